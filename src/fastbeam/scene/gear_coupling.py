"""Couplings of two coordinates of joints by a ratio: gears, racks and pinions; and checks that couplings can hold together."""
from __future__ import annotations

from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Any, ClassVar, NamedTuple, Union

from fastbeam.interface.arguments import Name, Number, Refusal, checked, shown
from fastbeam.interface.errors import SceneError
from fastbeam.interface.synonyms import listed
from fastbeam.scene import checks
from fastbeam.scene.axis_joint import AxisJoint
from fastbeam.scene.checks import Takes, noun
from fastbeam.scene.joint_freedoms import Freedom

# kinds of coordinates that have two directions
COUPLED = ("angle", "twist", "distance")


class JointCoordinate(NamedTuple):
    """Free coordinate of a joint, by its number among those of the joint."""

    joint: AxisJoint
    k: int

    @property
    def freedom(self) -> Freedom:
        """The coordinate with what acts on it."""
        return self.joint.freedoms[self.k]

    @property
    def label(self) -> str:
        """Text for messages."""
        return self.freedom.label


class Relation(NamedTuple):
    """Relation between two coordinates: the second is `ratio` times the first."""

    label: str
    first: JointCoordinate
    second: JointCoordinate
    ratio: float


@dataclass(frozen=True)
class ACoordinate:
    """Check of a coordinate of a joint: a joint that has one, or (joint, 'angle')."""

    def __call__(self, value: Any) -> JointCoordinate:
        if isinstance(value, JointCoordinate):
            return value
        joint, word = value if isinstance(value, tuple) and len(value) == 2 else (value, None)
        if not isinstance(joint, AxisJoint) or not (word is None or isinstance(word, str)):
            raise Refusal("must be a joint with an axis, as RevoluteJoint or PrismaticJoint, or (joint, 'angle'), got "
                          f"{shown(value)}")
        words = {f"{x.which}{x.shape.what}": k for k, x in enumerate(joint.freedoms) if x.shape.what in COUPLED}
        if word is None and len(words) == 1:
            return JointCoordinate(joint, *words.values())
        if word not in words:
            named = listed([repr(x) for x in words])
            raise Refusal(f"must name a coordinate of {joint.label}, {named}: write (joint, {next(iter(words))!r})"
                          + ("" if word is None else f", got {word!r}"))
        return JointCoordinate(joint, words[word])


CoordinateField = Takes[Union[AxisJoint, tuple[AxisJoint, str]], JointCoordinate]


@checked(first=ACoordinate(), second=ACoordinate(), name=Name("a coupling has two coordinates, write one for every pair"),
         ratio=Number())
@noun
class GearCoupling:
    """Gear, or rack and pinion: the second coordinate is `ratio` times the first (theory.md (4.36)).

    A coordinate is the angle or distance of a joint since t = 0: a pair of wheels couples the angles of their hinges, a rack
    and pinion the angle of a hinge with the distance of a `PrismaticJoint`. Where the hinges belong to a carrier that turns,
    these are the angles against it, as those of planetary gears.

    `result.joint(name)` of both joints has the torque, N m, or force, N, that the gear exerts on the coordinate, `coupling`:
    on the second T, on the first -ratio T, so that they do no work together. They act between the sides of each joint; the
    forces of teeth at a distance from the axes press on the bearings in addition, and are not included.

    Parameters
    ----------
    first, second : joint, or (joint, word)
        Joints with axes: `RevoluteJoint`, `PrismaticJoint`. Of those that leave several coordinates free say which, as
        `(joint, 'angle')`, `'distance'`, `'first angle'`, `'twist'`.
    name : str, optional
    ratio : float
        Of the second coordinate to the first, rad/rad, m/rad, rad/m or m/m, not 0: -z1/z2 for numbers of teeth z of outer wheels
        about the same direction, z1/z2 for an inner wheel, the radius of a pinion for a rack.

    Raises
    ------
    SceneError
        An argument is no joint with such a coordinate, both are the same coordinate, the ratio is 0. `Scene.check`: a joint is
        not in the scene; gears form a loop; more than one of the coordinates that gears connect is prescribed, or has friction
        or rigid stops.

    Examples
    --------
    >>> from fastbeam.scene import GROUND, GearCoupling, RevoluteJoint, RigidBody, Scene
    >>> small = RigidBody('small', mass=1.0, inertia=(1, 1, 0.2), position=(0, 0, 0))
    >>> large = RigidBody('large', mass=4.0, inertia=(1, 1, 3.2), position=(0.5, 0, 0))
    >>> one, two = (RevoluteJoint(GROUND, wheel, axis=(0, 0, 1)) for wheel in (small, large))
    >>> scene = Scene(small, large, one, two, GearCoupling(one, two, 'gear', ratio=-0.25))
    >>> scene.check()
    """

    kind: ClassVar[str] = "gear coupling"

    first: CoordinateField
    second: CoordinateField
    name: str | None = None
    _: KW_ONLY
    ratio: float

    def __post_init__(self) -> None:
        if self.name is None:
            checks.fill(self, name=f"{self.kind} of {self.first.label} and {self.second.label}")
        if self.first == self.second:
            raise SceneError(f"{self.label}: both coordinates are the {self.first.freedom.shape.what} of "
                             f"{self.first.joint.label}; a gear needs two")
        if self.ratio == 0.0:
            raise SceneError(f"{self.label}: ratio must not be 0, with which the second coordinate would stand still")

    @property
    def label(self) -> str:
        """Name for messages; an automatic name says the kind already."""
        return self.name if self.name.startswith(f"{self.kind} of ") else checks.label(self.kind, self.name)  # type: ignore

    @property
    def relation(self) -> Relation:
        """The relation between both coordinates."""
        return Relation(self.label, self.first, self.second, self.ratio)


def relations_of(parts: Iterable[Any]) -> list[Relation]:
    """Return the relations between coordinates of joints that parts of a scene have."""
    found = [getattr(part, "relation", None) for part in parts]
    return [x for x in found if x is not None]


def check_relations(relations: list[Relation], joints: Iterable[AxisJoint], scene: str) -> None:
    """Check that the joints of relations are in the scene, and that all of them can hold, with what holds single coordinates.

    Raises SceneError: a joint is missing, relations form a loop, or one group of coordinates is held twice.
    """
    known = set(joints)
    group: dict[JointCoordinate, JointCoordinate] = {}
    holder: dict[JointCoordinate, str] = {}
    for relation in relations:
        roots = []
        for one in (relation.first, relation.second):
            if one.joint not in known:
                raise SceneError(f"{relation.label}: {one.joint.label} is not in {scene}; add it to the scene")
            if one not in group:
                group[one] = one
                holder[one] = _holder(one.freedom)
            while group[one] != one:
                one = group[one]
            roots.append(one)
        a, b = roots
        if a == b:
            raise SceneError(f"{relation.label}: other couplings relate both coordinates already, which are held twice in this "
                             "loop; leave one of them out")
        if holder[a] and holder[b]:
            raise SceneError(f"{relation.label}: {holder[a]} and {holder[b]}, but the coupling lets either hold the other; leave "
                             "one of them out, or the coupling")
        group[a], holder[b] = b, holder[a] or holder[b]


def _holder(freedom: Freedom) -> str:
    """Return what holds a coordinate, empty if nothing does."""
    if freedom.is_given:
        return f"{freedom.label} is prescribed"
    return f"{freedom.label} has {'friction' if freedom.has_friction else 'rigid stops'}" if freedom.may_stick else ""
