"""Impacts of sliders and joints on rigid stops, theory.md 5.6."""
from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from fastbeam.dynamics.velocity_jumps import blow, jump, of_momenta, settled, with_momenta
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.contact.slider_forces import AGAINST, HISTORY, SIGN, STICKS, STOP_LOSS
from fastbeam.kernels.joints import friction as joint_friction
from fastbeam.kernels.state import State
from fastbeam.model.gap_rows import GapRows
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

    Parameters
    ----------
    model : Model
        Model with tables in space.
    times : float64 [S + R, 2], optional
        Times of an earlier run.

    Attributes
    ----------
    times : float64 [S + R, 2] or None
        Times of the last impact of every slider, or way between contacts of moving meshes, and every coordinate of a joint that
        may stick, at the start and the end, s; NEVER where there was none. None where nothing has rigid stops.
    number : int
        Number of impacts in this run.
    dulled : float
        Kinetic energy that the last impact dissipated because it came within a step of the one before, so that it did not
        bounce, as a share of the largest kinetic energy before an impact; `largest`: twice that, J.
    in_a_row : int
        Steps shortened before a stop since the last whole step, or since one that led to a stop.

    Raises
    ------
    SceneError
        There are not as many times as the model needs.
    """

    def __init__(self, model: Model, times: Array | None = None) -> None:
        self.model, self.number, self.in_a_row = model, 0, 0
        self.dulled = self.largest = 0.0
        self.times: Array | None = None
        # coordinates of joints that have met stops at this instant, one after the other, and on which side
        self.together: dict[int, float] = {}
        forces, motions = model.slider_forces, model.motions
        self.first = before_joints(model)
        self.count = self.first + (0 if motions is None else motions.holds.rubs.size)
        of_sliders = forces is not None and bool(np.any(forces.restitutions >= 0.0))
        if not of_sliders and (motions is None or not motions.holds.has_rigid_stops):
            return
        self.times = np.full((self.count, 2), NEVER) if times is None else np.array(times, dtype=float)
        if self.times.shape != (self.count, 2):
            raise SceneError(f"start: the checkpoint has impact times of shape {self.times.shape}, but scene "
                             f"{model.scene_name!r} needs {(self.count, 2)}; use a checkpoint of this model")

    def is_rigid(self, state: State, k: int, at_end: bool) -> bool:
        """Return whether slider k, or behind the sliders a coordinate of a joint, has a rigid stop at this end."""
        return self.times is not None and self._restitution(state, k, at_end) is not None

    def _restitution(self, state: State, k: int, at_end: bool) -> float | None:
        if k >= self.first:
            return self.model.motions.holds.restitution(k - self.first, at_end)
        if self.model.slider_forces is None:
            return None
        return self.model.slider_forces.restitution(k, at_end, float(state.s[k]), self.model.along_of(state.history)[k])

    def may_go_on(self, moved: bool) -> bool:
        """Count a step that ends at a stop; return whether the run still advances. moved: whether a step has led to a stop
        now."""
        self.in_a_row = 0 if moved else self.in_a_row + 1
        return self.in_a_row <= MOST_IN_A_ROW + 2 * self.count

    def behind(self, state: State, k: int, at_end: bool, t: float, step: float, last: float) -> State:
        """Return the state after an impact of slider or coordinate k at time t, and remember the impact; last: time since the one
        before, or the row. Of two within a step the second does not bounce, one behind a whole step at the stop included."""
        assert self.times is not None
        restitution = given = self._restitution(state, k, at_end) or 0.0
        if t - self.times[k, int(at_end)] < (1.0 + SAME_TIME) * step:
            restitution = 0.0
        self.times[k, int(at_end)] = t
        self.number += 1
        if last > 0.0:
            self.together.clear()
        if k >= self.first:
            self.together[k - self.first] = 1.0 if at_end else -1.0
            after = strike_joint(self.model, state, k - self.first, at_end, restitution, self.together)
        else:
            after = strike(self.model, state, k, at_end, restitution)
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


def before_joints(model: Model) -> int:
    """Return the number of sliders, or of ways between contacts of moving meshes, that stand before coordinates of joints
    (bounds.py)."""
    return model.n_sliders if model.moving is None else int(model.moving.gaps(model.q0.reshape(-1))[0].size)


def strike_joint(model: Model, state: State, i: int, at_end: bool, restitution: float,
                 together: dict[int, float] | None = None) -> State:
    """Return the state after coordinate i of those of joints that may stick has met a rigid stop; as `strike`. Where it does not
    bounce it comes to rest, with those that met stops at the same instant, `together`, and on which side."""
    holds = model.motions.holds
    start = of_momenta(model, state)
    free, before = settled(model, start, -1 - i)
    rows = GapRows(model)
    row = rows.at(state.q, state.s).rates[rows.coordinates[i]]
    rate = float((row @ free.v)[0])
    bounces = restitution * rate * (1.0 if at_end else -1.0) > 0.0
    rest = {} if bounces else {**(together or {}), i: 1.0 if at_end else -1.0}
    after, loss = jump(model, free, -1 - i, row[:int(bounces)], np.full(int(bounces), -(1.0 + restitution) * rate), rest)
    own = holds.numbers(after.history)
    own[i, joint_friction.STOP_LOSS] += before + loss
    if bounces:
        own[i, joint_friction.SIGN], own[i, joint_friction.STICKS] = -np.sign(rate), 0.0
    return with_momenta(model, state, start, after)


def strike(model: Model, state: State, k: int, at_end: bool, restitution: float) -> State:
    """Return the state after slider k has met a rigid stop.

    The velocity of k along its beam is -restitution times the one before, see `jump`, or zero where that leads away from the stop
    already. The energy that is lost goes to the history of the slider.

    Parameters
    ----------
    model : Model
        Model with tables in space.
    state : State
        State with sliding points on their curves.
    k : int
    at_end : bool
        Whether the stop is the one towards the end of the beam.
    restitution : float
    """
    side, gaps = 1.0 if at_end else -1.0, GapRows(model).at(state.q, state.s)

    def change(begin: State) -> Array:
        rate = gaps.along(k, begin.v)
        return -(1.0 + restitution * (side * rate > 0.0)) * rate * gaps.tangents[k]

    begin, after, loss = blow(model, state, k, np.eye(3), change)
    rate = gaps.along(k, begin.v)
    own = model.own(after.history, "slider_forces").reshape(-1, HISTORY)
    own[k, STOP_LOSS] += loss
    own[k, SIGN] = -np.sign(rate)
    if rate != 0.0:
        own[k, STICKS] = 0.0
    if not restitution * side * rate > 0.0:
        own[k, SIGN], own[k, AGAINST] = 0.0, side
    return after
