"""How far the numbers that tests compare are from their bars: lists small tolerances that are met by less than a factor of three.

    python perf/suite/test_margins.py                        the default tests
    python perf/suite/test_margins.py tests/validation -m slow  arguments of pytest
    python perf/suite/test_margins.py --of out/test_margins.jsonl  of a run before
    python perf/suite/test_margins.py --of A.jsonl B.jsonl  of A without what is the same in B, one with OPENBLAS_CORETYPE=Haswell

It sees `a < bar` in an assert with a bar of at most 1e-4, `pytest.approx` and `np.testing.assert_allclose`. Results may differ in
the last bits between processors (OPENBLAS_CORETYPE, MKL_CBWR): a bar that is met by less needs a reason, and room.
"""
from __future__ import annotations

import json
import re
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from perf.suite import watched  # noqa: E402

OUT = watched.written("test_margins")
ROOM = 3.0
NUMBER = r"(?:np\.float64\()?(\d+(?:\.\d*)?(?:e[-+]?\d+)?)\)?"
BELOW = re.compile(rf"(?<![\w.\-\[]){NUMBER} <=? {NUMBER}(?![\w.*/])")
LARGEST = 1e-4
# runs on two processors that agree to this share measure an error of discretisation, not round-off
SAME = 1e-3
_now = [""]


def keep(line: int, measured: float, bar: float) -> None:
    """Write one comparison down where it is a small bar that is nearly reached."""
    if 0.0 < bar <= LARGEST and bar / ROOM < measured <= bar:
        with OUT.open("a") as file:
            file.write(json.dumps([_now[0], line, measured, bar]) + "\n")


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Any:
    """As a plugin: the name of the test that runs."""
    _now[0] = item.nodeid
    yield


def pytest_assertion_pass(item: pytest.Item, lineno: int, orig: str, expl: str) -> None:
    """As a plugin: every assert that holds, with its values."""
    if "<" in orig:
        for measured, bar in BELOW.findall(expl.splitlines()[0] if expl else ""):
            keep(lineno, float(measured), float(bar))


def _watch(module: Any, name: str, look: Any) -> None:
    """Call `look` with the arguments of a function that has passed."""
    inner = getattr(module, name)

    def outer(*arguments: Any, **options: Any) -> Any:
        out = inner(*arguments, **options)
        look(out, *arguments, **options)
        return out

    setattr(module, name, outer)


def _of_allclose(_: Any, actual: Any, desired: Any, rtol: float = 1e-7, atol: float = 0.0, *rest: Any, **options: Any) -> None:
    off, room = np.abs(np.asarray(actual) - np.asarray(desired)), atol + rtol * np.abs(np.asarray(desired))
    share = np.max(np.divide(off, room, out=np.zeros(np.broadcast(off, room).shape), where=room > 0.0), initial=0.0)
    keep(sys._getframe(2).f_lineno, float(share) * max(rtol, atol), max(rtol, atol))


def _of_approx(out: bool, expected: Any, actual: Any) -> None:
    if out and isinstance(expected.expected, (int, float)) and isinstance(actual, (int, float)):
        size = abs(float(expected.expected)) or 1.0
        keep(sys._getframe(2).f_lineno, abs(float(actual) - float(expected.expected)) / size, float(expected.tolerance) / size)


def pytest_configure(config: pytest.Config) -> None:
    """As a plugin: watch the two functions that compare."""
    _watch(np.testing, "assert_allclose", _of_allclose)
    _watch(type(pytest.approx(1.0)), "__eq__", _of_approx)


def lines(path: Path) -> list[tuple[str, int, float, float]]:
    """Test, line, measured number and bar of every comparison that was written down."""
    return [tuple(json.loads(text)) for text in path.read_text().splitlines()] if path.exists() else []


def table(path: Path, *others: Path) -> None:
    """Each place once, with the least margin that it had; without numbers that runs on other processors have alike."""
    elsewhere = [defaultdict(list) for _ in others]
    for known, other in zip(elsewhere, others):
        for name, line, measured, _ in lines(other):
            known[name, line].append(measured)
    least: dict[tuple[str, int], tuple[float, float, float, str]] = {}
    for name, line, measured, bar in lines(path):
        if others and all(any(abs(x - measured) <= SAME * measured for x in known[name, line]) for known in elsewhere):
            continue
        key = name.split("::")[0], line
        least[key] = min(least.get(key, (np.inf, 0.0, 0.0, "")), (bar / measured, measured, bar, name))
    print(f"{len(least)} places with bars of at most {LARGEST:g} that are met by less than a factor of {ROOM:g}\n")
    for (_, line), (margin, measured, bar, name) in sorted(least.items(), key=lambda x: x[1][0]):
        print(f"{margin:6.2f}  {measured:9.3g} of {bar:9.3g}  line {line:4d}  {name}")


if __name__ == "__main__":
    sys.exit(watched.main("test_margins", table, "-o", "enable_assertion_pass_hook=true"))
