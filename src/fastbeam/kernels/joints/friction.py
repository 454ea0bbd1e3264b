"""Friction and rigid stops of coordinates of joints with axes, theory.md 4: forces that are unknowns, as in joints/drives.py.

    |G| <= G_max: x_n+1 = x_n + rest where it sticks, G = -sign G_max where it slips                                    (4.17)

Which of the two holds is decided as for sliders (contact/slider_forces.py): the sign is that of the velocity at the end of the
step, rest half the increment of a step that goes on with the velocity at its start, zero if that is zero; a force that would put
energy in is rejected. G_max may grow with the forces of the joint, (4.31): its derivatives go to the columns of those forces. A
coordinate at rest against a rigid stop sticks as long as the stop would not have to pull. The step in which it reaches the stop
is shortened (bounds.py), and the velocity jumps (velocity_jumps.py).

Arrays: counts_out [4 or 5].
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import Plane, Space, put, vector
from fastbeam.kernels.algebra.vectors import dot, ld3
from fastbeam.kernels.contact.coulomb import (
    Attempt,
    Coulomb,
    begin_coulomb,
    begin_iteration,
    breaks_loose,
    count_missed,
    is_soft,
    judge,
    note_change,
    obeys,
)
from fastbeam.kernels.contact.point_entries import begin_joint, take_forces_of
from fastbeam.kernels.contact.slider import END_SLACK
from fastbeam.kernels.contact.slider_forces import ROUND_OFF, begin_sides, crosses, sides_stay
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.joints.conditions import direction
from fastbeam.kernels.joints.coordinates import LINE, VALUE, JointMotion, gradient_in_step, missing, push, put_entries, rate_of
from fastbeam.kernels.joints.drives import is_held
from fastbeam.kernels.terms import (
    Conserving,
    WithContact,
    account,
    assemble,
    first_guess,
    is_settled,
    take_unknowns,
    within_limits,
)

# numbers of a coordinate with friction or rigid stops in `State.history`: sign of its velocity; 1 where it sticks since
# the last step, 2 since one before; energy lost to friction, J; -1 or 1 where it rests against its first or last stop,
# else 0; energy lost in impacts, J
RUB = 5
SIGN, STICKS, RUBBED, AGAINST, STOP_LOSS = range(RUB)
# increment, rad or a share of the size of the scene, below which a coordinate that sticks is at rest
LEFT = 1e-12


class JointFriction(NamedTuple):
    """D coordinates with Coulomb friction or rigid stops."""

    motion: JointMotion
    which: np.ndarray      # int64 [D]: of the coordinates of `motion`
    limit: np.ndarray      # float64 [D]: part of the largest force that does not depend on joint forces, N or N m
    share: np.ndarray      # float64 [D, 2]: largest force for each N across the axis, and for each N m, 1, m or 1/m
    press: np.ndarray      # int64 [D, 2]: constraints with these forces and moments of the joint, -1: none
    across: np.ndarray     # int64 [D]: node with the axis d_1 that counts for the forces, -1: that of the joint
    smoothing: np.ndarray  # float64 [D]: m/s or rad/s, above 0: tanh(rate/smoothing) in place of the sign; 0: Coulomb's law
    given: np.ndarray      # int64 [D]: 1 where its motion is prescribed
    stops: np.ndarray      # float64 [D, 2]: values at rigid stops, m or rad, infinite where there is none
    place: np.ndarray      # int64 [D]: offset of their numbers in the history
    first: np.ndarray      # int64 [1]: number of the first among all constraints
    start: np.ndarray      # float64 [D]: value at the start of the step, m or rad
    reached: np.ndarray    # float64 [D]: value at the end of the last step that was solved for, m or rad
    factor: np.ndarray     # float64 [D]: friction as a share of the largest in this iteration, 0 where it sticks
    coulomb: Coulomb       # of D coordinates
    rub_side: np.ndarray   # int64 [D, LAST]: of smoothed friction, as of `slider_forces.Along`
    clock: np.ndarray      # float64 [1]: size of the step, s
    ties: Any              # ties.Ties, planar_nodes.PlanarTies or NoTies


JointFriction.reads = WithContact  # type: ignore[attr-defined]


@kernel
def has_friction(term, i):
    return term.limit[i] > 0.0 or term.share[i, 0] > 0.0


@kernel
def may_stick(term, i):
    """Return whether the slip direction is an unknown: with friction, and at rest against a stop. Otherwise the coordinate moves
    freely between its stops, or friction is a function of its increment."""
    return has_friction(term, i) and not follows_motion(term, i) or term.coulomb.against[i] != 0


@kernel
def follows_motion(term, i):
    """Return whether friction is a function of the increment."""
    return term.smoothing[i] > 0.0 or term.given[i] != 0


@kernel
def rub_with_motion(term, i, way, system):
    """Return friction that is a function of the increment, as a share of the largest, and its derivative. A prescribed motion
    rests if its increment is round-off."""
    if term.smoothing[i] > 0.0:
        unit = term.clock[0] * term.smoothing[i]
        factor = np.tanh(way / unit)
        return -factor, (factor * factor - 1.0) / unit
    if abs(way) <= least_increment(term, i, system):
        return 0.0, 0.0
    return -1.0 * np.sign(way * term.clock[0]), 0.0


@kernel
def least_increment(term, i, system):
    """Return the increment of coordinate i below which it is at rest, m or rad."""
    return LEFT * (system.length if term.motion.kind[term.which[i]] == LINE else 1.0)


@generic
def across_axis(dofs, term, i, system, force):
    """Return the part across the axis of coordinate i of the force of a joint that fixes a point."""


@across_axis.register(Space)
@kernel
def across_axis_in_space(dofs, term, i, system, force):
    if term.across[i] >= 0:
        axis = ld3(system.work.q_mid, 12 * term.across[i] + 3, 1)
    else:
        axis = direction.call(dofs, term.motion, term.which[i], 0, 0, system.work.q_mid)
    return force - (dot(force, axis) / dot(axis, axis)) * axis


@across_axis.register(Plane)
@kernel
def across_axis_in_plane(dofs, term, i, system, force):
    return 1.0 * force


@kernel
def load_pressing(term, i, system, j):
    """Store forces (j = 0) or moments (1) that press on the sides of coordinate i in `hold`; return their number and their
    size."""
    motion, contact, force = term.motion, system.contact, system.state.force
    c, k = term.which[i], term.press[i, j]
    first = contact.first_force[k]
    # moments across the axis come first
    n = contact.forces[k] if j == 0 else min(contact.forces[k], 2)
    if j == 0 and (motion.kind[c] != LINE or term.across[i] >= 0):
        put(motion.hold, 0, 1, across_axis.call(system.dofs, term, i, system, vector(force, first, 1, system.dofs)))
    else:
        for p in range(n):
            motion.hold[p] = force[first + p]
    size = 0.0
    for p in range(n):
        size += motion.hold[p] * motion.hold[p]
    return n, np.sqrt(size)


@kernel
def most_of_friction(term, i, system):
    """Return the largest friction of coordinate i under the forces of this iteration, (4.31), N or N m."""
    most = term.limit[i]
    for j in range(2):
        if term.share[i, j] > 0.0 and term.press[i, j] >= 0:
            most += term.share[i, j] * load_pressing(term, i, system, j)[1]
    return most


@kernel
def put_pressing(term, i, system, factor):
    """Store derivatives of the friction, `factor` times the largest, by the forces that press: in the columns of these."""
    for j in range(2):
        if not term.share[i, j] > 0.0 or term.press[i, j] < 0:
            continue
        n, size = load_pressing(term, i, system, j)
        for p in range(n if size > 0.0 else 0):
            put_entries(term, term.which[i], system, term.press[i, j], p,
                        factor * term.share[i, j] * (term.motion.hold[p] / size), 0.0)


@first_guess.register(JointFriction)
@kernel
def begin_friction(term, system, h, c):
    """Find from the velocities which coordinates may come to rest."""
    motion, state = term.motion, system.state
    term.clock[0] = h
    begin_sides(term.rub_side)
    # a coordinate that stopped while others moved keeps a little velocity that changes sign every step; it is removed
    # once for each time that it comes to rest: in every step that would be a creep
    stopped = False
    for i in range(term.which.shape[0]):
        stopped = stopped or state.history[term.place[i] + STICKS] == 1.0
    for i in range(term.which.shape[0]):
        system.contact.before[term.first[0] + i] = np.inf
        term.start[i] = state.history[motion.place[term.which[i]] + VALUE]
        sign, against = int(state.history[term.place[i] + SIGN]), int(state.history[term.place[i] + AGAINST])
        begin_coulomb(term.coulomb, i, sign, against)
        rest = 0.5 * h * rate_of(motion, term.which[i], system.dofs, state.q, state.v)
        if sign == 0 and (not stopped or abs(rest) <= least_increment(term, i, system) or against != 0):
            rest = 0.0
        term.coulomb.rest[i] = rest


@kernel
def rub_by_coulomb(term, i, system, way, most, force):
    """Return friction by Coulomb's law as a share of the largest, and the derivative of the force by the increment where friction
    is below the bound. force: of the last iteration."""
    coulomb, increment, h = term.coulomb, system.work.increment, term.clock[0]
    begin_iteration(coulomb, i, increment)
    least = ROUND_OFF / LEFT * least_increment(term, i, system)
    judge(coulomb, i, increment, h, Attempt(way, way - coulomb.rest[i], force, most, 0.0, least))
    if coulomb.sign[i] != 0 and is_soft(coulomb, i):
        soft = coulomb.compliance[i] if h > 0.0 else -coulomb.compliance[i]
        return -way / (soft * most), -1.0 / soft
    return -1.0 * coulomb.sign[i], 0.0


@assemble.register(JointFriction, Conserving)
@kernel
def assemble_friction(term, method, system, h):
    motion, contact, force, coulomb = term.motion, system.contact, system.state.force, term.coulomb
    for i in range(term.which.shape[0]):
        c = term.which[i]
        k = term.first[0] + i
        f = contact.first_force[k]
        way = missing(motion, c, system.dofs, system.work.q_end, term.start[i])
        if coulomb.sign[i] == 0 and coulomb.judged[i] > 0:
            coulomb.found[i] = contact.compliance[k]
        begin_joint(contact, k, 1)
        most, factor, slope, by_load, sticks = 0.0, 0.0, 0.0, 0.0, False
        if follows_motion(term, i):
            most = most_of_friction(term, i, system)
            factor, slope = rub_with_motion(term, i, way, system)
            by_load = factor
            unit = term.clock[0] * term.smoothing[i]
            if term.given[i] == 0 and crosses(term.rub_side, i, way / unit, False):
                factor, slope, by_load = -way / unit, -1.0 / unit, 0.0
            slope *= most
        elif may_stick(term, i):
            most = most_of_friction(term, i, system)
            factor, slope = rub_by_coulomb(term, i, system, way, most, force[f])
            sticks = coulomb.sign[i] == 0
            # friction below the bound does not depend on the bound
            by_load = factor if slope == 0.0 else 0.0
        term.factor[i] = factor
        if not sticks:
            force[f] = factor * most
        push(motion, c, system, gradient_in_step(motion, c, system), force[f], slope)
        put_entries(term, c, system, k, 0, 1.0 if sticks else 0.0, 1.0 if sticks else 0.0)
        if sticks:
            contact.residual[k, 0] = way - coulomb.rest[i]
        else:
            # the force is known and stays
            contact.residual[k, 0] = 0.0
            contact.corner[k, 0] = 1.0
            put_pressing(term, i, system, by_load)


@is_settled.register(JointFriction)
@kernel
def friction_is_settled(term, system):
    """Return True if slip directions were evaluated in this step and friction dissipates; otherwise let the slip increment decide
    the direction."""
    settled = sides_stay(term.rub_side)
    coulomb = term.coulomb
    for i in range(term.which.shape[0]):
        if not may_stick(term, i):
            continue
        c = term.which[i]
        k = term.first[0] + i
        force = system.state.force[system.contact.first_force[k]]
        breaks = False
        if coulomb.sign[i] == 0:
            settled = is_held(term.motion, c, system, k) and settled
            # the coordinate slips: the next iteration takes the other branch
            breaks = breaks_loose(coulomb, i, force, most_of_friction(term, i, system) * (1.0 + 1e-12)) != 0
        way = missing(term.motion, c, system.dofs, system.work.q_end, term.start[i])
        settled = obeys(coulomb, i, system.work.increment, term.clock[0], way, force, breaks) and settled
    note_change(not settled, system.work.increment)
    return settled


@account.register(JointFriction)
@kernel
def account_friction(term, system, h):
    """Record the loss by friction, and which coordinates are at rest: their value is that at the start, to the last bit."""
    history = system.state.history
    for i in range(term.which.shape[0]):
        o = term.motion.place[term.which[i]]
        f = system.contact.first_force[term.first[0] + i]
        if term.smoothing[i] > 0.0:
            # the last increment has changed the friction
            factor = rub_with_motion(term, i, history[o + VALUE] - term.start[i], system)[0]
            system.state.force[f] = factor * most_of_friction(term, i, system)
        force = system.state.force[f]
        if may_stick(term, i):
            sticks = term.coulomb.sign[i] == 0
            if sticks:
                history[o + VALUE] = term.start[i] + term.coulomb.rest[i]
            else:
                history[term.place[i] + AGAINST] = 0.0
            count_missed(term.coulomb, i)
            history[term.place[i] + SIGN] = term.coulomb.sign[i]
            held = 1.0 if history[term.place[i] + STICKS] == 0.0 else 2.0
            history[term.place[i] + STICKS] = held if sticks and term.coulomb.against[i] == 0 else 0.0
        if has_friction(term, i) or term.coulomb.against[i] != 0:
            history[term.place[i] + RUBBED] -= force * (history[o + VALUE] - term.start[i])
        term.reached[i] = history[o + VALUE]


@within_limits.register(JointFriction)
@kernel
def joints_are_within(term, system, counts_out):
    """Return whether all coordinates are within rigid stops, to round-off; the number of one that is not, behind the sliders,
    goes to counts_out[3]."""
    for i in range(term.which.shape[0]):
        slack = END_SLACK * (system.length if term.motion.kind[term.which[i]] == LINE else 1.0)
        if not (term.reached[i] >= term.stops[i, 0] - slack and term.reached[i] <= term.stops[i, 1] + slack):
            counts_out[3] = system.state.s.shape[0] + i
            return False
    return True


@take_unknowns.register(JointFriction)
@kernel
def take_friction(term, system):
    """Update load-dependent friction; joint forces have been updated before."""
    take_forces_of(term.first[0], term.which.shape[0], system)
    for i in range(term.which.shape[0]):
        if term.share[i, 0] > 0.0 and term.factor[i] != 0.0:
            k = term.first[0] + i
            system.state.force[system.contact.first_force[k]] = term.factor[i] * most_of_friction(term, i, system)
