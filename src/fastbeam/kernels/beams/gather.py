"""Gathering of eight nodes of a group of elements into lanes: middle and end of a step, and coordinates before the last
increment.

Arrays: scratch [*], numbers of a group in lanes: layout.py has their places; off [3 N], in a plane [2 N].
"""
from __future__ import annotations

from fastbeam.kernels.algebra.blocks import EIGHTEEN, FOUR, ONE, SIX, THREE, TWELVE, TWO
from fastbeam.kernels.algebra.cayley import director_increment, planar_turn, turned_back
from fastbeam.kernels.algebra.dimensions import Plane, Space
from fastbeam.kernels.algebra.lanes import clear_lanes, copy_lanes, gather_lanes
from fastbeam.kernels.algebra.vectors import cross, dot, perp, vld, vld2, vld3, vst2, vst3
from fastbeam.kernels.beams.motions import (
    OverStep,
    Resting,
    Still,
    ToEnd,
    gather_ends,
    gather_increment,
    gather_spin_rates,
    needs_increment,
)
from fastbeam.kernels.jit.decorators import inlined, kernel
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.state import FROM_START
from fastbeam.kernels.terms import NoTies


# --- middle and end -----------------------------------------------------------------------------------------------------
@generic
def put_step(motion, scratch, qo, uo, move):
    """Form middle and end of a vector in lanes, from its start at qo and its increment; its second rate replaces its rate at
    uo."""


@put_step.register(OverStep)
@inlined
def put_middle_and_end(motion, scratch, qo, uo, move):
    h = motion.h
    x = vld3(scratch, qo, 8)
    vst3(scratch, qo + 96, 8, x + move)
    vst3(scratch, qo, 8, x + 0.5 * move)
    vst3(scratch, uo, 8, (2.0 / (h * h)) * (move - h * vld3(scratch, uo, 8)))


@put_step.register(ToEnd)
@inlined
def put_end(motion, scratch, qo, uo, move):
    x = vld3(scratch, qo, 8)
    vst3(scratch, qo + 96, 8, x + move)
    vst3(scratch, qo, 8, x + move)


@inlined
def put_steps(motion, tables, no, scratch, qo, uo):
    """Run `put_step` for the vectors of 8 nodes, whose starts stand at qo."""
    e = qo + 96
    gather_lanes(motion.dphi, tables.nodes, no, 3, scratch, e, THREE)
    gather_lanes(motion.increment.theta, tables.nodes, no, 3, scratch, e + 24, THREE)
    move = vld3(scratch, e, 8)
    t = vld3(scratch, e + 24, 8)
    c = 1.0 / (1.0 + 0.25 * dot(t, t))
    put_step.call(motion, scratch, qo, uo, move)
    for i in range(24, 96, 24):
        put_step.call(motion, scratch, qo + i, uo + i, director_increment(c, t, vld3(scratch, qo + i, 8)))


@gather_ends.register(Space, OverStep)
@inlined
def gather_over_step(dofs, motion, tables, no, scratch, qo, uo):
    gather_lanes(motion.q, tables.nodes, no, 12, scratch, qo, TWELVE)
    gather_lanes(motion.v, tables.nodes, no, 12, scratch, uo, TWELVE)
    put_steps(motion, tables, no, scratch, qo, uo)


@gather_ends.register(Space, ToEnd)
@inlined
def gather_end(dofs, motion, tables, no, scratch, qo, uo):
    gather_lanes(motion.q, tables.nodes, no, 12, scratch, qo, TWELVE)
    gather_lanes(motion.u, tables.nodes, no, 12, scratch, uo, TWELVE)
    put_steps(motion, tables, no, scratch, qo, uo)


@gather_ends.register(Space, Still)
@inlined
def gather_shape(dofs, motion, tables, no, scratch, qo, uo):
    gather_lanes(motion.q, tables.nodes, no, 12, scratch, qo, TWELVE)
    copy_lanes(scratch, qo, 96, scratch, qo + 96)


@gather_ends.register(Space, Resting)
@inlined
def gather_resting(dofs, motion, tables, no, scratch, qo, uo):
    gather_lanes(motion.u, tables.nodes, no, 12, scratch, uo, TWELVE)
    gather_shape(dofs, motion, tables, no, scratch, qo, uo)


@inlined
def put_planar_step(scratch, qo, uo, move, h):
    """Run `put_step` for a vector in a plane."""
    x = vld2(scratch, qo, 8)
    vst2(scratch, qo + 32, 8, x + move)
    vst2(scratch, qo, 8, x + 0.5 * move)
    vst2(scratch, uo, 8, (2.0 / (h * h)) * (move - h * vld2(scratch, uo, 8)))


@gather_ends.register(Plane, OverStep)
@inlined
def gather_planar_step(dofs, motion, tables, no, scratch, qo, uo):
    e = qo + 32
    gather_lanes(motion.q, tables.nodes, no, 4, scratch, qo, FOUR)
    gather_lanes(motion.dphi, tables.nodes, no, 2, scratch, e, TWO)
    gather_lanes(motion.increment.theta, tables.nodes, no, 1, scratch, e + 16, ONE)
    gather_lanes(motion.v, tables.nodes, no, 4, scratch, uo, FOUR)
    move = vld2(scratch, e, 8)
    t = vld(scratch, e + 16, 0)
    u = vld2(scratch, qo + 16, 8)
    put_planar_step(scratch, qo, uo, move, motion.h)
    put_planar_step(scratch, qo + 16, uo + 16, planar_turn(t, u), motion.h)


@gather_ends.register(Plane, Still)
@inlined
def gather_planar_shape(dofs, motion, tables, no, scratch, qo, uo):
    gather_lanes(motion.q, tables.nodes, no, 4, scratch, qo, FOUR)
    copy_lanes(scratch, qo, 32, scratch, qo + 32)


# --- the last increment -------------------------------------------------------------------------------------------------
@needs_increment.register(object)
@inlined
def needs_increment_after_start(motion):
    return motion.increment.control[0] != FROM_START


@needs_increment.register(ToEnd)
@kernel
def always_needs_increment(motion):
    return True


@generic
def put_before(off, scratch, tables, no, lo, position, step):
    """Store the position of 8 nodes before the increment `step` in lanes at lo; off: `state.LastIncrement.off`."""


@put_before.register(NoTies)
@inlined
def put_before_step(off, scratch, tables, no, lo, position, step):
    vst3(scratch, lo, 8, position - step)


@put_before.register(object)
@inlined
def put_before_step_of_tied(off, scratch, tables, no, lo, position, step):
    gather_lanes(off, tables.nodes, no, 3, scratch, lo, THREE)
    vst3(scratch, lo, 8, position - vld3(scratch, lo, 8) - step)


@gather_increment.register(Space)
@inlined
def gather_increment_in_space(dofs, motion, tables, no, scratch, end, lo):
    increment = motion.increment
    s = lo + 96
    gather_lanes(increment.x, tables.rows, no, 8, scratch, s, SIX)
    gather_lanes(increment.theta, tables.nodes, no, 3, scratch, lo, THREE)
    spin = vld3(scratch, s + 24, 8)
    y, g = turned_back(dot(spin, spin), dot(vld3(scratch, lo, 8), spin))
    put_before.call(increment.off, scratch, tables, no, lo, vld3(scratch, end, 8), vld3(scratch, s, 8))
    for i in range(24, 96, 24):
        d = vld3(scratch, end + i, 8)
        x = cross(spin, d)
        d += g * (0.5 * cross(spin, x) - y * x)
        vst3(scratch, s + i, 8, cross(spin, d))
        vst3(scratch, lo + i, 8, d)


@gather_increment.register(Space, ToEnd)
@inlined
def gather_increment_to_end(dofs, motion, tables, no, scratch, end, lo):
    """Gather the last increment; before the first increment of a step its start, and zero for the increment."""
    if motion.increment.control[0] == FROM_START:
        gather_lanes(motion.q, tables.nodes, no, 12, scratch, lo, TWELVE)
        clear_lanes(scratch, lo + 96, 96)
    else:
        gather_increment_in_space(dofs, motion, tables, no, scratch, end, lo)


@generic
def put_planar_before(off, scratch, tables, no, lo, position, step):
    """Run `put_before` in a plane."""


@put_planar_before.register(NoTies)
@inlined
def put_planar_before_step(off, scratch, tables, no, lo, position, step):
    vst2(scratch, lo, 8, position - step)


@put_planar_before.register(object)
@inlined
def put_planar_before_step_of_tied(off, scratch, tables, no, lo, position, step):
    gather_lanes(off, tables.nodes, no, 2, scratch, lo, TWO)
    vst2(scratch, lo, 8, position - vld2(scratch, lo, 8) - step)


@gather_increment.register(Plane)
@inlined
def gather_planar_increment(dofs, motion, tables, no, scratch, end, lo):
    increment = motion.increment
    s = lo + 32
    gather_lanes(increment.x, tables.rows, no, 8, scratch, s, THREE)
    gather_lanes(increment.theta, tables.nodes, no, 1, scratch, lo, ONE)
    spin = vld(scratch, s + 16, 0)
    y, g = turned_back(spin * spin, vld(scratch, lo, 0) * spin)
    put_planar_before.call(increment.off, scratch, tables, no, lo, vld2(scratch, end, 8), vld2(scratch, s, 8))
    d = vld2(scratch, end + 16, 8)
    d -= (g * spin) * (y * perp(d) + (0.5 * spin) * d)
    vst2(scratch, s + 16, 8, spin * perp(d))
    vst2(scratch, lo + 16, 8, d)


# --- spins of generalised alpha -----------------------------------------------------------------------------------------
@gather_spin_rates.register(object)
@inlined
def gather_no_spin_rates(motion, tables, no, nn, scratch, at):
    pass


@gather_spin_rates.register(ToEnd)
@kernel
def gather_rates_of_spins(motion, tables, no, nn, scratch, at):
    for a in range(nn):
        gather_lanes(motion.spin_rate, tables.nodes, no + 8 * a, 18, scratch, at + 144 * a, EIGHTEEN)
