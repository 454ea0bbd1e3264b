"""Crossings: two beams that slide on each other at one point."""
from __future__ import annotations

from dataclasses import KW_ONLY, field
from typing import Any, ClassVar

import numpy as np

from fastbeam.interface.arguments import Name, Numbers, Refusal, Word, checked, shown
from fastbeam.interface.errors import SceneError
from fastbeam.scene import checks
from fastbeam.scene.beams import Beam, NodeRef
from fastbeam.scene.bodies import PointMass
from fastbeam.scene.checks import ArrayField, Takes, noun
from fastbeam.scene.paths import Path, as_track, legs_of
from fastbeam.scene.slider_forces import Friction, as_friction
from fastbeam.scene.sliders import CURVES, Slider
from fastbeam.scene.switches import Switch

FrictionLike = Friction | float
Frictions = tuple[Friction | None, Friction | None]


class Knot(PointMass):
    """Point without mass where the beams of a `Crossing` touch."""

    kind: ClassVar[str] = "crossing"

    def __init__(self, name: str) -> None:
        checks.fill(self, name=name, mass=0.0, position=None, velocity=None)


def as_two_frictions(value: Any) -> tuple[Friction | None, Friction | None]:
    """Check of a coefficient or a Friction for both sides, or a pair of them."""
    both = tuple(value) if isinstance(value, (tuple, list)) else (value, value)
    if len(both) != 2:
        raise Refusal(f"must be a coefficient >= 0 or a Friction, or a pair of them for both beams, got {shown(value)}")
    one, other = (None if x is None else as_friction(x) for x in both)
    return one, other


@checked(name=Name(), beam_a=as_track, beam_b=as_track, at=Numbers((2,), "two arc lengths (s_a, s_b), m"), curve=Word(CURVES),
         friction=as_two_frictions)
@noun
class Crossing:
    """Two beams that touch at one point and slide on each other there: crossing cables (theory.md 5.10).

    The point lies on both curves; its arc lengths on them are two unknowns. The force between the beams is across both
    without friction. No direction is fixed, and the point has no mass. It counts as a part in results:
    `result.slider(c.name_a)` and `result.slider(c.name_b)` have places, forces and the gap, `points={"x": c.point}` records where
    it is.

    Parameters
    ----------
    name : str
    beam_a, beam_b : Beam or Path
        In any order; not the same, and not parallel where they cross.
    at : array_like (2,)
        Arc lengths of the point on both at t = 0, m. There the beams have to meet.
    curve : {'c1', 'own'}
        See `Slider`, for both.
    friction : float, Friction, or a pair of them, optional
        Friction of each beam against the point, as in an eye that both run through: it grows with the contact force and acts
        against the velocity along this beam.

    Attributes
    ----------
    slider_a, slider_b : Slider
        The point on each beam.
    point : NodeRef
        The point, for `points=`, loads and springs.

    Raises
    ------
    SceneError
        Both beams are the same, or an argument is of the wrong kind. `Scene.check` tests that they meet.

    Examples
    --------
    >>> from fastbeam.scene import Beam, Clamp, Crossing, Scene, Section
    >>> rope = Section.circle(radius=0.01, E=1e8, rho=1000.0)
    >>> a = Beam.straight('a', (0, 0, 0), (2, 0, 0), section=rope, elements=4)
    >>> b = Beam.straight('b', (0.7, -1, 0), (0.7, 1, 0), section=rope, elements=4)
    >>> cross = Crossing('x', a, b, at=(0.7, 1.0))
    >>> scene = Scene(a, b, cross, Clamp(a.start), Clamp(b.start))
    >>> scene.check()
    >>> scene.position_of(cross.point).tolist()
    [0.7, 0.0, 0.0]
    """

    kind: ClassVar[str] = "crossing"

    name: str
    beam_a: Beam | Path
    beam_b: Beam | Path
    _: KW_ONLY
    at: ArrayField
    curve: str = "c1"
    friction: Takes[FrictionLike | tuple[FrictionLike | None, FrictionLike | None] | None, Frictions | None] = None
    knot: Knot = field(init=False, repr=False)
    slider_a: Slider = field(init=False, repr=False)
    slider_b: Slider = field(init=False, repr=False)

    def __post_init__(self) -> None:
        who = checks.label(self.kind, self.name)
        for beam in (self.beam_a, self.beam_b):
            if isinstance(beam, Switch):
                raise SceneError(f"{who}: a crossing lies on a Beam or Path, not on {beam.label}; give one of its tracks")
        own = [legs_of(beam)[0] for beam in (self.beam_a, self.beam_b)]
        shared = [beam for beam in own[0] if any(beam is other for other in own[1])]
        if shared:
            raise SceneError(f"{who}: {shared[0].label} is on both sides; a crossing joins two different beams")
        knot = Knot(self.name)
        rub = self.friction or (None, None)
        sides = [Slider(f"{self.name} on {beam.name}", knot, beam, at=float(s), curve=self.curve, friction=mu)
                 for beam, s, mu in zip((self.beam_a, self.beam_b), self.at, rub)]
        checks.fill(self, knot=knot, slider_a=sides[0], slider_b=sides[1])
        tangents = [] if self._is_off() else [x.beam.reference(x.at)[1][0, 0] for x in sides]
        if tangents and np.linalg.norm(np.cross(*tangents)) < 1e-3:
            raise SceneError(f"{who}: {self.beam_a.label} and {self.beam_b.label} are parallel there, so their contact point is "
                             "not determined; let them cross at an angle")

    @property
    def point(self) -> NodeRef:
        """Node where the beams touch."""
        return self.knot.center

    @property
    def name_a(self) -> str:
        """Name of the slider on the first beam, for results."""
        return self.slider_a.name

    @property
    def name_b(self) -> str:
        """Name of the slider on the second beam, for results."""
        return self.slider_b.name

    @property
    def members(self) -> tuple[PointMass | Slider, ...]:
        """Parts of the crossing: the point and a slider of it on each beam."""
        return self.knot, self.slider_a, self.slider_b

    def _is_off(self) -> bool:
        """Return whether a place lies outside its beam, which `Scene.check` reports."""
        return any(not x.is_endless and not 0.0 <= x.at <= x.beam.length for x in (self.slider_a, self.slider_b))
