"""Supports that move in statics: where they are at a load factor, and the iteration that takes the scene along (theory.md 8)."""
from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.kernels import loop as kernels
from fastbeam.kernels.call_tables import ADDED, ASSEMBLY, Calls, SystemRecord
from fastbeam.kernels.state import State
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.connections import fixed_axes
from fastbeam.model.mapping import follow, turned
from fastbeam.model.model import Model
from fastbeam.model.moving_supports import turns_between
from fastbeam.scene.prescribed_motion import axial

Array = np.ndarray
# increments of a support up to this share of its coordinates, and of 1 rad, count as round-off
ROUND_OFF = 4.0 * float(np.finfo(float).eps)
# a support turns by less than this at once, rad
LARGEST_TURN = 1.5
# derivatives along motions of supports are differences of this, in sizes of the scene and rad
SHORT = 1e-4
# distance from which a support stands elsewhere, in sizes of the scene and rad
AWAY = 1e-6
# a motion may leave the plane of its scene by so much of its way
OUT_OF_PLANE = 1e-12


class _Moving(ABC):
    """Supports that move with the load factor; `ahead`: further increment of the load factor, to first order, for derivatives by
    it."""

    ahead = 0.0
    model: Model
    own: Array        # int64 [M]: nodes of the supports
    moves: Array      # [M, 6]: rates of displacements and rotation vectors of supports in space by the load factor
    _size: float
    _nodes: Array     # nodes that move, also those in the row of a support
    _of_nodes: Array  # number of the support that each moves with

    @abstractmethod
    def begin(self, share: float) -> None:
        """Count turns from where supports are at this load factor."""

    @abstractmethod
    def _label(self, k: int) -> str:
        """Return the name of support k in messages."""

    def rows(self, given: Array, core: Model, axes: Array | None) -> Array:
        """Return prescribed increments [M, 6] of supports as increments of rows, [rows, unknowns of a node]; axes: of the plane
        of `core`. Raises SceneError: a support leaves the plane."""
        x = np.zeros((core.pattern.n, 6 if axes is None else 3))
        flat = given
        if axes is not None:
            off = _off_plane(given, axes)
            if np.any(off > OUT_OF_PLANE * self._size):
                raise SceneError(f"{self._label(int(np.argmax(off)))}: it leaves the plane of the scene; compile the scene with "
                                 "planar=False")
            flat = np.concatenate((given[:, :3] @ axes[:2].T, given[:, 3:] @ axes[2:].T), axis=1)
        np.add.at(x, core.pattern.row_of[self.own], flat)
        return x

    def moved(self, q: Array, given: Array) -> Array:
        """Return coordinates [12 N] with the supports, and what follows them rigidly, moved by increments `given`: position and
        Cayley vector."""
        out = q.reshape(-1, 4, 3).copy()
        for node, x in zip(self._nodes, given[self._of_nodes]):
            out[node, 0] += x[:3]
            out[node, 1:] = turned(out[node, 1:][None], x[None, 3:])[0]
        return follow(self.model, out).reshape(-1)

    def opened(self, gaps: Callable[[Array], Array], q: Array, given: Array) -> Array:
        """Return gaps (a function of coordinates) with the supports moved by increments `given`, with `ahead` to first order."""
        if not self.ahead:
            return gaps(self.moved(q, given))
        rate = self.ahead * self.moves
        largest = float(np.max(np.abs(rate) / np.repeat((self._size, 1.0), 3)))
        here, h = given - rate, SHORT / largest if largest > 0.0 else 1.0
        difference = gaps(self.moved(q, here + h * rate)) - gaps(self.moved(q, here - h * rate))
        return gaps(self.moved(q, here)) + difference / (2.0 * h)


class SupportPath(_Moving):
    """Supports of a model on their way from where they stand to where their functions have them at one time.

    model: Model with supports that move; tables in space.
    state: state at load factor 0, in space.
    from_start: whether that is the shape of the scene, from which supports follow their functions from t = 0 on; else they go
        straight, and so do their rotation vectors. What is given by matrices turns about one axis, the shorter way.
    at_time: float or (float, float), s, at load factor 1; or at 0 and 1, between which supports follow their functions, whatever
        the shape.
    who: the function that was called.
    """

    def __init__(self, model: Model, state: State, from_start: bool, at_time: float | tuple[float, float],
                 who: str = "solve_static") -> None:
        self.of = model.prescribed
        require(Analysis.AT_TIME, model, who)
        self.own, self._nodes, self._of_nodes = self.of.own, self.of.nodes, self.of.motion_of_node
        self._along, self._turns = fixed_axes(self.of.masks), np.flatnonzero(self.of.masks & 56)
        between = isinstance(at_time, tuple)
        self.model, self.from_start = model, from_start or between
        self.first, self.at_time = at_time if isinstance(at_time, tuple) else (0.0, at_time)
        self.share = 0.0
        own = self.of.own
        self._place, self._triads = (model.q0.reshape(-1, 4, 3)[own][:, i] for i in (0, slice(1, 4)))
        start = state.q.reshape(-1, 4, 3)[own]
        self._start = start[:, 0].copy(), start[:, 1:].copy()
        self._size = model.length + float(np.max(np.abs(state.q.reshape(-1, 12)[:, :3])))
        motions = self.of.motions
        self._first = [(motion.place(0.0), *motion.turning(0.0)) for motion in motions]
        # turns of supports since t = 0 at the begin and end of the way, and at the last equilibrium
        self._way = model.turns_of(state.history).reshape(-1, 3).copy(), self.of.vectors(self.at_time).reshape(-1, 3)
        self._reached = self._way[0]
        self._counts = {k: n for n, k in enumerate(self.of.turning)
                        if self._first[k][2] is not None and motions[k].turning(self.at_time)[1] is not None}
        self._off = [np.zeros(3) if between else self._start[0][k] - self._at(k, 0.0)[0] for k in range(len(motions))]

    def _at(self, k: int, t: float) -> tuple[Array, Array]:
        """Return place and triad of support k at time t."""
        motion, (place, turn, _) = self.of.motions[k], self._first[k]
        now = motion.place(t)
        triad = self._triads[k] if motion.rotation is None else self._triads[k] @ turn @ motion.turn(t).T
        return now if motion.position is not None else self._place[k] + now - place, triad

    def _time_at(self, share: float) -> float:
        """Return the time of a load factor, s."""
        return self.first + share * (self.at_time - self.first)

    @property
    def _time(self) -> float:
        """Time of the load factor `share`, s."""
        return self._time_at(self.share)

    @property
    def moves(self) -> Array:
        """Rates of displacements and rotation vectors by the load factor along the functions, [M, 6]."""
        rates = np.array([np.concatenate(motion.rates(self._time)) for motion in self.of.motions])
        return (self.at_time - self.first) * rates * np.hstack((self._along, np.isin(np.arange(len(rates)), self._turns)[:, None]
                                                                * np.ones(3)))

    def begin(self, share: float) -> None:
        """Count turns from the places of supports at this load factor."""
        self.share = share
        self._reached = self._vectors()

    def stands(self, share: float, now: Array) -> bool:
        """Return whether supports with coordinates [M, 4, 3] stand where their functions have them at this load factor; turns are
        counted from there."""
        before = self.share
        self.begin(share)
        left = self.pending(now)
        self.share = before
        return left is None or bool(np.all(np.abs(left) <= AWAY * np.repeat((self._size, 1.0), 3)))

    def check_stands(self, who: str, share: float, now: Array) -> None:
        """Refuse a start whose supports stand elsewhere at this load factor. Raises SceneError."""
        if not self.stands(share, now):
            names = ", ".join(motion.label for motion in self.of.motions[:3])
            raise SceneError(f"{who}: {names}: at the start these supports are not at the places that their functions prescribe; "
                             "give a start= with the supports there, as in start=solve_static(model, at_time=...).state")

    def targets(self) -> tuple[Array, Array]:
        """Return places [M, 3] and triads [M, 3, 3] at the load factor `share`."""
        places, triads = self._start[0].copy(), self._start[1].copy()
        for k in range(len(places)):
            if self.from_start:
                place, triads[k] = self._at(k, self._time)
                places[k] = place + (1.0 - self.share) * self._off[k]
            else:
                place, triad = self._at(k, self.at_time)
                places[k] += self.share * (place - places[k])
                if k in self._counts:
                    # a difference between start and function decreases along the way
                    off = _vector(triads[k].T @ self._turned(k, self._way[0]))
                    triads[k] = self._turned(k, self._vectors()) @ _turned_by((1.0 - self.share) * off).T
                else:
                    triads[k] = triads[k] @ _turned_by(self.share * _vector(triad.T @ triads[k])).T
        return places, triads

    def _turned(self, k: int, vectors: Array) -> Array:
        """Return the triad of support k after supports have turned by these vectors since t = 0."""
        _, turn, first = self._first[k]
        return np.asarray(self._triads[k] @ turn @ _turned_by(first + vectors[self._counts[k]]).T)

    def _vectors(self) -> Array:
        """Return rotation vectors of supports since t = 0 at the load factor `share`, [K, 3]."""
        if self.from_start:
            return np.asarray(self.of.vectors(self._time).reshape(-1, 3))
        return self._way[0] + self.share * (self._way[1] - self._way[0])

    def count_turns(self, out: Array) -> None:
        """Write the rotation vectors of supports at an equilibrium into numbers of a history, [3 K]."""
        self._reached = self._vectors()
        out[:] = self._reached.reshape(-1)

    def check_turns(self, reached: float) -> None:
        """Refuse supports that turn by half a turn or more from the load factor `reached` to `share`. Raises SceneError."""
        for k in self.of.turning if self.from_start else ():
            turns_between(self.of.motions[k], [self._time_at(reached), self._time])

    def pending(self, now: Array) -> Array | None:
        """Return increments missing at coordinates [M, 4, 3] of supports up to the load factor `share`: position and Cayley
        vector, [M, 6]; None where nothing is missing. NaN where a support would turn too far at once."""
        out = np.zeros((len(now), 6))
        if np.any(np.linalg.norm(self._vectors() - self._reached, axis=1) > LARGEST_TURN):
            return np.full_like(out, np.nan)
        places, triads = self.targets()
        place = np.where(self._along, places - now[:, 0], 0.0)
        out[:, :3] = np.where(np.abs(place) <= ROUND_OFF * self._size, 0.0, place)
        turns = self._turns
        if turns.size:
            out[turns, 3:] = _turns_left(triads[turns], now[turns, 1:])
        if self.ahead:
            out += self.ahead * self.moves
        return out if out.any() else None

    def _label(self, k: int) -> str:
        return str(self.of.motions[k].label)


class StaticShift(_Moving):
    """Supports that are shifted with the load factor, straight, and turned, each about one axis through its node.

    model: Model in space.
    moves: dict of int -> float64 (6,), increments of nodes that are held along them: displacement, m, and rotation vector in
        space, rad, at load factor 1.
    q: float64 [12 N], the shape at the load factor `share`.
    """

    def __init__(self, model: Model, moves: dict[int, Array], q: Array, share: float) -> None:
        self.model, self.share, self._first = model, share, share
        self.own, self.moves = np.array(list(moves), np.int64), np.array(list(moves.values())).reshape(-1, 6)
        self._start = q.reshape(-1, 4, 3)[self.own].copy()
        self._size = model.length + float(np.max(np.abs(q.reshape(-1, 12)[:, :3])))
        self._turns = np.flatnonzero(self.moves[:, 3:].any(axis=1))
        self._of_nodes, self._nodes = np.nonzero(model.pattern.row_of == model.pattern.row_of[self.own][:, None])
        self._reached = share
        # turns at the start of supports that turn by a function
        self._turned: Array | None = None

    def begin(self, share: float) -> None:
        """Count turns from this load factor on."""
        self._reached = share

    def pending(self, now: Array) -> Array | None:
        """Return missing increments, see `SupportPath.pending`, with those of `ahead` added."""
        out = np.zeros((self.own.size, 6))
        if np.any(np.linalg.norm((self.share - self._reached) * self.moves[:, 3:], axis=1) > LARGEST_TURN):
            return np.full_like(out, np.nan)
        gone = (self.share - self._first) * self.moves
        out[:, :3] = np.where(self.moves[:, :3] != 0.0, self._start[:, 0] + gone[:, :3] - now[:, 0], 0.0)
        out[np.abs(out) <= ROUND_OFF * self._size] = 0.0
        if self._turns.size:
            # rows are directors: D' = D R^T
            turn = _turned_by(gone[self._turns, 3:]).transpose(0, 2, 1)
            out[self._turns, 3:] = _turns_left(self._start[self._turns, 1:] @ turn, now[self._turns, 1:])
        out += self.ahead * self.moves
        return out if out.any() else None

    def count_turns(self, out: Array) -> None:
        """Write the rotation vectors of supports into numbers of a history, see `SupportPath.count_turns`."""
        of = self.model.prescribed
        if of is not None and of.turning:
            if self._turned is None:
                self._turned = out.copy()
            for n, k in enumerate(of.turning):
                for j in np.flatnonzero(self.own == of.own[k]):
                    out[3 * n:3 * n + 3] = self._turned[3 * n:3 * n + 3] + (self.share - self._first) * self.moves[j, 3:]

    def _label(self, k: int) -> str:
        return str(self.model.labels[self.own[k]])


def _turns_left(triads: Array, now: Array) -> Array:
    """Return Cayley vectors [T, 3] from triads now [T, 3, 3] to these; NaN where one would turn too far at once."""
    # rows are directors: D' = D R^T
    turn = triads.transpose(0, 2, 1) @ now
    size = 1.0 + np.trace(turn, axis1=1, axis2=2)
    with np.errstate(divide="ignore"):
        vector = 2.0 * axial(turn) / size[:, None]
    # |cayley vector| = 2 tan(angle/2)
    if np.any(np.linalg.norm(vector, axis=1) > 2.0 * np.tan(0.5 * LARGEST_TURN)) or np.any(size < 1e-3):
        return np.full_like(vector, np.nan)
    return np.where(np.abs(vector) <= ROUND_OFF, 0.0, vector)


def leave_plane(model: Model, moves: dict[int, Array]) -> bool:
    """Return whether displacements and rotation vectors [6] lead out of the plane of a model."""
    if model.plane is None or not moves:
        return False
    given = np.array(list(moves.values()))
    return bool(np.any(_off_plane(given, model.plane.axes) > OUT_OF_PLANE * model.length))


def coordinates_of(stepper: Any, nodes: Array) -> Array:
    """Return coordinates in space [M, 4, 3] of some nodes of a stepper."""
    q = stepper.core_state.q
    return q.reshape(-1, 4, 3)[nodes] if stepper.plane is None else stepper.plane.vectors_of(q[None], nodes, True)[0]


def _off_plane(given: Array, axes: Array) -> Array:
    """Return the sizes of the parts of motions [M, 6] out of a plane, [M]."""
    return np.asarray(np.abs(given[:, :3] @ axes[2]) + np.abs(given[:, 3:] @ axes[:2].T).sum(axis=1))


class Carrying:
    """Assembly of an iteration that moves the scene of a stepper along with its supports; own: int [M], nodes that are moved."""

    def __init__(self, stepper: Any, own: Array) -> None:
        core = stepper.core
        held, pattern = core.static_held, core.pattern
        self.free = Calls(tuple(term for term in stepper.terms if term is not held), ASSEMBLY)
        self.held = Calls((held,), ADDED)
        columns = pattern.columns
        self.block = np.flatnonzero(np.isin(columns, pattern.row_of[own]))
        self.row, self.column = pattern.rows[self.block], columns[self.block]

    def assemble(self, stepper: Any, system: SystemRecord, x: Array) -> None:
        """Assemble half the static tangent and the residual of the rows, as `Iteration.assemble` does, for increments of which
        those of held unknowns are x [rows, unknowns of a node]: K_ff x_f = -r_f - K_fh x_h. system: what terms share."""
        work, size = stepper.work, x.shape[1]
        kernels.assemble_all(*self.free.on(system), 0.0)
        blocks = stepper.core.blocks_in(work.blocks)[self.block, :, :size]
        np.add.at(stepper.core.rows_in(work.r), self.row, 2.0 * np.einsum("kij,kj->ki", blocks, x[self.column]))
        kernels.assemble_some(*self.held.on(system), 0.0)


def _vector(turn: Array) -> Array:
    """Return the rotation vector (3,) of a rotation (3, 3)."""
    from scipy.spatial.transform import Rotation
    return Rotation.from_matrix(turn).as_rotvec()


def _turned_by(vector: Array) -> Array:
    """Return the rotations [..., 3, 3] of rotation vectors [..., 3]."""
    from scipy.spatial.transform import Rotation
    return Rotation.from_rotvec(vector).as_matrix()
