"""Fallback for Coulomb friction when the iteration on slip directions cycles (theory.md 5.6).

For the rest of the step friction acts against the increment Ds of the coordinate. At first the coordinate sticks. Where sticking
takes more than the bound, or does not converge, the friction is -Ds/c as long as that is less than the bound, and the bound
beyond. The compliance c is at first of the size of the compliance of the parts in the step. It is made smaller whenever Newton's
method has converged with friction below the bound. If a smaller c does not converge, a c between it and the last one that
converged is tried; after the second failure the last one stays. If the first c does not converge, it is made larger. A coordinate
that sticks within the bound, or slips with friction at the bound, obeys Coulomb's law in Ds, whatever c is.

Arrays: flips [n], judged [n], of n coordinates: changes of the slip direction in a step, and iterations that have evaluated it.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.kernels.jit.decorators import kernel
from fastbeam.kernels.state import CHANGED, IN_FALLBACK

# changes of the slip direction in one step, or iterations of it, after which Newton's method counts as cycling
MOST_FLIPS, LATE = 6, 12
# columns of `Fallback.counts`: 0 while the coordinate sticks, then number of c tried; iterations since; 1 if friction of the last
# one was below the bound; number of smaller c that have not converged; number of steps of the run that missed Coulomb's law
LEVEL, TRIED, WITHIN, FAILED, MISSED = range(5)
COUNTS = 5
# most c that are tried; factor from one c to the next; divisor that takes its place once a smaller c has not converged, and
# factor of a first c that has not; number of failures after which c stays
LEVELS, SHARPER, SOFTER, MOST_FAILED = 5, 1.0 / 64.0, 8.0, 2
# iterations after which sticking, or a c, counts as not converged; after which the force that sticking needs is known; iterations
# of a step after which no smaller c is tried
PATIENCE, KNOWN, LATEST = 8, 2, 75


class Fallback(NamedTuple):
    """Friction fallback of n coordinates (module docstring): compliance c and counters."""

    compliance: np.ndarray  # float64 [n]: c of this iteration, m/N or rad/(N m); 0 until it is known
    counts: np.ndarray      # int64 [n, COUNTS]
    inertia: np.ndarray     # float64 [n]: mass of the scene, kg; for angles times the square of its size, kg m^2


def fallback_of(inertia: np.ndarray) -> Fallback:
    """Return the fallback record `Fallback` of coordinates with this inertia, none of which uses the fallback."""
    return Fallback(np.zeros(inertia.size), np.zeros((inertia.size, COUNTS), np.int64), inertia)


@kernel
def clear_fallback(fallback, i):
    """Clear the fallback of coordinate i at the start of a step; the count MISSED of the run stays."""
    fallback.compliance[i] = 0.0
    for c in range(MISSED):
        fallback.counts[i, c] = 0


@kernel
def needs_fallback(flips, judged, i, increment):
    """Return whether the slip direction of coordinate i cycles, and flag it in IN_DOUBT: the step may then take more
    iterations."""
    if judged[i] == LATE:
        flips[i] = MOST_FLIPS
    if flips[i] < MOST_FLIPS:
        return False
    increment.control[IN_FALLBACK] = 1.0
    return True


@kernel
def note_change(changed, increment):
    """Flag in CHANGED that friction has changed between sticking and slipping, or its direction, in this iteration."""
    if changed:
        increment.control[CHANGED] = 1.0


@kernel
def factor(fallback, i):
    """Return the factor from this c to the next smaller one."""
    return SHARPER if fallback.counts[i, FAILED] == 0 else 1.0 / SOFTER


@kernel
def go_back(fallback, i):
    """Return to the last c with which Newton's method has converged, and count the failure."""
    counts = fallback.counts
    fallback.compliance[i] /= factor(fallback, i)
    counts[i, LEVEL] -= 1
    counts[i, TRIED] = 0
    counts[i, FAILED] += 1


@kernel
def sticks_in_fallback(fallback, i, h, found, way, most, breaks):
    """Begin an iteration of coordinate i and return whether it sticks in it; if not, c is in `compliance`. h: size of the step;
    found: compliance that the solver found last, 0 if there is none; way: increment Ds; most: bound of the friction; breaks:
    whether the friction that sticking needed in the last iteration is above the bound."""
    counts = fallback.counts
    counts[i, TRIED] += 1
    tried = counts[i, TRIED]
    if counts[i, LEVEL] == 0 and tried > PATIENCE:
        counts[i, LEVEL] = 1
        counts[i, TRIED] = 1
    elif counts[i, LEVEL] == 1 and counts[i, FAILED] == 0 and tried > PATIENCE:
        fallback.compliance[i] *= SOFTER
        counts[i, TRIED] = 0
    elif counts[i, LEVEL] > 1 and counts[i, FAILED] < MOST_FAILED and tried > PATIENCE:
        go_back(fallback, i)
    if counts[i, LEVEL] > 0 and fallback.compliance[i] == 0.0 and found > 0.0:
        # round the compliance up to h^2/inertia times a power of 8: solvers find it to a few digits only
        unit = h * h / fallback.inertia[i]
        fallback.compliance[i] = unit * 8.0 ** np.ceil(np.log2(found / unit) / 3.0)
    sticks = counts[i, LEVEL] == 0 or not fallback.compliance[i] > 0.0
    if sticks:
        counts[i, WITHIN] = 0 if breaks else 1
    else:
        counts[i, WITHIN] = 1 if abs(way) < fallback.compliance[i] * most else 0
    return sticks


@kernel
def is_sharp(fallback, i, iterations):
    """Return whether the converged step obeys Coulomb's law, or no smaller c is left to try; False asks for another iteration."""
    counts = fallback.counts
    if counts[i, LEVEL] == 0:
        if counts[i, TRIED] < KNOWN:
            return False
        # this coordinate has converged; others may take longer
        counts[i, TRIED] = KNOWN
        if counts[i, WITHIN] == 0:
            counts[i, LEVEL] = 1
            counts[i, TRIED] = 0
        return counts[i, WITHIN] == 1
    counts[i, TRIED] = 0
    if fallback.compliance[i] == 0.0:
        # the coordinate sticks: no compliance was found
        return True
    if counts[i, FAILED] == MOST_FAILED or counts[i, WITHIN] == 0 or counts[i, LEVEL] == LEVELS or iterations > LATEST:
        return True
    counts[i, LEVEL] += 1
    fallback.compliance[i] *= factor(fallback, i)
    return False


@kernel
def count_missed(fallback, flips, i):
    """Count a step that ends off Coulomb's law: the coordinate moves with less friction than the bound, or sticks with more."""
    counts = fallback.counts
    if flips[i] >= MOST_FLIPS and counts[i, LEVEL] > 0 and (counts[i, WITHIN] == 1 or fallback.compliance[i] == 0.0):
        counts[i, MISSED] += 1
