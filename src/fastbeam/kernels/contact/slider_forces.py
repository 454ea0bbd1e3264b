"""Slider forces along the beam, theory.md 5.6: friction, drives and elastic stops, as the right-hand side of (5.3).

    sliding     F . T = Q,   T of the step, Q the force along the beam on the sliding point; its work in the step is Q Ds

Drives, elastic stops, viscous and smoothed friction give Q as a function of s_n, s_n+1 and the size of the step. Coulomb friction
takes |Q| <= mu F_n |T|. Its F_n is |F_across| and the force that moments of a sleeve press on its edges, (5.11). Its sign is that
of the velocity at the end of the step, ds/dt = 2 Ds/h - ds/dt_n. Where the velocity there is zero, Ds = h ds/dt_n / 2 takes the
place of (5.3). Against a stop, if other parts move, a remaining ds/dt is removed in the same way in the following steps; from
then on the slider stays where it is to the last bit. Every iteration decides anew which of the three cases holds (a semismooth
Newton method). A friction force that would put energy in, for example if the velocity reverses within a step, is rejected: then
the sign of the increment of s decides.

Controllers with a largest force and smoothed friction saturate. Newton's method would go to and fro between both sides of such a
law if its range without saturation is short: an iteration behind one on the other side takes the tangent at zero instead, and
is not the last one.

Arrays: sides [n, LAST].
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import cayley_vector, dim, position, put, spin_cross, vector, zero_spin, zero_vector
from fastbeam.kernels.algebra.vectors import call_law, dot
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
from fastbeam.kernels.contact.curves import find_element, node_of, nodes_of, slot
from fastbeam.kernels.contact.slider import (
    NUMBER,
    NoSleeves,
    SlidingLaw,
    account_along,
    add_contact,
    add_slider,
    begin_along,
    begin_passage,
    is_settled_along,
    motion_along,
    note_passage,
    pull_at_end,
    put_residual,
    sliding_law,
)
from fastbeam.kernels.entries.dense import Weights, put_idle_corner, put_translation
from fastbeam.kernels.jit.decorators import inlined, kernel, separate
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.terms import known, put_loads, spread_nodes

# kinds of drives
NO_DRIVE, POSITION, INCREMENT, FORCE, LAW, CONTROL = range(6)
# numbers of a slider in `State.history`: -1, 0 or 1, the sign of its velocity with Coulomb friction; energy lost to friction, J;
# work of its drive, J; -1 or 1 where it rests against a rigid stop at the start or the end, else 0; energy lost in
# impacts, J; number of steps since it sticks, RESTS at most, else 0; FREE, LOCKED or OFF; how many times its locks
# have taken hold or let go; energy lost where they took hold, J; on switches arc length of the way less s, m, and -1 or 1 where
# it came onto its track by the end or the start, 0 where it began
HISTORY = 11
SIGN, FRICTION_LOSS, DRIVE_WORK, AGAINST, STOP_LOSS, STICKS, HELD, TURNS, LOCK_LOSS, OFFSET, CAME_BY = range(HISTORY)
# a slider slides, is locked where it is, or has left its beam
FREE, LOCKED, OFF = range(3)
# share of the contact force across the beam below which that is round-off
ALONG_ONLY = 1e-12
# number of steps after which a slider that sticks counts as at rest, whatever the beam does; before, its remaining velocity is
# removed, down to an increment of s that is this share of the size of the scene
RESTS, LEFT = 8, 1e-12
# increment that is round-off, rad or a share of the size of the scene
ROUND_OFF = 1e-14
# most nodes under a slider whose shape functions are kept: in steps that cross more element ends they are formed anew
MOST_KEPT = 16
# columns of laws that saturate: -1 or 1, on which side this iteration took the law, 0 in between, OPEN before the first one, or
# TANGENT to MOST_TANGENTS times the side before where it took the tangent at zero, one more each time; 1 if this iteration took
# another law than the one before, else 0
SIDE, CHANGED, LAST = range(3)
OPEN, TANGENT, MOST_TANGENTS = 2, 3, 6
BY_PLACE, BY_RATE, MOST, STIFFNESS = 0, 1, 2, 2  # columns of `gains`, the last one of `stops`
# columns of `asked`: arguments of a law, s and ds/dt; its force; failure as in user_force.FAILED: 1, time, s, ds/dt
ASKED_FORCE, ASKED_FAILED, ASKED = 2, 3, 7


class Along(NamedTuple):
    """Slider forces along the beam of S sliders, and their numbers of one run."""

    friction: np.ndarray    # float64 [S]: coefficient of Coulomb friction
    viscous: np.ndarray     # float64 [S]: N s/m
    smoothing: np.ndarray   # float64 [S]: m/s, friction is mu N tanh(velocity/smoothing); 0: Coulomb's law
    stops: np.ndarray       # float64 [S, 3]: arc lengths where elastic stops begin, m; their stiffness, N/m
    drive: np.ndarray       # int64 [S]: NO_DRIVE, POSITION, INCREMENT, FORCE, LAW or CONTROL
    gains: np.ndarray       # float64 [S, 3]: of a controller, N/m, N s/m and the largest force, N
    law: np.ndarray         # int64 [S]: address of a compiled function as of user_force.Laws, of a force, N
    asked: np.ndarray       # float64 [S, ASKED]: arguments and result of the law
    given: np.ndarray       # float64 [S, 2]: prescribed value of a drive in a step: s at its end or increment of s, m; the force,
    #                         N; or of a controller s in the middle, m, and ds/dt, m/s
    clock: np.ndarray       # float64 [3]: size of the step, s; time of its middle, s; mass of the scene, kg
    needed: np.ndarray      # float64 [S]: force that friction has to give, N, in the last iteration
    coulomb: Coulomb        # of S sliders
    drive_side: np.ndarray  # int64 [S, LAST]: of controllers: SIDE and CHANGED
    rub_side: np.ndarray    # int64 [S, LAST]: of smoothed friction
    held: np.ndarray        # int64 [S]: FREE, LOCKED or OFF
    offset: np.ndarray      # float64 [S]: arc length travelled less s, m: on switches, else 0
    under: np.ndarray       # int64 [S, 2]: first of the nodes under the slider in the last iteration, and the one behind the last
    taken: np.ndarray       # float64 [S]: s at the end of the step at which that iteration has formed shape functions
    shapes: np.ndarray      # float64 [S, MOST_KEPT, 4]: mean and mean slope of shape functions over the step, derivatives by s


Along.stays_in_memory = True  # type: ignore[attr-defined]


class DriveSchedule(NamedTuple):
    """Prescribed values of drives in every substep; stands ahead of the sliders in the tuple of terms."""

    along: Along
    given: np.ndarray       # float64 [substeps, S, 2]
    middle: np.ndarray      # float64 [substeps]: times of their middle, s


@put_loads.register(DriveSchedule)
@kernel
def put_drives(term, system, k):
    along = term.along
    for i in range(along.given.shape[0]):
        along.given[i, 0] = term.given[k, i, 0]
        along.given[i, 1] = term.given[k, i, 1]
    along.clock[1] = term.middle[k]


class Force(NamedTuple):
    """Force along the beam and its derivative by s at the end of the step."""

    value: float
    slope: float


@inlined
def stop_force(along, k, s0, s1):
    """Return the force of elastic stops: minus the divided difference of their energy."""
    stiffness = along.stops[k, STIFFNESS]
    if not stiffness > 0.0:
        return Force(0.0, 0.0)
    value = 0.0
    slope = 0.0
    for end in range(2):
        sign = 1.0 if end else -1.0
        p0 = max(sign * (s0 - along.stops[k, end]), 0.0)
        p1 = max(sign * (s1 - along.stops[k, end]), 0.0)
        if p0 > 0.0 and p1 > 0.0:
            value -= 0.5 * sign * stiffness * (p0 + p1)
            slope -= 0.5 * stiffness
        elif p0 > 0.0 or p1 > 0.0:
            along_end = sign * (s1 - s0)
            share = (p1 - p0) / along_end
            value -= 0.5 * sign * stiffness * share * (p0 + p1)
            slope -= 0.5 * stiffness * (2.0 * p1 - share * (p0 + p1)) / along_end
    return Force(value, slope)


@kernel
def law_force(along, k, s, rate):
    """Return the force, N, of a drive with a law at s and ds/dt = rate, in the middle of the step."""
    asked = along.asked
    asked[k, 0] = s
    asked[k, 1] = rate
    row = asked.ctypes.data + 8 * ASKED * k
    call_law(along.law[k], along.clock[1], row, row, row + 8 * ASKED_FORCE, row + 8 * ASKED_FAILED)
    return asked[k, ASKED_FORCE]


# --- laws that saturate ---------------------------------------------------------------------------------------------------
@kernel
def begin_sides(sides):
    """Forget the iterations of the step before."""
    for i in range(sides.shape[0]):
        sides[i, SIDE] = OPEN
        sides[i, CHANGED] = 0


@inlined
def crosses(sides, i, at, kinked):
    """Return whether law i, saturated where abs(at) > 1, takes the tangent at zero in this iteration: behind one on the other
    side, and some times more where the tangent leads back to that side.

    kinked: whether the law is that tangent as long as it is not saturated."""
    before = sides[i, SIDE]
    side = (1 if at > 1.0 else 0) - (1 if at < -1.0 else 0)
    now = side
    if side * before == -1:
        now = TANGENT * before
    elif TANGENT <= side * before < MOST_TANGENTS:
        now = before + side
    crossed = now != side
    same = before == now or before == OPEN or kinked and side == 0 and abs(before) >= TANGENT
    sides[i, SIDE] = now
    sides[i, CHANGED] = 1 if crossed or not same else 0
    return crossed


@kernel
def sides_stay(sides):
    """Return whether the last iteration took all laws on the sides of the iteration before."""
    for i in range(sides.shape[0]):
        if sides[i, CHANGED] != 0:
            return False
    return True


@inlined
def control_force(along, k, s0, s1):
    """Return the `Force` of a controller without its limit."""
    h = along.clock[0]
    force = (along.gains[k, BY_PLACE] * (along.given[k, 0] - along.offset[k] - 0.5 * (s0 + s1))
             + along.gains[k, BY_RATE] * (along.given[k, 1] - (s1 - s0) / h))
    return Force(force, -0.5 * along.gains[k, BY_PLACE] - along.gains[k, BY_RATE] / h)


@inlined
def drive_in_iteration(along, k, s0, s1):
    """Return `drive_force` as an iteration of a step takes it."""
    if along.drive[k] == CONTROL:
        force = control_force(along, k, s0, s1)
        if crosses(along.drive_side, k, force.value / along.gains[k, MOST], True):
            return force
    return drive_force(along, k, s0, s1)


@inlined
def drive_force(along, k, s0, s1):
    """Return the `Force` of a drive that does not prescribe the motion; zero for other drives."""
    kind = along.drive[k]
    h = along.clock[0]
    if kind == FORCE:
        return Force(along.given[k, 0], 0.0)
    if kind == LAW:
        step = 1e-6 * (abs(s1 - s0) + 1e-3 * abs(s1) + 1e-9)
        middle = 0.5 * (s0 + s1)
        rate = (s1 - s0) / h
        slope = (law_force(along, k, middle + 0.5 * step, rate + step / h)
                 - law_force(along, k, middle - 0.5 * step, rate - step / h)) / (2.0 * step)
        return Force(law_force(along, k, middle, rate), slope)
    if kind == CONTROL:
        force = control_force(along, k, s0, s1)
        limit = along.gains[k, MOST]
        if abs(force.value) > limit:
            return Force(limit if force.value > 0.0 else -limit, 0.0)
        return force
    return Force(0.0, 0.0)


@inlined
def other_forces(along, k, s0, s1):
    """Return the sum of all slider forces but Coulomb friction and drives that prescribe the motion."""
    stop = stop_force(along, k, s0, s1)
    drive = drive_in_iteration(along, k, s0, s1)
    viscous = along.viscous[k] / along.clock[0]
    return Force(stop.value + drive.value - viscous * (s1 - s0), stop.slope + drive.slope - viscous)


@inlined
def is_prescribed(along, k):
    return along.drive[k] == POSITION or along.drive[k] == INCREMENT or along.held[k] != FREE


@add_contact.register(Along)
@kernel
def add_if_on_beam(along, term, system, k):
    if along.held[k] == OFF:
        add_idle_slider(term, system, k)
    else:
        add_slider(along, term, system, k)


@kernel
def add_idle_slider(term, system, k):
    """Add the rows of a slider that has left its beam: no force, and s stays. Its only entry is its point, with zeros."""
    contact, work, dofs = system.contact, system.work, system.dofs
    point = term.sliders.point[k]
    force = vector(system.state.force, contact.first_force[k], 1, dofs)
    zero = zero_vector(dofs)
    contact.entries[k] = 0
    put_translation.call(term.ties, contact, k, point, system.row_of[point], work, Weights(0.0, 0.0, 0.0, 0.0), zero, zero, dofs)
    put_idle_corner.call(contact, k, dofs)
    put_residual(contact, k, force, work.s_end[k] - system.state.s[k], dofs)


@inlined
def prescribed_end(along, k, s0):
    """Return s at the end of the step of a slider whose motion is prescribed, or that is locked."""
    if along.held[k] != FREE:
        return s0
    return along.given[k, 0] - along.offset[k] if along.drive[k] == POSITION else s0 + along.given[k, 0]


@inlined
def has_signs(along, k):
    """Return whether the slip direction of a slider matters: with Coulomb friction, and at rest against a stop."""
    return along.friction[k] > 0.0 and along.smoothing[k] == 0.0 or along.coulomb.against[k] != 0


@generic
def force_of_edges(sleeves, system, k):
    """Return the force that the moments of slider k press on the edges of its bore, (5.11), N."""


@force_of_edges.register(NoSleeves)
@kernel
def force_of_no_edges(sleeves, system, k):
    return 0.0


class Pressing(NamedTuple):
    """Normal force of a slider on its beam, and quantities formed with it."""

    across: Any     # F_across, the part of the contact force across the beam
    part: float     # F less F_across, in units of T
    normal: float   # |F_across|
    edges: float    # force that moments press on the edges of a bore, N
    long: float     # |T|


@inlined
def pressing(force, tangent, edges):
    square = dot(tangent, tangent)
    part = dot(force, tangent) / square
    across = force - part * tangent
    return Pressing(across, part, np.sqrt(dot(across, across)), edges, np.sqrt(square))


@inlined
def most_of_friction(along, k, press):
    """Return the bound of Coulomb friction in (5.6)."""
    return along.friction[k] * (press.normal + press.edges) * press.long


@inlined
def rub(factor, press, law):
    """Add friction -factor (|F_across| + edges) |T| to a law without friction; `factor` is constant in the derivatives."""
    force, tangent = law.force, law.tangent
    across, part, normal, edges, long = press
    if not normal > ALONG_ONLY * np.sqrt(dot(force, force)):
        return SlidingLaw(force + (factor * edges / long) * tangent, tangent, law.rest, law.slope, 1.0, factor * long)
    by_tangent = (factor * (normal + edges) / long) * tangent - (factor * part * long / normal) * across
    # by_tangent . T is the friction, but for digits that a small F_across has lost
    lost = factor * (normal + edges) * long - dot(by_tangent, tangent)
    return SlidingLaw(force + by_tangent, tangent + (factor * long / normal) * across, law.rest + lost, law.slope, 1.0,
                      factor * long)


@inlined
def hold(along, way, force):
    """Return the law of a slider whose increment of s is prescribed: `way` is missing of it; in the unit of a force, as rows are
    scaled."""
    unit = along.clock[2] / (along.clock[0] * along.clock[0])
    return SlidingLaw(0.0 * force, 0.0 * force, unit * way, unit, 0.0, 0.0)


@sliding_law.register(Along)
@inlined
def slide_with_forces(along, term, system, k, force, tangent, push):
    s0, s1 = system.state.s[k], system.work.s_end[k]
    if is_prescribed(along, k):
        return hold(along, s1 - prescribed_end(along, k, s0), force)
    known = other_forces(along, k, s0, s1)
    other = known.value + push
    mu = along.friction[k]
    law = SlidingLaw(force, tangent, -other, -known.slope, 1.0, 0.0)
    signs = has_signs(along, k)
    if mu == 0.0 and not signs:
        return law
    press = pressing(force, tangent, force_of_edges.call(term.sleeves, system, k))
    most = most_of_friction(along, k, press)
    if not signs:
        at = (s1 - s0) / (along.clock[0] * along.smoothing[k])
        if crosses(along.rub_side, k, at, False):
            slope = most / (along.clock[0] * along.smoothing[k])
            return SlidingLaw(force, tangent, most * at - other, slope - known.slope, 1.0, 0.0)
        factor = np.tanh(at)
        slope = (1.0 - factor * factor) / (along.clock[0] * along.smoothing[k])
        return rub(factor * mu, press, SlidingLaw(force, tangent, -other, most * slope - known.slope, 1.0, 0.0))
    along.needed[k] = dot(force, tangent) - other
    rub_by_coulomb(along, k, system, s1 - s0, most)
    coulomb = along.coulomb
    if coulomb.sign[k] == 0:
        return hold(along, s1 - s0 - coulomb.rest[k], force)
    if is_soft(coulomb, k):
        soft = coulomb.compliance[k] if along.clock[0] > 0.0 else -coulomb.compliance[k]
        return SlidingLaw(law.force, law.tangent, law.rest + (s1 - s0) / soft, law.slope + 1.0 / soft, 1.0, 0.0)
    return rub(coulomb.sign[k] * mu, press, law)


@kernel
def rub_by_coulomb(along, k, system, ds, most):
    """Find by Coulomb's law whether slider k sticks, or in which direction it slips; `needed` has been found."""
    coulomb, increment, h = along.coulomb, system.work.increment, along.clock[0]
    coulomb.found[k] = system.contact.compliance[k]
    begin_iteration(coulomb, k, increment)
    judge(coulomb, k, increment, h, Attempt(ds, ds - coulomb.rest[k], along.needed[k], most, 0.0,
                                            ROUND_OFF * system.length))


@begin_along.register(Along)
@kernel
def begin_forces(along, term, system, h):
    """Find from the velocities along the beams which sliders may come to rest."""
    state = system.state
    along.clock[0] = h
    begin_sides(along.drive_side)
    begin_sides(along.rub_side)
    for k in range(state.s.shape[0]):
        along.held[k] = int(state.history[HISTORY * k + HELD])
        along.offset[k] = state.history[HISTORY * k + OFFSET]
        if is_prescribed(along, k):
            system.work.s_end[k] = prescribed_end(along, k, state.s[k])
            continue
        sign, against = int(state.history[HISTORY * k + SIGN]), int(state.history[HISTORY * k + AGAINST])
        begin_coulomb(along.coulomb, k, sign, against)
        if has_signs(along, k):
            if sign != 0 or (against == 0 and state.history[HISTORY * k + STICKS] < RESTS):
                e = find_element.call(term.curves, term.sliders.curve[k], state.s[k], system.contact.element[k])
                tangent, relative = motion_along(term.curves, term.sliders, system.contact, state.q, state.v, state.s[k],
                                                 state.history, k, e, system.dofs)
                rest = 0.5 * h * (dot(relative, tangent) / dot(tangent, tangent))
                if sign != 0 or abs(rest) > LEFT * system.length:
                    along.coulomb.rest[k] = rest
            if sign == 0:
                system.work.s_end[k] = state.s[k] + along.coulomb.rest[k]


@is_settled_along.register(Along)
@kernel
def friction_takes_energy(along, term, system):
    """Return True if slip directions were evaluated in this step and Coulomb friction dissipates; otherwise let the slip
    increment decide the direction. Laws that saturate have to stay on their sides."""
    settled = sides_stay(along.drive_side) and sides_stay(along.rub_side)
    for k in range(along.friction.shape[0]):
        if is_prescribed(along, k) or not has_signs(along, k):
            continue
        # a stop without friction loses nothing
        way = system.work.s_end[k] - system.state.s[k] if along.friction[k] > 0.0 else 0.0
        if not obeys(along.coulomb, k, system.work.increment, along.clock[0], way, along.needed[k], False):
            settled = False
    note_change(not settled, system.work.increment)
    return settled


@inlined
def sign_of_given(ds, system):
    """Return the sign of a prescribed increment of s; 0 within round-off, as while a prescribed motion rests."""
    return np.sign(ds) if abs(ds) > LEFT * system.length else 0.0


@account_along.register(Along)
@kernel
def account_forces(along, term, system, h):
    """Record work of friction and drives in a converged step, and which sliders are at rest."""
    state = system.state
    for k in range(state.s.shape[0]):
        if system.work.s_end[k] != state.s[k]:
            account_work(along, term, system, k)
        if is_prescribed(along, k):
            if along.friction[k] > 0.0:
                state.history[HISTORY * k + SIGN] = sign_of_given(system.work.s_end[k] - state.s[k], system)
        elif has_signs(along, k):
            coulomb, place = along.coulomb, HISTORY * k
            count_missed(coulomb, k)
            state.history[place + SIGN] = coulomb.sign[k]
            sticks = coulomb.sign[k] == 0 and coulomb.against[k] == 0
            state.history[place + STICKS] = min(state.history[place + STICKS] + 1.0, float(RESTS)) if sticks else 0.0
            if coulomb.sign[k] != 0:
                state.history[place + AGAINST] = 0.0


@kernel
def lead_passage(system, nodes, lo, hi, point, h):
    """Update the coordinates of the nodes under a slider, and of its point, from the last increments."""
    dofs, method, state, work = system.dofs, system.method, system.state, system.work
    for a in range(lo, hi):
        node = node_of.call(nodes, a)
        spread_nodes.call(dofs, method, state, work, h, node, node + 1)
    spread_nodes.call(dofs, method, state, work, h, point, point + 1)


@note_passage.register(Along, NoSleeves)
@inlined
def note_shapes(along, sleeves, term, system, k, nodes, lo, hi):
    basis = system.contact.basis
    along.under[k, 0] = lo
    along.under[k, 1] = hi
    along.taken[k] = system.work.s_end[k]
    if hi - lo > MOST_KEPT:
        return
    o = 4 * MOST_KEPT * k
    for a in range(lo, hi):
        i = slot.call(nodes, a)
        put(along.shapes, o, 1, 0.5 * (basis[0, i] + basis[1, i]))
        put(along.shapes, o + 1, 1, basis[3, i])
        put(along.shapes, o + 2, 1, 0.5 * basis[2, i])
        put(along.shapes, o + 3, 1, basis[4, i])
        o += 4


@generic
def last_passage(sleeves, along, term, system, k):
    """Return T of slider k in a converged step, from the last increments of the nodes under it, and the force of the moments of a
    sleeve along the beam."""


@last_passage.register(NoSleeves)
@inlined
def tangent_of_positions(sleeves, along, term, system, k):
    """Return T from positions and Cayley vectors alone, and 0. Shape functions follow from those of the last iteration, whose
    increment of s has a square below round-off when Newton's method has converged."""
    basis, q, work, dofs = system.contact.basis, system.state.q, system.work, system.dofs
    c = term.sliders.curve[k]
    nodes = nodes_of.call(term.curves, c)
    lo, hi = along.under[k, 0], along.under[k, 1]
    kept = hi - lo <= MOST_KEPT
    ds = work.s_end[k] - along.taken[k] if kept else 0.0
    if not kept:
        nodes, lo, hi = begin_passage(term, system, k)
    start = zero_vector(dofs)
    change = zero_vector(dofs)
    turn = zero_spin(dofs)
    for a in range(lo, hi):
        i = slot.call(nodes, a)
        node = node_of.call(nodes, a)
        if kept:
            mean = along.shapes[k, a - lo, 0] + ds * along.shapes[k, a - lo, 2]
            slope = along.shapes[k, a - lo, 1] + ds * along.shapes[k, a - lo, 3]
        else:
            mean = 0.5 * (basis[0, i] + basis[1, i])
            slope = basis[3, i]
        start += slope * position(q, node, dofs)
        change += slope * vector(work.dphi, dim(dofs) * node, 1, dofs)
        turn += mean * cayley_vector(work.theta, term.sliders.spin_root[node], dofs)
    return start + 0.5 * change - 0.25 * spin_cross.call(turn, change), 0.0


@separate
def account_work(along, term, system, k):
    """Record the work of friction and of the drive of a slider that moves."""
    state, work, contact, dofs = system.state, system.work, system.contact, system.dofs
    h = along.clock[0]
    tangent, push = last_passage.call(term.sleeves, along, term, system, k)
    force = vector(state.force, contact.first_force[k], 1, dofs)
    s0, s1 = state.s[k], work.s_end[k]
    ds = s1 - s0
    follows = term.sliders.following.at[k, NUMBER]
    if follows >= 0:
        own, tangent = tangent, vector(term.sliders.following.tangent[follows], 0, 1, dofs)
        push += dot(force, tangent - own) - pull_at_end(term, system, k)
    total = dot(force, tangent) - push
    stop = stop_force(along, k, s0, s1).value
    if is_prescribed(along, k):
        sign = np.tanh(ds / (h * along.smoothing[k])) if along.smoothing[k] > 0.0 else sign_of_given(ds, system)
        most = most_of_friction(along, k, pressing(force, tangent, force_of_edges.call(term.sleeves, system, k)))
        friction = -along.viscous[k] / h * ds - most * sign
        drive = total - stop - friction
    else:
        drive = known(drive_force(along, k, s0, s1).value)
        friction = total - stop - drive
    state.history[HISTORY * k + FRICTION_LOSS] -= friction * ds
    state.history[HISTORY * k + DRIVE_WORK] += drive * ds
