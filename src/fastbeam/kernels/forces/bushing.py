"""Bushings: elastic connections of two points with triads, theory.md (4.21) to (4.23).

D_i are the axes that node a carries, E_j those of b, equal at t = 0, r = x_b - x_a. The energy depends on products of two vectors
that are linear in the coordinates,

    u_i = r . D_i - const,   c_ij = D_i . E_j,   w = 1/2 sum_ijk e_ijk c_kj (the sine of the angle times the axis),
    U = 1/2 u.K u + u.C w + sum_ij G_ij (delta_ij - c_ij),   G = 1/2 tr(M) I - M,

K, C and M the blocks of the stiffness. Means of u and w over the step and the products at the mean shape make the discrete
gradient. A damper adds B Du/h to the forces of u, and to those of c the matrix P Dc/h, P made of its own M as G.

Arrays: q, q0 [12 N], in a plane [4 N]; out [1].
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import (
    add_cross,
    add_outer,
    add_to,
    add_turn,
    cross_product,
    dim,
    position,
    zero_spin,
    zero_vector,
)
from fastbeam.kernels.algebra.vectors import dot
from fastbeam.kernels.contact.sleeve import add_double_cross
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.joints.conditions import direction
from fastbeam.kernels.terms import Conserving, Equilibrium, account, assemble, potential_energy, spread_nodes


class Bushings(NamedTuple):
    """L bushings between nodes a and b."""

    node: np.ndarray       # int64 [L, 2]
    row: np.ndarray        # int64 [L, 2]
    block: np.ndarray      # int64 [L, 4]: a-a, a-b, b-a, b-b
    axes: np.ndarray       # float64 [18 L], in a plane [12 L]: as in `JointConditions`
    start: np.ndarray      # float64 [3 L]: r . D_i at t = 0, m
    stiffness: np.ndarray  # float64 [36 L]: K, C; C^T, M
    tilt: np.ndarray       # float64 [9 L]: G
    viscosity: np.ndarray  # float64 [9 L]: B
    drag: np.ndarray       # float64 [9 L]: P
    parts: np.ndarray      # int64 [L, 2]: 1 where C, and where P are not zero
    place: np.ndarray      # int64 [L]: offset of the loss in the history, -1: no damping


@kernel
def arm(link, k, q, dofs):
    """Return r of bushing k."""
    return position(q, link.node[k, 1], dofs) - position(q, link.node[k, 0], dofs)


@kernel
def shift(link, k, i, q, dofs):
    """Return u_i."""
    return dot(arm(link, k, q, dofs), direction.call(dofs, link, k, 0, i, q)) - link.start[3 * k + i]


@kernel
def product(link, k, i, j, q, dofs):
    """Return c_ij, in a plane without the part of the normal."""
    return dot(direction.call(dofs, link, k, 0, i, q), direction.call(dofs, link, k, 1, j, q))


@kernel
def sine(link, k, i, q, dofs):
    """Return w_i."""
    j, l = (i + 1) % 3, (i + 2) % 3
    return 0.5 * (product(link, k, l, j, q, dofs) - product(link, k, j, l, q, dofs))


@kernel
def turning(link, k, i, j, q, dofs):
    """Return D_i x E_j: derivative of c_ij by the spin of a, and with a minus by that of b."""
    return cross_product.call(direction.call(dofs, link, k, 0, i, q), direction.call(dofs, link, k, 1, j, q))


@kernel
def turning_of_sine(link, k, i, q, dofs):
    """Return the derivative of w_i by the spin of a, and with a minus by that of b."""
    j, l = (i + 1) % 3, (i + 2) % 3
    return 0.5 * (turning(link, k, l, j, q, dofs) - turning(link, k, j, l, q, dofs))


# --- forces of products -------------------------------------------------------------------------------------------------
@kernel
def force_of_shift(link, k, i, system, over_h):
    """Return the mean force of u_i over the step."""
    q0, q1, dofs = system.state.q, system.work.q_end, system.dofs
    force = 0.0
    for j in range(3):
        before, after = shift(link, k, j, q0, dofs), shift(link, k, j, q1, dofs)
        force += link.stiffness[36 * k + 6 * i + j] * 0.5 * (before + after)
        force += link.viscosity[9 * k + 3 * i + j] * over_h * (after - before)
        if link.parts[k, 0]:
            force += link.stiffness[36 * k + 6 * i + 3 + j] * 0.5 * (sine(link, k, j, q0, dofs) + sine(link, k, j, q1, dofs))
    return force


@kernel
def moment_of_sine(link, k, i, system):
    """Return the mean moment of w_i over the step: that of the displacements."""
    q0, q1, dofs = system.state.q, system.work.q_end, system.dofs
    moment = 0.0
    for j in range(3):
        moment += link.stiffness[36 * k + 6 * j + 3 + i] * 0.5 * (shift(link, k, j, q0, dofs) + shift(link, k, j, q1, dofs))
    return moment


@kernel
def moment_of_product(link, k, i, j, system, over_h):
    """Return the mean moment of c_ij over the step."""
    q0, q1, dofs = system.state.q, system.work.q_end, system.dofs
    moment = -link.tilt[9 * k + 3 * i + j]
    if link.parts[k, 1]:
        for l in range(3):
            change = product(link, k, l, j, q1, dofs) - product(link, k, l, j, q0, dofs)
            moment += link.drag[9 * k + 3 * i + l] * over_h * change
    if link.parts[k, 0] and i != j:
        # w_m holds c_ij with a plus where (j, i, m) is a rotation of (1, 2, 3)
        m = 3 - i - j
        moment += (0.5 if (j + 1) % 3 == i else -0.5) * moment_of_sine(link, k, m, system)
    return moment


# --- residual and tangent -----------------------------------------------------------------------------------------------
@kernel
def pull(link, k, system, mid, end):
    """Add the force `mid` on b and its opposite on a with its moment, and half their derivative by the end of the step, as far as
    the direction, `end` there, and the arm turn."""
    work, dofs = system.work, system.dofs
    d = dim(dofs)
    n = 8 * len(dofs)
    r = arm(link, k, work.q_mid, dofs)
    add_to(work.r, 8 * link.row[k, 1], 1, mid)
    add_to(work.r, 8 * link.row[k, 0], 1, -1.0 * mid)
    add_to(work.r, 8 * link.row[k, 0] + d, 1, cross_product.call(mid, r))
    add_turn(work.blocks, n * link.block[k, 2] + d, 0.5, end)
    add_turn(work.blocks, n * link.block[k, 0] + d, -0.5, end)
    add_double_cross.call(r, end, 0.5, work.blocks, n * link.block[k, 0] + 8 * d + d)
    add_cross(work.blocks, n * link.block[k, 1] + 8 * d, 0.5, mid)
    add_cross(work.blocks, n * link.block[k, 0] + 8 * d, -0.5, mid)


@kernel
def twist(link, k, j, system, mid, end):
    """Add the moment mid x E_j on a and its opposite on b, and half their derivative by the end of the step; mid, end: a
    direction fixed to a."""
    work, dofs = system.work, system.dofs
    d = dim(dofs)
    n = 8 * len(dofs)
    o = 8 * d + d
    other_mid = direction.call(dofs, link, k, 1, j, work.q_mid)
    other_end = direction.call(dofs, link, k, 1, j, work.q_end)
    moment = cross_product.call(mid, other_mid)
    add_to(work.r, 8 * link.row[k, 0] + d, 1, moment)
    add_to(work.r, 8 * link.row[k, 1] + d, 1, -1.0 * moment)
    add_double_cross.call(other_mid, end, 0.5, work.blocks, n * link.block[k, 0] + o)
    add_double_cross.call(mid, other_end, -0.5, work.blocks, n * link.block[k, 1] + o)
    add_double_cross.call(other_mid, end, -0.5, work.blocks, n * link.block[k, 2] + o)
    add_double_cross.call(mid, other_end, 0.5, work.blocks, n * link.block[k, 3] + o)


@kernel
def add_dyad(link, k, system, force, moment, lead, turn):
    """Add derivatives of forces: b gets `force`, a its opposite with the moment force x r, and besides them a gets `moment` and b
    its opposite, times the change of a product with the derivatives lead, lead x r and turn in the same places."""
    work, dofs = system.work, system.dofs
    d = dim(dofs)
    n = 8 * len(dofs)
    on_a = moment + cross_product.call(force, arm(link, k, work.q_mid, dofs))
    by_a = turn + cross_product.call(lead, arm(link, k, work.q_end, dofs))
    for e in range(4):
        o = n * link.block[k, e]
        s = 1.0 if e >= 2 else -1.0
        t = 1.0 if e % 2 == 1 else -1.0
        add_outer(work.blocks, o, s * t, force, lead)
        if e % 2 == 0:
            add_outer(work.blocks, o + d, s, force, by_a)
        else:
            add_outer(work.blocks, o + d, -s, force, turn)
        if e < 2:
            add_outer(work.blocks, o + 8 * d, t, on_a, lead)
            if e == 0:
                add_outer(work.blocks, o + 8 * d + d, 1.0, on_a, by_a)
            else:
                add_outer(work.blocks, o + 8 * d + d, -1.0, on_a, turn)
        else:
            add_outer(work.blocks, o + 8 * d, -t, moment, lead)
            if e == 2:
                add_outer(work.blocks, o + 8 * d + d, -1.0, moment, by_a)
            else:
                add_outer(work.blocks, o + 8 * d + d, 1.0, moment, turn)


@kernel
def stiffen_shifts(link, k, system, over_h):
    """Add derivatives by u_j at the end."""
    work, dofs = system.work, system.dofs
    for j in range(3):
        force = zero_vector(dofs)
        moment = zero_spin(dofs)
        for i in range(3):
            factor = 0.5 * link.stiffness[36 * k + 6 * i + j] + link.viscosity[9 * k + 3 * i + j] * over_h
            force += factor * direction.call(dofs, link, k, 0, i, work.q_mid)
            if link.parts[k, 0]:
                moment += (0.5 * link.stiffness[36 * k + 6 * j + 3 + i]) * turning_of_sine(link, k, i, work.q_mid, dofs)
        add_dyad(link, k, system, force, moment, direction.call(dofs, link, k, 0, j, work.q_end), zero_spin(dofs))


@kernel
def stiffen_sines(link, k, system):
    """Add derivatives by w_j at the end."""
    work, dofs = system.work, system.dofs
    for j in range(3):
        force = zero_vector(dofs)
        for i in range(3):
            force += (0.5 * link.stiffness[36 * k + 6 * i + 3 + j]) * direction.call(dofs, link, k, 0, i, work.q_mid)
        add_dyad(link, k, system, force, zero_spin(dofs), zero_vector(dofs), turning_of_sine(link, k, j, work.q_end, dofs))


@kernel
def stiffen_products(link, k, system, over_h):
    """Add derivatives by c_lj at the end."""
    work, dofs = system.work, system.dofs
    d = dim(dofs)
    for j in range(3):
        for l in range(3):
            moment = zero_spin(dofs)
            for i in range(3):
                moment += (link.drag[9 * k + 3 * i + l] * over_h) * turning(link, k, i, j, work.q_mid, dofs)
            turn = turning(link, k, l, j, work.q_end, dofs)
            for e in range(4):
                sign = 1.0 if e == 0 or e == 3 else -1.0
                add_outer(work.blocks, 8 * len(dofs) * link.block[k, e] + 8 * d + d, sign, moment, turn)


@kernel
def add_bushings(link, system, over_h):
    work, dofs = system.work, system.dofs
    for k in range(link.row.shape[0]):
        mid, end = zero_vector(dofs), zero_vector(dofs)
        for i in range(3):
            force = force_of_shift(link, k, i, system, over_h)
            mid += force * direction.call(dofs, link, k, 0, i, work.q_mid)
            end += force * direction.call(dofs, link, k, 0, i, work.q_end)
        pull(link, k, system, mid, end)
        for j in range(3):
            mid, end = zero_vector(dofs), zero_vector(dofs)
            for i in range(3):
                moment = moment_of_product(link, k, i, j, system, over_h)
                mid += moment * direction.call(dofs, link, k, 0, i, work.q_mid)
                end += moment * direction.call(dofs, link, k, 0, i, work.q_end)
            twist(link, k, j, system, mid, end)
        stiffen_shifts(link, k, system, over_h)
        if link.parts[k, 0]:
            stiffen_sines(link, k, system)
        if link.parts[k, 1] and over_h != 0.0:
            stiffen_products(link, k, system, over_h)


@assemble.register(Bushings, Conserving)
@kernel
def assemble_bushings(link, method, system, h):
    add_bushings(link, system, 1.0 / h)


@assemble.register(Bushings, Equilibrium)
@kernel
def assemble_bushings_at_rest(link, method, system, h):
    """Add the bushings of an equilibrium: the middle and both ends of a step are the present shape."""
    add_bushings(link, system, 0.0)


@account.register(Bushings)
@kernel
def account_bushings(link, system, h):
    """Record the loss by dampers."""
    state, work, dofs = system.state, system.work, system.dofs
    for k in range(link.row.shape[0]):
        if link.place[k] >= 0:
            for side in range(2):
                # update the nodes to the last increment
                node = link.node[k, side]
                spread_nodes.call(dofs, system.method, state, work, h, node, node + 1)
            loss = 0.0
            for i in range(3):
                for j in range(3):
                    du = shift(link, k, i, work.q_end, dofs) - shift(link, k, i, state.q, dofs)
                    dv = shift(link, k, j, work.q_end, dofs) - shift(link, k, j, state.q, dofs)
                    loss += link.viscosity[9 * k + 3 * i + j] * du * dv
                    for l in range(3):
                        dc = product(link, k, i, l, work.q_end, dofs) - product(link, k, i, l, state.q, dofs)
                        de = product(link, k, j, l, work.q_end, dofs) - product(link, k, j, l, state.q, dofs)
                        loss += link.drag[9 * k + 3 * i + j] * dc * de
            state.history[link.place[k]] += loss / h


@potential_energy.register(Bushings)
@kernel
def energy_of_bushings(link, q, dofs, out):
    """Add the energy; the sum over c_ij is w.M w/(1 + cos), which keeps its digits for small angles."""
    for k in range(link.row.shape[0]):
        # in a plane the normal has its part in the trace
        trace = 3.0 - dim(dofs)
        turned = 0.0
        linear = 0.0
        energy = 0.0
        for i in range(3):
            trace += product(link, k, i, i, q, dofs)
            for j in range(3):
                s = 36 * k + 6 * i
                v = shift(link, k, i, q, dofs)
                energy += link.stiffness[s + j] * 0.5 * v * shift(link, k, j, q, dofs)
                energy += link.stiffness[s + 3 + j] * v * sine(link, k, j, q, dofs)
                turned += link.stiffness[s + 21 + j] * sine(link, k, i, q, dofs) * sine(link, k, j, q, dofs)
                own = dot(direction.call(dofs, link, k, 0, i, q), direction.call(dofs, link, k, 0, j, q))
                linear += link.tilt[9 * k + 3 * i + j] * (own - product(link, k, i, j, q, dofs))
        cosine = 0.5 * (trace - 1.0)
        out[0] += energy + (turned / (1.0 + cosine) if cosine > 0.0 else linear)
