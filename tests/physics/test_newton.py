"""Newton squares its increments, which it does only with the exact tangent."""
from __future__ import annotations

import math

from validate import Row, misses
from validate.tangents import check_newton, exponent


def test_newton_converges_quadratically_in_every_kind_of_scene() -> None:
    assert misses(check_newton(quick=True)) == []


def test_the_exponent_tells_linear_from_quadratic_convergence() -> None:
    assert math.isclose(exponent([1e-1, 1e-2, 1e-4, 1e-8]), 2.0)
    assert math.isclose(exponent([1e-1, 1e-2, 1e-3, 1e-4]), 1.0)
    assert math.isnan(exponent([1e-1, 1e-2]))


def test_a_check_that_measures_nothing_is_a_miss() -> None:
    assert misses([]) != []
    assert misses([Row("x", math.nan, at_most=1.0)]) != []
    assert misses([Row("x", 0.5, at_most=1.0), Row("y", 3.0, at_least=2.0, at_most=4.0)]) == []
