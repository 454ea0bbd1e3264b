"""Steps in which a slider goes over a corner between two tracks of a switch, as one on a path does (theory.md 5.11)."""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.dynamics.control import StepSizes
from fastbeam.dynamics.locks import Awaited, Locking
from fastbeam.interface.errors import ConvergenceError
from fastbeam.kernels.loop import OK, SLIDER_END
from fastbeam.kernels.state import State
from fastbeam.scene.locks import END
from fastbeam.scene.switches import chosen, span_of
from fastbeam.stepping.outcome import Outcome
from fastbeam.stepping.stepper import Stepper
from fastbeam.stepping.terms import Corner

# a step over a corner that fails, or meets something else, is tried again, up to so many times half as far behind it
MOST_TRIES = 8
# number of tries with step control; the last one is kept, however large its error is
MOST_JUDGED = 10
# velocities of a step to a corner that is shorter, as a share of a whole one, are round-off
TOO_SHORT = 1e-8


class Passed(NamedTuple):
    """A step over a corner: its size, s, its outcome, the state behind it, and the event of a change of track; None where the
    slider turned around."""

    size: float
    outcome: Outcome
    state: State
    event: dict[str, Any] | None


class Corners:
    """Corners that a slider meets in a step; control: judges the steps."""

    def __init__(self, stepper: Stepper, locking: Locking, control: StepSizes | None = None) -> None:
        self.stepper, self.locking, self.model, self.control = stepper, locking, stepper.model, control

    def passed(self, start: Any, t: float, sizes: tuple[float, float], awaited: Awaited, step: int) -> Passed | None:
        """Take a step from the saved state `start` at time t over the corner that a slider is at now.

        sizes: sizes of the step to the corner and of the whole step, s.
        awaited: the change of track that is due.
        step: number of the step, for errors.
        Raises ConvergenceError: no step leads over the corner.

        Returns
        -------
        Passed or None
            With the stepper at the end of the step, on the curve over the corner; None, with the stepper as it was, where the
            slider may stop there: the corner is not sharp, or something else happens in every such step.
        """
        here, k, at_end = self.stepper.save(), awaited.slider, awaited.when == END
        slider, state = self.locking.sliders[k], here[0]
        switch, number = slider.beam, span_of(slider.beam, float(state.s[k]))
        assert self.model.sliders is not None
        place = int(self.model.sliders.curve[k]), number, at_end
        is_short = 0.0 < sizes[0] < TOO_SHORT * sizes[1]
        if not any(at[:3] == place and (is_sharp or is_short) for at, (_, is_sharp) in self.model.corners.items()):
            return None
        track = chosen(switch, switch.options(switch.tracks[number], awaited.when), t + sizes[0], state,
                       self.model.names["sliders"][k])
        curve, is_sharp = self.model.corners.get((*place, [x.name for x in switch.tracks].index(track)), (-1, False))
        if not (is_sharp or is_short):
            return None
        stops = slider.stops
        on_tracks = any(isinstance(x, tuple) for x in (getattr(stops, "start", None), getattr(stops, "end", None), *(
            x.at for x in slider.lock or ())))
        found, failed = None, False
        if curve >= 0 and not on_tracks:
            corner = Corner(k, curve, self._limits(state, k, number, at_end, track))
            found, failed = self._tried(start, t, sizes, corner, track)
        if found is None:
            self.stepper.load(here)
            if is_sharp and (failed or is_short):
                self.stepper.load(start)
                raise ConvergenceError(
                    f"step {step} at t = {t:.6g} s: {slider.kind} {slider.name!r} cannot pass the corner between the tracks "
                    f"{switch.tracks[number].name!r} and {track!r}; the last good state is in .state, everything computed in "
                    ".result. At a corner sharper than a right angle no force carries a slider on: replace the corner by an "
                    "arc. At a blunter corner a smaller step may help",
                    step=step, time=t, state=self.stepper.copy_state())
        return found

    def _limits(self, state: State, k: int, number: int, at_end: bool, track: str) -> tuple[float, float]:
        """Return the arc lengths, m, between which slider k may go that leaves the track of this number for another: the stops on
        both."""
        behind = State(*(x.copy() for x in state))
        shift = self.locking.move_on(behind, k, number, at_end, track)
        own, others = (self.model.limits_at(x.s, x.history)[k] for x in (state, behind))
        return (own[0], others[1] + shift) if at_end else (others[0] + shift, own[1])

    def _tried(self, start: Any, t: float, sizes: tuple[float, float], corner: Corner,
               track: str) -> tuple[Passed | None, bool]:
        """Find the longest step over a corner; return also whether all fail."""
        stepper, failed = self.stepper, True
        tries = MOST_TRIES if self.control is None else MOST_JUDGED
        for n in range(tries):
            size = sizes[0] + 0.5**n * (sizes[1] - sizes[0])
            stepper.corner = corner
            try:
                stepper.load(start)
                outcome, is_good = self._step(start, t, size)
            finally:
                stepper.corner = None
            if not is_good and n < tries - 1:
                continue
            if outcome.status == OK and outcome.steps:
                state = stepper.copy_state()
                event = self._moved_on(state, corner.slider, track, start[0], t + sizes[0])
                if self.locking.reached(state, t + size)[0] < 0.0:
                    return Passed(size, outcome, state, event), False
            failed &= outcome.status not in (OK, SLIDER_END)
        return None, failed

    def _step(self, start: Any, t: float, size: float) -> tuple[Outcome, bool]:
        """Take a step of this size, with step control its halves; return also whether its local error is below the tolerance."""
        stepper, control = self.stepper, self.control
        whole = stepper.advance(t, size, 1)
        if control is None or whole.status != OK or not whole.steps:
            return whole, True
        coarse = stepper.copy_state()
        stepper.load(start)
        halves = stepper.advance(t, 0.5 * size, 2)
        halves.force = np.stack((halves.force.mean(axis=0), halves.force.mean(axis=0)))
        return halves, halves.status == OK and halves.steps == 2 and control.error(stepper, coarse) <= control.tolerance

    def _moved_on(self, state: State, k: int, track: str, before: State, t: float) -> dict[str, Any] | None:
        """Count the arc length of slider k on its new track, reached at time t; the event, None where it turned around."""
        switch = self.locking.sliders[k].beam
        number = span_of(switch, float(before.s[k]))
        begin, end = switch.spans[number]
        if begin <= state.s[k] <= end:
            return None
        self.locking.move_on(state, k, number, bool(state.s[k] > end), track)
        return self.locking.switched(state, k, number, track, t)
