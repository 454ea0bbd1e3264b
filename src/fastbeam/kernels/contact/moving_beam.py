"""Element arrays of points of beams whose mesh moves with its contacts, theory.md 5.12.

Element ends are shares of the places s of two neighbouring contacts (or of an end of the beam), x = (1 - f) s_a + f s_b, so that
with the derivative g = sum N_A' q_A by the coordinate of the element, 0 to 1, its length h, and xr = dx/dt at a point

    velocity  a - xr g/h,   a = sum N_A q_A',       T = 1/2 int rho (h a.a - 2 xr a.g + xr^2 g.g/h)

The history keeps the momenta per reference length, m = h a - xr g at every point: T = 1/2 int rho m.m/h. Derivatives of T, of the
strains and of h are discrete ones: products of means and differences of quantities that rigid motions do not change.

Arrays: u, v, q [12 N]; shape [2, points, n]; reference [6]; stiffness [6, 6]; out [84 n].
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.vectors import add3, dot, ld3, zero3
from fastbeam.kernels.jit.decorators import kernel


class Scratch(NamedTuple):
    """Work arrays of one element with n nodes: sums over its points. Coordinates of a node are numbered by field, 4 of 3."""

    iso: np.ndarray      # float64 [4 n, 4 n]: multiples of the identity between fields
    force: np.ndarray    # float64 [12 n + 2]: on coordinates, and on the places at both ends
    column: np.ndarray   # float64 [24 n]: derivatives of forces on coordinates by both places
    line: np.ndarray     # float64 [24 n]: derivatives of forces on places by coordinates
    corner: np.ndarray   # float64 [2, 2]: derivatives of forces on places by places
    left: np.ndarray     # float64 [84 n]: gradients of the forms of strain at the mean
    right: np.ndarray    # float64 [84 n]: gradients at the end
    rows: np.ndarray     # float64 [42 n]: both gradients for unknowns of the nodes
    lines: np.ndarray    # float64 [42 n]
    d: np.ndarray        # float64 [7, 7]: derivatives of stresses on forms by forms
    g: np.ndarray        # float64 [2, 6, 7]: derivatives of strains by forms: means, and at the end
    form: np.ndarray     # float64 [2, 7]: forms by the coordinate of the element at both ends of the step
    scale: np.ndarray    # float64 [5, 7]: powers of 1/h at both ends, difference over Dh, its derivative, derivative at the end
    strain: np.ndarray   # float64 [3, 6]: strains less those of the reference at both ends, mean stress
    stress: np.ndarray   # float64 [7]: stresses on forms
    k: np.ndarray        # float64 [6 n + 2, 6 n + 2]: the tangent


class MovingBeam(NamedTuple):
    """One beam with E elements of n nodes and S contacts."""

    node: np.ndarray     # int64 [E, n]
    row: np.ndarray      # int64 [E, n + 2]: rows of nodes, then of places of contacts; -1 at an end of the beam
    block: np.ndarray    # int64 [E, n + 2, n + 2]
    place: np.ndarray    # int64 [4]: of the momenta in the history, first node, nodes; contacts and ends of beams before these.
    # The momenta: h (a - xr g/h) of every element, mass point and field, [E, points, 4, 3]; behind them the work of the weight
    slot: np.ndarray     # int64 [E, 2]: contacts that elements lie between, or -1
    places: np.ndarray   # int64 [S]: nodes whose first coordinate is s
    place_rows: np.ndarray  # int64 [S]
    share: np.ndarray    # float64 [E, 2]: f at both ends
    length: np.ndarray   # float64 [2]: length of the beam, and least length between two contacts
    mass_shape: np.ndarray  # float64 [2, points, n]: shape functions and slopes
    mass_point: np.ndarray  # float64 [2, points]: coordinates and weights
    shape: np.ndarray    # float64 [2, points, n]: at points of the strain energy
    weight: np.ndarray   # float64 [points]
    stiffness: np.ndarray  # float64 [6, 6]
    reference: np.ndarray  # float64 [6]
    rho: np.ndarray      # float64 [4]: inertia of position and directors
    weighs: np.ndarray   # float64 [3]: rhoA times gravity
    held: np.ndarray     # int64 [H, 2]: nodes of contacts, and of points that multipliers hold there
    held_row: np.ndarray  # int64 [H]: rows of the nodes of contacts
    held_block: np.ndarray  # int64 [H, 2]: blocks contact-contact, contact-point
    scratch: Scratch


@kernel
def ends_of(beam, e, q, v):
    """Return the places s and rates of both contacts of an element."""
    a = beam.slot[e, 0]
    b = beam.slot[e, 1]
    sa = 0.0; ra = 0.0; rb = 0.0
    sb = beam.length[0]
    if a >= 0:
        sa = q[12 * beam.places[a]]
        ra = v[12 * beam.places[a]]
    if b >= 0:
        sb = q[12 * beam.places[b]]
        rb = v[12 * beam.places[b]]
    return sa, sb, ra, rb


@kernel
def size_of(beam, e, q, v):
    """Return the length of an element."""
    sa, sb, _, _ = ends_of(beam, e, q, v)
    return (beam.share[e, 1] - beam.share[e, 0]) * (sb - sa)


@kernel
def rate_of(beam, e, g, q, v):
    """Return dx/dt at mass point g of an element, and f there."""
    _, _, ra, rb = ends_of(beam, e, q, v)
    f = beam.share[e, 0] + beam.mass_point[0, g] * (beam.share[e, 1] - beam.share[e, 0])
    return (1.0 - f) * ra + f * rb, f


@kernel
def sum_of(beam, e, shape, kind, g, q, field):
    """Return the sum of shape functions (kind 0) or slopes (1) at point g times a field of the nodes."""
    x = zero3()
    for a in range(beam.node.shape[1]):
        x += shape[kind, g, a] * ld3(q, 12 * beam.node[e, a] + 3 * field, 1)
    return x


@kernel
def clear_element(w):
    for i in range(w.iso.shape[0]):
        for j in range(w.iso.shape[1]):
            w.iso[i, j] = 0.0
    for i in range(w.force.shape[0]):
        w.force[i] = 0.0
    for i in range(w.column.shape[0]):
        w.column[i] = 0.0
        w.line[i] = 0.0
    for i in range(2):
        for j in range(2):
            w.corner[i, j] = 0.0


# --- kinetic energy -----------------------------------------------------------------------------------------------------
@kernel
def density_place(beam, e, g, k):
    """Return the index in the history of the momentum of field k at mass point g."""
    return beam.place[0] + 12 * (e * beam.mass_point.shape[1] + g) + 3 * k


@kernel
def means_of_point(beam, e, g, k, state, work, h):
    """Return the mean rate a of field k over the step, and its slopes g at both ends."""
    a0 = sum_of(beam, e, beam.mass_shape, 0, g, state.v, k)
    a = a0 + 0.5 * h * sum_of(beam, e, beam.mass_shape, 0, g, work.u, k)
    g0 = sum_of(beam, e, beam.mass_shape, 1, g, state.q, k)
    g1 = sum_of(beam, e, beam.mass_shape, 1, g, work.q_end, k)
    return a, g0, g1


@kernel
def rates_of_point(beam, e, g, state, work, h):
    """Return the length of the element at both ends of the step, mean dx/dt, and f."""
    h0 = size_of(beam, e, state.q, state.v)
    h1 = size_of(beam, e, work.q_end, state.v)
    x0, f = rate_of(beam, e, g, state.q, state.v)
    more, _ = rate_of(beam, e, g, state.q, work.u)
    return h0, h1, x0 + 0.5 * h * more, f


@kernel
def mean_density(beam, e, g, k, state, work, h):
    """Return the mean momentum of field k at mass point g over the step, per mass."""
    h0, h1, x, _ = rates_of_point(beam, e, g, state, work, h)
    a, g0, g1 = means_of_point(beam, e, g, k, state, work, h)
    return (2.0 * h0 * h1 / (h0 + h1)) * a - (0.5 * x) * (g0 + g1)


@kernel
def add_inertia(beam, e, g, k, state, work, h):
    """Add changes of momenta less dT/dq and dT/ds of field k at point g, and all derivatives of these."""
    w = beam.scratch
    n = beam.node.shape[1]
    h0, h1, x, f = rates_of_point(beam, e, g, state, work, h)
    a, g0, g1 = means_of_point(beam, e, g, k, state, work, h)
    c = beam.mass_point[1, g] * beam.rho[k]
    r = 2.0 / h
    hh = 1.0 / (h0 * h1)
    im = 0.5 * (1.0 / h0 + 1.0 / h1); ih = -0.5 / (h1 * h1)
    gm = 0.5 * (g0 + g1)
    mean = (1.0 / im) * a - x * gm
    m0 = ld3(state.history, density_place(beam, e, g, k), 1)
    m1 = 2.0 * mean - m0
    # derivatives of the mean momentum by x and h1
    mean_h = (-ih / (im * im)) * a
    before = dot(m0, g0); after = dot(m1, g1)
    rate = -0.5 * r * c * (after / h1 - before / h0)
    size = -c * hh * (0.25 * (dot(m0, m0) + dot(m1, m1)) + 0.5 * x * (before + after))
    rate_x = r * c * dot(gm, g1) / h1; rate_h = -0.5 * r * c * (2.0 * dot(mean_h, g1) - after / h1) / h1
    size_x = c * hh * (dot(gm, m1) + x * dot(gm, g1) - 0.5 * (before + after))
    size_h = -c * hh * (dot(mean_h, m1) + x * dot(mean_h, g1)) - size / h1
    df = beam.share[e, 1] - beam.share[e, 0]
    for i in range(n):
        na = beam.mass_shape[0, g, i]; da = beam.mass_shape[1, g, i]
        o = 12 * i + 3 * k
        add3(w.force, o, 1, (c * na * r) * (mean - m0) + (c * da * x * im) * mean)
        by_x = (-c * na * r) * gm + (c * da * im) * (mean - x * gm)
        by_h = (c * na * r) * mean_h + (c * da * x) * (im * mean_h + ih * mean)
        # derivatives of the mean momentum by coordinates
        own = 0.5 * (r * na / im - x * da)
        to_rate = (-0.5 * r * c / h1) * ((2.0 * own) * g1 + da * m1)
        to_size = (-c * hh) * (own * m1 + (x * own) * g1 + (0.5 * x * da) * m1)
        for side in range(2):
            part = f if side == 1 else 1.0 - f
            way = df if side == 1 else -df
            add3(w.column, 12 * n * side + o, 1, (0.5 * r * part) * by_x + way * by_h)
            add3(w.line, 12 * n * side + o, 1, part * to_rate + way * to_size)
        for b in range(n):
            nb = beam.mass_shape[0, g, b]; db = beam.mass_shape[1, g, b]
            w.iso[4 * i + k, 4 * b + k] += c * (na * r + da * x * im) * 0.5 * (r * nb / im - x * db)
    for side in range(2):
        part = f if side == 1 else 1.0 - f
        way = df if side == 1 else -df
        w.force[12 * n + side] += part * rate + way * size
        for other in range(2):
            part2 = 0.5 * r * (f if other == 1 else 1.0 - f)
            way2 = df if other == 1 else -df
            w.corner[side, other] += part * (rate_x * part2 + rate_h * way2) + way * (size_x * part2 + size_h * way2)


# --- stored energy ------------------------------------------------------------------------------------------------------
@kernel
def put_forms(beam, e, g, q, end, slope, out):
    """Store forms of strain by the coordinate of the element in scratch.form[end] (end 0, 1), and their gradients at q in out
    where slope is not 0."""
    f = sum_of(beam, e, beam.shape, 1, g, q, 0)
    d1 = sum_of(beam, e, beam.shape, 0, g, q, 1); d2 = sum_of(beam, e, beam.shape, 0, g, q, 2)
    d3 = sum_of(beam, e, beam.shape, 0, g, q, 3)
    k1 = sum_of(beam, e, beam.shape, 1, g, q, 1); k2 = sum_of(beam, e, beam.shape, 1, g, q, 2)
    k3 = sum_of(beam, e, beam.shape, 1, g, q, 3)
    if end >= 0:
        o = beam.scratch.form
        o[end, 0] = 0.5 * dot(f, f); o[end, 1] = dot(f, d2); o[end, 2] = dot(f, d3)
        o[end, 3] = 0.5 * (dot(k2, d3) - dot(k3, d2)); o[end, 4] = 0.5 * (dot(k3, d1) - dot(k1, d3))
        o[end, 5] = 0.5 * (dot(k1, d2) - dot(k2, d1))
        o[end, 6] = -0.25 * (dot(d1, d1) + dot(d2, d2) + dot(d3, d3))
    if slope == 0:
        return
    for i in range(out.shape[0]):
        out[i] = 0.0
    size = 12 * beam.node.shape[1]
    for a in range(beam.node.shape[1]):
        n = beam.shape[0, g, a]; s = beam.shape[1, g, a]
        o = 12 * a
        half, turn = 0.5 * n, 0.5 * s
        add3(out, o, 1, s * f)
        add3(out, size + o, 1, s * d2)
        add3(out, size + o + 6, 1, n * f)
        add3(out, 2 * size + o, 1, s * d3)
        add3(out, 2 * size + o + 9, 1, n * f)
        add3(out, 3 * size + o + 6, 1, turn * d3 - half * k3)
        add3(out, 3 * size + o + 9, 1, half * k2 - turn * d2)
        add3(out, 4 * size + o + 9, 1, turn * d1 - half * k1)
        add3(out, 4 * size + o + 3, 1, half * k3 - turn * d3)
        add3(out, 5 * size + o + 3, 1, turn * d2 - half * k2)
        add3(out, 5 * size + o + 6, 1, half * k1 - turn * d1)
        add3(out, 6 * size + o + 3, 1, (-half) * d1)
        add3(out, 6 * size + o + 6, 1, (-half) * d2)
        add3(out, 6 * size + o + 9, 1, (-half) * d3)


@kernel
def put_scales(w, h0, h1):
    """Store the powers of 1/h of all forms."""
    for i in range(7):
        two = i == 0
        one = 0 < i < 6
        w.scale[0, i] = 1.0 / (h0 * h0) if two else 1.0 / h0 if one else 1.0
        w.scale[1, i] = 1.0 / (h1 * h1) if two else 1.0 / h1 if one else 1.0
        w.scale[2, i] = -(h0 + h1) / (h0 * h0 * h1 * h1) if two else -1.0 / (h0 * h1) if one else 0.0
        w.scale[3, i] = (2.0 * h0 + h1) / (h0 * h0 * h1 * h1 * h1) if two else 1.0 / (h0 * h1 * h1) if one else 0.0
        w.scale[4, i] = -2.0 / (h1 * h1 * h1) if two else -1.0 / (h1 * h1) if one else 0.0


@kernel
def strains_at(w, end, reference):
    """Store strains less those of the reference in strain[end]; return r and c."""
    x2 = w.form[end, 1] * w.scale[end, 1]; x3 = w.form[end, 2] * w.scale[end, 2]
    r = (2.0 * w.form[end, 0] * w.scale[end, 0] - x2 * x2 - x3 * x3)**0.5
    c = 1.75 + w.form[end, 6]
    w.strain[end, 0] = r
    w.strain[end, 1] = x2
    w.strain[end, 2] = x3
    for i in range(3):
        w.strain[end, 3 + i] = c * w.form[end, 3 + i] * w.scale[end, 3 + i]
    for i in range(6):
        w.strain[end, i] -= reference[i]
    return r, c


@kernel
def put_slopes(w, at, r, c, first, second):
    """Store derivatives of strains by forms in g[at], with the means of the forms of ends `first` and `second`."""
    for i in range(6):
        for j in range(7):
            w.g[at, i, j] = 0.0
    for i in range(1, 6):
        x = 0.5 * (w.form[first, i] * w.scale[first, i] + w.form[second, i] * w.scale[second, i])
        if i < 3:
            w.g[at, i, i] = 1.0
            w.g[at, 0, i] = -x / r
        else:
            w.g[at, i, i] = c
            w.g[at, i, 6] = x
    w.g[at, 0, 0] = 1.0 / r


@kernel
def put_stresses(w, stiffness):
    """Store the mean stress, stresses on forms, and derivatives of these by forms at the end."""
    for i in range(6):
        x = 0.0
        for j in range(6):
            x += 0.5 * stiffness[i, j] * (w.strain[0, j] + w.strain[1, j])
        w.strain[2, i] = x
    for j in range(7):
        x = 0.0
        for i in range(6):
            x += w.g[0, i, j] * w.strain[2, i]
        w.stress[j] = x
    for i in range(7):
        for j in range(7):
            x = 0.0
            for k in range(6):
                if w.g[0, k, i] != 0.0:
                    for m in range(6):
                        c = stiffness[k, m] - (w.stress[0] if k == m and k < 3 else 0.0)
                        x += 0.5 * w.g[0, k, i] * c * w.g[1, m, j]
            w.d[i, j] = x
    for i in range(3, 6):
        w.d[i, 6] += 0.5 * w.strain[2, i]
        w.d[6, i] += 0.5 * w.strain[2, i]


@kernel
def add_shape_stiffness(beam, g, c):
    """Add c/2 times the second derivatives of the forms, weighted with their stresses."""
    w = beam.scratch
    n = beam.node.shape[1]
    for i in range(7):
        t = 0.25 * c * w.stress[i] * (w.scale[0, i] + w.scale[1, i])
        for a in range(n):
            na = beam.shape[0, g, a]; sa = beam.shape[1, g, a]
            for b in range(n):
                nb = beam.shape[0, g, b]; sb = beam.shape[1, g, b]
                if i == 0:
                    w.iso[4 * a, 4 * b] += t * sa * sb
                elif i < 3:
                    w.iso[4 * a, 4 * b + 1 + i] += t * sa * nb
                    w.iso[4 * a + 1 + i, 4 * b] += t * na * sb
                elif i < 6:
                    # torsion couples d2 with d3, bending d3 with d1 and d1 with d2
                    first = 1 + (i - 2) % 3
                    second = 1 + (i - 1) % 3
                    w.iso[4 * a + first, 4 * b + second] += 0.5 * t * (sa * nb - na * sb)
                    w.iso[4 * a + second, 4 * b + first] += 0.5 * t * (na * sb - sa * nb)
                else:
                    for d in range(1, 4):
                        w.iso[4 * a + d, 4 * b + d] -= 0.5 * t * na * nb


@kernel
def energy_at(w, end, stiffness):
    """Return E C E of the strains of one end."""
    x = 0.0
    for i in range(6):
        for j in range(6):
            x += w.strain[end, i] * stiffness[i, j] * w.strain[end, j]
    return x
