"""Coordinates that joints with axes leave free: tables of their springs, dampers and motors, what motors give in every step, and
values and energies at rows. What holds, stops and drives them: joint_drives.py."""
from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .errors import SceneError
from .joint_drives import Holds, JointsOfRun, holds_of
from .joint_tables import Conditions
from .kernels.joint_friction import RUB
from .kernels.joint_motion import LOSS, MOTION, VALUE, WORK, JointMotion, MotorSchedule
from .kernels.work import State
from .load_times import mean_factors
from .plane import Plane, numbers_of

Array = np.ndarray
# a value in the history that differs more from that of the coordinates belongs to another state
STALE = 1e-11


@dataclass(frozen=True)
class Motions:
    """All free coordinates of the joints of a scene, C of them.

    Attributes
    ----------
    table : JointMotion
        Of those that are left in a plane, in its model.
    rows : int64 [*]
        Which of all coordinates the table has.
    names : list of str
        The joint of every coordinate.
    labels : list of str
        For messages.
    motors : list
        Force or torque of every coordinate: a number, a function of time, or None.
    turn : float64 [C, 2, 3, 3]
        R with D_i = sum_k R_ik d_k of both nodes.
    node : int64 [C, 2]
    spring : float64 [C, 2]
        Stiffness and rest value.
    distance : float64 [C]
        At t = 0, m.
    is_angle : bool [C]
    damped : bool
    holds : Holds
        What holds and stops them.
    """

    table: JointMotion
    rows: Array
    names: list[str]
    labels: list[str]
    motors: list[Any]
    turn: Array
    node: Array
    spring: Array
    distance: Array
    is_angle: Array
    damped: bool
    holds: Holds

    @property
    def size(self) -> int:
        """Numbers of `State.history`."""
        return MOTION * len(self.names) + RUB * self.holds.rubs.size

    @property
    def driven(self) -> bool:
        """Whether there are motors or drives."""
        return any(motor is not None for motor in self.motors) or self.holds.driven.size > 0

    @property
    def timed(self) -> bool:
        """Whether a motor has to be told the time."""
        return any(callable(motor) for motor in self.motors)

    @property
    def exchanges(self) -> bool:
        """Whether the total energy changes: there is more than springs."""
        return self.damped or self.driven or self.holds.held.size > 0

    @property
    def acts(self) -> bool:
        """Whether there are springs, dampers or motors."""
        return self.damped or any(motor is not None for motor in self.motors) or bool(np.any(self.spring[:, 0]))

    def work(self, model: Any) -> JointsOfRun:
        """The tables with arrays of one run of a model."""
        table = self.table._replace(given=self.table.given.copy(), hold=np.zeros(32))
        return self.holds.tables(table, self.acts, model.ties, model.kept, model.n_sliders)

    def schedules(self, tables: JointsOfRun, starts: Array, lengths: Array, end: float) -> list[Any]:
        """What motors, given coordinates and drives have in substeps that begin at `starts`, of these lengths [n]; the last ends
        at `end`."""
        out: list[Any] = []
        if self.timed:
            out.append(MotorSchedule(tables.motion, self.schedule(starts, lengths)))
        if tables.drives is not None:
            out.append(self.holds.schedule(tables.drives, starts, lengths, end))
        if tables.control is not None:
            out.append(self.holds.controls(tables.control, starts, lengths))
        return out

    def schedule(self, starts: Array, lengths: Array) -> Array:
        """Mean forces of the motors in the table over substeps from times `starts` on, of these lengths [n]: [n, *]."""
        out = np.zeros((len(starts), len(self.rows)))
        for column, k in enumerate(self.rows.tolist()):
            motor = self.motors[k]
            out[:, column] = mean_factors(motor, starts, lengths, self.labels[k]) if callable(motor) else motor or 0.0
        return out

    # --- at rows ------------------------------------------------------------------------------------------------------
    def _vectors(self, q: Array) -> tuple[Array, Array]:
        """x_b - x_a [C, 3] and D of both nodes [C, 2, 3, 3]."""
        return q[self.node[:, 1], 0] - q[self.node[:, 0], 0], np.einsum("csik,cskx->csix", self.turn, q[self.node, 1:])

    def values(self, q: Array, before: Array) -> Array:
        """Coordinates [C] at q [N, 4, 3], of angles those next to `before` [C]."""
        r, d = self._vectors(q)
        angle = np.arctan2(np.sum(d[:, 0, 2] * d[:, 1, 1], axis=1), np.sum(d[:, 0, 1] * d[:, 1, 1], axis=1))
        angle += 2.0 * np.pi * np.round((before - angle) / (2.0 * np.pi))
        return np.where(self.is_angle, angle, np.sum(r * d[:, 0, 0], axis=1) - self.distance)

    def rates(self, q: Array, v: Array) -> Array:
        """Rates [C] of the coordinates at q and rates v [N, 4, 3]."""
        (r, d), (dr, dd) = self._vectors(q), self._vectors(v)
        spin = 0.5 * np.cross(d, dd).sum(axis=2)
        turning = np.sum(d[:, 0, 0] * (spin[:, 1] - spin[:, 0]), axis=1)
        return np.where(self.is_angle, turning, np.sum(dr * d[:, 0, 0] + r * dd[:, 0, 0], axis=1))

    def energy(self, history: Array) -> Array:
        """Energy [C] that springs store, J; history [C, 3]."""
        stiffness, rest = self.spring.T
        energy = 0.5 * stiffness * (history[:, VALUE] - rest)**2
        return energy + self.holds.stop_energy(history[:, VALUE]) if self.holds.stopped.size else energy

    def own(self, history: Array, place: int) -> Array:
        """Numbers [C, 3] of all coordinates in a history, from `place` on."""
        return history[place:place + MOTION * len(self.names)].reshape(-1, MOTION)

    def settle(self, state: State, space: State, place: int, t: float | None) -> None:
        """Bring the values in the history of a state, from `place` on, up to its coordinates, those of `space`; t: when a run
        starts from there, None in an equilibrium."""
        own = self.own(state.history, place)
        q, v = (x.reshape(-1, 4, 3) for x in (space.q, space.v))
        found = self.values(q, own[:, VALUE])
        stale = np.abs(found - own[:, VALUE]) > STALE * (1.0 + np.abs(found))
        own[stale, VALUE] = found[stale]
        if t is None or not self.holds.held.size:
            return
        self.holds.start(t, own[:, VALUE], found)
        if self.holds.rubs.size:
            self.holds.check_within(found)
            self.holds.start_rubbing(state.history[self.holds.place:].reshape(-1, RUB), self.rates(q, v),
                                     float(np.max(np.abs(v), initial=0.0)))

    def given_between(self, history: Array, place: int, t: float) -> tuple[Array, Array]:
        """Of coordinates that are given the values in a history and those at time t; one whose speed is given stays."""
        before = self.own(history, place)[self.holds.given, VALUE].copy()
        after = [x if self.holds.parts[k].speed is not None else self.holds.value(k, t)
                 for k, x in zip(self.holds.given.tolist(), before)]
        return before, np.array(after)

    def check_stays(self, who: str, state: State, place: int, t: float) -> None:
        """As of `Holds`, in a state in space."""
        if self.holds.given.size:
            before = self.own(state.history, place)[:, VALUE]
            self.holds.check_stays(who, t, self.values(state.q.reshape(-1, 4, 3), before))

    def row(self, t: float, state: State, place: int) -> dict[str, Array]:
        """Series of one row, at time t."""
        q, v = (x.reshape(-1, 4, 3) for x in (state.q, state.v))
        values, rates = self.own(state.history, place)[:, VALUE].copy(), self.rates(q, v)
        drive = {"joint_drive": self.holds.drive_forces(t, values, rates)} if self.holds.driven.size else {}
        return {"joint_value": values, "joint_rate": rates, **drive}

    def exchanged(self, state: State, place: int) -> dict[str, Array]:
        """Series of energies of one row."""
        own = self.own(state.history, place)
        return {"joint_energy": self.energy(own), "joint_loss": own[:, LOSS].copy(), "joint_work": own[:, WORK].copy(),
                **self.holds.exchanged(state.history)}


def motions_of(links: Any, blocks: Any, row_of: Array, spin_root: Array, model: Any) -> Motions | None:
    """Of the joints of a scene; links: `links.Links`; model: the scene's, without them. None where there are none."""
    found = [(part, node, is_angle, k) for part, node in links.with_axes for k, is_angle in enumerate(part.coordinates)]
    place = model.motion_place
    if not found:
        return None
    node = np.array([x[1] for x in found], np.int64).reshape(-1, 2)
    laws: list[Conditions] = [links.law_of(x[0]) for x in found]
    a, b = node.T
    block = np.stack([blocks.between(i, j) for i in (a, b) for j in (a, b)], axis=1)
    turn = np.array([law.turn for law in laws])
    x = np.array([law.reference for law in laws])
    distance = np.sum((x[:, 1, 0] - x[:, 0, 0]) * np.array([law.axes[0, 0] for law in laws]), axis=1)
    numbers = {name: np.array([part.numbers[name][k] for part, *_, k in found]) for name in ("stiffness", "damping", "rest")}
    motors = [part.motor for part, *_ in found]
    is_angle = np.array([x[2] for x in found], np.int64)
    count = len(found)
    table = JointMotion(node, row_of[node], block, is_angle, spin_root[node], turn.reshape(-1), distance,
                        place + MOTION * np.arange(count), numbers["stiffness"], numbers["damping"], numbers["rest"],
                        np.array([float(m) if m is not None and not callable(m) else 0.0 for m in motors]), np.zeros(32))
    parts = [part for part, *_ in found]
    holds = holds_of(parts, is_angle, model.n_sliders + len(model.kept), place + MOTION * count, model.length)
    return Motions(table, np.arange(count), [str(part.name) for part in parts], [part.label for part in parts], motors,
                   turn, node, np.stack((numbers["stiffness"], numbers["rest"]), axis=1), distance, is_angle == 1,
                   bool(np.any(numbers["damping"])), holds)


def motions_in_plane(motions: Motions | None, reference: Array, plane: Plane, constraints: int) -> Motions | None:
    """With the table of what is left in a plane; reference: coordinates [N, 4, 3] in space; constraints: all that are left there
    but moments of sleeves."""
    if motions is None:
        return None
    table = motions.table
    axis = np.einsum("ck,ckx->cx", motions.turn[:, 0, 0], reference[motions.node[:, 0], 1:])
    up = np.abs(axis @ plane.axes[2]) > 0.5
    rows = np.flatnonzero(up == motions.is_angle)
    flat = np.einsum("csik,csk->csi", motions.turn[rows], plane.factor[motions.node[rows]])
    size = np.abs(flat)
    flat = np.where(size > 0.5, flat / np.where(size > 0.5, size, 1.0), 0.0)
    some = {name: np.ascontiguousarray(getattr(table, name)[rows]) for name in
            ("node", "row", "block", "is_angle", "spin_node", "value", "place", "stiffness", "damping", "rest", "given")}
    first = constraints - int(np.sum(np.isin(motions.holds.held, rows)))
    return replace(motions, table=table._replace(**some, axes=numbers_of(flat)), rows=rows,
                   holds=motions.holds.in_plane(rows, first))


def check_motions(motions: Motions | None, compared: str | None, substeps: int, static: bool) -> None:
    """Refuse what forces in joints do not go together with.

    Raises
    ------
    SceneError
    """
    if motions is None:
        return
    holds = motions.holds
    if not (motions.acts or motions.driven or holds.held.size or holds.stopped.size):
        return
    if compared is not None:
        raise SceneError(f"method {compared!r} has no springs, dampers, motors, drives, friction and stops in joints; use the "
                         "default method")
    if substeps > 1 and motions.damped:
        raise SceneError("order=4 has a step backward in time, in which dampers of joints would put energy in; use order=2")
    if substeps > 1 and holds.backward:
        raise SceneError(f"order=4 has a step backward in time, in which {holds.backward} would put energy in; use order=2")
    if static and motions.driven:
        driven = [k for k, motor in enumerate(motions.motors) if motor is not None] + holds.driven.tolist()
        raise SceneError(f"{motions.labels[driven[0]]}: solve_static takes no motors and drives of joints; leave it out, or hold "
                         "the joint by a stiff spring with rest=")
    if static and holds.rubs.size:
        part = holds.parts[holds.rubs[0]]
        what = "friction of joints, which leaves a range of them" if part.has_friction else "rigid stops of joints"
        way = "" if part.has_friction else ", give the stops a stiffness="
        raise SceneError(f"{part.label}: equilibria and modes know no {what}; leave it out{way}, hold the joint where it is to "
                         "be by angle= or distance=, or run until it rests")
