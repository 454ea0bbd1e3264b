"""Ties between nodes in space: coordinates of tied nodes, and their rows, columns and blocks moved to their master nodes.

Arrays: q, q_mid, q_end, x_out [12 N]; dphi, theta, off_out [3 N]; r [8 (rows + 1)]; blocks [48 (blocks + 1)], blocks of 6 rows of
8; panel [rows, 6, width] flat; scratch [*].
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.cayley import director_increment
from fastbeam.kernels.algebra.vectors import (
    add3,
    add_iso,
    add_matrix,
    component0,
    component1,
    component2,
    cross,
    dot,
    ld3,
    outer,
    st3,
    zero3,
)
from fastbeam.kernels.beams.nodes import turn_of
from fastbeam.kernels.entries.dense import tied_arm
from fastbeam.kernels.jit.decorators import inlined, kernel
from fastbeam.kernels.layout import ARM, POSITION, TRIAD
from fastbeam.kernels.terms import apply_ties, pull_tied_columns, push_tied_columns, tie_increments

# columns of `moves`
SOURCE, ROW_ENTRY, COLUMN_ENTRY, TARGET = range(4)


class Ties(NamedTuple):
    """Slave nodes, whose coordinates are linear in those of master nodes (targets): rigid and ball connections.

    The position or the triad of slave k is the sum of its entries: POSITION, that of the target; ARM, an offset in the triad of
    the target; TRIAD, that of the target turned by a constant matrix.
    """

    slave: np.ndarray      # int64 [K]: node
    row: np.ndarray        # int64 [K]
    start: np.ndarray      # int64 [N + 1]: entries of every node; none for a free node
    target: np.ndarray     # int64 [M]: node
    target_row: np.ndarray  # int64 [M]
    diagonal: np.ndarray   # int64 [M]: diagonal block of the target
    kind: np.ndarray       # int64 [M]: POSITION, ARM or TRIAD
    offset: np.ndarray     # float64 [3 M]
    rotation: np.ndarray   # float64 [9 M]: d_i = sum_j R_ij d_j of the target
    moves: np.ndarray      # int64 [P, 4]: block, entry of its row or -1, entry of its column or -1, block it adds to (ascending)


@kernel
def tie_coordinates(ties, x_out):
    """Set coordinates, or their rates, of the tied nodes from those of their masters; linear, so one function serves both."""
    for k in range(ties.slave.shape[0]):
        i = ties.slave[k]
        e0 = ties.start[i]
        e1 = ties.start[i + 1]
        for e in range(e0, e1):
            t = 12 * ties.target[e]
            if ties.kind[e] == TRIAD and ties.target[e] != i:
                for a in range(3):
                    x = zero3()
                    for b in range(3):
                        x += ties.rotation[9 * e + 3 * a + b] * ld3(x_out, t + 3 + 3 * b, 1)
                    st3(x_out, 12 * i + 3 + 3 * a, 1, x)
        x = zero3()
        for e in range(e0, e1):
            t = 12 * ties.target[e]
            if ties.kind[e] == POSITION:
                x += ld3(x_out, t, 1)
            elif ties.kind[e] == ARM:
                for b in range(3):
                    x += ties.offset[3 * e + b] * ld3(x_out, t + 3 + 3 * b, 1)
        st3(x_out, 12 * i, 1, x)


@tie_increments.register(Ties)
@kernel
def tie_increments_in_space(ties, q, theta, dphi, off_out):
    for k in range(ties.slave.shape[0]):
        i = ties.slave[k]
        x = zero3()
        for e in range(ties.start[i], ties.start[i + 1]):
            t = ties.target[e]
            if ties.kind[e] == TRIAD:
                st3(theta, 3 * i, 1, ld3(theta, 3 * t, 1))
            elif ties.kind[e] == POSITION:
                x += ld3(dphi, 3 * t, 1)
            else:
                turn, c = turn_of(theta, t)
                for b in range(3):
                    x += ties.offset[3 * e + b] * director_increment(c, turn, ld3(q, 12 * t + 3 + 3 * b, 1))
        st3(off_out, 3 * i, 1, x - ld3(dphi, 3 * i, 1))
        st3(dphi, 3 * i, 1, x)


@tied_arm.register(Ties)
@kernel
def tie_arm(ties, e, q):
    """Return the offset of an entry of kind ARM in space."""
    t = 12 * ties.target[e]
    x = zero3()
    for b in range(3):
        x += ties.offset[3 * e + b] * ld3(q, t + 3 + 3 * b, 1)
    return x


@apply_ties.register(Ties)
@kernel
def apply_ties_in_space(ties, k0, k1, p0, p1, q_mid, q_end, r, blocks, scratch):
    for k in range(k0, k1):
        i = ties.slave[k]
        o = 8 * ties.row[k]
        f = ld3(r, o, 1)
        m = ld3(r, o + 3, 1)
        st3(r, o, 1, zero3())
        st3(r, o + 3, 1, zero3())
        for e in range(ties.start[i], ties.start[i + 1]):
            t = 8 * ties.target_row[e]
            if ties.kind[e] == POSITION:
                add3(r, t, 1, f)
            elif ties.kind[e] == ARM:
                add3(r, t + 3, 1, cross(tie_arm(ties, e, q_mid), f))
                d = tie_arm(ties, e, q_end)
                add_matrix(blocks, 48 * ties.diagonal[e] + 27, 8, 1, 0.5 * add_iso(outer(d, f), -dot(d, f)))
            else:
                add3(r, t + 3, 1, m)
    for p in range(p0, p1):
        for rows in range(2):
            if follows(ties, ties.moves[p, ROW_ENTRY], rows):
                for columns in range(2):
                    if follows(ties, ties.moves[p, COLUMN_ENTRY], columns):
                        move_part(ties, p, rows, columns, q_mid, q_end, blocks)


@inlined
def follows(ties, e, part):
    """Return whether the position (part 0) or the spin (1) of a tied node depends on its master by entry e; -1: the node is not
    tied."""
    return e < 0 or (ties.kind[e] == TRIAD) == (part == 1)


@inlined
def move_part(ties, p, rows, columns, q_mid, q_end, blocks):
    """Add L_a^T K L_b to the block of the masters, for the rows and columns of K on a position (0) or spin (1)."""
    e, f = ties.moves[p, ROW_ENTRY], ties.moves[p, COLUMN_ENTRY]
    o = 48 * ties.moves[p, SOURCE] + 24 * rows + 3 * columns
    x, y, z = ld3(blocks, o, 1), ld3(blocks, o + 8, 1), ld3(blocks, o + 16, 1)
    if dot(x, x) + dot(y, y) + dot(z, z) == 0.0:
        return
    if f >= 0 and ties.kind[f] == ARM:
        arm = tie_arm(ties, f, q_end)
        x, y, z, columns = cross(arm, x), cross(arm, y), cross(arm, z), 1
    if e >= 0 and ties.kind[e] == ARM:
        arm = tie_arm(ties, e, q_mid)
        u, v, w = component0(arm), component1(arm), component2(arm)
        x, y, z, rows = v * z - w * y, w * x - u * z, u * y - v * x, 1
    o = 48 * ties.moves[p, TARGET] + 24 * rows + 3 * columns
    add3(blocks, o, 1, x)
    add3(blocks, o + 8, 1, y)
    add3(blocks, o + 16, 1, z)


@pull_tied_columns.register(Ties)
@kernel
def pull_columns_in_space(ties, q_mid, panel, width):
    for k in range(ties.slave.shape[0]):
        i = ties.slave[k]
        o = 6 * width * ties.row[k]
        for c in range(1, width):
            f = ld3(panel, o + c, width)
            m = ld3(panel, o + 3 * width + c, width)
            for e in range(ties.start[i], ties.start[i + 1]):
                t = 6 * width * ties.target_row[e] + c
                if ties.kind[e] == POSITION:
                    st3(panel, o + c, width, 0.0 * f)
                    st3(panel, t, width, ld3(panel, t, width) + f)
                elif ties.kind[e] == ARM:
                    st3(panel, t + 3 * width, width, ld3(panel, t + 3 * width, width) + cross(tie_arm(ties, e, q_mid), f))
                elif ties.target[e] != i:
                    st3(panel, o + 3 * width + c, width, 0.0 * m)
                    st3(panel, t + 3 * width, width, ld3(panel, t + 3 * width, width) + m)


@push_tied_columns.register(Ties)
@kernel
def push_columns_in_space(ties, q_end, panel, pitch, width, columns):
    for k in range(ties.slave.shape[0]):
        i = ties.slave[k]
        o = pitch * ties.row[k]
        for c in range(columns):
            for e in range(ties.start[i], ties.start[i + 1]):
                t = pitch * ties.target_row[e] + c
                if ties.kind[e] == TRIAD and ties.target[e] != i:
                    st3(panel, o + 3 * width + c, width, ld3(panel, t + 3 * width, width))
            x = ld3(panel, o + c, width)
            x = x - x
            for e in range(ties.start[i], ties.start[i + 1]):
                t = pitch * ties.target_row[e] + c
                if ties.kind[e] == POSITION:
                    x += ld3(panel, t, width)
                elif ties.kind[e] == ARM:
                    x -= cross(tie_arm(ties, e, q_end), ld3(panel, t + 3 * width, width))
            st3(panel, o + c, width, x)
