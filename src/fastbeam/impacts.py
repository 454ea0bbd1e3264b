"""Impacts of sliders and joints on rigid stops, and of what supports catch: velocities that jump, theory.md 5.6."""
from __future__ import annotations

from typing import Any

import numpy as np

from .errors import SceneError
from .coordinates import Coordinate
from .kernels import joint_friction
from .kernels.along import (AGAINST, DRIVE_WORK, FREE, HELD, HISTORY, INCREMENT, LOCKED, OFF, POSITION, SIGN, STICKS,
                            STOP_LOSS)
from .kernels.joint_coordinates import VALUE
from .kernels.work import State
from .maps import free_unknowns, gap_rates, mass_map, share_map, tie_map, velocity_map
from .mapping import contact
from .model import Model
from .multipliers import gap_matrix
from .nearest import nearest_by
from .starting import direction_rates

Array = np.ndarray
# time of an impact where there was none, s
NEVER = -float(np.finfo(float).max)
# what happens within this share of a step happens at the same time
SAME_TIME = 1e-5
# steps in a row that end at or before a stop without getting anywhere, besides two for every slider
MOST_IN_A_ROW = 3
# rates below this share of the largest are none behind an impact
MOVES = 1e-9
# a coordinate of a joint stands at a stop within this share of a large value
AT_STOP = 1e-9
# changes of what rests at stops behind an impact
MOST_PIVOTS = 200


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
        Of the last impact of every slider, or way between contacts of moving meshes, and every coordinate of a joint that may
        stick, at the start and the end, s; NEVER where there was none. None where nothing has rigid stops.
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
            raise SceneError(f"start: the checkpoint holds times of impacts of shape {self.times.shape}, scene "
                             f"{model.scene_name!r} needs {(self.count, 2)}; take a checkpoint of this model")

    def is_rigid(self, state: State, k: int, at_end: bool) -> bool:
        """Whether slider k, or behind the sliders a coordinate of a joint, has a rigid stop there."""
        return self.times is not None and self._restitution(state, k, at_end) is not None

    def _restitution(self, state: State, k: int, at_end: bool) -> float | None:
        if k >= self.first:
            return self.model.motions.holds.restitution(k - self.first, at_end)
        if self.model.slider_forces is None:
            return None
        return self.model.slider_forces.restitution(k, at_end, float(state.s[k]), self.model.along_of(state.history)[k])

    def may_go_on(self, moved: bool) -> bool:
        """Whether a run gets anywhere; moved: whether a step has led to a stop now."""
        self.in_a_row = 0 if moved else self.in_a_row + 1
        return self.in_a_row <= MOST_IN_A_ROW + 2 * self.count

    def behind(self, state: State, k: int, at_end: bool, t: float, step: float, last: float) -> State:
        """The state after an impact of slider or coordinate k at time t, which is remembered; last: time since the one before, or
        the row. Of two within a step the second does not bounce, one behind a whole step at the stop included."""
        assert self.times is not None
        restitution = self._restitution(state, k, at_end) or 0.0
        if t - self.times[k, int(at_end)] < (1.0 + SAME_TIME) * step:
            restitution = 0.0
        self.times[k, int(at_end)] = t
        self.number += 1
        if last > 0.0:
            self.together.clear()
        if k >= self.first:
            self.together[k - self.first] = 1.0 if at_end else -1.0
            return strike_joint(self.model, state, k - self.first, at_end, restitution, self.together)
        return strike(self.model, state, k, at_end, restitution)


def before_joints(model: Model) -> int:
    """Number of sliders, or of ways between contacts of moving meshes: what ends bound before coordinates of joints (ways.py)."""
    return model.n_sliders if model.moving is None else int(model.moving.gaps(model.q0.reshape(-1))[0].size)


def values_of(model: Model, state: State) -> Array:
    """Values of the coordinates of joints that may stick, as the history has them, m or rad, [R]."""
    motions = model.motions
    if motions is None:
        return np.zeros(0)
    return motions.own(state.history, model.motion_place)[motions.holds.rubs, VALUE]


def strike_joint(model: Model, state: State, i: int, at_end: bool, restitution: float,
                 together: dict[int, float] | None = None) -> State:
    """The state after coordinate i of those of joints that may stick has met a rigid stop; as `strike`. Where it does not bounce
    it comes to rest, with those that met stops at the same instant, `together`, and on which side."""
    holds = model.motions.holds
    row = gap_matrix([holds.link(model.kept, i)], state.q.reshape(-1, 4, 3))
    rate = float((row @ state.v)[0])
    bounces = restitution * rate * (1.0 if at_end else -1.0) > 0.0
    rest = {} if bounces else {**(together or {}), i: 1.0 if at_end else -1.0}
    after, loss = jump(model, state, -1 - i, row[:int(bounces)], np.full(int(bounces), -(1.0 + restitution) * rate), rest)
    own = holds.numbers(after.history)
    own[i, joint_friction.STOP_LOSS] += loss
    if bounces:
        own[i, joint_friction.SIGN], own[i, joint_friction.STICKS] = -np.sign(rate), 0.0
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


def jump(model: Model, state: State, k: int | None, lead: Any, change: Array,
         rest: dict[int, float] | None = None) -> tuple[State, float]:
    """The state after an impact at slider k, and the energy that it took, J.

    Of all jumps of velocities that connections, supports, sliders and joints allow, the one of least kinetic energy with which
    the velocity of the point of k relative to its curve changes by `change` in the directions `lead`: the impulse of that contact
    alone. Sliders whose motion is prescribed, that are locked or at rest against a stop keep their velocities along the beam;
    impulses of drives that prescribe a motion do work, which counts as theirs. Joints that stand at a stop are at rest behind it
    where that takes an impulse that pushes, and leave it else.

    Parameters
    ----------
    k : int or None
        Of a slider; -1 - i: of coordinate i of joints that may stick; None: of a support.
    lead : float64 [m, 3], of a joint sparse [1, 12 N]; [0, 12 N] of one that does not bounce; of a support sparse [m, 12 N]
    change : float64 [m]
        m/s, of joints and supports m/s or rad/s.
    rest : dict, optional
        Coordinates of joints that come to rest at stops, and on which side.
    """
    from scipy import sparse
    history = state.history.copy()
    own = history[:model.work_place].reshape(-1, HISTORY)
    matrix, tangents, _ = gap_rates(model, state)
    given = driven = np.zeros(0, bool)
    if model.slider_forces is not None:
        driven = np.isin(model.slider_forces.tables.drive, (POSITION, INCREMENT))
        given = driven | (own[:, AGAINST] != 0.0) | (own[:, HELD] == LOCKED)
    slides, bounces = k is not None and k >= 0, -1
    if k is not None and k < 0 and change.size:
        bounces = -1 - k
    rows: list[Any] = [] if slides else [lead]
    right: list[Array] = [] if slides else [change]
    # where the equations of sliders begin whose drives prescribe a motion
    drives: dict[int, int] = {}
    for j, tangent in enumerate(tangents):
        if model.slider_forces is None:
            rows.append(sparse.csr_matrix(np.linalg.svd(tangent[None])[2][1:]) @ matrix[3 * j:3 * j + 3])
            right.append(np.zeros(2))
            continue
        if j != k and own[j, HELD] == OFF:
            continue
        leads = lead if j == k else np.eye(3) if given[j] else np.linalg.svd(tangent[None])[2][1:]
        if driven[j] and j != k and own[j, HELD] == FREE and own[j, AGAINST] == 0.0:
            drives[j] = sum(x.size for x in right)
        rows.append(sparse.csr_matrix(leads) @ matrix[3 * j:3 * j + 3])
        right.append(change if j == k else np.zeros(len(leads)))
    of_joints = matrix[3 * len(tangents):]
    for others in (of_joints, *direction_rates(model, state.q.reshape(-1, 4, 3), state.s)[0]):
        rows.append(others)
        right.append(_against_gaps(model, others, state) if not slides and others is of_joints else np.zeros(others.shape[0]))
    free = free_unknowns(model, state)
    lift = (tie_map(model) @ velocity_map(state.q.reshape(-1, 4, 3)) @ share_map(model)).tocsc()[:, free]
    inertia = mass_map(model)
    momentum = inertia @ state.v
    if model.moving is not None:
        inertia = inertia + model.moving.inertia(state.q)
        momentum += model.moving.momentum(history, state.q)
    mass = (lift.T @ inertia @ lift).tocsr()

    # every jump that was tried, with its impulses
    tried: list[tuple[Array, Array]] = []

    def least(more: list[Any], goals: list[float]) -> Array:
        """The jump with changes of more rates."""
        every = (sparse.vstack([*rows, *more]) @ lift).tocsr()
        goal = np.concatenate([*right, goals])
        x, impulses = nearest_by(mass, every, goal, np.zeros(free.size), free % 6 >= 3)
        tried.append((np.asarray(lift @ x), impulses))
        return tried[-1][0]

    if bounces >= 0 and model.moving is not None:
        # energy is that of the momenta, of which velocities differ to second order: so is the impulse
        every, right = right, [np.ones(1), *(np.zeros(x.size) for x in right[1:])]
        unit = least([], [])
        right = [change * float(unit @ momentum) / float(unit @ (inertia @ unit)) / float((lead @ state.v)[0]), *every[1:]]
    by = _with_stops(model, state, history, bounces, rest or {}, least)
    put_in = 0.0
    if drives:
        impulses = next(x for way, x in tried if way is by)
        for j, at in drives.items():
            work = float(impulses[at:at + 3] @ (matrix[3 * j:3 * j + 3] @ state.v))
            own[j, DRIVE_WORK] += work
            put_in += work
    v = state.v + by
    if model.slider_forces is not None:
        after = np.array([float((matrix[3 * j:3 * j + 3] @ v) @ x / (x @ x)) for j, x in enumerate(tangents)])
        moves = ~given & (own[:, HELD] == FREE) & (np.abs(after) > MOVES * np.max(np.abs(v)))
        if slides:
            moves[k] = False
        own[moves, SIGN] = np.sign(after[moves])
        own[moves, STICKS] = 0.0
    if model.moving is not None:
        model.moving.put_blow(history, state.q, by)
    loss = put_in - float(by @ (momentum + 0.5 * inertia @ by))
    return State(state.q.copy(), v, state.s.copy(), state.force.copy(), history), loss


def _against_gaps(model: Model, rows: Any, state: State) -> Array:
    """Changes of the rates of gaps of joints that take away what velocities at the end of a step have of them: they are met to
    second order, and a short step after the impact would turn them around with huge forces. Given coordinates keep theirs."""
    out = -np.asarray(rows @ state.v)
    at = 0
    for link in (x for x in model.kept if x.law.holds):
        m = link.forces(3)
        if isinstance(link.law, Coordinate):
            out[at:at + m] = 0.0
        at += m
    return out


def _with_stops(model: Model, state: State, history: Array, bounces: int, rest: dict[int, float], least: Any) -> Array:
    """The jump of all coordinates [12 N] beside joints at stops, which push only; bounces: the coordinate that does, or -1;
    rest: as of `jump`; `least` gives it for rows and changes of their rates. Which of them rest behind it, and signs of the
    velocities of others that rub, go to the history.

    Rates into stops are zero, impulses push, and one of both is zero (a linear complementarity problem): Murty's least index
    method, which ends for every inertia."""
    if model.motions is None or not model.motions.holds.rubs.size:
        return np.asarray(least([], []))
    holds = model.motions.holds
    own = holds.numbers(history)
    rows = [gap_matrix([holds.link(model.kept, i)], state.q.reshape(-1, 4, 3)) for i in range(len(own))]
    rates = np.array([float((row @ state.v)[0]) for row in rows])
    off = values_of(model, state)[:, None] - holds.ends
    near = np.abs(off) <= AT_STOP * holds.scales[:, None]
    side = np.where(near[:, 1], 1.0, np.where(near[:, 0], -1.0, 0.0))
    rests = own[:, joint_friction.AGAINST] != 0.0
    side[rests] = own[rests, joint_friction.AGAINST]
    for i, of in rest.items():
        side[i] = of
    if bounces >= 0:
        side[bounces] = 0.0
    at_stop = np.flatnonzero(side).tolist()
    active = [i for i in at_stop if rests[i] or i in rest or side[i] * rates[i] > 0.0]

    def jump_with(some: list[int]) -> tuple[Array, Array, float]:
        """With these at rest: the jump, rates into stops behind it, and what counts as none."""
        by = np.asarray(least([rows[i] for i in some], [-rates[i] for i in some]))
        found = state.v + by
        into = np.array([side[i] * float((rows[i] @ found)[0]) for i in at_stop])
        return by, into, MOVES * float(np.max(np.abs(found), initial=0.0))

    for _ in range(MOST_PIVOTS):
        by, into, none = jump_with(active)
        for n, i in enumerate(at_stop):
            if i in rest:
                continue
            if i in active:
                # without the stop it would leave it: its impulse pulls
                others = [j for j in active if j != i]
                _, alone, none = jump_with(others)
                if alone[n] < -none:
                    active = others
                    break
            elif into[n] > none:
                active = sorted([*active, i])
                break
        else:
            break
    found = state.v + by
    for i in range(len(own)):
        rate = float((rows[i] @ found)[0])
        if i in active:
            own[i, [joint_friction.SIGN, joint_friction.STICKS, joint_friction.AGAINST]] = 0.0, 0.0, side[i]
        elif side[i] != 0.0 or abs(rate) > MOVES * float(np.max(np.abs(found))):
            own[i, [joint_friction.SIGN, joint_friction.STICKS, joint_friction.AGAINST]] = np.sign(rate), 0.0, 0.0
    return by
