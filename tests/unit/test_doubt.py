"""What friction whose signs go in circles does from one iteration to the next."""
from __future__ import annotations

import pytest

from fastbeam.kernels.doubt import (FINAL, LATEST, LEVEL, LEVELS, PATIENCE, SHARPER, SOFTER, WITHIN, Doubt, clear_doubt, is_sharp,
                                    no_doubt, sticks_in_doubt)


def begun(found: float = 3e-3, way: float = 1e-5) -> Doubt:
    """After one iteration of a step; the bound is 1 N."""
    doubt = no_doubt(2)
    assert not sticks_in_doubt(doubt, 1, found, way, 1.0, False)
    assert doubt.compliance[0] == 0.0 and not doubt.counts[0].any()
    return doubt


def iterate(doubt: Doubt, n: int = 1, breaks: bool = False) -> bool:
    return [sticks_in_doubt(doubt, 1, 3e-3, 1e-5, 1.0, breaks) for _ in range(n)][-1]


@pytest.mark.parametrize("found", [3e-3, 3.001e-3, 2.0**-9 * 1.01])
def test_compliances_that_differ_a_little_are_taken_for_one(found: float) -> None:
    assert begun(found).compliance[1] == 8.0**-2


def test_it_gets_sharper_until_it_sticks() -> None:
    doubt = begun()
    for level in range(1, LEVELS + 1):
        assert doubt.counts[1, WITHIN] == 1 and not is_sharp(doubt, 1, 7 + level)
        assert doubt.compliance[1] == 8.0**-2 * SHARPER**level
        assert iterate(doubt) == (level == LEVELS)
    assert is_sharp(doubt, 1, 12)
    clear_doubt(doubt, 1)
    assert doubt.compliance[1] == 0.0 and not doubt.counts[1].any()


def test_all_of_the_friction_is_coulombs_law() -> None:
    doubt = begun(way=-1.0)
    assert doubt.counts[1, WITHIN] == 0 and is_sharp(doubt, 1, 8)


def test_late_iterations_make_nothing_sharper() -> None:
    assert is_sharp(begun(), 1, LATEST + 1)


def test_what_breaks_loose_or_does_not_converge_goes_back() -> None:
    doubt = begun()
    for level in range(1, LEVELS + 1):
        assert not is_sharp(doubt, 1, 7 + level)
        iterate(doubt)
    # the force of the first iteration that sticks is not that which holds it
    assert iterate(doubt, breaks=False) and not iterate(doubt, breaks=True)
    assert (doubt.counts[1, LEVEL], doubt.counts[1, FINAL]) == (LEVELS - 1, 1) and is_sharp(doubt, 1, 12)
    doubt = begun()
    assert not is_sharp(doubt, 1, 8) and not iterate(doubt, PATIENCE) and doubt.counts[1, LEVEL] == 1
    assert not iterate(doubt) and doubt.counts[1, LEVEL] == 0 and doubt.compliance[1] == 8.0**-2 and is_sharp(doubt, 1, 14)


def test_the_first_gets_softer_where_it_does_not_converge() -> None:
    doubt = begun()
    iterate(doubt, PATIENCE)
    assert doubt.compliance[1] == 8.0**-2 * SOFTER and doubt.counts[1, LEVEL] == 0


def test_it_sticks_until_a_compliance_is_known() -> None:
    doubt = no_doubt(1)
    assert sticks_in_doubt(doubt, 0, 0.0, 1e-5, 1.0, True) and not is_sharp(doubt, 0, 7)
    assert not sticks_in_doubt(doubt, 0, 3e-3, 1e-5, 1.0, True) and doubt.compliance[0] == 8.0**-2
    doubt = no_doubt(1)
    assert all(sticks_in_doubt(doubt, 0, 0.0, 1e-5, 1.0, False) for _ in range(2)) and is_sharp(doubt, 0, 8)
