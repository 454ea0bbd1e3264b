"""Links between two points of a scene: the common part of springs and of joints with multipliers."""
from __future__ import annotations

from typing import ClassVar

from fastbeam.interface.arguments import Name, checked
from fastbeam.interface.errors import SceneError
from fastbeam.scene import checks
from fastbeam.scene.beams import Beam
from fastbeam.scene.bodies import Node
from fastbeam.scene.checks import NodeField, noun


@checked(a=Node(fixed=True), b=Node(fixed=True), name=Name("a link has two sides, write one for every pair"))
@noun
class Link:
    """Link of two different nodes and a name that is made from them when left out."""

    kind: ClassVar[str] = "link"

    a: NodeField
    b: NodeField
    name: str | None = None

    def __post_init__(self) -> None:
        a, b = self.a, self.b
        if a.owner.kind == b.owner.kind == "ground":
            who = self.kind if self.name is None else checks.label(self.kind, self.name)
            raise SceneError(f"{who}: both sides are the ground; one has to belong to something that moves")
        if a.owner is b.owner and a.index == b.index and (a.offset == b.offset).all():
            who = self.kind if self.name is None else checks.label(self.kind, self.name)
            same = a.label if isinstance(a.owner, Beam) else a.owner.label
            raise SceneError(f"{who}: both sides are {same}; it needs two different points")
        if self.name is None:
            checks.fill(self, name=f"{self.kind} of {a.label} and {b.label}")

    @property
    def label(self) -> str:
        """Name of the link for messages; automatic names already say the kind."""
        return label_of(self)


def label_of(link: Link) -> str:
    """Return the name of a link for messages; automatic names already say the kind."""
    name = str(link.name)
    return name if name.startswith(f"{link.kind} of ") else checks.label(link.kind, name)
