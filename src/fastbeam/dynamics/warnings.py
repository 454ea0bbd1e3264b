"""Warnings of a run: events that tell where its results are not to be trusted."""
from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from fastbeam.dynamics.callback import given_places
from fastbeam.dynamics.control import UNRESOLVED_TURN
from fastbeam.dynamics.kinks import Kinks
from fastbeam.kernels.contact.coulomb import Coulomb
from fastbeam.kernels.state import State
from fastbeam.model.contact.sleeve_twist import rubbing, twist_label
from fastbeam.model.model import Model
from fastbeam.results.observe.axial_waves import braking_time
from fastbeam.results.observe.resolution import Resolution
from fastbeam.results.result import Result
from fastbeam.scene.prescribed_motion import Signal, largest_kink
from fastbeam.stepping.stepper import Stepper

Array = np.ndarray
# steps between two looks whether the mesh resolves the shape, so that looks take little time beside steps
STEPS_A_LOOK = 50
# relative drift of an invariant beyond which round-off cannot be all
LARGEST_DRIFT = 1e-6
# events of one kind that name a part each, and impacts of a slider that are looked at
MOST_NAMED, MOST_BLOWS = 100, 5


class Watch:
    """Checks of a run now and then.

    event: takes an event {'kind', 'time', 'text', ...}.
    t_start, t_end: begin and end of the run, s.
    kinks: kinks of a run with order 4.
    """

    def __init__(self, model: Model, stepper: Stepper, event: Callable[[dict[str, Any]], None], t_start: float,
                 t_end: float, kinks: Kinks | None = None) -> None:
        self.model, self.stepper, self.event, self.t_start, self.t_end = model, stepper, event, t_start, t_end
        self.kinks = kinks
        self._turns_are_resolved = True
        self._struck: dict[int, int] = {}
        self._missed: set[str] = set()
        self._resolution: Resolution | None = None
        self._start = stepper.core_state.s.copy()
        self._next_look, self._steps_to_look = t_start, STEPS_A_LOOK

    def massless(self) -> None:
        """Add an event for each beam whose triads nothing holds."""
        massless = self.model.massless if self.stepper.plane is None else ()
        for beam in massless[:MOST_NAMED]:
            self.event({"kind": "massless", "time": self.t_start,
                        "text": f"{beam}: rhoI2 = rhoI3 = 0 and no clamp or rigid connection, so nothing resists a spin about "
                                "its own axis. Outside a plane its directors may spin at random; give the section rotary "
                                "inertia"})
        if len(massless) > MOST_NAMED:
            self.event({"kind": "massless", "time": self.t_start,
                        "text": f"{len(massless) - MOST_NAMED} more beams have rhoI2 = rhoI3 = 0 and no support of their spin"})

    def tables(self) -> None:
        """Add an event for each place that is given by a table whose rate jumps during the run."""
        for who, function in given_places(self.model):
            if isinstance(function, Signal):
                at, jump = largest_kink(function, self.t_start, self.t_end)
                if jump > 0.0:
                    self.event({"kind": "kink", "time": at,
                                "text": f"{who}: the slope of its table jumps by {jump:.3g} per s at t = {at:.6g} s. The jump "
                                        "acts as an impact within one step, and forces alternate from step to step afterwards. "
                                        "Give the Signal interpolation='cubic' or 'pchip', or give damping to the parts that it "
                                        "moves"})

    def order(self, t: float) -> None:
        """Add events where a run with order 4 passed a kink since the last row."""
        if self.kinks is not None:
            for event in self.kinks.look(t, self.stepper.state):
                self.event(event)

    def turns(self, t: float, h: float) -> None:
        """Add an event where a step turns a triad further than it can resolve, once a run."""
        node, turn = self.stepper.largest_turn()
        if turn > UNRESOLVED_TURN and self._turns_are_resolved:
            self._turns_are_resolved = False
            self.event({"kind": "unresolved", "time": t,
                        "text": f"{self.model.node_label(node)} turns by {turn:.3g} rad in a step of {h:.3g} s that ends at t = "
                                f"{t:.6g} s: invariants are conserved, but the rotation is not resolved; use a smaller step"})

    def friction(self, t: float, h: float) -> None:
        """Add an event where a step since the last row has missed Coulomb's law, once a run and coordinate."""
        for stepper in filter(None, (self.stepper, self.stepper.made_fallback)):
            for coulomb, name_of in friction_of(stepper):
                for i in np.flatnonzero(coulomb.missed):
                    name = name_of(i)
                    if name in self._missed or len(self._missed) >= MOST_NAMED:
                        continue
                    self._missed.add(name)
                    self.event({"kind": "unresolved", "time": t,
                                "text": f"{name} jams in a step of {h:.3g} s at or before t = {t:.6g} s: no motion that "
                                        "satisfies Coulomb's law was found. Its friction force deviates from that law there, "
                                        "and the distance that it slides depends on the step; use a smaller step"})

    def blow(self, k: int, name: str, t: float, h: float) -> None:
        """Add an event where steps of size h do not resolve the wave that the impact of slider k, or contact k of moving meshes,
        on a rigid stop sends along the beam, once a run and slider."""
        looks = self._struck.get(k, 0)
        if looks >= MOST_BLOWS or len(self._struck) >= MOST_NAMED:
            return
        time = braking_time(self.model, self.stepper.state, k)
        self._struck[k] = looks + 1
        if h > time:
            self._struck[k] = MOST_BLOWS
            self.event({"kind": "unresolved", "time": t,
                        "text": f"slider {name!r} hits a rigid stop at t = {t:.6g} s. The stress wave in the beam takes over its "
                                f"momentum within m/sqrt(EA rhoA) = {time:.2g} s, which steps of {h:.3g} s do not resolve. Its "
                                "rebound velocity depends on the step, up to that without a wave. Use steps below "
                                f"{0.3 * time:.1g} s, or an elastic stop, stiffness="})

    def drift(self, t: float, result: Result, conserved: Iterable[str]) -> None:
        """Add an event where the conserving step did not conserve: then its equations were not solved."""
        if self.stepper.method.name == "energy_momentum":
            for name in conserved:
                drift = result.drift(name) if name in result.series else 0.0
                if not drift <= LARGEST_DRIFT:
                    self.event({"kind": "drift", "time": t,
                                "text": f"{name} should be constant but drifted by {drift:.2g} of its size: do not trust this "
                                        "run. Use a smaller step, place the scene near the origin and at rest, and compare with "
                                        "solver='sparse', eliminate_inner=False"})

    def next_look(self, t: Array, steps: int, every: int) -> int:
        """Return the first of the rows at times t, `every` steps from one to the next after so many, whose shape is checked."""
        return max(int(np.searchsorted(t, self._next_look)), -((steps - self._steps_to_look) // every) - 1)

    def mesh(self, t: float, steps: int, h: float = 0.0, last: bool = False,
             states: Callable[[], list[State]] | None = None) -> None:
        """Remember where elements do not resolve the shape after so many steps of h, a few times a run; at the end add events.
        states: gives the state at that time; default: the present one."""
        if self._resolution is None:
            self._resolution = Resolution(self.model, self.stepper.strains)
            self._resolution.contacts.before = self.t_start, self._start
        if not last and self.model.n_sliders:
            contacts = self._resolution.contacts
            contacts.remember(t, self.stepper.core_state.s, h, lambda: self.stepper.state)
            if contacts.riders:
                contacts.push(t, self.stepper.core, self.stepper.core_state)
        if self.model.moving is not None and not last:
            self._resolution.look_at_moving(t, self.stepper.state.q, self.stepper.core_state.s)
        if last or t >= self._next_look and steps >= self._steps_to_look:
            self._resolution.look(t, self.stepper.state if states is None else states()[0], moves=True)
            self._next_look = t + (self.t_end - self.t_start) / self._resolution.looks
            self._steps_to_look = steps + STEPS_A_LOOK
        if last:
            for event in self._resolution.events():
                self.event(event)


def friction_of(stepper: Stepper) -> list[tuple[Coulomb, Callable[[int], str]]]:
    """List records of Coulomb's law in a stepper, with a function that returns the name of a coordinate:
    rows ask for it, and there may be many."""
    model, out = stepper.model, list[tuple[Coulomb, Callable[[int], str]]]()
    names, motions = model.names["sliders"], model.motions
    if stepper.along is not None:
        out.append((stepper.along.coulomb, lambda i: f"slider {names[i]!r}"))
    sleeves = rubbing(stepper.terms)
    if sleeves is not None:
        out.append((sleeves.twist.coulomb, lambda i: twist_label(f"sleeve {names[model.sleeve_pairs[i, 0]]!r}")))
    if stepper.motion is not None and stepper.motion.friction is not None:
        out.append((stepper.motion.friction.coulomb, lambda i: f"joint {motions.names[motions.holds.rubs[i]]!r}"))
    return out
