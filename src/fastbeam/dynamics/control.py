"""Time stepping above the single step: composition to order four, step control, runs that end at the end of a beam."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fastbeam.dynamics.bounds import Bounded, vanishing
from fastbeam.dynamics.checkpoint import RESOLVED, Clock, check_times
from fastbeam.dynamics.options import StepControl
from fastbeam.interface.errors import ConvergenceError, SceneError
from fastbeam.kernels.loop import BORDER_SINGULAR, NOT_CONVERGED, NOT_FINITE, OK, SINGULAR, SLIDER_END
from fastbeam.kernels.state import State
from fastbeam.model.forces.winches import used_up
from fastbeam.model.maps import gyration_radii
from fastbeam.stepping.outcome import MEANING, Outcome
from fastbeam.stepping.stepper import Stepper

Array = np.ndarray
SUZUKI = 1.0 / (4.0 - 4.0 ** (1.0 / 3.0))
WEIGHTS = {2: np.ones(1), 4: np.array([SUZUKI, SUZUKI, 1.0 - 4.0 * SUZUKI, SUZUKI, SUZUKI])}
# a located end of a beam is met within this share of its length
END_TOLERANCE = 1e-10
# the same for sliders that go on to another track there
TRANSFER_TOLERANCE = 1e-15
# the time at which a condition begins to hold is met within this share of the step, round-off
CONDITION = 1e-15
# the error of a step to such an end is judged within this share of it, so that its halves stay inside
INSIDE = 0.99
# a step in which a triad turns by more is hard to solve, and beyond the second one does not resolve the rotation, rad
LARGE_TURN, UNRESOLVED_TURN = 0.5, 0.5 * np.pi


def composition(order: int) -> Array:
    """Return the substeps of a step of order 2 or 4 (Suzuki's composition, theory.md 6). Raises SceneError: the order is neither
    2 nor 4."""
    if order not in (2, 4):
        raise SceneError(f"order: must be 2 or 4, got {order!r}")
    return WEIGHTS[order]


def failure(stepper: Stepper, outcome: Outcome, t: float, step: int, h: float = 0.0) -> ConvergenceError:
    """Form the error of a step of size h that failed, with the last good state."""
    model = stepper.model
    node, size = stepper.worst_node()
    worst = f"{stepper.label_of(node)} (residual {size:.3g})"
    if stepper.contact is not None:
        k, gap, slide = stepper.worst_constraint()
        sliding = f", sliding {slide:.3g} N" if k < model.n_sliders else ""
        worst += f", {model.constraint_names[k]} (gap {gap:.3g} m{sliding})"
    sizes = [float(x) for x in outcome.sizes if x > 0.0 or x != x]
    cause, advice = _cause(stepper, outcome, h)
    if not np.isfinite(size) and outcome.status in (SINGULAR, NOT_FINITE) and not vanishing(model, stepper.state, h).size:
        cause = (f"during the iteration the axis was compressed to zero length near {model.node_label(node)}, where strains are "
                 "undefined, or values there became infinite")
    shown = ", ".join(f"{x:.2g}" for x in sizes[:8]) + (", ..." if len(sizes) > 8 else "")
    spinning, spin = stepper.largest_spin()
    if spin * h > LARGE_TURN:
        shown += (f"; {model.node_label(spinning)} turns with {spin:.3g} rad/s, which is {spin * h:.3g} rad in this step of "
                  f"{h:.3g} s. Turns up to {LARGE_TURN} rad a step are safe, here steps up to {LARGE_TURN / spin:.2g} s")
    error = ConvergenceError(
        f"step {step} at t = {t:.6g} s: {cause}; increments {shown or 'none'}; largest at {worst}; the last good state is in "
        f".state, everything computed in .result. {advice}",
        step=step, time=t, residuals=sizes, worst=worst, state=stepper.copy_state())
    return stepper.blamed(error, f"step {step} at t = {t:.6g} s",
                          "The last good state is in .state, everything computed in .result")


def _cause(stepper: Stepper, outcome: Outcome, h: float) -> tuple[str, str]:
    """Tell why a step failed, and what to do."""
    spent = used_up(stepper.model, stepper.state, h) if outcome.status == SINGULAR else ""
    if spent:
        return spent, "End the run earlier, give more rope, or brake the drum (tension=, inertia=)"
    run_out = vanishing(stepper.model, stepper.state, h)
    if run_out.size:
        found = stepper.model.moving.at_end(int(run_out[0]), stepper.state.s)
        return f"in this step {found['text'].replace('came', 'comes')}", "Use smaller steps"
    names, contact = stepper.model.constraint_names, stepper.contact
    if outcome.status == SLIDER_END and 0 <= outcome.slider < stepper.model.n_sliders:
        begin, end = stepper.model.limits_at(stepper.state.s, stepper.state.history)[outcome.slider]
        s = float(stepper.state.s[outcome.slider])
        which = "end" if end - s < s - begin else "start"
        return (f"{names[outcome.slider]} reaches the {which} of its {stepper.model.track} in this step, where its motion ends",
                "End before that time (t_end=...)")
    others, smaller = "supports, connections or other sliders", "Try a smaller step, or step control with tolerance=..."
    if outcome.status == BORDER_SINGULAR:
        # a negative size is the number of the slider
        cause = f"the equations of {names[int(-min(outcome.sizes)) - 1]} are singular"
        if max(outcome.sizes) > 0.1:
            # far from a solution a singular border says nothing about the scene
            return cause, smaller
        # known is only that no force moves the parts towards each other
        return (f"{cause}: its constraint force moves nothing, for example because {others} fix both sides already",
                "Remove one of these constraints, or give the parts that it joins mass and freedom to move.")
    last = [x for x in outcome.sizes if x > 0.0][-1:]
    if outcome.status == NOT_CONVERGED and contact is not None and last and last[0] < 1e-9 and np.any(contact.remaining > 0.0):
        k = int(np.argmax(contact.remaining))
        return (f"the gap of {names[k]} does not close, {contact.remaining[k]:.2g} m are left: {others} constrain almost the "
                "same motion", "Move them apart, or raise augmentation=...")
    return MEANING.get(outcome.status, "failed"), smaller


def run_to_end_of_beam(stepper: Stepper, t: float, h: float, tolerance: float = END_TOLERANCE,
                       failed: bool = False) -> tuple[float, Outcome, int]:
    """Shorten a step in which sliders leave their beams, or they or joints pass rigid stops, so that it ends where the first of
    them meets its end. The step size is free, so the invariants stay exact. Returns (size of the step, its outcome, the number of
    that slider or, behind all of these, coordinate of a joint); size 0 where it stands at the end already. tolerance: way that
    may be left, as a share of the length; failed: the whole step has not converged, as contacts meet in it (`vanishing`)."""
    start = stepper.save()
    bounded = Bounded(stepper.model)
    limits, lengths = bounded.limits(stepper.state), bounded.scales
    (low_end, high_end), slack = limits.T, bounded.slack(limits)
    leaving: dict[int, float] = {}

    def distance_left() -> float:
        """Return the way to the end in sight at the end of the last trial, as a share of the length; the least of all that leave,
        negative beyond the end."""
        s = bounded.tried(stepper)
        for k in np.flatnonzero(~((s >= low_end - slack) & (s <= high_end + slack))):
            leaving.setdefault(int(k), 0.0 if s[k] < low_end[k] else 1.0)
        return way(s)[0]

    def way(s: Array) -> tuple[float, int]:
        return min((float((high_end[k] - s[k] if end else s[k] - low_end[k]) / lengths[k]), k) for k, end in leaving.items())

    if failed:
        ways = stepper.model.n_sliders + vanishing(stepper.model, stepper.state, h)
        leaving.update(dict.fromkeys(ways.tolist(), 0.0))
    high, f_high = 1.0, -way(bounded.at(stepper.state))[0] if failed else distance_left()
    low, reached = 0.0, start
    best = 0.0, Outcome(OK, 0, 0, -1, np.zeros(0), np.zeros((2, stepper.recorded)))
    halved, before = True, (np.inf, -np.inf)
    for _ in range(60):
        f_low = way(bounded.at(reached[0]))[0]
        if f_low <= tolerance or high - low < 1e-13:
            break
        # secant, with bisection as a guard and where a secant has led next to nowhere, as where the slider starts from rest; aim
        # a little inside
        halved = not halved and f_low > 0.5 * before[0] and f_high < 0.5 * before[1]
        before = f_low, f_high
        x = 0.5 * (low + high) if halved or not f_high < 0.0 else low + (high - low) * f_low / (f_low - f_high)
        x = min(max(x, low + 0.001 * (high - low)), high - 0.001 * (high - low))
        stepper.load(start)
        outcome = stepper.advance(t, x * h, 1)
        if outcome.status == OK:
            low, reached, best = x, stepper.save(), (x * h, outcome)
        else:
            high, f_high = x, distance_left() if outcome.status == SLIDER_END else -f_low
    stepper.load(reached)
    return *best, way(bounded.at(reached[0]))[1]


def run_to_condition(stepper: Stepper, t: float, h: float, parts: int, least: float,
                     reached: Callable[[State, float], tuple[float, list[Any]]]) -> tuple[float, Outcome, list[Any]]:
    """Shorten a step from t, after which a condition holds, so that it ends where the first of them begins to.

    parts: the step consists of so many of the same size.
    least: share of the step: what holds by then holds now.
    reached: (state, t) -> how far the first condition is reached, negative before that, and which conditions hold.

    Returns
    -------
    tuple
        Size of the step, its outcome, and the conditions.
    """
    from scipy.optimize import brentq
    start = stepper.save()

    def trial(x: float) -> Outcome:
        stepper.load(start)
        return stepper.advance(t, x * h / parts, parts)

    def beyond(x: float) -> float:
        # a step that fails, or ends elsewhere, is too long
        return reached(stepper.copy_state(), t + x * h)[0] if trial(x).status == OK else 1.0

    if not beyond(least) < 0.0:
        found = reached(stepper.copy_state(), t + least * h)[1]
        stepper.load(start)
        return 0.0, Outcome(OK, 0, 0, -1, np.zeros(0), np.zeros((2, stepper.model.n_forces))), found
    at = float(brentq(beyond, least, 1.0, xtol=CONDITION, rtol=CONDITION))
    outcome = trial(at)
    return at * h, outcome, reached(stepper.copy_state(), t + at * h)[1]


@dataclass
class StepSizes:
    """Local error control by step doubling: one step against two halves; the halves are kept.

    tolerance: allowed local error of a position per step, relative to the size of the scene; of a triad at the radius of gyration
        of its body or section.
    order: order of the method.
    smallest, largest: bounds of the step, s.
    Raises SceneError: the smallest step is not > 0, or larger than the largest.
    """

    tolerance: float
    order: int
    smallest: float
    largest: float
    accepted: int = 0
    rejected: int = 0
    # passages that steps of the smallest size have missed: number of a spring, damper or line force whose ends passed each other
    # on a long way -> whether an event has told so
    passed: dict[int, bool] = field(default_factory=dict)
    # float64 [N], optional: radii of gyration of all nodes, m, from the first step on
    radius: Array | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if not 0.0 < self.smallest <= self.largest:
            raise SceneError(f"min_step, max_step: need 0 < min_step <= max_step, got {self.smallest:g} and {self.largest:g} s")

    def advance(self, stepper: Stepper, t: float, h: float, step: int) -> tuple[float, float, Outcome]:
        """Take one accepted step. Returns (its size, proposed size of the next, outcome); the status is OK or SLIDER_END. OK
        without a step means that `stepper.stop` said so. Raises ConvergenceError: the smallest step fails."""
        start = stepper.save()
        try:
            return self._accepted(stepper, start, t, h, step)
        except BaseException:
            stepper.load(start)
            raise

    def _accepted(self, stepper: Stepper, start: tuple[State, Array], t: float, h: float,
                  step: int) -> tuple[float, float, Outcome]:
        while True:
            whole = stepper.advance(t, h, 1)
            coarse = stepper.copy_state()
            error, size = np.inf, h
            halves = whole
            if whole.status == SLIDER_END:
                size, error = self._to_the_end(stepper, start, t, h)
                # if friction changes its branch short of the end, smaller steps do not help
                if error <= self.tolerance or not np.isfinite(error) and h <= self.smallest * (1.0 + 1e-12):
                    return h, h, stepper.advance(t, h, 1)
            elif whole.status == OK:
                stepper.load(start)
                halves = stepper.advance(t, 0.5 * h, 2) if whole.steps else whole
                if halves.status == OK and halves.steps < 2:
                    stepper.load(start)
                    halves.steps = 0
                    return h, h, halves
                if halves.status == SLIDER_END:
                    stepper.load(start)
                    if h > self.smallest * (1.0 + 1e-12):
                        # the slider went beyond the end and back: a shorter step meets the end
                        h = max(self.smallest, 0.5 * h)
                        continue
                    return h, h, stepper.advance(t, h, 1)
                if halves.status == OK:
                    error = self.error(stepper, coarse)
                    if error <= self.tolerance:
                        error = max(error, self._unseen(stepper, start[0].q, t, h))
            if error <= self.tolerance:
                self.accepted += 1
                halves.force = np.stack((halves.force.mean(axis=0), halves.force.mean(axis=0)))
                halves.iterations += whole.iterations
                return h, min(self.largest, h * self._factor(error)), halves
            self.rejected += 1
            stepper.load(start)
            shorter = size * (self._factor(error) if np.isfinite(error) else 0.25)
            if h <= self.smallest * (1.0 + 1e-12):
                if np.isfinite(error):
                    raise ConvergenceError(f"step {step} at t = {t:.6g} s: the local error {error:.3g} exceeds the tolerance "
                                           f"{self.tolerance:g} at the smallest step {h:.3g} s; reduce min_step, or increase "
                                           "tolerance", step=step, time=t, state=start[0])
                raise failure(stepper, halves if whole.status == OK else whole, t, step, h)
            h = max(self.smallest, shorter)

    def _to_the_end(self, stepper: Stepper, start: tuple[State, Array], t: float, h: float) -> tuple[float, float]:
        """Return the size of the step that ends where a slider meets the end of its beam, or a rigid stop, and its local error:
        of one step, which is what is kept there. The state is left at the start."""
        stop, stepper.stop = stepper.stop, bool
        error = np.inf
        try:
            size = run_to_end_of_beam(stepper, t, h)[0]
            if size == 0.0:
                return size, 0.0
            stepper.load(start)
            if stepper.advance(t, INSIDE * size, 1).status == OK:
                coarse = stepper.copy_state()
                stepper.load(start)
                if stepper.advance(t, 0.5 * INSIDE * size, 2).status == OK:
                    error = 2.0**self.order * self.error(stepper, coarse)
            return size, error
        finally:
            stepper.stop = stop
            stepper.load(start)

    def _unseen(self, stepper: Stepper, before: Array, t: float, h: float) -> float:
        """Return the error that a step and its halves do not show: inf where ends of a spring, damper or line force pass each
        other, and that of laws of line forces that begin to act within a step (theory.md 6). The smallest step has none."""
        lines = stepper.model.lines
        if lines is None:
            return 0.0
        state, is_smallest = stepper.state, h <= self.smallest * (1.0 + 1e-12)
        found = lines.passed(before, state.q)
        for k in found if is_smallest else ():
            self.passed.setdefault(int(k), False)
        if is_smallest or len(found):
            return 0.0 if is_smallest else np.inf
        if not lines.forces:
            return 0.0
        return float(lines.unseen(before, state.q, t + 0.5 * h, h, stepper.model.gravity_weight)) / stepper.model.length

    def error(self, stepper: Stepper, coarse: State) -> float:
        """Return the local error of two halves of a step, which led to the present state, against the whole; relative to the
        scene. A triad that is turned counts by what it moves at the radius of gyration."""
        difference = (stepper.state.q - coarse.q).reshape(-1, 4, 3)
        if self.radius is None:
            self.radius = gyration_radii(stepper.model)
        turned = self.radius * np.linalg.norm(difference[:, 1:], axis=(1, 2)) / np.sqrt(2.0)
        size = float(np.max(np.hypot(np.linalg.norm(difference[:, 0], axis=1), turned)))
        if coarse.s.size:
            size = max(size, float(np.max(np.abs(stepper.state.s - coarse.s))))
        return size / (2.0**self.order - 1.0) / stepper.model.length

    def _factor(self, error: float) -> float:
        if error <= 0.0:
            return 4.0
        return float(np.clip(0.9 * (self.tolerance / error) ** (1.0 / (self.order + 1)), 0.2, 4.0))


def step_sizes(asked: StepControl, order: int, clock: Clock, t_end: float) -> StepSizes:
    """Make the step control of a run, with bounds where none are given: a millionth of the first step, a tenth of the run. Raises
    SceneError: the bounds are none, or doubles cannot tell apart times of smallest steps."""
    largest = 0.1 * (t_end - clock.origin) if asked.max_step is None else asked.max_step
    least = RESOLVED * float(np.spacing(max(abs(clock.origin), abs(t_end))))
    smallest = min(max(1e-6 * clock.step, least), largest) if asked.min_step is None else asked.min_step
    control = StepSizes(asked.tolerance, order, smallest, largest)
    check_times(clock.now, t_end, smallest, "min_step")
    return control
