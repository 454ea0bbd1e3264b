"""Dependence of the energy of a contact on its place in an element (theory.md 3.3).

A force on a beam between two nodes makes a kink, over the bending length sqrt(EI/N) of a taut beam, and a jump of shear. How well
polynomials of an element show both depends on where in it the force acts. With the compliance C of the mesh instead of the beam's
the energy -F^2 C(s)/2 is off by V(s) = -F^2 (C_mesh - C)/2, which goes up and down over every element: V' pushes along the
beam, V'' is a stiffness against motions along it. Both compliances are found here for a piece of some elements on two pins,
straight, with the tension N: C in closed form, that of the mesh with the elements and the curve of the contact.
"""
from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import Chebyshev

from fastbeam.model.mapping import shapes_at
from fastbeam.scene import Beam, NodeRef, Path, PointMass, RigidBody, Scene, Sleeve, Slider, Switch
from fastbeam.scene.interpolation.averaged_curves import averaged_curve
from fastbeam.scene.interpolation.basis import Basis, build_basis
from fastbeam.scene.paths import legs_of

Array = np.ndarray
# what has no error of the mesh at contacts
MOVING = "moving elements (with_moving_meshes), where these support the scene"
# elements on each side of the one with the contact, Lagrange and splines; places in that one; degree of the fit to these
AROUND, AROUND_SPLINE, PLACES, DEGREE = 3, 8, 17, 14
# bending lengths in the piece at least, so that no digits are lost where there is no tension
LEAST_TAUT = 0.1
# factors of the number of elements that are tried, and slope of the beam (rad) below which a force along it is negligible
FINER, LEAST_SLOPE = (2, 4, 8, 16, 32, 64), 1e-6
# errors from which on there are events: of places, as a share of the size of the scene; of the stiffness along the beam and of
# w^2; of energies relative to that of the motion along the beam; of the compliance of beams in sleeves
PLACE, STIFFNESS, ENERGY, SLEEVE = 2e-3, 0.02, 0.05, 0.02
# error of the speed along a beam whose elements move, of the largest speed; masses, of one element, below which it is looked
# at: tangents in kinks of taut beams are too rough for others
WRONG_SPEED, LIGHT = 0.02, 0.03
# the length beside a sleeve that a mean over its bore keeps from bending, of the bore: half of the mean distance of two places in
# it, both with the weights of the mean (a quadratic B-spline)
OF_BORE = 239.0 / 2520.0
# bores of more elements are as good as exact
MOST_BORE = 4.0
# sliders that are looked at, those with the largest forces; looks in a run, the least slope (rad) and way (of the beam) there
MOST, MOST_LOOKS, LEAST_SLOPE_IN_TIME, LEAST_TRAVEL, MOST_EVENTS = 20, 8, 1e-4, 1e-4, 5
# number of checks from which on costly ones are made only once in as many
SELDOM = 10


# distance of a curve that rounds a kink from the axis, of the size of the scene
ROUNDED = 5e-4
# blows at kinks next to the usual force; how much a force changes from one step to the next; rows in which they are looked for
# behind one; distance of the tangents on both sides, of the length; kinks of a track at most
BLOW, JUMP, ROWS_BEHIND, NEARBY, MOST_KINKS = 2.0, 0.5, 3, 1e-6, 1000
# blow of a kink of so many rad, below which there is none
LEAST_BLOW = 1e-6


class Contact(NamedTuple):
    """A slider on its beam under a force across it."""

    slider: int
    name: str
    beam: Beam
    s: float           # arc length of the beam, m
    curve: str
    force: float       # N
    total: float       # of all contacts in the element, N
    EI: float          # in the direction of the force, N m^2
    GA: float          # N
    tension: float     # N

    @property
    def mesh(self) -> str:
        """Mesh of the beam at the contact, for messages."""
        basis, e = self.beam.basis, element_at(self.beam, self.s)
        taut = f", bending length sqrt(EI/N) = {np.sqrt(self.EI / self.tension):.2g} m" if self.tension > 0.0 else ""
        return f"{self.beam.label} (elements of {basis.element_ends[e + 1] - basis.element_ends[e]:.3g} m{taut})"


class Ripple(NamedTuple):
    """Variation of the energy of a contact over an element."""

    energy: float      # J, from the lowest to the highest
    force: float       # N, the largest along the beam
    stiffness: float   # N/m, where the contact is
    most: float        # N/m, the largest
    size: float        # m, of the element


def contacts_of(model: Any, state: Any, tension: Array) -> Iterator[Contact]:
    """Yield the contacts of a model that exert a force at a state in space; tension: of beams at all nodes [N], N, NaN where
    there is none.

    Sleeves hold means over their bore, and are left out; so are sliders on switches.
    """
    scene = getattr(model.uneliminated, "scene", None)
    if scene is None or not model.n_sliders:
        return
    # contacts that are element ends have no error of the mesh
    ends = set() if model.moving is None else set(model.moving.sliders.tolist())
    triads, found, total = state.q.reshape(-1, 4, 3)[:, 1:], [], dict[tuple[Beam, int], Array]()
    for k, slider in enumerate(scene.sliders[:model.n_sliders]):
        first = model.first_force[k]
        push = state.force[first:first + 3]
        if isinstance(slider, Sleeve) or isinstance(slider.beam, Switch) or not push.any() or k in ends:
            continue
        nodes, values = shapes_at(model, k, float(state.s[k]))
        beam, s = place_of(slider, float(state.s[k]))
        across = np.einsum("a,aic,c->i", values[0], triads[nodes], push)[1:]
        if np.isfinite(tension[nodes]).any() and np.linalg.norm(across) > 0.0:
            key = beam, element_at(beam, s)
            found.append((k, slider, beam, s, nodes, values, across, key))
            total[key] = total.get(key, 0.0) + across
    for k, slider, beam, s, nodes, values, across, key in found:
        axial = tension[nodes]
        known = np.isfinite(axial)
        force = float(np.linalg.norm(across))
        share, C = (across / force)**2, beam.section.C
        # a force along d2 bends about d3
        EI, GA = 1.0 / float(share @ (1.0 / np.diag(C)[[5, 4]])), 1.0 / float(share @ (1.0 / np.diag(C)[[1, 2]]))
        weight = np.abs(values[0]) * known
        yield Contact(k, slider.name, beam, s, slider.curve, force, float(np.linalg.norm(total[key])), EI, GA,
                      float(weight @ np.where(known, axial, 0.0) / weight.sum()))


def place_of(slider: Slider, s: float) -> tuple[Beam, float]:
    """Return the beam that a slider is on at arc length s of its curve, and the arc length on that beam, m."""
    return slider.beam.locate(s) if isinstance(slider.beam, Path) else (slider.beam, s)


def element_at(beam: Beam, s: float) -> int:
    """Return the number of the element of a beam at arc length s."""
    ends = beam.basis.element_ends
    return int(np.clip(np.searchsorted(ends, s, side="right") - 1, 0, ends.size - 2))


def ripple_of(contact: Contact, finer: int = 1) -> Ripple:
    """Compute the ripple of a contact on the mesh of its beam, or on one with `finer` times as many elements."""
    basis, e = contact.beam.basis, element_at(contact.beam, contact.s)
    around = AROUND if basis.interpolation == "lagrange" else AROUND_SPLINE
    ends = basis.element_ends[max(e - around, 0):e + around + 2]
    size = float(basis.element_ends[e + 1] - basis.element_ends[e])
    x = (contact.s - float(basis.element_ends[e])) / size
    own = min(e, around)
    shape = tuple(np.round((ends - ends[0]) / size, 9).tolist())
    if finer > 1:
        size, own, shape = size / finer, around, tuple(range(2 * around + 2))
    piece = _piece(basis.interpolation, basis.degree, shape, basis.directors, contact.curve, own)
    # lengths in elements, forces in EI/size^2
    unit = contact.EI / size**2
    GA = contact.GA / unit
    least = (LEAST_TAUT / shape[-1])**2
    N = min(max(contact.tension / unit, least), 0.5 * GA)
    error = piece.compliance(GA, N) - _exact(shape[-1], GA, N, piece.at)
    error *= -0.5 * contact.force * contact.total / unit * size
    fit = Chebyshev.fit(piece.at, error, DEGREE, domain=[shape[own], shape[own] + 1.0])
    bent = fit.deriv(2)
    return Ripple(float(np.ptp(error)), float(np.max(np.abs(fit.deriv()(piece.at)))) / size,
                  float(bent(shape[own] + np.clip(x, 0.0, 1.0))) / size**2, float(np.max(np.abs(bent(piece.at)))) / size**2, size)


def worst_of(model: Any, state: Any, tension: Array, free: Array) -> list[Contact]:
    """Return the contacts of sliders that are free, bool [S], those with the largest forces."""
    found = [contact for contact in contacts_of(model, state, tension) if free[contact.slider]]
    return sorted(found, key=lambda contact: -contact.force * contact.total)[:MOST]


def rest_events(model: Any, state: Any, tension: Array, free: Array,
                compliance: Callable[[int], Array | None]) -> list[dict[str, Any]]:
    """Return events where sliders that are free, bool [S], rest at places, or with a stiffness, of the mesh more than of the
    beam.

    `compliance(k)` are the motions [S] of all sliders by a force of 1 N along the beam on slider k, None where there are none.
    """
    contacts = [(contact, ripple_of(contact)) for contact in worst_of(model, state, tension, free)]
    contacts = [(contact, ripple) for contact, ripple in contacts if ripple.force > LEAST_SLOPE * contact.force]
    columns = [compliance(contact.slider) for contact, _ in contacts]
    if not contacts or any(x is None for x in columns):
        return []
    at = [contact.slider for contact, _ in contacts]
    soft = np.array([x[at] for x in columns if x is not None]).T
    # without the stiffness that the mesh adds
    true = np.linalg.pinv(np.linalg.pinv(soft) - np.diag([ripple.stiffness for _, ripple in contacts]))
    out = []
    for j, (contact, ripple) in enumerate(contacts):
        here = np.array([float(other.beam is contact.beam and element_at(other.beam, other.s) == element_at(
            contact.beam, contact.s)) * r.force for other, r in contacts])
        off = float(np.abs(true[j] @ here))
        share = float(abs(true[j, j] * ripple.stiffness))
        if off > PLACE * model.length or share > STIFFNESS:
            text = (f"slider {contact.name!r}: on {contact.mesh} the force along the beam depends by up to {ripple.force:.2g} N "
                    f"on its place within an element. Its equilibrium position may be off by about {off:.1g} m, and its "
                    f"stiffness along the beam, with frequencies, critical loads and derivatives, by {100.0 * share:.2g} %")
            out.append((max(off / (PLACE * model.length), share / STIFFNESS), text + _cure(contact, lambda x: max(
                x.force / ripple.force * off / (PLACE * model.length), x.most * true[j, j] / STIFFNESS) < 1.0,
                f"{MOVING}, or contacts='exact'")))
    return _told(out, 1.0)


def mode_events(model: Any, state: Any, tension: Array, slides: Array, squared: Array) -> list[dict[str, Any]]:
    """Return events where w^2 of modes, squared [n], are those of the mesh more than of the beam; slides: motions of sliders [n,
    S] in modes of modal mass 1."""
    out = []
    for contact in worst_of(model, state, tension, np.any(slides != 0.0, axis=0)):
        ripple = ripple_of(contact)
        own = np.abs(slides[:, contact.slider])**2
        with np.errstate(divide="ignore", invalid="ignore"):
            share = ripple.stiffness * own / (squared - ripple.stiffness * own)
        share[~np.isfinite(share) | (ripple.force <= LEAST_SLOPE * contact.force)] = 0.0
        k = int(np.argmax(np.abs(share)))
        if abs(share[k]) > STIFFNESS:
            true = float(squared[k] - ripple.stiffness * own[k])
            size = f"{100.0 * share[k]:+.2g} %" if abs(share[k]) < 1.0 else "more than its value"
            text = (f"slider {contact.name!r}: on {contact.mesh} its stiffness along the beam depends on its place within an "
                    f"element, which changes w^2 of mode {k} by about {size}")
            out.append((float(abs(share[k])), text + _cure(
                contact, lambda x: x.most * own[k] < STIFFNESS * abs(true), MOVING)))
    return _told(out, 0.0)


def _cure(contact: Contact, enough: Callable[[Ripple], bool], other: str) -> str:
    """Return the end of a message: how many more elements are enough, and what else helps."""
    found = next((finer for finer in FINER if enough(ripple_of(contact, finer))), None)
    if found is None:
        return f"; more elements do not help, because a jump of the shear force increases the error again: use {other}"
    return f"; use about {found} times as many elements there, or {other}"


def _told(found: Sequence[tuple[float, str]], t: float) -> list[dict[str, Any]]:
    """Form events of the worst, by size."""
    rows = sorted(found, key=lambda row: -row[0])
    more = [f"and {len(rows) - MOST_EVENTS} more sliders of this kind"] if len(rows) > MOST_EVENTS else []
    return [{"kind": "contact", "time": t, "text": text} for text in [*(text for _, text in rows[:MOST_EVENTS]), *more]]


def _mass_of_element(beam: Beam) -> float:
    """Return the mass of a mean element of a beam, kg."""
    return float(beam.section.rhoA * beam.length / beam.n_elements)


class Contacts:
    """Checks of the contacts of a model, in runs and at rest: sleeves, two sliders of one body in an element, and in runs the
    energy of sliders that moves with their elements."""

    def __init__(self, model: Any) -> None:
        self.model = model
        scene = getattr(model.uneliminated, "scene", None)
        sliders = [] if scene is None else scene.sliders[:model.n_sliders]
        # contacts that are element ends have no error that depends on their place
        ends = set() if model.moving is None else set(model.moving.sliders.tolist())
        looked_at = [(k, x) for k, x in enumerate(sliders) if k not in ends and not isinstance(x.beam, Switch)]
        self.sleeves = [(k, x) for k, x in looked_at if isinstance(x, Sleeve)][:MOST]
        points = [(k, x) for k, x in looked_at if not isinstance(x, Sleeve)]
        self.rounded = [(k, x) for k, x in points if x.curve == "c1" and x.beams[0].interpolation == "lagrange"][:MOST]
        of = dict[Any, list[tuple[int, Slider]]]()
        for k, x in points:
            of.setdefault(_owner(x), []).append((k, x))
        self.pairs = [(j, k, one, other) for some in of.values() for i, (j, one) in enumerate(some[:MOST])
                      for k, other in some[i + 1:MOST]][:5 * MOST]
        # sliders that nothing holds along their beam, with the mass that moves along it
        supported = () if scene is None else {part.at.owner for part in (*scene.clamps, *scene.pins, *scene.prescribed)}
        self.free = {k: float(owner.mass if isinstance(owner, PointMass | RigidBody) and owner not in supported
                              else x.beams[0].section.rhoA * x.beam.length)
                     for k, x in points for owner in (_owner(x),)
                     if x.lock is None and not (x.drive is not None and x.drive.is_prescribed)}
        self.friction = np.array([0.0 if x.friction is None else x.friction.coefficient for x in sliders])
        # speeds of sliders, m/s, their range of places, m, and the last row
        n = len(sliders)
        self.speed, self.least, self.largest = np.zeros(n), np.full(n, np.inf), np.full(n, -np.inf)
        self.before: tuple[float, Array] = 0.0, np.zeros(0)
        self.looks = self.count = 0
        self.sliders = sliders
        # light masses that nothing pushes along a beam whose elements move with them; at the last row time and tangents, impulses
        # along since the start, and the largest of these, N s
        self.riders = {k: float(owner.mass) for k in sorted(ends) if k < n for owner in (_owner(sliders[k]),)
                       if sliders[k].slides_freely and isinstance(owner, PointMass | RigidBody) and owner not in supported
                       and owner.mass < LIGHT * _mass_of_element(sliders[k].beam)}
        self._at = [] if model.moving is None else [model.moving.sliders.tolist().index(k) for k in self.riders]
        self._along: tuple[float, Array] | None = None
        self._impulse = self._most = np.zeros(len(self.riders))
        self.scene, self.masses = scene, {k: float(owner.mass) for k, x in points for owner in (_owner(x),)
                                          if isinstance(owner, PointMass | RigidBody)}
        self._blows: dict[str, tuple[float, float, str]] = {}
        # of sliders at the last row: the force, the usual one and of how many rows; the kink behind, and rows that are left
        self._passing: dict[int, tuple[Array, float, int, float, int]] = {}
        self._worst: dict[str, tuple[float, float, str]] = {}
        self._energy: dict[int, list[tuple[float, float, Contact]]] = {}

    @cached_property
    def _kinks(self) -> dict[int, list[float]]:
        """Arc lengths of possible kinks for sliders of masses and bodies; sliders on the same track share them."""
        one_of = {self.sliders[k].beam: self.sliders[k] for k in self.masses}
        known = {track: kinks_of(self.scene, slider) for track, slider in one_of.items()}
        return {k: known[self.sliders[k].beam] for k in self.masses if known[self.sliders[k].beam]}

    def remember(self, t: float, s: Array, h: float, state: Callable[[], Any]) -> None:
        """Keep the places [S] of a row of a run with steps of h, some of which may lie behind kinks."""
        before = self.before[1]
        if before.size and t > self.before[0]:
            np.maximum(self.speed, np.abs(s - before) / (t - self.before[0]), out=self.speed)
            if self._kinks:
                self._pass(t, s, h, state())
        np.minimum(self.least, s, out=self.least)
        np.maximum(self.largest, s, out=self.largest)
        self.before = t, s.copy()

    def _pass(self, t: float, s: Array, h: float, state: Any) -> None:
        """Note blows of sliders that have just gone over a place where kinks may be: where every step is a row, forces that jump
        from one to the next tell, else the angle of the kink."""
        before, span = self.before[1], t - self.before[0]
        for k, kinks in self._kinks.items():
            first = self.model.first_force[k]
            force = state.force[first:first + 3].copy()
            size = float(np.linalg.norm(force))
            last, usual, rows, place, left = self._passing.get(k, (force, size, 0, 0.0, 0))
            # no open one is passed twice in a row
            period = (1.0 if self.sliders[k].is_endless else 2.0) * self.sliders[k].beam.length
            passed = [at for at in kinks if np.floor((before[k] - at) / period) != np.floor((s[k] - at) / period)]
            if passed:
                place, left = passed[-1], ROWS_BEHIND
            if left and rows:
                if span < 1.5 * h:
                    # across what it runs on: stops and drives act along
                    tangents = self._tangent(k, float(s[k]), state)
                    now, then = (x - (x @ tangents) * tangents for x in (force, last))
                    blow = max(float(np.linalg.norm(now)), float(np.linalg.norm(then)))
                    blow *= float(np.linalg.norm(now - then)) > JUMP * blow
                else:
                    speed = abs(float(s[k] - before[k])) / span
                    blow = self.masses[k] * speed * self._angle(k, place, state) / h if passed else 0.0
                if blow > max(BLOW * usual, LEAST_BLOW * self.masses[k] * float(self.speed[k]) / h):
                    self._blow(t, k, place, h, blow, usual)
            if not left:
                # mean over rows without kinks
                usual, rows = (usual * rows + size) / (rows + 1), rows + 1
            self._passing[k] = force, usual, rows, place, max(left - 1, 0)

    def _tangent(self, k: int, s: float, state: Any) -> Array:
        """Return the unit tangent [3] of the curve of slider k at s."""
        nodes, values = shapes_at(self.model, k, s)
        tangent = values[1] @ state.q.reshape(-1, 4, 3)[nodes, 0]
        return np.asarray(tangent / np.linalg.norm(tangent))

    def _angle(self, k: int, place: float, state: Any) -> float:
        """Return the angle, rad, of the kink at a place of the curve of slider k."""
        track = self.sliders[k].beam
        tangents = [self._tangent(k, s, state) for s in (place - NEARBY * track.length, place + NEARBY * track.length)]
        return float(2.0 * np.arcsin(min(1.0, 0.5 * np.linalg.norm(tangents[1] - tangents[0]))))

    def _blow(self, t: float, k: int, place: float, h: float, blow: float, usual: float) -> None:
        slider = self.sliders[k]
        beam, s = place_of(slider, place)
        text = (f"slider {slider.name!r} passes s = {place:.4g} m ({beam.label}, s = {s:.4g} m) with steps of {h:.2g} s, where "
                f"its contact curve has a kink. Its force there, about {blow:.2g} N after {usual:.2g} N before, is that of an "
                "impact and grows with 1/h. Let the beam bend there: a weld instead of a hinge, a curved beam between, elements "
                "below sqrt(EI/N), and steps that resolve the time in the bend; damping= absorbs the waves")
        key = f"{slider.name} {place:.6g}"
        if blow > self._blows.get(key, (0.0, 0.0, ""))[0]:
            self._blows[key] = blow, t, text

    def look(self, t: float, state: Any, tension: Callable[[Array], Array], moves: bool) -> None:
        """Check the contacts of a state in space; moves: state of a run, in which the check of energies is due, too."""
        self.count += 1
        if self.count < SELDOM or self.count % SELDOM == 0:
            for k, sleeve in self.sleeves:
                self._sleeve(t, state, k, sleeve)
            for j, k, one, other in self.pairs:
                self._pair(t, state, j, k, one, other)
            self._roundings(t, state)
        if moves and self.free and self.looks < MOST_LOOKS:
            self.looks += 1
            free = np.zeros(self.model.n_sliders, bool)
            free[list(self.free)] = True
            for contact in worst_of(self.model, state, tension(state.q), free):
                ripple = ripple_of(contact)
                weight = max(self.friction[contact.slider], LEAST_SLOPE_IN_TIME) * contact.force
                energy = ripple.energy if ripple.force > weight else 0.0
                self._energy.setdefault(contact.slider, []).append((energy, t, contact))

    def push(self, t: float, core: Any, state: Any) -> None:
        """Add up the forces along the beam on masses that ride on moving elements, which are errors of mesh and step.
        core, state: the model in its plane, or in space, and its state in a row of a run."""
        tangents = core.moving.tangents_at_ends(state.q.reshape(core.n_nodes, -1, core.dim), state.s)[self._at]
        force = state.force[:core.dim * core.n_sliders].reshape(-1, core.dim)[list(self.riders)]
        if self._along is not None:
            # forces are means over the last step; beside ends of beams, where contacts are inside elements, tangents are NaN
            before, mean = self._along[0], 0.5 * (self._along[1] + tangents)
            along = np.nan_to_num(np.sum(force * mean, axis=1) / np.linalg.norm(mean, axis=1))
            self._impulse = self._impulse + (t - before) * along
            self._most = np.maximum(self._most, np.abs(self._impulse))
        self._along = t, tangents

    def events(self) -> list[dict[str, Any]]:
        """Return events of the worst."""
        blows = sorted(self._blows.values(), key=lambda row: -row[0])[:MOST_EVENTS]
        found = [(size, t, text) for size, t, text in self._worst.values()]
        for k, rows in self._energy.items():
            moving = 0.5 * self.free[k] * float(self.speed[k])**2
            energy, t, contact = max(rows, key=lambda row: row[0])
            energy = float(np.mean([row[0] for row in rows]))
            # what is held some other way does not move
            if energy > ENERGY * moving and self.largest[k] - self.least[k] > LEAST_TRAVEL * contact.beam.length:
                text = (f"slider {contact.name!r}: on {contact.mesh} its energy varies by {energy:.2g} J within every element, "
                        f"but its kinetic energy along the beam is at most {moving:.2g} J. The place where it stops, and its "
                        "vibration there, depend on the mesh")
                enough = max(ENERGY * moving, 1e-300)
                other = MOVING
                found.append((energy / enough, t, text + _cure(contact, lambda x: x.energy < enough, other)))
        for (k, mass), impulse in zip(self.riders.items(), self._most.tolist()):
            speed, error = float(self.speed[k]), impulse / mass
            if error > WRONG_SPEED * speed and self.largest[k] - self.least[k] > LEAST_TRAVEL * self.sliders[k].beam.length:
                found.append((error / (WRONG_SPEED * max(speed, 1e-300)), self.before[0], (
                    f"slider {self.sliders[k].name!r}: errors of its moving elements change the speed of {mass:.3g} kg along the "
                    f"beam by up to {error:.2g} m/s of {speed:.2g} m/s, because it is so light. Use smaller steps, or "
                    "compile the scene without moving elements")))
        return [*({"kind": "unresolved", "time": t, "text": text, "blow": size} for size, t, text in blows),
                *self._in_order(found)]

    @staticmethod
    def _in_order(found: list[tuple[float, float, str]]) -> list[dict[str, Any]]:
        return [{**event, "time": t} for (_, t, _), event in zip(sorted(found, key=lambda x: -x[0]), _told(
            [(size, text) for size, _, text in found], 0.0))]

    def _note(self, name: str, size: float, t: float, text: str) -> None:
        if size > self._worst.get(name, (0.0, 0.0, ""))[0]:
            self._worst[name] = size, t, text

    def _sleeve(self, t: float, state: Any, k: int, sleeve: Any) -> None:
        """Note the length that is free beside a sleeve, which its bore and its place in an element make uncertain."""
        beam, s = place_of(sleeve, float(state.s[k]))
        ends, e = beam.basis.element_ends, element_at(beam, s)
        size = float(ends[e + 1] - ends[e])
        a = self.model.first_force
        force = state.force[a[k]:a[k] + 3]
        (row,) = self.model.sleeve_pairs[self.model.sleeve_pairs[:, 0] == k, 1]
        moment = state.force[a[row]:a[row] + 3]
        # the arm of the force there, or the shorter part of the beam
        sides = [part for part in (s, beam.length - s) if part > 0.5 * size]
        if force.any() and np.linalg.norm(moment) > 1e-3 * size * np.linalg.norm(force):
            arm = float(np.linalg.norm(moment) / np.linalg.norm(force))
        elif sides:
            arm = min(sides)
        else:
            return
        mean = beam.length / beam.basis.n_elements
        is_default = abs(sleeve.length - mean) <= 1e-12 * mean
        # the compliance L^3/3 of a cantilever with a force at its end changes by L^2 times that
        error = 3.0 * (stiffened_length(beam, s, sleeve.length, sleeve.curve) - OF_BORE * sleeve.length * (not is_default)) / arm
        if error > SLEEVE:
            text = (f"sleeve {sleeve.name!r}: on {beam.label} (elements of {size:.3g} m) the free length of {arm:.2g} m beside "
                    f"it is uncertain by a part of an element, so the beam may be too stiff by about {100.0 * error:.2g} %; ")
            text += "its bore is one element long: give length=, 0 for a point, and " if is_default else ""
            text += f"use {math.ceil(error / SLEEVE)} times as many elements"
            text += ", or an element end at the sleeve" if beam.interpolation == "lagrange" else ""
            self._note(sleeve.name, error, t, text)

    def _roundings(self, t: float, state: Any) -> None:
        """Measure how far curves with one tangent at element ends lie beside the axes of beams, which may have kinks there."""
        positions = state.q.reshape(-1, 4, 3)[:, 0]
        on = dict[Beam, list[tuple[int, Slider, float]]]()
        for k, slider in self.rounded:
            beam, s = place_of(slider, float(state.s[k]))
            on.setdefault(beam, []).append((k, slider, s))
        for beam, some in on.items():
            first, values, _ = beam.basis.curve("own").evaluate([s for *_, s in some])
            nodes = self.model.numbers.start(beam) + first[:, None] + np.arange(values.shape[1])
            axis = np.einsum("ma,maj->mj", values, positions[nodes])
            for (k, slider, s), place in zip(some, axis):
                nodes, shapes = shapes_at(self.model, k, float(state.s[k]), 0)
                self._rounding(t, slider, beam, s, place - np.asarray(shapes[0] @ positions[nodes]))

    def _rounding(self, t: float, slider: Slider, beam: Beam, s: float, distance: Array) -> None:
        """Note a slider at s of a beam whose curve lies so far beside the axis [3]."""
        off = float(np.linalg.norm(distance))
        if off > ROUNDED * self.model.length:
            ends, e = beam.basis.element_ends, element_at(beam, s)
            text = (f"slider {slider.name!r}: at s = {s:.4g} m on {beam.label} its curve 'c1' lies {off:.2g} m off the axis, "
                    f"because it rounds a kink of the mesh at an end of an element of {ends[e + 1] - ends[e]:.3g} m. Use "
                    f"{math.ceil(off / (ROUNDED * self.model.length))} times as many elements there, or curve='own'")
            self._note(f"{slider.name} c1", off, t, text)

    def _pair(self, t: float, state: Any, j: int, k: int, one: Slider, other: Slider) -> None:
        """Note two points of one body in an element: their forces are those of a stiffness that the element has not."""
        (beam, a), (second, b) = place_of(one, float(state.s[j])), place_of(other, float(state.s[k]))
        if beam is not second:
            return
        ends, e = beam.basis.element_ends, element_at(beam, 0.5 * (a + b))
        size, distance = float(ends[e + 1] - ends[e]), abs(a - b)
        force = state.force[self.model.first_force[[j, k]][:, None] + np.arange(3)]
        if 0.0 < distance < size and force.any():
            text = (f"sliders {one.name!r} and {other.name!r} of {_owner(one).label} are {distance:.3g} m apart on {beam.label}, "
                    f"whose elements are {size:.3g} m long. The force of each depends on its place within an element, and may be "
                    f"about {min(1.0 + 0.2 * size / distance, 10.0):.2g} times too large; their sum is right. Use elements of "
                    f"{0.5 * distance:.2g} m there")
            self._note(f"{one.name} {other.name}", size / distance, t, text)


def stiffened_length(beam: Beam, s: float, bore: float, curve: str) -> float:
    """Return the length of a beam, m, that a sleeve at s keeps from bending: EI times the difference of the turn by a unit moment
    there of a beam on two pins and of its elements, of which the mean over the bore is taken."""
    basis, around = beam.basis, AROUND if beam.interpolation == "lagrange" else AROUND_SPLINE
    sides = [element_at(beam, min(max(s + side * bore, 0.0), beam.length)) for side in (-0.5, 0.5)]
    ends = basis.element_ends[max(sides[0] - around, 0):sides[1] + around + 2]
    if bore > MOST_BORE * float(np.max(np.diff(ends))):
        return OF_BORE * bore
    ends, x = ends - ends[0], s - float(ends[0])
    fields = "greville" if basis.directors == "nodes" else basis.directors
    some = build_basis(basis.interpolation, basis.degree, ends, float(ends[-1]), directors=fields)
    piece = piece_of(some, "own", np.array([x]))
    (first,), (values,), _ = (averaged_curve(some, bore) if bore > 0.0 else some.curve(curve)).evaluate([x])
    count = min(values.size, some.n_nodes - int(first))
    moment = np.zeros(2 * some.n_nodes)
    moment[some.n_nodes + int(first):some.n_nodes + int(first) + count] = values[:count]
    moment = np.delete(moment, [0, some.n_nodes - 1])
    stiff = np.diag(beam.section.C)
    shear = float(np.min(stiff[1:3]) / np.max(stiff[4:]))
    found = float(moment @ np.linalg.solve(shear * piece.parts[0] + piece.parts[1], moment))
    W, remaining = float(ends[-1]), float(ends[-1]) - x
    return (x**3 + remaining**3) / (3.0 * W * W) + 1.0 / (shear * W) - found


def kinks_of(scene: Scene, slider: Slider) -> list[float]:
    """Return arc lengths, m, at which the curve of a slider may have a kink: joints of a path, and nodes inside of beams at which
    other parts act."""
    beams, senses = legs_of(slider.beam)
    starts = slider.beam.starts if isinstance(slider.beam, Path) else np.array([0.0, slider.beam.length])
    out = set(starts[1:-1].tolist()) | ({0.0} if slider.is_endless else set())
    for part in scene.parts:
        for node in vars(part).values():
            if isinstance(node, NodeRef) and node.owner in beams and 0 < node.index < node.owner.n_nodes - 1:
                i = beams.index(node.owner)
                local = float(node.owner.node_s[node.index])
                out.add(float(starts[i] + (local if senses[i] > 0 else node.owner.length - local)))
    return sorted(out)[:MOST_KINKS]


def _owner(slider: Slider) -> Any:
    """Return the part that a slider is a point of."""
    return getattr(slider.point, "owner", slider.point)


def _exact(W: float, GA: float, N: float, s: Array) -> Array:
    """Return the compliance at s of a taut Reissner beam with EI = 1 on two pins, W apart."""
    length = np.sqrt(GA / (N * (GA - N)))
    a, b = s / length, (W - s) / length
    # sinh a sinh b / sinh(a + b)
    hyperbolic = 0.5 * np.expm1(-2.0 * a) * np.expm1(-2.0 * b) / -np.expm1(-2.0 * (a + b))
    return np.asarray(s * (W - s) / (N * W) - (1.0 - N / GA) * length / N * hyperbolic)


class Piece(NamedTuple):
    """Elements of some lengths with EI = 1 on two pins, and forces on them."""

    at: Array                              # float64 [k], where these act
    parts: tuple[Array, Array, Array]      # energies of shear, bending and tension; unknowns are places, then turns
    load: Array                            # float64 [unknowns, k]

    def compliance(self, GA: float, N: float) -> Array:
        """Return the compliance at the places of the forces [k]."""
        shear, bending, tension = self.parts
        found = np.linalg.solve((GA - N) * shear + bending + N * tension, self.load)
        return np.asarray(np.einsum("ik,ik->k", self.load, found))


def piece_of(basis: Basis, curve: str, at: Array) -> Piece:
    """Form a piece with forces at some places of the curve of a slider."""
    n = basis.n_nodes
    parts = np.zeros((3, 2 * n, 2 * n))
    for e, nodes in enumerate(basis.element_nodes):
        none = np.zeros_like(basis.phi_s[e])
        all_of = np.concatenate((nodes, n + nodes))
        for K, rows in zip(parts, (np.hstack((basis.phi_s[e], -basis.dir[e])), np.hstack((none, basis.dir_s[e])),
                                   np.hstack((basis.phi_s[e], none)))):
            K[np.ix_(all_of, all_of)] += (rows.T * basis.weight[e]) @ rows
    first, values, _ = basis.curve(curve).evaluate(at)
    load = np.zeros((2 * n, at.size))
    for k, (a, row) in enumerate(zip(first, values)):
        count = min(row.size, n - a)
        load[a:a + count, k] = row[:count]
    free = np.delete(np.arange(2 * n), [0, n - 1])
    shear, bending, tension = parts[:, free[:, None], free]
    return Piece(at, (shear, bending, tension), load[free])


@lru_cache(maxsize=64)
def _piece(interpolation: str, degree: int, ends: tuple[float, ...], directors: str, curve: str, own: int) -> Piece:
    """Form a piece with forces at places of element `own`."""
    fields = "greville" if directors == "nodes" else directors
    basis = build_basis(interpolation, degree, np.array(ends), ends[-1], directors=fields)
    return piece_of(basis, curve, ends[own] + 0.5 * (ends[own + 1] - ends[own]) * (
        1.0 + np.cos(np.pi * (np.arange(PLACES) + 0.5) / PLACES)))
