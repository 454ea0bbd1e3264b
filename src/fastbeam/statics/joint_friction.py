"""Friction and rigid stops of joints, and friction of beams that turn in sleeves, in equilibria (theory.md 8): which
coordinates rest, and where the others come to rest.

Every such coordinate x, of a joint or the angle of a section in its sleeve, is held at a place in each equilibrium; G is the
force that holds it. It rests where |G| <= G_max, or where a rigid stop is pushed. One that does not goes to where
G = -sigma G_max, (8.5), sigma the direction in which it slips: from place to place by Newton's method on G(x), downhill, with
dG/dx from the equations of the equilibrium.
"""
from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fastbeam.kernels.contact import sleeve_twist as twists
from fastbeam.kernels.joints.coordinates import VALUE
from fastbeam.kernels.joints.friction import AGAINST, SIGN, STICKS
from fastbeam.kernels.loop import NOT_CONVERGED, OK
from fastbeam.model.contact.sleeve_conditions import sections
from fastbeam.model.contact.sleeve_twist import angle_of, numbers_of, twist_label
from fastbeam.model.joints.constraints import ConstrainedJoint
from fastbeam.statics.slider_friction import edges_of, let_go, share_left

if TYPE_CHECKING:
    from fastbeam.statics.sliding import SlidingSolver

Array = np.ndarray
# a coordinate goes by less than this at once, rad or a share of the size of the scene
LARGEST_INCREMENT = 0.3
# ways below which a coordinate has come to rest, and a force that is round-off of all that hold joints
TINY, ROUND_OFF = 1e-13, 1e-11
# share of friction in reserve where a slipping coordinate comes to rest, so that round-off does not move it in a run from there
RESERVE = 1e-5
MOST_ROUNDS, MOST_HALVES, MOST_CHANGES = 100, 8, 4
# largest increments in a row, with forces equal within this share, after which nothing resists a coordinate
IN_VAIN, SAME = 5, 1e-6


class JointCoordinates:
    """Coordinates of joints, R of them, with friction or rigid stops.

    values: float64 [R], initial values, rad or m.
    stops, scales: float64 [R, 2], [R], rigid stops, infinite without, and sizes of coordinates.
    rows: int64 [R], number of the constraint force that holds each coordinate, -1 where none does.
    has_friction: bool [R].
    """

    def __init__(self, solver: SlidingSolver) -> None:
        self.solver = solver
        self.motions = solver.core.motions
        self.holds = holds = self.motions.holds
        state = solver.stepper.core_state
        self.stops, self.scales = holds.ends, holds.scales
        self.values = self.motions.own(state.history, solver.core.place("motions"))[holds.rubs, VALUE]
        self.values = np.clip(self.values, *self.stops.T)
        self.has_friction = np.array([holds.parts[k].has_friction for k in holds.rubs], bool)
        self.labels = [holds.parts[k].label for k in holds.rubs]
        self._begin = _begin_of(solver)
        self.rows = np.full(holds.rubs.size, -1)
        left = holds.left_of_rubs()
        self.rows[left] = self._begin[len(solver.map.model.kept) - holds.rubs.size:][:-1][left]

    def hold(self, values: Array) -> None:
        """Prescribe these values [R] of the coordinates in the next equilibria."""
        self.solver.resting = values

    def most(self) -> Array:
        """Return the largest friction under the present forces, [R]."""
        out = self.holds.limits.copy()
        force, q = self.solver.stepper.core_state.force, self.solver.state.q.reshape(-1, 4, 3)
        kept = self.solver.map.model.kept
        for i in np.flatnonzero(self.holds.shares[:, 0] > 0.0).tolist():
            k = self.holds.rubs[i]
            for j, number in enumerate(self.holds._press(k, kept, 0)):
                if number < 0:
                    continue
                within = _within(self.solver, kept[number])
                mine = within.T @ force[self._begin[number]:self._begin[number + 1]]
                if j == 0 and self.holds.parts[k].shape.is_angle:
                    axis = self.motions.turn[k, 0, 0] @ q[self.motions.node[k, 0], 1:]
                    mine = mine - (mine @ axis) * axis
                out[i] += self.holds.shares[i, j] * float(np.linalg.norm(mine if j == 0 else mine[:2]))
        return out

    def remember(self, values: Array, at_stop: Array) -> None:
        """Write into the history of the state that all coordinates rest, by friction or at stops."""
        state = self.solver.stepper.core_state
        own = self.holds.numbers(state.history)
        own[:, SIGN], own[:, AGAINST] = 0.0, at_stop
        own[:, STICKS] = self.has_friction & (at_stop == 0)
        self.motions.own(state.history, self.solver.core.place("motions"))[self.holds.rubs, VALUE] = values


class SectionAngles:
    """Angles of the sections of beams in R sleeves with friction as they turn; as `JointCoordinates`, in space."""

    def __init__(self, solver: SlidingSolver) -> None:
        self.solver, self.model = solver, solver.map.model
        state = solver.stepper.core_state
        self.of = self.model.twisting
        every = sections(self.model, state.s, state.q.reshape(-1, 4, 3))
        known = numbers_of(self.model, state.history)[:, twists.ANGLE]
        self.values = np.array([angle_of(every[o], x) for o, x in zip(self.of.tolist(), known.tolist())])
        self.stops, self.scales = np.tile((-np.inf, np.inf), (self.of.size, 1)), np.ones(self.of.size)
        self.has_friction = np.ones(self.of.size, bool)
        names = self.model.names["sliders"]
        self.sliders = self.model.sleeve_pairs[self.of, 0]
        self.labels = [twist_label(names[k]) for k in self.sliders]
        self.rows = state.force.size - 3 * len(self.model.sleeve_pairs) + 3 * self.of + 2

    def hold(self, values: Array) -> None:
        """Prescribe these values [R] of the angles in the next equilibria."""
        self.solver.constraints.angles = dict(zip(self.of.tolist(), values.tolist()))

    def most(self) -> Array:
        """Return the largest moment of friction under the present forces, N m [R]."""
        state = self.solver.stepper.core_state
        every = sections(self.model, state.s, state.q.reshape(-1, 4, 3))
        press, _ = edges_of(self.model, state.force)
        out = np.zeros(self.of.size)
        for i, (o, k) in enumerate(zip(self.of.tolist(), self.sliders.tolist())):
            force, axis = state.force[3 * k:3 * k + 3], every[o].axes[0]
            across = force - (force @ axis) / (axis @ axis) * axis
            out[i] = self.model.sleeves.twist.arm[o] * (np.linalg.norm(across) + press[k])
        return out

    def remember(self, values: Array, at_stop: Array) -> None:
        """Write into the history of the state that friction holds all angles."""
        own = numbers_of(self.model, self.solver.stepper.core_state.history)
        own[:, twists.ANGLE], own[:, twists.SIGN], own[:, twists.STICKS], own[:, twists.MOST] = values, 0.0, 1.0, self.most()


def _within(solver: SlidingSolver, link: ConstrainedJoint) -> Array:
    """Return the matrix that selects the conditions of a joint which the equations contain, [m, m in space]."""
    axes = solver.map.axes
    return np.eye(link.forces(3)) if axes is None else link.law.within(axes)


def _begin_of(solver: SlidingSolver) -> Array:
    """Return the offsets of the forces of every joint among those of all constraints, with their end, int64 [J + 1]."""
    sizes = [len(_within(solver, link)) for link in solver.map.model.kept]
    return solver.core.dim * solver.core.n_sliders + np.concatenate(([0], np.cumsum(sizes))).astype(np.int64)


def static_joints(solver: SlidingSolver) -> StaticJoints | None:
    """Collect the coordinates of a solver that have friction or rigid stops; None where there are none."""
    motions = solver.core.motions
    parts: list[JointCoordinates | SectionAngles] = []
    if motions is not None and motions.holds.rubs.size:
        parts.append(JointCoordinates(solver))
    # nothing twists in a plane
    if solver.stepper.plane is None and solver.map.model.twisting.size:
        parts.append(SectionAngles(solver))
    return StaticJoints(solver, parts) if parts else None


def _downhill(slopes: Array, left: Array) -> tuple[Array, bool]:
    """Find the increments of coordinates by the forces left [n] and their slopes [n, n]: those of Newton's method where these are
    stable, else downhill along every eigenvector; and whether they are stable."""
    values, vectors = np.linalg.eigh(0.5 * (slopes + slopes.T))
    if np.all(values > 1e-9 * np.max(np.abs(values))):
        return -np.linalg.solve(slopes, left), True
    least = 1e-3 * np.max(np.abs(values), initial=1e-300)
    return -vectors @ ((vectors.T @ left) / np.maximum(np.abs(values), least)), False


class StaticJoints:
    """Coordinates of joints with friction or rigid stops, and of sections with friction in their sleeves, R of them, in the
    equilibria of a solver."""

    def __init__(self, solver: SlidingSolver, parts: list[JointCoordinates | SectionAngles]) -> None:
        self.solver, self._parts = solver, parts
        self._cuts = np.cumsum([x.values.size for x in parts])[:-1]
        self.values, self.stops, self.scales, self.rows, self.has_friction = (
            np.concatenate([getattr(x, name) for x in parts]) for name in ("values", "stops", "scales", "rows", "has_friction"))
        near = np.abs(self.values[:, None] - self.stops) <= 1e-9 * self.scales[:, None]
        # -1 or 1: at rest against the first or last stop
        self.at_stop = np.where(near[:, 1], 1, np.where(near[:, 0], -1, 0))
        # coordinates that are held by whatever force that needs
        self.kept = np.zeros(self.values.size, bool)
        self.labels = [label for x in parts for label in x.labels]
        # arm of every constraint force: 1, of moments the size of the scene; moments of sleeves stand behind those of joints
        begin, length = _begin_of(solver), solver.core.length
        self._arms = np.ones(solver.core.n_forces)
        self._arms[begin[-1]:] = length
        for link, at, to in zip(solver.map.model.kept, begin, begin[1:]):
            self._arms[at:to] = length if link.law.is_angle else 1.0

    @property
    def loose(self) -> Array:
        """Joint coordinates that are free for small motions: without friction and away from stops, bool."""
        loose = ~self.has_friction & (self.at_stop == 0)
        return loose[:sum(x.values.size for x in self._parts if isinstance(x, JointCoordinates))]

    def hold(self) -> None:
        """Prescribe the present values of all coordinates in the next equilibrium."""
        for part, values in zip(self._parts, np.split(self.values, self._cuts)):
            part.hold(values)

    def forces(self) -> Array:
        """Return the forces and moments that hold the coordinates, N or N m, [R]."""
        return np.where(self.rows >= 0, self.solver.stepper.core_state.force[self.rows], 0.0)

    def most(self) -> Array:
        """Return the largest friction under the present forces, [R]."""
        return np.concatenate([x.most() for x in self._parts])

    def _slopes(self, moving: Array) -> Array | None:
        """Return dG/dx of the coordinates that move, [n, n]; None where the equations are singular."""
        solver = self.solver
        saddle, right = solver._assembled(solver.sliding)
        at = self.rows[moving]
        first = solver.places.stop
        out = np.zeros((moving.size, moving.size))
        for column, row in enumerate(at.tolist()):
            unit = np.zeros(right.size)
            unit[first + row] = -1.0
            found = saddle.solve(unit)
            if found is None or not np.isfinite(found).all():
                return None
            out[:, column] = found[first + at]
        return out

    def settle(self, factors: Array) -> tuple[int, list[float]]:
        """The equilibrium of load factors [K] in which all are at rest: status and sizes of increments, as of `equilibrium`."""
        before, sign, changes = self.values.copy(), np.zeros(self.values.size, np.int64), np.zeros(self.values.size, np.int64)
        status, sizes = self._at(self.values, factors)
        reach = np.full(self.values.size, LARGEST_INCREMENT)
        last, force_before, in_vain = np.zeros(self.values.size), np.full(self.values.size, np.inf), 0
        self.solver.unresisted = ""
        for _ in range(MOST_ROUNDS):
            if status != OK:
                return status, sizes
            force, most = self.forces(), self.most()
            # the largest constraint force, moments divided by the size of the scene, N
            largest = float(np.max(np.abs(self.solver.stepper.core_state.force) / self._arms, initial=0.0))
            size = ROUND_OFF * (largest * self.solver.core.length / self.scales + most)
            sticking = (sign == 0) & ~self.kept
            returned = (sign * (self.values - before) < -TINY * self.scales) & (most > 0.0) & (changes < MOST_CHANGES)
            let_go(sticking, force, most + size, sign, self.at_stop)
            sign[returned] = 0
            changes[returned] += 1
            moving = np.flatnonzero(sign)
            if returned.any():
                self.values[returned] = before[returned]
                status, more = self._at(self.values, factors)
                sizes += more
                continue
            # without friction there is no direction
            left = force[moving] + (1.0 - RESERVE) * sign[moving] * most[moving]
            if not moving.size:
                return OK, sizes
            slopes = self._slopes(moving)
            if slopes is None:
                return NOT_CONVERGED, sizes
            increments, stable = _downhill(slopes, left)
            # turned around: it went too far
            turned = moving[increments * last[moving] < 0.0]
            if not stable:
                reach[turned] = np.minimum(reach[turned], 0.5 * np.abs(last[turned]) / self.scales[turned])
            increments = np.clip(increments, -reach[moving] * self.scales[moving], reach[moving] * self.scales[moving])
            if stable and np.all((np.abs(increments) <= TINY * self.scales[moving]) | (np.abs(left) <= size[moving] * 1e-3)):
                self._remember()
                return OK, sizes
            same = np.abs(force[moving] - force_before[moving]) <= SAME * np.abs(force[moving])
            far = same & (np.abs(increments) >= 0.99 * reach[moving] * self.scales[moving])
            in_vain = in_vain + 1 if far.any() else 0
            if in_vain >= IN_VAIN:
                self.solver.unresisted = self.labels[moving[np.argmax(far)]]
                return NOT_CONVERGED, sizes
            force_before[:] = force
            goal = self.values.copy()
            goal[moving] += increments
            low, high = self.stops.T
            met = np.where(goal >= high, 1, np.where(goal <= low, -1, 0))
            goal = np.clip(goal, low, high)
            status, more = self._go(goal, factors)
            sizes += more
            hit = (met != 0) & (sign != 0) & (self.values == goal)
            self.at_stop[hit], sign[hit] = met[hit], 0
            last[:] = 0.0
            last[moving] = increments
        return NOT_CONVERGED, sizes

    def _go(self, goal: Array, factors: Array) -> tuple[int, list[float]]:
        """Find the equilibrium with all coordinates held at `goal`, or at a part of the way there."""
        start, saved = self.values.copy(), self.solver._saved()
        sizes: list[float] = []
        status = NOT_CONVERGED
        for _ in range(MOST_HALVES):
            status, more = self._at(goal, factors)
            sizes += more
            if status == OK:
                return status, sizes
            self.solver._restore(saved)
            goal = 0.5 * (start + goal)
        return status, sizes

    def _at(self, values: Array, factors: Array) -> tuple[int, list[float]]:
        """Find the equilibrium with all coordinates held at these values [R]."""
        self.values = values.copy()
        self.solver.hold_joints()
        status, sizes = self.solver._with_sliders(factors)
        if status == OK:
            self._remember()
        return status, sizes

    def _remember(self) -> None:
        """Write into the history of the state that all coordinates rest, by friction or at stops."""
        for part, *own in zip(self._parts, np.split(self.values, self._cuts), np.split(self.at_stop, self._cuts)):
            part.remember(*own)

    def margin(self, i: int) -> float:
        """Return the share of its friction that coordinate i has left; all of it where it is pressed against a rigid stop."""
        force, most = float(self.forces()[i]), float(self.most()[i])
        if force * self.at_stop[i] < 0.0:
            return 1.0
        return share_left(force, most)

    def report(self) -> dict[str, dict[str, Any]]:
        """Report for every coordinate with friction: the force that holds it, the largest friction, and whether it sticks with
        some in reserve."""
        force, most = self.forces(), self.most()
        out = {}
        for i in np.flatnonzero(self.has_friction).tolist():
            out[self.labels[i]] = {
                "force": float(force[i]), "cone": float(most[i]), "sticks": bool(abs(force[i]) < most[i] * (1.0 - 2.0 * RESERVE))}
        return out
