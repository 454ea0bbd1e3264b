"""Global numbers of the nodes of a scene, with their reference positions and triads."""
from __future__ import annotations

import numpy as np

from .scene import Beam, NodeRef, RigidBody, Scene

Array = np.ndarray


class NodeList:
    """Global numbers of all nodes: beams, then bodies, masses, and one node for every used point of a body off its centre."""

    def __init__(self, scene: Scene) -> None:
        self.first: dict[int, int] = {}
        self.labels: list[str] = []
        phi: list[Array] = []
        directors: list[Array] = []
        rank: list[int] = []
        for beam in scene.beams:
            self.first[id(beam)] = len(self.labels)
            p, d = beam.reference(beam.node_s)
            phi.append(beam.basis.fit_positions(p))
            directors.append(d)
            self.labels += [f"{beam.label} node {k}" for k in range(beam.n_nodes)]
            rank += [3] * beam.n_nodes
        for part in [*scene.bodies, *scene.masses]:
            self.first[id(part)] = len(self.labels)
            phi.append(scene.position_of(part)[None])
            directors.append(np.array(getattr(part, "directors", np.eye(3)))[None])
            self.labels.append(part.label)
            rank.append(2 if isinstance(part, RigidBody) else 9)
        self.arms: dict[tuple[int, tuple[float, ...]], int] = {}
        self.arm_owner: list[tuple[int, int]] = []
        points = [s.point for s in scene.sliders] + [load.at for load in scene.loads]
        points += [node for joint in [*scene.balls, *scene.rigid] for node in (joint.a, joint.b)]
        for node in points:
            key = (id(node.owner), tuple(node.offset.tolist()))
            if isinstance(node.owner, Beam) or node.is_center or key in self.arms:
                continue
            owner = self.first[id(node.owner)]
            self.arms[key] = len(self.labels)
            self.arm_owner.append((owner, len(self.labels)))
            phi.append(scene.position_of(node)[None])
            directors.append(np.array(node.owner.directors)[None])
            self.labels.append(node.label)
            rank.append(4)
        self.phi = np.concatenate(phi)
        self.directors = np.concatenate(directors)
        self.rank = np.array(rank)

    def __len__(self) -> int:
        return len(self.labels)

    def number(self, node: NodeRef) -> int:
        """Global number of a node of the scene."""
        if isinstance(node.owner, Beam):
            return self.first[id(node.owner)] + node.index
        if node.is_center:
            return self.first[id(node.owner)]
        return self.arms[id(node.owner), tuple(node.offset.tolist())]
