"""Elastic connections of two points with triads."""
from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Any, ClassVar

import numpy as np

from fastbeam.interface.arguments import LARGEST, Name, Refusal, checked, constant, numbers, shown
from fastbeam.interface.errors import SceneError
from fastbeam.scene.bodies import Node, PointMass
from fastbeam.scene.checks import Array, ArrayField, FilledArray, as_rotation, fill, noun, symmetry
from fastbeam.scene.links import Link

# entries that couple forces and rotations, relative to those on the diagonal, that are round-off
COUPLED = 1e-12


@dataclass(frozen=True)
class Matrix:
    """Check of six numbers >= 0, or a symmetric matrix (6, 6) without negative eigenvalues; as a matrix."""

    what: str

    def __call__(self, value: Any) -> Array:
        found = numbers(value)
        if found is None or found.shape not in ((6,), (6, 6)) or not np.all(np.abs(found) <= LARGEST):
            raise Refusal(f"must be six finite numbers >= 0, or a {self.what} matrix (6, 6), got {shown(value)}")
        if found.ndim == 1:
            if np.any(found < 0.0):
                raise Refusal(f"must be six numbers >= 0 (three along the axes, three about them), got {shown(value)}")
            return constant(np.diag(found))
        _, skew, least = symmetry(found)
        if skew > 1e-9:
            raise Refusal(f"must be symmetric, the matrix differs from its transpose by {skew:.3g} of its diagonal; use a "
                          "ForceElement for a bearing with cross coupling, which has no energy")
        if least < -1e-12:
            raise Refusal(f"must not have negative eigenvalues, the smallest is {least:.3g} (after scaling to a unit diagonal)")
        return constant(0.5 * (found + found.T))


@checked(a=Node(fixed=True), b=Node(fixed=True), name=Name("a bushing has two sides, write one for every pair"),
         stiffness=Matrix("stiffness"), damping=Matrix("damping"), directors=as_rotation)
@noun
class Bushing(Link):
    """Elastic connection without mass of two points with triads, in displacement and rotation: a bushing, an elastic support.

    It is free of forces at t = 0. For small motions force and moment on b's side are `stiffness` times the displacement of the
    point of b and the rotation of its triad, both seen in the axes that a carries. Where they are large, displacements count in
    full and a rotation by an angle about one axis gives the moment stiffness times its sine (theory.md (4.21)): its largest at
    90 degrees, zero at 180. `result.bushing(name)` has displacement, rotation, force, moment, energy and loss.

    Parameters
    ----------
    a, b : NodeRef or RigidBody
        Nodes of beams, points of bodies; one may be `GROUND.point((x, y, z))`.
    name : str, optional
    stiffness : array_like (6,) or (6, 6)
        Along the three axes, N/m, and about them, N m/rad, each >= 0; or the symmetric matrix of all, without negative
        eigenvalues.
    damping : array_like (6,) or (6, 6), optional
        Along the axes, N s/m, and about them, N m s/rad, in the same way; a matrix does not couple one with the other. Steps of
        order 2 alone.
    directors : array_like (3, 3), optional
        The axes as rows, directions in space at t = 0; default: x, y, z.

    Raises
    ------
    SceneError
        A side is no node or body or has no rotation, both are the same, a number is out of range, a matrix is not symmetric, has
        a negative eigenvalue or couples forces with rotations in damping.

    Examples
    --------
    >>> from fastbeam.scene import GROUND, Bushing, RigidBody, Scene
    >>> engine = RigidBody('engine', mass=150.0, inertia=(8, 10, 9), position=(0, 0, 0.5))
    >>> feet = [(0.4, 0.3, -0.2), (0.4, -0.3, -0.2), (-0.4, 0.3, -0.2), (-0.4, -0.3, -0.2)]
    >>> mounts = [Bushing(GROUND.point((x, y, 0.3)), engine.point((x, y, z)), stiffness=(2e5, 2e5, 3e5, 50, 50, 50),
    ...                   damping=(400, 400, 600, 0.1, 0.1, 0.1)) for x, y, z in feet]
    >>> Scene(engine, *mounts, gravity=(0, 0, -9.81)).check()
    """

    kind: ClassVar[str] = "bushing"

    _: KW_ONLY
    stiffness: ArrayField
    damping: FilledArray = None
    directors: FilledArray = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for side in (self.a, self.b):
            if isinstance(side.owner, PointMass):
                raise SceneError(f"{self.label}: {side.owner.label} has no rotation; join a RigidBody, a point of one or a node "
                                 "of a beam, or use a Spring")
        damping = np.zeros((6, 6)) if self.damping is None else self.damping
        size = np.sqrt(np.maximum(np.diag(damping), 0.0))
        if np.any(np.abs(damping[:3, 3:]) > COUPLED * np.outer(size[:3], size[3:])):
            raise SceneError(f"{self.label}: damping couples forces with rotations (rows 1 to 3 with columns 4 to 6); set these "
                             "entries to 0")
        fill(self, damping=constant(damping), directors=constant(np.eye(3)) if self.directors is None else self.directors)

    @property
    def is_damped(self) -> bool:
        """True if it dissipates energy."""
        return bool(np.any(self.damping))
