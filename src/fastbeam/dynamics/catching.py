"""Supports that take hold in a run: the impact with which they catch a node, theory.md (4.11a)."""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.dynamics.velocity_jumps import jump, settled
from fastbeam.kernels.state import State
from fastbeam.model.maps import mass_map
from fastbeam.model.model import Model

Array = np.ndarray


def catch(model: Model, state: State, k: int, t: float) -> tuple[State, float]:
    """The state behind support k of `model.released`, which takes hold at time t, and the energy that the impact takes, J.

    The node stays where it is. Of all jumps of velocities that the scene allows it is the one of least kinetic energy after which
    the node rests, or moves as the support does: momenta stay along what is free. The work of the blow of a support that moves is
    booked with that of its reaction.

    Parameters
    ----------
    model : Model
        With tables in space.
    state : State
    k : int
    t : float
        s.
    """
    of = model.released
    node, motion = int(of.node[k]), int(of.motion[k])
    caught = State(state.q, state.v, state.s, state.force, state.history.copy())
    caught.history[model.place("released") + k] += 1.0
    bits = int(model.held_in(caught)[node] & ~model.held_in(state)[node])
    new = np.flatnonzero(bits >> np.arange(6) & 1)
    target = np.zeros(6)
    if motion >= 0:
        target[:3], target[3:] = model.prescribed.motions[motion].rates(t)
    rows = _motion_of(state.q, node)[new]
    begin, before = settled(model, state, None)
    after, lost = jump(model, begin, None, rows, target[new] - rows @ begin.v)
    after.history[model.place("released") + k] += 1.0
    # what rests does so to the last bit
    mine = np.flatnonzero(model.pattern.row_of == model.pattern.row_of[node])
    v = after.v.reshape(-1, 4, 3)
    v[mine[:, None], 0, new[new < 3]] = target[new[new < 3]]
    if bits & 56 == 56 and not target[3:].any():
        v[mine, 1:] = 0.0
    if motion >= 0:
        by = after.v - begin.v
        loss = 0.5 * float(by @ (mass_map(model) @ by))
        after.history[model.works_place + motion] += loss - lost
        lost = loss
    lost += before
    after.history[model.losses_for(type(of)) + int(np.sum(of.waits[:k]))] += lost
    return after, lost


def _motion_of(q: Array, node: int) -> Any:
    """Rates of the coordinates -> velocity and spin of a node, sparse [6, 12 N]."""
    from scipy import sparse
    d = q.reshape(-1, 4, 3)[node, 1:]
    block = np.zeros((6, 12))
    block[:3, :3] = np.eye(3)
    # half the sum of d x d'
    block[3:, 3:] = 0.5 * np.concatenate([np.cross(x, np.eye(3)).T for x in d], axis=1)
    rows, columns = np.nonzero(block)
    return sparse.csr_matrix((block[rows, columns], (rows, 12 * node + columns)), shape=(6, q.size))
