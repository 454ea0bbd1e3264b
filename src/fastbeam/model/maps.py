"""Linear maps of a compiled scene between its unknowns, velocities and coordinates, for use outside of a step."""
from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.algebra.dimensions import SPACE
from fastbeam.kernels.beams.planar_nodes import PlanarBodies
from fastbeam.kernels.layout import layout_of
from fastbeam.kernels.state import State
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.forces.winches import rope_masses, ropes_of
from fastbeam.model.model import Model

Array = np.ndarray


def _skew(x: Array) -> Array:
    """Return the skew matrices of x [m, 3], which times v are x cross v: [m, 3, 3]."""
    return np.cross(np.eye(3)[None], x[:, None, :])


def velocity_map(q: Array) -> Any:
    """Return the map from (v, spin) of all nodes to rates of their 12 coordinates, sparse [12 N, 6 N]."""
    n = len(q)
    block = np.zeros((n, 12, 6))
    block[:, :3, :3] = np.eye(3)
    for k in range(1, 4):
        block[:, 3 * k:3 * k + 3, 3:] = -_skew(q[:, k])
    return sparse.bsr_matrix((block, np.arange(n), np.arange(n + 1)), shape=(12 * n, 6 * n)).tocsr()


def motion_map(q: Array, nodes: Array) -> Any:
    """Return the map from rates of the 12 coordinates of some nodes to their (v, spin), sparse [6 N, 12 N], as
    `velocities_and_spins`; nodes: int, ascending."""
    block = np.zeros((nodes.size, 6, 12))
    block[:, :3, :3] = np.eye(3)
    for k in range(1, 4):
        block[:, 3:, 3 * k:3 * k + 3] = 0.5 * _skew(q[nodes, k])
    start = np.searchsorted(nodes, np.arange(len(q) + 1))
    return sparse.bsr_matrix((block, nodes, start), shape=(6 * len(q), 12 * len(q))).tocsr()


def tie_map(model: Model) -> Any:
    """Return the map on 12 coordinates of all nodes that takes those of slave nodes from their master nodes, sparse
    [12 N, 12 N]."""
    n = model.n_nodes
    if model.ties is None:
        return sparse.eye(12 * n, format="csr")
    ties = model.ties
    owner = np.repeat(np.arange(n), np.diff(ties.start))
    free = np.flatnonzero(np.repeat(np.diff(ties.start) == 0, 12))
    rows, columns, values = [free], [free], [np.ones(free.size)]
    # master nodes are never slave nodes themselves, so one pass is enough
    for kind, to, of, factor in ((0, [0], [0], np.ones((owner.size, 1, 1))), (1, [0], [3, 6, 9], ties.offset.reshape(-1, 1, 3)),
                                 (2, [3, 6, 9], [3, 6, 9], ties.rotation.reshape(-1, 3, 3))):
        e = np.flatnonzero(ties.kind == kind)
        shape = (e.size, len(to), len(of), 3)
        rows.append(np.broadcast_to((12 * owner[e])[:, None, None, None] + np.array(to)[:, None, None] + np.arange(3), shape))
        columns.append(np.broadcast_to((12 * ties.target[e])[:, None, None, None] + np.array(of)[:, None] + np.arange(3), shape))
        values.append(np.broadcast_to(factor[e][:, :, :, None], shape))
    flat = [np.concatenate([x.reshape(-1) for x in parts]) for parts in (values, rows, columns)]
    return sparse.csr_matrix((flat[0], (flat[1], flat[2])), shape=(12 * n, 12 * n))


def share_map(model: Model) -> Any:
    """Return the map on the unknowns of all nodes that takes those of nodes on a shared row from the first node on it, sparse
    [6 N, 6 N]."""
    n = model.n_nodes
    pick = sparse.csr_matrix((np.ones(n), (np.arange(n), model.pattern.first_on_row)), shape=(n, n))
    return sparse.kron(pick, sparse.eye(6), format="csr")


def spins(q: Array, v: Array) -> Array:
    """Return the spins of nodes at coordinates and rates [..., 4, 3], rad/s: float64 [..., 3]."""
    return np.asarray(0.5 * np.cross(q[..., 1:, :], v[..., 1:, :]).sum(axis=-2))


def velocities_and_spins(q: Array, v: Array) -> Array:
    """Return velocities and spins of nodes at coordinates and rates [..., 4, 3], m/s and rad/s: float64 [..., 6], as
    `velocity_map` takes them."""
    return np.concatenate((v[..., 0, :], spins(q, v)), axis=-1)


def rates_map(model: Model, q: Array) -> Any:
    """Return the map from velocities and spins of rows to rates of all coordinates, sparse [12 N, 6 N], at coordinates
    [N, 4, 3]."""
    return (tie_map(model) @ velocity_map(q) @ share_map(model)).tocsc()


def spin_map(model: Model) -> Any:
    """Return the map on the spins of all nodes that takes those of rigidly connected nodes from their roots, sparse
    [3 N, 3 N]."""
    n = model.n_nodes
    pick = sparse.csr_matrix((np.ones(n), (np.arange(n), model.spin_root)), shape=(n, n))
    return sparse.kron(pick, sparse.eye(3), format="csr")


def free_unknowns(model: Model, state: State | None = None) -> Array:
    """Return the numbers 6 node + c of the free unknowns; for nodes that share a row, of the first node."""
    free = (model.fixed_in(state)[:, None] >> np.arange(6)) & 1 == 0
    first = np.unique(model.pattern.row_of, return_index=True)[1]
    free[np.setdiff1d(np.arange(model.n_nodes), first)] = False
    return np.flatnonzero(free.reshape(-1))


def mass_map(model: Model, q: Array | None = None) -> Any:
    """Assemble the mass matrix on the 12 coordinates of all nodes, sparse [12 N, 12 N]; with coordinates q [12 N] also that of
    ropes, which depends on them."""
    own = sparse.kron(vector_masses(model, q is not None), sparse.eye(3), format="csr")
    ropes = None if q is None else ropes_of(model)
    return own if ropes is None else own + rope_masses(ropes, q)


def gyration_radii(model: Model) -> Array:
    """Return the radius of gyration of every node, float64 [N], m: of its body, or of the section of its beam; 0 without mass."""
    mass = vector_masses(model, True).diagonal().reshape(model.n_nodes, -1)
    place, turning = mass[:, 0], mass[:, 1:].sum(axis=1)
    return np.sqrt(np.divide(turning, place, out=np.zeros(len(mass)), where=place > 0.0))


def vector_masses(model: Model, without_ropes: bool = False) -> Any:
    """Assemble the masses of the vectors (phi, d1, d2, d3) of all nodes, the same in all three directions, sparse [4 N, 4 N]; in
    a plane of (phi, u), [2 N, 2 N]. without_ropes: leave out ropes, else a model with ropes raises an error."""
    # the inertia of a rope couples its nodes with its length
    if not without_ropes:
        require(Analysis.MASSES, model, "analyses that use the masses of nodes alone (impacts, Start(mend=True))")
    n, vectors = model.n_nodes, 4 if model.dofs == SPACE else 2
    rows, columns, values = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0)]

    def put(i: Array, j: Array, x: Array) -> None:
        rows.append(np.ravel(i)); columns.append(np.ravel(j)); values.append(np.ravel(x))

    for tables in (model.simo, model.green):
        for nn, nq, co, no, *_ in () if tables is None else tables.meta:
            at = tables.nodes[no:no + 8 * nn].reshape(nn, 8)
            live = tables.rows[no:no + 8] != n
            place = layout_of(model.dofs, int(nn), int(nq))
            rho, *turning = tables.tab[co + place.inertia:co + place.masses].reshape(-1, 8)
            m = tables.tab[co + place.masses:co + place.table_size].reshape(2, nn, nn, 8)
            a, b = np.broadcast_arrays(at[:, None, live], at[None, :, live])
            # d1 has no mass in space
            for k, x in ((0, rho * m[0]), *((vectors - len(turning) + i, j * m[1]) for i, j in enumerate(turning))):
                put(vectors * a + k, vectors * b + k, x[:, :, live])
    if isinstance(model.bodies, PlanarBodies):
        for k, x in enumerate(model.bodies.inertia.reshape(-1, 2).T):
            put(2 * model.bodies.node + k, 2 * model.bodies.node + k, x)
    elif model.bodies is not None:
        k = np.arange(4)
        i = 4 * model.bodies.node[:, None, None] + k[:, None]
        j = 4 * model.bodies.node[:, None, None] + k
        put(*np.broadcast_arrays(i, j), model.bodies.inertia.reshape(-1, 4, 4))
    return sparse.csr_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))),
                             shape=(vectors * n, vectors * n))


def free_of_rows(model: Model, held: Any) -> Array:
    """Mark unknowns of rows that are free by 1, fixed ones by 0, float64 [n rows]; held: fixed unknowns, those of statics
    (`model.static_held`) or of steps (`model.held`)."""
    size = len(model.dofs)
    free = np.ones((model.pattern.n, size))
    if held is not None:
        # rows that are eliminated come last
        seen = held.row < model.pattern.n
        free[held.row[seen]] *= 1 - (held.mask[seen, None] >> np.arange(size) & 1)
    return free.reshape(-1)


class RowMap:
    """Maps from the unknowns of the rows of nodes in statics to positions, spins and coordinates.

    model: Model in space.
    axes: float64 [3, 3], axes of the plane where nodes have 3 unknowns: two in it and its normal, by rows.
    """

    def __init__(self, model: Model, axes: Array | None) -> None:
        self.model, self.axes = model, axes

    @cached_property
    def free(self) -> Array:
        """Mask with 1 at free unknowns, 0 at fixed ones [m]."""
        core = self.model if self.axes is None else self.model.plane.model
        return free_of_rows(core, core.static_held)

    @cached_property
    def ties(self) -> Any:
        """Map `tie_map` of the model."""
        return tie_map(self.model)

    @cached_property
    def every(self) -> Any:
        """Map from unknowns, fixed ones too, to positions and spins of all nodes, sparse [6 N, m]."""
        n, pattern = self.model.n_nodes, self.model.pattern
        pick = sparse.csr_matrix((np.ones(n), (np.arange(n), pattern.row_of)), shape=(n, pattern.n))
        within = np.eye(6)
        if self.axes is not None:
            within = np.zeros((6, 3))
            within[:3, 0], within[:3, 1], within[3:, 2] = self.axes
        return sparse.kron(pick, within, format="csr")

    @cached_property
    def rows(self) -> Any:
        """Map `every` with zero columns for fixed unknowns."""
        return (self.every @ sparse.diags(self.free)).tocsr()

    def rates(self, q: Array) -> Any:
        """Return the map from unknowns to rates of the coordinates of all nodes at q [12 N], sparse [12 N, m]."""
        return self.ties @ velocity_map(q.reshape(-1, 4, 3)) @ self.rows
