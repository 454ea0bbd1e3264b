"""Runs with order 4 say where they pass a kink that leaves them a lower order, and smooth ones say nothing."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.dynamics.kinks import between
from fastbeam.model.forces.spring_laws import kinks_of

Array = np.ndarray
G = 9.81


def run(model: fb.Model, t_end: float, step: float, **options: Any) -> fb.Result:
    return fb.simulate(model, **{"order": 4, "progress": False, **options}, t_end=t_end, step=step)


def told(result: fb.Result) -> list[dict[str, Any]]:
    assert {event["kind"] for event in result.events} <= {"order"}
    return list(result.events)


# --- springs ----------------------------------------------------------------------------------------------------------
def bouncing(spring: dict[str, Any], x: float = 1.2) -> fb.Model:
    """A mass of 1 kg on a line through a spring to the ground with length 1, let go at rest at x."""
    bob = fb.PointMass("bob", mass=1.0, position=(x, 0, 0))
    return fb.compile_scene(fb.Scene(bob, fb.Spring(fb.GROUND.point((0, 0, 0)), bob, "rope", length=1.0, **spring)))


def test_a_rope_that_goes_slack_is_told_with_its_time() -> None:
    """Slack from a quarter of its period on: x = 1 + 0.2 cos 10 t."""
    model = bouncing({"stiffness": 100.0, "tension_only": True})
    event, = told(run(model, 0.4, 0.01))
    assert event["time"] == pytest.approx(0.05 * np.pi, abs=0.011)
    assert event["text"].startswith("spring 'rope' passes a kink of its force law, at the elongation 0 m near t = 0.15")
    assert "order 3 in the step" in event["text"] and "order=2" in event["text"]
    # before it nothing, with order 2 nothing, under step control nothing
    assert told(run(model, 0.15, 0.01)) == [] == told(run(model, 0.4, 0.01, order=2))
    assert told(run(model, 0.4, 0.01, tolerance=1e-8)) == []


@pytest.mark.parametrize(("spring", "left"), [
    ({"stiffness": 100.0, "tension_only": True}, 3), ({"stiffness": 100.0, "compression_only": True}, 3),
    ({"table": ([-0.5, 0.0, 0.5], [-20.0, 0.0, 50.0])}, 3), ({"stiffness": 100.0, "tension_only": True, "damping": 3.0}, 1)])
def test_kinks_of_laws(spring: dict[str, Any], left: int) -> None:
    x = 0.8 if "compression_only" in spring else 1.2
    event, = told(run(bouncing(spring, x), 1.0, 0.01))
    assert f"of order {left} in the step" in event["text"] and event["time"] < 0.4


def slope(model: fb.Model, t_end: float, exact: float, at: int) -> float:
    """Exponent of the step in the errors of coordinate `at`. Where in a step a kink lies changes with their number, so that
    errors scatter: the largest of all smaller steps counts."""
    steps = np.array([40, 57, 80, 113, 160, 226, 320, 453, 640, 905])
    errors = np.array([abs(float(run(model, t_end, t_end / n, every=int(n)).state.q[at]) - exact) for n in steps])
    errors = np.maximum.accumulate(errors[::-1])[::-1]
    return float(-np.polyfit(np.log(steps), np.log(errors), 1)[0])


def test_the_order_behind_a_kink_is_the_one_that_is_told() -> None:
    """Free flight behind a rope of x = 1 + 0.2 cos 10 t, from the time pi/20 on with 2 m/s; the same with a damper of the damping
    ratio 0.15; a ball that is thrown up in air."""
    exact = 1.0 - 2.0 * (0.4 - 0.05 * np.pi)
    found = slope(bouncing({"stiffness": 100.0, "tension_only": True}), 0.4, exact, 0)
    assert 2.7 < found < 3.4, found
    # x - 1 = 0.2 exp(-z w t) (cos(v t) + z w/v sin(v t)), which is 0 first at tan(v t) = -v/(z w)
    zw = 1.5
    v = np.sqrt(100.0 - zw**2)
    t = (np.pi - np.arctan(v / zw)) / v
    speed = 0.2 * np.exp(-zw * t) * 100.0 / v * np.sin(v * t)
    found = slope(bouncing({"stiffness": 100.0, "tension_only": True, "damping": 3.0}), 0.4, 1.0 - speed * (0.4 - t), 0)
    assert 0.6 < found < 1.6, found
    # up to v_inf^2/(2 g) log(1 + v^2/v_inf^2), down by v_inf^2/g log(cosh(g t/v_inf))
    limit = np.sqrt(0.5 * G / 0.1)
    up = limit / G * np.arctan(4.0 / limit)
    exact = limit**2 / G * (0.5 * np.log(1.0 + (4.0 / limit)**2) - np.log(np.cosh(G * (0.8 - up) / limit)))
    found = slope(thrown((0, 0, 4.0), normal=0.1), 0.8, exact, 2)
    assert 2.4 < found < 3.4, found


@pytest.mark.parametrize("spring", [
    {"stiffness": 100.0}, {"table": ([-0.5, 0.0, 0.5], [-50.0, 0.0, 50.0])}, {"stiffness": 100.0, "damping": 2.0},
    {"table": ([-0.5, -0.1, 0.0, 0.1], [-62.5, -10.1, 0.0, 10.1]), "interpolation": "spline"}])
def test_laws_without_kinks_are_silent(spring: dict[str, Any]) -> None:
    assert told(run(bouncing(spring), 1.0, 0.01)) == []


def test_a_rope_that_stays_taut_or_starts_at_its_length_is_silent() -> None:
    bob = fb.PointMass("bob", mass=1.0, position=(0, 0, -1))
    rope = fb.Spring(fb.GROUND.point((0, 0, 0)), bob, "rope", stiffness=500.0, tension_only=True)
    assert told(run(fb.compile_scene(fb.Scene(bob, rope, gravity=(0, 0, -G))), 0.25, 0.005)) == []


def test_what_a_spring_passes_between_rows_is_seen() -> None:
    """It dips below its kink for 0.06 s between rows that are 0.2 s apart: x = 1.19 + 0.2 cos 10 t."""
    bob = fb.PointMass("bob", mass=1.0, position=(1.39, 0, 0))
    rope = fb.Spring(fb.GROUND.point((0, 0, 0)), bob, "rope", length=1.0, stiffness=100.0, tension_only=True)
    model = fb.compile_scene(fb.Scene(bob, rope, fb.Load("pull", bob, force=(19.0, 0, 0))))
    event, = told(run(model, 0.42, 0.01, every=21))
    assert 0.2 < event["time"] < 0.42


def test_pieces_tell_their_kinks() -> None:
    ground = fb.GROUND.point((0, 0, 0))
    bob = fb.PointMass("bob", mass=1.0, position=(1, 0, 0))

    def kinks(**law: Any) -> Any:
        return kinks_of(fb.Spring(ground, bob, **law))

    assert kinks(stiffness=3.0, tension_only=True) == ((0.0, 3),) and kinks(stiffness=3.0, damping=1.0) == ()
    assert kinks(stiffness=3.0, compression_only=True, damping=1.0) == ((0.0, 1),)
    assert kinks(table=([-1.0, 0.0, 1.0, 2.0], [-1.0, 0.0, 1.0, 3.0])) == ((1.0, 3),)
    x = np.array([-1.0, -0.3, 0.2, 0.7, 1.0])
    assert kinks(table=(x, x**3), interpolation="spline") == ()
    assert len(kinks(table=(x, x**3))) == 3


def test_values_between_rows_are_those_of_the_cubic_or_a_straight_line() -> None:
    def f(t: float) -> float:
        return 0.3 + 2.0 * t - 5.0 * t**2 + 4.0 * t**3

    s = np.linspace(0.0, 1.0, 17)
    x0, x1 = np.array([f(0.5), 0.0]), np.array([f(0.7), 0.1])
    v0, v1 = np.array([2.0 - 5.0 + 3.0, 9.0]), np.array([2.0 - 7.0 + 12.0 * 0.49, 9.0])
    found = between(x0, x1, v0, v1, 0.2)
    # rates of 9 m/s do not fit a way of 0.1 m in 0.2 s
    np.testing.assert_allclose(found[:, 1], 0.1 * s, atol=1e-16)
    straight = abs(0.1 * (v0[0] + v1[0]) - (x1[0] - x0[0])) > 0.25 * 0.2 * max(abs(v0[0]), abs(v1[0]))
    exact = x0[0] + s * (x1[0] - x0[0]) if straight else np.array([f(0.5 + 0.2 * a) for a in s])
    assert not straight
    np.testing.assert_allclose(found[:, 0], exact, atol=1e-15)


# --- stops ------------------------------------------------------------------------------------------------------------
def arm(**options: Any) -> fb.Model:
    body = fb.RigidBody("arm", mass=1.0, inertia=(0.02, 0.03, 0.04), position=(0.5, 0, 0))
    pivot = fb.RevoluteJoint(fb.GROUND, body.point((-0.5, 0, 0)), "pivot", axis=(0, 1, 0), **options)
    return fb.compile_scene(fb.Scene(body, pivot, gravity=(0, 0, -G)))


@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_an_elastic_stop_of_a_joint_is_told(damping: float) -> None:
    """Composed of substeps, and with a damper of two runs."""
    model = arm(stops=fb.Stops(None, 1.0, stiffness=500.0), damping=damping)
    event, = told(run(model, 0.7, 0.005))
    text = event["text"]
    assert text.startswith("revolute joint 'pivot' reaches or leaves an elastic stop, at the angle 1 rad near t = "), text
    angle = run(model, 0.7, 0.005, every=1).joint("pivot")["angle"]
    met = 0.005 * int(np.argmax(angle > 1.0))
    assert event["time"] == pytest.approx(met, abs=0.0051)
    assert told(run(model, met - 0.01, 0.005)) == []


def bead(**options: Any) -> fb.Model:
    rail = fb.Beam.straight("rail", (0, 0, 0), (4, 0, 0), section=fb.Section.circle(radius=0.05, E=200e9, rho=7800.0), elements=4)
    mass = fb.PointMass("bead", mass=0.5, velocity=(1.5, 0, 0))
    return fb.compile_scene(fb.Scene(rail, mass, *[fb.Clamp(rail.node(i)) for i in range(rail.n_nodes)],
                                     fb.Slider("run", mass, rail, at=2.0, **options)))


def test_an_elastic_stop_of_a_slider_is_told() -> None:
    model = bead(stops=fb.Stops(1.0, 2.5, stiffness=200.0))
    event, = told(run(model, 0.5, 0.01))
    assert event["text"].startswith("slider 'run' reaches or leaves an elastic stop, s = 2.5 m near t = 0.3")
    assert event["time"] == pytest.approx(0.5 / 1.5, abs=0.011)
    assert told(run(model, 0.3, 0.01)) == []


# --- drag -------------------------------------------------------------------------------------------------------------
def thrown(velocity: tuple[float, float, float], **drag: Any) -> fb.Model:
    ball = fb.PointMass("ball", mass=0.5, position=(0, 0, 0), velocity=velocity)
    return fb.compile_scene(fb.Scene(ball, fb.Drag("air", ball, **drag), gravity=(0, 0, -G)))


def test_a_ball_that_is_thrown_up_turns_around_in_air() -> None:
    """At the time (v_inf/g) atan(v/v_inf)."""
    model, limit = thrown((0, 0, 4.0), normal=0.1), np.sqrt(0.5 * G / 0.1)
    event, = told(run(model, 0.8, 0.01))
    assert event["time"] == pytest.approx(limit / G * np.arctan(4.0 / limit), abs=0.011)
    assert event["text"].startswith("drag 'air' on point mass 'ball': the velocity relative to the air changes sign near t = 0.3")
    assert "order 3 in the step" in event["text"]


@pytest.mark.parametrize(("velocity", "drag"), [
    ((0.0, 0.0, 0.0), {"normal": 0.1}), ((0.0, 0.0, -2.0), {"normal": 0.1}), ((1.0, 0.0, 4.0), {"normal": 0.1}),
    ((0.0, 0.0, 4.0), {"linear": 0.1}), ((0.0, 0.0, 4.0), {"normal": 0.1, "air": (3.0, 0.0, 0.0)})])
def test_what_does_not_turn_around_in_air_is_silent(velocity: tuple[float, float, float], drag: dict[str, Any]) -> None:
    """At rest at first, down, on an arc, linear, in wind from the side."""
    assert told(run(thrown(velocity, **drag), 0.8, 0.01)) == []


def test_moving_air_counts() -> None:
    """The ball flies up faster than the air and is overtaken."""
    event, = told(run(thrown((0, 0, 4.0), normal=0.1, air=(0.0, 0.0, 2.0)), 0.4, 0.01))
    assert 0.1 < event["time"] < 0.25


SOFT = dict(EA=1e3, GA2=400.0, GA3=400.0, GJ=0.7, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=0.01, rhoI3=0.01)


def rod(velocity: Callable[[Array], Array], **drag: Any) -> fb.Model:
    beam = fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=fb.Section(**SOFT), elements=4)
    return fb.compile_scene(fb.Scene(beam, fb.InitialVelocity(beam, velocity=velocity), fb.Drag("air", beam, **drag)))


def test_beams_turn_around_across_and_along() -> None:
    def sway(s: Array) -> Array:
        return np.outer(np.cos(np.pi * s), (0.0, 0.5, 0.0))

    def shuttle(s: Array) -> Array:
        return np.outer(np.cos(np.pi * s / 2.0), (0.5, 0.0, 0.0))

    event, = told(run(rod(sway, normal=0.1), 2.0, 0.01))
    assert event["text"].startswith("drag 'air' on beam 'rod': the velocity across the beam relative to the air changes sign")
    event, = told(run(rod(shuttle, tangential=0.1), 0.2, 0.001))
    assert "along the beam" in event["text"]
    assert told(run(rod(shuttle, linear=0.1), 0.2, 0.001)) == []
    assert told(run(rod(lambda s: np.outer(1.0 + 0.0 * s, (0.5, 0.2, 0.0)), normal=0.1, tangential=0.1), 1.0, 0.01)) == []


def test_a_rope_and_a_beam_at_rest_in_air_are_silent() -> None:
    beam = fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=fb.Section(**SOFT), elements=4)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Drag("air", beam, normal=0.1), gravity=(0, 0, -0.1)))
    rest = fb.solve_static(model).state
    assert told(run(model, 1.0, 0.01, start=rest)) == []
