"""Controllers of a scene, and their history variables."""
from __future__ import annotations

from fastbeam.model.analyses import Analysis, Lack, without_adjoint
from fastbeam.model.feature import Array, Feature
from fastbeam.scene import Controller


class Controllers(Feature):
    """Controllers, which are called at their own times."""

    key, title, order = "control", "controllers", 200
    lacks = (Lack((Analysis.STEP_CONTROL,), "controllers", "{name}: step control does not support its sampling "
                                                           "times", "leave tolerance out",
                  lambda control, asked: [part.label for part in control.parts]),
             without_adjoint("controllers"))

    def __init__(self, parts: tuple[Controller, ...]) -> None:
        self.parts = parts

    @property
    def history_size(self) -> int:
        """Number of history variables of all controllers."""
        return sum(part.size for part in self.parts)

    def start_history(self, own: Array, q: Array, v: Array) -> None:
        """Put the values at the start, the number of calls so far, 0, and the memories into `own`."""
        own[:] = [x for part in self.parts for x in (part.start, 0.0, *part.memory)]  # type: ignore[misc]
