"""Ball joints that close loops of rigid parts and are held by multipliers; all others are eliminated (ties.py).

Gap x_b - x_a at the end of a step, force F on b and -F on a at the mean places, theory.md 4.1: no work, no moment.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import add_to, dim, position, put, vector
from fastbeam.kernels.beams.generalized_alpha import Alpha
from fastbeam.kernels.contact.point_entries import begin_joint, forget_gaps, joints_are_closed, put_point, take_forces
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.terms import (
    Conserving,
    Equilibrium,
    Midpoint,
    WithContact,
    assemble,
    first_guess,
    is_settled,
    take_unknowns,
)


class BallJoints(NamedTuple):
    """Joints between nodes a and b, J of them."""

    node: np.ndarray       # int64 [J, 2]
    row: np.ndarray        # int64 [J, 2]
    first: np.ndarray      # int64 [1]: number of the first among all constraints
    ties: Any              # ties.Ties, planar_nodes.PlanarTies or NoTies


BallJoints.reads = WithContact  # type: ignore[attr-defined]


@kernel
def add_ball_joints(joints, system, share):
    """Add forces, gaps and entries; share: of the tangent that the node matrix holds."""
    work, contact, dofs = system.work, system.contact, system.dofs
    for j in range(joints.node.shape[0]):
        k = joints.first[0] + j
        a = joints.node[j, 0]
        b = joints.node[j, 1]
        force = vector(system.state.force, contact.first_force[k], 1, dofs)
        begin_joint(contact, k, dim(dofs))
        add_to(work.r, 8 * joints.row[j, 1], 1, -1.0 * force)
        add_to(work.r, 8 * joints.row[j, 0], 1, force)
        put(contact.residual[k], 0, 1, position(work.q_end, b, dofs) - position(work.q_end, a, dofs))
        put_point.call(joints.ties, -share, 1.0, contact, k, b, joints.row[j, 1], work.q_mid, work.q_end, dofs)
        put_point.call(joints.ties, share, -1.0, contact, k, a, joints.row[j, 0], work.q_mid, work.q_end, dofs)


@assemble.register(BallJoints, Conserving)
@assemble.register(BallJoints, Equilibrium)
@assemble.register(BallJoints, Midpoint)
@kernel
def assemble_ball_joints(joints, method, system, h):
    add_ball_joints(joints, system, 1.0)


@assemble.register(BallJoints, Alpha)
@kernel
def assemble_ball_joints_at_end(joints, method, system, h):
    add_ball_joints(joints, system, 0.5)


first_guess.register(BallJoints)(forget_gaps)
take_unknowns.register(BallJoints)(take_forces)
is_settled.register(BallJoints)(joints_are_closed)
