"""Section laws, stresses of strains at a point, as types that strain sets carry: elastic, with the viscosity of Kelvin and Voigt
(theory.md (2.5)), or with filters that dissipate high frequencies (6.2). In a plane stresses and strains are vectors of three, in
space lanes in scratch.

Arrays: constants [*], the tables of a group, and scratch [*], its numbers in lanes: layout.py has their places.
"""
from __future__ import annotations

from typing import Any, NamedTuple

from fastbeam.kernels.algebra.native import vld, vst, vzero
from fastbeam.kernels.algebra.vectors import component0, component1, component2, triple
from fastbeam.kernels.beams.motions import OverStep
from fastbeam.kernels.jit.decorators import inlined
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.layout import HALF_CHANGE, VISCOSITY, VISCOSITY_IN_PLANE


class Elastic(NamedTuple):
    """Elastic law S = C E."""


class KelvinVoigt(NamedTuple):
    """Viscoelastic law S = C E + D E_t."""

    rate: float     # 2/h of the step that is evaluated: D E_t is rate D (E_n+1 - E_n)/2


class TangentOfKelvinVoigt(NamedTuple):
    """Law of the tangent, twice the change of the mean stress with the strain at the end of the step, S = (C + 2 D/h) E."""

    rate: float


class Filtered(NamedTuple):
    """Filtered law S = C (E + more (E_n+1 - E_n)/2), theory.md (6.2); the reference strains hold the filters' values before the
    step."""

    more: float


class TangentOfFiltered(NamedTuple):
    """Law of the tangent, twice the change of the mean stress of `Filtered` with the strain at the end of the step."""

    more: float


ELASTIC, KELVIN_VOIGT = Elastic(), KelvinVoigt(0.0)


class Law(NamedTuple):
    """Symmetric matrix of a point in a plane, times its weight."""

    c00: Any
    c01: Any
    c02: Any
    c11: Any
    c12: Any
    c22: Any


@generic
def law_over(law, motion):
    """Return the law in the step of a motion."""


@law_over.register(Elastic)
@law_over.register(Filtered)
@inlined
def elastic_law(law, motion):
    return law


@law_over.register(KelvinVoigt, OverStep)
@inlined
def viscous_law(law, motion):
    return KelvinVoigt(2.0 / motion.h)


@generic
def tangent_law(law):
    """Return the law of stresses in the tangent alone, theory.md (4.6), half of whose strains are at the end of the step."""


@tangent_law.register(Elastic)
@inlined
def elastic_tangent(law):
    return law


@tangent_law.register(KelvinVoigt)
@inlined
def viscous_tangent(law):
    return TangentOfKelvinVoigt(law.rate)


@tangent_law.register(Filtered)
@inlined
def filtered_tangent(law):
    return TangentOfFiltered(law.more)


# --- in space -----------------------------------------------------------------------------------------------------------
@generic
def put_half_change(law, scratch, e, start, end):
    """Store half the change of a strain behind its mean at e, if the law uses it."""


@put_half_change.register(Elastic)
@inlined
def put_no_change(law, scratch, e, start, end):
    pass


@put_half_change.register(KelvinVoigt)
@put_half_change.register(Filtered)
@inlined
def put_change(law, scratch, e, start, end):
    vst(scratch, e + HALF_CHANGE, 0, 0.5 * (end - start))


@generic
def stress_of(law, constants, k, scratch, e):
    """Return the contribution to a stress of a strain at e, and of half its change in the step at e + HALF_CHANGE; k: offset in
    C."""


@generic
def put_added(law, constants, scratch, zo):
    """Store stresses that a section adds to those of `stress_of`, and their moduli, from the strains and half their change at
    zo."""


@put_added.register(object)
@inlined
def put_none(law, constants, scratch, zo):
    pass


@generic
def added_stress(law, scratch, eo, i):
    """Return the stress that a section adds to stress i of `stress_of`; eo: of the strains."""


@added_stress.register(object)
@inlined
def no_stress(law, scratch, eo, i):
    return vzero()


@generic
def added_energy(law, constants, scratch, zo):
    """Return the energy that a section adds to E C E/2 at the strains of a state, and store its stresses for `added_stress`."""


@added_energy.register(object)
@inlined
def no_energy(law, constants, scratch, zo):
    return vzero()


@stress_of.register(Elastic)
@inlined
def elastic_stress(law, constants, k, scratch, e):
    return vld(constants, k, 0) * vld(scratch, e, 0)


@stress_of.register(KelvinVoigt)
@inlined
def viscous_stress(law, constants, k, scratch, e):
    return vld(constants, k, 0) * vld(scratch, e, 0) + (
        law.rate * vld(constants, VISCOSITY + k, 0)) * vld(scratch, e + HALF_CHANGE, 0)


@stress_of.register(TangentOfKelvinVoigt)
@inlined
def viscous_tangent_stress(law, constants, k, scratch, e):
    return (vld(constants, k, 0) + law.rate * vld(constants, VISCOSITY + k, 0)) * vld(scratch, e, 0)


@stress_of.register(Filtered)
@inlined
def filtered_stress(law, constants, k, scratch, e):
    return vld(constants, k, 0) * (vld(scratch, e, 0) + law.more * vld(scratch, e + HALF_CHANGE, 0))


@stress_of.register(TangentOfFiltered)
@inlined
def filtered_tangent_stress(law, constants, k, scratch, e):
    return (1.0 + law.more) * (vld(constants, k, 0) * vld(scratch, e, 0))


@generic
def modulus(law, constants, k, scratch, zo):
    """Return twice the derivative of the mean stress by a strain at the end of the step: C, or C + 2 D/h; k: offset in C; zo: of
    the numbers of the point."""


@modulus.register(Elastic)
@inlined
def elastic_modulus(law, constants, k, scratch, zo):
    return vld(constants, k, 0)


@modulus.register(KelvinVoigt)
@inlined
def viscous_modulus(law, constants, k, scratch, zo):
    return vld(constants, k, 0) + law.rate * vld(constants, VISCOSITY + k, 0)


@modulus.register(Filtered)
@inlined
def filtered_modulus(law, constants, k, scratch, zo):
    return (1.0 + law.more) * vld(constants, k, 0)


# --- in a plane ---------------------------------------------------------------------------------------------------------
@inlined
def matrix_at(constants, to, k, factor):
    """Return the law of the 3 x 3 matrix at offset k, for the point whose weight stands at `to`."""
    w = factor * vld(constants, to, 0)
    return Law(w * vld(constants, k, 0), w * vld(constants, k + 8, 0), w * vld(constants, k + 16, 0),
               w * vld(constants, k + 32, 0), w * vld(constants, k + 40, 0), w * vld(constants, k + 64, 0))


@inlined
def apply_law(law, e):
    """Return the stresses of three strains."""
    x = component0(e); y = component1(e); z = component2(e)
    return triple(law.c00 * x + law.c01 * y + law.c02 * z, law.c01 * x + law.c11 * y + law.c12 * z,
                  law.c02 * x + law.c12 * y + law.c22 * z)


@generic
def planar_stress(law, stiffness, constants, to, e, half_change):
    """Return stresses of mean strains e and half their change in the step, times the weight; stiffness: the weight times C."""


@planar_stress.register(Elastic)
@inlined
def elastic_planar_stress(law, stiffness, constants, to, e, half_change):
    return apply_law(stiffness, e)


@planar_stress.register(KelvinVoigt)
@inlined
def viscous_planar_stress(law, stiffness, constants, to, e, half_change):
    return apply_law(stiffness, e) + apply_law(matrix_at(constants, to, VISCOSITY_IN_PLANE, law.rate), half_change)


@generic
def planar_modulus(law, stiffness, constants, to):
    """Return the matrix of `modulus` for all strains."""


@planar_modulus.register(Elastic)
@inlined
def elastic_planar_modulus(law, stiffness, constants, to):
    return stiffness


@planar_modulus.register(KelvinVoigt)
@inlined
def viscous_planar_modulus(law, stiffness, constants, to):
    x = matrix_at(constants, to, VISCOSITY_IN_PLANE, law.rate)
    return Law(stiffness.c00 + x.c00, stiffness.c01 + x.c01, stiffness.c02 + x.c02, stiffness.c11 + x.c11,
               stiffness.c12 + x.c12, stiffness.c22 + x.c22)


@planar_stress.register(Filtered)
@inlined
def filtered_planar_stress(law, stiffness, constants, to, e, half_change):
    return apply_law(stiffness, e + law.more * half_change)


@planar_modulus.register(Filtered)
@inlined
def filtered_planar_modulus(law, stiffness, constants, to):
    x = 1.0 + law.more
    return Law(x * stiffness.c00, x * stiffness.c01, x * stiffness.c02, x * stiffness.c11, x * stiffness.c12, x * stiffness.c22)
