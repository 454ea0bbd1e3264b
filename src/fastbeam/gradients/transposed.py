"""Solutions with the transposed tangent of a step outside of compiled code, for the adjoint of runs (theory.md (13.12))."""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.adjoint import adjoint as kernels
from fastbeam.kernels.empty_arrays import aligned_empty
from fastbeam.linalg.factors import OF_STEP, Factoriser, Factors, factoriser_for
from fastbeam.model.maps import free_of_rows
from fastbeam.stepping.stepper import Stepper

Array = np.ndarray


class TransposedSolver:
    """Solutions with the transposed matrix of a stepper by PARDISO, or SuperLU."""

    def __init__(self, stepper: Stepper) -> None:
        self.stepper, self.structure = stepper, None
        self._factoriser: Factoriser | None = None

    def _begin(self) -> None:
        """Form the structure of tangents by columns, and find where their entries stand in the blocks."""
        core = self.stepper.core
        size, n = core.pattern.keys.size, len(core.dofs)
        numbered = self.stepper.linear.superlu.matrix(np.arange(1.0, 8.0 * n * size + 1.0).reshape(-1, n, 8))
        self.place = numbered.data.astype(np.int64) - 1
        self.structure = numbered.indices, numbered.indptr
        self._factoriser = factoriser_for("auto")

    def _bordered(self, matrix: Any, terms: Any, system: Any) -> Any:
        """Border a matrix with columns and lines of constraints, by columns, and add the part of the terms that turns with
        sleeves."""
        contact, core = self.stepper.contact, self.stepper.core
        assert contact is not None
        n, size = len(core.dofs), core.border
        count = len(contact.entries)
        free = free_of_rows(core, core.held).reshape(-1, n)
        parts = []
        for of in (contact.column, contact.line):
            out = np.zeros((core.pattern.n, n, count, size))
            for k in range(count):
                for m in range(contact.entries[k]):
                    out[contact.row[k, m], :, k] += of[k].reshape(-1, n, 8)[m, :, :size]
            parts.append(sparse.csr_matrix((free[:, :, None, None] * out).reshape(core.pattern.n * n, count * size)))
        corner = sparse.block_diag([x.reshape(8, 8)[:size, :size] for x in contact.corner]).tolil()
        for (slide, moments), (by_moments, by_s) in zip(size * contact.pair, contact.cross):
            for a in range(int(contact.forces[moments // size])):
                corner[slide + core.dim, moments + a] += by_moments[a]
                corner[moments + a, slide + core.dim] += by_s[a]
        matrix = matrix + self._turning(free, terms, system)
        return sparse.bmat([[matrix, parts[0]], [parts[1].T, corner]], format="csc")

    def _turning(self, free: Array, terms: Any, system: Any) -> Any:
        """Return E of theory.md (13.13), by columns; free [rows, n]: 0 where a row is held."""
        contact, core = self.stepper.contact, self.stepper.core
        assert contact is not None
        n, d = core.pattern.n, core.dim
        found = sparse.lil_matrix((n * len(core.dofs), n * len(core.dofs)))
        rows = {int(row) for c in contact.pair[:, 1] for row in contact.row[c, :contact.entries[c]]}
        for row in rows:
            for i in range(d, len(core.dofs)):
                x, out = aligned_empty(8 * (core.n_nodes + 1)), aligned_empty(8 * (core.n_nodes + 1))
                x[8 * row + i] = free[row, i]
                kernels.turn_rows(terms, system, x, out)
                found[len(core.dofs) * row + i] = -(free * out.reshape(-1, 8)[:n, :len(core.dofs)]).reshape(-1)
        return found.tocsc()

    def solve(self, blocks: Array, right: Array, terms: Any, system: Any) -> Array | None:
        """Return x [rows n], with those of a border behind, with K^T x = right; None where K is singular. terms, system: of the
        step."""
        if self.structure is None:
            self._begin()
        n = len(self.stepper.core.dofs) * self.stepper.core.pattern.n
        matrix = sparse.csc_matrix((blocks[self.place], *self.structure), shape=(n, n))
        if right.size > n:
            matrix = self._bordered(matrix, terms, system)
        # the structure of a border changes as sliders go on
        return Factors(matrix.T.tocsr(), self._factoriser if right.size == n else None, OF_STEP).solve(right)
