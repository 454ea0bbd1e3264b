"""Checks of the arguments of functions that run something; the nouns of a scene have theirs in `scene/checks.py`."""
from __future__ import annotations

import math
from typing import Any

import numpy as np

from .errors import SceneError


def number(name: str, value: Any) -> float:
    """A finite number as a float.

    Raises
    ------
    SceneError
        Texts, truth values, NaN, infinities, anything that is not one number.
    """
    try:
        x = math.nan if isinstance(value, (str, bytes, bool, np.bool_)) or np.ndim(value) else float(value)
    except (TypeError, ValueError, OverflowError):
        x = math.nan
    if not math.isfinite(x):
        raise SceneError(f"{name}: must be a finite number, got {value!r:.60}")
    return x


def count(name: str, value: Any, least: int = 1) -> int:
    """A whole number >= `least`.

    Raises
    ------
    SceneError
        Anything else, floats and truth values too.
    """
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise SceneError(f"{name}: must be a whole number >= {least}, got {value!r:.60}")
    return int(value)
