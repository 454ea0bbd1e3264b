"""A run that is cut at a row and goes on is the whole run, bit for bit."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import fastbeam as fb


def assert_goes_on(model: Any, whole: fb.Result, n: int, path: Path, settings: dict[str, Any]) -> tuple[fb.Result, fb.Result]:
    """Cut at row n of the whole run, with the same settings: both parts, whose state and rows are those of the whole run.

    The last row of the first part is the first of the second, which knows neither iterations nor the step before."""
    left = [n]

    def stop(t: float, state: Any) -> bool:
        left[0] -= 1
        return left[0] == 0

    part = fb.simulate(model, callback=stop, output=fb.Output(checkpoint=path), **settings)
    rest = fb.simulate(model, start=fb.load_checkpoint(path), **settings)
    for x, y in zip(rest.state, whole.state):
        assert np.array_equal(x, y), n
    for series, x in whole.series.items():
        if series not in ("iterations", "step_size"):
            y = np.concatenate((part.series[series][:-1], rest.series[series]))
            assert np.array_equal(x, y, equal_nan=True), (n, series)
    return part, rest
