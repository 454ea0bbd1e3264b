"""Elements of a beam whose ends move along it in a step, in lanes: what theory.md 5.12 adds to the element loop.

The element loop evaluates the forces at the mean length of an element over the step, from tables that `stretch_tables` writes
before every evaluation. Here are the others: inertia, weight, forces along the beam on both ends of an element, and derivatives
of all forces by the places of the ends, in space and in a plane. Offsets count doubles; one number of each of the 8 elements of a
group takes 8 of them.

Arrays: tab, constants [*], the tables of a group, and scratch [*], its numbers in lanes: layout.py has their places, those of
`Moved` are behind; of [3].
"""
from __future__ import annotations

from typing import NamedTuple

from fastbeam.kernels.algebra.dimensions import Plane, Space, add_lanes, moment, put_lanes, vector_lanes, zero_lanes, zero_moment
from fastbeam.kernels.algebra.native import vld, vst, vst3, vzero
from fastbeam.kernels.algebra.vectors import dot, smaller, triple
from fastbeam.kernels.beams.motions import add_inertia, put_forms
from fastbeam.kernels.beams.planar import Shape, planar_shapes
from fastbeam.kernels.beams.section_laws import apply_law, matrix_at, stress_of
from fastbeam.kernels.beams.strain_measures import (
    add_forces,
    mean_of_forms,
    planar_director_forces,
    planar_form_stresses,
    planar_point_data,
    planar_position_force,
    planar_strains,
    present_strains,
)
from fastbeam.kernels.beams.strains import interpolate, stresses
from fastbeam.kernels.jit.decorators import inlined, kernel, separate
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.layout import BEFORE, END, MIDDLE, NODE_TABLE, SHAPE, SHAPES_AT, STRAINS, TEMPORARY, layout
from fastbeam.kernels.terms import Conserving

# numbers of an element behind its scratch of the element loop: lengths at both ends of the step, mean rates of both its ends, and
# the shares of the place ahead in these; forces on the places behind and ahead, and the part on the length of the element; their
# derivatives by these places; the weight by length; the position of the first node in the middle of the step, from which those of
# all nodes count; what both forces gain as inner nodes move under their own residual
LENGTHS, RATES, SHARES, FORCES, STRETCH, CORNER, WEIGHT, BASE, GAIN, INERTIA = 0, 16, 32, 48, 64, 72, 104, 128, 152, 168
# of a point, behind six strains of the reference with the length at the start of the step, what `put_rest` stores
REST_1, REST_SLOPE, REST_DIVIDED, REST_BEND, RESTS = 48, 96, 144, 192, 240


class MovingStep(Conserving):
    """Conserving step of elements whose ends move."""


MOVING_STEP = MovingStep()


class Moved(NamedTuple):
    """Offsets of the numbers of a group that only moving elements have; n nodes with C coordinates and U unknowns, and P points
    of the mass an element."""

    first: int     # where they begin
    inertia: int   # forces of inertia and weight on the coordinates, n x C
    momenta: int   # at the start of the step: P points, C numbers
    column: int    # derivatives of forces on coordinates by the places behind and ahead, 2 x n x C
    line: int      # derivatives of forces on these places by coordinates at the end of the step, 2 x n x C
    rows: int      # both, for unknowns: 4 x n x U
    rest: int      # strains of the reference that the element loop subtracts, of every point, then those of `put_rest`
    doubles: int
    vector: int    # distances of vectors, of nodes with all their coordinates, and with all their unknowns
    node: int
    unknowns: int
    fields: int    # vectors of a node: its position, then directors


@inlined
def moved(at, points, dofs):
    """Return the offsets of a group behind those of its layout; points: number of points of the mass."""
    n = len(dofs)
    vector = 24 if n == 6 else 16
    node = 96 if n == 6 else 32
    strains = 48 if n == 6 else 24
    inertia = at.doubles + INERTIA
    column = inertia + node * at.nn
    line = column + 2 * node * at.nn
    rows = line + 2 * node * at.nn
    momenta = rows + 32 * n * at.nn
    rest = momenta + node * points
    return Moved(at.doubles, inertia, momenta, column, line, rows, rest, rest + strains * at.nq + RESTS, vector, node, 8 * n,
                 node // vector)


@inlined
def way_of(scratch, x, point):
    """Return the mean rate of a point of the element over the step; point: its coordinate, 0 to 1."""
    return (1.0 - point) * vld(scratch, x.first + RATES, 0) + point * vld(scratch, x.first + RATES + 8, 0)


@inlined
def mean_of_inverse(scratch, x):
    """Return the mean of 1/length over both ends of the step."""
    return 0.5 * (1.0 / vld(scratch, x.first + LENGTHS, 0) + 1.0 / vld(scratch, x.first + LENGTHS + 8, 0))


@inlined
def stretch_tables(beam, tab, scratch, at, x, h):
    """Write the tables of the element loop for the mean length of the elements; masses are those of the tangent of `put_inertia`,
    which is not symmetric."""
    mean = 0.5 * (vld(scratch, x.first + LENGTHS, 0) + vld(scratch, x.first + LENGTHS + 8, 0))
    over = 1.0 / mean
    for g in range(at.nq):
        to = at.point + at.point_size * g
        vst(tab, to, 0, beam.weight[g] * mean)
        for a in range(at.nn):
            slope = beam.shape[1, g, a] * over
            vst(tab, to + 8 + NODE_TABLE * a, 0, slope)
            vst(tab, to + 24 + NODE_TABLE * a, 0, slope)
    size = at.nn * at.nn
    for i in range(size):
        vst(tab, at.masses + 8 * i, 0, 0.0)
    inverse = mean_of_inverse(scratch, x)
    half = 0.5 * h
    for g in range(beam.mass_point.shape[1]):
        way = half * way_of(scratch, x, beam.mass_point[0, g])
        for a in range(at.nn):
            row = beam.mass_point[1, g] * (beam.mass_shape[0, g, a] + beam.mass_shape[1, g, a] * (way * inverse))
            for b in range(at.nn):
                o = at.masses + 8 * (at.nn * a + b)
                column = beam.mass_shape[0, g, b] / inverse - beam.mass_shape[1, g, b] * way
                vst(tab, o, 0, vld(tab, o, 0) + row * column)
    for i in range(size):
        vst(tab, at.director_masses + 8 * i, 0, vld(tab, at.masses + 8 * i, 0))


class OfPoint(NamedTuple):
    """Mean momentum of a vector at a point over the step, by mass, without it, and slopes of the vector at both ends."""

    rate: object
    mean: object
    before: object
    after: object


@inlined
def mean_momentum(beam, scratch, at, x, g, k, dofs):
    """Return the mean momentum of vector k of the nodes at point g of the mass, theory.md (5.21)."""
    rate = zero_lanes(dofs); g0 = zero_lanes(dofs); g1 = zero_lanes(dofs)
    for a in range(at.nn):
        middle = vector_lanes(scratch, at.node * a + x.vector * k, dofs)
        end = vector_lanes(scratch, at.node * a + x.node + x.vector * k, dofs)
        d = beam.mass_shape[1, g, a]
        rate += beam.mass_shape[0, g, a] * vector_lanes(scratch, at.rates + x.node * a + x.vector * k, dofs)
        g0 += d * (2.0 * middle - end)
        g1 += d * end
    way = way_of(scratch, x, beam.mass_point[0, g])
    return OfPoint(rate, (1.0 / mean_of_inverse(scratch, x)) * rate - (0.5 * way) * (g0 + g1), g0, g1)


@kernel
def put_momenta(beam, scratch, at, x, dofs):
    """Replace the momenta of WIDTH elements at the start of the step by those at its end."""
    for g in range(beam.mass_point.shape[1]):
        for k in range(x.fields):
            if beam.rho[k] != 0.0:
                o = x.momenta + x.node * g + x.vector * k
                mean = mean_momentum(beam, scratch, at, x, g, k, dofs).mean
                put_lanes(scratch, o, 2.0 * mean - vector_lanes(scratch, o, dofs))


@inlined
def put_inertia(beam, scratch, at, x, g, k, h, dofs):
    """Add the changes of the momenta of vector k at point g of the mass less the derivatives of the kinetic energy: forces on
    nodes and on both ends of the element, and derivatives of these by the ends."""
    of = mean_momentum(beam, scratch, at, x, g, k, dofs)
    h0 = vld(scratch, x.first + LENGTHS, 0); h1 = vld(scratch, x.first + LENGTHS + 8, 0)
    point = beam.mass_point[0, g]
    way = way_of(scratch, x, point)
    c = beam.mass_point[1, g] * beam.rho[k]
    r = 2.0 / h
    inverse = 0.5 * (1.0 / h0 + 1.0 / h1)
    inverse_h = -0.5 / (h1 * h1)
    over = 1.0 / (h0 * h1)
    gm = 0.5 * (of.before + of.after)
    m0 = vector_lanes(scratch, x.momenta + x.node * g + x.vector * k, dofs)
    m1 = 2.0 * of.mean - m0
    # derivatives of the mean momentum by the length at the end
    mean_h = (-1.0 * inverse_h / (inverse * inverse)) * of.rate
    before = dot(m0, of.before); after = dot(m1, of.after)
    along = dot(gm, of.after)
    bend = dot(mean_h, of.after)
    rate = (-0.5 * r * c) * (after / h1 - before / h0)
    size = (-c) * over * (0.25 * (dot(m0, m0) + dot(m1, m1)) + 0.5 * way * (before + after))
    rate_x = (r * c) * along / h1
    rate_h = (-0.5 * r * c) * (2.0 * bend - after / h1) / h1
    size_x = c * over * (dot(gm, m1) + way * along - 0.5 * (before + after))
    size_h = (-c) * over * (dot(mean_h, m1) + way * bend) - size / h1
    for i in range(at.nn):
        na = beam.mass_shape[0, g, i]; da = beam.mass_shape[1, g, i]
        o = x.node * i + x.vector * k
        add_lanes(scratch, x.inertia + o, (c * na * r) * (of.mean - m0) + (c * da * (way * inverse)) * of.mean)
        by_x = (-c * na * r) * gm + (c * da * inverse) * (of.mean - way * gm)
        by_h = (c * na * r) * mean_h + (c * da * way) * (inverse * mean_h + inverse_h * of.mean)
        own = 0.5 * (r * na / inverse - way * da)
        to_rate = (-0.5 * r * c / h1) * ((2.0 * own) * of.after + da * m1)
        to_size = ((-c) * over) * (own * m1 + (way * own) * of.after + (0.5 * da * way) * m1)
        for side in range(2):
            part = point if side == 1 else 1.0 - point
            sign = 1.0 if side == 1 else -1.0
            to = x.node * at.nn * side + o
            add_lanes(scratch, x.column + to, (0.5 * r * part) * by_x + sign * by_h)
            add_lanes(scratch, x.line + to, part * to_rate + sign * to_size)
    add(scratch, x.first + STRETCH, size)
    for side in range(2):
        part = point if side == 1 else 1.0 - point
        sign = 1.0 if side == 1 else -1.0
        add(scratch, x.first + FORCES + 8 * side, part * rate)
        for other in range(2):
            part_2 = 0.5 * r * (point if other == 1 else 1.0 - point)
            sign_2 = 1.0 if other == 1 else -1.0
            add(scratch, x.first + CORNER + 16 * side + 8 * other,
                part * (rate_x * part_2 + rate_h * sign_2) + sign * (size_x * part_2 + size_h * sign_2))


@inlined
def add(scratch, o, y):
    """Add y to the lanes at o."""
    vst(scratch, o, 0, vld(scratch, o, 0) + y)


@kernel
def product(law, tab, to, coupled, scratch, eo, other):
    """Return w E C E' of the strains at eo and at `other` at a point."""
    out = vzero()
    for i in range(6):
        y = vzero()
        for j in range(0 if coupled else i, 6 if coupled else i + 1):
            y += stress_of.call(law, tab, 48 * i + 8 * j, scratch, eo + 8 * j)
        out += y * vld(scratch, other + 8 * i, 0)
    return vld(tab, to, 0) * out


@kernel
def put_rest(beam, scratch, g, h0, h1, mean, o, lanes):
    """Store strains of the reference at point g: with the lengths of both ends of the step, the derivative of length times strain
    at the end, its divided difference over the step, the derivative of that by the length at the end; at `lanes` those that the
    element loop subtracts."""
    most = beam.rest_until[0]
    x0 = smaller(h0, vzero() + most); x1 = smaller(h1, vzero() + most)
    # share of the step with a length beyond that of the polynomial
    beyond = (h1 - x1 - (h0 - x0)) / (h1 - h0 + 1e-300)
    for i in range(6):
        value = vzero(); divided = vzero(); slope = vzero()
        # Horner's scheme for a polynomial, its divided difference, and the derivative of that
        for k in range(beam.rest.shape[0] - 1, -1, -1):
            slope = slope * x1 + divided
            divided = divided * x1 + value
            value = value * x0 + beam.rest[k, g, i]
        vst(scratch, o + REST_SLOPE + 8 * i, 0, divided + (x1 - x0) * slope)
        value += beam.rest_slope[g, i] * (h0 - x0)
        divided += beyond * (beam.rest_slope[g, i] - divided)
        end = value + (h1 - h0) * divided
        vst(scratch, o + 8 * i, 0, value / h0)
        vst(scratch, o + REST_1 + 8 * i, 0, end / h1)
        vst(scratch, o + REST_DIVIDED + 8 * i, 0, divided)
        vst(scratch, o + REST_BEND + 8 * i, 0, slope)
        vst(scratch, lanes + 8 * i, 0, 0.5 * (value + end) / mean)


@inlined
def combine(scratch, to, factor, a, sign, b):
    """Store factor times the six strains at a plus sign times those at b."""
    for i in range(0, 48, 8):
        vst(scratch, to + i, 0, factor * vld(scratch, a + i, 0) + sign * vld(scratch, b + i, 0))


@generic
def put_stored(dofs, beam, method, strains, tab, coupled, scratch, at, x):
    """Add the forces of the stored energy on both ends of the elements, theory.md (5.22), and their derivatives. The strains are
    inversely proportional to the length of the element; tables: of the mean length."""


@put_stored.register(Space)
@inlined
def put_stored_in_space(dofs, beam, method, strains, tab, coupled, scratch, at, x):
    zo = at.blocks
    eo = zo + STRAINS
    # strains with the mean length at the end and at the start, then less those of the reference and with their own; sums of two
    ends, starts, excess, both, rest = zo + BEFORE, zo + BEFORE + 56, zo + BEFORE + 112, zo + TEMPORARY, x.rest + 48 * at.nq
    h0 = vld(scratch, x.first + LENGTHS, 0); h1 = vld(scratch, x.first + LENGTHS + 8, 0)
    mean = 0.5 * (h0 + h1)
    over = 1.0 / mean
    force = vzero(); bend = vzero()
    column = x.column + 96 * at.nn
    line = x.line + 96 * at.nn
    for g in range(at.nq):
        to = at.point + at.point_size * g
        po = at.points + at.point_stride * g
        ao = po + SHAPES_AT
        interpolate(tab, to, at.nn, at.node, scratch, 0, zo + MIDDLE)
        interpolate(tab, to, at.nn, at.node, scratch, 96, zo + END)
        end = put_forms.call(method, strains, scratch, zo)
        mean_of_forms.call(strains, scratch, eo, zo + end, ao)
        present_strains.call(strains, scratch, zo + END, ao, ends)
        put_rest(beam, scratch, g, h0, h1, mean, rest, x.rest + 48 * g)
        combine(scratch, starts, 2.0, eo, -1.0, ends)
        # as the element loop forms them: then round-off of the stress does no work along an unstrained beam
        combine(scratch, eo, 1.0, eo, -1.0, x.rest + 48 * g)
        combine(scratch, both, 1.0, eo, 1.0, rest + REST_SLOPE)
        stresses(strains.law, strains, tab, to, coupled, scratch, both, po, ao)
        add_forces.call(strains, tab, to, at.nn, scratch, zo + MIDDLE, po, column)
        force -= over * product(strains.law, tab, to, coupled, scratch, eo, rest + REST_DIVIDED)
        bend += (0.5 * over * over) * product(strains.law, tab, to, coupled, scratch, both, rest + REST_DIVIDED)
        bend -= over * product(strains.law, tab, to, coupled, scratch, eo, rest + REST_BEND)
        combine(scratch, excess, mean / h0, starts, -1.0, rest)
        square = (over * over) * h0 * product(strains.law, tab, to, coupled, scratch, excess, excess)
        combine(scratch, excess, mean / h1, ends, -1.0, rest + REST_1)
        combine(scratch, both, 1.0, excess, 1.0, rest + REST_SLOPE)
        own = (over * over) * product(strains.law, tab, to, coupled, scratch, excess, excess)
        square += h1 * own
        force -= 0.25 * square
        bend += 0.125 * over * square - 0.25 * own
        bend += (0.5 * over * over) * product(strains.law, tab, to, coupled, scratch, excess, both)
        combine(scratch, both, 1.0, excess, 1.0, rest + REST_DIVIDED)
        stresses(strains.law, strains, tab, to, coupled, scratch, both, po, ao + SHAPE)
        add_forces.call(strains, tab, to, at.nn, scratch, zo + END, po, line)
    share_stored(scratch, at, x, over, force, bend)


@inlined
def share_stored(scratch, at, x, over, force, bend):
    """Share what `put_stored` has found by the length of the elements out between both ends: the force, its derivative `bend`,
    and those by and of coordinates that stand in the places of the end ahead."""
    column = x.column + x.node * at.nn
    line = x.line + x.node * at.nn
    for i in range(0, x.node * at.nn, 8):
        y = (-0.5 * over) * vld(scratch, column + i, 0)
        z = (-0.5 * over) * vld(scratch, line + i, 0)
        vst(scratch, column + i, 0, y); vst(scratch, x.column + i, 0, -1.0 * y)
        vst(scratch, line + i, 0, z); vst(scratch, x.line + i, 0, -1.0 * z)
    add(scratch, x.first + STRETCH, force)
    for side in range(2):
        sign = 1.0 if side == 1 else -1.0
        for other in range(2):
            add(scratch, x.first + CORNER + 16 * side + 8 * other, (sign if other == 1 else -sign) * bend)


class PlanarRest(NamedTuple):
    """Strains of the reference at a point, as `put_rest` stores them."""

    start: object
    end: object
    slope: object
    divided: object
    bend: object
    mean: object


@inlined
def planar_rest(beam, g, h0, h1, mean):
    """Return what `put_rest` stores, in a plane."""
    most = beam.rest_until[0]
    x0 = smaller(h0, vzero() + most); x1 = smaller(h1, vzero() + most)
    beyond = (h1 - x1 - (h0 - x0)) / (h1 - h0 + 1e-300)
    zero = triple(vzero(), vzero(), vzero())
    value = zero; divided = zero; slope = zero
    for k in range(beam.rest.shape[0] - 1, -1, -1):
        slope = x1 * slope + divided
        divided = x1 * divided + value
        value = x0 * value + uniform(beam.rest[k, g])
    last = uniform(beam.rest_slope[g])
    whole_slope = divided + (x1 - x0) * slope
    value += (h0 - x0) * last
    divided += beyond * (last - divided)
    end = value + (h1 - h0) * divided
    return PlanarRest((1.0 / h0) * value, (1.0 / h1) * end, whole_slope, divided, slope, (0.5 / mean) * (value + end))


@inlined
def uniform(of):
    """Return three numbers in all lanes."""
    return triple(vzero() + of[0], vzero() + of[1], vzero() + of[2])


@inlined
def add_planar_forces(strains, data, shape, s, tab, to, nn, scratch, fo):
    """Add the forces of stresses at a point on the coordinates of the nodes, from fo on, 32 doubles apart."""
    forms = planar_form_stresses.call(strains, data, s)
    force = planar_position_force.call(strains, data, shape, forms)
    x, y = planar_director_forces.call(strains, data, shape, forms)
    for a in range(nn):
        t = to + 8 + NODE_TABLE * a
        add_lanes(scratch, fo + 32 * a, vld(tab, t, 0) * force)
        add_lanes(scratch, fo + 32 * a + 16, vld(tab, t + 8, 0) * x + vld(tab, t + 16, 0) * y)


@put_stored.register(Plane)
@inlined
def put_stored_in_plane(dofs, beam, method, strains, tab, coupled, scratch, at, x):
    h0 = vld(scratch, x.first + LENGTHS, 0); h1 = vld(scratch, x.first + LENGTHS + 8, 0)
    mean = 0.5 * (h0 + h1)
    over = 1.0 / mean
    force = vzero(); bend = vzero()
    for g in range(at.nq):
        to = at.point + at.point_size * g
        stiffness = matrix_at(tab, to, 0, 1.0)
        middle, end = planar_shapes(tab, to, at.nn, scratch, 0)
        start = Shape(2.0 * middle.f - end.f, 2.0 * middle.u - end.u, 2.0 * middle.k - end.k)
        starts = planar_strains.call(strains, start)
        ends = planar_strains.call(strains, end)
        rest = planar_rest(beam, g, h0, h1, mean)
        vst3(scratch, x.rest + 24 * g, 8, rest.mean)
        strain = 0.5 * (starts + ends) - rest.mean
        both = strain + rest.slope
        add_planar_forces(strains, planar_point_data.call(strains, middle, start, end), middle, apply_law(stiffness, both), tab,
                          to, at.nn, scratch, x.column + x.node * at.nn)
        divided = apply_law(stiffness, rest.divided)
        force -= over * dot(divided, strain)
        bend += (0.5 * over * over) * dot(divided, both)
        bend -= over * dot(apply_law(stiffness, rest.bend), strain)
        excess = (mean / h0) * starts - rest.start
        square = (over * over) * h0 * dot(apply_law(stiffness, excess), excess)
        excess = (mean / h1) * ends - rest.end
        stress = apply_law(stiffness, excess)
        own = (over * over) * dot(stress, excess)
        square += h1 * own
        force -= 0.25 * square
        bend += 0.125 * over * square - 0.25 * own
        bend += (0.5 * over * over) * dot(stress, excess + rest.slope)
        add_planar_forces(strains, planar_point_data.call(strains, end, end, end), end, stress + divided, tab, to, at.nn, scratch,
                          x.line + x.node * at.nn)
    share_stored(scratch, at, x, over, force, bend)


@inlined
def put_weight(beam, scratch, at, x, dofs):
    """Add the weight: its forces on nodes are shares of the length."""
    mean = 0.5 * (vld(scratch, x.first + LENGTHS, 0) + vld(scratch, x.first + LENGTHS + 8, 0))
    force = vector_lanes(scratch, x.first + WEIGHT, dofs)
    base = vector_lanes(scratch, x.first + BASE, dofs)
    for a in range(at.nn):
        m = 0.0
        for g in range(beam.mass_point.shape[1]):
            m += beam.mass_point[1, g] * beam.mass_shape[0, g, a]
        height = m * dot(force, base + vector_lanes(scratch, at.node * a, dofs))
        add(scratch, x.first + STRETCH, -1.0 * height)
        add_lanes(scratch, x.inertia + x.node * a, (-m * mean) * force)
        for side in range(2):
            sign = 1.0 if side == 1 else -1.0
            to = x.node * (at.nn * side + a)
            add_lanes(scratch, x.column + to, (-0.5 * m * sign) * force)
            add_lanes(scratch, x.line + to, (-0.5 * m * sign) * force)


@add_inertia.register(MovingStep)
@kernel
def add_moving_inertia(method, constants, scratch, at, dofs):
    """Add what `put_inertia` and `put_weight` left."""
    for i in range(0, (96 if len(dofs) == 6 else 32) * at.nn, 8):
        add(scratch, at.forces + i, vld(scratch, at.doubles + INERTIA + i, 0))


@inlined
def put_unknowns(scratch, at, x, first, q, to, dofs):
    """Transform derivatives by the coordinates of the nodes, from `first` on, to those by their unknowns, from `to` on: vectors,
    and sums of directors cross vectors; q: offset of the middle or the end of the step."""
    for a in range(at.nn):
        put_lanes(scratch, to + x.unknowns * a, vector_lanes(scratch, first + x.node * a, dofs))
        turn = zero_moment(dofs)
        for d in range(x.vector, x.node, x.vector):
            turn += moment(vector_lanes(scratch, at.node * a + q + d, dofs), vector_lanes(scratch, first + x.node * a + d, dofs))
        put_lanes(scratch, to + x.unknowns * a + x.vector, turn)


@inlined
def share_out(scratch, x, first, second):
    """Replace derivatives by both ends of an element by those by the places behind and ahead of it."""
    f0 = vld(scratch, x.first + SHARES, 0); f1 = vld(scratch, x.first + SHARES + 8, 0)
    a = vld(scratch, first, 0); b = vld(scratch, second, 0)
    vst(scratch, first, 0, (1.0 - f0) * a + (1.0 - f1) * b)
    vst(scratch, second, 0, f0 * a + f1 * b)


@generic
def evaluate_ends(dofs, beam, method, strains, tab, coupled, scratch, at, points, h):
    """Run `evaluate_ends_at` in code that the compiler treats as it treats that of `evaluate_lanes`; points: those of the mass.
    Stresses of both must not differ in round-off: it would do work in every step."""


@evaluate_ends.register(Space)
@inlined
def evaluate_ends_in_space(dofs, beam, method, strains, tab, coupled, scratch, at, points, h):
    evaluate_any_ends(beam, method, strains, tab, coupled, scratch, at, points, h, dofs)


@evaluate_ends.register(Plane)
@inlined
def evaluate_ends_in_plane(dofs, beam, method, strains, tab, coupled, scratch, at, points, h):
    if at.nn == 2 and at.nq == 1:
        evaluate_linear_ends(beam, method, strains, tab, coupled, scratch, points, h, dofs)
    elif at.nn == 3 and at.nq == 2:
        evaluate_quadratic_ends(beam, method, strains, tab, coupled, scratch, points, h, dofs)
    elif at.nn == 4 and at.nq == 3:
        evaluate_cubic_ends(beam, method, strains, tab, coupled, scratch, points, h, dofs)
    else:
        evaluate_any_ends(beam, method, strains, tab, coupled, scratch, at, points, h, dofs)


@separate
def evaluate_any_ends(beam, method, strains, tab, coupled, scratch, at, points, h, dofs):
    """Run `evaluate_ends_at` for any numbers of nodes and points."""
    evaluate_ends_at(beam, method, strains, tab, coupled, scratch, at, moved(at, points, dofs), points, h, dofs)


@separate
def evaluate_linear_ends(beam, method, strains, tab, coupled, scratch, points, h, dofs):
    """Run `evaluate_ends_at` for 2 nodes and 1 point: lengths of loops and offsets are known when it is compiled."""
    at = layout(dofs, 2, 1)
    evaluate_ends_at(beam, method, strains, tab, coupled, scratch, at, moved(at, points, dofs), points, h, dofs)


@separate
def evaluate_quadratic_ends(beam, method, strains, tab, coupled, scratch, points, h, dofs):
    """Run `evaluate_ends_at` for 3 nodes and 2 points."""
    at = layout(dofs, 3, 2)
    evaluate_ends_at(beam, method, strains, tab, coupled, scratch, at, moved(at, points, dofs), points, h, dofs)


@separate
def evaluate_cubic_ends(beam, method, strains, tab, coupled, scratch, points, h, dofs):
    """Run `evaluate_ends_at` for 4 nodes and 3 points."""
    at = layout(dofs, 4, 3)
    evaluate_ends_at(beam, method, strains, tab, coupled, scratch, at, moved(at, points, dofs), points, h, dofs)


@inlined
def evaluate_ends_at(beam, method, strains, tab, coupled, scratch, at, x, points, h, dofs):
    """Evaluate everything of WIDTH elements that the element loop does not, from their coordinates in the middle and at the end
    of the step, and the tables for the element loop; h: 0 at rest."""
    stretch_tables(beam, tab, scratch, at, x, h)
    for i in range(x.inertia, x.rows, 8):
        vst(scratch, i, 0, 0.0)
    for i in range(x.first + FORCES, x.first + WEIGHT, 8):
        vst(scratch, i, 0, 0.0)
    put_stored.call(dofs, beam, method, strains, tab, coupled, scratch, at, x)
    for g in range(points if h != 0.0 else 0):
        for k in range(x.fields):
            if beam.rho[k] != 0.0:
                put_inertia(beam, scratch, at, x, g, k, h, dofs)
    put_weight(beam, scratch, at, x, dofs)
    size = x.unknowns * at.nn
    for side in range(2):
        put_unknowns(scratch, at, x, x.column + x.node * at.nn * side, 0, x.rows + size * side, dofs)
        put_unknowns(scratch, at, x, x.line + x.node * at.nn * side, x.node, x.rows + 2 * size + size * side, dofs)
    for i in range(0, size, 8):
        share_out(scratch, x, x.rows + i, x.rows + size + i)
        share_out(scratch, x, x.rows + 2 * size + i, x.rows + 3 * size + i)
    share_out(scratch, x, x.first + FORCES, x.first + FORCES + 8)
    # the length is this share of the way between the places, to the last bit
    force = (vld(scratch, x.first + SHARES + 8, 0) - vld(scratch, x.first + SHARES, 0)) * vld(scratch, x.first + STRETCH, 0)
    add(scratch, x.first + FORCES, -1.0 * force)
    add(scratch, x.first + FORCES + 8, force)
    for i in range(0, 32, 16):
        share_out(scratch, x, x.first + CORNER + i, x.first + CORNER + i + 8)
    for i in range(0, 16, 8):
        share_out(scratch, x, x.first + CORNER + i, x.first + CORNER + i + 16)
