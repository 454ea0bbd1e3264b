"""Two hundred random columns of any slenderness and mesh (tests/column_scenes.py): numbers of unstable and free directions."""
from __future__ import annotations

from collections.abc import Iterator

from column_scenes import counted, drawn

from perf.stress.table import Row


def rows(quick: bool = False) -> Iterator[Row]:
    """All cases of this part."""
    for k, kind in enumerate(("bare columns", "columns with a strut", "columns with a body", "columns in a loop")):
        seeds, wrong = range(k, 24 if quick else 200, 4), []
        for seed in seeds:
            column = drawn(seed, 200 if quick else 2048)
            found = counted(column)
            if found != (column.unstable, column.free):
                wrong.append(f"{seed}: {found} for {(column.unstable, column.free)}")
        yield Row(f"{len(seeds)} {kind}, slenderness to 1e5", "as many unstable and free directions as there are",
                  "; ".join(wrong) or f"{len(seeds)} right", not wrong)
