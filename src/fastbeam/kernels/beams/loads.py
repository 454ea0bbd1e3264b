"""Work of loads that have no potential: those that change in time, and moments."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import dim
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.terms import account


class LoadWork(NamedTuple):
    """Term that adds the work of all loads and of gravity to `State.history`."""

    node: np.ndarray    # int64 [rows]: a node that has the row
    place: np.ndarray   # int64 [1]: where the work stands in the history


@account.register(LoadWork)
@kernel
def account_loads(term, system, h):
    """Record the work f . Dphi + m . theta of the loads, as of the forces in the equations of the step (theory.md 4)."""
    work, dofs = system.work, system.dofs
    d = dim(dofs)
    spins = len(dofs) - d
    total = 0.0
    for r in range(term.node.shape[0]):
        n = term.node[r]
        for c in range(d):
            total += work.f_ext[8 * r + c] * work.dphi[d * n + c]
        for c in range(spins):
            total += work.f_ext[8 * r + d + c] * work.theta[spins * n + c]
    system.state.history[term.place[0]] += total
