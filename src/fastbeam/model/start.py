"""State at the start of a run: checks against connections, supports and sliders of the model, and mending of small errors."""
from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from fastbeam.interface.arguments import LARGEST, numbers, shown
from fastbeam.interface.errors import SceneError
from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.contact.slider import END_SLACK
from fastbeam.kernels.contact.slider_forces import FREE, HELD, OFF
from fastbeam.kernels.layout import TRIAD
from fastbeam.kernels.state import State
from fastbeam.linalg.least_norm import middles, nearest_by, rigid_change, rigid_motions, rigid_share
from fastbeam.model.connections import HOLD_TRIAD, components, fixed_axes
from fastbeam.model.gap_rows import ConstraintGaps, across_of
from fastbeam.model.joints.constraints import Distance
from fastbeam.model.joints.coordinates import Coordinate
from fastbeam.model.mapping import follow, turned
from fastbeam.model.maps import free_unknowns, mass_map, rates_map, share_map, spins, tie_map, velocities_and_spins, velocity_map
from fastbeam.model.model import Model
from fastbeam.model.rates import rates_in

Array = np.ndarray
# largest gap from round-off of a long run between welded ends of a net, relative to the size of the scene, or for triads to 1;
# supports whose nodes are displaced by more raise an event
TIED = 1e-7
# largest gap of a slider at the start, relative to the size of the scene: an impulse would close it in the first step
GAP = 1e-12
# largest distance of a slider beyond a rigid stop, as a share of the length of the beam
AT_STOP = 1e-9
# velocity of a slider across its curve, relative to the largest velocity, that raises an event, and that raises an error; it is
# not zero, because velocities at the end of a step satisfy constraints on positions to second order only
SIDEWAYS, UNTRUE = 0.01, 0.5
# difference between velocities of a state and those of its momenta, relative to the largest velocity, that raises an error: in
# runs it grows with the square of the step, to 0.05 with steps of a tenth of a period
EDITED = 0.1
# allowance for the same difference in a state near rest, in sizes of the scene a step
AT_REST = 1e-6
TURNS_AROUND = "contact forces alternate from step to step, with the size needed to reverse this velocity; use a smaller step"
JUMPS = ("the support moves its node with a velocity jump, after which forces alternate from step to step. Let the motion begin "
         "with the velocity of the state")
# largest error of places that Start(mend=True) mends, as a share of the size of the scene
MENDABLE = 1e-2
# largest change of velocities of the scene without an event, as a share of the largest velocity
CHANGES = 1e-9
# size of closed gaps, round-off, as a share of the size of the scene
CLOSED = 4.0 * float(np.finfo(float).eps)
# rounds in which parts are moved until joints close
ROUNDS = 8
# factor on the mass of beams when places are mended, so that sliding points move rather than their beams
STIFF = 100.0


@dataclass
class Misfit:
    """Violation of a condition by the state at the start: text, size and unit, largest size allowed, largest that can be mended,
    size from which an event is raised, and text of the event."""

    what: str
    size: float
    unit: str
    allowed: float
    mendable: float
    told: float = np.inf
    word: str = TURNS_AROUND


def own_state(model: Model, state: State) -> State:
    """Return a checked copy of a state that fits the model; compiled code reads it without bounds. Raises SceneError: the start
    is not a State, or is one of another model."""
    if not isinstance(state, State):
        raise SceneError(f"start: must be a State (result.state, model.state()), got {shown(state)}")
    found = [numbers(x) for x in state]
    for name, given, x, mine in zip(State._fields, state, found, model.state()):
        if x is None:
            raise SceneError(f"start: {name} must hold real numbers, got {shown(given)}; start from the state of a run")
        if x.shape != mine.shape:
            raise SceneError(f"start: {name} has shape {x.shape}, scene {model.scene_name!r} needs {mine.shape}; start from "
                             "a state of the same model, or bring it over with result.state_for(model)")
        if not np.all(np.abs(x) <= LARGEST):
            what = f"larger than {LARGEST:g}" if np.isfinite(x).all() else "that are not finite"
            raise SceneError(f"start: {name} has values {what}; start from an earlier state")
    own = State(*(np.array(x, dtype=float) for x in found))
    triads = own.q.reshape(-1, 4, 3)[:, 1:]
    skew = float(np.max(np.abs(triads @ triads.transpose(0, 2, 1) - np.eye(3)), initial=0.0))
    if skew > 1e-6:
        raise SceneError(f"start: the directors of a node are not orthonormal (off by {skew:.3g}); start from the state of a run")
    limits, ends = model.limits_at(own.s, own.history), model.ends_at(own.s)
    # steps do not watch over the ends where a slider is held
    free = model.slider_forces is None or model.along_of(own.history)[:, HELD] == FREE
    slack = np.where(free, END_SLACK, AT_STOP) * model.slider_lengths
    of_sliders = own.s, model.slider_lengths, slack, ends, limits, model.names["sliders"]
    for s, length, beyond, (begin, end), (low, high), name in zip(*of_sliders):
        if not begin - beyond <= s <= end + beyond:
            raise SceneError(f"start: slider {name!r} is at s = {s:.6g} m, outside its beam (0 to {length:.6g} m)")
        if not low - AT_STOP * length <= s <= high + AT_STOP * length:
            raise SceneError(f"start: slider {name!r} is at s = {s:.6g} m, beyond its stops ({low:.6g} to {high:.6g} m)")
    return own


def check_start(model: Model, state: State, step: float, mend: bool | None = None, at_rest: bool = False, t: float | None = None,
                goes_on: bool = False) -> tuple[State, list[Any]]:
    """Return the state to start from, bit for bit the same where it agrees with the model, and (kind, text) of its events.

    step: step size of the run, s: round-off of a velocity is that of a position over it.
    mend: replace a state with small errors by a near one that agrees with the model; None: the caller has no such option.
    at_rest: ignore the velocities.
    t: time at which the run begins, s: supports that move are checked, too.
    goes_on: true for a state of a run of this model: its velocities satisfy constraints to second order in the step, and are
        accepted however coarse the step was.
    Raises SceneError: the state is not one of the model, or violates connections, supports or sliders; says which and by how
        much.
    """
    state = own_state(model, state)
    if at_rest:
        model.stop(state)
    notes: list[Any] = _displaced_supports(model, state)
    if not (at_rest or goes_on) and model.moving is not None:
        state, told = _with_written_velocities(model, state, step)
        notes += told
    if t is not None:
        notes += moved_supports(model, state, t)
    if not at_rest:
        notes += _at_rest_where_the_scene_moves(model, state) + _swapped_springs(model, state)
    found = misfits(model, state, step, t)
    if goes_on:
        found = [m for m in found if m.mendable < np.inf]
    worst = _worst(found)
    if worst is None:
        if not mend:
            notes += [("shock" if m.word is JUMPS else "start", f"{m.what} {m.size:.3g} {m.unit} at the start: {m.word}, or "
                       "start=Start(state, mend=True)") for m in found if m.size > m.told]
        if not mend or not any(m.size > m.told for m in found):
            return state, notes
        worst = max(found, key=lambda m: m.size / m.told)
    if mend and worst.size <= worst.mendable:
        state = mended(model, state, t)
        left = _worst(misfits(model, state, step, t))
        if left is None:
            return state, [*notes, ("mended", f"the start was corrected: {worst.what} {worst.size:.3g} {worst.unit} off")]
        worst = left
    if mend:
        advice = f"Start(mend=True) corrects errors up to {worst.mendable:.2g} {worst.unit}"
    elif worst.size <= worst.mendable:
        advice = f"{'' if mend is not None else 'simulate can '}correct it with start=Start(state, mend=True)"
        if worst.unit == "m/s":
            advice += ": the parts then meet in an inelastic impact, which conserves momenta and dissipates energy"
    else:
        advice = "this is too large to be mended"
    raise SceneError(f"start: {worst.what} {worst.size:.3g} {worst.unit} off (allowed: {worst.allowed:.2g}); {advice}, or start "
                     "from a state of a run of this model, or build the scene with its parts at the places of the state")


def _with_written_velocities(model: Model, state: State, step: float) -> tuple[State, list[Any]]:
    """Return a state on moving meshes with momenta of velocities that do not fit those in its history, because they were written
    into it, and an event of that."""
    moving, speed = model.moving, _speed_of(model, state)
    allowance = AT_REST * model.length / step
    # as it is, or of a motion that goes back
    for one in (state, state._replace(history=moving.reversed(state.history))):
        found = moving.written(model, one)
        jumps = np.abs(moving.places_in(found.history) - moving.places_in(one.history))
        if model.momenta_misfit(one) <= EDITED * speed + allowance and np.max(jumps) <= SIDEWAYS * speed + allowance:
            return one, []
    found = moving.written(model, state)
    return found, [("start", "velocities do not fit the momenta of beams with moving elements in State.history; they are taken "
                             "as velocities of the material that were written into the state, and momenta follow from them")]


def _speed_of(model: Model, state: State) -> float:
    """Return the largest velocity in a state, with that of turning in the size of the scene, m/s."""
    v = state.v.reshape(-1, 4, 3)
    return float(np.max(np.abs(v[:, 0]), initial=0.0)) + model.length * float(np.max(np.abs(v[:, 1:]), initial=0.0))


def _worst(found: list[Misfit]) -> Misfit | None:
    """Return the first violation that cannot be mended, else the largest relative to what can be mended; None where all are
    allowed."""
    wrong = [m for m in found if not m.size <= m.allowed]
    return max(wrong, key=lambda m: m.size / m.mendable if m.size == m.size else np.inf, default=None)


def misfits(model: Model, state: State, step: float, t: float | None = None) -> list[Misfit]:
    """Return the largest violation of every kind; t: time at which the run begins, to check supports that move."""
    q, v = state.q.reshape(-1, 4, 3), state.v.reshape(-1, 4, 3)
    length = model.length
    reach = length + float(np.max(np.abs(q[:, 0])))
    speed = _speed_of(model, state)
    noise = 1e-12 * reach / step
    # mending by an impact does not include added mass and moving meshes
    most = np.inf if model.added is None and model.moving is None else MENDABLE * speed
    out: list[Misfit] = []

    def add(what: str, error: Array, nodes: Array, unit: str, allowed: float, mendable: float) -> None:
        """Add the largest error [m, ...] of nodes [m] to the violations."""
        if len(nodes):
            size = np.sqrt(np.sum(error.reshape(len(nodes), -1)**2, axis=1))
            # angle between two triads from the norm of their difference
            size = size if unit != "rad" else 2.0 * np.arcsin(np.minimum(size / np.sqrt(8.0), 1.0))
            k = int(np.argmax(size))
            out.append(Misfit(what.format(_joint_of(model, int(nodes[k]))), float(size[k]), unit, allowed, mendable))

    place, rate = follow(model, q), follow(model, v)
    tied = model.ties.slave if model.ties is not None else np.zeros(0, np.int64)
    # a run keeps gaps between welded ends of a net, and closes all others in its first step
    for led, off in ((tied, GAP), (np.setdiff1d(np.flatnonzero(_follows(model)), tied), TIED)):
        add("{} stands", (q - place)[led, 0], led, "m", off * reach, MENDABLE * length)
        add("{} is turned by", (q - place)[led, 1:], led, "rad", 10.0 * off, MENDABLE)
        add("the velocity of {} is", (v - rate)[led, 0], led, "m/s", off * speed + noise, most)
        add("the spin of {}, times the size of the scene, is", (v - rate)[led, 1:] * length, led, "m/s", off * speed + noise,
            most)
    supported = _standing(model, state)
    for bits, part, what in ((7, slice(0, 1), "the support of {}: its velocity is"),
                             (56, slice(1, 4), "the support of {}: its spin, times the size of the scene, is")):
        still = np.flatnonzero(supported & bits != 0)
        axes = fixed_axes(supported[still])[:, None] if bits == 7 else length
        add(what, v[still, part] * axes, still, "m/s", 1e-12 * speed, most)
    for motion, node in moving_supports(model, state) if t is not None else ():
        rates = np.array(motion.rates(t))
        off = velocities_and_spins(q[node], v[node]).reshape(2, 3) - rates
        off *= fixed_axes(np.array([motion.mask]))[0], [float(motion.mask & 56 != 0)] * 3
        size = float(np.linalg.norm(off[0])) + length * float(np.linalg.norm(off[1]))
        # a state of solve_static is accepted as it is: it raises an event, and is mended on request
        told = SIDEWAYS * max(speed, float(np.linalg.norm(rates[0]))) + noise
        out.append(Misfit(f"the velocity of {model.labels[node]}, relative to that of {motion.label}, is", size, "m/s", np.inf,
                          np.inf, told, JUMPS))
    for place, moves, gap, rate, is_angle in _gaps_and_rates(model, state):
        # the rate of an angle times the size of the scene is a velocity
        unit, big, wide, per = ("rad", 1.0, 1.0, length) if is_angle else ("m", reach, length, 1.0)
        out.append(Misfit(place, gap, unit, GAP * big, MENDABLE * wide))
        out.append(Misfit(moves, rate * per, "m/s", UNTRUE * speed + noise, np.inf, SIDEWAYS * speed + noise))
    of_momenta = model.momenta_misfit(state)
    if of_momenta > 0.0:
        allowance = AT_REST * length / step
        out.append(Misfit("velocities, relative to those from the momenta of moving meshes and added mass, are", of_momenta,
                          "m/s", EDITED * speed + allowance, np.inf, SIDEWAYS * speed + allowance,
                          "the momenta are used; set velocities of the parts in the scene instead"))
    return out


def _gaps_and_rates(model: Model, state: State) -> Iterator[tuple[str, str, float, float, bool]]:
    """Yield for every constraint the texts of its gap and of its rate, their sizes, m and m/s or rad and rad/s, and True for an
    angle."""
    if not model.n_constraints:
        return
    rows = ConstraintGaps(model, state.history)
    values, by_rates, tangents, met, _ = rows.at(state.q, state.s)
    every = rates_in(model, state)
    rates, names, away = by_rates @ every, model.names["sliders"], off_beam(model, state)
    more = np.zeros(model.n_sliders)
    if model.moving is not None:
        more[model.moving.sliders] = met @ every
    for k in np.flatnonzero(~away).tolist():
        relative, tangent = rates[3 * k:3 * k + 3], tangents[k]
        across = relative - (relative @ tangent) / (tangent @ tangent) * tangent + more[k] * tangent
        yield (f"slider {names[k]!r}: its point lies", f"slider {names[k]!r}: the velocity of its point across the beam is",
               float(np.linalg.norm(values[3 * k:3 * k + 3])), float(np.linalg.norm(across)), False)
    for (k, _), of_sleeve in zip(model.sleeve_pairs, rows.moments):
        name = f"sleeve {names[k]!r}"
        yield (f"{name}: its direction is", f"{name}: its spin relative to the section of the beam, times the size of the scene, "
                                            "is",
               _angle(values[of_sleeve]), float(np.linalg.norm(rates[of_sleeve])), True)
    for link, first in zip(model.kept, model.first_force[model.n_sliders:]):
        if isinstance(link.law, Coordinate):
            # prescribed values depend on time
            continue
        at = slice(first, first + link.forces(3))
        gap, rate = values[at], float(np.linalg.norm(rates[at]))
        if isinstance(link.law, Distance):
            # error of the length l - L, from (l^2 - L^2)/(2 L)
            a, b = model.q0.reshape(-1, 4, 3)[list(link.node), 0]
            gap = 2.0 * gap / (1.0 + np.sqrt(1.0 + 2.0 * gap / np.linalg.norm(b - a)))
        place, moves, size = ("its directions are", "the rate of its directions is", _angle(gap)) if link.law.is_angle else (
            "its points lie", "the velocity of its points is", float(np.linalg.norm(gap)))
        if link.coupled:
            place, moves, size = "its coordinates are", "the rate of its coordinates is", float(np.abs(gap[0]))
        yield f"{link.name}: {place}", f"{link.name}: {moves}", size, rate, bool(link.law.is_angle)


def _angle(products: Array) -> float:
    """Return the angle, rad, between directions whose products are its sines."""
    return float(np.arcsin(min(float(np.linalg.norm(products)), 1.0)))


def off_beam(model: Model, state: State) -> Array:
    """Return which sliders have left their beams, bool [S]."""
    if model.slider_forces is None:
        return np.zeros(model.n_sliders, bool)
    return np.asarray(model.along_of(state.history)[:, HELD] == OFF)


def _follows(model: Model) -> Array:
    """Return which nodes are slave nodes, or share the row of a node before them, bool [N]."""
    out = model.pattern.first_on_row != np.arange(model.n_nodes)
    if model.ties is not None:
        out[model.ties.slave] = True
    return out


def _led(model: Model) -> Array:
    """Return the node whose triad every node turns with, itself for a node with its own triad, int64 [N]."""
    out = model.pattern.first_on_row.copy()
    if model.ties is not None:
        turns = model.ties.kind == TRIAD
        out[np.repeat(np.arange(out.size), np.diff(model.ties.start))[turns]] = model.ties.target[turns]
    return out


def _joint_of(model: Model, node: int) -> str:
    """Return the label of a node with the joints at it, for messages."""
    joints = model.joints.get(node, [])
    return f"{model.labels[node]} ({', '.join(joints)})" if joints else model.labels[node]


def _standing(model: Model, state: State) -> Array:
    """Return the unknowns of every node that a support at rest fixes, bit by bit, int64 [N]; nodes that follow others only in
    position have their own triad."""
    supported = model.fixed_in(state)
    supported[_follows(model)] &= HOLD_TRIAD
    supported[_led(model) != np.arange(supported.size)] = 0
    if model.prescribed is not None:
        for motion, node in zip(model.prescribed.motions, model.prescribed.own):
            supported[model.pattern.row_of == model.pattern.row_of[node]] &= ~motion.mask
    return supported


def moving_supports(model: Model, state: State) -> list[tuple[Any, int]]:
    """Return the motions that hold their nodes from the start on, with these nodes; not those with `since`, which take hold
    wherever their nodes are then."""
    return [(motion, node) for _, motion, node in active_supports(model, state) if motion.since is None]


def active_supports(model: Model, state: State) -> list[tuple[int, Any, int]]:
    """Return the motions of supports that hold now: number, motion and node."""
    if model.prescribed is None:
        return []
    gone: set[int] = set()
    if model.released is not None:
        off = model.released.off(model.own(state.history, "released"))
        gone = set(model.released.motion[off].tolist())
    pairs = zip(model.prescribed.motions, model.prescribed.own.tolist())
    return [(k, *pair) for k, pair in enumerate(pairs) if k not in gone]


def _put_rates_of_supports(model: Model, state: State, t: float, out: Array) -> None:
    """Write the velocities and spins of supports that move at time t into those of all nodes [N, 6]."""
    for motion, node in moving_supports(model, state):
        bits = np.append(fixed_axes(np.array([motion.mask]))[0], np.full(3, bool(motion.mask & 56)))
        out[node, bits] = np.concatenate(motion.rates(t))[bits]


def moved_supports(model: Model, state: State, t: float) -> list[tuple[str, str]]:
    """Return events for supports that move and whose nodes in the state are not at their places at time t."""
    q, q0 = state.q.reshape(-1, 4, 3), model.q0.reshape(-1, 4, 3)
    reach = model.length + float(np.max(np.abs(q0[:, 0])))
    out = []
    more = {} if model.prescribed is None else model.prescribed.more_turns(model.turns_of(state.history), t)
    for motion, node in moving_supports(model, state):
        place = motion.place(t) if motion.position is not None else q0[node, 0] + motion.place(t) - motion.place(0.0)
        away = float(np.linalg.norm(np.where(fixed_axes(np.array([motion.mask]))[0], q[node, 0] - place, 0.0)))
        turn = motion.turn(t) @ motion.turn(0.0).T
        angle = _turned_by(q[node, 1:], q0[node, 1:] @ turn.T) if motion.rotation is not None else 0.0
        angle = max(angle, more.get(motion.name, 0.0))
        if away > TIED * reach or angle > 10.0 * TIED:
            by = " and ".join(text for text, size in ((f"{away:.3g} m", away), (f"{angle:.3g} rad", angle)) if size)
            out.append(("support", f"{motion.label} begins at t = {t:.6g} s, but {model.labels[node]} is {by} away from the "
                                   "prescribed place at that time, and keeps this offset: only later changes of the function "
                                   "are added to its position. Start with a state of that time, or give the time of the state, "
                                   "Start(state, time=...)"))
    return out


def _turned_by(a: Array, b: Array) -> float:
    """Return the angle between two triads (3, 3), rad."""
    return 2.0 * float(np.arcsin(min(1.0, float(np.linalg.norm(a - b)) / np.sqrt(8.0))))


def _displaced_supports(model: Model, state: State) -> list[tuple[str, str]]:
    """Return events for supports whose nodes in the state are not at their places in the model: they hold them there."""
    off = (state.q - model.q0).reshape(-1, 4, 3)
    # nodes of supports that have taken hold stand elsewhere
    supported = _standing(model, state) & model.fixed_mask
    away = np.linalg.norm(np.where(fixed_axes(supported), off[:, 0], 0.0), axis=1)
    turned = np.where((supported == 63) & (model.numbers.rank != 9), np.linalg.norm(off[:, 1:], axis=(1, 2)), 0.0)
    k, i = int(np.argmax(away)), int(np.argmax(turned))
    out = []
    if away[k] > TIED * (model.length + float(np.max(np.abs(model.q0.reshape(-1, 12)[:, :3])))):
        out.append(("support", f"the support of {model.labels[k]} is {away[k]:.6g} m away from its place in the model, and fixes "
                               "the node at this distance"))
    if turned[i] > 10.0 * TIED:
        out.append(("support", f"the clamp of {model.labels[i]} is rotated relative to the model, and fixes the node in this "
                               "rotation"))
    return out


def mended(model: Model, state: State, t: float | None = None) -> State:
    """Return a state near to this one that slave nodes, supports and sliders allow.

    Parts move as rigid bodies first, with the least motion in the norm of the masses, and bend only where joints are open still:
    bodies and masses then give way before beams. Velocities jump as in an inelastic impact, by the jump of least kinetic energy
    to admissible velocities: parts without support keep their momenta. t: time at which supports that move give the velocities
    of their nodes; None: they have those of the state.
    """
    if off_beam(model, state).any():
        raise SceneError("start, mend: a slider is off its beam, which cannot be corrected; start from the state of a run "
                         "without mend")
    q, s, rows = state.q.reshape(-1, 4, 3).copy(), state.s.copy(), ConstraintGaps(model, state.history)
    _close_rigidly(model, rows, state, q, s)
    q = follow(model, q)
    inertia = mass_map(model)
    beams = sparse.diags(np.repeat(np.where(model.numbers.rank == 3, STIFF, 1.0), 12))
    before = np.inf
    for _ in range(ROUNDS * (model.n_constraints > 0)):
        across, gaps = _across(model, rows, q, s)
        left = float(np.max(np.abs(gaps), initial=0.0))
        # the next step would close the rest, and the constraint forces would do work on it
        if left <= CLOSED * model.length or left > 0.5 * before:
            break
        before = left
        lift, free = _lift(model, q, state)
        mass = (lift.T @ beams @ inertia @ beams @ lift).tocsr()
        step = np.zeros(6 * model.n_nodes)
        step[free] = nearest_by(mass, (across @ lift).tocsr(), -gaps, np.zeros(free.size), free % 6 >= 3)[0]
        step = (share_map(model) @ step).reshape(-1, 6)
        q[:, 0] += step[:, :3]
        q[:, 1:] = turned(q[:, 1:], step[:, 3:])
        q = follow(model, q)
    v = _after_impact(model, rows, state, q, s, t)
    out = State(q.reshape(-1), v, s, state.force.copy(), state.history.copy())
    model.start_momenta(out.history, out.q, out.v, out.s)
    return out


def _close_rigidly(model: Model, rows: ConstraintGaps, state: State, q: Array, s: Array) -> None:
    """Move parts as rigid bodies, and sliders along their beams, until connections and joints are closed, or as far as
    possible."""
    inertia, before, part = mass_map(model), np.inf, model.numbers.part
    if model.ties is not None:
        # no rigid motion of parts moves a point of a body to its place on the body
        owner = np.repeat(np.arange(len(q)), np.diff(model.ties.start))
        own = _follows(model) & (np.bincount(owner, part[model.ties.target] != part[owner], len(q)) == 0)
        q[own] = follow(model, q)[own]
    for _ in range(ROUNDS):
        across, gaps = _across(model, rows, q, s)
        ties, open_ties, _ = _ties(model, state, q)
        gaps = np.concatenate((gaps, open_ties))
        left = float(np.max(np.abs(gaps), initial=0.0))
        if left <= CLOSED * model.length or left > 0.5 * before:
            break
        before, rates = left, velocity_map(q)
        step = rigid_share((rates.T @ inertia @ rates).tocsr(), sparse_rows(across @ rates, ties), -gaps,
                           rigid_motions(q[:, 0], part)).reshape(-1, 6)
        middle, number = middles(q[:, 0], part)
        # finite rotation of the whole part
        arms = (q[:, 0] - middle[number])[:, None]
        q[:, 0] = middle[number] + step[number, :3] + turned(arms, step[number, 3:])[:, 0]
        q[:, 1:] = turned(q[:, 1:], step[number, 3:])


def sparse_rows(*parts: Any) -> Any:
    """Stack sparse matrices below each other."""
    return sparse.vstack(parts, format="csr")


def _ties(model: Model, state: State, q: Array) -> tuple[Any, Array, Array]:
    """Assemble the conditions of slave nodes, welded ends and supports: a matrix on velocities and spins of all nodes, sparse
    [m, 6 N], the errors of position [m], and the numbers of unknowns that supports, whose rows come last, fix."""
    place = follow(model, q)
    led = np.flatnonzero(_follows(model))
    unit = sparse.eye(6 * len(q), format="csr")
    to_rates = velocity_map(q)
    rates = tie_map(model) @ to_rates @ share_map(model)
    # motion of the master nodes less that of the slave node
    at = (12 * led[:, None] + np.arange(3)).reshape(-1)
    rows, off = [(rates - to_rates)[at]], [(place - q)[led, 0].reshape(-1)]
    leads = _led(model)
    led = np.flatnonzero(leads != np.arange(len(q)))
    of, to = ((6 * k[:, None] + np.arange(3, 6)).reshape(-1) for k in (led, leads[led]))
    rows.append(unit[to] - unit[of])
    off.append(spins(q[led], place[led]).reshape(-1))
    supported = _standing(model, state)
    for _, motion, node in active_supports(model, state):
        supported[node] |= motion.mask
    still = np.flatnonzero((supported[:, None] >> np.arange(6) & 1).reshape(-1))
    rows.append(unit[still])
    off.append(np.zeros(still.size))
    return sparse_rows(*rows), np.concatenate(off), still


def with_velocities_of_scene(model: Model, state: State, t: float) -> tuple[State, list[tuple[str, str]]]:
    """Return the state with the velocities that the scene gives its parts, in the shape of the state, and its events.

    Rigid motions are those of the scene at the places of the state, sliders keep their rates along their beams. Velocities that
    joints do not allow in this shape are projected: rigid motions of the parts change first.
    """
    state = own_state(model, state)
    q, q0, v0 = (x.reshape(-1, 4, 3) for x in (state.q, model.q0, model.v0))
    given = velocities_and_spins(q0, v0)
    _put_rates_of_supports(model, state, t, given)
    fixed = given.reshape(-1).copy()
    given[:, :3] += np.cross(model.numbers.turning, q[:, 0] - q0[:, 0])
    to_rates = velocity_map(q)
    rows = ConstraintGaps(model)
    gaps, at_start, size = rows.at(state.q, state.s), rows.at(model.q0, model.s0), model.v0.size
    # nodes of moving meshes have the velocities of the points there
    stands = ~np.isin(np.arange(model.n_sliders), [] if model.moving is None else model.moving.sliders)
    by_rates, at_first, goals = gaps.rates[:, :size], at_start.rates[:, :size], []
    first = rates_in(model, model.state())
    for k, tangent in enumerate(gaps.tangents):
        goals.append(at_start.along(k, first) * stands[k] * tangent)
        # the part with the sliding point moves along, its beam does not
        part = model.numbers.part == model.numbers.part[int(model.sliders.point[k])]  # type: ignore[union-attr]
        if np.all(model.numbers.rank[part] != 3):
            given[part, :3] += goals[-1] - by_rates[3 * k:3 * k + 3] @ (to_rates @ given.reshape(-1))
    on = np.repeat(~off_beam(model, state), 3)
    of_joints = at_first[rows.joints] @ model.v0
    leads = by_rates[np.concatenate((np.flatnonzero(on), rows.others))]
    right = np.concatenate([np.concatenate((*goals, np.zeros(0)))[on], np.where(rows.given, of_joints, 0.0)])
    begin = given.reshape(-1)
    found = nearest_velocities(model, state, leads, right, fixed, begin)
    out = State(state.q, follow(model, (to_rates @ found).reshape(-1, 4, 3)).reshape(-1), state.s, state.force, state.history)
    model.start_momenta(out.history, out.q, out.v, out.s)
    changed = np.linalg.norm((found - begin).reshape(-1, 6)[:, :3], axis=1)
    k = int(np.argmax(changed))
    if changed[k] <= CHANGES * np.max(np.abs(begin), initial=0.0):
        return out, []
    return out, [("projected", f"the velocities of the scene change by up to {changed[k]:.6g} m/s, at {model.labels[k]}, to "
                               "satisfy joints, supports and sliders in the shape of the start")]


def nearest_velocities(model: Model, state: State, leads: Any, goals: Array, supports: Array, given: Array) -> Array:
    """Find the velocities and spins [6 N] nearest to `given` that slave nodes, supports, sliders and joints allow: rigid motions
    of the parts change first.

    leads: sparse [m, 12 N], rates of gaps of sliders, joints and sleeves by those of the coordinates.
    goals: float64 [*], values of these rates; 0 for rates behind the last.
    supports: float64 [6 N], velocities and spins of nodes that supports fix.
    """
    q = state.q.reshape(-1, 4, 3)
    to_rates = velocity_map(q)
    ties, _, still = _ties(model, state, q)
    matrix = sparse_rows(leads @ to_rates, ties)
    right = np.concatenate((goals, np.zeros(matrix.shape[0] - goals.size - still.size), supports[still]))
    mass = (to_rates.T @ mass_map(model) @ to_rates).tocsr()
    found = given + rigid_change(mass, matrix, right, given, rigid_motions(q[:, 0], model.numbers.part))
    found = nearest_by(mass, matrix, right, found, np.arange(given.size) % 6 >= 3)[0]
    found[still] = supports[still]
    return found


def _at_rest_where_the_scene_moves(model: Model, state: State) -> list[tuple[str, str]]:
    """Return the event of a start without velocities in a scene that gives some."""
    if state.v.any() or not model.v0.any():
        return []
    size = np.linalg.norm(model.v0.reshape(-1, 4, 3), axis=2)
    k = int(np.argmax(size.max(axis=1)))
    much = f"{size[k, 0]:.3g} m/s" if size[k, 0] > 0.0 else "a spin"
    return [("start", f"the start has zero velocities, but the scene gives {model.labels[k]} {much}. The run begins at rest; "
                      "take the velocities of the scene with Start(state, velocities=\"scene\"), or leave them out of the "
                      "scene")]


def _swapped_springs(model: Model, state: State) -> list[tuple[str, str]]:
    """Return events for one-sided springs without force whose ends have passed each other against the scene."""
    if model.lines is None:
        return []
    a, b = model.lines.node.T
    x, y = (q.reshape(-1, 12)[:, :3] for q in (model.q0, state.q))
    around = np.einsum("lc,lc->l", x[b] - x[a], y[b] - y[a]) < 0.0
    names = {model.lines.names[k] for k in np.flatnonzero(around & model.lines.acts)}
    slack = [name for springs in model.spring_rows if hasattr(springs, "slack") for name in springs.slack(state)]
    return [("start", f"spring {name!r} has no force at the start, and points in the opposite direction than in the scene. Its "
                      "ends have passed each other, and its force will not separate them; start from a shape in which they have "
                      "not")
            for name in slack if f"spring {name!r}" in names]


def _after_impact(model: Model, rows: ConstraintGaps, state: State, q: Array, s: Array, t: float | None) -> Array:
    """Return admissible rates [12 N] at coordinates q near to those of the state: only connections, joints and supports change
    momenta."""
    inertia = mass_map(model)
    before = state.q.reshape(-1, 4, 3)
    own = velocities_and_spins(before, state.v.reshape(-1, 4, 3))
    led_by = own.copy()
    if t is not None:
        _put_rates_of_supports(model, state, t, led_by)
    across, _ = _across(model, rows, q, s)
    lift, free = _lift(model, q, state)
    moved = _moved_unknowns(model, state)
    # supports that move keep their velocities
    led = rates_map(model, q)[:, moved] @ led_by.reshape(-1)[moved]
    # every node keeps its momentum, turned with the node
    carried = state.v + velocity_map(q) @ own.reshape(-1) - velocity_map(before) @ own.reshape(-1)
    momentum = np.zeros(q.size)
    if not np.array_equal(q, before):
        joined = sparse_rows(across @ velocity_map(q), _ties(model, state, q)[0])
        momentum += inertia @ _turned_back(inertia, joined, before, q, state.v, carried)
    # nodes of moving supports take the momentum of their support; the other nodes do not take up its change
    carried += velocity_map(q) @ (led_by - own).reshape(-1)
    momentum += inertia @ carried
    found = led_by.reshape(-1)[free]
    missing = lift.T @ (momentum - inertia @ (lift @ found + led))
    right = -(across @ led)
    # coordinates that are prescribed as functions of time keep their rates
    given = 2 * model.n_sliders + np.flatnonzero(rows.given)
    right[given] += (across @ carried)[given]
    rates = nearest_by((lift.T @ inertia @ lift).tocsr(), (across @ lift).tocsr(), right, found, free % 6 >= 3, missing)[0]
    return np.asarray(lift @ rates + led)


def _turned_back(inertia: Any, joined: Any, before: Array, q: Array, v: Array, carried: Array) -> Array:
    """Return the rates [12 N] of the rigid motions that restore the momenta of each piece of the scene, moved from `before` to q:
    those with rates v, where it has those of `carried`. joined: matrix on velocities and spins, sparse [m, 6 N], of what joins
    nodes to pieces besides the inertia of beams."""
    rates = velocity_map(q)
    mass = (rates.T @ inertia @ rates).tocsr()
    every = (abs(mass) + abs(joined).T @ abs(joined)).tocoo()
    number = components(len(q), np.stack((every.row, every.col), axis=1) // 6)
    rigid = rigid_motions(q[:, 0], number)
    own = (rigid.T @ mass @ rigid).tocsr()
    middle, number = middles(q[:, 0], number)
    lost = np.zeros((len(middle), 6))
    for sign, x, of in ((1.0, before, v), (-1.0, q, carried)):
        p = (inertia @ of).reshape(-1, 4, 3)
        arms = x.copy()
        arms[:, 0] -= middle[number]
        np.add.at(lost[:, :3], number, sign * p[:, 0])
        np.add.at(lost[:, 3:], number, sign * np.cross(arms, p).sum(axis=1))
    turns = np.zeros_like(lost)
    for k in np.flatnonzero(np.any(lost != 0.0, axis=1)):
        turns[k] = np.linalg.lstsq(own[6 * k:6 * k + 6, 6 * k:6 * k + 6].toarray(), lost[k], rcond=1e-12)[0]
    return np.asarray(rates @ (rigid @ turns.reshape(-1)))


def _lift(model: Model, q: Array, state: State) -> tuple[Any, Array]:
    """Return the map from free velocities and spins to rates of all coordinates, sparse [12 N, F], and their numbers [F]."""
    free = free_unknowns(model, state)
    return rates_map(model, q)[:, free], free


def _moved_unknowns(model: Model, state: State) -> Array:
    """Return the numbers 6 node + c of the unknowns that supports move; for nodes that share a row, of the first node."""
    bits = np.zeros(model.n_nodes, np.int64)
    first = model.pattern.first_on_row
    for _, motion, node in active_supports(model, state):
        bits[first[node]] |= motion.mask
    return np.flatnonzero((bits[:, None] >> np.arange(6) & 1).reshape(-1))


def _across(model: Model, rows: ConstraintGaps, q: Array, s: Array) -> tuple[Any, Array]:
    """Move s to the nearest points, and return the gaps across the curves [2 S], of joints with multipliers and of directions in
    sleeves: their matrix on the coordinates, sparse, and values."""
    of_sliders = 3 * np.arange(s.size)[:, None] + np.arange(3)
    for _ in range(20):
        gaps, tangents = rows.values(q.reshape(-1), s)
        increments = np.sum(gaps[of_sliders] * tangents, axis=1) / np.sum(tangents**2, axis=1)
        # moves of the size of round-off would make a sticking slider slip
        moves = np.abs(increments) > 1e-15 * model.slider_lengths
        if model.moving is not None:
            # with their places nodes of beams would move
            moves[model.moving.sliders] = False
        if not moves.any():
            break
        s[moves] = np.clip(s + increments, *model.ends_at(s).T)[moves]
    found = rows.at(q.reshape(-1), s)
    by_rates, met = (x[:, :q.size] for x in (found.rates, found.met))
    axes = [across_of(tangent) for tangent in found.tangents]
    matrix = [sparse.csr_matrix(two) @ by_rates[at] for two, at in zip(axes, of_sliders)]
    values = [two @ found.values[at] for two, at in zip(axes, of_sliders)]
    along = np.zeros(0)
    if model.moving is not None:
        some = model.moving.sliders
        along = np.sum(found.values[of_sliders[some]] * found.tangents[some], axis=1)
    return sparse_rows(*matrix, by_rates[rows.others], met), np.concatenate((*values, found.values[rows.others], along))
