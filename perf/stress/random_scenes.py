"""Three thousand random scenes (tests/scene_strategies.py) against the properties of tests/validation/test_scene_properties.py,
and as many with sleeves, friction, drives and stops against those of tests/sliding_checks.py."""
from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import sliding_checks as sliding
from hypothesis import given, settings
from scene_strategies import scenes, sliding_paths
from test_scene_properties import CHECKS, QUICK

from perf.stress.table import Row


def tried(what: str, strategy: Any, holds: Callable[[Any], None], examples: int) -> Row:
    """One property over many scenes; a failure shows the smallest scene that was found, all of it."""
    count = [0, 0]

    def check(drawn: Any) -> None:
        count[0] += 1
        holds(drawn)
        count[1] += 1

    message = ""
    try:
        settings(QUICK, max_examples=examples)(given(strategy)(check))()
    except Exception as found:  # what was found is the result
        message = f"{type(found).__name__}: {str(found)[:300]} {' '.join(getattr(found, '__notes__', []))}"
    happened = message or f"holds in {count[1]}, {count[0] - count[1]} not usable"
    return Row(what, f"holds in {examples}", happened, not message)


def rows(quick: bool = False) -> Iterator[Row]:
    """All cases of this part."""
    examples, where = 20 if quick else 300, {False: "in flight", True: "on supports, with loads"}
    for name, check in CHECKS.items():
        for held in (False, True):
            yield tried(f"{name}, scenes {where[held]}", scenes(held=held, planar=name == "turned"), check, examples)
    for name, check in sliding.CHECKS.items():
        for held in (False, True):
            yield tried(f"{name}, sleeves and forces along beams {where[held]}", sliding.drawn_by(name, held), check, examples)
            if name != "plane":
                what = f"{name}, elements that move {where[held]}"
                yield tried(what, sliding.drawn_by(name, held, moves=True), check, examples)
        if name != "turned":
            yield tried(f"{name}, forces along paths", sliding_paths(planar=name == "plane"), check, examples)
