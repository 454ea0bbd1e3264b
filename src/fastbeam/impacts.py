"""Impacts of sliders on rigid stops: velocities that jump, theory.md 5.6."""
from __future__ import annotations

from typing import Any

import numpy as np

from .errors import SceneError
from .kernels.along import (AGAINST, FREE, HELD, HISTORY, INCREMENT, LOCKED, OFF, POSITION, SIGN, STICKS, STOP_LOSS)
from .kernels.work import State
from .maps import free_unknowns, gap_rates, mass_map, share_map, tie_map, velocity_map
from .mapping import contact
from .model import Model
from .nearest import nearest
from .starting import direction_rates

Array = np.ndarray
# time of an impact where there was none, s
NEVER = -float(np.finfo(float).max)
# steps in a row that end at or before a stop without getting anywhere, besides two for every slider
MOST_IN_A_ROW = 3


class Impacts:
    """What a run remembers of impacts on rigid stops.

    Parameters
    ----------
    model : Model
        With tables in space.
    times : float64 [S, 2], optional
        Of a run before.

    Attributes
    ----------
    times : float64 [S, 2] or None
        Of the last impact of every slider at the start and the end, s; NEVER where there was none. None where no slider has rigid
        stops.
    number : int
        Of impacts in this run.
    in_a_row : int
        Steps shortened before a stop since the last whole step, or since one that led to a stop.

    Raises
    ------
    SceneError
        There are not as many times as the model needs.
    """

    def __init__(self, model: Model, times: Array | None = None) -> None:
        self.model, self.number, self.in_a_row = model, 0, 0
        self.times: Array | None = None
        forces = model.slider_forces
        if forces is None or not np.any(forces.restitutions >= 0.0):
            return
        self.times = np.full((model.n_sliders, 2), NEVER) if times is None else np.array(times, dtype=float)
        if self.times.shape != (model.n_sliders, 2):
            raise SceneError(f"start: the checkpoint holds times of impacts of shape {self.times.shape}, scene "
                             f"{model.scene_name!r} needs {(model.n_sliders, 2)}; take a checkpoint of this model")

    def is_rigid(self, slider: int, at_end: bool) -> bool:
        """Whether a slider has a rigid stop there."""
        return self.times is not None and self.model.slider_forces.restitution(slider, at_end) is not None

    def may_go_on(self, moved: bool) -> bool:
        """Whether a run gets anywhere; moved: whether a step has led to a stop now."""
        self.in_a_row = 0 if moved else self.in_a_row + 1
        return self.in_a_row <= MOST_IN_A_ROW + 2 * self.model.n_sliders

    def behind(self, state: State, slider: int, at_end: bool, t: float, step: float) -> State:
        """The state after an impact at time t, which is remembered. Of two within a step the second does not bounce."""
        assert self.times is not None
        restitution = self.model.slider_forces.restitution(slider, at_end)
        if t - self.times[slider, int(at_end)] < step:
            restitution = 0.0
        self.times[slider, int(at_end)] = t
        self.number += 1
        return strike(self.model, state, slider, at_end, restitution)


def strike(model: Model, state: State, k: int, at_end: bool, restitution: float) -> State:
    """The state after slider k has met a rigid stop.

    The velocity of k along its beam is -restitution times the one before, see `jump`. The energy that is lost goes to the history
    of the slider.

    Parameters
    ----------
    model : Model
        With tables in space.
    state : State
        With sliding points on their curves.
    k : int
    at_end : bool
        Whether the stop is the one towards the end of the beam.
    restitution : float
    """
    tangent, rate = along(model, state, k)
    after, loss = jump(model, state, k, np.eye(3), -(1.0 + restitution) * rate * tangent)
    own = after.history[:model.work_place].reshape(-1, HISTORY)
    own[k, STOP_LOSS] += loss
    own[k, SIGN] = -np.sign(rate)
    if rate != 0.0:
        own[k, STICKS] = 0.0
    if restitution * abs(rate) == 0.0:
        own[k, SIGN], own[k, AGAINST] = 0.0, 1.0 if at_end else -1.0
    return after


def along(model: Model, state: State, k: int) -> tuple[Array, float]:
    """Derivative by s of the curve under slider k [3], and ds/dt, m/s."""
    _, tangent, relative = contact(model, k, float(state.s[k]), *(x.reshape(-1, 4, 3) for x in (state.q, state.v)))
    return tangent, float(relative @ tangent / (tangent @ tangent))


def jump(model: Model, state: State, k: int, lead: Array, change: Array) -> tuple[State, float]:
    """The state after an impact at slider k, and the energy that it took, J.

    Of all jumps of velocities that connections, supports and sliders allow, the one of least kinetic energy with which the
    velocity of the point of k relative to its curve changes by `change` in the directions `lead`: the impulse of that contact
    alone. Sliders whose motion is prescribed, that are locked or at rest against a stop keep their velocities along the beam.

    Parameters
    ----------
    lead : float64 [m, 3]
    change : float64 [m]
        m/s.
    """
    from scipy import sparse
    history = state.history.copy()
    own = history[:model.work_place].reshape(-1, HISTORY)
    matrix, tangents, _ = gap_rates(model, state)
    given = np.isin(model.slider_forces.tables.drive, (POSITION, INCREMENT)) | (own[:, AGAINST] != 0.0) | (own[:, HELD] == LOCKED)
    rows: list[Any] = []
    right: list[Array] = []
    for j, tangent in enumerate(tangents):
        if j != k and own[j, HELD] == OFF:
            continue
        leads = lead if j == k else np.eye(3) if given[j] else np.linalg.svd(tangent[None])[2][1:]
        rows.append(sparse.csr_matrix(leads) @ matrix[3 * j:3 * j + 3])
        right.append(change if j == k else np.zeros(len(leads)))
    for others in (matrix[3 * len(tangents):], *direction_rates(model, state.q.reshape(-1, 4, 3), state.s)[0]):
        rows.append(others)
        right.append(np.zeros(others.shape[0]))
    free = free_unknowns(model, state)
    lift = (tie_map(model) @ velocity_map(state.q.reshape(-1, 4, 3)) @ share_map(model)).tocsc()[:, free]
    inertia = mass_map(model)
    mass = (lift.T @ inertia @ lift).tocsr()
    by = lift @ nearest(mass, (sparse.vstack(rows) @ lift).tocsr(), np.concatenate(right), np.zeros(free.size), free % 6 >= 3)
    found = state.v + by
    after = np.array([float((matrix[3 * j:3 * j + 3] @ found) @ x / (x @ x)) for j, x in enumerate(tangents)])
    moves = ~given & (own[:, HELD] == FREE) & (np.abs(after) > 1e-9 * np.max(np.abs(found))) & (np.arange(after.size) != k)
    own[moves, SIGN] = np.sign(after[moves])
    own[moves, STICKS] = 0.0
    return (State(state.q.copy(), found, state.s.copy(), state.force.copy(), history),
            -float(by @ (inertia @ (state.v + 0.5 * by))))
