"""Saddle-point equations, with constraints, as one matrix: solutions without its null vectors, and its inertia.

    [ A   B^T ] [ x ]   [ b ]      x: coordinates (nodes in m and rad, sliding coordinates in m)
    [ B'   0  ] [ m ] = [ c ]      m: multipliers (forces), in any number and any units

A may be singular and so may be its diagonal (a mass has no stiffness): only the whole is solved. If the matrix is singular to
round-off (a free motion, the same constraint twice) its null vectors are found by inverse iteration and left out of the solution;
the components of the right-hand side along them are kept apart.
"""
from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.linalg.factors import LU, Factoriser, Factors, lu, norms_of_rows, refined
from fastbeam.linalg.inertia import (
    SKEW,
    Entries,
    Nodes,
    Signs,
    Terms,
    held,
    inertia,
    negative_pivots,
    orthonormal_columns,
    sizes_of,
)
from fastbeam.linalg.scaling import typical_factors, with_values

Array = np.ndarray
# limits for the scaled matrix: singular values that are round-off, number added to the diagonal so that it can be factored, most
# null vectors that are searched, and refinements without them
NULL, SMALL, MOST_NULL, REFINEMENTS = 3e-15, 1e-13, 12, 6
# share of B^T B that is added to A before its pivots are counted: any gives the same number; and multipliers up to which
# the rest is counted by eigenvalues of a dense matrix
PENALTIES, DENSE = (1e2, 1e4, 1e6), 4000
# eigenvalues of the matrix of the multipliers, next to its largest, that are round-off
ZERO = 1e-13


class Saddle(Factors):
    """One matrix with constraints.

    matrix: sparse float64 [n, n] by rows, all rows and columns, coordinates and multipliers in any order.
    multiplier: bool [n], true for unknowns that are multipliers.
    factoriser: used before SuperLU.
    drift: float64 [n], components of the last right-hand side along null vectors, in no unit; zero if the matrix is regular.
    unbalanced: its share in the right-hand side, in scaled rows.
    left: float64 [n, m], null vectors of the transposed matrix, along which the last solution leaves the right-hand side out.
    """

    def __init__(self, matrix: Any, multiplier: Array, factoriser: Factoriser | None = None) -> None:
        super().__init__(matrix, factoriser)
        self.multiplier = multiplier
        # for signs: unknowns of nodes, and the function that finds one unknown of every free motion
        self.nodes: Nodes | None = None
        self.free: Callable[[Callable[[], Any]], Array] | None = None
        self.unbalanced, self.drift, self.left = 0.0, np.zeros(multiplier.size), np.zeros((multiplier.size, 0))

    @property
    def is_singular(self) -> bool:
        """True if the last solution left null vectors out, or the matrix is singular to round-off."""
        return bool(self.left.shape[1]) or super().is_singular

    def stiffened(self, by: float) -> Saddle:
        """Return the matrix with this much more on the diagonal of the coordinates, in scaled rows."""
        more = np.where(self.multiplier, 0.0, by / (self.row * self.column))
        n, indptr, indices = self.multiplier.size, self.matrix.indptr, self.matrix.indices
        at = np.flatnonzero(indices == np.repeat(np.arange(n), np.diff(indptr)))
        if not np.array_equal(indices[at][~self.multiplier[indices[at]]], np.flatnonzero(~self.multiplier)):
            return Saddle(self.matrix + sparse.diags(more), self.multiplier, self._factoriser)
        data = self.matrix.data.copy()
        data[at] += more[indices[at]]
        return Saddle(with_values(self.matrix, data), self.multiplier, self._factoriser)

    def holding(self, unknowns: Array) -> Saddle:
        """Return the matrix with some coordinates fixed by stiffnesses."""
        return Saddle(held(self.matrix, unknowns), self.multiplier, self._factoriser)

    def _otherwise(self, b: Array, transposed: bool, fair: tuple[Factoriser | LU, Array, float] | None) -> Array | None:
        """Solve without null vectors; if there are none, return the fair solution."""
        self.unbalanced, self.drift, self.left = 0.0, np.zeros(self.multiplier.size), self.left[:, :0]
        right, left = self._null_vectors[::-1] if transposed else self._null_vectors
        if right.shape[1]:
            by, asked = self._near, left.T @ b
            met = b - left @ asked
            rest_of = self._residual_of(met, transposed)

            def solved(rest: Array) -> Array:
                x = by.solve(rest, transposed)
                return np.asarray(x - right @ (right.T @ x))

            def without(x: Array, b: Array, rest_out: Array) -> Array:
                rest_of(x, b, rest_out)
                rest_out -= left @ (left.T @ rest_out)
                return norms_of_rows(rest_out)

            x, self.residual = refined(solved, without, met, self.limits._replace(most=REFINEMENTS))
            if np.isfinite(x).all() and self.residual <= self.limits.fair:
                into, out = self.scales[::-1] if transposed else self.scales
                self.unbalanced, self.left = float(np.linalg.norm(asked)), into[:, None] * left
                # the nearby matrix maps null vectors of one side to those of the other
                self.drift = out * (right @ (right.T @ (left @ asked)))
                return x
        if fair is None:
            return None
        self.by, x, self.residual = fair
        self.limits = self.limits._replace(is_strict=False)
        return x

    @cached_property
    def _near(self) -> Any:
        """Factors of the scaled matrix, or of one next to it; None if there are none."""
        if self._last is not None:
            return self._last
        return lu(self.scaled + sparse.diags(np.where(self.multiplier, -SMALL, SMALL), format="csr"))

    @cached_property
    def _null_vectors(self) -> tuple[Array, Array]:
        """Orthonormal null vectors of the scaled matrix, and of its transpose, by columns, as many of each."""
        none = np.zeros((self.multiplier.size, 0))
        if self._near is None:
            return none, none
        right = self._null(False)
        left = self._null(True) if right.shape[1] else right
        return (right, left) if right.shape[1] == left.shape[1] else (none, none)

    def _null(self, transposed: bool) -> Array:
        matrix = self.scaled.T if transposed else self.scaled
        n = matrix.shape[0]
        for count in (1, min(n, MOST_NULL)):
            v = np.random.default_rng(0).standard_normal((n, count))
            for _ in range(3):
                v = orthonormal_columns(np.nan_to_num(self._near.solve(v.T, transposed).T))[0]
            _, sizes, turn = np.linalg.svd(orthonormal_columns(matrix @ v)[1])
            if not np.any(sizes <= NULL):
                break
        return v @ turn[sizes <= NULL].T

    def signs(self, symmetric: bool = True) -> tuple[int, int] | None:
        """Return numbers of negative and of zero directions of A among the motions that the constraints allow, B x = 0; as
        `inertia.Signs.count` if the matrix is not symmetric. None if they are not found.

        A + p B^T B has on these motions the signs of A, whatever p is. Its negative eigenvalues less those of B (A + p B^T B)^-1
        B^T are the number (Haynsworth), which is 0 where A + p B^T B has none."""
        if not np.logical_or.reduce(self.multiplier):
            return Signs(Entries(self.matrix), self.nodes, self.free).count(symmetric)
        free = np.zeros(0, np.int64) if self.free is None else self.free(lambda: self.matrix)
        if not free.size and is_positive(self.matrix, self.multiplier):
            return 0, 0
        matrix = held(self.matrix, free) if free.size else self.matrix
        whole = (matrix + matrix.T).tocsr()
        whole.data *= 0.5
        factor = self.typical(whole)
        # one factor for a row and its column; none for coordinates, whose differences are taken
        used = np.where(self.multiplier, factor, 1.0)
        whole.data *= np.repeat(used, np.diff(whole.indptr)) * used[whole.indices]
        found = signs_between(whole, self.multiplier, self.nodes)
        if not symmetric and found != (0, 0) and Signs(Entries(matrix)).skew(factor) > SKEW:
            return (1, free.size) if Saddle(matrix, self.multiplier).determinant_sign() < 0 else None
        return None if found is None else (found[0], found[1] + free.size)

    def typical(self, matrix: Any) -> Array:
        """Return factors of rows and columns [n] that bring stiffnesses and constraints to a size of 1, in any units."""
        n = self.multiplier.size
        size, nodes = abs(matrix).tocsr(), self.nodes or Nodes(n, 1, 1)
        # stiffness that is round-off, as sliders may have, does not count
        stiff = np.where(np.arange(n) < nodes.total, size.diagonal(), 0.0)
        return typical_factors(size, self.multiplier, nodes.turns(n), stiff)[1]

    def determinant_sign(self) -> int:
        """Return the sign of the determinant of A among the motions that the constraints allow: 1, -1, or 0 if it is singular."""
        return Signs(Entries(self.matrix)).determinant() * (-1)**int(np.sum(self.multiplier))


def _signs(a: Any, b: Any, nodes: Nodes | None) -> tuple[int, int] | None:
    """Return numbers of negative and zero directions of a [n, n] where b x = 0, b [m, n]."""
    found = None
    for penalty in PENALTIES:
        stiff = (a + penalty * (b.T @ b)).tocsc()
        found = inertia(stiff, nodes)
        if found is not None and (found[0] == 0 or b.shape[0] == 0):
            return found
        if found is None or found[1] or b.shape[0] > DENSE:
            continue
        scale = sparse.diags(1.0 / np.sqrt(sizes_of(stiff.diagonal())), format="csc")
        factors, rows = lu(scale @ stiff @ scale), b @ scale
        if factors is None:
            continue
        inverse = rows @ factors.solve(rows.toarray()).T
        values = np.linalg.eigvalsh(0.5 * (inverse + inverse.T))
        zero = np.abs(values) <= ZERO * np.max(np.abs(values))
        return found[0] - int(np.sum((values < 0.0) & ~zero)), int(np.sum(zero))
    return found


def is_positive(matrix: Any, multiplier: Array) -> bool:
    """Tell whether the symmetric part of a matrix by rows [n, n] is clearly positive on the motions that its constraints, the
    rows of multipliers [n], allow: all pivots of A + B^T D B are, with a D that brings B^T D B to the size of A."""
    n = multiplier.size
    row, column, data = np.arange(n).repeat(matrix.indptr[1:] - matrix.indptr[:-1]), matrix.indices, matrix.data
    above, left = multiplier[row], multiplier[column]
    within, constrains, own = ~(above | left), above & ~left, row == column
    stiff = np.zeros(n)
    stiff[row[own]] = np.abs(data[own])
    # constraints, and all pairs of the entries of each
    b, j = data[constrains], column[constrains]
    count = np.bincount(row[constrains], minlength=n)
    first, size = (count.cumsum() - count)[count > 0], count[count > 0]
    largest = np.maximum.reduceat(b * b, first) if b.size else b
    weight = np.where(largest > 0.0, np.maximum.reduceat(stiff[j], first) / np.where(largest > 0.0, largest, 1.0), 0.0)
    pairs = size.repeat(size)
    one = np.arange(b.size).repeat(pairs)
    other = np.arange(one.size) + (first.repeat(size) - pairs.cumsum() + pairs).repeat(pairs)
    half, i, k = 0.5 * data[within], row[within], column[within]
    values = np.concatenate((half, half, weight.repeat(size)[one] * b[one] * b[other]))
    order = sparse.csgraph.reverse_cuthill_mckee(matrix, symmetric_mode=True)
    number = np.empty(n, np.int64)
    number[order] = np.add.accumulate(~multiplier[order], dtype=np.int64) - 1
    i, k = number[np.concatenate((i, k, j[one]))], number[np.concatenate((k, i, j[other]))]
    signs = Signs(Terms(n - int(np.add.reduce(multiplier)), i, k, values))
    return (signs.clear() if signs.is_narrow else (negative_pivots(signs.of.matrix), 0)) == (0, 0)


def signs_between(matrix: Any, multiplier: Array, nodes: Nodes | None = None) -> tuple[int, int] | None:
    """Return numbers of negative and of zero directions of a symmetric matrix [n, n] among the motions that its constraints, the
    rows of multipliers [n], allow; None if they are not found. nodes: unknowns that belong to nodes."""
    if not multiplier.any():
        return inertia(matrix.tocsc(), nodes)
    return _signs(matrix[~multiplier][:, ~multiplier].tocsc(), matrix[multiplier][:, ~multiplier].tocsc(), nodes)
