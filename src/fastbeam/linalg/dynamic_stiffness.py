"""Equations of motions x e^(r t) about a state of rest, K x + r C x + r^2 M x - B^T m = f, B x = g, as one complex sparse matrix.

One structure serves all rates r. PARDISO solves real and imaginary parts side by side, [A', -A''; -A'', -A'] [x'; x''] =
[b'; -b''], which is symmetric where A is; without an imaginary part the real matrix alone. Where its solutions cannot be
accepted,
or without MKL, SuperLU solves the complex matrix. Rows and columns are scaled to entries of 1, solutions refined, residuals
checked.
"""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from fastbeam.linalg.eigen import (GIVE, IDLE, NOISE, ROUND_OFF, Pencil, SingularError, agreeing, grown, refined, scales,
    stiffest, upper)
from fastbeam.linalg.linear_system import SMALL
from fastbeam.linalg.mkl import load_mkl
from fastbeam.linalg.saddle import Factors

Array = np.ndarray
# share of forces along a motion that is round-off
PUSHED = 1e-9


def with_still(pencil: Pencil, forces: Array) -> Pencil:
    """The pencil with a stiffness against the motions that cost nothing, `Pencil.still`, those that these forces [k] do not push:
    the others are orthogonal to them in the masses and do not see it."""
    from scipy import sparse
    still = pencil.still
    if not still.shape[1]:
        return pencil
    size = np.sqrt(np.asarray(still.multiply(still).sum(axis=0)).reshape(-1))
    quiet = np.flatnonzero(np.abs(still.T @ forces) <= PUSHED * size * np.linalg.norm(forces))
    still = still.tocsc()[:, quiet]
    product = pencil.mass @ still
    weight = np.asarray(product.multiply(still).sum(axis=0)).reshape(-1)
    held = product @ sparse.diags(stiffest(pencil) / weight) @ product.T
    return pencil._replace(stiffness=(pencil.stiffness + grown(held.tocsr(), pencil.multiplier.size)).tocsr())


class DynamicStiffness:
    """K + r C + r^2 M with the constraints of a pencil, factored at one rate r after the other.

    Parameters
    ----------
    pencil : Pencil
    damping : sparse [k, k]
        C.
    loss : sparse [k, k], optional
        Stiffness that has an imaginary part: i times this is added.
    ratios : (float64 [k, m], float64 [m], float64 [m]), optional
        M times m modes of unit mass, their angular frequencies and the damping ratios they get besides.
    backend : {'auto', 'pardiso', 'superlu'}
    """

    def __init__(self, pencil: Pencil, damping: Any, loss: Any = None, ratios: tuple[Array, Array, Array] | None = None,
                 backend: str = "auto") -> None:
        from scipy import sparse
        self.pencil = pencil
        n = pencil.multiplier.size
        self._modes = 0 if ratios is None else ratios[1].size
        size = n + self._modes
        parts = [pencil.stiffness, grown(damping, n), grown(pencil.mass, n)]
        parts += [] if loss is None else [grown(loss, n)]
        scale = sparse.diags(scales(pencil.stiffness, True, pencil)[1][:pencil.mass.shape[0]])
        scaled = scale @ damping @ scale
        skew = abs(scaled - scaled.T)
        self._symmetric = pencil.is_symmetric and not (skew.nnz and skew.max() > 1e-12 * abs(scaled).max())
        self.multiplier = np.append(pencil.multiplier, np.zeros(self._modes, bool))
        # sensitivity to the frequency: the derivative by r
        self.damping, self.mass = parts[1].tocsr(), parts[2].tocsr()
        diagonal = np.arange(size) * (size + 1)
        entries = []
        for part in parts:
            coo = grown(part.tocsr(), size).tocoo()
            coo.sum_duplicates()
            entries.append((coo.row.astype(np.int64) * size + coo.col, coo.data))
        if ratios is not None:
            columns = ratios[0]
            row, column = np.nonzero(columns)
            entries.append((np.concatenate((row * size + n + column, (n + column) * size + row)),
                            np.tile(columns[row, column], 2)))
            self._frequencies, self._ratios = ratios[1:]
        every = np.unique(np.concatenate([diagonal, *(key for key, _ in entries)]))
        self._data = []
        for key, value in entries:
            self._data.append(np.zeros(every.size))
            self._data[-1][np.searchsorted(every, key)] = value
        self.row = every // size
        self._indices = (every % size).astype(np.int32)
        self._indptr = np.searchsorted(every, size * np.arange(size + 1)).astype(np.int32)
        self.diagonal = np.searchsorted(every, diagonal)
        self._has_loss = loss is not None
        self._mkl = None if backend == "superlu" else load_mkl()
        self._factors: dict[bool, Factors] = {}
        self.names: set[str] = set()
        self._size = size

    @property
    def name(self) -> str:
        """What was used, for a result."""
        return " and ".join(sorted(self.names))

    def matrix(self, rate: complex) -> Any:
        """At a rate, sparse complex [n + m, n + m]; behind the others a row for every mode with a damping ratio."""
        from scipy import sparse
        data = self._data[0] + complex(rate) * self._data[1] + rate * rate * self._data[2]
        if self._has_loss:
            data = data + 1j * self._data[3]
        if self._modes:
            # x gets M z r 2 zeta w (z . M x) in all, nothing at rest
            own = self.diagonal[self._size - self._modes:]
            data = data + (rate != 0.0) * self._data[-1]
            data[own] -= 1.0 / (rate * 2.0 * self._ratios * self._frequencies) if rate else 1.0
        return sparse.csr_matrix((data, self._indices, self._indptr), shape=(self._size, self._size))

    def real_form(self, matrix: Any) -> Any:
        """Of real and imaginary part of such a matrix, [2 (n + m), 2 (n + m)]."""
        from scipy import sparse
        count = np.diff(self._indptr)
        first = np.arange(matrix.nnz) + self._indptr[self.row]
        second = first + count[self.row]
        indices, data = np.empty(4 * matrix.nnz, np.int32), np.empty(4 * matrix.nnz)
        half = 2 * matrix.nnz
        for begin, one, other in ((0, matrix.data.real, -matrix.data.imag), (half, -matrix.data.imag, -matrix.data.real)):
            indices[begin + first], indices[begin + second] = self._indices, self._indices + self._size
            data[begin + first], data[begin + second] = one, other
        indptr = np.concatenate((2 * self._indptr, half + 2 * self._indptr[1:]))
        return sparse.csr_matrix((data, indices, indptr), shape=(2 * self._size,) * 2)

    def factored(self, rate: complex, round_off: float = ROUND_OFF) -> Solver:
        """Ready to solve at a rate.

        Parameters
        ----------
        round_off : float
            What residuals may be next to the largest of their terms where they are not small: more for inverse iteration, next to
            an eigenvalue.

        Raises
        ------
        SingularError
            The matrix is singular.
        """
        return Solver(self, self.matrix(rate), round_off)


class Solver:
    """Factors at one rate.

    Raises
    ------
    SingularError
        When it is made, or solves.
    """

    def __init__(self, of: DynamicStiffness, matrix: Any, round_off: float) -> None:
        self._of, self._round_off = of, round_off
        self._is_real = not np.any(matrix.data.imag)
        size = abs(matrix)
        self.once, self.scale = scales(size, True, of.pencil)
        # entry by entry: zeros on the diagonal stay
        matrix.data *= self.once * self.scale[of.row] * self.scale[matrix.indices]
        self._matrix = matrix.real if self._is_real else matrix
        idle = ~of.multiplier & (size.diagonal() == 0.0)
        draw = np.random.default_rng(1).standard_normal((2, 2, of.multiplier.size))
        self._test = agreeing(self._matrix, of.multiplier | idle, draw[0] + 1j * draw[1])[0]
        held = self._matrix.copy()
        held.data[of.diagonal[of.multiplier]] -= GIVE
        if not self._factor(held):
            held.data[of.diagonal[idle]] += IDLE
            if not idle.any() or not self._factor(held):
                raise SingularError

    def _factor(self, held: Any) -> bool:
        """Whether there are factors, of this matrix, whose solutions can be accepted."""
        of = self._of
        if of._mkl is not None:
            matrix = held if self._is_real else of.real_form(held)
            known = of._factors.setdefault(self._is_real, Factors(
                of._mkl, of._symmetric, True, 1, 1 if matrix.shape[0] < SMALL else of._mkl.MKL_Get_Max_Threads()))
            for again in (False, True):
                if known.factor(upper(matrix) if of._symmetric else matrix, again):
                    self._solve: Callable[[Array], Array] = self._by_pardiso(known)
                    if self._is_good():
                        of.names.add("PARDISO")
                        return True
                if known.is_fresh:
                    break
        from scipy.sparse.linalg import splu
        try:
            factors = splu(held.tocsc())
        except RuntimeError:
            return False
        self._solve = lambda right: _each_part(factors.solve, right) if self._is_real else factors.solve(right)
        of.names.add("SuperLU")
        return self._is_good()

    def _by_pardiso(self, factors: Factors) -> Callable[[Array], Array]:
        if self._is_real:
            return lambda right: _each_part(factors.solve, right)

        def solve(right: Array) -> Array:
            both = factors.solve(np.concatenate((right.real, -right.imag)))
            return np.asarray(both[:right.size] + 1j * both[right.size:])
        return solve

    def _is_good(self) -> bool:
        try:
            self._refined(self._test)
        except SingularError:
            return False
        return True

    def _refined(self, right: Array) -> Array:
        x, self.residual = refined(lambda rest: self._solve(rest[0])[None], self._matrix, right[None],
                                    round_off=self._round_off)
        return x[0]

    def noise(self, x: Array) -> float:
        """Estimate of what round-off of the matrix makes of a solution [n], next to its size, in scaled unknowns."""
        whole = np.zeros(self._matrix.shape[0], complex)
        whole[:x.size] = x / self.scale[:x.size]
        # without a pattern that elements could have
        signs = 1.0 - 2.0 * (np.arange(whole.size) * 2654435761 >> 16 & 1)
        change = self._solve(NOISE * signs * (abs(self._matrix) @ np.abs(whole)) + 0j)
        return float(np.linalg.norm(change) / (np.linalg.norm(whole) or 1.0))

    def solve(self, right: Array) -> Array:
        """Of right-hand side [n], complex; without the rows of modes."""
        n = self._of.pencil.multiplier.size
        whole = np.zeros(self._matrix.shape[0], complex)
        whole[:n] = self.once * self.scale[:n] * right
        return (self.scale * self._refined(whole))[:n]


def _each_part(solve: Callable[[Array], Array], right: Array) -> Array:
    """Real and imaginary part one after the other."""
    return np.asarray(solve(np.ascontiguousarray(right.real)) + 1j * solve(np.ascontiguousarray(right.imag)))

