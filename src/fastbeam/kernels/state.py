"""Arrays of a run: its state, and everything that a step writes.

Arrays: of any length: x, y_out [*].
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.jit.decorators import kernel, separate

# `LastIncrement.control` before the first increment of a step: the line is at its start
FROM_START = 2.0
# index in `control`: 1 in the fallback of friction (coulomb.py); the step may then take this many times the iterations
FALLBACK, MORE_ITERATIONS = 3, 5
# index in `control`: 1 if friction began to stick or to slip in this iteration, so that its increment is more than round-off
CHANGED = 4
# indices in `control`: 1 if the fallback is asked for; number of times that all coordinates began again in it; iterations since
# its active set could change, and number of times that it could; size of the last increment, and of the one before
ASKED, BEGUN, WAITED, ROUNDS, MOVED, MOVED_BEFORE = range(5, 11)
CONTROLS = 11


class LastIncrement(NamedTuple):
    """Last increment of a Newton iteration, for stresses that follow it in a straight line (theory.md (4.6))."""

    control: np.ndarray   # float64 [11]: whether the tangent takes it, 0, 1 or FROM_START; size of increments, relative to that
    #                       of the scene, up to which it does not; size of the first increment of the step, -1 before there is
    #                       one; FALLBACK, CHANGED, and those of coulomb.py
    theta: np.ndarray     # float64 [3 N]: Cayley vectors of the step after the increment, the same array as `Work.theta`, padded:
    #                       rows of three are read as rows of four
    x: np.ndarray         # float64 [8 (rows + 1)]: increment of all rows
    off: Any              # float64 [3 N]: positions of tied nodes less those to which x alone leads; terms.NoTies without ties


class Work(NamedTuple):
    """Arrays that a step writes besides the state; sizes are those in space."""

    dphi: np.ndarray      # float64 [3 N]: increments of the positions, padded as theta
    theta: np.ndarray     # float64 [3 N]: Cayley vectors, d_n+1 = cay(theta) d_n
    q_mid: np.ndarray     # float64 [12 N]: coordinates in the middle and at the end of the step, for sliders, ties and bodies;
    #                       empty where there are none
    q_end: np.ndarray     # float64 [12 N]
    u: np.ndarray         # float64 [12 N]: second rates of the coordinates, for bodies
    s_end: np.ndarray     # float64 [S]
    f_ext: np.ndarray     # float64 [8 (rows + 1)]
    r: np.ndarray         # float64 [8 (rows + 1)]
    blocks: np.ndarray    # float64 [8 n (blocks + 1)] for n unknowns per node
    pivots: np.ndarray    # int64 [n rows]
    panel: np.ndarray     # float64 [rows, n, width] flat: right-hand sides of the rows that the solver sees; with sliders of all
    border_rows: np.ndarray  # float64 [7 S + 1, width] flat, 5 in a plane
    schur: np.ndarray     # float64 [7 S, 7 S], 5 in a plane
    y: np.ndarray         # float64 [7 S]
    scratch: np.ndarray   # float64 [*]
    keep_q: np.ndarray    # float64 [12 N]: state before the step; the arrays keep_* are empty where
    #                       a failed step does not change it
    keep_v: np.ndarray    # float64 [12 N]
    keep_s: np.ndarray    # float64 [S]
    keep_force: np.ndarray  # float64 [3 S]
    keep_history: np.ndarray  # float64 [*], as State.history
    keep_dphi: np.ndarray  # float64 [3 N]
    keep_theta: np.ndarray  # float64 [3 N]
    past: np.ndarray      # float64 [4 + 2 (4 S) + 6 N + 1]: mean rates of steps, nodes.remember; the newest of nodes
    #                       are their increments
    keep_past: np.ndarray  # float64 [*], as past
    increment: LastIncrement
    reference_strains: np.ndarray  # float64 [*]: strains free of stress of all elements, and the stress of filters
    #                       (strain_filter.py): of every point 6, in a plane 3, of 8 lanes


class State(NamedTuple):
    """Variables that a step changes; `force` is the contact force of the last step, also the first guess of the next."""

    q: np.ndarray         # float64 [12 N]
    v: np.ndarray         # float64 [12 N]
    s: np.ndarray         # float64 [S]
    force: np.ndarray     # float64 [3 S]
    history: np.ndarray = np.zeros(0)  # float64 [*]: internal variables of terms, as work done


def aligned(n: int) -> np.ndarray:
    """Return n zeros on a cache line, for arrays from which kernels load 8 numbers at a time: unaligned loads touch two cache
    lines each."""
    raw = np.zeros(n + 8)
    shift = (-raw.ctypes.data // 8) % 8
    return raw[shift:shift + n]


@kernel
def copy(x, y_out):
    for i in range(x.shape[0]):
        y_out[i] = x[i]


@kernel
def keep(x, y_out):
    """Copy as many numbers as y_out has: none if it is empty."""
    for i in range(y_out.shape[0]):
        y_out[i] = x[i]


@kernel
def halve(x):
    """Halve all numbers."""
    for i in range(x.shape[0]):
        x[i] *= 0.5


@kernel
def start_increment(work):
    """Prepare the first increment of a step: the tangent takes the stresses of the first guess if that of the step before was
    good, else those at the start of the step. From here on dphi and theta are increments of this step, no longer mean rates of
    the last one: past[3] = 0."""
    work.past[3] = 0.0
    first = work.past[work.past.shape[0] - 1]
    follow_increment(work.increment, first if work.past[0] > 0.0 else np.inf)
    work.increment.control[2] = -1.0
    for i in range(FALLBACK, work.increment.control.shape[0]):
        work.increment.control[i] = 0.0
    if work.increment.control[0] != 0.0:
        work.increment.control[0] = FROM_START


@kernel
def follow_increment(increment, moved):
    """Decide by the size of an increment whether the tangent takes the stresses to which it led in a straight line. The row
    behind the last, which idle lanes of element loops write and read, is cleared."""
    for i in range(increment.x.shape[0] - 8, increment.x.shape[0]):
        increment.x[i] = 0.0
    increment.control[0] = 0.0 if moved <= increment.control[1] else 1.0
    increment.control[MOVED_BEFORE] = increment.control[MOVED]
    increment.control[MOVED] = moved
    if increment.control[2] < 0.0:
        increment.control[2] = moved


@kernel
def clear_equations(work):
    """Start a residual with the loads and a tangent with zeros."""
    for i in range(work.r.shape[0]):
        work.r[i] = -work.f_ext[i]
    for i in range(work.blocks.shape[0]):
        work.blocks[i] = 0.0


@separate
def keep_arrays(state, work):
    """Save the state before a step, and the data of first guesses."""
    keep(state.q, work.keep_q)
    keep(state.v, work.keep_v)
    keep(state.s, work.keep_s)
    keep(state.force, work.keep_force)
    keep(state.history, work.keep_history)
    keep(work.dphi, work.keep_dphi)
    keep(work.theta, work.keep_theta)
    keep(work.past, work.keep_past)


@separate
def restore_arrays(state, work):
    """Restore the arrays that `keep_arrays` saved."""
    copy(work.keep_q, state.q)
    copy(work.keep_v, state.v)
    copy(work.keep_s, state.s)
    copy(work.keep_force, state.force)
    copy(work.keep_history, state.history)
    copy(work.keep_dphi, work.dphi)
    copy(work.keep_theta, work.theta)
    copy(work.keep_past, work.past)
