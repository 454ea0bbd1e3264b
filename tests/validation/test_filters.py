"""High frequencies that conserving steps dissipate by `rho_inf`: against the recursion of one vibration, what is kept, order,
runs that go on, and what is refused."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.dynamics.filtering import filter_factors

Array = np.ndarray
ROUND_OFF = 1e-12
SOFT = dict(EA=100.0, GA2=50.0, GA3=50.0, GJ=0.7, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=0.01, rhoI3=0.01)


def one_step(x: float, rho: float) -> Array:
    """Matrix of a step with x = w h for (u, h v, h m, h r), from theory.md (4.1) and (6.2), without any of the code."""
    a, b, kappa = filter_factors(rho)
    out = np.zeros((4, 4))
    for k, (u, v, m, r) in enumerate(np.eye(4)):
        # Du = v + Dv/2, Dv = - x^2 (u + Du/2 + a (Du - m) + 2 b (Du - r))
        change = (2.0 * v - x**2 * (u - a * m - 2.0 * b * r)) / (2.0 + x**2 * (0.5 + a + 2.0 * b))
        out[:, k] = u + change, 2.0 * change - v, m + kappa * (change - m), 2.0 * change - r
    return out


def roots(x: float, rho: float) -> Array:
    """Without the -1 of r - v, which is zero from the start."""
    mu = np.linalg.eigvals(one_step(x, rho))
    return mu[np.argsort(np.abs(mu + 1.0))][1:]


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.5, 0.8, 0.95])
def test_the_roots_of_a_step_are_those_of_the_theory(rho: float) -> None:
    """(6.4) and (6.5), of the recursion."""
    assert np.max(np.abs(roots(1e9, rho) + rho)) < 2e-5
    radii = [np.max(np.abs(roots(x, rho))) for x in np.logspace(-2, 6, 200)]
    assert np.max(radii) < 1.0 and np.all(np.diff(radii) < 1e-5)
    chi, x = (1.0 - rho) / (1.0 + rho), 0.05
    slow = roots(x, rho)[np.argmin(np.abs(roots(x, rho) - np.exp(1j * x)))]
    angle = abs(np.angle(slow))
    assert -np.log(abs(slow)) / angle == pytest.approx(0.5 * (chi * x)**3, rel=0.02)
    assert 1.0 - angle / x == pytest.approx(x**2 * (1.0 / 12.0 + 0.375 * chi**2), rel=0.02)


def bar(**options: Any) -> tuple[fb.Model, fb.Beam]:
    """A bar of length 1, clamped at one end, in its first axial mode of angular frequency 5 pi."""
    beam = fb.Beam.straight("bar", (0, 0, 0), (1, 0, 0), section=fb.Section(**SOFT), elements=8, degree=3)
    push = fb.InitialVelocity(beam, velocity=lambda s: np.outer(1e-3 * np.sin(0.5 * np.pi * s), (1, 0, 0)))
    return fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), push), **options), beam


@pytest.mark.parametrize(("rho", "h"), [(0.5, 0.05), (0.0, 1.0), (0.8, 20.0)])
@pytest.mark.parametrize("planar", ["auto", pytest.param(False, marks=pytest.mark.slow)])
def test_a_bar_follows_the_recursion_of_its_mode(rho: float, h: float, planar: Any) -> None:
    """Strains are linear in the stretch; w h = 0.8, 16 and 314."""
    model, beam = bar(planar=planar)
    run = fb.simulate(model, t_end=10 * h, step=h, method=fb.Method(rho_inf=rho), every=1, points={"tip": beam.end},
                      progress=False)
    step, y, found = one_step(5.0 * np.pi * h, rho), 1e-3 * h * np.array([0.0, 1.0, 1.0, 1.0]), [0.0]
    for _ in range(10):
        y = step @ y
        found.append(y[0])
    assert np.max(np.abs(run.point("tip")[:, 0] - 1.0 - found)) < 1e-8 * np.max(np.abs(found))
    assert run.drift("balance") < 1e-10
    if rho == 0.0:
        # nothing is left where nothing is resolved
        assert run.series["total"][-1] < 1e-3 * run.series["total"][0]


def flight(elements: int = 8) -> fb.Model:
    """A rod that flies, spins and bends a lot in a plane."""
    rod = fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=fb.Section(**SOFT), elements=elements, degree=3)
    bend = fb.InitialVelocity(rod, velocity=lambda s: np.stack((0.0 * s, 2.0 * np.sin(2.0 * s), 0.0 * s), axis=1))
    return fb.compile_scene(fb.Scene(rod, bend, fb.RigidMotion(velocity=(1.0, 0.3, 0.0), spin=(0, 0, 2.0))))


def test_momenta_stay_books_close_and_energy_falls_in_every_step() -> None:
    model = flight()
    runs = {n: fb.simulate(model, t_end=1.0, step=1.0 / n, method=fb.Method(rho_inf=0.5), every=1,
                           progress=False) for n in (20, 400, 1600)}
    for run in runs.values():
        assert "total" not in run.info["conserved"] and "rho_inf = 0.5" in run.info["method"]
        for name in ("balance", "lin_mom", "ang_mom"):
            assert name in run.info["conserved"] and run.drift(name) < ROUND_OFF
        parts = run.balance()
        assert np.all(np.diff(parts["dissipated by filters"]) > 0.0)
        held = parts["kinetic"] + parts["strain"] + parts["stored in filters"]
        assert np.all(np.diff(held) < 1e-13 * held[0])
    assert runs[20].series["filter_loss"][-1, 0] > 10.0 * runs[1600].series["filter_loss"][-1, 0]
    # 1 dissipates nothing
    plain, one = (fb.simulate(model, t_end=0.2, step=0.01, method=fb.Method(rho_inf=rho), progress=False) for rho in (None, 1.0))
    assert np.array_equal(plain.state.q, one.state.q) and "filter_loss" not in one.series


def test_errors_in_large_motion_are_of_second_order_and_as_large_as_the_theory_says() -> None:
    """Those of the frequencies of (6.4), 1 + 9 chi^2/2 times those of the conserving step."""
    model = flight(3)

    def place(n: int, **options: Any) -> Array:
        return fb.simulate(model, t_end=1.0, step=1.0 / n, observe=(), progress=False, **options).state.q.reshape(-1, 12)[:, :3]

    plain = [place(n) for n in (1600, 3200, 12800)]
    exact = plain[2] + (plain[2] - plain[1]) / 15.0
    own = [np.max(np.abs(place(n, method=fb.Method(rho_inf=0.5)) - exact)) for n in (1600, 3200)]
    assert own[0] / own[1] == pytest.approx(4.0, rel=0.05)
    assert own[1] / np.max(np.abs(plain[1] - exact)) == pytest.approx(1.5, rel=0.02)


def test_a_run_goes_on_from_a_checkpoint_bit_for_bit_and_step_control_books_what_it_keeps() -> None:
    model = flight()
    options = {"step": 0.01, "method": fb.Method(rho_inf=0.5), "every": 10, "progress": False}
    whole, half = (fb.simulate(model, t_end=t, **options) for t in (0.6, 0.3))
    rest = fb.simulate(model, t_end=0.6, start=half.checkpoint, **options)
    assert all(np.array_equal(a, b) for a, b in zip(whole.state, rest.state))
    assert np.array_equal(whole.series["filter_loss"][-1], rest.series["filter_loss"][-1])
    with pytest.raises(fb.SceneError, match="the checkpoint has"):
        fb.simulate(model, t_end=0.6, start=half.checkpoint, step=0.01, progress=False)
    run = fb.simulate(model, t_end=0.5, step=0.01, method=fb.Method(rho_inf=0.5), tolerance=1e-5, progress=False)
    assert run.info["accepted"] > 5 and run.drift("balance") < ROUND_OFF


def test_motions_without_strain_do_not_know_of_filters() -> None:
    rod = fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=fb.Section(**SOFT), elements=3, degree=3)
    model = fb.compile_scene(fb.Scene(rod, fb.RigidMotion(velocity=(1.0, 0.3, 0.0))))
    run = fb.simulate(model, t_end=1.0, step=0.1, method=fb.Method(rho_inf=0.0), progress=False)
    np.testing.assert_allclose(run.phi[-1] - run.phi[0], np.broadcast_to((1.0, 0.3, 0.0), run.phi[0].shape), atol=1e-13)
    assert np.max(np.abs(run.series["filter_loss"])) < 1e-18


@pytest.mark.slow
def test_equilibria_stay() -> None:
    beam = fb.Beam.straight("bar", (0, 0, 0), (1, 0, 0), section=fb.Section(**SOFT), elements=8, degree=3)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), gravity=(0, -3, 0)))
    rest = fb.solve_static(model).state
    run = fb.simulate(model, t_end=5.0, step=0.5, method=fb.Method(rho_inf=0.2), start=rest, progress=False)
    assert np.max(np.abs(run.state.q - rest.q)) < 1e-12 and np.max(np.abs(run.series["filter_loss"])) < 1e-20


@pytest.mark.parametrize(("damping", "options", "says"), [
    (0.0, {"order": 4}, "order=2"), (0.01, {}, "has material damping"), (0.0, {"observe": ("reaction",)}, "'reaction'"),
    (0.0, {"method": fb.Method("midpoint", rho_inf=0.5)}, "not for 'midpoint'"),
    (0.0, {"method": fb.Method(rho_inf=1.5)}, "must lie in")])
def test_what_filters_do_not_go_together_with_is_refused(damping: float, options: dict[str, Any], says: str) -> None:
    beam = fb.Beam.straight("bar", (0, 0, 0), (1, 0, 0), section=fb.Section(**SOFT, damping=damping), elements=2)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start)))
    with pytest.raises(fb.SceneError, match=says):
        fb.simulate(model, t_end=0.1, step=0.01, progress=False, **{"method": fb.Method(rho_inf=0.5), **options})
    mass = fb.PointMass("mass", mass=1.0, position=(0, 0, 0))
    with pytest.raises(fb.SceneError, match="no beams"):
        fb.simulate(fb.compile_scene(fb.Scene(mass)), t_end=0.1, step=0.01, method=fb.Method(rho_inf=0.5), progress=False)


@pytest.mark.slow
def test_in_space_with_twist_and_a_slider_that_leaves_its_beam_the_books_close() -> None:
    """The step in which the slider passes the end is taken back, and the filters with it."""
    rod = fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=fb.Section(**SOFT), elements=6, degree=3)
    bend = fb.InitialVelocity(rod, velocity=lambda s: np.stack((0.0 * s, 2.0 * np.sin(2.0 * s), s * s), axis=1), spin=(1.0, 0, 0))
    bead = fb.PointMass("bead", mass=0.5)
    model = fb.compile_scene(fb.Scene(rod, bend, bead, fb.Slider("s", bead, rod, at=1.5, rate=1.0),
                                      fb.RigidMotion(velocity=(1.0, 0.3, 0.0), spin=(0, 0, 2.0))))
    run = fb.simulate(model, t_end=2.0, step=0.05, method=fb.Method(rho_inf=0.5), every=1, progress=False)
    assert run.events[-1]["kind"] == "slider" or "reached the end" in run.events[-1]["text"]
    for name in ("balance", "lin_mom", "ang_mom"):
        assert run.drift(name) < ROUND_OFF
    assert run.series["filter_loss"][-1, 0] > 1e-3 and run.series["gap"].max() < 1e-13
