"""Names that a module needs to add links between two points and laws of sections to fastbeam from outside; docs/extending.md
walks through three.

These names stay. Everything else below `fastbeam` that is no public name may change with any version.
"""
from __future__ import annotations

from fastbeam.compile.links import Ends
from fastbeam.compile.links import register as register_link
from fastbeam.interface.arguments import Flag, Name, Number, Vector, checked
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.algebra.dimensions import add_stiffness, add_to, position
from fastbeam.kernels.algebra.vectors import cross, dot
from fastbeam.kernels.beams.nonlinear_sections import section_energy, section_modulus, section_stress
from fastbeam.kernels.contact.point_entries import begin_joint as begin_constraint
from fastbeam.kernels.contact.point_entries import forget_gaps, joints_are_closed, put_point, take_forces
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.terms import (
    Conserving,
    Equilibrium,
    assemble,
    first_guess,
    is_settled,
    potential_energy,
    take_unknowns,
)
from fastbeam.scene.bodies import Node
from fastbeam.scene.links import Link
from fastbeam.scene.sections import SectionLaw

__all__ = ["Conserving", "Ends", "Equilibrium", "Flag", "Link", "Name", "Node", "Number", "SceneError", "SectionLaw", "Vector",
           "add_stiffness", "add_to", "assemble", "begin_constraint", "checked", "cross", "dot", "kernel", "position",
           "potential_energy", "put_point", "register_constraints", "register_link", "section_energy",
           "section_modulus", "section_stress"]


def register_constraints(table: type) -> None:
    """Register what all constraints answer for a class of tables: their forces are unknowns, and gaps have to be closed.

    Parameters
    ----------
    table : type
        A named tuple with `node` [L, 2], and `first` [1] of `Ends`; its `assemble` puts forces, gaps and entries.
    """
    first_guess.register(table)(forget_gaps)
    take_unknowns.register(table)(take_forces)
    is_settled.register(table)(joints_are_closed)
