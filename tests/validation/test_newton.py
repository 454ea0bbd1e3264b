"""Newton squares its increments, which it does only with the exact tangent."""
from __future__ import annotations

import math

import numpy as np
import pytest

from fastbeam.kernels.loop import has_converged, next_increment
from perf.validation import Row, misses
from perf.validation.tangents import check_newton, exponent


def test_newton_converges_quadratically_in_every_kind_of_scene() -> None:
    assert misses(check_newton(quick=True)) == []


def test_the_exponent_tells_linear_from_quadratic_convergence() -> None:
    assert math.isclose(exponent([1e-1, 1e-2, 1e-4, 1e-8]), 2.0)
    assert math.isclose(exponent([1e-1, 1e-2, 1e-3, 1e-4]), 1.0)
    assert math.isnan(exponent([1e-1, 1e-2]))


@pytest.mark.parametrize(("sizes", "last"), [
    # squares until nothing is left
    ([1e-2, 1e-4, 1e-8, 1e-16], 3),
    ([1e-3, 3e-7, 1e-13], 2),
    # what is left is round-off: the last but one foretold less than 1e-18
    ([8e-5, 1.6e-9, 3e-13, 3e-13], 2),
    ([5e-3, 5.6e-6, 1.8e-10, 3e-13, 3e-13], 3),
    # round-off that has not been foretold ends the iteration where it shrinks no more
    ([1e-6, 1e-8, 1e-10, 2e-11, 1e-11], 3),
    # shrinks by the same factor each time: goes on until nothing is left
    ([20.0**-k for k in range(2, 20)], 10),
    # and where it grew before it shrank: a body that turns by 1e4 rad in a step
    ([1.2e-9, 2.5e-9, 6.2e-10, 1.2e-9], 2),
    # slower for once, not round-off yet
    ([1e-4, 2e-8, 9e-10, 1e-12, 1e-15], 4), ([1e-4, 1e-8, 9e-10, 8e-11, 7e-12, 6e-13, 5e-14, 4e-15, 3e-16], 8),
    # large, growing, or no number
    ([1e-1, 1e-1, 1e-1], None), ([1e-8, 1e-6, 1e-4], None), ([1e-3, math.nan, math.nan], None)])
def test_newton_stops_at_round_off_and_not_an_iteration_later(sizes: list[float], last: int | None) -> None:
    before = expected = np.inf
    stops = []
    for k, size in enumerate(sizes):
        if has_converged(size, before, expected):
            stops.append(k)
        before, expected = size, next_increment(size, before)
    assert (stops[0] if stops else None) == last


def test_a_check_that_measures_nothing_is_a_miss() -> None:
    assert misses([]) != []
    assert misses([Row("x", math.nan, at_most=1.0)]) != []
    assert misses([Row("x", 0.5, at_most=1.0), Row("y", 3.0, at_least=2.0, at_most=4.0)]) == []
