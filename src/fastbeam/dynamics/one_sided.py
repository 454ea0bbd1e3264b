"""One-sided contact, which pushes only: place of a point beside its beam, lift-off, and impact when it comes back
(theory.md 5.9)."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fastbeam.dynamics.velocity_jumps import blow, jump
from fastbeam.kernels.contact.nearest_place import Sides, nearest_place_of
from fastbeam.kernels.contact.slider_forces import DRIVE_WORK, FREE, HELD, INCREMENT, SIGN, STICKS, STOP_LOSS
from fastbeam.kernels.empty_arrays import empty
from fastbeam.kernels.entries.dense import Contact
from fastbeam.kernels.state import State
from fastbeam.model.gap_rows import ConstraintGaps, across_of
from fastbeam.model.model import Model
from fastbeam.model.rates import rates_in

Array = np.ndarray
# a point is beside the beam, not beyond its ends, and meets it, within this share of its length
ON_AXIS = 1e-9
# steps of the search for the nearest place
SEARCH = 20


@dataclass
class Place:
    """Place of a point beside a beam: arc length of the nearest point, m; distance on its side, m, negative on the other; whether
    it is between the ends of the beam; unit normal [3]; part of the gap that is neither along the beam nor the normal, m."""

    s: float
    distance: float
    is_between_ends: bool
    normal: Array
    off: float


class Finder:
    """Search for the places of points beside their beams.

    model: Model with tables in space.
    work: work arrays.
    """

    def __init__(self, model: Model, work: Contact) -> None:
        assert model.slider_forces is not None
        self.model, self._work = model, work
        sides = model.slider_forces.sides
        self._sides = Sides(np.cumsum([0, *map(len, sides)]), np.concatenate(sides).reshape(-1))
        # arc lengths between which there is a contact: the ends of the beam, or the places where stops begin
        self.ends = model.slider_forces.free_range(model.limits_at(model.s0))
        self._out = empty(7)

    def place(self, state: State, k: int, search: int = SEARCH) -> Place:
        """Find the place of the point of slider k beside its beam, from the s of the state on; search: number of iterations, 0
        for the place at s itself."""
        model, out = self.model, self._out
        length, (low, high) = float(model.slider_lengths[k]), self.ends[k]
        nearest_place_of(model.curves, model.sliders, self._work, self._sides, k, state.q, float(state.s[k]), low, high, length,
                     search, out)
        return Place(float(out[0]), float(out[1]), abs(float(out[2])) <= ON_AXIS * length, out[4:].copy(), float(out[3]))

    def pull(self, state: State, k: int, force: Array) -> float:
        """Return the part of the contact force [3] on the point of slider k that pulls it towards the beam, N."""
        return -float(self.place(state, k, 0).normal @ force)


def land(model: Model, state: State, k: int, place: Place, restitution: float, t: float) -> tuple[State, float, bool]:
    """Return the state behind a hit of slider k on its beam at time t, the energy lost, J, and whether it stays on the beam."""
    state = State(*(x.copy() for x in state))
    state.s[k] = place.s
    gaps = ConstraintGaps(model).at(state.q, state.s)
    of_point, tangent = gaps.rates[3 * k:3 * k + 3], gaps.tangents[k]
    relative = of_point @ rates_in(model, state)
    stays = restitution * min(float(place.normal @ relative), 0.0) == 0.0
    lead = across_of(tangent) if stays else place.normal[None]

    def change(begin: State) -> Array:
        rates = lead @ (of_point @ rates_in(model, begin))
        return -rates if stays else -(1.0 + restitution) * np.minimum(rates, 0.0)

    _, state, loss = blow(model, state, k, lead, change)
    own = model.along_of(state.history)
    own[k, STOP_LOSS] += loss
    if stays:
        own[k, HELD], own[k, STICKS] = FREE, 0.0
        own[k, SIGN] = np.sign(relative @ tangent)
        if model.slider_forces.tables.drive[k] == INCREMENT:
            # the blow of a drive that gives its velocity along the beam; its work counts as the drive's
            speed = model.slider_forces.speed_given(k, t)
            state, work = jump(model, state, k, np.eye(3), speed * tangent - of_point @ rates_in(model, state))
            own = model.along_of(state.history)
            own[k, DRIVE_WORK] -= work
            own[k, SIGN] = np.sign(speed)
    return state, loss, stays
