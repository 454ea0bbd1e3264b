"""Reactions of supports and joints in an equilibrium."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fastbeam.dynamics.reactions import Reactions
from fastbeam.kernels.state import State
from fastbeam.results.observe.observer import Observer
from fastbeam.results.observe.resultants import Sections
from fastbeam.statics.equilibrium import StaticSolver

Array = np.ndarray


class StaticReactions:
    """Reactions of the equilibria of a solver."""

    def __init__(self, solver: StaticSolver, sections: Sequence[Sections | None] = ()) -> None:
        self.main = solver
        self.solver = solver if solver.stepper.pivots_everywhere else solver.fallback
        self.reactions = Reactions(self.solver.stepper, static=True, sections=sections)

    def at(self, factors: Array, state: State) -> Array:
        """Return reactions at the last equilibrium, that of load factors [K], whose state in space is given: [6 (R + C)]."""
        self.solver.set_time(*self.main.stepper.law_work[:2])
        self.solver.load_all(factors)
        q, steady = state.q.reshape(-1, 4, 3), getattr(self.solver, "steady", None)
        second = None if steady is None else steady.rates(q)
        found = self.reactions.of_equilibrium(q, factors, second)
        if steady is not None and second is None:
            # forces of inertia act on nodes of beams that travel, and nothing tells their shares on both sides of a section
            found[6 * self.reactions.count:] = np.nan
        return found


def reactions_of(solver: StaticSolver, observer: Observer) -> StaticReactions | None:
    """Return the reactions of a solver that rows hold; None where they hold none."""
    return StaticReactions(solver, observer.points.balanced) if observer.reactions or observer.cut else None
