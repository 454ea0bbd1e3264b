"""Nodes and constraints solved together, theory.md 9: how a step fills, solves and closes its equations with sliders as rows."""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .._jit import kernel
from .beam import ElementTables
from .constraint_entries import (add_inner, carry, clear_held_columns, put_entries, recover_inner_rows, start_blocks, start_inner)
from .constraint_fill import update_order
from .constraint_rows import Couplings, Order, Touched
from .constraint_solve import Factors, eliminate, substitute, take_solution
from .inner import Inner
from .nodes import Held
from .planar_nodes import PlanarTies
from .slider import ContactInRows
from .terms import close, fill, push_increments, solve, take_unknowns
from .ties import Ties


class Constraints(NamedTuple):
    """Everything about the rows of constraints but their entries: the solver of a system with contact in rows."""

    couplings: Couplings
    touched: Touched
    order: Order
    factors: Factors
    buffer: np.ndarray      # float64: columns and lines of the constraints of an element
    inner: Any              # inner.Inner; all of these are None where there are none
    ties: Any               # ties.Ties or planar_nodes.PlanarTies
    held: Any               # nodes.Held
    simo: Any               # beam.ElementTables of strain set (2.2)
    green: Any              # of strain set (2.1)


# a value of one of these fills a call with its arrays, seven words each
for _record in (Constraints, Couplings, Touched, Order, Factors, ContactInRows, Inner, Ties, PlanarTies, Held, ElementTables):
    _record.stays_in_memory = True  # type: ignore[attr-defined]


@kernel
def fill_constraints(contact, inner, ties, held, rows, r, q_mid, q_end, size):
    """Residual r and entries of all constraints into the blocks, in an order that is found again where they touch other rows.
    Returns False where there is not enough room: then `factors.failed[0]` is 1."""
    if contact.full[0] != 0 or not update_order(contact, inner, ties, rows.couplings, rows.touched, rows.order,
                                                rows.factors.store.shape[0], rows.buffer.shape[0], size):
        rows.factors.failed[0] = 1
        return False
    start_blocks(contact, rows.couplings, rows.order, rows.factors, r, size)
    put_entries(contact, rows.couplings, rows.touched, rows.factors, size)
    if inner is not None:
        carry(contact, inner, ties, rows.couplings, rows.touched, rows.order, rows.factors, rows.buffer, q_mid, q_end, size)
    if held is not None:
        clear_held_columns(held, rows.touched, rows.factors, rows.couplings.diagonal.shape[0])
    return True


@kernel
def solve_constraints(contact, rows, force, x_out, y_out, size):
    """Solve; increments of the nodes that the solver sees in rows of x_out, unknowns of constraints in y_out. Returns False at a
    singular block: `factors.failed[1]` is the constraint that has it, or -1 where a node has it."""
    if not eliminate(rows.couplings, rows.order, rows.factors, contact, force, size):
        return False
    substitute(rows.order, rows.factors, size)
    take_solution(rows.couplings, rows.order, rows.factors, contact, force, x_out, y_out, size)
    return True


@kernel
def complete_inner(simo, green, contact, inner, rows, y, x_out, scratch, size):
    """Increments of inner nodes of elements from those of the end nodes and of the constraints."""
    if inner is not None:
        start_inner(inner, x_out, size)
        add_inner(contact, inner, rows.touched, rows.couplings, y, rows.buffer, x_out, size)
        if simo is not None:
            recover_inner_rows(simo, inner, x_out, scratch, size)
        if green is not None:
            recover_inner_rows(green, inner, x_out, scratch, size)


@fill.register(ContactInRows)
@kernel
def fill_rows(contact, terms, system):
    rows, work = system.solver, system.work
    fill_constraints(contact, rows.inner, rows.ties, rows.held, rows, work.r, work.q_mid, work.q_end, system.size)


@solve.register(Constraints)
@kernel
def solve_rows(rows, contact, system):
    """A constraint without a pivot is told by `close`."""
    if rows.factors.failed[0] != 0:
        return False
    if solve_constraints(contact, rows, system.state.force, system.work.line.x, system.work.y, system.size):
        return True
    return rows.factors.failed[1] >= 0


@close.register(ContactInRows)
@kernel
def close_rows(contact, terms, system):
    rows, work = system.solver, system.work
    if rows.factors.failed[1] >= 0:
        return -1.0 - rows.factors.failed[1], 0.0
    push_increments.each(terms, system)
    complete_inner(rows.simo, rows.green, contact, rows.inner, rows, work.y, work.line.x, work.scratch, system.size)
    contact.augmented[3] = 0.0
    take_unknowns.each(terms, system)
    return 0.0, contact.augmented[3]
