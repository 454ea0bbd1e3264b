"""Rows, shapes and events of a run, on their way to memory and file."""
from __future__ import annotations

import math
from typing import Any

import numpy as np

from fastbeam.dynamics.blocks import Block
from fastbeam.dynamics.checkpoint import Clock
from fastbeam.dynamics.contact_force import ContactForces
from fastbeam.dynamics.options import Output
from fastbeam.interface.errors import ResultFileError
from fastbeam.kernels.state import State
from fastbeam.model.maps import spins
from fastbeam.model.rates import own_shape
from fastbeam.results.observe.observer import Observer
from fastbeam.results.result import ResultBuffer, ResultHeader
from fastbeam.stepping.stepper import Stepper

Array = np.ndarray
# whole shapes of a run that says nothing
SNAPSHOTS = 50


class Rows:
    """Rows of a run on their way to memory and file. A row waits until the next step is known: the contact force of a row is the
    mean of the steps around it (theory.md (4.5)).

    forces: None where forces are not recorded, or are those at the end of a step.
    output: file, and about how many shapes to keep, one a row at most.
    writer: a file that cannot be written is left behind.
    file_error: why; a run ends at its next row then.
    broken_off: whether an error is on its way out, which does not wait for the steps that the force of the last row takes.
    """

    def __init__(self, observer: Observer, stepper: Stepper, clock: Clock, forces: ContactForces | None, t_end: float,
                 header: ResultHeader, output: Output) -> None:
        self.observer, self.stepper, self.clock, self.forces, self.t_end = observer, stepper, clock, forces, t_end
        self.writer: Any = None
        if output.file is not None:
            from fastbeam.results.hdf5_writer import ResultWriter
            self.writer = ResultWriter(output.file, header, overwrite=output.overwrite)
        self.file_error: ResultFileError | None = None
        self.snapshots = SNAPSHOTS if output.snapshots is None else output.snapshots
        self.memory = ResultBuffer(header, min(self.snapshots, SNAPSHOTS))
        self.shape_gap = (t_end - clock.origin) / max(self.snapshots - 1, 1)
        self.first_shape = self.next_shape = clock.origin
        self.pending: tuple[float, dict[str, Any]] | None = None
        self.first_force: Array | None = None
        self.broken_off = True

    def first(self) -> None:
        """Open the row that a run starts from."""
        self.open(self.clock.now, 0, 0.0)
        if self.forces is not None:
            self.first_force = self.forces.first(self.clock)

    def open(self, t: float, iterations: int, size: float) -> None:
        """Open a row of the present state, after steps of this size that took so many iterations each."""
        self.pending = (t, {**self._row(t), "iterations": iterations, "step_size": size})
        if self._due(np.array([t])):
            self._shape(t, self.stepper.state)

    def _row(self, t: float) -> dict[str, Any]:
        return self.observer.row(t, self.stepper.state, self.stepper.core_state[:2])

    def block(self, block: Block, every: int, size: float) -> None:
        """Append rows without forces of constraints, each after so many steps of this size."""
        self.close()
        rows = self.observer.rows(block.t, block.q, block.v, block.states)
        self._feed("append", {**rows, "iterations": block.iterations // every, "step_size": np.full(len(block.t), size)}, block.t)
        due = self._due(block.t)
        for t, state in zip(block.t[due].tolist(), block.states(due)):
            self._shape(t, state)

    def _due(self, t: Array) -> list[int]:
        """Return the rows at times t whose shapes are due, and find when the next is."""
        out = list[int]()
        k = 0 if self.snapshots > 0 else len(t)
        gap = self.shape_gap
        while (k := max(k, int(np.searchsorted(t, min(self.next_shape - 1e-9 * gap, self.t_end))))) < len(t):
            self.next_shape = self.first_shape + gap * (math.floor((float(t[k]) - self.first_shape) / gap + 1e-9) + 1)
            out.append(k)
            k += 1
        return out

    def _shape(self, t: float, state: State) -> None:
        """Keep a shape."""
        q, v, mesh = own_shape(self.stepper.model, state)
        rates = (v[:, 0], spins(q, v)) if self.memory.header.velocities else (None, None)
        self._feed("snapshot", t, q[:, 0], q[:, 1:], *rates, mesh)

    def reopen(self, t: float) -> None:
        """Take the present state for the waiting row of this time; steps ahead tell its forces."""
        if self.pending is not None:
            row = self.pending[1]
            self.pending = (t, {**row, **self._row(t)})
        if self.forces is not None:
            self.first_force = self.forces.first(self.clock)

    def close(self, t: float = 0.0, size: float = 0.0, after: Array | None = None, steps: int = 0) -> None:
        """Finish the waiting row, now that so many steps of this size, with mean forces `after` in the first, led to time t; or
        that the run ends."""
        if self.pending is None:
            return
        if self.observer.needs_forces:
            self.observer.add_forces(self.pending[1], np.asarray(self._force(t, size, after, steps)))
        (time_of_row, row), self.pending = self.pending, None
        self._feed("append", row, time_of_row)

    def close_last(self) -> None:
        """Finish the waiting row where a run ends; its forces are unknown where a function of time fails in their steps."""
        try:
            self.close()
        except Exception:
            self.broken_off = True
            self.close()

    @property
    def looks_back(self) -> bool:
        """True where forces of the last row come from those of the last steps, one by one."""
        return self.forces is not None and self.forces.looks_back

    def _force(self, t: float, size: float, after: Array | None, steps: int) -> Array | None:
        """Return forces of all constraints in the waiting row."""
        if self.forces is None:
            # forces at the end of a step are those of its time
            return self.clock.before
        if self.first_force is not None:
            force, self.first_force = self.first_force, None
            return force
        if after is not None:
            return self.forces.between(self.clock, t, size, after, steps)
        return self.forces.unknown if self.broken_off else self.forces.last(self.clock)

    def event(self, event: dict[str, Any]) -> None:
        """Keep an event {'kind', 'time', 'text', ...}."""
        self._feed("event", event)

    def _feed(self, call: str, *what: Any) -> None:
        getattr(self.memory, call)(*what)
        if self.writer is not None:
            try:
                getattr(self.writer, call)(*what)
            except ResultFileError as failed:
                self.writer, self.file_error = None, failed

    def end(self, info: dict[str, Any]) -> None:
        """Close the file."""
        if self.writer is not None:
            try:
                self.writer.close(info)
            except ResultFileError as failed:
                self.file_error = failed
