"""Block elimination: LU of a sparse matrix of n x n blocks in a fixed order; rows are exchanged inside diagonal blocks only.

Blocks are stored as n rows of 8 doubles, so that a row is one register; block k starts at 8 n k. n = 6 in space, 3 in a plane:
the length of the tuple `size`. The order and the fill come from the compiler of the scene: for chains and trees of beams there
is no fill beyond the elements.
Right-hand sides stand side by side in a panel of `width` doubles a row (a multiple of 8), n rows a node.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._jit import kernel, one_variant
from .algebra import flush_rows, largest_of_row, vld, vst
from .blocks import lu_rows, solve_rows, subtract_rows

# row k: 1 in the columns right of k, 0 in the two that pad a row
RIGHT_OF = (np.triu(np.ones((8, 8)), 1) * (np.arange(8) < 6)).reshape(-1)
# pivots without exchange are good between these shares of their diagonal entries
LOW, HIGH = 1e-6, 1e3


class Elimination(NamedTuple):
    """Order and update lists of the block LU, n rows."""

    diagonal: np.ndarray      # int64 [n]: block of the diagonal
    start: np.ndarray         # int64 [n + 1]: range of row i in the next three
    column: np.ndarray        # int64 [m]: column j > i of an upper block
    upper: np.ndarray         # int64 [m]: block (i, j)
    lower: np.ndarray         # int64 [m]: block (j, i)
    target_start: np.ndarray  # int64 [n]: where the targets of row i begin
    target: np.ndarray        # int64: blocks (j, k) for all j, k of row i, row by row


@one_variant
def exchange_rows(pivots, p, x, o, stride, size):
    """The row exchanges of a factored diagonal block, on n rows of 8 at o, `stride` apart."""
    for k in range(len(size)):
        m = pivots[p + k]
        if m != k:
            t = vld(x, o + k * stride, 0)
            vst(x, o + k * stride, 0, vld(x, o + m * stride, 0))
            vst(x, o + m * stride, 0, t)


@kernel
def exchange_and_factor(blocks, d, pivots, p, size):
    """LU of a diagonal block with row exchanges, reciprocal pivots on the diagonal. Returns the smallest ratio of a pivot to the
    largest entry that its row had: zero where the block is singular or NaN. The ratio does not see that forces and moments have
    different units."""
    n = len(size)
    smallest = np.inf
    for i in range(n):
        # the last pad of a row carries its size through the exchanges
        for j in range(n, 8):
            blocks[d + 8 * i + j] = 0.0
        blocks[d + 8 * i + 7] = largest_of_row(blocks, d + 8 * i)
    for k in range(n):
        m = k
        v = abs(blocks[d + 9 * k])
        for i in range(k + 1, n):
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
        for i in range(k + 1, n):
            f = blocks[d + 8 * i + k] * inverse
            vst(blocks, d + 8 * i, 0, vld(blocks, d + 8 * i, 0) - f * row)
            blocks[d + 8 * i + k] = f
        blocks[d + 9 * k] = inverse
    return smallest


@kernel
def factor(plan, blocks, pivots, panel, width, size):
    """Factor in place: diagonal blocks to LU, upper blocks to D^-1 A; and eliminate the right-hand sides of `panel` on the way
    (None: there are none). pivots [n rows]: the exchanges of a row, -1 first where there are none. Returns the worst pivot ratio
    of the blocks with exchanges, at most 1; stops at a singular block, which returns 0."""
    n = len(size)
    block = 8 * n
    worst = 1.0
    for i in range(plan.diagonal.shape[0]):
        d = block * plan.diagonal[i]
        exchanged = not lu_rows(blocks, d, LOW, HIGH, size)
        pivots[n * i] = -1
        if exchanged:
            ratio = exchange_and_factor(blocks, d, pivots, n * i, size)
            if not ratio > 0.0:
                return 0.0
            worst = min(worst, ratio)
        k0 = plan.start[i]
        k1 = plan.start[i + 1]
        for k in range(k0, k1):
            if exchanged:
                exchange_rows(pivots, n * i, blocks, block * plan.upper[k], 8, size)
            solve_rows(blocks, d, 8, 1, blocks, block * plan.upper[k], 8, size)
        if panel is not None:
            for c in range(0, width, 8):
                o = n * width * i + c
                if exchanged:
                    exchange_rows(pivots, n * i, panel, o, width, size)
                solve_rows(blocks, d, 8, 1, panel, o, width, size)
                flush_rows(panel, o, width, size)
        t = plan.target_start[i]
        for j in range(k0, k1):
            low = block * plan.lower[j]
            for k in range(k0, k1):
                subtract_rows(blocks, low, 8, 1, blocks, block * plan.upper[k], 8, blocks, block * plan.target[t], 8, size)
                t += 1
            if panel is not None:
                for c in range(0, width, 8):
                    subtract_rows(blocks, low, 8, 1, panel, n * width * i + c, width, panel, n * width * plan.column[j] + c,
                                  width, size)
    return worst


@kernel
def back_substitute(plan, blocks, panel, width, size):
    """Solve for all right-hand sides of the panel [rows, n, width] that were eliminated."""
    n = len(size)
    for i in range(plan.diagonal.shape[0] - 2, -1, -1):
        for c in range(0, width, 8):
            o = n * width * i + c
            for k in range(plan.start[i], plan.start[i + 1]):
                subtract_rows(blocks, 8 * n * plan.upper[k], 8, 1, panel, n * width * plan.column[k] + c, width, panel, o, width,
                              size)
            flush_rows(panel, o, width, size)


@kernel
def solve(plan, blocks, pivots, panel, width, size):
    """Solve for all right-hand sides of the panel [rows, n, width] in place, with factors from before."""
    n = len(size)
    for i in range(plan.diagonal.shape[0]):
        for c in range(0, width, 8):
            o = n * width * i + c
            if pivots[n * i] >= 0:
                exchange_rows(pivots, n * i, panel, o, width, size)
            solve_rows(blocks, 8 * n * plan.diagonal[i], 8, 1, panel, o, width, size)
            flush_rows(panel, o, width, size)
            for k in range(plan.start[i], plan.start[i + 1]):
                subtract_rows(blocks, 8 * n * plan.lower[k], 8, 1, panel, o, width, panel, n * width * plan.column[k] + c, width,
                              size)
    back_substitute(plan, blocks, panel, width, size)


@kernel
def multiply(rows, columns, blocks, x, y_out):
    """y += A x for a list of 6 x 6 blocks: rows, columns int64 [n_blocks]; x, y [n, 8]."""
    for k in range(rows.shape[0]):
        yo = 8 * rows[k]
        xo = 8 * columns[k]
        for i in range(6):
            s = 0.0
            for j in range(6):
                s += blocks[48 * k + 8 * i + j] * x[xo + j]
            y_out[yo + i] += s
