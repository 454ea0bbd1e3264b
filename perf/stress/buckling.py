"""Sixty random scenes that buckle (tests/buckling_scenes.py): lowest critical loads in a plane and in space, and modes about
both sides."""
from __future__ import annotations

from collections.abc import Iterator

from buckling_scenes import KINDS
from test_out_of_plane import compared

from perf.stress.table import Row


def rows(quick: bool = False) -> Iterator[Row]:
    """All cases of this part."""
    for kind in KINDS:
        worst, missed = 0.0, ""
        for seed in range(2 if quick else 12):
            try:
                worst = max(worst, compared(kind, seed))
            except AssertionError as found:
                missed = f"; modes say otherwise: {str(found)[:60]}"
        yield Row(f"lowest critical loads of each {kind}", "as in space to 1e-6, none missed", f"{worst:.1e}{missed}",
                  worst < 1e-6 and not missed)
