"""Steppers: take a model's state over steps, either in the compiled loop with block elimination or with a sparse solver."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .kernels import step as kernels
from .kernels.step import BORDER_SINGULAR, NOT_CONVERGED, NOT_FINITE, OK, SINGULAR, SLIDER_END, State
from .linsolve import SparseSolver
from .model import Model

Array = np.ndarray
MEANING = {NOT_CONVERGED: "the Newton iteration did not converge", SINGULAR: "the tangent is singular",
           BORDER_SINGULAR: "the equations of a slider are singular", NOT_FINITE: "the Newton iteration diverged"}


@dataclass
class Outcome:
    """Of a number of steps: status, steps done, Newton iterations, slider of an event, sizes of the last increments, mean contact
    force of the first and the last step [2, 3 S]."""

    status: int
    steps: int
    iterations: int
    slider: int
    sizes: Array
    force: Array


class Stepper:
    """Runs steps of one model; owns the state and the work arrays.

    Parameters
    ----------
    model : Model
    weights : float64 [m]
        Substeps of a step as fractions of it (method.md 6).
    state : State, optional
        Start from here instead of the model's initial state.
    max_iterations : int
        Newton iterations a substep.
    backend : {'auto', 'pardiso', 'superlu'}
        Of the sparse solver.
    """

    def __init__(self, model: Model, weights: Array, state: State | None = None, max_iterations: int = 25,
                 backend: str = "auto") -> None:
        self.model = model
        self.weights = np.ascontiguousarray(weights, dtype=float)
        self.state = model.state() if state is None else State(*(np.array(x, dtype=float) for x in state))
        self.work = model.work()
        self.contact = model.contact()
        self.max_iterations = max_iterations
        self.fallbacks = 0
        self.linear: SparseSolver | None = None
        self._backend = backend
        self._factors = model.load_factors(np.zeros(1), np.ones(1))
        self._timed = any(t is not None for t in model.load_times)
        if not self._timed and model.loads.shape[0]:
            kernels.external_forces(model.loads, self._factors[0], self.work.f_ext)

    @property
    def solver_name(self) -> str:
        """Which solver ran and how often it fell back."""
        if self.model.pattern.plan is not None:
            return f"block elimination, {self.fallbacks} steps fell back to SuperLU"
        return self.linear.name if self.linear is not None else "none"

    def copy_state(self) -> State:
        """A copy of the present state."""
        return State(*(x.copy() for x in self.state))

    def set_state(self, state: State) -> None:
        """Go (back) to a state."""
        for mine, other in zip(self.state, state):
            mine[:] = other

    def advance(self, t: float, h: float, n: int) -> Outcome:
        """n steps of size h from time t. On a failure or event the state is the one before that step."""
        model = self.model
        counts = np.zeros(5, np.int64)
        sizes = np.zeros(self.max_iterations)
        force = np.zeros((2, 3 * model.n_sliders))
        loads, factors = None, self._factors
        if self._timed:
            ends = np.concatenate(([0.0], np.cumsum(self.weights)))[:-1]
            starts = t + h * (np.arange(n)[:, None] + ends)
            loads, factors = model.loads, model.load_factors(starts.reshape(-1), np.tile(self.weights * h, n))
        if model.pattern.plan is None:
            return self._sparse_run(factors if self._timed else None, h, n, self._backend)
        kernels.run(model.simo, model.green, model.bodies, model.ties, model.held, model.curves, model.sliders, self.contact,
                    model.pattern.plan, model.pattern.row_of, model.spinless, loads, factors, self.state, self.work, self.weights, h, n,
                    model.width, model.length, self.max_iterations, model.slider_lengths, counts, sizes, force)
        done = int(counts[1])
        if counts[0] in (SINGULAR, NOT_CONVERGED, NOT_FINITE):
            # once more with pivoting across blocks
            again = self._sparse_run(factors[done * self.weights.size:] if self._timed else None, h, 1, "superlu")
            if again.status == OK:
                self.fallbacks += 1
                first = again.force[0] if done == 0 else force[0]
                head = Outcome(OK, done + 1, int(counts[2]) + again.iterations, -1, again.sizes, np.stack((first, again.force[1])))
                if done + 1 == n:
                    return head
                tail = self.advance(t + (done + 1) * h, h, n - done - 1)
                last = tail.force[1] if tail.steps else head.force[1]
                return Outcome(tail.status, done + 1 + tail.steps, head.iterations + tail.iterations, tail.slider, tail.sizes,
                               np.stack((first, last)))
        return Outcome(int(counts[0]), done, int(counts[2]), int(counts[3]), sizes, force)

    def _sparse_run(self, factors: Array | None, h: float, n: int, backend: str) -> Outcome:
        """The same loop in Python around a sparse solver."""
        model, state, work = self.model, self.state, self.work
        force = np.zeros((2, 3 * model.n_sliders))
        iterations = 0
        sizes = np.zeros(0)
        for k in range(n):
            before = self.copy_state()
            last = np.zeros(3 * model.n_sliders)
            status = OK
            for m, weight in enumerate(self.weights):
                if factors is not None:
                    kernels.external_forces(model.loads, factors[k * self.weights.size + m], work.f_ext)
                status, sizes = self._sparse_step(weight * h, backend)
                iterations += len(sizes)
                if status != OK:
                    break
                kernels.finish_step(state, work, weight * h)
                last += weight * state.force
            slider = -1
            if status == OK:
                outside = np.flatnonzero(~((state.s >= 0.0) & (state.s <= model.slider_lengths)))
                if outside.size:
                    status, slider = SLIDER_END, int(outside[0])
            if status != OK:
                self.set_state(before)
                return Outcome(status, k, iterations, slider, sizes, force)
            force[1] = last
            if k == 0:
                force[0] = last
        return Outcome(OK, n, iterations, -1, sizes, force)

    def _sparse_step(self, h: float, backend: str) -> tuple[int, Array]:
        model, state, work, contact = self.model, self.state, self.work, self.contact
        pattern = model.pattern
        if self.linear is None:
            self.linear = SparseSolver(pattern.rows, pattern.columns, pattern.n, backend)
        kernels.start_step(model.ties, model.curves, model.sliders, contact, model.spinless, state, work, h)
        n, width, columns = pattern.n, model.width, 1 + 7 * model.n_sliders
        blocks = work.blocks[:48 * pattern.keys.size].reshape(-1, 6, 8)
        panel = work.panel.reshape(6 * n, width)
        sizes: list[float] = []
        previous = np.inf
        for _ in range(self.max_iterations):
            kernels.assemble_step(model.simo, model.green, model.bodies, model.ties, model.held, model.curves, model.sliders, contact,
                                  pattern.row_of, state, work, h)
            kernels.prepare_panel(model.held, contact, pattern.row_of, work, width)
            x = self.linear.solve(blocks, np.ascontiguousarray(panel[:, :columns].T))
            if x is None:
                return (SINGULAR if np.isfinite(work.r).all() else NOT_FINITE), np.array(sizes)
            panel[:, :columns] = x.T
            size = kernels.update_step(model.ties, contact, pattern.row_of, state, work, width, model.length)
            if size < 0.0:
                return BORDER_SINGULAR, np.array(sizes)
            sizes.append(size)
            if not size < 1e6:
                return NOT_FINITE, np.array(sizes)
            if kernels.has_converged(size, previous, 1e-9):
                return OK, np.array(sizes)
            previous = size
        return NOT_CONVERGED, np.array(sizes)

    def worst_node(self) -> tuple[int, float]:
        """(node, size) of the largest residual of the last iteration."""
        r = np.abs(self.work.r[:8 * self.model.n_nodes].reshape(-1, 8)[:, :6]).max(axis=1)
        row = int(np.argmax(np.where(np.isfinite(r), r, np.inf)))
        return int(np.flatnonzero(self.model.pattern.row_of == row)[0]), float(r[row])
