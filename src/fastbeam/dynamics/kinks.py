"""Kinks in time that a run with order 4 passes: elastic stops, springs with laws, drag that turns around (theory.md 6).

Rows tell them, with values and rates: between two rows a value goes along the cubic through both, so that what comes and goes
between them is seen where rows resolve the motion.
"""
from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.contact.slider_forces import STIFFNESS
from fastbeam.kernels.joints.coordinates import VALUE
from fastbeam.kernels.state import State
from fastbeam.model.forces.loads import factor_at
from fastbeam.model.forces.spring_laws import SpringRows
from fastbeam.model.mapping import contact
from fastbeam.model.model import Model

Array = np.ndarray
# places between two rows that are looked at; so far from a border, of the way between rows, a value has to be to lie beyond it
PLACES, BEYOND = np.linspace(0.0, 1.0, 17), 1e-6
# mean rates that differ by more from the way between rows, of the larger rate, show that these do not resolve the motion
RESOLVED = 0.25
# and of a length of the scene, or of 1 rad
ROUND_OFF = 1e-9
# nodes of a drag that are looked at, and speeds that count, as a share of the largest that one of them has had
MOST_NODES, SLOW = 500, 1e-3


class Quantity(NamedTuple):
    """Quantity whose borders are kinks: what it does there, its unit, and borders with the order behind."""

    label: str
    unit: str
    borders: tuple[tuple[float, int], ...]


class Scalars:
    """Quantities that one function of the state gives, with their rates; length: of the scene, m."""

    def __init__(self, parts: list[Quantity], values: Callable[[State], tuple[Array, Array]], length: float) -> None:
        self.parts, self._values, self._length = parts, values, length
        self._left = list(range(len(parts)))
        self._last: tuple[float, Array, Array] | None = None

    def look(self, t: float, state: State) -> list[tuple[float, str, int]]:
        """Return time, text and order of the quantities that passed a border for the first time since the last row."""
        if not self._left:
            return []
        last, (x, rate) = self._last, self._values(state)
        self._last = (t, x, rate)
        out: list[tuple[float, str, int]] = []
        if last is None or not t > last[0]:
            return out
        interpolated = between(last[1], x, last[2], rate, t - last[0])
        for k in list(self._left):
            part, way = self.parts[k], interpolated[:, k]
            slack = max(BEYOND * float(np.ptp(way)), ROUND_OFF * (self._length if part.unit == "m" else 1.0))
            for border, order in part.borders:
                sides = np.sign(way - border) * (np.abs(way - border) > slack)
                on = sides[sides != 0.0]
                if on.size and np.any(on != on[0]):
                    at = int(np.argmax(sides == -on[0]))
                    out.append((last[0] + (t - last[0]) * float(PLACES[at]), f"{part.label} {border:.6g} {part.unit}", order))
                    self._left.remove(k)
                    break
        return out


def between(x0: Array, x1: Array, v0: Array, v1: Array, h: float) -> Array:
    """Interpolate values at `PLACES` between two rows a time h apart, [17, ...], from values and rates of both; straight where
    rates do not fit the way."""
    s = PLACES.reshape(-1, *[1] * np.ndim(x0))
    straight = x0 + s * (x1 - x0)
    fits = np.abs(0.5 * h * (v0 + v1) - (x1 - x0)) <= RESOLVED * h * np.maximum(np.abs(v0), np.abs(v1))
    # the cubic with these values and slopes, less the straight line
    bent = s * (1.0 - s) * ((1.0 - s) * (h * v0 - (x1 - x0)) - s * (h * v1 - (x1 - x0)))
    return np.asarray(straight + np.where(fits, bent, 0.0))


class Turning:
    """Parts of a scene with drag by the square of a velocity, which has a kink where this passes 0: the force v |v| has a jump in
    its second derivative; step: step of the run, s: what turns around from one step to the next has not been resolved."""

    def __init__(self, model: Model, step: float) -> None:
        of, self.step, self.slow = model.dragged, step, ROUND_OFF * model.length / step
        self.labels, self.times = of.labels, of.times
        squares = of.coefficient[:, 0] + of.coefficient[:, 1] > 0.0
        # the velocity of air by a function of place is known to steps alone
        known = np.zeros(len(of.node), bool) if of.windy else squares
        chosen = [np.flatnonzero(known & (of.part == k)) for k in range(len(of.labels))]
        chosen = [x[::max(1, -(-len(x) // MOST_NODES))] for x in chosen]
        self.at = np.concatenate([np.zeros(0, np.int64), *chosen])
        self.node, self.part = of.node[self.at], of.part[self.at]
        self.slender, self.air = of.slender[self.at][:, None] == 1, of.air[self.at]
        self.squares = of.coefficient[self.at, :2] > 0.0
        self.fastest = np.zeros(len(of.labels))
        self._told: set[int] = set()
        self._last: tuple[float, Array, Array, Array] | None = None
        self._tail: Array | None = None

    def _relative_velocities(self, t: float, state: State) -> tuple[Array, Array, Array]:
        """Return places less those of the air, velocities against it and directors d1 of the nodes, [D, 3] each."""
        q, v = (y.reshape(-1, 4, 3)[self.node] for y in (state.q, state.v))
        factors = np.array([1.0 if time is None else factor_at(time, t) for time in self.times])
        return q[:, 0], v[:, 0] - factors[self.part, None] * self.air, q[:, 1]

    def look(self, t: float, state: State) -> list[tuple[float, str, int]]:
        """Find velocities that turned around since the last row; return as `Scalars.look`."""
        if not self.at.size or len(self._told) == len(self.labels):
            return []
        last, here = self._last, self._relative_velocities(t, state)
        self._last = (t, *here)
        if last is None or not t > last[0]:
            return []
        h = t - last[0]
        speeds = _between_rates(last[1], here[0], last[2], here[1], h, moving=bool(np.any(self.air)))
        s = PLACES[:, None, None]
        axis = (1.0 - s) * last[3] + s * here[2]
        axis = np.where(self.slender, axis / np.linalg.norm(axis, axis=-1, keepdims=True), 0.0)
        along = np.sum(speeds * axis, axis=-1)
        both = np.stack((speeds - along[..., None] * axis, along[..., None] * axis))
        if self._tail is not None:
            # a velocity of exactly 0 at a row turns around between the places beside it
            both = np.concatenate((self._tail[:, None], both), axis=1)
        self._tail = both[:, -2].copy()
        return self._turned(both, last[0], h)

    def _turned(self, both: Array, t: float, h: float) -> list[tuple[float, str, int]]:
        """Find zeros of velocities [2, places, D, 3] across and along beams, from time t on; h: time between the rows."""
        size = np.linalg.norm(both, axis=-1).max(axis=(0, 1))
        np.maximum.at(self.fastest, self.part, size)
        out: list[tuple[float, str, int]] = []
        for i, (name, x) in enumerate(zip(("across", "along"), both)):
            # an exact 0 has no direction: the step over it counts
            pairs = [(x[:-1], x[1:]), (x[:-2], x[2:])]
            hit = np.zeros(x.shape[1], bool)
            when = np.zeros(x.shape[1])
            for a, b in pairs:
                way = b - a
                square = np.sum(way * way, axis=-1)
                near = np.clip(-np.sum(a * way, axis=-1) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
                least = np.linalg.norm(a + near[..., None] * way, axis=-1)
                # change in a step
                a_step = np.sqrt(square) * min(1.0, self.step / (h * (PLACES[1] * (len(x) - len(a)))))
                found = (np.sum(a * b, axis=-1) < 0.0) & (least <= a_step)
                when = np.where(~hit & found.any(axis=0), PLACES[np.minimum(found.argmax(axis=0), 16)], when)
                hit |= found.any(axis=0)
            counts = np.maximum(SLOW * self.fastest[self.part], self.slow)
            hit &= self.squares[:, i] & (np.linalg.norm(x, axis=-1).max(axis=0) > counts)
            for k in np.unique(self.part[hit]).tolist():
                if k in self._told:
                    continue
                self._told.add(k)
                first = int(np.flatnonzero(hit & (self.part == k))[0])
                where = f" {name} the beam" if self.slender[first, 0] else ""
                out.append((t + h * float(when[first]),
                            f"{self.labels[k]}: the velocity{where} relative to the air changes sign", 3))
        return out


def _between_rates(x0: Array, x1: Array, v0: Array, v1: Array, h: float, moving: bool) -> Array:
    """Interpolate rates at `PLACES` between two rows, [17, ...]: those of the cubic, or on a straight line, also where the air
    moves."""
    s = PLACES.reshape(-1, *[1] * np.ndim(x0))
    straight = v0 + s * (v1 - v0)
    mean = (x1 - x0) / h
    fits = np.abs(0.5 * (v0 + v1) - mean) <= RESOLVED * np.maximum(np.abs(v0), np.abs(v1))
    bent = 6.0 * s * (1.0 - s) * (mean - 0.5 * (v0 + v1))
    return np.asarray(straight + np.where(fits & (not moving), bent, 0.0))


class Kinks:
    """Kinks that a run with order 4 passes and that leave it a lower order; step: step of the run, s."""

    def __init__(self, model: Model, step: float) -> None:
        self.groups: list[Scalars | Turning] = [*_springs(model), *_slider_stops(model), *_joint_stops(model)]
        if model.dragged is not None:
            self.groups.append(Turning(model, step))
        self.events: list[dict[str, Any]] = []

    def look(self, t: float, state: State) -> Sequence[dict[str, Any]]:
        """Return events {'kind', 'time', 'text'} of the row at time t, s; state: in space. They are kept in `events`, too."""
        found = [{"kind": "order", "time": at,
                  "text": f"{text} near t = {at:.6g} s, where the motion has a kink. Order 4 is lost there: errors after it are "
                          f"of order {order} in the step. Use smaller steps there, or order=2, which costs less"}
                 for group in self.groups for at, text, order in group.look(t, state)]
        self.events += found
        return found

    def __call__(self, t: float, state: State) -> None:
        """Look at a row, as a callback."""
        self.look(t, state)


def _springs(model: Model) -> list[Scalars]:
    rows = [x for x in model.spring_rows if isinstance(x, SpringRows)]
    out = []
    for springs in rows:
        parts = [Quantity(f"{label} passes a kink of its force law, at the elongation", "m", borders)
                 for label, borders in zip(springs.labels, springs.kinks())]
        chosen = [k for k, part in enumerate(parts) if part.borders]
        if chosen:
            def values(state: State, springs: SpringRows = springs, chosen: list[int] = chosen) -> tuple[Array, Array]:
                e, rate = springs.motion(state)
                return e[chosen], rate[chosen]
            out.append(Scalars([parts[k] for k in chosen], values, model.length))
    return out


def _slider_stops(model: Model) -> list[Scalars]:
    forces = model.slider_forces
    if forces is None or model.spans:
        return []
    table = forces.tables
    chosen = np.flatnonzero(table.stops[:, STIFFNESS] > 0.0).tolist()
    parts = [_stopped(f"slider {model.names['sliders'][k]!r}", "s =", "m", table.stops[k, :2]) for k in chosen]

    def values(state: State) -> tuple[Array, Array]:
        q, v = state.q.reshape(-1, 4, 3), state.v.reshape(-1, 4, 3)
        rates = []
        for k in chosen:
            _, tangent, relative = contact(model, k, float(state.s[k]), q, v)
            rates.append(float(relative @ tangent / (tangent @ tangent)))
        return state.s[chosen].copy(), np.array(rates)

    return [Scalars(parts, values, model.length)] if chosen else []


def _joint_stops(model: Model) -> list[Scalars]:
    motions = model.motions
    if motions is None or not motions.holds.stopped.size:
        return []
    chosen = motions.holds.stopped.tolist()
    parts = [_stopped(motions.labels[k], f"at the {motions.what[k]}", motions.holds.parts[k].words[2], stop[:2])
             for k, stop in zip(chosen, motions.holds.stops)]

    def values(state: State) -> tuple[Array, Array]:
        own, q, v = motions.own(state.history, model.place("motions")), state.q.reshape(-1, 4, 3), state.v.reshape(-1, 4, 3)
        return motions.values(q, own[:, VALUE])[chosen], motions.rates(q, v)[chosen]

    return [Scalars(parts, values, model.length)]


def _stopped(who: str, where: str, unit: str, ends: Array) -> Quantity:
    return Quantity(f"{who} reaches or leaves an elastic stop, {where}", unit,
                    tuple((float(x), 3) for x in ends if np.isfinite(x)))
