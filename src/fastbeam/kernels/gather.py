"""Coordinates of eight nodes of a group of elements into lanes: middle and end of a step, and where the last increment led."""
from __future__ import annotations

from .._jit import kernel
from .algebra import cross, dot, perp, vld, vld2, vld3, vst2, vst3
from .blocks import FOUR, ONE, SIX, THREE, TWELVE, TWO
from .rows import clear_lanes, copy_lanes, gather_lanes
from .turns import director_increment, planar_turn, turned_back
from .work import FROM_START


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
        copy_lanes(scratch, qo, 96, scratch, e)
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
def put_planar_step(scratch, qo, uo, move, h):
    """The same of a vector in a plane."""
    x = vld2(scratch, qo, 8)
    vst2(scratch, qo + 32, 8, x + move)
    vst2(scratch, qo, 8, x + 0.5 * move)
    vst2(scratch, uo, 8, (2.0 / (h * h)) * (move - h * vld2(scratch, uo, 8)))


@kernel
def gather_planar_ends(tables, at, q, dphi, line, v, h, scratch, qo, uo):
    """Like `gather_ends` in a plane, 4 lanes each, without other second rates."""
    e = qo + 32
    gather_lanes(q, tables.nodes, at, 4, scratch, qo, FOUR)
    if dphi is None:
        copy_lanes(scratch, qo, 32, scratch, e)
    if dphi is not None:
        gather_lanes(dphi, tables.nodes, at, 2, scratch, e, TWO)
        gather_lanes(line.theta, tables.nodes, at, 1, scratch, e + 16, ONE)
        gather_lanes(v, tables.nodes, at, 4, scratch, uo, FOUR)
        move = vld2(scratch, e, 8)
        t = vld(scratch, e + 16, 0)
        u = vld2(scratch, qo + 16, 8)
        put_planar_step(scratch, qo, uo, move, h)
        put_planar_step(scratch, qo + 16, uo + 16, planar_turn(t, u), h)


@kernel
def gather_line(tables, at, q, spin_rate, line, off, scratch, end, lo):
    """Coordinates of 8 nodes before the last increment, 12 lanes at lo, and behind them that increment, along which a straight
    line leads; from their coordinates at `end`. With spin_rate, before the first increment, the start of the step and nothing.
    off: as in `work.Line`."""
    s = lo + 96
    if spin_rate is not None:
        if line.use[0] == FROM_START:
            gather_lanes(q, tables.nodes, at, 12, scratch, lo, TWELVE)
            clear_lanes(scratch, s, 96)
            return
    gather_lanes(line.x, tables.rows, at, 8, scratch, s, SIX)
    gather_lanes(line.theta, tables.nodes, at, 3, scratch, lo, THREE)
    spin = vld3(scratch, s + 24, 8)
    y, g = turned_back(dot(spin, spin), dot(vld3(scratch, lo, 8), spin))
    position = vld3(scratch, end, 8)
    if off is not None:
        gather_lanes(off, tables.nodes, at, 3, scratch, lo, THREE)
        position = position - vld3(scratch, lo, 8)
    vst3(scratch, lo, 8, position - vld3(scratch, s, 8))
    for i in range(24, 96, 24):
        d = vld3(scratch, end + i, 8)
        x = cross(spin, d)
        d += g * (0.5 * cross(spin, x) - y * x)
        vst3(scratch, s + i, 8, cross(spin, d))
        vst3(scratch, lo + i, 8, d)


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
    vst2(scratch, lo, 8, position - vld2(scratch, s, 8))
    d = vld2(scratch, end + 16, 8)
    d -= (g * spin) * (y * perp(d) + (0.5 * spin) * d)
    vst2(scratch, s + 16, 8, spin * perp(d))
    vst2(scratch, lo + 16, 8, d)
