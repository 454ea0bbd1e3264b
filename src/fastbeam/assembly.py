"""What a run hands to compiled code: the terms of a model and the record of what they share (kernels/terms.py)."""
from __future__ import annotations

from typing import Any

from .kernels.along import Along
from .kernels.beams import Beams
from .kernels.joint_motion import JointForces, JointMotion
from .kernels.inner import Inner, NoInner
from .kernels.slider import Contact, NoForceAlong, NoSleeves, Sliding
from .kernels.strain_sets import GREEN_LAGRANGE, SIMO_REISSNER
from .kernels.terms import NoContact, NoTies, SolverOutside, System
from .kernels.work import State, Work
from .model import Model


def terms_of(model: Model, inner: Inner | None, static: bool = False, along: Along | None = None,
             motion: JointMotion | None = None) -> tuple[Any, ...]:
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
    motion : JointMotion, optional
        What joints leave free, with the work arrays of this run.
    """
    terms: list[Any] = []
    if model.sliders is not None and not static:
        terms.append(Sliding(model.curves, model.sliders, NoTies() if model.ties is None else model.ties, model.slider_limits,
                             NoForceAlong() if along is None else along,
                             NoSleeves() if model.sleeves is None else model.sleeves))
        if model.sleeves is not None:
            terms.append(model.sleeves)
    if inner is not None:
        terms.append(inner)
    for strains, tables in ((SIMO_REISSNER, model.simo), (GREEN_LAGRANGE, model.green)):
        if tables is not None:
            terms.append(Beams(strains, tables, NoInner() if inner is None else inner))
    held = model.static_held if static else model.held
    bodies, loads = (None, None) if static else (model.bodies, model.load_work())
    forces = JointForces(motion) if motion is not None and model.motions.acts else None
    return (*terms, *(x for x in (loads, bodies, *model.links, forces, None if static else motion, model.ties, held)
                      if x is not None))


def system_of(model: Model, method: Any, contact: Contact | None, solver: Any, state: State, work: Work) -> System:
    """The record of what all terms share; method: a named tuple of kernels/terms.py, or Alpha; solver: the tables of one that
    compiled code calls, or None."""
    return System(model.dofs, method, NoContact() if contact is None else contact, SolverOutside() if solver is None else solver,
                  model.pattern.row_of, model.spinless, state, work, model.width, model.length)
