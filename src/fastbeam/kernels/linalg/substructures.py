"""Beams condensed to their ends, eight at a time: lane l of a group of elements walks along beam l (theory.md 9).

Per element inner nodes are eliminated as in inner_nodes.py. Then, at the present node c between the start o of the beam and the
next node e, with the condensed blocks of the elements behind c (S) and the present element (K),

    A = S_cc + K_cc,   U = A^-1 K_ce,   P = A^-1 S_co,   y = A^-1 r_c
    S_ee = K_ee - K_ec U,   S_eo = - K_ec P,   S_oe = - S_oc U,   S_oo -= S_oc P,   r_e -= K_ec y,   r_o -= S_oc y

and the solver sees the four blocks and two residuals of the ends. Recovered in reverse: x_c = y - U x_e - P x_o.

Threads take groups of beams; each writes only numbers of its beams, and contributions of ends to a block or row are summed up in
a fixed order. Increments are added along with the groups, whose arrays are still in the cache then.

Arrays: scratch [*], numbers of a group in lanes: layout.py has their places, behind them those of the ends; store [*] as
`Substructures.store`; x_out, r_out [8 (rows + 1)]; blocks_out [8 n (blocks + 1)]; nodes [*], row_of [N].
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.blocks import ONE, lu_lanes, solve_lanes, subtract_lanes
from fastbeam.kernels.algebra.lanes import clear_lanes, copy_lanes, gather_lanes, put_rows
from fastbeam.kernels.algebra.vectors import vld, vst
from fastbeam.kernels.beams.element_loop import evaluate_group
from fastbeam.kernels.beams.inner_nodes import (
    IN_ROWS,
    PIVOT,
    Condensed,
    eliminate_inner,
    recover_group,
    short_store,
    store_size,
    subtract_loads,
    take_scaled,
)
from fastbeam.kernels.beams.nodes import larger
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.layout import LIST, POINTS, layout
from fastbeam.kernels.terms import move_nodes, spread_nodes

# columns of `Substructures.group`
FIRST_GROUP, ELEMENTS, NODES_EACH, STORE = range(4)


class Substructures(NamedTuple):
    """Condensed beams, B of them in groups of 8 equal ones, and the work arrays of their elimination; n unknowns a node."""

    group: np.ndarray       # int64 [G, 4]: first group of elements, elements of a beam, nodes of an element, offset in store
    beam: np.ndarray        # int64 [B]: 0 .. B - 1
    block_start: np.ndarray  # int64 [blocks + 1]: range of every block of the tangent in the next
    block_term: np.ndarray  # int64 [4 B]: 4 beam + (0: start-start, 1: start-end, 2: end-start, 3: end-end)
    row_start: np.ndarray   # int64 [rows of ends + 1]: range of every row of the residual in the next
    row_term: np.ndarray    # int64 [2 B]: 2 beam + (0: start, 1: end)
    counts: np.ndarray      # int64 [3]: first row of their interior nodes, which are the last rows; groups with strain set (2.2),
    #                         then with (2.1)
    store: np.ndarray       # float64 [*]: U and P of every interior node, lanes last
    ends: np.ndarray        # float64 [B, 32 n + 16]: four blocks and two residuals, rows padded to 8
    state: np.ndarray       # float64 [G]: 0 where an elimination failed


def place_stores(subs: Substructures, n: int) -> Substructures:
    """Return the beams with n unknowns a node, and room for their elimination."""
    group = subs.group.copy()
    doubles = 16 * n * n * (group[:, ELEMENTS] - 1)
    for nn in np.unique(group[:, NODES_EACH]).tolist():
        doubles += np.where(group[:, NODES_EACH] == nn, group[:, ELEMENTS] * store_size(nn, False, n, 0), 0)
    group[:, STORE] = np.cumsum(doubles) - doubles
    return subs._replace(group=group, store=np.zeros(doubles.sum()), ends=np.zeros(subs.beam.size * (32 * n + 16)),
                         state=np.ones(len(group)))


def front_size(n: int) -> int:
    """Return the doubles of scratch behind those of an element group."""
    return 8 * n * (7 * n + 2)


@kernel
def condense_node(scratch, so, present, nn, tables, no, ro, ko, store, d, x_out, dofs):
    """Eliminate the node between the elements behind it, whose condensed blocks stand from so on, and the present one at ro, ko.
    present: places of S_oc and S_co, 1 or 3 and 2 or 4; y goes to its row of x_out. Return False if a pivot counts as zero."""
    n = len(dofs)
    column = 8 * n
    block = column * n
    last = nn - 1
    oc = so + block * present
    co = oc + 2 * block
    oe = so + block * (3 - present)
    eo = oe + 2 * block
    lu = so + 6 * block
    r = so + 7 * block
    for c in range(0, block, 8):
        vst(scratch, ko + c, 0, vld(scratch, ko + c, 0) + vld(scratch, so + 5 * block + c, 0))
    if not lu_lanes(scratch, ko, scratch, lu, PIVOT, dofs):
        return False
    y = ko    # y replaces the block at ko, which is not needed any more
    for c in range(0, column, 8):
        solve_lanes(scratch, lu, scratch, ko + block * last + c, column, store, d + c, column, dofs)
        solve_lanes(scratch, lu, scratch, co + c, column, store, d + block + c, column, dofs)
    solve_lanes(scratch, lu, scratch, ro, 8, scratch, y, 8, dofs)
    put_rows(scratch, y, tables.rows, no, 8, 0, x_out, dofs)
    ec = ko + block * nn * last
    ee = ec + block * last
    clear_lanes(scratch, oe, block)
    clear_lanes(scratch, eo, block)
    subtract_lanes(scratch, ec, store, d, scratch, ee, dofs, dofs)
    subtract_lanes(scratch, ec, store, d + block, scratch, eo, dofs, dofs)
    subtract_lanes(scratch, oc, store, d, scratch, oe, dofs, dofs)
    subtract_lanes(scratch, oc, store, d + block, scratch, so, dofs, dofs)
    subtract_lanes(scratch, ec, scratch, y, scratch, ro + column * last, ONE, dofs)
    subtract_lanes(scratch, oc, scratch, y, scratch, r, ONE, dofs)
    copy_lanes(scratch, ee, block, scratch, so + 5 * block)
    copy_lanes(scratch, ro + column * last, column, scratch, r + column)
    return True


@kernel
def ends_of_beam(subs, tables, g, lane):
    """Return the nodes at the ends of one beam of a group; those between them are numbered in turn."""
    first = subs.group[g, FIRST_GROUP]
    last = first + subs.group[g, ELEMENTS] - 1
    end = tables.meta[last, LIST] + 8 * (subs.group[g, NODES_EACH] - 1)
    return tables.nodes[tables.meta[first, LIST] + lane], tables.nodes[end + lane]


@kernel
def spread_listed(nodes, first, last, dofs, method, state, work, h):
    """Run `terms.spread_nodes` for the nodes of a list, from `first` to before `last`."""
    for k in range(first, last):
        spread_nodes.call(dofs, method, state, work, h, nodes[k], nodes[k] + 1)


@kernel
def condense(subs, tables, strains, first, last, move, loads, scratch, dofs):
    """Evaluate and condense the groups of beams from `first` to before `last`. move: of motions.py; loads [8 (rows + 1)]. Rows of
    interior nodes in the last increment take their y at once: no later element reads the increments there."""
    x = move.increment.x
    keep = Condensed(loads, x)
    n = len(dofs)
    column = 8 * n
    block = column * n
    per_node = 2 * block
    per_beam = 4 * column + 16
    so = scratch.shape[0] - 7 * block - 2 * column
    r = so + 7 * block
    for g in range(first, last):
        nn = subs.group[g, NODES_EACH]
        inner = short_store(nn, n, 0)
        at = layout(dofs, nn, tables.meta[subs.group[g, FIRST_GROUP], POINTS])
        ro = at.rows
        ko = at.blocks
        d = subs.group[g, STORE] - per_node
        present = 1
        subs.state[g] = 1.0
        for j in range(subs.group[g, ELEMENTS]):
            k = subs.group[g, FIRST_GROUP] + j
            no = tables.meta[k, LIST]
            evaluate_group(tables, k, at, strains, move, scratch, dofs)
            good = eliminate_inner(keep, subs.store, d + per_node, tables, no, nn, scratch, ro, ko, so + 6 * block, dofs)
            if j == 0:
                end = ko + block * (nn - 1)
                copy_lanes(scratch, ko, block, scratch, so)
                copy_lanes(scratch, end, block, scratch, so + block)
                copy_lanes(scratch, end + block * (nn - 1) * (nn - 1), block, scratch, so + 3 * block)
                copy_lanes(scratch, ko + block * (nn * nn - 1), block, scratch, so + 5 * block)
                copy_lanes(scratch, ro, column, scratch, r)
                copy_lanes(scratch, ro + column * (nn - 1), column, scratch, r + column)
            else:
                for c in range(0, column, 8):
                    vst(scratch, ro + c, 0, vld(scratch, ro + c, 0) + vld(scratch, r + column + c, 0))
                subtract_loads(keep.loads, tables, no, scratch, ro, so + 6 * block, dofs)
                good = good and condense_node(scratch, so, present, nn, tables, no, ro, ko, subs.store, d, x, dofs)
                present = 3 - present
            d += per_node + inner
            if not good:
                subs.state[g] = 0.0
                break
        for i in range(n):
            o = so + column * i
            for p in range(4):
                # start-start, start-end, end-start, end-end
                at = o + block * (0 if p == 0 else present if p == 1 else present + 2 if p == 2 else 5)
                put_rows(scratch, at, subs.beam, 8 * g, per_beam, column * p + 8 * i, subs.ends, dofs)
        put_rows(scratch, r, subs.beam, 8 * g, per_beam, 4 * column, subs.ends, dofs)
        put_rows(scratch, r + column, subs.beam, 8 * g, per_beam, 4 * column + 8, subs.ends, dofs)


@kernel
def add_end_blocks(subs, first, last, blocks_out, dofs):
    """Add the blocks of the ends of beams to the blocks of the tangent from `first` to before `last`."""
    n = len(dofs)
    per_beam = 32 * n + 16
    for k in range(first, last):
        for t in range(subs.block_start[k], subs.block_start[k + 1]):
            o = per_beam * (subs.block_term[t] // 4) + 8 * n * (subs.block_term[t] % 4)
            for i in range(0, 8 * n, 8):
                vst(blocks_out, 8 * n * k + i, 0, vld(blocks_out, 8 * n * k + i, 0) + vld(subs.ends, o + i, 0))


@kernel
def add_end_rows(subs, first, last, r_out, dofs):
    """Add the residuals of the ends of beams to the rows from `first` to before `last`."""
    n = len(dofs)
    per_beam = 32 * n + 16
    for k in range(first, last):
        for t in range(subs.row_start[k], subs.row_start[k + 1]):
            o = per_beam * (subs.row_term[t] // 2) + 32 * n + 8 * (subs.row_term[t] % 2)
            vst(r_out, 8 * k, 0, vld(r_out, 8 * k, 0) + vld(subs.ends, o, 0))


@kernel
def recover(subs, tables, first, last, factor, row_of, work, scratch, dofs):
    """Recover increments of the interior nodes of the groups of beams from `first` to before `last` from those of their ends, and
    add them to those of the step; factor: increment per solution, -1 in a step. Return the largest, as `nodes.update_nodes`
    does."""
    n = len(dofs)
    column = 8 * n
    block = column * n
    per_node = 2 * block
    move = 0.0
    spin = 0.0
    for g in range(first, last):
        k0 = subs.group[g, FIRST_GROUP]
        count = subs.group[g, ELEMENTS]
        nn = subs.group[g, NODES_EACH]
        end = column * nn
        inner = short_store(nn, n, 0)
        # start of the beam, then the nodes of an element
        gather_lanes(work.increment.x, tables.rows, tables.meta[k0, LIST], 8, scratch, 0, dofs)
        gather_lanes(work.increment.x, tables.rows, tables.meta[k0 + count - 1, LIST] + 8 * (nn - 1), 8, scratch, end, dofs)
        for j in range(count - 1, -1, -1):
            no = tables.meta[k0 + j, LIST]
            d = subs.group[g, STORE] + j * (per_node + inner) - per_node
            if j == 0:
                copy_lanes(scratch, 0, column, scratch, column)
            else:
                gather_lanes(work.increment.x, tables.rows, no, 8, scratch, column, dofs)
                take_scaled(scratch, column, factor, scratch, column, n)
                subtract_lanes(subs.store, d, scratch, end, scratch, column, ONE, dofs)
                subtract_lanes(subs.store, d + block, scratch, 0, scratch, column, ONE, dofs)
                put_rows(scratch, column, tables.rows, no, 8, 0, work.increment.x, dofs)
            recover_group(IN_ROWS, subs.store, d + per_node + inner, nn, tables, no, factor, scratch, column, work.increment.x,
                          dofs)
            copy_lanes(scratch, column, column, scratch, end)
        for lane in range(8):
            a, b = ends_of_beam(subs, tables, g, lane)
            m, s = move_nodes.call(dofs, row_of, work, a + 1, b, scratch)
            move = larger(m, move)
            spin = larger(s, spin)
    return move, spin


@kernel
def move_listed(nodes, first, last, dofs, row_of, work):
    """Add the increments of the nodes of a list, from `first` to before `last`."""
    move = 0.0
    spin = 0.0
    for k in range(first, last):
        m, s = move_nodes.call(dofs, row_of, work, nodes[k], nodes[k] + 1, work.scratch)
        move = larger(m, move)
        spin = larger(s, spin)
    return move, spin
