"""Places of element ends that follow contacts, and of contacts on the mesh, theory.md (5.24).

The element end of a contact at s is at y(s) = s + e(s) - e(L - s), which is s but near the ends of the beam, from which y keeps a
distance. There the contact lies inside an element, at u(s) along the beam as it was compiled, whose nodes are those of the mesh.

Arrays: reach [F, 4], shift [F, 5] and condensed [F, 4] of `slider.Following`; s [*], places of all sliders.
"""
from __future__ import annotations

from typing import NamedTuple

from fastbeam.kernels.jit.decorators import inlined, kernel

# columns of `Following.reach`: length of the beam, distances kept from its start and its end, 0 where other contacts are between,
# and the place of the element end on the beam as it was compiled; of `Following.shift`: mean slope of y in the step, its slope at
# the end of the step, the derivative of the former by the place at the end, and y at both ends of the step
LENGTH, FROM_START, FROM_END, NODE_AT = range(4)
MEAN, SLOPE, BEND, BEFORE, AFTER = range(5)
# columns of `Following.condensed`: 1 where inner nodes are eliminated from the border, now and while contacts are nodes; where
# rows of the beam wait for the forces of contacts on inner nodes, now and while contacts are inside elements
NOW, ALLOWED, WAITS, MAY_WAIT = range(4)


class InStep(NamedTuple):
    """Number that follows from a place: at both ends of a step, its divided difference by the place, its derivative at the end of
    the step, and that of the divided difference."""

    start: float
    end: float
    mean: float
    slope: float
    bend: float


@kernel
def excess(x0, x1, r):
    """Return the length e that is added to a distance from an end, which goes from x0 to x1: e = r (1 - z)^3 (1 + z), z = x/2r,
    for x from 0 to 2r; 0 beyond, and x + e = r on the way of an iteration behind the end."""
    if r == 0.0 or (x0 >= 2.0 * r and x1 >= 2.0 * r):
        return InStep(0.0, 0.0, 0.0, 0.0, 0.0)
    a = min(max(0.0, 1.0 - 0.5 * x0 / r), 1.0)
    b = min(max(0.0, 1.0 - 0.5 * x1 / r), 1.0)
    squares = a * a + b * b
    mean = 2.0 * (squares + a * b) - (a + b) * squares
    slope = -b * b * (3.0 - 2.0 * b)
    start = r * a**3 * (2.0 - a) - min(x0, 0.0)
    end = r * b**3 * (2.0 - b) - min(x1, 0.0)
    if min(x0, x1) >= 0.0 and max(x0, x1) <= 2.0 * r:
        return InStep(start, end, -0.5 * mean, slope, 0.25 / r * (2.0 * (a + 2.0 * b) - squares - 2.0 * b * (a + b)))
    if max(x0, x1) <= 0.0:
        return InStep(start, end, -1.0, -1.0, 0.0)
    # the step leads from one part to another
    mean = (mean * r * (b - a) - (min(x1, 0.0) - min(x0, 0.0))) / (x1 - x0)
    return InStep(start, end, mean, slope, (slope - mean) / (x1 - x0))


@kernel
def place_at(s, length, from_start, from_end):
    """Return the place y of the element end that follows a contact at s, with the distances kept from both ends."""
    return s + excess(s, s, from_start).end - excess(length - s, length - s, from_end).end


@kernel
def place_of(following, f, s):
    """Return the place y of the element end that follows contact f at s."""
    reach = following.reach[f]
    return place_at(s, reach[LENGTH], reach[FROM_START], reach[FROM_END])


@kernel
def slope_of(following, f, s):
    """Return the derivative of y at contact f by its place."""
    reach = following.reach[f]
    t = reach[LENGTH] - s
    return 1.0 + excess(s, s, reach[FROM_START]).slope + excess(t, t, reach[FROM_END]).slope


@inlined
def is_on_node(following, f, s):
    """Return whether contact f at s is at an element end."""
    reach = following.reach[f]
    return s >= 2.0 * reach[FROM_START] and reach[LENGTH] - s >= 2.0 * reach[FROM_END]


@kernel
def put_shift(following, f, s0, s1):
    """Store how the element end at contact f follows from s0 to s1."""
    reach = following.reach[f]
    t0 = reach[LENGTH] - s0
    t1 = reach[LENGTH] - s1
    low = excess(s0, s1, reach[FROM_START])
    high = excess(t0, t1, reach[FROM_END])
    following.shift[f, MEAN] = 1.0 + low.mean + high.mean
    following.shift[f, SLOPE] = 1.0 + low.slope + high.slope
    following.shift[f, BEND] = low.bend - high.bend
    following.shift[f, BEFORE] = s0 + low.start - high.start
    following.shift[f, AFTER] = s1 + low.end - high.end


@kernel
def share_of_excess(x0, x1, r):
    """Return e/(x + e) for a distance that goes from x0 to x1."""
    e = excess(x0, x1, r)
    y0 = x0 + e.start
    y1 = x1 + e.end
    if r == 0.0:
        return InStep(0.0, 0.0, 0.0, 0.0, 0.0)
    by_step = x0 * e.mean - e.start
    over = 1.0 / (y0 * y1)
    return InStep(e.start / y0, e.end / y1, by_step * over, (x1 * e.slope - e.end) / (y1 * y1),
                  over * (x0 * e.bend - by_step * (1.0 + e.slope) / y1))


@kernel
def on_mesh(following, f, s0, s1):
    """Return the place u of contact f, which goes from s0 to s1, along the beam as it was compiled."""
    reach = following.reach[f]
    at = reach[NODE_AT]
    rest = reach[LENGTH] - at
    low = share_of_excess(s0, s1, reach[FROM_START])
    high = share_of_excess(reach[LENGTH] - s0, reach[LENGTH] - s1, reach[FROM_END])
    return InStep(at * (1.0 - low.start) + rest * high.start, at * (1.0 - low.end) + rest * high.end,
                  -at * low.mean - rest * high.mean, -at * low.slope - rest * high.slope, rest * high.bend - at * low.bend)


@inlined
def entries_of_border(following, f):
    """Return how many nodes the border of contact f has: element ends alone where inner nodes are eliminated from it."""
    return following.ends[f] if following.condensed[f, NOW] != 0 else following.nodes.shape[1]
