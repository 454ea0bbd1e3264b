"""Joints with axes between two of body, point of a body, beam node and ground: lists of conditions on points and directions."""
from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Any, ClassVar

import numpy as np

from fastbeam.arguments import Name, Number, Numbers, Refusal, Vector, checked, shown
from fastbeam.errors import SceneError
from fastbeam.scene import checks
from fastbeam.scene.beams import Beam, NodeRef
from fastbeam.scene.checks import Array, ArrayField, OfTimeLike, SideField, noun
from fastbeam.scene.fixed import GROUND, Ground
from fastbeam.scene.links import Link
from fastbeam.scene.parts import Node, PointMass
from fastbeam.scene.sliding import ADrive, Drive, OfTime, SomeStops, Stops, rate_at_start

# largest deviation of two axes from a right angle, as the cosine of the angle
UPRIGHT = 1e-9
# as of `rate_at_start`: also of what begins with the fourth power of time
FADES = 1e-3
JOINED = Name("a joint has two sides, write one for every pair")


@dataclass(frozen=True)
class Side:
    """A node, a point of the ground, or the ground where the other side is."""

    def __call__(self, value: Any) -> Any:
        return value if isinstance(value, Ground) else Node(fixed=True)(value)


@dataclass(frozen=True)
class OnBoth:
    """A number for the angle and one for the distance of a joint that has both."""

    least: float | None = None

    def __call__(self, value: Any) -> tuple[float, float]:
        clean = Numbers((2,), "two numbers, one for the angle and one for the distance")(value)
        if self.least is not None and np.any(clean < self.least):
            raise Refusal(f"must be two numbers >= {self.least:g}, got {shown(value)}")
        return float(clean[0]), float(clean[1])


SIDE = Side()
# conditions (i, j): D_i of a and D_j of b stay at a right angle; (i, -1): the distance along D_i from a to b stays
Condition = tuple[int, int]
ONE_AXIS, ONE_TRIAD = ((0, 1), (0, 2)), ((0, 1), (0, 2), (1, 2))


class AxisJoint(Link):
    """Common part of the joints with axes: what they hold and leave free, and where they lie at t = 0."""

    kind: ClassVar[str] = "joint"
    # whether both points stay together
    is_pinned: ClassVar[bool] = False
    # sets of conditions, each held by forces of one unit
    conditions: ClassVar[tuple[tuple[Condition, ...], ...]] = ()
    # what it leaves free: True for an angle, False for a distance along D_1
    coordinates: ClassVar[tuple[bool, ...]] = ()

    def __post_init__(self) -> None:
        who = self.kind if self.name is None else checks.label(self.kind, self.name)
        for side in (self.a, self.b):
            if isinstance(getattr(side, "owner", None), PointMass):
                raise SceneError(f"{who}: {side.owner.label} has no rotation; join a RigidBody, a point of one or a node of a "
                                 "beam, or use BallJoint or DistanceJoint")
        fixed = [isinstance(side, Ground) or side.owner.kind == "ground" for side in (self.a, self.b)]
        if all(fixed):
            raise SceneError(f"{who}: both sides are the ground; one has to belong to something that moves")
        for name, side, other in (("a", self.a, self.b), ("b", self.b, self.a)):
            if isinstance(side, Ground):
                checks.fill(self, **{name: GROUND.point(_place(other))})
        super().__post_init__()

    @property
    def label(self) -> str:
        """The joint for messages; automatic names already say the kind."""
        name = str(self.name)
        return name if name.startswith(f"{self.kind} of ") else checks.label(self.kind, name)

    # what may act on what it leaves free
    stiffness: ClassVar[Any] = 0.0
    damping: ClassVar[Any] = 0.0
    rest: ClassVar[Any] = 0.0
    speed: ClassVar[Any] = None
    friction: ClassVar[float] = 0.0
    coefficient: ClassVar[float] = 0.0
    radius: ClassVar[float] = 1.0
    length: ClassVar[float | None] = None
    drive: ClassVar[Drive | None] = None
    stops: ClassVar[Stops | None] = None

    @property
    def has_friction(self) -> bool:
        """Whether it rubs."""
        return self.friction > 0.0 or self.coefficient > 0.0

    @property
    def may_stick(self) -> bool:
        """Whether friction or a rigid stop may hold its coordinate."""
        return self.has_friction or (self.stops is not None and self.stops.is_rigid)

    @property
    def shares(self) -> tuple[float, float]:
        """Largest friction for each N that the joint carries across its axis, and for each N m."""
        return self.coefficient * self.radius, 0.0 if self.length is None else 2.0 * self.coefficient * self.radius / self.length

    @property
    def motor(self) -> OfTimeLike | None:
        """Force or torque on what it leaves free: a number, a function of time, or None."""
        return None

    @property
    def place(self) -> OfTimeLike | None:
        """What its coordinate is given: a number, a function of time, or None."""
        return None

    @property
    def is_given(self) -> bool:
        """Whether its coordinate is given as a function of time."""
        return self.place is not None or self.speed is not None

    @property
    def given_rate(self) -> float:
        """Of what is given, at t = 0, m/s or rad/s."""
        what = "speed" if self.place is None else self.words[0]
        return rate_at_start(self.speed if self.place is None else self.place, what, self.label, FADES)

    @property
    def words(self) -> tuple[str, str, str]:
        """Names of the arguments for its coordinate and its motor, and the unit of the coordinate."""
        return ("angle", "torque", "rad") if self.coordinates[0] else ("distance", "force", "m")

    @property
    def numbers(self) -> dict[str, tuple[float, ...]]:
        """Stiffness, damping and rest value of every coordinate, by the names of the arguments."""
        return {what: value if isinstance(value := getattr(self, what), tuple) else (float(value),)
                for what in ("stiffness", "damping", "rest")}

    def _check_forces(self) -> None:
        """Refuse what contradicts each other on the coordinate that it leaves free."""
        who, (place, motor, unit) = self.label, self.words
        if self.place is not None and self.speed is not None:
            raise SceneError(f"{who}: {place}= and speed= both say how it moves; give one of them")
        if self.is_given:
            given = f"{place}=" if self.place is not None else "speed="
            others = {"stiffness": self.stiffness > 0.0, "damping": self.damping > 0.0, motor: self.motor is not None,
                      "drive": self.drive is not None, "friction": self.friction > 0.0, "coefficient": self.coefficient > 0.0,
                      "stops": self.stops is not None}
            for what, is_there in others.items():
                if is_there:
                    raise SceneError(f"{who}: {given} says how it moves, whatever that takes, so {what}= changes nothing; leave "
                                     "one of them out")
        if self.drive is not None and self.drive.is_prescribed:
            raise SceneError(f"{who}: a drive that says how it moves, whatever that takes, is {place}= or speed= of the joint; "
                             "drive= is for a force, or a controller with stiffness=, damping= and limit=")
        if self.coefficient > 0.0 and not self.radius > 0.0:
            raise SceneError(f"{who}: coefficient= is friction on the surface of a pin; give its radius= too, m > 0")
        if self.coefficient == 0.0 and (self.length is not None or type(self).radius != self.radius):
            what = "length" if self.length is not None else "radius"
            raise SceneError(f"{who}: {what}= belongs to friction by the load, coefficient=; give that too, or leave it out")
        stops = self.stops
        if stops is not None:
            if stops.on_tracks:
                raise SceneError(f"{who}: stops: (track, s) is a place on a Switch; give a distance, m, or an angle, rad")
            low, high = stops.between
            if not low <= 0.0 <= high:
                raise SceneError(f"{who}: stops from {stops.start} to {stops.end} {unit} exclude its start, where the {place} is "
                                 "0; begin between them")


def _place(node: NodeRef) -> Array:
    """Position of a node of a beam or point of a body at t = 0."""
    owner = node.owner
    if isinstance(owner, Beam):
        return np.asarray(owner.reference(owner.node_s[node.index])[0][0])
    return np.asarray(owner.position + node.offset @ owner.directors)


@checked(a=SIDE, b=SIDE, name=JOINED, axis=Vector)
@noun
class OneAxisJoint(AxisJoint):
    """A joint with one axis, which both parts carry."""

    a: SideField
    b: SideField
    name: str | None = None
    _: KW_ONLY
    axis: ArrayField

    def __post_init__(self) -> None:
        super().__post_init__()
        checks.fill(self, axis=checks.direction(self.label, "axis", self.axis))

    @property
    def axes(self) -> tuple[Array, Array]:
        """D_1 of a and the direction in b that the conditions name, in space at t = 0, both [3]."""
        return self.axis, self.axis


@checked(a=SIDE, b=SIDE, name=JOINED, axis=Vector, stiffness=Number(least=0.0, unit="N m/rad"),
         damping=Number(least=0.0, unit="N m s/rad"), rest=Number(unit="rad"), torque=OfTime("N m"), angle=OfTime("rad"),
         speed=OfTime("rad/s"), friction=Number(least=0.0, unit="N m"), coefficient=Number(least=0.0),
         radius=Number(least=0.0, unit="m"), length=Number(above=0.0, unit="m"), drive=ADrive(), stops=SomeStops())
@noun
class RevoluteJoint(OneAxisJoint):
    """A hinge: two points stay together, and both parts keep one axis in common (theory.md 4, Joints with axes).

    `result.joint(name)` has the angle, that by which b has turned against a about the axis since t = 0, counted over turns.

    Parameters
    ----------
    a, b : NodeRef, RigidBody or GROUND
        Nodes of beams, points of bodies; one may be `GROUND`, then the joint lies at the other. They coincide at t = 0.
    name : str, optional
    axis : array_like (3,)
        Direction of the axis in space at t = 0; both parts carry it along.
    stiffness, damping : float
        Of a torsion spring, N m/rad, and of a damper, N m s/rad, >= 0.
    rest : float
        Angle without torque of the spring, rad; 0 is that at t = 0.
    torque : float or callable, optional
        Of a motor, on b about the axis, the opposite on a, N m: a number or a function of time.
    angle, speed : float or callable, optional
        A drive that turns b as given, whatever torque that takes: the angle in rad, over any number of turns, or its rate in
        rad/s, a number or a function of time. The angle at t = 0 is 0.
    friction : float
        Largest torque of Coulomb friction, N m, >= 0: it sticks up to it, and slips under it (theory.md (4.17)).
    coefficient, radius, length : float, optional
        Of friction on a pin of this radius, m: it adds coefficient x radius x (F + 2 M/length) to the largest torque, F the force
        and M the moment that the joint carries across its axis (theory.md (4.31)); without length= moments do not press.
    drive : Drive, optional
        A torque of time or of (t, angle, spin), or a controller: `fb.Drive(position=f, stiffness=k, damping=d, limit=T)` with
        angles in the place of arc lengths, rad, N m/rad, N m s/rad, N m.
    stops : Stops, optional
        Angles, rad: elastic ones, `fb.Stops(-1.0, 2.0, stiffness=1e4)`, N m/rad, or rigid ones, `restitution=` from 0 to 1.

    Raises
    ------
    SceneError
        A side is no node or body or has no rotation, both sides are the same or the ground, the axis is zero, a number is out of
        range; an angle or speed with anything else that acts on the angle; stops that exclude the start.
        `Scene.check`: the points do not coincide.

    Examples
    --------
    >>> from fastbeam.scene import GROUND, RevoluteJoint, RigidBody, Scene
    >>> arm = RigidBody('arm', mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0.5, 0, 0))
    >>> hinge = RevoluteJoint(GROUND, arm.point((-0.5, 0, 0)), 'hinge', axis=(0, 1, 0), stiffness=20.0, damping=0.3)
    >>> scene = Scene(arm, hinge, gravity=(0, 0, -9.81))
    >>> scene.check()
    """

    kind: ClassVar[str] = "revolute joint"
    is_pinned: ClassVar[bool] = True
    conditions: ClassVar[tuple[tuple[Condition, ...], ...]] = (ONE_AXIS,)
    coordinates: ClassVar[tuple[bool, ...]] = (True,)

    _: KW_ONLY
    stiffness: float = 0.0
    damping: float = 0.0
    rest: float = 0.0
    torque: OfTimeLike | None = None
    angle: OfTimeLike | None = None
    speed: OfTimeLike | None = None
    friction: float = 0.0
    coefficient: float = 0.0
    radius: float = 0.0
    length: float | None = None
    drive: Drive | None = None
    stops: Stops | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_forces()

    @property
    def motor(self) -> OfTimeLike | None:
        """As of `AxisJoint`."""
        return self.torque

    @property
    def place(self) -> OfTimeLike | None:
        """As of `AxisJoint`."""
        return self.angle


@checked(a=SIDE, b=SIDE, name=JOINED, axis=Vector, stiffness=OnBoth(0.0), damping=OnBoth(0.0), rest=OnBoth())
@noun
class CylindricalJoint(OneAxisJoint):
    """Part b turns about an axis of a and slides along it. The axis goes through the point of b, parallel to `axis`.

    `result.joint(name)` has the angle and the distance along the axis from a to b, both zero at t = 0.

    Parameters
    ----------
    a, b, name, axis
        As of `RevoluteJoint`; the points need not coincide.
    stiffness, damping, rest : (float, float)
        Of a torsion spring and damper, and of those along the axis: N m/rad and N/m, N m s/rad and N s/m, rad and m.

    Raises
    ------
    SceneError
        As of `RevoluteJoint`.
    """

    kind: ClassVar[str] = "cylindrical joint"
    conditions: ClassVar[tuple[tuple[Condition, ...], ...]] = (((1, -1), (2, -1)), ONE_AXIS)
    coordinates: ClassVar[tuple[bool, ...]] = (True, False)

    _: KW_ONLY
    stiffness: tuple[float, float] = (0.0, 0.0)
    damping: tuple[float, float] = (0.0, 0.0)
    rest: tuple[float, float] = (0.0, 0.0)


@checked(a=SIDE, b=SIDE, name=JOINED, axis=Vector, stiffness=Number(least=0.0, unit="N/m"),
         damping=Number(least=0.0, unit="N s/m"), rest=Number(unit="m"), force=OfTime("N"), distance=OfTime("m"),
         speed=OfTime("m/s"), friction=Number(least=0.0, unit="N"), coefficient=Number(least=0.0),
         length=Number(above=0.0, unit="m"), drive=ADrive(), stops=SomeStops())
@noun
class PrismaticJoint(OneAxisJoint):
    """Part b slides along an axis of a without turning: a guide, a translational joint.

    `result.joint(name)` has the distance that b has gone along the axis since t = 0.

    Parameters
    ----------
    a, b, name, axis
        As of `RevoluteJoint`; the points need not coincide.
    stiffness, damping : float
        Of a spring along the axis, N/m, and of a damper, N s/m, >= 0.
    rest : float
        Distance without force of the spring, m; 0 is that at t = 0.
    force : float or callable, optional
        Of an actuator, on b along the axis, the opposite on a, N: a number or a function of time.
    distance, speed : float or callable, optional
        A drive that moves b as given, whatever force that takes: the distance in m, or its rate in m/s, a number or a function of
        time. The distance at t = 0 is 0.
    friction : float
        Largest force of Coulomb friction, N, >= 0: it sticks up to it, and slips under it (theory.md (4.17)).
    coefficient, length : float, optional
        Of friction in a guide of this length, m: it adds coefficient x (F + 2 M/length) to the largest force, F the force and M
        the moment about the point of b that the joint carries across its axis; without length= moments do not press.
    drive, stops : Drive, Stops, optional
        As of `RevoluteJoint`, along the axis.

    Raises
    ------
    SceneError
        As of `RevoluteJoint`.
    """

    kind: ClassVar[str] = "prismatic joint"
    conditions: ClassVar[tuple[tuple[Condition, ...], ...]] = (((1, -1), (2, -1)), ONE_TRIAD)
    coordinates: ClassVar[tuple[bool, ...]] = (False,)

    _: KW_ONLY
    stiffness: float = 0.0
    damping: float = 0.0
    rest: float = 0.0
    force: OfTimeLike | None = None
    distance: OfTimeLike | None = None
    speed: OfTimeLike | None = None
    friction: float = 0.0
    coefficient: float = 0.0
    length: float | None = None
    drive: Drive | None = None
    stops: Stops | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_forces()

    @property
    def motor(self) -> OfTimeLike | None:
        """As of `AxisJoint`."""
        return self.force

    @property
    def place(self) -> OfTimeLike | None:
        """As of `AxisJoint`."""
        return self.distance


@checked(a=SIDE, b=SIDE, name=JOINED, normal=Vector)
@noun
class PlanarJoint(AxisJoint):
    """The point of b stays in a plane of a, and b turns about the normal of the plane alone.

    Parameters
    ----------
    a, b, name
        As of `RevoluteJoint`; the points need not coincide.
    normal : array_like (3,)
        Of the plane, in space at t = 0; both parts carry it along.

    Raises
    ------
    SceneError
        As of `RevoluteJoint`.
    """

    kind: ClassVar[str] = "planar joint"
    conditions: ClassVar[tuple[tuple[Condition, ...], ...]] = (((0, -1),), ONE_AXIS)

    a: SideField
    b: SideField
    name: str | None = None
    _: KW_ONLY
    normal: ArrayField

    def __post_init__(self) -> None:
        super().__post_init__()
        checks.fill(self, normal=checks.direction(self.label, "normal", self.normal))

    @property
    def axes(self) -> tuple[Array, Array]:
        """As of `OneAxisJoint`."""
        return self.normal, self.normal


@checked(a=SIDE, b=SIDE, name=JOINED, axis_a=Vector, axis_b=Vector)
@noun
class UniversalJoint(AxisJoint):
    """A Cardan joint: two points stay together, and an axis of a stays at a right angle to one of b, the arms of its cross.

    Parameters
    ----------
    a, b, name
        As of `RevoluteJoint`.
    axis_a, axis_b : array_like (3,)
        Arms of the cross in a and in b, directions in space at t = 0 at a right angle to each other.

    Raises
    ------
    SceneError
        As of `RevoluteJoint`, or the arms are not at a right angle.
    """

    kind: ClassVar[str] = "universal joint"
    is_pinned: ClassVar[bool] = True
    conditions: ClassVar[tuple[tuple[Condition, ...], ...]] = (((0, 1),),)

    a: SideField
    b: SideField
    name: str | None = None
    _: KW_ONLY
    axis_a: ArrayField
    axis_b: ArrayField

    def __post_init__(self) -> None:
        super().__post_init__()
        who = self.label
        a, b = checks.direction(who, "axis_a", self.axis_a), checks.direction(who, "axis_b", self.axis_b)
        if abs(float(a @ b)) > UPRIGHT:
            angle = float(np.degrees(np.arccos(np.clip(a @ b, -1.0, 1.0))))
            raise SceneError(f"{who}: axis_a={checks.shown(self.axis_a)} and axis_b={checks.shown(self.axis_b)} make an angle of "
                             f"{angle:.10g} degrees, the arms of a cross are at a right angle; turn one of them")
        checks.fill(self, axis_a=a, axis_b=b - (a @ b) * a)

    @property
    def axes(self) -> tuple[Array, Array]:
        """As of `OneAxisJoint`."""
        return self.axis_a, self.axis_b
