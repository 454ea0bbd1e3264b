"""Order of elimination of nodes and joints with multipliers together, theory.md (9.9): least degree, where a joint need not wait
for both of its ends.

A joint can be eliminated once its conditions are independent of those eliminated before, on the motions of the nodes that are.
Nodes that eliminated joints connect are a component. While it is free, it has all its rigid motions left: one joint that it has
with a node outside may be eliminated before that node, as if that were the ground, whatever is inside. The component is open,
then, until the node follows. Two joints like that, or one beside a support, need not be independent: two rods in line.

Where loops are many, as in nets, the order of METIS for nodes and joints together is taken instead, in which every joint comes as
soon as it may; or the usual order, where that makes less fill: nodes by rank, and every joint behind the last of its nodes.
"""
from __future__ import annotations

import heapq
from itertools import combinations
from typing import NamedTuple

import numpy as np

from fastbeam.linalg.pattern import MUCH, breadth_first, dissected, elimination_cost

Array = np.ndarray
FREE, OPEN, GROUND = 0, 1, 2
# no order is searched if rows are coupled with more others, there are more rows, or more rows for a joint than these
MOST, LARGE, FEW = 200, 400_000, 100


class Joint(NamedTuple):
    """Constraints of one joint, all between the same nodes."""

    constraints: list[int]
    rows: tuple[int, ...]   # rows of the nodes, without those that are fixed altogether
    held: tuple[int, ...]   # rows of fixed nodes


def places_of(n: int, coupled: Array, joints: list[Joint], grounded: Array, by_rows: bool) -> Array | None:
    """Return the place of every row in the elimination; None if the order that the kernels find is cheaper.

    n: rows of nodes; those of constraints follow.
    coupled: int [m, 2], rows of nodes that are coupled without joints.
    grounded: bool [n], rows of nodes with a support.
    by_rows: whether kernels would eliminate nodes in the order of their rows.

    Returns
    -------
    int32 [n + constraints], or None
    """
    if n + len(joints) > LARGE or n > FEW * len(joints):
        return None
    touched = [(*joint.rows, *joint.held) for joint in joints]
    pairs = np.array([pair for rows in touched for pair in combinations(rows, 2)], np.int64).reshape(-1, 2)
    rank = np.arange(n) if by_rows else breadth_first(n, np.concatenate((coupled, pairs)))
    last = [max(rank[a] for a in rows) for rows in touched]
    usual = np.lexsort((np.arange(n + len(joints)), np.concatenate((rank, last))))
    edges = np.array([(a, k) for k, rows in enumerate(touched, n) for a in rows])
    low, high = np.concatenate((coupled, edges)).T

    def cost_of(order: list[int] | Array, limit: float = np.inf) -> float:
        place = np.argsort(order)
        cost = elimination_cost(place[low], place[high], len(order), limit)
        return np.inf if cost is None else cost

    order = least_degree(n, coupled, joints, grounded)
    cost = np.inf if order is None else cost_of(order)
    if cost > MUCH * len(usual):
        other = by_dissection(n, low, high, joints, grounded)
        less = np.inf if other is None else cost_of(other, cost)
        if less < cost:
            order, cost = other, less
    if order is None or cost_of(usual, cost) <= cost:
        return None
    rows = [r for v in order for r in ([v] if v < n else [n + k for k in joints[v - n].constraints])]
    return np.argsort(rows).astype(np.int32)


def least_degree(n: int, coupled: Array, joints: list[Joint], grounded: Array) -> list[int] | None:
    """Order nodes, and joints from n on, for their elimination; arguments as in `places_of`. None if a row has very many
    columns."""
    return _Search(n, coupled, joints, grounded).run()


def by_dissection(n: int, low: Array, high: Array, joints: list[Joint], grounded: Array) -> list[int] | None:
    """Order nodes and joints by nested dissection of their graph, of edges between `low` and `high`; a joint that may not be
    eliminated yet comes as soon as it may. None without METIS."""
    rank = dissected(n + len(joints), low, high)
    return None if rank is None else _Search(n, np.zeros((0, 2), np.int64), joints, grounded, rank.tolist()).run()


class _Search:
    """Search for an order of vertices: nodes, then joints. Components of eliminated nodes are trees of parents, with their data
    at the root. Candidates are in the order of `rank`, by default of their degree."""

    def __init__(self, n: int, coupled: Array, joints: list[Joint], grounded: Array, rank: list[int] | None = None) -> None:
        self.n, self.joints, self.rank = n, joints, rank
        self.near: list[set[int]] = [set() for _ in range(n + len(joints))]
        for a, b in coupled.tolist():
            self.near[a].add(b)
            self.near[b].add(a)
        self.touching: list[list[int]] = [[] for _ in range(n)]
        for k, joint in enumerate(joints, n):
            for a in (*joint.rows, *joint.held):
                self.near[a].add(k)
                self.near[k].add(a)
            for a in joint.rows:
                self.touching[a].append(k)
        self.parent = list(range(n))
        self.state = [GROUND if g else FREE for g in grounded.tolist()]
        self.open_joint = [-1] * n
        self.left: list[set[int]] = [set(x) for x in self.touching]
        self.done = [False] * (n + len(joints))
        self.heap: list[tuple[int, int]] = []

    def run(self) -> list[int] | None:
        """Return the vertices in their order."""
        for v in range(self.n):
            self._push(v)
        order = []
        while self.heap:
            key, v = heapq.heappop(self.heap)
            if self.done[v] or key != self._key(v) or (v >= self.n and not self._may_follow(v)):
                continue
            if self.rank is None and key > MOST:
                return None
            self.done[v] = True
            order.append(v)
            around = self.near[v]
            self.near[v] = set()
            for a in around:
                if self.rank is None:
                    self.near[a] |= around
                    self.near[a] -= {a, v}
                if not self.done[a] and (a < self.n or self._may_follow(a)):
                    self._push(a)
            changed = self._after_node(v) if v < self.n else self._after_joint(v)
            if changed >= 0:
                for k in self.left[self._root(changed)]:
                    if self._may_follow(k):
                        self._push(k)
        return order

    def _key(self, v: int) -> int:
        return len(self.near[v]) if self.rank is None else self.rank[v]

    def _push(self, v: int) -> None:
        heapq.heappush(self.heap, (self._key(v), v))

    def _root(self, a: int) -> int:
        while self.parent[a] != a:
            self.parent[a] = self.parent[self.parent[a]]
            a = self.parent[a]
        return a

    def _may_follow(self, k: int) -> bool:
        """Return whether joint k is independent of the joints eliminated before."""
        rows = self.joints[k - self.n].rows
        waits = [a for a in rows if not self.done[a]]
        roots = {self._root(a) for a in rows if self.done[a]}
        states = [self.state[a] for a in roots]
        if waits:
            return len(rows) == 2 and not self.joints[k - self.n].held and states == [FREE]
        if self.joints[k - self.n].held:
            return OPEN not in states
        # a loop within a component leaves its rigid motions alone
        return len(roots) <= 1 or states.count(OPEN) + (GROUND in states) <= 1

    def _after_node(self, v: int) -> int:
        """Close joints that were open to the node; return a node of the component that changed."""
        for k in self.touching[v]:
            if self.done[k]:
                self.left[self._root(v)].discard(k)
                for a in self.joints[k - self.n].rows:
                    root = self._root(a)
                    if a != v and self.open_joint[root] == k:
                        self.open_joint[root], self.state[root] = -1, FREE
                        self._join(a, v)
        return v

    def _after_joint(self, k: int) -> int:
        """Update components after joint k; return a node of the component that changed, -1 if the joint has no node yet."""
        rows = self.joints[k - self.n].rows
        gone = [a for a in rows if self.done[a]]
        for a in gone:
            self.left[self._root(a)].discard(k)
        if not gone:
            return -1
        if len(gone) < len(rows):
            root = self._root(gone[0])
            self.open_joint[root], self.state[root] = k, OPEN
        for a in gone[1:]:
            self._join(gone[0], a)
        if self.joints[k - self.n].held:
            self.state[self._root(gone[0])] = GROUND
        return gone[0]

    def _join(self, a: int, b: int) -> None:
        """Join two components."""
        a, b = self._root(a), self._root(b)
        if a == b:
            return
        if len(self.left[a]) < len(self.left[b]):
            a, b = b, a
        self.parent[b] = a
        self.left[a] |= self.left[b]
        self.left[b] = set()
        self.open_joint[a] = max(self.open_joint[a], self.open_joint[b])
        self.state[a] = max(self.state[a], self.state[b])
