"""Damping of sections: exact decay, the energy that it takes, momenta that it leaves alone, restart, and what it does not go
together with."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb

Array = np.ndarray
SOFT = dict(EA=100.0, GA2=50.0, GA3=50.0, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=0.01, rhoI3=0.01)
# of the energies that occur
ROUND_OFF = 1e-12


def bar(tau: float, steps: int, amplitude: float = 1.0, **options: Any) -> tuple[fb.Result, float]:
    """A bar of length 1, clamped at one end, in its first axial mode over 1 s, and the angular frequency of that."""
    beam = fb.Beam.straight("bar", (0, 0, 0), (1, 0, 0), section=fb.Section(**SOFT, damping=tau), elements=8, degree=3,
                            **{x: options.pop(x) for x in ("strain",) if x in options})
    push = fb.InitialVelocity(beam, velocity=lambda s: np.outer(amplitude * np.sin(0.5 * np.pi * s), (1, 0, 0)))
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), push), **options)
    return fb.simulate(model, t_end=1.0, step=1.0 / steps, points={"tip": beam.end}, progress=False), 5.0 * np.pi


def decayed(tau: float, w: float, t: float) -> float:
    """Displacement of the tip of that bar for a velocity of 1 at its start: u'' + tau w^2 u' + w^2 u = 0."""
    zeta = 0.5 * w * tau
    root = w * np.sqrt(complex(1.0 - zeta**2))
    return float((np.exp(-zeta * w * t) * np.sin(root * t) / root).real)


@pytest.mark.parametrize("tau", [0.02, 0.2])
@pytest.mark.parametrize("planar", ["auto", False])
def test_a_bar_decays_as_that_of_kelvin_and_voigt(tau: float, planar: bool | str) -> None:
    """Simo-Reissner strains are linear in the stretch, so the mode is linear at any amplitude; the longer time overdamps it."""
    runs = [bar(tau, steps, planar=planar) for steps in (200, 400, 800)]
    u = np.array([run.point("tip")[-1, 0] - 1.0 for run, _ in runs])
    exact = decayed(tau, runs[0][1], 1.0)
    errors = np.abs(u - exact)
    assert np.all(np.log2(errors[:-1] / errors[1:]) > 1.9)
    first = u[1:] + np.diff(u) / 3.0
    assert abs(first[1] + (first[1] - first[0]) / 15.0 - exact) < 1e-6 * abs(exact)
    assert max(run.drift("balance") for run, _ in runs) < ROUND_OFF
    lost = runs[0][0].balance()["damping of beam 'bar'"]
    assert np.all(np.diff(lost) >= 0.0) and lost[-1] > 0.9 * 0.25


def flight(damping: Any, planar: bool | str = "auto", twist: float = 0.0) -> fb.Scene:
    """A beam that flies, spins and bends a lot."""
    section = fb.Section(**{**SOFT, "GJ": 0.7}, damping=damping)
    beam = fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=section, elements=6, degree=3)
    bend = fb.InitialVelocity(beam, velocity=lambda s: np.stack((0.0 * s, 2.0 * np.sin(2.0 * s), twist * s * s), axis=1),
                              spin=(twist, 0, 0))
    return fb.Scene(beam, bend, fb.RigidMotion(velocity=(1.0, 0.3, 0.0), spin=(0, 0, 2.0)))


def test_momenta_stay_and_the_energy_is_booked_in_large_motion() -> None:
    times = (0.02, 0.03, 0.01, 0.05, 0.02, 0.04)
    run = fb.simulate(fb.compile_scene(flight(times, twist=1.0)), t_end=1.0, step=0.01, progress=False)
    assert "total" not in run.info["conserved"]
    for name in ("balance", "lin_mom", "ang_mom"):
        assert name in run.info["conserved"] and run.drift(name) < ROUND_OFF
    lost = run.series["losses"][:, 0]
    assert run.names["losses"] == ["damping of beam 'rod'"] and np.all(np.diff(lost) > 0.0) and lost[-1] > 0.5


def test_a_plane_gives_the_numbers_of_space() -> None:
    scene = flight((0.02, 0.03, 0.03, 0.0, 0.05, 0.05))
    flat, space = (fb.simulate(fb.compile_scene(scene, planar=planar), t_end=1.0, step=0.01, progress=False)
                   for planar in (True, False))
    np.testing.assert_allclose(flat.state.q, space.state.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(flat.series["losses"], space.series["losses"], rtol=1e-11)


def test_a_run_goes_on_from_a_checkpoint_bit_for_bit() -> None:
    model = fb.compile_scene(flight(0.02))
    whole = fb.simulate(model, t_end=0.6, step=0.01, every=10, progress=False)
    half = fb.simulate(model, t_end=0.3, step=0.01, every=10, progress=False)
    rest = fb.simulate(model, t_end=0.6, step=0.01, every=10, start=half.checkpoint, progress=False)
    assert all(np.array_equal(a, b) for a, b in zip(whole.state, rest.state))
    assert np.array_equal(whole.series["losses"][-1], rest.series["losses"][-1]) and rest.series["losses"][0, 0] > 0.0


def test_step_control_books_what_it_keeps() -> None:
    run = fb.simulate(fb.compile_scene(flight(0.02)), t_end=0.5, step=0.01, tolerance=1e-5, progress=False)
    assert run.info["rejected"] + run.info["accepted"] > 5 and run.drift("balance") < ROUND_OFF


def test_of_two_beams_each_has_its_own_account_and_one_without_damping_has_none() -> None:
    section = fb.Section(**SOFT)
    slow = fb.Section(**SOFT, damping=0.05)
    a, b, c = (fb.Beam.straight(name, (0, y, 0), (1, y, 0), section=s, elements=3, degree=3)
               for name, y, s in (("a", 0.0, slow), ("b", 1.0, section), ("c", 2.0, slow)))
    clamps = [fb.Clamp(x.start) for x in (a, b, c)]
    model = fb.compile_scene(fb.Scene(a, b, c, *clamps, fb.Load("pull", a.end, force=(0, 1, 0)), gravity=(0, -3, 0)))
    run = fb.simulate(model, t_end=0.5, step=0.01, progress=False)
    assert "energy taken       damping of beam 'a', damping of beam 'c'" in str(model)
    balance = run.balance()
    assert [name for name in balance if "damping" in name] == ["damping of beam 'a'", "damping of beam 'c'"]
    assert run.drift("balance") < ROUND_OFF and balance["damping of beam 'a'"][-1] != balance["damping of beam 'c'"][-1]
    alone = fb.simulate(fb.compile_scene(fb.Scene(c, clamps[2], gravity=(0, -3, 0))), t_end=0.5, step=0.01, progress=False)
    np.testing.assert_allclose(alone.series["losses"][:, 0], run.series["losses"][:, 1], rtol=1e-9, atol=1e-15)


def test_equilibria_do_not_know_damping() -> None:
    found = []
    for tau in (0.0, 0.1):
        beam = fb.Beam.straight("b", (0, 0, 0), (1, 0, 0), section=fb.Section(**SOFT, damping=tau), elements=3, degree=3)
        model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), gravity=(0, -3, 0)))
        found.append(fb.solve_static(model).state.q)
    assert np.array_equal(*found)


@pytest.mark.parametrize(("options", "says"), [({"method": "midpoint"}, "does not support damping"),
                                               ({"method": "generalized_alpha"}, "does not support damping")])
def test_what_damping_does_not_go_together_with_is_refused(options: dict[str, Any], says: str) -> None:
    with pytest.raises(fb.SceneError, match=says) as refused:
        fb.simulate(fb.compile_scene(flight(0.02)), t_end=0.1, step=0.01, progress=False, **options)
    assert "beam 'rod'" in str(refused.value)


@pytest.mark.slow
def test_a_damped_net_is_condensed_to_the_same_numbers() -> None:
    section = fb.Section(**SOFT, damping=(0.02, 0.02, 0.02, 0.01, 0.03, 0.03))
    grid = np.array([(x, y, 0.0) for x in range(4) for y in range(4)])
    edges = [(4 * x + y, 4 * x + y + 1) for x in range(4) for y in range(3)] + [(4 * x + y, 4 * x + y + 4) for x in range(3)
                                                                               for y in range(4)]
    net = fb.Net("net", grid, edges, section=section, elements=4, degree=2, clamps=[0, 12])
    scene = fb.Scene(net, gravity=(0, 0, -2))
    runs = [fb.simulate(fb.compile_scene(scene, condense=condense), t_end=0.2, step=0.01, progress=False, **options)
            for condense, options in ((False, {}), (True, {"solver": fb.Solver(threads=1)}),
                                      (True, {"solver": fb.Solver(threads=2)}))]
    assert max(run.drift("balance") for run in runs) < ROUND_OFF
    np.testing.assert_allclose(runs[1].state.q, runs[0].state.q, rtol=0, atol=1e-11)
    np.testing.assert_allclose(runs[1].series["losses"], runs[0].series["losses"], rtol=1e-9)
    assert np.array_equal(runs[1].series["losses"], runs[2].series["losses"])


@pytest.mark.slow
@pytest.mark.parametrize("planar", ["auto", False])
def test_the_balance_of_strains_of_green_and_lagrange(planar: bool | str) -> None:
    run, _ = bar(0.02, 200, strain="green_lagrange", planar=planar)
    assert run.drift("balance") < ROUND_OFF and run.series["losses"][-1, 0] > 0.1
