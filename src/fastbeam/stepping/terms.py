"""Terms of a model in a run, and the record of what they share, as compiled code takes them (kernels/terms.py)."""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.beams.beam_term import Beams
from fastbeam.kernels.beams.inner_nodes import NoInner
from fastbeam.kernels.contact.slider import Sliding
from fastbeam.kernels.contact.slider_forces import Along
from fastbeam.kernels.entries.dense import Contact
from fastbeam.kernels.entries.factored import FactoredContact
from fastbeam.kernels.forces.drag import Drag
from fastbeam.kernels.jit.calls import Unknown
from fastbeam.kernels.state import State, Work
from fastbeam.kernels.terms import NoContact, SolverOutside, System
from fastbeam.model.feature import OfRun, Stand
from fastbeam.model.forces.damping_and_drag import COEFFICIENTS
from fastbeam.model.forces.user_forces import ON_NODES
from fastbeam.model.model import Model

Array = np.ndarray


def terms_of(run: OfRun) -> tuple[Any, ...]:
    """Collect the terms of a run, in the order of kernels/terms.py."""
    model = run.model
    terms: list[tuple[Stand, Any]] = [part for feature in model.features for part in feature.terms(run)]
    inner = NoInner() if run.inner is None else run.inner
    terms += [(Stand.BEAMS, Beams(strains, tables, inner))
              for tables, strains in model.sets_of_elements(run.static)]
    for table in model.links:
        for feature in model.features:
            table = feature.link_of_run(table, run)
        terms.append((Stand.LINKS, table))
    terms += [(Stand.INNER, run.inner), (Stand.BODIES, None if run.static else model.bodies), (Stand.TIES, model.ties),
              (Stand.HELD, model.static_held if run.static else model.held)]
    return tuple(term for _, term in sorted(terms, key=lambda x: x[0]) if term is not None)


class Growing:
    """Forces by laws, and of moving air, in the terms of a model at rest: their values at a load factor and a time; terms: terms
    of a run in statics."""

    def __init__(self, model: Model, terms: tuple[Any, ...]) -> None:
        # scaled arrays, their full values, and 1 where they grow
        self._parts: list[tuple[Array, Array, Any]] = []
        self._air: list[tuple[Array, Array]] = []
        self.laws = [term for term in terms if isinstance(term, ON_NODES)]
        self._parts += [(term.share, term.share.copy(), term.grows) for term in self.laws]
        for term in terms:
            if isinstance(term, Drag):
                self._parts += [(x, x.copy(), np.ones(x.size)) for x in (getattr(term, name) for name in COEFFICIENTS)]
                self._air.append((term.air, model.dragged.table.air))
        self._dragged = model.dragged

    def put(self, t: float, factor: float, shares: Array | None = None) -> None:
        """Set the forces for a time, s, and a load factor; shares: float64 [K] of nodes with loads that turn, where these have
        factors of their own."""
        for out, whole, grows in self._parts:
            out[:] = whole * np.where(grows == 1, factor, 1.0)
        for term, whole in zip(self.laws, (x[1] for x in self._parts)) if shares is not None else ():
            term.share[:] = whole * shares
        for air, given in self._air if self._dragged is not None and self._dragged.timed else ():
            factors = self._dragged.factors_at(t)
            air[:] = given * np.repeat(factors, air.size // factors.size)


class Corner(NamedTuple):
    """A slider on the curve that leads over a corner of its switch, and between which arc lengths it may go there, m."""

    slider: int
    curve: int
    limits: tuple[float, float]


def put_limits(model: Model, state: State, corner: Corner | None, *all_terms: tuple[Any, ...] | None) -> None:
    """Let sliders that are not held move up to the ends and stops of the tracks on which they are, and one of them over a
    corner."""
    changes = model.spans or (model.slider_forces is not None and model.slider_forces.lets_go)
    for terms in all_terms if changes else ():
        for term in terms or ():
            if isinstance(term, Sliding):
                model.put_limits(term.limits, state.s, state.history)
                if model.corners:
                    term.sliders.curve[:] = model.sliders.curve
                if corner is not None:
                    term.sliders.curve[corner.slider], term.limits[corner.slider, :2] = corner.curve, corner.limits
                if model.spans and isinstance(term.along, Along):
                    term.along.stops[:, :2] = model.slider_forces.elastic(state.s, model.along_of(state.history))


def system_of(model: Model, method: Any, contact: Contact | FactoredContact | None, solver: Any, state: State, work: Work,
              width: int | None = None) -> System:
    """Form the record of what all terms share; method: a named tuple of kernels/terms.py, or Alpha; solver: the tables of one
    that compiled code calls, or None; width: columns of the panel of right-hand sides, default those of the model."""
    width = model.width if width is None else width
    return System(Unknown(0), model.pattern.row_of, model.spinless, state, width, model.length, work, model.dofs, method,
                  NoContact() if contact is None else contact, SolverOutside() if solver is None else solver)
