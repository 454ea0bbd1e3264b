"""References between parts of a scene, and names of parts for messages."""
from __future__ import annotations

from functools import partial
from types import FunctionType, MethodType
from typing import Any

from fastbeam.scene.added_mass import AddedMass
from fastbeam.scene.beams import Beam, NodeRef
from fastbeam.scene.bodies import BallJoint, DistributedLoad, InitialVelocity, Load, RigidConnection, RigidMotion
from fastbeam.scene.controller import Controller
from fastbeam.scene.drag import Drag
from fastbeam.scene.links import Link
from fastbeam.scene.prescribed_motion import PrescribedMotion
from fastbeam.scene.slider_forces import Drive
from fastbeam.scene.sliders import Slider
from fastbeam.scene.supports import Clamp, Pin
from fastbeam.scene.user_force import UserForce
from fastbeam.scene.winch import Winch

# depth of the search for controllers, and number of entries of a list that it looks at
DEEPEST, MOST = 4, 100


def who(part: Any) -> str:
    """Return the text of a part for messages; automatic names already say the kind."""
    name = getattr(part, "name", None)
    if name is None:
        return getattr(part, "label", part.kind)
    return name if name.startswith(f"{part.kind} of ") else f"{part.kind} {name!r}"


def referenced_nodes(part: Any) -> list[NodeRef]:
    """Return the nodes that a support, joint, link or slider takes as points."""
    if isinstance(part, (Clamp, Pin, PrescribedMotion)):
        return [part.at]
    if isinstance(part, (RigidConnection, BallJoint, Link)):
        return [part.a, part.b]
    if isinstance(part, Winch):
        return [part.drum, part.load]
    return [part.point] if isinstance(part, Slider) else []


def owners(part: Any) -> list[Any]:
    """Return the beams, bodies and masses that a part refers to."""
    found = [node.owner for node in referenced_nodes(part)]
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


def controllers_of(part: Any) -> list[Controller]:
    """Return the controllers that a part takes as functions of time, or that these call, each once."""
    found: dict[Controller, None] = {}
    values = list(vars(part).values())
    for _ in range(DEEPEST):
        found |= dict.fromkeys(x for x in values if isinstance(x, Controller))
        values = [y for x in values for y in _inside(x)]
    return list(found)


def _inside(value: Any) -> list[Any]:
    """Return the items of a drive or a list, or the objects that a function knows besides its arguments."""
    if isinstance(value, Drive):
        return [value.position, value.speed, value.force]
    if isinstance(value, (tuple, list)):
        return list(value[:MOST]) if not isinstance(value, NodeRef) else []
    if isinstance(value, partial):
        return [value.func, *value.args, *value.keywords.values()]
    if isinstance(value, MethodType):
        return [value.__self__]
    if not isinstance(value, FunctionType):
        return []
    cells = [x for cell in value.__closure__ or () for x in _contents(cell)]
    known = [value.__globals__[name] for name in value.__code__.co_names if name in value.__globals__]
    own = Controller, partial, MethodType, FunctionType
    return [x for x in (*cells, *known, *(value.__defaults__ or ())) if isinstance(x, own)]


def _contents(cell: Any) -> list[Any]:
    try:
        return [cell.cell_contents]
    except ValueError:  # nothing yet
        return []
