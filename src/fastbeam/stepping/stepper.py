"""Steppers, which take a model's state over steps, in the compiled loop with block elimination or with a sparse solver."""
from __future__ import annotations

from collections.abc import Callable
from functools import cache
from operator import is_
from typing import Any

import numpy as np

from fastbeam.interface.arguments import count, number
from fastbeam.interface.errors import ConvergenceError, SceneError
from fastbeam.kernels import loop as kernels
from fastbeam.kernels.call_tables import AT_REST, EVERYTHING, ITERATION, Calls, SystemRecord, Table, system_record
from fastbeam.kernels.contact.coulomb import begin_fallback
from fastbeam.kernels.contact.slider_forces import AGAINST, FREE, HELD, SIGN, STICKS
from fastbeam.kernels.empty_arrays import aligned_empty, empty
from fastbeam.kernels.entries.dense import Contact
from fastbeam.kernels.entries.factored import FactoredContact
from fastbeam.kernels.forces.user_force import UserForceTimes
from fastbeam.kernels.jit.decorators import announce_first_use
from fastbeam.kernels.jit.records import Record, same_record
from fastbeam.kernels.linalg.constraints import Constraints
from fastbeam.kernels.loop import BORDER_SINGULAR, CYCLES, LARGEST_IN_TIME, NOT_CONVERGED, NOT_FINITE, OK, SINGULAR, SLIDER_END
from fastbeam.kernels.measures import slider_motion
from fastbeam.kernels.state import MORE_ITERATIONS, State
from fastbeam.kernels.terms import AtRest, Conserving, Equilibrium, Loads, Midpoint, System, put_loads
from fastbeam.linalg.linear_system import LinearSystem, check_backend
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.contact.sleeve_twist import start_twisting
from fastbeam.model.feature import Feature, OfRun, Span, Stand
from fastbeam.model.forces.failed_laws import FINITE_NUMBERS, Failure, acting_at, failure_in, forget, has_failed
from fastbeam.model.forces.loads import load_factors
from fastbeam.model.maps import spins
from fastbeam.model.model import Model
from fastbeam.model.released_supports import own_supports
from fastbeam.model.start import own_state
from fastbeam.model.workspace import (
    Capacity,
    ReferenceStrains,
    border_is_slow,
    capacity_of,
    contact_of,
    factored_contact_of,
    inner_of,
    larger_capacity,
    law_work,
    work_of,
)
from fastbeam.stepping.condensed import CondensedIteration, thread_count
from fastbeam.stepping.constraint_rows import constraints_of
from fastbeam.stepping.constraint_matrix import MatrixIteration, MatrixSystem
from fastbeam.stepping.iteration import LEFT, Iteration
from fastbeam.stepping.methods import Scheme, empty_rates, start_rates
from fastbeam.stepping.outcome import Outcome
from fastbeam.stepping.terms import Corner, Growing, put_limits, system_of, terms_of

Array = np.ndarray
# factor of theory.md (5.5), chosen by docs/reports/stress.md
AUGMENTATION = 1e7
# a force moves nothing where the compliance of its parts is below this share of h^2/(mass of the scene)
LEAST_COMPLIANCE = 1e-14
# work arrays in the order of the nodes and sliders, whatever the order of the rows
BY_NODE = ("dphi", "theta", "q_mid", "q_end", "u", "s_end", "keep_q", "keep_v", "keep_s", "keep_force",
           "keep_dphi", "keep_theta", "past", "keep_past")
# the cache folder is looked through once a process
_announce = cache(announce_first_use)
# a start whose supports have turned as far as their functions, rad
SAME_TURN = 1e-9


class Stepper:
    """Stepper of one model; it owns the state and the work arrays.

    weights: float64 [m], substeps of a step as fractions of it (theory.md 6).
    state: start from here instead of the model's initial state.
    max_iterations: Newton iterations a substep.
    backend: {'auto', 'pardiso', 'superlu'}, sparse solver, where the model needs one.
    t: time of the state, s; some methods need the loads there.
    memory: as `memory` gave it; default: consistent with the state.
    augmentation: factor of the augmented Lagrangian of sliders (theory.md 5.5); 0: plain multipliers.
    threads: threads for condensed beams (default: see `thread_count`) and for PARDISO.
    static, symmetric: for statics: loads that change, PARDISO's symmetric factorisation.
    strains: those of the run, which several steppers may share.
    in_matrix: for a model without eliminated nodes: nodes and constraints are one sparse matrix.
    Raises SceneError: the state is not one of this model, max_iterations, backend or augmentation is not usable.
    """

    def __init__(self, model: Model, weights: Array, state: State | None = None, max_iterations: int = 25,
                 backend: str = "auto", method: Scheme = Scheme(), t: float = 0.0, memory: Array | None = None,
                 augmentation: float = AUGMENTATION, threads: int | None = None, static: bool = False,
                 symmetric: bool = False, strains: ReferenceStrains | None = None, in_matrix: bool = False) -> None:
        check_backend(backend)
        self.max_iterations = count("max_iterations", max_iterations)
        _announce()
        self.in_matrix, self.method, self._static = in_matrix, method, static
        self.model = model = self._form_of(model)
        self.strains = strains or ReferenceStrains()
        self.weights = np.ascontiguousarray(weights, dtype=float)
        start = None if state is None else own_state(model, state)
        self.augmentation = number("augmentation", augmentation)
        if self.augmentation != 0.0 and not 1.0 <= self.augmentation <= 1e12:
            raise SceneError(f"augmentation: must be 0 (plain multipliers) or from 1 to 1e12, got {augmentation:g}; the default "
                             f"is {AUGMENTATION:g}")
        self._choose_core(start, memory)
        core = self.core
        self._make_arrays()
        condensed = core.substructures is not None
        if condensed or threads is not None:
            threads = thread_count(threads, core.condensed_elements)
        self.linear = MatrixSystem(core.pattern, backend, len(core.dofs)) if self.in_matrix else LinearSystem(
            core.pattern, core.columns, backend, len(core.dofs), threads, reproducible=condensed, symmetric=symmetric)
        self.alpha = empty_rates(method, model.n_nodes)
        self._more_turns: Array | None = None
        self._check_analyses()
        # arrays of this run, by the keys of features
        self.own = {x.key: x.work(core, self.plane, static) for x in core.features}
        self._scheduled = [x for x in core.features if type(x).schedules is not Feature.schedules]
        if self.motion is not None and memory is None:
            core.motions.settle(self.core_state, self.state, core.place("motions"), None if static else t)
        # of user forces: the time in the middle of a step, and the load factor in statics
        self.law_work = law_work()
        self.terms = terms_of(OfRun(core, static, self.inner, self.own, self.law_work))
        self.corner: Corner | None = None  # a slider on its way over a corner of a switch
        self.growing = Growing(core, self.terms) if static else None
        put_limits(core, self.core_state, None, self.terms)
        self.parts = (CondensedIteration(self, threads) if condensed and threads else
                      MatrixIteration(self) if self.in_matrix else Iteration(self))
        self._factors = np.ones((1, len(model.load_times)))
        self.made_fallback: Stepper | None = None  # once a step has needed it
        self._calls: Calls | None = None
        self._records: tuple[Any, Any] = None, None
        # what they were made of
        self._recorded: tuple[Any, ...] = (None,) * 8
        # asked between the iterations of a loop in Python: whether to leave, with the state before the step
        self.stop: Callable[[], bool] = bool
        mass = float(np.add.reduce(model.gravity_weight)) + (0.0 if model.moving is None else model.moving.mass)
        self._least = LEAST_COMPLIANCE * float(np.minimum.reduce(np.abs(weights)))**2 / mass if mass > 0.0 else np.inf
        self._timed = any(t is not None for t in model.load_times)
        self._put_first_loads(t)
        if self.alpha is not None and memory is None:
            start_rates(model, self.alpha, self.core_state, self._rows_at_rest)
        if self.along is not None:
            core.slider_forces.check_start(t, self.core_state.s, core.along_of(self.core_state.history))
        if memory is not None:
            self.memory = memory
        elif self.along is not None:
            self._start_sliding()

    def _form_of(self, model: Model) -> Model:
        """Return the form of a model that suits the method and its constraints."""
        if self.method.is_compared and model.substructures is not None and model.uncondensed is not None:
            return model.uncondensed()
        if not self._static and border_is_slow(model):
            assert model.uneliminated is not None
            self.in_matrix = True
            return model.uneliminated(planar=model.plane is not None)
        return model

    def _choose_core(self, start: State | None, memory: Array | None) -> None:
        """Choose the model whose equations are solved, that in space or that in its plane, and reduce the start to it."""
        model = self.model
        # the methods for comparison run in space, so does a state that left the plane of its scene, and what went on from there
        flat = model.plane is not None and not self.method.is_compared
        from_space = memory is not None and memory.size == model.past_size + 6 * model.n_nodes
        self.plane = model.plane if flat and not from_space and (start is None or model.plane.holds(start)) else None
        core: Model = model if self.plane is None else self.plane.model
        self.core_state = core.state() if start is None else start if self.plane is None else self.plane.reduce(start)
        core, self.supports = own_supports(core, self.core_state, self._static)
        self.core = core
        # a plane may leave none of the constraints
        self.in_matrix = self.in_matrix and core.n_constraints > 0

    def _make_arrays(self) -> None:
        """Make the work arrays of nodes and constraints."""
        core, rates = self.core, self.method.at_end
        # a step in one piece changes the state when it is done
        keep = self.weights.size > 1 or core.n_constraints > 0 or core.moving is not None or rates
        self.work = work_of(core, keep, rates, self.strains, self.in_matrix)
        self.inner = inner_of(core)
        # sliders alone, as rows of the block matrix
        self._factored = (core.by_rows and core.n_constraints == core.n_sliders and core.moving is None
                          and not (self.method.is_compared or self._static))
        self.rows: Constraints | None = None
        if core.by_rows and not self._static:
            self.capacity = capacity_of(core)
            self.contact = self._contact_of(self.capacity.entries)
            self._make_rows(self.capacity)
        else:
            self.contact = contact_of(core, at_rest=self._static, in_matrix=self.in_matrix)

    def _check_analyses(self) -> None:
        """Refuse a model that does not go with the method or the substeps. Raises SceneError."""
        if self.method.is_compared:
            require(Analysis.COMPARED, self.model, f"method {self.method.name!r}")
        if self.weights.size > 1:
            require(Analysis.ORDER_4, self.model)
            require(Analysis.COMPOSED, self.model)

    def _put_first_loads(self, t: float) -> None:
        """Put the loads where steps read them: those that stay as they are, or those at time t that rates begin with."""
        core, model = self.core, self.model
        if self._timed:
            if self.alpha is not None:
                kernels.external_forces(model.loads, load_factors(model, np.full(1, t), np.zeros(1))[0], self.work.f_ext)
        elif len(core.load_times) == 1 and not self._static:
            self.work = self.work._replace(f_ext=core.loads.first)
        elif model.load_times:
            kernels.external_forces(core.loads, self._factors[0], self.work.f_ext)

    @property
    def along(self) -> Any:
        """Forces along the beams of sliders with the arrays of this run, or None."""
        return self.own.get("slider_forces")

    @property
    def prescribed(self) -> Any:
        """Supports that move with the arrays of this run, or None."""
        return self.own.get("prescribed")

    @property
    def motion(self) -> Any:
        """Coordinates of joints with the arrays of this run, or None."""
        return self.own.get("motions")

    def put_static_loads(self, factors: Array, out: Array) -> None:
        """Put the sum of all load vectors with factors [K] in an equilibrium into `out`, and gravity on moving meshes where they
        read it."""
        kernels.external_forces(self.core.loads, factors, out)
        if self.core.moving is not None:
            self.put_gravity(factors)

    def put_gravity(self, factors: Array) -> None:
        """Let gravity on moving meshes have the factor that it has among those of all loads, [K]."""
        self.core.moving.put_gravity(self.own["moving"], self.core.load_times, factors)

    def load_at(self, t: float, factor: float, shares: Array | None = None) -> None:
        """Set the time, s, and load factor of forces by laws, moving air and ropes, in statics; shares: as of `Growing.put`."""
        self.law_work[:2] = t, factor
        assert self.growing is not None
        self.growing.put(t, factor, shares)

    def _start_sliding(self) -> None:
        """Set the slip directions of sliders with Coulomb friction from their velocities. Sliders that a run before left at rest,
        held by friction or against a stop, stay there: their velocity is a remainder of second order of the step in which they
        came to rest."""
        model, state = self.model, self.state
        rates, contact = empty(model.n_sliders), contact_of(model)
        slider_motion(model.curves, model.sliders, contact, state, empty(3 * model.n_sliders), rates)
        moving = np.abs(rates) > 1e-12 * np.max(np.abs(self.core_state.v), initial=0.0)
        own = model.along_of(self.core_state.history)
        moving &= (own[:, AGAINST] == 0.0) & (own[:, STICKS] == 0.0) & (own[:, HELD] == FREE)
        own[:, SIGN] = np.where(moving, np.sign(rates), 0.0)
        start_twisting(model, self.core_state.history, *(x.reshape(-1, 4, 3) for x in state[:2]), state.s)

    @property
    def state(self) -> State:
        """Present state: the arrays themselves, or what they mean in space where the run is planar."""
        return self.core_state if self.plane is None else self.plane.expand(self.core_state)

    @property
    def recorded(self) -> int:
        """Number of forces in an outcome."""
        return self.model.n_forces

    @property
    def memory(self) -> Array:
        """Copy of what a run carries besides the state: rates of the method, mean rates of the last two steps, the newest as
        increments, and the state as a planar run keeps it."""
        rates, past, *increments = self._remembered
        if past[3] == 0.0:
            # these are no rates but remainders of a failed step
            increments[:2] = (np.zeros_like(x) for x in increments[:2])
        return np.concatenate((rates, past, *increments))

    @property
    def system(self) -> System:
        """Data that all terms share in compiled code."""
        method: Any = Conserving() if self.method.middle is None else Midpoint()
        if self.alpha is not None:
            method = self.alpha
        if self._static:
            method = Equilibrium()
        solver = self.linear.tables if self.core.pattern.plan is None else self.rows or self.core.pattern.plan
        return system_of(self.core, method, self.contact, solver if self.linear.is_compiled else None,
                         self.core_state, self.work, 1 if self.in_matrix else None)

    @property
    def records(self) -> tuple[Table, SystemRecord]:
        """The terms and what they share, as compiled loops take them."""
        of = self.terms, self.core, self.contact, self.rows, self.core_state, self.work, self.alpha, self.linear.tables
        if not all(map(is_, of, self._recorded)):
            calls, (_, system) = self._calls, self._records
            if calls is None or not same_record(self.terms, calls.terms):
                calls = self._calls = Calls(self.terms, ITERATION if self._static else EVERYTHING)
            self._records, self._recorded = calls.on(system_record(self.system, system)), of
        return self._records

    @property
    def _remembered(self) -> tuple[Array, ...]:
        """The parts of `memory`."""
        rates = np.zeros(0) if self.alpha is None else self.alpha.rates[:18 * self.model.n_nodes]
        own = () if self.plane is None else self.core_state
        return rates, self.work.past, self.work.dphi, self.work.theta, *own

    @memory.setter
    def memory(self, memory: Array) -> None:
        parts = self._remembered
        sizes = [x.size for x in parts]
        if memory.size != sum(sizes):
            raise SceneError(f"start: the checkpoint has {memory.size} numbers besides the state, but method "
                             f"{self.method.name!r} needs {sum(sizes)}; continue with the method that wrote it, or with "
                             "start=Start(checkpoint.state, time=checkpoint.t)")
        for mine, other in zip(parts, np.split(memory, np.cumsum(sizes)[:-1])):
            mine[:] = other

    def _rows_at_rest(self, u: Array) -> Array:
        """Return rows [N, 6] of the nodes' equations for second rates u of the coordinates, without contact forces."""
        model, work = self.model, self.work
        work.u[:] = u
        system = self.system._replace(method=AtRest())
        whole = Calls(terms_of(OfRun(model)), AT_REST).on(SystemRecord(system, AT_REST))
        kernels.begin(*whole, 0.0)
        kernels.assemble_all(*whole, 0.0)
        return work.r[:8 * model.n_nodes].reshape(-1, 8)[model.pattern.row_of, :6].copy()

    def _contact_of(self, entries: int) -> Contact | FactoredContact | None:
        """Allocate work arrays of the constraints, with room for so many entries each."""
        return factored_contact_of(self.core, entries) if self._factored else contact_of(self.core, entries)

    def _make_rows(self, capacity: Capacity) -> None:
        """Allocate work arrays of sliders as rows of the block matrix."""
        assert self.contact is not None
        self.capacity = capacity
        self.rows = rows = constraints_of(self.core, self.inner, capacity.entries, capacity.scale, capacity.targets)
        if capacity.buffer > rows.buffer.size:
            self.rows = rows._replace(buffer=aligned_empty(capacity.buffer))
        self.work = self.work._replace(blocks=rows.factors.store[:rows.couplings.end[0]])
        if self.contact.row.shape[1] != capacity.entries:
            old, self.contact = self.contact, self._contact_of(capacity.entries)
            assert self.contact is not None
            self.contact.augmented[:], self.contact.element[:] = old.augmented, old.element

    def _enlarge(self) -> None:
        """Make more room for sliders as rows, of the kind that was too short."""
        assert self.contact is not None and self.rows is not None
        self._make_rows(larger_capacity(self.core, self.capacity, self.contact, self.rows))

    @property
    def pivots_everywhere(self) -> bool:
        """True where SuperLU solves for all unknowns, so that no fallback is left."""
        return self.inner is None and self.core.substructures is None and not self.linear.is_compiled

    @property
    def fallback(self) -> Stepper:
        """Stepper with the same state and first guesses around SuperLU, without elimination of inner nodes, for vanishing
        pivots."""
        if self.made_fallback is None:
            assert self.model.uneliminated is not None
            fallback = Stepper(self.model.uneliminated(planar=self.plane is not None), self.weights, None, self.max_iterations,
                               "superlu", self.method, memory=self.memory, augmentation=self.augmentation,
                               strains=self.strains, in_matrix=True)
            fallback.core_state, fallback.alpha = self.core_state, self.alpha
            put_limits(self.core, self.core_state, self.corner, fallback.terms)
            fallback.work = fallback.work._replace(**{name: getattr(self.work, name) for name in BY_NODE},
                                                   increment=fallback.work.increment._replace(theta=self.work.theta))
            self.made_fallback = fallback
        return self.made_fallback

    def save(self) -> tuple[State, Array]:
        """Return everything that a later `load` needs."""
        return self.copy_state(), self.memory

    def load(self, saved: tuple[State, Array]) -> None:
        """Restore what `save` returned."""
        self.set_state(saved[0])
        self.memory = saved[1]

    def copy_state(self) -> State:
        """Return a copy of the present state."""
        return State(*(x.copy() for x in self.state))

    def set_state(self, state: State) -> None:
        """Go (back) to a state, without memory of steps before it."""
        self.work.past[0] = 0.0
        for mine, other in zip(self.core_state, state if self.plane is None else self.plane.reduce(state)):
            mine[:] = other
        put_limits(self.core, self.core_state, self.corner, self.terms, self.made_fallback and self.made_fallback.terms)

    @property
    def failed_law(self) -> Failure:
        """User's law that failed in the last attempt, and its failure."""
        return failure_in(self.core, self.terms, self.law_work)

    def label_of(self, node: int) -> str:
        """Return the label of a node for messages about failures, with the user's laws that act there."""
        return self.model.node_label(node) + acting_at(self.core, self.terms, node)

    def blamed(self, error: ConvergenceError, text: str, rest: str) -> ConvergenceError:
        """Return the error of an attempt; it names a law of the user's own where one has failed.

        text: text that names the attempt.
        rest: text that tells where the results are.
        """
        failed = self.failed_law
        if failed.text:
            error.args = (f"{text}: {failed.text}{FINITE_NUMBERS} {rest}",)
            error.__cause__ = failed.error
        return error

    def forget_failures(self) -> None:
        """Forget failed laws before an attempt."""
        forget(self.terms, self.law_work)

    def assemble_anew(self) -> None:
        """Assemble residual and tangent of the present shape at rest. Raises SceneError: a law of the user's own has failed."""
        self.forget_failures()
        self.parts.assemble(0.0)
        self.check_laws()

    def check_laws(self) -> None:
        """Refuse equations that laws have put no numbers into. Raises SceneError: names the law, its time and what it was
        given."""
        if has_failed(self.terms, self.law_work):
            failed = self.failed_law
            raise SceneError(failed.text) from failed.error

    def advance(self, t: float, h: float, n: int, done: int = 0) -> Outcome:
        """Take n steps of size h, the first from time t + done*h: times do not depend on how a run is cut into calls. On a
        failure or event the state is the one before that step. Fewer steps without either mean that `stop` said so."""
        self.begun = False  # whether the state may have changed
        result = self._run(t, h, n, done)
        while result.status == OK and result.steps < n and not self.stop():
            result = self._run(t, h, n - result.steps, done + result.steps).after(result)
        if self.prescribed is not None and self.core.prescribed.history_size:
            self._count_turns(t + h * done, t + h * (done + result.steps))
        return result

    @property
    def is_alone(self) -> bool:
        """True where steps are one call of the compiled loop, with loads that stay and nothing else that depends on time."""
        return (self.linear.is_compiled and self.core.substructures is None and self.contact is None and not self._timed
                and not self._scheduled and not self.core.laws)

    def take(self, t: float, h: float, n: int, done: int, record: Record) -> Array | None:
        """Take n steps in one call that keeps states on the way in a record of `Recorded`: return the iterations before each of
        them and behind the last; None, and any state, where one fails."""
        counts, sizes = np.zeros(5 + n, np.int64), empty(MORE_ITERATIONS * self.max_iterations)
        with self.linear.threads():
            table, system = self.records
            table.give((record,))
            kernels.run(table, system, self.weights, h, n, self.max_iterations, counts, sizes, empty((2, 0)))
            table.give(())
        return np.append(counts[5:], counts[2]) if counts[0] == OK else None

    def _count_turns(self, begin: float, end: float) -> None:
        """Write into the history how far supports have turned since t = 0 at `end`. A difference between the state of the start
        and their functions, at `begin`, stays."""
        now = self.core.turns_of(self.core_state.history)
        if self._more_turns is None:
            more = now - self.core.prescribed.vectors(begin)
            self._more_turns = np.where(np.abs(more) > SAME_TURN, more, 0.0)
        now[:] = self.core.prescribed.vectors(end) + self._more_turns

    def _run(self, t: float, h: float, n: int, done: int) -> Outcome:
        """Run steps as `advance`, but return after a step that was repeated."""
        model = self.core
        self._augment(h)
        self.forget_failures()
        counts, sizes = np.zeros(5, np.int64), empty(MORE_ITERATIONS * self.max_iterations)
        force = empty((2, self.core_state.force.size))
        loads, factors = None, self._factors
        if self._timed:
            span = self._span(t, h, n, done)
            starts, lengths = span.starts, span.lengths
            if self.method.at_end:
                starts, lengths = starts + h, np.zeros(n)
            loads, factors = model.loads, load_factors(model, starts, lengths)
        schedules = self._schedules(t, h, n, done)
        self.begun = True
        if self.linear.is_compiled and model.substructures is None:
            with self.linear.threads():
                table, system = self.records
                if loads is not None:
                    schedules = *schedules, Loads(loads, factors)
                if schedules or self._scheduled:
                    table.give(schedules)
                kernels.run(table, system, self.weights, h, n, self.max_iterations, counts, sizes, force)
            result = Outcome(int(counts[0]), int(counts[1]), int(counts[2]), int(counts[3]), sizes, self._in_space(force))
        else:
            result = self._python_run(factors if self._timed else None, h, n, schedules)
        reached = result.steps
        if self.rows is not None and self.rows.factors.failed[0]:
            # the step is discarded: rows of a run do not depend on when there was room
            self._enlarge()
            result.iterations = int(counts[4])
            return self._run(t, h, 1, done + reached).after(result)
        if result.status not in (SINGULAR, NOT_CONVERGED, NOT_FINITE, BORDER_SINGULAR):
            if has_failed(self.terms, self.law_work):
                # when a step was done: its work is not known
                result.status = NOT_FINITE
            return result
        # the failed step once more, from a first guess that relies less on the past, at last with pivoting across all unknowns
        past = self.work.past
        if past[0]:
            known, past[0] = past[0], past[0] - 1.0
            fresh = self._run(t, h, 1, done + reached)
            if fresh.status in (OK, SLIDER_END):
                return fresh.after(result)
            past[0] = known
            return Outcome(fresh.status, reached, result.iterations + fresh.iterations, fresh.slider, fresh.sizes, result.force)
        if self.pivots_everywhere:
            return result
        self.fallback._augment(h)
        at = reached * self.weights.size
        pivoting = self.fallback._python_run(factors[at:] if self._timed else None, h, 1,
                                             self.fallback._schedules(t, h, 1, done + reached))
        if pivoting.status not in (OK, SLIDER_END):
            return result
        if self.motion is not None and self.motion.friction is not None:
            self.motion.friction.reached[:] = self.fallback.motion.friction.reached
        self.linear.fallbacks += pivoting.status == OK
        return pivoting.after(result)

    def _schedules(self, t: float, h: float, n: int, done: int) -> tuple[Any, ...]:
        """Collect the schedules of terms for n steps; empty where nothing depends on time."""
        if not self._scheduled and not self.core.laws:
            return ()
        span = self._span(t, h, n, done)
        found = [part for feature in self._scheduled for part in feature.schedules(span)]
        if self.core.laws:
            found.append((Stand.LINKS, UserForceTimes(self.law_work, span.starts + 0.5 * span.lengths)))
        return tuple(schedule for _, schedule in sorted(found, key=lambda x: x[0]))

    def _span(self, t: float, h: float, n: int, done: int) -> Span:
        return Span(self.own, self.terms, self.plane, self.weights, t, h, n, done)

    def _in_space(self, force: Array) -> Array:
        return force if self.plane is None or not self.model.n_forces else np.stack([self.plane.forces(x) for x in force])

    def _augment(self, h: float) -> None:
        """Set the augmented Lagrangian for steps of size h, and supports as the state has them."""
        self.supports.follow(self)
        if self.contact is None:
            return
        self.contact.augmented[:2] = 1.0 / self.augmentation if self.augmentation else 0.0, self._least * h**2

    def _python_run(self, factors: Array | None, h: float, n: int, schedules: tuple[Any, ...] = ()) -> Outcome:
        """Run n steps in a loop in Python, around SuperLU or on several threads."""
        state, work, parts = self.core_state, self.work, self.parts
        force, iterations, sizes = np.zeros((2, state.force.size)), 0, np.zeros(0)
        for k in range(n):
            parts.keep()
            last, status, slider = np.zeros(state.force.size), OK, -1
            for m, weight in enumerate(self.weights):
                at = k * self.weights.size + m
                self._put_loads(factors, schedules, at)
                status, sizes = (LEFT, np.zeros(0)) if k + m > 0 and self.stop() else self._python_step(weight * h)
                iterations += len(sizes)
                if status == CYCLES:
                    begin_fallback(work.increment)
                    status, sizes = self._newton(weight * h)
                    iterations += len(sizes)
                    if status not in (OK, LEFT) and self.weights.size == 1:
                        # as `begin_again` of kernels/loop.py
                        parts.restore()
                        self._put_loads(factors, schedules, at)
                        parts.start(weight * h)
                        begin_fallback(work.increment)
                        status, sizes = self._newton(weight * h)
                        iterations += len(sizes)
                if status == LEFT:
                    parts.restore()
                    return Outcome(OK, k, iterations, -1, sizes, self._in_space(force))
                if status != OK:
                    break
                parts.finish(weight * h)
                last += weight * state.force
            if status == OK:
                counts = np.array([0, 0, 0, -1])
                status = OK if kernels.all_within_limits(*self.records, counts) else SLIDER_END
                slider = int(counts[3])
            if status != OK:
                parts.restore()
                return Outcome(status, k, iterations, slider, sizes, self._in_space(force))
            force[1] = last
            if k == 0:
                force[0] = last
        return Outcome(OK, n, iterations, -1, sizes, self._in_space(force))

    def _put_loads(self, factors: Array | None, schedules: tuple[Any, ...], k: int) -> None:
        """Put the loads and everything else that depends on time for substep k."""
        if factors is not None:
            kernels.external_forces(self.core.loads, factors[k], self.work.f_ext)
        for schedule in schedules:
            put_loads(schedule, None, k)

    def _python_step(self, h: float) -> tuple[int, Array]:
        self.parts.start(h)
        return self._newton(h)

    def _newton(self, h: float) -> tuple[int, Array]:
        status, sizes = self.parts.newton(h, self.max_iterations, LARGEST_IN_TIME, self.stop)
        return status, np.array(sizes)

    def worst_constraint(self) -> tuple[int, float, float]:
        """Return (slider, or joint behind the sliders, gap in m, residual of its sliding equation in N) where the gap of the last
        iteration is largest."""
        assert self.contact is not None
        inside = np.arange(8) < self.contact.forces[:, None]
        gaps = np.where(inside, np.abs(self.contact.residual), 0.0).max(axis=1)
        k = int(np.argmax(np.where(np.isfinite(gaps), gaps, np.inf)))
        return k, float(gaps[k]), float(self.contact.residual[k, self.core.dim])

    def largest_turn(self) -> tuple[int, float]:
        """Return (node, angle in rad) of the largest turn of a triad in the last substep."""
        theta = self.work.theta.reshape(self.model.n_nodes, -1)
        size = np.abs(theta[:, 0]) if self.plane is not None else np.linalg.norm(theta, axis=1)
        node = int(np.argmax(size))
        return node, float(2.0 * np.arctan(0.5 * size[node]))

    def largest_spin(self) -> tuple[int, float]:
        """Return (node, angular velocity in rad/s) of the triad that turns fastest in the present state."""
        state = self.state
        size = np.linalg.norm(spins(state.q.reshape(-1, 4, 3), state.v.reshape(-1, 4, 3)), axis=1)
        node = int(np.argmax(size))
        return node, float(size[node])

    def worst_node(self) -> tuple[int, float]:
        """Return (node, size) of the largest residual of the last iteration."""
        # that of the interior of condensed beams is kept nowhere; steps in time that failed have been tried without condensation
        of = self if self.core.substructures is None or self.made_fallback is None else self.made_fallback
        r = np.abs(of.work.r[:8 * of.model.n_nodes].reshape(-1, 8)[:, :len(of.core.dofs)]).max(axis=1)
        row = int(np.argmax(np.where(np.isfinite(r), r, np.inf)))
        return int(np.flatnonzero(of.model.pattern.row_of == row)[0]), float(r[row])
