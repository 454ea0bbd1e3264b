"""Ball joints that close loops of rigid parts and are held by multipliers; all others are eliminated (ties.py).

Gap x_b - x_a at the end of a step, force F on b and -F on a at the mean places, theory.md 4.1: no work, no moment.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .._jit import inlined
from .joint_entries import put_joint, register_joints
from .kinds import add_to, dim, position, put, vector


class BallJoints(NamedTuple):
    """Joints between nodes a and b, J of them."""

    node: np.ndarray       # int64 [J, 2]
    row: np.ndarray        # int64 [J, 2]
    first: np.ndarray      # int64 [1]: number of the first among all constraints
    ties: Any              # ties.Ties, planar_nodes.PlanarTies or NoTies


@put_joint.register(BallJoints)
@inlined
def put_ball_joint(joints, j, system):
    work, contact, size = system.work, system.contact, system.size
    k = joints.first[0] + j
    force = vector(system.state.force, contact.first_force[k], 1, size)
    add_to(work.r, 8 * joints.row[j, 1], 1, -1.0 * force)
    add_to(work.r, 8 * joints.row[j, 0], 1, force)
    gap = position(work.q_end, joints.node[j, 1], size) - position(work.q_end, joints.node[j, 0], size)
    put(contact.residual[k], 0, 1, gap)
    return dim(size), -1.0, 1.0


register_joints(BallJoints)
