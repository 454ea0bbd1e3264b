"""Forces along the beam on sliders in an equilibrium (theory.md 8): drives, stops, and which sliders friction holds.

    sliding     F . T - Q(s) - Q_friction - Q_stop = 0,    |Q_friction| <= mu |F_n| |T|

Whether a slider sticks at the place of the load step before, slips, or rests against a rigid stop is found like the set of
active conditions in a problem of contact: what does not fit is changed, and the equilibrium found again.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.kernels.contact.slider import Following
from fastbeam.kernels.contact.slider_forces import (
    AGAINST,
    HISTORY,
    INCREMENT,
    NO_DRIVE,
    OFFSET,
    POSITION,
    SIGN,
    STICKS,
    STIFFNESS,
)
from fastbeam.kernels.state import State
from fastbeam.model.contact.sleeve_conditions import sections
from fastbeam.model.maps import RowMap
from fastbeam.model.model import Model
from fastbeam.stepping.assembled import Constraints, Entries, Equations, entries_of_matrix

Array = np.ndarray
# a part of the contact force across the beam that is round-off of the force
ALONG_ONLY = 1e-12
# a force along the beam that is round-off of the contact force
ROUND_OFF = 1e-10
# a slider that slips comes to rest where friction has this share in reserve, so that round-off of contact forces does not move it
# in a run from there
RESERVE = 1e-5
# a slider is at a rigid stop, or back where it was, within this share of the length of its beam
AT_STOP, BACK = 1e-12, 1e-13
# a slider touches an elastic stop where it is beyond its begin by this share of the length of its beam
TOUCH = 1e-12
# how often one slider may change between sticking and slipping in one load step
MOST_CHANGES = 6


class Modes(NamedTuple):
    """States of sliders in a load step: sticking, slipping, at a stop."""

    sign: Array     # int64 [S]: -1 or 1, slip direction of sliders with friction; 0: sticking
    at_stop: Array  # int64 [S]: -1 or 1 at a rigid stop at the start or the end, else 0
    changes: Array  # int64 [S]: how often a slider has changed from slipping to sticking in this load step


def let_go(resting: Array, force: Array, most: Array, sign: Array, at_stop: Array) -> None:
    """Let coordinates that rest, bool [n], slip where the force that holds them is larger than the most that friction can exert,
    and does not push them against their stops; write that into their directions `sign` and into `at_stop`."""
    back = resting & (force > most) & (at_stop >= 0)
    forth = resting & (force < -most) & (at_stop <= 0)
    sign[back], sign[forth] = -1, 1
    at_stop[back | forth] = 0


def share_left(force: float, most: float) -> float:
    """Return the share of friction that is left beside a force that it holds; negative where it cannot."""
    return 1.0 - abs(force) / most if most > 0.0 else -1.0 if force else 1.0


class StaticAlong:
    """Forces along the beam on S sliders, at least one of which has such forces.

    at_time: time of functions of time, s.
    s: float64 [S], places of sliders at load factor 0, m.
    held: bool [S], sliders that stay at their s, with whatever force that takes.
    history: history of the state.
    Raises SceneError: a drive prescribes a place beyond the end of its beam, or returns no finite number.
    """

    def __init__(self, model: Model, at_time: float, s: Array, held: Array, history: Array) -> None:
        self.forces, self.at_time = model.slider_forces, at_time
        table = self.forces.tables
        self.start, self.end, own = s.copy(), s.copy(), model.along_of(history).copy()
        self.offset, self.elastic = own[:, OFFSET], self.forces.elastic(s, own)
        for k in np.flatnonzero((table.drive == POSITION) & ~held).tolist():
            self.end[k] = self.forces.place_given(k, at_time, own[k])
            low, high = model.limits_at(s, history)[k]
            if not low <= self.end[k] <= high:
                raise SceneError(f"solve_static: slider {model.names['sliders'][k]!r}: its drive prescribes s = {self.end[k]:.6g}"
                                 f" m, outside what it slides on ({low:.6g} to {high:.6g} m)")
        self.held = held | np.isin(table.drive, (POSITION, INCREMENT))
        self.rubs = self.forces.hold_by_friction & ~self.held
        # at rest smoothed friction is none
        self.friction = np.where(self.rubs, table.friction, 0.0)
        self.driven = np.flatnonzero((table.drive != NO_DRIVE) & ~self.held)
        self.lengths, limits = model.slider_lengths, model.limits_at(s, history)
        self.rigid = self.forces.restitutions_at(s, own) >= 0.0
        self.stops = np.where(self.rigid, limits, (-np.inf, np.inf))
        at_stop = (np.abs(s - self.stops[:, 1]) <= 1e-9 * self.lengths).astype(int)
        at_stop -= np.abs(s - self.stops[:, 0]) <= 1e-9 * self.lengths
        self.modes = Modes(np.zeros(s.size, np.int64), np.where(self.held, 0, at_stop), np.zeros(s.size, np.int64))
        # share of the way to prescribed places, and the load factor
        self.share = self.factor = 0.0
        self.in_circles = False
        self.reserve = RESERVE
        # derivatives of laws to all digits, which Newton's method does not need
        self.is_exact = False

    # --- one load step ------------------------------------------------------------------------------------------------
    def begin(self, s: Array) -> Array:
        """Return places [S] at the load factor of sliders whose motion is prescribed, those of the others as they are, at `s`."""
        self.before = s.copy()
        self.modes.sign[:] = 0
        self.modes.changes[:] = 0
        at = np.clip(s, *self.stops.T)
        return np.where(self.held, self.start + self.share * (self.end - self.start), at)

    @property
    def free(self) -> Array:
        """Sliders that move, bool [S]."""
        return ~self.held & (self.modes.at_stop == 0) & (~self.rubs | (self.modes.sign != 0))

    @property
    def slip(self) -> Array:
        """Coefficients of friction with the sign of the slip, 0 of sliders that stick [S]."""
        return np.asarray((1.0 - self.reserve) * self.friction * self.modes.sign)

    def known(self, s: Array) -> tuple[Array, Array]:
        """Evaluate drives and elastic stops at s [S]: forces on the points, N, and their derivatives by s, N/m, [S] each."""
        table = self.forces.tables
        stiff = table.stops[:, STIFFNESS]
        low, high = (np.where(stiff > 0.0, self.elastic[:, i], s) for i in (0, 1))
        beyond = np.maximum(low - s, 0.0) - np.maximum(s - high, 0.0)
        force, slope = stiff * beyond, -stiff * (beyond != 0.0)
        for k in self.driven.tolist():
            if self.is_exact:
                s_k, offset = float(s[k]), float(self.offset[k])
                force[k] += self.forces.at_rest(k, self.at_time, s_k, self.factor, offset)
                slope[k] += self.forces.slope_at_rest(k, self.at_time, s_k, self.factor, offset, by_rate=False)
                continue
            step = 1e-6 * (1e-3 * abs(s[k]) + 1e-3 * self.lengths[k])
            back, here, ahead = (self.forces.at_rest(k, self.at_time, float(s[k] + x), self.factor, self.offset[k])
                                 for x in (-step, 0.0, step))
            force[k] += here
            slope[k] += (ahead - back) / (2.0 * step)
        return force, slope

    def judge(self, equations: Equations, s: Array) -> tuple[bool, Array]:
        """Compare every slider with its equilibrium, equations without friction: whether one has to do something else now, and
        where all go on from [S]."""
        sign, at_stop, changes = self.modes
        most = self.friction * equations.normal
        needed = equations.sliding
        slack = ROUND_OFF * (np.linalg.norm(equations.along, axis=1) * equations.size + np.abs(self.known(s)[0]))
        before = sign.copy(), at_stop.copy()
        resting = ~self.held & (sign == 0) & (self.rubs | (at_stop != 0))
        returned = (sign != 0) & (sign * (s - self.before) < -BACK * self.lengths)
        self.in_circles = bool(np.any(returned & (changes >= MOST_CHANGES)))
        returned &= changes < MOST_CHANGES
        let_go(resting, needed, most + slack, sign, at_stop)
        sign[~self.rubs] = 0
        sign[returned] = 0
        changes[returned] += 1
        changed = not (np.array_equal(before[0], sign) and np.array_equal(before[1], at_stop))
        return changed, np.where(returned, self.before, s)

    def to_stop(self, s: Array, way: Array) -> Array:
        """Return the increments after which sliders with increments `way` [S] from s touch an elastic stop that they do not touch
        yet."""
        stiff = self.forces.tables.stops[:, STIFFNESS] > 0.0
        gap = np.where(way > 0.0, self.elastic[:, 1] - s, s - self.elastic[:, 0])
        return np.where(stiff & (gap >= 0.0), gap + TOUCH * self.lengths, np.inf)

    def is_rigid(self, way: Array) -> Array:
        """Return whether sliders with increments `way` [S] have a rigid stop ahead, bool [S]."""
        return np.isfinite(np.where(way > 0.0, self.stops[:, 1], self.stops[:, 0]))

    def meets(self, s: Array, steps: Array, way: Array) -> Array:
        """Return -1 or 1 for sliders with increments `way` [S] that steps [S] from s bring to a rigid stop at the start or the
        end, else 0."""
        slack = AT_STOP * self.lengths
        low = (way < 0.0) & (s + steps <= self.stops[:, 0] + slack)
        high = (way > 0.0) & (s + steps >= self.stops[:, 1] - slack)
        return high.astype(np.int64) - low

    def meet(self, which: Array, s: Array) -> None:
        """Let sliders rest against the stops that they met, `which` as of `meets`; s [S] are exactly these then."""
        self.modes.at_stop[which != 0] = which[which != 0]
        s[which < 0], s[which > 0] = self.stops[which < 0, 0], self.stops[which > 0, 1]

    # --- results ------------------------------------------------------------------------------------------------------
    def remember(self, history: Array) -> None:
        """Write into the history of a state that all sliders rest, at stops or by friction."""
        own = history[:HISTORY * self.held.size].reshape(-1, HISTORY)
        own[:, SIGN] = 0.0
        own[:, AGAINST] = self.modes.at_stop
        own[:, STICKS] = self.rubs & (self.modes.at_stop == 0)

    def report(self, names: list[str], equations: Equations) -> dict[str, dict[str, Any]]:
        """Report for every slider with friction: friction force, N, its largest value, and whether the slider sticks; equations:
        without friction."""
        most, needed = self.friction * equations.normal, equations.sliding
        force = np.where(self.modes.at_stop == 0, needed, np.clip(needed, -most, most))
        return {names[k]: {"force": float(force[k]), "cone": float(most[k]), "sticks": bool(self.modes.sign[k] == 0)}
                for k in np.flatnonzero(self.rubs).tolist()}


def with_friction(constraints: Constraints, found: Equations, slip: Array) -> Equations:
    """Add normal forces and friction to equations; slip [S]: coefficients of friction with the sign of the slip."""
    core, force = constraints.stepper.core, constraints.stepper.core_state.force
    t, (s, d) = found.along, found.along.shape
    f = force[:s * d].reshape(s, d)
    long, size = np.linalg.norm(t, axis=1), np.linalg.norm(f, axis=1)
    part = np.sum(f * t, axis=1) / long**2
    across = f - part[:, None] * t
    normal = np.linalg.norm(across, axis=1)
    edges, of_edges = edges_of(core, force)
    found = found._replace(normal=(normal + edges) * long, size=size + edges)
    if not slip.any():
        return found
    # the derivatives of (|F_across| + edges) |c'|
    bare = np.where(normal > ALONG_ONLY * size, normal, np.inf)
    by_force = (slip * long / bare)[:, None] * across
    by_tangent = (slip * (normal + edges) / long)[:, None] * t - (slip * part * long / bare)[:, None] * across
    # terms with the tangents are those of these vectors as contact forces
    other = np.zeros_like(force)
    other[:s * d] = by_tangent.reshape(-1)
    turning = constraints.at(other)
    if core.moving is not None:
        turning = _by_nodes(core, constraints.stepper.own["moving"], turning, by_tangent)
    pressed = Entries(np.repeat(np.arange(s), d), np.arange(s * d), by_force.reshape(-1))
    return found._replace(sliding=found.sliding + slip * found.normal, bend=found.bend + turning.bend, rubbing=turning.slide,
                          by_force=pressed.with_more(of_edges._replace(value=(slip * long)[of_edges.row] * of_edges.value)))


def _by_nodes(core: Model, following: Following, turning: Equations, by_tangent: Array) -> Equations:
    """Return derivatives of friction with those of contacts on moving meshes by the tangents there."""
    sliders, slide, bend = core.moving.sliders, turning.slide, turning.bend.copy()
    d, size = core.dim, len(core.dofs)
    bend[sliders] = 2.0 * np.sum(by_tangent[sliders] * following.tangent[:, 3:3 + d], axis=1)
    others = ~np.isin(slide.row, sliders)
    f, m = (following.nodes >= 0).nonzero()
    value = 2.0 * following.slope[f, m][:, None] * by_tangent[sliders[f]]
    column = size * core.pattern.row_of[following.nodes[f, m]].astype(np.int64)[:, None] + np.arange(d)
    free = column < size * core.pattern.n
    row = np.broadcast_to(sliders[f][:, None], column.shape)
    kept = Entries(slide.row[others], slide.column[others], slide.value[others])
    return turning._replace(bend=bend, slide=kept.with_more(Entries(row[free], column[free], value[free])))


def edges_of(core: Model, force: Array) -> tuple[Array, Entries]:
    """Evaluate the force of moments of sleeves on the edges of bores, N [S], and its derivative by the multipliers [S, F]."""
    press, value, row, column = np.zeros(core.n_sliders), [np.zeros(0)], [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for o, (k, c) in enumerate(core.sleeve_pairs.tolist()):
        at = core.first_force[c] + np.arange(core.forces[c])
        bore, key = core.sleeves.edges[2 * o:2 * o + 2]
        bending = float(np.linalg.norm(force[at[:2]]))
        press[k] = bore * bending + key * float(np.sum(np.abs(force[at[2:]])))
        value.append(np.concatenate((bore * force[at[:2]] / (bending or 1.0), key * np.sign(force[at[2:]]))))
        row.append(np.full(at.size, k))
        column.append(at)
    return press, Entries(*(np.concatenate(x) for x in (row, column, value)))


def turned_with_sleeves(of: RowMap, angles: dict[int, float], state: State) -> Entries:
    """Form the stiffness that moments of sleeves have from the second change of directors with the spins, on the unknowns of the
    rows, N m; angles: of sections that friction holds."""
    model, space = of.model, state.force
    n, at = model.n_nodes, state.force.size - 3 * len(model.sleeve_pairs)
    every = sections(model, state.s, state.q.reshape(-1, 4, 3))
    every = [section.turned_by(angles[o]) if o in angles else section for o, section in enumerate(every)]
    turned = sum(section.turned(space[at + 3 * o:at + 3 * o + 3], n) for o, section in enumerate(every))
    return entries_of_matrix(of.rows.T @ turned @ of.rows)
