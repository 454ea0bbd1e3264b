"""The arrays of a run: its state, and everything a step writes."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._jit import kernel


class Work(NamedTuple):
    """Everything a step writes besides the state; sizes are those in space."""

    dq: np.ndarray        # float64 [12 N]
    theta: np.ndarray     # float64 [3 N]
    q_mid: np.ndarray     # float64 [12 N]
    q_end: np.ndarray     # float64 [12 N]
    u: np.ndarray         # float64 [12 N]
    s_end: np.ndarray     # float64 [S]
    f_ext: np.ndarray     # float64 [8 (rows + 1)]
    r: np.ndarray         # float64 [8 (rows + 1)]
    blocks: np.ndarray    # float64 [8 n (blocks + 1)] for n unknowns per node
    pivots: np.ndarray    # int64 [n rows]
    panel: np.ndarray     # float64 [rows, n, width] flat
    schur: np.ndarray     # float64 [7 S, 7 S], 5 in a plane
    y: np.ndarray         # float64 [7 S]
    scratch: np.ndarray   # float64
    keep_q: np.ndarray    # float64 [12 N]: state before the step
    keep_v: np.ndarray    # float64 [12 N]
    keep_s: np.ndarray    # float64 [S]
    keep_force: np.ndarray  # float64 [3 S]
    past: np.ndarray      # float64 [3 + 2 (6 N + 4 S)]: mean rates of the last two steps, nodes.remember
    keep_past: np.ndarray
    q_last: np.ndarray    # float64 [12 N]: shape before the last increment, at first that before the step
    q_line: np.ndarray    # float64 [12 N]: where that increment led in a straight line


class State(NamedTuple):
    """What a step changes; `force` is the contact force of the last step, also the first guess of the next."""

    q: np.ndarray         # float64 [12 N]
    v: np.ndarray         # float64 [12 N]
    s: np.ndarray         # float64 [S]
    force: np.ndarray     # float64 [3 S]


@kernel
def copy(x, y_out):
    for i in range(x.shape[0]):
        y_out[i] = x[i]


@kernel
def forget_line(state, work):
    """No increment yet: the tangent takes the stresses before the step."""
    copy(state.q, work.q_last)
    copy(state.q, work.q_line)


@kernel
def clear(inner, work):
    """Start a residual with the loads and a tangent with zeros."""
    if inner is not None:
        inner.state[0] = 1.0
        for i in range(inner.rhs.shape[0]):
            inner.rhs[i] = 0.0
    for i in range(work.r.shape[0]):
        work.r[i] = -work.f_ext[i]
    for i in range(work.blocks.shape[0]):
        work.blocks[i] = 0.0
