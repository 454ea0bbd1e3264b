"""Equations with constraints as one matrix: solved by SuperLU with pivoting across all of it, and its inertia.

    [ A   B^T ] [ x ]   [ b ]      x: coordinates (nodes in m and rad, sliding coordinates in m)
    [ B'   0  ] [ m ] = [ c ]      m: multipliers (forces), in any number and any units

A may be singular and so may be its diagonal (a mass has no stiffness): only the whole is solved. Rows and columns are brought to
a size of 1 first, so units do not matter. Where the matrix is singular to round-off (a free motion, the same constraint twice)
coordinates get a small stiffness and multipliers a small compliance, and the solution is refined with the matrix itself: what
the right-hand side does not ask for stays small.
"""
from __future__ import annotations

from typing import Any

import numpy as np

from .linsolve import SuperLU, _inertia

Array = np.ndarray
# sweeps of the equilibration; each halves the exponent of what is missing
SWEEPS = 12
# relative residuals of a solution that is accepted; and of one whose backward error is round-off
GOOD, FAIR, ROUND_OFF = 1e-9, 1e-2, 1e-12
# a smaller pivot next to the largest tells a singular matrix
LEAST_PIVOT = 1e-15
# stiffness and compliance of what is singular, in the scaled matrix, and refinements with the matrix itself
SMALL, REFINEMENTS = 1e-9, 8
# share of B^T B that is added to A before its pivots are counted: any gives the same number; and multipliers up to which
# the rest is counted by eigenvalues of a dense matrix
PENALTIES, DENSE = (1e2, 1e4, 1e6), 4000
# eigenvalues of the matrix of the multipliers, next to its largest, that are round-off
ZERO = 1e-13


class Saddle:
    """One matrix, factored when it is first solved.

    Parameters
    ----------
    matrix : sparse float64 [n, n]
        All rows and columns, coordinates and multipliers in any order.
    multiplier : bool [n]
        Which unknowns are multipliers.

    Attributes
    ----------
    is_singular : bool
        Whether the last solution took the small stiffnesses.
    residual : float
        Of the last solution, relative to the right-hand side, in scaled rows.
    """

    def __init__(self, matrix: Any, multiplier: Array) -> None:
        from scipy import sparse
        self.matrix, self.multiplier = matrix.tocsc(), multiplier
        self.is_finite = bool(np.isfinite(self.matrix.data).all())
        self.row, self.column = equilibrated(self.matrix) if self.is_finite else (np.ones(multiplier.size),) * 2
        self.scaled = (sparse.diags(self.row) @ self.matrix @ sparse.diags(self.column)).tocsc()
        self.is_singular = False
        self.residual = 0.0

    def solve(self, right: Array) -> Array | None:
        """x [n] with matrix x = right [n]. None where nothing finite is found."""
        if not (self.is_finite and np.isfinite(right).all()):
            return None
        b = self.row * right
        # the order that suits a symmetric structure first, then plain partial pivoting
        for options in ({"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.1, "options": {"SymmetricMode": True}}, {}):
            x = self._solution(b, self.scaled, options, 2)
            if x is not None and self._is_good(x, b):
                self.is_singular = False
                return self.column * x
        self.is_singular = True
        from scipy import sparse
        small = sparse.diags(np.where(self.multiplier, -SMALL, SMALL), format="csc")
        x = self._solution(b, (self.scaled + small).tocsc(), {}, REFINEMENTS)
        if x is None or not np.isfinite(x).all():
            return None
        return self.column * x

    def _solution(self, b: Array, matrix: Any, options: dict[str, Any], refinements: int) -> Array | None:
        """By factors of a matrix, refined with the scaled one as long as that helps."""
        from scipy.sparse.linalg import splu
        try:
            factors = splu(matrix, **options)
        except RuntimeError:
            return None
        pivots = np.abs(factors.U.diagonal())
        if matrix is self.scaled and not np.min(pivots, initial=np.inf) > LEAST_PIVOT * np.max(pivots, initial=0.0):
            return None
        x = factors.solve(b)
        size = float(np.linalg.norm(b)) or 1.0
        rest = b - self.scaled @ x
        self.residual = float(np.linalg.norm(rest)) / size
        for _ in range(refinements):
            if not 1e-14 < self.residual < 1e3:
                break
            better = x + factors.solve(rest)
            rest = b - self.scaled @ better
            found = float(np.linalg.norm(rest)) / size
            if not found < self.residual:
                break
            x, self.residual = better, found
        return x

    def _is_good(self, x: Array, b: Array) -> bool:
        if self.residual <= GOOD:
            return True
        rest = np.abs(b - self.scaled @ x)
        size = np.max(abs(self.scaled) @ np.abs(x) + np.abs(b))
        return bool(self.residual <= FAIR and np.max(rest) <= ROUND_OFF * size)

    def signs(self, symmetric: bool = True) -> tuple[int, int] | None:
        """Numbers of negative and of zero directions of A among the motions that the constraints allow, B x = 0; as
        `SuperLU.signs` where the matrix is not symmetric. None where they are not found.

        A + p B^T B has on these motions the signs of A, whatever p is. Its negative eigenvalues less those of
        B (A + p B^T B)^-1 B^T are the number (Haynsworth), which is none where the first has none."""
        from scipy import sparse
        skew = (self.matrix - self.matrix.T).tocoo()
        # the same factor for a row and its column
        factor = np.sqrt(np.abs(self.row * self.column))
        small = np.max(np.abs(skew.data) * factor[skew.row] * factor[skew.col], initial=0.0) <= 1e-8
        scale = sparse.diags(factor)
        whole = (scale @ (0.5 * (self.matrix + self.matrix.T)) @ scale).tocsr()
        a = whole[~self.multiplier][:, ~self.multiplier].tocsc()
        b = whole[self.multiplier][:, ~self.multiplier].tocsc()
        found = _signs(a, b)
        if symmetric or small or found == (0, 0):
            return found
        sign = SuperLU._determinant_sign(self.matrix) * (-1)**int(np.sum(self.multiplier))
        return (1, 0) if sign < 0 else None


def _signs(a: Any, b: Any) -> tuple[int, int] | None:
    """Negative and zero directions of a [n, n] where b x = 0, b [m, n]."""
    from scipy.sparse.linalg import splu
    found = None
    for penalty in PENALTIES:
        stiff = (a + penalty * (b.T @ b)).tocsc()
        found = _inertia(stiff)
        if found is not None and (found[0] == 0 or b.shape[0] == 0):
            return found
        if found is None or found[1] or b.shape[0] > DENSE:
            continue
        try:
            inverse = b @ splu(stiff).solve(b.T.toarray())
        except RuntimeError:
            continue
        values = np.linalg.eigvalsh(0.5 * (inverse + inverse.T))
        zero = np.abs(values) <= ZERO * np.max(np.abs(values))
        return found[0] - int(np.sum((values < 0.0) & ~zero)), int(np.sum(zero))
    return found


def equilibrated(matrix: Any) -> tuple[Array, Array]:
    """Factors of rows and columns [n], powers of two, with which the largest entry of each comes close to 1 (D. Ruiz, 2001); the
    same for both where the matrix is symmetric. 1 for those without entries."""
    size = abs(matrix).tocoo()
    row, column = np.ones(matrix.shape[0]), np.ones(matrix.shape[1])
    for _ in range(SWEEPS):
        data = size.data * row[size.row] * column[size.col]
        most = np.zeros(row.size), np.zeros(column.size)
        np.maximum.at(most[0], size.row, data)
        np.maximum.at(most[1], size.col, data)
        row, column = (x / np.sqrt(np.where(y > 0.0, y, 1.0)) for x, y in zip((row, column), most))
    return tuple(np.exp2(np.round(np.log2(x))) for x in (row, column))  # type: ignore[return-value]
