"""Curves of beams and paths that carry sliders: piecewise polynomials of arc length, their shape functions and divided
differences.

Nodes of a curve are numbered along it. On a closed path elements and nodes are counted on from round to round, as its arc length
is: element e + n is element e once around. Shape functions of one round stand in the work arrays, in the `slot` of a node.

Arrays: q [12 N], in a plane [4 N]; table, table_out [3, n_coef], Legendre polynomials and two derivatives; basis_out [5, n],
shape functions of the n nodes of a curve, rows as in `slider.Contact`.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import position, zero_vector
from fastbeam.kernels.jit.decorators import inlined, kernel, one_variant
from fastbeam.kernels.jit.generic import generic

# columns of `meta`
FIRST_NODE, ELEMENTS, ENDS, FIRSTS, COEFFICIENTS = range(5)
# columns of `shape`
MOST_NODES, TERMS, NODES_OF_CURVE = range(3)


class Curves(NamedTuple):
    """Piecewise polynomial curves of all beams that carry a slider."""

    meta: np.ndarray        # int64 [C, 5]: first node, number of elements, offset in ends, offset in first, offset in coef
    shape: np.ndarray       # int64 [C, 3]: nodes per element (padded), coefficients, nodes of the beam
    ends: np.ndarray        # float64 [*]: element ends in arc length
    first: np.ndarray       # int64 [*]: first node of every element, counted from the beam's first
    count: np.ndarray       # int64 [*]: nodes of every element
    coef: np.ndarray        # float64 [*]: Legendre coefficients of every element, node and degree
    gauss_x: np.ndarray     # float64 [G]: points on [0, 1], exact for the derivative of every curve
    gauss_w: np.ndarray     # float64 [G]


class Paths(NamedTuple):
    """Contact curves of scenes in which a slider runs on a path of several beams; a beam is a path of one."""

    meta: np.ndarray        # int64 [C, 5]: as in `Curves`, but the first column is an offset in node
    shape: np.ndarray       # int64 [C, 3]
    ends: np.ndarray        # float64 [*]
    first: np.ndarray       # int64 [*]: on a closed path nodes of the last beam may come before the first, as negative numbers
    count: np.ndarray       # int64 [*]
    coef: np.ndarray        # float64 [*]
    gauss_x: np.ndarray     # float64 [G]
    gauss_w: np.ndarray     # float64 [G]
    node: np.ndarray        # int64 [*]: numbers in the scene of the nodes of every curve
    period: np.ndarray      # float64 [C]: length of a closed path, 0 of an open one


class NodesOfBeam(NamedTuple):
    """Nodes of the curve of a beam."""

    first: int


class NodesOfPath(NamedTuple):
    """Nodes of a path."""

    node: np.ndarray        # int64 [*]: as in `Paths`
    first: int              # index in `node` of the first one
    count: int


@generic
def nodes_of(curves, c):
    """Return the nodes of curve c, for `slot` and `node_of`."""


@generic
def slot(nodes, a):
    """Return the index in work arrays of the shape functions of node a of a curve."""


@generic
def node_of(nodes, a):
    """Return the number in the scene of node a of a curve."""


@generic
def nodes_under(curves, c, e0, e1):
    """Return the first node of elements e0 to e1 of curve c, and the one behind the last."""


@generic
def find_element(curves, c, s, hint):
    """Return the element of arc length s on curve c; ends outside a beam or an open path belong to the outer elements."""


@generic
def add_basis(curves, c, e, s, derivative, factor, next_factor, table, basis_out, position):
    """Add factor d^k N_A / ds^k at s, from the polynomials of element e, to basis_out[position, A], and next_factor d^(k+1) N_A /
    ds^(k+1) to basis_out[position + 1, A]; k = derivative, 0 or 1."""


@generic
def add_mean_slopes(curves, c, s0, s1, e0, e1, table, basis_out):
    """Add N[s0, s1] to basis_out[3] for a step that crosses element ends: N[a, b] = 1/(b - a) int_a^b N' ds, a Gauss rule on the
    part of each element, theory.md (5.3)."""


@nodes_of.register(Curves)
@kernel
def nodes_of_beam(curves, c):
    return NodesOfBeam(curves.meta[c, FIRST_NODE])


@nodes_of.register(Paths)
@kernel
def nodes_of_path(curves, c):
    return NodesOfPath(curves.node, curves.meta[c, FIRST_NODE], curves.shape[c, NODES_OF_CURVE])


@slot.register(NodesOfBeam)
@inlined
def slot_on_beam(nodes, a):
    return a


@slot.register(NodesOfPath)
@inlined
def slot_on_path(nodes, a):
    return a % nodes.count


@node_of.register(NodesOfBeam)
@inlined
def node_of_beam(nodes, a):
    return nodes.first + a


@node_of.register(NodesOfPath)
@inlined
def node_of_path(nodes, a):
    return nodes.node[nodes.first + a % nodes.count]


@find_element.register(Curves)
@kernel
def find_in_table(curves, c, s, hint):
    n = curves.meta[c, ELEMENTS]
    o = curves.meta[c, ENDS]
    e = min(max(hint, 0), n - 1)
    while e > 0 and s < curves.ends[o + e]:
        e -= 1
    while e < n - 1 and s >= curves.ends[o + e + 1]:
        e += 1
    return e


@find_element.register(Paths)
@kernel
def find_on_path(curves, c, s, hint):
    period = curves.period[c]
    if period == 0.0:
        return find_in_table(curves, c, s, hint)
    rounds = np.floor(s / period)
    # a diverging Newton iteration may give such s
    if not abs(rounds) < 1e9:
        return hint
    n = curves.meta[c, ELEMENTS]
    return n * int(rounds) + find_in_table(curves, c, s - rounds * period, hint % n)


@inlined
def begin_of_round(curves, c, e):
    """Return the arc length at which the round of element e of a path begins."""
    return curves.period[c] * (e // curves.meta[c, ELEMENTS])


@nodes_under.register(Curves)
@kernel
def nodes_under_on_beam(curves, c, e0, e1):
    p = curves.meta[c, FIRSTS]
    last = p + max(e0, e1)
    return curves.first[p + min(e0, e1)], curves.first[last] + curves.count[last]


@nodes_under.register(Paths)
@kernel
def nodes_under_on_path(curves, c, e0, e1):
    n = curves.meta[c, ELEMENTS]
    p = curves.meta[c, FIRSTS]
    low = min(e0, e1)
    high = max(e0, e1)
    nodes = curves.shape[c, NODES_OF_CURVE]
    lo = curves.first[p + low % n] + nodes * (low // n)
    hi = curves.first[p + high % n] + curves.count[p + high % n] + nodes * (high // n)
    # a step of a whole round or more touches each node once
    return lo, min(hi, lo + nodes)


@kernel
def legendre(xi, n, table_out):
    """Evaluate the Legendre polynomials P_k, P_k', P_k'' for k < n."""
    table_out[0, 0] = 1.0
    table_out[1, 0] = 0.0
    table_out[2, 0] = 0.0
    if n > 1:
        table_out[0, 1] = xi
        table_out[1, 1] = 1.0
        table_out[2, 1] = 0.0
    for k in range(1, n - 1):
        table_out[0, k + 1] = ((2 * k + 1) * xi * table_out[0, k] - k * table_out[0, k - 1]) / (k + 1)
        table_out[1, k + 1] = table_out[1, k - 1] + (2 * k + 1) * table_out[0, k]
        table_out[2, k + 1] = table_out[2, k - 1] + (2 * k + 1) * table_out[1, k]


@add_basis.register(Curves)
@one_variant
def add_from_table(curves, c, e, s, derivative, factor, next_factor, table, basis_out, position):
    nodes = nodes_of.call(curves, c)
    o = curves.meta[c, ENDS] + e
    scale = 2.0 / (curves.ends[o + 1] - curves.ends[o])
    n = curves.shape[c, TERMS]
    legendre(scale * (s - curves.ends[o]) - 1.0, n, table)
    f = factor if derivative == 0 else factor * scale
    g = next_factor * scale if derivative == 0 else next_factor * scale * scale
    p = curves.meta[c, FIRSTS] + e
    co = curves.meta[c, COEFFICIENTS] + e * curves.shape[c, MOST_NODES] * n
    for a in range(curves.count[p]):
        x = 0.0
        y = 0.0
        for k in range(n):
            x += curves.coef[co + a * n + k] * table[derivative, k]
            y += curves.coef[co + a * n + k] * table[derivative + 1, k]
        at = slot.call(nodes, curves.first[p] + a)
        basis_out[position, at] += f * x
        basis_out[position + 1, at] += g * y


@add_basis.register(Paths)
@one_variant
def add_on_path(curves, c, e, s, derivative, factor, next_factor, table, basis_out, position):
    add_from_table(curves, c, e % curves.meta[c, ELEMENTS], s - begin_of_round(curves, c, e), derivative, factor, next_factor,
                   table, basis_out, position)


@kernel
def step_basis(curves, c, s0, s1, e0, e1, lo, hi, contact):
    """Evaluate shape functions at both ends of the step and the divided difference between them, nodes lo..hi-1."""
    basis = contact.basis
    table = contact.legendre
    nodes = nodes_of.call(curves, c)
    for k in range(5):
        for a in range(lo, hi):
            basis[k, slot.call(nodes, a)] = 0.0
    add_basis.call(curves, c, e0, s0, 0, 1.0, 0.0, table, basis, 0)
    add_basis.call(curves, c, e1, s1, 0, 1.0, 1.0, table, basis, 1)
    if e0 == e1:
        for g in range(curves.gauss_x.shape[0]):
            x = curves.gauss_x[g]
            w = curves.gauss_w[g]
            s = s0 + x * (s1 - s0)
            add_basis.call(curves, c, e0, s, 1, w, w * x, table, basis, 3)
        return
    add_mean_slopes.call(curves, c, s0, s1, e0, e1, table, basis)
    span = least_span(curves, c, e1)
    if abs(s1 - s0) > 1e-9 * span:
        for a in range(lo, hi):
            at = slot.call(nodes, a)
            basis[4, at] = (basis[2, at] - basis[3, at]) / (s1 - s0)


@inlined
def least_span(curves, c, e):
    """Return the length of element e, the same in all rounds."""
    o = curves.meta[c, ENDS] + e % curves.meta[c, ELEMENTS]
    return curves.ends[o + 1] - curves.ends[o]


@add_mean_slopes.register(Curves)
@kernel
def add_mean_slopes_on_beam(curves, c, s0, s1, e0, e1, table, basis_out):
    a_ = min(s0, s1)
    b_ = max(s0, s1)
    o = curves.meta[c, ENDS]
    for e in range(min(e0, e1), max(e0, e1) + 1):
        x0 = a_ if e == min(e0, e1) else curves.ends[o + e]
        x1 = b_ if e == max(e0, e1) else curves.ends[o + e + 1]
        share = (x1 - x0) / (b_ - a_) if b_ > a_ else 0.5
        for g in range(curves.gauss_x.shape[0]):
            add_from_table(curves, c, e, x0 + curves.gauss_x[g] * (x1 - x0), 1, share * curves.gauss_w[g], 0.0, table, basis_out,
                           3)


@add_mean_slopes.register(Paths)
@kernel
def add_mean_slopes_on_path(curves, c, s0, s1, e0, e1, table, basis_out):
    # whole rounds change no shape function: their integrals are left out
    n = curves.meta[c, ELEMENTS]
    o = curves.meta[c, ENDS]
    low = min(e0, e1)
    inside = max(e0, e1) - low - 1
    first = low % n
    last = max(e0, e1) % n
    a_ = min(s0, s1) - begin_of_round(curves, c, low)
    b_ = max(s0, s1) - begin_of_round(curves, c, max(e0, e1))
    whole = max(s0, s1) - min(s0, s1)
    if inside < n:
        # round-off of arc lengths after many rounds must not show in steps that are as short
        parts = (curves.ends[o + first + 1] - a_) + (b_ - curves.ends[o + last])
        for i in range(inside):
            parts += least_span(curves, c, first + 1 + i)
        if abs(parts - whole) > 1e-9 * whole:
            whole = parts
    for i in range(inside % n + 2):
        e = last if i == inside % n + 1 else (first + i) % n
        x0 = a_ if i == 0 else curves.ends[o + e]
        x1 = b_ if i == inside % n + 1 else curves.ends[o + e + 1]
        share = (x1 - x0) / whole if whole > 0.0 else 0.5
        for g in range(curves.gauss_x.shape[0]):
            add_from_table(curves, c, e, x0 + curves.gauss_x[g] * (x1 - x0), 1, share * curves.gauss_w[g], 0.0, table, basis_out,
                           3)


@one_variant
def point_on_curve(curves, c, s, q, element, contact, derivative, dofs):
    """Return the position (derivative = 0) or its derivative by s (1) of curve c at s for node coordinates q."""
    nodes = nodes_of.call(curves, c)
    lo, hi = nodes_under.call(curves, c, element, element)
    for a in range(lo, hi):
        contact.basis[0, slot.call(nodes, a)] = 0.0
    add_basis.call(curves, c, element, s, derivative, 1.0, 0.0, contact.legendre, contact.basis, 0)
    x = zero_vector(dofs)
    for a in range(lo, hi):
        x += contact.basis[0, slot.call(nodes, a)] * position(q, node_of.call(nodes, a), dofs)
    return x
