"""Rows, shapes and events of the equilibria that a static analysis finds, for its result."""
from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any

import numpy as np

from fastbeam.compile.links import Passes
from fastbeam.dynamics.interrupt import Interrupts
from fastbeam.interface.errors import ConvergenceError, Interrupted, carry
from fastbeam.kernels.state import State
from fastbeam.model.model import Model
from fastbeam.model.rates import own_shape
from fastbeam.results.observe.observer import Observer
from fastbeam.results.observe.resolution import Resolution
from fastbeam.results.result import Result, ResultBuffer
from fastbeam.scene.checks import Place
from fastbeam.statics.equilibrium import StaticSolver
from fastbeam.statics.reactions import reactions_of

Array = np.ndarray
NONE: Mapping[str, Any] = MappingProxyType({})
# quantities that `simulate` observes and that exist at rest
RECORDED = ("energy", "spring", "orientation", "section", "reaction")


class StaticRows:
    """Rows of the equilibria of a model, of what is observed at rest; method, info: of the result; solver: has reactions and
    reference strains; series, names: of rows besides those of the observer. Raises SceneError: what is observed does not
    exist."""

    def __init__(self, model: Model, method: str, observe: Sequence[str], points: Mapping[str, Place] | None,
                 solver: StaticSolver | None, info: Mapping[str, Any], series: Mapping[str, tuple[int, ...]] = NONE,
                 names: Mapping[str, list[Any]] = NONE) -> None:
        self.model = model
        if not set(observe) <= set(RECORDED):
            Observer(model, observe, points)  # refuses what does not exist
        self._strains = None if solver is None else solver.strains
        self.observed = "slider", "joint", *(kind for kind in observe if kind in RECORDED)
        self.observer = Observer(model, self.observed, points, strains=self._strains)
        self.reactions = None if solver is None else reactions_of(solver, self.observer)
        self.info: dict[str, Any] = {"scene": model.scene_name, "method": method, "conserved": [], **info}
        header = self.observer.header(self.info)
        header.series |= series
        header.names |= names
        self.buffer = ResultBuffer(header)
        self.passes = Passes(model.lines, self.buffer.event)
        self.begin = time.perf_counter()

    def event(self, kind: str, at: float, text: str) -> None:
        """Add an event at the time of a row."""
        self.buffer.event({"kind": kind, "time": at, "text": text})

    def row(self, t: float, state: State, iterations: int, size: float, loads: Array,
            share: float | None = None) -> dict[str, Any]:
        """Return the row of an equilibrium at time t, s, under load factors [K]; share: that of drives."""
        row = {**self.observer.row(t, state), "iterations": iterations, "step_size": size}
        if self.observer.needs_forces:
            found = self.reactions.at(loads, state) if self.reactions else ()
            self.observer.add_forces(row, np.concatenate((state.force, found)), share)
        return row

    def keep(self, at: float, row: dict[str, Any], state: State, where: str, shown: State | None = None) -> None:
        """Keep a row and a shape, that of another state if given; where: describes the equilibrium in events."""
        self.buffer.append(row, at)
        self.passes.look(state.q, at, where)
        q, _, mesh = own_shape(self.model, shown or state)
        self.buffer.snapshot(at, q[:, 0], q[:, 1:], mesh=mesh)

    def look_at_mesh(self, at: float, state: State) -> str:
        """Add events where elements are too coarse for an equilibrium; return the first as a text."""
        resolution = Resolution(self.model, self._strains)
        resolution.look(at, state)
        found = resolution.events()
        for event in found:
            self.buffer.event(event)
        return f"; {found[0]['text']}" if found else ""

    def closed(self, state: State, **more: Any) -> Result:
        """Return the result so far with its last state, a copy; more: entries of `info`."""
        result = self.buffer.close(self.info | more | {"wall_time": time.perf_counter() - self.begin})
        result.state, result._moving = State(*(x.copy() for x in state)), self.model.moving
        return result

    @contextmanager
    def guarded(self, finish: Callable[[], Result], at: Callable[[], float], where: Callable[[], str],
                last: str = "equilibrium") -> Iterator[Interrupts]:
        """Let Ctrl-C wait for the end of a step, or of an iteration where these are called from Python. What ends an analysis
        takes its result along, from `finish`; at: time of events; where, last: for the message. Raises Interrupted."""
        try:
            with Interrupts() as interrupts:
                yield interrupts
        except ConvergenceError:
            raise
        except Exception as failed:
            self.event("failed", at(), f"{type(failed).__name__}: {failed}")
            carry(failed, finish)
            raise
        except KeyboardInterrupt as stopped:
            text = f"{where()}: interrupted; the last {last} is in .state, everything until then in .result"
            self.event("interrupted", at(), text)
            result = finish()
            raise Interrupted(text, result=result, state=result.state) from stopped
