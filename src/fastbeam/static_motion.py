"""Supports that move in statics: where they are at a load factor, and the iteration that takes the scene along (theory.md 8)."""
from __future__ import annotations

from typing import Any

import numpy as np

from ._records import Record
from .connections import held_axes
from .errors import SceneError
from .kernels import step as kernels
from .mapping import follow
from .model import Model

Array = np.ndarray
# what is missing up to the place of a support counts as round-off up to this share of its coordinates, and of 1 rad
ROUND_OFF = 4.0 * float(np.finfo(float).eps)
# a support turns by less than this at once, rad
LARGEST_TURN = 1.5
# a motion may leave the plane of its scene by so much of its way
OUT_OF_PLANE = 1e-12


class StaticMotion:
    """Supports of a model on their way from where they stand to where their functions have them at one time.

    Parameters
    ----------
    model : Model
        With supports that move; tables in space.
    q : float64 [12 N]
        The shape at load factor 0.
    from_start : bool
        Whether that is the shape of the scene, from which supports follow their functions from t = 0 on; else they go straight,
        and turn about one axis.
    at_time : float
        s.
    """

    def __init__(self, model: Model, q: Array, from_start: bool, at_time: float) -> None:
        self.of = model.prescribed
        for motion in self.of.motions:
            if motion.since is not None:
                raise SceneError(f"solve_static(at_time=): {motion.label} takes hold in a run (since=); leave since "
                                 "out, or the motion")
        self.model, self.from_start, self.at_time = model, from_start, at_time
        self.share = 0.0
        own = self.of.own
        self._place, self._triads = (model.q0.reshape(-1, 4, 3)[own][:, i] for i in (0, slice(1, 4)))
        start = q.reshape(-1, 4, 3)[own]
        self._start = start[:, 0].copy(), start[:, 1:].copy()
        self._size = model.length + float(np.max(np.abs(q.reshape(-1, 12)[:, :3])))

    def _at(self, k: int, t: float) -> tuple[Array, Array]:
        """Place and triad of support k at time t."""
        motion = self.of.motions[k]
        place = motion.place(t) if motion.position is not None else self._place[k] + motion.place(t) - motion.place(0.0)
        return place, self._triads[k] @ motion.turn(0.0) @ motion.turn(t).T

    def targets(self) -> tuple[Array, Array]:
        """Places [M, 3] and triads [M, 3, 3] at the load factor `share`."""
        places, triads = self._start[0].copy(), self._start[1].copy()
        for k in range(len(places)):
            if self.from_start:
                off = places[k] - self._at(k, 0.0)[0]
                place, triads[k] = self._at(k, self.share * self.at_time)
                places[k] = place + (1.0 - self.share) * off
            else:
                place, triad = self._at(k, self.at_time)
                places[k] += self.share * (place - places[k])
                triads[k] = triads[k] @ _turned_by(self.share * _vector(triad.T @ triads[k])).T
        return places, triads

    def pending(self, q: Array) -> Array | None:
        """What is missing at a shape [12 N] up to the load factor `share`: position and Cayley vector, [M, 6]; None where nothing
        is. NaN where a support would turn too far at once."""
        places, triads = self.targets()
        now = q.reshape(-1, 4, 3)[self.of.own]
        masks = self.of.masks
        out = np.zeros((len(masks), 6))
        out[:, :3] = np.where(held_axes(masks), places - now[:, 0], 0.0)
        # rows are directors: D' = D R^T
        turn = triads.transpose(0, 2, 1) @ now[:, 1:]
        size = 1.0 + np.trace(turn, axis1=1, axis2=2)
        turns = masks & 56 != 0
        with np.errstate(divide="ignore"):
            out[turns, 3:] = (2.0 * _axial(turn) / size[:, None])[turns]
        out[:, :3][np.abs(out[:, :3]) <= ROUND_OFF * self._size] = 0.0
        out[:, 3:][np.abs(out[:, 3:]) <= ROUND_OFF] = 0.0
        # |cayley vector| = 2 tan(angle/2)
        if np.any(np.linalg.norm(out[:, 3:], axis=1) > 2.0 * np.tan(0.5 * LARGEST_TURN)) or np.any(size[turns] < 1e-3):
            return np.full_like(out, np.nan)
        return out if np.any(out) else None

    def rows(self, given: Array, core: Model, axes: Array | None) -> Array:
        """The same as increments of rows, [rows, unknowns of a node]; axes: of the plane of `core`.

        Raises
        ------
        SceneError
            A support leaves the plane.
        """
        return _rows(given, core, axes, self.of.own, self._size, [motion.label for motion in self.of.motions])

    def moved(self, q: Array, given: Array) -> Array:
        """Coordinates [12 N] where the supports and what hangs rigidly on them have gone on by that."""
        out = q.reshape(-1, 4, 3).copy()
        for node, k in zip(self.of.nodes, self.of.motion_of_node):
            w = given[k, 3:]
            out[node, 0] += given[k, :3]
            d = np.cross(w, out[node, 1:])
            out[node, 1:] += (d + 0.5 * np.cross(w, d)) / (1.0 + 0.25 * w @ w)
        return follow(self.model, out).reshape(-1)


class StaticShift:
    """Supports that are shifted with the load factor, straight and without turning.

    Parameters
    ----------
    model : Model
        In space.
    shifts : dict of int -> float64 (3,)
        Of nodes whose position is held along them, m at load factor 1.
    q : float64 [12 N]
        The shape at the load factor `share`.
    share : float
    """

    def __init__(self, model: Model, shifts: dict[int, Array], q: Array, share: float) -> None:
        self.model, self.share, self._first = model, share, share
        self.own, self.shifts = np.array(list(shifts), np.int64), np.array(list(shifts.values())).reshape(-1, 3)
        self._start = q.reshape(-1, 4, 3)[self.own, 0].copy()
        self._size = model.length + float(np.max(np.abs(q.reshape(-1, 12)[:, :3])))
        row = model.pattern.row_of
        self._nodes = [np.flatnonzero(row == row[node]) for node in self.own]

    def pending(self, q: Array) -> Array | None:
        """As `StaticMotion.pending`."""
        out = np.zeros((self.own.size, 6))
        target = self._start + (self.share - self._first) * self.shifts
        out[:, :3] = np.where(self.shifts != 0.0, target - q.reshape(-1, 4, 3)[self.own, 0], 0.0)
        out[np.abs(out) <= ROUND_OFF * self._size] = 0.0
        return out if np.any(out) else None

    def rows(self, given: Array, core: Model, axes: Array | None) -> Array:
        """As `StaticMotion.rows`.

        Raises
        ------
        SceneError
        """
        return _rows(given, core, axes, self.own, self._size, [self.model.labels[node] for node in self.own])

    def moved(self, q: Array, given: Array) -> Array:
        """As `StaticMotion.moved`."""
        out = q.reshape(-1, 4, 3).copy()
        for nodes, shift in zip(self._nodes, given[:, :3]):
            out[nodes, 0] += shift
        return follow(self.model, out).reshape(-1)


def _rows(given: Array, core: Model, axes: Array | None, own: Array, size: float, labels: list[str]) -> Array:
    """Motions [M, 6] of nodes as increments of rows."""
    x = np.zeros((core.pattern.n, 6))
    np.add.at(x, core.pattern.row_of[own], given)
    if axes is None:
        return x
    off = np.abs(given[:, :3] @ axes[2]) + np.linalg.norm(given[:, 3:] - (given[:, 3:] @ axes[2])[:, None] * axes[2], axis=1)
    if np.any(off > OUT_OF_PLANE * size):
        raise SceneError(f"{labels[int(np.argmax(off))]}: it leaves the plane of the scene; compile the scene with planar=False")
    return np.concatenate((x[:, :3] @ axes[:2].T, x[:, 3:] @ axes[2:].T), axis=1)


def assemble_moved(stepper: Any, x: Array) -> None:
    """Half the static tangent and the residual of the rows, as `Iteration.assemble` does, for increments of which those of held
    unknowns are x [rows, unknowns of a node]: K_ff x_f = -r_f - K_fh x_h. Around solvers without elimination of inner nodes."""
    core, work, size = stepper.core, stepper.work, x.shape[1]
    held, pattern = core.static_held, core.pattern
    system = stepper.records[1]
    kernels.assemble_all(Record(tuple(term for term in stepper.terms if term is not held)), system, 0.0)
    moved = np.flatnonzero(np.any(x != 0.0, axis=1)[pattern.columns])
    blocks = work.blocks[:8 * size * pattern.keys.size].reshape(-1, size, 8)[moved][:, :, :size]
    r = work.r[:8 * pattern.n].reshape(-1, 8)[:, :size]
    np.add.at(r, pattern.rows[moved], 2.0 * np.einsum("kij,kj->ki", blocks, x[pattern.columns[moved]]))
    kernels.assemble_some(Record((held,)), system, 0.0)


def _axial(turn: Array) -> Array:
    """Twice the sine of the angle of rotations [..., 3, 3] times their axis, [..., 3]."""
    x = turn - np.swapaxes(turn, -1, -2)
    return np.stack((x[..., 2, 1], x[..., 0, 2], x[..., 1, 0]), axis=-1)


def _vector(turn: Array) -> Array:
    """Rotation vector (3,) of a rotation (3, 3)."""
    from scipy.spatial.transform import Rotation
    return Rotation.from_matrix(turn).as_rotvec()


def _turned_by(vector: Array) -> Array:
    """Rotation (3, 3) of a rotation vector (3,)."""
    from scipy.spatial.transform import Rotation
    return Rotation.from_rotvec(vector).as_matrix()
