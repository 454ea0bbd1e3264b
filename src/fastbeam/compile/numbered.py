"""First stage of the compiler: global numbers of all nodes, their connections, and the size of the scene."""
from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from fastbeam.compile.initial import place_points
from fastbeam.compile.links import Links
from fastbeam.model.connections import NO_PAIRS, Connections, connect
from fastbeam.model.numbering import NodeList
from fastbeam.scene import Beam, Scene

Array = np.ndarray


@dataclass(frozen=True)
class Numbered:
    """Nodes of a scene and their connections."""

    nodes: NodeList  # numbers, reference positions and triads of all nodes
    length: float  # size of the scene, m
    joints: Connections  # slave nodes, shared rows and spins, unknowns that supports fix
    links: Links  # springs and joints with multipliers
    dragged: Array  # int64 [*]: nodes with drag or added mass
    always: Array  # int64 [N]: unknowns of every node that supports without `until` and `since` fix
    late: Array  # int64 [N]: unknowns that only supports with `since` fix, at the nodes whose rows they are
    supported: Array  # int64 [*]: nodes of all supports; for a support at a body the node of the body

    @property
    def joints_at_start(self) -> Connections:
        """Connections with the unknowns that are fixed before supports with `since` take hold."""
        return replace(self.joints, held=self.joints.held & ~self.late) if self.late.any() else self.joints

    @property
    def touched(self) -> Array:
        """Nodes that links, drag and added mass touch; they are not eliminated inside elements and beams."""
        return np.union1d(self.links.touched, self.dragged)


def number(scene: Scene, moved: Collection[Beam] = ()) -> Numbered:
    """Number the nodes of a scene; moved: beams whose elements move with their contacts. Raises SceneError: joints cannot be
    eliminated, or are impossible at the places of their ends."""
    nodes = NodeList(scene, moved)
    place_points(scene, nodes)
    length = max([nodes.extent, *(b.length for b in scene.beams), *(float(net.lengths.max()) for net in scene.nets)]) or 1.0
    joints, hinges, always, late, supported = _connections(scene, nodes, length)
    every = np.arange(len(nodes))
    dragged = np.concatenate([np.zeros(0, np.int64), *(every[nodes.span(x.on)] for x in (*scene.drags, *scene.added_masses))])
    return Numbered(nodes, length, joints, Links(scene, nodes, joints, hinges), dragged, always, late, supported)


def _connections(scene: Scene, nodes: NodeList, length: float) -> tuple[Connections, Array, Array, Array, Array]:
    """Return the connections of nodes, the ball joints of nets, int [*, 2], the unknowns that supports without changes fix, those
    that only supports with `since` fix, int64 [N] each, and the nodes of supports, int64 [*]."""
    held = np.zeros(len(nodes), np.int64)
    welds, hinges = [NO_PAIRS], [NO_PAIRS]
    for net in scene.nets:
        held[nodes.span(net)] |= net.held()
        for found, pairs in zip((welds, hinges), net.pairs()):
            found.append(nodes.start(net) + pairs)
    for mass in scene.masses:
        held[nodes.start(mass)] = 56
    held[nodes.ground] = 63
    always, begins = held.copy(), held.copy()
    supports = [*scene.pins, *scene.prescribed, *scene.clamps]
    supported = nodes.held(supports)
    for support, node in zip(supports, supported.tolist()):
        held[node] |= support.mask
        always[node] |= support.mask if support.until is None and support.since is None else 0
        begins[node] |= support.mask if support.since is None else 0
    rigid = [(nodes.number(j.a), nodes.number(j.b), str(j.name)) for j in scene.rigid]
    rigid += [(owner, arm, "point") for owner, arm in nodes.arm_owner]
    balls = [(nodes.number(j.a), nodes.number(j.b), str(j.name)) for j in scene.balls]
    joints = connect(nodes.phi, nodes.directors, rigid, balls, held, nodes.rank, nodes.labels, 1e-14 * length,
                     np.concatenate(welds), np.concatenate(hinges))
    late, early = np.zeros_like(held), np.zeros_like(held)
    for mine, given in ((late, held & ~begins), (early, begins)):
        np.bitwise_or.at(mine, joints.row_root, given)
    return joints, np.concatenate(hinges), always, late & ~early, supported
