"""Equilibria of sliders with friction, drives and stops, and friction of the moments of sleeves, against exact answers."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.model.mapping import contact

sys.path.insert(0, str(Path(__file__).parent))
from test_slider_forces import G, rigid_rail  # noqa: E402

Array = np.ndarray
N = 0.01 * G * np.cos(np.pi / 6.0)


# --- a bead on a straight rail ------------------------------------------------------------------------------------------
@pytest.mark.parametrize("planar", ["auto", False])
def test_a_bead_on_an_incline_sticks_where_its_slope_is_below_the_coefficient(planar: Any) -> None:
    tangent = float(np.tan(np.radians(16.0)))
    result = fb.solve_static(rigid_rail(16.0, 1.0, planar, friction=1.0001 * tangent))
    found = result.info["friction"]["s"]
    assert result.state.s[0] == 1.0 and found["sticks"]
    assert found["force"] == pytest.approx(0.01 * G * np.sin(np.radians(16.0)), rel=1e-10)
    assert found["cone"] == pytest.approx(1.0001 * found["force"], rel=1e-10)
    np.testing.assert_allclose(result.slider("s")["friction_force"][-1], found["force"], rtol=1e-10)
    with pytest.raises(fb.ConvergenceError, match="'s' leaves its beam"):
        fb.solve_static(rigid_rail(16.0, 1.0, planar, friction=0.9999 * tangent))


def test_drives_and_stops_give_the_forces_that_they_must() -> None:
    weight = 0.5 * 0.01 * G
    elastic = fb.solve_static(rigid_rail(30.0, 1.0, stops=fb.Stops(0.5, 3.0, stiffness=100.0)))
    assert elastic.state.s[0] == pytest.approx(0.5 - weight / 100.0, rel=1e-12)
    assert elastic.slider("s")["stop_force"][-1] == pytest.approx(weight, rel=1e-9)
    rigid = fb.solve_static(rigid_rail(30.0, 1.0, stops=fb.Stops(0.5, 3.0)))
    assert rigid.state.s[0] == 0.5 and rigid.slider("s")["stop_force"][-1] == pytest.approx(weight, rel=1e-9)
    # a motor pushes it to the other one; with friction it stays where it is, or rests at the stop with what friction leaves
    motor = fb.Drive(force=0.06)
    pushed = fb.solve_static(rigid_rail(30.0, 1.0, stops=fb.Stops(0.5, 3.0), drive=motor))
    assert pushed.state.s[0] == 3.0 and pushed.slider("s")["stop_force"][-1] == pytest.approx(weight - 0.06, rel=1e-9)
    assert fb.solve_static(rigid_rail(30.0, 1.0, stops=fb.Stops(0.5, 3.0), drive=motor, friction=0.2)).state.s[0] == 1.0
    leaning = fb.solve_static(rigid_rail(30.0, 1.0, stops=fb.Stops(0.5, 3.0), friction=0.1))
    assert leaning.state.s[0] == 0.5 and leaning.slider("s")["stop_force"][-1] == pytest.approx(weight - 0.1 * N, rel=1e-9)
    # a prescribed place is approached with the load factor; a controller is a spring
    driven = fb.solve_static(rigid_rail(30.0, 1.0, drive=fb.Drive(position=lambda t: 1.0 + 2.0 * t)), at_time=0.5, levels=(0.5,))
    np.testing.assert_allclose(driven.slider("s")["s"][[driven.t.tolist().index(0.5), -1]], (1.5, 2.0), rtol=1e-14)
    assert driven.slider("s")["drive_force"][-1] == pytest.approx(weight, rel=1e-9)
    spring = fb.solve_static(rigid_rail(30.0, 1.0, drive=fb.Drive(position=2.0, stiffness=0.05)))
    assert spring.state.s[0] == pytest.approx(2.0 - weight / 0.05, rel=1e-9)
    # it is what makes that stable, in the plane and in space
    assert spring.info["unstable_directions"] == 0 and spring.info["free_directions"] == 0


@pytest.mark.parametrize("stiffness", [1e2, 1e4, 1e6])
@pytest.mark.parametrize("angle", [6.0, 35.0, 60.0])
def test_beads_rest_on_stiff_elastic_stops(angle: float, stiffness: float) -> None:
    """m g sin(angle)/k behind it, also where a law of the user's own is one."""
    weight = 0.01 * G * np.sin(np.radians(angle))
    stop = fb.solve_static(rigid_rail(angle, 1.0, stops=fb.Stops(0.5, 3.0, stiffness=stiffness)))
    law = fb.solve_static(rigid_rail(angle, 1.0, drive=fb.Drive(force=lambda t, s, v: stiffness * max(0.5 - s, 0.0))))
    for found in (stop, law):
        assert 0.5 - found.state.s[0] == pytest.approx(weight / stiffness, rel=1e-6, abs=1e-12)


def test_a_force_that_jumps_over_the_weight_is_named() -> None:
    with pytest.raises(fb.ConvergenceError, match=r"'s' is pushed.*near s = 0.5 m: the force of its drive jumps there"):
        fb.solve_static(rigid_rail(30.0, 1.0, drive=fb.Drive(force=lambda t, s, v: 0.2 if s < 0.5 else 0.0)))


def test_a_bead_on_a_soft_beam_rests_where_a_damped_run_ends() -> None:
    """On an elastic stop at each of many places of a beam that sags under it."""
    soft = fb.Section(EA=1e4, GA2=4e3, GA3=4e3, GJ=1, EI2=1, EI3=2, rhoA=.2, rhoI2=2e-5, rhoI3=3e-5, damping=5e-3)

    def held(at: float, *more: Any, **slider: Any) -> fb.Model:
        beam, bead = fb.Beam.straight("b", (0, 0, 0), (1.5, 0, 0), section=soft, elements=4), fb.PointMass("m", mass=0.2)
        stops = fb.Stops(at - 0.03, at + 0.03, stiffness=800.0)
        return fb.compile_scene(fb.Scene(beam, bead, fb.Clamp(beam.start), fb.Pin(beam.end), *(one(beam) for one in more),
                                         fb.Slider("s", bead, beam, at=at, stops=stops, **slider), gravity=(0, 0, -G)))

    rests = {at: fb.solve_static(held(at)) for at in (0.2, 0.26, 0.3, 0.36, 0.48, 0.54)}
    for at, rest in rests.items():
        s, force = rest.state.s[0], rest.slider("s")["stop_force"][-1]
        assert s > at + 0.03 and force == pytest.approx(-800.0 * (s - at - 0.03), rel=1e-9)
    settled = fb.simulate(held(0.3, lambda beam: fb.Drag("air", beam, linear=3.0), friction=fb.Friction(0.0, viscous=4.0)),
                          t_end=4.0, step=4e-3, every=100)
    assert settled.state.s[0] == pytest.approx(rests[0.3].state.s[0], abs=1e-8)


def test_a_spring_with_friction_has_an_interval_of_rest() -> None:
    def law(t: float, s: float, rate: float) -> float:
        return -0.05 * (s - 2.0)

    result = fb.solve_static(rigid_rail(30.0, 1.0, drive=fb.Drive(force=law), friction=0.2), rest_intervals=True)
    ends = 2.0 - (0.5 * 0.01 * G + np.array([1.0, -1.0]) * 0.2 * N) / 0.05
    np.testing.assert_allclose(result.info["rest_intervals"]["s"], ends, rtol=1e-9)
    assert result.state.s[0] == 1.0
    # from beyond it comes to the end that is nearer
    for at, end in ((0.2, ends[0]), (3.0, ends[1])):
        found = fb.solve_static(rigid_rail(30.0, at, drive=fb.Drive(force=law), friction=0.2))
        assert found.state.s[0] == pytest.approx(end, abs=1e-4) and ends[0] < found.state.s[0] < ends[1]


def pushed(mu: float, planar: Any = "auto", angle: float = 30.0) -> fb.Model:
    """A bead of 2 kg on a rigid rail at this angle (degrees) to the horizontal, pushed by t N along the horizontal."""
    a = np.radians(angle)
    section = fb.Section.circle(radius=0.05, E=200e9, rho=7800.0)
    rail = fb.Beam.straight("rail", (0, 0, 0), (4 * np.cos(a), 0, 4 * np.sin(a)), section=section, elements=4)
    bead = fb.PointMass("bead", mass=2.0)
    return fb.compile_scene(fb.Scene(rail, bead, *[fb.Clamp(rail.node(i)) for i in range(rail.n_nodes)], fb.Slider(
        "s", bead, rail, at=1.0, friction=mu), fb.Load("push", bead, force=(1, 0, 0), time=lambda t: t),
        gravity=(0, 0, -G)), planar=planar)


@pytest.mark.parametrize("planar", ["auto", False])
def test_an_interval_of_load_factors_in_which_a_bead_sticks(planar: Any) -> None:
    angle, friction = np.pi / 6.0, np.arctan(0.2)
    low, high = 2.0 * G * np.tan(angle - friction), 2.0 * G * np.tan(angle + friction)
    found = fb.stick_interval(pushed(0.2, planar), "s", at_time=(0.0, 1.0), load_factor=10.0, within=(-100.0, 100.0))
    print(f"off by {found.low / low - 1.0:.1e} and {found.high / high - 1.0:.1e}")
    assert found.low == pytest.approx(low, rel=1e-10) and found.high == pytest.approx(high, rel=1e-10)
    assert found.at_low.s[0] == found.at_high.s[0] == 1.0
    # beyond an angle of friction nothing pushes it up, and where the loads are looked at only so far it sticks there
    jammed = fb.stick_interval(pushed(2.0, planar), "s", at_time=(0.0, 1.0), load_factor=10.0, within=(-5.0, 1000.0))
    assert jammed.high == np.inf and jammed.low == -np.inf
    with pytest.raises(fb.ConvergenceError, match="no equilibrium was found at load factor 30"):
        fb.stick_interval(pushed(0.2, planar), "s", at_time=(0.0, 1.0), load_factor=30.0, within=(0.0, 100.0))


def test_intervals_of_load_factors_say_what_is_wrong() -> None:
    model = pushed(0.2)
    for words, given in (("no slider 't'", dict(slider="t")), ("must enclose load_factor=1", dict(within=(2.0, 3.0))),
                         ("at_time", dict(at_time=None)), ("has no Coulomb friction, or is locked", dict(held="s"))):
        with pytest.raises(fb.SceneError, match=words):
            fb.stick_interval(model, **{"slider": "s", "at_time": (0.0, 1.0), **given})


# --- a bead on an arc, a ring on a rope ---------------------------------------------------------------------------------
def arc(at: float, mu: float, planar: Any = "auto") -> tuple[fb.Model, float]:
    """A bead on a stiff arc of radius 2 m, and the arc length of its lowest point."""
    low, high = np.radians(-50.0), np.radians(80.0)
    start = (2.0 * np.sin(low), 0.0, 2.0 - 2.0 * np.cos(low))
    section = fb.Section(EA=1e8, GA2=1e8, GA3=1e8, GJ=1e6, EI2=1e6, EI3=1e6, rhoA=1.0, rhoI2=1.0, rhoI3=1.0)
    wire = fb.Beam.arc("wire", start, (np.cos(low), 0, np.sin(low)), (-np.sin(low), 0, np.cos(low)), radius=2.0,
                       angle=high - low, section=section, elements=16)
    bead = fb.PointMass("bead", mass=1.0)
    light = fb.Scene(wire, bead, fb.Clamp(wire.start), fb.Clamp(wire.end), fb.Slider("s", bead, wire, at=at, friction=mu),
                     gravity=(0, 0, -G))
    return fb.compile_scene(light, planar=planar), -2.0 * low


@pytest.mark.parametrize("planar", ["auto", False])
@pytest.mark.parametrize(("at", "mu"), [(4.0, 0.3), (0.5, 0.3), (2.0, 0.3), (1.0, 1.0)])
def test_a_bead_rests_on_an_arc_where_the_slope_is_at_most_the_coefficient(at: float, mu: float, planar: Any) -> None:
    model, lowest = arc(at, mu, planar)
    result = fb.solve_static(model, rest_intervals="s")
    reach = 2.0 * np.arctan(mu)
    # the wire bends by 1e-6 m
    np.testing.assert_allclose(np.array(result.info["rest_intervals"]["s"]) - lowest, (-reach, reach), atol=2e-5)
    found = result.state.s[0] - lowest
    if abs(at - lowest) < reach:
        assert result.state.s[0] == at and result.info["friction"]["s"]["sticks"]
    else:
        assert found == pytest.approx(np.sign(at - lowest) * reach, abs=4e-5) and abs(found) < reach
    assert result.info["unstable_directions"] == 0


@pytest.mark.parametrize("at", [4.0, 2.0])
def test_a_run_from_an_equilibrium_with_friction_sticks(at: float) -> None:
    model, _ = arc(at, 0.3)
    start = fb.solve_static(model).state
    run = fb.simulate(model, t_end=10.0, step=1e-3, every=100, start=start, progress=False)
    assert np.max(np.abs(run.slider("s")["s"] - start.s[0])) <= 1e-12 and run.info["steps"] == 10_000


def test_a_run_from_an_equilibrium_stays_at_stops_and_drives() -> None:
    rigid = rigid_rail(30.0, 1.0, stops=fb.Stops(0.5, 3.0), friction=0.1)
    driven = rigid_rail(30.0, 1.0, drive=fb.Drive(position=lambda t: 1.0 + t * t))
    for model, at in ((rigid, 0.5), (driven, 1.0)):
        start = fb.solve_static(model, at_time=0.0).state
        run = fb.simulate(model, t_end=0.1, step=1e-3, start=start, progress=False)
        assert start.s[0] == at
        np.testing.assert_allclose(run.slider("s")["s"], at if model is rigid else at + run.t**2, rtol=0.0, atol=1e-12)
        assert run.slider("s")["stop_force" if model is rigid else "drive_force"][0] > 0.0


def test_a_ring_on_a_rope_rests_as_far_as_held_ones_need_no_more_than_its_friction() -> None:
    section = fb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=5.0, EI2=5.0, EI3=5.0, rhoA=1.0, rhoI2=0.01, rhoI3=0.01)

    def ring(at: float, mu: float) -> fb.Model:
        rope = fb.Beam.straight("rope", (0, 0, 0), (3, 0, 0.2), section=section, elements=12, degree=2)
        mass = fb.PointMass("ring", mass=5.0)
        return fb.compile_scene(fb.Scene(rope, mass, fb.Pin(rope.start), fb.Pin(rope.end),
                                         fb.Slider("s", mass, rope, at=at, friction=mu), gravity=(0, 0, -G)))

    def needed(at: float) -> float:
        """Coefficient that holds the ring there."""
        model = ring(at, 0.0)
        state = fb.solve_static(model, held=True).state
        q = state.q.reshape(-1, 4, 3)
        t = contact(model, 0, at, q, q)[1]
        t /= np.linalg.norm(t)
        return float(state.force[:3] @ t / np.linalg.norm(np.cross(state.force[:3], t)))

    for at, mu in ((0.4, 0.05), (1.2, 0.2)):
        result = fb.solve_static(ring(at, mu), rest_intervals=("s",))
        low, high = result.info["rest_intervals"]["s"]
        assert low < result.state.s[0] < high
        assert needed(low) == pytest.approx(-mu, rel=1e-8) and needed(high) == pytest.approx(mu, rel=1e-8)


# --- the capstan --------------------------------------------------------------------------------------------------------
# T1/T2 of a cable of vanishing EI over N rings on a quarter of a circle, mu = 0.3: cot x - cot y = 2 mu, x + y = A/(2 N)
CAPSTAN = {1: 1.52370496884403, 5: 1.5986048747}
FAR = 1e4


def capstan(rings: int, per_length: int, **load: Any) -> tuple[fb.Model, Any]:
    """A cable with EI = 1, T = 1, so that it bends within 1 m; `per_length` elements on that. One piece for every ring, hinged in
    the middle between rings; a spring far away keeps the direction of the end that is not pulled. And its tension at a state."""
    angle, radius, parts, cables = 0.5 * np.pi, 50.0, [], []
    section = fb.Section(EA=1e5, GA2=1e5, GA3=1e5, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1e-3, rhoI2=1e-9, rhoI3=1e-9)
    half = radius * np.tan(angle / (2 * rings)) if rings > 1 else 16.0
    for k in range(rings):
        a = angle * (2 * k + 1) / (2 * rings)
        at, along = radius * np.array([np.sin(a), 1.0 - np.cos(a), 0.0]), np.array([np.cos(a), np.sin(a), 0.0])
        cable = fb.Beam.straight(f"cable {k}", at - half * along, at + half * along, section=section,
                                 elements=int(np.ceil(2.0 * half * per_length)), degree=3)
        ring = fb.PointMass(f"ring {k}", mass=1.0)
        parts += [cable, ring, fb.Pin(ring.center), fb.Slider(f"s{k}", ring, cable, at=half, friction=0.3)]
        parts += [fb.BallJoint(cables[-1].end, cable.start)] if cables else []
        cables.append(cable)
    place = np.array([cables[0].reference(0.0)[0][0, 0] - FAR, radius * (1.0 - np.cos(angle / (2 * rings))), 0.0])
    anchor = fb.PointMass("anchor", mass=1.0, position=place)
    model = fb.compile_scene(fb.Scene(*parts, anchor, fb.Pin(anchor.center), fb.Spring(
        cables[0].start, anchor.center, stiffness=0.5, length=FAR), fb.Load("pull", cables[-1].end, force=(0, 1, 0), **load)),
        planar=True)
    first = model.numbers.number(cables[0].start)
    return model, (lambda x: 0.5 * (np.linalg.norm(x[..., first, :] - place, axis=-1) - FAR))


@pytest.mark.parametrize(("rings", "per_length", "elements"), [(1, 10, 320), (5, 2, 160)])
def test_a_capstan_of_rings_in_statics(rings: int, per_length: int, elements: int) -> None:
    model, tension = capstan(rings, per_length)
    result = fb.solve_static(model, levels=(0.8, 0.9))
    # the rings slip through about an element between the levels
    for level in (0.8, 0.9, 1.0):
        ratio = level / tension(result.phi[result.t_snap.tolist().index(level)])
        print(f"{rings} rings, {elements} cubic elements: T1/T2 = {ratio:.6f}, off by {ratio / CAPSTAN[rings] - 1.0:.1e}")
        assert abs(ratio / CAPSTAN[rings] - 1.0) < 1e-4
    assert not any(x["sticks"] for x in result.info["friction"].values())
    if rings == 1:
        # let go, it slips back where the other side pulls as much more
        found = fb.stick_interval(model, "s0", start=result.state, within=(0.0, 2.0))
        ratio = found.low / tension(found.at_low.q.reshape(-1, 4, 3)[:, 0])
        print(f"on the way back T2/T1 = {1.0 / ratio:.6f}, off by {1.0 / ratio / CAPSTAN[1] - 1.0:.1e}; up to {found.high:.6f}")
        assert abs(ratio * CAPSTAN[1] - 1.0) < 1e-4 and 1.0 <= found.high < 1.0 + 3e-5


@pytest.mark.slow
@pytest.mark.parametrize(("rings", "per_length"), [(1, 10), (5, 2)])
def test_a_capstan_of_rings_in_slow_motion(rings: int, per_length: int) -> None:
    def pull(t: float) -> float:
        return 1.0 + 0.3 * (t / 100.0 - np.sin(2.0 * np.pi * t / 100.0) / (2.0 * np.pi))

    model, tension = capstan(rings, per_length, time=pull)
    start = fb.solve_static(model, at_time=0.0).state
    run = fb.simulate(model, t_end=100.0, step=0.5, start=start, output=fb.Output(snapshots=201), progress=False)
    ratio = np.array([pull(t) for t in run.t_snap]) / tension(run.phi) / CAPSTAN[rings] - 1.0
    print(f"{rings} rings: T1/T2 off by {np.mean(ratio):.1e} in the mean, {np.max(np.abs(ratio)):.1e} at most")
    assert np.max(np.abs(ratio)) < 1e-4 and abs(np.mean(ratio)) < 2e-5


# --- friction of the moments of a sleeve --------------------------------------------------------------------------------
def block(pull: float, beside: float, planar: Any = "auto", across: Any = (0.0, 0.0, 1.0), **sleeve: Any) -> fb.Model:
    """A block of 2 kg in a sleeve of 0.2 m on a rigid rail, pulled along it at a distance beside it."""
    section = fb.Section.circle(radius=0.05, E=200e9, rho=7800.0)
    rail = fb.Beam.straight("rail", (0, 0, 0), (4, 0, 0), section=section, elements=8)
    body = fb.RigidBody("block", mass=2.0, inertia=(0.1, 0.2, 0.3), position=(1, 0, 0))
    moment = beside * np.cross(across, (pull, 0, 0)) + sleeve.pop("twist", 0.0)
    load = fb.Load("pull", body.center, force=(pull, 0, 0), moment=moment)
    return fb.compile_scene(fb.Scene(rail, body, *[fb.Clamp(rail.node(i)) for i in range(rail.n_nodes)], fb.Sleeve(
        "s", body, rail, at=1.0, length=0.2, friction=0.2, **sleeve), load, gravity=(0, 0, -G)), planar=planar)


@pytest.mark.parametrize("planar", ["auto", False])
def test_a_block_in_a_sleeve_sticks_by_its_weight_and_by_its_moment(planar: Any) -> None:
    weight = 2.0 * G
    for pull, beside in ((3.0, 0.0), (5.0, 0.2), (-5.0, 0.2)):
        result = fb.solve_static(block(pull, beside, planar))
        found = result.info["friction"]["s"]
        assert found["cone"] == pytest.approx(0.2 * (weight + 2.0 * abs(pull) * beside / 0.2), rel=1e-9) and found["sticks"]
        assert found["force"] == pytest.approx(-pull, rel=1e-9) and result.state.s[0] == 1.0
    # mu < l/(2 e): it can be pulled away; mu > l/(2 e): it jams, however strong the pull
    with pytest.raises(fb.ConvergenceError, match="leaves its beam"):
        fb.solve_static(block(40.0, 0.4, planar))
    assert fb.solve_static(block(1e6, 0.6, planar)).info["friction"]["s"]["sticks"]


def test_moments_about_all_axes_press() -> None:
    result = fb.solve_static(block(3.0, 0.1, False, across=(0.0, 0.6, 0.8), twist=np.array([0.05, 0.0, 0.0]), key_radius=0.02))
    assert result.info["friction"]["s"]["cone"] == pytest.approx(0.2 * (2.0 * G + 2.0 * 0.3 / 0.2 + 0.05 / 0.02), rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("planar", ["auto", False])
@pytest.mark.parametrize(("pull", "beside"), [(5.0, 0.1), (20.0, 0.2), (1e4, 0.6)])
def test_a_block_in_a_sleeve_moves_as_it_must(pull: float, beside: float, planar: Any) -> None:
    result = fb.simulate(block(pull, beside, planar), t_end=0.3, step=1e-3, progress=False)
    excess = max(pull - 0.2 * (2.0 * G + 2.0 * pull * beside / 0.2), 0.0)
    np.testing.assert_allclose(result.slider("s")["s"], 1.0 + 0.25 * excess * result.t**2, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(result.slider("s")["friction_force"][1:], excess - pull, rtol=1e-8)
    assert result.drift("balance") < 1e-13
