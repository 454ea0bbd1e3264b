"""Points and pairs of nodes of beams in a plane: element_loop.py and the strain sets with 3 unknowns a node.

A node has 4 coordinates: its position x, y in the plane and the director u = d1 in it. The other director of the plane is J u, u
turned by a right angle, the third is the constant normal. The strains that remain are (theory.md 10)

    stretch  sqrt(f . f - shear^2)  or  1/2 f . f,     shear  u x f,     curvature  c u x u',  c = (3 - u . u)/2,  or  f x u'
    (f = phi', x: normal component)

where the second form belongs to strain set (2.1). Residual and tangent as in theory.md 4: mean strains, rows with the mean
director, columns with the spin at the end. Values stay in registers, so here shapes and strains are vectors and not offsets;
loads, stores and zeros are those of `vectors.WIDTH` lanes.

Arrays: constants [*] and reference [*], addresses of a group's tables and of its reference strains; scratch [*], its numbers in
lanes: layout.py has their places.
"""
from __future__ import annotations

from typing import Any, NamedTuple

from fastbeam.kernels.algebra.dimensions import Plane
from fastbeam.kernels.algebra.native import vadd2, vld, vld2, vld3, vst, vst2, vzero, vzero2
from fastbeam.kernels.algebra.vectors import component0, component1, component2, cross2, dot, perp, square_root, triple
from fastbeam.kernels.beams.element_loop import add_node_inertia, evaluate_point, put_pairs
from fastbeam.kernels.beams.motions import share_of_end
from fastbeam.kernels.beams.section_laws import Law, apply_law, matrix_at, planar_modulus, planar_stress
from fastbeam.kernels.beams.strain_measures import (
    GreenLagrange,
    SimoReissner,
    planar_changes,
    planar_director_forces,
    planar_extrapolated,
    planar_form_stresses,
    planar_geometric,
    planar_no_sums,
    planar_point_data,
    planar_point_stiffness,
    planar_position_force,
    planar_reversed,
    planar_strains,
    planar_sums,
)
from fastbeam.kernels.jit.decorators import inlined, kernel
from fastbeam.kernels.layout import (
    NODE_TABLE,
    PLANAR_MATRIX,
    PLANAR_NODE,
    PLANAR_NODES,
    PLANAR_POSITION_ROTATION,
    PLANAR_PRODUCTS,
    PLANAR_ROTATION_POSITION,
    PLANAR_ROWS,
)


class Shape(NamedTuple):
    """Shape of a beam at a point: phi', u, u'."""

    f: Any
    u: Any
    k: Any


class SimoData(NamedTuple):
    """Data for derivatives of the strains (2.2): means, and values at the end."""

    over: Any       # 1 / stretch, so that changes of mean strains are those of forms at the end
    over_end: Any
    g: Any          # shear
    g_end: Any
    a: Any          # factor c
    a_end: Any
    c: Any          # u x u'
    c_end: Any


class GreenData(NamedTuple):
    """Placeholder for data of strains (2.1), which are quadratic forms."""


GREEN_DATA = GreenData()


class Basis(NamedTuple):
    """Basis functions of a node at a point: phi_s, dir, dir_s."""

    position: Any
    director: Any
    slope: Any


class SimoSums(NamedTuple):
    """Sums over the points of stresses (2.2) times products of basis functions of two nodes a and b."""

    shear: Any            # dir_a phi_s,b
    shear_reversed: Any   # phi_s,a dir_b
    curvature: Any        # dir_a dir_s,b - dir_s,a dir_b
    factor: Any           # dir_a dir_b


class GreenSums(NamedTuple):
    """Sums over the points of stresses (2.1) times products of basis functions, shear and curvature together."""

    shear: Any
    shear_reversed: Any


class Shared(NamedTuple):
    """Stiffness block of the positions of two nodes."""

    t00: Any
    t10: Any
    t01: Any
    t11: Any


class PointForces(NamedTuple):
    """Forces of a point on a node: phi_s times `position`, dir times `director` plus dir_s times `slope`."""

    position: Any
    director: Any
    slope: Any


@inlined
def planar_shapes(constants, to, nn, scratch, qo):
    """Return the `Shape` of the nodes from qo on, 64 doubles apart, and that of the coordinates 32 doubles behind."""
    f = vzero2(); u = vzero2(); k = vzero2(); fe = vzero2(); ue = vzero2(); ke = vzero2()
    for a in range(nn):
        t = to + 8 + NODE_TABLE * a
        q = qo + 64 * a
        dp = vld(constants, t, 0); n = vld(constants, t + 8, 0); dn = vld(constants, t + 16, 0)
        x = vld2(scratch, q + 16, 8); y = vld2(scratch, q + 48, 8)
        f += dp * vld2(scratch, q, 8); u += n * x; k += dn * x
        fe += dp * vld2(scratch, q + 32, 8); ue += n * y; ke += dn * y
    return Shape(f, u, k), Shape(fe, ue, ke)


@inlined
def add_node_forces(constants, t, scratch, fo, forces):
    """Add forces of a point on the coordinates of a node; t: offset of its basis functions."""
    vadd2(scratch, fo, 8, vld(constants, t, 0) * forces.position)
    vadd2(scratch, fo + 16, 8, vld(constants, t + 8, 0) * forces.director + vld(constants, t + 16, 0) * forces.slope)


@add_node_inertia.register(Plane)
@inlined
def add_node_inertia_in_plane(dofs, constants, scratch, at, a):
    p = vzero2(); d = vzero2()
    for b in range(at.nn):
        u = at.rates + 32 * b
        p += vld(constants, at.masses + 8 * (at.nn * a + b), 0) * vld2(scratch, u, 8)
        d += vld(constants, at.director_masses + 8 * (at.nn * a + b), 0) * vld2(scratch, u + 16, 8)
    fo = at.forces + 32 * a
    vadd2(scratch, fo, 8, vld(constants, at.inertia, 0) * p)
    vadd2(scratch, fo + 16, 8, vld(constants, at.inertia + 8, 0) * d)


@evaluate_point.register(Plane)
@inlined
def evaluate_point_in_plane(dofs, method, strains, constants, reference, g, scratch, at, case):
    to = at.point + at.point_size * g
    middle, end = planar_shapes(constants, to, at.nn, scratch, 0)
    start = Shape(2.0 * middle.f - end.f, 2.0 * middle.u - end.u, 2.0 * middle.k - end.k)
    before = planar_strains.call(strains, start)
    present = planar_strains.call(strains, end)
    data = planar_point_data.call(strains, middle, start, end)
    stiffness = matrix_at(constants, to, 0, 1.0)
    e = 0.5 * (before + present) - vld3(reference, 24 * g, 8)
    s = planar_stress.call(strains.law, stiffness, constants, to, e, 0.5 * (present - before))
    law = planar_modulus.call(strains.law, stiffness, constants, to)
    t = s
    if case.mixed:
        # the tangent takes the strains to which the last increment led in a straight line: their difference to those of the
        # present shape, theory.md (4.6)
        if case.gathered:
            shape_before, increment = planar_shapes(constants, to, at.nn, scratch, at.increment)
            before = planar_extrapolated.call(strains, shape_before, increment)
        more = apply_law(law, share_of_end.call(method) * (before - present))
        t = s + more
        x, y = planar_director_forces.call(strains, data, middle, planar_form_stresses.call(strains, data, more))
        for a in range(at.nn):
            t_a = to + 8 + NODE_TABLE * a
            vadd2(scratch, at.tangent_forces + 32 * a + 16, 8, vld(constants, t_a + 8, 0) * x + vld(constants, t_a + 16, 0) * y)
    forms = planar_form_stresses.call(strains, data, s)
    x, y = planar_director_forces.call(strains, data, middle, forms)
    forces = PointForces(planar_position_force.call(strains, data, middle, forms), x, y)
    planar_point_stiffness.call(strains, data, middle, end, law, t, forces, constants, to, scratch, at,
                                at.points + at.point_stride * g)


@inlined
def put_planar_node(scratch, b, rows, products, rotation_position, position_rotation):
    """Store rows, products and columns of a node at a point, for the pairs of nodes."""
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


@planar_changes.register(SimoReissner)
@inlined
def simo_changes(strains, data, middle, step):
    g = cross2(step.u, middle.f) + cross2(middle.u, step.f)
    c = cross2(step.u, middle.k) + cross2(middle.u, step.k)
    return triple(data.over * (dot(middle.f, step.f) - data.g * g), g, data.a * c - data.c * dot(middle.u, step.u))


@planar_form_stresses.register(SimoReissner)
@inlined
def simo_form_stresses(strains, data, s):
    """Return stresses on the forms; that on the curvature form stays the moment."""
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
def simo_stiffness(strains, data, middle, end, law, t, forces, constants, to, scratch, at, po):
    """Form the stiffness of a point; rows are derivatives of the quadratic forms of shear, curvature and its factor, theory.md
    (4.8)."""
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
        add_node_forces(constants, t_a, scratch, at.forces + 32 * a, forces)
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


@planar_no_sums.register(SimoReissner)
@inlined
def simo_no_sums(strains):
    return SimoSums(vzero(), vzero(), vzero(), vzero())


@planar_sums.register(SimoReissner)
@inlined
def simo_sums(strains, sums, scratch, po, a, b):
    s2 = vld(scratch, po + 8, 0)
    return SimoSums(sums.shear + (a.director * b.position) * s2, sums.shear_reversed + (a.position * b.director) * s2,
                    sums.curvature + (a.director * b.slope - a.slope * b.director) * vld(scratch, po + 16, 0),
                    sums.factor + (a.director * b.director) * vld(scratch, po + 24, 0))


@planar_reversed.register(SimoReissner)
@inlined
def simo_reversed(strains, sums):
    return SimoSums(sums.shear_reversed, sums.shear, vzero() - sums.curvature, sums.factor)


@planar_geometric.register(SimoReissner)
@inlined
def simo_geometric(strains, sums, ua, ub):
    return (0.5 * sums.curvature) * cross2(ua, ub) + (0.5 * sums.factor) * dot(ua, ub)


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


@planar_changes.register(GreenLagrange)
@inlined
def green_changes(strains, data, middle, step):
    return triple(dot(middle.f, step.f), cross2(step.u, middle.f) + cross2(middle.u, step.f),
                  cross2(step.f, middle.k) + cross2(middle.f, step.k))


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
def green_stiffness(strains, data, middle, end, law, t, forces, constants, to, scratch, at, po):
    """Form the stiffness of a point; rows are derivatives of the strains (2.1) of theory.md."""
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
        add_node_forces(constants, t_a, scratch, at.forces + 32 * a, forces)
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


@planar_no_sums.register(GreenLagrange)
@inlined
def green_no_sums(strains):
    return GreenSums(vzero(), vzero())


@planar_sums.register(GreenLagrange)
@inlined
def green_sums(strains, sums, scratch, po, a, b):
    s2 = vld(scratch, po + 8, 0); s3 = vld(scratch, po + 16, 0)
    return GreenSums(sums.shear + b.position * (a.director * s2 - a.slope * s3),
                     sums.shear_reversed + a.position * (b.director * s2 - b.slope * s3))


@planar_reversed.register(GreenLagrange)
@inlined
def green_reversed(strains, sums):
    return GreenSums(sums.shear_reversed, sums.shear)


@planar_geometric.register(GreenLagrange)
@inlined
def green_geometric(strains, sums, ua, ub):
    return vzero()


# --- pairs of nodes -----------------------------------------------------------------------------------------------------
@put_pairs.register(Plane)
@inlined
def put_planar_pairs(dofs, strains, constants, scratch, at, mass_factor):
    """Form the blocks of all pairs of nodes; blocks (a, b) and (b, a) share sums of stresses and the part of the positions."""
    for a in range(at.nn):
        for b in range(a, at.nn):
            shared, sums = planar_pair(strains, constants, scratch, at, a, b)
            put_planar_block(strains, constants, scratch, at, a, b, mass_factor, shared, sums)
            if b > a:
                put_planar_block(strains, constants, scratch, at, b, a, mass_factor, shared, planar_reversed.call(strains, sums))


@inlined
def basis_of_node(constants, t, a):
    t_a = t + NODE_TABLE * a
    return Basis(vld(constants, t_a, 0), vld(constants, t_a + 8, 0), vld(constants, t_a + 16, 0))


@inlined
def planar_pair(strains, constants, scratch, at, a, b):
    """Return the parts that the blocks of nodes a, b and b, a share, and sums of stresses."""
    t00 = vzero(); t10 = vzero(); t01 = vzero(); t11 = vzero()
    sums = planar_no_sums.call(strains)
    for g in range(at.nq):
        t = at.point + at.point_size * g + 8
        po = at.points + at.point_stride * g
        at_a = basis_of_node(constants, t, a); at_b = basis_of_node(constants, t, b)
        pp = at_a.position * at_b.position
        iso = (0.5 * pp) * vld(scratch, po, 0)
        m = po + PLANAR_MATRIX
        t00 += pp * vld(scratch, m, 0) + iso; t10 += pp * vld(scratch, m + 8, 0)
        t01 += pp * vld(scratch, m + 16, 0); t11 += pp * vld(scratch, m + 24, 0) + iso
        sums = planar_sums.call(strains, sums, scratch, po, at_a, at_b)
    return Shared(t00, t10, t01, t11), sums


@inlined
def put_planar_block(strains, constants, scratch, at, a, b, mass_factor, shared, sums):
    """Store the 3 x 3 block of nodes a, b."""
    rr = vzero(); rt = vzero2(); tr = vzero2()
    for g in range(at.nq):
        t = at.point + at.point_size * g + 8
        po = at.points + at.point_stride * g + PLANAR_NODES
        ba = po + PLANAR_NODE * a
        bb = po + PLANAR_NODE * b
        rt += vld(constants, t + NODE_TABLE * b, 0) * vld2(scratch, ba + PLANAR_ROTATION_POSITION, 8)
        tr += vld(constants, t + NODE_TABLE * a, 0) * vld2(scratch, bb + PLANAR_POSITION_ROTATION, 8)
        for i in range(0, 24, 8):
            rr += vld(scratch, ba + PLANAR_ROWS + i, 0) * vld(scratch, bb + PLANAR_PRODUCTS + i, 0)
    ua = vld2(scratch, 64 * a + 16, 8)
    ub = vld2(scratch, 64 * b + 48, 8)
    rt -= (0.5 * sums.shear) * ua
    tr -= (0.5 * sums.shear_reversed) * ub
    m = mass_factor * vld(constants, at.masses + 8 * (at.nn * a + b), 0) * vld(constants, at.inertia, 0)
    md = mass_factor * vld(constants, at.director_masses + 8 * (at.nn * a + b), 0) * vld(constants, at.inertia + 8, 0)
    rr += planar_geometric.call(strains, sums, ua, ub) + md * dot(ua, ub)
    ko = at.blocks + 72 * (at.nn * a + b)
    vst(scratch, ko, 0, shared.t00 + m); vst(scratch, ko + 8, 0, shared.t01); vst2(scratch, ko + 16, 24, tr)
    vst(scratch, ko + 24, 0, shared.t10); vst(scratch, ko + 32, 0, shared.t11 + m)
    vst2(scratch, ko + 48, 8, rt); vst(scratch, ko + 64, 0, rr)
