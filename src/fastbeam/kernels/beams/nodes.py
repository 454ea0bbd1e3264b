"""Node loops: predictor, update of position and triad, point inertia, held unknowns.

A step is described by the increments `dphi` of the positions and the Cayley vectors `theta` of the triads, d_n+1 = cay(theta) d_n
(theory.md (4.2)); increments dq of all 12 coordinates of a node follow from them wherever they are needed. Velocities and inertia
forces are formed from dq, never from differences of large coordinates, so round-off stays relative to the motion.

Arrays: q, v, u, q_mid, q_end, q_mid_out, q_end_out, u_out [12 N]; dphi, theta [3 N]; row_of, spinless, held_theta [N]; x, r,
r_out [8 (rows + 1)]; blocks, blocks_out [48 (blocks + 1)], blocks of 6 rows of 8, in a plane 3; panel [rows, n, width] flat; s,
s_end [S]; force [3 S], in a plane [2 S]; past [*] as in `remember`; scratch [NODES_SCRATCH].
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.blocks import SIX, THREE, TWELVE
from fastbeam.kernels.algebra.cayley import cayley_increment, director_increment
from fastbeam.kernels.algebra.dimensions import Space, coordinates
from fastbeam.kernels.algebra.lanes import gather_lanes, load_rows, store_rows
from fastbeam.kernels.algebra.vectors import (
    add3,
    add_iso,
    add_matrix,
    add_skew,
    cross,
    dot,
    largest,
    ld3,
    outer,
    st3,
    total,
    vld,
    vld3,
    vst,
    vst3,
    vzero,
    zero3,
    zerom,
)
from fastbeam.kernels.jit.decorators import inlined, kernel, separate
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.terms import (
    AtRest,
    Conserving,
    Equilibrium,
    Midpoint,
    advance_nodes,
    assemble,
    carry_columns,
    move_nodes,
    predict_nodes,
    spread_nodes,
)


class Bodies(NamedTuple):
    """Nodes with an inertia of their own: point masses and rigid bodies."""

    node: np.ndarray     # int64 [B]
    row: np.ndarray      # int64 [B]
    block: np.ndarray    # int64 [B]: diagonal block
    inertia: np.ndarray  # float64 [16 B]: symmetric 4 x 4 over (phi, d1, d2, d3), Euler tensor for the directors


class Held(NamedTuple):
    """Unknowns that do not change: clamps, pins, triads of point masses, tied coordinates."""

    row: np.ndarray        # int64 [F]
    mask: np.ndarray       # int64 [F]: bit c set, unknown c of that row is held
    diagonal: np.ndarray   # int64 [F]
    block: np.ndarray      # int64 [P]: blocks in a row or column of a held unknown
    row_mask: np.ndarray   # int64 [P]
    column_mask: np.ndarray  # int64 [P]


class NoHeld(NamedTuple):
    """Placeholder for a scene without supports."""


# doubles of scratch that `update_nodes` and `advance` need
NODES_SCRATCH = 240


@kernel
def turn_of(theta, i):
    """Return the Cayley vector of node i in this step, and the factor of `cayley.director_increment`."""
    t = ld3(theta, 3 * i, 1)
    return t, 1.0 / (1.0 + 0.25 * dot(t, t))


@inlined
def is_zero(blocks, o, rows):
    """Return whether `rows` rows of 8 from o on are zero, like the blocks of points of bodies that have only joints."""
    x = vld(blocks, o, 0)
    squares = x * x
    for i in range(o + 8, o + 8 * rows, 8):
        x = vld(blocks, i, 0)
        squares += x * x
    return total(squares) == 0.0


@kernel
def extrapolation(past, h):
    """Return the factor c of the first guess w1 + c (w1 - w2), which extrapolates the mean rates w1, w2 of the last two steps by
    the times of their middles. 0 if only one step is known or is to be used, or c would be large; NaN if no step is known."""
    if past[0] == 0.0:
        return np.nan
    if past[0] == 1.0 or past[3] == 0.0:
        return 0.0
    c = (0.5 * h - past[1]) / (past[1] - past[2])
    return c if abs(c) <= 4.0 else 0.0


@kernel
def predict_from(past, o, share, c, h, first, last, x):
    """Predict increments from the mean rates of two steps, for the numbers from `first` to before `last`: the newest are `share`
    times the increments of the last step and move to `past`; where share is 0 they stand there, and are all that is known."""
    k = first
    if share != 0.0:
        while k + 8 <= last:
            w = share * vld(x, k, 0)
            vst(x, k, 0, h * ((1.0 + c) * w - c * vld(past, o + k, 0)))
            vst(past, o + k, 0, w)
            k += 8
        while k < last:
            w = share * x[k]
            x[k] = h * ((1.0 + c) * w - c * past[o + k])
            past[o + k] = w
            k += 1
    else:
        for k in range(first, last):
            x[k] = h * past[o + k]


@separate
def predict(q, v, h, c, past, held_theta, first, last, theta, dphi):
    """Predict a step from the mean rates of the last two (`extrapolation` c), for the nodes from `first` to before `last`;
    past[3]: size of the step whose increments stand in dphi and theta, 0 where those are no rates. Where c is NaN positions move
    on and triads spin on with omega = 1/2 sum d_i x v_i."""
    if c == c:
        share = 1.0 / past[3] if past[3] != 0.0 else 0.0
        turns = past.shape[0] - 1 - theta.shape[0]
        predict_from(past, turns - dphi.shape[0], share, c, h, 3 * first, 3 * last, dphi)
        predict_from(past, turns, share, c, h, 3 * first, 3 * last, theta)
    else:
        for i in range(first, last):
            st3(dphi, 3 * i, 1, h * ld3(v, 12 * i, 1))
            w = zero3()
            for k in range(3, 12, 3):
                w += cross(ld3(q, 12 * i + k, 1), ld3(v, 12 * i + k, 1))
            free = 0.0 if held_theta[i] else 0.5 * h
            st3(theta, 3 * i, 1, free * w)


@kernel
def remember(s, s_end, force, d, h, past):
    """Record the increments of a converged step of size h as the newest rates; contact forces have d components.

    past: how many rates are known, times of their middles from now on, size of the step whose increments are the newest of the
    nodes or 0; s and force of every slider, newest and older; older increments of the nodes, positions, then Cayley vectors; size
    of the first increment of the last step."""
    past[2] = past[1] - h
    past[1] = -0.5 * h
    past[0] = min(past[0] + 1.0, 2.0)
    past[3] = h
    if s.shape[0] > 0:
        m = (d + 1) * s.shape[0]
        for k in range(4, 4 + m):
            past[k + m] = past[k]
        for k in range(s.shape[0]):
            o = 4 + (d + 1) * k
            past[o] = (s_end[k] - s[k]) / h
            for c in range(d):
                past[o + 1 + c] = force[d * k + c]


@kernel
def spread_vector(q, v, move, h, k, q_mid_out, q_end_out, u_out):
    """Form mid, end and second rate 2/h^2 (dq - h v) of one vector of a node from its increment."""
    x = ld3(q, k, 1)
    st3(q_mid_out, k, 1, x + 0.5 * move)
    st3(q_end_out, k, 1, x + move)
    if k < u_out.shape[0]:
        st3(u_out, k, 1, (2.0 / (h * h)) * (move - h * ld3(v, k, 1)))


@separate
def spread(q, v, dphi, theta, h, first, last, q_mid_out, q_end_out, u_out):
    """Form mid and end coordinates and second rates of the nodes from `first` to before `last`; arrays of length 0 are left
    out."""
    if q_mid_out.shape[0] > 0:
        for i in range(first, last):
            t, c = turn_of(theta, i)
            spread_vector(q, v, ld3(dphi, 3 * i, 1), h, 12 * i, q_mid_out, q_end_out, u_out)
            for k in range(12 * i + 3, 12 * i + 12, 3):
                spread_vector(q, v, director_increment(c, t, ld3(q, k, 1)), h, k, q_mid_out, q_end_out, u_out)


@separate
def update_nodes(row_of, x, first, last, theta, dphi, scratch):
    """Add the rows of x, 8 doubles each, to the increments of a step, of the nodes from `first` to before `last`. Returns the
    largest position increment and the largest increment of a Cayley vector over sqrt(1 + theta.theta/4): spins alone would also
    become small where theta grows without bound, towards half a turn. NaN counts as larger than any number."""
    move = 0.0
    spin = 0.0
    i = first
    if first + 8 <= last:
        moves = vzero()
        spins = vzero()
        while i + 8 <= last:
            # eight nodes at a time: rows of x and increments in lanes
            gather_lanes(x, row_of, i, 8, scratch, 0, SIX)
            load_rows(theta, 3 * i, 3, scratch, 48, THREE)
            load_rows(dphi, 3 * i, 3, scratch, 72, THREE)
            for c in range(0, 24, 8):
                moves = largest(vld(scratch, c, 0), moves)
            t = vld3(scratch, 48, 8)
            p = cayley_increment(t, vld3(scratch, 24, 8))
            spins = largest(dot(p, p) / (1.0 + 0.25 * dot(t, t)), spins)
            vst3(scratch, 48, 8, t + p)
            vst3(scratch, 72, 8, vld3(scratch, 72, 8) + vld3(scratch, 0, 8))
            store_rows(scratch, 48, theta, 3 * i, 3, THREE)
            store_rows(scratch, 72, dphi, 3 * i, 3, THREE)
            i += 8
        vst(scratch, 0, 0, moves)
        vst(scratch, 8, 0, spins)
        for k in range(8):
            move = larger(scratch[k], move)
            spin = larger(scratch[8 + k], spin)
    while i < last:
        o = 8 * row_of[i]
        add3(dphi, 3 * i, 1, ld3(x, o, 1))
        for c in range(3):
            move = larger(abs(x[o + c]), move)
        t = ld3(theta, 3 * i, 1)
        p = cayley_increment(t, ld3(x, o + 3, 1))
        spin = larger(dot(p, p) / (1.0 + 0.25 * dot(t, t)), spin)
        add3(theta, 3 * i, 1, p)
        i += 1
    return move, np.sqrt(spin)


@kernel
def larger(x, y):
    """Return the larger of two numbers, NaN if one is."""
    return x if x > y or x != x else y


@separate
def add_bodies(bodies, q_mid, q_end, u, mass_factor, r_out, blocks_out):
    """Add the inertia of point masses and rigid bodies; the director form of the inertia of a body, same projection as a beam
    node. mass_factor: 2/h^2, or 0 if the derivative of u is added elsewhere."""
    for k in range(bodies.node.shape[0]):
        q = 12 * bodies.node[k]
        ro = 8 * bodies.row[k]
        ko = 48 * bodies.block[k]
        j0 = 16 * k
        tt = zerom(); tr = zerom(); rt = zerom(); rr = zerom()
        moment = zero3()
        for a in range(4):
            f = zero3()
            for b in range(4):
                f += bodies.inertia[j0 + 4 * a + b] * ld3(u, q + 3 * b, 1)
            if a == 0:
                add3(r_out, ro, 1, f)
            else:
                moment += cross(ld3(q_mid, q + 3 * a, 1), f)
                d = ld3(q_end, q + 3 * a, 1)
                rr += 0.5 * add_iso(outer(d, f), -dot(d, f))
        add3(r_out, ro + 3, 1, moment)
        for a in range(4):
            x = ld3(q_mid, q + 3 * a, 1)
            for b in range(4):
                m = mass_factor * bodies.inertia[j0 + 4 * a + b]
                if m != 0.0:
                    y = ld3(q_end, q + 3 * b, 1)
                    if a == 0 and b == 0:
                        tt = add_iso(tt, m)
                    elif a == 0:
                        tr = add_skew(tr, -m * y)
                    elif b == 0:
                        rt = add_skew(rt, m * x)
                    else:
                        rr += add_iso(zerom() - outer(m * y, x), m * dot(x, y))
        add_matrix(blocks_out, ko, 8, 1, tt)
        add_matrix(blocks_out, ko + 3, 8, 1, tr)
        add_matrix(blocks_out, ko + 24, 8, 1, rt)
        add_matrix(blocks_out, ko + 27, 8, 1, rr)


@separate
def apply_held(held, r, blocks, dofs):
    """Replace rows and columns of prescribed unknowns by those of the identity."""
    n = len(dofs)
    for k in range(held.block.shape[0]):
        o = 8 * n * held.block[k]
        rm = held.row_mask[k]
        cm = held.column_mask[k]
        for i in range(n):
            for j in range(n):
                if (rm >> i) & 1 or (cm >> j) & 1:
                    blocks[o + 8 * i + j] = 0.0
    for k in range(held.row.shape[0]):
        for c in range(n):
            if (held.mask[k] >> c) & 1:
                r[8 * held.row[k] + c] = 0.0
                blocks[8 * n * held.diagonal[k] + 9 * c] = 1.0


@kernel
def clear_held(held, width, panel, dofs):
    """Set prescribed unknowns to zero in all columns."""
    n = len(dofs)
    for k in range(held.row.shape[0]):
        for c in range(n):
            if (held.mask[k] >> c) & 1:
                o = (n * held.row[k] + c) * width
                for j in range(width):
                    panel[o + j] = 0.0


class NoVelocities(NamedTuple):
    """Placeholder for velocities: statics changes only shapes."""


NO_VELOCITIES = NoVelocities()


@generic
def load_velocities(v, i, scratch):
    """Load rates of eight nodes from i on into lanes."""


@generic
def accept(v, scratch, k, move, h):
    """Run `advance` for a vector in lanes at k, whose rate stands 96 doubles behind."""


@generic
def store_velocities(v, i, scratch):
    """Store rates of eight nodes from i on from lanes."""


@generic
def accept_one(v, q, k, move, h):
    """Run `advance` for one vector of a node."""


@load_velocities.register(NoVelocities)
@store_velocities.register(NoVelocities)
@kernel
def pass_no_velocities(v, i, scratch):
    pass


@load_velocities.register(object)
@inlined
def load_velocities_of_nodes(v, i, scratch):
    load_rows(v, 12 * i, 12, scratch, 96, TWELVE)


@store_velocities.register(object)
@inlined
def store_velocities_of_nodes(v, i, scratch):
    store_rows(scratch, 96, v, 12 * i, 12, TWELVE)


@accept.register(NoVelocities)
@inlined
def accept_shape(v, scratch, k, move, h):
    vst3(scratch, k, 8, vld3(scratch, k, 8) + move)


@accept.register(object)
@inlined
def accept_motion(v, scratch, k, move, h):
    vst3(scratch, k, 8, vld3(scratch, k, 8) + move)
    velocity = vld3(scratch, k + 96, 8)
    vst3(scratch, k + 96, 8, velocity + (2.0 / h) * (move - h * velocity))


@accept_one.register(NoVelocities)
@inlined
def accept_one_shape(v, q, k, move, h):
    st3(q, k, 1, ld3(q, k, 1) + move)


@accept_one.register(object)
@inlined
def accept_one_motion(v, q, k, move, h):
    st3(q, k, 1, ld3(q, k, 1) + move)
    velocity = ld3(v, k, 1)
    st3(v, k, 1, velocity + (2.0 / h) * (move - h * velocity))


@separate
def advance(q, v, dphi, theta, h, first, last, scratch):
    """Accept the increments of the nodes from `first` to before `last`: q <- q + dq, v <- v + 2/h (dq - h v), theory.md (4.2); in
    statics, where v is NO_VELOCITIES, only the first."""
    i = first
    while i + 8 <= last:
        load_rows(q, 12 * i, 12, scratch, 0, TWELVE)
        load_rows(dphi, 3 * i, 3, scratch, 192, THREE)
        load_rows(theta, 3 * i, 3, scratch, 216, THREE)
        load_velocities.call(v, i, scratch)
        t = vld3(scratch, 216, 8)
        c = 1.0 / (1.0 + 0.25 * dot(t, t))
        accept.call(v, scratch, 0, vld3(scratch, 192, 8), h)
        for k in range(24, 96, 24):
            accept.call(v, scratch, k, director_increment(c, t, vld3(scratch, k, 8)), h)
        store_rows(scratch, 0, q, 12 * i, 12, TWELVE)
        store_velocities.call(v, i, scratch)
        i += 8
    while i < last:
        t, c = turn_of(theta, i)
        accept_one.call(v, q, 12 * i, ld3(dphi, 3 * i, 1), h)
        for k in range(12 * i + 3, 12 * i + 12, 3):
            accept_one.call(v, q, k, director_increment(c, t, ld3(q, k, 1)), h)
        i += 1


# --- as parts of a step -------------------------------------------------------------------------------------------------
@predict_nodes.register(Space)
@kernel
def predict_in_space(dofs, state, work, spinless, h, c, first, last):
    predict(state.q, state.v, h, c, work.past, spinless, first, last, work.theta, work.dphi)


@spread_nodes.register(Space, Conserving)
@spread_nodes.register(Space, Midpoint)
@kernel
def spread_in_space(dofs, method, state, work, h, first, last):
    spread(state.q, state.v, work.dphi, work.theta, h, first, last, work.q_mid, work.q_end, work.u)


@spread_nodes.register(object, Equilibrium)
@spread_nodes.register(object, AtRest)
@kernel
def spread_at_rest(dofs, method, state, work, h, first, last):
    """Set middle and end to the present shape."""
    n = coordinates(dofs)
    for c in range(n * first, min(n * last, work.q_mid.shape[0])):
        work.q_mid[c] = state.q[c]
        work.q_end[c] = state.q[c]


@move_nodes.register(Space)
@kernel
def move_in_space(dofs, row_of, work, first, last, scratch):
    return update_nodes(row_of, work.increment.x, first, last, work.theta, work.dphi, scratch)


@advance_nodes.register(Space)
@kernel
def advance_in_space(dofs, method, state, work, h, first, last, scratch):
    advance(state.q, state.v, work.dphi, work.theta, h, first, last, scratch)


@advance_nodes.register(Space, Equilibrium)
@kernel
def move_at_rest(dofs, method, state, work, h, first, last, scratch):
    advance(state.q, NO_VELOCITIES, work.dphi, work.theta, 0.0, first, last, scratch)


@assemble.register(Bodies, Conserving)
@assemble.register(Bodies, Midpoint)
@kernel
def assemble_bodies(bodies, method, system, h):
    work = system.work
    add_bodies(bodies, work.q_mid, work.q_end, work.u, 2.0 / (h * h), work.r, work.blocks)


@assemble.register(Bodies, AtRest)
@kernel
def assemble_bodies_at_rest(bodies, method, system, h):
    work = system.work
    add_bodies(bodies, work.q_mid, work.q_end, work.u, 0.0, work.r, work.blocks)


@assemble.register(Held)
@kernel
def assemble_held(held, method, system, h):
    apply_held(held, system.work.r, system.work.blocks, system.dofs)


@carry_columns.register(Held)
@kernel
def carry_held_columns(held, system):
    clear_held(held, system.width, system.work.panel, system.dofs)
