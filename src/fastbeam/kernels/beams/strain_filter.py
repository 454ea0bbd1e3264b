"""Dissipation of high frequencies by two filters of the strains of every point (theory.md (6.2)), as a term: their stress in the
strains that a step subtracts, and the update of filters and energies after it.

Arrays: constants [*] and reference [*], addresses of a group's tables and of its reference strains; scratch [*], its numbers in
lanes: layout.py has their places; x, y [*], addresses of strains of a point, and change_out [*], where they are written.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import Plane, Space
from fastbeam.kernels.algebra.native import vld, vld3, vst, vst3, vzero
from fastbeam.kernels.algebra.vectors import WIDTH, address, dot
from fastbeam.kernels.beams.element_loop import ElementTables, gather_group
from fastbeam.kernels.beams.motions import motion
from fastbeam.kernels.beams.planar import Shape, planar_shapes
from fastbeam.kernels.beams.section_laws import apply_law, matrix_at
from fastbeam.kernels.beams.strain_measures import planar_strains, set_over
from fastbeam.kernels.beams.strains import interpolate, mean_strains
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.jit.records import in_memory
from fastbeam.kernels.layout import (
    CONSTANTS,
    COUPLED,
    END,
    HALF_CHANGE,
    LIST,
    MIDDLE,
    NODES,
    POINTS,
    REFERENCE,
    SHAPES_AT,
    STRAINS,
    layout,
)
from fastbeam.kernels.terms import account, first_guess


class StrainFilter(NamedTuple):
    """Filters of beams with one strain set; G groups of elements, n strains of all their points in lanes."""

    strains: Any           # strain_measures.SimoReissner or GreenLagrange with section_laws.Filtered
    tables: ElementTables
    begin: np.ndarray      # int64 [1]: where its strains begin among those of the run
    live: np.ndarray       # float64 [8 G]: 1, of idle lanes 0
    factors: np.ndarray    # float64 [3]: a, b, kappa
    free: np.ndarray       # float64 [n]: reference strains of the run, without stress of the filters
    smooth: np.ndarray     # float64 [n]: m, a smoothed rate of the strains, 1/s
    rate: np.ndarray       # float64 [n]: r, their rate at the end of the last step, 1/s
    kept: np.ndarray       # float64 [2 n + 2]: m, r and energies before the last step
    change: np.ndarray     # float64 [n]: of the strains in a step
    rest: np.ndarray       # float64 [n]: their change less h m
    lost: np.ndarray       # float64 [2], J: dissipated since the start, and stored in the filters


@generic
def put_change(dofs, method, strains, constants, reference, g, scratch, at, change_out):
    """Change of the strains of point g in the step."""


@put_change.register(Space)
@kernel
def put_change_in_space(dofs, method, strains, constants, reference, g, scratch, at, change_out):
    to = at.point + at.point_size * g
    zo = at.blocks
    interpolate(constants, to, at.nn, at.node, scratch, 0, zo + MIDDLE)
    interpolate(constants, to, at.nn, at.node, scratch, 96, zo + END)
    mean_strains(method, strains, reference, 48 * g, scratch, zo, at.points + at.point_stride * g + SHAPES_AT)
    for i in range(0, 48, 8):
        vst(change_out, 48 * g + i, 0, 2.0 * vld(scratch, zo + STRAINS + HALF_CHANGE + i, 0))


@put_change.register(Plane)
@kernel
def put_change_in_plane(dofs, method, strains, constants, reference, g, scratch, at, change_out):
    middle, end = planar_shapes(constants, at.point + at.point_size * g, at.nn, scratch, 0)
    start = Shape(2.0 * middle.f - end.f, 2.0 * middle.u - end.u, 2.0 * middle.k - end.k)
    vst3(change_out, 24 * g, 8, planar_strains.call(strains, end) - planar_strains.call(strains, start))


@generic
def product(dofs, constants, to, coupled, x, y):
    """Return the weight times x . C y at the point whose table begins at `to`."""


@product.register(Space)
@kernel
def product_in_space(dofs, constants, to, coupled, x, y):
    total = vzero()
    for i in range(6):
        j0 = 0 if coupled else i
        j1 = 6 if coupled else i + 1
        s = vzero()
        for j in range(j0, j1):
            s += vld(constants, 48 * i + 8 * j, 0) * vld(y, 8 * j, 0)
        total += s * vld(x, 8 * i, 0)
    return vld(constants, to, 0) * total


@product.register(Plane)
@kernel
def product_in_plane(dofs, constants, to, coupled, x, y):
    return dot(vld3(x, 0, 8), apply_law(matrix_at(constants, to, 0, 1.0), vld3(y, 0, 8)))


@kernel
def put_changes(term, system, k, h):
    """Store changes of all strains of group k in a step of size h."""
    dofs, tables, scratch = system.dofs, term.tables, system.work.scratch
    move = motion.call(system.method, system.state, system.work, h)
    strains = set_over.call(term.strains, move)
    at = layout(dofs, tables.meta[k, NODES], tables.meta[k, POINTS])
    gather_group(tables, tables.meta[k, LIST], at, move, scratch, dofs)
    o = tables.meta[k, REFERENCE] - term.begin[0]
    for lane in range(0, 8, WIDTH):
        constants = address(tables.tab, tables.meta[k, CONSTANTS] + lane)
        reference = address(move.reference_strains, tables.meta[k, REFERENCE] + lane)
        for g in range(at.nq):
            put_change.call(dofs, system.method, strains, constants, reference, g, address(scratch, lane), at,
                            address(term.change, o + lane))


@generic
def put_all_changes(term, system, h):
    """Store changes of the strains of all filters."""


@put_all_changes.register(StrainFilter)
@kernel
def put_changes_of_filter(term, system, h):
    for k in range(term.tables.meta.shape[0]):
        put_changes(term, system, k, h)


@kernel
def group_energy(term, system, k, x, y):
    """Sum of x . C y over the points of group k."""
    dofs, tables, scratch = system.dofs, term.tables, system.work.scratch
    at = layout(dofs, tables.meta[k, NODES], tables.meta[k, POINTS])
    n = 48 if len(dofs) == 6 else 24
    o = tables.meta[k, REFERENCE] - term.begin[0]
    for lane in range(0, 8, WIDTH):
        constants = address(tables.tab, tables.meta[k, CONSTANTS] + lane)
        total = vzero()
        for g in range(at.nq):
            total += product.call(dofs, constants, at.point + at.point_size * g, tables.meta[k, COUPLED] != 0,
                                  address(x, o + n * g + lane), address(y, o + n * g + lane))
        vst(address(scratch, lane), at.rows, 0, total)
    out = 0.0
    for lane in range(8):
        if term.live[8 * k + lane] != 0.0:
            out += scratch[at.rows + lane]
    return out


@first_guess.register(StrainFilter)
@kernel
def begin_filters(term, system, h, c):
    """Store the known stress of the filters at the begin of a step, as strains that are subtracted with those of the
    reference."""
    a, b, begin, subtracted = h * term.factors[0], 2.0 * h * term.factors[1], term.begin[0], system.work.reference_strains
    for i in range(term.free.shape[0]):
        subtracted[begin + i] = term.free[i] + (a * term.smooth[i] + b * term.rate[i])


@account.register(StrainFilter)
@kernel
def account_filters(term, system, h):
    """Update filters and their energies after the step."""
    n = term.free.shape[0]
    term.kept[2 * n] = term.lost[0]
    term.kept[2 * n + 1] = term.lost[1]
    put_changes_of_filter(term, system, h)
    a, b, kappa = term.factors[0], term.factors[1], term.factors[2]
    for i in range(n):
        m, r, change = term.smooth[i], term.rate[i], term.change[i]
        term.kept[i] = m
        term.kept[n + i] = r
        term.rest[i] = change - h * m
        term.smooth[i] = m + (kappa / h) * term.rest[i]
        term.rate[i] = r + (2.0 / h) * (change - h * r)
    # energy that the filters dissipate, then the work of their stress
    through = 0.0
    for k in range(term.tables.meta.shape[0]):
        through += (a * (1.0 - 0.5 * kappa)) * group_energy(term, system, k, term.rest, term.rest)
    for i in range(n):
        term.rest[i] = a * term.rest[i] + 2.0 * b * (term.change[i] - h * term.kept[n + i])
    done = 0.0
    for k in range(term.tables.meta.shape[0]):
        done += group_energy(term, system, k, term.rest, term.change)
    term.lost[0] += through
    term.lost[1] += done - through


@kernel
def changes_of(terms, system, h):
    put_all_changes.each(in_memory(terms), in_memory(system), h)
