"""Coordinates of joints with axes that a force of their own holds, theory.md 4: given as functions of time, and by friction.

The force G on a coordinate x acts as in joint_motion.py and does the work G Dx. It is an unknown, one more constraint, whose
equation is

    given       x_n+1 = x(t_n+1)                                                                                       (4.16)
    friction    |G| <= G_max: x_n+1 = x_n + rest where it sticks, G = -sign G_max where it slips                         (4.17)

x_n+1 of an angle is compared by the sine and cosine of what it misses, which lose no digits over many turns. Which of the two
holds for friction is decided as for sliders (along.py): the sign is that of the velocity at the end of the step, rest half the
increment of a step that goes on with the velocity at its start, zero where it stood still; a force that would put energy in is
refused.

Arrays: q, q_end, v [12 N], in a plane [4 N].
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .._generic import generic
from .._jit import kernel
from .algebra import cross, dot
from .along import JUDGED, MOST_FLIPS
from .joint_conditions import direction, put_on_end, put_spin
from .joint_entries import begin_joint, is_closed, take_forces_of
from .joint_motion import VALUE, WORK, JointMotion, axis_of, push_angle, push_distance, turn_of_step
from .kinds import Plane, Space, cross_product, dim, position
from .sleeve import SETTLED
from .terms import Conserving, account, assemble, first_guess, is_settled, put_loads, take_unknowns

# how a coordinate is given: its value at the end of the step, or its increment
TO, BY = range(2)
# numbers of a coordinate with friction in `State.history`: sign of its velocity; 1 where friction holds it since a step before;
# energy that friction took away, J
RUB = 3
# increment, rad or a share of the size of the scene, below which a coordinate that sticks is at rest
LEFT = 1e-12
SIGN, STICKS, RUBBED = range(RUB)


class JointDrives(NamedTuple):
    """D coordinates that are given."""

    motion: JointMotion
    which: np.ndarray      # int64 [D]: of the coordinates of `motion`
    kind: np.ndarray       # int64 [D]: TO or BY
    first: np.ndarray      # int64 [1]: number of the first among all constraints
    given: np.ndarray      # float64 [D]: value at the end of the step, or its increment, m or rad
    start: np.ndarray      # float64 [D]: value at the start of the step, m or rad
    ties: Any              # ties.Ties, planar_nodes.PlanarTies or NoTies


class DriveTimes(NamedTuple):
    """What they are given in every substep."""

    drives: JointDrives
    given: np.ndarray      # float64 [substeps, D]


class JointFriction(NamedTuple):
    """D coordinates with Coulomb friction of a given limit."""

    motion: JointMotion
    which: np.ndarray      # int64 [D]: of the coordinates of `motion`
    limit: np.ndarray      # float64 [D]: largest force, N or N m
    place: np.ndarray      # int64 [D]: where their numbers stand in the history
    first: np.ndarray      # int64 [1]: number of the first among all constraints
    start: np.ndarray      # float64 [D]: value at the start of the step, m or rad
    rest: np.ndarray       # float64 [D]: increment that leaves the coordinate at rest at the end of the step, m or rad
    soft: np.ndarray       # float64 [D]: compliance of what the joint joins, where it stuck last
    sign: np.ndarray       # int64 [D]: sign of the velocity at the end of the step, as taken in this iteration
    flips: np.ndarray      # int64 [D]: how often an iteration of this step has changed the sign
    judged: np.ndarray     # int64 [D]: how many iterations of this step have asked for the sign
    clock: np.ndarray      # float64 [1]: size of the step, s
    ties: Any              # ties.Ties, planar_nodes.PlanarTies or NoTies


class KnownForces(NamedTuple):
    """The same forces as they stand in the state, without equations: for reactions."""

    motion: JointMotion
    which: np.ndarray      # int64 [D]
    first: np.ndarray      # int64 [1]


@put_loads.register(DriveTimes)
@kernel
def put_given(term, system, k):
    for i in range(term.given.shape[1]):
        term.drives.given[i] = term.given[k, i]


@kernel
def missing(motion, c, dofs, q, target):
    """Coordinate c at coordinates q less `target`; of an angle the nearest of all turns."""
    if not motion.is_angle[c]:
        r = position(q, motion.node[c, 1], dofs) - position(q, motion.node[c, 0], dofs)
        return (dot(r, direction.call(dofs, motion, c, 0, 0, q)) - motion.value[c]) - target
    b = direction.call(dofs, motion, c, 1, 1, q)
    up = dot(direction.call(dofs, motion, c, 0, 2, q), b)
    along = dot(direction.call(dofs, motion, c, 0, 1, q), b)
    u, w = np.cos(target), np.sin(target)
    return np.arctan2(up * u - along * w, along * u + up * w)


@generic
def spin_about(dofs, motion, c, side, q, v):
    """Spin of node a (side 0) or b (1) about the axis of coordinate c, an angle, rad/s."""


@spin_about.register(Space)
@kernel
def spin_in_space(dofs, motion, c, side, q, v):
    spin = cross(direction.call(dofs, motion, c, side, 0, q), direction.call(dofs, motion, c, side, 0, v))
    for i in (1, 2):
        spin += cross(direction.call(dofs, motion, c, side, i, q), direction.call(dofs, motion, c, side, i, v))
    return 0.5 * dot(axis_of.call(dofs, motion, c, q), spin)


@spin_about.register(Plane)
@kernel
def spin_in_plane(dofs, motion, c, side, q, v):
    return axis_of.call(dofs, motion, c, q) * cross_product.call(direction.call(dofs, motion, c, side, 1, q),
                                                                 direction.call(dofs, motion, c, side, 1, v))


@kernel
def rate_of(motion, c, dofs, q, v):
    """Rate of coordinate c, m/s or rad/s."""
    if motion.is_angle[c]:
        return spin_about.call(dofs, motion, c, 1, q, v) - spin_about.call(dofs, motion, c, 0, q, v)
    a, b = motion.node[c, 0], motion.node[c, 1]
    r = position(q, b, dofs) - position(q, a, dofs)
    rate = position(v, b, dofs) - position(v, a, dofs)
    return dot(rate, direction.call(dofs, motion, c, 0, 0, q)) + dot(r, direction.call(dofs, motion, c, 0, 0, v))


@kernel
def push(motion, c, system, force, slope):
    """A force on coordinate c, and its derivative by the coordinate at the end of the step."""
    if motion.is_angle[c]:
        push_angle(motion, c, system, turn_of_step.call(system.dofs, motion, c, system), force, slope)
    else:
        push_distance(motion, c, system, force, slope)


@kernel
def put_entries(term, c, system, k, share):
    """Column and line of the force on coordinate c, constraint k; share: 1, or 0 where the force is known. The rows that it
    touches are the same."""
    motion, contact, work, dofs = term.motion, system.contact, system.work, system.dofs
    rows = system.row_of
    if motion.is_angle[c]:
        turn = turn_of_step.call(dofs, motion, c, system)
        lead = (share * turn.ratio) * turn.mid
        put_spin(contact, k, 0, rows[motion.spin_node[c, 0]], lead, -share * turn.end, dofs)
        put_spin(contact, k, 0, rows[motion.spin_node[c, 1]], -1.0 * lead, share * turn.end, dofs)
    else:
        mid = direction.call(dofs, motion, c, 0, 0, work.q_mid)
        end = direction.call(dofs, motion, c, 0, 0, work.q_end)
        a, b = motion.node[c, 0], motion.node[c, 1]
        r_mid = position(work.q_mid, b, dofs) - position(work.q_mid, a, dofs)
        r_end = position(work.q_end, b, dofs) - position(work.q_end, a, dofs)
        put_on_end.call(term.ties, motion, system, k, 0, c, 1, -share * mid, share * end)
        put_on_end.call(term.ties, motion, system, k, 0, c, 0, share * mid, -share * end)
        put_spin(contact, k, 0, rows[motion.spin_node[c, 0]], -share * cross_product.call(mid, r_mid),
                 share * cross_product.call(end, r_end), dofs)


@kernel
def is_held(motion, c, system, k):
    """Whether the gap of coordinate c, constraint k, is closed."""
    allowed = SETTLED
    if not motion.is_angle[c]:
        d = dim(system.dofs)
        reach = system.length
        for i in range(d):
            reach = max(reach, system.length + abs(system.state.q[(12 if d == 3 else 4) * motion.node[c, 0] + i]))
        allowed = 1e-15 * reach
    return is_closed(system.contact, k, allowed)


# --- given ------------------------------------------------------------------------------------------------------------
@first_guess.register(JointDrives)
@kernel
def begin_drives(term, system, h, c):
    for i in range(term.which.shape[0]):
        term.start[i] = system.state.history[term.motion.place[term.which[i]] + VALUE]
        system.contact.before[term.first[0] + i] = np.inf


@kernel
def given_value(term, i):
    """Value of coordinate i at the end of the step."""
    return term.given[i] if term.kind[i] == TO else term.start[i] + term.given[i]


@assemble.register(JointDrives, Conserving)
@kernel
def assemble_drives(term, method, system, h):
    contact = system.contact
    for i in range(term.which.shape[0]):
        c = term.which[i]
        k = term.first[0] + i
        begin_joint(contact, k, 1)
        push(term.motion, c, system, system.state.force[contact.first_force[k]], 0.0)
        put_entries(term, c, system, k, 1.0)
        contact.residual[k, 0] = missing(term.motion, c, system.dofs, system.work.q_end, given_value(term, i))


@is_settled.register(JointDrives)
@kernel
def drives_are_met(term, system):
    settled = True
    for i in range(term.which.shape[0]):
        settled = is_held(term.motion, term.which[i], system, term.first[0] + i) and settled
    return settled


@account.register(JointDrives)
@kernel
def account_drives(term, system, h):
    """Work, and the value: what is given, so that increments do not collect round-off."""
    for i in range(term.which.shape[0]):
        o = term.motion.place[term.which[i]]
        value = given_value(term, i)
        force = system.state.force[system.contact.first_force[term.first[0] + i]]
        system.state.history[o + VALUE] = value
        system.state.history[o + WORK] += force * (value - term.start[i])


@take_unknowns.register(JointDrives)
@take_unknowns.register(JointFriction)
@kernel
def take_held(term, system):
    take_forces_of(term.first[0], term.which.shape[0], system)


# --- friction ---------------------------------------------------------------------------------------------------------
@first_guess.register(JointFriction)
@kernel
def begin_friction(term, system, h, c):
    """Velocities tell which coordinates may come to rest."""
    motion, state = term.motion, system.state
    term.clock[0] = h
    for i in range(term.which.shape[0]):
        system.contact.before[term.first[0] + i] = np.inf
        term.start[i] = state.history[motion.place[term.which[i]] + VALUE]
        term.sign[i] = int(state.history[term.place[i] + SIGN])
        term.flips[i] = 0
        term.judged[i] = 0
        rest = 0.5 * h * rate_of(motion, term.which[i], system.dofs, state.q, state.v)
        # where it stopped while others moved, a little of its velocity is left, which would change its sign in every step
        left = LEFT if motion.is_angle[term.which[i]] else LEFT * system.length
        term.rest[i] = rest if term.sign[i] != 0 or abs(rest) > left else 0.0


@kernel
def judge(term, i, force, way):
    """Sign of the velocity at the end of the step, from the force of the last iteration and the increment of the coordinate."""
    term.judged[i] += 1
    sign = term.sign[i]
    if term.judged[i] == 1:
        return sign
    if sign == 0:
        if abs(force) > term.limit[i]:
            sign = -1 if force > 0.0 else 1
            # backward in time a velocity has the other sign
            return sign if term.clock[0] > 0.0 else -sign
        return 0
    return 0 if sign * (way - term.rest[i]) * term.clock[0] < 0.0 else sign


@assemble.register(JointFriction, Conserving)
@kernel
def assemble_friction(term, method, system, h):
    motion, contact, force = term.motion, system.contact, system.state.force
    for i in range(term.which.shape[0]):
        c = term.which[i]
        k = term.first[0] + i
        f = contact.first_force[k]
        way = missing(motion, c, system.dofs, system.work.q_end, term.start[i])
        if term.sign[i] == 0 and term.judged[i] > 0 and term.flips[i] < MOST_FLIPS:
            term.soft[i] = contact.compliance[k]
        begin_joint(contact, k, 1)
        slope = 0.0
        if term.flips[i] >= MOST_FLIPS:
            # continuous in the velocity: full where the coordinate moves by what friction can push the parts in the step
            term.rest[i] = 0.0
            term.judged[i] += 1
            width = term.limit[i] * term.soft[i]
            ahead = 1.0 if term.clock[0] > 0.0 else -1.0
            part = ahead * (way / width if width > 0.0 else np.sign(way))
            inside = abs(part) < 1.0 and width > 0.0
            term.sign[i] = 1 if part > 0.0 else -1
            force[f] = -term.limit[i] * (part if inside else term.sign[i])
            slope = -ahead * term.limit[i] / width if inside else 0.0
        else:
            sign = judge(term, i, force[f], way)
            term.flips[i] += sign != term.sign[i]
            term.sign[i] = sign
            if sign != 0:
                force[f] = -sign * term.limit[i]
        push(motion, c, system, force[f], slope)
        put_entries(term, c, system, k, 1.0 if term.sign[i] == 0 else 0.0)
        if term.sign[i] == 0:
            contact.residual[k, 0] = way - term.rest[i]
        else:
            # the force is known and stays
            contact.residual[k, 0] = 0.0
            contact.corner[k, 0] = 1.0


@is_settled.register(JointFriction)
@kernel
def friction_is_settled(term, system):
    """False where no iteration has judged signs by now, or friction put energy in; there the sign of the increment is to
    decide."""
    settled = True
    for i in range(term.which.shape[0]):
        c = term.which[i]
        k = term.first[0] + i
        if term.judged[i] < JUDGED:
            settled = False
        if term.sign[i] == 0:
            settled = is_held(term.motion, c, system, k) and settled
            if abs(system.state.force[system.contact.first_force[k]]) > term.limit[i] * (1.0 + 1e-12):
                # it slips: the next iteration takes the other branch
                settled = False
        if term.rest[i] != 0.0 and term.clock[0] > 0.0:
            way = missing(term.motion, c, system.dofs, system.work.q_end, term.start[i])
            force = -1.0 * term.sign[i] if term.sign[i] != 0 else system.state.force[system.contact.first_force[k]]
            if force * way > 0.0:
                term.rest[i] = 0.0
                settled = False
    return settled


@account.register(JointFriction)
@kernel
def account_friction(term, system, h):
    """What friction takes, and whether coordinates are at rest: there the value is that at the start, to the last bit."""
    history = system.state.history
    for i in range(term.which.shape[0]):
        o = term.motion.place[term.which[i]]
        sticks = term.sign[i] == 0
        if sticks:
            history[o + VALUE] = term.start[i] + term.rest[i]
        force = system.state.force[system.contact.first_force[term.first[0] + i]]
        history[term.place[i] + SIGN] = term.sign[i]
        history[term.place[i] + STICKS] = 1.0 if sticks else 0.0
        history[term.place[i] + RUBBED] -= force * (history[o + VALUE] - term.start[i])


@assemble.register(KnownForces, Conserving)
@kernel
def push_known(term, method, system, h):
    for i in range(term.which.shape[0]):
        push(term.motion, term.which[i], system, system.state.force[system.contact.first_force[term.first[0] + i]], 0.0)
