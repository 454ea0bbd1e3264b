"""Dynamic relaxation: conserving steps whose velocities are set to zero at peaks of the kinetic energy, then Newton's method
(theory.md 15)."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fastbeam.dynamics.control import failure
from fastbeam.dynamics.interrupt import Interrupts
from fastbeam.dynamics.options import MENDED, Group, Start, shape_of_start, START
from fastbeam.interface.arguments import Anything, Count, Flag, Number, Word, checked
from fastbeam.interface.deprecation import regrouped
from fastbeam.interface.errors import ConvergenceError, SceneError
from fastbeam.interface.result_warnings import warns
from fastbeam.kernels.loop import OK, SLIDER_END, external_forces
from fastbeam.kernels.state import State
from fastbeam.linalg.linear_system import check_backend
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.contact.moving_meshes import Moving
from fastbeam.model.forces.loads import load_factors_at
from fastbeam.model.model import Model, check_model
from fastbeam.model.moving_supports import PrescribedMotions
from fastbeam.model.supports import check_supports
from fastbeam.results.observe.observer import OBSERVED, POINTS, Observer
from fastbeam.results.progress import Progress
from fastbeam.results.result import Result
from fastbeam.scene.checks import Place
from fastbeam.statics.equilibrium import StaticSolver
from fastbeam.statics.linear_response import place_events
from fastbeam.statics.load_steps import stability
from fastbeam.statics.moving_supports import SupportPath
from fastbeam.statics.rows import StaticRows
from fastbeam.statics.sliding import SlidingSolver
from fastbeam.stepping.outcome import Outcome
from fastbeam.stepping.stepper import Stepper

Array = np.ndarray
# steps from rest to the peak of the kinetic energy that are wanted; fewer: steps are halved, more: they grow
FEW, MANY = 4, 16
GROWTH = 1.5
# a step that moves a node further, in sizes of the scene, is halved
LONGEST = 0.1
# first step: share of the time in which the scene falls by its size
FIRST = 0.02
SMALLEST = 1e-9
# swings after which Newton's method is tried for the first time; tries come at ever longer distances
FIRST_TRY, LATER = 2, 1.5
# an equilibrium may lie higher than the energy reached by this share of the energy lost in the motion
HIGHER = 1e-9
# supports that move go so far in a step, in sizes of the scene and rad, and by such a share of their way
LARGEST_TRAVEL, LARGEST_SHARE = 0.01, 0.05
# motion in a swing, in sizes of the scene, with which a scene counts as at rest where Newton's method is not asked
STILL = 1e-7
# and with which it is near to an equilibrium whose stability is not known otherwise: the motion goes there by itself
NEAR = 1e-4


@regrouped("0.2", MENDED)
@warns
@checked(model=Anything(), start=Group(Start, START), step=Number(above=0.0, unit="s"), most_steps=Count(most=10**7),
         at_time=Number(unit="s"), observe=OBSERVED, points=POINTS, finish=Flag(), max_iterations=Count(most=10_000),
         backend=Word())
def relax(model: Model, *, start: State | Start | None = None, step: float | None = None, most_steps: int = 20_000,
          at_time: float | None = None, observe: Sequence[str] = ("energy",), points: Mapping[str, Place] | None = None,
          finish: bool = True, max_iterations: int = 25, backend: str = "auto") -> Result:
    """Find an equilibrium by dynamic relaxation where Newton's method does not reach it from the start: mechanisms, slack cables
    and nets, sliders far from their place.

    The scene moves from rest, by conserving steps under all of its loads. At every peak of its kinetic energy the velocities are
    set to zero (kinetic damping), so that the potential energy falls from swing to swing, into a valley. After some swings
    Newton's method finishes; it is tried again until it finds an equilibrium that lies no higher and is not unstable. Steps
    adapt to the swings; masses influence the path, not the equilibrium.

    Parameters
    ----------
    model : Model
        Every part has to be held at one point at least, about which it may turn. With `at_time` supports that
        move go to their place at that time first, along their functions; without a time they stand still.
    start : State or Start
        Begin from this shape instead of the reference; its velocities do not count. ``Start(state, mend=True)`` mends it as in
        `simulate`.
    step : float
        First step, s; default: a share of the time in which the scene falls by its size.
    most_steps : int
        Steps after which a scene that does not come to rest is given up.
    at_time : float
        Where time functions of loads are evaluated, s; needed when the scene has some.
    observe, points
        As in `solve_static`, without 'reaction'; rows are the peaks of the kinetic energy, `result.t` the time of the motion, s.
    finish : bool
        False: without Newton's method, until a swing moves no node by more than 1e-7 of the size of the scene.
    max_iterations : int
        Newton iterations of a step, and of the finish.
    backend : {'auto', 'pardiso', 'superlu'}

    Returns
    -------
    Result
        With the equilibrium in `.state`. `info["finished"]`: whether Newton's method finished, `info["residual"]` its last
        increment, in sizes of the scene and rad (else the motion of the last swing); `info["energy_loss"]` the energy lost, J;
        `info["swings"]`, `info["steps"]`; `info["unstable_directions"]` and `info["free_directions"]` as in `solve_static`.

    Raises
    ------
    SceneError
        A scene that is not compiled or not held, an argument out of range, sliders with Coulomb friction, prescribed motions,
        rigid stops or locks, drives in joints.
    ConvergenceError
        It does not come to rest, a step fails, a slider runs off its beam; carries the last shape and the result until then.
    Interrupted
        By Ctrl-C; carries the same.
    """
    check_model("relax", model)
    require(Analysis.RELAX, model)
    if at_time is None:
        require(Analysis.TIMELESS_SHAPES, model, "relax")
    check_backend(backend)
    if "reaction" in observe:
        raise SceneError("relax: rows have no reactions; take them from solve_static(model, start=result.state, load_step=1.0, "
                         "observe=('reaction',))")
    factors = load_factors_at("relax", model, at_time)
    state, notes = (None, []) if start is None else shape_of_start("relax", model, start)
    way = _way(model, state, at_time)
    at_rest = _at_rest(model, factors, way)
    run = _Relaxation(model, at_rest, state, factors, at_time or 0.0, max_iterations, backend, observe, points, way)
    run.held_in_space = check_supports(model, run.stepper.plane is not None, may_turn=True)
    for kind, text in notes:
        run.event(kind, 0.0, text)
    with run.guarded(run.result, lambda: run.t, lambda: f"relax, step {run.steps}", "shape") as run.interrupts:
        return run.go(step, most_steps, finish)


def _way(model: Model, start: State | None, at_time: float | None) -> _SupportProgress | None:
    """Return the path of supports that move; None where they stand at their places at the time of the loads. Raises SceneError: a
    support of the start stands neither at its place at that time nor at its place at t = 0."""
    if model.prescribed is None or at_time is None:
        return None
    begin = model.state() if start is None else start
    path = SupportPath(model, begin, True, (0.0, at_time), "relax")
    now = begin.q.reshape(-1, 4, 3)[path.own]
    if path.stands(1.0, now) and (start is not None or at_time == 0.0):
        return None
    path.check_stands("relax", 0.0, now)
    return _SupportProgress(model.prescribed, at_time, model.length)


def _at_rest(model: Model, factors: Array, way: _SupportProgress | None) -> Model:
    """Return the model with loads that are constant and supports that go their way, or stand still."""
    def constant(one: Model) -> Model:
        loads = one.loads
        if factors.size:
            value = loads.value.reshape(-1, 8) * factors[loads.vector][:, None]
            loads = loads._replace(first=loads.first * factors[0], value=value.reshape(-1))
        features = tuple(_Still(x, way) if isinstance(x, PrescribedMotions) else
                         x.in_constant_gravity(one.load_times, factors) if isinstance(x, Moving) else x for x in one.features)
        return replace(one.with_loading(loads=loads, load_times=[None] * len(factors)), features=features)

    plane, uneliminated, uncondensed = model.plane, model.uneliminated, model.uncondensed
    if plane is not None:
        plane = replace(plane, model=constant(plane.model))
    assert uneliminated is not None and uncondensed is not None
    return replace(constant(model), plane=plane, uneliminated=lambda **options: _at_rest(uneliminated(**options), factors, way),
                   uncondensed=lambda: _at_rest(uncondensed(), factors, way))


class _SupportProgress:
    """Progress of supports on their path from t = 0 to their places at one time, s; share, size: part of the path that is done,
    and that of the next step."""

    def __init__(self, of: PrescribedMotions, at_time: float, length: float) -> None:
        self.at_time, self.share = at_time, 0.0
        ends = [path.place(at_time) - path.place(0.0) for path in of.motions]
        turns = [path.turn(at_time) @ path.turn(0.0).T - np.eye(3) for path in of.motions]
        # matrices do not tell full turns
        turned = [float(np.max(np.abs(x), initial=0.0)) for x in (turns, of.vectors(at_time))]
        far = max(float(np.max(np.abs(ends))) / length, *turned)
        self.most = self.size = min(LARGEST_TRAVEL / far, LARGEST_SHARE) if far > 0.0 else LARGEST_SHARE

    def times(self) -> Array:
        """Return times of the functions of supports, at both ends of the next step, s."""
        return self.at_time * np.array([self.share, min(self.share + self.size, 1.0)])

    def took(self) -> None:
        """Advance by the step that was taken."""
        self.share = 1.0 if self.share + self.size > 1.0 - 1e-9 else self.share + self.size
        self.size = min(GROWTH * self.size, self.most, 1.0 - self.share)

    @property
    def is_done(self) -> bool:
        return self.share == 1.0


class _Still(PrescribedMotions):
    """Supports that could move and go their way in the motion, or stand still."""

    def __init__(self, of: PrescribedMotions, way: _SupportProgress | None) -> None:
        vars(self).update(vars(of))
        self._of, self._way = of, way

    def schedule(self, times: Array, tables: Any, plane: Any = None) -> Array:
        """Return increments of a step, as `PrescribedMotions.schedule`."""
        if self._way is None or self._way.is_done:
            return np.zeros((len(times) - 1, len(self._of.motions), 6 if plane is None else 3))
        return self._of.schedule(self._way.times(), tables, plane)

    def vectors(self, t: float) -> Array:
        """Return rotation vectors [3 K] of supports where they are on their way, less those at t = 0; zeros where they stand
        still."""
        return np.zeros(self._of.history_size) if self._way is None else self._of.vectors(self._way.at_time * self._way.share)


class _Relaxation(StaticRows):
    """Damped motion from the start to rest."""

    def __init__(self, model: Model, at_rest: Model, start: State | None, factors: Array, t: float, max_iterations: int,
                 backend: str, observe: Sequence[str], points: Mapping[str, Place] | None, way: _SupportProgress | None) -> None:
        self.model, self.factors, self.at_time, self.max_iterations, self.backend = model, factors, t, max_iterations, backend
        own = None
        if start is not None:
            own = State(start.q, 0.0 * start.v, start.s, start.force, start.history)
        self.stepper = Stepper(at_rest, np.ones(1), own, max_iterations, backend)
        self.stepper.core.stop(self.stepper.core_state)
        super().__init__(model, "relax", ("energy", *observe), points, None, {"finished": False, "residual": np.inf})
        self.interrupts = Interrupts()
        self.meter = Observer(at_rest, ("energy",), None)
        self.t = self.lost = 0.0
        self.steps = self.swings = self.iterations = 0
        self.held_in_space = True
        self.way = way
        # why the last equilibrium of Newton's method does not count
        self.refused = ""
        self.solver: StaticSolver | None = None

    # --- states -------------------------------------------------------------------------------------------------------
    def state(self) -> State:
        """Return the present shape at rest, as a state of the model."""
        now, history = self.stepper.state, self.model.state().history
        found = State(now.q.copy(), np.zeros_like(now.v), now.s.copy(), now.force.copy(), history)
        self.model.keep_turns(history, now.history)
        self.model.stop(found)
        if self.model.motions is not None:
            self.model.motions.settle(found, found, self.model.place("motions"), None)
        return found

    def record(self, iterations: int, size: float) -> None:
        state = self.state()
        row = self.row(self.at_time, state, iterations, size, self.factors)
        self.keep(self.t, row, state, f"the shape at t = {self.t:.6g} s")

    def result(self) -> Result:
        return self.closed(self.state(), solver=self.stepper.linear.name, steps=self.steps, iterations=self.iterations,
                           swings=self.swings, energy_loss=self.lost)

    def energies(self, state: State | None = None) -> tuple[float, float, float]:
        """Return kinetic, strain and potential energy, J: the last one of forces, moments have none."""
        model = self.stepper.model
        state = self.stepper.state if state is None else state
        row = self.meter.row(self.at_time, state)
        loads = np.zeros(8 * (model.n_nodes + 1))
        external_forces(model.loads, np.ones(len(model.load_times)), loads)
        forces = loads.reshape(-1, 8)[model.pattern.row_of, :3]
        first = np.unique(model.pattern.row_of, return_index=True)[1]
        strain = float(row["strain"])
        return float(row["kinetic"]), strain, strain - float(np.sum((forces * state.q.reshape(-1, 4, 3)[:, 0])[first]))

    # --- the motion ---------------------------------------------------------------------------------------------------
    def go(self, step: float | None, most_steps: int, finish: bool) -> Result:
        """Move until the scene rests. Raises ConvergenceError."""
        bar = Progress(1.0, f"{self.model.scene_name}: relax")
        h = self._first_step() if step is None else step
        smallest = SMALLEST * h
        self.record(0, 0.0)
        next_try = FIRST_TRY
        before, since, moved = 0.0, 0, self.stepper.state.q.copy()
        try:
            while self.steps < most_steps:
                self.interrupts.serve()
                outcome, h = self._step(h, smallest)
                if outcome is None:
                    continue
                since += 1
                kinetic = self.energies()[0]
                if kinetic > before:
                    before = kinetic
                    if since >= MANY:
                        h *= GROWTH
                        since = FEW
                    continue
                # past the peak: at rest from here
                self.lost += kinetic
                self.swings += 1
                way = self._way(moved)
                self._stop()
                self.record(outcome.iterations, h)
                moved = self.stepper.state.q.copy()
                if since < FEW:
                    h *= 0.5
                before, since = 0.0, 0
                self.info["residual"] = way
                bar.update(0.0)
                if self.way is not None and not self.way.is_done:
                    continue
                if finish and (self.swings >= next_try or way <= STILL):
                    next_try = int(np.ceil(LATER * self.swings))
                    if self._finished():
                        return self._last()
                    if way <= STILL:
                        raise self._stuck()
                if not finish and way <= STILL:
                    return self._last()
            raise self._restless(most_steps)
        finally:
            bar.close()

    def _step(self, h: float, smallest: float) -> tuple[Outcome | None, float]:
        """Take a step of size h, s; where it fails or goes too far none, and return a size to try. Raises ConvergenceError: the
        size is the smallest, or a slider has run off its beam."""
        saved = self.stepper.save()
        # laws of forces see the time in the middle of a step
        outcome = self.stepper.advance(self.at_time - 0.5 * h, h, 1)
        if outcome.status == SLIDER_END:
            raise self._ran_off(outcome.slider)
        far = self._way(saved[0].q) > LONGEST if outcome.status == OK else True
        if far and h > smallest:
            self.stepper.load(saved)
            if self.way is not None:
                self.way.size *= 0.5
            return None, h * (0.5 if outcome.status == OK else 0.25)
        if outcome.status != OK:
            error = failure(self.stepper, outcome, self.t, self.steps, h)
            raise self._error(str(error).replace("step ", "relax: step ", 1), residuals=error.residuals,
                              worst=error.worst) from error.__cause__
        self.steps += 1
        if self.way is not None and not self.way.is_done:
            self.way.took()
        self.t += h
        self.iterations += outcome.iterations
        return outcome, h

    def _first_step(self) -> float:
        """Return a share of the time in which the loads, or the stresses of the start, move the scene by its size."""
        model = self.stepper.model
        mass = float(model.gravity_weight.sum())
        push = float(np.sum(np.linalg.norm(model.loads.entries[:, :3], axis=1)))
        push = max(push, self.energies()[1] / model.length)
        if not push > 0.0 or not mass > 0.0:
            return FIRST * model.length if mass > 0.0 else 1.0
        return FIRST * float(np.sqrt(model.length * mass / push))

    def _way(self, before: Array) -> float:
        """Return the largest displacement of a node from the coordinates `before`, in sizes of the scene."""
        change = (self.stepper.state.q - before).reshape(-1, 4, 3)[:, 0]
        return float(np.max(np.linalg.norm(change, axis=1))) / self.model.length

    def _stop(self) -> None:
        """Take the velocities away."""
        state = self.stepper.copy_state()
        self.model.stop(state)
        self.stepper.set_state(state)

    # --- the end ------------------------------------------------------------------------------------------------------
    def _finished(self) -> bool:
        """Apply Newton's method from here; return whether it finds an equilibrium that lies no higher and is not unstable, which
        becomes the state then."""
        state = self.state()
        at_rest = self.stepper.model
        reached = self.energies()[2]
        if self.model.n_constraints:
            solver: StaticSolver = SlidingSolver(at_rest, state, self.max_iterations,
                                                 np.zeros(self.model.n_sliders, bool), backend=self.backend, at_time=self.at_time)
        else:
            solver = StaticSolver(at_rest, state, self.max_iterations, self.backend)
        solver.interrupts = self.interrupts
        solver.set_time(self.at_time, 1.0)
        solver.move_to(1.0)
        # loads of the model in hand have their factors in them
        ones = np.ones(len(at_rest.load_times))
        status, sizes = solver.equilibrium(ones)
        self.refused = "Newton's method does not converge from there"
        if status != OK:
            return False
        flat = solver.stepper.plane is not None
        # the motion can leave what is unstable where it moves, and nothing else
        leaves = solver.signs(ones, flat)
        if leaves is not None and leaves[0]:
            self.refused = (f"the equilibrium there has {leaves[0]} unstable direction(s), which the motion does not excite, "
                            "because the scene is symmetric: disturb it by a small load, or begin elsewhere")
            return False
        if leaves is None and self.info["residual"] > NEAR:
            self.refused = "moments make it impossible to decide whether the equilibrium there is stable"
            return False
        # what pushes along beams, moments and moving air do work of their own
        closed = not solver.moments and self.model.slider_forces is None and not self.model.blows
        if closed and self.energies(solver.state)[2] > reached + HIGHER * (self.lost + abs(reached)):
            self.refused = "the equilibrium that Newton's method finds from there has a higher energy"
            return False
        if isinstance(solver, SlidingSolver):
            for event in place_events(solver, self.model):
                self.buffer.event({**event, "time": self.t})
        told, texts = stability(solver, self.model, ones, self.held_in_space)
        found = solver.state
        history = self.stepper.state.history.copy()
        self.stepper.set_state(State(found.q.copy(), np.zeros_like(found.v), found.s.copy(), found.force.copy(), history))
        self.info |= {"finished": True, "residual": sizes[-1]} | told
        for kind, text in texts:
            self.event(kind, self.t, text)
        self.iterations += len(sizes)
        self.record(len(sizes), 0.0)
        return True

    def _last(self) -> Result:
        self.look_at_mesh(self.t, self.state())
        return self.result()

    def _error(self, text: str, **more: Any) -> ConvergenceError:
        """Form an error with the last shape and everything until then."""
        return ConvergenceError(text, step=self.steps, time=self.t, state=self.state(), result=self.result(), **more)

    def _stuck(self) -> ConvergenceError:
        """Form the error of a motion that has come to rest where Newton's method does not finish."""
        return self._error(
            f"relax: scene {self.model.scene_name!r} came to rest in {self.swings} swings, and the last one moved it by "
            f"{self.info['residual']:.2g} of its size, but {self.refused}. With finish=False this shape is the result; it is in "
            ".state, everything until then in .result")

    def _restless(self, most_steps: int) -> ConvergenceError:
        """Form the error of a scene that does not come to rest."""
        last = f"the last swing moved it by {self.info['residual']:.2g} of its size" if self.swings else "it is still falling"
        text = (f"relax: scene {self.model.scene_name!r} did not come to rest in {most_steps} steps, {self.swings} swings; "
                f"{last}. Increase most_steps, or use damping (damping= of sections, Drag(linear=)) and a run in time. Check "
                "also that an equilibrium exists: a mechanism that a moment or a law turns for ever has none. The last shape is "
                "in .state, everything until then in .result")
        self.event("stopped", self.t, text)
        return self._error(text)

    def _ran_off(self, slider: int) -> ConvergenceError:
        name = self.model.names["sliders"][slider]
        return self._error(f"relax: slider {name!r} leaves its beam during relaxation, after {self.steps} steps; let the scene "
                           "begin with it elsewhere, or lock it in solve_static(model, held=...). The last shape is in .state, "
                           "everything until then in .result")
