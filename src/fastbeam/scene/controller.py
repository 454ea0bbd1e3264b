"""Controllers: user functions that read the state at given times and hold a value until the next."""
from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from fastbeam.interface.arguments import Function, Name, Names, Number, Numbers, checked
from fastbeam.scene import checks
from fastbeam.scene.beams import NodeRef
from fastbeam.scene.bodies import PointMass, RigidBody

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

SIGNATURE = "(now, memory)"


@checked(name=Name(), law=Function(SIGNATURE), period=Number(above=0.0, unit="s"), start=Number(),
         memory=Numbers((None,), "a list of numbers"), points=Names("must map names to nodes, as in points={'tip': beam.end}"))
@dataclass(frozen=True, eq=False)
class Controller(checks.Named):
    """Digital controller: it reads the state every `period` seconds and holds the value of its law until the next time.

    It is a function of time for everything that takes one: `Load(time=)`, `Drive(force=)`, `RevoluteJoint(torque=)`,
    `PrismaticJoint(force=)`, `Winch(tension=)`. Between its times nothing changes, so a run keeps its order where the period is a
    whole number of steps, which it has to be. What takes it brings it into the scene, and so does a function of time that calls
    it. Value and memory are part of the state: a run that goes on from a checkpoint is the same to the last bit. Controllers that
    act without delay and have no memory: `Drive` with stiffness and damping, or force laws of (t, s, rate), `UserForce` and
    `LineForce`.

    Parameters
    ----------
    name : str
    law : callable
        law(now, memory) -> value. `now.t` is the time, s; `now.point(name)` and `now.velocity(name)` (3,) of `points`;
        `now.slider(name)` its arc length; `now.joint(name)` angle or distance and its rate; `now.winch(name)` free length and its
        rate; `now.spring(name)` length and force. `memory` is an array that the law may change, for integrals.
    period : float
        s; the first time is the start of the run.
    start : float
        Value in statics, and value that other laws read before the first time.
    memory : array_like [n]
        Memory at the start.
    points : mapping, optional
        Names of nodes that the law reads.

    Raises
    ------
    SceneError
        A value of the wrong kind; in a run a law that fails or returns no finite number, a step that does not divide the period.

    Examples
    --------
    >>> from fastbeam.scene import Controller, Load, PointMass, Scene
    >>> cart = PointMass('cart', mass=2.0, position=(0.3, 0, 0))
    >>> def pid(now, memory):
    ...     error = -now.point('cart')[0]
    ...     memory[0] += 0.01 * error
    ...     return 80.0 * error + 30.0 * memory[0] - 20.0 * now.velocity('cart')[0]
    >>> hand = Controller('hand', pid, period=0.01, memory=(0.0,), points={'cart': cart})
    >>> Scene(cart, hand, Load('push', cart, force=(1, 0, 0), time=hand)).check()
    """

    kind: ClassVar[str] = "controller"

    name: str
    law: Callable[..., float]
    _: KW_ONLY
    period: float
    start: float = 0.0
    memory: ArrayLike = ()
    points: Mapping[str, NodeRef | RigidBody | PointMass] | None = None

    def __post_init__(self) -> None:
        checks.fill(self, memory=np.array(self.memory, dtype=float), points=dict(self.points or {}), held=[self.start])

    @property
    def size(self) -> int:
        """Number of values that a state keeps of it: its value, how often it has been called, its memory."""
        return 2 + len(self.memory)  # type: ignore[arg-type]

    def __call__(self, t: float) -> float:
        """Return the value that it holds."""
        return float(self.held[0])  # type: ignore[attr-defined]
