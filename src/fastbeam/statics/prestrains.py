"""Prestrains that change along a path of equilibria: unstressed lengths, temperatures (theory.md 12)."""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from fastbeam.interface.arguments import real, shown
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.beams.element_loop import ElementTables
from fastbeam.kernels.layout import LIST, NODES, POINTS, REFERENCE
from fastbeam.model.model import Model
from fastbeam.scene import Beam

Array = np.ndarray
# of a prestrain, from its least to its largest value
LEAST, MOST = -10.0, 0.99


def check_beam(who: str, model: Model, beam: Any) -> None:
    """Refuse arguments that are no beam of the scene of a model; who: the call and argument.

    Raises
    ------
    SceneError
    """
    if not isinstance(beam, Beam):
        raise SceneError(f"{who}: {shown(beam)} is not a beam; of a net name its beams, net.beam(k)")
    try:
        model.numbers.start(beam)
    except KeyError:
        raise SceneError(f"{who}: {beam.label} is not in scene {model.scene_name!r}; name a beam of the compiled "
                         "scene") from None


def prestrains_of(model: Model, prestrains: Any) -> dict[Beam, float]:
    """Return changes of prestrains until load factor 1.

    Raises
    ------
    SceneError
        No mapping of beams of the scene to finite numbers, or all are zero.
    """
    if not isinstance(prestrains, Mapping) or not prestrains:
        raise SceneError(f"solve_path, prestrains: must be a mapping {{beam: change of its prestrain}}, got {shown(prestrains)}")
    out = {}
    for beam, value in prestrains.items():
        check_beam("solve_path, prestrains", model, beam)
        number = real(value)
        if number is None or not LEAST <= beam.start_strain[0] + number <= MOST:
            raise SceneError(f"solve_path, prestrains: {beam.label} would have a prestrain of {beam.start_strain[0]:.6g} + "
                             f"{shown(value)} at load factor 1; it must be a number from {LEAST:g} to {MOST:g}")
        if number:
            out[beam] = number
    if not out:
        raise SceneError(f"solve_path, prestrains: all changes are zero, got {shown(prestrains)}")
    return out


class StrainPath:
    """Prestrains of beams as functions of the load factor.

    Parameters
    ----------
    model : Model
    changes : dict of Beam -> float
        Changes of prestrains until load factor 1.

    Attributes
    ----------
    model : Model
        The same scene with tables of its own, in which `put` changes them.
    """

    def __init__(self, model: Model, changes: dict[Beam, float]) -> None:
        self.changes = changes
        self._spans = [(model.numbers.start(beam), beam.basis.n_nodes, value) for beam, value in changes.items()]
        # number of the beam, table, places of axial strains, what they are at load factor 0, and their change
        self._parts: list[tuple[int, Array, Array, Array, Array]] = []
        self._made: dict[bool, Model] = {}
        # load factor of every beam that tables have
        self._now = np.zeros(len(changes))
        given = model.uneliminated
        assert given is not None

        def uneliminated(planar: bool) -> Model:
            if planar not in self._made:
                self._made[planar] = replace(self._own(given(planar=planar)), uneliminated=uneliminated)
                self.put(self._now)
            return self._made[planar]

        self.model = replace(self._own(model), uneliminated=uneliminated)

    def _own(self, model: Model) -> Model:
        """Return the model with tables of its own."""
        plane = None if model.plane is None else replace(model.plane, model=self._own(model.plane.model))
        return replace(model, simo=self._tables(model.simo, model.dim), green=self._tables(model.green, model.dim), plane=plane)

    def _tables(self, tables: ElementTables | None, dim: int) -> ElementTables | None:
        if tables is None:
            return None
        tab, numbers = tables.tab.copy(), 6 if dim == 3 else 3
        for group in tables.meta:
            nn, nq, first = group[NODES], group[POINTS], group[LIST]
            nodes = tables.nodes[first:first + 8 * nn].reshape(nn, 8)
            for k, (start, count, value) in enumerate(self._spans):
                lanes = np.flatnonzero(np.all((nodes >= start) & (nodes < start + count), axis=0))
                if lanes.size:
                    at = (group[REFERENCE] + 8 * numbers * np.arange(nq)[:, None] + lanes).reshape(-1)
                    self._parts.append((k, tab, at, tab[at].copy(), np.full(at.size, -value)))
        return tables._replace(tab=tab)

    def put(self, factor: float | Array) -> None:
        """Let beams have the prestrains of a load factor, or each of its own [B]."""
        self._now = np.broadcast_to(factor, len(self.changes)).copy()
        for k, tab, at, first, change in self._parts:
            tab[at] = first + self._now[k] * change

    def watch(self, sections: list[Any]) -> None:
        """Let these `resultants.Sections`, or None, have the prestrains as well, from the next `put` on."""
        for section in sections:
            for k, (start, count, value) in enumerate(self._spans):
                if section is not None and start <= section.first < start + count:
                    axial = section.reference[..., 0]
                    self._parts.append((k, axial, np.arange(axial.shape[0]), axial.copy(), np.full(axial.shape, -value)))
