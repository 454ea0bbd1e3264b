"""All rows with a bar of the validation table at full size: slow."""
from __future__ import annotations

import pytest

from perf.validation import CHECKS, STUDIES, check, misses


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in CHECKS if name not in STUDIES])
def test_every_row_of_the_table_meets_its_bar(name: str) -> None:
    assert misses(check(name)(quick=False)) == []
