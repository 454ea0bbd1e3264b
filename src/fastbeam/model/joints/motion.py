"""Coordinates that joints with axes leave free: tables of their springs, dampers and motors, motor forces in every step, values
and energies at rows. Prescribed values, stops and drives: joints/drives.py."""
from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fastbeam.kernels.empty_arrays import empty
from fastbeam.kernels.joints.coordinates import ANGLE, LINE, LOSS, MOTION, NO_SWING, SWING, VALUE, WORK, JointMotion
from fastbeam.kernels.joints.forces import MotorSchedule
from fastbeam.kernels.joints.friction import RUB
from fastbeam.kernels.state import State
from fastbeam.model.analyses import Analysis, Lack, dissipating, lacking, unknown_to_methods, without_adjoint
from fastbeam.model.feature import Feature, OfRun, Span, Stand
from fastbeam.model.forces.loads import factor_at, mean_factors
from fastbeam.model.joints.coordinates import KINDS, Coordinate
from fastbeam.model.joints.drives import Holds, JointsOfRun, holds_of
from fastbeam.model.joints.tables import bearing_nodes
from fastbeam.model.plane import Plane, numbers_of

Array = np.ndarray
# largest difference, relative to 1 + value, between a value in the history and that of the coordinates of the same state
STALE = 1e-11


def _unknown(analyses: tuple[Analysis, ...], what: str, text: str, instead: str, some: Callable[[Motions], list[int]]) -> Lack:
    """Declare that analyses do not support some coordinates, which messages name by their labels."""
    return Lack(analyses, what, text, instead, lambda motions, asked: [motions.labels[k] for k in some(motions)])


SMOOTH_AT_REST = Analysis.RELAX, Analysis.PATH, Analysis.LENGTHS, Analysis.SENSITIVITY
HOLD_IT = "prescribe its value by angle= or distance=, or run until it comes to rest"


@dataclass(frozen=True)
class Motions(Feature):
    """All free coordinates of the joints of a scene, C of them."""

    key, title, order = "motions", "springs, dampers, motors, drives, friction and stops of joints", 80
    constrains = True
    lacks = (
        unknown_to_methods("springs, dampers, motors, drives, friction and stops of joints",
                           lambda motions, asked: [motions.title] * bool(
                               motions.acts or motions.driven or motions.holds.held.size or motions.holds.stopped.size)),
        dissipating("friction, rigid stops", lambda motions, asked: motions.holds.kinks, kinked=True),
        dissipating("drives with a limit, where something dissipates", lambda motions, asked: (
            motions.holds.heeding or ["drives with a limit"])
            if motions.holds.is_bounded and any(lacking(Analysis.COMPOSED, asked.model)) else [], kinked=True),
        dissipating("dampers, drives by velocity", lambda motions, asked: (
            ["dampers of joints"] * motions.damped + motions.holds.heeding)),
        _unknown(SMOOTH_AT_REST, "motors and drives", "{name}: {who} does not support motors and drives of joints",
                 "leave it out, or replace it by a stiff spring with rest=", lambda motions: motions.pushed),
        _unknown((*SMOOTH_AT_REST, Analysis.EXACT), "friction",
                 "{name}: {who} does not support friction of joints, with which equilibria are not "
                 "unique", f"leave it out, {HOLD_IT}",
                 lambda motions: [k for k in motions.holds.rubs.tolist() if motions.holds.parts[k].has_friction]),
        _unknown((*SMOOTH_AT_REST, Analysis.EXACT), "rigid stops", "{name}: {who} does not support rigid stops of joints",
                 f"leave it out, give the stops a stiffness=, {HOLD_IT}",
                 lambda motions: [k for k in motions.holds.rubs.tolist() if not motions.holds.parts[k].has_friction]),
        _unknown((Analysis.RELAX,), "given values", "relax: {name} has a value prescribed as a function of time, which relax "
                                                    "does not support",
                 "replace it by a stiff spring with rest=, or use solve_static", lambda motions: motions.holds.given.tolist()),
        _unknown((Analysis.SENSITIVITY,), "given values",
                 "{who}: {name} has a prescribed value, which may depend on the parameters; its derivative is not "
                 "available", "use differences of equilibria",
                 lambda motions: motions.holds.given.tolist()),
        Lack((Analysis.TIMELESS,), "motors, drives and given values by functions of time",
             "{who}: motors, drives or prescribed motions of joints are functions of time, so a time is needed",
             "give the time with at_time=t", lambda motions, asked: ["joints"] * motions.holds.has_functions),
        Lack((Analysis.TIMELESS_MODES,), "motors and drives by functions of time",
             "{who}: motors or drives of joints are functions of time, so a time is needed", "give the time with at_time=t",
             lambda motions, asked: ["joints"] * motions.holds.pushes_in_time),
        without_adjoint("friction, rigid stops", lambda motions, asked: [
            f"friction or rigid stops of {motions.labels[k]}" for k in motions.holds.rubs]))

    table: JointMotion  # table of the coordinates `rows`
    rows: Array  # int64 [*]: coordinates in the table: all, in the model of a plane those that are left there
    names: list[str]  # the joint of every coordinate
    labels: list[str]  # for messages
    what: list[str]  # 'angle', 'distance', 'swing', 'twist' or 'cosine' of every coordinate
    motors: list[Any]  # force or torque of every coordinate: a number, a function of time, or None
    turn: Array  # float64 [C, 2, 3, 3]: R with D_i = sum_k R_ik d_k of both nodes
    node: Array  # int64 [C, 2]
    spring: Array  # float64 [C, 2]: stiffness and rest value
    every: JointMotion  # table of all coordinates in space
    laws: list[Coordinate]
    damped: bool
    holds: Holds  # prescribed values, friction, stops and drives

    @property
    def history_size(self) -> int:
        """Number of history variables of all coordinates."""
        return MOTION * len(self.names) + RUB * self.holds.rubs.size

    @property
    def driven(self) -> bool:
        """True if there are motors or drives."""
        return any(motor is not None for motor in self.motors) or self.holds.driven.size > 0

    @property
    def pushed(self) -> list[int]:
        """Coordinates with motors, then those with drives."""
        return [k for k, motor in enumerate(self.motors) if motor is not None] + self.holds.driven.tolist()

    @property
    def timed(self) -> bool:
        """True if a motor force is a function of time."""
        return any(callable(motor) for motor in self.motors)

    @property
    def exchanges(self) -> bool:
        """True if joints change the total energy: there is more than springs."""
        return self.damped or self.driven or self.holds.held.size > 0

    @property
    def acts(self) -> bool:
        """True if there are springs, dampers or motors."""
        return self.damped or any(motor is not None for motor in self.motors) or bool(np.any(self.spring[:, 0]))

    def work(self, model: Any, plane: Any, static: bool) -> JointsOfRun | None:
        """Return the tables with arrays of one run of a model; None where no coordinate is left in its plane."""
        if not self.rows.size:
            return None
        table = self.table._replace(given=self.table.given.copy(), hold=empty(64))
        return self.holds.tables(table, self.acts, model)

    def terms(self, run: OfRun) -> list[tuple[Stand, Any]]:
        """Return the terms of forces on coordinates and of their constraints."""
        own: JointsOfRun | None = run.own.get(self.key)
        if own is None:
            return []
        return [(Stand.JOINTS, x) for x in (own.known if run.known else own.static_terms if run.static else own.terms)]

    def schedules(self, span: Span) -> list[tuple[Stand, Any]]:
        """Tabulate motor forces, prescribed values and inputs of drives for the steps of a span."""
        own: JointsOfRun | None = span.own.get(self.key)
        if own is None:
            return []
        out: list[Any] = []
        if self.timed:
            out.append(MotorSchedule(own.motion, self.schedule(span.starts, span.lengths)))
        if own.drives is not None:
            out.append(self.holds.schedule(own.drives, span.starts, span.lengths, span.end))
        if own.control is not None:
            out.append(self.holds.controls(own.control, span.starts, span.lengths))
        return [(Stand.MOTORS, x) for x in out]

    def schedule(self, starts: Array, lengths: Array) -> Array:
        """Average the forces of the motors in the table over substeps from times `starts` on, of these lengths [n]: [n, *]."""
        out = np.zeros((len(starts), len(self.rows)))
        for column, k in enumerate(self.rows.tolist()):
            motor = self.motors[k]
            who = f"(motor) of {self.labels[k]}"
            out[:, column] = mean_factors(motor, starts, lengths, who) if callable(motor) else motor or 0.0
        return out

    def at_rest(self, tables: JointsOfRun, t: float, share: float) -> None:
        """Set motor forces and inputs of drives in the tables of an equilibrium at time t, with load factor `share`."""
        for column, k in enumerate(self.rows.tolist()):
            motor = self.motors[k]
            if motor is not None:
                full = factor_at(motor, t, f"(motor) of {self.labels[k]}") if callable(motor) else float(motor)
                tables.motion.given[column] = share * full
        if tables.control is not None:
            self.holds.at_rest(tables.control, t, share)

    def in_plane(self, plane: Plane, model: Any, constraints: int) -> Motions:
        """Return a copy with the table of the coordinates that are left in a plane."""
        table = self.table
        d = np.einsum("csik,cskx->csix", self.turn, model.q0.reshape(-1, 4, 3)[self.node, 1:])
        up = np.abs(d @ plane.axes[2]) > 0.5
        (i, j), of = table.pair[:, 1:].T, np.repeat(np.arange(len(self.names)), np.diff(table.start))
        out = up[of, 0, i] | (j >= 0) & up[of, 1, j]
        rows = np.flatnonzero(np.bincount(of, weights=out, minlength=len(self.names)) == 0)
        mine = np.isin(of, rows)
        start = np.concatenate(([0], np.cumsum(np.diff(table.start)[rows]))).astype(np.int64)
        flat = np.einsum("csik,csk->csi", self.turn[rows], plane.factor[self.node[rows]])
        size = np.abs(flat)
        flat = np.where(size > 0.5, flat / np.where(size > 0.5, size, 1.0), 0.0)
        some = {name: np.ascontiguousarray(getattr(table, name)[rows]) for name in
                ("node", "row", "block", "kind", "spin_node", "value", "place", "stiffness", "damping", "rest", "given")}
        first = constraints - int(np.sum(np.isin(self.holds.held, rows)))
        return replace(self, table=table._replace(**some, start=start, pair=np.ascontiguousarray(table.pair[mine]),
                                                     sign=table.sign[mine], axes=numbers_of(flat)),
                       rows=rows, holds=self.holds.in_plane(rows, first))

    # --- at rows ------------------------------------------------------------------------------------------------------
    def _vectors(self, q: Array) -> tuple[Array, Array]:
        """Return x_b - x_a [C, 3] and D of both nodes [C, 2, 3, 3]."""
        return q[self.node[:, 1], 0] - q[self.node[:, 0], 0], np.einsum("csik,cskx->csix", self.turn, q[self.node, 1:])

    def _factors(self, q: Array) -> tuple[Array, Array]:
        """Return both vectors of every product, [P, 3] each."""
        r, d = self._vectors(q)
        (i, j), of = self.every.pair[:, 1:].T, self._of
        return d[of, 0, i], np.where(j[:, None] < 0, r[of], d[of, 1, j])

    @property
    def _of(self) -> Array:
        """Coordinate of every product, [P]."""
        return np.repeat(np.arange(len(self.names)), np.diff(self.every.start))

    def _summed(self, products: Array) -> tuple[Array, Array]:
        """Sum products [P] into y and z of all coordinates, [C] each."""
        out = np.zeros((2, len(self.names)))
        np.add.at(out, (self.every.pair[:, 0], self._of), self.every.sign * products)
        return out[0], out[1]

    def _sums(self, q: Array) -> tuple[Array, Array]:
        """Return y and z [C] at q [N, 4, 3]; y of a swing is the sine."""
        a, b = self._factors(q)
        y, z = self._summed(np.sum(a * b, axis=1))
        swings = np.flatnonzero(self.every.kind == SWING)
        if swings.size:
            d = self._vectors(q)[1]
            y[swings] = np.linalg.norm(np.cross(d[swings, 0, 0], d[swings, 1, 0]), axis=1)
        return y, z

    def values(self, q: Array, before: Array) -> Array:
        """Return the coordinates [C] at q [N, 4, 3]; angles are counted over turns, next to `before` [C]."""
        y, z = self._sums(q)
        angle = np.arctan2(y, z)
        turns = np.where(self.every.kind == ANGLE, np.round((before - angle) / (2.0 * np.pi)), 0.0)
        return np.where(self.every.kind == LINE, y - self.every.value, angle + 2.0 * np.pi * turns)

    def rates(self, q: Array, v: Array) -> Array:
        """Return the rates [C] of the coordinates at q and rates v [N, 4, 3]."""
        (a, b), (da, db), (y, z) = self._factors(q), self._factors(v), self._sums(q)
        dy, dz = self._summed(np.sum(da * b + a * db, axis=1))
        with np.errstate(divide="ignore", invalid="ignore"):
            turning = (z * dy - y * dz) / (y * y + z * z)
        return np.choose(self.every.kind, (dy, turning, -dz / np.maximum(y, NO_SWING)))

    def energy(self, history: Array) -> Array:
        """Return the energy [C] that springs and elastic stops store, J; history [C, 3]."""
        stiffness, neutral = self.spring.T
        energy = 0.5 * stiffness * (history[:, VALUE] - neutral)**2
        return energy + self.holds.stop_energy(history[:, VALUE]) if self.holds.stopped.size else energy

    def own(self, history: Array, place: int) -> Array:
        """Return the history variables [C, 3] of all coordinates, which begin at `place`: a view."""
        return history[place:place + MOTION * len(self.names)].reshape(-1, MOTION)

    def settle(self, state: State, space: State, place: int, t: float | None) -> None:
        """Update the values in the history of a state, from `place` on, to its coordinates, those of `space`; t: time at which a
        run starts from there, None in an equilibrium."""
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
            self.holds.start_rubbing(self.holds.numbers(state.history), self.rates(q, v),
                                     float(np.max(np.abs(v), initial=0.0)))

    def given_between(self, history: Array, place: int, t: float) -> tuple[Array, Array]:
        """Return the prescribed coordinates in a history and at time t; a coordinate with a prescribed speed keeps its value."""
        before = self.own(history, place)[self.holds.given, VALUE].copy()
        after = [x if self.holds.parts[k].speed is not None else self.holds.value(k, t)
                 for k, x in zip(self.holds.given.tolist(), before)]
        return before, np.array(after)

    def check_stays(self, who: str, state: State, place: int, t: float) -> None:
        """Check that joints in a state in space stand at their prescribed values at time t, see `Holds.check_stays`."""
        if self.holds.given.size:
            before = self.own(state.history, place)[:, VALUE]
            self.holds.check_stays(who, t, self.values(state.q.reshape(-1, 4, 3), before))

    def series(self, kinds: Collection[str], model: Any) -> dict[str, tuple[int, ...]]:
        """Return the shapes of coordinates with their forces, and of the energies that they exchange."""
        holds, names = self.holds, []
        if "joint" in kinds:
            names += ["joint_value", "joint_rate"]
            names += ["joint_drive"] * (holds.driven.size > 0) + ["joint_force"] * (holds.held.size > 0)
        if "energy" in kinds:
            names += ["joint_energy", "joint_loss", "joint_work", *["joint_friction"] * (holds.rubs.size > 0),
                      *["joint_stop_loss"] * holds.has_rigid_stops]
        return dict.fromkeys(names, (len(self.names),))

    def read(self, kinds: Collection[str], model: Any, t: float, state: State) -> dict[str, Array]:
        """Return coordinates, drive forces and energies of a state at time t."""
        own, out = self.own(state.history, model.place(self.key)), {}
        if "energy" in kinds:
            out = {"joint_energy": self.energy(own), "joint_loss": own[:, LOSS].copy(), "joint_work": own[:, WORK].copy(),
                   **self.holds.exchanged(state.history)}
        if "joint" in kinds:
            q, v = (x.reshape(-1, 4, 3) for x in (state.q, state.v))
            out["joint_value"], out["joint_rate"] = own[:, VALUE].copy(), self.rates(q, v)
            if self.holds.driven.size:
                out["joint_drive"] = self.holds.drive_forces(t, out["joint_value"], out["joint_rate"])
        return out

    def held_forces(self, model: Any, force: Array) -> Array:
        """Select the forces of the coordinates `Holds.held`, N or N m, from those of all constraints [F]."""
        end = 3 * model.n_sliders + sum(link.forces(3) for link in model.kept)
        return force[end - self.holds.held.size:end]

    def read_forces(self, kinds: Collection[str], model: Any, force: Array) -> dict[str, Array]:
        """Return the forces on all coordinates that are unknowns, zero for those without one."""
        if "joint" not in kinds or not self.holds.held.size:
            return {}
        return {"joint_force": self.holds.forces(self.held_forces(model, force))}

    def named(self, kinds: Collection[str]) -> dict[str, list[str]]:
        """Return the joint and the kind of every coordinate, and the joints with drives, and with forces that are unknowns."""
        driven, held = ([self.names[k] for k in which.tolist()] for which in (self.holds.driven, self.holds.held))
        out = {"joints": self.names, "coordinates": self.what, "driven": driven}
        return {**out, "held": held} if "joint" in kinds and held else out

    def booked(self, model: Any, state: State, row: Mapping[str, Any]) -> tuple[list[float], list[float]]:
        """Return the energy that dampers dissipated less the work of motors, then that of friction and of impacts, J, and sizes
        of these parts."""
        more = [name for name in ("joint_friction", "joint_stop_loss") if name in row]
        parts = [float(np.sum(row["joint_loss"]) - np.sum(row["joint_work"])), *(float(np.sum(row[name])) for name in more)]
        return parts, [float(np.sum(np.abs(row[name]))) for name in ("joint_loss", "joint_work", *more)]


def motions_of(links: Any, blocks: Any, row_of: Array, spin_root: Array, model: Any) -> Motions | None:
    """Build the feature of the joint coordinates of a scene; links: `links.Links`; model: that of the scene without them. None
    without coordinates."""
    parts, place = [x[0] for x in links.freedoms], model.place_for(Motions)
    if not parts:
        return None
    node = np.array([x[1] for x in links.freedoms], np.int64).reshape(-1, 2)
    # coordinates without forces have no blocks
    acts = links.acting
    bearing = bearing_nodes(node, np.array([x.shape.is_angle for x in parts], bool), spin_root)
    a, b = bearing[acts].T
    block = np.full((node.shape[0], 4), blocks.n_blocks)
    block[acts] = np.stack([blocks.between(i, j) for i in (a, b) for j in (a, b)], axis=1)
    turn = np.array([frame.turn for *_, frame in links.freedoms])
    kind = np.array([KINDS[x.shape.what] for x in parts], np.int64)
    products = [one for x in parts for one in x.shape.products]
    start = np.concatenate(([0], np.cumsum([len(x.shape.products) for x in parts]))).astype(np.int64)
    stiffness, damping, neutral = (np.array([getattr(x, name) for x in parts], float) for name in ("stiffness", "damping",
                                                                                                   "rest"))
    motors, count = [x.motor for x in parts], len(parts)
    laws = [Coordinate(x.shape, frame) for x, _, frame in links.freedoms]
    table = JointMotion(node, row_of[bearing], block, kind, spin_root[node], start, np.array([x[:3] for x in products], np.int64),
                        np.array([x.sign for x in products]), turn.reshape(-1), np.array([x.at_start for x in laws]),
                        place + MOTION * np.arange(count), stiffness, damping, neutral,
                        np.array([float(m) if m is not None and not callable(m) else 0.0 for m in motors]), np.zeros(64))
    holds = holds_of(parts, model.n_sliders + len(model.kept), place + MOTION * count, model.length)
    return Motions(table, np.arange(count), [x.name for x in parts], [x.label for x in parts], [x.shape.what for x in parts],
                    motors, turn, node, np.stack((stiffness, neutral), axis=1), table, laws, bool(np.any(damping)), holds)
