"""Elimination of nodes and constraints in an order of linalg/constraint_rows.py, theory.md 9.

The right-hand side stands in the last column of the diagonal blocks and, once a row is eliminated, of its first block behind the
diagonal. Nodes are factored without exchange of rows if the pivots are good enough, constraints always with it: their rows in
units of their compliance as found in the elimination, theory.md (5.5).

Arrays: store [*] as `Factors.store`; pivots [8 N] by positions; force [*], forces of all constraints one after the other; x_out
[8 (rows + 1)]; y_out [7 S], unknowns of all constraints.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.blocks import (
    lu_rows,
    lu_two,
    solve_column,
    solve_rows,
    solve_rows_with_last,
    subtract_column,
    subtract_rows,
)
from fastbeam.kernels.algebra.dimensions import dim
from fastbeam.kernels.algebra.vectors import fetch, vld, vst
from fastbeam.kernels.entries.dense import first_of_own_block
from fastbeam.kernels.jit.decorators import inlined, kernel, one_variant, separate
from fastbeam.kernels.linalg.chain import HIGH, LOW, exchange_and_factor, exchange_rows
from fastbeam.kernels.linalg.constraint_blocks import (
    column_on_slider,
    column_slider_on_node,
    column_slider_on_slider,
    factor_moments,
    factor_slider,
    solve_behind_moments,
    solve_behind_moments_with_right,
    solve_behind_slider,
    solve_behind_slider_with_right,
    solve_right_of_moments,
    solve_right_of_slider,
    subtract_on_slider,
    subtract_slider_on_node,
    subtract_slider_on_slider,
)

# least pivots that count as none: of a node, next to the largest entry of the row; of a constraint, with the augmented Lagrangian
# and without
LEAST_NODE, LEAST_PIVOT, LEAST_UNAUGMENTED = 1e-14, 1e-14, 1e-7
RIGHT = 7     # column of the right-hand side
# number of rows whose blocks are prefetched, if all blocks have more doubles than the caches next to a processor hold
AHEAD, FAR = 8, 65536


class Factors(NamedTuple):
    """Work arrays of the elimination of n nodes and S constraints, N rows."""

    store: np.ndarray       # float64 [*]: all blocks
    x: np.ndarray           # float64 [8 N]: solution by positions
    pivots: np.ndarray      # int8 [8 N]: exchanges by positions, -1 first where there are none
    own: np.ndarray         # float64 [7 S]: part of the diagonal of the forces that the pivots of nodes subtracted
    hold: np.ndarray        # float64 [8]
    failed: np.ndarray      # int64 [2]: 1 where there was not enough room; a constraint without a pivot, or -1


@kernel
def subtract_block(store, low, up, target, rows, inner):
    """Subtract low up from target, rows x inner numbers times inner rows of 8."""
    for i in range(rows):
        z = vld(store, target + 8 * i, 0)
        for k in range(inner):
            z -= store[low + 8 * i + k] * vld(store, up + 8 * k, 0)
        vst(store, target + 8 * i, 0, z)


@inlined
def subtract_row(store, order, x, first, last, t, rows, inner, dofs):
    """Subtract the block of later row x below the pivot times the row of the pivot, columns first to last, from the blocks of x,
    from target t on. rows, inner: unknowns of both."""
    n = len(dofs)
    m = 2 * dim(dofs) + 1
    low = order.lower[x]
    if inner == n and rows == n:
        for y in range(first, last):
            subtract_rows(store, low, 8, 1, store, order.upper[y], 8, store, order.target[t + y - first], 8, dofs)
    elif inner == n and rows == m:
        for y in range(first, last):
            subtract_on_slider(store, low, 8, 1, store, order.upper[y], 8, store, order.target[t + y - first], 8, dofs)
    elif inner == m and rows == n:
        for y in range(first, last):
            subtract_slider_on_node(store, low, 8, 1, store, order.upper[y], 8, store, order.target[t + y - first], 8, dofs)
    elif inner == m and rows == m:
        for y in range(first, last):
            subtract_slider_on_slider(store, low, 8, 1, store, order.upper[y], 8, store, order.target[t + y - first], 8, dofs)
    else:
        for y in range(first, last):
            subtract_block(store, low, order.upper[y], order.target[t + y - first], rows, inner)


@inlined
def subtract_numbers(store, low, source, x, x_row, target, y, y_row, rows, inner, dofs):
    """Subtract the block at low times a column of numbers in source [*] at x from one in target [*] at y, y_row apart; rows,
    inner: rows and columns of the block."""
    n = len(dofs)
    m = 2 * dim(dofs) + 1
    if inner == n and rows == n:
        subtract_column(store, low, 8, 1, source, x, x_row, target, y, y_row, dofs)
    elif inner == n and rows == m:
        column_on_slider(store, low, 8, 1, source, x, x_row, target, y, y_row, dofs)
    elif inner == m and rows == n:
        column_slider_on_node(store, low, 8, 1, source, x, x_row, target, y, y_row, dofs)
    elif inner == m and rows == m:
        column_slider_on_slider(store, low, 8, 1, source, x, x_row, target, y, y_row, dofs)
    else:
        for a in range(rows):
            z = target[y + y_row * a]
            for k in range(inner):
                z -= store[low + 8 * a + k] * source[x + x_row * k]
            target[y + y_row * a] = z


@inlined
def update_rows(couplings, order, factors, i, is_node, dofs):
    """Subtract the products of the row at position i from the blocks behind it."""
    store = factors.store
    inner = order.unknowns[i]
    first = order.start[i]
    last = order.start[i + 1]
    t = order.target_start[i]
    for x in range(first, last):
        j = order.column[x]
        rows = order.unknowns[j]
        d = order.diagonal[j]
        # the order has no number any more for rows that carriers eliminated
        constraint = order.order[j] - order.rank.shape[0] if j < order.order.shape[0] else -1
        forces = couplings.forces[constraint] if is_node and constraint >= 0 else 0
        for a in range(forces):
            factors.own[7 * constraint + a] += store[d + 9 * a]
        subtract_row(store, order, x, first, last, t, rows, inner, dofs)
        t += last - first
        for a in range(forces):
            factors.own[7 * constraint + a] -= store[d + 9 * a]
        if x > first:
            subtract_numbers(store, order.lower[x], store, order.upper[first] + RIGHT, 8, store, d + RIGHT, 8, rows, inner, dofs)


@kernel
def factor_with_exchange(order, factors, i, dofs):
    """Factor the diagonal block of a node with exchange of rows, of the right-hand side too. Return the worst pivot ratio."""
    n = len(dofs)
    d = order.diagonal[i]
    for c in range(n):
        factors.hold[c] = factors.store[d + 8 * c + RIGHT]
    ratio = exchange_and_factor(factors.store, d, factors.pivots, 8 * i, dofs)
    if ratio > 0.0:
        for c in range(n):
            m = factors.pivots[8 * i + c]
            t = factors.hold[c]
            factors.hold[c] = factors.hold[m]
            factors.hold[m] = t
        for c in range(n):
            factors.store[d + 8 * c + RIGHT] = factors.hold[c]
    return ratio


@inlined
def solve_behind_node(order, factors, i, dofs):
    """Solve with D for the blocks behind the factored diagonal block of a node, the right-hand side with the first."""
    store = factors.store
    d = order.diagonal[i]
    first = order.start[i]
    exchanged = factors.pivots[8 * i] >= 0
    for x in range(first, order.start[i + 1]):
        u = order.upper[x]
        if exchanged:
            exchange_rows(factors.pivots, 8 * i, store, u, 8, dofs)
        if x == first:
            solve_rows_with_last(store, d, store, u, dofs)
        else:
            solve_rows(store, d, 8, 1, store, u, 8, dofs)
    if first == order.start[i + 1]:
        solve_column(store, d, 8, 1, store, d + RIGHT, 8, dofs)


@inlined
def compliance_of(couplings, factors, contact, k):
    """Return the compliance of the parts that a constraint joins, 0 if there is none; 1 if its force is prescribed and touches
    nothing."""
    c = 0.0
    for a in range(couplings.forces[k]):
        c = max(c, abs(factors.own[7 * k + a]))
    if not c > contact.augmented[1]:
        c = first_of_own_block.call(contact, k)
        if not c > contact.augmented[1]:
            return 0.0
    contact.compliance[k] = c
    return c


@inlined
def scale_constraint(couplings, order, factors, contact, force, i, k, c):
    """Add the augmented Lagrangian and write forces in units of 1/compliance, as `factor_slider` does."""
    store = factors.store
    d = order.diagonal[i]
    m = couplings.unknowns[k]
    forces = couplings.forces[k]
    inverse = 1.0 / c
    soft = contact.augmented[0] * contact.softness[k]
    first = contact.augmented[2] * soft * c
    for a in range(forces):
        store[d + 8 * a + RIGHT] -= first * force[couplings.first_force[k] + a]
        store[d + 9 * a] += soft * c
    for b in range(m):
        for a in range(forces):
            store[d + 8 * b + a] *= inverse
    for a in range(forces, forces + couplings.in_force[k]):
        vst(store, d + 8 * a, 0, c * vld(store, d + 8 * a, 0))


@kernel
def factor_constraint(store, d, m, pivots, p):
    """Factor m rows with their exchange, reciprocal pivots on the diagonal; the right-hand side is exchanged too. Return the
    smallest pivot."""
    least = np.inf
    for k in range(m):
        largest = k
        v = abs(store[d + 9 * k])
        for i in range(k + 1, m):
            t = abs(store[d + 8 * i + k])
            if t > v:
                v = t
                largest = i
        if not v > 0.0:
            return 0.0
        least = min(least, v)
        pivots[p + k] = largest
        if largest != k:
            row = vld(store, d + 8 * k, 0)
            vst(store, d + 8 * k, 0, vld(store, d + 8 * largest, 0))
            vst(store, d + 8 * largest, 0, row)
        inverse = 1.0 / store[d + 9 * k]
        store[d + 9 * k] = inverse
        for i in range(k + 1, m):
            f = store[d + 8 * i + k] * inverse
            store[d + 8 * i + k] = f
            for j in range(k + 1, m):
                store[d + 8 * i + j] -= f * store[d + 8 * k + j]
    return least


@kernel
def solve_block(store, d, m, u):
    """Solve with LU for m rows of 8 at u."""
    for i in range(1, m):
        z = vld(store, u + 8 * i, 0)
        for k in range(i):
            z -= store[d + 8 * i + k] * vld(store, u + 8 * k, 0)
        vst(store, u + 8 * i, 0, z)
    for i in range(m - 1, -1, -1):
        z = vld(store, u + 8 * i, 0)
        for k in range(i + 1, m):
            z -= store[d + 8 * i + k] * vld(store, u + 8 * k, 0)
        vst(store, u + 8 * i, 0, store[d + 9 * i] * z)


@inlined
def are_moments(couplings, k, dofs):
    """Return whether constraint k has the unknowns of the moments of a sleeve: the moments, and a copy of a spin."""
    d = dim(dofs)
    unknowns, forces = (6, 3) if d == 3 else (2, 1)
    return couplings.unknowns[k] == unknowns and couplings.forces[k] == forces and couplings.in_force[k] == 0


@inlined
def solve_behind_constraint(couplings, order, factors, i, k, c, dofs):
    """Solve with D for the blocks behind the factored diagonal block of a constraint of compliance c, the right-hand side with
    the first."""
    store = factors.store
    d = order.diagonal[i]
    m = couplings.unknowns[k]
    first = order.start[i]
    last = order.start[i + 1]
    is_slider = m == 2 * dim(dofs) + 1 and couplings.in_force[k] == 1
    of_sleeve = are_moments(couplings, k, dofs)
    if first == last and is_slider:
        solve_right_of_slider(store, d, c, dofs)
    elif first == last and of_sleeve:
        solve_right_of_moments(store, d, c, dofs)
    elif first == last:
        solve_right(store, d, m)
        for a in range(couplings.forces[k]):
            store[d + 8 * a + RIGHT] /= c
    elif is_slider:
        solve_behind_slider_with_right(store, d, factors.pivots, 8 * i, c, order.upper[first], dofs)
        for x in range(first + 1, last):
            solve_behind_slider(store, d, factors.pivots, 8 * i, c, order.upper[x], dofs)
    elif of_sleeve:
        solve_behind_moments_with_right(store, d, factors.pivots, 8 * i, c, order.upper[first], dofs)
        for x in range(first + 1, last):
            solve_behind_moments(store, d, factors.pivots, 8 * i, c, order.upper[x], dofs)
    else:
        for x in range(first, last):
            solve_behind_any(couplings, order, factors, i, k, c, order.upper[x], x == first)


@one_variant
def solve_behind_any(couplings, order, factors, i, k, c, u, right):
    """Solve for the block at u behind a constraint of any number of unknowns; right: with the right-hand side."""
    store = factors.store
    d = order.diagonal[i]
    m = couplings.unknowns[k]
    forces = couplings.forces[k]
    for a in range(forces, forces + couplings.in_force[k]):
        vst(store, u + 8 * a, 0, c * vld(store, u + 8 * a, 0))
    for a in range(m):
        b = factors.pivots[8 * i + a]
        if b != a:
            row = vld(store, u + 8 * a, 0)
            vst(store, u + 8 * a, 0, vld(store, u + 8 * b, 0))
            vst(store, u + 8 * b, 0, row)
    if right:
        for a in range(m):
            store[u + 8 * a + RIGHT] = store[d + 8 * a + RIGHT]
    solve_block(store, d, m, u)
    for a in range(forces):
        vst(store, u + 8 * a, 0, (1.0 / c) * vld(store, u + 8 * a, 0))


@kernel
def solve_right(store, d, m):
    """Solve with LU for the right-hand side beside the factors."""
    o = d + RIGHT
    for i in range(1, m):
        for k in range(i):
            store[o + 8 * i] -= store[d + 8 * i + k] * store[o + 8 * k]
    for i in range(m - 1, -1, -1):
        for k in range(i + 1, m):
            store[o + 8 * i] -= store[d + 8 * i + k] * store[o + 8 * k]
        store[o + 8 * i] *= store[d + 9 * i]


@inlined
def fetch_rows(store, at, rows):
    """Prefetch a block of `rows` rows at `at`."""
    for c in range(0, 8 * rows, 8):
        fetch(store, at + c)


@inlined
def fetch_blocks(order, store, i):
    """Prefetch the blocks of the row at position i and of its column."""
    m = order.unknowns[i]
    fetch_rows(store, order.diagonal[i], m)
    for x in range(order.start[i], order.start[i + 1]):
        fetch_rows(store, order.upper[x], m)
        fetch_rows(store, order.lower[x], order.unknowns[order.column[x]])


@separate
def eliminate(couplings, order, factors, contact, force, dofs):
    """Factor in place; the right-hand side goes along. force: of the constraints, one after the other. Return False at a singular
    block: `factors.failed` then has the constraint, or -1."""
    n = order.rank.shape[0]
    least = LEAST_PIVOT if contact.augmented[0] > 0.0 else LEAST_UNAUGMENTED
    rows = order.order.shape[0]
    i = 0
    fetched = 0 if order.counts[1] > FAR else rows
    while i < rows:
        k = order.order[i] - n
        while fetched < rows and fetched < i + AHEAD:
            fetch_blocks(order, factors.store, fetched)
            fetched += 1
        if k >= 0:
            c = compliance_of(couplings, factors, contact, k)
            pivot = 0.0
            if c > 0.0:
                soft = contact.augmented[0] * contact.softness[k] * c
                if couplings.unknowns[k] == 2 * dim(dofs) + 1 and couplings.in_force[k] == 1:
                    pivot = factor_slider(factors.store, order.diagonal[i], factors.pivots, 8 * i, c, soft,
                                          contact.augmented[2] * soft, force, couplings.first_force[k], dofs)
                elif are_moments(couplings, k, dofs):
                    pivot = factor_moments(factors.store, order.diagonal[i], factors.pivots, 8 * i, c, soft,
                                           contact.augmented[2] * soft, force, couplings.first_force[k], dofs)
                else:
                    scale_constraint(couplings, order, factors, contact, force, i, k, c)
                    pivot = factor_constraint(factors.store, order.diagonal[i], couplings.unknowns[k], factors.pivots, 8 * i)
            if not pivot > least:
                factors.failed[1] = k
                return False
            solve_behind_constraint(couplings, order, factors, i, k, c, dofs)
            update_rows(couplings, order, factors, i, False, dofs)
            i += 1
            continue
        # two rows at a time where the second does not wait for the first
        end = i + 2
        if end > rows or order.order[i + 1] >= n:
            end = i + 1
        elif order.start[i] < order.start[i + 1] and order.column[order.start[i]] == i + 1:
            end = i + 1
        factored = False
        if end == i + 2:
            factored = lu_two(factors.store, order.diagonal[i], order.diagonal[i + 1], LOW, HIGH, dofs)
        for r in range(i, end):
            factors.pivots[8 * r] = -1
            if not factored and not lu_rows(factors.store, order.diagonal[r], LOW, HIGH, dofs):
                # NaN fails the comparison too
                if not factor_with_exchange(order, factors, r, dofs) > LEAST_NODE:
                    return False
        for r in range(i, end):
            solve_behind_node(order, factors, r, dofs)
        for r in range(i, end):
            update_rows(couplings, order, factors, r, True, dofs)
        i = end
    return True


@separate
def substitute(order, factors, dofs):
    """Solve by positions from the eliminated rows."""
    store = factors.store
    x = factors.x
    ahead = AHEAD if order.counts[1] > FAR else order.order.shape[0]
    for i in range(order.order.shape[0] - 1, -1, -1):
        if i >= ahead:
            for e in range(order.start[i - ahead], order.start[i - ahead + 1]):
                fetch_rows(store, order.upper[e], order.unknowns[i - ahead])
        m = order.unknowns[i]
        first = order.start[i]
        last = order.start[i + 1]
        right = (order.diagonal[i] if first == last else order.upper[first]) + RIGHT
        for a in range(m):
            x[8 * i + a] = store[right + 8 * a]
        for e in range(first, last):
            j = order.column[e]
            subtract_numbers(store, order.upper[e], x, 8 * j, 1, x, 8 * i, 1, m, order.unknowns[j], dofs)


@separate
def take_solution(couplings, order, factors, contact, force, x_out, y_out, dofs):
    """Store the solution by rows: nodes in rows of 8, constraints one by one; and the gaps that the augmented Lagrangian
    leaves."""
    n = order.rank.shape[0]
    for i in range(n):
        p = order.position[i]
        for c in range(len(dofs)):
            x_out[8 * i + c] = factors.x[8 * p + c]
    for k in range(couplings.unknowns.shape[0]):
        p = order.position[n + k]
        m = couplings.unknowns[k]
        forces = couplings.forces[k]
        y = couplings.first[k]
        f = couplings.first_force[k]
        for a in range(m):
            y_out[y + a] = factors.x[8 * p + a]
        contact.remaining[k] = 0.0
        share = contact.augmented[0] * contact.softness[k] * contact.compliance[k]
        for a in range(forces):
            left = share * (y_out[y + a] + contact.augmented[2] * force[f + a])
            contact.remaining[k] = max(contact.remaining[k], abs(left))
    contact.augmented[2] = 0.0
