"""Sliding contact of a point on the curve of a beam: the discrete gradient of theory.md 5.1.

With the force F = sum lam_i d_i,mid as unknown instead of the multipliers, the directors of the frame drop out of the equations:
only the Cayley vector theta of the frame in this step is left. Any rotation that moves with the structure will do; here the
frame turns with the curve under the contact, theta = sum_A N_A,mean theta_A: it favours no node and is symmetric in time.

    force       +F on the point, -N_A,mean F on node A, moment N_A,mean F x g_mean on node A,
                g_mean = phi_S,mid - sum_A N_A,mean phi_A,mid
    sliding     F . (T_n + T_n+1)/2 + 1/4 (theta x F) . (T_n+1 - T_n) = 0,   T_k = sum_A N[s_n, s_n+1]_A phi_A(k)        (5.3)
    gap         phi_S - sum_A N_A(s) phi_A = 0 at n+1                                                                     (5.4)

Each slider is a border of 7 on the matrix of the nodes: F (3), s, and g_mean (3), which keeps the frame's moment from coupling
nodes that no element joins; in a plane of 5, with a Cayley number for the frame. The compared methods have sliders without a
frame, theory.md (7.1).
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .._generic import generic
from .._jit import kernel
from .algebra import dot
from .alpha import Alpha
from .curves import Curves, add_basis, find_element, point_on_curve, step_basis
from .kinds import (add_to, cayley_vector, coordinates, cross_product, dim, on_spin, position, put, put_cross_matrix, spin_cross,
                    vector, zero_spin, zero_vector)
from .terms import Conserving, Midpoint, NoTies, assemble, first_guess, is_settled, take_unknowns, within_limits


END_SLACK = 1e-12


class Sliders(NamedTuple):
    """One row a slider."""

    curve: np.ndarray       # int64 [S]
    point: np.ndarray       # int64 [S]: node of the sliding point
    spin_root: np.ndarray   # int64 [N]: the node whose spin a node shares


class Sliding(NamedTuple):
    """The term of all sliders; their work arrays are `System.contact`."""

    curves: Curves
    sliders: Sliders
    ties: Any               # ties.Ties, planar_nodes.PlanarTies or NoTies
    lengths: np.ndarray     # float64 [S]: arc length where the beam of each slider ends


class Contact(NamedTuple):
    """Work of all constraints with multipliers: the sliders come first, then joints; S constraints, `E` entries each at most."""

    basis: np.ndarray       # float64 [5, n]: N(s_n), N(s_n+1), N'(s_n+1), N[s_n, s_n+1], its derivative by s_n+1
    legendre: np.ndarray    # float64 [3, n_coef]
    entries: np.ndarray     # int64 [S]: number of entries
    row: np.ndarray         # int64 [S, E]: row of the residual
    column: np.ndarray      # float64 [S, 48 E]: column[6 x 8] of every entry, derivative of the rows by the border unknowns
    line: np.ndarray        # float64 [S, 48 E]: derivative of the border equations by the unknowns of the row, transposed
    corner: np.ndarray      # float64 [S, 64]
    residual: np.ndarray    # float64 [S, 8]
    element: np.ndarray     # int64 [S]: element of s_n, a hint
    forces: np.ndarray      # int64 [S]: number of forces, as many equations come first, gaps
    first: np.ndarray       # int64 [S]: number of the first unknown among those of all constraints
    first_force: np.ndarray  # int64 [S]: number of the first force
    compliance: np.ndarray  # float64 [S]: of the parts that each slider joins, in a step
    remaining: np.ndarray   # float64 [S]: gap that the augmented Lagrangian leaves after the last iteration
    full: np.ndarray        # int64 [1]: 1 where a slider had more entries than there is room for
    augmented: np.ndarray   # float64 [4]: 1/factor of theory.md (5.5), least compliance of the parts, 1 in the first iteration,
    #                         largest increment of s


class ContactInRows(Contact):
    """The same where sliders are rows of the block matrix (constraints.py) and no dense border."""


class ContactOfCarriers(Contact):
    """The same, without entries, where all sliders are eliminated with their beams (carriers.py)."""


@generic
def tied_arm(ties, e, q):
    """Offset of entry e of tied nodes of kind 1, a point carried on an arm, at coordinates q."""


@kernel
def predict_sliders(curves, sliders, contact, q, v, s, h, c, past, s_out, force_out, size):
    """First guess of s and force: as `nodes.predict`; where c is NaN the rate by least squares of v_S - sum N_A v_A = c' ds/dt
    (theory.md 5.4) and the force of the last step."""
    d = dim(size)
    m = (d + 1) * s.shape[0]
    for k in range(sliders.curve.shape[0]):
        b = sliders.curve[k]
        e = find_element(curves, b, s[k], contact.element[k])
        contact.element[k] = e
        if c == c:
            i = 4 + (d + 1) * k
            s_out[k] = s[k] + h * ((1.0 + c) * past[i] - c * past[i + m])
            put(force_out, d * k, 1, (1.0 + c) * vector(past, i + 1, 1, size) - c * vector(past, i + m + 1, 1, size))
        else:
            tangent = point_on_curve(curves, b, s[k], q, e, contact, 1, size)
            relative = position(v, sliders.point[k], size) - point_on_curve(curves, b, s[k], v, e, contact, 0, size)
            s_out[k] = s[k] + h * dot(relative, tangent) / dot(tangent, tangent)


@kernel
def new_entry(contact, k, row, size):
    """Offset of a fresh entry of slider k; that of the last one again, and `full` says so, where there is no room."""
    m = contact.entries[k]
    if m == contact.row.shape[1]:
        contact.full[0] = 1
        m -= 1
    n = 8 * len(size)
    contact.entries[k] = m + 1
    contact.row[k, m] = row
    for i in range(n * m, n * m + n):
        contact.column[k, i] = 0.0
        contact.line[k, i] = 0.0
    return n * m


@kernel
def put_position(contact, k, row, n_mean, n_end, rate, f, slide, size):
    """Entry of a position: its force is n_mean F, the gap changes with -n_end, g_mean with -n_mean/2; `rate` is the derivative of
    n_mean by s, `slide` the derivative of the sliding equation by the position. Returns its offset."""
    o = new_entry(contact, k, row, size)
    d = dim(size)
    column = contact.column[k]
    line = contact.line[k]
    for i in range(d):
        column[o + 8 * i + i] = n_mean
        line[o + 8 * i + i] = -n_end
        line[o + 8 * i + d + 1 + i] = 0.5 * n_mean
    put(column, o + d, 8, rate * f)
    put(line, o + d, 8, slide)
    return o


@kernel
def put_arm(contact, k, row, arm_mid, arm_end, n_mean, n_end, rate, f, slide, size):
    """Entry of the spin of a node that carries the position of `put_position` on an arm."""
    d = dim(size)
    o = new_entry(contact, k, row, size) + 8 * d
    column = contact.column[k]
    line = contact.line[k]
    put_cross_matrix(column, o, n_mean, arm_mid)
    put(column, o + d, 8, cross_product.call(arm_mid, rate * f))
    put_spin_lines(line, o, n_mean, n_end, arm_end, size)
    put(line, o + d, 8, cross_product.call(arm_end, slide))


@kernel
def put_spin_lines(line, o, n_mean, n_end, arm, size):
    """Derivatives of gap and mean gap by the spin that moves an arm."""
    put_cross_matrix(line, o, -n_end, arm)
    put_cross_matrix(line, o + dim(size) + 1, 0.5 * n_mean, arm)


@generic
def put_translation(ties, contact, k, node, row, q_mid, q_end, n_mean, n_end, rate, f, slide, size):
    """Entry of the position of one node as in `put_position`; tied nodes pass it on. Returns the offset of the node's own entry,
    -1 where it is tied."""


@put_translation.register(NoTies)
@kernel
def put_free_translation(ties, contact, k, node, row, q_mid, q_end, n_mean, n_end, rate, f, slide, size):
    return put_position(contact, k, row, n_mean, n_end, rate, f, slide, size)


@kernel
def put_tied_translation(ties, contact, k, node, row, q_mid, q_end, n_mean, n_end, rate, f, slide, size):
    """`put_translation` where there are tied nodes."""
    if ties.start[node + 1] > ties.start[node]:
        for t in range(ties.start[node], ties.start[node + 1]):
            if ties.kind[t] == 0:
                put_position(contact, k, ties.target_row[t], n_mean, n_end, rate, f, slide, size)
            elif ties.kind[t] == 1:
                put_arm(contact, k, ties.target_row[t], tied_arm.call(ties, t, q_mid), tied_arm.call(ties, t, q_end), n_mean,
                        n_end, rate, f, slide, size)
        return -1
    return put_position(contact, k, row, n_mean, n_end, rate, f, slide, size)


@kernel
def add_sliders(curves, sliders, contact, ties, row_of, q, q_mid, q_end, theta, s, s_end, force, r_out, size):
    """Forces of all sliders into the residual and their borders into `contact`."""
    d = dim(size)
    for k in range(sliders.curve.shape[0]):
        c = sliders.curve[k]
        base = curves.meta[c, 0]
        e0 = find_element(curves, c, s[k], contact.element[k])
        e1 = find_element(curves, c, s_end[k], e0)
        p = curves.meta[c, 3]
        lo = curves.first[p + min(e0, e1)]
        last = p + max(e0, e1)
        hi = curves.first[last] + curves.count[last]
        step_basis(curves, c, s[k], s_end[k], e0, e1, lo, hi, contact)
        basis = contact.basis
        f = vector(force, d * k, 1, size)
        # curve at the end of the step, mean gap, mean tangents at both ends of the step, rotation of the frame
        end = zero_vector(size); end_s = zero_vector(size); mean = zero_vector(size); mean_s = zero_vector(size)
        t0 = zero_vector(size); t1 = zero_vector(size); dt0 = zero_vector(size); dt1 = zero_vector(size)
        th = zero_spin(size); th_s = zero_spin(size)
        for a in range(lo, hi):
            n_mean = 0.5 * (basis[0, a] + basis[1, a])
            x0 = position(q, base + a, size); x1 = position(q_end, base + a, size); xm = position(q_mid, base + a, size)
            end += basis[1, a] * x1
            end_s += basis[2, a] * x1
            mean += n_mean * xm
            mean_s += basis[2, a] * xm
            t0 += basis[3, a] * x0; t1 += basis[3, a] * x1
            dt0 += basis[4, a] * x0; dt1 += basis[4, a] * x1
            x = cayley_vector(theta, sliders.spin_root[base + a], size)
            th += n_mean * x
            th_s += (0.5 * basis[2, a]) * x
        point = sliders.point[k]
        gap = position(q_end, point, size) - end
        g_mean = position(q_mid, point, size) - mean
        jump = t1 - t0
        turned = spin_cross.call(th, f)
        # residual rows: -F on the point, +N F and -N F x g_mean on the curve
        add_to(r_out, 8 * row_of[point], 1, -1.0 * f)
        contact.entries[k] = 0
        slide = 0.5 * f + 0.25 * turned
        back = 0.5 * f - 0.25 * turned
        moment = cross_product.call(g_mean, f)
        across = cross_product.call(f, jump)
        for a in range(lo, hi):
            n_mean = 0.5 * (basis[0, a] + basis[1, a])
            rate = 0.5 * basis[2, a]
            node = base + a
            root = sliders.spin_root[node]
            add_to(r_out, 8 * row_of[node], 1, n_mean * f)
            add_to(r_out, 8 * row_of[root] + d, 1, n_mean * moment)
            o = put_translation.call(ties, contact, k, node, row_of[node], q_mid, q_end, n_mean, basis[1, a], rate, f,
                                     basis[3, a] * slide, size)
            if o < 0 or root != node:
                o = new_entry(contact, k, row_of[root], size)
            # the node's share in the frame: its moment n_mean g_mean x F, its theta in the sliding equation
            column = contact.column[k]
            put_cross_matrix(column, o + 8 * d, n_mean, g_mean)
            put_cross_matrix(column, o + 9 * d + 1, -n_mean, f)
            put(column, o + 9 * d, 8, rate * moment)
            put(contact.line[k], o + 9 * d, 8, on_spin.call(cayley_vector(theta, root, size), (0.25 * n_mean) * across))
        put_translation.call(ties, contact, k, point, row_of[point], q_mid, q_end, -1.0, -1.0, 0.0, f, zero_vector(size), size)
        # corner: rows gap, sliding, g_mean against F, s, g_mean
        corner = contact.corner[k]
        for i in range(64):
            corner[i] = 0.0
        put(corner, d, 8, -1.0 * end_s)
        put(corner, 8 * d, 1, 0.5 * (t0 + t1) - 0.25 * spin_cross.call(th, jump))
        corner[9 * d] = dot(slide, dt1) + dot(back, dt0) + 0.25 * dot(spin_cross.call(th_s, f), jump)
        put(corner, 9 * d + 8, 8, 0.5 * mean_s)
        put_residual(contact, k, gap, dot(slide, t1) + dot(back, t0), size)


@kernel
def put_residual(contact, k, gap, sliding, size):
    """Residuals of the border of slider k, and the equation g_mean = mean gap, which holds whatever the increment."""
    d = dim(size)
    residual = contact.residual[k]
    put(residual, 0, 1, gap)
    residual[d] = sliding
    for i in range(d + 1, 2 * d + 1):
        contact.corner[k, 9 * i] = 1.0
        residual[i] = 0.0


@kernel
def add_plain_sliders(curves, sliders, contact, ties, row_of, q_mid, q_end, s, s_end, force, share, r_out, size):
    """Sliders of the compared methods, theory.md (7.1): force and sliding direction at one instant, the gap at the end of the
    step. With share = 1 the instant is the middle of the step; with share = 1/2, the share of the tangent that the node matrix
    then holds, it is the end, and q_mid = q_end. The border is that of the conserving step without the frame."""
    d = dim(size)
    near = 0.5 / share    # derivative of the instant's s and q by those of the end
    for k in range(sliders.curve.shape[0]):
        c = sliders.curve[k]
        base = curves.meta[c, 0]
        e0 = find_element(curves, c, s[k], contact.element[k])
        e1 = find_element(curves, c, s_end[k], e0)
        si = s[k] + near * (s_end[k] - s[k])
        ei = find_element(curves, c, si, e0)
        p = curves.meta[c, 3]
        lo = curves.first[p + min(ei, e1)]
        hi = curves.first[p + max(ei, e1)] + curves.count[p + max(ei, e1)]
        basis = contact.basis
        for j in range(5):
            for a in range(lo, hi):
                basis[j, a] = 0.0
        add_basis(curves, c, ei, si, 0, 1.0, 1.0, contact.legendre, basis, 0)
        add_basis(curves, c, ei, si, 1, 0.0, 1.0, contact.legendre, basis, 1)
        add_basis(curves, c, e1, s_end[k], 0, 1.0, 1.0, contact.legendre, basis, 3)
        f = vector(force, d * k, 1, size)
        end = zero_vector(size); end_s = zero_vector(size); tangent = zero_vector(size); bend = zero_vector(size)
        for a in range(lo, hi):
            x = position(q_end, base + a, size)
            end += basis[3, a] * x; end_s += basis[4, a] * x
            x = position(q_mid, base + a, size)
            tangent += basis[1, a] * x; bend += basis[2, a] * x
        point = sliders.point[k]
        add_to(r_out, 8 * row_of[point], 1, -1.0 * f)
        contact.entries[k] = 0
        for a in range(lo, hi):
            node = base + a
            add_to(r_out, 8 * row_of[node], 1, basis[0, a] * f)
            put_translation.call(ties, contact, k, node, row_of[node], q_mid, q_end, share * basis[0, a], basis[3, a],
                                 0.5 * basis[1, a], f, (near * basis[1, a]) * f, size)
        put_translation.call(ties, contact, k, point, row_of[point], q_mid, q_end, -share, -1.0, 0.0, f, zero_vector(size), size)
        corner = contact.corner[k]
        for i in range(64):
            corner[i] = 0.0
        put(corner, d, 8, -1.0 * end_s)
        put(corner, 8 * d, 1, tangent)
        corner[9 * d] = near * dot(f, bend)
        put_residual(contact, k, position(q_end, point, size) - end, dot(f, tangent), size)


# --- as a term of a step ------------------------------------------------------------------------------------------------
@first_guess.register(Sliding)
@kernel
def predict_sliding(term, system, h, c):
    state, work = system.state, system.work
    predict_sliders(term.curves, term.sliders, system.contact, state.q, state.v, state.s, h, c, work.past, work.s_end,
                    state.force, system.size)


@assemble.register(Sliding, Conserving)
@kernel
def assemble_sliding(term, method, system, h):
    state, work = system.state, system.work
    add_sliders(term.curves, term.sliders, system.contact, term.ties, system.row_of, state.q, work.q_mid, work.q_end, work.theta,
                state.s, work.s_end, state.force, work.r, system.size)


@assemble.register(Sliding, Midpoint)
@kernel
def assemble_sliding_midpoint(term, method, system, h):
    state, work = system.state, system.work
    add_plain_sliders(term.curves, term.sliders, system.contact, term.ties, system.row_of, work.q_mid, work.q_end, state.s,
                      work.s_end, state.force, 1.0, work.r, system.size)


@assemble.register(Sliding, Alpha)
@kernel
def assemble_sliding_at_end(term, method, system, h):
    state, work = system.state, system.work
    add_plain_sliders(term.curves, term.sliders, system.contact, term.ties, system.row_of, work.q_mid, work.q_end, state.s,
                      work.s_end, state.force, 0.5, work.r, system.size)


@take_unknowns.register(Sliding)
@kernel
def move_sliders(term, system):
    """Add the solved unknowns of all sliders to forces and positions."""
    state, work, contact, d = system.state, system.work, system.contact, dim(system.size)
    for k in range(state.s.shape[0]):
        for c in range(d):
            state.force[contact.first_force[k] + c] += work.y[contact.first[k] + c]
        z = work.y[contact.first[k] + d]
        work.s_end[k] += z
        if abs(z) > contact.augmented[3] or z != z:
            contact.augmented[3] = abs(z)


@is_settled.register(Sliding)
@kernel
def gaps_are_closed(term, system):
    """Whether the augmented Lagrangian of the last iteration leaves gaps of round-off size only."""
    contact, q, size = system.contact, system.state.q, system.size
    for k in range(term.sliders.point.shape[0]):
        p = coordinates(size) * term.sliders.point[k]
        reach = 0.0
        for c in range(dim(size)):
            reach = max(reach, abs(q[p + c]))
        if not contact.remaining[k] <= 1e-15 * (system.length + reach):
            return False
    return True


@within_limits.register(Sliding)
@kernel
def sliders_are_within(term, system, counts_out):
    """False where a slider is beyond the end of its beam, but for the last digits; its number goes to counts_out."""
    s = system.state.s
    for k in range(s.shape[0]):
        slack = END_SLACK * term.lengths[k]
        if not (s[k] >= -slack and s[k] <= term.lengths[k] + slack):
            counts_out[3] = k
            return False
    return True
