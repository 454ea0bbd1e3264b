"""Supports of a scene, and its eliminated joints as trees, whose forces follow from the equations of nodes."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fastbeam.model.connections import components, searched

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
    if not len(pairs):
        return np.full(n, -1), np.ones(n, bool)
    part = components(n, pairs)
    count = part.max() + 1
    holds = np.bincount(part[np.unique(supports)], minlength=count)
    edges, members = np.bincount(part[pairs[:, 0]], minlength=count), np.bincount(part, minlength=count)
    top = np.full(count, -1)
    top[part[::-1]] = np.arange(n)[::-1]
    top[part[supports]] = supports
    return searched(pairs, top, n)[1], ((edges == members - 1) & (holds <= 1))[part]
