"""Joints that keep the distance of two points, theory.md 4.1.

Gap (|r|^2 - L^2)/(2 L) with r = x_b - x_a at the end of a step, push P along the mean r: P r_mid/L on b, the opposite on a.
Its work is P times the change of the gap, none; forces along the mean r leave the angular momentum alone. A tension is -P.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.algebra.vectors import dot
from fastbeam.kernels.beams.generalized_alpha import Alpha
from fastbeam.kernels.contact.point_entries import begin_joint, forget_gaps, joints_are_closed, put_point, take_forces
from fastbeam.kernels.entries.pairs import add_pair, difference
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


class DistanceJoints(NamedTuple):
    """Joints between nodes a and b, J of them."""

    node: np.ndarray       # int64 [J, 2]
    row: np.ndarray        # int64 [J, 2]
    block: np.ndarray      # int64 [J, 4]: blocks a-a, a-b, b-a, b-b
    length: np.ndarray     # float64 [J], m
    first: np.ndarray      # int64 [1]: number of the first among all constraints
    ties: Any              # ties.Ties, planar_nodes.PlanarTies or NoTies


DistanceJoints.reads = WithContact  # type: ignore[attr-defined]


@kernel
def add_distance_joints(joints, system, share):
    """Add tensions, gaps and entries; share: of the tangent that the node matrix holds."""
    work, contact, dofs = system.work, system.contact, system.dofs
    for j in range(joints.length.shape[0]):
        k = joints.first[0] + j
        over = 1.0 / joints.length[j]
        end = difference(joints, j, work.q_end, dofs)
        mean = difference(joints, j, work.q_mid, dofs)
        push = system.state.force[contact.first_force[k]]
        begin_joint(contact, k, 1)
        add_pair(joints, j, (-push * over) * mean, -0.5 * push * over, 0.0 * mean, mean, work, dofs)
        length = dot(end, end)**0.5
        # (l^2 - L^2)/(2 L) without the loss of digits
        contact.residual[k, 0] = 0.5 * over * (length - joints.length[j]) * (length + joints.length[j])
        column = (-share * over) * mean
        line = over * end
        put_point.call(joints.ties, column, line, contact, k, joints.node[j, 1], joints.row[j, 1], work.q_mid, work.q_end, dofs)
        put_point.call(joints.ties, -1.0 * column, -1.0 * line, contact, k, joints.node[j, 0], joints.row[j, 0], work.q_mid,
                       work.q_end, dofs)


@assemble.register(DistanceJoints, Conserving)
@assemble.register(DistanceJoints, Equilibrium)
@assemble.register(DistanceJoints, Midpoint)
@kernel
def assemble_distance_joints(joints, method, system, h):
    add_distance_joints(joints, system, 1.0)


@assemble.register(DistanceJoints, Alpha)
@kernel
def assemble_distance_joints_at_end(joints, method, system, h):
    add_distance_joints(joints, system, 0.5)


first_guess.register(DistanceJoints)(forget_gaps)
take_unknowns.register(DistanceJoints)(take_forces)
is_settled.register(DistanceJoints)(joints_are_closed)
