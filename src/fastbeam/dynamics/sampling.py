"""Controllers in a run: asked at their times, between steps; their values and memory stand in the history of the state."""
from __future__ import annotations

import math
from typing import Any

import numpy as np

from fastbeam.interface.arguments import Number, take
from fastbeam.interface.errors import SceneError
from fastbeam.interface.synonyms import known
from fastbeam.kernels.state import State
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.model import Model
from fastbeam.results.observe.observer import Observer

Array = np.ndarray
# a time that is so many periods away is now
NOW = 1e-9


class Now:
    """Time `t`, and the state at that time, that a controller reads."""

    def __init__(self, t: float, row: dict[str, Any], names: dict[str, list[str]]) -> None:
        self.t, self._row, self._names = t, row, names

    def _of(self, kind: str, noun: str, name: str, *series: str) -> list[Any]:
        names = self._names.get(kind, [])
        if name not in names:
            raise KeyError(f"there is no {noun} {name!r}; there are {known(names, name)}")
        return [self._row[x][names.index(name)] for x in series]

    def point(self, name: str) -> Array:
        """Return the position (3,), m, of one of the points of the controller."""
        return np.array(self._of("points", "point", name, "points")[0])

    def velocity(self, name: str) -> Array:
        """Return the velocity (3,), m/s, of one of the points of the controller."""
        return np.array(self._of("points", "point", name, "point_velocity")[0])

    def slider(self, name: str) -> float:
        """Return the arc length of a slider, m."""
        return float(self._of("sliders", "slider", name, "s_slide")[0])

    def joint(self, name: str) -> tuple[float, float]:
        """Return the angle or distance that a joint leaves free, rad or m, and its rate; the first of several."""
        value, rate = self._of("joints", "joint", name, "joint_value", "joint_rate")
        return float(value), float(rate)

    def winch(self, name: str) -> tuple[float, float]:
        """Return the free length of a rope, m, and its rate, m/s."""
        length, speed = self._of("winches", "winch", name, "winch_length", "winch_speed")
        return float(length), float(speed)

    def spring(self, name: str) -> tuple[float, float]:
        """Return the length, m, and force, N, of a spring."""
        length, force = self._of("springs", "spring", name, "spring_length", "spring_force")
        return float(length), float(force)


def _asked(one: Any, now: Now, memory: Array) -> float:
    """Return the value of a controller. Raises SceneError: its law fails, or returns no finite number."""
    try:
        found = one.law(now, memory)
    except Exception as error:
        text = f"{type(error).__name__}: {str(error)[:200]}"
        raise SceneError(f"{one.label}: its law failed at t = {now.t:.6g} s: {text}") from error
    if not np.isfinite(memory).all():
        raise SceneError(f"{one.label}: its memory has values that are not finite at t = {now.t:.6g} s")
    return float(take(Number(), f"{one.label}: its law at t = {now.t:.6g} s", found))


class Sampling:
    """The controllers of a run.

    step: step of the run, s.
    controlled: whether steps are chosen by their error.
    Raises SceneError: step control, or steps that do not meet the times of a controller.
    """

    def __init__(self, model: Model, step: float, controlled: bool, state: State) -> None:
        self.controllers = model.controllers
        if not self.controllers:
            return
        if controlled:
            require(Analysis.STEP_CONTROL, model)
        self._place = model.place("control")
        for one in self.controllers:
            ratio = one.period / step
            if abs(ratio - round(ratio)) > NOW * ratio or round(ratio) < 1:
                raise SceneError(f"{one.label}: period={one.period:.6g} s is {ratio:.6g} steps of {step:.6g} s; it must be a "
                                 "whole number of steps, so that each sampling time is the end of a step")
        points = {(k, name): node for k, one in enumerate(self.controllers) for name, node in one.points.items()}
        flat = {f"{k} {name}": node for (k, name), node in points.items()}
        self._observer = Observer(model, ("slider", "joint", "spring", "velocity"), flat)
        self._names = {"sliders": model.names["sliders"], "joints": [] if model.motions is None else list(model.motions.names),
                       **{x.kind: list(x.names) for x in self._observer.springs}}
        self._of = [[name for k, name in points if k == i] for i in range(len(self.controllers))]
        self.follow(state)

    def _parts(self, state: State) -> list[Array]:
        """Return value, number of the next time and memory of every controller in a state, to read and to change."""
        ends = self._place + np.cumsum([0] + [one.size for one in self.controllers])
        return [state.history[a:b] for a, b in zip(ends[:-1], ends[1:])]

    def follow(self, state: State) -> None:
        """Set the values of controllers to those in a state."""
        for one, own in zip(self.controllers, self._parts(state)):
            one.held[0] = float(own[0])

    def ask(self, t: float, stepper: Any) -> None:
        """Ask the controllers whose time has come."""
        if not self.controllers:
            return
        parts = self._parts(stepper.core_state)
        due = [k for k, (one, own) in enumerate(zip(self.controllers, parts)) if own[1] * one.period <= t + NOW * one.period]
        if not due:
            return
        row = self._observer.row(t, stepper.state)
        first = 0
        found = []
        for k, (one, own) in enumerate(zip(self.controllers, parts)):
            count = len(self._of[k])
            if k in due:
                some = dict(row)
                for name in ("points", "point_velocity"):
                    if count:
                        some[name] = row[name][first:first + count]
                memory = own[2:].copy()
                value = _asked(one, Now(t, some, {**self._names, "points": self._of[k]}), memory)
                found.append((one, own, value, memory))
            first += count
        for one, own, value, memory in found:
            own[0], own[1], own[2:] = value, math.floor(t / one.period + NOW) + 1, memory
            one.held[0] = value

    def steps(self, t: float, step: float, state: State) -> int:
        """Return the number of whole steps from t on that end no later than the next time of a controller, one at least."""
        ahead = [own[1] * one.period - t for one, own in zip(self.controllers, self._parts(state))]
        return max(1, math.ceil(min(ahead) / step * (1.0 - NOW) - NOW))
