"""What takes energy out of a scene besides its sliders, or puts it in: names, and places of their energies in `State.history`."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fastbeam.kernels.beams.damping import Dissipation
from fastbeam.kernels.beams.element_loop import ElementTables
from fastbeam.kernels.forces.drag import AirSchedule, Drag, NoWind, Wind
from fastbeam.kernels.layout import LIST
from fastbeam.model.forces.loads import factor_at, mean_factors
from fastbeam.model.forces.user_forces import wind_of
from fastbeam.model.model import Model
from fastbeam.model.numbering import NodeList
from fastbeam.model.tables import Elements, node_lengths
from fastbeam.scene import Beam, Net, Scene

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


@dataclass(frozen=True)
class Dragged:
    """Nodes with drag.

    Attributes
    ----------
    labels : tuple of str
        Of the drags.
    node, part : int64 [D]
        Nodes, and to which drag they belong.
    coefficient : float64 [D, 3]
        Normal, tangential and linear ones of whole nodes.
    slender : int64 [D]
        1 where d1 counts.
    air : float64 [D, 3]
        Velocity of the air, m/s.
    times : tuple of callable or None
        Of every drag the factor of that as a function of time.
    wind : Wind or NoWind
        Velocities of the air by functions of the user's own.
    """

    labels: tuple[str, ...]
    node: Array
    part: Array
    coefficient: Array
    slender: Array
    air: Array
    times: tuple[Any, ...] = ()
    wind: Wind | NoWind = NoWind()

    @property
    def timed(self) -> bool:
        """Whether the velocity of the air changes."""
        return any(time is not None for time in self.times)

    @property
    def blows(self) -> bool:
        """Whether the air moves, so that there is a force at rest."""
        return self.windy or bool(np.any(self.air))

    @property
    def turns(self) -> bool:
        """Whether that force depends on the shape."""
        return self.blows and (self.windy or bool(np.any(self.slender)))

    @property
    def windy(self) -> bool:
        """Whether functions of place and time give the velocity of the air."""
        return isinstance(self.wind, Wind)

    def factors_at(self, t: float) -> Array:
        """Of the air at a time, s, of every node, [D]."""
        return np.array([1.0 if time is None else factor_at(time, t, f"of {label}")
                         for time, label in zip(self.times, self.labels)])[self.part]

    def schedule(self, given: Array, terms: tuple[Any, ...], times: Array, steps: Array) -> AirSchedule:
        """The air in steps from these times on, of these sizes, s; given: float64 [*], the `air` of the tables of the model;
        terms: those of the run."""
        own = next(term for term in terms if isinstance(term, Drag))
        factors = np.ones((len(times), len(self.times)))
        for k, time in enumerate(self.times):
            if time is not None:
                factors[:, k] = mean_factors(time, times, steps, f"of {self.labels[k]}")
        return AirSchedule(own.air, given, self.part, factors)

    def tables(self, row_of: Array, block: Array, first: int) -> Drag:
        """Tables; block: diagonal blocks [D]; first: place of the first drag in the history."""
        return Drag(self.node, row_of[self.node], block, *np.ascontiguousarray(self.coefficient.T), self.slender,
                    self.air.reshape(-1), first + self.part, self.wind)


def dragged_of(scene: Scene, nodes: NodeList, elements: list[Elements]) -> Dragged | None:
    """None where there is no drag. elements: of every beam, then of every net."""
    if not scene.drags:
        return None
    length = np.zeros(len(nodes))
    for part in elements:
        length += node_lengths(part.nodes, part.mass_phi, length.size)
    node = [np.arange(len(nodes))[nodes.span(drag.on)] for drag in scene.drags]
    part = np.repeat(np.arange(len(node)), [x.size for x in node])
    every = np.concatenate(node)
    slender = np.array([int(drag.is_slender) for drag in scene.drags])[part]
    given = np.array([(drag.normal, drag.tangential, drag.linear) for drag in scene.drags])[part]
    return Dragged(tuple(f"{drag.label} on {drag.on.label}" for drag in scene.drags), every, part,
                   np.where(slender == 1, length[every], 1.0)[:, None] * given, slender,
                   np.array([drag.air for drag in scene.drags], dtype=float)[part], tuple(drag.time for drag in scene.drags),
                   wind_of(scene.drags, part, nodes.phi[every]))


def with_drag(model: Model, diagonal: Callable[[Array], Array]) -> Model:
    """The model with the tables of its drag; diagonal: blocks of the own terms of nodes."""
    if model.dragged is None:
        return model
    first = model.catch_place - len(model.dragged.labels)
    return replace(model, drag=model.dragged.tables(model.pattern.row_of, diagonal(model.dragged.node), first))
