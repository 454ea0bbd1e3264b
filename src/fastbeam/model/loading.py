"""Loads and gravity of a compiled scene, and remarks for messages."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fastbeam.kernels.terms import LoadVectors

Array = np.ndarray


@dataclass(frozen=True)
class Loading:
    """Dead loads of a scene: the same vectors in every shape.

    Attributes
    ----------
    loads : LoadVectors
        K vectors in row layout; `load_times[k]` their factor (None: constant).
    load_names : list of str
        Name of the owner of each time function.
    load_parts : dict
        Loads of the scene by their names.
    gravity : float64 [3]
        Gravity, m/s^2, with a factor by `gravity_time`.
    gravity_weight : float64 [N]
        Masses of nodes, kg.
    constant_load : float64 [N, 3]
        Sum of the loads without a time function, N.
    """

    loads: LoadVectors
    load_times: list[Callable[[float], float] | None]
    load_names: list[str]
    load_parts: dict[str, Any]
    gravity: Array
    gravity_time: Callable[[float], Any] | None
    gravity_weight: Array
    constant_load: Array


@dataclass(frozen=True)
class Remarks:
    """Remarks on a model for messages, without effect on results.

    Attributes
    ----------
    text : str
        Text of `print(model)`.
    not_planar : str
        Reason why there is no plane.
    asked_for_plane : bool
        True if compiled with planar=True: only the plane is of interest.
    massless : tuple of str
        Beams without rotary inertia whose triads no support holds.
    notes : tuple of (str, str)
        Kinds and texts of events of a run that begins with the initial velocities.
    joints : dict
        Names of the joints at a node.
    """

    text: str = ""
    not_planar: str = ""
    asked_for_plane: bool = False
    massless: tuple[str, ...] = ()
    notes: tuple[tuple[str, str], ...] = ()
    joints: dict[int, list[str]] = field(default_factory=dict)
