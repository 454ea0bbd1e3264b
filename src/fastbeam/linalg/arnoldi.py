"""Eigenvalues next to a shift of matrices without symmetry, from the operator of a solution at the shift.

Krylov vectors in blocks, so that double eigenvalues come together, orthonormal and all of them kept (block Arnoldi with full
orthogonalisation).
"""
from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from fastbeam.linalg.orthonormal import orthonormal

Array = np.ndarray
# residual of a Ritz pair next to its value, up to which it counts as converged
CONVERGED = 1e-11
# values of the operator, next to its largest, that are round-off
NOTHING = 1e-13
# growth of the number of Krylov vectors between two looks at what they give
GROWTH = 1.15


class Nearest(NamedTuple):
    """Eigenvalues, the best first, and their vectors basis @ parts."""

    values: Array          # complex [k]
    basis: Array           # [n, m], orthonormal
    parts: Array           # complex [m, k]
    is_converged: bool     # False where the vectors did not suffice


def nearest(applied: Callable[[Array], Array], begin: Array, shift: float, wanted: int, most: int,
            rank: Callable[[Array], Array]) -> Nearest:
    """Find eigenvalues r of which an operator has the eigenvalues 1 / (r - shift).

    Parameters
    ----------
    applied : callable
        The operator, on columns [n, b].
    begin : float64 [n, b]
        The first block.
    wanted, most : int
        Numbers of eigenvalues and, at most, of vectors, some blocks more.
    rank : callable
        Returns a number for each of some eigenvalues: the smallest are wanted, and none that are infinite.
    """
    from scipy import sparse
    n, size = begin.shape
    basis = np.zeros((n, most + 2 * size), order="F")
    h = np.zeros((most + 2 * size,) * 2)
    unit = sparse.identity(n, format="csr")
    block = orthonormal(begin, basis[:, :0], unit).q
    m, look = 0, min(wanted + 2 * size, most)
    while True:
        b = block.shape[1]
        basis[:, m:m + b] = block
        known = basis[:, :m + b]
        block, _, remainder, h[:m + b, m:m + b] = orthonormal(applied(block), known, unit)
        m += b
        h[m:m + len(remainder), m - b:m] = remainder
        if m >= look or not block.shape[1] or m + size > most:
            look = int(GROWTH * m)
            values, y = np.linalg.eig(h[:m, :m])
            y = y / np.linalg.norm(y, axis=0)
            error = np.linalg.norm(remainder @ y[m - b:], axis=0) if remainder.size else np.zeros(m)
            live = np.abs(values) > NOTHING * np.max(np.abs(values))
            found = np.where(live, shift + 1.0 / np.where(live, values, 1.0), np.inf)
            ranks = rank(found)
            order = np.argsort(ranks)[:min(wanted, int(np.sum(np.isfinite(ranks))))]
            done = order.size >= min(wanted, int(live.sum())) and bool(np.all(error[order] <= CONVERGED * np.abs(values[order])))
            if done or not block.shape[1] or m + size > most:
                break
    return Nearest(found[order], basis[:, :m], y[:, order], done or not block.shape[1])
