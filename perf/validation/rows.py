"""Rows of the validation table, reference values, and observed orders."""
from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

Array = np.ndarray
REFERENCE = Path(__file__).resolve().parents[2] / "tests" / "reference"


@dataclass(frozen=True)
class Row:
    """One measured value and its bar.

    Parameters
    ----------
    quantity : str
        What was measured, with its unit where it has one.
    value : float
    at_most, at_least : float or None
        The bar; both None: the value is shown, nothing is asked of it.
    """

    quantity: str
    value: float
    at_most: float | None = None
    at_least: float | None = None

    @property
    def is_met(self) -> bool:
        """Whether the value is finite and within its bar."""
        low = -math.inf if self.at_least is None else self.at_least
        high = math.inf if self.at_most is None else self.at_most
        return math.isfinite(self.value) and low <= self.value <= high

    @property
    def bar(self) -> str:
        """The bar as text."""
        if self.at_least is not None and self.at_most is not None:
            return f"{self.at_least:g} to {self.at_most:g}"
        if self.at_most is not None:
            return f"<= {self.at_most:.3g}"
        return "shown" if self.at_least is None else f">= {self.at_least:.3g}"

    def __str__(self) -> str:
        verdict = "" if self.at_most is None and self.at_least is None else "pass" if self.is_met else "FAIL"
        size = abs(self.value)
        number = f"{self.value:.4g}" if size == 0.0 or 0.01 <= size < 1e4 else f"{self.value:.1e}"
        return f"{self.quantity:<106}{self.bar:>12}{number:>11}  {verdict}".rstrip()


def misses(rows: Sequence[Row]) -> list[str]:
    """The rows that miss their bar, as text; a check without rows is a miss too."""
    if not rows:
        return ["nothing was measured"]
    return [f"{row.quantity}: {row.value:.3g}, bar {row.bar}" for row in rows if not row.is_met]


@cache
def reference(name: str) -> dict[str, Any]:
    """Contents of tests/reference/<name>.json; 'rows' becomes an array [n, columns]."""
    data = json.loads((REFERENCE / f"{name}.json").read_text())
    if "rows" in data:
        data["rows"] = np.array(data["rows"])
    return data


def orders(errors: Sequence[float], ratio: float = 2.0) -> Array:
    """Observed orders between neighbouring errors [n - 1], the step shrinking by `ratio`."""
    e = np.asarray(errors, dtype=float)
    return np.log(e[:-1] / e[1:]) / math.log(ratio)


def distance(a: Array, b: Array) -> float:
    """Largest distance between the points [n, m] of two paths."""
    return float(np.max(np.linalg.norm(np.atleast_2d(a) - np.atleast_2d(b), axis=1)))
