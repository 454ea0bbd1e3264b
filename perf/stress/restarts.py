"""A thousand random restarts across scenes (tests/random_restarts.py): joints added, removed and moved; momenta and energy are
accounted for, or the start is refused."""
from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from random_restarts import BAR, restart

from perf.stress.table import Row


def rows(quick: bool = False) -> Iterator[Row]:
    """All cases of this part."""
    found = [restart(seed) for seed in range(60 if quick else 1000)]
    worst = max(error for _, error in found)
    count = ", ".join(f"{n} {what}" for what, n in Counter(what for what, _ in found).items())
    yield Row(f"{len(found)} random restarts", f"books to {BAR:g}, or refused", f"{worst:.1e}; {count}", worst < BAR)
