"""Winches: ropes whose free length changes, because a drum pays them out or reels them in."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from typing import Any, ClassVar

import numpy as np

from fastbeam.interface.arguments import Count, Name, Number, Refusal, checked, shown
from fastbeam.interface.errors import SceneError
from fastbeam.scene import checks
from fastbeam.scene.beams import Beam, NodeRef
from fastbeam.scene.bodies import Load, Node, PointMass, RigidBody
from fastbeam.scene.checks import Array, Named, called, tried
from fastbeam.scene.fixed import Ground
from fastbeam.scene.prescribed_motion import PrescribedMotion
from fastbeam.scene.supports import Pin

LENGTH = Number(above=0.0, unit="m")
MOST_SEGMENTS = 10_000


@dataclass(frozen=True)
class OfTime:
    """Check of a function of t that returns a number, tried at t = 0; with `or_number` also a number."""

    unit: str
    or_number: bool = False

    def __call__(self, value: Any) -> Any:
        if not callable(value) or isinstance(value, type):
            if self.or_number:
                return Number(unit=self.unit)(value)
            raise Refusal(f"must be a function of t that returns a number, {self.unit}, got {shown(value)}")
        Number(unit=self.unit)(tried(value, "at t = 0", 0.0))
        return value


class RopePoint(PointMass):
    """Point between two segments of a rope; the rope has the mass."""

    kind: ClassVar[str] = "point of rope"

    def __init__(self, name: str, position: Array, velocity: Array | None = None) -> None:
        checks.fill(self, name=name, mass=0.0, position=checks.constant(position), velocity=velocity)


class Coil(RopePoint):
    """Drum of a winch: its place along x changes by as much as the free length of the rope."""

    kind: ClassVar[str] = "drum"


@checked(name=Name(), drum=Node(fixed=True), load=Node(fixed=True), stiffness=Number(above=0.0, unit="N"),
         mass_per_length=Number(above=0.0, unit="kg/m"), length=LENGTH, length_at=OfTime("m"),
         tension=OfTime("N", or_number=True), total=LENGTH, inertia=Number(least=0.0, unit="kg"),
         speed=Number(unit="m/s"), segments=Count(1, MOST_SEGMENTS))
@dataclass(frozen=True, eq=False)
class Winch(Named):
    """Rope between a drum and a load; the drum pays out or reels in rope: cranes, hoists, tethers (theory.md 4).

    The rope has mass and elasticity, pulls and does not push, and has no bending stiffness. Its free part is a row of straight
    segments of equal unstressed length through which it flows towards the load, so that the mesh stays even while the length
    changes by any factor. The length is a coordinate: given by `length_at`, or free, with a `tension` at the drum, or constant.
    Scenes with a winch run in space, with the conserving step or in statics. `result.winch(name)` has length, speed and tension.

    Parameters
    ----------
    name : str
    drum, load : NodeRef, RigidBody or PointMass
        Where the rope leaves the drum, and where it ends; one may be `GROUND.point((x, y, z))`. A mass has a position.
    stiffness : float
        EA, N.
    mass_per_length : float
        kg/m, unstressed.
    length : float, optional
        Unstressed free length at t = 0, m; default: the distance, or `length_at(0)`.
    length_at : callable, optional
        t -> unstressed free length, m: a hoist that is driven. Its rate must not jump. The work is that of `motion of ...` in
        `result.balance()`, the force the reaction of the winch's name along x: what pushes rope out, minus the pull of the drum.
    tension : float or callable, optional
        N, or t -> N: what the drum pulls with, its torque over its radius; the length follows. At rest the tension T of the rope
        is such that T (1 + T/(2 EA)) is this.
    total : float, optional
        All rope, free and on the drum, m: what is on the drum has mass, moves with the drum and around it, and no more than all
        is paid out. Default: the rope on the drum does not count.
    inertia : float
        Moment of inertia of the drum over the square of its radius, kg.
    speed : float
        Rate of the free length at t = 0, m/s, where a tension lets it go.
    segments : int
        Number of segments of the free part.

    Attributes
    ----------
    coil : PointMass
        Its place along x changes as the free length does; forces along x act on it.

    Raises
    ------
    SceneError
        Both a given length and a tension, lengths that do not fit together, or ends without a place.

    Examples
    --------
    >>> from fastbeam.scene import GROUND, PointMass, Scene, Winch
    >>> crate = PointMass('crate', mass=500.0, position=(0, 0, -50))
    >>> hoist = Winch('hoist', GROUND.point((0, 0, 0)), crate, stiffness=1e7, mass_per_length=1.5,
    ...               length_at=lambda t: 50.0 - 0.1 * t * t)
    >>> Scene(crate, hoist, gravity=(0, 0, -9.81)).check()
    >>> hoist.length
    50.0
    """

    kind: ClassVar[str] = "winch"

    name: str
    drum: NodeRef
    load: NodeRef
    _: KW_ONLY
    stiffness: float
    mass_per_length: float
    length: float | None = None
    length_at: Callable[[float], float] | None = None
    tension: float | Callable[[float], float] | None = None
    total: float | None = None
    inertia: float = 0.0
    speed: float = 0.0
    segments: int = 8

    def __post_init__(self) -> None:
        who = self.label
        if self.length_at is not None and (self.tension is not None or self.length is not None):
            raise SceneError(f"{who}: length_at prescribes the length; leave {('length' if self.tension is None else 'tension')} "
                             "out")
        if self.speed != 0.0 and self.tension is None:
            raise SceneError(f"{who}: speed={self.speed:.6g} m/s is for a rope whose length is not prescribed, tension=; leave "
                             "it out")
        ends = [self._place(node) for node in (self.drum, self.load)]
        distance = float(np.linalg.norm(ends[1] - ends[0]))
        if not distance > 0.0:
            raise SceneError(f"{who}: {self.drum} and {self.load} coincide, but a rope needs a length > 0 m; move one of them")
        if self.length is None:
            checks.fill(self, length=distance)
            if self.length_at is not None:
                checks.fill(self, length=self.length_of(0.0))
        if self.total is not None and self.total < self.length:
            raise SceneError(f"{who}: total={self.total:.6g} m is the length of the whole rope, but {self.length:.6g} m are free "
                             "at t = 0")
        shares = np.arange(1, self.segments)[:, None] / self.segments
        places = ends[0] + shares * (ends[1] - ends[0])
        checks.fill(self, points=tuple(RopePoint(f"{self.name} point {k + 1}", x) for k, x in enumerate(places)),
                    coil=Coil(f"{self.name} drum", ends[0], checks.constant(np.array([self.speed, 0.0, 0.0]))))

    @property
    def members(self) -> tuple[PointMass | Pin | PrescribedMotion | Load, ...]:
        """Parts of the winch besides the rope: points, the drum, and its support, prescribed motion or load."""
        coil = self.coil.center
        if self.length_at is not None:
            drive: Pin | PrescribedMotion | Load = PrescribedMotion(self.name, coil, displacement=self._paid_out, axes="x")
        elif self.tension is not None:
            time = self.tension if callable(self.tension) else None
            drive = Load(self.name, coil, force=(-(1.0 if time else self.tension), 0.0, 0.0), time=time)
        else:
            drive = Pin(coil, self.name, axes="x")
        return (*self.points, self.coil, Pin(coil, f"guide of {self.name}", axes="yz"), drive)

    @checked(t=Number(unit="s"))
    def length_of(self, t: float) -> float:
        """Return the prescribed free length at time t, m.

        Raises
        ------
        SceneError
            The length is not given, or the function fails or returns a length that the rope cannot have.
        """
        if self.length_at is None:
            raise SceneError(f"{self.label}: its length is not prescribed")
        from fastbeam.interface.arguments import take
        found = take(Number(unit="m"), f"{self.label}: length_at(t) at t = {t:.6g} s", called(self.label, "length_at",
                                                                                              self.length_at, t))
        if not 0.0 < found <= (np.inf if self.total is None else self.total):
            most = "" if self.total is None else f" and at most total={self.total:.6g} m"
            raise SceneError(f"{self.label}: length_at({t:.6g}) = {found:.6g} m; a free length must be more than 0{most}")
        return float(found)

    def _paid_out(self, t: float) -> tuple[float]:
        return (self.length_of(t) - self.length,)

    def _place(self, node: NodeRef) -> Array:
        owner = node.owner
        if isinstance(owner, Beam):
            return np.array(owner.reference(owner.node_s[node.index])[0][0])
        if isinstance(owner, RigidBody):
            return np.array(owner.position + node.offset @ owner.directors)
        if isinstance(owner, Ground):
            return np.array(node.offset)
        if getattr(owner, "position", None) is None:
            raise SceneError(f"{self.label}: {owner.label} has no position, but is an end of the rope; give it a position")
        return np.array(owner.position)
