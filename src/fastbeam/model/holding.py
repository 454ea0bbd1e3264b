"""What holds the nodes of a scene: supports, and eliminated joints as trees, whose forces the equations of nodes tell."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Holding:
    """What holds the nodes of a scene.

    Attributes
    ----------
    support_names : list of str
    supports : int64 [R]
        Their nodes.
    masks : int64 [R]
        What each holds of the six unknowns of its node, bit by bit.
    turning : int64 [R', 2]
        Further nodes whose rotation a support holds: (support, node).
    joint_names : list of str
        Joints that are eliminated, of tree-like connections of nodes.
    joints : int64 [J, 2]
        Nodes of sides a and b.
    parent : int64 [N]
        The node that a connected node hangs on, towards a support where there is one; -1 for others.
    determined : bool [N]
        Whether the connections around a node are a tree with one support at most, so that its equations tell their forces.
    """

    support_names: list[str]
    supports: Array
    masks: Array
    turning: Array
    joint_names: list[str]
    joints: Array
    parent: Array
    determined: Array


def trees(n: int, pairs: Array, supports: Array) -> tuple[Array, Array]:
    """`parent` and `determined` of `Holding`, of n nodes: pairs that are connected [*, 2], nodes of supports [*]."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import breadth_first_order, connected_components
    parent, determined = np.full(n, -1), np.ones(n, bool)
    if not len(pairs):
        return parent, determined
    graph = coo_matrix((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    count, part = connected_components(graph, directed=False)
    holds = np.bincount(part[np.unique(supports)], minlength=count)
    edges, members = np.bincount(part[pairs[:, 0]], minlength=count), np.bincount(part, minlength=count)
    determined = ((edges == members - 1) & (holds <= 1))[part]
    top = np.full(count, -1)
    top[part[::-1]] = np.arange(n)[::-1]
    top[part[supports]] = supports
    # every tree hangs on one more node, so that one search goes through all
    whole = coo_matrix((np.ones(len(pairs) + count, np.int8), (np.concatenate((pairs[:, 0], np.full(count, n))),
                                                               np.concatenate((pairs[:, 1], top)))), shape=(n + 1, n + 1))
    _, above = breadth_first_order(whole.tocsr(), n, directed=False)
    above = above[:n].astype(np.int64)
    parent[:] = np.where(above == n, -1, above)
    return parent, determined
