"""What friction whose signs go in circles does from one iteration to the next."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.dynamics.warnings import Watch, fallbacks_of
from fastbeam.kernels.contact.friction_fallback import (
    FAILED,
    KNOWN,
    LATE,
    LATEST,
    LEVEL,
    LEVELS,
    MISSED,
    MOST_FAILED,
    MOST_FLIPS,
    PATIENCE,
    SHARPER,
    SOFTER,
    WITHIN,
    Fallback,
    clear_fallback,
    count_missed,
    fallback_of,
    is_sharp,
    needs_fallback,
    sticks_in_fallback,
)
from fastbeam.kernels.state import IN_FALLBACK, LastIncrement
from fastbeam.stepping.stepper import Stepper

# of an inertia of 10 in steps of 0.1
H, UNIT = 0.1, 1e-3
FIRST = UNIT * 8.0
FLIPS = np.full(2, MOST_FLIPS)


def iterate(fallback: Fallback, n: int = 1, breaks: bool = False, found: float = 3e-3, way: float = 1e-5) -> bool:
    """So many iterations; the bound is 1 N."""
    return [sticks_in_fallback(fallback, 1, H, found, way, 1.0, breaks) for _ in range(n)][-1]


def begun(found: float = 3e-3, way: float = 1e-5) -> Fallback:
    """After the iteration behind those in which it stuck, which took more than the bound."""
    fallback = fallback_of(np.full(2, H * H / UNIT))
    assert iterate(fallback, KNOWN, breaks=True) and not is_sharp(fallback, 1, 7)
    assert not iterate(fallback, found=found, way=way)
    assert fallback.compliance[0] == 0.0 and not fallback.counts[0].any()
    return fallback


def test_it_sticks_where_that_takes_less_than_the_bound() -> None:
    fallback = fallback_of(np.full(2, H * H / UNIT))
    # the force before it stuck is not that which holds it
    assert iterate(fallback) and not is_sharp(fallback, 1, 7)
    assert iterate(fallback) and is_sharp(fallback, 1, 8) and fallback.compliance[1] == 0.0


def test_what_does_not_converge_while_it_sticks_slides() -> None:
    fallback = fallback_of(np.full(2, H * H / UNIT))
    assert iterate(fallback, PATIENCE) and not iterate(fallback)
    assert (fallback.counts[1, LEVEL], fallback.compliance[1]) == (1, FIRST)


def test_what_has_converged_waits_for_others() -> None:
    fallback = fallback_of(np.full(2, H * H / UNIT))
    iterate(fallback, KNOWN)
    for _ in range(5):
        assert is_sharp(fallback, 1, 8) and iterate(fallback, PATIENCE - KNOWN)
    fallback = begun(way=-1.0)
    for _ in range(5):
        assert is_sharp(fallback, 1, 8) and not iterate(fallback, PATIENCE, way=-1.0) and fallback.compliance[1] == FIRST


@pytest.mark.parametrize("found", [3e-3, 3.001e-3, UNIT * 1.01])
def test_compliances_that_differ_a_little_are_taken_for_one(found: float) -> None:
    assert begun(found).compliance[1] == FIRST


def test_a_compliance_does_not_depend_on_units() -> None:
    inertia, found = np.array([3.0, 3.0 * 1e6 * 0.4536]), 3e-5
    fallback = fallback_of(inertia)
    for i, scale in ((0, 1.0), (1, 1e6 * 0.4536)):
        for _ in range(KNOWN):
            sticks_in_fallback(fallback, i, H, found / scale, 1e-5, 1.0, True)
        assert not is_sharp(fallback, i, 7) and not sticks_in_fallback(fallback, i, H, found / scale, 1e-5, 1.0, True)
    assert fallback.compliance[1] * inertia[1] == pytest.approx(fallback.compliance[0] * inertia[0], rel=1e-14)


def test_it_gets_sharper_until_it_slips() -> None:
    fallback = begun()
    for level in range(2, LEVELS + 1):
        assert fallback.counts[1, WITHIN] == 1 and not is_sharp(fallback, 1, 10 + level)
        assert fallback.compliance[1] == FIRST * SHARPER**(level - 1)
        assert not iterate(fallback, way=1e-12)
    assert is_sharp(fallback, 1, 20)
    assert not iterate(fallback, way=-1.0) and fallback.counts[1, WITHIN] == 0 and is_sharp(fallback, 1, 21)
    clear_fallback(fallback, 1)
    assert fallback.compliance[1] == 0.0 and not fallback.counts[1].any()


def test_all_of_the_friction_is_coulombs_law() -> None:
    fallback = begun(way=-1.0)
    assert fallback.counts[1, WITHIN] == 0 and is_sharp(fallback, 1, 11)
    count_missed(fallback, FLIPS, 1)
    assert fallback.counts[1, MISSED] == 0


def test_late_iterations_make_nothing_sharper_and_count_as_missed() -> None:
    fallback = begun()
    assert is_sharp(fallback, 1, LATEST + 1)
    count_missed(fallback, FLIPS, 1)
    count_missed(fallback, FLIPS - 1, 1)
    assert fallback.counts[1, MISSED] == 1
    # those of steps before stay counted, and a step in which it sticks has missed nothing
    clear_fallback(fallback, 1)
    assert iterate(fallback, KNOWN) and is_sharp(fallback, 1, 8)
    count_missed(fallback, FLIPS, 1)
    assert fallback.counts[1].tolist() == [0, KNOWN, 1, 0, 1]


def test_a_smaller_one_that_does_not_converge_is_tried_less_small_once_more() -> None:
    fallback = begun()
    for failed, factor in enumerate((SHARPER, 1.0 / SOFTER)):
        assert not is_sharp(fallback, 1, 11)
        assert not iterate(fallback, PATIENCE) and fallback.compliance[1] == FIRST * factor
        assert not iterate(fallback) and (fallback.counts[1, LEVEL], fallback.counts[1, FAILED]) == (1, failed + 1)
        assert fallback.compliance[1] == FIRST
    assert fallback.counts[1, FAILED] == MOST_FAILED and is_sharp(fallback, 1, 30)


def test_the_first_gets_softer_where_it_does_not_converge() -> None:
    fallback = begun()
    iterate(fallback, PATIENCE)
    assert fallback.compliance[1] == FIRST * SOFTER and fallback.counts[1, LEVEL] == 1


def test_it_sticks_where_no_compliance_is_known() -> None:
    fallback = fallback_of(np.full(2, H * H / UNIT))
    assert iterate(fallback, KNOWN, breaks=True, found=0.0) and not is_sharp(fallback, 1, 7)
    assert iterate(fallback, breaks=True, found=0.0) and is_sharp(fallback, 1, 8)
    count_missed(fallback, FLIPS, 1)
    assert fallback.counts[1, MISSED] == 1
    assert not iterate(fallback, breaks=True) and fallback.compliance[1] == FIRST


def test_many_changes_of_sign_and_many_iterations_are_doubt() -> None:
    for flips, judged, expected in ((MOST_FLIPS - 1, 3, False), (MOST_FLIPS, 3, True), (0, LATE, True)):
        increment = LastIncrement(np.zeros(4), np.zeros(3), np.zeros(8), np.zeros(3))
        changes = np.array([flips])
        assert needs_fallback(changes, np.array([judged]), 0, increment) is expected
        assert increment.control[IN_FALLBACK] == float(expected) and bool(changes[0] == MOST_FLIPS) is expected


def test_an_event_names_what_has_missed_coulombs_law_once() -> None:
    section = fb.Section.circle(radius=0.01, E=1e9, rho=1000.0)
    rod = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=section, elements=2)
    bead = fb.PointMass("bead", mass=0.1)
    block, flap = (fb.RigidBody(name, mass=1.0, inertia=(0.1, 0.1, 0.1), position=(x, 0, 0))
                   for x, name in ((0.5, "block"), (1.5, "flap")))
    scene = fb.Scene(rod, bead, block, flap, fb.Slider("ring", bead, rod, at=0.25, friction=0.3),
                     fb.Sleeve("bush", block, rod, at=0.5, length=0.05, radius=0.01, keyed=False, friction=0.2),
                     fb.RevoluteJoint(block.point((0.5, 0, 0)), flap.point((-0.5, 0, 0)), "hinge", axis=(0, 0, 1), friction=0.1))
    model = fb.compile_scene(scene, planar=False)
    stepper, told = Stepper(model, np.ones(1)), list[dict[str, Any]]()
    watch = Watch(model, stepper, told.append, 0.0, 1.0)
    watch.friction(0.1, 0.01)
    assert not told
    names = [name_of(i) for fallback, name_of in fallbacks_of(stepper) for i in range(len(fallback.counts))]
    assert len(names) == 4 and len(set(names)) == 4
    for fallback, _ in fallbacks_of(stepper):
        fallback.counts[-1, MISSED] = 1
    for _ in range(2):
        watch.friction(0.2, 0.01)
    assert [x["text"].split(" jams in a step of 0.01 s at or before t = 0.2 s")[0] for x in told] \
        == ["slider 'bush'", "sleeve 'bush': twist", "joint 'hinge'"]
    assert {x["kind"] for x in told} == {"unresolved"}
