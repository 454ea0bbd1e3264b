"""The user's function of time and state: it sees a copy; changes that it makes to functions of time are detected."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from fastbeam.interface.arguments import shown
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.state import State
from fastbeam.model.model import Model

Array = np.ndarray


def time_functions(model: Model) -> list[tuple[str, Callable[[float], Any]]]:
    """List all functions of time alone that steps evaluate: what they belong to, and the function. Compiled laws are not among
    them, whose numbers are fixed when they are compiled."""
    out: list[tuple[str, Any]] = list(zip(model.load_names, model.load_times))

    def add(who: str, of: Any, *names: str) -> None:
        out.extend((f"{who} ({name})", getattr(of, name)) for name in names)

    for slider in () if model.slider_forces is None else model.slider_forces.sliders:
        if slider.drive is not None and not slider.drive.takes_state:
            add(f"the drive of slider {slider.name!r}", slider.drive, "position", "speed", "force")
    for part in () if model.motions is None else model.motions.holds.parts:
        out.extend((f"the prescribed value of {part.label}", x) for x in (part.motor, part.place, part.speed))
        if part.drive is not None and not part.drive.takes_state:
            add(f"the drive of {part.label}", part.drive, "position", "speed", "force")
    if model.dragged is not None:
        out.extend(zip((f"the air of {label}" for label in model.dragged.labels), model.dragged.times))
    for motion in () if model.prescribed is None else model.prescribed.motions:
        add(motion.label, motion, "displacement", "position", "rotation")
    return [(name, time) for name, time in out if callable(time)]


def given_places(model: Model) -> list[tuple[str, Any]]:
    """List prescribed places of sliders, joints and supports: what they belong to, and a function of time, a number or None."""
    out: list[tuple[str, Any]] = []
    for slider in () if model.slider_forces is None else model.slider_forces.sliders:
        if slider.drive is not None and slider.drive.is_prescribed:
            out.append((f"the drive of slider {slider.name!r} (position)", slider.drive.position))
    for part in () if model.motions is None else model.motions.holds.parts:
        out.append((f"the prescribed value of {part.label}", part.place))
    for motion in () if model.prescribed is None else model.prescribed.motions:
        out += [(f"{motion.label} ({name})", getattr(motion, name)) for name in ("displacement", "position", "rotation")]
    scene = getattr(model.uneliminated, "scene", None)
    return out + [(f"{winch.label} (length_at)", winch.length_at) for winch in (() if scene is None else scene.winches)]


class Callback:
    """Caller of a function of (t, state) at rows.

    function: called with the time, s, and a read-only State in space; True ends the run.
    t_end: time functions are not asked for later than that.
    found: message about a forbidden change, empty where there was none. Loads, motors, drives and motions of supports that the
        function sets act one step too late: the step that led here used another value than the one that belongs to this state.
    """

    def __init__(self, model: Model, function: Callable[[float, State], bool | None], t_end: float) -> None:
        self.function, self.t_end = function, t_end
        self.timed = time_functions(model)
        self.found = ""

    def __call__(self, t: float, size: float, state: State) -> bool:
        """Call the function; return whether the run ends at time t, after a step of this size. state: a copy of the present one.
        Raises SceneError: the function returned something else than True, False or None."""
        for x in state:
            x.flags.writeable = False
        times = (t, min(t + 0.5 * size, self.t_end))
        before = self._values(times)
        answer = self.function(t, state)
        if not (answer is None or isinstance(answer, (bool, np.bool_))):
            raise SceneError(f"callback: must return True to end the run, else False or None, got {shown(answer)} at t = {t:.6g} "
                             "s")
        after = self._values(times)
        if after != before and not self.found:
            k = next(k for k, (x, y) in enumerate(zip(before, after)) if x != y)
            name, at = self.timed[k // 2][0], times[k % 2]
            if self._values(times) == after:
                self.found = (f"the callback at t = {t:.6g} s changed {name}: its time function returned {before[k]} at t = "
                              f"{at:.6g} s before the call, and {after[k]} after it")
            else:
                self.found = f"{name}: its time function returns different values at the same time, t = {at:.6g} s"
        return bool(answer)

    def _values(self, times: tuple[float, float]) -> list[str]:
        """Return the values of all time functions at these times, as texts, so that NaN is equal to itself."""
        return [_value(time, t) for _, time in self.timed for t in times]


def _value(time: Callable[[float], Any], t: float) -> str:
    """Return the value of a time function as a text, or the exception that it raises: steps that evaluate it name its owner."""
    try:
        found = time(t)
    except Exception as failed:
        return f"{type(failed).__name__}: {failed}"
    return repr(found.item() if isinstance(found, np.generic) else found)
