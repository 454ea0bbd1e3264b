"""Taut thin ropes: right by default. Once invariants stayed at round-off while a rope let its load fall by 40 m."""
from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[2] / "perf" / "stress")]

import fastbeam as fb  # noqa: E402
import taut  # noqa: E402


def wrong(rows: object) -> list[str]:
    return [str(row) for row in rows if not row.ok]  # type: ignore[attr-defined]


def test_ropes_are_stable_and_vibrate_as_strings() -> None:
    assert wrong(taut.ropes(quick=True)) == []


def test_the_load_swings_whatever_the_step_and_the_mesh() -> None:
    assert wrong(taut.swings(quick=True)) == []


def test_elevator_crane_and_contact_wire() -> None:
    assert wrong(taut.machines(quick=True)) == []


def test_cubic_elements_vibrate_as_a_string_to_four_digits() -> None:
    # eight elements, EI negligible; the bar is 1e-2
    assert np.abs(taut.frequency_errors(1e6, 8, degree=3)).max() < 1e-4


@pytest.mark.parametrize("elements,tension,share,family", [
    (8, 1e6, 1e-3, {"degree": 2}), (6, 1e8, 1e-2, {"degree": 3}), (2, 1e8, 1e-2, {"degree": 4}), (8, 1e8, 0.1, {"degree": 3}),
    (4, 1e6, 1e-3, {"degree": 3, "interpolation": "bspline"})])
def test_a_bent_rope_is_stable(elements: int, tension: float, share: float, family: dict[str, object]) -> None:
    """The first load step of a quarter led to folded shapes, that are in equilibrium too, or needed steps below 1e-6."""
    result = taut.stretched(tension, elements, share * tension, **family)[1]
    assert result.info["unstable_directions"] == 0 and not [x for x in result.events if x["kind"] == "unstable"]
    end = result.state.q.reshape(-1, 4, 3)[-1, 0]
    np.testing.assert_allclose(end[:2], (1.0 / np.hypot(1.0, share), share / np.hypot(1.0, share)), rtol=0.03, atol=2e-4)


def test_an_unstable_equilibrium_is_looked_for_again_but_not_from_a_start() -> None:
    column = fb.Beam.straight("column", (0, 0, 0), (0, 0, 1), section=taut.wire(100.0), elements=4)
    model = fb.compile_scene(fb.Scene(column, fb.Clamp(column.start), fb.Load("weight", column.end, force=(0, 0, -10.0))))
    first = fb.solve_static(model)
    # beyond Euler's load in both directions, whatever the steps
    assert first.info["unstable_directions"] == 2
    again = fb.solve_static(model, start=first.state)
    assert again.info["unstable_directions"] == 2 and again.info["steps"] <= first.info["steps"]


@pytest.mark.slow
def test_all_families_tensions_and_steps() -> None:
    assert wrong(taut.rows(quick=False)) == []
