"""Rigid stops of joints with axes, friction that follows what they carry, and drives that push: against exact answers."""
from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from restarts import assert_goes_on
from scipy.integrate import solve_ivp

import fastbeam as fb
from fastbeam.dynamics.velocity_jumps import strike_joint
from fastbeam.kernels.joints.coordinates import WORK
from fastbeam.kernels.joints.friction import AGAINST, STOP_LOSS

Array = np.ndarray
G = 9.81
# of the arm: mass 1 kg at 0.5 m of its pivot
INERTIA, LEVER = 0.03 + 0.25, 0.5
SPACE_AND_PLANE = pytest.mark.parametrize("planar", [pytest.param(False, marks=pytest.mark.slow), "auto"], ids=["space", "plane"])


def body(name: str, position: Any, **options: Any) -> fb.RigidBody:
    return fb.RigidBody(name, **{"mass": 1.0, "inertia": (0.02, 0.03, 0.04), "position": position, **options})


def hinge(a: Any, b: Any, at: Any, name: str, axis: Any = (0, 1, 0), **options: Any) -> fb.RevoluteJoint:
    sides = [x if x is fb.GROUND else x.point((np.asarray(at, float) - x.position) @ x.directors.T) for x in (a, b)]
    return fb.RevoluteJoint(*sides, name, axis=axis, **options)


def run(model: fb.Model, t_end: float, step: float, **options: Any) -> fb.Result:
    return fb.simulate(model, t_end=t_end, step=step, progress=False, **options)


def arm(planar: Any = "auto", gravity: Any = (0, 0, -G), spin: float = 0.0, **options: Any) -> fb.Model:
    """A body on a hinge about y at the origin, horizontal at t = 0."""
    part = body("arm", (LEVER, 0, 0), spin=(0, spin, 0), velocity=(0, 0, -spin * LEVER))
    return fb.compile_scene(fb.Scene(part, hinge(fb.GROUND, part, (0, 0, 0), "pivot", **options), gravity=gravity), planar=planar)


def chain(n: int, planar: Any = "auto", **options: Any) -> fb.Scene:
    """n bars, each on the one before, horizontal at t = 0."""
    links = [body(f"link {k}", (0.2 * k + 0.1, 0, 0), mass=0.2, inertia=(1e-3, 1e-3, 1e-3)) for k in range(n)]
    joints = [hinge(a, b, (0.2 * k, 0, 0), f"joint {k}", **options) for k, (a, b) in enumerate(zip([fb.GROUND, *links], links))]
    return fb.Scene(*links, *joints, gravity=(0, 0, -G))


def impacts(result: fb.Result) -> list[float]:
    return [x["time"] for x in result.events if x["kind"] == "impact"]


# ------------------------------------------------------------------------------------------------------------- rigid stops
def fall(angle: float, spin: float = 0.0, to: float = 1.0) -> tuple[float, float]:
    """Time in which the arm comes from an angle to another, and its spin there."""
    def meets(t: float, y: Array) -> float:
        return float(y[0] - to) if t > 1e-9 else -1.0

    meets.terminal, meets.direction = True, 1.0  # type: ignore[attr-defined]
    found = solve_ivp(lambda t, y: [y[1], G * LEVER * np.cos(y[0]) / INERTIA], (0.0, 10.0), [angle, spin], events=meets,
                      method="DOP853", rtol=1e-12, atol=1e-13)
    return float(found.t[-1]), float(found.y[1, -1])


@SPACE_AND_PLANE
def test_an_arm_bounces_on_its_stop_at_the_times_of_an_integrator_with_events(planar: Any) -> None:
    restitution = 0.6
    exact, spin, t = [], 0.0, 0.0
    angle = 0.0
    for _ in range(4):
        way, spin = fall(angle, spin)
        t, angle, spin = t + way, 1.0, -restitution * spin
        exact.append(t)
    errors = []
    for step in (0.005, 0.0025):
        result = run(arm(planar, stops=fb.Stops(-0.2, 1.0, restitution=restitution)), 1.8, step, every=1)
        errors.append(np.max(np.abs(np.array(impacts(result)[:4]) - exact)))
        joint = result.joint("pivot")
        assert result.drift("balance") < 1e-13 and np.max(joint["angle"]) < 1.0 + 1e-9
        assert set(result.balance()) >= {"stops of joint 'pivot'"}
        # each impact takes its share of the kinetic energy
        losses = np.diff(joint["stop_loss"])
        losses = losses[losses > 0.0][:4]
        np.testing.assert_allclose(losses[1:] / losses[:-1], restitution**2, rtol=1e-3)
    assert errors[1] < 2e-4 and np.log2(errors[0] / errors[1]) > 1.8
    first = G * LEVER * np.sin(1.0)
    assert losses[0] == pytest.approx((1.0 - restitution**2) * first, rel=1e-9)


def test_an_arm_rests_at_its_stop_until_it_is_pulled_away_and_its_stop_carries_the_weight() -> None:
    push = 3.0 * G * LEVER
    # it lets go when the motor lifts the weight
    leaves = np.cos(1.0) / 3.0
    model = arm("auto", stops=fb.Stops(None, 1.0), torque=lambda t: -push * max(t - 1.0, 0.0))
    result = run(model, 1.5, 0.002, every=1)
    joint, (t,) = result.joint("pivot"), impacts(result)
    rests = (result.t > t) & (result.t < 1.0 + leaves - 0.003)
    assert np.ptp(joint["angle"][rests]) == 0.0 and joint["angle"][-1] < 0.99
    assert result.drift("balance") < 1e-13
    # a row is the mean of the steps around it
    inner = rests & (result.t > t + 0.01) & (np.abs(result.t - 1.0) > 0.003)
    exact = push * np.maximum(result.t - 1.0, 0.0) - G * LEVER * np.cos(1.0)
    np.testing.assert_allclose(joint["torque"][inner], exact[inner], rtol=0.0, atol=1e-9)
    assert np.all(joint["torque"][result.t > 1.0 + leaves + 0.005] == 0.0)


def test_runs_go_on_from_every_row_around_an_impact_bit_for_bit_also_with_step_control(tmp_path: Any) -> None:
    model = arm("auto", stops=fb.Stops(-0.2, 1.0, restitution=0.3))
    for tolerance in (None, 1e-5):
        settings: dict[str, Any] = dict(t_end=0.9, step=0.01, every=1, tolerance=tolerance, progress=False)
        whole = fb.simulate(model, **settings)
        times = impacts(whole)
        assert len(times) > 2 and whole.drift("balance") < 1e-13
        for t in (times[0], times[-1]):
            n = int(np.argmin(np.abs(whole.t - t)))
            for k in (n - 1, n, n + 1):
                assert_goes_on(model, whole, k, tmp_path / "c", settings)


@SPACE_AND_PLANE
def test_a_chain_falls_on_the_stops_of_all_its_joints_and_comes_to_rest_there(planar: Any) -> None:
    model = fb.compile_scene(chain(3, stops=fb.Stops(-0.3, 0.3, restitution=0.2), friction=2e-3), planar=planar)
    result = run(model, 4.0, 0.002, every=1)
    assert result.drift("balance") < 1e-12 and result.info["fallbacks"] == 0
    angles = np.array([result.joint(f"joint {k}")["angle"] for k in range(3)])
    assert np.all(np.abs(angles) < 0.3 + 1e-9) and np.all(np.ptp(angles[:, -20:], axis=1) == 0.0)
    # stops that are met within 1e-5 of a step count as met at the same time
    np.testing.assert_allclose(angles[:, -1], 0.3, rtol=0.0, atol=1e-7)
    torque = np.array([result.joint(f"joint {k}")["torque"][-2] for k in range(3)])
    lines = np.cumsum(0.3 * np.ones(3))
    ends = np.concatenate(([0.0], np.cumsum(0.2 * np.cos(lines))))
    hanging = np.array([np.sum(0.2 * G * (0.5 * (ends[1:] + ends[:-1])[k:] - ends[k])) for k in range(3)])
    # friction carries what the stop does not have to
    np.testing.assert_allclose(torque, -hanging, rtol=0.0, atol=1e-6)


def mass_matrix(angles: Any, m: float = 0.2, inertia: float = 1e-3, length: float = 0.2) -> Array:
    """Of two bars by their relative angles."""
    one, two = np.cumsum(angles)
    tangent = [np.array([-np.sin(x), np.cos(x)]) for x in (one, two)]
    lead = [np.stack((0.5 * length * tangent[0], np.zeros(2)), axis=1),
            np.stack((length * tangent[0] + 0.5 * length * tangent[1], 0.5 * length * tangent[1]), axis=1)]
    turn = [np.array([1.0, 0.0]), np.array([1.0, 1.0])]
    return sum(m * j.T @ j + inertia * np.outer(w, w) for j, w in zip(lead, turn))


@pytest.mark.parametrize(("at_end", "holds"), [(True, True), (False, False)])
def test_an_impact_beside_a_joint_at_rest_is_that_of_lagranges_equations(at_end: bool, holds: bool) -> None:
    """The second joint strikes while the first rests: its stop takes an impulse that pushes, and lets go else."""
    one, two = body("one", (0.1, 0, 0), mass=0.2, inertia=(1e-3, 1e-3, 1e-3)), None
    rate = 2.0 if at_end else -2.0
    two = body("two", (0.3, 0, 0), mass=0.2, inertia=(1e-3, 1e-3, 1e-3), spin=(0, rate, 0), velocity=(0, 0, -0.1 * rate))
    stops = fb.Stops(-0.5, 0.0) if at_end else fb.Stops(0.0, 0.5)
    scene = fb.Scene(one, two, hinge(fb.GROUND, one, (0, 0, 0), "first", stops=fb.Stops(None, 0.0)),
                     hinge(one, two, (0.2, 0, 0), "second", stops=fb.Stops(stops.start, stops.end, restitution=0.5)))
    model = fb.compile_scene(scene, planar=False)
    state, holds_of = model.state(), model.motions.holds
    holds_of.numbers(state.history)[0, AGAINST] = 1.0
    after = strike_joint(model, state, 1, at_end, 0.5)
    mass, before = mass_matrix((0.0, 0.0)), np.array([0.0, rate])
    # the impulse is on the second coordinate; held, the first does not move
    inverse = np.diag([0.0, 1.0 / mass[1, 1]]) if holds else np.linalg.inv(mass)
    impulse = -1.5 * rate / inverse[1, 1]
    exact = before + inverse @ [0.0, impulse]
    if not holds:
        assert exact[0] < 0.0
    found = model.motions.rates(*(x.reshape(-1, 4, 3) for x in (after.q, after.v)))
    np.testing.assert_allclose(found, exact, rtol=1e-11, atol=1e-12)
    own = holds_of.numbers(after.history)
    loss = 0.5 * (before @ mass @ before - exact @ mass @ exact)
    assert own[1, STOP_LOSS] == pytest.approx(loss, rel=1e-10) and own[0, AGAINST] == (1.0 if holds else 0.0)


@pytest.mark.parametrize("restitution", [1.0, 0.5])
def test_a_motor_beside_a_stop_does_the_work_of_its_impulse(restitution: float) -> None:
    """The first bar turns at a given speed while the second strikes its stop: the loss is that of the second alone, the rest of
    what changes is work of the motor."""
    given, rate = 1.5, -3.0
    one = body("one", (0.1, 0, 0), mass=0.2, inertia=(1e-3, 1e-3, 1e-3), spin=(0, given, 0), velocity=(0, 0, -0.1 * given))
    two = body("two", (0.3, 0, 0), mass=0.2, inertia=(1e-3, 1e-3, 1e-3), spin=(0, given + rate, 0),
               velocity=(0, 0, -0.3 * given - 0.1 * rate))
    model = fb.compile_scene(fb.Scene(one, two, hinge(fb.GROUND, one, (0, 0, 0), "motor", speed=given),
                                      hinge(one, two, (0.2, 0, 0), "stopped",
                                            stops=fb.Stops(0.0, None, restitution=restitution))), planar=False)
    state, motions = model.state(), model.motions
    after = strike_joint(model, state, 0, False, restitution)
    mass = mass_matrix((0.0, 0.0))
    rates = np.array([given, rate]), np.array([given, -restitution * rate])
    np.testing.assert_allclose(motions.rates(*(x.reshape(-1, 4, 3) for x in (after.q, after.v))), rates[1], rtol=1e-11)
    loss = 0.5 * mass[1, 1] * rate**2 * (1.0 - restitution**2)
    work = 0.5 * (rates[1] @ mass @ rates[1] - rates[0] @ mass @ rates[0]) + loss
    assert work > 0.02
    assert motions.own(after.history, model.place("motions"))[:, WORK] == pytest.approx([work, 0.0], rel=1e-10, abs=1e-15)
    assert motions.holds.numbers(after.history)[0, STOP_LOSS] == pytest.approx(loss, rel=1e-10, abs=1e-14)


@pytest.mark.parametrize(("restitution", "turns"), [(1.0, False), (0.3, False), (1.0, True), (0.3, True)])
def test_a_support_that_moves_does_the_work_of_a_blow(restitution: float, turns: bool) -> None:
    """An arm on a carriage, or a hub, that is driven strikes its stop: the loss is that of its own turning."""
    speed = 2.0
    if turns:
        carriage, part = body("hub", (0, 0, 0), spin=(0, speed, 0)), body("arm", (LEVER, 0, 0), velocity=(0, 0, -LEVER * speed),
                                                                          spin=(0, speed, 0))
    else:
        carriage, part = body("carriage", (0, 0, 0), velocity=(0, 0, speed)), body("arm", (LEVER, 0, 0), velocity=(0, 0, speed))
    drive = fb.PrescribedMotion("drive", carriage, displacement=lambda t: (0.0, 0.0, 0.0 if turns else speed * t),
                                rotation=lambda t: (0.0, speed * t if turns else 0.0, 0.0))
    scene = fb.Scene(carriage, part, hinge(carriage, part, (0, 0, 0), "pivot", torque=1.0,
                                           stops=fb.Stops(None, 0.2, restitution=restitution)),
                     drive)
    result = run(fb.compile_scene(scene), 1.2, 2e-3, every=1)
    spin = np.sqrt(2.0 * 0.2 / INERTIA)
    lost = result.balance()["stops of joint 'pivot'"]
    n = int(np.argmax(result.t >= impacts(result)[0] - 1e-12))
    # rates across the hinge, which the end of a step leaves, are lost: fourth order in the step
    assert lost[n] == pytest.approx(0.5 * INERTIA * spin**2 * (1.0 - restitution**2), rel=1e-4, abs=1e-10)
    if restitution == 1.0:
        assert len(impacts(result)) > 1
    # of all impacts none gives energy, and the books close
    assert np.min(np.diff(lost)) > -1e-13 and result.drift("balance") < 1e-12


@pytest.mark.parametrize("step", [2e-3, 1e-3])
def test_a_stop_between_bodies_that_tumble_gives_no_energy_and_with_e_1_takes_none(step: float) -> None:
    """Rates of directors at the end of a step are no motion of triads, and have energy of their own."""
    one = body("one", (0, 0, 0), inertia=(0.1, 0.2, 0.3), spin=(1.0, 2.0, -1.0))
    two = body("two", (1, 0.2, 0.1), mass=0.7, inertia=(0.09, 0.12, 0.2), spin=(1.0, 2.0, 3.0))
    joint = fb.RevoluteJoint(one.point((0.5, 0.1, 0.1)), two.point((-0.5, -0.1, 0.0)), "pivot", axis=(0.2, 0.3, 1),
                             stops=fb.Stops(-0.3, 0.3, restitution=1.0))
    result = run(fb.compile_scene(fb.Scene(one, two, joint, project_velocities=True), planar=False), 3.0, step, every=1)
    losses, size = np.diff(result.balance()["stops of joint 'pivot'"]), np.max(result.series["kinetic"])
    assert len(impacts(result)) > 3 and result.drift("balance") < 1e-12
    assert np.min(losses) > -1e-14 * size and np.max(losses) < 1e-11 * size


def test_a_stop_in_a_closed_loop_of_bodies_is_hit_and_holds() -> None:
    """A parallelogram that swings against the stop of its rocker, redundant in space: its crank stands as far."""
    p = np.array([[0.0, 0, 0], [0, 0, -0.4], [1, 0, -0.4], [1, 0, 0]])
    bars = [body(name, 0.5 * (p[k] + p[k + 1])) for k, name in enumerate(("crank", "coupler", "rocker"))]
    options: list[dict[str, Any]] = [{}, {}, {}, {"stops": fb.Stops(-0.1, 0.1, restitution=0.5)}]
    joints = [hinge(a, b, p[k], "ABCD"[k], **options[k]) for k, (a, b) in enumerate(zip([fb.GROUND, *bars], [*bars, fb.GROUND]))]
    scene = fb.Scene(*bars, *joints, fb.RigidMotion(bars[0], spin=(0, 4.0, 0), about=(0, 0, 0)), gravity=(0, 0, -G),
                     project_velocities=True)
    for planar in ("auto",):
        result = run(fb.compile_scene(scene, planar=planar), 1.5, 0.004, every=1)
        assert result.drift("balance") < 1e-12 and len(impacts(result)) >= 2 and result.info["fallbacks"] == 0
        np.testing.assert_allclose(result.joint("A")["angle"], -result.joint("D")["angle"], rtol=0.0, atol=1e-11)
        assert np.max(np.abs(result.joint("D")["angle"])) < 0.1 + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("what", ["angle", "distance"])
def test_impacts_friction_and_drives_between_two_bodies_in_flight_keep_momenta(what: str) -> None:
    a, b = body("a", (0.5, 0, 0), spin=(1, 2, 3), mass=2.0), body("b", (1.5, 0, 0.2), spin=(-1, 0, 1), velocity=(0, 0.5, 0.2))
    kind: Any = fb.RevoluteJoint if what == "angle" else fb.PrismaticJoint
    points = (a.point((1, 0, 0)), b.point((0, 0, -0.2))) if what == "angle" else (a.point((0.2, 0.1, 0)), b.point((0, 0.1, 0.3)))
    rubs = {"coefficient": 0.1, "length": 0.2, **({"radius": 0.05} if what == "angle" else {})}
    joint = kind(*points, "joint", axis=(0.3, 1.0, 0.2), stops=fb.Stops(-0.05, 0.05, restitution=0.7), **rubs,
                 drive=fb.Drive(force=lambda t, x, rate: 0.5 * np.sin(5.0 * t) - x - 0.1 * rate))
    model = fb.compile_scene(fb.Scene(a, b, joint, project_velocities=True))
    result = run(model, 1.0, 0.004, every=1)
    assert max(result.drift(name) for name in ("balance", "lin_mom", "ang_mom")) < 1e-13
    found = result.joint("joint")
    assert found["stop_loss"][-1] > 1e-3 and found["friction_loss"][-1] > 1e-4 and abs(found["work"][-1]) > 1e-4
    assert np.all(np.diff(found["friction_loss"]) >= 0.0) and len(impacts(result)) > 0


@pytest.mark.slow
def test_a_beam_that_swings_against_a_stop_of_its_hinge_keeps_its_books() -> None:
    section = fb.Section.circle(radius=0.02, E=1e8, rho=1000.0)
    beam = fb.Beam.straight("blade", (0, 0, 0), (1, 0, 0), section=section, elements=3)
    root = fb.RevoluteJoint(fb.GROUND, beam.start, "root", axis=(0, 1, 0), stops=fb.Stops(-0.1, 0.3, restitution=0.5))
    result = run(fb.compile_scene(fb.Scene(beam, root, gravity=(0, 0, -G))), 0.4, 0.002)
    joint = result.joint("root")
    assert result.drift("balance") < 1e-12 and len(impacts(result)) > 1
    assert joint["stop_loss"][-1] > 0.0 and -0.1 - 1e-9 < np.min(joint["angle"]) and np.max(joint["angle"]) < 0.3 + 1e-9


# ------------------------------------------------------------------------------------------ friction that follows the load
def bearing(t: float, y: Array, share: float) -> list[float]:
    """The arm whose friction is `share`, m, times the force on its pivot, iterated to the acceleration."""
    x, spin = y
    radial, tangent = np.array([np.cos(x), -np.sin(x)]), np.array([-np.sin(x), -np.cos(x)])
    rate = G * LEVER * np.cos(x) / INERTIA
    for _ in range(40):
        force = LEVER * (rate * tangent - spin**2 * radial) + [0.0, G]
        rate = (G * LEVER * np.cos(x) - share * np.linalg.norm(force) * np.sign(spin)) / INERTIA
    return [spin, rate]


@SPACE_AND_PLANE
def test_a_pendulum_in_a_journal_bearing_against_a_reference_integrator(planar: Any) -> None:
    coefficient, radius, t_end = 0.3, 0.1, 0.8
    exact = solve_ivp(bearing, (0, t_end), [0.0, 1e-12], args=(coefficient * radius,), method="DOP853", rtol=1e-10,
                      atol=1e-12).y[:, -1]
    errors = []
    model = arm(planar, coefficient=coefficient, radius=radius)
    for step in (0.01, 0.005):
        result = run(model, t_end, step)
        joint = result.joint("pivot")
        errors.append(abs(joint["angle"][-1] - exact[0]) + abs(joint["spin"][-1] - exact[1]))
        assert result.drift("balance") < 1e-13
    assert errors[1] < 1e-3 and np.log2(errors[0] / errors[1]) > 1.9
    # it comes to rest within the cone of friction, and stays there to the last bit
    result = run(model, 25.0, 0.01, every=1)
    joint = result.joint("pivot")
    x = joint["angle"][-1]
    assert np.ptp(joint["angle"][-50:]) == 0.0 and result.drift("balance") < 1e-13
    assert joint["torque"][-2] == pytest.approx(-G * LEVER * np.cos(x), rel=1e-9)
    assert abs(LEVER * np.cos(x)) <= coefficient * radius
    assert result.info["iterations"] < 4 * result.info["steps"] and np.all(np.diff(joint["friction_loss"]) >= 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("planar", [False, "auto"], ids=["space", "plane"])
def test_a_block_on_an_incline_slides_as_it_should_or_sticks_for_ever(planar: Any) -> None:
    for slope in (0.2, 0.5):
        block = body("block", (0.2, 0, 0.1))
        guide = fb.PrismaticJoint(fb.GROUND, block, "guide", axis=(1, 0, 0), coefficient=0.3)
        scene = fb.Scene(block, guide, gravity=(G * np.sin(slope), 0, -G * np.cos(slope)))
        result = run(fb.compile_scene(scene, planar=planar), 1.0, 0.01, every=1)
        joint = result.joint("guide")
        rate = max(G * (np.sin(slope) - 0.3 * np.cos(slope)), 0.0) if np.tan(slope) > 0.3 else 0.0
        np.testing.assert_allclose(joint["distance"], 0.5 * rate * result.t**2, rtol=0.0, atol=1e-14)
        assert result.drift("balance") < 1e-14
        force = -0.3 * G * np.cos(slope) if rate else -G * np.sin(slope)
        np.testing.assert_allclose(joint["force"][1:-1], force, rtol=1e-12)


@pytest.mark.slow
def test_a_guide_of_some_length_jams_where_it_is_pulled_too_far_beside() -> None:
    """A force at the distance e beside a guide of length l: F (1 - 2 mu e/l) is left, self-locking from mu = l/(2 e) on."""
    for arm_of_force, moves in ((0.1, True), (0.6, False)):
        block = body("block", (0, 0, 0))
        guide = fb.PrismaticJoint(fb.GROUND, block, "guide", axis=(1, 0, 0), coefficient=0.3, length=0.3)
        pull = fb.Load("pull", block.point((0, 0, arm_of_force)), force=(5.0, 0, 0))
        result = run(fb.compile_scene(fb.Scene(block, guide, pull), planar=False), 1.0, 0.01)
        rate = 5.0 * (1.0 - 2.0 * 0.3 * arm_of_force / 0.3) if moves else 0.0
        assert result.joint("guide")["distance"][-1] == pytest.approx(0.5 * rate, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("step", [0.01, 0.0025])
def test_a_joint_that_stopped_while_others_move_does_not_creep(step: float) -> None:
    axis = np.array([1.0, 1.0, 0.3]) / np.linalg.norm([1.0, 1.0, 0.3])
    one = body("one", (0.5, 0, 0))
    two = body("two", (1.5, 0, 0), spin=8.0 * axis, velocity=np.cross(8.0 * axis, (0.5, 0, 0)))
    scene = fb.Scene(one, two, hinge(fb.GROUND, one, (0, 0, 0), "free"), hinge(one, two, (1, 0, 0), "rubs", axis, friction=12.0),
                     gravity=(0, 0, -G))
    result = run(fb.compile_scene(scene, planar=False), 4.0, step, every=1)
    late = result.t > 0.1
    assert np.ptp(result.joint("rubs")["angle"]) > 0.1 and np.ptp(result.joint("rubs")["angle"][late]) == 0.0
    assert np.ptp(result.joint("free")["angle"][late]) > 0.5 and result.drift("balance") < 1e-13


# ---------------------------------------------------------------------------------------------------------- drives that push
def test_a_controller_with_a_largest_torque_against_a_reference_integrator() -> None:
    gain, damping, limit = 60.0, 6.0, 9.0

    def target(t: float) -> float:
        return 0.8 * t**2

    def torque(t: float, x: float, rate: float) -> float:
        return float(np.clip(gain * (target(t) - x) + damping * (1.6 * t - rate), -limit, limit))

    exact = solve_ivp(lambda t, y: [y[1], (torque(t, *y) + G * LEVER * np.cos(y[0])) / INERTIA], (0, 1.5), [0.0, 0.0],
                      method="DOP853", rtol=1e-10, atol=1e-12, max_step=1e-3).y[:, -1]
    errors = []
    drive = fb.Drive(position=target, stiffness=gain, damping=damping, limit=limit)
    for step in (0.005, 0.0025):
        result = run(arm("auto", drive=drive), 1.5, step, every=1)
        joint = result.joint("pivot")
        errors.append(abs(joint["angle"][-1] - exact[0]))
        assert result.drift("balance") < 1e-13 and np.max(np.abs(joint["drive"])) <= limit
        np.testing.assert_allclose(joint["work"], result.series["total"] - result.series["total"][0], rtol=0.0, atol=1e-11)
    assert errors[1] < 2e-5 and errors[0] / errors[1] > 3.0
    np.testing.assert_allclose(joint["drive"][-1], torque(1.5, joint["angle"][-1], joint["spin"][-1]), rtol=1e-9)


def test_a_speed_control_holds_its_speed_up_to_its_largest_torque_and_the_same_law_of_ones_own() -> None:
    """Against gravity that it can lift, and one that it cannot; a law of (t, angle, spin) is the same to the last bit."""
    ends = []
    law = fb.Drive(force=lambda t, x, rate: min(max(40.0 * (2.0 - rate), -30.0), 30.0))
    for drive in (fb.Drive(speed=2.0, damping=40.0, limit=30.0), law):
        result = run(arm("auto", drive=drive), 3.0, 0.005)
        # a walk of 600 steps of 30 N m times the last place of 6 rad is 7e-13 J
        assert abs(result.joint("pivot")["spin"][-1] - 2.0) < 0.2 and result.drift("balance") < 3e-13
        ends.append(result.state.q)
    np.testing.assert_allclose(ends[0], ends[1], rtol=0.0, atol=1e-9)
    weak = run(arm("auto", gravity=(0, 0, G), drive=fb.Drive(speed=2.0, damping=40.0, limit=1.0)), 3.0, 0.005).joint("pivot")
    assert np.max(weak["angle"]) < 0.5 and np.max(weak["drive"]) == 1.0


def test_a_controller_without_a_limit_is_of_order_four_by_two_runs() -> None:
    model = arm("auto", drive=fb.Drive(position=lambda t: t**4, stiffness=30.0, damping=2.0))
    ends = [run(model, 1.0, step, order=4).state.q for step in (0.04, 0.02, 0.005)]
    errors = [float(np.max(np.abs(q - ends[-1]))) for q in ends[:-1]]
    assert np.log2(errors[0] / errors[1]) > 3.7 and errors[1] < 1e-6


# ------------------------------------------------------------------------------------------------------- how-to/joints.md
@pytest.mark.slow
def test_the_recipe_runs() -> None:
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "joints.md").read_text(encoding="utf-8")
    recipe = page.split("A gate that a motor with a largest torque swings against its stops")[1].split("\n\n")[1]
    found: dict[str, Any] = {"fb": fb}
    exec(textwrap.dedent(recipe), found)
    gate = found["gate"].joint("hinge")
    assert found["gate"].drift("balance") < 1e-12 and gate["stop_loss"][-1] > 0.0 and gate["friction_loss"][-1] > 0.0


# ---------------------------------------------------------------------------------------------------------------- refusals
@pytest.mark.parametrize(("options", "text"), [
    ({"coefficient": 0.1}, "needs its radius; give radius="), ({"radius": 0.1}, "radius= is part of friction by the load"),
    ({"length": 0.1}, "length= is part of friction by the load"),
    ({"angle": 0.0, "coefficient": 0.1, "radius": 0.1}, "coefficient= has no effect"),
    ({"angle": 0.0, "drive": fb.Drive(force=1.0)}, "drive= has no effect"),
    ({"drive": fb.Drive(speed=1.0)}, "prescribe its motion by angle= or speed= of the joint"),
    ({"stops": fb.Stops(0.1, 0.2)}, "must enclose its"), ({"drive": 3.0}, "drive must be a Drive")])
def test_what_contradicts_each_other_is_refused(options: dict[str, Any], text: str) -> None:
    with pytest.raises(fb.SceneError, match=text):
        arm(**options)


def test_what_does_not_go_with_stops_friction_and_drives_says_so() -> None:
    stopped, rubbing = arm(stops=fb.Stops(-1, 1)), arm(coefficient=0.1, radius=0.1)
    driven = arm(drive=fb.Drive(position=0.1, stiffness=3.0, damping=0.1, limit=5.0))
    for model, text in ((stopped, "impacts on rigid stops of revolute joint 'pivot' would"),
                        (rubbing, "friction of revolute joint"),
                        (driven, "the drive of revolute joint 'pivot', which depends on its rate, would")):
        with pytest.raises(fb.SceneError, match=text):
            run(model, 0.1, 0.01, order=4)
    for model, text in ((stopped, "does not support rigid stops of joints; leave it out, give the stops a stiffness"),
                        (driven, "does not support motors and drives"), (rubbing, "does not support friction of joints")):
        with pytest.raises(fb.SceneError, match=text):
            fb.relax(model)
    with pytest.raises(fb.SceneError, match="numba cannot compile its drive's force.t, s, rate."):
        arm(drive=fb.Drive(force=lambda t, x, rate: float(str(x))))
