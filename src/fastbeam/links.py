"""Registry of what couples two points: springs and other links. One entry turns all parts of a kind into the table of its term.

A new kind of link is a noun in scene/, a file in kernels/ with its table and what it adds to a step, and an entry here.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from .connections import Connections
from .kernels.spring import Springs
from .numbering import NodeList
from .scene import Scene, Spring
from .scene.links import Link

Array = np.ndarray


class Blocks(Protocol):
    """Numbers of the blocks of the tangent."""

    def between(self, a: Array, b: Array) -> Array:
        """Blocks that couple nodes, int [n]."""


class Ends:
    """Both ends of all links of one kind, as tables need them.

    Attributes
    ----------
    node : int64 [L, 2]
        Nodes.
    row : int64 [L, 2]
        Their rows of the residual.
    block : int64 [L, 4]
        Blocks a-a, a-b, b-a, b-b of the tangent.
    distance : float64 [L]
        Of both ends at t = 0, m.
    """

    def __init__(self, links: list[Any], nodes: NodeList, blocks: Blocks, row_of: Array) -> None:
        self.node = ends_of(links, nodes)
        a, b = self.node.T
        self.row = row_of[self.node]
        self.block = np.stack([blocks.between(i, j) for i in (a, b) for j in (a, b)], axis=1)
        self.distance = np.linalg.norm(nodes.phi[b] - nodes.phi[a], axis=1)


@dataclass(frozen=True)
class Entry:
    """A kind of link: its noun, and the table of all links of this kind."""

    noun: type[Link]
    table: Callable[[list[Any], Ends], Any]


def _springs(springs: list[Spring], ends: Ends) -> Springs:
    length = np.array([d if x.length is None else x.length for x, d in zip(springs, ends.distance)])
    return Springs(ends.node, ends.row, ends.block, np.array([x.stiffness for x in springs]), length)


REGISTRY = (Entry(Spring, _springs),)


def ends_of(links: list[Any], nodes: NodeList) -> Array:
    """Nodes at both ends, int64 [L, 2]."""
    return np.array([(nodes.number(x.a), nodes.number(x.b)) for x in links], np.int64).reshape(-1, 2)


def linked_nodes(scene: Scene, nodes: NodeList) -> Array:
    """All nodes that a link touches; they are not eliminated inside elements and beams."""
    return np.unique(ends_of(scene.links, nodes))


def coupled_pairs(scene: Scene, nodes: NodeList, joints: Connections) -> Array:
    """Pairs of nodes i, j that links couple, as i N + j."""
    a, b = joints.row_root[ends_of(scene.links, nodes)].T
    n = len(nodes)
    return np.concatenate((a * n + a, a * n + b, b * n + a, b * n + b))


def link_tables(scene: Scene, nodes: NodeList, blocks: Blocks, row_of: Array) -> tuple[Any, ...]:
    """The tables of all kinds of links that the scene has."""
    found = [(entry, [x for x in scene.links if type(x) is entry.noun]) for entry in REGISTRY]
    return tuple(entry.table(links, Ends(links, nodes, blocks, row_of)) for entry, links in found if links)
