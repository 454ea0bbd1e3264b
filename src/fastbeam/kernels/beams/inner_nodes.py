"""Elimination of the inner nodes of elements inside the element loop, eight elements at a time.

A node that only one element touches is eliminated before anything is assembled: the solver sees the end nodes only. Per group
of 8 elements and inner node i, in turn, with the others j behind it (later inner nodes, last node, first node):

    U_ij = K_ii^-1 K_ij,   K_kj -= K_ki U_ij,   y_i = K_ii^-1 r_i,   r_k -= K_ki y_i

and, after the end nodes are known, x_i = y_i - sum_j U_ij x_j in reverse order. Scenes with sliders keep the factors and K_ji
too: columns of their borders take the same way, one element at a time, eight columns at once.

Arrays: scratch [*], numbers of a group in lanes: layout.py has their places; store [*] as `Inner.store`; r, r_out, rhs, x,
x_out, loads [8 (rows + 1)]; panel [rows, n, width] flat.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.blocks import ONE, lu_lanes, solve_lanes, solve_rows, subtract_lanes, subtract_rows
from fastbeam.kernels.algebra.lanes import copy_lanes, gather_lanes, put_rows, scatter_rows
from fastbeam.kernels.algebra.vectors import vld, vst
from fastbeam.kernels.jit.decorators import inlined, kernel
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.layout import FACTORS, LIST, NODES
from fastbeam.kernels.state import halve

PIVOT = 1e-13        # a pivot below this share of its diagonal entry counts as zero


class NoInner(NamedTuple):
    """Placeholder for elements whose inner nodes are not eliminated."""


class NoColumns(NamedTuple):
    """Placeholder for `Inner.rhs` in a scene without sliders, which has no border columns to eliminate."""


# columns of `Inner.where`: offset of the lane of an element in the store, its inner nodes, offset of its rows
PLACE, INNER_NODES, ROWS = range(3)


class Inner(NamedTuple):
    """Factors and index lists of the eliminated nodes."""

    store: np.ndarray     # float64 [*]: per group and inner node its LU, then U_ij, K_ji of every other; without sliders U_ij of
    #                       every other, then y_i
    rhs: np.ndarray | NoColumns  # float64 [8 (N + 1)]: y_i by rows
    where: np.ndarray     # int64 [E, 3]: of every live element: offset of its lane in store, inner nodes, offset in rows
    rows: np.ndarray      # int64 [*]: rows of the nodes of every element, first to last
    element: np.ndarray   # int64 [inner nodes]: element of every row from the first inner row on
    mark: np.ndarray      # int64 [E]: elements that a slider touches, in use
    found: np.ndarray     # int64 [E]: list of these elements
    first: np.ndarray     # int64 [1]: first inner row
    state: np.ndarray     # float64 [1]: 0 where a group was singular


def store_size(nn: int, columns: bool, n: int = 6, with_y: int = 1) -> int:
    """Return the doubles of a group in `store` for n unknowns per node, where columns follow or not; with_y: as in
    `short_store`."""
    return sum(8 * n * n * (1 + 2 * (nn - i)) if columns else 8 * n * (n * (nn - i) + with_y) for i in range(1, nn - 1))


@kernel
def short_store(nn, n, with_y):
    """Return the doubles of a group in `store` without columns; with_y: 1 where y_i stand there, 0 where they do not."""
    doubles = 0
    for i in range(1, nn - 1):
        doubles += 8 * n * (n * (nn - i) + with_y)
    return doubles


# --- kept results of an elimination -------------------------------------------------------------------------------------
class Short(NamedTuple):
    """Kept results of an elimination: U_ij of every other node, then y_i."""

    r: np.ndarray      # float64 [8 rows]: residual, with the loads


class WithColumns(NamedTuple):
    """Kept results of an elimination: factors, then U_ij, K_ji of every other node; y_i by rows."""

    r: np.ndarray      # float64 [8 rows]
    rhs: np.ndarray    # float64 [8 rows]: takes y_i


class Condensed(NamedTuple):
    """Kept results of an elimination: U_ij of every other node; y_i by rows. Only loads act on the nodes."""

    loads: np.ndarray  # float64 [8 rows]
    x: np.ndarray      # float64 [8 rows]: takes y_i


@generic
def clear_rhs(rhs):
    """Set rhs to zero, if the scene has it."""


@generic
def halve_rhs(rhs):
    """Halve rhs, if the scene has it."""


@generic
def kept(rhs, r):
    """Return the record of results that `eliminate_inner` keeps for nodes whose residual stands in r."""


@clear_rhs.register(NoColumns)
@halve_rhs.register(NoColumns)
@kernel
def leave_no_columns(rhs):
    pass


@clear_rhs.register(object)
@kernel
def clear_columns(rhs):
    for i in range(rhs.shape[0]):
        rhs[i] = 0.0


@halve_rhs.register(object)
@kernel
def halve_columns(rhs):
    halve(rhs)


@kept.register(NoColumns)
@inlined
def keep_short(rhs, r):
    return Short(r)


@kept.register(object)
@inlined
def keep_columns(rhs, r):
    return WithColumns(r, rhs)


@generic
def take_loads(keep, tables, at, scratch, ro, temporary, dofs):
    """Add forces of loads and sliders on 8 nodes to their residual at ro."""


@generic
def place(keep, store, d, scratch, temporary, block):
    """Return the places of the results of the elimination of a node, from d on in `store`: (array and offset of the factors of
    K_ii, offset of U_ij of the first other node j, distance to the next)."""


@generic
def keep_lower(keep, scratch, low, store, d, block):
    """Keep a block K_ji."""


@generic
def keep_solution(keep, scratch, y, tables, at, store, d, dofs):
    """Keep y_i of 8 nodes; return the offset of the next node in `store`."""


@take_loads.register(object)
@inlined
def take_rows(keep, tables, at, scratch, ro, temporary, dofs):
    """Add the residual at ro to its rows, which hold those of loads and sliders, and fetch the sum."""
    scatter_rows(scratch, ro, tables.rows, at, 8, 0, keep.r, dofs)
    gather_lanes(keep.r, tables.rows, at, 8, scratch, ro, dofs)


@take_loads.register(Condensed)
@inlined
def take_loads_alone(keep, tables, at, scratch, ro, temporary, dofs):
    subtract_loads(keep.loads, tables, at, scratch, ro, temporary, dofs)


@place.register(object)
@inlined
def place_short(keep, store, d, scratch, temporary, block):
    return scratch, temporary, d, block


@place.register(WithColumns)
@inlined
def place_with_columns(keep, store, d, scratch, temporary, block):
    return store, d, d + block, 2 * block


@keep_lower.register(object)
@inlined
def keep_no_lower(keep, scratch, low, store, d, block):
    pass


@keep_lower.register(WithColumns)
@inlined
def keep_lower_block(keep, scratch, low, store, d, block):
    copy_lanes(scratch, low, block, store, d + block)


@keep_solution.register(Short)
@inlined
def keep_in_store(keep, scratch, y, tables, at, store, d, dofs):
    copy_lanes(scratch, y, 8 * len(dofs), store, d)
    return d + 8 * len(dofs)


@keep_solution.register(WithColumns)
@inlined
def keep_by_rows(keep, scratch, y, tables, at, store, d, dofs):
    scatter_rows(scratch, y, tables.rows, at, 8, 0, keep.rhs, dofs)
    return d


@keep_solution.register(Condensed)
@inlined
def keep_in_rows(keep, scratch, y, tables, at, store, d, dofs):
    put_rows(scratch, y, tables.rows, at, 8, 0, keep.x, dofs)
    return d


# --- elimination --------------------------------------------------------------------------------------------------------
@kernel
def subtract_loads(loads, tables, at, scratch, ro, temporary, dofs):
    """Subtract the loads of 8 nodes from their residual at ro."""
    gather_lanes(loads, tables.rows, at, 8, scratch, temporary, dofs)
    for c in range(0, 8 * len(dofs), 8):
        vst(scratch, ro + c, 0, vld(scratch, ro + c, 0) - vld(scratch, temporary + c, 0))


@kernel
def eliminate_inner(keep, store, io, tables, no, nn, scratch, ro, ko, temporary, dofs):
    """Eliminate the inner nodes of one group: rows at ro, blocks at ko. Returns False, and stops, where a pivot counts as zero.

    store takes what `keep` says, from io on; factors that are not kept go to scratch, a block at `temporary`.
    LU and triangular solutions: explicit inverses would be faster and are not accurate enough, because on slender beams the soft
    directions of the others' stiffness are small differences.
    """
    n = len(dofs)
    block = 8 * n * n
    for i in range(1, nn - 1):
        take_loads.call(keep, tables, no + 8 * i, scratch, ro + 8 * n * i, temporary, dofs)
    d = io
    for i in range(1, nn - 1):
        diagonal = ko + block * (nn * i + i)
        lu, lo, u0, step = place.call(keep, store, d, scratch, temporary, block)
        if not lu_lanes(scratch, diagonal, lu, lo, PIVOT, dofs):
            return False
        y = diagonal     # the diagonal block is needed no more, y takes its place
        solve_lanes(lu, lo, scratch, ro + 8 * n * i, 8, scratch, y, 8, dofs)
        # others: i + 1 .. nn - 1, then 0
        for m in range(nn - i):
            j = i + 1 + m if m < nn - 1 - i else 0
            for c in range(0, 8 * n, 8):
                solve_lanes(lu, lo, scratch, ko + block * (nn * i + j) + c, 8 * n, store, u0 + step * m + c, 8 * n, dofs)
        for m in range(nn - i):
            k = i + 1 + m if m < nn - 1 - i else 0
            low = ko + block * (nn * k + i)
            for l in range(nn - i):
                j = i + 1 + l if l < nn - 1 - i else 0
                subtract_lanes(scratch, low, store, u0 + step * l, scratch, ko + block * (nn * k + j), dofs, dofs)
            subtract_lanes(scratch, low, scratch, y, scratch, ro + 8 * n * k, ONE, dofs)
            keep_lower.call(keep, scratch, low, store, u0 + step * m, block)
        d = keep_solution.call(keep, scratch, y, tables, no + 8 * i, store, u0 + step * (nn - i), dofs)
    return True


@generic
def eliminate_group(inner, tables, k, at, scratch, r_out, dofs):
    """Eliminate the inner nodes of group k if its tables say so; return the distance of the remaining nodes."""


@eliminate_group.register(NoInner)
@inlined
def eliminate_nothing(inner, tables, k, at, scratch, r_out, dofs):
    return 1


@eliminate_group.register(Inner)
@inlined
def eliminate_inside(inner, tables, k, at, scratch, r_out, dofs):
    if tables.meta[k, FACTORS] < 0:
        return 1
    if not eliminate_inner(kept.call(inner.rhs, r_out), inner.store, tables.meta[k, FACTORS], tables, tables.meta[k, LIST], at.nn,
                           scratch, at.rows, at.blocks, 0, dofs):
        inner.state[0] = 0.0
    return at.nn - 1


@kernel
def eliminate_columns(inner, contact, panel, width, dofs):
    """Carry the border columns on inner rows to the end nodes, for the elements that a slider touches."""
    n = len(dofs)
    block = 8 * n * n
    found = 0
    first = inner.first[0]
    for k in range(contact.entries.shape[0]):
        for m in range(contact.entries[k]):
            if contact.row[k, m] >= first:
                e = inner.element[contact.row[k, m] - first]
                if inner.mark[e] == 0:
                    inner.mark[e] = 1
                    inner.found[found] = e
                    found += 1
    for f in range(found):
        e = inner.found[f]
        inner.mark[e] = 0
        d = inner.where[e, PLACE]
        count = inner.where[e, INNER_NODES]
        rows = inner.where[e, ROWS]
        for i in range(1, count + 1):
            others = count + 2 - i
            row = n * width * inner.rows[rows + i]
            for c in range(0, width, 8):
                solve_rows(inner.store, d, 8 * n, 8, panel, row + c, width, dofs)
                for m in range(others):
                    k = i + 1 + m if m < others - 1 else 0
                    subtract_rows(inner.store, d + 2 * block * (m + 1), 8 * n, 8, panel, row + c, width, panel,
                                  n * width * inner.rows[rows + k] + c, width, dofs)
            d += block * (1 + 2 * others)


@kernel
def put_inner_rhs(inner, panel, width, dofs):
    """Store y of the inner rows in column 0 of the panel."""
    n = len(dofs)
    for i in range(inner.first[0], panel.shape[0] // (n * width)):
        for c in range(n):
            panel[(n * i + c) * width] = inner.rhs[8 * i + c]


@kernel
def take_scaled(source, offset, factor, target, to, n):
    """Store factor times n lanes, from source [*] in target [*]."""
    for c in range(0, 8 * n, 8):
        vst(target, to + c, 0, factor * vld(source, offset + c, 0))


class InStore(NamedTuple):
    """Marker: y_i stand behind U_ij."""


class InRows(NamedTuple):
    """Marker: y_i stand in the rows of increments."""


IN_STORE, IN_ROWS = InStore(), InRows()


@generic
def take_solution(where, store, end, tables, at, factor, scratch, xi, x, dofs):
    """Store factor times y_i of 8 nodes in lanes at xi; return the end of U_ij in `store`."""


@take_solution.register(InStore)
@inlined
def take_from_store(where, store, end, tables, at, factor, scratch, xi, x, dofs):
    take_scaled(store, end - 8 * len(dofs), factor, scratch, xi, len(dofs))
    return end - 8 * len(dofs)


@take_solution.register(InRows)
@inlined
def take_from_rows(where, store, end, tables, at, factor, scratch, xi, x, dofs):
    gather_lanes(x, tables.rows, at, 8, scratch, xi, dofs)
    take_scaled(scratch, xi, factor, scratch, xi, len(dofs))
    return end


@kernel
def recover_group(where, store, end, nn, tables, no, factor, scratch, xo, x_out, dofs):
    """Recover increments of the inner nodes of 8 elements from those of the end nodes: nn nodes in lanes from xo on. end: end of
    their stored numbers; where: InStore or InRows; factor: increment per solution."""
    n = len(dofs)
    column = 8 * n
    block = column * n
    for i in range(nn - 2, 0, -1):
        xi = xo + column * i
        end = take_solution.call(where, store, end, tables, no + 8 * i, factor, scratch, xi, x_out, dofs)
        end -= block * (nn - i)
        for m in range(nn - i):
            a = i + 1 + m if m < nn - 1 - i else 0
            subtract_lanes(store, end + block * m, scratch, xo + column * a, scratch, xi, ONE, dofs)
        put_rows(scratch, xi, tables.rows, no + 8 * i, 8, 0, x_out, dofs)


@generic
def recover_rows(inner, tables, factor, x_out, scratch, dofs):
    """Recover increments of all inner nodes of elements with one strain set from those of the end nodes, in a scene without
    sliders."""


@recover_rows.register(NoInner)
@kernel
def recover_nothing(inner, tables, factor, x_out, scratch, dofs):
    pass


@recover_rows.register(Inner)
@kernel
def recover_inner_rows(inner, tables, factor, x_out, scratch, dofs):
    n = len(dofs)
    for k in range(tables.meta.shape[0]):
        if tables.meta[k, FACTORS] >= 0:
            nn = tables.meta[k, NODES]
            no = tables.meta[k, LIST]
            gather_lanes(x_out, tables.rows, no, 8, scratch, 0, dofs)
            gather_lanes(x_out, tables.rows, no + 8 * (nn - 1), 8, scratch, 8 * n * (nn - 1), dofs)
            recover_group(IN_STORE, inner.store, tables.meta[k, FACTORS] + short_store(nn, n, 1), nn, tables, no, factor, scratch,
                          0, x_out, dofs)


@kernel
def recover_inner(inner, panel, width, dofs):
    """Recover solutions of the inner rows of the panel from those of the end nodes, all columns."""
    n = len(dofs)
    block = 8 * n * n
    for e in range(inner.where.shape[0]):
        count = inner.where[e, INNER_NODES]
        rows = inner.where[e, ROWS]
        d = inner.where[e, PLACE]
        for i in range(1, count):
            d += block * (1 + 2 * (count + 2 - i))
        for i in range(count, 0, -1):
            others = count + 2 - i
            row = n * width * inner.rows[rows + i]
            for c in range(0, width, 8):
                for m in range(others):
                    k = i + 1 + m if m < others - 1 else 0
                    subtract_rows(inner.store, d + block * (1 + 2 * m), 8 * n, 8, panel, n * width * inner.rows[rows + k] + c,
                                  width, panel, row + c, width, dofs)
            d -= block * (1 + 2 * (others + 1))
