"""Beams whose elements end at contacts: the scene on another mesh, and energies of elements as functions of their ends.

Polynomials in the elements on both sides represent a point force, or moment, at their common end exactly: the mesh adds no error
(theory.md 8). Contacts are numbered like the sliders of the scene.
"""
from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import fields, is_dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from fastbeam.compile.unpack import points_of
from fastbeam.model.maps import spins
from fastbeam.model.tables import strain_gradient, strains_of
from fastbeam.scene import Beam, Crossing, InitialVelocity, Path, RigidMotion, Scene, Sleeve, Slider
from fastbeam.scene.beams import NodeRef
from fastbeam.scene.checks import nearest_triads
from fastbeam.scene.interpolation.basis import Basis, build_basis

Array = np.ndarray
# contacts nearer than this share of the beam to each other, or to an end that stays, count as one place
SAME = 1e-9
# a contact replaces an element end nearer than the first share of an element; elements may shrink to the second share before the
# mesh is chosen again
NEAR, LEAST = 0.3, 0.1
# differences of fourth order by the places of element ends: step as a share of the element; steps and their weights
STEP = 6e-4
STENCIL = ((-2, 1.0 / 12.0), (-1, -2.0 / 3.0), (1, 2.0 / 3.0), (2, -1.0 / 12.0))
# one-sided steps and weights, beside the end of a beam
ONE_SIDED = ((0, -25.0 / 12.0), (1, 4.0), (2, -3.0), (3, 4.0 / 3.0), (4, -1.0 / 4.0))


class Slot(NamedTuple):
    """Element end: arc length, m, contacts there, and True for an end of the given mesh that stays."""

    at: float
    contacts: tuple[int, ...] = ()
    stays: bool = False


class Place(NamedTuple):
    """Place of a contact: beam, arc length on it, m, and 1, or -1 where s grows against the beam."""

    beam: Beam
    at: float
    sign: int


def place_of(slider: Any, s: float) -> Place:
    """Return the place of a slider at arc length s of its curve."""
    if not isinstance(slider.beam, Path):
        return Place(slider.beam, float(np.clip(s, 0.0, slider.beam.length)), 1)
    k, local = slider.beam.places(s)
    return Place(slider.beam.beams[int(k[0])], float(local[0]), slider.beam.directions[int(k[0])])


def _kept(scene: Scene, beam: Beam) -> Array:
    """Return the arc lengths of the nodes of a beam that other parts refer to, with both ends."""
    index = {0, beam.n_nodes - 1}
    for part in scene.parts:
        index.update(node.index for node in _nodes(part) if node.owner is beam)
    return np.asarray(beam.node_s[sorted(index)])


def _nodes(part: Any) -> Iterator[NodeRef]:
    for field in fields(part) if is_dataclass(part) and not isinstance(part, Beam) else ():
        value = getattr(part, field.name)
        for x in value if isinstance(value, (tuple, list)) else (value,):
            if isinstance(x, NodeRef):
                yield x


def slots_of(beam: Beam, kept: Array, contacts: dict[int, float]) -> list[Slot]:
    """Return the element ends of a beam: at the arc lengths `kept`, at contacts, and between them at those of its own mesh."""
    same = SAME * beam.length
    found = [Slot(float(x), (), True) for x in kept]
    for k, at in sorted(contacts.items(), key=lambda item: item[1]):
        near = [i for i, slot in enumerate(found) if abs(slot.at - at) <= same]
        if near:
            found[near[0]] = found[near[0]]._replace(contacts=(*found[near[0]].contacts, k))
        else:
            found.append(Slot(at, (k,)))
    ends = beam.basis.element_ends
    taken = np.array([slot.at for slot in found])
    at_contact = np.array([bool(slot.contacts) for slot in found])
    for before, x, after in zip(ends[:-2], ends[1:-1], ends[2:]):
        gap = np.abs(taken - x)
        if np.min(gap) > same and not np.any(at_contact & (gap < NEAR * min(x - before, after - x))):
            found.append(Slot(float(x)))
    return sorted(found)


def moved(slots: list[Slot], contacts: dict[int, float]) -> list[Slot] | None:
    """Return the element ends with contacts at new places; None where elements would become too short, or a contact leaves a
    node."""
    out = []
    for slot in slots:
        at = {contacts[k] for k in slot.contacts}
        if not at or max(abs(x - slot.at) for x in at) == 0.0:
            out.append(slot)
            continue
        if slot.stays or len(at) > 1:
            return None
        out.append(slot._replace(at=at.pop()))
    x, now = (np.array([slot.at for slot in y]) for y in (slots, out))
    return out if np.all(np.diff(now) >= LEAST * np.diff(x)) else None


class PointSleeve(Sleeve):
    """Sleeve that holds the section of the reference at one point, whatever the mesh."""

    @property
    def section_at_start(self) -> Array:
        return np.asarray(self.beam.reference(self.at)[1][0])


# --- the scene ----------------------------------------------------------------------------------------------------------
class Cut:
    """Scene whose beams have element ends at contacts.

    s: float64 [S], arc lengths of the contacts, m.
    before: mesh that is kept where possible, with contacts moved.
    scene: the new scene; every sleeve holds the section at one point.
    same_mesh: true if nodes and elements are those of `before`.
    slots: element ends of the beams with contacts, by the beams of the given scene.
    model: Model of the new scene, once it is compiled.
    """

    def __init__(self, scene: Scene, s: Array, before: Cut | None = None) -> None:
        self.given, self.s = scene, s.copy()
        self.model: Any = None
        self.places = [place_of(slider, float(x)) for slider, x in zip(scene.sliders, s)]
        on: dict[Beam, dict[int, float]] = {}
        for k, place in enumerate(self.places):
            on.setdefault(place.beam, {})[k] = place.at
        kept = None
        if before is not None and before.slots.keys() == on.keys():
            kept = {beam: moved(before.slots[beam], x) for beam, x in on.items()}
        self.same_mesh = kept is not None and all(x is not None for x in kept.values())
        self.slots: dict[Beam, list[Slot]] = (kept if self.same_mesh else {  # type: ignore[assignment]
            beam: slots_of(beam, _kept(scene, beam), x) for beam, x in on.items()})
        self.new = {beam: replace(beam, elements=np.array([slot.at for slot in slots])) for beam, slots in self.slots.items()}
        self._paths: dict[Path, Path] = {}
        parts = [self._swapped(part) for part in scene.parts if not isinstance(part, (InitialVelocity, RigidMotion, Crossing))]
        self.scene = Scene(*parts, name=scene.name, gravity=scene.gravity, gravity_time=scene.gravity_time,
                           project_velocities=True)

    def point(self, what: Any) -> Any:
        """Map an observed point of the given scene to this scene."""
        if isinstance(what, tuple):
            return self.new.get(what[0], what[0]), what[1]
        if isinstance(what, NodeRef) and what.owner in self.new:
            return self.new[what.owner], float(what.owner.node_s[what.index])
        return what

    def _swapped(self, x: Any) -> Any:
        """Return a part, or what it refers to, on the new beams."""
        if isinstance(x, Beam):
            return self.new.get(x, x)
        if isinstance(x, NodeRef):
            beam = self.new.get(x.owner)
            return x if beam is None else beam.at(float(x.owner.node_s[x.index]))
        if isinstance(x, Path):
            if x not in self._paths:
                pairs = [(self._swapped(beam), d) for beam, d in zip(x.beams, x.directions)]
                self._paths[x] = Path(x.name, pairs, closed=x.closed)
            return self._paths[x]
        if isinstance(x, (tuple, list)):
            found = [self._swapped(y) if isinstance(y, (Beam, NodeRef)) else y for y in x]
            return x if all(a is b for a, b in zip(found, x)) else type(x)(found)
        if not is_dataclass(x) or getattr(x, "kind", None) is None:
            return x
        changed = {}
        for field in fields(x):
            value = getattr(x, field.name)
            new = self._swapped(value) if isinstance(value, (Beam, NodeRef, Path, tuple, list)) else value
            if new is not value and field.init:
                changed[field.name] = new
        if isinstance(x, Sleeve):
            changed |= {"axis": None, "point": self._swapped(_on_axis(x)), **self._bore(x)}
            return PointSleeve(**{field.name: getattr(x, field.name) for field in fields(x) if field.init} | changed)
        if isinstance(x, Slider) and changed:
            changed["curve"] = "own"
        return replace(x, **changed) if changed else x

    def _bore(self, sleeve: Sleeve) -> dict[str, Any]:
        """Return the changes of the bore of a sleeve: only friction needs a bore, and locked sleeves do not slip."""
        return {"length": 0.0, "friction": None, "key_radius": None}

    # --- coordinates --------------------------------------------------------------------------------------------------
    def carry(self, q: Array, given: Any, new: Any, out: Array) -> None:
        """Map coordinates [N, 4, 3] of the given mesh to this mesh; given, new: numbers of the nodes of both."""
        for part in self._with_nodes():
            beam = self.new.get(part)
            x = q[given.span(part)]
            out[new.span(part if beam is None else beam)] = x if beam is None else along(part.basis, beam.node_s, x)

    def bring_back(self, q: Array, new: Any, given: Any, out: Array) -> None:
        """Map coordinates [N, 4, 3] of this mesh to the given mesh, the opposite of `carry`."""
        for part in self._with_nodes():
            beam = self.new.get(part)
            x = q[new.span(part if beam is None else beam)]
            out[given.span(part)] = x if beam is None else along(beam.basis, part.node_s, x)

    def shifted(self, k: int, way: float) -> Cut:
        """Return a copy with contact k moved by a small `way`; it shares nodes and beams with this mesh."""
        out = copy(self)
        i = self.places[k].beam
        way *= self.places[k].sign
        here = [slot._replace(at=slot.at + way) if k in slot.contacts else slot for slot in self.slots[i]]
        out.slots = {**self.slots, i: here}
        return out

    def length_at(self, k: int) -> float:
        """Return the length of the shorter element beside contact k, m."""
        slots = self.slots[self.places[k].beam]
        e = next(e for e, slot in enumerate(slots) if k in slot.contacts)
        return min(abs(slots[e].at - slots[j].at) for j in (e - 1, e + 1) if 0 <= j < len(slots))

    def _with_nodes(self) -> list[Any]:
        return [*self.given.beams, *self.given.nets, *self.given.bodies, *self.given.masses]


def along(basis: Basis, s: Array, q: Array) -> Array:
    """Interpolate coordinates [n, 4, 3] at arc lengths s [n] of a beam from those of its nodes; triads are made orthonormal."""
    first, values, _ = basis.curve("own").evaluate(s)
    out = np.einsum("sn,snic->sic", values, q[first[:, None] + np.arange(values.shape[1])])
    out[:, 1:] = nearest_triads(out[:, 1:])
    return out


def _on_axis(sleeve: Sleeve) -> Any:
    """Return the point of the holder on the axis of a curved beam, instead of the mean over the bore."""
    on_beam = sleeve.beam.reference(sleeve.at)[0][0]
    shift = on_beam - sleeve.place
    if np.linalg.norm(shift) <= 1e-9 * sleeve.beam.length or isinstance(sleeve.point.owner, Beam):
        return sleeve.point
    owner = sleeve.point.owner
    return owner.point(sleeve.point.offset + owner.directors @ shift)


# --- the energy of an element by the places of its ends -----------------------------------------------------------------
@cache
def _unit(degree: int) -> Basis:
    return build_basis("lagrange", degree, 1, 1.0)


class Acting(NamedTuple):
    """Loads along a beam: its weight, N/m [3], and distributed loads with their factors."""

    weight: Array
    loads: tuple[tuple[Any, float], ...]


class Element(NamedTuple):
    """Element: its beam, loads along it, arc lengths of its ends, and coordinates [p + 1, 4, 3] of its nodes."""

    beam: Beam
    acting: Acting
    ends: tuple[float, float]
    q: Array

    def moved(self, side: int, way: float) -> Element:
        """Return a copy with one end moved by `way`, and the same coordinates."""
        ends = list(self.ends)
        ends[side] += way
        return self._replace(ends=(ends[0], ends[1]))

    def stencil(self, side: int) -> list[tuple[float, float]]:
        """Return shifts of one end, m, and their weights in its derivative, 1/m; beside an end of the beam only into the
        element."""
        step = STEP * (self.ends[1] - self.ends[0])
        to_end = self.ends[0] if side == 0 else self.beam.length - self.ends[1]
        if to_end < 2.0 * step:
            step *= 1 - 2 * side
            return [(way * step, weight / step) for way, weight in ONE_SIDED]
        return [(way * step, weight / step) for way, weight in STENCIL]

    def reference(self) -> Array:
        """Return the strains of the reference [g, 6] at the points of the strain energy, less those of a prestrain."""
        beam, unit, h = self.beam, _unit(self.beam.degree), self.ends[1] - self.ends[0]
        phi, triads = beam.reference(self.ends[0] + h * unit.node_s)
        slopes = np.einsum("gn,nkc->gkc", unit.dir_s[0] / h, triads)
        return strains_of(beam.strain, unit.phi_s[0] / h @ (phi - phi[0]), np.einsum("gn,nkc->gkc", unit.dir[0], triads),
                          slopes) - beam.start_strain

    def forces(self) -> Array:
        """Return the nodal forces of the loads along it, N [p + 1, 3]."""
        unit, h = _unit(self.beam.degree), self.ends[1] - self.ends[0]
        out = h * unit.mass_phi[0].sum(axis=1)[:, None] * self.acting.weight
        for load, factor in self.acting.loads:
            if callable(load.force):
                on = points_of(load, 0, np.array(self.ends))
                shape = unit.shapes(on.element, (on.s - self.ends[0]) / h)[0]
                out = out + factor * np.einsum("pg,pgn,pgc->nc", on.weight, shape, on.values)
            elif load.force is not None:
                out = out + factor * h * np.einsum("g,gn,c->nc", unit.mass_weight[0], unit.mass_phi_values[0], load.force)
        return out

    def slopes(self, sides: tuple[int, ...]) -> tuple[Array, Array]:
        """Return the derivatives of strain energy less the work of its loads, by the places of both ends, N [2], valid for
        `sides`, and by the coordinates of its nodes [p + 1, 4, 3]."""
        beam, q, unit, h = self.beam, self.q, _unit(self.beam.degree), self.ends[1] - self.ends[0]
        dir_s = unit.dir_s[0] / h
        # relative to the first node: differences of large coordinates are exact
        f, d = unit.phi_s[0] / h @ (q[:, 0] - q[0, 0]), np.einsum("gn,nkc->gkc", unit.dir[0], q[:, 1:])
        k = np.einsum("gn,nkc->gkc", dir_s, q[:, 1:])
        strain = strains_of(beam.strain, f, d, k) - self.reference()
        stress, weight = strain @ beam.section.C, h * unit.weight[0]
        by = np.einsum("g,gi,gijc->gjc", weight, stress, strain_gradient(beam.strain, f, d, k))
        gradient = np.zeros_like(q)
        gradient[:, 0] = (unit.phi_s[0] / h).T @ by[:, 0] - self.forces()
        gradient[:, 1:] = np.einsum("gn,gkc->nkc", unit.dir[0], by[:, 1:4]) + np.einsum("gn,gkc->nkc", dir_s, by[:, 4:])
        # derivatives by the arc length decrease with the length of an element
        longer = (0.5 * float(np.einsum("g,gi,gi->", weight, stress, strain)) - float(np.sum(by[:, 0] * f))
                  - float(np.sum(by[:, 4:] * k))) / h
        out = np.array([-longer, longer])
        place = q[:, 0]
        for side in sides:
            for way, share in self.stencil(side):
                there = self.moved(side, way)
                out[side] -= share * (float(np.einsum("g,gi,gi->", weight, stress, there.reference()))
                                      + float(np.sum(there.forces() * place)))
        return out, gradient


class Along(NamedTuple):
    """Derivatives of the energy of a scene by the arc lengths of S contacts. NaN where a contact stands on a node that other
    parts refer to, at an end of its beam, or with another one.

    Nodes that move with an element end may take the coordinates of the points of the beam that they reach: in an equilibrium the
    energy changes by the same amount, and the normal force, known to round-off of a stiff beam only, does not enter.
    """

    slope: Array     # float64 [S], N: nodes move along; without the work of the contact forces on the nodes of the contacts
    bend: Array      # float64 [S, S], N/m: second derivatives, nodes fixed
    forces: Array    # float64 [S, 12 N]: derivatives of the forces on the coordinates of all nodes, nodes fixed
    node: Array      # int64 [S]: nodes of the contacts, -1 where there is no slope
    way: Array       # float64 [S, 2, 3]: derivatives of position and spin of these nodes by s


def energy_along(cut: Cut, numbers: Any, acting: dict[Any, Acting], q: Array, only: int = -1) -> Along:
    """Evaluate the derivatives at coordinates q [N, 4, 3] of the nodes of the cut scene. acting: loads along the beams with
    contacts, by the given beams; only: the one contact of which the slope is needed, without second derivatives."""
    size = len(cut.places)
    out = Along(np.full(size, np.nan), np.zeros((size, size)), np.zeros((size, q.size)), np.full(size, -1),
                np.zeros((size, 2, 3)))
    for i, slots in cut.slots.items():
        beam = cut.new[i]
        first, p = numbers.start(beam), beam.degree
        free = [slot.contacts[0] if len(slot.contacts) == 1 and not slot.stays else -1 for slot in slots]
        free = [k if only in (-1, k) else -1 for k in free]
        for e, k in enumerate(free):
            if k >= 0:
                out.slope[k], out.node[k] = 0.0, first + p * e
                out.way[k] = cut.places[k].sign * _way(p, [(slots[e].at - slots[e - 1].at, q[out.node[k] - p:][:p + 1]),
                                                           (slots[e + 1].at - slots[e].at, q[out.node[k]:][:p + 1])])
        for e in range(len(slots) - 1):
            ends = free[e], free[e + 1]
            if max(ends) >= 0:
                nodes = first + p * e + np.arange(p + 1)
                element = Element(beam, acting[i], (slots[e].at, slots[e + 1].at), q[nodes])
                _add_element(out, cut, ends, nodes, element, only < 0)
    return out


def _slopes_at_nodes(p: int, h: float, q: Array) -> tuple[Array, Array]:
    """Return the derivatives by the arc length of positions and spins [p + 1, 3] at the nodes of an element of length h."""
    unit = _unit(p)
    slope = np.einsum("an,nic->aic", unit.curve("own").evaluate(unit.node_s)[2], q - q[:1]) / h
    return slope[:, 0], spins(q, slope)


def _way(p: int, sides: list[tuple[float, Array]]) -> Array:
    """Return the mean derivative of both sides of a node [2, 3], from elements with their lengths and coordinates."""
    left, right = (_slopes_at_nodes(p, h, q) for h, q in sides)
    return 0.5 * np.array([a[-1] + b[0] for a, b in zip(left, right)])


def _add_element(out: Along, cut: Cut, ends: tuple[int, int], nodes: Array, element: Element, second: bool) -> None:
    """Add the derivatives of an element. ends: contacts at its ends that move, or -1; second: with second derivatives."""
    h, degree = element.ends[1] - element.ends[0], element.beam.degree
    sides = tuple(side for side in (0, 1) if ends[side] >= 0)
    slopes, gradient = element.slopes(sides)
    along = _slopes_at_nodes(degree, h, element.q)
    force, moment = gradient[:, 0], np.cross(element.q[:, 1:], gradient[:, 1:]).sum(axis=1)
    for side in sides:
        k = ends[side]
        sign = cut.places[k].sign
        # inner nodes move along by their share, the node of the contact with the mean of its two sides
        share = np.abs(_unit(degree).node_s - (1.0 - side))
        share[-side] = 0.0
        work = float(share @ np.sum(force * along[0] + moment * along[1], axis=1))
        out.slope[k] += sign * (slopes[side] + work) + float(force[-side] @ out.way[k, 0] + moment[-side] @ out.way[k, 1])
        if not second:
            continue
        bend, change = np.zeros(2), np.zeros_like(element.q)
        for way, weight in element.stencil(side):
            found = element.moved(side, way).slopes(sides)
            bend += weight * found[0]
            change += weight * found[1]
        out.bend[k, k] += bend[side]
        other = ends[1 - side]
        if other >= 0:
            out.bend[k, other] += sign * cut.places[other].sign * bend[1 - side]
        out.forces.reshape(len(out.slope), -1, 4, 3)[k, nodes] += sign * change
