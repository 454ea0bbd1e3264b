"""Strain set (2.2) of theory.md in the element loops: stretch, shears, and curvatures with the factor c.

Stresses are the s_1 to s_7 of theory.md (4.7), which multiply derivatives of the quadratic forms (2.4): of phi'.phi'/2 and the
shears, of twist and curvatures (the moments times c), and of c. Loads, stores and zeros are those of `vectors.WIDTH` lanes.

Arrays: constants [*], the tables of a group, and scratch [*], its numbers in lanes: layout.py has their places.
"""
from __future__ import annotations

from fastbeam.kernels.algebra.dimensions import Space
from fastbeam.kernels.algebra.native import vadd3, vld, vld3, vst, vst3, vstm, vzero, vzero3, vzerom
from fastbeam.kernels.algebra.vectors import add_iso, cross, dot, outer, square_root
from fastbeam.kernels.beams.section_laws import modulus, put_half_change
from fastbeam.kernels.beams.strain_measures import (
    SimoReissner,
    add_director_forces,
    add_forces,
    add_geometric,
    add_stresses,
    extrapolated_strains,
    form_stresses,
    mean_of_forms,
    point_stiffness,
    prepare_points,
    present_strains,
    quadratic_forms,
    strain_changes,
    strains_of_shape,
    sum_pair,
)
from fastbeam.kernels.jit.decorators import inlined, kernel
from fastbeam.kernels.layout import (
    CURVATURE_2,
    CURVATURE_3,
    END,
    LENGTHS,
    MIDDLE,
    NODE_TABLE,
    POINT_MATRIX,
    POINT_NODE,
    POINT_NODES,
    POINT_PRODUCTS,
    POSITION_ROTATION,
    PRODUCTS,
    ROTATION_POSITION,
    SHAPE,
    SHAPES_AT,
    SHEAR_2,
    SHEAR_3,
    STRESSES,
    TWIST,
    TWISTS,
)


# --- strains ------------------------------------------------------------------------------------------------------------
@quadratic_forms.register(SimoReissner)
@kernel
def forms(strains, scratch, z, eo):
    f = vld3(scratch, z, 8); d1 = vld3(scratch, z + 24, 8); d2 = vld3(scratch, z + 48, 8); d3 = vld3(scratch, z + 72, 8)
    k1 = vld3(scratch, z + 96, 8); k2 = vld3(scratch, z + 120, 8); k3 = vld3(scratch, z + 144, 8)
    vst(scratch, eo, 0, 0.5 * dot(f, f)); vst(scratch, eo + 8, 0, dot(f, d2)); vst(scratch, eo + 16, 0, dot(f, d3))
    vst(scratch, eo + 24, 0, 0.5 * (dot(k2, d3) - dot(k3, d2)))
    vst(scratch, eo + 32, 0, 0.5 * (dot(k3, d1) - dot(k1, d3)))
    vst(scratch, eo + 40, 0, 0.5 * (dot(k1, d2) - dot(k2, d1)))
    vst(scratch, eo + 48, 0, -0.25 * (dot(d1, d1) + dot(d2, d2) + dot(d3, d3)))


@kernel
def form_changes(scratch, z, x, eo):
    """Form derivatives of the forms at z along x."""
    f = vld3(scratch, z, 8); d1 = vld3(scratch, z + 24, 8); d2 = vld3(scratch, z + 48, 8); d3 = vld3(scratch, z + 72, 8)
    k1 = vld3(scratch, z + 96, 8); k2 = vld3(scratch, z + 120, 8); k3 = vld3(scratch, z + 144, 8)
    g = vld3(scratch, x, 8); x1 = vld3(scratch, x + 24, 8); x2 = vld3(scratch, x + 48, 8); x3 = vld3(scratch, x + 72, 8)
    y1 = vld3(scratch, x + 96, 8); y2 = vld3(scratch, x + 120, 8); y3 = vld3(scratch, x + 144, 8)
    vst(scratch, eo, 0, dot(f, g))
    vst(scratch, eo + 8, 0, dot(f, x2) + dot(g, d2)); vst(scratch, eo + 16, 0, dot(f, x3) + dot(g, d3))
    vst(scratch, eo + 24, 0, 0.5 * (dot(y2, d3) + dot(k2, x3) - dot(y3, d2) - dot(k3, x2)))
    vst(scratch, eo + 32, 0, 0.5 * (dot(y3, d1) + dot(k3, x1) - dot(y1, d3) - dot(k1, x3)))
    vst(scratch, eo + 40, 0, 0.5 * (dot(y1, d2) + dot(k1, x2) - dot(y2, d1) - dot(k2, x1)))
    vst(scratch, eo + 48, 0, -0.5 * (dot(d1, x1) + dot(d2, x2) + dot(d3, x3)))


@kernel
def stretch(scratch, eo):
    """Return r = sqrt(phi'.phi' - Gamma_2^2 - Gamma_3^2) from the forms at eo, theory.md (2.2)."""
    g2 = vld(scratch, eo + 8, 0); g3 = vld(scratch, eo + 16, 0)
    return square_root(2.0 * vld(scratch, eo, 0) - g2 * g2 - g3 * g3)


@kernel
def put_shape(scratch, eo, over_stretch, ao):
    """Store data for derivatives of the strains (`layout.SHAPE`), from the forms at eo: shears, 1/r, K_i, c."""
    vst(scratch, ao, 0, vld(scratch, eo + 8, 0)); vst(scratch, ao + 8, 0, vld(scratch, eo + 16, 0))
    vst(scratch, ao + 16, 0, over_stretch)
    for i in range(24, 48, 8):
        vst(scratch, ao + i, 0, vld(scratch, eo + i, 0))
    vst(scratch, ao + 48, 0, 1.75 + vld(scratch, eo + 48, 0))


@mean_of_forms.register(SimoReissner)
@kernel
def mean(strains, scratch, eo, end, ao):
    r_end = stretch(scratch, end)
    r_start = stretch(scratch, eo)
    r = 0.5 * (r_start + r_end)
    over = 1.0 / (r * r_end)
    c = 1.75 + vld(scratch, eo + 48, 0)
    c_end = 1.75 + vld(scratch, end + 48, 0)
    put_shape(scratch, end, r * over, ao + SHAPE)
    vst(scratch, ao + 2 * SHAPE, 0, r_end)
    mean_c = 0.5 * (c + c_end)
    vst(scratch, ao + 16, 0, r_end * over); vst(scratch, ao + 48, 0, mean_c)
    vst(scratch, eo, 0, r)
    put_half_change.call(strains.law, scratch, eo, r_start, r_end)
    for i in range(8, 24, 8):
        g_start = vld(scratch, eo + i, 0); g_end = vld(scratch, end + i, 0)
        g = 0.5 * (g_start + g_end)
        vst(scratch, eo + i, 0, g); vst(scratch, ao + i - 8, 0, g)
        put_half_change.call(strains.law, scratch, eo + i, g_start, g_end)
    for i in range(24, 48, 8):
        k = vld(scratch, eo + i, 0); k_end = vld(scratch, end + i, 0)
        e_start = c * k; e_end = c_end * k_end
        vst(scratch, eo + i, 0, 0.5 * (e_start + e_end)); vst(scratch, ao + i, 0, 0.5 * (k + k_end))
        put_half_change.call(strains.law, scratch, eo + i, e_start, e_end)


@present_strains.register(SimoReissner)
@kernel
def strains_of_end(strains, scratch, z, ao, eo):
    end = ao + SHAPE
    c = vld(scratch, end + 48, 0)
    vst(scratch, eo, 0, vld(scratch, ao + 2 * SHAPE, 0))
    vst(scratch, eo + 8, 0, vld(scratch, end, 0)); vst(scratch, eo + 16, 0, vld(scratch, end + 8, 0))
    for i in range(24, 48, 8):
        vst(scratch, eo + i, 0, c * vld(scratch, end + i, 0))


@extrapolated_strains.register(SimoReissner)
@kernel
def extrapolated(strains, scratch, z, x, eo, temporary):
    """Form E(z) + DE(z) x; the stretch r changes by (dQ_1 - Gamma_2 dGamma_2 - Gamma_3 dGamma_3)/r, Q_1 = phi'.phi'/2."""
    forms(strains, scratch, z, eo)
    form_changes(scratch, z, x, temporary)
    r = stretch(scratch, eo)
    g2 = vld(scratch, eo + 8, 0); g3 = vld(scratch, eo + 16, 0)
    dr = vld(scratch, temporary, 0) - g2 * vld(scratch, temporary + 8, 0) - g3 * vld(scratch, temporary + 16, 0)
    vst(scratch, eo, 0, r + dr / r)
    for i in range(8, 24, 8):
        vst(scratch, eo + i, 0, vld(scratch, eo + i, 0) + vld(scratch, temporary + i, 0))
    c = 1.75 + vld(scratch, eo + 48, 0)
    dc = vld(scratch, temporary + 48, 0)
    for i in range(24, 48, 8):
        vst(scratch, eo + i, 0, (c + dc) * vld(scratch, eo + i, 0) + c * vld(scratch, temporary + i, 0))


@strain_changes.register(SimoReissner)
@kernel
def changes_of_means(strains, scratch, z, x, ao, eo):
    form_changes(scratch, z, x, eo)
    y = vld(scratch, eo, 0) - vld(scratch, ao, 0) * vld(scratch, eo + 8, 0)
    vst(scratch, eo, 0, vld(scratch, ao + 16, 0) * (y - vld(scratch, ao + 8, 0) * vld(scratch, eo + 16, 0)))
    c = vld(scratch, ao + 48, 0); dc = vld(scratch, eo + 48, 0)
    for i in range(24, 48, 8):
        vst(scratch, eo + i, 0, c * vld(scratch, eo + i, 0) + dc * vld(scratch, ao + i, 0))


@strains_of_shape.register(SimoReissner)
@kernel
def strains_of_forms(strains, scratch, z, eo):
    forms(strains, scratch, z, eo)
    vst(scratch, eo, 0, stretch(scratch, eo))
    c = 1.75 + vld(scratch, eo + 48, 0)
    for i in range(24, 48, 8):
        vst(scratch, eo + i, 0, c * vld(scratch, eo + i, 0))


# --- stresses and forces ------------------------------------------------------------------------------------------------
@form_stresses.register(SimoReissner)
@kernel
def stresses_of_forms(strains, scratch, ao, so):
    n = vld(scratch, so, 0) * vld(scratch, ao + 16, 0)
    vst(scratch, so, 0, n)
    vst(scratch, so + 8, 0, vld(scratch, so + 8, 0) - n * vld(scratch, ao, 0))
    vst(scratch, so + 16, 0, vld(scratch, so + 16, 0) - n * vld(scratch, ao + 8, 0))
    c = vld(scratch, ao + 48, 0)
    x = vzero()
    for i in range(24, 48, 8):
        m = vld(scratch, so + i, 0)
        x += m * vld(scratch, ao + i, 0)
        vst(scratch, so + i, 0, c * m); vst(scratch, so + 32 + i, 0, m)
    vst(scratch, so + 48, 0, -0.5 * x)


@add_stresses.register(SimoReissner)
@kernel
def add_all_stresses(strains, scratch, other, so):
    for i in range(0, STRESSES, 8):
        vst(scratch, so + i, 0, vld(scratch, so + i, 0) + vld(scratch, other + i, 0))


@add_forces.register(SimoReissner)
@kernel
def forces(strains, constants, to, nn, scratch, z, so, fo):
    x0 = vld(scratch, so, 0) * vld3(scratch, z, 8) + vld(scratch, so + 8, 0) * vld3(scratch, z + 48, 8)
    x0 += vld(scratch, so + 16, 0) * vld3(scratch, z + 72, 8)
    for a in range(nn):
        vadd3(scratch, fo + 96 * a, 8, vld(constants, to + 8 + NODE_TABLE * a, 0) * x0)
    director_forces(strains, constants, to, nn, scratch, z, so, fo)


@add_director_forces.register(SimoReissner)
@kernel
def director_forces(strains, constants, to, nn, scratch, z, so, fo):
    """Add forces on directors: dir x_i + dir_s y_i on director i of a node, with the same x_i, y_i for all nodes."""
    f = vld3(scratch, z, 8); d1 = vld3(scratch, z + 24, 8); d2 = vld3(scratch, z + 48, 8); d3 = vld3(scratch, z + 72, 8)
    k1 = vld3(scratch, z + 96, 8); k2 = vld3(scratch, z + 120, 8); k3 = vld3(scratch, z + 144, 8)
    s2 = vld(scratch, so + 8, 0); s3 = vld(scratch, so + 16, 0)
    s4 = 0.5 * vld(scratch, so + 24, 0); s5 = 0.5 * vld(scratch, so + 32, 0); s6 = 0.5 * vld(scratch, so + 40, 0)
    s7 = vld(scratch, so + 48, 0)
    x1 = s5 * k3 - s6 * k2 + s7 * d1
    y1 = s6 * d2 - s5 * d3
    x2 = s2 * f - s4 * k3
    x2 += s6 * k1 + s7 * d2
    y2 = s4 * d3
    y2 -= s6 * d1
    x3 = s3 * f + s4 * k2
    x3 += s7 * d3 - s5 * k1
    y3 = -1.0 * (s4 * d2)
    y3 += s5 * d1
    for a in range(nn):
        t = to + 8 + NODE_TABLE * a
        n = vld(constants, t + 8, 0); dn = vld(constants, t + 16, 0)
        o = fo + 96 * a
        vadd3(scratch, o + 24, 8, n * x1 + dn * y1)
        vadd3(scratch, o + 48, 8, n * x2 + dn * y2)
        vadd3(scratch, o + 72, 8, n * x3 + dn * y3)


# --- stiffness of a point -----------------------------------------------------------------------------------------------
@prepare_points.register(Space, SimoReissner)
@kernel
def put_twists(dofs, strains, scratch, at):
    """Form for every pair of nodes a < b with directors y: y_2a x y_3b - y_3a x y_2b, the same with 3, 1 and with 1, 2, and the
    sum of y_ia x y_ib; of the middle of the step, then of its end. All points share them."""
    for b in range(1, at.nn):
        for a in range(b):
            for end in range(0, 2 * TWISTS, TWISTS):
                p = at.node * a + end
                q = at.node * b + end
                o = at.twists + TWISTS * (b * (b - 1) + 2 * a) + end
                x1 = vld3(scratch, p + 24, 8); x2 = vld3(scratch, p + 48, 8); x3 = vld3(scratch, p + 72, 8)
                y1 = vld3(scratch, q + 24, 8); y2 = vld3(scratch, q + 48, 8); y3 = vld3(scratch, q + 72, 8)
                vst3(scratch, o, 8, cross(x2, y3) - cross(x3, y2))
                vst3(scratch, o + 24, 8, cross(x3, y1) - cross(x1, y3))
                vst3(scratch, o + 48, 8, cross(x1, y2) - cross(x2, y1))
                vst3(scratch, o + 72, 8, cross(x1, y1) + cross(x2, y2) + cross(x3, y3))


@kernel
def rows_of_pairs(constants, to, nn, a, scratch, z, q, twists, out):
    """Form `form_rows` for node a if z is interpolated from the nodes whose directors stand at q: then the rows of twist,
    curvatures and c are sums over the other nodes of the vectors of `put_twists`."""
    t = to + 8 + NODE_TABLE * a
    n = vld(constants, t + 8, 0); dn = vld(constants, t + 16, 0)
    nf = n * vld3(scratch, z, 8)
    vst3(scratch, out, 8, cross(vld3(scratch, q + 48, 8), nf))
    vst3(scratch, out + 24, 8, cross(vld3(scratch, q + 72, 8), nf))
    half_n = 0.5 * n; half_dn = 0.5 * dn
    r4 = vzero3(); r5 = vzero3(); r6 = vzero3(); r7 = vzero3()
    for b in range(nn):
        if b != a:
            t = to + 8 + NODE_TABLE * b
            m = vld(constants, t + 8, 0)
            w = half_dn * m - half_n * vld(constants, t + 16, 0)
            o = twists + TWISTS * (b * (b - 1) + 2 * a)
            c = half_n * m
            if b < a:
                o = twists + TWISTS * (a * (a - 1) + 2 * b)
                c = -1.0 * c
            r4 += w * vld3(scratch, o, 8)
            r5 += w * vld3(scratch, o + 24, 8)
            r6 += w * vld3(scratch, o + 48, 8)
            r7 -= c * vld3(scratch, o + 72, 8)
    vst3(scratch, out + 48, 8, r4)
    vst3(scratch, out + 72, 8, r5)
    vst3(scratch, out + 96, 8, r6)
    vst3(scratch, out + 120, 8, r7)


@kernel
def form_rows(scratch, z, q, n, dn, out):
    """Form derivatives by the spin of one node of the quantities (2.4) of strain set (2.2): shears, twist and curvatures, the
    factor c. Six vectors b_i, delta Q_i = b_i . delta_phi; q: coordinates of the node."""
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
def form_stiffness(law, constants, to, scratch, zo, so, ao, out):
    """Form D of theory.md (4.8), d sbar = D dQ_end, 7 x 7 lanes by rows, for a section whose C is diagonal: only the block of the
    first three forms and that of the last four are filled."""
    end = ao + SHAPE
    half_w = 0.5 * vld(constants, to, 0)
    axial = 0.5 * vld(scratch, so, 0)
    g2 = vld(scratch, ao, 0); g3 = vld(scratch, ao + 8, 0); over = vld(scratch, ao + 16, 0)
    h2 = vld(scratch, end, 0); h3 = vld(scratch, end + 8, 0); over_end = vld(scratch, end + 16, 0)
    y = over * over_end * (half_w * modulus.call(law, constants, 0, scratch, zo) - axial)
    y2 = vzero() - y * h2; y3 = vzero() - y * h3
    vst(scratch, out, 0, y); vst(scratch, out + 8, 0, y2); vst(scratch, out + 16, 0, y3)
    vst(scratch, out + 56, 0, vzero() - g2 * y); vst(scratch, out + 112, 0, vzero() - g3 * y)
    vst(scratch, out + 64, 0, half_w * modulus.call(law, constants, 56, scratch, zo) - axial - g2 * y2)
    vst(scratch, out + 72, 0, vzero() - g2 * y3); vst(scratch, out + 120, 0, vzero() - g3 * y2)
    vst(scratch, out + 128, 0, half_w * modulus.call(law, constants, 112, scratch, zo) - axial - g3 * y3)
    c = vld(scratch, ao + 48, 0); c_end = vld(scratch, end + 48, 0)
    x = vzero()
    for i in range(3):
        y = half_w * modulus.call(law, constants, 168 + 56 * i, scratch, zo)
        half_m = 0.5 * vld(scratch, so + 56 + 8 * i, 0)
        k = vld(scratch, ao + 24 + 8 * i, 0); k_end = vld(scratch, end + 24 + 8 * i, 0)
        vst(scratch, out + 192 + 64 * i, 0, c * c_end * y)
        vst(scratch, out + 216 + 56 * i, 0, c * k_end * y + half_m)
        vst(scratch, out + 360 + 8 * i, 0, c_end * k * y + half_m)
        x += k * k_end * y
    vst(scratch, out + 384, 0, x)


@kernel
def coupled_form_stiffness(law, constants, to, scratch, zo, so, ao, out):
    """Form D of theory.md (4.8) for any C, all 7 x 7 lanes."""
    end = ao + SHAPE
    half_w = 0.5 * vld(constants, to, 0)
    axial = 0.5 * vld(scratch, so, 0)
    # C times the derivatives of the strains at the end
    over = vld(scratch, end + 16, 0); g2 = vld(scratch, end, 0); g3 = vld(scratch, end + 8, 0); c = vld(scratch, end + 48, 0)
    for i in range(6):
        o = out + 56 * i
        for j in range(6):
            vst(scratch, o + 8 * j, 0, half_w * modulus.call(law, constants, 48 * i + 8 * j, scratch, zo))
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
    # times derivatives in the middle, and the change of these derivatives
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
    """Return the sum of the entries `first` to before `last` of a row of D, each times its vector at rows."""
    x = vzero3()
    for k in range(first, last):
        x += vld(scratch, do + 8 * k, 0) * vld3(scratch, rows + 24 * k, 8)
    return x


@kernel
def node_products(scratch, coupled, do, y, out):
    """Form D times the rows of a spin at the end. The first form, phi'.phi'/2, does not change with a spin: the row of the second
    stands at y + 24. Products of the forms from the second on go to out, that of the first is returned."""
    if coupled:
        for i in range(6):
            vst3(scratch, out + 24 * i, 8, times_forms(scratch, do + 56 + 56 * i, 1, 7, y))
        return times_forms(scratch, do, 1, 7, y)
    vst3(scratch, out, 8, times_forms(scratch, do + 56, 1, 3, y))
    vst3(scratch, out + 24, 8, times_forms(scratch, do + 112, 1, 3, y))
    xc = vld3(scratch, y + 144, 8)
    x = vld(scratch, do + 384, 0) * xc
    for i in range(3):
        z = vld3(scratch, y + 72 + 24 * i, 8)
        x += vld(scratch, do + 360 + 8 * i, 0) * z
        o = do + 168 + 56 * i
        vst3(scratch, out + 48 + 24 * i, 8, vld(scratch, o + 24 + 8 * i, 0) * z + vld(scratch, o + 48, 0) * xc)
    vst3(scratch, out + 120, 8, x)
    return times_forms(scratch, do, 1, 3, y)


@point_stiffness.register(SimoReissner)
@kernel
def stiffness(strains, constants, to, coupled, scratch, at, columns, po):
    """Form the stiffness of a point; rows b_i are derivatives of the quadratic forms by the spin of a node, D is that of
    theory.md (4.8)."""
    z_mid = at.blocks + MIDDLE
    z_end = at.blocks + columns
    ao = po + SHAPES_AT
    # offsets of D, of the rows of the positions at the end, of their products with D, of the rows of a spin at the end
    do = at.blocks + POINT_PRODUCTS
    te = do + 392
    ct = te + 72
    re = ct + 144
    if coupled:
        coupled_form_stiffness(strains.law, constants, to, scratch, at.blocks, po, ao, do)
    else:
        form_stiffness(strains.law, constants, to, scratch, at.blocks, po, ao, do)
    f = vld3(scratch, z_mid, 8); d2 = vld3(scratch, z_mid + 48, 8); d3 = vld3(scratch, z_mid + 72, 8)
    # the first three forms change with phi' by phi', d2, d3
    vst3(scratch, te, 8, vld3(scratch, z_end, 8))
    vst3(scratch, te + 24, 8, vld3(scratch, z_end + 48, 8)); vst3(scratch, te + 48, 8, vld3(scratch, z_end + 72, 8))
    tt = outer(f, times_forms(scratch, do, 0, 3, te))
    nc = 6 if coupled else 2
    for i in range(nc):
        vst3(scratch, ct + 24 * i, 8, times_forms(scratch, do + 56 + 56 * i, 0, 3, te))
    tt += outer(d2, vld3(scratch, ct, 8)) + outer(d3, vld3(scratch, ct + 24, 8))
    vstm(scratch, po + POINT_MATRIX, 8, add_iso(tt, 0.5 * vld(scratch, po, 0)))
    for a in range(at.nn):
        t = to + 8 + NODE_TABLE * a
        n = vld(constants, t + 8, 0); dn = vld(constants, t + 16, 0)
        b = po + POINT_NODES + POINT_NODE * a
        rows_of_pairs(constants, to, at.nn, a, scratch, z_mid, at.node * a, at.twists, b)
        if columns == END:
            rows_of_pairs(constants, to, at.nn, a, scratch, z_end, at.node * a + 96, at.twists + TWISTS, re)
        else:
            form_rows(scratch, z_end, at.node * a + 96, n, dn, re)
        x1 = node_products(scratch, coupled, do, re - 24, b + PRODUCTS)
        tr = outer(f, x1) + outer(d2, vld3(scratch, b + PRODUCTS, 8)) + outer(d3, vld3(scratch, b + PRODUCTS + 24, 8))
        vstm(scratch, b + POSITION_ROTATION, 8, tr)
        rt = vzerom()
        for i in range(nc):
            rt += outer(vld3(scratch, b + 24 * i, 8), vld3(scratch, ct + 24 * i, 8))
        vstm(scratch, b + ROTATION_POSITION, 8, rt)


# --- pairs of nodes -----------------------------------------------------------------------------------------------------
@sum_pair.register(SimoReissner)
@inlined
def sums_of_pair(strains, constants, scratch, at, a, b):
    g2 = vzero(); g3 = vzero(); h2 = vzero(); h3 = vzero(); e4 = vzero(); e5 = vzero(); e6 = vzero(); e7 = vzero()
    for g in range(at.nq):
        t = at.point + at.point_size * g + 8
        so = at.points + at.point_stride * g
        pa = vld(constants, t + 24 * a, 0); na = vld(constants, t + 24 * a + 8, 0); da = vld(constants, t + 24 * a + 16, 0)
        pb = vld(constants, t + 24 * b, 0); nb = vld(constants, t + 24 * b + 8, 0); db = vld(constants, t + 24 * b + 16, 0)
        s2 = vld(scratch, so + 8, 0); s3 = vld(scratch, so + 16, 0)
        pn = na * pb
        g2 += pn * s2; g3 += pn * s3
        pn = pa * nb
        h2 += pn * s2; h3 += pn * s3
        twist = da * nb - na * db
        e4 += vld(scratch, so + 24, 0) * twist; e5 += vld(scratch, so + 32, 0) * twist; e6 += vld(scratch, so + 40, 0) * twist
        e7 += (na * nb) * vld(scratch, so + 48, 0)
    put_sums(scratch, at.pairs + at.pair_size * (at.nn * a + b), g2, g3, e4, e5, e6, e7)
    zero = vzero()
    put_sums(scratch, at.pairs + at.pair_size * (at.nn * b + a), h2, h3, zero - e4, zero - e5, zero - e6, e7)


@inlined
def put_sums(scratch, o, g2, g3, e4, e5, e6, e7):
    vst(scratch, o + SHEAR_2, 0, g2); vst(scratch, o + SHEAR_3, 0, g3); vst(scratch, o + TWIST, 0, e4)
    vst(scratch, o + CURVATURE_2, 0, e5); vst(scratch, o + CURVATURE_3, 0, e6); vst(scratch, o + LENGTHS, 0, e7)


@add_geometric.register(SimoReissner)
@kernel
def geometric(strains, krr, scratch, qa, qb, sums, m2, m3):
    """Return krr + sum b_i w_i^T - (sum b_i . w_i) I, the stresses skew, inertia and lengths diagonal."""
    a1 = vld3(scratch, qa + 24, 8); a2 = vld3(scratch, qa + 48, 8); a3 = vld3(scratch, qa + 72, 8)
    b1 = vld3(scratch, qb + 24, 8); b2 = vld3(scratch, qb + 48, 8); b3 = vld3(scratch, qb + 72, 8)
    q4 = 0.25 * vld(scratch, sums + TWIST, 0); q5 = 0.25 * vld(scratch, sums + CURVATURE_2, 0)
    q6 = 0.25 * vld(scratch, sums + CURVATURE_3, 0); q7 = 0.5 * vld(scratch, sums + LENGTHS, 0)
    w1 = q6 * a2 - q5 * a3 - q7 * a1
    w2 = q4 * a3 - (q7 + m2) * a2 - q6 * a1
    w3 = vzero3() - q4 * a2 - (q7 + m3) * a3 + q5 * a1
    krr += outer(b1, w1)
    krr += outer(b2, w2)
    krr += outer(b3, w3)
    return add_iso(krr, -1.0 * (dot(b1, w1) + dot(b2, w2) + dot(b3, w3)))
