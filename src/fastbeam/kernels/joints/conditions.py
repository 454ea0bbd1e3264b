"""Conditions of joints with axes, theory.md (4.13): products of directions that both nodes carry, and distances along one.

D_i are fixed in node a, D_j in node b, r = x_b - x_a. Each condition is a product of two vectors that are linear in the
coordinates, so that its derivative at the mean shape is the discrete gradient:

    D_i . D_j = 0       moment mu D_i,mean x D_j,mean on a, the opposite on b
    r . D_i = const     force mu D_i,mean on b, the opposite on a, moment mu D_i,mean x r_mean on a

Arrays: q, q_mid, q_end [12 N], in a plane [4 N]; blocks as `Work.blocks`; column, line as rows of `Contact.column` and
`Contact.line`.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import Plane, Space, add_cross, add_to, add_turn, cross_product, dim, position
from fastbeam.kernels.algebra.vectors import dot, ld2, ld3, perp
from fastbeam.kernels.beams.generalized_alpha import Alpha
from fastbeam.kernels.beams.planar_nodes import PlanarTies
from fastbeam.kernels.beams.ties import Ties
from fastbeam.kernels.contact.point_entries import begin_joint, forget_gaps, is_closed, take_forces
from fastbeam.kernels.contact.sleeve import SETTLED, add_double_cross
from fastbeam.kernels.entries.dense import entry_of, tied_arm
from fastbeam.kernels.jit.decorators import inlined, kernel
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.layout import ARM, POSITION
from fastbeam.kernels.terms import (
    Conserving,
    Equilibrium,
    Midpoint,
    NoTies,
    WithContact,
    assemble,
    first_guess,
    is_settled,
    take_unknowns,
)


class JointConditions(NamedTuple):
    """J sets of conditions between nodes a and b, P conditions in all."""

    node: np.ndarray       # int64 [J, 2]
    row: np.ndarray        # int64 [J, 2]
    spin_row: np.ndarray   # int64 [J, 2]: rows with the spins of the nodes
    block: np.ndarray      # int64 [J, 4]: blocks a-a, a-b, b-a, b-b
    start: np.ndarray      # int64 [J + 1]: range of a set among the conditions
    pair: np.ndarray       # int64 [P, 2]: (i, j), or (i, -1) for the distance along D_i
    value: np.ndarray      # float64 [P]: prescribed value of a product, m or 0
    axes: np.ndarray       # float64 [18 J]: R with D_i = sum_k R_ik d_k of a, then of b; in a plane [12 J], D_i = (a, b) stands
    #                        for a u + b J u
    first: np.ndarray      # int64 [1]: number of the first set among all constraints
    ties: Any              # ties.Ties, planar_nodes.PlanarTies or NoTies


JointConditions.reads = WithContact  # type: ignore[attr-defined]


@generic
def direction(dofs, joints, j, side, i, q):
    """Return D_i of node a (side 0) or b (1) of set j."""


@direction.register(Space)
@kernel
def direction_in_space(dofs, joints, j, side, i, q):
    r = 18 * j + 9 * side + 3 * i
    o = 12 * joints.node[j, side]
    return joints.axes[r] * ld3(q, o + 3, 1) + joints.axes[r + 1] * ld3(q, o + 6, 1) + joints.axes[r + 2] * ld3(q, o + 9, 1)


@direction.register(Plane)
@kernel
def direction_in_plane(dofs, joints, j, side, i, q):
    r = 12 * j + 6 * side + 2 * i
    u = ld2(q, 4 * joints.node[j, side] + 2, 1)
    return joints.axes[r] * u + joints.axes[r + 1] * perp(u)


@kernel
def put_spin(contact, k, p, row, column, line, dofs):
    """Add column and line of force p of constraint k on a spin."""
    o = entry_of(contact, k, row, dofs) + 8 * dim(dofs) + p
    add_to(contact.column[k], o, 8, column)
    add_to(contact.line[k], o, 8, line)


@kernel
def put_place(contact, k, p, row, column, line, dofs):
    """Add column and line of force p of constraint k on a position."""
    o = entry_of(contact, k, row, dofs) + p
    add_to(contact.column[k], o, 8, column)
    add_to(contact.line[k], o, 8, line)


@generic
def put_on_end(ties, joints, system, k, p, j, side, column, line):
    """Add column and line of force p of constraint k on the position of node `side` of set j; tied nodes pass them on."""


@put_on_end.register(NoTies)
@kernel
def put_on_free_end(ties, joints, system, k, p, j, side, column, line):
    put_place(system.contact, k, p, joints.row[j, side], column, line, system.dofs)


@put_on_end.register(Ties)
@put_on_end.register(PlanarTies)
@kernel
def put_on_tied_end(ties, joints, system, k, p, j, side, column, line):
    contact, work, dofs = system.contact, system.work, system.dofs
    node = joints.node[j, side]
    if ties.start[node + 1] == ties.start[node]:
        put_place(contact, k, p, joints.row[j, side], column, line, dofs)
    for t in range(ties.start[node], ties.start[node + 1]):
        if ties.kind[t] == POSITION:
            put_place(contact, k, p, ties.target_row[t], column, line, dofs)
        elif ties.kind[t] == ARM:
            put_spin(contact, k, p, ties.target_row[t], cross_product.call(tied_arm.call(ties, t, work.q_mid), column),
                     cross_product.call(tied_arm.call(ties, t, work.q_end), line), dofs)


@kernel
def turn_against(joints, system, j, i, other, force):
    """Add a force on the product D_i . D_other, moments on both nodes: residual and half its derivative by the end of the
    step."""
    dofs, q_mid, q_end = system.dofs, system.work.q_mid, system.work.q_end
    turn_both(joints, system, j, direction.call(dofs, joints, j, 0, i, q_mid), direction.call(dofs, joints, j, 1, other, q_mid),
              direction.call(dofs, joints, j, 0, i, q_end), direction.call(dofs, joints, j, 1, other, q_end), force)


@inlined
def turn_both(joints, system, j, a_mid, b_mid, a_end, b_end, force):
    """Add the same moments as `turn_against` for D_i = a and D_other = b, their means in the step and values at its end."""
    work, dofs = system.work, system.dofs
    d = dim(dofs)
    n = 8 * len(dofs)
    turning = cross_product.call(a_mid, b_mid)
    add_to(work.r, 8 * joints.row[j, 0] + d, 1, -force * turning)
    add_to(work.r, 8 * joints.row[j, 1] + d, 1, force * turning)
    o = 8 * d + d
    half = 0.5 * force
    add_double_cross.call(b_mid, a_end, -half, work.blocks, n * joints.block[j, 0] + o)
    add_double_cross.call(a_mid, b_end, half, work.blocks, n * joints.block[j, 1] + o)
    add_double_cross.call(b_mid, a_end, half, work.blocks, n * joints.block[j, 2] + o)
    add_double_cross.call(a_mid, b_end, -half, work.blocks, n * joints.block[j, 3] + o)


@kernel
def keep_direction(joints, system, share, j, k, p, i, other):
    """Add condition D_i . D_other = 0 as force p of constraint k."""
    dofs, q_mid, q_end, contact = system.dofs, system.work.q_mid, system.work.q_end, system.contact
    a_mid, b_mid = direction.call(dofs, joints, j, 0, i, q_mid), direction.call(dofs, joints, j, 1, other, q_mid)
    a_end, b_end = direction.call(dofs, joints, j, 0, i, q_end), direction.call(dofs, joints, j, 1, other, q_end)
    turn_both(joints, system, j, a_mid, b_mid, a_end, b_end, system.state.force[contact.first_force[k] + p])
    turning = cross_product.call(a_mid, b_mid)
    at_end = cross_product.call(a_end, b_end)
    contact.residual[k, p] = dot(a_end, b_end)
    put_spin(contact, k, p, joints.spin_row[j, 0], -share * turning, 1.0 * at_end, dofs)
    put_spin(contact, k, p, joints.spin_row[j, 1], share * turning, -1.0 * at_end, dofs)


@kernel
def push_along(joints, system, j, i, force):
    """Add a force on b along D_i of a, the opposite on a with its moment: residual and half its derivative by the end of the
    step."""
    work, dofs = system.work, system.dofs
    d = dim(dofs)
    n = 8 * len(dofs)
    mid = direction.call(dofs, joints, j, 0, i, work.q_mid)
    end = direction.call(dofs, joints, j, 0, i, work.q_end)
    r_mid = position(work.q_mid, joints.node[j, 1], dofs) - position(work.q_mid, joints.node[j, 0], dofs)
    add_to(work.r, 8 * joints.row[j, 1], 1, -force * mid)
    add_to(work.r, 8 * joints.row[j, 0], 1, force * mid)
    add_to(work.r, 8 * joints.row[j, 0] + d, 1, -force * cross_product.call(mid, r_mid))
    half = 0.5 * force
    # derivatives of the forces by the spin of a; of the moment by that spin, and by both positions
    add_turn(work.blocks, n * joints.block[j, 2] + d, -half, end)
    add_turn(work.blocks, n * joints.block[j, 0] + d, half, end)
    add_double_cross.call(r_mid, end, -half, work.blocks, n * joints.block[j, 0] + 8 * d + d)
    add_cross(work.blocks, n * joints.block[j, 1] + 8 * d, -half, mid)
    add_cross(work.blocks, n * joints.block[j, 0] + 8 * d, half, mid)


@kernel
def keep_distance(joints, system, share, j, k, p, i, value):
    """Add condition r . D_i = value as force p of constraint k."""
    work, dofs = system.work, system.dofs
    push_along(joints, system, j, i, system.state.force[system.contact.first_force[k] + p])
    mid = direction.call(dofs, joints, j, 0, i, work.q_mid)
    end = direction.call(dofs, joints, j, 0, i, work.q_end)
    r_mid = position(work.q_mid, joints.node[j, 1], dofs) - position(work.q_mid, joints.node[j, 0], dofs)
    r_end = position(work.q_end, joints.node[j, 1], dofs) - position(work.q_end, joints.node[j, 0], dofs)
    system.contact.residual[k, p] = dot(r_end, end) - value
    put_on_end.call(joints.ties, joints, system, k, p, j, 1, -share * mid, 1.0 * end)
    put_on_end.call(joints.ties, joints, system, k, p, j, 0, share * mid, -1.0 * end)
    put_spin(system.contact, k, p, joints.spin_row[j, 0], -share * cross_product.call(mid, r_mid), cross_product.call(end, r_end),
             dofs)


@kernel
def add_conditions(joints, system, share):
    """Add forces, gaps and entries; share: of the tangent that the node matrix holds."""
    for j in range(joints.node.shape[0]):
        k = joints.first[0] + j
        begin_joint(system.contact, k, joints.start[j + 1] - joints.start[j])
        for c in range(joints.start[j], joints.start[j + 1]):
            p = c - joints.start[j]
            if joints.pair[c, 1] < 0:
                keep_distance(joints, system, share, j, k, p, joints.pair[c, 0], joints.value[c])
            else:
                keep_direction(joints, system, share, j, k, p, joints.pair[c, 0], joints.pair[c, 1])


@assemble.register(JointConditions, Conserving)
@assemble.register(JointConditions, Equilibrium)
@assemble.register(JointConditions, Midpoint)
@kernel
def assemble_conditions(joints, method, system, h):
    add_conditions(joints, system, 1.0)


@assemble.register(JointConditions, Alpha)
@kernel
def assemble_conditions_at_end(joints, method, system, h):
    add_conditions(joints, system, 0.5)


@is_settled.register(JointConditions)
@kernel
def conditions_are_met(joints, system):
    """Return whether the gaps of all conditions are closed."""
    contact, q, dofs = system.contact, system.state.q, system.dofs
    closed = True
    for j in range(joints.node.shape[0]):
        allowed = SETTLED
        if joints.pair[joints.start[j], 1] < 0:
            reach = system.length
            for c in range(dim(dofs)):
                reach = max(reach, system.length + abs(q[(12 if dim(dofs) == 3 else 4) * joints.node[j, 0] + c]))
            allowed = 1e-15 * reach
        closed = is_closed(contact, joints.first[0] + j, allowed) and closed
    return closed


first_guess.register(JointConditions)(forget_gaps)
take_unknowns.register(JointConditions)(take_forces)
