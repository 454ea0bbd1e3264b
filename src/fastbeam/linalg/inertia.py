"""Signs of the eigenvalues of sparse matrices: numbers of unstable and of free directions of an equilibrium.

They are the signs of the pivots of a symmetric matrix (Sylvester's law of inertia), and the sign of the determinant where a
matrix is not symmetric. Matrices of a small bandwidth are factored as bands, others by SuperLU. Known free motions
(`free_motions`) are fixed before, because round-off makes the signs of their pivots arbitrary.
"""
from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.linalg import band
from fastbeam.linalg.factors import LU, SYMMETRIC_MODE, lu

Array = np.ndarray
# for a matrix scaled to a diagonal of 1, in which round-off moves eigenvalues by 1e-16 to 1e-15: if none is nearer to zero than
# CERTAIN, pivots count them; else those within the first of these widths that has no more than MOST_NEAR are computed
CERTAIN, WIDTHS, MOST_NEAR = 1e-14, (1e-12, 1e-13, 1e-14), 60
# inverse iteration for these: shift as a share of the width, vectors more than are wanted, and steps
SHIFT, MORE, SWEEPS = 0.01, 8, 6
# an eigenvalue is zero up to this multiple of the round-off of its terms
NOISE = 8.0
# sums of a row next to its terms, and skew parts of a block next to its diagonal, that are round-off; entries at once
LAST_BITS, SKEW_BLOCK, CHUNK = 3.0 * np.finfo(float).eps, 1e-14, 100_000
# if all pivots lie above this share of their diagonal entries, no eigenvalue is zero
CLEAR_PIVOT = 1e-6
# a negative pivot above this share is no round-off of a free motion, which in long beams grows to 1e-9
NEGATIVE_PIVOT = 1e-8
# limits for a matrix that is factored as a band: entries beside its diagonal, and operations
WIDEST, MOST_IN_BAND = 128, 2e7
# skew parts up to this share of the diagonal are round-off
SKEW = 1e-8


class Nodes(NamedTuple):
    """Unknowns that belong to nodes: the first ones of a matrix."""

    total: int    # unknowns of all nodes
    size: int     # unknowns of one node
    dim: int      # number of positions, the first unknowns of a node

    def turns(self, n: int) -> Array:
        """Return which of n unknowns are rotations of nodes, bool [n]."""
        k = np.arange(n)
        return (k < self.total) & (k % self.size >= self.dim)


class Blocks:
    """Matrix of square blocks.

    n: rows.
    rows, columns: array [m] of int, rows and columns of blocks; no block twice.
    blocks: array [m, size, 8].
    """

    def __init__(self, n: int, rows: Array, columns: Array, blocks: Array, size: int) -> None:
        self.n, self._rows, self._columns, self._blocks, self._size = n, rows, columns, blocks, size
        self.width = size * (int(np.max(np.abs(rows - columns), initial=0)) + 1) - 1

    def add_half(self, upper: Array) -> None:
        """Add the symmetric part to a band, as `kernels.band` keeps it."""
        band.add_blocks(self._rows, self._columns, self._blocks, self._size, upper)

    def put(self, whole: Array) -> None:
        """Store the whole matrix in a band, as `kernels.band` keeps it."""
        band.put_blocks(self._rows, self._columns, self._blocks, self._size, self.width, whole)

    @cached_property
    def by_rows(self) -> Any:
        """Matrix in scipy's format csr."""
        data = np.ascontiguousarray(self._blocks[:, :, :self._size])
        indptr = np.searchsorted(self._rows, np.arange(self.n // self._size + 1))
        return sparse.bsr_matrix((data, self._columns, indptr), shape=(self.n, self.n)).tocsr()

    @cached_property
    def matrix(self) -> Any:
        """Matrix by columns."""
        return self.by_rows.tocsc()


class Entries:
    """Matrix by rows; matrix: sparse matrix or array [n, n], in scipy's format csr."""

    def __init__(self, matrix: Any) -> None:
        self.by_rows, self.n = matrix, matrix.shape[0]
        matrix.sum_duplicates()
        rows = np.repeat(np.arange(self.n), np.diff(matrix.indptr))
        self.width = int(np.max(np.abs(matrix.indices - rows), initial=0))

    def add_half(self, upper: Array) -> None:
        """Add the symmetric part to a band, as `kernels.band` keeps it."""
        band.add_entries(self.by_rows.indptr, self.by_rows.indices, self.by_rows.data, upper)

    def put(self, whole: Array) -> None:
        """Store the whole matrix in a band, as `kernels.band` keeps it."""
        band.put_entries(self.by_rows.indptr, self.by_rows.indices, self.by_rows.data, self.width, whole)

    @cached_property
    def matrix(self) -> Any:
        """Matrix by columns."""
        return self.by_rows.tocsc()


class Terms:
    """Symmetric matrix as a sum of entries, of which several may stand at one place.

    n: rows.
    row, column, value: array [m], of the entries on both sides of the diagonal.
    """

    def __init__(self, n: int, row: Array, column: Array, value: Array) -> None:
        self.n, self._row, self._column, self._value = n, row, column, value
        self.width = int(np.maximum.reduce(column - row, initial=0))

    def add_half(self, upper: Array) -> None:
        """Add the entries to a band, as `kernels.band` keeps it."""
        at = self._column >= self._row
        np.add.at(upper, (self._row[at], self._column[at] - self._row[at]), self._value[at])

    @property
    def matrix(self) -> Any:
        """Sparse matrix by columns."""
        return sparse.csc_matrix((self._value, (self._row, self._column)), shape=(self.n, self.n))


class Signs:
    """Signs of the eigenvalues of a matrix.

    of: of terms only `clear` is known.
    free: function of what gives the matrix by rows -> int array, one unknown of every free motion that is known, to be held.
    """

    def __init__(self, of: Any, nodes: Nodes | None = None, free: Callable[[Callable[[], Any]], Array] | None = None) -> None:
        self.of, self._nodes, self._free = of, nodes, free
        self.is_narrow = of.width <= WIDEST and of.n * of.width**2 <= MOST_IN_BAND

    def count(self, symmetric: bool) -> tuple[int, int] | None:
        """Return numbers of negative eigenvalues, if the matrix is symmetric but for round-off, and of those that are zero to it.

        For a matrix that is not symmetric return (0, 0) if its symmetric part has them: then all its eigenvalues have a positive
        real part (Bendixson). Return (1, 0) if its determinant is negative, which takes an odd number of negative eigenvalues,
        and None if neither decides, or the eigenvalues cannot be counted."""
        free = self._free(lambda: self.of.by_rows) if self._free is not None else np.zeros(0, np.int64)
        if free.size:
            found = Signs(Entries(held(self.of.by_rows, free)), self._nodes).count(symmetric)
            return None if found is None else (found[0], found[1] + len(free))
        clear = self.clear()
        if clear is not None and (symmetric or clear == (0, 0)):
            return clear
        # scaled, because stiffnesses differ by many powers of ten
        if not symmetric and self.skew(np.sqrt(1.0 / self._diagonal())) > SKEW:
            # clearly negative pivots decide, before eigenvalues next to zero are computed
            is_positive = self.clear(NEGATIVE_PIVOT) in (None, (0, 0)) and self._of_symmetric_part() == (0, 0)
            return (0, 0) if is_positive else (1, 0) if self.determinant() < 0 else None
        return clear or self._of_symmetric_part()

    def clear(self, least: float = CLEAR_PIVOT) -> tuple[int, int] | None:
        """Return `count` of the symmetric part, from pivots in the order of the rows; None if the band is wide, or a pivot is not
        above the least share of its diagonal entry."""
        if not self.is_narrow:
            return None
        upper = np.zeros((self.of.n, self.of.width + 2))
        self.of.add_half(upper)
        count = int(band.negative_pivots(upper, least))
        return None if count < 0 else (count, 0)

    def skew(self, scale: Array) -> float:
        """Return the largest entry of the difference to the transposed matrix, rows and columns multiplied by a scale [n]."""
        if self._whole is not None:
            return float(band.largest_skew(self._whole, self.of.width, scale))
        skew = (self.of.matrix - self.of.matrix.T).tocoo()
        return float(np.max(np.abs(skew.data) * scale[skew.row] * scale[skew.col], initial=0.0))

    def determinant(self) -> int:
        """Return the sign of the determinant: 1, -1, or 0 if the matrix is singular."""
        if self._whole is not None:
            from scipy.linalg.lapack import dgbtrf
            width = self.of.width
            lapack, exchanged, fault = dgbtrf(self._whole.T, width, width)
            if fault:
                return 0
            signs, odd = np.sign(lapack[2 * width]), np.sum(exchanged != np.arange(exchanged.size)) % 2
        else:
            factors = lu(self.of.matrix)
            if factors is None:
                return 0
            raw = factors.raw
            signs = np.sign(np.concatenate((raw.L.diagonal(), raw.U.diagonal())))
            odd = _is_odd(raw.perm_r) ^ _is_odd(raw.perm_c)
        return int(np.prod(signs)) * (-1 if odd else 1)

    @cached_property
    def _whole(self) -> Array | None:
        """Matrix as a band, None if it is wide."""
        if not self.is_narrow:
            return None
        whole = np.zeros((self.of.n, 3 * self.of.width + 1))
        self.of.put(whole)
        return whole

    def _diagonal(self) -> Array:
        return sizes_of(self.of.matrix.diagonal() if self._whole is None else self._whole[:, 2 * self.of.width])

    def _of_symmetric_part(self) -> tuple[int, int] | None:
        return inertia((0.5 * (self.of.matrix + self.of.matrix.T)).tocsc(), self._nodes)


def inertia(matrix: Any, nodes: Nodes | None = None) -> tuple[int, int] | None:
    """Return numbers of negative eigenvalues of a symmetric matrix and of those that are zero to round-off (Sylvester). None if
    row exchanges spoil the count of pivots.

    Pivots of the matrix scaled to a diagonal of 1 and shifted by s and by -s count eigenvalues below -s and s, beyond doubt where
    s is far above round-off. Eigenvalues in between are computed: vectors by inverse iteration, values from differences of
    positions (`Form`), and a value is zero if it is round-off of the terms of its sum."""
    count = negative_pivots(matrix)
    if count is not None:
        return count, 0
    scale = np.sqrt(1.0 / sizes_of(matrix.diagonal()))
    scaled = (sparse.diags(scale) @ matrix @ sparse.diags(scale)).tocsc()
    low = high = 0
    for k, width in enumerate((CERTAIN, *WIDTHS)):
        found = [_below(scaled, side * width) for side in (-1.0, 1.0)]
        if min(found) < 0:
            return None
        low, high = found
        if high <= low:
            return low, 0
        if k and high - low <= MOST_NEAR:
            break
    near = _nearest_to_zero(scaled, high - low, width)
    if near is None:
        return None
    values, noise = Form(matrix.tocsr(), nodes).values(scale[:, None] * near)
    first = np.argsort(np.abs(values))[:high - low]
    zero = np.abs(values[first]) <= NOISE * noise[first]
    return low + int(np.sum((values[first] < 0.0) & ~zero)), int(np.sum(zero))


def held(matrix: Any, unknowns: Array) -> Any:
    """Return a matrix by rows with its largest diagonal entry added to the diagonal of some unknowns.

    With z, K z = 0, z_i not 0, the matrix K + k e_i e_i^T has one zero eigenvalue less than K, and as many negative ones."""
    more = np.zeros(matrix.shape[0])
    more[unknowns] = float(np.max(np.abs(matrix.diagonal()), initial=0.0)) or 1.0
    return (matrix + sparse.diags(more)).tocsr()


class Form:
    """Quadratic form x . K y of a symmetric matrix K, from differences of positions.

    A common shift of all nodes strains nothing. In every row the entries between positions, and those between rotations and
    positions, therefore have the sum zero but for supports in space. Positions may then be replaced by their differences to the
    node of the row. Without that, round-off of a stiffness EA/h stands beside the energy of bending, and hides it in fine meshes
    of slender beams.

    matrix: sparse by rows [n, n].
    nodes: default: plain products.
    """

    def __init__(self, matrix: Any, nodes: Nodes | None) -> None:
        rows, columns, data = _entries(matrix)
        # (values, two numbers whose difference is the left factor, and two for the right factor)
        self._parts: list[tuple[Array, tuple[Array, ...], tuple[Array, ...]]] = []
        if nodes is None:
            self._parts.append((data, (rows,), (columns,)))
            return
        count, size, dim = nodes
        of_nodes = (rows < count) & (columns < count)
        from_place, to_place = (of_nodes & (x % size < dim) for x in (rows, columns))
        other_node = rows // size != columns // size
        others = ~(from_place | to_place)
        self._parts.append((data[others], (rows[others],), (columns[others],)))
        at = from_place & to_place & other_node
        a, b = rows[at], columns[at]
        self._parts.append((-0.5 * data[at], (a, _component(b, a, size)), (_component(a, b, size), b)))
        # a block that is not symmetric by itself
        skew = 0.5 * (data[at] - _at(matrix, _component(a, b, size), _component(b, a, size)))
        real = np.abs(skew) > SKEW_BLOCK * np.sqrt(np.abs(matrix.diagonal()))[a] * np.sqrt(np.abs(matrix.diagonal()))[b]
        a, b = a[real], b[real]
        self._parts.append((skew[real], (a,), (b, _component(a, b, size))))
        at = ~from_place & to_place & other_node
        a, b = rows[at], columns[at]
        self._parts.append((2.0 * data[at], (a,), (b, _component(a, b, size))))
        row, place, total = _totals(rows[to_place], columns[to_place], data[to_place], nodes)
        self._parts.append((np.where(row % size < dim, 1.0, 2.0) * total, (row,), (place,)))

    def values(self, x: Array) -> tuple[Array, Array]:
        """Return eigenvalues of x^T K x, x [n, m], and the round-off that each may have."""
        product = np.zeros((x.shape[1],) * 2)
        for value, left, right in self._parts:
            for k in range(0, value.size, CHUNK):
                a, b = (_difference(x, [i[k:k + CHUNK] for i in side]) for side in (left, right))
                product += (a * value[k:k + CHUNK, None]).T @ b
        values, turn = np.linalg.eigh(0.5 * (product + product.T))
        y, noise = x @ turn, np.zeros(values.size)
        for value, left, right in self._parts:
            for k in range(0, value.size, CHUNK):
                a, b = (np.abs(_difference(y, [i[k:k + CHUNK] for i in side])) for side in (left, right))
                noise += np.abs(value[k:k + CHUNK]) @ (a * b)
        return values, np.finfo(float).eps * noise


def strained(matrix: Any, nodes: Nodes, x: Array) -> tuple[Array, Array]:
    """Return K x of motions by columns [n, m], from differences of positions as in `Form`, and sums of the largest sizes that its
    terms could have, those of entries sqrt(K_ii K_jj)."""
    rows, columns, data = _entries(matrix)
    count, size, dim = nodes
    place = (rows < count) & (columns < count) & (columns % size < dim)
    row, at, total = _totals(rows[place], columns[place], data[place], nodes)
    own = np.where(place, _component(rows, columns, size), 0)
    root = np.sqrt(np.abs(matrix.diagonal()))
    most = np.maximum(np.abs(data), root[rows] * root[columns])
    product, sizes = np.zeros(x.shape), np.zeros(x.shape)
    for j, one in enumerate(x.T):
        change = one[columns] - np.where(place, one[own], 0.0)
        product[:, j] = np.bincount(rows, data * change, len(x)) + np.bincount(row, total * one[at], len(x))
        sizes[:, j] = np.bincount(rows, most * np.abs(change), len(x)) + np.bincount(row, np.abs(total * one[at]), len(x))
    return product, sizes


def _entries(matrix: Any) -> tuple[Array, Array, Array]:
    """Return rows, columns and values."""
    return np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr)), matrix.indices.astype(np.int64), matrix.data


def _component(row: Array, column: Array, size: int) -> Array:
    """Return the unknowns of the nodes of `row` with the same component as `column`."""
    return row // size * size + column % size


def _at(matrix: Any, rows: Array, columns: Array) -> Array:
    """Return entries of a sparse matrix."""
    return np.asarray(matrix[rows, columns]).reshape(-1)


def _difference(x: Array, of: list[Array]) -> Array:
    return x[of[0]] - x[of[1]] if len(of) > 1 else x[of[0]]


def _totals(rows: Array, columns: Array, data: Array, nodes: Nodes) -> tuple[Array, Array, Array]:
    """Return row, position of its node, and sum of the entries of the row that belong to this component of positions: the
    stiffness of supports in space. Sums that are round-off are left out."""
    key = rows * nodes.dim + columns % nodes.size
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    if not first.size:
        return rows[:0], columns[:0], data[:0]
    # in extended precision: the sum may be smaller than its terms by all digits of a double
    total = np.add.reduceat(data[order].astype(np.longdouble), first).astype(float)
    real = np.abs(total) > LAST_BITS * np.add.reduceat(np.abs(data[order]), first)
    row, column = rows[order[first[real]]], columns[order[first[real]]]
    return row, _component(row, column, nodes.size), total[real]


def sizes_of(diagonal: Array) -> Array:
    """Return absolute values of a diagonal; zeros replaced by 1."""
    sizes = np.abs(diagonal)
    return np.where(sizes > 0.0, sizes, 1.0)


def _factored(matrix: Any) -> LU | None:
    """Factor without exchange of rows; None where the matrix is singular."""
    return lu(matrix, SYMMETRIC_MODE | {"diag_pivot_thresh": 0.0})


def negative_pivots(matrix: Any) -> int | None:
    """Count the negative pivots of a symmetric matrix by columns; None where one is not clearly different from zero."""
    pivots = _pivots(matrix)
    if pivots is None or not np.all(np.abs(pivots) > CLEAR_PIVOT * np.abs(matrix.diagonal())):
        return None
    return int(np.sum(pivots < 0.0))


def _pivots(matrix: Any) -> Array | None:
    """Return pivots of a symmetric matrix in the order of its rows; None where the matrix is singular or rows were exchanged."""
    factors = _factored(matrix)
    return None if factors is None else factors.pivots


def _below(matrix: Any, shift: float) -> int:
    """Count the eigenvalues of a symmetric matrix below a shift; -1 if the count is not found."""
    pivots = _pivots((matrix - shift * sparse.identity(matrix.shape[0], format="csc")).tocsc())
    return -1 if pivots is None else int(np.sum(pivots < 0.0))


def _nearest_to_zero(matrix: Any, count: int, width: float) -> Array | None:
    """Return orthonormal vectors [n, m] among which are those of the `count` eigenvalues nearest to zero of a symmetric matrix
    with a diagonal of 1, which lie within this width."""
    n = matrix.shape[0]
    # shift a little off zero, where the matrix is not singular
    factors = _factored((matrix + SHIFT * width * sparse.identity(n, format="csc")).tocsc())
    if factors is None:
        return None
    v = np.random.default_rng(0).standard_normal((n, min(n, count + MORE)))
    for _ in range(SWEEPS):
        v = orthonormal_columns(factors.solve(v.T).T)[0]
        if not np.isfinite(v).all():
            return None
    return v


def orthonormal_columns(v: Array) -> tuple[Array, Array]:
    """Return Q, R of a few long columns, by Gram and Schmidt, each column twice: LAPACK takes a hundred times as long."""
    q, r = v.copy(), np.zeros((v.shape[1], v.shape[1]))
    for j in range(v.shape[1]):
        for _ in range(2):
            part = q[:, :j].T @ q[:, j]
            q[:, j] -= q[:, :j] @ part
            r[:j, j] += part
        r[j, j] = np.linalg.norm(q[:, j])
        if r[j, j] > 0.0:
            q[:, j] /= r[j, j]
    return q, r


def _is_odd(order: Array) -> bool:
    """Return whether a permutation takes an odd number of exchanges: those of each of its cycles are one less than its length."""
    seen = np.zeros(order.size, bool)
    cycles = 0
    for k in range(order.size):
        cycles += not seen[k]
        while not seen[k]:
            seen[k] = True
            k = order[k]
    return bool((order.size - cycles) % 2)
