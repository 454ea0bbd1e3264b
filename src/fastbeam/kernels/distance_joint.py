"""Joints that keep the distance of two points, theory.md 4.1.

Gap (|r|^2 - L^2)/(2 L) with r = x_b - x_a at the end of a step, push P along the mean r: P r_mid/L on b, the opposite on a.
Its work is P times the change of the gap, none; forces along the mean r leave the angular momentum alone. A tension is -P.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .._jit import inlined
from .algebra import dot
from .joint_entries import put_joint, register_joints
from .spring import add_pair, difference


class DistanceJoints(NamedTuple):
    """Joints between nodes a and b, J of them."""

    node: np.ndarray       # int64 [J, 2]
    row: np.ndarray        # int64 [J, 2]
    block: np.ndarray      # int64 [J, 4]: blocks a-a, a-b, b-a, b-b
    length: np.ndarray     # float64 [J], m
    first: np.ndarray      # int64 [1]: number of the first among all constraints
    ties: Any              # ties.Ties, planar_nodes.PlanarTies or NoTies


@put_joint.register(DistanceJoints)
@inlined
def put_distance_joint(joints, j, system):
    work, contact, size = system.work, system.contact, system.size
    k = joints.first[0] + j
    over = 1.0 / joints.length[j]
    end = difference(joints, j, work.q_end, size)
    mean = difference(joints, j, work.q_mid, size)
    push = system.state.force[contact.first_force[k]]
    add_pair(joints, j, (-push * over) * mean, -0.5 * push * over, 0.0 * mean, mean, work, size)
    length = dot(end, end)**0.5
    # (l^2 - L^2)/(2 L) without the loss of digits
    contact.residual[k, 0] = 0.5 * over * (length - joints.length[j]) * (length + joints.length[j])
    return 1, -over * mean, over * end


register_joints(DistanceJoints)
