"""A run cut in two is the run."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parents[1]))
from small_scenes import bead, cantilever, free_beam, straight  # noqa: E402

H = 0.01


def pulled() -> fb.Scene:
    """A clamped beam under a load that changes in time."""
    beam = straight("beam", (0, 0, 0), (3, 0, 0))
    return fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, force=(0, 0, 20), time=lambda t: 1.0 + np.sin(5.0 * t)))


def assert_same_state(a: Any, b: Any) -> None:
    for x, y in zip(a, b):
        np.testing.assert_array_equal(x, y)


@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize("make", [free_beam, bead])
@pytest.mark.parametrize("solver", ["chain", "sparse"])
def test_two_halves_are_the_whole_bit_for_bit(make: Any, order: int, solver: str) -> None:
    model = fb.compile_scene(make(), solver=solver)
    n = 50 if solver == "chain" else 10
    whole = fb.simulate(model, t_end=2 * n * H, step=H, order=order)
    half = fb.simulate(model, t_end=n * H, step=H, order=order)
    rest = fb.simulate(model, t_end=2 * n * H, step=H, order=order, start=half.checkpoint)
    assert (half.info["steps"], rest.info["steps"], whole.info["steps"]) == (n, n, 2 * n)
    assert whole.events == half.events == rest.events == []
    assert_same_state(rest.state, whole.state)
    for name in ("total", "ang_mom", "s_slide"):
        if name in whole.series:
            assert half.series[name][-1].tobytes() == rest.series[name][0].tobytes()


@pytest.mark.parametrize("make", [free_beam, bead])
def test_from_a_state_alone_the_rest_is_the_same_to_round_off(make: Any) -> None:
    # the first guess of a step knows the steps before it, a state does not
    model = fb.compile_scene(make())
    whole = fb.simulate(model, t_end=60 * H, step=H)
    half = fb.simulate(model, t_end=50 * H, step=H)
    rest = fb.simulate(model, start=fb.Start(half.state, time=50 * H), t_end=60 * H, step=H)
    np.testing.assert_allclose(rest.state.q, whole.state.q, rtol=0.0, atol=1e-13)


def test_loads_in_time_go_on_at_the_time_of_the_restart() -> None:
    # times differ by round-off between the two, so do the loads
    model = fb.compile_scene(pulled())
    whole = fb.simulate(model, t_end=100 * H, step=H)
    half = fb.simulate(model, t_end=50 * H, step=H)
    rest = fb.simulate(model, start=fb.Start(half.state, time=50 * H), t_end=100 * H, step=H)
    np.testing.assert_allclose(rest.state.q, whole.state.q, rtol=0.0, atol=1e-12)
    late = fb.simulate(model, t_end=50 * H, step=H, start=half.state)
    assert np.max(np.abs(late.state.q - whole.state.q)) > 1e-3


def test_state_of_a_result_is_no_view_of_the_next_run() -> None:
    model = fb.compile_scene(bead())
    first = fb.simulate(model, t_end=10 * H, step=H)
    kept = [x.copy() for x in first.state]
    fb.simulate(model, start=fb.Start(first.state, time=10 * H), t_end=20 * H, step=H)
    assert_same_state(first.state, kept)
    np.testing.assert_array_equal(model.q0, fb.compile_scene(bead()).q0)


def test_equilibrium_stays_where_it_is() -> None:
    model = fb.compile_scene(cantilever())
    rest = fb.solve_static(model)
    moved = fb.simulate(model, t_end=50 * H, step=H, start=rest.state)
    # residual of a converged equilibrium over mass, twice integrated
    assert np.max(np.abs(moved.state.q - rest.state.q)) <= 1e-9
    assert np.max(moved.series["kinetic"]) <= 1e-18 * np.max(np.abs(moved.series["potential"])) + 1e-18


@pytest.mark.parametrize("scene", [free_beam(), bead(at=1.02, rate=0.2), bead(at=0.7, rate=1.0)],
                         ids=["beam", "bead", "fast bead"])
def test_run_backwards_returns_to_the_start(scene: fb.Scene) -> None:
    model = fb.compile_scene(scene)
    there = fb.simulate(model, t_end=50 * H, step=H)
    back = fb.simulate(model, t_end=50 * H, step=H, start=there.state._replace(v=-there.state.v))
    assert np.max(np.abs(there.state.q - model.q0)) > 0.1
    np.testing.assert_allclose(back.state.q, model.q0, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(back.state.v, -model.v0, rtol=0.0, atol=1e-11)  # differences of q over h
