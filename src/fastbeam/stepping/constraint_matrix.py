"""Newton iterations around one sparse matrix of nodes and constraints, of nets with many constraints, and in the fallback around
SuperLU (theory.md 9).

    K x + C y = -r          C: columns, derivatives of the residual by the unknowns of the constraints
    L x + D y = -g          L: lines, derivatives of their equations by the unknowns of the nodes

with the augmented Lagrangian of (5.5) on the diagonal of D.
"""
from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from fastbeam.kernels import loop as kernels
from fastbeam.linalg.factors import OF_STEP, Factors, factoriser_for, solver_name
from fastbeam.linalg.linear_system import LinearSystem
from fastbeam.linalg.pattern import Pattern
from fastbeam.model.maps import free_of_rows
from fastbeam.stepping.assembled import MatrixOfBlocks
from fastbeam.stepping.iteration import Iteration

if TYPE_CHECKING:
    from fastbeam.stepping.stepper import Stepper

Array = np.ndarray


def _same(touched: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    """Return whether entries stand for the same rows, with the same unknowns held."""
    return touched[:2] == other[:2] and bool(other) and touched[2] is other[2]


class MatrixSystem(LinearSystem):
    """Solver for the nodes and constraints of a model."""

    def __init__(self, pattern: Pattern, backend: str, size: int) -> None:
        super().__init__(pattern, 1, "superlu", size)
        # on one thread, because the bits depend on their number
        self.factoriser = factoriser_for(backend, threads=1)

    @property
    def name(self) -> str:
        """Linear solver and its number of factorisations, for the result."""
        return solver_name(self.factoriser, "nodes and constraints")


class MatrixIteration(Iteration):
    """Newton iteration around the sparse matrix of nodes and constraints."""

    def __init__(self, owner: Stepper) -> None:
        super().__init__(owner)
        core, contact = owner.core, owner.contact
        assert contact is not None
        self._size, self._border, self._dim = len(core.dofs), core.border, core.dim
        self._matrix = MatrixOfBlocks(core.pattern, self._size, core.border * core.n_constraints)
        self._nodes = self._matrix.nodes
        self._of_force = np.arange(self._border) < contact.forces[:, None]
        self._unknowns = np.arange(self._border) < core.unknowns[:, None]
        self._number = self._nodes + contact.first[:, None] + np.arange(self._border)
        # what entries stand for, and did in the first iteration of the last step; the structure that they were given there
        self._touched: tuple[Any, ...] = ()
        self._begun: tuple[Any, ...] = ()
        self._structure: Array | None = None
        self._is_first = True
        self._entries = self._place = self._rows = self._of = np.zeros(0, np.int64)
        # the constraint whose forces move nothing, -1: none
        self._loose = -1
        rows, within = core.pattern.rows, np.arange(self._size)
        own = rows == core.pattern.columns
        self._diagonal = np.zeros((core.pattern.n, self._size), np.int64)
        self._diagonal[rows[own]] = 8 * self._size * np.flatnonzero(own)[:, None] + 9 * within
        self._diagonal = self._diagonal.reshape(-1)

    def newton(self, h: float, max_iterations: int, largest: float, stop: Callable[[], Any]) -> tuple[int, list[float]]:
        # the bits of a step must not depend on those before
        self._is_first = True
        if self.owner.linear.factoriser is not None:
            self.owner.linear.factoriser.forget()
        return super().newton(h, max_iterations, largest, stop)

    def _look(self) -> None:
        """Find where entries of the constraints stand, if that has changed."""
        contact, core = self.owner.contact, self.owner.core
        inside = np.arange(contact.row.shape[1]) < contact.entries[:, None]
        touched = contact.entries.tobytes(), contact.row[inside].tobytes(), core.held
        begins, self._is_first = self._is_first, False
        if begins and not (self._matrix.structure is self._structure and _same(touched, self._begun)):
            self._matrix.forget()
            self._touched, self._begun = (), touched
        if not _same(touched, self._touched):
            self._touched = touched
            self._place_entries(inside)
        if begins:
            self._structure = self._matrix.structure

    def _place_entries(self, inside: Array) -> None:
        """Find where entries of the constraints stand; inside: bool [S, E], those that there are."""
        contact, core, size = self.owner.contact, self.owner.core, self._size
        k, m = inside.nonzero()
        unknown = size * contact.row[k, m][:, None] + np.arange(size)
        at = (8 * size * (k * contact.row.shape[1] + m))[:, None, None] + 8 * np.arange(size)[:, None] + np.arange(self._border)
        used = np.broadcast_to(self._unknowns[k][:, None], at.shape)
        row = np.broadcast_to(unknown[:, :, None], at.shape)[used]
        number = np.broadcast_to(self._number[k][:, None], at.shape)[used]
        self._entries = at[used]
        # several entries of a constraint may stand in one row, and cancel
        places, self._place = np.unique(row * self._number.size + number - self._nodes, return_inverse=True)
        self._rows, self._of = np.divmod(places, self._number.size)
        self._free = free_of_rows(core, core.held)[row]
        corner = np.broadcast_to(self._number[:, :, None], (*self._number.shape, self._border))
        pair = contact.pair
        slide, moments = self._number[pair[:, 0], self._dim], self._number[pair[:, 1]]
        slides = np.repeat(slide, self._border)
        force = self._number[self._of_force]
        self._matrix.place(
            np.concatenate((row, number, corner.reshape(-1), slides, moments.reshape(-1), force)),
            np.concatenate((number, row, corner.transpose(0, 2, 1).reshape(-1), moments.reshape(-1), slides, force)),
            lambda: self._reach(k, contact.row[k, m]))

    def _reach(self, k: Array, row: Array) -> Array:
        """Return keys of entries of sliders k [*], next to their rows, that they reach when they go on."""
        pattern, n, size = self.owner.core.pattern, self._matrix.n, self._size
        moves = k < self.owner.core.n_sliders
        k, row = k[moves], row[moves]
        first, end = pattern.rows.searchsorted(row), pattern.rows.searchsorted(row, "right")
        of = np.repeat(np.arange(row.size), end - first)
        near = pattern.columns[np.arange(of.size) + np.repeat(first - np.cumsum(end - first) + end - first, end - first)]
        unknown = (size * near[:, None, None] + np.arange(size)[:, None]).astype(np.int64)
        number = self._number[k[of]][:, None]
        return np.concatenate([(x * n + y).reshape(-1) for x, y in ((unknown, number), (number, unknown))])

    def solve(self) -> bool:
        """Solve for nodes and constraints; False where no acceptable solution was found."""
        owner, contact, work = self.owner, self.owner.contact, self.owner.work
        kernels.fill_right(*self.records)
        if not self.is_regular:
            return False
        self._look()
        column = self._free * contact.column.reshape(-1)[self._entries]
        line = contact.line.reshape(-1)[self._entries]
        stiff = np.abs(work.blocks[self._diagonal])
        stiff[stiff == 0.0] = np.inf
        # of the parts that a constraint joins, each unknown alone
        share = np.bincount(self._place, column) * np.bincount(self._place, line)
        of_each = np.bincount(self._of, np.abs(share) / stiff[self._rows], self._number.size)
        # and of sliders that have left their beams
        border, corner = self._border, contact.corner.reshape(-1, 8, 8)
        corner = corner[:, :border, :border]
        own = np.abs(np.diagonal(corner, axis1=1, axis2=2))
        compliance = np.max(np.where(self._of_force, of_each.reshape(own.shape) + own, 0.0), axis=1)
        self._loose = int(np.argmin(compliance)) if not np.all(compliance > contact.augmented[1]) else -1
        if self._loose >= 0:
            return True
        contact.compliance[:] = compliance
        soft = (contact.augmented[0] * contact.softness * compliance)[:, None]
        before = np.zeros(self._number.shape)
        before[self._of_force] = contact.augmented[2] * owner.core_state.force
        cross = contact.cross[:, :, :border]
        value = np.concatenate((column, line, corner.reshape(-1), cross[:, 0].reshape(-1), cross[:, 1].reshape(-1),
                                np.broadcast_to(soft, self._number.shape)[self._of_force]))
        right = np.concatenate((work.panel[:self._nodes], (contact.residual[:, :border] + soft * before).reshape(-1)))
        factors = Factors(self._matrix.filled(work.blocks, 1.0, value), owner.linear.factoriser, OF_STEP)
        x = factors.solve(-right)
        # without the augmented Lagrangian nothing decides between forces of dependent constraints
        if x is None or contact.augmented[0] == 0.0 and factors.is_singular:
            return False
        work.panel[:self._nodes], work.y[:] = x[:self._nodes], x[self._nodes:]
        left = np.abs(soft * (work.y.reshape(before.shape) + before))
        contact.remaining[:] = np.max(np.where(self._of_force, left, 0.0), axis=1)
        contact.augmented[2] = 0.0
        return True

    def update(self) -> float:
        return -1.0 - self._loose if self._loose >= 0 else super().update()
