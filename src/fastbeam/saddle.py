"""Equations with constraints as one matrix: solved by SuperLU with pivoting across all of it, and its inertia.

    [ A   B^T ] [ x ]   [ b ]      x: coordinates (nodes in m and rad, sliding coordinates in m)
    [ B'   0  ] [ m ] = [ c ]      m: multipliers (forces), in any number and any units

A may be singular and so may be its diagonal (a mass has no stiffness): only the whole is solved. Rows and columns are brought to
a size of 1 first, so units do not matter. Where the matrix is singular to round-off (a free motion, the same constraint twice)
its null vectors are found by inverse iteration and left out of the solution; what the right-hand side asks for along them is
kept apart.
"""
from __future__ import annotations

from typing import Any

import numpy as np

from .linsolve import SuperLU, _inertia

Array = np.ndarray
# sweeps of the equilibration; each halves the exponent of what is missing
SWEEPS = 12
# relative residual of a regular matrix; of a solution that is accepted; backward error that is round-off
REGULAR, FAIR, ROUND_OFF = 1e-12, 1e-2, 1e-12
# a smaller pivot next to the largest tells a singular matrix
LEAST_PIVOT = 1e-15
# of the scaled matrix: singular values that are round-off, what is added to the diagonal so that it can be factored, and null
# vectors that are looked for at most
NULL, SMALL, MOST_NULL = 1e-12, 1e-13, 12
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
        Whether the last solution left null vectors out.
    drift : float64 [n]
        Along these, what the right-hand side asks for, in no unit; zero where the matrix is regular.
    unbalanced : float
        Its share in the right-hand side, in scaled rows.
    residual : float
        Of the rest of the last solution, relative to the right-hand side, in scaled rows.
    """

    def __init__(self, matrix: Any, multiplier: Array) -> None:
        from scipy import sparse
        self.matrix, self.multiplier = matrix.tocsc(), multiplier
        self.is_finite = bool(np.isfinite(self.matrix.data).all())
        self.row, self.column = equilibrated(self.matrix) if self.is_finite else (np.ones(multiplier.size),) * 2
        self.scaled = (sparse.diags(self.row) @ self.matrix @ sparse.diags(self.column)).tocsc()
        self.is_singular = False
        self.residual = self.unbalanced = 0.0
        self.drift = np.zeros(multiplier.size)

    def stiffened(self, by: float) -> Saddle:
        """The same with this much on the diagonal of the coordinates, in scaled rows."""
        from scipy import sparse
        more = np.where(self.multiplier, 0.0, by / (self.row * self.column))
        return Saddle(self.matrix + sparse.diags(more), self.multiplier)

    def solve(self, right: Array) -> Array | None:
        """x [n] with matrix x = right [n]. None where nothing acceptable is found."""
        if not (self.is_finite and np.isfinite(right).all()):
            return None
        b = self.row * right
        self.is_singular, self.unbalanced, self.drift = False, 0.0, np.zeros(b.size)
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
            if self._is_fair(x, b):
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

        def residual(x: Array) -> tuple[Array, float]:
            rest = b - self.scaled @ x
            if without is not None:
                rest = rest - without[0] @ (without[0].T @ rest)
            return rest, float(np.linalg.norm(rest)) / size

        size = float(np.linalg.norm(b)) or 1.0
        x = solved(b)
        rest, left = residual(x)
        for _ in range(refinements):
            if not 1e-15 < left < 1e3:
                break
            better = x + solved(rest)
            rest, found = residual(better)
            if not found < left:
                break
            x, left = better, found
        return x, left

    def _is_fair(self, x: Array, b: Array) -> bool:
        """Whether the residual is small, or what round-off leaves of large terms."""
        rest = np.abs(b - self.scaled @ x)
        size = np.max(abs(self.scaled) @ np.abs(x) + np.abs(b))
        return bool(self.residual <= FAIR and np.max(rest) <= ROUND_OFF * size)

    def _deflated(self, b: Array, factors: Any) -> Array | None:
        """Solution without null vectors; None where there are none, or nothing is found. factors: of the matrix, or None."""
        from scipy import sparse
        if factors is None:
            near = (self.scaled + sparse.diags(np.where(self.multiplier, -SMALL, SMALL), format="csc")).tocsc()
            factors = _factors(near, {}, 0.0)
        if factors is None:
            return None
        right, left = (self._null(factors, trans) for trans in ("N", "T"))
        if not right.shape[1] or right.shape[1] != left.shape[1]:
            return None
        asked = left.T @ b
        x, self.residual = self._refined(factors, b - left @ asked, 6, (left, right))
        if not (np.isfinite(x).all() and self.residual <= FAIR):
            return None
        self.is_singular = True
        self.unbalanced = float(np.linalg.norm(asked))
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
                v = _orthonormal(np.nan_to_num(factors.solve(np.ascontiguousarray(v), trans)))[0]
            _, sizes, turn = np.linalg.svd(_orthonormal(matrix @ v)[1])
            if not np.any(sizes <= NULL):
                break
        return v @ turn[sizes <= NULL].T

    def signs(self, symmetric: bool = True) -> tuple[int, int] | None:
        """Numbers of negative and of zero directions of A among the motions that the constraints allow, B x = 0; as
        `SuperLU.signs` where the matrix is not symmetric. None where they are not found.

        A + p B^T B has on these motions the signs of A, whatever p is. Its negative eigenvalues less those of
        B (A + p B^T B)^-1 B^T are the number (Haynsworth), which is 0 where A + p B^T B has none."""
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


def _orthonormal(v: Array) -> tuple[Array, Array]:
    """Q, R of a few long columns, by Gram and Schmidt, each column twice: LAPACK takes a hundred times as long."""
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


def _factors(matrix: Any, options: dict[str, Any], least: float = LEAST_PIVOT) -> Any:
    """Of SuperLU; None where a pivot vanishes."""
    from scipy.sparse.linalg import splu
    try:
        factors = splu(matrix, **options)
    except RuntimeError:
        return None
    pivots = np.abs(factors.U.diagonal())
    return factors if np.min(pivots, initial=np.inf) > least * np.max(pivots, initial=0.0) else None


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
