"""Bounds of ends of beams and rigid stops in a run: of arc lengths of sliders, or in scenes with moving meshes of the ways
between their contacts, then of coordinates of joints that may stick."""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.dynamics.impacts import before_joints
from fastbeam.dynamics.velocity_jumps import values_of
from fastbeam.kernels.contact.slider import END_SLACK
from fastbeam.kernels.state import State
from fastbeam.stepping.stepper import Stepper

Array = np.ndarray


class Ways:
    """Bounded coordinates of a run: arc lengths of S sliders, or ways between contacts, and R coordinates of joints.

    Parameters
    ----------
    stepper : Stepper

    Attributes
    ----------
    scales : float64 [S + R]
        Lengths of beams, m; large values of coordinates of joints, m or rad.
    """

    def __init__(self, stepper: Stepper) -> None:
        self.stepper, self.model = stepper, stepper.model
        motions = self.model.motions
        self.holds: Any = None if motions is None or not motions.holds.rubs.size else motions.holds
        self.moving = self.model.moving
        lengths = self.model.slider_lengths if self.moving is None else self.moving.gaps(self.model.q0.reshape(-1))[2]
        self.scales = lengths if self.holds is None else np.concatenate((lengths, self.holds.scales))

    def limits(self, state: State) -> Array:
        """Return the bounds of each coordinate, float64 [S + R, 2]."""
        if self.moving is not None:
            least = self.moving.gaps(state.q)[1]
            limits = np.stack((least, np.full(least.size, np.inf)), axis=1)
        else:
            limits = self.model.limits_at(state.s, state.history)
        return limits if self.holds is None else np.concatenate((limits, self.holds.ends))

    def slack(self, limits: Array) -> Array:
        """Return how far each coordinate may lie beyond its bounds, [S + R]."""
        first = before_joints(self.model)
        slack = np.zeros(first) if self.moving is not None else self.model.slack_at(limits[:first])
        return slack if self.holds is None else np.concatenate((slack, END_SLACK * self.holds.scales))

    def at(self, state: State) -> Array:
        """Return the values of the coordinates in a state, [S + R]."""
        s = state.s if self.moving is None else self.moving.gaps(state.q)[0]
        return s if self.holds is None else np.concatenate((s, values_of(self.model, state)))

    def runs_out(self, h: float) -> Array:
        """Find ways between contacts that would vanish within a step of size h at the velocities of the state, int64 [*]: where
        elements vanish, no step converges."""
        if self.moving is None:
            return np.zeros(0, np.int64)
        state = self.stepper.state
        ahead, least, _ = self.moving.gaps(state.q + h * state.v)
        return np.flatnonzero(ahead < least)

    def tried(self) -> Array:
        """Return the values of the coordinates at the end of the last step that was solved for, [S + R]."""
        work = self.stepper.work
        s = work.s_end if self.moving is None else self.moving.gaps(work.q_end)[0]
        if self.holds is None:
            return s
        values, core = values_of(self.model, self.stepper.core_state), self.stepper.core
        if core.motions is not None and self.stepper.motion is not None and self.stepper.motion.friction is not None:
            values[core.motions.holds.left_of_rubs()] = self.stepper.motion.friction.reached
        return np.concatenate((s, values))
