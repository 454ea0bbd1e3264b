"""Time integration of a model, with the rows of its result."""
from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from os import PathLike
from typing import Any, NamedTuple

import numpy as np

from fastbeam.dynamics.blocks import Blocks
from fastbeam.dynamics.bounds import vanishing
from fastbeam.dynamics.callback import Callback
from fastbeam.dynamics.checkpoint import SLIVER, Checkpoint, Clock, check_target, check_times, start_clock
from fastbeam.dynamics.contact_force import AT_END, AT_ROWS, ContactForces
from fastbeam.dynamics.control import StepSizes, composition, failure, step_sizes
from fastbeam.dynamics.events import CONDITION, Encounters, Plan
from fastbeam.dynamics.extrapolation import check_two_runs, extrapolates, of_two_runs
from fastbeam.dynamics.filtering import FilteringStepper, check_filtered
from fastbeam.dynamics.impacts import Impacts
from fastbeam.dynamics.interrupt import Calls, Interrupts
from fastbeam.dynamics.kinks import Kinks
from fastbeam.dynamics.locks import Locking
from fastbeam.dynamics.reactions import ReactingStepper
from fastbeam.dynamics.options import BEGIN, OLD, STEP, TIME, Group, Method, Output, Solver, Start, StepControl, groups
from fastbeam.dynamics.recording import Rows
from fastbeam.dynamics.sampling import Sampling
from fastbeam.dynamics.step_means import forces_of, measuring
from fastbeam.dynamics.warnings import Watch
from fastbeam.interface.arguments import Anything, Count, FilePath, Flag, Function, Number, Word, checked
from fastbeam.interface.deprecation import regrouped
from fastbeam.interface.errors import ConvergenceError, Interrupted, ResultFileError, SceneError, carry
from fastbeam.interface.result_warnings import warns
from fastbeam.kernels.loop import OK, SLIDER_END
from fastbeam.kernels.state import State
from fastbeam.model.model import Model, check_model
from fastbeam.model.start import check_start, moved_supports, with_velocities_of_scene
from fastbeam.results.observe.observer import OBSERVED, POINTS, Observer, books_of_start, conserved
from fastbeam.results.observe.points import PointSeries
from fastbeam.results.progress import Progress
from fastbeam.results.result import Result
from fastbeam.scene.checks import Place
from fastbeam.stepping.methods import Scheme, choose_scheme
from fastbeam.stepping.outcome import Outcome
from fastbeam.stepping.stepper import Stepper

Array = np.ndarray
AFTER_BLOWS = (". Before this, sliders passed kinks of their contact curves, which acts as an impact whatever the step (see "
               "events 'unresolved' for places and forces). The waves from it continue: weld the beams there, let them bend, or "
               "give their sections damping=")


@regrouped("0.2", OLD)
@warns
@checked(model=Anything(), t_end=TIME, step=STEP, order=Count(), method=Group(Method, Word()),
         tolerance=Group(StepControl, Number(above=0.0)), start=Group(Start, BEGIN), observe=OBSERVED, points=POINTS,
         every=Count(), callback=Function("(t, state)"), output=Group(Output, FilePath()), solver=Group(Solver, Word()),
         progress=Flag())
def simulate(model: Model, *, t_end: float, step: float, order: int = 2, method: str | Method = "energy_momentum",
             tolerance: float | StepControl | None = None, start: State | Checkpoint | Start | None = None,
             observe: Sequence[str] = ("energy", "momentum", "slider", "joint"), points: Mapping[str, Place] | None = None,
             every: int | None = None, callback: Callable[[float, State], bool | None] | None = None,
             output: str | PathLike[str] | Output | None = None, solver: str | Solver = "auto",
             progress: bool | None = None) -> Result:
    """Integrate a model in time, with the conserving step (theory.md 4 to 6) or a method to compare it with (theory.md 7).

    With the conserving step energy, linear and angular momentum of an isolated system and the gap of its sliders stay at
    round-off for every step size that converges.

    Parameters
    ----------
    model : Model
        From `compile_scene`.
    t_end, step : float
        End time and step size, s. With `tolerance`, `step` is the first step. The last step ends at t_end: it is shorter than the
        others, or up to a hundredth longer instead of leaving less than that, and none behind an impact just before t_end.
    order : {2, 4}
        4 composes five substeps, one of them backwards: for smooth scenes; an event `order` tells of kinks on the way. With
        damping, drag, dampers and user forces, and with 'reaction' observed, it extrapolates two runs, of `step` and half of it,
        at three times the cost of order 2 (theory.md 6).
    method : str or Method
        'energy_momentum', or a method to compare it with: 'midpoint', 'trapezoidal', 'generalized_alpha'.
        ``Method(rho_inf=0.8)`` dissipates high frequencies.
    tolerance : float or StepControl
        Step control: local error of a position per step, relative to the size of the scene.
        ``StepControl(1e-6, max_step=0.1)`` bounds the step size.
    start : State, Checkpoint or Start
        Go on from a state (`result.state`), at t = 0 unless ``Start(state, time=...)`` says otherwise; default: the initial
        state of the model. From a checkpoint (`result.checkpoint`, `load_checkpoint`) the run goes on bit for bit; it knows its
        time. A state that joints, supports or sliders do not allow is refused, or mended by ``Start(state, mend=True)``; a
        support holds its node where the state has it.
    observe : sequence of {'energy', 'momentum', 'slider', 'joint', 'spring', 'inner', 'velocity', 'spin', 'orientation',
            'acceleration', 'section', 'reaction'}
        What is recorded: 'velocity' (snapshots keep velocities and spins of all nodes, too), 'spin', 'orientation',
        'acceleration' and 'section' of points, 'reaction' of supports and joints (an assembly a step, order 2); with both
        'section' and 'reaction' forces of sections from balance, too.
    points : mapping
        name -> node (`beam.end`), body, body point, mass, or (beam, s): positions to record.
    every : int
        Steps between rows; default: about 500 rows in all. With step control every accepted step is a row.
    callback : callable
        Called with (t, state) at every row but the first; returning True ends the run there. The state is a copy in space, not to
        be written to. Where it changes what a load's time function returns, an event says so, and step control refuses it.
    output : path or Output
        HDF5 file to which the result is written as the run goes; ``Output(file=..., checkpoint=..., snapshots=200)`` also has
        checkpoints and the number of whole shapes.
    solver : {'auto', 'pardiso', 'superlu'} or Solver
        Sparse solver, where the scene needs one; ``Solver(threads=1, max_iterations=50)`` has more.
    progress : bool
        Progress bar; default: on anything longer than a second.

    Returns
    -------
    Result
        With the final state in `.state`, and in `.checkpoint` to go on from. A slider that reaches the end of its beam ends the
        run there: see `.events`.

    Raises
    ------
    SceneError
        A scene that is not compiled, an argument out of range; a time function or the law of a controller that fails on the way.
    ConvergenceError
        A step failed, also where a law of the user's own does; the error carries the last good state and the result until then.
    Exception
        What a function of the user's own raises. On the way that, and a SceneError, has the result until then as `.result`, with
        `.state` and `.checkpoint` of the last good state; files are closed, the checkpoint renewed.
    ResultFileError
        A file cannot be written; when that happens on the way, the error carries the result until then.
    Interrupted
        By Ctrl-C: a KeyboardInterrupt that carries the result until then; files are closed, the checkpoint renewed.

    Examples
    --------
    >>> import fastbeam as fb
    >>> bar = fb.Section.circle(radius=0.01, E=1e8, rho=1000.0)
    >>> beam = fb.Beam.straight('beam', (0, 0, 0), (1, 0, 0), section=bar, elements=4)
    >>> model = fb.compile_scene(fb.Scene(beam, fb.RigidMotion(velocity=(1, 0, 0), spin=(0, 0, 2))))
    >>> result = fb.simulate(model, t_end=0.1, step=0.01)
    >>> bool(result.drift('total') < 1e-12)
    True
    """
    check_model("simulate", model)
    chosen, control, begin, kept, solving = groups(method, tolerance, start, output, solver)
    state, clock = start_clock(model, begin.state, begin.time, step, control is not None)
    first, said = begin.state, []
    if begin.velocities == "scene" and state is not None:
        if isinstance(first, Checkpoint):
            raise SceneError("velocities: a checkpoint keeps its own velocities; Start(checkpoint.state, velocities=\"scene\") "
                             "takes those of the scene")
        first, said = with_velocities_of_scene(model, state, clock.now)
        state = first
    check_times(clock.now, t_end, step)
    notes = list(model.notes) if first is None else []
    books: dict[str, Any] = {}
    if state is not None:
        # a checkpoint goes on as if it had never stopped
        goes_on = isinstance(first, Checkpoint)
        state, notes = check_start(model, state, step, begin.mend, t=clock.now, goes_on=goes_on)
        notes = [] if goes_on else notes
        notes += said
        books, notes = books_of_start(model, first, state, clock.now, notes)
    elif clock.now != 0.0:
        notes += moved_supports(model, model.state(), clock.now)
    if kept.checkpoint is not None:
        kept = replace(kept, checkpoint=check_target(kept.checkpoint, overwrite=True, probe=True))
    if order == 4 and chosen.name == "energy_momentum" and extrapolates(model, observe):
        check_two_runs(control, callback, kept.checkpoint)
        begin = Start(first if isinstance(first, State) else state, clock.now, begin.mend)
        return of_two_runs(simulate, model, begin, t_end, step, every, kept, {
            "method": chosen, "observe": observe, "points": points, "solver": solver, "progress": progress})
    weights = composition(order)
    scheme = choose_scheme(chosen.name, chosen.rho_inf, order, control is not None, model)
    n_steps = int(np.ceil((t_end - clock.origin) / step * (1.0 - 1e-12)))
    every = max(1, n_steps // 500) if every is None else every
    sizes = None if control is None else step_sizes(control, order, clock, t_end)
    memory = first.memory if isinstance(first, Checkpoint) else None
    make = _stepper_class(scheme, order, model, observe)
    rows_of_points = PointSeries(model, observe, points)
    if rows_of_points.measured:
        make = measuring(make, scheme, rows_of_points)
    stepper = make(model, weights, state, solving.max_iterations, solving.backend, scheme, clock.now, memory,
                   solving.augmentation, solving.threads)
    stepper.points = rows_of_points
    if isinstance(stepper, ReactingStepper):
        stepper.cut(rows_of_points.balanced)
    observer = Observer(model, observe, rows_of_points, stepper.lost if scheme.filters else None, stepper.strains,
                        stepper.plane)
    run = _Run(model, stepper, observer, clock, t_end, order, kept, callback, sizes, progress)
    run.notes = notes
    run.info |= books
    run.impacts = Impacts(model, first.impacts if isinstance(first, Checkpoint) else None)
    return run.go(every)


def _stepper_class(method: Scheme, order: int, model: Model, observe: Sequence[str]) -> Any:
    """Choose the class of the stepper of a run, before what its points ask for. Raises SceneError: a method that dissipates does
    not go with the order, the model or what is observed."""
    if method.filters:
        check_filtered(order, model, observe)
        return FilteringStepper
    return ReactingStepper if "reaction" in observe else Stepper


class _Taken(NamedTuple):
    """Steps of a run that were taken together."""

    outcome: Outcome
    size: float          # of each, s
    reached: float       # time behind them, s
    proposed: float      # size of the next with step control, s
    more: bool = False   # whether others follow before the next row


class _Run(Encounters):
    """One run, which drives the stepper and feeds rows to memory and file."""

    def __init__(self, model: Model, stepper: Stepper, observer: Observer, clock: Clock, t_end: float, order: int,
                 output: Output, callback: Any, control: StepSizes | None, progress: bool | None) -> None:
        self.model, self.stepper, self.observer, self.clock = model, stepper, observer, clock
        self.t_start, self.t_end, self.step, self.order = clock.now, t_end, clock.step, order
        self.callback = None if callback is None else Callback(model, callback, t_end)
        self.control = control
        self.checkpoint, self.checkpoint_every, self.last_checkpoint = (output.checkpoint, output.checkpoint_every,
                                                                          time.perf_counter())
        self.info: dict[str, Any] = {
            "scene": model.scene_name, "method": stepper.method.label, "order": order, "step": clock.step, "t_end": t_end,
            "conserved": conserved(model, observer.lost is not None), "unknowns": stepper.core.own_unknowns,
            "versions": dict(_versions())}
        at_end = stepper.method.at_end
        if observer.slider:
            self.info["contact_force"] = AT_END if at_end else AT_ROWS
        forces = ContactForces(stepper, control is not None, clock.began, t_end) if observer.needs_forces and not at_end else None
        header = observer.header(self.info, moving=True)
        self.rows = Rows(observer, stepper, clock, forces, t_end, header, output)
        self.memory, self.event = self.rows.memory, self.rows.event
        self.progress = Progress(t_end - clock.now, model.scene_name, progress)
        self.iterations = self.steps = 0
        # kind and text of what is to be said of the start
        self.notes: list[tuple[str, str]] = []
        self.interrupts = Interrupts()
        self.calls = Calls(stepper, self.interrupts)
        self.impacts = Impacts(model)
        self.sampling = Sampling(model, clock.step, control is not None, stepper.core_state)
        # whether the clock lags behind the state
        self.between = False
        self.locking = Locking(model)
        # step control finds smaller steps there by itself
        kinks = Kinks(model, clock.step) if order == 4 and control is None else None
        self.watch = Watch(model, stepper, self.event, clock.now, t_end, kinks)
        # nothing looks at single steps
        alone = control is None and callback is None and output.checkpoint is None and kinks is None and Blocks.suit(stepper)
        self.blocks = Blocks(stepper) if alone and forces is None and not at_end else None

    def keep_checkpoint(self, present: Checkpoint | None = None) -> None:
        """Renew the checkpoint file, at the end of a run or where its time has come."""
        due = present is not None or time.perf_counter() - self.last_checkpoint >= self.checkpoint_every
        if self.checkpoint is None or not due:
            return
        try:
            (present or self.present()).save(self.checkpoint, overwrite=True)
        except ResultFileError as failed:
            self.checkpoint, self.rows.file_error = None, self.rows.file_error or failed
        self.last_checkpoint = time.perf_counter()

    def present(self) -> Checkpoint:
        found = self.clock.checkpoint(self.model, self.stepper.copy_state(), self.control is not None, self.stepper.memory,
                                      self.impacts.times)
        known = found.mean_force
        return found if known is None else replace(found, mean_force=forces_of(self.stepper, known))

    def call_back(self, t: float, size: float) -> bool:
        """Call the user's function; whether the run ends here. What it sets lags behind."""
        known = self.callback.found
        stop = self.callback(t, size, self.stepper.copy_state())
        if self.callback.found != known:
            text = f"{self.callback.found}. Values set by a callback act one step late, so errors are of first order"
            if self.control is not None:
                raise ConvergenceError(f"{text}, which step control cannot see; use a fixed step, make it a function of time "
                                       "alone, or use a Controller or a user-defined law, which are evaluated inside the "
                                       "step", step=self.steps, time=t, state=self.stepper.copy_state())
            self.event({"kind": "lagging load", "time": t, "text": f"{text}: halve the step to see how large they are"})
        return stop

    # --- the run ------------------------------------------------------------------------------------------------------
    def go(self, every: int) -> Result:
        with self.interrupts:
            return self.run(every)

    def run(self, every: int) -> Result:
        begin = time.perf_counter()
        clock = self.clock
        if clock.before is None and self.stepper.method.at_end:
            clock.before = self.stepper.state.force.copy()
        error: BaseException | None = None
        begun = False
        try:
            if self.happen(clock.now):
                clock.before = clock.before_size = None
            self.rows.first()
            begun = True
            self._tell_of_start()
            for t, outcome, size, row_due in self.chunks(every):
                self.took(t, outcome, size)
                self.between = False
                if row_due and self._record(t, outcome, size) or self.rows.file_error is not None:
                    break
                self.interrupts.serve()
            self.rows.broken_off = False
        except ConvergenceError as failed:
            # it comes with the last good state
            error, self.between, self.rows.broken_off = failed, False, False
            self.event({"kind": "failed", "time": failed.time, "text": str(failed)})
        except KeyboardInterrupt as stopped:
            error, self.between = stopped, self.between and not self.calls.intact
            self.rows.broken_off = self.between or self.calls.slow
            self.event({"kind": "interrupted", "time": clock.now, "text": f"the run was interrupted at t = {clock.now:.6g} s"})
        except Exception as failed:
            # of a function of the user's own
            if not begun:
                raise
            error, self.between = failed, self.between and not self.calls.intact
            self.rows.broken_off = self.between
            self.event({"kind": "failed", "time": clock.now, "text": f"{type(failed).__name__}: {failed}"})
        finally:
            self._close(begin)
        return self._result(error)

    def _tell_of_start(self) -> None:
        """Put what is to be said of the start and of the model into the events."""
        for kind, text in self.notes:
            self.event({"kind": kind, "time": self.t_start, "text": text})
        self.watch.massless()
        self.watch.tables()
        self.watch.order(self.clock.now)

    def _record(self, t: float, outcome: Outcome, size: float) -> bool:
        """Record a row, renew the checkpoint; whether the callback ends the run."""
        self.rows.open(t, outcome.iterations // max(outcome.steps, 1), size)
        if outcome.status == OK:
            self.watch.turns(t, size)
            self.watch.friction(t, size)
            self.watch.order(t)
        self.watch.mesh(t, self.steps, size)
        if self.callback is not None:
            with self.interrupts.at_once():
                ended = self.call_back(t, size)
            if ended:
                self.event({"kind": "stopped", "time": t, "text": "the callback ended the run"})
                return True
        self.keep_checkpoint()
        return False

    def _close(self, begin: float) -> None:
        """Close rows and files, and sum up a run that began at this reading of `time.perf_counter`, s."""
        self.rows.close_last()
        self.progress.close()
        self.info |= {"solver": self.stepper.linear.name, "steps": self.steps, "iterations": self.iterations,
                      "fallbacks": self.stepper.linear.fallbacks,
                      "scale": self.observer.scales(self.step) | {"gap": self.model.length},
                      "wall_time": time.perf_counter() - begin}
        if self.control is not None:
            self.info |= {"tolerance": self.control.tolerance, "accepted": self.control.accepted,
                          "rejected": self.control.rejected}
        if not self.between:
            self.watch.mesh(self.clock.now, self.steps, last=True)
        self.watch.drift(self.clock.now, self.memory.close(self.info), self.info["conserved"])
        self.rows.end(self.info)

    def _result(self, error: BaseException | None) -> Result:
        """Return the result with its checkpoint, or raise what broke the run off, with the result until then. Raises
        ConvergenceError or ResultFileError or Interrupted or Exception: as `simulate`."""
        clock = self.clock
        # the clock knows no time for a state that a second Ctrl-C left somewhere in a step
        present = None if self.between else self.present()
        if present is not None:
            self.keep_checkpoint(present)
        if self.rows.file_error is not None:
            self.memory.event({"kind": "file", "time": clock.now, "text": str(self.rows.file_error)})
        result = self.memory.close(self.info)
        if present is not None:
            result.checkpoint, result.state, result._moving = present, present.state, self.model.moving
        final = error or self.rows.file_error
        if isinstance(final, ConvergenceError) and any("blow" in event for event in result.events):
            final.args = (f"{final}{AFTER_BLOWS}",)
        if isinstance(error, KeyboardInterrupt) or self.interrupts.asked:
            self.interrupts.asked = False
            advice = "" if present is None else ", .checkpoint goes on from there"
            raise Interrupted(f"the run was interrupted at t = {clock.now:.6g} s; everything until then is in .result{advice}",
                              result=result, state=present and present.state, checkpoint=present) from final
        if isinstance(final, ConvergenceError | ResultFileError):
            final.result = result
        elif final is not None:
            carry(final, lambda: result)
        if final is not None:
            raise final
        return result

    def took(self, t: float, outcome: Outcome, size: float) -> None:
        """Count steps of this size that led to time t; they tell the forces of the row that waits."""
        if outcome.steps:
            self.iterations += outcome.iterations
            self.steps += outcome.steps
            self.rows.close(t, size, outcome.force[0], outcome.steps)
            self.clock.before, self.clock.before_size = outcome.force[1], size
            if self.rows.forces is not None:
                self.rows.forces.remember(size, outcome.force[1], outcome.steps == 1 or self.control is not None)

    def block(self, every: int, count: int) -> int:
        """Take so many rows of steps at once; return how many steps were taken."""
        assert self.blocks is not None
        clock, size = self.clock, self.step
        self.between, self.calls.intact = True, False
        block, begin = self.blocks.take(clock, every, count), clock.now
        if block is None:
            # step by step from here on
            self.blocks, self.between = None, False
            return 0
        clock.count(every * count)
        clock.before, clock.before_size, self.between = np.zeros(0), size, False
        self.rows.block(block, every, size)
        while (k := self.watch.next_look(block.t, self.steps, every)) < count:
            self.watch.mesh(float(block.t[k]), self.steps + every * (k + 1), size, states=partial(block.states, [k]))
        self.steps += every * count
        self.iterations += int(block.iterations.sum())
        self.progress.update(clock.now - begin)
        if self.rows.file_error is not None:
            self.blocks = None
        self.interrupts.serve()
        return every * count

    def chunks(self, every: int) -> Any:
        """Runs of steps that end where a row is due: (time, outcome, step size, row due)."""
        clock = self.clock
        t, h = clock.now, clock.size
        quiet = not self.observer.series().keys() - {"iterations", "step_size"}
        quiet = quiet and self.rows.writer is None and self.callback is None and self.checkpoint is None
        plan = self.plan()
        # steps since the last row, which controllers do not end
        since = 0
        while t < self.t_end:
            while self.blocks is not None and not quiet and (rows := self.blocks.count(every, plan.left, self.calls.burst)) > 1:
                plan.left -= self.block(every, rows)
                t = clock.now
            begin = time.perf_counter()
            self.sampling.ask(t, self.stepper)
            self.between = True
            whole = plan.left > 0
            outcome, size, reached, h, more = self._take(t, h, plan, every, since)
            if outcome.status == OK and not outcome.steps:
                # left before the first step was done
                self.between, h = False, clock.size
                self.interrupts.serve()
                continue
            if not whole:
                reached = reached if outcome.status == OK else t
                clock.leave_grid(reached)
            failed = outcome.status not in (OK, SLIDER_END, CONDITION)
            vanishes = failed and vanishing(self.model, self.stepper.state, size).size > 0
            if outcome.status in (SLIDER_END, CONDITION) or vanishes:
                self.progress.update(reached - t)
                clock.size = h
                ends = self.to_condition if outcome.status == CONDITION else self.end_of_beam
                goes_on = yield from ends(reached, outcome, size)
                if not goes_on:
                    return
                t = clock.now
                plan = self.plan()
                continue
            if outcome.status != OK:
                failed = failure(self.stepper, outcome, reached, self.steps + outcome.steps, size)
                if outcome.steps:
                    # the last good state is a row
                    yield reached, outcome, size, True
                raise failed
            self.progress.update(reached - t)
            t = clock.now = reached
            clock.size, self.impacts.in_a_row = h, 0
            if self.locking.lifting or t >= plan.end and self.locking.next_time(self.stepper.state) <= t:
                # the row of this time is behind what happens now
                self.took(t, outcome, size)
                outcome = replace(outcome, steps=0, iterations=outcome.iterations // max(outcome.steps, 1))
                self.happen(t)
                self.count_from(t)
                plan = self.plan()
            since += outcome.steps
            due = not (self.sampling.controllers or more) or since >= every or t >= self.t_end
            since = 0 if due else since
            yield t, outcome, size, due
            if quiet and self.control is None and time.perf_counter() - begin < 0.1:
                every *= 2

    def _take(self, t: float, h: float, plan: Plan, every: int, since: int) -> _Taken:
        """Take the next steps from time t: one of the size that step control chooses, whole ones, or a last one that differs.

        h: size that step control has proposed, s.
        every, since: steps between rows, and since the last one.
        """
        if self.control is not None:
            return self._controlled_step(t, h, plan.end)
        if plan.left:
            return self._whole_steps(t, h, plan, every, since)
        return _Taken(self.advance(t, plan.last, 1), plan.last, plan.end, h)

    def _controlled_step(self, t: float, h: float, end: float) -> _Taken:
        """Take a step of the size that step control chooses; the last one meets the end."""
        assert self.control is not None
        planned = min(max(h, self.control.smallest), self.control.largest)
        remaining = end - t
        # neither a sliver at the end nor a step beyond the largest
        sliver = planned < remaining < (1.0 + SLIVER) * planned
        cut = 0.5 * remaining if sliver and remaining > self.control.largest else remaining if sliver else min(planned, remaining)
        size, h, outcome = self.controlled(t, cut)
        # a step that was cut to meet the end says nothing about the next
        h = max(h, planned) if size == remaining or size == cut != planned else h
        return _Taken(outcome, size, end if size == remaining else t + size, h)

    def _whole_steps(self, t: float, h: float, plan: Plan, every: int, since: int) -> _Taken:
        """Take whole steps up to a row, to where a controller is asked, or to the end; as `_take`."""
        clock, most = self.clock, every
        if self.sampling.controllers:
            most = min(every - since, self.sampling.steps(t, self.step, self.stepper.core_state))
        # the last three steps tell the last row, and are taken one by one
        singly = self.rows.looks_back and plan.left <= most
        tail = 2 if plan.last else 3
        count = min(most, plan.left) if not singly else max(1, plan.left - tail)
        outcome = self.advance(clock.origin, self.step, count, clock.done)
        plan.left -= outcome.steps
        reached = clock.count(outcome.steps)
        if outcome.status == OK and not plan.left and not plan.last:
            reached = plan.end
        return _Taken(outcome, self.step, reached, h, singly and plan.left > 0)


@cache
def _versions() -> dict[str, str]:
    from importlib.metadata import PackageNotFoundError, version
    out = {"python": sys.version.split()[0]}
    for name in ("fastbeam", "numpy", "numba"):
        try:
            out[name] = version(name)
        except PackageNotFoundError:
            out[name] = "not installed"
    return out
