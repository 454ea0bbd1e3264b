"""Supports that take hold in a run: the impact with which they catch a node, theory.md (4.11a)."""
from __future__ import annotations

import numpy as np

from fastbeam.dynamics.velocity_jumps import jump, settled
from fastbeam.kernels.state import State
from fastbeam.model.maps import mass_map, motion_map
from fastbeam.model.model import Model

Array = np.ndarray


def catch(model: Model, state: State, k: int, t: float) -> tuple[State, float]:
    """Return the state behind support k of `model.released`, which takes hold at time t, and the energy that the impact
    dissipates, J.

    The node stays where it is. Of all jumps of velocities that the scene allows it is the one of least kinetic energy after which
    the node rests, or moves as the support does: momenta stay along what is free. The work of the blow of a support that moves is
    booked with that of its reaction.

    model: Model with tables in space.
    t: s.
    """
    of = model.released
    node, motion = int(of.node[k]), int(of.motion[k])
    caught = State(state.q, state.v, state.s, state.force, state.history.copy())
    caught.history[model.place("released") + k] += 1.0
    bits = int(model.fixed_in(caught)[node] & ~model.fixed_in(state)[node])
    new = np.flatnonzero(bits >> np.arange(6) & 1)
    target = np.zeros(6)
    if motion >= 0:
        target[:3], target[3:] = model.prescribed.motions[motion].rates(t)
    rows = motion_map(state.q.reshape(-1, 4, 3), np.array([node]))[6 * node + new]
    begin, before = settled(model, state, None)
    after, lost = jump(model, begin, None, rows, target[new] - rows @ begin.v)
    after.history[model.place("released") + k] += 1.0
    # velocities that become zero are so to the last bit
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
