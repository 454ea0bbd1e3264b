"""Continuation along a path of equilibria: lengths of steps, critical and wanted points within them, rows (theory.md 12)."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fastbeam.interface.errors import ConvergenceError, SceneError
from fastbeam.model.model import Model
from fastbeam.results.observe.resolution import Resolution
from fastbeam.results.progress import Progress
from fastbeam.results.result import Result
from fastbeam.scene.checks import Place
from fastbeam.statics.arc_length import Direction, PathSolver
from fastbeam.statics.linear_response import place_events
from fastbeam.statics.load_steps import KEPT
from fastbeam.statics.path_stops import Wanted
from fastbeam.statics.paths.critical_points import CriticalPoint, PathStep, mode_of, type_of_bifurcation
from fastbeam.statics.reactions import reactions_of
from fastbeam.statics.rows import StaticRows

Array = np.ndarray
# steps in which the path turns by more (cosine) are halved
LEAST_COSINE = 0.9
# lengths of a step around a corner, in smallest steps
CORNERS = np.array([4.0, 64.0, 1024.0])
# iterations up to which steps grow, and by how much
FEW, GROWTH = 5, 1.5
# part of a step to which it is divided where a change within it is not located
FINEST = 1e-3
# a slider that near to an end, as a share of its beam, is what stops a path
AT_END = 1e-3
# a path is closed that comes back to its first equilibrium: rows before this is looked for, distance of the start from a chord of
# the path as a share of its length, and half the length of the shorter chord, ten times nearer, as a share of the step
LEAST_ROWS, OFF_CHORD, AROUND = 4, 0.1, 0.05
# a load factor that is so many times farther off than a path has come is too large for its steps
FAR = 10.0
# message about loads without a potential
FLUTTER = ("follower loads, laws, moving air and moments with fixed axes have no potential. Only real eigenvalues are counted "
           "here; growing vibrations (flutter) are found by fb.modes(model, state=result.state, load_factor=...) only")


@dataclass
class _Step:
    """Step along a path, or the part of it up to its event."""

    before: tuple[Any, ...]     # what the solver has saved at its beginning
    along: Direction
    after: Direction            # at its end
    iterations: int
    size: float
    counted: int | None         # unstable directions at its end
    met: Wanted | None          # the quantity that comes to its value there
    off: Array                  # how far all of them are off theirs
    found: CriticalPoint | None = None


class PathWalk(StaticRows):
    """Walk along a path of equilibria, with the rows of its result."""

    def __init__(self, model: Model, solver: PathSolver, points: Mapping[str, Place] | None, step: float, largest: float,
                 smallest: float, most: int, observe: Sequence[str] = (), wanted: Sequence[Wanted] = ()) -> None:
        judge = solver.judge
        super().__init__(model, "path", observe, points, solver, {
            "critical_points": [], "conservative": not judge.is_unsymmetric,
            "counted_in": "space" if judge.stepper.plane is None else "plane"}, {"load_factor": (), "unstable_directions": ()})
        self.solver = solver
        self.step, self.largest, self.smallest, self.most = step, largest, smallest, most
        # state at which the present step begins
        self.begun_at: tuple[Any, ...] | None = None
        self.first_step = self.size = step
        # length of a step before it was divided because something within it was not located
        self.undivided: float | None = None
        # quantities that end the path, and how far they are off their values
        self.wanted, self.off = wanted, np.zeros(0)
        self.resolution = Resolution(model, solver.strains)
        self.length, self.rows, self.iterations = 0.0, 0, 0
        # load factors at which the number of unstable directions is not known
        self.open: list[float] = []
        # unstable directions at the beginning of a step, and sign of the change of the load factor there
        self.unstable: int | None = None
        self.sign = 1.0
        # why a path in a plane knows nothing of critical points out of it
        self.aside = ""

    def record(self, iterations: int, size: float, unstable: int | None) -> None:
        """Keep a row and a shape of the present equilibrium."""
        self.solver.count_turns()
        state, (t, share) = self.solver.state, self.solver.drives_at or (0.0, None)
        row = self.row(t, state, iterations, size, self.solver.load_factors, share)
        row |= {"load_factor": self.solver.factor, "unstable_directions": np.nan if unstable is None else float(unstable)}
        self.keep(self.length, row, state, f"the load factor {self.solver.factor:.6g}")
        self.resolution.look(self.length, state)
        if unstable is None:
            self.open.append(self.solver.factor)
        self.rows += 1
        self.iterations += iterations

    def finish(self) -> Result:
        """Return the result so far."""
        for event in self.resolution.events():
            self.buffer.event(event)
        if self.open:
            text = (f"at {len(self.open)} rows, between load factors {min(self.open):.6g} and {max(self.open):.6g}, the number "
                    "of unstable directions is not known, so bifurcations may be missing there; check with fb.modes(model, "
                    "state=..., load_factor=...)")
            self.event("unresolved", self.length, text)
        if not self.info["conservative"]:
            self.event("nonconservative", self.length, FLUTTER)
        return self.closed(self.solver.state, solver=self.solver.name, steps=self.rows - 1, iterations=self.iterations)

    def to(self, to: float, stop_at: str | None, branch: int | None) -> Result:
        """Follow the path until this load factor, or a critical point of this kind; branch: number of the branch at the
        bifurcation where the path begins. Raises ConvergenceError or Interrupted."""
        bar = Progress(float(self.most), f"{self.model.scene_name}: path")
        with bar, self.guarded(self.finish, lambda: self.length, lambda: f"load factor {self.solver.factor:.6g}"
                               ) as self.solver.interrupts:
            try:
                self._go(to, stop_at, branch, bar)
                for event in place_events(self.solver, self.model):
                    self.buffer.event({**event, "time": self.length})
            except Exception as failed:
                if self.begun_at is not None and not isinstance(failed, ConvergenceError):
                    self.solver.restore(self.begun_at)
                raise
        if self.aside and (stop_at is not None or any(point["kind"] == "bifurcation" for point in self.info["critical_points"])):
            self.event("plane", self.length, self.aside)
        return self.finish()

    def _go(self, to: float, stop_at: str | None, branch: int | None, bar: Progress) -> None:
        along = self._first(to) if branch is None else self._off(branch)
        solver = self.solver
        self.unstable, self.sign = solver.judge.unstable(), float(np.sign(along.factor))
        self.record(0, 0.0, self.unstable)
        self.off = self._off_values()
        first = solver.saved()
        while self.rows < self.most:
            self.begun_at = None
            solver.interrupts.serve()
            before = self.begun_at = solver.saved()
            step = self._taken(before, along)
            if step is not None and self._closes(first, step):
                return
            if step is not None and self.rows == 1 and branch is not None:
                # changes on the first step off a bifurcation are no events
                self.sign = float(np.sign(step.after.factor))
            elif step is not None and not self._looks(step, stop_at):
                step = None
            passes = step is not None and (before[3] - to) * (solver.factor - to) <= 0.0 and before[3] != to
            if step is not None and passes and self._arrives(step, to):
                return
            if step is None or passes:
                solver.restore(before)
                stuck = step is None and self.step <= self.smallest and self.rows > 1
                behind = self._around_corner(along, stop_at) if stuck else None
                if behind is None:
                    self._shorten()
                    continue
                if behind is along:
                    return
                along = behind
                continue
            if self._ends_with(step, stop_at, bar):
                return
            along, self.unstable = step.after, step.counted
            self._lengthen(step.iterations)
        text = (f"the path ends after {self.most} points at load factor {solver.factor:.6g}, before {to:.6g}; ")
        if abs(solver.factor - to) > FAR * abs(solver.factor - first[3]):
            # a step changes the load factor by its length at most
            text += ("scale the loads such that load factors are of the size of 1: critical_loads(model) gives the factors at "
                     "which the scene buckles")
        else:
            text += "continue from result.state with load_factor=, or increase most_points"
        self.event("stopped", self.length, text)

    def _taken(self, before: tuple[Any, ...], along: Direction) -> _Step | None:
        """Take the next step, up to the first wanted quantity within it; None where it fails or the path turns too far."""
        solver = self.solver
        iterations = solver.go(along, self.step)
        after = solver.direction(along) if iterations else None
        if after is None or solver.product(along, after) < LEAST_COSINE:
            return None
        self.size = self.step
        met, off = self._met(before, along)
        if met is not None:
            after = self._direction(along)
        return _Step(before, along, after, iterations, self.size, solver.judge.unstable(), met, off)

    def _around_corner(self, along: Direction, stop_at: str | None) -> Direction | None:
        """Go on behind a corner of the path, where the smallest step fails, with a row there. Returns the direction there; None
        where there is no corner; `along` where it is a limit point and the path ends at it, with the last row."""
        solver, corner = self.solver, self.solver.saved()
        for size in CORNERS * self.smallest:
            found = solver.around_corner(along, float(size))
            if found is None:
                continue
            iterations, after = found
            behind = solver.judge.unstable()
            if after.factor * self.sign < 0.0:
                end = solver.saved()
                solver.restore(corner)
                self.sign = -self.sign
                point = {"kind": "limit", "load_factor": float(solver.factor), "length": self.length, "row": self.rows - 1,
                         "type": "maximum" if self.sign < 0.0 else "minimum"}
                self._keep_point(point, f"limit point ({point['type']}) at a kink of a force law, for example at a stop: the "
                                        "load factor turns around there")
                if stop_at == "limit":
                    return along
                solver.restore(end)
            self.unstable, self.length = behind, self.length + float(size)
            self.record(iterations, float(size), behind)
            self.off, self.step = self._off_values(), self.first_step
            return after
        return None

    def _closes(self, first: tuple[Any, ...], step: _Step) -> bool:
        """Return whether a step leads back to the first equilibrium; if it does, keep the last row there."""
        back = self._back(first, step.before, step.along, step.size) if self.rows >= LEAST_ROWS else None
        if back is None:
            return False
        self.length += back
        self.record(step.iterations, back, self.solver.judge.unstable())
        self.event("closed", self.length, f"the path is back at its start, load factor {self.solver.factor:.6g}")
        return True

    def _looks(self, step: _Step, stop_at: str | None) -> bool:
        """Look for the first critical point within a step, which ends there then. False where one was not located in a step that
        may be divided."""
        whole = PathStep(self.solver, step.before, step.along, step.size)
        rates = (step.along.factor, step.after.factor) if step.after.factor * self.sign < 0.0 else None
        found = whole.first(rates, self.unstable, step.counted)
        if whole.is_lost:
            if self._may_divide(stop_at):
                return False
            what = "the load factor turns around" if rates is not None and found is None else (
                f"the number of unstable directions changes from {self.unstable} to {step.counted}")
            self._lost(whole, what, stop_at)
        if found is not None:
            step.found, step.size, step.counted, step.met = found, found.size, found.unstable, None
            step.after, step.off = self._direction(step.along), self._off_values()
        return True

    def _arrives(self, step: _Step, to: float) -> bool:
        """Return whether part of a step that passes the final load factor leads to an equilibrium there; if it does, keep the
        last row."""
        solver, along = self.solver, step.along
        solver.restore(step.before)
        share = (to - step.before[3]) / along.factor if along.factor else step.size
        if not solver.go(along, min(max(share, 0.0), 1.5 * step.size), to):
            return False
        end = self._direction(along)
        self.length += abs(solver.product(along, end)) * step.size
        self.record(step.iterations, step.size, solver.judge.unstable())
        return True

    def _ends_with(self, step: _Step, stop_at: str | None, bar: Progress) -> bool:
        """Keep a step; return whether the path ends with it, at a wanted quantity or a critical point of this kind."""
        found, met = step.found, step.met
        if found is not None:
            self.sign = -self.sign if found.kind == "limit" else self.sign
            self._note(found, self.sign)
        self.length += step.size
        self.record(step.iterations, step.size, step.counted)
        bar.update(1.0)
        if met is not None:
            text = f"load factor {self.solver.factor:.12g}: {met.label} is {met.value:.12g}"
            self.event("wanted", self.length, text)
            return True
        self.off = step.off
        if found is None or found.kind != stop_at:
            return False
        self._list_branches(found.number)
        return True

    def _lengthen(self, iterations: int) -> None:
        """Lengthen the next step where the last one was easy."""
        self.step = min(self.largest, GROWTH * self.step if iterations <= FEW else self.step)
        if self.undivided is not None and self.step >= self.undivided:
            self.undivided = None

    def _off_values(self) -> Array:
        return np.array([x.off(self.solver.state) for x in self.wanted])

    def _met(self, before: tuple[Any, ...], along: Direction) -> tuple[Wanted | None, Array]:
        """Find the first wanted quantity that the present step brings to its value, with the solver there and `size` the part of
        the step; return it, and how far all quantities are off at its end."""
        off, met = self._off_values(), None
        # a quantity that begins at its value goes on from there
        passed = np.flatnonzero((self.off != 0.0) & (self.off * off <= 0.0))
        solver, whole, end, after = self.solver, self.step, self.solver.saved(), off
        for k in passed.tolist():
            solver.restore(end)
            self.size = whole
            one = self.wanted[k]
            size: float | None = whole
            if off[k] != 0.0:
                step = PathStep(solver, before, along, whole)
                size = step.zero(lambda: one.off(solver.state), float(self.off[k]), float(off[k]))
            if size is not None and (met is None or size < met[0]):
                met = size, one, solver.saved()
        if met is None:
            solver.restore(end)
            self.size = whole
            return None, after
        self.size = met[0]
        solver.restore(met[2])
        return met[1], after

    def _first(self, to: float) -> Direction:
        """Find the first direction. Raises ConvergenceError."""
        solver = self.solver
        # the start may not quite be an equilibrium
        sign = 1.0 if to > solver.factor else -1.0
        at = Direction(np.zeros_like(solver.weight), 1.0)
        good = solver.go(at, 0.0, solver.factor)
        along = solver.direction(None, sign) if good else None
        if along is None:
            error = ConvergenceError("solve_path: no equilibrium was found at the start, or its tangent is singular: give the "
                                     "load_factor of the start, lock sliders whose contacts carry no force yet (held=True), or "
                                     "begin from solve_static(...).state at a small load factor",
                                     state=solver.state, result=self.finish())
            raise solver.stepper.blamed(error, "solve_path: at the start", KEPT)
        return along

    def _off(self, branch: int) -> Direction:
        """Find the first direction on another path through a bifurcation. Raises SceneError or ConvergenceError."""
        solver, judge = self.solver, self.solver.judge
        number = judge.unstable() or 0
        found, _ = judge.branches(number, self.step)
        if not found:
            raise ConvergenceError("solve_path: no direction of a branch was found at the start; give a smaller step=, or more "
                                   "elements (a coarse mesh may lose branches of a symmetry)",
                                   state=self.solver.state, result=self.finish())
        if branch >= len(found):
            raise SceneError(f"branch: {branch} does not exist, {len(found)} directions lead away from the start, counted from 0")
        if judge is solver:
            return found[branch]
        within = solver.in_plane(found[branch], number, self.step)
        if within is None:
            # the path leaves the plane
            self.solver, self.reactions = judge, reactions_of(judge, self.observer)
        return within or found[branch]

    def _list_branches(self, k: int) -> None:
        """Store the directions of paths that leave the last critical point, at which the eigenvalue of number k vanishes."""
        point = self.info["critical_points"][-1]
        if point["kind"] != "bifurcation":
            return
        judge = self.solver.judge
        found, is_continuum = judge.branches(k, self.first_step)
        vectors = judge.critical_directions(k)
        if vectors is not None:
            parts = [vectors.T @ (judge.weight * way.x) for way in found]
            point |= {"multiplicity": vectors.shape[1], "branches": [part.tolist() for part in parts], "continuum": is_continuum}

    def _direction(self, along: Direction) -> Direction:
        """Return the direction at the present equilibrium; the last one where none is found, as where paths cross."""
        found = self.solver.direction(along)
        return along if found is None or self.solver.product(along, found) < LEAST_COSINE else found

    def _shorten(self) -> None:
        """Halve the step. Raises ConvergenceError: it is the smallest."""
        if self.step <= self.smallest:
            solver, result = self.solver, self.finish()
            where = solver.stepper.label_of(solver.stepper.worst_node()[0])
            to_end = np.min(np.abs(solver.stepper.core_state.s - solver.ends.T), axis=0) / solver.lengths
            if self.rows == 1 and solver.sliding.any():
                where += ("; the place of a slider whose contact carries no force yet is not determined: lock it (held=True), or "
                          "begin with start=solve_static(...).state and its load_factor")
            elif np.any(to_end < AT_END):
                where += f"; slider {self.model.names['sliders'][int(np.argmin(to_end))]!r} reaches an end of its beam"
            error = ConvergenceError(f"load factor {solver.factor:.6g}: the smallest step of the path fails, the largest "
                                     f"residual is at {where}; the last equilibrium is in .state, everything until then in "
                                     ".result", step=self.rows - 1, time=self.length, worst=where, state=result.state,
                                     result=result)
            raise solver.stepper.blamed(error, f"load factor {solver.factor:.6g}", KEPT)
        self.step = max(self.smallest, 0.5 * self.step)

    def _back(self, first: tuple[Any, ...], before: tuple[Any, ...], along: Direction, size: float) -> float | None:
        """Return the part of the present step that leads back to the first equilibrium, with the solver there; None where it does
        not.

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

    def _may_divide(self, stop_at: str | None) -> bool:
        """Return whether a step with a change that was not located may be divided: to a share of what it was, or to the smallest
        step where the path ends at a critical point."""
        self.undivided = self.undivided or self.step
        return self.step > max(self.smallest, 0.0 if stop_at else FINEST * self.undivided)

    def _lost(self, step: PathStep, what: str, stop_at: str | None) -> None:
        """Add an event about a change within a step that was not located; the next step is as long as before. Raises
        ConvergenceError: the path ends at a critical point, which may be this one."""
        low, high = sorted((step.before[3], step.end[3]))
        text = f"between load factors {low:.12g} and {high:.12g} {what}, but the critical point was not located"
        if stop_at is not None:
            self.solver.restore(step.before)
            result = self.finish()
            raise ConvergenceError(f"{text}, where the path may have to end (stop_at={stop_at!r}). Give another step=, or leave "
                                   "stop_at out and read info['critical_points']; the last equilibrium before is in .state, "
                                   "everything until then in .result", step=self.rows - 1, time=self.length,
                                   state=result.state, result=result)
        self.event("unresolved", self.length, f"{text}; use a smaller largest_step there")
        self.step, self.undivided = self.undivided or self.step, None

    def _note(self, found: CriticalPoint, sign: float) -> None:
        """Keep what is known of a critical point, at which the solver is; sign: that of the change of the load factor behind
        it."""
        solver, length = self.solver.judge, float(self.length + found.size)
        vectors = solver.critical_directions(found.number)
        point: dict[str, Any] = {"kind": found.kind, "load_factor": float(solver.factor), "length": length, "row": self.rows}
        if found.kind == "limit":
            point["type"] = "maximum" if sign < 0.0 else "minimum"
            text = f"limit point ({point['type']}): the load factor turns around there"
        else:
            point["type"] = "unknown" if vectors is None else type_of_bifurcation(solver, vectors, self.first_step, sign)
            text = f"bifurcation ({point['type']}): another path branches off; side= follows it (see solve_path)"
        mode = None if vectors is None else mode_of(solver, vectors[:, 0])
        if mode is not None:
            moves, slides = mode
            node = int(np.argmax(np.linalg.norm(moves, axis=1)))
            point |= {"mode": moves.tolist(), "mode_sliders": slides.tolist(), "mode_at": self.model.node_label(node)}
            text += (f"; its mode has its largest displacement at {point['mode_at']}, "
                     f"({', '.join((f'{x:.2g}' for x in moves[node] + 0.0))})")
        self._keep_point(point, text)

    def _keep_point(self, point: dict[str, Any], text: str) -> None:
        """Add a critical point to the result, with an event."""
        self.info["critical_points"].append(point)
        text = f"load factor {point['load_factor']:.12g}: {text}"
        self.event(point["kind"], point["length"], text)


def _from_chord(point: Array, a: Array, b: Array) -> tuple[float, float]:
    """Return the place of the foot of a point on the chord from a to b, from 0 to 1, and its distance; both as shares of the
    chord."""
    way = b - a
    share = float(way @ (point - a) / (way @ way))
    return share, float(np.linalg.norm(point - a - share * way) / np.linalg.norm(way))
