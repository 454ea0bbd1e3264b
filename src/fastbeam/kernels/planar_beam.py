"""Points and pairs of nodes of beams in a plane: what beam.py and the strain sets compute in space, with 3 unknowns a node.

A node has 4 coordinates: its position x, y in the plane and the director u = d1 in it. The other director of the plane is
J u, u turned by a right angle, the third is the constant normal. The strains that remain are (theory.md 10)

    stretch  sqrt(f . f - shear^2)  or  1/2 f . f,     shear  u x f,     curvature  c u x u',  c = (3 - u . u)/2,  or  f x u'
    (f = phi', x: normal component)

where the second form belongs to strain set (2.1). Residual and tangent as in theory.md 4: mean strains, rows with the mean
director, columns with the spin at the end. Values stay in registers, so here shapes and strains are vectors and not offsets;
loads, stores and zeros are those of `algebra.WIDTH` lanes.

Arrays: constants [*] and reference [*], addresses of a group's tables and of its reference strains; scratch [*], its numbers in
lanes: layout.py has their places.
"""
from __future__ import annotations

from typing import Any, NamedTuple

from .._jit import inlined, kernel
from .algebra import component0, component1, component2, cross2, dot, perp, square_root, triple
from .algebra import padd2 as vadd2
from .algebra import pld as vld
from .algebra import pld2 as vld2
from .algebra import pld3 as vld3
from .algebra import pst as vst
from .algebra import pst2 as vst2
from .algebra import pzero as vzero
from .algebra import pzero2 as vzero2
from .beam import evaluate_point, put_pairs
from .kinds import Plane
from .layout import (NODE_TABLE, PLANAR_MATRIX, PLANAR_NODE, PLANAR_NODES, PLANAR_POSITION_ROTATION, PLANAR_PRODUCTS,
                     PLANAR_ROTATION_POSITION, PLANAR_ROWS)
from .motions import share_of_end
from .strain_sets import (GreenLagrange, SimoReissner, planar_director_forces, planar_extrapolated, planar_form_stresses,
                          planar_geometric, planar_point_data, planar_point_stiffness, planar_position_force, planar_strains,
                          planar_sum_pair)


class Shape(NamedTuple):
    """phi', u, u' at a point."""

    f: Any
    u: Any
    k: Any


class SimoData(NamedTuple):
    """What derivatives of the strains (2.2) need: means, and values at the end."""

    over: Any       # 1 / stretch, so that changes of mean strains are those of forms at the end
    over_end: Any
    g: Any          # shear
    g_end: Any
    a: Any          # factor c
    a_end: Any
    c: Any          # u x u'
    c_end: Any


class GreenData(NamedTuple):
    """Strains (2.1) are quadratic forms: nothing."""


GREEN_DATA = GreenData()


class Law(NamedTuple):
    """Weight times C at a point."""

    c00: Any
    c01: Any
    c02: Any
    c11: Any
    c12: Any
    c22: Any


@inlined
def planar_shape(constants, to, nn, scratch, qo):
    """Of the nodes from qo on, 64 doubles apart."""
    f = vzero2(); u = vzero2(); k = vzero2()
    for a in range(nn):
        t = to + 8 + NODE_TABLE * a
        q = qo + 64 * a
        n = vld(constants, t + 8, 0); dn = vld(constants, t + 16, 0)
        x = vld2(scratch, q + 16, 8)
        f += vld(constants, t, 0) * vld2(scratch, q, 8); u += n * x; k += dn * x
    return Shape(f, u, k)


@inlined
def law_of_point(constants, to):
    w = vld(constants, to, 0)
    return Law(w * vld(constants, 0, 0), w * vld(constants, 8, 0), w * vld(constants, 16, 0), w * vld(constants, 32, 0),
               w * vld(constants, 40, 0), w * vld(constants, 64, 0))


@inlined
def apply_law(law, e):
    """Stresses of three strains."""
    x = component0(e); y = component1(e); z = component2(e)
    return triple(law.c00 * x + law.c01 * y + law.c02 * z, law.c01 * x + law.c11 * y + law.c12 * z,
                  law.c02 * x + law.c12 * y + law.c22 * z)


@inlined
def add_director_forces(constants, to, nn, scratch, fo, x, y):
    """dir x + dir_s y on the directors of all nodes."""
    for a in range(nn):
        t = to + 8 + NODE_TABLE * a
        vadd2(scratch, fo + 32 * a + 16, 8, vld(constants, t + 8, 0) * x + vld(constants, t + 16, 0) * y)


@evaluate_point.register(Plane)
@inlined
def evaluate_point_in_plane(dofs, method, strains, constants, reference, g, scratch, at, case):
    to = at.point + at.point_size * g
    middle = planar_shape(constants, to, at.nn, scratch, 0)
    end = planar_shape(constants, to, at.nn, scratch, 32)
    start = Shape(2.0 * middle.f - end.f, 2.0 * middle.u - end.u, 2.0 * middle.k - end.k)
    before = planar_strains.call(strains, start)
    present = planar_strains.call(strains, end)
    data = planar_point_data.call(strains, middle, start, end)
    law = law_of_point(constants, to)
    e = 0.5 * (before + present) - vld3(reference, 24 * g, 8)
    s = apply_law(law, e)
    t = s
    if case.mixed:
        # the tangent takes the strains to which the last increment led in a straight line: their difference to those of the
        # present shape, theory.md (4.6)
        if case.gathered:
            shape_before = planar_shape(constants, to, at.nn, scratch, at.increment)
            before = planar_extrapolated.call(strains, shape_before, planar_shape(constants, to, at.nn, scratch,
                                                                                  at.increment + 32))
        more = apply_law(law, share_of_end.call(method) * (before - present))
        t = s + more
        x, y = planar_director_forces.call(strains, data, middle, planar_form_stresses.call(strains, data, more))
        add_director_forces(constants, to, at.nn, scratch, at.tangent_forces, x, y)
    forms = planar_form_stresses.call(strains, data, s)
    x0 = planar_position_force.call(strains, data, middle, forms)
    for a in range(at.nn):
        vadd2(scratch, at.forces + 32 * a, 8, vld(constants, to + 8 + NODE_TABLE * a, 0) * x0)
    x, y = planar_director_forces.call(strains, data, middle, forms)
    add_director_forces(constants, to, at.nn, scratch, at.forces, x, y)
    planar_point_stiffness.call(strains, data, middle, end, law, t, constants, to, scratch, at,
                                at.points + at.point_stride * g)


@inlined
def put_planar_node(scratch, b, rows, products, rotation_position, position_rotation):
    """Rows, products and columns of a node at a point, for the pairs of nodes."""
    vst(scratch, b + PLANAR_ROWS, 0, component0(rows)); vst(scratch, b + PLANAR_ROWS + 8, 0, component1(rows))
    vst(scratch, b + PLANAR_ROWS + 16, 0, component2(rows))
    vst(scratch, b + PLANAR_PRODUCTS, 0, component0(products)); vst(scratch, b + PLANAR_PRODUCTS + 8, 0, component1(products))
    vst(scratch, b + PLANAR_PRODUCTS + 16, 0, component2(products))
    vst2(scratch, b + PLANAR_ROTATION_POSITION, 8, rotation_position)
    vst2(scratch, b + PLANAR_POSITION_ROTATION, 8, position_rotation)


# --- strain set (2.2) ---------------------------------------------------------------------------------------------------
@planar_strains.register(SimoReissner)
@inlined
def simo_strains(strains, shape):
    g = cross2(shape.u, shape.f)
    return triple(square_root(dot(shape.f, shape.f) - g * g), g, (1.5 - 0.5 * dot(shape.u, shape.u)) * cross2(shape.u, shape.k))


@planar_extrapolated.register(SimoReissner)
@kernel
def simo_extrapolated(strains, shape, step):
    g0 = cross2(shape.u, shape.f)
    g = g0 + cross2(step.u, shape.f) + cross2(shape.u, step.f)
    c = cross2(shape.u, shape.k)
    a = 1.5 - 0.5 * dot(shape.u, shape.u)
    return triple((dot(shape.f, shape.f + step.f) - g0 * g) / square_root(dot(shape.f, shape.f) - g0 * g0), g,
                  a * (c + cross2(step.u, shape.k) + cross2(shape.u, step.k)) - dot(shape.u, step.u) * c)


@planar_point_data.register(SimoReissner)
@inlined
def simo_data(strains, middle, start, end):
    g0 = cross2(start.u, start.f); ge = cross2(end.u, end.f)
    r0 = square_root(dot(start.f, start.f) - g0 * g0); r_end = square_root(dot(end.f, end.f) - ge * ge)
    e = 0.5 * (r0 + r_end)
    over = 1.0 / (e * r_end)
    a0 = 1.5 - 0.5 * dot(start.u, start.u); ae = 1.5 - 0.5 * dot(end.u, end.u)
    c0 = cross2(start.u, start.k); ce = cross2(end.u, end.k)
    return SimoData(r_end * over, e * over, 0.5 * (g0 + ge), ge, 0.5 * (a0 + ae), ae, 0.5 * (c0 + ce), ce)


@planar_form_stresses.register(SimoReissner)
@inlined
def simo_form_stresses(strains, data, s):
    """Of the curvature it stays the moment."""
    n = data.over * component0(s)
    return triple(n, component1(s) - data.g * n, component2(s))


@planar_position_force.register(SimoReissner)
@inlined
def simo_position_force(strains, data, middle, s):
    return component0(s) * middle.f + component1(s) * perp(middle.u)


@planar_director_forces.register(SimoReissner)
@inlined
def simo_director_forces(strains, data, middle, s):
    m = component2(s)
    x = vzero2() - component1(s) * perp(middle.f) - data.a * (m * perp(middle.k)) - (m * data.c) * middle.u
    return x, data.a * (m * perp(middle.u))


@planar_point_stiffness.register(SimoReissner)
@inlined
def simo_stiffness(strains, data, middle, end, law, t, constants, to, scratch, at, po):
    """Rows are derivatives of the quadratic forms of shear, curvature and its factor, theory.md (4.8)."""
    f = middle.f; n2 = perp(middle.u); n2e = perp(end.u)
    n = data.over * component0(t)
    m = component2(t)
    vst(scratch, po, 0, n); vst(scratch, po + 8, 0, component1(t) - data.g * n); vst(scratch, po + 16, 0, data.a * m)
    vst(scratch, po + 24, 0, vzero() - data.c * m)
    half_m = 0.5 * m
    # half the stiffness, less the axial stress over the stretch, (4.8); strains at the end
    half = Law(0.5 * (law.c00 - n), 0.5 * law.c01, 0.5 * law.c02, 0.5 * (law.c11 - n), 0.5 * law.c12, 0.5 * law.c22)
    x = data.over_end * (end.f - data.g_end * n2e)
    v1 = data.over * (half.c00 * x + half.c01 * n2e)
    v2 = half.c01 * x + half.c11 * n2e - data.g * v1
    v3 = half.c02 * x + half.c12 * n2e
    vst2(scratch, po + PLANAR_MATRIX, 8, component0(v1) * f + component0(v2) * n2)
    vst2(scratch, po + PLANAR_MATRIX + 16, 8, component1(v1) * f + component1(v2) * n2)
    v4 = data.c * v3
    v3 = data.a * v3
    for a in range(at.nn):
        t_a = to + 8 + NODE_TABLE * a
        n = vld(constants, t_a + 8, 0); dn = vld(constants, t_a + 16, 0)
        z = perp(vld2(scratch, 64 * a + 16, 8)); ze = perp(vld2(scratch, 64 * a + 48, 8))
        r1 = n * cross2(z, f)
        r2 = n * cross2(z, middle.k) + dn * cross2(middle.u, z)
        r3 = vzero() - n * dot(middle.u, z)
        # strains at the end; back to the forms in the middle
        q2 = n * cross2(ze, end.f)
        qk = n * cross2(ze, end.k) + dn * cross2(end.u, ze)
        qa = vzero() - n * dot(end.u, ze)
        p = apply_law(half, triple(vzero() - (data.over_end * data.g_end) * q2, q2, data.a_end * qk + data.c_end * qa))
        p0 = data.over * component0(p)
        p1 = component1(p) - data.g * p0
        p3 = component2(p)
        put_planar_node(scratch, po + PLANAR_NODES + PLANAR_NODE * a, triple(r1, r2, r3),
                        triple(p1, data.a * p3 + half_m * qa, data.c * p3 + half_m * qk), r1 * v2 + r2 * v3 + r3 * v4,
                        p0 * f + p1 * n2)


@planar_sum_pair.register(SimoReissner)
@inlined
def simo_sums(strains, constants, scratch, at, a, b):
    """Shear, curvature and its factor."""
    h = vzero(); g = vzero(); e3 = vzero(); e4 = vzero()
    for p in range(at.nq):
        t = at.point + at.point_size * p + 8
        po = at.points + at.point_stride * p
        pa = vld(constants, t + 24 * a, 0); na = vld(constants, t + 24 * a + 8, 0); da = vld(constants, t + 24 * a + 16, 0)
        pb = vld(constants, t + 24 * b, 0); nb = vld(constants, t + 24 * b + 8, 0); db = vld(constants, t + 24 * b + 16, 0)
        s2 = vld(scratch, po + 8, 0)
        h += (pa * nb) * s2
        g += (na * pb) * s2
        e3 += (na * db - da * nb) * vld(scratch, po + 16, 0)
        e4 += (na * nb) * vld(scratch, po + 24, 0)
    o = at.pairs + at.pair_size * (at.nn * a + b)
    vst(scratch, o, 0, g); vst(scratch, o + 8, 0, e3); vst(scratch, o + 16, 0, e4)
    o = at.pairs + at.pair_size * (at.nn * b + a)
    vst(scratch, o, 0, h); vst(scratch, o + 8, 0, vzero() - e3); vst(scratch, o + 16, 0, e4)


@planar_geometric.register(SimoReissner)
@inlined
def simo_geometric(strains, scratch, sums, ua, ub):
    return (0.5 * vld(scratch, sums + 8, 0)) * cross2(ua, ub) + (0.5 * vld(scratch, sums + 16, 0)) * dot(ua, ub)


# --- strain set (2.1) ---------------------------------------------------------------------------------------------------
@planar_strains.register(GreenLagrange)
@inlined
def green_strains(strains, shape):
    return triple(0.5 * dot(shape.f, shape.f), cross2(shape.u, shape.f), cross2(shape.f, shape.k))


@planar_extrapolated.register(GreenLagrange)
@kernel
def green_extrapolated(strains, shape, step):
    return triple(0.5 * dot(shape.f, shape.f) + dot(shape.f, step.f),
                  cross2(shape.u, shape.f) + cross2(step.u, shape.f) + cross2(shape.u, step.f),
                  cross2(shape.f, shape.k) + cross2(step.f, shape.k) + cross2(shape.f, step.k))


@planar_point_data.register(GreenLagrange)
@inlined
def green_data(strains, middle, start, end):
    return GREEN_DATA


@planar_form_stresses.register(GreenLagrange)
@inlined
def green_form_stresses(strains, data, s):
    return s


@planar_position_force.register(GreenLagrange)
@inlined
def green_position_force(strains, data, middle, s):
    return component0(s) * middle.f + component1(s) * perp(middle.u) - component2(s) * perp(middle.k)


@planar_director_forces.register(GreenLagrange)
@inlined
def green_director_forces(strains, data, middle, s):
    x = perp(middle.f)
    return vzero2() - component1(s) * x, component2(s) * x


@planar_point_stiffness.register(GreenLagrange)
@kernel
def green_stiffness(strains, data, middle, end, law, t, constants, to, scratch, at, po):
    """Rows are derivatives of the strains (2.1) of theory.md."""
    f = middle.f; n2 = perp(middle.u); n2e = perp(end.u)
    n3 = vzero2() - perp(middle.k); n3e = vzero2() - perp(end.k)
    vst(scratch, po, 0, component0(t)); vst(scratch, po + 8, 0, component1(t)); vst(scratch, po + 16, 0, component2(t))
    v1 = 0.5 * (law.c00 * end.f + law.c01 * n2e + law.c02 * n3e)
    v2 = 0.5 * (law.c01 * end.f + law.c11 * n2e + law.c12 * n3e)
    v3 = 0.5 * (law.c02 * end.f + law.c12 * n2e + law.c22 * n3e)
    vst2(scratch, po + PLANAR_MATRIX, 8, component0(v1) * f + component0(v2) * n2 + component0(v3) * n3)
    vst2(scratch, po + PLANAR_MATRIX + 16, 8, component1(v1) * f + component1(v2) * n2 + component1(v3) * n3)
    for a in range(at.nn):
        t_a = to + 8 + NODE_TABLE * a
        n = vld(constants, t_a + 8, 0); dn = vld(constants, t_a + 16, 0)
        z = perp(vld2(scratch, 64 * a + 16, 8)); ze = perp(vld2(scratch, 64 * a + 48, 8))
        r1 = n * cross2(z, f)
        r2 = dn * cross2(f, z)
        q2 = n * cross2(ze, end.f)
        q3 = dn * cross2(end.f, ze)
        p0 = 0.5 * (law.c01 * q2 + law.c02 * q3)
        p1 = 0.5 * (law.c11 * q2 + law.c12 * q3)
        p2 = 0.5 * (law.c12 * q2 + law.c22 * q3)
        put_planar_node(scratch, po + PLANAR_NODES + PLANAR_NODE * a, triple(r1, r2, vzero()), triple(p1, p2, vzero()),
                        r1 * v2 + r2 * v3, p0 * f + p1 * n2 + p2 * n3)


@kernel
def green_sum(constants, scratch, at, a, b):
    g = vzero()
    for p in range(at.nq):
        t = at.point + at.point_size * p + 8
        po = at.points + at.point_stride * p
        na = vld(constants, t + 24 * a + 8, 0); da = vld(constants, t + 24 * a + 16, 0)
        g += vld(constants, t + 24 * b, 0) * (na * vld(scratch, po + 8, 0) - da * vld(scratch, po + 16, 0))
    return g


@planar_sum_pair.register(GreenLagrange)
@kernel
def green_sums(strains, constants, scratch, at, a, b):
    vst(scratch, at.pairs + at.pair_size * (at.nn * a + b), 0, green_sum(constants, scratch, at, a, b))
    vst(scratch, at.pairs + at.pair_size * (at.nn * b + a), 0, green_sum(constants, scratch, at, b, a))


@planar_geometric.register(GreenLagrange)
@inlined
def green_geometric(strains, scratch, sums, ua, ub):
    return vzero()


# --- pairs of nodes -----------------------------------------------------------------------------------------------------
@put_pairs.register(Plane)
@inlined
def put_planar_pairs(dofs, strains, constants, scratch, at, mass_factor):
    for a in range(at.nn):
        for b in range(a, at.nn):
            planar_sum_pair.call(strains, constants, scratch, at, a, b)
    for a in range(at.nn):
        for b in range(at.nn):
            planar_pair(strains, constants, scratch, at, a, b, mass_factor)


@inlined
def planar_pair(strains, constants, scratch, at, a, b, mass_factor):
    """The 3 x 3 block of nodes a, b."""
    t00 = vzero(); t10 = vzero(); t01 = vzero(); t11 = vzero()
    rr = vzero(); rt = vzero2(); tr = vzero2()
    for g in range(at.nq):
        t = at.point + at.point_size * g + 8
        po = at.points + at.point_stride * g
        ba = po + PLANAR_NODES + PLANAR_NODE * a
        bb = po + PLANAR_NODES + PLANAR_NODE * b
        pa = vld(constants, t + 24 * a, 0); pb = vld(constants, t + 24 * b, 0)
        pp = pa * pb
        iso = (0.5 * pp) * vld(scratch, po, 0)
        m = po + PLANAR_MATRIX
        t00 += pp * vld(scratch, m, 0) + iso; t10 += pp * vld(scratch, m + 8, 0)
        t01 += pp * vld(scratch, m + 16, 0); t11 += pp * vld(scratch, m + 24, 0) + iso
        rt += pb * vld2(scratch, ba + PLANAR_ROTATION_POSITION, 8)
        tr += pa * vld2(scratch, bb + PLANAR_POSITION_ROTATION, 8)
        for i in range(0, 24, 8):
            rr += vld(scratch, ba + PLANAR_ROWS + i, 0) * vld(scratch, bb + PLANAR_PRODUCTS + i, 0)
    ua = vld2(scratch, 64 * a + 16, 8)
    ub = vld2(scratch, 64 * b + 48, 8)
    sums = at.pairs + at.pair_size * (at.nn * a + b)
    rt -= (0.5 * vld(scratch, sums, 0)) * ua
    tr -= (0.5 * vld(scratch, at.pairs + at.pair_size * (at.nn * b + a), 0)) * ub
    m = mass_factor * vld(constants, at.masses + 8 * (at.nn * a + b), 0) * vld(constants, at.inertia, 0)
    md = mass_factor * vld(constants, at.director_masses + 8 * (at.nn * a + b), 0) * vld(constants, at.inertia + 8, 0)
    rr += planar_geometric.call(strains, scratch, sums, ua, ub) + md * dot(ua, ub)
    ko = at.blocks + 72 * (at.nn * a + b)
    vst(scratch, ko, 0, t00 + m); vst(scratch, ko + 8, 0, t01); vst2(scratch, ko + 16, 24, tr)
    vst(scratch, ko + 24, 0, t10); vst(scratch, ko + 32, 0, t11 + m)
    vst2(scratch, ko + 48, 8, rt); vst(scratch, ko + 64, 0, rr)
