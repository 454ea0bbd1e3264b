"""Locks and releases of sliders in a run: what they wait for, when it comes, and the state behind it (theory.md 5.9)."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .arguments import Refusal
from .errors import SceneError
from .impacts import along, jump
from .kernels.along import AGAINST, HELD, HISTORY, FREE, LOCK_LOSS, LOCKED, OFF, SIGN, STICKS, TURNS
from .kernels.observe import slider_motion
from .kernels.work import State
from .model import Model
from .scene.locks import END, START, STOP, truth
from .starting import AT_STOP
from .workspace import contact_of

Array = np.ndarray
LOCK, UNLOCK, RELEASE = "lock", "unlock", "release"
KINDS = {LOCK: "locked", UNLOCK: "unlocked", RELEASE: "released"}


@dataclass(frozen=True)
class Awaited:
    """What a slider waits for: `action` at a time, at a word's place, where a function is not negative, or at an arc length."""

    slider: int
    action: str
    when: Any
    at: float | None = None

    @property
    def is_watched(self) -> bool:
        """Whether the state of every step has to be looked at."""
        return self.at is not None or callable(self.when)


class Locking:
    """Locks and releases of all sliders of a model; what has happened is in `State.history`.

    Parameters
    ----------
    model : Model
        With tables in space.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self.sliders = [] if model.slider_forces is None else model.slider_forces.sliders
        self.is_present = any(x.lock is not None or x.release is not None for x in self.sliders)
        self._contact = contact_of(model) if self.is_present else None
        # what `reached` compares with: the awaited that are watched, and their values in the state before the step
        self._watched: list[Awaited] = []
        self._before = np.zeros(0)

    def awaited(self, state: State) -> list[Awaited]:
        """What all sliders wait for in a state."""
        if not self.is_present:
            return []
        out = []
        own = state.history[:self.model.work_place].reshape(-1, HISTORY)
        for k, slider in enumerate(self.sliders):
            if own[k, HELD] == OFF:
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
        """The first time at which something is due, s."""
        return min((x.when for x in self.awaited(state) if isinstance(x.when, float)), default=np.inf)

    # --- conditions ---------------------------------------------------------------------------------------------------
    def watch(self, state: State, t: float) -> bool:
        """Remember the values of conditions in a state, before a step; whether there are any."""
        self._watched = [x for x in self.awaited(state) if x.is_watched]
        self._before = self._values(state, t)
        return bool(self._watched)

    def reached(self, state: State, t: float) -> tuple[float, list[Awaited]]:
        """How far conditions are reached behind the step, negative before the first of them; which hold."""
        found = self._values(state, t)
        for i, x in enumerate(self._watched):
            if x.at is not None:
                # from the side on which it was
                side = np.sign(self._before[i])
                found[i] = -side * found[i] if side else -abs(found[i])
        first = float(np.max(found, initial=-np.inf))
        return first, [x for x, value in zip(self._watched, found) if value >= 0.0 or value == first]

    def _values(self, state: State, t: float) -> Array:
        """Of all that is watched, [n]."""
        if not self._watched:
            return np.zeros(0)
        model = self.model
        rates = np.zeros(model.n_sliders)
        slider_motion(model.curves, model.sliders, self._contact, state.q, state.v, state.s, np.zeros(3 * model.n_sliders), rates)
        return np.array([state.s[x.slider] - x.at if x.at is not None else
                         self._asked(x, t, float(state.s[x.slider]), float(rates[x.slider])) for x in self._watched])

    def _asked(self, awaited: Awaited, t: float, s: float, rate: float) -> float:
        slider = self.sliders[awaited.slider]
        what = "until" if awaited.action == UNLOCK else "when"
        noun = "release" if awaited.action == RELEASE else "lock"
        try:
            found = truth(awaited.when, t, s, rate)
        except Refusal as refusal:
            raise SceneError(f"{slider.kind} {slider.name!r}: {noun}: {what} {refusal}") from refusal.__cause__
        if found is None:
            raise SceneError(f"{slider.kind} {slider.name!r}: {noun}: {what} must return a finite number, or True or False; at "
                             f"t = {t:.6g} s, s = {s:.6g} m, rate = {rate:.6g} m/s it does not")
        return found

    # --- what happens -------------------------------------------------------------------------------------------------
    def behind(self, state: State, t: float, slack: float, found: Sequence[Awaited] = ()) -> tuple[State, list[dict[str, Any]]]:
        """The state behind all that is due at time t, and events.

        Parameters
        ----------
        slack : float
            What is due within this time is due now, s.
        found : sequence of Awaited
            Conditions that hold, located by the caller.
        """
        events = []
        due = list(found)
        while self.is_present:
            if not due:
                self.watch(state, t)
                holds = dict(zip(self._watched, self._before))
                due = [x for x in self.awaited(state) if
                       isinstance(x.when, float) and x.when <= t + slack or callable(x.when) and holds[x] >= 0.0
                       or x.at is not None and holds[x] == 0.0]
                if not due:
                    break
            state, event = self.happens(due.pop(0), state, t)
            events.append(event)
            # what waits next depends on it
            due = [x for x in due if x in self.awaited(state)]
        return state, events

    def at_end(self, state: State, k: int, at_end: bool, is_stop: bool) -> list[Awaited]:
        """What slider k waits for at a rigid stop, or an end of its beam."""
        words = (END if at_end else START, STOP) if is_stop else (END if at_end else START,)
        return [x for x in self.awaited(state) if x.slider == k and isinstance(x.when, str) and x.when in words
                and (x.action == LOCK) == is_stop]

    def happens(self, awaited: Awaited, state: State, t: float) -> tuple[State, dict[str, Any]]:
        """The state behind one of them, and its event."""
        k, name = awaited.slider, self.model.names["sliders"][awaited.slider]
        s, loss = float(state.s[k]), 0.0
        state = State(*(x.copy() for x in state))
        if awaited.action == LOCK:
            tangent, rate = along(self.model, state, k)
            state, loss = jump(self.model, state, k, np.eye(3), -rate * tangent)
        own = state.history[:self.model.work_place].reshape(-1, HISTORY)
        own[k, SIGN] = own[k, AGAINST] = own[k, STICKS] = 0.0
        if awaited.action == LOCK:
            own[k, HELD], own[k, LOCK_LOSS] = LOCKED, own[k, LOCK_LOSS] + loss
            text = f"slider {name!r} is locked at s = {s:.6g} m from t = {t:.6g} s on, {loss:.3g} J are lost"
        elif awaited.action == UNLOCK:
            own[k, HELD] = FREE
            self._begin_at_rest(own[k], k, s)
            text = f"slider {name!r} is let go at s = {s:.6g} m at t = {t:.6g} s"
        else:
            own[k, HELD] = OFF
            text = f"slider {name!r} leaves its {self.model.track} at s = {s:.6g} m at t = {t:.6g} s"
        own[k, TURNS] += awaited.action != RELEASE
        return state, {"kind": KINDS[awaited.action], "time": t, "slider": name, "s": s, "loss": loss, "text": text}

    def _begin_at_rest(self, own: Array, k: int, s: float) -> None:
        """A slider that is let go stands still: held by friction, or against its stop, until more pulls at it."""
        slider = self.sliders[k]
        own[STICKS] = float(slider.friction is not None)
        slack = AT_STOP * float(self.model.slider_lengths[k])
        for at_end, limit in enumerate(self.model.slider_limits[k]):
            if abs(s - limit) <= slack and self.model.slider_forces.restitution(k, bool(at_end)) is not None:
                own[AGAINST] = 1.0 if at_end else -1.0
