"""Elimination of the inner nodes of elements inside the element loop, eight elements at a time.

A node that only one element touches is eliminated before anything is assembled: the solver sees the end nodes only. Per group
of 8 elements and inner node i, in turn, with the others j behind it (later inner nodes, last node, first node):

    D_i = K_ii^-1,   U_ij = D_i K_ij,   K_kj -= K_ki U_ij,   y_i = D_i r_i,   r_k -= K_ki y_i

and, after the end nodes are known, x_i = y_i - sum_j U_ij x_j in reverse order. Columns of slider borders take the same way, one
element at a time, eight columns at once.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._jit import kernel
from .algebra import cross, gather_lanes, ld3, scatter_rows, st3, vdominates, vld, vst
from .chain import invert_exchanging
from .nodes import tie_arm

BLOCK = 288          # 6 x 6 lanes of 8
PIVOT = 1e-5         # a pivot below this share of its diagonal entry calls for row exchanges


class Inner(NamedTuple):
    """Factors and index lists of the eliminated nodes; None in a model without any."""

    store: np.ndarray     # float64: per group and inner node D, then U, L of every other
    rhs: np.ndarray       # float64 [8 (N + 1)]: y_i by rows
    where: np.ndarray     # int64 [E, 3]: of every live element: offset of its lane in store, inner nodes, offset in rows
    rows: np.ndarray      # int64: rows of the nodes of every element, first to last
    element: np.ndarray   # int64 [inner nodes]: element of every row from the first inner row on
    mark: np.ndarray      # int64 [E]: elements that a slider touches, in use
    found: np.ndarray     # int64 [E]: list of those
    first: np.ndarray     # int64 [1]: first inner row
    state: np.ndarray     # float64 [1]: 0 where a group was singular
    sizes: np.ndarray     # float64 [6]


def store_size(nn: int) -> int:
    """Doubles of a group in `store`."""
    return sum(BLOCK * (1 + 2 * (nn - i)) for i in range(1, nn - 1))


@kernel
def invert_lanes(a, o, out, d):
    """Inverse of 8 blocks by Gauss-Jordan without exchange; False where a pivot is small."""
    for k in range(0, BLOCK, 8):
        vst(out, d + k, 0, vld(a, o + k, 0))
    good = True
    for k in range(6):
        pivot = vld(out, d + 56 * k, 0)
        if not vdominates(pivot, PIVOT * vld(a, o + 56 * k, 0)):
            good = False
        p = 1.0 / pivot
        x0 = p * vld(out, d + 48 * k, 0); x1 = p * vld(out, d + 48 * k + 8, 0); x2 = p * vld(out, d + 48 * k + 16, 0)
        x3 = p * vld(out, d + 48 * k + 24, 0); x4 = p * vld(out, d + 48 * k + 32, 0); x5 = p * vld(out, d + 48 * k + 40, 0)
        for r in range(6):
            if r != k:
                q = d + 48 * r
                f = vld(out, q + 8 * k, 0)
                vst(out, q, 0, vld(out, q, 0) - f * x0)
                vst(out, q + 8, 0, vld(out, q + 8, 0) - f * x1)
                vst(out, q + 16, 0, vld(out, q + 16, 0) - f * x2)
                vst(out, q + 24, 0, vld(out, q + 24, 0) - f * x3)
                vst(out, q + 32, 0, vld(out, q + 32, 0) - f * x4)
                vst(out, q + 40, 0, vld(out, q + 40, 0) - f * x5)
                vst(out, q + 8 * k, 0, -1.0 * (f * p))
        q = d + 48 * k
        vst(out, q, 0, x0); vst(out, q + 8, 0, x1); vst(out, q + 16, 0, x2)
        vst(out, q + 24, 0, x3); vst(out, q + 32, 0, x4); vst(out, q + 40, 0, x5)
        vst(out, q + 8 * k, 0, p)
    return good


@kernel
def invert_one_by_one(a, o, out, d, sizes):
    """The same with row exchanges. False where one is singular or not finite."""
    for k in range(0, BLOCK, 8):
        vst(out, d + k, 0, vld(a, o + k, 0))
    for lane in range(8):
        if not invert_exchanging(out, d + lane, 48, 8, sizes) > 1e-14:
            return False
    return True


@kernel
def multiply_lanes(a, ao, b, bo, c, co):
    """C = A B, 8 blocks."""
    for r in range(0, 48 * 6, 48):
        x0 = vld(a, ao + r, 0); x1 = vld(a, ao + r + 8, 0); x2 = vld(a, ao + r + 16, 0)
        x3 = vld(a, ao + r + 24, 0); x4 = vld(a, ao + r + 32, 0); x5 = vld(a, ao + r + 40, 0)
        for k in range(0, 48, 8):
            q = bo + k
            vst(c, co + r + k, 0, x0 * vld(b, q, 0) + x1 * vld(b, q + 48, 0) + x2 * vld(b, q + 96, 0)
                + x3 * vld(b, q + 144, 0) + x4 * vld(b, q + 192, 0) + x5 * vld(b, q + 240, 0))


@kernel
def subtract_lanes(a, ao, b, bo, c, co):
    """C -= A B, 8 blocks."""
    for r in range(0, 48 * 6, 48):
        x0 = vld(a, ao + r, 0); x1 = vld(a, ao + r + 8, 0); x2 = vld(a, ao + r + 16, 0)
        x3 = vld(a, ao + r + 24, 0); x4 = vld(a, ao + r + 32, 0); x5 = vld(a, ao + r + 40, 0)
        for k in range(0, 48, 8):
            q = bo + k
            vst(c, co + r + k, 0, vld(c, co + r + k, 0) - x0 * vld(b, q, 0) - x1 * vld(b, q + 48, 0) - x2 * vld(b, q + 96, 0)
                - x3 * vld(b, q + 144, 0) - x4 * vld(b, q + 192, 0) - x5 * vld(b, q + 240, 0))


@kernel
def apply_lanes(a, ao, x, xo, y, yo):
    """y = A x for 8 blocks and 6 lanes each."""
    for r in range(6):
        q = ao + 48 * r
        vst(y, yo + 8 * r, 0, vld(a, q, 0) * vld(x, xo, 0) + vld(a, q + 8, 0) * vld(x, xo + 8, 0)
            + vld(a, q + 16, 0) * vld(x, xo + 16, 0) + vld(a, q + 24, 0) * vld(x, xo + 24, 0)
            + vld(a, q + 32, 0) * vld(x, xo + 32, 0) + vld(a, q + 40, 0) * vld(x, xo + 40, 0))


@kernel
def subtract_applied(a, ao, x, xo, y, yo):
    """y -= A x for 8 blocks and 6 lanes each."""
    for r in range(6):
        q = ao + 48 * r
        vst(y, yo + 8 * r, 0, vld(y, yo + 8 * r, 0) - vld(a, q, 0) * vld(x, xo, 0) - vld(a, q + 8, 0) * vld(x, xo + 8, 0)
            - vld(a, q + 16, 0) * vld(x, xo + 16, 0) - vld(a, q + 24, 0) * vld(x, xo + 24, 0)
            - vld(a, q + 32, 0) * vld(x, xo + 32, 0) - vld(a, q + 40, 0) * vld(x, xo + 40, 0))


@kernel
def eliminate_inner(inner, io, nn, tables, no, scratch, ro, ko, r_out):
    """Eliminate the inner nodes of one group: rows at ro, blocks at ko. Their own residual goes to r_out and comes back with what
    loads and sliders put there."""
    store = inner.store
    for i in range(1, nn - 1):
        scatter_rows(scratch, ro + 48 * i, tables.rows, no + 8 * i, 8, 0, r_out)
        gather_lanes(r_out, tables.rows, no + 8 * i, 8, 6, scratch, ro + 48 * i)
    d = io
    for i in range(1, nn - 1):
        diagonal = ko + BLOCK * (nn * i + i)
        if not invert_lanes(scratch, diagonal, store, d):
            if not invert_one_by_one(scratch, diagonal, store, d, inner.sizes):
                inner.state[0] = 0.0
                return
        y = diagonal     # the block is done with, its room takes y
        apply_lanes(store, d, scratch, ro + 48 * i, scratch, y)
        scatter_rows(scratch, y, tables.rows, no + 8 * i, 8, 0, inner.rhs)
        # others: i + 1 .. nn - 1, then 0
        u0 = d + BLOCK
        for m in range(nn - i):
            j = i + 1 + m if m < nn - 1 - i else 0
            multiply_lanes(store, d, scratch, ko + BLOCK * (nn * i + j), store, u0 + 2 * BLOCK * m)
        for m in range(nn - i):
            k = i + 1 + m if m < nn - 1 - i else 0
            low = ko + BLOCK * (nn * k + i)
            for l in range(nn - i):
                j = i + 1 + l if l < nn - 1 - i else 0
                subtract_lanes(scratch, low, store, u0 + 2 * BLOCK * l, scratch, ko + BLOCK * (nn * k + j))
            subtract_applied(scratch, low, scratch, y, scratch, ro + 48 * k)
            for c in range(0, BLOCK, 8):
                vst(store, u0 + 2 * BLOCK * m + BLOCK + c, 0, vld(scratch, low + c, 0))
        d = u0 + 2 * BLOCK * (nn - i)


@kernel
def apply_to_columns(a, o, x, xo, width):
    """Six rows of 8 columns times one lane of a block: returns nothing, x <- A x."""
    w0 = vld(x, xo, 0); w1 = vld(x, xo + width, 0); w2 = vld(x, xo + 2 * width, 0)
    w3 = vld(x, xo + 3 * width, 0); w4 = vld(x, xo + 4 * width, 0); w5 = vld(x, xo + 5 * width, 0)
    for r in range(6):
        q = o + 48 * r
        vst(x, xo + r * width, 0,
            a[q] * w0 + a[q + 8] * w1 + a[q + 16] * w2 + a[q + 24] * w3 + a[q + 32] * w4 + a[q + 40] * w5)


@kernel
def subtract_columns(a, o, x, xo, y, yo, width):
    """Six rows of 8 columns: y -= A x for one lane of a block."""
    w0 = vld(x, xo, 0); w1 = vld(x, xo + width, 0); w2 = vld(x, xo + 2 * width, 0)
    w3 = vld(x, xo + 3 * width, 0); w4 = vld(x, xo + 4 * width, 0); w5 = vld(x, xo + 5 * width, 0)
    for r in range(6):
        q = o + 48 * r
        z = vld(y, yo + r * width, 0) - a[q] * w0 - a[q + 8] * w1 - a[q + 16] * w2
        vst(y, yo + r * width, 0, z - a[q + 24] * w3 - a[q + 32] * w4 - a[q + 40] * w5)


@kernel
def eliminate_columns(inner, contact, panel, width):
    """Carry the border columns on inner rows to the end nodes, for the elements that a slider touches."""
    n = 0
    first = inner.first[0]
    for k in range(contact.entries.shape[0]):
        for m in range(contact.entries[k]):
            if contact.row[k, m] >= first:
                e = inner.element[contact.row[k, m] - first]
                if inner.mark[e] == 0:
                    inner.mark[e] = 1
                    inner.found[n] = e
                    n += 1
    for f in range(n):
        e = inner.found[f]
        inner.mark[e] = 0
        d = inner.where[e, 0]
        count = inner.where[e, 1]
        rows = inner.where[e, 2]
        for i in range(1, count + 1):
            others = count + 2 - i
            row = 6 * width * inner.rows[rows + i]
            for c in range(0, width, 8):
                apply_to_columns(inner.store, d, panel, row + c, width)
                for m in range(others):
                    k = i + 1 + m if m < others - 1 else 0
                    subtract_columns(inner.store, d + 2 * BLOCK * (m + 1), panel, row + c, panel,
                                     6 * width * inner.rows[rows + k] + c, width)
            d += BLOCK * (1 + 2 * others)


@kernel
def put_inner_rhs(inner, n_rows, panel, width):
    """y of the inner rows into column 0 of the panel."""
    for i in range(inner.first[0], n_rows):
        for c in range(6):
            panel[(6 * i + c) * width] = inner.rhs[8 * i + c]


@kernel
def recover_inner(inner, panel, width):
    """Solutions of the inner rows from those of the end nodes, all columns."""
    for e in range(inner.where.shape[0]):
        count = inner.where[e, 1]
        rows = inner.where[e, 2]
        d = inner.where[e, 0]
        for i in range(1, count):
            d += BLOCK * (1 + 2 * (count + 2 - i))
        for i in range(count, 0, -1):
            others = count + 2 - i
            row = 6 * width * inner.rows[rows + i]
            for c in range(0, width, 8):
                for m in range(others):
                    k = i + 1 + m if m < others - 1 else 0
                    subtract_columns(inner.store, d + BLOCK * (1 + 2 * m), panel, 6 * width * inner.rows[rows + k] + c, panel,
                                     row + c, width)
            d -= BLOCK * (1 + 2 * (others + 1))


@kernel
def pull_tied_columns(ties, q_mid, panel, width):
    """Border columns on rows of tied nodes go to their targets."""
    for k in range(ties.slave.shape[0]):
        i = ties.slave[k]
        o = 6 * width * ties.row[k]
        for c in range(1, width):
            f = ld3(panel, o + c, width)
            m = ld3(panel, o + 3 * width + c, width)
            for e in range(ties.start[i], ties.start[i + 1]):
                t = 6 * width * ties.target_row[e] + c
                if ties.kind[e] == 0:
                    st3(panel, o + c, width, 0.0 * f)
                    st3(panel, t, width, ld3(panel, t, width) + f)
                elif ties.kind[e] == 1:
                    st3(panel, t + 3 * width, width, ld3(panel, t + 3 * width, width) + cross(tie_arm(ties, e, q_mid), f))
                elif ties.target[e] != i:
                    st3(panel, o + 3 * width + c, width, 0.0 * m)
                    st3(panel, t + 3 * width, width, ld3(panel, t + 3 * width, width) + m)


@kernel
def push_tied_columns(ties, q_end, panel, width):
    """Solutions on rows of tied nodes from their targets, all columns."""
    for k in range(ties.slave.shape[0]):
        i = ties.slave[k]
        o = 6 * width * ties.row[k]
        for c in range(width):
            for e in range(ties.start[i], ties.start[i + 1]):
                t = 6 * width * ties.target_row[e] + c
                if ties.kind[e] == 2 and ties.target[e] != i:
                    st3(panel, o + 3 * width + c, width, ld3(panel, t + 3 * width, width))
            x = ld3(panel, o + c, width)
            x = x - x
            for e in range(ties.start[i], ties.start[i + 1]):
                t = 6 * width * ties.target_row[e] + c
                if ties.kind[e] == 0:
                    x += ld3(panel, t, width)
                elif ties.kind[e] == 1:
                    x -= cross(tie_arm(ties, e, q_end), ld3(panel, t + 3 * width, width))
            st3(panel, o + c, width, x)
