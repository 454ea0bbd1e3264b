"""Block elimination of a sparse matrix of 6 x 6 blocks in a fixed order, with inverses of the diagonal blocks.

A block is inverted in registers without row exchanges; where a pivot is small it is done again with exchanges. With the inverse
everything else is products, which do not wait for each other as the steps of a triangular solution do.

Blocks are stored as 6 rows of 8 doubles, so that a row is one register; block k starts at 48 k. The order and the fill come
from the compiler of the scene: for chains and trees of beams there is no fill beyond the elements.
Right-hand sides stand side by side in a panel of `width` doubles a row (a multiple of 8), 6 rows a node.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._jit import kernel
from .algebra import flush_rows, invert_rows, vld, vst


class Elimination(NamedTuple):
    """Order and update lists, n rows."""

    diagonal: np.ndarray      # int64 [n]: block of the diagonal
    start: np.ndarray         # int64 [n + 1]: range of row i in the next three
    column: np.ndarray        # int64 [m]: column j > i of an upper block
    upper: np.ndarray         # int64 [m]: block (i, j)
    lower: np.ndarray         # int64 [m]: block (j, i)
    target_start: np.ndarray  # int64 [n]: where the targets of row i begin
    target: np.ndarray        # int64: blocks (j, k) for all j, k of row i, row by row


@kernel
def invert_exchanging(x, o, rs, cs, sizes):
    """Inverse in place of the 6 x 6 block x[o + rs*i + cs*j], Gauss-Jordan with row exchanges. Returns the smallest ratio of a
    pivot to the largest entry that its row had: zero where the block is singular or NaN. The ratio does not see that forces and
    moments have different units. sizes: 6 numbers of room."""
    for i in range(6):
        t = 0.0
        for j in range(6):
            t = max(t, abs(x[o + rs * i + cs * j]))
        sizes[i] = t
    smallest = np.inf
    moved = np.int64(0)
    for k in range(6):
        m = k
        v = abs(x[o + (rs + cs) * k])
        for i in range(k + 1, 6):
            t = abs(x[o + rs * i + cs * k])
            if t > v:
                v = t
                m = i
        # also where the pivot is NaN, which min() would drop
        if not v > 0.0:
            return 0.0
        smallest = min(smallest, v / sizes[m])
        moved |= np.int64(m) << (4 * k)
        if m != k:
            t = sizes[k]; sizes[k] = sizes[m]; sizes[m] = t
            for j in range(6):
                t = x[o + rs * k + cs * j]
                x[o + rs * k + cs * j] = x[o + rs * m + cs * j]
                x[o + rs * m + cs * j] = t
        p = 1.0 / x[o + (rs + cs) * k]
        x[o + (rs + cs) * k] = 1.0
        for j in range(6):
            x[o + rs * k + cs * j] *= p
        for i in range(6):
            if i != k:
                f = x[o + rs * i + cs * k]
                x[o + rs * i + cs * k] = 0.0
                for j in range(6):
                    x[o + rs * i + cs * j] -= f * x[o + rs * k + cs * j]
    # exchanges of rows are undone on the columns of the inverse
    for k in range(5, -1, -1):
        m = (moved >> (4 * k)) & 15
        if m != k:
            for i in range(6):
                t = x[o + rs * i + cs * k]
                x[o + rs * i + cs * k] = x[o + rs * i + cs * m]
                x[o + rs * i + cs * m] = t
    return smallest


@kernel
def apply_block(blocks, a, x, o, stride):
    """X <- A X for the block A at a and 6 rows of 8 at o, `stride` apart."""
    w0 = vld(x, o, 0); w1 = vld(x, o + stride, 0); w2 = vld(x, o + 2 * stride, 0)
    w3 = vld(x, o + 3 * stride, 0); w4 = vld(x, o + 4 * stride, 0); w5 = vld(x, o + 5 * stride, 0)
    for r in range(6):
        q = a + 8 * r
        y = blocks[q] * w0 + blocks[q + 1] * w1 + blocks[q + 2] * w2
        vst(x, o + stride * r, 0, y + (blocks[q + 3] * w3 + blocks[q + 4] * w4 + blocks[q + 5] * w5))


@kernel
def subtract_product(blocks, a, b, bo, b_stride, c, co, c_stride):
    """C -= A B for a block A at a and 6 rows of 8 of B and C."""
    w0 = vld(b, bo, 0); w1 = vld(b, bo + b_stride, 0); w2 = vld(b, bo + 2 * b_stride, 0)
    w3 = vld(b, bo + 3 * b_stride, 0); w4 = vld(b, bo + 4 * b_stride, 0); w5 = vld(b, bo + 5 * b_stride, 0)
    for r in range(6):
        q = a + 8 * r
        o = co + c_stride * r
        x = vld(c, o, 0) - blocks[q] * w0 - blocks[q + 1] * w1 - blocks[q + 2] * w2
        y = blocks[q + 3] * w3 + blocks[q + 4] * w4 + blocks[q + 5] * w5
        vst(c, o, 0, x - y)


@kernel
def factor(plan, blocks, sizes):
    """Factor in place: diagonal blocks to D^-1, upper blocks to D^-1 A. Returns the worst pivot ratio where rows had to be
    exchanged, else 1; stops at a singular block, which returns 0. sizes: 6 numbers of room."""
    worst = 1.0
    for i in range(plan.diagonal.shape[0]):
        d = 48 * plan.diagonal[i]
        if not invert_rows(blocks, d):
            ratio = invert_exchanging(blocks, d, 8, 1, sizes)
            if not ratio > 0.0:
                return 0.0
            worst = min(worst, ratio)
        k0 = plan.start[i]
        k1 = plan.start[i + 1]
        for k in range(k0, k1):
            apply_block(blocks, d, blocks, 48 * plan.upper[k], 8)
        t = plan.target_start[i]
        for j in range(k0, k1):
            low = 48 * plan.lower[j]
            for k in range(k0, k1):
                subtract_product(blocks, low, blocks, 48 * plan.upper[k], 8, blocks, 48 * plan.target[t], 8)
                t += 1
    return worst


@kernel
def solve(plan, blocks, panel, width):
    """Solve for all right-hand sides of the panel [n, 6, width] in place."""
    n = plan.diagonal.shape[0]
    for i in range(n):
        for c in range(0, width, 8):
            o = 6 * width * i + c
            apply_block(blocks, 48 * plan.diagonal[i], panel, o, width)
            flush_rows(panel, o, width)
            for k in range(plan.start[i], plan.start[i + 1]):
                subtract_product(blocks, 48 * plan.lower[k], panel, o, width, panel, 6 * width * plan.column[k] + c, width)
    for i in range(n - 2, -1, -1):
        for c in range(0, width, 8):
            o = 6 * width * i + c
            for k in range(plan.start[i], plan.start[i + 1]):
                subtract_product(blocks, 48 * plan.upper[k], panel, 6 * width * plan.column[k] + c, width, panel, o, width)
            flush_rows(panel, o, width)


@kernel
def multiply(rows, columns, blocks, x, y_out):
    """y += A x for a list of blocks: rows, columns int64 [n_blocks]; x, y [n, 8]."""
    for k in range(rows.shape[0]):
        yo = 8 * rows[k]
        xo = 8 * columns[k]
        for i in range(6):
            s = 0.0
            for j in range(6):
                s += blocks[48 * k + 8 * i + j] * x[xo + j]
            y_out[yo + i] += s
