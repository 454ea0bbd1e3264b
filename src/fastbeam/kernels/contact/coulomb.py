"""Coulomb's law for coordinates that slide or turn (theory.md 5.6): which of them stick, and in which direction the others slip.

The velocity at the end of the step decides, anew in every iteration: what sticks, Ds = rest, slips once sticking takes more than
the bound; what slips sticks once its velocity has turned around. Where these directions cycle in one coordinate, the fallback
begins: for the rest of the step the increments Ds of all coordinates decide, together and in stages.

    LAW      Coulomb's law with Ds = 0 where one sticks (an active set). It changes in rounds, once Newton's method converges with
             it; if all coordinates cannot change at once, every second one may in a round, then every fourth
    SOFT     friction is -Ds/c as long as that is below the bound, and the bound beyond. c is of the size of the compliance of
             the parts in the step, and made larger until Newton's method converges
    SHARP    the same with a smaller c
    AGAIN    Coulomb's law, from what SHARP leaves: what is below the bound sticks
    LAST     as SHARP: friction below the bound misses Coulomb's law

The stage is that of the step, in `LastIncrement.control`: the order of coordinates makes no difference.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.state import ASKED, CHANGED, FALLBACK, MOVED, MOVED_BEFORE, ROUNDS, SOFTENED, TRIED, WAITED

# changes of the slip direction in one step, or iterations of it, after which Newton's method counts as cycling; iterations that
# evaluate slip directions before convergence counts
MOST_FLIPS, LATE, JUDGED = 6, 12, 2
LAW, SOFT, SHARP, AGAIN, LAST = range(1, 6)
# iterations after which a c counts as not converged, and an active set changes in any case; iterations after which active sets
# count as cycling; rounds after which fewer coordinates may change
PATIENCE, MOST_OF_LAW, TURN = 8, 40, 8
# Newton's method converges if an increment is below the first, relative to the scene, and below the other share of the one before
CLOSE, SHRINKS = 1e-3, 0.25
# factor from c of SOFT to that of SHARP; from c to the next where it does not converge
SHARPER, SOFTER = 1.0 / 64.0, 8.0
# states of a coordinate in the fallback: friction below the bound is that of c; it is that of c beyond the bound, too, if the
# coordinate has just turned around
NEW, SLIPS, STICKS, WITHIN, TURNS = range(5)


class Coulomb(NamedTuple):
    """Coulomb's law for n coordinates, of one run."""

    sign: np.ndarray        # int64 [n]: direction of slip at the end of the step, as taken in this iteration; 0 where it sticks
    rest: np.ndarray        # float64 [n]: increment Ds that leaves the coordinate at rest at the end of the step, m or rad
    against: np.ndarray     # int64 [n]: -1 or 1 where it rests against a rigid stop at the first or the last value, else 0
    flips: np.ndarray       # int64 [n]: number of iterations of the step that have changed the sign
    judged: np.ndarray      # int64 [n]: number of iterations of the step
    branch: np.ndarray      # int64 [n]: NEW, SLIPS, STICKS, WITHIN or TURNS
    missed: np.ndarray      # int64 [n]: number of steps of the run that missed Coulomb's law
    found: np.ndarray       # float64 [n]: compliance of the parts as found last in this step, m/N or rad/(N m); or 0
    first: np.ndarray       # float64 [n]: c of SOFT; 0 until it is known
    compliance: np.ndarray  # float64 [n]: c of this iteration
    inertia: np.ndarray     # float64 [n]: mass of the scene, kg; for angles times the square of its size, kg m^2


class Attempt(NamedTuple):
    """Result of the last iteration for one coordinate."""

    way: float     # increment Ds
    beyond: float  # increment Ds less `rest`, or a number with its sign
    force: float   # force that sticking needs, N or N m
    most: float    # bound of the friction
    more: float    # by which a force that breaks loose exceeds the bound at least
    least: float   # increment Ds that is round-off


def coulomb_of(inertia: np.ndarray) -> Coulomb:
    """Return the record of coordinates with this inertia."""
    n = inertia.size
    return Coulomb(np.zeros(n, np.int64), np.zeros(n), *np.zeros((5, n), np.int64), *np.zeros((3, n)), inertia)


def part_of(coulomb: Coulomb, which: np.ndarray) -> Coulomb:
    """Return a copy of the record for some of its coordinates."""
    return Coulomb(*(x[which] for x in coulomb))


# --- iterations -----------------------------------------------------------------------------------------------------------
@kernel
def cycles(increment):
    """Return whether slip directions cycle, so that the fallback has to begin."""
    return increment.control[FALLBACK] == 0.0 and increment.control[ASKED] != 0.0


@kernel
def begin_fallback(increment):
    """Begin with the first stage."""
    for i in range(CHANGED, increment.control.shape[0]):
        increment.control[i] = 0.0
    increment.control[FALLBACK] = LAW


@kernel
def next_stage(increment):
    """Find the stage of the next iteration."""
    control = increment.control
    stage = control[FALLBACK]
    asked = control[ASKED] != 0.0
    control[CHANGED] = 0.0
    control[ASKED] = 0.0
    if stage == 0.0 and not asked:
        return
    if control[MOVED] <= min(CLOSE, SHRINKS * control[MOVED_BEFORE]) or control[WAITED] >= PATIENCE:
        control[WAITED] = 0.0
        control[ROUNDS] += 1.0
    else:
        control[WAITED] += 1.0
    control[TRIED] += 1.0
    late = control[TRIED] > (MOST_OF_LAW if is_law(stage) else PATIENCE)
    if (stage == SOFT or stage == LAST) and late and not asked:
        control[SOFTENED] += 1.0
        control[TRIED] = 0.0
    elif stage != LAST and (asked or late):
        control[FALLBACK] = stage + 1.0
        control[TRIED] = 0.0
        control[WAITED] = 1.0
        control[ROUNDS] = 0.0


@kernel
def is_law(stage):
    return stage == LAW or stage == AGAIN


@kernel
def softness(increment):
    """Return c of this stage as a share of the first one, 0 where Coulomb's law holds."""
    stage = increment.control[FALLBACK]
    if is_law(stage):
        return 0.0
    soft = SOFTER ** increment.control[SOFTENED]
    return soft if stage == SOFT else soft * SHARPER


@kernel
def may_change(increment, i):
    """Return whether coordinate i may begin to slip or to stick in this iteration of an active set: neighbours that only change
    together never settle."""
    rounds = int(increment.control[ROUNDS])
    share = 1 if rounds < TURN else 2 if rounds < 3 * TURN else 4
    return increment.control[WAITED] == 0.0 and i % share == rounds % share


@kernel
def note_change(changed, increment):
    """Flag in CHANGED that friction has changed between sticking and slipping, or its direction, in this iteration."""
    if changed:
        increment.control[CHANGED] = 1.0


# --- one coordinate -------------------------------------------------------------------------------------------------------
@kernel
def begin_coulomb(coulomb, i, sign, against):
    """Begin a step of coordinate i with the slip direction of the step before."""
    coulomb.sign[i] = sign
    coulomb.against[i] = against
    coulomb.rest[i] = 0.0
    coulomb.flips[i] = 0
    coulomb.judged[i] = 0
    coulomb.branch[i] = NEW
    coulomb.found[i] = 0.0
    coulomb.first[i] = 0.0


@kernel
def begin_iteration(coulomb, i, increment):
    """Begin an iteration of coordinate i, and return whether the fallback decides; if slip directions of this coordinate cycle,
    the next iteration begins it."""
    coulomb.judged[i] += 1
    if increment.control[FALLBACK] != 0.0:
        coulomb.flips[i] = MOST_FLIPS
        coulomb.rest[i] = 0.0
        return True
    if coulomb.judged[i] == LATE or coulomb.flips[i] >= MOST_FLIPS:
        coulomb.flips[i] = MOST_FLIPS
        increment.control[ASKED] = 1.0
    return False


@kernel
def breaks_loose(coulomb, i, force, most):
    """Return -1 or 1 if a sticking coordinate has to move in this direction, else 0; force: the force that holds it."""
    # a rigid stop pushes only
    if force > most and coulomb.against[i] >= 0:
        return -1
    return 1 if force < -most and coulomb.against[i] <= 0 else 0


@kernel
def judge(coulomb, i, increment, h, attempt):
    """Find the slip direction at the end of the step, of size h; `begin_iteration` has been called."""
    # backward in time a velocity has the other sign
    ahead = 1 if h > 0.0 else -1
    if increment.control[FALLBACK] == 0.0:
        sign = coulomb.sign[i]
        if coulomb.judged[i] > 1:
            if sign == 0:
                sign = ahead * breaks_loose(coulomb, i, attempt.force, attempt.most + attempt.more)
            elif sign * ahead * attempt.beyond < 0.0:
                sign = 0
        note_change(sign != coulomb.sign[i], increment)
        coulomb.flips[i] += sign != coulomb.sign[i]
        coulomb.sign[i] = sign
    elif coulomb.against[i] != 0:
        # what rests at a stop stays there for this step
        coulomb.sign[i] = 0
    else:
        judge_in_fallback(coulomb, i, increment, h, ahead, attempt)


@kernel
def judge_in_fallback(coulomb, i, increment, h, ahead, attempt):
    """Find from the increment Ds in which state of the fallback coordinate i is."""
    before, sign = coulomb.branch[i], coulomb.sign[i]
    if coulomb.first[i] == 0.0 and coulomb.found[i] > 0.0:
        # round the compliance up to h^2/inertia times a power of 8: solvers find it to a few digits only
        unit = h * h / coulomb.inertia[i]
        coulomb.first[i] = unit * 8.0 ** np.ceil(np.log2(coulomb.found[i] / unit) / 3.0)
    coulomb.compliance[i] = coulomb.first[i] * softness(increment)
    way, force, bound = ahead * attempt.way, ahead * attempt.force, attempt.most + attempt.more
    to = 1 if way > 0.0 else -1
    turned = before == SLIPS and to != sign
    broken = before == STICKS and abs(force) > bound
    branch = before
    if coulomb.compliance[i] > 0.0:
        branch = WITHIN if abs(way) < coulomb.compliance[i] * attempt.most else TURNS if turned else SLIPS
        sign = to
    elif before == SLIPS or before == STICKS:
        if broken and may_change(increment, i):
            branch, sign = SLIPS, -1 if force > 0.0 else 1
        elif turned and may_change(increment, i):
            branch = STICKS
    else:
        # behind iterations that cycle as they left it, in a step that begins again it sticks
        branch = SLIPS if before == NEW and coulomb.judged[i] > 1 and to == sign else STICKS
    coulomb.branch[i] = branch
    coulomb.sign[i] = 0 if branch == STICKS else sign
    noise = coulomb.inertia[i] / (h * h) * attempt.least
    is_round_off = turned and abs(way) <= attempt.least or broken and abs(force) <= bound + noise
    # soft friction is continuous where it reaches the bound
    stays = branch == before or (branch != STICKS and branch != TURNS and before != STICKS and before != NEW)
    misfits = (turned or broken) and not coulomb.compliance[i] > 0.0
    note_change((misfits or not stays) and not is_round_off, increment)


@kernel
def is_soft(coulomb, i):
    """Return whether friction is -Ds/c in this iteration."""
    return coulomb.branch[i] == WITHIN or coulomb.branch[i] == TURNS


@kernel
def obeys(coulomb, i, increment, h, way, force, breaks):
    """Return whether a converged step obeys Coulomb's law in coordinate i, or no stage is left to try; otherwise the next
    iteration decides anew. way: Ds; force: as it held or rubbed; breaks: whether it exceeds the bound of a coordinate that sticks
    outside the fallback."""
    settled = coulomb.judged[i] >= JUDGED
    stage = increment.control[FALLBACK]
    if stage == 0.0:
        settled = settled and not breaks
    elif coulomb.against[i] == 0:
        if is_soft(coulomb, i) and stage != LAST:
            increment.control[ASKED] = 1.0
            settled = False
        elif coulomb.branch[i] == TURNS or increment.control[CHANGED] != 0.0:
            settled = False
    # friction that would put energy in is rejected: then the increment decides
    if coulomb.rest[i] != 0.0 and h > 0.0 and (force if coulomb.sign[i] == 0 else -1.0 * coulomb.sign[i]) * way > 0.0:
        coulomb.rest[i] = 0.0
        settled = False
    return settled


@kernel
def count_missed(coulomb, i):
    """Count a step that ends off Coulomb's law: the coordinate moves with less friction than the bound."""
    if is_soft(coulomb, i):
        coulomb.missed[i] += 1
