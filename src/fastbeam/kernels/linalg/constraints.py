"""Solution of nodes and constraints together, theory.md 9: fill, solve and close of a step with sliders as rows.

Arrays: r, x_out [8 (rows + 1)]; q_mid, q_end [12 N], in a plane [4 N]; force [*], forces of all constraints one after the other;
y_out [7 S], their unknowns; scratch [*].
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.beams.beam_term import Beams
from fastbeam.kernels.beams.element_loop import ElementTables
from fastbeam.kernels.beams.inner_nodes import Inner, NoInner
from fastbeam.kernels.beams.nodes import Held, NoHeld
from fastbeam.kernels.beams.planar_nodes import PlanarTies
from fastbeam.kernels.beams.ties import Ties
from fastbeam.kernels.contact.moving_beam import MovingBeam
from fastbeam.kernels.contact.moving_mesh import follow_places
from fastbeam.kernels.entries.dense import ContactInRows
from fastbeam.kernels.entries.factored import FactoredContact
from fastbeam.kernels.jit.decorators import kernel, separate
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.linalg.constraint_entries import (
    add_inner,
    carry,
    clear_held_columns,
    put_entries,
    recover_inner_rows,
    start_blocks,
    start_inner,
)
from fastbeam.kernels.linalg.constraint_fill import update_order
from fastbeam.kernels.linalg.constraint_rows import Couplings, Order, Touched
from fastbeam.kernels.linalg.constraint_solve import Factors, eliminate, substitute, take_solution
from fastbeam.kernels.terms import close, fill, push_increments, solve, take_unknowns


class Constraints(NamedTuple):
    """Solver of a system with contact in rows: all data of the rows of constraints but their entries."""

    couplings: Couplings
    touched: Touched
    order: Order
    factors: Factors
    buffer: np.ndarray      # float64 [*]: columns and lines of the constraints of an element
    inner: Any              # inner_nodes.Inner or NoInner
    ties: Any               # ties.Ties, planar_nodes.PlanarTies or NoTies
    held: Any               # nodes.Held or NoHeld


# passed as addresses: by value each of these records would add all its arrays to a call, seven words an array
for _record in (Constraints, Couplings, Touched, Order, Factors, ContactInRows, FactoredContact, Inner, Ties, PlanarTies, Held,
                ElementTables):
    _record.stays_in_memory = True  # type: ignore[attr-defined]


@generic
def carry_entries(inner, contact, solver, q_mid, q_end, dofs):
    """Carry entries of constraints on nodes that are eliminated inside elements to the ends."""


@carry_entries.register(NoInner)
@kernel
def carry_nothing(inner, contact, solver, q_mid, q_end, dofs):
    pass


@carry_entries.register(Inner)
@kernel
def carry_to_ends(inner, contact, solver, q_mid, q_end, dofs):
    carry(contact, inner, solver.ties, solver.couplings, solver.touched, solver.order, solver.factors, solver.buffer, q_mid,
          q_end, dofs)


@generic
def clear_columns(held, solver):
    """Clear columns of constraints on prescribed unknowns."""


@clear_columns.register(NoHeld)
@kernel
def clear_no_columns(held, solver):
    pass


@clear_columns.register(Held)
@kernel
def clear_columns_of_held(held, solver):
    clear_held_columns(held, solver.touched, solver.factors, solver.couplings.diagonal.shape[0])


@separate
def fill_constraints(contact, solver, r, q_mid, q_end, dofs):
    """Fill the blocks with residual r and entries of all constraints, in an order that is found again if they touch other rows.
    Return False if there is not enough room: then `factors.failed[0]` is 1."""
    if contact.full[0] != 0 or not update_order(contact, solver.inner, solver.ties, solver.couplings, solver.touched,
                                                solver.order, solver.factors.store.shape[0], solver.buffer.shape[0], dofs):
        solver.factors.failed[0] = 1
        return False
    start_blocks(contact, solver.couplings, solver.order, solver.factors, r, dofs)
    put_entries(contact, solver.couplings, solver.touched, solver.order, solver.factors, dofs)
    carry_entries.call(solver.inner, contact, solver, q_mid, q_end, dofs)
    clear_columns.call(solver.held, solver)
    return True


@kernel
def solve_constraints(contact, solver, force, x_out, y_out, dofs):
    """Solve; increments of the nodes that the solver sees go to rows of x_out, unknowns of constraints to y_out. Return False at
    a singular block: `factors.failed[1]` is the constraint that has it, or -1 if a node has it."""
    if not eliminate(solver.couplings, solver.order, solver.factors, contact, force, dofs):
        return False
    substitute(solver.order, solver.factors, dofs)
    take_solution(solver.couplings, solver.order, solver.factors, contact, force, x_out, y_out, dofs)
    return True


@generic
def begin_inner(inner, contact, solver, work, dofs):
    """Store rows of nodes that were eliminated inside elements, from their stored solutions and the unknowns of constraints."""


@begin_inner.register(NoInner)
@kernel
def begin_no_inner(inner, contact, solver, work, dofs):
    pass


@begin_inner.register(Inner)
@kernel
def begin_all_inner(inner, contact, solver, work, dofs):
    start_inner(inner, work.increment.x, dofs)
    add_inner(contact, inner, solver.touched, solver.couplings, work.y, solver.buffer, work.increment.x, dofs)


@generic
def recover_inside(term, system):
    """Recover increments of nodes that were eliminated inside elements, from their ends and the numbers in their own rows."""


@generic
def recover_elements(inner, tables, system, scratch):
    """Recover increments of nodes inside all elements of some tables."""


@recover_elements.register(NoInner)
@kernel
def recover_no_elements(inner, tables, system, scratch):
    pass


@recover_elements.register(Inner)
@kernel
def recover_all_elements(inner, tables, system, scratch):
    recover_inner_rows(tables, inner, system.work.increment.x, scratch, system.dofs)


@recover_inside.register(Beams)
@kernel
def recover_beams(beams, system):
    recover_elements.call(beams.inner, beams.tables, system, system.work.scratch)


@recover_inside.register(MovingBeam)
@kernel
def recover_moving(beam, system):
    follow_places(beam, system)
    recover_elements.call(beam.inner, beam.tables, system, beam.scratch)


@fill.register(ContactInRows)
@fill.register(FactoredContact)
@kernel
def fill_constraint_rows(contact, terms, system):
    solver, work = system.solver, system.work
    fill_constraints(contact, solver, work.r, work.q_mid, work.q_end, system.dofs)


@solve.register(Constraints)
@kernel
def solve_constraint_rows(solver, contact, system):
    """Solve; return True also if a constraint has no pivot above its limit: `close` reports which one it is."""
    if solver.factors.failed[0] != 0:
        return False
    if solve_constraints(contact, solver, system.state.force, system.work.increment.x, system.work.y, system.dofs):
        return True
    return solver.factors.failed[1] >= 0


@close.register(ContactInRows)
@close.register(FactoredContact)
@kernel
def close_constraint_rows(contact, terms, system):
    solver, work = system.solver, system.work
    if solver.factors.failed[1] >= 0:
        return -1.0 - solver.factors.failed[1], 0.0
    push_increments.each(terms, system)
    begin_inner.call(solver.inner, contact, solver, work, system.dofs)
    recover_inside.each(terms, system)
    contact.augmented[3] = 0.0
    take_unknowns.each(terms, system)
    return 0.0, contact.augmented[3]
