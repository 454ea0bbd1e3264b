"""Corners of parameters and of linear algebra: the fast core of `perf/stress`; right, or refused with the reason."""
from __future__ import annotations

import numpy as np
import pytest

import fastbeam as fb
from perf.stress import drift, linear_algebra, parameters


def wrong(rows: object) -> list[str]:
    """Rows that are not ok; a part without rows is wrong too."""
    found = list(rows)
    return [str(row) for row in found if not row.ok] if found else ["no rows"]


@pytest.mark.parametrize("change", [{"EA": 1e-2}, {"EA": 1e10}, {"GA": 1e10}, {"GJ": 5e-4}, {"EI": 5e8}], ids=str)
def test_stiffness_ratios(change: dict[str, float]) -> None:
    assert parameters.judge(parameters.flight(parameters.section(**change)), parameters.H, 20).right


@pytest.mark.parametrize("share", [1e-9, 1e9])
def test_mass_of_the_bead(share: float) -> None:
    assert parameters.judge(parameters.flight(parameters.section(), mass=share * parameters.LENGTH), parameters.H, 20).right


def test_massless_triads_move_with_a_clamp_and_are_named_without() -> None:
    held = parameters.judge(parameters.swing(parameters.section(rhoI=0.0)), parameters.H, 20)
    assert held.right
    free = parameters.judge(parameters.flight(parameters.section(rhoI=0.0)), parameters.H, 20)
    assert "massless" in free.events and free.honest


def test_small_vibrations_have_their_exact_frequency() -> None:
    assert wrong(parameters.tones(np.array([1e-6, 1e6]))) == []


def test_steps_that_turn_too_far_are_named() -> None:
    # vanishing spins passed for convergence: the step with 1000 rad was accepted with all its energy lost
    assert wrong(parameters.turns()) == []


@pytest.mark.parametrize("slenderness", [1e1, 1e4])
def test_slender_cantilevers_are_those_of_the_theory(slenderness: float) -> None:
    assert wrong(parameters.slender(np.array([slenderness]))) == []


def test_sparse_solver_takes_slender_beams() -> None:
    # refused as singular before, by a residual relative to the loads alone
    assert wrong(parameters.slender(np.array([1e4]), "sparse")) == []


def test_hostile_matrices_are_solved_or_refused() -> None:
    assert wrong(linear_algebra.matrices(5)) == []


def test_step_whose_inner_pivot_vanishes_is_taken_without_elimination() -> None:
    # refused as singular before, although the matrix is regular
    model = fb.compile_scene(linear_algebra.bar(), planar=False)
    start = linear_algebra.stretched(model)
    h = linear_algebra.vanishing_step(model, start)[1]
    found = fb.simulate(model, t_end=h, step=h, start=fb.Start(start, time=0.0))
    assert found.info["fallbacks"] == 1 and found.drift("total") <= 1e-13
    assert wrong(linear_algebra.inner_pivots()) == []


def test_buckled_equilibria_are_called_unstable() -> None:
    assert wrong(linear_algebra.buckling()) == []
    assert wrong(linear_algebra.imperfect()) == []


def test_mechanisms_are_named() -> None:
    assert wrong(linear_algebra.mechanisms()) == []


def test_parts_added_after_compiling_do_not_reach_the_repeated_step() -> None:
    scene = linear_algebra.bar()
    model = fb.compile_scene(scene)
    scene.add(fb.PointMass("later", mass=1.0, position=(0, 0, 5)))
    assert model.uneliminated().n_nodes == model.n_nodes and model.uneliminated().inner is None


@pytest.mark.slow
@pytest.mark.parametrize("name", drift.SCENES)
def test_round_off_stays_round_off_over_many_steps(name: str) -> None:
    run, growth = drift.march(name, 20_000)
    assert run.info["steps"] == 20_000
    # 1e-10 after 1e6 steps, were it a trend
    assert {key: of.largest[-1] for key, of in growth.items() if of.largest[-1] > 2e-12} == {}


@pytest.mark.parametrize("elements", [3, 7, 8])
def test_lanes_without_an_element_stay_idle(elements: int) -> None:
    # once they fed on what they had left behind the last row: 1e114 after 200 steps, 92 of them repeated with SuperLU
    section = fb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=0.1, rhoI3=0.1)
    beam = fb.Beam.arc("arc", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=1.5, angle=1.5, section=section, elements=elements)
    wave = fb.InitialVelocity(beam, velocity=lambda s: np.stack((0 * s, 0.3 * np.sin(3 * s), 0.2 * np.cos(2 * s)), axis=1))
    model = fb.compile_scene(fb.Scene(beam, fb.RigidMotion(spin=(0.5, 0.3, 1.0)), wave), planar=False)
    whole = fb.simulate(model, t_end=20.0, step=0.1, progress=False)
    assert whole.info["fallbacks"] == 0 and whole.info["iterations"] <= 4.5 * whole.info["steps"]
    half = fb.simulate(model, t_end=10.0, step=0.1, progress=False)
    rest = fb.simulate(model, start=half.checkpoint, t_end=20.0, step=0.1, progress=False)
    assert np.array_equal(rest.state.q, whole.state.q)
