"""Coulomb's law for coordinates that slide or turn (theory.md 5.6): which of them stick, and in which direction the others slip.

The velocity at the end of the step decides, anew in every iteration: what sticks, Ds = rest, slips once sticking takes more than
the bound; what slips sticks once its velocity has turned around. Where these directions cycle in one coordinate, the fallback
begins: for the rest of the step the increments Ds of all coordinates decide, Ds = 0 where one sticks.

What sticks and what slips is an active set. It changes in rounds, whenever Newton's method converges with it; if all
coordinates cannot change at once, every second one may in a round, then every fourth. A coordinate that goes to and fro gets
soft friction: -Ds/c as long as that is below the bound, and the bound beyond, c of the size of the compliance of the parts in
the step. The first time it sticks again once Newton's method has converged with friction below the bound. The second time c is
made smaller instead. If a smaller c does not converge, a c between it and the last one that converged is tried; after the
second failure the last one stays. If the first c does not converge, it is made larger. If Newton's method does not converge
with a set that would stay, all coordinates stick at first, then all have soft friction. A coordinate that sticks within the
bound, or slips with friction at the bound, obeys Coulomb's law in Ds, whatever c is; one that ends with friction below the
bound misses it.

Rounds are those of the step, in `LastIncrement.control`: the order of coordinates makes no difference.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.state import ASKED, BEGUN, CHANGED, FALLBACK, MOVED, MOVED_BEFORE, ROUNDS, WAITED

# changes of the slip direction in one step, or iterations of it, after which Newton's method counts as cycling, but not where
# increments are small already; iterations that evaluate slip directions before convergence counts
MOST_FLIPS, LATE, NEARLY, JUDGED = 6, 12, 1e-8, 2
# iterations after which Newton's method counts as not converging with a set; rounds after which fewer coordinates may change;
# rounds in which a coordinate may change before its friction is soft
PATIENCE, TURN, MOST_TURNS = 8, 8, 5
# Newton's method converges if an increment is below the first, relative to the scene, and below the other share of the one before
CLOSE, SHRINKS = 1e-3, 0.25
# most c that are tried; factor from one c to the next; divisor that takes its place once a smaller c has not converged, and
# factor of a first c that has not; number of failures after which c stays
LEVELS, SHARPER, SOFTER, MOST_FAILED = 5, 1.0 / 64.0, 8.0, 2
# value of WAITED in an iteration in which all coordinates begin again
ANEW = -1.0
# states of a coordinate in the fallback; the last two have soft friction, at the bound and below it
NEW, SLIPS, STICKS, BEYOND, WITHIN = range(5)
# columns of `soft`: 0 while there is no soft friction, then number of c tried; iterations since; number of smaller c that have
# not converged; 1 if the coordinate had soft friction before, and stuck again
LEVEL, TRIED, FAILED, AGAIN = range(4)


class Coulomb(NamedTuple):
    """Coulomb's law for n coordinates, of one run."""

    sign: np.ndarray        # int64 [n]: direction of slip at the end of the step, as taken in this iteration; 0 where it sticks
    rest: np.ndarray        # float64 [n]: increment Ds that leaves the coordinate at rest at the end of the step, m or rad
    against: np.ndarray     # int64 [n]: -1 or 1 where it rests against a rigid stop at the first or the last value, else 0
    flips: np.ndarray       # int64 [n]: number of iterations of the step that have changed the sign
    turns: np.ndarray       # int64 [n]: number of rounds that have changed the state since friction was soft
    judged: np.ndarray      # int64 [n]: number of iterations of the step
    branch: np.ndarray      # int64 [n]: NEW, SLIPS, STICKS, BEYOND or WITHIN
    missed: np.ndarray      # int64 [n]: number of steps of the run that missed Coulomb's law
    found: np.ndarray       # float64 [n]: compliance of the parts as found last in this step, m/N or rad/(N m); or 0
    compliance: np.ndarray  # float64 [n]: c; 0 until it is known
    soft: np.ndarray        # int64 [n, 4]: LEVEL, TRIED, FAILED and AGAIN
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
    return Coulomb(np.zeros(n, np.int64), np.zeros(n), *np.zeros((6, n), np.int64), *np.zeros((2, n)), np.zeros((n, 4), np.int64),
                   inertia)


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
    """Begin the fallback with the next iteration."""
    for i in range(CHANGED, increment.control.shape[0]):
        increment.control[i] = 0.0
    increment.control[FALLBACK] = 1.0


@kernel
def begin_round(increment):
    """Find whether the active set may change in the next iteration."""
    control = increment.control
    asked, changed = control[ASKED] != 0.0, control[CHANGED] != 0.0
    control[CHANGED] = 0.0
    control[ASKED] = 0.0
    if control[FALLBACK] == 0.0:
        control[FALLBACK] = 1.0 if asked else 0.0
        return
    if control[MOVED] <= min(CLOSE, SHRINKS * control[MOVED_BEFORE]) or changed and control[WAITED] >= PATIENCE:
        control[WAITED] = 0.0
        control[ROUNDS] += 1.0
    elif control[WAITED] >= PATIENCE:
        control[WAITED] = ANEW
        control[BEGUN] += 1.0
    else:
        control[WAITED] = max(control[WAITED], 0.0) + 1.0


@kernel
def may_change(increment, i):
    """Return whether coordinate i may begin to slip or to stick in this iteration: neighbours that only change together never
    settle."""
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
    coulomb.turns[i] = 0
    coulomb.found[i] = 0.0
    coulomb.compliance[i] = 0.0
    for c in range(4):
        coulomb.soft[i, c] = 0


@kernel
def begin_iteration(coulomb, i, increment):
    """Begin an iteration of coordinate i, and return whether the fallback decides; if slip directions of this coordinate cycle,
    the next iteration begins it."""
    coulomb.judged[i] += 1
    if increment.control[FALLBACK] != 0.0:
        coulomb.flips[i] = MOST_FLIPS
        coulomb.rest[i] = 0.0
        return True
    late = coulomb.judged[i] >= LATE and increment.control[MOVED] > NEARLY
    if late or coulomb.flips[i] >= MOST_FLIPS:
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
    before, sign, waited = coulomb.branch[i], coulomb.sign[i], increment.control[WAITED]
    way, force, bound = ahead * attempt.way, ahead * attempt.force, attempt.most + attempt.more
    to = 1 if way > 0.0 else -1
    if coulomb.compliance[i] == 0.0 and coulomb.found[i] > 0.0:
        # round the compliance up to h^2/inertia times a power of 8: solvers find it to a few digits only
        unit = h * h / coulomb.inertia[i]
        coulomb.compliance[i] = unit * 8.0 ** np.ceil(np.log2(coulomb.found[i] / unit) / 3.0)
    branch = before
    if waited == ANEW:
        branch = STICKS
        if increment.control[BEGUN] > 1.0 and coulomb.compliance[i] > 0.0 and coulomb.soft[i, LEVEL] == 0:
            begin_soft(coulomb, i, 1)
    elif before == NEW:
        # behind iterations that cycle as they left it, in a step that begins again it sticks
        branch = SLIPS if coulomb.judged[i] > 1 and to == sign else STICKS
    elif before == SLIPS and to != sign:
        if may_change(increment, i):
            branch = STICKS
        note_change(abs(way) > attempt.least, increment)
    elif before == STICKS and abs(force) > bound:
        if may_change(increment, i):
            branch = SLIPS
            sign = -1 if force > 0.0 else 1
        note_change(abs(force) > bound + coulomb.inertia[i] / (h * h) * attempt.least, increment)
    if waited == 0.0 and branch != before and before != NEW:
        coulomb.turns[i] += 1
        if coulomb.turns[i] > MOST_TURNS and coulomb.compliance[i] > 0.0:
            begin_soft(coulomb, i, coulomb.soft[i, AGAIN])
    if coulomb.soft[i, LEVEL] > 0:
        soften_or_sharpen(coulomb, i)
        branch = WITHIN if abs(way) < coulomb.compliance[i] * attempt.most else BEYOND
        sign = to
    elif before == NEW or waited == ANEW:
        note_change(True, increment)
        sign = to
    coulomb.branch[i] = branch
    coulomb.sign[i] = 0 if branch == STICKS else sign


@kernel
def begin_soft(coulomb, i, again):
    """Begin with soft friction of coordinate i; again: 1 if it does not stick again afterwards."""
    coulomb.turns[i] = 0
    coulomb.soft[i, LEVEL] = 1
    coulomb.soft[i, TRIED] = 0
    coulomb.soft[i, FAILED] = 0
    coulomb.soft[i, AGAIN] = again


@kernel
def factor(coulomb, i):
    """Return the factor from this c to the next smaller one."""
    return SHARPER if coulomb.soft[i, FAILED] == 0 else 1.0 / SOFTER


@kernel
def soften_or_sharpen(coulomb, i):
    """Count an iteration with this c; if Newton's method does not converge with it, take a larger one, or the last one with which
    it has converged."""
    soft = coulomb.soft
    soft[i, TRIED] += 1
    if soft[i, TRIED] <= PATIENCE:
        return
    if soft[i, LEVEL] == 1 and soft[i, FAILED] == 0:
        coulomb.compliance[i] *= SOFTER
        soft[i, TRIED] = 0
    elif soft[i, LEVEL] > 1 and soft[i, FAILED] < MOST_FAILED:
        coulomb.compliance[i] /= factor(coulomb, i)
        soft[i, LEVEL] -= 1
        soft[i, TRIED] = 0
        soft[i, FAILED] += 1


@kernel
def is_soft(coulomb, i):
    """Return whether friction is -Ds/c in this iteration."""
    return coulomb.branch[i] == WITHIN


@kernel
def is_sharp(coulomb, i):
    """Return whether the converged step obeys Coulomb's law in coordinate i with soft friction, or no smaller c is left to try;
    otherwise the coordinate sticks again, or c is made smaller."""
    soft = coulomb.soft
    soft[i, TRIED] = 0
    if coulomb.branch[i] != WITHIN:
        return True
    if soft[i, AGAIN] == 0:
        soft[i, AGAIN] = 1
        soft[i, LEVEL] = 0
        coulomb.branch[i] = STICKS
        return False
    if soft[i, FAILED] == MOST_FAILED or soft[i, LEVEL] == LEVELS:
        return True
    soft[i, LEVEL] += 1
    coulomb.compliance[i] *= factor(coulomb, i)
    return False


@kernel
def obeys(coulomb, i, increment, h, way, force, breaks):
    """Return whether a converged step obeys Coulomb's law in coordinate i, or friction stays soft; otherwise the next iteration
    decides anew. way: Ds; force: as it held or rubbed; breaks: whether it exceeds the bound of a coordinate that sticks, outside
    the fallback."""
    settled = coulomb.judged[i] >= JUDGED
    if increment.control[FALLBACK] == 0.0:
        settled = settled and not breaks
    elif coulomb.against[i] == 0:
        if increment.control[CHANGED] != 0.0:
            settled = False
        if coulomb.soft[i, LEVEL] > 0 and not is_sharp(coulomb, i):
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
