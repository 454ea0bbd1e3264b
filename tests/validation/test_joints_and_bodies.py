"""Rigid bodies and joints against closed forms, a reference integrator and each other."""
from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parents[1]))
from small_scenes import bent, drifts, straight  # noqa: E402

Array = np.ndarray
ROUND_OFF = 1e-12  # relative drift over a few hundred steps


# ------------------------------------------------------------------------------------------------------------- rigid body
def top(spin: tuple[float, float, float]) -> fb.Scene:
    """Free asymmetric top, principal axes along the body triad."""
    return fb.Scene(fb.RigidBody("top", mass=2.0, inertia=(1.0, 2.0, 3.0), position=(0.5, 0, 0), velocity=(1, 2, 3), spin=spin))


def euler_reference(spin: tuple[float, float, float], t_end: float) -> Array:
    """Directors (rows) of the same top from Euler's equations and d_i' = omega x d_i, integrated to 1e-12."""
    j = np.array([1.0, 2.0, 3.0])

    def rate(t: float, y: Array) -> Array:
        w, d = y[:3], y[3:].reshape(3, 3)
        return np.concatenate((np.cross(j * w, w) / j, np.cross(w @ d, d).reshape(-1)))

    start = np.concatenate((spin, np.eye(3).reshape(-1)))
    solution = solve_ivp(rate, (0.0, t_end), start, method="DOP853", rtol=1e-12, atol=1e-13)
    return solution.y[3:, -1].reshape(3, 3)


@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize("spin", [(1.0, 2.0, 3.0), (0.01, 3.0, 0.02)], ids=["tumbling", "Dzhanibekov"])
def test_free_top_keeps_energy_and_momenta(spin: tuple[float, float, float], order: int) -> None:
    model = fb.compile_scene(top(spin))
    result = fb.simulate(model, t_end=20.0, step=0.05, order=order)
    assert max(drifts(result).values()) <= ROUND_OFF
    np.testing.assert_allclose(result.state.q[:3], [20.5, 40, 60], rtol=1e-12)
    d = result.state.q[3:].reshape(3, 3)
    np.testing.assert_allclose(d @ d.T, np.eye(3), rtol=0.0, atol=1e-12)
    # kinetic energy and angular momentum about the origin of the initial state
    w, j = np.array(spin), np.array([1.0, 2.0, 3.0])
    assert result.series["kinetic"][0] == pytest.approx(0.5 * 2.0 * 14.0 + 0.5 * float(j @ w**2), rel=1e-14)
    np.testing.assert_allclose(result.series["ang_mom"][0], j * w + 2.0 * np.cross([0.5, 0, 0], [1, 2, 3]), rtol=1e-14)


def test_flipping_top_follows_the_reference_with_order_two_and_four() -> None:
    spin = (0.01, 3.0, 0.02)
    model, exact = fb.compile_scene(top(spin)), euler_reference(spin, 8.0)
    assert exact[1, 1] < 0.99  # it has left its axis by then
    rates = {}
    for order, step in ((2, 0.01), (4, 0.04)):
        errors = []
        for h in (step, step / 2):
            d = fb.simulate(model, t_end=8.0, step=h, order=order, observe=()).state.q[3:].reshape(3, 3)
            errors.append(float(np.max(np.abs(d - exact))))
        rates[order] = np.log2(errors[0] / errors[1])
    assert rates[2] == pytest.approx(2.0, abs=0.1)
    assert rates[4] == pytest.approx(4.0, abs=0.25)
    fine = fb.simulate(model, t_end=8.0, step=0.0025, order=4, observe=()).state.q[3:].reshape(3, 3)
    np.testing.assert_allclose(fine, exact, rtol=0.0, atol=2e-8)


def test_top_turns_over_only_about_its_middle_axis() -> None:
    # spin in the body triad changes sign about the middle axis, never about the other two
    signs = {}
    for k in range(3):
        spin = 0.02 * np.ones(3)
        spin[k] = 3.0
        model = fb.compile_scene(top(tuple(spin)))
        seen: list[float] = []

        def watch(t: float, state: object, k: int = k, seen: list[float] = seen) -> None:
            q, v = state.q.reshape(4, 3), state.v.reshape(4, 3)
            seen.append(float(0.5 * np.cross(q[1:], v[1:]).sum(axis=0) @ q[1 + k]))

        fb.simulate(model, t_end=15.0, step=0.02, callback=watch, every=5)
        signs[k] = min(seen) < 0.0 < max(seen)
    assert signs == {0: False, 1: True, 2: False}


# -------------------------------------------------------------------------------------------------------------- pendulums
def pendulum(angle: float, hook: str) -> tuple[fb.Scene, fb.RigidBody]:
    """Body on a ball joint at the origin, centre of mass 0.8 m below, turned by `angle` about e_y."""
    c, s = np.cos(angle), np.sin(angle)
    directors = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    body = fb.RigidBody("bob", mass=1.5, inertia=(0.1, 0.2, 0.3), position=-0.8 * directors[2], directors=directors)
    if hook == "mass":
        nail = fb.PointMass("nail", mass=1.0, position=(0, 0, 0))
        parts = (nail, fb.Clamp(nail.center))
        node = nail.center
    else:
        wall = straight("wall", (-1, 0, 0), (0, 0, 0), elements=1)
        parts = (wall, fb.Clamp(wall.start), fb.Clamp(wall.node(1)), fb.Clamp(wall.end))
        node = wall.end
    return fb.Scene(*parts, body, fb.BallJoint(node, body.point((0, 0, 0.8))), gravity=(0, 0, -9.81)), body


@pytest.mark.parametrize("hook", ["mass", "beam"])
@pytest.mark.parametrize("angle", [0.01, 2.0])
def test_period_of_a_pendulum_on_a_ball_joint(angle: float, hook: str) -> None:
    scene, body = pendulum(angle, hook)
    inertia = 0.2 + 1.5 * 0.8**2
    period = 4.0 * np.sqrt(inertia / (1.5 * 9.81 * 0.8)) * ellipk(np.sin(0.5 * angle) ** 2)
    model = fb.compile_scene(scene)
    result = fb.simulate(model, t_end=period, step=period / 200, order=4, every=1,
                         points={"bob": body, "top": body.point((0, 0, 0.8))})
    bob = result.point("bob")
    # error of the method of order 4 at 200 steps a period
    np.testing.assert_allclose(bob[-1], bob[0], rtol=0.0, atol=2e-6 * max(angle, 0.1))
    np.testing.assert_allclose(bob[100], bob[0] * [-1, 1, 1], rtol=0.0, atol=2e-6 * max(angle, 0.1))
    assert np.max(np.abs(result.point("top"))) <= 1e-14
    assert np.ptp(result.series["total"]) <= ROUND_OFF * 1.5 * 9.81 * 0.8


def test_body_on_the_end_of_a_flexible_beam_keeps_its_energy() -> None:
    beam = straight("arm", (0, 0, 0), (2, 0, 0))
    body = fb.RigidBody("bob", mass=0.5, inertia=(0.02, 0.03, 0.04), position=(2, 0, -0.5))
    scene = fb.Scene(beam, body, fb.Clamp(beam.start), fb.BallJoint(beam.end, body.point((0, 0, 0.5))), gravity=(0, 3, -9.81))
    result = fb.simulate(fb.compile_scene(scene), t_end=2.0, step=0.01, points={"hook": body.point((0, 0, 0.5)), "tip": beam.end})
    assert np.max(np.abs(result.point("hook") - result.point("tip"))) <= 1e-14
    assert np.ptp(result.series["total"]) <= ROUND_OFF * np.max(result.series["kinetic"]) * 10.0
    assert np.max(result.series["kinetic"]) > 0.5


# ----------------------------------------------------------------------------------------------------------------- joined
def test_beams_joined_end_to_end_are_one_beam() -> None:
    whole = straight("whole", (0, 0, 0), (4, 0, 0), elements=4)
    left, right = straight("left", (0, 0, 0), (2, 0, 0), elements=2), straight("right", (2, 0, 0), (4, 0, 0), elements=2)
    start = bent(whole)
    fields = [fb.InitialVelocity(beam, velocity=lambda s, x=x: start.velocity_at(s + x), spin=lambda s, x=x: start.spin_at(s + x))
              for beam, x in ((left, 0.0), (right, 2.0))]
    run = {"t_end": 1.0, "step": 0.01, "every": 10}
    one = fb.simulate(fb.compile_scene(fb.Scene(whole, start)), **run)
    for joint in (fb.RigidConnection(left.end, right.start), fb.RigidConnection(right.start, left.end)):
        two = fb.simulate(fb.compile_scene(fb.Scene(left, right, joint, *fields)), **run)
        for part, at in ((left, slice(0, 5)), (right, slice(4, 9))):
            first = 0 if part is left else 5
            np.testing.assert_allclose(two.phi[:, first:first + 5], one.phi[:, at], rtol=0.0, atol=1e-11)
            np.testing.assert_allclose(two.directors[:, first:first + 5], one.directors[:, at], rtol=0.0, atol=1e-11)
        np.testing.assert_allclose(two.series["total"], one.series["total"], rtol=1e-11)
        assert max(drifts(two).values()) <= ROUND_OFF


def test_pieces_of_a_body_joined_rigidly_move_as_the_body() -> None:
    spin = (0.5, 2.0, -1.0)
    parts = [fb.RigidBody(f"piece {k}", mass=1.0 + k, inertia=(0.1, 0.2, 0.25), position=x) for k, x in
             enumerate([(0.0, 0.0, 0.0), (1.0, 0.2, 0.0), (0.3, 1.0, 0.5)])]
    pieces = fb.Scene(*parts, fb.RigidConnection(parts[0], parts[1]), fb.RigidConnection(parts[1], parts[2]),
                      fb.RigidMotion(spin=spin, velocity=(1, 0, 0)))
    mass = sum(part.mass for part in parts)
    center = sum(part.mass * part.position for part in parts) / mass
    inertia = sum(part.inertia + part.mass * ((r := part.position - center) @ r * np.eye(3) - np.outer(r, r)) for part in parts)
    body = fb.RigidBody("whole", mass=mass, inertia=inertia, position=center)
    whole = fb.Scene(body, fb.RigidMotion(spin=spin, velocity=(1, 0, 0)))
    run = {"t_end": 2.0, "step": 0.02}
    one = fb.simulate(fb.compile_scene(whole), **run)
    many = fb.simulate(fb.compile_scene(pieces), **run)
    np.testing.assert_allclose(many.state.q[3:12], one.state.q[3:12], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(many.series["ang_mom"], one.series["ang_mom"], rtol=0.0, atol=1e-11)
    assert max(drifts(many).values()) <= ROUND_OFF
