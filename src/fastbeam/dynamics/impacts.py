"""Impacts on rigid stops in a run, theory.md 5.6."""
from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from fastbeam.dynamics.bounds import Bounded
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.state import State
from fastbeam.model.maps import mass_map
from fastbeam.model.model import Model

Array = np.ndarray
# time of an impact where there was none, s
NEVER = -float(np.finfo(float).max)
# events within this share of a step count as simultaneous
SAME_TIME = 1e-5
# steps in a row that end at or before a stop without getting anywhere, besides two for every slider
MOST_IN_A_ROW = 3


class Impacts:
    """Impacts of a run on rigid stops.

    model: Model with tables in space.
    times: float64 [S + R, 2], times of the last impact of every slider, way between contacts of moving meshes, and every
        coordinate of a joint that may stick, at the start and the end, s, at first those of an earlier run; NEVER where there
        was none. None where nothing has rigid stops.
    number: number of impacts in this run.
    dulled: kinetic energy that the last impact dissipated because it came within a step of the one before, so that it did not
        bounce, as a share of the largest kinetic energy before an impact; `largest`: twice that, J.
    in_a_row: steps shortened before a stop since the last whole step, or since one that led to a stop.
    Raises SceneError: there are not as many times as the model needs.
    """

    def __init__(self, model: Model, times: Array | None = None) -> None:
        self.model, self.number, self.in_a_row = model, 0, 0
        self.dulled = self.largest = 0.0
        self.times: Array | None = None
        # coordinates of joints that have met stops at this instant, one after the other, and on which side
        self.together: dict[int, float] = {}
        self.bounded = Bounded(model)
        self.count = self.bounded.scales.size
        if not any(kind.has_rigid_stops for kind in self.bounded.kinds):
            return
        self.times = np.full((self.count, 2), NEVER) if times is None else np.array(times, dtype=float)
        if self.times.shape != (self.count, 2):
            raise SceneError(f"start: the checkpoint has impact times of shape {self.times.shape}, but scene "
                             f"{model.scene_name!r} needs {(self.count, 2)}; use a checkpoint of this model")

    def is_rigid(self, state: State, k: int, at_end: bool) -> bool:
        """Return whether coordinate k of `Bounded` has a rigid stop at this end."""
        kind, i = self.bounded.kind_of(k)
        return self.times is not None and kind.restitution(state, i, at_end) is not None

    def may_go_on(self, moved: bool) -> bool:
        """Count a step that ends at a stop; return whether the run still advances. moved: whether a step has led to a stop
        now."""
        self.in_a_row = 0 if moved else self.in_a_row + 1
        return self.in_a_row <= MOST_IN_A_ROW + 2 * self.count

    def behind(self, state: State, k: int, at_end: bool, t: float, step: float, last: float) -> State:
        """Return the state after an impact of coordinate k at time t, and remember it; last: time since the one before, or
        the row. Of two within a step the second does not bounce, one behind a whole step at the stop included."""
        assert self.times is not None
        kind, i = self.bounded.kind_of(k)
        restitution = given = kind.restitution(state, i, at_end) or 0.0
        if t - self.times[k, int(at_end)] < (1.0 + SAME_TIME) * step:
            restitution = 0.0
        self.times[k, int(at_end)] = t
        self.number += 1
        if last > 0.0:
            self.together.clear()
        if kind.meet_together:
            self.together[i] = 1.0 if at_end else -1.0
        after = kind.strike(state, i, at_end, restitution, self.together)
        self.dulled = 0.0
        if given > restitution and self.model.moving is None:
            before, behind = (float(x.v @ (self._mass @ x.v)) for x in (state, after))
            self.dulled = (before - behind) / max(self.largest, before) if before > 0.0 else 0.0
        elif given > 0.0 and self.model.moving is None:
            self.largest = max(self.largest, float(state.v @ (self._mass @ state.v)))
        return after

    @cached_property
    def _mass(self) -> Any:
        return mass_map(self.model)
