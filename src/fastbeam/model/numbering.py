"""Global numbers of the nodes of a scene, with their reference positions and triads."""
from __future__ import annotations

from bisect import bisect_right
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from fastbeam.scene import Beam, Net, NodeRef, RigidBody, Scene
from fastbeam.scene.fixed import Ground
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


class _Nodes(NamedTuple):
    """Nodes that are numbered together."""

    key: Any
    label: Beam | Net | NodeRef | str
    phi: Array
    directors: Array
    rank: int


def _nodes_of_parts(scene: Scene) -> Iterator[_Nodes]:
    """Yield the nodes of every beam, net, body and mass."""
    for beam in scene.beams:
        p, d = beam.reference(beam.node_s)
        yield _Nodes(beam, beam, beam.basis.fit_positions(p), d, 3)
    for net in scene.nets:
        yield _Nodes(net, net, net.positions, net.directors, 3)
    upright = np.eye(3)
    for part in [*scene.bodies, *scene.masses]:
        yield _Nodes(part, part.label, scene.position_of(part)[None], getattr(part, "directors", upright)[None],
                     2 if isinstance(part, RigidBody) else 9)


def _nodes_of_points(scene: Scene) -> Iterator[_Nodes]:
    """Yield a node for every used point of a body off its centre and of the ground."""
    points = [s.point for s in scene.sliders] + [load.at for load in scene.loads]
    points += [force.at for force in scene.user_forces if not isinstance(force.at, Beam)]
    points += [node for winch in scene.winches for node in (winch.drum, winch.load)]
    points += [node for joint in [*scene.balls, *scene.rigid, *scene.links] for node in (joint.a, joint.b)]
    known = set()
    for node in points:
        key = _arm(node)
        fixed = isinstance(node.owner, Ground)
        if isinstance(node.owner, Beam) or (node.is_center and not fixed) or key in known:
            continue
        known.add(key)
        yield _Nodes(key, node, (node.offset if fixed else scene.position_of(node))[None], node.owner.directors[None],
                     2 if fixed else 4)


def _arm(node: NodeRef) -> tuple[Any, tuple[float, ...]]:
    """Form the key of a point of a body or of the ground."""
    return node.owner, tuple(node.offset.tolist())


class NodeList:
    """Global numbers of all nodes: beams, nets, bodies, masses, and one node for every used point of a body off its
    centre and of the ground; moved: beams whose elements move with their contacts."""

    def __init__(self, scene: Scene, moved: Collection[Any] = ()) -> None:
        self.moved = moved
        self.first: dict[Any, int] = {}
        self.arms: dict[tuple[Any, tuple[float, ...]], int] = {}
        # what sliders run on (tracks.py)
        self.tracks: dict[tuple[Any, str, float], Any] = {}
        self.labels = Labels()
        found: list[tuple[Array, Array, Array]] = []
        for numbers, every in ((self.first, _nodes_of_parts(scene)), (self.arms, _nodes_of_points(scene))):
            for key, label, phi, directors, rank in every:
                numbers[key] = len(self.labels)
                self.labels.add(label, len(phi))
                found.append((phi, directors, np.full(len(phi), rank)))
        self.phi, self.directors, self.rank = (np.concatenate(x) for x in zip(*found))
        on_ground = {arm: owner for (owner, _), arm in self.arms.items() if isinstance(owner, Ground)}
        # points of the ground
        self.ground = list(on_ground)
        self.arm_owner = [(self.first[owner], arm) for (owner, _), arm in self.arms.items() if arm not in on_ground]
        # of every node the first one of the beam, or of the beam of a net, that it belongs to; of points that of their body
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

    def __len__(self) -> int:
        return len(self.labels)

    @property
    def extent(self) -> float:
        """Extent of all nodes, m."""
        return extent_of(self.phi)

    def coordinates(self, nodes: Sequence[int]) -> Array:
        """Return the reference positions and directors of some nodes, [n, 4, 3]."""
        pick = list(nodes)
        return np.concatenate((self.phi[pick, None], self.directors[pick]), axis=1)

    def know(self, given: Mapping[Any, Any]) -> None:
        """Let the beams that a user knows stand for those in their place; given: the former by the latter."""
        self.first |= {own: self.first[there] for there, own in given.items()}

    def start(self, part: Any) -> int:
        """Return the global number of the first node of a beam, a beam of a net, a net, body or mass. Raises KeyError: the part
        is not in the scene."""
        if isinstance(part, NetBeam):
            return self.first[part.net] + int(part.net.node_start[part.index])
        return self.first[part]

    def span(self, part: Any) -> slice:
        """Return the global numbers of all nodes of a part."""
        first = self.start(part)
        return slice(first, first + getattr(part, "n_nodes", 1))

    def ends(self, links: Iterable[Any]) -> Array:
        """Return the global numbers of the nodes a and b of joints and links, int64 [L, 2]."""
        return np.array([(self.number(x.a), self.number(x.b)) for x in links], np.int64).reshape(-1, 2)

    def held(self, supports: Iterable[Any]) -> Array:
        """Return the global numbers of the nodes that supports hold, of a body its centre, int64 [S]."""
        return np.array([self.start(x.at.owner) if isinstance(x.at.owner, RigidBody) else self.number(x.at) for x in supports],
                        np.int64)

    def number(self, node: NodeRef) -> int:
        """Return the global number of a node of the scene."""
        if isinstance(node.owner, Beam):
            return self.start(node.owner) + node.index
        if node.is_center and not isinstance(node.owner, Ground):
            return self.start(node.owner)
        return self.arms[_arm(node)]
