"""Substructures (carriers): beams with their sliders, eliminated to the ends of the beams, theory.md 9.

Groups of carriers are systems of their own, with the rows of linalg/constraint_rows.py: first the points that slide, then the
nodes between the ends, each slider behind the last of these that it touches, all ends last. Elimination stops before the ends.
Their remaining blocks and residuals are added to those of the scene like those of condensed beams, `Substructures.ends`. Blocks,
entries of sliders and right-hand sides are work of a thread; only numbers that the substitution needs are kept for a group.

Arrays: x_now, x_out [8 (rows + 1)] by rows of the scene; store [*] as `Factors.store`; ends_out [B, 32 n + 16] flat as
`Substructures.ends`.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.vectors import vld, vst, vzero
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.jit.records import in_memory
from fastbeam.kernels.linalg.constraint_entries import clear_held_columns, put_entries, start_blocks
from fastbeam.kernels.linalg.constraint_fill import block_at, find_fill, find_places, find_targets
from fastbeam.kernels.linalg.constraint_rows import collect, is_changed, put_in_order
from fastbeam.kernels.linalg.constraint_solve import RIGHT, eliminate, substitute, take_solution
from fastbeam.kernels.terms import assemble, push_increments, take_unknowns


class Carriers(NamedTuple):
    """Table of L carriers in groups, with their sliders and sliding points."""

    ends: np.ndarray          # int64 [L, 2]: first and last node; nodes between are numbered in turn
    group: np.ndarray         # int64 [L]: ascending
    slider_start: np.ndarray  # int64 [L + 1]: range of a carrier in the next
    slider: np.ndarray        # int64 [S]
    point_start: np.ndarray   # int64 [L + 1]: range of a carrier in the next
    point: np.ndarray         # int64 [*]: nodes of the masses and bodies that slide on it, and of points of these bodies
    tables: np.ndarray        # int64 [K, 4]: group of carriers, 0 or 1 for strain set (2.2) or (2.1), its first group of elements
    #                           there, their number

    @property
    def eliminated_nodes(self) -> np.ndarray:
        """All nodes that the solver does not see."""
        return np.concatenate([self.point, *(np.arange(a + 1, b) for a, b in self.ends.tolist())])


class GroupRows(NamedTuple):
    """Places in the scene of the n rows of a group, 2 K of them ends."""

    row: np.ndarray     # int64 [n]: row of the residual; ends last, start and end of every carrier in turn
    beam: np.ndarray    # int64 [K]: place of every carrier in `Substructures.ends`
    kept: np.ndarray    # float64 [*]: blocks behind the diagonal of all eliminated rows, in turn
    place: np.ndarray   # int32 [*]: offset of each of these blocks
    end: np.ndarray     # int64 [1]: end of these blocks


@kernel
def find_order(contact, solver, group_rows, dofs):
    """Find the order and the fill again if other rows are touched, as `constraint_fill.update_order`, in the given order of
    nodes. Return False if an array is too short."""
    touched, order, couplings = solver.touched, solver.order, solver.couplings
    if not is_changed(contact, touched):
        return True
    touched.counts[1] = 0
    if not collect(contact, solver.inner, solver.ties, couplings, touched, len(dofs)):
        return False
    put_in_order(couplings, touched, order)
    end = find_fill(couplings, touched, order, dofs)
    if end < 0 or end > solver.factors.store.shape[0] or not find_targets(order):
        return False
    order.counts[1] = end
    find_places(contact, couplings, touched, order)
    at = 0
    for i in range(order.order.shape[0] - 2 * group_rows.beam.shape[0]):
        for e in range(order.start[i], order.start[i + 1]):
            group_rows.place[e] = at
            at += 8 * order.unknowns[i]
    group_rows.end[0] = at
    if at > group_rows.kept.shape[0]:
        return False
    touched.counts[1] = 1
    return True


@kernel
def keep_rows(group_rows, order, store):
    """Keep the upper blocks of eliminated rows, which the substitution needs."""
    for i in range(order.order.shape[0]):
        for e in range(order.start[i], order.start[i + 1]):
            for c in range(0, 8 * order.unknowns[i], 8):
                vst(group_rows.kept, group_rows.place[e] + c, 0, vld(store, order.upper[e] + c, 0))


@kernel
def put_block(store, at, ends_out, to, dofs):
    """Copy a block, with zeros in the columns that pad its rows."""
    n = len(dofs)
    for i in range(0, 8 * n, 8):
        for c in range(8):
            ends_out[to + i + c] = store[at + i + c] if c < n else 0.0


@kernel
def put_ends(group_rows, order, store, ends_out, dofs):
    """Store blocks and residuals of the ends of all carriers of a group."""
    n = len(dofs)
    first = group_rows.row.shape[0] - 2 * group_rows.beam.shape[0]
    for k in range(group_rows.beam.shape[0]):
        to = (32 * n + 16) * group_rows.beam[k]
        for a in range(2):
            i = order.position[first + 2 * k + a]
            for b in range(2):
                at = block_at(order, i, order.position[first + 2 * k + b])
                put_block(store, at, ends_out, to + 8 * n * (2 * a + b), dofs)
            for c in range(8):
                ends_out[to + 32 * n + 8 * a + c] = -store[order.diagonal[i] + 8 * c + RIGHT] if c < n else 0.0


@kernel
def condense_carriers(all_terms, whole_system, short_order, held, group_rows, h, x_now, ends_out):
    """Assemble the terms of a group and eliminate all but the ends; short_order: the same arrays without the ends among the
    positions; x_now: rows of the last increment. Return False if there is not enough room, `factors.failed[0]` is 1 then, or no
    pivot."""
    terms, system, short = in_memory(all_terms), in_memory(whole_system), in_memory(short_order)
    solver, work, contact, dofs = system.solver, system.work, system.contact, system.dofs
    r, blocks = work.r, work.blocks
    solver.factors.failed[0] = 0
    solver.factors.failed[1] = -1
    n = solver.couplings.diagonal.shape[0]
    for i in range(r.shape[0]):
        r[i] = 0.0
    x = work.increment.x
    for i in range(n):
        vst(x, 8 * i, 0, vld(x_now, 8 * group_rows.row[i], 0))
        if i < n - 2 * group_rows.beam.shape[0]:
            vst(r, 8 * i, 0, vzero() - vld(work.f_ext, 8 * group_rows.row[i], 0))
    vst(x, 8 * n, 0, vzero())
    for i in range(blocks.shape[0]):
        blocks[i] = 0.0
    assemble.each(terms, system.method, system, h)
    if contact.full[0] != 0 or not find_order(contact, solver, group_rows, dofs):
        solver.factors.failed[0] = 1
        return False
    start_blocks(contact, solver.couplings, solver.order, solver.factors, r, dofs)
    put_entries(contact, solver.couplings, solver.touched, solver.order, solver.factors, dofs)
    clear_held_columns(held, solver.touched, solver.factors, n)
    if not eliminate(solver.couplings, short, solver.factors, contact, system.state.force, dofs):
        return False
    put_ends(group_rows, solver.order, solver.factors.store, ends_out, dofs)
    keep_rows(group_rows, short, solver.factors.store)
    return True


@kernel
def recover_carriers(all_terms, whole_system, short_order, group_rows, x_out):
    """Recover increments of a group from those of its ends in rows of x_out, and of its sliders; short_order and factors of the
    solver: those that were kept."""
    terms, system, short = in_memory(all_terms), in_memory(whole_system), in_memory(short_order)
    solver, work, contact, dofs = system.solver, system.work, system.contact, system.dofs
    n = group_rows.row.shape[0]
    first = n - 2 * group_rows.beam.shape[0]
    for i in range(first, n):
        for c in range(len(dofs)):
            solver.factors.x[8 * solver.order.position[i] + c] = x_out[8 * group_rows.row[i] + c]
    substitute(short, solver.factors, dofs)
    take_solution(solver.couplings, solver.order, solver.factors, contact, system.state.force, work.increment.x, work.y, dofs)
    push_increments.each(terms, system)
    contact.augmented[3] = 0.0
    take_unknowns.each(terms, system)
    for i in range(first):
        for c in range(len(dofs)):
            x_out[8 * group_rows.row[i] + c] = work.increment.x[8 * i + c]
