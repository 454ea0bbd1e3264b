"""Failures of user laws in compiled code, which returns NaN and records the arguments of the law that failed."""
from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

from fastbeam.interface.arguments import shown
from fastbeam.interface.errors import SceneError
from fastbeam.kernels.contact.slider import Sliding
from fastbeam.kernels.contact.slider_forces import ASKED_FAILED, Along
from fastbeam.kernels.forces.drag import Drag, Wind
from fastbeam.kernels.forces.planar_follower import PlanarFollowers
from fastbeam.kernels.forces.user_force import FAILED, SIZE, UserForces
from fastbeam.kernels.joints.drives import JointControl

Array = np.ndarray
NUMBERS = ctypes.POINTER(ctypes.c_double)
LAW = ctypes.CFUNCTYPE(None, ctypes.c_double, *[NUMBERS] * 4)


class Asked(NamedTuple):
    """Label of a part, arguments of its functions, and their calls: (name, call, array that it writes into, or None)."""

    label: str
    arguments: dict[str, Any]
    calls: list[tuple[str, Callable[[], Any], Array | None]]


class Lawful(NamedTuple):
    """Parts of a scene whose laws one table calls: the part of every row, text for the place of a row, and the functions of a
    part with a time, its arguments and its parameters."""

    parts: list[Any]
    of: Array
    places: Callable[[int], str]
    asked: Callable[[Any, float, Array, Array], Asked]


class Failure(NamedTuple):
    """Text of a failure, the rest of a sentence, and the exception in Python; empty without a failure."""

    text: str
    error: Exception | None = None


NOTHING = Failure("")
# advice behind the text of a failure
FINITE_NUMBERS = ". It must return finite numbers there."
# names of the results of functions
WORDS = {"law": "force", "wind": "velocity"}
# number of laws at a node that a message names
SHOWN = 2
UNSEEN = "fails in compiled code, though not in Python, for example by a division by zero,"


def forget(terms: Iterable[Any], work: Array) -> None:
    """Clear failures before an attempt."""
    work[FAILED] = 0.0
    for asked in _drives(terms):
        asked[:, ASKED_FAILED] = 0.0


def has_failed(terms: Iterable[Any], work: Array) -> bool:
    """Return whether a law has failed since failures were cleared."""
    return work[FAILED] != 0.0 or any(asked[:, ASKED_FAILED].any() for asked in _drives(terms))


def _drives(terms: Iterable[Any]) -> list[Array]:
    found = []
    for term in terms:
        own = term.along if isinstance(term, Sliding) else term
        if isinstance(own, (Along, JointControl)):
            found.append(own.asked)
    return found


def failure_in(model: Any, terms: Iterable[Any], work: Array) -> Failure:
    """Describe the first failure of a law; model: that of the terms; work: work array of laws."""
    address = int(work[FAILED])
    for term in terms:
        if isinstance(term, Sliding) and isinstance(term.along, Along):
            for k in np.flatnonzero(term.along.asked[:, ASKED_FAILED])[:1].tolist():
                slider = model.slider_forces.sliders[k]
                return _of_drive(f"slider {slider.name!r}", slider.drive, term.along.asked[k])
        if isinstance(term, JointControl):
            for i in np.flatnonzero(term.asked[:, ASKED_FAILED])[:1].tolist():
                part = model.motions.holds.pushed(i)
                return _of_drive(part.label, part.drive, term.asked[i])
        kind, table = _table(term)
        if address == 0 or kind not in model.laws:
            continue
        rows = np.flatnonzero(table.first == (address - table.parameters.ctypes.data) // 8)
        if rows.size:
            return failure_of(model.laws[kind], table, rows, float(work[FAILED + 1]), work[FAILED + 2:])
    return NOTHING


def _table(term: Any) -> tuple[type, Any]:
    """Return the kind under which a model finds the parts of a term, and its table of laws."""
    table = term.wind if isinstance(term, Drag) and isinstance(term.wind, Wind) else term
    return UserForces if isinstance(table, PlanarFollowers) else type(table), table


def acting_at(model: Any, terms: Iterable[Any], node: int) -> str:
    """Return the names of laws that act on the equations of a node, for a message that names it; empty where there are none."""
    row, ties = model.pattern.row_of[node], model.ties
    there = model.pattern.row_of == row
    if ties is not None:
        # forces on a slave node stand in the equations of its master nodes
        there[np.repeat(np.arange(there.size), np.diff(ties.start))[ties.target_row == row]] = True
    names = {}
    for term in terms:
        kind, table = _table(term)
        laws = model.laws.get(kind)
        if laws is None:
            continue
        for k in np.flatnonzero(there[term.node].reshape(len(term.node), -1).any(axis=1)).tolist():
            asked = laws.asked(laws.parts[laws.of[k]], 0.0, np.zeros(18), table.parameters[table.first[k]:])
            # time functions of follower loads are no laws
            if asked.calls[0][0] in WORDS:
                names[asked.label] = None
    if not names:
        return ""
    several = len(names) > 1
    return f", where the law{'s' * several} of {' and '.join(list(names)[:SHOWN])} act{'s' * (not several)}"


def _of_drive(who: str, drive: Any, asked: Array) -> Failure:
    t, s, rate = asked[ASKED_FAILED + 1:ASKED_FAILED + 4].tolist()
    how, error = _again(lambda: drive.force(t, s, rate), None, "force")
    return Failure(f"{who}: force(t, s, rate) of its drive {how} at t = {t:.6g} s, s = {s:.6g}, rate = {rate:.6g}", error)


def failure_of(laws: Lawful, table: Any, rows: Array, t: float, given: Array) -> Failure:
    """Describe the failure of a law at time t; rows: rows of the table that it may be; given: its arguments."""
    label, arguments, calls = laws.asked(laws.parts[laws.of[rows[0]]], t, given, table.parameters[table.first[rows[0]]:])
    for noun, call, out in calls:
        how, error = _again(call, out, WORDS.get(noun, "number"))
        if error is not None or how != UNSEEN:
            break
    place = f", {laws.places(int(rows[0]))}" if rows.size == 1 else ""
    where = "".join(f", {name} = {shown(x)}" for name, x in arguments.items())
    return Failure(f"{label}: its {noun} {how} at t = {t:.6g} s{place}{where}", error)


def _again(call: Callable[[], Any], out: Array | None, word: str) -> tuple[str, Exception | None]:
    """Call a function again in Python, and describe its failure, with the exception; out: array that it writes into, None where
    it returns numbers; word: name of these numbers."""
    try:
        with np.errstate(all="ignore"):
            returned = call()
        if out is None and returned is None:
            return "returns nothing", None
        found = np.asarray(returned if out is None else out, dtype=float)
    except Exception as failed:
        return f"fails, {type(failed).__name__}: {str(failed)[:200]},", failed
    return (UNSEEN if np.isfinite(found).all() else f"returns {shown(found)}, which is not a finite {word},"), None


def ask(model: Any, table: Any, k: int, t: float, given: Array, found: int) -> Array:
    """Evaluate the law of row k of a table at time t, float64 [found]; given: its arguments. Raises SceneError: the law fails."""
    given, out, failed = np.append(given, np.zeros(18 - len(given))), np.zeros(found), np.zeros(SIZE - FAILED)
    parameters = table.parameters[table.first[k]:]
    LAW(int(table.laws.address[k]))(t, *(x.ctypes.data_as(NUMBERS) for x in (given, parameters, out, failed)))
    if failed[0]:
        said = failure_of(model.laws[type(table)], table, np.flatnonzero(table.first == table.first[k]), t, given)
        raise SceneError(said.text) from said.error
    return out
