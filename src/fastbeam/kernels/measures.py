"""Measures of single elements and sliders of a state: energies of points, what the mesh check looks at, gaps of sliders.

Elements are evaluated eight at a time. Loads, stores and zeros are those of `vectors.WIDTH` lanes.

Arrays: constants [*] and reference [*], addresses of a group's tables and of its reference strains; scratch [*], numbers of a
group in lanes: layout.py has their places; q, v [12 N]; x [12 N], in a plane [4 N]; s, gap_out, rate_out [S]; tangent_out
[3 S]; measures_out [32 groups].
"""
from __future__ import annotations

from fastbeam.kernels.algebra.blocks import FOUR, TWELVE
from fastbeam.kernels.algebra.dimensions import SPACE, Plane, Space, put
from fastbeam.kernels.algebra.lanes import gather_lanes
from fastbeam.kernels.algebra.native import vld, vld3, vst, vzero
from fastbeam.kernels.algebra.vectors import WIDTH, address, dot, ld3, smaller
from fastbeam.kernels.beams.section_laws import added_energy, added_stress
from fastbeam.kernels.beams.strain_measures import strains_of_shape
from fastbeam.kernels.beams.strains import interpolate
from fastbeam.kernels.contact.curves import find_element, node_of, nodes_of, point_on_curve
from fastbeam.kernels.contact.moving_places import is_on_node, on_mesh
from fastbeam.kernels.contact.slider import NODE, NUMBER, motion_along
from fastbeam.kernels.jit.decorators import inlined, kernel
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.layout import CONSTANTS, COUPLED, LIST, NODES, POINTS, REFERENCE, STRAINS, TEMPORARY, layout

# measures of 8 elements: mean axial force, the smallest square of the length of the directors, the smallest phi'.d1, the smallest
# cosine between neighbouring nodes
FORCE, SQUARE, ALONG, COSINE, MEASURES = range(0, 40, 8)


@generic
def gather_nodes(dofs, tables, no, nn, x, scratch, offset, distance):
    """Gather coordinates of the nodes of a group, whose list begins at no, to offset, `distance` doubles from node to node."""


@gather_nodes.register(Space)
@inlined
def gather_nodes_in_space(dofs, tables, no, nn, x, scratch, offset, distance):
    for a in range(nn):
        gather_lanes(x, tables.nodes, no + 8 * a, 12, scratch, offset + distance * a, TWELVE)


@gather_nodes.register(Plane)
@inlined
def gather_nodes_in_plane(dofs, tables, no, nn, x, scratch, offset, distance):
    for a in range(nn):
        gather_lanes(x, tables.nodes, no + 8 * a, 4, scratch, offset + distance * a, FOUR)


@kernel
def point_energy(strains, constants, reference, coupled, g, scratch, at):
    """Return twice the energy of quadrature point g, (E - E0) C (E - E0) of linear sections; its shape z stands at at.blocks, its
    axial force at TEMPORARY behind."""
    zo = at.blocks
    eo = zo + STRAINS
    interpolate(constants, at.point + at.point_size * g, at.nn, at.node, scratch, 0, zo)
    strains_of_shape.call(strains, scratch, zo, eo)
    for i in range(0, 48, 8):
        vst(scratch, eo + i, 0, vld(scratch, eo + i, 0) - vld(reference, 48 * g + i, 0))
    energy = 2.0 * added_energy.call(strains.law, constants, scratch, zo)
    for i in range(6):
        # C of a section without coupling is diagonal
        j0 = 0 if coupled else i
        j1 = 6 if coupled else i + 1
        stress = vzero()
        for j in range(j0, j1):
            stress += vld(constants, 48 * i + 8 * j, 0) * vld(scratch, eo + 8 * j, 0)
        energy += vld(scratch, eo + 8 * i, 0) * stress
        if i == 0:
            vst(scratch, zo + TEMPORARY, 0, stress + added_stress.call(strains.law, scratch, eo, 0))
    return energy


@kernel
def measure_lanes(strains, constants, reference, coupled, scratch, at, measures_out):
    """Form the measures of a part of a group from the coordinates of its nodes in scratch."""
    z = at.blocks
    force = vzero(); length = vzero()
    square = vzero() + 1.0; along = vzero() + 1.0; cosine = vzero() + 1.0
    for g in range(at.nq):
        point_energy(strains, constants, reference, coupled, g, scratch, at)
        weight = vld(constants, at.point + at.point_size * g, 0)
        force += weight * vld(scratch, z + TEMPORARY, 0)
        length += weight
        d1 = vld3(scratch, z + 24, 8); d2 = vld3(scratch, z + 48, 8); d3 = vld3(scratch, z + 72, 8)
        square = smaller(square, 0.5 * (dot(d1, d1) + dot(d2, d2) + dot(d3, d3) - 1.0))
        along = smaller(along, dot(vld3(scratch, z, 8), d1))
    for a in range(at.node, at.nn * at.node, at.node):
        product = vzero()
        for i in range(a + 24, a + 96, 24):
            product += dot(vld3(scratch, i, 8), vld3(scratch, i - at.node, 8))
        cosine = smaller(cosine, 0.5 * (product - 1.0))
    vst(measures_out, FORCE, 0, force / length); vst(measures_out, SQUARE, 0, square)
    vst(measures_out, ALONG, 0, along); vst(measures_out, COSINE, 0, cosine)


@kernel
def measure_elements(tables, reference, q, strains, scratch, measures_out):
    """Form the measures of all elements, 8 lanes of each; see `Resolution`."""
    for k in range(tables.meta.shape[0]):
        meta = tables.meta[k]
        at = layout(SPACE, meta[NODES], meta[POINTS])
        gather_nodes.call(SPACE, tables, meta[LIST], at.nn, q, scratch, 0, at.node)
        for lane in range(0, 8, WIDTH):
            measure_lanes(strains, address(tables.tab, meta[CONSTANTS] + lane), address(reference, meta[REFERENCE] + lane),
                          meta[COUPLED] != 0, address(scratch, lane), at, address(measures_out, MEASURES * k + lane))


@kernel
def slider_points(curves, sliders, contact, q, s, gap_out):
    """Form the distance of every sliding point from its curve at s."""
    for k in range(sliders.curve.shape[0]):
        c = sliders.curve[k]
        node = sliders.following.at[k, NODE]
        f = sliders.following.at[k, NUMBER]
        if f >= 0 and is_on_node(sliders.following, f, s[k]):
            place = ld3(q, 12 * node_of.call(nodes_of.call(curves, c), node), 1)
        else:
            at = s[k] if f < 0 else on_mesh(sliders.following, f, s[k], s[k]).end
            e = find_element.call(curves, c, at, contact.element[k])
            place = point_on_curve(curves, c, at, q, e, contact, 0, SPACE)
        gap = ld3(q, 12 * sliders.point[k], 1) - place
        gap_out[k] = dot(gap, gap)**0.5


@kernel
def slider_motion(curves, sliders, contact, state, tangent_out, rate_out):
    """Form the derivative by s of the curve under every slider of a state, tangent_out [3 S], and ds/dt, rate_out [S] (theory.md
    5.4)."""
    for k in range(sliders.curve.shape[0]):
        c = sliders.curve[k]
        e = find_element.call(curves, c, state.s[k], contact.element[k])
        tangent, relative = motion_along(curves, sliders, contact, state.q, state.v, state.s[k], state.history, k, e, SPACE)
        put(tangent_out, 3 * k, 1, tangent)
        rate_out[k] = dot(relative, tangent) / dot(tangent, tangent)
