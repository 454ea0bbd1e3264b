"""A cylindrical joint whose angle and distance are coupled by a thread."""
from __future__ import annotations

from dataclasses import KW_ONLY
from typing import ClassVar

import numpy as np

from fastbeam.interface.arguments import Number, Vector, checked
from fastbeam.interface.errors import SceneError
from fastbeam.scene.axis_joint import JOINED, SIDE
from fastbeam.scene.checks import noun
from fastbeam.scene.compound_joints import ANGLE_AND_DISTANCE, CylindricalJoint, each_of
from fastbeam.scene.gear_coupling import JointCoordinate, Relation
from fastbeam.scene.joint_freedoms import times_of
from fastbeam.scene.slider_forces import OfTime


@checked(a=SIDE, b=SIDE, name=JOINED, axis=Vector, pitch=Number(unit="m"), torque=OfTime("N m"), force=OfTime("N"),
         angle=OfTime("rad"), distance=OfTime("m"), speed=times_of(2, ANGLE_AND_DISTANCE, "rad/s or m/s"),
         **each_of(2, ANGLE_AND_DISTANCE))
@noun
class ScrewJoint(CylindricalJoint):
    """Screw: part b goes along an axis of a by `pitch` for each turn about it, as a nut on a threaded rod (theory.md (4.36)).

    `result.joint(name)` has the angle and the distance along the axis from a to b, both zero at t = 0, and in `coupling` the
    torque and the force that the thread exerts on b, N m and N.

    Parameters
    ----------
    a, b, name, axis
        See `CylindricalJoint`; the points need not coincide.
    pitch : float
        Distance for each turn, m, not 0: > 0 for a right-hand thread, with which a turn about the axis goes along it, < 0 for a
        left-hand one.
    stiffness, damping, rest, friction : (float, float)
        See `CylindricalJoint`. Friction of one of both coordinates holds the other, too.
    torque, force, angle, distance : float or callable, optional
        See `CylindricalJoint`; give angle or distance, one of them.
    speed, drive, stops : (of the angle, of the distance), optional
        See `CylindricalJoint`; either may be None.

    Raises
    ------
    SceneError
        See `CylindricalJoint`; the pitch is 0. `Scene.check`: both coordinates are prescribed, or have friction or rigid stops.

    Examples
    --------
    >>> from fastbeam.scene import GROUND, RigidBody, Scene, ScrewJoint
    >>> nut = RigidBody('nut', mass=1.0, inertia=(0.01, 0.01, 0.01), position=(0, 0, 1.0))
    >>> scene = Scene(nut, ScrewJoint(GROUND, nut, 'thread', axis=(0, 0, 1), pitch=0.02), gravity=(0, 0, -9.81))
    >>> scene.check()
    """

    kind: ClassVar[str] = "screw joint"

    _: KW_ONLY
    pitch: float

    def _clean(self) -> None:
        super()._clean()
        if self.pitch == 0.0:
            raise SceneError(f"{self.label}: pitch must not be 0, with which nothing moves along the axis; use RevoluteJoint")

    @property
    def relation(self) -> Relation:
        """The relation between the angle and the distance."""
        return Relation(f"{self.label} (thread)", JointCoordinate(self, 0), JointCoordinate(self, 1), self.pitch / (2.0 * np.pi))
