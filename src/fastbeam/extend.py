"""What a module needs that adds a link between two points to fastbeam from outside; docs/extending.md walks through one.

These names stay. Everything else below `fastbeam` that is no public name may change with any version.
"""
from __future__ import annotations

from ._jit import kernel
from .arguments import Flag, Name, Number, Vector, checked
from .errors import SceneError
from .kernels.algebra import cross, dot
from .kernels.kinds import add_stiffness, add_to, position
from .kernels.terms import Conserving, assemble, potential_energy
from .links import Ends
from .links import register as register_link
from .scene.links import Link
from .scene.parts import Node

__all__ = ["Conserving", "Ends", "Flag", "Link", "Name", "Node", "Number", "SceneError", "Vector", "add_stiffness", "add_to",
           "assemble", "checked", "cross", "dot", "kernel", "position", "potential_energy", "register_link"]
