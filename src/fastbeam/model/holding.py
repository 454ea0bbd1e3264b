"""Supports of a scene, and its eliminated joints as trees, whose forces follow from the equations of nodes."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Holding:
    """Supports of a scene, and joints that are eliminated."""

    support_names: list[str]
    supports: Array  # int64 [R]: nodes of the supports
    masks: Array  # int64 [R]: unknowns of its node that each support fixes, one bit for each of the six
    turning: Array  # int64 [R', 2]: further nodes whose rotation a support holds: (support, node)
    joint_names: list[str]  # joints that are eliminated
    joints: Array  # int64 [J, 2]: nodes of sides a and b
    # int64 [N]: parent of a node in its tree of connections, towards a support where there is one; -1 for other nodes
    parent: Array
    # bool [N]: true if the connections around a node are a tree with one support at most, so that equilibrium determines their
    # forces
    determined: Array


def trees(n: int, pairs: Array, supports: Array) -> tuple[Array, Array]:
    """Return `parent` and `determined` of `Holding`, for n nodes, connected pairs [*, 2] and nodes of supports [*]."""
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
    # an additional node connects all trees, so that one search goes through all of them
    whole = coo_matrix((np.ones(len(pairs) + count, np.int8), (np.concatenate((pairs[:, 0], np.full(count, n))),
                                                               np.concatenate((pairs[:, 1], top)))), shape=(n + 1, n + 1))
    _, above = breadth_first_order(whole.tocsr(), n, directed=False)
    above = above[:n].astype(np.int64)
    parent[:] = np.where(above == n, -1, above)
    return parent, determined
