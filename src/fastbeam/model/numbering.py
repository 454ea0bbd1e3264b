"""Global numbers of the nodes of a scene, with their reference positions and triads."""
from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import Any

import numpy as np

from fastbeam.scene import Beam, Net, NodeRef, RigidBody, Scene
from fastbeam.scene.fixed import Ground
from fastbeam.scene.moving_mesh import LineOfPlaces, PlaceOnBeam
from fastbeam.scene.nets import NetBeam
from fastbeam.scene.placing import extent_of

Array = np.ndarray


class Labels(Sequence):
    """Texts of all nodes for messages, made when they are read."""

    def __init__(self) -> None:
        self._starts: list[int] = []
        self._owners: list[Beam | Net | NodeRef | str] = []
        self._n = 0

    def add(self, owner: Beam | Net | NodeRef | str, count: int = 1) -> None:
        """Register the owner of the next nodes: a part, a point, or a text."""
        self._starts.append(self._n)
        self._owners.append(owner)
        self._n += count

    def __len__(self) -> int:
        return self._n

    def owner(self, k: int) -> tuple[Beam | Net | NodeRef | str, int]:
        """Return the owner of node k, and its number there."""
        i = bisect_right(self._starts, k) - 1
        return self._owners[i], k - self._starts[i]

    def __getitem__(self, k: Any) -> Any:
        if isinstance(k, slice):
            return [self[i] for i in range(*k.indices(self._n))]
        owner, local = self.owner(range(self._n)[int(k)])
        if isinstance(owner, str):
            return owner
        if isinstance(owner, NodeRef):
            return owner.label
        if isinstance(owner, Net):
            beam = owner.beam_at(local)
            owner, local = owner.beam(beam), local - int(owner.node_start[beam])
        return f"{owner.label} node {local}"


class NodeList:
    """Global numbers of all nodes: beams, nets, bodies, masses, and one node for every used point of a body off its
    centre and of the ground."""

    def __init__(self, scene: Scene) -> None:
        self.first: dict[Any, int] = {}
        # curves of sliders (tracks.py)
        self.tracks: dict[tuple[Any, str, float], Any] = {}
        self.labels = Labels()
        phi: list[Array] = []
        directors: list[Array] = []
        rank: list[tuple[int, int]] = []

        def add(label: Beam | Net | NodeRef | str, p: Array, d: Array, r: int) -> int:
            first = len(self.labels)
            self.labels.add(label, len(p))
            phi.append(p)
            directors.append(d)
            rank.append((r, len(p)))
            return first

        for beam in scene.beams:
            p, d = beam.reference(beam.node_s)
            self.first[beam] = add(beam, beam.basis.fit_positions(p), d, 3)
        for net in scene.nets:
            self.first[net] = add(net, net.positions, net.directors, 3)
        upright = np.eye(3)
        for part in [*scene.bodies, *scene.masses]:
            self.first[part] = add(part.label, scene.position_of(part)[None], getattr(part, "directors", upright)[None],
                                       2 if isinstance(part, RigidBody) else 9)
        elsewhere = [self.first[x] for x in scene.masses if isinstance(x, PlaceOnBeam)]
        self.arms: dict[tuple[Any, tuple[float, ...]], int] = {}
        self.arm_owner: list[tuple[int, int]] = []
        # points of the ground
        self.ground: list[int] = []
        points = [s.point for s in scene.sliders] + [load.at for load in scene.loads]
        points += [force.at for force in scene.user_forces if not isinstance(force.at, Beam)]
        points += [node for winch in scene.winches for node in (winch.drum, winch.load)]
        points += [node for joint in [*scene.balls, *scene.rigid, *scene.links] for node in (joint.a, joint.b)]
        for node in points:
            key = (node.owner, tuple(node.offset.tolist()))
            fixed = isinstance(node.owner, Ground)
            if isinstance(node.owner, Beam) or (node.is_center and not fixed) or key in self.arms:
                continue
            if fixed:
                self.arms[key] = add(node, node.offset[None], node.owner.directors[None], 2)
                self.ground.append(self.arms[key])
                if isinstance(node.owner, LineOfPlaces):
                    elsewhere.append(self.arms[key])
                continue
            self.arms[key] = add(node, scene.position_of(node)[None], node.owner.directors[None], 4)
            self.arm_owner.append((self.first[node.owner], self.arms[key]))
        # part of every node: the first node of its beam, or beam of a net; for points of bodies the node of the body
        self.part = np.arange(len(self.labels))
        for beam in scene.beams:
            self.part[self.span(beam)] = self.start(beam)
        for net in scene.nets:
            first, last = (self.start(net) + net.end_node).T
            self.part[self.span(net)] = np.repeat(first, last - first + 1)
        for owner, arm in self.arm_owner:
            self.part[arm] = owner
        # initial spin of every node by rigid motions
        self.turning = np.zeros((len(self.labels), 3))
        for motion in scene.motions:
            for part in motion.objects or [*scene.beams, *scene.nets, *scene.bodies, *scene.masses]:
                self.turning[self.span(part)] += motion.spin
        for owner, arm in self.arm_owner:
            self.turning[arm] = self.turning[owner]
        self.phi = np.concatenate(phi)
        self._in_space = np.delete(np.arange(len(self.phi)), elsewhere)
        self.directors = np.concatenate(directors)
        self.rank = np.repeat(*np.array(rank).T)

    def __len__(self) -> int:
        return len(self.labels)

    @property
    def extent(self) -> float:
        """Extent of all nodes in space, m."""
        return extent_of(self.phi[self._in_space])

    def coordinates(self, nodes: Sequence[int]) -> Array:
        """Return the reference positions and directors of some nodes, [n, 4, 3]."""
        pick = list(nodes)
        return np.concatenate((self.phi[pick, None], self.directors[pick]), axis=1)

    def start(self, part: Any) -> int:
        """Return the global number of the first node of a beam, a beam of a net, a net, body or mass.

        Raises
        ------
        KeyError
            The part is not in the scene.
        """
        if isinstance(part, NetBeam):
            return self.first[part.net] + int(part.net.node_start[part.index])
        return self.first[part]

    def span(self, part: Any) -> slice:
        """Return the global numbers of all nodes of a part."""
        first = self.start(part)
        return slice(first, first + getattr(part, "n_nodes", 1))

    def number(self, node: NodeRef) -> int:
        """Return the global number of a node of the scene."""
        if isinstance(node.owner, Beam):
            return self.start(node.owner) + node.index
        if node.is_center and not isinstance(node.owner, Ground):
            return self.start(node.owner)
        return self.arms[node.owner, tuple(node.offset.tolist())]
