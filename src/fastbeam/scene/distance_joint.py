"""A joint that keeps the distance of two points."""
from __future__ import annotations

from typing import ClassVar

from fastbeam.interface.arguments import Name, checked
from fastbeam.scene.bodies import Node
from fastbeam.scene.checks import noun
from fastbeam.scene.links import Link


@checked(a=Node(fixed=True), b=Node(fixed=True), name=Name("a distance joint has two ends, write one for every pair"))
@noun
class DistanceJoint(Link):
    """Joint that keeps the distance that two points have at t = 0, like a rigid rod without mass between two ball joints.

    Parameters
    ----------
    a, b : NodeRef, RigidBody or PointMass
        Nodes of beams, points of bodies, masses; one may be `GROUND.point((x, y, z))`.
    name : str, optional

    Raises
    ------
    SceneError
        A side is no node, body or mass, or both sides are the same. `Scene.check`: both points lie at the same place.

    Examples
    --------
    >>> from fastbeam.scene import Clamp, DistanceJoint, PointMass, Scene
    >>> anchor, bob = PointMass('anchor', mass=1.0, position=(0, 0, 0)), PointMass('bob', mass=2.0, position=(1, 0, 0))
    >>> scene = Scene(anchor, bob, Clamp(anchor), DistanceJoint(anchor, bob, 'rod'), gravity=(0, 0, -9.81))
    >>> scene.check()
    """

    kind: ClassVar[str] = "distance joint"
