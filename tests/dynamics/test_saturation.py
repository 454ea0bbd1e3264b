"""Laws that saturate within a small part of a step: controllers with a largest force and smoothed friction."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb

Array = np.ndarray
G, H = 9.81, 0.01
INERTIA, MASS = 0.1, 0.5
STIFF = fb.Section.circle(radius=0.05, E=1e9, rho=1e-6)
# gain by rate: the force saturates 1e-4 of a rad/s or m/s from where it is zero
GAIN, LIMIT = 1e4, 1.0


def wheel(inertia: float = INERTIA, planar: Any = "auto", **options: Any) -> fb.Model:
    """A body that turns about an axis of another one, which is clamped."""
    body, base = (fb.RigidBody(name, mass=1.0, inertia=(inertia,) * 3, position=(0, 0, 0)) for name in ("wheel", "base"))
    axle = fb.RevoluteJoint(base, body, name="axle", axis=(0, 1, 0), **options)
    return fb.compile_scene(fb.Scene(body, base, fb.Clamp(base, name="foot"), axle), planar=planar)


def rail(angle: float = 0.0, rate: float = 0.0, **acting: Any) -> fb.Model:
    """A mass on a straight rail that does not move, at this angle (rad) to the horizontal."""
    beam = fb.Beam.straight("rail", (0, 0, 0), (4 * np.cos(angle), 0, 4 * np.sin(angle)), section=STIFF, elements=4)
    bead = fb.PointMass("bead", mass=MASS)
    scene = fb.Scene(beam, bead, *[fb.Clamp(beam.node(i)) for i in range(beam.n_nodes)], gravity=(0, 0, -G))
    return fb.compile_scene(scene.add(fb.Slider("s", bead, beam, at=1.0, rate=rate, **acting)))


def moving_mesh(gravity: float, **acting: Any) -> fb.Model:
    """A mass on a rail with a moving mesh, both ends of which are clamped."""
    stiff = fb.Section(EA=1e9, GA2=1e9, GA3=1e9, GJ=1e7, EI2=1e7, EI3=1e7, rhoA=1.0, rhoI2=1e-3, rhoI3=1e-3)
    beam, bead = fb.Beam.straight("rail", (0, 0, 0), (2, 0, 0), section=stiff, elements=4), fb.PointMass("bead", mass=MASS)
    scene = fb.Scene(beam, bead, fb.Clamp(beam.start), fb.Clamp(beam.end), gravity=(0, 0, -gravity))
    return fb.compile_scene(fb.with_moving_meshes(scene.add(fb.Slider("s", bead, beam, at=0.8, **acting))))


def arms(n: int, gain: float, limit: float) -> fb.Model:
    """A chain of bars with a motor in each of its hinges, whose angles follow sines."""
    bars = [fb.RigidBody(f"bar {k}", mass=0.2, inertia=(1e-3,) * 3, position=(0.2 * k + 0.1, 0, 0)) for k in range(n)]
    before = [fb.GROUND, *(bar.point((0.1, 0, 0)) for bar in bars)]

    def to(k: int) -> Any:
        return lambda t: np.sin(3.0 * t + k) - np.sin(k)

    motors = [fb.Drive(position=to(k), stiffness=gain, damping=0.1 * gain, limit=limit) for k in range(n)]
    hinges = [fb.RevoluteJoint(before[k], bars[k].point((-0.1, 0, 0)), name=f"hinge {k}", axis=(0, 1, 0), drive=motors[k])
              for k in range(n)]
    return fb.compile_scene(fb.Scene(*bars, *hinges, gravity=(0, 0, -G)))


def run(model: fb.Model, t_end: float, step: float = H, **options: Any) -> fb.Result:
    return fb.simulate(model, t_end=t_end, step=step, every=1, progress=False, **options)


# --- controllers ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("gain", [1e2, 1e4, 1e6])
@pytest.mark.parametrize(("slow", "off"), [(1.0, 1e-3), (1e-3, 1e-8)])
def test_a_motor_with_a_largest_torque_reaches_its_speed_and_holds_it(gain: float, slow: float, off: float) -> None:
    """The rate grows with 10 rad/s^2 to 3 rad/s, at t = 0.3 s, the end of a step; a fast wheel with the error of rotations of
    0.03 rad in a step, a slow heavy one without it."""
    model = wheel(INERTIA / slow, drive=fb.Drive(speed=3.0 * slow, damping=gain / slow, limit=LIMIT))
    result = run(model, 0.6)
    axle, t = result.joint("axle"), result.t
    np.testing.assert_allclose(axle["spin"] / slow, np.minimum(10.0 * t, 3.0), atol=off)
    np.testing.assert_allclose(axle["angle"] / slow, np.where(t < 0.3, 5.0 * t**2, 3.0 * t - 0.45), atol=off)
    np.testing.assert_allclose(axle["work"][-1] / slow, 0.45, rtol=off)
    assert np.mean(result.series["iterations"][1:]) < 3.0


def test_a_speed_that_is_reached_within_a_step_is_that_of_the_mean() -> None:
    """The velocity ends the step as far beyond as it began it; the increment of the angle is that of the speed."""
    result = run(wheel(1e3 * INERTIA, drive=fb.Drive(speed=3.03e-3, damping=1e9, limit=LIMIT)), 0.6)
    angle = result.joint("axle")["angle"]
    np.testing.assert_allclose(np.diff(angle)[31:], 3.03e-3 * H, atol=1e-11)
    np.testing.assert_allclose(angle[:31], 5e-3 * result.t[:31]**2, atol=1e-11)


def test_a_place_that_is_held_by_a_controller_with_a_largest_force() -> None:
    """A force of 0.1 N is pushed against within the range of the controller, 1 N behind it."""
    drive = fb.Drive(position=1.0, stiffness=1e5, damping=1e4, limit=LIMIT)
    push = np.arcsin(0.1 / (MASS * G))
    held = run(rail(push, drive=drive), 0.5).slider("s")
    np.testing.assert_allclose(held["s"][-1], 1.0 - 0.1 / 1e5, atol=1e-8)
    moved = run(rail(np.arcsin(1.2 / (MASS * G)), drive=drive), 0.5)
    np.testing.assert_allclose(moved.slider("s")["s"], 1.0 - 0.5 * 0.2 / MASS * moved.t**2, atol=2e-6)


def turning(t: float) -> float:
    return float(3.0 * np.sin(5.0 * t))


@pytest.mark.parametrize("of", ["joint", "space", "slider", "moving mesh"])
def test_every_step_obeys_the_law(of: str) -> None:
    """What the momentum gains in a step is the force of the law at the mean rate: on both sides, and in between."""
    turns = of in ("joint", "space")
    slow = 1e-3 if turns else 1.0
    drive = fb.Drive(speed=lambda t: slow * turning(t), damping=50.0 / slow, limit=LIMIT)
    if turns:
        model, inertia = wheel(INERTIA / slow, False if of == "space" else "auto", drive=drive), INERTIA / slow
    else:
        model, inertia = rail(drive=drive) if of == "slider" else moving_mesh(0.0, rate=0.0, drive=drive), MASS
    result = run(model, 1.0)
    at = result.joint("axle") if turns else result.slider("s")
    way, rate = (at["angle"], at["spin"]) if turns else (at["s"], at["slide_rate"])
    wanted = slow * np.diff(3.0 / 5.0 * (1.0 - np.cos(5.0 * result.t))) / H
    force = np.clip(50.0 / slow * (wanted - np.diff(way) / H), -LIMIT, LIMIT)
    assert np.any(force == LIMIT) and np.any(force == -LIMIT) and np.any(abs(force) < 0.9 * LIMIT)
    # a rail with a moving mesh is a little longer under the force
    np.testing.assert_allclose(inertia * np.diff(rate) / H, force, atol=5e-3 if of == "moving mesh" else 1e-7)
    assert result.drift("balance") < 1e-11


@pytest.mark.parametrize("gain", [1e3, 1e5])
def test_motors_of_a_chain_whose_ranges_are_met_together(gain: float) -> None:
    result = run(arms(3, gain, 3.0), 1.0, 0.005)
    assert result.drift("balance") < 1e-10
    for k in range(3):
        np.testing.assert_allclose(result.joint(f"hinge {k}")["angle"][-1], np.sin(3.0 + k) - np.sin(k), atol=0.02)


# --- smoothed friction ----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("of", ["slider", "moving mesh"])
def test_smoothed_friction_that_brings_a_mass_to_rest(of: str) -> None:
    """It comes to rest at the end of step 34: v - mu g t."""
    mu = 0.3
    rubs, begin = fb.Friction(mu, smoothing=1e-8), mu * G * 34 * H
    result = run(rail(0.0, begin, friction=rubs) if of == "slider" else moving_mesh(G, rate=begin, friction=rubs), 0.6)
    s, t = result.slider("s"), np.minimum(result.t, 34 * H)
    # the weight comes upon a rail with a moving mesh at once, and it swings
    off = 1e-8 if of == "slider" else 1e-3
    np.testing.assert_allclose(s["s"] - s["s"][0], begin * t - 0.5 * mu * G * t**2, atol=off)
    np.testing.assert_allclose(s["friction_loss"][-1], 0.5 * MASS * begin**2, rtol=10.0 * off)
    assert result.drift("balance") < 1e-11


@pytest.mark.parametrize("smoothing", [1e-5, 1e-7])
def test_smoothed_friction_creeps_on_an_incline(smoothing: float) -> None:
    """A mass that went uphill creeps down with mu cos tanh(v/smoothing) = sin, at rest in the mean of a step."""
    mu, angle, n = 0.3, np.radians(10.0), 20
    brake = G * (mu * np.cos(angle) + np.sin(angle))
    result = run(rail(angle, brake * n * H, friction=fb.Friction(mu, smoothing=smoothing)), 0.6)
    s = result.slider("s")["s"]
    np.testing.assert_allclose(s[n], 1.0 + 0.5 * brake * (n * H)**2, atol=1e-8)
    np.testing.assert_allclose(np.diff(s)[n:], -H * smoothing * np.arctanh(np.tan(angle) / mu), atol=1e-10)


def test_smoothed_friction_obeys_the_law_in_every_step() -> None:
    mu, smoothing = 0.3, 1e-4
    drive = fb.Drive(force=lambda t: 3.0 * np.sin(20.0 * t))
    result = run(rail(0.0, 0.0, friction=fb.Friction(mu, smoothing=smoothing), drive=drive), 1.0)
    s, t = result.slider("s"), result.t
    push = 3.0 * np.diff(-np.cos(20.0 * t) / 20.0) / H
    rubs = mu * MASS * G * np.tanh(np.diff(s["s"]) / (H * smoothing))
    np.testing.assert_allclose(MASS * np.diff(s["slide_rate"]) / H, push - rubs, atol=1e-6)


# --- what knows nothing of the iterations before --------------------------------------------------------------------------
@pytest.mark.parametrize("make", [
    lambda: wheel(drive=fb.Drive(speed=turning, damping=GAIN, limit=LIMIT)),
    lambda: rail(0.0, 1.0, friction=fb.Friction(0.3, smoothing=1e-5), drive=fb.Drive(speed=turning, damping=GAIN, limit=2.0))])
def test_two_halves_are_the_whole_bit_for_bit(make: Any) -> None:
    model = make()
    # in between the law changes its side
    for cut in (0.33, 0.34, 0.35):
        whole, half = run(model, 0.6), run(model, cut)
        rest = run(model, 0.6, start=half.checkpoint)
        for a, b in zip(rest.state, whole.state):
            np.testing.assert_array_equal(a, b)


def test_reactions_are_those_of_the_law() -> None:
    """The foot takes the torque of the motor, also around the step in which it reverses; rows hold means of the steps around."""
    model = wheel(1e3 * INERTIA, drive=fb.Drive(speed=lambda t: 1e-3 * turning(t), damping=1e7, limit=LIMIT))
    result = run(model, 1.0, observe=("energy", "joint", "reaction"))
    torque = 1e3 * INERTIA * np.diff(result.joint("axle")["spin"]) / H
    moment = result.reaction("foot")["moment"][1:-1, 1]
    np.testing.assert_allclose(moment, 0.5 * (torque[1:] + torque[:-1]), atol=1e-5)
    assert np.ptp(torque) > 1.9 * LIMIT


@pytest.mark.parametrize("of", ["motor", "drive", "friction"])
def test_gradients_go_through_both_sides(of: str) -> None:
    """Derivatives by an inertia of a run that saturates on both sides, against differences of runs."""
    def scene(m: float) -> fb.Scene:
        if of == "motor":
            body = fb.RigidBody("part", mass=m, inertia=(INERTIA,) * 3, position=(0.5, 0, 0))
            drive = fb.Drive(speed=turning, damping=GAIN, limit=LIMIT)
            return fb.Scene(body, fb.RevoluteJoint(fb.GROUND, body.point((-0.5, 0, 0)), name="axle", axis=(0, 1, 0), drive=drive))
        beam = fb.Beam.straight("rail", (0, 0, 0), (4, 0, 0), section=STIFF, elements=4)
        body = fb.PointMass("part", mass=m)
        push = fb.Drive(speed=turning, damping=GAIN, limit=LIMIT) if of == "drive" else fb.Drive(force=lambda t: 3.0 * turning(t))
        rubs = None if of == "drive" else fb.Friction(0.3, smoothing=1e-3)
        return fb.Scene(beam, body, *[fb.Clamp(beam.node(i)) for i in range(beam.n_nodes)],
                        fb.Slider("s", body, beam, at=1.0, rate=0.0, drive=push, friction=rubs), gravity=(0, 0, -G))

    def go(m: float) -> Any:
        at = scene(m)
        return fb.adjoint_run(fb.compile_scene(at), t_end=1.0, step=H, points={"part": [*at.bodies, *at.masses][0]})

    found = go(MASS)
    given = {"part": np.random.default_rng(3).standard_normal((101, 3))}
    by = found.gradient(points=given).masses["part"]
    e = 1e-6
    ends = [float(np.sum(given["part"] * go(MASS + sign * e).point("part"))) for sign in (1, -1)]
    assert by == pytest.approx((ends[0] - ends[1]) / (2.0 * e), rel=1e-4)
