"""Strain sets as types, and the questions of the element loops to a set: strains, factors of their derivatives, stiffness.

Implementations are in simo_reissner.py, green_lagrange.py and beams/planar.py. Offsets in scratch are those of layout.py.

Arrays: constants [*], the tables of a group, and scratch [*], its numbers in lanes: layout.py has their places.
"""
from __future__ import annotations

from typing import Any, NamedTuple

from fastbeam.kernels.beams.section_laws import ELASTIC, law_over
from fastbeam.kernels.jit.decorators import inlined, kernel
from fastbeam.kernels.jit.generic import generic


class SimoReissner(NamedTuple):
    """Strain set (2.2) of theory.md."""

    law: Any = ELASTIC


class GreenLagrange(NamedTuple):
    """Strain set (2.1)."""

    law: Any = ELASTIC


SIMO_REISSNER, GREEN_LAGRANGE = SimoReissner(), GreenLagrange()


@generic
def set_over(strains, motion):
    """Return the strain set with its law in the step of a motion."""


@set_over.register(SimoReissner)
@inlined
def simo_over(strains, motion):
    return SimoReissner(law_over.call(strains.law, motion))


@set_over.register(GreenLagrange)
@inlined
def green_over(strains, motion):
    return GreenLagrange(law_over.call(strains.law, motion))


# --- in space -----------------------------------------------------------------------------------------------------------
@generic
def quadratic_forms(strains, scratch, z, eo):
    """Form the quadratic forms of z that strains are made of, theory.md (2.1), (2.4), in lanes at eo: phi'.phi'/2, two shears,
    twist, two curvatures; of strain set (2.2) a seventh, c - 7/4."""


@generic
def mean_of_forms(strains, scratch, eo, end, ao):
    """Form means of the strains from the forms at eo and at `end`, six lanes at eo; ao: offset of the data for derivatives of the
    strains."""


@generic
def present_strains(strains, scratch, z, ao, eo):
    """Form strains of the shape z to which the tangent belongs, six lanes at eo."""


@generic
def strains_of_shape(strains, scratch, z, eo):
    """Form strains of a shape z that stands alone, six lanes at eo; the one behind them is in use."""


@generic
def extrapolated_strains(strains, scratch, z, x, eo, temporary):
    """Form E(z) + DE(z) x of theory.md (4.6), six lanes at eo."""


@generic
def strain_changes(strains, scratch, z, x, ao, eo):
    """Form changes of the strains on which the mean stresses of a step do work, theory.md (4.7), along x from the shape z in its
    middle: six lanes at eo; the one behind them is in use."""


@generic
def form_stresses(strains, scratch, ao, so):
    """Transform the stresses S at so to the s of theory.md (4.7), which multiply the derivatives of the quadratic forms."""


@generic
def add_stresses(strains, scratch, other, so):
    """Add stresses that `form_stresses` left at `other` to those at so."""


@generic
def add_forces(strains, constants, to, nn, scratch, z, so, fo):
    """Add internal forces B(q_mid)^T S on the coordinates of every node, fo: nn x 12 lanes."""


@generic
def add_director_forces(strains, constants, to, nn, scratch, z, so, fo):
    """Add internal forces B(q_mid)^T S on the directors alone."""


@generic
def prepare_points(dofs, strains, scratch, at):
    """Form quantities that all points of an element share, before the loop over them."""


@prepare_points.register(object)
@kernel
def prepare_nothing(dofs, strains, scratch, at):
    pass


@generic
def point_stiffness(strains, constants, to, coupled, scratch, at, columns, po):
    """Form the factors, at po, of the stiffness of one point from which those of pairs of nodes are formed; columns: offset of z
    of the shape whose variation the columns of the tangent are, MIDDLE or END."""


@generic
def sum_pair(strains, constants, scratch, at, a, b):
    """Sum stresses times basis products over the points, for nodes a and b and for b and a, at at.pairs."""


@generic
def add_geometric(strains, krr, scratch, qa, qb, sums, q2, q3):
    """Return krr plus the part of directors against directors from the sums of a pair: qa, qb: mid coordinates of a and end
    coordinates of b; q2, q3: inertia of the directors."""


# --- in a plane ---------------------------------------------------------------------------------------------------------
@generic
def planar_strains(strains, shape):
    """Return stretch, shear and curvature."""


@generic
def planar_extrapolated(strains, shape, step):
    """Return the strains of a shape plus their derivative along a step."""


@generic
def planar_point_data(strains, middle, start, end):
    """Return the data for derivatives of the strains."""


@generic
def planar_changes(strains, data, middle, step):
    """Return changes of the strains, as `strain_changes`."""


@generic
def planar_form_stresses(strains, data, s):
    """Return the stresses that multiply the derivatives of the quadratic forms, theory.md (4.7), from three stresses."""


@generic
def planar_director_forces(strains, data, middle, s):
    """Return (x, y): forces on the director of a node are dir x + dir_s y."""


@generic
def planar_position_force(strains, data, middle, s):
    """Return x: the force on the position of a node is phi_s x."""


@generic
def planar_point_stiffness(strains, data, middle, end, law, t, forces, constants, to, scratch, at, po):
    """Form the stiffness of a point for pairs of nodes, at po, from stresses t; add the forces of the point."""


@generic
def planar_no_sums(strains):
    """Return zero sums of stresses times basis products."""


@generic
def planar_sums(strains, sums, scratch, po, a, b):
    """Return sums of stresses times basis products of two nodes, with those of one point more."""


@generic
def planar_reversed(strains, sums):
    """Return the sums of these nodes in the other order."""


@generic
def planar_geometric(strains, sums, ua, ub):
    """Return the block rotation against rotation from the sums of a pair."""
