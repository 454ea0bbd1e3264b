"""Coordinates of a run that have bounds, at ends of beams and rigid stops: arc lengths of sliders, with moving meshes ways
between their contacts, then coordinates of joints that may stick."""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.dynamics.velocity_jumps import strike, strike_joint, values_of
from fastbeam.kernels.contact.slider import END_SLACK
from fastbeam.kernels.state import State
from fastbeam.model.model import Model
from fastbeam.stepping.stepper import Stepper

Array = np.ndarray


class OfSliders:
    """Arc lengths of sliders, between the ends of their beams and stops."""

    # whether those that meet stops at the same instant stay at rest there together
    meet_together = False

    def __init__(self, model: Model) -> None:
        self.model, self.scales, self._forces = model, model.slider_lengths, model.slider_forces
        self.has_rigid_stops = self._forces is not None and bool(np.any(self._forces.restitutions >= 0.0))

    def limits(self, state: State) -> Array:
        """Return the bounds of each coordinate, float64 [n, 2]."""
        return self.model.step_limits_at(state.s, state.history)

    def slack(self, limits: Array) -> Array:
        """Return how far each coordinate may lie beyond its bounds, [n]."""
        return self.model.slack_at(limits)

    def at(self, state: State) -> Array:
        """Return the values of the coordinates in a state, [n]."""
        return state.s

    def tried(self, stepper: Stepper) -> Array:
        """Return the values at the end of the last step that was solved for, [n]."""
        return stepper.work.s_end

    def named(self, i: int) -> tuple[str, str]:
        """Return 'slider' or 'joint', and the name of the part to which coordinate i belongs."""
        return "slider", self.model.names["sliders"][i]

    def restitution(self, state: State, i: int, at_end: bool) -> float | None:
        """Return the coefficient of restitution of the rigid stop of coordinate i at its end or start; None without a stop."""
        if self._forces is None:
            return None
        return self._forces.restitution(i, at_end, float(state.s[i]), self.model.along_of(state.history)[i])

    def strike(self, state: State, i: int, at_end: bool, restitution: float, together: dict[int, float]) -> State:
        """Return the state after coordinate i has met a rigid stop; together: those that met one at this instant, and on which
        side."""
        return strike(self.model, state, i, at_end, restitution)


class OfMovingMeshes(OfSliders):
    """Ways between contacts of moving meshes, which must not vanish."""

    def __init__(self, model: Model) -> None:
        super().__init__(model)
        self.moving: Any = model.moving
        self.scales = self.moving.gaps(model.s0)[2]
        self.has_rigid_stops = False

    def limits(self, state: State) -> Array:
        """Return the bounds of each way, float64 [n, 2]: that of the mesh at the start, none at the end."""
        least = self.moving.gaps(state.s)[1]
        return np.stack((least, np.full(least.size, np.inf)), axis=1)

    def slack(self, limits: Array) -> Array:
        """Return zeros [n]."""
        return np.zeros(len(limits))

    def at(self, state: State) -> Array:
        """Return the ways in a state, [n]."""
        return self.moving.gaps(state.s)[0]

    def tried(self, stepper: Stepper) -> Array:
        """Return the ways at the end of the last step that was solved for, [n]."""
        return self.moving.gaps(stepper.work.s_end)[0]

    def restitution(self, state: State, i: int, at_end: bool) -> float | None:
        """Return None: contacts do not strike each other."""
        return None


class OfJoints:
    """Coordinates of joints that may stick, between their rigid stops; methods as of `OfSliders`."""

    meet_together = True

    def __init__(self, model: Model) -> None:
        self.model, self.holds = model, model.motions.holds
        self.scales, self.has_rigid_stops = self.holds.scales, self.holds.has_rigid_stops
        self.named = self.holds.named

    def limits(self, state: State) -> Array:
        return self.holds.ends

    def slack(self, limits: Array) -> Array:
        return END_SLACK * self.scales

    def at(self, state: State) -> Array:
        return values_of(self.model, state)

    def tried(self, stepper: Stepper) -> Array:
        values, motions = values_of(self.model, stepper.core_state), stepper.core.motions
        if motions is not None and stepper.motion is not None and stepper.motion.friction is not None:
            values[motions.holds.left_of_rubs()] = stepper.motion.friction.reached
        return values

    def restitution(self, state: State, i: int, at_end: bool) -> float | None:
        return self.holds.restitution(i, at_end)

    def strike(self, state: State, i: int, at_end: bool, restitution: float, together: dict[int, float]) -> State:
        return strike_joint(self.model, state, i, at_end, restitution, together)


class Bounded:
    """All coordinates with bounds of a model: those of sliders, of moving meshes, then those of joints; scales: float64 [n],
    lengths of beams, m; large values of coordinates of joints, m or rad."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.kinds: list[OfSliders | OfJoints] = [OfSliders(model)]
        if model.moving is not None:
            self.kinds.append(OfMovingMeshes(model))
        if model.motions is not None and model.motions.holds.rubs.size:
            self.kinds.append(OfJoints(model))
        self.scales = _joined([kind.scales for kind in self.kinds])
        self._start = np.cumsum([0, *(kind.scales.size for kind in self.kinds)])

    def kind_of(self, k: int) -> tuple[OfSliders | OfJoints, int]:
        """Return the kind of coordinate k, and its number there."""
        at = int(np.searchsorted(self._start, k, side="right")) - 1
        return self.kinds[at], k - int(self._start[at])

    def limits(self, state: State) -> Array:
        """Return the bounds of each coordinate, float64 [n, 2]."""
        return _joined([kind.limits(state) for kind in self.kinds])

    def slack(self, limits: Array) -> Array:
        """Return how far each coordinate may lie beyond its bounds, [n]."""
        return _joined([kind.slack(some) for kind, some in zip(self.kinds, np.split(limits, self._start[1:-1]))])

    def at(self, state: State) -> Array:
        """Return the values of the coordinates in a state, [n]."""
        return _joined([kind.at(state) for kind in self.kinds])

    def tried(self, stepper: Stepper) -> Array:
        """Return the values at the end of the last step that was solved for, [n]."""
        return _joined([kind.tried(stepper) for kind in self.kinds])


def vanishing(model: Model, state: State, h: float) -> Array:
    """Find ways between contacts that would vanish within a step of size h at the velocities of the state, int64 [*]: where
    elements vanish, no step converges."""
    if model.moving is None:
        return np.zeros(0, np.int64)
    s = state.s.copy()
    s[model.moving.sliders] += h * model.moving.places_in(state.history)
    ahead, least, _ = model.moving.gaps(s)
    return np.flatnonzero(ahead < least)


def _joined(parts: list[Array]) -> Array:
    """Concatenate arrays; one alone as it is."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)
