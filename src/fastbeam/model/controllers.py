"""Controllers of a scene, and the numbers that a state keeps of them."""
from __future__ import annotations

from fastbeam.model.analyses import Analysis, Lack, without_adjoint
from fastbeam.model.feature import Array, Feature
from fastbeam.scene import Controller


class Controllers(Feature):
    """Controllers, which are asked at their own times.

    Parameters
    ----------
    parts : tuple of Controller
    """

    key, title, order = "control", "controllers", 200
    lacks = (Lack((Analysis.STEP_CONTROL,), "controllers", "{name}: step control does not know its times", "leave tolerance out",
                  lambda control, asked: [part.label for part in control.parts]),
             without_adjoint("controllers"))

    def __init__(self, parts: tuple[Controller, ...]) -> None:
        self.parts = parts

    @property
    def history_size(self) -> int:
        """Numbers of `State.history`."""
        return sum(part.size for part in self.parts)

    def start_history(self, own: Array, q: Array, v: Array) -> None:
        """Values at the start, how often each has been asked, and memories, into the numbers of the state."""
        own[:] = [x for part in self.parts for x in (part.start, 0.0, *part.memory)]  # type: ignore[misc]
