"""Contact that pushes only: where a point is beside its beam, when it lifts off and what happens when it comes back
(theory.md 5.9)."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .impacts import jump
from .kernels.along import FREE, HELD, HISTORY, SIGN, STICKS, STOP_LOSS
from .kernels.work import State
from .mapping import contact, shapes_at
from .model import Model

Array = np.ndarray
# a point is beside the beam, not beyond its ends, and meets it, within this share of its length
ON_AXIS = 1e-9
# the last step of the search for the nearest point is as short, as a share of the length
NEAR = 1e-8


@dataclass
class Place:
    """Where a point is beside a beam: arc length of the nearest point, m; distance on its side, m, negative on the other; whether
    it is beside the beam; unit normal [3]; what of the gap is neither along the beam nor the normal, m."""

    s: float
    distance: float
    is_between_ends: bool
    normal: Array
    off: float


def place_of(model: Model, state: State, k: int) -> Place:
    """Where the point of slider k is, from the s of the state on."""
    q = state.q.reshape(-1, 4, 3)
    length, (low, high) = float(model.slider_lengths[k]), model.slider_ends[k]
    s = float(state.s[k])
    point = q[int(model.sliders.point[k]), 0]  # type: ignore[union-attr]
    for _ in range(20):
        nodes, shapes = shapes_at(model, k, s)
        at, tangent, bend = shapes @ q[nodes, 0]
        gap = point - at
        slope = tangent @ tangent - gap @ bend
        way = float(gap @ tangent / (slope if slope > 0.5 * (tangent @ tangent) else tangent @ tangent))
        before, s = s, float(np.clip(s + way, low, high))
        # Newton's method squares what is left
        if abs(s - before) <= NEAR * length:
            break
    at, tangent, normal = frame_at(model, q, k, s)
    gap = point - at
    distance, beyond = float(normal @ gap), float(gap @ tangent)
    rest = gap - distance * normal - beyond * tangent
    return Place(s, distance, abs(beyond) <= ON_AXIS * length, normal, float(np.linalg.norm(rest)))


def frame_at(model: Model, q: Array, k: int, s: float) -> tuple[Array, Array, Array]:
    """Place, unit tangent and normal of the curve of slider k at s, on the side where it may lift off; q [N, 4, 3]."""
    nodes, shapes = shapes_at(model, k, s)
    at, tangent, _ = shapes @ q[nodes, 0]
    tangent = tangent / np.linalg.norm(tangent)
    side = model.slider_forces.sides[k] @ np.einsum("n,nic->ic", shapes[0], q[nodes, 1:])
    normal = side - (side @ tangent) * tangent
    return at, tangent, normal / np.linalg.norm(normal)


def pull(model: Model, state: State, k: int, force: Array) -> float:
    """How much the contact force [3] on the point of slider k pulls it towards the beam, N."""
    return -float(frame_at(model, state.q.reshape(-1, 4, 3), k, float(state.s[k]))[2] @ force)


def land(model: Model, state: State, k: int, place: Place, restitution: float) -> tuple[State, float, bool]:
    """The state behind a hit of slider k on its beam, the energy lost, J, and whether it stays on the beam."""
    state = State(*(x.copy() for x in state))
    state.s[k] = place.s
    _, tangent, relative = contact(model, k, place.s, *(x.reshape(-1, 4, 3) for x in (state.q, state.v)))
    towards = min(float(place.normal @ relative), 0.0)
    stays = restitution * towards == 0.0
    if stays:
        lead = np.linalg.svd(tangent[None])[2][1:]
        state, loss = jump(model, state, k, lead, -lead @ relative)
    else:
        state, loss = jump(model, state, k, place.normal[None], np.array([-(1.0 + restitution) * towards]))
    own = state.history[:model.work_place].reshape(-1, HISTORY)
    own[k, STOP_LOSS] += loss
    if stays:
        own[k, HELD], own[k, STICKS] = FREE, 0.0
        own[k, SIGN] = np.sign(relative @ tangent)
    return state, loss, stays
