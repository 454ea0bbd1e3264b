"""Elimination of the inner nodes of elements inside the element loop, eight elements at a time.

A node that only one element touches is eliminated before anything is assembled: the solver sees the end nodes only. Per group
of 8 elements and inner node i, in turn, with the others j behind it (later inner nodes, last node, first node):

    U_ij = K_ii^-1 K_ij,   K_kj -= K_ki U_ij,   y_i = K_ii^-1 r_i,   r_k -= K_ki y_i

and, after the end nodes are known, x_i = y_i - sum_j U_ij x_j in reverse order. Scenes with sliders keep the factors and K_ji
too: columns of their borders take the same way, one element at a time, eight columns at once.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._jit import kernel
from .algebra import vld, vst
from .blocks import ONE, lu_lanes, solve_lanes, solve_rows, subtract_lanes, subtract_rows
from .rows import copy_lanes, gather_lanes, put_rows, scatter_rows

PIVOT = 1e-13        # a pivot below this share of its diagonal entry is none


class Inner(NamedTuple):
    """Factors and index lists of the eliminated nodes; None in a model without any."""

    store: np.ndarray     # float64: per group and inner node its LU, then U_ij, K_ji of every other; without sliders U_ij of
    #                       every other, then y_i
    rhs: np.ndarray | None  # float64 [8 (N + 1)]: y_i by rows; None in a scene without sliders, where no columns follow
    where: np.ndarray     # int64 [E, 3]: of every live element: offset of its lane in store, inner nodes, offset in rows
    rows: np.ndarray      # int64: rows of the nodes of every element, first to last
    element: np.ndarray   # int64 [inner nodes]: element of every row from the first inner row on
    mark: np.ndarray      # int64 [E]: elements that a slider touches, in use
    found: np.ndarray     # int64 [E]: list of those
    first: np.ndarray     # int64 [1]: first inner row
    state: np.ndarray     # float64 [1]: 0 where a group was singular


def store_size(nn: int, columns: bool, n: int = 6, with_y: int = 1) -> int:
    """Doubles of a group in `store` for n unknowns per node, where columns follow or not; with_y: as in `short_store`."""
    return sum(8 * n * n * (1 + 2 * (nn - i)) if columns else 8 * n * (n * (nn - i) + with_y) for i in range(1, nn - 1))


@kernel
def short_store(nn, n, with_y):
    """The same without columns; with_y: 1 where y_i stand there, 0 where they do not."""
    room = 0
    for i in range(1, nn - 1):
        room += 8 * n * (n * (nn - i) + with_y)
    return room


@kernel
def clear_rhs(rhs):
    """Zero, where there is any."""
    if rhs is not None:
        for i in range(rhs.shape[0]):
            rhs[i] = 0.0


@kernel
def subtract_loads(loads, tables, at, scratch, ro, spare, size):
    """Take the loads of 8 nodes from their rows at ro."""
    gather_lanes(loads, tables.rows, at, 8, scratch, spare, size)
    for c in range(0, 8 * len(size), 8):
        vst(scratch, ro + c, 0, vld(scratch, ro + c, 0) - vld(scratch, spare + c, 0))


@kernel
def eliminate_inner(store, io, nn, tables, no, scratch, ro, ko, r_out, loads, rhs_out, x_out, spare, size):
    """Eliminate the inner nodes of one group: rows at ro, blocks at ko. Their own residual goes to r_out and comes back with
    what loads and sliders put there; without r_out (None) nothing but `loads` act on them. Returns False, and stops, where a
    pivot is none.

    store, from io on: of every node its factors, then U_ij, K_ji of every other; y_i go to rhs_out, by rows. Where rhs_out is
    None no columns follow: only U_ij and y_i are stored, factors take the room of a block at `spare` in scratch. With x_out y_i
    go there, by rows, and not to store.
    LU and triangular solutions: explicit inverses would be faster and are not accurate enough, because on slender beams the soft
    directions of the others' stiffness are small differences.
    """
    n = len(size)
    block = 8 * n * n
    for i in range(1, nn - 1):
        if r_out is not None:
            scatter_rows(scratch, ro + 8 * n * i, tables.rows, no + 8 * i, 8, 0, r_out, size)
            gather_lanes(r_out, tables.rows, no + 8 * i, 8, scratch, ro + 8 * n * i, size)
        if loads is not None:
            subtract_loads(loads, tables, no + 8 * i, scratch, ro + 8 * n * i, spare, size)
    d = io
    for i in range(1, nn - 1):
        diagonal = ko + block * (nn * i + i)
        if rhs_out is None:
            lu = scratch
            lo = spare
            u0 = d
            step = block
        else:
            lu = store
            lo = d
            u0 = d + block
            step = 2 * block
        if not lu_lanes(scratch, diagonal, lu, lo, PIVOT, size):
            return False
        y = diagonal     # the block is done with, its room takes y
        solve_lanes(lu, lo, scratch, ro + 8 * n * i, 8, scratch, y, 8, size)
        # others: i + 1 .. nn - 1, then 0
        for m in range(nn - i):
            j = i + 1 + m if m < nn - 1 - i else 0
            for c in range(0, 8 * n, 8):
                solve_lanes(lu, lo, scratch, ko + block * (nn * i + j) + c, 8 * n, store, u0 + step * m + c, 8 * n, size)
        for m in range(nn - i):
            k = i + 1 + m if m < nn - 1 - i else 0
            low = ko + block * (nn * k + i)
            for l in range(nn - i):
                j = i + 1 + l if l < nn - 1 - i else 0
                subtract_lanes(scratch, low, store, u0 + step * l, scratch, ko + block * (nn * k + j), size, size)
            subtract_lanes(scratch, low, scratch, y, scratch, ro + 8 * n * k, ONE, size)
            if rhs_out is not None:
                copy_lanes(scratch, low, block, store, u0 + step * m + block)
        d = u0 + step * (nn - i)
        if x_out is not None:
            put_rows(scratch, y, tables.rows, no + 8 * i, 8, 0, x_out, size)
        elif rhs_out is None:
            copy_lanes(scratch, y, 8 * n, store, d)
            d += 8 * n
        else:
            scatter_rows(scratch, y, tables.rows, no + 8 * i, 8, 0, rhs_out, size)
    return True


@kernel
def eliminate_columns(inner, contact, panel, width, size):
    """Carry the border columns on inner rows to the end nodes, for the elements that a slider touches."""
    n = len(size)
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
        d = inner.where[e, 0]
        count = inner.where[e, 1]
        rows = inner.where[e, 2]
        for i in range(1, count + 1):
            others = count + 2 - i
            row = n * width * inner.rows[rows + i]
            for c in range(0, width, 8):
                solve_rows(inner.store, d, 8 * n, 8, panel, row + c, width, size)
                for m in range(others):
                    k = i + 1 + m if m < others - 1 else 0
                    subtract_rows(inner.store, d + 2 * block * (m + 1), 8 * n, 8, panel, row + c, width, panel,
                                  n * width * inner.rows[rows + k] + c, width, size)
            d += block * (1 + 2 * others)


@kernel
def put_inner_rhs(inner, panel, width, size):
    """y of the inner rows into column 0 of the panel."""
    n = len(size)
    for i in range(inner.first[0], panel.shape[0] // (n * width)):
        for c in range(n):
            panel[(n * i + c) * width] = inner.rhs[8 * i + c]


@kernel
def take_scaled(source, offset, factor, target, to, n):
    """factor times n lanes."""
    for c in range(0, 8 * n, 8):
        vst(target, to + c, 0, factor * vld(source, offset + c, 0))


@kernel
def recover_group(store, end, by_rows, nn, tables, no, factor, scratch, xo, x_out, size):
    """Increments of the inner nodes of 8 elements, from those of the end nodes: nn nodes in lanes from xo on. end: where what was
    stored of them ends; by_rows: None where y_i stand there, else in x_out; factor: increment per solution."""
    n = len(size)
    column = 8 * n
    block = column * n
    for i in range(nn - 2, 0, -1):
        xi = xo + column * i
        if by_rows is None:
            end -= column
            take_scaled(store, end, factor, scratch, xi, n)
        else:
            gather_lanes(x_out, tables.rows, no + 8 * i, 8, scratch, xi, size)
            take_scaled(scratch, xi, factor, scratch, xi, n)
        end -= block * (nn - i)
        for m in range(nn - i):
            a = i + 1 + m if m < nn - 1 - i else 0
            subtract_lanes(store, end + block * m, scratch, xo + column * a, scratch, xi, ONE, size)
        put_rows(scratch, xi, tables.rows, no + 8 * i, 8, 0, x_out, size)


@kernel
def recover_rows(tables, inner, factor, x_out, scratch, size):
    """Increments of all inner nodes of elements with one strain set from those of the end nodes, in a scene without sliders; none
    where inner is None."""
    n = len(size)
    if inner is not None:
        for k in range(tables.meta.shape[0]):
            if tables.meta[k, 6] >= 0:
                nn = tables.meta[k, 0]
                no = tables.meta[k, 3]
                gather_lanes(x_out, tables.rows, no, 8, scratch, 0, size)
                gather_lanes(x_out, tables.rows, no + 8 * (nn - 1), 8, scratch, 8 * n * (nn - 1), size)
                recover_group(inner.store, tables.meta[k, 6] + short_store(nn, n, 1), None, nn, tables, no, factor, scratch, 0,
                              x_out, size)


@kernel
def recover_inner(inner, panel, width, size):
    """Solutions of the inner rows of the panel from those of the end nodes, all columns."""
    n = len(size)
    block = 8 * n * n
    for e in range(inner.where.shape[0]):
        count = inner.where[e, 1]
        rows = inner.where[e, 2]
        d = inner.where[e, 0]
        for i in range(1, count):
            d += block * (1 + 2 * (count + 2 - i))
        for i in range(count, 0, -1):
            others = count + 2 - i
            row = n * width * inner.rows[rows + i]
            for c in range(0, width, 8):
                for m in range(others):
                    k = i + 1 + m if m < others - 1 else 0
                    subtract_rows(inner.store, d + block * (1 + 2 * m), 8 * n, 8, panel, n * width * inner.rows[rows + k] + c,
                                  width, panel, row + c, width, size)
            d -= block * (1 + 2 * (others + 1))
