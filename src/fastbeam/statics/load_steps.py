"""Load steps of equilibria, which adapt to the convergence of Newton's method (theory.md 8), for `solve_static`."""
from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fastbeam.dynamics.control import failure
from fastbeam.interface.errors import ConvergenceError, SceneError
from fastbeam.kernels.loop import NOT_CONVERGED, OK, SLIDER_END
from fastbeam.kernels.state import State
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.forces.spring_laws import SpringRows
from fastbeam.model.model import Model
from fastbeam.model.supports import check_supports
from fastbeam.results.observe.resolution import Resolution
from fastbeam.results.progress import Progress
from fastbeam.results.result import Result
from fastbeam.scene.checks import Place
from fastbeam.statics.equilibrium import StaticSolver
from fastbeam.statics.exact_contact import ExactSolver, Observed
from fastbeam.statics.linear_response import place_events
from fastbeam.statics.load_laws import user_forces
from fastbeam.statics.moving_supports import SupportPath
from fastbeam.statics.rows import StaticRows
from fastbeam.statics.sliding import SlidingSolver
from fastbeam.statics.steady_motion import Spin, SteadyForces, Travel
from fastbeam.stepping.outcome import Outcome

Array = np.ndarray
UNSTABLE = ("this equilibrium is unstable, its tangent has {} negative eigenvalue(s) {}: the load path passed a buckling or "
            "limit load. fb.modes(model, state=result.state) shows the unstable direction; a larger imperfection or a run in "
            "time finds a stable equilibrium")
FREE_MOTIONS = "{} motion(s) {} have no stiffness: {}; their amplitudes are arbitrary"
FREE = ("the tangent of this equilibrium has {} zero eigenvalue(s) {}: this is a buckling or limit load, or a part can move "
        "freely; its amplitude is arbitrary")
# names of free motions in an event
SHOWN = 6
WHERE = {"space": "in space", "plane": "in the plane of the scene (motions out of it are not counted)"}
KEPT = "The last equilibrium is in .state, everything computed in .result"
# event of the smallest load step where supports move
LEAP = ("load factor {:.6g}: no equilibrium was found near the one before, and a more distant one was used (by {:.3g}, in sizes "
        "of the scene and rad). The load path passed a buckling or limit load, and there may be other equilibria. "
        "fb.solve_path(model, at_time=(0, t)) follows the path from the one before, fb.relax finds a stable equilibrium")
# load steps that are tried at most, or so many times as many as the largest one makes necessary
MOST_STEPS, MORE_STEPS = 200, 2
TOO_MANY = ("load factor {:.6g}: {} load steps were tried, the last one of {:.3g}, but the full loads act at 1 only. The scene "
            "may begin far from an equilibrium, for example as a rope drawn with a corner, or a limit point lies there. Use "
            "start=fb.relax(model).state, draw the shape without corners, or follow the path with fb.solve_path. A smaller "
            "largest_load_step= allows more steps.  ")
# iterations beyond which a load step was hard: the next one is not longer
LONG = 9


@dataclass(frozen=True)
class StaticTask:
    """Task of `solve_static`, its arguments tested."""

    model: Model
    start: State | None
    notes: list[tuple[str, str]]  # events of the start
    factors: Array  # float64 [K]: load factors at the time of the loads
    stops: list[float]  # load factors that steps end at
    stays: Array  # bool [sliders]: sliders that are held
    asked: list[int]  # sliders whose interval of places of rest is looked for
    # smallest_step, at_time, observe, points, max_iterations, backend, threads, raise_loads, contacts, steady: arguments of
    # `solve_static`
    smallest_step: float
    at_time: float | None
    observe: Sequence[str]
    points: Mapping[str, Place] | None
    max_iterations: int
    backend: str
    threads: int | None
    raise_loads: bool
    contacts: str
    steady: Spin | Travel | None

    def solver(self) -> StaticSolver:
        """Make the solver for this type of scene, at the start. Raises SceneError: `contacts="exact"` does not support something
        in the scene."""
        model, t = self.model, self.at_time or 0.0
        out: StaticSolver
        if self.contacts == "exact" and model.n_sliders:
            if self.steady is not None:
                raise SceneError("solve_static: contacts='exact' does not support steady motions; leave contacts out, or steady")
            require(Analysis.EXACT, model, held=self.stays)
            out = ExactSolver(model, self.start, self.max_iterations, self.stays, self.backend, t)
        elif model.n_constraints or self.steady is not None:
            out = sliding = SlidingSolver(model, self.start, self.max_iterations, self.stays,
                                          None if self.steady is None else False, self.backend, t)
            if self.steady is not None:
                sliding.steady = SteadyForces("solve_static", sliding.stepper.model, self.steady, sliding.map, 6)
        else:
            out = StaticSolver(model, self.start, self.max_iterations, self.backend, self.threads)
        if model.prescribed is not None and self.at_time is not None:
            out.motion = SupportPath(model, out.state, self.start is None, self.at_time)
        return out


def stability(solver: StaticSolver, model: Model, factors: Array, held_in_space: bool,
              is_counted: bool = True) -> tuple[dict[str, Any], list[tuple[str, str]]]:
    """Report the stability of the last equilibrium of a solver, that of load factors [K]: entries of `info`, and events (kind,
    text). held_in_space: result of `check_supports`; is_counted: whether stability is reported at all."""
    flat = solver.stepper.plane is not None
    where = "plane" if flat and (model.asked_for_plane or not held_in_space) else "space"
    counted = solver.signs(factors, where == "plane") if is_counted else None
    if is_counted and counted is None and flat and where == "space":
        # about the normal of a plane moments have a potential
        where, counted = "plane", solver.signs(factors, True)
    unstable, free, names = counted or (None, None, ())
    info = {"unstable_directions": unstable, "free_directions": free, "free_motions": list(names), "counted_in": where}
    texts = [("unstable", UNSTABLE.format(unstable, WHERE[where]))] if unstable else []
    if names:
        shown = ", ".join(names[:SHOWN]) + (f" and {len(names) - SHOWN} more" if len(names) > SHOWN else "")
        texts.append(("free", FREE_MOTIONS.format(len(names), WHERE[where], shown)))
    if free and free > len(names):
        texts.append(("free", FREE.format(free - len(names), WHERE[where])))
    return info, texts


class LoadSteps(StaticRows):
    """Load steps to the equilibrium, with a row for each. Raises SceneError: something is held by nothing, or what is observed
    does not exist."""

    def __init__(self, task: StaticTask, method: str = "static", **more: Any) -> None:
        self.task, self.solver = task, task.solver()
        model = task.model
        self.flat = self.solver.stepper.plane is not None
        # a scene in steady motion need not be held
        self.held_in_space = task.steady is not None or check_supports(model, self.flat)
        super().__init__(model, method, task.observe, task.points, self.solver,
                         {"contact_force": "of the equilibrium"} if model.n_sliders else {}, **more)
        for kind, text in task.notes:
            self.event(kind, 0.0, text)

    def find(self, load_step: float, largest_load_step: float) -> Result:
        """Find the equilibrium, with load steps that begin with one size and stay below another. Raises ConvergenceError or
        Interrupted."""
        bar = Progress(1.0, f"{self.model.scene_name}: load")
        with bar, self.guarded(self._finish, lambda: bar.done, lambda: f"load factor {bar.done:.6g}") as self.solver.interrupts:
            self._climb(load_step, largest_load_step, bar)
            bar.close()
            self._judge()
        return self._finish()

    def _climb(self, step: float, largest: float, bar: Progress) -> None:
        """Advance from one equilibrium to the next, until load factor 1."""
        task, solver = self.task, self.solver
        factors, raised, t, smallest = task.factors, task.raise_loads, task.at_time or 0.0, task.smallest_step
        reached, tried, size = 0.0, 0, step
        most = max(MOST_STEPS, MORE_STEPS * (math.ceil(1.0 / largest) + len(task.stops)))
        solver.set_time(t, 0.0 if raised else 1.0)
        self._record(0.0, 0, 0.0)
        while reached < 1.0:
            solver.interrupts.serve()
            tried += 1
            if tried > most:
                raise self._given_up(reached, most, size)
            stop = next(level for level in task.stops if level > reached)
            size = min(step, stop - reached)
            target = stop if reached + size > stop - 1e-12 else reached + size
            solver.set_time(t, target if raised else 1.0)
            solver.move_to(target)
            before = solver.stepper.core_state.q.copy()
            shape = None if task.model.lines is None else solver.state.q.copy()
            shorter = size > smallest * (1.0 + 1e-12)
            solver.may_leap = not shorter
            status, sizes = solver.equilibrium(target * factors if raised else factors)
            if status == OK and shorter and (self._leaps_back(before) or self._swaps_back(before, shape)):
                status = NOT_CONVERGED
            if status == OK:
                solver.history.append(len(sizes))
                self._record(target, len(sizes), size)
                for share, extent in solver.leaps:
                    self.event("leap", share, LEAP.format(share, extent))
                solver.leaps.clear()
                bar.update(target - reached)
                reached = target
                # a step that was cut to meet a level says nothing against the size planned
                grown = size * (2.0 if solver.longest <= 6 else 1.4 if solver.longest <= LONG else 1.0)
                step = min(max(grown, step if size < step else 0.0), largest)
                continue
            if status == SLIDER_END and isinstance(solver, SlidingSolver) and max(solver.runaway, solver.stuck) >= 0:
                raise _no_equilibrium_of_slider(solver, target, reached, self._finish())
            if not shorter:
                if isinstance(solver.motion, SupportPath):
                    solver.motion.check_turns(reached)
                raise self._failure(status, sizes, reached)
            step = max(smallest, 0.25 * size)

    def _leaps_back(self, before: Array) -> bool:
        """Go back to the coordinates `before` where many iterations ended at a shape that is folded as no beam is, and they were
        not: smaller steps lead elsewhere. Returns whether that was so."""
        solver = self.solver
        if solver.longest <= LONG or isinstance(solver, SlidingSolver):
            return False
        resolution, q = Resolution(self.task.model), solver.stepper.core_state.q
        if not resolution.is_folded(solver.state.q):
            return False
        after = q.copy()
        q[:] = before
        if resolution.is_folded(solver.state.q):
            q[:] = after
            return False
        return True

    def _swaps_back(self, before: Array, shape: Array | None) -> bool:
        """Go back to the coordinates `before`, `shape` in space, where ends of a spring or line force have passed each other: a
        smaller step may meet it. Returns whether that was so. shape: None where there are no such ends."""
        solver, lines = self.solver, self.task.model.lines
        if shape is None or isinstance(solver, SlidingSolver) or not lines.swapped(shape, solver.state.q):
            return False
        solver.stepper.core_state.q[:] = before
        return True

    def _given_up(self, reached: float, count: int, size: float) -> ConvergenceError:
        """Form the error after `count` load steps, the last one of this size."""
        return ConvergenceError(f"{TOO_MANY.format(reached, count, size)}{KEPT}", step=len(self.solver.history), time=reached,
                                state=self.solver.stepper.copy_state(), result=self._finish())

    def _failure(self, status: int, sizes: list[float], reached: float) -> ConvergenceError:
        """Form the error of a failure with the smallest load step."""
        solver = self.solver
        failed = Outcome(status, 0, len(sizes), -1, np.array(sizes), np.zeros((2, 0)))
        error = failure(solver.stepper, failed, reached, len(solver.history))
        text = str(error).replace(f"t = {reached:.6g} s", f"load factor {reached:.6g}").split("; the last good state")[0]
        coarse = self.look_at_mesh(reached, solver.state)
        if solver.unresisted:
            coarse += (f"; {solver.unresisted!r} slips beyond its friction there, and no other force resists: lock it, reduce "
                       "its load, or add a spring")
        in_full = [force.name for force in user_forces(self.task.model) if not force.grows]
        if in_full:
            coarse += (f"; user force {in_full[0]!r} acts in full from the first load step: give it grows=True if it is to grow "
                       "with the load factor")
        error = ConvergenceError(f"{text}{coarse}{_slack(self.task.model, solver.state)}; a limit or buckling point may lie "
                                 "there, a part may be free to move, or stiffnesses are too far apart for round-off (beams more "
                                 f"slender than 1e6). {KEPT}",
                                 step=error.step, time=reached, residuals=error.residuals, worst=error.worst,
                                 state=solver.stepper.copy_state(), result=self._finish())
        return solver.stepper.blamed(error, f"load factor {reached:.6g}", KEPT)

    def _judge(self) -> None:
        """Report friction, stability and resolution of the mesh in the last equilibrium."""
        task, solver, info = self.task, self.solver, self.info
        factors = task.factors
        if isinstance(solver, SlidingSolver):
            info |= solver.at_rest(task.asked, factors)
        if isinstance(solver, ExactSolver):
            info["force_along"] = solver.forces_along()
        self.look_at_mesh(1.0, solver.state)
        if isinstance(solver, SlidingSolver) and not isinstance(solver, ExactSolver):
            for event in place_events(solver, task.model):
                self.buffer.event(event)
        told, texts = stability(solver, task.model, factors, self.held_in_space, task.steady is None)
        info |= told
        for kind, text in texts:
            self.event(kind, 1.0, text)

    def _record(self, factor: float, iterations: int, size: float) -> None:
        """Keep a row of the last equilibrium."""
        task, solver, t = self.task, self.solver, self.task.at_time or 0.0
        solver.count_turns()
        state = shown = solver.state
        loads = factor * task.factors if task.raise_loads else task.factors
        row = self.row(t, state, iterations, size, loads, factor)
        if isinstance(solver, ExactSolver) and solver.found is not None:
            row |= solver.row(Observed(self.observed, task.points or {}), t, loads, factor)
            shown = solver.shown
        self.keep(factor, row | self._also(), state, f"the load factor {factor:.6g}", shown)

    def _also(self) -> dict[str, Any]:
        """Return entries of a row besides the observed quantities."""
        return {}

    def _finish(self) -> Result:
        """Return the result so far, with the last equilibrium."""
        solver = self.solver
        return self.closed(solver.state, solver=solver.name, steps=len(solver.history), iterations=sum(solver.history))


def _slack(model: Model, state: State) -> str:
    """Name springs that are slack, for the message of a failed load step."""
    rows = model.spring_rows
    names = [name for springs in rows if isinstance(springs, SpringRows) for name in springs.slack(state)]
    if not names:
        return ""
    return (f"; {len(names)} of the springs with tension or compression only are slack "
            f"({', '.join(map(repr, names[:4]))}{(', ...' if len(names) > 4 else '')}), and have no stiffness: use start= with a "
            "shape in which they carry load, or let fb.relax(model) find the equilibrium")


def _no_equilibrium_of_slider(solver: SlidingSolver, target: float, reached: float, result: Result) -> ConvergenceError:
    """Form the error of a slider that finds no place on its beam."""
    names = solver.stepper.model.names["sliders"]
    name = names[max(solver.runaway, solver.stuck)]
    if solver.runaway >= 0:
        text = (f"slider {name!r} leaves its beam: it finds no equilibrium between its place and the end. Lock it where it is "
                f"(held=({name!r},)), let the scene begin with it elsewhere, or add a stop or spring at the end")
    elif isinstance(solver, ExactSolver) and solver.why_stuck:
        text = solver.why_stuck
    else:
        forces = solver.stepper.model.slider_forces
        slider = None if forces is None else forces.sliders[solver.stuck]
        driven = slider is not None and slider.drive is not None
        why, what = (("the force of its drive jumps there", "Let that force change steadily with the place") if driven else
                     ("its curve has a kink at an element end, where the tangent is not defined",
                      "Use curve='c1'" if slider is None or slider.curve != "c1" else "Use more elements there"))
        text = (f"slider {name!r} is pushed to the same place from both sides, near s = {solver.last_s[solver.stuck]:.6g} m: "
                f"{why}. {what}, or lock it (held=({name!r},))")
    return ConvergenceError(
        f"load factor {target:.6g}: {text}. The last equilibrium is in .state, everything computed in .result",
        step=len(solver.history), time=reached, state=solver.stepper.copy_state(), result=result)
