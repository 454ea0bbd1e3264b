"""Given angles and distances, stops and friction of joints with axes: against other ways to the same motion, exact answers."""
from __future__ import annotations

import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import fastbeam as fb

Array = np.ndarray
G = 9.81
SPACE_AND_PLANE = pytest.mark.parametrize("planar", [False, "auto"], ids=["space", "plane"])


def body(name: str, position: Any, **options: Any) -> fb.RigidBody:
    return fb.RigidBody(name, **{"mass": 1.0, "inertia": (0.02, 0.03, 0.04), "position": position, **options})


def hinge(a: Any, b: Any, at: Any, axis: Any, name: str, **options: Any) -> fb.RevoluteJoint:
    """A revolute joint at a place in space."""
    sides = [x if x is fb.GROUND else x.point((np.asarray(at, float) - x.position) @ x.directors.T) for x in (a, b)]
    return fb.RevoluteJoint(*sides, name, axis=axis, **options)


def run(model: fb.Model, t_end: float, step: float, **options: Any) -> fb.Result:
    return fb.simulate(model, t_end=t_end, step=step, progress=False, **options)


def arm(planar: Any = "auto", gravity: Any = (0, 0, -G), at: float = 0.5, spin: float = 0.0, **options: Any) -> fb.Model:
    """A body on a hinge about y at the origin."""
    part = body("arm", (at, 0, 0), spin=(0, spin, 0), velocity=(0, 0, -spin * at))
    return fb.compile_scene(fb.Scene(part, hinge(fb.GROUND, part, (0, 0, 0), (0, 1, 0), "pivot", **options), gravity=gravity),
                            planar=planar)


def slide(planar: Any = "auto", gravity: Any = (0, 0, 0), speed: float = 0.0, **options: Any) -> fb.Model:
    """A body on a guide along x."""
    part = body("block", (0.2, 0, 0.1), velocity=(speed, 0, 0))
    guide = fb.PrismaticJoint(fb.GROUND, part, "guide", axis=(1, 0, 0), **options)
    return fb.compile_scene(fb.Scene(part, guide, gravity=gravity), planar=planar)


def turned(result: fb.Result) -> Array:
    """Angle of the arm about y in the last shape, from its directors."""
    d = result.state.q.reshape(-1, 4, 3)[0, 1]
    return np.arctan2(-d[2], d[0])


# ------------------------------------------------------------------------------------------------------------ given motion
@SPACE_AND_PLANE
def test_ten_thousand_steps_of_a_given_angle_end_where_they_should(planar: Any) -> None:
    """Some 135 turns, with a wobble; the angle is that of the directors."""
    def angle(t: float) -> float:
        return 8.5 * t + 0.3 * np.sin(5.0 * t)

    model = arm(planar, spin=10.0, angle=angle)
    result = run(model, 100.0, 0.01, every=500)
    assert abs(np.sin(turned(result) - angle(100.0))) < 1e-12
    joint = result.joint("pivot")
    np.testing.assert_allclose(joint["angle"], [angle(t) for t in result.t], rtol=0.0, atol=1e-12)
    assert joint["angle"][-1] > 260 * np.pi and result.drift("balance") < 1e-12
    assert result.info["fallbacks"] == 0 and result.info["iterations"] < 4 * result.info["steps"]


def test_torque_of_a_drive_is_that_of_the_equation_of_motion_to_second_order() -> None:
    def angle(t: float) -> float:
        return 0.5 * t**2 + 0.2 * t**3

    errors = []
    for step in (0.02, 0.01):
        result = run(arm(angle=angle), 2.0, step, every=1)
        joint = result.joint("pivot")
        exact = (0.03 + 0.25) * (1.0 + 1.2 * result.t) - G * 0.5 * np.cos(joint["angle"])
        errors.append(np.max(np.abs(joint["torque"] - exact)))
        work = result.balance()["motor of joint 'pivot'"]
        np.testing.assert_allclose(joint["work"], -work, rtol=0.0, atol=0.0)
        np.testing.assert_allclose(joint["work"], result.series["total"] - result.series["total"][0], rtol=0.0, atol=1e-11)
    assert errors[1] < 5e-3 and np.log2(errors[0] / errors[1]) > 1.9


@SPACE_AND_PLANE
@pytest.mark.parametrize("given", ["angle", "speed"])
def test_a_flexible_beam_is_spun_up_as_by_a_support_that_turns(planar: Any, given: str) -> None:
    """The root on a hinge with a given angle, and in a support with a prescribed rotation: the same motion, and the same work."""
    def angle(t: float) -> float:
        return 2.0 * (t - np.sin(np.pi * t) / np.pi)

    def speed(t: float) -> float:
        return 2.0 * (1.0 - np.cos(np.pi * t))

    section = fb.Section.circle(radius=0.02, E=1e8, rho=1000.0)
    ends, works = [], []
    for held in ("joint", "support"):
        beam = fb.Beam.straight("blade", (0, 0, 0), (1, 0, 0), section=section, elements=4)
        held_by: Any = fb.RevoluteJoint(fb.GROUND, beam.start, "root", axis=(0, 1, 0),
                                        **{given: angle if given == "angle" else speed})
        if held == "support":
            held_by = fb.PrescribedMotion("root", beam.start, rotation=lambda t: _about_y(angle(t)))
        model = fb.compile_scene(fb.Scene(beam, held_by, gravity=(0, 0, -G)), planar=planar)
        result = run(model, 1.5, 0.01)
        assert result.drift("balance") < 1e-12
        ends.append(result.state.q.reshape(-1, 4, 3)[:13])
        works.append(-[x for name, x in result.balance().items() if "root" in name][0])
    # the mean of a speed over a step is exact to sixth order
    limit = 1e-10 if given == "angle" else 1e-9
    np.testing.assert_allclose(ends[0], ends[1], rtol=0.0, atol=limit)
    np.testing.assert_allclose(works[0], works[1], rtol=0.0, atol=10 * limit)
    assert np.linalg.norm(ends[0][-1, 0] - [np.cos(angle(1.5)), 0, -np.sin(angle(1.5))]) > 0.01


def _about_y(angle: float) -> Array:
    return np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])


def test_a_flexible_slider_crank_with_a_given_crank_angle_moves_as_with_a_crank_pin_on_a_circle() -> None:
    r, length, w = 0.15, 0.6, 12.0
    x = np.sqrt(length**2 - r**2)

    def angle(t: float) -> float:
        return w * (t - 0.1 * np.sin(10.0 * t))

    section = fb.Section.rectangle(height=0.01, width=0.02, E=1e9, rho=1500.0)
    ends, works = [], []
    for kind in ("joint", "pin"):
        rod = fb.Beam.straight("rod", (0, 0, r), (x, 0, 0), section=section, elements=4)
        piston = body("piston", (x, 0, 0), mass=0.3)
        parts: list[Any] = [rod, piston, fb.RevoluteJoint(rod.end, piston, "pin", axis=(0, 1, 0)),
                            fb.PrismaticJoint(fb.GROUND, piston, "guide", axis=(1, 0, 0))]
        if kind == "joint":
            # a crank in balance about its shaft takes no work but that of its inertia, which is zero at the end
            crank = body("crank", (0, 0, 0), inertia=(1e-4, 1e-4, 1e-4))
            parts += [crank, hinge(fb.GROUND, crank, (0, 0, 0), (0, 1, 0), "shaft", angle=angle),
                      fb.RevoluteJoint(crank.point((0, 0, r)), rod.start, "crank pin", axis=(0, 1, 0))]
        else:
            parts.append(fb.PrescribedMotion("circle", rod.start, position=lambda t: _about_y(angle(t)) @ (0, 0, r)))
        model = fb.compile_scene(fb.Scene(*parts, gravity=(0, 0, -G)))
        result = run(model, 0.2 * np.pi, 0.2 * np.pi / 400)
        assert result.drift("balance") < 1e-12 and result.info["fallbacks"] == 0
        ends.append(result.state.q.reshape(-1, 4, 3)[:13, 0])
        works.append(-[x for name, x in result.balance().items() if "shaft" in name or "circle" in name][0])
    # the pin goes from point to point on chords, which bends the rod by second order
    np.testing.assert_allclose(ends[0], ends[1], rtol=0.0, atol=5e-6)
    np.testing.assert_allclose(works[0][-1], works[1][-1], rtol=0.0, atol=1e-3)
    assert np.max(np.abs(works[0])) > 0.01


FREE = {"angle": lambda t: np.sin(3 * t) - 3 * t, "distance": lambda t: 0.3 * np.cos(3 * t) - 0.3}


def flight(what: str, **options: Any) -> fb.Model:
    """Two spinning bodies, with a joint that lies at both of their sides."""
    a, b = body("a", (0.5, 0, 0), spin=(1, 2, 3), mass=2.0), body("b", (1.5, 0, 0.2), spin=(-1, 0, 1), velocity=(0, 0.5, 0.2))
    axis = (0.3, 1.0, 0.2)
    joint: Any
    if what == "angle":
        joint = fb.RevoluteJoint(a.point((1, 0, 0)), b.point((0, 0, -0.2)), "joint", axis=axis, **options)
    else:
        joint = fb.PrismaticJoint(a.point((0.2, 0.1, 0)), b.point((0, 0.1, 0.3)), "joint", axis=axis, **options)
    return fb.compile_scene(fb.Scene(a, b, joint, project_velocities=True))


@pytest.mark.parametrize("what", list(FREE))
def test_given_joints_in_flight_keep_momenta_and_close_their_books_with_both_orders(what: str) -> None:
    model = flight(what, **{what: FREE[what]})
    ends: dict[tuple[int, float], Array] = {}
    for order, step in ((2, 0.04), (2, 0.02), (4, 0.04), (4, 0.02), (4, 0.005)):
        result = run(model, 1.0, step, order=order)
        assert max(result.drift(name) for name in ("balance", "lin_mom", "ang_mom")) < 1e-13
        assert abs(result.joint("joint")["work"][-1]) > 1e-3
        ends[order, step] = result.state.q
    exact = ends[4, 0.005]
    two, four = ([float(np.max(np.abs(ends[order, step] - exact))) for step in (0.04, 0.02)] for order in (2, 4))
    assert np.log2(two[0] / two[1]) > 1.9 and two[1] < 1e-3
    assert np.log2(four[0] / four[1]) > 3.0 and four[1] < 1e-6


def test_a_drive_goes_on_from_a_checkpoint_bit_for_bit_and_with_step_control() -> None:
    for options in ({"angle": lambda t: 4.0 * t**2}, {"speed": lambda t: 8.0 * t}):
        model = arm(False, **options)
        whole, first = run(model, 2.0, 0.01), run(model, 0.83, 0.01)
        second = run(model, 2.0, 0.01, start=first.checkpoint)
        for x, y in zip(whole.state, second.state):
            np.testing.assert_array_equal(x, y)
        controlled = run(model, 2.0, 0.01, tolerance=1e-5)
        assert abs(controlled.joint("pivot")["angle"][-1] - 16.0) < 1e-11 and controlled.drift("balance") < 1e-11


def test_reactions_of_a_driven_joint_have_its_torque_and_those_of_others_stay_in_balance() -> None:
    part, hand = body("arm", (0.5, 0, 0)), body("hand", (1.0, 0, 0.2))
    scene = fb.Scene(part, hand, hinge(fb.GROUND, part, (0, 0, 0), (0, 1, 0), "shoulder", angle=lambda t: 2.0 * t**2),
                     hinge(part, hand, (1, 0, 0), (0, 1, 0), "wrist", friction=0.3), gravity=(0, 0, -G))
    result = run(fb.compile_scene(scene, planar=False), 1.0, 0.005, observe=("energy", "joint", "reaction"))
    for name in ("shoulder", "wrist"):
        np.testing.assert_allclose(result.reaction(name)["moment"][:, 1], result.joint(name)["torque"], rtol=1e-4, atol=1e-4)
    # the joint carries the weight, and what turns the momentum around
    series = run(fb.compile_scene(scene, planar=False), 1.0, 0.005, observe=("energy", "momentum", "reaction"))
    force = series.reaction("shoulder")["force"]
    change = np.gradient(series.series["lin_mom"], series.t, axis=0)
    np.testing.assert_allclose(force[2:-2], (change + [0, 0, 2.0 * G])[2:-2], rtol=0.0, atol=0.05)


@SPACE_AND_PLANE
def test_an_equilibrium_at_a_given_angle_is_that_of_a_beam_clamped_at_this_angle(planar: Any) -> None:
    section, found = fb.Section.circle(radius=0.01, E=1e9, rho=1000.0), []
    for given in (True, False):
        tip = (1, 0, 0) if given else (np.cos(0.7), 0, -np.sin(0.7))
        beam = fb.Beam.straight("boom", (0, 0, 0), tip, section=section, elements=4)
        support: Any = fb.Clamp(beam.start)
        if given:
            support = fb.RevoluteJoint(fb.GROUND, beam.start, "pivot", axis=(0, 1, 0), angle=lambda t: 0.175 * t**2)
        model = fb.compile_scene(fb.Scene(beam, support, gravity=(0, 0, -G)), planar=planar)
        rest = fb.solve_static(model, at_time=2.0)
        assert rest.info["unstable_directions"] == rest.info["free_directions"] == 0
        found.append((rest, fb.modes(model, state=rest.state, n=4).frequencies, model))
    one, other = (rest.state.q.reshape(-1, 4, 3)[:13, 0] for rest, *_ in found)
    np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(found[0][1], found[1][1], rtol=1e-7)
    # and a run holds it there with the torque of the weight
    held = found[0][2]
    with pytest.raises(fb.SceneError, match="its value is 0.7 rad, but its prescribed angle at t = 0 s is 0 rad"):
        run(held, 0.1, 0.01, start=found[0][0].state)
    with pytest.raises(fb.SceneError, match="give the time with at_time"):
        fb.solve_static(held)


# ------------------------------------------------------------------------------------------------------------------- stops
@SPACE_AND_PLANE
def test_a_stop_is_touched_for_half_a_period_of_its_spring_and_gives_all_energy_back(planar: Any) -> None:
    inertia, stiffness, spin, gap = 0.03, 30.0, 2.0, 0.5
    contact = np.pi * np.sqrt(inertia / stiffness)
    model = arm(planar, (0, 0, 0), 0.0, spin, stops=fb.Stops(-gap, gap, stiffness=stiffness))
    errors = []
    for step in (0.002, 0.001):
        result = run(model, 8.0, step, every=1)
        joint = result.joint("pivot")
        assert result.drift("total") < 1e-13 and np.max(joint["energy"]) > 0.9 * 0.5 * inertia * spin**2
        # instants at which it turns around
        k = np.flatnonzero(joint["spin"][:-1] * joint["spin"][1:] < 0.0)
        rate = joint["spin"]
        at = result.t[k] + step * rate[k] / (rate[k] - rate[k + 1])
        exact = gap / spin + 0.5 * contact + np.arange(at.size) * (contact + 2.0 * gap / spin)
        assert at.size > 10
        errors.append(float(np.max(np.abs(at - exact))))
    assert errors[1] < 2e-4 * 8.0 and errors[0] / errors[1] > 2.5


def test_an_arm_that_falls_on_a_stop_rests_where_it_pushes_back() -> None:
    for planar in (False, "auto"):
        model = arm(planar, stiffness=0.1, stops=fb.Stops(None, 0.3, stiffness=200.0))
        rest = fb.solve_static(model)
        exact = brentq(lambda a: 0.1 * a + 200.0 * (a - 0.3) - 0.5 * G * np.cos(a), 0.3, 0.4, xtol=1e-15)
        assert rest.info["unstable_directions"] == 0
        on = run(model, 0.1, 0.01, start=rest.state).joint("pivot")["angle"]
        np.testing.assert_allclose(on, exact, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("what", list(FREE))
def test_stops_and_friction_between_two_bodies_in_flight_keep_momenta(what: str) -> None:
    stops = fb.Stops(-0.05, 0.05, stiffness=500.0)
    result = run(flight(what, stops=stops), 1.0, 0.005)
    assert max(result.drift(name) for name in ("total", "lin_mom", "ang_mom")) < 1e-13
    assert np.max(result.joint("joint")["energy"]) > 1e-3
    result = run(flight(what, friction=0.05), 1.0, 0.005)
    assert max(result.drift(name) for name in ("balance", "lin_mom", "ang_mom")) < 1e-13
    joint = result.joint("joint")
    assert joint["friction_loss"][-1] > 1e-3 and np.all(np.diff(joint["friction_loss"]) >= 0.0)


# ---------------------------------------------------------------------------------------------------------------- friction
@SPACE_AND_PLANE
@pytest.mark.parametrize("turns", [True, False], ids=["angle", "distance"])
def test_friction_stops_a_rotor_and_a_block_after_the_time_that_it_takes(planar: Any, turns: bool) -> None:
    inertia, limit, speed = (0.03, 0.02, 2.0) if turns else (1.0, 0.5, 1.2)
    model = arm(planar, (0, 0, 0), 0.0, speed, friction=limit) if turns else slide(planar, speed=speed, friction=limit)
    result = run(model, 4.0, 0.01, every=1)
    joint = result.joint("pivot" if turns else "guide")
    way = joint["angle" if turns else "distance"]
    stop = inertia * speed / limit
    t = np.minimum(result.t, stop)
    np.testing.assert_allclose(way, speed * t - 0.5 * limit / inertia * t**2, rtol=0.0, atol=1e-4)
    at_rest = result.t > stop + 0.02
    assert np.any(at_rest) and np.ptp(way[at_rest]) == 0.0
    assert joint["friction_loss"][-1] == pytest.approx(0.5 * inertia * speed**2, rel=1e-4)
    assert result.drift("balance") < 1e-13
    force = joint["torque" if turns else "force"]
    np.testing.assert_allclose(force[result.t < stop - 0.02], -limit, rtol=1e-9)
    assert set(result.balance()) >= {f"friction of joint '{'pivot' if turns else 'guide'}'"}


def test_a_motor_breaks_loose_where_it_exceeds_the_friction() -> None:
    """0.03 t N m against 0.02 N m: it begins to move at 2/3 s, and before that does not move by a bit."""
    model = arm("auto", (0, 0, 0), 0.0, friction=0.02, torque=lambda t: 0.03 * t)
    result = run(model, 2.0, 0.001, every=1)
    joint = result.joint("pivot")
    assert result.t[np.argmax(joint["angle"] > 0.0)] == pytest.approx(2.0 / 3.0, abs=2e-3)
    assert np.all(joint["angle"][result.t < 0.666] == 0.0)
    late = np.maximum(result.t - 2.0 / 3.0, 0.0)
    np.testing.assert_allclose(joint["angle"], late**3 / 6.0, rtol=0.0, atol=1e-5)
    stuck = result.t < 0.66
    np.testing.assert_allclose(joint["torque"][stuck], -0.03 * result.t[stuck], rtol=0.0, atol=1e-6)


def _with_friction(force: Callable[[float], float], limit: float, t_end: float) -> float:
    """Angle of x'' = force(x) - limit sign(x'), from rest at zero, with stops at the events."""
    t, x, v = 0.0, 0.0, 0.0
    while t < t_end:
        if abs(force(x)) <= limit:
            return x
        sign = np.sign(force(x))

        def turns(t: float, y: Array, sign: float = sign) -> float:
            return y[1] * sign + 1e-13 * (t == 0.0)

        turns.terminal, turns.direction = True, -1.0  # type: ignore[attr-defined]
        found = solve_ivp(lambda t, y, sign=sign: [y[1], force(y[0]) - sign * limit], (t, t_end), [x, v], events=turns,
                          method="DOP853", rtol=1e-11, atol=1e-12, first_step=1e-6)
        t, (x, v) = found.t[-1], found.y[:, -1]
        if found.t_events[0].size:
            v = 0.0
    return x


@SPACE_AND_PLANE
def test_a_pendulum_with_friction_comes_to_rest_where_an_integrator_with_events_says(planar: Any) -> None:
    inertia, limit = 0.03 + 0.25, 0.8
    exact = _with_friction(lambda x: G * 0.5 * np.cos(x) / inertia, limit / inertia, 60.0)
    errors = []
    for step in (0.01, 0.005):
        result = run(arm(planar, friction=limit), 12.0, step, every=1)
        joint = result.joint("pivot")
        assert np.ptp(joint["angle"][-50:]) == 0.0 and result.drift("balance") < 1e-12
        assert abs(joint["torque"][-1]) <= limit * (1 + 1e-9)
        assert joint["torque"][-2] == pytest.approx(-0.5 * G * np.cos(joint["angle"][-1]), rel=1e-9)
        assert result.info["iterations"] < 4 * result.info["steps"]
        errors.append(abs(joint["angle"][-1] - exact))
    assert errors[1] < 2e-3


def test_friction_of_a_joint_between_beams_and_its_checkpoint() -> None:
    """Two bars fold about a hinge that rubs; a run that goes on from a checkpoint is the same to the last bit."""
    section = fb.Section.circle(radius=0.02, E=1e8, rho=1000.0)
    one = fb.Beam.straight("one", (0, 0, 0), (0.5, 0, 0), section=section, elements=2)
    two = fb.Beam.straight("two", (0.5, 0, 0), (1, 0, 0), section=section, elements=2)
    scene = fb.Scene(one, two, fb.Clamp(one.start), fb.RevoluteJoint(one.end, two.start, "knee", axis=(0, 1, 0), friction=0.6),
                     gravity=(0, 0, -G))
    for planar in (False, "auto"):
        model = fb.compile_scene(scene, planar=planar)
        whole, first = run(model, 1.0, 0.005), run(model, 0.4, 0.005)
        assert whole.drift("balance") < 1e-12 and whole.joint("knee")["friction_loss"][-1] > 0.1
        second = run(model, 1.0, 0.005, start=first.checkpoint)
        for x, y in zip(whole.state, second.state):
            np.testing.assert_array_equal(x, y)


@pytest.mark.parametrize("step", [0.01, 0.005])
def test_a_chain_of_hinges_that_all_rub_falls_and_comes_to_rest(step: float) -> None:
    links = [body(f"link {k}", (0.1 * k + 0.05, 0, 0), mass=0.1, inertia=(1e-4, 1e-4, 1e-4)) for k in range(5)]
    joints = [hinge(a, b, (0.1 * k, 0, 0), (0, 1, 0), f"joint {k}", friction=0.15)
              for k, (a, b) in enumerate(zip([fb.GROUND, *links], links))]
    result = run(fb.compile_scene(fb.Scene(*links, *joints, gravity=(0, 0, -G))), 6.0, step)
    assert result.drift("balance") < 1e-12 and result.info["fallbacks"] == 0
    assert result.info["iterations"] < 6 * result.info["steps"]
    angles = np.array([result.joint(f"joint {k}")["angle"] for k in range(5)])
    # what is left of a velocity when one joint stops while others move does not make the others creep
    assert np.all(np.ptp(angles[:, -20:], axis=1) == 0.0) and np.ptp(angles[0]) > 1.0
    # each joint holds what hangs on it, but for what is left of its motion
    torque = np.array([result.joint(f"joint {k}")["torque"][-2] for k in range(5)])
    assert np.all(np.abs(torque) <= 0.15 * (1 + 1e-9))
    q = result.state.q.reshape(-1, 4, 3)
    x, ends = q[:5, 0, 0], [0.0, *(q[:4, 0, 0] + 0.05 * q[:4, 1, 0])]
    hanging = np.array([np.sum(0.1 * G * (x[k:] - ends[k])) for k in range(5)])
    np.testing.assert_allclose(torque, -hanging, rtol=0.0, atol=1e-7)


# ------------------------------------------------------------------------------------------------------ cylindrical joints
def test_springs_of_a_cylindrical_joint_swing_with_both_frequencies() -> None:
    part = body("bush", (0, 0, 0), spin=(0.6, 0, 0), velocity=(0.4, 0, 0))
    joint = fb.CylindricalJoint(fb.GROUND, part, "guide", axis=(1, 0, 0), stiffness=(2.0, 400.0), damping=(0.0, 3.0),
                                rest=(0.1, 0.0))
    result = run(fb.compile_scene(fb.Scene(part, joint)), 1.0, 0.001)
    found, t = result.joint("guide"), result.t
    w = np.sqrt(2.0 / 0.02)
    np.testing.assert_allclose(found["angle"], 0.1 - 0.1 * np.cos(w * t) + 0.6 / w * np.sin(w * t), rtol=0.0, atol=2e-4)
    w, rate = np.sqrt(400.0 - 1.5**2), 1.5
    np.testing.assert_allclose(found["distance"], 0.4 / w * np.exp(-rate * t) * np.sin(w * t), rtol=0.0, atol=2e-5)
    assert result.drift("balance") < 1e-13 and found["loss"][-1] > 0.05
    assert result.balance()["damper of joint 'guide'"][-1] == found["loss"][-1]


# ------------------------------------------------------------------------------------------------------- how-to/joints.md
def test_the_recipe_runs() -> None:
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "joints.md").read_text(encoding="utf-8")
    recipe = page.split("An arm that is swung to a given angle")[1].split("\n\n")[1]
    found: dict[str, Any] = {"fb": fb}
    exec(textwrap.dedent(recipe), found)
    swing = found["swing"]
    assert swing.drift("balance") < 1e-12 and swing.joint("shoulder")["angle"][-1] == pytest.approx(0.5, abs=1e-14)
    assert swing.joint("shoulder")["torque"].max() > 1.0 and swing.joint("wrist")["friction_loss"][-1] > 0.0


# ---------------------------------------------------------------------------------------------------------------- refusals
@pytest.mark.parametrize(("options", "text"), [
    ({"angle": 0.0, "torque": 1.0}, "torque= has no effect"), ({"angle": 0.0, "speed": 1.0}, "angle= and speed= both"),
    ({"speed": 1.0, "stiffness": 3.0}, "speed= prescribes its motion whatever the force, so stiffness="),
    ({"angle": 0.0, "damping": 3.0}, "damping= has no effect"), ({"angle": 0.0, "friction": 3.0}, "friction= has no effect"),
    ({"angle": 0.0, "stops": fb.Stops(-1, 1, stiffness=1.0)}, "stops= has no effect"),
    ({"stops": fb.Stops(0.1, 1, stiffness=1.0)}, "stops from 0.1 to 1.0 rad must enclose its .* at the start")])
def test_what_contradicts_each_other_is_refused(options: dict[str, Any], text: str) -> None:
    with pytest.raises(fb.SceneError, match=text):
        arm(**options)


def _driven_by(angle: float) -> fb.Scene:
    beam = fb.Beam.straight("boom", (0, 0, 0), (1, 0, 0), section=fb.Section.circle(radius=0.01, E=1e9, rho=1000.0), elements=2)
    return fb.Scene(beam, fb.RevoluteJoint(fb.GROUND, beam.start, "pivot", axis=(0, 1, 0), angle=angle), gravity=(0, 0, -G))


def test_runs_refuse_what_they_do_not_know() -> None:
    with pytest.raises(fb.SceneError, match="its value is 0 rad, but its prescribed angle at t = 0 s is 0.5 rad"):
        run(arm(angle=0.5), 0.1, 0.01)
    with pytest.raises(fb.SceneError, match="half a turn or more in the step from t = 0"):
        run(arm(speed=lambda t: 800.0 * t), 1.0, 0.1)
    with pytest.raises(fb.SceneError, match="must return a finite number"):
        run(arm(angle=lambda t: 0.0 if t < 0.05 else np.nan), 0.1, 0.01)
    with pytest.raises(fb.SceneError, match="initial velocities violate it"):
        arm(speed=3.0)
    with pytest.raises(fb.SceneError, match="friction of revolute joint .pivot. would add energy"):
        run(arm(friction=0.1), 0.1, 0.01, order=4)
    with pytest.raises(fb.SceneError, match="solve_path does not support friction of joints"):
        fb.solve_path(arm(friction=0.1))
    for options in ({"friction": 0.1}, {"angle": 0.0}, {"stops": fb.Stops(-1, 1, stiffness=1.0)}):
        with pytest.raises(fb.SceneError, match="use the default method"):
            run(arm(**options), 0.1, 0.01, method="midpoint")
    for options, text in (({"friction": 0.1}, "does not support friction of joints"),
                          ({"angle": 0.0}, "joint 'pivot' has a value prescribed as a function")):
        with pytest.raises(fb.SceneError, match=text):
            fb.relax(arm(**options))
    with pytest.raises(fb.SceneError, match="joint 'pivot' has a prescribed value, which may depend on the parameters"):
        fb.sensitivity(_driven_by, {"angle": 0.1})
    loaded = arm(angle=0.5)
    with pytest.raises(fb.SceneError, match="solve_path: joints keep their angles and distances"):
        fb.solve_path(loaded)
