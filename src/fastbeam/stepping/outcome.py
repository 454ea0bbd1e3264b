"""Outcomes of the steps of a run."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fastbeam.kernels.loop import NOT_CONVERGED, NOT_FINITE, SINGULAR

Array = np.ndarray
MEANING = {NOT_CONVERGED: "the Newton iteration did not converge", SINGULAR: "the tangent is singular",
           NOT_FINITE: "the Newton iteration diverged"}


@dataclass
class Outcome:
    """Outcome of a number of steps: status, steps done, Newton iterations, slider of an event, sizes of the last increments, mean
    contact force of the first and the last step [2, 3 S]."""

    status: int
    steps: int
    iterations: int
    slider: int
    sizes: Array
    force: Array

    def after(self, other: Outcome) -> Outcome:
        """Return this outcome as the continuation of another."""
        first = other.force[0] if other.steps else self.force[0]
        last = self.force[1] if self.steps else other.force[1]
        return Outcome(self.status, other.steps + self.steps, other.iterations + self.iterations, self.slider, self.sizes,
                       np.stack((first, last)))
