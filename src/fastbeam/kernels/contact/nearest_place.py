"""Nearest points on the curves of sliders, theory.md 5.9: the place by Newton's method, and the normal there.

Arrays: q [12 N]; out [7]: arc length of the place; distance along the normal; distance of the point beyond the place along the
curve; rest of the gap, neither along the normal nor along the curve; unit normal [3].
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.vectors import cross, dot, ld3, st3, zero3
from fastbeam.kernels.contact.curves import add_basis, find_element, node_of, nodes_of, nodes_under, slot
from fastbeam.kernels.jit.decorators import kernel

# the search ends with a step shorter than this share of the length
NEAR = 1e-8


class Sides(NamedTuple):
    """Sides of the curves on which points may lift off."""

    start: np.ndarray   # int64 [S + 1]: where the nodes of the curve of each slider begin
    side: np.ndarray    # float64 [3 n]: direction in the triad of every node; no entries for sliders that are not one-sided


@kernel
def shapes_at_place(curves, c, s, hint, contact):
    """Evaluate shape functions of curve c at s and two derivatives in rows of `contact.basis`; return lo and hi of the nodes lo
    to before hi, and the element."""
    e = find_element.call(curves, c, s, hint)
    lo, hi = nodes_under.call(curves, c, e, e)
    nodes = nodes_of.call(curves, c)
    for a in range(lo, hi):
        for i in range(3):
            contact.basis[i, slot.call(nodes, a)] = 0.0
    add_basis.call(curves, c, e, s, 0, 1.0, 0.0, contact.legendre, contact.basis, 0)
    add_basis.call(curves, c, e, s, 1, 1.0, 1.0, contact.legendre, contact.basis, 1)
    return lo, hi, e


@kernel
def nearest_place_of(curves, sliders, contact, sides, k, q, s, low, high, length, steps, out):
    """Find the place nearest to the point of slider k, from s on in at most `steps` iterations, between arc lengths low and
    high."""
    c = sliders.curve[k]
    nodes = nodes_of.call(curves, c)
    point = ld3(q, 12 * sliders.point[k], 1)
    for _ in range(steps):
        lo, hi, contact.element[k] = shapes_at_place(curves, c, s, contact.element[k], contact)
        gap = point
        tangent = zero3()
        bend = zero3()
        for a in range(lo, hi):
            i = slot.call(nodes, a)
            x = ld3(q, 12 * node_of.call(nodes, a), 1)
            gap = gap - contact.basis[0, i] * x
            tangent += contact.basis[1, i] * x
            bend += contact.basis[2, i] * x
        square = dot(tangent, tangent)
        slope = square - dot(gap, bend)
        before = s
        s = min(max(s + dot(gap, tangent) / (slope if slope > 0.5 * square else square), low), high)
        # Newton's method squares the error
        if abs(s - before) <= NEAR * length:
            break
    lo, hi, contact.element[k] = shapes_at_place(curves, c, s, contact.element[k], contact)
    gap = point
    tangent = zero3()
    normal = zero3()
    for a in range(lo, hi):
        i = slot.call(nodes, a)
        o = 12 * node_of.call(nodes, a)
        x = ld3(q, o, 1)
        gap = gap - contact.basis[0, i] * x
        tangent += contact.basis[1, i] * x
        at = 3 * (sides.start[k] + i)
        for j in range(3):
            normal += (contact.basis[0, i] * sides.side[at + j]) * ld3(q, o + 3 + 3 * j, 1)
    tangent = (1.0 / dot(tangent, tangent)**0.5) * tangent
    normal = normal - dot(normal, tangent) * tangent
    normal = (1.0 / dot(normal, normal)**0.5) * normal
    out[0] = s
    out[1] = dot(normal, gap)
    out[2] = dot(gap, tangent)
    out[3] = abs(dot(gap, cross(tangent, normal)))
    st3(out, 4, 1, normal)
