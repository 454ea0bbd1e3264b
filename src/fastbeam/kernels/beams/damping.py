"""Energy that the damping of sections takes in a step, D E . D DE/h of every point (theory.md (2.5)), as a term.

Arrays: constants [*] and reference [*], addresses of a group's tables and of its reference strains; scratch [*], its numbers in
lanes: layout.py has their places.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.algebra.dimensions import Plane, Space
from fastbeam.kernels.algebra.native import vld, vst, vzero
from fastbeam.kernels.algebra.vectors import WIDTH, address, dot
from fastbeam.kernels.beams.element_loop import ElementTables, gather_group
from fastbeam.kernels.beams.motions import motion
from fastbeam.kernels.beams.planar import Shape, planar_shapes
from fastbeam.kernels.beams.section_laws import apply_law, matrix_at
from fastbeam.kernels.beams.strain_measures import planar_strains, set_over
from fastbeam.kernels.beams.strains import interpolate, mean_strains
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.jit.generic import generic
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
    VISCOSITY,
    VISCOSITY_IN_PLANE,
    layout,
)
from fastbeam.kernels.terms import account


class Dissipation(NamedTuple):
    """Energy dissipated by the damping of beams with one strain set; G groups of elements."""

    strains: Any           # strain_measures.SimoReissner or GreenLagrange with section_laws.KelvinVoigt
    tables: ElementTables
    place: np.ndarray      # int64 [8 G]: of every lane where its energy stands in `State.history`, -1: it takes none


@generic
def dissipated(dofs, method, strains, constants, reference, g, scratch, at, coupled):
    """Return the energy that point g dissipates in the step."""


@dissipated.register(Space)
@kernel
def dissipated_in_space(dofs, method, strains, constants, reference, g, scratch, at, coupled):
    to = at.point + at.point_size * g
    ao = at.points + at.point_stride * g + SHAPES_AT
    zo = at.blocks
    interpolate(constants, to, at.nn, at.node, scratch, 0, zo + MIDDLE)
    interpolate(constants, to, at.nn, at.node, scratch, 96, zo + END)
    mean_strains(method, strains, reference, 48 * g, scratch, zo, ao)
    eo = zo + STRAINS + HALF_CHANGE
    total = vzero()
    for i in range(6):
        j0 = 0 if coupled else i
        j1 = 6 if coupled else i + 1
        x = vzero()
        for j in range(j0, j1):
            x += vld(constants, VISCOSITY + 48 * i + 8 * j, 0) * vld(scratch, eo + 8 * j, 0)
        total += x * vld(scratch, eo + 8 * i, 0)
    return (2.0 * strains.law.rate) * (vld(constants, to, 0) * total)


@dissipated.register(Plane)
@kernel
def dissipated_in_plane(dofs, method, strains, constants, reference, g, scratch, at, coupled):
    to = at.point + at.point_size * g
    middle, end = planar_shapes(constants, to, at.nn, scratch, 0)
    start = Shape(2.0 * middle.f - end.f, 2.0 * middle.u - end.u, 2.0 * middle.k - end.k)
    half = 0.5 * (planar_strains.call(strains, end) - planar_strains.call(strains, start))
    return 2.0 * dot(half, apply_law(matrix_at(constants, to, VISCOSITY_IN_PLANE, strains.law.rate), half))


@account.register(Dissipation)
@kernel
def account_dissipation(term, system, h):
    """Add the dissipated energy for every part of the scene."""
    dofs, tables, scratch, history = system.dofs, term.tables, system.work.scratch, system.state.history
    move = motion.call(system.method, system.state, system.work, h)
    strains = set_over.call(term.strains, move)
    for k in range(tables.meta.shape[0]):
        damped = False
        for lane in range(8):
            damped = damped or term.place[8 * k + lane] >= 0
        if not damped:
            continue
        at = layout(dofs, tables.meta[k, NODES], tables.meta[k, POINTS])
        coupled = tables.meta[k, COUPLED] != 0
        gather_group(tables, tables.meta[k, LIST], at, move, scratch, dofs)
        for lane in range(0, 8, WIDTH):
            constants = address(tables.tab, tables.meta[k, CONSTANTS] + lane)
            reference = address(move.reference_strains, tables.meta[k, REFERENCE] + lane)
            lanes = address(scratch, lane)
            total = vzero()
            for g in range(at.nq):
                total += dissipated.call(dofs, system.method, strains, constants, reference, g, lanes, at, coupled)
            vst(lanes, at.rows, 0, total)
        for lane in range(8):
            place = term.place[8 * k + lane]
            if place >= 0:
                history[place] += scratch[at.rows + lane]
