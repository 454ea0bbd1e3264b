"""Sliders of a scene as a feature: terms, and limits of analyses with the curves of sliders."""
from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fastbeam.kernels.contact.curves import Curves, Paths
from fastbeam.kernels.contact.sleeve import Rubbing, Sleeves
from fastbeam.kernels.contact.sleeve_twist import Twist
from fastbeam.kernels.contact.slider import Following, NoForceAlong, NoSleeves, Sliders, Sliding
from fastbeam.kernels.terms import NoTies
from fastbeam.model.analyses import Analysis, Asked, Lack
from fastbeam.model.contact.sleeve_twist import sleeves_of_run
from fastbeam.model.contact.sleeves import sleeves_in_plane
from fastbeam.model.feature import Feature, OfRun, Stand
from fastbeam.scene import DistributedLoad, Drag, Slider, Switch, UserForce
from fastbeam.scene.crossings import Knot
from fastbeam.scene.nets import NetBeam

Array = np.ndarray


def _works_along(part: Any, beam: Any) -> bool:
    """Return whether a part acts along a beam by a work whose derivative by the place of an element end is unknown."""
    return (isinstance(part, UserForce) and part.at is beam
            or isinstance(part, DistributedLoad) and part.beam is beam and (part.moment is not None or part.follower)
            or isinstance(part, Drag) and part.on is beam and part.blows)


def _on_beams(instead: str, what: str, why: Callable[[Any, Asked], str]) -> Lack:
    """Declare that contacts on some beams cannot be element ends; why: reason for a beam, empty where they can."""
    def names(contact: SlidingContact, asked: Asked) -> Iterator[str]:
        for slider in contact.parts:
            for beam in slider.beams:
                reason = why(beam, asked)
                if reason:
                    yield f"{slider.kind} {slider.name!r} is on {beam.label}{reason}"
    return Lack((Analysis.EXACT,), what, "{who}: {name}", instead, names)


def _loads_along(beam: Any, asked: Asked) -> str:
    """Describe the part that acts along a beam, for a message; empty without any."""
    for part in asked.model.uneliminated.scene.parts:
        if _works_along(part, beam):
            return f", and {part.kind} {part.name!r} acts along it, whose work as an element end moves is not implemented"
    return ""


@dataclass(frozen=True)
class SlidingContact(Feature):
    """Sliders and sleeves."""

    key, title, order = "sliding", "sliders", 5
    constrains = True
    lacks = (
        Lack((Analysis.EXACT,), "crossings, switches", "{who}: {name}, which only contacts='mesh' supports",
             "leave contacts= out",
             lambda contact, asked: contact.branching),
        _on_beams("make it a Beam of its own, or leave contacts= out", "beams of nets",
                  lambda beam, asked: ", whose elements have equal lengths" if isinstance(beam, NetBeam) else ""),
        _on_beams("use interpolation='lagrange', or leave contacts= out", "splines",
                  lambda beam, asked: "" if isinstance(beam, NetBeam) or beam.interpolation == "lagrange" else
                  " with interpolation 'bspline', whose curve cannot have a kink at a contact"),
        _on_beams("put it on nodes, or leave contacts= out", "user forces, moments, loads that follow and moving air along beams",
                  _loads_along))

    parts: list[Slider]
    curves: Curves | Paths  # curves of sliders: beams, paths or tracks of switches
    sliders: Sliders
    sleeves: Sleeves | None  # the sliders that are sleeves
    slider_lengths: Array  # float64 [S]: lengths of the curves of sliders, m
    # spans, corners: for sliders on switches, begins and ends of their tracks, m; for (curve of the switch, track, True if left
    # by its end, next track), number of the curve over the corner, -1 without any, and True for a sharp corner
    spans: dict[int, Array]
    corners: dict[tuple[int, int, bool, int], tuple[int, bool]]
    curve_s: tuple[Array, ...]  # tuple of float64 [n]: arc lengths of the nodes of every curve, m

    def terms(self, run: OfRun) -> list[tuple[Stand, Any]]:
        """Return the terms of sliders and sleeves, and of friction against twist in sleeves."""
        model = run.model
        sleeves: Any = NoSleeves() if self.sleeves is None else sleeves_of_run(self.sleeves, run.static)
        # a slider changes its curve at corners of switches: every run has its own table
        sliders = self.sliders._replace(curve=self.sliders.curve.copy()) if self.corners else self.sliders
        if model.moving is not None:
            sliders = sliders._replace(following=run.own.get("moving") or model.moving.alone)
        along = run.own.get("slider_forces")
        sliding = Sliding(self.curves, sliders, NoTies() if model.ties is None else model.ties,
                          model.put_limits(np.zeros((model.n_sliders, 3)), model.s0),
                          NoForceAlong() if along is None else along, sleeves)
        out: list[Any] = [sliding]
        if isinstance(sleeves, Sleeves) and not run.static:
            out.append(sleeves)
            if isinstance(sleeves.twist, Twist):
                out.append(Rubbing(sleeves, sliding))
        return [(Stand.SLIDING, x) for x in out]

    def with_following(self, following: Following) -> SlidingContact:
        """Return a copy whose sliders are at element ends that move with them."""
        return replace(self, sliders=self.sliders._replace(following=following))

    def in_plane(self, plane: Any, model: Any, constraints: int) -> SlidingContact:
        """Return a copy with the table of sleeves for nodes with 3 unknowns, whose constraints are the last."""
        sleeves = sleeves_in_plane(model, plane)[0]
        return replace(self, sleeves=sleeves and sleeves._replace(first=np.array([constraints])))

    @property
    def branching(self) -> list[str]:
        """Sliders of crossings and on switches, for messages."""
        return [f"{x.kind} {x.name!r} belongs to a {'crossing' if isinstance(x.point.owner, Knot) else 'switch'}"
                for x in self.parts if isinstance(x.point.owner, Knot) or isinstance(x.beam, Switch)]
