"""Three thousand random scenes (tests/scene_strategies.py) against the properties of tests/physics/test_scene_properties.py."""
from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from hypothesis import given, settings

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "physics"))

from scene_strategies import Drawn, scenes  # noqa: E402
from table import Row  # noqa: E402
from test_scene_properties import CHECKS, QUICK, assert_property  # noqa: E402


def tried(name: str, held: bool, examples: int) -> Row:
    """One property over many scenes; a failure shows the smallest scene that was found."""
    count = [0, 0]

    def check(drawn: Drawn) -> None:
        count[0] += 1
        assert_property(name, drawn)
        count[1] += 1

    message = ""
    try:
        settings(QUICK, max_examples=examples)(given(scenes(held=held, planar=name == "turned"))(check))()
    except Exception as found:  # what was found is the result
        message = f"{type(found).__name__}: {str(found)[:300]} {' '.join(getattr(found, '__notes__', []))[:2000]}"
    what = "on supports, with loads" if held else "in flight"
    happened = message or f"holds in {count[1]}, {count[0] - count[1]} not usable"
    return Row(f"{name}, scenes {what}", f"holds in {examples}", happened, not message)


def rows(quick: bool = False) -> Iterator[Row]:
    """All cases of this part."""
    for name in CHECKS:
        for held in (False, True):
            yield tried(name, held, 20 if quick else 300)
