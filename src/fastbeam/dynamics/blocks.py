"""Rows of many steps that are taken in one call of the compiled loop: states are kept there and read afterwards, all at once."""
from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from fastbeam.dynamics.checkpoint import Clock
from fastbeam.dynamics.control import UNRESOLVED_TURN
from fastbeam.kernels.empty_arrays import empty
from fastbeam.kernels.jit.records import Record
from fastbeam.kernels.recorded import Recorded
from fastbeam.kernels.state import State
from fastbeam.stepping.stepper import Stepper

Array = np.ndarray
# s, of a block; numbers of the states that it keeps: few, as memory that is touched for the first time takes longer than all sums
CALL_TIME, MOST_NUMBERS = 0.05, 250_000


class Block:
    """Rows of equal numbers of steps.

    t: float64 [m], their times.
    q, v: float64 [m, 12 N], in a plane [m, 4 N], coordinates and their rates.
    iterations: int64 [m], Newton iterations before each, since the row before it.
    plane: None in space.
    """

    def __init__(self, t: Array, q: Array, v: Array, iterations: Array, rest: tuple[Array, ...], plane: Any) -> None:
        self.t, self.q, self.v, self.iterations, self._rest, self._plane = t, q, v, iterations, rest, plane

    def states(self, rows: list[int]) -> list[State]:
        """Return the states of some rows, in space."""
        q, v = self.q[rows], self.v[rows]
        if self._plane is not None:
            q, v = self._plane.rows(q, v)
        return [State(*x, *self._rest) for x in zip(q, v)]


class Blocks:
    """Takes blocks of steps of a scene that has nothing between two steps to look after."""

    def __init__(self, stepper: Stepper) -> None:
        self.stepper = stepper
        size = stepper.core_state.q.size
        self._most = max(2, MOST_NUMBERS // (2 * size))
        # steps of a block that take no more than the time of one
        self._steps = 0
        # states of the rows of a block, which the next overwrites
        kept = Recorded(np.zeros(1, np.int64), empty((self._most, size)), empty((self._most, size)), np.zeros(1))
        self._kept, self._record = kept, Record(kept)

    @staticmethod
    def suit(stepper: Stepper) -> bool:
        """Return whether steps need the compiled loop alone: no features, constraint forces, laws nor functions of time."""
        model = stepper.model
        return (type(stepper) is Stepper and not model.features and not model.n_forces and model.gravity_time is None
                and stepper.is_alone)

    def count(self, every: int, left: int, burst: int) -> int:
        """Return the number of rows of the next block; every: steps between rows; left: steps, of which the last stands alone;
        burst: steps that a call may have, as single rows tell."""
        return min((left - 1) // every, max(self._steps, burst) // every, self._most)

    def take(self, clock: Clock, every: int, count: int) -> Block | None:
        """Take the next rows; None where a step fails or turns too far: then no step is taken."""
        stepper, core = self.stepper, self.stepper.core_state
        saved, begin = stepper.save(), time.perf_counter()
        kept = self._kept
        kept.every[0], kept.turned[0] = every * stepper.weights.size, 0.0
        spent = stepper.take(clock.origin, clock.step, count * every, clock.done, self._record)
        q, v = kept.q[:count], kept.v[:count]
        q[-1], v[-1] = core.q, core.v
        turn = max(2.0 * math.atan(0.5 * math.sqrt(kept.turned[0])), stepper.largest_turn()[1])
        if spent is None or not turn < UNRESOLVED_TURN:
            stepper.load(saved)
            return None
        each = (time.perf_counter() - begin) / (count * every)
        self._steps = max(1, min(int(CALL_TIME / each), 8 * count * every))
        t = clock.origin + clock.step * (clock.done + every * np.arange(1, count + 1))
        return Block(t, q, v, np.diff(spent[::every]), core[2:], stepper.plane)
