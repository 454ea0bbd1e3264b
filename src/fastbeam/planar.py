"""Scenes that stay in a plane: found from the compiled tables, and the same tables with 3 unknowns a node (theory.md 10)."""
from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from .kernels.beam import ElementTables
from .kernels.inner import Inner, NoColumns, store_size
from .kernels.kinds import PLANE, SPACE
from .kernels.layout import layout_of
from .kernels.nodes import Held
from .kernels.planar_nodes import PlanarBodies, PlanarTies
from .kernels.substructures import place_stores
from .kernels.terms import NoTies
from .kernels.work import State
from .tables import CHUNK, TablePool

if TYPE_CHECKING:
    from .model import Model

Array = np.ndarray
# components out of the plane that count as round-off, relative to the largest quantity of the same kind
TOLERANCE = 1e-12
AXES = "xyz"


class NotPlanar(Exception):
    """Why a scene has to be run in space."""


@dataclass
class Plane:
    """The plane of a scene and its tables.

    Attributes
    ----------
    axes : float64 [3, 3]
        Two axes in the plane and its normal, by rows.
    height : float
        Of all nodes along the normal, m.
    factor : complex128 [N, 3]
        Director i of a node is factor_i u in the plane: a + i b stands for a u + b J u.
    normal : float64 [N, 3]
        Constant component of the directors along the normal.
    vectors : int
        Forces of constraints that are vectors; behind them come single ones.
    model : Model
        With 4 coordinates a node, x, y and u, and 3 unknowns.
    """

    axes: Array
    height: float
    factor: Array
    normal: Array
    vectors: int
    model: Any = None

    @property
    def label(self) -> str:
        """Text for `print(model)`."""
        k = np.flatnonzero(self.axes[2] == 1.0)
        if k.size:
            return "plane normal to " + AXES[k[0]]
        return "plane with normal (" + ", ".join(f"{x:.3g}" for x in self.axes[2]) + ")"

    def reduce(self, state: State) -> State:
        """Coordinates in the plane."""
        n = len(self.factor)
        flat = [_complex(x.reshape(n, 4, 3), self.axes) for x in (state.q, state.v)]
        # u from the director that lies best in the plane
        k = np.argmax(np.abs(self.factor), axis=1)
        at = np.arange(n)
        q, v = (np.stack((z[:, 0], z[at, 1 + k] / self.factor[at, k]), axis=1) for z in flat)
        vectors = 3 * self.vectors
        force = _complex(state.force[:vectors].reshape(-1, 3), self.axes)
        return State(_numbers(q), _numbers(v), state.s.copy(), np.concatenate((_numbers(force), state.force[vectors:])),
                     state.history.copy())

    def expand(self, flat: State) -> State:
        """Coordinates in space."""
        vectors = 2 * self.vectors
        force = np.concatenate((self.forces(flat.force[:vectors]), flat.force[vectors:]))
        return State(self._within(flat.q) + self._above, self._within(flat.v), flat.s.copy(), force, flat.history.copy())

    def _within(self, x: Array) -> Array:
        """[12 N] from [4 N], without what points along the normal."""
        z = x.view(complex).reshape(-1, 2)
        place = np.empty((len(z), 4), complex)
        place[:, 0] = z[:, 0]
        np.multiply(self.factor, z[:, 1:], out=place[:, 1:])
        return _vectors(place, self.axes).reshape(-1)

    @cached_property
    def _above(self) -> Array:
        """What points along the normal, [12 N]."""
        up = np.concatenate((np.full((len(self.factor), 1), self.height), self.normal), axis=1)
        return (up[:, :, None] * self.axes[2]).reshape(-1)

    def forces(self, force: Array) -> Array:
        """Contact forces [..., 2 S] in space, [..., 3 S]."""
        return _vectors(force.view(complex), self.axes).reshape(*force.shape[:-1], -1)

    def holds(self, state: State) -> bool:
        """Whether a state lies in the plane."""
        try:
            _check_state(state.q, state.v, self, self.model.length)
        except NotPlanar:
            return False
        force = state.force[:3 * self.vectors].reshape(-1, 3)
        # contact forces carry the round-off of the stiffest directions
        return bool(np.all(np.abs(force @ self.axes[2]) <= 10.0 * TOLERANCE * np.max(np.abs(force), initial=1e-300)))


def _complex(x: Array, axes: Array) -> Array:
    return x @ axes[0] + 1j * (x @ axes[1])


def _numbers(z: Array) -> Array:
    return np.stack((z.real, z.imag), axis=-1).reshape(-1)


def _vectors(z: Array, axes: Array) -> Array:
    return z.view(float).reshape(*z.shape, 2) @ axes[:2]


def find_plane(model: Model) -> tuple[Plane | None, str]:
    """The plane in which a model stays, with its tables; or None and the reason."""
    try:
        plane = _plane_of(model)
        plane.model = _reduced(model, plane)
    except NotPlanar as reason:
        return None, str(reason)
    return plane, ""


def _plane_of(model: Model) -> Plane:
    q, v = model.q0.reshape(-1, 4, 3), model.v0.reshape(-1, 4, 3)
    rows = model.loads.reshape(-1, model.n_nodes + 1, 8)[:, model.pattern.row_of]
    within = [(q[:, 0] - q[0, 0], "{} lies out of the plane of other nodes"),
              (v[:, 0], "the initial velocity of {} points out of the plane"),
              (model.gravity[None], "gravity points out of the plane"),
              *((x, "the load on {} points out of the plane") for x in rows[:, :, :3])]
    # round-off of spins and moments has no axis
    speed, push = (float(np.max(np.abs(x), initial=0.0)) for x in (v[:, 0], rows[:, :, :3]))
    spins = _without_noise(np.cross(q[:, 1:], v[:, 1:]).sum(axis=1), speed / model.length)
    across = [(spins, "the initial spin of {} is not about the normal of the plane")]
    across += [(_without_noise(x, push * model.length), "the moment on {} is not about the normal of the plane")
               for x in rows[:, :, 3:6]]
    normal = _normal([x for x, _ in within], [x for x, _ in across], q[0, 1:])
    axes = _axes(normal)
    normal = axes[2]
    for x, why in within:
        _refuse(np.abs(x @ normal), TOLERANCE * np.max(np.linalg.norm(x, axis=1)), why, model)
    for x, why in across:
        off = np.linalg.norm(x - (x @ normal)[:, None] * normal, axis=1)
        _refuse(off, TOLERANCE * np.max(np.linalg.norm(x, axis=1)), why, model)
    flat = _complex(q[:, 1:], axes)
    # u is the director that lies best in the plane, the first of equals: d1 of a beam
    k = np.argmax(np.round(np.abs(flat), 9), axis=1)
    u = flat[np.arange(len(q)), k]
    factor = flat * (np.conj(u) / np.abs(u))[:, None]
    vectors = model.n_sliders + sum(link.law.is_vector for link in model.kept)
    plane = Plane(axes, float(q[0, 0] @ normal), _snapped(factor), _snapped(q[:, 1:] @ normal), vectors)
    _check_state(model.q0, model.v0, plane, model.length)
    _refuse((model.numbers.rank == 3) * np.where(k == 0, np.abs(plane.normal[:, 0]), 1.0), TOLERANCE,
            "the section of {} does not stand upright on the plane", model)
    return plane


def _refuse(off: Array, limit: float | Array, why: str, model: Model, nodes: Array | None = None) -> None:
    """Refuse the plane where `off` [n] of a node (of `nodes` [n]; default: all of the model) exceeds its limit; names it."""
    if np.any(off > limit):
        k = int(np.argmax(off))
        raise NotPlanar(why.format(model.node_label(k if nodes is None else int(nodes[k]))))


def _without_noise(x: Array, size: float) -> Array:
    """Vectors [n, 3], zero where next to `size` they are round-off."""
    return np.where(np.linalg.norm(x, axis=1, keepdims=True) > TOLERANCE * size, x, 0.0)


def _snapped(x: Array) -> Array:
    """0, 1 and -1 where round-off is all that is missing."""
    if np.iscomplexobj(x):
        return _snapped(x.real) + 1j * _snapped(x.imag)
    near = np.round(x)
    return np.where(np.abs(x - near) < 1e-14, near, x)


def _normal(within: list[Array], across: list[Array], triad: Array) -> Array:
    """Of the plane that holds the vectors `within`, whose normal has the direction of those `across`."""
    for x in across:
        size = np.linalg.norm(x, axis=1)
        if np.any(size > 0.0):
            return x[np.argmax(size)] / np.max(size)
    # three rows at least
    known = np.zeros((3, 3))
    size, directions = np.zeros(3), np.eye(3)
    for x in within:
        if np.any(x):
            known = np.concatenate((known, x / np.max(np.linalg.norm(x, axis=1))))
            _, size, directions = np.linalg.svd(known, full_matrices=False)
        if size[1] > 1e-9 * size[0]:
            # a director of the first node is more exact where it has this direction
            return min((d for d in triad if np.linalg.norm(np.cross(d, directions[2])) < 1e-9),
                       key=lambda d: -abs(d @ directions[2]), default=directions[2])
    if not size[0] > 0.0:
        raise NotPlanar("a single point at rest has no plane")
    # everything on one line: any plane through it that the first triad allows
    for d in triad[::-1]:
        if abs(d @ directions[0]) < TOLERANCE:
            return d
    raise NotPlanar("everything lies on one line, and the triads are oblique to it")


def _axes(normal: Array) -> Array:
    """Two axes and the normal; coordinate axes where the normal is one."""
    k = int(np.argmax(np.abs(normal)))
    if np.max(np.abs(np.delete(normal, k))) < 0.1 * TOLERANCE:
        return np.eye(3)[[(k + 1) % 3, (k + 2) % 3, k]]
    first = np.eye(3)[np.argmin(np.abs(normal))]
    first = first - (first @ normal) * normal
    first /= np.linalg.norm(first)
    return np.stack((first, np.cross(normal, first), normal))


def _check_state(q: Array, v: Array, plane: Plane, length: float) -> None:
    n = plane.axes[2]
    q, v = q.reshape(-1, 4, 3), v.reshape(-1, 4, 3)
    size = length + float(np.max(np.abs(q[:, 0]), initial=0.0))
    speed = float(np.max(np.abs(v), initial=0.0))
    if np.any(np.abs(q[:, 0] @ n - plane.height) > TOLERANCE * size) or np.any(np.abs(v @ n) > TOLERANCE * speed):
        raise NotPlanar("a node leaves the plane")
    if np.any(np.abs(q[:, 1:] @ n - plane.normal) > TOLERANCE):
        raise NotPlanar("a triad is turned out of the plane")


# --- tables -----------------------------------------------------------------------------------------------------------
def _reduced(model: Model, plane: Plane) -> Model:
    axes = plane.axes
    state = plane.reduce(model.state())
    loads = np.zeros_like(model.loads)
    if loads.size:
        rows, out = (x.reshape(-1, model.n_nodes + 1, 8) for x in (model.loads, loads))
        out[:, :, 0], out[:, :, 1], out[:, :, 2] = rows[:, :, :3] @ axes[0], rows[:, :, :3] @ axes[1], rows[:, :, 3:6] @ axes[2]
    simo, green = (_elements(model, tables, plane) for tables in (model.simo, model.green))
    ties = _ties(model, plane, state)
    flat = replace(
        model, simo=simo, green=green, inner=_inner(model.inner, [simo, green]),
        substructures=None if model.substructures is None else place_stores(model.substructures, 3),
        bodies=_bodies(model, plane), links=tuple(_link(table, ties) for table in model.links), ties=ties, held=_held(model.held),
        static_held=_held(model.static_held), loads=loads, q0=state.q,
        v0=state.v, size=PLANE, plane=None)
    flat.softest = model.softest
    return flat


def _elements(model: Model, tables: ElementTables | None, plane: Plane) -> ElementTables | None:
    """With the angle t of d2 against J d1 the strains of space are T (stretch, shear, curvature)."""
    if tables is None:
        return None
    meta = tables.meta.copy()
    tab = TablePool()
    for nn, nq in np.unique(meta[:, :2], axis=0).tolist():
        every = np.flatnonzero((meta[:, 0] == nn) & (meta[:, 1] == nq))
        for begin in range(0, every.size, CHUNK // 8):
            some = every[begin:begin + CHUNK // 8]
            meta[some, 2], meta[some, 7] = _group_tables(model, tables, plane, nn, nq, some, tab)
    meta[:, 6] = np.where(meta[:, 6] >= 0, meta[:, 6] // 4, -1)
    return ElementTables(meta, tab.array(), tables.nodes, tables.rows, tables.blocks)


def _group_tables(model: Model, tables: ElementTables, plane: Plane, nn: int, nq: int, some: Array,
                  tab: TablePool) -> tuple[Array, Array]:
    """Put the tables of some groups of equal size, int [S], into the pool; where they and their reference strains begin."""
    meta = tables.meta
    at = layout_of(SPACE, nn, nq)
    lanes = tables.tab[meta[some, 2, None] + np.arange(at.table_size)].reshape(len(some), -1, 8)
    nodes = tables.nodes[meta[some, 3, None] + np.arange(8 * nn)].reshape(-1, nn, 8)
    # [group, node, lane]: d2 = cos J u + sin n
    cos, sin = plane.factor[nodes, 1].imag, plane.normal[nodes, 1]

    def refuse(wrong: Array, why: str) -> None:
        """wrong: bool [group, lane]"""
        if np.any(wrong):
            raise NotPlanar(why.format(model.node_label(int(nodes[:, 0][wrong][0])).split(" node ")[0]))

    turned = np.abs(cos - cos[:, :1]) + np.abs(sin - sin[:, :1])
    refuse(np.any(turned > TOLERANCE, axis=1), "{} is twisted")
    c, s = cos[:, 0], sin[:, 0]
    zero, one = np.zeros_like(c), np.ones_like(c)
    within = np.array([[one, zero, zero], [zero, c, zero], [zero, -s, zero], [zero, zero, zero], [zero, zero, s],
                       [zero, zero, c]]).transpose(2, 3, 0, 1)
    beyond = np.array([[zero, zero, zero], [s, zero, zero], [c, zero, zero], [zero, one, zero], [zero, zero, c],
                       [zero, zero, -s]]).transpose(2, 3, 0, 1)
    C = lanes[:, :36].reshape(-1, 6, 6, 8).transpose(0, 3, 1, 2)
    inner, outer, cross = (np.einsum("glia,glij,gljb->glab", x, C, y)
                           for x, y in ((within, within), (beyond, beyond), (beyond, within)))
    scale = np.einsum("glaa,glbb->glab", outer, inner)
    refuse(np.any(cross**2 > TOLERANCE**2 * scale, axis=(2, 3)), "the section of {} couples strains in the plane with others")
    e0 = tables.tab[meta[some, 7, None] + np.arange(48 * nq)].reshape(-1, nq, 6, 8).transpose(0, 1, 3, 2)
    off = np.abs(np.einsum("glia,gpli->gpla", beyond, e0)) > TOLERANCE * max(1.0, float(np.max(np.abs(e0))))
    refuse(np.any(off, axis=(1, 3)), "{} is curved or twisted out of the plane")
    strains = np.einsum("glia,gpli->gpal", within, e0)
    points = lanes[:, at.point // 8:at.inertia // 8]
    rho, i2, i3 = (lanes[:, at.inertia // 8 + k] for k in range(3))
    refuse(np.abs((i2 - i3) * s * c) > TOLERANCE * (i2 + i3), "the section inertia of {} is oblique to the plane")
    inertia = np.stack((rho, i2 * c * c + i3 * s * s), axis=1)
    masses = lanes[:, at.masses // 8:]
    flat = np.concatenate((inner.reshape(-1, 8, 9).transpose(0, 2, 1), points, inertia, masses), axis=1).reshape(len(some), -1)
    assert flat.shape[1] == layout_of(PLANE, nn, nq).table_size
    return tab.share(flat), tab.append(strains.reshape(len(some), -1))


def _inner(inner: Inner | None, tables: list[ElementTables | None]) -> Inner | None:
    """Work arrays of eliminated nodes with 3 unknowns: blocks take a quarter of the doubles, and where right-hand sides stand
    among them offsets change in other proportions."""
    if inner is None:
        return None
    if isinstance(inner.rhs, NoColumns):
        size = 0
        for meta in (t.meta for t in tables if t is not None):
            room = np.zeros(len(meta), np.int64)
            for nn in np.unique(meta[:, 0]).tolist():
                room[(meta[:, 0] == nn) & (meta[:, 6] >= 0)] = store_size(nn, False, 3)
            meta[:, 6] = np.where(meta[:, 6] >= 0, size + np.cumsum(room) - room, -1)
            size += int(room.sum())
        return inner._replace(store=np.zeros(size))
    where = inner.where.copy()
    lane = where[:, 0] % 8
    where[:, 0] = (where[:, 0] - lane) // 4 + lane
    return inner._replace(store=np.zeros(inner.store.size // 4), where=where)


def _bodies(model: Model, plane: Plane) -> PlanarBodies | None:
    bodies = model.bodies
    if bodies is None:
        return None
    tensor = bodies.inertia.reshape(-1, 4, 4)
    factor, normal = plane.factor[bodies.node], plane.normal[bodies.node]
    own = tensor[:, 1:, 1:]
    about = np.einsum("ki,kij,kj->k", factor, own, factor.conj()).real
    tilt = np.abs(np.einsum("ki,kij,kj->k", normal, own, factor))
    size = np.trace(own, axis1=1, axis2=2)
    _refuse(tilt / np.where(size > 0.0, size, 1.0), TOLERANCE, "the principal axes of {} are oblique to the plane", model,
            bodies.node)
    return PlanarBodies(bodies.node, bodies.row, bodies.block, np.stack((tensor[:, 0, 0], about), axis=1).reshape(-1))


def _ties(model: Model, plane: Plane, state: State) -> PlanarTies | None:
    ties = model.ties
    if ties is None:
        return None
    slave = np.repeat(ties.slave, np.diff(ties.start)[ties.slave])
    offset = ties.offset.reshape(-1, 3)
    arm = np.einsum("ei,ei->e", offset, plane.factor[ties.target])
    up = np.einsum("ei,ei->e", offset, plane.normal[ties.target])
    _refuse(np.abs(up), TOLERANCE * model.length, "{} is connected at an offset out of the plane", model, slave)
    u = state.q.reshape(-1, 2, 2)[:, 1] @ np.array([1.0, 1j])
    turn = _snapped(u[slave] * np.conj(u[ties.target]))
    factor = np.where(ties.kind == 2, turn, arm)
    return PlanarTies(ties.slave, ties.row, ties.start, ties.target, ties.target_row, ties.diagonal, ties.kind, _numbers(factor),
                      ties.moves)


def _link(table: Any, ties: PlanarTies | None) -> Any:
    """Springs and joints have the same tables, but for the tied nodes at their ends."""
    if "ties" not in table._fields:
        return table
    return table._replace(ties=NoTies() if ties is None else ties)


def _held(held: Held | None) -> Held | None:
    """What is held in the plane: a position where all three of its components are held, a turn where all three spins are. A
    single held spin is that of a beam about its own axis in statics, which does not exist in the plane."""
    if held is None:
        return None

    def flat(mask: Array) -> Array:
        return np.where((mask & 7) == 7, 3, 0) | np.where((mask & 56) == 56, 4, 0)

    return Held(held.row, flat(held.mask), held.diagonal, held.block, flat(held.row_mask), flat(held.column_mask))
