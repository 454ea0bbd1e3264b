"""Impacts of sliders and joints on rigid stops: velocities that jump, theory.md 5.6."""
from __future__ import annotations

from typing import Any

import numpy as np

from .errors import SceneError
from .kernels import joint_friction
from .kernels.along import (AGAINST, FREE, HELD, HISTORY, INCREMENT, LOCKED, OFF, POSITION, SIGN, STICKS, STOP_LOSS)
from .kernels.joint_motion import VALUE
from .kernels.work import State
from .maps import free_unknowns, gap_rates, mass_map, share_map, tie_map, velocity_map
from .mapping import contact
from .model import Model
from .multipliers import gap_matrix
from .nearest import nearest
from .starting import direction_rates

Array = np.ndarray
# time of an impact where there was none, s
NEVER = -float(np.finfo(float).max)
# steps in a row that end at or before a stop without getting anywhere, besides two for every slider
MOST_IN_A_ROW = 3
# rates below this share of the largest are none behind an impact
MOVES = 1e-9


class Impacts:
    """What a run remembers of impacts on rigid stops.

    Parameters
    ----------
    model : Model
        With tables in space.
    times : float64 [S + R, 2], optional
        Of a run before.

    Attributes
    ----------
    times : float64 [S + R, 2] or None
        Of the last impact of every slider, and every coordinate of a joint that may stick, at the start and the end, s; NEVER
        where there was none. None where nothing has rigid stops.
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
        forces, motions = model.slider_forces, model.motions
        self.count = model.n_sliders + (0 if motions is None else motions.holds.rubs.size)
        of_sliders = forces is not None and bool(np.any(forces.restitutions >= 0.0))
        if not of_sliders and (motions is None or not motions.holds.has_rigid_stops):
            return
        self.times = np.full((self.count, 2), NEVER) if times is None else np.array(times, dtype=float)
        if self.times.shape != (self.count, 2):
            raise SceneError(f"start: the checkpoint holds times of impacts of shape {self.times.shape}, scene "
                             f"{model.scene_name!r} needs {(self.count, 2)}; take a checkpoint of this model")

    def is_rigid(self, k: int, at_end: bool) -> bool:
        """Whether slider k, or behind the sliders a coordinate of a joint, has a rigid stop there."""
        return self.times is not None and self._restitution(k, at_end) is not None

    def _restitution(self, k: int, at_end: bool) -> float | None:
        if k >= self.model.n_sliders:
            return self.model.motions.holds.restitution(k - self.model.n_sliders, at_end)
        return None if self.model.slider_forces is None else self.model.slider_forces.restitution(k, at_end)

    def may_go_on(self, moved: bool) -> bool:
        """Whether a run gets anywhere; moved: whether a step has led to a stop now."""
        self.in_a_row = 0 if moved else self.in_a_row + 1
        return self.in_a_row <= MOST_IN_A_ROW + 2 * self.count

    def behind(self, state: State, k: int, at_end: bool, t: float, step: float) -> State:
        """The state after an impact of slider or coordinate k at time t, which is remembered. Of two within a step the second
        does not bounce."""
        assert self.times is not None
        restitution = self._restitution(k, at_end) or 0.0
        if t - self.times[k, int(at_end)] < step:
            restitution = 0.0
        self.times[k, int(at_end)] = t
        self.number += 1
        if k >= self.model.n_sliders:
            return strike_joint(self.model, state, k - self.model.n_sliders, at_end, restitution)
        return strike(self.model, state, k, at_end, restitution)


def values_of(model: Model, state: State) -> Array:
    """Values of the coordinates of joints that may stick, as the history has them, m or rad, [R]."""
    motions = model.motions
    if motions is None:
        return np.zeros(0)
    return motions.own(state.history, model.motion_place)[motions.holds.rubs, VALUE]


def strike_joint(model: Model, state: State, i: int, at_end: bool, restitution: float) -> State:
    """The state after coordinate i of those of joints that may stick has met a rigid stop; as `strike`."""
    holds = model.motions.holds
    row = gap_matrix([holds.link(model.kept, i)], state.q.reshape(-1, 4, 3))
    rate = float((row @ state.v)[0])
    after, loss = jump(model, state, -1 - i, row, np.array([-(1.0 + restitution) * rate]))
    own = holds.numbers(after.history)
    own[i, joint_friction.STOP_LOSS] += loss
    own[i, joint_friction.SIGN] = -np.sign(rate)
    own[i, joint_friction.STICKS] = 0.0
    if restitution * abs(rate) == 0.0:
        own[i, joint_friction.SIGN], own[i, joint_friction.AGAINST] = 0.0, 1.0 if at_end else -1.0
    return after


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


def jump(model: Model, state: State, k: int, lead: Any, change: Array) -> tuple[State, float]:
    """The state after an impact at slider k, and the energy that it took, J.

    Of all jumps of velocities that connections, supports, sliders and joints allow, the one of least kinetic energy with which
    the velocity of the point of k relative to its curve changes by `change` in the directions `lead`: the impulse of that contact
    alone. Sliders whose motion is prescribed, that are locked or at rest against a stop keep their velocities along the beam.
    Joints at rest against a stop keep theirs where that takes an impulse that pushes, and leave it else.

    Parameters
    ----------
    k : int
        Of a slider; -1 - i: of coordinate i of joints that may stick.
    lead : float64 [m, 3], of a joint sparse [1, 12 N]
    change : float64 [m]
        m/s, of a joint m/s or rad/s.
    """
    from scipy import sparse
    history = state.history.copy()
    own = history[:model.work_place].reshape(-1, HISTORY)
    matrix, tangents, _ = gap_rates(model, state)
    given = np.zeros(0, bool)
    if model.slider_forces is not None:
        drive = model.slider_forces.tables.drive
        given = np.isin(drive, (POSITION, INCREMENT)) | (own[:, AGAINST] != 0.0) | (own[:, HELD] == LOCKED)
    rows: list[Any] = [] if k >= 0 else [lead]
    right: list[Array] = [] if k >= 0 else [change]
    for j, tangent in enumerate(tangents):
        if model.slider_forces is None:
            rows.append(sparse.csr_matrix(np.linalg.svd(tangent[None])[2][1:]) @ matrix[3 * j:3 * j + 3])
            right.append(np.zeros(2))
            continue
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

    def least(more: list[Any]) -> Array:
        """The jump with more rows that stay."""
        every = (sparse.vstack([*rows, *more]) @ lift).tocsr()
        goal = np.concatenate([*right, np.zeros(len(more))])
        return np.asarray(lift @ nearest(mass, every, goal, np.zeros(free.size), free % 6 >= 3))

    by = _beside_stops(model, state, history, k, least)
    found = state.v + by
    if model.slider_forces is not None:
        after = np.array([float((matrix[3 * j:3 * j + 3] @ found) @ x / (x @ x)) for j, x in enumerate(tangents)])
        moves = ~given & (own[:, HELD] == FREE) & (np.abs(after) > MOVES * np.max(np.abs(found))) & (np.arange(after.size) != k)
        own[moves, SIGN] = np.sign(after[moves])
        own[moves, STICKS] = 0.0
    return (State(state.q.copy(), found, state.s.copy(), state.force.copy(), history),
            -float(by @ (inertia @ (state.v + 0.5 * by))))


def _beside_stops(model: Model, state: State, history: Array, k: int, least: Any) -> Array:
    """The jump of all coordinates [12 N], with joints that rest against stops: `least` gives it for rows that stay. Signs of the
    velocities of those that rub go to the history."""
    if model.motions is None or not model.motions.holds.rubs.size:
        return np.asarray(least([]))
    holds, q = model.motions.holds, state.q.reshape(-1, 4, 3)
    own = holds.numbers(history)
    rows = [gap_matrix([holds.link(model.kept, i)], q) for i in range(len(own))]
    resting = [i for i in range(len(own)) if own[i, joint_friction.AGAINST] != 0.0 and i != -1 - k]
    while True:
        by = np.asarray(least([rows[i] for i in resting]))
        for i in resting:
            # without it the coordinate would go on into its stop, or leave it
            alone = least([rows[j] for j in resting if j != i])
            if own[i, joint_friction.AGAINST] * float((rows[i] @ alone)[0]) < -MOVES * float(np.max(np.abs(alone), initial=0.0)):
                resting.remove(i)
                own[i, joint_friction.AGAINST] = 0.0
                break
        else:
            break
    found = state.v + by
    for i in range(len(own)):
        rate = float((rows[i] @ found)[0])
        if i != -1 - k and i not in resting and abs(rate) > MOVES * float(np.max(np.abs(found))):
            own[i, joint_friction.SIGN], own[i, joint_friction.STICKS] = np.sign(rate), 0.0
    return by
