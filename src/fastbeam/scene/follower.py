"""Follower loads, which turn with the part that they act on, as forces by a law of the triad."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np

from fastbeam.interface.arguments import take
from fastbeam.scene import checks
from fastbeam.scene.bodies import DistributedLoad, Load
from fastbeam.scene.user_force import UserForce


def turning(t: Any, position: Any, directors: Any, velocity: Any, spin: Any, parameters: Any, force: Any, moment: Any) -> None:
    """Form the force and the moment from their components along the directors, which are the parameters."""
    for c in range(3):
        for i in range(3):
            force[c] += parameters[i] * directors[i, c]
            moment[c] += parameters[3 + i] * directors[i, c]


def turning_slopes(t: Any, position: Any, directors: Any, velocity: Any, spin: Any, parameters: Any, out: Any) -> None:
    """Form the derivative of `turning`: of director i the columns from 3 + 3 i on."""
    for c in range(3):
        for i in range(3):
            out[c, 3 + 3 * i + c] = parameters[i]
            out[3 + c, 3 + 3 * i + c] = parameters[3 + i]


class FollowerForce(UserForce):
    """Load in the axes of the part that it acts on, times `time(t)`, which numba compiles with it."""

    kind: ClassVar[str] = "follower load"
    time: Callable[[float], float] | None

    def __init__(self, load: Load | DistributedLoad) -> None:
        at = load.at if isinstance(load, Load) else load.beam
        both = [np.zeros(3) if x is None else np.asarray(x, float) for x in (load.force, load.moment)]
        # evaluated at points of a step, not integrated over it
        checks.fill(self, time=take(checks.refuse_jumps, f"{load.kind} {load.name!r}: time of a load that follows", load.time))
        super().__init__(load.name, at, turning, parameters=np.concatenate(both), dissipates=False, derivative=turning_slopes,
                         grows=True)


def as_force(load: Load | DistributedLoad) -> FollowerForce:
    """Return the `FollowerForce` of a load, always the same object."""
    known = load.__dict__.get("_as_force")
    if known is None:
        known = FollowerForce(load)
        checks.fill(load, _as_force=known)
    return known
