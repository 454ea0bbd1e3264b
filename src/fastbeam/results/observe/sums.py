"""Energies and momenta of the states of a model, in space, from coordinates in space or in its plane."""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.kernels import energies as kernels
from fastbeam.kernels.algebra.dimensions import PLANE, SPACE
from fastbeam.kernels.empty_arrays import aligned_empty, empty
from fastbeam.model.model import Model
from fastbeam.model.workspace import ReferenceStrains, scratch_of

Array = np.ndarray
LINEAR, ANGULAR = (slice(k, k + 3) for k in (kernels.LINEAR, kernels.ANGULAR))


class Sums:
    """Sums of states, in the columns of `energies`.

    strains: those of the run; default: of the model.
    plane: that of the coordinates, None in space.
    """

    def __init__(self, model: Model, strains: ReferenceStrains | None, plane: Any = None) -> None:
        core = model if plane is None else plane.model
        self._core, self._plane, self._dofs = core, plane, SPACE if plane is None else PLANE
        self._strains = core.reference_strains if strains is None else strains.of(core)
        self._tables = core.sets_of_elements(static=True)
        self._scratch, self._lanes, self._work = scratch_of(core), aligned_empty(8 * (kernels.IN_LANES + 1)), empty(1)
        axes = np.eye(3) if plane is None else plane.axes[:2]
        self._loads = model.gravity_weight, axes @ model.gravity, (model.constant_load @ axes.T).reshape(-1)

    def of(self, q: Array, v: Array) -> Array:
        """Return the sums of states [m, SUMS], rows of coordinates and their rates."""
        core, out = self._core, np.zeros((len(q), kernels.SUMS))
        for tables, kind in self._tables:
            kernels.add_elements(tables, kind, self._strains, core.n_nodes, q, v, self._scratch, self._lanes, out, self._dofs)
        if core.bodies is not None:
            kernels.add_bodies(core.bodies, q, v, out, self._dofs)
        kernels.add_loads(*self._loads, q, out, self._dofs)
        if core.links:
            kernels.add_links(core.links, q, self._work, out, self._dofs)
        if self._plane is not None:
            self._expand(out)
        return out

    def _expand(self, out: Array) -> None:
        """Replace momenta in the plane by those in space."""
        axes, height = self._plane.axes, self._plane.height
        linear = out[:, LINEAR].copy()
        # one product after the other: those of matrices round differently for many rows
        out[:, LINEAR] = linear[:, :1] * axes[0] + linear[:, 1:2] * axes[1]
        out[:, ANGULAR] = out[:, kernels.ANGULAR, None] * axes[2]
        if height != 0.0:
            # of the plane about the origin
            out[:, ANGULAR] += height * (linear[:, :1] * axes[1] - linear[:, 1:2] * axes[0])
            out[:, kernels.ANGULAR_SIZE] += abs(height) * out[:, kernels.LINEAR_SIZE]
