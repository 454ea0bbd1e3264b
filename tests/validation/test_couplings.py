"""Screws and gears, theory.md (4.36): exact motions and equilibria, forces, conservation, large turns, analyses, wrong input."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb

Array = np.ndarray
G = 9.81
SPACE_AND_PLANE = pytest.mark.parametrize("planar", [False, "auto"], ids=["space", "plane"])
PITCH, LEAD = 0.02, 0.02 / (2.0 * np.pi)


def wheel(name: str, inertia: float, at: float = 0.0, spin: float = 0.0, mass: float = 1.0) -> fb.RigidBody:
    """A wheel in the plane y = 0, at `at` on the x axis, which turns about y."""
    return fb.RigidBody(name, mass=mass, inertia=(0.6 * inertia, inertia, 0.6 * inertia), position=(at, 0, 0), spin=(0, spin, 0))


def hinge(a: Any, b: fb.RigidBody, name: str, **options: Any) -> fb.RevoluteJoint:
    """A hinge at the centre of b."""
    side = a if a is fb.GROUND else a.point((np.asarray(b.position) - a.position) @ a.directors.T)
    return fb.RevoluteJoint(side, b, name, axis=(0, 1, 0), **options)


def pair(ratio: float, inertia: tuple[float, float] = (0.3, 0.05), spin: float = 0.0, **options: Any) -> fb.Scene:
    """Two wheels on the ground, and their gear; options: of both hinges, 'one' and 'two'."""
    one, two = wheel("a", inertia[0], 0.0, spin), wheel("b", inertia[1], 0.5, ratio * spin)
    joints = [hinge(fb.GROUND, body, name, **options.get(name, {})) for body, name in ((one, "one"), (two, "two"))]
    return fb.Scene(one, two, *joints, fb.GearCoupling(*joints, "gear", ratio=ratio))


def nut(inertia: float = 0.003, mass: float = 2.0, spin: float = 0.0, **options: Any) -> fb.Scene:
    body = fb.RigidBody("nut", mass=mass, inertia=(0.01, 0.01, inertia), position=(0, 0, 1.0), spin=(0, 0, spin),
                        velocity=(0, 0, LEAD * spin))
    return fb.Scene(body, fb.ScrewJoint(fb.GROUND, body, "thread", axis=(0, 0, 1), pitch=PITCH, **options), gravity=(0, 0, -G))


def run(scene: fb.Scene, t_end: float, step: float, planar: Any = "auto", **options: Any) -> fb.Result:
    return fb.simulate(fb.compile_scene(scene, planar=planar), t_end=t_end, step=step, progress=False, **options)


# ------------------------------------------------------------------------------------------------------------------ screws
def test_a_nut_on_a_screw_falls_with_its_reduced_acceleration() -> None:
    """a = g / (1 + I (2 pi/p)^2/m), to second order in the turn of a step; what the thread does is m (g - a) and I a 2 pi/p."""
    exact = G / (1.0 + 0.003 / (2.0 * LEAD**2))
    errors = []
    for step in (0.004, 0.002):
        result = run(nut(), 0.4, step, every=1)
        joint = result.joint("thread")
        errors.append(abs(joint["distance"][-1] + 0.5 * exact * 0.4**2))
        np.testing.assert_allclose(joint["distance"], LEAD * joint["angle"], rtol=0.0, atol=1e-15)
        assert result.drift("total") < 1e-14
        middle = len(result.t) // 2
        torque, force = joint["coupling"][middle]
        assert force == pytest.approx(2.0 * (G - exact), rel=1e-4)
        assert torque == pytest.approx(-LEAD * force, rel=1e-14)
    assert errors[1] < 2e-5 * 0.5 * exact * 0.4**2 and np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.02)


def test_a_nut_turns_many_times_in_large_steps() -> None:
    """A step turns by 0.4 rad: 100 turns up and down again, with the energy and the thread to round-off."""
    result = run(nut(spin=60.0), 20.0, 0.005, every=40)
    joint = result.joint("thread")
    assert np.max(joint["angle"]) > 200 * np.pi or np.min(joint["angle"]) < -200 * np.pi
    np.testing.assert_allclose(joint["distance"], LEAD * joint["angle"], rtol=0.0, atol=1e-13)
    assert result.drift("total") < 1e-12 and result.info["iterations"] < 4 * result.info["steps"]


def test_a_torque_of_weight_times_pitch_by_a_turn_holds_the_nut() -> None:
    weight = 2.0 * G
    sprung = fb.solve_static(fb.compile_scene(nut(stiffness=(0.5, 0.0))))
    joint = sprung.joint("thread")
    assert joint["angle"][-1] == pytest.approx(-weight * LEAD / 0.5, rel=1e-12)
    np.testing.assert_allclose(joint["coupling"][-1], (-weight * LEAD, weight), rtol=1e-12)
    # over several turns, which takes several steps
    held = fb.solve_static(fb.compile_scene(nut(angle=20.0)))
    joint = held.joint("thread")
    assert joint["distance"][-1] == pytest.approx(20.0 * LEAD, rel=1e-12)
    assert joint["torque"][-1] == pytest.approx(weight * LEAD, rel=1e-11)


@pytest.mark.parametrize("angle", [False, True], ids=["along", "about"])
def test_a_screw_on_springs_vibrates_with_the_reduced_mass(angle: bool) -> None:
    model = fb.compile_scene(nut(stiffness=(0.7, 0.0) if angle else (0.0, 900.0)))
    rest = fb.solve_static(model)
    found = fb.modes(model, n=1, state=rest.state)
    stiffness = 0.7 if angle else 900.0 * LEAD**2
    assert found.frequencies[0] == pytest.approx(np.sqrt(stiffness / (0.003 + 2.0 * LEAD**2)) / (2 * np.pi), rel=1e-11)
    assert rest.info["unstable_directions"] == rest.info["free_directions"] == 0


def test_a_screw_between_a_beam_and_a_body_in_flight_keeps_energy_and_momenta() -> None:
    section = fb.Section.circle(radius=0.02, E=1e7, rho=1000.0)
    beam = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=section, elements=3)
    body = fb.RigidBody("nut", mass=0.5, inertia=(0.02, 0.01, 0.015), position=(1.1, 0.02, 0), spin=(9.0, 0, 0),
                        velocity=(9.0 * LEAD, 0, 0))
    joint = fb.ScrewJoint(beam.end, body.point((0, -0.02, 0)), "thread", axis=(1, 0, 0), pitch=PITCH)
    result = run(fb.Scene(beam, body, joint, fb.RigidMotion(beam, velocity=(0, 0, 0)), project_velocities=True), 1.0, 0.01,
                 observe=("energy", "momentum", "joint"))
    assert max(result.drift(name) for name in ("total", "lin_mom", "ang_mom")) < 1e-12
    found = result.joint("thread")
    np.testing.assert_allclose(found["distance"], LEAD * found["angle"], rtol=0.0, atol=1e-14)
    assert abs(found["angle"][-1]) > 1.0 and result.info["fallbacks"] == 0


def test_a_left_hand_thread_goes_the_other_way_and_stops_hold_both_coordinates() -> None:
    """The nut bounces on a rigid stop of its distance: all of its energy is in the turn, and comes back."""
    body = fb.RigidBody("nut", mass=2.0, inertia=(0.01, 0.01, 0.003), position=(0, 0, 1.0))
    joint = fb.ScrewJoint(fb.GROUND, body, "thread", axis=(0, 0, 1), pitch=-PITCH,
                          stops=(None, fb.Stops(start=-0.01, restitution=1)))
    result = run(fb.Scene(body, joint, gravity=(0, 0, -G)), 1.2, 0.002, every=1)
    found = result.joint("thread")
    assert np.min(found["distance"]) == pytest.approx(-0.01, abs=1e-9) and np.max(found["angle"]) > 3.0
    np.testing.assert_allclose(found["distance"], -LEAD * found["angle"], rtol=0.0, atol=1e-15)
    assert result.drift("total") < 1e-12
    last = np.flatnonzero(result.t > 0.6)
    assert np.max(found["distance"][last]) > -1e-4


# ------------------------------------------------------------------------------------------------------------------- gears
@SPACE_AND_PLANE
def test_two_wheels_with_a_motor_have_their_reduced_inertia(planar: Any) -> None:
    """alpha = T/(I1 + r^2 I2); on the second wheel the gear does I2 r alpha, and the ground carries the rest."""
    ratio, torque = -3.0, 0.2
    exact = torque / (0.3 + ratio**2 * 0.05)
    errors = []
    for step in (0.02, 0.01):
        result = run(pair(ratio, one=dict(torque=torque)), 1.0, step, planar, every=1, observe=("energy", "joint", "reaction"))
        one, two = result.joint("one"), result.joint("two")
        errors.append(abs(one["angle"][-1] - 0.5 * exact))
        np.testing.assert_allclose(two["angle"], ratio * one["angle"], rtol=0.0, atol=1e-14)
        assert result.drift("balance") < 1e-14
        middle = len(result.t) // 2
        assert two["coupling"][middle] == pytest.approx(0.05 * ratio * exact, rel=1e-3)
        assert one["coupling"][middle] == pytest.approx(-ratio * two["coupling"][middle], rel=1e-14)
        moments = [result.reaction(name)["moment"][middle, 1] for name in ("one", "two")]
        np.testing.assert_allclose(moments, [one["coupling"][middle], two["coupling"][middle]], rtol=1e-12)
    assert errors[1] < 1e-4 and np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.05)
    assert (result.model_text.count("planar form") == 1) == (planar is False)


@SPACE_AND_PLANE
def test_a_gear_box_in_flight_keeps_energy_and_momenta(planar: Any) -> None:
    """A housing that nothing holds, wheels that start with the ratio: all of it turns, and the tooth forces are inner forces."""
    box = fb.RigidBody("box", mass=3.0, inertia=(0.2, 0.4, 0.3), position=(0.1, 0, -0.2), spin=(0, 0.7, 0),
                       velocity=(0.3, 0, 0.1))
    bodies = []
    for name, at, spin in (("a", (0.0, 0, 0), 5.0), ("b", (0.5, 0, 0.1), -10.0)):
        place = np.array(at) - box.position
        bodies.append(fb.RigidBody(name, mass=0.5, inertia=(0.02, 0.03, 0.02), position=at, spin=(0, 0.7 + spin, 0),
                                   velocity=box.velocity + np.cross((0, 0.7, 0), place)))
    joints = [hinge(box, body, name) for body, name in zip(bodies, ("one", "two"))]
    result = run(fb.Scene(box, *bodies, *joints, fb.GearCoupling(*joints, "gear", ratio=-2.0)), 4.0, 0.02, planar,
                 observe=("energy", "momentum", "joint"))
    assert max(result.drift(name) for name in ("total", "lin_mom", "ang_mom")) < 1e-13
    np.testing.assert_allclose(result.joint("two")["angle"], -2.0 * result.joint("one")["angle"], rtol=0.0, atol=1e-13)
    assert abs(result.joint("one")["angle"][-1]) > 6 * np.pi


def test_wheels_turn_a_thousand_radians_in_steps_of_more_than_half_a_radian() -> None:
    result = run(pair(-0.7, spin=6.0), 200.0, 0.1, every=20)
    one, two = result.joint("one")["angle"], result.joint("two")["angle"]
    assert one[-1] > 1000.0
    np.testing.assert_allclose(two, -0.7 * one, rtol=0.0, atol=1e-11)
    assert result.drift("total") < 1e-12 and result.info["fallbacks"] == 0


@SPACE_AND_PLANE
def test_a_rack_is_as_heavy_as_its_pinion_makes_it(planar: Any) -> None:
    """a = F/(m + I/r^2); the ratio of a rack is the radius of its pinion."""
    radius, push = 0.1, 3.0
    pinion, rack = wheel("pinion", 0.02), fb.RigidBody("rack", mass=2.0, inertia=(0.1, 0.1, 0.1), position=(0, 0, -radius))
    turns = hinge(fb.GROUND, pinion, "turns")
    slides = fb.PrismaticJoint(fb.GROUND, rack, "slides", axis=(1, 0, 0), force=push)
    result = run(fb.Scene(pinion, rack, turns, slides, fb.GearCoupling(turns, slides, "gear", ratio=-radius)), 0.5, 0.002, planar,
                 every=1)
    exact = push / (2.0 + 0.02 / radius**2)
    slides_, turns_ = result.joint("slides"), result.joint("turns")
    assert slides_["distance"][-1] == pytest.approx(0.5 * exact * 0.25, rel=1e-5)
    np.testing.assert_allclose(slides_["distance"], -radius * turns_["angle"], rtol=0.0, atol=1e-15)
    assert slides_["coupling"][100] == pytest.approx(2.0 * exact - push, rel=1e-4) and result.drift("balance") < 1e-14


@SPACE_AND_PLANE
def test_two_wheels_on_springs_have_one_frequency(planar: Any) -> None:
    """omega^2 = (k1 + r^2 k2)/(I1 + r^2 I2)."""
    ratio = 2.5
    model = fb.compile_scene(pair(ratio, one=dict(stiffness=3.0), two=dict(stiffness=7.0)), planar=planar)
    found = fb.modes(model, n=1)
    exact = np.sqrt((3.0 + ratio**2 * 7.0) / (0.3 + ratio**2 * 0.05)) / (2 * np.pi)
    assert found.frequencies[0] == pytest.approx(exact, rel=1e-11)


def test_shafts_with_a_gear_between_them_have_the_frequency_of_the_reduced_system() -> None:
    """Wheels at the free ends of two shafts of GJ/L = k1 and k2 without inertia, geared at the others: next to the free turn
    there is one mode, of the reduced inertias I1 and r^2 I2 on the springs k1 and r^2 k2 in a row."""
    ratio, GJ = -2.0, (4.0, 6.0)  # noqa: N806
    inertia, length = (0.03, 0.02), 0.5
    parts: list[Any] = []
    hinges = []
    for k, name in enumerate(("one", "two")):
        section = fb.Section(EA=1e6, GA2=1e6, GA3=1e6, GJ=GJ[k], EI2=1e4, EI3=1e4, rhoA=1e-9, rhoI2=1e-12, rhoI3=1e-12)
        beam = fb.Beam.straight(f"shaft {name}", (0, 0, 0.4 * k), (length, 0, 0.4 * k), section=section, elements=1, degree=1)
        body = fb.RigidBody(f"wheel {name}", mass=1.0, inertia=(inertia[k], 0.6 * inertia[k], 0.6 * inertia[k]),
                            position=(length, 0, 0.4 * k))
        far = fb.CylindricalJoint(fb.GROUND, body, f"far {name}", axis=(1, 0, 0))
        hinges.append(fb.RevoluteJoint(fb.GROUND, beam.start, name, axis=(1, 0, 0)))
        parts += [beam, body, fb.RigidConnection(beam.end, body), hinges[-1], far]
    model = fb.compile_scene(fb.Scene(*parts, fb.GearCoupling(*hinges, "gear", ratio=ratio)))
    found = fb.modes(model, n=2)
    k1, k2 = GJ[0] / length, ratio**2 * GJ[1] / length
    i1, i2 = inertia[0], ratio**2 * inertia[1]
    exact = np.sqrt(1.0 / (1.0 / k1 + 1.0 / k2) * (1.0 / i1 + 1.0 / i2)) / (2 * np.pi)
    assert found.frequencies[0] < 1e-3 and found.frequencies[1] == pytest.approx(exact, rel=1e-6)


@SPACE_AND_PLANE
def test_a_planetary_gear_obeys_willis(planar: Any) -> None:
    """A sun with a motor, a planet on a carrier, and a fixed ring: the carrier turns by zs/(zs + zr) of the sun, and all inertias
    act on the motor in the squares of their ratios."""
    zs, zp, zr = 20.0, 15.0, 50.0
    arm, torque = 0.35, 0.5
    of_carrier, of_planet = zs / (zs + zr), zs / (zs + zr) * (1.0 - zr / zp)
    sun, carrier = wheel("sun", 0.02), wheel("carrier", 0.05)
    planet = wheel("planet", 0.01, arm, mass=0.8)
    first = hinge(fb.GROUND, carrier, "carrier hinge")
    on = [hinge(carrier, sun, "sun hinge"), hinge(carrier, planet, "planet hinge")]
    # the torque on the sun, from the ground
    scene = fb.Scene(carrier, sun, planet, first, *on, fb.Load("motor", sun, moment=(0, torque, 0)),
                     fb.GearCoupling(*on, "outer", ratio=-zs / zp),
                     # the ring stands still: seen from the carrier it turns back
                     fb.GearCoupling(first, on[1], "inner", ratio=-zr / zp))
    result = run(scene, 1.0, 0.005, planar)
    turned = result.joint("carrier hinge")["angle"]
    of_sun = turned + result.joint("sun hinge")["angle"]
    np.testing.assert_allclose(turned, of_carrier * of_sun, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(turned + result.joint("planet hinge")["angle"], of_planet * of_sun, rtol=0.0, atol=1e-13)
    reduced = 0.02 + of_carrier**2 * (0.05 + 0.8 * arm**2) + of_planet**2 * 0.01
    assert of_sun[-1] == pytest.approx(0.5 * torque / reduced, rel=1e-3) and result.drift("balance") < 1e-12


def test_a_given_angle_of_one_wheel_turns_the_other() -> None:
    def angle(t: float) -> float:
        return 3.0 * t**2

    result = run(pair(-4.0, one=dict(angle=angle)), 2.0, 0.005, every=1)
    one, two = result.joint("one"), result.joint("two")
    np.testing.assert_allclose(two["angle"], -4.0 * 3.0 * result.t**2, rtol=0.0, atol=1e-12)
    assert one["torque"][200] == pytest.approx(6.0 * (0.3 + 16.0 * 0.05), rel=1e-2)
    assert two["coupling"][200] == pytest.approx(-24.0 * 0.05, rel=1e-2) and result.drift("balance") < 1e-12
    rest = fb.solve_static(fb.compile_scene(pair(-4.0, one=dict(angle=2.5), two=dict(stiffness=0.3))))
    assert rest.joint("two")["angle"][-1] == pytest.approx(-10.0, rel=1e-13)
    assert rest.joint("one")["torque"][-1] == pytest.approx(16.0 * 0.3 * 2.5, rel=1e-12)


@pytest.mark.parametrize(("spring", "unstable"), [(1.2, 0), (0.8, 1)])
def test_a_pendulum_on_its_head_stands_as_long_as_the_geared_spring_is_stiff_enough(spring: float, unstable: int) -> None:
    """m g L = 1 against r^2 k."""
    ratio = 2.0
    top = fb.RigidBody("top", mass=1.0 / G, inertia=(0.1, 0.1, 0.1), position=(0, 0, 1.0))
    other = wheel("b", 0.05, 0.5)
    joints = [fb.RevoluteJoint(fb.GROUND, top.point((0, 0, -1)), "one", axis=(0, 1, 0)),
              hinge(fb.GROUND, other, "two", stiffness=spring / ratio**2)]
    model = fb.compile_scene(fb.Scene(top, other, *joints, fb.GearCoupling(*joints, "gear", ratio=ratio), gravity=(0, 0, -G)))
    assert fb.solve_static(model).info["unstable_directions"] == unstable


def test_friction_of_one_wheel_holds_both_up_to_its_torque() -> None:
    """r M on the first wheel, or I1 + r^2 I2 on what is left of the motor."""
    ratio, most = 2.0, 0.1
    stuck = run(pair(ratio, one=dict(torque=0.99 * ratio * most), two=dict(friction=most)), 0.5, 0.01)
    np.testing.assert_allclose(stuck.joint("one")["angle"], 0.0, atol=1e-14)
    slips = run(pair(ratio, one=dict(torque=0.3), two=dict(friction=most)), 0.5, 0.005)
    exact = (0.3 - ratio * most) / (0.3 + ratio**2 * 0.05)
    assert slips.joint("one")["angle"][-1] == pytest.approx(0.5 * exact * 0.25, rel=2e-2)
    assert slips.joint("two")["friction_loss"][-1] == pytest.approx(most * slips.joint("two")["angle"][-1], rel=1e-12)
    assert slips.drift("balance") < 1e-13


# ---------------------------------------------------------------------------------------------------- starts and velocities
def test_velocities_that_a_gear_does_not_allow_are_refused_projected_or_mended() -> None:
    """A wheel that turns meets one at rest: I1 w1 = (I1 + r^2 I2) w."""
    ratio = -3.0

    def scene(**options: Any) -> fb.Scene:
        found = pair(ratio)
        one, two = wheel("a", 0.3, 0.0, 4.0), wheel("b", 0.05, 0.5)
        joints = [hinge(fb.GROUND, one, "one"), hinge(fb.GROUND, two, "two")]
        assert len(found.parts) == 5
        return fb.Scene(one, two, *joints, fb.GearCoupling(*joints, "gear", ratio=ratio), **options)

    with pytest.raises(fb.SceneError, match="gear coupling 'gear': the initial velocities violate it by 12 rad/s"):
        fb.compile_scene(scene())
    result = run(scene(project_velocities=True), 0.1, 0.01)
    expected = 0.3 * 4.0 / (0.3 + ratio**2 * 0.05)
    assert result.joint("one")["spin"][0] == pytest.approx(expected, rel=1e-12)
    model = fb.compile_scene(pair(ratio))
    start = model.state()
    start.v[:] = fb.compile_scene(fb.Scene(*[x for x in scene().parts if not isinstance(x, fb.GearCoupling)])).state().v
    with pytest.raises(fb.SceneError, match="gear coupling 'gear': the rate of its coordinates is"):
        fb.simulate(model, t_end=0.1, step=0.01, start=start, progress=False)
    mended = fb.simulate(model, t_end=0.1, step=0.01, start=fb.Start(start, mend=True), progress=False)
    assert mended.joint("one")["spin"][0] == pytest.approx(expected, rel=1e-12)


def test_a_state_with_a_wrong_ratio_is_refused_and_one_of_a_run_goes_on() -> None:
    scene = pair(-3.0, spin=5.0)
    model = fb.compile_scene(scene)
    whole = fb.simulate(model, t_end=4.0, step=0.02, progress=False)
    half = fb.simulate(model, t_end=2.0, step=0.02, progress=False)
    rest = fb.simulate(model, t_end=4.0, step=0.02, start=fb.Start(half.state, time=2.0), progress=False)
    np.testing.assert_allclose(rest.state.q, whole.state.q, rtol=0.0, atol=1e-12)
    assert rest.joint("two")["angle"][-1] == pytest.approx(-60.0, abs=0.5)
    other = fb.compile_scene(pair(-2.9, spin=5.0))
    with pytest.raises(fb.SceneError, match="start: gear coupling 'gear': its coordinates are .* rad off"):
        fb.simulate(other, t_end=3.0, step=0.02, start=fb.Start(half.state_for(other), time=2.0), progress=False)


def test_a_checkpoint_goes_on_to_the_last_bit(tmp_path: Path) -> None:
    model, path = fb.compile_scene(pair(-3.0, spin=5.0, one=dict(torque=0.1))), tmp_path / "half"
    whole = fb.simulate(model, t_end=1.0, step=0.02, progress=False)
    fb.simulate(model, t_end=0.5, step=0.02, progress=False, output=fb.Output(checkpoint=path))
    rest = fb.simulate(fb.compile_scene(pair(-3.0, spin=5.0, one=dict(torque=0.1))), t_end=1.0, step=0.02,
                       start=fb.load_checkpoint(path), progress=False)
    assert np.array_equal(rest.state.q, whole.state.q) and np.array_equal(rest.state.v, whole.state.v)


# ---------------------------------------------------------------------------------------------------------- other analyses
def geared(k: float = 3.0, ratio: float = 2.0, pull: float = 0.5) -> Any:
    """A bent beam that turns a wheel by a hinge at its end, which is geared to a wheel on a spring."""
    section = fb.Section(EA=1e4, GA2=4e3, GA3=5e3, GJ=4.0, EI2=5.0, EI3=6.0, rhoA=1.0, rhoI2=0.02, rhoI3=0.03)
    beam = fb.Beam.straight("arm", (0, 0, 0), (1, 0, 0), section=section, elements=2)
    one, two = wheel("a", 0.1, 1.0), wheel("b", 0.05, 2.0)
    joints = [fb.RevoluteJoint(beam.end, one, "one", axis=(0, 1, 0)), hinge(fb.GROUND, two, "two", stiffness=k)]
    scene = fb.Scene(beam, one, two, fb.Clamp(beam.start), *joints, fb.GearCoupling(*joints, "gear", ratio=ratio),
                     fb.Load("pull", beam.end, force=(0, 0, -2.0)), fb.Load("turn", one, moment=(0, pull, 0)))
    return scene, {"tip": beam.end, "rim": one.point((0.2, 0, 0.1))}


def test_equilibria_have_their_derivatives() -> None:
    found = fb.sensitivity(geared, {"k": 3.0, "ratio": 2.0, "pull": 0.5})

    def rim(**values: float) -> Array:
        scene, points = geared(**values)
        return np.asarray(fb.solve_static(fb.compile_scene(scene), points=points).point("rim")[-1])

    for name, value in (("k", 3.0), ("ratio", 2.0), ("pull", 0.5)):
        e = 1e-3 * value
        steps = [rim(**{name: value + n * e}) - rim(**{name: value - n * e}) for n in (1, 2)]
        slope = (8.0 * steps[0] - steps[1]) / (12.0 * e)
        np.testing.assert_allclose(found.point("rim")[name], slope, rtol=1e-6, atol=1e-9 * np.abs(slope).max())


def test_runs_have_their_gradients() -> None:
    draw = np.random.default_rng(5)
    given = {name: draw.standard_normal((21, 3)) for name in ("tip", "rim")}

    def go(**values: float) -> Any:
        scene, points = geared(**values)
        return fb.adjoint_run(fb.compile_scene(scene), t_end=0.2, step=0.01, points=points)

    def weighed(**values: float) -> float:
        one = go(**values)
        return sum(float(np.sum(w * one.point(p))) for p, w in given.items())

    found = go()
    for name, value in (("k", 3.0), ("ratio", 2.0), ("pull", 0.5)):
        e = 1e-3 * value
        first, second = (weighed(**{name: value + n * e}) - weighed(**{name: value - n * e}) for n in (1, 2))
        slope = found.gradient(points=given, build=geared, values={"k": 3.0, "ratio": 2.0, "pull": 0.5}).by[name]
        assert slope == pytest.approx((8.0 * first - second) / (12.0 * e), rel=1e-6), name


def test_relaxation_comes_to_rest_where_the_equilibrium_is() -> None:
    scene, points = geared()
    model = fb.compile_scene(scene)
    rest = fb.solve_static(model, points=points)
    found = fb.relax(model, points=points)
    np.testing.assert_allclose(found.point("rim")[-1], rest.point("rim")[-1], atol=1e-9)
    path = fb.solve_path(model, points=points)
    np.testing.assert_allclose(path.state.q, rest.state.q, atol=1e-9)


def test_filters_and_step_control_keep_the_ratio_and_the_balance() -> None:
    scene, _ = geared()
    model = fb.compile_scene(scene)
    for options in (dict(method=fb.Method(rho_inf=0.7)), dict(tolerance=1e-5)):
        result = fb.simulate(model, t_end=0.3, step=0.01, progress=False, **options)
        one, two = result.joint("one")["angle"], result.joint("two")["angle"]
        np.testing.assert_allclose(two, 2.0 * one, rtol=0.0, atol=1e-14)
        assert np.max(np.abs(one)) > 1e-3 and result.drift("balance") < 1e-11


def test_friction_holds_a_gear_in_an_equilibrium() -> None:
    """A wheel with friction under a torque on the other, below its limit and beyond."""
    held = fb.solve_static(fb.compile_scene(pair(2.0, one=dict(torque=0.15), two=dict(friction=0.1))))
    assert held.joint("one")["angle"][-1] == 0.0 and held.joint("two")["torque"][-1] == pytest.approx(-0.075, rel=1e-12)
    slips = fb.solve_static(fb.compile_scene(pair(2.0, one=dict(torque=0.5, stiffness=3.0), two=dict(friction=0.1))))
    # with the reserve of friction that a joint has where it comes to rest, theory.md 8
    assert slips.joint("one")["angle"][-1] == pytest.approx((0.5 - 2.0 * 0.1 * (1.0 - 1e-5)) / 3.0, rel=1e-9)


def test_a_step_of_order_four_takes_gears_and_other_methods_do_not() -> None:
    scene = pair(-2.0, spin=3.0, one=dict(stiffness=4.0))
    model = fb.compile_scene(scene)
    exact = 3.0 / np.sqrt(4.0 / 0.5) * np.sin(np.sqrt(4.0 / 0.5))
    ends = [fb.simulate(model, t_end=1.0, step=step, order=4, progress=False).joint("one")["angle"][-1] for step in (0.02, 0.01)]
    assert abs(ends[1] - exact) < 1e-6 and np.log2(abs((ends[0] - exact) / (ends[1] - exact))) > 3.5
    for name in ("midpoint", "generalized_alpha"):
        with pytest.raises(fb.SceneError, match="does not support .*gear coupling 'gear'"):
            fb.simulate(model, t_end=0.1, step=0.01, method=name, progress=False)


# ---------------------------------------------------------------------------------------------------------------- messages
def test_what_leads_out_of_a_plane_is_in_space() -> None:
    scene = nut()
    assert fb.compile_scene(scene).plane is None
    with pytest.raises(fb.SceneError, match=r"screw joint 'thread' \(thread\) leads out of the plane"):
        fb.compile_scene(scene, planar=True)


def test_couplings_that_cannot_be_are_refused_by_name() -> None:
    bodies = [wheel(name, 0.1, x) for name, x in (("a", 0.0), ("b", 0.5), ("c", 1.0))]
    free = [hinge(fb.GROUND, body, name) for body, name in zip(bodies, ("one", "two", "three"))]
    given = [hinge(fb.GROUND, body, name, speed=1.0) for body, name in zip(bodies, ("one", "two", "three"))]
    rough = [hinge(fb.GROUND, body, name, friction=1.0) for body, name in zip(bodies, ("one", "two", "three"))]
    gear = fb.GearCoupling
    for parts, message in (
            ((free[0], gear(free[0], free[1], "g", ratio=2.0)),
             "gear coupling 'g': revolute joint 'two' is not in scene 'scene'; add it to the scene"),
            ((*given[:2], gear(*given[:2], "g", ratio=2.0)),
             "gear coupling 'g': revolute joint 'one' is prescribed and revolute joint 'two' is prescribed, but"),
            ((given[0], free[1], rough[2], gear(given[0], free[1], "g", ratio=2.0), gear(free[1], rough[2], "h", ratio=2.0)),
             "gear coupling 'h': revolute joint 'one' is prescribed and revolute joint 'three' has friction, but"),
            ((*free, *(gear(free[i], free[j], f"g{i}", ratio=2.0) for i, j in ((0, 1), (1, 2), (2, 0)))),
             "gear coupling 'g2': other couplings relate both coordinates already"),
            ((fb.ScrewJoint(fb.GROUND, bodies[0], "s", axis=(0, 0, 1), pitch=0.1, speed=(1.0, 2.0)),),
             r"screw joint 's' \(thread\): angle of screw joint 's' is prescribed and distance of screw joint 's' is")):
        with pytest.raises(fb.SceneError, match=message):
            fb.Scene(*bodies, *parts).check()
