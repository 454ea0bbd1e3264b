"""Supports: fixed nodes, all of a node or along some axes of space."""
from __future__ import annotations

from dataclasses import KW_ONLY
from typing import Any, ClassVar

from fastbeam.interface.arguments import Name, Number, Refusal, checked, shown
from fastbeam.interface.errors import SceneError
from fastbeam.scene import checks
from fastbeam.scene.bodies import Node
from fastbeam.scene.checks import NodeField, UntilLike, noun
from fastbeam.scene.slider_forces import needed_arguments

AXES = "xyz"
TIME = Number(unit="s")


def as_axes(value: Any) -> str:
    """Check of letters of axes of space, in any order."""
    letters = value if isinstance(value, str) else ""
    if not letters or len(set(letters)) < len(letters) or not set(letters) <= set(AXES):
        hint = "" if isinstance(value, str) else ("; for an oblique direction use a PlanarJoint or PrismaticJoint with "
                                                  "GROUND, or a Slider on a stiff clamped beam")
        raise Refusal(f"must name axes of the global frame by their letters, as in axes='yz', got {shown(value)}{hint}")
    return letters


def as_until(value: Any) -> Any:
    """Check of a time, or a function of (t, state)."""
    if callable(value) and not isinstance(value, type):
        if needed_arguments(value) != 2:
            raise Refusal(f"must take two arguments (t, state), this function takes {needed_arguments(value)}")
        return value
    try:
        return TIME(value)
    except Refusal:
        raise Refusal(f"must be a finite time in s or a function of (t, state), got {shown(value)}") from None


def check_since(who: str, since: Any, until: Any) -> None:
    """Check that a support takes hold before it lets go, if both times are given. Raises SceneError."""
    if isinstance(since, float) and isinstance(until, float) and not until > since:
        raise SceneError(f"{who}: until={until:.6g} s must lie after since={since:.6g} s")


def mask_of(axes: str) -> int:
    """Return bits of the components of a position that are fixed."""
    return sum(1 << AXES.index(letter) for letter in axes)


@checked(at=Node(), name=Name("each support holds one node, write one for every node"), axes=as_axes,
         until=as_until, since=as_until)
@noun
class _Support:
    """Common part of Clamp and Pin: a node and a name that is made from it when left out."""

    kind: ClassVar[str] = "support"
    holds_triad: ClassVar[bool] = False

    at: NodeField
    name: str | None = None
    _: KW_ONLY
    axes: str = AXES
    until: UntilLike | None = None
    since: UntilLike | None = None

    def __post_init__(self) -> None:
        if self.name is None:
            along = "" if self.mask & 7 == 7 else f" along {self.axes}"
            checks.fill(self, name=f"{self.kind} of {self.at.label}{along}")
        check_since(str(self.name), self.since, self.until)

    @property
    def mask(self) -> int:
        """Bits of the six unknowns of its node that it fixes."""
        return mask_of(self.axes) | (56 if self.holds_triad else 0)


class Clamp(_Support):
    """Support that fixes position and triad of a node: `Clamp(beam.start)`. A point of a body clamps the whole body.

    Parameters
    ----------
    at : NodeRef, RigidBody, PointMass
    name : str, optional
    axes : str
        Letters of the axes of space along which the position is held, as in axes="yz": then the node moves along the others,
        without turning (a guided end).
    until : float or callable
        When it lets go for good: a time, s, or as soon as a function of (t, state) is not negative, or returns True. Neither the
        motion nor the energy jumps there.
    since : float or callable
        When it takes hold: a time, s, or as soon as a function of (t, state) is not negative, or returns True. It holds the node
        where it is then, and the impact takes the kinetic energy that this costs (theory.md (4.11a)).

    Raises
    ------
    SceneError
        `at` is no node, body or mass, `axes` are no axes of space, or belong to a body point away from the centre.
    """

    kind: ClassVar[str] = "clamp"
    holds_triad: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mask != 63 and not self.at.is_center:
            raise SceneError(f"{self.name}: axes are available at the centre of a body only; clamp the centre with these axes: a "
                             "body that does not turn moves as its centre does")


class Pin(_Support):
    """Support that fixes the position of a node, rotation stays free: `Pin(beam.end)`; a roller fixes it along some axes of space
    only: `Pin(beam.end, axes="yz")` rolls along x.

    Parameters
    ----------
    at : NodeRef, RigidBody, PointMass
    name : str, optional
    axes : str
        Letters of the axes of space along which the position is held.
    until : float or callable
        When it lets go for good, as for a `Clamp`.
    since : float or callable
        When it takes hold, as for a `Clamp`.

    Raises
    ------
    SceneError
        `at` is no node, body or mass, or a body point away from the centre; `axes` are no axes of space.
    """

    kind: ClassVar[str] = "pin"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.at.is_center:
            raise SceneError(f"{self.name}: a pin fixes the centre of a body; for another point clamp a PointMass there and join "
                             "it with BallJoint(body.point(...), mass)")
