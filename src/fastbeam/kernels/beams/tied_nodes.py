"""Tied nodes as a term of a step, in space and in a plane."""
from __future__ import annotations

from fastbeam.kernels.beams.generalized_alpha import Alpha
from fastbeam.kernels.beams.planar_nodes import PlanarTies
from fastbeam.kernels.beams.ties import Ties, tie_coordinates
from fastbeam.kernels.entries.dense import put_tied_translation, put_translation
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.terms import (
    accept,
    apply_ties,
    assemble,
    carry_columns,
    clear,
    complete_columns,
    first_guess,
    follow_nodes,
    pull_tied_columns,
    push_increments,
    push_tied_columns,
    tie_increments,
)

put_translation.register(Ties)(put_tied_translation)
put_translation.register(PlanarTies)(put_tied_translation)


@follow_nodes.register(Ties)
@follow_nodes.register(PlanarTies)
@kernel
def follow_ties(ties, system):
    tie_increments.call(ties, system.state.q, system.work.theta, system.work.dphi, system.work.increment.off)


@first_guess.register(Ties)
@first_guess.register(PlanarTies)
@kernel
def guess_ties(ties, system, h, c):
    follow_ties(ties, system)


@assemble.register(Ties)
@assemble.register(PlanarTies)
@kernel
def assemble_ties(ties, method, system, h):
    work = system.work
    apply_ties.call(ties, 0, ties.slave.shape[0], 0, ties.moves.shape[0], work.q_mid, work.q_end, work.r, work.blocks,
                    work.scratch)


@carry_columns.register(Ties)
@carry_columns.register(PlanarTies)
@kernel
def carry_tied_columns(ties, system):
    pull_tied_columns.call(ties, system.work.q_mid, system.work.panel, system.width)


@complete_columns.register(Ties)
@complete_columns.register(PlanarTies)
@kernel
def complete_tied_columns(ties, system):
    work, width = system.work, system.width
    push_tied_columns.call(ties, work.q_end, work.panel, len(system.dofs) * width, width, width)


@push_increments.register(Ties)
@push_increments.register(PlanarTies)
@kernel
def push_tied_increments(ties, system):
    push_tied_columns.call(ties, system.work.q_end, system.work.increment.x, 8, 1, 1)


@clear.register(Ties, Alpha)
@kernel
def tie_second_rates(ties, method, system):
    tie_coordinates(ties, system.work.u)


@accept.register(Ties, Alpha)
@kernel
def accept_ties(ties, method, system):
    tie_coordinates(ties, system.state.v)
