"""The parts of a Newton iteration, called and timed one by one: elements, their assembly, the elimination of blocks.

Kernels are called from Python; the time of the same call on nothing is subtracted. Calls are short, so the clock on the wall
counts, the smallest of many repetitions.
"""
from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from perf.limits.ceilings import clock
from perf.places import private

element_groups, evaluate_groups = private("kernels.beam", "element_groups", "evaluate_groups")
OneSide, back_substitute, factor = private("kernels.chain", "OneSide", "back_substitute", "factor")
NoInner = private("kernels.inner", "NoInner")
OverStep = private("kernels.motions", "OverStep")
apply_held = private("kernels.nodes", "apply_held")
SIMO_REISSNER = private("kernels.strain_sets", "SIMO_REISSNER")
Conserving = private("kernels.terms", "Conserving")
Stepper = private("newton", "Stepper")

Array = np.ndarray


def shortest(work: Callable[[], Any], seconds: float, prepare: Callable[[], Any] | None = None,
             empty: Callable[[], Any] | None = None, least: int = 5) -> float:
    """Smallest time of one call, s, of as many as `seconds` allow, each after `prepare`; less the smallest time of `empty`, a
    call on nothing, which runs in turn with it."""
    found, nothing, k = np.inf, np.inf if empty else 0.0, 0
    end = time.perf_counter() + seconds
    while k < least or time.perf_counter() < end:
        if prepare is not None:
            prepare()
        if empty is not None:
            begin = time.perf_counter()
            empty()
            nothing = min(nothing, time.perf_counter() - begin)
        begin = time.perf_counter()
        work()
        found = min(found, time.perf_counter() - begin)
        k += 1
    return max(found - nothing, 0.0)


def iteration(stepper: Stepper, step: float, seconds: float, threads: int = 1) -> tuple[float, float, Any]:
    """(time of one Newton iteration of a run on so many threads, s; iterations a step; outcome). Every repetition begins with the
    present state, and takes so many steps that about fifty of them, five at least, fit into the time.

    Raises
    ------
    SystemExit
        A step fails.
    """
    now = clock(threads)
    start = stepper.copy_state()
    steps, found, runs = 1, np.inf, 0
    end = time.perf_counter() + seconds
    while runs < 5 or time.perf_counter() < end:
        stepper.set_state(start)
        begin = now()
        outcome = stepper.advance(0.0, step, steps)
        spent = now() - begin
        if outcome.steps != steps:
            raise SystemExit(f"the run stopped with status {outcome.status}: nothing was measured")
        if spent < 0.02 * seconds and steps < 256:
            steps *= 2
        else:
            found, runs = min(found, spent / outcome.iterations), runs + 1
    return found, outcome.iterations / outcome.steps, outcome


class ChainParts:
    """Elements and elimination of a model in space that is solved by block elimination, after some steps of a run.

    Parameters
    ----------
    model : Model
    step : float
        Size of a step, s.
    mixed : bool
        Whether the tangent takes other stresses than the present ones (theory.md (4.6)).
    """

    def __init__(self, model: Any, step: float, mixed: bool = True) -> None:
        self.model, self.stepper = model, Stepper(model, np.ones(1))
        self.stepper.advance(0.0, step, 3)
        self.work, self.step, self.rate = self.stepper.work, step, 2.0 / step**2
        self.work.increment.control[0] = float(mixed)
        self.groups = len(model.simo.meta)
        self.n = len(model.dofs)
        self.nothing = model.pattern.plan._replace(diagonal=model.pattern.plan.diagonal[:0])
        self.fill()
        self.blocks, self.panel = self.work.blocks.copy(), self.work.panel.copy()

    def evaluate(self, groups: int | None = None, assembled: bool = True) -> None:
        """Residual and tangent of so many groups of elements (default: all), added up or left in scratch."""
        w, m = self.work, self.model
        state, groups = self.stepper.core_state, self.groups if groups is None else groups
        motion = OverStep(Conserving(), state.q, w.dphi, state.v, w.increment, w.reference_strains, self.step, self.rate)
        if assembled:
            inner = NoInner() if self.stepper.inner is None else self.stepper.inner
            element_groups(m.simo, 0, groups, inner, SIMO_REISSNER, motion, w.r, w.blocks, w.scratch, m.dofs)
        else:
            evaluate_groups(m.simo, 0, groups, SIMO_REISSNER, motion, w.scratch, m.dofs)

    def fill(self) -> None:
        """Blocks and right-hand sides of the iteration."""
        w, m = self.work, self.model
        w.blocks[:] = 0.0
        w.r[:] = -w.f_ext
        self.evaluate()
        if m.held is not None:
            apply_held(m.held, w.r, w.blocks, m.dofs)
        w.panel[:] = 0.0
        w.panel.reshape(-1, m.width)[:, 0] = w.r.reshape(-1, 8)[:m.panel_rows, :self.n].reshape(-1)

    def matrix(self) -> Array:
        """The blocks of the matrix [blocks, n, n]."""
        m = self.model
        return self.blocks[:8 * self.n * m.pattern.keys.size].reshape(-1, self.n, 8)[:, :, :self.n]

    def right(self) -> Array:
        """The right-hand side of the nodes that the elimination sees, [n rows]."""
        return self.panel.reshape(-1, self.model.width)[:self.n * self.model.pattern.n, 0].copy()

    def restore(self) -> None:
        """Matrix and right-hand side as they were assembled."""
        self.work.blocks[:] = self.blocks
        self.work.panel[:] = self.panel

    def factor(self, plan: Any = None) -> None:
        """Factors, and the elimination of the right-hand side."""
        w, m = self.work, self.model
        if not factor(plan or m.pattern.plan, w.blocks, w.pivots, OneSide(w.panel), m.dofs) > 0.0:
            raise SystemExit("the matrix is singular: nothing was measured")

    def back(self, plan: Any = None) -> None:
        """Back substitution."""
        back_substitute(plan or self.model.pattern.plan, self.work.blocks, OneSide(self.work.panel), self.model.dofs)

    def solution(self) -> Array:
        """Solution of the matrix for `right`."""
        self.restore()
        self.factor()
        self.back()
        return self.work.panel.reshape(-1, self.model.width)[:self.n * self.model.pattern.n, 0].copy()

    def element_time(self, seconds: float, assembled: bool = True) -> float:
        """Of `evaluate`, s."""
        return shortest(lambda: self.evaluate(assembled=assembled), seconds, empty=lambda: self.evaluate(0, assembled))

    def elimination_time(self, seconds: float) -> float:
        """Of `factor` and `back`, s."""
        def both() -> None:
            self.factor()
            self.back()

        def neither() -> None:
            self.factor(self.nothing)
            self.back(self.nothing)

        return shortest(both, seconds, self.restore, neither)
