"""Newton's method for equilibria of scenes with constraints, sliders or joints (theory.md 8): nodes, sliding coordinates and
contact forces in one saddle matrix."""
from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from fastbeam.kernels import loop as kernels
from fastbeam.kernels.loop import NOT_CONVERGED, NOT_FINITE, OK, SINGULAR, SLIDER_END
from fastbeam.kernels.state import State
from fastbeam.linalg.factors import factoriser_for, solver_name
from fastbeam.linalg.saddle import Saddle
from fastbeam.model.mapping import HALF_TURN
from fastbeam.model.maps import RowMap
from fastbeam.model.model import Model
from fastbeam.model.workspace import ReferenceStrains
from fastbeam.statics.equilibrium import StaticSolver
from fastbeam.statics.joint_friction import static_joints
from fastbeam.statics.moving_supports import coordinates_of
from fastbeam.statics.slider_friction import StaticAlong, turned_with_sleeves, with_friction
from fastbeam.statics.steady_motion import SteadyForces
from fastbeam.stepping.assembled import Constraints, Equations, SaddleMatrix, entries_of_matrix
from fastbeam.stepping.iteration import newton_loop

Array = np.ndarray
# a Newton increment moves and turns nodes by this much at most, in sizes of the scene and rad
LARGEST_MOVE = 1.0
# iterations after which those that are tried and do not become smaller are given up
LEAST_PATIENCE = 6
# added to the diagonal of the scaled matrix, one after the other, until no increment is too long
STIFFNESSES = (1e-10, 1e-8, 1e-6, 1e-4, 1e-2)
# share of all loads from which on a force along a motion without stiffness is not round-off; how far nodes follow such a motion
# in one iteration, in sizes of the scene
UNBALANCED, DRIFT = 1e-9, 0.2
EPSILON = 1e-13
NO_SHAPE = np.zeros(0)


class SaddleSolver(StaticSolver):
    """Newton solver for equilibria with constraints: `StaticSolver` around one sparse matrix without elimination of inner nodes,
    factored by PARDISO, or by SuperLU where PARDISO finds no reliable solution.

    max_iterations: largest number of increments of each Newton iteration.
    held: bool [S], sliders that stay at their s.
    at_time: time at which drives are evaluated, s.
    flat: whether to solve in the plane of the scene; default: where it has one and the start lies in it.
    backend: {'auto', 'pardiso', 'superlu'}.
    strains: those of the run, which other solvers share.
    nodes: unknowns of the nodes, which stand first among all.
    places: sliding coordinates among all unknowns; the multipliers stand behind them.
    """

    def __init__(self, model: Model, start: State | None, max_iterations: int, held: Array, flat: bool | None = None,
                 backend: str = "auto", at_time: float = 0.0, strains: ReferenceStrains | None = None) -> None:
        if flat is None:
            flat = model.plane is not None and (start is None or model.plane.holds(start))
        assert model.uneliminated is not None
        uneliminated = model.uneliminated(planar=flat)
        super().__init__(uneliminated, start, max_iterations, "superlu", strains=strains)
        plane = self.stepper.plane
        self.map = RowMap(uneliminated, None if plane is None else plane.axes)
        self.constraints = Constraints(self.stepper)
        core = self.core
        self.nodes = len(core.dofs) * core.pattern.n
        self.places = slice(self.nodes, self.nodes + held.size)
        self._multiplier = np.arange(self.places.stop + core.n_forces) >= self.places.stop
        self._matrix = SaddleMatrix(core.pattern, len(core.dofs), core.n_sliders, core.n_forces)
        self._factoriser = factoriser_for(backend, threads=1)
        self.held = held
        self.lengths, self.ends = uneliminated.slider_lengths, self.stepper.model.limits_at(
            self.stepper.core_state.s, self.stepper.core_state.history)
        self.along = None
        if uneliminated.slider_forces is not None:
            self.along = StaticAlong(uneliminated, at_time, self.stepper.core_state.s, held, self.stepper.core_state.history)
        # prescribed joint coordinates at the start and at the end of the load
        self.given = None
        if core.motions is not None and core.motions.holds.given.size:
            self.given = core.motions.given_between(self.stepper.core_state.history, core.place("motions"), at_time)
        # coordinates that friction or rigid stops may hold, and places of those of joints
        self.joints, self.resting = static_joints(self), np.zeros(0)
        if self.joints is not None:
            self.hold_joints()
        # the slider that ran off its beam, and one at a kink of its curve
        self.runaway = self.stuck = -1
        self.last_s = np.zeros(held.size)
        self._loads = self.work.f_ext.copy()
        # equations of a scene without constraints, and loads with the forces of constraints
        self._without: Equations | None = None
        self._all_loads = self.work.f_ext
        # forces of inertia of a steady motion
        self.steady: SteadyForces | None = None

    def set_time(self, t: float, factor: float) -> None:
        super().set_time(t, factor)
        if self.along is not None:
            self.along.factor = factor
        if self.steady is not None:
            self.steady.share = factor

    def move_to(self, share: float) -> None:
        super().move_to(share)
        if self.along is not None:
            self.along.share = share
        self.hold_joints()

    @property
    def turns_too_far(self) -> bool:
        """True where a prescribed joint angle lies half a turn or more beyond the last equilibrium, so that its direction is
        ambiguous."""
        if self.given is None:
            return False
        holds, ways = self.core.motions.holds, np.zeros(len(self.core.motions.names))
        ways[holds.given] = (self.share - self._reached) * (self.given[1] - self.given[0])
        couplings = self.core.by_key.get("couplings")
        ways = ways if couplings is None else couplings.follow(ways)
        return bool(np.any(np.abs(ways[holds.is_angle]) > HALF_TURN))

    def hold_joints(self) -> None:
        """Prescribe the joint coordinates that are given, and fix those that friction and rigid stops hold."""
        given = [] if self.given is None else [(1.0 - self.share) * self.given[0] + self.share * self.given[1]]
        if self.joints is not None:
            self.joints.hold()
            given.append(self.resting)
        if given:
            self.constraints.given = np.concatenate(given)

    @property
    def name(self) -> str:
        """Linear solver and its number of factorisations, for the result."""
        return solver_name(self._factoriser, "nodes and sliders")

    @cached_property
    def _records(self) -> tuple[Any, Any]:
        """Terms of the scene, and what they share, as compiled code takes them."""
        return self.stepper.records

    @property
    def sliding(self) -> Array:
        """Sliders that are free to move, bool [S]."""
        return ~self.held if self.along is None else self.along.free

    # --- states -------------------------------------------------------------------------------------------------------
    def _saved(self) -> tuple[Array, Array, Array]:
        state = self.stepper.core_state
        return state.q.copy(), state.s.copy(), state.force.copy()

    def _restore(self, saved: tuple[Array, Array, Array]) -> None:
        state = self.stepper.core_state
        state.q[:], state.s[:], state.force[:] = saved

    def _of_constraints(self, rubs: bool = True) -> Equations:
        """Evaluate the equations of the constraints at the present shape, with friction of sliders that slip or without; their
        residuals are kept for messages."""
        if self._without is not None:
            return self._without
        state, contact, along = self.stepper.core_state, self.stepper.contact, self.along
        found = self.constraints.at()
        if contact is None:
            self._without = found
            return found
        if self.core.sleeves is not None:
            found = found._replace(bent=turned_with_sleeves(self.map, self.constraints.angles, self.stepper.state))
        if along is not None:
            found = with_friction(self.constraints, found, along.slip if rubs else np.zeros(state.s.size))
            force, slope = along.known(state.s)
            found = found._replace(sliding=found.sliding - force, bend=found.bend - slope)
        kept = contact.residual[:state.s.size, self.core.dim]
        kept[:] = found.sliding
        kept[self.held if along is None else ~along.free] = 0.0
        return found

    # --- Newton's method ----------------------------------------------------------------------------------------------
    def _assembled(self, sliding: Array, drag: float = 0.0) -> tuple[Saddle, Array]:
        """Assemble tangent and right-hand side with these sliders [S] free; drag: stiffness against their increments, N/m."""
        model, work = self.core, self.work
        size, n = len(model.dofs), model.pattern.n
        equations = self._of_constraints()
        # coordinates in space, for equations that ask for them
        q = self.state.q if self.steady is not None or self.motion is not None else NO_SHAPE
        work.f_ext[:] = self._loads
        if self.steady is not None:
            work.f_ext[:] += self.steady.loads(q)
            equations = equations._replace(bent=equations.bent.with_more(entries_of_matrix(self.steady.stiffness(q))))
        self._all_loads = work.f_ext + equations.loads
        given = None if self.motion is None else self.motion.pending(coordinates_of(self.stepper, self.motion.own))
        if given is None:
            kernels.assemble_all(*self._records, 0.0)
        else:
            x = self.motion.rows(given, model, self.map.axes)
            self.carrying.assemble(self.stepper, self._records[1], x)
        matrix = self._matrix.of(work.blocks, equations, sliding, drag)
        right, gaps = np.zeros(self._multiplier.size), equations.gaps
        r = right[:self.nodes].reshape(n, size)
        r[:] = work.r[:8 * n].reshape(n, 8)[:, :size]
        if given is not None:
            # the rows of held unknowns say 2 x = ...; gaps that the supports open are closed
            r -= 2.0 * x
            gaps = self.motion.opened(self.constraints.gaps_at, q, given) if gaps.size else gaps
        np.negative(r, out=r)
        np.negative(equations.sliding, out=right[self.places], where=sliding)
        right[self.places.stop:] = gaps
        saddle = Saddle(matrix, self._multiplier, self._factoriser)
        saddle.nodes, saddle.free = self.free_motions.nodes, self.hold_free
        return saddle, right

    def _increment(self, sliding: Array, drag: float = 0.0) -> tuple[Array, float, bool] | None:
        """Solve for an increment of all unknowns, arguments as of `_assembled`. Return it, the size of its part of the nodes, and
        whether it is one of Newton's method; None where there is none."""
        saddle, right = self._assembled(sliding, drag)
        n = self.nodes
        if self.free_motions.has_axes:
            saddle = self._with_spins_fixed(saddle, right[:n])
        for stiffness in (0.0, *STIFFNESSES):
            used = saddle.stiffened(stiffness) if stiffness else saddle
            x = used.solve(right)
            if x is None or not np.logical_and.reduce(np.isfinite(x)):
                return None
            if used.unbalanced > 0.0 and used.unbalanced > np.linalg.norm(used.row[:n] * self._round_off(used)):
                # forces push along free motions: follow them a little, sliders too
                size = self._size(used.drift[:n])
                if size > 0.0:
                    x[:self.places.stop] += DRIFT / size * used.drift[:self.places.stop]
            # soft motions grow without bounds: stiffness is added against these alone
            size = self._size(x[:n])
            if size <= LARGEST_MOVE:
                break
        return x, size, stiffness == 0.0

    def _with_spins_fixed(self, saddle: Saddle, right: Array) -> Saddle:
        """Fix one unknown of every beam that may spin about its axis; right: residual of the nodes [n]. Return the fixed
        system."""
        unknowns = self.free_motions.spins(saddle.matrix, self.state.q.reshape(-1, 4, 3), right, lambda: self._round_off(saddle))
        return saddle.holding(unknowns) if unknowns.size else saddle

    def _round_off(self, saddle: Saddle) -> Array:
        """Return the possible round-off in the residuals of the nodes [n]: from loads and contact forces, and from forces in the
        beams."""
        size = len(self.core.dofs)
        n = self.nodes // size
        loads = np.abs(self._all_loads[:8 * n].reshape(n, 8)[:, :size]).reshape(-1)
        stiff = np.abs(saddle.matrix.diagonal()[:self.nodes])
        return UNBALANCED * loads + EPSILON * self.core.length * stiff

    def _size(self, nodes: Array) -> float:
        """Return the size of a nodal increment, in sizes of the scene and rad."""
        x = np.maximum.reduce(np.abs(nodes.reshape(-1, len(self.core.dofs))))
        dim = self.core.dim
        return float(np.maximum.reduce(x[:dim])) / self.core.length + float(np.maximum.reduce(x[dim:], initial=0.0))

    @staticmethod
    def _share(size: float) -> float:
        """Return the share of an increment of the nodes of this size that is not too long."""
        return min(1.0, LARGEST_MOVE / max(size, 1e-300))

    def move(self, x: Array) -> float:
        """Add an increment of all unknowns. Returns its size."""
        state, core, work = self.stepper.core_state, self.core, self.work
        if core.moving is not None:
            # nodes of moving meshes follow the places
            x = x.copy()
            x[:self.nodes] += self.constraints.ways @ x[self.places]
        # arms of tied nodes are those of the present shape, which need not be that of the last equations
        if work.q_end.size:
            work.q_mid[:] = work.q_end[:] = state.q
        # the kernels take half of what solves the equations of half the tangent, and subtract it
        work.panel.reshape(-1, core.width)[:self.nodes, 0] = -2.0 * x[:self.nodes]
        moved = float(kernels.update(*self._records))
        state.s[:] += x[self.places]
        state.force[:] += x[self.places.stop:]
        return moved + float(np.maximum.reduce(np.abs(x[self.places]), initial=0.0)) / core.length

    def _newton(self, sliding: Array, patient: bool = True) -> tuple[int, list[float]]:
        """Iterate by Newton's method with these sliders [S] free; not patient: give up where increments do not become smaller."""
        self.work.increment.control[0] = 0.0
        is_whole, carries = False, self._follows and self._led is None

        def increment() -> tuple[int, float | None]:
            nonlocal is_whole, carries
            found = self._increment(sliding)
            if found is None:
                return self.no_increment, None
            x, size, is_whole = found
            if self.beyond_ends(self.stepper.core_state.s + x[self.places]):
                return SLIDER_END, None
            share = self._share(size)
            is_whole &= share == 1.0
            # forces stand in the equations as they are: whole ones balance the loads whatever nodes do
            x[:self.places.stop] *= share
            size = self.move(x)
            if carries:
                self._led = self.stepper.core_state.q.copy()
            carries = False
            return OK, size

        def after(sizes: list[float]) -> int:
            if self.interrupts.asked:
                self.interrupts.serve()
            return NOT_CONVERGED if not patient and len(sizes) >= LEAST_PATIENCE and sizes[-1] > sizes[0] else OK

        status, sizes = newton_loop(increment, self.max_iterations, after, lambda: is_whole)
        self.longest = max(self.longest, len(sizes))
        return status, sizes

    @property
    def _follows(self) -> bool:
        """True where supports or joints are moved as prescribed, and no slider or joint finds its own place."""
        moves = self.motion is not None or self.given is not None
        return moves and self.joints is None and not self.sliding.any()

    def interrupted(self, _: list[float]) -> int:
        """Serve interrupts between iterations; return OK, nothing else ends them."""
        self.interrupts.serve()
        return OK

    @property
    def no_increment(self) -> int:
        """Status that tells why Newton's method has found no increment."""
        return SINGULAR if np.isfinite(self.work.r).all() else NOT_FINITE

    def beyond_ends(self, s: Array) -> bool:
        """Return whether some slider would run off its beam at s [S]."""
        return bool(np.logical_or.reduce((s < self.ends[:, 0]) | (s > self.ends[:, 1])))
