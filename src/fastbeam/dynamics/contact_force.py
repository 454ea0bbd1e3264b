"""Contact forces at the times of rows, to second order, from the mean forces of steps (theory.md (4.5))."""
from __future__ import annotations

import numpy as np

from fastbeam.dynamics.checkpoint import Clock
from fastbeam.dynamics.step_means import forces_of
from fastbeam.kernels.loop import OK
from fastbeam.stepping.stepper import Stepper

Array = np.ndarray
# steps ahead and back are this share of the others: their forces are as good as the state
PART = 0.25
# what rows hold, for the result
AT_ROWS = ("mean of the steps before and after a row, second-order accurate. At both ends of the run, and next to a shorter "
           "step, from short extra steps ahead or back; NaN where these fail")
AT_END = "at the time of the row"
# sizes of steps that are equal; and those from which forces alternate alike, such as a last step that takes a sliver along
EQUAL, ALIKE = 1e-9, 0.02


class ContactForces:
    """Forces of all constraints, F of them, at rows. Between two steps of the same size they are the means of theirs. The first
    and the last row of a run, and one beside a shorter step, have no such neighbours: there a few steps are taken ahead or back,
    for their forces only. Where something dissipates none are taken back, which would make what was dissipated grow again: the
    last row is extrapolated from the last three steps.

    stepper: its state is the same to the last bit after every call.
    controlled: steps are two of half the size, so that forces do not alternate from one to the next.
    t_start, t_end: between which loads with time functions may be asked for.
    """

    def __init__(self, stepper: Stepper, controlled: bool, t_start: float, t_end: float) -> None:
        self.stepper, self.controlled = stepper, controlled
        self.t_start, self.t_end = t_start, t_end
        forces = stepper.model.slider_forces
        self.timed = any(time is not None for time in stepper.model.load_times) or (forces is not None and forces.timed)
        motions = stepper.model.motions
        self.timed = self.timed or (motions is not None and motions.holds.given.size > 0)
        # forces at the first row that a checkpoint does not know
        self.ahead = np.zeros(0)
        self.looks_back = bool(stepper.model.losses)
        # size and mean forces [F] of up to three steps, the last first
        self._recent: list[tuple[float, Array]] = []

    @property
    def unknown(self) -> Array:
        """Forces that are not known: NaN, [F]."""
        return np.full(self.stepper.recorded, np.nan)

    def first(self, clock: Clock) -> Array | None:
        """Return the force at the first row [F]; None where the run goes on from a checkpoint and the next step gives it."""
        size, self._recent = clock.before_size, []
        if clock.before is not None and size is not None and (self.controlled or is_equal(size, clock.step, ALIKE)):
            self._fit(clock)
            return None
        clock.before = None
        return self._at(clock.now, clock.size)

    def _fit(self, clock: Clock) -> None:
        """Leave out forces of supports and joints of a checkpoint where this run does not record them. Forces that checkpoints do
        not keep come from steps ahead, for the first row."""
        assert clock.before is not None
        before, width = forces_of(self.stepper, clock.before).copy(), self.stepper.recorded
        if before.size < width:
            self.ahead = self._at(clock.now, clock.size)[before.size:]
        clock.before = np.append(before, np.full(width - before.size, np.nan))

    def between(self, clock: Clock, t: float, size: float, after: Array, steps: int) -> Array:
        """Return the force [F] at the last row; size, after: of the steps that followed, mean forces of the first [F]; t: the
        present time, their end."""
        found = self._between(clock, t, size, after, steps)
        found[found.size - self.ahead.size:] = self.ahead
        self.ahead = np.zeros(0)
        return found

    def _between(self, clock: Clock, t: float, size: float, after: Array, steps: int) -> Array:
        before, step = clock.before, clock.before_size
        assert before is not None and step is not None
        if is_equal(step, size):
            return np.mean([before, after], axis=0)
        if self.controlled and steps > 1 or is_equal(step, size, ALIKE):
            return (size * before + step * after) / (step + size)
        # only the last step of a run has another size, so the state is the one at its end
        return self._at(t, step if self.looks_back else -step, back=size)

    def remember(self, size: float, force: Array, alone: bool) -> None:
        """Keep size and mean forces [F] of the last step; alone: whether the steps kept before directly precede it."""
        self._recent = [(size, force), *(self._recent[:2] if alone else ())]

    def last(self, clock: Clock) -> Array:
        """Return the force [F] at the end of a run."""
        if clock.before_size is None:
            return self.unknown
        step = clock.before_size if self.controlled else clock.step
        if not self.looks_back:
            return self._at(clock.now, -step)
        # a run that ends early may go on
        return self._extrapolated() if len(self._recent) == 3 else self._at(clock.now, step)

    def _extrapolated(self) -> Array:
        """Extrapolate the force [F] behind the last three steps linearly; means of steps alternate besides (4.5), but for those
        of two halves."""
        sizes = np.array([size for size, _ in self._recent])
        middle = np.cumsum(sizes) - 0.5 * sizes
        third = middle**2 if self.controlled else np.array([1.0, -1.0, 1.0])
        share = np.linalg.solve(np.stack((np.ones(3), middle / middle[2], third / abs(third[2]))), np.array([1.0, 0.0, 0.0]))
        return np.asarray(share @ np.stack([force for _, force in self._recent]))

    def _at(self, t: float, step: float, *, back: float = 0.0) -> Array:
        """Return the force [F] at the time t of the present state, or `back` before it; NaN where steps fail. step: of the run,
        negative to look back. The state stays as it is."""
        stepper = self.stepper
        saved, fallbacks = stepper.save(), stepper.linear.fallbacks
        # loads are not asked for where the run does not go
        available = (self.t_end - t + back if step > 0.0 else t - back - self.t_start) if self.timed else np.inf
        h = PART * float(np.copysign(min(abs(step), max(available, 0.0)), step))
        if h == 0.0:
            return self.unknown
        try:
            # a beam may end soon
            for size in (h, 0.1 * h):
                if back and stepper.advance(t, -back, 1).status != OK:
                    break
                found = self._fitted(t - back, size)
                stepper.load(saved)
                if found is not None:
                    return found
        finally:
            stepper.load(saved)
            stepper.linear.fallbacks = fallbacks
        return self.unknown

    def _fitted(self, t: float, h: float) -> Array | None:
        """Return the force at time t, that of the state, from three steps. It is taken to change linearly; means of steps
        alternate besides (4.5)."""
        forces = []
        for k in range(3):
            outcome = self.stepper.advance(t, h, 1, k)
            if outcome.status != OK:
                return None
            forces.append(outcome.force[1])
        return forces[0] + 0.5 * forces[1] - 0.5 * forces[2]


def is_equal(one: float, other: float, share: float = EQUAL) -> bool:
    """Return whether two steps have the same size, but for this share of it."""
    return abs(one - other) <= share * max(one, other)
