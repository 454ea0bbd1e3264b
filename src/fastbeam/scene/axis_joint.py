"""Common part of joints with axes between two of body, point of a body, beam node and ground: conditions on points and
directions, and free coordinates."""
from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Any, ClassVar

from fastbeam.interface.arguments import Name, Vector, checked
from fastbeam.interface.errors import SceneError
from fastbeam.scene import checks
from fastbeam.scene.bodies import Node, PointMass
from fastbeam.scene.checks import Array, ArrayField, SideField, noun
from fastbeam.scene.fixed import GROUND, Ground
from fastbeam.scene.joint_freedoms import Freedom, Shape, freedoms_of
from fastbeam.scene.links import Link

JOINED = Name("a joint has two sides, write one for every pair")


@dataclass(frozen=True)
class Side:
    """Check of a side: a node, a point of the ground, or the ground at the place of the other side."""

    def __call__(self, value: Any) -> Any:
        return value if isinstance(value, Ground) else Node(fixed=True)(value)


SIDE = Side()
# conditions (i, j): D_i of a and D_j of b stay at a right angle; (i, -1): the distance along D_i from a to b stays
Condition = tuple[int, int]
ONE_AXIS, ONE_TRIAD = ((0, 1), (0, 2)), ((0, 1), (0, 2), (1, 2))


class AxisJoint(Link):
    """Common part of the joints with axes: their conditions, free coordinates, and places at t = 0."""

    kind: ClassVar[str] = "joint"
    # True: both points stay together
    is_pinned: ClassVar[bool] = False
    # sets of conditions, each held by forces of one unit
    conditions: ClassVar[tuple[tuple[Condition, ...], ...]] = ()
    # shapes of the free coordinates
    shapes: ClassVar[tuple[Shape, ...]] = ()

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
                checks.fill(self, **{name: GROUND.point(other.place)})
        super().__post_init__()
        self._clean()
        for freedom in self.freedoms:
            freedom.check()

    def _clean(self) -> None:
        """Clean the directions of the joint."""

    @property
    def across(self) -> Array | None:
        """Direction D_2 in space at t = 0 where the user has chosen it, else None."""
        return None

    @property
    def freedoms(self) -> tuple[Freedom, ...]:
        """Free coordinates, each with its drives, springs, friction and stops."""
        return freedoms_of(self, self.shapes, self._acting())

    def _acting(self) -> dict[str, tuple[Any, ...]]:
        """Return the arguments of `freedoms_of` for the coordinates."""
        return {}


@checked(a=SIDE, b=SIDE, name=JOINED, axis=Vector)
@noun
class OneAxisJoint(AxisJoint):
    """Joint with one axis, which both parts carry."""

    a: SideField
    b: SideField
    name: str | None = None
    _: KW_ONLY
    axis: ArrayField

    def _clean(self) -> None:
        checks.fill(self, axis=checks.direction(self.label, "axis", self.axis))

    @property
    def axes(self) -> tuple[Array, Array]:
        """D_1 of a and the direction in b that the conditions name, in space at t = 0, both [3]."""
        return self.axis, self.axis
