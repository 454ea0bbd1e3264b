"""Steps along an equilibrium path: the load factor as one more unknown (theory.md 12)."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from .eigen import Pencil, SingularError, lowest
from .kernels.step import has_converged, next_increment
from .kernels.work import State
from .model import Model
from .saddle import Saddle, factors_for
from .static_sliders import Increment, SlidingSolver

Array = np.ndarray
# longest correction, in sizes of the scene and rad
LONGEST = 1.0
# accuracy of the place of a critical point on its step, and evaluations until then
ACCURATE, MOST_EVALUATIONS = 1e-12, 40


class Direction(NamedTuple):
    """Of a path, of unit length: all unknowns, and the load factor."""

    x: Array
    factor: float


class PathSolver(SlidingSolver):
    """An equilibrium with its load factor as one more unknown.

    Parameters
    ----------
    model, start, max_iterations, held, flat, backend
        As `SlidingSolver`.
    factors : (float64 [K], float64 [K])
        Of the loads at load factor 0, and their change until load factor 1.
    factor : float
        Load factor of the start.
    """

    def __init__(self, model: Model, start: State | None, max_iterations: int, held: Array, flat: bool | None, backend: str,
                 factors: tuple[Array, Array], factor: float) -> None:
        super().__init__(model, start, max_iterations, held, flat, backend)
        self._of_path, self._backend = factors_for(backend), backend
        loads = []
        for part in factors:
            self._load(part)
            loads.append(self.work.f_ext.copy())
        self._first_loads, self._unit_loads = loads
        self.factor = factor
        core = self.core
        size, rows = len(core.dofs), core.pattern.n
        place = np.arange(size * rows) % size < core.dim
        # square of the length of a step: mean over nodes, in sizes of the scene and rad
        self._weight = np.concatenate((np.where(place, 1.0 / core.length**2, 1.0) / rows, np.full(held.size, core.length**-2.0),
                                       np.zeros(core.n_forces)))

    @property
    def name(self) -> str:
        """What was used, for the result."""
        f = self._of_path
        if f is None or not f.count:
            return "SuperLU on nodes and load factor"
        return f"PARDISO on nodes and load factor, {f.count} factorisations, {f.refused} left to SuperLU"

    def saved(self) -> tuple[Any, ...]:
        """State and load factor, for `restore`."""
        return (*self._saved(), self.factor)

    def restore(self, saved: tuple[Any, ...]) -> None:
        """Go back to it."""
        self._restore(saved[:3])  # type: ignore[arg-type]
        self.factor = saved[3]

    def place(self) -> Array:
        """Coordinates, arc lengths of sliders and load factor such that differences have the length of steps, to first order."""
        state, size = self.state, self.core.length
        q = state.q.reshape(-1, 4, 3)
        nodes = np.concatenate((q[:, 0] / size, q[:, 1:].reshape(len(q), -1) / np.sqrt(2.0)), axis=1) / np.sqrt(len(q))
        return np.concatenate((nodes.reshape(-1), state.s / size, [self.factor]))

    def equations(self) -> tuple[Saddle, Array, Array]:
        """Tangent, forces and gaps that are left, and their derivative by the load factor."""
        # both from the same shape, the present factor last
        self._loads[:] = self._first_loads + (self.factor + 1.0) * self._unit_loads
        _, more = self._assembled(self.sliding)
        self._loads[:] = self._first_loads + self.factor * self._unit_loads
        saddle, right = self._assembled(self.sliding)
        return saddle, right, more - right

    def _bordered(self, saddle: Saddle, column: Array, row: Array, corner: float, right: Array, last: float) -> Array | None:
        """Solution of [K, -column; row, corner]."""
        from scipy import sparse
        matrix = sparse.bmat([[saddle.matrix, -sparse.csr_matrix(column[:, None])],
                              [sparse.csr_matrix(row[None]), sparse.csr_matrix([[corner]])]], format="csr")
        x = Saddle(matrix, np.append(saddle.multiplier, True), self._of_path).solve(np.append(right, last))
        return x if x is not None and np.isfinite(x).all() else None

    def product(self, a: Direction, b: Direction) -> float:
        """Of two directions."""
        return float(np.sum(self._weight * a.x * b.x)) + a.factor * b.factor

    def direction(self, along: Direction | None, sign: float = 1.0) -> Direction | None:
        """Of the path at the present equilibrium, forward along one before it; without one as the load factor grows (sign -1:
        falls)."""
        self.work.increment.control[0] = 0.0
        saddle, right, loads = self.equations()
        row = np.zeros(right.size) if along is None else self._weight * along.x
        x = self._bordered(saddle, loads, row, sign if along is None else along.factor, np.zeros(right.size), 1.0)
        if x is None:
            return None
        found = Direction(x[:-1], float(x[-1]))
        size = np.sqrt(self.product(found, found))
        return Direction(found.x / size, found.factor / size)

    def go(self, along: Direction, step: float, to: float | None = None) -> int:
        """From an equilibrium to the next one by a step; the number of iterations, 0 where it fails. to: a load factor that it
        ends at instead of the plane across the direction."""
        self.work.increment.control[0] = 0.0
        n, s = self._weight.size - self.core.n_forces, self.sliding.size
        nodes = n - s

        def move(x: Array, factor: float) -> float:
            size = self._move(Increment(x[:nodes], x[nodes:n], x[n:]))
            self.factor += factor
            return size + abs(factor)

        move(step * along.x, step * along.factor if to is None else to - self.factor)
        row, corner = (self._weight * along.x, along.factor) if to is None else (np.zeros_like(along.x), 1.0)
        before = expected = np.inf
        for k in range(self.max_iterations):
            saddle, right, loads = self.equations()
            x = self._bordered(saddle, loads, row, corner, right, 0.0)
            if x is None or self._size(x[:nodes]) > LONGEST:
                return 0
            size = move(x[:-1], float(x[-1]))
            state = self.stepper.core_state
            if np.any((state.s < self.ends[:, 0]) | (state.s > self.ends[:, 1])) or not size < np.inf:
                return 0
            if has_converged(size, before, expected):
                return k + 1
            before, expected = size, next_increment(size, before)
            self.interrupts.serve()
        return 0

    def eigenvalue(self, k: int) -> float:
        """The k-th lowest eigenvalue of the tangent, counted from 0, in the metric of the steps; NaN where it is not found. That
        of number k changes its sign where k + 1 directions become unstable after k."""
        found = self._eigen(k + 1)
        return np.nan if found is None or found[0].size <= k else float(found[0][k])

    def critical_direction(self, k: int) -> Direction | None:
        """Of the eigenvalue next to zero among the lowest k + 2, its largest component positive."""
        found = self._eigen(k + 2)
        if found is None or not found[0].size:
            return None
        v = found[1][:, int(np.argmin(np.abs(found[0])))]
        return Direction(v * np.sign(v[np.argmax(np.abs(v) * np.sqrt(self._weight))]), 0.0)

    def _eigen(self, n: int) -> tuple[Array, Array] | None:
        """The lowest n eigenvalues of the tangent in the metric of the steps, and vectors of length 1."""
        from scipy import sparse
        self.work.increment.control[0] = 0.0
        saddle, *_ = self.equations()
        k = int(np.sum(~saddle.multiplier))
        free = np.append(self.contacts.free(len(self.core.dofs)), np.ones(self.sliding.size))
        mass = sparse.diags(self._weight[:k] * free, format="csr")
        matrix = (0.5 * (saddle.matrix + saddle.matrix.T)).tocsr()
        try:
            v = lowest(Pencil(matrix, mass, saddle.multiplier, True, sparse.csr_matrix((k, 0))), n, self._backend).vectors
        except SingularError:
            return None
        # not set to zero where they are round-off
        return np.sum(v * (matrix @ v), axis=0), v

    def unstable(self) -> int | None:
        """Number of negative eigenvalues of the tangent; None where moments leave it undecided."""
        self.work.increment.control[0] = 0.0
        saddle, *_ = self.equations()
        found = saddle.signs(self.stepper.plane is not None or not self.moments)
        return None if found is None else found[0]


def root(f: Callable[[float], float], a: float, fa: float, b: float, fb: float) -> float | None:
    """Where f changes its sign between a and b; None where it cannot be evaluated there."""
    x = b
    for _ in range(MOST_EVALUATIONS):
        x = (a * fb - b * fa) / (fb - fa)
        fx = f(x)
        if not np.isfinite(fx):
            return None
        if fx == 0.0 or abs(b - a) <= ACCURATE:
            return x
        if fx * fb < 0.0:
            a, fa = b, fb
        else:
            # Anderson and Bjoerck
            m = 1.0 - fx / fb
            fa *= m if m > 0.0 else 0.5
        b, fb = x, fx
    return x
