"""Sparsity pattern: the order of elimination, its fill, and places of all blocks."""
from __future__ import annotations

import heapq
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.linalg.chain import Elimination
from fastbeam.kernels.linalg.pardiso import ANALYSE, UNSYMMETRIC
from fastbeam.linalg.factors import PardisoMemory
from fastbeam.linalg.mkl import load_mkl, pardiso_tables

Array = np.ndarray
# rows beyond which orders other than that of the nodes are not tried, and fill is not followed where there is much of it
LARGE = 20000
# updates a row from which on nets of joints are eliminated in the order of METIS, and all that there may be then: a table has 4
# bytes for each, and those of the joints' rows come on top
MUCH, MOST_UPDATES = 100, 10**8


@dataclass(frozen=True)
class Pattern:
    """Blocks of a symmetric structure."""

    row_of: Array  # int [N]: row of every node; rows from n on belong to nodes that are eliminated before (theory.md 9)
    keys: Array  # int [n_blocks]: row * n + column of the blocks, ascending: block k stands at rank k
    # update lists of the block elimination; None where its fill is too large and a sparse solver has to do it
    plan: Elimination | None
    n: int  # number of block rows
    coupled: Array  # int [m, 2]: rows of coupled nodes, each pair once, without the fill of the plan

    @property
    def first_on_row(self) -> Array:
        """First node on the row of every node, int64 [N]."""
        _, first, of = np.unique(self.row_of, return_index=True, return_inverse=True)
        return np.asarray(first[of])

    @property
    def rows(self) -> Array:
        """Block row of every block."""
        return self.keys // self.n

    @property
    def columns(self) -> Array:
        """Block column of every block."""
        return self.keys % self.n

    @cached_property
    def beats_breadth_first(self) -> bool:
        """True if the reverse of a breadth-first search, which begins in the middle, costs well more than the order of the rows.
        On trees it costs nothing more, and it follows couplings by sliders; between parts that many beams join it is
        expensive."""
        if self.plan is None or self.n > LARGE:
            return False
        counts = np.diff(self.plan.start)
        rank = breadth_first(self.n, self.coupled)
        low, high = self.coupled.T
        return _symbolic(self.n, rank[low], rank[high], int(1.5 * np.sum(counts + counts * counts))) is None

    def block(self, i: Array, j: Array) -> Array:
        """Return the block of nodes i, j (arrays or numbers); both must be in the pattern."""
        return np.searchsorted(self.keys, self.row_of[i] * self.n + self.row_of[j])


def ascending(keys: Array) -> Array:
    """Return the different values among keys in ascending order; np.unique looks them up one by one, which takes ten times as
    long."""
    keys = np.sort(keys)
    return keys[np.concatenate(([True], keys[1:] != keys[:-1]))] if keys.size else keys


def build_pattern(n: int, pairs: Array, band: int, allow_elimination: bool = True, joints: int = 0) -> Pattern:
    """Choose an order and, where the fill stays small, plan the block elimination.

    n: number of nodes.
    pairs: int [m, 2], coupled nodes, any order, repeats allowed; the diagonal is added.
    band: couplings of a node to one side within a beam; what a chain costs.
    allow_elimination: false: leave the factorisation to a sparse solver.
    joints: joints with multipliers, which a sparse solver leaves to a dense border: some columns of all rows each.
    """
    low, high = np.minimum(pairs[:, 0], pairs[:, 1]), np.maximum(pairs[:, 0], pairs[:, 1])
    edges = ascending(low * n + high)
    low, high = edges // n, edges % n
    keep = low != high
    low, high = low[keep], high[keep]
    natural = np.arange(n)
    if allow_elimination:
        # a chain costs band + band^2 updates a node; beyond three times that the sparse solver is the better one
        limit = 3 * n * (band + band * band) + (200 if n <= LARGE else 20) * n + joints * n
        # a chain from both ends to its middle: two nodes at a time that do not wait for each other
        order = _from_both_ends(n) if low.size and np.all(high == low + 1) else natural
        best = _symbolic(n, order[low], order[high], limit)
        if n <= LARGE and (best is None or best.cost > n * (band + band * band)):
            rank = _minimum_degree(n, low, high, limit if best is None else best.cost)
            found = None if rank is None else _symbolic(n, rank[low], rank[high], limit if best is None else best.cost)
            if found is not None and (best is None or found.cost < best.cost):
                best, order = found, rank
        if joints and low.size and (best is None or best.cost > MUCH * n):
            rank = dissected(n, low, high)
            most = MOST_UPDATES if best is None else best.cost
            found = None if rank is None else _symbolic(n, rank[low], rank[high], most, patient=True)
            if rank is not None and found is not None and (best is None or found.cost < best.cost):
                best, order = found, rank
        if best is not None:
            return _with_plan(order, best, np.stack((order[low], order[high]), axis=1))
    row = np.concatenate((low, high, natural))
    column = np.concatenate((high, low, natural))
    return Pattern(natural, np.sort(row * n + column), None, n, np.stack((low, high), axis=1))


def dissected(n: int, low: Array, high: Array) -> Array | None:
    """Return the rank of every node in the order of METIS; None without it."""
    mkl = load_mkl()
    if mkl is None:
        return None
    own = np.arange(n)
    i, j = np.concatenate((low, high, own)), np.concatenate((high, low, own))
    matrix = sparse.csr_array((np.ones(i.size), (i, j)), (n, n))
    t = pardiso_tables(matrix.indptr, matrix.indices, UNSYMMETRIC, {4: 2})
    t.data[:] = 1.0
    failed = PardisoMemory(mkl, t, 1).call(ANALYSE, t.b, t.x)
    return None if failed else np.argsort(t.perm)


def breadth_first(n: int, coupled: Array) -> Array:
    """Return the rank of n rows, coupled [m, 2], in the reverse of a breadth-first search from the middle, as the kernel `sweep`
    finds it."""
    low, high = coupled.T
    graph = sparse.csr_array((np.ones(2 * low.size), (np.concatenate((low, high)), np.concatenate((high, low)))), (n, n))
    rank = np.zeros(n, np.int64)
    component = sparse.csgraph.connected_components(graph, directed=False)[1]
    roots, sizes = np.unique(component, return_index=True, return_counts=True)[1:]
    alone = roots[sizes == 1]
    rank[alone] = n - 1 - np.arange(alone.size)
    done = alone.size
    for root in roots[sizes > 1]:
        for turn in range(3):
            found, came = sparse.csgraph.breadth_first_order(graph, root, directed=False)
            root = found[-1]
            if turn == 1:
                route = [root]
                while came[route[-1]] >= 0:
                    route.append(came[route[-1]])
                root = route[(len(route) - 1) // 2]
        rank[found] = n - 1 - done - np.arange(found.size)
        done += found.size
    return rank


def _from_both_ends(n: int) -> Array:
    """Return the rank of every node if first and last nodes take turns."""
    k = np.arange(n)
    return np.minimum(2 * k, 2 * (n - 1 - k) + 1)


def widen(pattern: Pattern, level: Array, row_root: Array) -> Pattern:
    """Return the pattern of the nodes of level 0 (int [N]) with rows for all N nodes: the others follow, level by level, and
    nodes share the row of row_root, int [N]."""
    own = row_root == np.arange(level.size)
    row_of = np.empty(level.size, np.int64)
    row_of[(level == 0) & own] = pattern.row_of
    remaining = np.flatnonzero((level > 0) & own)
    row_of[remaining[np.argsort(level[remaining], kind="stable")]] = pattern.n + np.arange(remaining.size)
    return Pattern(row_of[row_root], pattern.keys, pattern.plan, pattern.n, pattern.coupled)


@dataclass(frozen=True)
class _Fill:
    """Upper blocks of the factors: columns of every row, ascending, from `start`; cost: updates of the elimination."""

    cost: int
    start: Array
    column: Array


def _symbolic(n: int, a: Array, b: Array, limit: float, patient: bool = False) -> _Fill | None:
    """Find the fill of the elimination of edges between rows a, b; None beyond the limit or, unless `patient`, if many rows have
    it."""
    i, j = np.minimum(a, b), np.maximum(a, b)
    key = np.sort(i * n + j)
    i, j = key // n, key % n
    start = np.searchsorted(i, np.arange(n + 1))
    count = np.diff(start)
    cost = int(np.sum(count + count * count))
    if cost > limit:
        return None
    # eliminating a row couples its first later neighbour with all others; where they are coupled already there is no fill
    follows = np.ones(j.size, bool)
    follows[start[:-1][count > 0]] = False
    inherited = j[start[i[follows]]] * n + j[follows]
    missing = int(np.sum(key[np.minimum(np.searchsorted(key, inherited), key.size - 1)] != inherited)) if inherited.size else 0
    if missing == 0:
        return _Fill(cost, start, j)
    if n > LARGE and missing > n // 100 and not patient:
        return None
    columns = j.tolist()
    upper: list[list[int]] = [columns[start[k]:start[k + 1]] for k in range(n)]
    cost = 0
    for k in range(n):
        row = upper[k]
        if not row:
            continue
        cost += len(row) + len(row) ** 2
        if cost > limit:
            return None
        parent = upper[row[0]]
        if len(row) > 1 and row[1:] != parent:
            upper[row[0]] = sorted(set(parent).union(row[1:]))
    counts = np.array([len(row) for row in upper], dtype=np.int64)
    start = np.concatenate(([0], np.cumsum(counts)))
    return _Fill(cost, start, np.fromiter((c for row in upper for c in row), dtype=np.int64, count=start[-1]))


def elimination_cost(a: Array, b: Array, n: int, limit: float = np.inf) -> int | None:
    """Count the updates of the elimination of n rows with edges between places a, b; None beyond the limit."""
    found = _symbolic(n, a, b, limit, patient=True)
    return None if found is None else found.cost


def _minimum_degree(n: int, low: Array, high: Array, limit: int) -> Array | None:
    """Return the rank of every node in a greedy minimum degree order, ties by number; None if its elimination costs more than the
    limit."""
    neighbours: list[set[int]] = [set() for _ in range(n)]
    for a, b in zip(low.tolist(), high.tolist()):
        neighbours[a].add(b)
        neighbours[b].add(a)
    heap = [(len(s), k) for k, s in enumerate(neighbours)]
    heapq.heapify(heap)
    rank = np.full(n, -1)
    done = cost = 0
    while heap:
        degree, k = heapq.heappop(heap)
        if rank[k] >= 0 or degree != len(neighbours[k]):
            continue
        cost += degree + degree * degree
        if degree > 200 or cost > limit:
            return None
        rank[k] = done
        done += 1
        around = neighbours[k]
        for a in around:
            neighbours[a] |= around
            neighbours[a] -= {a, k}
            heapq.heappush(heap, (len(neighbours[a]), a))
    return rank


def _with_plan(rank: Array, fill: _Fill, coupled: Array) -> Pattern:
    n = rank.size
    start, column = fill.start, fill.column
    counts = np.diff(start)
    row = np.repeat(np.arange(n), counts)
    diagonal = np.arange(n) * (n + 1)
    keys = np.sort(np.concatenate((row * n + column, column * n + row, diagonal)))

    def find(i: Array, j: Array) -> Array:
        return np.searchsorted(keys, i * n + j)

    targets_from = np.concatenate(([0], np.cumsum(counts**2)))
    # all pairs (j, k) of the columns of a row, row by row
    local = np.arange(targets_from[-1]) - np.repeat(targets_from[:-1], counts**2)
    width = np.repeat(counts, counts**2)
    first = np.repeat(start[:-1], counts**2)
    target = find(column[first + local // np.maximum(width, 1)], column[first + local % np.maximum(width, 1)])
    plan = Elimination(find(np.arange(n), np.arange(n)), start, column, find(row, column), find(column, row),
                       targets_from[:-1].copy(), target)
    return Pattern(rank, keys, plan, n, coupled)
