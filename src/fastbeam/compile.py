"""The scene compiler: turns nouns into constant tables and a plan of the work that is present.

Whatever a scene lacks gets no table, no rows, no unknowns and, because its argument is None, no compiled code.
"""
from __future__ import annotations

from typing import Any

import numpy as np

from .connections import Connections, connect
from .errors import SceneError
from .initial import initial_state
from .kernels.nodes import Bodies, Held
from .kernels.slider import Sliders
from .kernels.ties import Ties
from .model import Model
from .numbering import NodeList
from .pattern import Pattern, build_pattern, widen
from .planar import find_plane
from .report import describe
from .scene import RigidBody, Scene
from .tables import ElementPacker, pack_curves, pack_inner

Array = np.ndarray
SOLVERS = ("auto", "chain", "sparse")


def compile_scene(scene: Scene, *, solver: str = "auto", eliminate_inner: bool = True, planar: bool | str = "auto") -> Model:
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
        raise SceneError(f"compile_scene: needs a Scene, got {scene!r:.60}; put the parts into one: "
                         "model = fb.compile_scene(fb.Scene(beam, ...))")
    if solver not in SOLVERS:
        raise SceneError(f"compile_scene: solver {solver!r} does not exist: choose 'auto', 'chain' or 'sparse'")
    if not (planar == "auto" or isinstance(planar, bool)):
        raise SceneError(f"compile_scene: planar must be 'auto', True or False, got {planar!r}")
    scene.check()
    nodes = NodeList(scene)
    n = len(nodes)
    extent = float(np.max(np.ptp(nodes.phi, axis=0)))
    length = max([extent, *(b.length for b in scene.beams)]) or 1.0
    joints = _connections(scene, nodes, length)

    packers = {"simo_reissner": ElementPacker(), "green_lagrange": ElementPacker()}
    for beam in scene.beams:
        a = nodes.first[id(beam)]
        packers[beam.strain].add(beam, a, nodes.phi[a:a + beam.n_nodes], nodes.directors[a:a + beam.n_nodes])
    used = [packers[name] for name in packers if packers[name].meta]
    size = 0
    if eliminate_inner:
        eligible = _inner_nodes(n, used, joints)
        for packer in used:
            size = packer.eliminate(eligible, size)
    pairs = np.concatenate([p.pairs() for p in used]) if used else np.zeros((0, 2), np.int64)
    band = max([1 if meta[k, 6] >= 0 else int(meta[k, 0]) - 1 for p in used for meta in p.meta for k in range(len(meta))] + [0])
    blocks = _Blocks(n, pairs, joints, band, solver, _end_nodes(n, used))

    tables = {}
    at = 0
    for name, packer in packers.items():
        m = packer.n_blocks
        tables[name] = packer.tables(blocks.pattern.row_of, blocks.element[at:at + m]) if packer.meta else None
        at += m
    bodies = _bodies(scene, nodes, blocks)
    ties = _ties(joints, blocks, n)
    held = _held(joints, blocks)
    curves, sliders = _sliders(scene, nodes, joints)
    loads, times, weight, constant = _loads(scene, nodes, blocks.pattern.row_of)
    state = initial_state(scene, nodes, joints, curves, sliders, ties)
    model = Model(
        scene_name=scene.name, n_nodes=n, simo=tables["simo_reissner"], green=tables["green_lagrange"],
        inner=pack_inner(used, blocks.pattern.row_of, blocks.pattern.n, size), bodies=bodies, ties=ties,
        held=held, curves=curves, sliders=sliders, pattern=blocks.pattern, spinless=((joints.held & 56) == 56).astype(np.int8),
        spin_root=joints.spin_root, loads=loads, load_times=times, gravity=np.array(scene.gravity),
        gravity_time=scene.gravity_time, gravity_weight=weight, constant_load=constant, q0=state.q, v0=state.v, s0=state.s,
        slider_lengths=np.array([s.beam.length for s in scene.sliders]), length=length, n_blocks=blocks.n_blocks,
        names=_names(scene, nodes), labels=nodes.labels, numbers=nodes)
    if planar:
        model.plane, model.not_planar = find_plane(model)
    else:
        model.not_planar = "planar=False"
    if planar is True and model.plane is None:
        raise SceneError(f"compile_scene: {scene.label} does not stay in a plane: {model.not_planar}; use planar='auto'")
    model.text = describe(scene, model)
    return model


def _inner_nodes(n: int, packers: list[ElementPacker], joints: Connections) -> Array:
    """Whether a node may be eliminated within its element: no other element, no joint, no support; bool [N + 1], the last one for
    idle lanes."""
    count = np.zeros(n + 1, np.int64)
    for packer in packers:
        for _, live in packer.lanes():
            np.add.at(count, live, 1)
    eligible = count == 1
    eligible[:n] &= (joints.held == 0) & (joints.spin_root == np.arange(n))
    for k, entries in joints.entries.items():
        eligible[[k, *(entry[1] for entry in entries)]] = False
    eligible[n] = True
    return eligible


def _end_nodes(n: int, packers: list[ElementPacker]) -> Array:
    """Nodes that the solver sees, bool [N]."""
    end = np.ones(n, dtype=bool)
    for packer in packers:
        for meta, live in packer.lanes():
            gone = live[meta[:, 6] >= 0, 1:-1]
            end[gone[gone >= 0]] = False
    return end


def _connections(scene: Scene, nodes: NodeList, length: float) -> Connections:
    held = np.zeros(len(nodes), np.int64)
    for mass in scene.masses:
        held[nodes.first[id(mass)]] = 56
    for pin in scene.pins:
        held[nodes.number(pin.at)] |= 7
    for clamp in scene.clamps:
        held[nodes.first[id(clamp.at.owner)] if isinstance(clamp.at.owner, RigidBody) else nodes.number(clamp.at)] = 63
    rigid = [(nodes.number(j.a), nodes.number(j.b), str(j.name)) for j in scene.rigid]
    rigid += [(owner, arm, "point") for owner, arm in nodes.arm_owner]
    balls = [(nodes.number(j.a), nodes.number(j.b), str(j.name)) for j in scene.balls]
    return connect(nodes.phi, nodes.directors, rigid, balls, held, nodes.rank, nodes.labels, 1e-14 * length)


class _Blocks:
    """Numbers of all blocks: those of the pattern, then one for every pair with a tied node, then one idle block.
    end: bool [N], the nodes that the solver sees."""

    def __init__(self, n: int, pairs: Array, joints: Connections, band: int, solver: str, end: Array) -> None:
        tied = np.zeros(n + 1, dtype=bool)
        tied[list(joints.entries)] = True
        live = pairs[:, 0] >= 0
        raw = live & (tied[pairs[:, 0]] | tied[pairs[:, 1]])
        diagonal = np.stack((np.arange(n), np.arange(n)), axis=1)
        self.raw_pairs = np.unique(np.concatenate((pairs[raw], diagonal[tied[:n]])), axis=0)
        targets = {k: joints.targets(k) for k in joints.entries}
        moved = [(a, b) for i, j in self.raw_pairs.tolist() for a in targets.get(i, [i]) for b in targets.get(j, [j])]
        final = np.concatenate((np.unique(pairs[live & ~raw], axis=0), diagonal, np.array(moved, np.int64).reshape(-1, 2)))
        final = final[end[final].all(axis=1)]
        number = np.cumsum(end) - 1
        among_ends = build_pattern(int(end.sum()), number[final], band, allow_elimination=solver != "sparse")
        self.pattern: Pattern = widen(among_ends, end)
        if solver == "chain" and self.pattern.plan is None:
            raise SceneError("compile_scene: solver='chain' would fill the matrix: this scene is a net; use solver='auto'")
        base = self.pattern.keys.size
        self.n_blocks = base + len(self.raw_pairs)
        raw_keys = self.raw_pairs[:, 0] * n + self.raw_pairs[:, 1]
        self.element = np.full(len(pairs), self.n_blocks)
        plain = live & ~raw
        self.element[plain] = self.pattern.block(pairs[plain, 0], pairs[plain, 1])
        self.element[raw] = base + np.searchsorted(raw_keys, pairs[raw, 0] * n + pairs[raw, 1])
        self.raw_diagonal = {i: base + k for k, (i, j) in enumerate(self.raw_pairs.tolist()) if i == j}
        self.base = base

    def diagonal(self, node: int) -> int:
        """Block that a node's own terms are added to."""
        return self.raw_diagonal.get(node, int(self.pattern.block(np.int64(node), np.int64(node))))


def _bodies(scene: Scene, nodes: NodeList, blocks: _Blocks) -> Bodies | None:
    parts = [*scene.bodies, *scene.masses]
    if not parts:
        return None
    number = np.array([nodes.first[id(p)] for p in parts], np.int64)
    inertia = np.zeros((len(parts), 4, 4))
    for k, part in enumerate(parts):
        inertia[k, 0, 0] = part.mass
        if isinstance(part, RigidBody):
            # Euler tensor: T = 1/2 sum E_ij v_i . v_j with E = 1/2 tr(J) I - J
            inertia[k, 1:, 1:] = 0.5 * np.trace(part.inertia) * np.eye(3) - part.inertia
    diagonal = np.array([blocks.diagonal(int(k)) for k in number], np.int64)
    return Bodies(number, blocks.pattern.row_of[number].astype(np.int64), diagonal, inertia.reshape(-1))


def _ties(joints: Connections, blocks: _Blocks, n: int) -> Ties | None:
    if not joints.entries:
        return None
    pattern = blocks.pattern
    slaves = sorted(joints.entries)
    flat = [entry for k in slaves for entry in joints.entries[k]]
    counts = np.zeros(n, np.int64)
    counts[slaves] = [len(joints.entries[k]) for k in slaves]
    start = np.concatenate(([0], np.cumsum(counts))).astype(np.int64)
    target = np.array([e[1] for e in flat], np.int64)
    moves = []

    def sides(k: int) -> list[tuple[int, int]]:
        """(entry or -1, node) of a node."""
        if k not in joints.entries:
            return [(-1, k)]
        return [(e, int(target[e])) for e in range(start[k], start[k + 1])]

    for m, (i, j) in enumerate(blocks.raw_pairs.tolist()):
        for ea, a in sides(i):
            for eb, b in sides(j):
                moves.append((blocks.base + m, ea, eb, int(pattern.block(np.int64(a), np.int64(b)))))
    return Ties(np.array(slaves, np.int64), pattern.row_of[slaves].astype(np.int64), start, target,
                pattern.row_of[target].astype(np.int64), pattern.block(target, target).astype(np.int64),
                np.array([e[0] for e in flat], np.int64), np.array([e[2] for e in flat]).reshape(-1),
                np.array([e[3] for e in flat]).reshape(-1), np.array(moves, np.int64).reshape(-1, 4))


def _held(joints: Connections, blocks: _Blocks) -> Held | None:
    pattern = blocks.pattern
    number = np.flatnonzero(joints.held)
    if number.size == 0:
        return None
    mask_of_row = np.zeros(pattern.row_of.size, np.int64)
    mask_of_row[pattern.row_of] = joints.held
    rows, columns = pattern.rows, pattern.columns
    touched = np.flatnonzero((mask_of_row[rows] != 0) | (mask_of_row[columns] != 0))
    return Held(pattern.row_of[number].astype(np.int64), joints.held[number], pattern.block(number, number).astype(np.int64),
                touched.astype(np.int64), mask_of_row[rows[touched]], mask_of_row[columns[touched]])


def _sliders(scene: Scene, nodes: NodeList, joints: Connections) -> tuple[Any, Sliders | None]:
    if not scene.sliders:
        return None, None
    index: dict[tuple[int, str], int] = {}
    items = []
    for slider in scene.sliders:
        key = (id(slider.beam), slider.curve)
        if key not in index:
            index[key] = len(items)
            items.append((nodes.first[id(slider.beam)], slider.beam, slider.beam.basis.curve(slider.curve)))
    point = np.array([nodes.number(s.point) for s in scene.sliders], np.int64)
    curve = np.array([index[id(s.beam), s.curve] for s in scene.sliders], np.int64)
    return pack_curves(items), Sliders(curve, point, joints.spin_root.astype(np.int64))


def _loads(scene: Scene, nodes: NodeList, row_of: Array) -> tuple[Array, list[Any], Array, Array]:
    """(vectors [K, 8 (N + 1)], their time functions, weight of every node [N] in kg, constant forces [N, 3] in N)."""
    n = len(nodes)
    groups: list[tuple[Any, Array]] = []

    def group(time: Any) -> Array:
        for known, vector in groups:
            if known is time:
                return vector
        groups.append((time, np.zeros((n, 6))))
        return groups[-1][1]

    weight = np.zeros(n)
    for beam in scene.beams:
        basis = beam.basis
        np.add.at(weight, nodes.first[id(beam)] + basis.element_nodes, beam.section.inertia[0] * basis.mass_phi.sum(axis=2))
    for part in [*scene.bodies, *scene.masses]:
        weight[nodes.first[id(part)]] += part.mass
    if np.any(scene.gravity):
        group(scene.gravity_time)[:, :3] += weight[:, None] * scene.gravity
    constant = np.zeros((n, 3))
    for load in scene.loads:
        k = nodes.number(load.at)
        vector = group(load.time)
        vector[k, :3] += load.force
        vector[k, 3:] += load.moment
        if load.time is None:
            constant[k] += load.force
    for load in scene.distributed:
        basis = load.beam.basis
        at = nodes.first[id(load.beam)] + basis.element_nodes
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
        vectors[k].reshape(n + 1, 8)[row_of, :6] = vector
    return vectors, [time for time, _ in groups], weight, constant


def _names(scene: Scene, nodes: NodeList) -> dict[str, list[Any]]:
    """Names for results: what stands where in the node list."""
    beams = []
    for b in scene.beams:
        first = nodes.first[id(b)]
        ends = first + (b.basis.element_nodes[:, 0] if b.interpolation == "lagrange" else np.array([], int))
        last = first + b.n_nodes - 1
        beams.append({"name": b.name, "first": first, "count": b.n_nodes, "element_ends": [*map(int, ends), last],
                      "s": [float(s) for s in b.node_s], "length": float(b.length)})
    return {"beams": beams,
            "bodies": [{"name": p.name, "node": nodes.first[id(p)]} for p in scene.bodies],
            "masses": [{"name": p.name, "node": nodes.first[id(p)]} for p in scene.masses],
            "sliders": [s.name for s in scene.sliders], "points": []}
