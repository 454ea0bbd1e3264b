"""Modules of fastbeam that measurements reach into, wherever a revision keeps them: flat in the package, or in its packages.

    Stepper = private("newton", "Stepper")

With this a script measures revisions of both layouts. What is public is taken from `fastbeam` itself.
"""
from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import Any

# flat module: the same among packages, which is tried first, because names of packages were names of modules
PACKAGED = {
    "_generic": "kernels.jit.generic", "_jit": "kernels.jit.decorators", "eigen": "linalg.eigen",
    "filtering": "dynamics.filtering",
    "kernels.algebra": "kernels.algebra.vectors", "kernels.beam": "kernels.beams.element_loop",
    "kernels.blocks": "kernels.algebra.blocks", "kernels.chain": "kernels.linalg.chain",
    "kernels.inner": "kernels.beams.inner_nodes", "kernels.layout": "kernels.layout", "kernels.motions": "kernels.beams.motions",
    "kernels.nodes": "kernels.beams.nodes", "kernels.sparse": "kernels.linalg.pardiso", "kernels.step": "kernels.loop",
    "kernels.strain_sets": "kernels.beams.strain_measures", "kernels.substructures": "kernels.linalg.substructures",
    "kernels.terms": "kernels.terms", "kernels.work": "kernels.state", "linsolve": "linalg.linear_system",
    "methods": "stepping.methods", "mkl": "linalg.mkl", "newton": "stepping.stepper", "numbered": "compile.numbered",
    "observe": "results.observe.observer", "ordering": "compile.order", "outcome": "stepping.outcome",
    "substructuring": "compile.substructuring", "tables": "model.tables", "unpacked": "compile.unpack",
    "vibration": "vibration.natural_modes", "workspace": "model.workspace",
}


def module(name: str) -> ModuleType:
    """The module that was `fastbeam.name` in the flat layout.

    Raises
    ------
    KeyError
        No place is known: add it to PACKAGED.
    """
    packaged = f"fastbeam.{PACKAGED[name]}"
    try:
        return import_module(packaged)
    except ModuleNotFoundError as missing:
        if missing.name is None or not f"{packaged}.".startswith(f"{missing.name}."):
            raise
        return import_module(f"fastbeam.{name}")


def private(name: str, *names: str) -> Any:
    """What a module of the flat layout defines: one thing for one name, a list for several."""
    of = module(name)
    found = [getattr(of, each) for each in names]
    return found if len(names) > 1 else found[0]
