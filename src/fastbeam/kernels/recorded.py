"""States of a run at its rows, which the loop over steps keeps where many rows are evaluated at once."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.terms import put_loads


class Recorded(NamedTuple):
    """States after every so many substeps but the last, in rows."""

    every: np.ndarray   # int64 [1]
    q: np.ndarray       # float64 [m, 12 N], in a plane [m, 4 N]
    v: np.ndarray       # float64 [m, 12 N]
    theta: np.ndarray   # float64 [m, 3 N], in a plane [m, N]: Cayley vectors of the last substep


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
    for i in range(term.theta.shape[1]):
        term.theta[r, i] = system.work.theta[i]
