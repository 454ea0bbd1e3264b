"""Block elimination: LU of a sparse matrix of 6 x 6 blocks in a fixed order, with pivoting inside the diagonal blocks.

Blocks are stored as 6 rows of 8 doubles, so that a row is one register; block k starts at 48 k. The order and the fill come
from the compiler of the scene: for chains and trees of beams there is no fill beyond the elements.
Right-hand sides stand side by side in a panel of `width` doubles a row (a multiple of 8), 6 rows a node.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._jit import kernel
from .algebra import flush_rows, largest_of_row, vld, vst


# row k: 1 in the columns right of k, 0 in the two that pad a row
RIGHT_OF = (np.triu(np.ones((8, 8)), 1) * (np.arange(8) < 6)).reshape(-1)


class Elimination(NamedTuple):
    """Order and update lists of the block LU, n rows."""

    diagonal: np.ndarray      # int64 [n]: block of the diagonal
    start: np.ndarray         # int64 [n + 1]: range of row i in the next three
    column: np.ndarray        # int64 [m]: column j > i of an upper block
    upper: np.ndarray         # int64 [m]: block (i, j)
    lower: np.ndarray         # int64 [m]: block (j, i)
    target_start: np.ndarray  # int64 [n]: where the targets of row i begin
    target: np.ndarray        # int64: blocks (j, k) for all j, k of row i, row by row


@kernel
def solve_block(blocks, d, pivots, p, x, o, stride):
    """X <- D^-1 X for the factored diagonal block at d and 6 rows of 8 at o, `stride` apart."""
    for k in range(6):
        m = pivots[p + k]
        if m != k:
            t = vld(x, o + k * stride, 0)
            vst(x, o + k * stride, 0, vld(x, o + m * stride, 0))
            vst(x, o + m * stride, 0, t)
    w0 = vld(x, o, 0)
    w1 = vld(x, o + stride, 0) - blocks[d + 8] * w0
    w2 = vld(x, o + 2 * stride, 0) - blocks[d + 16] * w0 - blocks[d + 17] * w1
    w3 = vld(x, o + 3 * stride, 0) - blocks[d + 24] * w0 - blocks[d + 25] * w1 - blocks[d + 26] * w2
    w4 = (vld(x, o + 4 * stride, 0) - blocks[d + 32] * w0 - blocks[d + 33] * w1 - blocks[d + 34] * w2
          - blocks[d + 35] * w3)
    w5 = (vld(x, o + 5 * stride, 0) - blocks[d + 40] * w0 - blocks[d + 41] * w1 - blocks[d + 42] * w2
          - blocks[d + 43] * w3 - blocks[d + 44] * w4)
    # the diagonal holds the reciprocal pivots
    w5 = blocks[d + 45] * w5
    w4 = blocks[d + 36] * (w4 - blocks[d + 37] * w5)
    w3 = blocks[d + 27] * (w3 - blocks[d + 28] * w4 - blocks[d + 29] * w5)
    w2 = blocks[d + 18] * (w2 - blocks[d + 19] * w3 - blocks[d + 20] * w4 - blocks[d + 21] * w5)
    w1 = blocks[d + 9] * (w1 - blocks[d + 10] * w2 - blocks[d + 11] * w3 - blocks[d + 12] * w4 - blocks[d + 13] * w5)
    w0 = blocks[d] * (w0 - blocks[d + 1] * w1 - blocks[d + 2] * w2 - blocks[d + 3] * w3 - blocks[d + 4] * w4
                      - blocks[d + 5] * w5)
    vst(x, o, 0, w0); vst(x, o + stride, 0, w1); vst(x, o + 2 * stride, 0, w2)
    vst(x, o + 3 * stride, 0, w3); vst(x, o + 4 * stride, 0, w4); vst(x, o + 5 * stride, 0, w5)


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
def factor_diagonal(blocks, d, pivots, p):
    """LU of a 6 x 6 block with row exchanges, reciprocal pivots on the diagonal. Returns the smallest ratio of a pivot to the
    largest entry that its row had: zero where the block is singular or NaN. The ratio does not see that forces and moments
    have different units."""
    smallest = np.inf
    for i in range(6):
        # the last pad of a row carries its size through the exchanges
        blocks[d + 8 * i + 7] = 0.0
        blocks[d + 8 * i + 7] = largest_of_row(blocks, d + 8 * i)
    for k in range(6):
        m = k
        v = abs(blocks[d + 9 * k])
        for i in range(k + 1, 6):
            t = abs(blocks[d + 8 * i + k])
            if t > v:
                v = t
                m = i
        # also where the pivot is NaN, which min() would drop
        if not v > 0.0:
            return 0.0
        pivots[p + k] = m
        if m != k:
            t8 = vld(blocks, d + 8 * k, 0)
            vst(blocks, d + 8 * k, 0, vld(blocks, d + 8 * m, 0))
            vst(blocks, d + 8 * m, 0, t8)
        smallest = min(smallest, v / blocks[d + 8 * k + 7])
        inverse = 1.0 / blocks[d + 9 * k]
        # only the columns right of k take part: the factors of earlier columns stand to the left
        row = vld(blocks, d + 8 * k, 0) * vld(RIGHT_OF, 8 * k, 0)
        for i in range(k + 1, 6):
            f = blocks[d + 8 * i + k] * inverse
            vst(blocks, d + 8 * i, 0, vld(blocks, d + 8 * i, 0) - f * row)
            blocks[d + 8 * i + k] = f
        blocks[d + 9 * k] = inverse
    return smallest


@kernel
def factor(plan, blocks, pivots):
    """Factor in place: diagonal blocks to LU, upper blocks to D^-1 A. Returns the worst pivot ratio; stops at a singular block,
    which returns 0."""
    worst = np.inf
    for i in range(plan.diagonal.shape[0]):
        d = 48 * plan.diagonal[i]
        ratio = factor_diagonal(blocks, d, pivots, 6 * i)
        if not ratio > 0.0:
            return 0.0
        worst = min(worst, ratio)
        k0 = plan.start[i]
        k1 = plan.start[i + 1]
        for k in range(k0, k1):
            solve_block(blocks, d, pivots, 6 * i, blocks, 48 * plan.upper[k], 8)
        t = plan.target_start[i]
        for j in range(k0, k1):
            low = 48 * plan.lower[j]
            for k in range(k0, k1):
                subtract_product(blocks, low, blocks, 48 * plan.upper[k], 8, blocks, 48 * plan.target[t], 8)
                t += 1
    return worst


@kernel
def solve(plan, blocks, pivots, panel, width):
    """Solve for all right-hand sides of the panel [n, 6, width] in place."""
    n = plan.diagonal.shape[0]
    for i in range(n):
        for c in range(0, width, 8):
            o = 6 * width * i + c
            solve_block(blocks, 48 * plan.diagonal[i], pivots, 6 * i, panel, o, width)
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
