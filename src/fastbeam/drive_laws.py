"""Drives of sliders and joints (scene/sliding.py): what they are given in a step, and their forces at one time."""
from __future__ import annotations

from typing import Any

import numpy as np

from ._jit import compiled_law
from .errors import SceneError
from .kernels.along import CONTROL, FORCE, INCREMENT, LAW, NO_DRIVE, POSITION

Array = np.ndarray
# three Gauss points: smooth forces are exact to order 6, and a step stays symmetric in time
POINTS, SHARES = 0.5 + np.array([-0.5, 0.0, 0.5]) * np.sqrt(0.6), np.array([5.0, 8.0, 5.0]) / 18.0

# derivative from values at steps of SHORT s from now on, of fourth order, as of scene/sliding.py
SHORT, FORWARD = 1e-4, np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) / 12.0


def kind_of(drive: Any) -> int:
    """One of the kinds of kernels/along.py."""
    if drive is None:
        return NO_DRIVE
    if drive.is_controlled:
        return CONTROL
    if drive.is_prescribed:
        return POSITION if drive.position is not None else INCREMENT
    return LAW if callable(drive.force) and drive.takes_state else FORCE


def gains_of(drive: Any) -> tuple[float, float, float]:
    """Of a controller: by place and rate, and the largest force."""
    return drive.stiffness, drive.damping, np.inf if drive.limit is None else drive.limit


def law_of(drive: Any, who: str) -> Any:
    """A compiled force of (t, s, rate).

    Raises
    ------
    SceneError
        It cannot be compiled.
    """
    try:
        return compiled_law(drive.force)
    except Exception as error:
        raise SceneError(f"{who}: force(t, s, rate) cannot be compiled by numba ({' '.join(str(error).split())[:300]}); use "
                         "numbers, math and numpy functions of numbers, or a function of t alone") from error


def given_to(drive: Any, who: str, t: float, h: float) -> tuple[float, float]:
    """What it is given for a step from t to t + h; (0, 0) where it does not ask for the time."""
    kind = kind_of(drive)
    if kind == POSITION:
        return value_at(drive, who, "position", t + h), 0.0
    if kind == INCREMENT:
        return h * mean_of(drive, who, "speed", t, h), 0.0
    if kind == FORCE:
        return mean_of(drive, who, "force", t, h), 0.0
    if kind == CONTROL:
        place = 0.0 if drive.position is None else value_at(drive, who, "position", t + 0.5 * h)
        if drive.speed is not None:
            return place, mean_of(drive, who, "speed", t, h)
        if not callable(drive.position):
            return place, 0.0
        if h != 0.0:
            return place, (value_at(drive, who, "position", t + h) - value_at(drive, who, "position", t)) / h
        # ds/dt of the moment
        return place, float(np.dot(FORWARD, [value_at(drive, who, "position", t + i * SHORT) for i in range(5)])) / SHORT
    return 0.0, 0.0


def value_at(drive: Any, who: str, what: str, t: float) -> float:
    """Of position, speed or force at time t.

    Raises
    ------
    SceneError
        A function fails, or returns no finite number.
    """
    value = getattr(drive, what)
    if not callable(value):
        return float(value)
    try:
        found = value(t)
    except Exception as error:
        text = f"must not fail, at {t:.6g} it raises {type(error).__name__}: {error}"
        raise SceneError(f"{who}: {what} {text:.200}") from error
    try:
        found = float(found)
    except (TypeError, ValueError):
        found = np.nan
    if not np.isfinite(found):
        raise SceneError(f"{who}: {what}(t) must return a finite number, at t = {t:.6g} s it does not")
    return float(found)


def mean_of(drive: Any, who: str, what: str, t: float, h: float) -> float:
    """Its mean over the step."""
    if not callable(getattr(drive, what)):
        return value_at(drive, who, what, t)
    return float(sum(w * value_at(drive, who, what, t + x * h) for x, w in zip(POINTS, SHARES)))


def force_at(drive: Any, who: str, t: float, s: float, rate: float) -> float:
    """Force at time t of one that does not prescribe the motion, where its slider or joint stands at s and moves at this rate."""
    kind = kind_of(drive)
    if kind == LAW:
        return float(drive.force(t, s, rate))
    given = given_to(drive, who, t, 0.0)
    if kind == FORCE:
        return given[0]
    gains = gains_of(drive)
    return float(np.clip(gains[0] * (given[0] - s) + gains[1] * (given[1] - rate), -gains[2], gains[2]))
