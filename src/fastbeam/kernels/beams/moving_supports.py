"""Supports that move as functions of time (theory.md 4, (4.11)), with known increments in a step, and the work of their
reactions.

Two terms share the arrays: the first guess comes before that of tied nodes; reactions are read from the rows of the nodes before
supports clear them.

Arrays: r [8 (rows + 1)]; dphi, theta [3 N], in a plane [2 N], [N].
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import dim
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.state import CHANGED
from fastbeam.kernels.terms import account, assemble, first_guess, is_settled, put_loads

# least number of calls that ask whether a step may end: the last iteration evaluates reactions at the end of the step
ASKED = 2
# iterations go on while the work of reactions is expected to change by more than this share of it: if increments converge
# slowly, over the kink of a rope that becomes slack, one iteration is not enough. Most calls, and most iterations, for that
CHANGES, MOST_ASKED, MOST_ITERATIONS = 1e-13, 6, 24.0


class Prescribed(NamedTuple):
    """M prescribed motions of n nodes; nodes that share a row have the same motion."""

    node: np.ndarray      # int64 [n]
    motion: np.ndarray    # int64 [n]: number of the motion of every node
    mask: np.ndarray      # int64 [M]: bit c set, unknown c is prescribed
    row: np.ndarray       # int64 [M]
    place: np.ndarray     # int64 [M]: offset of the work in `State.history`
    given: np.ndarray     # float64 [M, 6], in a plane [M, 3]: increments of the step, position, m, and Cayley vector
    reaction: np.ndarray  # float64 [M, 6], in a plane [M, 3]: forces, N, and moments, N m, on the nodes
    asked: np.ndarray     # int64 [1]: how often this step was asked whether it is done
    works: np.ndarray     # float64 [4]: work of all reactions in the last three iterations, J, the newest first; their number


class MovedRows(NamedTuple):
    """Reactions of `Prescribed` motions, a term behind the ties, when the rows of these nodes hold them."""

    of: Prescribed


class PrescribedSchedule(NamedTuple):
    """Increments of every substep, in the tuple of terms ahead of all others."""

    of: Prescribed
    given: np.ndarray     # float64 [substeps, M, 6], in a plane [substeps, M, 3]


@put_loads.register(PrescribedSchedule)
@kernel
def put_increments(term, system, k):
    given = term.of.given
    for m in range(given.shape[0]):
        for c in range(given.shape[1]):
            given[m, c] = term.given[k, m, c]


@first_guess.register(Prescribed)
@kernel
def move_supports(term, system, h, c):
    """Set the prescribed increments, which no iteration changes, because the unknowns are fixed."""
    work, dofs = system.work, system.dofs
    d = dim(dofs)
    spins = len(dofs) - d
    term.asked[0] = 0
    term.works[3] = 0.0
    for k in range(term.node.shape[0]):
        n = term.node[k]
        m = term.motion[k]
        for i in range(d):
            if (term.mask[m] >> i) & 1:
                work.dphi[d * n + i] = term.given[m, i]
        for i in range(spins):
            if (term.mask[m] >> (d + i)) & 1:
                work.theta[spins * n + i] = term.given[m, d + i]


@assemble.register(MovedRows)
@kernel
def take_reactions(term, method, system, h):
    r, of = system.work.r, term.of
    for m in range(of.row.shape[0]):
        for c in range(len(system.dofs)):
            of.reaction[m, c] = r[8 * of.row[m] + c]
    of.works[2], of.works[1], of.works[0] = of.works[1], of.works[0], work_of_reactions(of, system)
    of.works[3] += 1.0


@kernel
def work_of_reactions(of, system):
    """Return the work of all reactions in the step, J."""
    total = 0.0
    for m in range(of.row.shape[0]):
        for c in range(len(system.dofs)):
            if (of.mask[m] >> c) & 1:
                total += of.reaction[m, c] * of.given[m, c]
    return total


@is_settled.register(MovedRows)
@kernel
def reactions_are_those_of_the_end(term, system):
    """Ask for one more iteration, because reactions are those before the last increment, and for more while their work changes.
    The next change of an iteration that squares its errors is the last one times the square of their ratio. A change of the
    friction law starts this anew."""
    of = term.of
    if system.work.increment.control[CHANGED] != 0.0:
        system.work.increment.control[CHANGED] = 0.0
        of.asked[0] = 0
        return False
    of.asked[0] += 1
    if of.asked[0] < ASKED or of.works[3] < 3.0 or of.asked[0] >= MOST_ASKED or of.works[3] >= MOST_ITERATIONS:
        return of.asked[0] >= ASKED
    last, before = abs(of.works[0] - of.works[1]), abs(of.works[1] - of.works[2])
    ratio = min(last / before, 1.0) if before > 0.0 else 0.0
    return last * ratio * ratio <= CHANGES * abs(of.works[0])


@account.register(MovedRows)
@kernel
def account_motion(term, system, h):
    of, history = term.of, system.state.history
    for m in range(of.row.shape[0]):
        work = 0.0
        for c in range(len(system.dofs)):
            if (of.mask[m] >> c) & 1:
                work += of.reaction[m, c] * of.given[m, c]
        history[of.place[m]] += work
