"""Free coordinates of joints: single angles and distances, and forces, springs, drives and stops on each."""
from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, fields
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fastbeam.interface.arguments import Refusal, numbers, shown
from fastbeam.interface.errors import SceneError
from fastbeam.scene.checks import OfTimeLike
from fastbeam.scene.slider_forces import Drive, OfTime, Stops, as_drive, as_stops, rate_at_start

if TYPE_CHECKING:
    from fastbeam.scene.axis_joint import AxisJoint

# argument `fades` of `rate_at_start`, also for functions that begin with the fourth power of time
FADES = 1e-3


class Product(NamedTuple):
    """Term of one of the two sums, y and z, of which a coordinate is a function (joints/coordinates.py)."""

    of_z: int    # 0: it belongs to y, 1: to z
    i: int       # a direction D_i of a
    j: int       # a direction E_j of b; -1: r = x_b - x_a takes its place
    sign: float = 1.0


class Shape(NamedTuple):
    """Coordinate as a function of both nodes, without forces on it."""

    what: str                      # 'angle', 'distance', 'place', 'swing', 'twist' or 'cosine'
    products: tuple[Product, ...]
    axis: int = 0                  # the direction about which it turns or along which it goes
    side: int = 0                  # 0: one of a; 1: of b

    @property
    def is_angle(self) -> bool:
        """True if it is a coordinate of directions, not of points."""
        return self.what != "distance"


def distance_along(i: int) -> Shape:
    """Return the shape of the distance from a to b along D_i."""
    return Shape("distance", (Product(0, i, -1),), i)


# angle of b against a about D_1, which both carry; or of E_2 about D_1, to which it stays at a right angle
ABOUT_A = Shape("angle", (Product(0, 2, 1), Product(1, 1, 1)))
# angle of b against the cross, about E_2
ABOUT_B = Shape("angle", (Product(0, 0, 2), Product(1, 0, 0)), 1, 1)
# rotation of b = swing of the axis, about a direction across, after a twist about the axis
SWING = Shape("swing", (Product(1, 0, 0),))
TWIST = Shape("twist", (Product(0, 2, 1), Product(0, 1, 2, -1.0), Product(1, 1, 1), Product(1, 2, 2)))
# E_1 in the directions of a: coordinates that damp the swing
COSINES = tuple(Shape("cosine", (Product(0, i, 0),)) for i in range(3))


@dataclass(frozen=True)
class Freedom:
    """Free coordinate of a joint, with forces, springs, drives and stops on it."""

    joint: AxisJoint
    shape: Shape
    which: str = ""  # word that distinguishes it from others of its kind in messages: 'first ', 'second ' or ''
    alone: bool = True  # whether the joint has no other
    _: KW_ONLY
    # stiffness, damping, rest, motor, place, speed, friction, coefficient, radius, length, drive, stops, smoothing: arguments of
    # joints, and of `Friction`; motor is the torque or force, place the prescribed angle or distance
    stiffness: float = 0.0
    damping: float = 0.0
    rest: float = 0.0
    motor: OfTimeLike | None = None
    place: OfTimeLike | None = None
    speed: OfTimeLike | None = None
    friction: float = 0.0
    coefficient: float = 0.0
    radius: float = 1.0
    length: float | None = None
    drive: Drive | None = None
    stops: Stops | None = None
    smoothing: float = 0.0

    @property
    def name(self) -> str:
        """Name of the joint."""
        return str(self.joint.name)

    @property
    def word(self) -> str:
        """Kind of the coordinate in words, empty if the joint has no other."""
        return "" if self.alone else f"{self.which}{self.shape.what}"

    @property
    def label(self) -> str:
        """Text for messages."""
        return self.joint.label if self.alone else f"{self.word} of {self.joint.label}"

    def force_label(self, what: str) -> str:
        """Return the name of a force on the coordinate, which is a part of those of the joint."""
        return f"{self.joint.label} ({f'{self.word} {what}'.strip()})"

    @property
    def words(self) -> tuple[str, str, str]:
        """Names of the arguments for its value and its motor, and the unit of the value."""
        if self.shape.is_angle:
            return "angle", "torque", "rad"
        return "distance", "force", "m"

    @property
    def has_friction(self) -> bool:
        """True if it has friction."""
        return self.friction > 0.0 or self.coefficient > 0.0

    @property
    def may_stick(self) -> bool:
        """True if friction or a rigid stop may hold it."""
        return self.has_friction or (self.stops is not None and self.stops.is_rigid)

    @property
    def shares(self) -> tuple[float, float]:
        """Largest friction for each N that the joint carries across its axis, and for each N m."""
        return self.coefficient * self.radius, 0.0 if self.length is None else 2.0 * self.coefficient * self.radius / self.length

    @property
    def is_given(self) -> bool:
        """True if it is prescribed as a function of time."""
        return self.place is not None or self.speed is not None

    @property
    def acts(self) -> bool:
        """True if a force, spring, drive, friction or stop acts on it."""
        return (self.stiffness > 0.0 or self.damping > 0.0 or self.motor is not None or self.is_given or self.may_stick
                or self.drive is not None or self.stops is not None)

    @property
    def given_rate(self) -> float:
        """Prescribed rate at t = 0, m/s or rad/s."""
        what = "speed" if self.place is None else self.words[0]
        return rate_at_start(self.speed if self.place is None else self.place, what, self.label, FADES)

    def check(self) -> None:
        """Check the arguments for contradictions. Raises SceneError."""
        who, (place, motor, unit) = self.label, self.words
        if self.place is not None and self.speed is not None:
            raise SceneError(f"{who}: {place}= and speed= both prescribe its motion; give one of them")
        if self.is_given:
            given = f"{place}=" if self.place is not None else "speed="
            others = {"stiffness": self.stiffness > 0.0, "damping": self.damping > 0.0, motor: self.motor is not None,
                      "drive": self.drive is not None, "friction": self.friction > 0.0, "coefficient": self.coefficient > 0.0,
                      "stops": self.stops is not None}
            for what, is_there in others.items():
                if is_there:
                    raise SceneError(f"{who}: {given} prescribes its motion whatever the force, so {what}= has no effect; leave "
                                     "one of them out")
        if self.drive is not None and self.drive.is_prescribed:
            raise SceneError(f"{who}: drive= is for a force, or a controller with stiffness=, damping= and limit=; prescribe its "
                             f"motion by {place}= or speed= of the joint")
        if self.stops is not None:
            if self.stops.on_tracks:
                raise SceneError(f"{who}: stops: (track, s) is a place on a Switch; give a distance, m, or an angle, rad")
            low, high = self.stops.between
            if not low <= 0.0 <= high:
                raise SceneError(f"{who}: stops from {self.stops.start} to {self.stops.end} {unit} must enclose its {place} at "
                                 "the start, 0; begin between them")


ACTING = tuple(x.name for x in fields(Freedom) if x.name not in ("joint", "shape", "which", "alone"))


def freedoms_of(joint: AxisJoint, shapes: tuple[Shape, ...], given: dict[str, tuple[Any, ...]]) -> tuple[Freedom, ...]:
    """Return all coordinates of a joint; given: values for each coordinate, by the names of `Freedom`."""
    out = []
    for k, shape in enumerate(shapes):
        same = [n for n, other in enumerate(shapes) if other.what == shape.what]
        which = "" if len(same) == 1 else ("first ", "second ", "third ")[same.index(k)]
        # None is left out, for the default
        mine = {name: values[k] for name, values in given.items() if values[k] is not None}
        out.append(Freedom(joint, shape, which, len(shapes) == 1, **mine))
    return tuple(out)


# --- arguments of joints with several coordinates ------------------------------------------------------------------------------
@dataclass(frozen=True)
class ForEach:
    """Check of a number >= least for each coordinate of a joint, `what` in words."""

    count: int
    what: str
    least: float | None = None

    def __call__(self, value: Any) -> tuple[float, ...]:
        bound = "" if self.least is None else f" >= {self.least:g}"
        need = f"must be {_COUNTS[self.count]} numbers{bound}, {self.what}"
        clean = numbers(value)
        if clean is None or clean.shape != (self.count,) or not np.all(np.abs(clean) <= 1e60):
            raise Refusal(f"{need}, got {shown(value)}")
        if self.least is not None and np.any(clean < self.least):
            raise Refusal(f"{need}, got {shown(value)}")
        return tuple(float(x) for x in clean)


@dataclass(frozen=True)
class SomeOf:
    """Check of a value of a kind, or None, for each coordinate of a joint."""

    count: int
    what: str
    of: Any
    noun: str

    def __call__(self, value: Any) -> tuple[Any, ...]:
        need = f"must be {_COUNTS[self.count]} of them, {self.what}, each {self.noun} or None"
        if not isinstance(value, (tuple, list)) or len(value) != self.count:
            raise Refusal(f"{need}, got {shown(value)}")
        return tuple(None if x is None else self.of(x) for x in value)


_COUNTS = {2: "two", 3: "three"}


def times_of(count: int, what: str, unit: str) -> SomeOf:
    """Return the check of numbers or functions of time for each coordinate."""
    return SomeOf(count, what, OfTime(unit), "a number, a function of time")


def drives_of(count: int, what: str) -> SomeOf:
    """Return the check of drives for each coordinate."""
    return SomeOf(count, what, as_drive, "a Drive")


def stops_of(count: int, what: str) -> SomeOf:
    """Return the check of stops for each coordinate."""
    return SomeOf(count, what, as_stops, "Stops")
