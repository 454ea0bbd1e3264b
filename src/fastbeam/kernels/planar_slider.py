"""Sliding contact in a plane: the equations of kernels/slider.py with force, gap and mean gap of two components, and one Cayley
number for the frame. A slider is a border of 5: F (2), s, g_mean (2)."""
from __future__ import annotations

from .._jit import kernel, one_variant
from .algebra import add2, cross2, dot, ld2, perp, st2, zero2
from .planar_nodes import planar_arm
from .slider import add_basis, contact_basis, find_element


@one_variant
def planar_point_on_curve(curves, c, s, q, element, contact, derivative):
    """Position (or derivative by s) of curve c at s for node coordinates q [4 N]."""
    p = curves.meta[c, 3] + element
    first = curves.first[p]
    n = curves.count[p]
    for a in range(first, first + n):
        contact.basis[0, a] = 0.0
    add_basis(curves, c, element, s, derivative, 1.0, 0.0, contact.legendre, contact.basis, 0)
    x = zero2()
    for a in range(first, first + n):
        x += contact.basis[0, a] * ld2(q, 4 * (curves.meta[c, 0] + a), 1)
    return x


@kernel
def predict_planar_sliders(curves, sliders, contact, q, v, s, h, c, past, s_out, force_out):
    """As `slider.predict_sliders`."""
    m = 3 * s.shape[0]
    for k in range(sliders.curve.shape[0]):
        b = sliders.curve[k]
        e = find_element(curves, b, s[k], contact.element[k])
        contact.element[k] = e
        if c == c:
            i = 4 + 3 * k
            s_out[k] = s[k] + h * ((1.0 + c) * past[i] - c * past[i + m])
            st2(force_out, 2 * k, 1, (1.0 + c) * ld2(past, i + 1, 1) - c * ld2(past, i + m + 1, 1))
        else:
            tangent = planar_point_on_curve(curves, b, s[k], q, e, contact, 1)
            relative = ld2(v, 4 * sliders.point[k], 1) - planar_point_on_curve(curves, b, s[k], v, e, contact, 0)
            s_out[k] = s[k] + h * dot(relative, tangent) / dot(tangent, tangent)


@kernel
def planar_entry(contact, k, row):
    """Offset of a fresh entry."""
    m = contact.entries[k]
    contact.entries[k] = m + 1
    contact.row[k, m] = row
    for i in range(24 * m, 24 * m + 24):
        contact.column[k, i] = 0.0
        contact.line[k, i] = 0.0
    return 24 * m


@kernel
def put_planar_rows(contact, k, row, n_mean, n_end, rate, f, slide):
    """Entry of a position: its force is n_mean F, the gap changes with -n_end, g_mean with -n_mean/2; `rate` is the derivative of
    n_mean by s, `slide` the derivative of the sliding equation by the position."""
    o = planar_entry(contact, k, row)
    column = contact.column[k]
    line = contact.line[k]
    for i in range(2):
        column[o + 8 * i + i] = n_mean
        line[o + 8 * i + i] = -n_end
        line[o + 8 * i + 3 + i] = 0.5 * n_mean
    st2(column, o + 2, 8, rate * f)
    st2(line, o + 2, 8, slide)
    return o


@kernel
def put_planar_arm(contact, k, row, arm_mid, arm_end, n_mean, n_end, rate, f, slide):
    """Entry of the spin of a node that carries the point on an arm."""
    o = planar_entry(contact, k, row) + 16
    column = contact.column[k]
    line = contact.line[k]
    st2(column, o, 1, n_mean * perp(arm_mid))
    column[o + 2] = rate * cross2(arm_mid, f)
    st2(line, o, 1, -n_end * perp(arm_end))
    line[o + 2] = cross2(arm_end, slide)
    st2(line, o + 3, 1, (0.5 * n_mean) * perp(arm_end))


@kernel
def put_planar_translation(contact, k, node, row, ties, q_mid, q_end, n_mean, n_end, rate, f, slide):
    """Border entry of one node; tied nodes pass it on. Returns the offset of the node's own entry, -1 where it is tied."""
    if ties is not None:
        if ties.start[node + 1] > ties.start[node]:
            for t in range(ties.start[node], ties.start[node + 1]):
                if ties.kind[t] == 0:
                    put_planar_rows(contact, k, ties.target_row[t], n_mean, n_end, rate, f, slide)
                elif ties.kind[t] == 1:
                    put_planar_arm(contact, k, ties.target_row[t], planar_arm(ties, t, q_mid), planar_arm(ties, t, q_end), n_mean,
                                   n_end, rate, f, slide)
            return -1
    return put_planar_rows(contact, k, row, n_mean, n_end, rate, f, slide)


@kernel
def add_planar_sliders(curves, sliders, contact, ties, row_of, q, q_mid, q_end, theta, s, s_end, force, r_out):
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
        f = ld2(force, 2 * k, 1)
        turned = perp(f)
        # curve at the end of the step, mean gap, mean tangents at both ends of the step, rotation of the frame
        end = zero2(); end_s = zero2(); mean = zero2(); mean_s = zero2()
        t0 = zero2(); t1 = zero2(); dt0 = zero2(); dt1 = zero2()
        th = 0.0
        th_s = 0.0
        for a in range(lo, hi):
            n = 4 * (base + a)
            n_mean = 0.5 * (basis[0, a] + basis[1, a])
            x0 = ld2(q, n, 1); x1 = ld2(q_end, n, 1); xm = ld2(q_mid, n, 1)
            end += basis[1, a] * x1
            end_s += basis[2, a] * x1
            mean += n_mean * xm
            mean_s += basis[2, a] * xm
            t0 += basis[3, a] * x0; t1 += basis[3, a] * x1
            dt0 += basis[4, a] * x0; dt1 += basis[4, a] * x1
            x = theta[sliders.spin_root[base + a]]
            th += n_mean * x
            th_s += 0.5 * basis[2, a] * x
        point = sliders.point[k]
        gap = ld2(q_end, 4 * point, 1) - end
        g_mean = ld2(q_mid, 4 * point, 1) - mean
        jump = t1 - t0
        # residual rows: -F on the point, +N F and -N F x g_mean on the curve
        add2(r_out, 8 * row_of[point], 1, -1.0 * f)
        contact.entries[k] = 0
        slide = 0.5 * f + (0.25 * th) * turned
        back = 0.5 * f - (0.25 * th) * turned
        for a in range(lo, hi):
            n_mean = 0.5 * (basis[0, a] + basis[1, a])
            rate = 0.5 * basis[2, a]
            node = base + a
            root = sliders.spin_root[node]
            add2(r_out, 8 * row_of[node], 1, n_mean * f)
            r_out[8 * row_of[root] + 2] += n_mean * cross2(g_mean, f)
            o = put_planar_translation(contact, k, node, row_of[node], ties, q_mid, q_end, n_mean, basis[1, a], rate, f,
                                       basis[3, a] * slide)
            if o < 0 or root != node:
                o = planar_entry(contact, k, row_of[root])
            # the node's share in the frame: its moment n_mean g_mean x F, its theta in the sliding equation
            column = contact.column[k]
            st2(column, o + 16, 1, n_mean * perp(g_mean))
            column[o + 18] = rate * cross2(g_mean, f)
            st2(column, o + 19, 1, -n_mean * turned)
            contact.line[k, o + 18] = 0.25 * n_mean * dot(turned, jump) * (1.0 + 0.25 * theta[root] * theta[root])
        put_planar_translation(contact, k, point, row_of[point], ties, q_mid, q_end, -1.0, -1.0, 0.0, f, zero2())
        # corner: rows gap, sliding, g_mean against F, s, g_mean
        corner = contact.corner[k]
        for i in range(64):
            corner[i] = 0.0
        st2(corner, 2, 8, -1.0 * end_s)
        st2(corner, 16, 1, 0.5 * (t0 + t1) - (0.25 * th) * perp(jump))
        corner[18] = dot(slide, dt1) + dot(back, dt0) + 0.25 * th_s * dot(turned, jump)
        st2(corner, 26, 8, 0.5 * mean_s)
        corner[27] = 1.0
        corner[36] = 1.0
        residual = contact.residual[k]
        st2(residual, 0, 1, gap)
        residual[2] = dot(slide, t1) + dot(back, t0)
        residual[3] = 0.0; residual[4] = 0.0
