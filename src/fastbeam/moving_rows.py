"""Rows of moving meshes: energies and momenta of their beams, places and positions of their contacts."""
from __future__ import annotations

from typing import Any

import numpy as np

from .errors import SceneError
from .kernels.moving_mesh import momentum_sums, motion_of
from .kernels.work import State
from .model import Model

Array = np.ndarray


class MeshRows:
    """What rows hold of contacts; moving: of the model, or None where none is asked for."""

    def __init__(self, moving: Any) -> None:
        self.moving = moving

    def series(self) -> dict[str, tuple[int, ...]]:
        """Shape of one row of every series."""
        if self.moving is None:
            return {}
        n = len(self.moving.names)
        return {"s_slide": (n,), "gap": (n,), "slide_rate": (n,), "slider_position": (n, 3)}

    def row(self, state: State) -> dict[str, Any]:
        """Of a state; there is no gap, points are nodes of the beam."""
        if self.moving is None:
            return {}
        q, v, moving = state.q.reshape(-1, 12), state.v.reshape(-1, 12), self.moving
        return {"s_slide": q[moving.places, 0].copy(), "gap": np.zeros(len(moving.names)),
                "slide_rate": v[moving.places, 0].copy(), "slider_position": q[moving.contacts, :3].copy()}

    def named(self, names: dict[str, list[Any]]) -> dict[str, list[Any]]:
        """With the sliders."""
        if self.moving is None:
            return names
        return {**names, "sliders": list(self.moving.names), "moving_meshes": [1], "moving_moments": list(self.moving.moments)}


def add_moving(model: Model, state: State, out: Array) -> None:
    """Kinetic energy and momenta of all moving beams, as `observe.motion` puts them."""
    if model.moving is None:
        return
    p = np.zeros_like(state.q)
    for table in model.moving.tables:
        out[0] += motion_of(table, state.q, state.history, p)
    momentum_sums(state.q, p, out)


def moving_weight(model: Model, q: Array) -> float:
    """Energy of all moving beams in the gravity of the scene, J."""
    total = 0.0
    for table in () if model.moving is None else model.moving.tables:
        values, weight = table.mass_shape[0], table.mass_point[1]
        for e, nodes in enumerate(table.node):
            s = [0.0, float(table.length[0])]
            for side, k in enumerate(table.slot[e]):
                s[side] = float(q[12 * table.places[k]]) if k >= 0 else s[side]
            h = (table.share[e, 1] - table.share[e, 0]) * (s[1] - s[0])
            total -= h * float(weight @ (values @ (q.reshape(-1, 12)[nodes, :3] @ table.weighs)))
    return total


def place_rows(model: Model) -> Array:
    """Rows of the places of contacts, which are no positions in space."""
    return np.zeros(0, np.int64) if model.moving is None else np.concatenate([table.place_rows for table in model.moving.tables])


def refuse_point(model: Model, name: str, owner: Any) -> None:
    """Refuse a material point of a beam whose elements move.

    Raises
    ------
    SceneError
        Names the point.
    """
    for table in () if model.moving is None else model.moving.tables:
        if model.numbers.first.get(id(owner)) == int(table.place[1]):
            raise SceneError(f"point {name!r}: the elements of {owner.label} move, and no node stays at a material point inside; "
                             "observe its start or end, or what slides on it")
