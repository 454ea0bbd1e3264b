"""The parts of a Newton iteration, called one by one where the loop around them runs in Python."""
from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from .kernels import step as kernels
from .kernels.inner import Inner
from .kernels.slider import Contact
from .kernels.work import State, Work
from .linsolve import LinearSystem
from .model import Model

Array = np.ndarray


class Owner(Protocol):
    """Who owns the state and the work arrays: a `newton.Stepper`."""

    core: Model
    kind: tuple[Any, Any, Any]
    core_state: State
    work: Work
    inner: Inner | None
    contact: Contact | None
    alpha: Any
    method: Any
    linear: LinearSystem


class Iteration:
    """Around SuperLU, on one thread."""

    def __init__(self, owner: Owner) -> None:
        self.owner = owner

    def keep(self) -> None:
        """Remember the state before a step."""
        kernels.keep_state(self.owner.alpha, self.owner.core_state, self.owner.work)

    def restore(self) -> None:
        """Go back to it."""
        kernels.restore_state(self.owner.alpha, self.owner.core_state, self.owner.work)

    def start(self, h: float) -> None:
        """First guess of a step of size h."""
        s, m = self.owner, self.owner.core
        kernels.start_step(*s.kind[:2], m.ties, m.curves, m.sliders, s.contact, m.spinless, s.core_state, s.work, h)

    def assemble(self, h: float) -> None:
        """Residual and tangent."""
        s, m = self.owner, self.owner.core
        kernels.assemble_step(*s.kind[:2], m.simo, m.green, s.inner, m.bodies, m.ties, m.held, m.curves, m.sliders, s.contact,
                              s.method.middle, s.alpha, m.pattern.row_of, s.core_state, s.work, h)

    def assemble_static(self) -> None:
        """The same in statics."""
        s, m = self.owner, self.owner.core
        kernels.assemble_static(*s.kind[:2], m.simo, m.green, s.inner, m.ties, m.static_held, s.core_state, s.work)

    def solve(self, static: bool = False) -> bool:
        """Solve for the nodes that the solver sees; False where no acceptable solution was found."""
        s, m = self.owner, self.owner.core
        held, contact = (m.static_held, None) if static else (m.held, s.contact)
        kernels.prepare_panel(*s.kind[:2], s.inner, m.ties, contact, held, m.width, s.work, m.size)
        return self.is_regular and self.solve_panel()

    @property
    def is_regular(self) -> bool:
        """Whether all eliminations before the solver went well."""
        return self.owner.inner is None or self.owner.inner.state[0] != 0.0

    def solve_panel(self) -> bool:
        """Solve the panel of right-hand sides with SuperLU."""
        model, work = self.owner.core, self.owner.work
        columns, size = model.columns, len(model.size)
        panel = work.panel.reshape(-1, model.width)[:size * model.pattern.n]
        blocks = work.blocks[:8 * size * model.pattern.keys.size].reshape(-1, size, 8)
        x = self.owner.linear.superlu.solve(blocks, np.ascontiguousarray(panel[:, :columns].T))
        if x is None:
            return False
        panel[:, :columns] = x.T
        return True

    def update(self) -> float:
        """Add the increments; their size relative to that of the scene, or -1 - k where slider k makes the border singular."""
        s, m = self.owner, self.owner.core
        return float(kernels.update_step(*s.kind[:2], m.simo, m.green, s.inner, m.ties, s.contact, s.alpha, m.pattern.row_of,
                                         s.core_state, s.work, m.width, m.length, m.size))

    def update_static(self) -> float:
        """The same in statics."""
        s, m = self.owner, self.owner.core
        return float(kernels.update_static(*s.kind[:2], m.simo, m.green, s.inner, m.ties, m.pattern.row_of, s.core_state,
                                           s.work, m.width, m.length, m.size))

    def finish(self, h: float) -> None:
        """Accept a converged step."""
        s = self.owner
        kernels.finish_step(*s.kind[:2], s.core.ties, s.alpha, s.core_state, s.work, h)
