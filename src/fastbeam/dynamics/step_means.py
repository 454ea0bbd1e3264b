"""Means over steps of quantities of rows besides forces: accelerations of points, rates of strains in damped sections."""
from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.kernels.loop import OK
from fastbeam.results.observe.points import PointSeries
from fastbeam.stepping.methods import Scheme
from fastbeam.stepping.outcome import Outcome
from fastbeam.stepping.stepper import Stepper

Array = np.ndarray


class MeasuredSteps(Stepper if TYPE_CHECKING else object):  # type: ignore[misc]
    """Mixin for steppers whose outcomes hold means of `points` behind all forces. Of some steps the first and the last are looked
    at from outside; those between them stay in one call."""

    points: PointSeries  # set before the first step

    @property
    def recorded(self) -> int:
        return super().recorded + self.measured

    @property
    def measured(self) -> int:
        """Number of means in an outcome, its last numbers."""
        return self.points.measured

    def advance(self, t: float, h: float, n: int, done: int = 0) -> Outcome:
        start = self.save() if n > 1 else None
        whole: Outcome | None = None
        try:
            for count in (1, n - 2, 1) if n > 2 else (1,) * n:
                part = self._some(t, h, count, done if whole is None else done + whole.steps)
                whole = part if whole is None else part.after(whole)
                if part.status != OK or part.steps < count or self.stop():
                    break
        except Exception:
            if start is not None and not self.begun:
                # a function of time fails for a step that was not begun: whoever called tries the steps one by one
                self.load(start)
            raise
        assert whole is not None
        return whole

    def _some(self, t: float, h: float, count: int, done: int) -> Outcome:
        """Take steps in one call, with means of the last one where it stands alone or is the last that succeeds."""
        if count == 1:
            before = self.points.look(self.state)
            one = super().advance(t, h, 1, done)
            return self._with(one, self.points.means(before, self.points.look(self.state), h) if one.steps else self._unknown)
        saved = self.save()
        part = super().advance(t, h, count, done)
        if part.steps in (0, count):
            return self._with(part, self._unknown)
        # the same steps again, the last good one by itself, then what ended them
        good = part.steps
        self.load(saved)
        again = self._some(t, h, good - 1, done) if good > 1 else None
        last = self._some(t, h, 1, done + good - 1)
        last = last if again is None else last.after(again)
        return last if part.status == OK else self._some(t, h, 1, done + good).after(last)

    @property
    def _unknown(self) -> Array:
        return np.full(self.measured, np.nan)

    def _with(self, outcome: Outcome, means: Array) -> Outcome:
        outcome.force = np.hstack((outcome.force, np.stack((means, means))))
        return outcome


def forces_of(stepper: Stepper, found: Array) -> Array:
    """Return the forces among numbers of an outcome, which are what checkpoints keep."""
    return found[:stepper.recorded - getattr(stepper, "measured", 0)]


def measuring(make: type[Stepper], method: Scheme, points: PointSeries) -> Any:
    """Return the class of steppers of this kind whose outcomes hold means of `points`. Raises SceneError: a method whose rows
    hold forces of their own time has no such means."""
    if method.at_end and points.acceleration:
        raise SceneError(f"observe: accelerations are means of the steps around a row, which method {method.name!r} does not "
                         "support; leave 'acceleration' out, or leave method out")
    return type(f"Measured{make.__name__}", (MeasuredSteps, make), {})
