"""Transposed solutions of a step: nodes alone, and with the dense border of sliders and joints with multipliers (theory.md
(13.9), (13.12)).

Arrays: blocks [8 n (blocks + 1)]; pivots [n rows]; rows, columns [blocks]; x, y_out, shape_out, of_nodes [8 (rows + 1)];
of_border, y [m].
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.adjoint.adjoint_sliders import add_turning
from fastbeam.kernels.algebra.dimensions import dim
from fastbeam.kernels.algebra.lanes import flush_column
from fastbeam.kernels.algebra.vectors import vld, vst
from fastbeam.kernels.beams.nodes import Held
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.linalg.border import solve_dense
from fastbeam.kernels.linalg.chain import NoSide, factor
from fastbeam.kernels.state import copy

# relative residual of a solution with the transposed tangent: refined above the first, not accepted above the second
REFINE_AT, REFUSE_AT = 1e-13, 1e-9
# smallest pivot of the scaled Schur complement
LEAST_PIVOT = 1e-14
# corrections of a solution; beyond the first number only while each halves the residual
CORRECTIONS, MOST_CORRECTIONS = 8, 40


class NoBorder(NamedTuple):
    """Placeholder for scenes without constraints with multipliers."""


class Border(NamedTuple):
    """Adjoint of S sliders, C constraints in all, whose m = C (2 d + 1) unknowns are a dense border."""

    slide: np.ndarray    # float64 [S]: adjoint of places along the curves
    y: np.ndarray        # float64 [m]: solution of a step, one for each equation of a constraint
    right: np.ndarray    # float64 [m]: right-hand side, one for each unknown
    rest: np.ndarray     # float64 [m]
    solved: np.ndarray   # float64 [m, 8 (rows + 1)]: K^-T times the lines of all equations
    schur: np.ndarray    # float64 [m, m]
    factors: np.ndarray  # float64 [m, m]
    scale: np.ndarray    # float64 [m]: scale of the columns of `schur`
    softness: np.ndarray  # float64 [C]: share of a constraint's own entry that regularises it, 0: none


# --- transposed elimination of nodes --------------------------------------------------------------------------------------
@kernel
def add_transposed(rows, columns, blocks, factor, x, y_out, dofs):
    """Add factor K^T x to y_out for blocks at `rows`, `columns`."""
    n = len(dofs)
    for k in range(rows.shape[0]):
        o = 8 * n * k
        xo = 8 * rows[k]
        yo = 8 * columns[k]
        y = vld(y_out, yo, 0)
        for c in range(n):
            y += (factor * x[xo + c]) * vld(blocks, o + 8 * c, 0)
        vst(y_out, yo, 0, y)


@kernel
def take_transposed(blocks, b, x, xo, yo, dofs):
    """Subtract B^T x[xo] from x[yo] for the block at b, rows of 8."""
    y = vld(x, yo, 0)
    for c in range(len(dofs)):
        y -= x[xo + c] * vld(blocks, b + 8 * c, 0)
    vst(x, yo, 0, y)


@kernel
def solve_diagonal(blocks, d, pivots, p, x, o, dofs):
    """Solve x[o] <- D^-T x[o] with the factors of a diagonal block and their exchanges."""
    n = len(dofs)
    for i in range(n):
        s = x[o + i]
        for j in range(i):
            s -= blocks[d + 8 * j + i] * x[o + j]
        x[o + i] = s * blocks[d + 9 * i]
    for i in range(n - 1, -1, -1):
        s = x[o + i]
        for j in range(i + 1, n):
            s -= blocks[d + 8 * j + i] * x[o + j]
        x[o + i] = s
    if pivots[p] >= 0:
        for k in range(n - 1, -1, -1):
            m = pivots[p + k]
            t = x[o + k]
            x[o + k] = x[o + m]
            x[o + m] = t


@kernel
def solve_transposed(plan, blocks, pivots, x, dofs):
    """Solve x <- K^-T x with factors of `chain.factor`, K = L U: U has D^-1 K_ij, L has the factored diagonal blocks and K_ji."""
    n = len(dofs)
    block = 8 * n
    for i in range(plan.diagonal.shape[0]):
        for k in range(plan.start[i], plan.start[i + 1]):
            take_transposed(blocks, block * plan.upper[k], x, 8 * i, 8 * plan.column[k], dofs)
    for i in range(plan.diagonal.shape[0] - 1, -1, -1):
        for k in range(plan.start[i], plan.start[i + 1]):
            take_transposed(blocks, block * plan.lower[k], x, 8 * plan.column[k], 8 * i, dofs)
        solve_diagonal(blocks, block * plan.diagonal[i], pivots, n * i, x, 8 * i, dofs)
        flush_column(x, 8 * i, 1, dofs)


@kernel
def factor_step(plan, adjoint, system):
    """Keep the tangent, and factor it; return False if it is singular."""
    work = system.work
    for i in range(adjoint.kept.shape[0]):
        adjoint.kept[i] = work.blocks[i]
    # NaN fails the comparison too
    return factor(plan, work.blocks, work.pivots, NoSide(), system.dofs) > 1e-14


@kernel
def relative(rest, of, dofs):
    """Return the ratio of the norms of the rows of `rest` [8 (rows + 1)] and of `of` [8 (rows + 1)]."""
    size = 0.0
    left = 0.0
    for i in range(0, rest.shape[0] - 8, 8):
        for c in range(len(dofs)):
            size += of[i + c] * of[i + c]
            left += rest[i + c] * rest[i + c]
    return np.sqrt(left / size) if size > 0.0 else np.sqrt(left)


@kernel
def node_residual(adjoint, dofs):
    """Form adjoint.rest = right - K^T x with the kept tangent."""
    copy(adjoint.right, adjoint.rest)
    add_transposed(adjoint.block_row, adjoint.block_column, adjoint.kept, -1.0, adjoint.x, adjoint.rest, dofs)


@generic
def drop_held(term, dofs, shape_out):
    """Set prescribed unknowns of the rows to zero."""


@drop_held.register(Held)
@kernel
def drop_held_rows(held, dofs, shape_out):
    for k in range(held.row.shape[0]):
        for c in range(len(dofs)):
            if (held.mask[k] >> c) & 1:
                shape_out[8 * held.row[k] + c] = 0.0


# --- by the border --------------------------------------------------------------------------------------------------------
@generic
def put_slides(border, system, steps, k, at, to):
    """Store forces of constraints in step k, and places of sliders at its start, row `at`, and at its end, row `to`."""


@generic
def begin_border(border, system):
    """Form the right-hand side of the border."""


@generic
def solve_step(border, plan, terms, adjoint, system):
    """Solve with the transposed tangent in system.work.blocks, refined as needed; return False if that fails."""


@generic
def end_border(border, system, of_nodes, shape_out):
    """Add the contribution of the border of the step backward in time to the adjoint of the start; of_nodes: the solution."""


@generic
def equations_product(border, system, y):
    """Return the residuals of the equations of constraints times y."""


@equations_product.register(NoBorder)
@kernel
def no_equations(border, system, y):
    return 0.0


@equations_product.register(Border)
@kernel
def product_with_equations(border, system, y):
    contact = system.contact
    size = 2 * dim(system.dofs) + 1
    s = 0.0
    for k in range(contact.entries.shape[0]):
        for i in range(size):
            s += y[size * k + i] * contact.residual[k, i]
    return s


@put_slides.register(NoBorder)
@kernel
def put_no_slides(border, system, steps, k, at, to):
    pass


@begin_border.register(NoBorder)
@kernel
def begin_no_border(border, system):
    pass


@end_border.register(NoBorder)
@kernel
def end_no_border(border, system, of_nodes, shape_out):
    pass


@solve_step.register(NoBorder)
@kernel
def solve_nodes(border, plan, terms, adjoint, system):
    work, dofs = system.work, system.dofs
    if not factor_step(plan, adjoint, system):
        return False
    copy(adjoint.right, adjoint.x)
    solve_transposed(plan, work.blocks, work.pivots, adjoint.x, dofs)
    node_residual(adjoint, dofs)
    left = relative(adjoint.rest, adjoint.right, dofs)
    for _ in range(3):
        if left <= REFINE_AT:
            break
        solve_transposed(plan, work.blocks, work.pivots, adjoint.rest, dofs)
        for i in range(adjoint.x.shape[0]):
            adjoint.x[i] += adjoint.rest[i]
        node_residual(adjoint, dofs)
        left = relative(adjoint.rest, adjoint.right, dofs)
    return left <= REFUSE_AT


@put_slides.register(Border)
@kernel
def put_places(border, system, steps, k, at, to):
    state, work = system.state, system.work
    for i in range(state.s.shape[0]):
        state.s[i] = steps.s[at, i]
        work.s_end[i] = steps.s[to, i]
    for i in range(state.force.shape[0]):
        state.force[i] = steps.force[k, i]


@begin_border.register(Border)
@kernel
def begin_sliders(border, system):
    d = dim(system.dofs)
    for j in range(border.right.shape[0]):
        border.right[j] = 0.0
    for k in range(border.slide.shape[0]):
        border.right[(2 * d + 1) * k + d] = border.slide[k]


@kernel
def touches(contact, k, i, dofs):
    """Return whether equation i of constraint k depends on a node."""
    n = len(dofs)
    for m in range(contact.entries[k]):
        for c in range(n):
            if contact.line[k, 8 * (n * m + c) + i] != 0.0:
                return True
    return False


@kernel
def solve_lines(border, plan, terms, system):
    """Solve K^-T times the lines of all equations."""
    contact, work, dofs, solved = system.contact, system.work, system.dofs, border.solved
    n = len(dofs)
    size = 2 * dim(dofs) + 1
    for e in range(solved.shape[0]):
        k = e // size
        i = e - size * k
        for j in range(solved.shape[1]):
            solved[e, j] = 0.0
        for m in range(contact.entries[k]):
            for c in range(n):
                solved[e, 8 * contact.row[k, m] + c] += contact.line[k, 8 * (n * m + c) + i]
        if touches(contact, k, i, dofs):
            drop_held.each(terms, dofs, solved[e])
            solve_transposed(plan, work.blocks, work.pivots, solved[e], dofs)


@kernel
def column_product(contact, k, j, x, dofs):
    """Return the column of unknown j of constraint k times x."""
    n = len(dofs)
    s = 0.0
    for m in range(contact.entries[k]):
        for c in range(n):
            s += contact.column[k, 8 * (n * m + c) + j] * x[8 * contact.row[k, m] + c]
    return s


@kernel
def column_size(contact, k, j, x, dofs):
    """Return the sum of the squares of the terms of `column_product`."""
    n = len(dofs)
    s = 0.0
    for m in range(contact.entries[k]):
        for c in range(n):
            s += (contact.column[k, 8 * (n * m + c) + j] * x[8 * contact.row[k, m] + c])**2
    return s


@kernel
def fill_schur(border, system):
    """Form the Schur complement, its columns of gaps in units of the compliance of the parts that a constraint joins; regularised
    if constraints may be redundant, as theory.md (5.5)."""
    contact, schur, dofs = system.contact, border.schur, system.dofs
    size = 2 * dim(dofs) + 1
    for row in range(schur.shape[0]):
        k = row // size
        for e in range(schur.shape[0]):
            schur[row, e] = -column_product(contact, k, row - size * k, border.solved[e], dofs)
            border.scale[e] = 1.0
        for i in range(size):
            schur[row, size * k + i] += contact.corner[k, 8 * i + row - size * k]
    # s of a sleeve stands in the equations of its moments, these in its sliding equation
    for o in range(contact.pair.shape[0]):
        slide = size * contact.pair[o, 0] + dim(dofs)
        moments = size * contact.pair[o, 1]
        for a in range(contact.forces[contact.pair[o, 1]]):
            schur[moments + a, slide] += contact.cross[o, 0, a]
            schur[slide, moments + a] += contact.cross[o, 1, a]
    for k in range(contact.entries.shape[0]):
        o = size * k
        largest = 0.0
        for j in range(contact.forces[k]):
            # the moment that stays zero has no equation
            if touches(contact, k, j, dofs):
                largest = max(largest, abs(schur[o + j, o + j]))
        for j in range(o, o + contact.forces[k]):
            if touches(contact, k, j - o, dofs) and largest > 0.0:
                schur[j, j] += border.softness[k] * largest
                border.scale[j] = largest
                for i in range(schur.shape[0]):
                    schur[i, j] /= largest


@kernel
def rest_of_sleeves(border, contact, row, rest, dofs):
    """Return `rest` of unknown `row` less its products with equations of other constraints, and the sum of the squares of
    these."""
    size = 2 * dim(dofs) + 1
    whole = 0.0
    for o in range(contact.pair.shape[0]):
        slide = size * contact.pair[o, 0] + dim(dofs)
        moments = size * contact.pair[o, 1]
        for a in range(contact.forces[contact.pair[o, 1]]):
            part = 0.0
            if row == moments + a:
                part = contact.cross[o, 0, a] * border.y[slide]
            elif row == slide:
                part = contact.cross[o, 1, a] * border.y[moments + a]
            rest -= part
            whole += part * part
    return rest, whole


@kernel
def border_residual(border, terms, adjoint, system):
    """Form residuals of nodes and border in adjoint.rest and border.rest; return them relative to the terms of their sums."""
    contact, dofs = system.contact, system.dofs
    n = len(dofs)
    size = 2 * dim(dofs) + 1
    node_residual(adjoint, dofs)
    whole = 0.0
    left = 0.0
    for row in range(border.y.shape[0]):
        k = row // size
        j = row - size * k
        rest = border.right[row] - column_product(contact, k, j, adjoint.x, dofs)
        # products may cancel: those of a joint that fixes a length vanish
        whole += column_size(contact, k, j, adjoint.x, dofs) + border.right[row] * border.right[row]
        for i in range(size):
            rest -= contact.corner[k, 8 * i + j] * border.y[size * k + i]
            whole += (contact.corner[k, 8 * i + j] * border.y[size * k + i])**2
        rest, crossed = rest_of_sleeves(border, contact, row, rest, dofs)
        whole += crossed
        border.rest[row] = rest
        left += rest * rest
        # here `row` numbers equations
        for m in range(contact.entries[k]):
            for c in range(n):
                adjoint.rest[8 * contact.row[k, m] + c] -= contact.line[k, 8 * (n * m + c) + j] * border.y[row]
    add_turning.each(terms, system, adjoint.x, adjoint.rest)
    drop_held.each(terms, dofs, adjoint.rest)
    of_border = np.sqrt(left / whole) if whole > 0.0 else np.sqrt(left)
    # the right-hand side may consist of forces of constraints only
    for i in range(adjoint.both.shape[0]):
        adjoint.both[i] = abs(adjoint.right[i]) + abs(adjoint.right[i] - adjoint.rest[i])
    return max(relative(adjoint.rest, adjoint.both, dofs), of_border)


@kernel
def correct(border, plan, adjoint, system):
    """Add the solution for the residuals; return False if the complement is singular."""
    work, contact, dofs, t = system.work, system.contact, system.dofs, border.rest
    size = 2 * dim(dofs) + 1
    solve_transposed(plan, work.blocks, work.pivots, adjoint.rest, dofs)
    for row in range(t.shape[0]):
        t[row] -= column_product(contact, row // size, row % size, adjoint.rest, dofs)
    for i in range(t.shape[0]):
        for j in range(t.shape[0]):
            border.factors[i, j] = border.schur[i, j]
    if solve_dense(border.factors, t, t.shape[0], LEAST_PIVOT) >= 0:
        return False
    for i in range(adjoint.x.shape[0]):
        adjoint.x[i] += adjoint.rest[i]
    for e in range(t.shape[0]):
        z = t[e] / border.scale[e]
        border.y[e] += z
        for i in range(adjoint.x.shape[0]):
            adjoint.x[i] -= border.solved[e, i] * z
    return True


@solve_step.register(Border)
@kernel
def solve_with_border(border, plan, terms, adjoint, system):
    if not factor_step(plan, adjoint, system):
        return False
    solve_lines(border, plan, terms, system)
    fill_schur(border, system)
    for i in range(adjoint.x.shape[0]):
        adjoint.x[i] = 0.0
    for e in range(border.y.shape[0]):
        border.y[e] = 0.0
    before = left = np.inf
    border_residual(border, terms, adjoint, system)
    for i in range(MOST_CORRECTIONS):
        if not correct(border, plan, adjoint, system):
            return False
        before = left
        left = border_residual(border, terms, adjoint, system)
        if left <= REFINE_AT or (i + 1 >= CORRECTIONS and not left < 0.5 * before):
            break
    return left <= REFUSE_AT


@end_border.register(Border)
@kernel
def end_sliders(border, system, of_nodes, shape_out):
    """Add the contribution of sliders to the adjoint of the start. Gaps belong to the end of a step alone. The mean gap is an
    unknown only to keep nodes apart: it follows from the places."""
    contact, dofs = system.contact, system.dofs
    n, d = len(dofs), dim(dofs)
    for k in range(border.slide.shape[0]):
        o = (2 * d + 1) * k
        slip = border.y[o + d]
        slide = -column_product(contact, k, d, of_nodes, dofs) - contact.corner[k, 9 * d] * slip
        for j in range(d + 1, 2 * d + 1):
            border.rest[o + j] = column_product(contact, k, j, of_nodes, dofs)
            slide += contact.corner[k, 8 * j + d] * border.rest[o + j]
        for m in range(contact.entries[k]):
            for c in range(n):
                p = 8 * (n * m + c)
                z = -contact.line[k, p + d] * slip
                for j in range(d + 1, 2 * d + 1):
                    z += contact.line[k, p + j] * border.rest[o + j]
                shape_out[8 * contact.row[k, m] + c] += z
        border.slide[k] = slide
    # moments turn with the spin of the holder
    copy_of = n - d
    for o in range(contact.pair.shape[0]):
        c = contact.pair[o, 1]
        for j in range(copy_of, 2 * copy_of):
            z = column_product(contact, c, j, of_nodes, dofs)
            for m in range(contact.entries[c]):
                for i in range(n):
                    shape_out[8 * contact.row[c, m] + i] += contact.line[c, 8 * (n * m + i) + j] * z
