"""Friction, drives, stops and locks of sliders: tables, inputs of drives in every step, and forces at rows."""
from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.kernels.contact.coulomb import coulomb_of
from fastbeam.kernels.contact.slider_forces import (
    AGAINST,
    ASKED,
    BY_RATE,
    CAME_BY,
    CONTROL,
    DRIVE_WORK,
    FORCE,
    FRICTION_LOSS,
    HELD,
    HISTORY,
    INCREMENT,
    LAST,
    LAW,
    LOCK_LOSS,
    LOCKED,
    MOST_KEPT,
    NO_DRIVE,
    OFF,
    OFFSET,
    POSITION,
    SIGN,
    STIFFNESS,
    STOP_LOSS,
    TURNS,
    Along,
    DriveSchedule,
)
from fastbeam.kernels.empty_arrays import empty
from fastbeam.kernels.state import State
from fastbeam.model.analyses import AT_REST, Analysis, Asked, Lack, dissipating, lacking, unknown_to_methods, without_adjoint
from fastbeam.model.contact.drive_laws import (
    force_at,
    gains_of,
    given_over,
    given_to,
    kind_of,
    law_at,
    law_of,
    slope_at_rest,
    value_at,
)
from fastbeam.model.feature import Feature, Span, Stand
from fastbeam.scene import Drive, Path, Slider, Switch
from fastbeam.scene.switches import AT_END, Arrival, span_of, stops_on

Array = np.ndarray
# largest distance between a prescribed position and its slider in the scene, as a share of the length of the beam
AT_START = 1e-9
# largest distance between a prescribed position and its slider in the state that a run starts from, as a share of that length
JUMP = 1e-6
# series of energies, and columns of the history with energies that were dissipated
ENERGIES = "friction_loss", "drive_work", "stop_energy", "stop_loss", "lock_loss"
LOSSES = FRICTION_LOSS, STOP_LOSS, LOCK_LOSS
# names of dissipating forces, for messages
DISSIPATION = "friction, damping, forces of (t, s, rate) and rigid stops of sliders"


@dataclass
class AtRow:
    """Forces along the beam at one time, N, on the sliding points in the direction of growing s; all [S]."""

    along: Array
    friction: Array
    drive: Array
    stop: Array
    lock: Array


def _not_at_rest(analyses: tuple[Analysis, ...], what: str, some: Callable[[SliderForces], Array]) -> Lack:
    """Declare that analyses at rest do not support some sliders, unless these are locked."""
    def names(forces: SliderForces, asked: Asked) -> list[str]:
        return [forces.sliders[k].name for k in np.flatnonzero(some(forces) & ~asked.held)]
    return Lack(analyses, what, "{who}: slider {name!r} has " + what + ", which equilibria do not support",
                "lock it at its place with held=({name!r},), leave that out for the equilibrium, or run until it comes to "
                "rest", names)


def _without_adjoint(what: str, has: Callable[[Slider], bool]) -> Lack:
    """Declare that steps have no adjoint for some sliders."""
    return without_adjoint(what, lambda forces, asked: [f"{what} of slider {x.name!r}" for x in forces.sliders if has(x)])


class SliderForces(Feature):
    """Forces along the beam on all S sliders of a scene; at least one slider has some. Raises SceneError: a function of a drive
    cannot be compiled."""

    key, title, order = "slider_forces", "friction, drives, stops, locks, releases of sliders", 10
    lacks = (
        unknown_to_methods("friction, drives, stops, locks and releases of sliders"),
        Lack((Analysis.ORDER_4,), "locks, releases, one-sided contact",
             "order=4: where a slider is locked, released or lifts off, velocities are of second order only, and so is the "
             "motion after it",
             "use order=2", lambda forces, asked: ["sliders"] * forces.lets_go),
        dissipating("Coulomb friction, rigid stops", lambda forces, asked: [DISSIPATION] * forces.has_kinks, kinked=True),
        dissipating("switches, where something dissipates", lambda forces, asked: ["sliders on switches"] * bool(
            asked.model.spans and any(lacking(Analysis.COMPOSED, asked.model))), kinked=True),
        dissipating("viscous friction, drives by velocity", lambda forces, asked: [DISSIPATION] * forces.dissipates),
        Lack((*(x for x in AT_REST if x is not Analysis.EXACT), Analysis.TRAVEL), "a start away from the beam",
             "{who}: slider {name!r} begins away from its beam, where it has no equilibrium",
             "let it begin on the beam, or run until it comes to rest",
             lambda forces, asked: [x.name for x in forces.sliders if x.starts_off]),
        _not_at_rest((Analysis.STATIC, Analysis.STICK, Analysis.MODES), "a lock or may leave its beam",
                     lambda forces: forces.lets_go_of),
        _not_at_rest((Analysis.PATH, Analysis.RELAX, Analysis.SENSITIVITY),
                     "Coulomb friction, a prescribed motion, rigid stops, a lock, a switch, or may leave its beam",
                     lambda forces: forces.is_rough),
        _not_at_rest((Analysis.LENGTHS, Analysis.TRAVEL), "friction, a drive, stops, a lock or may leave its beam",
                     lambda forces: np.array([not x.slides_freely for x in forces.sliders])),
        Lack((Analysis.TIMELESS, Analysis.TIMELESS_SHAPES), "drives by functions of time", "{who}: drives have time functions, "
                                                                                           "so a time is needed",
             "give one time with at_time=t",
             lambda forces, asked: ["drives"] * forces.has_functions(~asked.held)),
        Lack((Analysis.TIMELESS_MODES,), "drives that push, by functions of time", "{who}: drives have time functions, so a time "
                                                                                   "is needed",
             "give one time with at_time=t",
             lambda forces, asked: ["drives"] * forces.has_functions(~asked.held & ~forces.is_prescribed)),
        _without_adjoint("locks", lambda slider: slider.lock is not None),
        _without_adjoint("releases", lambda slider: slider.release is not None),
        _without_adjoint("one-sided contact", lambda slider: slider.one_sided is not None),
        _without_adjoint("tracks of a switch", lambda slider: isinstance(slider.beam, Switch)),
        _without_adjoint("rigid stops (elastic ones, stiffness=, have one)",
                         lambda slider: slider.stops is not None and slider.stops.is_rigid))

    def __init__(self, sliders: list[Slider]) -> None:
        self.sliders = sliders
        n = len(sliders)
        self.tables = Along(*(np.zeros(n) for _ in range(3)), np.zeros((n, 3)), np.zeros(n, np.int64), np.zeros((n, 3)),
                            np.zeros(n, np.int64), np.zeros((n, ASKED)), np.zeros((n, 2)), np.zeros(3), np.zeros(n),
                            coulomb_of(np.ones(n)), *np.zeros((2, n, LAST), np.int64), np.zeros(n, np.int64), np.zeros(n),
                            np.zeros((n, 2), np.int64), np.zeros(n), np.zeros((n, MOST_KEPT, 4)))
        for k, slider in enumerate(sliders):
            self._fill(k, slider)

    def _fill(self, k: int, slider: Slider) -> None:
        t, friction, drive, stops = self.tables, slider.friction, slider.drive, slider.stops
        if friction is not None:
            t.friction[k], t.viscous[k], t.smoothing[k] = friction.coefficient, friction.viscous, friction.smoothing or 0.0
        t.stops[k, :2] = -np.inf, np.inf
        if stops is not None and stops.stiffness is not None:
            t.stops[k] = *self._between(k, slider.at, np.zeros(HISTORY)), stops.stiffness
        t.drive[k] = kind_of(drive)
        if drive is None:
            return
        if t.drive[k] == CONTROL:
            t.gains[k] = gains_of(drive)
        elif t.drive[k] == LAW:
            t.law[k] = law_of(drive, f"slider {slider.name!r}")
        t.given[k] = given_to(drive, f"slider {slider.name!r}", 0.0, 0.0)

    @property
    def timed(self) -> bool:
        """True if a drive needs the time of a step."""
        return any(x is not None and x.is_timed for x in self._drives)

    @property
    def _drives(self) -> list[Drive | None]:
        return [slider.drive for slider in self.sliders]

    @property
    def lets_go_of(self) -> Array:
        """True for sliders that are locked at some time or may leave their beam, bool [S]."""
        return np.array([not (x.lock is None and x.release is None and x.one_sided is None) for x in self.sliders])

    @property
    def is_rough(self) -> Array:
        """True for sliders whose place at rest is no smooth function of the loads, bool [S]: friction, rigid stops, a lock, a
        release or a prescribed motion, or a switch."""
        rough = [isinstance(x.beam, Switch) or x.stops is not None and x.stops.is_rigid for x in self.sliders]
        return self.lets_go_of | self.hold_by_friction | np.array(rough) | self.is_prescribed

    @property
    def is_prescribed(self) -> Array:
        """True for sliders whose drive prescribes the motion, bool [S]."""
        return np.isin(self.tables.drive, (POSITION, INCREMENT))

    @property
    def hold_by_friction(self) -> Array:
        """True for sliders that Coulomb friction can hold at rest, bool [S]."""
        t = self.tables
        return (t.friction > 0.0) & (t.smoothing == 0.0) & ~self.is_prescribed

    def has_functions(self, of: Array) -> bool:
        """Return whether drives of some sliders, bool [S], are functions of time alone that act on sliders at rest."""
        return any(x is not None and not x.takes_state and (callable(x.position) or callable(x.force))
                   for x, mine in zip(self._drives, of) if mine)

    @property
    def has_kinks(self) -> bool:
        """True if Coulomb friction or rigid stops act, whose forces have kinks in time."""
        return bool(np.any(self.tables.friction > 0.0)) or any(x.stops is not None and x.stops.is_rigid for x in self.sliders)

    @property
    def dissipates(self) -> bool:
        """True if friction, a damping drive, a force law or a rigid stop dissipates energy."""
        t = self.tables
        return self.has_kinks or bool(np.any(t.viscous > 0.0) or np.any(t.gains[:, BY_RATE] > 0.0) or np.any(t.law))

    @property
    def exchanges(self) -> bool:
        """True if forces along beams change the total energy: there is more than elastic stops."""
        return self.dissipates or bool(np.any(self.tables.drive != NO_DRIVE)) or self.lets_go

    @property
    def lets_go(self) -> bool:
        """True if sliders are locked at some time or may leave their beams."""
        return bool(self.lets_go_of.any())

    @property
    def leaves(self) -> bool:
        """True if a slider may leave its beam."""
        return any(x.release is not None or x.one_sided is not None for x in self.sliders)

    @property
    def locked_at_start(self) -> Array:
        """True for sliders that are locked from the start, bool [S]."""
        return np.array([x.lock is not None and x.lock[0].from_start for x in self.sliders])

    @property
    def initial_history(self) -> Array:
        """History variables of the sliders at the start, float64 [11 S]."""
        out = np.zeros((len(self.sliders), HISTORY))
        locked = self.locked_at_start
        out[locked, HELD], out[locked, TURNS] = LOCKED, 1.0
        out[[x.starts_off for x in self.sliders], HELD] = OFF
        return out.reshape(-1)

    @property
    def plan(self) -> Array:
        """Conditions of locks, releases and one-sided contacts as numbers: times, places and constants, NaN for other conditions;
        float64 [*]."""
        out: list[float] = []
        for slider in self.sliders:
            waits: list[Any] = [x for lock in slider.lock or () for x in (lock.when, lock.at, lock.until)]
            waits += [] if slider.release is None else [slider.release.when]
            waits += [] if slider.one_sided is None else [*slider.one_sided.side.tolist(), slider.one_sided.restitution,
                                                              float(slider.one_sided.catch)]
            out += [x if isinstance(x, float) else np.nan for x in waits] + [np.inf]
        return np.array(out)

    @property
    def choices(self) -> str:
        """Tracks that sliders on switches choose, their stops and locks, as a text that says of functions only that they
        exist."""
        switches = [x.beam for x in self.sliders if isinstance(x.beam, Switch)]
        chosen = [sorted(x.choose.items()) if isinstance(x.choose, dict) else x.choose for x in switches]
        places = [[x.stops and (x.stops.start, x.stops.end), *(lock.at for lock in x.lock or ())] for x in self.sliders
                  if isinstance(x.beam, Switch)]
        return repr([places, *(([track.name for track in x.tracks], "function" if callable(y) else y)
                               for x, y in zip(switches, chosen))])

    opens = True

    def start_history(self, own: Array, q: Array, v: Array) -> None:
        """Put the history variables of the start into `own`."""
        own[:] = self.initial_history

    @property
    def history_size(self) -> int:
        """Number of history variables of all sliders."""
        return HISTORY * len(self.sliders)

    def work(self, model: Any, plane: Any, static: bool) -> Along | None:
        """Return the tables with the arrays of one run in time."""
        if static:
            return None
        self.tables.clock[2] = model.mass
        return self.tables._replace(coulomb=coulomb_of(np.full(len(self.sliders), model.mass)), **{
            name: getattr(self.tables, name).copy() for name in (
                "stops", "asked", "given", "clock", "drive_side", "rub_side", "held", "offset", "under")},
            **{name: empty(getattr(self.tables, name).shape) for name in ("needed", "taken", "shapes")})

    @cached_property
    def sides(self) -> list[Array]:
        """Direction in which every slider may lift off, in the triads of the nodes of its curve, float64 [n, 3] each; n = 0 for
        sliders that may not. Raises SceneError: on a path the direction is along one of the beams, or returns as another one
        around a closed path."""
        return [np.zeros((0, 3)) if slider.one_sided is None else sides_of(slider) for slider in self.sliders]

    def free_range(self, limits: Array) -> Array:
        """Return the arc lengths between which no stop acts on sliders, from their limits [S, 2]."""
        out = limits.copy()
        for k, slider in enumerate(self.sliders):
            if slider.stops is not None and not isinstance(slider.beam, Switch):
                out[k] = np.clip(slider.stops.between, *limits[k])
        return out

    # --- stops at the places of sliders -------------------------------------------------------------------------------
    def _between(self, k: int, s: float, own: Array) -> tuple[float, float]:
        """Return the arc lengths of the stops around slider k at s, by its history [11]; infinite where there are none."""
        stops, on = self.sliders[k].stops, self.sliders[k].beam
        if stops is None:
            return -np.inf, np.inf
        if not isinstance(on, Switch):
            return stops.between
        return stops_on(on, stops, span_of(on, s), Arrival(float(own[OFFSET]), float(own[CAME_BY])))

    def elastic(self, s: Array, history: Array) -> Array:
        """Return the arc lengths at which elastic stops begin, float64 [S, 2]; history [S, 11]."""
        out = self.tables.stops[:, :2].copy()
        for k, slider in enumerate(self.sliders):
            if isinstance(slider.beam, Switch) and self.tables.stops[k, STIFFNESS] > 0.0:
                out[k] = self._between(k, float(s[k]), history[k])
        return out

    def speed_given(self, k: int, t: float) -> float:
        """Evaluate the velocity that a drive prescribes at time t, m/s."""
        return value_at(self.sliders[k].drive, self._who(k), "speed", t)

    def _who(self, k: int) -> str:
        return f"slider {self.sliders[k].name!r}"

    # --- inputs of drives ---------------------------------------------------------------------------------------------
    def schedules(self, span: Span) -> list[tuple[Stand, Any]]:
        """Tabulate the inputs of drives for the steps of a span."""
        if not self.timed:
            return []
        return [(Stand.DRIVES, DriveSchedule(span.own[self.key], *self.schedule(span.starts, span.lengths)))]

    def schedule(self, starts: Array, lengths: Array) -> tuple[Array, Array]:
        """Tabulate the inputs of all drives for substeps from times `starts` on, of these lengths [n]: (float64 [n, S, 2], times
        of their middle [n])."""
        out = np.zeros((len(starts), len(self.sliders), 2))
        for k, (drive, kind) in enumerate(zip(self._drives, self.tables.drive.tolist())):
            if kind != NO_DRIVE:
                out[:, k] = given_over(drive, kind, self._who(k), starts, lengths)
        return out, starts + 0.5 * lengths

    # --- rigid stops --------------------------------------------------------------------------------------------------
    def limits(self, ends: Array, s: Array, history: Array) -> Array:
        """Return the arc lengths between which sliders at s [S] may go: `ends` [S, 2] of their tracks, or rigid stops; history
        [S, 11]."""
        out = ends.copy()
        for k, slider in enumerate(self.sliders):
            if slider.stops is not None and slider.stops.is_rigid:
                out[k] = np.clip(self._between(k, float(s[k]), history[k]), *ends[k])
        return out

    @property
    def restitutions(self) -> Array:
        """Coefficients of restitution of the rigid stops of all sliders at both ends, on whatever track, -1 where there is none,
        float64 [S, 2]."""
        out = np.full((len(self.sliders), 2), -1.0)
        for k, slider in enumerate(self.sliders):
            stops = slider.stops
            if stops is not None and stops.is_rigid:
                there = [x is not None for x in (stops.start, stops.end)]
                # a slider behind a stop on a track meets the stop from the other side
                out[k, any(there) if stops.on_tracks else there] = stops.restitution or 0.0
        return out

    def restitutions_at(self, s: Array, history: Array) -> Array:
        """Return the coefficients of restitution of the stops that sliders at s meet on their tracks, as in `restitutions`;
        history [S, 11]."""
        found = [[self.restitution(k, at_end, float(x), own) for at_end in (False, True)]
                 for k, (x, own) in enumerate(zip(s, history))]
        return np.array([[-1.0 if x is None else x for x in both] for both in found])

    def check_start(self, t: float, s: Array, history: Array) -> None:
        """Check that sliders stand at their prescribed positions at the time t at which a run starts. Raises SceneError: a slider
        would jump."""
        for k in np.flatnonzero(self.tables.drive == POSITION).tolist():
            slider, place = self.sliders[k], self.place_given(k, t, history[k])
            if abs(place - s[k]) > JUMP * slider.beam.length:
                raise SceneError(f"slider {slider.name!r} is at s = {s[k]:.6g} m, but its drive prescribes {place:.6g} m at t = "
                                 f"{t:.6g} s; start at the time of the state (Start(state, time=...)), or let the "
                                 "position begin there")

    def restitution(self, k: int, at_end: bool, s: float, own: Array) -> float | None:
        """Return the coefficient of restitution of the rigid stop of slider k, at s, at its end or start; None where there is no
        stop; own [11]: history of the slider."""
        stops, on = self.sliders[k].stops, self.sliders[k].beam
        if stops is None or not stops.is_rigid:
            return None
        wall = self._between(k, s, own)[int(at_end)]
        if not np.isfinite(wall):
            return None
        if isinstance(on, Switch):
            begin, end = on.spans[span_of(on, s)]
            slack = AT_END * float(end - begin)
            if not begin - slack <= wall <= end + slack:
                return None
        return stops.restitution or 0.0

    # --- rows ---------------------------------------------------------------------------------------------------------
    def series(self, kinds: Collection[str], model: Any) -> dict[str, tuple[int, ...]]:
        """Return the shapes of forces along the beam, and of energies."""
        along = ("slide_rate", "force_along", "friction_force", "drive_force", "stop_force", "lock_force")
        return dict.fromkeys((*(along if "slider" in kinds else ()), *ENERGIES), (len(self.sliders),)) if {
            "slider", "energy"} & set(kinds) else {}

    def read(self, kinds: Collection[str], model: Any, t: float, state: State) -> dict[str, Array]:
        """Return the energies of a state."""
        if not {"slider", "energy"} & set(kinds):
            return {}
        history = model.own(state.history, self.key).reshape(-1, HISTORY).copy()
        found = (history[:, FRICTION_LOSS], history[:, DRIVE_WORK], self.stop_energy(state.s, state.history),
                 history[:, STOP_LOSS], history[:, LOCK_LOSS])
        return dict(zip(ENERGIES, found))

    def stored(self, state: State) -> float:
        """Return the energy of elastic stops, J."""
        return float(np.sum(self.stop_energy(state.s, state.history)))

    def booked(self, model: Any, state: State, row: Mapping[str, Any]) -> tuple[list[float], list[float]]:
        """Return the energy that friction, stops and locks dissipated less the work of drives, J, and the sizes of these
        parts."""
        history = model.own(state.history, self.key).reshape(-1, HISTORY)
        return ([float(np.sum(history[:, LOSSES])) - float(np.sum(history[:, DRIVE_WORK]))],
                np.sum(np.abs(history[:, (*LOSSES, DRIVE_WORK)]), axis=0).tolist())

    def stop_energy(self, s: Array, history: Array) -> Array:
        """Return the energy that elastic stops store, J, [S]; history [S, 11], or flat."""
        stiff, (low, high) = self.tables.stops[:, STIFFNESS], self.elastic(s, history[:self.history_size].reshape(-1, HISTORY)).T
        beyond = np.maximum(low - s, 0.0)**2 + np.maximum(s - high, 0.0)**2
        return np.asarray(0.5 * stiff * np.where(stiff > 0.0, beyond, 0.0))

    def at_row(self, t: float, s: Array, rate: Array, history: Array, tangent: Array, force: Array, push: Array,
               edges: Array, share: float | None = None) -> AtRow:
        """Evaluate the forces along the beam at time t.

        s, rate: float64 [S], places, m, and velocities ds/dt, m/s.
        history: float64 [S, 11], history variables of the state.
        tangent, force: float64 [S, 3], derivatives of the curves by s; contact forces, N.
        push: float64 [S], force of the moments of sleeves along the beam, N.
        edges: float64 [S], force of these moments on the edges of bores, N.
        share: the load factor of an equilibrium.
        """
        table, sign = self.tables, history[:, SIGN]
        along = np.sum(force * tangent, axis=1)
        long = np.linalg.norm(tangent, axis=1)
        across = (np.linalg.norm(force - (along / long**2)[:, None] * tangent, axis=1) + edges) * long
        along = along - push
        stiff, (low, high), offset = table.stops[:, STIFFNESS], self.elastic(s, history).T, history[:, OFFSET]
        beyond = np.maximum(low - s, 0.0) - np.maximum(s - high, 0.0)
        stop = np.where(stiff > 0.0, stiff * beyond, 0.0)
        drive = np.zeros(len(s))
        prescribed = self.is_prescribed
        for k in np.flatnonzero((table.drive != NO_DRIVE) & ~prescribed).tolist():
            drive[k] = self._drive_at(k, t, s[k], rate[k], offset[k]) if share is None else self.at_rest(
                k, t, s[k], share, offset[k])
        smooth = table.smoothing > 0.0
        # a prescribed motion takes the sign of the last step: at rest, the rest of its velocity alternates in sign
        direction = np.where(smooth, np.tanh(rate / np.where(smooth, table.smoothing, 1.0)), sign)
        friction = -table.friction * across * direction - table.viscous * rate
        sticks = (table.friction > 0.0) & ~smooth & ~prescribed & (sign == 0.0)
        friction = np.where(sticks, along - stop - drive, friction)
        drive = np.where(prescribed, along - stop - friction, drive)
        # friction takes as much of the force against a rigid stop as it can
        against = history[:, AGAINST] != 0.0
        friction = np.where(against, np.clip(along - drive, -table.friction * across, table.friction * across), friction)
        stop = np.where(against, along - drive - friction, stop)
        locked, off = history[:, HELD] == LOCKED, history[:, HELD] == OFF
        friction, drive = np.where(locked | off, 0.0, friction), np.where(off, 0.0, drive)
        stop = np.where(off | locked & ~(stiff > 0.0), 0.0, stop)
        return AtRow(along, friction, drive, stop, np.where(locked, along - drive - stop, 0.0))

    def _drive_at(self, k: int, t: float, s: float, rate: float, offset: float) -> float:
        # on a switch, laws take s and controllers the arc length travelled
        coordinate = s + offset if self.tables.drive[k] == CONTROL else s
        return force_at(self.sliders[k].drive, self._who(k), t, coordinate, rate)

    def at_rest(self, k: int, t: float, s: float, share: float, offset: float) -> float:
        """Evaluate the force, N, of a drive that does not prescribe the motion on a slider at rest at s, at time t and load
        factor `share`, in proportion to which it grows; offset: arc length travelled less s."""
        kind, gains, drive, who = self.tables.drive[k], self.tables.gains[k], self.sliders[k].drive, self._who(k)
        if kind == LAW:
            return share * law_at(drive, who, t, s, 0.0)
        given = given_to(drive, who, t, 0.0)[0]
        return share * (given if kind == FORCE else float(np.clip(gains[0] * (given - offset - s), -gains[2], gains[2])))

    def slope_at_rest(self, k: int, t: float, s: float, share: float, offset: float, by_rate: bool) -> float:
        """Return the derivative of the force `at_rest` by s, N/m, or by ds/dt, N s/m. Raises SceneError: a law has a kink or
        jumps there."""
        slider = self.sliders[k]
        # on a switch, laws take s and controllers the arc length travelled
        coordinate = s + offset if self.tables.drive[k] == CONTROL else s
        return share * slope_at_rest(slider.drive, f"slider {slider.name!r}", t, coordinate, slider.beam.length, by_rate)

    def place_given(self, k: int, t: float, own: Array) -> float:
        """Return the arc length that a drive prescribes for slider k at time t, m; own [11]: history of the slider."""
        return value_at(self.sliders[k].drive, self._who(k), "position", t) - float(own[OFFSET])


def slider_forces_of(sliders: list[Slider]) -> SliderForces | None:
    """Build the forces along the beam of all sliders; None where no slider has any. Raises SceneError: a prescribed position does
    not begin where its slider stands."""
    if all(x.slides_freely for x in sliders):
        return None
    found = SliderForces(sliders)
    # evaluated now to raise its errors on paths at compile time
    assert len(found.sides) == len(sliders)
    for k in np.flatnonzero(found.tables.drive == POSITION).tolist():
        slider = sliders[k]
        begin = float(found.tables.given[k, 0])
        if abs(begin - slider.at) > AT_START * slider.beam.length:
            raise SceneError(f"slider {slider.name!r}: its drive begins at position(0) = {begin:.6g} m, but the slider at "
                             f"{slider.at:.6g} m; begin with at={begin:.6g}")
    return found


def sides_of(slider: Slider) -> Array:
    """Return the direction in which a slider may lift off, in the triads of the nodes of its curve, float64 [n, 3]. From beam to
    beam of a path it stays the same in space, in the reference shape. Raises SceneError: on a path the direction is along one of
    the beams, or returns as another one around a closed path."""
    if not isinstance(slider.beam, Path):
        side = slider.beam.reference(slider.at)[1][0] @ slider.one_sided.side
        side[0] = 0.0
        return np.tile(side, (slider.beam.n_nodes, 1))
    path, n = slider.beam, len(slider.beam.beams)
    (first,), (at,) = path.places([slider.at])
    sides = np.zeros((n, 3))
    sides[first] = _across(slider, path.beams[first].reference(at)[1][0], slider.one_sided.side)
    # forward from its beam, then backward from it; around a closed path only forward
    on = [(k % n, (k + 1) % n) for k in range(first, first + n if path.closed else n - 1)]
    back = [] if path.closed else [(k, k - 1) for k in range(first, 0, -1)]
    for k, other in (*on, *back):
        forward = other == (k + 1) % n if path.closed else other > k
        ends = [path.beams[j].reference(path.beams[j].length * (x == (path.directions[j] > 0)))[1][0]
                for j, x in ((k, forward), (other, not forward))]
        found = _across(slider, ends[1], sides[k] @ ends[0])
        if np.any(sides[other]) and np.linalg.norm(found - sides[other]) > 1e-3:
            raise SceneError(f"slider {slider.name!r}: one_sided: around {path.label} its side turns about the axis and does not "
                             "return to itself. Give the beams directors that match where the path closes, or use an open path")
        sides[other] = found if not np.any(sides[other]) else sides[other]
    return np.repeat(sides, [beam.n_nodes for beam in path.beams], axis=0)


def _across(slider: Slider, triad: Array, side: Array) -> Array:
    """Return the unit direction across a beam, in its triad, from a direction in space."""
    out = triad @ side
    out[0] = 0.0
    size = float(np.linalg.norm(out))
    if not size > 1e-3 * float(np.linalg.norm(side)):
        raise SceneError(f"slider {slider.name!r}: one_sided: its side must not be parallel to the axis of a beam of "
                         f"{slider.beam.label}; give a direction across all of them")
    return out / size
