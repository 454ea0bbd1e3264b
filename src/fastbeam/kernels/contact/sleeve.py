"""Sleeves: sliders that hold the direction of the section as well, theory.md 5.8.

The sliding point of a sleeve is its holder, a node with a triad. With D_1, D_2, D_3 fixed to the holder, D_1 along the beam, the
conditions are D_1 . d_2(s) = 0, D_1 . d_3(s) = 0 and, where the sleeve is keyed, (D_2 . d_3(s) - D_3 . d_2(s))/2 = 0; in a plane
the first alone. Their multipliers are moments, mu_12, mu_13, mu_23; with means over the step a product D_i . d_j gives

    director i of the holder  + mu_ij sum_A N_A,mean d_jA,mean         moment  mu_ij D_i,mean x sum_A N_A,mean d_jA,mean
    director j of node A      + mu_ij N_A,mean D_i,mean                moment  mu_ij N_A,mean d_jA,mean x D_i,mean
    sliding (5.3)             - mu_ij sum_A N[s_n, s_n+1]_A mean(D_i . d_jA)

with mu_23/2 in the place of mu_ij for (i, j) = (2, 3) and -mu_23/2 for (3, 2).

The moments of a sleeve are a constraint of their own behind all others, coupled with the slider by s alone. Besides mu it has a
copy z of the holder's spin: moments turn with the nodes that they act on, and in the tangent all of these turn like the holder.
What is left out are the small differences of their spins times a moment, next to the bending stiffness of an element.

Arrays: q [12 N], in a plane [4 N]; basis [5, n] as `Contact.basis`; column, line as rows of `Contact.column`, `Contact.line`.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import add_stiffness, add_to, cross_product, dim
from fastbeam.kernels.algebra.vectors import V2, V3, dot, f8
from fastbeam.kernels.contact.curves import node_of, slot
from fastbeam.kernels.contact.held_directors import director, holder_of, products, sum_held_directors, way_of
from fastbeam.kernels.contact.point_entries import take_forces_of
from fastbeam.kernels.contact.slider import (
    Sliding,
    begin_passage,
    hold_section,
    mean_tangent,
    note_passage,
    pass_along,
    push_of_moments,
    sums_of_sections,
)
from fastbeam.kernels.contact.slider_forces import Along, force_of_edges, last_passage, lead_passage
from fastbeam.kernels.entries.dense import Weights, entry_of
from fastbeam.kernels.jit.decorators import inlined, kernel
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.terms import WithContact, account, first_guess, is_settled, take_unknowns

# largest residual of the conditions that round-off of directions leaves
SETTLED = 4e-15


class Sleeves(NamedTuple):
    """O sleeves: axes of the holders, and edges of the bores."""

    of_slider: np.ndarray  # int64 [S]: number of the sleeve that a slider is, or -1
    first: np.ndarray      # int64 [1]: number of the first constraint of moments
    keyed: np.ndarray      # int64 [O]: 1 where the twist is fixed, too
    axes: np.ndarray       # float64 [9 O]: R with D_i = sum_k R_ik d_k of the holder; in a plane [2 O], D_1 = (a, b) stands for
    #                        a u + b J u
    edges: np.ndarray      # float64 [2 O]: 2/length of the bore and 1/radius of the key, 1/m; 0 without length, or radius
    twist: Any             # sleeve_twist.Twist or NoTwist


Sleeves.reads = WithContact  # type: ignore[attr-defined]
Sleeves.stays_in_memory = True  # type: ignore[attr-defined]


class NoTwist(NamedTuple):
    """Placeholder for sleeves in which beams turn without friction."""


class KnownTwist(NamedTuple):
    """Marker of sleeves whose moments of friction are those of the state."""


class Rubbing(NamedTuple):
    """Term of sleeves with friction on beams that turn in them, with the curves of their sliders."""

    sleeves: Any           # Sleeves with a Twist
    sliding: Sliding


Rubbing.reads = WithContact  # type: ignore[attr-defined]


@generic
def begin_twist(twist, sleeves, term, system, h):
    """Prepare the friction of twists after the first guess of a step of size h."""


@generic
def twist_rubs(twist, sleeves, term, system, k, o, nodes, lo, hi):
    """Form right-hand side, own block and moment of the twist of sleeve o, slider k, which is not keyed; return 1 if it has a
    condition, 0 if its moment is known, -1 if there is none."""


@generic
def twist_is_settled(twist, sleeves, system):
    """Return whether friction of twists is that of the step, when Newton's method has converged."""


@generic
def account_twist(twist, sleeves, term, system, h):
    """Record the loss by friction of twists in a converged step, and the angles of sections."""


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


@inlined
def put_condition(contact, c, p, at, weights, turned_mid, turned_end):
    """Add column and line of condition p of constraint c on a spin; turned: sums of products d_j x D_i."""
    add_to(contact.column[c], at + p, 8, -weights.mean * turned_mid)
    add_to(contact.line[c], at + p, 8, weights.end * turned_end)


@inlined
def turned_by_key(key, side, second, third):
    """Return the sum of products d_j x D_i of the twist condition."""
    return 0.5 * (cross_product.call(third, key) - cross_product.call(second, side))


@inlined
def put_conditions(contact, c, held, at, weights, holder, second_mid, second_end, third_mid, third_end):
    """Add the first `held` of three conditions on a spin that turns d_2 and d_3, those in the middle and at the end of the
    step."""
    put_condition(contact, c, 0, at, weights, cross_product.call(second_mid, holder.bore_mid),
                  cross_product.call(second_end, holder.bore_end))
    if held > 1:
        put_condition(contact, c, 1, at, weights, cross_product.call(third_mid, holder.bore_mid),
                      cross_product.call(third_end, holder.bore_end))
    if held > 2:
        put_condition(contact, c, 2, at, weights, turned_by_key(holder.key_mid, holder.side_mid, second_mid, third_mid),
                      turned_by_key(holder.key_end, holder.side_end, second_end, third_end))


@inlined
def add_turning(column, at, factor, held_mid, held_end, turner_mid, turner_end):
    """Add the matrix of factor (held_mid x (turner_end x z) - turner_mid x (held_end x z)) as a function of the spin z to column
    [*] at `at`, rows of 8."""
    add_double_cross.call(held_mid, turner_end, factor, column, at)
    add_double_cross.call(turner_mid, held_end, -factor, column, at)


@kernel
def put_moments(term, system, k, c, held, holder, sums, share, nodes, lo, hi):
    """Add the first `held` of the three moments of constraint c, of slider k, on its holder and the nodes under it: rows of the
    residual and entries. share: of the sliding equation as in `SlidingLaw`."""
    contact, work, dofs = system.contact, system.work, system.dofs
    d = dim(dofs)
    copy = len(dofs) - d
    second, third = sums
    row = system.row_of[term.sliders.spin_root[term.sliders.point[k]]]
    at = entry_of(contact, c, row, dofs) + 8 * d
    # the holder turns the other way
    put_conditions(contact, c, held, at, Weights(-1.0, -1.0, 0.0, 0.0), holder, second.mean, second.end, third.mean, third.end)
    turning = cross_product.call(second.mean, holder.second_mid)
    slope = cross_product.call(second.mean_s, holder.second_mid)
    along = cross_product.call(second.t1, holder.second_end)
    add_turning(contact.column[c], at + copy, -0.5, second.mean, second.mean_end, holder.second_mid, holder.second_end)
    if held > 1:
        turning += cross_product.call(third.mean, holder.third_mid)
        slope += cross_product.call(third.mean_s, holder.third_mid)
        along += cross_product.call(third.t1, holder.third_end)
        add_turning(contact.column[c], at + copy, -0.5, third.mean, third.mean_end, holder.third_mid, holder.third_end)
    add_to(work.r, 8 * row + d, 1, turning)
    at = entry_of(contact, k, row, dofs) + 9 * d
    add_to(contact.column[k], at, 8, slope)
    add_to(contact.line[k], at, 8, (0.5 * share) * along)
    basis = contact.basis
    for a in range(lo, hi):
        i = slot.call(nodes, a)
        node = node_of.call(nodes, a)
        weights = Weights(0.5 * (basis[0, i] + basis[1, i]), basis[1, i], 0.5 * basis[2, i], basis[3, i])
        second_mid = director.call(dofs, work.q_mid, node, 1)
        second_end = director.call(dofs, work.q_end, node, 1)
        third_mid = director.call(dofs, work.q_mid, node, 2)
        third_end = director.call(dofs, work.q_end, node, 2)
        row = system.row_of[term.sliders.spin_root[node]]
        at = entry_of(contact, c, row, dofs) + 8 * d
        put_conditions(contact, c, held, at, weights, holder, second_mid, second_end, third_mid, third_end)
        half = 0.5 * weights.mean
        turning = cross_product.call(second_mid, holder.second_mid)
        along = cross_product.call(second_end, holder.second_end)
        add_turning(contact.column[c], at + copy, half, second_mid, second_end, holder.second_mid, holder.second_end)
        if held > 1:
            turning += cross_product.call(third_mid, holder.third_mid)
            along += cross_product.call(third_end, holder.third_end)
            add_turning(contact.column[c], at + copy, half, third_mid, third_end, holder.third_mid, holder.third_end)
        add_to(work.r, 8 * row + d, 1, -weights.mean * turning)
        at = entry_of(contact, k, row, dofs) + 9 * d
        add_to(contact.column[k], at, 8, -weights.slope * turning)
        add_to(contact.line[k], at, 8, (-0.5 * share * weights.along) * along)


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
    """Return `last_passage` from the directors of the nodes, which the moments of sleeves need."""
    nodes, lo, hi = begin_passage(term, system, k)
    lead_passage(system, nodes, lo, hi, term.sliders.point[k], along.clock[0])
    tangent = mean_tangent(pass_along(system.contact.basis, nodes, lo, hi, system, term.sliders.spin_root))
    sums = sums_of_sections.call(sleeves, system, k, nodes, lo, hi)
    return tangent, push_of_moments.call(sleeves, sums, term, system, k)


@sums_of_sections.register(Sleeves)
@kernel
def sums_in_sleeve(sleeves, system, k, nodes, lo, hi):
    # the sum is empty for a slider that is no sleeve
    return sum_held_directors.call(system.dofs, system.contact.basis, system, nodes, lo, hi if sleeves.of_slider[k] >= 0 else lo)


@push_of_moments.register(Sleeves)
@kernel
def push_of_sleeve(sleeves, sums, term, system, k):
    o = sleeves.of_slider[k]
    push = 0.0
    if o >= 0:
        contact = system.contact
        c = sleeves.first[0] + o
        holder = holder_of(sleeves, term, system, k, o, contact.forces[c])
        second, third = sums
        for p in range(contact.forces[c]):
            push += system.state.force[contact.first_force[c] + p] * way_of(holder, second, third, p)
    return push


@kernel
def bending_of(system, c):
    """Return the size of the moments of constraint c that hold the bore's direction, and the moment that holds the twist."""
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
    """Return the derivative of `force_of_edges` by moment p of constraint c, of sleeve o."""
    across, twist = bending_of(system, c)
    if p == 2:
        return sleeves.edges[2 * o + 1] * np.sign(twist)
    return sleeves.edges[2 * o] * system.state.force[system.contact.first_force[c] + p] / across if across > 0.0 else 0.0


@kernel
def let_go(contact, c, p, dofs):
    """Clear the line of equation p of constraint c, which then depends on no node."""
    n = 8 * len(dofs)
    for m in range(contact.entries[c]):
        for i in range(n * m + p, n * m + n, 8):
            contact.line[c, i] = 0.0


@hold_section.register(Sleeves)
@kernel
def hold_section_in_sleeve(sleeves, sums, term, system, k, nodes, lo, hi, law):
    o = sleeves.of_slider[k]
    if o < 0:
        return
    contact = system.contact
    c = sleeves.first[0] + o
    begin_moments(term, system, k, c)
    for i in range(8):
        contact.cross[o, 0, i] = 0.0
        contact.cross[o, 1, i] = 0.0
    held = contact.forces[c]
    rubs = held > 2 and not sleeves.keyed[o]
    twist = 1.0
    if rubs:
        # called before the moment is read, because slipping friction sets it
        twist = twist_rubs.call(sleeves.twist, sleeves, term, system, k, o, nodes, lo, hi)
        if twist < 0.0:
            # a multiplier that stays zero
            contact.corner[c, 18] = 1.0
            contact.residual[c, 2] = system.state.force[contact.first_force[c] + 2]
            held = 2
    holder = holder_of(sleeves, term, system, k, o, held)
    put_moments(term, system, k, c, held, holder, sums, law.share, nodes, lo, hi)
    slope = 0.0
    second, third = sums
    for p in range(held):
        here = 1.0 if p < 2 else twist
        if p < 2 or not rubs:
            contact.residual[c, p] = products(p, holder.bore_end, holder.key_end, holder.side_end, second.end, third.end)
        slope += system.state.force[contact.first_force[c] + p] * (
            products(p, holder.bore_start, holder.key_start, holder.side_start, second.dt0, third.dt0)
            + products(p, holder.bore_end, holder.key_end, holder.side_end, second.dt1, third.dt1))
        contact.cross[o, 0, p] = (-law.share * way_of(holder, second, third, p)
                                  + law.rub * edge_by_moment(sleeves, system, o, c, p))
        contact.cross[o, 1, p] = here * products(p, holder.bore_end, holder.key_end, holder.side_end, second.end_s, third.end_s)
        if here == 0.0:
            let_go(contact, c, p, system.dofs)
    contact.corner[k, 9 * dim(system.dofs)] -= 0.5 * law.share * slope


# --- as a term of a step ------------------------------------------------------------------------------------------------
@take_unknowns.register(Sleeves)
@kernel
def take_moments(sleeves, system):
    """Add the increments of all moments."""
    take_forces_of(sleeves.first[0], sleeves.keyed.shape[0], system)


@is_settled.register(Sleeves)
@kernel
def sections_are_held(sleeves, system):
    """Return whether the augmented Lagrangian of the last iteration leaves errors of directions of round-off size only."""
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
