"""Sliding contact in an equilibrium: the equations of theory.md 5.1 with both ends of the step equal, as sparse matrices.

    gap         g_k = phi_S - sum_A N_A(s_k) phi_A = 0
    force       +F_k on the point, -N_A F_k on node A
    sliding     F_k . c'(s_k) = 0,   c' = sum_A N'_A phi_A

They make W - (loads) - sum_k F_k . g_k stationary. Tied nodes and held unknowns pass through the map from the unknowns of the
rows to the positions of all nodes; how that map changes with the shape belongs to the tangent of the nodes, which is assembled
with the contact forces among the loads.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .kept import gap_matrix
from .mapping import shapes_at
from .maps import tie_map, velocity_map
from .model import Model

Array = np.ndarray


class Border(NamedTuple):
    """Of all sliders at one shape; d = 3 components in space, 2 in a plane, m unknowns of the nodes."""

    gap: Array        # float64 [S, d], m
    tangent: Array    # float64 [S, d]: c'(s)
    sliding: Array    # float64 [S], N: F . c'
    bend: Array       # float64 [S], N/m: F . c''
    gradient: Any     # sparse [F, m]: derivative of the gaps, of joints too, by the unknowns of the nodes
    slide: Any        # sparse [S, m]: of the sliding equations
    joint_gap: Array  # float64 [F - d S]: of joints with multipliers, m
    bent: Any         # sparse [m, m]: second derivative of - sum F . gap of joints, N/m


class StaticContacts:
    """The sliders of a model in statics.

    Parameters
    ----------
    model : Model
        In space.
    axes : float64 [3, 3], optional
        Of the plane where nodes have 3 unknowns: two in it and its normal, by rows.
    """

    def __init__(self, model: Model, axes: Array | None) -> None:
        from scipy import sparse
        self.model, self.axes = model, axes
        n, rows = model.n_nodes, model.pattern.n
        self._ties = tie_map(model)
        # unknowns of the rows in space -> those of the nodes; held ones stand still
        pick = sparse.csr_matrix((np.ones(n), (np.arange(n), model.pattern.row_of)), shape=(n, rows))
        # three unknowns of a row in the plane -> six
        within = np.eye(6)
        if axes is not None:
            within = np.zeros((6, 3))
            within[:3, 0], within[:3, 1], within[3:, 2] = axes
        self._rows = (sparse.kron(pick, within, format="csr") @ sparse.diags(self._free(within.shape[1]))).tocsr()

    def _free(self, size: int) -> Array:
        """1 for free unknowns of the rows, 0 for held ones [size rows]."""
        core = self.model if self.axes is None else self.model.plane.model
        free = np.ones((core.pattern.n, size))
        if core.static_held is not None:
            held = core.static_held.mask[:, None] >> np.arange(size) & 1
            free[core.static_held.row] *= 1 - held
        return free.reshape(-1)

    def weights(self, s: Array) -> list[Any]:
        """Positions of all nodes -> gaps, tangents, second derivatives of the curves at s [S]; sparse [3 S, 12 N] each."""
        from scipy import sparse
        n = self.model.n_nodes
        entries: list[list[tuple[Array, Array, Array]]] = [[], [], []]
        points = np.zeros(0, np.int64) if self.model.sliders is None else self.model.sliders.point
        for k in range(s.size):
            nodes, values = shapes_at(self.model, k, float(s[k]))
            of = np.full(nodes.size, k)
            entries[0] += [(of, nodes, -values[0]), (np.full(1, k), points[k:k + 1], np.ones(1))]
            entries[1].append((of, nodes, values[1]))
            entries[2].append((of, nodes, values[2]))
        out = []
        c = np.arange(3)
        for part in entries:
            nothing = (np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))
            k, nodes, values = (np.concatenate(x) for x in zip(nothing, *part))
            out.append(sparse.csr_matrix((np.repeat(values, 3), ((3 * k[:, None] + c).reshape(-1),
                                                                 (12 * nodes[:, None] + c).reshape(-1))), (3 * s.size, 12 * n)))
        return out

    def border(self, weights: list[Any], q: Array, force: Array) -> Border:
        """At coordinates q [12 N] and forces of all constraints."""
        from scipy import sparse
        gap, tangent, second = ((w @ q).reshape(-1, 3) for w in weights)
        gradient, turn = (w @ self._ties for w in weights[:2])
        rates = velocity_map(q.reshape(-1, 4, 3)) @ self._rows
        gradient, turn = gradient @ rates, turn @ rates
        if self.axes is not None:
            gap, tangent, second = (x @ self.axes[:2].T for x in (gap, tangent, second))
            within = sparse.kron(sparse.eye(len(gap)), self.axes[:2], format="csr")
            gradient, turn = within @ gradient, within @ turn
        s, d = gap.shape
        f = force[:s * d].reshape(s, d)
        pick = sparse.csr_matrix((force[:s * d], (np.repeat(np.arange(s), d), np.arange(s * d))), shape=(s, s * d))
        joint_gap, of_joints, bent = self._joints(q, force[s * d:], rates)
        return Border(gap, tangent, np.sum(f * tangent, axis=1), np.sum(f * second, axis=1),
                      sparse.vstack((gradient, of_joints), format="csr"), pick @ turn, joint_gap, bent)

    def _joints(self, q: Array, force: Array, rates: Any) -> tuple[Array, Any, Any]:
        """Of joints with multipliers: gaps, their derivatives by the unknowns of the nodes, and the second ones of - force . gap.
        rates: unknowns of the nodes -> coordinates."""
        from scipy import sparse
        kept, x = self.model.kept, q.reshape(-1, 4, 3)[:, 0]
        at_start = self.model.q0.reshape(-1, 4, 3)[:, 0]
        gaps, bent = [np.zeros(0)], sparse.lil_matrix((q.size, q.size))
        within = []
        for link, part in zip(kept, self._parts(force)):
            a, b = link.node
            r = x[b] - x[a]
            gap = link.law.gap(r, at_start[b] - at_start[a])
            axes = np.eye(1) if not link.law.is_vector else np.eye(3) if self.axes is None else self.axes[:2]
            gaps.append(axes @ gap)
            within.append(axes)
            second = link.law.curvature(r, part)
            for i in (a, b):
                for j in (a, b):
                    bent[12 * i:12 * i + 3, 12 * j:12 * j + 3] += (-1.0 if i == j else 1.0) * second
        lift = self._ties @ rates
        lead = sparse.csr_matrix((0, lift.shape[1]))
        if kept:
            lead = sparse.block_diag(within, format="csr") @ gap_matrix(kept, x) @ lift
        return np.concatenate(gaps), lead, (lift.T @ bent.tocsr() @ lift).tocsr()

    def _parts(self, force: Array) -> list[Array]:
        """Forces of every joint with multipliers in space, [3] or [1], from all of them."""
        out, at = [], 0
        for link in self.model.kept:
            m = link.forces(3 if self.axes is None else 2)
            part = force[at:at + m]
            out.append(part if self.axes is None or not link.law.is_vector else part @ self.axes[:2])
            at += m
        return out

    def loads(self, weights: list[Any], q: Array, force: Array) -> Array:
        """The forces of all constraints as loads on the rows, flat as `Work.f_ext` [8 (N + 1)]."""
        n = self.model.n_nodes
        flat = self.axes is not None
        own = self.model.n_sliders * (2 if flat else 3)
        f = force[:own].reshape(-1, 2) @ self.axes[:2] if self.axes is not None else force[:own]
        of_node = (weights[0].T @ f.reshape(-1)).reshape(n, 12)[:, :3]
        x = q.reshape(-1, 4, 3)[:, 0]
        for link, part in zip(self.model.kept, self._parts(force[own:])):
            a, b = link.node
            push = link.law.lead(x[b] - x[a]).T @ part
            of_node[b] += push
            of_node[a] -= push
        if flat:
            of_node = of_node @ self.axes[:2].T  # type: ignore[index]
        out = np.zeros((n + 1, 8))
        np.add.at(out[:, :of_node.shape[1]], self.model.pattern.row_of, of_node)
        return out.reshape(-1)
