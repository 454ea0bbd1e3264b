"""Fourth stage of the compiler: elements in groups of eight, and which of their beams are condensed to their ends."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fastbeam.compile.carriers import carriers_of
from fastbeam.compile.substructuring import substructures_of
from fastbeam.compile.unpack import Unpacked
from fastbeam.kernels.linalg.carriers import Carriers
from fastbeam.model.tables import ElementPacker, condensed_ends
from fastbeam.scene import Scene

Array = np.ndarray


@dataclass(frozen=True)
class Condensed:
    """Elements in groups."""

    packers: dict[str, ElementPacker]  # packers of both strain sets
    moving: list[ElementPacker]  # packers of every beam whose elements move with contacts
    carriers: Carriers | None
    ends: Array  # int64 [B, 2]: first and last node of all condensed beams, carriers last

    @property
    def used(self) -> list[ElementPacker]:
        """Packers with elements."""
        return [packer for packer in (*self.packers.values(), *self.moving) if packer.meta]


def condense(scene: Scene, unpacked: Unpacked, condense: bool | str) -> Condensed:
    """Choose the beams that are condensed; condense: option of `compile_scene`."""
    numbered = unpacked.numbered
    nodes, joints, touched = numbered.nodes, numbered.joints, numbered.touched
    packers = {"simo_reissner": ElementPacker(), "green_lagrange": ElementPacker()}
    carried = None if not condense else carriers_of(scene, nodes, joints, touched)
    beams, carried = substructures_of(scene, nodes, joints, touched, condense, carried)
    for source, part in zip([*scene.beams, *scene.nets], unpacked.elements):
        some, found = beams.get(source.name, (None, []))
        if carried is not None and source.name in carried.elements:
            some = np.setdiff1d(np.arange(len(part.nodes)) if some is None else some, carried.taken(source.name))
        packers[part.strain].add(part, some)
        for lanes in found:
            packers[part.strain].add(part, lanes.reshape(-1), lanes.shape[1])
        for g, lanes in () if carried is None else carried.elements.get(source.name, ()):
            packers[part.strain].add(part, lanes, -1 - g)
    moving = [ElementPacker() for _ in unpacked.moving]
    for packer, part in zip(moving, unpacked.moving):
        packer.add(part)
    carriers = None if carried is None else carried.carriers._replace(tables=np.array(
        [(g, k, at, m) for k, packer in enumerate(packers.values()) for g, at, m in packer.carried()]))
    ends = condensed_ends([packer for packer in packers.values() if packer.meta])
    return Condensed(packers, moving, carriers, ends if carriers is None else np.concatenate((ends, carriers.ends)))
