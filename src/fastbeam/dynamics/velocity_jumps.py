"""Velocities that jump at an instant: impacts on rigid stops, locks that engage, supports that catch; theory.md 5.6."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.contact.slider_forces import (
    AGAINST,
    DRIVE_WORK,
    FREE,
    HELD,
    INCREMENT,
    LOCKED,
    OFF,
    POSITION,
    SIGN,
    STICKS,
    STOP_LOSS,
)
from fastbeam.kernels.joints import friction as joint_friction
from fastbeam.kernels.joints.coordinates import VALUE, WORK
from fastbeam.kernels.state import State
from fastbeam.linalg.least_norm import nearest_by
from fastbeam.model.connections import components
from fastbeam.model.gap_rows import ConstraintGaps, across_of
from fastbeam.model.maps import mass_map, velocities_and_spins
from fastbeam.model.model import Model
from fastbeam.model.rates import Motions, rates_in, unknowns_in, with_rates
from fastbeam.model.start import active_supports

Array = np.ndarray
# rates below this share of the largest are none behind an impact
MOVES = 1e-9
# a coordinate of a joint stands at a stop within this share of a large value
AT_STOP = 1e-9
# changes of what rests at stops behind an impact
MOST_PIVOTS = 200
# as in least_norm.py, for velocities by momenta: a mesh that moves along a resting beam has almost no inertia
HOLD = 1e-13
# share of the largest rate
ROUND_OFF = 1e-15
# share of the energy that jumps may give
NO_GAIN = 1e-15


def jump(model: Model, state: State, k: int | None, lead: Any, change: Array,
         rest: dict[int, float] | None = None) -> tuple[State, float]:
    """Return the state after an impact at slider k, and the energy that it dissipated, J.

    The jump has the least kinetic energy of all that connections, supports, sliders and joints allow and with which the velocity
    of the point of k relative to its curve changes by `change` in the directions `lead`: it is the
    effect of the impulse of that contact alone. Sliders whose motion is prescribed, that are locked or at rest against a stop
    keep their velocities along the beam; impulses of supports that move and of drives and motors that prescribe a motion do work,
    which counts as theirs. Joints that stand at a stop are at rest behind it where that takes an impulse that pushes, else they
    leave it.

    k: number of a slider; -1 - i: coordinate i of joints that may stick; None: a support.
    lead: float64 [m, 3], of a joint sparse [1, 12 N]; [0, 12 N] of one that does not bounce; of a support sparse [m, 12 N].
    change: float64 [m], m/s, of joints and supports m/s or rad/s.
    rest: coordinates of joints that come to rest at stops, and on which side.
    """
    equations = Equations(model, state, k, lead, change)
    history = state.history.copy()
    bounces = -1 - k if k is not None and k < 0 and change.size else -1
    found = _with_stops(equations, history, bounces, rest or {})
    v = equations.rates + found.by
    if model.slider_forces is not None:
        own = model.along_of(history)
        after = equations.along_beams(v)
        moves = ~equations.given & (own[:, HELD] == FREE) & (np.abs(after) > MOVES * np.max(np.abs(v)))
        if k is not None and k >= 0:
            moves[k] = False
        own[moves, SIGN] = np.sign(after[moves])
        own[moves, STICKS] = 0.0
    return equations.behind(found, history)


def settled(model: Model, state: State, k: int | None) -> tuple[State, float]:
    """Return the state at an instant with velocities that sliders, sleeves and joints allow exactly, the nearest ones, and the
    energy that this takes, J. At the end of a step they hold velocities to second order in the step, and what is left would turn
    around in the next one.

    k: as of `jump`, what meets a stop and is free along its way. Other sliders whose motion is prescribed keep their velocities
    along the beam; those that are locked or rest against a stop have none.
    """
    meets = -1 - k if k is not None and k < 0 else -1
    rests: list[int] = []
    if model.motions is not None and model.motions.holds.rubs.size:
        rests = np.flatnonzero(model.motions.holds.numbers(state.history)[:, joint_friction.AGAINST]).tolist()
    equations = Equations(model, state, k, None, np.zeros(0))
    rows = equations.coordinates[[j for j in rests if j != meets]]
    goals = -(rows @ equations.rates)
    if not equations.ask(goals):
        return state, 0.0
    return equations.behind(equations.least(rows, goals), state.history.copy())


def blow(model: Model, state: State, k: int, lead: Any, change: Callable[[State], Array]) -> tuple[State, State, float]:
    """Return the state whose velocities a jump begins at, the state behind it, and the energy that it took, which is not negative
    but for round-off.

    At the end of a step rates across what holds are zero to second order in the step. Impulses do work on these, and where a blow
    takes hardly anything that may be more: then the jump begins at the state that `settled` finds, with what that takes.

    k, lead: as in `jump`, for a slider.
    change: the change of rates from a state.
    """
    start = of_momenta(model, state)
    begin, before = start, 0.0
    after, loss = jump(model, begin, k, lead, change(begin))
    if loss < -NO_GAIN * float(state.v @ (mass_map(model) @ state.v)):
        begin, before = settled(model, start, k)
        after, loss = jump(model, begin, k, lead, change(begin))
    return begin, with_momenta(model, state, start, after), before + loss


def strike_joint(model: Model, state: State, i: int, at_end: bool, restitution: float,
                 together: dict[int, float] | None = None) -> State:
    """Return the state after coordinate i of those of joints that may stick has met a rigid stop; as `strike`. Where it does not
    bounce it comes to rest, with those that met stops at the same instant, `together`, and on which side."""
    holds = model.motions.holds
    start = of_momenta(model, state)
    free, before = settled(model, start, -1 - i)
    rows = ConstraintGaps(model)
    row = rows.at(state.q, state.s).rates[rows.coordinates[i]]
    rate = float((row @ rates_in(model, free))[0])
    bounces = restitution * rate * (1.0 if at_end else -1.0) > 0.0
    rest = {} if bounces else {**(together or {}), i: 1.0 if at_end else -1.0}
    after, loss = jump(model, free, -1 - i, row[:int(bounces)], np.full(int(bounces), -(1.0 + restitution) * rate), rest)
    own = holds.numbers(after.history)
    own[i, joint_friction.STOP_LOSS] += before + loss
    if bounces:
        own[i, joint_friction.SIGN], own[i, joint_friction.STICKS] = -np.sign(rate), 0.0
    return with_momenta(model, state, start, after)


def strike(model: Model, state: State, k: int, at_end: bool, restitution: float) -> State:
    """Return the state after slider k has met a rigid stop.

    The velocity of k along its beam is -restitution times the one before, see `jump`, or zero where that leads away from the stop
    already. The energy that is lost goes to the history of the slider.

    model: Model with tables in space.
    state: state with sliding points on their curves.
    at_end: whether the stop is the one towards the end of the beam.
    """
    side, gaps = 1.0 if at_end else -1.0, ConstraintGaps(model).at(state.q, state.s)

    def change(begin: State) -> Array:
        rate = gaps.along(k, rates_in(model, begin))
        return -(1.0 + restitution * (side * rate > 0.0)) * rate * gaps.tangents[k]

    begin, after, loss = blow(model, state, k, np.eye(3), change)
    rate = gaps.along(k, rates_in(model, begin))
    own = model.along_of(after.history)
    own[k, STOP_LOSS] += loss
    own[k, SIGN] = -np.sign(rate)
    if rate != 0.0:
        own[k, STICKS] = 0.0
    if not restitution * side * rate > 0.0:
        own[k, SIGN], own[k, AGAINST] = 0.0, side
    return after


def of_momenta(model: Model, state: State) -> State:
    """Return the state with motions of triads that are nearest to its momenta. Rates of directors at the end of a step are none,
    to second order in the step, and velocities of moving meshes differ so from their momenta, which are unknowns of their own:
    jumps begin here and end with `with_momenta`."""
    motions = Motions(model, state)
    free, lift = motions.free, motions.lift
    momentum = motions.masses @ rates_in(model, state)
    if model.moving is not None:
        momentum += model.moving.momentum(state.history, state.q, state.s)
    found = unknowns_in(model, state)
    missing = momentum - motions.inertia @ (motions.to_rates @ found)
    rows = _at_contacts(model, state) @ lift
    found[free] = nearest_by(motions.mass, rows, np.zeros(rows.shape[0]), found[free], motions.turns, lift.T @ missing, HOLD)[0]
    return with_rates(model, state, motions.to_rates @ found, state.history.copy())


def _at_contacts(model: Model, state: State) -> Any:
    """Return the rates of points, and of sections in sleeves, relative to the nodes of moving meshes at them, sparse
    [m, 12 N + P]."""
    if model.moving is None:
        return sparse.csr_matrix((0, state.v.size))
    rows, sliders = ConstraintGaps(model), model.moving.sliders
    of_sleeves = [x for (k, _), x in zip(model.sleeve_pairs, rows.moments) if k in sliders]
    every = np.concatenate(((3 * sliders[:, None] + np.arange(3)).reshape(-1), *of_sleeves))
    rates = rows.at(state.q, state.s).rates[every].tolil()
    rates[:, state.v.size:] = 0.0
    return rates.tocsr()


def with_momenta(model: Model, state: State, before: State, after: State) -> State:
    """Return a state behind a jump from `before`, its own by `of_momenta`, to `after`: momenta, and velocities that are these,
    change as the velocities; those of nodes that only moving meshes have become the ones of `after`."""
    by, history = after.v - before.v, after.history.copy()
    v = (state.v + by).reshape(-1, 12)
    if model.moving is not None:
        model.moving.put_blow(history, state.q, state.s, rates_in(model, after) - rates_in(model, before))
        alone = _alone_on_meshes(model)
        v[alone] = after.v.reshape(-1, 12)[alone]
    return State(state.q.copy(), v.reshape(-1), state.s.copy(), state.force.copy(), history)


def _alone_on_meshes(model: Model) -> Array:
    """Return nodes of moving meshes to which no others are tied, bool [N]."""
    assert model.moving is not None
    n, ties = model.n_nodes, model.ties
    pairs = [np.stack((np.arange(n), model.pattern.first_on_row), axis=1)]
    if ties is not None:
        pairs.append(np.stack((np.repeat(np.arange(n), np.diff(ties.start)), ties.target), axis=1))
    piece = components(n, np.concatenate(pairs))
    mesh = np.zeros(n, bool)
    mesh[model.moving.nodes] = True
    return mesh & (np.bincount(piece, ~mesh)[piece] == 0.0)


def values_of(model: Model, state: State) -> Array:
    """Return values of the coordinates of joints that may stick, as the history has them, m or rad, [R]."""
    motions = model.motions
    if motions is None:
        return np.zeros(0)
    return motions.own(state.history, model.place("motions"))[motions.holds.rubs, VALUE]


class Least(NamedTuple):
    """Jump of least kinetic energy."""

    by: Array  # float64 [12 N + P]: changes of the rates of all coordinates, and of places of contacts on moving meshes
    impulses: Array  # float64 [m]
    rows: Any  # sparse [m, 12 N + P]: directions in which the impulses act


class Equations:
    """Conditions of connections, supports, sliders and joints on a jump of the velocities; arguments as of `jump`, without `lead`
    those of `settled`.

    given: bool [S], sliders whose velocities along the beam do not jump: prescribed, locked or at rest against a stop.
    rates: float64 [12 N + P], rates of the state.
    coordinates: sparse [R, 12 N + P], rates of the coordinates of joints that may stick by all rates.
    """

    def __init__(self, model: Model, state: State, k: int | None, lead: Any, change: Array) -> None:
        self.model, self.state, self.rates = model, state, rates_in(model, state)
        own = model.along_of(state.history)
        rows = ConstraintGaps(model)
        self._gaps = gaps = rows.at(state.q, state.s)
        self.coordinates = gaps.rates[rows.coordinates]
        self.given = driven = np.zeros(len(gaps.tangents), bool)
        if model.slider_forces is not None:
            driven = np.isin(model.slider_forces.tables.drive, (POSITION, INCREMENT))
            self.given = driven | (own[:, AGAINST] != 0.0) | (own[:, HELD] == LOCKED)
        settles, slides = lead is None, k is not None and k >= 0
        self._rows: list[Any] = [] if slides or settles else [lead]
        right: list[Array] = [] if slides or settles else [change]
        # first equations of sliders whose drives prescribe a motion
        self._drives: dict[int, int] = {}
        for j, tangent in enumerate(gaps.tangents):
            if model.slider_forces is not None and own[j, HELD] == OFF and (settles or j != k):
                continue
            across = across_of(tangent)
            leads = lead if j == k and not settles else np.eye(3) if self.given[j] and j != k else across
            if driven[j] and j != k and own[j, HELD] == FREE and own[j, AGAINST] == 0.0:
                self._drives[j] = sum(x.size for x in right)
            self._rows.append(sparse.csr_matrix(leads) @ self._of_slider(j))
            if settles:
                # only a drive keeps a rate along the beam
                relative = self._of_slider(j) @ self.rates
                right.append(-leads @ (across.T @ across @ relative if j in self._drives or j == k else relative))
            else:
                right.append(change if j == k else np.zeros(len(leads)))
        self._behind_joints = sum(x.size for x in right) + rows.joints.size
        others = gaps.rates[rows.others]
        self._rows += [others, gaps.met]
        right.append(-(others @ self.rates) if settles else np.zeros(others.shape[0]))
        # given coordinates keep their rates
        right[-1][:rows.joints.size][rows.given] = 0.0
        right.append(-(gaps.met @ self.rates) if settles else np.zeros(gaps.met.shape[0]))
        self._goal = np.concatenate(right)
        self._motions = Motions(model, state)
        self._mass = self._motions.mass

    def ask(self, goals: Array) -> bool:
        """Return whether anything but round-off has to change, with changes of further rates."""
        wanted = float(np.max(np.abs(np.concatenate((self._goal, goals))), initial=0.0))
        return wanted > ROUND_OFF * float(np.max(np.abs(self.rates), initial=0.0))

    def _of_slider(self, j: int) -> Any:
        """Return the velocity of a point relative to its curve from all rates, sparse [3, 12 N + P]."""
        return self._gaps.rates[3 * j:3 * j + 3]

    def along_beams(self, v: Array) -> Array:
        """Return ds/dt of all sliders at rates [12 N + P], m/s."""
        return np.array([self._gaps.along(j, v) for j in range(len(self._gaps.tangents))])

    def least(self, more: Any, goals: Array) -> Least:
        """Find the jump with which these rates [m] change, too; more: sparse [m, 12 N + P]."""
        every = sparse.vstack([*self._rows, more], format="csr")
        lift, turns = self._motions.lift, self._motions.turns
        x, impulses = nearest_by(self._mass, (every @ lift).tocsr(), np.concatenate((self._goal, goals)), np.zeros(turns.size),
                                 turns)
        return Least(np.asarray(lift @ x), impulses, every)

    def behind(self, found: Least, history: Array) -> tuple[State, float]:
        """Return the state behind a jump, with a history that is changed, and the energy that it took, J."""
        by, put_in = found.by, self._add_works(found, history)
        after = with_rates(self.model, self.state, self.rates + by, history)
        return after, put_in - float(by @ (self._motions.inertia @ (self.rates + 0.5 * by)))

    def _add_works(self, found: Least, history: Array) -> float:
        """Work of drives and motors that prescribe a motion and of supports that move in a jump, J, which is added to theirs."""
        model, state, impulses = self.model, self.state, found.impulses
        own = model.along_of(history)
        total = 0.0
        for j, at in self._drives.items():
            work = float(impulses[at:at + 3] @ self._gaps.tangents[j]) * self._gaps.along(j, self.rates)
            own[j, DRIVE_WORK] += work
            total += work
        if model.motions is not None and model.motions.holds.given.size:
            given = model.motions.holds.given
            at = self._behind_joints - given.size + np.arange(given.size)
            works = impulses[at] * (found.rows[at] @ self.rates)
            model.motions.own(history, model.place("motions"))[given, WORK] += works
            total += float(np.sum(works))
        supports = active_supports(model, state)
        if supports:
            force = self._motions.to_rates.T @ (self._motions.inertia @ found.by - found.rows.T @ impulses)
            force = force[:6 * model.n_nodes].reshape(-1, 6)[model.pattern.first_on_row]
            q, v = (x.reshape(-1, 4, 3) for x in (state.q, state.v))
            for k, motion, node in supports:
                fixed_components = (motion.mask >> np.arange(6) & 1).astype(bool)
                work = float(force[node, fixed_components] @ velocities_and_spins(q[node], v[node])[fixed_components])
                history[model.works_place + k] += work
                total += work
        return total


def _with_stops(equations: Equations, history: Array, bounces: int, rest: dict[int, float]) -> Least:
    """Find the jump beside joints at stops, which push only; bounces: the coordinate that does, or -1; rest: as of `jump`. Write
    into the history which joints rest behind it, and signs of the velocities of others with friction.

    Rates into stops are zero, impulses push, and one of both is zero (a linear complementarity problem): Murty's least index
    method, which ends for every inertia."""
    model, state, rows = equations.model, equations.state, equations.coordinates
    if not rows.shape[0]:
        return equations.least(rows, np.zeros(0))
    holds = model.motions.holds
    own = holds.numbers(history)
    rates = rows @ equations.rates
    off = values_of(model, state)[:, None] - holds.ends
    near = np.abs(off) <= AT_STOP * holds.scales[:, None]
    side = np.where(near[:, 1], 1.0, np.where(near[:, 0], -1.0, 0.0))
    rests = own[:, joint_friction.AGAINST] != 0.0
    side[rests] = own[rests, joint_friction.AGAINST]
    for i, of in rest.items():
        side[i] = of
    if bounces >= 0:
        side[bounces] = 0.0
    at_stop = np.flatnonzero(side).tolist()
    active = [i for i in at_stop if rests[i] or i in rest or side[i] * rates[i] > 0.0]

    def jump_with(some: list[int]) -> tuple[Least, Array, float]:
        """Return the jump with these joints at rest, rates into stops behind it, and the rate that counts as zero."""
        found = equations.least(rows[some], -rates[some])
        v = equations.rates + found.by
        return found, side[at_stop] * (rows[at_stop] @ v), MOVES * float(np.max(np.abs(v), initial=0.0))

    for _ in range(MOST_PIVOTS):
        found, into, none = jump_with(active)
        for n, i in enumerate(at_stop):
            if i in rest:
                continue
            if i in active:
                # without the stop it would leave it: its impulse pulls
                others = [j for j in active if j != i]
                _, alone, none = jump_with(others)
                if alone[n] < -none:
                    active = others
                    break
            elif into[n] > none:
                active = sorted([*active, i])
                break
        else:
            break
    v = equations.rates + found.by
    for i, rate in enumerate((rows @ v).tolist()):
        if i in active:
            own[i, [joint_friction.SIGN, joint_friction.STICKS, joint_friction.AGAINST]] = 0.0, 0.0, side[i]
        elif side[i] != 0.0 or abs(rate) > MOVES * float(np.max(np.abs(v))):
            own[i, [joint_friction.SIGN, joint_friction.STICKS, joint_friction.AGAINST]] = np.sign(rate), 0.0, 0.0
    return found
