"""Sliding contact of a point on the curve of a beam: the discrete gradient of theory.md 5.1.

With the force F = sum lam_i d_i,mid as unknown instead of the multipliers, the directors of the frame drop out of the equations:
only the Cayley vector theta of the frame in this step is left. Any rotation that moves with the structure will do; here the
frame turns with the curve under the contact, theta = sum_A N_A,mean theta_A: it favours no node and is symmetric in time.

    force       +F on the point, -N_A,mean F on node A, moment N_A,mean F x g_mean on node A,
                g_mean = phi_S,mid - sum_A N_A,mean phi_A,mid
    sliding     F . (T_n + T_n+1)/2 + 1/4 (theta x F) . (T_n+1 - T_n) = 0,   T_k = sum_A N[s_n, s_n+1]_A phi_A(k)        (5.3)
    gap         phi_S - sum_A N_A(s) phi_A = 0 at n+1                                                                     (5.4)

Each slider is a border of 7 on the matrix of the nodes: F (3), s, and g_mean (3), which keeps the frame's moment from coupling
nodes that no element joins; in a plane of 5, with a Cayley number for the frame. Friction, drives and stops change the sliding
equation (along.py).

Arrays: q, v [12 N], in a plane [4 N]; s, s_out [S]; force_out [3 S], in a plane [2 S]; past [*] as in `nodes.remember`;
spin_root [N]; basis [5, n] as `Contact.basis`; counts_out [4 or 5].
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .._generic import generic
from .._jit import inlined, kernel, separate
from .algebra import dot
from .curves import find_element, node_of, nodes_of, nodes_under, point_on_curve, slot, step_basis
from .kinds import (add_to, cayley_vector, coordinates, cross_product, dim, on_spin, position, put, put_cross_matrix, spin_cross,
                    vector, zero_spin, zero_vector)
from .terms import Conserving, NoTies, account, assemble, first_guess, is_settled, take_unknowns, within_limits


END_SLACK = 1e-12


class Sliders(NamedTuple):
    """One row a slider."""

    curve: np.ndarray       # int64 [S]
    point: np.ndarray       # int64 [S]: node of the sliding point
    spin_root: np.ndarray   # int64 [N]: the node whose spin a node shares


class Sliding(NamedTuple):
    """The term of all sliders; their work arrays are `System.contact`."""

    curves: Any             # curves.Curves or curves.Paths
    sliders: Sliders
    ties: Any               # ties.Ties, planar_nodes.PlanarTies or NoTies
    limits: np.ndarray      # float64 [S, 3]: arc lengths between which each slider may go, those of its curve or of rigid stops,
    #                         and by how much it may be beyond
    along: Any              # along.Along or NoForceAlong
    sleeves: Any            # sleeve.Sleeves or NoSleeves


class NoForceAlong(NamedTuple):
    """Of sliders without friction, drives and stops."""


class NoSleeves(NamedTuple):
    """Of sliders that hold no direction of the section."""


class Contact(NamedTuple):
    """Work of all constraints with multipliers: the sliders come first, then joints, then moments of sleeves; S constraints, `E`
    entries each at most."""

    basis: np.ndarray       # float64 [5, n]: N(s_n), N(s_n+1), N'(s_n+1), N[s_n, s_n+1], its derivative by s_n+1
    legendre: np.ndarray    # float64 [3, n_coef]
    entries: np.ndarray     # int64 [S]: number of entries
    row: np.ndarray         # int64 [S, E]: row of the residual
    column: np.ndarray      # float64 [S, 48 E]: column[6 x 8] of every entry, derivative of the rows by the border unknowns
    line: np.ndarray        # float64 [S, 48 E]: derivative of the border equations by the unknowns of the row, transposed
    corner: np.ndarray      # float64 [S, 64]
    residual: np.ndarray    # float64 [S, 8]
    element: np.ndarray     # int64 [S]: element of s_n, a hint
    forces: np.ndarray      # int64 [S]: number of forces, as many equations come first, gaps
    first: np.ndarray       # int64 [S]: number of the first unknown among those of all constraints
    first_force: np.ndarray  # int64 [S]: number of the first force
    compliance: np.ndarray  # float64 [S]: of the parts that each slider joins, in a step
    softness: np.ndarray    # float64 [S]: share of augmented[0] that it has
    remaining: np.ndarray   # float64 [S]: gap that the augmented Lagrangian leaves after the last iteration
    full: np.ndarray        # int64 [1]: 1 where a slider had more entries than there is room for
    augmented: np.ndarray   # float64 [4]: 1/factor of theory.md (5.5), least compliance of the parts, 1 in the first iteration,
    #                         largest increment of s
    pair: np.ndarray        # int64 [O, 2]: of every sleeve its slider and the constraint of its moments
    cross: np.ndarray       # float64 [O, 2, 8]: derivatives of the sliding equation by the unknowns of the moments, and of the
    #                         equations of the moments by s
    before: np.ndarray = np.zeros(0)  # float64 [S]: of joints the gap that was left when it was last looked at in this step


class ContactInRows(Contact):
    """Contact of scenes whose constraints are rows of the block matrix (constraints.py), not a dense border."""


class ContactOfCarriers(Contact):
    """Contact of scenes whose sliders are all eliminated with their beams (carriers.py): it has no entries."""


class SlidingLaw(NamedTuple):
    """Sliding equation (5.6) of one slider, force . T + rest = 0, with T of the step."""

    force: Any      # the contact force; with friction also what changes with T
    tangent: Any    # derivative of the equation by the contact force: T, with friction also what changes with the force
    rest: float     # minus the forces along the beam
    slope: float    # derivative of what is not force . T by s at the end of the step
    share: float    # of (5.6) in it: 1, or 0 where the increment of s is given
    rub: float      # derivative by `force_of_edges`


@generic
def sliding_law(along, term, system, k, force, tangent, push):
    """The `SlidingLaw` of slider k for its contact force, the tangent T of the step and the push of moments along the beam."""


@generic
def begin_along(along, term, system, h):
    """Forces along the beam: after the first guess of a step of size h."""


@generic
def is_settled_along(along, term, system):
    """Whether forces along the beam are those of the step, when Newton's method has converged."""


@generic
def account_along(along, term, system, h):
    """Work of forces along the beam in a converged step."""


@generic
def add_contact(along, term, system, k):
    """Rows of slider k: `add_slider`, or those of one that has left its beam."""


@sliding_law.register(NoForceAlong)
@kernel
def slide_freely(along, term, system, k, force, tangent, push):
    return SlidingLaw(force, tangent, -push, 0.0, 1.0, 0.0)


@begin_along.register(NoForceAlong)
@account_along.register(NoForceAlong)
@kernel
def no_force_along(along, term, system, h):
    pass


@is_settled_along.register(NoForceAlong)
@kernel
def no_force_is_settled(along, term, system):
    return True


@generic
def push_of_moments(sleeves, term, system, k, nodes, lo, hi):
    """What the moments of slider k add to the force along the beam, (5.10), N: lo to before hi of `nodes_of` its curve are under
    it."""


@generic
def hold_section(sleeves, term, system, k, nodes, lo, hi, law):
    """Conditions on the direction of the section where slider k is a sleeve, after `add_slider`; law: its `SlidingLaw`."""


@push_of_moments.register(NoSleeves)
@kernel
def push_of_no_moments(sleeves, term, system, k, nodes, lo, hi):
    return 0.0


@hold_section.register(NoSleeves)
@kernel
def hold_no_section(sleeves, term, system, k, nodes, lo, hi, law):
    pass


@generic
def tied_arm(ties, e, q):
    """Offset of entry e of tied nodes of kind 1, a point carried on an arm, at coordinates q."""


@kernel
def predict_sliders(curves, sliders, contact, q, v, s, h, c, past, s_out, force_out, dofs):
    """First guess of s and force: as `nodes.predict`; where c is NaN the rate by least squares of v_S - sum N_A v_A = c' ds/dt
    (theory.md 5.4) and the force of the last step."""
    d = dim(dofs)
    m = (d + 1) * s.shape[0]
    for k in range(sliders.curve.shape[0]):
        b = sliders.curve[k]
        e = find_element.call(curves, b, s[k], contact.element[k])
        contact.element[k] = e
        if c == c:
            i = 4 + (d + 1) * k
            s_out[k] = s[k] + h * ((1.0 + c) * past[i] - c * past[i + m])
            put(force_out, d * k, 1, (1.0 + c) * vector(past, i + 1, 1, dofs) - c * vector(past, i + m + 1, 1, dofs))
        else:
            tangent, relative = motion_along(curves, sliders, contact, q, v, s[k], k, e, dofs)
            s_out[k] = s[k] + h * dot(relative, tangent) / dot(tangent, tangent)


@kernel
def motion_along(curves, sliders, contact, q, v, s, k, e, dofs):
    """Derivative by s of the curve under slider k at s, in element e, and the velocity of the sliding point relative to it."""
    b = sliders.curve[k]
    tangent = point_on_curve(curves, b, s, q, e, contact, 1, dofs)
    return tangent, position(v, sliders.point[k], dofs) - point_on_curve(curves, b, s, v, e, contact, 0, dofs)


@kernel
def new_entry(contact, k, row, dofs):
    """Offset of a new entry of slider k, filled with zeros. Where the arrays are full it is the last entry again, and `full` is
    set."""
    m = contact.entries[k]
    if m == contact.row.shape[1]:
        contact.full[0] = 1
        m -= 1
    n = 8 * len(dofs)
    contact.entries[k] = m + 1
    contact.row[k, m] = row
    for i in range(n * m, n * m + n):
        contact.column[k, i] = 0.0
        contact.line[k, i] = 0.0
    return n * m


@kernel
def entry_of(contact, k, row, dofs):
    """Offset of an entry of constraint k for a row: the one that it has, or a new one."""
    for m in range(contact.entries[k]):
        if contact.row[k, m] == row:
            return 8 * len(dofs) * m
    return new_entry(contact, k, row, dofs)


class Weights(NamedTuple):
    """How a node takes part in a contact."""

    mean: float     # share of the force; the mean gap changes with -mean/2 of its position
    end: float      # the gap at the end of the step changes with -end of its position
    slope: float    # derivative of `mean` by the place of the slider at the end


@kernel
def put_position(contact, k, row, weights, f, slide, dofs):
    """Entry of a position, which takes weights.mean of the force f; slide: derivative of the sliding equation by the position.
    Returns its offset."""
    o = new_entry(contact, k, row, dofs)
    d = dim(dofs)
    column = contact.column[k]
    line = contact.line[k]
    for i in range(d):
        column[o + 8 * i + i] = weights.mean
        line[o + 8 * i + i] = -weights.end
        line[o + 8 * i + d + 1 + i] = 0.5 * weights.mean
    put(column, o + d, 8, weights.slope * f)
    put(line, o + d, 8, slide)
    return o


@kernel
def put_arm(contact, k, row, arm_mid, arm_end, weights, f, slide, dofs):
    """Entry of the spin of a node that carries the position of `put_position` on an arm."""
    d = dim(dofs)
    o = new_entry(contact, k, row, dofs) + 8 * d
    column = contact.column[k]
    line = contact.line[k]
    put_cross_matrix(column, o, weights.mean, arm_mid)
    put(column, o + d, 8, cross_product.call(arm_mid, weights.slope * f))
    put_cross_matrix(line, o, -weights.end, arm_end)
    put_cross_matrix(line, o + d + 1, 0.5 * weights.mean, arm_end)
    put(line, o + d, 8, cross_product.call(arm_end, slide))


@generic
def put_translation(ties, contact, k, node, row, work, weights, f, slide, dofs):
    """Entry of the position of one node as in `put_position`; tied nodes pass it on. Returns the offset of the node's own entry,
    -1 where it is tied."""


@put_translation.register(NoTies)
@kernel
def put_free_translation(ties, contact, k, node, row, work, weights, f, slide, dofs):
    return put_position(contact, k, row, weights, f, slide, dofs)


@kernel
def put_tied_translation(ties, contact, k, node, row, work, weights, f, slide, dofs):
    """`put_translation` where there are tied nodes."""
    if ties.start[node + 1] > ties.start[node]:
        for t in range(ties.start[node], ties.start[node + 1]):
            if ties.kind[t] == 0:
                put_position(contact, k, ties.target_row[t], weights, f, slide, dofs)
            elif ties.kind[t] == 1:
                put_arm(contact, k, ties.target_row[t], tied_arm.call(ties, t, work.q_mid), tied_arm.call(ties, t, work.q_end),
                        weights, f, slide, dofs)
        return -1
    return put_position(contact, k, row, weights, f, slide, dofs)


class Passage(NamedTuple):
    """The curve under a slider in one step, theory.md (5.3), (5.4)."""

    end: Any        # position at the end of the step, and its derivative by s there
    end_s: Any
    mean: Any       # mean position, sum of mean shape functions and mean coordinates, and twice its derivative by s at the end
    mean_s: Any
    t0: Any         # tangents T with the coordinates at the start and at the end, and their derivatives by s at the end
    t1: Any
    dt0: Any
    dt1: Any
    turn: Any       # Cayley vector of the frame, and its derivative by s at the end
    turn_s: Any


@inlined
def pass_along(basis, nodes, lo, hi, system, spin_root):
    """The `Passage` of a slider over nodes lo to before hi of a curve; nodes: `nodes_of` the curve."""
    q, work, dofs = system.state.q, system.work, system.dofs
    end = zero_vector(dofs); end_s = zero_vector(dofs); mean = zero_vector(dofs); mean_s = zero_vector(dofs)
    t0 = zero_vector(dofs); t1 = zero_vector(dofs); dt0 = zero_vector(dofs); dt1 = zero_vector(dofs)
    turn = zero_spin(dofs); turn_s = zero_spin(dofs)
    for a in range(lo, hi):
        i = slot.call(nodes, a)
        node = node_of.call(nodes, a)
        n_mean = 0.5 * (basis[0, i] + basis[1, i])
        x0 = position(q, node, dofs); x1 = position(work.q_end, node, dofs); xm = position(work.q_mid, node, dofs)
        end += basis[1, i] * x1
        end_s += basis[2, i] * x1
        mean += n_mean * xm
        mean_s += basis[2, i] * xm
        t0 += basis[3, i] * x0; t1 += basis[3, i] * x1
        dt0 += basis[4, i] * x0; dt1 += basis[4, i] * x1
        x = cayley_vector(work.theta, spin_root[node], dofs)
        turn += n_mean * x
        turn_s += (0.5 * basis[2, i]) * x
    return Passage(end, end_s, mean, mean_s, t0, t1, dt0, dt1, turn, turn_s)


@inlined
def begin_passage(term, system, k):
    """`nodes_of` the curve of slider k, the first of them under it in the step and the one behind the last; their basis."""
    curves, state, work, contact = term.curves, system.state, system.work, system.contact
    c = term.sliders.curve[k]
    e0 = find_element.call(curves, c, state.s[k], contact.element[k])
    e1 = find_element.call(curves, c, work.s_end[k], e0)
    lo, hi = nodes_under.call(curves, c, e0, e1)
    step_basis(curves, c, state.s[k], work.s_end[k], e0, e1, lo, hi, contact)
    return nodes_of.call(curves, c), lo, hi


@kernel
def put_curve(term, system, k, nodes, lo, hi, way, law, slide):
    """Rows of the residual and entries of the nodes under slider k: forces +N F, moments of the frame -N F x g_mean; `slide`
    times N[s_n, s_n+1] is the derivative of the sliding equation by a position."""
    work, contact, dofs, row_of = system.work, system.contact, system.dofs, system.row_of
    d = dim(dofs)
    basis = contact.basis
    f = vector(system.state.force, contact.first_force[k], 1, dofs)
    g_mean = position(work.q_mid, term.sliders.point[k], dofs) - way.mean
    moment = cross_product.call(g_mean, f)
    across = cross_product.call(law.force, way.t1 - way.t0)
    for a in range(lo, hi):
        i = slot.call(nodes, a)
        node = node_of.call(nodes, a)
        weights = Weights(0.5 * (basis[0, i] + basis[1, i]), basis[1, i], 0.5 * basis[2, i])
        root = term.sliders.spin_root[node]
        add_to(work.r, 8 * row_of[node], 1, weights.mean * f)
        add_to(work.r, 8 * row_of[root] + d, 1, weights.mean * moment)
        o = put_translation.call(term.ties, contact, k, node, row_of[node], work, weights, f, basis[3, i] * slide, dofs)
        if o < 0 or root != node:
            o = new_entry(contact, k, row_of[root], dofs)
        # the node's share in the frame: its moment n_mean g_mean x F, its theta in the sliding equation
        column = contact.column[k]
        put_cross_matrix(column, o + 8 * d, weights.mean, g_mean)
        put_cross_matrix(column, o + 9 * d + 1, -weights.mean, f)
        put(column, o + 9 * d, 8, weights.slope * moment)
        turned = on_spin.call(cayley_vector(work.theta, root, dofs), (0.25 * weights.mean) * across)
        put(contact.line[k], o + 9 * d, 8, turned)


@add_contact.register(NoForceAlong)
@separate
def add_slider(along, term, system, k):
    """Forces of slider k into the residual and its border into `system.contact`."""
    state, work, contact, dofs = system.state, system.work, system.contact, system.dofs
    d = dim(dofs)
    nodes, lo, hi = begin_passage(term, system, k)
    f = vector(state.force, contact.first_force[k], 1, dofs)
    way = pass_along(contact.basis, nodes, lo, hi, system, term.sliders.spin_root)
    jump = way.t1 - way.t0
    push = push_of_moments.call(term.sleeves, term, system, k, nodes, lo, hi)
    law = sliding_law.call(term.along, term, system, k, f, mean_tangent(way), push)
    turned = spin_cross.call(way.turn, law.force)
    slide = 0.5 * law.force + 0.25 * turned
    back = 0.5 * law.force - 0.25 * turned
    contact.entries[k] = 0
    put_curve(term, system, k, nodes, lo, hi, way, law, slide)
    # -F on the point
    point = term.sliders.point[k]
    add_to(work.r, 8 * system.row_of[point], 1, -1.0 * f)
    put_translation.call(term.ties, contact, k, point, system.row_of[point], work, Weights(-1.0, -1.0, 0.0), f, zero_vector(dofs),
                         dofs)
    # corner: rows gap, sliding, g_mean against F, s, g_mean
    corner = contact.corner[k]
    for i in range(64):
        corner[i] = 0.0
    put(corner, d, 8, -1.0 * way.end_s)
    put(corner, 8 * d, 1, law.tangent)
    corner[9 * d] = (dot(slide, way.dt1) + dot(back, way.dt0) + 0.25 * dot(spin_cross.call(way.turn_s, law.force), jump)
                     + law.slope)
    put(corner, 9 * d + 8, 8, 0.5 * way.mean_s)
    put_residual(contact, k, position(work.q_end, point, dofs) - way.end,
                 dot(slide, way.t1) + dot(back, way.t0) + law.rest, dofs)
    hold_section.call(term.sleeves, term, system, k, nodes, lo, hi, law)


@kernel
def mean_tangent(way):
    """T of (5.3): F . T = F . (T_n + T_n+1)/2 + 1/4 (theta x F) . (T_n+1 - T_n)."""
    return 0.5 * (way.t0 + way.t1) - 0.25 * spin_cross.call(way.turn, way.t1 - way.t0)


@kernel
def put_residual(contact, k, gap, sliding, dofs):
    """Residuals of the border of slider k, and the equation g_mean = mean gap, which holds whatever the increment."""
    d = dim(dofs)
    residual = contact.residual[k]
    put(residual, 0, 1, gap)
    residual[d] = sliding
    for i in range(d + 1, 2 * d + 1):
        contact.corner[k, 9 * i] = 1.0
        residual[i] = 0.0


# --- as a term of a step ------------------------------------------------------------------------------------------------
@first_guess.register(Sliding)
@kernel
def predict_sliding(term, system, h, c):
    state, work = system.state, system.work
    predict_sliders(term.curves, term.sliders, system.contact, state.q, state.v, state.s, h, c, work.past, work.s_end,
                    state.force, system.dofs)
    begin_along.call(term.along, term, system, h)


@assemble.register(Sliding, Conserving)
@kernel
def assemble_sliding(term, method, system, h):
    for k in range(term.sliders.curve.shape[0]):
        add_contact.call(term.along, term, system, k)


@take_unknowns.register(Sliding)
@kernel
def move_sliders(term, system):
    """Add the solved unknowns of all sliders to forces and positions."""
    state, work, contact, d = system.state, system.work, system.contact, dim(system.dofs)
    for k in range(state.s.shape[0]):
        for c in range(d):
            state.force[contact.first_force[k] + c] += work.y[contact.first[k] + c]
        z = work.y[contact.first[k] + d]
        work.s_end[k] += z
        if abs(z) > contact.augmented[3] or z != z:
            contact.augmented[3] = abs(z)


@is_settled.register(Sliding)
@kernel
def gaps_are_closed(term, system):
    """Whether the augmented Lagrangian of the last iteration leaves gaps of round-off size only."""
    contact, q, dofs = system.contact, system.state.q, system.dofs
    for k in range(term.sliders.point.shape[0]):
        p = coordinates(dofs) * term.sliders.point[k]
        reach = 0.0
        for c in range(dim(dofs)):
            reach = max(reach, abs(q[p + c]))
        if not contact.remaining[k] <= 1e-15 * (system.length + reach):
            return False
    return is_settled_along.call(term.along, term, system)


@account.register(Sliding)
@kernel
def account_sliding(term, system, h):
    account_along.call(term.along, term, system, h)


@within_limits.register(Sliding)
@kernel
def sliders_are_within(term, system, counts_out):
    """False where a slider is beyond the end of its curve or a rigid stop by more than round-off; its number goes to
    counts_out[3]."""
    s = system.state.s
    for k in range(s.shape[0]):
        slack = term.limits[k, 2]
        if not (s[k] >= term.limits[k, 0] - slack and s[k] <= term.limits[k, 1] + slack):
            counts_out[3] = k
            return False
    return True
