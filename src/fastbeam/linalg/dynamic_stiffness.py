"""Dynamic stiffness, the equations of motions x e^(r t) about a state of rest as one complex sparse matrix:

    K x + r C x + r^2 M x - B^T m = f,   B x = g

One structure serves all rates r; without an imaginary part the matrix is a real one.
"""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.linalg.eigen import LIMITS, NOISE, Pencil, SingularError, grown, regularised, scales, stiffest
from fastbeam.linalg.factors import factoriser_for

Array = np.ndarray
# share of forces along a motion that is round-off
PUSHED = 1e-9


def with_still(pencil: Pencil, forces: Array) -> Pencil:
    """Return the pencil with a stiffness against those zero-energy motions, `Pencil.still`, that these forces [k] do not push:
    all other motions are orthogonal to them in the masses and do not see it."""
    still = pencil.still
    if not still.shape[1]:
        return pencil
    size = np.sqrt(np.asarray(still.multiply(still).sum(axis=0)).reshape(-1))
    quiet = np.flatnonzero(np.abs(still.T @ forces) <= PUSHED * size * np.linalg.norm(forces))
    still = still.tocsc()[:, quiet]
    product = pencil.mass @ still
    weight = np.asarray(product.multiply(still).sum(axis=0)).reshape(-1)
    regularised = product @ sparse.diags(stiffest(pencil) / weight) @ product.T
    return pencil._replace(stiffness=(pencil.stiffness + grown(regularised.tocsr(), pencil.multiplier.size)).tocsr())


class DynamicStiffness:
    """Matrix K + r C + r^2 M with the constraints of a pencil, factored at one rate r after the other.

    damping: sparse [k, k], C.
    loss: sparse [k, k], stiffness that has an imaginary part: i times this is added.
    ratios: (float64 [k, m], float64 [m], float64 [m]), M times m modes of unit mass, their angular frequencies and the damping
        ratios they get besides.
    backend: {'auto', 'pardiso', 'superlu'}.
    """

    def __init__(self, pencil: Pencil, damping: Any, loss: Any = None, ratios: tuple[Array, Array, Array] | None = None,
                 backend: str = "auto") -> None:
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
        # derivative by r: the sensitivity to the frequency
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
        self._indices = (every % size).astype(np.int32)
        self._indptr = np.searchsorted(every, size * np.arange(size + 1)).astype(np.int32)
        self._diagonal = np.searchsorted(every, diagonal)
        self._has_loss = loss is not None
        self.factoriser = factoriser_for(backend, symmetric=self._symmetric)
        self.names: set[str] = set()
        self._size = size

    @property
    def name(self) -> str:
        """Names of the solvers that were used, for a result."""
        return " and ".join(sorted(self.names))

    def matrix(self, rate: complex) -> Any:
        """Return the matrix at a rate, sparse complex [n + m, n + m]; behind the others a row for every mode with a damping
        ratio."""
        data = self._data[0] + complex(rate) * self._data[1] + rate * rate * self._data[2]
        if self._has_loss:
            data = data + 1j * self._data[3]
        if self._modes:
            # the force M z r 2 zeta w (z . M x) acts on x; it vanishes for r = 0
            own = self._diagonal[self._size - self._modes:]
            data = data + (rate != 0.0) * self._data[-1]
            data[own] -= 1.0 / (rate * 2.0 * self._ratios * self._frequencies) if rate else 1.0
        return sparse.csr_matrix((data, self._indices, self._indptr), shape=(self._size, self._size))

    def factored(self, rate: complex, round_off: float = LIMITS.round_off) -> Solver:
        """Return the factors at a rate, ready to solve.

        round_off: accepted ratio of residuals to the largest of their terms: more for inverse iteration, next to an eigenvalue.
        Raises SingularError: the matrix is singular.
        """
        return Solver(self, self.matrix(rate), round_off)


class Solver:
    """Factors of the dynamic stiffness at one rate.

    Raises
    ------
    SingularError
        When it is made, or solves.
    """

    def __init__(self, of: DynamicStiffness, matrix: Any, round_off: float) -> None:
        self._of = of
        size = abs(matrix)
        once, self.scale = scales(size, True, of.pencil)
        idle = ~of.multiplier & (size.diagonal() == 0.0)
        draw = np.random.default_rng(1).standard_normal((2, 2, of.multiplier.size))
        self._factors = regularised(matrix if np.any(matrix.data.imag) else matrix.real, of.factoriser,
                                  LIMITS._replace(round_off=round_off, last_bits=0.0), (once * self.scale, self.scale),
                                  of.multiplier, idle, draw[0] + 1j * draw[1])
        if self._factors.by is not None:
            of.names.add(self._factors.by.name)

    @property
    def residual(self) -> float:
        """Residual of the last solution, relative to its right-hand side, in scaled rows."""
        return self._factors.residual

    def noise(self, x: Array) -> float:
        """Estimate the relative error of a solution [n] due to round-off of the matrix, in scaled unknowns."""
        scaled = self._factors.scaled
        whole = np.zeros(scaled.shape[0], complex)
        whole[:x.size] = x / self.scale[:x.size]
        # signs without a pattern that elements could have
        signs = 1.0 - 2.0 * (np.arange(whole.size) * 2654435761 >> 16 & 1)
        change = self._factors.solve_roughly(NOISE * signs * (abs(scaled) @ np.abs(whole)) + 0j)
        return float(np.linalg.norm(change) / (np.linalg.norm(whole) or 1.0))

    def solve(self, right: Array) -> Array:
        """Return the solution for a right-hand side [n], complex; without the rows of modes."""
        n = self._of.pencil.multiplier.size
        whole = np.zeros(self.scale.size, complex)
        whole[:n] = right
        x = self._factors.solve(whole)
        if x is None:
            raise SingularError
        return x[:n]
