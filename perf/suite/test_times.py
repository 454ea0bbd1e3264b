"""Processor time of every test, that of the processes it starts included: which tests compile kernels for long.

    rm -rf the folder of compiled kernels (`python -m fastbeam doctor` says where), then
    python perf/suite/test_times.py                      the default tests; 40 longest tests, and files
    python perf/suite/test_times.py tests/statics -m slow arguments of pytest
    python perf/suite/test_times.py --of out/test_times.jsonl   of a run before

What compiles first pays for those behind it: after moving a test to `tests/slow_variants.txt`, measure again.
"""
from __future__ import annotations

import json
import resource
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from perf.suite import watched  # noqa: E402

OUT = watched.written("test_times")


def used() -> float:
    """Processor seconds of this process and of those it waited for."""
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(x.ru_utime + x.ru_stime for x in both)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """As a plugin: one line a test."""
    begin = used()
    yield
    with OUT.open("a") as file:
        file.write(json.dumps([item.nodeid, round(used() - begin, 3)]) + "\n")


def table(path: Path) -> None:
    """The longest tests, and files."""
    tests = [json.loads(line) for line in path.read_text().splitlines()]
    files: dict[str, float] = defaultdict(float)
    for name, seconds in tests:
        files[name.split("::")[0]] += seconds
    print(f"{len(tests)} tests, {sum(files.values()):.0f} s of processor time")
    for lines in (sorted(tests, key=lambda x: -x[1])[:40], sorted(files.items(), key=lambda x: -x[1])[:25]):
        print()
        for name, seconds in lines:
            print(f"{seconds:8.1f} s  {name}")


if __name__ == "__main__":
    sys.exit(watched.main("test_times", table))
