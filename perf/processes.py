"""Measurements in several fresh processes: where the arrays of a run come to lie changes its time by a tenth from one process to
the next, and more where a small difference of two times is asked for."""
from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import numpy as np

PROCESSES = 5


def smallest(measure: Callable[..., dict[str, tuple[float, ...]]], *arguments: Any) -> dict[str, tuple[float, ...]]:
    """Of each number that `measure(*arguments)` returns by names the smallest of several processes, one after the other."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        found = list(pool.map(measure, *([x] * PROCESSES for x in arguments)))
    return {name: tuple(map(min, *(one[name] for one in found))) for name in found[0]}


def in_turn(steppers: Mapping[str, Any], step: float, steps: int, rounds: int) -> dict[str, tuple[float, float, float]]:
    """Of steppers that take so many steps in turn, once a round: the least microseconds of an iteration and of a step, in all
    rounds but the first, and iterations of a step in the last."""
    found = dict.fromkeys(steppers, (np.inf, np.inf, 0.0))
    for k in range(rounds):
        for name, stepper in steppers.items():
            begin = time.thread_time()
            outcome = stepper.advance(0.0, step, steps, steps * k)
            took = 1e6 * (time.thread_time() - begin)
            assert outcome.status == 0 and stepper.linear.fallbacks == 0, (name, outcome)
            if k:
                iteration, whole, _ = found[name]
                found[name] = (min(iteration, took / outcome.iterations), min(whole, took / steps), outcome.iterations / steps)
    return found
