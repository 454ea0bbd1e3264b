"""Rates of a state outside of a step: of all coordinates, and of the places of contacts on moving meshes, P of them."""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.state import State
from fastbeam.model.maps import free_unknowns, mass_map, rates_map, velocities_and_spins
from fastbeam.model.model import Model

Array = np.ndarray


def own_shape(model: Model, state: State) -> tuple[Array, Array, Array | None]:
    """Return the coordinates and rates [N, 4, 3] of all nodes in a state, those of moving meshes at the arc lengths of their
    beams; and the coordinates of the nodes of moving meshes [M, 4, 3], None without any."""
    q = state.q.reshape(-1, 4, 3)
    if model.moving is None:
        return q, state.v.reshape(-1, 4, 3), None
    return *model.moving.own_shape(state), q[model.moving.nodes]


def rates_in(model: Model, state: State) -> Array:
    """Return the rates of all coordinates and places in a state, [12 N + P]."""
    return state.v if model.moving is None else np.concatenate((state.v, model.moving.places_in(state.history)))


def with_rates(model: Model, state: State, rates: Array, history: Array) -> State:
    """Return the state with other rates [12 N + P], and this history, which is changed."""
    if model.moving is not None:
        rates, places = np.split(rates, [state.v.size])
        model.moving.put_places(history, places)
    return State(state.q.copy(), rates, state.s.copy(), state.force.copy(), history)


class Motions:
    """Motions that supports and connections allow at a state.

    to_rates: sparse [12 N + P, 6 N + P], map from velocities and spins of rows, and rates of places, to all rates.
    free: int64 [m], numbers of the free ones among these.
    turns: bool [m], true for spins.
    lift: sparse [12 N + P, m], `to_rates` of the free ones.
    masses, inertia: sparse [12 N + P, 12 N + P], masses without those of moving meshes, and all.
    """

    def __init__(self, model: Model, state: State) -> None:
        self.to_rates, self.free = rates_map(model, state.q.reshape(-1, 4, 3)), free_unknowns(model, state)
        self.turns, self.masses = self.free % 6 >= 3, mass_map(model)
        self.inertia = self.masses
        if model.moving is not None:
            places = model.moving.sliders.size
            self.free = np.concatenate((self.free, self.to_rates.shape[1] + np.arange(places)))
            self.turns = np.concatenate((self.turns, np.zeros(places, bool)))
            self.to_rates = sparse.block_diag((self.to_rates, sparse.eye(places)), format="csc")
            self.masses = sparse.block_diag((self.masses, sparse.csr_matrix((places, places))), format="csr")
            self.inertia = self.masses + model.moving.inertia(state.q, state.s)
        self.lift = self.to_rates[:, self.free]

    @property
    def mass(self) -> Any:
        """Masses for the free ones, sparse [m, m]."""
        return (self.lift.T @ self.inertia @ self.lift).tocsr()


def unknowns_in(model: Model, state: State) -> Array:
    """Return the velocities and spins of all nodes, and rates of places, in a state, [6 N + P]."""
    q, v = (x.reshape(-1, 4, 3) for x in (state.q, state.v))
    found = velocities_and_spins(q, v).reshape(-1)
    return found if model.moving is None else np.concatenate((found, model.moving.places_in(state.history)))
