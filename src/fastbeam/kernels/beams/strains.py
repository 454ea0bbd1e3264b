"""Strains and stresses at the quadrature points of a part of a group of 8 elements, and those of the tangent (theory.md (4.6)).
Loads, stores and zeros are those of `vectors.WIDTH` lanes; offsets are those of the first of them.

Differences between the strain sets are in simo_reissner.py and green_lagrange.py, those between methods here.

Arrays: constants [*] and reference [*], addresses of a group's tables and of its reference strains; scratch [*], its numbers in
lanes: layout.py has their places.
"""
from __future__ import annotations

from fastbeam.kernels.algebra.native import vld, vld3, vst, vst3, vzero3
from fastbeam.kernels.beams.motions import columns, increment_of_tangent, put_forms, share_of_end
from fastbeam.kernels.beams.section_laws import added_stress, stress_of
from fastbeam.kernels.beams.strain_measures import (
    extrapolated_strains,
    form_stresses,
    mean_of_forms,
    present_strains,
    quadratic_forms,
)
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.layout import BEFORE, END, MIDDLE, NODE_TABLE, STEP, STRAINS, TEMPORARY, Z
from fastbeam.kernels.terms import Conserving, Midpoint


@kernel
def interpolate(constants, to, nn, node, scratch, qo, zo):
    """Form z = (phi', d1, d2, d3, d1', d2', d3') at one point in zo; qo: offset of the first of nn nodes, `node` doubles from one
    to the next."""
    f = vzero3(); d1 = vzero3(); d2 = vzero3(); d3 = vzero3(); k1 = vzero3(); k2 = vzero3(); k3 = vzero3()
    for a in range(nn):
        t = to + 8 + NODE_TABLE * a
        q = qo + node * a
        dp = vld(constants, t, 0); n = vld(constants, t + 8, 0); dn = vld(constants, t + 16, 0)
        f += dp * vld3(scratch, q, 8)
        x = vld3(scratch, q + 24, 8); d1 += n * x; k1 += dn * x
        x = vld3(scratch, q + 48, 8); d2 += n * x; k2 += dn * x
        x = vld3(scratch, q + 72, 8); d3 += n * x; k3 += dn * x
    vst3(scratch, zo, 8, f); vst3(scratch, zo + 24, 8, d1); vst3(scratch, zo + 48, 8, d2); vst3(scratch, zo + 72, 8, d3)
    vst3(scratch, zo + 96, 8, k1); vst3(scratch, zo + 120, 8, k2); vst3(scratch, zo + 144, 8, k3)


# --- by the method ------------------------------------------------------------------------------------------------------
@put_forms.register(object)
@kernel
def put_forms_of_both_ends(method, strains, scratch, zo):
    for i in range(0, Z, 8):
        vst(scratch, zo + TEMPORARY + i, 0, 2.0 * vld(scratch, zo + MIDDLE + i, 0) - vld(scratch, zo + END + i, 0))
    quadratic_forms.call(strains, scratch, zo + TEMPORARY, zo + STRAINS)
    quadratic_forms.call(strains, scratch, zo + END, zo + TEMPORARY)
    return TEMPORARY


@put_forms.register(Midpoint)
@kernel
def put_forms_of_middle(method, strains, scratch, zo):
    quadratic_forms.call(strains, scratch, zo + MIDDLE, zo + STRAINS)
    return STRAINS


@columns.register(object)
@kernel
def columns_of_end(method):
    return END


@columns.register(Midpoint)
@kernel
def columns_of_middle(method):
    return MIDDLE


@share_of_end.register(object)
@kernel
def whole_share(method):
    return 1.0


@share_of_end.register(Conserving)
@kernel
def half_share(method):
    """Return 1/2: only the end changes in the mean of both ends of a step."""
    return 0.5


@increment_of_tangent.register(object)
@kernel
def increment_of_end(method, scratch, zo, gathered):
    return gathered


@increment_of_tangent.register(Midpoint)
@kernel
def increment_of_middle(method, scratch, zo, gathered):
    zb = zo + BEFORE
    zx = zo + STEP
    for i in range(0, Z, 8):
        if not gathered:
            vst(scratch, zb + i, 0, 2.0 * vld(scratch, zo + i, 0) - vld(scratch, zo + END + i, 0)); vst(scratch, zx + i, 0, 0.0)
        vst(scratch, zb + i, 0, vld(scratch, zo + i, 0) + 0.5 * (vld(scratch, zb + i, 0) - vld(scratch, zo + END + i, 0)))
        vst(scratch, zx + i, 0, 0.5 * vld(scratch, zx + i, 0))
    return True


# --- strains of stresses, and of the tangent ----------------------------------------------------------------------------
@kernel
def mean_strains(method, strains, reference, e0, scratch, zo, ao):
    """Form (E_n + E_n+1)/2 - E0 at STRAINS, with damping half of E_n+1 - E_n behind them; for the midpoint rule E(z_mid) - E0.
    Both come from the shapes in the middle and at the end of the step; e0: offset of E0; ao: offset of the data for derivatives
    of the strains, `layout.SHAPES_AT`."""
    eo = zo + STRAINS
    end = put_forms.call(method, strains, scratch, zo)
    mean_of_forms.call(strains, scratch, eo, zo + end, ao)
    for i in range(0, 48, 8):
        vst(scratch, eo + i, 0, vld(scratch, eo + i, 0) - vld(reference, e0 + i, 0))


@kernel
def excess_strains(method, strains, reference, e0, scratch, zo, gathered, ao):
    """Form at STRAINS the difference between the strains to which the last increment led in a straight line and those of the
    present shape, which the tangent adds to the mean strains, theory.md (4.6). BEFORE: the shape before the last increment, STEP:
    that increment; if not `gathered`, there was none in this step and the shape before is that of its start."""
    eo = zo + STRAINS
    present = zo + TEMPORARY
    present_strains.call(strains, scratch, zo + columns.call(method), ao, present)
    if increment_of_tangent.call(method, scratch, zo, gathered):
        extrapolated_strains.call(strains, scratch, zo + BEFORE, zo + STEP, eo, present + 56)
    else:
        # strains at the start, from their mean and those at the end
        for i in range(0, 48, 8):
            mean = vld(scratch, eo + i, 0) + vld(reference, e0 + i, 0)
            vst(scratch, eo + i, 0, 2.0 * mean - vld(scratch, present + i, 0))
    share = share_of_end.call(method)
    for i in range(0, 48, 8):
        vst(scratch, eo + i, 0, share * (vld(scratch, eo + i, 0) - vld(scratch, present + i, 0)))


@kernel
def stresses(law, strains, constants, to, coupled, scratch, eo, so, ao):
    """Form sbar of theory.md (4.7), times the weight of the point, in the lanes at `so`, from the strains at `eo`; law: that of
    the strain set, or for the stresses of the tangent its `tangent_law`."""
    w = vld(constants, to, 0)
    for i in range(6):
        # C of a section without coupling is diagonal
        j0 = 0 if coupled else i
        j1 = 6 if coupled else i + 1
        s = added_stress.call(law, scratch, eo, i)
        for j in range(j0, j1):
            s += stress_of.call(law, constants, 48 * i + 8 * j, scratch, eo + 8 * j)
        vst(scratch, so + 8 * i, 0, w * s)
    form_stresses.call(strains, scratch, ao, so)
