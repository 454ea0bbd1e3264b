"""What takes energy out of a scene besides its sliders, or puts it in: names, and places of their energies in `State.history`."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .kernels.beam import ElementTables
from .kernels.damping import Dissipation
from .kernels.layout import LIST
from .numbering import NodeList
from .scene import Beam, Net, Scene

Array = np.ndarray


@dataclass(frozen=True)
class Damped:
    """Beams and nets with damping.

    Attributes
    ----------
    labels : tuple of str
    strains : tuple of str
        Their strain sets.
    part : int64 [N]
        Of every node which of them it belongs to, -1: none.
    """

    labels: tuple[str, ...]
    strains: tuple[str, ...]
    part: Array

    def term(self, strains: Any, tables: ElementTables, first: int) -> Dissipation:
        """The term that books the energy of a strain set; first: place of the first part in the history."""
        meta = tables.meta
        lanes = meta[:, LIST, None] + np.arange(8)
        part = self.part[tables.nodes[lanes]]
        # idle lanes have the row behind the last
        live = tables.rows[lanes] < self.part.size
        return Dissipation(strains, tables, np.where((part >= 0) & live, first + part, -1).reshape(-1))


def damped_of(scene: Scene, nodes: NodeList) -> Damped | None:
    """None where no section has damping."""
    parts: list[Beam | Net] = [beam for beam in scene.beams if np.any(beam.section.damping)]
    parts += [net for net in scene.nets if any(np.any(section.damping) for section in net.sections)]
    if not parts:
        return None
    number = np.full(len(nodes), -1)
    for k, part in enumerate(parts):
        number[nodes.span(part)] = k
    return Damped(tuple(part.label for part in parts), tuple(part.strain for part in parts), number)
