"""Coulomb's law of many coordinates: what each does from one iteration to the next, and where all of them end."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.dynamics.warnings import Watch, friction_of
from fastbeam.kernels.contact.coulomb import (
    AGAIN,
    JUDGED,
    LAST,
    LATE,
    LAW,
    MOST_FLIPS,
    MOST_OF_LAW,
    NEW,
    PATIENCE,
    SHARP,
    SHARPER,
    SLIPS,
    SOFT,
    SOFTER,
    STICKS,
    TURN,
    TURNS,
    WITHIN,
    Attempt,
    Coulomb,
    begin_coulomb,
    begin_fallback,
    begin_iteration,
    coulomb_of,
    count_missed,
    cycles,
    judge,
    may_change,
    next_stage,
    obeys,
)
from fastbeam.kernels.state import (
    ASKED,
    CHANGED,
    CONTROLS,
    FALLBACK,
    MOVED,
    MOVED_BEFORE,
    ROUNDS,
    SOFTENED,
    TRIED,
    WAITED,
    LastIncrement,
)
from fastbeam.stepping.stepper import Stepper

# compliances are rounded up to powers of 8 of h^2/inertia, 1 m/N here
H = 1e-3
FIRST = 8.0**-2


def increment_of(stage: int = 0, **control: float) -> LastIncrement:
    """Return the controls of a step in this stage, in which an active set may change."""
    increment = LastIncrement(np.zeros(CONTROLS), np.zeros(3), np.zeros(8), np.zeros(3))
    increment.control[FALLBACK] = stage
    return increment


def two() -> Coulomb:
    return coulomb_of(np.full(2, H * H))


def iterate(coulomb: Coulomb, increment: LastIncrement, way: float = 1e-5, force: float = 0.0, found: float = 3e-3,
            most: float = 1.0, least: float = 0.0, h: float = H) -> int:
    """Return the slip direction of coordinate 1 in an iteration."""
    coulomb.found[1] = found
    begin_iteration(coulomb, 1, increment)
    judge(coulomb, 1, increment, h, Attempt(way, way - coulomb.rest[1], force, most, 0.0, least))
    return int(coulomb.sign[1])


def stages(increment: LastIncrement, asks: bool, n: int) -> list[int]:
    """Return the stages of n iterations."""
    out = []
    for _ in range(n):
        increment.control[ASKED] = float(asks)
        next_stage(increment)
        out.append(int(increment.control[FALLBACK]))
    return out


def test_stages_that_converge_follow_each_other() -> None:
    assert stages(increment_of(), False, 3) == [0, 0, 0]
    assert stages(increment_of(), True, 7) == [LAW, SOFT, SHARP, AGAIN, LAST, LAST, LAST]


def test_stages_that_do_not_converge_end() -> None:
    increment = increment_of(SOFT)
    assert stages(increment, False, PATIENCE + 1) == [SOFT] * (PATIENCE + 1) and increment.control[SOFTENED] == 1.0
    for stage, most in ((LAW, MOST_OF_LAW), (SHARP, PATIENCE), (AGAIN, MOST_OF_LAW)):
        assert stages(increment_of(stage), False, most + 1) == [stage] * most + [stage + 1]
    increment = increment_of(LAST)
    assert stages(increment, False, PATIENCE + 1)[-1] == LAST and increment.control[SOFTENED] == 1.0


def test_many_changes_of_sign_and_many_iterations_begin_the_fallback_of_all() -> None:
    for flips, judged, expected in ((MOST_FLIPS - 1, 3, False), (MOST_FLIPS, 3, True), (0, LATE - 1, True)):
        increment, coulomb = increment_of(), two()
        coulomb.flips[0], coulomb.judged[0], coulomb.rest[1] = flips, judged, 1.0
        assert not begin_iteration(coulomb, 0, increment) and cycles(increment) is expected
        next_stage(increment)
        assert begin_iteration(coulomb, 1, increment) is expected
        assert increment.control[FALLBACK] == (LAW if expected else 0) and coulomb.rest[1] == float(not expected)
        assert (coulomb.flips[1] == MOST_FLIPS) == expected


def test_the_velocity_at_the_end_decides_at_first() -> None:
    coulomb, increment = two(), increment_of()
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
        assert obeys(coulomb, 1, increment_of(), H, way, force, False) is is_settled
        assert coulomb.rest[1] == (1e-5 if is_settled else 0.0)
        coulomb.rest[1] = 1e-5
        # steps backward in time undo what others did
        assert obeys(coulomb, 1, increment_of(), -H, way, force, False)
        assert not obeys(coulomb, 1, increment_of(), -H, way, force, True)
        coulomb.judged[1] = JUDGED - 1
        assert not obeys(coulomb, 1, increment_of(), -H, way, force, False)


@pytest.mark.parametrize("found", [3e-3, 3.001e-3, 2.0**-9 * 1.01])
@pytest.mark.parametrize("unit", [1.0, 1.7e5])
def test_compliances_that_differ_a_little_are_taken_for_one_in_all_units(found: float, unit: float) -> None:
    for stage, factor in ((SOFT, 1.0), (SHARP, SHARPER), (LAST, SHARPER), (LAW, 0.0), (AGAIN, 0.0)):
        coulomb = coulomb_of(np.full(2, H * H / unit))
        iterate(coulomb, increment_of(stage), found=found * unit)
        np.testing.assert_allclose(coulomb.compliance, [0.0, FIRST * factor * unit], rtol=1e-14)


def test_a_compliance_that_does_not_converge_gets_larger() -> None:
    increment, coulomb = increment_of(SOFT), two()
    increment.control[SOFTENED] = 1.0
    iterate(coulomb, increment)
    assert coulomb.compliance[1] == FIRST * SOFTER


def test_soft_friction_is_the_bound_beyond_it() -> None:
    coulomb, increment = two(), increment_of(SOFT)
    assert iterate(coulomb, increment, way=0.9 * FIRST) == 1 and coulomb.branch[1] == WITHIN
    assert iterate(coulomb, increment, way=1.1 * FIRST) == 1 and coulomb.branch[1] == SLIPS
    # what turns around is soft for an iteration, whatever the bound, and does not count as converged
    increment.control[CHANGED] = 0.0
    assert iterate(coulomb, increment, way=-1.1 * FIRST) == -1 and coulomb.branch[1] == TURNS
    assert increment.control[CHANGED] == 1.0 and not obeys(coulomb, 1, increment_of(LAST), H, 1.0, 0.0, False)
    assert iterate(coulomb, increment, way=-1.1 * FIRST) == -1 and coulomb.branch[1] == SLIPS


def test_what_is_within_the_bound_sticks_until_it_needs_more() -> None:
    coulomb = two()
    iterate(coulomb, increment_of(SHARP), way=0.9 * SHARPER * FIRST)
    assert iterate(coulomb, increment_of(AGAIN), force=0.9) == 0 and coulomb.branch[1] == STICKS
    assert iterate(coulomb, increment_of(AGAIN), force=0.9) == 0 and obeys(coulomb, 1, increment_of(AGAIN), H, 0.0, 0.9, False)
    for force, sign in ((1.1, -1), (-1.1, 1)):
        coulomb.branch[1], increment = STICKS, increment_of(AGAIN)
        assert iterate(coulomb, increment, force=force) == sign and coulomb.branch[1] == SLIPS
        assert not obeys(coulomb, 1, increment, H, 0.0, force, False)
    assert iterate(coulomb, increment_of(AGAIN), way=1e-5) == 1 and obeys(coulomb, 1, increment_of(AGAIN), H, 1e-5, -1.0, False)
    assert iterate(coulomb, increment_of(AGAIN), way=-1e-5) == 0 and coulomb.branch[1] == STICKS
    begin_coulomb(coulomb, 1, 1, 0)
    assert coulomb.branch[1] == NEW and coulomb.first[1] == 0.0
    # what goes on as in the step before slips, what has turned around sticks
    assert iterate(coulomb, increment_of(LAW), way=1e-5) == 1 and coulomb.branch[1] == SLIPS
    begin_coulomb(coulomb, 1, 1, 0)
    assert iterate(coulomb, increment_of(LAW), way=-1e-5) == 0 and coulomb.branch[1] == STICKS


def test_an_active_set_changes_once_newtons_method_converges() -> None:
    increment = increment_of()
    begin_fallback(increment)
    increment.control[[MOVED, MOVED_BEFORE]] = 1.0, 1.0
    opens = []
    for _ in range(PATIENCE + 2):
        next_stage(increment)
        opens.append(increment.control[WAITED] == 0.0)
    # it waits no longer than PATIENCE iterations
    assert opens == [False] * PATIENCE + [True, False]
    increment.control[[MOVED, MOVED_BEFORE]] = 0.1, 1.0
    next_stage(increment)
    assert increment.control[WAITED] == 0.0 and increment.control[ROUNDS] == 2.0 and increment.control[TRIED] == PATIENCE + 3
    coulomb = two()
    coulomb.branch[1] = STICKS
    assert iterate(coulomb, increment, force=2.0) == -1
    coulomb.branch[1], increment.control[WAITED], increment.control[CHANGED] = STICKS, 1.0, 0.0
    coulomb.sign[1] = 0
    assert iterate(coulomb, increment, force=2.0) == 0 and increment.control[CHANGED] == 1.0


def test_coordinates_that_cannot_change_together_take_turns() -> None:
    increment = increment_of(LAW)
    for rounds, expected in ((TURN - 1, range(8)), (TURN, (0, 2, 4, 6)), (TURN + 1, (1, 3, 5, 7)), (3 * TURN + 1, (1, 5))):
        increment.control[ROUNDS] = rounds
        assert [i for i in range(8) if may_change(increment, i)] == list(expected)


def test_round_off_changes_nothing() -> None:
    coulomb, increment = two(), increment_of(LAW)
    coulomb.branch[1], coulomb.sign[1] = SLIPS, 1
    assert iterate(coulomb, increment, way=-1e-15, least=1e-14) == 0 and increment.control[CHANGED] == 0.0
    assert iterate(coulomb, increment, force=1.0 + 1e-15, least=1e-14) == -1 and increment.control[CHANGED] == 0.0


def test_friction_that_stays_soft_has_missed_coulombs_law() -> None:
    coulomb = two()
    for _ in range(JUDGED):
        iterate(coulomb, increment_of(LAST), way=0.9 * SHARPER * FIRST)
    increment = increment_of(SOFT)
    assert not obeys(coulomb, 1, increment, H, 1.0, -0.9, False) and increment.control[ASKED] == 1.0
    assert obeys(coulomb, 1, increment_of(LAST), H, 1.0, -0.9, False)
    count_missed(coulomb, 1)
    coulomb.branch[1] = STICKS
    count_missed(coulomb, 1)
    begin_coulomb(coulomb, 1, 0, 0)
    count_missed(coulomb, 1)
    assert coulomb.missed.tolist() == [0, 1]


def settled(matrix: np.ndarray, loads: np.ndarray, most: np.ndarray, begin: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Return increments and friction of coordinates that springs couple, matrix @ ways = loads + friction, and iterations."""
    n, coulomb, increment = loads.size, coulomb_of(np.ones(loads.size)), increment_of()
    begin_fallback(increment)
    increment.control[FALLBACK] = begin
    coulomb.found[:] = np.diag(np.linalg.inv(matrix))
    ways, friction = np.zeros(n), np.zeros(n)
    for iteration in range(1, 100):
        next_stage(increment)
        for i in range(n):
            begin_iteration(coulomb, i, increment)
            judge(coulomb, i, increment, 1.0, Attempt(ways[i], ways[i], friction[i], most[i], 0.0, 0.0))
        soft, sticks = (coulomb.branch == WITHIN) | (coulomb.branch == TURNS), coulomb.branch == STICKS
        given = np.where(sticks | soft, 0.0, -coulomb.sign * most)
        springs = np.where(soft, 1.0 / np.where(soft, coulomb.compliance, 1.0), 0.0)
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


@pytest.mark.parametrize("begin", [LAW, SOFT])
@pytest.mark.parametrize("n", [1, 5, 40, 80])
def test_many_coordinates_stick_and_slip_together(n: int, begin: int) -> None:
    """A chain of springs that is pulled here and there: what sticks decides what slips."""
    random = np.random.default_rng(n)
    matrix = 2.05 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    loads, most = random.normal(size=n), 0.1 + random.random(n)
    ways, friction, iterations = settled(matrix, loads, most, begin)
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
