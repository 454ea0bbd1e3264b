"""Node loops in a plane: 4 coordinates a node, position and director u; a turn is one number, its Cayley number theta.

Arrays: q, v, u, q_mid, q_end, q_mid_out, q_end_out, u_out [4 N]; dphi, off_out [2 N]; theta [N]; row_of, spinless, held_theta
[N]; x, r, r_out [8 (rows + 1)]; blocks, blocks_out [24 (blocks + 1)], blocks of 3 rows of 8; panel [rows, 3, width] flat; past
[*] as in `nodes.remember`; scratch [*].
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.cayley import planar_turn
from fastbeam.kernels.algebra.dimensions import Plane
from fastbeam.kernels.algebra.vectors import add2, cross2, dot, ld2, perp, st2, zero2
from fastbeam.kernels.beams.nodes import NO_VELOCITIES, NoVelocities, is_zero, predict_from
from fastbeam.kernels.beams.ties import COLUMN_ENTRY, ROW_ENTRY, SOURCE, TARGET
from fastbeam.kernels.entries.dense import tied_arm
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.layout import ARM, POSITION, TRIAD
from fastbeam.kernels.terms import (
    Conserving,
    Equilibrium,
    advance_nodes,
    apply_ties,
    assemble,
    move_nodes,
    predict_nodes,
    pull_tied_columns,
    push_tied_columns,
    spread_nodes,
    tie_increments,
)


class PlanarBodies(NamedTuple):
    """Nodes with an inertia of their own."""

    node: np.ndarray     # int64 [B]
    row: np.ndarray      # int64 [B]
    block: np.ndarray    # int64 [B]: diagonal block
    inertia: np.ndarray  # float64 [2 B]: mass, moment of inertia about the normal


class PlanarTies(NamedTuple):
    """Tied nodes; entries as in `ties.Ties`, with offsets and rotations as complex numbers: (a, b) stands for a u + b J u of the
    master."""

    slave: np.ndarray      # int64 [K]: node
    row: np.ndarray        # int64 [K]
    start: np.ndarray      # int64 [N + 1]: entries of every node; none for a free node
    target: np.ndarray     # int64 [M]: node
    target_row: np.ndarray  # int64 [M]
    diagonal: np.ndarray   # int64 [M]: diagonal block of the target
    kind: np.ndarray       # int64 [M]: POSITION, ARM or TRIAD
    factor: np.ndarray     # float64 [2 M]: offset of an ARM or rotation of a TRIAD
    moves: np.ndarray      # int64 [P, 4]: block, entry of its row or -1, entry of its column or -1, block it adds to (ascending)


@kernel
def planar_predict(q, v, h, c, past, held_theta, first, last, theta, dphi):
    """Predict a step in a plane, as `nodes.predict`."""
    if c == c:
        share = 1.0 / past[3] if past[3] != 0.0 else 0.0
        turns = past.shape[0] - 1 - theta.shape[0]
        predict_from(past, turns - dphi.shape[0], share, c, h, 2 * first, 2 * last, dphi)
        predict_from(past, turns, share, c, h, first, last, theta)
    else:
        for i in range(first, last):
            st2(dphi, 2 * i, 1, h * ld2(v, 4 * i, 1))
            theta[i] = 0.0 if held_theta[i] else h * cross2(ld2(q, 4 * i + 2, 1), ld2(v, 4 * i + 2, 1))


@kernel
def planar_spread(q, v, dphi, theta, h, first, last, q_mid_out, q_end_out, u_out):
    """Form mid and end coordinates and second rates in a plane, as `nodes.spread`."""
    for i in range(first, min(last, q_mid_out.shape[0] // 4)):
        for k in range(4 * i, 4 * i + 4, 2):
            x = ld2(q, k, 1)
            move = planar_turn(theta[i], x) if k > 4 * i else ld2(dphi, 2 * i, 1)
            st2(q_mid_out, k, 1, x + 0.5 * move)
            st2(q_end_out, k, 1, x + move)
            if k < u_out.shape[0]:
                st2(u_out, k, 1, (2.0 / (h * h)) * (move - h * ld2(v, k, 1)))


@kernel
def planar_update(row_of, x, first, last, theta, dphi):
    """Add rows of increments in a plane, as `nodes.update_nodes`."""
    largest = 0.0
    spin = 0.0
    for i in range(first, last):
        o = 8 * row_of[i]
        add2(dphi, 2 * i, 1, ld2(x, o, 1))
        for c in range(2):
            z = x[o + c]
            if abs(z) > largest or z != z:  # NaN counts as larger than any number
                largest = abs(z)
        t = 1.0 + 0.25 * theta[i] * theta[i]
        p = t * x[o + 2]
        theta[i] += p
        z = abs(p) / np.sqrt(t)
        if z > spin or z != z:
            spin = z
    return largest, spin


@generic
def follow_velocity(v, k, move, h):
    """Update the rate of a vector after its increment."""


@follow_velocity.register(NoVelocities)
@kernel
def follow_no_velocity(v, k, move, h):
    pass


@follow_velocity.register(object)
@kernel
def follow_planar_velocity(v, k, move, h):
    velocity = ld2(v, k, 1)
    st2(v, k, 1, velocity + (2.0 / h) * (move - h * velocity))


@kernel
def planar_advance(q, v, dphi, theta, h, first, last, scratch):
    """Accept increments in a plane, as `nodes.advance`; scratch is not used."""
    for i in range(first, last):
        for k in range(4 * i, 4 * i + 4, 2):
            x = ld2(q, k, 1)
            move = planar_turn(theta[i], x) if k > 4 * i else ld2(dphi, 2 * i, 1)
            st2(q, k, 1, x + move)
            follow_velocity.call(v, k, move, h)


@kernel
def add_planar_bodies(bodies, q_mid, q_end, u, mass_factor, r_out, blocks_out):
    """Add the inertia of point masses and rigid bodies; mass_factor: 2/h^2."""
    for k in range(bodies.node.shape[0]):
        q = 4 * bodies.node[k]
        ro = 8 * bodies.row[k]
        ko = 24 * bodies.block[k]
        m = bodies.inertia[2 * k]
        j = bodies.inertia[2 * k + 1]
        f = j * ld2(u, q + 2, 1)
        x = ld2(q_mid, q + 2, 1)
        y = ld2(q_end, q + 2, 1)
        add2(r_out, ro, 1, m * ld2(u, q, 1))
        r_out[ro + 2] += cross2(x, f)
        blocks_out[ko] += mass_factor * m
        blocks_out[ko + 9] += mass_factor * m
        blocks_out[ko + 18] += mass_factor * j * dot(x, y) - 0.5 * dot(y, f)


@kernel
def turned(ties, e, u):
    """Return a u + b J u of an entry."""
    return ties.factor[2 * e] * u + ties.factor[2 * e + 1] * perp(u)


@tied_arm.register(PlanarTies)
@kernel
def planar_arm(ties, e, q):
    """Return the offset of an ARM."""
    return turned(ties, e, ld2(q, 4 * ties.target[e] + 2, 1))


@tie_increments.register(PlanarTies)
@kernel
def tie_increments_in_plane(ties, q, theta, dphi, off_out):
    for k in range(ties.slave.shape[0]):
        i = ties.slave[k]
        x = zero2()
        for e in range(ties.start[i], ties.start[i + 1]):
            t = ties.target[e]
            if ties.kind[e] == TRIAD:
                theta[i] = theta[t]
            elif ties.kind[e] == POSITION:
                x += ld2(dphi, 2 * t, 1)
            else:
                x += turned(ties, e, planar_turn(theta[t], ld2(q, 4 * t + 2, 1)))
        st2(off_out, 2 * i, 1, x - ld2(dphi, 2 * i, 1))
        st2(dphi, 2 * i, 1, x)


@apply_ties.register(PlanarTies)
@kernel
def apply_ties_in_plane(ties, k0, k1, p0, p1, q_mid, q_end, r, blocks, scratch):
    for k in range(k0, k1):
        i = ties.slave[k]
        o = 8 * ties.row[k]
        f = ld2(r, o, 1)
        m = r[o + 2]
        for c in range(3):
            r[o + c] = 0.0
        for e in range(ties.start[i], ties.start[i + 1]):
            t = 8 * ties.target_row[e]
            if ties.kind[e] == POSITION:
                add2(r, t, 1, f)
            elif ties.kind[e] == ARM:
                r[t + 2] += cross2(planar_arm(ties, e, q_mid), f)
                blocks[24 * ties.diagonal[e] + 18] -= 0.5 * dot(planar_arm(ties, e, q_end), f)
            else:
                r[t + 2] += m
    for p in range(p0, p1):
        source = 24 * ties.moves[p, SOURCE]
        if is_zero(blocks, source, 3):
            continue
        ea = ties.moves[p, ROW_ENTRY]
        eb = ties.moves[p, COLUMN_ENTRY]
        to = 24 * ties.moves[p, TARGET]
        # columns: scratch = K L_b
        for i in range(3):
            s = source + 8 * i
            o = 8 * i
            for j in range(3):
                scratch[o + j] = 0.0
            if eb < 0:
                for j in range(3):
                    scratch[o + j] = blocks[s + j]
            elif ties.kind[eb] == POSITION:
                st2(scratch, o, 1, ld2(blocks, s, 1))
            elif ties.kind[eb] == ARM:
                scratch[o + 2] = cross2(planar_arm(ties, eb, q_end), ld2(blocks, s, 1))
            else:
                scratch[o + 2] = blocks[s + 2]
        # rows: add L_a^T scratch
        for j in range(3):
            if ea < 0:
                for i in range(3):
                    blocks[to + 8 * i + j] += scratch[8 * i + j]
            elif ties.kind[ea] == POSITION:
                add2(blocks, to + j, 8, ld2(scratch, j, 8))
            elif ties.kind[ea] == ARM:
                blocks[to + 16 + j] += cross2(planar_arm(ties, ea, q_mid), ld2(scratch, j, 8))
            else:
                blocks[to + 16 + j] += scratch[16 + j]


@pull_tied_columns.register(PlanarTies)
@kernel
def pull_columns_in_plane(ties, q_mid, panel, width):
    for k in range(ties.slave.shape[0]):
        i = ties.slave[k]
        o = 3 * width * ties.row[k]
        for c in range(1, width):
            f = ld2(panel, o + c, width)
            m = panel[o + 2 * width + c]
            for e in range(ties.start[i], ties.start[i + 1]):
                t = 3 * width * ties.target_row[e] + c
                if ties.kind[e] == POSITION:
                    st2(panel, o + c, width, 0.0 * f)
                    st2(panel, t, width, ld2(panel, t, width) + f)
                elif ties.kind[e] == ARM:
                    panel[t + 2 * width] += cross2(planar_arm(ties, e, q_mid), f)
                elif ties.target[e] != i:
                    panel[o + 2 * width + c] = 0.0
                    panel[t + 2 * width] += m


@push_tied_columns.register(PlanarTies)
@kernel
def push_columns_in_plane(ties, q_end, panel, pitch, width, columns):
    for k in range(ties.slave.shape[0]):
        i = ties.slave[k]
        o = pitch * ties.row[k]
        for c in range(columns):
            x = zero2()
            for e in range(ties.start[i], ties.start[i + 1]):
                t = pitch * ties.target_row[e] + c
                if ties.kind[e] == POSITION:
                    x += ld2(panel, t, width)
                elif ties.kind[e] == ARM:
                    x += panel[t + 2 * width] * perp(planar_arm(ties, e, q_end))
                elif ties.target[e] != i:
                    panel[o + 2 * width + c] = panel[t + 2 * width]
            st2(panel, o + c, width, x)


# --- as parts of a step -------------------------------------------------------------------------------------------------
@predict_nodes.register(Plane)
@kernel
def predict_in_plane(dofs, state, work, spinless, h, c, first, last):
    planar_predict(state.q, state.v, h, c, work.past, spinless, first, last, work.theta, work.dphi)


@spread_nodes.register(Plane, Conserving)
@kernel
def spread_in_plane(dofs, method, state, work, h, first, last):
    planar_spread(state.q, state.v, work.dphi, work.theta, h, first, last, work.q_mid, work.q_end, work.u)


@move_nodes.register(Plane)
@kernel
def move_in_plane(dofs, row_of, work, first, last, scratch):
    return planar_update(row_of, work.increment.x, first, last, work.theta, work.dphi)


@advance_nodes.register(Plane)
@kernel
def advance_in_plane(dofs, method, state, work, h, first, last, scratch):
    planar_advance(state.q, state.v, work.dphi, work.theta, h, first, last, scratch)


@advance_nodes.register(Plane, Equilibrium)
@kernel
def move_in_plane_at_rest(dofs, method, state, work, h, first, last, scratch):
    planar_advance(state.q, NO_VELOCITIES, work.dphi, work.theta, 0.0, first, last, scratch)


@assemble.register(PlanarBodies, Conserving)
@kernel
def assemble_planar_bodies(bodies, method, system, h):
    work = system.work
    add_planar_bodies(bodies, work.q_mid, work.q_end, work.u, 2.0 / (h * h), work.r, work.blocks)
