"""Forces along lines by laws of the user's own: as built-in springs and dampers, momenta and books (theory.md (4.29))."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb


def strut(t, length, rate, parameters):
    return parameters[0] * (length - parameters[1]) + parameters[2] * rate


def muscle(t, length, rate, parameters):
    return parameters[0] * (1.0 + np.sin(parameters[1] * t)) * length**2


def pair(*links: Any) -> Any:
    """Two bodies with spins and a mass; links between points of them."""
    return fb.compile_scene(fb.Scene(ARM, LEG, BALL, *links), planar=False)


ARM = fb.RigidBody("arm", mass=2.0, inertia=(0.1, 0.2, 0.25), position=(0, 0, 0), velocity=(0.3, 0, 0.1), spin=(1.0, 2.0, -0.5))
LEG = fb.RigidBody("leg", mass=1.0, inertia=(0.05, 0.04, 0.06), position=(1.0, 0.2, 0), spin=(-0.7, 0.3, 1.0))
BALL = fb.PointMass("ball", mass=0.5, position=(0.5, 1.0, 0.3), velocity=(0, -0.4, 0.2))
BOB = fb.PointMass("bob", mass=2.0, position=(0, 0, -1.0))
ENDS = ((ARM.point((0.2, 0.1, 0)), LEG.point((-0.1, 0.15, 0.05))), (LEG.point((0.1, 0, 0)), BALL), (BALL, ARM.center))


def run(model: Any) -> fb.Result:
    return fb.simulate(model, t_end=2.0, step=0.01, progress=False, observe=("energy", "momentum"))


def test_a_spring_and_a_damper_by_a_law_are_the_built_in_ones() -> None:
    built = run(pair(*(fb.Spring(a, b, f"s{k}", stiffness=30.0, length=0.6, damping=2.0) for k, (a, b) in enumerate(ENDS))))
    own = run(pair(*(fb.LineForce(a, b, f"s{k}", law=strut, parameters=(30.0, 0.6, 2.0)) for k, (a, b) in enumerate(ENDS))))
    assert np.max(np.abs(own.phi - built.phi)) < 1e-12
    for name in ("balance", "lin_mom", "ang_mom"):
        assert abs(own.drift(name)) < 1e-12
    # what the laws took is what springs store and dampers take
    taken = sum(own.balance()[f"work taken by line force 's{k}'"] for k in range(3))
    lost = sum(built.balance()[f"damping of spring 's{k}'"] for k in range(3))
    strain = built.series["strain"]
    assert np.max(np.abs(taken - lost - (strain - strain[0]))) < 1e-12 and lost[-1] > 0.5


def test_a_muscle_that_depends_on_time_keeps_momenta_and_closes_its_books() -> None:
    result = run(pair(*(fb.LineForce(a, b, law=muscle, parameters=(4.0, 3.0)) for a, b in ENDS)))
    assert np.ptp(result.series["kinetic"]) > 0.5
    for name in ("balance", "lin_mom", "ang_mom"):
        assert abs(result.drift(name)) < 1e-12


def hardening(t, length, rate, parameters):
    e = length - parameters[0]
    return parameters[1] * e + parameters[2] * e**2 + parameters[3] * e**3 + parameters[4] * rate


def hung(*parameters: float) -> fb.Model:
    """A mass 1 m below the ground that is pulled down by 1 N times the load factor."""
    rope = fb.LineForce(fb.GROUND.point((0, 0, 0)), BOB, "rope", law=hardening, parameters=parameters)
    return fb.compile_scene(fb.Scene(BOB, fb.Pin(BOB, axes="xy"), rope, fb.Load("pull", BOB, force=(0, 0, -1.0))), planar=False)


def test_a_law_acts_in_full_at_every_load_factor() -> None:
    """Rows of an equilibrium: F = 100 e + 20 e^3 with e = l - 0.99, and its damped mode there and at another load factor."""
    model = hung(0.99, 100.0, 0.0, 20.0, 0.8)
    rest = fb.solve_static(model, load_step=0.25, points={"bob": BOB})
    e = -rest.point("bob")[1:, 2] - 0.99
    assert len(e) >= 3
    np.testing.assert_allclose(100.0 * e + 20.0 * e**3, rest.t[1:], rtol=0, atol=1e-11)
    for factor, state in ((1.0, rest.state), (0.5, fb.solve_path(model, to=0.5).state)):
        stretch = -state.q.reshape(-1, 4, 3)[0, 0, 2] - 0.99
        found = fb.modes(model, state=state, n=1, damped=True, load_factor=factor)
        np.testing.assert_allclose(found.damping_ratios[0], 0.8 / (2.0 * np.sqrt(2.0 * (100.0 + 60.0 * stretch**2))), rtol=1e-7)


def test_a_path_goes_through_the_limit_points_of_a_law() -> None:
    """F = 10 e - 30 e^2 + 20 e^3, with limit points at F = +-10/sqrt(108)."""
    model = hung(1.0, 10.0, -30.0, 20.0, 0.0)
    path = fb.solve_path(model, to=1.2, step=0.2, largest_step=0.4, points={"bob": BOB})
    e = -path.point("bob")[:, 2] - 1.0
    np.testing.assert_allclose(10.0 * e - 30.0 * e**2 + 20.0 * e**3, path.series["load_factor"], rtol=0, atol=1e-11)
    limits = [x["load_factor"] for x in path.info["critical_points"]]
    np.testing.assert_allclose(limits, np.array([1.0, -1.0]) * 10.0 / np.sqrt(108.0), rtol=1e-10)


def test_a_scene_whose_laws_alone_act_has_nothing_that_grows() -> None:
    rope = fb.LineForce(fb.GROUND.point((0, 0, 0)), BOB, "rope", law=strut, parameters=(1.0, 0.5, 0.0))
    with pytest.raises(fb.SceneError, match="no loads to scale"):
        fb.solve_path(fb.compile_scene(fb.Scene(BOB, fb.Pin(BOB, axes="xy"), rope), planar=False))


def test_laws_that_cannot_be_are_refused() -> None:
    with pytest.raises(fb.SceneError, match="law= is missing"):
        fb.LineForce(ARM, LEG)
    with pytest.raises(fb.SceneError, match="finite numbers"):
        pair(fb.LineForce(ARM, LEG, law=lambda t, length, rate, parameters: np.nan))
    here = fb.PointMass("here", mass=1.0, position=(0, 0, 0))
    with pytest.raises(fb.SceneError, match="its ends coincide"):
        fb.compile_scene(fb.Scene(ARM, here, fb.LineForce(ARM, here, law=strut, parameters=(1.0, 1.0, 0.0))))


@pytest.mark.slow
def test_a_law_in_statics_and_in_modes() -> None:
    bob = fb.PointMass("bob", mass=2.0, position=(0, 0, -1.0))
    top = fb.GROUND.point((0, 0, 0))
    force = fb.LineForce(top, bob, law=strut, parameters=(200.0, 1.0, 0.8))
    model = fb.compile_scene(fb.Scene(bob, fb.Pin(bob, axes="xy"), force, gravity=(0, 0, -9.81)))
    found = fb.solve_static(model)
    assert abs(found.phi[-1, 0, 2] + 1.0 + 2.0 * 9.81 / 200.0) < 1e-12
    rate = fb.modes(model, state=found.state, n=1, damped=True)
    assert abs(rate.damping_ratios[0] - 0.8 / (2.0 * np.sqrt(200.0 * 2.0))) < 1e-8


def pad(t, length, rate, parameters):
    return -parameters[0] * max(parameters[1] - length, 0.0)**1.5


def dropped(link: Any) -> Any:
    ball = fb.PointMass("B", mass=1.0, position=(0, 0, 0.2))
    return fb.compile_scene(fb.Scene(ball, link(fb.GROUND.point((0, 0, 0)), ball), gravity=(0, 0, -9.81))), {"B": ball}


def on_a_pad(a: Any, b: Any) -> fb.LineForce:
    return fb.LineForce(a, b, "p", law=pad, parameters=(5e4, 0.1))


def test_step_control_does_not_jump_over_a_pad() -> None:
    model, points = dropped(on_a_pad)
    # energy: m g (0.2 - z) = k/2.5 (0.1 - z)^2.5 where it turns around; each bounce, two falls of 0.1 m and the contact, the same
    from scipy.optimize import brentq
    deepest = float(brentq(lambda z: 9.81 * (0.2 - z) - 2e4 * (0.1 - z)**2.5, 0.05, 0.1))
    fine = fb.simulate(model, t_end=3.0, step=5e-5, points=points, progress=False).point("B")[-1, 2]
    for tolerance, close in ((1e-6, 1e-3), (1e-8, 5e-5)):
        result = fb.simulate(model, t_end=3.0, step=1e-3, tolerance=tolerance, points=points, progress=False)
        z = result.point("B")[:, 2]
        assert deepest - 1e-5 < np.min(z) < deepest + 2e-4 and np.max(z) < 0.2 + 1e-6
        assert abs(z[-1] - fine) < close and not result.events


def test_smallest_step_that_passes_over_a_pad_is_told() -> None:
    model, points = dropped(on_a_pad)
    result = fb.simulate(model, t_end=1.0, step=0.2, tolerance=fb.StepControl(1e3, min_step=0.2, max_step=0.2), points=points,
                         progress=False)
    assert [event["kind"] for event in result.events] == ["unresolved"]
    assert "line force 'p': its ends pass each other in the smallest step, 0.2 s" in result.events[0]["text"]


def test_springs_whose_ends_pass_each_other_are_stepped_through() -> None:
    # a spring of 1 m that is pressed through itself snaps out on the other side; one without length is an oscillator, for free
    model, points = dropped(lambda a, b: fb.Spring(a, b, "s", stiffness=9.81, length=0.0))
    result = fb.simulate(model, t_end=5.0, step=1e-3, tolerance=1e-8, points=points, progress=False)
    omega = np.sqrt(9.81)
    np.testing.assert_allclose(result.point("B")[:, 2], -1.0 + 1.2 * np.cos(omega * result.t), atol=1e-4)
    assert not result.events and model.lines is None
    model, points = dropped(lambda a, b: fb.Damper(a, b, "d", damping=1.0))
    result = fb.simulate(model, t_end=1.0, step=1e-3, tolerance=1e-6, points=points, progress=False)
    fall = 0.2 - 9.81 * (result.t - 1.0 + np.exp(-result.t))
    np.testing.assert_allclose(result.point("B")[:, 2], fall, atol=1e-4)
    assert not result.events
