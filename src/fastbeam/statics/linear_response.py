"""Linear response of an equilibrium: residuals of scenes around it, and solutions with its tangent and the transposed one
(theory.md 13)."""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.state import State
from fastbeam.linalg.saddle import Saddle
from fastbeam.model.mapping import follow, turned
from fastbeam.model.model import Model
from fastbeam.model.workspace import ReferenceStrains
from fastbeam.results.observe.contact_ripples import rest_events
from fastbeam.results.observe.resolution import Resolution
from fastbeam.statics.sliding import SlidingSolver

Array = np.ndarray


# relative round-off of coordinates and sums
NOISE = 1e-13


class OutOfPlane(Exception):
    """Error: a scene around a planar one is not in its plane."""


class Response(SlidingSolver):
    """Linear response of a scene at a shape on all its unknowns: those of the rows of nodes, sliding coordinates, multipliers.

    model, start, held, flat, backend, at_time, strains: see `SlidingSolver`.
    factors: float64 [K], load factors.
    load_factor: common factor that `factors` contain.
    """

    def __init__(self, model: Model, start: State, held: Array, flat: bool, backend: str, at_time: float, factors: Array,
                 load_factor: float, strains: ReferenceStrains | None = None) -> None:
        super().__init__(model, start, 20, held, flat, backend, at_time, strains)
        self.set_time(at_time, load_factor)
        self.move_to(load_factor)
        if self.along is not None:
            self.along.is_exact = True
        self.factors = factors
        self._load(factors)
        self._loads[:] = self.work.f_ext

    @property
    def unknowns(self) -> int:
        """Number of unknowns: nodal ones, also fixed, sliding coordinates and multipliers."""
        return self.places.stop + self.core.n_forces

    def weighed(self, x: Array) -> Array:
        """Return motions of the nodes and sliders among unknowns [n], in sizes of the scene and rad."""
        size = len(self.core.dofs)
        moved = x[:self.nodes].reshape(-1, size) / np.where(np.arange(size) < self.core.dim, self.core.length, 1.0)
        return np.append(moved.reshape(-1), x[self.places] / self.core.length)

    @property
    def weights(self) -> Array:
        """Weights of squares of the unknowns [n] in the metric of theory.md (12.1); zero for multipliers."""
        place = np.arange(len(self.core.dofs)) < self.core.dim
        rows, length = self.core.pattern.n, self.core.length
        nodes = np.tile(np.where(place, length**-2.0, 1.0) / rows, rows)
        return np.concatenate((nodes, np.full(self.sliding.size, length**-2.0), np.zeros(self.core.n_forces)))

    def size_of(self, x: Array) -> float:
        """Return the largest motion of nodes and sliders among unknowns [n], in sizes of the scene and rad."""
        return float(np.max(np.abs(self.weighed(x)), initial=0.0))

    def label(self, unknown: int) -> str:
        """Return the label of the node of an unknown."""
        row = unknown // len(self.core.dofs)
        return str(self.stepper.model.labels[int(np.flatnonzero(self.core.pattern.row_of == row)[0])])

    def noise(self) -> Array:
        """Return the possible round-off of `unbalanced` [n]: of forces in beams, of loads and of gaps."""
        length = self.core.length
        out = np.full(self.unknowns, NOISE * length)
        loads = self.core.rows_in(self._all_loads).reshape(-1)
        out[:self.nodes] = NOISE * (length * np.abs(self.linearised()[0].matrix.diagonal()[:self.nodes]) + np.abs(loads))
        out[self.places] *= 1.0 + np.linalg.norm(self.stepper.core_state.force)
        return out

    def unbalanced(self) -> Array:
        """Return residual forces, sliding forces and gaps [n]; fixed unknowns have none."""
        return self.linearised()[1]

    def linearised(self) -> tuple[Saddle, Array]:
        """Return tangent and residual."""
        self.work.increment.control[0] = 0.0
        self.stepper.forget_failures()
        found = self._assembled(self.sliding)
        self.stepper.check_laws()
        return found

    def inner_forces(self) -> Array:
        """Return the forces of beams, springs and joints on the unknowns of nodes, and the derivatives of the energy of moving
        elements by the places of free sliders [m + S], without loads and contact forces."""
        state, moving = self.stepper.core_state, self.stepper.own.get("moving")
        arrays = [self._loads, state.force] + ([] if moving is None else [moving.gravity])
        kept = [x.copy() for x in arrays]
        for x in arrays:
            x[:] = 0.0
        found = -self.unbalanced()[:self.places.stop]
        if moving is None:
            found[self.places] = 0.0
        elif self.along is not None:
            # without forces along beams
            found[self.places] += np.where(self.sliding, self.along.known(state.s)[0], 0.0)
        for x, before in zip(arrays, kept):
            x[:] = before
        return found

    def with_meshes(self, x: Array) -> Array:
        """Return unknowns of nodes [m] with unknowns of the material [n]: nodes of moving meshes follow the places."""
        own = x[:self.nodes]
        return own if self.core.moving is None else own + self.constraints.ways @ x[self.places]

    def lift(self) -> Any:
        """Return the map from unknowns of nodes and places of sliders to rates of the 12 coordinates of all nodes, and of the
        places, sparse [12 N + S, m + S]."""
        rates, places = self.map.rates(self.state.q), sparse.identity(self.sliding.size)
        return sparse.bmat([[rates, None if self.core.moving is None else rates @ self.constraints.ways], [None, places]], "csr")

    def spread(self, x: Array) -> Array:
        """Return displacements and spins of the nodes that the unknowns [n] of nodes belong to, [N, 6]; tied nodes have none."""
        return np.asarray(self.map.rows @ self.with_meshes(x)).reshape(-1, 6)

    def own_rates(self, x: Array) -> tuple[Array, Array]:
        """Return the coordinates and, for unknowns [n], their rates [N, 4, 3] of all nodes as results have them: on moving meshes
        of material points."""
        state, rates = self.state, np.asarray(self.lift() @ x[:self.places.stop])
        moving = self.stepper.model.moving
        q, v = state.q, rates[:state.q.size]
        if moving is None:
            return q.reshape(-1, 4, 3), v.reshape(-1, 4, 3)
        history = state.history.copy()
        moving.put_places(history, rates[state.q.size:][moving.sliders])
        return moving.own_shape(State(q, v, state.s, state.force, history))


def at_shape(like: Response, model: Model, factors: Array, way: Array, length: float,
             load_factor: float | None = None) -> Response:
    """Return the response of another scene of the family at the shape of the first, moved with its reference and along a way.

    like: response at the equilibrium.
    model: the other scene.
    factors: float64 [K], factors of its loads.
    way: float64 [n], derivatives of the unknowns beside the motion with the reference.
    length: distance along that way.
    load_factor: factor of slider forces; default: that of the first.
    """
    state, own = like.state, like.stepper.model
    before, after = (x.q0.reshape(-1, 4, 3) for x in (own, model))
    q = state.q.reshape(-1, 4, 3).copy()
    q[:, 0] += after[:, 0] - before[:, 0]
    moved = np.flatnonzero(np.any(after[:, 1:] != before[:, 1:], axis=(1, 2)))
    turn = np.einsum("nka,nkb->nab", after[moved, 1:], before[moved, 1:])
    q[moved, 1:] = np.einsum("nab,nkb->nka", turn, q[moved, 1:])
    displacement = length * like.spread(way)
    q[:, 0] += displacement[:, :3]
    q[:, 1:] = turned(q[:, 1:], displacement[:, 3:])
    # free sliders move with the length of their beam, held ones with their place on it
    s = np.where(like.sliding, state.s * model.slider_lengths / own.slider_lengths, state.s + (model.s0 - own.s0))
    start = State(follow(model, q).reshape(-1), np.zeros(q.size), s, state.force.copy(), model.state().history)
    model.keep_turns(start.history, state.history)
    plane, own_plane = model.plane, like.stepper.plane
    if own_plane is not None and (plane is None or np.max(np.abs(plane.axes - own_plane.axes)) > 1e-9):
        raise OutOfPlane
    out = Response(model, start, like.held, own_plane is not None, "superlu", float(like.stepper.law_work[0]), factors,
                   float(like.stepper.law_work[1]) if load_factor is None else load_factor)
    if (out.stepper.plane is None) != (own_plane is None):
        raise OutOfPlane
    out.stepper.core_state.s[:] += length * way[like.places]
    out.stepper.core_state.force[:] = like.stepper.core_state.force + length * way[like.places.stop:]
    return out


def place_events(solver: SlidingSolver, model: Model) -> list[dict[str, Any]]:
    """Return events where sliders that are free in the equilibrium of a model, at which the solver is, rest where the mesh lets
    them."""
    if not np.any(solver.sliding):
        return []
    saddle, free = solver.at_places()

    def compliance(k: int) -> Array | None:
        push = np.zeros(saddle.multiplier.size)
        push[solver.nodes + k] = 1.0
        x = saddle.solve(push)
        return None if x is None else x[solver.places]

    state = solver.stepper.copy_state()
    return rest_events(model, state, Resolution(model, solver.strains).tension(state.q), free, compliance)
