"""Contribution of sleeves, and of slider forces, to the adjoint of a step (theory.md (13.13) to (13.15)).

Slider forces are those of the branch that the step took: a slipping slider keeps its slip direction, a slider that sticks or is
driven keeps its prescribed increment of s. That increment alone depends on the start of the step in its own way; all other
equations are symmetric in time.

Arrays: q, v [12 N], in a plane [4 N]; x, rows_out [8 (rows + 1)].
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import (
    Plane,
    Space,
    add_to,
    coordinates,
    cross_product,
    dim,
    position,
    spin_cross,
    vector,
    zero_vector,
)
from fastbeam.kernels.algebra.vectors import dot, ld3
from fastbeam.kernels.contact.curves import add_basis, find_element, node_of, nodes_of, nodes_under, slot
from fastbeam.kernels.contact.held_directors import director, holder_of
from fastbeam.kernels.contact.sleeve import Sleeves
from fastbeam.kernels.contact.slider import (
    NoForceAlong,
    NoSleeves,
    Sliding,
    SlidingLaw,
    begin_passage,
    mean_tangent,
    pass_along,
    sliding_law,
)
from fastbeam.kernels.contact.slider_forces import (
    INCREMENT,
    POSITION,
    Along,
    begin_sides,
    force_of_edges,
    has_signs,
    hold,
    is_prescribed,
    other_forces,
    pressing,
    rub,
    slide_with_forces,
)
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.joints.coordinates import VALUE, JointMotion
from fastbeam.kernels.joints.drives import JointControl


class TakenAlong(Along):
    """Slider forces of recorded steps: `sign` of the run, and in `rest` the missing increment of s."""


class Sliders(NamedTuple):
    """Sums of a backward pass for S sliders."""

    along: np.ndarray     # float64 [n, S]: derivatives by a force along the beam in every step
    place: np.ndarray     # float64 [n, S]: by the place, or its increment, that a drive prescribes in every step
    friction: np.ndarray  # float64 [S]: by coefficients of friction
    viscous: np.ndarray   # float64 [S]


class Rest(NamedTuple):
    """Derivatives of the increment of s that leaves a slider at rest, h/2 ds/dt at the start of the step."""

    by_rate: Any          # derivative by the velocity of the point relative to the beam
    by_tangent: Any       # derivative by dx/ds
    by_s: float


@generic
def put_branch(term, system, steps, h, k, back):
    """Store the branch of slider forces and joint forces in step k, of size h; back: from its end."""


@generic
def put_start(term, system, steps, h, k):
    """Correct derivatives of sliding equations that are not symmetric in time by the places at the start of step k, after the
    tangent of the step backward in time."""


@generic
def add_start(term, border, system, adjoint, steps, h, k):
    """Add derivatives of these equations by coordinates and velocities at the start to adjoint.forces and adjoint.rate."""


@generic
def add_slides(term, border, system, found, h, k):
    """Add the contribution of step k to derivatives by slider forces and prescribed places."""


@generic
def add_turning(term, system, x, rows_out):
    """Subtract E^T x from rows_out, E the part of the tangent of a step that its iterations leave out (13.13)."""


# --- laws -----------------------------------------------------------------------------------------------------------------
@kernel
def sticks(along, k):
    """Return whether slider k sticks."""
    return has_signs(along, k) and along.coulomb.sign[k] == 0 and not is_prescribed(along, k)


@sliding_law.register(TakenAlong)
@kernel
def slide_as_taken(along, term, system, k, force, tangent, push):
    if is_prescribed(along, k) or not has_signs(along, k):
        return slide_with_forces(along, term, system, k, force, tangent, push)
    s0, s1 = system.state.s[k], system.work.s_end[k]
    if along.coulomb.sign[k] == 0:
        return hold(along, s1 - s0 - along.coulomb.rest[k], force)
    known = other_forces(along, k, s0, s1)
    press = pressing(force, tangent, force_of_edges.call(term.sleeves, system, k))
    return rub(along.coulomb.sign[k] * along.friction[k], press,
               SlidingLaw(force, tangent, -known.value - push, -known.slope, 1.0, 0.0))


@put_branch.register(Sliding)
@kernel
def put_branch_of_sliders(term, system, steps, h, k, back):
    put_taken.call(term.along, steps, h, k)


@generic
def put_taken(along, steps, h, k):
    """Store the branch of the slider forces `along`, see `put_branch`."""


@put_taken.register(NoForceAlong)
@kernel
def put_none_taken(along, steps, h, k):
    pass


@put_taken.register(TakenAlong)
@kernel
def put_branch_taken(along, steps, h, k):
    along.clock[0] = h
    begin_sides(along.drive_side)
    begin_sides(along.rub_side)
    for i in range(along.friction.shape[0]):
        along.coulomb.sign[i] = steps.sign[k, i]
        along.coulomb.rest[i] = steps.rest[k, i]


@put_branch.register(JointMotion)
@kernel
def put_values(motion, system, steps, h, k, back):
    at = k + 1 if back else k
    for c in range(motion.place.shape[0]):
        system.state.history[motion.place[c] + VALUE] = steps.values[at, c]


@put_branch.register(JointControl)
@kernel
def put_clock(control, system, steps, h, k, back):
    control.clock[0] = h
    begin_sides(control.drive_side)


# --- equations that are not symmetric in time -------------------------------------------------------------------------------
@kernel
def rest_of(term, system, steps, h, k, i):
    """Return `Rest` of slider i in step k of size h; shape functions and their slopes are left in rows 0 and 1 of the basis, and
    nodes lo to before hi of `nodes_of` the curve are under it."""
    curves, contact, dofs = term.curves, system.contact, system.dofs
    basis = contact.basis
    q, v, s, c = steps.q[k], steps.v[k], steps.s[k, i], term.sliders.curve[i]
    e = find_element.call(curves, c, s, contact.element[i])
    nodes = nodes_of.call(curves, c)
    lo, hi = nodes_under.call(curves, c, e, e)
    for row in range(3):
        for a in range(lo, hi):
            basis[row, slot.call(nodes, a)] = 0.0
    add_basis.call(curves, c, e, s, 0, 1.0, 0.0, contact.legendre, basis, 0)
    add_basis.call(curves, c, e, s, 1, 1.0, 1.0, contact.legendre, basis, 1)
    tangent = zero_vector(dofs); tangent_s = zero_vector(dofs); rate_s = zero_vector(dofs)
    rate = position(v, term.sliders.point[i], dofs)
    for a in range(lo, hi):
        at = slot.call(nodes, a)
        x = position(q, node_of.call(nodes, a), dofs)
        u = position(v, node_of.call(nodes, a), dofs)
        tangent += basis[1, at] * x
        tangent_s += basis[2, at] * x
        rate -= basis[0, at] * u
        rate_s -= basis[1, at] * u
    size = dot(tangent, tangent)
    by_rate = (0.5 * h / size) * tangent
    by_tangent = (0.5 * h / size) * (rate - (2.0 * dot(rate, tangent) / size) * tangent)
    return Rest(by_rate, by_tangent, dot(by_rate, rate_s) + dot(by_tangent, tangent_s)), lo, hi


@put_start.register(Sliding)
@kernel
def put_start_of_sliders(term, system, steps, h, k):
    put_start_along.call(term.along, term, system, steps, h, k)


@generic
def put_start_along(along, term, system, steps, h, k):
    """Run `put_start` for the slider forces `along`."""


@put_start_along.register(NoForceAlong)
@kernel
def start_is_symmetric(along, term, system, steps, h, k):
    pass


@put_start_along.register(TakenAlong)
@kernel
def put_start_of_held(along, term, system, steps, h, k):
    corner, at = system.contact.corner, 9 * dim(system.dofs)
    for i in range(along.friction.shape[0]):
        if along.drive[i] == POSITION:
            corner[i, at] = 0.0
        elif along.drive[i] == INCREMENT:
            corner[i, at] *= -1.0
        elif sticks(along, i):
            by_s = 0.0
            if along.coulomb.rest[i] != 0.0:
                rest, lo, hi = rest_of(term, system, steps, h, k, i)
                by_s = rest.by_s
            corner[i, at] *= -(1.0 + by_s)


@add_start.register(Sliding)
@kernel
def add_start_of_sliders(term, border, system, adjoint, steps, h, k):
    add_start_along.call(term.along, term, border, system, adjoint, steps, h, k)


@generic
def add_start_along(along, term, border, system, adjoint, steps, h, k):
    """Run `add_start` for the slider forces `along`."""


@add_start_along.register(NoForceAlong)
@kernel
def start_is_known(along, term, border, system, adjoint, steps, h, k):
    pass


@add_start_along.register(TakenAlong)
@kernel
def add_start_of_held(along, term, border, system, adjoint, steps, h, k):
    dofs, basis = system.dofs, system.contact.basis
    d, size = dim(dofs), coordinates(dofs)
    for i in range(along.friction.shape[0]):
        if not sticks(along, i) or along.coulomb.rest[i] == 0.0:
            continue
        rest, lo, hi = rest_of(term, system, steps, h, k, i)
        factor = along.clock[2] / (h * h) * border.y[(2 * d + 1) * i + d]
        nodes = nodes_of.call(term.curves, term.sliders.curve[i])
        for a in range(lo, hi):
            at = slot.call(nodes, a)
            o = size * node_of.call(nodes, a)
            add_to(adjoint.forces, o, 1, (factor * basis[1, at]) * rest.by_tangent)
            add_to(adjoint.rate, o, 1, (-factor * basis[0, at]) * rest.by_rate)
        add_to(adjoint.rate, size * term.sliders.point[i], 1, factor * rest.by_rate)


# --- derivatives ------------------------------------------------------------------------------------------------------------
@add_slides.register(Sliding)
@kernel
def add_slides_of_sliders(term, border, system, found, h, k):
    add_slides_along.call(term.along, term, border, system, found, h, k)


@generic
def add_slides_along(along, term, border, system, found, h, k):
    """Run `add_slides` for the slider forces `along`."""


@add_slides_along.register(NoForceAlong)
@kernel
def add_free_slides(along, term, border, system, found, h, k):
    d = dim(system.dofs)
    for i in range(found.along.shape[1]):
        found.along[k, i] = border.y[(2 * d + 1) * i + d]


@add_slides_along.register(TakenAlong)
@kernel
def add_taken_slides(along, term, border, system, found, h, k):
    d = dim(system.dofs)
    for i in range(found.along.shape[1]):
        share = border.y[(2 * d + 1) * i + d]
        if is_prescribed(along, i):
            found.place[k, i] = along.clock[2] / (h * h) * share
        elif not sticks(along, i):
            ds = system.work.s_end[i] - system.state.s[i]
            found.along[k, i] = share
            found.viscous[i] -= share * ds / h
            found.friction[i] -= share * rubbed(along, term, system, i, ds)


@kernel
def rubbed(along, term, system, i, ds):
    """Return the friction force of slider i per coefficient, against growing s."""
    nodes, lo, hi = begin_passage(term, system, i)
    tangent = mean_tangent(pass_along(system.contact.basis, nodes, lo, hi, system, term.sliders.spin_root))
    force = vector(system.state.force, system.contact.first_force[i], 1, system.dofs)
    press = pressing(force, tangent, force_of_edges.call(term.sleeves, system, i))
    sign = np.tanh(ds / (along.clock[0] * along.smoothing[i])) if along.smoothing[i] > 0.0 else 1.0 * along.coulomb.sign[i]
    return sign * (press.normal + press.edges) * press.long


# --- moments of sleeves -----------------------------------------------------------------------------------------------------
@generic
def spin_at(dofs, x, o):
    """Return the spin of rows x from offset o on, in a plane a number."""


@spin_at.register(Space)
@kernel
def spin_in_space(dofs, x, o):
    return ld3(x, o, 1)


@spin_at.register(Plane)
@kernel
def spin_in_plane(dofs, x, o):
    return x[o]


@add_turning.register(Sliding)
@kernel
def add_turning_of_sliders(term, system, x, rows_out):
    add_turning_in.call(term.sleeves, term, system, x, rows_out)


@generic
def add_turning_in(sleeves, term, system, x, rows_out):
    """Run `add_turning` for these sleeves."""


@add_turning_in.register(NoSleeves)
@kernel
def nothing_turns(sleeves, term, system, x, rows_out):
    pass


@add_turning_in.register(Sleeves)
@kernel
def add_turning_in_sleeves(sleeves, term, system, x, rows_out):
    for k in range(term.sliders.point.shape[0]):
        if sleeves.of_slider[k] >= 0:
            add_turning_of(sleeves, term, system, k, x, rows_out)


@kernel
def add_turning_of(sleeves, term, system, k, x, rows_out):
    """Add `add_turning` of slider k: moments on a node turn with its own spin, not with that of the holder."""
    work, contact, dofs = system.work, system.contact, system.dofs
    d = dim(dofs)
    o = sleeves.of_slider[k]
    c = sleeves.first[0] + o
    point = term.sliders.point[k]
    at_holder = 8 * system.row_of[term.sliders.spin_root[point]] + d
    held = contact.forces[c]
    holder = holder_of(sleeves, term, system, k, o, held)
    nodes, lo, hi = begin_passage(term, system, k)
    for a in range(lo, hi):
        i = slot.call(nodes, a)
        node = node_of.call(nodes, a)
        at = 8 * system.row_of[term.sliders.spin_root[node]] + d
        turn = spin_at.call(dofs, x, at) - spin_at.call(dofs, x, at_holder)
        left = cross_product.call(director.call(dofs, work.q_end, node, 1), spin_cross.call(turn, holder.second_mid))
        if held > 1:
            left += cross_product.call(director.call(dofs, work.q_end, node, 2), spin_cross.call(turn, holder.third_mid))
        factor = 0.25 * (contact.basis[0, i] + contact.basis[1, i])
        add_to(rows_out, at, 1, -factor * left)
        add_to(rows_out, at_holder, 1, factor * left)
