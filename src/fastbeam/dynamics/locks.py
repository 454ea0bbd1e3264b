"""Locks and releases of sliders in a run, supports that let go or take hold: their conditions, times, and states behind them
(theory.md 5.9)."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fastbeam.dynamics.catching import catch
from fastbeam.dynamics.one_sided import ON_AXIS, Finder, Place, land
from fastbeam.dynamics.velocity_jumps import blow
from fastbeam.interface.arguments import Refusal, real, shown
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.contact.slider_forces import (
    AGAINST,
    CAME_BY,
    FREE,
    HELD,
    HISTORY,
    LOCK_LOSS,
    LOCKED,
    OFF,
    OFFSET,
    SIGN,
    STICKS,
    STOP_LOSS,
    TURNS,
)
from fastbeam.kernels.measures import slider_motion
from fastbeam.kernels.state import State
from fastbeam.model.gap_rows import ConstraintGaps
from fastbeam.model.model import Model
from fastbeam.model.rates import rates_in
from fastbeam.model.start import AT_STOP
from fastbeam.model.workspace import contact_of
from fastbeam.scene.checks import called
from fastbeam.scene.locks import END, START, STOP, truth
from fastbeam.scene.switches import Switch, chosen, place_at, span_of

Array = np.ndarray
LOCK, UNLOCK, RELEASE, LIFT, LAND, TRANSFER, LET_GO, CATCH = (
    "lock", "unlock", "release", "lift", "land", "transfer", "let go", "catch")
KINDS = {LOCK: "locked", UNLOCK: "unlocked", RELEASE: "released", LIFT: "lifted"}
# entry of a slider that is away: 1 where its point was beyond the ends or on the other side
PASSED = STICKS
# distance, as a share of the length of the beam
TOUCHING = 1e-12
# events of points that come back, in a run
MOST_HITS = 100


@dataclass(frozen=True)
class Awaited:
    """Condition that a slider waits for: `action` at a time, at a word's place, where a function is not negative, or at an arc
    length; or when its point comes back. rests: it came back with no flight between. LET_GO, CATCH: `slider` is the number of a
    support."""

    slider: int
    action: str
    when: Any
    at: float | tuple[str, float] | None = None
    rests: bool = False


class Locking:
    """Locks and releases of all sliders of a model; `State.history` keeps those that are done; model: Model with tables in
    space."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.sliders = [] if model.slider_forces is None else model.slider_forces.sliders
        self.is_present = model.released is not None or bool(model.spans) or any(
            x.lock is not None or x.release is not None or x.one_sided is not None for x in self.sliders)
        self.sided = [k for k, x in enumerate(self.sliders) if x.one_sided is not None]
        # sliders that lift off at the end of the last step
        self.lifting: list[Awaited] = []
        self.hits = 0
        # places of points away from their beams, at one time
        self._places: dict[tuple[int, float], Place] = {}
        self._contact = contact_of(model) if self.is_present and self.sliders else None
        self._finder = Finder(model, self._contact) if self.sided and self._contact is not None else None
        # watched conditions, and their values in the state before the step, for `reached`
        self._watched: list[Awaited] = []
        self._before = np.zeros(0)

    def awaited(self, state: State) -> list[Awaited]:
        """List what all sliders and supports wait for in a state."""
        if not self.is_present:
            return []
        out = []
        if self.model.released is not None:
            of = self.model.released
            engaged = self.model.own(state.history, "released") + ~of.waits
            # supports let go first: a node handed over is not held by both
            out = [Awaited(k, LET_GO, of.until[k]) for k in np.flatnonzero(engaged == 1.0).tolist() if of.until[k] is not None]
            out += [Awaited(k, CATCH, of.since[k]) for k in np.flatnonzero(engaged == 0.0).tolist()]
        own = self.model.along_of(state.history)
        for k, slider in enumerate(self.sliders):
            if own[k, HELD] == OFF:
                out += [Awaited(k, LAND, None)] if slider.one_sided is not None else []
                continue
            turn, locks = int(own[k, TURNS]), slider.lock or ()
            if turn < 2 * len(locks):
                lock = locks[turn // 2]
                if turn % 2 == 0:
                    out.append(Awaited(k, LOCK, lock.when, lock.at))
                elif lock.until is not None:
                    out.append(Awaited(k, UNLOCK, lock.until))
            if slider.release is not None:
                out.append(Awaited(k, RELEASE, slider.release.when))
        return out

    def next_time(self, state: State) -> float:
        """Return the first time at which something is due, s."""
        return min((x.when for x in self.awaited(state) if isinstance(x.when, float)), default=np.inf)

    # --- conditions ---------------------------------------------------------------------------------------------------
    def watch(self, state: State, t: float) -> bool:
        """Remember the values of conditions in a state, before a step; whether steps have to be looked at one by one."""
        self._watched = [x for x in self.awaited(state) if x.at is not None or callable(x.when) or x.action == LAND]
        self._before = self._values(state, t)
        return bool(self._watched or self.sided)

    def reached(self, state: State, t: float) -> tuple[float, list[Awaited]]:
        """Return how far conditions are reached behind the step, negative before the first of them, and which of them hold."""
        self._places.clear()
        found = self._values(state, t)
        for i, x in enumerate(self._watched):
            if x.at is not None:
                # seen from the side on which the slider was
                side = np.sign(self._before[i])
                found[i] = -side * found[i] if side else -abs(found[i])
        first = float(np.max(found, initial=-np.inf))
        return first, [x for x, value in zip(self._watched, found) if value >= 0.0 or value == first]

    @property
    def touches(self) -> bool:
        """True where a point that is away from its beam was at it before the step."""
        return any(x.action == LAND and abs(value) <= TOUCHING * float(self.model.slider_lengths[x.slider])
                   for x, value in zip(self._watched, self._before))

    def _values(self, state: State, t: float) -> Array:
        """Return the values of all watched conditions, [n]."""
        if not self._watched:
            return np.zeros(0)
        model = self.model
        rates = np.zeros(model.n_sliders)
        if self._contact is not None:
            slider_motion(model.curves, model.sliders, self._contact, state, np.zeros(3 * model.n_sliders),
                          rates)
        return np.array([self._value(x, state, t, rates) for x in self._watched])

    def _value(self, x: Awaited, state: State, t: float, rates: Array) -> float:
        """Return the value of one watched condition; rates: of all sliders [S]."""
        if x.action in (LET_GO, CATCH):
            return self._support_asked(x, state, t)
        s = float(state.s[x.slider])
        if x.at is not None:
            at = self._lock_place(x, state)
            # on another track it is far away
            return float(self.model.slider_lengths[x.slider]) if at is None else s - at
        return self._nearness(x, state, t) if x.action == LAND else self._asked(x, t, s, float(rates[x.slider]))

    def _at_once(self, x: Awaited) -> float:
        """Return the distance from the place of a lock within which a slider is locked at once, m: round-off where it has come
        onto a track."""
        return TOUCHING * float(self.model.slider_lengths[x.slider]) if isinstance(x.at, tuple) else 0.0

    def _lock_place(self, x: Awaited, state: State) -> float | None:
        """Return s at which a lock waits; None where that is on another track than the one on which the slider is."""
        on, offset = self.sliders[x.slider].beam, float(self.model.along_of(state.history)[x.slider, OFFSET])
        if not isinstance(on, Switch):
            return float(x.at)
        return place_at(on, x.at, span_of(on, float(state.s[x.slider])), offset)

    def _place(self, state: State, t: float, k: int) -> Place:
        """Return the place of the point of slider k in the state at time t; places evaluated at that time are kept."""
        if (k, t) not in self._places:
            self._places = {at: place for at, place in self._places.items() if at[1] == t}
            self._places[k, t] = self._finder.place(state, k)
        return self._places[k, t]

    def _nearness(self, awaited: Awaited, state: State, t: float) -> float:
        """Return minus the distance of a point from its beam, m; of one that was beyond the ends or on the other side a
        length."""
        k = awaited.slider
        place = self._place(state, t, k)
        is_between_ends = place.is_between_ends and state.history[HISTORY * k + PASSED] == 0.0
        return -place.distance if is_between_ends else -float(self.model.slider_lengths[k])

    # --- one-sided contact --------------------------------------------------------------------------------------------
    def follow(self, state: State, t: float, into: State) -> None:
        """Set s of points away from their beams to that of the nearest point. One that comes from beyond an end counts again when
        it is beside the beam, on its side."""
        for k in self.sided:
            if into.history[HISTORY * k + HELD] == OFF:
                place = self._place(state, t, k)
                into.s[k] = place.s
                if not place.is_between_ends or place.distance > 0.0:
                    into.history[HISTORY * k + PASSED] = 0.0 if place.is_between_ends else 1.0

    def find_lifting(self, state: State, before: Array | None, force: Array) -> bool:
        """Find sliders that lift off at the end of a step, as the contact force pulls: the mean of the step and the one before,
        [F] each. Return whether there are any."""
        self.lifting = [Awaited(k, LIFT, None) for k in self.sided if before is not None
                        and not self.sliders[k].one_sided.catch and state.history[HISTORY * k + HELD] == FREE
                        and self._finder.pull(state, k, 0.5 * (before + force)[3 * k:3 * k + 3]) > 0.0]
        return bool(self.lifting)

    def _comes_back(self, awaited: Awaited, state: State, t: float) -> tuple[State, dict[str, Any]]:
        """Return the state and event of a point that meets its beam again, or passes beside it."""
        k, name = awaited.slider, self.model.names["sliders"][awaited.slider]
        place = self._finder.place(state, k)
        event = {"time": t, "slider": name, "s": place.s}
        if place.off > ON_AXIS * float(self.model.slider_lengths[k]):
            state = State(*(x.copy() for x in state))
            state.history[HISTORY * k + PASSED] = 1.0
            return state, {"kind": "missed", **event, "text": f"slider {name!r} passes its beam at a distance of {place.off:.3g} "
                                                              f"m at t = {t:.6g} s"}
        restitution = 0.0 if awaited.rests else self.sliders[k].one_sided.restitution
        state, loss, stays = land(self.model, state, k, place, restitution, t)
        kind, what = ("landed", "is back on") if stays else ("impact", "bounces off")
        return state, {"kind": kind, **event, "loss": loss, "text": f"slider {name!r} {what} its beam at s = {place.s:.6g} m, "
                                                                    f"t = {t:.6g} s, {loss:.3g} J are lost"}

    def _asked(self, awaited: Awaited, t: float, s: float, rate: float) -> float:
        slider = self.sliders[awaited.slider]
        what = "until" if awaited.action == UNLOCK else "when"
        noun = "release" if awaited.action == RELEASE else "lock"
        try:
            found = truth(awaited.when, t, s, rate)
        except Refusal as refusal:
            raise SceneError(f"{slider.kind} {slider.name!r}: {noun}: {what} {refusal}") from refusal.__cause__
        if found is None:
            raise SceneError(f"{slider.kind} {slider.name!r}: {noun}: {what} must return a finite number, or True or False, but "
                             f"does not at t = {t:.6g} s, s = {s:.6g} m, rate = {rate:.6g} m/s")
        return found

    def _support_asked(self, awaited: Awaited, state: State, t: float) -> float:
        name, what = self.model.released.names[awaited.slider], "until" if awaited.action == LET_GO else "since"
        found = called(name, what, awaited.when, t, State(*(x.copy() for x in state)), where="at t = {:.6g} s")
        value = (1.0 if found else -1.0) if isinstance(found, (bool, np.bool_)) else real(found)
        if value is None or not np.isfinite(value):
            raise SceneError(f"{name}: {what} must return a finite number, or True or False, but returns {shown(found)} at t = "
                             f"{t:.6g} s")
        return value

    # --- what happens -------------------------------------------------------------------------------------------------
    def behind(self, state: State, t: float, slack: float, found: Sequence[Awaited] = ()) -> tuple[State, list[dict[str, Any]]]:
        """Return the state behind all that is due at time t, and events.

        slack: events that are due within this time, s, are due now.
        found: conditions that hold, located by the caller.
        """
        events = []
        due = [*found, *self.lifting]
        self.lifting = []
        self.follow(state, t, state)
        while self.is_present:
            if not due:
                self.watch(state, t)
                holds = dict(zip(self._watched, self._before))
                due = [x for x in self.awaited(state) if
                       isinstance(x.when, float) and x.when <= t + slack or callable(x.when) and holds[x] >= 0.0
                       or x.at is not None and abs(holds[x]) <= self._at_once(x)]
                if not due:
                    break
            now = due.pop(0)
            state, event = self._comes_back(now, state, t) if now.action == LAND else self.happens(now, state, t)
            self.hits += now.action in (LIFT, LAND)
            if now.action not in (LIFT, LAND) or self.hits <= MOST_HITS:
                events.append(event)
            # an event changes what is awaited next
            due = [x for x in due if x.action == LIFT or replace(x, rests=False) in self.awaited(state)]
        return state, events

    def at_end(self, state: State, k: int, at_end: bool, is_stop: bool) -> list[Awaited]:
        """List what slider k waits for at a rigid stop, or an end of its beam."""
        if k in self.model.spans and not is_stop:
            end = END if at_end else START
            # a lock that waits at the end of a track takes hold there
            slack = AT_STOP * float(self.model.slider_lengths[k])
            waits = [x for x in self.awaited(state) if x.slider == k and x.action == LOCK and isinstance(x.at, tuple)]
            at = [self._lock_place(x, state) for x in waits]
            if any(x is not None and abs(x - state.s[k]) <= slack for x in at):
                return waits
            if self._options(state, k, end):
                return [Awaited(k, TRANSFER, end)]
        words = (END if at_end else START, STOP) if is_stop else (END if at_end else START,)
        return [x for x in self.awaited(state) if x.slider == k and isinstance(x.when, str) and x.when in words
                and (x.action == LOCK) == is_stop]

    def _options(self, state: State, k: int, end: str) -> tuple[str, ...]:
        """Return the names of the tracks on which slider k may go on from the end or start of its own."""
        switch = self.sliders[k].beam
        return switch.options(switch.where(float(state.s[k]))[0], end)

    def _transferred(self, awaited: Awaited, state: State, t: float) -> tuple[State, dict[str, Any]]:
        """Move a slider from the end of its track to another one: nothing changes but its arc length."""
        k, name, switch = awaited.slider, self.model.names["sliders"][awaited.slider], self.sliders[awaited.slider].beam
        state = State(*(x.copy() for x in state))
        number = span_of(switch, float(state.s[k]))
        track = chosen(switch, self._options(state, k, awaited.when), t, state, name)
        self.move_on(state, k, number, awaited.when == END, track)
        return state, self.switched(state, k, number, track, t)

    def switched(self, state: State, k: int, number: int, track: str, t: float) -> dict[str, Any]:
        """Return the event of slider k, which left the track of this number for the one on which it is in a state."""
        name, s, own = self.model.names["sliders"][k], float(state.s[k]), self.model.along_of(state.history)[k]
        return {"kind": "switched", "time": t, "slider": name, "s": s, "way": float(s + own[OFFSET]), "track": track, "loss": 0.0,
                "text": f"slider {name!r} passes from {self.sliders[k].beam.tracks[number].name!r} to {track!r} at t = {t:.6g} s"}

    def move_on(self, state: State, k: int, number: int, at_end: bool, track: str) -> float:
        """Count the arc length of slider k, which leaves the track of this number, on another; return by how much it falls."""
        switch = self.sliders[k].beam
        target = float(switch.spans[[x.name for x in switch.tracks].index(track), int(not at_end)])
        own, stored = self.model.along_of(state.history)[k], self._in_stop(state, k)
        # the distance from the end of a track is kept on the other track
        before = float(switch.spans[number, int(at_end)])
        state.s[k] = target + (state.s[k] - before)
        own[OFFSET] += before - target
        own[CAME_BY] = 1.0 if at_end else -1.0
        # a stop that stands on the track behind swings back by itself
        own[STOP_LOSS] += stored - self._in_stop(state, k)
        return before - target

    def happens(self, awaited: Awaited, state: State, t: float) -> tuple[State, dict[str, Any]]:
        """Return the state behind an awaited event, and the event."""
        if awaited.action in (LET_GO, CATCH):
            return self._changed(awaited.slider, state, t)
        if awaited.action == TRANSFER:
            return self._transferred(awaited, state, t)
        k, name = awaited.slider, self.model.names["sliders"][awaited.slider]
        s, loss = float(state.s[k]), 0.0
        state = State(*(x.copy() for x in state))
        if awaited.action == LOCK:
            gaps = ConstraintGaps(self.model).at(state.q, state.s)
            _, state, loss = blow(self.model, state, k, np.eye(3),
                                  lambda x: -gaps.along(k, rates_in(self.model, x)) * gaps.tangents[k])
        own = self.model.along_of(state.history)
        own[k, SIGN] = own[k, AGAINST] = own[k, STICKS] = 0.0
        if awaited.action == LOCK:
            own[k, HELD], own[k, LOCK_LOSS] = LOCKED, own[k, LOCK_LOSS] + loss
            text = f"slider {name!r} is locked at s = {s:.6g} m from t = {t:.6g} s on; the impact dissipates {loss:.3g} J"
        elif awaited.action == UNLOCK:
            own[k, HELD] = FREE
            self._begin_at_rest(state, own[k], k, s)
            text = f"slider {name!r} is released at s = {s:.6g} m at t = {t:.6g} s"
        else:
            own[k, HELD] = OFF
            if awaited.action == LIFT:
                own[k, STOP_LOSS] += self._let_go_of_stop(state, k)
            verb = "leaves" if awaited.action == RELEASE else "lifts off"
            text = f"slider {name!r} {verb} its {self.model.track} at s = {s:.6g} m at t = {t:.6g} s"
        own[k, TURNS] += awaited.action in (LOCK, UNLOCK)
        return state, {"kind": KINDS[awaited.action], "time": t, "slider": name, "s": s, "loss": loss, "text": text}

    def _changed(self, k: int, state: State, t: float) -> tuple[State, dict[str, Any]]:
        """Return the state behind support k, which lets go or takes hold, and the event."""
        name, of = self.model.released.names[k], self.model.released
        if of.off(self.model.own(state.history, "released"))[k]:
            state, loss = catch(self.model, state, k, t)
            return state, {"kind": "caught", "time": t, "support": name, "loss": loss,
                           "text": f"{name} engages at t = {t:.6g} s; the impact dissipates {loss:.3g} J"}
        state = State(*(x.copy() for x in state))
        state.history[self.model.place("released") + k] += 1.0
        return state, {"kind": "let go", "time": t, "support": name, "text": f"{name} is released at t = {t:.6g} s"}

    def _let_go_of_stop(self, state: State, k: int) -> float:
        """Move a slider that lifts off out of its elastic stop; return the energy that the stop loses, J: it swings back by
        itself."""
        before = self._in_stop(state, k)
        state.s[k] = np.clip(state.s[k], *self._finder.ends[k])
        return before - self._in_stop(state, k)

    def _in_stop(self, state: State, k: int) -> float:
        """Return the energy that an elastic stop of slider k stores, J."""
        return float(self.model.slider_forces.stop_energy(state.s, state.history)[k])

    def _begin_at_rest(self, state: State, own: Array, k: int, s: float) -> None:
        """Let a slider that is released begin at rest: held by friction, or against its stop, until more pulls at it."""
        slider = self.sliders[k]
        own[STICKS] = float(slider.friction is not None)
        slack = AT_STOP * float(self.model.slider_lengths[k])
        for at_end, limit in enumerate(self.model.limits_at(state.s, state.history)[k]):
            if abs(s - limit) <= slack and self.model.slider_forces.restitution(k, bool(at_end), s, own) is not None:
                own[AGAINST] = 1.0 if at_end else -1.0
