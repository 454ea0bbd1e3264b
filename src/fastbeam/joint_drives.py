"""Forces that hold what joints with axes leave free: given angles and distances, friction; and their stops. Tables, what is given
in every step, and what a run may start from."""
from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from .errors import SceneError
from .kernels.joint_drive import BY, RUB, RUBBED, SIGN, STICKS, TO, DriveTimes, JointDrives, JointFriction, KnownForces
from .kernels.joint_motion import JointForces, JointMotion, JointStops
from .kernels.terms import NoTies
from .load_times import factor_at, mean_factors

Array = np.ndarray
# a given value may be so far from where the joint stands at the start, m or rad, of a distance times the size of the scene: the
# first step closes it
JUMP = 1e-9
# an angle turns by less in a step, rad
HALF_TURN = np.pi * (1.0 - 1e-3)
# a rate below this share of the fastest motion is none
AT_REST = 1e-12


class JointsOfRun(NamedTuple):
    """Tables of the coordinates of joints with the arrays of one run."""

    motion: JointMotion
    forces: JointForces | None
    stops: JointStops | None
    drives: JointDrives | None
    friction: JointFriction | None

    @property
    def static_terms(self) -> tuple[Any, ...]:
        """What has a part in statics."""
        return tuple(x for x in (self.forces, self.stops) if x is not None)

    @property
    def terms(self) -> tuple[Any, ...]:
        """All, in the order in which they keep account: values that are held come after those that are found."""
        held = tuple(x for x in (self.drives, self.friction) if x is not None)
        return (*self.static_terms, self.motion, *held)

    @property
    def known(self) -> tuple[Any, ...]:
        """With the forces of the state instead of equations for them."""
        held = tuple(KnownForces(self.motion, x.which, x.first) for x in (self.drives, self.friction) if x is not None)
        return (*self.static_terms, *held)


@dataclass(frozen=True)
class Holds:
    """What holds and stops coordinates, of C that the joints of a scene leave free.

    Attributes
    ----------
    parts : list
        The joint of every coordinate.
    is_angle : bool [C]
    given, rubs, stopped : int64 [*]
        Coordinates that are given, that have friction, and that have stops.
    rows : int64 [*]
        Which of all coordinates the tables of this model have.
    first : int
        Number of the first of these constraints among all.
    place : int
        Where the numbers of friction stand in the history.
    length : float
        Size of the scene, m.
    """

    parts: list[Any]
    is_angle: Array
    given: Array
    rubs: Array
    stopped: Array
    rows: Array
    first: int
    place: int
    length: float

    @property
    def held(self) -> Array:
        """Coordinates with a force of their own, in the order of these."""
        return np.concatenate((self.given, self.rubs))

    @property
    def stops(self) -> Array:
        """Where stops begin, and their stiffness, float64 [*, 3]."""
        every = [self.parts[k].stops for k in self.stopped]
        return np.array([(*x.between, x.stiffness) for x in every]).reshape(-1, 3)

    @property
    def limits(self) -> Array:
        """Largest forces of friction, N or N m."""
        return np.array([float(self.parts[k].friction) for k in self.rubs])

    def in_plane(self, rows: Array, first: int) -> Holds:
        """With the coordinates that are left in a plane."""
        return replace(self, rows=rows, first=first)

    def _left(self, which: Array) -> tuple[Array, Array]:
        """Of some coordinates those that the model has: their places in its table, and in `which`."""
        mine = np.flatnonzero(np.isin(which, self.rows))
        return np.searchsorted(self.rows, which[mine]), mine

    # --- tables -------------------------------------------------------------------------------------------------------
    def tables(self, motion: JointMotion, acts: bool, ties: Any) -> JointsOfRun:
        """Of one run; acts: whether there are springs, dampers or motors."""
        ties = NoTies() if ties is None else ties
        (at_drive, mine), (at_rub, rubs), (at_stop, stopped) = (self._left(x) for x in (self.given, self.rubs, self.stopped))
        m, n = at_drive.size, at_rub.size
        drives = friction = stops = None
        if m:
            kind = np.array([TO if self.parts[k].speed is None else BY for k in self.given[mine]])
            drives = JointDrives(motion, at_drive, kind, np.array([self.first]), np.zeros(m), np.zeros(m), ties)
        if n:
            friction = JointFriction(motion, at_rub, self.limits[rubs], self.place + RUB * rubs, np.array([self.first + m]),
                                     *np.zeros((3, n)), *np.zeros((3, n), np.int64), np.zeros(1), ties)
        if at_stop.size:
            stops = JointStops(motion, at_stop, self.stops[stopped])
        return JointsOfRun(motion, JointForces(motion) if acts else None, stops, drives, friction)

    @property
    def has_functions(self) -> bool:
        """Whether a value that is given is a function of time."""
        return any(callable(self.parts[k].place) for k in self.given)

    # --- what is given ------------------------------------------------------------------------------------------------
    def value(self, k: int, t: float) -> float:
        """Given value of coordinate k at a time, m or rad; not of a given speed."""
        place = self.parts[k].place
        return factor_at(place, t, f"({self.parts[k].words[0]}) of {self.parts[k].label}") if callable(place) else float(place)

    def _mean(self, k: int, starts: Array, lengths: Array) -> Array:
        """Mean of a given speed over substeps."""
        speed = self.parts[k].speed
        if not callable(speed):
            return np.full(len(starts), float(speed))
        return mean_factors(speed, starts, lengths, f"(speed) of {self.parts[k].label}")

    def schedule(self, drives: JointDrives, starts: Array, lengths: Array, end: float) -> DriveTimes:
        """What is given in substeps that begin at `starts` and have these lengths [n]; the last ends at `end`.

        Raises
        ------
        SceneError
            A function fails, or a joint makes half a turn in a step.
        """
        mine = self.given[self._left(self.given)[1]]
        out = np.zeros((len(starts), mine.size))
        # a substep ends, to the last bit, where the next begins
        times = np.append(starts, end)
        for column, k in enumerate(mine.tolist()):
            if self.parts[k].speed is not None:
                way = out[:, column] = lengths * self._mean(k, starts, lengths)
            else:
                values = np.array([self.value(k, t) for t in times.tolist()])
                out[:, column], way = values[1:], np.diff(values)
            if self.is_angle[k] and np.any(np.abs(way) > HALF_TURN):
                raise SceneError(f"{self.parts[k].label}: it is to make half a turn or more in the step from t = "
                                 f"{times[int(np.argmax(np.abs(way)))]:.6g} s; use smaller steps")
        return DriveTimes(drives, out)

    # --- where a run starts -------------------------------------------------------------------------------------------
    def start(self, t: float, own: Array, found: Array) -> None:
        """Counted values in a history `own` [C] become those that are given at time t; found: those of the coordinates [C].

        Raises
        ------
        SceneError
            One stands elsewhere.
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
                raise SceneError(f"{part.label}: it stands at {found[k]:.6g} {unit}, its given {name} at t = {t:.6g} s is "
                                 f"{value:.6g} {unit}; let it begin with {found[k]:.6g} there, start at the time of the state "
                                 "(t_start=...), or from the equilibrium of solve_static, which goes there")
            own[k] = value

    def check_stays(self, who: str, t: float, found: Array) -> None:
        """Joints stay at their values `found` [C] where these are given at time t; who: the function that was called.

        Raises
        ------
        SceneError
            One would have to move.
        """
        try:
            self.start(t, found.copy(), found)
        except SceneError as error:
            raise SceneError(f"{who}: joints stay where they stand; {error}") from None

    def start_rubbing(self, own: Array, rates: Array, fastest: float) -> None:
        """Signs of the velocities of coordinates with friction into a history `own` [R, 3]; rates [C]; fastest: rate of the
        fastest motion. What a run before left at rest stays there."""
        for i, k in enumerate(self.rubs.tolist()):
            moves = abs(rates[k]) > AT_REST * fastest and own[i, STICKS] == 0.0
            own[i, SIGN] = np.sign(rates[k]) if moves else 0.0

    # --- at rows ------------------------------------------------------------------------------------------------------
    def stop_energy(self, values: Array) -> Array:
        """Energy that stops store, J, [C], at values [C]."""
        out = np.zeros(values.size)
        low, high, stiffness = self.stops.T
        x = values[self.stopped]
        out[self.stopped] = 0.5 * stiffness * (np.maximum(low - x, 0.0)**2 + np.maximum(x - high, 0.0)**2)
        return out

    def rubbed(self, history: Array) -> Array:
        """Energy that friction took, J, [C]; history from `place` on."""
        out = np.zeros(len(self.parts))
        out[self.rubs] = history[self.place:self.place + RUB * self.rubs.size].reshape(-1, RUB)[:, RUBBED]
        return out

    def forces(self, force: Array) -> Array:
        """Forces on all coordinates [C], N or N m, zero where there is none of its own; force: of all of these."""
        out = np.zeros(len(self.parts))
        out[self.held] = force
        return out


def holds_of(parts: list[Any], is_angle: Array, constraints: int, place: int, length: float) -> Holds:
    """parts: the joint of every coordinate; constraints: all of the scene but moments of sleeves; place: as of `Holds`."""
    every = np.arange(len(parts))
    given, rubs, stopped = (np.array([k for k in every if has(parts[k])], np.int64) for has in (
        lambda x: x.is_given, lambda x: x.friction > 0.0, lambda x: x.stops is not None))
    return Holds(parts, is_angle == 1, given, rubs, stopped, every, constraints - given.size - rubs.size, place, length)
