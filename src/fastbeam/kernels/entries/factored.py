"""Factored entries of sliders: the few numbers of an entry take a twelfth of the memory of its blocks, which are formed where
they are needed. With w the weights of a node, s the slide of the frame and t the share of its theta in the sliding equation,
columns and lines against F, s, g_mean are

    position        [w.mean I, w.slope F, 0]                             [-w.end I, w.along s, w.mean/2 I]
    spin            [w.mean g_mean^, w.slope g_mean x F, -w.mean F^]     [0, t, 0]
    on an arm a     [w.mean a^, w.slope a x F, 0]                        [-w.end a^, a x w.along s, w.mean/2 a^]

with a in the middle of the step in the columns, at its end in the lines.

Arrays: out [*], blocks of rows of 8 numbers, of `add_factored_product` numbers; y [7 S], unknowns of all constraints; of [*],
numbers of an entry or of a slider.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import add_cross, add_to, add_turn, cross_product, dim, put, spin, vector
from fastbeam.kernels.algebra.vectors import vst
from fastbeam.kernels.entries.dense import (
    add_column,
    add_column_times,
    add_line,
    add_line_rows,
    first_of_own_block,
    largest_share,
    put_arm,
    put_corner,
    put_frame,
    put_idle_corner,
    put_node,
    put_own_block,
    put_position,
)
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.terms import System

# kinds of entries of `FactoredContact`: the position of a node, its spin, both, or the spin of one that carries it on an arm
POSITION, SPIN, BOTH, ON_ARM = 1.0, 2.0, 3.0, 4.0
# numbers of such an entry: those of `Weights`, then from TURNED on a vector, the kind last; with ties two arms behind them
TURNED, KIND, ARM_MID, ARM_END = 4, 7, 8, 11
# numbers of a slider there: its force F, g_mean, derivative of the sliding equation by a position for `Weights.along` = 1, moment
# g_mean x F; of its own block the derivatives by s of the curve at the end and of the mean, those of the sliding equation by the
# force and by s; 1 where it has left its beam
FORCE, GAP, SLIDE, MOMENT, END_S, MEAN_S, TANGENT, BY_S, IDLE, FRAME = 0, 3, 6, 9, 12, 15, 18, 21, 22, 24


class FactoredContact(NamedTuple):
    """Contact of scenes whose constraints are all sliders, rows of the block matrix, without sleeves; E entries each at most."""

    basis: np.ndarray       # float64 [5, n]: this and all fields without a comment as in `Contact`
    legendre: np.ndarray    # float64 [3, n_coef]
    entries: np.ndarray     # int32 [S]
    row: np.ndarray         # int32 [S, E]
    share: np.ndarray       # float64 [S, E, 8]: numbers of an entry, 16 with ties
    frame: np.ndarray       # float64 [S, 24]: numbers of a slider
    residual: np.ndarray    # float64 [S, 8]
    element: np.ndarray     # int64 [S]
    forces: np.ndarray      # int64 [S]
    first: np.ndarray       # int64 [S]
    first_force: np.ndarray  # int64 [S]
    compliance: np.ndarray  # float64 [S]
    softness: np.ndarray    # float64 [S]
    remaining: np.ndarray   # float64 [S]
    full: np.ndarray        # int64 [1]
    augmented: np.ndarray   # float64 [4]
    pair: np.ndarray        # int64 [0, 2]: no sleeves
    strong: np.ndarray      # int64 [S]: all entries


FactoredContact.reads = System  # type: ignore[attr-defined]


@kernel
def new_place(contact, k, row, weights, kind):
    """Return the place of a new entry of slider k. If the arrays are full it is the last again, and `full` is set."""
    m = contact.entries[k]
    if m == contact.row.shape[1]:
        contact.full[0] = 1
        m -= 1
    contact.entries[k] = m + 1
    contact.row[k, m] = row
    share = contact.share[k, m]
    share[0] = weights.mean
    share[1] = weights.end
    share[2] = weights.slope
    share[3] = weights.along
    share[KIND] = kind
    return m


@put_position.register(FactoredContact)
@kernel
def put_position_shares(contact, k, row, weights, f, slide, dofs):
    return new_place(contact, k, row, weights, POSITION)


@put_arm.register(FactoredContact)
@kernel
def put_arm_shares(contact, k, row, arm_mid, arm_end, weights, f, slide, dofs):
    m = new_place(contact, k, row, weights, ON_ARM)
    put(contact.share[k, m], ARM_MID, 1, arm_mid)
    put(contact.share[k, m], ARM_END, 1, arm_end)


@put_frame.register(FactoredContact)
@kernel
def keep_frame(contact, k, frame, dofs):
    of = contact.frame[k]
    put(of, FORCE, 1, frame.force)
    put(of, GAP, 1, frame.gap)
    put(of, SLIDE, 1, frame.slide)
    put(of, MOMENT, 1, frame.moment)


@put_node.register(FactoredContact)
@kernel
def put_node_shares(contact, k, row, entry, turned, weights, frame, dofs):
    m = entry
    if m < 0:
        m = new_place(contact, k, row, weights, SPIN)
    else:
        contact.share[k, m, KIND] = BOTH
    put(contact.share[k, m], TURNED, 1, turned)


@put_corner.register(FactoredContact)
@kernel
def keep_corner(contact, k, end_s, mean_s, tangent, by_s, dofs):
    of = contact.frame[k]
    put(of, END_S, 1, end_s)
    put(of, MEAN_S, 1, mean_s)
    put(of, TANGENT, 1, tangent)
    of[BY_S] = by_s
    of[IDLE] = 0.0


@put_idle_corner.register(FactoredContact)
@kernel
def keep_idle_corner(contact, k, dofs):
    of = contact.frame[k]
    for i in range(of.shape[0]):
        of[i] = 0.0
    of[BY_S] = 1.0
    of[IDLE] = 1.0


# --- blocks -------------------------------------------------------------------------------------------------------------
@add_column.register(FactoredContact)
@kernel
def add_factored_column(contact, k, m, out, at, dofs):
    d = dim(dofs)
    share = contact.share[k, m]
    of = contact.frame[k]
    mean = share[0]
    slope = share[2]
    kind = share[KIND]
    f = vector(of, FORCE, 1, dofs)
    if kind == ON_ARM:
        arm = vector(share, ARM_MID, 1, dofs)
        add_cross(out, at + 8 * d, mean, arm)
        add_to(out, at + 9 * d, 8, cross_product.call(arm, slope * f))
        return
    if kind != SPIN:
        for i in range(d):
            out[at + 9 * i] += mean
        add_to(out, at + d, 8, slope * f)
    if kind != POSITION:
        add_cross(out, at + 8 * d, mean, vector(of, GAP, 1, dofs))
        add_cross(out, at + 9 * d + 1, -mean, f)
        add_to(out, at + 9 * d, 8, slope * spin(of, MOMENT, dofs))


@add_line.register(FactoredContact)
@kernel
def add_factored_line(contact, k, m, out, at, dofs):
    d = dim(dofs)
    share = contact.share[k, m]
    kind = share[KIND]
    half = 0.5 * share[0]
    slide = share[3] * vector(contact.frame[k], SLIDE, 1, dofs)
    if kind == ON_ARM:
        arm = vector(share, ARM_END, 1, dofs)
        add_cross(out, at + 8 * d, -share[1], arm)
        add_cross(out, at + 9 * d + 1, half, arm)
        add_to(out, at + 9 * d, 8, cross_product.call(arm, slide))
        return
    if kind != SPIN:
        for i in range(d):
            out[at + 9 * i] -= share[1]
            out[at + 9 * i + d + 1] += half
        add_to(out, at + d, 8, slide)
    if kind != POSITION:
        add_to(out, at + 9 * d, 8, spin(share, TURNED, dofs))


@add_line_rows.register(FactoredContact)
@kernel
def add_factored_rows(contact, k, m, out, at, unknowns, dofs):
    d = dim(dofs)
    share = contact.share[k, m]
    kind = share[KIND]
    half = 0.5 * share[0]
    slide = share[3] * vector(contact.frame[k], SLIDE, 1, dofs)
    if kind == ON_ARM:
        arm = vector(share, ARM_END, 1, dofs)
        add_turn(out, at + d, -share[1], arm)
        add_turn(out, at + 8 * (d + 1) + d, half, arm)
        add_to(out, at + 9 * d, 1, cross_product.call(arm, slide))
        return
    if kind != SPIN:
        for i in range(d):
            out[at + 9 * i] -= share[1]
            out[at + 8 * (d + 1) + 9 * i] += half
        add_to(out, at + 8 * d, 1, slide)
    if kind != POSITION:
        add_to(out, at + 9 * d, 1, spin(share, TURNED, dofs))


@add_column_times.register(FactoredContact)
@kernel
def add_factored_product(contact, k, m, y, first, unknowns, out, at, dofs):
    d = dim(dofs)
    share = contact.share[k, m]
    of = contact.frame[k]
    kind = share[KIND]
    f = vector(of, FORCE, 1, dofs)
    # the change of the share of the force
    force = share[0] * vector(y, first, 1, dofs) + (share[2] * y[first + d]) * f
    if kind == ON_ARM:
        add_to(out, at + d, 1, cross_product.call(vector(share, ARM_MID, 1, dofs), force))
        return
    if kind != SPIN:
        add_to(out, at, 1, force)
    if kind != POSITION:
        gap = share[0] * vector(y, first + d + 1, 1, dofs)
        # moments of that on the arm g_mean, and of F on its change
        moment = cross_product.call(vector(of, GAP, 1, dofs), force)
        add_to(out, at + d, 1, moment + cross_product.call(gap, f))


@kernel
def largest_across(of, first, held, dofs):
    """Return the largest number of the free rows of the matrix x cross, x in of [*] from `first` on; bit i of `held` set: row i
    is not free."""
    d = dim(dofs)
    largest = 0.0
    for i in range(3 if d == 3 else 1):
        for j in range(d):
            if (held >> i) & 1 == 0 and (d == 2 or j != i):
                largest = max(largest, abs(of[first + j]))
    return largest


@largest_share.register(FactoredContact)
@kernel
def largest_of_shares(contact, k, m, held, forces, dofs):
    d = dim(dofs)
    share = contact.share[k, m]
    kind = share[KIND]
    mean = abs(share[0])
    largest = 0.0
    if kind == POSITION or kind == BOTH:
        for i in range(d):
            if (held >> i) & 1 == 0:
                largest = mean
    if kind == ON_ARM:
        return mean * largest_across(share, ARM_MID, held >> d, dofs)
    if kind != POSITION:
        largest = max(largest, mean * largest_across(contact.frame[k], GAP, held >> d, dofs))
    return largest


@put_own_block.register(FactoredContact)
@kernel
def put_factored_block(contact, k, out, at, unknowns, dofs):
    d = dim(dofs)
    of = contact.frame[k]
    for i in range(2 * d + 1):
        vst(out, at + 8 * i, 0, 0.0)
    for i in range(d):
        out[at + 9 * i] = of[IDLE]
        out[at + 9 * (d + 1 + i)] = 1.0
    put(out, at + d, 8, -1.0 * vector(of, END_S, 1, dofs))
    put(out, at + 8 * d, 1, vector(of, TANGENT, 1, dofs))
    out[at + 9 * d] = of[BY_S]
    put(out, at + 9 * d + 8, 8, vector(of, MEAN_S, 1, dofs))


@first_of_own_block.register(FactoredContact)
@kernel
def idle_number(contact, k):
    return contact.frame[k, IDLE]
