"""fastbeam: large flexible multibody systems with sliding contact.

Geometrically exact beams with a rotationless director triad, energy-momentum conserving time integration, sliders whose sliding
coordinate is an unknown of the same step.
"""
from __future__ import annotations

from typing import TYPE_CHECKING, Any

__version__ = "0.2.0"

_WHERE = {
    "scene": ["AddedMass", "BallJoint", "Beam", "Bushing", "Clamp", "Controller", "Crossing", "CylindricalJoint", "Damper",
              "DistanceJoint", "DistributedLoad", "Drag", "Drive", "ForceElement", "Friction", "GROUND", "InitialVelocity",
              "LineForce", "Load",
              "Lock", "MovingMesh", "Net", "NodeRef", "OneSided", "Path", "Pin", "PlanarJoint", "PointMass", "PrescribedMotion",
              "PrismaticJoint", "Release", "RevoluteJoint", "RigidBody", "RigidConnection", "RigidMotion", "Scene", "Section",
              "Signal", "Sleeve", "Slider", "SphericalJoint", "Spring", "Stops", "Switch", "UniversalJoint", "UserForce",
              "Winch"],
    "errors": ["BackendError", "ConvergenceError", "Interrupted", "ResultFileError", "ResultWarning", "SceneError"],
    "compile": ["compile_scene"],
    "remeshing": ["with_moving_meshes"],
    "checkpoint": ["Checkpoint", "load_checkpoint"],
    "run": ["simulate"],
    "statics": ["solve_static"],
    "vibration": ["modes"],
    "steady": ["Spin", "Travel"],
    "harmonic": ["frequency_response"],
    "relaxing": ["relax"],
    "form_finding": ["force_density"],
    "finding_lengths": ["find_lengths"],
    "equilibrium_paths": ["solve_path"],
    "stick_limits": ["stick_interval"],
    "sensitivities": ["sensitivity"],
    "critical_slopes": ["critical_sensitivity"],
    "adjoint": ["adjoint_run"],
    "result": ["Result"],
    "resultants": ["section_forces"],
    "reading": ["load_result"],
    "sweeping": ["Sweep", "load_sweep", "sweep"],
    "animation": ["animate"],
    "plot": ["plot_balance", "plot_invariants", "plot_modes", "plot_overview", "plot_response", "plot_shapes", "plot_slider"],
}
_HOME = {name: module for module, names in _WHERE.items() for name in names}
__all__ = ["__version__", *sorted(_HOME)]

if TYPE_CHECKING:
    # what type checkers and editors read: the names of _WHERE once more
    from .scene import (
        AddedMass as AddedMass,
        BallJoint as BallJoint, Beam as Beam, Bushing as Bushing, Clamp as Clamp, Controller as Controller,
        Crossing as Crossing,
        CylindricalJoint as CylindricalJoint,
        Damper as Damper, DistanceJoint as DistanceJoint, DistributedLoad as DistributedLoad, Drag as Drag, Drive as Drive,
        ForceElement as ForceElement, Friction as Friction, GROUND as GROUND,
        InitialVelocity as InitialVelocity, LineForce as LineForce, Load as Load, Lock as Lock,
        MovingMesh as MovingMesh, Net as Net,
        NodeRef as NodeRef, OneSided as OneSided, Path as Path, Pin as Pin, PlanarJoint as PlanarJoint, PointMass as PointMass,
        PrescribedMotion as PrescribedMotion, PrismaticJoint as PrismaticJoint, Release as Release,
        RevoluteJoint as RevoluteJoint, RigidBody as RigidBody, RigidConnection as RigidConnection, RigidMotion as RigidMotion,
        Scene as Scene, Section as Section, Signal as Signal, Sleeve as Sleeve, Slider as Slider,
        SphericalJoint as SphericalJoint, Spring as Spring,
        Stops as Stops, Switch as Switch, UniversalJoint as UniversalJoint, UserForce as UserForce,
        Winch as Winch,
    )
    from .errors import (
        BackendError as BackendError, ConvergenceError as ConvergenceError, Interrupted as Interrupted,
        ResultFileError as ResultFileError, ResultWarning as ResultWarning, SceneError as SceneError,
    )
    from .compile import compile_scene as compile_scene
    from .remeshing import with_moving_meshes as with_moving_meshes
    from .checkpoint import Checkpoint as Checkpoint, load_checkpoint as load_checkpoint
    from .run import simulate as simulate
    from .statics import solve_static as solve_static
    from .stick_limits import stick_interval as stick_interval
    from .vibration import modes as modes
    from .steady import Spin as Spin, Travel as Travel
    from .harmonic import frequency_response as frequency_response
    from .relaxing import relax as relax
    from .form_finding import force_density as force_density
    from .finding_lengths import find_lengths as find_lengths
    from .equilibrium_paths import solve_path as solve_path
    from .sensitivities import sensitivity as sensitivity
    from .critical_slopes import critical_sensitivity as critical_sensitivity
    from .adjoint import adjoint_run as adjoint_run
    from .result import Result as Result
    from .resultants import section_forces as section_forces
    from .reading import load_result as load_result
    from .sweeping import Sweep as Sweep, load_sweep as load_sweep, sweep as sweep
    from .animation import animate as animate
    from .plot import (
        plot_balance as plot_balance, plot_invariants as plot_invariants, plot_modes as plot_modes,
        plot_overview as plot_overview, plot_response as plot_response, plot_shapes as plot_shapes, plot_slider as plot_slider,
    )

if not TYPE_CHECKING:
    def __getattr__(name: str) -> Any:
        # modules load when first used: the import itself needs neither numba nor matplotlib nor h5py
        from importlib import import_module
        if name not in _HOME:
            new = None if name.startswith("_") else import_module(".deprecation", __name__).new_name(name)
            if new is None:
                raise AttributeError(f"module 'fastbeam' has no attribute {name!r}")
            return getattr(import_module(__name__), new)
        from ._collection import held
        with held():
            value = getattr(import_module(f".{_HOME[name]}", __name__), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return __all__
