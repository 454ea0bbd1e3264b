"""Conserving step of beams whose elements move with their contacts (theory.md 5.12).

The history keeps momenta of points of the elements. Their means over a step follow from mean rates; forces on nodes and places of
contacts change their sums. That conserves energy and both momenta.

Arrays: counts_out [5]; history [*]; scratch [*], numbers of a group of 8 elements in lanes; store [*] as `Inner.store`.
"""
from __future__ import annotations

import numpy as np

from fastbeam.kernels.algebra.blocks import FOUR, ONE, THREE, TWELVE, TWO, solve_lanes, subtract_lanes
from fastbeam.kernels.algebra.dimensions import Plane, Space, dim
from fastbeam.kernels.algebra.lanes import copy_lanes, gather_lanes, put_rows
from fastbeam.kernels.algebra.vectors import WIDTH, address, dot, ld3, st3, vld, vst
from fastbeam.kernels.beams.element_loop import Case, evaluate_lanes, gather_group, scatter_group
from fastbeam.kernels.beams.inner_nodes import Inner, NoInner, eliminate_group
from fastbeam.kernels.beams.motions import motion
from fastbeam.kernels.contact.moving_beam import MovingBeam, MovingRows, density_place, height_of
from fastbeam.kernels.contact.moving_elements import (
    BASE,
    CORNER,
    FORCES,
    GAIN,
    LENGTHS,
    MOVING_STEP,
    RATES,
    SHARES,
    WEIGHT,
    evaluate_ends,
    moved,
    put_momenta,
)
from fastbeam.kernels.contact.moving_places import (
    AFTER,
    ALLOWED,
    BEFORE,
    BEND,
    MAY_WAIT,
    MEAN,
    NOW,
    SLOPE,
    WAITS,
    is_on_node,
    place_of,
    put_shift,
)
from fastbeam.kernels.contact.slider import UNKNOWN
from fastbeam.kernels.jit.decorators import inlined, kernel, separate
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.layout import CONSTANTS, COUPLED, FACTORS, LIST, NODES, POINTS, layout
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
def put_shifts(beam, state, work):
    """Store how element ends follow their contacts in the step; return whether all contacts stay at element ends."""
    following, on_nodes = beam.following, True
    for j in range(beam.slider.shape[0]):
        f, s0, s1 = beam.first[0] + j, state.s[beam.slider[j]], work.s_end[beam.slider[j]]
        put_shift(following, f, s0, s1)
        on_nodes = on_nodes and is_on_node(following, f, s0) and is_on_node(following, f, s1)
    return on_nodes


@kernel
def put_ends(beam, k, scratch, x, h):
    """Store lengths of the elements of group k at both ends of the step, mean rates of their ends, and shares, from the numbers
    of `put_shifts`."""
    shift, first = beam.following.shift, beam.first[0]
    for lane in range(8):
        e = beam.lane[8 * k + lane]
        a0 = a1 = behind = ahead = 0.0
        b0 = b1 = beam.length[0]
        a, b = beam.slot[e, 0], beam.slot[e, 1]
        if a >= 0:
            a0, a1, behind = shift[first + a, BEFORE], shift[first + a, AFTER], shift[first + a, MEAN] * rate_of(beam, a, h)
        if b >= 0:
            b0, b1, ahead = shift[first + b, BEFORE], shift[first + b, AFTER], shift[first + b, MEAN] * rate_of(beam, b, h)
        o = x.first + lane
        scratch[o + LENGTHS] = (beam.share[e, 1] - beam.share[e, 0]) * (b0 - a0)
        # a step in which an element vanishes fails
        ratio = (b1 - a1) / (b0 - a0)
        scratch[o + LENGTHS + 8] = (beam.share[e, 1] - beam.share[e, 0]) * (b1 - a1) if ratio > LEAST_RATIO else np.nan
        for side in range(2):
            f = beam.share[e, side]
            scratch[o + SHARES + 8 * side] = f
            scratch[o + GAIN + 8 * side] = 0.0
            scratch[o + RATES + 8 * side] = (1.0 - f) * behind + f * ahead


@generic
def gather_rates(dofs, state, tables, no, scratch, to):
    """Gather the rates of the coordinates of 8 nodes into lanes."""


@generic
def gather_positions(dofs, state, tables, no, scratch, to):
    """Gather the positions of 8 nodes at the start of the step into lanes."""


@generic
def gather_momenta(dofs, beam, k, points, g, history, scratch, to):
    """Gather the momenta of the elements of group k at point g of the mass into lanes; in a plane those of its coordinates."""


@generic
def keep_momenta(dofs, beam, points, e, g, lane, scratch, momenta, history):
    """Keep the momenta of element e, in a lane, at point g of the mass, in the history, which has vectors in space."""


@gather_rates.register(Space)
@inlined
def gather_rates_in_space(dofs, state, tables, no, scratch, to):
    gather_lanes(state.v, tables.nodes, no, 12, scratch, to, TWELVE)


@gather_rates.register(Plane)
@inlined
def gather_rates_in_plane(dofs, state, tables, no, scratch, to):
    gather_lanes(state.v, tables.nodes, no, 4, scratch, to, FOUR)


@gather_positions.register(Space)
@inlined
def gather_positions_in_space(dofs, state, tables, no, scratch, to):
    gather_lanes(state.q, tables.nodes, no, 12, scratch, to, THREE)


@gather_positions.register(Plane)
@inlined
def gather_positions_in_plane(dofs, state, tables, no, scratch, to):
    gather_lanes(state.q, tables.nodes, no, 4, scratch, to, TWO)


@gather_momenta.register(Space)
@inlined
def gather_momenta_in_space(dofs, beam, k, points, g, history, scratch, to):
    gather_lanes(address(history, beam.place[0] + 12 * g), beam.lane, 8 * k, 12 * points, scratch, to + 96 * g, TWELVE)


@gather_momenta.register(Plane)
@inlined
def gather_momenta_in_plane(dofs, beam, k, points, g, history, scratch, to):
    within, inert = beam.within, beam.place[4]
    for lane in range(8):
        first = beam.place[0] + 12 * (points * beam.lane[8 * k + lane] + g)
        o = to + 32 * g + lane
        position = ld3(history, first, 1)
        director = ld3(history, first + inert, 1)
        for c in range(2):
            scratch[o + 8 * c] = dot(ld3(within, 3 * c, 1), position)
            scratch[o + 16 + 8 * c] = dot(ld3(within, 6 + 3 * c, 1), director)


@keep_momenta.register(Space)
@inlined
def keep_momenta_in_space(dofs, beam, points, e, g, lane, scratch, momenta, history):
    first = beam.place[0] + 12 * (points * e + g)
    for i in range(12):
        history[first + i] = scratch[momenta + 96 * g + 8 * i + lane]


@keep_momenta.register(Plane)
@inlined
def keep_momenta_in_plane(dofs, beam, points, e, g, lane, scratch, momenta, history):
    first = beam.place[0] + 12 * (points * e + g)
    o = momenta + 32 * g + lane
    for d in range(4):
        own = o if d == 0 else o + 16
        x = scratch[own] * ld3(beam.within, 12 + 6 * d, 1) + scratch[own + 8] * ld3(beam.within, 15 + 6 * d, 1)
        st3(history, first + 3 * d, 1, x)


@kernel
def gather_moving(beam, k, at, x, step, state, work, h, dofs):
    """Gather coordinates, their mean rates, ends and momenta of the elements of group k into scratch."""
    no = beam.tables.meta[k, LIST]
    gather_group(beam.tables, no, at, step, beam.scratch, dofs)
    scratch = beam.scratch
    for a in range(at.nn):
        # v + h u/2: differences of positions over h would be round-off of these
        gather_rates.call(dofs, state, beam.tables, no + 8 * a, scratch, x.rows)
        for i in range(0, x.node, 8):
            o = at.rates + x.node * a + i
            vst(scratch, o, 0, vld(scratch, x.rows + i, 0) + (0.5 * h) * vld(scratch, o, 0))
    # positions count from the first node: far from the origin strains would be round-off of them
    for a in range(at.nn):
        gather_positions.call(dofs, state, beam.tables, no + 8 * a, scratch, x.rows + x.vector * a)
    for i in range(0, x.vector, 8):
        start = vld(scratch, x.rows + i, 0)
        end = vld(scratch, x.node + i, 0)
        vst(scratch, x.first + BASE + i, 0, 0.5 * (start + end))
        for a in range(at.nn):
            o = at.node * a + i
            moved_end = vld(scratch, o + x.node, 0) - end
            vst(scratch, o + x.node, 0, moved_end)
            vst(scratch, o, 0, 0.5 * (vld(scratch, x.rows + x.vector * a + i, 0) - start + moved_end))
    put_ends(beam, k, beam.scratch, x, h)
    points = beam.mass_point.shape[1]
    for g in range(points):
        gather_momenta.call(dofs, beam, k, points, g, state.history, beam.scratch, x.momenta)


@separate
def evaluate_moving(beam, method, k, state, work, h, dofs):
    """Evaluate residual and tangent of group k in scratch; h: 0 at rest. Returns the layout, and that of `moved`."""
    tables, scratch = beam.tables, beam.scratch
    at = layout(dofs, tables.meta[k, NODES], tables.meta[k, POINTS])
    points = beam.mass_point.shape[1]
    x = moved(at, points, dofs)
    step = motion.call(method, state, work, h)
    gather_moving(beam, k, at, x, step, state, work, h, dofs)
    for c in range(dim(dofs)):
        for lane in range(8):
            scratch[x.first + WEIGHT + 8 * c + lane] = beam.following.gravity[0] * beam.weighs[c]
    # the tangent is exact, without the stresses of theory.md (4.6)
    case = Case(tables.meta[k, COUPLED] != 0, False, False)
    for lane in range(0, 8, WIDTH):
        tab = address(tables.tab, tables.meta[k, CONSTANTS] + lane)
        of_lanes = address(scratch, lane)
        evaluate_ends.call(dofs, beam, MOVING_STEP, beam.strains, tab, case.coupled, of_lanes, at, points, h)
        evaluate_lanes.call(dofs, MOVING_STEP, beam.strains, tab, address(scratch, x.rest + lane), of_lanes, at, case,
                            step.mass_factor)
    return at, x


@kernel
def add_rows(beam, k, at, work, dofs):
    """Add residual and tangent of group k from scratch, without inner nodes if these are eliminated."""
    every = eliminate_group.call(beam.inner, beam.tables, k, at, beam.scratch, work.r, dofs)
    scatter_group(beam.tables, k, at, every, beam.scratch, work.r, work.blocks, dofs)


@generic
def condense_border(inner, beam, k, at, x, dofs):
    """Eliminate the inner nodes of group k from the derivatives that belong to places of contacts, as `constraint_entries` does
    for other constraints, if `Following.condensed` says so."""


@condense_border.register(NoInner)
@inlined
def condense_no_border(inner, beam, k, at, x, dofs):
    pass


@condense_border.register(Inner)
@separate
def condense_border_of_group(inner, beam, k, at, x, dofs):
    scratch, store = beam.scratch, inner.store
    if beam.following.condensed[beam.first[0], NOW] == 0:
        return
    n = len(dofs)
    row, block, size = 8 * n, 8 * n * n, x.unknowns * at.nn
    lu = beam.tables.meta[k, FACTORS]
    for i in range(1, at.nn - 1):
        others = at.nn - i
        for side in range(2):
            column = x.rows + size * side
            solve_lanes(store, lu, scratch, column + row * i, 8, scratch, column + row * i, 8, dofs)
            for m in range(others):
                j = i + 1 + m if m < others - 1 else 0
                subtract_lanes(store, lu + block * (2 + 2 * m), scratch, column + row * i, scratch, column + row * j, ONE, dofs)
        for side in range(2):
            carry_forces(scratch, at, x, i, side, block, row)
            line = x.rows + size * (2 + side)
            for m in range(others):
                j = i + 1 + m if m < others - 1 else 0
                subtract_transposed(scratch, line + row * i, store, lu + block * (1 + 2 * m), line + row * j, n)
            to = row * (2 * ((at.nn - 2) * k + i - 1) + side)
            copy_lanes(scratch, x.rows + size * side + row * i, row, beam.carried, to)
        lu += block * (1 + 2 * others)


@inlined
def carry_forces(scratch, at, x, i, side, block, row):
    """Subtract from the force on a place, and from its derivatives by both, what they owe to inner node i of 8 elements."""
    size = x.unknowns * at.nn
    line = x.rows + size * (2 + side) + row * i
    # the solution of the residual, in place of the diagonal block
    own = at.blocks + block * (at.nn * i + i)
    gain = vld(scratch, x.first + GAIN + 8 * side, 0)
    for c in range(0, row, 8):
        gain -= vld(scratch, line + c, 0) * vld(scratch, own + c, 0)
    vst(scratch, x.first + GAIN + 8 * side, 0, gain)
    for other in range(2):
        o = x.first + CORNER + 16 * side + 8 * other
        corner = vld(scratch, o, 0)
        for c in range(0, row, 8):
            corner -= vld(scratch, line + c, 0) * vld(scratch, x.rows + size * other + row * i + c, 0)
        vst(scratch, o, 0, corner)


@inlined
def subtract_transposed(scratch, line, store, upper, to, n):
    """Subtract the product of n lanes and n rows of n lanes from n lanes of 8 elements."""
    for c in range(n):
        z = vld(scratch, to + 8 * c, 0)
        for a in range(n):
            z -= vld(scratch, line + 8 * a, 0) * vld(store, upper + 8 * (n * a + c), 0)
        vst(scratch, to + 8 * c, 0, z)


@kernel
def scatter_ends(beam, e, lane, scratch, at, x, dofs):
    """Add the forces of element e on the places of contacts, and the derivatives that belong to these places."""
    n = len(dofs)
    size = x.unknowns * at.nn
    following, shift = beam.following, beam.following.shift
    every = at.nn - 1 if following.condensed[beam.first[0], NOW] != 0 else 1
    for side in range(2):
        if beam.slot[e, side] < 0:
            continue
        f = beam.first[0] + beam.slot[e, side]
        mean, slope = shift[f, MEAN], shift[f, SLOPE]
        column = x.rows + size * side + lane
        line = column + 2 * size
        for a in range(0, at.nn, every):
            border = following.border[f, beam.entry[e, side, a]]
            for c in range(n):
                border[c] += slope * scratch[column + x.unknowns * a + 8 * c]
                border[n + c] += mean * scratch[line + x.unknowns * a + 8 * c]
        corner = x.first + CORNER + 16 * side + lane
        force = scratch[x.first + FORCES + 8 * side + lane]
        following.pull[f, 0] += mean * force
        following.pull[f, 1] += mean * slope * scratch[corner + 8 * side] + shift[f, BEND] * force
        following.pull[f, 2] += mean * scratch[x.first + GAIN + 8 * side + lane]
        if beam.slot[e, 1 - side] >= 0:
            # the contact behind has the number `side` = 0
            of_other = shift[f + 1 - 2 * side, SLOPE]
            following.cross[f - side, side] += mean * of_other * scratch[corner + 8 * (1 - side)]
        if beam.share[e, side] == float(side):
            put_tangent(beam, e, side, f, scratch, at, x, lane, dofs)


@kernel
def put_tangent(beam, e, side, f, scratch, at, x, lane, dofs):
    """Add the half of the tangent at the element end of contact f, at an end of element e, and its derivatives."""
    following = beam.following
    size = 0.5 * (scratch[x.first + LENGTHS + lane] + scratch[x.first + LENGTHS + 8 + lane])
    # the length at the end grows with the place ahead
    by_place = following.shift[f, SLOPE] * (beam.share[e, 1] - beam.share[e, 0]) * (0.5 if side == 1 else -0.5) / size
    for a in range(at.nn):
        slope = 0.5 * beam.edge[side, a] / size
        following.slope[f, beam.entry[e, side, a]] += 0.5 * slope
        for c in range(dim(dofs)):
            part = slope * scratch[at.node * a + 8 * c + lane]
            following.tangent[f, c] += part
            following.tangent[f, 3 + c] -= by_place * part


@kernel
def clear_contacts(beam, state, work):
    """Set what `scatter_ends` adds up to zero; inner nodes under contacts are not eliminated from the border."""
    following, first = beam.following, beam.first[0]
    on_nodes = put_shifts(beam, state, work)
    for f in range(first, first + beam.slider.shape[0]):
        following.condensed[f, NOW] = following.condensed[f, ALLOWED] if on_nodes else 0
        following.condensed[f, WAITS] = 0 if on_nodes else following.condensed[f, MAY_WAIT]
        following.pull[f, 0] = following.pull[f, 1] = following.pull[f, 2] = 0.0
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
    work, dofs = system.work, system.dofs
    clear_contacts(beam, system.state, work)
    waits = beam.following.condensed[beam.first[0], WAITS] != 0
    for k in range(beam.tables.meta.shape[0]):
        at, x = evaluate_moving(beam, method, k, system.state, work, h, dofs)
        if not waits:
            add_rows(beam, k, at, work, dofs)
            condense_border.call(beam.inner, beam, k, at, x, dofs)
        for lane in range(8):
            if 8 * k + lane < beam.node.shape[0]:
                scatter_ends(beam, 8 * k + lane, lane, beam.scratch, at, x, dofs)


@assemble.register(MovingRows, Conserving)
@kernel
def assemble_rows(term, method, system, h):
    """Add the rows of a beam that wait for those of contacts."""
    beam, work, dofs = term.beam, system.work, system.dofs
    if beam.following.condensed[beam.first[0], WAITS] != 0:
        for k in range(beam.tables.meta.shape[0]):
            at, _ = evaluate_moving(beam, method, k, system.state, work, h, dofs)
            add_rows(beam, k, at, work, dofs)


@assemble.register(MovingBeam, Equilibrium)
@kernel
def assemble_moving_at_rest(beam, method, system, h):
    """Add the beam in an equilibrium, where both ends of the step are the present shape."""
    for j in range(beam.slider.shape[0]):
        system.work.s_end[beam.slider[j]] = system.state.s[beam.slider[j]]
    assemble_moving(beam, method, system, 0.0)


@assemble.register(MovingRows, Equilibrium)
@kernel
def assemble_rows_at_rest(term, method, system, h):
    assemble_rows(term, method, system, 0.0)


@kernel
def follow_places(beam, system):
    """Add to increments of all inner nodes what they owe to those of the places of contacts."""
    if beam.following.condensed[beam.first[0], NOW] != 0:
        for k in range(beam.tables.meta.shape[0]):
            follow_places_in_group(beam, k, system.work, system.dofs)


@kernel
def follow_places_in_group(beam, k, work, dofs):
    """Run `follow_places` for group k."""
    tables, scratch, x_out = beam.tables, beam.scratch, work.increment.x
    n, nn = len(dofs), tables.meta[k, NODES]
    row = 8 * n
    for lane in range(8):
        for side in range(2):
            contact = beam.slot[beam.lane[8 * k + lane], side]
            z = 0.0
            if contact >= 0:
                # contacts are nodes, so their places are those of element ends
                z = work.y[beam.following.at[beam.slider[contact], UNKNOWN]]
            scratch[8 * side + lane] = z
    for i in range(1, nn - 1):
        no = tables.meta[k, LIST] + 8 * i
        gather_lanes(x_out, tables.rows, no, 8, scratch, 16, dofs)
        first = row * 2 * ((nn - 2) * k + i - 1)
        for c in range(0, row, 8):
            y = vld(scratch, 16 + c, 0) - vld(beam.carried, first + c, 0) * vld(scratch, 0, 0)
            vst(scratch, 16 + c, 0, y - vld(beam.carried, first + row + c, 0) * vld(scratch, 8, 0))
        put_rows(scratch, 16, tables.rows, no, 8, 0, x_out, dofs)


@account.register(MovingBeam)
@kernel
def account_moving(beam, system, h):
    """Update momenta to the end of the step, twice their means less those at its start, and the work of the weight."""
    state, work, dofs = system.state, system.work, system.dofs
    first = beam.place[1]
    put_shifts(beam, state, work)
    spread_nodes.call(dofs, system.method, state, work, h, first, first + beam.place[2])
    for k in range(beam.tables.meta.shape[0]):
        take_momenta(beam, k, state, work, h, dofs)
    behind = density_place(beam, beam.node.shape[0], 0, 0)
    for j in range(beam.slider.shape[0]):
        # as the velocities of nodes
        place = behind + j
        state.history[place] = 2.0 * rate_of(beam, j, h) - state.history[place]
    way = height_of(beam, work.q_end, work.s_end, dofs) - height_of(beam, state.q, state.s, dofs)
    state.history[behind + beam.slider.shape[0]] += beam.following.gravity[0] * way


@separate
def take_momenta(beam, k, state, work, h, dofs):
    """Store the momenta of group k at the end of the step."""
    at = layout(dofs, beam.tables.meta[k, NODES], beam.tables.meta[k, POINTS])
    x = moved(at, beam.mass_point.shape[1], dofs)
    gather_moving(beam, k, at, x, motion.call(MOVING_STEP, state, work, h), state, work, h, dofs)
    for lane in range(0, 8, WIDTH):
        put_momenta(beam, address(beam.scratch, lane), at, x, dofs)
    points = beam.mass_point.shape[1]
    for lane in range(8):
        if 8 * k + lane < beam.node.shape[0]:
            for g in range(points):
                keep_momenta.call(dofs, beam, points, 8 * k + lane, g, lane, beam.scratch, x.momenta, state.history)


@within_limits.register(MovingBeam)
@kernel
def contacts_keep_distance(beam, system, counts_out):
    """Return whether element ends at contacts are at least `length[1]` from each other."""
    before = 0.0
    for j in range(beam.slider.shape[0]):
        y = place_of(beam.following, beam.first[0] + j, system.state.s[beam.slider[j]])
        if j > 0 and not y - before >= beam.length[1]:
            counts_out[3] = system.state.s.shape[0] + beam.place[3] + j - 1
            return False
        before = y
    return True
