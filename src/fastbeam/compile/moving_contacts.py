"""Contacts of sliders on elements that move with them, as joints (theory.md 5.12).

A contact is an element end, so its point is joined to a node of the beam: a slider by a ball joint, a sleeve rigidly, or by a
hinge where the beam may twist in it; a contact with Coulomb friction by multipliers, which give the normal force. Its place s is
the first coordinate of an additional node, on which the forces along the beam act.
"""
from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from fastbeam.model.contact.moving_tables import Mesh
from fastbeam.scene import BallJoint, PointMass, RevoluteJoint, RigidConnection, Sleeve, Slider
from fastbeam.scene.axis_joint import ONE_AXIS, ONE_TRIAD, AxisJoint, Condition
from fastbeam.scene.checks import fill, label
from fastbeam.scene.joint_freedoms import Product, Shape
from fastbeam.scene.moving_mesh import LineOfPlaces, has_coulomb

Array = np.ndarray
# begin of the line of places; no point of a scene belongs to it
LINE = LineOfPlaces()


class Along(AxisJoint):
    """Place s of a contact along its beam as a joint coordinate, with the slider forces: the distance of a node from the start of
    the line of places."""

    shapes: ClassVar[tuple[Shape, ...]] = (Shape("place", (Product(0, 0, -1),)),)

    def __init__(self, slider: Slider, place: PointMass) -> None:
        fill(self, name=along_of(slider), slider=slider, a=LINE.point((0.0, 0.0, 0.0)), b=place.center)

    @property
    def label(self) -> str:
        """Label of the slider."""
        return label(self.slider.kind, self.slider.name)

    @property
    def axes(self) -> tuple[Array, Array]:
        """Both axes of the coordinate: the line of places, as in `OneAxisJoint`."""
        along = np.array((1.0, 0.0, 0.0))
        return along, along

    def _acting(self) -> dict[str, tuple[Any, ...]]:
        slider = self.slider
        drive, friction = slider.drive, slider.friction
        out: dict[str, tuple[Any, ...]] = {"stops": (slider.stops,)}
        if drive is not None and drive.is_prescribed:
            out |= {"place": (drive.position,), "speed": (drive.speed,)}
        else:
            out["drive"] = (drive,)
        if friction is not None:
            out |= {"damping": (friction.viscous,), "coefficient": (friction.coefficient,),
                    "smoothing": (friction.smoothing,)}
            out["length"] = (slider.length or None if isinstance(slider, Sleeve) else None,)
        return out


class Bore(RevoluteJoint):
    """Axis of a sleeve in which the beam may twist; another joint holds its position."""

    kind: ClassVar[str] = "bore"
    is_pinned: ClassVar[bool] = False


class ContactJoint(AxisJoint):
    """Joint with multipliers of a contact with Coulomb friction, whose forces and moments press on the beam."""

    is_pinned: ClassVar[bool] = True

    def __init__(self, slider: Slider, node: Any) -> None:
        fill(self, kind=slider.kind, name=slider.name, a=node, b=slider.point, axis=slider.beam.reference(slider.at)[1][0, 0])

    @property
    def axes(self) -> tuple[Array, Array]:
        """Both axes of the joint: d1 of the beam at the contact, as in `OneAxisJoint`."""
        return self.axis, self.axis


class SleeveAxisJoint(ContactJoint):
    """Joint `ContactJoint` of a sleeve in which the beam may twist."""

    conditions: ClassVar[tuple[tuple[Condition, ...], ...]] = (ONE_AXIS,)


class SleeveTriadJoint(ContactJoint):
    """Joint `ContactJoint` of a sleeve that holds the twist."""

    conditions: ClassVar[tuple[tuple[Condition, ...], ...]] = (ONE_TRIAD,)


def along_of(slider: Slider) -> str:
    """Return the name of the coordinate with the forces along the beam on a contact; empty without forces."""
    return "" if slider.slides_freely else f"{slider.name} (along {slider.beam.name})"


def moment_of(slider: Slider) -> str:
    """Return the name of the joint that carries the moments of a contact; empty where it carries none."""
    if not isinstance(slider, Sleeve):
        return ""
    return slider.name if slider.keyed or has_coulomb(slider) else f"{slider.name} (bore)"


def joints_of(mesh: Mesh, k: int) -> list[Any]:
    """Return the joints of the point of contact k with its node of the beam, and of its place with the forces along the beam."""
    slider, node = mesh.sliders[k], mesh.contact(k)
    acting = [] if slider.slides_freely else [Along(slider, mesh.places[k])]
    is_sleeve = isinstance(slider, Sleeve)
    if has_coulomb(slider):
        kind = ContactJoint if not is_sleeve else SleeveTriadJoint if slider.keyed else SleeveAxisJoint
        return [*acting, kind(slider, node)]
    if is_sleeve and slider.keyed:
        return [*acting, RigidConnection(node, slider.point, name=slider.name)]
    # the position is eliminated: a node of a straight beam that moves with its place, without a mass, has no inertia
    out: list[Any] = [*acting, BallJoint(node, slider.point, name=slider.name)]
    if is_sleeve:
        out.append(Bore(node, slider.point, moment_of(slider), axis=mesh.beam.reference(slider.at)[1][0, 0]))
    return out
