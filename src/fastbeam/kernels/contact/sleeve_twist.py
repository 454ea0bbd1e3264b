"""Friction of beams that turn in unkeyed sleeves, theory.md 5.8.

The moment mu_23 of such a sleeve is friction and fixes nothing. Its condition (5.8) is taken with D_2 and D_3 turned to the
section by an angle that is constant in the step: h = (D_2* . d_3(s) - D_3* . d_2(s))/2 = sin(x - x*), x the angle of the section
in the sleeve, so that the moment does exactly the work mu_23 Dh, whatever the step. With x* = x_n + rest and rest = h x'_n/2, the
one increment that leaves the section at rest,

    it sticks   h = 0 at the end of the step, |mu_23| <= mu r F_n
    it slips    mu_23 Dh = -sign mu r F_n Dx,   sign that of the velocity at the end of the step, which is that of h      (5.14)

Which of the two holds is decided as for joints (joints/drives.py): anew in every iteration, never putting energy in. F_n is that
of the last iteration.

Arrays: q, v [12 N]; basis [5, n] as `Contact.basis`.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import vector, zero_vector
from fastbeam.kernels.algebra.vectors import dot
from fastbeam.kernels.contact.coulomb import (
    Attempt,
    Coulomb,
    begin_coulomb,
    begin_iteration,
    count_missed,
    is_soft,
    judge,
    note_change,
    obeys,
)
from fastbeam.kernels.contact.curves import find_element, node_of, slot
from fastbeam.kernels.contact.held_directors import director, holder_director, twist_between
from fastbeam.kernels.contact.sleeve import account_twist, begin_twist, twist_is_settled, twist_rubs
from fastbeam.kernels.contact.slider import begin_passage, motion_along
from fastbeam.kernels.contact.slider_forces import FRICTION_LOSS, HISTORY, ROUND_OFF, force_of_edges, lead_passage
from fastbeam.kernels.jit.decorators import kernel

# numbers of a sleeve that rubs in `State.history`: angle of the section in it, rad, against d_2, d_3 at t = 0 with h = sin(x);
# sign of its velocity; 1 where friction holds it since a step before; the largest moment of friction in the last step, N m
TWIST = 4
ANGLE, SIGN, STICKS, MOST = range(TWIST)
# increment, rad, below which a section that sticks is at rest
LEFT = 1e-12
# share of the found compliance in whose unit rows of known moments are written; it has to be the smaller one
UNIT = 1e-3
# Dh up to which (x* in the middle of the step) Dx/Dh is taken from its series
SHORT_WAY = 1e-4


class Twist(NamedTuple):
    """Friction of twists in O sleeves, some of which rub on beams that turn in them."""

    arm: np.ndarray     # float64 [O]: coefficient of friction times the radius at which sleeves rub, m; 0 without friction
    place: np.ndarray   # int64 [O]: offset of their numbers in the history
    axes: np.ndarray    # float64 [9 O]: `Sleeves.axes` at t = 0; those of `Sleeves` turn
    start: np.ndarray   # float64 [O]: angle at the start of the step, rad
    way: np.ndarray     # float64 [O]: Dh of the last iteration
    most: np.ndarray    # float64 [O]: largest moment of friction in the last iteration, N m
    before: np.ndarray  # float64 [2 O]: moment and largest moment of the step before where it stuck, N m
    coulomb: Coulomb    # of O sleeves
    clock: np.ndarray   # float64 [1]: size of the step, s


@kernel
def aim(twist, sleeves, o, angle):
    """Turn D_2 and D_3 of sleeve o to a section at this angle."""
    c, s = np.cos(angle), np.sin(angle)
    for i in range(9 * o + 3, 9 * o + 6):
        sleeves.axes[i] = c * twist.axes[i] - s * twist.axes[i + 3]
        sleeves.axes[i + 3] = s * twist.axes[i] + c * twist.axes[i + 3]


@kernel
def most_of_twist(twist, sleeves, term, system, k, o):
    """Return the largest moment of friction, N m."""
    dofs = system.dofs
    force = vector(system.state.force, system.contact.first_force[k], 1, dofs)
    axis = holder_director.call(dofs, sleeves, o, 0, system.work.q_mid, term.sliders.point[k])
    across = force - (dot(force, axis) / dot(axis, axis)) * axis
    return twist.arm[o] * (np.sqrt(dot(across, across)) + force_of_edges.call(sleeves, system, k))


@kernel
def angle_per_way(start, end):
    """Return Dx/Dh of a step, for h at its start and at its end: friction does the work mu r F_n Dx."""
    way = end - start
    if abs(way) < SHORT_WAY or abs(start) >= 1.0 or abs(end) >= 1.0:
        return 1.0 + way * way / 24.0
    return (np.arcsin(end) - np.arcsin(start)) / way


@kernel
def section_of(basis, row, dofs, q, nodes, lo, hi, j):
    """Return d_j + 1 of the section over lo to before hi of `nodes_of` a curve, with the shape functions of a row of basis."""
    out = zero_vector(dofs)
    for a in range(lo, hi):
        out += basis[row, slot.call(nodes, a)] * director.call(dofs, q, node_of.call(nodes, a), j)
    return out


@kernel
def sine_of_section(sleeves, o, point, basis, row, dofs, q, nodes, lo, hi):
    """Return h, the sine of the angle from D_2*, D_3* to the section, at coordinates q."""
    second = section_of(basis, row, dofs, q, nodes, lo, hi, 1)
    third = section_of(basis, row, dofs, q, nodes, lo, hi, 2)
    return twist_between(holder_director.call(dofs, sleeves, o, 1, q, point), holder_director.call(dofs, sleeves, o, 2, q, point),
                         second, third)


@kernel
def cosine_of_section(sleeves, o, point, basis, row, dofs, q, nodes, lo, hi):
    """Return (D_2* . d_2 + D_3* . d_3)/2 at coordinates q."""
    key = holder_director.call(dofs, sleeves, o, 1, q, point)
    side = holder_director.call(dofs, sleeves, o, 2, q, point)
    return 0.5 * (dot(key, section_of(basis, row, dofs, q, nodes, lo, hi, 1))
                  + dot(side, section_of(basis, row, dofs, q, nodes, lo, hi, 2)))


@begin_twist.register(Twist)
@kernel
def begin_rubbing(twist, sleeves, term, system, h):
    """Find from the velocities which sections may come to rest."""
    state = system.state
    twist.clock[0] = h
    for k in range(state.s.shape[0]):
        o = sleeves.of_slider[k]
        if o < 0 or not twist.arm[o] > 0.0:
            continue
        twist.start[o] = state.history[twist.place[o] + ANGLE]
        sign = int(state.history[twist.place[o] + SIGN])
        begin_coulomb(twist.coulomb, o, sign, 0)
        sticks = 1.0 if state.history[twist.place[o] + STICKS] != 0.0 else 0.0
        twist.before[2 * o] = sticks * state.force[system.contact.first_force[sleeves.first[0] + o] + 2]
        twist.before[2 * o + 1] = sticks * state.history[twist.place[o] + MOST]
        aim(twist, sleeves, o, twist.start[o])
        rest = 0.5 * h * rate_of_twist(sleeves, term, system, k, o)
        rest = rest if sign != 0 or abs(rest) > LEFT else 0.0
        twist.coulomb.rest[o] = rest
        aim(twist, sleeves, o, twist.start[o] + rest)


@kernel
def rate_of_twist(sleeves, term, system, k, o):
    """Return the velocity of the angle at the start of the step, rad/s, with D_2 and D_3 at the section."""
    state, contact, dofs = system.state, system.contact, system.dofs
    point = term.sliders.point[k]
    e = find_element.call(term.curves, term.sliders.curve[k], state.s[k], contact.element[k])
    tangent, relative = motion_along(term.curves, term.sliders, contact, state.q, state.v, state.s[k], state.history, k, e,
                                     dofs)
    along = dot(relative, tangent) / dot(tangent, tangent)
    s_end = system.work.s_end[k]
    system.work.s_end[k] = state.s[k]
    nodes, lo, hi = begin_passage(term, system, k)
    system.work.s_end[k] = s_end
    basis = contact.basis
    q, v = state.q, state.v
    second, third = section_of(basis, 0, dofs, q, nodes, lo, hi, 1), section_of(basis, 0, dofs, q, nodes, lo, hi, 2)
    moving = section_of(basis, 0, dofs, v, nodes, lo, hi, 1) + along * section_of(basis, 2, dofs, q, nodes, lo, hi, 1)
    moved = section_of(basis, 0, dofs, v, nodes, lo, hi, 2) + along * section_of(basis, 2, dofs, q, nodes, lo, hi, 2)
    key, side = holder_director.call(dofs, sleeves, o, 1, q, point), holder_director.call(dofs, sleeves, o, 2, q, point)
    turning = twist_between(holder_director.call(dofs, sleeves, o, 1, v, point),
                            holder_director.call(dofs, sleeves, o, 2, v, point), second, third)
    return 2.0 * (turning + twist_between(key, side, moving, moved)) / (dot(key, second) + dot(side, third))


@twist_rubs.register(Twist)
@kernel
def rub_section(twist, sleeves, term, system, k, o, nodes, lo, hi):
    """Decide whether the section sticks or slips, before the entries of the pair are formed. A slipping section sets moment 23 of
    the state to that of friction. Return 1 if it has a condition, 0 if the moment is known, -1 for a sleeve without friction."""
    if not twist.arm[o] > 0.0:
        return -1.0
    state, work, contact, dofs = system.state, system.work, system.contact, system.dofs
    point = term.sliders.point[k]
    c = sleeves.first[0] + o
    f = contact.first_force[c] + 2
    most = most_of_twist(twist, sleeves, term, system, k, o)
    twist.most[o] = most
    h, coulomb = twist.clock[0], twist.coulomb
    if coulomb.sign[o] == 0 and coulomb.judged[o] > 0:
        coulomb.found[o] = contact.compliance[c]
    rest = coulomb.rest[o]
    begin_iteration(coulomb, o, work.increment)
    if coulomb.rest[o] != rest:
        aim(twist, sleeves, o, twist.start[o])
    end = sine_of_section(sleeves, o, point, contact.basis, 1, dofs, work.q_end, nodes, lo, hi)
    twist.way[o] = end - sine_of_section(sleeves, o, point, contact.basis, 0, dofs, state.q, nodes, lo, hi)
    judge(coulomb, o, work.increment, h, Attempt(twist.way[o], end, state.force[f] + twist.before[2 * o], most,
                                                 twist.before[2 * o + 1], ROUND_OFF))
    contact.residual[c, 2] = end
    if coulomb.sign[o] == 0:
        return 1.0
    if is_soft(coulomb, o):
        soft = coulomb.compliance[o] if h > 0.0 else -coulomb.compliance[o]
        contact.corner[c, 18] = soft
        contact.residual[c, 2] = end + soft * state.force[f]
        return 1.0
    state.force[f] = -coulomb.sign[o] * most * angle_per_way(end - twist.way[o], end)
    contact.residual[c, 2] = 0.0
    # a compliance kept from the step before would not be part of the state
    contact.corner[c, 18] = UNIT * contact.compliance[c] if coulomb.judged[o] > 1 and contact.compliance[c] > 0.0 else 1.0
    return 0.0


@twist_is_settled.register(Twist)
@kernel
def twist_takes_energy(twist, sleeves, system):
    """Return True if slip directions were evaluated in this step and friction dissipates; otherwise let the slip increment decide
    the direction."""
    settled = True
    for o in range(twist.arm.shape[0]):
        if not twist.arm[o] > 0.0:
            continue
        moment = system.state.force[system.contact.first_force[sleeves.first[0] + o] + 2]
        bound = (twist.most[o] + twist.before[2 * o + 1]) * (1.0 + 1e-12)
        # the section slips: the next iteration takes the other branch
        breaks = twist.coulomb.sign[o] == 0 and abs(moment + twist.before[2 * o]) > bound
        rest = twist.coulomb.rest[o]
        settled = obeys(twist.coulomb, o, system.work.increment, twist.clock[0], twist.way[o], moment, breaks) and settled
        if twist.coulomb.rest[o] != rest:
            aim(twist, sleeves, o, twist.start[o])
    note_change(not settled, system.work.increment)
    return settled


@account_twist.register(Twist)
@kernel
def account_rubbing(twist, sleeves, term, system, h):
    """Record the loss by friction, and the angle: a section that sticks keeps that at the start, to the last bit."""
    state, work, contact, dofs = system.state, system.work, system.contact, system.dofs
    for k in range(state.s.shape[0]):
        o = sleeves.of_slider[k]
        if o < 0 or not twist.arm[o] > 0.0:
            continue
        nodes, lo, hi = begin_passage(term, system, k)
        point = term.sliders.point[k]
        lead_passage(system, nodes, lo, hi, point, h)
        end = sine_of_section(sleeves, o, point, contact.basis, 1, dofs, work.q_end, nodes, lo, hi)
        way = end - sine_of_section(sleeves, o, point, contact.basis, 0, dofs, state.q, nodes, lo, hi)
        moment = state.force[contact.first_force[sleeves.first[0] + o] + 2]
        angle = twist.start[o] + twist.coulomb.rest[o]
        if twist.coulomb.sign[o] != 0:
            angle += np.arctan2(end, cosine_of_section(sleeves, o, point, contact.basis, 1, dofs, work.q_end, nodes, lo, hi))
        count_missed(twist.coulomb, o)
        own = twist.place[o]
        state.history[own + ANGLE] = angle
        state.history[own + SIGN] = twist.coulomb.sign[o]
        state.history[own + STICKS] = 1.0 if twist.coulomb.sign[o] == 0 else 0.0
        state.history[own + MOST] = twist.most[o]
        state.history[HISTORY * k + FRICTION_LOSS] -= moment * way
