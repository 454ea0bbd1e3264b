"""Prescribed coordinates of joints with axes, functions of time, theory.md 4; and drives that push with a force.

The force G on a coordinate x acts as in forces.py and does the work G Dx. Where x is prescribed, G is an unknown, one more
constraint, whose equation is

    x_n+1 = x(t_n+1)                                                                                                    (4.16)

The error of an angle x_n+1 is formed by its sine and cosine, which lose no digits over many turns. Friction and rigid stops
prescribe coordinates in the same way: friction.py. Drives that do not prescribe the motion of a coordinate push it with a force
of time, of (t, x, x'), or of a controller.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import dim
from fastbeam.kernels.contact.coulomb import note_change
from fastbeam.kernels.contact.point_entries import begin_joint, is_closed, take_forces_of
from fastbeam.kernels.contact.sleeve import SETTLED
from fastbeam.kernels.contact.slider_forces import begin_sides, drive_force, drive_in_iteration, sides_stay
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.joints.coordinates import (
    LINE,
    VALUE,
    WORK,
    JointMotion,
    gradient_at_rest,
    gradient_in_step,
    missing,
    push,
    put_entries,
    value_of,
)
from fastbeam.kernels.joints.forces import way_of
from fastbeam.kernels.terms import (
    Conserving,
    Equilibrium,
    WithContact,
    account,
    assemble,
    first_guess,
    is_settled,
    known,
    put_loads,
    take_unknowns,
)

# prescribed quantity of a coordinate: its value at the end of the step, or its increment
TO, BY = range(2)


class JointDrives(NamedTuple):
    """D prescribed coordinates of joints."""

    motion: JointMotion
    which: np.ndarray      # int64 [D]: of the coordinates of `motion`
    kind: np.ndarray       # int64 [D]: TO or BY
    first: np.ndarray      # int64 [1]: number of the first among all constraints
    given: np.ndarray      # float64 [D]: value at the end of the step, or its increment, m or rad
    start: np.ndarray      # float64 [D]: value at the start of the step, m or rad
    ties: Any              # ties.Ties, planar_nodes.PlanarTies or NoTies


JointDrives.reads = WithContact  # type: ignore[attr-defined]


class DriveTimes(NamedTuple):
    """Prescribed values of the coordinates of `JointDrives` in every substep."""

    drives: JointDrives
    given: np.ndarray      # float64 [substeps, D]


class JointControl(NamedTuple):
    """D coordinates with drives that push with a force, without prescribed motion."""

    motion: JointMotion
    which: np.ndarray      # int64 [D]: of the coordinates of `motion`
    drive: np.ndarray      # int64 [D]: slider_forces.FORCE, LAW or CONTROL
    gains: np.ndarray      # float64 [D, 3]: of a controller, by value and rate, and the largest force, N or N m
    law: np.ndarray        # int64 [D]: address of a compiled function, as of `slider_forces.Along`
    asked: np.ndarray      # float64 [D, ASKED]: arguments and result of the law
    given: np.ndarray      # float64 [D, 2]: the force; or value and rate that a controller follows
    clock: np.ndarray      # float64 [2]: size of the step, and time of its middle, s
    start: np.ndarray      # float64 [D]: value at the start of the step, m or rad
    share: np.ndarray      # float64 [1]: factor of the forces, the load factor in an equilibrium
    offset: np.ndarray     # float64 [D]: 0; for sliders on switches the difference of a controller's value and theirs
    drive_side: np.ndarray  # int64 [D, LAST]: as of `slider_forces.Along`


class ControlTimes(NamedTuple):
    """Prescribed values of the drives of `JointControl` in every substep."""

    control: JointControl
    given: np.ndarray      # float64 [substeps, D, 2]
    middle: np.ndarray     # float64 [substeps]: times of their middle, s


class KnownForces(NamedTuple):
    """Forces of constraints on D coordinates as the state has them, without equations: for reactions."""

    motion: JointMotion
    which: np.ndarray       # int64 [D]: of the coordinates of `motion`
    factor: np.ndarray      # float64 [D]: share of the force of the constraint
    constraint: np.ndarray  # int64 [D]: number of the constraint


KnownForces.reads = WithContact  # type: ignore[attr-defined]


@put_loads.register(DriveTimes)
@kernel
def put_given(term, system, k):
    for i in range(term.given.shape[1]):
        term.drives.given[i] = term.given[k, i]


@kernel
def round_off_of(motion, c, system):
    """Return the size of round-off of coordinate c, m or rad."""
    if motion.kind[c] != LINE:
        return SETTLED
    d = dim(system.dofs)
    reach = system.length
    for i in range(d):
        reach = max(reach, system.length + abs(system.state.q[(12 if d == 3 else 4) * motion.node[c, 0] + i]))
    return 1e-15 * reach


@kernel
def is_held(motion, c, system, k):
    """Return whether the gap of coordinate c, constraint k, is closed."""
    return is_closed(system.contact, k, round_off_of(motion, c, system))


# --- prescribed -------------------------------------------------------------------------------------------------------
@first_guess.register(JointDrives)
@kernel
def begin_drives(term, system, h, c):
    for i in range(term.which.shape[0]):
        term.start[i] = system.state.history[term.motion.place[term.which[i]] + VALUE]
        system.contact.before[term.first[0] + i] = np.inf


@kernel
def given_value(term, i):
    """Return the value of coordinate i at the end of the step."""
    return term.given[i] if term.kind[i] == TO else term.start[i] + term.given[i]


@assemble.register(JointDrives, Conserving)
@assemble.register(JointDrives, Equilibrium)
@kernel
def assemble_drives(term, method, system, h):
    contact = system.contact
    for i in range(term.which.shape[0]):
        c = term.which[i]
        k = term.first[0] + i
        begin_joint(contact, k, 1)
        push(term.motion, c, system, gradient_in_step(term.motion, c, system), system.state.force[contact.first_force[k]], 0.0)
        put_entries(term, c, system, k, 0, 1.0, 1.0)
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
    """Record the work, and the prescribed value as the value, so that increments do not collect round-off."""
    for i in range(term.which.shape[0]):
        o = term.motion.place[term.which[i]]
        value = given_value(term, i)
        force = system.state.force[system.contact.first_force[term.first[0] + i]]
        system.state.history[o + VALUE] = value
        system.state.history[o + WORK] += force * (value - term.start[i])


@take_unknowns.register(JointDrives)
@kernel
def take_held(term, system):
    take_forces_of(term.first[0], term.which.shape[0], system)


# --- drives that push --------------------------------------------------------------------------------------------------
@put_loads.register(ControlTimes)
@kernel
def put_controls(term, system, k):
    control = term.control
    for i in range(control.given.shape[0]):
        control.given[i, 0] = term.given[k, i, 0]
        control.given[i, 1] = term.given[k, i, 1]
    control.clock[1] = term.middle[k]


@first_guess.register(JointControl)
@kernel
def begin_control(term, system, h, c):
    term.clock[0] = h
    begin_sides(term.drive_side)
    for i in range(term.which.shape[0]):
        term.start[i] = system.state.history[term.motion.place[term.which[i]] + VALUE]


@assemble.register(JointControl, Conserving)
@kernel
def assemble_control(term, method, system, h):
    motion = term.motion
    for i in range(term.which.shape[0]):
        c = term.which[i]
        before = system.state.history[motion.place[c] + VALUE]
        gradient = gradient_in_step(motion, c, system)
        found = drive_in_iteration(term, i, before, before + way_of(motion, c, system, gradient, before))
        push(motion, c, system, gradient, found.value, found.slope)


@assemble.register(JointControl, Equilibrium)
@kernel
def assemble_control_at_rest(term, method, system, h):
    """Add forces at one shape and half their derivative: the clock has an infinite step, so that rates vanish."""
    motion = term.motion
    for i in range(term.which.shape[0]):
        c = term.which[i]
        value = value_of(motion, c, system.dofs, system.work.q_end, system.state.history[motion.place[c] + VALUE])
        found = drive_force(term, i, value, value)
        push(motion, c, system, gradient_at_rest(motion, c, system), term.share[0] * found.value, term.share[0] * found.slope)


@is_settled.register(JointControl)
@kernel
def controls_stay(term, system):
    settled = sides_stay(term.drive_side)
    note_change(not settled, system.work.increment)
    return settled


@account.register(JointControl)
@kernel
def account_control(term, system, h):
    """Record the work; values at the end of the step are known."""
    history = system.state.history
    for i in range(term.which.shape[0]):
        o = term.motion.place[term.which[i]]
        value = history[o + VALUE]
        history[o + WORK] += known(drive_force(term, i, term.start[i], value).value * (value - term.start[i]))


@assemble.register(KnownForces, Conserving)
@assemble.register(KnownForces, Equilibrium)
@kernel
def push_known(term, method, system, h):
    for i in range(term.which.shape[0]):
        force = term.factor[i] * system.state.force[system.contact.first_force[term.constraint[i]]]
        push(term.motion, term.which[i], system, gradient_in_step(term.motion, term.which[i], system), force, 0.0)
