"""Newton's method and its parts, called one by one where the loop around them runs in Python."""
from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from fastbeam.kernels import loop as kernels
from fastbeam.kernels.call_tables import SystemRecord, Table
from fastbeam.kernels.contact.coulomb import cycles
from fastbeam.kernels.loop import BORDER_SINGULAR, CYCLES, NOT_CONVERGED, NOT_FINITE, OK, SINGULAR
from fastbeam.kernels.state import FALLBACK, MORE_ITERATIONS

if TYPE_CHECKING:
    from fastbeam.stepping.stepper import Stepper

Array = np.ndarray
# status of a step that was left before its end
LEFT = -1


def newton_loop(increment: Callable[[], tuple[int, float | None]], most: int, after: Callable[[list[float]], int],
                is_settled: Callable[[], bool] = lambda: True, largest: float = np.inf) -> tuple[int, list[float]]:
    """Iterate by Newton's method where its loop runs in Python, as `kernels.step.newton`.

    increment: solves the linearised equations and adds what it finds. Returns a status and the size of the increment, None where
        none was found; any status but OK ends the loop.
    most: largest number of iterations.
    after: called with the sizes so far after every iteration that does not end the loop; any status but OK ends it.
    is_settled: asked where increments are at round-off: whether the equations have not changed with the last one.
    largest: an increment beyond this, or NaN, ends it.

    Returns
    -------
    tuple
        Status, and sizes of the increments.
    """
    sizes: list[float] = []
    before = expected = np.inf
    for _ in range(most):
        status, size = increment()
        if size is not None:
            sizes.append(size)
        if status != OK or size is None:
            return status, sizes
        if not size < largest:
            return NOT_FINITE, sizes
        if kernels.has_converged(size, before, expected) and is_settled():
            return OK, sizes
        before, expected = size, kernels.next_increment(size, before)
        status = after(sizes)
        if status != OK:
            return status, sizes
    return NOT_CONVERGED, sizes


class Iteration:
    """Newton iteration around SuperLU, on one thread."""

    def __init__(self, owner: Stepper) -> None:
        self.owner = owner

    def hold(self) -> None:
        """Take over what supports hold after a change."""

    def keep(self) -> None:
        """Remember the state before a step."""
        kernels.keep_now(*self.owner.records)

    def restore(self) -> None:
        """Restore the state that `keep` remembered."""
        kernels.restore_kept(*self.owner.records)

    def start(self, h: float) -> None:
        """Form the first guess of a step of size h."""
        kernels.begin(*self.owner.records, h)

    def newton(self, h: float, max_iterations: int, largest: float, stop: Callable[[], Any]) -> tuple[int, list[float]]:
        """Iterate from the first guess; return (status, sizes of the increments), as `kernels.step.newton`.

        h: size of the step; 0 in statics.
        largest: an increment beyond this ends it.
        stop: asked after every iteration; true: LEFT.
        """
        owner = self.owner
        owner.linear.begin_step()

        def increment() -> tuple[int, float | None]:
            self.assemble(h)
            if not self.solve():
                finite = np.isfinite(owner.work.r).all() and np.isfinite(owner.work.dphi).all()
                return (SINGULAR if finite else NOT_FINITE), None
            size = self.update()
            return (BORDER_SINGULAR if size < 0.0 else OK), size

        def after(sizes: list[float]) -> int:
            if stop():
                return LEFT
            if cycles(owner.work.increment):
                return CYCLES
            # more only where signs of friction go in circles
            spent = len(sizes) == max_iterations and owner.work.increment.control[FALLBACK] == 0.0
            return NOT_CONVERGED if spent else OK

        return newton_loop(increment, MORE_ITERATIONS * max_iterations, after, lambda: bool(kernels.all_settled(*owner.records)),
                           largest)

    def assemble(self, h: float) -> None:
        """Assemble residual and tangent."""
        kernels.assemble_all(*self.owner.records, h)

    def solve(self) -> bool:
        """Solve for the nodes that the solver sees; False where no acceptable solution was found."""
        kernels.fill_right(*self.records)
        return self.is_regular and self.solve_panel()

    @property
    def records(self) -> tuple[Table, SystemRecord]:
        """Terms and system, as the panel of right-hand sides needs them."""
        return self.owner.records

    @property
    def is_regular(self) -> bool:
        """True where all eliminations before the solver succeeded."""
        return bool(kernels.all_regular(*self.owner.records))

    def solve_panel(self) -> bool:
        """Solve the panel of right-hand sides with SuperLU."""
        model, work = self.owner.core, self.owner.work
        columns, size = model.columns, len(model.dofs)
        panel = work.panel.reshape(-1, model.width)[:size * model.pattern.n]
        x = self.owner.linear.superlu.solve(model.blocks_in(work.blocks), np.ascontiguousarray(panel[:, :columns].T))
        if x is None:
            return False
        panel[:, :columns] = x.T
        return True

    def update(self) -> float:
        """Add the increments; return their size relative to that of the scene, or -1 - k where slider k makes the border
        singular."""
        return float(kernels.update(*self.owner.records))

    def finish(self, h: float) -> None:
        """Accept a converged step."""
        kernels.finish(*self.owner.records, h)
