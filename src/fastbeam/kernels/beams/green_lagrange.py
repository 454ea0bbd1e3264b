"""Strain set (2.1) of theory.md in the element loops: all strains are quadratic forms.

Loads, stores and zeros are those of `vectors.WIDTH` lanes.

Arrays: constants [*], the tables of a group, and scratch [*], its numbers in lanes: layout.py has their places.
"""
from __future__ import annotations

from fastbeam.kernels.algebra.native import vadd3, vld, vld3, vst, vst3, vstm, vzero, vzero3, vzerom
from fastbeam.kernels.algebra.vectors import add_iso, cross, dot, outer
from fastbeam.kernels.beams.section_laws import modulus, put_half_change
from fastbeam.kernels.beams.strain_measures import (
    GreenLagrange,
    add_director_forces,
    add_forces,
    add_geometric,
    add_stresses,
    extrapolated_strains,
    form_stresses,
    mean_of_forms,
    point_stiffness,
    present_strains,
    quadratic_forms,
    strain_changes,
    strains_of_shape,
    sum_pair,
)
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.layout import (
    MIDDLE,
    NODE_TABLE,
    POINT_MATRIX,
    POINT_NODE,
    POINT_NODES,
    POINT_PRODUCTS,
    POSITION_ROTATION,
    PRODUCTS,
    ROTATION_POSITION,
    SHEAR_2,
    SHEAR_3,
    TWIST,
)


# --- strains ------------------------------------------------------------------------------------------------------------
@quadratic_forms.register(GreenLagrange)
@strains_of_shape.register(GreenLagrange)
@kernel
def forms(strains, scratch, z, eo):
    f = vld3(scratch, z, 8); d2 = vld3(scratch, z + 48, 8); d3 = vld3(scratch, z + 72, 8)
    k2 = vld3(scratch, z + 120, 8); k3 = vld3(scratch, z + 144, 8)
    vst(scratch, eo, 0, 0.5 * dot(f, f)); vst(scratch, eo + 8, 0, dot(f, d2)); vst(scratch, eo + 16, 0, dot(f, d3))
    vst(scratch, eo + 24, 0, 0.5 * (dot(k2, d3) - dot(k3, d2)))
    vst(scratch, eo + 32, 0, dot(f, k3)); vst(scratch, eo + 40, 0, -1.0 * dot(f, k2))


@kernel
def form_changes(scratch, z, x, eo):
    """Form derivatives of the forms at z along x."""
    f = vld3(scratch, z, 8); d2 = vld3(scratch, z + 48, 8); d3 = vld3(scratch, z + 72, 8)
    k2 = vld3(scratch, z + 120, 8); k3 = vld3(scratch, z + 144, 8)
    g = vld3(scratch, x, 8); x2 = vld3(scratch, x + 48, 8); x3 = vld3(scratch, x + 72, 8)
    y2 = vld3(scratch, x + 120, 8); y3 = vld3(scratch, x + 144, 8)
    vst(scratch, eo, 0, dot(f, g))
    vst(scratch, eo + 8, 0, dot(f, x2) + dot(g, d2)); vst(scratch, eo + 16, 0, dot(f, x3) + dot(g, d3))
    vst(scratch, eo + 24, 0, 0.5 * (dot(y2, d3) + dot(k2, x3) - dot(y3, d2) - dot(k3, x2)))
    vst(scratch, eo + 32, 0, dot(f, y3) + dot(g, k3)); vst(scratch, eo + 40, 0, -1.0 * (dot(f, y2) + dot(g, k2)))


@mean_of_forms.register(GreenLagrange)
@kernel
def mean(strains, scratch, eo, end, ao):
    for i in range(0, 48, 8):
        e_start = vld(scratch, eo + i, 0); e_end = vld(scratch, end + i, 0)
        vst(scratch, eo + i, 0, 0.5 * (e_start + e_end))
        put_half_change.call(strains.law, scratch, eo + i, e_start, e_end)


@present_strains.register(GreenLagrange)
@kernel
def forms_of_end(strains, scratch, z, ao, eo):
    forms(strains, scratch, z, eo)


@extrapolated_strains.register(GreenLagrange)
@kernel
def extrapolated(strains, scratch, z, x, eo, temporary):
    forms(strains, scratch, z, eo)
    form_changes(scratch, z, x, temporary)
    for i in range(0, 48, 8):
        vst(scratch, eo + i, 0, vld(scratch, eo + i, 0) + vld(scratch, temporary + i, 0))


@strain_changes.register(GreenLagrange)
@kernel
def changes_of_forms(strains, scratch, z, x, ao, eo):
    form_changes(scratch, z, x, eo)


# --- stresses and forces ------------------------------------------------------------------------------------------------
@form_stresses.register(GreenLagrange)
@kernel
def stresses_of_forms(strains, scratch, ao, so):
    """Do nothing: strains (2.1) are the quadratic forms themselves, so sbar = Sbar in (4.7)."""


@add_stresses.register(GreenLagrange)
@kernel
def add_six_stresses(strains, scratch, other, so):
    for i in range(0, 48, 8):
        vst(scratch, so + i, 0, vld(scratch, so + i, 0) + vld(scratch, other + i, 0))


@add_forces.register(GreenLagrange)
@kernel
def forces(strains, constants, to, nn, scratch, z, so, fo):
    x0 = vld(scratch, so, 0) * vld3(scratch, z, 8) + vld(scratch, so + 8, 0) * vld3(scratch, z + 48, 8)
    x0 += vld(scratch, so + 16, 0) * vld3(scratch, z + 72, 8)
    x0 += vld(scratch, so + 32, 0) * vld3(scratch, z + 144, 8) - vld(scratch, so + 40, 0) * vld3(scratch, z + 120, 8)
    for a in range(nn):
        vadd3(scratch, fo + 96 * a, 8, vld(constants, to + 8 + NODE_TABLE * a, 0) * x0)
    director_forces(strains, constants, to, nn, scratch, z, so, fo)


@add_director_forces.register(GreenLagrange)
@kernel
def director_forces(strains, constants, to, nn, scratch, z, so, fo):
    """Add forces on directors: dir x_i + dir_s y_i on director i of a node, with the same x_i, y_i for all nodes."""
    f = vld3(scratch, z, 8); d2 = vld3(scratch, z + 48, 8); d3 = vld3(scratch, z + 72, 8)
    k2 = vld3(scratch, z + 120, 8); k3 = vld3(scratch, z + 144, 8)
    s4 = 0.5 * vld(scratch, so + 24, 0)
    x2 = vld(scratch, so + 8, 0) * f - s4 * k3
    x3 = vld(scratch, so + 16, 0) * f + s4 * k2
    y2 = s4 * d3 - vld(scratch, so + 40, 0) * f
    y3 = vld(scratch, so + 32, 0) * f - s4 * d2
    for a in range(nn):
        t = to + 8 + NODE_TABLE * a
        n = vld(constants, t + 8, 0); dn = vld(constants, t + 16, 0)
        vadd3(scratch, fo + 96 * a + 48, 8, n * x2 + dn * y2)
        vadd3(scratch, fo + 96 * a + 72, 8, n * x3 + dn * y3)


# --- stiffness of a point -----------------------------------------------------------------------------------------------
@kernel
def strain_rows(scratch, z, q, n, dn, out):
    """Form derivatives of the strains (2.1) by the spin of one node: vectors b_i (delta E_i = b_i . delta_phi)."""
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
def position_rows(scratch, z, out):
    """Form derivatives of the strains (2.1) by phi': six vectors."""
    vst3(scratch, out, 8, vld3(scratch, z, 8))
    vst3(scratch, out + 24, 8, vld3(scratch, z + 48, 8))
    vst3(scratch, out + 48, 8, vld3(scratch, z + 72, 8))
    vst3(scratch, out + 72, 8, vzero3())
    vst3(scratch, out + 96, 8, vld3(scratch, z + 144, 8))
    vst3(scratch, out + 120, 8, -1.0 * vld3(scratch, z + 120, 8))


@kernel
def multiply_rows(law, constants, half_w, coupled, scratch, zo, rows, out):
    """Form half_w times C, or C + 2 D/h, times six vectors."""
    for i in range(6):
        j0 = 0 if coupled else i
        j1 = 6 if coupled else i + 1
        x = vzero3()
        for j in range(j0, j1):
            x += (half_w * modulus.call(law, constants, 48 * i + 8 * j, scratch, zo)) * vld3(scratch, rows + 24 * j, 8)
        vst3(scratch, out + 24 * i, 8, x)


@point_stiffness.register(GreenLagrange)
@kernel
def stiffness(strains, constants, to, coupled, scratch, at, columns, po):
    """Form the stiffness of a point; rows b_i are derivatives of the strains (2.1) by the spin of a node."""
    z_mid = at.blocks + MIDDLE
    z_end = at.blocks + columns
    # rows of the end of one node, stiffness times rows of the positions, their rows in the middle
    re = at.blocks + POINT_PRODUCTS
    ct = re + 144
    tm = ct + 144
    half_w = 0.5 * vld(constants, to, 0)
    position_rows(scratch, z_end, tm)
    multiply_rows(strains.law, constants, half_w, coupled, scratch, at.blocks, tm, ct)
    position_rows(scratch, z_mid, tm)
    for a in range(at.nn):
        t = to + 8 + NODE_TABLE * a
        n = vld(constants, t + 8, 0); dn = vld(constants, t + 16, 0)
        b = po + POINT_NODES + POINT_NODE * a
        strain_rows(scratch, z_mid, at.node * a, n, dn, b)
        strain_rows(scratch, z_end, at.node * a + 96, n, dn, re)
        multiply_rows(strains.law, constants, half_w, coupled, scratch, at.blocks, re, b + PRODUCTS)
        tr = vzerom()
        rt = vzerom()
        for i in range(6):
            tr += outer(vld3(scratch, tm + 24 * i, 8), vld3(scratch, b + PRODUCTS + 24 * i, 8))
            rt += outer(vld3(scratch, b + 24 * i, 8), vld3(scratch, ct + 24 * i, 8))
        vstm(scratch, b + POSITION_ROTATION, 8, tr)
        vstm(scratch, b + ROTATION_POSITION, 8, rt)
    tt = vzerom()
    for i in range(6):
        tt += outer(vld3(scratch, tm + 24 * i, 8), vld3(scratch, ct + 24 * i, 8))
    vstm(scratch, po + POINT_MATRIX, 8, add_iso(tt, 0.5 * vld(scratch, po, 0)))


# --- pairs of nodes -----------------------------------------------------------------------------------------------------
@kernel
def sum_one(constants, scratch, at, a, b, o):
    """Form two sums for the forces between positions and directors, and one for the twist."""
    g2 = vzero(); g3 = vzero(); e4 = vzero()
    for g in range(at.nq):
        t = at.point + at.point_size * g + 8
        so = at.points + at.point_stride * g
        na = vld(constants, t + 24 * a + 8, 0); da = vld(constants, t + 24 * a + 16, 0)
        pb = vld(constants, t + 24 * b, 0); nb = vld(constants, t + 24 * b + 8, 0); db = vld(constants, t + 24 * b + 16, 0)
        pn = na * pb
        pd = da * pb
        g2 += pn * vld(scratch, so + 8, 0) - pd * vld(scratch, so + 40, 0)
        g3 += pn * vld(scratch, so + 16, 0) + pd * vld(scratch, so + 32, 0)
        e4 += vld(scratch, so + 24, 0) * (da * nb - na * db)
    vst(scratch, o + SHEAR_2, 0, g2); vst(scratch, o + SHEAR_3, 0, g3); vst(scratch, o + TWIST, 0, e4)


@sum_pair.register(GreenLagrange)
@kernel
def sums_of_pair(strains, constants, scratch, at, a, b):
    sum_one(constants, scratch, at, a, b, at.pairs + at.pair_size * (at.nn * a + b))
    sum_one(constants, scratch, at, b, a, at.pairs + at.pair_size * (at.nn * b + a))


@add_geometric.register(GreenLagrange)
@kernel
def geometric(strains, krr, scratch, qa, qb, sums, m2, m3):
    """Return krr + sum b_i w_i^T - (sum b_i . w_i) I, the stresses skew, the inertia diagonal."""
    a2 = vld3(scratch, qa + 48, 8); a3 = vld3(scratch, qa + 72, 8)
    b2 = vld3(scratch, qb + 48, 8); b3 = vld3(scratch, qb + 72, 8)
    q4 = 0.25 * vld(scratch, sums + TWIST, 0)
    w2 = q4 * a3 - m2 * a2
    w3 = vzero3() - q4 * a2 - m3 * a3
    krr += outer(b2, w2)
    krr += outer(b3, w3)
    return add_iso(krr, -1.0 * (dot(b2, w2) + dot(b3, w3)))
