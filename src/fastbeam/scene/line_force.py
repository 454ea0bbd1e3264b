"""A force between two points by a function of the user's own."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from fastbeam.interface.arguments import Function, Name, Numbers, checked
from fastbeam.interface.errors import SceneError
from fastbeam.scene import checks
from fastbeam.scene.bodies import Node
from fastbeam.scene.links import Link

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


@checked(a=Node(fixed=True), b=Node(fixed=True), name=Name("a force has two ends, write one for every pair"),
         law=Function("(t, length, rate, parameters)"), parameters=Numbers((None,), "a list of numbers for the law"),
         derivative=Function("(t, length, rate, parameters)"))
@dataclass(frozen=True, eq=False)
class LineForce(Link):
    """Force along the line of two points by a function that is compiled into the step: actuators, buffers, muscles.

    The law is a plain Python function that numba can compile, called as

        law(t, length, rate, parameters) -> tension

    with the time in the middle of a step (s), the mean of the lengths at both of its ends (m) and their difference over the step
    (m/s). Tension (N) pulls both points together with the same force, so that momenta stay. Linear springs and dampers come out
    as `Spring` and `Damper` to round-off (theory.md (4.29)). What it takes from the energy, elastic or not, is
    `work taken by ...` in `Result.balance`. In space and in a plane, with conserving steps, of order 4 by two runs; in statics,
    also in `solve_path`, the rate is 0, and it acts in full at every load factor, as springs do.

    Parameters
    ----------
    a, b : NodeRef, RigidBody or PointMass
        Its ends; one may be `GROUND.point((x, y, z))`. They do not meet.
    name : str, optional
    law : callable
    parameters : array_like [n]
        Numbers for the law. Another law or other numbers compile no other part of the step again.
    derivative : callable, optional
        The derivative of the law, called as the law; it returns how the tension changes with length (N/m) and rate (N s/m).
        Default: by differences. It is compared with them at the start.

    Raises
    ------
    SceneError
        An end is no node, body or mass, both ends are the same, or there is no law.

    Examples
    --------
    >>> from fastbeam.scene import GROUND, LineForce, PointMass, Scene
    >>> def buffer(t, length, rate, parameters):
    ...     return -parameters[0] * max(parameters[1] - length, 0.0)**1.5 * (1.0 - parameters[2] * rate)
    >>> ball = PointMass('ball', mass=0.2, position=(0, 0, 1))
    >>> pad = LineForce(GROUND.point((0, 0, 0)), ball, 'pad', law=buffer, parameters=(5e4, 0.1, 0.2))
    >>> Scene(ball, pad, gravity=(0, 0, -9.81)).check()
    """

    kind: ClassVar[str] = "line force"
    is_damped: ClassVar[bool] = True
    takes: ClassVar[str] = "work taken by"

    _: KW_ONLY
    law: Callable[..., float] | None = None
    parameters: ArrayLike = ()
    derivative: Callable[..., tuple[float, float]] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        checks.fill(self, parameters=np.array(self.parameters, dtype=float))
        if self.law is None:
            raise SceneError(f"{self.label}: law= is missing, a function (t, length, rate, parameters) that returns the tension")
