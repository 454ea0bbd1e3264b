"""The balance of energies, judged by what was exchanged."""
from __future__ import annotations

import numpy as np

import fastbeam as fb


def exchanged(result: fb.Result) -> float:
    """The most that a part of the balance gained or lost in the run, J: largest less smallest value."""
    return max(float(np.ptp(x)) for name, x in result.balance().items() if name != "sum")


def largest(result: fb.Result) -> float:
    """The largest value of a part of the balance, J."""
    return max(float(np.max(np.abs(x))) for name, x in result.balance().items() if name != "sum")


def error_of_balance(result: fb.Result) -> float:
    """Largest less smallest sum of all parts, over what was exchanged."""
    error = float(np.ptp(result.balance()["sum"]))
    return error / exchanged(result) if error > 0.0 else 0.0


def balanced(result: fb.Result, limit: float = 1e-12) -> bool:
    """Whether the sum of all parts is constant next to what was exchanged, and what the run says of it next to its energies."""
    found = error_of_balance(result)
    print(f"balance: {found:.1e} of {exchanged(result):.2g} J exchanged, largest part {largest(result):.2g} J")
    return found < limit and ("balance" not in result.series or result.drift("balance") < limit)


def unit_of_strains(section: fb.Section, length: float, elements: int, energy: float) -> float:
    """What one unit in the last place of the strains is worth of a strain energy E, J: directors off by eps make a curvature of
    an element h wrong by eps/h, and an energy of a stiffness C over a length L by eps/h sqrt(2 E C L). Steps add such errors up
    as a random walk does."""
    of = np.sqrt(2.0 * energy * np.diag(section.C) * length) / np.repeat((1.0, length / elements), 3)
    return float(np.finfo(float).eps * np.max(of))
