"""Joints with one axis that leave one angle or one distance free: hinges and guides."""
from __future__ import annotations

from dataclasses import KW_ONLY
from typing import Any, ClassVar

from fastbeam.interface.arguments import Number, Vector, checked
from fastbeam.interface.errors import SceneError
from fastbeam.scene.axis_joint import JOINED, ONE_AXIS, ONE_TRIAD, SIDE, Condition, OneAxisJoint
from fastbeam.scene.checks import OfTimeLike, noun
from fastbeam.scene.joint_freedoms import ABOUT_A, ACTING, Shape, distance_along
from fastbeam.scene.slider_forces import Drive, OfTime, Stops, as_drive, as_stops


def _check_pin(who: str, coefficient: float, length: float | None, radius: float | None) -> None:
    """Check that friction by the load has the sizes of the pressed surfaces; radius: of a pin, None for a guide.

    Raises SceneError.
    """
    if coefficient > 0.0 and radius == 0.0:
        raise SceneError(f"{who}: coefficient= is friction on the surface of a pin and needs its radius; give radius=, m > 0")
    if coefficient == 0.0 and (length is not None or (radius or 0.0) != 0.0):
        what = "length" if length is not None else "radius"
        raise SceneError(f"{who}: {what}= is part of friction by the load and needs coefficient=; give that too, or leave "
                         f"{what}= out")


@checked(a=SIDE, b=SIDE, name=JOINED, axis=Vector, stiffness=Number(least=0.0, unit="N m/rad"),
         damping=Number(least=0.0, unit="N m s/rad"), rest=Number(unit="rad"), torque=OfTime("N m"), angle=OfTime("rad"),
         speed=OfTime("rad/s"), friction=Number(least=0.0, unit="N m"), coefficient=Number(least=0.0),
         radius=Number(least=0.0, unit="m"), length=Number(above=0.0, unit="m"), drive=as_drive, stops=as_stops)
@noun
class RevoluteJoint(OneAxisJoint):
    """Hinge: two points stay together, and both parts keep one axis in common (theory.md 4, Joints with axes).

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
    shapes: ClassVar[tuple[Shape, ...]] = (ABOUT_A,)

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
        _check_pin(self.label, self.coefficient, self.length, self.radius)

    def _acting(self) -> dict[str, tuple[Any, ...]]:
        return {**{name: (getattr(self, name),) for name in ACTING if hasattr(self, name)}, "motor": (self.torque,),
                "place": (self.angle,)}


@checked(a=SIDE, b=SIDE, name=JOINED, axis=Vector, stiffness=Number(least=0.0, unit="N/m"),
         damping=Number(least=0.0, unit="N s/m"), rest=Number(unit="m"), force=OfTime("N"), distance=OfTime("m"),
         speed=OfTime("m/s"), friction=Number(least=0.0, unit="N"), coefficient=Number(least=0.0),
         length=Number(above=0.0, unit="m"), drive=as_drive, stops=as_stops)
@noun
class PrismaticJoint(OneAxisJoint):
    """Part b slides along an axis of a without turning: a guide, a translational joint.

    `result.joint(name)` has the distance that b has gone along the axis since t = 0.

    Parameters
    ----------
    a, b, name, axis
        See `RevoluteJoint`; the points need not coincide.
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
        As in `RevoluteJoint`, along the axis.

    Raises
    ------
    SceneError
        See `RevoluteJoint`.
    """

    kind: ClassVar[str] = "prismatic joint"
    conditions: ClassVar[tuple[tuple[Condition, ...], ...]] = (((1, -1), (2, -1)), ONE_TRIAD)
    shapes: ClassVar[tuple[Shape, ...]] = (distance_along(0),)

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
        _check_pin(self.label, self.coefficient, self.length, None)

    def _acting(self) -> dict[str, tuple[Any, ...]]:
        return {**{name: (getattr(self, name),) for name in ACTING if hasattr(self, name)}, "motor": (self.force,),
                "place": (self.distance,)}
