"""Forces and moments in sections of beams from the balance of what lies behind them, theory.md (4.35): with reactions, loads and
inertia they are in equilibrium to round-off, where those of the strains are so to the error of the mesh."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from fastbeam.compile.unpack import of_elements, points_of
from fastbeam.kernels import loop as kernels
from fastbeam.kernels.beams.beam_term import Beams
from fastbeam.kernels.call_tables import ADDED, Calls, SystemRecord, system_record
from fastbeam.kernels.contact.curves import Paths
from fastbeam.kernels.contact.slider import Sliding
from fastbeam.kernels.empty_arrays import aligned_empty
from fastbeam.kernels.forces.added_mass import AddedMass
from fastbeam.kernels.forces.drag import Drag
from fastbeam.kernels.forces.planar_follower import PlanarFollowers
from fastbeam.kernels.forces.user_force import UserForces
from fastbeam.kernels.layout import LIST, NODES
from fastbeam.model.mapping import nodes_of_curve, nodes_passed
from fastbeam.model.model import Model
from fastbeam.results.observe.resultants import Sections
from fastbeam.scene import DistributedLoad
from fastbeam.scene.interpolation.basis import Basis

Array = np.ndarray
# a section that is nearer to the end of an element lies there, as a share of the length of the beam
AT_END = 1e-12
# entries on nodes that belong to the whole of a beam
ON_NODES = Drag, AddedMass, UserForces, PlanarFollowers


class Cut(NamedTuple):
    """A beam cut at the end of an element, and the elements on one side of it that act on the nodes that both sides have."""

    section: Sections
    s: float          # arc length, m
    behind: bool      # on which side of the cut: that of larger arc lengths
    elements: Array   # int64 [m]: those on that side with nodes of both sides
    shared: Array     # int64 [a]: nodes of both sides among those of the beam; at an end of the beam the one there
    place: Array      # float64 [A]: weights of the nodes of the beam that make up the position of the cut


class Piece(NamedTuple):
    """Piece of a beam from the cut at the start of an element to a section inside it."""

    section: Sections
    cut: int          # at its start
    element: int
    s: Array          # float64 [g]: points of a quadrature along it, m
    weight: Array     # float64 [g], m
    shape: Array      # float64 [g, A]: shape functions of the nodes of the beam there
    whole: Array      # float64 [g, A]: and at the points of the mass in the whole element
    place: Array      # float64 [A]: and at the section
    length: Array     # float64 [A]: that belongs to a node, m
    # of every load that acts along it: number of its vector, shape functions [g, A], and forces and moments [g, 6] at points
    loads: tuple[tuple[int, Array, Array], ...] = ()


def places_on(section: Sections, s: Array) -> Array:
    """Return shape functions of all nodes of a beam at arc lengths [g]: [g, A]."""
    basis: Basis = section.beam.basis
    first, values, _ = basis.curve("own").evaluate(s)
    out = np.zeros((s.size, basis.n_nodes))
    np.put_along_axis(out, first[:, None] + np.arange(values.shape[1]), values, axis=1)
    return out


def nodal(basis: Basis, values: Array) -> Array:
    """Sum the values [E, n, 3] of all elements on their nodes, [A, 3]."""
    out = np.zeros((basis.n_nodes, 3))
    np.add.at(out, basis.element_nodes, values)
    return out


def lengths_of(basis: Basis, elements: Any = slice(None)) -> Array:
    """Return the length that belongs to every node of a beam, or the part of it that belongs to some elements, m [A]."""
    out = np.zeros(basis.n_nodes)
    np.add.at(out, basis.element_nodes[elements], basis.mass_phi[elements].sum(axis=2))
    return out


def cut_at(section: Sections, k: int) -> Cut:
    """Cut a beam at end k of an element."""
    basis: Basis = section.beam.basis
    nodes, s = basis.element_nodes, float(basis.element_ends[k])
    last = basis.n_elements
    if k in (0, last):
        shared = nodes[0, :1] if k == 0 else nodes[last - 1, -1:]
    else:
        shared = np.intersect1d(nodes[k - 1], nodes[k])
    behind = k < last
    side = np.arange(k, last) if behind else np.arange(last)
    elements = side[np.isin(nodes[side], shared).any(axis=1)]
    return Cut(section, s, behind, elements, shared, places_on(section, np.array([s]))[0])


def piece_to(section: Sections, cut: int, element: int) -> Piece:
    """Form the piece of a beam from the start of an element to a section."""
    basis: Basis = section.beam.basis
    at, weight = np.polynomial.legendre.leggauss(basis.degree + 2)
    half = 0.5 * (float(section.s[0]) - float(basis.element_ends[element]))
    s = basis.element_ends[element] + half * (1.0 + at)
    return Piece(section, cut, element, s, half * weight, places_on(section, s),
                 places_on(section, basis.mass_point_s[element]), places_on(section, section.s)[0], lengths_of(basis))


class FreeBodies:
    """Sections of beams, and the parts of elements and loads behind them.

    model: Model in space.
    terms: terms of the run, with equations of the nodes themselves.
    sections: one arc length each.
    plane: Plane where nodes have three unknowns.
    idle: row of idle lanes in the tables of elements, behind those of nodes.
    """

    def __init__(self, model: Model, terms: Sequence[Any], sections: Sequence[Sections], plane: Any, idle: int) -> None:
        self.model, self.plane, self.sections, self.idle = model, plane, list(sections), idle
        self.cuts: list[Cut] = []
        # of every section the cut at which it lies, or the piece that ends there
        self.of: list[int | Piece] = []
        for section in self.sections:
            ends, s = section.beam.basis.element_ends, float(section.s[0])
            near = int(np.argmin(np.abs(ends - s)))
            if abs(ends[near] - s) <= AT_END * section.beam.length:
                self.of.append(self._number(section, near))
            else:
                k = int(np.searchsorted(ends, s)) - 1
                self.of.append(self._loaded(piece_to(section, self._number(section, k), k)))
        # rows of nodes of elements, then of nodes
        wanted = {(cut.section.first, int(e)): cut.section.first + cut.section.beam.basis.element_nodes[e]
                  for cut in self.cuts for e in cut.elements}
        self.row_of: dict[Any, int] = {}
        for key, nodes in wanted.items():
            for node in nodes.tolist():
                self.row_of[(*key, node)] = len(self.row_of)
        pieces = [x for x in self.of if isinstance(x, Piece)]
        for first, nodes in [*((x.section.first, x.shared) for x in self.cuts),
                             *((x.section.first, x.section.beam.basis.element_nodes[x.element]) for x in pieces)]:
            for node in (first + nodes).tolist():
                self.row_of.setdefault(node, len(self.row_of))
        rows = len(self.row_of)
        self._r = aligned_empty(8 * (rows + 1))
        self.beams = Calls(tuple(x for x in (self._elements(term, wanted, rows) for term in terms if isinstance(term, Beams))
                                  if x is not None), ADDED)
        node_row = np.full(model.n_nodes, rows)
        for key, row in self.row_of.items():
            if not isinstance(key, tuple):
                node_row[key] = row
        self.on_nodes = Calls(tuple(_routed(term, node_row, rows) for term in terms if isinstance(term, ON_NODES)), ADDED)
        self._system: SystemRecord | None = None
        self._lines: dict[int, tuple[Array, Array]] = {}
        # curves of sliders, which change in a run over corners of switches; in statics those of the model
        running = [term.sliders.curve for term in terms if isinstance(term, Sliding)]
        of_model = np.zeros(0, np.int64) if model.sliders is None else model.sliders.curve
        self._curve: Array = running[0] if running else of_model
        self._gather()

    def _number(self, section: Sections, k: int) -> int:
        """Return the number of the cut at end k of an element."""
        cut = cut_at(section, k)
        for number, known in enumerate(self.cuts):
            if known.section.first == section.first and known.s == cut.s:
                return number
        self.cuts.append(cut)
        return len(self.cuts) - 1

    def _elements(self, term: Beams, wanted: dict[tuple[int, int], Array], rows: int) -> Beams | None:
        """Return the groups of elements that are wanted, each with rows of its own."""
        tables = term.tables
        # elements of splines may have the same nodes: which of these it is, in their order along the beam, as in tables
        by_nodes = {}
        for (first, e), nodes in wanted.items():
            basis: Basis = next(x.beam.basis for x in self.sections if x.first == first)
            same = np.all(basis.element_nodes[:e] == nodes - first, axis=1)
            by_nodes[(*sorted(nodes.tolist()), int(np.sum(same)))] = first, e
        firsts = np.array([nodes[0] for nodes in by_nodes])
        seen: dict[tuple[int, ...], int] = {}
        out, groups = np.full_like(tables.rows, rows), []
        for g, meta in enumerate(tables.meta):
            at, count = int(meta[LIST]), int(meta[NODES])
            nodes, live, own = (x[at:at + 8 * count].reshape(count, 8) for x in (tables.nodes, tables.rows, out))
            for lane in np.flatnonzero(np.isin(nodes.min(axis=0), firsts) & (live[0] != self.idle)):
                key = tuple(sorted(nodes[:, lane].tolist()))
                seen[key] = seen.get(key, -1) + 1
                found = by_nodes.get((*key, seen[key]))
                if found is not None:
                    own[:, lane] = [self.row_of[(*found, int(node))] for node in nodes[:, lane]]
                    groups.append(g)
        if not groups:
            return None
        return term._replace(tables=tables._replace(meta=np.ascontiguousarray(tables.meta[np.unique(groups)]), rows=out))

    def _gather(self) -> None:
        """Find the rows of every pair of a cut and a node, and its shares of loads."""
        model, entries = self.model, []
        loads = np.zeros((len(model.load_times), 0, 6))
        slots: list[Array] = []
        for c, cut in enumerate(self.cuts):
            beam, first = cut.section.beam, cut.section.first
            basis = beam.basis
            length, own = lengths_of(basis), lengths_of(basis, cut.elements)
            parts = np.zeros((len(model.load_times), basis.n_nodes, 6))
            for k, load in self._distributed(beam):
                for columns, values in of_elements(load):
                    if columns.start and basis.interpolation == "bspline":
                        parts[k, :, columns] += (own / length)[:, None] * nodal(basis, values)
                    else:
                        np.add.at(parts[k, :, columns], basis.element_nodes[cut.elements], values[cut.elements])
            if np.any(model.gravity):
                k = self._group(model.gravity_time)
                parts[k, :, :3] += beam.section.inertia[0] * own[:, None] * model.gravity
            loads = np.concatenate((loads, parts[:, cut.shared]), axis=1)
            for a in cut.shared.tolist():
                rows = [self.row_of[first, int(e), first + a] for e in cut.elements if a in basis.element_nodes[e]]
                slots += [np.array([len(entries), row]) for row in rows]
                entries.append((c, first + a, own[a] / length[a], self.row_of[first + a]))
        self.entry_cut, self.node, self.share, self.node_row = (np.array(x) for x in zip(*entries))
        self.loads = loads
        self.slot_entry, self.slot_row = np.array(slots).T
        self.sign = np.array([-1.0 if cut.behind else 1.0 for cut in self.cuts])

    def _group(self, time: Any) -> int:
        """Return the number of the load vector of loads with this factor in time."""
        return next(k for k, known in enumerate(self.model.load_times) if known is time)

    def _distributed(self, beam: Any) -> list[tuple[int, DistributedLoad]]:
        """Return dead loads along a beam, each with the number of its load vector."""
        return [(self._group(load.time), load) for load in self.model.load_parts.values()
                if isinstance(load, DistributedLoad) and load.beam is beam and not load.follower]

    def _loaded(self, piece: Piece) -> Piece:
        section, beam, loads = piece.section, piece.section.beam, []
        start = float(beam.basis.element_ends[piece.element])
        for k, load in self._distributed(beam):
            for which, given in enumerate((load.force, load.moment)):
                # moments on splines act on nodes
                if given is None or which and beam.basis.interpolation == "bspline":
                    continue
                if callable(given):
                    on = points_of(load, which, np.array([start, float(section.s[0])]))
                    shape = places_on(section, on.s.reshape(-1))
                    on_points = (on.weight[..., None] * on.values).reshape(-1, 3)
                else:
                    shape, on_points = piece.shape, piece.weight[:, None] * given
                acting = np.zeros((len(shape), 6))
                acting[:, 3 * which:3 * which + 3] = on_points
                loads.append((k, shape, acting))
        return piece._replace(loads=tuple(loads))

    # --- one evaluation ---------------------------------------------------------------------------------------------------
    def forces(self, system: Any, q: Array, h: float, factors: Array, second: Array | None, pushes: Any) -> Array:
        """Return force and moment [C, 2, 3] that the part behind each section exerts on the part before it.

        system: system of the assembly; residuals are left alone.
        q: float64 [N, 4, 3], coordinates in the middle of the step.
        h: the step, s; 0 in statics.
        factors: float64 [K], factors of the loads.
        second: float64 [N, 4, 3], mean second rates of the coordinates in the step; in statics those of a steady motion.
        pushes: function of the number of a slider -> float64 [N, 8], forces and moments that it exerts on nodes.
        """
        own = system._replace(work=system.work._replace(r=self._r))
        self._system = system_record(own, self._system, ADDED)
        rows = self._assembled(self.beams, h)
        entry = np.zeros((len(self.node), 6))
        np.add.at(entry, self.slot_entry, rows[self.slot_row])
        # distributed loads have the sign of inertia in the equations
        on_nodes = self._assembled(self.on_nodes, h) if self.on_nodes.terms else np.zeros_like(rows)
        entry += self.share[:, None] * on_nodes[self.node_row]
        entry -= np.einsum("k,kec->ec", factors, self.loads)
        if h == 0.0 and second is not None:
            entry += self._inertia(q, second)
        self._find_sliders(system.state.s, system.work.s_end if h > 0.0 else system.state.s)
        x = q[:, 0]
        at = np.array([cut.place @ x[cut.section.span] for cut in self.cuts])
        out = np.zeros((len(self.cuts), 2, 3))
        signed = self.sign[self.entry_cut, None] * entry
        np.add.at(out[:, 0], self.entry_cut, signed[:, :3])
        np.add.at(out[:, 1], self.entry_cut, signed[:, 3:] + np.cross(x[self.node] - at[self.entry_cut], signed[:, :3]))
        for c, cut in enumerate(self.cuts):
            for k in self._sliders(cut.section.first + cut.shared):
                out[c] += self._across(cut, at[c], x, k, self.in_space(pushes(k)))
        found = []
        for of in self.of:
            if isinstance(of, Piece):
                sliders = self._sliders(of.section.first + of.section.beam.basis.element_nodes[of.element])
                rates = None if second is None else second[of.section.span]
                at_end = self._at_end_of(of, out[of.cut], q[of.section.span], factors, rates, on_nodes)
                found.append(at_end - sum(self._within(of, x, k, self.in_space(pushes(k))) for k in sliders))
            else:
                found.append(out[of])
        return np.array(found)

    def _assembled(self, terms: Calls, h: float) -> Array:
        """Assemble forces and moments [rows, 6] that terms put on rows of their own."""
        self._r[:] = 0.0
        kernels.assemble_some(*terms.on(self._system), h)
        return self.in_space(self._r.reshape(-1, 8))

    def _inertia(self, q: Array, second: Array) -> Array:
        """Return forces of inertia in a steady motion, which the equations of statics lack, [entries, 6]."""
        out = np.zeros((len(self.node), 6))
        for c, cut in enumerate(self.cuts):
            basis, inertia = cut.section.beam.basis, cut.section.beam.section.inertia
            x, rates = q[cut.section.span], second[cut.section.span]
            nodes = basis.element_nodes[cut.elements]
            parts = np.zeros((*nodes.shape, 6))
            parts[..., :3] = inertia[0] * (basis.mass_phi[cut.elements] @ rates[nodes, 0])
            for i in (2, 3):
                parts[..., 3:] += inertia[i - 1] * np.cross(x[nodes, i], basis.mass_dir[cut.elements] @ rates[nodes, i])
            whole = np.zeros((basis.n_nodes, 6))
            np.add.at(whole, nodes, parts)
            mine = self.entry_cut == c
            out[mine] = whole[self.node[mine] - cut.section.first]
        return out

    def in_space(self, r: Array) -> Array:
        """Return forces and moments [rows, 6] of residuals [rows, 8]."""
        if self.plane is None:
            return r[:, :6]
        axes = self.plane.axes
        return np.hstack((r[:, :2] @ axes[:2], r[:, 2:3] * axes[2]))

    # --- sliders ----------------------------------------------------------------------------------------------------------
    def _find_sliders(self, start: Array, end: Array) -> None:
        """Find the nodes that sliders touch in a step that leads them from s [S] to s [S]."""
        self._place = 0.5 * (start + end)
        curves = self.model.curves
        self._local = [nodes_passed(curves, int(c), float(start[k]), float(end[k])) for k, c in enumerate(self._curve)]
        self._touched = [self._line(k)[0][local] for k, local in enumerate(self._local)]
        self._under = np.concatenate([np.zeros(0, np.int64), *self._touched])
        self._under_of = np.repeat(np.arange(len(self._touched)), [len(x) for x in self._touched])

    def _line(self, k: int) -> tuple[Array, Array]:
        """Return nodes of the curve of slider k, and their arc lengths on it."""
        c = int(self._curve[k])
        if c not in self._lines:
            self._lines[c] = nodes_of_curve(self.model.curves, c), self.model.curve_s[c]
        return self._lines[c]

    def _sliders(self, nodes: Array) -> list[int]:
        """Return the sliders that act on some nodes in the step."""
        near = (self._under >= nodes.min()) & (self._under <= nodes.max())
        return [int(k) for k in np.unique(self._under_of[near]) if np.isin(nodes, self._touched[k]).any()]

    def _standing(self, k: int, section: Sections) -> tuple[float, Array, Array]:
        """Return the place of slider k on a beam of its curve, m, outside it less than 0 or more than its length; and those of
        the nodes that it touches which belong to other beams of the curve, in front of this one and behind it."""
        nodes, s = self._line(k)
        curves = self.model.curves
        period = float(curves.period[self._curve[k]]) if isinstance(curves, Paths) else 0.0
        own = np.flatnonzero((nodes >= section.span.start) & (nodes < section.span.stop))
        low, high = s[own[0]], s[own[-1]]
        middle = 0.5 * (low + high)
        local = self._local[k]
        others = nodes[local[(nodes[local] < section.span.start) | (nodes[local] >= section.span.stop)]]
        along = np.concatenate(([self._place[k]], s[local[np.isin(nodes[local], others)]])) - middle
        if period:
            along -= period * np.round(along / period)
        # a beam that the path runs from its end to its start
        along *= 1.0 if nodes[own[0]] < nodes[own[-1]] else -1.0
        return float(along[0] + 0.5 * (high - low)), others[along[1:] < 0.0], others[along[1:] > 0.0]

    def _across(self, cut: Cut, at: Array, x: Array, k: int, push: Array) -> Array:
        """Return the force and moment [2, 3] that slider k, on one side of a cut, exerts on nodes of the other."""
        place, front, behind = self._standing(k, cut.section)
        stands_behind = _is_behind(cut.section, place, cut.s)
        nodes = np.arange(cut.section.count)
        of_both = cut.shared[-1] + 1 if cut.behind else cut.shared[0]
        own = nodes < of_both if stands_behind else nodes >= of_both
        other = np.concatenate((cut.section.first + nodes[own], front if stands_behind else behind))
        return (1.0 if stands_behind else -1.0) * _about(at, x[other], push[other])

    def _within(self, piece: Piece, x: Array, k: int, push: Array) -> Array:
        """Return the force and moment [2, 3] that slider k exerts on the piece, about the end of it."""
        section, start = piece.section, self.cuts[piece.cut].s
        place = self._standing(k, section)[0]
        touched = self._touched[k]
        if not _is_behind(section, place, start) or _is_behind(section, place, float(section.s[0])):
            return np.zeros((2, 3))
        return _about(piece.place @ x[section.span], x[touched], push[touched])

    def _at_end_of(self, piece: Piece, start: Array, q: Array, factors: Array, second: Array | None, on_nodes: Array) -> Array:
        """Return force and moment [2, 3] at the end of a piece from those at its start. q, second: of the nodes of the beam."""
        section, beam = piece.section, piece.section.beam
        lacks = np.zeros((piece.s.size, 6))
        e, basis, inertia = piece.element, beam.basis, beam.section.inertia
        nodes = basis.element_nodes[e]
        x, end = q[:, 0], piece.place @ q[:, 0]
        # what the whole element has more than these densities: directors may have shape functions of their own, and loads on
        # nodes have another moment than the same along the element
        off = np.zeros((2, 3))
        if second is not None:
            lacks[:, :3] += inertia[0] * (piece.shape @ second[:, 0])
            for i in (2, 3):
                along = [(shape @ q[:, i], shape @ second[:, i]) for shape in (piece.shape, piece.whole)]
                lacks[:, 3:] += inertia[i - 1] * np.cross(*along[0])
                off[1] += inertia[i - 1] * np.cross(q[nodes, i], basis.mass_dir[e] @ second[nodes, i]).sum(axis=0)
                off[1] -= inertia[i - 1] * basis.mass_weight[e] @ np.cross(*along[1])
        if np.any(self.model.gravity):
            lacks[:, :3] -= factors[self._group(self.model.gravity_time)] * beam.section.inertia[0] * self.model.gravity
        rows = on_nodes[[self.row_of[section.first + a] for a in nodes.tolist()]]
        for k, load in self._distributed(beam) if basis.interpolation == "bspline" else ():
            rows[:, 3:] -= factors[k] * nodal(basis, of_elements(load)[1][1])[nodes]
        rows /= piece.length[nodes, None]
        lacks += piece.shape[:, nodes] @ rows
        out = _about(end, piece.shape @ x, piece.weight[:, None] * lacks)
        for k, shape, acting in piece.loads:
            out -= factors[k] * _about(end, shape @ x, acting)
        off += _about(end, x[nodes], basis.mass_phi[e].sum(axis=1)[:, None] * rows)
        off -= _about(end, piece.whole @ x, basis.mass_weight[e][:, None] * (piece.whole[:, nodes] @ rows))
        start_s, end_s = basis.element_ends[e:e + 2]
        out += (float(section.s[0]) - start_s) / (end_s - start_s) * off
        out += _about(end, (self.cuts[piece.cut].place @ x)[None], start.reshape(1, 6))
        return out


def _is_behind(section: Sections, place: float, s: float) -> bool:
    """Return whether a place lies behind arc length s of the beam; one at s does not."""
    return place > s + AT_END * section.beam.length


def _about(at: Array, x: Array, c: Array) -> Array:
    """Sum forces and moments [n, 6] at places x [n, 3], about another place: [2, 3]."""
    return np.array([c[:, :3].sum(axis=0), c[:, 3:].sum(axis=0) + np.cross(x - at, c[:, :3]).sum(axis=0)])


def _routed(term: Any, row_of: Array, nowhere: int) -> Any:
    """Return the term with rows of its own for wanted nodes; what acts on one node alone is no part of the beam."""
    row = row_of[term.node]
    if isinstance(term, (UserForces, PlanarFollowers)):
        row = np.where(term.along == 1, row, nowhere)
    return term._replace(row=row)
