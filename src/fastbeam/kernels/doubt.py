"""Coulomb friction where the signs of a step go in circles (theory.md 5.6): for the rest of the step its force is -Ds/c, Ds the
increment of the coordinate, as long as that is less than the bound, and the bound beyond. c is at first of the size of the
compliance of the parts in the step. Whenever Newton's method has converged with less than the bound, c is made smaller, and at
last the coordinate sticks: what is reached is Coulomb's law in Ds, which does not depend on c. Where a smaller c does not
converge, the one before stays, and where the first does not, it is made larger.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._jit import kernel

# after so many changes of a sign in one step Newton's method goes in circles, and after so many iterations as well
MOST_FLIPS, LATE = 6, 12
# columns of `Doubt.counts`: how many times c was made smaller; iterations since then; whether the last one took less than the
# bound; whether c stays
LEVEL, TRIED, WITHIN, FINAL = range(4)
COUNTS = 4
# c is made smaller by this factor so many times; then the coordinate sticks. The first is made larger by the other
SHARPER, LEVELS, SOFTER = 1.0 / 64.0, 2, 8.0
# iterations after which a c has not converged, and iterations of a step after which no smaller one is tried
PATIENCE, LATEST = 5, 19


class Doubt(NamedTuple):
    """Of n coordinates."""

    compliance: np.ndarray  # float64 [n]: c of this iteration, m/N or rad/(N m); 0 where it is not known by now
    counts: np.ndarray      # int64 [n, COUNTS]


def no_doubt(n: int) -> Doubt:
    """Of n coordinates at the start of a step."""
    return Doubt(np.zeros(n), np.zeros((n, COUNTS), np.int64))


@kernel
def clear_doubt(doubt, i):
    """At the start of a step."""
    doubt.compliance[i] = 0.0
    for c in range(COUNTS):
        doubt.counts[i, c] = 0


@kernel
def go_back(doubt, i):
    """To the last c with which Newton's method has converged, which stays for this step."""
    counts = doubt.counts
    counts[i, LEVEL] -= 1
    counts[i, TRIED] = 0
    counts[i, FINAL] = 1
    doubt.compliance[i] /= SHARPER


@kernel
def sticks_in_doubt(doubt, i, found, way, most, breaks):
    """Begin an iteration of coordinate i: whether it sticks in it, else c is in `compliance`. found: compliance that the solver
    has found last, 0 where there is none; way: Ds; most: the bound; breaks: whether what held it in the last iteration is more
    than that, where it stuck."""
    counts = doubt.counts
    if doubt.compliance[i] == 0.0 and found > 0.0:
        # the next power of 8: solvers find it to some digits, with the matrix of the one or other iteration
        doubt.compliance[i] = 8.0 ** np.ceil(np.log2(found) / 3.0)
    counts[i, TRIED] += 1
    if counts[i, LEVEL] == 0 and counts[i, FINAL] == 0 and counts[i, TRIED] > PATIENCE:
        doubt.compliance[i] *= SOFTER
        counts[i, TRIED] = 0
    if counts[i, LEVEL] > 0 and counts[i, FINAL] == 0:
        if counts[i, TRIED] > PATIENCE or (counts[i, LEVEL] == LEVELS and counts[i, TRIED] > 1 and breaks):
            go_back(doubt, i)
    sticks = counts[i, LEVEL] == LEVELS or not doubt.compliance[i] > 0.0
    counts[i, WITHIN] = 1 if sticks or abs(way) < doubt.compliance[i] * most else 0
    return sticks


@kernel
def is_sharp(doubt, i, iterations):
    """Whether Newton's method, which has converged, has done so with Coulomb's law; else c is made smaller."""
    counts = doubt.counts
    if doubt.compliance[i] == 0.0:
        # the next iteration may know it
        return counts[i, TRIED] > 1
    if counts[i, FINAL] != 0 or counts[i, WITHIN] == 0 or counts[i, LEVEL] == LEVELS or iterations > LATEST:
        return True
    counts[i, LEVEL] += 1
    counts[i, TRIED] = 0
    doubt.compliance[i] *= SHARPER
    return False
