"""Fill of the elimination of nodes and constraints in an order of linalg/constraint_rows.py, and places of all blocks."""
from __future__ import annotations

from fastbeam.kernels.jit.decorators import inlined, kernel, one_variant
from fastbeam.kernels.linalg.constraint_rows import (
    BEFORE,
    CONSTRAINT,
    ELEMENT,
    collect,
    find_waiting,
    is_changed,
    put_in_order,
    rank_by_rows,
    sweep,
    take_places,
)


@inlined
def enter_column(order, i, p, upper, lower, at):
    """Enter a later position p in the row at position i, with its blocks or -1. Return the place of the next."""
    if p > i:
        if order.work[0, p] != i:
            order.work[0, p] = i
            order.work[3, p] = -1
            order.column[at] = p
            at += 1
        if upper >= 0:
            order.work[3, p] = upper
            order.work[4, p] = lower
    return at


@inlined
def own_columns(couplings, touched, order, i, at):
    """Enter the later positions that the row at position i is coupled with before the elimination. Return the place of the
    next."""
    n = couplings.diagonal.shape[0]
    g = order.order[i]
    if g < n:
        for e in range(couplings.start[g], couplings.start[g + 1]):
            at = enter_column(order, i, order.position[couplings.near[e]], couplings.block[e], couplings.back[e], at)
        for u in range(touched.user_start[g], touched.user_start[g + 1]):
            at = enter_column(order, i, order.position[n + touched.owner[touched.user[u]]], -1, -1, at)
        return at
    for t in range(touched.start[g - n], touched.start[g - n + 1]):
        at = enter_column(order, i, order.position[touched.row[t]], -1, -1, at)
    if couplings.partner[g - n] >= 0:
        at = enter_column(order, i, order.position[n + couplings.partner[g - n]], -1, -1, at)
    for j in range(touched.job_start[g - n], touched.job_start[g - n + 1]):
        x = touched.last_job[touched.job[j, ELEMENT]]
        while x >= 0:
            at = enter_column(order, i, order.position[n + touched.job[x, CONSTRAINT]], -1, -1, at)
            x = touched.job[x, BEFORE]
    return at


@one_variant
def sort_columns(column, first, last):
    """Sort column [*] from `first` to before `last`, ascending, in place."""
    for x in range(first + 1, last):
        v = column[x]
        y = x - 1
        while y >= first and column[y] > v:
            column[y + 1] = column[y]
            y -= 1
        column[y + 1] = v


@kernel
def find_fill(couplings, touched, order, dofs):
    """Find columns of every row behind its diagonal, and its blocks. Return the end of the blocks in store, -1 if there is not
    enough room for columns."""
    n = couplings.diagonal.shape[0]
    rows = order.position.shape[0]
    child = order.work[1]
    sibling = order.work[2]
    for i in range(rows):
        g = order.order[i]
        order.unknowns[i] = len(dofs) if g < n else couplings.unknowns[g - n]
        order.work[0, i] = -1
        child[i] = -1
    end = couplings.end[0]
    at = 0
    for i in range(rows):
        if at + rows - i > order.column.shape[0]:
            return -1
        g = order.order[i]
        order.start[i] = at
        first = at
        at = own_columns(couplings, touched, order, i, at)
        c = child[i]
        while c >= 0:
            for e in range(order.start[c], order.start[c + 1]):
                at = enter_column(order, i, order.column[e], -1, -1, at)
            c = sibling[c]
        order.start[i + 1] = at
        sort_columns(order.column, first, at)
        if g < n:
            order.diagonal[i] = couplings.diagonal[g]
        else:
            order.diagonal[i] = end
            end += 8 * order.unknowns[i]
        for e in range(first, at):
            p = order.column[e]
            order.upper[e] = order.work[3, p]
            order.lower[e] = order.work[4, p]
            if order.upper[e] < 0:
                order.upper[e] = end
                order.lower[e] = end + 8 * order.unknowns[i]
                end += 8 * (order.unknowns[i] + order.unknowns[p])
        if at > first:
            sibling[i] = child[order.column[first]]
            child[order.column[first]] = i
    order.counts[0] = at
    return end


@inlined
def find_targets(order):
    """Find the target blocks of the products of every row. Return False if there is not enough room."""
    at = 0
    for i in range(order.position.shape[0]):
        first = order.start[i]
        last = order.start[i + 1]
        m = last - first
        order.target_start[i] = at
        if at + m * m > order.target.shape[0]:
            return False
        for x in range(m):
            j = order.column[first + x]
            e = order.start[j]
            order.target[at + m * x + x] = order.diagonal[j]
            for y in range(x + 1, m):
                k = order.column[first + y]
                while order.column[e] != k:
                    e += 1
                order.target[at + m * x + y] = order.upper[e]
                order.target[at + m * y + x] = order.lower[e]
        at += m * m
    return True


@kernel
def block_at(order, i, j):
    """Return the offset of the block at positions i, j."""
    if i == j:
        return order.diagonal[i]
    e = order.start[min(i, j)]
    last = order.start[min(i, j) + 1]
    while e < last and order.column[e] != max(i, j):
        e += 1
    return order.upper[e] if i < j else order.lower[e]


@inlined
def find_places(contact, couplings, touched, order):
    """Find the offsets of entries of constraints, of blocks between constraints that share an element, and of blocks of
    sleeves."""
    n = couplings.diagonal.shape[0]
    for k in range(touched.entries.shape[0]):
        p = order.position[n + k]
        for t in range(touched.start[k], touched.start[k + 1]):
            q = order.position[touched.row[t]]
            touched.column[t] = block_at(order, q, p)
            touched.line[t] = block_at(order, p, q)
    for o in range(contact.pair.shape[0]):
        p = order.position[n + contact.pair[o, 0]]
        q = order.position[n + contact.pair[o, 1]]
        touched.cross[o, 0] = block_at(order, p, q)
        touched.cross[o, 1] = block_at(order, q, p)
    at = 0
    for f in range(touched.counts[0]):
        a = touched.last_job[touched.found[f, ELEMENT]]
        while a >= 0:
            p = order.position[n + touched.job[a, CONSTRAINT]]
            b = touched.last_job[touched.found[f, ELEMENT]]
            while b >= 0:
                touched.pair[at] = block_at(order, p, order.position[n + touched.job[b, CONSTRAINT]])
                at += 1
                b = touched.job[b, BEFORE]
            a = touched.job[a, BEFORE]


@kernel
def update_order(contact, inner, ties, couplings, touched, order, capacity, buffer_capacity, dofs):
    """Find order and structure again if other rows are touched; capacity: doubles in store and in a buffer. Return False, and
    expect another call, if an array is too short."""
    is_given = couplings.place.shape[0] > 0
    waiting = not is_given and find_waiting(contact, couplings, touched, dofs)
    if not waiting and not is_changed(contact, touched):
        return True
    touched.counts[1] = 0
    if not collect(contact, inner, ties, couplings, touched, len(dofs)) or touched.counts[2] > buffer_capacity:
        return False
    if is_given:
        take_places(couplings, order)
    else:
        if couplings.by_rows[0] != 0:
            rank_by_rows(order)
        else:
            sweep(couplings, touched, order)
        put_in_order(couplings, touched, order)
    end = find_fill(couplings, touched, order, dofs)
    if end < 0 or end > capacity or not find_targets(order):
        return False
    order.counts[1] = end
    find_places(contact, couplings, touched, order)
    touched.counts[1] = 1
    return True
