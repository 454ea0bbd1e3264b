"""Equilibria of scenes with sliders (theory.md 8).

Without friction, and where sliders do not go far, Newton's method on all unknowns leads from one equilibrium to the next. But
a sliding coordinate is only determined once its contact carries a force. Otherwise a load step is found with all sliders held
first; then they are released and slide downhill, the rest of the scene following in equilibrium, until Newton's method on all
unknowns squares its increments. Sliders with friction are released where it cannot hold them, in the direction in which they go
then (`slider_friction.py`).
"""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from fastbeam.kernels.loop import NOT_CONVERGED, OK, SINGULAR, SLIDER_END
from fastbeam.linalg.saddle import Saddle
from fastbeam.statics.constrained import SaddleSolver
from fastbeam.statics.equilibrium import Counts
from fastbeam.statics.slider_friction import RESERVE
from fastbeam.stepping.assembled import Equations

Array = np.ndarray
# a slider moves by this share of its beam at once, and goes this share of the way to an end of it
REACH, TO_END = 0.1, 0.75
# nearer to an end, as a share of the beam, it runs off; increments below this share of the scene are those of Newton's method
AT_END, CLOSE = 1e-6, 1e-9
# increments up to this share of the beam are accepted as those of Newton's method, whose size it squares
NEWTON_FROM = 0.02
MOST_SLIDES = 100
# rounds of deciding which sliders stick, slip and rest against stops, for every slider
ROUNDS = 8
# share of a step below which nothing is found; a slope that jumps from one sign to the other within this share of a beam has no
# place between
LEAST_TRUST, SAME_PLACE = 1e-4, 1e-12
# where Newton's method fails that near to a place that lay too far, the slope jumps
JUMPS = 1e-6


class SlidingSolver(SaddleSolver):
    """Solver for equilibria whose sliders move to where no force pushes them along their beams."""

    def equilibrium(self, factors: Array) -> tuple[int, list[float]]:
        before, status = self.kept(), NOT_CONVERGED
        self.stepper.forget_failures()
        try:
            self._led = None
            status, sizes = self._equilibrium(factors)
            if status == OK and self._leaps(before[0][0], factors):
                status = NOT_CONVERGED
        finally:
            if status != OK:
                self.take_back(before)
        return status, sizes

    def kept(self) -> tuple[Any, ...]:
        """Return everything that a later equilibrium depends on."""
        return (self._saved(), None if self.along is None else self.along.modes.at_stop.copy(),
                None if self.joints is None else (self.joints.values.copy(), self.joints.at_stop.copy()))

    def take_back(self, kept: tuple[Any, ...]) -> None:
        """Return to what `kept` returned."""
        self._restore(kept[0])
        if self.along is not None:
            self.along.modes.at_stop[:] = kept[1]
        if self.joints is not None:
            self.joints.values, self.joints.at_stop = (x.copy() for x in kept[2])

    def _equilibrium(self, factors: Array) -> tuple[int, list[float]]:
        if self.turns_too_far:
            return NOT_CONVERGED, []
        return self._with_sliders(factors) if self.joints is None else self.joints.settle(factors)

    def _with_sliders(self, factors: Array) -> tuple[int, list[float]]:
        self._load(factors)
        self._loads[:] = self.work.f_ext
        self.longest, self.runaway, self.stuck = 0, -1, -1
        along, state = self.along, self.stepper.core_state
        if along is not None:
            state.s[:] = along.begin(state.s)
        status, sizes = self._directly() if along is None else (NOT_CONVERGED, [])
        if status == OK:
            return status, sizes
        status, more = self._newton(np.zeros(self.held.size, bool))
        sizes += more
        for _ in range(ROUNDS * (self.held.size + 1)):
            if status == OK and np.logical_or.reduce(self.sliding):
                status, more = self._release()
                sizes += more
            if status != OK or along is None:
                return status, sizes
            changed, s = along.judge(self._of_constraints(rubs=False), state.s)
            if along.in_circles:
                return NOT_CONVERGED, sizes
            if not changed:
                along.remember(state.history)
                return OK, sizes
            if np.any(s != state.s):
                state.s[:] = s
                status, more = self._newton(np.zeros(s.size, bool))
                sizes += more
        return NOT_CONVERGED, sizes

    def _directly(self) -> tuple[int, list[float]]:
        """Try Newton's method on all unknowns from the last equilibrium, or the start; reject its result where sliders go far.
        Return a status and sizes."""
        free = self.sliding
        if not free.any():
            return NOT_CONVERGED, []
        saved = self._saved()
        # solutions of a singular matrix, which are refused, may be too large for their norms
        with np.errstate(over="ignore"):
            status, sizes = self._newton(free, False)
        way = self.stepper.core_state.s - saved[1]
        if status == OK and np.all(np.abs(way) <= NEWTON_FROM * self.lengths) and self._rises(way):
            return OK, sizes
        self._restore(saved)
        return NOT_CONVERGED, sizes

    def at_rest(self, asked: list[int], factors: Array) -> dict[str, Any]:
        """Report, at the last equilibrium, that of load factors [K], friction of all sliders, and the intervals of rest of those
        that are asked for."""
        of_joints = {} if self.joints is None else self.joints.report()
        if self.along is None or not self.along.rubs.any():
            return {"friction": of_joints} if of_joints else {}
        names = self.stepper.model.names["sliders"]
        out = {"friction": self.along.report(names, self._without_friction()) | of_joints}
        return out | ({"rest_intervals": {names[k]: self._stick_interval(k, factors) for k in asked}} if asked else {})

    def _without_friction(self) -> Equations:
        """Evaluate the equations of the constraints at the last equilibrium, without friction."""
        return self._of_constraints(rubs=False)

    def _stick_interval(self, k: int, factors: Array) -> tuple[float, float]:
        """Find the arc lengths between which slider k rests under load factors [K] by its friction, the others with friction
        staying where they are: from the last equilibrium to both ends, where friction is fully used; NaN where none is found. The
        state is the same after it."""
        self._load(factors)
        self._loads[:] = self.work.f_ext
        before = self._saved()

        def slide(sign: int) -> tuple[int, float]:
            try:
                return self._release()[0], float(self.stepper.core_state.s[k])
            finally:
                self._restore(before)

        return self._where_slip_ends(k, slide)

    def _where_slip_ends(self, k: int, slide: Callable[[int], tuple[int, float]]) -> tuple[float, float]:
        """Return where slider k comes to rest with friction pushing it towards its last and its first place, NaN where nothing is
        found. slide: returns, by the sign of the friction, a status and the arc length there."""
        along, found = self.along, []
        assert along is not None
        modes, along.reserve = [x.copy() for x in along.modes], 0.0
        for sign in (1, -1):
            along.modes.sign[:] = 0
            along.modes.sign[k], along.modes.at_stop[k] = sign, 0
            self.runaway = -1
            try:
                status, s = slide(sign)
                runs_off = status == SLIDER_END and self.runaway == k
                found.append(float(self.ends[k, int(sign < 0)]) if runs_off else s if status == OK else np.nan)
            finally:
                for x, was in zip(along.modes, modes):
                    x[:] = was
        along.reserve = RESERVE
        return found[0], found[1]

    def load_all(self, factors: Array) -> None:
        self._load(factors)
        if self.steady is not None:
            self.work.f_ext[:] += self.steady.loads(self.state.q)

    def signs(self, factors: Array, in_plane: bool) -> Counts | None:
        if in_plane != (self.stepper.plane is not None):
            # where friction or a stop holds a slider, it stays
            t, share = (float(x) for x in self.stepper.law_work[:2])
            other = SlidingSolver(self.stepper.model, self.state, self.max_iterations, ~self._unhindered, in_plane, "superlu", t,
                                  self.strains)
            other.set_time(t, share)
            other.move_to(share)
            return other.signs(factors, in_plane)
        self._load(factors)
        self._loads[:] = self.work.f_ext
        self.work.increment.control[0] = 0.0
        if self.along is not None:
            self.along.modes.sign[:] = 0
        self.constraints.loose = None if self.joints is None else self.joints.loose
        found = self._assembled(self._unhindered)[0].signs(self.has_potential(in_plane))
        self.constraints.loose = None
        return self.counts(found)

    def at_places(self) -> tuple[Saddle, Array]:
        """Return the tangent at the present equilibrium, with spins of beams held and the sliders free that move without friction
        and away from stops, and which these are, bool [S]."""
        self.work.increment.control[0] = 0.0
        saddle, right = self._assembled(self._unhindered)
        return self._with_spins_fixed(saddle, right[:self.nodes]), self._unhindered

    @property
    def _unhindered(self) -> Array:
        """Sliders that move without friction and away from stops, bool [S]."""
        return self.sliding if self.along is None else self.along.free & ~self.along.rubs

    # --- sliding ------------------------------------------------------------------------------------------------------
    def _release(self) -> tuple[int, list[float]]:
        """Go from an equilibrium with all sliders held to one in which free ones do not push along their beams: downhill, F . c'
        being the derivative of the energy by s with the others in equilibrium."""
        descent = _Descent(self)
        for _ in range(MOST_SLIDES):
            status = descent.go_on()
            if status is not None:
                return status, descent.sizes
        return NOT_CONVERGED, descent.sizes

    def _met(self, way: Array, steps: Array) -> Array:
        """Return -1 or 1 for sliders that steps [S] along their increments `way` [S] bring to a rigid stop, else 0."""
        if self.along is None:
            return np.zeros(steps.size, np.int64)
        return self.along.meets(self.stepper.core_state.s, steps, way)

    def _rises(self, way: Array) -> bool:
        """Return whether an equilibrium lies in a valley of the energy and not on a ridge, seen along the increments `way` [S] to
        it."""
        self.work.increment.control[0] = 0.0
        saddle, right = self._assembled(self.sliding)
        saddle = self._with_spins_fixed(saddle, right[:self.nodes])
        right[:] = 0.0
        right[self.places] = np.where(self.sliding, way, 0.0)
        x = saddle.solve(right)
        return x is None or bool(way @ x[self.places] >= 0.0)

    def _steps(self, s: Array, slope: Array, beyond: Array) -> tuple[Array, int]:
        """Return increments of the sliding coordinates, none too long, none beyond an end, and half the way to places [S] that
        lay too far (NaN: none is known); and a slider that stands at the end that it is pushed to, or -1."""
        now = self.stepper.core_state.s
        to_end = np.where(s > 0.0, self.ends[:, 1] - now, now - self.ends[:, 0])
        rigid = np.zeros(s.size, bool) if self.along is None else self.along.is_rigid(s)
        out = np.flatnonzero((to_end <= AT_END * self.lengths) & (np.abs(s) > to_end) & (slope * s < 0.0) & ~rigid)
        if out.size:
            return s.copy(), int(out[0])
        most = np.minimum(REACH * self.lengths, np.where(rigid, 1.0, TO_END) * to_end)
        most = np.where((beyond - now) * s > 0.0, np.minimum(most, 0.5 * np.abs(beyond - now)), most)
        if self.along is not None:
            # an elastic stop is stiff from where it begins
            most = np.minimum(most, self.along.to_stop(now, s))
        steps = np.clip(s, -most, most)
        if not slope @ steps < 0.0:
            steps = s * float(np.min(np.where(np.abs(s) > most, most / np.where(s == 0.0, 1.0, np.abs(s)), 1.0)))
        return steps, -1


class _Descent:
    """Free sliders on their way downhill, the rest of the scene following in equilibrium. What goes on returns a status where the
    way ends, else None.

    sizes: of the increments.
    drag, trust: by how much increments are kept from going uphill; share of an increment that is taken.
    near: increments up to this share of the beams are tried as those of Newton's method.
    beyond: float64 [S], places that lay too far, from where the sliders came; NaN: none is known.
    is_probed: whether a step was taken since Newton's method failed close by.
    """

    def __init__(self, solver: SlidingSolver) -> None:
        self.solver, self.state = solver, solver.stepper.core_state
        self.sizes: list[float] = []
        self.drag, self.trust, self.near, self.is_probed = 0.0, 1.0, NEWTON_FROM, False
        self.beyond = np.full(solver.held.size, np.nan)

    def go_on(self) -> int | None:
        """Take the next increment, by Newton's method on everything or downhill."""
        solver = self.solver
        # less those that have come to a rigid stop
        free = solver.sliding
        if not free.any():
            return OK
        solver.work.increment.control[0] = 0.0
        found = solver._increment(free, self.drag)
        if found is None:
            return SINGULAR
        x, size, _ = found
        s = x[solver.places]
        slope = np.where(free, solver._of_constraints().sliding, 0.0)
        largest = float(np.max(np.abs(s) / solver.lengths))
        close = largest * float(np.max(solver.lengths)) <= CLOSE * solver.core.length
        work = float(slope @ s)
        if not close and not work < 0.0:
            # uphill, to where it is steepest or highest: as much against it as turns the increment round
            self.drag = max(4.0 * self.drag, 2.0 * abs(work) / float(s @ s) + self.drag)
            return None
        saved = solver._saved()
        status = None
        if close or (largest <= self.near and self.drag == 0.0):
            status = self._arrive(s, free, largest, close, saved)
        return self._slide(x, size, free, slope, saved) if status is None else status

    def _arrive(self, s: Array, free: Array, largest: float, close: bool, saved: Any) -> int | None:
        """Try Newton's method on everything. largest: share of the beams of the increment s [S]; close: whether it is one of
        Newton's method."""
        solver = self.solver
        status, more = solver._newton(free, close)
        self.sizes += more
        way = self.state.s - saved[1]
        if status == OK and (close or (np.all(np.abs(way) <= 4.0 * largest * solver.lengths) and solver._rises(way))):
            return OK
        solver._restore(saved)
        if not close or (status == SLIDER_END and solver._met(s, s).any()):
            self.near = 0.25 * largest
            return None
        off = np.nan_to_num(np.abs(self.beyond - self.state.s) / solver.lengths, nan=1.0)
        if np.min(off) <= JUMPS:
            return self._stick(int(np.argmin(off)), self.state.s.copy())
        if self.is_probed:
            return NOT_CONVERGED if status == SLIDER_END else status
        # a short step tells whether the slope jumps there
        self.is_probed = True
        return None

    def _slide(self, x: Array, size: float, free: Array, slope: Array, saved: Any) -> int | None:
        """Take a step downhill, and go back where it leads uphill. size: of the part of the nodes of the increment x."""
        solver, along, state = self.solver, self.solver.along, self.state
        s = x[solver.places]
        steps, out = solver._steps(s, slope, self.beyond)
        steps *= self.trust
        met = solver._met(s, steps)
        if out >= 0:
            solver.runaway = out
            return SLIDER_END
        share = float(np.max(np.abs(steps)) / np.max(np.abs(s)))
        share *= solver._share(share * size)
        x *= share
        s[:] = steps
        self.sizes.append(solver.move(x))
        status, more = solver._newton(np.zeros(free.size, bool))
        self.sizes += more
        after = np.where(free, solver._of_constraints().sliding, 0.0) * steps if status == OK else np.full(free.size, np.inf)
        if float(np.sum(after)) <= 0.9 * abs(float(slope @ steps)):
            self.trust, self.drag = min(1.0, 2.0 * self.trust), 0.0
            if along is not None:
                along.meet(met, state.s)
            return None
        gone = state.s.copy()
        solver._restore(saved)
        if status != OK:
            self.trust *= 0.25
            return status if self.trust < LEAST_TRUST else None
        self.beyond = np.where(after > 0.0, gone, self.beyond)
        k = int(np.argmax(after))
        return self._stick(k, gone) if abs(gone[k] - state.s[k]) <= SAME_PLACE * solver.lengths[k] else None

    def _stick(self, k: int, s: Array) -> int:
        """Note that slider k finds no place next to s, where the slope jumps."""
        self.solver.stuck, self.solver.last_s = k, s
        return SLIDER_END
