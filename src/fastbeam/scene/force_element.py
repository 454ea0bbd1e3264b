"""A force and a moment between two triads by a function of the user's own."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from fastbeam.interface.arguments import Function, Name, Numbers, checked, constant
from fastbeam.interface.errors import SceneError
from fastbeam.scene import checks
from fastbeam.scene.bodies import Node, PointMass
from fastbeam.scene.checks import FilledArray, as_rotation
from fastbeam.scene.links import Link

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

SIGNATURE = "(t, position, rotation, velocity, spin, parameters, force, moment)"
DERIVATIVE = "(t, position, rotation, velocity, spin, parameters, out)"


@checked(a=Node(fixed=True), b=Node(fixed=True), name=Name("a force element has two ends, write one for every pair"),
         law=Function(SIGNATURE), parameters=Numbers((None,), "a list of numbers for the law"), directors=as_rotation,
         derivative=Function(DERIVATIVE))
@dataclass(frozen=True, eq=False)
class ForceElement(Link):
    """Force and moment between two points with triads by a function that is compiled into the step: tyres, mounts, couplings.

    The law is a plain Python function that numba can compile, called as

        law(t, position, rotation, velocity, spin, parameters, force, moment)

    with the time in the middle of a step (s) and, all in the axes that `a` carries, means of both ends of the step of the
    position of b as seen from a [3] (m) and of the matrix of its rotation [3, 3] (columns: the axes that b carries, equal to
    those of a at t = 0), the rate of that position [3] (m/s) and the relative spin [3] (rad/s), as somebody on a sees them.
    It writes force[:] (N) and moment[:] (N m) on b, in the same axes, both 0 when it is called. At the point of b the
    opposite acts on a, so that both momenta stay (theory.md (4.33)). What it takes from the energy, elastic or not, is
    `work taken by ...` in `Result.balance`. In space, with conserving steps, of order 4 by two runs; in statics, also in
    `solve_path`, velocity and spin are 0, and it acts in full at every load factor, as springs do.

    Parameters
    ----------
    a, b : NodeRef or RigidBody
        Nodes of beams, points of bodies; one may be `GROUND.point((x, y, z))`.
    name : str, optional
    law : callable
    parameters : array_like [n]
        Numbers for the law. Another law or other numbers compile no other part of the step again.
    directors : array_like (3, 3), optional
        The axes as rows, directions in space at t = 0; default: x, y, z.
    derivative : callable, optional
        The derivative of the law, called as `derivative(t, position, rotation, velocity, spin, parameters, out)`: it writes
        out[i, j] (6, 18), 0 when it is called, how number i of (force, moment) changes with number j of (position, rotation row
        by row, velocity, spin), each for itself. Default: by differences. It is compared with them at the start.

    Raises
    ------
    SceneError
        A side is no node or body or has no rotation, both are the same, or there is no law.

    Examples
    --------
    >>> from fastbeam.scene import GROUND, ForceElement, RigidBody, Scene
    >>> def mount(t, position, rotation, velocity, spin, parameters, force, moment):
    ...     force[:] = -parameters[0] * (1.0 + parameters[1] * position[2]**2) * position - parameters[2] * velocity
    >>> engine = RigidBody('engine', mass=150.0, inertia=(8, 10, 9), position=(0, 0, 0))
    >>> rubber = ForceElement(GROUND.point((0, 0, 0)), engine.center, 'rubber', law=mount, parameters=(2e5, 1e3, 400.0))
    >>> Scene(engine, rubber).check()
    """

    kind: ClassVar[str] = "force element"
    is_damped: ClassVar[bool] = True
    takes: ClassVar[str] = "work taken by"

    _: KW_ONLY
    law: Callable[..., None] | None = None
    parameters: ArrayLike = ()
    directors: FilledArray = None
    derivative: Callable[..., None] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        checks.fill(self, parameters=np.array(self.parameters, dtype=float),
                    directors=constant(np.eye(3)) if self.directors is None else self.directors)
        if self.law is None:
            raise SceneError(f"{self.label}: law= is missing, a function {SIGNATURE} that writes force and moment on b")
        for side in (self.a, self.b):
            if isinstance(side.owner, PointMass):
                raise SceneError(f"{self.label}: {side.owner.label} has no rotation; join a RigidBody, a point of one or a node "
                                 "of a beam, or use a LineForce")
