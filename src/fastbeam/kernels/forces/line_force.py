"""Forces along the line of two points by user functions, theory.md (4.29).

The law gives the tension from the time in the middle of the step, the mean of the lengths at both ends and their difference over
the step. With these a linear spring and a damper written as laws are those of theory.md (4.9) and (4.18). The force lies along
the mean of both ends, so that both momenta are conserved, and its work is accounted. In statics it acts in full at every load
factor, as springs do.

Arrays: q [12 N], in a plane [4 N].
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.vectors import call_law, dot
from fastbeam.kernels.entries.pairs import add_pair, difference
from fastbeam.kernels.forces.user_force import FAILED, FOUND, GIVEN, INCREMENT, SLOPES, TIME, Laws, find_slopes
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.terms import account, assemble, known, spread_nodes


class LineForces(NamedTuple):
    """L forces between nodes a and b."""

    node: np.ndarray       # int64 [L, 2]
    row: np.ndarray        # int64 [L, 2]
    block: np.ndarray      # int64 [L, 4]: a-a, a-b, b-a, b-b
    place: np.ndarray      # int64 [L]: offset of the work in the history
    first: np.ndarray      # int64 [L]: first of its parameters
    parameters: np.ndarray  # float64 [*]
    laws: Laws
    work: np.ndarray       # float64 [SIZE]: of one run, as of user forces


@kernel
def tension_at(lines, k, length, rate):
    """Return the tension of line k by its law."""
    w = lines.work
    w[GIVEN] = length
    w[GIVEN + 1] = rate
    base = w.ctypes.data
    call_law(lines.laws.address[k], w[TIME], base + 8 * GIVEN, lines.parameters.ctypes.data + 8 * lines.first[k],
             base + 8 * FOUND, base + 8 * FAILED)
    return w[FOUND]


@assemble.register(LineForces)
@kernel
def assemble_lines(lines, method, system, h):
    """Add forces and stiffness of all lines; in statics, with h = 0, of one shape, with half the derivative."""
    work, dofs = system.work, system.dofs
    over = 1.0 / h if h != 0.0 else 0.0
    for k in range(lines.place.shape[0]):
        mean = difference(lines, k, work.q_mid, dofs)
        start, end = mean, mean
        if h != 0.0:
            start, end = difference(lines, k, system.state.q, dofs), difference(lines, k, work.q_end, dofs)
        before, after = dot(start, start)**0.5, dot(end, end)**0.5
        both = before + after
        tension = tension_at(lines, k, 0.5 * both, over * (after - before))
        if lines.laws.slopes[k] != 0:
            find_slopes(lines, k)
            slope = 0.5 * lines.work[SLOPES] + over * lines.work[SLOPES + 1]
        else:
            size = INCREMENT * both
            slope = (tension_at(lines, k, 0.5 * (both + size), over * (after + size - before))
                     - tension_at(lines, k, 0.5 * (both - size), over * (after - size - before))) / (2.0 * size)
        share = 2.0 * tension / both
        add_pair(lines, k, share * mean, 0.5 * share, ((2.0 * slope - share) / (both * after)) * mean, end, work, dofs)


@account.register(LineForces)
@kernel
def account_lines(lines, system, h):
    """Record the work, tension times the change of the length."""
    state, work, dofs = system.state, system.work, system.dofs
    for k in range(lines.place.shape[0]):
        for side in range(2):
            # update the nodes to the last increment
            node = lines.node[k, side]
            spread_nodes.call(dofs, system.method, state, work, h, node, node + 1)
        start, end = difference(lines, k, state.q, dofs), difference(lines, k, work.q_end, dofs)
        before, after = dot(start, start)**0.5, dot(end, end)**0.5
        tension = tension_at(lines, k, 0.5 * (before + after), (after - before) / h)
        state.history[lines.place[k]] += known(tension * (after - before))
