"""What parts of a scene refer to, and how messages call them."""
from __future__ import annotations

from typing import Any


from fastbeam.scene.beams import Beam, NodeRef
from fastbeam.scene.added_mass import AddedMass
from fastbeam.scene.drag import Drag
from fastbeam.scene.links import Link
from fastbeam.scene.parts import (
    BallJoint, DistributedLoad, InitialVelocity, Load, RigidConnection, RigidMotion,
)
from fastbeam.scene.prescribed import PrescribedMotion
from fastbeam.scene.sliders import Slider
from fastbeam.scene.supports import Clamp, Pin
from fastbeam.scene.user_force import UserForce
from fastbeam.scene.winch import Winch


def who(part: Any) -> str:
    """A part as text for messages; automatic names already say the kind."""
    name = getattr(part, "name", None)
    if name is None:
        return getattr(part, "label", part.kind)
    return name if name.startswith(f"{part.kind} of ") else f"{part.kind} {name!r}"


def held_nodes(part: Any) -> list[NodeRef]:
    """The nodes that a support, joint, link or slider takes as points."""
    if isinstance(part, (Clamp, Pin, PrescribedMotion)):
        return [part.at]
    if isinstance(part, (RigidConnection, BallJoint, Link)):
        return [part.a, part.b]
    if isinstance(part, Winch):
        return [part.drum, part.load]
    return [part.point] if isinstance(part, Slider) else []


def owners(part: Any) -> list[Any]:
    """The beams, bodies and masses that a part refers to."""
    found = [node.owner for node in held_nodes(part)]
    if isinstance(part, (Load, UserForce)):
        found.append(part.at if isinstance(part.at, Beam) else part.at.owner)
    if isinstance(part, Slider):
        found.extend(part.beams)
    if isinstance(part, (DistributedLoad, InitialVelocity)):
        found.append(part.beam)
    if isinstance(part, RigidMotion):
        found.extend(part.objects or ())
    if isinstance(part, (Drag, AddedMass)):
        found.append(part.on)
    return found
