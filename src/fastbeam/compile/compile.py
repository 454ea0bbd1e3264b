"""Scene compiler: turns scene parts into constant tables and a plan of the work that is present, in six stages.

    number    -> Numbered    numbers of nodes, joints (numbered.py)
    unpack    -> Unpacked    elements, bodies, loads, initial state as arrays (unpack.py)
    find      -> Found       the plane of the scene, if it has one (compile/planar.py)
    condense  -> Condensed   elements in groups of eight; beams condensed to their ends (condense.py)
    order     -> Ordered     which nodes the solver sees, in what order; numbers of blocks (order.py)
    pack      -> Model       tables (here; in the plane: compile/planar.py)

What a scene lacks has no table, no rows and no unknowns, and no code is compiled for it.
"""
from __future__ import annotations

from copy import copy
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from fastbeam.compile.condense import Condensed
from fastbeam.compile.condense import condense as choose
from fastbeam.compile.links import Links
from fastbeam.compile.moving_meshes import meshes_of, moving_tables, with_tables
from fastbeam.compile.numbered import number
from fastbeam.compile.order import Blocks, Ordered, order
from fastbeam.compile.planar import find_plane, pack_plane
from fastbeam.compile.redundancy import softness_of
from fastbeam.compile.remeshing import remeshed
from fastbeam.compile.report import describe
from fastbeam.compile.tracks import corners_of, contact_curve_of
from fastbeam.compile.unpack import Loads, Unpacked, unpack
from fastbeam.interface.arguments import Anything, Flag, Word, checked, shown
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.beams.nodes import Bodies, Held
from fastbeam.kernels.beams.nodes_without_mass import Knots
from fastbeam.kernels.beams.ties import TARGET, Ties
from fastbeam.kernels.contact.slider import Sliders, no_following
from fastbeam.kernels.forces.drag import Wind
from fastbeam.kernels.layout import POSITION
from fastbeam.kernels.terms import LoadVectors, NoTies
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.connections import Connections
from fastbeam.model.contact.sleeves import SleeveContact, sleeves_of, twist_friction_of, with_twist
from fastbeam.model.contact.slider_forces import slider_forces_of
from fastbeam.model.contact.sliders import SlidingContact
from fastbeam.model.controllers import Controllers
from fastbeam.model.forces.added_mass import Added
from fastbeam.model.forces.damping_and_drag import Dragged, damped_of
from fastbeam.model.forces.failed_laws import Lawful
from fastbeam.model.forces.link_forces import CarriedSliders, Crossings, LinkForces
from fastbeam.model.forces.loads import LoadAccount
from fastbeam.model.forces.user_forces import asked_of
from fastbeam.model.holding import Holding, trees
from fastbeam.model.joints.motion import motions_of
from fastbeam.model.loading import Loading, Remarks
from fastbeam.model.model import Model
from fastbeam.model.moving_supports import released_of
from fastbeam.model.numbering import NodeList
from fastbeam.model.supports import waiting
from fastbeam.model.tables import Elements, TablePool, pack_curves, pack_inner, pack_paths, pack_substructures
from fastbeam.scene import Beam, Bushing, ForceElement, Path, Scene, Sleeve, Switch
from fastbeam.scene.crossings import Knot
from fastbeam.scene.winch import Coil, RopePoint

Array = np.ndarray
SOLVERS = ("auto", "chain", "sparse")
CHOICE = Flag(("auto",))
# mass of a point without mass in the tangent, as a share of that of an element beside it (nodes_without_mass.py)
KNOT_SHARE = 1e-6


@checked(scene=Anything(), solver=Word(SOLVERS), eliminate_inner=Flag(), planar=CHOICE, condense=CHOICE, moving=CHOICE)
def compile_scene(scene: Scene, *, solver: str = "auto", eliminate_inner: bool = True, planar: bool | str = "auto",
                  condense: bool | str = "auto", moving: bool | str = False) -> Model:
    """Compile a scene to constant tables.

    Parameters
    ----------
    scene : Scene
    solver : {'auto', 'chain', 'sparse'}
        Block elimination in compiled code, or PARDISO (SuperLU without MKL); 'auto' takes the elimination where its fill is
        small.
    eliminate_inner : bool
        Eliminate the inner nodes of elements in the element loop, so that the solver sees the end nodes only. The results are
        the same; False is for comparison.
    planar : {'auto', True, False}
        Run a scene that lies and moves in a plane with 3 unknowns a node instead of 6: same results to round-off, several times
        faster. True refuses a scene that does not stay in a plane and says why. False runs every scene in space, like the methods
        that conserving steps are compared with. Instabilities out of the plane need a disturbance out of it (theory.md 10).
    condense : {'auto', True, False}
        Condense the beams of nets, and pieces of long beams with Lagrange elements, to their ends, eight equal ones at a time and
        on several threads, so that the solver sees these ends only (theory.md 9). Same results to round-off; 'auto' does it in
        large scenes, where it pays.
    moving : {False, True, 'auto'}
        Let the elements of beams with sliders move with the contacts, which then have no error of the mesh (theory.md 5.12), as
        `with_moving_meshes`, but for the beams of the scene themselves: results have rows for the material points at their nodes.
        True refuses a scene whose elements cannot move and says why; 'auto' compiles it as it is.

    Raises
    ------
    SceneError
        No scene, everything that `Scene.check` refuses, joints that cannot be eliminated, inconsistent initial velocities; with
        planar=True a scene that does not stay in a plane.
    """
    if isinstance(scene, Model):
        raise SceneError(f"compile_scene: scene {scene.scene_name!r} is compiled already; pass the model on to simulate "
                         "or solve_static")
    if not isinstance(scene, Scene):
        raise SceneError(f"compile_scene: needs a Scene, got {shown(scene)}; put the parts into one: "
                         "model = fb.compile_scene(fb.Scene(beam, ...))")
    as_given, (scene, own) = scene, _with_moving(scene, moving)
    scene, meshes = meshes_of(scene)
    scene.check()
    numbered = number(scene, [mesh.beam for mesh in meshes])
    numbered.nodes.know(own)
    unpacked = unpack(scene, numbered, pack_at_rest, meshes)
    found, not_planar = find_plane(unpacked) if planar else (None, "planar=False")
    if planar is True and found is None:
        raise _out_of_plane(scene, not_planar)
    condensed = choose(scene, unpacked, False if meshes else condense)
    kept = len(unpacked.kept)
    constraints = len(scene.sliders) + kept + len(scene.sleeves)
    if condensed.carriers is not None:
        constraints -= sum(1 + isinstance(scene.sliders[k], Sleeve) for k in condensed.carriers.slider.tolist())
    ordered = order(numbered, condensed, solver, eliminate_inner, constraints, kept)
    model = with_tables(pack(scene, unpacked, condensed, ordered), scene, meshes, moving_tables(condensed, ordered), own)
    plane = None if found is None else pack_plane(model, found, condensed.packers)
    # copies of the scene, because the user may add parts to it before other models of it are compiled
    as_compiled, numbered_as = copy(as_given), copy(scene)
    as_compiled.parts, numbered_as.parts = list(as_given.parts), list(scene.parts)
    model = replace(
        model, plane=plane,
        find_holding=partial(_holding, numbered_as, numbered.nodes, numbered.joints),
        uneliminated=Variant(as_compiled, solver="sparse", eliminate_inner=False, condense=False, moving=moving),
        uncondensed=Variant(as_compiled, solver=solver, eliminate_inner=eliminate_inner, planar=False, condense=False,
                            moving=moving))
    model = model.with_remarks(not_planar=not_planar, asked_for_plane=planar is True)
    return model.with_remarks(text=describe(scene, model))


def _with_moving(scene: Scene, moving: bool | str) -> tuple[Scene, dict[Beam, Beam]]:
    """Return the scene with moving meshes, if asked for and, with 'auto', if it can have any, and its beams by those in their
    place."""
    if not moving or moving == "auto" and not scene.sliders:
        return scene, {}
    try:
        out, own = remeshed("compile_scene: moving=True", scene)
        for there, given in own.items():
            if there.n_nodes != given.n_nodes:
                raise SceneError(f"compile_scene: moving=True: {given.label} has {given.n_elements} elements, but its sliders "
                                 f"need {there.n_elements} on moving meshes, one on either side; give it more")
        meshes_of(out)
    except SceneError:
        if moving is True:
            raise
        return scene, {}
    return out, own


def _out_of_plane(scene: Scene, reason: str) -> SceneError:
    return SceneError(f"compile_scene: {scene.label} does not stay in a plane: {reason}; use planar='auto'")


class Variant:
    """Model of a scene with other options, compiled on first use; options: options of `compile_scene`."""

    def __init__(self, scene: Scene, **options: Any) -> None:
        self.scene, self._options = scene, options
        self._made: dict[tuple[tuple[str, Any], ...], Model] = {}

    def __call__(self, **more: Any) -> Model:
        """Return the model; more: options that are left open, or others."""
        key = tuple(sorted(more.items()))
        if key not in self._made:
            self._made[key] = compile_scene(self.scene, **{**self._options, **more})
        return self._made[key]

    def know(self, model: Model, **more: Any) -> None:
        """Register a model that was compiled with these options."""
        self._made[tuple(sorted(more.items()))] = model


def pack_at_rest(scene: Scene, unpacked: Unpacked) -> Model:
    """Build all tables in space, without condensed beams."""
    condensed, kept = choose(scene, unpacked, False), len(unpacked.kept)
    constraints = len(scene.sliders) + kept + len(scene.sleeves)
    return pack(scene, unpacked, condensed, order(unpacked.numbered, condensed, "auto", False, constraints, kept))


def pack(scene: Scene, unpacked: Unpacked, condensed: Condensed, ordered: Ordered) -> Model:
    """Build all tables in space."""
    nodes, joints, links = unpacked.nodes, unpacked.joints, unpacked.numbered.links
    packers, used, ends, blocks = condensed.packers, condensed.used, condensed.ends, ordered.blocks
    n, pattern = len(nodes), blocks.pattern
    row_of = pattern.row_of
    tables, strains = {}, TablePool()
    at = 0
    for name, packer in packers.items():
        m = packer.n_blocks
        tables[name] = packer.tables(row_of, blocks.element[at:at + m], strains) if packer.meta else None
        at += m
    at += sum(packer.n_blocks for packer in condensed.moving)
    inner = pack_inner(used, row_of, pattern.n, ordered.n_panel, ordered.store, ordered.columns)
    between_ends = blocks.element[at:at + 4 * len(ends)].reshape(-1, 4)
    substructures = pack_substructures(list(packers.values()), row_of[ends], between_ends, blocks.n_blocks, pattern.n,
                                       ordered.n_panel)
    ties = _ties(joints.without_welds(), blocks)
    held = _held(joints.held, blocks)
    loads = _loads(unpacked.loads, joints.row_root, row_of)
    idle = _idle_spins(scene, nodes, joints, unpacked.loads, links)
    state, length = unpacked.state, unpacked.numbered.length
    model = Model(
        scene_name=scene.name, n_nodes=n, simo=tables["simo_reissner"], green=tables["green_lagrange"],
        reference_strains=strains.array(), inner=inner, substructures=substructures, carriers=condensed.carriers,
        bodies=_bodies(unpacked, blocks), links=(),
        kept=unpacked.kept, kept_softness=softness_of(unpacked.kept, joints, nodes.rank), ties=ties,
        held=held, static_held=_held(joints.held | idle, blocks) if idle.any() else held,
        pattern=pattern, spinless=((joints.held[joints.row_root] & 56) == 56).astype(np.int8),
        spin_root=joints.spin_root, loading=Loading(
            loads, unpacked.loads.times, unpacked.loads.names, {load.name: load for load in [*scene.loads, *scene.distributed]},
            unpacked.gravity, scene.gravity_time, unpacked.loads.weight, unpacked.loads.constant),
        q0=state.q, v0=state.v, s0=state.s,
        length=length,
        softest=min((part.softest(length) for part in unpacked.elements), default=np.inf), n_blocks=blocks.n_blocks,
        names=_names(scene, nodes), numbers=nodes, remarks=Remarks(
            notes=unpacked.notes, joints=_joint_names(scene, nodes),
            massless=tuple(beam.label for beam in scene.beams if _is_massless(scene, beam))))
    return _with_features(model, scene, unpacked, blocks)


def _with_features(model: Model, scene: Scene, unpacked: Unpacked, blocks: Blocks) -> Model:
    """Return the model with its features, and the tables that need the offsets of their history variables."""
    nodes, joints, links, row_of = unpacked.nodes, unpacked.joints, unpacked.numbered.links, blocks.pattern.row_of
    released = released_of(scene, nodes, joints, row_of, unpacked.numbered.always)
    dragged, added = unpacked.dragged, unpacked.added
    model = model.with_features(
        _sliding(scene, nodes, joints, len(unpacked.kept)), slider_forces_of(scene.sliders),
        SleeveContact(scene.sleeves) if scene.sleeves else None, twist_friction_of(scene),
        LoadAccount() if _accounts_loads(unpacked) else None, damped_of(scene, nodes), unpacked.nonlinear, *links.features,
        unpacked.prescribed, released,
        Crossings() if scene.knots else None, Controllers(tuple(scene.controllers)) if scene.controllers else None,
        CarriedSliders() if model.carriers is not None else None)
    if scene.gravity_time is not None:
        require(Analysis.GRAVITY_IN_TIME, model)
    ties = NoTies() if model.ties is None else model.ties
    model = replace(model, links=links.tables(blocks, row_of, len(scene.sliders), ties, model.place_for(LoadAccount),
                                              model.losses_for(LinkForces)))
    if dragged is not None:
        blown = dragged.with_table(row_of, blocks.diagonal(dragged.node), model.losses_for(Dragged))
        laws = Lawful(scene.drags, blown.part, lambda k: nodes.labels[blown.node[k]], asked_of)
        model = model.with_features(replace(blown, called_laws={Wind: laws} if blown.windy else {}))
    if released is not None and released.losses:
        model = replace(model, **waiting(model))
    if scene.knots:
        model = replace(model, links=(*model.links, _knots(scene, nodes, blocks, unpacked.elements)))
    model = model.with_features(motions_of(links, blocks, row_of, joints.spin_root.astype(np.int64), model))
    if scene.sleeves:
        model = replace(model, features=tuple(replace(x, sleeves=with_twist(scene, model)) if isinstance(x, SlidingContact) else x
                                              for x in model.features))
    if added is not None:
        model = model.with_features(added.with_table(row_of, blocks.diagonal(added.node), model.place_for(Added)))
        if model.has_blows:
            require(Analysis.BLOWS, model)
    return model


def _accounts_loads(unpacked: Unpacked) -> bool:
    """Return whether loads have no potential."""
    loads = unpacked.loads
    return any(t is not None for t in loads.times) or bool(np.any(loads.first[:, 3:]) or np.any(loads.value[:, 3:])
                                                           or unpacked.numbered.links.loaded.forces)


def _is_massless(scene: Scene, beam: Beam) -> bool:
    """Return whether neither inertia nor a clamp or rigid connection resists a spin of the beam about its own axis."""
    holds = [clamp.at for clamp in scene.clamps] + [node for joint in scene.rigid for node in (joint.a, joint.b)]
    return not any(beam.section.inertia[1:]) and all(node.owner is not beam for node in holds)


def _bodies(unpacked: Unpacked, blocks: Blocks) -> Bodies | None:
    node = unpacked.bodies
    if not node.size:
        return None
    return Bodies(node, blocks.pattern.row_of[node], blocks.diagonal(node), unpacked.inertia.reshape(-1))


def _knots(scene: Scene, nodes: NodeList, blocks: Blocks, elements: list[Elements]) -> Knots:
    """Build the table of points without mass; in the tangent they have a share of the mass of the heaviest element that they
    slide on."""
    node = np.array([nodes.start(knot) for knot in scene.knots], np.int64)
    heaviest = np.zeros(node.size)
    for slider in scene.sliders:
        if isinstance(slider.point.owner, Knot):
            k = scene.knots.index(slider.point.owner)
            masses = [beam.section.inertia[0] * beam.length / beam.n_elements for beam in slider.beams]
            heaviest[k] = max(heaviest[k], *masses)
    total = sum(float(np.sum(x.inertia[x.section, :1] * x.mass_phi.sum(axis=2))) for x in elements)
    heaviest[heaviest == 0.0] = total if total > 0.0 else 1.0
    return Knots(node, blocks.pattern.row_of[node], blocks.diagonal(node), KNOT_SHARE * heaviest)


def _loads(loads: Loads, row_root: Array, row_of: Array) -> LoadVectors:
    """Return the load vectors in row layout."""
    own = np.flatnonzero(row_root == np.arange(row_of.size))
    first = np.zeros((row_of.size + 1, 8))
    first[row_of[own], :6] = loads.first[own]
    order = np.lexsort((row_of[loads.node], loads.vector))
    value = np.zeros((order.size, 8))
    value[:, :6] = loads.value[order]
    return LoadVectors(first.reshape(-1) if loads.times else np.zeros(0), loads.vector[order],
                       row_of[loads.node[order]].astype(np.int64), value.reshape(-1))


def _ties(joints: Connections, blocks: Blocks) -> Ties | None:
    """Build the table of slave nodes; joints: without those of shared rows."""
    if not joints.kind.size:
        return None
    pattern = blocks.pattern
    slaves = np.flatnonzero(joints.tied)
    pair, row, column, a, b = blocks.moves.T
    moves = np.stack((blocks.base + pair, row, column, pattern.block(a, b)), axis=1)
    # sorted by target: threads take ranges of targets
    moves = moves[np.argsort(moves[:, TARGET], kind="stable")]
    return Ties(slaves, pattern.row_of[slaves], joints.start, joints.target, pattern.row_of[joints.target],
                pattern.block(joints.target, joints.target), joints.kind, joints.offset.reshape(-1), joints.rotation.reshape(-1),
                np.ascontiguousarray(moves))


def _held(masks: Array, blocks: Blocks) -> Held | None:
    pattern, number = blocks.pattern, np.flatnonzero(masks)
    if number.size == 0:
        return None
    mask_of_row = np.zeros(pattern.row_of.size, np.int64)
    mask_of_row[pattern.row_of[number]] = masks[number]
    rows, columns = pattern.rows, pattern.columns
    touched = np.flatnonzero((mask_of_row[rows] != 0) | (mask_of_row[columns] != 0))
    # rows that the solver does not see have the idle block
    diagonal = np.where(pattern.row_of[number] < pattern.n, pattern.block(number, number), blocks.n_blocks)
    return Held(pattern.row_of[number], masks[number], diagonal, touched, mask_of_row[rows[touched]],
                mask_of_row[columns[touched]])


def _idle_spins(scene: Scene, nodes: NodeList, joints: Connections, loads: Loads, links: Links) -> Array:
    """Return masks of the spins that statics may fix: one component at the start of every beam of a net that may spin freely
    about its axis, where that changes no stress (theory.md 8)."""
    n = len(nodes)
    out = np.zeros(n, np.int64)
    if not scene.nets:
        return out
    free = (joints.held & 56 == 0) & (joints.row_root == np.arange(n)) & (joints.spin_root == np.arange(n))
    owner = joints.owner
    free[joints.target[(joints.kind != POSITION) & (joints.target != owner)]] = False
    free &= np.bincount(joints.row_root, minlength=n) == 1
    free[loads.first[:, 3:].any(axis=1)] = False
    free[loads.node[loads.value[:, 3:].any(axis=1)]] = False
    for bushing, ends in zip(*links.of(Bushing)):
        free[ends] &= not np.any(bushing.stiffness[3:, 3:])
    free[links.of(ForceElement)[1].reshape(-1)] = False
    inner_free = free & ~joints.tied & (joints.held == 0)
    inner_free[joints.target] = False
    for net in scene.nets:
        ends = nodes.start(net) + net.end_node
        own = inner_free[nodes.span(net)].copy()
        own[net.end_node] = free[ends]
        isotropic = np.array([s.is_isotropic for s in net.sections])[net.section_of]
        idle = np.logical_and.reduceat(own, net.node_start[:-1]) & isotropic
        out[ends[idle, 0]] = 8 << np.argmax(np.abs(net.triads[idle, 0]), axis=1)
    return out


def _sliding(scene: Scene, nodes: NodeList, joints: Connections, kept: int) -> SlidingContact | None:
    """Build the feature of sliders and sleeves, behind so many joints with multipliers; None without any."""
    if not scene.sliders:
        return None
    tracks = [contact_curve_of(scene, nodes, slider) for slider in scene.sliders]
    index = {track: k for k, track in enumerate(dict.fromkeys(tracks))}
    point = np.array([nodes.number(s.point) for s in scene.sliders], np.int64)
    curve = np.array([index[track] for track in tracks], np.int64)
    pack = pack_paths if any(isinstance(slider.beam, Path) for slider in scene.sliders) else pack_curves
    every, corners = list(dict.fromkeys(tracks)), {}
    for c, slider in {c: slider for c, slider in zip(curve.tolist(), scene.sliders) if isinstance(slider.beam, Switch)}.items():
        for place, (track, is_sharp) in corners_of(scene, nodes, slider).items():
            corners[c, *place] = -1 if track is None else len(every), is_sharp
            every += [] if track is None else [track]
    spans = {k: slider.beam.spans for k, slider in enumerate(scene.sliders) if isinstance(slider.beam, Switch)}
    sliders = Sliders(curve, point, joints.spin_root.astype(np.int64), no_following(point.size))
    return SlidingContact(scene.sliders, pack(every), sliders,
                          sleeves_of(scene, nodes, kept), np.array([slider.beam.length for slider in scene.sliders]), spans,
                          corners, tuple(track.node_s for track in every))


def _holding(scene: Scene, nodes: NodeList, joints: Connections) -> Holding:
    """Collect the supports, and the joints that are eliminated."""
    still, turning = [*scene.pins, *scene.clamps], []
    names, masks = ([getattr(x, of) for x in (*still, *scene.prescribed)] for of in ("name", "mask"))
    supports = nodes.held(still).tolist() + [nodes.number(motion.at) for motion in scene.prescribed]
    for net in scene.nets:
        at, node = nodes.start(net) + net.end_node.reshape(-1), net.edges.reshape(-1)
        for kind, held in (("pin", net.pins), ("clamp", net.clamps)):
            for i in held.tolist():
                if kind == "clamp" and net.ball[i]:
                    turning += [(len(names), k) for k in at[node == i].tolist() if k != nodes.start(net) + net.junction[i]]
                names.append(f"{kind} of {net.label} node {i}")
                masks.append(63 if kind == "clamp" else 7)
                supports.append(int(nodes.start(net) + net.junction[i]))
    named = [(nodes.number(j.a), nodes.number(j.b), str(j.name)) for j in scene.rigid]
    closing = set(joints.loops.tolist())
    named += [(nodes.number(j.a), nodes.number(j.b), str(j.name)) for k, j in enumerate(scene.balls) if k not in closing]
    pairs = np.array([x[:2] for x in named] + list(nodes.arm_owner), np.int64).reshape(-1, 2)
    place = np.array(supports, np.int64)
    return Holding(names, place, np.array(masks, np.int64), np.array(turning, np.int64).reshape(-1, 2), [x[2] for x in named],
                   pairs[:len(named)], *trees(len(nodes), pairs, place))


def _joint_names(scene: Scene, nodes: NodeList) -> dict[int, list[str]]:
    """Return the names of the joints at every node with joints; those at points of a body also at its centre."""
    out: dict[int, list[str]] = {}
    for joint in [*scene.rigid, *scene.balls]:
        for node in (joint.a, joint.b):
            out.setdefault(nodes.number(node), []).append(str(joint.name))
    for body, arm in nodes.arm_owner:
        out.setdefault(body, []).extend(out.get(arm, []))
    return out


def _names(scene: Scene, nodes: NodeList) -> dict[str, list[Any]]:
    """Return the names of parts with their nodes, for results."""
    beams = []
    for b in scene.beams:
        first = nodes.start(b)
        ends = first + (b.basis.element_nodes[:, 0] if b.interpolation == "lagrange" else np.array([], int))
        last = first + b.n_nodes - 1
        beams.append({"name": b.name, "first": first, "count": b.n_nodes, "element_ends": [*ends.tolist(), last],
                      "s": b.node_s.tolist(), "length": float(b.length), "degree": b.degree,
                      **dict(zip(("half_2", "half_3", "round"), b.section.outline)),
                      **({"spline_ends": b.basis.element_ends.tolist()} if b.interpolation == "bspline" else {})})
    nets = [{"name": net.name, "first": nodes.start(net), "count": net.n_nodes, "starts": net.node_start[:-1].tolist(),
             "junctions": net.junction.tolist(), "outlines": [x for section in net.sections for x in section.outline],
             "outline_of": net.section_of.tolist() if len(net.sections) > 1 else []} for net in scene.nets]
    ropes = [{"name": winch.name, "nodes": [nodes.number(winch.drum), *(nodes.start(x) for x in winch.points),
                                            nodes.number(winch.load)]} for winch in scene.winches]
    return {"beams": beams, **({"nets": nets} if nets else {}), **({"ropes": ropes} if ropes else {}),
            "bodies": [{"name": p.name, "node": nodes.start(p)} for p in scene.bodies],
            "masses": [{"name": p.name, "node": nodes.start(p), **({"drum": True} if isinstance(p, Coil) else {"rope": True}
                                                                   if isinstance(p, RopePoint) else {})} for p in scene.masses],
            "sliders": [s.name for s in scene.sliders], "points": []}
