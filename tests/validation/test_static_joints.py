"""Motors, drives, friction and rigid stops of joints in equilibria, against exact answers of arms and pendulums."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import fastbeam as fb

Array = np.ndarray
G = 9.81
SPACE_AND_PLANE = pytest.mark.parametrize("planar", [False, "auto"], ids=["space", "plane"])


def body(name: str, position: Any, **options: Any) -> fb.RigidBody:
    return fb.RigidBody(name, **{"mass": 1.0, "inertia": (0.02, 0.03, 0.04), "position": position, **options})


def arm(planar: Any = "auto", **options: Any) -> fb.Model:
    """A body of 1 kg, 0.5 m from a hinge about y: the angle grows downward, the weight turns it by 0.5 G cos(angle)."""
    part = body("arm", (0.5, 0, 0))
    pivot = fb.RevoluteJoint(fb.GROUND, part.point((-0.5, 0, 0)), "pivot", axis=(0, 1, 0), **options)
    return fb.compile_scene(fb.Scene(part, pivot, gravity=(0, 0, -G)), planar=planar)


def block(planar: Any = "auto", slope: float = 0.3, **options: Any) -> fb.Model:
    """A body of 1 kg on a guide that goes down."""
    part = body("block", (0, 0, 0))
    guide = fb.PrismaticJoint(fb.GROUND, part, "guide", axis=(np.cos(slope), 0, -np.sin(slope)), **options)
    return fb.compile_scene(fb.Scene(part, guide, gravity=(0, 0, -G)), planar=planar)


def angle(result: fb.Result) -> float:
    d = result.state.q.reshape(-1, 4, 3)[0, 1]
    return float(np.arctan2(-d[2], d[0]))


def stays(model: fb.Model, result: fb.Result, name: str, what: str) -> None:
    """A run from there stands still."""
    on = fb.simulate(model, start=result.state, t_end=0.2, step=0.01, progress=False).joint(name)[what]
    assert np.ptp(on) < 1e-11


@SPACE_AND_PLANE
def test_a_motor_turns_an_arm_to_where_its_spring_holds_it(planar: Any) -> None:
    model = arm(planar, stiffness=12.0, torque=lambda t: 3.0 * t)
    result = fb.solve_static(model, at_time=0.7)
    exact = brentq(lambda x: 12.0 * x - 2.1 - 0.5 * G * np.cos(x), 0.0, 1.5, xtol=1e-15)
    np.testing.assert_allclose(angle(result), exact, rtol=0.0, atol=1e-13)
    assert result.info["unstable_directions"] == 0
    found = fb.modes(model, n=1, state=result.state, at_time=0.7, planar=True if planar == "auto" else None)
    stiffness = 12.0 + 0.5 * G * np.sin(exact)
    np.testing.assert_allclose(found.frequencies[0], np.sqrt(stiffness / 0.28) / (2 * np.pi), rtol=1e-9)
    with pytest.raises(fb.SceneError, match=r"give the time with at_time="):
        fb.solve_static(model)


@SPACE_AND_PLANE
@pytest.mark.parametrize("kind", ["controller", "law", "force"])
def test_a_drive_at_rest_holds_an_arm_as_its_law_says(planar: Any, kind: str) -> None:
    drives = {"controller": (fb.Drive(position=-0.2, stiffness=20.0, damping=1.0), lambda x: 20.0 * (-0.2 - x)),
              "law": (fb.Drive(force=lambda t, x, rate: -30.0 * x**3 - 2.0 * rate), lambda x: -30.0 * x**3),
              "force": (fb.Drive(force=-1.5), lambda x: -1.5)}
    drive, law = drives[kind]
    model = arm(planar, drive=drive, stiffness=3.0)
    # a law may depend on the time
    at = 0.0 if kind == "law" else None
    result = fb.solve_static(model, at_time=at)
    exact = brentq(lambda x: law(x) - 3.0 * x + 0.5 * G * np.cos(x), -1.0, 2.0, xtol=1e-15)
    np.testing.assert_allclose(angle(result), exact, rtol=0.0, atol=1e-12)
    if kind != "force":
        stays(model, result, "pivot", "angle")
    e = 1e-6
    stiffness = 3.0 + 0.5 * G * np.sin(exact) - (law(exact + e) - law(exact - e)) / (2 * e)
    found = fb.modes(model, n=1, state=result.state, at_time=at)
    np.testing.assert_allclose(found.frequencies[0], np.sqrt(stiffness / 0.28) / (2 * np.pi), rtol=1e-6)
    if kind == "controller":
        ratio = fb.modes(model, n=1, state=result.state, damped=True).damping_ratios[0]
        np.testing.assert_allclose(ratio, 1.0 / (2.0 * np.sqrt(stiffness * 0.28)), rtol=1e-8)


@SPACE_AND_PLANE
def test_an_arm_falls_onto_its_rigid_stop_and_rests_there_with_its_weight(planar: Any) -> None:
    model = arm(planar, stops=fb.Stops(-0.4, 0.3))
    result = fb.solve_static(model)
    np.testing.assert_allclose(angle(result), 0.3, rtol=0.0, atol=1e-13)
    stays(model, result, "pivot", "angle")
    on = fb.simulate(model, start=result.state, t_end=0.05, step=0.01, progress=False)
    np.testing.assert_allclose(on.joint("pivot")["torque"][-1], -0.5 * G * np.cos(0.3), rtol=1e-9)
    assert result.info["unstable_directions"] == 0
    # pulled off the stop by a spring
    model = arm(planar, stops=fb.Stops(-0.4, 0.3), stiffness=40.0)
    result = fb.solve_static(model)
    exact = brentq(lambda x: 40.0 * x - 0.5 * G * np.cos(x), 0.0, 0.3, xtol=1e-15)
    np.testing.assert_allclose(angle(result), exact, rtol=0.0, atol=1e-12)
    found = fb.modes(model, n=1, state=result.state)
    np.testing.assert_allclose(found.frequencies[0], np.sqrt((40.0 + 0.5 * G * np.sin(exact)) / 0.28) / (2 * np.pi), rtol=1e-9)


def test_a_pendulum_between_wide_stops_hangs_down() -> None:
    model = arm(stops=fb.Stops(-0.4, 3.0))
    result = fb.solve_static(model)
    np.testing.assert_allclose(angle(result), 0.5 * np.pi, rtol=0.0, atol=1e-11)


def pulled(planar: Any = "auto", **options: Any) -> fb.Model:
    """The arm of `arm`, lifted by t N at its centre."""
    part = body("arm", (0.5, 0, 0))
    pivot = fb.RevoluteJoint(fb.GROUND, part.point((-0.5, 0, 0)), "pivot", axis=(0, 1, 0), **options)
    lift = fb.Load("lift", part, force=(0, 0, 1), time=lambda t: t)
    return fb.compile_scene(fb.Scene(part, pivot, lift, gravity=(0, 0, -G)), planar=planar)


@SPACE_AND_PLANE
def test_load_factors_between_which_friction_holds_a_lever(planar: Any) -> None:
    """Of all loads, of one load alone, with friction that grows with the force on the pin, a motor, a stop."""
    for options, turns in (({}, 0.5 * G), ({"torque": 3.0}, 0.5 * G + 3.0)):
        found = fb.stick_interval(arm(planar, friction=5.0, **options), "pivot", load_factor=0.5, within=(-5.0, 5.0))
        np.testing.assert_allclose((found.low, found.high), np.array([-5.0, 5.0]) / turns, rtol=1e-12)
    for options, most in (({"friction": 2.0}, 2.0 / 0.5), ({"friction": 1.0, "coefficient": 0.3, "radius": 0.1}, 1.0 / 0.47)):
        found = fb.stick_interval(pulled(planar, **options), "pivot", at_time=(0.0, 1.0), load_factor=G, within=(0.0, 50.0))
        np.testing.assert_allclose((found.low, found.high), (G - most, G + most), rtol=1e-12)
    found = fb.stick_interval(arm(planar, friction=5.0, stops=fb.Stops(-1.0, 0.0)), "pivot", load_factor=0.5, within=(-5.0, 5.0))
    assert found.high == np.inf and found.low == pytest.approx(-10.0 / G, rel=1e-12)
    # one that has slipped is at the end of its interval
    found = fb.stick_interval(arm(planar, friction=2.0), "pivot", within=(-3.0, 3.0))
    np.testing.assert_allclose((found.low, found.high), (-1.0, 1.0), rtol=2e-5)


def test_intervals_of_joints_say_what_is_wrong() -> None:
    part = body("arm", (0.5, 0, 0))
    joint = fb.CylindricalJoint(fb.GROUND, part, "tube", axis=(0, 1, 0), friction=(1.0, 2.0))
    tube = fb.compile_scene(fb.Scene(part, joint, fb.Load("push", part, force=(0, 1.0, 0))))
    with pytest.raises(fb.SceneError, match="friction on 2 coordinates; name one of them, .*distance of cylindrical joint"):
        fb.stick_interval(tube, "tube")
    found = fb.stick_interval(tube, "distance of cylindrical joint 'tube'", load_factor=0.5, within=(-9.0, 9.0))
    np.testing.assert_allclose(np.abs((found.low, found.high)), found.high, rtol=1e-12)
    assert found.high in (pytest.approx(1.0, rel=1e-12), pytest.approx(2.0, rel=1e-12))
    with pytest.raises(fb.SceneError, match="joint 'pivot' has no friction; name one"):
        fb.stick_interval(arm(stops=fb.Stops(-1.0, 0.0)), "pivot")


@SPACE_AND_PLANE
def test_friction_holds_an_arm_or_lets_it_go_to_where_it_is_full(planar: Any) -> None:
    held = fb.solve_static(arm(planar, friction=5.0))
    assert angle(held) == pytest.approx(0.0, abs=1e-14) and held.info["friction"]["revolute joint 'pivot'"]["sticks"]
    np.testing.assert_allclose(held.info["friction"]["revolute joint 'pivot'"]["force"], -0.5 * G, rtol=1e-12)
    model = arm(planar, friction=2.0)
    result = fb.solve_static(model)
    # a share of 1e-5 stays in reserve
    np.testing.assert_allclose(angle(result), np.arccos(2.0 * (1.0 - 1e-5) / (0.5 * G)), rtol=0.0, atol=1e-10)
    assert not result.info["friction"]["revolute joint 'pivot'"]["sticks"] and result.info["unstable_directions"] == 0
    stays(model, result, "pivot", "angle")
    # with a spring behind: full friction against it on the way down
    model = arm(planar, friction=2.0, stiffness=4.0)
    exact = brentq(lambda x: 4.0 * x + 2.0 * (1.0 - 1e-5) - 0.5 * G * np.cos(x), 0.0, 1.5, xtol=1e-15)
    np.testing.assert_allclose(angle(fb.solve_static(model)), exact, rtol=0.0, atol=1e-11)


@SPACE_AND_PLANE
def test_a_block_on_an_incline_rests_by_the_coefficient_of_its_guide(planar: Any) -> None:
    result = fb.solve_static(block(planar, coefficient=0.35))
    found = result.info["friction"]["prismatic joint 'guide'"]
    np.testing.assert_allclose((found["force"], found["cone"]), (-G * np.sin(0.3), 0.35 * G * np.cos(0.3)), rtol=1e-12)
    assert found["sticks"] and abs(result.state.q[0]) < 1e-14
    k, mu = 30.0, 0.2
    result = fb.solve_static(block(planar, coefficient=mu, stiffness=k))
    way = G * (np.sin(0.3) - (1.0 - 1e-5) * mu * np.cos(0.3)) / k
    np.testing.assert_allclose(result.state.q[0] / np.cos(0.3), way, rtol=0.0, atol=1e-12)


def test_a_journal_that_slips_presses_as_it_turns() -> None:
    """The pin carries the weight whatever the angle: mu R G."""
    model = arm(False, coefficient=0.3, radius=0.4, stiffness=4.0)
    exact = brentq(lambda x: 4.0 * x + 0.3 * 0.4 * G * (1.0 - 1e-5) - 0.5 * G * np.cos(x), 0.0, 1.5, xtol=1e-15)
    np.testing.assert_allclose(angle(fb.solve_static(model)), exact, rtol=0.0, atol=1e-10)


@SPACE_AND_PLANE
def test_two_arms_that_rub_and_stop_at_once(planar: Any) -> None:
    """The upper one slips against a spring, the lower one falls on its stop."""
    upper, lower = body("upper", (0.5, 0, 0)), body("lower", (1.5, 0, 0))
    scene = fb.Scene(upper, lower,
                     fb.RevoluteJoint(fb.GROUND, upper.point((-0.5, 0, 0)), "shoulder", axis=(0, 1, 0), friction=3.0,
                                      stiffness=25.0),
                     fb.RevoluteJoint(upper.point((0.5, 0, 0)), lower.point((-0.5, 0, 0)), "elbow", axis=(0, 1, 0),
                                      stops=fb.Stops(-0.2, 0.25)), gravity=(0, 0, -G))
    model = fb.compile_scene(scene, planar=planar)
    result = fb.solve_static(model)
    exact = brentq(lambda x: 25.0 * x + 3.0 * (1.0 - 1e-5) - 1.5 * G * np.cos(x) - 0.5 * G * np.cos(x + 0.25), 0.0, 1.5,
                   xtol=1e-15)
    np.testing.assert_allclose(angle(result), exact, rtol=0.0, atol=1e-11)
    d = result.state.q.reshape(-1, 4, 3)[1, 1]
    np.testing.assert_allclose(np.arctan2(-d[2], d[0]) - exact, 0.25, rtol=0.0, atol=1e-11)
    stays(model, result, "elbow", "angle")


def test_a_cross_with_motors_and_a_ball_in_its_cone_rest_where_they_should() -> None:
    part = body("part", (0, 0, -0.5))
    cross = fb.UniversalJoint(fb.GROUND, part.point((0, 0, 0.5)), "cross", axis_a=(1, 0, 0), axis_b=(0, 1, 0), torque=(1.2, None))
    result = fb.solve_static(fb.compile_scene(fb.Scene(part, cross, gravity=(0, 0, -G))))
    x = result.state.q.reshape(-1, 4, 3)[0, 0]
    np.testing.assert_allclose(np.arctan2(x[1], -x[2]), np.arcsin(1.2 / (0.5 * G)), rtol=0.0, atol=1e-12)
    part = body("part", (0.5, 0, 0))
    ball = fb.SphericalJoint(fb.GROUND, part.point((-0.5, 0, 0)), "ball", axis=(1, 0, 0), cone=fb.Stops(end=0.3, stiffness=200.0),
                             stiffness=(1.0, 2.0))
    result = fb.solve_static(fb.compile_scene(fb.Scene(part, ball, gravity=(0, 0, -G)), planar=False))
    exact = brentq(lambda x: 1.0 * x + 200.0 * (x - 0.3) - 0.5 * G * np.cos(x), 0.3, 0.5, xtol=1e-15)
    np.testing.assert_allclose(angle(result), exact, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(("call", "text"), [
    (lambda m: fb.relax(m), "relax does not support motors"), (lambda m: fb.solve_path(m), "solve_path does not support motors")])
def test_what_does_not_know_motors_of_joints_says_so(call: Any, text: str) -> None:
    with pytest.raises(fb.SceneError, match=text):
        call(arm(False, torque=1.0, stiffness=1.0))
