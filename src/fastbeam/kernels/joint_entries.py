"""Entries of joints with multipliers, theory.md 4: what their forces do to two points, and the derivatives of their gaps.

A joint has some forces and as many gaps, functions of the positions of two nodes a and b. The gap of a ball joint is a vector:
its derivative by a position is a number times the unit matrix. The gap of a distance joint is a number: its derivative is a
vector.

Arrays: q_mid, q_end [12 N], in a plane [4 N].
"""
from __future__ import annotations

from .._generic import generic
from .._jit import kernel
from .algebra import V2, V3, f8
from .alpha import Alpha
from .kinds import cross_product, dim, put, put_cross_matrix
from .planar_nodes import PlanarTies
from .slider import is_gap_closed, new_entry, tied_arm
from .terms import Conserving, Midpoint, NoTies, assemble, is_settled, take_unknowns
from .ties import Ties


@generic
def put_columns(column, line, contact, k, row, size):
    """Entry of a position: derivative of its residual by the forces, and of the gaps by the position."""


@generic
def put_arm_columns(column, line, contact, k, row, arm_mid, arm_end, size):
    """Entry of the spin of a node that carries such a position on an arm."""


@put_columns.register(f8)
@kernel
def put_unit(column, line, contact, k, row, size):
    o = new_entry(contact, k, row, size)
    for i in range(dim(size)):
        contact.column[k, o + 9 * i] = column
        contact.line[k, o + 9 * i] = line


@put_arm_columns.register(f8)
@kernel
def put_unit_arm(column, line, contact, k, row, arm_mid, arm_end, size):
    o = new_entry(contact, k, row, size) + 8 * dim(size)
    put_cross_matrix(contact.column[k], o, column, arm_mid)
    put_cross_matrix(contact.line[k], o, line, arm_end)


@put_columns.register(V3[f8])
@put_columns.register(V2[f8])
@kernel
def put_direction(column, line, contact, k, row, size):
    o = new_entry(contact, k, row, size)
    put(contact.column[k], o, 8, column)
    put(contact.line[k], o, 8, line)


@put_arm_columns.register(V3[f8])
@put_arm_columns.register(V2[f8])
@kernel
def put_direction_arm(column, line, contact, k, row, arm_mid, arm_end, size):
    o = new_entry(contact, k, row, size) + 8 * dim(size)
    put(contact.column[k], o, 8, cross_product.call(arm_mid, column))
    put(contact.line[k], o, 8, cross_product.call(arm_end, line))


@generic
def put_point(ties, column, line, contact, k, node, row, q_mid, q_end, size):
    """Entries of one node; tied nodes pass them on."""


@put_point.register(NoTies)
@kernel
def put_free_point(ties, column, line, contact, k, node, row, q_mid, q_end, size):
    put_columns.call(column, line, contact, k, row, size)


@put_point.register(Ties)
@put_point.register(PlanarTies)
@kernel
def put_tied_point(ties, column, line, contact, k, node, row, q_mid, q_end, size):
    if ties.start[node + 1] == ties.start[node]:
        put_columns.call(column, line, contact, k, row, size)
    for t in range(ties.start[node], ties.start[node + 1]):
        if ties.kind[t] == 0:
            put_columns.call(column, line, contact, k, ties.target_row[t], size)
        elif ties.kind[t] == 1:
            put_arm_columns.call(column, line, contact, k, ties.target_row[t], tied_arm.call(ties, t, q_mid),
                                 tied_arm.call(ties, t, q_end), size)


@generic
def put_joint(joints, j, system):
    """Forces of joint j into the residual, its gaps into that of its constraint. Returns its number of forces, the derivative of
    the residual of node b by them, and that of the gaps by the position of b; those of node a are the opposite."""


@kernel
def add_joints(joints, system, share):
    """Forces, gaps and entries of joints of one kind; share: of the tangent that the node matrix holds."""
    work, contact, size = system.work, system.contact, system.size
    for j in range(joints.node.shape[0]):
        k = joints.first[0] + j
        forces, column, line = put_joint.call(joints, j, system)
        column = share * column
        contact.entries[k] = 0
        for i in range(64):
            contact.corner[k, i] = 0.0
        for i in range(forces, 8):
            contact.corner[k, 9 * i] = 1.0
            contact.residual[k, i] = 0.0
        put_point.call(joints.ties, column, line, contact, k, joints.node[j, 1], joints.row[j, 1], work.q_mid, work.q_end, size)
        put_point.call(joints.ties, -1.0 * column, -1.0 * line, contact, k, joints.node[j, 0], joints.row[j, 0], work.q_mid,
                       work.q_end, size)


@kernel
def assemble_joints(joints, method, system, h):
    add_joints(joints, system, 1.0)


@kernel
def assemble_joints_at_end(joints, method, system, h):
    add_joints(joints, system, 0.5)


@kernel
def take_forces(joints, system):
    """Add the increments of all forces of joints of one kind."""
    contact, y, force = system.contact, system.work.y, system.state.force
    for k in range(joints.first[0], joints.first[0] + joints.node.shape[0]):
        for a in range(contact.forces[k]):
            force[contact.first_force[k] + a] += y[contact.first[k] + a]


@kernel
def joints_are_closed(joints, system):
    """Whether the augmented Lagrangian leaves gaps of round-off size only."""
    for j in range(joints.node.shape[0]):
        if not is_gap_closed(system, joints.first[0] + j, joints.node[j, 0]):
            return False
    return True


def register_joints(kind):
    """What joints of any kind do in a step."""
    assemble.register(kind, Conserving)(assemble_joints)
    assemble.register(kind, Midpoint)(assemble_joints)
    assemble.register(kind, Alpha)(assemble_joints_at_end)
    take_unknowns.register(kind)(take_forces)
    is_settled.register(kind)(joints_are_closed)
