"""Order four with what dissipates, two runs that are extrapolated: orders against exact answers, what is kept, cost, refusals."""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb

Array = np.ndarray
G = 9.81
ROUND_OFF = 1e-12
SOFT = dict(EA=100.0, GA2=50.0, GA3=50.0, GJ=0.7, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=0.01, rhoI3=0.01)


def fourth(model: fb.Model, t_end: float, steps: int, **options: Any) -> fb.Result:
    return fb.simulate(model, t_end=t_end, step=t_end / steps, order=4, progress=False, **options)


def orders(found: Callable[[int], float], exact: float, steps: tuple[int, ...]) -> Array:
    """Of the errors with so many steps."""
    errors = np.abs(np.array([found(n) for n in steps]) - exact)
    return np.log2(errors[:-1] / errors[1:]) / np.log2(np.divide(steps[1:], steps[:-1]))


def bar(tau: float) -> tuple[fb.Model, fb.Beam]:
    """A bar of length 1, clamped at one end, in its first axial mode of angular frequency 5 pi."""
    beam = fb.Beam.straight("bar", (0, 0, 0), (1, 0, 0), section=fb.Section(**SOFT, damping=tau), elements=8, degree=3)
    push = fb.InitialVelocity(beam, velocity=lambda s: np.outer(np.sin(0.5 * np.pi * s), (1, 0, 0)))
    return fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), push)), beam


@pytest.mark.parametrize(("tau", "steps"), [(0.02, (80, 160, 320)), (0.2, (20, 40, 80))])
def test_a_bar_of_kelvin_and_voigt_decays_with_order_four(tau: float, steps: tuple[int, ...]) -> None:
    """u'' + tau w^2 u' + w^2 u = 0 of the mode that the elements have, with the angular frequency that `modes` finds; the longer
    time overdamps it."""
    model, beam = bar(tau)
    w = fb.modes(model, n=8).angular
    w = w[np.argmin(np.abs(w - 5.0 * np.pi))]
    root = w * np.sqrt(complex(1.0 - (0.5 * w * tau)**2))
    exact = float((np.exp(-0.5 * w**2 * tau) * np.sin(root) / root).real)

    def tip(n: int) -> float:
        run = fourth(model, 1.0, n, points={"tip": beam.end})
        assert run.drift("balance") < ROUND_OFF and run.events == [] and run.info["order"] == 4
        # a position is a number of size 1
        return float(run.point("tip")[-1, 0] - 1.0)

    found = orders(tip, exact, steps)
    assert np.all((found > 3.9) & (found < 4.1)), found


def test_it_takes_three_times_the_iterations_of_order_two_at_most() -> None:
    model, _ = bar(0.02)
    two = fb.simulate(model, t_end=1.0, step=0.01, progress=False)
    assert fourth(model, 1.0, 100).info["iterations"] <= 3 * two.info["iterations"]


def test_what_falls_in_air_has_the_exact_velocity() -> None:
    """v = v_inf tanh(g t/v_inf), v_inf^2 = m g/k."""
    k, m, t = 0.3, 0.5, 0.5
    limit = np.sqrt(m * G / k)
    mass = fb.PointMass("mass", mass=m, position=(0, 0, 0))
    model = fb.compile_scene(fb.Scene(mass, fb.Drag("air", mass, normal=k), gravity=(0, 0, -G)))

    def speed(n: int) -> float:
        run = fourth(model, t, n)
        assert run.drift("balance") < ROUND_OFF
        return float(run.state.v[2])

    exact = -limit * np.tanh(G * t / limit)
    found = orders(speed, exact, (8, 16, 32))
    assert np.all((found > 3.9) & (found < 4.1)), found
    assert abs(speed(64) / exact - 1.0) < 1e-9


def test_a_motor_on_a_joint_with_a_damper_has_order_four() -> None:
    """J a'' = 2 sin(5 t) - c a', from rest."""
    inertia, c, w = 0.28, 0.4, 5.0
    arm = fb.RigidBody("arm", mass=1.0, inertia=(0.02, 0.03, 0.04), position=(0.5, 0, 0))
    pivot = fb.RevoluteJoint(fb.GROUND, arm.point((-0.5, 0, 0)), "pivot", axis=(0, 1, 0), damping=c,
                             torque=lambda t: 2.0 * np.sin(w * t))
    model = fb.compile_scene(fb.Scene(arm, pivot))

    def angle(n: int) -> float:
        run = fourth(model, 1.0, n)
        parts = run.balance()
        assert float(np.ptp(parts["sum"])) < ROUND_OFF and parts["damper of joint 'pivot'"][-1] > 0.1
        return float(run.joint("pivot")["angle"][-1])

    rate = c / inertia
    at = 2.0 / inertia / (rate**2 + w**2)
    # a' = at (rate sin wt - w cos wt + w exp(-rate t))
    exact = at * (rate * (1.0 - np.cos(w)) / w - np.sin(w) + w * (1.0 - np.exp(-rate)) / rate)
    found = orders(angle, exact, (20, 40, 80))
    assert np.all((found > 3.9) & (found < 4.1)), found


def flight() -> fb.Model:
    """A damped rod that flies, spins and bends a lot in a plane."""
    rod = fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=fb.Section(**SOFT, damping=0.02), elements=8, degree=3)
    bend = fb.InitialVelocity(rod, velocity=lambda s: np.stack((0.0 * s, 2.0 * np.sin(2.0 * s), 0.0 * s), axis=1))
    return fb.compile_scene(fb.Scene(rod, bend, fb.RigidMotion(velocity=(1.0, 0.3, 0.0), spin=(0, 0, 2.0))))


def test_momenta_and_books_stay_at_round_off_in_large_motion(tmp_path: Path) -> None:
    model = flight()
    run = fourth(model, 1.0, 50, output=tmp_path / "run.h5")
    for name in ("balance", "lin_mom", "ang_mom"):
        assert name in run.info["conserved"] and run.drift(name) < ROUND_OFF
    assert np.all(np.diff(run.series["losses"][:, 0]) > 0.0)
    triads = run.directors[-1]
    np.testing.assert_allclose(triads @ triads.transpose(0, 2, 1), np.broadcast_to(np.eye(3), triads.shape), atol=1e-14)
    np.testing.assert_allclose(run.state.q.reshape(-1, 4, 3)[:, 0], run.phi[-1], atol=1e-14)
    rates = np.einsum("nic,njc->nij", run.state.v.reshape(-1, 4, 3)[:, 1:], run.state.q.reshape(-1, 4, 3)[:, 1:])
    np.testing.assert_allclose(rates, -rates.transpose(0, 2, 1), atol=1e-12)
    assert np.array_equal(fb.load_result(tmp_path / "run.h5").series["total"], run.series["total"])
    fine = fb.simulate(model, t_end=1.0, step=1.0 / 1600, progress=False).state.q
    finest = fb.simulate(model, t_end=1.0, step=1.0 / 3200, progress=False).state.q
    exact = (finest + (finest - fine) / 3.0).reshape(-1, 12)[:, :3]
    errors = [np.max(np.abs(fourth(model, 1.0, n).phi[-1] - exact)) for n in (100, 200)]
    assert 3.8 < np.log2(errors[0] / errors[1]) < 4.2
    # it goes on from its end, and the books of both parts are one
    rest = fourth(model, 1.0, 50, output=fb.Output(snapshots=2))
    later = fb.simulate(model, t_end=1.2, step=0.02, order=4, start=rest.checkpoint, progress=False)
    assert later.t[0] == 1.0 and later.drift("balance") < ROUND_OFF
    assert abs(later.series["losses"][0, 0] - rest.series["losses"][-1, 0]) < 1e-12


def test_a_step_that_does_not_fit_becomes_a_whole_part_of_the_time() -> None:
    model, _ = bar(0.02)
    run = fb.simulate(model, t_end=1.0, step=0.03, order=4, every=5, progress=False)
    assert run.info["steps"] == 34 and run.info["step"] == 1.0 / 34
    np.testing.assert_allclose(run.t, [*np.arange(0, 34, 5) / 34, 1.0], rtol=1e-15)
    one = fb.simulate(model, t_end=1.0, step=0.03, order=4, every=5, observe=(), output=fb.Output(snapshots=3), progress=False)
    assert one.t[0] == 0.0 and one.t[-1] == 1.0 and np.array_equal(one.state.q, run.state.q)


def test_runs_that_differ_too_much_are_told() -> None:
    """Many periods of hardly damped vibration, with steps that lose its phase."""
    model, _ = bar(1e-5)
    run = fourth(model, 20.0, 400)
    assert [event["kind"] for event in run.events] == ["extrapolation"] and run.info["difference"] > 0.05
    assert "use smaller steps" in run.events[0]["text"]


@pytest.mark.parametrize(("name", "options"), [
    ("tolerance", {"tolerance": 1e-6}), ("callback", {"callback": lambda t, state: None}),
    ("checkpoint", {"output": fb.Output(checkpoint="run.check")})])
def test_what_needs_one_state_on_the_way_is_refused(name: str, options: dict[str, Any]) -> None:
    with pytest.raises(fb.SceneError, match=f"{name}: order=4 with dissipation"):
        fb.simulate(bar(0.02)[0], t_end=0.1, step=0.01, order=4, progress=False, **options)


def test_a_file_that_is_there_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "run.h5").write_bytes(b"")
    with pytest.raises(fb.ResultFileError, match="exists already"):
        fourth(bar(0.02)[0], 0.1, 10, output=tmp_path / "run.h5")


@pytest.mark.slow
def test_a_slider_with_viscous_friction_and_a_drive_has_order_four() -> None:
    """m s'' = sin(8 t) - c s' on a rigid rail; a run that meets the end of the rail is no run of order 4."""
    rail = fb.Beam.straight("rail", (0, 0, 0), (4, 0, 0), section=fb.Section.circle(radius=0.05, E=200e9, rho=7800.0), elements=4)
    bead = fb.PointMass("bead", mass=0.5)
    rate, w, t = 0.7 / 0.5, 8.0, 0.8
    drive, friction = fb.Drive(force=lambda t: np.sin(8.0 * t)), fb.Friction(viscous=0.7)
    at = 2.0 / (rate**2 + w**2)
    exact = 2.0 + at * (rate * (1.0 - np.cos(w * t)) / w - np.sin(w * t) + w * (1.0 - np.exp(-rate * t)) / rate)

    def driven(drive: fb.Drive) -> fb.Model:
        return fb.compile_scene(fb.Scene(rail, bead, *[fb.Clamp(rail.node(i)) for i in range(rail.n_nodes)],
                                         fb.Slider("s", bead, rail, at=2.0, rate=0.0, friction=friction, drive=drive)))

    model = driven(drive)

    def place(n: int) -> float:
        run = fourth(model, t, n)
        assert run.drift("balance") < ROUND_OFF and run.drift("gap") < 1e-14
        return float(run.slider("s")["s"][-1])

    found = orders(place, exact, (8, 16, 32))
    assert np.all((found > 3.9) & (found < 4.2)), found
    with pytest.raises(fb.ConvergenceError, match="one of them ended at t ="):
        fourth(driven(fb.Drive(force=lambda t: 5.0)), 2.0, 50)
