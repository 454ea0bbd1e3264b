"""Steady vibrations under harmonic loads and bases, and damped modes, against closed forms and runs in time."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg as dense

import fastbeam as fb
from fastbeam.results.mode_shapes import DampedModes

Array = np.ndarray
L, EA, GA, EI, RHO_A, RHO_I = 2.0, 1e4, 4e3, 30.0, 1.3, 0.01


def section(**changes: Any) -> fb.Section:
    return fb.Section(**dict(EA=EA, GA2=GA, GA3=GA, GJ=20.0, EI2=EI, EI3=EI, rhoA=RHO_A, rhoI2=RHO_I, rhoI3=RHO_I) | changes)


def bar(degree: int = 5, elements: int = 8, **changes: Any) -> fb.Beam:
    return fb.Beam.straight("bar", (0, 0, 0), (L, 0, 0), section=section(**changes), elements=elements, degree=degree)


def twice(w: float, h: float) -> float:
    """The frequency, Hz, at which a conserving step of size h vibrates as a scene at w does."""
    return float(2.0 / h * np.tan(0.5 * w * h) / (2.0 * np.pi))


def nearest(found: DampedModes, rate: complex) -> float:
    return float(np.min(np.abs(found.rates - rate)) / abs(rate))


# --- closed forms ---------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("planar", [True, False])
def test_viscous_bar_with_a_mass_at_its_end(planar: bool) -> None:
    """E -> E (1 + i w tau): u = A sin k x under a force at the mass, cos k x + B sin k x on a base that moves."""
    tau, mass, f = 2e-3, 0.7, np.array([0.0, 3.0, 11.0, 40.0])
    beam = bar(damping=tau)
    end = fb.PointMass("mass", mass=mass, position=(L, 0, 0))
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), end, fb.BallJoint(beam.end, end)), planar=planar)
    points = {"tip": end, "inside": (beam, 0.53 * L)}
    w = 2.0 * np.pi * f
    modulus = EA * (1.0 + 1j * w * tau)
    k = w * np.sqrt(RHO_A / modulus)
    with np.errstate(all="ignore"):
        a = 2.0 / (modulus * k * np.cos(k * L) - w**2 * mass * np.sin(k * L))
        b = (modulus * k * np.sin(k * L) + w**2 * mass * np.cos(k * L)) / (
            modulus * k * np.cos(k * L) - w**2 * mass * np.sin(k * L))
    forced = fb.frequency_response(model, f, loads=fb.Load("push", end, force=(2.0, 0, 0)), points=points)
    np.testing.assert_allclose(forced.point("tip")[1:, 0], (a * np.sin(k * L))[1:], rtol=1e-9)
    np.testing.assert_allclose(forced.point("inside")[1:, 0], (a * np.sin(0.53 * k * L))[1:], rtol=1e-7)
    assert forced.point("tip")[0, 0] == pytest.approx(2.0 * L / EA, rel=1e-11)
    assert np.max(np.abs(forced.point("tip")[:, 1:])) < 1e-14 and np.max(forced.residuals) < 1e-11
    moved = fb.frequency_response(model, f, base=(1e-3, 0, 0), points=points)
    np.testing.assert_allclose(moved.point("tip")[1:, 0], 1e-3 * (np.cos(k * L) + b * np.sin(k * L))[1:], rtol=1e-8)
    assert moved.point("tip")[0, 0] == pytest.approx(1e-3, rel=1e-11)
    assert moved.info["moves_in"] == ("plane" if planar else "space")


def timoshenko(w: float, factor: complex) -> Array:
    """(deflection, turn, moment, shear force) at the start to those at the end."""
    a = np.array([[0, 1, 0, 1 / (GA * factor)], [0, 0, 1 / (EI * factor), 0], [0, -RHO_I * w * w, 0, -1],
                  [-RHO_A * w * w, 0, 0, 0]], complex)
    return np.asarray(dense.expm(a * L))


@pytest.mark.parametrize(("damping", "loss_factor"), [(1e-3, 0.0), (0.0, 0.05), (2e-4, 0.02)])
def test_cantilever_on_a_shaken_base(damping: float, loss_factor: float) -> None:
    """Timoshenko's equations with complex moduli; both bending planes at once, with a quarter of a period between them."""
    f = np.array([0.3, 0.7, 2.0, 4.4, 9.0])
    beam = bar(damping=damping)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start)))
    found = fb.frequency_response(model, f, base=(0, 1e-3, 2e-3j), loss_factor=loss_factor, points={"tip": beam.end})
    for j, w in enumerate(2.0 * np.pi * f):
        t = timoshenko(w, 1.0 + 1j * w * damping + 1j * loss_factor)
        # moment and shear force vanish at the free end
        at_start = np.linalg.solve(t[2:, 2:], -t[2:, 0])
        tip = t[0, 0] + t[0, 2:] @ at_start
        np.testing.assert_allclose(found.point("tip")[j], [0.0, 1e-3 * tip, 2e-3j * tip], rtol=1e-8, atol=1e-14)
        turn = t[1, 0] + t[1, 2:] @ at_start
        assert abs(found.spin("tip")[j, 2]) == pytest.approx(1e-3 * abs(turn), rel=1e-7)


@pytest.mark.parametrize("planar", [True, False])
def test_cantilever_on_a_base_that_turns(planar: bool) -> None:
    """Timoshenko's equations from a start that moves and turns; of all supports about the origin, of one about its node."""
    f, off = np.array([0.3, 2.0, 9.0]), np.array([0.7, -0.4, 0.0])
    beam = fb.Beam.straight("bar", off, off + (L, 0, 0), section=section(damping=1e-3), elements=8, degree=5)
    clamp = fb.Clamp(beam.start)
    model = fb.compile_scene(fb.Scene(beam, clamp), planar=planar)
    rise, turn_z, turn_y = 1e-3, 2e-2j, 0.0 if planar else 5e-3
    own = np.array([0.0, rise, 0.0, 0.0, turn_y, turn_z])
    of_all = own.copy()
    of_all[:3] -= np.cross(own[3:], off)
    alone = fb.frequency_response(model, f, base={clamp: own}, points={"tip": beam.end})
    found = fb.frequency_response(model, f, base=of_all, points={"tip": beam.end})
    np.testing.assert_allclose(found.displacements, alone.displacements, rtol=1e-11, atol=1e-15)
    for j, w in enumerate(2.0 * np.pi * f):
        t = timoshenko(w, 1.0 + 1j * w * 1e-3)
        by_start = t[:2, :2] - t[:2, 2:] @ np.linalg.solve(t[2:, 2:], t[2:, :2])
        in_y, in_z = by_start @ (rise, turn_z), by_start @ (0.0, -turn_y)
        # along the bar, where its base moves with the turn only about another point
        np.testing.assert_allclose(found.point("tip")[j, 1:], [in_y[0], in_z[0]], rtol=1e-8, atol=1e-14)
        np.testing.assert_allclose(found.spin("tip")[j], [0.0, -in_z[1], in_y[1]], rtol=1e-7, atol=1e-13)


def test_bases_that_cannot_turn_are_refused() -> None:
    beam = bar()
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Pin(beam.end)))
    with pytest.raises(fb.SceneError, match="no support fixes its rotation"):
        fb.frequency_response(model, [1.0], base={beam.end: (0, 0, 0, 0, 0, 1e-3)})
    # of all supports the pinned ones move with the turn
    tip = fb.frequency_response(model, [0.0], base=(0, 0, 0, 0, 0, 1e-3), points={"tip": beam.end}).point("tip")[0]
    np.testing.assert_allclose(tip, (0.0, 1e-3 * L, 0.0), rtol=1e-12, atol=1e-15)
    with pytest.raises(fb.SceneError, match="moves supports out of the plane"):
        fb.frequency_response(fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start)), planar=True), [1.0],
                              base=(0, 0, 0, 0, 1e-3, 0))


def test_slender_cantilever_of_euler_and_bernoulli() -> None:
    slender = dict(GA2=1e8, GA3=1e8, EA=1e8, rhoI2=1e-9, rhoI3=1e-9)
    beam = bar(**slender)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start)), planar=True)
    f = np.array([0.2, 1.1, 3.1])
    found = fb.frequency_response(model, f, base=(0, 1.0, 0), points={"tip": beam.end})
    b = (RHO_A * (2.0 * np.pi * f)**2 / EI)**0.25 * L
    exact = (np.cos(b) + np.cosh(b)) / (1.0 + np.cos(b) * np.cosh(b))
    np.testing.assert_allclose(found.point("tip")[:, 1].real, exact, rtol=1e-5)
    assert 1e-10 < np.max(found.uncertainty) < 1e-5


def test_mass_on_a_spring_in_air_and_an_arm_on_a_damped_hinge() -> None:
    mass = fb.PointMass("mass", mass=0.5, position=(0.3, 0, 0))
    model = fb.compile_scene(fb.Scene(mass, fb.Spring(fb.GROUND.point((0, 0, 0)), mass, stiffness=80.0, length=0.3),
                                      fb.Drag("oil", mass, linear=0.9, normal=3.0)))
    f = np.array([0.5, 2.0, 5.0])
    w = 2.0 * np.pi * f
    found = fb.frequency_response(model, f, loads=fb.Load("push", mass, force=(1.5, 0, 0)), points={"mass": mass})
    np.testing.assert_allclose(found.point("mass")[:, 0], 1.5 / (80.0 + 0.9j * w - 0.5 * w**2), rtol=1e-12)
    arm = fb.RigidBody("arm", mass=2.0, inertia=(0.1, 0.4, 0.4), position=(0.5, 0, 0))
    hinge = fb.RevoluteJoint(fb.GROUND, arm.point((-0.5, 0, 0)), "hinge", axis=(0, 1, 0), stiffness=20.0, damping=1.5)
    load = fb.Load("turn", arm, moment=(0, 3.0, 0))
    model = fb.compile_scene(fb.Scene(arm, hinge, load))
    found = fb.frequency_response(model, f, loads="turn", load_factor=0.0, points={"arm": arm})
    turn = 3.0 / (20.0 + 1.5j * w - 0.9 * w**2)
    np.testing.assert_allclose(found.spin("arm")[:, 1], turn, rtol=1e-9)
    np.testing.assert_allclose(found.point("arm")[:, 2], -0.5 * turn, rtol=1e-9)
    rates = np.roots([0.9, 1.5, 20.0])
    modes = fb.modes(model, damped=True, load_factor=0.0)
    np.testing.assert_allclose(modes.rates, rates[rates.imag > 0], rtol=1e-9)


def test_dampers_of_springs_and_bushings() -> None:
    """A mass between a damped spring, a damper across and a slack rope; a body on a bushing with full matrices."""
    mass = fb.PointMass("mass", mass=0.5, position=(0, 0, 0))
    ground = fb.GROUND.point
    springs = [fb.Spring(ground((-1, 0, 0)), mass, stiffness=80.0, damping=0.7, name="both"),
               fb.Damper(ground((0, -2, 0)), mass, damping=1.1), fb.Spring(ground((0, 3, 0)), mass, stiffness=30.0),
               fb.Spring(ground((0, 0, 1)), mass, stiffness=50.0, damping=2.0, tension_only=True, length=1.2, name="slack"),
               fb.Spring(ground((0, 0, 2)), mass, stiffness=20.0)]
    found = fb.modes(fb.compile_scene(fb.Scene(mass, *springs)), n=3, damped=True)
    exact = [np.roots([0.5, c, k])[0] for c, k in ((0.7, 80.0), (1.1, 30.0), (0.0, 20.0))]
    for rate in exact:
        assert nearest(found, rate.real + 1j * abs(rate.imag)) < 1e-9
    draw = np.random.default_rng(2)
    half = [draw.standard_normal((3, 3)) for _ in range(2)]
    damping, stiffness = np.zeros((6, 6)), np.diag([300.0, 400.0, 500.0, 20.0, 30.0, 40.0])
    damping[:3, :3], damping[3:, 3:] = 2.0 * half[0] @ half[0].T, 0.1 * half[1] @ half[1].T
    axes = np.linalg.qr(draw.standard_normal((3, 3)))[0]
    axes *= np.sign(np.linalg.det(axes))
    body = fb.RigidBody("body", mass=2.0, inertia=(0.3, 0.4, 0.5), position=(0, 0, 0))
    held = fb.Bushing(ground((0.2, 0.1, -0.3)), body.point((0.2, 0.1, -0.3)), stiffness=stiffness, damping=damping,
                      directors=axes)
    found = fb.modes(fb.compile_scene(fb.Scene(body, held)), n=6, damped=True)
    # displacement of the point and turn, seen in the axes
    lever = np.array([np.cross(e, (0.2, 0.1, -0.3)) for e in np.eye(3)]).T
    seen = np.block([[axes, axes @ lever], [np.zeros((3, 3)), axes]])
    inertia = np.diag([2.0, 2.0, 2.0, 0.3, 0.4, 0.5])
    k, c = (np.linalg.solve(inertia, seen.T @ x @ seen) for x in (stiffness, damping))
    rates = np.linalg.eigvals(np.block([[np.zeros((6, 6)), np.eye(6)], [-k, -c]]))
    assert max(nearest(found, rate) for rate in rates if rate.imag >= 0.0) < 1e-8 and len(found) >= 6


def test_one_support_of_two_moves() -> None:
    """A bar between two masses that are held: the one end moves, the other one stays."""
    tau, f = 1e-3, np.array([7.0, 30.0])
    beam = bar(damping=tau)
    ends = fb.Clamp(beam.start), fb.Clamp(beam.end)
    model = fb.compile_scene(fb.Scene(beam, *ends))
    k = 2.0 * np.pi * f * np.sqrt(RHO_A / (EA * (1.0 + 2j * np.pi * f * tau)))
    points = {"inside": beam.at(0.5 * L), "end": beam.end}
    for key in (ends[1], beam.end):
        found = fb.frequency_response(model, f, base={key: (2e-3, 0, 0)}, points=points)
        np.testing.assert_allclose(found.point("inside")[:, 0], 2e-3 * np.sin(0.5 * k * L) / np.sin(k * L), rtol=1e-9)
        np.testing.assert_allclose(found.point("end")[:, 0], 2e-3, rtol=1e-12)
    both = fb.frequency_response(model, f, base={end: (2e-3, 0, 0) for end in ends}, points=points)
    same = fb.frequency_response(model, f, base=(2e-3, 0, 0), points=points)
    np.testing.assert_allclose(both.displacements, same.displacements, rtol=1e-12)


def test_damping_ratios_are_those_of_a_sum_over_all_modes() -> None:
    beam = fb.Beam.straight("bar", (0, 0, 0), (L, 0, 0), section=section(), elements=2, degree=2)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start)))
    f = np.array([0.0, 1.4, 5.0, 12.0])
    force = np.array([0.3, 1.0, -2.0])
    found = fb.frequency_response(model, f, loads={fb.Load("push", beam.end, force=force): 1.0 + 0.5j}, damping_ratio=0.03,
                                  points={"tip": beam.end})
    modes = fb.modes(model, n=100)
    assert len(modes) == 24 and found.info["modes_with_ratio"] == np.sum(modes.frequencies <= 24.0)
    w = 2.0 * np.pi * f[:, None]
    ratio = np.where(modes.frequencies <= 24.0, 0.03, 0.0)
    share = modes.displacements[:, -1] @ force * (1.0 + 0.5j) / modes.modal_mass
    tip = (share / (modes.angular**2 - w**2 + 2j * ratio * w * modes.angular)) @ modes.displacements[:, -1]
    np.testing.assert_allclose(found.point("tip"), tip, rtol=1e-9, atol=1e-16)


@pytest.mark.parametrize("joints", ["rigid", "ball"])
def test_prestressed_net_as_in_statics_and_by_its_modes(joints: str) -> None:
    """At rest the displacement by a small load; beams between ball joints may spin about their axes, which nothing excites."""
    n = 4
    grid = np.stack(np.meshgrid(np.arange(n), np.arange(n), [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(n * n).reshape(n, n)
    edges = np.concatenate((np.stack((number[:-1].ravel(), number[1:].ravel()), 1),
                            np.stack((number[:, :-1].ravel(), number[:, 1:].ravel()), 1)))
    pins = np.unique(np.concatenate((number[0], number[-1], number[:, 0], number[:, -1])))
    wire = section(EI2=1e-3, EI3=1e-3, GJ=1e-3, rhoI2=1e-7, rhoI3=1e-7)
    net = fb.Net("net", grid, edges, section=wire, elements=2, degree=3, joints=joints, pins=pins, prestress=200.0)
    size, node = 1e-5, net.node(5)
    push = fb.Load("push", node, force=(0, 0, size))
    rest = fb.solve_static(fb.compile_scene(fb.Scene(net, push)), points={"node": node})
    model = fb.compile_scene(fb.Scene(net))
    modes = fb.modes(model, n=1)
    f = [0.0, 0.5 * modes.frequencies[0]]
    found = fb.frequency_response(model, f, loads=push, points={"node": node}, loss_factor=1e-3)
    still = fb.frequency_response(model, [0.0], loads=push, points={"node": node})
    assert still.point("node")[0, 2] == pytest.approx(rest.point("node")[-1, 2], rel=1e-6)
    assert abs(found.point("node")[1, 2]) > 1.05 * abs(found.point("node")[0, 2])
    assert np.max(found.uncertainty) < 1e-6


# --- against runs in time -------------------------------------------------------------------------------------------------
def test_a_run_that_has_settled() -> None:
    """Steps of size h answer F cos w t as the scene answers the mean of F over a step at 2/h tan(w h/2): with a bead that slides
    on a damped, bent and loaded beam."""
    h, w = 0.02, 9.0
    beam = fb.Beam.straight("rail", (0, 0, 0), (3, 0, 0), section=fb.Section(
        EA=1e4, GA2=1e4, GA3=1e4, GJ=500.0, EI2=50.0, EI3=50.0, rhoA=1.0, rhoI2=0.01, rhoI3=0.01, damping=0.02), elements=4)
    bead = fb.PointMass("bead", mass=0.5)
    size = 1e-6
    push = fb.Load("push", beam.at(2.25), force=(0, 0, size), time=lambda t: float(np.cos(w * t)))
    scene = fb.Scene(beam, bead, fb.Clamp(beam.start), fb.Clamp(beam.end), fb.Slider("run", bead, beam, at=1.1),
                     fb.Drag("air", bead, linear=1.0), push, gravity=(0, 0, -9.81))
    model = fb.compile_scene(scene)
    # without the small load: its time function is zero there
    rest = fb.solve_static(model, at_time=0.5 * np.pi / w)
    found = fb.frequency_response(model, [twice(w, h)], state=rest.state, at_time=0.5 * np.pi / w, loads="push",
                                  points={"bead": bead, "mid": beam.at(1.5)})
    run = fb.simulate(model, start=fb.Start(rest.state, time=0.0), t_end=1600 * h, step=h, every=1, progress=False,
                      points={"bead": bead, "mid": beam.at(1.5)})
    share = np.sinc(0.5 * w * h / np.pi) / np.cos(0.5 * w * h)
    late = np.flatnonzero(run.t > 1600 * h - 2.0)
    turn = np.exp(1j * w * run.t[late])
    for name in ("bead", "mid"):
        moved = run.point(name)[late] - run.point(name)[0]
        expected = np.real(turn[:, None] * found.point(name) * share)
        assert np.max(np.abs(moved - expected)) < 2e-4 * np.max(np.abs(expected)), name
    slid = run.slider("run")["s"][late] - run.slider("run")["s"][0]
    expected = np.real(turn * found.slide("run")[0] * share)
    assert np.max(np.abs(slid - expected)) < 2e-4 * np.max(np.abs(expected))


# --- damped modes ---------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("tau", [2e-3, 3e-2, 0.2])
def test_viscous_bar_swings_and_creeps(tau: float) -> None:
    """zeta = w tau/2 in extension; above 1 two motions without vibration. Bending has a time of its own."""
    beam = bar(damping=(tau, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4), elements=6)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start)))
    n = 40
    found = fb.modes(model, n=n, damped=True)
    assert isinstance(found, DampedModes)
    swinging = np.sum(found.angular > 0.0)
    assert 2 * n == 2 * swinging + np.sum(found.angular == 0.0) and np.max(found.residuals) < 1e-10
    for j in (0.5, 1.5):
        w = j * np.pi / L * np.sqrt(EA / RHO_A)
        for rate in np.roots([1.0, w * w * tau, w * w]):
            if rate.imag >= 0.0:
                assert nearest(found, rate) < 1e-8
                k = int(np.argmin(np.abs(found.rates - rate)))
                assert found.damping_ratios[k] == pytest.approx(min(0.5 * w * tau, 1.0), rel=1e-8)
    undamped = fb.modes(model, n=4)
    zeta = found.damping_ratios[found.angular > 0.0][:4]
    np.testing.assert_allclose(zeta, 0.5e-4 * undamped.angular, rtol=1e-6)


def test_round_off_is_no_damping_of_free_motions() -> None:
    """A bar on two pins turns freely about itself; its damping there is a sum of large numbers that cancel."""
    beam = bar(damping=2e-3, elements=6)
    found = fb.modes(fb.compile_scene(fb.Scene(beam, fb.Pin(beam.start), fb.Pin(beam.end))), n=4, damped=True)
    free = found.undamped < 1e-6
    assert np.sum(free) == 2 and not np.any(found.rates[free]) and not np.any(found.damping_ratios[free])
    assert np.all(found.decay[~free] > 0.0)


@pytest.mark.parametrize("twist", [0.0, 0.1])
def test_turns_that_nothing_holds_have_rate_zero(twist: float) -> None:
    """A ball on a rod of 0.4 m in a shoulder that damps the swing: the twist is free, or has its damper alone."""
    ball = fb.RigidBody("ball", mass=3.0, inertia=(0.02, 0.02, 0.02), position=(0, 0, -0.4))
    shoulder = fb.SphericalJoint(fb.GROUND, ball.point((0, 0, 0.4)), "shoulder", axis=(0, 0, -1), stiffness=(5.0, 0.0),
                                 damping=(0.5, twist))
    found = fb.modes(fb.compile_scene(fb.Scene(ball, shoulder, gravity=(0, 0, -9.81))), n=3, damped=True)
    swing = np.roots([0.02 + 3.0 * 0.4**2, 0.5, 5.0 + 3.0 * 9.81 * 0.4])
    assert sum(abs(found.rates - swing[np.imag(swing) > 0]) < 1e-9) == 2
    turns = sorted(np.real(found.rates[found.angular == 0.0]))
    np.testing.assert_allclose(turns, [-twist / 0.02, 0.0], rtol=1e-9)
    assert not turns[-1] and np.all(found.damping_ratios >= 0.0) and np.max(found.residuals) < 1e-10


def test_linear_drag_lets_free_motions_decay() -> None:
    """r (m r + c) = 0 for a flight: one free motion and one that decays, in each direction."""
    beam = bar(elements=3)
    found = fb.modes(fb.compile_scene(fb.Scene(beam, fb.Drag("air", beam, linear=0.8 * RHO_A))), n=8, damped=True)
    assert np.sum(found.rates == 0.0) == 7 and np.sum(np.abs(found.rates + 0.8) < 1e-9) == 3
    assert np.all(found.decay >= 0.0)


def test_damped_modes_with_coupling_decay_in_runs_as_they_say() -> None:
    """Drag on half of a frame, a damper in a hinge: modes are complex. A run from each takes in a step the factor of its rate."""
    h, n = 0.01, 60
    one = fb.Beam.straight("one", (0, 0, 0), (L, 0, 0), section=section(damping=2e-3), elements=3)
    two = fb.Beam.straight("two", (L, 0, 0), (L, 0, -1.5), section=section(), elements=3)
    hinge = fb.RevoluteJoint(one.end, two.start, "hinge", axis=(0, 1, 0), stiffness=15.0, damping=6.0)
    model = fb.compile_scene(fb.Scene(one, two, fb.Clamp(one.start), hinge, fb.Drag("air", two, linear=1.2)))
    found = fb.modes(model, n=5, damped=True)
    assert np.max(found.residuals) < 1e-9
    phases = np.angle(found.displacements[0][np.abs(found.displacements[0]) > 0.05])
    assert np.ptp(np.mod(phases + 0.5, np.pi)) > 0.01, "no standing wave"
    for k in range(3):
        rate = found.rates[k]
        run = fb.simulate(model, start=found.state(k, 1e-6), t_end=n * h, step=h, every=1, progress=False,
                          points={"a": one.end, "b": two.end})
        factor = ((1.0 + 0.5 * rate * h) / (1.0 - 0.5 * rate * h))**np.arange(n + 1)
        for name, node in (("a", one.end), ("b", two.end)):
            shape = found.displacements[k, model.numbers.number(node)]
            moved = run.point(name) - model.state().q.reshape(-1, 4, 3)[model.numbers.number(node), 0]
            assert np.max(np.abs(moved - 1e-6 * np.real(factor[:, None] * shape))) < 1e-10


def test_response_peaks_where_damped_modes_say() -> None:
    """A single mode: the peak is at w sqrt(1 - 2 zeta^2), its sensitivity is Q."""
    beam = bar(elements=3, damping=2e-3)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start)))
    mode = fb.modes(model, n=1, damped=True)
    zeta, w = mode.damping_ratios[0], mode.undamped[0]
    peak = w * np.sqrt(1.0 - 2.0 * zeta**2) / (2.0 * np.pi)
    f = peak * np.linspace(0.99, 1.01, 41)
    found = fb.frequency_response(model, f, loads=fb.Load("push", beam.end, force=(0, 0, 1.0)), points={"tip": beam.end})
    assert found.peaks("tip")[0][0] == pytest.approx(peak, rel=6e-4)
    assert found.sensitivity[20] == pytest.approx(0.5 / zeta * 2.0, rel=0.02)
