"""Motion of nodes in the element loops, by method: a named tuple of arrays for each, with the reference strains of the run.

`method` is a named tuple without items, by which the operations below choose: that of terms.py, or `AtEnd` for generalised alpha.

Arrays: constants [*], the tables of a group, and scratch [*], its numbers in lanes: layout.py has their places.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.beams.generalized_alpha import Alpha
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.state import LastIncrement
from fastbeam.kernels.terms import AtRest, Conserving, Equilibrium, Midpoint


class AtEnd(NamedTuple):
    """Method that evaluates everything at the end of the step, theory.md 7."""


AT_END = AtEnd()


class OverStep(NamedTuple):
    """Step from q by dphi and increment.theta: the conserving step and the midpoint rule."""

    method: Any
    q: np.ndarray          # float64 [12 N], in a plane [4 N]: at the start of the step
    dphi: np.ndarray       # float64 [3 N], [2 N]: increments of the positions
    v: np.ndarray          # float64 [12 N], [4 N]: rates at the start
    increment: LastIncrement
    reference_strains: np.ndarray  # float64 [*]: as `Work.reference_strains`
    h: float               # s
    mass_factor: float     # factor of the mass matrix in the tangent: 2/h^2


class ToEnd(NamedTuple):
    """End of a step of generalised alpha."""

    method: Any
    q: np.ndarray          # float64 [12 N]: at the start of the step
    dphi: np.ndarray       # float64 [3 N]
    u: np.ndarray          # float64 [12 N]: second rates at the end
    spin_rate: np.ndarray  # float64 [18 N]: derivatives of second rates of d2, d3 by the spins
    increment: LastIncrement
    reference_strains: np.ndarray  # float64 [*]
    mass_factor: float     # half of d(second rates)/d(displacements), as the tangent is halved


class Resting(NamedTuple):
    """Shape with given second rates."""

    method: Any
    q: np.ndarray          # float64 [12 N]
    u: np.ndarray          # float64 [12 N]: second rates
    increment: LastIncrement
    reference_strains: np.ndarray  # float64 [*]
    mass_factor: float     # 0


class Still(NamedTuple):
    """Shape in equilibrium."""

    method: Any
    q: np.ndarray          # float64 [12 N], in a plane [4 N]
    increment: LastIncrement
    reference_strains: np.ndarray  # float64 [*]
    mass_factor: float     # 0


@generic
def motion(method, state, work, h):
    """Return the motion that a method evaluates."""


@motion.register(Conserving)
@motion.register(Midpoint)
@kernel
def motion_over_step(method, state, work, h):
    return OverStep(method, state.q, work.dphi, state.v, work.increment, work.reference_strains, h, 2.0 / (h * h))


@motion.register(Alpha)
@kernel
def motion_to_end(alpha, state, work, h):
    return ToEnd(AT_END, state.q, work.dphi, work.u, alpha.spin_rate, work.increment, work.reference_strains,
                 0.5 * alpha.factor[1])


@motion.register(AtRest)
@kernel
def motion_at_rest(method, state, work, h):
    return Resting(method, state.q, work.u, work.increment, work.reference_strains, 0.0)


@motion.register(Equilibrium)
@kernel
def no_motion(method, state, work, h):
    return Still(method, state.q, work.increment, work.reference_strains, 0.0)


# --- asked of a motion --------------------------------------------------------------------------------------------------
@generic
def gather_ends(dofs, motion, tables, no, scratch, qo, uo):
    """Gather coordinates of 8 nodes in the middle and at the end of the step into lanes from qo on, and their second rates at
    uo."""


@generic
def gather_increment(dofs, motion, tables, no, scratch, end, lo):
    """Gather the shape z and the increment x of theory.md (4.6): coordinates of 8 nodes before the last increment into lanes from
    lo on and, behind them, that increment, from their coordinates at `end`."""


@generic
def gather_spin_rates(motion, tables, no, nn, scratch, at):
    """Gather derivatives of second rates by spins into lanes."""


@generic
def needs_increment(motion):
    """Return whether the last increment has to be gathered. Before the first increment of a step there is none, and the shape at
    the start follows from those in the middle and at the end."""


# --- asked of a method --------------------------------------------------------------------------------------------------
@generic
def add_inertia(method, constants, scratch, at, dofs):
    """Add M u on the coordinates of every node."""


@generic
def put_forms(method, strains, scratch, zo):
    """Form the quadratic forms of the two shapes whose strains are averaged, the first at STRAINS, the second at the offset that
    is returned: start and end of a step, twice the middle for the midpoint rule."""


@generic
def columns(method):
    """Return the offset of z of the shape to which the columns of the tangent belong: MIDDLE or END."""


@generic
def increment_of_tangent(method, scratch, zo, gathered):
    """Form BEFORE and STEP for the shape of `columns`: the shape before the last increment, and that increment. Return whether
    there is one."""


@generic
def share_of_end(method):
    """Return the derivative of the strains that make the stresses by those of the shape of `columns`: 1/2 if they are means over
    a step."""


@generic
def pair_mass_factor(method, mass_factor):
    """Return the factor of the mass matrix in the tangent; 0 if `add_spin_rates` adds the tangent of inertia."""


@generic
def add_spin_rates(method, constants, scratch, at, mass_factor):
    """Add the tangent of the inertia forces for methods in which it is not a multiple of the mass matrix (generalised alpha)."""
