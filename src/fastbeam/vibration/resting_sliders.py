"""Sliders about a state at rest (theory.md 11, 14): sliders that stay in place, and forces of drives, stops and friction along
the beam on the others, to first order in places and velocities."""
from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.kernels.contact.slider_forces import CAME_BY, HELD, HISTORY, INCREMENT, LOCKED, OFFSET, POSITION, STIFFNESS, TURNS
from fastbeam.statics.slider_friction import StaticAlong

if TYPE_CHECKING:
    from fastbeam.kernels.state import State
    from fastbeam.model.model import Model
    from fastbeam.stepping.assembled import Equations

Array = np.ndarray
# force along the beam that is round-off of contact forces, next to these, and next to all loads
OF_CONTACT, OF_LOADS = 1e-8, 1e-12


class RestingSliders:
    """Sliders, S of them, about a state at rest.

    Those that are held, locked, or whose motion is prescribed stay where they are, and those that friction or a rigid stop holds;
    on the others act drives and elastic stops, with the derivatives of their forces, and viscous and smoothed friction.

    model: sliders have forces along their beams.
    stays: bool [S], sliders that stay in place, with whatever force that needs.
    at_time: time of functions of time, s.
    factor: load factor, with which forces of drives grow.
    """

    def __init__(self, model: Model, state: State, stays: Array, at_time: float, factor: float) -> None:
        forces = self.forces = model.slider_forces
        self._names, s = model.names["sliders"], state.s
        prescribed = np.isin(forces.tables.drive, (POSITION, INCREMENT))
        self.along = StaticAlong(model, at_time, s, stays | prescribed, state.history)
        self.along.factor = factor
        self._own = model.along_of(state.history).copy()
        self.force, _ = self.along.known(s)
        self._at = at_time, factor, s.copy()

    def _by_drives(self, by_rate: bool) -> Array:
        """Return derivatives of the forces of drives on sliders that are free, by place, N/m, or by rate, N s/m, [S]."""
        t, factor, s = self._at
        out = np.zeros(s.size)
        for k in np.intersect1d(self.along.driven, np.flatnonzero(self.free)).tolist() if factor else []:
            out[k] = self.forces.slope_at_rest(k, t, float(s[k]), factor, float(self._own[k, OFFSET]), by_rate)
        return out

    @property
    def free(self) -> Array:
        """Sliders that move, bool [S]."""
        return self.along.free

    @property
    def slope(self) -> Array:
        """Derivatives by s of the forces of drives and stops on sliders that are free, N/m, [S].

        Raises SceneError: the law of a drive has none.
        """
        s, stiff, (low, high) = self._at[2], self.forces.tables.stops[:, STIFFNESS], self.along.elastic.T
        return self._by_drives(by_rate=False) - np.where((stiff > 0.0) & ((s < low) | (s > high)), stiff, 0.0)

    def put(self, equations: Equations) -> Equations:
        """Add these forces to equations of sliders."""
        return equations._replace(sliding=equations.sliding - self.force, bend=equations.bend - self.slope)

    def damping(self, equations: Equations) -> Array:
        """Return minus the derivatives of forces along the beam by ds/dt, N s/m, [S]; equations: with normal forces.

        Raises SceneError: the law of a drive has none.
        """
        table = self.forces.tables
        smooth = (table.smoothing > 0.0) & (table.friction > 0.0)
        of_smooth = np.where(smooth, table.friction * equations.normal / np.where(smooth, table.smoothing, 1.0), 0.0)
        return np.where(self.free, of_smooth + table.viscous - self._by_drives(by_rate=True), 0.0)

    def judge(self, who: str, equations: Equations, loads: float) -> bool:
        """Check that friction and stops hold the sliders that they are to hold; one that touches a stop without a force is free
        from now on.

        who: the function that was called.
        equations: equations at the equilibrium, without these forces and with normal forces.
        loads: size of all loads, N.
        Raises SceneError: one is pushed away.

        Returns
        -------
        bool
            True where a slider is free that was not.
        """
        along, at_stop = self.along, self.along.modes.at_stop
        most, needed = along.friction * equations.normal, equations.sliding - self.force
        long = np.linalg.norm(equations.along, axis=1)
        slack = OF_CONTACT * (long * equations.size + np.abs(self.force)) + OF_LOADS * long * loads
        resting = ~along.held & (along.rubs | (at_stop != 0))
        gone = resting & ((needed > most + slack) & (at_stop >= 0) | (needed < -most - slack) & (at_stop <= 0))
        if gone.any():
            k = int(np.argmax(gone * np.abs(needed)))
            holds = ["its stop acts in the other direction only"] if at_stop[k] else []
            holds += [f"its friction is at most {most[k]:.6g} N"] if along.rubs[k] else []
            raise SceneError(f"{who}: the state is not an equilibrium: a force of {abs(needed[k]):.6g} N pushes slider "
                             f"{self._names[k]!r} along its beam, but {' and '.join(holds)}. Find one with result = "
                             "fb.solve_static(model) and give state=result.state")
        touches = ~along.rubs & (at_stop != 0) & (np.abs(needed) <= slack)
        at_stop[touches] = 0
        return bool(touches.any())

    def remember(self, history: Array) -> None:
        """Write into the history of a state that moves about this one which sliders are locked, stick or rest against a stop."""
        self.along.remember(history)
        own = history[:HISTORY * self.free.size].reshape(-1, HISTORY)
        carried_over = [HELD, TURNS, OFFSET, CAME_BY]
        own[:, carried_over] = self._own[:, carried_over]


def locked_sliders(model: Model, state: State | None) -> Array:
    """Return which sliders are locked in a state, bool [S]."""
    if model.slider_forces is None or state is None:
        return np.zeros(model.n_sliders, bool)
    return np.asarray(model.along_of(state.history)[:, HELD] == LOCKED)


def resting_sliders(who: str, model: Model, state: State | None, stays: Array, at_time: float | None,
                    factor: float) -> RestingSliders | None:
    """Collect the sliders about a state at rest; None where nothing acts along the beams of a model. who: the function that was
    called.

    Raises SceneError: a drive is a function of time, and none is given.
    """
    forces = model.slider_forces
    if forces is None:
        return None
    return RestingSliders(model, model.state() if state is None else state, stays, at_time or 0.0, factor)
