"""Elimination of nodes and constraints in an order of kernels/constraint_rows.py, theory.md 9.

The right-hand side stands in the last column of the diagonal blocks and, once a row is eliminated, of its first block behind the
diagonal. Nodes are factored without exchange of rows where that is good enough, constraints always with it: their rows in units
of what is found of their compliance, theory.md (5.5).
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._jit import kernel, written_in
from .algebra import vld, vst
from .blocks import lu_rows, lu_two, solve_column, solve_rows, solve_rows_with_last, subtract_column, subtract_rows
from .chain import HIGH, LOW, exchange_and_factor, exchange_rows

# pivots of a node over the largest entry of their rows; pivots of a constraint, with the augmented Lagrangian and without
LEAST_NODE, LEAST_PIVOT, LEAST_PLAIN = 1e-14, 1e-14, 1e-7
RIGHT = 7     # column of the right-hand side


class Factors(NamedTuple):
    """Work of the elimination of n nodes and S constraints, N rows."""

    store: np.ndarray       # float64: all blocks
    x: np.ndarray           # float64 [8 N]: solution by positions
    pivots: np.ndarray      # int64 [8 N]: exchanges by positions, -1 first where there are none
    own: np.ndarray         # float64 [7 S]: what the pivots of nodes took from the diagonal of the forces
    hold: np.ndarray        # float64 [8]
    failed: np.ndarray      # int64 [2]: 1 where there was not enough room; a constraint without a pivot, or -1


@kernel
def subtract_block(store, low, up, target, rows, inner):
    """target -= low up, rows x inner numbers times inner rows of 8."""
    for i in range(rows):
        z = vld(store, target + 8 * i, 0)
        for k in range(inner):
            z -= store[low + 8 * i + k] * vld(store, up + 8 * k, 0)
        vst(store, target + 8 * i, 0, z)


@written_in
def update_rows(order, factors, i, is_node, size):
    """Take the products of the row at position i from the blocks behind it."""
    n = len(size)
    store = factors.store
    inner = order.unknowns[i]
    first = order.start[i]
    last = order.start[i + 1]
    t = order.target_start[i]
    for x in range(first, last):
        j = order.column[x]
        rows = order.unknowns[j]
        low = order.lower[x]
        d = order.diagonal[j]
        constraint = order.order[j] - order.rank.shape[0]
        counted = is_node and constraint >= 0
        if counted:
            for a in range(rows):
                factors.own[7 * constraint + a] += store[d + 9 * a]
        for y in range(first, last):
            if rows == n and inner == n:
                subtract_rows(store, low, 8, 1, store, order.upper[y], 8, store, order.target[t], 8, size)
            else:
                subtract_block(store, low, order.upper[y], order.target[t], rows, inner)
            t += 1
        if counted:
            for a in range(rows):
                factors.own[7 * constraint + a] -= store[d + 9 * a]
        if x > first:
            up = order.upper[first] + RIGHT
            for a in range(rows):
                z = store[d + 8 * a + RIGHT]
                for k in range(inner):
                    z -= store[low + 8 * a + k] * store[up + 8 * k]
                store[d + 8 * a + RIGHT] = z


@kernel
def factor_with_exchange(order, factors, i, size):
    """Factor the diagonal block of a node with exchange of rows, of the right-hand side too. Returns the worst pivot ratio."""
    n = len(size)
    d = order.diagonal[i]
    for c in range(n):
        factors.hold[c] = factors.store[d + 8 * c + RIGHT]
    ratio = exchange_and_factor(factors.store, d, factors.pivots, 8 * i, size)
    if ratio > 0.0:
        for c in range(n):
            m = factors.pivots[8 * i + c]
            t = factors.hold[c]
            factors.hold[c] = factors.hold[m]
            factors.hold[m] = t
        for c in range(n):
            factors.store[d + 8 * c + RIGHT] = factors.hold[c]
    return ratio


@written_in
def solve_behind_node(order, factors, i, size):
    """Blocks behind the factored diagonal block of a node <- D^-1 of them, the right-hand side with the first."""
    store = factors.store
    d = order.diagonal[i]
    first = order.start[i]
    exchanged = factors.pivots[8 * i] >= 0
    for x in range(first, order.start[i + 1]):
        u = order.upper[x]
        if exchanged:
            exchange_rows(factors.pivots, 8 * i, store, u, 8, size)
        if x == first:
            solve_rows_with_last(store, d, store, u, size)
        else:
            solve_rows(store, d, 8, 1, store, u, 8, size)
    if first == order.start[i + 1]:
        solve_column(store, d, 8, 1, store, d + RIGHT, 8, size)


@written_in
def scale_constraint(couplings, order, factors, contact, force, i, k):
    """Add the augmented Lagrangian and write forces in units of 1/compliance. Returns the compliance, 0 where there is none."""
    store = factors.store
    d = order.diagonal[i]
    m = couplings.unknowns[k]
    forces = couplings.forces[k]
    c = 0.0
    for a in range(forces):
        c = max(c, abs(factors.own[7 * k + a]))
    if not c > contact.augmented[1]:
        return 0.0
    contact.compliance[k] = c
    inverse = 1.0 / c
    first = contact.augmented[2] * contact.augmented[0] * c
    for a in range(forces):
        store[d + 8 * a + RIGHT] -= first * force[couplings.first_force[k] + a]
        store[d + 9 * a] += contact.augmented[0] * c
    for b in range(m):
        for a in range(forces):
            store[d + 8 * b + a] *= inverse
    for a in range(forces, forces + couplings.in_force[k]):
        vst(store, d + 8 * a, 0, c * vld(store, d + 8 * a, 0))
    return c


@kernel
def factor_constraint(store, d, m, pivots, p):
    """LU of m rows with their exchange, reciprocal pivots on the diagonal; the right-hand side is exchanged too. Returns the
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
    """m rows of 8 at u <- (LU)^-1 of them."""
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


@written_in
def solve_behind_constraint(couplings, order, factors, i, k, c):
    """Blocks behind the factored diagonal block of a constraint of compliance c <- D^-1 of them, the right-hand side with the
    first."""
    store = factors.store
    d = order.diagonal[i]
    m = couplings.unknowns[k]
    forces = couplings.forces[k]
    first = order.start[i]
    for x in range(first, order.start[i + 1]):
        u = order.upper[x]
        for a in range(forces, forces + couplings.in_force[k]):
            vst(store, u + 8 * a, 0, c * vld(store, u + 8 * a, 0))
        for a in range(m):
            b = factors.pivots[8 * i + a]
            if b != a:
                row = vld(store, u + 8 * a, 0)
                vst(store, u + 8 * a, 0, vld(store, u + 8 * b, 0))
                vst(store, u + 8 * b, 0, row)
        if x == first:
            for a in range(m):
                store[u + 8 * a + RIGHT] = store[d + 8 * a + RIGHT]
        solve_block(store, d, m, u)
        for a in range(forces):
            vst(store, u + 8 * a, 0, (1.0 / c) * vld(store, u + 8 * a, 0))
    if first == order.start[i + 1]:
        solve_right(store, d, m)
        for a in range(forces):
            store[d + 8 * a + RIGHT] /= c


@kernel
def solve_right(store, d, m):
    """The right-hand side beside factors <- (LU)^-1 of it."""
    o = d + RIGHT
    for i in range(1, m):
        for k in range(i):
            store[o + 8 * i] -= store[d + 8 * i + k] * store[o + 8 * k]
    for i in range(m - 1, -1, -1):
        for k in range(i + 1, m):
            store[o + 8 * i] -= store[d + 8 * i + k] * store[o + 8 * k]
        store[o + 8 * i] *= store[d + 9 * i]


@kernel
def eliminate(couplings, order, factors, contact, force, size):
    """Factor in place, the right-hand side goes along. force: of the constraints, one after the other. Returns False at a
    singular block: `factors.failed` then has the constraint, or -1."""
    n = order.rank.shape[0]
    least = LEAST_PIVOT if contact.augmented[0] > 0.0 else LEAST_PLAIN
    rows = order.order.shape[0]
    i = 0
    while i < rows:
        k = order.order[i] - n
        if k >= 0:
            c = scale_constraint(couplings, order, factors, contact, force, i, k)
            if not c > 0.0 or not factor_constraint(factors.store, order.diagonal[i], couplings.unknowns[k], factors.pivots,
                                                    8 * i) > least:
                factors.failed[1] = k
                return False
            solve_behind_constraint(couplings, order, factors, i, k, c)
            update_rows(order, factors, i, False, size)
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
            factored = lu_two(factors.store, order.diagonal[i], order.diagonal[i + 1], LOW, HIGH, size)
        for r in range(i, end):
            factors.pivots[8 * r] = -1
            if not factored and not lu_rows(factors.store, order.diagonal[r], LOW, HIGH, size):
                # NaN fails the comparison too
                if not factor_with_exchange(order, factors, r, size) > LEAST_NODE:
                    return False
        for r in range(i, end):
            solve_behind_node(order, factors, r, size)
        for r in range(i, end):
            update_rows(order, factors, r, True, size)
        i = end
    return True


@kernel
def substitute(order, factors, size):
    """Solution by positions from the eliminated rows."""
    n = len(size)
    store = factors.store
    x = factors.x
    for i in range(order.order.shape[0] - 1, -1, -1):
        m = order.unknowns[i]
        first = order.start[i]
        last = order.start[i + 1]
        right = (order.diagonal[i] if first == last else order.upper[first]) + RIGHT
        for a in range(m):
            x[8 * i + a] = store[right + 8 * a]
        for e in range(first, last):
            j = order.column[e]
            inner = order.unknowns[j]
            if m == n and inner == n:
                subtract_column(store, order.upper[e], 8, 1, x, 8 * j, 1, x, 8 * i, 1, size)
            else:
                for a in range(m):
                    z = x[8 * i + a]
                    for b in range(inner):
                        z -= store[order.upper[e] + 8 * a + b] * x[8 * j + b]
                    x[8 * i + a] = z


@kernel
def take_solution(couplings, order, factors, contact, force, x_out, y_out, size):
    """Solution by rows: nodes in rows of 8, constraints one by one; and the gaps that the augmented Lagrangian leaves."""
    n = order.rank.shape[0]
    for i in range(n):
        p = order.position[i]
        for c in range(len(size)):
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
        for a in range(forces):
            left = contact.augmented[0] * contact.compliance[k] * (y_out[y + a] + contact.augmented[2] * force[f + a])
            contact.remaining[k] = max(contact.remaining[k], abs(left))
    contact.augmented[2] = 0.0
