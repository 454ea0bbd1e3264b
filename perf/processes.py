"""Measurements in several fresh processes: where the arrays of a run come to lie changes its time by a tenth from one process to
the next, and more where a small difference of two times is asked for."""
from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

PROCESSES = 5


def smallest(measure: Callable[..., dict[str, tuple[float, ...]]], *arguments: Any) -> dict[str, tuple[float, ...]]:
    """Of each number that `measure(*arguments)` returns by names the smallest of several processes, one after the other."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        found = list(pool.map(measure, *([x] * PROCESSES for x in arguments)))
    return {name: tuple(map(min, *(one[name] for one in found))) for name in found[0]}
