"""Supports that move as functions of time: exact answers at orders 2 and 4, the work that they do, and what is refused."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.kernels.state import State
from fastbeam.model.start import mended

Array = np.ndarray
SOFT = fb.Section(EA=1e3, GA2=500.0, GA3=500.0, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=0.01, rhoI3=0.01)
ROUND_OFF = 1e-12


def rates(errors: list[float]) -> Array:
    """Orders of convergence where each step is half the one before."""
    return np.log2(np.abs(np.array(errors[:-1]) / np.array(errors[1:])))


@pytest.mark.parametrize("order", [2, 4])
def test_a_mass_on_a_spring_with_a_shaken_base(order: int) -> None:
    a, k, m, W, T = 0.02, 200.0, 2.0, 7.0, 2.0
    base, mass = fb.PointMass("base", mass=1.0, position=(0, 0, 0)), fb.PointMass("mass", mass=m, position=(1, 0, 0))
    shake = fb.PrescribedMotion("shake", base, displacement=lambda t: (a * np.sin(W * t), 0, 0))
    model = fb.compile_scene(fb.Scene(base, mass, fb.Spring(base, mass, stiffness=k), shake))
    w = np.sqrt(k / m)
    exact = a * w**2 / (w**2 - W**2) * (np.sin(W * T) - W / w * np.sin(w * T))
    errors = []
    for steps in (50, 100, 200):
        run = fb.simulate(model, t_end=T, step=T / steps, order=order, points={"mass": mass}, progress=False)
        errors.append(float(run.point("mass")[-1, 0] - 1.0 - exact))
        assert run.drift("balance") < ROUND_OFF and "lin_mom" not in run.info["conserved"]
        work = run.balance()["motion of point mass 'base' ('shake')"]
        assert np.ptp(work) > 0.01
    assert np.all(np.abs(rates(errors) - order) < 0.3) and abs(errors[-1]) < (3e-4 if order == 2 else 5e-8)


@pytest.mark.parametrize(("order", "planar"), [(2, "auto"), (4, "auto"), pytest.param(4, False, marks=pytest.mark.slow)])
def test_a_bar_with_a_shaken_end_moves_as_a_standing_wave(order: int, planar: bool | str) -> None:
    """u = a sin(W t) cos(k (L - s))/cos(k L), k = W/c, at any amplitude: Simo-Reissner strains are linear in the stretch."""
    a, W, T = 0.01, 20.0, 0.3
    k = W / np.sqrt(SOFT.EA / SOFT.rhoA)
    beam = fb.Beam.straight("bar", (0, 0, 0), (1, 0, 0), section=SOFT, elements=6, degree=4)
    start = fb.InitialVelocity(beam, velocity=lambda s: np.outer(a * W * np.cos(k * (1.0 - s)) / np.cos(k), (1, 0, 0)))
    shake = fb.PrescribedMotion("base", beam.start, displacement=lambda t: (a * np.sin(W * t), 0, 0))
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), shake, start), planar=planar)
    errors = []
    for steps in (40, 320):
        run = fb.simulate(model, t_end=T, step=T / steps, order=order, points={"p": (beam, 0.37)}, progress=False)
        errors.append(float(run.point("p")[-1, 0] - 0.37 - a * np.sin(W * T) * np.cos(0.63 * k) / np.cos(k)))
        assert run.drift("balance") < ROUND_OFF
    # the shortest waves of the mesh meet the resonances of order 4 in between (theory.md 6)
    assert rates(errors)[0] / 3.0 > order - 0.3 and abs(errors[-1]) < (3e-7 if order == 2 else 1e-11)


def turning_arm(planar: bool | str = "auto", damping: float = 0.0) -> fb.Model:
    """A beam with a body at its tip on a hub that moves and turns."""
    section = replace(SOFT, damping=damping)
    beam = fb.Beam.straight("arm", (0, 0, 0), (2, 0, 0), section=section, elements=5, degree=3)
    body = fb.RigidBody("tip", mass=0.3, inertia=(0.01, 0.01, 0.01), position=(2, 0, 0))
    hub = fb.PrescribedMotion("hub", beam.start, displacement=hub_place, rotation=lambda t: (0, 0, 4.0 * t * t / (1.0 + t)))
    return fb.compile_scene(fb.Scene(beam, body, fb.RigidConnection(beam.end, body), hub, gravity=(0, -9.81, 0)), planar=planar)


def hub_place(t: float) -> Array:
    return np.array([0.2 * np.sin(3.0 * t)**2, 0.1 * (1.0 - np.cos(5.0 * t)), 0.0])


def test_a_turning_arm_stands_where_it_is_put_and_its_motor_pays() -> None:
    """In space as in the plane; the damped one, too."""
    flat, space, damped = (fb.simulate(turning_arm(*options), t_end=1.0, step=0.01, progress=False)
                           for options in (("auto",), (False,), ("auto", 0.01)))
    for run in (flat, space, damped):
        assert run.drift("balance") < ROUND_OFF
        np.testing.assert_allclose(run.phi[-1, 0], hub_place(1.0), rtol=0, atol=1e-15)
        # the triad has turned by 2 rad
        np.testing.assert_allclose(run.directors[-1, 0, 0], (np.cos(2.0), np.sin(2.0), 0.0), rtol=0, atol=1e-14)
    np.testing.assert_allclose(flat.state.q, space.state.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(flat.series["works"], space.series["works"], rtol=1e-11, atol=1e-13)
    assert abs(damped.series["works"][-1, 0]) > 1.0 and damped.series["losses"][-1, 0] > 1.0
    assert set(damped.balance()) == {"kinetic", "strain", "gravity", "damping of beam 'arm'",
                                     "motion of beam 'arm' node 0 ('hub')", "sum"}


def test_a_pendulum_on_a_moving_support() -> None:
    """J + m l^2 about the pivot: th'' = -m l (g sin th + x'' cos th)/(J + m l^2)."""
    from scipy.integrate import solve_ivp
    m, J, l, g, a, W, T = 2.0, 0.3, 0.8, 9.81, 0.2, 6.0, 2.0
    pivot = fb.PointMass("pivot", mass=1.0, position=(0, 0, 0))
    body = fb.RigidBody("bob", mass=m, inertia=(J, J, J), position=(l * np.sin(0.5), -l * np.cos(0.5), 0))
    ride = fb.PrescribedMotion("ride", pivot, position=lambda t: (a * np.sin(W * t)**2, 0, 0))
    model = fb.compile_scene(fb.Scene(pivot, body, fb.BallJoint(pivot, body.point(-body.position)), ride, gravity=(0, -g, 0)))

    def equation(t: float, y: Array) -> list[float]:
        push = 2.0 * a * W**2 * np.cos(2.0 * W * t)
        return [y[1], -m * l * (g * np.sin(y[0]) + push * np.cos(y[0])) / (J + m * l * l)]

    theta = solve_ivp(equation, (0.0, T), (0.5, 0.0), method="DOP853", rtol=1e-12, atol=1e-13).y[0, -1]
    exact = np.array([a * np.sin(W * T)**2 + l * np.sin(theta), -l * np.cos(theta)])
    errors = []
    for steps in (100, 200, 400):
        run = fb.simulate(model, t_end=T, step=T / steps, order=4, points={"bob": body}, progress=False)
        errors.append(float(np.linalg.norm(run.point("bob")[-1, :2] - exact)))
        assert run.drift("balance") < ROUND_OFF
    assert np.all(rates(errors) > 3.5) and errors[-1] < 1e-6


def test_a_body_that_is_turned_takes_its_energy_from_the_motor() -> None:
    """About an oblique axis in space, by rotation vectors and by matrices."""
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    x = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])

    def angle(t: float) -> float:
        return 3.0 * t * t

    def vector(t: float) -> Array:
        return angle(t) * axis

    def matrix(t: float) -> Array:
        return np.eye(3) + np.sin(angle(t)) * x + (1.0 - np.cos(angle(t))) * x @ x

    runs = []
    for rotation in (vector, matrix):
        body = fb.RigidBody("b", mass=1.0, inertia=(1.0, 2.0, 2.5), position=(0, 0, 0))
        model = fb.compile_scene(fb.Scene(body, fb.PrescribedMotion("motor", body, rotation=rotation)))
        runs.append(fb.simulate(model, t_end=1.0, step=0.01, progress=False))
    for run in runs:
        np.testing.assert_allclose(run.directors[-1, 0], matrix(1.0).T, rtol=0, atol=1e-13)
        assert run.drift("balance") < ROUND_OFF
        # at the speed 6 rad/s; second order
        assert abs(run.series["works"][-1, 0] - 0.5 * axis @ (np.array([1.0, 2.0, 2.5]) * axis) * 36.0) < 0.05
    # 15 kg m^2/s times the last place of rotations over a step, 3e-13 J, of some fifteen roundings
    np.testing.assert_allclose(runs[0].series["works"], runs[1].series["works"], rtol=0, atol=2e-11)


def test_a_run_goes_on_from_a_checkpoint_bit_for_bit_however_it_is_cut() -> None:
    model = turning_arm()
    whole = fb.simulate(model, t_end=0.6, step=0.01, every=1, progress=False)
    half = fb.simulate(model, t_end=0.3, step=0.01, every=10, progress=False)
    rest = fb.simulate(model, t_end=0.6, step=0.01, every=7, start=half.checkpoint, progress=False)
    assert all(np.array_equal(a, b) for a, b in zip(whole.state, rest.state))
    # from the state alone it moves on from where it is
    other = fb.simulate(model, t_end=0.6, step=0.01, start=fb.Start(half.state, time=0.3), progress=False)
    np.testing.assert_allclose(other.state.q, whole.state.q, rtol=0, atol=1e-9)
    assert not [event for event in other.events if event["kind"] == "support"]


def test_a_signal_is_the_spline_through_its_table() -> None:
    t = np.linspace(0.0, 2.0, 401)
    signal = fb.Signal(t, np.sin(t), rest=False, interpolation="cubic")
    assert abs(signal(1.2345) - np.sin(1.2345)) < 1e-9
    with pytest.raises(fb.SceneError, match="outside its table"):
        signal(2.1)
    push = fb.Signal(t, np.sin(np.pi * t)**2, direction=(0, 2, 0), interpolation="cubic")
    np.testing.assert_allclose(push(0.505), (0.0, 2.0 * np.sin(0.505 * np.pi)**2, 0.0), rtol=0, atol=1e-8)
    assert push(-1.0).tolist() == [0.0, 0.0, 0.0] and abs(push(5.0)[1]) < 1e-15


def test_a_quake_from_a_table_is_that_of_its_function() -> None:
    t = np.linspace(0.0, 0.5, 201)
    found = []
    for displacement in (fb.Signal(t, 0.02 * np.sin(2.0 * np.pi * t)**2, direction=(0, 1, 0), interpolation="cubic"),
                         lambda t: (0, 0.02 * np.sin(2.0 * np.pi * t)**2, 0)):
        mast = fb.Beam.straight("mast", (0, 0, 0), (2, 0, 0), section=SOFT, elements=5, degree=3)
        shake = fb.PrescribedMotion("quake", mast.start, displacement=displacement)
        model = fb.compile_scene(fb.Scene(mast, fb.Clamp(mast.start), shake))
        found.append(fb.simulate(model, t_end=0.5, step=0.005, progress=False).state.q)
    np.testing.assert_allclose(*found, rtol=0, atol=1e-8)


def scene_of(**motion: Any) -> fb.Scene:
    mast = fb.Beam.straight("mast", (0, 0, 0), (2, 0, 0), section=SOFT, elements=5, degree=3)
    return fb.Scene(mast, fb.Clamp(mast.start), fb.PrescribedMotion("shake", mast.start, **motion))


@pytest.mark.parametrize("kind", ["linear", "pchip"])
def test_a_support_whose_velocity_jumps_at_a_row_of_its_table_is_told(kind: str) -> None:
    lift = fb.Signal([0.0, 0.02, 0.04], [0.0, 0.0, 0.01], direction=(0, 0, 1), interpolation=kind)
    run = fb.simulate(fb.compile_scene(scene_of(displacement=lift)), t_end=0.05, step=0.005, progress=False)
    told = [event for event in run.events if event["kind"] == "kink"]
    assert len(told) == (kind == "linear")
    if told:
        assert told[0]["time"] == 0.02 and "'shake' (displacement): the slope of its table jumps by 0.5 per s" in told[0]["text"]


def still(t: float) -> tuple[float, float, float]:
    return 0.0, 0.0, 0.0


def tied() -> fb.Scene:
    a, b = (fb.Beam.straight(name, (0, 0, 0), (2, y, 0), section=SOFT, elements=2) for name, y in (("a", 0.0), ("b", 1.0)))
    body = fb.RigidBody("hub", mass=1.0, inertia=(1, 1, 1), position=(-1, 0, 0))
    return fb.Scene(a, b, body, fb.Clamp(body), fb.RigidConnection(body, a.start), fb.Clamp(b.start),
                    fb.PrescribedMotion("shake", a.start, rotation=still))


def twice() -> fb.Scene:
    scene = scene_of(displacement=still)
    return scene.add(fb.PrescribedMotion("again", scene.beams[0].start, displacement=still))


def both(one: str, other: str) -> fb.Scene:
    """Two motions of one node along these axes."""
    scene = scene_of(displacement=lambda t: np.zeros(len(one)), axes=one)
    return scene.add(fb.PrescribedMotion("again", scene.beams[0].start, displacement=lambda t: np.zeros(len(other)), axes=other))


@pytest.mark.parametrize(("make", "says"), [
    (lambda: scene_of(position=lambda t: (1, 0, 0)), "lies 1 m from"), (twice, "moves the same node"),
    (tied, "move that node instead"), (scene_of, "give position, displacement or rotation"),
    (lambda: scene_of(position=still, displacement=still), "not both"),
    (lambda: scene_of(displacement=lambda t: (t, 0)), "3 finite numbers"),
    (lambda: scene_of(displacement=still, axes="x"), "must return a finite number, one for each of axes='x', got"),
    (lambda: scene_of(displacement=lambda t: t, axes="xy"), "must return 2 finite numbers, one for each of axes='xy', got 0"),
    (lambda: scene_of(displacement=lambda t: 0.0, axes="w"), "must name axes of the global frame"),
    (lambda: scene_of(position=lambda t: 1.0, axes="y"), "lies 1 m from"),
    (lambda: both("xy", "y"), "moves the same node along the same axis"),
    (lambda: scene_of(displacement=lambda t: 1 / t), "must not fail"),
    (lambda: scene_of(rotation=lambda t: np.ones((3, 3))), "orthonormal")])
def test_motions_that_make_no_sense_are_refused(make: Callable[[], fb.Scene], says: str) -> None:
    with pytest.raises(fb.SceneError, match=says):
        fb.compile_scene(make())


def test_motions_that_go_wrong_on_the_way_are_refused() -> None:
    with pytest.raises(fb.SceneError, match="finite numbers.*nan|must return 3 finite numbers"):
        fb.simulate(fb.compile_scene(scene_of(displacement=lambda t: (0, 0, 0) if t < 0.5 else (np.nan, 0, 0))),
                    t_end=1.0, step=0.1, progress=False)
    # out of the plane at a time at which nobody has looked
    jump = scene_of(displacement=lambda t: (0, 0.1 * t * t, 1e-3 if 0.2345 < t < 0.2355 else 0.0))
    model = fb.compile_scene(jump)
    assert model.plane is not None
    with pytest.raises(fb.SceneError, match="planar=False"):
        fb.simulate(model, t_end=1.0, step=0.005, progress=False)
    assert "supports that move motion of beam 'mast' node 0 ('shake')" in str(model)
    assert fb.compile_scene(scene_of(displacement=lambda t: (0, t * t, t**3))).plane is None
    with pytest.raises(fb.SceneError, match="half a turn"):
        fb.simulate(fb.compile_scene(scene_of(rotation=lambda t: (0, 0, 10.0 * np.pi * t))), t_end=1.0, step=0.1,
                    progress=False)
    for method in ("midpoint", "trapezoidal"):
        with pytest.raises(fb.SceneError, match="supports that move"):
            fb.simulate(fb.compile_scene(scene_of(displacement=still)), t_end=1.0, step=0.1, method=method, progress=False)


@pytest.mark.slow
def test_a_shaken_net_is_condensed_to_the_same_numbers() -> None:
    grid = np.array([(x, y, 0.0) for x in range(4) for y in range(4)])
    edges = [(4 * x + y, 4 * x + y + 1) for x in range(4) for y in range(3)] + [(4 * x + y, 4 * x + y + 4) for x in range(3)
                                                                               for y in range(4)]
    net = fb.Net("net", grid, edges, section=SOFT, elements=4, degree=2, clamps=[0, 12])
    shake = fb.PrescribedMotion("shake", net.node(0), displacement=lambda t: (0, 0, 0.1 * np.sin(8.0 * t)**2))
    scene = fb.Scene(net, shake, gravity=(0, 0, -2))
    runs = [fb.simulate(fb.compile_scene(scene, condense=condense), t_end=0.2, step=0.01, progress=False)
            for condense in (False, True)]
    assert max(run.drift("balance") for run in runs) < ROUND_OFF
    np.testing.assert_allclose(runs[1].state.q, runs[0].state.q, rtol=0, atol=1e-11)
    np.testing.assert_allclose(runs[1].series["works"], runs[0].series["works"], rtol=1e-8)


@pytest.mark.parametrize(("keyed", "seed"), [(True, 1), (False, 5)], ids=["keyed", "rubs as it turns"])
def test_friction_on_a_moving_support_keeps_the_balance(keyed: bool, seed: int) -> None:
    """A sleeve that rubs on a beam whose support moves, with an arm on a hinge that rubs: sliding stops and begins anew."""
    draw = np.random.default_rng(seed)
    at = 0.2 + 0.6 * draw.random()
    rod = fb.Section(EA=1e5, GA2=4e4, GA3=4e4, GJ=4.0, EI2=5.0, EI3=5.0, rhoA=0.1, rhoI2=1e-4, rhoI3=1e-4)
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=rod, elements=4)
    body = fb.RigidBody("body", mass=0.2, inertia=(1e-3, 1e-3, 1e-3), position=(at, 0, 0))
    arm = fb.RigidBody("arm", mass=0.3, inertia=(1e-2, 1e-2, 1e-2), position=(at, 0, -0.2))
    sleeve = fb.Sleeve("sleeve", body, beam, at=at, length=0.1, friction=0.1 + 0.4 * draw.random(), keyed=keyed,
                       radius=None if keyed else 0.02)
    more = {} if keyed else {"coefficient": 0.2, "radius": 0.02}
    hinge = fb.RevoluteJoint(body, arm.point((0, 0, 0.2)), "hinge", axis=(0, 1, 0) if keyed else (1, 0, 0),
                             friction=(0.05 if keyed else 0.02) * draw.random(), **more)
    size, rate = 0.02 * draw.random(), 10.0 + 30.0 * draw.random()
    shake = fb.PrescribedMotion("shake", beam.start, displacement=lambda t: (
        np.array((0.0, float(not keyed), 1.0)) * size * (1.0 - np.cos(rate * t))))
    loads = (fb.Load("end", beam.end, force=(0.1, 0, -0.3)), fb.Load("pull", arm, force=(draw.random(), 0.5 * (not keyed), 0)))
    model = fb.compile_scene(fb.Scene(beam, body, sleeve, arm, hinge, shake, fb.Clamp(beam.start), *loads, gravity=(0, 0, -9.81)))
    found = fb.simulate(model, t_end=0.3, step=1e-3, progress=False)
    # 3e-15 and 4e-15; 2e-10 and 1e-11 where the last iteration of a step still changes the forces of supports
    assert found.drift("balance") < 5e-14 and found.series["friction_loss"][-1, 0] > 1e-5


def test_a_slider_on_a_moving_beam_keeps_the_balance() -> None:
    rail = fb.Beam.straight("rail", (0, 0, 0), (2, 0, 0), section=SOFT, elements=5, degree=3)
    bead = fb.PointMass("bead", mass=0.3)
    lift = fb.PrescribedMotion("lift", rail.start, displacement=lambda t: (0, 0.3 * np.sin(3.0 * t)**2, 0),
                               rotation=lambda t: (0, 0, -0.4 * np.sin(4.0 * t)**2))
    model = fb.compile_scene(fb.Scene(rail, bead, lift, fb.Slider("s", bead, rail, at=0.4, rate=1.0), gravity=(0, -5, 0)))
    run = fb.simulate(model, t_end=0.5, step=0.005, progress=False)
    assert run.drift("balance") < ROUND_OFF and run.drift("gap") < 1e-14 and abs(run.series["works"][-1, 0]) > 0.01
    # a state that misses a little is mended, and the support goes on as it did
    part = fb.simulate(model, t_end=0.25, step=0.005, progress=False)
    off = State(*(x.copy() for x in part.state))
    bead_at = 12 * model.names["masses"][0]["node"]
    off.q[bead_at:bead_at + 3] += 3e-8
    rest = fb.simulate(model, start=fb.Start(off, time=0.25, mend=True), t_end=0.5, step=0.005, progress=False, every=1)
    assert [x["kind"] for x in rest.events] == ["mended"]
    np.testing.assert_allclose(rest.state.q, run.state.q, rtol=0, atol=3e-7)
    assert rest.drift("balance") < ROUND_OFF
    # that the support takes up its velocity is no momentum of the beam, however little the places moved: 8e-8, once 1.6e-4
    as_it_is = mended(model, part.state, 0.25)
    np.testing.assert_allclose(mended(model, off, 0.25).v, as_it_is.v, rtol=0, atol=1e-6)


def test_a_support_that_begins_with_a_velocity_alone_is_told_of() -> None:
    """A rod that is pushed at one end from rest: behind the front the strain is velocity over speed of waves, by d'Alembert."""
    steel = fb.Section.rectangle(height=0.01, width=0.01, E=210e9, rho=7850.0)
    strain = 0.4 / np.sqrt(210e9 / 7850.0)

    def model(place: Callable[[float], float], *parts: Callable[[fb.Beam], Any], **options: Any) -> tuple[fb.Model, fb.Beam]:
        rod = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=steel, elements=20)
        push = fb.PrescribedMotion("push", rod.start, displacement=lambda t: (place(t), 0, 0))
        scene = fb.Scene(rod, push, fb.Pin(rod.end, axes="yz"), *(part(rod) for part in parts), **options)
        return fb.compile_scene(scene), rod

    def run(*given: Any, **options: Any) -> fb.Result:
        compiled, rod = model(*given, **options)
        return fb.simulate(compiled, t_end=1.2e-4, step=1e-6, progress=False, observe=("section",), points={"near": (rod, 0.1)})

    with pytest.warns(fb.ResultWarning, match=r"'push' begins with 0.4 m/s, but .* strains of about 8e-05 .*project_velocities"):
        alone = run(lambda t: 0.4 * t)
    assert [event["kind"] for event in alone.events] == ["shock"]
    again = fb.adjoint_run(model(lambda t: 0.4 * t)[0], t_end=2e-6, step=1e-6)
    assert [event["text"] for event in again.events] == [event["text"] for event in alone.events]
    behind = alone.section("near")["N"][alone.t > 6e-5] / (210e9 * 1e-4)
    np.testing.assert_allclose(np.mean(behind), -strain, rtol=0.02)
    # at rest, with the velocity of the beam, or along with it
    fits = (run(lambda t: 2e3 * t * t), run(lambda t: 0.4 * t, lambda rod: fb.RigidMotion(rod, velocity=(0.4, 0, 0))),
            run(lambda t: 0.4 * t, lambda rod: fb.InitialVelocity(rod, velocity=lambda s: np.outer(0.4 * (1.0 - s), (1, 0, 0)))),
            run(lambda t: 0.4 * t, project_velocities=True))
    assert [[event["kind"] for event in fit.events] for fit in fits] == [[], [], [], ["projected"]]
    assert np.max(np.abs(fits[1].section("near")["N"])) < 1e-7 * 210e9 * 1e-4 * strain
    # what stands still is taken along at once
    pushed, _ = model(lambda t: 0.4 * t)
    still = fb.simulate(pushed, start=model(lambda t: 2e3 * t * t)[0].state(), t_end=2e-6, step=1e-6, progress=False)
    assert [event["text"] for event in still.events if "moves its node with a velocity jump" in event["text"]
            and event["kind"] == "shock"]


# --- along single axes -------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize("planar", ["auto", False])
def test_a_cart_that_is_moved_up_and_down_rolls_on(order: int, planar: bool | str) -> None:
    """The motion along y leaves momentum and speed along x alone; a pendulum on it swings as on a support that goes y(t) and is
    free along x (two equations of Lagrange)."""
    from scipy.integrate import solve_ivp
    M, m, J, l, g, a, W, T = 1.5, 2.0, 0.3, 0.8, 9.81, 0.1, 6.0, 1.0
    cart = fb.PointMass("cart", mass=M, position=(0, 0, 0), velocity=(0.4, 0, 0))
    body = fb.RigidBody("bob", mass=m, inertia=(J, J, J), position=(l * np.sin(0.5), -l * np.cos(0.5), 0), velocity=(0.4, 0, 0))
    lift = fb.PrescribedMotion("lift", cart, displacement=lambda t: a * np.sin(W * t)**2, axes="y")
    parts = [] if planar else [fb.Pin(cart, axes="z")]
    model = fb.compile_scene(fb.Scene(cart, body, fb.BallJoint(cart, body.point(-body.position)), lift, *parts,
                                      gravity=(0, -g, 0)), planar=planar)

    def equation(t: float, y: Array) -> list[float]:
        _, u, th, w = y
        G = g + 2.0 * a * W**2 * np.cos(2.0 * W * t)
        c, s = np.cos(th), np.sin(th)
        matrix = [[M + m, m * l * c], [m * l * c, J + m * l * l]]
        push, turn = np.linalg.solve(matrix, [m * l * s * w * w, -m * l * G * s])
        return [u, push, w, turn]

    x, _, theta, _ = solve_ivp(equation, (0.0, T), (0.0, 0.4, 0.5, 0.0), method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    exact = np.array([x + l * np.sin(theta), a * np.sin(W * T)**2 - l * np.cos(theta)])
    errors = []
    for steps in (50, 100):
        run = fb.simulate(model, t_end=T, step=T / steps, order=order, points={"bob": body, "cart": cart}, progress=False)
        errors.append(float(np.linalg.norm(run.point("bob")[-1, :2] - exact)))
        momentum = run.series["lin_mom"][:, 0]
        assert run.drift("balance") < ROUND_OFF and np.ptp(momentum) < 1e-13 * momentum[0]
        np.testing.assert_allclose(run.point("cart")[:, 1], a * np.sin(W * run.t)**2, rtol=0, atol=1e-15)
        assert set(run.balance()) == {"kinetic", "strain", "gravity", "motion of point mass 'cart' ('lift')", "sum"}
    assert rates(errors)[0] > order - 0.4 and errors[-1] < (1e-3 if order == 2 else 1e-5)


def test_motions_along_axes_together_are_one_motion() -> None:
    """Along x and along y by two motions, a pin along z, the triad by a clamp: as one motion of a clamp, with all its work."""
    def run(*parts: Callable[[fb.Beam], Any]) -> fb.Result:
        mast = fb.Beam.straight("mast", (0, 0, 0), (0, 0, 2), section=SOFT, elements=5, degree=3)
        return fb.simulate(fb.compile_scene(fb.Scene(mast, *(part(mast) for part in parts), gravity=(0, 0, -1))), t_end=0.5,
                           step=0.005, progress=False, observe=("energy", "reaction"))

    def x(t: float) -> float:
        return float(0.1 * np.sin(5.0 * t)**2)

    def y(t: float) -> float:
        return float(0.2 * np.sin(3.0 * t)**2)

    whole = run(lambda mast: fb.PrescribedMotion("m", mast.start, displacement=lambda t: (x(t), y(t), 0)),
                lambda mast: fb.Clamp(mast.start))
    single = run(lambda mast: fb.PrescribedMotion("mx", mast.start, displacement=x, axes="x"),
                 lambda mast: fb.PrescribedMotion("my", mast.start, position=y, axes="y"), lambda mast: fb.Clamp(mast.start))
    turned = run(lambda mast: fb.PrescribedMotion("m", mast.start, displacement=lambda t: (y(t), x(t)), axes="yx",
                                                  rotation=lambda t: (0, 0, 0)), lambda mast: fb.Pin(mast.start, axes="z"))
    assert max(r.drift("balance") for r in (whole, single, turned)) < ROUND_OFF
    for other in (single, turned):
        np.testing.assert_allclose(other.state.q, whole.state.q, rtol=0, atol=1e-13)
        np.testing.assert_allclose(other.series["works"].sum(axis=1), whole.series["works"].sum(axis=1), rtol=0, atol=1e-12)
    force = whole.reaction("m")["force"]
    np.testing.assert_allclose(single.reaction("mx")["force"], force * (1, 0, 0), rtol=0, atol=1e-9)
    np.testing.assert_allclose(single.reaction("my")["force"], force * (0, 1, 0), rtol=0, atol=1e-9)
    np.testing.assert_allclose(turned.reaction("m")["force"], force * (1, 1, 0), rtol=0, atol=1e-9)


def test_base_excitation_along_one_axis_from_a_signal() -> None:
    """A beam on two rollers whose ends go up and down by a table: the frame of the supports sees it as gravity."""
    t = np.linspace(0.0, 1.0, 401)
    found = []
    for shaken in (True, False):
        beam = fb.Beam.straight("beam", (0, 0, 0), (2, 0, 0), section=SOFT, elements=6)
        up = fb.Signal(t, 0.05 * np.sin(np.pi * t)**4, interpolation="cubic")
        parts: list[Any] = [fb.Pin(beam.end, axes="yz")]
        options: dict[str, Any] = {}
        if shaken:
            parts = [fb.PrescribedMotion(f"up {k}", at, displacement=up, axes="z") for k, at in enumerate((beam.start, beam.end))]
            parts += [fb.Pin(beam.start, axes="xy"), fb.Pin(beam.end, axes="y")]
        else:
            acceleration = up._curve.derivative(2)
            parts.append(fb.Pin(beam.start))
            options = {"gravity": (0, 0, -1), "gravity_time": lambda t: float(acceleration(min(t, 1.0)))}
        run = fb.simulate(fb.compile_scene(fb.Scene(beam, *parts, **options)), t_end=1.0, step=0.0025, progress=False,
                          points={"middle": (beam, 1.0), "end": beam.end})
        found.append(run.point("middle")[:, 2] - run.point("end")[:, 2])
    assert np.max(np.abs(found[0])) > 0.05 and np.max(np.abs(found[0] - found[1])) < 2e-4 * np.max(np.abs(found[0]))
