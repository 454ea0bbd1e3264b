"""Tests that run for long, or compile kernels of their own for long beside others of their kind, are slow ones:
`slow_variants.txt` lists them, `python perf/suite/test_times.py` measures them."""
from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

import pytest

from fastbeam.kernels.jit import background as _background

if "PYTEST_XDIST_WORKER" in os.environ:
    # the other processor compiles for tests of its own; a second process would take as long to start as it saves
    _background._processors = lambda: 1

# files of few tests that take long: begun last, they would keep one processor alone
FIRST = ("kernels/test_plain_numba.py", "validation/test_full_table.py", "validation/test_taut.py", "project/test_packages.py",
         "dynamics/test_start.py", "interface/test_typing.py", "house/test_compiled_code.py")
VARIANTS = [line for line in (Path(__file__).parent / "slow_variants.txt").read_text().splitlines() if line and line[0] != "#"]


def _file(item: pytest.Item) -> str:
    """Below tests/."""
    return item.nodeid.removeprefix("tests/").split("::")[0]


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark them; a line that fits no test of a file that was collected whole is an error. Files of `FIRST` come first, and behind
    them those of many tests."""
    files = Counter(map(_file, items))
    rank = {name: k for k, name in enumerate(FIRST)}
    items.sort(key=lambda item: (rank.get(_file(item), len(rank)), -files[_file(item)], _file(item)))
    fits = set()
    for item in items:
        name = item.nodeid.removeprefix("tests/")
        found = [line for line in VARIANTS if name.startswith(line)]
        fits.update(found)
        if found:
            item.add_marker("slow")
    if not any("::" in argument for argument in config.args):
        unknown = [line for line in VARIANTS if line not in fits and line.split("::")[0] in files]
        if unknown:
            raise pytest.UsageError(f"tests/slow_variants.txt: no test begins with {unknown[0]!r}")
