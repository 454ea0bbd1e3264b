"""Equilibria of scenes with sliders (theory.md 8): nodes, contact forces and sliding coordinates in one saddle matrix.

A sliding coordinate is only determined once its contact carries a force. So every load step is found with all sliders held first;
then they are released and slide downhill, the rest of the scene following in equilibrium, until Newton's method on everything
squares its increments. Sliders with friction are released where it cannot hold them, in the direction in which they go then
(`static_along.py`).
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .equilibrium import StaticSolver
from .kernels.step import NOT_CONVERGED, NOT_FINITE, OK, SINGULAR, SLIDER_END, has_converged, next_increment
from .kernels.work import State
from .model import Model
from .saddle import Saddle, factors_for
from .static_along import RESERVE, StaticAlong
from .static_contact import Border, SaddleMatrix, StaticContacts
from .static_joints import static_joints
from .static_motion import coordinates_of
from .steady import SteadyForces

Array = np.ndarray
# a Newton increment moves and turns nodes by this much at most, in sizes of the scene and rad
LARGEST_MOVE = 1.0
# a slider moves by this share of its beam at once, and goes this share of the way to an end of it
REACH, TO_END = 0.1, 0.75
# nearer to an end, as a share of the beam, it runs off; increments below this share of the scene are those of Newton's method
AT_END, CLOSE = 1e-6, 1e-9
# increments up to this share of the beam are accepted as those of Newton's method, whose size it squares
NEWTON_FROM = 0.02
MOST_SLIDES = 100
# how often it is looked which sliders stick, slip and rest against stops, for every slider
ROUNDS = 8
# iterations after which those that are tried and do not become smaller are given up
LEAST_PATIENCE = 6
LEAST_TRUST = 1e-4
# added to the diagonal of the scaled matrix, one after the other, until no increment is too long
STIFFNESSES = (1e-10, 1e-8, 1e-6, 1e-4, 1e-2)
# share of all loads from which on a force along a motion without stiffness is not round-off; how far nodes follow such a motion
# in one iteration, in sizes of the scene
UNBALANCED, DRIFT = 1e-9, 0.2
EPSILON = 1e-13


class Increment(NamedTuple):
    """Of nodes [n], sliding coordinates [S] and contact forces [d S]; whether it is a whole one of Newton's method."""

    nodes: Array
    s: Array
    force: Array
    whole: bool = True


class SlidingSolver(StaticSolver):
    """As `StaticSolver`, around one sparse matrix without elimination of inner nodes: PARDISO, SuperLU where that finds nothing
    that is certain.

    Parameters
    ----------
    model : Model
    start : State or None
    max_iterations : int
        Of each Newton iteration.
    held : bool [S]
        Sliders that stay at their s.
    at_time : float
        When drives that are functions of time are evaluated, s.
    flat : bool, optional
        Whether to solve in the plane of the scene; default: where it has one and the start lies in it.
    backend : {'auto', 'pardiso', 'superlu'}
    """

    def __init__(self, model: Model, start: State | None, max_iterations: int, held: Array, flat: bool | None = None,
                 backend: str = "auto", at_time: float = 0.0) -> None:
        if flat is None:
            flat = model.plane is not None and (start is None or model.plane.holds(start))
        assert model.uneliminated is not None
        uneliminated = model.uneliminated(planar=flat)
        super().__init__(uneliminated, start, max_iterations, "superlu")
        plane = self.stepper.plane
        self.contacts = StaticContacts(uneliminated, None if plane is None else plane.axes)
        core = self.core
        self._matrix = SaddleMatrix(core.pattern, len(core.dofs), core.n_sliders, core.n_forces)
        self._factors = factors_for(backend)
        self._refused = 0
        # of the first matrix of those with the same free sliders
        self._scales: dict[bytes, tuple[Array, Array]] = {}
        self.held = held
        self.lengths, self.ends = uneliminated.slider_lengths, self.stepper.model.limits_at(
            self.stepper.core_state.s, self.stepper.core_state.history)
        self.along = None
        if uneliminated.slider_forces is not None:
            self.along = StaticAlong(uneliminated, at_time, self.stepper.core_state.s, held, self.stepper.core_state.history)
        # what joints are given at the start and at the end of the load
        self.given = None
        if core.motions is not None and core.motions.holds.given.size:
            self.given = core.motions.given_between(self.stepper.core_state.history, core.motion_place, at_time)
        self._gone = 0.0
        # those that friction or rigid stops may hold, and where those of joints are
        self.joints, self.resting = static_joints(self), np.zeros(0)
        if self.joints is not None:
            self.hold_joints()
        # the slider that ran off its beam, and one at a kink of its curve
        self.runaway = self.stuck = -1
        self.last_s = np.zeros(held.size)
        self._loads = self.work.f_ext.copy()
        self._no_border: Border | None = None
        # forces of inertia of a steady motion
        self.steady: SteadyForces | None = None

    def set_time(self, t: float, factor: float) -> None:
        super().set_time(t, factor)
        if self.along is not None:
            self.along.factor = factor
        if self.steady is not None:
            self.steady.share = factor

    def move_to(self, share: float) -> None:
        super().move_to(share)
        if self.along is not None:
            self.along.share = share
        self._gone = share
        self.hold_joints()

    def hold_joints(self) -> None:
        """Where coordinates of joints stand that are given, or that friction and rigid stops hold."""
        given = [] if self.given is None else [(1.0 - self._gone) * self.given[0] + self._gone * self.given[1]]
        if self.joints is not None:
            self.joints.hold()
            given.append(self.resting)
        if given:
            self.contacts.given = np.concatenate(given)

    @property
    def name(self) -> str:
        """What was used, for the result."""
        if self._factors is None or not self._factors.count:
            return "SuperLU on nodes and sliders"
        f = self._factors
        return f"PARDISO on nodes and sliders, {f.count} factorisations, {f.refused} left to SuperLU"

    @property
    def sliding(self) -> Array:
        """Which sliders are free to move, bool [S]."""
        return ~self.held if self.along is None else self.along.free

    def equilibrium(self, factors: Array) -> tuple[int, list[float]]:
        before = self._saved()
        at_stop = None if self.along is None else self.along.modes.at_stop.copy()
        joints = None if self.joints is None else (self.joints.values.copy(), self.joints.at_stop.copy())
        status = NOT_CONVERGED
        try:
            status, sizes = self._equilibrium(factors)
        finally:
            if status != OK:
                self._restore(before)
                if self.along is not None:
                    self.along.modes.at_stop[:] = at_stop
                if self.joints is not None:
                    self.joints.values, self.joints.at_stop = joints
        return status, sizes

    def _equilibrium(self, factors: Array) -> tuple[int, list[float]]:
        return self._with_sliders(factors) if self.joints is None else self.joints.settle(factors)

    def _with_sliders(self, factors: Array) -> tuple[int, list[float]]:
        self._load(factors)
        self._loads[:] = self.work.f_ext
        self.longest, self.runaway, self.stuck = 0, -1, -1
        if self._factors is not None and self._factors.refused > self._refused:
            # they may have changed too much
            self._scales.clear()
            self._refused = self._factors.refused
        along, state = self.along, self.stepper.core_state
        if along is not None:
            state.s[:] = along.begin(state.s)
        status, sizes = self._newton(np.zeros(self.held.size, bool))
        for _ in range(ROUNDS * (self.held.size + 1)):
            if status == OK and self.sliding.any():
                status, more = self._release()
                sizes += more
            if status != OK or along is None:
                return status, sizes
            changed, s = along.judge(self._border(rubs=False), state.s)
            if along.in_circles:
                return NOT_CONVERGED, sizes
            if not changed:
                along.remember(state.history)
                return OK, sizes
            if np.any(s != state.s):
                state.s[:] = s
                status, more = self._newton(np.zeros(s.size, bool))
                sizes += more
        return NOT_CONVERGED, sizes

    def at_rest(self, asked: list[int], factors: Array) -> dict[str, Any]:
        """For the result, at the last equilibrium, that of load factors [K]: friction of all sliders, and the intervals of rest
        of those that are asked for."""
        of_joints = {} if self.joints is None else self.joints.report()
        if self.along is None or not self.along.rubs.any():
            return {"friction": of_joints} if of_joints else {}
        names = self.stepper.model.names["sliders"]
        out = {"friction": self.along.report(names, self._border(rubs=False)) | of_joints}
        return out | ({"rest_intervals": {names[k]: self._rest_interval(k, factors) for k in asked}} if asked else {})

    def _rest_interval(self, k: int, factors: Array) -> tuple[float, float]:
        """Arc lengths between which slider k rests under load factors [K] by its friction, the others that rub staying where they
        are: from the last equilibrium to both ends, where friction is all that it can be; NaN where none is found. The state is
        the same after it."""
        along, state = self.along, self.stepper.core_state
        assert along is not None
        self._load(factors)
        self._loads[:] = self.work.f_ext
        before, modes = self._saved(), [x.copy() for x in along.modes]
        along.reserve, found = 0.0, []
        for sign in (1, -1):
            along.modes.sign[:] = 0
            along.modes.sign[k], along.modes.at_stop[k] = sign, 0
            # friction pushes towards the end that is looked for
            self.runaway = -1
            try:
                status, _ = self._release()
                runs_off = status == SLIDER_END and self.runaway == k
                found.append(float(self.ends[k, int(sign < 0)] if runs_off else state.s[k] if status == OK else np.nan))
            finally:
                self._restore(before)
                for x, was in zip(along.modes, modes):
                    x[:] = was
        along.reserve = RESERVE
        return found[0], found[1]

    def load_all(self, factors: Array) -> None:
        self._load(factors)
        self._border()
        self.work.f_ext[:] += self.contacts.loads(self._weights, self.state.q, self.stepper.core_state.force, False)
        if self.steady is not None:
            self.work.f_ext[:] += self.steady.loads(self.state.q)

    def signs(self, factors: Array, in_plane: bool) -> tuple[int, int] | None:
        if in_plane != (self.stepper.plane is not None):
            # where friction or a stop holds a slider, it stays
            t, share = (float(x) for x in self.stepper.law_work[:2])
            other = SlidingSolver(self.stepper.model, self.state, self.max_iterations, ~self._unhindered, in_plane, "superlu", t)
            other.set_time(t, share)
            other.move_to(share)
            return other.signs(factors, in_plane)
        self._load(factors)
        self._loads[:] = self.work.f_ext
        self.work.increment.control[0] = 0.0
        if self.along is not None:
            self.along.modes.sign[:] = 0
        self.contacts.loose = None if self.joints is None else self.joints.loose
        found = self._assembled(self._unhindered)[0].signs(self.has_potential(in_plane))
        self.contacts.loose = None
        return found

    @property
    def _unhindered(self) -> Array:
        """Which sliders move without friction and away from stops, bool [S]."""
        return self.sliding if self.along is None else self.along.free & ~self.along.rubs

    # --- states -------------------------------------------------------------------------------------------------------
    def _saved(self) -> tuple[Array, Array, Array]:
        state = self.stepper.core_state
        return state.q.copy(), state.s.copy(), state.force.copy()

    def _restore(self, saved: tuple[Array, Array, Array]) -> None:
        state = self.stepper.core_state
        state.q[:], state.s[:], state.force[:] = saved

    def _border(self, rubs: bool = True) -> Border:
        """Equations of the sliders at the present shape, with friction of those that slip or without; their residuals are kept
        for messages."""
        if self._no_border is not None:
            return self._no_border
        state, contact = self.stepper.core_state, self.stepper.contact
        self._weights = self.contacts.weights(state.s)
        along = self.along
        border = self.contacts.border(self._weights, self.state.q, state.force,
                                      None if along is None else along.slip if rubs else np.zeros(state.s.size))
        if along is not None:
            force, slope = along.known(state.s)
            border = border._replace(sliding=border.sliding - force, bend=border.bend - slope)
        dim = self.core.dim
        sliders = self.sliding.size
        if contact is None:
            # without constraints there is nothing that depends on a shape
            self._no_border = border
            return border
        contact.residual[:sliders, :dim] = border.gap
        contact.residual[:sliders, dim] = np.where(self.sliding, border.sliding, 0.0)
        of_joints = np.arange(8) < contact.forces[sliders:, None]
        contact.residual[sliders:][of_joints] = border.joint_gap
        return border

    def _shape(self) -> Array:
        """Coordinates in space [12 N]; nothing where no equation asks for them."""
        needed = self._no_border is None or self.steady is not None or self.motion is not None
        return self.state.q if needed else np.zeros(0)

    # --- Newton's method ----------------------------------------------------------------------------------------------
    def _assembled(self, sliding: Array, drag: float = 0.0) -> tuple[Saddle, Array]:
        """Tangent and right-hand side with these sliders [S] free; drag: stiffness against their increments, N/m."""
        model, work, state = self.core, self.work, self.stepper.core_state
        size, n = len(model.dofs), model.pattern.n
        border, q = self._border(), self._shape()
        work.f_ext[:] = self._loads
        if self._no_border is None:
            work.f_ext[:] += self.contacts.loads(self._weights, q, state.force)
        if self.steady is not None:
            work.f_ext[:] += self.steady.loads(q)
            border = border._replace(bent=border.bent + self.steady.stiffness(q))
        given = None if self.motion is None else self.motion.pending(coordinates_of(self.stepper, self.motion.own))
        if given is None:
            self.stepper.parts.assemble(0.0)
        else:
            x = self.motion.rows(given, model, self.contacts.axes)
            self.carrying.assemble(self.stepper, self.stepper.records[1], x)
        matrix = self._matrix.of(work.blocks, border, sliding, drag)
        r = work.r[:8 * n].reshape(n, 8)[:, :size].reshape(-1)
        if given is not None:
            # the rows of held unknowns say 2 x = ...; gaps that the supports open are closed
            r = r - 2.0 * x.reshape(-1)
            moved = self.contacts.border(self._weights, self.motion.moved(q, given), state.force, np.zeros(state.s.size))
            border = border._replace(gap=moved.gap, joint_gap=moved.joint_gap)
        right = np.concatenate((-r, np.where(sliding, -border.sliding, 0.0), border.gap.reshape(-1), border.joint_gap))
        multiplier = np.zeros(right.size, bool)
        multiplier[r.size + sliding.size:] = True
        saddle = Saddle(matrix, multiplier, self._factors, self._scales.get(sliding.tobytes()))
        if saddle.measured_in is None and self._factors is not None:
            saddle.measured_in = self._scales[sliding.tobytes()] = saddle.scales
        return saddle, right

    def _increment(self, sliding: Array, drag: float = 0.0) -> Increment | None:
        saddle, right = self._assembled(sliding, drag)
        n = len(self.core.dofs) * self.core.pattern.n
        for stiffness in (0.0, *STIFFNESSES):
            used = saddle.stiffened(stiffness) if stiffness else saddle
            x = used.solve(right)
            if x is None or not np.isfinite(x).all():
                return None
            if used.unbalanced > 0.0 and used.unbalanced > np.linalg.norm(used.row[:n] * self._round_off(used)):
                # forces push where nothing resists: a little along
                size = self._size(used.drift[:n])
                if size > 0.0:
                    x[:n] += DRIFT / size * used.drift[:n]
            # what is soft runs away by itself: it alone is kept back
            if self._size(x[:n]) <= LARGEST_MOVE:
                break
        return Increment(x[:n], x[n:n + sliding.size], x[n + sliding.size:], stiffness == 0.0)

    def _round_off(self, saddle: Saddle) -> Array:
        """What may be round-off in the residuals of the nodes [n]: of loads and contact forces, and of forces in the beams."""
        size, n = len(self.core.dofs), self.core.pattern.n
        loads = np.abs(self.work.f_ext[:8 * n].reshape(n, 8)[:, :size]).reshape(-1)
        stiff = np.abs(saddle.matrix.diagonal()[:size * n])
        return UNBALANCED * loads + EPSILON * self.core.length * stiff

    def _size(self, nodes: Array) -> float:
        """Of an increment of the nodes, in sizes of the scene and rad."""
        x = np.abs(nodes.reshape(-1, len(self.core.dofs)))
        dim = self.core.dim
        return float(np.max(x[:, :dim])) / self.core.length + float(np.max(x[:, dim:], initial=0.0))

    def _share(self, nodes: Array) -> float:
        """Of an increment of the nodes that is not too long."""
        return min(1.0, LARGEST_MOVE / max(self._size(nodes), 1e-300))

    def move(self, x: Increment) -> float:
        """Add an increment. Returns its size."""
        state, core = self.stepper.core_state, self.core
        # the kernels take half of what solves the equations of half the tangent, and subtract it
        self.work.panel.reshape(-1, core.width)[:x.nodes.size, 0] = -2.0 * x.nodes
        moved = self.stepper.parts.update()
        state.s[:] += x.s
        state.force[:] += x.force
        return moved + float(np.max(np.abs(x.s), initial=0.0)) / core.length

    def _newton(self, sliding: Array, patient: bool = True) -> tuple[int, list[float]]:
        """Newton iteration with these sliders [S] free; not patient: given up where increments do not become smaller."""
        sizes: list[float] = []
        before = expected = np.inf
        self.work.increment.control[0] = 0.0
        state = self.stepper.core_state
        for _ in range(self.max_iterations):
            x = self._increment(sliding)
            if x is None:
                return (SINGULAR if np.isfinite(self.work.r).all() else NOT_FINITE), sizes
            s = state.s + x.s
            if np.any((s < self.ends[:, 0]) | (s > self.ends[:, 1])):
                return SLIDER_END, sizes
            share = self._share(x.nodes)
            # forces stand in the equations as they are: whole ones balance the loads whatever nodes do
            sizes.append(self.move(Increment(share * x.nodes, share * x.s, x.force)))
            self.longest = max(self.longest, len(sizes))
            if not sizes[-1] < np.inf:
                return NOT_FINITE, sizes
            if share == 1.0 and x.whole and has_converged(sizes[-1], before, expected):
                return OK, sizes
            if not patient and len(sizes) >= LEAST_PATIENCE and sizes[-1] > sizes[0]:
                break
            before, expected = sizes[-1], next_increment(sizes[-1], before)
            self.interrupts.serve()
        return NOT_CONVERGED, sizes

    # --- sliding ------------------------------------------------------------------------------------------------------
    def _release(self) -> tuple[int, list[float]]:
        """From an equilibrium with all sliders held to one in which those that are free do not push along their beams. They go
        downhill: with the others in equilibrium F . c' is the derivative of the energy by s."""
        state = self.stepper.core_state
        held = np.zeros(self.held.size, bool)
        sizes: list[float] = []
        drag, trust, near = 0.0, 1.0, NEWTON_FROM
        for _ in range(MOST_SLIDES):
            # less those that have come to a rigid stop
            free = self.sliding
            if not free.any():
                return OK, sizes
            self.work.increment.control[0] = 0.0
            x = self._increment(free, drag)
            if x is None:
                return SINGULAR, sizes
            slope = np.where(free, self._border().sliding, 0.0)
            largest = float(np.max(np.abs(x.s) / self.lengths))
            close = largest * float(np.max(self.lengths)) <= CLOSE * self.core.length
            work = float(slope @ x.s)
            if not close and not work < 0.0:
                # uphill, to where it is steepest or highest: as much against it as turns the increment round
                drag = max(4.0 * drag, 2.0 * abs(work) / float(x.s @ x.s) + drag)
                continue
            saved = self._saved()
            if close or (largest <= near and drag == 0.0):
                status, more = self._newton(free, close)
                sizes += more
                way = state.s - saved[1]
                if status == OK and (close or (np.all(np.abs(way) <= 4.0 * largest * self.lengths) and self._rises(way))):
                    return OK, sizes
                self._restore(saved)
                if close and (status != SLIDER_END or not self._met(x.s, x.s).any()):
                    return (NOT_CONVERGED if status == SLIDER_END else status), sizes
                near = 0.25 * largest
            steps, out = self._steps(trust * x.s, slope)
            met = self._met(x.s, steps)
            if out >= 0:
                self.runaway = out
                return SLIDER_END, sizes
            share = float(np.max(np.abs(steps)) / np.max(np.abs(x.s)))
            share *= self._share(share * x.nodes)
            sizes.append(self.move(Increment(share * x.nodes, steps, share * x.force)))
            status, more = self._newton(held)
            sizes += more
            after = np.where(free, self._border().sliding, 0.0) * steps if status == OK else np.full(free.size, np.inf)
            if float(np.sum(after)) <= 0.9 * abs(float(slope @ steps)):
                trust, drag = min(1.0, 2.0 * trust), 0.0
                if self.along is not None:
                    self.along.meet(met, state.s)
                continue
            self._restore(saved)
            trust *= 0.25
            if trust < LEAST_TRUST:
                if status == OK:
                    # the slope jumps from one sign to the other
                    self.stuck, self.last_s = int(np.argmax(after)), state.s.copy()
                    return SLIDER_END, sizes
                return status, sizes
        return NOT_CONVERGED, sizes

    def _met(self, way: Array, steps: Array) -> Array:
        """-1 or 1 for sliders that steps [S] along their ways [S] bring to a rigid stop, else 0."""
        if self.along is None:
            return np.zeros(steps.size, np.int64)
        return self.along.meets(self.stepper.core_state.s, steps, way)

    def _rises(self, way: Array) -> bool:
        """Whether an equilibrium lies in a valley of the energy and not on a ridge, seen along the way [S] to it."""
        self.work.increment.control[0] = 0.0
        saddle, right = self._assembled(self.sliding)
        right[:] = 0.0
        n = len(self.core.dofs) * self.core.pattern.n
        right[n:n + way.size] = np.where(self.sliding, way, 0.0)
        x = saddle.solve(right)
        return x is None or bool(way @ x[n:n + way.size] >= 0.0)

    def _steps(self, s: Array, slope: Array) -> tuple[Array, int]:
        """Increments of the sliding coordinates, none too long and none beyond an end; and a slider that stands at the end that
        it is pushed to, or -1."""
        now = self.stepper.core_state.s
        to_end = np.where(s > 0.0, self.ends[:, 1] - now, now - self.ends[:, 0])
        rigid = np.zeros(s.size, bool) if self.along is None else self.along.is_rigid(s)
        out = np.flatnonzero((to_end <= AT_END * self.lengths) & (np.abs(s) > to_end) & (slope * s < 0.0) & ~rigid)
        if out.size:
            return s, int(out[0])
        most = np.minimum(REACH * self.lengths, np.where(rigid, 1.0, TO_END) * to_end)
        steps = np.clip(s, -most, most)
        if not slope @ steps < 0.0:
            steps = s * float(np.min(np.where(np.abs(s) > most, most / np.where(s == 0.0, 1.0, np.abs(s)), 1.0)))
        return steps, -1
