"""joint_order.py: joints are independent of what was eliminated before them, chains and trees get no fill, and runs are the same
as with joints that wait for both ends."""
from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.linalg.joint_ordering import Joint, _Search, by_dissection, least_degree, places_of
from fastbeam.linalg.mkl import load_mkl
from fastbeam.linalg.pattern import elimination_cost
from fastbeam.stepping import constraint_rows as constraints
from fastbeam.stepping.stepper import Stepper

NONE = np.zeros((0, 2), np.int64)


def order_of(n: int, ends: list[tuple[int, ...]], coupled: np.ndarray = NONE) -> list[int] | None:
    """Rows in their order, joints behind the n nodes; an end below n is a node, one of n or more the ground."""
    joints = [Joint([k], tuple(a for a in x if a < n), ()) for k, x in enumerate(ends)]
    places = places_of(n, coupled, joints, np.zeros(n, bool), False)
    return None if places is None else np.argsort(places).tolist()


def updates(n: int, ends: list[tuple[int, ...]], order: list[int], coupled: np.ndarray = NONE) -> int:
    """What the elimination costs."""
    place = np.argsort(order)
    edges = np.array([(a, n + k) for k, x in enumerate(ends) for a in x if a < n] + [tuple(x) for x in coupled.tolist()])
    cost = elimination_cost(place[edges[:, 0]], place[edges[:, 1]], len(order))
    assert cost is not None
    return cost


def rods(x: np.ndarray, ends: list[tuple[int, int]]) -> np.ndarray:
    """Derivatives of lengths of rods between points x [n, 3] by their places."""
    out = np.zeros((len(ends), x.size))
    for k, (a, b) in enumerate(ends):
        d = (x[b] - x[a]) / np.linalg.norm(x[b] - x[a])
        out[k, 3 * a:3 * a + 3], out[k, 3 * b:3 * b + 3] = -d, d
    return out


without_mkl = pytest.mark.skipif(load_mkl() is None, reason="no MKL")


@pytest.mark.parametrize("dissection", [False, pytest.param(True, marks=without_mkl)])
@pytest.mark.parametrize("seed", range(40))
def test_pivots_of_rods_on_a_lattice_are_never_singular(seed: int, dissection: bool) -> None:
    """Points of a lattice, so that many rods are in line; rods are taken as long as they are independent, and a few points are
    held."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(4, 24))
    cells = np.array(np.unravel_index(rng.choice(64, n, replace=False), (4, 4, 4))).T.astype(float)
    held = rng.random(n) < rng.choice([0.0, 0.1, 0.3])
    ends: list[tuple[int, int]] = []
    free = np.repeat(~held, 3)
    for _ in range(int(rng.choice([1, 3])) * n):
        a, b = (int(i) for i in rng.choice(n, 2, replace=False))
        more = [*ends, (a, b)]
        rank = np.linalg.matrix_rank(rods(cells, more)[:, free], 1e-9)
        if rank == len(more):
            ends = more
    mass = 10.0**rng.uniform(-2, 2, n)
    joints = [Joint([k], tuple(i for i in x if not held[i]), tuple(i for i in x if held[i])) for k, x in enumerate(ends)]
    edges = np.array([(a, n + k) for k, joint in enumerate(joints) for a in (*joint.rows, *joint.held)]).reshape(-1, 2)
    order = by_dissection(n, *edges.T, joints, held) if dissection else least_degree(n, NONE, joints, held)
    assert order is not None and sorted(order) == list(range(n + len(ends)))
    lead = rods(cells, ends) * free
    matrix = np.zeros((3 * n + len(ends),) * 2)
    matrix[:3 * n, :3 * n] = np.diag(np.repeat(mass, 3))
    matrix[3 * n:, :3 * n], matrix[:3 * n, 3 * n:] = lead, lead.T
    for v in order:
        at = np.arange(3 * v, 3 * v + 3) if v < n else np.array([2 * n + v])
        pivot = matrix[np.ix_(at, at)]
        if v >= n:
            # a joint that depends on those before leaves some 1e-16
            assert abs(pivot.item()) > 1e-10 * (lead[v - n]**2 @ np.repeat(1.0 / mass, 3)), v
        matrix -= matrix[:, at] @ np.linalg.solve(pivot, matrix[at])
        matrix[at], matrix[:, at] = 0.0, 0.0


def test_a_chain_is_eliminated_from_its_free_end_without_fill() -> None:
    n = 50
    ends: list[tuple[int, ...]] = [(n, 0), *((k, k + 1) for k in range(n - 1))]
    order = order_of(n, ends)
    assert order is not None
    assert order[:4] == [n - 1, 2 * n - 1, n - 2, 2 * n - 2] and order[-1] == n
    # one later row each: two updates a row
    assert updates(n, ends, order) == 2 * (2 * n - 1)


def test_what_is_done_is_not_looked_at_again() -> None:
    """Components that kept joints which were eliminated made the search of a chain quadratic."""
    joints = [Joint([k], (k, k + 1), ()) for k in range(99)]
    search = _Search(100, NONE, joints, np.zeros(100, bool))
    order = search.run()
    assert order is not None and len(order) == 199
    assert not any(search.left)


def test_a_tree_gets_no_fill() -> None:
    rng = np.random.default_rng(3)
    ends = [(int(rng.integers(k)), k) for k in range(1, 80)]
    order = order_of(80, ends)
    assert order is not None and updates(80, ends, order) == 2 * (2 * 80 - 2)


@without_mkl
def test_large_nets_of_joints_are_dissected(monkeypatch: pytest.MonkeyPatch) -> None:
    """A grid of 50 x 50 nodes, joints along one side and couplings along the other: less fill than by least degree."""
    m = 50
    at = np.arange(m * m).reshape(m, m)
    ends: list[tuple[int, ...]] = [(m * m, *row[:1].tolist()) for row in at]
    ends += [(int(a), int(b)) for a, b in zip(at[:, :-1].ravel(), at[:, 1:].ravel())]
    coupled = np.stack((at[:-1].ravel(), at[1:].ravel()), axis=1)
    best = order_of(m * m, ends, coupled)
    monkeypatch.setenv("FASTBEAM_NO_MKL", "1")
    other = order_of(m * m, ends, coupled)
    assert best is not None and other is not None
    assert updates(m * m, ends, best, coupled) < 0.9 * updates(m * m, ends, other, coupled)


def test_beams_between_two_hubs_stand_alone() -> None:
    """Chains of 5 coupled nodes whose ends are hinged to nodes 0 and 1: no hub is left before the last beam is done."""
    coupled, ends = [], []
    for k in range(30):
        first = 2 + 5 * k
        coupled += [(first + i, first + i + 1) for i in range(4)]
        ends += [(0, first), (first + 4, 1)]
    order = order_of(152, ends, coupled=np.array(coupled))
    assert order is not None
    # in the usual way 60 joints wait for the hubs
    assert updates(152, ends, order, np.array(coupled)) < 6 * len(order)
    assert {0, 1} <= set(order[-4:])


def test_nets_keep_the_usual_order() -> None:
    ends = [(10 * i + j, 10 * i + j + 1) for i in range(10) for j in range(9)]
    ends += [(10 * i + j, 10 * i + j + 10) for i in range(9) for j in range(10)]
    assert order_of(100, ends, coupled=np.array(ends)) is None


def linkage() -> fb.Scene:
    """An arm of three bodies on the ground, a loop of two more, and two beams hinged to the last and to a free body."""
    a, b, c, d, e, hub = (fb.RigidBody(name, mass=m, inertia=(0.1 * m, 0.2 * m, 0.2 * m), position=x)
                          for name, m, x in (("a", 1.0, (0.5, 0, 0)), ("b", 2.0, (1.5, 0, 0)), ("c", 1.0, (2.5, 0, 0)),
                                             ("d", 1.0, (1.5, 0, 1)), ("e", 1.0, (1.0, 0, 0.5)), ("hub", 3.0, (3.5, 0, 0))))
    half = np.array([0.5, 0, 0])
    section = fb.Section.circle(radius=0.01, E=1e8, rho=1000.0)
    beams = [fb.Beam.straight(f"beam {y}", (3, y, 0.0), (3.4, y, 0.0), section=section, elements=2) for y in (-0.2, 0.2)]
    parts = [fb.RevoluteJoint(fb.GROUND, a.point(-half), "foot", axis=(0, 1, 0)),
             fb.RevoluteJoint(a.point(half), b.point(-half), "knee", axis=(0, 0, 1)),
             fb.BallJoint(b.point(half), c.point(-half), "ball"),
             fb.DistanceJoint(b, d, "rod"), fb.DistanceJoint(d, e, "strut"), fb.DistanceJoint(e.point((0, 0.1, 0)), a, "tie")]
    for beam, y in zip(beams, (-0.2, 0.2)):
        parts += [fb.RevoluteJoint(c.point((0.5, y, 0)), beam.start, f"near {y}", axis=(0, 1, 0)),
                  fb.RevoluteJoint(hub.point((-0.1, y, 0)), beam.end, f"far {y}", axis=(0, 1, 0))]
    return fb.Scene(a, b, c, d, e, hub, *beams, *parts, gravity=(0, 0, -9.81))


def rods_in_line() -> fb.Scene:
    """Masses on rods along x, the first one pinned, and a heavy body behind them."""
    masses = [fb.PointMass(f"mass {k}", mass=1.0, position=(0.1 * k, 0, 0)) for k in range(6)]
    body = fb.RigidBody("body", mass=1e6, inertia=(1e4, 1e4, 1e4), position=(0.6, 0, 0))
    chain = [*masses, body]
    return fb.Scene(*chain, *(fb.DistanceJoint(a, b, f"rod {b.name}") for a, b in zip(chain, chain[1:])), fb.Pin(masses[0]),
                    gravity=(0, 0, -9.81))


def mechanism(seed: int) -> fb.Scene:
    """Bodies on a lattice in a tree of joints of all kinds, masses from 1 g to 1 t, with a few rods between them."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(5, 14))
    x = np.array(np.unravel_index(rng.choice(64, n, replace=False), (4, 4, 4))).T.astype(float)
    mass = 10.0**rng.uniform(-3, 3, n)
    bodies = [fb.RigidBody(f"body {k}", mass=m, inertia=(0.1 * m, 0.15 * m, 0.2 * m), position=at)
              for k, (m, at) in enumerate(zip(mass, x))]
    parts: list[object] = [*bodies, fb.DistanceJoint(bodies[0], bodies[-1], "rod")]
    for k in range(1, n):
        j, axis = int(rng.integers(k)), np.eye(3)[rng.integers(3)]
        ends = [bodies[i].point(0.5 * (x[j] + x[k]) - x[i]) for i in (j, k)]
        kind = (fb.RevoluteJoint, fb.PrismaticJoint, fb.UniversalJoint)[k % 3]
        if kind is fb.UniversalJoint:
            parts.append(fb.UniversalJoint(*ends, f"joint {k}", axis_a=axis, axis_b=np.roll(axis, 1)))
        else:
            parts.append(kind(*ends, f"joint {k}", axis=axis))
    if seed % 2:
        parts.append(fb.RevoluteJoint(fb.GROUND, bodies[0].point((0.1, 0.2, 0.3)), "foot", axis=(0, 1, 0)))
    return fb.Scene(*parts, gravity=(0, 0, -9.81))


# in mechanism 9 steps do not converge with joints that wait for both ends
@pytest.mark.parametrize("scene", [linkage, rods_in_line, *(partial(mechanism, seed) for seed in range(9))])
def test_scenes_move_as_with_joints_that_wait_for_both_ends(scene: Callable[[], fb.Scene],
                                                             monkeypatch: pytest.MonkeyPatch) -> None:
    found = []
    for usual in (False, True):
        if usual:
            monkeypatch.setattr(constraints, "places_of", lambda *_: None)
        model = fb.compile_scene(scene())
        stepper = Stepper(model, np.ones(1))
        outcome = stepper.advance(0.0, 2e-3, 30)
        assert outcome.status == 0
        assert stepper.rows is not None and (stepper.rows.couplings.place.size == 0) == usual
        found.append((stepper.state.q.copy(), stepper.state.force.copy(), outcome.iterations))
    (q, force, iterations), (other, other_force, other_iterations) = found
    assert np.abs(q - other).max() < 1e-10
    # free bodies fall without forces: those that are left are round-off of the weight
    assert np.abs(force - other_force).max() < 1e-6 * max(np.abs(force).max(), 1.0)
    assert iterations <= 1.2 * other_iterations + 5


def loaded_arm() -> fb.Scene:
    """An arm whose points have springs, a load and a rod besides their joints."""
    bodies = [fb.RigidBody(f"body {k}", mass=1.0, inertia=(0.1, 0.2, 0.3), position=(k + 0.5, 0, 0)) for k in range(4)]
    half = np.array([0.5, 0, 0])
    far = [body.point(half) for body in bodies]
    near = [body.point(-half) for body in bodies]
    side = bodies[3].point((0, 0.3, 0))
    return fb.Scene(*bodies, fb.RevoluteJoint(fb.GROUND, near[0], "foot", axis=(0, 1, 0), stiffness=5.0),
                    fb.RevoluteJoint(far[0], near[1], "knee", axis=(0, 0, 1)),
                    fb.PrismaticJoint(far[1], near[2], "rail", axis=(1, 0, 0), stiffness=300.0),
                    fb.UniversalJoint(far[2], near[3], "cross", axis_a=(0, 1, 0), axis_b=(0, 0, 1)),
                    fb.DistanceJoint(far[0], near[2], "rod"),
                    fb.Spring(far[3], bodies[0], "spring", stiffness=40.0), fb.Load("push", far[3], force=(1.0, 2.0, 0.5)),
                    fb.Spring(side, far[1], "other spring", stiffness=10.0), gravity=(0, 0, -9.81))


@pytest.mark.parametrize(("scene", "method"), [
    (linkage, "energy_momentum"), (loaded_arm, "energy_momentum"), (partial(mechanism, 1), "energy_momentum"),
    (partial(mechanism, 4), "energy_momentum"), (linkage, "generalized_alpha"), (partial(mechanism, 3), "generalized_alpha")])
def test_points_of_joints_need_no_rows(scene: Callable[[], fb.Scene], method: str) -> None:
    """As with rows and blocks of their own, which a solver sees that eliminates no nodes."""
    observe = ["reaction"] if method == "energy_momentum" else []
    models = [fb.compile_scene(scene(), planar=False, **options) for options in ({}, {"eliminate_inner": False})]
    assert models[0].pattern.n < models[1].pattern.n and models[0].n_blocks < models[1].n_blocks
    one, other = (fb.simulate(model, t_end=0.05, step=2e-3, method=method, observe=observe) for model in models)
    assert np.abs(one.state.q - other.state.q).max() < 1e-10
    for name in models[0].reaction_names if observe else ():
        for a, b in zip(one.reaction(name).values(), other.reaction(name).values()):
            assert np.allclose(a, b, rtol=0.0, atol=1e-7 * max(np.nanmax(np.abs(b)), 1.0), equal_nan=True), name


def test_a_net_of_many_joints_has_room_for_its_products_and_no_dense_border() -> None:
    """Room grew with everything else before: 680 MB for 760 joints; 1740 were a dense border of gigabytes."""
    n = 30
    masses = [fb.PointMass(f"{i} {j}", mass=0.1, position=(0.1 * i, 0.1 * j, 0.02 * np.sin(0.7 * i + j)))
              for i in range(n) for j in range(n)]
    ends = [(n * i + j, n * i + j + 1) for i in range(n) for j in range(n - 1)]
    ends += [(n * i + j, n * i + j + n) for i in range(n - 1) for j in range(n)]
    rods = [fb.DistanceJoint(masses[a], masses[b], f"rod {a} {b}") for a, b in ends]
    model = fb.compile_scene(fb.Scene(*masses, *rods, fb.Pin(masses[0]), gravity=(0, 0, -9.81)))
    assert model.by_rows
    stepper = Stepper(model, np.ones(1))
    assert stepper.advance(0.0, 1e-3, 1).status == 0
    assert stepper.rows is not None
    columns = np.diff(stepper.rows.order.start.astype(np.int64))
    assert stepper.rows.order.target.size < 1.3 * np.sum(columns**2)
    assert stepper.rows.factors.store.nbytes < 200e6
