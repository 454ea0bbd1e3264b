"""Motions that nothing resists at an equilibrium, found from the parts of a scene, and named (theory.md 8).

A round beam between two ball joints spins about its axis, a body on a ball joint turns about it. Such motions are known as
vectors z, not as eigenvalues next to zero, which round-off gives either sign and which the softest bending of a fine mesh may
come near to. A vector counts where the tangent K has K z = 0 to round-off, every row next to its own terms.

Spins about axes are tried all at once, by one product of K. They leave the energy as it is at every shape. So Newton's method may
hold one unknown of each: the residual has nothing along z, and what holds z has nothing to do in the solution.
"""
from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.linalg.inertia import Nodes, strained
from fastbeam.model.maps import free_of_rows
from fastbeam.model.model import Model

Array = np.ndarray
# round-off of K z, relative to the sum of the sizes of its terms: for spins about axes, rigid motions of beams, and those of
# bodies alone, whose few terms have less (their weight on a beam of 5000 nodes may resist with 1e-15)
NOTHING, OF_BEAMS, OF_BODIES = 3e-14, 3e-15, 3e-16
# the same of forces and moments across the axes of spins, in which round-off of positions far from the origin stands; and share
# of what may be round-off of residuals that those about axes have
ACROSS, ABOUT = 1e-10, 1e-6
# square of what is left of motions, relative to sums of the sizes of its terms, from which on it is certainly no round-off
SURELY = 1e-10
# largest component of a motion at supports that allow it
FIXED_TOLERANCE = 1e-9
# components of a combination of motions of size 1 that count as zero
ROUND_OFF = 1e-12
# parts of rigid motions next to the whole that are another motion already; parts whose motions together are tried,
# numbers of these, and parts at all
NEGLIGIBLE, MOST_TOGETHER, MOST_NUMBERS, MOST_PARTS = 1e-5, 24, 2e7, 500
# beams of a part that may spin together
LONGEST_CHAIN = 50
# components of axes that are not shown
SMALL = 1e-6


class Part(NamedTuple):
    """Part of a model: beams and bodies joined rigidly."""

    name: str         # of its first beam or body
    several: bool     # whether there are others
    nodes: Array      # int [k]
    signs: Array      # float64 [k]: a spin about the axis of the first beam is one about these times d1; NaN where there is none


_KNOWN: WeakKeyDictionary[Model, list[Part]] = WeakKeyDictionary()
# parts of a model, or of one in a plane, as `_alike`
_GROUPS: WeakKeyDictionary[Model, list[_Alike]] = WeakKeyDictionary()


def _bound(matrix: Any) -> Callable[[Array], Array]:
    """Return the function that takes sizes of motions [n] to sums of the largest sizes that the terms of every row could have,
    those of entries K_ij and sqrt(K_ii K_jj)."""
    sizes, root = abs(matrix), np.sqrt(np.abs(matrix.diagonal()))
    there = type(matrix)((np.ones(matrix.nnz), matrix.indices, matrix.indptr), shape=matrix.shape)
    return lambda x: sizes @ x + root * (there @ (root * x))


class FreeMotions:
    """Motions of one model that nothing resists.

    model: Model in space, without elimination of inner nodes.
    axes: float64 [3, 3], axes of the plane where nodes have 3 unknowns.
    names: names of the motions that were found last.
    """

    def __init__(self, model: Model, axes: Array | None) -> None:
        self.model, self.axes = model, axes
        self._core = core = model if axes is None else model.plane.model
        size = len(core.dofs)
        self.nodes = Nodes(size * core.pattern.n, size, core.dim)
        self.names: tuple[str, ...] = ()
        # unknowns and motions in these of those found last
        self._found: list[tuple[Array, Array]] = []

    @cached_property
    def own(self) -> Array:
        """True where unknowns of rows are independent, bool [rows, 6]: tied nodes follow others."""
        model = self.model
        free = np.zeros((model.pattern.n, 6), bool)
        first = np.unique(model.pattern.row_of, return_index=True)[1]
        free[model.pattern.row_of[first]] = True
        if model.ties is not None:
            held = np.zeros(model.n_nodes, np.int64)
            if model.held is not None:
                held[model.held.row] = model.held.mask
            of = model.pattern.row_of[model.ties.slave]
            free[of] &= (held[of][:, None] >> np.arange(6)) & 1 == 0
        return free

    @cached_property
    def held(self) -> Array:
        """True where unknowns of nodes are fixed by supports or belong to tied nodes, bool [n]."""
        return free_of_rows(self._core, self._core.held) == 0.0

    @property
    def parts(self) -> list[Part]:
        """Parts of the model that are joined rigidly."""
        if (found := _KNOWN.get(self.model)) is None:
            found = _KNOWN[self.model] = _parts(self.model)
        return found

    @property
    def _alike(self) -> list[_Alike]:
        """Parts, grouped by their number of nodes. A node that supports fix in all directions leaves its part no motion."""
        if (found := _GROUPS.get(self._core)) is not None:
            return found
        pattern = self.model.pattern
        clamped = self.held.reshape(-1, self.nodes.size).all(axis=1) & self.own.all(axis=1)
        inside = [part.nodes[pattern.first_on_row[part.nodes] == part.nodes] for part in self.parts]
        count = np.array([0 if clamped[pattern.row_of[x]].any() else x.size for x in inside], np.int64)
        found = _GROUPS[self._core] = [_Alike(self, np.flatnonzero(count == k)) for k in np.unique(count[count > 0])]
        return found

    @cached_property
    def has_axes(self) -> bool:
        """True where some part has an axis, and may spin about it: beams in a line that no support clamps."""
        return any(alike.signs.any() for alike in self._alike)

    @property
    def may_be(self) -> bool:
        """True where some part has motions that its supports allow."""
        return self._may_move(self.model.q0.reshape(-1, 4, 3), True)

    def _may_move(self, q: Array, rigidly: bool) -> bool:
        """Return whether some part may spin at coordinates q or, if `rigidly`, move as a rigid body."""
        return any(alike.spins(self, q).any() or rigidly and alike.rigid(self, q).any() for alike in self._alike)

    def find(self, matrix: Callable[[], Any], q: Array) -> Array:
        """Return one unknown of every free motion [m]; `names` has their names.

        matrix: returns the tangent, sparse by rows [n, n]; unknowns of nodes come first.
        q: float64 [N, 4, 3], coordinates in space.
        """
        few = len(self.parts) <= MOST_PARTS
        if not self._may_move(q, few):
            self.names, self._found = (), []
            return np.zeros(0, np.int64)
        of = matrix()
        whole = (0.5 * (of + of.T)).tocsr()
        spins = _Spins(self, whole, q)
        spins.leave(spins.resisted(0.0))
        self._found = spins.motions
        unknowns = [spins.pivots]
        names = [f"{part.name} about {'their axes' if part.several else 'its axis'}"
                 for part in (self.parts[k] for k in spins.free)]
        loose = sorted(self._loose(q, spins), key=lambda one: one.number) if few else []
        count = sum(one.rigid.shape[1] for one in loose)
        together = len(loose) <= MOST_TOGETHER and count * whole.shape[0] <= MOST_NUMBERS
        if not together:
            loose = [one for one, sure in zip(loose, self._resisted(whole, loose)) if not sure]
        near = [_Near(self, whole, one) for one in loose]
        for group in ([near] if together else [[one] for one in near]):
            if group:
                held, how = self._of_group(whole, group)
                unknowns.append(held)
                names += how
        self.names = tuple(names)
        return np.concatenate(unknowns)

    def spins(self, matrix: Any, q: Array, residual: Array, round_off: Callable[[], Array]) -> Array:
        """Return one unknown [m] of every spin about an axis that Newton's method may hold at any shape.

        matrix: sparse by rows [n, n].
        q: see `find`.
        residual: float64 [n], residual of the unknowns of nodes at this shape.
        round_off: returns how much of the residual may be round-off, float64 [n].
        """
        if not self._may_move(q, False):
            return np.zeros(0, np.int64)
        spins = _Spins(self, matrix, q)
        # on the way to an equilibrium moments turn with the sections
        slack = np.zeros(matrix.shape[0])
        slack[:residual.size] = np.repeat(np.linalg.norm(residual.reshape(-1, self.nodes.size), axis=1), self.nodes.size)
        spins.leave(spins.resisted(slack))
        spins.leave(spins.driven(residual, ABOUT * round_off()))
        return spins.pivots

    def _loose(self, q: Array, spins: _Spins) -> list[_Loose]:
        """Return parts that supports let move otherwise than by free spins."""
        out = []
        for alike in self._alike:
            rest = _without(alike.rigid(self, q), spins.of_parts(alike))
            out += [_Loose(int(alike.numbers[j]), alike.rows[j], alike.unknowns[j], rest[j][:, rest[j].any(axis=0)])
                    for j in np.flatnonzero(rest.any(axis=(1, 2)))]
        return out

    def _resisted(self, whole: Any, loose: list[_Loose]) -> Array:
        """Return whether every motion of these parts, each moving alone, is resisted by far more than round-off, bool [parts]."""
        part = np.repeat(np.arange(len(loose)), [one.rigid.size for one in loose])
        rows = np.concatenate([np.repeat(one.unknowns, one.rigid.shape[1]) for one in loose])
        columns = 6 * part + np.concatenate([np.tile(np.arange(one.rigid.shape[1]), one.unknowns.size) for one in loose])
        motions = sparse.csr_matrix((np.concatenate([one.rigid.reshape(-1) for one in loose]), (rows, columns)),
                                    shape=(whole.shape[0], 6 * len(loose)))
        total = _bound(whole)(np.abs(motions).sum(axis=1).A1)
        left = sparse.diags(1.0 / np.where(total > 0.0, total, 1.0)) @ whole @ motions
        products = (left.T @ left).tobsr((6, 6))
        of = np.repeat(np.arange(len(loose)), np.diff(products.indptr))
        forms = np.zeros((len(loose), 6, 6))
        forms[of[products.indices == of]] = products.data[products.indices == of]
        absent = np.arange(6) >= np.array([one.rigid.shape[1] for one in loose])[:, None]
        return np.asarray(np.linalg.eigvalsh(forms + absent[:, None] * np.eye(6))[:, 0] > SURELY)

    def motions(self, n: int) -> Array:
        """Return the motions found last, among n unknowns, by columns [n, m]."""
        ends = np.cumsum([0, *(x.shape[1] for _, x in self._found)])
        out = np.zeros((n, ends[-1]))
        for (unknowns, x), first, last in zip(self._found, ends, ends[1:]):
            out[unknowns, first:last] = x
        return out

    def on_unknowns(self, rows: Array, motion: Array) -> Array:
        """Return velocities and spins [k, 6, m] of nodes that have these rows [k] in their unknowns [k, size, m]."""
        motion = motion * self.own[rows][:, :, None]
        if self.axes is None:
            return motion
        shift = np.einsum("ij,njm->nim", self.axes[:2], motion[:, :3])
        return np.concatenate((shift, np.einsum("j,njm->nm", self.axes[2], motion[:, 3:])[:, None]), axis=1)

    def _of_group(self, whole: Any, group: list[_Near]) -> tuple[Array, list[str]]:
        """Find free motions of parts that may move together: one unknown of each [m], and their names."""
        if len(group) == 1:
            matrix, nodes, motions, unknowns = group[0].matrix, group[0].nodes, group[0].rest, group[0].unknowns
        else:
            matrix, nodes, unknowns = whole, self.nodes, np.arange(whole.shape[0])
            ends = np.cumsum([0, *(near.rest.shape[1] for near in group)])
            motions = np.zeros((whole.shape[0], ends[-1]))
            for k, near in enumerate(group):
                motions[near.unknowns, ends[k]:ends[k + 1]] = near.rest
        round_off = OF_BODIES if all(near.part.nodes.size == 1 for near in group) else OF_BEAMS
        found = motions @ _null(matrix, nodes, motions, round_off)
        self._found.append((unknowns, found))
        return unknowns[_pivots(matrix, found)], [self._name(group, unknowns, x) for x in found.T]

    def _name(self, group: list[_Near], unknowns: Array, x: Array) -> str:
        """Name a motion x of these unknowns: the part that moves most, and its axis or direction."""
        motion = np.zeros(self.nodes.total + 1)
        motion[np.minimum(unknowns, self.nodes.total)] = x
        rows = motion[:-1].reshape(-1, self.nodes.size)[self.model.pattern.row_of]
        if self.axes is None:
            shift, turn = rows[:, :3], rows[:, 3:]
        else:
            shift, turn = rows[:, :2] @ self.axes[:2], rows[:, 2:] * self.axes[2]
        shift = shift / self.model.length
        sizes = np.array([np.max(np.linalg.norm(np.hstack((shift, turn))[near.part.nodes], axis=1)) for near in group])
        part, others = group[int(np.argmax(sizes))].part, int(np.sum(sizes > NEGLIGIBLE * np.max(sizes))) - 1
        with_others = f" and {others} more that move with it" if others else ""
        turn, shift = (y[part.nodes][np.argmax(np.linalg.norm(y[part.nodes], axis=1))] for y in (turn, shift))
        if np.linalg.norm(turn) > NEGLIGIBLE * np.max(sizes):
            return f"{part.name}{with_others} about {_axis(turn)}"
        return f"{part.name}{with_others} along {_axis(shift)}"


class _Alike:
    """Parts with equally many nodes, and their motions that supports allow, in their own unknowns."""

    def __init__(self, of: FreeMotions, numbers: Array) -> None:
        pattern, size = of.model.pattern, of.nodes.size
        parts = [of.parts[k] for k in numbers]
        first = [pattern.first_on_row[part.nodes] == part.nodes for part in parts]
        self.numbers = numbers
        self._inside = np.stack([part.nodes[x] for part, x in zip(parts, first)])
        self.signs = np.stack([part.signs[x] for part, x in zip(parts, first)])
        self.rows = pattern.row_of[self._inside]
        self.unknowns = (self.rows[:, :, None] * size + np.arange(size)).reshape(len(parts), -1)
        self._held = of.held[self.unknowns]

    def spins(self, of: FreeMotions, q: Array) -> Array:
        """Return spins about axes [parts, unknowns], zero where there is none."""
        out = of.on_unknowns(self.rows.reshape(-1), _spin(self.signs.reshape(-1), q[self._inside.reshape(-1), 1]))
        out = out.reshape(self.unknowns.shape)
        return out * ~np.any(out * self._held, axis=1)[:, None]

    def rigid(self, of: FreeMotions, q: Array) -> Array:
        """Return shifts and turns [parts, unknowns, 6], zero where there are fewer."""
        motion = np.stack([_rigid(x, of.model.length) for x in q[self._inside, 0]])
        motion = of.on_unknowns(self.rows.reshape(-1), motion.reshape(-1, 6, 6)).reshape(*self.unknowns.shape, 6)
        # parts of the motions at fixed unknowns
        sizes, turn = _singular(motion * self._held[:, :, None])
        allowed = sizes <= FIXED_TOLERANCE * np.maximum(1.0, np.max(sizes, axis=1))[:, None]
        out = motion @ (turn * allowed[:, :, None]).transpose(0, 2, 1)
        return np.where(self._held[:, :, None], 0.0, out)


class _Spins:
    """Spins of beams about their axes that supports allow, at one shape; free: int [m], numbers of the parts that have one,
    ascending, without those that were left."""

    def __init__(self, of: FreeMotions, matrix: Any, q: Array) -> None:
        self._of, self._matrix, n = of, matrix, matrix.shape[0]
        self._spin, self._part = np.zeros(n), np.full(n, -1)
        for alike in of._alike:
            spin = alike.spins(of, q)
            self._spin[alike.unknowns] += spin
            moves = spin.any(axis=1)
            self._part[alike.unknowns[moves]] = alike.numbers[moves, None]
        self._part[self._spin == 0.0] = -1
        self.free = np.unique(self._part[self._part >= 0])
        self._root = np.sqrt(np.abs(matrix.diagonal()))

    def of_parts(self, alike: Any) -> Array:
        """Return the spins [parts, unknowns] of parts with equally many nodes, zero where there is none."""
        return np.where(self._part[alike.unknowns] == alike.numbers[:, None], self._spin[alike.unknowns], 0.0)

    @property
    def motions(self) -> list[tuple[Array, Array]]:
        """Unknowns of every part [k], and its spin in these [k, 1]."""
        at = np.flatnonzero(self._part >= 0)
        at = at[np.argsort(self._part[at], kind="stable")]
        ends = np.flatnonzero(np.diff(self._part[at])) + 1
        return [(x, self._spin[x, None]) for x in np.split(at, ends)] if at.size else []

    @property
    def pivots(self) -> Array:
        """One unknown of every part, the stiffest."""
        at = np.flatnonzero(self._part >= 0)
        size = np.abs(self._spin[at]) * np.where(self._root > 0.0, self._root, SMALL * np.max(self._root, initial=1.0))[at]
        at = at[np.lexsort((-size, self._part[at]))]
        return at[np.unique(self._part[at], return_index=True)[1]]

    def leave(self, parts: Array) -> None:
        """Take spins of some parts out."""
        gone = np.isin(self._part, parts)
        self._spin[gone], self._part[gone] = 0.0, -1
        self.free = np.setdiff1d(self.free, parts)

    def driven(self, residual: Array, round_off: Array) -> Array:
        """Return parts that the residual of nodes [n] turns about their axes by more than its round-off."""
        at = np.flatnonzero(self._part >= 0)
        pushed, most = (np.bincount(self._part[at], x[at], len(self._of.parts))
                        for x in (self._spin[:residual.size] * residual, np.abs(self._spin[:residual.size]) * round_off))
        return np.flatnonzero(np.abs(pushed) > most)

    def resisted(self, slack: Array | float) -> Array:
        """Return parts whose spins the matrix resists; slack: float64 [n], forces and moments that are neglected besides
        round-off."""
        count, size, _ = self._of.nodes
        matrix, bound = self._matrix, _bound(self._matrix)
        # not the same of all parts, which would hide springs between two of them
        weight = np.random.default_rng(0).uniform(0.5, 1.0, len(self._of.parts) + 1)
        out: list[Array] = []
        while True:
            part = np.where(np.isin(self._part, np.concatenate(out)), -1, self._part) if out else self._part
            spin = np.where(part >= 0, self._spin * weight[part], 0.0)
            of_nodes = np.zeros(spin.size)
            of_nodes[:count] = np.repeat(np.linalg.norm(spin[:count].reshape(-1, size), axis=1), size)
            moved = of_nodes > 0.0
            left = matrix @ spin
            own, most = (bound(x) for x in (np.abs(spin), of_nodes))
            across = np.abs(left) > ACROSS * most + slack
            along, terms = (np.sum(x[:count].reshape(-1, size), axis=1)
                            for x in (spin * left, np.abs(spin) * (NOTHING * own + slack)))
            of_rows = np.max(part[:count].reshape(-1, size), axis=1)
            bad = [of_rows[np.abs(along) > terms], np.repeat(of_rows, size)[(across & moved)[:count]]]
            if not any(x.size for x in bad) and across.any():
                touched = matrix[np.flatnonzero(across)].indices
                bad = [part[touched][part[touched] >= 0]]
            if not any(x.size for x in bad):
                return np.unique(np.concatenate([np.zeros(0, np.int64), *out]))
            out += bad


class _Loose(NamedTuple):
    """Part that supports let move as a rigid body."""

    number: int
    rows: Array       # int [k]: rows of its nodes
    unknowns: Array   # int [n]
    rigid: Array      # float64 [n, m]: its motions in these


class _Near:
    """Rigid motions of a part in the unknowns of the rows of the tangent that these reach."""

    def __init__(self, of: FreeMotions, whole: Any, loose: _Loose) -> None:
        own, (count, size, dim) = loose.unknowns, of.nodes
        self.part = of.parts[loose.number]
        reached = whole[own].indices
        rows = np.unique(np.concatenate((loose.rows, reached[reached < count] // size)))
        others = np.unique(reached[reached >= count])
        self.unknowns = np.concatenate(((rows[:, None] * size + np.arange(size)).reshape(-1), others))
        self.nodes = Nodes(rows.size * size, size, dim)
        self.matrix = whole[self.unknowns][:, self.unknowns]
        self.rest = np.zeros((self.unknowns.size, loose.rigid.shape[1]))
        self.rest[np.searchsorted(self.unknowns[:self.nodes.total], own)] = loose.rigid


def _spin(signs: Array, axes: Array) -> Array:
    """Return velocities and spins [k, 6, 1] of nodes that spin about their axes [k, 3]."""
    out = np.zeros((len(axes), 6, 1))
    out[:, 3:, 0] = np.nan_to_num(signs)[:, None] * axes
    return out


def _rigid(x: Array, length: float) -> Array:
    """Return velocities and spins [k, 6, 6] of nodes at x [k, 3] that move together: shifts, and turns about their middle."""
    off = x - x.mean(axis=0)
    reach = float(np.max(np.linalg.norm(off, axis=1), initial=0.0)) or length
    out = np.zeros((len(x), 6, 6))
    out[:, :3, :3], out[:, 3:, 3:] = reach * np.eye(3), np.eye(3)
    out[:, :3, 3:] = np.cross(np.eye(3)[None], off[:, None]).transpose(0, 2, 1)
    return out


def _scaled(matrix: Any, nodes: Nodes, x: Array) -> Array:
    """Return K x of motions [n, m], every row relative to the sum of the sizes of its terms."""
    product, size = strained(matrix, nodes, x)
    total = size.sum(axis=1)
    return product[total > 0.0] / total[total > 0.0, None]


def _null(matrix: Any, nodes: Nodes, x: Array, round_off: float) -> Array:
    """Return the combinations [k, m] of motions x [n, k] that only round-off resists."""
    product = _scaled(matrix, nodes, x)
    turn = _singular(product)[1]
    left = np.max(np.abs(product @ turn.T), axis=0, initial=0.0)
    c = turn[left <= round_off].T
    return np.where(np.abs(c) > ROUND_OFF, c, 0.0)


def _pivots(matrix: Any, x: Array) -> Array:
    """Choose as many unknowns as there are motions x [n, m], such that fixing them fixes the motions; stiff ones where there is a
    choice."""
    from scipy.linalg import qr
    stiff = np.sqrt(np.abs(matrix.diagonal()))
    stiff[stiff == 0.0] = SMALL * np.max(stiff, initial=1.0)
    if x.shape[1] < 2:
        return np.argmax(stiff[:, None] * np.abs(x), axis=0)
    return qr((stiff[:, None] * x).T, mode="r", pivoting=True)[1][:x.shape[1]]


def _parts(model: Model) -> list[Part]:
    """Find beams and bodies that are joined rigidly, because they share triads."""
    names = model.names
    groups = [(f"beam {x['name']!r}", np.arange(x["first"], x["first"] + x["count"])) for x in names["beams"]]
    for net in names.get("nets", []):
        starts = net["first"] + np.append(net["starts"], net["count"])
        groups += [(model.labels[a].split(" node ")[0], np.arange(a, b)) for a, b in zip(starts[:-1], starts[1:])]
    beams = len(groups)
    groups += [(f"body {x['name']!r}", np.array([x["node"]])) for x in names["bodies"]]
    if not groups:
        return []
    # a triad is a node's own, or that of the root of what it is welded to, or that of a node on the same row
    triad = np.asarray(model.spin_root)[model.pattern.first_on_row]
    member = np.repeat(np.arange(len(groups)), [len(x) for _, x in groups])
    m, n, nodes = len(groups), model.n_nodes, np.concatenate([x for _, x in groups])
    graph = sparse.coo_matrix((np.ones(nodes.size), (member, m + triad[nodes])), shape=(m + n, m + n))
    which = np.unique(sparse.csgraph.connected_components(graph, directed=False)[1][:m], return_inverse=True)[1]
    d1 = model.q0.reshape(-1, 4, 3)[:, 1]
    out = []
    for group in np.split(np.argsort(which, kind="stable"), np.cumsum(np.bincount(which))[:-1]):
        own, several = [groups[k][1] for k in group], group.size > 1
        signs = _signs(own, triad, d1) if np.all(group < beams) and len(group) <= LONGEST_CHAIN else np.full(len(own), np.nan)
        out.append(Part(groups[group[0]][0] + several * " and what is joined to it", several, np.concatenate(own),
                        np.repeat(signs, [len(x) for x in own])))
    return out


def _signs(beams: list[Array], triad: Array, d1: Array) -> Array:
    """Return 1 or -1 for each of some beams that are joined, such that they spin about their axes together where they are in
    line."""
    shared: dict[int, list[tuple[int, int]]] = {}
    for k, nodes in enumerate(beams):
        for node in nodes.tolist():
            shared.setdefault(int(triad[node]), []).append((k, node))
    signs = np.full(len(beams), np.nan)
    signs[0], todo = 1.0, [pairs for pairs in shared.values() if len(pairs) > 1]
    for _ in beams:
        for pairs in todo:
            known = [(k, node) for k, node in pairs if not np.isnan(signs[k])]
            for k, node in pairs if known else ():
                if np.isnan(signs[k]):
                    signs[k] = signs[known[0][0]] * (1.0 if d1[node] @ d1[known[0][1]] > 0.0 else -1.0)
    return signs


def _without(x: Array, known: Array) -> Array:
    """Return motions [parts, n, m] without their parts along a known one [parts, n], all of size 1; zero where nothing is
    left."""
    def unit(y: Array) -> Array:
        size = np.linalg.norm(y, axis=1, keepdims=True)
        return y / np.where(size > 0.0, size, 1.0)

    x, along = unit(x), unit(known)[:, :, None]
    x = x - along @ (along.transpose(0, 2, 1) @ x)
    sizes, turn = _singular(x)
    share = np.where(sizes > NEGLIGIBLE, 1.0 / np.maximum(sizes, NEGLIGIBLE), 0.0)
    return x @ (share[:, :, None] * turn).transpose(0, 2, 1)


def _singular(x: Array) -> tuple[Array, Array]:
    """Return singular values [..., m] and right vectors by rows [..., m, m] of matrices [..., n, m]."""
    short = max(x.shape[-1] - x.shape[-2], 0)
    x = np.concatenate((x, np.zeros((*x.shape[:-2], short, x.shape[-1]))), axis=-2)
    return np.linalg.svd(np.linalg.qr(x, mode="r"))[1:]


def _axis(v: Array) -> str:
    v = v / np.linalg.norm(v)
    v = np.where(np.abs(v) < SMALL, 0.0, v)
    v = v * np.sign(v[np.argmax(np.abs(v) > 0.0)]) + 0.0
    return "(" + ", ".join(f"{x:.3g}" for x in v) + ")"
