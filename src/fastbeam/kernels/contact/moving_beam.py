"""Beams whose mesh moves with its contacts, theory.md 5.12: tables, and energies of a shape.

Element ends are shares of the places y(s) at two neighbouring contacts (or of an end of the beam), x = (1 - f) y_a + f y_b, so
that with the derivative g = sum N_A' q_A by the coordinate of the element, 0 to 1, its length h, and xr = dx/dt at a point

    velocity  a - xr g/h,   a = sum N_A q_A',       T = 1/2 int rho (h a.a - 2 xr a.g + xr^2 g.g/h)

The history keeps the momenta per reference length, m = h a - xr g at every point: T = 1/2 int rho m.m/h.

Arrays: q, p_out [12 N], of the weight in a plane q [4 N]; s [*], places of all sliders; shape [2, points, n]; history [*]; out
[9].
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import position, vector
from fastbeam.kernels.algebra.vectors import add3, cross, dot, ld3, zero3
from fastbeam.kernels.beams.element_loop import ElementTables
from fastbeam.kernels.contact.moving_places import place_of
from fastbeam.kernels.contact.slider import Following
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.terms import put_loads


class MovingBeam(NamedTuple):
    """One beam with E elements of n nodes and S contacts. In a plane there are 3 strains, and inertia of the position and one
    director."""

    strains: Any         # strain_measures.SimoReissner
    tables: ElementTables  # of groups of 8 elements; `tab` changes in every evaluation
    inner: Any           # inner_nodes.Inner, or NoInner where no nodes are eliminated
    following: Following
    lane: np.ndarray     # int64 [8 G]: element of every lane; idle ones repeat the last
    node: np.ndarray     # int64 [E, n]
    entry: np.ndarray    # int64 [E, 2, n]: numbers of the nodes among those of the contact behind, and of that ahead
    place: np.ndarray    # int64 [5]: of the momenta in the history, first node, nodes; pairs of contacts before these;
    # in a plane the first number of the director with inertia among those of a point.
    # The momenta: h (a - xr g/h) of every element, mass point and field, [E, points, 4, 3]; behind them ds/dt of the contacts
    # [S], and the work of the weight
    slot: np.ndarray     # int64 [E, 2]: contacts that elements lie between, or -1
    slider: np.ndarray   # int64 [S]: sliders of the contacts
    first: np.ndarray    # int64 [1]: number of the first contact among those of all beams
    share: np.ndarray    # float64 [E, 2]: f at both ends
    length: np.ndarray   # float64 [2]: length of the beam, and least length between two contacts
    mass_shape: np.ndarray  # float64 [2, points, n]: shape functions and slopes
    mass_point: np.ndarray  # float64 [2, points]: coordinates and weights
    shape: np.ndarray    # float64 [2, points, n]: at points of the strain energy
    edge: np.ndarray     # float64 [2, n]: slopes at both ends
    weight: np.ndarray   # float64 [points]
    stiffness: np.ndarray  # float64 [6, 6]
    reference: np.ndarray  # float64 [6]: strains of the reference curve
    rest: np.ndarray     # float64 [K, points, 6 or 3]: length times strains of an element with nodes on it, by powers of that
    rest_until: np.ndarray  # float64 [1]: length up to which that holds
    rest_slope: np.ndarray  # float64 [points, 6 or 3]: its derivative there, which it has beyond
    rho: np.ndarray      # float64 [4 or 2]: inertia of position and directors
    weighs: np.ndarray   # float64 [3 or 2]: rhoA times gravity
    within: np.ndarray   # float64 [36], in a plane: four vectors whose products with the momenta of position and director in the
    #                      history are those of its coordinates, then, of every vector of the history, two by which it follows
    scratch: np.ndarray  # float64 [*]: `moving_elements.Moved` of a group
    carried: np.ndarray  # float64 [*]: motion of the inner nodes of all groups with the places behind and ahead while element
    #                      ends stay, where they are eliminated from the border


class MovingRows(NamedTuple):
    """Rows of the nodes of a beam, once contacts inside elements have put their forces on inner nodes, which are eliminated."""

    beam: MovingBeam


@kernel
def ends_of(beam, e, s):
    """Return the places of the element ends at the contacts behind and ahead of an element, with those of all sliders [*]."""
    a = beam.slot[e, 0]
    b = beam.slot[e, 1]
    begin = 0.0
    end = beam.length[0]
    if a >= 0:
        begin = place_of(beam.following, beam.first[0] + a, s[beam.slider[a]])
    if b >= 0:
        end = place_of(beam.following, beam.first[0] + b, s[beam.slider[b]])
    return begin, end


@kernel
def size_of(beam, e, s):
    """Return the length of an element."""
    begin, end = ends_of(beam, e, s)
    return (beam.share[e, 1] - beam.share[e, 0]) * (end - begin)


class MovingGravity(NamedTuple):
    """Factors of gravity on a moving beam in every substep."""

    gravity: np.ndarray     # float64 [1]: as in `Following`
    factors: np.ndarray     # float64 [substeps]


@put_loads.register(MovingGravity)
@kernel
def put_gravity(term, system, k):
    term.gravity[0] = term.factors[k]


@kernel
def density_place(beam, e, g, k):
    """Return the index in the history of the momentum of field k at mass point g."""
    return beam.place[0] + 12 * (e * beam.mass_point.shape[1] + g) + 3 * k


@kernel
def sum_of(beam, e, shape, kind, g, q, field):
    """Return the sum of shape functions (kind 0) or slopes (1) at point g times a field of the nodes."""
    x = zero3()
    for a in range(beam.node.shape[1]):
        x += shape[kind, g, a] * ld3(q, 12 * beam.node[e, a] + 3 * field, 1)
    return x


@kernel
def height_of(beam, q, s, dofs):
    """Return the work of the full weight on its way from the origin: sum of h m phi . rhoA g."""
    out = 0.0
    force = vector(beam.weighs, 0, 1, dofs)
    for e in range(beam.node.shape[0]):
        h = size_of(beam, e, s)
        for g in range(beam.mass_point.shape[1]):
            for a in range(beam.node.shape[1]):
                share = h * beam.mass_point[1, g] * beam.mass_shape[0, g, a]
                out += share * dot(force, position(q, beam.node[e, a], dofs))
    return out


@kernel
def motion_of(beam, s, history, p_out):
    """Return T, and add momenta of nodes to p_out [12 N]."""
    out = 0.0
    for e in range(beam.node.shape[0]):
        h = size_of(beam, e, s)
        for g in range(beam.mass_point.shape[1]):
            for k in range(4):
                c = beam.mass_point[1, g] * beam.rho[k]
                m = ld3(history, density_place(beam, e, g, k), 1)
                out += 0.5 * c * dot(m, m) / h
                for a in range(beam.node.shape[1]):
                    add3(p_out, 12 * beam.node[e, a] + 3 * k, 1, (c * beam.mass_shape[0, g, a]) * m)
    return out


@kernel
def rest_of(beam, g, i, h):
    """Return strain i of the reference at point g of an element of length h."""
    x = min(h, beam.rest_until[0])
    value = 0.0
    for k in range(beam.rest.shape[0] - 1, -1, -1):
        value = value * x + beam.rest[k, g, i]
    return (value + (h - x) * beam.rest_slope[g, i]) / h


@kernel
def energy_at(beam, e, g, q, h):
    """Return E C E of the strains (2.2) less those of the reference at a point with stored energy."""
    over = 1.0 / h
    # slopes of equal positions do not vanish to the last bit, so positions count from the first node
    f = zero3()
    first = ld3(q, 12 * beam.node[e, 0], 1)
    for a in range(1, beam.node.shape[1]):
        f += (over * beam.shape[1, g, a]) * (ld3(q, 12 * beam.node[e, a], 1) - first)
    d1 = sum_of(beam, e, beam.shape, 0, g, q, 1); d2 = sum_of(beam, e, beam.shape, 0, g, q, 2)
    d3 = sum_of(beam, e, beam.shape, 0, g, q, 3)
    k1 = over * sum_of(beam, e, beam.shape, 1, g, q, 1); k2 = over * sum_of(beam, e, beam.shape, 1, g, q, 2)
    k3 = over * sum_of(beam, e, beam.shape, 1, g, q, 3)
    c = 0.5 * (1.75 - 0.25 * (dot(d1, d1) + dot(d2, d2) + dot(d3, d3)))
    g2 = dot(f, d2); g3 = dot(f, d3)
    strains = ((dot(f, f) - g2 * g2 - g3 * g3)**0.5 - rest_of(beam, g, 0, h), g2 - rest_of(beam, g, 1, h),
               g3 - rest_of(beam, g, 2, h), c * (dot(k2, d3) - dot(k3, d2)) - rest_of(beam, g, 3, h),
               c * (dot(k3, d1) - dot(k1, d3)) - rest_of(beam, g, 4, h),
               c * (dot(k1, d2) - dot(k2, d1)) - rest_of(beam, g, 5, h))
    out = 0.0
    for i in range(6):
        for j in range(6):
            out += strains[i] * beam.stiffness[i, j] * strains[j]
    return out


@kernel
def energy_of_moving(beam, q, s):
    """Return the stored energy, without that of the weight."""
    out = 0.0
    for e in range(beam.node.shape[0]):
        h = size_of(beam, e, s)
        for g in range(beam.weight.shape[0]):
            out += 0.5 * h * beam.weight[g] * energy_at(beam, e, g, q, h)
    return out


@kernel
def momentum_sums(q, p, out):
    """Add linear and angular momentum of nodes with momenta p [12 N] to out[1:4] and out[4:7], their sizes to out[7], out[8]."""
    for i in range(q.shape[0] // 12):
        for k in range(0, 12, 3):
            pk = ld3(p, 12 * i + k, 1)
            if k == 0:
                add3(out, 1, 1, pk)
                out[7] += dot(pk, pk)**0.5
            x = cross(ld3(q, 12 * i + k, 1), pk)
            add3(out, 4, 1, x)
            out[8] += dot(x, x)**0.5
