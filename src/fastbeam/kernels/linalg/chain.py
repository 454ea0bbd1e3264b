"""Block elimination: LU of a sparse matrix of n x n blocks in a fixed order; rows are exchanged inside diagonal blocks only.

Blocks are stored as n rows of 8 doubles, so that a row is one register; block k starts at 8 n k. n = 6 in space, 3 in a plane:
the length of the tuple `dofs`. The order and the fill come from the compiler of the scene: for chains and trees of beams there
is no fill beyond the elements.
Right-hand sides are one of three types: `RightSides`, side by side in a panel; `OneSide`, which goes along in the columns that
pad the blocks; `NoSide`.

Arrays: blocks [8 n (blocks + 1)]; pivots [n rows], of each row those of its diagonal block; panel [rows, n, width] flat.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.blocks import (
    lu_rows,
    lu_two,
    solve_column,
    solve_rows,
    solve_rows_with_column,
    subtract_column,
    subtract_rows,
)
from fastbeam.kernels.algebra.lanes import flush_column, flush_rows
from fastbeam.kernels.algebra.vectors import largest_of_row, vld, vst
from fastbeam.kernels.jit.decorators import inlined, kernel, one_variant, separate
from fastbeam.kernels.jit.generic import generic

# row k of this mask: 1 in the columns right of k, 0 in the others and in the two that pad a row
RIGHT_OF = (np.triu(np.ones((8, 8)), 1) * (np.arange(8) < 6)).reshape(-1)
# pivots without exchange are good between these shares of their diagonal entries
LOW, HIGH = 1e-6, 1e3
# pivots of a row without exchanges
NONE = np.array([-1])


class Elimination(NamedTuple):
    """Order and update lists of the block LU, n rows."""

    diagonal: np.ndarray      # int64 [n]: block of the diagonal
    start: np.ndarray         # int64 [n + 1]: range of row i in the next three
    column: np.ndarray        # int64 [m]: column j > i of an upper block
    upper: np.ndarray         # int64 [m]: block (i, j)
    lower: np.ndarray         # int64 [m]: block (j, i)
    target_start: np.ndarray  # int64 [n]: where the targets of row i begin
    target: np.ndarray        # int64 [*]: blocks (j, k) for all j, k of row i, row by row


@one_variant
def exchange_rows(pivots, p, x, o, stride, dofs):
    """Apply the row exchanges of a factored diagonal block to n rows of 8 in x [*], from o on and `stride` doubles apart."""
    for k in range(len(dofs)):
        m = pivots[p + k]
        if m != k:
            t = vld(x, o + k * stride, 0)
            vst(x, o + k * stride, 0, vld(x, o + m * stride, 0))
            vst(x, o + m * stride, 0, t)


@kernel
def exchange_and_factor(blocks, d, pivots, p, dofs):
    """Factor a diagonal block with row exchanges, reciprocal pivots on the diagonal. Return the smallest ratio of a pivot to the
    largest entry that its row had: zero if the block is singular or NaN. The ratio does not see that forces and moments have
    different units."""
    n = len(dofs)
    smallest = np.inf
    for i in range(n):
        # the last padding column holds the largest entry of a row, so that it is exchanged with the row
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
def exchange_and_solve(blocks, d, pivots, p, panel, row, width, dofs):
    """Solve with D for right-hand sides of a row of the panel, and set tiny numbers to zero."""
    for o in range(len(dofs) * width * row, len(dofs) * width * row + width, 8):
        if pivots[p] >= 0:
            exchange_rows(pivots, p, panel, o, width, dofs)
        solve_rows(blocks, d, 8, 1, panel, o, width, dofs)
        flush_rows(panel, o, width, dofs)


@kernel
def subtract_product(blocks, k, panel, row, target, width, dofs):
    """Subtract block k times right-hand sides of `row` from those of row `target`."""
    n = len(dofs)
    for c in range(0, width, 8):
        subtract_rows(blocks, 8 * n * k, 8, 1, panel, n * width * row + c, width, panel, n * width * target + c, width, dofs)


@kernel
def take_padding(blocks, d, panel, o, pivots, p, dofs):
    """Add to a single right-hand side its part in the column that pads the diagonal block, where products with earlier rows have
    been subtracted, and exchange its rows as those of the block."""
    n = len(dofs)
    for c in range(n):
        panel[o + c] += blocks[d + 8 * c + n]
        blocks[d + 8 * c + n] = 0.0
    if pivots[p] >= 0:
        for k in range(n):
            m = pivots[p + k]
            t = panel[o + k]
            panel[o + k] = panel[o + m]
            panel[o + m] = t


# --- right-hand sides ---------------------------------------------------------------------------------------------------
class NoSide(NamedTuple):
    """Right-hand sides: none, only factors are wanted."""


class OneSide(NamedTuple):
    """Single right-hand side. It goes along in the first column behind the n of the first upper block of every row and of the
    diagonal blocks, where it costs nothing; `panel` has it where a row has no upper block."""

    panel: np.ndarray    # float64 [n rows]


class RightSides(NamedTuple):
    """Several right-hand sides, `width` doubles a row, a multiple of 8."""

    panel: np.ndarray    # float64 [rows, n, width] flat
    width: int


@generic
def take_row(sides, blocks, d, r, pivots, dofs):
    """Prepare and finish the right-hand sides of row r, before and after its diagonal block is factored with row exchanges."""


@generic
def solve_upper(sides, blocks, d, u, r, is_first, dofs):
    """Solve with D for the upper block at u of row r."""


@generic
def solve_row(sides, blocks, d, r, has_upper, pivots, dofs):
    """Solve with D for the right-hand sides of row r."""


@generic
def subtract_row(sides, plan, blocks, j, r, dofs):
    """Subtract lower block j times right-hand sides of row r from those of the row of the block."""


@generic
def substitute_row(sides, plan, blocks, i, dofs):
    """Substitute in the right-hand sides of row i, which has upper blocks, those behind it."""


@take_row.register(object)
@inlined
def take_nothing(sides, blocks, d, r, pivots, dofs):
    pass


@take_row.register(OneSide)
@inlined
def take_one(sides, blocks, d, r, pivots, dofs):
    take_padding(blocks, d, sides.panel, len(dofs) * r, pivots, len(dofs) * r, dofs)


@solve_upper.register(object)
@inlined
def solve_block(sides, blocks, d, u, r, is_first, dofs):
    solve_rows(blocks, d, 8, 1, blocks, u, 8, dofs)


@solve_upper.register(OneSide)
@inlined
def solve_block_and_one(sides, blocks, d, u, r, is_first, dofs):
    if is_first:
        solve_rows_with_column(blocks, d, blocks, u, sides.panel, len(dofs) * r, dofs)
    else:
        solve_rows(blocks, d, 8, 1, blocks, u, 8, dofs)


@solve_row.register(NoSide)
@inlined
def solve_nothing(sides, blocks, d, r, has_upper, pivots, dofs):
    pass


@solve_row.register(OneSide)
@inlined
def solve_one(sides, blocks, d, r, has_upper, pivots, dofs):
    if not has_upper:
        take_padding(blocks, d, sides.panel, len(dofs) * r, NONE, 0, dofs)
        solve_column(blocks, d, 8, 1, sides.panel, len(dofs) * r, 1, dofs)
        flush_column(sides.panel, len(dofs) * r, 1, dofs)


@solve_row.register(RightSides)
@inlined
def solve_several(sides, blocks, d, r, has_upper, pivots, dofs):
    exchange_and_solve(blocks, d, pivots, len(dofs) * r, sides.panel, r, sides.width, dofs)


@subtract_row.register(NoSide)
@inlined
def subtract_nothing(sides, plan, blocks, j, r, dofs):
    pass


@subtract_row.register(OneSide)
@inlined
def subtract_one(sides, plan, blocks, j, r, dofs):
    """Subtract for lower blocks behind the first. The first upper block holds the right-hand side in its padding, so the product
    of blocks has subtracted that already."""
    n = len(dofs)
    first = plan.start[r]
    if j > first:
        subtract_column(blocks, 8 * n * plan.lower[j], 8, 1, blocks, 8 * n * plan.upper[first] + n, 8, blocks,
                        8 * n * plan.diagonal[plan.column[j]] + n, 8, dofs)


@subtract_row.register(RightSides)
@inlined
def subtract_several(sides, plan, blocks, j, r, dofs):
    subtract_product(blocks, plan.lower[j], sides.panel, r, plan.column[j], sides.width, dofs)


@substitute_row.register(OneSide)
@inlined
def substitute_one(sides, plan, blocks, i, dofs):
    n = len(dofs)
    panel = sides.panel
    for c in range(n):
        panel[n * i + c] = blocks[8 * (n * plan.upper[plan.start[i]] + c) + n]
    for k in range(plan.start[i], plan.start[i + 1]):
        subtract_column(blocks, 8 * n * plan.upper[k], 8, 1, panel, n * plan.column[k], 1, panel, n * i, 1, dofs)
    flush_column(panel, n * i, 1, dofs)


@substitute_row.register(RightSides)
@inlined
def substitute_several(sides, plan, blocks, i, dofs):
    panel, width = sides.panel, sides.width
    for k in range(plan.start[i], plan.start[i + 1]):
        subtract_product(blocks, plan.upper[k], panel, plan.column[k], i, width, dofs)
    for o in range(len(dofs) * width * i, len(dofs) * width * i + width, 8):
        flush_rows(panel, o, width, dofs)


# --- factors and solution -----------------------------------------------------------------------------------------------
@separate
def factor(plan, blocks, pivots, sides, dofs):
    """Factor in place: diagonal blocks to LU, upper blocks to D^-1 A; and eliminate right-hand sides on the way. pivots [n rows]:
    the exchanges of a row, -1 first where there are none. Return the worst pivot ratio of the blocks with exchanges, at most 1;
    stop at a singular block, and return 0."""
    n = len(dofs)
    block = 8 * n
    worst = 1.0
    rows = plan.diagonal.shape[0]
    i = 0
    while i < rows:
        # two rows at a time where the second does not wait for the first
        end = i + 2
        if end > rows or (plan.start[i] < plan.start[i + 1] and plan.column[plan.start[i]] == i + 1):
            end = i + 1
        factored = False
        if end == i + 2:
            factored = lu_two(blocks, block * plan.diagonal[i], block * plan.diagonal[i + 1], LOW, HIGH, dofs)
        for r in range(i, end):
            d = block * plan.diagonal[r]
            pivots[n * r] = -1
            if not factored and not lu_rows(blocks, d, LOW, HIGH, dofs):
                take_row.call(sides, blocks, d, r, pivots, dofs)
                ratio = exchange_and_factor(blocks, d, pivots, n * r, dofs)
                if not ratio > 0.0:
                    return 0.0
                worst = min(worst, ratio)
                take_row.call(sides, blocks, d, r, pivots, dofs)
        for r in range(i, end):
            d = block * plan.diagonal[r]
            first = plan.start[r]
            for k in range(first, plan.start[r + 1]):
                if pivots[n * r] >= 0:
                    exchange_rows(pivots, n * r, blocks, block * plan.upper[k], 8, dofs)
                solve_upper.call(sides, blocks, d, block * plan.upper[k], r, k == first, dofs)
            solve_row.call(sides, blocks, d, r, first < plan.start[r + 1], pivots, dofs)
        for r in range(i, end):
            t = plan.target_start[r]
            first = plan.start[r]
            for j in range(first, plan.start[r + 1]):
                low = block * plan.lower[j]
                for k in range(first, plan.start[r + 1]):
                    subtract_rows(blocks, low, 8, 1, blocks, block * plan.upper[k], 8, blocks, block * plan.target[t], 8, dofs)
                    t += 1
                subtract_row.call(sides, plan, blocks, j, r, dofs)
        i = end
    return worst


@separate
def back_substitute(plan, blocks, sides, dofs):
    """Solve for all right-hand sides that were eliminated."""
    for i in range(plan.diagonal.shape[0] - 1, -1, -1):
        if plan.start[i] < plan.start[i + 1]:
            substitute_row.call(sides, plan, blocks, i, dofs)


@kernel
def solve(plan, blocks, pivots, panel, width, dofs):
    """Solve for all right-hand sides of the panel [rows, n, width] in place, with factors from before."""
    n = len(dofs)
    for i in range(plan.diagonal.shape[0]):
        exchange_and_solve(blocks, 8 * n * plan.diagonal[i], pivots, n * i, panel, i, width, dofs)
        for k in range(plan.start[i], plan.start[i + 1]):
            subtract_product(blocks, plan.lower[k], panel, i, plan.column[k], width, dofs)
    back_substitute(plan, blocks, RightSides(panel, width), dofs)


@kernel
def multiply(rows, columns, blocks, x, y_out):
    """Add A x to y for a list of K blocks of 6 x 6: rows, columns [K] and blocks [48 K]; x, y_out [8 n]."""
    for k in range(rows.shape[0]):
        yo = 8 * rows[k]
        xo = 8 * columns[k]
        for i in range(6):
            s = 0.0
            for j in range(6):
                s += blocks[48 * k + 8 * i + j] * x[xo + j]
            y_out[yo + i] += s
