"""Rows of moving meshes: energies and momenta of their beams, places and positions of their contacts."""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.kernels.joints.coordinates import LOSS, VALUE, WORK
from fastbeam.kernels.joints.friction import AGAINST
from fastbeam.kernels.state import State
from fastbeam.model.model import Model
from fastbeam.results.readings import ALONG, EXCHANGED

Array = np.ndarray


class MovingMeshSeries:
    """Rows of the contacts of a model with moving meshes; slider, energy: whether rows have sliders, and energies."""

    def __init__(self, model: Model, slider: bool, energy: bool) -> None:
        self.moving, self.slider = model.moving, slider and model.moving is not None
        self.motions, self.place = model.motions, 0 if model.motions is None else model.place("motions")
        # contacts with forces along the beam: their numbers, and those of their coordinates
        names = [] if model.moving is None else model.moving.along
        self.some = np.array([name != "" for name in names], bool).nonzero()[0]
        self.along = np.array([model.motions.names.index(names[k]) for k in self.some.tolist()], np.int64)
        self.energy = energy and self.some.size > 0
        # whether rows hold forces along beams
        self.acts = self.slider and self.some.size > 0
        # coordinates that rest against rigid stops at the newest row
        self._rests = np.zeros(0, bool)

    def series(self) -> dict[str, tuple[int, ...]]:
        """Return the shape of one row of every series."""
        n = 0 if self.moving is None else len(self.moving.names)
        out: dict[str, tuple[int, ...]] = {}
        if self.slider:
            out |= {"s_slide": (n,), "gap": (n,), "slide_rate": (n,), "slider_position": (n, 3)}
        if self.acts:
            out |= dict.fromkeys((x for x in ALONG if x not in EXCHANGED), (n,))
        return out | (dict.fromkeys(EXCHANGED, (n,)) if self.energy else {})

    def row(self, t: float, state: State) -> dict[str, Any]:
        """Return the row of a state at time t; there is no gap, points are nodes of the beam. Forces that are unknowns come
        later."""
        out: dict[str, Any] = {}
        if self.slider:
            q, v, moving = state.q.reshape(-1, 12), state.v.reshape(-1, 12), self.moving
            out |= {"s_slide": q[moving.places, 0].copy(), "gap": np.zeros(len(moving.names)),
                    "slide_rate": v[moving.places, 0].copy(), "slider_position": q[moving.contacts, :3].copy()}
        if self.some.size == 0:
            return out
        own, holds = self.motions.own(state.history, self.place), self.motions.holds
        if self.slider:
            rates = self.motions.rates(state.q.reshape(-1, 4, 3), state.v.reshape(-1, 4, 3))
            out |= {"friction_force": self._of(-self.motions.every.damping * rates),
                    "drive_force": self._of(holds.drive_forces(t, own[:, VALUE], rates)),
                    "stop_force": self._of(holds.stop_forces(own[:, VALUE])), "lock_force": self._of(np.zeros(len(rates)))}
            self._rests = np.zeros(len(rates), bool)
            self._rests[holds.rubs] = holds.numbers(state.history)[:, AGAINST] != 0.0
        if self.energy:
            none = np.zeros(len(own))
            found = holds.exchanged(state.history)
            out |= {"friction_loss": self._of(own[:, LOSS] + found.get("joint_friction", none)),
                    "drive_work": self._of(own[:, WORK]), "stop_energy": self._of(self.motions.energy(own)),
                    "stop_loss": self._of(found.get("joint_stop_loss", none)), "lock_loss": self._of(none)}
        return out

    def add_forces(self, row: dict[str, Any], found: Array) -> None:
        """Add forces of friction, of prescribed motions and of rigid stops to the newest row; found: forces of coordinates that
        are unknowns, in the order of `Holds.held`. Against a stop friction counts as a part of its force."""
        holds = self.motions.holds
        given, rubs = np.zeros(len(holds.parts)), np.zeros(len(holds.parts))
        given[holds.given], rubs[holds.rubs] = np.split(found, [holds.given.size])
        row["drive_force"] = row["drive_force"] + self._of(given)
        row["friction_force"] = row["friction_force"] + self._of(np.where(self._rests, 0.0, rubs))
        row["stop_force"] = row["stop_force"] + self._of(np.where(self._rests, rubs, 0.0))
        row["force_along"] = row["friction_force"] + row["drive_force"] + row["stop_force"]

    def _of(self, x: Array) -> Array:
        """Return values of contacts from values of all coordinates."""
        out = np.zeros(len(self.moving.names))
        out[self.some] = x[self.along]
        return out

    def named(self, names: dict[str, list[Any]]) -> dict[str, list[Any]]:
        """Return names with those of the sliders."""
        if not self.slider and not self.energy:
            return names
        return {**names, "sliders": list(self.moving.names), "moving_meshes": [1], "moving_moments": list(self.moving.moments)}


def moving_weight(model: Model, q: Array) -> float:
    """Return the energy of all moving beams in the gravity of the scene, J."""
    total = 0.0
    for table in model.moving.tables:
        values, weight = table.mass_shape[0], table.mass_point[1]
        for e, nodes in enumerate(table.node):
            s = [0.0, float(table.length[0])]
            for side, k in enumerate(table.slot[e]):
                s[side] = float(q[12 * table.places[k]]) if k >= 0 else s[side]
            h = (table.share[e, 1] - table.share[e, 0]) * (s[1] - s[0])
            total -= h * float(weight @ (values @ (q.reshape(-1, 12)[nodes, :3] @ table.weighs)))
    return total


def place_rows(model: Model) -> Array:
    """Return rows of the places of contacts, and of the begin of their line, which are no positions in space."""
    moving = model.moving
    return model.pattern.row_of[np.zeros(0, np.int64) if moving is None else np.concatenate((moving.line, moving.places))]
