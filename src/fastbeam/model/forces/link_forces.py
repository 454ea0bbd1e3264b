"""Features that are tables of links alone: springs and dampers, bushings, crossings, links of modules outside the package."""
from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

from fastbeam.kernels.forces.bushing import Bushings
from fastbeam.kernels.state import State
from fastbeam.model.analyses import dissipating, unknown_to_methods, without_adjoint
from fastbeam.model.feature import Array, Feature
from fastbeam.model.forces.bushings import bushings_in_plane


class LinkForces(Feature):
    """Springs, dampers, bushings, line forces and winches: dissipated energies, series at rows, and ends that may pass each
    other.

    losses: names of the dissipated energies in the balance.
    find_rows: makes the evaluators of rows from the tables of the links of a model.
    lines: links whose ends may pass each other.
    """

    key, title, order = "link_forces", "springs, dampers", 40
    lacks = (unknown_to_methods("damping", lambda forces, asked: forces.losses),
             dissipating("damping", lambda forces, asked: forces.losses))
    losses: tuple[str, ...] = ()

    def __init__(self, losses: tuple[str, ...], find_rows: Callable[[tuple[Any, ...]], list[Any]], lines: Any) -> None:
        self.losses, self.find_rows, self.lines = losses, find_rows, lines

    def series(self, kinds: Collection[str], model: Any) -> dict[str, tuple[int, ...]]:
        """Return the shapes of elongations, forces and energies."""
        rows = model.spring_rows if "spring" in kinds else []
        return {name: shape for one in rows for name, shape in one.series().items()}

    def read(self, kinds: Collection[str], model: Any, t: float, state: State) -> dict[str, Array]:
        """Return elongations, forces and energies of a state."""
        rows = model.spring_rows if "spring" in kinds else []
        return {name: x for one in rows for name, x in one.row(state).items()}


class BushingForces(Feature):
    """Bushings."""

    key, title, order = "bushing_forces", "bushings", 140
    lacks = (unknown_to_methods("bushings"),)

    def link_in_plane(self, table: Any, plane: Any) -> Any:
        """Return the table of bushings with axes as they lie in the plane; other tables unchanged."""
        return bushings_in_plane(table, plane) if isinstance(table, Bushings) else table


class Crossings(Feature):
    """Points without mass at which beams cross."""

    key, title, order = "crossings", "crossings", 150
    lacks = (unknown_to_methods("crossings"), without_adjoint("crossings of beams"))


class CarriedSliders(Feature):
    """Sliders that are condensed with their beams."""

    key, title, order = "carried", "sliders on condensed beams", 170
    lacks = (without_adjoint("sliders on nets of condensed beams"),)


class OutsideLinks(Feature):
    """Links of modules outside the package; kinds: names of their classes, and true for constraints."""

    key, title, order = "outside", "links of modules outside the package", 180
    lacks = (without_adjoint("links from outside", lambda links, asked: [f"links of kind {kind}" for kind in links.kinds]),
             unknown_to_methods("constraints from outside", lambda links, asked: [
                 f"constraints of kind {kind}" for kind, constrains in links.kinds.items() if constrains]))

    def __init__(self, kinds: dict[str, bool]) -> None:
        self.kinds = kinds
