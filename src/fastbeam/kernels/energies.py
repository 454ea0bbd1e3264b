"""Energies and momenta of states in space or in a plane, in rows of sums; run only when somebody asks for them.

Elements are evaluated eight at a time. Loads and stores are those of `vectors.WIDTH` lanes.

Arrays: q_rows, v_rows [m, 12 N], in a plane [m, 4 N]; sums_out [m, SUMS]; constants [*] and reference [*], addresses of a group's
tables and of its reference strains; scratch [*], numbers of a group in lanes: layout.py has their places; lanes
[8 (IN_LANES + 1)], sums of the elements in each lane; q, v, a row of q_rows and v_rows [*]; out [SUMS]; weight [N]; gravity [3],
load [3 N], in a plane [2] and [2 N]; work [1].
"""
from __future__ import annotations

from fastbeam.kernels.algebra.dimensions import (
    Plane,
    Space,
    add_lanes,
    add_to,
    coordinates,
    cross_product,
    dim,
    moment,
    position,
    vector,
    vector_lanes,
    zero_vector,
)
from fastbeam.kernels.algebra.lanes import clear_lanes
from fastbeam.kernels.algebra.native import vld, vld3, vst
from fastbeam.kernels.algebra.vectors import V3, WIDTH, address, dot, f8, native, square_root, total
from fastbeam.kernels.algebra.vectors import vld as all_lanes
from fastbeam.kernels.beams.element_loop import add_node_inertia
from fastbeam.kernels.beams.nodes import Bodies
from fastbeam.kernels.beams.planar import planar_shapes
from fastbeam.kernels.beams.planar_nodes import PlanarBodies
from fastbeam.kernels.beams.section_laws import apply_law, matrix_at
from fastbeam.kernels.beams.strain_measures import planar_strains
from fastbeam.kernels.jit.decorators import inlined, kernel
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.layout import CONSTANTS, COUPLED, LIST, NODES, POINTS, REFERENCE, layout
from fastbeam.kernels.loop import energy_of
from fastbeam.kernels.measures import gather_nodes, point_energy

# columns of sums: kinetic energy, linear and angular momentum, theory.md (4.3), sums of the sizes of the contributions to both,
# the scale of their round-off; strain energy; int rho phi.g ds of gravity and phi.F of constant loads. In a plane there are two
# numbers of the linear momentum, and one of the angular
KINETIC, LINEAR, ANGULAR, LINEAR_SIZE, ANGULAR_SIZE, STRAIN, GRAVITY, LOADS, SUMS = 0, 1, 4, 7, 8, 9, 10, 11, 12
# those of elements; behind their lanes stands 1 for each that is in use
IN_LANES = 10


@generic
def square(x):
    """Return the square of the size of a vector, or of a moment in a plane."""


@square.register(V3[native])
@square.register(V3[f8])
@inlined
def square_of_vector(x):
    return dot(x, x)


@square.register(native)
@square.register(f8)
@inlined
def square_of_number(x):
    return x * x


# --- elements -----------------------------------------------------------------------------------------------------------
@generic
def weighted_energy(dofs, strains, constants, reference, coupled, g, scratch, at):
    """Return (E - E0) C (E - E0) of quadrature point g times its weight."""


@weighted_energy.register(Space)
@inlined
def weighted_energy_in_space(dofs, strains, constants, reference, coupled, g, scratch, at):
    return vld(constants, at.point + at.point_size * g, 0) * point_energy(strains, constants, reference, coupled, g, scratch, at)


@weighted_energy.register(Plane)
@inlined
def weighted_energy_in_plane(dofs, strains, constants, reference, coupled, g, scratch, at):
    to = at.point + at.point_size * g
    shape = planar_shapes(constants, to, at.nn, scratch, 0)[0]
    e = planar_strains.call(strains, shape) - vld3(reference, 24 * g, 8)
    return dot(e, apply_law(matrix_at(constants, to, 0, 1.0), e))


@kernel
def add_group(dofs, strains, constants, reference, coupled, scratch, lanes, at):
    """Add the sums of a part of a group, with coordinates and rates of its nodes in scratch, to those in its lanes."""
    n = 8 * coordinates(dofs)
    used = vld(lanes, 8 * IN_LANES, 0)
    kinetic = vld(lanes, 8 * KINETIC, 0)
    linear = vld(lanes, 8 * LINEAR_SIZE, 0); angular = vld(lanes, 8 * ANGULAR_SIZE, 0)
    for i in range(at.forces, at.rows, 8):
        vst(scratch, i, 0, 0.0)
    for a in range(at.nn):
        add_node_inertia.call(dofs, constants, scratch, at, a)
        for i in range(0, n, 8 * dim(dofs)):
            p = used * vector_lanes(scratch, at.forces + n * a + i, dofs)
            x = moment(vector_lanes(scratch, at.node * a + i, dofs), p)
            kinetic += 0.5 * dot(vector_lanes(scratch, at.rates + n * a + i, dofs), p)
            if i == 0:
                add_lanes(lanes, 8 * LINEAR, p)
                linear += square_root(dot(p, p))
            add_lanes(lanes, 8 * ANGULAR, x)
            angular += square_root(square.call(x))
    vst(lanes, 8 * KINETIC, 0, kinetic); vst(lanes, 8 * LINEAR_SIZE, 0, linear); vst(lanes, 8 * ANGULAR_SIZE, 0, angular)
    energy = vld(lanes, 8 * STRAIN, 0)
    for g in range(at.nq):
        energy += (0.5 * used) * weighted_energy.call(dofs, strains, constants, reference, coupled, g, scratch, at)
    vst(lanes, 8 * STRAIN, 0, energy)


@kernel
def add_elements(tables, strains, reference, n_rows, q_rows, v_rows, scratch, lanes, sums_out, dofs):
    """Add the sums of all elements with one strain set."""
    n = 8 * coordinates(dofs)
    for r in range(q_rows.shape[0]):
        clear_lanes(lanes, 0, 8 * IN_LANES)
        for k in range(tables.meta.shape[0]):
            meta = tables.meta[k]
            no = meta[LIST]
            at = layout(dofs, meta[NODES], meta[POINTS])
            for lane in range(8):
                lanes[8 * IN_LANES + lane] = 0.0 if tables.rows[no + lane] == n_rows else 1.0
            gather_nodes.call(dofs, tables, no, at.nn, q_rows[r], scratch, 0, at.node)
            gather_nodes.call(dofs, tables, no, at.nn, v_rows[r], scratch, at.rates, n)
            for lane in range(0, 8, WIDTH):
                add_group(dofs, strains, address(tables.tab, meta[CONSTANTS] + lane), address(reference, meta[REFERENCE] + lane),
                          meta[COUPLED] != 0, address(scratch, lane), address(lanes, lane), at)
        for i in range(IN_LANES):
            sums_out[r, i] += total(all_lanes(lanes, 8 * i, 0))


# --- bodies, loads, springs ---------------------------------------------------------------------------------------------
@generic
def inertia_of(bodies, k, a, b):
    """Return the inertia of vectors a and b of body k: its position, then directors."""


@inertia_of.register(Bodies)
@inlined
def inertia_in_space(bodies, k, a, b):
    return bodies.inertia[16 * k + 4 * a + b]


@inertia_of.register(PlanarBodies)
@inlined
def inertia_in_plane(bodies, k, a, b):
    return bodies.inertia[2 * k + a] if a == b else 0.0


@kernel
def add_bodies(bodies, q_rows, v_rows, sums_out, dofs):
    """Add the sums of point masses and rigid bodies."""
    d = dim(dofs)
    vectors = coordinates(dofs) // d
    for r in range(q_rows.shape[0]):
        v = v_rows[r]
        out = sums_out[r]
        for k in range(bodies.node.shape[0]):
            o = coordinates(dofs) * bodies.node[k]
            for a in range(vectors):
                p = zero_vector(dofs)
                for b in range(vectors):
                    p += inertia_of.call(bodies, k, a, b) * vector(v, o + d * b, 1, dofs)
                x = cross_product.call(vector(q_rows[r], o + d * a, 1, dofs), p)
                out[KINETIC] += 0.5 * dot(vector(v, o + d * a, 1, dofs), p)
                if a == 0:
                    add_to(out, LINEAR, 1, p)
                    out[LINEAR_SIZE] += dot(p, p)**0.5
                add_to(out, ANGULAR, 1, x)
                out[ANGULAR_SIZE] += square.call(x)**0.5


@kernel
def add_loads(weight, gravity, load, q_rows, sums_out, dofs):
    """Add what gravity and constant loads do on the way of the nodes from the origin."""
    g = vector(gravity, 0, 1, dofs)
    for r in range(q_rows.shape[0]):
        of_gravity = 0.0
        of_loads = 0.0
        for i in range(weight.shape[0]):
            x = position(q_rows[r], i, dofs)
            of_gravity += weight[i] * dot(x, g)
            of_loads += dot(x, vector(load, dim(dofs) * i, 1, dofs))
        sums_out[r, GRAVITY] += of_gravity
        sums_out[r, LOADS] += of_loads


@kernel
def add_links(links, q_rows, work, sums_out, dofs):
    """Add the energy that springs store to that of strains."""
    for r in range(q_rows.shape[0]):
        work[0] = 0.0
        energy_of(links, q_rows[r], dofs, work)
        sums_out[r, STRAIN] += work[0]
