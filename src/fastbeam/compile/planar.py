"""Scenes that stay in a plane: search for the plane in their arrays before tables are packed, and tables with 3 unknowns a node
(theory.md 10)."""
from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fastbeam.compile.unpack import Unpacked
from fastbeam.kernels.algebra.dimensions import PLANE
from fastbeam.kernels.beams.element_loop import ElementTables
from fastbeam.kernels.beams.inner_nodes import Inner, NoColumns, store_size
from fastbeam.kernels.beams.nodes import Held
from fastbeam.kernels.beams.planar_nodes import PlanarBodies, PlanarTies
from fastbeam.kernels.joints.conditions import JointConditions
from fastbeam.kernels.layout import CONSTANTS, FACTORS, NODES, POINTS, REFERENCE
from fastbeam.kernels.linalg.substructures import place_stores
from fastbeam.kernels.state import State
from fastbeam.kernels.terms import NoTies
from fastbeam.model.analyses import Analysis, told
from fastbeam.model.connections import TRIAD, fixed_axes, fixed_in_plane
from fastbeam.model.contact.sleeves import sleeves_in_plane
from fastbeam.model.forces.bushings import check_plane
from fastbeam.model.joints.coordinates import Coordinate
from fastbeam.model.joints.tables import conditions_in_plane, constraints_in_plane, left_in_plane
from fastbeam.model.plane import TOLERANCE, NotPlanar, Plane, check_state, numbers_of, strain_maps, to_plane
from fastbeam.model.tables import CHUNK, ElementPacker, Elements, TablePool, group_tables
from fastbeam.scene import Bushing

if TYPE_CHECKING:
    from fastbeam.model.model import Model

Array = np.ndarray
PUSH_OUT, TURN_OUT = "the load on {} points out of the plane", "the moment on {} is not about the normal of the plane"


class Found(NamedTuple):
    """Plane of a scene, and scalars that replace vectors and tensors in its tables."""

    plane: Plane      # without its model
    state: State      # at t = 0
    inertia: Array    # float64 [B, 2]: mass and moment of inertia about the normal, of every body
    ties: Array       # complex128 [M]: factor of every entry of `Connections.without_welds`


def find_plane(unpacked: Unpacked) -> tuple[Found | None, str]:
    """Find the plane in which a scene stays; or None and the reason."""
    try:
        plane = _plane_of(unpacked)
        elements = [*unpacked.elements, *unpacked.moving]
        kinds = [(part.strain, *part.shape) for part in elements]
        for kind in sorted(set(kinds), key=lambda x: (x[0] != "simo_reissner", *x[1:])):
            for part, own in zip(elements, kinds):
                if own == kind:
                    _check_elements(unpacked, part, plane)
        state = plane.reduce(unpacked.state)
        ties = _ties(unpacked, plane, state)
        return Found(plane, state, _bodies(unpacked, plane), ties), ""
    except NotPlanar as reason:
        return None, str(reason)


def _plane_of(unpacked: Unpacked) -> Plane:
    features = [x for x in (*unpacked.numbered.links.features, unpacked.dragged, unpacked.nonlinear) if x is not None]
    for lack, names in told(Analysis.PLANAR, features):
        raise NotPlanar(lack.text.format(name=names[0]))
    within, across = _vectors(unpacked)
    q = unpacked.state.q.reshape(-1, 4, 3)
    masks = unpacked.joints.held & 7
    partly = np.flatnonzero((masks != 0) & (masks != 7))
    some_axes = fixed_axes(masks[partly]).astype(float)
    normal = _normal([vectors.x for vectors in within], [vectors.x for vectors in across], q[0, 1:], some_axes)
    axes = _axes(normal)
    normal = axes[2]
    check_plane(unpacked.numbered.links.of(Bushing)[0], normal)
    for x, why, nodes in within:
        _refuse(np.abs(x @ normal), TOLERANCE * np.max(np.linalg.norm(x, axis=1)), why, unpacked, nodes)
    along = some_axes * normal
    _refuse(np.linalg.norm(along - (along @ normal)[:, None] * normal, axis=1), TOLERANCE,
            "the support of {} fixes axes that are oblique to the plane", unpacked, partly)
    for x, why, nodes in across:
        off = np.linalg.norm(x - (x @ normal)[:, None] * normal, axis=1)
        _refuse(off, TOLERANCE * np.max(np.linalg.norm(x, axis=1)), why, unpacked, nodes)
    for freedom, _, frame in unpacked.numbered.links.freedoms:
        if not freedom.joint.conditions:
            # the conditions of other joints are checked by constraints_in_plane
            left_in_plane(freedom.joint.label, Coordinate(freedom.shape, frame), normal)
    flat = to_plane(q[:, 1:], axes)
    # u is the director that lies best in the plane, the first of equals: d1 of a beam
    k = np.argmax(np.round(np.abs(flat), 9), axis=1)
    u = flat[np.arange(len(q)), k]
    factor = flat * (np.conj(u) / np.abs(u))[:, None]
    vectors = unpacked.state.s.size + sum(link.law.is_vector for link in unpacked.kept)
    singles = constraints_in_plane(unpacked.kept, normal)[1]
    single = sum(link.forces(3) for link in unpacked.kept if not link.law.is_vector)
    plane = Plane(axes, float(q[0, 0] @ normal), _snapped(factor), _snapped(q[:, 1:] @ normal), vectors, singles, single)
    check_state(unpacked.state.q, unpacked.state.v, plane, unpacked.numbered.length)
    _refuse((unpacked.nodes.rank == 3) * np.where(k == 0, np.abs(plane.normal[:, 0]), 1.0), TOLERANCE,
            "the section of {} is not perpendicular to the plane", unpacked)
    return plane


class _Vectors(NamedTuple):
    """Vectors of nodes that lie in the plane of a scene, or along its normal."""

    x: Array                      # float64 [n, 3]
    why: str                      # what is said of a node, {}, where a vector has another
    nodes: Array | None = None    # int64 [n]; default: all of the scene


def _vectors(unpacked: Unpacked) -> tuple[list[_Vectors], list[_Vectors]]:
    """Collect vectors that lie in the plane of a scene, and those along its normal: places, velocities, loads, what moves."""
    q, v = unpacked.state.q.reshape(-1, 4, 3), unpacked.state.v.reshape(-1, 4, 3)
    length = unpacked.numbered.length
    loads = unpacked.loads.each(unpacked.joints.row_root)
    within = [_Vectors(q[:, 0] - q[0, 0], "{} does not lie in the plane of the other nodes"),
              _Vectors(v[:, 0], "the initial velocity of {} points out of the plane"),
              _Vectors(unpacked.gravity[None], "gravity points out of the plane"),
              *(_Vectors(x[:, :3], PUSH_OUT, nodes) for x, nodes in loads)]
    # round-off of spins and moments has no axis
    speed = float(np.max(np.abs(v[:, 0]), initial=0.0))
    push = max((float(np.max(np.abs(x[:, :3]))) for x, _ in loads), default=0.0)
    spins = _without_noise(np.cross(q[:, 1:], v[:, 1:]).sum(axis=1), speed / length)
    across = [_Vectors(spins, "the initial spin of {} is not about the normal of the plane"),
              *(_Vectors(_without_noise(x[:, 3:], push * length), TURN_OUT, nodes) for x, nodes in loads)]
    if unpacked.dragged is not None:
        # several drags may act on one node, each with air of its own
        within.append(_Vectors(unpacked.dragged.air, "the air at {} moves out of the plane", unpacked.dragged.node))
    if unpacked.prescribed is not None:
        for translation, axes in unpacked.prescribed.directions(len(q)):
            within.append(_Vectors(translation, "the motion of {} leads out of the plane"))
            across.append(_Vectors(axes, "the rotation of {} is not about the normal of the plane"))
    pushed, twisted = _following(unpacked.numbered.links.loaded, q, length)
    within += [_Vectors(x, PUSH_OUT) for x in pushed]
    across += [_Vectors(x, TURN_OUT) for x in twisted]
    for on, pushes, turns in _driven(unpacked.numbered.links, len(q)):
        within.append(_Vectors(pushes, f"{on} exerts a force on {{}} out of the plane"))
        across.append(_Vectors(turns, f"{on} exerts a moment on {{}} about an axis that is not the normal of the plane"))
    return within, across


def _following(loaded: Any, q: Array, length: float) -> tuple[list[Array], list[Array]]:
    """Return the forces and moments [n, 3] on all nodes by every follower load at t = 0; q [n, 4, 3]; length: of the scene."""
    forces, moments = [], []
    for k, force in enumerate(loaded.forces):
        on = loaded.node[loaded.of == k]
        for out, parts in ((forces, force.parameters[:3]), (moments, force.parameters[3:])):
            x = np.zeros((len(q), 3))
            x[on] = np.einsum("i,nic->nc", parts, q[on, 1:])
            size = float(np.max(np.abs(force.parameters) * np.repeat((length, 1.0), 3)))
            out.append(x if out is forces else _without_noise(x, size))
    return forces, moments


def _driven(links: Any, n: int) -> Iterator[tuple[str, Array, Array]]:
    """Yield for every joint with a motor or a prescribed motion, or with a spring under load at t = 0, its label, and for all n
    nodes the directions [n, 3] in which it pushes and about which it turns."""
    for freedom, nodes, frame in links.freedoms:
        moved = freedom.motor is not None or freedom.drive is not None or freedom.is_given
        if not moved and freedom.stiffness * freedom.rest == 0.0:
            continue
        pushes, turns = np.zeros((n, 3)), np.zeros((n, 3))
        (turns if freedom.shape.is_angle else pushes)[nodes[1]] = frame.axes[freedom.shape.side, freedom.shape.axis]
        yield freedom.joint.label, pushes, turns


def _refuse(off: Array, limit: float | Array, why: str, unpacked: Unpacked, nodes: Array | None = None) -> None:
    """Raise NotPlanar where `off` [n] of a node (of `nodes` [n]; default: all of the scene) exceeds its limit, and name the
    node."""
    if np.any(off > limit):
        k = int(np.argmax(off))
        raise NotPlanar(why.format(unpacked.nodes.labels[k if nodes is None else int(nodes[k])]))


def _without_noise(x: Array, size: float) -> Array:
    """Return vectors [n, 3], zero where they are round-off next to `size`."""
    return np.where(np.linalg.norm(x, axis=1, keepdims=True) > TOLERANCE * size, x, 0.0)


def _snapped(x: Array) -> Array:
    """Round numbers to 0, 1 and -1 where they differ by round-off only."""
    if np.iscomplexobj(x):
        return _snapped(x.real) + 1j * _snapped(x.imag)
    near = np.round(x)
    return np.where(np.abs(x - near) < 1e-14, near, x)


def _normal(within: list[Array], across: list[Array], triad: Array, some_axes: Array) -> Array:
    """Find the normal of the plane that holds the vectors `within`, with the direction of the vectors `across`; some_axes: axes
    that supports hold, 1 or 0, [*, 3]: if any plane is possible, choose that in which most of them lie."""
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
            # a director of the first node with this direction up to round-off is more exact than the singular vector
            noise = 64.0 * np.finfo(float).eps * size[0] / size[1]
            return min((d for d in triad if np.linalg.norm(np.cross(d, directions[2])) < noise),
                       key=lambda d: -abs(d @ directions[2]), default=directions[2])
    if not size[0] > 0.0:
        raise NotPlanar("a single point without velocity or load defines no plane")
    # everything on one line: any plane through it that the first triad allows
    for d in sorted(triad[::-1], key=lambda d: round(float(np.sum((some_axes * d)**2)), 9)):
        if abs(d @ directions[0]) < TOLERANCE:
            return d
    raise NotPlanar("everything lies on one line, and the directors are oblique to it")


def _axes(normal: Array) -> Array:
    """Return two axes and the normal; coordinate axes where the normal is one."""
    k = int(np.argmax(np.abs(normal)))
    if np.max(np.abs(np.delete(normal, k))) < 0.1 * TOLERANCE:
        return np.eye(3)[[(k + 1) % 3, (k + 2) % 3, k]]
    first = np.eye(3)[np.argmin(np.abs(normal))]
    first = first - (first @ normal) * normal
    first /= np.linalg.norm(first)
    return np.stack((first, np.cross(normal, first), normal))


def _angles(elements: Elements, some: Array, plane: Plane) -> tuple[Array, Array]:
    """Return cos and sin of d2 = cos J u + sin n at the nodes of elements, int [...]; [..., nn] each."""
    nodes = elements.nodes[some]
    return plane.factor[nodes, 1].imag, plane.normal[nodes, 1]


def _round_off(elements: Elements, some: Array, length: float) -> float:
    """Bound the round-off of strains and of curvatures times a length, of some elements, int [...]: fine meshes multiply that of
    positions and triads by their derivatives."""
    steep = max(float(np.max(np.sum(np.abs(x[some]), axis=-1))) for x in (elements.phi_s, elements.dir_s))
    return 16.0 * np.finfo(float).eps * steep * max(length, float(np.max(np.abs(elements.phi[elements.nodes[some]]))))


def _check_elements(unpacked: Unpacked, elements: Elements, plane: Plane) -> None:
    for begin in range(0, len(elements.nodes), CHUNK):
        some = np.arange(begin, min(begin + CHUNK, len(elements.nodes)))
        cos, sin = _angles(elements, some, plane)

        def refuse(wrong: Array, why: str, of: Any = slice(None), node: Array = elements.nodes[some, 0]) -> None:
            """Raise NotPlanar for wrong elements, bool [element], of all or of some."""
            if np.any(wrong):
                raise NotPlanar(why.format(unpacked.nodes.labels[int(node[of][wrong][0])].split(" node ")[0]))

        turned = np.abs(cos - cos[:, :1]) + np.abs(sin - sin[:, :1])
        refuse(np.any(turned > TOLERANCE, axis=1), "{} is twisted")
        c, s = cos[:, 0], sin[:, 0]
        # elements that differ from the one before
        kinds = np.stack((elements.section[some], c, s))
        first = np.flatnonzero(np.concatenate(([True], np.any(kinds[:, 1:] != kinds[:, :-1], axis=0))))
        within, beyond = strain_maps(c[first], s[first])
        for C in (elements.stiffness, elements.viscosity):
            inner, outer, cross = (np.einsum("eia,eij,ejb->eab", x, C[elements.section[some[first]]], y)
                                   for x, y in ((within, within), (beyond, beyond), (beyond, within)))
            scale = np.einsum("eaa,ebb->eab", outer, inner)
            refuse(np.any(cross**2 > TOLERANCE**2 * scale, axis=(1, 2)),
                   "the section of {} couples in-plane strains with out-of-plane strains", first)
        # curvatures times the size of the scene are strains
        e0 = elements.reference_strains[some] * np.repeat((1.0, unpacked.numbered.length), 3)
        beyond = np.repeat(beyond, np.diff(np.append(first, some.size)), axis=0)
        off = np.abs(np.einsum("eia,epi->epa", beyond, e0))
        limit = TOLERANCE * max(1.0, float(np.max(np.abs(e0)))) + _round_off(elements, some, unpacked.numbered.length)
        refuse(np.any(off > limit, axis=(1, 2)), "{} is curved or twisted out of the plane")
        _, i2, i3 = elements.inertia[elements.section[some]].T
        refuse(np.abs((i2 - i3) * s * c) > TOLERANCE * (i2 + i3), "the section inertia of {} is oblique to the plane")


def _bodies(unpacked: Unpacked, plane: Plane) -> Array:
    """Return mass and moment of inertia about the normal of all bodies, [B, 2]."""
    tensor = unpacked.inertia
    factor, normal = plane.factor[unpacked.bodies], plane.normal[unpacked.bodies]
    own = tensor[:, 1:, 1:]
    about = np.einsum("ki,kij,kj->k", factor, own, factor.conj()).real
    tilt = np.abs(np.einsum("ki,kij,kj->k", normal, own, factor))
    size = np.trace(own, axis1=1, axis2=2)
    _refuse(tilt / np.where(size > 0.0, size, 1.0), TOLERANCE, "the principal axes of {} are oblique to the plane", unpacked,
            unpacked.bodies)
    return np.stack((tensor[:, 0, 0], about), axis=1)


def _ties(unpacked: Unpacked, plane: Plane, state: State) -> Array:
    """Return the factors of the entries of all slave nodes except those that share a row, [M]."""
    ties = unpacked.joints.without_welds()
    slave = ties.owner
    arm = np.einsum("ei,ei->e", ties.offset, plane.factor[ties.target])
    up = np.einsum("ei,ei->e", ties.offset, plane.normal[ties.target])
    _refuse(np.abs(up), TOLERANCE * unpacked.numbered.length, "{} is connected with an offset out of the plane", unpacked, slave)
    u = state.q.reshape(-1, 2, 2)[:, 1] @ np.array([1.0, 1j])
    turn = _snapped(u[slave] * np.conj(u[ties.target]))
    return np.where(ties.kind == TRIAD, turn, arm)


# --- tables -----------------------------------------------------------------------------------------------------------
def pack_plane(model: Model, found: Found, packers: dict[str, ElementPacker]) -> Plane:
    """Return the plane with its model: the tables of the scene with 3 unknowns a node. model: the tables in space, whose lists of
    nodes, rows and blocks serve both; packers: the elements of its tables, by strain set."""
    plane, axes = found.plane, found.plane.axes
    # moving meshes have changed the velocities at the start
    velocities = plane.reduce(State(model.q0, model.v0, model.s0, np.zeros(model.n_forces), np.zeros(0))).v
    loads = model.loads._replace(first=_load(model.loads.first, axes), value=_load(model.loads.value, axes))
    strains = TablePool()
    simo, green = (None if tables is None else _elements(tables, packers[strain], plane, strains)
                   for tables, strain in ((model.simo, "simo_reissner"), (model.green, "green_lagrange")))
    ties, bodies = model.ties, model.bodies
    if ties is not None:
        ties = PlanarTies(ties.slave, ties.row, ties.start, ties.target, ties.target_row, ties.diagonal, ties.kind,
                          numbers_of(found.ties), ties.moves)
    if bodies is not None:
        bodies = PlanarBodies(bodies.node, bodies.row, bodies.block, found.inertia.reshape(-1))
    kept = constraints_in_plane(model.kept, axes[2])[0]
    left = {(link.name, link.node) for link in kept}
    softness = model.kept_softness[[(link.name, link.node) in left for link in model.kept]]
    links = [_link(table, model, plane, ties) for table in model.links]
    flat = replace(
        model.with_loading(loads=loads), kept=kept, kept_softness=softness,
        features=tuple(feature.in_plane(plane, model, model.n_sliders + len(kept)) for feature in model.features),
        simo=simo, green=green, reference_strains=strains.array(),
        substructures=None if model.substructures is None else place_stores(model.substructures, 3),
        bodies=bodies, links=tuple(table for table in links if table is not None), ties=ties,
        held=_held(model.held, axes),
        static_held=_held(model.static_held, axes), q0=found.state.q, v0=velocities, dofs=PLANE)
    flat = replace(flat, inner=_inner(model.inner, [simo, green], flat.n_bordered > 0))
    return replace(plane, moments=sleeves_in_plane(model, plane)[1], model=flat)


def _load(of_rows: Array, axes: Array) -> Array:
    """Return forces and moments of rows, [8 M], in the plane."""
    rows, out = of_rows.reshape(-1, 8), np.zeros_like(of_rows)
    for c, part in enumerate((rows[:, :3], rows[:, :3], rows[:, 3:6])):
        out[c::8] = part @ axes[c]
    return out


def _elements(tables: ElementTables, packer: ElementPacker, plane: Plane, strains: TablePool) -> ElementTables:
    """Return the groups of `tables` with constants of the plane; strains: takes their reference strains."""
    meta = tables.meta.copy()
    pool = TablePool()
    parts = [packer.parts[k] for k in packer.order]
    begins = np.cumsum([0, *(lane.size // 8 for _, lane in parts)])
    for nn, nq in np.unique(meta[:, [NODES, POINTS]], axis=0).tolist():
        every = np.flatnonzero((meta[:, NODES] == nn) & (meta[:, POINTS] == nq))
        for begin in range(0, every.size, CHUNK // 8):
            some = every[begin:begin + CHUNK // 8]
            part_of = np.searchsorted(begins, some, side="right") - 1
            constants, viscosity, own = (np.concatenate(x) for x in zip(*(
                _group_tables(parts[k][0], parts[k][1].reshape(-1, 8)[some[part_of == k] - begins[k]].reshape(-1), plane)
                for k in np.unique(part_of))))
            meta[some, CONSTANTS] = pool.constants(constants, [viscosity] if packer.is_damped else [])
            meta[some, REFERENCE] = strains.append(own)
    meta[:, FACTORS] = np.where(meta[:, FACTORS] >= 0, meta[:, FACTORS] // 4, -1)
    return ElementTables(meta, pool.array(), tables.nodes, tables.rows, tables.blocks)


def _group_tables(elements: Elements, lane: Array, plane: Plane) -> tuple[Array, Array, Array]:
    """Return constants, viscosities and reference strains of groups of 8 elements, int [8 G]: [G, doubles] each."""
    groups = lane.size // 8
    cos, sin = _angles(elements, lane, plane)
    c, s = cos[:, 0].reshape(groups, 8), sin[:, 0].reshape(groups, 8)
    within, _ = strain_maps(c, s)
    section = elements.section[lane].reshape(groups, 8)
    inner, viscous = (np.einsum("glia,glij,gljb->glab", within, x[section], within).reshape(groups, 8, 9).transpose(0, 2, 1)
                      for x in (elements.stiffness, elements.viscosity))
    e0 = elements.reference_strains[lane]
    e0 = e0.reshape(groups, 8, *e0.shape[1:]).transpose(0, 2, 1, 3)
    strains = np.einsum("glia,gpli->gpal", within, e0)
    rho, i2, i3 = np.moveaxis(elements.inertia[section], 2, 0)
    inertia = np.stack((rho, i2 * c * c + i3 * s * s), axis=1)
    return group_tables(elements, lane, PLANE, inner, inertia), viscous.reshape(groups, -1), strains.reshape(groups, -1)


def _inner(inner: Inner | None, tables: list[ElementTables | None], columns: bool) -> Inner | None:
    """Return the work arrays of eliminated nodes with 3 unknowns: blocks take a quarter of the doubles; offsets change in other
    proportions where right-hand sides stand among them. columns: True if constraints are left in the plane, whose columns
    follow."""
    if inner is None:
        return None
    if not columns:
        size = 0
        for meta in (t.meta for t in tables if t is not None):
            doubles = np.zeros(len(meta), np.int64)
            for nn in np.unique(meta[:, NODES]).tolist():
                doubles[(meta[:, NODES] == nn) & (meta[:, FACTORS] >= 0)] = store_size(nn, False, 3)
            meta[:, FACTORS] = np.where(meta[:, FACTORS] >= 0, size + np.cumsum(doubles) - doubles, -1)
            size += int(doubles.sum())
        return inner._replace(store=np.zeros(size), rhs=NoColumns())
    where = inner.where.copy()
    lane = where[:, 0] % 8
    where[:, 0] = (where[:, 0] - lane) // 4 + lane
    return inner._replace(store=np.zeros(inner.store.size // 4), where=where)


def _link(table: Any, model: Model, plane: Plane, ties: PlanarTies | None) -> Any:
    """Return the table of springs or joints in the plane: that of space, with other slave nodes at their ends and other axes of
    joints. None where nothing is left of it in the plane."""
    if isinstance(table, JointConditions):
        table = conditions_in_plane(table, model.kept, plane)
    for feature in model.features:
        table = feature.link_in_plane(table, plane)
    if table is None or "ties" not in table._fields:
        return table
    return table._replace(ties=NoTies() if ties is None else ties)


def _held(held: Held | None, axes: Array) -> Held | None:
    """Return the fixed unknowns in the plane. A single fixed spin is that of a beam about its own axis in statics, and does not
    exist in the plane."""
    if held is None:
        return None
    mask, row_mask, column_mask = (fixed_in_plane(x, axes) for x in (held.mask, held.row_mask, held.column_mask))
    return Held(held.row, mask, held.diagonal, held.block, row_mask, column_mask)
