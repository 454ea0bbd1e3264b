"""fastbeam: large flexible multibody systems with sliding contact.

Geometrically exact beams with a rotationless director triad, energy-momentum conserving time integration, sliders whose sliding
coordinate is an unknown of the same step.
"""
from __future__ import annotations

from typing import Any

__version__ = "0.1.0"

_WHERE = {
    "scene": ["BallJoint", "Beam", "Clamp", "DistanceJoint", "DistributedLoad", "Drag", "Drive", "Friction", "InitialVelocity",
              "Load", "Net", "NodeRef", "Path", "Pin", "PointMass", "PrescribedMotion", "RigidBody", "RigidConnection",
              "RigidMotion", "Scene", "Section", "Signal", "Sleeve", "Slider", "Spring", "Stops"],
    "errors": ["BackendError", "ConvergenceError", "Interrupted", "ResultFileError", "SceneError"],
    "compile": ["compile_scene"],
    "checkpoint": ["Checkpoint", "load_checkpoint"],
    "run": ["simulate"],
    "statics": ["solve_static"],
    "result": ["Result"],
    "reading": ["load_result"],
    "plot": ["plot_invariants", "plot_overview", "plot_shapes", "plot_slider"],
}
_HOME = {name: module for module, names in _WHERE.items() for name in names}
__all__ = ["__version__", *sorted(_HOME)]


def __getattr__(name: str) -> Any:
    # modules load when first used: the import itself needs neither numba nor matplotlib nor h5py
    if name not in _HOME:
        raise AttributeError(f"module 'fastbeam' has no attribute {name!r}")
    from importlib import import_module
    value = getattr(import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
