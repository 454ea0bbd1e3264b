"""Loads that turn, and forces by laws, along a path of equilibria (theory.md 12)."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.forces.loads import factor_at
from fastbeam.model.model import Model
from fastbeam.scene import Beam, UserForce

Array = np.ndarray
# number of times between two given ones, where functions of time may vanish, at which laws are tried; share that counts as zero
PLACES, NOTHING = 33, 1e-6


class LawPath(NamedTuple):
    """Forces by laws on a path: time of evaluation, factor at load factor 0, and its change until load factor 1."""

    time: float
    first: float
    change: float
    shares: tuple[Array, Array] | None = None    # the same, [K] each, of every node with a law; None: equal for all

    @property
    def moves(self) -> bool:
        """True where any force by a law changes along the path."""
        return self.change != 0.0 if self.shares is None else bool(np.any(self.shares[1]))

    @property
    def begins(self) -> bool:
        """True where any force by a law acts at load factor 0."""
        return self.first != 0.0 if self.shares is None else bool(np.any(self.shares[0]))


def user_forces(model: Model) -> list[UserForce]:
    """Return forces by laws on nodes and along beams, and loads that turn."""
    return model.uneliminated.scene.user_forces if model.user_forces else []  # type: ignore[union-attr]


def laws_grow(model: Model) -> bool:
    """Return whether forces by laws, or of moving air, grow with the load factor."""
    return any(force.grows for force in user_forces(model)) or model.blows


def law_path(who: str, model: Model, at_time: float | tuple[float, float] | None, grow: bool) -> LawPath:
    """Return the path of loads that turn and of forces by laws; grow: whether loads at one time grow from zero, or stay. Raises
    SceneError: between two times a law is no load that turns, or its function of time has no value to compare with."""
    forces = user_forces(model)
    if not isinstance(at_time, tuple):
        return LawPath(at_time or 0.0, 0.0 if grow else 1.0, 1.0 if grow else 0.0)
    if not model.user_forces:
        return LawPath(0.0, 1.0, 0.0)
    require(Analysis.TWO_TIMES, model, who)

    def values(t: float) -> Array:
        return np.array([1.0 if x.time is None else factor_at(x.time, t, f"of {x.kind} {x.name!r}") for x in forces])

    a, b = (values(t) for t in at_time)
    size = np.maximum(np.abs(a), np.abs(b))
    times = at_time[0] + (at_time[1] - at_time[0]) * np.concatenate(([1.0, 0.0], np.linspace(0.0, 1.0, PLACES)[1:-1]))
    best = max(times.tolist(), key=lambda t: float(np.min(np.abs(values(t)[size > 0.0]) / size[size > 0.0], initial=1.0)))
    at = values(best)
    if np.any((np.abs(at) < NOTHING * size) & (size > 0.0)):
        raise SceneError(f"solve_path: at_time={at_time}: time functions of loads with follower=True vanish one after another, "
                         "so no single time gives the factors of all of them; compute one case after the other")
    counts = [x.at.basis.n_nodes if isinstance(x.at, Beam) else 1 for x in forces]
    first, change = (np.repeat(np.where(size > 0.0, x / np.where(size > 0.0, at, 1.0), 0.0), counts) for x in (a, b - a))
    return LawPath(float(best), 1.0, 0.0, (first, change))
