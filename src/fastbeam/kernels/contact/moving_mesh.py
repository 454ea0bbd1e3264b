"""Conserving step of beams whose elements move with their contacts (theory.md 5.12).

The history keeps momenta of points of the elements. Their means over a step follow from mean rates; forces on nodes and places of
contacts change their sums. That conserves energy and both momenta.

Arrays: q_mid, q_end [12 N]; counts_out [5]; scratch [*], numbers of a group of 8 elements in lanes.
"""
from __future__ import annotations

import numpy as np

from fastbeam.kernels.algebra.blocks import THREE, TWELVE
from fastbeam.kernels.algebra.lanes import gather_lanes
from fastbeam.kernels.algebra.vectors import WIDTH, address, vld, vst
from fastbeam.kernels.beams.element_loop import Case, evaluate_lanes, gather_group, scatter_group
from fastbeam.kernels.beams.motions import motion
from fastbeam.kernels.contact.moving_beam import MovingBeam, density_place, ends_of, height_of
from fastbeam.kernels.contact.moving_elements import (
    BASE,
    CORNER,
    FORCES,
    LENGTHS,
    MOVING_STEP,
    RATES,
    SHARES,
    WEIGHT,
    evaluate_ends,
    moved,
    put_momenta,
)
from fastbeam.kernels.jit.decorators import kernel, separate
from fastbeam.kernels.layout import CONSTANTS, COUPLED, LIST, NODES, POINTS, layout
from fastbeam.kernels.terms import Conserving, Equilibrium, account, assemble, spread_nodes, within_limits

# an element may shrink to this share of its length in a step
LEAST_RATIO = 1e-3


@kernel
def rate_of(beam, contact, h):
    """Return the mean rate of the place of a contact over the step, 0 for an end of the beam (-1) and at rest."""
    if contact < 0 or h == 0.0:
        return 0.0
    return beam.following.way[beam.first[0] + contact, 0] / h


@kernel
def put_ends(beam, k, scratch, x, state, work, h):
    """Store lengths of the elements of group k at both ends of the step, mean rates of their ends, and shares."""
    for lane in range(8):
        e = beam.lane[8 * k + lane]
        a0, b0 = ends_of(beam, e, state.s)
        a1, b1 = ends_of(beam, e, work.s_end)
        behind = rate_of(beam, beam.slot[e, 0], h)
        ahead = rate_of(beam, beam.slot[e, 1], h)
        o = x.first + lane
        scratch[o + LENGTHS] = (beam.share[e, 1] - beam.share[e, 0]) * (b0 - a0)
        # a step in which an element vanishes fails
        ratio = (b1 - a1) / (b0 - a0)
        scratch[o + LENGTHS + 8] = (beam.share[e, 1] - beam.share[e, 0]) * (b1 - a1) if ratio > LEAST_RATIO else np.nan
        for side in range(2):
            f = beam.share[e, side]
            scratch[o + SHARES + 8 * side] = f
            scratch[o + RATES + 8 * side] = (1.0 - f) * behind + f * ahead


@kernel
def gather_moving(beam, k, at, x, step, state, work, h, dofs):
    """Gather coordinates, their mean rates, ends and momenta of the elements of group k into scratch."""
    no = beam.tables.meta[k, LIST]
    gather_group(beam.tables, no, at, step, beam.scratch, dofs)
    scratch = beam.scratch
    for a in range(at.nn):
        # v + h u/2: differences of positions over h would be round-off of these
        gather_lanes(state.v, beam.tables.nodes, no + 8 * a, 12, scratch, x.rows, TWELVE)
        for i in range(0, 96, 8):
            o = at.rates + 96 * a + i
            vst(scratch, o, 0, vld(scratch, x.rows + i, 0) + (0.5 * h) * vld(scratch, o, 0))
    # positions count from the first node: far from the origin strains would be round-off of them
    for a in range(at.nn):
        gather_lanes(state.q, beam.tables.nodes, no + 8 * a, 12, scratch, x.rows + 24 * a, THREE)
    for i in range(0, 24, 8):
        start = vld(scratch, x.rows + i, 0)
        end = vld(scratch, 96 + i, 0)
        vst(scratch, x.first + BASE + i, 0, 0.5 * (start + end))
        for a in range(at.nn):
            o = at.node * a + i
            moved_end = vld(scratch, o + 96, 0) - end
            vst(scratch, o + 96, 0, moved_end)
            vst(scratch, o, 0, 0.5 * (vld(scratch, x.rows + 24 * a + i, 0) - start + moved_end))
    put_ends(beam, k, beam.scratch, x, state, work, h)
    points = beam.mass_point.shape[1]
    for g in range(points):
        gather_lanes(address(state.history, beam.place[0] + 12 * g), beam.lane, 8 * k, 12 * points, beam.scratch,
                     x.momenta + 96 * g, TWELVE)


@separate
def evaluate_moving(beam, method, k, state, work, h, dofs):
    """Add residual and tangent of group k; h: 0 at rest."""
    tables, scratch = beam.tables, beam.scratch
    at = layout(dofs, tables.meta[k, NODES], tables.meta[k, POINTS])
    x = moved(at, beam.mass_point.shape[1])
    step = motion.call(method, state, work, h)
    gather_moving(beam, k, at, x, step, state, work, h, dofs)
    for c in range(3):
        for lane in range(8):
            scratch[x.first + WEIGHT + 8 * c + lane] = beam.following.gravity[0] * beam.weighs[c]
    # the tangent is exact, without the stresses of theory.md (4.6)
    case = Case(tables.meta[k, COUPLED] != 0, False, False)
    for lane in range(0, 8, WIDTH):
        tab = address(tables.tab, tables.meta[k, CONSTANTS] + lane)
        of_lanes = address(scratch, lane)
        evaluate_ends(beam, MOVING_STEP, beam.strains, tab, case.coupled, of_lanes, at, x, h)
        evaluate_lanes.call(dofs, MOVING_STEP, beam.strains, tab, address(scratch, x.rest + lane), of_lanes, at, case,
                            step.mass_factor)
    scatter_group(tables, k, at, 1, scratch, work.r, work.blocks, dofs)
    for lane in range(8):
        if 8 * k + lane < beam.node.shape[0]:
            scatter_ends(beam, 8 * k + lane, lane, scratch, at, x)


@kernel
def scatter_ends(beam, e, lane, scratch, at, x):
    """Add the forces of element e on the places of contacts, and the derivatives that belong to these places."""
    n = at.nn
    size = 48 * n
    following = beam.following
    for side in range(2):
        if beam.slot[e, side] < 0:
            continue
        f = beam.first[0] + beam.slot[e, side]
        column = x.rows + size * side + lane
        line = column + 2 * size
        for a in range(n):
            border = following.border[f, beam.entry[e, side, a]]
            for c in range(6):
                border[c] += scratch[column + 48 * a + 8 * c]
                border[6 + c] += scratch[line + 48 * a + 8 * c]
        corner = x.first + CORNER + 16 * side + lane
        following.pull[f, 0] += scratch[x.first + FORCES + 8 * side + lane]
        following.pull[f, 1] += scratch[corner + 8 * side]
        if beam.slot[e, 1 - side] >= 0:
            # the contact behind has the number `side` = 0
            following.cross[f - side, side] += scratch[corner + 8 * (1 - side)]
        if beam.share[e, side] == float(side):
            put_tangent(beam, e, side, f, scratch, at, x, lane)


@kernel
def put_tangent(beam, e, side, f, scratch, at, x, lane):
    """Add the half of the tangent at contact f, at an end of element e, and its derivatives."""
    following = beam.following
    size = 0.5 * (scratch[x.first + LENGTHS + lane] + scratch[x.first + LENGTHS + 8 + lane])
    # the length at the end grows with the place ahead
    by_place = (beam.share[e, 1] - beam.share[e, 0]) * (0.5 if side == 1 else -0.5) / size
    for a in range(at.nn):
        slope = 0.5 * beam.edge[side, a] / size
        following.slope[f, beam.entry[e, side, a]] += 0.5 * slope
        for c in range(3):
            part = slope * scratch[at.node * a + 8 * c + lane]
            following.tangent[f, c] += part
            following.tangent[f, 3 + c] -= by_place * part


@kernel
def clear_contacts(beam):
    """Set what `scatter_ends` adds up to zero."""
    following, first = beam.following, beam.first[0]
    for f in range(first, first + beam.slider.shape[0]):
        following.pull[f, 0] = following.pull[f, 1] = 0.0
        following.cross[f, 0] = following.cross[f, 1] = 0.0
        for c in range(6):
            following.tangent[f, c] = 0.0
        for m in range(following.border.shape[1]):
            following.slope[f, m] = 0.0
            for c in range(12):
                following.border[f, m, c] = 0.0


@assemble.register(MovingBeam, Conserving)
@kernel
def assemble_moving(beam, method, system, h):
    clear_contacts(beam)
    for k in range(beam.tables.meta.shape[0]):
        evaluate_moving(beam, method, k, system.state, system.work, h, system.dofs)


@assemble.register(MovingBeam, Equilibrium)
@kernel
def assemble_moving_at_rest(beam, method, system, h):
    """Add the beam in an equilibrium, where both ends of the step are the present shape."""
    for j in range(beam.slider.shape[0]):
        system.work.s_end[beam.slider[j]] = system.state.s[beam.slider[j]]
    assemble_moving(beam, method, system, 0.0)


@account.register(MovingBeam)
@kernel
def account_moving(beam, system, h):
    """Update momenta to the end of the step, twice their means less those at its start, and the work of the weight."""
    state, work, dofs = system.state, system.work, system.dofs
    first = beam.place[1]
    spread_nodes.call(dofs, system.method, state, work, h, first, first + beam.place[2])
    for k in range(beam.tables.meta.shape[0]):
        take_momenta(beam, k, state, work, h, dofs)
    behind = density_place(beam, beam.node.shape[0], 0, 0)
    for j in range(beam.slider.shape[0]):
        # as the velocities of nodes
        place = behind + j
        state.history[place] = 2.0 * rate_of(beam, j, h) - state.history[place]
    way = height_of(beam, work.q_end, work.s_end) - height_of(beam, state.q, state.s)
    state.history[behind + beam.slider.shape[0]] += beam.following.gravity[0] * way


@separate
def take_momenta(beam, k, state, work, h, dofs):
    """Store the momenta of group k at the end of the step."""
    at = layout(dofs, beam.tables.meta[k, NODES], beam.tables.meta[k, POINTS])
    x = moved(at, beam.mass_point.shape[1])
    gather_moving(beam, k, at, x, motion.call(MOVING_STEP, state, work, h), state, work, h, dofs)
    for lane in range(0, 8, WIDTH):
        put_momenta(beam, address(beam.scratch, lane), at, x)
    points = beam.mass_point.shape[1]
    for lane in range(8):
        if 8 * k + lane < beam.node.shape[0]:
            first = density_place(beam, 8 * k + lane, 0, 0)
            for i in range(12 * points):
                state.history[first + i] = beam.scratch[x.momenta + 8 * i + lane]


@within_limits.register(MovingBeam)
@kernel
def contacts_keep_distance(beam, system, counts_out):
    """Return whether contacts are at least `length[1]` from each other and from both ends of the beam."""
    before = 0.0
    for j in range(beam.slider.shape[0] + 1):
        s = system.state.s[beam.slider[j]] if j < beam.slider.shape[0] else beam.length[0]
        if not s - before >= beam.length[1]:
            counts_out[3] = system.state.s.shape[0] + beam.place[3] + j
            return False
        before = s
    return True
