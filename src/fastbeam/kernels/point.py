"""What a quadrature point adds to the forces of a group of elements, and what all pairs of nodes share of its stiffness.

Loads, stores and zeros are those of `algebra.WIDTH` lanes, as in kernels/beam.py, which has the layout of the tables.
"""
from __future__ import annotations

from .._jit import kernel
from .algebra import add_iso, cross, outer
from .algebra import padd3 as vadd3
from .algebra import pld as vld
from .algebra import pld3 as vld3
from .algebra import pst as vst
from .algebra import pst3 as vst3
from .algebra import pstm as vstm
from .algebra import pzero as vzero
from .algebra import pzero3 as vzero3
from .algebra import pzerom as vzerom
from .strains import Q_LANES, SHAPE


@kernel
def add_forces(tab, to, nn, scratch, z, so, green, positions, fo):
    """Internal forces B(q_mid)^T S on the 12 coordinates of every node, fo: nn x 12 lanes; without `positions` (None) those on
    the directors alone."""
    f = vld3(scratch, z, 8); d1 = vld3(scratch, z + 24, 8); d2 = vld3(scratch, z + 48, 8); d3 = vld3(scratch, z + 72, 8)
    k1 = vld3(scratch, z + 96, 8); k2 = vld3(scratch, z + 120, 8); k3 = vld3(scratch, z + 144, 8)
    s1 = vld(scratch, so, 0); s2 = vld(scratch, so + 8, 0); s3 = vld(scratch, so + 16, 0)
    s4 = 0.5 * vld(scratch, so + 24, 0)
    # director forces are N x_i + N' y_i, the position force is N' x0
    x2 = s2 * f - s4 * k3
    x3 = s3 * f + s4 * k2
    y2 = s4 * d3
    y3 = -1.0 * (s4 * d2)
    if green is None:
        s5 = 0.5 * vld(scratch, so + 32, 0); s6 = 0.5 * vld(scratch, so + 40, 0)
        s7 = vld(scratch, so + 48, 0)
        x0 = s1 * f + s2 * d2 + s3 * d3
        x1 = s5 * k3 - s6 * k2 + s7 * d1
        y1 = s6 * d2 - s5 * d3
        x2 += s6 * k1 + s7 * d2
        y2 -= s6 * d1
        x3 += s7 * d3 - s5 * k1
        y3 += s5 * d1
    else:
        s5 = vld(scratch, so + 32, 0); s6 = vld(scratch, so + 40, 0)
        x0 = s1 * f + s2 * d2 + s3 * d3 + s5 * k3 - s6 * k2
        x1 = vzero3()
        y1 = vzero3()
        y2 -= s6 * f
        y3 += s5 * f
    for a in range(nn):
        t = to + 8 + 24 * a
        n = vld(tab, t + 8, 0); dn = vld(tab, t + 16, 0)
        o = fo + 96 * a
        if positions is not None:
            vadd3(scratch, o, 8, vld(tab, t, 0) * x0)
        if green is None:
            vadd3(scratch, o + 24, 8, n * x1 + dn * y1)
        vadd3(scratch, o + 48, 8, n * x2 + dn * y2)
        vadd3(scratch, o + 72, 8, n * x3 + dn * y3)


@kernel
def form_rows(scratch, z, q, n, dn, out):
    """Derivatives by the spin of one node of what strain set (2.2) is made of (2.4): shears, twist and curvatures, the factor c.
    Six vectors b_i, delta Q_i = b_i . delta_phi; q: coordinates of the node."""
    f = vld3(scratch, z, 8); d1 = vld3(scratch, z + 24, 8); d2 = vld3(scratch, z + 48, 8); d3 = vld3(scratch, z + 72, 8)
    k1 = vld3(scratch, z + 96, 8); k2 = vld3(scratch, z + 120, 8); k3 = vld3(scratch, z + 144, 8)
    y1 = vld3(scratch, q + 24, 8); y2 = vld3(scratch, q + 48, 8); y3 = vld3(scratch, q + 72, 8)
    half_n = 0.5 * n; half_dn = 0.5 * dn
    p1 = half_dn * d1 - half_n * k1
    p2 = half_dn * d2 - half_n * k2
    p3 = half_dn * d3 - half_n * k3
    nf = n * f
    vst3(scratch, out, 8, cross(y2, nf))
    vst3(scratch, out + 24, 8, cross(y3, nf))
    vst3(scratch, out + 48, 8, cross(y2, p3) - cross(y3, p2))
    vst3(scratch, out + 72, 8, cross(y3, p1) - cross(y1, p3))
    vst3(scratch, out + 96, 8, cross(y1, p2) - cross(y2, p1))
    vst3(scratch, out + 120, 8, (-1.0 * half_n) * (cross(y1, d1) + cross(y2, d2) + cross(y3, d3)))


@kernel
def form_stiffness(tab, co, to, scratch, so, ao, out):
    """How what multiplies the quadratic forms at the middle changes with the forms at the end: 7 x 7 lanes by rows, theory.md
    (4.8), of a section that is not coupled: only the block of the first three forms and the last four rows and columns are
    filled."""
    end = ao + SHAPE
    half_w = 0.5 * vld(tab, to, 0)
    axial = 0.5 * vld(scratch, so, 0)
    g2 = vld(scratch, ao, 0); g3 = vld(scratch, ao + 8, 0); over = vld(scratch, ao + 16, 0)
    h2 = vld(scratch, end, 0); h3 = vld(scratch, end + 8, 0); over_end = vld(scratch, end + 16, 0)
    y = over * over_end * (half_w * vld(tab, co, 0) - axial)
    y2 = vzero() - y * h2; y3 = vzero() - y * h3
    vst(scratch, out, 0, y); vst(scratch, out + 8, 0, y2); vst(scratch, out + 16, 0, y3)
    vst(scratch, out + 56, 0, vzero() - g2 * y); vst(scratch, out + 112, 0, vzero() - g3 * y)
    vst(scratch, out + 64, 0, half_w * vld(tab, co + 56, 0) - axial - g2 * y2); vst(scratch, out + 72, 0, vzero() - g2 * y3)
    vst(scratch, out + 120, 0, vzero() - g3 * y2); vst(scratch, out + 128, 0, half_w * vld(tab, co + 112, 0) - axial - g3 * y3)
    c = vld(scratch, ao + 48, 0); c_end = vld(scratch, end + 48, 0)
    x = vzero()
    for i in range(3):
        y = half_w * vld(tab, co + 168 + 56 * i, 0)
        half_m = 0.5 * vld(scratch, so + 56 + 8 * i, 0)
        k = vld(scratch, ao + 24 + 8 * i, 0); k_end = vld(scratch, end + 24 + 8 * i, 0)
        vst(scratch, out + 192 + 64 * i, 0, c * c_end * y)
        vst(scratch, out + 216 + 56 * i, 0, c * k_end * y + half_m)
        vst(scratch, out + 360 + 8 * i, 0, c_end * k * y + half_m)
        x += k * k_end * y
    vst(scratch, out + 384, 0, x)


@kernel
def coupled_form_stiffness(tab, co, to, scratch, so, ao, out):
    """The same of any section, all 7 x 7 lanes."""
    end = ao + SHAPE
    half_w = 0.5 * vld(tab, to, 0)
    axial = 0.5 * vld(scratch, so, 0)
    # C times the derivatives of the strains at the end
    over = vld(scratch, end + 16, 0); g2 = vld(scratch, end, 0); g3 = vld(scratch, end + 8, 0); c = vld(scratch, end + 48, 0)
    for i in range(6):
        o = out + 56 * i
        for j in range(6):
            vst(scratch, o + 8 * j, 0, half_w * vld(tab, co + 48 * i + 8 * j, 0))
        if i < 3:
            vst(scratch, o + 8 * i, 0, vld(scratch, o + 8 * i, 0) - axial)
        x = over * vld(scratch, o, 0)
        vst(scratch, o, 0, x)
        vst(scratch, o + 8, 0, vld(scratch, o + 8, 0) - g2 * x)
        vst(scratch, o + 16, 0, vld(scratch, o + 16, 0) - g3 * x)
        x = vzero()
        for j in range(24, 48, 8):
            y = vld(scratch, o + j, 0)
            x += y * vld(scratch, end + j, 0)
            vst(scratch, o + j, 0, c * y)
        vst(scratch, o + 48, 0, x)
    # times those in the middle, and the change of those
    over = vld(scratch, ao + 16, 0); g2 = vld(scratch, ao, 0); g3 = vld(scratch, ao + 8, 0); c = vld(scratch, ao + 48, 0)
    for o in range(out, out + 56, 8):
        x = over * vld(scratch, o, 0)
        vst(scratch, o, 0, x)
        vst(scratch, o + 56, 0, vld(scratch, o + 56, 0) - g2 * x)
        vst(scratch, o + 112, 0, vld(scratch, o + 112, 0) - g3 * x)
        x = vzero()
        for j in range(3):
            y = vld(scratch, o + 168 + 56 * j, 0)
            x += vld(scratch, ao + 24 + 8 * j, 0) * y
            vst(scratch, o + 168 + 56 * j, 0, c * y)
        vst(scratch, o + 336, 0, x)
    for j in range(3):
        half_m = 0.5 * vld(scratch, so + 56 + 8 * j, 0)
        for o in (out + 216 + 56 * j, out + 360 + 8 * j):
            vst(scratch, o, 0, vld(scratch, o, 0) + half_m)


@kernel
def times_forms(scratch, do, first, last, rows):
    """Of the entries `first` to before `last` of a row of `form_stiffness`, times vectors at rows."""
    x = vzero3()
    for k in range(first, last):
        x += vld(scratch, do + 8 * k, 0) * vld3(scratch, rows + 24 * k, 8)
    return x


@kernel
def point_stiffness(tab, co, to, nn, coupled, scratch, z_mid, z_end, qo, so, po, ao):
    """Everything of one point that the node pairs share, of strain set (2.2), from po on: TT (9), per node rows of the midpoint
    (18), what multiplies them (18), rotation-translation RT (9) and translation-rotation TR (9). Rows are derivatives of the
    quadratic forms, theory.md (4.8)."""
    # room behind the two shapes: 7 x 7 lanes, vectors of the positions at the end, products with them, rows of the end of a node
    do = z_mid + 336
    te = do + 392
    ct = te + 72
    re = ct + 144
    if coupled:
        coupled_form_stiffness(tab, co, to, scratch, so, ao, do)
    else:
        form_stiffness(tab, co, to, scratch, so, ao, do)
    f = vld3(scratch, z_mid, 8); d2 = vld3(scratch, z_mid + 48, 8); d3 = vld3(scratch, z_mid + 72, 8)
    # positions have the rows phi', d2, d3
    vst3(scratch, te, 8, vld3(scratch, z_end, 8))
    vst3(scratch, te + 24, 8, vld3(scratch, z_end + 48, 8)); vst3(scratch, te + 48, 8, vld3(scratch, z_end + 72, 8))
    tt = outer(f, times_forms(scratch, do, 0, 3, te))
    nc = 6 if coupled else 2
    for i in range(nc):
        vst3(scratch, ct + 24 * i, 8, times_forms(scratch, do + 56 + 56 * i, 0, 3, te))
    tt += outer(d2, vld3(scratch, ct, 8)) + outer(d3, vld3(scratch, ct + 24, 8))
    vstm(scratch, po, 8, add_iso(tt, 0.5 * vld(scratch, so, 0)))
    for a in range(nn):
        t = to + 8 + 24 * a
        n = vld(tab, t + 8, 0); dn = vld(tab, t + 16, 0)
        b = po + 72 + 432 * a
        form_rows(scratch, z_mid, qo + Q_LANES * a, n, dn, b)
        form_rows(scratch, z_end, qo + Q_LANES * a + 96, n, dn, re)
        # spins have no row of the first form
        y = re - 24
        if coupled:
            x1 = times_forms(scratch, do, 1, 7, y)
            for i in range(6):
                vst3(scratch, b + 144 + 24 * i, 8, times_forms(scratch, do + 56 + 56 * i, 1, 7, y))
        else:
            x1 = times_forms(scratch, do, 1, 3, y)
            vst3(scratch, b + 144, 8, times_forms(scratch, do + 56, 1, 3, y))
            vst3(scratch, b + 168, 8, times_forms(scratch, do + 112, 1, 3, y))
            xc = vld3(scratch, re + 120, 8)
            x = vld(scratch, do + 384, 0) * xc
            for i in range(3):
                z = vld3(scratch, re + 48 + 24 * i, 8)
                x += vld(scratch, do + 360 + 8 * i, 0) * z
                o = do + 168 + 56 * i
                vst3(scratch, b + 192 + 24 * i, 8, vld(scratch, o + 24 + 8 * i, 0) * z + vld(scratch, o + 48, 0) * xc)
            vst3(scratch, b + 264, 8, x)
        tr = outer(f, x1) + outer(d2, vld3(scratch, b + 144, 8)) + outer(d3, vld3(scratch, b + 168, 8))
        vstm(scratch, b + 360, 8, tr)
        rt = vzerom()
        for i in range(nc):
            rt += outer(vld3(scratch, b + 24 * i, 8), vld3(scratch, ct + 24 * i, 8))
        vstm(scratch, b + 288, 8, rt)


@kernel
def green_rows(scratch, z, q, n, dn, out):
    """Derivatives of the strains (2.1) by the spin of one node: vectors b_i (delta E_i = b_i . delta_phi)."""
    f = vld3(scratch, z, 8); d2 = vld3(scratch, z + 48, 8); d3 = vld3(scratch, z + 72, 8)
    k2 = vld3(scratch, z + 120, 8); k3 = vld3(scratch, z + 144, 8)
    y2 = vld3(scratch, q + 48, 8); y3 = vld3(scratch, q + 72, 8)
    half_n = 0.5 * n; half_dn = 0.5 * dn
    p2 = half_dn * d2 - half_n * k2
    p3 = half_dn * d3 - half_n * k3
    x2 = cross(y2, f)
    x3 = cross(y3, f)
    vst3(scratch, out, 8, vzero3())
    vst3(scratch, out + 24, 8, n * x2)
    vst3(scratch, out + 48, 8, n * x3)
    vst3(scratch, out + 72, 8, cross(y2, p3) - cross(y3, p2))
    vst3(scratch, out + 96, 8, dn * x3)
    vst3(scratch, out + 120, 8, -1.0 * (dn * x2))


@kernel
def green_position_rows(scratch, z, out):
    """Derivatives of the strains (2.1) by phi': six vectors."""
    vst3(scratch, out, 8, vld3(scratch, z, 8))
    vst3(scratch, out + 24, 8, vld3(scratch, z + 48, 8))
    vst3(scratch, out + 48, 8, vld3(scratch, z + 72, 8))
    vst3(scratch, out + 72, 8, vzero3())
    vst3(scratch, out + 96, 8, vld3(scratch, z + 144, 8))
    vst3(scratch, out + 120, 8, -1.0 * vld3(scratch, z + 120, 8))


@kernel
def multiply_rows(tab, co, half_w, coupled, scratch, rows, out):
    """half_w times C times six vectors."""
    for i in range(6):
        j0 = 0 if coupled else i
        j1 = 6 if coupled else i + 1
        x = vzero3()
        for j in range(j0, j1):
            x += (half_w * vld(tab, co + 48 * i + 8 * j, 0)) * vld3(scratch, rows + 24 * j, 8)
        vst3(scratch, out + 24 * i, 8, x)


@kernel
def green_point_stiffness(tab, co, to, nn, coupled, scratch, z_mid, z_end, qo, so, po):
    """The same of strain set (2.1); rows are those of the strains."""
    # room behind the two shapes: rows of the end of one node, stiffness times rows of the positions, their rows in the middle
    re = z_mid + 336
    ct = re + 144
    tm = ct + 144
    half_w = 0.5 * vld(tab, to, 0)
    green_position_rows(scratch, z_end, tm)
    multiply_rows(tab, co, half_w, coupled, scratch, tm, ct)
    green_position_rows(scratch, z_mid, tm)
    for a in range(nn):
        t = to + 8 + 24 * a
        n = vld(tab, t + 8, 0); dn = vld(tab, t + 16, 0)
        b = po + 72 + 432 * a
        green_rows(scratch, z_mid, qo + Q_LANES * a, n, dn, b)
        green_rows(scratch, z_end, qo + Q_LANES * a + 96, n, dn, re)
        multiply_rows(tab, co, half_w, coupled, scratch, re, b + 144)
        tr = vzerom()
        rt = vzerom()
        for i in range(6):
            tr += outer(vld3(scratch, tm + 24 * i, 8), vld3(scratch, b + 144 + 24 * i, 8))
            rt += outer(vld3(scratch, b + 24 * i, 8), vld3(scratch, ct + 24 * i, 8))
        vstm(scratch, b + 360, 8, tr)
        vstm(scratch, b + 288, 8, rt)
    tt = vzerom()
    for i in range(6):
        tt += outer(vld3(scratch, tm + 24 * i, 8), vld3(scratch, ct + 24 * i, 8))
    vstm(scratch, po, 8, add_iso(tt, 0.5 * vld(scratch, so, 0)))
