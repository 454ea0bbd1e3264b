"""The balance of energies, judged by what was exchanged."""
from __future__ import annotations

import numpy as np

import fastbeam as fb


def exchanged(result: fb.Result) -> float:
    """The most that a part of the balance gained or lost in the run, J: largest less smallest value."""
    return max(float(np.ptp(x)) for name, x in result.balance().items() if name != "sum")


def share_exchanged(result: fb.Result) -> float:
    """That over the largest value of a part: round-off of the sum is so much smaller than what `error_of_balance` shows."""
    return exchanged(result) / max(float(np.max(np.abs(x))) for name, x in result.balance().items() if name != "sum")


def error_of_balance(result: fb.Result) -> float:
    """Largest less smallest sum of all parts, over what was exchanged."""
    return float(np.ptp(result.balance()["sum"])) / exchanged(result)


def assert_balanced(result: fb.Result, most: float = 1e-12) -> None:
    """The sum of all parts is constant, next to what was exchanged; of a scene that exchanges a sizeable amount."""
    found, share = error_of_balance(result), share_exchanged(result)
    assert share > 1e-3, f"only {share:.1e} of the largest energy was exchanged"
    assert found < most, f"balance off by {found:.1e} of {exchanged(result):.3g} J"
