"""Element loops of geometrically exact beams: residual and tangent of the conserving step, eight elements at a time.

Once the numbers of a group of 8 elements stand in lanes, `vectors.WIDTH` lanes are evaluated at a time, as many as a register of
the processor holds: loads, stores and zeros in this file are those of WIDTH lanes.

Unknowns per node are the position increment and the spin increment at the end of the step: a director at t_n+1 varies
by  delta d_i = delta_phi x d_i,n+1  and the equations are projected with the directors of the midpoint, theory.md (4.2).
With both ends equal the same kernel is statics; its tangent is then half the static one.

The loop over groups, inertia and projection serve nodes in space and in a plane; points and pairs of nodes in a plane are in
beams/planar.py. Offsets in the tables of a group and in its scratch are those of layout.py. Groups with equal constants share one
table; reference strains, 6 or 3 per point, are an array of the run.

Arrays: constants [*] and reference [*], addresses of a group's tables and of its reference strains; scratch [*], numbers of a
group in lanes: layout.py has their places; r_out [8 (rows + 1)]; blocks_out [8 n (blocks + 1)], n unknowns a node.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import (
    Plane,
    Space,
    add_turned,
    coordinates,
    dim,
    dyad,
    moment,
    put_lanes,
    vector_lanes,
    zero_dyad,
    zero_moment,
)
from fastbeam.kernels.algebra.lanes import scatter_rows
from fastbeam.kernels.algebra.native import vadd3, vadd_matrix, vld, vld3, vldm, vst, vst_matrix, vzero3, vzerom
from fastbeam.kernels.algebra.vectors import WIDTH, add_iso, add_skew, address, cross, outer
from fastbeam.kernels.beams import (  # noqa: F401  the strain sets
    gather,  # noqa: F401  of all motions
    green_lagrange,
    simo_reissner,
)
from fastbeam.kernels.beams.inner_nodes import eliminate_group
from fastbeam.kernels.beams.motions import (
    AtEnd,
    add_inertia,
    add_spin_rates,
    columns,
    gather_ends,
    gather_increment,
    gather_spin_rates,
    needs_increment,
    pair_mass_factor,
)
from fastbeam.kernels.beams.section_laws import put_added, tangent_law
from fastbeam.kernels.beams.strain_measures import (
    add_director_forces,
    add_forces,
    add_geometric,
    add_stresses,
    point_stiffness,
    prepare_points,
    set_over,
    sum_pair,
)
from fastbeam.kernels.beams.strains import excess_strains, interpolate, mean_strains, stresses
from fastbeam.kernels.jit.decorators import inlined, kernel, separate
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.layout import (
    BEFORE,
    BLOCKS,
    CONSTANTS,
    COUPLED,
    END,
    LIST,
    MIDDLE,
    NODES,
    POINT_MATRIX,
    POINT_NODE,
    POINT_NODES,
    POINTS,
    POSITION_ROTATION,
    PRODUCTS,
    REFERENCE,
    ROTATION_POSITION,
    SHAPES_AT,
    SHEAR_2,
    SHEAR_3,
    STEP,
    STRAINS,
    TEMPORARY,
    layout,
)
from fastbeam.kernels.terms import Equilibrium


class ElementTables(NamedTuple):
    """Constant tables of all elements with one strain set; G groups of 8 lanes."""

    meta: np.ndarray     # int64 [G, 8]: nodes nn, points nq, offset in tab, in nodes, in blocks, 1 where C is coupled, offset of
    #                      the factors of inner nodes or -1, in the reference strains of the run: columns NODES to REFERENCE
    tab: np.ndarray      # float64 [*], see layout.py
    nodes: np.ndarray    # int64 [*]: per group nn x 8 node numbers; idle lanes repeat the last element
    rows: np.ndarray     # int64 [*]: per group nn x 8 rows of the residual; idle lanes point to the row behind the last
    blocks: np.ndarray   # int64 [*]: per group nn x nn x 8 blocks of the tangent; idle lanes to the block behind the last


class Case(NamedTuple):
    """Options of the evaluation of a group of elements."""

    coupled: bool     # C couples strains
    mixed: bool       # the tangent takes other stresses than the present ones, theory.md (4.6)
    gathered: bool    # the last increment is in scratch


# --- inertia and projection ---------------------------------------------------------------------------------------------
@add_inertia.register(Equilibrium)
@kernel
def add_no_inertia(method, constants, scratch, at, dofs):
    pass


@add_inertia.register(object)
@inlined
def add_inertia_forces(method, constants, scratch, at, dofs):
    """Add M u with u = 2/h^2 (q_n+1 - q_n - h v_n). In space d2 and d3 have inertia and d1 has none (1.2), in a plane the
    director."""
    for a in range(at.nn):
        add_node_inertia.call(dofs, constants, scratch, at, a)


@generic
def add_node_inertia(dofs, constants, scratch, at, a):
    """Add inertia forces M u on the coordinates of node a, one pass over the second rates u of all nodes."""


@add_node_inertia.register(Space)
@inlined
def add_node_inertia_in_space(dofs, constants, scratch, at, a):
    p = vzero3(); d2 = vzero3(); d3 = vzero3()
    for b in range(at.nn):
        u = at.rates + 96 * b
        md = vld(constants, at.director_masses + 8 * (at.nn * a + b), 0)
        p += vld(constants, at.masses + 8 * (at.nn * a + b), 0) * vld3(scratch, u, 8)
        d2 += md * vld3(scratch, u + 48, 8)
        d3 += md * vld3(scratch, u + 72, 8)
    fo = at.forces + 96 * a
    vadd3(scratch, fo, 8, vld(constants, at.inertia, 0) * p)
    vadd3(scratch, fo + 48, 8, vld(constants, at.inertia + 8, 0) * d2)
    vadd3(scratch, fo + 72, 8, vld(constants, at.inertia + 16, 0) * d3)


@add_spin_rates.register(object)
@kernel
def add_no_spin_rates(method, constants, scratch, at, mass_factor):
    pass


@add_spin_rates.register(AtEnd)
@kernel
def add_rates_of_spins(method, constants, scratch, at, mass_factor):
    """Add the tangent of the inertia forces (7.3): positions with the factor `mass_factor`, directors with the derivatives of d''
    by the spins, six vectors a node."""
    for a in range(at.nn):
        for b in range(at.nn):
            ko = at.blocks + 288 * (at.nn * a + b)
            rb = at.spin_rates + 144 * b
            m = mass_factor * vld(constants, at.masses + 8 * (at.nn * a + b), 0)
            md = vld(constants, at.director_masses + 8 * (at.nn * a + b), 0)
            j2 = md * vld(constants, at.inertia + 8, 0); j3 = md * vld(constants, at.inertia + 16, 0)
            vadd_matrix(scratch, ko, 48, 8, add_iso(vzerom(), m * vld(constants, at.inertia, 0)))
            a2 = j2 * vld3(scratch, at.node * a + 48, 8); a3 = j3 * vld3(scratch, at.node * a + 72, 8)
            for c in range(3):
                vadd3(scratch, ko + 168 + 8 * c, 48,
                      cross(a2, vld3(scratch, rb + 24 * c, 8)) + cross(a3, vld3(scratch, rb + 72 + 24 * c, 8)))


@pair_mass_factor.register(object)
@kernel
def whole_mass_factor(method, mass_factor):
    return mass_factor


@pair_mass_factor.register(AtEnd)
@kernel
def no_mass_factor(method, mass_factor):
    return 0.0


@inlined
def project_node(scratch, at, a, dofs):
    """Form residual rows of a node: (f_phi, sum d_i,mid x f_i), and the part of the tangent that comes from moving d_i,mid, with
    the contribution of the tangent to the forces f."""
    d = 8 * dim(dofs)
    node = 8 * coordinates(dofs)
    n = 8 * len(dofs)
    q = at.node * a
    fo = at.forces + node * a
    go = at.tangent_forces + node * a
    put_lanes(scratch, at.rows + n * a, vector_lanes(scratch, fo, dofs))
    m = zero_moment(dofs)
    k = zero_dyad(dofs)
    for i in range(d, node, d):
        f = vector_lanes(scratch, fo + i, dofs)
        m += moment(vector_lanes(scratch, q + i, dofs), f)
        f += vector_lanes(scratch, go + i, dofs)
        k += dyad(vector_lanes(scratch, q + node + i, dofs), f)
    put_lanes(scratch, at.rows + n * a + d, m)
    add_turned(scratch, at.blocks + n * len(dofs) * (at.nn * a + a), k, dofs)


# --- points in space ----------------------------------------------------------------------------------------------------
@generic
def evaluate_point(dofs, method, strains, constants, reference, g, scratch, at, case):
    """Add forces of quadrature point g on the coordinates, those that the tangent adds on the directors, and its stiffness in the
    form that pairs of nodes share."""


@evaluate_point.register(Space)
@inlined
def evaluate_point_in_space(dofs, method, strains, constants, reference, g, scratch, at, case):
    to = at.point + at.point_size * g
    po = at.points + at.point_stride * g
    ao = po + SHAPES_AT
    zo = at.blocks     # the place of the tangent is free until the pairs of nodes are evaluated
    interpolate(constants, to, at.nn, at.node, scratch, 0, zo + MIDDLE)
    interpolate(constants, to, at.nn, at.node, scratch, 96, zo + END)
    mean_strains(method, strains, reference, 48 * g, scratch, zo, ao)
    put_added.call(strains.law, constants, scratch, zo)
    stresses(strains.law, strains, constants, to, case.coupled, scratch, zo + STRAINS, po, ao)
    add_forces.call(strains, constants, to, at.nn, scratch, zo + MIDDLE, po, at.forces)
    if case.mixed:
        if case.gathered:
            interpolate(constants, to, at.nn, at.node, scratch, at.increment, zo + BEFORE)
            interpolate(constants, to, at.nn, at.node, scratch, at.increment + 96, zo + STEP)
        excess_strains(method, strains, reference, 48 * g, scratch, zo, case.gathered, ao)
        stresses(tangent_law.call(strains.law), strains, constants, to, case.coupled, scratch, zo + STRAINS, zo + TEMPORARY, ao)
        add_director_forces.call(strains, constants, to, at.nn, scratch, zo + MIDDLE, zo + TEMPORARY, at.tangent_forces)
        add_stresses.call(strains, scratch, zo + TEMPORARY, po)
    point_stiffness.call(strains, constants, to, case.coupled, scratch, at, columns.call(method), po)


# --- pairs of nodes in space: one pass over the points for each quarter of a 6 x 6 block, because more than 12 accumulators of 8
# lanes and their factors do not stay in registers
@inlined
def rotation_position(constants, scratch, at, a, b, ko):
    """Form the block rotation of a against position of b, with the sums of stress times basis products."""
    k = vzerom()
    for g in range(at.nq):
        pb = vld(constants, at.point + at.point_size * g + 8 + 24 * b, 0)
        k += pb * vldm(scratch, at.points + at.point_stride * g + POINT_NODES + POINT_NODE * a + ROTATION_POSITION, 8)
    sums = at.pairs + at.pair_size * (at.nn * a + b)
    qa = at.node * a
    u = vld(scratch, sums + SHEAR_2, 0) * vld3(scratch, qa + 48, 8) + vld(scratch, sums + SHEAR_3, 0) * vld3(scratch, qa + 72, 8)
    vst_matrix(scratch, ko + 144, 48, 8, add_skew(k, 0.5 * u))


@inlined
def position_rotation(constants, scratch, at, a, b, ko):
    """Form the block position of a against rotation of b."""
    k = vzerom()
    for g in range(at.nq):
        pa = vld(constants, at.point + at.point_size * g + 8 + 24 * a, 0)
        k += pa * vldm(scratch, at.points + at.point_stride * g + POINT_NODES + POINT_NODE * b + POSITION_ROTATION, 8)
    sums = at.pairs + at.pair_size * (at.nn * b + a)
    qb = at.node * b + 96
    v = vld(scratch, sums + SHEAR_2, 0) * vld3(scratch, qb + 48, 8) + vld(scratch, sums + SHEAR_3, 0) * vld3(scratch, qb + 72, 8)
    vst_matrix(scratch, ko + 24, 48, 8, add_skew(k, -0.5 * v))


@inlined
def rotation_rotation(strains, constants, scratch, at, a, b, mass_factor, ko):
    """Form the block rotation of a against rotation of b."""
    k = vzerom()
    for g in range(at.nq):
        po = at.points + at.point_stride * g + POINT_NODES
        ba = po + POINT_NODE * a
        bb = po + POINT_NODE * b + PRODUCTS
        for i in range(6):
            k += outer(vld3(scratch, ba + 24 * i, 8), vld3(scratch, bb + 24 * i, 8))
    md = mass_factor * vld(constants, at.director_masses + 8 * (at.nn * a + b), 0)
    m2 = md * vld(constants, at.inertia + 8, 0)
    m3 = md * vld(constants, at.inertia + 16, 0)
    k = add_geometric.call(strains, k, scratch, at.node * a, at.node * b + 96, at.pairs + at.pair_size * (at.nn * a + b), m2, m3)
    vst_matrix(scratch, ko + 168, 48, 8, k)


@inlined
def position_position(constants, scratch, at, a, b, mass_factor, ko):
    """Form the block position of a against position of b."""
    k = vzerom()
    for g in range(at.nq):
        t = at.point + at.point_size * g + 8
        k += (vld(constants, t + 24 * a, 0) * vld(constants, t + 24 * b, 0)) * vldm(
            scratch, at.points + at.point_stride * g + POINT_MATRIX, 8)
    m = mass_factor * vld(constants, at.masses + 8 * (at.nn * a + b), 0)
    vst_matrix(scratch, ko, 48, 8, add_iso(k, m * vld(constants, at.inertia, 0)))


@generic
def put_pairs(dofs, strains, constants, scratch, at, mass_factor):
    """Form the blocks of all pairs of nodes: material part from the stiffness of points, geometric part from the stresses,
    `mass_factor` times the projected mass, theory.md (4.1), (4.2)."""


@put_pairs.register(Space)
@inlined
def pair_stiffness(dofs, strains, constants, scratch, at, mass_factor):
    for a in range(at.nn):
        for b in range(a, at.nn):
            sum_pair.call(strains, constants, scratch, at, a, b)
    for a in range(at.nn):
        for b in range(at.nn):
            ko = at.blocks + 288 * (at.nn * a + b)
            rotation_position(constants, scratch, at, a, b, ko)
            rotation_rotation(strains, constants, scratch, at, a, b, mass_factor, ko)
            position_rotation(constants, scratch, at, a, b, ko)
    # last, because these quarters of the blocks lie where the sums over the points stood
    for a in range(at.nn):
        for b in range(at.nn):
            position_position(constants, scratch, at, a, b, mass_factor, at.blocks + 288 * (at.nn * a + b))


# --- groups of elements -------------------------------------------------------------------------------------------------
@inlined
def evaluate_at(method, strains, constants, reference, scratch, at, case, mass_factor, dofs):
    """Evaluate residual and tangent of WIDTH elements of a group, whose coordinates have been gathered into scratch; mass_factor:
    factor of the mass matrix in the tangent, as in motions.py."""
    for i in range(at.forces, at.rows, 8):
        vst(scratch, i, 0, 0.0)
    add_inertia.call(method, constants, scratch, at, dofs)
    for i in range(at.rates, at.forces, 8):
        vst(scratch, at.tangent_forces - at.rates + i, 0, 0.0)
    prepare_points.call(dofs, strains, scratch, at)
    for g in range(at.nq):
        evaluate_point.call(dofs, method, strains, constants, reference, g, scratch, at, case)
    put_pairs.call(dofs, strains, constants, scratch, at, pair_mass_factor.call(method, mass_factor))
    add_spin_rates.call(method, constants, scratch, at, mass_factor)
    for a in range(at.nn):
        project_node(scratch, at, a, dofs)


@separate
def evaluate(method, strains, constants, reference, scratch, at, case, mass_factor, dofs):
    """Run `evaluate_at` for any numbers of nodes and points, compiled once for all motions of a method, and for elements with and
    without inner nodes that are eliminated."""
    evaluate_at(method, strains, constants, reference, scratch, at, case, mass_factor, dofs)


@separate
def evaluate_linear(method, strains, constants, reference, scratch, case, mass_factor, dofs):
    """Run `evaluate_at` for 2 nodes and 1 point: lengths of loops and offsets are known when it is compiled."""
    evaluate_at(method, strains, constants, reference, scratch, layout(dofs, 2, 1), case, mass_factor, dofs)


@separate
def evaluate_quadratic(method, strains, constants, reference, scratch, case, mass_factor, dofs):
    """Run `evaluate_at` for 3 nodes and 2 points."""
    evaluate_at(method, strains, constants, reference, scratch, layout(dofs, 3, 2), case, mass_factor, dofs)


@separate
def evaluate_cubic(method, strains, constants, reference, scratch, case, mass_factor, dofs):
    """Run `evaluate_at` for 4 nodes and 3 points."""
    evaluate_at(method, strains, constants, reference, scratch, layout(dofs, 4, 3), case, mass_factor, dofs)


@generic
def evaluate_lanes(dofs, method, strains, constants, reference, scratch, at, case, mass_factor):
    """Run `evaluate_at` in the code for the numbers of nodes and points in `at`."""


@evaluate_lanes.register(Space)
@inlined
def evaluate_in_space(dofs, method, strains, constants, reference, scratch, at, case, mass_factor):
    evaluate(method, strains, constants, reference, scratch, at, case, mass_factor, dofs)


@evaluate_lanes.register(Plane)
@inlined
def evaluate_in_plane(dofs, method, strains, constants, reference, scratch, at, case, mass_factor):
    """Run the code of their own for Lagrange elements of degree 1 to 3: loops over so few nodes are too short for their
    beginnings and ends. Elements of B-splines may have as many nodes and fewer points."""
    if at.nn == 2 and at.nq == 1:
        evaluate_linear(method, strains, constants, reference, scratch, case, mass_factor, dofs)
    elif at.nn == 3 and at.nq == 2:
        evaluate_quadratic(method, strains, constants, reference, scratch, case, mass_factor, dofs)
    elif at.nn == 4 and at.nq == 3:
        evaluate_cubic(method, strains, constants, reference, scratch, case, mass_factor, dofs)
    else:
        evaluate(method, strains, constants, reference, scratch, at, case, mass_factor, dofs)


@inlined
def gather_group(tables, no, at, motion, scratch, dofs):
    """Gather coordinates of the nodes of a group, whose list begins at no, in the middle and at the end, and second rates."""
    for a in range(at.nn):
        gather_ends.call(dofs, motion, tables, no + 8 * a, scratch, at.node * a, at.rates + 8 * coordinates(dofs) * a)


@inlined
def evaluate_group(tables, k, at, strains, motion, scratch, dofs):
    """Evaluate residual and tangent of group k in scratch, at at.rows and at.blocks."""
    no = tables.meta[k, LIST]
    node = 8 * coordinates(dofs)
    gather_group(tables, no, at, motion, scratch, dofs)
    case = Case(tables.meta[k, COUPLED] != 0, motion.increment.control[0] != 0.0, needs_increment.call(motion))
    if case.mixed and case.gathered:
        for a in range(at.nn):
            gather_increment.call(dofs, motion, tables, no + 8 * a, scratch, at.node * a + node, at.increment + at.node * a)
    gather_spin_rates.call(motion, tables, no, at.nn, scratch, at.spin_rates)
    for lane in range(0, 8, WIDTH):
        evaluate_lanes.call(dofs, motion.method, set_over.call(strains, motion),
                            address(tables.tab, tables.meta[k, CONSTANTS] + lane),
                            address(motion.reference_strains, tables.meta[k, REFERENCE] + lane), address(scratch, lane), at, case,
                            motion.mass_factor)


@inlined
def scatter_group(tables, k, at, every, scratch, r_out, blocks_out, dofs):
    """Add rows and blocks of the nodes of group k, or of the first and last of them where `every` is nn - 1."""
    n = 8 * len(dofs)
    no = tables.meta[k, LIST]
    bo = tables.meta[k, BLOCKS]
    for a in range(0, at.nn, every):
        scatter_rows(scratch, at.rows + n * a, tables.rows, no + 8 * a, 8, 0, r_out, dofs)
        for b in range(0, at.nn, every):
            pair = at.nn * a + b
            for i in range(len(dofs)):
                scatter_rows(scratch, at.blocks + n * (len(dofs) * pair + i), tables.blocks, bo + 8 * pair, n, 8 * i, blocks_out,
                             dofs)


@kernel
def evaluate_groups(tables, first, last, strains, motion, scratch, dofs):
    """Evaluate residual and tangent of the groups from `first` to before `last`, one after the other in scratch."""
    for k in range(first, last):
        evaluate_group(tables, k, layout(dofs, tables.meta[k, NODES], tables.meta[k, POINTS]), strains, motion, scratch, dofs)


@separate
def element_groups(tables, first, last, inner, strains, motion, r_out, blocks_out, scratch, dofs):
    """Add residual rows and tangent blocks of the groups from `first` to before `last`.

    inner: inner_nodes.Inner or NoInner; strains: a strain set; motion: of motions.py. motion.increment: the last increment
    (state.LastIncrement); where it says so, the tangent takes the stresses to which that led in a straight line, theory.md (4.6),
    else the present ones. r_out [8 rows], blocks_out [8 n blocks]: rows padded to 8 doubles.
    """
    for k in range(first, last):
        at = layout(dofs, tables.meta[k, NODES], tables.meta[k, POINTS])
        evaluate_group(tables, k, at, strains, motion, scratch, dofs)
        every = eliminate_group.call(inner, tables, k, at, scratch, r_out, dofs)
        scatter_group(tables, k, at, every, scratch, r_out, blocks_out, dofs)
