"""Rigid sets and ball trees as linear maps between nodes, and what they refuse."""
from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from fastbeam.compile.compile import compile_scene
from fastbeam.interface.errors import SceneError
from fastbeam.model.connections import ARM, HOLD_POSITION, HOLD_TRIAD, POSITION, TRIAD, Connections, connect
from fastbeam.model.workspace import contact_of
from fastbeam.scene import BallJoint, Beam, Clamp, Pin, PointMass, RigidBody, RigidConnection, Scene, Section, Slider

sys.path.insert(0, str(Path(__file__).parents[1]))
from naive import Twin, cay  # noqa: E402

Array = np.ndarray
CLAMPED, PINNED, INERT = 63, 7, 56
BODY, NODE, ARM_POINT, MASS = 2, 3, 4, 9  # ranks
SECTION = Section(EA=200.0, GA2=150.0, GA3=130.0, GJ=50.0, EI2=60.0, EI3=70.0, rhoA=1.0, rhoI2=0.1, rhoI3=0.2)


class Nodes:
    """Nodes 0 .. n-1 at random places with random triads."""

    def __init__(self, *ranks: int, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        n = len(ranks)
        self.phi = rng.standard_normal((n, 3))
        self.directors = np.array([cay(t) for t in rng.standard_normal((n, 3))])
        self.rank = np.array(ranks)
        self.held = np.where(self.rank == MASS, INERT, 0)

    def connect(self, rigid: list[tuple[int, int]] = (), balls: list[tuple[int, int]] = ()) -> Connections:
        """All connections; ball joints first move their second side onto the first."""
        return connect(self.phi, self.directors, [(a, b, f"weld {a}-{b}") for a, b in rigid],
                       [(a, b, f"ball {a}-{b}") for a, b in balls], self.held, self.rank,
                       [f"node {k}" for k in range(len(self.phi))], 1e-14)

    def follow(self, out: Connections, phi: Array, directors: Array) -> tuple[Array, Array]:
        """Positions and triads of all nodes when the free ones have these."""
        p, d = phi.copy(), directors.copy()
        for k, entries in out.entries.items():
            for kind, target, _, turn in entries:
                if kind == TRIAD and target != k:
                    d[k] = turn @ directors[target]
        for k, entries in out.entries.items():
            p[k] = sum((phi[target] if kind == POSITION else c @ d[target]) for kind, target, c, _ in entries if kind != TRIAD)
        return p, d

    def moved(self, out: Connections, seed: int = 1) -> tuple[Array, Array]:
        """A random configuration that the connections allow."""
        rng = np.random.default_rng(seed)
        turn = np.array([cay(t) for t in rng.standard_normal((len(self.phi), 3))])
        turn[self.rank == MASS] = np.eye(3)
        return self.follow(out, rng.standard_normal(self.phi.shape), np.einsum("nij,nkj->nki", turn, self.directors))

    def relative(self, p: Array, d: Array, a: int, b: int) -> Array:
        """Position and triad of b as seen from a."""
        return np.concatenate(((d[a] @ (p[b] - p[a]))[None], d[b] @ d[a].T))


def held_of(out: Connections) -> dict[int, int]:
    return {int(k): int(out.held[k]) for k in np.flatnonzero(out.held)}


# ------------------------------------------------------------------------------------------------------------ rigid sets
def test_nothing_connected_ties_nothing() -> None:
    nodes = Nodes(NODE, NODE, MASS)
    out = nodes.connect()
    assert out.entries == {}
    assert held_of(out) == {2: INERT}
    assert out.targets(1) == [1]
    assert np.array_equal(out.spin_root, [0, 1, 2])


def test_a_rigid_set_keeps_its_shape() -> None:
    nodes = Nodes(NODE, NODE, NODE, NODE, NODE)
    out = nodes.connect(rigid=[(3, 1), (1, 4)])
    assert sorted(out.entries) == [3, 4]
    assert out.targets(3) == out.targets(4) == [1]
    assert np.array_equal(out.spin_root, [0, 1, 2, 1, 1])
    assert held_of(out) == {3: HOLD_POSITION | HOLD_TRIAD, 4: HOLD_POSITION | HOLD_TRIAD}
    p, d = nodes.moved(out)
    for a, b in ((3, 1), (1, 4), (3, 4)):
        before, after = nodes.relative(nodes.phi, nodes.directors, a, b), nodes.relative(p, d, a, b)
        np.testing.assert_allclose(after, before, rtol=0, atol=1e-14)
    # and the map reproduces the reference
    p, d = nodes.follow(out, nodes.phi, nodes.directors)
    np.testing.assert_allclose(p, nodes.phi, rtol=0, atol=1e-14)
    np.testing.assert_allclose(d, nodes.directors, rtol=0, atol=1e-14)


@pytest.mark.parametrize(("ranks", "root"), [((NODE, BODY, NODE), 1), ((ARM_POINT, NODE, BODY), 2), ((NODE, NODE, NODE), 0),
                                             ((MASS, ARM_POINT, NODE), 2)])
def test_the_root_is_a_body_before_a_beam_node(ranks: tuple[int, ...], root: int) -> None:
    nodes = Nodes(*ranks)
    out = nodes.connect(rigid=[(0, 1), (1, 2)])
    assert sorted(out.entries) == [k for k in range(3) if k != root]
    assert all(out.targets(k) == sorted({root, k} if ranks[k] == MASS else {root}) for k in out.entries)


@pytest.mark.parametrize(("mask", "freedom"), [(CLAMPED, "clamped"), (PINNED, "pinned")])
def test_a_held_node_becomes_the_root(mask: int, freedom: str) -> None:
    nodes = Nodes(BODY, NODE, NODE)
    nodes.held[2] = mask
    out = nodes.connect(rigid=[(0, 1), (1, 2)])
    assert sorted(out.entries) == [0, 1], freedom
    assert held_of(out) == {0: CLAMPED, 1: CLAMPED, 2: mask}
    assert np.array_equal(out.spin_root, [2, 2, 2])


def test_a_clamp_goes_before_a_pin() -> None:
    nodes = Nodes(NODE, NODE, NODE)
    nodes.held[:] = PINNED, CLAMPED, CLAMPED
    out = nodes.connect(rigid=[(0, 1), (1, 2)])
    # two clamps and a pin on one rigid set: the first clamp holds it, the others ride along
    assert sorted(out.entries) == [0, 2]
    assert out.held[1] == CLAMPED


def test_pins_at_the_same_point_hold_their_set_once() -> None:
    nodes = Nodes(NODE, NODE)
    nodes.phi[1] = nodes.phi[0]
    nodes.held[:] = PINNED
    out = nodes.connect(rigid=[(0, 1)])
    assert held_of(out) == {0: PINNED, 1: CLAMPED}
    assert [entry[0] for entry in out.entries[1]] == [POSITION, TRIAD]  # no arm of round-off length


def test_a_mass_in_a_rigid_set_follows_on_an_arm_with_its_own_triad() -> None:
    nodes = Nodes(NODE, MASS)
    out = nodes.connect(rigid=[(1, 0)])
    assert [entry[:2] for entry in out.entries[1]] == [(POSITION, 0), (ARM, 0), (TRIAD, 1)]
    assert held_of(out) == {1: CLAMPED}
    assert out.spin_root[1] == 1
    p, d = nodes.moved(out)
    np.testing.assert_allclose(d[0] @ (p[1] - p[0]), nodes.directors[0] @ (nodes.phi[1] - nodes.phi[0]), rtol=0, atol=1e-14)


# ------------------------------------------------------------------------------------------------------------ ball trees
def test_a_ball_joint_keeps_points_together_and_frees_rotation() -> None:
    nodes = Nodes(NODE, NODE)
    nodes.phi[1] = nodes.phi[0]
    out = nodes.connect(balls=[(1, 0)])
    assert [entry[:2] for entry in out.entries[1]] == [(POSITION, 0), (TRIAD, 1)]
    assert held_of(out) == {1: HOLD_POSITION}
    assert np.array_equal(out.spin_root, [0, 1])


def pendulum(n: int) -> tuple[Nodes, list[tuple[int, int]], list[tuple[int, int]]]:
    """n bodies in a row, each with an arm point at both ends; neighbours share a ball joint."""
    nodes = Nodes(*([BODY] * n), *([ARM_POINT] * 2 * n))
    left, right = n + np.arange(n), 2 * n + np.arange(n)
    nodes.phi[left[1:]] = nodes.phi[right[:-1]]
    balls = [(int(right[k]), int(left[k + 1])) for k in range(n - 1)]
    return nodes, [(k, int(x[k])) for k in range(n) for x in (left, right)], balls


def test_a_chain_of_ball_joints_hangs_on_one_position() -> None:
    nodes, rigid, balls = pendulum(4)
    out = nodes.connect(rigid, balls)
    # bodies 1 .. 3 have lost their position, not their triad
    assert [int(out.held[k]) for k in range(4)] == [0, HOLD_POSITION, HOLD_POSITION, HOLD_POSITION]
    assert np.array_equal(out.spin_root[:4], np.arange(4))
    assert {entry[1] for k in out.entries for entry in out.entries[k] if entry[0] == POSITION} == {0}
    assert out.targets(3) == [0, 1, 2, 3]
    p, d = nodes.moved(out)
    for a, b in balls:
        np.testing.assert_allclose(p[a], p[b], rtol=0, atol=1e-14)
    for a, b in rigid:
        before = nodes.relative(nodes.phi, nodes.directors, a, b)
        np.testing.assert_allclose(nodes.relative(p, d, a, b), before, rtol=0, atol=1e-13)


def test_a_held_set_carries_the_tree() -> None:
    nodes, rigid, balls = pendulum(3)
    nodes.held[2] = CLAMPED
    out = nodes.connect(rigid, balls)
    assert 2 not in out.entries
    assert {entry[1] for k in out.entries for entry in out.entries[k] if entry[0] == POSITION} == {2}
    p, _ = nodes.moved(out)
    for a, b in balls:
        np.testing.assert_allclose(p[a], p[b], rtol=0, atol=1e-14)


def test_a_ball_joint_that_branches() -> None:
    # three beams and a mass in one point
    nodes = Nodes(NODE, NODE, NODE, MASS)
    nodes.phi[:] = nodes.phi[0]
    out = nodes.connect(balls=[(2, 0), (1, 2), (3, 2)])
    assert sorted(out.entries) == [1, 2, 3]
    assert all(out.targets(k) == sorted({0, k}) for k in (1, 2, 3))
    assert held_of(out) == {1: HOLD_POSITION, 2: HOLD_POSITION, 3: CLAMPED}


# -------------------------------------------------------------------------------------------------------------- refusals
def test_rigidly_connected_masses_are_refused() -> None:
    with pytest.raises(SceneError, match="rigid connection of node 0 and node 1: point masses have no rotation; use a RigidBody"):
        Nodes(MASS, MASS).connect(rigid=[(0, 1)])


def test_two_pins_on_one_rigid_set_are_refused() -> None:
    nodes = Nodes(NODE, NODE)
    nodes.held[:] = PINNED
    with pytest.raises(SceneError, match="pin of node 1: a rigid connection joins it to node 0 at a distance"):
        nodes.connect(rigid=[(0, 1)])


@pytest.mark.parametrize(("joints", "why"), [
    ({"rigid": [(0, 1)], "balls": [(0, 1)]}, "rigid connections join both of its sides already, so the joint has no effect; rem"),
    ({"balls": [(0, 1), (1, 0)]}, "it joins the same rigid parts at the same point as ball 0-1, so it has no effect")],
    ids=["weld and ball", "twice"])
def test_joints_that_do_nothing_are_refused(joints: dict, why: str) -> None:
    last = joints["balls"][-1]
    with pytest.raises(SceneError, match=f"ball {last[0]}-{last[1]}: {why}"):
        Nodes(NODE, NODE, NODE, NODE).connect(**joints)


@pytest.mark.parametrize(("joints", "loops"), [
    ({"balls": [(0, 1), (1, 2), (2, 0)]}, [2]), ({"rigid": [(0, 1), (2, 3)], "balls": [(0, 2), (1, 3)]}, [1]),
    ({"balls": [(0, 1), (1, 2)]}, [])], ids=["triangle", "hinge", "chain"])
def test_joints_that_close_loops_are_left_to_multipliers(joints: dict, loops: list[int]) -> None:
    out = Nodes(NODE, NODE, NODE, NODE).connect(**joints)
    assert out.loops.tolist() == loops


@pytest.mark.parametrize("mask", [PINNED, CLAMPED])
def test_a_joint_between_held_parts_is_refused(mask: int) -> None:
    nodes = Nodes(NODE, NODE, NODE)
    nodes.held[[0, 2]] = mask
    with pytest.raises(SceneError, match=r"ball 1-2: supports fix both sides \(node 1, node 2\), so the joint has no effect; "
                                         r"remove it"):
        nodes.connect(balls=[(0, 1), (1, 2)])


# ---------------------------------------------------------------------------------------------------------------- scenes
def beam(name: str, start: tuple[float, float, float], end: tuple[float, float, float]) -> Beam:
    return Beam.straight(name, start, end, section=SECTION, elements=2, degree=1)


def refusal(*parts: object) -> str:
    with pytest.raises(SceneError) as caught:
        compile_scene(Scene(*parts))
    return str(caught.value)


def test_scenes_name_the_joint_they_refuse() -> None:
    a, b = beam("a", (0, 0, 0), (1, 0, 0)), beam("b", (1, 0, 0), (2, 0, 0))
    text = refusal(a, b, Clamp(a.end), Pin(b.start), BallJoint(a.end, b.start, name="elbow"))
    assert text.startswith("elbow: supports fix both sides (beam 'a' node 2, beam 'b' node 0)")
    text = refusal(a, b, RigidConnection(a.end, b.start), BallJoint(a.end, b.start, name="elbow"))
    assert text.startswith("elbow: rigid connections join both of its sides already, so the joint has no effect")
    m, n = PointMass("m", mass=1.0, position=(0, 0, 0)), PointMass("n", mass=1.0, position=(1, 0, 0))
    assert "point mass 'm' and point mass 'n': point masses have no rotation" in refusal(m, n, RigidConnection(m, n))


def test_a_linkage_between_two_supports_has_one_joint_with_multipliers() -> None:
    # a four-bar: the last joint leaves one motion of three
    links = [RigidBody(name, mass=1.0, inertia=(1, 1, 1), position=at) for name, at in
             (("a", (0, 0.5, 0)), ("b", (0.5, 1, 0)), ("c", (1, 0.5, 0)))]
    left, right = (PointMass(name, mass=1.0, position=(x, 0, 0)) for name, x in (("left", 0), ("right", 1)))
    a, b, c = links
    model = compile_scene(Scene(*links, left, right, Pin(left), Pin(right), BallJoint(left, a.point((0, -0.5, 0))),
                                BallJoint(a.point((0, 0.5, 0)), b.point((-0.5, 0, 0))),
                                BallJoint(b.point((0.5, 0, 0)), c.point((0, 0.5, 0))),
                                BallJoint(c.point((0, -0.5, 0)), right, name="last")))
    assert [link.name for link in model.kept] == ["ball joint 'last'"]


def test_a_beam_may_close_a_loop_of_joints() -> None:
    a = beam("a", (0, 0, 0), (1, 0, 0))
    body = RigidBody("body", mass=1.0, inertia=(1, 1, 1), position=(1, 0, 0))
    model = compile_scene(Scene(a, body, BallJoint(a.start, body.point((-1, 0, 0))), BallJoint(a.end, body)), planar=False)
    # 4 own and 1 arm node, less the arm (6) and the positions of both ends
    assert model.n_unknowns == 6 * 5 - 6 - 6


def test_a_clamped_point_clamps_its_whole_body() -> None:
    a = beam("a", (0, 0, 0), (1, 0, 0))
    body = RigidBody("body", mass=1.0, inertia=(1, 1, 1), position=(2, 0, 0))
    model = compile_scene(Scene(a, body, RigidConnection(a.end, body), Clamp(body.point((0, 1, 0)))), planar=False)
    held = np.zeros(model.n_nodes, int)
    held[np.argsort(model.pattern.row_of)[model.held.row]] = model.held.mask
    node = model.names["bodies"][0]["node"]
    assert held.tolist() == [0, 0, CLAMPED, CLAMPED]
    assert model.spin_root[2] == node
    assert model.n_unknowns == 12


@pytest.mark.parametrize("kind", ["rigid", "ball", "mixed"])
def test_compiled_ties_are_those_of_the_geometry(kind: str) -> None:
    a, b = beam("a", (0, 0, 0), (1, 0, 0)), beam("b", (1, 0, 0), (2, 1, 0.5))
    body = RigidBody("body", mass=1.0, inertia=(1, 1, 1), position=(2, 1, 1), directors=cay(np.array([0.3, -0.2, 0.5])).T)
    mass = PointMass("m", mass=1.0)
    arm = body.directors @ (np.array([2, 1, 0.5]) - body.position)
    parts = {"rigid": [RigidConnection(a.end, b.start), RigidConnection(b.end, body)],
             "ball": [BallJoint(a.end, b.start), BallJoint(b.end, body.point(arm)), BallJoint(body.point((0.1, 0.2, 0.3)), mass)],
             "mixed": [BallJoint(a.end, b.start), RigidConnection(body, b.end), BallJoint(mass, b.end)]}[kind]
    scene = Scene(a, b, body, *([mass] if kind != "rigid" else []), *parts)
    model = compile_scene(scene)
    # the twin solves its map from the equations of the joints, and tests that there are as many as dependent coordinates
    twin = Twin(scene, model)
    t = model.ties
    found = np.eye(4 * model.n_nodes)
    for k in t.slave:
        found[4 * k:4 * k + 4] = 0.0
        for e in range(t.start[k], t.start[k + 1]):
            at = 4 * t.target[e]
            if t.kind[e] == POSITION:
                found[4 * k, at] += 1.0
            elif t.kind[e] == ARM:
                found[4 * k, at + 1:at + 4] += t.offset[3 * e:3 * e + 3]
            else:
                found[4 * k + 1:4 * k + 4, at + 1:at + 4] = t.rotation[9 * e:9 * e + 9].reshape(3, 3)
    np.testing.assert_allclose(found, twin.tie, rtol=0, atol=1e-12)
    assert np.array_equal(twin.free.sum(), model.n_unknowns)


@pytest.mark.parametrize("bodies", [2, 12])
def test_a_contact_has_room_for_a_point_on_many_arms(bodies: int) -> None:
    chain = [RigidBody(f"x{k}", mass=1.0, inertia=(1, 1, 1), position=(k, 0, 0)) for k in range(bodies)]
    joints = [BallJoint(chain[k].point((0.5, 0, 0)), chain[k + 1].point((-0.5, 0, 0))) for k in range(bodies - 1)]
    tip = chain[-1].point((0.3, 0, 0))
    rail = Beam.straight("rail", (bodies - 0.7, 0, 0), (bodies - 0.7, 2, 0), section=SECTION, elements=1, degree=1)
    model = compile_scene(Scene(*chain, *joints, rail, Slider("s", tip, rail, at=0.0)))
    point = int(model.sliders.point[0])
    arms = int(model.ties.start[point + 1] - model.ties.start[point])
    assert arms == bodies + 2  # position, an arm on every body, triad
    # two nodes of the rail, position and arms of the point
    assert contact_of(model).row.shape[1] >= 2 + (arms - 1)
