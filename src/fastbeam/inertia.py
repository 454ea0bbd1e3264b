"""Signs of the eigenvalues of sparse matrices: how many directions of an equilibrium are unstable, and how many free.

They are the signs of the pivots of a symmetric matrix (Sylvester's law of inertia), and the sign of the determinant where a
matrix is not symmetric. Matrices of a small bandwidth are factored as bands, others by SuperLU.
"""
from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from .kernels import band

Array = np.ndarray
# eigenvalues of a matrix scaled to a diagonal of 1: smaller ones are round-off
ZERO_EIGENVALUE = 1e-13
# where all pivots lie above this share of their diagonal entries no eigenvalue is zero
CLEAR_PIVOT = 1e-6
# a negative pivot above this share is no round-off of a free motion, which in long beams grows to 1e-9
NEGATIVE_PIVOT = 1e-8
# of a matrix that is factored as a band: entries beside its diagonal, and operations
WIDEST, MOST_IN_BAND = 128, 2e7
# skew parts up to this share of the diagonal are round-off
SKEW = 1e-8


class Blocks:
    """A matrix of square blocks.

    Parameters
    ----------
    n : int
        Rows.
    rows, columns : array [m] of int
        Of blocks; no block twice.
    blocks : array [m, size, 8]
    size : int
    """

    def __init__(self, n: int, rows: Array, columns: Array, blocks: Array, size: int) -> None:
        self.n, self._rows, self._columns, self._blocks, self._size = n, rows, columns, blocks, size
        self.width = size * (int(np.max(np.abs(rows - columns), initial=0)) + 1) - 1

    def add_half(self, upper: Array) -> None:
        """Its symmetric part, as `kernels.band` keeps it."""
        band.add_blocks(self._rows, self._columns, self._blocks, self._size, upper)

    def put(self, whole: Array) -> None:
        """All of it, as `kernels.band` keeps it."""
        band.put_blocks(self._rows, self._columns, self._blocks, self._size, self.width, whole)

    @cached_property
    def by_rows(self) -> Any:
        """In scipy's format csr."""
        from scipy import sparse
        data = np.ascontiguousarray(self._blocks[:, :, :self._size])
        indptr = np.searchsorted(self._rows, np.arange(self.n // self._size + 1))
        return sparse.bsr_matrix((data, self._columns, indptr), shape=(self.n, self.n)).tocsr()

    @cached_property
    def matrix(self) -> Any:
        """By columns."""
        return self.by_rows.tocsc()


class Entries:
    """A matrix by rows.

    Parameters
    ----------
    matrix : sparse matrix or array [n, n]
        In scipy's format csr.
    """

    def __init__(self, matrix: Any) -> None:
        self._by_rows, self.n = matrix, matrix.shape[0]
        matrix.sum_duplicates()
        rows = np.repeat(np.arange(self.n), np.diff(matrix.indptr))
        self.width = int(np.max(np.abs(matrix.indices - rows), initial=0))

    def add_half(self, upper: Array) -> None:
        """Its symmetric part, as `kernels.band` keeps it."""
        band.add_entries(self._by_rows.indptr, self._by_rows.indices, self._by_rows.data, upper)

    def put(self, whole: Array) -> None:
        """All of it, as `kernels.band` keeps it."""
        band.put_entries(self._by_rows.indptr, self._by_rows.indices, self._by_rows.data, self.width, whole)

    @cached_property
    def matrix(self) -> Any:
        """By columns."""
        return self._by_rows.tocsc()


class Signs:
    """Signs of the eigenvalues of a matrix.

    Parameters
    ----------
    of : Blocks or Entries
    """

    def __init__(self, of: Blocks | Entries) -> None:
        self._of = of
        self._is_narrow = of.width <= WIDEST and of.n * of.width**2 <= MOST_IN_BAND

    def count(self, symmetric: bool) -> tuple[int, int] | None:
        """Numbers of negative eigenvalues, if it is symmetric but for round-off, and of those that are zero to it.

        Of a matrix that is not symmetric the same where they are (0, 0): then all its eigenvalues have a positive real part
        (Bendixson). Else (1, 0) where its determinant is negative, which takes an odd number of negative eigenvalues. None where
        neither decides, or the eigenvalues cannot be counted."""
        clear = self.clear()
        if clear is not None and (symmetric or clear == (0, 0)):
            return clear
        # stiffnesses differ by many powers of ten
        if not symmetric and self.skew(np.sqrt(1.0 / self._diagonal())) > SKEW:
            # at first without the eigenvalues next to zero
            is_positive = self.clear(NEGATIVE_PIVOT) in (None, (0, 0)) and self._of_symmetric_part() == (0, 0)
            return (0, 0) if is_positive else (1, 0) if self.determinant() < 0 else None
        return clear or self._of_symmetric_part()

    def clear(self, least: float = CLEAR_PIVOT) -> tuple[int, int] | None:
        """Of the symmetric part, from pivots in the order of the rows; None where the band is wide, or a pivot is not above the
        least share of its diagonal entry."""
        if not self._is_narrow:
            return None
        upper = np.zeros((self._of.n, self._of.width + 2))
        self._of.add_half(upper)
        count = int(band.negative_pivots(upper, least))
        return None if count < 0 else (count, 0)

    def skew(self, scale: Array) -> float:
        """Largest entry of the difference to the transposed matrix, rows and columns multiplied by a scale [n]."""
        if self._whole is not None:
            return float(band.largest_skew(self._whole, self._of.width, scale))
        skew = (self._of.matrix - self._of.matrix.T).tocoo()
        return float(np.max(np.abs(skew.data) * scale[skew.row] * scale[skew.col], initial=0.0))

    def determinant(self) -> int:
        """Its sign: 1, -1, or 0 where the matrix is singular."""
        if self._whole is not None:
            from scipy.linalg.lapack import dgbtrf
            width = self._of.width
            lapack, exchanged, fault = dgbtrf(self._whole.T, width, width)
            if fault:
                return 0
            signs, odd = np.sign(lapack[2 * width]), np.sum(exchanged != np.arange(exchanged.size)) % 2
        else:
            from scipy.sparse.linalg import splu
            try:
                factors = splu(self._of.matrix)
            except RuntimeError:
                return 0
            signs = np.sign(np.concatenate((factors.L.diagonal(), factors.U.diagonal())))
            odd = _is_odd(factors.perm_r) ^ _is_odd(factors.perm_c)
        return int(np.prod(signs)) * (-1 if odd else 1)

    @cached_property
    def _whole(self) -> Array | None:
        """The matrix as a band, None where it is wide."""
        if not self._is_narrow:
            return None
        whole = np.zeros((self._of.n, 3 * self._of.width + 1))
        self._of.put(whole)
        return whole

    def _diagonal(self) -> Array:
        return _sizes(self._of.matrix.diagonal() if self._whole is None else self._whole[:, 2 * self._of.width])

    def _of_symmetric_part(self) -> tuple[int, int] | None:
        return inertia(0.5 * (self._of.matrix + self._of.matrix.T))


def inertia(matrix: Any) -> tuple[int, int] | None:
    """Numbers of negative eigenvalues of a symmetric matrix and of those that are zero to round-off, counted as pivots
    (Sylvester). None where row exchanges spoil the count or eigenvalues are not found.

    Round-off makes the sign of a pivot of a free motion arbitrary, and in long beams grows in it to 1e-9 of the diagonal. Where
    a pivot is small, the eigenvalues nearest to zero are therefore computed, and negative ones counted behind the gap next to
    those that vanish."""
    from scipy import sparse
    diagonal = np.abs(matrix.diagonal())
    pivots = _pivots(matrix)
    if pivots is not None and np.all(np.abs(pivots) > CLEAR_PIVOT * diagonal):
        return int(np.sum(pivots < 0.0)), 0
    scale = sparse.diags(np.sqrt(1.0 / _sizes(matrix.diagonal())), format="csc")
    scaled = scale @ matrix @ scale
    near = _nearest_to_zero(scaled)
    if near is None:
        return None
    zero = np.abs(near) <= ZERO_EIGENVALUE
    next_one = np.min(np.abs(near[~zero]), initial=1.0)
    shift = np.sqrt(ZERO_EIGENVALUE * next_one)
    pivots = _pivots((scaled + shift * sparse.identity(scaled.shape[0], format="csc")).tocsc())
    return None if pivots is None else (int(np.sum(pivots < 0.0)), int(np.sum(zero)))


def _sizes(diagonal: Array) -> Array:
    """Of its entries, 1 for those that vanish."""
    sizes = np.abs(diagonal)
    return np.where(sizes > 0.0, sizes, 1.0)


def _pivots(matrix: Any) -> Array | None:
    """Pivots of a symmetric matrix in the order of its rows; None where the matrix is singular or rows were exchanged."""
    from scipy.sparse.linalg import splu
    try:
        factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError:
        return None
    # perm_c[j] is where column j went
    return factors.U.diagonal()[factors.perm_c] if np.array_equal(factors.perm_r, factors.perm_c) else None


def _nearest_to_zero(matrix: Any) -> Array | None:
    """Eigenvalues nearest to zero of a symmetric matrix with a diagonal of 1, so many that one at least is no round-off; None
    where they cannot be found."""
    from scipy.sparse.linalg import ArpackError, eigsh
    n = matrix.shape[0]
    if n <= 100:
        return np.linalg.eigvalsh(matrix.toarray())
    count = 4
    while count < n // 2:
        try:
            # about a point beside zero, where the matrix is not singular
            near = eigsh(matrix, count, sigma=-1e-11, v0=np.ones(n), return_eigenvectors=False)
        except (ArpackError, RuntimeError):
            return None
        if np.any(np.abs(near) > ZERO_EIGENVALUE):
            return near
        count *= 4
    return None


def _is_odd(order: Array) -> bool:
    """Whether a permutation takes an odd number of exchanges: those of each of its cycles are one less than its length."""
    seen = np.zeros(order.size, bool)
    cycles = 0
    for k in range(order.size):
        cycles += not seen[k]
        while not seen[k]:
            seen[k] = True
            k = order[k]
    return bool((order.size - cycles) % 2)
