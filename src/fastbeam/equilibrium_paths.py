"""Equilibrium paths under loads that grow and fall by one factor, past limit points, by arc length (theory.md 12)."""
from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .arc_length import Direction, PathSolver, root
from .arguments import Anything, Count, Number, Refusal, Vector, Word, checked, shown, take, whole
from .errors import ConvergenceError, Interrupted, SceneError
from .interrupt import Interrupts
from .joint_motion import check_at_rest
from .kernels.work import State
from .linsolve import check_backend
from .load_times import load_factors_at, load_path, which_times
from .model import Model, check_model
from .observe import OBSERVED, POINTS, Observer
from .progress import Progress
from .reactions import StaticReactions
from .resolution import Resolution
from .result import Result, ResultBuffer
from .scene import Clamp, NodeRef, Pin, PointMass, PrescribedMotion, RigidBody
from .scene.checks import Place
from .starting import check_start
from .static_motion import StaticShift
from .statics import RECORDED, START, check_slider_forces, held_sliders, which_sliders
from .supports import check_supports, standing_supports, supported
from .winches import refuse_winches

Array = np.ndarray
Support = Clamp | Pin | PrescribedMotion | NodeRef | PointMass | RigidBody
# steps in which the path turns by more (cosine) are halved
LEAST_COSINE = 0.9
# iterations up to which steps grow, and by how much
FEW, GROWTH = 5, 1.5
# a slider that near to an end, as a share of its beam, is what stops a path
AT_END = 1e-3
# a path is closed that comes back to its first equilibrium: rows before this is looked for, distance of the start from a chord of
# the path as a share of its length, and half the length of the shorter chord, ten times nearer, as a share of the step
LEAST_ROWS, OFF_CHORD, AROUND = 4, 0.1, 0.05
STEP = Number(above=0.0, most=10.0)
KINDS = ("limit", "bifurcation")


def which_branch(value: Any) -> int:
    """1 or -1.

    Raises
    ------
    Refusal
    """
    side = whole(value)
    if side not in (1, -1):
        raise Refusal(f"must be 1 or -1, the side to which the path branches off, got {shown(value)}")
    return side


@checked(model=Anything(), to=Number(), start=START, load_factor=Number(), step=STEP, largest_step=STEP, smallest_step=STEP,
         most_points=Count(most=1_000_000), at_time=which_times, points=POINTS, observe=OBSERVED, held=which_sliders,
         max_iterations=Count(most=10_000), backend=Word(), stop_at=Word(KINDS), side=which_branch, branch=Count(0),
         moves=Anything())
def solve_path(model: Model, *, to: float = 1.0, start: State | None = None, load_factor: float = 0.0, step: float = 0.05,
               largest_step: float = 0.1, smallest_step: float = 1e-7, most_points: int = 500,
               at_time: float | tuple[float, float] | None = None,
               points: Mapping[str, Place] | None = None, observe: Sequence[str] = (), held: bool | str | Sequence[str] = False,
               max_iterations: int = 15, backend: str = "auto", stop_at: str | None = None, side: int | None = None,
               branch: int | None = None, moves: Mapping[Support, ArrayLike] | None = None) -> Result:
    """The path of equilibria under dead loads and gravity times a load factor that grows and falls as the path asks for (arc
    length), through limit points and snap-back, until the factor is `to`; limit points and bifurcations are located on the way.

    Parameters
    ----------
    model : Model
        Held as for `solve_static`. A planar scene stays in its plane.
    to : float
        Load factor at which the path ends.
    start : State
        An equilibrium, that of `load_factor`; default: the reference, without loads.
    load_factor : float
        Of the start. The path sets out towards `to`.
    step, largest_step, smallest_step : float
        First, largest and smallest length of a step: the root of the squares of the change of the load factor and of the mean
        motion of the nodes, in sizes of the scene and rad.
    most_points : int
        Points after which the path ends all the same, with an event; one that comes back to its start ends there.
    at_time : float or (float, float)
        Where time functions of loads are evaluated, s; needed when the scene has some. Two times: load factor 0 has the loads of
        the first, 1 those of the second, so that loads and gravity without a time function stay, and cases of loads follow each
        other. `start` is then an equilibrium under the first loads, `solve_static(model, at_time=...)`.
    points : mapping
        As in `simulate`.
    observe : sequence of str
        Besides what sliders do, of 'energy', 'spring', 'section' and 'reaction', as in `solve_static`.
    held : bool, str or sequence of str
        Sliders that stay where they are, as in `solve_static`. Those that are free need a start in which their contact carries
        a force.
    max_iterations : int
        Newton iterations a step.
    backend : {'auto', 'pardiso', 'superlu'}
    stop_at : {'limit', 'bifurcation'}, optional
        End at the first critical point of this kind.
    side : {1, -1}, optional
        Leave the start, a bifurcation (`stop_at`), on the other path that goes through it, to this side.
    branch : int, optional
        The same where several directions lead away, from 0: number of one of `info["critical_points"][-1]["branches"]`; of a
        simple bifurcation 0 is side 1 and 1 is side -1.
    moves : mapping, optional
        Displacement control: supports (Clamp, Pin, PrescribedMotion, or the node that they hold) -> displacement (3,), m, by
        which they are shifted from the start, straight, without turning, times the load factor less that of the start. Loads and
        gravity stay as they are, in full, but for those with time functions between two times.

    Returns
    -------
    Result
        Rows are equilibria along the path, `result.t` its length; `series["load_factor"]`, `series["unstable_directions"]` (NaN
        where moments leave the number open). Critical points are rows, too; `info["critical_points"]` lists them: kind ("limit"
        or "bifurcation"), load_factor, length, row; of the bifurcation that stop_at= ends at also multiplicity, branches
        (directions that lead away, as components along the vectors that vanish together) and continuum (whether they are two
        opposite ones of a continuum, as of a column that may bend to all sides).

    Raises
    ------
    SceneError
        An argument is not usable, or something is held by nothing.
    ConvergenceError
        The smallest step fails; carries the last equilibrium and the result until then.
    Interrupted
        By Ctrl-C; carries the same.
    """
    check_model("solve_path", model)
    stays = held_sliders(model, held)
    check_slider_forces("solve_path", model, stays)
    refuse_winches("solve_path", model)
    if model.user_forces:
        raise SceneError(f"solve_path: user force {model.user_forces[0]!r} is no load that grows by one factor; use "
                         "solve_static, which scales it, or leave it out")
    check_backend(backend)
    step = min(step, largest_step)
    if not smallest_step <= step:
        raise SceneError(f"step: needs smallest_step <= step and <= largest_step, got {smallest_step:g}, {step:g} and "
                         f"{largest_step:g}")
    if to == load_factor:
        raise SceneError(f"to: the path begins at load factor {load_factor:g} and has no way to go; give another `to`")
    if moves is None and (not model.loads.shape[0] or not np.any(model.loads)):
        raise SceneError("solve_path: the scene has no loads that could grow; add a Load, a DistributedLoad or gravity, or move "
                         "supports, moves={clamp: (0, 0, -0.1)}")
    shifts = {} if moves is None else _shifts(model, moves)
    if moves is None or isinstance(at_time, tuple):
        factors = load_path("solve_path", model, at_time)
    else:
        stay = load_factors_at("solve_path", model, at_time)
        factors = stay, np.zeros_like(stay)
    if start is None and np.any(factors[0]) and np.any(model.loads):
        raise SceneError("solve_path: the start carries loads already; say which equilibrium it is, as in "
                         "start=solve_static(model, at_time=...).state")
    if start is not None:
        start, _ = check_start(model, start, 1.0, at_rest=True)
    if branch is not None and side is not None:
        raise SceneError("branch: give side= or branch=, not both")
    if branch is not None and start is None:
        raise SceneError("branch: needs a start on a bifurcation, solve_path(model, stop_at='bifurcation').state, and its "
                         "load_factor=")
    if side is not None and start is None:
        raise SceneError("side: needs a start on a bifurcation, solve_path(model, stop_at='bifurcation').state, and its "
                         "load_factor=")
    check_at_rest("solve_path", model.motions)
    solver = PathSolver(model, start, max_iterations, stays, None, backend, factors, load_factor)
    check_supports(model, solver.stepper.plane is not None)
    if model.motions is not None:
        for t in np.atleast_1d(0.0 if at_time is None else at_time).tolist():
            model.motions.check_stays("solve_path", solver.state, model.motion_place, t)
    if shifts:
        solver.motion = StaticShift(solver.stepper.model, shifts, solver.state.q, load_factor)
    path = _Path(model, solver, points, step, largest_step, smallest_step, most_points, observe)
    return path.to(to, stop_at, branch if side is None else (1 - side) // 2)


def _shifts(model: Model, moves: Any) -> dict[int, Array]:
    """Displacements of nodes that supports hold.

    Raises
    ------
    SceneError
    """
    if not isinstance(moves, Mapping) or not moves:
        raise SceneError("solve_path, moves: must be a mapping {support or its node: displacement (3,) in m}, got "
                         f"{shown(moves)}")
    held, out = standing_supports(model), {}
    for what, value in moves.items():
        vector = take(Vector, f"solve_path, moves: displacement of {shown(what)}", value)
        axes = int(np.sum(np.array([1, 2, 4])[vector != 0.0]))
        if axes:
            out[supported("solve_path: moves=", model, what, held, axes)] = vector
    if not out:
        raise SceneError("solve_path, moves: all displacements are zero, got " + shown(moves))
    return out


class _Path:
    """Goes along, and keeps rows."""

    def __init__(self, model: Model, solver: PathSolver, points: Mapping[str, Place] | None, step: float, largest: float,
                 smallest: float, most: int, observe: Sequence[str] = ()) -> None:
        Observer(model, observe, points)  # refuses what does not exist
        self.model, self.solver = model, solver
        self.step, self.largest, self.smallest, self.most = step, largest, smallest, most
        self.first_step = step
        self.resolution = Resolution(model)
        self.observer = Observer(model, ("slider", *(kind for kind in observe if kind in RECORDED)), points)
        self.reactions = StaticReactions(solver) if self.observer.reactions else None
        self.info: dict[str, Any] = {"scene": model.scene_name, "method": "path", "conserved": [], "critical_points": [],
                                     "counted_in": "space" if solver.stepper.plane is None else "plane"}
        header = self.observer.header(self.info)
        header.series |= {"load_factor": (), "unstable_directions": ()}
        self.buffer = ResultBuffer(header)
        self.begin = time.perf_counter()
        self.length, self.rows, self.iterations = 0.0, 0, 0

    def record(self, iterations: int, size: float, unstable: int | None) -> None:
        """A row and a shape of the present equilibrium."""
        state = self.solver.state
        row = {**self.observer.row(0.0, state), "iterations": iterations, "step_size": size,
               "load_factor": self.solver.factor, "unstable_directions": np.nan if unstable is None else float(unstable)}
        if self.observer.needs_forces:
            found = self.reactions.at(self.solver.load_factors) if self.reactions else ()
            self.observer.add_forces(row, np.concatenate((state.force, found)))
        self.buffer.append(row, self.length)
        q = state.q.reshape(-1, 4, 3)
        self.buffer.snapshot(self.length, q[:, 0], q[:, 1:])
        self.resolution.look(self.length, state.q)
        self.rows += 1
        self.iterations += iterations

    def finish(self) -> Result:
        """The result so far."""
        for event in self.resolution.events():
            self.buffer.event(event)
        result = self.buffer.close(self.info | {"solver": self.solver.name, "steps": self.rows - 1, "iterations": self.iterations,
                                                "wall_time": time.perf_counter() - self.begin})
        result.state = State(*(x.copy() for x in self.solver.state))
        return result

    def to(self, to: float, stop_at: str | None, branch: int | None) -> Result:
        """Until this load factor, or a critical point of this kind; branch: of the bifurcation that it begins at.

        Raises
        ------
        ConvergenceError, Interrupted
        """
        bar = Progress(float(self.most), f"{self.model.scene_name}: path")
        try:
            with Interrupts() as self.solver.interrupts:
                self._go(to, stop_at, branch, bar)
        except KeyboardInterrupt as stopped:
            bar.close()
            result = self.finish()
            raise Interrupted(f"load factor {self.solver.factor:.6g}: interrupted; the last equilibrium is in .state, everything "
                              "until then in .result", result=result, state=result.state) from stopped
        bar.close()
        return self.finish()

    def _go(self, to: float, stop_at: str | None, branch: int | None, bar: Progress) -> None:
        solver = self.solver
        along = self._first(to) if branch is None else self._off(branch)
        unstable, sign = solver.unstable(), np.sign(along.factor)
        self.record(0, 0.0, unstable)
        first = solver.saved()
        while self.rows < self.most:
            solver.interrupts.serve()
            before = solver.saved()
            iterations = solver.go(along, self.step)
            after = solver.direction(along) if iterations else None
            if after is None or solver.product(along, after) < LEAST_COSINE:
                solver.restore(before)
                self._shorten(bar)
                continue
            counted, size = solver.unstable(), self.step
            back = self._back(first, before, along, size) if self.rows >= LEAST_ROWS else None
            if back is not None:
                self.length += back
                self.record(iterations, back, solver.unstable())
                self.buffer.event({"kind": "closed", "time": self.length,
                                   "text": f"the path is back at its start, load factor {solver.factor:.6g}"})
                return
            found = None
            if self.rows == 1 and branch is not None:
                # what changes on the way off is no event
                sign = np.sign(after.factor)
            elif after.factor * sign < 0.0:
                # to the limit point first
                sign = -sign
                found = self._limit(before, along, after)
            elif counted is not None and unstable is not None and counted != unstable:
                found = self._bifurcation(before, along, min(counted, unstable))
            if found is not None:
                size, after = found, self._direction(along)
            if (before[3] - to) * (solver.factor - to) <= 0.0 and before[3] != to:
                solver.restore(before)
                share = (to - before[3]) / along.factor if along.factor else size
                if solver.go(along, min(max(share, 0.0), 1.5 * size), to):
                    end = self._direction(along)
                    self.length += abs(solver.product(along, end)) * size
                    self.record(iterations, size, solver.unstable())
                    return
                solver.restore(before)
                self._shorten(bar)
                continue
            self.length += size
            self.record(iterations, size, counted)
            bar.update(1.0)
            if found is not None and self.info["critical_points"][-1]["kind"] == stop_at:
                self._list_branches(min(counted or 0, unstable or 0))
                return
            along, unstable = after, counted
            self.step = min(self.largest, GROWTH * self.step if iterations <= FEW else self.step)
        text = (f"the path ends after {self.most} points at load factor {solver.factor:.6g}, before {to:.6g}; go on from "
                "result.state with load_factor=, or give most_points")
        self.buffer.event({"kind": "stopped", "time": self.length, "text": text})

    def _first(self, to: float) -> Direction:
        """The first direction.

        Raises
        ------
        ConvergenceError
        """
        solver = self.solver
        # from what may not quite be an equilibrium
        sign = 1.0 if to > solver.factor else -1.0
        at = Direction(np.zeros_like(solver.weight), 1.0)
        good = solver.go(at, 0.0, solver.factor)
        along = solver.direction(None, sign) if good else None
        if along is None:
            raise ConvergenceError("solve_path: no equilibrium was found at the start, or its tangent is singular: give the "
                                   "load_factor that belongs to the start, hold sliders whose contacts carry no force yet "
                                   "(held=True), or begin from solve_static(...).state at a small load factor",
                                   state=solver.state, result=self.finish())
        return along

    def _off(self, branch: int) -> Direction:
        """The first direction on another path through a bifurcation.

        Raises
        ------
        SceneError, ConvergenceError
        """
        found, _ = self.solver.branches(self.solver.unstable() or 0, self.step)
        if not found:
            raise ConvergenceError("solve_path: no direction was found in which a path branches off the start",
                                   state=self.solver.state, result=self.finish())
        if branch >= len(found):
            raise SceneError(f"branch: {branch} does not exist, {len(found)} directions lead away from the start, counted from 0")
        return found[branch]

    def _list_branches(self, k: int) -> None:
        """What is known of the directions that lead away from the last critical point, at which the eigenvalue of number k
        vanishes."""
        point = self.info["critical_points"][-1]
        if point["kind"] != "bifurcation":
            return
        found, is_continuum = self.solver.branches(k, self.first_step)
        vectors = self.solver.critical_directions(k)
        if vectors is not None:
            parts = [vectors.T @ (self.solver.weight * way.x) for way in found]
            point |= {"multiplicity": vectors.shape[1], "branches": [part.tolist() for part in parts], "continuum": is_continuum}

    def _direction(self, along: Direction) -> Direction:
        """At the present equilibrium; the last one where there is none, as where paths cross."""
        found = self.solver.direction(along)
        return along if found is None or self.solver.product(along, found) < LEAST_COSINE else found

    def _shorten(self, bar: Progress) -> None:
        """Half the step.

        Raises
        ------
        ConvergenceError
            It is the smallest.
        """
        if self.step <= self.smallest:
            bar.close()
            solver, result = self.solver, self.finish()
            where = self.model.node_label(solver.stepper.worst_node()[0])
            to_end = np.min(np.abs(solver.stepper.core_state.s - solver.ends.T), axis=0) / solver.lengths
            if self.rows == 1 and solver.sliding.any():
                where += ("; a slider whose contact carries no force yet has no place of its own: hold it (held=True), or begin "
                          "with start=solve_static(...).state and its load_factor")
            elif np.any(to_end < AT_END):
                where += f"; slider {self.model.names['sliders'][int(np.argmin(to_end))]!r} comes to an end of its beam"
            raise ConvergenceError(f"load factor {solver.factor:.6g}: the smallest step of the path fails, the largest residual "
                                   f"is at {where}; the last equilibrium is in .state, everything until then in .result",
                                   step=self.rows - 1, time=self.length, worst=where, state=result.state, result=result)
        self.step = max(self.smallest, 0.5 * self.step)

    def _located(self, before: tuple[Any, ...], along: Direction, f: Callable[[], float], first: float, last: float,
                 ) -> float | None:
        """The step at which f vanishes, with the solver there; f at the start and the end of the present step."""
        solver, end = self.solver, self.solver.saved()

        def at(size: float) -> float:
            solver.restore(before)
            return f() if solver.go(along, size) else np.nan

        size = root(at, 0.0, first, self.step, last) if first * last < 0.0 else None
        if size is None or not 0.0 < size < self.step or not np.isfinite(at(size)):
            solver.restore(end)
            return None
        return size

    def _back(self, first: tuple[Any, ...], before: tuple[Any, ...], along: Direction, size: float) -> float | None:
        """The part of the present step that leads back to the first equilibrium, with the solver there; None where it does not.

        Newton's method is asked for a little before and behind it only: where the path begins at a bifurcation its matrix is
        singular.
        """
        solver, end, last = self.solver, self.solver.saved(), self.solver.place()
        solver.restore(first)
        start = solver.place()
        solver.restore(before)
        begin = solver.place()
        share, distance = _from_chord(start, begin, last)
        if 0.0 < share <= 1.0 and distance < OFF_CHORD:
            ends = []
            for x in (share - AROUND, share + AROUND):
                solver.restore(before)
                if solver.go(along, x * size):
                    ends.append(solver.place())
            if len(ends) == 2:
                inside, distance = _from_chord(start, *ends)
                if 0.0 < inside < 1.0 and distance < 2.0 * AROUND * OFF_CHORD:
                    solver.restore(first)
                    return share * size
        solver.restore(end)
        return None

    def _limit(self, before: tuple[Any, ...], along: Direction, after: Direction) -> float | None:
        """Go to the limit point within the present step, whose length to there it returns."""
        solver = self.solver

        def rate() -> float:
            found = solver.direction(along)
            return np.nan if found is None else found.factor

        size = self._located(before, along, rate, along.factor, after.factor)
        if size is not None:
            self._note("limit", size)
        return size

    def _bifurcation(self, before: tuple[Any, ...], along: Direction, k: int) -> float | None:
        """The same for the bifurcation at which the eigenvalue of number k changes its sign."""
        solver = self.solver
        end = solver.saved()
        last = solver.eigenvalue(k)
        solver.restore(before)
        first = solver.eigenvalue(k)
        solver.restore(end)
        size = self._located(before, along, lambda: solver.eigenvalue(k), first, last)
        if size is not None:
            self._note("bifurcation", size)
        return size

    def _note(self, kind: str, size: float) -> None:
        length = float(self.length + size)
        point = {"kind": kind, "load_factor": float(self.solver.factor), "length": length, "row": self.rows}
        self.info["critical_points"].append(point)
        text = ("limit point: loads cannot grow beyond it, or not fall" if kind == "limit" else
                "bifurcation: another path branches off; side= leads there (see solve_path)")
        self.buffer.event({"kind": kind, "time": length, "text": f"load factor {self.solver.factor:.12g}: {text}"})


def _from_chord(point: Array, a: Array, b: Array) -> tuple[float, float]:
    """Of a point beside the chord from a to b: where its foot is, from 0 to 1, and its distance; both as shares of the chord."""
    way = b - a
    share = float(way @ (point - a) / (way @ way))
    return share, float(np.linalg.norm(point - a - share * way) / np.linalg.norm(way))
