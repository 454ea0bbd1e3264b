"""Supports that let go or take hold in a run: fixed unknowns in a state, and the tables of a run that follow."""
from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.kernels.beams.nodes import Held
from fastbeam.kernels.state import State
from fastbeam.linalg.pattern import Pattern
from fastbeam.model.analyses import Analysis, Lack, always, unknown_to_methods, without_adjoint
from fastbeam.model.connections import fixed_in_plane
from fastbeam.model.feature import Feature

Array = np.ndarray


@dataclass(frozen=True)
class Released(Feature):
    """Supports with `until` or `since`, R of them. Their history variables count the changes of each: supports with `since` take
    hold first, those with `until` let go."""

    key, title, order = "released", "supports with until= or since=", 70
    lacks = (
        unknown_to_methods("supports with until= or since="),
        Lack((Analysis.ORDER_4,), "supports with until= or since=",
             "order=4: where a support is released or engages, velocities are of second order only, and so is the motion after "
             "it",
             "use order=2", always("supports")),
        Lack((Analysis.RELAX,), "supports with until= or since=",
             "relax: a support is released or engages (until=, since=)",
             "leave that out for the equilibrium, or run in time", always("supports")),
        without_adjoint("supports with until= or since="))

    names: tuple[str, ...]
    # until, since: tuple of float, callable or None
    until: tuple[Any, ...]
    since: tuple[Any, ...]
    # node, row, int64 [R]: node and row of each
    node: Array
    row: Array
    mask: Array  # int64 [R]: unknowns of the row that each fixes, bit by bit
    always: Array  # int64 [R]: unknowns of the same row that supports without `until` and `since` fix, bit by bit
    motion: Array  # int64 [R]: number among the supports that move, or -1
    reaction: Array  # int64 [R]: number among the supports of `Holding`
    spin: int = 56  # bits of the spins

    @property
    def history_size(self) -> int:
        """Number of history variables, one for each support."""
        return len(self.names)

    @property
    def arrays(self) -> list[Array]:
        """Arrays that differ for models with different supports; times that are conditions count as NaN."""
        return [self.node, self.mask, self.waits, *(np.array([x if isinstance(x, float) else np.nan for x in times])
                                                    for times in (self.until, self.since))]

    @property
    def waits(self) -> Array:
        """True for supports that take hold in the run, bool [R]."""
        return np.array([x is not None for x in self.since])

    @property
    def losses(self) -> tuple[str, ...]:
        """Names of the energies lost where supports take hold, in their order."""
        return tuple(f"impact at {name}" for name, waits in zip(self.names, self.waits) if waits)

    def describe(self) -> list[tuple[str, str, list[str]]]:
        """Return lines of `print(model)`: supports that let go, and those that take hold."""
        return [(what, "", [name for name, time in zip(self.names, times) if time is not None])
                for what, times in (("let go", self.until), ("take hold", self.since))]

    def off(self, changes: Array) -> Array:
        """Return which supports do not hold, bool [R], from the number of changes of each [R]."""
        return np.asarray(changes + ~self.waits != 1.0)

    def at_start(self, held: Held | None, pattern: Pattern) -> Held | None:
        """Return the fixed unknowns before supports with `since` take hold; held: table with all supports."""
        if held is None or not self.waits.any():
            return held
        found = held._replace(mask=held.mask.copy(), row_mask=held.row_mask.copy(), column_mask=held.column_mask.copy())
        everything = self.masks(np.zeros(len(self.names), bool))[1]
        for (row, mask), every in zip(zip(*self.masks(self.waits)), everything):
            found.mask[held.row == row] &= ~(every & ~mask)
            found.row_mask[pattern.rows[held.block] == row] &= ~(every & ~mask)
            found.column_mask[pattern.columns[held.block] == row] &= ~(every & ~mask)
        return found

    def put(self, off: Array, masks: Array) -> None:
        """Set masks of fixed unknowns of all rows for supports that do not hold, off [R]."""
        rows, found = self.masks(off)
        masks[rows] = found

    def in_plane(self, plane: Any, model: Any, constraints: int) -> Released:
        """Return a copy for the unknowns in a plane."""
        mask, always = (fixed_in_plane(x, plane.axes) for x in (self.mask, self.always))
        return replace(self, mask=mask, always=always, spin=4)

    def masks(self, off: Array) -> tuple[Array, Array]:
        """Return rows [n] and masks of fixed unknowns in these rows, int64 [n], for supports that do not hold, off [R]."""
        rows, which = np.unique(self.row, return_inverse=True)
        masks = np.zeros(rows.size, np.int64)
        np.bitwise_or.at(masks, which, self.always | np.where(off, 0, self.mask))
        return rows, masks


class OwnSupports:
    """Tables of a run that change when supports let go or take hold: copies of those of its model; core: Model with such
    supports."""

    def __init__(self, core: Any) -> None:
        held = core.held
        self.of = core.released
        self.core = replace(core, spinless=core.spinless.copy(), held=held._replace(
            mask=held.mask.copy(), row_mask=held.row_mask.copy(), column_mask=held.column_mask.copy()))
        pattern = core.pattern
        self._of_rows, self._of_columns = pattern.rows[held.block], pattern.columns[held.block]
        self._off = self.of.waits

    def off(self, state: State) -> Array:
        """Return which supports do not hold in a state, bool [R]."""
        return self.of.off(self.core.own(state.history, "released"))

    def follow(self, stepper: Any) -> None:
        """Update all tables of a run to the supports in its state."""
        off = self.off(stepper.core_state)
        if np.array_equal(off, self._off):
            return
        self._off = off
        core, of = self.core, self.of
        held = core.held
        for row, mask in zip(*of.masks(off)):
            held.mask[held.row == row] = mask
            held.row_mask[self._of_rows == row] = mask
            held.column_mask[self._of_columns == row] = mask
            core.spinless[core.pattern.row_of == row] = mask & of.spin == of.spin
            if stepper.rows is not None and row < stepper.rows.couplings.held.size:
                stepper.rows.couplings.held[row] = mask
        if stepper.prescribed is not None:
            moves = of.motion >= 0
            stepper.prescribed.mask[of.motion[moves]] = np.where(off, 0, of.mask)[moves]
        stepper.parts.hold()


class StandingSupports:
    """Supports of a run in which none lets go or takes hold."""

    def follow(self, stepper: Any) -> None:
        """Do nothing: no table changes."""


def own_supports(core: Any, state: State, static: bool) -> tuple[Any, OwnSupports | StandingSupports]:
    """Return the model of a run with its own tables where supports change; in statics they stay as at the start. Raises
    SceneError: in statics a support of the state has let go or taken hold."""
    if core.released is None:
        return core, StandingSupports()
    own = OwnSupports(core)
    changed = core.own(state.history, "released") != 0.0
    if static and changed.any():
        k = int(np.argmax(changed))
        what, change = (("been released", "leave it out of the scene") if own.off(state)[k] else
                        ("engaged", "leave out its since="))
        raise SceneError(f"start: {core.released.names[k]} has {what} in this state; {change} for an equilibrium, and start from "
                         "result.state_for(model)")
    return (core, StandingSupports()) if static else (own.core, own)
