"""Coulomb's law of many coordinates: what each does from one iteration to the next, and where all of them end."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.dynamics.warnings import Watch, friction_of
from fastbeam.kernels.contact.coulomb import (
    AGAIN,
    ANEW,
    BEYOND,
    FAILED,
    JUDGED,
    LATE,
    LEVEL,
    LEVELS,
    MOST_FAILED,
    MOST_FLIPS,
    MOST_TURNS,
    NEARLY,
    NEW,
    PATIENCE,
    SHARPER,
    SLIPS,
    SOFTER,
    STICKS,
    TURN,
    WITHIN,
    Attempt,
    Coulomb,
    begin_coulomb,
    begin_fallback,
    begin_iteration,
    begin_round,
    begin_soft,
    coulomb_of,
    count_missed,
    cycles,
    judge,
    may_change,
    obeys,
)
from fastbeam.kernels.state import (
    BEGUN,
    CHANGED,
    CONTROLS,
    FALLBACK,
    MOVED,
    MOVED_BEFORE,
    ROUNDS,
    WAITED,
    LastIncrement,
)
from fastbeam.stepping.stepper import Stepper

# compliances are rounded up to powers of 8 of h^2/inertia, 1 m/N here
H = 1e-3
FIRST = 8.0**-2


def increment_of(fallback: int = 1) -> LastIncrement:
    """Return the controls of a step, in whose fallback the active set may change."""
    increment = LastIncrement(np.zeros(CONTROLS), np.zeros(3), np.zeros(8), np.zeros(3))
    increment.control[FALLBACK] = fallback
    return increment


def two() -> Coulomb:
    return coulomb_of(np.full(2, H * H))


def soft(again: int = 1) -> Coulomb:
    """Return a record whose coordinate 1 has soft friction."""
    coulomb = two()
    coulomb.branch[1] = STICKS
    begin_soft(coulomb, 1, again)
    return coulomb


def iterate(coulomb: Coulomb, increment: LastIncrement, way: float = 1e-5, force: float = 0.0, found: float = 3e-3,
            most: float = 1.0, least: float = 0.0, h: float = H) -> int:
    """Return the slip direction of coordinate 1 in an iteration."""
    coulomb.found[1] = found
    begin_iteration(coulomb, 1, increment)
    judge(coulomb, 1, increment, h, Attempt(way, way - coulomb.rest[1], force, most, 0.0, least))
    return int(coulomb.sign[1])


def converges(coulomb: Coulomb) -> bool:
    """Return whether a converged step obeys Coulomb's law."""
    return bool(obeys(coulomb, 1, increment_of(), H, 0.0, 0.0, False))


def test_many_changes_of_sign_and_many_iterations_begin_the_fallback_of_all() -> None:
    for flips, judged, moved, expected in ((MOST_FLIPS - 1, 3, 1.0, False), (MOST_FLIPS, 3, 1.0, True), (0, LATE - 1, 1.0, True),
                                           (0, LATE - 1, 0.1 * NEARLY, False)):
        increment, coulomb = increment_of(0), two()
        increment.control[MOVED] = moved
        coulomb.flips[0], coulomb.judged[0], coulomb.rest[1] = flips, judged, 1.0
        assert not begin_iteration(coulomb, 0, increment) and cycles(increment) is expected
        begin_round(increment)
        assert begin_iteration(coulomb, 1, increment) is expected
        assert increment.control[FALLBACK] == float(expected) and coulomb.rest[1] == float(not expected)
        assert (coulomb.flips[1] == MOST_FLIPS) == expected


def test_the_velocity_at_the_end_decides_at_first() -> None:
    coulomb, increment = two(), increment_of(0)
    begin_coulomb(coulomb, 1, 1, 0)
    coulomb.rest[1] = 2e-5
    assert iterate(coulomb, increment) == 1
    # its increment is smaller than the one that leaves it at rest: it has turned around
    assert iterate(coulomb, increment) == 0 and increment.control[CHANGED] == 1.0 and coulomb.flips[1] == 1
    for force, h, sign in ((0.9, H, 0), (1.1, H, -1), (-1.1, H, 1), (1.1, -H, 1), (-1.1, -H, -1)):
        coulomb.sign[1] = 0
        assert iterate(coulomb, increment, force=force, h=h) == sign
    # a rigid stop pushes only
    for against, force, sign in ((-1, 9.0, 0), (-1, -9.0, 1), (1, -9.0, 0), (1, 9.0, -1)):
        coulomb.sign[1], coulomb.against[1], coulomb.flips[1], coulomb.judged[1] = 0, against, 0, 3
        assert iterate(coulomb, increment, force=force) == sign


def test_friction_that_puts_energy_in_is_rejected() -> None:
    for sign, way, force, is_settled in ((0, 1e-5, 1.0, False), (0, 1e-5, -1.0, True), (1, -1e-5, 0.0, False),
                                         (1, 1e-5, 0.0, True)):
        coulomb = two()
        coulomb.sign[1], coulomb.rest[1], coulomb.judged[1] = sign, 1e-5, JUDGED
        assert obeys(coulomb, 1, increment_of(0), H, way, force, False) is is_settled
        assert coulomb.rest[1] == (1e-5 if is_settled else 0.0)
        coulomb.rest[1] = 1e-5
        # steps backward in time undo what others did
        assert obeys(coulomb, 1, increment_of(0), -H, way, force, False)
        assert not obeys(coulomb, 1, increment_of(0), -H, way, force, True)
        coulomb.judged[1] = JUDGED - 1
        assert not obeys(coulomb, 1, increment_of(0), -H, way, force, False)


@pytest.mark.parametrize("found", [3e-3, 3.001e-3, 2.0**-9 * 1.01])
@pytest.mark.parametrize("unit", [1.0, 1.7e5])
def test_compliances_that_differ_a_little_are_taken_for_one_in_all_units(found: float, unit: float) -> None:
    coulomb = coulomb_of(np.full(2, H * H / unit))
    iterate(coulomb, increment_of(), found=found * unit)
    np.testing.assert_allclose(coulomb.compliance, [0.0, FIRST * unit], rtol=1e-14)


def test_soft_friction_is_the_bound_beyond_it() -> None:
    coulomb, increment = soft(), increment_of()
    assert iterate(coulomb, increment, way=0.9 * FIRST) == 1 and coulomb.branch[1] == WITHIN
    assert iterate(coulomb, increment, way=-1.1 * FIRST) == -1 and coulomb.branch[1] == BEYOND
    assert converges(coulomb) and coulomb.compliance[1] == FIRST


def test_a_compliance_that_converges_is_made_smaller() -> None:
    coulomb = soft()
    for level in range(1, LEVELS):
        iterate(coulomb, increment_of(), way=1e-12)
        assert coulomb.branch[1] == WITHIN and not converges(coulomb) and coulomb.compliance[1] == FIRST * SHARPER**level
    for _ in range(2):
        iterate(coulomb, increment_of(), way=1e-12)
        assert converges(coulomb) and coulomb.soft[1, LEVEL] == LEVELS


def test_a_smaller_compliance_that_does_not_converge_is_approached() -> None:
    coulomb = soft()
    for failed, factor in enumerate((SHARPER, 1.0 / SOFTER)):
        iterate(coulomb, increment_of(), way=1e-12)
        assert not converges(coulomb) and coulomb.compliance[1] == FIRST * factor
        for _ in range(PATIENCE + 1):
            iterate(coulomb, increment_of(), way=1e-12)
        assert coulomb.compliance[1] == FIRST and coulomb.soft[1, FAILED] == failed + 1
    assert coulomb.soft[1, FAILED] == MOST_FAILED and converges(coulomb)


def test_a_first_compliance_that_does_not_converge_is_made_larger() -> None:
    coulomb = soft()
    for _ in range(PATIENCE + 1):
        iterate(coulomb, increment_of(), way=1e-12)
    assert coulomb.compliance[1] == FIRST * SOFTER and coulomb.soft[1, LEVEL] == 1


def test_what_had_soft_friction_for_the_first_time_sticks_again() -> None:
    coulomb = soft(again=0)
    iterate(coulomb, increment_of(), way=1e-12)
    assert not converges(coulomb) and coulomb.branch[1] == STICKS and coulomb.soft[1].tolist() == [0, 0, 0, 1]
    assert iterate(coulomb, increment_of(), force=0.9) == 0 and converges(coulomb)


def test_what_is_within_the_bound_sticks_until_it_needs_more() -> None:
    coulomb = two()
    coulomb.branch[1] = STICKS
    for _ in range(JUDGED):
        assert iterate(coulomb, increment_of(), force=0.9) == 0 and coulomb.branch[1] == STICKS
    assert converges(coulomb)
    for force, sign in ((1.1, -1), (-1.1, 1)):
        coulomb.branch[1], increment = STICKS, increment_of()
        assert iterate(coulomb, increment, force=force) == sign and coulomb.branch[1] == SLIPS
        assert not obeys(coulomb, 1, increment, H, 0.0, force, False)
    assert iterate(coulomb, increment_of(), way=1e-5) == 1 and converges(coulomb)
    assert iterate(coulomb, increment_of(), way=-1e-5) == 0 and coulomb.branch[1] == STICKS
    # a step backward in time: increment and force have the other sign
    coulomb.branch[1], coulomb.sign[1] = STICKS, 0
    assert iterate(coulomb, increment_of(), force=1.1, h=-H) == 1
    assert iterate(coulomb, increment_of(), way=-1e-5, h=-H) == 1 and iterate(coulomb, increment_of(), way=1e-5, h=-H) == 0


def test_the_fallback_begins_as_iterations_have_left_it() -> None:
    for judged, sign, way, branch in ((2, 1, 1e-5, SLIPS), (2, 1, -1e-5, STICKS), (2, 0, 1e-5, STICKS), (0, 1, 1e-5, STICKS)):
        coulomb = two()
        begin_coulomb(coulomb, 1, sign, 0)
        assert coulomb.branch[1] == NEW
        coulomb.judged[1] = judged
        iterate(coulomb, increment_of(), way=way)
        assert coulomb.branch[1] == branch and coulomb.sign[1] == (sign if branch == SLIPS else 0)


def test_what_goes_to_and_fro_gets_soft_friction() -> None:
    coulomb = two()
    coulomb.branch[1] = STICKS
    for turn in range(MOST_TURNS + 1):
        assert coulomb.soft[1, LEVEL] == 0
        iterate(coulomb, increment_of(), way=1e-5, force=2.0)
    assert coulomb.soft[1].tolist() == [1, 1, 0, 0] and coulomb.branch[1] == WITHIN and turn == MOST_TURNS


def test_an_active_set_changes_once_newtons_method_converges() -> None:
    increment = increment_of()
    begin_fallback(increment)
    increment.control[[MOVED, MOVED_BEFORE]] = 1.0, 1.0
    for changed, value in ((1.0, 0.0), (0.0, ANEW)):
        waits = []
        for _ in range(PATIENCE + 1):
            increment.control[CHANGED] = changed
            begin_round(increment)
            waits.append(increment.control[WAITED])
        # it waits no longer than PATIENCE iterations; a set that would stay begins again
        assert waits == [*range(1, PATIENCE + 1), value]
    assert increment.control[BEGUN] == 1.0 and increment.control[ROUNDS] == 1.0
    increment.control[[MOVED, MOVED_BEFORE]] = 2e-4, 1e-3
    begin_round(increment)
    assert increment.control[WAITED] == 0.0 and increment.control[ROUNDS] == 2.0
    coulomb = two()
    coulomb.branch[1] = STICKS
    assert iterate(coulomb, increment, force=2.0) == -1
    coulomb.branch[1], coulomb.sign[1], increment.control[WAITED], increment.control[CHANGED] = STICKS, 0, 1.0, 0.0
    assert iterate(coulomb, increment, force=2.0) == 0 and increment.control[CHANGED] == 1.0


def test_a_set_that_does_not_converge_begins_again() -> None:
    for begun, level in ((1.0, 0), (2.0, 1)):
        coulomb, increment = two(), increment_of()
        coulomb.branch[1], coulomb.sign[1] = SLIPS, 1
        increment.control[[WAITED, BEGUN]] = ANEW, begun
        iterate(coulomb, increment)
        assert coulomb.branch[1] == (WITHIN if level else STICKS) and coulomb.soft[1, LEVEL] == level
        assert coulomb.soft[1, AGAIN] == level


def test_coordinates_that_cannot_change_together_take_turns() -> None:
    increment = increment_of()
    for rounds, expected in ((TURN - 1, range(8)), (TURN, (0, 2, 4, 6)), (TURN + 1, (1, 3, 5, 7)), (3 * TURN + 1, (1, 5))):
        increment.control[ROUNDS] = rounds
        assert [i for i in range(8) if may_change(increment, i)] == list(expected)


def test_round_off_changes_nothing() -> None:
    coulomb, increment = two(), increment_of()
    coulomb.branch[1], coulomb.sign[1] = SLIPS, 1
    assert iterate(coulomb, increment, way=-1e-15, least=1e-14) == 0 and increment.control[CHANGED] == 0.0
    assert iterate(coulomb, increment, force=1.0 + 1e-15, least=1e-14) == -1 and increment.control[CHANGED] == 0.0


def test_friction_that_stays_soft_has_missed_coulombs_law() -> None:
    coulomb = soft()
    coulomb.soft[1, LEVEL] = LEVELS
    for _ in range(JUDGED):
        iterate(coulomb, increment_of(), way=1e-12)
    assert converges(coulomb)
    count_missed(coulomb, 1)
    coulomb.branch[1] = BEYOND
    count_missed(coulomb, 1)
    begin_coulomb(coulomb, 1, 0, 0)
    count_missed(coulomb, 1)
    assert coulomb.missed.tolist() == [0, 1] and not coulomb.soft[1].any() and coulomb.compliance[1] == 0.0


def settled(matrix: np.ndarray, loads: np.ndarray, most: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Return increments and friction of coordinates that springs couple, matrix @ ways = loads + friction, and iterations."""
    n, coulomb, increment = loads.size, coulomb_of(np.ones(loads.size)), increment_of()
    begin_fallback(increment)
    coulomb.found[:] = np.diag(np.linalg.inv(matrix))
    ways, friction = np.zeros(n), np.zeros(n)
    for iteration in range(1, 100):
        begin_round(increment)
        for i in range(n):
            begin_iteration(coulomb, i, increment)
            judge(coulomb, i, increment, 1.0, Attempt(ways[i], ways[i], friction[i], most[i], 0.0, 0.0))
        is_soft, sticks = coulomb.branch == WITHIN, coulomb.branch == STICKS
        given = np.where(sticks | is_soft, 0.0, -coulomb.sign * most)
        springs = np.where(is_soft, 1.0 / np.where(is_soft, coulomb.compliance, 1.0), 0.0)
        free, before = ~sticks, ways
        ways = np.zeros(n)
        ways[free] = np.linalg.solve((matrix + np.diag(springs))[np.ix_(free, free)], (loads + given)[free])
        friction = np.where(sticks, matrix @ ways - loads, given - springs * ways)
        increment.control[MOVED_BEFORE] = increment.control[MOVED]
        increment.control[MOVED] = np.max(np.abs(ways - before))
        is_done = increment.control[MOVED] <= 1e-12 * np.max(np.abs(ways))
        if is_done and all([obeys(coulomb, i, increment, 1.0, ways[i], friction[i], False) for i in range(n)]):
            return ways, friction, iteration
    raise AssertionError("it did not settle")


def projected(matrix: np.ndarray, loads: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Return the friction of the same coordinates by projected Gauss-Seidel iterations, one after the other."""
    compliance, friction = np.linalg.inv(matrix), np.zeros(loads.size)
    for _ in range(200_000):
        before = friction.copy()
        for i in range(loads.size):
            way = compliance[i] @ (loads + friction)
            friction[i] = np.clip(friction[i] - way / compliance[i, i], -most[i], most[i])
        if np.max(np.abs(friction - before)) < 1e-14:
            return friction
    raise AssertionError("it did not converge")


@pytest.mark.parametrize("n", [1, 5, 40, 80])
def test_many_coordinates_stick_and_slip_together(n: int) -> None:
    """A chain of springs that is pulled here and there: what sticks decides what slips."""
    random = np.random.default_rng(n)
    matrix = 2.05 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    loads, most = random.normal(size=n), 0.1 + random.random(n)
    ways, friction, iterations = settled(matrix, loads, most)
    np.testing.assert_allclose(friction, projected(matrix, loads, most), rtol=0.0, atol=1e-11)
    sticks = ways == 0.0
    assert np.all(np.abs(friction[sticks]) <= most[sticks])
    assert np.all(friction[~sticks] == -np.sign(ways[~sticks]) * most[~sticks])
    assert iterations < 40 and (n == 1 or 0 < sticks.sum() < n)


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
    names = [name_of(i) for coulomb, name_of in friction_of(stepper) for i in range(coulomb.sign.size)]
    assert len(names) == 4 and len(set(names)) == 4
    for coulomb, _ in friction_of(stepper):
        coulomb.missed[-1] = 1
    for _ in range(2):
        watch.friction(0.2, 0.01)
    assert [x["text"].split(" jams in a step of 0.01 s at or before t = 0.2 s")[0] for x in told] \
        == ["slider 'bush'", "sleeve 'bush': twist", "joint 'hinge'"]
    assert {x["kind"] for x in told} == {"unresolved"}
