"""States of a run at its rows: kept by the loop over steps where many rows are evaluated at once, and mapped to space.

Arrays: directions [3, 12 N]; flat_rows [m, 4 N]; rows_out [m, 12 N].
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import coordinates
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.terms import put_loads


class Recorded(NamedTuple):
    """States after every so many substeps but the last, in rows."""

    every: np.ndarray   # int64 [1]
    q: np.ndarray       # float64 [m, 12 N], in a plane [m, 4 N]
    v: np.ndarray       # float64 [m, 12 N]
    turned: np.ndarray  # float64 [1]: largest square of a Cayley vector in the substeps before


@put_loads.register(Recorded)
@kernel
def keep_row(term, system, k):
    """Keep the state before substep k."""
    if k == 0 or k % term.every[0] != 0:
        return
    r = k // term.every[0] - 1
    for i in range(term.q.shape[1]):
        term.q[r, i] = system.state.q[i]
        term.v[r, i] = system.state.v[i]
    theta, most = system.work.theta, term.turned[0]
    n = theta.shape[0] * coordinates(system.dofs) // term.q.shape[1]
    for i in range(0, theta.shape[0], n):
        square = 0.0
        for j in range(i, i + n):
            square += theta[j] * theta[j]
        most = max(most, square)
    term.turned[0] = most


@kernel
def rows_in_space(directions, share, flat_rows, rows_out):
    """Map rows of coordinates in a plane to space, share = 1, or of their rates, share = 0: the position x, y and the director u
    of a node are x or u_x times the first of the directions plus y or u_y times the second plus the last."""
    first = directions[0]; second = directions[1]; constant = directions[2]
    for r in range(flat_rows.shape[0]):
        flat = flat_rows[r]
        out = rows_out[r]
        for i in range(flat.shape[0] // 4):
            x = flat[4 * i]; y = flat[4 * i + 1]
            for k in range(12 * i, 12 * i + 3):
                out[k] = x * first[k] + y * second[k] + share * constant[k]
            x = flat[4 * i + 2]; y = flat[4 * i + 3]
            for k in range(12 * i + 3, 12 * i + 12):
                out[k] = x * first[k] + y * second[k] + share * constant[k]
