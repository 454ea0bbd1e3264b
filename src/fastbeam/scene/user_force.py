"""Forces by a function of the user's own."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY
from typing import Any, ClassVar

import numpy as np

from fastbeam.interface.arguments import Flag, Function, Name, Numbers, Refusal, checked, shown, take
from fastbeam.interface.errors import SceneError
from fastbeam.scene import checks
from fastbeam.scene.beams import Beam, NodeRef
from fastbeam.scene.bodies import Node
from fastbeam.scene.checks import FieldField, NodeLike, Takes, noun, tried

Array = np.ndarray
SIGNATURE = "(t, position, directors, velocity, spin, parameters, force, moment)"
DERIVATIVE = "(t, position, directors, velocity, spin, parameters, out)"


def as_node_or_beam(value: Any) -> NodeRef | Beam:
    """Check of a node, body, point of one or mass; or a whole beam."""
    return value if isinstance(value, Beam) else Node()(value)


def as_function_of_place(value: Any) -> Any:
    """Check of a list of numbers, or a function s[n] -> [n, m]."""
    if callable(value) and not isinstance(value, type):
        return value
    return Numbers((None,), "a list of numbers for the law, or along a beam a function of s[n] that returns [n, m]")(value)


@checked(name=Name(), at=as_node_or_beam, law=Function(SIGNATURE), parameters=as_function_of_place,
         dissipates=Flag(), derivative=Function(DERIVATIVE), grows=Flag())
@noun
class UserForce:
    """Force and moment on a node or body, or per length along a beam, by a function that is compiled into the step.

    The law is a plain Python function that numba can compile, called as

        law(t, position, directors, velocity, spin, parameters, force, moment)

    with the time in the middle of a step (s), means of both ends of the step of position [3] (m) and directors [3, 3] (rows d1,
    d2, d3), mean velocity [3] (m/s) and spin [3] (rad/s), and `parameters`. It writes force[:] (N, along a beam N/m) and
    moment[:] (N m, N m/m), both 0 when it is called, and returns nothing. Its work is among the loads of
    `Result.balance`. Scenes with such forces run in space, with the conserving step.

    Parameters
    ----------
    name : str
    at : NodeRef, RigidBody, PointMass or Beam
        A whole beam has Lagrange elements; the law is evaluated at its nodes, which are the points of a Gauss-Lobatto quadrature.
    law : callable
    parameters : array_like [m], or callable
        Numbers for the law. Another law or other numbers compile no other part of the step again. Along a beam also a function
        of arc lengths, s[n] -> [n, m]: at each node the law is given those of its place, as in `lambda s: np.c_[s, 2.0 + s]`.
    dissipates : bool
        False for a law of time, position and directors alone, with which order 4 takes one run instead of two.
    derivative : callable, optional
        The derivative of the law, called as `derivative(t, position, directors, velocity, spin, parameters, out)`: it writes
        out[i, j] (6, 18), 0 when it is called, how number i of (force, moment) changes with number j of (position, directors
        row by row, velocity, spin), each for itself. Default: by differences. It is compared with them at the start.

    grows : bool
        Whether it is a load, which grows with the load factor of `solve_static` and `solve_path`. False (default): it acts in
        full from the start, as springs do: foundations, contact, magnets.

    Raises
    ------
    SceneError
        A value of the wrong kind, or a beam with B-splines.

    Examples
    --------
    >>> import numpy as np
    >>> from fastbeam.scene import PointMass, Scene, UserForce
    >>> def drag(t, position, directors, velocity, spin, parameters, force, moment):
    ...     speed = np.sqrt(velocity[0]**2 + velocity[1]**2 + velocity[2]**2)
    ...     force[:] = -parameters[0] * speed * velocity
    >>> ball = PointMass('ball', mass=0.2, position=(0, 0, 0), velocity=(20, 0, 5))
    >>> Scene(ball, UserForce('drag', ball, drag, parameters=(0.004,)), gravity=(0, 0, -9.81)).check()
    """

    kind: ClassVar[str] = "user force"

    name: str
    at: Takes[NodeLike | Beam, NodeRef | Beam]
    law: Callable[..., None]
    _: KW_ONLY
    parameters: FieldField = ()
    dissipates: bool = True
    derivative: Callable[..., None] | None = None
    grows: bool = False

    def __post_init__(self) -> None:
        who = checks.label(self.kind, self.name)
        if isinstance(self.at, Beam) and self.at.interpolation != "lagrange":
            raise SceneError(f"{who}: {self.at.label} has B-splines, whose nodes do not lie on the beam; use "
                             "interpolation='lagrange', or a force on its start or end")
        given: Any = self.parameters
        if callable(given):
            if not isinstance(self.at, Beam):
                raise SceneError(f"{who}: parameters may be a function of s along a beam only; on {self.at.label} give numbers")
            numbers_of_nodes(self)
        else:
            checks.fill(self, parameters=np.array(given, dtype=float))


def numbers_of_nodes(force: UserForce) -> Array:
    """Return parameters of the nodes that a force acts on, [n, m]; one row where they are equal. Raises SceneError: the function
    fails, or returns something else."""
    given: Any = force.parameters
    if not callable(given):
        return np.array(given)[None]
    assert isinstance(force.at, Beam)
    s, who = np.array(force.at.node_s), f"{checks.label(force.kind, force.name)}: parameters(s)"
    try:
        found = tried(given, f"at s = {shown(s)}", s)
    except Refusal as refusal:
        raise SceneError(f"{who} {refusal}") from refusal.__cause__
    return np.array(take(Numbers((s.size, None), f"finite numbers of shape [n, m] (here [{s.size}, m])"), who, found))
