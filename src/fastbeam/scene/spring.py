"""A spring between two points."""
from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import ClassVar

from fastbeam.arguments import Name, Number, checked
from fastbeam.scene.links import Link
from fastbeam.scene.parts import Node


@checked(a=Node(fixed=True), b=Node(fixed=True), name=Name("a spring has two ends, write one for every pair"),
         stiffness=Number(least=0.0, unit="N/m"), length=Number(least=0.0, unit="m"))
@dataclass(frozen=True, eq=False)
class Spring(Link):
    """Linear spring without mass between two points: nodes of beams, points of bodies, masses.

    Its energy is 1/2 stiffness (distance - length)^2; it pulls and pushes along the line of both points.

    Parameters
    ----------
    a, b : NodeRef, RigidBody or PointMass
        Its ends; one may be `GROUND.point((x, y, z))`.
    name : str, optional
    stiffness : float
        N/m, >= 0.
    length : float, optional
        Length without force, m, >= 0; default: the distance of its ends at t = 0.

    Raises
    ------
    SceneError
        An end is no node, body or mass, both ends are the same, a number is out of range.

    Examples
    --------
    >>> from fastbeam.scene import Clamp, PointMass, Scene, Spring
    >>> anchor, bob = PointMass('anchor', mass=1.0, position=(0, 0, 0)), PointMass('bob', mass=2.0, position=(0, 0, -1))
    >>> scene = Scene(anchor, bob, Clamp(anchor), Spring(anchor, bob, 'spring', stiffness=200.0), gravity=(0, 0, -9.81))
    >>> scene.check()
    """

    kind: ClassVar[str] = "spring"

    _: KW_ONLY
    stiffness: float
    length: float | None = None
