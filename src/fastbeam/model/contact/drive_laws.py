"""Drives of sliders and joints (scene/slider_forces.py): their inputs in a step, and their forces at one time."""
from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from fastbeam.interface.arguments import real
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.contact.slider_forces import CONTROL, FORCE, INCREMENT, LAW, NO_DRIVE, POSITION
from fastbeam.model.forces.compiled_laws import compiled_drive, machine_code
from fastbeam.model.forces.loads import means
from fastbeam.scene.checks import called

Array = np.ndarray
# one-sided difference of fourth order, from values at the present time and at steps of SHORT s after it, as in
# scene/slider_forces.py
SHORT, FORWARD = 1e-4, np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) / 12.0
# derivatives of laws at rest: largest difference, as a share of the size of the argument; number of its halvings; largest
# relative difference between one-sided derivatives and the result
LARGEST, HALVES, ONE_SIDED = 1e-3, 20, 1e-2


def kind_of(drive: Any) -> int:
    """Return the kind of a drive, a constant of kernels/contact/slider_forces.py."""
    if drive is None:
        return NO_DRIVE
    if drive.is_controlled:
        return CONTROL
    if drive.is_prescribed:
        return POSITION if drive.position is not None else INCREMENT
    return LAW if callable(drive.force) and drive.takes_state else FORCE


def gains_of(drive: Any) -> tuple[float, float, float]:
    """Return the stiffness, the damping and the largest force of a controller."""
    return drive.stiffness, drive.damping, np.inf if drive.limit is None else drive.limit


def law_of(drive: Any, who: str) -> int:
    """Return the address of a compiled force of (t, s, rate); kept as long as the process. Raises SceneError: the force cannot be
    compiled, or returns nothing."""
    return machine_code(who, "drive's force(t, s, rate)", lambda: _driving(drive.force))[0]


_driving = cache(compiled_drive)


def given_to(drive: Any, who: str, t: float, h: float) -> tuple[float, float]:
    """Return the inputs of a drive for a step from t to t + h: position, increment or mean force, then 0; place and rate that a
    controller follows; (0, 0) for laws."""
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
        # ds/dt at time t
        return place, float(np.dot(FORWARD, [value_at(drive, who, "position", t + i * SHORT) for i in range(5)])) / SHORT
    return 0.0, 0.0


def given_over(drive: Any, kind: int, who: str, starts: Array, lengths: Array) -> Array:
    """Return the inputs of a drive, as `given_to`, for substeps from times `starts` on, of these lengths [n]: [n, 2]; kind:
    `kind_of` the drive."""
    out = np.zeros((len(starts), 2))
    if kind in (NO_DRIVE, LAW):
        return out
    if kind == FORCE and not callable(drive.force):
        out[:, 0] = float(drive.force)
    elif kind == INCREMENT and not callable(drive.speed):
        out[:, 0] = lengths * float(drive.speed)
    else:
        out[:] = [given_to(drive, who, t, h) for t, h in zip(starts.tolist(), lengths.tolist())]
    return out


def value_at(drive: Any, who: str, what: str, t: float) -> float:
    """Evaluate position, speed or force of a drive at time t. Raises SceneError: a function fails, or returns no finite
    number."""
    value = getattr(drive, what)
    if not callable(value):
        return float(value)
    found = called(who, what, value, t)
    try:
        found = float(found)
    except (TypeError, ValueError):
        found = np.nan
    if not np.isfinite(found):
        raise SceneError(f"{who}: {what}(t) must return a finite number, but does not at t = {t:.6g} s")
    return float(found)


def mean_of(drive: Any, who: str, what: str, t: float, h: float) -> float:
    """Return the mean of position, speed or force over a step from t to t + h."""
    given = getattr(drive, what)
    if not callable(given):
        return value_at(drive, who, what, t)
    def values(times: list[float]) -> Array:
        return np.array([value_at(drive, who, what, at) for at in times])

    return float(means(values, getattr(given, "_rows", None), np.array([t]), np.array([h]))[0])


def law_at(drive: Any, who: str, t: float, s: float, rate: float) -> float:
    """Evaluate the force of a drive with a law, in Python. Raises SceneError: the law fails, or returns no finite number."""
    failed: Exception | None = None
    try:
        found = real(drive.force(t, s, rate))
        how = "does not return a finite number"
    except Exception as error:
        found, failed, how = None, error, f"fails, {type(error).__name__}: {str(error)[:200]},"
    if found is None or not np.isfinite(found):
        raise SceneError(f"{who}: force(t, s, rate) of its drive {how} at t = {t:.6g} s, s = {s:.6g}, rate = "
                         f"{rate:.6g}") from failed
    return found


def force_at(drive: Any, who: str, t: float, s: float, rate: float) -> float:
    """Evaluate the force at time t of a drive that does not prescribe the motion, for a slider or joint at s with this rate; NaN
    where its law fails."""
    kind = kind_of(drive)
    if kind == LAW:
        try:
            return law_at(drive, who, t, s, rate)
        except SceneError:  # a step that evaluates the law there ends the run
            return np.nan
    given = given_to(drive, who, t, 0.0)
    if kind == FORCE:
        return given[0]
    gains = gains_of(drive)
    return float(np.clip(gains[0] * (given[0] - s) + gains[1] * (given[1] - rate), -gains[2], gains[2]))


def slope_at_rest(drive: Any, who: str, t: float, s: float, size: float, by_rate: bool) -> float:
    """Return the derivative by place, N/m, or by rate, N s/m, of the force of a drive that does not prescribe the motion, for a
    slider at rest at s at time t; size: scale of places, m, and of rates a second. Raises SceneError: a law has a kink or jumps
    there."""
    kind = kind_of(drive)
    if kind == LAW:
        law = f"{who}: force(t, s, rate)"
        if by_rate:
            return slope_of(lambda x: law_at(drive, who, t, s, x), 0.0, size, law, "rate")
        return slope_of(lambda x: law_at(drive, who, t, x, 0.0), s, size, law, "s")
    stiffness, damping, limit = gains_of(drive)
    if kind != CONTROL or abs(stiffness * (given_to(drive, who, t, 0.0)[0] - s)) > limit:
        return 0.0
    return -damping if by_rate else -stiffness


def slope_of(f: Callable[[float], float], x: float, size: float, who: str, by: str) -> float:
    """Differentiate a function at x: central differences are halved and extrapolated, the one that changes least is taken (C. J.
    F. Ridders, Adv. Eng. Softw. 4, 1982); size: scale of x. Raises SceneError: the function has no derivative there."""
    here, h = f(x), LARGEST * size
    best, error, before = np.nan, np.inf, np.zeros(0)
    widest = 0.0
    for i in range(HALVES + 1):
        ahead, back = _value_or_nan(f, x + h), _value_or_nan(f, x - h)
        widest = max(widest, *(np.nan_to_num(abs(y - here) / (LARGEST * size)) for y in (ahead, back)))
        row = np.full(i + 1, (ahead - back) / (2.0 * h))
        round_off = np.finfo(float).eps * (abs(ahead) + abs(back) + abs(x * row[0])) / h
        for j in range(i):
            row[j + 1] = row[j] + (row[j] - before[j]) / (4.0**(j + 1) - 1.0)
            change = max(abs(row[j + 1] - row[j]), abs(row[j + 1] - before[j])) + round_off
            if change <= error:
                best, error = float(row[j + 1]), change
        before, last, h = row, h, 0.5 * h
    sides = (ahead - here) / last, (here - back) / last
    off = max(abs(side - best) for side in sides)
    if not off <= ONE_SIDED * max(abs(best), widest) + 16.0 * np.finfo(float).eps * abs(here) / last:
        raise SceneError(f"{who} has no derivative by {by} at {by} = {x:.6g}, where its slider rests: it has a kink, a jump or "
                         "no finite value there. Make it smooth there, or lock the slider with held=")
    return best


def _value_or_nan(f: Callable[[float], float], x: float) -> float:
    """Evaluate a function; NaN where it fails."""
    try:
        return f(x)
    except (ArithmeticError, ValueError):
        return float(np.nan)
