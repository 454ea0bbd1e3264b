"""Joints that leave several angles and distances free: cylindrical, planar, universal and spherical."""
from __future__ import annotations

from dataclasses import KW_ONLY
from typing import Any, ClassVar

import numpy as np

from fastbeam.interface.arguments import Number, Vector, checked
from fastbeam.interface.errors import SceneError
from fastbeam.scene import checks
from fastbeam.scene.axis_joint import JOINED, ONE_AXIS, SIDE, AxisJoint, Condition, OneAxisJoint
from fastbeam.scene.checks import Array, ArrayField, OfTimeLike, SideField, noun
from fastbeam.scene.joint_freedoms import (
    ABOUT_A,
    ABOUT_B,
    COSINES,
    SWING,
    TWIST,
    ForEach,
    Freedom,
    Shape,
    distance_along,
    drives_of,
    stops_of,
    times_of,
)
from fastbeam.scene.slider_forces import Drive, OfTime, Stops, as_drive, as_stops

# largest deviation of two axes from a right angle, as the cosine of the angle
UPRIGHT = 1e-9
Two, Three = tuple[float, float], tuple[float, float, float]
Times = tuple[OfTimeLike | None, ...]
ANGLE_AND_DISTANCE, CROSS, IN_PLANE = ("one for the angle and one for the distance", "one for the angle about each arm",
                                 "two for the distances and one for the angle")
NONE2, NONE3 = (None, None), (None, None, None)


def each_of(count: int, what: str) -> dict[str, Any]:
    """Return checks of the arguments for drives and forces on each of some coordinates."""
    return {"stiffness": ForEach(count, what, 0.0), "damping": ForEach(count, what, 0.0), "rest": ForEach(count, what),
            "friction": ForEach(count, what, 0.0), "drive": drives_of(count, what), "stops": stops_of(count, what)}


@checked(a=SIDE, b=SIDE, name=JOINED, axis=Vector, torque=OfTime("N m"), force=OfTime("N"), angle=OfTime("rad"),
         distance=OfTime("m"), speed=times_of(2, ANGLE_AND_DISTANCE, "rad/s or m/s"), **each_of(2, ANGLE_AND_DISTANCE))
@noun
class CylindricalJoint(OneAxisJoint):
    """Cylindrical joint: part b turns about an axis of a and slides along it. The axis goes through the point of b, parallel to
    `axis`.

    `result.joint(name)` has the angle and the distance along the axis from a to b, both zero at t = 0.

    Parameters
    ----------
    a, b, name, axis
        See `RevoluteJoint`; the points need not coincide.
    stiffness, damping, rest, friction : (float, float)
        See `RevoluteJoint` and `PrismaticJoint`: N m/rad and N/m, N m s/rad and N s/m, rad and m, N m and N. Friction of the
        angle is independent of that of the distance.
    torque, force, angle, distance : float or callable, optional
        See these joints.
    speed, drive, stops : (of the angle, of the distance), optional
        See these joints; either may be None.

    Raises
    ------
    SceneError
        See `RevoluteJoint`.
    """

    kind: ClassVar[str] = "cylindrical joint"
    conditions: ClassVar[tuple[tuple[Condition, ...], ...]] = (((1, -1), (2, -1)), ONE_AXIS)
    shapes: ClassVar[tuple[Shape, ...]] = (ABOUT_A, distance_along(0))

    _: KW_ONLY
    stiffness: Two = (0.0, 0.0)
    damping: Two = (0.0, 0.0)
    rest: Two = (0.0, 0.0)
    torque: OfTimeLike | None = None
    force: OfTimeLike | None = None
    angle: OfTimeLike | None = None
    distance: OfTimeLike | None = None
    speed: Times = NONE2
    friction: Two = (0.0, 0.0)
    drive: tuple[Drive | None, ...] = NONE2
    stops: tuple[Stops | None, ...] = NONE2

    def _acting(self) -> dict[str, tuple[Any, ...]]:
        return {**_same(self), "motor": (self.torque, self.force), "place": (self.angle, self.distance)}


@checked(a=SIDE, b=SIDE, name=JOINED, normal=Vector, along=Vector, force=times_of(2, "one for each distance", "N"),
         torque=OfTime("N m"), distance=times_of(2, "one for each direction", "m"), angle=OfTime("rad"),
         speed=times_of(3, IN_PLANE, "m/s or rad/s"), **each_of(3, IN_PLANE))
@noun
class PlanarJoint(AxisJoint):
    """Planar joint: the point of b stays in a plane of a, and b turns about the normal of the plane alone.

    `result.joint(name)` has the distances [n, 2] that the point of b has gone along two directions of the plane, which a carries,
    `along` and normal x along, and the angle by which b has turned about the normal.

    Parameters
    ----------
    a, b, name
        See `RevoluteJoint`; the points need not coincide.
    normal : array_like (3,)
        Normal of the plane, in space at t = 0; both parts carry it along.
    along : array_like (3,), optional
        Direction of the first distance, in space at t = 0, at a right angle to the normal. Default: a director of a or b, or an
        axis of space, that lies in the plane.
    stiffness, damping, rest, friction : (float, float, float)
        See `PrismaticJoint` for both distances, and `RevoluteJoint` for the angle: N/m and N m/rad, N s/m and N m s/rad, m
        and rad, N and N m. Friction along one direction is independent of that along the other.
    force, distance : (float or callable or None,) x 2, optional
        Along both directions, N and m.
    torque, angle : float or callable, optional
        About the normal, N m and rad.
    speed, drive, stops : of both distances and the angle, optional
        See these joints; each may be None.

    Raises
    ------
    SceneError
        See `RevoluteJoint`; `along` does not lie in the plane.
    """

    kind: ClassVar[str] = "planar joint"
    conditions: ClassVar[tuple[tuple[Condition, ...], ...]] = (((0, -1),), ONE_AXIS)
    shapes: ClassVar[tuple[Shape, ...]] = (distance_along(1), distance_along(2), ABOUT_A)

    a: SideField
    b: SideField
    name: str | None = None
    _: KW_ONLY
    normal: ArrayField
    along: ArrayField | None = None
    stiffness: Three = (0.0, 0.0, 0.0)
    damping: Three = (0.0, 0.0, 0.0)
    rest: Three = (0.0, 0.0, 0.0)
    force: Times = NONE2
    torque: OfTimeLike | None = None
    distance: Times = NONE2
    angle: OfTimeLike | None = None
    speed: Times = NONE3
    friction: Three = (0.0, 0.0, 0.0)
    drive: tuple[Drive | None, ...] = NONE3
    stops: tuple[Stops | None, ...] = NONE3

    def _clean(self) -> None:
        checks.fill(self, normal=checks.direction(self.label, "normal", self.normal))
        if self.along is not None:
            found = checks.direction(self.label, "along", self.along)
            if abs(float(found @ self.normal)) > UPRIGHT:
                raise SceneError(f"{self.label}: along={checks.shown(self.along)} must lie in the plane with the normal "
                                 f"{checks.shown(self.normal)}; give a direction perpendicular to the normal")
            checks.fill(self, along=found - (found @ self.normal) * self.normal)

    @property
    def axes(self) -> tuple[Array, Array]:
        """Directions of both sides, see `OneAxisJoint`."""
        return self.normal, self.normal

    @property
    def across(self) -> Array | None:
        """Direction of the first distance, see `AxisJoint`."""
        return self.along

    def _acting(self) -> dict[str, tuple[Any, ...]]:
        return {**_same(self), "motor": (*self.force, self.torque), "place": (*self.distance, self.angle)}


@checked(a=SIDE, b=SIDE, name=JOINED, axis_a=Vector, axis_b=Vector, torque=times_of(2, CROSS, "N m"),
         angle=times_of(2, CROSS, "rad"), speed=times_of(2, CROSS, "rad/s"), **each_of(2, CROSS))
@noun
class UniversalJoint(AxisJoint):
    """Cardan joint: two points stay together, and an axis of a stays at a right angle to one of b, the arms of its cross.

    `result.joint(name)` has the angles [n, 2]: that by which the cross has turned against a about `axis_a`, and that of b against
    the cross about `axis_b`, both zero at t = 0.

    Parameters
    ----------
    a, b, name
        See `RevoluteJoint`.
    axis_a, axis_b : array_like (3,)
        Arms of the cross in a and in b, directions in space at t = 0 at a right angle to each other.
    stiffness, damping, rest, friction : (float, float)
        See `RevoluteJoint`, for both angles: N m/rad, N m s/rad, rad, N m.
    torque, angle, speed, drive, stops : (about axis_a, about axis_b), optional
        See `RevoluteJoint`; either may be None.

    Raises
    ------
    SceneError
        See `RevoluteJoint`, or the arms are not at a right angle.
    """

    kind: ClassVar[str] = "universal joint"
    is_pinned: ClassVar[bool] = True
    conditions: ClassVar[tuple[tuple[Condition, ...], ...]] = (((0, 1),),)
    shapes: ClassVar[tuple[Shape, ...]] = (ABOUT_A, ABOUT_B)

    a: SideField
    b: SideField
    name: str | None = None
    _: KW_ONLY
    axis_a: ArrayField
    axis_b: ArrayField
    stiffness: Two = (0.0, 0.0)
    damping: Two = (0.0, 0.0)
    rest: Two = (0.0, 0.0)
    torque: Times = NONE2
    angle: Times = NONE2
    speed: Times = NONE2
    friction: Two = (0.0, 0.0)
    drive: tuple[Drive | None, ...] = NONE2
    stops: tuple[Stops | None, ...] = NONE2

    def _clean(self) -> None:
        who = self.label
        a, b = checks.direction(who, "axis_a", self.axis_a), checks.direction(who, "axis_b", self.axis_b)
        if abs(float(a @ b)) > UPRIGHT:
            angle = float(np.degrees(np.arccos(np.clip(a @ b, -1.0, 1.0))))
            raise SceneError(f"{who}: axis_a={checks.shown(self.axis_a)} and axis_b={checks.shown(self.axis_b)} make an angle of "
                             f"{angle:.10g} degrees, but the arms of a cross are perpendicular; turn one of them")
        checks.fill(self, axis_a=a, axis_b=b - (a @ b) * a)

    @property
    def axes(self) -> tuple[Array, Array]:
        """Directions of both sides, see `OneAxisJoint`."""
        return self.axis_a, self.axis_b

    def _acting(self) -> dict[str, tuple[Any, ...]]:
        return {**_same(self), "motor": self.torque, "place": self.angle}


@checked(a=SIDE, b=SIDE, name=JOINED, axis=Vector, stiffness=ForEach(2, "one for the swing and one for the twist", 0.0),
         damping=ForEach(2, "one for the swing and one for the twist", 0.0), cone=as_stops, torque=OfTime("N m"),
         twist=OfTime("rad"), speed=OfTime("rad/s"), friction=Number(least=0.0, unit="N m"), drive=as_drive, stops=as_stops)
@noun
class SphericalJoint(OneAxisJoint):
    """Ball in a socket: two points stay together, as with `BallJoint`, and an axis that both parts carry defines swing and twist.

    `result.joint(name)` has the swing, the angle from the axis of a to that of b, 0 to pi, and the twist of b about the axis: the
    rotation of b against a is the twist, followed by the swing about a direction across. Both are zero at t = 0.

    Parameters
    ----------
    a, b, name, axis
        See `RevoluteJoint`.
    stiffness : (float, float)
        Stiffness of springs towards zero swing and zero twist, N m/rad: energies k swing^2/2 and k twist^2/2.
    damping : (float, float)
        N m s/rad: torques against the rate at which the axis of b turns against a, and against the rate of the twist.
    cone : Stops, optional
        Stop of the swing: `fb.Stops(end=0.6, stiffness=500.0)`, elastic, or rigid with `restitution=`.
    torque, twist, speed, friction, drive, stops
        Arguments of the twist, see the angle of `RevoluteJoint`; twist and speed prescribe it as a function of time.

    Raises
    ------
    SceneError
        See `RevoluteJoint`; a cone that does not begin with a swing > 0.
    """

    kind: ClassVar[str] = "spherical joint"
    is_pinned: ClassVar[bool] = True
    shapes: ClassVar[tuple[Shape, ...]] = (SWING, TWIST, *COSINES)

    _: KW_ONLY
    stiffness: Two = (0.0, 0.0)
    damping: Two = (0.0, 0.0)
    cone: Stops | None = None
    torque: OfTimeLike | None = None
    twist: OfTimeLike | None = None
    speed: OfTimeLike | None = None
    friction: float = 0.0
    drive: Drive | None = None
    stops: Stops | None = None

    def _clean(self) -> None:
        super()._clean()
        if self.cone is not None and not (self.cone.start is None and 0.0 < self.cone.between[1] < np.pi):
            raise SceneError(f"{self.label}: cone={self.cone} must limit the swing from above, by an angle between 0 and pi; "
                             "write fb.Stops(end=...)")

    @property
    def freedoms(self) -> tuple[Freedom, ...]:
        """Free coordinates, see `AxisJoint`; without damping of the swing its cosines are left out."""
        every = super().freedoms
        return every if self.damping[0] > 0.0 else every[:2]

    def _acting(self) -> dict[str, tuple[Any, ...]]:
        def second(x: Any) -> tuple[Any, ...]:
            return (None, x, None, None, None)

        swing, twist = self.damping
        return {"stiffness": (*self.stiffness, None, None, None), "damping": (None, twist, swing, swing, swing),
                "stops": (self.cone, self.stops, None, None, None), "motor": second(self.torque), "place": second(self.twist),
                "speed": second(self.speed), "friction": second(self.friction), "drive": second(self.drive)}


def _same(joint: Any) -> dict[str, tuple[Any, ...]]:
    """Return the arguments of a joint that have one value for each coordinate."""
    return {name: getattr(joint, name) for name in ("stiffness", "damping", "rest", "speed", "friction", "drive", "stops")}
