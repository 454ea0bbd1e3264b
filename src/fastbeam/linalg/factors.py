"""Factors of sparse matrices, real or complex: by PARDISO, or SuperLU, with scaling, refinement and acceptance of solutions.

Rows and columns are brought to a size of 1 before, so that units do not matter. PARDISO perturbs small pivots and may return
garbage without an error code. Solutions are therefore refined with the matrix itself, and accepted by their residuals; where they
are not, another analysis follows, then SuperLU with few exchanges of rows, then SuperLU with many.
"""
from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.empty_arrays import empty
from fastbeam.kernels.linalg import pardiso as kernels
from fastbeam.kernels.linalg.pardiso import PardisoTables
from fastbeam.kernels.linalg.scaling import leave
from fastbeam.linalg.mkl import OnThreads, mkl_for, pardiso_tables, threads_for
from fastbeam.linalg.scaling import entry_scales, equilibrated, rows_of, with_values

Array = np.ndarray
# a smaller pivot next to the largest tells a singular matrix
LEAST_PIVOT = 1e-15
# smallest singular value of the scaled matrix that is round-off, and one above which there are no null vectors for certain
# (fine meshes of slender beams have some of 1e-14)
SINGULAR, CLEARLY_REGULAR = 10.0 * np.finfo(float).eps, 3e-14
# size of the largest entry of a scaled row, or its reciprocal, up to which factors of an earlier matrix serve
FAR = 64.0
# residual up to which one that is round-off of the product is no sign of a singular matrix
CLEAR = 1e-4
# types of complex matrices in PARDISO: structurally symmetric, symmetric
COMPLEX, COMPLEX_SYMMETRIC = 13, 6
# an order that suits a symmetric structure, with few exchanges of rows
SYMMETRIC_MODE: dict[str, Any] = {"permc_spec": "MMD_AT_PLUS_A", "options": {"SymmetricMode": True}}


class Limits(NamedTuple):
    """Limits of residuals of solutions, relative to the right-hand side unless stated."""

    good: float             # up to which a solution is not refined any more
    accepted: float         # up to which a solution is accepted
    fair: float             # up to which a solution is accepted if its residual is round-off:
    round_off: float        # at most this share of the largest term of the equations
    enough: int             # refinements after which an acceptable solution is not refined any more
    most: int               # refinements at most
    is_strict: bool = False  # accept perturbed pivots, and fair solutions, only if no singular value is near round-off
    last_bits: float = 0.0  # residual next to the solution, scaled, that is round-off of the product and not refined any more


# limits for equilibria, where a singular matrix has to be noticed; for a step, whose iteration goes on anyway
EXACT = Limits(1e-14, 1e-12, 1e-2, 1e-12, 2, 2, True)
OF_STEP = Limits(1e-13, 1e-8, 1e-2, 1e-12, 2, 2)


class PardisoMemory:
    """Memory of PARDISO for one structure and its values, freed with this object; threads: threads of all calls: PARDISO crashes
    with fewer than it was analysed on."""

    def __init__(self, mkl: Any, tables: PardisoTables, threads: int) -> None:
        self.tables, self.threads = tables, OnThreads(mkl, threads)
        self._count, self._on_threads = threads, mkl.MKL_Set_Num_Threads_Local

    def call(self, phase: int, b: Array, x: Array) -> int:
        """Call PARDISO with right-hand sides and solutions [m, n]; return its error code."""
        before = self._on_threads(self._count)
        try:
            return int(kernels.call_pardiso(self.tables, phase, b, x))
        finally:
            self._on_threads(before)

    def __del__(self, python_ends: Callable[[], bool] = sys.is_finalizing) -> None:
        # at exit compiled code may be gone before this object, and the memory goes with the process
        if not python_ends() and self.tables.handle.any():
            self.call(kernels.RELEASE, self.tables.b, self.tables.x)


class Factoriser:
    """PARDISO for one matrix after another. A structure is analysed once; with it goes the permutation that brings large entries
    to the diagonal, for the values that it is analysed with.

    symmetric: take the entries on and above the diagonal only, all of the diagonal among them.
    matching: bring large entries to the diagonal.
    threads: default: as many as suit the size of the matrix.
    order: int32 [n], of elimination, `order` of a factoriser of matrices of the same structure; not with matching. Default: by
        METIS.
    count, analyses, refused: factorisations and analyses until now, and equations that SuperLU solved instead.
    scales: ((float64 [n], float64 [n]), float64 [entries]), factors of rows and columns of an earlier matrix of this structure,
        and of its entries.
    """

    name = "PARDISO"

    def __init__(self, mkl: Any, symmetric: bool = False, matching: bool = True, threads: int | None = None,
                 order: Array | None = None) -> None:
        self._mkl, self._symmetric, self._threads, self._order = mkl, symmetric, threads, order
        # matching finds an order for the present values; otherwise the order is given, or kept
        self._settings = {10: 1, 12: 1} if matching else {4: 2 if order is None else 1}
        self._memory: PardisoMemory | None = None
        self._indices = self._indptr = np.zeros(0, np.int32)
        # entries that PARDISO takes
        self._upper: Array | slice = slice(None)
        self._kind = 0
        self.count = self.analyses = self.refused = 0
        self.is_fresh = False
        self.scales: tuple[tuple[Array, Array], Array] | None = None

    def forget(self) -> None:
        """Forget the structure and values of earlier matrices, on which the bits of solutions depend."""
        self._memory = self.scales = None
        self._indices = self._indptr = np.zeros(0, np.int32)

    def knows(self, matrix: Any) -> bool:
        """Return whether a matrix by rows has the structure that was analysed last."""
        if self._memory is None or self._indices.size != matrix.indices.size:
            return False
        return self._indices is matrix.indices or (
            np.array_equal(self._indices, matrix.indices) and np.array_equal(self._indptr, matrix.indptr))

    def factor(self, matrix: Any, data: Array, again: bool = False) -> bool:
        """Factor a matrix with the structure of one by rows and these entries; again: analyse it even if its structure is that of
        the last one."""
        is_complex = data.dtype.kind == "c"
        kind = ((kernels.UNSYMMETRIC, kernels.SYMMETRIC), (COMPLEX, COMPLEX_SYMMETRIC))[is_complex][self._symmetric]
        self.is_fresh = again or kind != self._kind or not self.knows(matrix)
        if self.is_fresh:
            # free the memory of another structure first
            self._memory = None
            self._indices, self._indptr, self._kind = matrix.indices, matrix.indptr, kind
            indptr = matrix.indptr
            self._upper = slice(None)
            if self._symmetric:
                self._upper = matrix.indices >= rows_of(matrix)
                indptr = np.concatenate(([0], np.cumsum(self._upper)))[indptr]
            tables = pardiso_tables(indptr, matrix.indices[self._upper], kind, self._settings)
            if is_complex:
                tables = tables._replace(data=empty(2 * tables.indices.size))
            if self._order is not None:
                tables.perm[:] = self._order
            self._memory = PardisoMemory(self._mkl, tables, threads_for(self._mkl, indptr.size - 1, self._threads))
        assert self._memory is not None
        t = self._memory.tables
        t.data[:] = data[self._upper].view(float)
        if self.is_fresh:
            self.analyses += 1
            if self._memory.call(kernels.ANALYSE, t.b, t.x):
                return False
        self.count += 1
        return self._memory.call(kernels.FACTOR, t.b, t.x) == 0

    @property
    def order(self) -> Array | None:
        """Order of elimination, int32 [n], for another factoriser; None with matching."""
        return self._memory.tables.perm if self._memory is not None and 4 in self._settings else None

    @property
    def perturbed(self) -> int:
        """Number of pivots of the last matrix that were so small that PARDISO changed them."""
        return 0 if self._memory is None else int(self._memory.tables.iparm[13])

    @property
    def negative(self) -> int | None:
        """Number of negative eigenvalues of the last matrix; None where it is not symmetric, or pivots were changed."""
        counts = self._memory is not None and self._kind == kernels.SYMMETRIC and not self.perturbed
        return int(self._memory.tables.iparm[22]) if self._memory is not None and counts else None

    def solve(self, right: Array, transposed: bool = False) -> Array:
        """Solve with the last matrix, or its transpose, for right-hand side [n], or rows of several [m, n]; NaN if PARDISO
        fails."""
        memory = self._memory
        assert memory is not None
        memory.tables.iparm[11] = 2 * (transposed and not self._symmetric)
        b = np.ascontiguousarray(right if right.ndim > 1 else right[None])
        x = np.empty(b.shape, b.dtype)
        failed = memory.call(kernels.SOLVE, b.view(float), x.view(float))
        return np.full(right.shape, np.nan) if failed else x.reshape(right.shape)


def factoriser_for(backend: str, **options: Any) -> Factoriser | None:
    """Make a factoriser with these options; None where SuperLU is wanted, or all there is. Raises BackendError: backend='pardiso'
    without MKL."""
    mkl = mkl_for(backend)
    return None if mkl is None else Factoriser(mkl, **options)


def solver_name(factoriser: Factoriser | None, unknowns: str) -> str:
    """Return the name of the solver on these unknowns and its number of factorisations, for a result."""
    if factoriser is None or not factoriser.count:
        return f"SuperLU on {unknowns}"
    return f"PARDISO on {unknowns}, {factoriser.count} factorisations, {factoriser.refused} left to SuperLU"


class LU:
    """SuperLU's factors of one matrix, as `lu` returns them; `raw`: SciPy's object."""

    name, perturbed, order = "SuperLU", 0, None

    def __init__(self, raw: Any) -> None:
        self.raw = raw

    def solve(self, right: Array, transposed: bool = False) -> Array:
        """Solve with the matrix, or its transpose, for right-hand side [n], or rows of several [m, n]."""
        x = self.raw.solve(np.ascontiguousarray(right.T), "T" if transposed else "N")
        return np.ascontiguousarray(x.T)

    @cached_property
    def pivots(self) -> Array | None:
        """Pivots in the order of the rows, those of a symmetric matrix have the signs of its eigenvalues; None where rows were
        exchanged."""
        # perm_c[j] is where column j went
        unmoved = np.array_equal(self.raw.perm_r, self.raw.perm_c)
        return self.raw.U.diagonal()[self.raw.perm_c] if unmoved else None

    @property
    def negative(self) -> int | None:
        """Number of negative eigenvalues of a symmetric matrix; None where rows were exchanged."""
        return None if self.pivots is None else int(np.sum(self.pivots < 0.0))


def lu(matrix: Any, options: dict[str, Any] | None = None, least: float = 0.0) -> LU | None:
    """Factor a sparse matrix by SuperLU; None where it is singular, or a pivot is smaller than this share of the largest.

    matrix: sparse matrix [n, n].
    options: of SciPy's `splu`. Default: partial pivoting.
    """
    matrix = matrix.tocsc()
    # SuperLU writes beyond its arrays where a matrix is singular whatever its entries are (SciPy 1.17)
    if not np.all(matrix.diagonal()) and sparse.csgraph.structural_rank(matrix) < matrix.shape[0]:
        return None
    try:
        found = LU(sparse.linalg.splu(matrix, **(options or {})))
    except RuntimeError:
        return None
    if least:
        pivots = np.abs(found.raw.U.diagonal())
        return found if np.min(pivots, initial=np.inf) > least * np.max(pivots, initial=0.0) else None
    return found


class Factors:
    """One matrix, factored when it is first solved, by the first solver whose solutions are accepted.

    matrix: sparse by rows [n, n], real or complex.
    factoriser: used before SuperLU.
    scales: (float64 [n], float64 [n]), factors of rows and columns; the same for both where the factoriser is a symmetric one.
        Default: those that bring them to a size of 1.
    give: float64 [n], added to the diagonal of the scaled matrix that is factored, and taken out again by the refinement; the
        matrix has all of its diagonal then.
    exchange: share of the largest entry of a column from which on SuperLU takes the one on the diagonal, when first asked.
    residual: residual of the last solution, relative to the right-hand side, in scaled rows.
    factorisations: number until now.
    by: solver whose solutions were accepted.
    """

    def __init__(self, matrix: Any, factoriser: Factoriser | None = None, limits: Limits = EXACT,
                 scales: tuple[Array, Array] | None = None, give: Array | None = None, exchange: float = 0.1) -> None:
        self.matrix, self.limits, self._factoriser = matrix, limits, factoriser
        self.is_finite = bool(np.logical_and.reduce(np.isfinite(matrix.data)))
        self._scales, self._give = scales, give
        self.residual, self.factorisations = 0.0, 0
        # factorisations to try in turn: by PARDISO, with the known analysis or another one, by SuperLU with options
        self._ways: list[bool | dict[str, Any]] = [] if factoriser is None else [False, True]
        self._ways += [SYMMETRIC_MODE | {"diag_pivot_thresh": exchange}, {}]
        self.by: Factoriser | LU | None = None
        self._last: LU | None = None
        self._number, self._least = 0, -1.0

    @property
    def scales(self) -> tuple[Array, Array]:
        """Factors of rows and columns that bring them to a size of 1, [n] each."""
        if self._scales is None:
            self._scales = self._find_scales()
        return self._scales

    def _find_scales(self) -> tuple[Array, Array]:
        known = self._factoriser
        if not self.is_finite:
            return (np.ones(self.matrix.shape[0]),) * 2
        if known is not None and known.scales is not None and known.knows(self.matrix):
            # factors of an earlier matrix are used as long as no row has grown or shrunk much
            data = self.matrix.data * known.scales[1]
            sizes = np.maximum.reduceat(np.abs(data), self.matrix.indptr[:-1])
            if 1.0 / FAR <= np.minimum.reduce(sizes) and np.maximum.reduce(sizes) <= FAR:
                self._data = data
                return known.scales[0]
        scales = equilibrated(self.matrix)
        factors = entry_scales(self.matrix, *scales)
        self._data = self.matrix.data * factors
        if known is not None:
            has_empty = np.logical_or.reduce(self.matrix.indptr[1:] == self.matrix.indptr[:-1])
            known.scales = None if has_empty else (scales, factors)
        return scales

    @property
    def row(self) -> Array:
        """Factors of the rows [n]."""
        return self.scales[0]

    @property
    def column(self) -> Array:
        """Factors of the columns [n]."""
        return self.scales[1]

    @cached_property
    def scaled(self) -> Any:
        """The matrix with rows and columns of size 1, by rows."""
        return with_values(self.matrix, self._data)

    @cached_property
    def _data(self) -> Array:
        """Entries of `scaled`, unless `scales` has kept them."""
        return np.asarray(self.matrix.data * entry_scales(self.matrix, *self.scales))

    @property
    def _held(self) -> Array:
        """Entries of the matrix that is factored."""
        if self._give is None:
            return self._data
        data = self._data.copy()
        data[self.matrix.indices == rows_of(self.matrix)] += self._give
        return data

    def solve(self, right: Array, transposed: bool = False) -> Array | None:
        """Return x with matrix x = right, or with its transpose, for right-hand side [n], or rows of several [m, n]; None if no
        solution is accepted."""
        if not (self.is_finite and np.logical_and.reduce(np.isfinite(right), axis=None)):
            return None
        into, out = self.scales[::-1] if transposed else self.scales
        x = self.solve_scaled(into * right, transposed)
        return None if x is None else np.asarray(out * x)

    def solve_scaled(self, b: Array, transposed: bool = False, most_given: float = np.inf) -> Array | None:
        """Run `solve` in scaled rows and unknowns; most_given: share of the right-hand sides that `give` may take up at
        multipliers, where it is negative."""
        fair: tuple[Factoriser | LU, Array, float] | None = None
        if not self.factorisations:
            self._advance()
        while self.by is not None:
            solve = partial(self.solve_roughly, transposed=transposed)
            x, self.residual = refined(solve, self._residual_of(b, transposed), b, self.limits)
            if self._is_accepted(x, b, transposed):
                if not most_given < np.inf or self._given(x) <= most_given * float(np.max(np.abs(b), initial=0.0)):
                    return x
            elif fair is None and self._is_fair(x, b, transposed):
                fair = self.by, x, self.residual
            self._advance()
        return self._otherwise(b, transposed, fair)

    def solve_roughly(self, b: Array, transposed: bool = False) -> Array:
        """Solve by the factors alone, in scaled rows and unknowns, after another solution."""
        by = self.by
        assert by is not None
        if isinstance(by, Factoriser) and by.count != self._number:
            # another matrix came between
            by.factor(self.matrix, self._held)
            self._number, self.factorisations = by.count, self.factorisations + 1
        if b.dtype.kind == "c" and self.matrix.data.dtype.kind != "c":
            x = by.solve(np.array([b.real, b.imag]).reshape(-1, b.shape[-1]), transposed).reshape(2, *b.shape)
            return np.asarray(x[0] + 1j * x[1])
        return by.solve(b, transposed)

    @property
    def is_singular(self) -> bool:
        """True if the matrix is singular to round-off, after a solution with it."""
        return self.by is None or self._least_singular_value() <= SINGULAR

    def _otherwise(self, b: Array, transposed: bool, fair: tuple[Factoriser | LU, Array, float] | None) -> Array | None:
        """Return a solution if none was accepted, or None; fair: solver, solution and residual that was round-off of large
        terms."""
        return None

    def _advance(self) -> None:
        """Go on to the next solver that factors the matrix."""
        self.by, self._least, by = None, -1.0, self._factoriser
        while self.by is None and self._ways:
            strategy = self._ways.pop(0)
            self.factorisations += 1
            if not isinstance(strategy, bool):
                regularised = with_values(self.matrix, self._held).tocsc()
                self.by = found = lu(regularised, strategy, LEAST_PIVOT if self.limits.is_strict else 0.0)
                self._last = found or self._last
                if strategy and by is not None:
                    by.refused += 1
            elif by is not None:
                self.by = by if by.factor(self.matrix, self._held, strategy) else None
                self._number = by.count
                if by.is_fresh and not strategy:
                    # another analysis would be the same
                    self._ways.pop(0)

    def _residual_of(self, b: Array, transposed: bool) -> Callable[[Array, Array, Array], Any]:
        """Return the function that puts residuals b - A x of the scaled matrix into an array and returns their norms, given x and
        right-hand sides such as b."""
        if b.ndim > 1 or transposed or "c" in (b.dtype.kind, self.matrix.data.dtype.kind):
            matrix = self.scaled.T if transposed else self.scaled
            return lambda x, b, rest_out: norms_of_rows(np.subtract(b, (matrix @ x.T).T, out=rest_out))
        structure = [x.astype(np.int32, copy=False) for x in (self.matrix.indptr, self.matrix.indices)]
        return partial(leave, self.matrix.data, *structure, *self.scales)

    def _is_accepted(self, x: Array, b: Array, transposed: bool) -> bool:
        of = self.limits
        assert self.by is not None
        if self.residual <= of.accepted and not (of.is_strict and self.by.perturbed):
            return True
        return self._is_fair(x, b, transposed) and not (of.is_strict and self._least_singular_value() <= CLEARLY_REGULAR)

    def _is_fair(self, x: Array, b: Array, transposed: bool) -> bool:
        """Return whether the residual is small, or round-off of large terms."""
        if not self.residual <= self.limits.fair or not np.isfinite(x).all():
            return False
        matrix = abs(self.scaled.T if transposed else self.scaled)
        terms = float(np.max((matrix @ np.abs(x).T).T + np.abs(b)))
        remainder = np.empty_like(x)
        self._residual_of(b, transposed)(x, b, remainder)
        return float(np.max(np.abs(remainder))) <= self.limits.round_off * terms

    def _given(self, x: Array) -> float:
        """Return the part of the right-hand sides that `give` takes up at multipliers."""
        return 0.0 if self._give is None else float(np.max(np.abs(np.minimum(self._give, 0.0) * x)))

    def _least_singular_value(self) -> float:
        """Return the smallest singular value of the scaled matrix, from above, by inverse iteration; 0 if that fails."""
        if self._least < 0.0:
            v, self._least = np.random.default_rng(0).standard_normal(self.matrix.shape[0]), 0.0
            for _ in range(2):
                v = self.solve_roughly(v)
                # those of a singular matrix may be too large
                with np.errstate(over="ignore"):
                    size = float(norms_of_rows(v))
                if not 0.0 < size < np.inf:
                    return 0.0
                v = v / size
            self._least = float(norms_of_rows(self.scaled @ v))
        return self._least


def refined(solve: Callable[[Array], Array], rest_of: Callable[[Array, Array, Array], Any], right: Array,
            limits: Limits) -> tuple[Array, float]:
    """Refine solutions of equations for a right-hand side [n], or rows of several [m, n], as long as that helps; return the best
    and the largest residual next to its right-hand side. solve: by factors; rest_of: puts residuals of solutions and
    right-hand sides into an array, and returns their norms."""
    size = norms_of_rows(right)
    size += size == 0.0
    x = best = solve(right)
    worst = np.inf
    for k in range(limits.most + 1):
        remainder = np.empty(x.shape, x.dtype)
        norms = rest_of(x, right, remainder)
        left = float(np.maximum.reduce(norms / size, axis=None))
        if not left < worst:
            break
        goes_on, worst, best = left < 0.5 * worst, left, x
        if not goes_on or left <= limits.good or k == limits.most or (k >= limits.enough and left <= limits.accepted):
            break
        if limits.last_bits and left <= CLEAR and np.all(norms <= limits.last_bits * norms_of_rows(x)):
            break
        x = x + solve(remainder)
    return best, worst


def norms_of_rows(x: Array) -> Array:
    """Return norms of rows; without BLAS, which starts threads for it."""
    return np.asarray(np.sqrt(np.add.reduce((x * x.conj()).real, axis=-1)))
