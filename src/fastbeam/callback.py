"""The user's function of time and state: it sees a copy, and whether it changes loads is watched."""
from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .arguments import shown
from .errors import SceneError
from .kernels.work import State
from .model import Model

Array = np.ndarray


class Callback:
    """Calls a function of (t, state) at rows.

    Parameters
    ----------
    model : Model
    function : callable
        Of the time in s and a State in space that nothing can be written to; True ends the run.
    t_end : float
        Time functions of loads are not asked for later than that.

    Attributes
    ----------
    found : str
        What a call changed that it must not, empty where nothing. A load that the function sets acts one step too late: its value
        in the step that led here was another than the one that belongs to the state here.
    """

    def __init__(self, model: Model, function: Callable[[float, State], bool | None], t_end: float) -> None:
        self.function, self.t_end = function, t_end
        self.timed = [(name, time) for name, time in zip(model.load_names, model.load_times) if time is not None]
        self.found = ""

    def __call__(self, t: float, size: float, state: State) -> bool:
        """Whether the run ends at time t, after a step of this size; state: a copy of the present one.

        Raises
        ------
        SceneError
            The function returned something else than True, False or None.
        """
        for x in state:
            x.flags.writeable = False
        times = (t, min(t + 0.5 * size, self.t_end))
        before = self._values(times)
        answer = self.function(t, state)
        if not (answer is None or isinstance(answer, (bool, np.bool_))):
            raise SceneError(f"callback: must return True where the run is to end, else False or None, got {shown(answer)} at "
                             f"t = {t:.6g} s")
        after = self._values(times)
        if after != before and not self.found:
            k = next(k for k, (x, y) in enumerate(zip(before, after)) if x != y)
            name, at = self.timed[k // 2][0], times[k % 2]
            if self._values(times) == after:
                self.found = (f"the callback at t = {t:.6g} s changed {name}: its time function gave {before[k]} at t = {at:.6g} "
                              f"s before the call and {after[k]} after it")
            else:
                self.found = f"{name}: its time function gives different values at the same time, t = {at:.6g} s"
        return bool(answer)

    def _values(self, times: tuple[float, float]) -> list[str]:
        """Of all time functions; as texts, so that NaN is equal to itself."""
        return [repr(time(t)) for _, time in self.timed for t in times]
