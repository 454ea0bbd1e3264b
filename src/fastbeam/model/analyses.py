"""Analyses of a model, their limits with its features, and alternatives."""
from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from enum import Enum
from typing import Any, NamedTuple

import numpy as np

from fastbeam.interface.errors import SceneError

Array = np.ndarray
# largest number of names that a message shows
MOST_NAMES = 3


class Analysis(Enum):
    """Analysis of a model; the value is how a user writes it."""

    PLANAR = "compile_scene(planar=True)"
    COMPARED = "simulate(method=...)"
    ORDER_4 = "simulate(order=4)"
    COMPOSED = "simulate(order=4) in one run"
    FILTERED = "simulate(method=Method(rho_inf=...))"
    STEP_CONTROL = "simulate(tolerance=...)"
    BLOWS = "rigid stops, locks, supports with since="
    MASSES = "impacts, Start(mend=True)"
    PROJECTION = "Scene(project_velocities=True)"
    CATCHING = "since= of supports"
    INNER = "observe=('inner',)"
    GRAVITY_IN_TIME = "Scene(gravity_time=...)"
    STATIC = "solve_static"
    EXACT = "solve_static(contacts='exact')"
    RELAX = "relax"
    PATH = "solve_path, critical_loads"
    LENGTHS = "find_lengths"
    STICK = "stick_interval"
    TIMELESS_LOADS = "any equilibrium without at_time="
    TIMELESS = "solve_static, stick_interval without at_time="
    TIMELESS_SHAPES = "relax, solve_path, critical_loads, sensitivity without at_time="
    TIMELESS_MODES = "modes, frequency_response without at_time="
    AT_TIME = "equilibria with at_time="
    TIME_SPAN = "equilibria with at_time=(first, last)"
    TWO_TIMES = "solve_path(at_time=(first, last))"
    BUCKLING = "critical_loads"
    MODES = "modes, frequency_response"
    DAMPED = "modes(damped=True), frequency_response"
    LOSS_FACTOR = "frequency_response(loss_factor=...)"
    STEADY = "steady=Spin or Travel"
    TRAVEL = "modes(steady=Travel(...))"
    SENSITIVITY = "sensitivity, critical_sensitivity"
    ADJOINT = "adjoint_run"


# analyses of states at rest
AT_REST = (Analysis.STATIC, Analysis.EXACT, Analysis.RELAX, Analysis.PATH, Analysis.LENGTHS, Analysis.STICK, Analysis.MODES,
           Analysis.SENSITIVITY)


class Asked(NamedTuple):
    """Context of a check of features: the model, the caller, and sliders that are locked, bool [S]."""

    model: Any
    who: str
    held: Array


class Lack(NamedTuple):
    """Limit of some analyses with a feature, and an alternative."""

    analyses: tuple[Analysis, ...]
    what: str  # name of the unsupported part of the feature in a table: 'friction'
    text: str  # text of a message; {who} is the call, {names} are the first parts concerned, {name} is the first of them
    instead: str  # alternative in the message, with the same words in braces
    # returns the names of the parts concerned from the feature and an `Asked`; without any, the analysis is possible
    names: Callable[[Any, Asked], Iterable[str]]


def always(*names: str) -> Callable[[Any, Asked], Iterable[str]]:
    """Return a function that names a feature as concerned in every model."""
    return lambda feature, asked: names


def unknown_to_methods(what: str, names: Callable[[Any, Asked], Iterable[str]] | None = None) -> Lack:
    """Declare that only the conserving step supports a feature."""
    return Lack((Analysis.COMPARED,), what, "{who} does not support {names}", "use the default method", names or always(what))


def timed_loads(names: Callable[[Any, Asked], Iterable[str]]) -> Lack:
    """Declare that equilibria need a time."""
    return Lack((Analysis.TIMELESS_LOADS,), "functions of time", "{who}: loads have time functions, so a time is needed",
                "give the time with at_time=t", names)


def without_adjoint(what: str, names: Callable[[Any, Asked], Iterable[str]] | None = None) -> Lack:
    """Declare that steps with a feature have no adjoint."""
    return Lack((Analysis.ADJOINT,), what, "{who}: the adjoint does not support {names}", "use differences of runs",
                names or always(what))


def dissipating(what: str, names: Callable[[Any, Asked], Iterable[str]], *, kinked: bool = False) -> Lack:
    """Declare that steps backward in time would put energy in; kinked: two runs cannot be extrapolated either."""
    return Lack((Analysis.ORDER_4 if kinked else Analysis.COMPOSED,), what,
                "order=4 contains a step backward in time, in which {names} would add energy. Friction, impacts and locks also "
                "have kinks in time, which the extrapolation from two runs does not allow", "use order=2", names)


def told(analysis: Analysis, features: Iterable[Any], asked: Asked | None = None) -> Iterator[tuple[Lack, list[str]]]:
    """Yield the limits of an analysis with some features, and the names of the parts concerned."""
    given = Asked(None, "", np.zeros(0, bool)) if asked is None else asked
    for feature in sorted(features, key=lambda x: not x.is_told_first):
        for lack in feature.lacks:
            names = list(lack.names(feature, given)) if analysis in lack.analyses else []
            if names:
                yield lack, names


def lacking(analysis: Analysis, model: Any, who: str = "", held: Array | None = None) -> Iterator[tuple[Lack, list[str]]]:
    """Yield the limits of an analysis with a model, as `told`."""
    return told(analysis, model.features, Asked(model, who, np.zeros(model.n_sliders, bool) if held is None else held))


def require(analysis: Analysis, model: Any, who: str | None = None, held: Array | None = None) -> None:
    """Check that an analysis supports all features of a model.

    who: name of the analysis in messages; default: as the user writes it.
    held: bool [S], sliders that are locked, whose forces along their beams do not count.
    Raises SceneError: names the parts concerned and the alternative.
    """
    name = analysis.value if who is None else who
    refuse(list(lacking(analysis, model, name, held)), name)


def refuse(found: list[tuple[Lack, list[str]]], name: str) -> None:
    """Raise an error for the first limit, if there is any; found: as from `told`; name: of the call. Raises SceneError: the first
    limit, with the names of all limits of the same text."""
    if found:
        lack = found[0][0]
        names = [x for other, own in found if (other.text, other.instead) == (lack.text, lack.instead) for x in own]
        words = {"who": name, "name": names[0], "names": ", ".join(names[:MOST_NAMES])}
        raise SceneError(f"{lack.text}; {lack.instead}".format(**words))
