"""Beams whose elements move with the contacts of sliders."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from fastbeam.interface.arguments import Refusal, checked, shown
from fastbeam.interface.errors import SceneError
from fastbeam.scene import checks
from fastbeam.scene.beams import Beam
from fastbeam.scene.bodies import FIELD, PointMass
from fastbeam.scene.checks import OptionalField, Takes, noun
from fastbeam.scene.paths import as_beam
from fastbeam.scene.sleeves import Sleeve
from fastbeam.scene.sliders import Slider

# contacts nearer to each other than this share of the beam leave no element between them
NEAREST = 1e-3


def as_sliders(value: Any) -> tuple[Slider, ...]:
    """Check of one Slider or Sleeve, or several, as a tuple."""
    some = tuple(value) if isinstance(value, (list, tuple)) else (value,)
    wrong = [x for x in some if not isinstance(x, Slider)]
    if not some or wrong:
        what = shown(wrong[0] if wrong else value)
        raise Refusal(f"must be a Slider or Sleeve, or several, got {what}")
    return some


def has_coulomb(slider: Slider) -> bool:
    """Return whether a slider has Coulomb friction, which depends on its normal force."""
    return slider.friction is not None and slider.friction.coefficient > 0.0


def check_acting(who: str, slider: Slider) -> None:
    """Check that a slider has no features that moving elements do not support. Raises SceneError."""
    label = f"{who}: {slider.kind} {slider.name!r}"
    given = {"a release": slider.release, "one-sided contact": slider.one_sided}
    for what, value in given.items():
        if value is not None:
            raise SceneError(f"{label} has {what}, which moving elements do not support; leave it out, or leave the moving mesh "
                             "out")


def check_places(who: str, beam: Beam, sliders: Sequence[Slider]) -> None:
    """Check that contacts are not too near to each other. Raises SceneError: names the sliders, and says how near they may be."""
    near = NEAREST * beam.length
    row = sorted(sliders, key=lambda slider: slider.at)
    for one, other in zip(row[:-1], row[1:]):
        if other.at - one.at < near:
            raise SceneError(f"{who}: sliders {one.name!r} and {other.name!r} at {one.at:.6g} and {other.at:.6g} m of "
                             f"{beam.label} are nearer than {near:.3g} m, so no element fits between them; start them further "
                             "apart")


@checked(beam=as_beam, sliders=as_sliders, velocity=FIELD, spin=FIELD)
@noun
class MovingMesh:
    """Beam whose elements move with sliders; their contacts are element ends at all times (theory.md 5.12).

    Elements between two contacts, or a contact and an end of the beam, share the length there in constant proportions. Within
    half a mean element of the ends of the beam contacts run inside elements, which do not vanish there. Each slider needs an
    element end at its place at t = 0; `with_moving_meshes` makes such beams.

    Parameters
    ----------
    beam : Beam
        With Lagrange elements, strain 'simo_reissner', and the same section and curvature everywhere.
    sliders : Slider or list of Slider
        All sliders on the beam, with friction, drives, stops and locks; without releases and one-sided contact. A `Sleeve` holds
        the beam at one point, and has `length=0`; only with Coulomb friction it has a length, on whose ends its moments press.
    velocity, spin : array_like (3,) or callable, optional
        Initial velocity (m/s) and angular velocity (rad/s) of the beam as functions of the arc length, as `InitialVelocity` takes
        them; added to what other parts say.

    Raises
    ------
    SceneError
        An argument is of the wrong kind, a slider is on another beam or has features that moving elements do not support, or an
        element end is missing.
    """

    kind: ClassVar[str] = "moving mesh"

    beam: Beam
    sliders: Takes[Slider | Sequence[Slider], tuple[Slider, ...]]
    velocity: OptionalField = None
    spin: OptionalField = None

    def __post_init__(self) -> None:
        beam = self.beam
        if beam.interpolation != "lagrange" or beam.strain != "simo_reissner":
            raise SceneError(f"{self.label}: needs interpolation='lagrange' and strain='simo_reissner', got "
                             f"{beam.interpolation!r} and {beam.strain!r}; make the beam with these")
        if np.any(beam.section.damping):
            raise SceneError(f"{self.label}: its section has damping, which moving elements do not support; leave it out, or "
                             "leave the moving mesh out")
        if beam.section.law is not None:
            raise SceneError(f"{self.label}: its section has a law, and moving elements take the stiffness matrix alone; "
                             "leave the moving mesh out")
        for slider in self.sliders:
            self._check(slider)
        check_places(self.label, beam, self.sliders)
        for key in ("velocity", "spin"):
            if getattr(self, key) is not None:
                checks.try_field(self.label, key, getattr(self, key), beam.length)

    def _check(self, slider: Slider) -> None:
        beam = self.beam
        if slider.beam is not beam:
            raise SceneError(f"{self.label}: slider {slider.name!r} is on {slider.beam.label}; name a slider on {beam.label}")
        check_acting(self.label, slider)
        if isinstance(slider, Sleeve) and slider.length and not has_coulomb(slider):
            raise SceneError(f"{self.label}: sleeve {slider.name!r} has a bore of length={slider.length:.6g} m (by default an "
                             "element), but a moving mesh needs a sleeve that acts at one point; give length=0, or use "
                             "with_moving_meshes(scene)")
        if isinstance(slider, Sleeve) and has_coulomb(slider):
            off = float(np.linalg.norm(slider.place - beam.reference(slider.at)[0][0]))
            if off > 1e-9 * beam.length:
                raise SceneError(f"{self.label}: sleeve {slider.name!r} with friction on a curved beam lies {off:.3g} m off it, "
                                 "at the mean over its bore, but moving elements support no bore; leave the friction out, or "
                                 "leave the moving mesh out")
        if not isinstance(slider.point.owner, (Beam, PointMass)) and slider.point.owner.kind != "body":
            raise SceneError(f"{self.label}: slider {slider.name!r}: {slider.point} cannot slide on moving elements; slide a "
                             "PointMass, a RigidBody or a node of another Beam")

    @property
    def label(self) -> str:
        """`moving mesh of beam 'name'`."""
        return f"{self.kind} of {self.beam.label}"
