"""Sleeves: sliders that hold the direction of the section as well, theory.md 5.8.

The sliding point of a sleeve is its holder, a node with a triad. With D_1, D_2, D_3 fixed to the holder, D_1 along the beam, the
conditions are D_i . d_j(s) = 0 for the pairs (i, j) = (1, 2), (1, 3) and, where the sleeve is keyed, (2, 3); in a plane for (1,
2) alone. Their multipliers are moments, mu_ij; with means over the step

    director i of the holder  + mu_ij sum_A N_A,mean d_jA,mean         moment  mu_ij D_i,mean x sum_A N_A,mean d_jA,mean
    director j of node A      + mu_ij N_A,mean D_i,mean                moment  mu_ij N_A,mean d_jA,mean x D_i,mean
    sliding (5.3)             - mu_ij sum_A N[s_n, s_n+1]_A mean(D_i . d_jA)

The moments of a sleeve are a constraint of their own behind all others, coupled with the slider by s alone. Besides mu it has a
copy z of the holder's spin: moments turn with the nodes that they act on, and in the tangent all of these turn like the holder.
What is left out are the small differences of their spins times a moment, next to the bending stiffness of an element.

Arrays: q [12 N], in a plane [4 N]; basis [5, n] as `Contact.basis`; column, line as rows of `Contact.column`, `Contact.line`.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .._generic import generic
from .._jit import kernel
from .algebra import V2, V3, dot, f8, ld2, ld3, perp
from .along import Along, force_of_edges, last_passage, lead_passage
from .contact_entries import entry_of
from .curves import node_of, slot
from .joint_entries import take_forces_of
from .kinds import Plane, Space, add_stiffness, add_to, cross_product, dim, zero_vector
from .slider import Sliding, begin_passage, hold_section, mean_tangent, note_passage, pass_along, push_of_moments
from .terms import account, first_guess, is_settled, take_unknowns

# conditions that iterations leave open by round-off of directions
SETTLED = 4e-15


class Sleeves(NamedTuple):
    """O sleeves."""

    of_slider: np.ndarray  # int64 [S]: number of the sleeve that a slider is, or -1
    first: np.ndarray      # int64 [1]: number of the first constraint of moments
    keyed: np.ndarray      # int64 [O]: 1 where the twist is held, too
    axes: np.ndarray       # float64 [9 O]: R with D_i = sum_k R_ik d_k of the holder; in a plane [2 O], D_1 = (a, b) stands for
    #                        a u + b J u
    edges: np.ndarray      # float64 [2 O]: 2/length of the bore and 1/radius of the key, 1/m; 0 where that is not given
    twist: Any             # twist.Twist or NoTwist


class NoTwist(NamedTuple):
    """Of sleeves in which beams turn without friction."""


class KnownTwist(NamedTuple):
    """Of sleeves whose moments of friction are those of the state."""


class Rubbing(NamedTuple):
    """The term of sleeves that rub on beams that turn in them: what needs the curves of their sliders."""

    sleeves: Any           # Sleeves with a Twist
    sliding: Sliding


class Pair(NamedTuple):
    """Sums over the nodes under a sleeve for one pair of directors, D of the holder and d of nodes."""

    mean: Any      # sum of mean shape functions and mean d, and half its derivative by s at the end
    mean_s: Any
    mean_end: Any  # sum of mean shape functions and d at the end
    end: Any       # d at the end of the step, and its derivative by s
    end_s: Any
    t0: Any        # sums of divided differences and d at the start and at the end, and their derivatives by s at the end
    t1: Any
    dt0: Any
    dt1: Any


@generic
def director(dofs, q, node, j):
    """Director j = 0, 1, 2 of a node at coordinates q; in a plane 0 or 1."""


@director.register(Space)
@kernel
def director_in_space(dofs, q, node, j):
    return ld3(q, 12 * node + 3 + 3 * j, 1)


@director.register(Plane)
@kernel
def director_in_plane(dofs, q, node, j):
    u = ld2(q, 4 * node + 2, 1)
    return perp(u) if j == 1 else u


@generic
def holder_director(dofs, sleeves, o, i, q, node):
    """D_i of sleeve o from the triad of its holder."""


@holder_director.register(Space)
@kernel
def holder_director_in_space(dofs, sleeves, o, i, q, node):
    r = 9 * o + 3 * i
    return (sleeves.axes[r] * ld3(q, 12 * node + 3, 1) + sleeves.axes[r + 1] * ld3(q, 12 * node + 6, 1)
            + sleeves.axes[r + 2] * ld3(q, 12 * node + 9, 1))


@holder_director.register(Plane)
@kernel
def holder_director_in_plane(dofs, sleeves, o, i, q, node):
    u = ld2(q, 4 * node + 2, 1)
    return sleeves.axes[2 * o] * u + sleeves.axes[2 * o + 1] * perp(u)


@generic
def begin_twist(twist, sleeves, term, system, h):
    """After the first guess of a step of size h."""


@generic
def twist_rubs(twist, sleeves, term, system, k, o, nodes, lo, hi):
    """Right-hand side, corner and moment of the twist of sleeve o, slider k, which is not keyed: 1 where it has a condition, 0
    where its moment is known, -1 where there is none."""


@generic
def twist_is_settled(twist, sleeves, system):
    """Whether friction of twists is that of the step, when Newton's method has converged."""


@generic
def account_twist(twist, sleeves, term, system, h):
    """What friction of twists takes in a converged step, and where sections are."""


@twist_rubs.register(NoTwist)
@kernel
def twist_is_free(twist, sleeves, term, system, k, o, nodes, lo, hi):
    return -1.0


@twist_rubs.register(KnownTwist)
@kernel
def twist_is_known(twist, sleeves, term, system, k, o, nodes, lo, hi):
    system.contact.corner[sleeves.first[0] + o, 18] = 1.0
    system.contact.residual[sleeves.first[0] + o, 2] = 0.0
    return 0.0


@twist_is_settled.register(NoTwist)
@kernel
def no_twist_is_settled(twist, sleeves, system):
    return True


@generic
def add_double_cross(a, b, factor, column, at):
    """Add the matrix of factor a x (b x z) as a function of the spin z to column [*] at `at`, rows of 8."""


@add_double_cross.register(V3[f8])
@kernel
def add_double_cross_in_space(a, b, factor, column, at):
    add_stiffness(column, at, -factor * dot(a, b), factor * b, a)


@add_double_cross.register(V2[f8])
@kernel
def add_double_cross_in_plane(a, b, factor, column, at):
    column[at] -= factor * dot(a, b)


@kernel
def sum_pair(basis, system, nodes, lo, hi, j):
    """`Pair` of director j of lo to before hi of `nodes_of` a curve."""
    q, work, dofs = system.state.q, system.work, system.dofs
    mean = zero_vector(dofs); mean_s = zero_vector(dofs); mean_end = zero_vector(dofs)
    end = zero_vector(dofs); end_s = zero_vector(dofs)
    t0 = zero_vector(dofs); t1 = zero_vector(dofs); dt0 = zero_vector(dofs); dt1 = zero_vector(dofs)
    for a in range(lo, hi):
        i = slot.call(nodes, a)
        node = node_of.call(nodes, a)
        n_mean = 0.5 * (basis[0, i] + basis[1, i])
        d0 = director.call(dofs, q, node, j)
        d1 = director.call(dofs, work.q_end, node, j)
        dm = director.call(dofs, work.q_mid, node, j)
        mean += n_mean * dm
        mean_s += (0.5 * basis[2, i]) * dm
        mean_end += n_mean * d1
        end += basis[1, i] * d1
        end_s += basis[2, i] * d1
        t0 += basis[3, i] * d0; t1 += basis[3, i] * d1
        dt0 += basis[4, i] * d0; dt1 += basis[4, i] * d1
    return Pair(mean, mean_s, mean_end, end, end_s, t0, t1, dt0, dt1)


@kernel
def put_pair_on_nodes(term, system, k, c, p, moment, j, holder_mid, holder_end, nodes, lo, hi):
    """Moments of pair p of constraint c on the nodes under slider k, and the entries of their spins."""
    work, contact, dofs = system.work, system.contact, system.dofs
    d = dim(dofs)
    copy = len(dofs) - d
    for a in range(lo, hi):
        i = slot.call(nodes, a)
        node = node_of.call(nodes, a)
        row = system.row_of[term.sliders.spin_root[node]]
        n_mean = 0.5 * (contact.basis[0, i] + contact.basis[1, i])
        d_mid = director.call(dofs, work.q_mid, node, j)
        d_end = director.call(dofs, work.q_end, node, j)
        turning = cross_product.call(d_mid, holder_mid)
        at_end = cross_product.call(d_end, holder_end)
        add_to(work.r, 8 * row + d, 1, (-moment * n_mean) * turning)
        o = entry_of(contact, c, row, dofs) + 8 * d
        add_to(contact.column[c], o + p, 8, -n_mean * turning)
        add_to(contact.line[c], o + p, 8, contact.basis[1, i] * at_end)
        add_double_cross.call(holder_mid, d_end, -0.5 * moment * n_mean, contact.column[c], o + copy)
        add_double_cross.call(d_mid, holder_end, 0.5 * moment * n_mean, contact.column[c], o + copy)
        o = entry_of(contact, k, row, dofs) + 8 * d
        add_to(contact.column[k], o + d, 8, (-0.5 * moment * contact.basis[2, i]) * turning)


@kernel
def put_pair_on_holder(term, system, k, c, p, moment, sums, holder_mid, holder_end):
    """The same on the holder of slider k."""
    work, contact, dofs = system.work, system.contact, system.dofs
    d = dim(dofs)
    copy = len(dofs) - d
    row = system.row_of[term.sliders.spin_root[term.sliders.point[k]]]
    turning = cross_product.call(holder_mid, sums.mean)
    add_to(work.r, 8 * row + d, 1, -moment * turning)
    o = entry_of(contact, c, row, dofs) + 8 * d
    add_to(contact.column[c], o + p, 8, -1.0 * turning)
    add_to(contact.line[c], o + p, 8, cross_product.call(holder_end, sums.end))
    add_double_cross.call(sums.mean, holder_end, -0.5 * moment, contact.column[c], o + copy)
    add_double_cross.call(holder_mid, sums.mean_end, 0.5 * moment, contact.column[c], o + copy)
    o = entry_of(contact, k, row, dofs) + 8 * d
    add_to(contact.column[k], o + d, 8, -moment * cross_product.call(holder_mid, sums.mean_s))


@kernel
def put_push(term, system, k, p, moment, j, sums, holder_end, nodes, lo, hi):
    """Derivatives of the push of pair p along the beam by the spins of nodes and holder, in the sliding equation."""
    work, contact, dofs = system.work, system.contact, system.dofs
    d = dim(dofs)
    for a in range(lo, hi):
        i = slot.call(nodes, a)
        node = node_of.call(nodes, a)
        o = entry_of(contact, k, system.row_of[term.sliders.spin_root[node]], dofs) + 9 * d
        d_end = director.call(dofs, work.q_end, node, j)
        add_to(contact.line[k], o, 8, (-0.5 * moment * contact.basis[3, i]) * cross_product.call(d_end, holder_end))
    o = entry_of(contact, k, system.row_of[term.sliders.spin_root[term.sliders.point[k]]], dofs) + 9 * d
    add_to(contact.line[k], o, 8, (-0.5 * moment) * cross_product.call(holder_end, sums.t1))


@kernel
def begin_moments(term, system, k, c):
    """Clear the entries of constraint c, the moments of slider k; the copy of the holder's spin is that of the increment."""
    contact, dofs = system.contact, system.dofs
    d = dim(dofs)
    copy = len(dofs) - d
    contact.entries[c] = 0
    for i in range(64):
        contact.corner[c, i] = 0.0
    for i in range(8):
        contact.residual[c, i] = 0.0
    for i in range(copy, 8):
        contact.corner[c, 9 * i] = 1.0
    row = system.row_of[term.sliders.spin_root[term.sliders.point[k]]]
    o = entry_of(contact, c, row, dofs) + 8 * d
    for i in range(copy):
        contact.line[c, o + 8 * i + copy + i] = -1.0


@note_passage.register(Along, Sleeves)
@kernel
def note_nothing(along, sleeves, term, system, k, nodes, lo, hi):
    pass


@last_passage.register(Sleeves)
@kernel
def passage_of_triads(sleeves, along, term, system, k):
    """The moments of sleeves need the directors of the nodes, too."""
    nodes, lo, hi = begin_passage(term, system, k)
    lead_passage(system, nodes, lo, hi, term.sliders.point[k], along.clock[0])
    tangent = mean_tangent(pass_along(system.contact.basis, nodes, lo, hi, system, term.sliders.spin_root))
    return tangent, push_of_moments.call(sleeves, term, system, k, nodes, lo, hi)


@push_of_moments.register(Sleeves)
@kernel
def push_of_sleeve(sleeves, term, system, k, nodes, lo, hi):
    o = sleeves.of_slider[k]
    push = 0.0
    if o >= 0:
        state, work, contact, dofs = system.state, system.work, system.contact, system.dofs
        point = term.sliders.point[k]
        c = sleeves.first[0] + o
        for p in range(contact.forces[c]):
            t0, t1 = zero_vector(dofs), zero_vector(dofs)
            for a in range(lo, hi):
                i = slot.call(nodes, a)
                node = node_of.call(nodes, a)
                t0 += contact.basis[3, i] * director.call(dofs, state.q, node, min(p + 1, 2))
                t1 += contact.basis[3, i] * director.call(dofs, work.q_end, node, min(p + 1, 2))
            holder_start = holder_director.call(dofs, sleeves, o, p // 2, state.q, point)
            holder_end = holder_director.call(dofs, sleeves, o, p // 2, work.q_end, point)
            push += 0.5 * state.force[contact.first_force[c] + p] * (dot(holder_start, t0) + dot(holder_end, t1))
    return push


@kernel
def bending_of(system, c):
    """Size of the moments of constraint c that hold the bore's direction, and the one that holds the twist."""
    contact, force = system.contact, system.state.force
    first = contact.first_force[c]
    across = force[first] * force[first]
    if contact.forces[c] > 1:
        across += force[first + 1] * force[first + 1]
    return np.sqrt(across), force[first + 2] if contact.forces[c] > 2 else 0.0


@force_of_edges.register(Sleeves)
@kernel
def force_of_edges_of_bore(sleeves, system, k):
    o = sleeves.of_slider[k]
    if o < 0:
        return 0.0
    across, twist = bending_of(system, sleeves.first[0] + o)
    return sleeves.edges[2 * o] * across + sleeves.edges[2 * o + 1] * abs(twist)


@kernel
def edge_by_moment(sleeves, system, o, c, p):
    """Derivative of `force_of_edges` by moment p of constraint c, of sleeve o."""
    across, twist = bending_of(system, c)
    if p == 2:
        return sleeves.edges[2 * o + 1] * np.sign(twist)
    return sleeves.edges[2 * o] * system.state.force[system.contact.first_force[c] + p] / across if across > 0.0 else 0.0


@kernel
def let_go(contact, c, p, dofs):
    """Equation p of constraint c depends on no node."""
    n = 8 * len(dofs)
    for m in range(contact.entries[c]):
        for i in range(n * m + p, n * m + n, 8):
            contact.line[c, i] = 0.0


@hold_section.register(Sleeves)
@kernel
def hold_section_in_sleeve(sleeves, term, system, k, nodes, lo, hi, law):
    o = sleeves.of_slider[k]
    if o < 0:
        return
    state, work, contact, dofs = system.state, system.work, system.contact, system.dofs
    d = dim(dofs)
    point = term.sliders.point[k]
    c = sleeves.first[0] + o
    begin_moments(term, system, k, c)
    for i in range(8):
        contact.cross[o, 0, i] = 0.0
        contact.cross[o, 1, i] = 0.0
    for p in range(contact.forces[c]):
        held = 1.0
        if p == 2 and not sleeves.keyed[o]:
            held = twist_rubs.call(sleeves.twist, sleeves, term, system, k, o, nodes, lo, hi)
            if held < 0.0:
                # a multiplier that stays zero
                contact.corner[c, 9 * p] = 1.0
                contact.residual[c, p] = state.force[contact.first_force[c] + p]
                continue
        moment = state.force[contact.first_force[c] + p]
        i = p // 2
        j = min(p + 1, 2)
        holder_start = holder_director.call(dofs, sleeves, o, i, state.q, point)
        holder_mid = holder_director.call(dofs, sleeves, o, i, work.q_mid, point)
        holder_end = holder_director.call(dofs, sleeves, o, i, work.q_end, point)
        sums = sum_pair(contact.basis, system, nodes, lo, hi, j)
        put_pair_on_nodes(term, system, k, c, p, moment, j, holder_mid, holder_end, nodes, lo, hi)
        put_pair_on_holder(term, system, k, c, p, moment, sums, holder_mid, holder_end)
        put_push(term, system, k, p, law.share * moment, j, sums, holder_end, nodes, lo, hi)
        slide = 0.5 * (dot(holder_start, sums.t0) + dot(holder_end, sums.t1))
        if p < 2 or sleeves.keyed[o]:
            contact.residual[c, p] = dot(holder_end, sums.end)
        contact.corner[k, 9 * d] -= 0.5 * law.share * moment * (dot(holder_start, sums.dt0) + dot(holder_end, sums.dt1))
        contact.cross[o, 0, p] = -law.share * slide + law.rub * edge_by_moment(sleeves, system, o, c, p)
        contact.cross[o, 1, p] = held * dot(holder_end, sums.end_s)
        if held == 0.0:
            let_go(contact, c, p, dofs)


# --- as a term of a step ------------------------------------------------------------------------------------------------
@take_unknowns.register(Sleeves)
@kernel
def take_moments(sleeves, system):
    """Add the increments of all moments."""
    take_forces_of(sleeves.first[0], sleeves.keyed.shape[0], system)


@is_settled.register(Sleeves)
@kernel
def sections_are_held(sleeves, system):
    """Whether the augmented Lagrangian of the last iteration leaves errors of directions of round-off size only."""
    for c in range(sleeves.first[0], sleeves.first[0] + sleeves.keyed.shape[0]):
        if not system.contact.remaining[c] <= SETTLED:
            return False
    return twist_is_settled.call(sleeves.twist, sleeves, system)


@first_guess.register(Rubbing)
@kernel
def begin_rubbing_twist(term, system, h, c):
    begin_twist.call(term.sleeves.twist, term.sleeves, term.sliding, system, h)


@account.register(Rubbing)
@kernel
def account_rubbing_twist(term, system, h):
    account_twist.call(term.sleeves.twist, term.sleeves, term.sliding, system, h)
