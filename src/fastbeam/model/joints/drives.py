"""Joint coordinates that are prescribed, driven, or have friction or stops: tables, inputs of every step, admissible states at
the start of a run."""
from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.kernels.contact.coulomb import coulomb_of
from fastbeam.kernels.contact.slider_forces import ASKED, CONTROL, LAST, LAW, begin_sides
from fastbeam.kernels.empty_arrays import empty
from fastbeam.kernels.joints.coordinates import JointMotion
from fastbeam.kernels.joints.drives import BY, TO, ControlTimes, DriveTimes, JointControl, JointDrives, KnownForces
from fastbeam.kernels.joints.forces import JointForces, JointStops
from fastbeam.kernels.joints.friction import AGAINST, RUB, RUBBED, SIGN, STICKS, STOP_LOSS, JointFriction
from fastbeam.kernels.terms import NoTies
from fastbeam.model.contact.drive_laws import force_at, gains_of, given_over, given_to, kind_of, law_of
from fastbeam.model.forces.loads import factor_at, mean_factors
from fastbeam.model.joints.constraints import ConstrainedJoint
from fastbeam.model.joints.coordinates import Coordinate
from fastbeam.model.mapping import HALF_TURN

Array = np.ndarray
# largest difference between a prescribed value and that of the joint at the start, rad or a share of the size of the scene; the
# first step closes it
JUMP = 1e-9
# rates below this share of the fastest motion count as zero
AT_REST = 1e-12
# largest distance beyond a rigid stop at the start, rad or a share of the size of the scene
AT_STOP = 1e-9


class JointsOfRun(NamedTuple):
    """Tables of the coordinates of joints with the arrays of one run."""

    motion: JointMotion
    forces: JointForces | None
    stops: JointStops | None
    drives: JointDrives | None
    friction: JointFriction | None
    control: JointControl | None

    @property
    def pushing(self) -> tuple[Any, ...]:
        """Terms with explicit forces: springs, motors, elastic stops and drives that push."""
        return tuple(x for x in (self.forces, self.stops, self.control) if x is not None)

    @property
    def static_terms(self) -> tuple[Any, ...]:
        """Terms of equilibria: friction and rigid stops fix coordinates as prescribed values do."""
        held = [x for x in (self.drives, self.friction) if x is not None]
        if not held:
            return self.pushing
        which = np.concatenate([x.which for x in held])
        return (*self.pushing, JointDrives(self.motion, which, np.full(which.size, TO), held[0].first, empty(which.size),
                                           empty(which.size), held[0].ties))

    @property
    def terms(self) -> tuple[Any, ...]:
        """Terms of a run in time, in the order of their accounts: those that hold or control coordinates follow `motion`."""
        pushing = tuple(x for x in (self.forces, self.stops) if x is not None)
        held = tuple(x for x in (self.drives, self.friction, self.control) if x is not None)
        return (*pushing, self.motion, *held)

    @property
    def known(self) -> tuple[Any, ...]:
        """Terms with constraint forces taken from the state instead of equations for them."""
        held = tuple(KnownForces(self.motion, x.which, np.ones(x.which.size), x.first[0] + np.arange(x.which.size))
                     for x in (self.drives, self.friction) if x is not None)
        return (*self.pushing, *held)

    def follow(self, other: JointsOfRun) -> None:
        """Copy the inputs of motors and drives from the last step of another run of the same model."""
        self.motion.given[:] = other.motion.given
        if self.control is not None and other.control is not None:
            self.control.given[:], self.control.clock[:] = other.control.given, other.control.clock
            self.control.share[:] = other.control.share
            begin_sides(self.control.drive_side)


@dataclass(frozen=True)
class Holds:
    """Prescribed coordinates, friction, stops and drives, for the C coordinates that the joints of a scene leave free."""

    parts: list[Any]  # all coordinates
    # given, rubs, stopped, driven, int64 [*]: coordinates that are prescribed, that have friction or rigid stops (R of them),
    # elastic stops, and drives
    given: Array
    rubs: Array
    stopped: Array
    driven: Array
    rows: Array  # int64 [*]: coordinates in the tables of this model
    first: int  # number of the first constraint of these coordinates among all constraints
    place: int  # offset of the history variables of friction
    length: float  # size of the scene, m
    laws: dict[int, int]  # addresses of compiled force laws of drives, by coordinate

    @property
    def is_angle(self) -> Array:
        """True for coordinates that are angles, bool [C]."""
        return np.array([x.shape.is_angle for x in self.parts], bool)

    @property
    def held(self) -> Array:
        """Coordinates with a multiplier, in the order of the multipliers."""
        return np.concatenate((self.given, self.rubs))

    @property
    def stops(self) -> Array:
        """Values at which elastic stops begin, and their stiffness, float64 [*, 3]."""
        every = [self.parts[k].stops for k in self.stopped]
        return np.array([(*x.between, x.stiffness) for x in every]).reshape(-1, 3)

    @property
    def limits(self) -> Array:
        """Load-independent part of the largest friction forces, N or N m, [R]."""
        return np.array([float(self.parts[k].friction) for k in self.rubs])

    @property
    def shares(self) -> Array:
        """Largest friction force for each N and each N m that joints carry across their axes, float64 [R, 2]."""
        return np.array([self.parts[k].shares for k in self.rubs]).reshape(-1, 2)

    @property
    def gains(self) -> Array:
        """Kind of every drive, then stiffness, damping and largest force of controllers, float64 [*, 4]."""
        every = [self.parts[k].drive for k in self.driven]
        return np.array([(kind_of(x), *gains_of(x)) for x in every]).reshape(-1, 4)

    # --- rigid stops --------------------------------------------------------------------------------------------------
    @property
    def ends(self) -> Array:
        """Values at the rigid stops of `rubs`, infinite where there are none, float64 [R, 2]."""
        every = [self.parts[k].stops for k in self.rubs]
        return np.array([(-np.inf, np.inf) if x is None or not x.is_rigid else x.between for x in every]).reshape(-1, 2)

    @property
    def scales(self) -> Array:
        """Reference size of every coordinate of `rubs`, 1 rad or the size of the scene in m, [R]."""
        return np.where(self.is_angle[self.rubs], 1.0, self.length)

    def restitution(self, i: int, at_end: bool) -> float | None:
        """Return the coefficient of restitution of the last or first rigid stop of coordinate `rubs[i]`; None without a stop."""
        return None if np.isinf(self.ends[i, int(at_end)]) else self.parts[self.rubs[i]].stops.restitution or 0.0

    @property
    def has_rigid_stops(self) -> bool:
        """True if a coordinate has rigid stops."""
        return bool(np.any(np.isfinite(self.ends)))

    @property
    def restitutions(self) -> Array:
        """Coefficients of restitution of all rigid stops, -1 where there is no stop, float64 [R, 2]."""
        found = [[self.restitution(i, at_end) for at_end in (False, True)] for i in range(self.rubs.size)]
        return np.array([[-1.0 if x is None else x for x in both] for both in found]).reshape(-1, 2)

    def named(self, i: int) -> tuple[str, str]:
        """Return 'joint', and the name of that to which coordinate `rubs[i]` belongs."""
        return "joint", self.parts[self.rubs[i]].name

    def loose(self, history: Array) -> Array:
        """Return a mask, bool [R], of the coordinates `rubs` that are free in small motions about a state at rest: no friction,
        off stops."""
        rubs = np.array([self.parts[k].has_friction for k in self.rubs], bool)
        return np.asarray(~rubs & (self.numbers(history)[:, AGAINST] == 0.0))

    def numbers(self, history: Array) -> Array:
        """Return a view of the history variables of friction and rigid stops, float64 [R, 5]."""
        return history[self.place:self.place + RUB * self.rubs.size].reshape(-1, RUB)

    def in_plane(self, rows: Array, first: int) -> Holds:
        """Return a copy for the coordinates `rows` that are left in a plane; first: number of their first constraint."""
        return replace(self, rows=rows, first=first)

    def _left(self, which: Array) -> tuple[Array, Array]:
        """Select the coordinates in `which` that the tables have: their rows in the tables, and their places in `which`."""
        mine = np.flatnonzero(np.isin(which, self.rows))
        return np.searchsorted(self.rows, which[mine]), mine

    def pushed(self, i: int) -> Any:
        """Return the coordinate of drive i among those that push."""
        return self.parts[int(self.driven[self._left(self.driven)[1]][i])]

    # --- tables -------------------------------------------------------------------------------------------------------
    def tables(self, motion: JointMotion, acts: bool, model: Any) -> JointsOfRun:
        """Build the tables of one run of a model; acts: true if there are springs, dampers or motors."""
        ties, kept, n_sliders = NoTies() if model.ties is None else model.ties, model.kept, model.n_sliders
        every = self.given, self.rubs, self.stopped, self.driven
        (at_drive, mine), (at_rub, rubs), (at_stop, stopped), (at_control, driven) = (self._left(x) for x in every)
        m, n = at_drive.size, at_rub.size
        drives = friction = stops = control = None
        if m:
            kind = np.array([TO if self.parts[k].speed is None else BY for k in self.given[mine]])
            drives = JointDrives(motion, at_drive, kind, np.array([self.first]), empty(m), empty(m), ties)
        if n:
            press = np.array([self._press(k, kept, n_sliders) for k in self.rubs[rubs]])
            # the force of another joint fixes a point that runs along a line, across an axis of that joint
            across = np.array([kept[j - n_sliders].node[0] if j >= 0 and kept[j - n_sliders].law.is_vector
                               and not self.is_angle[k] else -1 for k, (j, _) in zip(self.rubs[rubs], press.tolist())])
            friction = JointFriction(motion, at_rub, self.limits[rubs], self.shares[rubs], press, across,
                                     np.array([self.parts[k].smoothing for k in self.rubs[rubs]]),
                                     np.isin(self.rubs[rubs], self.given).astype(np.int64), self.ends[rubs],
                                     self.place + RUB * rubs, np.array([self.first + m]), *empty((3, n)),
                                     coulomb_of(model.mass * (self.length / self.scales[rubs])**2), np.zeros((n, LAST), np.int64),
                                     empty(1), ties)
        if at_stop.size:
            stops = JointStops(motion, at_stop, self.stops[stopped])
        if at_control.size:
            gains, d = self.gains[driven], at_control.size
            law = np.array([self.laws.get(k, 0) for k in self.driven[driven].tolist()], np.int64)
            control = JointControl(motion, at_control, gains[:, 0].astype(np.int64), np.ascontiguousarray(gains[:, 1:]), law,
                                   np.zeros((d, ASKED)), empty((d, 2)), empty(2), empty(d), np.ones(1), np.zeros(d),
                                   np.zeros((d, LAST), np.int64))
        return JointsOfRun(motion, JointForces(motion) if acts else None, stops, drives, friction, control)

    def _press(self, k: int, kept: list[ConstrainedJoint], n_sliders: int) -> tuple[int, int]:
        """Return the numbers of the constraints with the forces and the moments of the joint of coordinate k, -1: none."""
        mine = ConstrainedJoint(self.parts[k].joint.label, (0, 0), kept[0].law).joint
        of_joint = [(j, link) for j, link in enumerate(kept)
                    if link.joint == mine and not link.coupled and not isinstance(link.law, Coordinate)]
        found = [next((n_sliders + j for j, link in of_joint if link.law.is_angle == turns), -1) for turns in (False, True)]
        return found[0], found[1]

    def left_of_rubs(self) -> Array:
        """Return the places in `rubs` of the coordinates that the tables of this model have."""
        return self._left(self.rubs)[1]

    def left_of_held(self) -> Array:
        """Return the places in `held` of the coordinates that the tables of this model have."""
        return np.concatenate((self._left(self.given)[1], self.given.size + self._left(self.rubs)[1]))

    @property
    def has_functions(self) -> bool:
        """True if an equilibrium depends on the time of a prescribed value, a motor or a drive."""
        return self.pushes_in_time or any(callable(x.place) for x in self.parts)

    @property
    def pushes_in_time(self) -> bool:
        """True if forces in an equilibrium depend on the time of a motor or a drive."""
        return any(callable(x.motor) or x.drive is not None and any(callable(f) for f in (x.drive.position, x.drive.force))
                   for x in self.parts)

    def at_rest(self, control: JointControl, t: float, share: float) -> None:
        """Set the inputs of drives that push for an equilibrium at time t, with load factor `share`; rates are zero."""
        control.clock[:], control.share[0] = (np.inf, t), share
        for i, k in enumerate(self.driven[self._left(self.driven)[1]].tolist()):
            control.given[i] = given_to(self.parts[k].drive, self.parts[k].label, t, 0.0)[0], 0.0

    # --- prescribed values and inputs of drives -----------------------------------------------------------------------
    def value(self, k: int, t: float) -> float:
        """Evaluate the prescribed value of coordinate k at a time, m or rad; not for a prescribed speed."""
        place = self.parts[k].place
        return factor_at(place, t, f"({self.parts[k].words[0]}) of {self.parts[k].label}") if callable(place) else float(place)

    def _mean(self, k: int, starts: Array, lengths: Array) -> Array:
        """Average a prescribed speed over substeps."""
        speed = self.parts[k].speed
        if not callable(speed):
            return np.full(len(starts), float(speed))
        return mean_factors(speed, starts, lengths, f"(speed) of {self.parts[k].label}")

    def schedule(self, drives: JointDrives, starts: Array, lengths: Array, end: float) -> DriveTimes:
        """Tabulate prescribed values for substeps that begin at `starts` and have these lengths [n]; the last ends at `end`.

        Raises SceneError: a function fails, or a joint makes half a turn in a step.
        """
        mine = self.given[self._left(self.given)[1]]
        out = np.zeros((len(starts), mine.size))
        # a substep ends, to the last bit, at the time at which the next begins
        times = np.append(starts, end)
        for column, k in enumerate(mine.tolist()):
            if self.parts[k].speed is not None:
                increments = out[:, column] = lengths * self._mean(k, starts, lengths)
            else:
                values = np.array([self.value(k, t) for t in times.tolist()])
                out[:, column], increments = values[1:], np.diff(values)
            if self.is_angle[k] and np.any(np.abs(increments) > HALF_TURN):
                raise SceneError(f"{self.parts[k].label}: its prescribed motion turns by half a turn or more in the step from t "
                                 f"= {times[int(np.argmax(np.abs(increments)))]:.6g} s; use smaller steps")
        return DriveTimes(drives, out)

    def controls(self, control: JointControl, starts: Array, lengths: Array) -> ControlTimes:
        """Tabulate the inputs of drives that push for these substeps."""
        mine = self.driven[self._left(self.driven)[1]].tolist()
        out = np.zeros((len(starts), len(mine), 2))
        for column, k in enumerate(mine):
            part = self.parts[k]
            kind = LAW if k in self.laws else kind_of(part.drive)
            out[:, column] = given_over(part.drive, kind, part.label, starts, lengths)
        return ControlTimes(control, out, starts + 0.5 * lengths)

    # --- start of a run -----------------------------------------------------------------------------------------------
    def start(self, t: float, own: Array, found: Array) -> None:
        """Set prescribed coordinates in a history `own` [C] to their values at time t; found: values of the coordinates [C].

        Raises SceneError: a coordinate differs from its prescribed value.
        """
        for k in self.given.tolist():
            part = self.parts[k]
            if part.speed is not None:
                continue
            value = self.value(k, t)
            off = found[k] - value
            if self.is_angle[k]:
                off -= 2.0 * np.pi * np.round(off / (2.0 * np.pi))
            if not abs(off) <= JUMP * (1.0 if self.is_angle[k] else self.length):
                name, _, unit = part.words
                statics = "" if name == "position" else ", or from the equilibrium of solve_static, which satisfies it"
                raise SceneError(f"{part.label}: its value is {found[k]:.6g} {unit}, but its prescribed {name} at t = {t:.6g} s "
                                 f"is {value:.6g} {unit}. Let that begin with {found[k]:.6g}, start at the time of the state "
                                 f"(Start(state, time=...)){statics}")
            own[k] = value

    def check_stays(self, who: str, t: float, found: Array) -> None:
        """Check that joints at `found` [C] stand at their prescribed values at time t; who: the function that was called.

        Raises SceneError: a coordinate would have to move.
        """
        try:
            self.start(t, found.copy(), found)
        except SceneError as error:
            raise SceneError(f"{who}: joints keep their angles and distances; {error}") from None

    def start_rubbing(self, own: Array, rates: Array, fastest: float) -> None:
        """Set the signs of the velocities of coordinates with friction in a history `own` [R, 5]; rates [C]; fastest: rate of the
        fastest motion. Coordinates that the run before left at rest stay at rest."""
        for i, k in enumerate(self.rubs.tolist()):
            moves = abs(rates[k]) > AT_REST * fastest and own[i, STICKS] == 0.0 and own[i, AGAINST] == 0.0
            own[i, SIGN] = np.sign(rates[k]) if moves else 0.0

    def check_within(self, found: Array) -> None:
        """Check that coordinates at their values `found` [C] are between rigid stops.

        Raises SceneError: a coordinate is beyond its stops.
        """
        for (low, high), scale, k in zip(self.ends, self.scales, self.rubs.tolist()):
            if not low - AT_STOP * scale <= found[k] <= high + AT_STOP * scale:
                name, _, unit = self.parts[k].words
                raise SceneError(f"{self.parts[k].label}: its {name} of {found[k]:.6g} {unit} at the start lies beyond its stops "
                                 f"({low:.6g} to {high:.6g} {unit}); start from a state between them")

    # --- at rows ------------------------------------------------------------------------------------------------------
    def stop_energy(self, values: Array) -> Array:
        """Return the energy that elastic stops store, J, [C], at values [C]."""
        out = np.zeros(values.size)
        low, high, stiffness = self.stops.T
        x = values[self.stopped]
        out[self.stopped] = 0.5 * stiffness * (np.maximum(low - x, 0.0)**2 + np.maximum(x - high, 0.0)**2)
        return out

    def stop_forces(self, values: Array) -> Array:
        """Return the forces of elastic stops, N or N m, [C], at values [C]."""
        out = np.zeros(values.size)
        low, high, stiffness = self.stops.T
        x = values[self.stopped]
        out[self.stopped] = stiffness * (np.maximum(low - x, 0.0) - np.maximum(x - high, 0.0))
        return out

    def exchanged(self, history: Array) -> dict[str, Array]:
        """Return the energies that friction and impacts dissipated, J, [C], as series."""
        out = {}
        for name, column, is_there in (("joint_friction", RUBBED, True), ("joint_stop_loss", STOP_LOSS, self.has_rigid_stops)):
            if self.rubs.size and is_there:
                out[name] = np.zeros(len(self.parts))
                out[name][self.rubs] = self.numbers(history)[:, column]
        return out

    def drive_forces(self, t: float, values: Array, rates: Array) -> Array:
        """Evaluate the forces of drives that push at time t, N or N m, on all coordinates [C], at values and rates [C]."""
        out = np.zeros(len(self.parts))
        for k in self.driven.tolist():
            out[k] = force_at(self.parts[k].drive, self.parts[k].label, t, float(values[k]), float(rates[k]))
        return out

    @property
    def kinks(self) -> list[str]:
        """Friction and impacts, whose forces have kinks in time, for messages."""
        return [f"{'friction' if self.parts[k].has_friction else 'impacts on rigid stops'} of {self.parts[k].label}"
                for k in self.rubs.tolist()]

    @property
    def heeding(self) -> list[str]:
        """Drives that depend on rates, for messages."""
        return [f"the drive of {self.parts[k].label}, which depends on its rate," for k in self.driven[self.heeds_rates].tolist()]

    @property
    def heeds_rates(self) -> Array:
        """True for drives that may depend on the rates of their coordinates, bool [*]."""
        kind, _, damping, _ = self.gains.T
        return np.asarray((kind == LAW) | (kind == CONTROL) & (damping > 0.0))

    @property
    def is_bounded(self) -> bool:
        """True if a controller has a largest force: the force has a kink in time where it is reached."""
        kind, limit = self.gains[:, 0], self.gains[:, 3]
        return bool(np.any((kind == CONTROL) & np.isfinite(limit)))

    def forces(self, force: Array) -> Array:
        """Expand multipliers of the coordinates `held` to forces on all coordinates [C], N or N m, zero for those without one."""
        out = np.zeros(len(self.parts))
        np.add.at(out, self.held, force)
        return out


def holds_of(parts: list[Any], constraints: int, place: int, length: float) -> Holds:
    """Collect the coordinates that are prescribed, driven, or have friction or stops; parts: all coordinates; constraints: number
    in the scene but moments of sleeves; place: as in `Holds`.

    Raises SceneError: the force of a drive cannot be compiled.
    """
    every = np.arange(len(parts))
    given, rubs, stopped, driven = (np.array([k for k in every if has(parts[k])], np.int64) for has in (
        lambda x: x.is_given, lambda x: x.may_stick, lambda x: x.stops is not None and not x.stops.is_rigid,
        lambda x: x.drive is not None))
    laws = {k: law_of(parts[k].drive, parts[k].label) for k in driven.tolist() if kind_of(parts[k].drive) == LAW}
    return Holds(parts, given, rubs, stopped, driven, every, constraints - given.size - rubs.size, place, length, laws)
