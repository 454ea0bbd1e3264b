"""Equations with constraints as one matrix: solved by PARDISO, or by SuperLU with pivoting across all of it, and its inertia.

    [ A   B^T ] [ x ]   [ b ]      x: coordinates (nodes in m and rad, sliding coordinates in m)
    [ B'   0  ] [ m ] = [ c ]      m: multipliers (forces), in any number and any units

A may be singular and so may be its diagonal (a mass has no stiffness): only the whole is solved. Rows and columns are brought to
a size of 1 first, so units do not matter. Where the matrix is singular to round-off (a free motion, the same constraint twice)
its null vectors are found by inverse iteration and left out of the solution; what the right-hand side asks for along them is
kept apart.

PARDISO perturbs small pivots and may return garbage without an error code: what it finds counts where the residual says so and no
singular value is near round-off; else SuperLU goes on.
"""
from __future__ import annotations

import math
import sys
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from fastbeam.interface.errors import BackendError
from fastbeam.kernels.linalg import pardiso as kernels
from fastbeam.kernels.linalg.pardiso import PardisoTables
from fastbeam.kernels.linalg.scaling import balance, leave
from fastbeam.linalg.inertia import (SKEW, Entries, Nodes, Signs, Terms, held, inertia, negative_pivots, orthonormal_columns,
    sizes_of)
from fastbeam.linalg.mkl import load_mkl, pardiso_tables

Array = np.ndarray
# sweeps of the equilibration; each halves the exponent of what is missing
SWEEPS = 12
# relative residual of a regular matrix; of a solution that is accepted; backward error that is round-off
REGULAR, FAIR, ROUND_OFF = 1e-12, 1e-2, 1e-12
# one that is not refined any more
GOOD = 1e-14
# a smaller pivot next to the largest tells a singular matrix
LEAST_PIVOT = 1e-15
# of the scaled matrix: singular values that are round-off (fine meshes of slender beams have some of 1e-14 that are not), what is
# added to the diagonal so that it can be factored, and null vectors that are looked for at most
NULL, SMALL, MOST_NULL = 3e-15, 1e-13, 12
# a matrix whose smallest singular value, as two inverse iterations find it, lies above this has no null vectors
CLEARLY_REGULAR = 10.0 * NULL
# share of B^T B that is added to A before its pivots are counted: any gives the same number; and multipliers up to which
# the rest is counted by eigenvalues of a dense matrix
PENALTIES, DENSE = (1e2, 1e4, 1e6), 4000
# eigenvalues of the matrix of the multipliers, next to its largest, that are round-off
ZERO = 1e-13


class Factors:
    """PARDISO's factors of one matrix after another. A structure is analysed once; with it goes the permutation that brings large
    entries to the diagonal, for the values that it is analysed with.

    Parameters
    ----------
    mkl : the MKL runtime
    symmetric : bool
        Matrices come as their entries on and above the diagonal, all of the diagonal among them.
    matching : bool
        Bring large entries to the diagonal.
    columns, threads : int
        Right-hand sides at once; threads.
    order : int32 [n], optional
        Of elimination, `order` of factors of a matrix of the same structure; not with matching. Default: by METIS.

    Attributes
    ----------
    count, analyses, refused : int
        Factorisations and analyses until now, and equations that SuperLU solved instead.
    """

    def __init__(self, mkl: Any, symmetric: bool = False, matching: bool = True, columns: int = 1, threads: int = 1,
                 order: Array | None = None) -> None:
        self._mkl, self._threads, self._columns = mkl, threads, columns
        self._kind = kernels.SYMMETRIC if symmetric else kernels.UNSYMMETRIC
        # matching finds an order for the values in hand; else it is given, or kept
        self._settings = {10: 1, 12: 1} if matching else {4: 2 if order is None else 1}
        self._order = order
        self._tables: PardisoTables | None = None
        self._indices = self._indptr = np.zeros(0, np.int32)
        self.count = self.analyses = self.refused = 0
        self.is_fresh = False

    def factor(self, matrix: Any, again: bool = False) -> bool:
        """Factor a sparse matrix by rows; again: analyse it even if its structure is that of the last one."""
        known = self._tables is not None and not again and self._indices.size == matrix.indices.size
        if known and self._indices is not matrix.indices:
            known = np.array_equal(self._indices, matrix.indices) and np.array_equal(self._indptr, matrix.indptr)
        self.is_fresh = not known
        if not known:
            self._begin(matrix)
        t = self._tables
        assert t is not None
        t.data[:] = matrix.data
        if not known:
            self.analyses += 1
            if self._call(t, kernels.ANALYSE):
                return False
        self.count += 1
        return self._call(t, kernels.FACTOR) == 0

    def _call(self, t: PardisoTables, phase: int) -> int:
        """PARDISO on these threads, the calling one among them; its error code."""
        before = self._mkl.MKL_Set_Num_Threads_Local(self._threads)
        try:
            return int(kernels.call_pardiso(t, phase, t.b, t.x))
        finally:
            self._mkl.MKL_Set_Num_Threads_Local(before)

    def _begin(self, matrix: Any) -> None:
        """Tables of another structure."""
        self._release()
        self._indices, self._indptr = matrix.indices, matrix.indptr
        self._tables = pardiso_tables(matrix.indptr, matrix.indices, self._kind, self._settings, self._columns)
        if self._order is not None:
            self._tables.perm[:] = self._order

    @property
    def order(self) -> Array | None:
        """Of elimination, int32 [n], for other factors; None with matching."""
        return self._tables.perm if self._tables is not None and 4 in self._settings else None

    @property
    def perturbed(self) -> int:
        """Number of pivots of the last matrix that were so small that PARDISO changed them."""
        return 0 if self._tables is None else int(self._tables.iparm[13])

    @property
    def negative(self) -> int:
        """Number of negative eigenvalues of the last matrix, a symmetric one."""
        return -1 if self._tables is None else int(self._tables.iparm[22])

    def solve(self, right: Array) -> Array:
        """Of the last matrix for right-hand side [n], or as many as there are columns [m, n]; NaN where PARDISO fails."""
        t = self._tables
        assert t is not None
        t.b[:] = right
        failed = self._call(t, kernels.SOLVE)
        return np.full(right.shape, np.nan) if failed else t.x.reshape(right.shape).copy()

    def _release(self) -> None:
        if self._tables is not None and self._tables.handle.any():
            self._call(self._tables, kernels.RELEASE)
        self._tables = None

    def __del__(self, python_ends: Callable[[], bool] = sys.is_finalizing) -> None:
        # then modules may be gone before this, and the memory goes with the process
        if not python_ends():
            self._release()


def factors_for(backend: str) -> Factors | None:
    """PARDISO where it is wanted and there, else None.

    Raises
    ------
    BackendError
        backend='pardiso' without MKL.
    """
    mkl = None if backend == "superlu" else load_mkl()
    if mkl is None and backend == "pardiso":
        raise BackendError("backend='pardiso': no MKL runtime was found; pip install pypardiso, or use backend='auto'")
    return None if mkl is None else Factors(mkl)


class Saddle:
    """One matrix, factored when it is first solved.

    Parameters
    ----------
    matrix : sparse float64 [n, n] by rows
        All rows and columns, coordinates and multipliers in any order.
    multiplier : bool [n]
        Which unknowns are multipliers.
    factors : Factors, optional
        Asked before SuperLU.
    measured_in : (float64 [n], float64 [n]), optional
        `scales` of a matrix like this one, in which residuals of PARDISO's solutions are measured; default: its own.

    Attributes
    ----------
    is_singular : bool
        Whether the last solution left null vectors out.
    drift : float64 [n]
        Along these, what the right-hand side asks for, in no unit; zero where the matrix is regular.
    unbalanced : float
        Its share in the right-hand side, in scaled rows.
    left : float64 [n, m]
        Null vectors of the transposed matrix, along which the last solution leaves the right-hand side out.
    residual : float
        Of the rest of the last solution, relative to the right-hand side, in scaled rows.
    """

    def __init__(self, matrix: Any, multiplier: Array, factors: Factors | None = None,
                 measured_in: tuple[Array, Array] | None = None) -> None:
        self.measured_in = measured_in
        self.matrix, self.multiplier, self._factors = matrix, multiplier, factors
        self.is_finite = bool(np.logical_and.reduce(np.isfinite(self.matrix.data)))
        self.is_singular = False
        # which unknowns are those of nodes, and what finds one unknown of every free motion: for signs
        self.nodes: Nodes | None = None
        self.free: Callable[[Callable[[], Any]], Array] | None = None
        self.residual = self.unbalanced = 0.0
        self.drift, self.left = np.zeros(multiplier.size), np.zeros((multiplier.size, 0))

    @cached_property
    def scales(self) -> tuple[Array, Array]:
        """Factors of rows and columns that bring them to a size of 1, [n] each."""
        return equilibrated(self.matrix) if self.is_finite else (np.ones(self.multiplier.size),) * 2

    @property
    def _measure(self) -> tuple[Array, Array]:
        """Those of this matrix, or of one like it."""
        return self.scales if self.measured_in is None else self.measured_in

    @property
    def row(self) -> Array:
        """Factors of the rows that bring them to a size of 1 [n]."""
        return self.scales[0]

    @property
    def column(self) -> Array:
        """The same of the columns [n]."""
        return self.scales[1]

    @cached_property
    def scaled(self) -> Any:
        """The matrix with rows and columns of size 1, by columns."""
        from scipy import sparse
        return (sparse.diags(self.row) @ self.matrix.tocsc() @ sparse.diags(self.column)).tocsc()

    def stiffened(self, by: float) -> Saddle:
        """The same with this much on the diagonal of the coordinates, in scaled rows."""
        from scipy import sparse
        row, column = self._measure
        more = np.where(self.multiplier, 0.0, by / (row * column))
        n, indptr, indices = self.multiplier.size, self.matrix.indptr, self.matrix.indices
        at = np.flatnonzero(indices == np.repeat(np.arange(n), np.diff(indptr)))
        if not np.array_equal(indices[at][~self.multiplier[indices[at]]], np.flatnonzero(~self.multiplier)):
            return Saddle((self.matrix + sparse.diags(more)).tocsr(), self.multiplier, self._factors, self.measured_in)
        data = self.matrix.data.copy()
        data[at] += more[indices[at]]
        stiff = sparse.csr_matrix((data, indices, indptr), shape=self.matrix.shape)
        return Saddle(stiff, self.multiplier, self._factors, self.measured_in)

    def solve(self, right: Array) -> Array | None:
        """x [n] with matrix x = right [n]. None where nothing acceptable is found."""
        if not (self.is_finite and np.logical_and.reduce(np.isfinite(right))):
            return None
        self.is_singular, self.unbalanced, self.drift, self.left = False, 0.0, np.zeros(right.size), np.zeros((right.size, 0))
        x = self._by_pardiso(right) if self._factors is not None else None
        return self._by_superlu(right) if x is None else x

    def _by_pardiso(self, right: Array) -> Array | None:
        """None where it is not certain that the matrix is regular and the solution good."""
        factors = self._factors
        assert factors is not None
        row, column = self._measure
        matrix, b = self.matrix, row * right
        for again in (False, True):
            if factors.factor(matrix, again):
                x, self.residual = self._by_factors(factors, b, row, column)
                if self.residual <= REGULAR and not factors.perturbed:
                    return np.asarray(column * x)
                if self._is_fair(x, b, row, column) and least_singular_value(
                        lambda b: factors.solve(b / row) / column, lambda x: row * (matrix @ (column * x)),
                        b.size) > CLEARLY_REGULAR:
                    return np.asarray(column * x)
            if factors.is_fresh:
                break
        factors.refused += 1
        return None

    def _by_factors(self, factors: Factors, b: Array, row: Array, column: Array) -> tuple[Array, float]:
        """As `_refine`, with residuals in compiled code; b, and the solution, scaled by row, column."""
        matrix, size, rest = self.matrix, _norm(b) or 1.0, np.empty(b.size)
        structure = matrix.indptr.astype(np.int32, copy=False), matrix.indices.astype(np.int32, copy=False)
        x = factors.solve(b / row) / column
        left = leave(matrix.data, *structure, row, column, x, b, rest) / size
        for _ in range(2):
            if not GOOD < left < 1e3:
                break
            better = x + factors.solve(rest / row) / column
            found = leave(matrix.data, *structure, row, column, better, b, rest) / size
            if not found < left:
                break
            x, left = better, found
        return x, left

    def _by_superlu(self, right: Array) -> Array | None:
        b = self.row * right
        fair = last = None
        # the order that suits a symmetric structure first, then plain partial pivoting
        for options in ({"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.1, "options": {"SymmetricMode": True}}, {}):
            factors = _factors(self.scaled, options)
            if factors is None:
                continue
            x, self.residual = self._refined(factors, b, 2)
            if self.residual <= REGULAR:
                return self.column * x
            last = factors
            if self._is_fair(x, b, self.row, self.column):
                fair = x
                break
        found = self._deflated(b, last)
        if found is None:
            found = fair
        return None if found is None else self.column * found

    def _refined(self, factors: Any, b: Array, refinements: int,
                 without: tuple[Array, Array] | None = None) -> tuple[Array, float]:
        """Solution by factors, refined with the matrix as long as that helps, and its relative residual; without: orthonormal
        columns that the residual and the solution leave out."""
        def solved(rest: Array) -> Array:
            x = factors.solve(rest)
            return x if without is None else x - without[1] @ (without[1].T @ x)

        def rest_of(x: Array) -> Array:
            rest = b - self.scaled @ x
            return rest if without is None else rest - without[0] @ (without[0].T @ rest)

        return _refine(solved, rest_of, b, refinements)

    def _is_fair(self, x: Array, b: Array, row: Array, column: Array) -> bool:
        """Whether the residual is small, or what round-off leaves of large terms; x, b: scaled by row, column."""
        y = column * x
        rest = np.abs(b - row * (self.matrix @ y))
        size = np.max(row * (abs(self.matrix) @ np.abs(y)) + np.abs(b))
        return bool(self.residual <= FAIR and np.max(rest) <= ROUND_OFF * size)

    def _deflated(self, b: Array, factors: Any) -> Array | None:
        """Solution without null vectors; None where there are none, or nothing is found. factors: of the matrix, or None."""
        from scipy import sparse
        if factors is None:
            near = (self.scaled + sparse.diags(np.where(self.multiplier, -SMALL, SMALL), format="csc")).tocsc()
            factors = _factors(near, {}, 0.0)
        if factors is None:
            return None
        right = self._null(factors, "N")
        left = self._null(factors, "T") if right.shape[1] else right
        if not right.shape[1] or right.shape[1] != left.shape[1]:
            return None
        asked = left.T @ b
        x, self.residual = self._refined(factors, b - left @ asked, 6, (left, right))
        if not (np.isfinite(x).all() and self.residual <= FAIR):
            return None
        self.is_singular = True
        self.unbalanced, self.left = float(np.linalg.norm(asked)), self.row[:, None] * left
        # null vectors of both sides belong to each other through the matrix beside it
        self.drift = self.column * (right @ (right.T @ (left @ asked)))
        return x

    def _null(self, factors: Any, trans: str) -> Array:
        """Orthonormal null vectors of the scaled matrix, or of its transpose, by columns."""
        matrix = self.scaled if trans == "N" else self.scaled.T
        n = matrix.shape[0]
        for count in (1, min(n, MOST_NULL)):
            v = np.random.default_rng(0).standard_normal((n, count))
            for _ in range(3):
                v = orthonormal_columns(np.nan_to_num(factors.solve(np.ascontiguousarray(v), trans)))[0]
            _, sizes, turn = np.linalg.svd(orthonormal_columns(matrix @ v)[1])
            if not np.any(sizes <= NULL):
                break
        return v @ turn[sizes <= NULL].T

    def signs(self, symmetric: bool = True) -> tuple[int, int] | None:
        """Numbers of negative and of zero directions of A among the motions that the constraints allow, B x = 0; as
        `inertia.Signs.count` where the matrix is not symmetric. None where they are not found.

        A + p B^T B has on these motions the signs of A, whatever p is. Its negative eigenvalues less those of
        B (A + p B^T B)^-1 B^T are the number (Haynsworth), which is 0 where A + p B^T B has none."""
        if not self.multiplier.any():
            return Signs(Entries(self.matrix), self.nodes, self.free).count(symmetric)
        free = np.zeros(0, np.int64) if self.free is None else self.free(lambda: self.matrix)
        if not free.size and is_positive(self.matrix, self.multiplier):
            return 0, 0
        matrix = held(self.matrix, free) if free.size else self.matrix
        whole = (matrix + matrix.T).tocsr()
        whole.data *= 0.5
        factor = self.typical(whole)
        # the same factor for a row and its column; of coordinates none, between which differences are taken
        used = np.where(self.multiplier, factor, 1.0)
        whole.data *= np.repeat(used, np.diff(whole.indptr)) * used[whole.indices]
        found = signs_between(whole, self.multiplier, self.nodes)
        if not symmetric and found != (0, 0) and Signs(Entries(matrix)).skew(factor) > SKEW:
            return (1, free.size) if Saddle(matrix, self.multiplier).determinant_sign() < 0 else None
        return None if found is None else (found[0], found[1] + free.size)

    def typical(self, matrix: Any) -> Array:
        """Factors of rows and columns [n] that bring stiffnesses and constraints to a size of 1, in any units."""
        n = self.multiplier.size
        size, nodes = abs(matrix).tocsr(), self.nodes or Nodes(n, 1, 1)
        # what rests on round-off, as sliders may, does not count
        stiff = np.where(np.arange(n) < nodes.total, size.diagonal(), 0.0)
        return typical_factors(size, self.multiplier, nodes.turns(n), stiff)[1]

    def determinant_sign(self) -> int:
        """Of A among the motions that the constraints allow: 1, -1, or 0 where it is singular."""
        return Signs(Entries(self.matrix)).determinant() * (-1)**int(np.sum(self.multiplier))


def _norm(x: Array) -> float:
    """Without BLAS, which begins threads for it."""
    return math.sqrt(np.add.reduce(x * x))


def _refine(solved: Callable[[Array], Array], rest_of: Callable[[Array], Array], b: Array,
            refinements: int = 2) -> tuple[Array, float]:
    """Solution for b, refined as long as that helps, and its relative residual. solved: solution by factors; rest_of: residual of
    a solution."""
    size = _norm(b) or 1.0
    x = solved(b)
    rest = rest_of(x)
    left = _norm(rest) / size
    for _ in range(refinements):
        if not GOOD < left < 1e3:
            break
        better = x + solved(rest)
        rest = rest_of(better)
        found = _norm(rest) / size
        if not found < left:
            break
        x, left = better, found
    return x, left


def least_singular_value(solved: Callable[[Array], Array], times: Callable[[Array], Array], n: int) -> float:
    """The smallest singular value of a matrix, from above, by inverse iteration; 0 where that fails."""
    v = np.random.default_rng(0).standard_normal(n)
    for _ in range(2):
        v = solved(v)
        size = _norm(v)
        if not 0.0 < size < np.inf:
            return 0.0
        v /= size
    return _norm(times(v))


def _factors(matrix: Any, options: dict[str, Any], least: float = LEAST_PIVOT) -> Any:
    """Of SuperLU; None where a pivot vanishes."""
    from scipy.sparse.csgraph import structural_rank
    from scipy.sparse.linalg import splu
    # SuperLU writes beyond its arrays where a matrix is singular whatever its entries are (SciPy 1.17)
    if structural_rank(matrix) < matrix.shape[0]:
        return None
    try:
        factors = splu(matrix, **options)
    except RuntimeError:
        return None
    pivots = np.abs(factors.U.diagonal())
    return factors if np.min(pivots, initial=np.inf) > least * np.max(pivots, initial=0.0) else None


def _signs(a: Any, b: Any, nodes: Nodes | None) -> tuple[int, int] | None:
    """Negative and zero directions of a [n, n] where b x = 0, b [m, n]."""
    from scipy import sparse
    from scipy.sparse.linalg import splu
    found = None
    for penalty in PENALTIES:
        stiff = (a + penalty * (b.T @ b)).tocsc()
        found = inertia(stiff, nodes)
        if found is not None and (found[0] == 0 or b.shape[0] == 0):
            return found
        if found is None or found[1] or b.shape[0] > DENSE:
            continue
        scale = sparse.diags(1.0 / np.sqrt(sizes_of(stiff.diagonal())), format="csc")
        try:
            inverse = (b @ scale) @ splu((scale @ stiff @ scale).tocsc()).solve((scale @ b.T).toarray())
        except RuntimeError:
            continue
        values = np.linalg.eigvalsh(0.5 * (inverse + inverse.T))
        zero = np.abs(values) <= ZERO * np.max(np.abs(values))
        return found[0] - int(np.sum((values < 0.0) & ~zero)), int(np.sum(zero))
    return found


def is_positive(matrix: Any, multiplier: Array) -> bool:
    """Tell whether the symmetric part of a matrix by rows [n, n] is clearly positive on the motions that its constraints, the
    rows of multipliers [n], allow: all pivots of A + B^T D B are, with a D that brings B^T D B to the size of A."""
    from scipy.sparse.csgraph import reverse_cuthill_mckee
    n = multiplier.size
    row, column, data = np.repeat(np.arange(n), np.diff(matrix.indptr)), matrix.indices, matrix.data
    above, left = multiplier[row], multiplier[column]
    within, constrains, own = ~(above | left), above & ~left, row == column
    stiff = np.zeros(n)
    stiff[row[own]] = np.abs(data[own])
    # constraints, and all pairs of the entries of each
    b, j = data[constrains], column[constrains]
    count = np.bincount(row[constrains], minlength=n)
    first, size = (np.cumsum(count) - count)[count > 0], count[count > 0]
    largest = np.maximum.reduceat(b * b, first) if b.size else b
    weight = np.where(largest > 0.0, np.maximum.reduceat(stiff[j], first) / np.where(largest > 0.0, largest, 1.0), 0.0)
    pairs = np.repeat(size, size)
    one = np.repeat(np.arange(b.size), pairs)
    other = np.arange(one.size) + np.repeat(np.repeat(first, size) - np.cumsum(pairs) + pairs, pairs)
    half, i, k = 0.5 * data[within], row[within], column[within]
    values = np.concatenate((half, half, np.repeat(weight, size)[one] * b[one] * b[other]))
    order = reverse_cuthill_mckee(matrix, symmetric_mode=True)
    number = np.empty(n, np.int64)
    number[order] = np.add.accumulate(~multiplier[order], dtype=np.int64) - 1
    i, k = number[np.concatenate((i, k, j[one]))], number[np.concatenate((k, i, j[other]))]
    signs = Signs(Terms(n - int(np.add.reduce(multiplier)), i, k, values))
    return (signs.clear() if signs.is_narrow else (negative_pivots(signs.of.matrix), 0)) == (0, 0)


def signs_between(matrix: Any, multiplier: Array, nodes: Nodes | None = None) -> tuple[int, int] | None:
    """Numbers of negative and of zero directions of a symmetric matrix [n, n] among the motions that its constraints, the rows of
    multipliers [n], allow; None where they are not found. nodes: which unknowns are theirs."""
    if not multiplier.any():
        return inertia(matrix.tocsc(), nodes)
    return _signs(matrix[~multiplier][:, ~multiplier].tocsc(), matrix[multiplier][:, ~multiplier].tocsc(), nodes)


def equilibrated(matrix: Any, begin: tuple[Array, Array] | None = None) -> tuple[Array, Array]:
    """Factors of rows and columns [n], powers of two, with which the largest entry of each comes close to 1 (D. Ruiz, 2001); the
    same for both where the matrix is symmetric. 1 for those without entries. begin: factors to begin with; default: 1."""
    by_rows = matrix.tocsr()
    row, column = (np.ones(n) for n in by_rows.shape) if begin is None else begin
    structure = (x.astype(np.int32, copy=False) for x in (by_rows.indptr, by_rows.indices))
    balance(np.abs(by_rows.data), *structure, SWEEPS, row, column, np.zeros(row.size), np.zeros(column.size))
    return tuple(np.exp2(np.round(np.log2(x))) for x in (row, column))  # type: ignore[return-value]


def parity(size: float) -> float:
    """1 or 2, with which the power of two in a number becomes an even one: its root is a power of two as well."""
    return float(2.0**(np.frexp(size)[1] % 2))


def counted(stiff: Array, kind: Array) -> Array:
    """Which stiffnesses, bool [n], are more than round-off of the largest among those of one kind, bool [n]."""
    return stiff > ROUND_OFF * float(np.max(stiff[kind], initial=0.0))


def _levers(size: Any, of: tuple[Array, Array], multiplier: Array, turns: Array) -> Array:
    """Which entries, bool, are no round-off of a constraint: next to the largest by displacements, or by rotations."""
    joins = multiplier[of[0]] != multiplier[of[1]]
    of_turns = turns[np.where(multiplier[of[0]], of[1], of[0])]
    use = np.ones(size.data.size, bool)
    for kind in (joins & of_turns, joins & ~of_turns):
        use[kind] = counted(size.data, kind)[kind]
    return use


def typical_factors(size: Any, multiplier: Array, turns: Array, stiff: Array) -> tuple[float, Array, Array]:
    """Factors of a matrix, 1 or 2, of its rows, and of its columns, from typical stiffnesses against displacements and rotations,
    not from units. size: of the entries, by rows; stiff: stiffnesses, 0 where they do not count."""
    n, diagonal = multiplier.size, size.diagonal()
    of = np.repeat(np.arange(n), np.diff(size.indptr)), size.indices
    # rows of what is held have nothing beside the diagonal
    joined = np.zeros(n, bool)
    joined[of[0][(of[0] != of[1]) & (size.data > 0.0)]] = True
    once, row = 0.0, np.zeros(n)
    for kind in (~turns & ~multiplier, turns & ~multiplier):
        own = stiff[kind & joined & counted(stiff, kind & joined)]
        if own.size:
            typical = float(np.median(own))
            once = once or parity(typical)
            row[kind] = 1.0 / np.sqrt(once * typical)
    once = once or 1.0
    column, free = row.copy(), ~multiplier & (row == 0.0)
    use = _levers(size, of, multiplier, turns)
    # constraints, what has no stiffness by way of these, and constraints of nothing else
    for kind in (multiplier & joined, free, multiplier & joined):
        most = np.zeros((2, n))
        for largest, at, factor in zip(most, (of, of[::-1]), (column, row)):
            np.maximum.at(largest, at[0][use], once * size.data[use] * factor[at[1][use]])
        row, column = (np.where(kind & (factor == 0.0) & (largest > 0.0), 1.0 / np.where(largest > 0.0, largest, 1.0), factor)
                       for largest, factor in zip(most, (row, column)))
        for one in (free & turns, free & ~turns):
            for factor in (row, column):
                known = factor[one & (factor > 0.0)]
                factor[one & (factor == 0.0)] = np.median(known) if known.size else 0.0
    alone = ~joined & (diagonal > 0.0)
    column[column == 0.0] = row[row == 0.0] = 1.0
    row[alone] = 1.0 / (once * diagonal * column)[alone]
    return once, row, column
