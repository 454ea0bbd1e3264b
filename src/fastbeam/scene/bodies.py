"""Everything of a scene besides beams and sliders: masses, bodies, supports, joints, loads and initial velocities."""
from __future__ import annotations

from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from fastbeam.interface.arguments import Anything, Flag, Name, Number, Refusal, Vector, checked, shown
from fastbeam.interface.errors import SceneError
from fastbeam.scene import checks
from fastbeam.scene.beams import Beam, NodeRef, as_arc_lengths
from fastbeam.scene.checks import (
    Array,
    ArrayField,
    FieldField,
    FieldLike,
    FilledArray,
    Named,
    NodeField,
    OptionalArray,
    OptionalField,
    Takes,
    TimeFactor,
    as_factor,
    as_field,
    as_rotation,
    noun,
)
from fastbeam.scene.nets import Net
from fastbeam.scene.paths import as_beam

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

ZERO = (0.0, 0.0, 0.0)
MASS, FIELD, FACTOR = Number(above=0.0, unit="kg"), as_field, as_factor


@dataclass(frozen=True)
class Node:
    """Check of a node from a NodeRef, RigidBody (its centre) or PointMass; with `fixed` also a point of the ground."""

    fixed: bool = False

    def __call__(self, value: Any) -> NodeRef:
        if isinstance(value, NodeRef):
            if value.owner.kind == "ground" and not self.fixed:
                raise Refusal("is a point of the ground, which is fixed already; springs, distance joints and joints with axes "
                              "accept it, for others clamp a PointMass there")
            return value
        if getattr(value, "kind", None) == "ground" and not isinstance(value, type):
            raise Refusal("is the ground as a whole; " + ("say which point of it: GROUND.point((x, y, z))" if self.fixed else
                                                          "joints with axes accept it, for others clamp a PointMass"))
        if isinstance(value, (RigidBody, PointMass)):
            return value.center
        if isinstance(value, Beam):
            raise Refusal(f"names the whole {value.label}; use its start, end, node(i) or at(s)")
        if isinstance(value, Net):
            raise Refusal(f"names the whole {value.label}; use its node(i), or a node of its beam(k)")
        hint = "; use beam.start, beam.end or beam.node(i)" if isinstance(value, (int, float, np.number)) else ""
        hint = hint or ("; give the object itself, not a name" if isinstance(value, str) else "")
        raise Refusal(f"must be a node of a beam, a RigidBody, a point of one, or a PointMass, got {shown(value)}{hint}")


def as_steady(value: Any) -> Array:
    """Three numbers; a function of time is another argument."""
    if callable(value):
        raise Refusal(f"must be 3 finite numbers, got {shown(value)}; for changes in time give time=a function of t")
    return Vector(value)


def as_movable(value: Any) -> tuple[Any, ...]:
    """Check of one Beam, Net, RigidBody or PointMass or several, as a tuple."""
    one = isinstance(value, MOVABLE) or not isinstance(value, Iterable) or isinstance(value, (str, bytes, type, np.ndarray))
    objects = (value,) if one else tuple(islice(value, MOST_OBJECTS + 1))
    wrong = [item for item in objects if not isinstance(item, MOVABLE)]
    if not objects:
        raise Refusal("is empty; name the parts that move, or leave objects out to move everything")
    if wrong or len(objects) > MOST_OBJECTS:
        hint = f"; give {wrong[0].owner.label} itself" if wrong and isinstance(wrong[0], NodeRef) else "; None: everything"
        raise Refusal(f"must be beams, nets, bodies and point masses, got {shown(wrong[0] if wrong else objects)}{hint}")
    return objects


@checked(name=Name(), mass=MASS, position=Vector, velocity=Vector)
@noun
class PointMass(Named):
    """Point mass (kg, > 0). `position` (3,) m may be left out where a slider or a joint places it.

    `velocity` (3,) m/s: None means at rest, or moving with its slider.

    Raises
    ------
    SceneError
        The mass is not positive, or a vector is not 3 finite numbers.
    """

    kind: ClassVar[str] = "point mass"

    name: str
    _: KW_ONLY
    mass: float
    position: OptionalArray = None
    velocity: OptionalArray = None

    @property
    def center(self) -> NodeRef:
        """The mass as a node."""
        return NodeRef(self)


@checked(name=Name(), mass=MASS, inertia=Anything(), position=Vector, directors=as_rotation, velocity=Vector, spin=Vector)
@noun
class RigidBody(Named):
    """Rigid body: one node at the centre of mass with a body triad.

    Parameters
    ----------
    name : str
    mass : float
        kg, > 0.
    inertia : array_like (3,) or (3, 3)
        Principal moments, or the symmetric inertia tensor, about the centre of mass in the body triad, kg m^2; kept as (3, 3).
    position : array_like (3,)
        Centre of mass, m.
    directors : array_like (3, 3)
        Rows d1, d2, d3 of the body triad in space; default: the identity.
    velocity, spin : array_like (3,)
        Initial velocity of the centre of mass (m/s) and angular velocity in space (rad/s).

    Raises
    ------
    SceneError
        The inertia is not that of a body (not symmetric, negative, triangle inequality), or another value is out of range.
    """

    kind: ClassVar[str] = "body"

    name: str
    _: KW_ONLY
    mass: float
    inertia: ArrayField
    position: ArrayField
    directors: FilledArray = None
    velocity: ArrayField = ZERO
    spin: ArrayField = ZERO

    def __post_init__(self) -> None:
        who = checks.label(self.kind, self.name)
        directors = checks.constant(np.eye(3)) if self.directors is None else self.directors
        checks.fill(self, inertia=_inertia(who, self.inertia), directors=directors)

    @property
    def center(self) -> NodeRef:
        """The centre of mass as a node."""
        return NodeRef(self)

    @checked(offset=Vector)
    def point(self, offset: ArrayLike) -> NodeRef:
        """Return the point at `offset` (3,) m from the centre of mass, in the body triad.

        Raises
        ------
        SceneError
            The offset is not 3 finite numbers.
        """
        return NodeRef(self, 0, offset)


MOVABLE = (Beam, Net, RigidBody, PointMass)
Moved = Beam | Net | RigidBody | PointMass
MOST_OBJECTS = 10**6


def _inertia(who: str, value: Any) -> Array:
    """Return the symmetric inertia tensor (3, 3) of a possible body from principal moments or a tensor."""
    found = checks.numbers(value)
    if found is not None and found.shape == (3,):
        value = np.diag(checks.array(who, "inertia", value, (3,), "3 finite numbers"))
    tensor = checks.array(who, "inertia", value, (3, 3), "3 finite principal moments or a finite 3 x 3 tensor")
    scale = float(np.max(np.abs(tensor)))
    skew = float(np.max(np.abs(tensor - tensor.T)))
    if skew > 1e-9 * scale:
        raise SceneError(f"{who}: inertia must be symmetric, it deviates by {skew:.3g} kg m^2")
    moments = np.linalg.eigvalsh(0.5 * (tensor + tensor.T))
    if moments[0] < -1e-9 * scale:
        raise SceneError(f"{who}: inertia must not be negative, its smallest principal moment is {moments[0]:.6g} kg m^2")
    if moments[0] + moments[1] < moments[2] * (1.0 - 1e-9):
        raise SceneError(f"{who}: no body has the principal moments {checks.shown(moments)} kg m^2: the largest exceeds the sum "
                         "of the other two (triangle inequality)")
    return checks.constant(0.5 * (tensor + tensor.T))


@checked(a=Node(), b=Node(), name=Name("a joint has two sides, write one for every pair"))
@noun
class _Joint:
    """Common part of the joints: two nodes of different owners or at least different nodes."""

    kind: ClassVar[str] = "joint"

    a: NodeField
    b: NodeField
    name: str | None = None

    def __post_init__(self) -> None:
        who = self.kind if self.name is None else checks.label(self.kind, self.name)
        a, b = self.a, self.b
        if a.owner is b.owner and a.index == b.index:
            same = a.label if isinstance(a.owner, Beam) else a.owner.label
            raise SceneError(f"{who}: both sides are {same}; a joint needs two different nodes")
        if self.name is None:
            checks.fill(self, name=f"{self.kind} of {a.label} and {b.label}")


class RigidConnection(_Joint):
    """Rigid connection that keeps the relative position and rotation that two nodes have at t = 0; an offset between them is
    allowed.

    Raises
    ------
    SceneError
        A side is no node, body or mass, or both sides are the same node.
    """

    kind: ClassVar[str] = "rigid connection"


class BallJoint(_Joint):
    """Ball joint that keeps two coincident points together, rotations stay free. `Scene.check` tests that they coincide at t = 0.

    Raises
    ------
    SceneError
        A side is no node, body or mass, or both sides are the same node.
    """

    kind: ClassVar[str] = "ball joint"


@checked(name=Name(), at=Node(), force=as_steady, moment=as_steady, time=FACTOR, follower=Flag())
@noun
class Load:
    """Dead force (3,) N and moment (3,) N m in space on a node or body point, times `time(t)` (None: constant).

    With `follower=True` they are components along the directors of the node, with which they turn. numba compiles `time` then;
    the scene runs in space, with the conserving step or in statics (theory.md (4.30)).

    Raises
    ------
    SceneError
        A vector is not 3 finite numbers, or none is given, `time` is no function, a point mass gets a moment, or a load that
        turns with it.
    """

    kind: ClassVar[str] = "load"

    name: str
    at: NodeField
    _: KW_ONLY
    force: FilledArray = None
    moment: FilledArray = None
    time: TimeFactor | None = None
    follower: bool = False

    def __post_init__(self) -> None:
        who = checks.label(self.kind, self.name)
        if self.force is None and self.moment is None:
            raise SceneError(f"{who}: give force (N) or moment (N m), 3 numbers each")
        checks.fill(self, **{key: checks.constant(np.zeros(3)) for key in ("force", "moment") if getattr(self, key) is None})
        if isinstance(self.at.owner, PointMass) and self.follower:
            raise SceneError(f"{who}: {self.at.label} has no directors that turn; use a RigidBody or leave follower out")
        if isinstance(self.at.owner, PointMass) and np.any(self.moment):
            raise SceneError(f"{who}: {self.at.label} has no rotation and takes no moment; use a RigidBody or leave moment out")


@checked(name=Name(), beam=as_beam, force=FIELD, moment=FIELD, time=FACTOR, follower=Flag())
@noun
class DistributedLoad:
    """Dead force (N/m) and moment (N m/m) per reference length along a beam, in space, times `time(t)`.

    `force` and `moment` are 3 numbers or functions s[n] -> [n, 3]; None means none. Functions are integrated over what they load,
    whether they jump inside elements or not, as in lambda s: np.outer((s > 0.3) & (s < 0.7), (0, 0, -5.0)); a part that is
    shorter than 1/15 of its element and 1/250 of the beam may be missed: let elements end there, or use a `Load`. With
    `follower=True` they are 3 numbers along the directors, with which they turn, as for a `Load`: pressure is force=(0, -p, 0),
    N per unstressed length, against d2.

    Raises
    ------
    SceneError
        A field does not give finite [n, 3], `time` is no function, or `beam` no Beam; functions that should turn.
    """

    kind: ClassVar[str] = "distributed load"

    name: str
    beam: Beam
    _: KW_ONLY
    force: OptionalField = None
    moment: OptionalField = None
    time: TimeFactor | None = None
    follower: bool = False

    def __post_init__(self) -> None:
        who = checks.label(self.kind, self.name)
        if self.force is None and self.moment is None:
            raise SceneError(f"{who}: give force or moment per length")
        if self.follower and (callable(self.force) or callable(self.moment) or self.beam.interpolation != "lagrange"):
            raise SceneError(f"{who}: with follower=True force and moment must be 3 numbers, on a beam with Lagrange elements; "
                             "split the beam where they change, or write a UserForce")
        for key in ("force", "moment"):
            checks.try_field(who, key, getattr(self, key), self.beam.length)

    @checked(s=as_arc_lengths)
    def force_at(self, s: Array) -> Array:
        """Return the force per length [n, 3] at the arc lengths s[n], without the time factor."""
        return checks.field_values(checks.label(self.kind, self.name), "force", _field_or_zero(self.force), s)

    @checked(s=as_arc_lengths)
    def moment_at(self, s: Array) -> Array:
        """Return the moment per length [n, 3] at the arc lengths s[n], without the time factor."""
        return checks.field_values(checks.label(self.kind, self.name), "moment", _field_or_zero(self.moment), s)


def _field_or_zero(value: FieldLike | None) -> FieldLike:
    return np.zeros(3) if value is None else value


@checked(beam=as_beam, velocity=FIELD, spin=FIELD)
@noun
class InitialVelocity:
    """Initial velocity (m/s) and angular velocity in space (rad/s) along a beam: 3 numbers or functions s[n] -> [n, 3].

    Raises
    ------
    SceneError
        A field does not give finite [n, 3], or `beam` is no Beam.
    """

    kind: ClassVar[str] = "initial velocity"

    beam: Beam
    _: KW_ONLY
    velocity: FieldField = ZERO
    spin: FieldField = ZERO

    def __post_init__(self) -> None:
        for key in ("velocity", "spin"):
            checks.try_field(self.label, key, getattr(self, key), self.beam.length)

    @property
    def label(self) -> str:
        """`initial velocity of beam 'name'`."""
        return f"{self.kind} of {self.beam.label}"

    @checked(s=as_arc_lengths)
    def velocity_at(self, s: Array) -> Array:
        """Return the velocity [n, 3] at the arc lengths s[n]."""
        return checks.field_values(self.label, "velocity", self.velocity, s)

    @checked(s=as_arc_lengths)
    def spin_at(self, s: Array) -> Array:
        """Return the angular velocity [n, 3] at the arc lengths s[n]."""
        return checks.field_values(self.label, "spin", self.spin, s)


@checked(objects=as_movable, velocity=Vector, spin=Vector, about=Vector)
@noun
class RigidMotion:
    """Rigid motion that adds velocity + spin x (x - about) and the spin to the initial state of `objects` (None: everything).

    `objects`: one Beam, Net, RigidBody or PointMass, or several; kept as a tuple. Units m/s, rad/s, m. Contributions add up.

    Raises
    ------
    SceneError
        An object is of another kind, there is none in a list, or a vector is not 3 finite numbers.
    """

    kind: ClassVar[str] = "rigid motion"

    objects: Takes[Moved | Iterable[Moved] | None, tuple[Moved, ...] | None] = None
    _: KW_ONLY
    velocity: ArrayField = ZERO
    spin: ArrayField = ZERO
    about: ArrayField = ZERO
