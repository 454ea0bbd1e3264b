"""The scene compiler: turns nouns into constant tables and a plan of the work that is present.

What a scene lacks has no table, no rows and no unknowns, and no code is compiled for it.
"""
from __future__ import annotations

from copy import copy
from functools import partial
from typing import Any

import numpy as np

from .arguments import Anything, Flag, Word, checked, shown
from .carriers import carriers_of
from .connections import NO_PAIRS, POSITION, Connections, connect
from .errors import SceneError
from .initial import initial_state, place_points
from .links import Links
from .kernels.nodes import Bodies, Held
from .kernels.slider import Sliders
from .kernels.terms import NoTies
from .kernels.ties import Ties
from .model import Model
from .numbering import NodeList
from .pattern import Pattern, ascending, build_pattern, widen
from .planar import find_plane
from .report import describe
from .scene import Beam, RigidBody, Scene
from .slider_forces import slider_forces_of
from .substructuring import substructures_of
from .tables import ElementPacker, Elements, condensed_ends, elements_of, pack_curves, pack_inner, pack_substructures

Array = np.ndarray
SOLVERS = ("auto", "chain", "sparse")
CHOICE = Flag(("auto",))


@checked(scene=Anything(), solver=Word(SOLVERS), eliminate_inner=Flag(), planar=CHOICE, condense=CHOICE)
def compile_scene(scene: Scene, *, solver: str = "auto", eliminate_inner: bool = True, planar: bool | str = "auto",
                  condense: bool | str = "auto") -> Model:
    """Compile a scene to constant tables.

    Parameters
    ----------
    scene : Scene
    solver : {'auto', 'chain', 'sparse'}
        Block elimination in compiled code, or PARDISO (SuperLU without MKL); 'auto' takes the elimination where its fill is
        small.
    eliminate_inner : bool
        Eliminate the inner nodes of elements in the element loop, so that the solver sees the end nodes only. Same results;
        False is for comparison.
    planar : {'auto', True, False}
        Run a scene that lies and moves in a plane with 3 unknowns a node instead of 6: same results to round-off, several times
        faster. True refuses a scene that does not stay in a plane and says why. False runs every scene in space, like the methods
        that conserving steps are compared with. Instabilities out of the plane need a disturbance out of it (theory.md 10).
    condense : {'auto', True, False}
        Condense the beams of nets, and pieces of long beams with Lagrange elements, to their ends, eight equal ones at a time and
        on several threads, so that the solver sees these ends only (theory.md 9). Same results to round-off; 'auto' does it in
        large scenes, where it pays.

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
    scene.check()
    nodes = NodeList(scene)
    place_points(scene, nodes)
    n = len(nodes)
    extent = float(np.max(np.ptp(nodes.phi, axis=0)))
    length = max([extent, *(b.length for b in scene.beams), *(float(net.lengths.max()) for net in scene.nets)]) or 1.0
    joints, hinges = _connections(scene, nodes, length)
    links = Links(scene, nodes, joints, hinges)

    elements = [elements_of(part, nodes.start(part)) for part in [*scene.beams, *scene.nets]]
    packers = {"simo_reissner": ElementPacker(), "green_lagrange": ElementPacker()}
    carried = None if links.kept or not condense else carriers_of(scene, nodes, joints, links.touched)
    beams, carried = substructures_of(scene, nodes, joints, links.touched, condense, carried)
    for source, part in zip([*scene.beams, *scene.nets], elements):
        some, found = beams.get(source.name, (None, []))
        if carried is not None and source.name in carried.elements:
            some = np.setdiff1d(np.arange(len(part.nodes)) if some is None else some, carried.taken(source.name))
        packers[part.strain].add(part, nodes.phi, nodes.directors, some)
        for lanes in found:
            packers[part.strain].add(part, nodes.phi, nodes.directors, lanes.reshape(-1), lanes.shape[1])
        for g, lanes in () if carried is None else carried.elements.get(source.name, ()):
            packers[part.strain].add(part, nodes.phi, nodes.directors, lanes, -1 - g)
    used = [packers[name] for name in packers if packers[name].meta]
    carriers = None if carried is None else carried.carriers._replace(tables=np.array(
        [(g, k, at, m) for k, packer in enumerate(packers.values()) for g, at, m in packer.carried()]))
    ends = condensed_ends(used)
    if carriers is not None:
        ends = np.concatenate((ends, carriers.ends))
    size, columns = 0, len(scene.sliders) + len(links.kept) > 0 and carriers is None
    if eliminate_inner:
        eligible = _inner_nodes(n, used, joints)
        eligible[links.touched] = False
        for packer in used:
            size = packer.eliminate(eligible, size, columns)
    root = joints.row_root[ends]
    pairs = np.concatenate([np.zeros(0, np.int64), *(p.pairs(joints.row_root) for p in used),
                            (root[:, [0, 0, 1, 1]] * n + root[:, [0, 1, 0, 1]]).reshape(-1),
                            links.pairs])
    band = max([int(np.where(meta[:, 6] >= 0, 1, meta[:, 0] - 1).max()) for p in used for meta, _ in p.lanes()] + [len(ends) > 0])
    level = _levels(n, used)
    if carriers is not None:
        level[carriers.apart] = 2
    level[ends] = 0
    blocks = _Blocks(n, pairs, joints, band, solver, level)
    del pairs

    tables = {}
    at = 0
    row_of = blocks.pattern.row_of
    for name, packer in packers.items():
        m = packer.n_blocks
        tables[name] = packer.tables(row_of, blocks.element[at:at + m]) if packer.meta else None
        at += m
    n_panel = blocks.pattern.n + int(np.sum(level == 1))
    inner = pack_inner(used, row_of, blocks.pattern.n, n_panel, size, columns)
    between_ends = blocks.element[at:at + 4 * len(ends)].reshape(-1, 4)
    substructures = pack_substructures(list(packers.values()), row_of[ends], between_ends, blocks.n_blocks, blocks.pattern.n,
                                       n_panel)
    del used, packers
    bodies = _bodies(scene, nodes, blocks)
    ties = _ties(joints.apart(), blocks)
    held = _held(joints.held, blocks.pattern)
    curves, sliders = _sliders(scene, nodes, joints)
    loads, times, weight, constant = _loads(scene, nodes, elements, row_of)
    idle = _idle_spins(scene, nodes, joints, loads, row_of)
    static_held = _held(joints.held | idle, blocks.pattern) if idle.any() else held
    link_tables = links.tables(blocks, row_of, len(scene.sliders), NoTies() if ties is None else ties)
    state, projected = initial_state(scene, nodes, joints, elements, links.kept)
    model = Model(
        scene_name=scene.name, n_nodes=n, simo=tables["simo_reissner"], green=tables["green_lagrange"],
        inner=inner, substructures=substructures, carriers=carriers, bodies=bodies,
        links=link_tables, kept=links.kept, ties=ties, held=held, static_held=static_held,
        curves=curves, sliders=sliders,
        pattern=blocks.pattern, spinless=((joints.held[joints.row_root] & 56) == 56).astype(np.int8),
        spin_root=joints.spin_root, loads=loads, load_times=times, gravity=np.array(scene.gravity),
        gravity_time=scene.gravity_time, gravity_weight=weight, constant_load=constant, q0=state.q, v0=state.v, s0=state.s,
        slider_lengths=np.array([s.beam.length for s in scene.sliders]), length=length, n_blocks=blocks.n_blocks,
        names=_names(scene, nodes), labels=nodes.labels, numbers=nodes, projected=projected, joints=_joint_names(scene, nodes),
        load_names=[_timed_by(scene, time) for time in times], slider_forces=slider_forces_of(scene.sliders))
    # positions and triads of the node list are views of q0: the same numbers, stored once
    coordinates = model.q0.reshape(-1, 4, 3)
    nodes.phi, nodes.directors = coordinates[:, 0], coordinates[:, 1:]
    if planar:
        model.plane, model.not_planar = find_plane(model)
    else:
        model.not_planar = "planar=False"
    if planar is True and model.plane is None:
        raise SceneError(f"compile_scene: {scene.label} does not stay in a plane: {model.not_planar}; use planar='auto'")
    model.asked_for_plane = planar is True
    model.text = describe(scene, model)
    # a copy of the scene, because the user may add parts to it before other models of it are compiled
    as_compiled = copy(scene)
    as_compiled.parts = list(scene.parts)
    model.massless = tuple(beam.label for beam in scene.beams if _is_massless(scene, beam))
    model.plain = partial(compile_scene, as_compiled, solver="sparse", eliminate_inner=False, condense=False)
    model.uncondensed = partial(compile_scene, as_compiled, solver=solver, eliminate_inner=eliminate_inner, planar=False,
                                condense=False)
    return model


def _is_massless(scene: Scene, beam: Beam) -> bool:
    """Whether neither inertia nor a clamp or rigid connection resists a spin of the beam about its own axis."""
    holds = [clamp.at for clamp in scene.clamps] + [node for joint in scene.rigid for node in (joint.a, joint.b)]
    return not any(beam.section.inertia[1:]) and all(node.owner is not beam for node in holds)


def _inner_nodes(n: int, packers: list[ElementPacker], joints: Connections) -> Array:
    """Whether a node may be eliminated within its element: no other element, no joint, no support; bool [N + 1], the last one for
    idle lanes."""
    nodes = [live.reshape(-1) for packer in packers for _, live in packer.lanes()]
    # -1 of idle lanes counts for the last
    eligible = np.roll(np.bincount(np.concatenate([np.zeros(0, np.int64), *nodes]) + 1, minlength=n + 1), -1) == 1
    eligible[:n] &= (joints.held == 0) & (joints.spin_root == np.arange(n)) & ~joints.tied
    eligible[joints.target] = False
    eligible[n] = True
    return eligible


def _levels(n: int, packers: list[ElementPacker]) -> Array:
    """Of every node 0 where the solver sees it, 1 where it is eliminated within its element, 2 where it belongs to a condensed
    beam, [N]."""
    level = np.zeros(n, np.int8)
    for packer in packers:
        for meta, live in packer.lanes():
            gone = live[meta[:, 6] >= 0, 1:-1]
            level[gone[gone >= 0]] = 1
        for _, live in packer.condensed():
            level[live] = 2
    return level


def _connections(scene: Scene, nodes: NodeList, length: float) -> tuple[Connections, Array]:
    """How nodes are tied, and the ball joints of nets, int [*, 2]."""
    held = np.zeros(len(nodes), np.int64)
    welds, hinges = [NO_PAIRS], [NO_PAIRS]
    for net in scene.nets:
        held[nodes.span(net)] |= net.held()
        for found, pairs in zip((welds, hinges), net.pairs()):
            found.append(nodes.start(net) + pairs)
    for mass in scene.masses:
        held[nodes.start(mass)] = 56
    for pin in scene.pins:
        held[nodes.number(pin.at)] |= 7
    for clamp in scene.clamps:
        held[nodes.start(clamp.at.owner) if isinstance(clamp.at.owner, RigidBody) else nodes.number(clamp.at)] = 63
    rigid = [(nodes.number(j.a), nodes.number(j.b), str(j.name)) for j in scene.rigid]
    rigid += [(owner, arm, "point") for owner, arm in nodes.arm_owner]
    balls = [(nodes.number(j.a), nodes.number(j.b), str(j.name)) for j in scene.balls]
    return connect(nodes.phi, nodes.directors, rigid, balls, held, nodes.rank, nodes.labels, 1e-14 * length,
                   np.concatenate(welds), np.concatenate(hinges)), np.concatenate(hinges)


class _Blocks:
    """Numbers of all blocks: those of the pattern, then one for every pair with a tied node, then one idle block.
    pairs: coupled nodes as i N + j, or -1; level: int [N], 0 for the nodes that the solver sees."""

    def __init__(self, n: int, pairs: Array, joints: Connections, band: int, solver: str, level: Array) -> None:
        end = level == 0
        own = joints.row_root == np.arange(n)
        tied = joints.tied & own
        live = pairs >= 0
        coupled = ascending(pairs[live])
        through = tied[coupled // n] | tied[coupled % n]
        slaves = np.flatnonzero(tied)
        # pairs with a tied node, ascending, and where each of their entries moves
        self.raw = ascending(np.concatenate((coupled[through], slaves * (n + 1))))
        self.moves = _moves(self.raw, joints, tied)
        diagonal = np.flatnonzero(own) * (n + 1)
        final = np.concatenate((coupled[~through], diagonal, self.moves[:, 3] * n + self.moves[:, 4]))
        final = np.stack((final // n, final % n), axis=1)
        final = final[end[final].all(axis=1)]
        seen = end & own
        number = np.cumsum(seen) - 1
        among_ends = build_pattern(int(seen.sum()), number[final], band, allow_elimination=solver != "sparse")
        del final
        self.pattern: Pattern = widen(among_ends, level, joints.row_root)
        if solver == "chain" and self.pattern.plan is None:
            raise SceneError("compile_scene: solver='chain' would fill the matrix: this scene is a net; use solver='auto'")
        self.root = joints.row_root
        self.base = self.pattern.keys.size
        self.n_blocks = self.base + self.raw.size
        # block of every coupled pair, then of all pairs
        block = np.empty(coupled.size + 1, np.int64)
        block[:-1][~through] = self.pattern.block(coupled[~through] // n, coupled[~through] % n)
        block[:-1][through] = self.base + np.searchsorted(self.raw, coupled[through])
        block[-1] = self.n_blocks
        self.element = block[np.where(live, np.searchsorted(coupled, pairs), coupled.size)]

    def diagonal(self, nodes: Array) -> Array:
        """Blocks that the own terms of nodes are added to."""
        return self.between(nodes, nodes)

    def between(self, a: Array, b: Array) -> Array:
        """Blocks that terms of coupled nodes are added to, int [n]."""
        a, b = self.root[a], self.root[b]
        key = a * self.pattern.row_of.size + b
        at = np.minimum(np.searchsorted(self.raw, key), max(self.raw.size - 1, 0))
        tied = self.raw[at] == key if self.raw.size else np.zeros(key.shape, bool)
        out = self.base + at
        out[~tied] = self.pattern.block(a[~tied], b[~tied])
        return out


def _moves(raw: Array, joints: Connections, tied: Array) -> Array:
    """Of all pairs with a tied node, i N + j: number of the pair, entry of its row or -1, entry of its column or -1, nodes that
    it moves to, int [*, 5]. Entries are numbered without those of shared rows."""
    n = tied.size
    apart = joints.apart()
    first, target = apart.start, apart.target
    count = np.maximum(np.diff(first), 1)
    i, j = raw // n, raw % n
    size = count[i] * count[j]
    pair = np.repeat(np.arange(raw.size), size)
    local = np.arange(pair.size) - np.repeat(np.cumsum(size) - size, size)
    out = [pair]
    nodes = []
    for side, step in ((i[pair], local // count[j[pair]]), (j[pair], local % count[j[pair]])):
        entry = np.where(tied[side], first[side] + step, -1)
        out.append(entry)
        nodes.append(np.where(tied[side], target[entry] if target.size else side, side))
    return np.stack((*out, *nodes), axis=1)


def _bodies(scene: Scene, nodes: NodeList, blocks: _Blocks) -> Bodies | None:
    parts = [*scene.bodies, *scene.masses]
    number = [np.array([nodes.start(p) for p in parts], np.int64)]
    inertia = [np.zeros((len(parts), 4, 4))]
    for k, part in enumerate(parts):
        inertia[0][k, 0, 0] = part.mass
        if isinstance(part, RigidBody):
            # Euler tensor: T = 1/2 sum E_ij v_i . v_j with E = 1/2 tr(J) I - J
            inertia[0][k, 1:, 1:] = 0.5 * np.trace(part.inertia) * np.eye(3) - part.inertia
    for net in scene.nets:
        if net.masses is not None:
            loaded = np.flatnonzero(net.masses)
            number.append(nodes.start(net) + net.junction[loaded])
            inertia.append(np.zeros((loaded.size, 4, 4)))
            inertia[-1][:, 0, 0] = net.masses[loaded]
    node = np.concatenate(number)
    if not node.size:
        return None
    return Bodies(node, blocks.pattern.row_of[node], blocks.diagonal(node), np.concatenate(inertia).reshape(-1))


def _ties(joints: Connections, blocks: _Blocks) -> Ties | None:
    """joints: without those of shared rows."""
    if not joints.kind.size:
        return None
    pattern = blocks.pattern
    slaves = np.flatnonzero(joints.tied)
    pair, row, column, a, b = blocks.moves.T
    moves = np.stack((blocks.base + pair, row, column, pattern.block(a, b)), axis=1)
    # by target: threads take ranges of targets
    moves = moves[np.argsort(moves[:, 3], kind="stable")]
    return Ties(slaves, pattern.row_of[slaves], joints.start, joints.target, pattern.row_of[joints.target],
                pattern.block(joints.target, joints.target), joints.kind, joints.offset.reshape(-1), joints.rotation.reshape(-1),
                np.ascontiguousarray(moves))


def _held(masks: Array, pattern: Pattern) -> Held | None:
    number = np.flatnonzero(masks)
    if number.size == 0:
        return None
    mask_of_row = np.zeros(pattern.row_of.size, np.int64)
    mask_of_row[pattern.row_of[number]] = masks[number]
    rows, columns = pattern.rows, pattern.columns
    touched = np.flatnonzero((mask_of_row[rows] != 0) | (mask_of_row[columns] != 0))
    return Held(pattern.row_of[number], masks[number], pattern.block(number, number), touched, mask_of_row[rows[touched]],
                mask_of_row[columns[touched]])


def _idle_spins(scene: Scene, nodes: NodeList, joints: Connections, loads: Array, row_of: Array) -> Array:
    """Masks of the spins that statics may hold: one component at the start of every beam of a net that nothing keeps from
    spinning about its axis, where that changes no stress (theory.md 8)."""
    n = len(nodes)
    out = np.zeros(n, np.int64)
    if not scene.nets:
        return out
    free = (joints.held & 56 == 0) & (joints.row_root == np.arange(n)) & (joints.spin_root == np.arange(n))
    owner = joints.owner
    free[joints.target[(joints.kind != POSITION) & (joints.target != owner)]] = False
    free &= np.bincount(joints.row_root, minlength=n) == 1
    free &= ~np.any(loads.reshape(len(loads), n + 1, 8)[:, row_of, 3:6], axis=(0, 2))
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


def _sliders(scene: Scene, nodes: NodeList, joints: Connections) -> tuple[Any, Sliders | None]:
    if not scene.sliders:
        return None, None
    index: dict[tuple[int, str], int] = {}
    items = []
    for slider in scene.sliders:
        key = (id(slider.beam), slider.curve)
        if key not in index:
            index[key] = len(items)
            items.append((nodes.start(slider.beam), slider.beam, slider.beam.basis.curve(slider.curve)))
    point = np.array([nodes.number(s.point) for s in scene.sliders], np.int64)
    curve = np.array([index[id(s.beam), s.curve] for s in scene.sliders], np.int64)
    return pack_curves(items), Sliders(curve, point, joints.spin_root.astype(np.int64))


def _loads(scene: Scene, nodes: NodeList, elements: list[Elements], row_of: Array) -> tuple[Array, list[Any], Array, Array]:
    """(vectors [K, 8 (N + 1)], their time functions, weight of every node [N] in kg, constant forces [N, 3] in N)."""
    n = len(nodes)
    groups: list[tuple[Any, Array]] = []

    def group(time: Any) -> Array:
        for known, vector in groups:
            if known is time:
                return vector
        groups.append((time, np.zeros((n, 6))))
        return groups[-1][1]

    at = [part.nodes.reshape(-1) for part in elements]
    share = [(part.inertia[part.section, :1] * part.mass_phi.sum(axis=2)).reshape(-1) for part in elements]
    weight = np.bincount(np.concatenate(at), np.concatenate(share), minlength=n) if at else np.zeros(n)
    for body in [*scene.bodies, *scene.masses]:
        weight[nodes.start(body)] += body.mass
    for net in scene.nets:
        if net.masses is not None:
            weight[nodes.start(net) + net.junction] += net.masses
    if np.any(scene.gravity):
        group(scene.gravity_time)[:, :3] += weight[:, None] * scene.gravity
    constant = np.zeros((n, 3))
    for net in scene.nets:
        if net.loads is not None:
            at = nodes.start(net) + net.junction
            group(net.time)[at, :3] += net.loads
            if net.time is None:
                constant[at] += net.loads
    for load in scene.loads:
        k = nodes.number(load.at)
        vector = group(load.time)
        vector[k, :3] += load.force
        vector[k, 3:] += load.moment
        if load.time is None:
            constant[k] += load.force
    for load in scene.distributed:
        basis = load.beam.basis
        at = nodes.start(load.beam) + basis.element_nodes
        vector = group(load.time)
        # forces work on positions, moments on the spins of the directors: each with its own basis
        for field, s, weight_s, shape, columns in (
                (load.force_at, basis.mass_point_s, basis.mass_weight, basis.mass_phi_values, slice(0, 3)),
                (load.moment_at, basis.point_s, basis.weight, basis.dir, slice(3, 6))):
            values = field(s.reshape(-1)).reshape(*s.shape, 3)
            nodal = np.einsum("eg,egn,egc->enc", weight_s, shape, values)
            target = np.zeros((n, 3))
            np.add.at(target, at, nodal)
            vector[:, columns] += target
            if load.time is None and columns.start == 0:
                constant += target
    vectors = np.zeros((len(groups), 8 * (n + 1)))
    for k, (_, vector) in enumerate(groups):
        for c in range(6):
            # nodes may share a row
            vectors[k].reshape(n + 1, 8)[:, c] = np.bincount(row_of, vector[:, c], minlength=n + 1)
    return vectors, [time for time, _ in groups], weight, constant


def _timed_by(scene: Scene, time: Any) -> str:
    """What has this time function, for messages."""
    names = ["gravity"] * (scene.gravity_time is time)
    names += [f"{load.kind} {load.name!r}" for load in [*scene.loads, *scene.distributed] if load.time is time]
    names += [f"the loads of {net.label}" for net in scene.nets if net.loads is not None and net.time is time]
    return ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")


def _joint_names(scene: Scene, nodes: NodeList) -> dict[int, list[str]]:
    """Names of the joints at every node that has some; those at points of a body also at its centre."""
    out: dict[int, list[str]] = {}
    for joint in [*scene.rigid, *scene.balls]:
        for node in (joint.a, joint.b):
            out.setdefault(nodes.number(node), []).append(str(joint.name))
    for body, arm in nodes.arm_owner:
        out.setdefault(body, []).extend(out.get(arm, []))
    return out


def _names(scene: Scene, nodes: NodeList) -> dict[str, list[Any]]:
    """Names for results: what stands where in the node list."""
    beams = []
    for b in scene.beams:
        first = nodes.start(b)
        ends = first + (b.basis.element_nodes[:, 0] if b.interpolation == "lagrange" else np.array([], int))
        last = first + b.n_nodes - 1
        beams.append({"name": b.name, "first": first, "count": b.n_nodes, "element_ends": [*ends.tolist(), last],
                      "s": b.node_s.tolist(), "length": float(b.length)})
    nets = [{"name": net.name, "first": nodes.start(net), "count": net.n_nodes, "starts": net.node_start[:-1].tolist(),
             "junctions": net.junction.tolist()} for net in scene.nets]
    return {"beams": beams, **({"nets": nets} if nets else {}),
            "bodies": [{"name": p.name, "node": nodes.start(p)} for p in scene.bodies],
            "masses": [{"name": p.name, "node": nodes.start(p)} for p in scene.masses],
            "sliders": [s.name for s in scene.sliders], "points": []}
