"""Two thousand random scenes (tests/unit_systems.py), three analyses each, in SI and in other units, turned and moved: the same
results to round-off, closed books, and no law that fails without a word."""
from __future__ import annotations

from collections.abc import Iterator

from unit_systems import ASK_LAWS, BALANCE, FAMILIES, LAWS, compared, scene_of, silent

from perf.stress.table import Row


def rows(quick: bool = False) -> Iterator[Row]:
    """All cases of this part."""
    count = 12 if quick else 500
    for family in FAMILIES:
        wrong, found = [], []
        for number in range(count):
            features, analyses = scene_of(family, number)
            for name in analyses:
                found.append(compared(name, family, features, number))
                if found[-1].wrong:
                    wrong.append(f"{number}, {name}: {found[-1].wrong}")
        refused, told, books = sum(x.refused for x in found), sum(x.told for x in found), max(x.balance for x in found)
        happened = (f"{len(found)} analyses, {refused} refused alike, {told} told as unresolved; "
                    f"{max(x.ratio for x in found):.1g} of the round-off, books {books:.1e}")
        yield Row(f"{count} scenes of family {family}", f"same results, books to {BALANCE:g}", "; ".join(wrong) or happened,
                  not wrong)
    says = [text for number in range(count // 4) for law in LAWS for name in ASK_LAWS
            if (text := silent(name, "laws", (law,), number))]
    yield Row(f"{count // 4 * len(LAWS) * len(ASK_LAWS)} laws that fail", "named", "; ".join(says) or "all named", not says)
