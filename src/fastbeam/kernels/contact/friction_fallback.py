"""Coulomb friction where the signs of a step go in circles (theory.md 5.6): for the rest of the step it acts against the
increment Ds of the coordinate. At first the coordinate sticks. Where that takes more than the bound, or does not converge, the
friction is -Ds/c as long as that is less than the bound, and the bound beyond. c is at first of the size of the compliance of the
parts in the step; whenever Newton's method has converged with less than the bound, it is made smaller. Where a smaller c does not
converge, one that is less so is tried from the one before, which stays at last, and where the first does not, it is made larger.
What sticks within the bound, and what slips with all of it, is Coulomb's law in Ds, which does not depend on c.

Arrays: flips [n], judged [n], of n coordinates: changes of sign, and iterations that have asked for it, in a step.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.state import CHANGED, IN_DOUBT

# after so many changes of a sign in one step Newton's method goes in circles, and after so many iterations as well
MOST_FLIPS, LATE = 6, 12
# columns of `Doubt.counts`: 0 where it sticks, then how many c were tried; iterations since then; whether the last one took less
# than the bound; how many smaller c have not converged; how many steps of the run have missed Coulomb's law
LEVEL, TRIED, WITHIN, FAILED, MISSED = range(5)
COUNTS = 5
# so many c are tried, each smaller than the one before by this factor, and by the other once a c has not converged; behind the
# second that has not, c stays. The first c is made larger by the other factor
LEVELS, SHARPER, SOFTER, MOST_FAILED = 5, 1.0 / 64.0, 8.0, 2
# iterations after which sticking or a c has not converged; after which the force that it takes to stick is known; and iterations
# of a step after which no smaller c is tried
PATIENCE, KNOWN, LATEST = 8, 2, 75


class Doubt(NamedTuple):
    """Of n coordinates."""

    compliance: np.ndarray  # float64 [n]: c of this iteration, m/N or rad/(N m); 0 where it is not known by now
    counts: np.ndarray      # int64 [n, COUNTS]
    inertia: np.ndarray     # float64 [n]: of the scene, kg, or of an angle times the square of its size, kg m^2


def no_doubt(inertia: np.ndarray) -> Doubt:
    """At the start of a step."""
    return Doubt(np.zeros(inertia.size), np.zeros((inertia.size, COUNTS), np.int64), inertia)


@kernel
def clear_doubt(doubt, i):
    """At the start of a step."""
    doubt.compliance[i] = 0.0
    for c in range(MISSED):
        doubt.counts[i, c] = 0


@kernel
def is_in_doubt(flips, judged, i, increment):
    """Whether signs of coordinate i go in circles; the step may then take more iterations."""
    if judged[i] == LATE:
        flips[i] = MOST_FLIPS
    if flips[i] < MOST_FLIPS:
        return False
    increment.control[IN_DOUBT] = 1.0
    return True


@kernel
def note_change(changed, increment):
    """Remember that friction has changed its law in this iteration."""
    if changed:
        increment.control[CHANGED] = 1.0


@kernel
def factor(doubt, i):
    """By which the next c is smaller."""
    return SHARPER if doubt.counts[i, FAILED] == 0 else 1.0 / SOFTER


@kernel
def go_back(doubt, i):
    """To the last c with which Newton's method has converged."""
    counts = doubt.counts
    doubt.compliance[i] /= factor(doubt, i)
    counts[i, LEVEL] -= 1
    counts[i, TRIED] = 0
    counts[i, FAILED] += 1


@kernel
def sticks_in_doubt(doubt, i, h, found, way, most, breaks):
    """Begin an iteration of coordinate i: whether it sticks in it, else c is in `compliance`. h: size of the step; found:
    compliance that the solver has found last, 0 where there is none; way: Ds; most: the bound; breaks: whether what held it in
    the last iteration is more than that, where it stuck."""
    counts = doubt.counts
    counts[i, TRIED] += 1
    tried = counts[i, TRIED]
    if counts[i, LEVEL] == 0 and tried > PATIENCE:
        counts[i, LEVEL] = 1
        counts[i, TRIED] = 1
    elif counts[i, LEVEL] == 1 and counts[i, FAILED] == 0 and tried > PATIENCE:
        doubt.compliance[i] *= SOFTER
        counts[i, TRIED] = 0
    elif counts[i, LEVEL] > 1 and counts[i, FAILED] < MOST_FAILED and tried > PATIENCE:
        go_back(doubt, i)
    if counts[i, LEVEL] > 0 and doubt.compliance[i] == 0.0 and found > 0.0:
        # next to the inertia the next power of 8: solvers find it to some digits, at best with the matrix with which it has stuck
        unit = h * h / doubt.inertia[i]
        doubt.compliance[i] = unit * 8.0 ** np.ceil(np.log2(found / unit) / 3.0)
    sticks = counts[i, LEVEL] == 0 or not doubt.compliance[i] > 0.0
    if sticks:
        counts[i, WITHIN] = 0 if breaks else 1
    else:
        counts[i, WITHIN] = 1 if abs(way) < doubt.compliance[i] * most else 0
    return sticks


@kernel
def is_sharp(doubt, i, iterations):
    """Whether Newton's method, which has converged, has done so with Coulomb's law; else a smaller c is tried."""
    counts = doubt.counts
    if counts[i, LEVEL] == 0:
        if counts[i, TRIED] < KNOWN:
            return False
        # it has converged: others may take longer
        counts[i, TRIED] = KNOWN
        if counts[i, WITHIN] == 0:
            counts[i, LEVEL] = 1
            counts[i, TRIED] = 0
        return counts[i, WITHIN] == 1
    counts[i, TRIED] = 0
    if doubt.compliance[i] == 0.0:
        # it sticks, as there is no c
        return True
    if counts[i, FAILED] == MOST_FAILED or counts[i, WITHIN] == 0 or counts[i, LEVEL] == LEVELS or iterations > LATEST:
        return True
    counts[i, LEVEL] += 1
    doubt.compliance[i] *= factor(doubt, i)
    return False


@kernel
def count_missed(doubt, flips, i):
    """At the end of a step: whether it has missed Coulomb's law, as the coordinate moves with less friction than the bound, or
    sticks with more."""
    counts = doubt.counts
    if flips[i] >= MOST_FLIPS and counts[i, LEVEL] > 0 and (counts[i, WITHIN] == 1 or doubt.compliance[i] == 0.0):
        counts[i, MISSED] += 1
