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
equation (contact/slider_forces.py).

Arrays: q, v [12 N], in a plane [4 N]; s, s_out [S]; history [*]; force_out [3 S], in a plane [2 S]; past [*] as in
`nodes.remember`; spin_root [N]; basis [5, n] as `Contact.basis`; counts_out [4 or 5].
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import (
    add_to,
    cayley_vector,
    coordinates,
    cross_product,
    dim,
    on_spin,
    position,
    put,
    spin,
    spin_cross,
    vector,
    zero_spin,
    zero_vector,
)
from fastbeam.kernels.algebra.vectors import dot
from fastbeam.kernels.contact.curves import add_basis, find_element, node_of, nodes_of, nodes_under, slot, step_basis
from fastbeam.kernels.contact.moving_places import entries_of_border, is_on_node, on_mesh
from fastbeam.kernels.entries.dense import Contact, Frame, Weights, put_corner, put_frame, put_node, put_translation
from fastbeam.kernels.entries.factored import FactoredContact
from fastbeam.kernels.jit.decorators import inlined, kernel, separate
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.terms import (
    Conserving,
    Equilibrium,
    WithContact,
    account,
    assemble,
    first_guess,
    is_settled,
    take_unknowns,
    within_limits,
)

END_SLACK = 1e-12


class Following(NamedTuple):
    """Sliders whose contacts are element ends that move with them (theory.md 5.12), F of S sliders, and numbers of one run that
    their terms share with those of the beams. A row of `border` has the derivatives of the force and the moment on a node by the
    place of a contact, and those of the force on this place by the position and the spin of the node."""

    at: np.ndarray       # int64 [S, 4]: number among these, node counted along the curve, place of ds/dt in the history, that of
    #                      the increment of s among the unknowns of constraints; or -1
    nodes: np.ndarray    # int64 [F, M]: nodes of the elements on both sides of a contact, element ends first, or -1
    ends: np.ndarray     # int64 [F]: number of element ends among these
    border: np.ndarray   # float64 [F, M, 12]
    pull: np.ndarray     # float64 [F, 3]: force of the beam on the place, N, its derivative by the place at the end, and what it
    #                      gains as inner nodes move under their own residual
    cross: np.ndarray    # float64 [F, 2]: derivatives of that force by the place of the next contact, and of that on the next
    tangent: np.ndarray  # float64 [F, 6]: tangent T of the step, a mean of both sides, and its derivative by the place at the end
    slope: np.ndarray    # float64 [F, M]: derivative of that by the positions of the nodes at the end
    pair: np.ndarray     # int64 [F]: number in `Contact.pair` of the pair of a contact and the next on its beam, or -1
    way: np.ndarray      # float64 [F, 2]: increments of the places in the step, and in the last iteration, m
    gravity: np.ndarray  # float64 [1]: factor of gravity on their beams
    condensed: np.ndarray  # int64 [F, 4]: what is eliminated, as in moving_places.py, the same for all contacts of a beam
    reach: np.ndarray    # float64 [F, 4]: where the beam ends, and
    shift: np.ndarray    # float64 [F, 5]: how element ends follow there, as in moving_places.py


def no_following(sliders: int) -> Following:
    """Return the record of sliders on meshes that stand."""
    none = np.zeros(0, np.int64)
    return Following(np.full((sliders, 4), -1), np.zeros((0, 1), np.int64), none, np.zeros((0, 1, 12)), np.zeros((0, 3)),
                     np.zeros((0, 2)), np.zeros((0, 6)), np.zeros((0, 1)), none, np.zeros((0, 2)), np.ones(1),
                     np.zeros((0, 4), np.int64), np.zeros((0, 4)), np.zeros((0, 5)))


# columns of `Following.at`
NUMBER, NODE, RATE, UNKNOWN = range(4)


class Sliders(NamedTuple):
    """Table of S sliders: contact curve, and node of the sliding point."""

    curve: np.ndarray       # int64 [S]
    point: np.ndarray       # int64 [S]: node of the sliding point
    spin_root: np.ndarray   # int64 [N]: the node whose spin a node shares
    following: Following


# column of `Sliding.limits` behind both ends
SLACK = 2


class Sliding(NamedTuple):
    """Term of all sliders; their work arrays are `System.contact`."""

    curves: Any             # curves.Curves or curves.Paths
    sliders: Sliders
    ties: Any               # ties.Ties, planar_nodes.PlanarTies or NoTies
    limits: np.ndarray      # float64 [S, 3]: arc lengths between which each slider may go, those of its curve or of rigid stops,
    #                         and by how much it may be beyond
    along: Any              # slider_forces.Along or NoForceAlong
    sleeves: Any            # sleeve.Sleeves or NoSleeves


Sliding.reads = WithContact  # type: ignore[attr-defined]
Sliding.stays_in_memory = True  # type: ignore[attr-defined]


class NoForceAlong(NamedTuple):
    """Placeholder for sliders without friction, drives and stops."""


class NoSleeves(NamedTuple):
    """Placeholder for sliders that do not fix the direction of the section."""


class SlidingLaw(NamedTuple):
    """Sliding equation (5.6) of one slider, force . T + rest = 0, with T of the step."""

    force: Any      # contact force; with friction also its derivative by T
    tangent: Any    # derivative of the equation by the contact force: T, with friction also that of friction
    rest: float     # minus the slider force, N
    slope: float    # derivative of `rest` by s at the end of the step
    share: float    # factor of (5.6) in the equation: 1, or 0 where the increment of s is prescribed
    rub: float      # derivative of the equation by `force_of_edges`


@generic
def sliding_law(along, term, system, k, force, tangent, push):
    """Return the `SlidingLaw` of slider k for its contact force, the tangent T of the step and the push of moments along the
    beam."""


@generic
def in_step(method, x):
    """Return x in a step, zero in an equilibrium: for the lever arm of the mean gap, and the turn of the frame."""


@in_step.register(object)
@inlined
def of_step(method, x):
    return x


@in_step.register(Equilibrium)
@inlined
def none_at_rest(method, x):
    """Return zero: the gap that an iteration leaves is no lever arm, as forces without moments are the gradient of the energy."""
    return 0.0 * x


@generic
def begin_along(along, term, system, h):
    """Prepare forces along the beam after the first guess of a step of size h."""


@generic
def is_settled_along(along, term, system):
    """Return whether forces along the beam are those of the step, when Newton's method has converged."""


@generic
def account_along(along, term, system, h):
    """Record the work of forces along the beam in a converged step."""


@generic
def note_passage(along, sleeves, term, system, k, nodes, lo, hi):
    """Keep shape functions of the curve under slider k from an iteration, for the energy account of the step."""


@note_passage.register(NoForceAlong)
@kernel
def note_no_passage(along, sleeves, term, system, k, nodes, lo, hi):
    pass


@generic
def add_contact(along, term, system, k):
    """Add the rows of slider k: `add_slider`, or those of one that has left its beam."""


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
def sums_of_sections(sleeves, system, k, nodes, lo, hi):
    """Return the sums that the moments of slider k need: lo to before hi of `nodes_of` its curve are under it."""


@generic
def push_of_moments(sleeves, sums, term, system, k):
    """Return the force along the beam, N, by the moments of slider k, (5.10), from `sums_of_sections`."""


@generic
def hold_section(sleeves, sums, term, system, k, nodes, lo, hi, law):
    """Add conditions on the direction of the section if slider k is a sleeve, after `add_slider`; law: its `SlidingLaw`."""


@sums_of_sections.register(NoSleeves)
@kernel
def no_sums(sleeves, system, k, nodes, lo, hi):
    return 0.0


@push_of_moments.register(NoSleeves)
@kernel
def push_of_no_moments(sleeves, sums, term, system, k):
    return 0.0


@hold_section.register(NoSleeves)
@kernel
def hold_no_section(sleeves, sums, term, system, k, nodes, lo, hi, law):
    pass


@kernel
def predict_sliders(curves, sliders, contact, state, h, c, past, s_out, force_out, dofs):
    """Predict s and force as `nodes.predict` does; where c is NaN the rate by least squares of v_S - sum N_A v_A = c' ds/dt
    (theory.md 5.4) and the force of the last step."""
    d = dim(dofs)
    s = state.s
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
            tangent, relative = motion_along(curves, sliders, contact, state.q, state.v, s[k], state.history, k, e, dofs)
            s_out[k] = s[k] + h * dot(relative, tangent) / dot(tangent, tangent)


@kernel
def motion_along(curves, sliders, contact, q, v, s, history, k, e, dofs):
    """Return the derivative by s of the curve under slider k at s, in element e, and the velocity of the sliding point relative
    to it; at an element end that moves with it, the axis of the section, and ds/dt times this."""
    b = sliders.curve[k]
    nodes = nodes_of.call(curves, b)
    at = sliders.following.at[k]
    if at[NODE] >= 0:
        axis = axis_of(q, node_of.call(nodes, at[NODE]), dofs)
        return axis, history[at[RATE]] * axis
    lo, hi = nodes_under.call(curves, b, e, e)
    for a in range(lo, hi):
        i = slot.call(nodes, a)
        contact.basis[0, i] = 0.0
        contact.basis[1, i] = 0.0
    add_basis.call(curves, b, e, s, 0, 1.0, 1.0, contact.legendre, contact.basis, 0)
    tangent = zero_vector(dofs)
    velocity = zero_vector(dofs)
    for a in range(lo, hi):
        i = slot.call(nodes, a)
        node = node_of.call(nodes, a)
        tangent += contact.basis[1, i] * position(q, node, dofs)
        velocity += contact.basis[0, i] * position(v, node, dofs)
    return tangent, position(v, sliders.point[k], dofs) - velocity


@inlined
def axis_of(q, node, dofs):
    """Return d_1 of a node, which is the first director in space and in a plane."""
    return vector(q, coordinates(dofs) * node + dim(dofs), 1, dofs)


class Passage(NamedTuple):
    """Contact curve of a slider in one step, theory.md (5.3), (5.4)."""

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
    """Return the `Passage` of a slider over nodes lo to before hi of a curve; nodes: `nodes_of` the curve."""
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
    """Form the basis of the nodes under slider k in the step; return `nodes_of` its curve, the first of them and the one behind
    the last."""
    curves, contact = term.curves, system.contact
    c, s0, s1 = term.sliders.curve[k], system.state.s[k], system.work.s_end[k]
    following = term.sliders.following
    a = following.at[k, NODE]
    if a < 0:
        lo, hi = begin_basis(curves, c, s0, s1, k, contact)
        return nodes_of.call(curves, c), lo, hi
    nodes, f = nodes_of.call(curves, c), following.at[k, NUMBER]
    if is_on_node(following, f, s0) and is_on_node(following, f, s1):
        for i in range(5):
            contact.basis[i, slot.call(nodes, a)] = 1.0 if i < 2 else 0.0
        return nodes, a, a + 1
    u = on_mesh(following, f, s0, s1)
    lo, hi = begin_basis(curves, c, u.start, u.end, k, contact)
    for a in range(lo, hi):
        i = slot.call(nodes, a)
        contact.basis[4, i] = u.mean * u.slope * contact.basis[4, i] + u.bend * contact.basis[3, i]
        contact.basis[3, i] *= u.mean
        contact.basis[2, i] *= u.slope
    return nodes, lo, hi


@kernel
def begin_basis(curves, c, s0, s1, k, contact):
    """Form the basis of the nodes of curve c between s0 and s1; return the first of them and the one behind the last."""
    e0 = find_element.call(curves, c, s0, contact.element[k])
    e1 = find_element.call(curves, c, s1, e0)
    lo, hi = nodes_under.call(curves, c, e0, e1)
    step_basis(curves, c, s0, s1, e0, e1, lo, hi, contact)
    return lo, hi


@kernel
def put_curve(term, system, k, nodes, lo, hi, frame):
    """Add rows of the residual and entries of the nodes under slider k: forces +N F, moments of the frame -N F x g_mean."""
    work, contact, dofs, row_of = system.work, system.contact, system.dofs, system.row_of
    d = dim(dofs)
    basis = contact.basis
    put_frame.call(contact, k, frame, dofs)
    for a in range(lo, hi):
        i = slot.call(nodes, a)
        node = node_of.call(nodes, a)
        weights = Weights(0.5 * (basis[0, i] + basis[1, i]), basis[1, i], 0.5 * basis[2, i], basis[3, i])
        root = term.sliders.spin_root[node]
        add_to(work.r, 8 * row_of[node], 1, weights.mean * frame.force)
        add_to(work.r, 8 * row_of[root] + d, 1, weights.mean * frame.moment)
        o = put_translation.call(term.ties, contact, k, node, row_of[node], work, weights, frame.force, frame.slide, dofs)
        turned = on_spin.call(cayley_vector(work.theta, root, dofs), (0.25 * weights.mean) * frame.across)
        put_node.call(contact, k, row_of[root], o if root == node else -1, turned, weights, frame, dofs)


@add_contact.register(NoForceAlong)
@separate
def add_slider(along, term, system, k):
    """Add forces of slider k to the residual and its border to `system.contact`."""
    state, work, contact, dofs = system.state, system.work, system.contact, system.dofs
    nodes, lo, hi = begin_passage(term, system, k)
    f = vector(state.force, contact.first_force[k], 1, dofs)
    way = pass_along(contact.basis, nodes, lo, hi, system, term.sliders.spin_root)
    note_passage.call(along, term.sleeves, term, system, k, nodes, lo, hi)
    jump = way.t1 - way.t0
    sums = sums_of_sections.call(term.sleeves, system, k, nodes, lo, hi)
    push = push_of_moments.call(term.sleeves, sums, term, system, k)
    own = tangent = mean_tangent(way)
    follows = term.sliders.following.at[k, NUMBER]
    if follows >= 0:
        # the force of the beam on the place stands for F . T, but for what the contact slides on the mesh
        tangent = vector(term.sliders.following.tangent[follows], 0, 1, dofs)
        push += dot(f, tangent - own) - term.sliders.following.pull[follows, 0]
    law = sliding_law.call(term.along, term, system, k, f, tangent, push)
    slides = law.share * f if follows >= 0 else law.force
    turned = in_step.call(system.method, spin_cross.call(way.turn, slides))
    slide = 0.5 * slides + 0.25 * turned
    back = 0.5 * slides - 0.25 * turned
    contact.entries[k] = 0
    point = term.sliders.point[k]
    gap = in_step.call(system.method, position(work.q_mid, point, dofs) - way.mean)
    put_curve(term, system, k, nodes, lo, hi,
              Frame(f, gap, cross_product.call(gap, f), slide, cross_product.call(slides, jump)))
    # force -F on the point
    add_to(work.r, 8 * system.row_of[point], 1, -1.0 * f)
    put_translation.call(term.ties, contact, k, point, system.row_of[point], work, Weights(-1.0, -1.0, 0.0, 0.0), f,
                         zero_vector(dofs), dofs)
    by_s = (dot(slide, way.dt1) + dot(back, way.dt0) + 0.25 * dot(spin_cross.call(way.turn_s, slides), jump)
            + law.slope)
    by_force, sliding = law.tangent, dot(slide, way.t1) + dot(back, way.t0) + law.rest
    if follows >= 0:
        by_force, sliding = law.tangent - law.share * (tangent - own), dot(law.force, tangent) + law.rest
        sliding += law.share * term.sliders.following.pull[follows, 2]
        by_s += law.share * term.sliders.following.pull[follows, 1]
        by_s += dot(law.force - law.share * f, vector(term.sliders.following.tangent[follows], 3, 1, dofs))
    put_corner.call(contact, k, way.end_s, 0.5 * way.mean_s, by_force, by_s, dofs)
    put_residual(contact, k, position(work.q_end, point, dofs) - way.end, sliding, dofs)
    hold_section.call(term.sleeves, sums, term, system, k, nodes, lo, hi, law)
    if follows >= 0:
        follow_contact.call(contact, term, system, k, law)


@generic
def follow_contact(contact, term, system, k, law):
    """Add to the border of slider k, whose contact is a node that moves with it, what the whole beam has in its sliding
    equation."""


@follow_contact.register(FactoredContact)
@kernel
def follow_no_contact(contact, term, system, k, law):
    pass


@follow_contact.register(Contact)
@kernel
def add_border_of_beam(contact, term, system, k, law):
    work, dofs, row_of = system.work, system.dofs, system.row_of
    following, spin_root = term.sliders.following, term.sliders.spin_root
    f = following.at[k, NUMBER]
    n = len(dofs)
    zero = zero_vector(dofs)
    still = zero_spin(dofs)
    # of friction
    by_tangent = law.force - law.share * vector(system.state.force, contact.first_force[k], 1, dofs)
    # the order of elimination follows the entries before
    contact.strong[k] = contact.entries[k]
    for m in range(entries_of_border(following, f)):
        at = following.nodes[f, m]
        if at < 0:
            break
        border = following.border[f, m]
        root = spin_root[at]
        by_position = law.share * vector(border, n, 1, dofs) + following.slope[f, m] * by_tangent
        o = put_translation.call(term.ties, contact, k, at, row_of[at], work, Weights(0.0, 0.0, 1.0, 1.0),
                                 vector(border, 0, 1, dofs), by_position, dofs)
        put_node.call(contact, k, row_of[root], o if root == at else -1, law.share * spin(border, n + dim(dofs), dofs),
                      Weights(0.0, 0.0, 1.0, 0.0), Frame(zero, zero, spin(border, dim(dofs), dofs), zero, still), dofs)
    if following.pair[f] >= 0:
        contact.cross[following.pair[f], 0, dim(dofs)] = law.share * following.cross[f, 0]
    if f > 0 and following.pair[f - 1] >= 0:
        contact.cross[following.pair[f - 1], 1, dim(dofs)] = law.share * following.cross[f - 1, 1]


@kernel
def pull_at_end(term, system, k):
    """Return the force of the beam on the place of slider k, whose contact is a node that moves with it, behind the last
    iteration. It has the round-off of the forces on nodes, which does no work with them."""
    following, x, dofs = term.sliders.following, system.work.increment.x, system.dofs
    f = following.at[k, NUMBER]
    out = following.pull[f, 0] + following.pull[f, 2] + following.pull[f, 1] * following.way[f, 1]
    if following.pair[f] >= 0:
        out += following.cross[f, 0] * following.way[f + 1, 1]
    if f > 0 and following.pair[f - 1] >= 0:
        out += following.cross[f - 1, 1] * following.way[f - 1, 1]
    n = len(dofs)
    for m in range(entries_of_border(following, f)):
        at = following.nodes[f, m]
        if at < 0:
            break
        for c in range(n):
            row = system.row_of[at if c < dim(dofs) else term.sliders.spin_root[at]]
            out += following.border[f, m, n + c] * x[8 * row + c]
    return out


@kernel
def mean_tangent(way):
    """Return T of (5.3): F . T = F . (T_n + T_n+1)/2 + 1/4 (theta x F) . (T_n+1 - T_n)."""
    return 0.5 * (way.t0 + way.t1) - 0.25 * spin_cross.call(way.turn, way.t1 - way.t0)


@kernel
def put_residual(contact, k, gap, sliding, dofs):
    """Store residuals of the border of slider k, and the equation g_mean = mean gap, which holds whatever the increment."""
    d = dim(dofs)
    residual = contact.residual[k]
    put(residual, 0, 1, gap)
    residual[d] = sliding
    for i in range(d + 1, 2 * d + 1):
        residual[i] = 0.0


# --- as a term of a step ------------------------------------------------------------------------------------------------
@first_guess.register(Sliding)
@kernel
def predict_sliding(term, system, h, c):
    state, work = system.state, system.work
    predict_sliders(term.curves, term.sliders, system.contact, state, h, c, work.past, work.s_end, state.force, system.dofs)
    begin_along.call(term.along, term, system, h)
    following = term.sliders.following
    for k in range(following.at.shape[0]):
        if following.at[k, NUMBER] >= 0:
            following.way[following.at[k, NUMBER], 0] = work.s_end[k] - state.s[k]


@assemble.register(Sliding, Conserving)
@kernel
def assemble_sliding(term, method, system, h):
    for k in range(term.sliders.curve.shape[0]):
        # sliders that are eliminated with their beams are skipped
        if system.contact.first[k] >= 0:
            add_contact.call(term.along, term, system, k)


@assemble.register(Sliding, Equilibrium)
@kernel
def assemble_sliding_at_rest(term, method, system, h):
    """Add the sliders of an equilibrium, where both ends of the step are the present shape."""
    state, work = system.state, system.work
    for k in range(state.s.shape[0]):
        work.s_end[k] = state.s[k]
    assemble_sliding(term, method, system, h)


@take_unknowns.register(Sliding)
@kernel
def move_sliders(term, system):
    """Add the solved unknowns of all sliders to forces and positions."""
    state, work, contact, d = system.state, system.work, system.contact, dim(system.dofs)
    for k in range(state.s.shape[0]):
        if contact.first[k] < 0:
            continue
        for c in range(d):
            state.force[contact.first_force[k] + c] += work.y[contact.first[k] + c]
        z = work.y[contact.first[k] + d]
        follows = term.sliders.following.at[k, NUMBER]
        if follows >= 0:
            # the rate of the place is not round-off of the place
            way = term.sliders.following.way[follows]
            way[0] += z
            way[1] = z
            work.s_end[k] = state.s[k] + way[0]
        else:
            work.s_end[k] += z
        if abs(z) > contact.augmented[3] or z != z:
            contact.augmented[3] = abs(z)


@is_settled.register(Sliding)
@kernel
def gaps_are_closed(term, system):
    """Return whether the augmented Lagrangian of the last iteration leaves gaps of round-off size only."""
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
    """Return whether all sliders are within the ends of their curves and rigid stops, to round-off; the number of one that is not
    goes to counts_out[3]."""
    s = system.state.s
    for k in range(s.shape[0]):
        slack = term.limits[k, SLACK]
        if not (s[k] >= term.limits[k, 0] - slack and s[k] <= term.limits[k, 1] + slack):
            counts_out[3] = k
            return False
    return True
