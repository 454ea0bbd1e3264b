"""Drag of beams, nets, bodies and masses in air."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY
from typing import Any, ClassVar

import numpy as np

from fastbeam.interface.arguments import Function, Name, Number, Numbers, Refusal, checked, shown
from fastbeam.interface.errors import SceneError
from fastbeam.scene.beams import Beam, NodeRef
from fastbeam.scene.bodies import FACTOR, ZERO, PointMass, RigidBody, TimeFactor, as_steady
from fastbeam.scene.checks import ArrayField, Named, fill, noun
from fastbeam.scene.nets import Net

NOT_NEGATIVE = Number(least=0.0)


def as_in_air(value: Any) -> Any:
    """Check of a Beam, Net, RigidBody or PointMass."""
    if isinstance(value, NodeRef):
        raise Refusal(f"must be a Beam, Net, RigidBody or PointMass, got {value}; give {value.owner.label} itself")
    if not isinstance(value, (Beam, Net, RigidBody, PointMass)):
        raise Refusal(f"must be a Beam, Net, RigidBody or PointMass, got {shown(value)}")
    return value


@checked(name=Name(), on=as_in_air, normal=NOT_NEGATIVE, tangential=NOT_NEGATIVE, linear=NOT_NEGATIVE, air=as_steady,
         time=FACTOR, wind=Function("(t, position, parameters, velocity)"),
         parameters=Numbers((None,), "a list of numbers for the wind"))
@noun
class Drag(Named):
    """Force against the velocity relative to the air (theory.md (4.12)); its loss is in `result.balance()`. In statics moving
    air is a load, which grows with the load factor.

    On beams and nets the coefficients are those of a length, and velocities are split along d1 and across it; on bodies and
    masses the force acts at the centre and has no direction of its own, so there is no `tangential`. `linear` alone, alpha x
    rhoA or alpha x mass, is damping proportional to mass.

    Parameters
    ----------
    name : str
    on : Beam, Net, RigidBody, PointMass
    normal, tangential : float
        Force over the square of the velocity across and along the beam, N s^2/m^3, of a body N s^2/m^2; >= 0. Of a round wire of
        diameter d normal is about 0.6 rho d, rho the density of the air: half of 1.2 rho d.
    linear : float
        Force over velocity, N s/m^2, of a body N s/m; >= 0.
    air : array_like (3,)
        Velocity of the air, m/s.
    time : callable, optional
        t -> factor of that velocity: gusts, tides. Its mean over a step counts.
    wind : callable, optional
        Instead of `air` a function that varies in place and time, `wind(t, position, parameters, velocity)`, compiled into the
        step: from the time in the middle of the step (s) and the mean of both ends of the position [3] (m) it writes
        velocity[:] (m/s), 0 when it is called. Such scenes run in space.
    parameters : array_like [n]
        Numbers for `wind`. Another function or other numbers compile no other part of the step again.

    Raises
    ------
    SceneError
        A coefficient is negative, all are zero, a body has a tangential one, `time` is given for still air, or `wind`
        with `air`.
    """

    kind: ClassVar[str] = "drag"

    name: str
    on: Beam | Net | RigidBody | PointMass
    _: KW_ONLY
    normal: float = 0.0
    tangential: float = 0.0
    linear: float = 0.0
    air: ArrayField = ZERO
    time: TimeFactor | None = None
    wind: Callable[..., None] | None = None
    parameters: ArrayField = ()

    def __post_init__(self) -> None:
        if self.normal == self.tangential == self.linear == 0.0:
            raise SceneError(f"{self.label}: give normal, tangential or linear")
        fill(self, parameters=np.array(self.parameters, dtype=float))
        if self.wind is not None and (np.any(self.air) or self.time is not None):
            raise SceneError(f"{self.label}: wind is the velocity of the air in place and time already; leave air and time out")
        if self.wind is None and self.parameters.size:
            raise SceneError(f"{self.label}: parameters are numbers for wind; give wind, or leave parameters out")
        if self.time is not None and not np.any(self.air):
            raise SceneError(f"{self.label}: time is a factor of air, which is 0; give air, the velocity where the factor is 1")
        if self.tangential > 0.0 and not self.is_slender:
            raise SceneError(f"{self.label}: {self.on.label} has no direction; give normal, which then is its whole drag "
                             "coefficient")

    @property
    def blows(self) -> bool:
        """True if the air moves, so that there is a force at rest."""
        return self.wind is not None or bool(np.any(self.air))

    @property
    def is_slender(self) -> bool:
        """True if velocities are split by the direction of a beam."""
        return isinstance(self.on, (Beam, Net))
