"""Points without mass where beams cross, theory.md 5.10.

Such a node has no stiffness and no inertia: its equations are the balance of the contact forces on it, which do not depend on its
position. The solver, which eliminates nodes before forces, needs a pivot there. It gets that of a mass, in the tangent alone. The
residual of the balance is then that mass times the last increment, and vanishes in an iteration that has converged.

Arrays: q [12 N], in a plane [4 N].
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import add_stiffness, coordinates, dim, zero_vector
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.terms import Conserving, assemble, is_settled

# increments of a knot that are round-off, as a share of the size of the scene and the distance from the origin
AT_REST = 1e-14


class Knots(NamedTuple):
    """K nodes without mass."""

    node: np.ndarray    # int64 [K]
    row: np.ndarray     # int64 [K]
    block: np.ndarray   # int64 [K]: diagonal blocks
    hold: np.ndarray    # float64 [K]: mass in the tangent, kg


@assemble.register(Knots, Conserving)
@kernel
def hold_knots(knots, method, system, h):
    dofs = system.dofs
    for k in range(knots.block.shape[0]):
        none = zero_vector(dofs)
        add_stiffness(system.work.blocks, 8 * len(dofs) * knots.block[k], 2.0 * knots.hold[k] / (h * h), none, none)


@is_settled.register(Knots)
@kernel
def knots_are_settled(knots, system):
    """Return whether the last increments of the nodes without mass are round-off, so that their forces balance."""
    q, dofs = system.state.q, system.dofs
    for k in range(knots.node.shape[0]):
        p = coordinates(dofs) * knots.node[k]
        reach = system.length
        move = 0.0
        for c in range(dim(dofs)):
            reach = max(reach, abs(q[p + c]))
            move = max(move, abs(system.work.increment.x[8 * knots.row[k] + c]))
        if not move <= AT_REST * reach:
            return False
    return True
