"""User functions as machine code that kernels call by its address.

Compiled code cannot be left by an exception. A law that raises, reads beyond an array, returns nothing where a number is due or
finds no finite numbers therefore gives NaN, with which a step fails, and records its arguments in `failed`
(kernels/forces/user_force.FAILED) for a message (user_forces.py).
"""
from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from numba import carray, types

from fastbeam.interface.errors import SceneError
from fastbeam.kernels.jit.decorators import around_user, of_user, with_address

NUMBER, ARRAY, MATRIX = types.float64, types.Array(types.float64, 1, "C"), types.Array(types.float64, 2, "C")
# number of arguments of a law of a node: position, directors, velocity and spin
GIVEN = 18


class WrongForm(TypeError):
    """Wrong return value of a function: the rest of a sentence about it."""


def _writing(law: Callable[..., None], arguments: tuple[Any, ...], into: str) -> Any:
    """Compile a function that writes into arrays. Raises WrongForm: the function returns a value, which would be ignored."""
    compiled = of_user(law)
    compiled.compile(arguments)
    if compiled.nopython_signatures[-1].return_type != types.none:
        raise WrongForm(f"returns something, which would be ignored; let it write into {into}, as in {into.split()[0]}[:] = ..., "
                        "and return nothing")
    return compiled


def _returning(law: Callable[..., Any], arguments: tuple[Any, ...], what: str) -> Any:
    """Compile a function that returns numbers. Raises WrongForm: the function returns nothing."""
    compiled = of_user(law)
    compiled.compile(arguments)
    if compiled.nopython_signatures[-1].return_type == types.none:
        raise WrongForm(f"returns nothing; it must return {what}")
    return compiled


def _guarded(ask: Any, given: int, n: int, found: int, at: int = 0) -> Any:
    """Compile a guard around a compiled function (t, given, parameters, found) of arrays of these sizes; on failure it records
    the numbers from `at` on in `given`, GIVEN at most."""
    count = min(given - at, GIVEN)

    def entry(t: Any, given_at: Any, parameters_at: Any, found_at: Any, failed_at: Any) -> None:
        x, p, y = carray(given_at, (given,)), carray(parameters_at, (n,)), carray(found_at, (found,))
        total = math.nan
        try:
            ask(t, x, p, y)
            total = 0.0
            for i in range(found):
                total += y[i]
        except Exception:
            total = math.nan
        if not math.isfinite(total):
            failed = carray(failed_at, (2 + count,))
            if failed[0] == 0.0:
                failed[0], failed[1] = p.ctypes.data, t
                for i in range(count):
                    failed[2 + i] = x[at + i]
            for i in range(found):
                y[i] = math.nan
    return with_address(entry)


def _factor(time: Callable[[float], float]) -> Any:
    """Compile a function of time; NaN where it returns nothing."""
    factor = _returning(time, (NUMBER,), "a number")

    def known(t: Any) -> Any:
        share, value = factor(t), math.nan
        if share is not None:
            value = share
        return value
    return around_user(known)


def _timed(law: Callable[..., None], time: Callable[[float], float] | None) -> Any:
    """Compile a law of a user force, times a function of time where there is one."""
    steady = _writing(law, (NUMBER, ARRAY, MATRIX, *[ARRAY] * 5), "force and moment")
    if time is None:
        return steady
    factor = _factor(time)

    def timed(t: Any, x: Any, directors: Any, velocity: Any, spin: Any, parameters: Any, force: Any, moment: Any) -> None:
        steady(t, x, directors, velocity, spin, parameters, force, moment)
        share = factor(t)
        for i in range(3):
            force[i] *= share
            moment[i] *= share
    return around_user(timed)


def compiled_force(law: Callable[..., None], n: int, time: Callable[[float], float] | None = None) -> tuple[Any, Any]:
    """Compile a law of a user force with n parameters, times a function of time: machine code that kernels call by its
    `.address`, and the law for Python; the code lives as long as these objects. Raises WrongForm: the law returns a value, or the
    function of time none; the functions below raise it, too."""
    inner = _timed(law, time)

    def ask(t: Any, x: Any, p: Any, y: Any) -> None:
        inner(t, x[:3], x[3:12].reshape((3, 3)), x[12:15], x[15:18], p, y[:3], y[3:6])
    return _guarded(around_user(ask), GIVEN, n, 6), inner


def compiled_differences(law: Callable[..., None], n: int, time: Callable[[float], float] | None = None) -> Any:
    """Compile the derivative of a law of a user force by the six unknowns of its node, by differences, central ones at rest:
    machine code as in `compiled_force`, with the law within its loop. Its arguments stand behind `DIFFERENCE` in
    forces/user_force.py; it writes 6 x 6 numbers."""
    inner = _timed(law, time)

    def ask(t: Any, w: Any, p: Any, found: Any) -> None:
        x, y, turns, out = w[57:75], w[75:87], w[21:57].reshape((3, 12)), found.reshape((6, 6))
        is_central = w[18] == 0.0
        for i in range(18):
            x[i] = w[i]
        for c in range(6):
            size = w[19] if c < 3 else w[20]
            # one-sided differences from the force in y[6:]
            for o in range(0, 12 if is_central else 6, 6):
                by = size if o == 0 else -size
                if c < 3:
                    x[c] = w[c] + 0.5 * by
                    x[12 + c] = w[12 + c] + w[18] * by
                else:
                    for i in range(9):
                        x[3 + i] = w[3 + i] + by * turns[c - 3, i]
                    for i in range(3):
                        x[15 + i] = w[15 + i] + by * turns[c - 3, 9 + i]
                y[o:o + 6] = 0.0
                inner(t, x[:3], x[3:12].reshape((3, 3)), x[12:15], x[15:18], p, y[o:o + 3], y[o + 3:o + 6])
                if not math.isfinite(y[o] + y[o + 1] + y[o + 2] + y[o + 3] + y[o + 4] + y[o + 5]):
                    raise ArithmeticError
            if c < 3:
                x[c], x[12 + c] = w[c], w[12 + c]
            for i in range(6):
                out[i, c] = (y[i] - y[6 + i]) * ((0.5 if is_central else 1.0) / size)
    return _guarded(around_user(ask), 87, n, 36, at=57)


def compiled_tension(law: Callable[..., float], n: int) -> tuple[Any, Any]:
    """Compile a law of a force along a line with n parameters, as `compiled_force`."""
    inner = _returning(law, (NUMBER, NUMBER, NUMBER, ARRAY), "the tension, N")

    def ask(t: Any, x: Any, p: Any, y: Any) -> None:
        value = inner(t, x[0], x[1], p)
        y[0] = math.nan
        if value is not None:
            y[0] = value
    return _guarded(around_user(ask), 2, n, 1), inner


def compiled_drive(law: Callable[..., float]) -> tuple[Any, Any]:
    """Compile a force of (t, s, rate) of a drive, as `compiled_force`."""
    inner = _returning(law, (NUMBER, NUMBER, NUMBER), "the force")

    def ask(t: Any, x: Any, p: Any, y: Any) -> None:
        value = inner(t, x[0], x[1])
        y[0] = math.nan
        if value is not None:
            y[0] = value
    return _guarded(around_user(ask), 2, 0, 1), inner


def compiled_slopes(derivative: Callable[..., None], n: int, time: Callable[[float], float] | None = None) -> tuple[Any, Any]:
    """Compile the derivative of a law of a user force, as `compiled_force`."""
    inner = steady = _writing(derivative, (NUMBER, ARRAY, MATRIX, *[ARRAY] * 3, MATRIX), "out")
    if time is not None:
        factor = _factor(time)

        def timed(t: Any, x: Any, directors: Any, velocity: Any, spin: Any, parameters: Any, out: Any) -> None:
            steady(t, x, directors, velocity, spin, parameters, out)
            out *= factor(t)
        inner = around_user(timed)

    def ask(t: Any, x: Any, p: Any, y: Any) -> None:
        inner(t, x[:3], x[3:12].reshape((3, 3)), x[12:15], x[15:18], p, y.reshape((6, 18)))
    return _guarded(around_user(ask), GIVEN, n, 108), inner


def compiled_tension_slopes(derivative: Callable[..., tuple[float, float]], n: int) -> tuple[Any, Any]:
    """Compile the derivative of a law of a force along a line, as `compiled_force`."""
    inner = _returning(derivative, (NUMBER, NUMBER, NUMBER, ARRAY), "two numbers")

    def ask(t: Any, x: Any, p: Any, y: Any) -> None:
        both = inner(t, x[0], x[1], p)
        y[0] = math.nan
        if both is not None:
            y[0], y[1] = both
    return _guarded(around_user(ask), 2, n, 2), inner


def compiled_wind(law: Callable[..., None], n: int) -> tuple[Any, Any]:
    """Compile a velocity of the air with n parameters, as `compiled_force`."""
    inner = _writing(law, (NUMBER, ARRAY, ARRAY, ARRAY), "velocity")

    def ask(t: Any, x: Any, p: Any, y: Any) -> None:
        inner(t, x, p, y)
    return _guarded(around_user(ask), 3, n, 3), inner


def machine_code(who: str, what: str, make: Callable[[], tuple[Any, Any]]) -> tuple[int, Any]:
    """Return the address of a user function, and the function for Python; make: one of the compiling functions above; who, what:
    names in messages. Raises SceneError: numba cannot compile the function, or its return value is wrong."""
    try:
        entry, compiled = make()
        return int(entry.address), compiled
    except WrongForm as wrong:
        raise SceneError(f"{who}: its {what} {wrong}") from None
    except Exception as failed:
        text = " ".join(str(failed).split())[:300]
        raise SceneError(f"{who}: numba cannot compile its {what} ({text}); use numbers, indices, loops, math and numpy "
                         "functions") from failed
