"""Steps along an equilibrium path: the load factor as one more unknown (theory.md 12)."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.loop import NOT_CONVERGED, OK, SLIDER_END
from fastbeam.kernels.state import State
from fastbeam.linalg.eigen import Pencil, SingularError, grown, lowest
from fastbeam.linalg.factors import factoriser_for, solver_name
from fastbeam.linalg.saddle import Saddle
from fastbeam.linalg.scaling import with_values
from fastbeam.model.model import Model
from fastbeam.model.workspace import ReferenceStrains
from fastbeam.statics.equilibrium import LEAST_STRAY, STRAY
from fastbeam.statics.load_laws import LawPath
from fastbeam.statics.sliding import SlidingSolver
from fastbeam.stepping.iteration import newton_loop

Array = np.ndarray
# a corner turns a path by so much at least, and directions beside it differ by less than this share of that
LEAST_TURN, SAME = 1e-8, 0.1
# longest correction, in sizes of the scene and rad, and one that a start may need
LONGEST, AT_REST = 1.0, 1e-6
# relative rounding error of one number
EPSILON = float(np.finfo(float).eps)
# at a critical point: most eigenvalues computed; share of the next one below which they vanish together; directions tried in each
# dimension of their vectors; cosine from which two directions are the same
MOST_TOGETHER, TOGETHER, TRIALS, PARALLEL = 6, 1e-5, 24, 0.9995
# eigenvalues of a tangent without symmetry that are looked for, until two numbers tell the same number of negative ones
NUMBERS = (6, 12, 24, 48)
# largest imaginary part of a real eigenvalue, relative to the largest eigenvalue found
REAL = 1e-9
# relative to the largest stiffness: distance below zero from which vanishing eigenvalues are computed, and their round-off
NEXT_TO, ROUND_OFF = 1e-9, 1e-14
# a direction with less than this out of a plane lies in it; a vector of length 1 that moves places by less only spins
ASIDE, SPINS = 1e-3, 1e-6
# accuracy of the place of a critical point on its step, and evaluations until then
ACCURATE, MOST_EVALUATIONS = 1e-12, 40


class Direction(NamedTuple):
    """Unit direction of a path: increments of all unknowns and of the load factor."""

    x: Array
    factor: float


class PathSolver(SlidingSolver):
    """Solver for equilibria with the load factor as one more unknown.

    Parameters
    ----------
    model, start, max_iterations, held, flat, backend
        See `SlidingSolver`.
    factors : (float64 [K], float64 [K])
        Factors of the loads at load factor 0, and their change until load factor 1.
    factor : float
        Load factor of the start.
    laws : LawPath
        Path of forces by laws.
    strains : ReferenceStrains, optional
        With prestrains that change with the load factor.
    """

    def __init__(self, model: Model, start: State | None, max_iterations: int, held: Array, flat: bool | None, backend: str,
                 factors: tuple[Array, Array], factor: float, laws: LawPath = LawPath(0.0, 0.0, 1.0),
                 strains: ReferenceStrains | None = None) -> None:
        super().__init__(model, start, max_iterations, held, flat, backend, laws.time, strains)
        if self.along is not None:
            self.along.is_exact = True
        self._laws = laws
        self.is_unsymmetric = not self.has_potential(self.stepper.plane is not None)
        self._of_path, self._backend = factoriser_for(backend, threads=1), backend
        loads = []
        for part in factors:
            self._load(part)
            loads.append(self.work.f_ext.copy())
        self._first_loads, self._unit_loads = loads
        self._of_time = factors
        self.factor = factor
        self._by_laws = bool(model.user_forces) or model.blows
        # the equations of the last state; their derivative by the load factor where it is the same everywhere
        self._known: tuple[Array, tuple[Saddle, Array, Array]] | None = None
        self._push: Array | None = None
        # eigenvalues that were asked for last: how, at which state, and what was found
        self._last: tuple[tuple[int, float, bool], Array, tuple[Array, Array] | None] | None = None
        # structure of the matrix with border
        self._structure: tuple[Array, ...] | None = None
        self._places: tuple[Array, ...] = ()
        self._whole: Any = None
        # largest stiffness in the metric of the steps
        self._stiffest = 1.0
        # what the last step has added to the unknowns, to first order
        self.gone = np.zeros(0)
        # for a path in a plane: function that makes a solver in space of the same path, and that solver
        self.in_space: Callable[[State, float], PathSolver] | None = None
        self._judge: PathSolver | None = None
        # eigenvalues that are zero all along, of parts that may spin about their own line
        self.free = 0
        # for a judge in space: axes of the plane of the path, and its normal
        self.axes: Array | None = None
        core = self.core
        size, rows = len(core.dofs), core.pattern.n
        place = np.arange(size * rows) % size < core.dim
        # square of the length of a step: mean over nodes, in sizes of the scene and rad
        self.weight = np.concatenate((np.where(place, 1.0 / core.length**2, 1.0) / rows, np.full(held.size, core.length**-2.0),
                                       np.zeros(core.n_forces)))

    @property
    def judge(self) -> PathSolver:
        """Solver, at the present equilibrium, whose tangent decides on stability: in space where the scene may leave the plane in
        which the path runs."""
        if self.in_space is None:
            return self
        state = self.state
        if self._judge is None:
            self._judge = self.in_space(state, self.factor)
            self._judge.axes = self.stepper.plane.axes
        self._judge.interrupts = self.interrupts
        self._judge.restore((state.q, state.s, state.force, self.factor))
        return self._judge

    def in_plane(self, way: Direction, number: int, step: float) -> Direction | None:
        """Return the in-plane branch direction nearest to `way`, a direction of the judge; None where `way` leaves the plane.
        number, step: see `branches`."""
        if np.linalg.norm(self.judge.aside(way.x)) > ASIDE:
            return None
        flat = Direction(self.within(way.x[:, None])[:, 0], 0.0)
        own = self.branches(number, step)[0]
        return max(own, key=lambda x: self.product(x, flat), default=None)

    def within(self, x: Array) -> Array:
        """Project vectors [n, m] of the judge onto the plane of this solver, with zero multipliers; in space return them
        unchanged."""
        plane, rows, sliding = self.stepper.plane, self.core.pattern.n, self.sliding.size
        if self.in_space is None:
            return x
        parts = x[:6 * rows].reshape(rows, 6, -1)
        moves = np.einsum("ij,njm->nim", plane.axes[:2], parts[:, :3])
        turns = np.einsum("ij,njm->nim", plane.axes[2:], parts[:, 3:])
        flat = np.concatenate((moves, turns), axis=1).reshape(3 * rows, -1)
        return np.concatenate((flat, x[6 * rows:6 * rows + sliding], np.zeros((self.core.n_forces, x.shape[1]))))

    def aside(self, x: Array) -> Array:
        """Return the out-of-plane part of vectors [n, ...] of a solver in space, in the metric of the steps, [3 rows, ...]."""
        rows, (*within, normal) = self.core.pattern.n, self.axes
        parts = x[:6 * rows].reshape(rows, 2, 3, -1)
        out = np.stack((np.tensordot(parts[:, 0], normal, (1, 0)) / self.core.length,
                        *(np.tensordot(parts[:, 1], axis, (1, 0)) for axis in within)))
        return out.reshape(3 * rows, *x.shape[1:]) / np.sqrt(rows)

    @property
    def load_factors(self) -> Array:
        """Factors of all load vectors at the present load factor, [K]."""
        return np.asarray(self._of_time[0] + self.factor * self._of_time[1])

    @property
    def name(self) -> str:
        """Linear solver and its number of factorisations, for the result."""
        return solver_name(self._of_path, "nodes and load factor")

    @property
    def drives_at(self) -> tuple[float, float] | None:
        """Time, s, and share of the forces of drives on sliders at the present load factor; None where nothing acts on these."""
        laws = self._laws
        return None if self.along is None else (laws.time, laws.first + self.factor * laws.change)

    def saved(self) -> tuple[Any, ...]:
        """Return state and load factor, for `restore`."""
        return (*self._saved(), self.factor)

    def restore(self, saved: tuple[Any, ...]) -> None:
        """Restore a state and load factor of `saved`."""
        self._restore(saved[:3])  # type: ignore[arg-type]
        self.factor = saved[3]
        self.strains.put(self.factor)

    def place(self) -> Array:
        """Return coordinates, arc lengths of sliders and load factor such that differences have the length of steps, to first
        order."""
        state, size = self.state, self.core.length
        q = state.q.reshape(-1, 4, 3)
        nodes = np.concatenate((q[:, 0] / size, q[:, 1:].reshape(len(q), -1) / np.sqrt(2.0)), axis=1) / np.sqrt(len(q))
        return np.concatenate((nodes.reshape(-1), state.s / size, [self.factor]))

    def equations(self) -> tuple[Saddle, Array, Array]:
        """Return tangent, residual (forces and gaps) and its derivative by the load factor; kept until the state changes."""
        state = self.stepper.core_state
        now = np.concatenate((state.q, state.s, state.force, [self.factor, float(self.sliding.sum())]))
        if self._known is None or not np.array_equal(self._known[0], now):
            self._known = now, self._equations()
        return self._known[1]

    def _equations(self) -> tuple[Saddle, Array, Array]:
        """Assemble what `equations` returns."""
        if self._push is not None:
            self._at(self.factor)
            return *self._assembled(self.sliding), self._push
        # both from the same shape, the present factor last
        self._at(self.factor, 1.0)
        _, more = self._assembled(self.sliding)
        self._at(self.factor)
        saddle, right = self._assembled(self.sliding)
        push = more - right
        if self.strains.of_moving:
            # the energy of moving elements is quadratic in prestrains, and so are its derivatives by places
            self._at(self.factor, -1.0)
            push = 0.5 * (more - self._assembled(self.sliding)[1])
            self._at(self.factor)
            saddle, right = self._assembled(self.sliding)
        # the weight of moving elements depends on their shape
        alike = (self.motion is None and not self.strains.beams and not self._by_laws and self.along is None
                 and (self.core.moving is None or not np.any(self.core.gravity)))
        if alike and self.core.ties is None:
            # for dead loads it is constant: the loads themselves, without round-off, except on fixed unknowns
            size, n = len(self.core.dofs), self.core.pattern.n
            self._push = push = np.where(push == 0.0, 0.0, push)
            loads = self._unit_loads[:8 * n].reshape(n, 8)[:, :size].reshape(-1)
            push[:loads.size] = np.where(push[:loads.size] == 0.0, 0.0, loads)
        return saddle, right, push

    def _at(self, factor: float, ahead: float = 0.0) -> None:
        """Set loads, prestrains, laws and supports at a load factor, and by `ahead` further, supports to first order."""
        if self.motion is not None:
            self.motion.share, self.motion.ahead = factor, ahead
        factor += ahead
        self._loads[:] = self._first_loads + factor * self._unit_loads
        if self.core.moving is not None:
            first, change = self._of_time
            self.stepper.put_gravity(first + factor * change)
        self.strains.put(factor)
        laws = self._laws
        self.set_time(laws.time, laws.first + factor * laws.change)
        if laws.shares is not None:
            self.stepper.load_at(laws.time, laws.first, laws.shares[0] + factor * laws.shares[1])

    def _bordered(self, saddle: Saddle, column: Array, row: Array, corner: float, right: Array, last: float) -> Array | None:
        """Solve [K, -column; row, corner]; None where no solution leaves only round-off of the right-hand side."""
        from scipy import sparse
        inner, n = saddle.matrix, column.size
        kind = inner.indptr, inner.indices, column != 0.0, row != 0.0
        if self._structure is None or not all(x is y or np.array_equal(x, y) for x, y in zip(self._structure, kind)):
            self._structure = kind
            self._places = _bordered_places(*kind)
            self._whole = sparse.csr_matrix((np.zeros(self._places[1].size), self._places[1], self._places[0]),
                                            shape=(n + 1, n + 1))
        indptr, indices, of_inner, of_column = self._places
        data = np.empty(indices.size)
        data[of_inner], data[of_column] = inner.data, -column[kind[2]]
        data[indptr[n]:-1], data[-1] = row[kind[3]], corner
        whole = Saddle(with_values(self._whole, data), np.append(saddle.multiplier, True), self._of_path)
        x = whole.solve(np.append(right, last))
        left = whole.left[:-1]
        if x is None or not np.isfinite(x).all() or np.any(np.abs(right @ left) > self.round_off(saddle, left)):
            return None
        return x

    def round_off(self, saddle: Saddle, vectors: Array) -> Array:
        """Return the forces along vectors [n, m] that round-off of positions causes, [m]."""
        stiff = np.where(saddle.multiplier, 0.0, np.abs(saddle.matrix.diagonal()))
        return np.asarray(EPSILON * self.core.length * np.linalg.norm(stiff[:, None] * vectors, axis=0))

    def product(self, a: Direction, b: Direction) -> float:
        """Return the inner product of two directions."""
        return float(np.sum(self.weight * a.x * b.x)) + a.factor * b.factor

    def balanced(self) -> bool:
        """Return whether the start is an equilibrium: Newton's increment is negligible, or none is found."""
        self.work.increment.control[0] = 0.0
        saddle, right, loads = self.equations()
        x = self._bordered(saddle, loads, np.zeros_like(right), 1.0, right, 0.0)
        if x is None:
            return True
        size, dim = len(self.core.dofs), self.core.dim
        moves = x[:size * self.core.pattern.n].reshape(-1, size)
        shift, spin = (float(np.max(np.linalg.norm(part, axis=1), initial=0.0)) for part in (moves[:, :dim], moves[:, dim:]))
        return shift / self.core.length + spin < AT_REST

    def direction(self, along: Direction | None, sign: float = 1.0) -> Direction | None:
        """Return the direction of the path at the present equilibrium, forward along an earlier direction; without one the load
        factor grows (sign -1: falls). None where no direction is found."""
        self.work.increment.control[0] = 0.0
        saddle, right, loads = self.equations()
        row = np.zeros(right.size) if along is None else self.weight * along.x
        x = self._bordered(saddle, loads, row, sign if along is None else along.factor, np.zeros(right.size), 1.0)
        if x is None:
            return None
        found = Direction(x[:-1], float(x[-1]))
        size = np.sqrt(self.product(found, found))
        return Direction(found.x / size, found.factor / size)

    def go(self, along: Direction, step: float, to: float | None = None) -> int:
        """Advance from an equilibrium to the next one by a step; return the number of iterations, 0 on failure. to: a load factor
        at which the step ends instead of the plane across the direction."""
        self.work.increment.control[0] = 0.0
        self.stepper.forget_failures()
        self.gone, first = np.zeros_like(along.x), self.factor
        if self.motion is not None:
            self.motion.begin(first)

        def move(x: Array, factor: float) -> float:
            self.gone += x
            return self._go_by(x, factor)

        move(step * along.x, step * along.factor if to is None else to - self.factor)
        row, corner = (self.weight * along.x, along.factor) if to is None else (np.zeros_like(along.x), 1.0)

        def increment() -> tuple[int, float | None]:
            saddle, right, loads = self.equations()
            x = self._bordered(saddle, loads, row, corner, right, 0.0)
            if x is None or self._size(x[:self.nodes]) > LONGEST:
                return NOT_CONVERGED, None
            size = move(x[:-1], float(x[-1]))
            return (SLIDER_END if self.beyond_ends(self.stepper.core_state.s) else OK), size

        status, sizes = newton_loop(increment, self.max_iterations, self.interrupted)
        # farther off than a path can be that turns by less than the steps allow: another path
        strayed = to is None and self._strayed(along, step, first) > max(STRAY * step, LEAST_STRAY)
        return 0 if status != OK or strayed else len(sizes)

    def _go_by(self, x: Array, factor: float) -> float:
        """Add an increment of all unknowns and of the load factor; return its size."""
        size = self.move(x)
        self.factor += factor
        return size + abs(factor)

    def around_corner(self, along: Direction, size: float) -> tuple[int, Direction] | None:
        """Take a step of this size around a corner of the path, where the law of a force has a kink (a stop, a rope that becomes
        taut), with the tangent that holds a little further along.

        Returns
        -------
        tuple or None
            Number of iterations, and the direction behind the corner; None where the path has none here.
        """
        before, beyond = self.saved(), []
        for part in (0.5, 1.0):
            self._go_by(part * size * along.x, part * size * along.factor)
            found = self.direction(along)
            self.restore(before)
            if found is None:
                return None
            beyond.append(found)
        # behind a corner the tangent differs by as much however near it is; along a curve by less
        turn = self._between(along, beyond[1])
        if turn < LEAST_TURN or self._between(*beyond) > SAME * turn:
            return None
        for sign in (1.0, -1.0):
            way = Direction(sign * beyond[1].x, sign * beyond[1].factor)
            iterations = self.go(way, size)
            after = self.direction(way) if iterations else None
            # the direction back has the tangent before the corner
            if after is not None and self._between(way, after) < SAME * turn:
                return iterations, after
            self.restore(before)
        return None

    def _between(self, a: Direction, b: Direction) -> float:
        """Return the distance of two directions."""
        off = Direction(b.x - a.x, b.factor - a.factor)
        return float(np.sqrt(self.product(off, off)))

    def _strayed(self, along: Direction, step: float, first: float) -> float:
        """Return the distance of the equilibrium found from the end of a step along the direction; first: load factor at its
        beginning."""
        off = self.gone - step * along.x
        return float(np.sqrt(np.sum(self.weight * off * off) + (self.factor - first - step * along.factor)**2))

    def test_of(self, v: Array) -> float:
        """Return a number that vanishes with the determinant of the tangent, and changes its sign with the eigenvalue whose
        vector is near v [n]: g of [K, W v; v W, 0] [x; g] = [0; 1] (W. Govaerts, 2000). NaN where it is not found."""
        self.work.increment.control[0] = 0.0
        saddle, right, _ = self.equations()
        border = self.weight * v
        x = self._bordered(saddle, -border, border, 0.0, np.zeros(right.size), 1.0)
        return np.nan if x is None else float(x[-1])

    def eigenvalue(self, k: int) -> float:
        """Return the k-th lowest eigenvalue of the tangent, counted from 0, in the metric of the steps; NaN where it is not
        found. Eigenvalue number k changes its sign where k + 1 directions become unstable after k."""
        found = self._eigen(k + 1 + self.free)
        if found is None:
            return np.nan
        values = np.delete(found[0], np.argsort(np.abs(found[0]))[:self.free])
        return float(values[k]) if values.size > k else np.nan

    def nearest(self, m: int) -> Array:
        """Return vectors [n, m] of the m real eigenvalues nearest to zero, fewer where so many are not found."""
        found = self._eigen(NUMBERS[0] + m)
        if found is None:
            return np.zeros((self.weight.size, 0))
        size = np.where(_are_real(found[0]), np.abs(found[0]), np.inf)
        order = np.argsort(size)[:m]
        return np.asarray(found[1][:, order[np.isfinite(size[order])]])

    def critical_directions(self, k: int, left: bool = False) -> Array | None:
        """Return unit vectors of the eigenvalues that vanish together near the k-th, by columns [n, m], their largest component
        positive; left: vectors of the transposed tangent. None where no eigenvalue vanishes or is found."""
        found = self._eigen(k + MOST_TOGETHER + self.free, NEXT_TO, left)
        if found is None or not found[0].size:
            return None
        order = np.argsort(np.abs(found[0]))
        size = np.maximum(np.abs(found[0])[order], ROUND_OFF * self._stiffest)
        gaps = np.flatnonzero(size[:-1] <= TOGETHER * size[1:])
        # without a gap all are zero, or there is none
        m = int(gaps[0]) + 1 if gaps.size else size.size if size[-1] <= 10.0 * ROUND_OFF * self._stiffest else 1
        v = found[1][:, order[:m]]
        v = self._moving(v)
        if self.is_unsymmetric:
            # vectors of different eigenvalues are not orthogonal
            root = np.sqrt(self.weight)[:, None]
            whole = v @ np.linalg.inv(np.linalg.qr(root * v)[1])
            v = whole if np.isfinite(whole).all() else v
        if self.axes is not None and v.shape[1] > 1:
            # those in the plane first
            v = v @ np.linalg.svd(self.aside(v))[2][::-1].T
        peak = np.argmax(np.abs(v) * np.sqrt(self.weight)[:, None], axis=0)
        return np.asarray(v * np.sign(v[peak, np.arange(v.shape[1])]))

    def _moving(self, v: Array) -> Array:
        """Remove from vectors [n, m] the spins that move nothing among their combinations, if anything is left."""
        n, size = self.core.pattern.n, len(self.core.dofs)
        places = v[:n * size].reshape(n, size, -1)[:, :self.core.dim].reshape(n * self.core.dim, -1)
        moves = np.concatenate((places, v[n * size:n * size + self.sliding.size])) / self.core.length / np.sqrt(n)
        _, sizes, turn = np.linalg.svd(moves, full_matrices=False)
        rows = turn[sizes > SPINS]
        return v @ rows.T if 0 < len(rows) < v.shape[1] else v

    def branches(self, k: int, step: float) -> tuple[list[Direction], bool]:
        """Find directions in which other paths leave a critical point; return them, and whether they are some of a continuum.

        Where several eigenvalues vanish together, steps into many directions of their vectors are tried; each that ends in an
        equilibrium tells the direction of its path.
        """
        v = self.critical_directions(k)
        if v is None:
            return [], False
        m = v.shape[1]
        if m == 1:
            return [Direction(sign * v[:, 0], 0.0) for sign in (1.0, -1.0)], False
        if m == 2:
            angles = np.arange(TRIALS) * (2.0 * np.pi / TRIALS)
            tried = np.stack((np.cos(angles), np.sin(angles)), axis=1)
        else:
            tried = np.random.default_rng(0).standard_normal((TRIALS * m, m))
            tried /= np.linalg.norm(tried, axis=1, keepdims=True)
        before = self.saved()
        ways: list[Array] = []
        for c in tried:
            self.restore(before)
            if not self.go(Direction(v @ c, 0.0), step):
                continue
            way = v.T @ (self.weight * self.gone)
            way /= np.linalg.norm(way)
            if not ways or np.max(np.array(ways) @ way) < PARALLEL:
                ways.append(way)
        self.restore(before)
        # opposite ones one after the other, as of a simple point
        ways.sort(key=lambda way: tuple(np.round(way, 3)), reverse=True)
        is_continuum = len(ways) > 0.5 * len(tried)
        return [Direction(v @ way, 0.0) for way in (ways[:1] + [-ways[0]] if is_continuum else ways)], is_continuum

    def _eigen(self, n: int, below_zero: float = 0.0, left: bool = False) -> tuple[Array, Array] | None:
        """Find the lowest n eigenvalues of the tangent in the metric of the steps, and vectors of length 1; below_zero: distance
        below zero, relative to the largest stiffness, from which they are computed where several may vanish; left: vectors of the
        transposed tangent. The last ones are kept, because the same critical point is looked at several times."""
        self.work.increment.control[0] = 0.0
        saddle, *_ = self.equations()
        assert self._known is not None
        asked = n, below_zero, left and self.is_unsymmetric
        if self._last is None or self._last[0] != asked or not np.array_equal(self._last[1], self._known[0]):
            self._last = asked, self._known[0], self._eigen_of(saddle, *asked)
        return self._last[2]

    def _eigen_of(self, saddle: Saddle, n: int, below_zero: float, left: bool) -> tuple[Array, Array] | None:
        """Find the lowest n eigenvalues and vectors of this tangent, see `_eigen`."""
        from scipy import sparse
        k = int(np.sum(~saddle.multiplier))
        free = np.append(self.map.free, np.ones(self.sliding.size))
        mass = sparse.diags(self.weight[:k] * free, format="csr")
        given = saddle.matrix.T if left else saddle.matrix
        matrix = (given if self.is_unsymmetric else 0.5 * (given + given.T)).tocsr()
        pencil = Pencil(matrix, mass, saddle.multiplier, not self.is_unsymmetric, sparse.csr_matrix((k, 0)),
                        self.free_motions.nodes.turns(saddle.multiplier.size))
        if below_zero:
            # not the median, which may be one of those that vanish
            heavy = mass.diagonal() > 0.0
            self._stiffest = float(np.max(np.abs(matrix.diagonal()[:k][heavy]) / mass.diagonal()[heavy], initial=0.0)) or 1.0
            more = below_zero * self._stiffest * grown(mass, saddle.multiplier.size)
            pencil = pencil._replace(stiffness=(matrix + more).tocsr())
        try:
            found = lowest(pencil, n, self._backend)
        except SingularError:
            return None
        v = found.vectors
        if self.is_unsymmetric:
            values = found.values - below_zero * self._stiffest
            return values, v / np.sqrt(np.sum(self.weight[:, None] * np.abs(v)**2, axis=0))
        # not set to zero where they are round-off
        return np.sum(v * (matrix @ v), axis=0), v

    def unstable(self) -> int | None:
        """Return the number of negative eigenvalues of the tangent; None where moments leave it undecided."""
        self.work.increment.control[0] = 0.0
        saddle, *_ = self.equations()
        if not self.is_unsymmetric:
            found = saddle.signs()
            self.free = 0 if found is None else found[1]
            return None if found is None else found[0]
        # a symmetric part without negative ones has none itself (Bendixson)
        if saddle.signs() == (0, 0):
            return 0
        sign, before = saddle.determinant_sign(), -1
        for n in NUMBERS:
            near = self._eigen(n)
            if near is None:
                return None
            count = int(np.sum(_are_real(near[0]) & (np.real(near[0]) < 0.0)))
            # those far below zero may come late; pairs of complex ones leave the sign of the determinant
            if count == before and sign and (count % 2 == 1) == (sign < 0):
                return count
            before = count
        return None


def _are_real(values: Array) -> Array:
    """Return which eigenvalues are real, bool [m]."""
    return np.asarray(np.abs(np.imag(values)) <= REAL * np.max(np.abs(values), initial=0.0))


def _bordered_places(inner_indptr: Array, inner_indices: Array, column: Array, row: Array
                     ) -> tuple[Array, Array, Array, Array]:
    """Form the structure by rows of a matrix [n, n] with one more column and row, whose entries these masks [n] mark, and a
    corner: ends of rows, columns, and where entries of the matrix and of the column stand."""
    n = column.size
    more = np.concatenate(([0], np.cumsum(column)))
    indptr = np.append(inner_indptr + more, inner_indices.size + more[-1] + np.sum(row) + 1).astype(np.int32)
    of_inner = np.arange(inner_indices.size) + np.repeat(more[:-1], np.diff(inner_indptr))
    indices = np.full(indptr[-1], n, np.int32)
    indices[of_inner], indices[indptr[n]:-1] = inner_indices, np.flatnonzero(row)
    return indptr, indices, of_inner, indptr[1:-1][column] - 1


def root(f: Callable[[float], float], a: float, fa: float, b: float, fb: float, accurate: float = ACCURATE) -> float | None:
    """Find where f changes its sign between a and b, to this accuracy; None where f is not finite there."""
    x = b
    for _ in range(MOST_EVALUATIONS):
        x = (a * fb - b * fa) / (fb - fa)
        fx = f(x)
        if not np.isfinite(fx):
            return None
        if fx == 0.0 or abs(b - a) <= accurate:
            return x
        if fx * fb < 0.0:
            a, fa = b, fb
        else:
            # Anderson and Bjoerck
            m = 1.0 - fx / fb
            fa *= m if m > 0.0 else 0.5
        b, fb = x, fx
    return x
