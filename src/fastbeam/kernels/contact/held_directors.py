"""Directors of the sections and of the holder of a sleeve, and their sums over the nodes under it, theory.md 5.8.

Arrays: q [12 N], in a plane [4 N]; basis [5, n] as `Contact.basis`.
"""
from __future__ import annotations

from typing import Any, NamedTuple

from fastbeam.kernels.algebra.dimensions import Plane, Space, zero_vector
from fastbeam.kernels.algebra.vectors import dot, ld2, ld3, perp
from fastbeam.kernels.contact.curves import node_of, slot
from fastbeam.kernels.jit.decorators import inlined, kernel
from fastbeam.kernels.jit.generic import generic


class Sums(NamedTuple):
    """Sums over the nodes under a sleeve for one of their directors, d."""

    mean: Any      # sum of mean shape functions and mean d, and half its derivative by s at the end
    mean_s: Any
    mean_end: Any  # sum of mean shape functions and d at the end
    end: Any       # d at the end of the step, and its derivative by s
    end_s: Any
    t0: Any        # sums of divided differences and d at the start and at the end, and their derivatives by s at the end
    t1: Any
    dt0: Any
    dt1: Any


class Holder(NamedTuple):
    """Directors of the holder of a sleeve."""

    bore_start: Any   # D_1 at the start, in the middle and at the end of the step
    bore_mid: Any
    bore_end: Any
    key_start: Any    # D_2, in a plane D_1 again
    key_mid: Any
    key_end: Any
    side_start: Any   # D_3, in a plane D_1 again
    side_mid: Any
    side_end: Any
    second_mid: Any   # mu_12 D_1 - mu_23/2 D_3, which turns d_2
    second_end: Any
    third_mid: Any    # mu_13 D_1 + mu_23/2 D_2, which turns d_3
    third_end: Any


@generic
def director(dofs, q, node, j):
    """Return director j = 0, 1, 2 of a node at coordinates q; in a plane 0 or 1."""


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
    """Return D_i of sleeve o from the triad of its holder."""


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


@kernel
def sum_directors(basis, system, nodes, lo, hi, j):
    """Return `Sums` of director j of lo to before hi of `nodes_of` a curve."""
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
    return Sums(mean, mean_s, mean_end, end, end_s, t0, t1, dt0, dt1)


@generic
def sum_held_directors(dofs, basis, system, nodes, lo, hi):
    """Return `Sums` of the two directors that sleeves fix, d_2 and d_3; in a plane twice d_2, the only one."""


@sum_held_directors.register(Space)
@kernel
def sum_directors_in_space(dofs, basis, system, nodes, lo, hi):
    return sum_directors(basis, system, nodes, lo, hi, 1), sum_directors(basis, system, nodes, lo, hi, 2)


@sum_held_directors.register(Plane)
@kernel
def sum_directors_in_plane(dofs, basis, system, nodes, lo, hi):
    sums = sum_directors(basis, system, nodes, lo, hi, 1)
    return sums, sums


@kernel
def holder_of(sleeves, term, system, k, o, held):
    """Return `Holder` of sleeve o, slider k, with the first `held` of three moments."""
    contact, dofs, q, work = system.contact, system.dofs, system.state.q, system.work
    point = term.sliders.point[k]
    c = sleeves.first[0] + o
    first = contact.first_force[c]
    force = system.state.force
    bore_start = holder_director.call(dofs, sleeves, o, 0, q, point)
    bore_mid = holder_director.call(dofs, sleeves, o, 0, work.q_mid, point)
    bore_end = holder_director.call(dofs, sleeves, o, 0, work.q_end, point)
    key_start = holder_director.call(dofs, sleeves, o, 1, q, point)
    key_mid = holder_director.call(dofs, sleeves, o, 1, work.q_mid, point)
    key_end = holder_director.call(dofs, sleeves, o, 1, work.q_end, point)
    side_start = holder_director.call(dofs, sleeves, o, 2, q, point)
    side_mid = holder_director.call(dofs, sleeves, o, 2, work.q_mid, point)
    side_end = holder_director.call(dofs, sleeves, o, 2, work.q_end, point)
    third = force[first + 1] if held > 1 else 0.0
    key = 0.5 * force[first + 2] if held > 2 else 0.0
    return Holder(bore_start, bore_mid, bore_end, key_start, key_mid, key_end, side_start, side_mid, side_end,
                  force[first] * bore_mid - key * side_mid, force[first] * bore_end - key * side_end,
                  third * bore_mid + key * key_mid, third * bore_end + key * key_end)


@inlined
def twist_between(key, side, second, third):
    """Return (D_2 . d_3 - D_3 . d_2)/2, the sine of the angle from D_2, D_3 to d_2, d_3, which no turn of both about D_1
    changes."""
    return 0.5 * (dot(key, third) - dot(side, second))


@inlined
def products(p, bore, key, side, second, third):
    """Return the value of condition p of a sleeve between D_1, D_2, D_3 and d_2, d_3, or vectors in their places."""
    return twist_between(key, side, second, third) if p == 2 else dot(bore, second if p == 0 else third)


@inlined
def way_of(holder, second, third, p):
    """Sum of divided differences of condition p over the step; second, third: `Sums` of d_2 and d_3."""
    return 0.5 * (products(p, holder.bore_start, holder.key_start, holder.side_start, second.t0, third.t0)
                  + products(p, holder.bore_end, holder.key_end, holder.side_end, second.t1, third.t1))
