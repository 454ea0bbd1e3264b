"""Contribution of a step to gradients by the sections of all elements, from its adjoint rates (theory.md (13.11)).

Sums stay in lanes, element by element, over all steps; the caller adds up those of a beam.

Arrays: constants [*] and reference [*], addresses of a group's tables and of its reference strains; scratch [*], its numbers in
lanes: layout.py has their places; rates [12 N], in a plane [4 N]; gravity [n, 3], in a plane [n, 2]; stiffness, viscosity,
changes_out, inertia and out [*], addresses of the sums of a group.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.algebra.blocks import FOUR, TWELVE
from fastbeam.kernels.algebra.dimensions import Plane, Space
from fastbeam.kernels.algebra.lanes import gather_lanes
from fastbeam.kernels.algebra.native import vld, vld2, vld3, vst, vzero, vzero2, vzero3
from fastbeam.kernels.algebra.vectors import WIDTH, address, component0, component1, component2, dot, triple
from fastbeam.kernels.beams.element_loop import ElementTables, gather_group
from fastbeam.kernels.beams.motions import motion
from fastbeam.kernels.beams.planar import Shape, planar_shapes
from fastbeam.kernels.beams.section_laws import Elastic, KelvinVoigt
from fastbeam.kernels.beams.strain_measures import planar_changes, planar_point_data, planar_strains, set_over, strain_changes
from fastbeam.kernels.beams.strains import interpolate, mean_strains
from fastbeam.kernels.jit.decorators import inlined, kernel
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.layout import (
    CONSTANTS,
    END,
    HALF_CHANGE,
    LIST,
    MIDDLE,
    NODES,
    POINTS,
    REFERENCE,
    SHAPES_AT,
    STEP,
    STRAINS,
    TEMPORARY,
    layout,
)


class SectionSums(NamedTuple):
    """Sums of beams with one strain set, G groups of elements; 6 strains and 3 inertias, in a plane 3 and 2."""

    strains: Any           # strain_measures.SimoReissner or GreenLagrange with the law of the run
    tables: ElementTables
    stiffness: np.ndarray  # float64 [G 36 8], in a plane [G 9 8]: by C, not symmetric
    viscosity: np.ndarray  # float64 [G 36 8], in a plane [G 9 8]: by D, empty where the law has none
    change: np.ndarray     # float64 [G 6 8], in a plane [G 3 8]: changes of strains by the adjoint rates, m
    inertia: np.ndarray    # float64 [G 3 8], in a plane [G 2 8]: by rhoA, rhoI2, rhoI3


@generic
def add_sections(sums, system, rates, gravity, k, h):
    """Add the contribution of step k, whose numbers are in `system`."""


@generic
def gather_rates(dofs, rates, tables, no, scratch, qo):
    """Gather adjoint rates of 8 nodes into lanes."""


@generic
def add_point(dofs, method, strains, constants, reference, g, scratch, at, stiffness, viscosity, changes_out):
    """Add the contribution of point g to the sums by C and D, and to those of changes of strains."""


@generic
def add_inertias(dofs, constants, scratch, at, gravity, step, inertia):
    """Add the contribution of an element in a step to the sums by inertias."""


@generic
def add_viscosity(law, k, change, scratch, e, out):
    """Subtract `change` times the stress per D of the strain at e from the lanes at k."""


@gather_rates.register(Space)
@inlined
def gather_rates_in_space(dofs, rates, tables, no, scratch, qo):
    gather_lanes(rates, tables.nodes, no, 12, scratch, qo, TWELVE)


@gather_rates.register(Plane)
@inlined
def gather_rates_in_plane(dofs, rates, tables, no, scratch, qo):
    gather_lanes(rates, tables.nodes, no, 4, scratch, qo, FOUR)


@add_viscosity.register(Elastic)
@inlined
def add_no_viscosity(law, k, change, scratch, e, out):
    pass


@add_viscosity.register(KelvinVoigt)
@inlined
def add_rate_of_strain(law, k, change, scratch, e, out):
    vst(out, k, 0, vld(out, k, 0) - (law.rate * change) * vld(scratch, e + HALF_CHANGE, 0))


@add_point.register(Space)
@kernel
def add_point_in_space(dofs, method, strains, constants, reference, g, scratch, at, stiffness, viscosity, changes_out):
    to = at.point + at.point_size * g
    ao = at.points + at.point_stride * g + SHAPES_AT
    zo = at.blocks
    interpolate(constants, to, at.nn, at.node, scratch, 0, zo + MIDDLE)
    interpolate(constants, to, at.nn, at.node, scratch, 96, zo + END)
    interpolate(constants, to, at.nn, at.node, scratch, at.increment, zo + STEP)
    mean_strains(method, strains, reference, 48 * g, scratch, zo, ao)
    strain_changes.call(strains, scratch, zo + MIDDLE, zo + STEP, ao, zo + TEMPORARY)
    w = vld(constants, to, 0)
    for i in range(6):
        change = w * vld(scratch, zo + TEMPORARY + 8 * i, 0)
        vst(changes_out, 8 * i, 0, vld(changes_out, 8 * i, 0) + change)
        for j in range(6):
            k = 48 * i + 8 * j
            e = zo + STRAINS + 8 * j
            vst(stiffness, k, 0, vld(stiffness, k, 0) - change * vld(scratch, e, 0))
            add_viscosity.call(strains.law, k, change, scratch, e, viscosity)


@inlined
def add_row(k, change, strain, out):
    """Subtract `change` times three strains from the lanes at k."""
    vst(out, k, 0, vld(out, k, 0) - change * component0(strain))
    vst(out, k + 8, 0, vld(out, k + 8, 0) - change * component1(strain))
    vst(out, k + 16, 0, vld(out, k + 16, 0) - change * component2(strain))


@generic
def add_planar_viscosity(law, change, half, out):
    """Subtract changes of three strains times stresses per D of half their change in the step."""


@add_planar_viscosity.register(Elastic)
@inlined
def add_no_planar_viscosity(law, change, half, out):
    pass


@add_planar_viscosity.register(KelvinVoigt)
@inlined
def add_planar_rates(law, change, half, out):
    add_row(0, law.rate * component0(change), half, out)
    add_row(24, law.rate * component1(change), half, out)
    add_row(48, law.rate * component2(change), half, out)


@add_point.register(Plane)
@kernel
def add_point_in_plane(dofs, method, strains, constants, reference, g, scratch, at, stiffness, viscosity, changes_out):
    to = at.point + at.point_size * g
    middle, end = planar_shapes(constants, to, at.nn, scratch, 0)
    step, _ = planar_shapes(constants, to, at.nn, scratch, at.increment)
    start = Shape(2.0 * middle.f - end.f, 2.0 * middle.u - end.u, 2.0 * middle.k - end.k)
    before = planar_strains.call(strains, start)
    present = planar_strains.call(strains, end)
    e = 0.5 * (before + present) - vld3(reference, 24 * g, 8)
    data = planar_point_data.call(strains, middle, start, end)
    change = vld(constants, to, 0) * planar_changes.call(strains, data, middle, step)
    add_row(0, -1.0, change, changes_out)
    add_row(0, component0(change), e, stiffness)
    add_row(24, component1(change), e, stiffness)
    add_row(48, component2(change), e, stiffness)
    add_planar_viscosity.call(strains.law, change, 0.5 * (present - before), viscosity)


@add_inertias.register(Space)
@kernel
def add_inertias_in_space(dofs, constants, scratch, at, gravity, step, inertia):
    g1 = gravity[step, 0]; g2 = gravity[step, 1]; g3 = gravity[step, 2]
    by_rho = vzero(); by_2 = vzero(); by_3 = vzero()
    for a in range(at.nn):
        p = vzero3(); d2 = vzero3(); d3 = vzero3()
        mass = vzero()
        for b in range(at.nn):
            u = at.rates + 96 * b
            m = vld(constants, at.masses + 8 * (at.nn * a + b), 0)
            md = vld(constants, at.director_masses + 8 * (at.nn * a + b), 0)
            mass += m
            p += m * vld3(scratch, u, 8)
            d2 += md * vld3(scratch, u + 48, 8)
            d3 += md * vld3(scratch, u + 72, 8)
        w = at.increment + at.node * a
        by_rho += dot(vld3(scratch, w, 8), p - triple(g1 * mass, g2 * mass, g3 * mass))
        by_2 += dot(vld3(scratch, w + 48, 8), d2)
        by_3 += dot(vld3(scratch, w + 72, 8), d3)
    vst(inertia, 0, 0, vld(inertia, 0, 0) - by_rho)
    vst(inertia, 8, 0, vld(inertia, 8, 0) - by_2)
    vst(inertia, 16, 0, vld(inertia, 16, 0) - by_3)


@add_inertias.register(Plane)
@kernel
def add_inertias_in_plane(dofs, constants, scratch, at, gravity, step, inertia):
    g1 = gravity[step, 0]; g2 = gravity[step, 1]
    by_rho = vzero(); by_spin = vzero()
    for a in range(at.nn):
        p = vzero2(); d = vzero2()
        mass = vzero()
        for b in range(at.nn):
            u = at.rates + 32 * b
            m = vld(constants, at.masses + 8 * (at.nn * a + b), 0)
            mass += m
            p += m * vld2(scratch, u, 8)
            d += vld(constants, at.director_masses + 8 * (at.nn * a + b), 0) * vld2(scratch, u + 16, 8)
        w = at.increment + at.node * a
        v = vld2(scratch, w, 8)
        by_rho += dot(v, p) - mass * (g1 * component0(v) + g2 * component1(v))
        by_spin += dot(vld2(scratch, w + 16, 8), d)
    vst(inertia, 0, 0, vld(inertia, 0, 0) - by_rho)
    vst(inertia, 8, 0, vld(inertia, 8, 0) - by_spin)


@add_sections.register(SectionSums)
@kernel
def add_sections_of_groups(sums, system, rates, gravity, step, h):
    dofs, tables, scratch = system.dofs, sums.tables, system.work.scratch
    move = motion.call(system.method, system.state, system.work, h)
    strains = set_over.call(sums.strains, move)
    groups = tables.meta.shape[0]
    moduli = sums.stiffness.shape[0] // groups
    changes = sums.change.shape[0] // groups
    inertias = sums.inertia.shape[0] // groups
    for k in range(groups):
        at = layout(dofs, tables.meta[k, NODES], tables.meta[k, POINTS])
        no = tables.meta[k, LIST]
        gather_group(tables, no, at, move, scratch, dofs)
        for a in range(at.nn):
            gather_rates.call(dofs, rates, tables, no + 8 * a, scratch, at.increment + at.node * a)
        for lane in range(0, 8, WIDTH):
            constants = address(tables.tab, tables.meta[k, CONSTANTS] + lane)
            reference = address(move.reference_strains, tables.meta[k, REFERENCE] + lane)
            lanes = address(scratch, lane)
            add_inertias.call(dofs, constants, lanes, at, gravity, step, address(sums.inertia, inertias * k + lane))
            for g in range(at.nq):
                add_point.call(dofs, system.method, strains, constants, reference, g, lanes, at,
                               address(sums.stiffness, moduli * k + lane), address(sums.viscosity, moduli * k + lane),
                          address(sums.change, changes * k + lane))
