"""Scene: a list of parts, and every check that concerns more than one of them."""
from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NoReturn, TypeVar

import numpy as np

from fastbeam.interface import notebook
from fastbeam.interface.arguments import Flag, Name, Refusal, Vector, checked, shown
from fastbeam.interface.errors import SceneError
from fastbeam.interface.synonyms import known
from fastbeam.scene import checks
from fastbeam.scene.added_mass import AddedMass
from fastbeam.scene.axis_joint import AxisJoint
from fastbeam.scene.beams import Beam, NodeRef
from fastbeam.scene.bodies import (
    BallJoint,
    DistributedLoad,
    InitialVelocity,
    Load,
    Node,
    PointMass,
    RigidBody,
    RigidConnection,
    RigidMotion,
)
from fastbeam.scene.checks import Array, TimeFactor, as_factor
from fastbeam.scene.controller import Controller
from fastbeam.scene.crossings import Crossing, Knot
from fastbeam.scene.drag import Drag
from fastbeam.scene.fixed import Ground
from fastbeam.scene.follower import as_force
from fastbeam.scene.gear_coupling import GearCoupling, check_relations, relations_of
from fastbeam.scene.links import Link
from fastbeam.scene.moving_mesh import MovingMesh
from fastbeam.scene.nets import Net, NetBeam
from fastbeam.scene.paths import MOST_ROUNDS, Path, check_path
from fastbeam.scene.placing import Placing, extent_of
from fastbeam.scene.prescribed_motion import PrescribedMotion
from fastbeam.scene.relations import controllers_of, owners, referenced_nodes, who
from fastbeam.scene.sleeves import Sleeve
from fastbeam.scene.sliders import Slider
from fastbeam.scene.supports import Clamp, Pin
from fastbeam.scene.switches import Switch
from fastbeam.scene.user_force import UserForce
from fastbeam.scene.winch import Winch

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Part = (AddedMass | Beam | Net | RigidBody | PointMass | Clamp | Pin | RigidConnection | BallJoint | Load | DistributedLoad
        | InitialVelocity | RigidMotion | Slider | Crossing | Link | PrescribedMotion | Drag | UserForce | Winch | Controller
        | MovingMesh | GearCoupling)
KINDS: tuple[type, ...] = (Beam, Net, RigidBody, PointMass, Clamp, Pin, RigidConnection, BallJoint, Load, DistributedLoad,
                           InitialVelocity, RigidMotion, Slider, Sleeve, Crossing, Link, PrescribedMotion, Drag, UserForce,
                           AddedMass, Winch, Controller, MovingMesh, GearCoupling)
PLURALS = {"body": "bodies", "added mass": "added masses", "point mass": "point masses", "initial velocity": "initial velocities"}
Joint = RigidConnection | BallJoint
P = TypeVar("P")


def as_part(value: Any) -> Part:
    """Check of a part of a scene."""
    if isinstance(value, NetBeam):
        raise Refusal(f"{value.label} belongs to {value.net.label}; add the net")
    if not isinstance(value, KINDS):
        hint = " (Beam, RigidBody, Load, ...)"
        if isinstance(value, (list, tuple)):
            hint = "; unpack it: scene.add(*parts)"
        elif isinstance(value, type):
            hint = "; call it to make one"
        elif isinstance(value, NodeRef):
            hint = f"; add {value.owner.label}"
        elif isinstance(value, Path):
            hint = "; add its beams, and name it in its sliders: Slider(name, point, on=path, at=s)"
        raise Refusal(f"{shown(value)} is not a part of a scene{hint}")
    return value


class Every(Generic[P]):
    """Descriptor: all parts of a scene of one kind."""

    def __init__(self, kind: type[P]) -> None:
        self._kind = kind

    def __get__(self, scene: Any, owner: type | None = None) -> list[P]:
        return self if scene is None else [x for x in scene.parts if isinstance(x, self._kind)]  # type: ignore[return-value]

    def __set__(self, scene: Any, value: object) -> NoReturn:
        raise AttributeError("parts are added by scene.add")


@checked(parts=as_part, name=Name(), gravity=Vector, gravity_time=as_factor, project_velocities=Flag())
class Scene(notebook.Parts):
    """Set of parts under one gravity.

    Parameters
    ----------
    *parts : Beam, Net, RigidBody, PointMass, Clamp, Pin, RigidConnection, BallJoint, Load, ...
        In any order; `add` appends more.
    name : str
    gravity : array_like (3,)
        Acceleration, m/s^2.
    gravity_time : callable or None
        Factor t -> float on gravity; None: constant.
    project_velocities : bool
        Make inconsistent initial velocities consistent with sliders and joints instead of refusing them: by rigid motions of the
        parts, and bending beams only where no rigid motions agree.

    Raises
    ------
    SceneError
        A part is of an unknown kind, or a value is not usable. Relations between parts are tested by `check`.

    Examples
    --------
    >>> from fastbeam.scene import Beam, Clamp, PointMass, Scene, Section, Slider
    >>> bar = Section.circle(radius=0.01, E=70e9, rho=2700.0)
    >>> rail = Beam.straight('rail', (0, 0, 0), (1.2, 0, 0), section=bar, elements=4)
    >>> cart = PointMass('cart', mass=0.5)
    >>> scene = Scene(rail, cart, Clamp(rail.start), Slider('run', cart, rail, at=0.3), gravity=(0, 0, -9.81))
    >>> scene.check()
    >>> scene.position_of(cart).tolist()
    [0.3, 0.0, 0.0]
    >>> scene
    <scene 'scene': 1 beam ('rail'), 1 point mass ('cart'), 1 clamp, 1 slider ('run'), gravity (0, 0, -9.81)>
    """

    kind: ClassVar[str] = "scene"
    # parts by kind, in the order added
    beams = Every(Beam)
    nets = Every(Net)
    bodies = Every(RigidBody)
    masses = Every(PointMass)
    clamps = Every(Clamp)
    pins = Every(Pin)
    prescribed = Every(PrescribedMotion)  # supports that move
    drags = Every(Drag)
    rigid = Every(RigidConnection)
    balls = Every(BallJoint)
    winches = Every(Winch)
    velocities = Every(InitialVelocity)  # initial velocities along beams
    motions = Every(RigidMotion)  # initial rigid motions
    sliders = Every(Slider)
    sleeves = Every(Sleeve)  # sliders, too
    knots = Every(Knot)  # points of all crossings
    links = Every(Link)  # springs and other links between two points
    added_masses = Every(AddedMass)
    _loads, _distributed, _user_forces, _controllers = Every(Load), Every(DistributedLoad), Every(UserForce), Every(Controller)

    def __init__(self, *parts: Part, name: str = "scene", gravity: ArrayLike = (0.0, 0.0, 0.0),
                 gravity_time: TimeFactor | None = None, project_velocities: bool = False) -> None:
        self.name, self.gravity, self.gravity_time, self.project_velocities = name, gravity, gravity_time, project_velocities
        self.parts: list[Part] = []
        self._places: Placing | None = None
        self.add(*parts)

    @checked(parts=as_part)
    def add(self, *parts: Part) -> Scene:
        """Append parts; returns the scene.

        Raises
        ------
        SceneError
            A part is of an unknown kind.
        """
        for part in parts:
            self.parts.append(part)
            self.parts.extend(part.members if isinstance(part, (Crossing, Winch)) else ())
        return self

    # --- parts by kind ------------------------------------------------------------------------------------------------
    @property
    def label(self) -> str:
        """`scene 'name'`."""
        return f"scene {self.name!r}"

    @property
    def loads(self) -> list[Load]:
        """All loads on nodes that keep their direction."""
        return [load for load in self._loads if not load.follower]

    @property
    def distributed(self) -> list[DistributedLoad]:
        """All loads along beams that keep their direction."""
        return [load for load in self._distributed if not load.follower]

    @property
    def user_forces(self) -> list[UserForce]:
        """All forces by user functions, and loads that turn with the part that they act on."""
        turning = [as_force(load) for load in [*self._loads, *self._distributed] if load.follower]
        return self._user_forces + turning

    @property
    def controllers(self) -> list[Controller]:
        """All controllers: those that were added, then those that other parts take as functions of time."""
        added = self._controllers
        referred = dict.fromkeys(one for part in self.parts for one in controllers_of(part))
        if self.gravity_time is not None:
            referred |= dict.fromkeys(controllers_of(SimpleNamespace(time=self.gravity_time)))
        return list(dict.fromkeys([*added, *referred]))

    @property
    def pinned(self) -> list[AxisJoint]:
        """Joints with axes that hold two points together, as ball joints do."""
        return [link for link in self.links if isinstance(link, AxisJoint) and link.is_pinned]

    # --- positions ----------------------------------------------------------------------------------------------------
    @checked(thing=Node(fixed=True))
    def position_of(self, thing: NodeRef | RigidBody | PointMass) -> Array:
        """Return the position (3,) m at t = 0 of a node, body or mass; a slider or joint places a mass without position.

        Raises
        ------
        SceneError
            Nothing places the mass.
        """
        return np.array(self._placing.position(thing))

    @property
    def _placing(self) -> Placing:
        """Search for the positions of masses, made anew when parts were added."""
        if self._places is None or self._places.count != len(self.parts):
            self._places = Placing(self)
        return self._places

    def _tolerance(self) -> float:
        """Return 1e-9 of the size of the scene, m."""
        points = [beam.reference(np.linspace(0.0, beam.length, 3))[0] for beam in self.beams]
        points += [part.position[None] for part in [*self.bodies, *self.masses] if part.position is not None]
        offsets = [float(np.linalg.norm(n.offset)) for joint in [*self.balls, *self.rigid] for n in (joint.a, joint.b)]
        places = np.concatenate([*points, *(net.nodes for net in self.nets), np.zeros((0, 3))])
        size = max([extent_of(places), *offsets, *(beam.length for beam in self.beams)]) or 1.0
        reach = float(np.max(np.abs(places), initial=0.0))
        return 1e-9 * size + 16.0 * float(np.finfo(float).eps) * reach

    # --- checks -------------------------------------------------------------------------------------------------------
    def check(self) -> None:
        """Test every relation between parts; the compiler calls it first.

        Raises
        ------
        SceneError
            An empty scene, equal names, parts that refer to others outside the scene, nodes that are no material points,
            sliders off their beam, masses without a place or with two, ball joints with a gap.
        """
        if not (self.beams or self.nets or self.bodies or self.masses):
            raise SceneError(f"{self.label} is empty: add at least one Beam, Net, RigidBody or PointMass")
        self._check_names()
        self._check_members()
        self._check_control_points()
        check_relations(relations_of(self.parts), self.links, self.label)
        tolerance = self._tolerance()
        for path in dict.fromkeys(slider.beam for slider in self.sliders if isinstance(slider.beam, Path)):
            for one in path.tracks if isinstance(path, Switch) else (path,):
                if isinstance(one, Path):
                    check_path(one, tolerance)
        for slider in self.sliders:
            self._check_slider(slider)
        self._check_choices()
        self._placing.check(tolerance)
        for slider in self.sliders:
            self._check_contact(slider, tolerance)
        for ball in [*self.balls, *self.pinned]:
            gap = float(np.linalg.norm(self.position_of(ball.a) - self.position_of(ball.b)))
            if gap > tolerance:
                raise SceneError(f"{who(ball)}: {ball.a} and {ball.b} lie {gap:.6g} m apart at t = 0 (allowed: {tolerance:.2g} "
                                 "m); move one of them" + (", or use RigidConnection, which allows an offset" if
                                                           isinstance(ball, BallJoint) else ""))

    def _check_names(self) -> None:
        """Check that no part and no name appears twice; the same support twice is allowed, it adds no constraint."""
        known: set[Part] = set()
        named: dict[str, Part] = {}
        for part in [*self.parts, *self.controllers[len(self._controllers):]]:
            if part in known and not isinstance(part, (Clamp, Pin)):
                raise SceneError(f"{self.label}: {who(part)} was added twice")
            known.add(part)
            if isinstance(part, (Crossing, Winch)):
                # the point of a crossing, or the drive of a winch, has the same name
                continue
            name = getattr(part, "name", None)
            first = part if name is None else named.setdefault(name, part)
            if first is part or (isinstance(part, (Clamp, Pin)) and type(first) is type(part)
                                 and (first.at, first.mask) == (part.at, part.mask)):
                continue
            raise SceneError(f"{self.label}: the name {name!r} is used twice, by a {first.kind} and a {part.kind}; "
                             "give every part its own name")

    def _check_members(self) -> None:
        """Check that every beam, body or mass that a part refers to is in the scene."""
        members = {*self.beams, *self.nets, *self.bodies, *self.masses}
        for part in self.parts:
            for owner in owners(part):
                if not isinstance(owner, Ground) and (owner.net if isinstance(owner, NetBeam) else owner) not in members:
                    raise SceneError(f"{who(part)}: {owner.label} is not in {self.label}; add it to the scene")

    def _check_control_points(self) -> None:
        """Check that supports, joints and loads take no interior control points of a spline beam, which are no points of it."""
        for part in self.parts:
            for node in [part.at] if isinstance(part, (Load, UserForce)) else referenced_nodes(part):
                beam = None if isinstance(node, Beam) else node.owner
                if isinstance(beam, Beam) and beam.interpolation == "bspline" and 0 < node.index < beam.n_nodes - 1:
                    raise SceneError(f"{who(part)}: {node} is a control point, which does not lie on the beam; use its start or "
                                     "end, split the beam there, or interpolation='lagrange'")

    @staticmethod
    def _check_slider(slider: Slider) -> None:
        """Check that the contact lies on another beam than the point's own."""
        beam, point = slider.beam, slider.point
        if any(point.owner is one for one in slider.beams):
            raise SceneError(f"{who(slider)}: {point} belongs to the beam that it slides on; the point must belong to another "
                             "part")
        if slider.is_endless and abs(slider.at) > MOST_ROUNDS * beam.length:
            raise SceneError(f"{who(slider)}: at={slider.at:.6g} is more than {MOST_ROUNDS:g} times around {beam.label} "
                             f"({beam.length:.6g} m); subtract whole rounds")
        if not (slider.is_endless or isinstance(beam, Switch)) and not 0.0 <= slider.at <= beam.length:
            raise SceneError(f"{who(slider)}: at={slider.at:.6g} lies outside {beam.label} (0 to {beam.length:.6g} m)")

    def _check_choices(self) -> None:
        """Check that sliders for which a switch chooses tracks run on it."""
        on: dict[Switch, list[str]] = {}
        for slider in self.sliders:
            if isinstance(slider.beam, Switch):
                on.setdefault(slider.beam, []).append(slider.name)
        for switch, names in on.items():
            unknown = [name for name in switch.choose if name not in names] if isinstance(switch.choose, dict) else []
            if unknown:
                raise SceneError(f"{switch.label}: choose names {unknown[0]!r}, which is not a slider on it; its sliders are "
                                 f"{known(names, unknown[0])}")

    def _check_contact(self, slider: Slider, tolerance: float) -> None:
        """Check that a sliding point lies on the curve at t = 0, or on its side of it."""
        if slider.starts_off:
            return
        point, beam = self.position_of(slider.point), slider.beam
        gap = float(np.linalg.norm(point - slider.place))
        if gap <= tolerance:
            return
        s, least = beam.nearest(point)
        if least <= tolerance:
            cure = f"use at={s:.10g}, where it lies on the beam"
        else:
            cure = (f"the beam is closest at s={s:.4g} m, still {least:.6g} m away: move the point to beam.reference(s)[0][0], "
                    f"{checks.shown(beam.reference(s)[0][0])} m; beam.nearest(point) finds s")
        leave = "leave its position out, or " if isinstance(slider.point.owner, PointMass) else ""
        raise SceneError(f"{who(slider)}: {slider.point} lies {gap:.6g} m away from {beam.label} at={slider.at:.6g}; "
                         f"{leave}{cure}")

    def __repr__(self) -> str:
        items = []
        for kind in [*KINDS, *dict.fromkeys(type(link) for link in self.links)]:
            if not (found := [part for part in self.parts if type(part) is kind]):
                continue
            noun = PLURALS.get(kind.kind, kind.kind + "s") if len(found) > 1 else kind.kind
            named = (Beam, Net, RigidBody, PointMass, Load, DistributedLoad, Slider, Sleeve, PrescribedMotion, Drag, UserForce,
                     AddedMass, Winch, Controller)
            names = [repr(part.name) for part in found[:4] if kind in named]
            items.append(f"{len(found)} {noun}" + (f" ({', '.join(names)}{', ...' if len(found) > 4 else ''})" if names else ""))
        if np.any(self.gravity):
            items.append(f"gravity {checks.shown(self.gravity)}")
        return f"<{self.label}: {', '.join(items) or 'empty'}>"
