"""Rows of constraints in the block matrix, theory.md 9: touched rows, the order of elimination, its fill and its targets.

A constraint has a few unknowns of its own and touches a few nodes. Its row stands right behind the last node that it has to wait
for. All this depends only on the touched rows, and is found again when they change, as when a slider enters another element.

Rows are those of the n nodes, then those of the constraints; a position is the place of a row in the elimination. Blocks are rows
of 8 doubles in one array, `store`: assembled blocks first, then those of constraints and fill.

Arrays: seen, came, queue [N + 1], rows of `Order.work`.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.beams.inner_nodes import INNER_NODES, ROWS, Inner, NoInner
from fastbeam.kernels.beams.planar_nodes import PlanarTies
from fastbeam.kernels.beams.ties import Ties
from fastbeam.kernels.entries.dense import largest_share
from fastbeam.kernels.jit.decorators import inlined, kernel, one_variant
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.terms import NoTies

# columns of `Touched.job` and, from the first, of `Touched.found`
ELEMENT, CONSTRAINT, FIRST_ENTRY, BEFORE, PLACE_OF_START, PLACE_OF_END = range(6)
JOBS = 1


class Couplings(NamedTuple):
    """Constant couplings of n rows of nodes without constraints, and S constraints."""

    start: np.ndarray       # int32 [n + 1]: range of a row in the next three
    near: np.ndarray        # int32 [*]: rows that it is coupled with
    block: np.ndarray       # int32 [*]: offset of block (row, near) in store
    back: np.ndarray        # int32 [*]: offset of block (near, row)
    diagonal: np.ndarray    # int32 [n]
    held: np.ndarray        # int32 [n]: bit c set, unknown c of the row is prescribed
    tied: np.ndarray        # int32 [n]: the tied node that has the row, or -1
    late_start: np.ndarray  # int32 [S + 1]
    late: np.ndarray        # int32 [*]: rows that may be eliminated after a constraint: its point, and ends of carriers
    unknowns: np.ndarray    # int32 [S]: forces, then others, at most 7
    forces: np.ndarray      # int32 [S]: number of forces; as many equations come first, gaps
    in_force: np.ndarray    # int32 [S]: number of the next equations, in the unit of a force
    first: np.ndarray       # int32 [S]: number of its first unknown
    first_force: np.ndarray  # int32 [S]: number of its first force
    end: np.ndarray         # int64 [1]: end of the assembled blocks in store
    partner: np.ndarray     # int32 [S]: the constraint that it is coupled with by own unknowns, or -1
    by_rows: np.ndarray     # int64 [1]: 1 where nodes are eliminated in the order of their rows, 0 in that of `sweep`
    place: np.ndarray       # int32 [N]: place of every row in the elimination, or [0]: it is found


class Touched(NamedTuple):
    """Rows that the constraints touch; E entries a constraint at most. A job is a constraint on inner nodes of one element."""

    entries: np.ndarray     # int32 [S]: number of entries of every constraint, and
    kept: np.ndarray        # int32 [S, E]: their rows, for which the order was found
    wait: np.ndarray        # int32 [S]: 1 where a constraint waits for all that it touches
    entry: np.ndarray       # int32 [S, E]: place in `row` of every entry, -1 on inner nodes
    after: np.ndarray       # int32 [S, E]: the next entry of the same job, or -1
    start: np.ndarray       # int32 [S + 1]: range of a constraint in the next four
    row: np.ndarray         # int32 [T]: rows that it touches, each once
    owner: np.ndarray       # int32 [T]: the constraint
    column: np.ndarray      # int32 [T]: offset of block (row, constraint) in store
    line: np.ndarray        # int32 [T]: offset of block (constraint, row)
    user_start: np.ndarray  # int32 [n + 1]: range of a row in `user`
    user: np.ndarray        # int32 [T]: places in `row` that name it
    weak: np.ndarray        # int32 [S]: the first of its places that the search for the order does not follow
    job_start: np.ndarray   # int32 [S + 1]: range of a constraint in the jobs
    job: np.ndarray         # int32 [J, 6]: element, constraint, first entry, job before in the element or -1, places of both ends
    last_job: np.ndarray    # int32 [elements]: the last job of an element, or -1
    found: np.ndarray       # int32 [elements, 2]: elements with jobs and how many
    pair: np.ndarray        # int32 [P]: offsets of the blocks between the constraints of an element
    cross: np.ndarray       # int32 [O, 2]: offsets of the blocks between both constraints of a sleeve
    mark: np.ndarray        # int32 [n]: work
    place: np.ndarray       # int32 [n]: work
    counts: np.ndarray      # int32 [4]: elements with jobs; 1 once the order was found; doubles for an element; pairs


class Order(NamedTuple):
    """Order and structure of the elimination by positions; N = n + S."""

    rank: np.ndarray        # int32 [n]: place of a node among the nodes
    order: np.ndarray       # int32 [N]: row at a position
    position: np.ndarray    # int32 [N]: position of a row
    unknowns: np.ndarray    # int32 [N]: number of unknowns of the row at a position
    diagonal: np.ndarray    # int32 [N]: offset of its diagonal block in store
    start: np.ndarray       # int32 [N + 1]: range of a position in the next three
    column: np.ndarray      # int32 [M]: later positions, ascending
    upper: np.ndarray       # int32 [M]: offset of block (position, column)
    lower: np.ndarray       # int32 [M]: offset of block (column, position)
    target_start: np.ndarray  # int32 [N + 1]
    target: np.ndarray      # int32 [*]: target blocks of the products of a row, all pairs of its columns row by row
    work: np.ndarray        # int32 [6, N + 1]
    counts: np.ndarray      # int32 [2]: entries; end of the blocks in use in store


@inlined
def is_changed(contact, touched):
    """Return whether the constraints touch other rows than those for which the order was found."""
    if touched.counts[1] == 0:
        return True
    for k in range(contact.entries.shape[0]):
        if contact.entries[k] != touched.entries[k]:
            return True
        for m in range(contact.entries[k]):
            if contact.row[k, m] != touched.kept[k, m]:
                return True
    return False


@inlined
def find_waiting(contact, couplings, touched, dofs):
    """Mark constraints whose force hardly moves the nodes that are eliminated before them, as at a clamp: they have to be
    eliminated behind all that they touch. Return whether anything changed."""
    changed = False
    for k in range(contact.entries.shape[0]):
        largest = 0.0
        for m in range(contact.entries[k]):
            if largest > 1e-3:
                break
            row = contact.row[k, m]
            mask = couplings.held[row] if row < couplings.held.shape[0] else 0
            for t in range(couplings.late_start[k], couplings.late_start[k + 1]):
                if couplings.late[t] == row:
                    mask = -1
            if mask != -1:
                largest = max(largest, largest_share.call(contact, k, m, mask, couplings.forces[k], dofs))
        wait = 0 if largest > 1e-3 else 1
        if wait != touched.wait[k]:
            touched.wait[k] = wait
            changed = True
    return changed


@one_variant
def touch(touched, k, row, at):
    """Let constraint k touch a row. Return the place of the next new row; the count goes on if the arrays are full."""
    if touched.mark[row] != k:
        touched.mark[row] = k
        touched.place[row] = at
        if at < touched.row.shape[0]:
            touched.row[at] = row
            touched.owner[at] = k
        at += 1
    return at


@generic
def touch_end(ties, couplings, touched, k, row, at):
    """Run `touch` for an end of an element: a tied node passes on what it carries."""


@touch_end.register(NoTies)
@kernel
def touch_free_end(ties, couplings, touched, k, row, at):
    return touch(touched, k, row, at)


@touch_end.register(Ties)
@touch_end.register(PlanarTies)
@kernel
def touch_tied_end(ties, couplings, touched, k, row, at):
    at = touch(touched, k, row, at)
    node = couplings.tied[row]
    if node >= 0:
        for e in range(ties.start[node], ties.start[node + 1]):
            at = touch(touched, k, ties.target_row[e], at)
    return at


@generic
def touch_inner(inner, couplings, ties, touched, k, m, row, at, jobs):
    """Make entry m of constraint k on an inner node part of a job. Return the next new row and the next new job."""


@touch_inner.register(NoInner)
@kernel
def touch_nothing(inner, couplings, ties, touched, k, m, row, at, jobs):
    return at, jobs


@touch_inner.register(Inner)
@kernel
def touch_job(inner, couplings, ties, touched, k, m, row, at, jobs):
    e = inner.element[row - inner.first[0]]
    j = touched.last_job[e]
    if j < touched.job_start[k]:
        if j < 0:
            touched.found[touched.counts[0], ELEMENT] = e
            touched.counts[0] += 1
        first = inner.where[e, ROWS]
        touched.job[jobs, ELEMENT] = e
        touched.job[jobs, CONSTRAINT] = k
        touched.job[jobs, FIRST_ENTRY] = -1
        touched.job[jobs, BEFORE] = j
        a = inner.rows[first]
        b = inner.rows[first + inner.where[e, INNER_NODES] + 1]
        at = touch_end.call(ties, couplings, touched, k, a, at)
        at = touch_end.call(ties, couplings, touched, k, b, at)
        touched.job[jobs, PLACE_OF_START] = touched.place[a]
        touched.job[jobs, PLACE_OF_END] = touched.place[b]
        touched.last_job[e] = jobs
        j = jobs
        jobs += 1
    touched.entry[k, m] = -1
    touched.after[k, m] = touched.job[j, FIRST_ENTRY]
    touched.job[j, FIRST_ENTRY] = m
    return at, jobs


@kernel
def collect(contact, inner, ties, couplings, touched, n_unknowns):
    """Collect rows and jobs of all constraints. Return False if there is not enough room."""
    n = couplings.diagonal.shape[0]
    touched.counts[0] = 0
    for i in range(n):
        touched.mark[i] = -1
    for e in range(touched.last_job.shape[0]):
        touched.last_job[e] = -1
    at = 0
    jobs = 0
    for k in range(contact.entries.shape[0]):
        touched.start[k] = at
        touched.job_start[k] = jobs
        touched.entries[k] = contact.entries[k]
        for m in range(contact.entries[k]):
            if at > touched.row.shape[0] or jobs == touched.job.shape[0]:
                return False
            if m == contact.strong[k]:
                touched.weak[k] = at
            row = contact.row[k, m]
            touched.kept[k, m] = row
            if row < n:
                at = touch(touched, k, row, at)
                touched.entry[k, m] = touched.place[row]
            else:
                at, jobs = touch_inner.call(inner, couplings, ties, touched, k, m, row, at, jobs)
        if contact.strong[k] >= contact.entries[k]:
            touched.weak[k] = at
    if at > touched.row.shape[0]:
        return False
    touched.start[contact.entries.shape[0]] = at
    touched.job_start[contact.entries.shape[0]] = jobs
    count_jobs(inner, touched, n_unknowns)
    return list_users(touched, at, n)


@generic
def nodes_of_element(inner, e):
    """Return the number of nodes of an element with eliminated nodes."""


@nodes_of_element.register(NoInner)
@kernel
def no_nodes(inner, e):
    return 0


@nodes_of_element.register(Inner)
@kernel
def inner_and_ends(inner, e):
    return inner.where[e, INNER_NODES] + 2


@kernel
def count_jobs(inner, touched, n):
    """Count the jobs of every element, pairs of them, and the most doubles that the jobs of an element need side by side."""
    most = 0
    pairs = 0
    for f in range(touched.counts[0]):
        jobs = 0
        j = touched.last_job[touched.found[f, ELEMENT]]
        while j >= 0:
            jobs += 1
            j = touched.job[j, BEFORE]
        touched.found[f, JOBS] = jobs
        most = max(most, 16 * n * jobs * nodes_of_element.call(inner, touched.found[f, ELEMENT]))
        pairs += jobs * jobs
    touched.counts[2] = most
    touched.counts[3] = pairs


@one_variant
def list_users(touched, at, n):
    """List the constraints of every row. Return False if there is not enough room for pairs."""
    start = touched.user_start
    for i in range(n + 1):
        start[i] = 0
    for t in range(at):
        start[touched.row[t] + 1] += 1
    for i in range(n):
        start[i + 1] += start[i]
        touched.mark[i] = start[i]
    for t in range(at):
        row = touched.row[t]
        touched.user[touched.mark[row]] = t
        touched.mark[row] += 1
    return touched.counts[3] <= touched.pair.shape[0]


@inlined
def visit(couplings, touched, g, n, seen, came, queue, turn, tail):
    """Append the neighbours of row g that were not seen in this turn (breadth-first search). Return the end of the queue."""
    if g >= n:
        for t in range(touched.start[g - n], touched.weak[g - n]):
            j = touched.row[t]
            if seen[j] != turn:
                seen[j] = turn
                came[j] = g
                queue[tail] = j
                tail += 1
        return tail
    for e in range(couplings.start[g], couplings.start[g + 1]):
        j = couplings.near[e]
        if seen[j] != turn:
            seen[j] = turn
            came[j] = g
            queue[tail] = j
            tail += 1
    for u in range(touched.user_start[g], touched.user_start[g + 1]):
        t = touched.user[u]
        j = n + touched.owner[t]
        if t < touched.weak[j - n] and seen[j] != turn:
            seen[j] = turn
            came[j] = g
            queue[tail] = j
            tail += 1
    return tail


@kernel
def sweep(couplings, touched, order):
    """Rank the nodes: the reverse of a breadth-first search through nodes and constraints that begins in the middle between two
    ends. A tree gets no fill; a chain is eliminated from both ends in turn."""
    n = couplings.diagonal.shape[0]
    seen = order.work[0]
    came = order.work[1]
    queue = order.work[2]
    for g in range(order.position.shape[0]):
        seen[g] = -1
    at = 0
    for root in range(n):
        if seen[root] >= 0:
            continue
        r = root
        tail = at
        for turn in range(3):
            queue[at] = r
            seen[r] = turn
            came[r] = -1
            head = at
            tail = at + 1
            while head < tail:
                tail = visit(couplings, touched, queue[head], n, seen, came, queue, turn, tail)
                head += 1
            r = next_root(queue, came, tail, n, turn)
        at = tail
    k = 0
    for x in range(at - 1, -1, -1):
        if queue[x] < n:
            order.rank[queue[x]] = k
            k += 1


@inlined
def rank_by_rows(order):
    """Rank the nodes by their rows."""
    for i in range(order.rank.shape[0]):
        order.rank[i] = i


@inlined
def take_places(couplings, order):
    """Take the given positions."""
    for g in range(order.position.shape[0]):
        order.position[g] = couplings.place[g]
        order.order[couplings.place[g]] = g


@kernel
def next_root(queue, came, tail, n, turn):
    """Return the root of the next search: the last node that the search before met; after the second search the node half-way to
    it."""
    x = tail - 1
    while queue[x] >= n:
        x -= 1
    r = queue[x]
    if turn == 1:
        steps = 0
        g = r
        while came[g] >= 0:
            g = came[g]
            steps += 1
        for _ in range(steps // 2):
            r = came[r]
        while r >= n:
            r = came[r]
    return r


@inlined
def last_rank(couplings, touched, order, k):
    """Return the rank of the last node that constraint k waits for."""
    last = -1
    least = -1
    for t in range(touched.start[k], touched.start[k + 1]):
        row = touched.row[t]
        late = False
        for u in range(couplings.late_start[k], couplings.late_start[k + 1]):
            if couplings.late[u] == row:
                late = True
        least = max(least, order.rank[row])
        if not late:
            last = max(last, order.rank[row])
    return last if last >= 0 and touched.wait[k] == 0 else least


@kernel
def put_in_order(couplings, touched, order):
    """Order positions: nodes by rank, every constraint right behind the last node that it waits for."""
    n = couplings.diagonal.shape[0]
    behind = order.work[0]
    last = order.work[1]
    filled = order.work[2]
    constraints = order.position.shape[0] - n
    for i in range(n + 1):
        behind[i] = 0
        filled[i] = 0
    for k in range(constraints):
        last[k] = last_rank(couplings, touched, order, k)
        behind[last[k] + 1] += 1
    for i in range(n):
        behind[i + 1] += behind[i]
    for i in range(n):
        # count the constraints that stand behind earlier nodes
        p = order.rank[i] + behind[order.rank[i]]
        order.position[i] = p
        order.order[p] = i
    for k in range(constraints):
        p = last[k] + 1 + behind[last[k]] + filled[last[k]]
        filled[last[k]] += 1
        order.position[n + k] = p
        order.order[p] = n + k
