"""Judging measured runs: the lower envelope of time over error, the time at a wanted error, limits by extrapolation.

Needs NumPy only, so that it can be tested without any peer.
"""
from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

Array = np.ndarray
FAR = 2.0  # decades of error beyond the measured ones that are still extrapolated
TAIL = 1.5  # decades of error at the accurate end of a front that give the slope of the extrapolation
STEEPEST = 4.0  # decades of time per decade of error; a tail steeper than that has stopped converging


@dataclass(frozen=True)
class Run:
    """Error and time of one measured run, with a label of its settings."""

    error: float
    time: float
    label: str = ""


@dataclass(frozen=True)
class Crossing:
    """Time at a wanted error.

    Parameters
    ----------
    kind : {'measured', 'at most', 'extrapolated', 'not reached'}
        'measured': interpolated between two runs of the front. 'at most': the cheapest run is more accurate than wanted.
    time : float
        nan when not reached, s.
    slope : float
        Decades of time per decade of error around the crossing; 0 where there is none.
    """

    kind: str
    time: float
    slope: float = 0.0


def front(runs: Sequence[Run]) -> list[Run]:
    """The runs that no other run beats in both error and time, from the cheapest to the most accurate one."""
    best: list[Run] = []
    for run in sorted((r for r in runs if math.isfinite(r.error) and r.error > 0.0), key=lambda r: (r.time, r.error)):
        if not best or run.error < best[-1].error:
            best.append(run)
    return best


def slope_of_tail(runs: Sequence[Run]) -> float:
    """Decades of time per decade of error at the accurate end of a front, least squares; nan with fewer than two runs."""
    tail = [run for run in runs if run.error <= runs[-1].error * 10.0**TAIL] if runs else []
    tail = tail if len(tail) > 1 else list(runs[-2:])
    if len(tail) < 2:
        return math.nan
    x, y = np.log([run.error for run in tail]), np.log([run.time for run in tail])
    return float(-np.polyfit(x, y, 1)[0])


def time_at(runs: Sequence[Run], error: float) -> Crossing:
    """Time at `error` on a front (from `front`), linear in log-log between the two runs around it.

    Beyond the most accurate run the slope of the tail is followed over at most `FAR` decades.
    """
    if not runs:
        return Crossing("not reached", math.nan)
    if error >= runs[0].error:
        return Crossing("measured" if error == runs[0].error else "at most", runs[0].time)
    for a, b in zip(runs, runs[1:]):
        if a.error > error >= b.error:
            slope = math.log(b.time / a.time) / math.log(a.error / b.error)
            return Crossing("measured", a.time * (a.error / error) ** slope, slope)
    last, slope = runs[-1], slope_of_tail(runs)
    if not 0.0 < slope <= STEEPEST or last.error > error * 10.0**FAR:
        return Crossing("not reached", math.nan)
    return Crossing("extrapolated", last.time * (last.error / error) ** slope, slope)


def distance(a: Array, b: Array, length: float) -> float:
    """Largest distance between the points [n, 3] of two answers, relative to `length`."""
    return float(np.max(np.linalg.norm(np.asarray(a) - np.asarray(b), axis=1))) / length


@dataclass(frozen=True)
class Limit:
    """Extrapolated positions [n, 3], their distance to the extrapolation from one level coarser, and the observed orders."""

    points: Array
    uncertainty: float
    order_space: float
    order_time: float


def limit(answers: Mapping[tuple[int, float], Array], elements: int, step: float, orders: tuple[float, float],
          length: float) -> Limit:
    """Richardson extrapolation in both the mesh and the step from the runs (elements, step) in `answers`.

    Needs the runs (n, h), (n/2, h), (n, 2h) and, for the uncertainty, (n/2, 2h), (n/4, 2h), (n/2, 4h). `orders` are the ones
    in space and in time that are assumed; the observed ones come out, from the changes between the two levels.

    Raises
    ------
    KeyError
        A run is missing.
    """
    def level(n: int, h: float) -> tuple[Array, Array, Array]:
        p = np.asarray(answers[n, h])
        space, time = p - np.asarray(answers[n // 2, h]), p - np.asarray(answers[n, 2.0 * h])
        return p + space / (2.0 ** orders[0] - 1.0) + time / (2.0 ** orders[1] - 1.0), space, time

    fine, space, time = level(elements, step)
    coarse, space_coarse, time_coarse = level(elements // 2, 2.0 * step)

    def order(big: Array, small: Array) -> float:
        return math.log2(float(np.linalg.norm(big)) / float(np.linalg.norm(small)))

    return Limit(fine, distance(fine, coarse, length), order(space_coarse, space), order(time_coarse, time))
