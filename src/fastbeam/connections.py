"""Rigid and ball connections as linear maps between nodes: no multipliers, nothing to drift.

Nodes joined rigidly form a set with one root; a ball joint makes the position of one set's root follow another set. Every tied
node ends up with the entries of `kernels.nodes.Ties`.
"""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .errors import SceneError

Array = np.ndarray
POSITION, ARM, TRIAD = 0, 1, 2
HOLD_POSITION, HOLD_TRIAD = 7, 56


@dataclass
class Connections:
    """Entries (kind, target, offset (3,), rotation (3, 3)) of every tied node, the mask of held unknowns of every node, and the
    node whose spin each node shares."""

    entries: dict[int, list[tuple[int, int, Array, Array]]] = field(default_factory=dict)
    held: Array = field(default_factory=lambda: np.zeros(0, np.int64))
    spin_root: Array = field(default_factory=lambda: np.zeros(0, np.int64))

    def targets(self, node: int) -> list[int]:
        """Nodes that the unknowns of `node` belong to."""
        if node not in self.entries:
            return [node]
        return sorted({entry[1] for entry in self.entries[node]})


class _Sets:
    """Union-find."""

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
            rank: Array, labels: list[str], tolerance: float) -> Connections:
    """Resolve all connections.

    Parameters
    ----------
    phi, directors : [N, 3], [N, 3, 3]
        Reference positions and triads.
    rigid, balls : list of (node, node, name)
    held : int [N]
        Masks of supports: 63 clamped, 7 pinned, 56 the inert triad of a point mass.
    rank : int [N]
        Which node of a rigid set becomes its root: the lowest; 9 for nodes without rotation.
    labels : list of str
        Names of the nodes for messages.
    tolerance : float
        Length below which an offset is none.

    Raises
    ------
    SceneError
        A support or joint that this elimination cannot express; the message says what to do instead.
    """
    n = len(phi)
    out = Connections(held=held.copy(), spin_root=np.arange(n))
    if not rigid and not balls:
        return out
    sets = _Sets(n)
    for a, b, _ in rigid:
        sets.join(a, b)
    touched = sorted({k for a, b, _ in [*rigid, *balls] for k in (a, b)})
    members: dict[int, list[int]] = {}
    for k in touched:
        members.setdefault(sets.find(k), []).append(k)

    root_of: dict[int, int] = {}
    offset: dict[int, Array] = {}
    for group in members.values():
        root = min(group, key=lambda k: (0 if held[k] == 63 else 1 if held[k] & 7 else 2, rank[k], k))
        if rank[root] == 9 and len(group) > 1:
            raise SceneError(f"rigid connection of {' and '.join(labels[k] for k in group)}: point masses have no rotation; "
                             "use a RigidBody, or a BallJoint where they coincide")
        for k in group:
            root_of[k] = root
            c = directors[root] @ (phi[k] - phi[root])
            offset[k] = np.where(np.abs(c) > tolerance, c, 0.0)
            if k == root:
                continue
            if held[k] == 63:
                out.held[root] = 63
            elif held[k] & 7 and held[root] != 63:
                if np.any(offset[k]):
                    raise SceneError(f"pin of {labels[k]}: it is rigidly connected to {labels[root]} at a distance, together "
                                     "they are more than one pin; clamp it, or pin only one of them")
                out.held[root] |= 7

    # position of a set's root: base node plus offsets in triads
    roots = sorted(set(root_of.values()))
    base: dict[int, int] = {r: r for r in roots}
    arms: dict[int, list[tuple[int, Array]]] = {r: [] for r in roots}
    links: dict[int, list[tuple[int, int, int, str]]] = {r: [] for r in roots}
    trees = _Sets(n)
    for a, b, name in balls:
        ra, rb = root_of[a], root_of[b]
        if ra == rb or not trees.join(ra, rb):
            raise SceneError(f"{name}: it joins parts that rigid connections and ball joints already join (a hinge or a closed "
                             "loop of rigid parts); put a beam into the loop, or remove the joint")
        links[ra].append((rb, a, b, name))
        links[rb].append((ra, b, a, name))
    done: set[int] = set()
    for top in sorted(roots, key=lambda r: (0 if out.held[r] & 7 == 7 else 1, rank[r], r)):
        if top in done:
            continue
        done.add(top)
        queue = [top]
        while queue:
            parent = queue.pop(0)
            for child, at_parent, at_child, name in links[parent]:
                if child in done:
                    continue
                if out.held[child] & 7:
                    raise SceneError(f"{name}: both sides are held ({labels[parent]}, {labels[child]}), the joint does nothing; "
                                     "remove it or one of the supports")
                done.add(child)
                queue.append(child)
                base[child] = base[parent]
                arms[child] = [*arms[parent], (parent, offset[at_parent]), (child, -offset[at_child])]

    for k in touched:
        root = root_of[k]
        if k == root and base[root] == root:
            continue
        entries = [(POSITION, base[root], np.zeros(3), np.eye(3))]
        spread: dict[int, Array] = {}
        for node, c in [*arms[root], (root, offset[k])]:
            spread[node] = spread.get(node, np.zeros(3)) + c
        entries += [(ARM, node, c, np.eye(3)) for node, c in spread.items() if np.any(np.abs(c) > tolerance)]
        out.held[k] |= HOLD_POSITION
        if k != root and rank[k] != 9:
            entries.append((TRIAD, root, np.zeros(3), directors[k] @ directors[root].T))
            out.held[k] |= HOLD_TRIAD
            out.spin_root[k] = root
        else:
            entries.append((TRIAD, k, np.zeros(3), np.eye(3)))
        out.entries[k] = entries
    return out
