"""Terms of a compiled scene, and the questions that a step asks them.

A scene is a tuple of terms, named tuples of arrays: beams of each strain set, the nodes eliminated inside elements, bodies, tied
nodes, held unknowns, sliders, loads that change. Features that a scene lacks are not in its tuple, and their code is not
compiled. The step (loop.py) calls the generic functions below for all terms, through a table of addresses (questions.py); each
file of physics registers implementations of those that concern it. `System` holds data that all terms share; a class that reads
more of it than `WithMethod` has says so by its attribute `reads`.

Order of the tuple: sliders, which act on nodes inside elements, elements, bodies; then terms that gather the equations of nodes,
ties and held unknowns.

Arrays: q, q_mid, q_end [12 N], in a plane [4 N]; dphi, theta, off_out [3 N], in a plane dphi, off_out [2 N], theta [N]; row_of,
spinless [N]; r [8 (rows + 1)]; blocks [8 n (blocks + 1)]; panel [rows, n, width] flat; scratch [*]; counts_out [4 or 5]; out [1].
"""
from __future__ import annotations

from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.jit.calls import Unknown
from fastbeam.kernels.jit.decorators import inlined
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.state import State, Work


class NoTies(NamedTuple):
    """Placeholder for a scene without tied nodes."""


class NoContact(NamedTuple):
    """Placeholder for a scene without constraints: all unknowns are those of nodes."""


class SolverOutside(NamedTuple):
    """Marker of a system that a library called from Python solves."""


# --- methods: equations of an iteration ---------------------------------------------------------------------------------
class Conserving(NamedTuple):
    """Energy-momentum conserving step, theory.md 4."""


class Midpoint(NamedTuple):
    """Implicit midpoint rule, theory.md 7."""


class Equilibrium(NamedTuple):
    """Statics, theory.md 8: half the tangent, at the present configuration."""


class AtRest(NamedTuple):
    """Residual at the present configuration for given second rates, without contact forces."""


class System(NamedTuple):
    """Data that all terms share: tables of nodes, state, work arrays, method and solver."""

    calls: Unknown        # table of the questions to the scene as a whole (jit/calls.py)
    row_of: np.ndarray    # int64 [N]: row of every node
    spinless: np.ndarray  # int8 [N]: 1 where a triad does not turn
    state: State
    width: int            # columns of the panel of right-hand sides
    length: float         # size of the scene, m
    work: Work
    # from here on scenes differ in more than sizes of arrays
    dofs: Any             # dimensions.Space or dimensions.Plane
    method: Any           # Conserving, Midpoint, generalized_alpha.Alpha, Equilibrium or AtRest
    contact: Any          # slider.Contact or NoContact
    solver: Any           # chain.Elimination, pardiso.PardisoTables or SolverOutside


# the first fields of `System`, for code that reads no more of it: loops, most terms, constraints; `Unknown` stands for the others
Shared = namedtuple("Shared", System._fields[:7])
WithMethod = namedtuple("WithMethod", System._fields[:9])
WithContact = namedtuple("WithContact", System._fields[:10])
for part in (Shared, WithMethod, WithContact, System):
    part.stays_in_memory = True  # type: ignore[attr-defined]
    part.stands_for = dict.fromkeys(System._fields[len(part._fields):], "calls")  # type: ignore[attr-defined]
Work.stays_in_memory = State.stays_in_memory = True  # type: ignore[attr-defined]


class LoadVectors(NamedTuple):
    """K load vectors: the first one, which has gravity where there is some, and the rows that the others touch, those of each in
    their order."""

    first: np.ndarray    # float64 [8 (rows + 1)], empty where there are no loads
    vector: np.ndarray   # int64 [M]: number of a vector, from 1 on
    row: np.ndarray      # int64 [M]: a row that it touches
    value: np.ndarray    # float64 [8 M]: what it has there

    @property
    def entries(self) -> np.ndarray:
        """Entries of all vectors, [*, 8]."""
        return np.concatenate((self.first.reshape(-1, 8), self.value.reshape(-1, 8)))


class Loads(NamedTuple):
    """Loads that change in time: vectors and their mean factors over every substep."""

    vectors: LoadVectors
    factors: np.ndarray   # float64 [substeps, K]


# --- asked of every term ------------------------------------------------------------------------------------------------
@generic
def put_loads(term, system, k):
    """Store the loads of substep k in work.f_ext."""


@generic
def first_guess(term, system, h, c):
    """Predict the unknowns of the term for a step of size h, after the nodes; c as in `nodes.extrapolation`."""


@generic
def clear(term, method, system):
    """Prepare the assembly of residual and tangent, when coordinates in the middle and at the end of the step are known."""


@generic
def assemble(term, method, system, h):
    """Add residual and tangent of the term."""


@generic
def scale_solutions(term, method, system):
    """Halve solutions that the term has stored, after assembly, if the method halves its equations."""


@generic
def carry_columns(term, system):
    """Carry the border columns of sliders from eliminated and tied nodes to the nodes that the solver sees, like the residual."""


@generic
def complete_columns(term, system):
    """Complete the solutions of all columns for eliminated and tied nodes; last term first."""


@generic
def push_increments(term, system):
    """Set the rows of increments of tied nodes from those of their master nodes."""


@generic
def recover(term, system, share):
    """Set the rows of increments of eliminated nodes, `share` times their solution; last term first."""


@generic
def take_unknowns(term, system):
    """Add the increments in work.y to forces and own unknowns of constraints; contact.augmented[3]: the largest of a length."""


@generic
def follow_nodes(term, system):
    """Update the term after the increments of the nodes."""


@generic
def account(term, system, h):
    """Add work to `State.history`: a step of size h has converged, the state is still the one before."""


@generic
def accept(term, method, system):
    """Accept a converged step."""


@generic
def is_regular(term, system):
    """Return whether the solver may run: False after a singular elimination, or with an impossible length of rope."""


@generic
def is_settled(term, system):
    """Return whether the iteration may end when its increments are small: False while a constraint has a gap."""


@generic
def within_limits(term, system, counts_out):
    """Return whether a next step can begin from the state after this one; counts_out[3]: the slider that has left its beam."""


@generic
def potential_energy(term, q, dofs, out):
    """Add the energy, J, that the term stores at coordinates q to out[0]."""


# --- by the kind of nodes -----------------------------------------------------------------------------------------------
@generic
def predict_nodes(dofs, state, work, spinless, h, c, first, last):
    """Predict the nodes from `first` to before `last`."""


@generic
def spread_nodes(dofs, method, state, work, h, first, last):
    """Update coordinates of these nodes in the middle and at the end of the step, and second rates, for terms that need them."""


@generic
def move_nodes(dofs, row_of, work, first, last, scratch):
    """Add the rows of increments to these nodes. Returns the largest of positions and of spins."""


@generic
def axes_of(dofs):
    """Return the number of components of a position."""


@generic
def advance_nodes(dofs, method, state, work, h, first, last, scratch):
    """Accept the increments of these nodes."""


# --- by the kind of tied nodes ------------------------------------------------------------------------------------------
@generic
def tie_increments(ties, q, theta, dphi, off_out):
    """Set the increments of a step from q on of the tied nodes from those of their masters; off_out: their distance from the
    places to which the rows of increments led them."""


@generic
def apply_ties(ties, k0, k1, p0, p1, q_mid, q_end, r, blocks, scratch):
    """Move residual rows and tangent blocks of tied nodes to their targets: r <- L(q_mid)^T r, K <- L(q_mid)^T K L(q_end),
    plus the change of L with the target's spin. Rows of the tied nodes k0 to before k1, then the moves p0 to before p1."""


@generic
def pull_tied_columns(ties, q_mid, panel, width):
    """Move border columns on rows of tied nodes to their masters."""


@generic
def push_tied_columns(ties, q_end, panel, pitch, width, columns):
    """Set solutions on rows of tied nodes from their masters, for `columns` columns: `pitch` doubles a row, `width` an
    unknown."""


# --- by the method ------------------------------------------------------------------------------------------------------
@generic
def begin_step(method, terms, system, h):
    """Predict all unknowns of a step."""


@generic
def save(method):
    """Save the data that the method carries besides the state, before a step."""


@generic
def restore(method):
    """Restore the data that `save` kept."""


@generic
def scale_residual(method, system):
    """Halve the residual where the method forms half its tangent and assembles the whole residual."""


@generic
def node_share(method):
    """Return the increments per solution of the equations: -1, or -1/2 where half the tangent is formed."""


@generic
def inner_share(method):
    """Return the increments per stored solution of eliminated nodes, as `node_share`."""


@generic
def clear_increments(method, system):
    """Prepare the method before increments are added."""


@generic
def take_increments(method, system):
    """Update the method after increments were added."""


# --- by contact and solver ----------------------------------------------------------------------------------------------
@generic
def begin_contact(contact):
    """Prepare the constraints before the first iteration of a step."""


@generic
def fill(contact, terms, system):
    """Fill the right-hand sides of the panel."""


@generic
def close(contact, terms, system):
    """Set the rows of increments from the solved panel. Return (0, largest increment of s), or (-1 - k, 0) if slider k makes the
    system singular."""


@generic
def begin_solver(solver):
    """Prepare the solver before the first solution of a step."""


@generic
def solve(solver, contact, system):
    """Solve the panel; return False if the matrix is singular."""


@inlined
def known(work):
    """Return the work of a law, or 0 if the law fails when a step is done, which ends the run."""
    return work if work == work else 0.0
