"""Rows of many steps that are taken in one call of the compiled loop: states are kept there and read afterwards, all at once."""
from __future__ import annotations

import time
from typing import Any

import numpy as np

from fastbeam.dynamics.checkpoint import Clock
from fastbeam.dynamics.control import UNRESOLVED_TURN
from fastbeam.kernels.empty_arrays import empty
from fastbeam.kernels.recorded import Recorded
from fastbeam.kernels.state import State
from fastbeam.stepping.stepper import Stepper

Array = np.ndarray
# s, of a block; numbers of the states that one keeps
CALL_TIME, MOST_NUMBERS = 0.05, 500_000


class Block:
    """Rows of equal numbers of steps.

    t: float64 [m], their times.
    q, v: float64 [m, 12 N], coordinates in space and their rates.
    iterations: int64 [m], Newton iterations before each, since the row before it.
    """

    def __init__(self, t: Array, q: Array, v: Array, iterations: Array, rest: tuple[Array, ...]) -> None:
        self.t, self.q, self.v, self.iterations, self._rest = t, q, v, iterations, rest

    def state(self, k: int) -> State:
        """Return the state of a row, in space."""
        return State(self.q[k], self.v[k], *self._rest)


class Blocks:
    """Takes blocks of steps of a scene that has nothing between two steps to look after."""

    def __init__(self, stepper: Stepper) -> None:
        self.stepper = stepper
        self._most = MOST_NUMBERS // (2 * stepper.model.q0.size)
        # steps of a block that take no more than the time of one
        self._steps = 0

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
        own: Any = core.q, core.v, stepper.work.theta
        stored = [empty((count, x.size)) for x in own]
        spent = stepper.take(clock.origin, clock.step, count * every, clock.done,
                             Recorded(np.array([every * stepper.weights.size]), *stored))
        for x, last in zip(stored, own):
            x[-1] = last
        turn = stored[2].reshape(count, stepper.model.n_nodes, -1)
        if spent is None or not 2.0 * np.arctan(0.5 * np.max(np.linalg.norm(turn, axis=2))) < UNRESOLVED_TURN:
            stepper.load(saved)
            return None
        each = (time.perf_counter() - begin) / (count * every)
        self._steps = max(1, min(int(CALL_TIME / each), 8 * count * every))
        q, v = stored[:2] if stepper.plane is None else stepper.plane.rows(*stored[:2])
        t = clock.origin + clock.step * (clock.done + every * np.arange(1, count + 1))
        return Block(t, q, v, np.diff(spent[::every]), core[2:])
