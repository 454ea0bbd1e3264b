"""Linear maps of a compiled scene between its unknowns, velocities and coordinates, for whoever needs them outside of a step."""
from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from fastbeam.kernels.algebra.dimensions import SPACE
from fastbeam.kernels.beams.planar_nodes import PlanarBodies
from fastbeam.kernels.contact import curves as kernels
from fastbeam.kernels.contact.curves import ELEMENTS, FIRSTS, NODES_OF_CURVE
from fastbeam.kernels.layout import layout_of
from fastbeam.kernels.state import State
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.forces.winches import rope_masses, ropes_of
from fastbeam.model.joints.constraints import gap_matrix
from fastbeam.model.mapping import nodes_of_curve, within_round
from fastbeam.model.model import Model
from fastbeam.model.workspace import contact_of

Array = np.ndarray


def _skew(x: Array) -> Array:
    """[m, 3] -> [m, 3, 3]"""
    return np.cross(np.eye(3)[None], x[:, None, :])


def velocity_map(q: Array) -> Any:
    """(v, spin) of all nodes -> rates of their 12 coordinates, sparse [12 N, 6 N]."""
    from scipy import sparse
    n = len(q)
    block = np.zeros((n, 12, 6))
    block[:, :3, :3] = np.eye(3)
    for k in range(1, 4):
        block[:, 3 * k:3 * k + 3, 3:] = -_skew(q[:, k])
    return sparse.bsr_matrix((block, np.arange(n), np.arange(n + 1)), shape=(12 * n, 6 * n)).tocsr()


def tie_map(model: Model) -> Any:
    """12 coordinates of all nodes -> the same with those of tied nodes from their targets, sparse [12 N, 12 N]."""
    from scipy import sparse
    n = model.n_nodes
    if model.ties is None:
        return sparse.eye(12 * n, format="csr")
    ties = model.ties
    owner = np.repeat(np.arange(n), np.diff(ties.start))
    free = np.flatnonzero(np.repeat(np.diff(ties.start) == 0, 12))
    rows, columns, values = [free], [free], [np.ones(free.size)]
    # what a tied node takes from a target is never tied itself, so one pass is enough
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
    """Unknowns of all nodes -> the same with those of nodes that share the row of another from the first on that row, sparse
    [6 N, 6 N]."""
    from scipy import sparse
    n = model.n_nodes
    pick = sparse.csr_matrix((np.ones(n), (np.arange(n), model.pattern.first_on_row)), shape=(n, n))
    return sparse.kron(pick, sparse.eye(6), format="csr")


def spins(q: Array, v: Array) -> Array:
    """Spins of nodes at coordinates and rates [..., 4, 3], rad/s: float64 [..., 3]."""
    return np.asarray(0.5 * np.cross(q[..., 1:, :], v[..., 1:, :]).sum(axis=-2))


def velocities_and_spins(q: Array, v: Array) -> Array:
    """Of nodes at coordinates and rates [..., 4, 3], m/s and rad/s: float64 [..., 6], as `velocity_map` takes them."""
    return np.concatenate((v[..., 0, :], spins(q, v)), axis=-1)


def rates_map(model: Model, q: Array) -> Any:
    """Velocities and spins of rows -> rates of all coordinates, sparse [12 N, 6 N], at coordinates [N, 4, 3]."""
    return (tie_map(model) @ velocity_map(q) @ share_map(model)).tocsc()


def spin_map(model: Model) -> Any:
    """Spins of all nodes -> the same with those of rigidly tied nodes from their roots, sparse [3 N, 3 N]."""
    from scipy import sparse
    n = model.n_nodes
    pick = sparse.csr_matrix((np.ones(n), (np.arange(n), model.spin_root)), shape=(n, n))
    return sparse.kron(pick, sparse.eye(3), format="csr")


def free_unknowns(model: Model, state: State | None = None) -> Array:
    """Numbers 6 node + c of the unknowns that are free; of nodes that share a row those of the first."""
    free = (model.held_in(state)[:, None] >> np.arange(6)) & 1 == 0
    first = np.unique(model.pattern.row_of, return_index=True)[1]
    free[np.setdiff1d(np.arange(model.n_nodes), first)] = False
    return np.flatnonzero(free.reshape(-1))


def mass_map(model: Model, q: Array | None = None) -> Any:
    """Mass matrix on the 12 coordinates of all nodes, sparse [12 N, 12 N]; with coordinates q [12 N] that of ropes too, which
    depends on them."""
    from scipy import sparse
    own = sparse.kron(vector_masses(model, q is not None), sparse.eye(3), format="csr")
    ropes = None if q is None else ropes_of(model)
    return own if ropes is None else own + rope_masses(ropes, q)


def gyration_radii(model: Model) -> Array:
    """Radius of gyration of every node, float64 [N], m: of its body, or of the section of its beam; 0 without mass."""
    mass = vector_masses(model, True).diagonal().reshape(model.n_nodes, -1)
    place, turning = mass[:, 0], mass[:, 1:].sum(axis=1)
    return np.sqrt(np.divide(turning, place, out=np.zeros(len(mass)), where=place > 0.0))


def vector_masses(model: Model, without_ropes: bool = False) -> Any:
    """Masses of the vectors (phi, d1, d2, d3) of all nodes, the same in all three directions, sparse [4 N, 4 N]; in a plane of
    (phi, u), [2 N, 2 N]. without_ropes: those of ropes are not asked for."""
    from scipy import sparse
    # the inertia of a rope couples its nodes with its length
    if not without_ropes:
        require(Analysis.MASSES, model, "what works with the masses of nodes alone (blows, mend_start)")
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
            # in space d1 has none
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


def gap_rates(model: Model, state: State) -> tuple[Any, list[Array], Array]:
    """Gaps of sliders and joints with multipliers as a matrix on the 12 coordinates [3 S + J, 12 N], tangents [3] of the curves,
    and minus what the second derivative of a gap has besides accelerations: 2 ds/dt N' phi' + (ds/dt)^2 N'' phi of sliders."""
    from scipy import sparse
    n, s = model.n_nodes, model.n_sliders
    curves, sliders = model.curves, model.sliders
    x, v = state.q.reshape(n, 4, 3)[:, 0], state.v.reshape(n, 4, 3)[:, 0]
    matrix = sparse.lil_matrix((3 * s, 12 * n))
    contact = contact_of(model)
    tangents, convective = [], np.zeros((s, 3))
    for k in range(s):
        assert curves is not None and sliders is not None
        c, point = int(sliders.curve[k]), int(sliders.point[k])
        s = within_round(curves, c, float(state.s[k]))
        e = int(kernels.find_element(curves, c, s, 0)) % int(curves.meta[c, ELEMENTS])
        p = int(curves.meta[c, FIRSTS]) + e
        local = (int(curves.first[p]) + np.arange(int(curves.count[p]))) % int(curves.shape[c, NODES_OF_CURVE])
        contact.basis[:3, local] = 0.0
        for slot, factor in ((0, 1.0), (1, 0.0)):
            kernels.add_basis(curves, c, e, s, slot, factor, 1.0, contact.legendre, contact.basis, slot)
        local = np.unique(local)
        shape = contact.basis[:3, local]
        number = nodes_of_curve(curves, c)[local]
        tangent = shape[1] @ x[number]
        rate = float((v[point] - shape[0] @ v[number]) @ tangent / (tangent @ tangent))
        tangents.append(tangent)
        convective[k] = 2.0 * rate * (shape[1] @ v[number]) + rate**2 * (shape[2] @ x[number])
        for i in range(3):
            matrix[3 * k + i, 12 * number + i] = -shape[0]
            matrix[3 * k + i, 12 * point + i] = 1.0
    q, rates = (y.reshape(n, 4, 3) for y in (state.q, state.v))
    kept = [link for link in model.kept if link.law.holds]
    bent = [link.law.bend(*(y[list(link.node)] for y in (q, rates))) for link in kept]
    every = sparse.vstack((matrix.tocsr(), gap_matrix(kept, q)), format="csr")
    return every, tangents, np.concatenate((convective.reshape(-1), *bent))


def free_of_rows(model: Model) -> Array:
    """Mark unknowns of rows that are free in statics by 1, held ones by 0, float64 [n rows]."""
    size = len(model.dofs)
    free = np.ones((model.pattern.n, size))
    if model.static_held is not None:
        held = model.static_held.mask[:, None] >> np.arange(size) & 1
        free[model.static_held.row] *= 1 - held
    return free.reshape(-1)


class RowMap:
    """Maps from the unknowns of the rows of nodes in statics to what they move.

    Parameters
    ----------
    model : Model
        In space.
    axes : float64 [3, 3], optional
        Of the plane where nodes have 3 unknowns: two in it and its normal, by rows.
    """

    def __init__(self, model: Model, axes: Array | None) -> None:
        self.model, self.axes = model, axes

    @cached_property
    def free(self) -> Array:
        """1 for free unknowns, 0 for held ones [m]."""
        return free_of_rows(self.model if self.axes is None else self.model.plane.model)

    @cached_property
    def ties(self) -> Any:
        """`tie_map`."""
        return tie_map(self.model)

    @cached_property
    def every(self) -> Any:
        """Unknowns -> positions and spins of all nodes, sparse [6 N, m], held ones too."""
        from scipy import sparse
        n, pattern = self.model.n_nodes, self.model.pattern
        pick = sparse.csr_matrix((np.ones(n), (np.arange(n), pattern.row_of)), shape=(n, pattern.n))
        within = np.eye(6)
        if self.axes is not None:
            within = np.zeros((6, 3))
            within[:3, 0], within[:3, 1], within[3:, 2] = self.axes
        return sparse.kron(pick, within, format="csr")

    @cached_property
    def rows(self) -> Any:
        """The same with held unknowns standing still."""
        from scipy import sparse
        return (self.every @ sparse.diags(self.free)).tocsr()

    def rates(self, q: Array) -> Any:
        """Unknowns -> rates of the coordinates of all nodes at q [12 N], sparse [12 N, m]."""
        return self.ties @ velocity_map(q.reshape(-1, 4, 3)) @ self.rows


def with_values(matrix: Any, data: Array) -> Any:
    """A sparse matrix with the structure of this one, shared, and other values: making one anew looks at the structure."""
    out = object.__new__(type(matrix))
    vars(out).update(vars(matrix), data=data)
    return out
