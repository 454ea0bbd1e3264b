"""Curves of beams that carry sliders: piecewise polynomials of arc length, their shape functions and divided differences.

Arrays: q [12 N], in a plane [4 N]; table, table_out [3, n_coef], Legendre polynomials and two derivatives; basis_out [5, n],
shape functions of the n nodes of a beam, rows as in `slider.Contact`.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._jit import kernel, one_variant
from .kinds import position, zero_vector


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


@kernel
def find_element(curves, c, s, hint):
    """Element of arc length s on curve c; ends outside the beam belong to the outer elements."""
    n = curves.meta[c, 1]
    o = curves.meta[c, 2]
    e = min(max(hint, 0), n - 1)
    while e > 0 and s < curves.ends[o + e]:
        e -= 1
    while e < n - 1 and s >= curves.ends[o + e + 1]:
        e += 1
    return e


@kernel
def legendre(xi, n, table_out):
    """P_k, P_k', P_k'' for k < n."""
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


@one_variant
def add_basis(curves, c, e, s, derivative, factor, next_factor, table, basis_out, slot):
    """basis_out[slot, A] += factor d^k N_A / ds^k at s, from the polynomials of element e, and basis_out[slot + 1, A] +=
    next_factor d^(k+1) N_A / ds^(k+1); k = 0 or 1."""
    o = curves.meta[c, 2] + e
    scale = 2.0 / (curves.ends[o + 1] - curves.ends[o])
    n = curves.shape[c, 1]
    legendre(scale * (s - curves.ends[o]) - 1.0, n, table)
    f = factor if derivative == 0 else factor * scale
    g = next_factor * scale if derivative == 0 else next_factor * scale * scale
    p = curves.meta[c, 3] + e
    co = curves.meta[c, 4] + e * curves.shape[c, 0] * n
    for a in range(curves.count[p]):
        x = 0.0
        y = 0.0
        for k in range(n):
            x += curves.coef[co + a * n + k] * table[derivative, k]
            y += curves.coef[co + a * n + k] * table[derivative + 1, k]
        basis_out[slot, curves.first[p] + a] += f * x
        basis_out[slot + 1, curves.first[p] + a] += g * y


@kernel
def step_basis(curves, c, s0, s1, e0, e1, lo, hi, contact):
    """Shape functions at both ends of the step and the divided difference between them, nodes lo..hi-1."""
    basis = contact.basis
    table = contact.legendre
    for k in range(5):
        for a in range(lo, hi):
            basis[k, a] = 0.0
    add_basis(curves, c, e0, s0, 0, 1.0, 0.0, table, basis, 0)
    add_basis(curves, c, e1, s1, 0, 1.0, 1.0, table, basis, 1)
    ng = curves.gauss_x.shape[0]
    if e0 == e1:
        for g in range(ng):
            x = curves.gauss_x[g]
            w = curves.gauss_w[g]
            s = s0 + x * (s1 - s0)
            add_basis(curves, c, e0, s, 1, w, w * x, table, basis, 3)
        return
    # a step that crosses element ends: N[a,b] = 1/(b - a) int_a^b N' ds, a Gauss rule on the part of each element, (5.3)
    a_ = min(s0, s1)
    b_ = max(s0, s1)
    o = curves.meta[c, 2]
    for e in range(min(e0, e1), max(e0, e1) + 1):
        x0 = a_ if e == min(e0, e1) else curves.ends[o + e]
        x1 = b_ if e == max(e0, e1) else curves.ends[o + e + 1]
        share = (x1 - x0) / (b_ - a_) if b_ > a_ else 0.5
        for g in range(ng):
            add_basis(curves, c, e, x0 + curves.gauss_x[g] * (x1 - x0), 1, share * curves.gauss_w[g], 0.0, table,
                      basis, 3)
    span = curves.ends[o + e1 + 1] - curves.ends[o + e1]
    if abs(s1 - s0) > 1e-9 * span:
        for a in range(lo, hi):
            basis[4, a] = (basis[2, a] - basis[3, a]) / (s1 - s0)


@one_variant
def point_on_curve(curves, c, s, q, element, contact, derivative, dofs):
    """Position (derivative = 0) or its derivative by s (1) of curve c at s for node coordinates q."""
    p = curves.meta[c, 3] + element
    first = curves.first[p]
    n = curves.count[p]
    for a in range(first, first + n):
        contact.basis[0, a] = 0.0
    add_basis(curves, c, element, s, derivative, 1.0, 0.0, contact.legendre, contact.basis, 0)
    x = zero_vector(dofs)
    for a in range(first, first + n):
        x += contact.basis[0, a] * position(q, curves.meta[c, 0] + a, dofs)
    return x
