"""Arrays that are written before they are read: work of a run, and its results.

They begin with zeros. With `FASTBEAM_FILL=nan` in the environment they begin with NaN, and every result has the same bits, or
something was read that nobody wrote (tests/stepping/test_work_arrays.py). What has to begin with zero is made by `np.zeros`.
"""
from __future__ import annotations

import os
from typing import Any

import numpy as np

from fastbeam.kernels import state as work

Array = np.ndarray
FILL = float(os.environ.get("FASTBEAM_FILL", "0"))


def empty(shape: Any) -> Array:
    """Return an array of this shape, float64."""
    return filled(np.zeros(shape))


def aligned_empty(n: int) -> Array:
    """Return n numbers that begin on a cache line, see `kernels.work.aligned`."""
    return filled(work.aligned(n))


def filled(x: Array) -> Array:
    """Fill an array of zeros with FILL, the initial value of such arrays."""
    if FILL != 0.0:
        x.fill(FILL)
    return x
