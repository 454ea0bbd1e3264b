"""Regularisation of joints with multipliers: none in trees of rigid parts, which are never redundant (theory.md 5.5)."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.model.connections import HOLD_POSITION, HOLD_TRIAD, Connections, components
from fastbeam.model.joints.constraints import ConstrainedJoint

Array = np.ndarray
POINT_MASS = 9
# largest number of links from the ground in loops with full regularisation; in chains of n links the gap that an iteration
# leaves grows with n^2
MANY_LINKS = 30.0


def softness_of(kept: Sequence[ConstrainedJoint], connections: Connections, rank: Array) -> Array:
    """Return the share of 1/a, theory.md (5.5), in the equations of every joint with multipliers, [J].

    0: the joint belongs to a tree of rigid parts, where all forces are determined: plain multipliers; 1 in loops, less in long
    loops. Nodes that share a spin are one rigid part; all supports are one part, the ground; joints connect parts,
    eliminated joints included.

    rank: int [N], rank of nodes as in `NodeList`; POINT_MASS: without a triad.
    """
    if not kept:
        return np.zeros(0)
    root, owner = connections.spin_root, connections.owner
    n = root.size
    held = connections.held & np.where(rank == POINT_MASS, HOLD_POSITION, HOLD_POSITION | HOLD_TRIAD)
    part = np.where((held != 0) & ~connections.tied, n, root)
    # a fixed node fixes its whole part
    grounded = np.zeros(n + 1, bool)
    grounded[root[part == n]] = grounded[n] = True
    part = np.where(grounded[root], n, root)
    ties = np.unique(np.sort(part[np.stack((owner, connections.target), axis=1)], axis=1), axis=0)
    ties = ties[ties[:, 0] != ties[:, 1]]
    # a coupling of coordinates is no edge: it is as its joints are
    joints = [link for link in kept if not link.coupled]
    ends = np.sort(part[np.array([link.node for link in joints])], axis=1)
    # the conditions of one joint are one edge
    _, joint = np.unique([link.joint for link in joints], return_inverse=True)
    edges = np.concatenate((ties, np.unique(np.column_stack((ends, joint)), axis=0)[:, :2]))
    component = components(n + 1, edges)
    members = np.bincount(component)
    links = np.bincount(component[edges[:, 0]], minlength=members.size)
    soft = np.where(links == members - 1, 0.0, 1.0)
    for c in np.flatnonzero((links >= members) & (members > MANY_LINKS)):
        ours = component[ends[:, 0]] == c
        if ours.any():
            first = n if component[n] == c else int(ends[ours][0, 0])
            graph = sparse.csr_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n + 1, n + 1))
            order, before = sparse.csgraph.breadth_first_order(graph, first, directed=False)
            far = np.zeros(n + 1)
            for i in order[1:].tolist():
                far[i] = far[before[i]] + 1.0
            soft[c] = min(1.0, (MANY_LINKS / far.max())**2)
    at = np.concatenate(([0], np.cumsum([len(link.node) for link in kept])))[:-1]
    every = part[np.concatenate([link.node for link in kept])]
    return np.maximum.reduceat(soft[component[every]], at)
