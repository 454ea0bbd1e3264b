"""Newton's method for equilibria under given loads (theory.md 8): of scenes without sliders, and of scenes with them."""
from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from fastbeam.dynamics.interrupt import Interrupts
from fastbeam.kernels import loop as kernels
from fastbeam.kernels.empty_arrays import empty
from fastbeam.kernels.forces.force_element import ForceElements
from fastbeam.kernels.forces.user_force import UserForces
from fastbeam.kernels.loop import NOT_CONVERGED, NOT_FINITE, OK, SINGULAR
from fastbeam.kernels.state import MORE_ITERATIONS, State
from fastbeam.model.model import Model
from fastbeam.model.workspace import ReferenceStrains
from fastbeam.statics.free_motions import FreeMotions
from fastbeam.statics.moving_supports import Carrying, SupportPath, StaticShift, coordinates_of
from fastbeam.stepping.stepper import Stepper

Array = np.ndarray
# an increment of a fifth of the scene or of 0.8 rad at once is not a Newton step any more
LARGEST_INCREMENT = 4.0
# an equilibrium lies at most so far from the end of its step, as a share of the step, and at all
STRAY, LEAST_STRAY = 0.6, 1e-7
# increments as small as this that do not become smaller may be those of a free motion
DRIFT = 1e-4


def without_potential(model: Model) -> tuple[bool, bool]:
    """Return whether some loads of a model have no potential in space, and whether laws and moving air have none in a plane
    either."""
    turns = any(isinstance(x, (UserForces, ForceElements)) for x in model.links)
    turns |= model.dragged is not None and model.dragged.turns
    return bool(np.logical_or.reduce(model.loads.entries[:, 3:6], axis=None)) or bool(model.user_forces) or turns, turns


class Counts(NamedTuple):
    """Numbers of negative and zero eigenvalues of a tangent."""

    unstable: int            # negative ones
    free: int                # zeros
    names: tuple[str, ...]   # free motions among these


class StaticSolver:
    """Newton solver for equilibria of one model; it keeps the last equilibrium."""

    def __init__(self, model: Model, start: State | None, max_iterations: int, backend: str, threads: int | None = None,
                 strains: ReferenceStrains | None = None) -> None:
        # the tangent lacks as much of symmetry as there is lacking of equilibrium: its symmetric part squares the increments as
        # well, unless moments act (theory.md 8)
        self.moments, self._turns = without_potential(model)
        self.stepper = Stepper(model, np.ones(1), start, max_iterations, backend, threads=threads, static=True,
                               symmetric=not self.moments, strains=strains)
        self.core, self.work, self.max_iterations = self.stepper.core, self.stepper.work, max_iterations
        self.strains = self.stepper.strains
        self.core.stop(self.stepper.core_state)
        self.history: list[int] = []
        # iterations of the last equilibrium, or of the hardest part of it
        self.longest = 0
        self.interrupts = Interrupts()
        # label of what slipped in the last equilibrium without resistance
        self.unresisted = ""
        # supports on their way to where they are at the time of the loads
        self.motion: SupportPath | StaticShift | None = None
        self._carrying: Carrying | None = None
        # part of their path that these, and other prescribed coordinates, have gone
        self.share = 0.0
        # that part at the last equilibrium
        self._reached = 0.0
        # coordinates to which moving supports lead the scene, before Newton's method on all unknowns
        self._led: Array | None = None
        # load factors of the last equilibrium; without loads at the start
        self._factors_before: Any = 0.0
        # whether another equilibrium counts where none is next to these, and load factors and extents of such leaps, in
        # sizes of the scene and rad
        self.may_leap, self.leaps = True, list[tuple[float, float]]()
        self.linear = self.stepper.linear
        self.inner = self.stepper.inner
        if self.stepper.pivots_everywhere:
            self.linear.superlu.free = self.hold_free

    @property
    def name(self) -> str:
        """Linear solver, for the result."""
        return self.linear.name

    @property
    def state(self) -> State:
        """Present shape."""
        return self.stepper.state

    def count_turns(self) -> None:
        """Update turns of coordinates of joints and supports to the present equilibrium."""
        self._reached = self.share
        if self.motion is not None:
            self.motion.count_turns(self.core.turns_of(self.stepper.core_state.history))
        motions = self.core.motions
        if motions is not None:
            motions.settle(self.stepper.core_state, self.state, self.core.place("motions"), None)

    def has_potential(self, in_plane: bool) -> bool:
        """Return whether all loads have a potential: moments fixed in space have one in a plane only, loads by laws never."""
        return not self.moments or in_plane and not self._turns

    def set_time(self, t: float, factor: float) -> None:
        """Set the time and the load factor at which forces by laws, moving air and drives are evaluated."""
        self.stepper.load_at(t, factor)
        if self.core.motions is not None:
            self.core.motions.at_rest(self.stepper.motion, t, factor)

    def move_to(self, share: float) -> None:
        """Set the part of their path that supports and prescribed places of sliders have gone at the next equilibrium."""
        self.share = share
        if self.motion is not None:
            self.motion.share = share

    def _load(self, factors: Array) -> None:
        self.stepper.put_static_loads(factors, self.work.f_ext)

    def load_all(self, factors: Array) -> None:
        """Assemble all loads on nodes at the present shape, under load factors [K], into `work.f_ext`."""
        self._load(factors)

    def equilibrium(self, factors: Array) -> tuple[int, list[float]]:
        """Solve for load factors [K]; on a failure or interrupt the state is the last equilibrium."""
        before = self.stepper.core_state.q.copy()
        self.stepper.forget_failures()
        try:
            return self._equilibrium(factors)
        except BaseException:
            self.stepper.core_state.q[:] = before
            raise

    def _equilibrium(self, factors: Array) -> tuple[int, list[float]]:
        model, state = self.core, self.stepper.core_state
        self._load(factors)
        before = state.q.copy()
        status = self._carry(factors)
        if status != OK:
            state.q[:] = before
            return status, []
        self._led = None if self.motion is None else state.q.copy()
        if self.linear.is_compiled and model.substructures is None:
            buffer = empty(MORE_ITERATIONS * self.max_iterations)
            with self.linear.threads():
                status, n = kernels.solve_equilibrium(*self.stepper.records, self.max_iterations, LARGEST_INCREMENT, buffer)
            sizes = [float(x) for x in buffer[:n]]
        else:
            self.stepper.parts.start(0.0)
            status, sizes = self.stepper.parts.newton(0.0, self.max_iterations, LARGEST_INCREMENT, self.interrupts.serve)
        # round-off moves free motions arbitrarily, so that they have to be held
        drifts = status in (NOT_CONVERGED, NOT_FINITE) and min(sizes, default=1.0) < DRIFT and not self.stepper.pivots_everywhere
        if status == SINGULAR and not self.stepper.pivots_everywhere or drifts and self.fallback.free_motions.may_be:
            state.q[:] = before
            self.fallback.set_time(*self.stepper.law_work[:2])
            self.fallback.motion = self.motion
            status, sizes = self.fallback.equilibrium(factors)
            self._led = self.fallback._led
            self.linear.fallbacks += status == OK
        if status == OK and self._leaps(before, factors):
            status = NOT_CONVERGED
        if status != OK:
            state.q[:] = before
        self.longest = len(sizes)
        return status, sizes

    def _leaps(self, before: Array, factors: Array) -> bool:
        """Return whether the present equilibrium, under load factors [K], is remote and has to be rejected: it lies too far from
        the shape to which moving supports have led the scene, next to the distance of the coordinates `before`. With `may_leap`
        keep it in `leaps` instead. Where loads change too, as on a slack rope, nothing is decided."""
        changed, self._factors_before = np.logical_or.reduce(factors != self._factors_before, axis=None), factors.copy()
        if self._led is None or changed:
            return False
        q, size, dim = self.stepper.core_state.q, 12 if self.stepper.plane is None else 4, self.core.dim
        weight = np.where(np.arange(size) < dim, 1.0 / self.core.length, 1.0) * np.sqrt(size / q.size)
        off, moved = (float(np.linalg.norm((x - self._led).reshape(-1, size) * weight)) for x in (q, before))
        is_other = off > max(STRAY * moved, LEAST_STRAY)
        if is_other and self.may_leap:
            self.leaps.append((self.share, off))
        return is_other and not self.may_leap

    def _carry(self, factors: Array) -> int:
        """Move the scene along with its supports in one iteration; return a status."""
        if self.motion is None:
            return OK
        core, own = self.core, self.motion.own
        given = self.motion.pending(coordinates_of(self.stepper, own))
        if given is None:
            return OK
        if np.isnan(given).any():
            return NOT_CONVERGED
        if self.linear.is_compiled and core.substructures is None and np.all(core.pattern.row_of[own] < core.pattern.n):
            before = self.stepper.core_state.q.copy()
            if self._carried(given) == OK:
                return OK
            self.stepper.core_state.q[:] = before
        if self.stepper.pivots_everywhere:
            return self._carried(given)
        self.fallback.set_time(*self.stepper.law_work[:2])
        self.fallback.motion = self.motion
        self.fallback._load(factors)
        return self.fallback._carried(given)

    def _carried(self, given: Array) -> int:
        """Do one Newton iteration with prescribed increments `given` of the supports, under the loads in `work.f_ext`; return a
        status."""
        stepper = self.stepper
        assert self.motion is not None
        x = self.motion.rows(given, stepper.core, None if stepper.plane is None else stepper.plane.axes)
        terms, system = stepper.records
        kernels.begin(terms, system, 0.0)
        self.carrying.assemble(stepper, system, x)
        # increments are minus half the solution
        rows = stepper.core.rows_in(stepper.work.r)
        rows -= 2.0 * x
        if self.linear.is_compiled:
            kernels.fill_right(terms, system)
            self.linear.begin_step()
            with self.linear.threads():
                good = kernels.all_regular(terms, system) and kernels.solve_right(terms, system)
        else:
            good = stepper.parts.solve()
        if not good:
            return SINGULAR
        return OK if kernels.update(terms, system) < LARGEST_INCREMENT else NOT_FINITE

    @property
    def carrying(self) -> Carrying:
        """Iteration that moves the scene along with its supports."""
        if self._carrying is None:
            assert self.motion is not None
            self._carrying = Carrying(self.stepper, self.motion.own)
        return self._carrying

    def _uneliminated(self, planar: bool) -> StaticSolver:
        uneliminated = self.stepper.model.uneliminated
        assert uneliminated is not None
        other = StaticSolver(uneliminated(planar=planar), self.state, self.max_iterations, "superlu", strains=self.strains)
        other.set_time(*self.stepper.law_work[:2])
        return other

    @cached_property
    def fallback(self) -> StaticSolver:
        """Solver of the same state around SuperLU without elimination of inner nodes, see `Stepper.fallback`."""
        fallback = self._uneliminated(self.stepper.plane is not None)
        fallback.stepper.core_state = self.stepper.core_state
        fallback.interrupts = self.interrupts
        return fallback

    @cached_property
    def free_motions(self) -> FreeMotions:
        """Motions that nothing resists."""
        plane = self.stepper.plane
        return FreeMotions(self.stepper.model, None if plane is None else plane.axes)

    def hold_free(self, matrix: Callable[[], Any]) -> Array:
        """Return one unknown of every free motion at the present shape; matrix: function that returns the tangent by rows."""
        return self.free_motions.find(matrix, self.state.q.reshape(-1, 4, 3))

    def signs(self, factors: Array, in_plane: bool) -> Counts | None:
        """Count negative and zero eigenvalues of the tangent at the last equilibrium, that of load factors [K]: in space, also in
        directions that a planar scene cannot follow, or in its plane. None where moments leave the numbers undecided."""
        if in_plane != (self.stepper.plane is not None) or not self.stepper.pivots_everywhere:
            return self._uneliminated(in_plane).signs(factors, in_plane)
        self._load(factors)
        self.stepper.parts.start(0.0)
        self.stepper.assemble_anew()
        blocks = self.core.blocks_in(self.work.blocks)
        return self.counts(self.linear.superlu.signs(blocks, self.has_potential(in_plane), self.hold_free))

    def counts(self, found: tuple[int, int] | None) -> Counts | None:
        """Return the numbers of negative and of zero eigenvalues, with the names of free motions among the latter."""
        names = self.free_motions.names
        return None if found is None else Counts(*found, names if len(names) <= found[1] else ())
