"""Gradients of runs in everything that their steps have an adjoint for: the NumPy twin, scenes in a plane, what dissipates, loads
in time, states that are kept and steps that are taken again; against differences of runs."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parents[1]))
from naive_adjoint import NaiveAdjoint  # noqa: E402
from validation.test_adjoint_run import AWAY, SIXTH, swing  # noqa: E402

Array = np.ndarray
STEPS, STEP = 12, 0.01
NAMES = "tip", "body", "bob", "middle"


def weights(seed: int = 0) -> tuple[dict[str, Array], dict[str, Array]]:
    draw = np.random.default_rng(seed)
    places = {name: draw.standard_normal((STEPS + 1, 3)) for name in NAMES}
    return places, {name: draw.standard_normal((STEPS + 1, 3)) for name in ("tip", "body")}


def of(run: Any, places: dict[str, Array], rates: dict[str, Array]) -> float:
    return sum(float(np.sum(w * run.point(name))) for name, w in places.items()) + sum(
        float(np.sum(w * run.velocity(name))) for name, w in rates.items())


def spread(run: Any, given: dict[str, Array]) -> Array:
    """Weights of points as weights of nodes [n + 1, N, 4, 3]."""
    out = np.zeros((run.t.size, run.model.n_nodes, 4, 3))
    for name, rows in given.items():
        nodes, shares = run._points[name]
        for node, share in zip(nodes, shares):
            out[:, node] += share[:, None] * rows[:, None, :]
    return out


def test_the_twin_in_numpy() -> None:
    scene, points = swing("simo_reissner", False)
    run = fb.adjoint_run(fb.compile_scene(scene), t_end=STEPS * STEP, step=STEP, points=points)
    places, rates = weights()
    by = run.gradient(points=places, velocities=rates)
    naive = NaiveAdjoint(run, spread(run, places), spread(run, rates)).gradient()

    def same(found: Array, expected: Array) -> None:
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.max(np.abs(expected)))

    for part, sections in zip((0, 1), by.sections.values()):
        same(sections.stiffness[0], naive["stiffness"][part])
        same(np.stack((sections.rhoA, sections.rhoI2, sections.rhoI3), 1)[0], naive["inertia"][part])
        assert not sections.viscosity.any()
    for name in ("forces", "moments", "gravity", "velocities", "spins"):
        same(getattr(by, name), naive[name])
    same(np.array(sorted(by.masses.values())), np.sort(naive["bodies"]))
    timed = [k for k, time in enumerate(run.model.load_times) if time is not None]
    same(by.factors["load 'pull'"], naive["factors"][:, timed[0]])
    assert by.factors["load 'pull'"].all()
    # a force on a point is one on its node, step by step
    node = run._points["tip"][0][0]
    same(by.pushes["tip"].sum(axis=0), by.forces[node])
    # states of every fifth step, the others taken again
    again = fb.adjoint_run(run.model, t_end=STEPS * STEP, step=STEP, points=points, keep_every=5)
    np.testing.assert_array_equal(again.point("body"), run.point("body"))
    for found in (again.gradient(points=places, velocities=rates) for _ in range(2)):
        np.testing.assert_array_equal(found.sections["a"].stiffness, by.sections["a"].stiffness)
        np.testing.assert_array_equal(found.forces, by.forces)


def damped(flat: bool, EA: float = 1e4, d: float = 2e-3, pull: float = 3.0, g: float = -9.81, late: float = 0.0,  # noqa: N803
           m: float = 0.7, vz: float = 1.0, side: float = 0.0, bent: float = 0.0) -> Any:
    """What dissipates, in the layout of `swing`; flat: everything in one plane."""
    y = 0.0 if flat else 1.0
    one = fb.Section(EA=EA, GA2=4e3, GA3=5e3, GJ=4.0, EI2=5.0, EI3=6.0, rhoA=1.0, rhoI2=0.02, rhoI3=0.03, damping=d)
    a = fb.Beam.straight("a", (0, 0, 0), (2, 0, 0), section=one, elements=3, degree=2)
    b = fb.Beam.straight("b", (2, 0, 0), (2, 0.8 * y, 0.9), section=one, elements=2, degree=2, prestrain=bent)
    body = fb.RigidBody("body", mass=m, inertia=(0.02, 0.03, 0.04), position=(2.1, 0.8 * y, 1.1))
    bob = fb.PointMass("bob", mass=0.3, position=(1, 0, -1), velocity=(0.1, 0, vz))
    mount = fb.Bushing(fb.GROUND.point((2, 0.8 * y, 1)), body.point((-0.1, 0, -0.1)), stiffness=(40, 30, 20, 0.5, 0.4, 0.3),
                       damping=(0.6, 0.5, 0.4, 0.02, 0.02, 0.03))
    scene = fb.Scene(a, b, body, bob, fb.Clamp(a.start), fb.RigidConnection(a.end, b.start),
                     fb.BallJoint(b.end, body.point((-0.1, 0, -0.2))), mount,
                     fb.Spring(bob, a.end, stiffness=30.0, length=1.1, damping=0.3), fb.Damper(bob, b.end, damping=0.6),
                     fb.Drag("air", b, normal=0.8, tangential=0.3, linear=0.2), gravity=(0, 0, g),
                     gravity_time=lambda t: 1 + 2 * t).add(
        fb.Load("pull", b.end, force=(pull, 0.5 * y * pull, 0.5 * pull), time=lambda t: 1 + t + late * t * t))
    if side:
        scene.add(fb.Load("side", b.end, force=(0, side, 0)))
    return scene, {"tip": b.end, "body": body.point((0.2, 0, 0.3)), "bob": bob, "middle": (a, 1.03)}


def run_damped(flat: bool, values: dict[str, float], **options: Any) -> Any:
    scene, points = damped(flat, **values)
    return fb.adjoint_run(fb.compile_scene(scene, **options), t_end=STEPS * STEP, step=STEP, points=points)


@pytest.mark.parametrize("flat", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_what_dissipates_and_what_changes_in_time(flat: bool) -> None:
    places, rates = weights(1)
    if flat:
        for rows in (*places.values(), *rates.values()):
            rows[:, 1] = 0.0
    values = dict(EA=1e4, d=2e-3, pull=3.0, g=-9.81, late=0.0, m=0.7, vz=1.0, bent=1e-3)
    run = run_damped(flat, values)
    assert (run._stepper.plane is not None) == flat
    by = run.gradient(points=places, velocities=rates)
    C = np.diag([1e4, 4e3, 5e3, 4.0, 5.0, 6.0])  # noqa: N806
    axial, start = np.diag([1.0, 0, 0, 0, 0, 0]), run.t[:-1]
    squares = ((start + STEP)**3 - start**3) / (3 * STEP)
    bob = next(entry["node"] for entry in run.model.names["masses"])
    found = {"EA": sum(float(x.by(axial, viscosity=values["d"] * axial)[0]) for x in by.sections.values()),
             "d": sum(float(x.by(0.0, viscosity=C)[0]) for x in by.sections.values()),
             "pull": float((1 + start + 0.5 * STEP) @ by.factors["load 'pull'"]) / values["pull"],
             "g": by.gravity[2], "late": float(squares @ by.factors["load 'pull'"]), "m": by.masses["body"],
             "vz": by.velocities[bob, 2], "bent": by.sections["b"].prestrain[0, 0]}
    assert found.keys() == values.keys()
    for name, value in values.items():
        e = 2e-3 * (value or 1.0)
        around = [of(run_damped(flat, {**values, name: value + k * e}), places, rates) for k in AWAY]
        exact = float(SIXTH @ np.array(around)) / e
        assert found[name] == pytest.approx(exact, rel=1e-7), name
    assert by.gravity @ (0, 0, -9.81) == pytest.approx(float((1 + 2 * start + STEP) @ by.factors["gravity"]), rel=1e-12)


@pytest.mark.slow
def test_a_scene_in_its_plane_and_in_space() -> None:
    """The same numbers; what points out of the plane is asked of the scene in space."""
    places, rates = weights(2)
    flat, whole = (run_damped(True, {}, planar=planar) for planar in ("auto", False))
    within = {name: rows * (1, 0, 1) for name, rows in places.items()}
    one, other = (x.gradient(points=within, velocities={"body": rates["body"] * (1, 0, 1)}) for x in (flat, whole))

    def same(x: Array, y: Array) -> None:
        np.testing.assert_allclose(x, y, rtol=0, atol=1e-8 * np.max(np.abs(y)))

    for name, sections in one.sections.items():
        same(sections.stiffness, other.sections[name].stiffness)
        same(sections.viscosity, other.sections[name].viscosity)
        same(sections.prestrain, other.sections[name].prestrain)
        same(np.array([sections.rhoA, sections.rhoI2, sections.rhoI3]), np.array(
            [getattr(other.sections[name], x) for x in ("rhoA", "rhoI2", "rhoI3")]))
    for name in ("forces", "moments", "velocities", "spins", "positions", "turns", "gravity"):
        same(getattr(one, name), getattr(other, name))
    for name in places:
        same(one.pushes[name], other.pushes[name])
    assert one.masses["bob"] == pytest.approx(other.masses["bob"], rel=1e-8)
    out = flat.gradient(points=places)
    e, node = 1e-3, flat._points["tip"][0][0]
    exact = float(SIXTH @ np.array([of(run_damped(True, {"side": k * e}), places, {}) for k in AWAY])) / e
    assert out.forces[node, 1] == pytest.approx(exact, rel=1e-7)


def held(EA: float = 1e4, m: float = 0.5, pull: float = 3.0, way: float = 0.0) -> Any:  # noqa: N803
    """A bead on a beam, a loop of rigid parts with a hinge, a rod that keeps its length."""
    one = fb.Section(EA=EA, GA2=4e3, GA3=5e3, GJ=4.0, EI2=5.0, EI3=6.0, rhoA=1.0, rhoI2=0.02, rhoI3=0.03)
    a = fb.Beam.straight("a", (0, 0, 0), (2, 0, 0), section=one, elements=4, degree=2)
    bead = fb.PointMass("bead", mass=m)
    body = fb.RigidBody("body", mass=0.7, inertia=(0.02, 0.03, 0.04), position=(2, 1.2, 0.3))
    arm = fb.RigidBody("arm", mass=0.4, inertia=(0.02, 0.03, 0.04), position=(2, 2.0, 0.3))
    scene = fb.Scene(a, bead, body, arm, fb.Clamp(a.start), fb.Slider("ring", bead, a, at=0.6, rate=1.0),
                     fb.BallJoint(a.end, body.point((0, -1.2, -0.3))),
                     fb.RevoluteJoint(body.point((0, 0.4, 0)), arm.point((0, -0.4, 0)), axis=(0, 0.6, 0.8)),
                     fb.DistanceJoint(fb.GROUND.point((2, 2, 2)), arm.point((0, 0.1, 0)))).add(
        fb.Load("pull", a.end, force=(0, pull, 0.5 * pull), time=lambda t: 1 + t), fb.Load("way", bead, force=(0, way, 0)))
    return scene, {"tip": a.end, "body": body.point((0.1, 0, 0)), "bob": bead, "middle": arm}


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["auto", "sparse"])
def test_a_slider_and_joints_with_multipliers(solver: str) -> None:
    places, rates = weights(3)

    def go(**values: float) -> Any:
        scene, points = held(**values)
        return fb.adjoint_run(fb.compile_scene(scene), t_end=STEPS * STEP, step=STEP, points=points)

    run = go()
    if solver == "sparse":
        # the same equations as one sparse matrix
        known = run.model.uneliminated
        object.__setattr__(run.model, "uneliminated", lambda planar, solver: known(planar=planar))
    by = run.gradient(points=places, velocities=rates)
    assert run.outside == 0
    node = run._points["bob"][0][0]
    found = {"EA": by.sections["a"].stiffness[0, 0, 0], "m": by.masses["bead"], "way": by.forces[node, 1],
             "pull": float((1 + run.t[:-1] + 0.5 * STEP) @ by.factors["load 'pull'"]) / 3.0}
    # velocities of rigid loops have more round-off
    for name, value in dict(EA=1e4, m=0.5, pull=3.0, way=0.0).items():
        e = {"m": 0.06, "pull": 0.02}.get(name, 0.01) * (value or 1.0)
        around = [of(go(**{name: value + k * e}), places, rates) for k in AWAY]
        assert found[name] == pytest.approx(float(SIXTH @ np.array(around)) / e, rel=1e-7), name


@pytest.mark.slow
@pytest.mark.parametrize("planar", ["auto", False])
def test_a_loop_of_redundant_hinges(planar: Any) -> None:
    """Four bars: in space three of the conditions of its hinges follow from others."""
    def go(m: float = 0.7, F: float = 1.0) -> Any:  # noqa: N803
        inertia, y = (0.02, 0.03, 0.04), (0, 1, 0)
        a = fb.RigidBody("a", mass=m, inertia=inertia, position=(0, 0, 0.5))
        b = fb.RigidBody("b", mass=0.5, inertia=inertia, position=(0.75, 0, 1.1))
        c = fb.RigidBody("c", mass=0.6, inertia=inertia, position=(1.5, 0, 0.6))
        scene = fb.Scene(a, b, c, fb.RevoluteJoint(fb.GROUND, a.point((0, 0, -0.5)), axis=y),
                         fb.RevoluteJoint(a.point((0, 0, 0.5)), b.point((-0.75, 0, -0.1)), axis=y),
                         fb.RevoluteJoint(b.point((0.75, 0, 0.1)), c.point((0, 0, 0.6)), axis=y),
                         fb.RevoluteJoint(fb.GROUND, c.point((0, 0, -0.6)), axis=y), fb.Load("push", b, force=(F, 0, 0)),
                         gravity=(0, 0, -9.81))
        return fb.adjoint_run(fb.compile_scene(scene, planar=planar), t_end=0.2, step=0.01, points={"b": b, "c": c})

    run, places = go(), {"b": np.array([1, 0, 0.5]), "c": np.array([0, 0, 1.0])}
    by = run.gradient(points=places)
    assert run.outside == 0 and (run._stepper.plane is None) == (planar is False)
    for name, found, value in (("m", by.masses["a"], 0.7), ("F", by.forces[run._points["b"][0][0], 0], 1.0)):
        e = 0.02 * value
        around = [sum(x.point(p)[-1] @ w for p, w in places.items()) for x in (go(**{name: value + k * e}) for k in AWAY)]
        assert found == pytest.approx(float(SIXTH @ np.array(around)) / e, rel=1e-8), name
