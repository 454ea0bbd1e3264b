"""Sleeves: sliders that also fix the direction of the section."""
from __future__ import annotations

from dataclasses import KW_ONLY
from functools import cached_property
from typing import ClassVar

import numpy as np

from fastbeam.interface.arguments import Flag, Name, Number, Vector, Word, checked
from fastbeam.interface.errors import SceneError
from fastbeam.scene import checks
from fastbeam.scene.beams import Beam
from fastbeam.scene.bodies import Node, PointMass
from fastbeam.scene.checks import Array, OptionalArray, noun
from fastbeam.scene.interpolation.averaged_curves import averaged_curve
from fastbeam.scene.interpolation.basis import CurveBasis
from fastbeam.scene.locks import as_locks, as_one_sided, as_release
from fastbeam.scene.paths import as_beam
from fastbeam.scene.slider_forces import as_drive, as_friction, as_stops
from fastbeam.scene.sliders import CURVES, Slider

# shares of the length of a beam below which means over a bore are round-off
LEAST_BORE = 1e-7


@checked(name=Name(), point=Node(), beam=as_beam, on=as_beam, at=Number(), rate=Number(), curve=Word(CURVES),
         friction=as_friction, drive=as_drive, stops=as_stops, lock=as_locks, release=as_release, one_sided=as_one_sided,
         keyed=Flag(), length=Number(least=0.0, unit="m"), key_radius=Number(above=0.0, unit="m"),
         radius=Number(above=0.0, unit="m"), axis=Vector)
@noun
class Sleeve(Slider):
    """Slider that also fixes the direction of the beam's section (theory.md 5.8): a rod in a tube, a telescope, a rail.

    The holder carries the sleeve as it lies around the beam at t = 0: there is nothing to align. On a curved beam the sliding
    point is the mean over the bore, a point of the holder beside the one that is given.

    Parameters
    ----------
    name, beam, at, rate, curve, friction, drive, stops, lock
        See `Slider`. Coulomb friction is that of the contact force and of the moments, which press on the edges of the bore:
        |F_n| = |F| + 2 |M|/length (theory.md (5.11)). It needs `length`.
    point : RigidBody or NodeRef
        The holder: a body or a point of it, or a node of another beam, such as the end of a tube. One that is clamped holds the
        sleeve fixed in space.
    keyed : bool
        Whether the beam's twist is held, too; False lets it turn about its axis in the sleeve.
    length : float, optional
        Length of the bore, m: the sleeve holds the mean position and direction of the beam over it (theory.md 5.8), at least
        1e-7 of the length of the beam. The default is that of an element of the beam. 0 holds those of a single point; the force
        that drives a bent beam out of it then depends on where in an element it is, whatever the mesh.
    key_radius : float, optional
        Radius of the splines that fix the twist, m: with friction the torsion moment adds |M_1|/key_radius to |F_n|, by default
        nothing.
    radius : float, optional
        Radius at which a beam that turns in an unkeyed sleeve rubs, m, as the radius of its section: with friction
        it sticks and slips against a moment of up to coefficient x |F_n| x radius (theory.md (5.14)), beside the friction along
        the beam, each with its own limit. By default it turns without friction.
    axis : array_like (3,), optional
        Direction of the bore in the triad of the holder. It has to be that of the beam at t = 0; the default takes that.

    Raises
    ------
    SceneError
        An argument is of the wrong kind or not finite, the bore is longer than the beam or too short, the holder is a point mass,
        which has no direction, or there is friction and no length of the bore; `radius` with a twist that is held, or without
        Coulomb friction. `compile_scene` tests the axis.
    """

    kind: ClassVar[str] = "sleeve"

    _: KW_ONLY
    keyed: bool = True
    length: float | None = None
    key_radius: float | None = None
    radius: float | None = None
    axis: OptionalArray = None

    def __post_init__(self) -> None:
        super().__post_init__()
        who = checks.label(self.kind, self.name)
        if self.release is not None or self.one_sided is not None:
            raise SceneError(f"{who}: a sleeve cannot leave its beam; use a Slider for release= and one_sided=")
        if isinstance(self.point.owner, PointMass):
            raise SceneError(f"{who}: {self.point} has no rotation to constrain a section; use a RigidBody, or a Slider")
        if self.friction is not None and self.friction.coefficient > 0.0 and not self.length:
            raise SceneError(f"{who}: friction={self.friction.coefficient:.6g} needs the length of the bore, whose edges "
                             "transmit its moments (|F_n| = |F| + 2 |M|/length); give length=, m, greater than 0")
        if self.key_radius is not None and not self.keyed:
            raise SceneError(f"{who}: key_radius={self.key_radius:.6g} m needs a sleeve that fixes the twist, but keyed=False "
                             "releases it; leave one of them out")
        if self.radius is not None:
            self._check_radius(who)
        if self.length is None:
            checks.fill(self, length=self.beam.length / self.beam.basis.n_elements)
        if self.length > self.beam.length:
            raise SceneError(f"{who}: the bore, length={self.length:.6g} m, is longer than {self.beam.label}, "
                             f"{self.beam.length:.6g} m")
        if 0.0 < self.length < LEAST_BORE * self.beam.length:
            raise SceneError(f"{who}: the bore, length={self.length:.6g} m, is shorter than {LEAST_BORE:.0g} of the length of "
                             f"{self.beam.label}; give length=0 for a sleeve that acts at one point, or a longer bore")
        self._put_on_curve(who)
        if self.axis is not None and not np.linalg.norm(self.axis) > 0.0:
            raise SceneError(f"{who}: axis=(0, 0, 0) has no direction; give the direction of the bore in the directors of the "
                             "holder")

    def _check_radius(self, who: str) -> None:
        """Check that a radius comes with Coulomb friction and a sleeve that lets the beam turn."""
        friction = self.friction
        if self.keyed:
            raise SceneError(f"{who}: radius={self.radius:.6g} m is for friction of a twisting beam, but keyed=True fixes the "
                             "twist; use keyed=False, or key_radius= for splines with friction")
        if friction is None or not friction.coefficient > 0.0:
            raise SceneError(f"{who}: radius={self.radius:.6g} m needs friction; give friction=, a coefficient, or leave radius "
                             "out")
        if friction.smoothing is not None:
            raise SceneError(f"{who}: radius={self.radius:.6g} m: friction of a beam that turns in its sleeve follows Coulomb's "
                             "law without smoothing; leave out smoothing, or radius")

    @cached_property
    def place(self) -> Array:
        """Position of the holder at t = 0, (3,) m: the point of the beam, on a curved beam the mean over the bore, which is off
        the beam."""
        beam = self.beam
        first, values, _ = self.contact_curve.evaluate(self.at)
        keep = np.flatnonzero(values[0])
        near = int(first[0]) + keep
        if beam.interpolation == "lagrange":
            # nodes lie on the reference: those under the bore are enough
            nodes = beam.reference(beam.node_s[near])[0]
        else:
            nodes = beam.basis.fit_positions(beam.reference(beam.node_s)[0])[near]
        return values[0, keep] @ nodes

    def _put_on_curve(self, who: str) -> None:
        """Move a sliding point that lies on a curved beam to the mean of the beam over the bore."""
        holder, beam = self.point, self.beam
        if not 0.0 <= self.at <= beam.length:
            return
        on_beam, owner = beam.reference(self.at)[0][0], holder.owner
        here = holder.place
        tolerance = 1e-9 * (beam.length + float(np.max(np.abs(on_beam))))
        off = float(np.linalg.norm(here - self.place))
        # a body is put there also where a scene would refuse it as just off: but for round-off
        if np.linalg.norm(here - on_beam) > tolerance or off <= (tolerance if isinstance(owner, Beam) else 1e-3 * tolerance):
            return
        if isinstance(owner, Beam):
            raise SceneError(f"{who}: {beam.label} is curved at={self.at:.6g}: its mean over the bore of {self.length:.6g} m "
                             f"lies {off:.3g} m off it, but {holder} lies on the beam. Give length=0, or let a RigidBody that is "
                             "connected there be the holder of the sleeve")
        checks.fill(self, point=owner.point(holder.offset + owner.directors @ (self.place - here)))

    @property
    def section_at_start(self) -> Array | None:
        """Directors (3, 3) of the section that it fixes, by rows; None: those of the mesh, averaged over the bore."""
        return None

    @property
    def contact_curve(self) -> CurveBasis:
        """Contact curve of the holder: averaged over the bore."""
        assert self.length is not None
        return averaged_curve(self.beam.basis, self.length) if self.length > 0.0 else super().contact_curve
