"""Winches: tables of their ropes, series at rows, and limits of paying out (forces/winch.py)."""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.forces.winch import GAUSS, Winches, motion_of_ropes, weight_of_ropes
from fastbeam.kernels.state import State
from fastbeam.model.analyses import Analysis, Lack, always, unknown_to_methods, without_adjoint
from fastbeam.model.feature import Feature, OfRun
from fastbeam.model.workspace import law_work

Array = np.ndarray


class Ropes:
    """Nodes of the ropes of all winches of a scene.

    node: int64 [G, 3], upper and lower end of every segment, and the drum.
    of: int64 [G], number of the winch.
    """

    def __init__(self, scene: Any, nodes: Any) -> None:
        self.winches = scene.winches
        self.gravity = np.array(scene.gravity, float)
        found, of = [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)]
        for k, winch in enumerate(self.winches):
            chain = [nodes.number(winch.drum), *(nodes.start(x) for x in winch.points), nodes.number(winch.load)]
            drum = np.full(winch.segments, nodes.start(winch.coil))
            found.append(np.stack((chain[:-1], chain[1:], drum), axis=1).astype(np.int64))
            of.append(np.full(winch.segments, k))
        self.node, self.of = np.concatenate(found), np.concatenate(of)

    def pairs(self, root: Array) -> list[Array]:
        """Return the pairs of coupled nodes as i N + j; root: the node whose row a node shares."""
        nodes = root[self.node].T
        return [a * root.size + b for a in nodes for b in nodes]

    def table(self, row_of: Array, blocks: Any, q: Array) -> Winches:
        """Build the term; q [N, 3]: positions at the start."""
        of, node = self.of, self.node
        first = np.flatnonzero(np.diff(of, prepend=-1))

        def each(name: str) -> Array:
            return np.array([float(getattr(winch, name)) for winch in self.winches])

        segments = each("segments")
        mass = each("mass_per_length")
        has = np.array([winch.total is not None for winch in self.winches])
        total = np.array([np.inf if winch.total is None else winch.total for winch in self.winches])
        block = np.stack([blocks.between(node[:, i], node[:, j]) for i in range(3) for j in range(3)], axis=1)
        return Winches(node, row_of[node], block, segments[of] - (np.arange(of.size) - first[of]), segments[of],
                       each("length")[of], q[node[:, 2], 0].copy(), each("stiffness")[of], mass[of], first, total,
                       np.where(has, mass, 0.0), each("inertia"), self.gravity, law_work())


UNKNOWN = (Analysis.RELAX, Analysis.PATH, Analysis.LENGTHS, Analysis.SENSITIVITY, Analysis.MASSES, Analysis.CATCHING)


class Hoists(Feature):
    """Winches of a scene, and their ropes."""

    key, title, order = "hoists", "winches", 105
    lacks = (
        Lack((Analysis.PLANAR,), "winches", "{name} is available in space only", "use planar='auto'",
             lambda hoists, asked: [winch.label for winch in hoists.winches]),
        unknown_to_methods("winches"),
        Lack(UNKNOWN, "winches", "{who} does not support winches",
             "use simulate or solve_static, or replace the winch by a Spring of the same length and stiffness, and a mass",
             always("winches")),
        Lack((Analysis.PROJECTION,), "winches", "{who}: project_velocities does not support "
                                                "winches", "give compatible velocities",
             always("winches")),
        Lack((Analysis.INNER,), "ropes", "observe: 'inner' does not support the ropes of winches", "leave it out",
             always("winches")),
        Lack((Analysis.GRAVITY_IN_TIME,), "ropes", "{name}: ropes support constant gravity only", "leave gravity_time out",
             lambda hoists, asked: [winch.label for winch in hoists.winches]),
        Lack((Analysis.STEADY,), "ropes", "{who}: steady motions do not support ropes of winches",
             "replace them by a Spring of the same length and stiffness, and a mass", always("winches")),
        without_adjoint("winches"))

    def __init__(self, winches: list[Any]) -> None:
        self.winches = winches

    def describe(self) -> list[tuple[str, str, list[str]]]:
        """Return the line of `print(model)`: ropes and their segments."""
        ropes, segments = len(self.winches), sum(x.segments for x in self.winches)
        return [("winches", f"{ropes} rope{'s' * (ropes > 1)} of {segments} segments: ", [x.name for x in self.winches])]

    def link_of_run(self, table: Any, run: OfRun) -> Any:
        """Return the table of ropes with the work array of the run; other tables unchanged."""
        return table._replace(work=run.law_work) if isinstance(table, Winches) else table

    def add_motion(self, model: Any, state: State, out: Array) -> None:
        """Add the kinetic energy and the momenta of all ropes."""
        motion_of_ropes(ropes_of(model), state.q, state.v, out)

    def weight(self, model: Any, q: Array) -> float:
        """Return the energy of all ropes in the gravity of the scene, J."""
        out = np.zeros(1)
        weight_of_ropes(ropes_of(model), q, out)
        return float(out[0])


class WinchRows:
    """Free length, m, its rate, m/s, and tension at the drum and at the load, N, of winches at rows. The tension at both ends of
    the rope is extrapolated linearly from the last two segments; a single segment counts with its weight, without its inertia."""

    kind = "winches"

    def __init__(self, names: list[str], table: Winches) -> None:
        self.names, self._table = names, table
        self._last = np.append(table.first[1:], table.below.size) - 1

    def series(self) -> dict[str, tuple[int, ...]]:
        """Return the shapes of their series."""
        n = len(self.names)
        return {"winch_length": (n,), "winch_speed": (n,), "winch_tension": (n, 2)}

    def slack(self, state: State) -> list[str]:
        """Return the names of winches without tension."""
        tension = self.row(state)["winch_tension"]
        return [name for name, both in zip(self.names, tension) if not np.any(both > 0.0)]

    def row(self, state: State) -> dict[str, Array]:
        """Evaluate the series of one row."""
        t = self._table
        x, v = (y.reshape(-1, 12)[:, :3] for y in (state.q, state.v))
        drum = t.node[t.first, 2]
        length = t.length[t.first] + (x[drum, 0] - t.origin[t.first])
        unstressed = length / t.segments[t.first]

        def force(k: Array) -> Array:
            """Return the force of segments k [W], at their middles, on their upper ends, [W, 3]."""
            along = x[t.node[k, 1]] - x[t.node[k, 0]]
            chord = np.linalg.norm(along, axis=1)
            pull = t.stiffness[k] * np.maximum(chord - unstressed, 0.0) / unstressed
            return np.asarray((pull / np.maximum(chord, 1e-300))[:, None] * along)

        weight = (t.mass[t.first] * unstressed)[:, None] * t.gravity
        tension = []
        for end, side in ((t.first, 1), (self._last, -1)):
            own, other = force(end), force(end + side * (t.first < self._last))
            # weight and inertia change the force by a full step from middle to middle, and by half a step to the end
            change = np.where((t.first < self._last)[:, None], own - other, side * weight)
            pulls = own.any(axis=1) & other.any(axis=1)
            at_end = own + 0.5 * np.where(pulls[:, None], change, 0.0)
            tension.append(np.where(np.sum(own * at_end, axis=1) > 0.0, np.linalg.norm(at_end, axis=1), 0.0))
        return {"winch_length": length, "winch_speed": v[drum, 0].copy(), "winch_tension": np.stack(tension, axis=1)}


def ropes_of(model: Any) -> Winches | None:
    """Return the table of the ropes of a model; None without any."""
    return next((table for table in model.links if isinstance(table, Winches)), None)


def rope_masses(table: Winches, q: Array) -> Any:
    """Assemble the masses of ropes and drums at q [12 N] on the coordinates of all nodes, sparse [12 N, 12 N]: those of T in
    (4.24), with w by the velocities of both ends of a segment and the rate of the length."""
    x = q.reshape(-1, 12)[:, :3]
    a, b, drum = table.node.T
    length = table.length + (x[drum, 0] - table.origin)
    along = (x[b] - x[a]) / length[:, None]
    at = np.concatenate((12 * a[:, None] + np.arange(3), 12 * b[:, None] + np.arange(3), 12 * drum[:, None]), axis=1)
    blocks, places = [], []
    for place in (0.5 - GAUSS, 0.5 + GAUSS):
        w = np.zeros((len(at), 3, 7))
        w[:, :, :3], w[:, :, 3:6] = (1.0 - place) * np.eye(3), place * np.eye(3)
        w[:, :, 6] = (table.below - place)[:, None] * along
        blocks.append((0.5 * table.mass * length / table.segments)[:, None, None] * np.swapaxes(w, 1, 2) @ w)
        places.append(at)
    # rope on the drum moves with the drum and around it
    k = table.first
    store = np.where(table.stored > 0.0, table.stored * (np.where(table.stored > 0.0, table.total, 0.0) - length[k]), 0.0)
    on = np.zeros((k.size, 7, 7))
    on[:, np.arange(3), np.arange(3)] = store[:, None]
    on[:, 6, 6] = store + table.inertia
    values, where = np.concatenate((*blocks, on)), np.concatenate((*places, at[k]))
    rows, columns = np.broadcast_arrays(where[:, :, None], where[:, None, :])
    return sparse.csr_matrix((values.reshape(-1), (rows.reshape(-1), columns.reshape(-1))), shape=(q.size, q.size))


def used_up(model: Any, state: State, h: float) -> str:
    """Describe a rope that is all on its drum, or all paid out, one step of size h ahead; empty without any."""
    table = ropes_of(model)
    if table is None:
        return ""
    x, v = (y.reshape(-1, 12)[:, 0] for y in (state.q, state.v))
    for i, k in enumerate(table.first.tolist()):
        drum = table.node[k, 2]
        length = table.length[k] + (x[drum] - table.origin[k])
        ahead = length + 2.0 * h * v[drum]
        if not 0.0 < ahead <= table.total[i]:
            what = "all rope is paid out" if ahead > 0.0 else "all rope is on it"
            return f"{what}, of {model.labels[drum]}: the free length is {length:.6g} m, and changes by {v[drum]:.6g} m/s"
    return ""
