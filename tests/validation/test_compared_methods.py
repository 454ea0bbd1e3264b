"""What the methods of time integration do to orders, energy, momenta, high frequencies and contact forces."""
from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fastbeam as fb
from fastbeam.model.model import Model
from perf.validation.invariants import rail
from perf.validation.time_order import T_END, soft_scene

Array = np.ndarray
METHODS: dict[str, dict[str, Any]] = {
    "energy_momentum": {}, "midpoint": {"method": "midpoint"}, "trapezoidal": {"method": "trapezoidal"},
    "generalized_alpha 0.8": {"method": fb.Method("generalized_alpha", rho_inf=0.8)}}
OTHERS = [name for name in METHODS if name != "energy_momentum"]
ROUND_OFF = 1e-12  # relative drift over a few hundred steps
LINEAR = 1e-12  # of the amplitude; 40 steps of up to 30 rad, measured up to 3e-13


def alpha(rho_inf: float) -> dict[str, Any]:
    """Generalised alpha."""
    return {"method": fb.Method("generalized_alpha", rho_inf=rho_inf)}


def simulate(model: Model, steps: int, t_end: float, **changes: Any) -> fb.Result:
    """A run of so many steps."""
    return fb.simulate(model, t_end=t_end, step=t_end / steps, output=fb.Output(snapshots=0), progress=False, **changes)


# ------------------------------------------------------------------------------------------------------------------ orders
@cache
def soft(slider: bool) -> tuple[Model, Array]:
    """Soft free beam, with or without a sliding mass; its positions and s at the end, to 1e-10."""
    model = fb.compile_scene(soft_scene(slider, curve="c1"))
    return model, positions(simulate(model, 640, T_END, order=4, observe=()))


def positions(result: fb.Result) -> Array:
    """Positions of the nodes and s at the end."""
    return np.concatenate((result.state.q.reshape(-1, 12)[:, :3].ravel(), result.state.s))


def order_found(slider: bool, steps: int, **method: Any) -> float:
    """Rate of the error between so many steps and twice as many."""
    model, exact = soft(slider)
    errors = [np.max(np.abs(positions(simulate(model, n, T_END, observe=(), **method)) - exact)) for n in (steps, 2 * steps)]
    return float(np.log2(errors[0] / errors[1]))


@pytest.mark.parametrize("slider", [False, True], ids=["free", "slider"])
@pytest.mark.parametrize("name", METHODS)
def test_every_method_has_order_two(name: str, slider: bool) -> None:
    assert order_found(slider, 160, **METHODS[name]) == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("slider", [False, True], ids=["free", "slider"])
@pytest.mark.parametrize("name", ["energy_momentum", "midpoint"])
def test_the_symmetric_methods_compose_to_order_four(name: str, slider: bool) -> None:
    assert order_found(slider, 80, order=4, **METHODS[name]) == pytest.approx(4.0, abs=0.1)


# -------------------------------------------------------------------------------------------------------------- invariants
@cache
def flight(name: str, steps: int, slider: bool = False) -> fb.Result:
    """Two seconds of the soft beam."""
    return simulate(soft(slider)[0], steps, 2.0, every=1, **METHODS[name])


def test_the_conserving_step_keeps_energy_and_momenta() -> None:
    for slider in (False, True):
        result = flight("energy_momentum", 100, slider)
        assert np.ptp(result.series["kinetic"]) > 0.1 * result.info["scale"]["total"]
        assert max(result.drift(key) for key in ("total", "lin_mom", "ang_mom")) <= ROUND_OFF


@pytest.mark.parametrize("slider", [False, True], ids=["free", "slider"])
@pytest.mark.parametrize("name", OTHERS)
def test_the_other_methods_lose_and_gain_energy_of_second_order(name: str, slider: bool) -> None:
    coarse, fine = (flight(name, n, slider).drift("total") for n in (100, 200))
    assert 1e-5 < coarse < 1e-2
    assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.2)


def test_the_midpoint_rule_keeps_momenta_until_something_slides() -> None:
    free, slides = flight("midpoint", 100), flight("midpoint", 100, True)
    assert max(free.drift("lin_mom"), free.drift("ang_mom"), slides.drift("lin_mom")) <= ROUND_OFF
    assert slides.drift("ang_mom") > 1e-9


@pytest.mark.parametrize("slider", [False, True], ids=["free", "slider"])
@pytest.mark.parametrize("name", ["trapezoidal", "generalized_alpha 0.8"])
def test_equilibrium_at_the_end_of_a_step_keeps_linear_momentum_only(name: str, slider: bool) -> None:
    coarse, fine = (flight(name, n, slider) for n in (100, 200))
    assert coarse.drift("lin_mom") <= ROUND_OFF
    assert coarse.drift("ang_mom") > 1e-7
    assert np.log2(coarse.drift("ang_mom") / fine.drift("ang_mom")) == pytest.approx(2.0, abs=0.3)


def test_the_lower_rho_inf_the_more_energy_a_flight_with_fast_waves_loses() -> None:
    model = fb.compile_scene(fb.Scene(*rail(degree=2)))
    lost = []
    for rho in (1.0, 0.8, 0.5, 0.0):
        result = simulate(model, 100, 2.0, observe=("energy",), **alpha(rho))
        lost.append((result.series["total"][0] - result.series["total"][-1]) / result.series["total"][0])
    assert lost == sorted(lost) and abs(lost[0]) < 1e-5
    assert lost[1] > 1e-5 and lost[3] > 1e-3


# ------------------------------------------------------------------------------------------------- one degree of freedom
def vibrate(frequency: float, h: float, steps: int, **method: Any) -> tuple[Array, float]:
    """Displacements of the tip of a bar of one linear element, held at x = 0 and moving along its axis, at all steps, and its
    last velocity: a linear oscillator of mass rhoA L/3 = 1 that starts with the velocity 0.1 w, for an amplitude of 0.1."""
    section = fb.Section(EA=frequency**2, GA2=1e3, GA3=1e3, GJ=1e3, EI2=1e3, EI3=1e3, rhoA=3.0, rhoI2=1.0, rhoI3=1.0)
    beam = fb.Beam.straight("bar", (0, 0, 0), (1, 0, 0), section=section, elements=1, degree=1)
    move = fb.InitialVelocity(beam, velocity=lambda s: np.outer(0.1 * frequency * s, (1, 0, 0)))
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), move))
    result = simulate(model, steps, steps * h, every=1, points={"tip": beam.end}, observe=(), **method)
    return result.point("tip")[:, 0] - 1.0, float(result.state.v[12])


def chung_hulbert(w: float, h: float, steps: int, rho: float) -> tuple[Array, float]:
    """u and the last u' of u'' + w^2 u = 0, u(0) = 0, u'(0) = 0.1 w, by the formulas of Chung and Hulbert (1993)."""
    am, af = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
    beta, gamma = 0.25 * (1.0 - am + af)**2, 0.5 - am + af
    u, v, a = [0.0], 0.1 * w, 0.0
    for _ in range(steps):
        known = u[-1] + h * v + h * h * (0.5 - beta) * a
        a_end = -(am * a + w * w * ((1.0 - af) * known + af * u[-1])) / (1.0 - am + w * w * (1.0 - af) * beta * h * h)
        u.append(known + h * h * beta * a_end)
        v, a = v + h * ((1.0 - gamma) * a + gamma * a_end), a_end
    return np.array(u), v


@pytest.mark.parametrize("phase", [0.3, 3.0, 30.0])
@pytest.mark.parametrize("rho_inf", [0.0, 0.5, 0.9, 1.0])
def test_a_linear_oscillator_follows_the_formulas_of_chung_and_hulbert(rho_inf: float, phase: float) -> None:
    h, steps = 0.01, 40
    u, v = vibrate(phase / h, h, steps, **alpha(rho_inf))
    exact, exact_v = chung_hulbert(phase / h, h, steps, rho_inf)
    np.testing.assert_allclose(u, exact, rtol=0.0, atol=LINEAR * np.max(np.abs(exact)))
    assert abs(v - exact_v) <= LINEAR * 0.1 * phase / h


@pytest.mark.parametrize("phase", [0.3, 3.0, 30.0])
@pytest.mark.parametrize("name", ["energy_momentum", "midpoint", "trapezoidal"])
def test_a_linear_oscillator_keeps_its_amplitude(name: str, phase: float) -> None:
    # all three turn (w u, u') by 2 arctan(w h / 2) a step
    h, steps = 0.01, 40
    u, v = vibrate(phase / h, h, steps, **METHODS[name])
    turned = 2.0 * np.arctan(0.5 * phase) * np.arange(steps + 1)
    np.testing.assert_allclose(u, 0.1 * np.sin(turned), rtol=0.0, atol=LINEAR * 0.1)
    assert v == pytest.approx(0.1 * phase / h * np.cos(turned[-1]), abs=LINEAR * 0.1 * phase / h)


@pytest.mark.parametrize("rho_inf", [0.0, 0.5, 0.8])
def test_high_frequencies_decay_by_rho_inf_a_step(rho_inf: float) -> None:
    # three equal roots: rho^n times a polynomial in n of degree 2; below that the round-off of a position of 1 m
    h, n = 0.01, 120
    u, _ = vibrate(1e4 / h, h, n, **alpha(rho_inf))
    assert np.max(np.abs(u[-3:])) <= n**2 * rho_inf**(n - 3) * np.max(np.abs(u)) + 1e-15
    kept, _ = vibrate(1e4 / h, h, n, **alpha(1.0))
    assert np.max(np.abs(kept[-3:])) > 0.5 * np.max(np.abs(kept))


# --------------------------------------------------------------------------------------------------------------- one body
def top() -> fb.Scene:
    """A free asymmetric top that turns over."""
    return fb.Scene(fb.RigidBody("top", mass=2.0, inertia=(1.0, 2.0, 3.0), position=(0.5, 0, 0), velocity=(1, 2, 3),
                                 spin=(0.5, 3.0, 0.3)))


@pytest.mark.parametrize("method", [METHODS["trapezoidal"], alpha(0.8), alpha(0.3)], ids=["trapezoidal", "0.8", "0.3"])
def test_a_top_follows_euler_s_equations_with_order_two(method: dict[str, Any]) -> None:
    j = np.array([1.0, 2.0, 3.0])

    def rate(t: float, y: Array) -> Array:
        w, d = y[:3], y[3:].reshape(3, 3)
        return np.concatenate((np.cross(j * w, w) / j, np.cross(w @ d, d).reshape(-1)))

    start = np.concatenate(((0.5, 3.0, 0.3), np.eye(3).reshape(-1)))
    exact = solve_ivp(rate, (0.0, 2.0), start, method="DOP853", rtol=1e-12, atol=1e-13).y[3:, -1]
    model = fb.compile_scene(top())
    states = [simulate(model, n, 2.0, observe=(), **method).state for n in (200, 400)]
    errors = [np.max(np.abs(state.q[3:] - exact)) for state in states]
    assert errors[1] < 1e-2
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)
    # free fall of the centre is exact
    np.testing.assert_allclose(states[0].q[:3], (2.5, 4.0, 6.0), rtol=1e-12)


def test_without_strains_the_midpoint_rule_is_the_conserving_step() -> None:
    model = fb.compile_scene(top())
    a, b = (simulate(model, 100, 2.0, **METHODS[name]) for name in ("energy_momentum", "midpoint"))
    np.testing.assert_allclose(b.state.q, a.state.q, rtol=0.0, atol=1e-13)
    assert b.drift("total") <= ROUND_OFF


# ---------------------------------------------------------------------------------------------------------- contact force
def jitter(steps: int, **method: Any) -> float:
    """Largest second difference of the contact force in the last third of a run, relative to the force."""
    force = simulate(soft(True)[0], steps, T_END, every=1, **method).series["contact_force"][:, 0]
    jumps = np.linalg.norm(force[2:] - 2.0 * force[1:-1] + force[:-2], axis=1)[-steps // 3:]
    return float(np.max(jumps) / np.max(np.linalg.norm(force, axis=1)))


def test_damping_settles_the_contact_force_and_the_trapezoidal_rule_does_not() -> None:
    # a gap that is closed in positions leaves a force that swings from step to step; its amplitude is no matter of the step size
    damped = [jitter(n, **alpha(0.8)) for n in (100, 200)]
    undamped = [jitter(n, **METHODS["trapezoidal"]) for n in (100, 200)]
    assert damped[0] < 1e-2 and damped[1] < 0.4 * damped[0]
    assert min(undamped) > 3e-2 and undamped[1] > 0.5 * undamped[0]
