"""Sections with stresses that are nonlinear in their strains: to C E of theory.md (2.3) a law adds for every strain e the
derivative of an energy W(e) per length, theory.md (2.9).

A step takes the mean of W' along the straight line between the strains at its ends, by three points of Gauss, with the rest that
is missing of its integral, W(e_n+1) - W(e_n): so the energy is conserved to round-off also where W' has kinks.

Arrays: constants [*], the tables of a group, and scratch [*], its numbers in lanes: layout.py has their places; p
[PARAMETERS], those of a strain, and parameters [6 * PARAMETERS]; strains, stresses_out [6 n].
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.algebra.native import vld
from fastbeam.kernels.algebra.vectors import WIDTH, ld1, st1
from fastbeam.kernels.beams.section_laws import (
    added_energy,
    added_stress,
    law_over,
    modulus,
    put_added,
    put_change,
    put_half_change,
    stress_of,
    tangent_law,
)
from fastbeam.kernels.jit.decorators import inlined, kernel
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.layout import ADDED, HALF_CHANGE, MODULI, PARAMETERS, STRAINS

# points of Gauss on (0, 1) and their weights
FIRST, MIDDLE, LAST = 0.5 - 0.15**0.5, 0.5, 0.5 + 0.15**0.5
OUTER, INNER = 5.0 / 18.0, 8.0 / 18.0
# energy that counts as round-off, as a share of those at the ends of a step; change of a strain, as a share of it, below which
# the mean of W' is that of the points
ROUND_OFF, SHORT = 16.0 * np.finfo(float).eps, 1e-6


class Nonlinear(NamedTuple):
    """Law S = law(E) + W'(E)."""

    law: Any      # section_laws.Elastic or KelvinVoigt
    added: Any    # named tuple from outside, with implementations of `section_energy`, `section_stress`, `section_modulus`
    ahead: int    # doubles from the parameters of the group to C, which stand ahead of it


class TangentOfNonlinear(NamedTuple):
    """Law of the tangent, twice the change of the mean stress with the strain at the end of the step."""

    law: Any


@generic
def section_energy(law, e, p):
    """Return the energy W per length, J/m, at strain e; p: the `PARAMETERS` numbers of the section for this strain."""


@generic
def section_stress(law, e, p):
    """Return the stress W'(e), N or N m."""


@generic
def section_modulus(law, e, p):
    """Return the modulus W''(e), N or N m^2."""


@law_over.register(Nonlinear)
@inlined
def nonlinear_over(law, motion):
    return Nonlinear(law_over.call(law.law, motion), law.added, law.ahead)


@tangent_law.register(Nonlinear)
@inlined
def nonlinear_tangent(law):
    return TangentOfNonlinear(tangent_law.call(law.law))


put_half_change.register(Nonlinear)(put_change)


@kernel
def parameters_at(constants, o):
    """Return the parameters of a strain of the element whose lane begins at o."""
    return ld1(constants, o, 0), ld1(constants, o + 8, 0), ld1(constants, o + 16, 0), ld1(constants, o + 24, 0)


@inlined
def is_linear(p):
    """Return whether a strain has no added stress: all its parameters are zero."""
    return p[0] == 0.0 and p[1] == 0.0 and p[2] == 0.0 and p[3] == 0.0


@kernel
def mean_stress(added, start, end, p):
    """Return the mean of W' over a step from one strain to another, and twice its derivative by the strain at the end."""
    change = end - start
    x, y, z = start + FIRST * change, start + MIDDLE * change, start + LAST * change
    stress = (OUTER * (section_stress.call(added, x, p) + section_stress.call(added, z, p))
              + INNER * section_stress.call(added, y, p))
    slope = 2.0 * (OUTER * (FIRST * section_modulus.call(added, x, p) + LAST * section_modulus.call(added, z, p))
                   + INNER * MIDDLE * section_modulus.call(added, y, p))
    if abs(change) > SHORT * max(abs(start), abs(end)):
        first, last = section_energy.call(added, start, p), section_energy.call(added, end, p)
        missing = last - first - stress * change
        if abs(missing) > ROUND_OFF * (abs(first) + abs(last)):
            stress += missing / change
            slope = 2.0 * (section_stress.call(added, end, p) - stress) / change
    return stress, slope


@put_added.register(Nonlinear)
@kernel
def put_added_stresses(law, constants, scratch, zo):
    for i in range(6):
        for lane in range(WIDTH):
            o = 8 * i + lane
            p = parameters_at(constants, 8 * PARAMETERS * i + lane - law.ahead)
            stress, slope = 0.0, 0.0
            if not is_linear(p):
                mean, half = ld1(scratch, zo + STRAINS + o, 0), ld1(scratch, zo + STRAINS + HALF_CHANGE + o, 0)
                stress, slope = mean_stress(law.added, mean - half, mean + half, p)
            st1(scratch, zo + ADDED + o, 0, stress)
            st1(scratch, zo + MODULI + o, 0, slope)


@added_stress.register(Nonlinear)
@inlined
def nonlinear_stress(law, scratch, eo, i):
    return vld(scratch, eo - STRAINS + ADDED + 8 * i, 0)


@added_stress.register(TangentOfNonlinear)
@inlined
def nonlinear_tangent_stress(law, scratch, eo, i):
    return vld(scratch, eo - STRAINS + MODULI + 8 * i, 0) * vld(scratch, eo + 8 * i, 0)


@stress_of.register(Nonlinear)
@stress_of.register(TangentOfNonlinear)
@inlined
def linear_stress(law, constants, k, scratch, e):
    return stress_of.call(law.law, constants, k, scratch, e)


@modulus.register(Nonlinear)
@kernel
def nonlinear_modulus(law, constants, k, scratch, zo):
    found = modulus.call(law.law, constants, k, scratch, zo)
    # on the diagonal of C
    return found + vld(scratch, zo + MODULI + k // 7, 0) if k % 56 == 0 else found


# --- of states ----------------------------------------------------------------------------------------------------------
@added_energy.register(Nonlinear)
@kernel
def put_energy_of_state(law, constants, scratch, zo):
    for lane in range(WIDTH):
        total = 0.0
        for i in range(6):
            p = parameters_at(constants, 8 * PARAMETERS * i + lane - law.ahead)
            stress = 0.0
            if not is_linear(p):
                e = ld1(scratch, zo + STRAINS + 8 * i + lane, 0)
                total += section_energy.call(law.added, e, p)
                stress = section_stress.call(law.added, e, p)
            st1(scratch, zo + ADDED + 8 * i + lane, 0, stress)
        st1(scratch, zo + MODULI + lane, 0, total)
    return vld(scratch, zo + MODULI, 0)


@kernel
def put_section_stresses(added, parameters, strains, stresses_out):
    """Store W' of n times six strains of a section."""
    for k in range(strains.shape[0]):
        o = PARAMETERS * (k % 6)
        p = parameters[o], parameters[o + 1], parameters[o + 2], parameters[o + 3]
        stresses_out[k] = 0.0 if is_linear(p) else section_stress.call(added, strains[k], p)


@kernel
def put_law(added, e, p, out):
    """Store W, W' and W'' at a strain in out [3]; p: its parameters."""
    out[0] = section_energy.call(added, e, p)
    out[1] = section_stress.call(added, e, p)
    out[2] = section_modulus.call(added, e, p)
