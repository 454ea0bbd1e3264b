"""Sliding contact of a point on the curve of a beam: the discrete gradient of theory.md 5.1.

With the force F = sum lam_i d_i,mid as unknown instead of the multipliers, the directors of the frame drop out of the equations:
only the Cayley vector theta of the frame in this step is left. Any rotation that moves with the structure will do; here the
frame turns with the curve under the contact, theta = sum_A N_A,mean theta_A: it favours no node and is symmetric in time.

    force       +F on the point, -N_A,mean F on node A, moment N_A,mean F x g_mean on node A,
                g_mean = phi_S,mid - sum_A N_A,mean phi_A,mid
    sliding     F . (T_n + T_n+1)/2 + 1/4 (theta x F) . (T_n+1 - T_n) = 0,   T_k = sum_A N[s_n, s_n+1]_A phi_A(k)        (5.3)
    gap         phi_S - sum_A N_A(s) phi_A = 0 at n+1                                                                     (5.4)

Each slider is a border of 7 on the matrix of the nodes: F (3), s, and g_mean (3), which keeps the frame's moment from coupling
nodes that no element joins.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._jit import kernel, one_variant
from .algebra import add3, component0, component1, component2, cross, dot, ld3, st3, zero3
from .ties import tie_arm


class Curves(NamedTuple):
    """Piecewise polynomial curves of all beams that carry a slider."""

    meta: np.ndarray        # int64 [C, 5]: first node, number of elements, offset in ends, offset in first, offset in coef
    shape: np.ndarray       # int64 [C, 3]: nodes per element (padded), coefficients, nodes of the beam
    ends: np.ndarray        # float64: element ends in arc length
    first: np.ndarray       # int64: first node of every element, counted from the beam's first
    count: np.ndarray       # int64: nodes of every element
    coef: np.ndarray        # float64: Legendre coefficients [element, node, k]
    gauss_x: np.ndarray     # float64 [G]: points on [0, 1], exact for the derivative of every curve
    gauss_w: np.ndarray     # float64 [G]


class Sliders(NamedTuple):
    """One row a slider."""

    curve: np.ndarray       # int64 [S]
    point: np.ndarray       # int64 [S]: node of the sliding point
    spin_root: np.ndarray   # int64 [N]: the node whose spin a node shares


class Contact(NamedTuple):
    """Work of the sliders; `E` entries a slider at most."""

    basis: np.ndarray       # float64 [5, n]: N(s_n), N(s_n+1), N'(s_n+1), N[s_n, s_n+1], its derivative by s_n+1
    legendre: np.ndarray    # float64 [3, n_coef]
    entries: np.ndarray     # int64 [S]: number of entries
    row: np.ndarray         # int64 [S, E]: row of the residual
    column: np.ndarray      # float64 [S, 48 E]: column[6 x 8] of every entry, derivative of the rows by the border unknowns
    line: np.ndarray        # float64 [S, 48 E]: derivative of the border equations by the unknowns of the row, transposed
    corner: np.ndarray      # float64 [S, 64]
    residual: np.ndarray    # float64 [S, 8]
    element: np.ndarray     # int64 [S]: element of s_n, a hint
    compliance: np.ndarray  # float64 [S]: of the parts that each slider joins, in a step
    remaining: np.ndarray   # float64 [S]: gap that the augmented Lagrangian leaves after the last iteration
    augmented: np.ndarray   # float64 [3]: 1/factor of theory.md (5.5), least compliance of the parts, 1 in the first iteration


@one_variant
def border_of(n):
    """Border unknowns of a slider where nodes have n unknowns: force, s, mean gap."""
    return 7 if n == 6 else 5


@one_variant
def dim_of(n):
    """Components of a position where nodes have n unknowns."""
    return 3 if n == 6 else 2


@kernel
def find_element(curves, c, s, hint):
    """Element of arc length s on curve c; ends outside the beam belong to the outer elements."""
    n = curves.meta[c, 1]
    o = curves.meta[c, 2]
    e = min(max(hint, 0), n - 1)
    while e > 0 and s < curves.ends[o + e]:
        e -= 1
    while e < n - 1 and s >= curves.ends[o + e + 1]:
        e += 1
    return e


@kernel
def legendre(xi, n, table_out):
    """P_k, P_k', P_k'' for k < n."""
    table_out[0, 0] = 1.0
    table_out[1, 0] = 0.0
    table_out[2, 0] = 0.0
    if n > 1:
        table_out[0, 1] = xi
        table_out[1, 1] = 1.0
        table_out[2, 1] = 0.0
    for k in range(1, n - 1):
        table_out[0, k + 1] = ((2 * k + 1) * xi * table_out[0, k] - k * table_out[0, k - 1]) / (k + 1)
        table_out[1, k + 1] = table_out[1, k - 1] + (2 * k + 1) * table_out[0, k]
        table_out[2, k + 1] = table_out[2, k - 1] + (2 * k + 1) * table_out[1, k]


@one_variant
def add_basis(curves, c, e, s, derivative, factor, next_factor, table, basis_out, slot):
    """basis_out[slot, A] += factor d^k N_A / ds^k at s, from the polynomials of element e, and basis_out[slot + 1, A] +=
    next_factor d^(k+1) N_A / ds^(k+1); k = 0 or 1."""
    o = curves.meta[c, 2] + e
    scale = 2.0 / (curves.ends[o + 1] - curves.ends[o])
    n = curves.shape[c, 1]
    legendre(scale * (s - curves.ends[o]) - 1.0, n, table)
    f = factor if derivative == 0 else factor * scale
    g = next_factor * scale if derivative == 0 else next_factor * scale * scale
    p = curves.meta[c, 3] + e
    co = curves.meta[c, 4] + e * curves.shape[c, 0] * n
    for a in range(curves.count[p]):
        x = 0.0
        y = 0.0
        for k in range(n):
            x += curves.coef[co + a * n + k] * table[derivative, k]
            y += curves.coef[co + a * n + k] * table[derivative + 1, k]
        basis_out[slot, curves.first[p] + a] += f * x
        basis_out[slot + 1, curves.first[p] + a] += g * y


@kernel
def contact_basis(curves, c, s0, s1, e0, e1, lo, hi, contact):
    """Shape functions at both ends of the step and the divided difference between them, nodes lo..hi-1."""
    basis = contact.basis
    table = contact.legendre
    for k in range(5):
        for a in range(lo, hi):
            basis[k, a] = 0.0
    add_basis(curves, c, e0, s0, 0, 1.0, 0.0, table, basis, 0)
    add_basis(curves, c, e1, s1, 0, 1.0, 1.0, table, basis, 1)
    ng = curves.gauss_x.shape[0]
    if e0 == e1:
        for g in range(ng):
            x = curves.gauss_x[g]
            w = curves.gauss_w[g]
            s = s0 + x * (s1 - s0)
            add_basis(curves, c, e0, s, 1, w, w * x, table, basis, 3)
        return
    # crossing element ends: N[a,b] = 1/(b - a) int_a^b N' ds, one Gauss rule a piece
    a_ = min(s0, s1)
    b_ = max(s0, s1)
    o = curves.meta[c, 2]
    for e in range(min(e0, e1), max(e0, e1) + 1):
        x0 = a_ if e == min(e0, e1) else curves.ends[o + e]
        x1 = b_ if e == max(e0, e1) else curves.ends[o + e + 1]
        share = (x1 - x0) / (b_ - a_) if b_ > a_ else 0.5
        for g in range(ng):
            add_basis(curves, c, e, x0 + curves.gauss_x[g] * (x1 - x0), 1, share * curves.gauss_w[g], 0.0, table,
                      basis, 3)
    size = curves.ends[o + e1 + 1] - curves.ends[o + e1]
    if abs(s1 - s0) > 1e-9 * size:
        for a in range(lo, hi):
            basis[4, a] = (basis[2, a] - basis[3, a]) / (s1 - s0)


@one_variant
def point_on_curve(curves, c, s, q, element, contact, slot_derivative):
    """Position (or derivative by s) of curve c at s for node coordinates q."""
    p = curves.meta[c, 3] + element
    first = curves.first[p]
    n = curves.count[p]
    for a in range(first, first + n):
        contact.basis[0, a] = 0.0
    add_basis(curves, c, element, s, slot_derivative, 1.0, 0.0, contact.legendre, contact.basis, 0)
    x = zero3()
    for a in range(first, first + n):
        x += contact.basis[0, a] * ld3(q, 12 * (curves.meta[c, 0] + a), 1)
    return x


@kernel
def predict_sliders(curves, sliders, contact, q, v, s, h, c, past, s_out, force_out):
    """First guess of s and force: as `nodes.predict`; where c is NaN the rate by least squares of v_S - sum N_A v_A = c' ds/dt
    (theory.md 5.4) and the force of the last step."""
    m = 4 * s.shape[0]
    for k in range(sliders.curve.shape[0]):
        b = sliders.curve[k]
        e = find_element(curves, b, s[k], contact.element[k])
        contact.element[k] = e
        if c == c:
            i = 4 + 4 * k
            s_out[k] = s[k] + h * ((1.0 + c) * past[i] - c * past[i + m])
            st3(force_out, 3 * k, 1, (1.0 + c) * ld3(past, i + 1, 1) - c * ld3(past, i + m + 1, 1))
        else:
            tangent = point_on_curve(curves, b, s[k], q, e, contact, 1)
            relative = ld3(v, 12 * sliders.point[k], 1) - point_on_curve(curves, b, s[k], v, e, contact, 0)
            s_out[k] = s[k] + h * dot(relative, tangent) / dot(tangent, tangent)


@kernel
def put_translation(contact, k, node, row, ties, q_mid, q_end, n_mean, n_end, rate, f, slide):
    """Border entry of one node: its force is n_mean F, the gap changes with -n_end, g_mean with -n_mean/2; `rate` is the
    derivative of n_mean by s, `slide` the derivative of the sliding equation by the position. Tied nodes pass it on.
    Returns the offset of the node's own entry, -1 where it is tied."""
    if ties is not None:
        if ties.start[node + 1] > ties.start[node]:
            for t in range(ties.start[node], ties.start[node + 1]):
                if ties.kind[t] == 0:
                    put_rows(contact, k, ties.target_row[t], n_mean, n_end, rate, f, slide)
                elif ties.kind[t] == 1:
                    put_arm(contact, k, ties.target_row[t], tie_arm(ties, t, q_mid), tie_arm(ties, t, q_end), n_mean, n_end,
                            rate, f, slide)
            return -1
    return put_rows(contact, k, row, n_mean, n_end, rate, f, slide)


@kernel
def new_entry(contact, k, row):
    """Offset of a fresh entry."""
    m = contact.entries[k]
    contact.entries[k] = m + 1
    contact.row[k, m] = row
    for i in range(48 * m, 48 * m + 48):
        contact.column[k, i] = 0.0
        contact.line[k, i] = 0.0
    return 48 * m


@kernel
def put_rows(contact, k, row, n_mean, n_end, rate, f, slide):
    """Entry of a position."""
    o = new_entry(contact, k, row)
    column = contact.column[k]
    line = contact.line[k]
    for i in range(3):
        column[o + 8 * i + i] = n_mean
        line[o + 8 * i + i] = -n_end
        line[o + 8 * i + 4 + i] = 0.5 * n_mean
    st3(column, o + 3, 8, rate * f)
    st3(line, o + 3, 8, slide)
    return o


@kernel
def put_arm(contact, k, row, arm_mid, arm_end, n_mean, n_end, rate, f, slide):
    """Entry of the spin of a node that carries the point on an arm."""
    o = new_entry(contact, k, row)
    column = contact.column[k]
    line = contact.line[k]
    put_skew(column, o + 24, n_mean, arm_mid)
    put_skew(line, o + 24, -n_end, arm_end)
    put_skew(line, o + 28, 0.5 * n_mean, arm_end)
    st3(column, o + 27, 8, cross(arm_mid, rate * f))
    st3(line, o + 27, 8, cross(arm_end, slide))


@kernel
def put_frame(contact, k, o, n_mean, rate, f, g_mean, jump, th):
    """The share of one node in the frame: its moment n_mean g_mean x F, and its theta in the sliding equation."""
    column = contact.column[k]
    put_skew(column, o + 24, n_mean, g_mean)
    put_skew(column, o + 28, -n_mean, f)
    st3(column, o + 27, 8, rate * cross(g_mean, f))
    # d theta = (I - 1/2 theta^ + 1/4 theta theta^T) spin
    y = (0.25 * n_mean) * cross(f, jump)
    st3(contact.line[k], o + 27, 8, y + 0.5 * cross(th, y) + (0.25 * dot(th, y)) * th)


@kernel
def put_skew(a, o, factor, x):
    """a[o + 8 i + j] = factor skew(x)_ij"""
    x0 = factor * component0(x); x1 = factor * component1(x); x2 = factor * component2(x)
    a[o] = 0.0; a[o + 1] = -x2; a[o + 2] = x1
    a[o + 8] = x2; a[o + 9] = 0.0; a[o + 10] = -x0
    a[o + 16] = -x1; a[o + 17] = x0; a[o + 18] = 0.0


@kernel
def add_sliders(curves, sliders, contact, ties, row_of, q, q_mid, q_end, theta, s, s_end, force, r_out):
    """Forces of all sliders into the residual and their borders into `contact`."""
    for k in range(sliders.curve.shape[0]):
        c = sliders.curve[k]
        base = curves.meta[c, 0]
        e0 = find_element(curves, c, s[k], contact.element[k])
        e1 = find_element(curves, c, s_end[k], e0)
        p = curves.meta[c, 3]
        lo = curves.first[p + min(e0, e1)]
        last = p + max(e0, e1)
        hi = curves.first[last] + curves.count[last]
        contact_basis(curves, c, s[k], s_end[k], e0, e1, lo, hi, contact)
        basis = contact.basis
        f = ld3(force, 3 * k, 1)
        # curve at the end of the step, mean gap, mean tangents at both ends of the step, rotation of the frame
        end = zero3(); end_s = zero3(); mean = zero3(); mean_s = zero3()
        t0 = zero3(); t1 = zero3(); dt0 = zero3(); dt1 = zero3(); th = zero3(); th_s = zero3()
        for a in range(lo, hi):
            n = 12 * (base + a)
            n_mean = 0.5 * (basis[0, a] + basis[1, a])
            x0 = ld3(q, n, 1); x1 = ld3(q_end, n, 1); xm = ld3(q_mid, n, 1)
            end += basis[1, a] * x1
            end_s += basis[2, a] * x1
            mean += n_mean * xm
            mean_s += basis[2, a] * xm
            t0 += basis[3, a] * x0; t1 += basis[3, a] * x1
            dt0 += basis[4, a] * x0; dt1 += basis[4, a] * x1
            x = ld3(theta, 3 * sliders.spin_root[base + a], 1)
            th += n_mean * x
            th_s += (0.5 * basis[2, a]) * x
        point = sliders.point[k]
        gap = ld3(q_end, 12 * point, 1) - end
        g_mean = ld3(q_mid, 12 * point, 1) - mean
        jump = t1 - t0
        turned = cross(th, f)
        # residual rows: -F on the point, +N F and -N F x g_mean on the curve
        add3(r_out, 8 * row_of[point], 1, -1.0 * f)
        contact.entries[k] = 0
        slide = 0.5 * f + 0.25 * turned
        for a in range(lo, hi):
            n_mean = 0.5 * (basis[0, a] + basis[1, a])
            rate = 0.5 * basis[2, a]
            node = base + a
            root = sliders.spin_root[node]
            add3(r_out, 8 * row_of[node], 1, n_mean * f)
            add3(r_out, 8 * row_of[root] + 3, 1, n_mean * cross(g_mean, f))
            o = put_translation(contact, k, node, row_of[node], ties, q_mid, q_end, n_mean, basis[1, a], rate, f,
                                basis[3, a] * slide)
            if o < 0 or root != node:
                o = new_entry(contact, k, row_of[root])
            put_frame(contact, k, o, n_mean, rate, f, g_mean, jump, ld3(theta, 3 * root, 1))
        put_translation(contact, k, point, row_of[point], ties, q_mid, q_end, -1.0, -1.0, 0.0, f, zero3())
        # corner: rows gap, sliding, g_mean against F, s, g_mean
        corner = contact.corner[k]
        for i in range(64):
            corner[i] = 0.0
        st3(corner, 3, 8, -1.0 * end_s)
        st3(corner, 24, 1, 0.5 * (t0 + t1) + 0.25 * cross(jump, th))
        corner[27] = dot(slide, dt1) + dot(0.5 * f - 0.25 * turned, dt0) + 0.25 * dot(cross(th_s, f), jump)
        st3(corner, 35, 8, 0.5 * mean_s)
        for i in range(3):
            corner[8 * (4 + i) + 4 + i] = 1.0
        residual = contact.residual[k]
        st3(residual, 0, 1, gap)
        residual[3] = dot(slide, t1) + dot(0.5 * f - 0.25 * turned, t0)
        residual[4] = 0.0; residual[5] = 0.0; residual[6] = 0.0
