"""Names that a module needs to add a link between two points to fastbeam from outside; docs/extending.md walks through one.

These names stay. Everything else below `fastbeam` that is no public name may change with any version.
"""
from __future__ import annotations

from fastbeam.compile.links import Ends
from fastbeam.compile.links import register as register_link
from fastbeam.interface.arguments import Flag, Name, Number, Vector, checked
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.algebra.dimensions import add_stiffness, add_to, position
from fastbeam.kernels.algebra.vectors import cross, dot
from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.terms import Conserving, assemble, potential_energy
from fastbeam.scene.bodies import Node
from fastbeam.scene.links import Link

__all__ = ["Conserving", "Ends", "Flag", "Link", "Name", "Node", "Number", "SceneError", "Vector", "add_stiffness", "add_to",
           "assemble", "checked", "cross", "dot", "kernel", "position", "potential_energy", "register_link"]
