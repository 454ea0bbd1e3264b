"""Rigid and ball connections as linear maps between nodes: no multipliers, nothing to drift.

Nodes joined rigidly form a set with one root; a ball joint makes the position of one set's root follow another set. Every slave
node gets entries of `kernels.beams.ties.Ties`, or, where beams of a net are welded, the row of its root.
"""
from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.layout import ARM, POSITION, TRIAD

Array = np.ndarray
HOLD_POSITION, HOLD_TRIAD = 7, 56
AXES = "xyz"
# components of an axis of a plane below this count as zero
OBLIQUE = 1e-9
NO_PAIRS = np.zeros((0, 2), np.int64)


@dataclass
class Connections:
    """Connections between nodes: slave nodes with their master nodes, shared rows and spins, fixed unknowns."""

    held: Array  # int [N]: mask of fixed unknowns of every node
    # spin_root, row_root, int [N]: the node whose spin a node shares; the node whose row, all six unknowns, it shares
    spin_root: Array
    row_root: Array
    start: Array  # int [N + 1]: range of the entries of every node; empty for a free node
    # kind, target, int [M]
    kind: Array
    target: Array
    # offset, rotation, [M, 3], [M, 3, 3]: offset of an ARM in the triad of the target; d_i = sum_j R_ij d_j of the target of a
    # TRIAD
    offset: Array
    rotation: Array
    # int [L]: ball joints, counted through `balls` and then `hinges`, that close loops of rigid parts and supports: with
    # multipliers
    loops: Array

    @property
    def tied(self) -> Array:
        """True for slave nodes, which have entries, bool [N]."""
        return np.diff(self.start) > 0

    @property
    def owner(self) -> Array:
        """Slave node of every entry, int [M]."""
        return np.repeat(np.arange(self.held.size), np.diff(self.start))

    @cached_property
    def entries(self) -> dict[int, list[tuple[int, int, Array, Array]]]:
        """Entries (kind, target, offset, rotation) of every slave node."""
        flat = list(zip(self.kind.tolist(), self.target.tolist(), self.offset, self.rotation))
        return {int(k): flat[self.start[k]:self.start[k + 1]] for k in np.flatnonzero(self.tied)}

    def targets(self, node: int) -> list[int]:
        """Return the nodes that the unknowns of `node` belong to."""
        return np.unique(self.target[self.start[node]:self.start[node + 1]]).tolist() or [node]

    def without_welds(self) -> Connections:
        """Return the connections without the entries of nodes that share the row of another."""
        owner = self.owner
        keep = self.row_root[owner] == owner
        start = np.concatenate(([0], np.cumsum(np.bincount(owner[keep], minlength=self.held.size))))
        return Connections(self.held, self.spin_root, self.row_root, start, self.kind[keep], self.target[keep],
                           self.offset[keep], self.rotation[keep], self.loops)


class _Sets:
    """Disjoint sets with union and find."""

    def __init__(self, n: int) -> None:
        self.parent = list(range(n))

    def find(self, i: int) -> int:
        while self.parent[i] != i:
            self.parent[i] = self.parent[self.parent[i]]
            i = self.parent[i]
        return i

    def join(self, i: int, j: int) -> bool:
        a, b = self.find(i), self.find(j)
        self.parent[max(a, b)] = min(a, b)
        return a != b


def connect(phi: Array, directors: Array, rigid: list[tuple[int, int, str]], balls: list[tuple[int, int, str]], held: Array,
            rank: Array, labels: Sequence[str], tolerance: float, welds: Array = NO_PAIRS,
            hinges: Array = NO_PAIRS) -> Connections:
    """Resolve all connections.

    phi, directors: [N, 3], [N, 3, 3], reference positions and triads.
    rigid, balls: list of (node, node, name).
    held: int [N], masks of supports: 63 clamped, 7 pinned, some of its bits where single axes are held, 56 the inert triad of a
        point mass.
    rank: int [N], rank of a node in a rigid set, whose root is the lowest; 9 for nodes without rotation.
    labels: names of the nodes for messages.
    tolerance: length below which an offset counts as zero.
    welds, hinges: int [*, 2], pairs of coincident beam ends joined rigidly, by ball joints. A welded end shares the row of its
        root where that is free.
    Raises SceneError: a support or joint that this elimination cannot express; the message says what to do instead.
    """
    n = len(phi)
    fixed = np.concatenate((_pairs(rigid), welds))
    ball = np.concatenate((_pairs(balls), hinges))
    every = np.arange(n)
    out = Connections(held.copy(), every.copy(), every.copy(), np.zeros(n + 1, np.int64), np.zeros(0, np.int64),
                      np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0, np.int64))
    if not (len(fixed) or len(ball)):
        return out
    touched = np.zeros(n, bool)
    touched[fixed] = touched[ball] = True
    touched = np.flatnonzero(touched)
    root_of = _rigid_roots(n, fixed, touched, held, rank, labels)
    offset = np.zeros((n, 3))
    root = root_of[touched]
    c = (directors[root] @ (phi[touched] - phi[root])[:, :, None])[:, :, 0]
    offset[touched] = np.where(np.abs(c) > tolerance, c, 0.0)
    out.held = _supported_roots(held, touched, root_of, offset, labels)
    name = partial(_joint_name, balls, ball, labels)
    out.loops = _loops(root_of, ball, offset, out.held, name)
    base, arms = _ball_trees(root_of, np.delete(ball, out.loops, axis=0), offset, out.held, rank)
    trees = _Trees(root_of, offset, base, arms)
    _check_fixed_joints(trees, ball, out, name, labels)
    slave = touched[(touched != root) | (base[root] != root)]
    root = root_of[slave]
    turns = (slave != root) & (rank[slave] != 9)
    of, out.kind, out.target, out.offset, out.rotation = _entries(trees, slave, turns, directors, tolerance)
    out.start = np.concatenate(([0], np.cumsum(np.bincount(of, minlength=n))))
    out.held[slave] |= HOLD_POSITION
    out.held[slave[turns]] |= HOLD_TRIAD
    out.spin_root[slave[turns]] = root[turns]
    # a welded end at the place of a root with its own unknowns needs no entries: the same unknowns move it
    welded = np.zeros(n, bool)
    welded[welds] = True
    shares = welded[slave] & turns & (base[root] == root) & ~np.any(offset[slave], axis=1)
    out.row_root[slave[shares]] = root[shares]
    out.held[slave[shares]] = 0
    return out


class _Trees(NamedTuple):
    """Rigid sets of nodes, and how ball joints make them follow each other."""

    root_of: Array    # int [n]: root of the rigid set of every node
    offset: Array     # float64 [n, 3]: from there, in the triad of the root
    base: Array       # int [n]: node whose position starts that of a root
    arms: dict[int, list[tuple[int, Array]]]    # offsets in triads from there on, for the roots that have any


def _supported_roots(held: Array, touched: Array, root_of: Array, offset: Array, labels: Sequence[str]) -> Array:
    """Pass pins of nodes on to their roots: masks of supports, int [n]. Raises SceneError: a pin at a distance from a root that
    may turn."""
    out, root = held.copy(), root_of[touched]
    pinned = touched[(touched != root) & (held[touched] & 7 != 0) & (held[touched] != 63) & (held[root] != 63)]
    np.bitwise_or.at(out, root_of[pinned], held[pinned])
    for k in pinned[np.any(offset[pinned], axis=1) & (out[root_of[pinned]] & HOLD_TRIAD == 0)]:
        raise SceneError(f"pin of {labels[k]}: a rigid connection joins it to {labels[root_of[k]]} at a distance, where both "
                         "pins together constrain more than one; clamp it, or pin only one of them")
    return out


def _joint_name(balls: list[tuple[int, int, str]], ball: Array, labels: Sequence[str], j: int) -> str:
    return balls[j][2] if j < len(balls) else f"ball joint of {labels[ball[j, 0]]} and {labels[ball[j, 1]]}"


def _check_fixed_joints(trees: _Trees, ball: Array, out: Connections, name: Callable[[int], str], labels: Sequence[str]) -> None:
    """Refuse ball joints that close loops between sides which nothing can move. Raises SceneError."""
    a, b = ball[out.loops].T
    fixed = _fixed_axes(trees, a, out.held) & _fixed_axes(trees, b, out.held)
    for k in np.flatnonzero(fixed).tolist():
        axes = "".join(x for i, x in enumerate(AXES) if fixed[k] >> i & 1)
        along = "" if fixed[k] == HOLD_POSITION else f" along {axes}"
        sides = ", ".join(labels[trees.root_of[x]] for x in (a[k], b[k]))
        raise SceneError(f"{name(int(out.loops[k]))}: supports fix both sides{along} ({sides}), so the joint has no "
                         f"effect{along and ' there'}; remove {('' if along else 'it or ')}one of the supports")


def _fixed_axes(trees: _Trees, nodes: Array, held: Array) -> Array:
    """Find axes along which nothing can move nodes, int [*], bit by bit."""
    top = trees.root_of[nodes]
    turns = np.any(trees.offset[nodes], axis=1) | np.isin(top, list(trees.arms))
    return np.where(held[top] == 63, HOLD_POSITION, np.where(turns, 0, held[trees.base[top]] & HOLD_POSITION))


def _entries(trees: _Trees, slave: Array, turns: Array, directors: Array, tolerance: float) -> Iterable[Array]:
    """Form entries, position, arms, triad, of tied nodes, ordered by these: owner, kind, target, offset, rotation. turns: which
    take their triads from their roots."""
    root_of, offset, base, arms = trees
    root = root_of[slave]
    parts = [_alike(POSITION, slave, base[root])]
    on_balls = np.isin(root, list(arms))
    for k in slave[on_balls].tolist():
        spread: dict[int, Array] = {}
        for node, part in [*arms[root_of[k]], (int(root_of[k]), offset[k])]:
            spread[node] = spread.get(node, np.zeros(3)) + part
        longer = {node: x for node, x in spread.items() if np.any(np.abs(x) > tolerance)}
        parts.append(_alike(ARM, np.full(len(longer), k), np.array(list(longer), np.int64),
                            np.array(list(longer.values())).reshape(-1, 3)))
    on_arms = slave[~on_balls & np.any(offset[slave], axis=1)]
    rotation = np.broadcast_to(np.eye(3), (slave.size, 3, 3)).copy()
    rotation[turns] = directors[slave[turns]] @ directors[root[turns]].transpose(0, 2, 1)
    parts += [_alike(ARM, on_arms, root_of[on_arms], offset[on_arms]),
              _alike(TRIAD, slave, np.where(turns, root, slave), rotation=rotation)]
    whole = [np.concatenate(x) for x in zip(*parts)]
    order = np.argsort(whole[0], kind="stable")
    return (x[order] for x in whole)


def _alike(kind: int, owner: Array, target: Array, offset: Array = np.zeros(3),
           rotation: Array = np.eye(3)) -> tuple[Array, Array, Array, Array, Array]:
    """Form entries of one kind: owner, kind, target, offset, rotation."""
    n = owner.size
    return owner, np.full(n, kind), target, np.broadcast_to(offset, (n, 3)), np.broadcast_to(rotation, (n, 3, 3))


def _pairs(joints: list[tuple[int, int, str]]) -> Array:
    return np.array([joint[:2] for joint in joints], np.int64).reshape(-1, 2)


def components(n: int, edges: Array) -> Array:
    """Return the number of the connected component of every node, int [n]; edges: int [*, 2]. Every root takes the smallest
    neighbouring root until none has a neighbour; SciPy's function would do the same, but its import takes a fifth of the time of
    a warm start."""
    root = np.arange(n)
    a, b = edges[:, 0], edges[:, 1]
    while a.size:
        np.minimum.at(root, np.maximum(a, b), np.minimum(a, b))
        while not np.array_equal(root, up := root[root]):
            root = up
        a, b = root[a], root[b]
        distinct = a != b
        a, b = a[distinct], b[distinct]
    return np.unique(root, return_inverse=True)[1]


def searched(edges: Array, top: Array, n: int) -> tuple[Array, Array]:
    """Return n nodes, in order from the node `top` of each of their connected components on, and the node before each, int64 [n],
    -1 for those of `top`."""
    # an additional node connects all components, so that one search goes through all of them
    whole = np.concatenate((edges, np.stack((np.full(top.size, n), top), axis=1)))
    graph = sparse.coo_matrix((np.ones(len(whole), np.int8), (whole[:, 0], whole[:, 1])), shape=(n + 1, n + 1))
    reached, before = sparse.csgraph.breadth_first_order(graph.tocsr(), n, directed=False)
    before = before[:n].astype(np.int64)
    return reached[1:], np.where(before == n, -1, before)


def fixed_axes(held: Array) -> Array:
    """Return which components of positions are fixed, bool [n, 3], from masks [n]."""
    return (held[:, None] >> np.arange(3)) & 1 != 0


def fixed_in_plane(held: Array, axes: Array) -> Array:
    """Return masks of the three unknowns in a plane from masks of six, int [*]: the turn where all three spins are fixed, a
    position along an axis of the plane where all its components are. axes: of the plane, [3, 3]."""
    out = np.where(held & HOLD_TRIAD == HOLD_TRIAD, 4, 0)
    for c in range(2):
        parts = sum(1 << i for i in range(3) if abs(axes[c, i]) > OBLIQUE)
        out |= np.where(held & parts == parts, 1 << c, 0)
    return out


def _freedom(held: Array) -> Array:
    """Return 0 where a position is fixed, 1 where some of its components are, 2 where none is, [n]."""
    some = held & HOLD_POSITION
    return np.where(some == HOLD_POSITION, 0, np.where(some != 0, 1, 2))


def _rigid_roots(n: int, fixed: Array, touched: Array, held: Array, rank: Array, labels: Sequence[str]) -> Array:
    """Return the root of the rigid set of every touched node, int [n]."""
    group = components(n, fixed)[touched]
    rate = np.where(held[touched] == 63, 0, 1 + _freedom(held[touched]))
    order = np.lexsort((touched, rank[touched], rate))
    _, first, of, count = np.unique(group[order], return_index=True, return_inverse=True, return_counts=True)
    root = touched[order[first]]
    for g in np.flatnonzero((rank[root] == 9) & (count > 1)):
        members = np.sort(touched[order[of == g]])
        raise SceneError(f"rigid connection of {' and '.join(labels[k] for k in members)}: point masses have no rotation; "
                         "use a RigidBody, or a BallJoint where they coincide")
    root_of = np.arange(n)
    root_of[touched[order]] = root[of]
    return root_of


def _loops(root_of: Array, ball: Array, offset: Array, held: Array, name: Callable[[int], str]) -> Array:
    """Find ball joints between rigid sets, or supports of them, that joints before them connect already, int [L]. Raises
    SceneError: a joint between parts that are joined at the same point already."""
    if not len(ball):
        return np.zeros(0, np.int64)
    sides = root_of[ball]
    roots, local = np.unique(sides, return_inverse=True)
    local = local.reshape(-1, 2)
    m = roots.size
    standing = held[roots] & HOLD_POSITION != 0
    # every support is connected to the ground, an additional set
    ground = np.flatnonzero(standing)
    n_trees = components(m + 1, np.concatenate((local, np.stack((ground, np.full(ground.size, m)), axis=1)))).max() + 1
    if not np.any(local[:, 0] == local[:, 1]) and len(ball) + ground.size == m + 1 - n_trees:
        return np.zeros(0, np.int64)
    sets = _Sets(m + 1)
    for i in ground.tolist():
        sets.join(i, m)
    loops = []
    first: dict[tuple[int, int], list[int]] = {}
    for j, (a, b) in enumerate(local.tolist()):
        before = first.setdefault((min(a, b), max(a, b)), [])
        before.append(j)
        if a == b:
            raise SceneError(f"{name(j)}: rigid connections join both of its sides already, so the joint has no effect; remove "
                             "it")
        if sets.join(a, b):
            continue
        if any(np.array_equal(_sides(offset, ball[j], a, local[j]), _sides(offset, ball[k], a, local[k])) for k in before[:-1]):
            raise SceneError(f"{name(j)}: it joins the same rigid parts at the same point as {name(before[0])}, so it has no "
                             "effect; remove it")
        loops.append(j)
    return np.array(loops, np.int64)


def _sides(offset: Array, pair: Array, a: int, local: Array) -> Array:
    """Return the offsets of both sides of a joint in the triads of their roots, that of root a first."""
    return offset[pair if local[0] == a else pair[::-1]]


def _ball_trees(root_of: Array, ball: Array, offset: Array, held: Array,
                rank: Array) -> tuple[Array, dict[int, list[tuple[int, Array]]]]:
    """Return the node from which the position of every root's set starts [n], and offsets in triads from there on for the roots
    that have any, for ball joints that close no loops; at most one set of a tree is supported."""
    base = np.arange(root_of.size)
    arms: dict[int, list[tuple[int, Array]]] = {}
    if not len(ball):
        return base, arms
    sides = root_of[ball]
    roots, local = np.unique(sides, return_inverse=True)
    local = local.reshape(-1, 2)
    m = roots.size
    tree = components(m, local)
    order = np.lexsort((roots, rank[roots], _freedom(held[roots])))
    top = np.full(tree.max() + 1, -1)
    top[tree[order[::-1]]] = order[::-1]
    base[roots] = roots[top[tree]]
    reached, parent = searched(local, top, m)
    child = reached[parent[reached] >= 0]
    # the joint between a child and its parent: the keys of both sides are distinct in a forest
    key = np.minimum(local[:, 0], local[:, 1]) * m + np.maximum(local[:, 0], local[:, 1])
    by_key = np.argsort(key)
    above = parent[child]
    joint = by_key[np.searchsorted(key[by_key], np.minimum(child, above) * m + np.maximum(child, above))]
    side = (sides[joint, 1] == roots[child]).astype(np.int64)
    at_child, at_parent = ball[joint, side], ball[joint, 1 - side]
    away = np.any(offset[at_parent], axis=1) | np.any(offset[at_child], axis=1)
    if away.any():
        # parents come before their children
        for i in range(child.size):
            up, down = int(roots[above[i]]), int(roots[child[i]])
            if away[i] or up in arms:
                arms[down] = [*arms.get(up, []), (up, offset[at_parent[i]]), (down, -offset[at_child[i]])]
    return base, arms
