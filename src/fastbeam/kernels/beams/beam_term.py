"""All beams with one strain set as a term of a step, in space and in a plane, for every method; and the nodes that are eliminated
inside elements."""
from __future__ import annotations

from typing import Any, NamedTuple

from fastbeam.kernels.beams import planar as planar_beam  # noqa: F401  points in a plane
from fastbeam.kernels.beams.element_loop import ElementTables, element_groups
from fastbeam.kernels.beams.generalized_alpha import Alpha
from fastbeam.kernels.beams.inner_nodes import (
    Inner,
    clear_rhs,
    eliminate_columns,
    halve_rhs,
    put_inner_rhs,
    recover_inner,
    recover_rows,
)
from fastbeam.kernels.beams.motions import motion
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.terms import assemble, carry_columns, clear, complete_columns, is_regular, recover, scale_solutions


class Beams(NamedTuple):
    """Beams with one strain set."""

    strains: Any  # strain_measures.SimoReissner or GreenLagrange
    tables: ElementTables
    inner: Any    # inner_nodes.Inner, or NoInner where no nodes are eliminated


@assemble.register(Beams)
@kernel
def assemble_beams(beams, method, system, h):
    state, work = system.state, system.work
    element_groups(beams.tables, 0, beams.tables.meta.shape[0], beams.inner, beams.strains, motion.call(method, state, work, h),
                   work.r, work.blocks, work.scratch, system.dofs)


# --- nodes that are eliminated inside elements --------------------------------------------------------------------------
@recover.register(Beams)
@kernel
def recover_inside(beams, system, share):
    recover_rows.call(beams.inner, beams.tables, share, system.work.increment.x, system.work.scratch, system.dofs)


@clear.register(Inner)
@kernel
def clear_inner(inner, method, system):
    inner.state[0] = 1.0
    clear_rhs.call(inner.rhs)


@scale_solutions.register(Inner, Alpha)
@kernel
def scale_inner_solutions(inner, method, system):
    halve_rhs.call(inner.rhs)


@is_regular.register(Inner)
@kernel
def inner_is_regular(inner, system):
    return inner.state[0] != 0.0


@carry_columns.register(Inner)
@kernel
def carry_inner_columns(inner, system):
    work, width = system.work, system.width
    for i in range(len(system.dofs) * inner.first[0] * width, work.panel.shape[0], width):
        work.panel[i] = 0.0
    eliminate_columns(inner, system.contact, work.panel, width, system.dofs)
    put_inner_rhs(inner, work.panel, width, system.dofs)


@complete_columns.register(Inner)
@kernel
def complete_inner_columns(inner, system):
    recover_inner(inner, system.work.panel, system.width, system.dofs)
