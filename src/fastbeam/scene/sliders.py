"""Sliders: points that stay on beams and paths."""
from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import ClassVar

import numpy as np

from fastbeam.arguments import Name, Number, Word, checked
from fastbeam.basis import CurveBasis
from fastbeam.errors import SceneError
from fastbeam.scene import checks
from fastbeam.scene.beams import Beam
from fastbeam.scene.checks import Array, NodeField
from fastbeam.scene.parts import Node
from fastbeam.scene.paths import ATrack, Path
from fastbeam.scene.sliding import ADrive, AFriction, Drive, Friction, SomeStops, Stops, initial_rate

CURVES = ("own", "c1")


@checked(name=Name(), point=Node(), beam=ATrack(), on=ATrack(), at=Number(), rate=Number(), curve=Word(CURVES),
         friction=AFriction(), drive=ADrive(), stops=SomeStops())
@dataclass(frozen=True, eq=False)
class Slider:
    """Lets a point slide along a beam, or a path of several (theory.md 5), without friction where none is given.

    Parameters
    ----------
    name : str
    point : PointMass, RigidBody or NodeRef
        What slides: a mass, a body or a point of it, or a node of another beam.
    beam : Beam or Path
        What it slides on; `on=` is the same.
    at : float
        Arc length of the contact at t = 0, m, from 0 to the length of the beam or path; any number on a closed path.
    rate : float or None
        Initial ds/dt, m/s; also moves a point mass that has no velocity of its own.
    curve : {'c1', 'own'}
        The beam's interpolation with slope corrections that make its tangent continuous (theory.md 3.2), or its own, whose
        tangent jumps at the ends of Lagrange elements: a step of order 4 loses its order there. B-splines are smooth, both are
        the same.
    friction : float or Friction, optional
        Coefficient of Coulomb friction, or more of it.
    drive : Drive, optional
        Prescribed motion along the beam, force or controller. Where the motion is prescribed, it gives the rate, too.
    stops : Stops, optional
        Elastic stops.

    Raises
    ------
    SceneError
        An argument is of the wrong kind or not finite. `Scene.check` tests the position.
    """

    kind: ClassVar[str] = "slider"

    name: str
    point: NodeField
    beam: Beam | Path | None = None
    _: KW_ONLY
    on: Beam | Path | None = None
    at: float
    rate: float | None = None
    curve: str = "c1"
    friction: Friction | float | None = None
    drive: Drive | None = None
    stops: Stops | None = None

    def __post_init__(self) -> None:
        who = checks.label(self.kind, self.name)
        # `dataclasses.replace` gives both
        if (self.beam is None) == (self.on is None) and (self.beam is None or self.beam is not self.on):
            raise SceneError(f"{who}: give what it slides on once, a Beam or a Path, as in Slider(name, point, beam, at=s) or "
                             "Slider(name, point, on=path, at=s)")
        beam, at = self.on if self.beam is None else self.beam, self.at
        checks.fill(self, beam=beam, on=beam)
        # round-off at the ends is not worth an error
        if not self.is_endless and -1e-9 * beam.length <= at <= (1.0 + 1e-9) * beam.length:
            at = min(max(at, 0.0), beam.length)
        checks.fill(self, at=at)
        self._check_forces(who)

    @property
    def beams(self) -> tuple[Beam, ...]:
        """The beams that it slides on."""
        return self.beam.beams if isinstance(self.beam, Path) else (self.beam,)

    @property
    def is_endless(self) -> bool:
        """Whether it runs on a closed path."""
        return isinstance(self.beam, Path) and self.beam.closed

    @property
    def contact_curve(self) -> CurveBasis:
        """The curve that the point stays on."""
        return self.beam.basis.curve(self.curve)

    @property
    def place(self) -> Array:
        """Where the point has to lie at t = 0, (3,) m."""
        return self.beam.reference(self.at)[0][0]

    def _check_forces(self, who: str) -> None:
        """Forces along the beam fit each other and the beam; a prescribed motion is that of the start."""
        stops, drive = self.stops, self.drive
        if stops is not None:
            low, high = (-np.inf, np.inf) if self.is_endless else (0.0, self.beam.length)
            for what, end in (("start", stops.start), ("end", stops.end)):
                if end is not None and end > high:
                    raise SceneError(f"{who}: stops: {what}={end:.6g} m lies beyond {self.beam.label} (0 to "
                                     f"{self.beam.length:.6g} m)")
            if not (low if stops.start is None else stops.start) <= self.at <= (high if stops.end is None else stops.end):
                raise SceneError(f"{who}: stops from {stops.start} to {stops.end} m exclude its place at={self.at:.6g} m; start "
                                 "between them")
        if drive is not None and drive.is_prescribed:
            if stops is not None and stops.is_rigid:
                raise SceneError(f"{who}: its drive prescribes the motion, so a rigid stop cannot end it; give stops a "
                                 "stiffness, or the drive a limit with stiffness= and damping=")
            rate = initial_rate(drive, who)
            if self.rate is not None and abs(rate - self.rate) > 1e-6 * max(abs(rate), abs(self.rate)):
                raise SceneError(f"{who}: rate={self.rate:.6g} m/s, but its drive begins with {rate:.6g} m/s; leave rate out")
            checks.fill(self, rate=rate)
