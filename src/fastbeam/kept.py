"""Joints that multipliers hold, as NumPy sees them: their gaps and what these change with."""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray


class KeptLink(NamedTuple):
    """A joint between two nodes that is held by multipliers.

    Attributes
    ----------
    name : str
    node : (int, int)
        Nodes a and b.
    distance : bool
        Whether it keeps their distance, or the nodes together.
    """

    name: str
    node: tuple[int, int]
    distance: bool

    def forces(self, dim: int) -> int:
        """Number of its multipliers where positions have so many components."""
        return 1 if self.distance else dim

    def lead(self, r: Array) -> Array:
        """Derivative [m, 3] of its gaps by r = x_b - x_a, which keeps its length or is none."""
        return r[None] / np.linalg.norm(r) if self.distance else np.eye(3)

    def bend(self, r: Array, rate: Array) -> Array:
        """Minus what the second derivative in time of its gaps has besides accelerations, [m], m/s^2."""
        if not self.distance:
            return np.zeros(3)
        along = self.lead(r) @ rate
        return -(rate @ rate - along**2) / np.linalg.norm(r)

    def curvature(self, r: Array, force: Array) -> Array:
        """Second derivative [3, 3] of force . gap by r."""
        n = self.lead(r)
        return force[0] / np.linalg.norm(r) * (np.eye(3) - n.T @ n) if self.distance else np.zeros((3, 3))

    def gap(self, r: Array, at_start: Array) -> Array:
        """Its gaps [m], m, from r and that of the reference shape."""
        return np.array([np.linalg.norm(r) - np.linalg.norm(at_start)]) if self.distance else r


def gap_matrix(kept: list[KeptLink], x: Array) -> Any:
    """Derivative of all gaps [m, 12 N] by the coordinates, sparse, at positions x [N, 3]."""
    from scipy import sparse
    rows, columns, data = [], [], []
    m = 0
    for link in kept:
        a, b = link.node
        lead = link.lead(x[b] - x[a])
        for node, sign in ((b, 1.0), (a, -1.0)):
            i, j = np.nonzero(np.ones(lead.shape))
            rows.append(m + i)
            columns.append(12 * node + j)
            data.append(sign * lead[i, j])
        m += len(lead)
    where = (np.concatenate([np.zeros(0, int), *rows]), np.concatenate([np.zeros(0, int), *columns]))
    return sparse.csr_matrix((np.concatenate([np.zeros(0), *data]), where), shape=(m, 12 * len(x)))
