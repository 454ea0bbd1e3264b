"""Mesh check: do the elements of beams resolve the shapes of a run? Invariants and Newton's method do not tell.

The check finds (theory.md 3.3)

- an axis that runs against its sections, after a compression to nothing;
- turns between neighbouring nodes beyond a right angle, after which interpolated directors may vanish;
- directors that interpolation has made shorter: the elements bend or twist too much for their degree;
- elements that move with contacts and become long: what of the shape and of the curvature of the reference they span;
- turns that a taut beam makes within its bending length sqrt(EI/N), where a support, a kink or a contact holds its direction or
  pushes it aside, in elements far longer than that.
"""
from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from fastbeam.kernels.empty_arrays import empty
from fastbeam.kernels.layout import CONSTANTS, LIST, NODES
from fastbeam.kernels.measures import ALONG, COSINE, FORCE, MEASURES, SQUARE, measure_elements
from fastbeam.kernels.state import State
from fastbeam.model.contact.moving_tables import element_lengths
from fastbeam.model.model import Model
from fastbeam.model.workspace import ReferenceStrains, scratch_of
from fastbeam.results.observe.contact_ripples import Contacts, mode_events
from fastbeam.scene.interpolation.basis import build_basis

Array = np.ndarray
# squares of the lengths of directors may fall by this share, and should by this one
LARGEST_LOSS, GOOD_LOSS = 0.03, 0.01
# distance of nodes over the bending length, turn (rad) against the neighbours, and that turn times the distance of nodes over
# the size of the scene, beyond which a taut beam is not resolved and it matters
LONGEST, LEAST_TURN, LEAST_ERROR = 2.0, 0.1, 2e-3
MOST_EVENTS = 5
# elements that move: the turn of the reference along one, rad, to the power 2p; how much longer than on average one is that is
# looked at; the last term of its shape next to all that bend it, and to the size of the scene
LARGEST_BEND, STRETCHED, LARGEST_TERM, LEAST_TERM = 0.05, 2.0, 0.05, 1e-5
# a curve that turns by more, rad, within this share of its length has a kink
LEAST_KINK, SHARP = 0.05, 1e-9
# shapes that are looked at in a run, and elements in all of them together
MOST_LOOKS, MOST_ELEMENTS = 500, 500_000


@dataclass
class _Elements:
    """Elements of one number of nodes nn, sorted by their first node."""

    at: Array            # int [E], where an element stands in the output of the kernel
    nodes: Array         # int [E, nn]
    length: Array        # [E], m
    EI: Array            # [E], the softer one, N m^2
    taut: Array          # [E], N, the tension from which on nodes are LONGEST bending lengths apart
    before: Array        # int [E], the neighbour at the start, -1 where there is none
    behind: Array        # int [E]
    turn: Array = field(default_factory=lambda: np.zeros(0))       # [E, 3], rad, over an element of the reference
    square: Array = field(default_factory=lambda: np.ones(0))      # [E], smallest square of the directors' lengths there


class Resolution:
    """Mesh check of a run, which remembers the worst shape of every beam; strains: those of the run, default of the model."""

    def __init__(self, model: Model, strains: ReferenceStrains | None = None) -> None:
        self.model, self.reference = model, model.reference_strains if strains is None else strains.of(model)
        self._scratch = scratch_of(model)
        self.contacts = Contacts(model)
        self._worst: dict[tuple[str, str], tuple[float, float, str]] = {}
        known = _KNOWN.get(model)
        if known is None:
            known = _KNOWN[model] = _element_sets(model)
        self._sets = known
        count = sum(len(e.at) for *_, sets in known for e in sets)
        self.looks = max(1, min(MOST_LOOKS, MOST_ELEMENTS // max(count, 1)))

    def look(self, t: float, state: State, moves: bool = False) -> None:
        """Check a state in space at time t; moves: state of a run, in which contacts are checked for their motion, too."""
        q = state.q
        self.contacts.look(t, state, self.tension, moves)
        self.look_at_moving(t, q, state.s)
        for e, found in self._measured(q):
            self._reversed_axis(t, e, found[e.at + ALONG])
            self._turns_between_nodes(t, e, found[e.at + COSINE])
            self._short_directors(t, e, found[e.at + SQUARE])
            self._bending_lengths(t, q, e, found[e.at + FORCE])

    def _measured(self, q: Array) -> Iterator[tuple[_Elements, Array]]:
        """Yield all elements with the measures of their set at the shape q [12 N]."""
        for tables, strains, sets in self._sets:
            found = empty(MEASURES * len(tables.meta))
            measure_elements(tables, self.reference, q, strains, self._scratch, found)
            for e in sets:
                yield e, found

    def look_at_moving(self, t: float, q: Array, s: Array) -> None:
        """Check elements that move with contacts and become long where these go, at coordinates q [12 N] and places s [S]."""
        for table in () if self.model.moving is None else self.model.moving.tables:
            p, nodes = table.node.shape[1] - 1, q.reshape(-1, 4, 3)
            beam = self.model.node_label(int(table.node[0, 0])).split(" node ")[0]
            lengths = element_lengths(table, s)
            mean, size = float(table.length[0]) / len(lengths), float(np.max(lengths))
            kappa = float(np.linalg.norm(table.reference[3:]))
            bend = (kappa * size)**(2 * p)
            if bend > LARGEST_BEND:
                self._note_moving("bend", bend, t, beam, size / mean, size, (
                    f"the beam bends or twists by {kappa * size:.2g} rad along one, and the error of elements of degree {p} "
                    f"pushes contacts along the beam; elements must be shorter than {LARGEST_BEND ** (0.5 / p) / kappa:.2g} m"))
            long = np.flatnonzero(lengths > STRETCHED * mean)
            terms = np.linalg.norm(np.einsum("kn,enc->ekc", _terms(p), nodes[table.node[long], 0]), axis=2)
            last = terms[:, -1] * (terms[:, -1] > LARGEST_TERM * terms[:, 2:].sum(axis=1))
            if np.max(last, initial=0.0) > LEAST_TERM * self.model.length:
                self._note_moving("stretched", float(np.max(last)), t, beam, size / mean, size, (
                    f"they do not resolve the shape of the beam, whose error may be about {np.max(last):.1g} m"))

    def _note_moving(self, kind: str, worst: float, t: float, beam: str, grown: float, size: float, text: str) -> None:
        if worst > self._worst.get((kind, beam), (0.0, 0.0, ""))[0]:
            self._worst[kind, beam] = worst, t, (
                f"{beam}: moving elements are up to {size:.3g} m long, {grown:.2g} times the average: "
                f"{text}. Use more elements on the side that contacts move away from, by Beam(elements=[...]) and MovingMesh, or "
                "use fixed elements")

    def tension(self, q: Array) -> Array:
        """Return normal forces of beams at their nodes [N] at the shape q [12 N], N; NaN elsewhere."""
        out = np.full(self.model.n_nodes, np.nan)
        for e, found in self._measured(q):
            out[e.nodes] = found[e.at + FORCE][:, None]
        return out

    def is_folded(self, q: Array) -> bool:
        """Return whether an axis runs against its sections at the shape q [12 N], or neighbouring nodes turn by more than a right
        angle."""
        return any(np.min(found[e.at + k]) < 0.0 for e, found in self._measured(q) for k in (ALONG, COSINE))

    def events(self) -> list[dict[str, Any]]:
        """Return events of the worst of every kind and beam, MOST_EVENTS of a kind."""
        out = self.contacts.events()
        for kind in ("reversed", "turn", "curvature", "layer", "bend", "stretched"):
            rows = sorted((x for (k, _), x in self._worst.items() if k == kind), key=lambda x: -x[0])
            name = "reversed" if kind == "reversed" else "coarse"
            out += [{"kind": name, "time": t, "text": text} for _, t, text in rows[:MOST_EVENTS]]
            if len(rows) > MOST_EVENTS:
                out.append({"kind": name, "time": rows[0][1], "text": f"and {len(rows) - MOST_EVENTS} more beams of this kind"})
        return out

    # --- what is looked for ---------------------------------------------------------------------------------------------
    def _reversed_axis(self, t: float, e: _Elements, along: Array) -> None:
        k = int(along.argmin())
        if along[k] < 0.0:
            self._note("reversed", -float(along[k]), t, e, k, "the axis points against its sections: it was compressed to zero "
                                                              "length and beyond, or sheared by more than a right angle, which "
                                                              "is not physical; loads exceed the stiffness of the section", 0.0)

    def _turns_between_nodes(self, t: float, e: _Elements, cosine: Array) -> None:
        k = int(cosine.argmin())
        worst = float(cosine[k])
        if worst < 0.0:
            angle = math.acos(max(-1.0, worst))
            self._note("turn", angle, t, e, k, f"neighbouring nodes are rotated by {angle:.2f} rad relative to each other, more "
                                               "than a right angle: interpolation between them is "
                                               "meaningless", math.ceil(angle / 0.5))

    def _short_directors(self, t: float, e: _Elements, square: Array) -> None:
        loss = e.square - square
        k = int(loss.argmax())
        if loss[k] > LARGEST_LOSS:
            p = e.nodes.shape[1] - 1
            self._note("curvature", float(loss[k]), t, e, k, f"it bends or twists too much for one element of degree {p}: "
                                                             "directors between its nodes are shorter than 1 by "
                                                             f"{50.0 * float(loss[k]):.2g} %, and its curvature may have an "
                                                             "error of this "
                                                             "size", float(loss[k] / GOOD_LOSS)**(1.0 / (p + 1 + (p + 1) % 2)))

    def _bending_lengths(self, t: float, q: Array, e: _Elements, force: Array) -> None:
        coarse = force > e.taut
        if not coarse.any():
            return
        spacing = e.length / (e.nodes.shape[1] - 1)
        with np.errstate(divide="ignore", invalid="ignore"):
            bending = np.sqrt(e.EI / np.maximum(force, 0.0))
        turn = _turn(q, e.nodes) - e.turn
        near = np.stack((np.where((e.before >= 0)[:, None], turn[e.before], np.nan),
                         np.where((e.behind >= 0)[:, None], turn[e.behind], np.nan)))
        known = np.isfinite(near).all(axis=2)
        mean = np.nansum(near, axis=0) / np.maximum(known.sum(axis=0), 1)[:, None]
        own = np.linalg.norm(turn - mean, axis=1)
        error = own * spacing
        matters = coarse & (own > LEAST_TURN) & (error > LEAST_ERROR * self.model.length)
        if np.any(matters):
            k = int(np.argmax(np.where(matters, error, 0.0)))
            text = (f"it is taut (N = {force[k]:.3g} N) and turns by {own[k]:.2g} rad, within a bending length sqrt(EI/N) = "
                    f"{bending[k]:.2g} m. Nodes are {spacing[k]:.2g} m apart, so positions near there may be off by about "
                    f"{error[k]:.1g} m")
            self._note("layer", float(error[k]), t, e, k, text, float(spacing[k] / bending[k]))

    def _note(self, kind: str, size: float, t: float, e: _Elements, k: int, text: str, finer: float) -> None:
        """Remember the worst of a beam; `finer`: factor of the number of elements that would be enough."""
        first, last = int(e.nodes[k, 0]), int(e.nodes[k, -1])
        beam, where, elements = self._place(first, last)
        if size > self._worst.get((kind, beam), (0.0, 0.0, ""))[0]:
            cure = f"{math.ceil(finer)} times as many elements"
            if elements:
                cure = f"{math.ceil(finer * elements)} elements instead of {elements}"
            if kind == "layer":
                cure += ", or element ends closer to each other there"
            cure = self._kink(first, last) or f"use {cure}"
            self._worst[kind, beam] = size, t, f"{beam}, {where}: {text}" + (f"; {cure}" if finer else "")

    def _kink(self, first: int, last: int) -> str:
        """Return a text about the kink of the curve that a beam was made from, in an element or next to it; '' where there is
        none."""
        owner, k = self.model.numbers.labels.owner(first)
        curve = getattr(owner, "curve", None)
        if curve is None:
            return ""
        a, b = (float(x) for x in owner.node_s[[k, k + last - first]])
        edge = 1e-3 * (b - a)
        a, b = max(a - edge, 0.0), min(b + edge, float(owner.length))

        def turn(a: float, b: float) -> float:
            d = curve.reference(np.array([a, b]))[1][:, 0]
            return 2.0 * math.asin(min(1.0, 0.5 * float(np.linalg.norm(d[1] - d[0]))))

        while b - a > SHARP * owner.length:
            middle = 0.5 * (a + b)
            a, b = (a, middle) if turn(a, middle) > turn(middle, b) else (middle, b)
        found = turn(a, b)
        if found < LEAST_KINK:
            return ""
        return (f"the curve of the beam has a kink of {found:.2g} rad at s = {0.5 * (a + b):.4g} m, which no number of elements "
                "resolves: divide the beam there, or round the curve")

    def _place(self, first: int, last: int) -> tuple[str, str, int]:
        """Return (beam, which part of it, number of its elements or 0) of the element between two nodes."""
        label = self.model.node_label(first)
        for beam in self.model.names["beams"]:
            if beam["first"] <= first < beam["first"] + beam["count"]:
                s = beam["s"]
                count = len(beam["element_ends"]) - 1
                return (f"beam {beam['name']!r}", f"s = {s[first - beam['first']]:.4g} to {s[last - beam['first']]:.4g} m",
                        count if count > 1 or beam["count"] == last - first + 1 else 0)
        return label.split(" node ")[0], f"between {label} and {self.model.node_label(last)}", 0


def mesh_events(model: Model, state: State, slides: Array | None = None, squared: Array | None = None) -> list[dict[str, Any]]:
    """Return events where elements do not resolve one state, in space, of a model, nor modes about it: their w^2 [n], and motions
    of sliders in those of modal mass 1 [n, S]."""
    resolution = Resolution(model)
    resolution.look(0.0, state)
    out = resolution.events()
    if slides is not None and squared is not None and slides.size:
        out += mode_events(model, state, resolution.tension(state.q), slides, squared)
    return out


# the elements of models that were looked at
_KNOWN: WeakKeyDictionary[Model, list[tuple[Any, Any, list[_Elements]]]] = WeakKeyDictionary()


def _element_sets(model: Model) -> list[tuple[Any, Any, list[_Elements]]]:
    """Return tables and strains of a model, with their elements as they are in the reference."""
    out = []
    for tables, strains in model.sets_of_elements(static=True):
        found = empty(MEASURES * len(tables.meta))
        measure_elements(tables, model.reference_strains, model.q0, strains, scratch_of(model), found)
        sets = list(_elements(model, tables))
        for e in sets:
            e.turn = _turn(model.q0, e.nodes)
            e.square = found[e.at + SQUARE]
        out.append((tables, strains, sets))
    return out


def _elements(model: Model, tables: Any) -> Any:
    """Yield _Elements of the tables of one strain set, for every number of nodes."""
    meta = tables.meta
    lanes = np.arange(8)
    for nn in np.unique(meta[:, NODES]).tolist():
        groups = np.flatnonzero(meta[:, NODES] == nn)
        at = meta[groups, LIST][:, None, None] + 8 * np.arange(nn)[:, None] + lanes
        nodes = tables.nodes[at].transpose(0, 2, 1).reshape(-1, nn)
        used = (tables.rows[at[:, 0]] != model.n_nodes).reshape(-1)
        C = meta[groups, CONSTANTS][:, None] + lanes
        EI = np.minimum(tables.tab[C + 48 * 4 + 8 * 4], tables.tab[C + 48 * 5 + 8 * 5]).reshape(-1)
        where = (MEASURES * groups[:, None] + lanes).reshape(-1)
        order = np.flatnonzero(used)
        order = order[np.argsort(nodes[order, 0], kind="stable")]
        nodes, EI, where = nodes[order], EI[order], where[order]
        x = model.q0.reshape(-1, 12)[:, :3][nodes]
        length = np.linalg.norm(np.diff(x, axis=1), axis=2).sum(axis=1)
        # in a beam the last node of an element is the first one of the next
        follows = nodes[:-1, -1] == nodes[1:, 0]
        count = len(nodes)
        behind = np.append(np.where(follows, np.arange(1, count), -1), -1)
        before = np.append(-1, np.where(follows, np.arange(count - 1), -1))
        yield _Elements(where, nodes, length, EI, EI * (LONGEST * (nn - 1) / length)**2, before, behind)


@lru_cache
def _terms(p: int) -> Array:
    """Return the map from values at the nodes of an element of degree p to coefficients of Legendre polynomials [p + 1, p +
    1]."""
    return np.asarray(np.linalg.inv(np.polynomial.legendre.legvander(2.0 * build_basis("lagrange", p, 1, 1.0).node_s - 1.0, p)))


def _turn(q: Array, nodes: Array) -> Array:
    """Turn [E, 3] from the first to the last node of elements in the triad of the first: exact to the third order."""
    d = q.reshape(-1, 4, 3)[:, 1:]
    turn = np.einsum("eic,ejc->eij", d[nodes[:, 0]], d[nodes[:, -1]])
    return 0.5 * np.stack((turn[:, 1, 2] - turn[:, 2, 1], turn[:, 2, 0] - turn[:, 0, 2], turn[:, 0, 1] - turn[:, 1, 0]), axis=-1)
