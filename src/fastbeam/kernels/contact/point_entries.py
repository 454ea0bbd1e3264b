"""Constraint entries of joints with multipliers, theory.md 4: forces of a joint on two points, and the derivatives of its gaps.

A joint has some forces and as many gaps, functions of the positions of two nodes a and b. The gap of a ball joint is a vector:
its derivative by a position is a number times the unit matrix. The gap of a distance joint is a number: its derivative is a
vector.

Arrays: q_mid, q_end [12 N], in a plane [4 N].
"""
from __future__ import annotations

import numpy as np

from fastbeam.kernels.algebra.dimensions import cross_product, dim, put, put_cross_matrix
from fastbeam.kernels.algebra.vectors import V2, V3, f8
from fastbeam.kernels.beams.planar_nodes import PlanarTies
from fastbeam.kernels.beams.ties import Ties
from fastbeam.kernels.entries.dense import new_entry, tied_arm
from fastbeam.kernels.jit.decorators import inlined, kernel
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.layout import ARM, POSITION
from fastbeam.kernels.terms import NoTies

# accepted size of gaps that do not shrink any more, in units of round-off
STUCK = 1e3


@generic
def put_columns(column, line, contact, k, row, dofs):
    """Store the entry of a position: derivative of its residual by the forces, and of the gaps by the position."""


@generic
def put_arm_columns(column, line, contact, k, row, arm_mid, arm_end, dofs):
    """Store the entry of the spin of a node that carries such a position on an arm."""


@inlined
def spin_of_last(contact, k, row, dofs):
    """Return the index of the spin of a row in its entry: the last entry if it has the row, else a new one."""
    m = contact.entries[k] - 1
    at = 8 * len(dofs) * m if m >= 0 and contact.row[k, m] == row else new_entry(contact, k, row, dofs)
    return at + 8 * dim(dofs)


@put_columns.register(f8)
@kernel
def put_unit(column, line, contact, k, row, dofs):
    o = new_entry(contact, k, row, dofs)
    for i in range(dim(dofs)):
        contact.column[k, o + 9 * i] = column
        contact.line[k, o + 9 * i] = line


@put_arm_columns.register(f8)
@kernel
def put_unit_arm(column, line, contact, k, row, arm_mid, arm_end, dofs):
    o = spin_of_last(contact, k, row, dofs)
    put_cross_matrix(contact.column[k], o, column, arm_mid)
    put_cross_matrix(contact.line[k], o, line, arm_end)


@put_columns.register(V3[f8])
@put_columns.register(V2[f8])
@kernel
def put_direction(column, line, contact, k, row, dofs):
    o = new_entry(contact, k, row, dofs)
    put(contact.column[k], o, 8, column)
    put(contact.line[k], o, 8, line)


@put_arm_columns.register(V3[f8])
@put_arm_columns.register(V2[f8])
@kernel
def put_direction_arm(column, line, contact, k, row, arm_mid, arm_end, dofs):
    o = spin_of_last(contact, k, row, dofs)
    put(contact.column[k], o, 8, cross_product.call(arm_mid, column))
    put(contact.line[k], o, 8, cross_product.call(arm_end, line))


@generic
def put_point(ties, column, line, contact, k, node, row, q_mid, q_end, dofs):
    """Store the entries of one node; tied nodes pass them on."""


@put_point.register(NoTies)
@kernel
def put_free_point(ties, column, line, contact, k, node, row, q_mid, q_end, dofs):
    put_columns.call(column, line, contact, k, row, dofs)


@put_point.register(Ties)
@put_point.register(PlanarTies)
@kernel
def put_tied_point(ties, column, line, contact, k, node, row, q_mid, q_end, dofs):
    if ties.start[node + 1] == ties.start[node]:
        put_columns.call(column, line, contact, k, row, dofs)
    for t in range(ties.start[node], ties.start[node + 1]):
        if ties.kind[t] == POSITION:
            put_columns.call(column, line, contact, k, ties.target_row[t], dofs)
        elif ties.kind[t] == ARM:
            put_arm_columns.call(column, line, contact, k, ties.target_row[t], tied_arm.call(ties, t, q_mid),
                                 tied_arm.call(ties, t, q_end), dofs)


@kernel
def begin_joint(contact, k, forces):
    """Clear the entries of constraint k, a joint with as many gap equations as forces. The rest of its own block is that of the
    identity since the start of a run, and the rest of its residual 0."""
    contact.entries[k] = 0
    for i in range(8 * forces):
        contact.corner[k, i] = 0.0


@kernel
def take_forces(joints, system):
    """Add the increments of all forces of joints of one kind."""
    take_forces_of(joints.first[0], joints.node.shape[0], system)


@kernel
def take_forces_of(first, count, system):
    """Add the increments of the forces of `count` constraints from `first` on."""
    contact, y, force = system.contact, system.work.y, system.state.force
    for k in range(first, first + count):
        # constraints without a row are eliminated with their beams
        for a in range(contact.forces[k] if contact.first[k] >= 0 else 0):
            force[contact.first_force[k] + a] += y[contact.first[k] + a]


@kernel
def forget_gaps(joints, system, h, c):
    """Reset the gaps of the iteration before to infinity, ahead of the first iteration of a step."""
    contact = system.contact
    for k in range(joints.first[0], joints.first[0] + joints.node.shape[0]):
        contact.before[k] = np.inf


@kernel
def is_closed(contact, k, allowed):
    """Return whether the augmented Lagrangian leaves a gap of round-off size at constraint k, or one that does not shrink any
    more: round-off of triads and arms makes redundant joints disagree, by some 1e-16 times the root of the number of steps."""
    left = contact.remaining[k]
    before = contact.before[k]
    contact.before[k] = left
    return left <= allowed or (left <= STUCK * allowed and left >= before)


@kernel
def joints_are_closed(joints, system):
    """Return whether the gaps of joints of one kind are closed."""
    contact, q, dofs = system.contact, system.state.q, system.dofs
    closed = True
    for j in range(joints.node.shape[0]):
        reach = system.length
        for c in range(dim(dofs)):
            reach = max(reach, system.length + abs(q[(12 if dim(dofs) == 3 else 4) * joints.node[j, 0] + c]))
        closed = is_closed(contact, joints.first[0] + j, 1e-15 * reach) and closed
    return closed
