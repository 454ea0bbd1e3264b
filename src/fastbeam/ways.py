"""What ends of beams and rigid stops bound in a run: arc lengths of sliders, then coordinates of joints that may stick; in scenes
with moving meshes the ways between their contacts."""
from __future__ import annotations

from typing import Any

import numpy as np

from .impacts import values_of
from .kernels.slider import END_SLACK
from .kernels.work import State
from .newton import Stepper

Array = np.ndarray


class Ways:
    """Of S sliders and R coordinates of joints, or R ways between contacts.

    Parameters
    ----------
    stepper : Stepper

    Attributes
    ----------
    scales : float64 [S + R]
        Lengths of beams, m; what counts as a large value of a coordinate, m or rad.
    """

    def __init__(self, stepper: Stepper) -> None:
        self.stepper, self.model = stepper, stepper.model
        motions = self.model.motions
        self.holds: Any = None if motions is None or not motions.holds.rubs.size else motions.holds
        self.moving = self.model.moving
        lengths = self.model.slider_lengths if self.moving is None else self.moving.gaps(self.model.q0.reshape(-1))[2]
        self.scales = lengths if self.holds is None else np.concatenate((lengths, self.holds.scales))

    def limits(self, state: State) -> Array:
        """Between which each may go, float64 [S + R, 2]."""
        if self.moving is not None:
            least = self.moving.gaps(state.q)[1]
            return np.stack((least, np.full(least.size, np.inf)), axis=1)
        limits = self.model.limits_at(state.s, state.history)
        return limits if self.holds is None else np.concatenate((limits, self.holds.ends))

    def slack(self, limits: Array) -> Array:
        """By how much it may be beyond, [S + R]."""
        if self.moving is not None:
            return np.zeros(len(limits))
        slack = self.model.slack_at(limits[:self.model.n_sliders])
        return slack if self.holds is None else np.concatenate((slack, END_SLACK * self.holds.scales))

    def at(self, state: State) -> Array:
        """Where they are, [S + R]."""
        if self.moving is not None:
            return self.moving.gaps(state.q)[0]
        return state.s if self.holds is None else np.concatenate((state.s, values_of(self.model, state)))

    def tried(self) -> Array:
        """Where the last step that was solved for led, [S + R]."""
        if self.moving is not None:
            return self.moving.gaps(self.stepper.work.q_end)[0]
        s = self.stepper.work.s_end
        if self.holds is None:
            return s
        values, core = values_of(self.model, self.stepper.core_state), self.stepper.core
        if core.motions is not None and self.stepper.motion is not None and self.stepper.motion.friction is not None:
            values[core.motions.holds.left_of_rubs()] = self.stepper.motion.friction.reached
        return np.concatenate((s, values))
