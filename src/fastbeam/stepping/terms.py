"""What a run hands to compiled code: the terms of a model and the record of what they share (kernels/terms.py)."""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.beams.beam_term import Beams
from fastbeam.kernels.beams.inner_nodes import Inner, NoInner
from fastbeam.kernels.beams.moving_supports import MovedRows, Prescribed
from fastbeam.kernels.beams.section_laws import ELASTIC, KELVIN_VOIGT
from fastbeam.kernels.beams.strain_measures import GreenLagrange, SimoReissner
from fastbeam.kernels.contact.moving_beam import MovingBeam
from fastbeam.kernels.contact.sleeve import Rubbing, Sleeves
from fastbeam.kernels.contact.sleeve_twist import Twist
from fastbeam.kernels.contact.slider import NoForceAlong, NoSleeves, Sliding
from fastbeam.kernels.contact.slider_forces import Along
from fastbeam.kernels.entries.dense import Contact
from fastbeam.kernels.entries.factored import FactoredContact
from fastbeam.kernels.forces.drag import Drag
from fastbeam.kernels.forces.force_element import ForceElements
from fastbeam.kernels.forces.line_force import LineForces
from fastbeam.kernels.forces.planar_follower import PlanarFollowers
from fastbeam.kernels.forces.user_force import UserForces
from fastbeam.kernels.forces.winch import Winches
from fastbeam.kernels.state import State, Work
from fastbeam.kernels.terms import NoContact, NoTies, SolverOutside, System
from fastbeam.model.contact.sleeve_twist import sleeves_of_run
from fastbeam.model.joints.drives import JointsOfRun
from fastbeam.model.model import Model
from fastbeam.model.workspace import moving_of_run

Array = np.ndarray
# tables of forces by laws of the triad
LAWS = UserForces, PlanarFollowers
# coefficients of drag
DRAG = "normal", "tangential", "linear"


def strain_sets(model: Model, static: bool = False) -> tuple[SimoReissner, GreenLagrange]:
    """The strain sets with the laws of the sections of a model; at rest all are elastic."""
    damped = () if static or model.damped is None else model.damped.strains
    simo, green = (KELVIN_VOIGT if name in damped else ELASTIC for name in ("simo_reissner", "green_lagrange"))
    return SimoReissner(simo), GreenLagrange(green)


def terms_of(model: Model, inner: Inner | None, static: bool = False, along: Along | None = None,
             prescribed: Prescribed | None = None, law_work: Array | None = None,
             motion: JointsOfRun | None = None, known: bool = False) -> tuple[Any, ...]:
    """All that acts in a model, in the order of kernels/terms.py.

    Parameters
    ----------
    model : Model
    inner : Inner or None
        Eliminated nodes with the work arrays of this run.
    static : bool
        Only what has a part in statics.
    along : Along, optional
        Forces along the beam on sliders, with the work arrays of this run.
    prescribed : Prescribed, optional
        Supports that move, with the work arrays of this run.
    law_work : float64, optional
        The work array of user forces in this run.
    motion : JointsOfRun, optional
        What joints leave free, with the work arrays of this run.
    known : bool
        Without equations for the forces that hold it, which are those of the state.
    """
    terms: list[Any] = []
    if model.sliders is not None:
        sleeves = NoSleeves() if model.sleeves is None else sleeves_of_run(model.sleeves, static)
        # sliders of a run go over corners of switches on curves of their own
        sliders = model.sliders._replace(curve=model.sliders.curve.copy()) if model.corners else model.sliders
        terms.append(Sliding(model.curves, sliders, NoTies() if model.ties is None else model.ties,
                             model.put_limits(np.zeros((model.n_sliders, 3)), model.s0),
                             NoForceAlong() if along is None else along,
                             sleeves))
        if isinstance(sleeves, Sleeves) and not static:
            terms.append(sleeves)
            if isinstance(sleeves.twist, Twist):
                terms.append(Rubbing(sleeves, terms[0]))
    if inner is not None:
        terms.append(inner)
    losses: list[Any] = []
    for strains, tables in zip(strain_sets(model, static), (model.simo, model.green)):
        if tables is not None:
            terms.append(Beams(strains, tables, NoInner() if inner is None else inner))
            if strains.law is KELVIN_VOIGT:
                losses.append(model.damped.term(strains, tables, model.loss_place))
    held = model.static_held if static else model.held
    bodies, loads = (None, None) if static else (model.bodies, model.load_work())
    reactions = None if prescribed is None else MovedRows(prescribed)
    links = [x._replace(work=law_work) if isinstance(x, (*LAWS, ForceElements, LineForces, Winches)) else x for x in model.links]
    # shares are those of a run: paths change them
    links = [x._replace(share=x.share.copy()) if isinstance(x, LAWS) else x for x in links]
    links = [moving_of_run(x) if isinstance(x, MovingBeam) else x for x in links]
    free: tuple[Any, ...] = ()
    if motion is not None:
        free = motion.known if known else motion.static_terms if static else motion.terms
    drag = None if static and not model.blows else model.drag
    if drag is not None and static:
        # these and the air are those of a load factor and a time
        drag = drag._replace(**{name: getattr(drag, name).copy() for name in (*DRAG, "air")})
    elif drag is not None and model.dragged.timed:
        # its air is that of a run
        drag = drag._replace(air=drag.air.copy())
    if drag is not None and model.dragged.windy and law_work is not None:
        drag = drag._replace(wind=drag.wind._replace(work=law_work))
    added = None if static else model.added_tables
    others = prescribed, loads, bodies, drag, added, *links, *free, model.ties, reactions, held
    return (*terms, *losses, *(x for x in others if x is not None))


class Growing:
    """Forces by laws, and of moving air, in the terms of a model at rest: what they are at a load factor and a time.

    Parameters
    ----------
    model : Model
    terms : tuple
        Of a run in statics.
    """

    def __init__(self, model: Model, terms: tuple[Any, ...]) -> None:
        # arrays that are multiplied, whole ones, and 1 where they grow
        self._parts: list[tuple[Array, Array, Any]] = []
        self._air: list[tuple[Array, Array]] = []
        self.laws = [term for term in terms if isinstance(term, LAWS)]
        self._parts += [(term.share, term.share.copy(), term.grows) for term in self.laws]
        for term in terms:
            if isinstance(term, Drag):
                self._parts += [(x, x.copy(), np.ones(x.size)) for x in (getattr(term, name) for name in DRAG)]
                self._air.append((term.air, model.drag.air))
        self._dragged = model.dragged

    def put(self, t: float, factor: float, shares: Array | None = None) -> None:
        """At a time, s; shares: float64 [K] of nodes with loads that turn, where these have factors of their own."""
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
    """Let sliders on switches move on the tracks on which they are, to the stops there, and one of them over a corner."""
    for terms in all_terms if model.spans else ():
        for term in terms or ():
            if isinstance(term, Sliding):
                model.put_limits(term.limits, state.s, state.history)
                if model.corners:
                    term.sliders.curve[:] = model.sliders.curve
                if corner is not None:
                    term.sliders.curve[corner.slider], term.limits[corner.slider, :2] = corner.curve, corner.limits
                if isinstance(term.along, Along):
                    term.along.stops[:, :2] = model.slider_forces.elastic(state.s, model.along_of(state.history))


def system_of(model: Model, method: Any, contact: Contact | FactoredContact | None, solver: Any, state: State,
              work: Work) -> System:
    """The record of what all terms share; method: a named tuple of kernels/terms.py, or Alpha; solver: the tables of one that
    compiled code calls, or None."""
    return System(model.dofs, method, NoContact() if contact is None else contact, SolverOutside() if solver is None else solver,
                  model.pattern.row_of, model.spinless, state, work, model.width, model.length)
