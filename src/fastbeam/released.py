"""Supports that let go in a run: what they hold, which have let go in a state, and the tables of a run that follow."""
from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .connections import held_in_plane
from .errors import SceneError
from .kernels.work import State

Array = np.ndarray


@dataclass(frozen=True)
class Released:
    """Supports with `until`, R of them. Their numbers in `State.history`, 1 of those that have let go, begin at
    `Model.release_place`.

    Attributes
    ----------
    names : tuple of str
    until : tuple of float or callable
    node, row : int64 [R]
        Node and row of each.
    mask : int64 [R]
        What it holds of the unknowns of the row, bit by bit.
    always : int64 [R]
        What others that do not let go hold of the same row.
    motion : int64 [R]
        Its number among the supports that move, or -1.
    reaction : int64 [R]
        Its number among the supports of `Holding`.
    spin : int
        Bits of the spins.
    """

    names: tuple[str, ...]
    until: tuple[Any, ...]
    node: Array
    row: Array
    mask: Array
    always: Array
    motion: Array
    reaction: Array
    spin: int = 56

    @property
    def size(self) -> int:
        """Numbers of `State.history`."""
        return len(self.names)

    @property
    def arrays(self) -> list[Array]:
        """What tells models with different supports apart; conditions count as one."""
        return [self.node, self.mask, np.array([x if isinstance(x, float) else np.nan for x in self.until])]

    def put(self, gone: Array, masks: Array) -> None:
        """What is held where some have let go, gone [R], into masks of all rows."""
        rows, found = self.masks(gone)
        masks[rows] = found

    def in_plane(self, axes: Array) -> Released:
        """For the unknowns in a plane."""
        return replace(self, mask=held_in_plane(self.mask, axes), always=held_in_plane(self.always, axes), spin=4)

    def masks(self, gone: Array) -> tuple[Array, Array]:
        """Rows [n] and what is held there where some have let go, gone [R]: int64 [n]."""
        rows, which = np.unique(self.row, return_inverse=True)
        masks = np.zeros(rows.size, np.int64)
        np.bitwise_or.at(masks, which, self.always | np.where(gone, 0, self.mask))
        return rows, masks


class OwnSupports:
    """The tables of a run that change when supports let go: copies of those of its model.

    Parameters
    ----------
    core : Model
        With supports that let go.
    """

    def __init__(self, core: Any) -> None:
        held = core.held
        self.of, self.place = core.released, core.release_place
        self.core = replace(core, spinless=core.spinless.copy(), held=held._replace(
            mask=held.mask.copy(), row_mask=held.row_mask.copy(), column_mask=held.column_mask.copy()))
        pattern = core.pattern
        self._of_rows, self._of_columns = pattern.rows[held.block], pattern.columns[held.block]
        self._gone = np.zeros(self.of.size, bool)

    def gone(self, state: State) -> Array:
        """Which supports have let go in a state, bool [R]."""
        return state.history[self.place:self.place + self.of.size] != 0.0

    def follow(self, stepper: Any) -> None:
        """Bring all tables of a run up to its state."""
        gone = self.gone(stepper.core_state)
        if np.array_equal(gone, self._gone):
            return
        self._gone = gone
        core, of = self.core, self.of
        held = core.held
        for row, mask in zip(*of.masks(gone)):
            held.mask[held.row == row] = mask
            held.row_mask[self._of_rows == row] = mask
            held.column_mask[self._of_columns == row] = mask
            core.spinless[core.pattern.row_of == row] = mask & of.spin == of.spin
            if stepper.rows is not None and row < stepper.rows.couplings.held.size:
                stepper.rows.couplings.held[row] = mask
        if stepper.prescribed is not None:
            moves = of.motion >= 0
            stepper.prescribed.mask[of.motion[moves]] = np.where(gone, 0, of.mask)[moves]
        stepper.parts.hold()


class StandingSupports:
    """Of a run in which none lets go."""

    def follow(self, stepper: Any) -> None:
        """Nothing changes."""


def own_supports(core: Any, state: State, static: bool) -> tuple[Any, OwnSupports | StandingSupports]:
    """The model of a run with tables of its own where supports let go; in statics they hold.

    Raises
    ------
    SceneError
        In statics a support of the state has let go.
    """
    if core.released is None:
        return core, StandingSupports()
    own = OwnSupports(core)
    if static and own.gone(state).any():
        name = core.released.names[int(np.argmax(own.gone(state)))]
        raise SceneError(f"start: {name} has let go there; leave it out of the scene for an equilibrium, and start from "
                         "result.state_for(model)")
    return (core, StandingSupports()) if static else (own.core, own)
