"""What joints with axes leave free: angles and distances along an axis, with springs, dampers and motors on them, theory.md 4.

x is the distance r . D_1 or the angle by which b has turned against a about D_1, both zero at t = 0. With the generalised force

    G = -k ((x_n + x_n+1)/2 - x_rest) - c Dx/h + F,     F the mean of a force of time over the step                      (4.14)

a distance gets the force G D_1,mean as in joint_conditions.py. An angle gets the moment T a, a = D_1,mean, on b and the opposite
on a. As both triads keep the axis, theta_b - theta_a is parallel to a; the moments do the work T w, w = a . (theta_b - theta_a):

    T = G Dx/w,     tan(Dx/2) = p/q,  p = w/(2 a.a),  q = 1 + theta_a . theta_b/4                                       (4.15)

so that the energy changes by exactly G Dx. Dx/w is formed without division by zero. Elastic stops add minus the divided
difference of their energy to G. Forces that are unknowns, of given coordinates and of friction, stand in joint_drive.py.

Arrays: q [12 N], in a plane [4 N].
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .._generic import generic
from .._jit import kernel
from .algebra import cross, dot
from .along import stop_force
from .joint_conditions import direction, push_along
from .kinds import Plane, Space, add_to, add_turn, cayley_vector, cross_product, dim, on_spin, position, put
from .terms import Conserving, Equilibrium, account, assemble, put_loads, spread_nodes

# numbers of a coordinate in `State.history`: its value, m or rad; energy that its damper took away, work of its motor, J
MOTION = 3
VALUE, LOSS, WORK = range(MOTION)
# p/q up to which (4.15) is taken from its series
SMALL_TURN = 3e-3


class JointMotion(NamedTuple):
    """C coordinates of joints; the term that follows them."""

    node: np.ndarray       # int64 [C, 2]
    row: np.ndarray        # int64 [C, 2]
    block: np.ndarray      # int64 [C, 4]: blocks a-a, a-b, b-a, b-b
    is_angle: np.ndarray   # int64 [C]
    spin_node: np.ndarray  # int64 [C, 2]: nodes that have their spins
    axes: np.ndarray       # float64 [18 C], in a plane [12 C]: as of `JointConditions`
    value: np.ndarray      # float64 [C]: distance at t = 0, m
    place: np.ndarray      # int64 [C]: where the numbers of a coordinate stand in the history
    stiffness: np.ndarray  # float64 [C], N/m or N m/rad
    damping: np.ndarray    # float64 [C], N s/m or N m s/rad
    rest: np.ndarray       # float64 [C]: value without force of the spring, m or rad
    given: np.ndarray      # float64 [C]: mean force of the motor in a step, N or N m
    hold: np.ndarray       # float64 [32]: work


class JointForces(NamedTuple):
    """The term that applies the forces, where there are any."""

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


class Turn(NamedTuple):
    """An angle in a step."""

    angle: float           # Dx, rad
    ratio: float           # Dx/w
    lead_a: Any            # derivative of the ratio by the spins of a and b at the end
    lead_b: Any
    mid: Any               # mean axis, and that at the end; in a plane +1 or -1
    end: Any


@put_loads.register(MotorSchedule)
@kernel
def put_motors(term, system, k):
    for c in range(term.given.shape[1]):
        term.motion.given[c] = term.given[k, c]


@kernel
def angle_over(p, q):
    """atan(p/q)/p and the derivative of it by p, with p/q of any size."""
    x = p / q
    if q > 0.0 and abs(x) < SMALL_TURN:
        y = x * x
        return (1.0 - y * (1.0 / 3.0 - y * (0.2 - y / 7.0))) / q, -x * (2.0 / 3.0 - y * (0.8 - y * 6.0 / 7.0)) / (q * q)
    share = np.arctan2(p, q) / p
    return share, (q / (p * p + q * q) - share) / p


@generic
def axis_of(dofs, motion, c, q):
    """The axis of coordinate c, an angle; in a plane +1 or -1 along its normal."""


@axis_of.register(Space)
@kernel
def axis_in_space(dofs, motion, c, q):
    return direction.call(dofs, motion, c, 0, 0, q)


@axis_of.register(Plane)
@kernel
def axis_in_plane(dofs, motion, c, q):
    up = cross_product.call(direction.call(dofs, motion, c, 0, 1, q), direction.call(dofs, motion, c, 0, 2, q))
    return 1.0 if up > 0.0 else -1.0


@generic
def turn_of_step(dofs, motion, c, system):
    """The `Turn` of coordinate c."""


@turn_of_step.register(Space)
@kernel
def turn_in_space(dofs, motion, c, system):
    work = system.work
    one = cayley_vector(work.theta, motion.spin_node[c, 0], dofs)
    two = cayley_vector(work.theta, motion.spin_node[c, 1], dofs)
    mid = axis_of.call(dofs, motion, c, work.q_mid)
    end = axis_of.call(dofs, motion, c, work.q_end)
    n = dot(mid, mid)
    p = 0.5 * dot(mid, two - one) / n
    q = 1.0 + 0.25 * dot(one, two)
    share, slope = angle_over(p, q)
    dn = cross(end, mid)
    dp_a = (0.5 / n) * (0.5 * cross(end, two - one) - on_spin.call(one, mid)) - (p / n) * dn
    dp_b = (0.5 / n) * on_spin.call(two, mid)
    by_q = -0.25 / (p * p + q * q)
    lead_a = (slope / n) * dp_a + (by_q / n) * on_spin.call(one, two) - (share / (n * n)) * dn
    lead_b = (slope / n) * dp_b + (by_q / n) * on_spin.call(two, one)
    return Turn(2.0 * p * share, share / n, lead_a, lead_b, mid, end)


@turn_of_step.register(Plane)
@kernel
def turn_in_plane(dofs, motion, c, system):
    work = system.work
    one = cayley_vector(work.theta, motion.spin_node[c, 0], dofs)
    two = cayley_vector(work.theta, motion.spin_node[c, 1], dofs)
    axis = axis_of.call(dofs, motion, c, work.q_end)
    p = 0.5 * axis * (two - one)
    q = 1.0 + 0.25 * one * two
    share, slope = angle_over(p, q)
    by_q = -0.25 / (p * p + q * q)
    lead_a = -0.5 * slope * axis * on_spin.call(one, 1.0) + by_q * on_spin.call(one, two)
    lead_b = 0.5 * slope * axis * on_spin.call(two, 1.0) + by_q * on_spin.call(two, one)
    return Turn(2.0 * p * share, share, lead_a, lead_b, axis, axis)


@generic
def bend_axis(dofs, motion, c, system, moment, end):
    """Half the derivative of the moments by the end of the step, as far as the axis turns."""


@bend_axis.register(Space)
@kernel
def bend_axis_in_space(dofs, motion, c, system, moment, end):
    add_turn(system.work.blocks, 48 * motion.block[c, 2] + 27, -0.5 * moment, end)
    add_turn(system.work.blocks, 48 * motion.block[c, 0] + 27, 0.5 * moment, end)


@bend_axis.register(Plane)
@kernel
def keep_axis_in_plane(dofs, motion, c, system, moment, end):
    pass


@kernel
def value_of(motion, c, dofs, q, before):
    """Coordinate c at coordinates q; of an angle the value next to `before`."""
    if not motion.is_angle[c]:
        r = position(q, motion.node[c, 1], dofs) - position(q, motion.node[c, 0], dofs)
        return dot(r, direction.call(dofs, motion, c, 0, 0, q)) - motion.value[c]
    b = direction.call(dofs, motion, c, 1, 1, q)
    angle = np.arctan2(dot(direction.call(dofs, motion, c, 0, 2, q), b), dot(direction.call(dofs, motion, c, 0, 1, q), b))
    return angle + 2.0 * np.pi * np.floor((before - angle) / (2.0 * np.pi) + 0.5)


@kernel
def add_products(motion, c, work, factor, dofs):
    """Add factor times the products of patterns and leads in `hold` (a, then b; 8 numbers each) to the blocks of coordinate c."""
    n = len(dofs)
    for e in range(4):
        o = 8 * n * motion.block[c, e]
        row = 8 * (e // 2)
        column = 16 + 8 * (e % 2)
        for i in range(n):
            for j in range(n):
                work.blocks[o + 8 * i + j] += factor * motion.hold[row + i] * motion.hold[column + j]


@kernel
def push_distance(motion, c, system, force, slope):
    """A force along D_1 on b and the opposite on a, and its derivative `slope` by the distance at the end."""
    work, dofs = system.work, system.dofs
    d = dim(dofs)
    push_along(motion, system, c, 0, force)
    mid = direction.call(dofs, motion, c, 0, 0, work.q_mid)
    end = direction.call(dofs, motion, c, 0, 0, work.q_end)
    r_mid = position(work.q_mid, motion.node[c, 1], dofs) - position(work.q_mid, motion.node[c, 0], dofs)
    r_end = position(work.q_end, motion.node[c, 1], dofs) - position(work.q_end, motion.node[c, 0], dofs)
    for i in range(32):
        motion.hold[i] = 0.0
    put(motion.hold, 0, 1, -1.0 * mid)
    put(motion.hold, d, 1, cross_product.call(mid, r_mid))
    put(motion.hold, 8, 1, 1.0 * mid)
    put(motion.hold, 16, 1, -1.0 * end)
    put(motion.hold, 16 + d, 1, cross_product.call(end, r_end))
    put(motion.hold, 24, 1, 1.0 * end)
    add_products(motion, c, work, -slope, dofs)


@kernel
def push_angle(motion, c, system, turn, force, slope):
    """The moment force x turn.ratio along the mean axis on b and the opposite on a; slope: derivative of the force by the angle
    at the end."""
    work, dofs = system.work, system.dofs
    d = dim(dofs)
    moment = force * turn.ratio
    add_to(work.r, 8 * motion.row[c, 1] + d, 1, -moment * turn.mid)
    add_to(work.r, 8 * motion.row[c, 0] + d, 1, moment * turn.mid)
    bend_axis.call(dofs, motion, c, system, moment, turn.end)
    for i in range(32):
        motion.hold[i] = 0.0
    put(motion.hold, d, 1, -1.0 * turn.mid)
    put(motion.hold, 8 + d, 1, 1.0 * turn.mid)
    put(motion.hold, 16 + d, 1, force * turn.lead_a - slope * turn.ratio * turn.end)
    put(motion.hold, 24 + d, 1, force * turn.lead_b + slope * turn.ratio * turn.end)
    add_products(motion, c, work, -1.0, dofs)


@assemble.register(JointForces, Conserving)
@kernel
def assemble_joint_forces(term, method, system, h):
    motion, dofs = term.motion, system.dofs
    for c in range(motion.node.shape[0]):
        viscous = motion.damping[c] / h
        slope = -0.5 * motion.stiffness[c] - viscous
        before = system.state.history[motion.place[c] + VALUE]
        known = motion.given[c] - motion.stiffness[c] * (before - motion.rest[c])
        if motion.is_angle[c]:
            turn = turn_of_step.call(dofs, motion, c, system)
            push_angle(motion, c, system, turn, known + slope * turn.angle, slope)
        else:
            way = value_of(motion, c, dofs, system.work.q_end, 0.0) - before
            push_distance(motion, c, system, known + slope * way, slope)


@assemble.register(JointForces, Equilibrium)
@kernel
def assemble_joint_forces_at_rest(term, method, system, h):
    """Forces at one shape and half their derivative."""
    motion, dofs = term.motion, system.dofs
    for c in range(motion.node.shape[0]):
        k = motion.stiffness[c]
        value = value_of(motion, c, dofs, system.work.q_end, system.state.history[motion.place[c] + VALUE])
        force = motion.given[c] - k * (value - motion.rest[c])
        if motion.is_angle[c]:
            axis = axis_of.call(dofs, motion, c, system.work.q_end)
            push_angle(motion, c, system, Turn(0.0, 1.0, 0.0 * axis, 0.0 * axis, axis, axis), force, -0.5 * k)
        else:
            push_distance(motion, c, system, force, -0.5 * k)


@assemble.register(JointStops, Conserving)
@kernel
def assemble_stops(term, method, system, h):
    motion, dofs = term.motion, system.dofs
    for i in range(term.which.shape[0]):
        c = term.which[i]
        before = system.state.history[motion.place[c] + VALUE]
        if motion.is_angle[c]:
            turn = turn_of_step.call(dofs, motion, c, system)
            push = stop_force(term, i, before, before + turn.angle)
            push_angle(motion, c, system, turn, push.value, push.slope)
        else:
            push = stop_force(term, i, before, value_of(motion, c, dofs, system.work.q_end, 0.0))
            push_distance(motion, c, system, push.value, push.slope)


@assemble.register(JointStops, Equilibrium)
@kernel
def assemble_stops_at_rest(term, method, system, h):
    motion, dofs = term.motion, system.dofs
    for i in range(term.which.shape[0]):
        c = term.which[i]
        value = value_of(motion, c, dofs, system.work.q_end, system.state.history[motion.place[c] + VALUE])
        push = stop_force(term, i, value, value)
        if motion.is_angle[c]:
            axis = axis_of.call(dofs, motion, c, system.work.q_end)
            push_angle(motion, c, system, Turn(0.0, 1.0, 0.0 * axis, 0.0 * axis, axis, axis), push.value, push.slope)
        else:
            push_distance(motion, c, system, push.value, push.slope)


@account.register(JointMotion)
@kernel
def account_motion(motion, system, h):
    """Coordinates at the end of the step, what dampers take and motors put in."""
    state, work, dofs = system.state, system.work, system.dofs
    for c in range(motion.node.shape[0]):
        for side in range(2):
            # where the last increment led them
            node = motion.node[c, side]
            spread_nodes.call(dofs, system.method, state, work, h, node, node + 1)
        o = motion.place[c]
        before = state.history[o + VALUE]
        value = value_of(motion, c, dofs, work.q_end, before)
        state.history[o + VALUE] = value
        state.history[o + LOSS] += motion.damping[c] * (value - before)**2 / h
        state.history[o + WORK] += motion.given[c] * (value - before)
