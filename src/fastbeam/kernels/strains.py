"""Strains and stresses at the quadrature points of a group of 8 elements, and those that the tangent uses (theory.md (4.6))."""
from __future__ import annotations

from .._jit import kernel
from .algebra import cross, dot, perp, vld, vld2, vld3, vst, vst2, vst3, vzero, vzero3
from .blocks import ONE, SIX, THREE, TWELVE
from .rows import gather_lanes, gather_sum
from .turns import director_increment, turn_factor
from .work import FROM_START

Q_LANES = 24 * 8     # two sets of coordinates of a node


@kernel
def gather_ends(tables, at, q, dq, v, u, spin_rate, h, scratch, qo, uo, coordinates):
    """Coordinates of 8 nodes in the middle and at the end of a step, n lanes each from qo on, n the length of the tuple
    `coordinates`, and their second rates at uo: 2/h^2 (dq - h v), or u, or none. Without dq both are q; with spin_rate both are
    the end."""
    n = len(coordinates)
    e = qo + 8 * n
    if dq is None:
        gather_lanes(q, tables.nodes, at, n, scratch, qo, coordinates)
        gather_lanes(q, tables.nodes, at, n, scratch, e, coordinates)
    else:
        gather_sum(q, dq, 0.5 if spin_rate is None else 1.0, 1.0, tables.nodes, at, scratch, qo, coordinates)
        gather_sum(q, dq, 1.0, 1.0, tables.nodes, at, scratch, e, coordinates)
    if v is not None:
        gather_sum(dq, v, -h, 2.0 / (h * h), tables.nodes, at, scratch, uo, coordinates)
    if u is not None:
        gather_lanes(u, tables.nodes, at, n, scratch, uo, coordinates)


@kernel
def gather_line(tables, at, q, spin_rate, line, scratch, end, lo):
    """Where the last increment led 8 nodes in a straight line, 12 lanes at lo, and the way there behind; from their coordinates at
    `end`. With spin_rate, before the first increment, the start of the step."""
    s = lo + 96
    if spin_rate is not None:
        if line.use[0] == FROM_START:
            gather_lanes(q, tables.nodes, at, 12, scratch, lo, TWELVE)
            for i in range(s, s + 96, 8):
                vst(scratch, i, 0, 0.0)
            return
    gather_lanes(line.x, tables.rows, at, 8, scratch, s, SIX)
    gather_lanes(line.theta, tables.nodes, at, 3, scratch, lo, THREE)
    spin = vld3(scratch, s + 24, 8)
    back = -1.0 * (turn_factor(dot(spin, spin), dot(vld3(scratch, lo, 8), spin)) * spin)
    c = 1.0 / (1.0 + 0.25 * dot(back, back))
    # positions move in a straight line
    vst3(scratch, lo, 8, vld3(scratch, end, 8))
    for i in range(24, 96, 24):
        d = vld3(scratch, end + i, 8)
        d += director_increment(c, back, d)
        way = cross(spin, d)
        vst3(scratch, s + i, 8, way)
        vst3(scratch, lo + i, 8, d + way)


@kernel
def gather_planar_line(tables, at, line, scratch, end, lo):
    """The same in a plane, 4 lanes each."""
    s = lo + 32
    gather_lanes(line.x, tables.rows, at, 8, scratch, s, THREE)
    gather_lanes(line.theta, tables.nodes, at, 1, scratch, lo, ONE)
    spin = vld(scratch, s + 16, 0)
    back = -1.0 * (turn_factor(spin * spin, vld(scratch, lo, 0) * spin) * spin)
    vst2(scratch, lo, 8, vld2(scratch, end, 8))
    d = vld2(scratch, end + 16, 8)
    d += (back / (1.0 + 0.25 * back * back)) * (perp(d) - (0.5 * back) * d)
    way = spin * perp(d)
    vst2(scratch, s + 16, 8, way)
    vst2(scratch, lo + 16, 8, d + way)


@kernel
def interpolate(tab, to, nn, scratch, qo, zo):
    """z = (phi', d1, d2, d3, d1', d2', d3') at one point; qo: first of nn nodes of 24 lanes each, zo: output."""
    f = vzero3(); d1 = vzero3(); d2 = vzero3(); d3 = vzero3(); k1 = vzero3(); k2 = vzero3(); k3 = vzero3()
    for a in range(nn):
        t = to + 8 + 24 * a
        q = qo + Q_LANES * a
        dp = vld(tab, t, 0); n = vld(tab, t + 8, 0); dn = vld(tab, t + 16, 0)
        f += dp * vld3(scratch, q, 8)
        x = vld3(scratch, q + 24, 8); d1 += n * x; k1 += dn * x
        x = vld3(scratch, q + 48, 8); d2 += n * x; k2 += dn * x
        x = vld3(scratch, q + 72, 8); d3 += n * x; k3 += dn * x
    vst3(scratch, zo, 8, f); vst3(scratch, zo + 24, 8, d1); vst3(scratch, zo + 48, 8, d2); vst3(scratch, zo + 72, 8, d3)
    vst3(scratch, zo + 96, 8, k1); vst3(scratch, zo + 120, 8, k2); vst3(scratch, zo + 144, 8, k3)


@kernel
def quadratic_strains(scratch, z, green, eo, add):
    """The homogeneous quadratic part of the six strains of z, theory.md (2.1), (2.2); added to what stands there if `add`."""
    f = vld3(scratch, z, 8); d1 = vld3(scratch, z + 24, 8); d2 = vld3(scratch, z + 48, 8); d3 = vld3(scratch, z + 72, 8)
    k1 = vld3(scratch, z + 96, 8); k2 = vld3(scratch, z + 120, 8); k3 = vld3(scratch, z + 144, 8)
    e4 = 0.5 * (dot(k2, d3) - dot(k3, d2))
    if green is None:
        e1 = dot(f, d1)
        e5 = 0.5 * (dot(k3, d1) - dot(k1, d3))
        e6 = 0.5 * (dot(k1, d2) - dot(k2, d1))
    else:
        e1 = 0.5 * dot(f, f)
        e5 = dot(f, k3)
        e6 = -1.0 * dot(f, k2)
    e2 = dot(f, d2)
    e3 = dot(f, d3)
    if add:
        e1 += vld(scratch, eo, 0); e2 += vld(scratch, eo + 8, 0); e3 += vld(scratch, eo + 16, 0)
        e4 += vld(scratch, eo + 24, 0); e5 += vld(scratch, eo + 32, 0); e6 += vld(scratch, eo + 40, 0)
    vst(scratch, eo, 0, e1); vst(scratch, eo + 8, 0, e2); vst(scratch, eo + 16, 0, e3)
    vst(scratch, eo + 24, 0, e4); vst(scratch, eo + 32, 0, e5); vst(scratch, eo + 40, 0, e6)


@kernel
def mean_strains(tab, e0, scratch, zm, ze, green, middle, eo, room):
    """(E_n + E_n+1)/2 - E0: E quadratic gives E(z_mid) + E(z_end - z_mid). `middle`: only E(z_mid). e0: where E0 stands."""
    quadratic_strains(scratch, zm, green, eo, False)
    if middle is None:
        for i in range(0, 168, 8):
            vst(scratch, room + i, 0, vld(scratch, ze + i, 0) - vld(scratch, zm + i, 0))
        quadratic_strains(scratch, room, green, eo, True)
    for i in range(0, 48, 8):
        vst(scratch, eo + i, 0, vld(scratch, eo + i, 0) - vld(tab, e0 + i, 0))


@kernel
def unused_strains(scratch, zm, ze, zl, zs, dq, spin_rate, green, middle, eo, room):
    """What the mean strains, linear in the last increment, lack to those of the present shape: what the tangent must not use,
    theory.md (4.6). zl: the shape to which the last increment leads in a straight line, zs: that increment."""
    if middle is not None:
        for i in range(0, 168, 8):
            vst(scratch, zl + i, 0, vld(scratch, zm + i, 0) + 0.5 * (vld(scratch, zl + i, 0) - vld(scratch, ze + i, 0)))
            vst(scratch, zs + i, 0, 0.5 * vld(scratch, zs + i, 0))
    quadratic_strains(scratch, zs, green, eo, False)
    quadratic_strains(scratch, zm if middle is not None else ze, green, eo, True)
    quadratic_strains(scratch, zl, green, room, False)
    # the start of a conserving step stays as it is
    share = 0.5
    if middle is not None or dq is None or spin_rate is not None:
        share = 1.0
    for i in range(0, 48, 8):
        vst(scratch, eo + i, 0, share * (vld(scratch, room + i, 0) - vld(scratch, eo + i, 0)))


@kernel
def stresses(tab, co, to, coupled, scratch, eo, so):
    """weight times C times the strains at `eo` into the six lanes at `so`."""
    w = vld(tab, to, 0)
    for i in range(6):
        j0 = 0 if coupled else i
        j1 = 6 if coupled else i + 1
        s = vzero()
        for j in range(j0, j1):
            s += vld(tab, co + 48 * i + 8 * j, 0) * vld(scratch, eo + 8 * j, 0)
        vst(scratch, so + 8 * i, 0, w * s)
