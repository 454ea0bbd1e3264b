"""Entries of tables of calls (jit/calls.py): one kernel for every question of a step, compiled for the types of a term and of the
part of the system that it reads.
"""
from __future__ import annotations

from fastbeam.kernels import loop  # noqa: F401
from fastbeam.kernels.contact import slider  # noqa: F401
from fastbeam.kernels.entries.dense import Contact, ContactAtRest, ContactInMatrix, ContactInRows, ContactOfCarriers
from fastbeam.kernels.entries.factored import FactoredContact
from fastbeam.kernels.jit.calls import CALLS, COUNTS, INTEGER, NUMBER, PAIR, TRUTH, contents
from fastbeam.kernels.jit.decorators import table_entry
from fastbeam.kernels.linalg.constraints import recover_inside
from fastbeam.kernels.terms import (
    NoContact,
    accept,
    account,
    advance_nodes,
    assemble,
    axes_of,
    begin_contact,
    begin_solver,
    begin_step,
    carry_columns,
    clear,
    clear_increments,
    close,
    complete_columns,
    fill,
    first_guess,
    follow_nodes,
    is_regular,
    is_settled,
    move_nodes,
    push_increments,
    put_loads,
    recover,
    restore,
    save,
    scale_residual,
    scale_solutions,
    solve,
    spread_nodes,
    take_increments,
    take_unknowns,
    within_limits,
)

# questions of `fill` and `close` to terms, by the class of the contact; for other contacts they ask none
OF_NODES = push_increments, recover
BY_CONTACT = {NoContact: OF_NODES, ContactAtRest: OF_NODES, ContactOfCarriers: OF_NODES,
              ContactInMatrix: (push_increments, take_unknowns),
              Contact: (carry_columns, complete_columns, push_increments, take_unknowns),
              ContactInRows: (push_increments, recover_inside, take_unknowns),
              FactoredContact: (push_increments, recover_inside, take_unknowns)}


# --- asked of every term ------------------------------------------------------------------------------------------------
@put_loads.entry(k=INTEGER)
@table_entry
def put_loads_entry(term, system, k):
    put_loads.call(contents(term), system, k)


@first_guess.entry(h=NUMBER, c=NUMBER)
@table_entry
def first_guess_entry(term, system, h, c):
    first_guess.call(contents(term), system, h, c)


@clear.entry()
@table_entry
def clear_entry(term, system):
    clear.call(contents(term), system.method, system)


@assemble.entry(h=NUMBER)
@table_entry
def assemble_entry(term, system, h):
    assemble.call(contents(term), system.method, system, h)


@scale_solutions.entry()
@table_entry
def scale_solutions_entry(term, system):
    scale_solutions.call(contents(term), system.method, system)


@carry_columns.entry(contact=True)
@table_entry
def carry_columns_entry(term, system):
    carry_columns.call(contents(term), system)


@complete_columns.entry(contact=True)
@table_entry
def complete_columns_entry(term, system):
    complete_columns.call(contents(term), system)


@push_increments.entry()
@table_entry
def push_increments_entry(term, system):
    push_increments.call(contents(term), system)


@recover.entry(share=NUMBER)
@table_entry
def recover_entry(term, system, share):
    recover.call(contents(term), system, share)


@recover_inside.entry()
@table_entry
def recover_inside_entry(term, system):
    recover_inside.call(contents(term), system)


@take_unknowns.entry()
@table_entry
def take_unknowns_entry(term, system):
    take_unknowns.call(contents(term), system)


@follow_nodes.entry()
@table_entry
def follow_nodes_entry(term, system):
    follow_nodes.call(contents(term), system)


@account.entry(h=NUMBER)
@table_entry
def account_entry(term, system, h):
    account.call(contents(term), system, h)


@accept.entry()
@table_entry
def accept_entry(term, system):
    accept.call(contents(term), system.method, system)


@is_regular.entry(returns=TRUTH)
@table_entry
def is_regular_entry(term, system):
    return is_regular.call(contents(term), system)


@is_settled.entry(returns=TRUTH)
@table_entry
def is_settled_entry(term, system):
    return is_settled.call(contents(term), system)


@within_limits.entry(returns=TRUTH, counts_out=COUNTS)
@table_entry
def within_limits_entry(term, system, counts_out):
    return within_limits.call(contents(term), system, counts_out)


# --- asked of the scene: of all nodes, the method, contact and solver -----------------------------------------------------
@spread_nodes.entry(h=NUMBER, first=INTEGER, last=INTEGER)
@table_entry
def spread_nodes_entry(nothing, system, h, first, last):
    spread_nodes.call(system.dofs, system.method, system.state, system.work, h, first, last)


@move_nodes.entry(returns=PAIR, first=INTEGER, last=INTEGER)
@table_entry
def move_nodes_entry(nothing, system, first, last):
    return move_nodes.call(system.dofs, system.row_of, system.work, first, last, system.work.scratch)


@advance_nodes.entry(h=NUMBER, first=INTEGER, last=INTEGER)
@table_entry
def advance_nodes_entry(nothing, system, h, first, last):
    advance_nodes.call(system.dofs, system.method, system.state, system.work, h, first, last, system.work.scratch)


@axes_of.entry(returns=INTEGER)
@table_entry
def axes_of_entry(nothing, system):
    return axes_of.call(system.dofs)


@begin_step.entry(terms=CALLS, h=NUMBER)
@table_entry
def begin_step_entry(nothing, system, terms, h):
    begin_step.call(system.method, terms, system, h)


@save.entry()
@table_entry
def save_entry(nothing, system):
    save.call(system.method)


@restore.entry()
@table_entry
def restore_entry(nothing, system):
    restore.call(system.method)


@scale_residual.entry()
@table_entry
def scale_residual_entry(nothing, system):
    scale_residual.call(system.method, system)


@clear_increments.entry()
@table_entry
def clear_increments_entry(nothing, system):
    clear_increments.call(system.method, system)


@take_increments.entry()
@table_entry
def take_increments_entry(nothing, system):
    take_increments.call(system.method, system)


@begin_contact.entry()
@table_entry
def begin_contact_entry(nothing, system):
    begin_contact.call(system.contact)


@fill.entry(terms=CALLS)
@table_entry
def fill_entry(nothing, system, terms):
    fill.call(system.contact, terms, system)


@close.entry(returns=PAIR, terms=CALLS)
@table_entry
def close_entry(nothing, system, terms):
    return close.call(system.contact, terms, system)


@begin_solver.entry()
@table_entry
def begin_solver_entry(nothing, system):
    begin_solver.call(system.solver)


@solve.entry(returns=TRUTH)
@table_entry
def solve_entry(nothing, system):
    return solve.call(system.solver, system.contact, system)
