"""Strains and stresses at the quadrature points of a group of 8 elements, and those that the tangent uses (theory.md (4.6))."""
from __future__ import annotations

from .._jit import kernel
from .algebra import cross, dot, perp, vld, vld2, vld3, vst, vst2, vst3, vzero, vzero3
from .blocks import FOUR, ONE, SIX, THREE, TWELVE, TWO
from .rows import gather_lanes
from .turns import director_increment, planar_turn, turned_back
from .work import FROM_START

Q_LANES = 24 * 8     # two sets of coordinates of a node


@kernel
def put_step(scratch, qo, uo, move, v, spin_rate, h):
    """Middle and end, from the start at qo and the increment of a vector in lanes; its second rate in place of its rate at uo."""
    x = vld3(scratch, qo, 8)
    vst3(scratch, qo + 96, 8, x + move)
    if spin_rate is None:
        vst3(scratch, qo, 8, x + 0.5 * move)
    if spin_rate is not None:
        vst3(scratch, qo, 8, x + move)
    if v is not None:
        vst3(scratch, uo, 8, (2.0 / (h * h)) * (move - h * vld3(scratch, uo, 8)))


@kernel
def gather_ends(tables, at, q, dphi, line, v, u, spin_rate, h, scratch, qo, uo):
    """Coordinates of 8 nodes in the middle and at the end of a step, 12 lanes each from qo on, and their second rates at uo:
    2/h^2 (dq - h v), or u, or none. Without dphi both are q; with spin_rate both are the end."""
    e = qo + 96
    gather_lanes(q, tables.nodes, at, 12, scratch, qo, TWELVE)
    if u is not None:
        gather_lanes(u, tables.nodes, at, 12, scratch, uo, TWELVE)
    if dphi is None:
        for i in range(0, 96, 8):
            vst(scratch, e + i, 0, vld(scratch, qo + i, 0))
    if dphi is not None:
        gather_lanes(dphi, tables.nodes, at, 3, scratch, e, THREE)
        gather_lanes(line.theta, tables.nodes, at, 3, scratch, e + 24, THREE)
        if v is not None:
            gather_lanes(v, tables.nodes, at, 12, scratch, uo, TWELVE)
        move = vld3(scratch, e, 8)
        t = vld3(scratch, e + 24, 8)
        c = 1.0 / (1.0 + 0.25 * dot(t, t))
        put_step(scratch, qo, uo, move, v, spin_rate, h)
        for i in range(24, 96, 24):
            put_step(scratch, qo + i, uo + i, director_increment(c, t, vld3(scratch, qo + i, 8)), v, spin_rate, h)


@kernel
def gather_planar_ends(tables, at, q, dphi, line, v, h, scratch, qo, uo):
    """The same in a plane, 4 lanes each, without other second rates."""
    e = qo + 32
    gather_lanes(q, tables.nodes, at, 4, scratch, qo, FOUR)
    if dphi is None:
        for i in range(0, 32, 8):
            vst(scratch, e + i, 0, vld(scratch, qo + i, 0))
    if dphi is not None:
        gather_lanes(dphi, tables.nodes, at, 2, scratch, e, TWO)
        gather_lanes(line.theta, tables.nodes, at, 1, scratch, e + 16, ONE)
        gather_lanes(v, tables.nodes, at, 4, scratch, uo, FOUR)
        move = vld2(scratch, e, 8)
        t = vld(scratch, e + 16, 0)
        u = vld2(scratch, qo + 16, 8)
        turn = planar_turn(t, u)
        x = vld2(scratch, qo, 8)
        vst2(scratch, e, 8, x + move)
        vst2(scratch, e + 16, 8, u + turn)
        vst2(scratch, qo, 8, x + 0.5 * move)
        vst2(scratch, qo + 16, 8, u + 0.5 * turn)
        rate = 2.0 / (h * h)
        vst2(scratch, uo, 8, rate * (move - h * vld2(scratch, uo, 8)))
        vst2(scratch, uo + 16, 8, rate * (turn - h * vld2(scratch, uo + 16, 8)))


@kernel
def gather_line(tables, at, q, spin_rate, line, off, scratch, end, lo):
    """Where the last increment led 8 nodes in a straight line, 12 lanes at lo, and the way there behind; from their coordinates
    at `end`. With spin_rate, before the first increment, the start of the step. off: as in `work.Line`."""
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
    y, g = turned_back(dot(spin, spin), dot(vld3(scratch, lo, 8), spin))
    position = vld3(scratch, end, 8)
    if off is not None:
        gather_lanes(off, tables.nodes, at, 3, scratch, lo, THREE)
        position = position - vld3(scratch, lo, 8)
    vst3(scratch, lo, 8, position)
    for i in range(24, 96, 24):
        d = vld3(scratch, end + i, 8)
        x = cross(spin, d)
        d += g * (0.5 * cross(spin, x) - y * x)
        way = cross(spin, d)
        vst3(scratch, s + i, 8, way)
        vst3(scratch, lo + i, 8, d + way)


@kernel
def gather_planar_line(tables, at, line, off, scratch, end, lo):
    """The same in a plane, 4 lanes each."""
    s = lo + 32
    gather_lanes(line.x, tables.rows, at, 8, scratch, s, THREE)
    gather_lanes(line.theta, tables.nodes, at, 1, scratch, lo, ONE)
    spin = vld(scratch, s + 16, 0)
    y, g = turned_back(spin * spin, vld(scratch, lo, 0) * spin)
    position = vld2(scratch, end, 8)
    if off is not None:
        gather_lanes(off, tables.nodes, at, 2, scratch, lo, TWO)
        position = position - vld2(scratch, lo, 8)
    vst2(scratch, lo, 8, position)
    d = vld2(scratch, end + 16, 8)
    d -= (g * spin) * (y * perp(d) + (0.5 * spin) * d)
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
def unused_strains(scratch, zm, ze, zl, zs, dphi, spin_rate, green, middle, eo, room):
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
    if middle is not None or dphi is None or spin_rate is not None:
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
