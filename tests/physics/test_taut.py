"""Taut thin ropes: right by default. Once invariants stayed at round-off while a rope let its load fall by 40 m."""
from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[2] / "perf" / "stress")]

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


@pytest.mark.slow
def test_all_families_tensions_and_steps() -> None:
    assert wrong(taut.rows(quick=False)) == []
