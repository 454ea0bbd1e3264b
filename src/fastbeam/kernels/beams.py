"""All beams with one strain set as a term of a step, in space and in a plane, for every method; and the nodes that are eliminated
inside elements."""
from __future__ import annotations

from typing import Any, NamedTuple

from .._jit import kernel
from .alpha import Alpha
from .beam import ElementTables, element_groups
from .inner import (Inner, clear_rhs, eliminate_columns, put_inner_rhs, recover_inner, recover_rows)
from .kinds import Plane, Space
from .planar_beam import planar_groups
from .terms import (AtRest, Conserving, Equilibrium, Midpoint, add_elements, assemble, carry_columns, clear, complete_columns,
                    is_regular, recover, weigh)
from .work import halve


class SimoReissner(NamedTuple):
    """Beams with strain set (2.2) of theory.md."""

    tables: ElementTables
    inner: Any    # inner.Inner, or None where no nodes are eliminated


class GreenLagrange(NamedTuple):
    """Beams with strain set (2.1)."""

    tables: ElementTables
    inner: Any


@assemble.register(SimoReissner)
@kernel
def assemble_simo_reissner(beams, method, system, h):
    add_elements.call(system.size, method, beams.tables, beams.inner, None, system, h)


@assemble.register(GreenLagrange)
@kernel
def assemble_green_lagrange(beams, method, system, h):
    add_elements.call(system.size, method, beams.tables, beams.inner, 1, system, h)


@add_elements.register(Space, Conserving)
@kernel
def conserving_elements(size, method, tables, inner, strains, system, h):
    state, work = system.state, system.work
    element_groups(tables, 0, tables.meta.shape[0], inner, state.q, work.dphi, state.v, None, work.line, h, 2.0 / (h * h), None,
                   strains, None, work.r, work.blocks, work.scratch, size)


@add_elements.register(Space, Midpoint)
@kernel
def midpoint_elements(size, method, tables, inner, strains, system, h):
    state, work = system.state, system.work
    element_groups(tables, 0, tables.meta.shape[0], inner, state.q, work.dphi, state.v, None, work.line, h, 2.0 / (h * h), None,
                   strains, 1, work.r, work.blocks, work.scratch, size)


@add_elements.register(Space, Alpha)
@kernel
def alpha_elements(size, alpha, tables, inner, strains, system, h):
    state, work = system.state, system.work
    element_groups(tables, 0, tables.meta.shape[0], inner, state.q, work.dphi, None, work.u, work.line, h, 0.5 * alpha.factor[1],
                   alpha.spin_rate, strains, None, work.r, work.blocks, work.scratch, size)


@add_elements.register(Space, AtRest)
@kernel
def elements_at_rest(size, method, tables, inner, strains, system, h):
    state, work = system.state, system.work
    element_groups(tables, 0, tables.meta.shape[0], inner, state.q, None, None, work.u, work.line, 0.0, 0.0, None, strains, None,
                   work.r, work.blocks, work.scratch, size)


@add_elements.register(Space, Equilibrium)
@kernel
def elements_in_equilibrium(size, method, tables, inner, strains, system, h):
    state, work = system.state, system.work
    element_groups(tables, 0, tables.meta.shape[0], inner, state.q, None, None, None, work.line, None, None, None, strains, None,
                   work.r, work.blocks, work.scratch, size)


@add_elements.register(Plane, Conserving)
@kernel
def conserving_elements_in_plane(size, method, tables, inner, strains, system, h):
    state, work = system.state, system.work
    planar_groups(tables, 0, tables.meta.shape[0], inner, state.q, work.dphi, state.v, work.line, h, 2.0 / (h * h), strains,
                  work.r, work.blocks, work.scratch, size)


@add_elements.register(Plane, Equilibrium)
@kernel
def elements_in_equilibrium_in_plane(size, method, tables, inner, strains, system, h):
    state, work = system.state, system.work
    planar_groups(tables, 0, tables.meta.shape[0], inner, state.q, None, None, work.line, None, None, strains, work.r,
                  work.blocks, work.scratch, size)


# --- nodes that are eliminated inside elements --------------------------------------------------------------------------
@recover.register(SimoReissner)
@recover.register(GreenLagrange)
@kernel
def recover_inside(beams, system, share):
    recover_rows(beams.tables, beams.inner, share, system.work.line.x, system.work.scratch, system.size)


@clear.register(Inner)
@kernel
def clear_inner(inner, method, system):
    inner.state[0] = 1.0
    clear_rhs(inner.rhs)


@weigh.register(Inner, Alpha)
@kernel
def weigh_inner(inner, method, system):
    halve(inner.rhs)


@is_regular.register(Inner)
@kernel
def inner_is_regular(inner, system):
    return inner.state[0] != 0.0


@carry_columns.register(Inner)
@kernel
def carry_inner_columns(inner, system):
    work, width = system.work, system.width
    for i in range(len(system.size) * inner.first[0] * width, work.panel.shape[0], width):
        work.panel[i] = 0.0
    eliminate_columns(inner, system.contact, work.panel, width, system.size)
    put_inner_rhs(inner, work.panel, width, system.size)


@complete_columns.register(Inner)
@kernel
def complete_inner_columns(inner, system):
    recover_inner(inner, system.work.panel, system.width, system.size)
