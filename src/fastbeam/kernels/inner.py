"""Elimination of the inner nodes of elements inside the element loop, eight elements at a time.

A node that only one element touches is eliminated before anything is assembled: the solver sees the end nodes only. Per group
of 8 elements and inner node i, in turn, with the others j behind it (later inner nodes, last node, first node):

    U_ij = K_ii^-1 K_ij,   K_kj -= K_ki U_ij,   y_i = K_ii^-1 r_i,   r_k -= K_ki y_i

and, after the end nodes are known, x_i = y_i - sum_j U_ij x_j in reverse order. Columns of slider borders take the same way, one
element at a time, eight columns at once.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._jit import kernel
from .algebra import cross, gather_lanes, ld3, scatter_rows, st3, vdominates, vld, vst
from .nodes import tie_arm

BLOCK = 288          # 6 x 6 lanes of 8
PIVOT = 1e-13        # a pivot below this share of its diagonal entry is none


class Inner(NamedTuple):
    """Factors and index lists of the eliminated nodes; None in a model without any."""

    store: np.ndarray     # float64: per group and inner node its LU, then U_ij, K_ji of every other
    rhs: np.ndarray       # float64 [8 (N + 1)]: y_i by rows
    where: np.ndarray     # int64 [E, 3]: of every live element: offset of its lane in store, inner nodes, offset in rows
    rows: np.ndarray      # int64: rows of the nodes of every element, first to last
    element: np.ndarray   # int64 [inner nodes]: element of every row from the first inner row on
    mark: np.ndarray      # int64 [E]: elements that a slider touches, in use
    found: np.ndarray     # int64 [E]: list of those
    first: np.ndarray     # int64 [1]: first inner row
    state: np.ndarray     # float64 [1]: 0 where a group was singular


def store_size(nn: int) -> int:
    """Doubles of a group in `store`."""
    return sum(BLOCK * (1 + 2 * (nn - i)) for i in range(1, nn - 1))


@kernel
def factor_lanes(a, o, out, d):
    """LU of 8 blocks without exchange, reciprocal pivots on the diagonal; False where a pivot is next to nothing or NaN.
    An explicit inverse would be faster and is not accurate enough: on slender beams the soft directions of the others'
    stiffness are small differences."""
    for k in range(0, BLOCK, 8):
        vst(out, d + k, 0, vld(a, o + k, 0))
    good = True
    for k in range(6):
        q = d + 48 * k
        pivot = vld(out, q + 8 * k, 0)
        if not vdominates(pivot, PIVOT * vld(a, o + 56 * k, 0)):
            good = False
        p = 1.0 / pivot
        vst(out, q + 8 * k, 0, p)
        for r in range(k + 1, 6):
            z = d + 48 * r
            f = p * vld(out, z + 8 * k, 0)
            vst(out, z + 8 * k, 0, f)
            for c in range(8 * k + 8, 48, 8):
                vst(out, z + c, 0, vld(out, z + c, 0) - f * vld(out, q + c, 0))
    return good


@kernel
def solve_lanes(lu, d, x, xo, rs, out, oo, os):
    """out = A^-1 x for 8 factored blocks and 6 lanes each, rs and os doubles apart."""
    w0 = vld(x, xo, 0)
    w1 = vld(x, xo + rs, 0) - vld(lu, d + 48, 0) * w0
    w2 = vld(x, xo + 2 * rs, 0) - vld(lu, d + 96, 0) * w0 - vld(lu, d + 104, 0) * w1
    w3 = vld(x, xo + 3 * rs, 0) - vld(lu, d + 144, 0) * w0 - vld(lu, d + 152, 0) * w1 - vld(lu, d + 160, 0) * w2
    w4 = (vld(x, xo + 4 * rs, 0) - vld(lu, d + 192, 0) * w0 - vld(lu, d + 200, 0) * w1 - vld(lu, d + 208, 0) * w2
          - vld(lu, d + 216, 0) * w3)
    w5 = (vld(x, xo + 5 * rs, 0) - vld(lu, d + 240, 0) * w0 - vld(lu, d + 248, 0) * w1 - vld(lu, d + 256, 0) * w2
          - vld(lu, d + 264, 0) * w3 - vld(lu, d + 272, 0) * w4)
    w5 = vld(lu, d + 280, 0) * w5
    w4 = vld(lu, d + 224, 0) * (w4 - vld(lu, d + 232, 0) * w5)
    w3 = vld(lu, d + 168, 0) * (w3 - vld(lu, d + 176, 0) * w4 - vld(lu, d + 184, 0) * w5)
    w2 = vld(lu, d + 112, 0) * (w2 - vld(lu, d + 120, 0) * w3 - vld(lu, d + 128, 0) * w4 - vld(lu, d + 136, 0) * w5)
    w1 = vld(lu, d + 56, 0) * (w1 - vld(lu, d + 64, 0) * w2 - vld(lu, d + 72, 0) * w3 - vld(lu, d + 80, 0) * w4
                               - vld(lu, d + 88, 0) * w5)
    w0 = vld(lu, d, 0) * (w0 - vld(lu, d + 8, 0) * w1 - vld(lu, d + 16, 0) * w2 - vld(lu, d + 24, 0) * w3
                          - vld(lu, d + 32, 0) * w4 - vld(lu, d + 40, 0) * w5)
    vst(out, oo, 0, w0); vst(out, oo + os, 0, w1); vst(out, oo + 2 * os, 0, w2)
    vst(out, oo + 3 * os, 0, w3); vst(out, oo + 4 * os, 0, w4); vst(out, oo + 5 * os, 0, w5)


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
        if not factor_lanes(scratch, diagonal, store, d):
            inner.state[0] = 0.0
            return
        y = diagonal     # the block is done with, its room takes y
        solve_lanes(store, d, scratch, ro + 48 * i, 8, scratch, y, 8)
        scatter_rows(scratch, y, tables.rows, no + 8 * i, 8, 0, inner.rhs)
        # others: i + 1 .. nn - 1, then 0
        u0 = d + BLOCK
        for m in range(nn - i):
            j = i + 1 + m if m < nn - 1 - i else 0
            for c in range(0, 48, 8):
                solve_lanes(store, d, scratch, ko + BLOCK * (nn * i + j) + c, 48, store, u0 + 2 * BLOCK * m + c, 48)
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
def solve_columns(lu, d, x, xo, width):
    """Six rows of 8 columns: x <- A^-1 x for one lane of a factored block."""
    w0 = vld(x, xo, 0)
    w1 = vld(x, xo + width, 0) - lu[d + 48] * w0
    w2 = vld(x, xo + 2 * width, 0) - lu[d + 96] * w0 - lu[d + 104] * w1
    w3 = vld(x, xo + 3 * width, 0) - lu[d + 144] * w0 - lu[d + 152] * w1 - lu[d + 160] * w2
    w4 = vld(x, xo + 4 * width, 0) - lu[d + 192] * w0 - lu[d + 200] * w1 - lu[d + 208] * w2 - lu[d + 216] * w3
    w5 = (vld(x, xo + 5 * width, 0) - lu[d + 240] * w0 - lu[d + 248] * w1 - lu[d + 256] * w2 - lu[d + 264] * w3
          - lu[d + 272] * w4)
    w5 = lu[d + 280] * w5
    w4 = lu[d + 224] * (w4 - lu[d + 232] * w5)
    w3 = lu[d + 168] * (w3 - lu[d + 176] * w4 - lu[d + 184] * w5)
    w2 = lu[d + 112] * (w2 - lu[d + 120] * w3 - lu[d + 128] * w4 - lu[d + 136] * w5)
    w1 = lu[d + 56] * (w1 - lu[d + 64] * w2 - lu[d + 72] * w3 - lu[d + 80] * w4 - lu[d + 88] * w5)
    w0 = lu[d] * (w0 - lu[d + 8] * w1 - lu[d + 16] * w2 - lu[d + 24] * w3 - lu[d + 32] * w4 - lu[d + 40] * w5)
    vst(x, xo, 0, w0); vst(x, xo + width, 0, w1); vst(x, xo + 2 * width, 0, w2)
    vst(x, xo + 3 * width, 0, w3); vst(x, xo + 4 * width, 0, w4); vst(x, xo + 5 * width, 0, w5)


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
                solve_columns(inner.store, d, panel, row + c, width)
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
