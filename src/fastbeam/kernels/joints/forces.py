"""Springs, dampers, motors and elastic stops on coordinates of joints with axes, theory.md 4.

x is a coordinate of joints/coordinates.py, zero at t = 0. A spring, a damper and a motor give the force

    G = -k ((x_n + x_n+1)/2 - x_rest) - c Dx/h + F,     F the mean of a force of time over the step                      (4.14)

on it, whose work is G Dx, so that the energy changes by exactly that. Elastic stops add minus the divided difference of their
energy to G. The spring of a swing x between two axes has the energy k x^2/2 = k u(w), w = 1 - cos x: its force is the divided
difference of that, (4.32), from the series of u where axes are close. Forces that are unknowns, of prescribed coordinates and of
friction, stand in joints/drives.py.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.contact.slider_forces import stop_force
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.joints.coordinates import (
    LINE,
    LOSS,
    SWING,
    VALUE,
    WORK,
    JointMotion,
    gradient_at_rest,
    gradient_in_step,
    gradient_of,
    parts_of,
    push,
    push_parts,
    value_of,
)
from fastbeam.kernels.terms import Conserving, Equilibrium, account, assemble, put_loads, spread_nodes

# 1 - cos x of a swing up to which its spring is taken from the series, and its terms: 2^n/(n^2 (2n over n))
SMALL_SWING = 0.02
SWING_SERIES = (1.0, 1.0 / 6.0, 2.0 / 45.0, 1.0 / 70.0, 8.0 / 1575.0, 4.0 / 2079.0, 16.0 / 21021.0, 1.0 / 3217.5)


class JointForces(NamedTuple):
    """Term that applies the forces of joint coordinates, if there are any."""

    motion: JointMotion


class JointStops(NamedTuple):
    """Elastic stops of D coordinates."""

    motion: JointMotion
    which: np.ndarray      # int64 [D]: of the coordinates of `motion`
    stops: np.ndarray      # float64 [D, 3]: where they begin, m or rad, as values of the coordinate; stiffness, N/m or N m/rad


class MotorSchedule(NamedTuple):
    """Forces of motors in every substep."""

    motion: JointMotion
    given: np.ndarray      # float64 [substeps, C]


@put_loads.register(MotorSchedule)
@kernel
def put_motors(term, system, k):
    for c in range(term.given.shape[1]):
        term.motion.given[c] = term.given[k, c]


@kernel
def swing_slope(w0, w1):
    """Return the divided difference of u from w0 to w1, both small, and its derivative by w1."""
    share, slope, power, found, bent = 0.0, 0.0, 1.0, 0.0, 0.0
    for n in range(len(SWING_SERIES)):
        # divided difference of w^(n+1), and its derivative by w1
        slope = share + w1 * slope
        share = w1 * share + power
        power *= w0
        found += SWING_SERIES[n] * share
        bent += SWING_SERIES[n] * slope
    return found, bent


@kernel
def push_swing(motion, c, system, q0, q1):
    """Add the force of the spring of coordinate c, a swing, from one shape to another, q0, q1 [12 N]."""
    k = motion.stiffness[c]
    z0, z1 = parts_of(motion, c, system.dofs, q0).z, parts_of(motion, c, system.dofs, q1).z
    if max(1.0 - z0, 1.0 - z1) < SMALL_SWING:
        found, bent = swing_slope(1.0 - z0, 1.0 - z1)
        push_parts(motion, c, system, 0.0, k * found, (0.0, 0.0, 0.0, -k * bent))
    else:
        x0, x1 = value_of(motion, c, system.dofs, q0, 0.0), value_of(motion, c, system.dofs, q1, 0.0)
        gradient = gradient_of(motion, c, system.dofs, q0, q1)
        push(motion, c, system, gradient, -0.5 * k * (x0 + x1), -0.5 * k)


@assemble.register(JointForces, Conserving)
@kernel
def assemble_joint_forces(term, method, system, h):
    motion = term.motion
    for c in range(motion.node.shape[0]):
        if motion.kind[c] == SWING:
            if motion.stiffness[c] > 0.0:
                push_swing(motion, c, system, system.state.q, system.work.q_end)
            continue
        slope = -0.5 * motion.stiffness[c] - motion.damping[c] / h
        before = system.state.history[motion.place[c] + VALUE]
        gradient = gradient_in_step(motion, c, system)
        force = motion.given[c] - motion.stiffness[c] * (before - motion.rest[c])
        force += slope * way_of(motion, c, system, gradient, before)
        push(motion, c, system, gradient, force, slope)


@kernel
def way_of(motion, c, system, gradient, before):
    """Return the increment of coordinate c in this step; `before` is its value in the history."""
    return value_of(motion, c, system.dofs, system.work.q_end, 0.0) - before if motion.kind[c] == LINE else gradient.way


@assemble.register(JointForces, Equilibrium)
@kernel
def assemble_joint_forces_at_rest(term, method, system, h):
    """Add forces at one shape and half their derivative."""
    motion, work = term.motion, system.work
    for c in range(motion.node.shape[0]):
        k = motion.stiffness[c]
        if motion.kind[c] == SWING:
            if k > 0.0:
                push_swing(motion, c, system, work.q_end, work.q_end)
            continue
        value = value_of(motion, c, system.dofs, work.q_end, system.state.history[motion.place[c] + VALUE])
        push(motion, c, system, gradient_at_rest(motion, c, system), motion.given[c] - k * (value - motion.rest[c]), -0.5 * k)


@assemble.register(JointStops, Conserving)
@kernel
def assemble_stops(term, method, system, h):
    motion = term.motion
    for i in range(term.which.shape[0]):
        c = term.which[i]
        before = system.state.history[motion.place[c] + VALUE]
        gradient = gradient_in_step(motion, c, system)
        found = stop_force(term, i, before, before + way_of(motion, c, system, gradient, before))
        if found.value != 0.0:
            push(motion, c, system, gradient, found.value, found.slope)


@assemble.register(JointStops, Equilibrium)
@kernel
def assemble_stops_at_rest(term, method, system, h):
    motion = term.motion
    for i in range(term.which.shape[0]):
        c = term.which[i]
        value = value_of(motion, c, system.dofs, system.work.q_end, system.state.history[motion.place[c] + VALUE])
        found = stop_force(term, i, value, value)
        if found.value != 0.0:
            push(motion, c, system, gradient_at_rest(motion, c, system), found.value, found.slope)


@account.register(JointMotion)
@kernel
def account_motion(motion, system, h):
    """Record coordinates at the end of the step, losses of dampers and work of motors."""
    state, work, dofs = system.state, system.work, system.dofs
    for c in range(motion.node.shape[0]):
        for side in range(2):
            # update the nodes to the last increment
            node = motion.node[c, side]
            spread_nodes.call(dofs, system.method, state, work, h, node, node + 1)
        o = motion.place[c]
        before = state.history[o + VALUE]
        value = value_of(motion, c, dofs, work.q_end, before)
        state.history[o + VALUE] = value
        state.history[o + LOSS] += motion.damping[c] * (value - before)**2 / h
        state.history[o + WORK] += motion.given[c] * (value - before)
