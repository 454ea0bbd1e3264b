"""Wanted values of quantities at which a path of equilibria ends: places, section forces, places of sliders, functions of the
state (theory.md 12)."""
from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from fastbeam.interface.arguments import LARGEST, Function, Refusal, real, shown
from fastbeam.interface.errors import SceneError
from fastbeam.interface.synonyms import its_sliders, known
from fastbeam.kernels.state import State
from fastbeam.model.model import Model
from fastbeam.results.observe.observer import Observer
from fastbeam.scene.checks import Place

AXES, FORCES, MOMENTS = ("x", "y", "z"), ("N", "Q2", "Q3"), ("T", "M2", "M3")
WHAT = ("('tip', 'z') for a coordinate of one of points= or ('tip', 'N') for N, Q2, Q3, T, M2, M3 of a beam there, the name of a "
        "slider for its arc length, or a function of the state")


class Wanted(NamedTuple):
    """A quantity, a function of the state, and its value."""

    label: str
    of: Callable[[State], float]
    value: float
    section: Any = None    # where that is one of a beam

    def off(self, state: State) -> float:
        """Return the quantity less its value."""
        return self.of(state) - self.value


def wanted_of(model: Model, stop: Any, points: Mapping[str, Place] | None, who: str = "solve_path, stop") -> list[Wanted]:
    """Return the quantities and values that `stop=` of `solve_path`, or a similar argument, asks for; who: the function and the
    argument. Raises SceneError: it is no mapping of quantities to finite numbers, or a quantity does not exist."""
    if stop is None:
        return []
    if not isinstance(stop, Mapping) or not stop:
        raise SceneError(f"{who}: must be a mapping of quantities to wanted values, {{('tip', 'z'): -0.3}}, got {shown(stop)}")
    out = []
    for what, value in stop.items():
        number = real(value)
        if number is None or not abs(number) <= LARGEST:
            raise SceneError(f"{who}: the value of {shown(what)} must be a finite number, got {shown(value)}")
        label, of, section = _quantity(model, what, points or {}, who)
        out.append(Wanted(label, of, number, section))
    return out


def _quantity(model: Model, what: Any, points: Mapping[str, Place], who: str) -> tuple[str, Callable[[State], float], Any]:
    """Return name and function of a quantity, and its section. Raises SceneError."""
    if callable(what):
        name = getattr(what, "__name__", "function")
        try:
            Function("(state)")(what)
        except Refusal as refusal:
            raise SceneError(f"{who}: {name} {refusal}") from None
        return name, lambda state: _number(name, what(state)), None
    sliders = model.names["sliders"]
    if isinstance(what, str):
        if what not in sliders:
            raise SceneError(f"{who}: scene {model.scene_name!r} has no slider {what!r}; {its_sliders(sliders, what)}. "
                             f"Quantities are {WHAT}")
        number = sliders.index(what)
        return f"s of slider {what!r}", lambda state: float(state.s[number]), None
    if not (isinstance(what, tuple) and len(what) == 2 and all(isinstance(x, str) for x in what)):
        raise SceneError(f"{who}: {shown(what)} is not a quantity; use {WHAT}")
    name, part = what
    if name not in points:
        raise SceneError(f"{who}: {name!r} is not a name in points=, which has {known(points, name)}; give points={{{name!r}: "
                         "beam.end}")
    if part not in (*AXES, *FORCES, *MOMENTS):
        raise SceneError(f"{who}: {name!r} has no quantity {part!r}; choose x, y, z, N, Q2, Q3, T, M2 or M3")
    observer = Observer(model, () if part in AXES else ("section",), {name: points[name]})
    if part not in AXES and observer.points.sections[0] is None:
        raise SceneError(f"{who}: {name!r} lies on no beam and has no {part}")
    places = ("points", AXES), ("section_force", FORCES), ("section_moment", MOMENTS)
    series, names = next((series, names) for series, names in places if part in names)
    at = names.index(part)
    return f"{part} at {name!r}", lambda state: float(observer.row(0.0, state)[series][0, at]), (
        observer.points.sections[0] if observer.points.sections else None)


def _number(name: str, value: Any) -> float:
    number = real(value)
    if number is None or not np.isfinite(number):
        raise SceneError(f"solve_path, stop: {name} must return a finite number, got {shown(value)}")
    return number
