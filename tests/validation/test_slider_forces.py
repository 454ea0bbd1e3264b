"""Friction, drives and stops of sliders against exact answers, and the balance of energies with all of them."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from exchange import balanced, exchanged, unit_of_strains

import fastbeam as fb
from fastbeam.kernels import loop as kernels
from fastbeam.kernels.contact.coulomb import MOST_FLIPS
from fastbeam.kernels.contact.slider_forces import AGAINST
from fastbeam.scene.slider_forces import initial_rate
from fastbeam.stepping.stepper import Stepper

G = 9.81
# light: its nodes are held, the weight of steel would add nothing but its round-off to the balance
STIFF = fb.Section.circle(radius=0.05, E=200e9, rho=1.0)
SOFT = fb.Section.circle(radius=0.01, E=1e8, rho=1000.0)
# N: the force on 0.01 kg in steps of 1 ms is a second difference of places up to 4 m, which are known to their last place; some
# thirty of these are seen, in steps of any size
LAST_PLACE = 128.0 * 0.01 * np.spacing(4.0) / 1e-3**2
DENSE = fb.Section.circle(radius=0.01, E=1e6, rho=1000.0)


def rigid_rail(angle: float, at: float, planar: Any = "auto", mass: float = 0.01, gravity: float = G, **forces: Any) -> fb.Model:
    """A mass on a straight rail of 4 m, all nodes of which are clamped, at this angle (degrees) to the horizontal."""
    a = np.radians(angle)
    rail = fb.Beam.straight("rail", (0, 0, 0), (4 * np.cos(a), 0, 4 * np.sin(a)), section=STIFF, elements=4)
    bead = fb.PointMass("bead", mass=mass)
    scene = fb.Scene(rail, bead, *[fb.Clamp(rail.node(i)) for i in range(rail.n_nodes)],
                     fb.Slider("s", bead, rail, at=at, **forces), gravity=(0, 0, -gravity))
    return fb.compile_scene(scene, planar=planar)


def run(model: Any, t_end: float, step: float = 1e-3, **settings: Any) -> fb.Result:
    return fb.simulate(model, t_end=t_end, step=step, every=1, progress=False, **settings)


# --- friction -----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("planar", ["auto", False])
def test_a_bead_that_sticks_does_not_creep(planar: Any) -> None:
    result = run(rigid_rail(16.0, 1.0, planar, friction=0.3), 2.0)
    bead = result.slider("s")
    assert np.array_equal(bead["s"], np.full(len(result.t), 1.0))
    np.testing.assert_allclose(bead["friction_force"], 0.01 * G * np.sin(np.radians(16.0)), rtol=0, atol=LAST_PLACE)
    assert bead["friction_loss"][-1] == 0.0


@pytest.mark.slow
def test_a_bead_sticks_for_a_hundred_thousand_steps() -> None:
    model = rigid_rail(16.0, 1.0, friction=0.3)
    result = fb.simulate(model, t_end=100.0, step=1e-3, every=1000, progress=False)
    assert np.max(np.abs(result.slider("s")["s"] - 1.0)) <= 1e-12


@pytest.mark.parametrize("planar", ["auto", False])
def test_a_bead_slides_down_an_incline_as_it_must(planar: Any) -> None:
    angle = np.radians(30.0)
    result = run(rigid_rail(30.0, 3.9, planar, friction=0.3), 1.0)
    fall = 0.5 * G * (np.sin(angle) - 0.3 * np.cos(angle)) * result.t**2
    np.testing.assert_allclose(result.slider("s")["s"], 3.9 - fall, atol=1e-12)
    np.testing.assert_allclose(result.slider("s")["friction_force"][1:], 0.3 * 0.01 * G * np.cos(angle), rtol=0,
                               atol=LAST_PLACE)
    np.testing.assert_allclose(result.slider("s")["friction_loss"], 0.3 * 0.01 * G * np.cos(angle) * fall, atol=1e-12)
    assert balanced(result)


def test_a_bead_comes_to_rest_where_friction_has_taken_its_energy() -> None:
    # up an incline that holds it: the way errs by the part of a step in which it stops
    angle = np.radians(10.0)
    for step in (1e-2, 1e-3):
        result = run(rigid_rail(10.0, 1.0, friction=0.3, rate=2.0), 1.5, step)
        way = 2.0**2 / (2.0 * G * (np.sin(angle) + 0.3 * np.cos(angle)))
        bead = result.slider("s")
        assert abs(bead["s"][-1] - 1.0 - way) < 1.3 * step**2
        at_rest = bead["s"] == bead["s"][-1]
        assert at_rest.sum() > 0.4 * len(at_rest) and balanced(result)
        # nothing alternates once it rests
        np.testing.assert_allclose(bead["friction_force"][at_rest][5:], 0.01 * G * np.sin(angle), rtol=1e-6)


def seesaw(planar: Any) -> fb.Model:
    """Five beads that stop one after the other on a beam on a hinge with a spring and a damper."""
    rod = fb.Section.circle(radius=0.01, E=200e9, rho=7800.0, damping=2e-3)
    beam = fb.Beam.straight("beam", (-1, 0, 0), (1, 0, 0), section=rod, elements=4)
    hub = fb.RigidBody("hub", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0, 0, 0))
    hinge = fb.RevoluteJoint(fb.GROUND, hub, "hinge", axis=(0, 1, 0), stiffness=60.0, damping=4.0)
    beads = [fb.PointMass(f"m{k}", mass=0.05 + 0.02 * k) for k in range(5)]
    sliders = [fb.Slider(f"s{k}", bead, beam, at=at, rate=rate, friction=mu) for k, (bead, at, rate, mu) in enumerate(zip(
        beads, (0.3, 0.6, 1.2, 1.5, 1.8), (0.8, -0.6, 0.7, 0.5, -0.4), (0.15, 0.2, 0.3, 0.4, 0.6)))]
    return fb.compile_scene(fb.Scene(beam, hub, hinge, fb.RigidConnection(hub, beam.node(beam.n_nodes // 2)), *beads, *sliders,
                                     fb.Load("weight", beam.end, force=(0, 0, -2.0)), gravity=(0, 0, -G)), planar=planar)


@pytest.mark.slow
@pytest.mark.parametrize("planar", ["auto", False])
def test_beads_that_stop_beside_others_come_to_rest_to_the_last_bit(planar: Any) -> None:
    # one that was turned around within a step kept 1.5e-3 m/s, which changed its sign in every step, and so 0.16 N of friction
    result = run(seesaw(planar), 4.0, 5e-3)
    late, stopped = result.t > 3.0, []
    for k in range(5):
        bead = result.slider(f"s{k}")
        moved = np.flatnonzero(np.diff(bead["s"]))
        stopped.append(result.t[moved[-1] + 1])
        assert np.ptp(bead["s"]) > 1e-3 and np.ptp(bead["s"][late]) == 0.0
        # what the beam moves across them is left
        assert np.max(np.abs(bead["slide_rate"][late])) < 1e-5
        assert np.max(np.abs(np.diff(bead["friction_force"][late], 2)[:-2])) < 1e-5
    assert max(stopped) < 1.5 and len(set(stopped)) == 5 and balanced(result)


def test_friction_never_puts_energy_in() -> None:
    # a force that turns the bead around within few steps, many times
    def shake(t: float) -> float:
        return 0.2 * np.sign(np.sin(300.0 * t))

    result = run(rigid_rail(0.0, 2.0, friction=0.5, drive=fb.Drive(force=shake)), 0.5, 2e-3)
    loss = result.slider("s")["friction_loss"]
    # the bead moves by 1e-3 of its distance from the origin: as many digits of its velocities are gone
    assert np.all(np.diff(loss) >= 0.0) and loss[-1] > 0.0 and balanced(result, 1e-11)


def test_rotor_with_friction_of_the_side_force() -> None:
    """r'' = w^2 r - 2 mu w r' on a rod that a heavy hub keeps turning; exact: r(2) and r'(2) from the roots of the equation."""
    w, mu, t, r0 = 2.0, 0.3, 2.0, 0.1
    roots = w * (-mu + np.array([1.0, -1.0]) * np.sqrt(1.0 + mu**2))
    share = r0 * np.array([-roots[1], roots[0]]) / (roots[0] - roots[1])
    exact, rate = share @ np.exp(roots * t), (share * roots) @ np.exp(roots * t)
    assert abs(exact - 1.26251415275267) < 1e-13 and abs(rate - 1.87801011772984) < 1e-13

    def end(step: float) -> float:
        rod = fb.Beam.straight("rod", (0, 0, 0), (3, 0, 0), section=fb.Section.circle(radius=0.05, E=1e15, rho=1e-6), elements=4)
        hub = fb.RigidBody("hub", mass=1.0, inertia=(1e10,) * 3, position=(0, 0, 0))
        bead = fb.PointMass("bead", mass=1.0)
        scene = fb.Scene(rod, hub, bead, fb.Pin(hub), fb.RigidConnection(hub, rod.start),
                         fb.RigidMotion((rod, hub, bead), spin=(0, 0, w)),
                         fb.Slider("s", bead, rod, at=r0, rate=0.0, friction=mu))
        return float(run(fb.compile_scene(scene), t, step).slider("s")["s"][-1])

    errors = np.array([end(step) for step in (0.02, 0.01, 0.005, 0.0025)]) - exact
    rates = np.log2(np.abs(errors[:-1] / errors[1:]))
    assert np.all(np.abs(rates - 2.0) < 0.02)
    # what two extrapolations in the step leave
    once = (4.0 * errors[1:] - errors[:-1]) / 3.0
    assert abs((16.0 * once[2] - once[1]) / 15.0) < 1e-8


def test_viscous_friction_slows_down_exponentially() -> None:
    model = rigid_rail(0.0, 1.0, gravity=0.0, mass=0.5, rate=1.0, friction=fb.Friction(viscous=0.4))
    result = run(model, 2.0, 1e-3)
    np.testing.assert_allclose(result.slider("s")["s"], 1.0 + 0.5 / 0.4 * (1.0 - np.exp(-0.8 * result.t)), atol=1e-7)
    np.testing.assert_allclose(result.slider("s")["friction_loss"][-1], 0.25 * (1.0 - np.exp(-3.2)), rtol=1e-6)
    assert balanced(result)


def test_smoothed_friction_tends_to_coulomb_and_creeps() -> None:
    exact = run(rigid_rail(30.0, 3.9, friction=0.3), 0.5).slider("s")["s"][-1]
    errors = [abs(run(rigid_rail(30.0, 3.9, friction=fb.Friction(0.3, smoothing=v)), 0.5).slider("s")["s"][-1] - exact)
              for v in (1e-2, 1e-3)]
    assert errors[1] < 0.2 * errors[0] < 1e-3
    result = run(rigid_rail(10.0, 1.0, friction=fb.Friction(0.3, smoothing=1e-2)), 1.0)
    # mu cos tanh(v/v_s) = sin
    creep = 1e-2 * np.arctanh(np.tan(np.radians(10.0)) / 0.3)
    np.testing.assert_allclose(result.slider("s")["slide_rate"][-1], -creep, rtol=1e-4)


# --- drives -------------------------------------------------------------------------------------------------------------
def test_prescribed_position_needs_the_force_of_newton() -> None:
    def position(t: float) -> float:
        return 2.0 + 0.5 * np.sin(3.0 * t)

    result = run(rigid_rail(0.0, 2.0, mass=0.3, drive=fb.Drive(position=position)), 1.0)
    bead = result.slider("s")
    np.testing.assert_allclose(bead["s"], 2.0 + 0.5 * np.sin(3.0 * result.t), atol=1e-12)
    np.testing.assert_allclose(bead["drive_force"], -0.3 * 4.5 * np.sin(3.0 * result.t), atol=2e-5)
    np.testing.assert_allclose(bead["slide_rate"][[0, -1]], 1.5 * np.cos(3.0 * result.t[[0, -1]]), atol=1e-5)
    # what it did is what the bead has
    np.testing.assert_allclose(bead["drive_work"], result.series["kinetic"] - result.series["kinetic"][0], atol=1e-13)
    assert balanced(result)


def test_prescribed_speed_against_friction_and_gravity() -> None:
    angle = np.radians(30.0)
    result = run(rigid_rail(30.0, 1.0, friction=0.3, drive=fb.Drive(speed=0.7)), 1.0)
    bead = result.slider("s")
    force = 0.01 * G * (np.sin(angle) + 0.3 * np.cos(angle))
    np.testing.assert_allclose(bead["s"], 1.0 + 0.7 * result.t, atol=1e-12)
    np.testing.assert_allclose(bead["drive_force"], force, rtol=0, atol=LAST_PLACE)
    np.testing.assert_allclose(bead["drive_work"][-1], 0.7 * force, rtol=1e-9)
    np.testing.assert_allclose(bead["friction_loss"][-1], 0.7 * 0.3 * 0.01 * G * np.cos(angle), rtol=1e-9)
    assert balanced(result)


@pytest.mark.parametrize("kind", ["law", "controller"])
def test_a_spring_and_damper_as_a_law_and_as_a_controller(kind: str) -> None:
    mass, k, c = 0.5, 20.0, 0.6
    drives = {"law": fb.Drive(force=lambda t, s, rate: -20.0 * (s - 2.0) - 0.6 * rate),
              "controller": fb.Drive(position=2.0, stiffness=k, damping=c)}
    w, decay = np.sqrt(k / mass - (c / (2 * mass))**2), c / (2 * mass)

    def error(step: float) -> float:
        result = run(rigid_rail(0.0, 2.3, gravity=0.0, mass=mass, drive=drives[kind]), 1.0, step)
        assert balanced(result)
        exact = 2.0 + 0.3 * np.exp(-decay * result.t) * (np.cos(w * result.t) + decay / w * np.sin(w * result.t))
        return float(np.max(np.abs(result.slider("s")["s"] - exact)))

    errors = [error(step) for step in (4e-3, 2e-3, 1e-3)]
    assert errors[2] < 2e-5 and np.all(np.abs(np.log2(np.array(errors[:-1]) / errors[1:]) - 2.0) < 0.02)


def test_a_controller_gives_no_more_than_its_limit() -> None:
    drive = fb.Drive(position=3.0, stiffness=100.0, limit=0.5)
    result = run(rigid_rail(0.0, 1.0, gravity=0.0, mass=0.5, drive=drive), 0.5)
    np.testing.assert_allclose(result.slider("s")["s"], 1.0 + 0.5 * result.t**2, atol=1e-12)
    np.testing.assert_allclose(result.slider("s")["drive_force"], 0.5, rtol=1e-14)


def test_forces_of_time_have_order_four() -> None:
    def end(step: float) -> float:
        drive = fb.Drive(force=lambda t: np.sin(8.0 * t))
        model = rigid_rail(0.0, 2.0, gravity=0.0, mass=0.5, drive=drive, rate=0.0)
        return float(run(model, 0.8, step, order=4).slider("s")["s"][-1])

    # m s'' = sin(8 t)
    exact = 2.0 + (0.8 / 8.0 - np.sin(6.4) / 64.0) / 0.5
    errors = np.abs(np.array([end(step) for step in (0.2, 0.1, 0.05)]) - exact)
    assert np.all(np.log2(errors[:-1] / errors[1:]) > 3.7)


# --- stops --------------------------------------------------------------------------------------------------------------
def test_an_elastic_stop_returns_the_bead_after_half_a_period() -> None:
    m, k = 0.5, 2000.0
    result = run(rigid_rail(0.0, 2.0, gravity=0.0, mass=m, rate=1.0, stops=fb.Stops(end=2.5, stiffness=k)), 1.2, 1e-4)
    s = result.slider("s")["s"]
    # in contact from 0.5 s on for pi sqrt(m/k), then back
    np.testing.assert_allclose(s[-1], 2.5 - (1.2 - 0.5 - np.pi * np.sqrt(m / k)), atol=1e-6)
    np.testing.assert_allclose(s.max(), 2.5 + np.sqrt(m / k), atol=1e-6)
    np.testing.assert_allclose(result.slider("s")["stop_energy"].max(), 0.5 * m, rtol=1e-5)
    assert result.drift("total") < 1e-12 and result.is_conserved("total")


@pytest.mark.parametrize("planar", ["auto", False])
@pytest.mark.parametrize("restitution", [1.0, 0.5, 0.0])
def test_a_bead_bounces_on_a_rigid_stop(planar: Any, restitution: float) -> None:
    angle = np.radians(60.0)
    fall = G * np.sin(angle)
    model = rigid_rail(60.0, 2.0, planar, stops=fb.Stops(1.0, 3.0, restitution=restitution))
    result = run(model, 1.5)
    bead, first = result.slider("s"), np.sqrt(2.0 / fall)
    impacts = [x["time"] for x in result.events if x["kind"] == "impact"]
    assert abs(impacts[0] - first) < 1e-9 and balanced(result)
    speed, t = restitution * fall * first, first
    if restitution == 1.0:
        # thrown up twice
        late = 1.5 - 3.0 * first
        np.testing.assert_allclose(bead["s"][-1], 1.0 + speed * late - 0.5 * fall * late**2, atol=1e-8)
        assert abs(bead["stop_loss"][-1]) < 1e-14
        return
    for impact in impacts[1:5]:
        t += 2.0 * speed / fall
        speed *= restitution
        assert abs(impact - t) < 1e-8
    assert abs(bead["s"][-1] - 1.0) < 1e-9 and abs(bead["slide_rate"][-1]) < 1e-9
    np.testing.assert_allclose(bead["stop_force"][-1], 0.01 * fall, rtol=1e-9)
    np.testing.assert_allclose(bead["stop_loss"][-1], 0.01 * fall, rtol=1e-8)


def test_a_bead_leaves_its_stop_when_it_is_pulled_away() -> None:
    drive = fb.Drive(force=lambda t: -0.1 if t < 0.5 else 0.05)
    result = run(rigid_rail(0.0, 1.0, gravity=0.0, stops=fb.Stops(1.0, 3.0), drive=drive), 1.0)
    bead = result.slider("s")
    early, late = result.t <= 0.5, result.t > 0.5 + 2e-3
    np.testing.assert_allclose(bead["s"][early], 1.0, atol=1e-9)
    np.testing.assert_allclose(bead["s"][-1], 1.0 + 0.5 * 5.0 * 0.25, atol=1e-6)
    np.testing.assert_allclose(bead["stop_force"][early][:-2], 0.1, rtol=1e-8)
    assert np.all(bead["stop_force"][late] == 0.0) and balanced(result)


# --- flexible beams: everything at once ---------------------------------------------------------------------------------
def flying(planar: Any = "auto", body: bool = False, section: fb.Section = SOFT, **forces: Any) -> fb.Model:
    """A free beam in motion, in space out of a plane, and what slides on it."""
    across = 0.0 if planar == "auto" else 1.0
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0.2), section=section, elements=4)
    point: Any = fb.PointMass("point", mass=0.2)
    parts: list[Any] = [point]
    if body:
        along = np.array([1.0, 0.0, 0.2]) / np.sqrt(1.04)
        drive = forces.get("drive")
        rate = initial_rate(drive, "s") if drive is not None and drive.is_prescribed else forces.get("rate", 0.0)
        point = fb.RigidBody("body", mass=0.2, inertia=(1e-3, 2e-3, 2.5e-3), position=0.4 * along + (0, 0, 0.1),
                             velocity=rate * along + (0.0, across * np.cos(1.2), np.sin(1.2)))
        parts, point = [point], point.point((0, 0, -0.1))
    spin = fb.InitialVelocity(beam, velocity=lambda s: np.stack((0.0 * s, across * np.cos(3 * s), np.sin(3 * s)), axis=1))
    return fb.compile_scene(fb.Scene(beam, *parts, spin, fb.Slider("s", point, beam, at=0.4, **forces),
                                     project_velocities=body), planar=planar)


ALL: dict[str, dict[str, Any]] = {
    "friction": dict(rate=1.0, friction=0.3),
    "viscous": dict(rate=1.0, friction=fb.Friction(0.1, viscous=0.3)),
    "smoothed": dict(rate=1.0, friction=fb.Friction(0.3, smoothing=0.01)),
    "speed": dict(drive=fb.Drive(speed=lambda t: 1.0 - 5.0 * t)),
    "position": dict(drive=fb.Drive(position=lambda t: 0.4 + 0.3 * np.sin(5.0 * t)), friction=0.2),
    "force": dict(drive=fb.Drive(force=lambda t: np.sin(20.0 * t)), friction=0.1),
    "law": dict(drive=fb.Drive(force=lambda t, s, rate: -20.0 * (s - 0.5) - 0.1 * rate), friction=0.1),
    "controller": dict(drive=fb.Drive(position=0.5, stiffness=20.0, damping=0.1, limit=0.5), friction=0.1),
    "elastic stops": dict(rate=2.0, stops=fb.Stops(0.2, 0.6, stiffness=500.0), friction=0.05),
    "rigid stops": dict(rate=2.0, stops=fb.Stops(0.2, 0.6, restitution=0.6), friction=0.05),
}


@pytest.mark.parametrize("body", [False, True], ids=["mass", "body"])
@pytest.mark.parametrize("planar", ["auto", False], ids=["plane", "space"])
@pytest.mark.parametrize("name", ALL)
def test_balance_and_momenta_with_a_flying_beam(name: str, planar: Any, body: bool) -> None:
    result = run(flying(planar, body, **ALL[name]), 0.2)
    # behind an impact waves store 0.1 J in strains; round-off of these in 200 steps is more than 1e-12 of what the stop exchanges
    walk = 2.0 * np.sqrt(200.0) * unit_of_strains(SOFT, np.sqrt(1.04), 4, float(np.max(result.series["strain"])))
    least = walk / exchanged(result) if name == "rigid stops" else 0.0
    assert balanced(result, 1e-12 + least) and result.drift("balance") < 1e-12
    assert result.drift("lin_mom") < 1e-13 and result.drift("ang_mom") < 1e-12
    assert result.drift("gap") < 1e-14 and np.ptp(result.slider("s")["s"]) > 0.01
    assert not [x for x in result.events if x["kind"] not in ("impact", "projected", "coarse", "massless")]


@pytest.mark.parametrize("name", ALL)
def test_plane_and_space_agree(name: str) -> None:
    flat, deep = (fb.compile_scene(fb.Scene(
        beam := fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0.2), section=DENSE, elements=3), fb.Pin(beam.start), fb.Pin(beam.end),
        mass := fb.PointMass("point", mass=0.05), fb.Slider("s", mass, beam, at=0.4, **ALL[name]), gravity=(0, 0, -G)),
        planar=planar) for planar in ("auto", False))
    one, two = (run(model, 0.1) for model in (flat, deep))
    np.testing.assert_allclose(one.slider("s")["s"], two.slider("s")["s"], atol=1e-9)
    np.testing.assert_allclose(one.slider("s")["friction_loss"], two.slider("s")["friction_loss"], atol=1e-9)


@pytest.mark.parametrize("name", ALL)
def test_a_run_goes_on_bit_for_bit(name: str, tmp_path: Any) -> None:
    model = flying(**ALL[name])
    whole = run(model, 0.1)
    run(model, 0.05, output=fb.Output(checkpoint=tmp_path / "c"))
    rest = run(model, 0.1, start=fb.load_checkpoint(tmp_path / "c"))
    if name == "rigid stops":
        # steps are counted anew from an impact on, so that the half run ends with another step; tests/dynamics/test_impacts.py
        np.testing.assert_allclose(rest.state.s, whole.state.s, atol=1e-3)
        return
    for x, y in zip(rest.state, whole.state):
        assert np.array_equal(x, y)


def test_a_slider_that_sticks_goes_on_sticking_from_its_bare_state() -> None:
    # the shaking turns it around within steps
    model = rigid_rail(0.0, 2.0, friction=0.5,
                       drive=fb.Drive(force=lambda t: 0.2 * np.sign(np.sin(300.0 * t)) if t < 0.1 else 0.02))
    for t in (0.110, 0.112, 0.114, 0.116):
        half = run(model, t, 2e-3)
        # what that leaves of its velocity is taken away
        assert abs(half.slider("s")["slide_rate"][-1]) < 1e-9
        rest = run(model, t + 0.02, 2e-3, start=fb.Start(half.state, time=t))
        assert np.array_equal(rest.slider("s")["s"], np.full(len(rest.t), half.state.s[0]))
    # one that moves does not stick where it turns around
    moving = rigid_rail(0.0, 2.0, friction=0.5, rate=1.0)
    half = run(moving, 0.05, 1e-3)
    back = run(moving, 0.1, 1e-3, start=fb.Start(half.state._replace(v=-half.state.v), time=0.05))
    assert back.slider("s")["s"][-1] < half.state.s[0] - 0.01


@pytest.mark.parametrize("planar", ["auto", False])
@pytest.mark.parametrize("flips", [0, MOST_FLIPS])
def test_friction_goes_there_and_back(flips: int, planar: Any) -> None:
    """Steps backward in time undo those before, also where the sign of the velocity is in doubt and friction is continuous."""
    model = flying(planar, rate=0.02 if flips else 1.0, friction=0.3)
    stepper = Stepper(model, np.ones(1))
    start = stepper.copy_state()

    def go(h: float, n: int) -> None:
        for _ in range(n):
            stepper.parts.start(h)
            stepper.along.coulomb.flips[:] = flips
            iterate(stepper, h)
            stepper.parts.finish(h)

    go(1e-3, 5)
    assert abs(stepper.state.s[0] - start.s[0]) > 1e-5 and stepper.state.history[1] > 0.0
    go(-1e-3, 5)
    # velocities err by round-off of positions over the step, as without friction
    for x, y, limit in zip(stepper.state[:3], start[:3], (1e-13, 2e-10, 1e-14)):
        np.testing.assert_allclose(x, y, rtol=0.0, atol=limit)
    assert abs(stepper.state.history[1]) < 1e-14


def iterate(stepper: Stepper, h: float) -> None:
    """Newton's method around the compiled solver, its parts called one by one."""
    stepper._augment(h)
    for _ in range(25):
        kernels.assemble_all(*stepper.records, h)
        kernels.fill_right(*stepper.records)
        assert kernels.solve_right(*stepper.records)
        if stepper.parts.update() < 1e-14 and kernels.all_settled(*stepper.records):
            return
    raise AssertionError("it did not converge")


def test_a_slider_in_doubt_stays_at_its_stop() -> None:
    # pulled away, so that it leaves; where signs go in circles it waits for the next step
    for flips, leaves in ((0, True), (MOST_FLIPS, False)):
        stepper = Stepper(rigid_rail(0.0, 1.0, gravity=0.0, stops=fb.Stops(1.0, 3.0), drive=fb.Drive(force=0.1), friction=0.2),
                          np.ones(1))
        # a step there and back: rows of sliders have their room behind it
        start = stepper.save()
        stepper.advance(0.0, 1e-3, 1)
        stepper.load(start)
        stepper.core_state.history[AGAINST] = -1.0
        stepper.parts.start(1e-3)
        stepper.along.coulomb.flips[:] = flips
        iterate(stepper, 1e-3)
        stepper.parts.finish(1e-3)
        assert (stepper.state.s[0] > 1.0) == leaves and (stepper.state.history[AGAINST] == 0.0) == leaves


def test_a_run_that_records_energies_alone_has_its_balance() -> None:
    model = flying(**ALL["rigid stops"])
    alone, whole = (run(model, 0.15, observe=observe) for observe in (("energy",), ("energy", "slider")))
    assert "s_slide" not in alone.series and np.ptp(alone.series["stop_loss"]) > 0.0
    assert balanced(alone, 2e-12) and balanced(whole, 2e-12)
    for name, x in whole.balance().items():
        np.testing.assert_array_equal(alone.balance()[name], x)
    with pytest.raises(fb.SceneError, match="observe=.'energy'"):
        run(model, 0.01, observe=("slider",)).balance()


def test_friction_on_a_soft_cable_converges_in_the_step() -> None:
    def end(step: float) -> float:
        cable = fb.Beam.straight("cable", (0, 0, 0), (1, 0, 0), section=DENSE, elements=2)
        bead = fb.PointMass("bead", mass=0.05)
        scene = fb.Scene(cable, bead, fb.Clamp(cable.start), fb.Pin(cable.end),
                         fb.Slider("s", bead, cable, at=0.3, rate=0.8, friction=0.2), gravity=(0, 0, -1.0))
        return float(run(fb.compile_scene(scene), 0.2, step).slider("s")["s"][-1])

    fine = end(2.5e-5)
    errors = np.abs(np.array([end(step) for step in (2e-3, 1e-3, 5e-4, 2.5e-4)]) - fine)
    assert np.all(errors[1:] < 0.5 * errors[:-1]) and errors[-1] < 1e-5


def test_step_control_and_threads_take_forces_along_the_beam() -> None:
    result = fb.simulate(flying(rate=1.0, friction=0.3), t_end=0.1, step=1e-3, tolerance=1e-6, progress=False)
    assert balanced(result)
    nodes = np.array([[x, y, 0.0] for y in (0.0, 1.0) for x in (0.0, 1.0, 2.0)])
    edges = np.array([[0, 1], [1, 2], [3, 4], [4, 5], [0, 3], [1, 4], [2, 5]])
    net = fb.Net("net", nodes, edges, section=DENSE, elements=3, pins=(0, 2, 3, 5))
    bead = fb.PointMass("bead", mass=0.02)
    scene = fb.Scene(net, bead, fb.Slider("s", bead, net.beam(0), at=0.4, rate=0.5, friction=0.2), gravity=(0, 0, -1.0))
    results = [run(fb.compile_scene(scene, condense=condense), 0.05, solver=fb.Solver(threads=threads))
               for condense, threads in ((True, 1), (True, 2), (False, None))]
    assert all(balanced(x) for x in results)
    assert np.array_equal(results[0].state.q, results[1].state.q)
    np.testing.assert_allclose(results[0].slider("s")["s"], results[2].slider("s")["s"], atol=1e-11)


def test_loads_that_change_and_moments_have_an_account() -> None:
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0.2), section=SOFT, elements=3)
    body = fb.RigidBody("body", mass=0.3, inertia=(1e-3, 2e-3, 2e-3), position=(1, 0, 0.2))
    scene = fb.Scene(beam, body, fb.Clamp(beam.start), fb.RigidConnection(beam.end, body),
                     fb.Load("shake", body.center, force=(0, 1, 1), moment=(0, 0.1, 0.05), time=lambda t: np.sin(30.0 * t)),
                     fb.Load("twist", beam.node(3), moment=(0.02, 0, 0)), gravity=(0, 0, -G), gravity_time=lambda t: 1.0 + t)
    for order in (2, 4):
        result = run(fb.compile_scene(scene), 0.2, order=order)
        assert balanced(result) and result.info["conserved"] == ["gap", "balance"]
        assert abs(result.balance()["loads"][-1]) > 1e-2
