"""Events within the steps of a run: sliders and joints meet rigid stops, sliders meet ends of beams, locks engage."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from fastbeam.dynamics.bounds import OfMovingMeshes
from fastbeam.dynamics.checkpoint import Clock
from fastbeam.dynamics.control import (
    END_TOLERANCE,
    TRANSFER_TOLERANCE,
    StepSizes,
    failure,
    run_to_condition,
    run_to_end_of_beam,
)
from fastbeam.dynamics.corners import TOO_SHORT, Corners, Passed
from fastbeam.dynamics.impacts import SAME_TIME, Impacts
from fastbeam.dynamics.interrupt import Calls
from fastbeam.dynamics.locks import TRANSFER, Locking
from fastbeam.dynamics.recording import Rows
from fastbeam.dynamics.warnings import MOST_NAMED
from fastbeam.kernels.loop import NOT_CONVERGED, OK, SLIDER_END
from fastbeam.kernels.state import State
from fastbeam.model.model import Model
from fastbeam.model.start import AT_STOP
from fastbeam.results.progress import Progress
from fastbeam.stepping.outcome import Outcome
from fastbeam.stepping.stepper import Stepper

# share of a step up to which the rest of a run behind an impact is dropped: its velocities would be round-off
NEXT_TO_NOTHING = 1e-6
# a point that is back on its beam after this share of a step has not been away
SHORT_FLIGHT = 1.0 / 64.0
# share of the kinetic energy that an impact may dissipate because it is the second within a step
DULLED = 0.05
# status of steps before one in which a condition of a lock or release begins to hold
CONDITION = 100


@dataclass
class Plan:
    """Steps that are taken next."""

    end: float  # time up to which they go, s
    left: int  # whole steps until then; none with step control
    last: float  # size of a last one that differs, or 0, s


class Encounters:
    """The part of a run that goes on behind an event: the step is shortened to it, velocities jump or the slider is fixed or
    released, and steps are counted from there."""

    model: Model
    stepper: Stepper
    clock: Clock
    calls: Calls
    rows: Rows
    progress: Progress
    control: StepSizes | None
    impacts: Impacts
    locking: Locking
    event: Callable[[dict[str, Any]], None]
    took: Callable[[float, Outcome, float], None]
    t_end: float
    step: float
    steps: int
    between: bool

    def plan(self) -> Plan:
        """Plan the steps up to the end of the run, or to where a lock or release is due."""
        end = min(self.t_end, self.locking.next_time(self.stepper.state)) if self.locking.is_present else self.t_end
        return Plan(end, *(self.clock.plan(end) if self.control is None and self.clock.now < end else (0, 0.0)))

    def happen(self, t: float, found: Sequence[Any] = ()) -> bool:
        """Apply locks and releases that are due; return whether there are any."""
        if not self.locking.is_present:
            return False
        before = self.stepper.copy_state()
        state, events = self.locking.behind(before, t, NEXT_TO_NOTHING * self.step, found)
        if state is not before:
            self.stepper.set_state(state)
        for event in events:
            self.event(event)
        return state is not before

    def advance(self, t: float, h: float, n: int, done: int = 0) -> Outcome:
        """Take steps as `Calls.advance`, one at a time where conditions are watched: CONDITION where one holds behind the last,
        and no more steps where sliders lift off."""
        if not self.locking.is_present:
            return self.calls.advance(t, h, n, done)
        # made in space once a step
        here = self.stepper.copy_state()
        if not self.locking.watch(here, t + done * h):
            return self.calls.advance(t, h, n, done)
        whole: Outcome | None = None
        before = self.clock.before
        for k in range(done, done + n):
            saved = here, self.stepper.memory
            try:
                part = self.calls.advance(t, h, 1, k)
                part, here = self.looked_at(saved, part, t + (k + 1) * h, before)
            except KeyboardInterrupt:
                self.calls.intact &= k == done
                raise
            except Exception as failed:
                if whole is None or not self.calls.intact:
                    raise
                # steps done so far count
                self.calls.failed = failed
                break
            before = part.force[1]
            whole = part if whole is None else part.after(whole)
            if part.status != OK or not part.steps or self.locking.lifting:
                break
            self.locking.watch(here, t + (k + 1) * h)
        assert whole is not None
        return whole

    def controlled(self, t: float, h: float) -> tuple[float, float, Outcome]:
        """Take a step as `Calls.controlled`, with CONDITION as in `advance`."""
        assert self.control is not None
        watches = self.locking.is_present and self.locking.watch(self.stepper.state, t)
        saved = self.stepper.save() if watches else None
        size, proposed, outcome = self.calls.controlled(self.control, t, h, self.steps)
        for k in [k for k, told in self.control.passed.items() if not told][:MOST_NAMED]:
            self.control.passed[k] = True
            self.event({"kind": "unresolved", "time": t + size,
                        "text": f"{self.model.lines.names[k]}: its ends pass each other in the smallest step, {size:.3g} s, that "
                                f"ends at t = {t + size:.6g} s, so its force at short lengths is not resolved; reduce min_step"})
        if saved is not None:
            outcome, _ = self.looked_at(saved, outcome, t + size, self.clock.before)
        return size, proposed, outcome

    def looked_at(self, saved: Any, outcome: Outcome, t: float, before: Any) -> tuple[Outcome, State]:
        """Return a step that led to time t, and the state behind it; where a condition holds behind it go back to its saved
        start, with CONDITION. before: mean contact force of the step before, N."""
        if not outcome.steps:
            return outcome, saved[0]
        state = self.stepper.copy_state()
        try:
            holds = self.locking.reached(state, t)[0] >= 0.0
        except Exception:
            self.stepper.load(saved)
            self.calls.intact = True
            raise
        if holds:
            self.stepper.load(saved)
            return replace(outcome, status=CONDITION, steps=0), saved[0]
        if self.locking.sided:
            for into in (self.stepper.core_state, state):
                self.locking.follow(state, t, into)
            self.locking.find_lifting(state, before, outcome.force[1])
        return outcome, state

    def to_condition(self, t: float, outcome: Outcome, h: float) -> Any:
        """Take a step to where a condition of a lock or release begins to hold."""
        if outcome.steps:
            yield t, replace(outcome, status=OK), h, True
        self.between, self.calls.intact = True, False
        self.locking.watch(self.stepper.state, t)
        parts = 1 if self.control is None else 2
        least = SHORT_FLIGHT if self.locking.touches else NEXT_TO_NOTHING
        last, final, found = run_to_condition(self.stepper, t, h, parts, least, self.locking.reached)
        if final.status != OK:
            raise failure(self.stepper, final, t, self.steps, last)
        # a point that comes back without having been away does not bounce
        yield from self.behind(t, last, final, [replace(x, rests=last == 0.0) for x in found])
        return True

    def behind(self, t: float, last: float, final: Outcome, found: Sequence[Any] = (), strikes: Any = None,
               passed: Passed | None = None) -> Any:
        """Go on behind the events after a step from t of size `last`: conditions that hold, a slider that strikes a stop, with
        its end, and one that has passed a corner."""
        if last > 0.0:
            t = self.t_end if self.t_end - t - last < NEXT_TO_NOTHING * self.clock.size else t + last
            self.progress.update(last)
            self.clock.leave_grid(t)
        self.took(t, final, last)
        if strikes is not None:
            self.impact(strikes[0], t, strikes[1], last)
        if passed is not None:
            self.stepper.set_state(passed.state)
            if passed.event is not None:
                self.event(passed.event)
        self.happen(t, found)
        # the row, the callback and the checkpoint of this time are behind it
        self.count_from(t)
        if last > 0.0:
            yield t, replace(final, steps=0), last, True
        self.between = False

    def end_of_beam(self, t: float, outcome: Outcome, h: float) -> Any:
        """Take a step to the end of the beam, or the rigid stop, that a slider reached; return whether the run goes on behind
        it."""
        if outcome.steps:
            yield t, replace(outcome, status=OK), h, True
        self.between, self.calls.intact = True, False
        start = self.stepper.save()
        watched = self.locking.is_present and self.locking.watch(self.stepper.state, t)
        tolerance = TRANSFER_TOLERANCE if self.model.spans else END_TOLERANCE
        failed = outcome.status not in (OK, SLIDER_END)
        last, final, k = run_to_end_of_beam(self.stepper, t, h, tolerance, failed)
        if watched and last > 0.0 and self.locking.reached(self.stepper.state, t + last)[0] >= 0.0:
            self.stepper.load(start)
            return (yield from self.to_condition(t, replace(outcome, steps=0), last))
        bounded = self.impacts.bounded
        s, (low, high) = float(bounded.at(self.stepper.state)[k]), bounded.limits(self.stepper.state)[k]
        end = "end" if abs(s - high) <= abs(s - low) else "start"
        is_impact = self.impacts.is_rigid(self.stepper.state, k, end == "end")
        kind = bounded.kind_of(k)[0]
        found = self.locking.at_end(self.stepper.state, k, end == "end", is_impact) if k < self.model.n_sliders else []
        arrives = min(abs(s - low), abs(s - high)) <= AT_STOP * float(bounded.scales[k])
        if isinstance(kind, OfMovingMeshes) and not arrives:
            # in steps that are long against an element that vanishes no motion is right
            self.stepper.load(start)
            raise failure(self.stepper, replace(outcome, status=NOT_CONVERGED, steps=0), t, self.steps, h)
        if kind.meet_together and arrives and 0.0 < last < SAME_TIME * self.step:
            # joints that meet their stops one after the other at almost the same time: velocities of such a step are round-off
            self.stepper.load(start)
            last, final = 0.0, replace(final, steps=0)
        if (is_impact or found) and (arrives or last > 0.0) and self.impacts.may_go_on(last > 0.0 and arrives):
            # if a slightly longer step takes another branch of friction, this one ends before the stop
            strikes = (k, end) if arrives and not found else None
            if arrives and found and found[0].action == TRANSFER:
                passed = Corners(self.stepper, self.locking, self.control).passed(start, t, (last, h), found[0], self.steps)
                if passed is not None:
                    self.impacts.in_a_row = 0
                    yield from self.behind(t, passed.size, passed.outcome, passed=passed)
                    return True
                if 0.0 < last < TOO_SHORT * h:
                    # the slider stands there already: velocities of such a step are round-off
                    self.stepper.load(start)
                    last, final = 0.0, replace(final, steps=0)
            yield from self.behind(t, last, final, found if arrives else (), strikes)
            return True
        if last > 0.0:
            t += last
            self.progress.update(last)
            self.clock.leave_grid(t)
            yield t, final, last, True
        self.between = False
        if is_impact or found:
            raise failure(self.stepper, replace(final, status=NOT_CONVERGED, steps=0), t, self.steps, h)
        if isinstance(kind, OfMovingMeshes):
            found = self.model.moving.at_end(bounded.kind_of(k)[1], self.stepper.state.s)
        else:
            name = self.model.names["sliders"][k]
            found = {"slider": name, "end": end, "s": s, "text": f"slider {name!r} reached the {end} of its {self.model.track}"}
        self.event({"kind": "slider_end", "time": t, **found, "text": f"{found['text']} at t = {t:.6g} s; the run ends here"})
        return False

    def impact(self, k: int, t: float, end: str, last: float) -> None:
        """Apply the impact of a coordinate with bounds on a rigid stop: go on with the velocities behind it."""
        self.stepper.set_state(self.impacts.behind(self.stepper.copy_state(), k, end == "end", t, self.step, last))
        of, i = self.impacts.bounded.kind_of(k)
        kind, name = of.named(i)
        if kind == "slider" and self.control is None:
            self.watch.blow(k, name, t, self.step)
        if self.impacts.number <= MOST_NAMED:
            self.event({"kind": "impact", "time": t, kind: name, "end": end,
                        "text": f"{kind} {name!r} hit its stop at the {end} at t = {t:.6g} s"})
        if self.impacts.dulled > DULLED:
            self.event({"kind": "unresolved", "time": t, kind: name, "text": (
                f"{kind} {name!r} hit its stop at the {end} a second time within one step, at t = {t:.6g} s, and stays there. "
                f"This dissipates {100.0 * self.impacts.dulled:.2g} % of the kinetic energy, which restitution= would keep; use "
                "smaller steps")})

    def count_from(self, t: float) -> None:
        """Count steps from a time within one; forces of rows look ahead there."""
        clock = self.clock
        clock.now, clock.before, clock.before_size = t, None, None
        if self.control is None:
            clock.origin, clock.done, clock.on_grid = t, 0, True
        self.rows.reopen(t)
