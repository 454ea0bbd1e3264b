"""Corners of sliding contact: cases of `perf/stress/sliding.py`, and what was wrong there once."""
from __future__ import annotations

import numpy as np
import pytest
from naive import Step, Twin, cayley_vector

import fastbeam as fb
from fastbeam.model import start
from perf.stress import sliding

CASES = {case.name: case for part in sliding.PARTS for case in part()}
QUICK = ["contact force swings through zero", "at rest without load", "mass of 1e-12 kg", "mass of 1e+09 kg",
         "meets element ends at the end of steps, own", "rests on an element end of a swinging beam, c1",
         "starts at s = 0 at the clamp and leaves", "moves to the clamp from s = 0", "arrives at the free end of a swinging beam",
         "rests at the free end", "starts at the free end outwards", "reverses inside a step", "reverses at the end of a step",
         "reverses on an element end", "two meet and pass through each other", "one arrives where another rests",
         "one mass on the same beam twice, swinging", "mass pinned on the clamped node",
         "mass tied to the node of its own beam where it slides"]


@pytest.mark.parametrize("name", QUICK)
def test_corner_is_right(name: str) -> None:
    row = CASES[name].verdict(sliding.AUGMENTATION)
    assert row.ok, row


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in CASES if name not in QUICK])
def test_further_corner_is_right(name: str) -> None:
    row = CASES[name].verdict(sliding.AUGMENTATION)
    assert row.ok, row


def three_points() -> fb.Scene:
    """Three points of one body on one element of degree 1: two of nine gaps follow from the others."""
    return CASES["3 points of one body on one element of degree 1"].scene()


def test_dependent_sliders_meet_all_equations(monkeypatch: pytest.MonkeyPatch) -> None:
    # a start that bends the beam: forces of some N
    monkeypatch.setattr(start, "rigid_change", lambda mass, matrix, right, given, rigid: 0.0 * given)
    # plain multipliers once ran through with forces of 1e8 N, the energy 2e-8 and s 2e-5 m off, and no error
    model = fb.compile_scene(three_points())
    h = 2e-3
    before = fb.simulate(model, t_end=10 * h, step=h, output=fb.Output(snapshots=0)).state
    after = fb.simulate(model, start=before, t_end=h, step=h, output=fb.Output(snapshots=0))
    q, end = (x.q.reshape(-1, 4, 3) for x in (before, after.state))
    twin = Twin(three_points(), model)
    theta = np.array([cayley_vector(b.T @ a) for a, b in zip(q[:, 1:], end[:, 1:])])
    force, v = after.state.force.reshape(-1, 3), before.v.reshape(-1, 4, 3)
    nodes, contact = twin.residual(Step(q, v, end[:, 0] - q[:, 0], theta, before.s, after.state.s, force, h))
    inertia = float(np.max(np.abs(twin.mass))) * float(np.max(np.abs(before.v))) / h
    assert 1.0 < np.max(np.abs(force)) < 10.0
    assert np.max(np.abs(nodes)) < 1e-9 * inertia
    assert np.max(np.abs(contact[:, :3])) < 1e-14 * model.length
    assert np.max(np.abs(contact[:, 3])) < 1e-12 * np.max(np.abs(force))


def test_shared_forces_do_not_grow_in_small_steps() -> None:
    # with the increments of the force alone answering the gap 3000 steps took them from 6 to 1e5 N
    case = CASES["3 points of one body on one element of degree 1"]
    coarse, fine = (case.run(sliding.AUGMENTATION, parts) for parts in (1, 20))
    size = float(np.max(np.abs(coarse.series["contact_force"])))
    assert fine.info["steps"] == 3000
    # how the last row splits a force between sliders that share it is round-off (docs/limits.md); their sum is not
    assert np.max(np.abs(fine.series["contact_force"][:-1])) < 1.2 * size
    last = [run.series["contact_force"][-1].sum(axis=0) for run in (coarse, fine)]
    np.testing.assert_allclose(last[1], last[0], rtol=0.0, atol=0.01 * size)
    assert fine.drift("total") < 1e-13


@pytest.mark.parametrize("planar", [True, False])
def test_plain_multipliers_refuse_dependent_sliders(planar: bool) -> None:
    # the planar border leaves a pivot of 1e-10
    with pytest.raises(fb.ConvergenceError, match="equations of slider 'run [12]' are singular.*Remove one of these constraints"):
        fb.simulate(fb.compile_scene(three_points(), planar=planar), t_end=0.1, step=2e-3, solver=fb.Solver(augmentation=0.0))


def test_a_gap_that_stays_open_is_refused() -> None:
    with pytest.raises(fb.ConvergenceError, match="gap of slider 'run 1' does not close.*raise augmentation"):
        fb.simulate(fb.compile_scene(CASES["two points of one body on one beam, 1e-06 m apart"].scene()), t_end=0.1, step=2e-3)


@pytest.mark.parametrize("settings", [{"order": 4}, {"tolerance": 1e-6}, {"solver": "superlu"}, {"method": "midpoint"}],
                         ids=lambda x: str(*x.values()))
def test_dependent_sliders_run_in_every_way(settings: dict) -> None:
    model = fb.compile_scene(three_points())
    run = fb.simulate(model, t_end=0.05, step=2e-3, output=fb.Output(snapshots=0), **settings)
    exact = fb.simulate(model, t_end=0.05, step=2.5e-4, order=4, output=fb.Output(snapshots=0))
    assert np.max(np.abs(run.state.s - exact.state.s)) < 1e-5
    assert run.drift("gap") < 1e-14


def test_dependent_sliders_have_consistent_accelerations() -> None:
    # the start of the trapezoidal rule called them undetermined
    model = fb.compile_scene(three_points())
    run = fb.simulate(model, method="trapezoidal", t_end=0.05, step=2e-3, output=fb.Output(snapshots=0))
    exact = fb.simulate(model, t_end=0.05, step=2.5e-4, order=4, output=fb.Output(snapshots=0))
    assert np.max(np.abs(run.state.s - exact.state.s)) < 1e-5


def test_restart_with_dependent_sliders_gives_the_same_bits() -> None:
    model = fb.compile_scene(three_points())
    whole = fb.simulate(model, t_end=0.1, step=2e-3)
    half = fb.simulate(model, t_end=0.05, step=2e-3)
    rest = fb.simulate(model, start=half.checkpoint, t_end=0.1, step=2e-3)
    assert [x.tobytes() for x in rest.state] == [x.tobytes() for x in whole.state]


@pytest.mark.parametrize("value", [-1.0, 0.5, 1e13, np.nan, "much"])
def test_augmentation_out_of_range_is_refused(value: object) -> None:
    with pytest.raises(fb.SceneError, match="augmentation"):
        fb.simulate(fb.compile_scene(three_points()), t_end=0.1, step=2e-3, solver=fb.Solver(augmentation=value))
