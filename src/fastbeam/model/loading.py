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
    """Dead loads of a scene: the same vectors in every shape."""

    loads: LoadVectors  # K vectors in row layout; `load_times[k]` their factor (None: constant)
    load_times: list[Callable[[float], float] | None]
    load_names: list[str]  # name of the owner of each time function
    load_parts: dict[str, Any]  # loads of the scene by their names
    gravity: Array  # float64 [3]: gravity, m/s^2, with a factor by `gravity_time`
    gravity_time: Callable[[float], Any] | None
    gravity_weight: Array  # float64 [N]: masses of nodes, kg
    constant_load: Array  # float64 [N, 3]: sum of the loads without a time function, N


@dataclass(frozen=True)
class Remarks:
    """Remarks on a model for messages, without effect on results."""

    text: str = ""  # text of `print(model)`
    not_planar: str = ""  # reason why there is no plane
    asked_for_plane: bool = False  # true if compiled with planar=True: only the plane is of interest
    massless: tuple[str, ...] = ()  # beams without rotary inertia whose triads no support holds
    notes: tuple[tuple[str, str], ...] = ()  # kinds and texts of events of a run that begins with the initial velocities
    joints: dict[int, list[str]] = field(default_factory=dict)  # names of the joints at a node
