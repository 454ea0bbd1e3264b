"""Time factors of loads."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from fastbeam.interface.arguments import LARGEST, Number, Numbers, real, shown
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.beams.loads import LoadWork
from fastbeam.model.analyses import Analysis, require, timed_loads
from fastbeam.model.feature import Feature, OfRun, Stand
from fastbeam.model.model import Model

Array = np.ndarray
# three Gauss points: exact to order 6 for smooth functions, and symmetric in time
POINTS, SHARES = 0.5 + np.array([-0.5, 0.0, 0.5]) * np.sqrt(0.6), np.array([5.0, 8.0, 5.0]) / 18.0


def load_factors(model: Model, times: Array, steps: Array) -> Array:
    """Return the mean factor of every load vector over steps [t, t + h], [n, K]: three Gauss points, so that impulses of smooth
    loads are exact to order 6 and a step stays symmetric."""
    out = np.ones((len(times), len(model.load_times)))
    smooth: list[int] = []
    for k, time in enumerate(model.load_times):
        if getattr(time, "_rows", None) is not None:
            out[:, k] = mean_factors(time, times, steps, f"of {model.load_names[k]}")
        elif time is not None:
            smooth.append(k)
    if smooth:
        functions = [(model.load_times[k], f"of {model.load_names[k]}") for k in smooth]
        out[:, smooth] = smooth_means(lambda at: factors_at(functions, at), np.asarray(times), np.asarray(steps)).T
    return out


class LoadAccount(Feature):
    """Account of the work of loads without potential: they change in time, are moments, or follow laws."""

    key, title, order, opens = "load_account", "loads that change in time, moments", 20, True
    lacks = (timed_loads(lambda account, asked: [
        name for name, time in zip(asked.model.load_names, asked.model.load_times) if time is not None]),)

    @property
    def history_size(self) -> int:
        """Number of history variables: the work of the loads."""
        return 1

    def terms(self, run: OfRun) -> list[tuple[Stand, Any]]:
        """Return the term that accounts the work of loads; none in statics."""
        if run.static:
            return []
        model = run.model
        node = np.zeros(model.n_rows, np.int64)
        node[model.pattern.row_of] = np.arange(model.n_nodes)
        return [(Stand.LOADS, LoadWork(node, np.array([model.place(self.key)])))]


def load_factors_at(who: str, model: Model, at_time: float | None) -> Array:
    """Return the factor of every load vector at a time, [K]; who: the function that was called. Raises SceneError: there are time
    functions and no time."""
    for one in model.controllers:
        # an equilibrium uses the start value, not the last value of a run
        one.held[0] = one.start
    if at_time is None:
        require(Analysis.TIMELESS_LOADS, model, who)
    out = np.ones(len(model.load_times))
    timed = [k for k, time in enumerate(model.load_times) if time is not None]
    out[timed] = factors_at([(model.load_times[k], f"of {model.load_names[k]}") for k in timed], [at_time or 0.0])[:, 0]
    return out


def which_times(value: Any) -> float | tuple[float, float]:
    """Check the argument `at_time`: one time, s, or two. Raises Refusal."""
    if real(value) is not None:
        return Number(unit="s")(value)
    first, last = Numbers((2,), "a time in s, or two times: of the loads at load factor 0 and at load factor 1")(value)
    return float(first), float(last)


def load_path(who: str, model: Model, at_time: float | tuple[float, float] | None,
              others_change: bool = False) -> tuple[Array, Array]:
    """Return the factors [K] of all load vectors at load factor 0, and their change until load factor 1; who: the function that
    was called; others_change: True if other forces than load vectors change. Raises SceneError: there are time functions and no
    time, or between two times nothing changes."""
    if not isinstance(at_time, tuple):
        factors = load_factors_at(who, model, at_time)
        return np.zeros_like(factors), factors
    require(Analysis.TIME_SPAN, model, f"{who}: at_time={at_time}")
    first, last = (load_factors_at(who, model, t) for t in at_time)
    if np.array_equal(first, last) and not others_change:
        raise SceneError(f"{who}: at_time={at_time}: no load changes between these times. Give a time function to loads that "
                         "grow, as in Load(..., time=lambda t: t); loads without one stay constant")
    return first, last - first


def mean_factors(time: Callable[[float], float], times: Array, steps: Array, who: str = "of gravity") -> Array:
    """Return the means of a time function over steps [t, t + h], [n]."""
    return means(lambda at: factors_at([(time, who)], at)[0], getattr(time, "_rows", None), times, steps)


def smooth_means(values: Callable[[list[float]], Array], times: Array, steps: Array) -> Array:
    """Return the means of smooth functions over steps [t, t + h] by three Gauss points, [..., n]; values: of the functions at
    some times, [..., times]."""
    found = values((times[:, None] + POINTS * steps[:, None]).reshape(-1).tolist())
    found = found.reshape(*found.shape[:-1], -1, 3)
    # written out: a matrix product rounds a row differently in calls of different length
    return np.asarray(SHARES[0] * found[..., 0] + SHARES[1] * found[..., 1] + SHARES[2] * found[..., 2])


def means(values: Callable[[list[float]], Array], rows: Array | None, times: Array, steps: Array) -> Array:
    """Return the means of a function over steps [t, t + h], [n]: of a smooth one by three Gauss points, of a table from row to
    row (rows: their times) within a step; values: of the function at some times."""
    times, steps = np.asarray(times), np.asarray(steps)
    out = smooth_means(values, times, steps)
    if rows is not None:
        ends = times + steps
        low, high = np.minimum(times, ends), np.maximum(times, ends)
        first, last = np.searchsorted(rows, low, "right"), np.searchsorted(rows, high, "left")
        for k in np.flatnonzero(last > first):
            cuts = np.concatenate(([low[k]], rows[first[k]:last[k]], [high[k]]))
            sizes = np.diff(cuts)
            out[k] = float(np.sum(smooth_means(values, cuts[:-1], sizes) * sizes)) / (high[k] - low[k])
    return out


def factor_at(time: Callable[[float], float], t: float, who: str = "of gravity") -> float:
    """Evaluate a time function at t as a number; who: its owner. Raises SceneError: the function fails, or returns no finite
    number."""
    return float(factors_at([(time, who)], [t])[0, 0])


def factors_at(functions: Sequence[tuple[Callable[[float], float], str]], times: list[float]) -> Array:
    """Evaluate time functions, each with the name of its owner, at some times, [functions, times]. Raises SceneError: a function
    fails, or returns no finite number."""
    found: list[Any] = []
    try:
        for time, _ in functions:
            for t in times:
                found.append(time(t))
    except Exception as error:
        _numbers(found, functions, times)
        if isinstance(error, SceneError):
            raise
        k, i = divmod(len(found), len(times))
        text = f"must not fail, but raises {type(error).__name__} at t = {times[i]:.6g} s: {error}"
        raise SceneError(f"time function {functions[k][1]}: {text}") from error
    return _numbers(found, functions, times).reshape(len(functions), len(times))


def _numbers(found: list[Any], functions: Sequence[tuple[Any, str]], times: list[float]) -> Array:
    """Return the values of functions of time, one after the other, as numbers. Raises SceneError: see `factors_at`."""
    if not set(map(type, found)) <= {float, np.float64}:
        known = map(real, found)
        values = np.array([np.nan if x is None else x for x in known])
    else:
        values = np.array(found)
    good = np.abs(values) <= LARGEST
    if not good.all():
        k, i = divmod(int(np.argmin(good)), len(times))
        raise SceneError(f"time function {functions[k][1]}: must return a finite number, got "
                         f"{shown(found[k * len(times) + i])} at t = {times[i]:.6g} s")
    return values
