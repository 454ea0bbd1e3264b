"""Conditions of sleeves for NumPy: products D_i . d_j(s) between the triad of a holder and the section of a beam."""
from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.model.mapping import shapes_at

if TYPE_CHECKING:
    from fastbeam.model.model import Model

Array = np.ndarray
# products (factor, i, j), counted from 0, whose sum is zero; the last one of keyed sleeves alone: no turn of triad and section
# about D_1 changes it, though d_2 and d_3 between nodes are not quite at a right angle
CONDITIONS = (((1.0, 0, 1),), ((1.0, 0, 2),), ((0.5, 1, 2), (-0.5, 2, 1)))


class Section(NamedTuple):
    """Section of a beam in a sleeve: n nodes with shape functions and their first and second derivatives, P conditions."""

    nodes: Array    # int64 [n + 1]: nodes of the beam, then the holder
    roots: Array    # int64 [n + 1]: the nodes that their spins belong to
    shapes: Array   # float64 [3, n]
    d: Array        # float64 [n, 3, 3]: directors of the nodes
    turn: Array     # float64 [3, 3]: R with D_i = sum_k R_ik d_k of the holder
    axes: Array     # float64 [3, 3]: D_1, D_2, D_3
    pairs: int      # 3, or 2 where the twist is free

    def turned_by(self, angle: float) -> Section:
        """Return a copy with D_2, D_3 turned about D_1 that holds the section at this angle."""
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
        return self._replace(turn=turn @ self.turn, axes=turn @ self.axes, pairs=3)

    def values(self, derivative: int = 0) -> Array:
        """Evaluate the conditions [P], or their derivative by s of this order."""
        d = np.einsum("a,ajc->jc", self.shapes[derivative], self.d)
        return np.array([sum(f * (self.axes[i] @ d[j]) for f, i, j in some) for some in CONDITIONS[:self.pairs]])

    def by_spins(self, derivative: int = 0) -> tuple[Array, Array]:
        """Return the derivatives of `values` by the spins of the nodes [P, n, 3] and of the holder [P, 3]."""
        n = self.shapes[derivative]
        d = np.einsum("a,ajc->jc", n, self.d)
        every = CONDITIONS[:self.pairs]
        of_nodes = [sum(f * n[:, None] * np.cross(self.d[:, j], self.axes[i]) for f, i, j in some) for some in every]
        return np.array(of_nodes), np.array([sum(f * np.cross(self.axes[i], d[j]) for f, i, j in some) for some in every])

    def moment(self, mu: Array) -> Array:
        """Return the moment [3] of the multipliers [3] on the holder."""
        return self.by_spins()[1].T @ mu[:self.pairs]

    def turned(self, mu: Array, size: int) -> Any:
        """Return minus the derivative of the moments of multipliers mu [3] on all nodes by the spins, sparse [6 size, 6 size]."""
        n = self.shapes[0]
        count = len(n)
        blocks = np.zeros((count + 1, count + 1, 3, 3))
        d_here = np.einsum("a,ajc->jc", n, self.d)
        for m, i, j in ((moment * f, i, j) for moment, some in zip(mu, CONDITIONS[:self.pairs]) for f, i, j in some):
            axis = self.axes[i]
            for a in range(count):
                blocks[a, a] -= m * n[a] * _double_cross(axis, self.d[a, j])
                blocks[a, count] += m * n[a] * _double_cross(self.d[a, j], axis)
                blocks[count, a] += m * n[a] * _double_cross(axis, self.d[a, j])
            blocks[count, count] -= m * _double_cross(d_here[j], axis)
        row = 6 * self.roots[:, None, None, None] + 3 + np.arange(3)[:, None]
        column = 6 * self.roots[:, None, None] + 3 + np.arange(3)
        row, column = (np.broadcast_to(x, blocks.shape).reshape(-1) for x in (row, column))
        return sparse.csr_matrix((blocks.reshape(-1), (row, column)), shape=(6 * size, 6 * size))


def _double_cross(a: Array, b: Array) -> Array:
    """Return the matrix of a x (b x .)."""
    return np.outer(b, a) - (a @ b) * np.eye(3)


def sections(model: Model, s: Array, q: Array) -> list[Section]:
    """Return the sections in all sleeves of a model in space at sliding coordinates s [S] and coordinates q [N, 4, 3]."""
    sleeves = model.sleeves
    if sleeves is None:
        return []
    assert model.sliders is not None
    out = []
    for o, k in enumerate(model.sleeve_pairs[:, 0]):
        nodes, shapes = shapes_at(model, int(k), float(s[k]))
        holder = int(model.sliders.point[k])
        turn = sleeves.axes.reshape(-1, 3, 3)[o]
        every = np.append(nodes, holder)
        out.append(Section(every, model.spin_root[every], shapes, q[nodes, 1:], turn, turn @ q[holder, 1:],
                           3 if sleeves.keyed[o] else 2))
    return out
