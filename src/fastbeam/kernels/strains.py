"""Strains and stresses at the quadrature points of a group of 8 elements, and those that the tangent uses (theory.md (4.6))."""
from __future__ import annotations

from .._jit import kernel
from .algebra import cross, dot, gather_lanes, perp, vld, vld2, vld3, vst, vst2, vst3, vzero, vzero3

Q_LANES = 24 * 8     # two sets of coordinates of a node


@kernel
def gather_ends(tables, at, n, q, dq, v, u, spin_rate, h, scratch, qo, uo):
    """Coordinates of 8 nodes in the middle and at the end of a step, n = 12 or 4 lanes each from qo on, and their second rates at
    uo: 2/h^2 (dq - h v), or u, or none. Without dq both are q; with spin_rate both are the end."""
    gather_lanes(q, tables.nodes, at, n, n, scratch, qo)
    e = qo + 8 * n
    if dq is None:
        for i in range(0, 8 * n, 8):
            vst(scratch, e + i, 0, vld(scratch, qo + i, 0))
    else:
        gather_lanes(dq, tables.nodes, at, n, n, scratch, e)
        if v is not None:
            gather_lanes(v, tables.nodes, at, n, n, scratch, uo)
            rate = 2.0 / (h * h)
        for i in range(0, 8 * n, 8):
            x = vld(scratch, qo + i, 0)
            y = vld(scratch, e + i, 0)
            vst(scratch, e + i, 0, x + y)
            if spin_rate is not None:
                vst(scratch, qo + i, 0, x + y)
            else:
                vst(scratch, qo + i, 0, x + 0.5 * y)
            if v is not None:
                vst(scratch, uo + i, 0, rate * (y - h * vld(scratch, uo + i, 0)))
    if u is not None:
        gather_lanes(u, tables.nodes, at, n, n, scratch, uo)


@kernel
def gather_shape_before(tables, at, n, q, line, scratch, lo):
    """Coordinates of 8 nodes before the last increment, n lanes at lo, and the increment of their rows behind."""
    gather_lanes(q, tables.nodes, at, n, n, scratch, lo)
    s = lo + 8 * n
    gather_lanes(line.last, tables.nodes, at, n, n, scratch, s)
    for i in range(0, 8 * n, 8):
        vst(scratch, lo + i, 0, vld(scratch, lo + i, 0) + vld(scratch, s + i, 0))


@kernel
def gather_line(tables, at, q, line, scratch, lo):
    """Where the last increment leads 8 nodes in a straight line, 12 lanes at lo, and the way there behind."""
    gather_shape_before(tables, at, 12, q, line, scratch, lo)
    s = lo + 96
    gather_lanes(line.x, tables.rows, at, 8, 6, scratch, s)
    turn = vld3(scratch, s + 24, 8)
    vst3(scratch, lo, 8, vld3(scratch, lo, 8) + vld3(scratch, s, 8))
    for i in range(24, 96, 24):
        d = vld3(scratch, lo + i, 8)
        way = cross(turn, d)
        vst3(scratch, s + i, 8, way)
        vst3(scratch, lo + i, 8, d + way)


@kernel
def gather_planar_line(tables, at, q, line, scratch, lo):
    """The same in a plane, 4 lanes each."""
    gather_shape_before(tables, at, 4, q, line, scratch, lo)
    s = lo + 32
    gather_lanes(line.x, tables.rows, at, 8, 3, scratch, s)
    vst2(scratch, lo, 8, vld2(scratch, lo, 8) + vld2(scratch, s, 8))
    d = vld2(scratch, lo + 16, 8)
    way = vld(scratch, s + 16, 0) * perp(d)
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
