"""Ball joints that close loops of rigid parts: linkages, hinges, redundant joints, rings; conservation and exact motions."""
from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fastbeam as fb

Array = np.ndarray


def body(name: str, position: tuple[float, float, float], mass: float = 1.0) -> fb.RigidBody:
    return fb.RigidBody(name, mass=mass, inertia=(0.02 * mass, 0.03 * mass, 0.04 * mass), position=position)


def ground(name: str, position: tuple[float, float, float]) -> fb.RigidBody:
    return fb.RigidBody(name, mass=1.0, inertia=(1, 1, 1), position=position)


def hinge(a: fb.RigidBody, b: fb.RigidBody, at: tuple[float, float, float],
          axis: tuple[float, float, float]) -> list[fb.BallJoint]:
    """Two ball joints on a line."""
    out = []
    for side in (-0.1, 0.1):
        place = np.array(at) + side * np.array(axis)
        out.append(fb.BallJoint(a.point(place - a.position), b.point(place - b.position)))
    return out


def gaps(model: fb.Model, q: Array) -> float:
    x = q.reshape(-1, 4, 3)[:, 0]
    return max(float(np.linalg.norm(x[b] - x[a])) for a, b in (link.node for link in model.kept))


# ----------------------------------------------------------------------------------------------------------------- hinges
def test_a_body_on_a_hinge_of_two_ball_joints_swings_as_it_should() -> None:
    stand, arm = ground("stand", (0, 0, 0)), body("arm", (0.5, 0, 0))
    scene = fb.Scene(stand, arm, fb.Clamp(stand), *hinge(stand, arm, (0, 0, 0), (0, 1, 0)), gravity=(0, 0, -9.81))
    model = fb.compile_scene(scene, planar=False)
    assert len(model.kept) == 1
    inertia = 0.03 + 0.25
    fall = solve_ivp(lambda t, y: [y[1], 9.81 * 0.5 * np.cos(y[0]) / inertia], (0.0, 1.0), [0, 0], rtol=1e-11, atol=1e-12)
    exact = fall.y[0, -1]
    runs = [fb.simulate(model, t_end=1.0, step=step, order=4, progress=False) for step in (0.02, 0.01)]
    errors = [float(np.linalg.norm(run.state.q.reshape(-1, 4, 3)[1, 0] - 0.5 * np.array([np.cos(exact), 0, -np.sin(exact)])))
              for run in runs]
    assert errors[1] < 1e-5 and np.log2(errors[0] / errors[1]) > 3.5
    for run in runs:
        assert run.info["fallbacks"] == 0
        assert np.ptp(run.series["total"]) < 1e-12
        assert gaps(model, run.state.q) < 1e-13


def four_bar(hinged: bool) -> fb.Scene:
    """A parallel crank of three bodies; every joint a hinge: 3 constraints too many in space."""
    left, right = ground("left", (0, 0, 0)), ground("right", (1, 0, 0))
    a, b, c = body("a", (0, 0.5, 0)), body("b", (0.5, 1, 0)), body("c", (1, 0.5, 0))
    joints = []
    for one, other, at in ((left, a, (0, 0, 0)), (a, b, (0, 1, 0)), (b, c, (1, 1, 0)), (c, right, (1, 0, 0))):
        joints += hinge(one, other, at, (0, 0, 1)) if hinged else [fb.BallJoint(one.point(np.array(at) - one.position),
                                                                                other.point(np.array(at) - other.position))]
    return fb.Scene(left, right, a, b, c, fb.Clamp(left), fb.Clamp(right), *joints, fb.Load("push", b, force=(3, 0, 0)),
                    gravity=(0, -9.81, 0))


def parallel_crank(t: float) -> float:
    """Angle of the cranks: both turn about their lower ends, the coupler moves on a circle."""
    inertia = 2.0 * (0.04 + 0.25) + 1.0
    return float(solve_ivp(lambda _, y: [y[1], (3.0 * np.cos(y[0]) + 2.0 * 9.81 * np.sin(y[0])) / inertia], (0.0, t), [0, 0],
                           rtol=1e-11, atol=1e-12).y[0, -1])


@pytest.mark.parametrize(("planar", "hinged"), [(True, False), (False, True)], ids=["plane", "space, redundant"])
def test_four_bar(planar: bool, hinged: bool) -> None:
    model = fb.compile_scene(four_bar(hinged), planar=planar)
    angle = parallel_crank(0.5)
    runs = [fb.simulate(model, t_end=0.5, step=step, order=4, progress=False) for step in (0.02, 0.01)]
    expected = np.array([0.5 + np.sin(angle), np.cos(angle), 0.0])
    at = model.names["bodies"][3]["node"]
    errors = [float(np.linalg.norm(run.state.q.reshape(-1, 4, 3)[at, 0] - expected)) for run in runs]
    assert errors[1] < 1e-6
    for run in runs:
        assert run.info["fallbacks"] == 0
        assert np.ptp(run.series["total"]) < 1e-11
        assert gaps(model, run.state.q) < 1e-13


# ------------------------------------------------------------------------------------------------------------------ rings
@pytest.mark.parametrize("n", [3, 12])
def test_a_ring_of_bodies_keeps_energy_and_momenta(n: int) -> None:
    angle = 2.0 * np.pi * np.arange(n) / n
    places = np.stack((np.cos(angle), np.sin(angle), 0.1 * np.cos(3.0 * angle)), axis=1)
    middle = 0.5 * (places + np.roll(places, -1, axis=0))
    parts: list = [fb.RigidBody(f"b{k}", mass=10.0**(k % 3 - 1), inertia=0.01 * 10.0**(k % 3 - 1) * np.array([1, 1.5, 2]),
                                position=places[k]) for k in range(n)]
    joints = [fb.BallJoint(parts[k].point(middle[k] - places[k]), parts[(k + 1) % n].point(middle[k] - places[(k + 1) % n]))
              for k in range(n)]
    push = fb.Load("push", parts[0], force=(1.0, 2.0, 3.0), time=lambda t: float(t < 0.1))
    model = fb.compile_scene(fb.Scene(*parts, *joints, push))
    assert len(model.kept) == 1
    run = fb.simulate(model, t_end=1.0, step=0.01, observe=("energy", "momentum"), progress=False)
    free = run.t > 0.105
    assert run.info["fallbacks"] == 0
    assert np.max(run.series["kinetic"]) > 1e-3
    assert np.ptp(run.series["total"][free]) < 1e-12 * np.max(run.series["kinetic"])
    for name in ("lin_mom", "ang_mom"):
        x = run.series[name][free]
        assert np.abs(x - x[0]).max() < 1e-12
    assert gaps(model, run.state.q) < 1e-13


def test_a_loop_goes_on_bit_for_bit_and_in_space_as_in_the_plane() -> None:
    model = fb.compile_scene(four_bar(False))
    whole = fb.simulate(model, t_end=0.4, step=0.01, progress=False)
    half = fb.simulate(model, t_end=0.2, step=0.01, progress=False)
    rest = fb.simulate(model, t_end=0.4, step=0.01, start=half.checkpoint, progress=False)
    assert all(np.array_equal(x, y) for x, y in zip(whole.state, rest.state))
    space = fb.simulate(fb.compile_scene(four_bar(False), planar=False), t_end=0.4, step=0.01, progress=False)
    np.testing.assert_allclose(space.state.q, whole.state.q, rtol=0.0, atol=1e-11)


def test_a_linkage_finds_its_equilibrium() -> None:
    # no stiffness at all: 3 N along, 2 x 9.81 N down in the cranks and the coupler
    left, right = ground("left", (0, 0, 0)), ground("right", (1, 0, 0))
    a, b, c = body("a", (0, -0.5, 0)), body("b", (0.5, -1, 0)), body("c", (1, -0.5, 0))
    joints = [fb.BallJoint(left, a.point((0, 0.5, 0))), fb.BallJoint(a.point((0, -0.5, 0)), b.point((-0.5, 0, 0))),
              fb.BallJoint(b.point((0.5, 0, 0)), c.point((0, -0.5, 0))), fb.BallJoint(c.point((0, 0.5, 0)), right)]
    scene = fb.Scene(left, right, a, b, c, fb.Clamp(left), fb.Clamp(right), *joints, fb.Load("push", b, force=(3, 0, 0)),
                     gravity=(0, -9.81, 0))
    result = fb.solve_static(fb.compile_scene(scene, planar=True))
    # tan(angle) = 3 / (weight of the coupler and half of both cranks)
    angle = np.arctan2(3.0, 2.0 * 9.81)
    at = result.names["bodies"][3]["node"] if hasattr(result, "names") else 3
    np.testing.assert_allclose(result.state.q.reshape(-1, 4, 3)[at, 0], [0.5 + np.sin(angle), -np.cos(angle), 0], atol=1e-9)
