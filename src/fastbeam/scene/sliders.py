"""Sliders: points that stay on beams and paths."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from fastbeam.interface.arguments import Name, Number, Word, checked
from fastbeam.interface.errors import SceneError
from fastbeam.scene import checks
from fastbeam.scene.beams import Beam
from fastbeam.scene.bodies import Node, PointMass
from fastbeam.scene.checks import Array, NodeField, Takes, noun
from fastbeam.scene.interpolation.basis import CurveBasis
from fastbeam.scene.locks import Lock, OneSided, Release, as_locks, as_one_sided, as_release, check_locks, check_release
from fastbeam.scene.paths import Path, as_track, legs_of
from fastbeam.scene.slider_forces import Drive, Friction, Stops, as_drive, as_friction, as_stops, initial_rate
from fastbeam.scene.switches import Switch, check_places, span_of

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

CURVES = ("own", "c1")


@checked(name=Name(), point=Node(), beam=as_track, on=as_track, at=Number(), rate=Number(), curve=Word(CURVES),
         friction=as_friction, drive=as_drive, stops=as_stops, lock=as_locks, release=as_release, one_sided=as_one_sided)
@noun
class Slider:
    """Point that slides along a beam, or a path of several (theory.md 5), without friction by default.

    Parameters
    ----------
    name : str
    point : PointMass, RigidBody or NodeRef
        Sliding point: a mass, a body or a point of it, or a node of another beam.
    beam : Beam or Path
        Beam or path on which it slides; `on=` is the same.
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
        Elastic or rigid stops.
    lock : Lock or list of Lock, optional
        When it is locked where it is; several act one after the other, as in [Lock(until=1.0), Lock("end")].
    release : Release, optional
        When it leaves the beam.
    one_sided : array_like (3,) or OneSided, optional
        Direction in which it may lift off the beam: contact that pushes only. Then the point may begin away from the beam.

    Raises
    ------
    SceneError
        An argument is of the wrong kind or not finite. `Scene.check` tests the position.
    """

    kind: ClassVar[str] = "slider"

    name: str
    point: NodeField
    beam: Takes[Beam | Path | None, Beam | Path] = None
    _: KW_ONLY
    on: Takes[Beam | Path | None, Beam | Path] = None
    at: float
    rate: float | None = None
    curve: str = "c1"
    friction: Takes[Friction | float | None, Friction | None] = None
    drive: Drive | None = None
    stops: Stops | None = None
    lock: Takes[Lock | Sequence[Lock] | None, tuple[Lock, ...] | None] = None
    release: Release | None = None
    one_sided: Takes[OneSided | ArrayLike | None, OneSided | None] = None

    def __post_init__(self) -> None:
        who = checks.label(self.kind, self.name)
        # `dataclasses.replace` passes both names of the beam
        if (self.beam is None) == (self.on is None) and (self.beam is None or self.beam is not self.on):
            raise SceneError(f"{who}: needs exactly one curve to slide on, a Beam or a Path, as in Slider(name, point, beam, "
                             "at=s) or Slider(name, point, on=path, at=s)")
        beam, at = self.on if self.beam is None else self.beam, self.at
        checks.fill(self, beam=beam, on=beam)
        # places beyond an end by round-off are moved to the end
        if isinstance(beam, Switch):
            at = self._on_a_track(who, beam, at)
        elif not self.is_endless and -1e-9 * beam.length <= at <= (1.0 + 1e-9) * beam.length:
            at = min(max(at, 0.0), beam.length)
        checks.fill(self, at=at)
        self._check_forces(who)

    @property
    def beams(self) -> tuple[Beam, ...]:
        """Beams that it slides on."""
        return legs_of(self.beam)[0]

    @property
    def is_endless(self) -> bool:
        """True if it runs on a closed path."""
        return isinstance(self.beam, Path) and self.beam.closed

    @property
    def contact_curve(self) -> CurveBasis:
        """Contact curve of the point."""
        return self.beam.basis.curve(self.curve)

    @property
    def slides_freely(self) -> bool:
        """True if no friction, drive, stop, lock, release or switch acts on it."""
        forces = (self.friction, self.drive, self.stops, self.lock, self.release, self.one_sided)
        return all(x is None for x in forces) and not isinstance(self.beam, Switch)

    @property
    def starts_off(self) -> bool:
        """True if its point is away from the beam at t = 0, on its side of it."""
        if self.one_sided is None:
            return False
        if isinstance(self.point.owner, PointMass) and self.point.owner.position is None:
            return False
        side = self.one_sided.side / np.linalg.norm(self.one_sided.side)
        return bool((self.point.place - self.place) @ side > 1e-9 * self.beam.length)

    @property
    def place(self) -> Array:
        """Position of the point at t = 0, (3,) m."""
        return self.beam.reference(self.at)[0][0]

    def _on_a_track(self, who: str, switch: Switch, at: float) -> float:
        begin, end = switch.spans[span_of(switch, at)]
        if not begin - 1e-9 * switch.length <= at <= end + 1e-9 * switch.length:
            tracks = ", ".join(f"{x.name!r} {a:.6g} to {b:.6g} m" for x, (a, b) in zip(switch.tracks, switch.spans))
            raise SceneError(f"{who}: at={at:.6g} m lies on none of the tracks of {switch.label} ({tracks}); use "
                             "at=switch.offset(track) + s")
        if self.one_sided is not None:
            raise SceneError(f"{who}: one_sided cannot be combined with {switch.label}, on which arc lengths start anew with "
                             "every track; leave it out, or slide on a Path")
        at = float(min(max(at, begin), end))
        check_places(who, switch, at, self.stops, self.lock or (), self.release)
        return at

    def _check_forces(self, who: str) -> None:
        """Check that forces along the beam fit each other and the beam; a prescribed motion is that of the start."""
        stops, drive = self.stops, self.drive
        on_switch = isinstance(self.beam, Switch)
        low, high = (-np.inf, np.inf) if self.is_endless or on_switch else (0.0, self.beam.length)
        places = [(f"stops: {x}", getattr(stops, x, None)) for x in ("start", "end")]
        places += [("lock: at", x.at) for x in self.lock or ()]
        for what, place in places:
            if isinstance(place, tuple) and not on_switch:
                raise SceneError(f"{who}: {what}={place} is a place on a track of a Switch, but it slides on {self.beam.label}; "
                                 "give an arc length, m")
        if stops is not None and not on_switch:
            for what, end in (("start", stops.start), ("end", stops.end)):
                if end is not None and not 0.0 <= end <= high:
                    raise SceneError(f"{who}: stops: {what}={end:.6g} m lies beyond {self.beam.label} (0 to "
                                     f"{self.beam.length:.6g} m)")
            if not (low if stops.start is None else stops.start) <= self.at <= (high if stops.end is None else stops.end):
                raise SceneError(f"{who}: stops from {stops.start} to {stops.end} m must enclose its place at={self.at:.6g} m; "
                                 "start between them")
        if self.one_sided is not None:
            if self.release is not None:
                raise SceneError(f"{who}: one_sided cannot be combined with release; leave one of them out")
            if drive is not None and drive.is_prescribed and drive.position is not None:
                raise SceneError(f"{who}: its drive prescribes its place, so it cannot land at another place after it lifts off; "
                                 "give the drive speed=, or stiffness= and damping=, or leave one_sided out")
            if self.lock is not None and self.lock[0].from_start and self.starts_off:
                raise SceneError(f"{who}: it is locked from the start, but its point is not on {self.beam.label}; give the lock "
                                 "a time or a condition")
        if self.release is not None:
            check_release(who, self.release, None if on_switch else stops, self.is_endless)
        if self.lock is not None:
            check_locks(who, self.lock, stops, (low, high))
            if self.lock[0].from_start:
                if self.rate:
                    raise SceneError(f"{who}: rate={self.rate:.6g} m/s must be 0, because it is locked from the start; leave "
                                     "rate out")
                checks.fill(self, rate=0.0)
        if drive is not None and drive.is_prescribed:
            if self.lock is not None:
                raise SceneError(f"{who}: its drive prescribes the motion, so it cannot be locked; prescribe rest in the drive, "
                                 "or give it a limit with stiffness= and damping=")
            if stops is not None and stops.is_rigid:
                raise SceneError(f"{who}: its drive prescribes the motion, so a rigid stop cannot end it; give the stops a "
                                 "stiffness, or give the drive a limit with stiffness= and damping=")
            rate = initial_rate(drive, who)
            if self.rate is not None and abs(rate - self.rate) > 1e-6 * max(abs(rate), abs(self.rate)):
                raise SceneError(f"{who}: rate={self.rate:.6g} m/s, but its drive begins with {rate:.6g} m/s; leave rate out")
            checks.fill(self, rate=rate)
