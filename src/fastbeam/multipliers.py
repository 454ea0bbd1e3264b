"""Joints that multipliers hold, as NumPy sees them: their gaps, functions of r = x_b - x_a, and what these change with."""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray


class Together:
    """Of a ball joint: both points stay together. The gap is r, the force a vector."""

    is_vector = True

    def gap(self, r: Array, at_start: Array) -> Array:
        """[3], m, from r and that of the reference shape."""
        return r

    def lead(self, r: Array) -> Array:
        """Derivative [m, 3] of the gap by r."""
        return np.eye(3)

    def bend(self, r: Array, rate: Array) -> Array:
        """Minus what the second derivative in time of the gap has besides accelerations, [m], m/s^2."""
        return np.zeros(3)

    def curvature(self, r: Array, force: Array) -> Array:
        """Second derivative [3, 3] of force . gap by r."""
        return np.zeros((3, 3))


class Distance:
    """Of a distance joint: the length of r stays. One gap, and one force, which pushes along r."""

    is_vector = False

    def gap(self, r: Array, at_start: Array) -> Array:
        """As `Together.gap`, [1]."""
        return np.array([np.linalg.norm(r) - np.linalg.norm(at_start)])

    def lead(self, r: Array) -> Array:
        """As `Together.lead`."""
        return r[None] / np.linalg.norm(r)

    def bend(self, r: Array, rate: Array) -> Array:
        """As `Together.bend`."""
        along = self.lead(r) @ rate
        return -(rate @ rate - along**2) / np.linalg.norm(r)

    def curvature(self, r: Array, force: Array) -> Array:
        """As `Together.curvature`."""
        n = self.lead(r)
        return force[0] / np.linalg.norm(r) * (np.eye(3) - n.T @ n)


class KeptLink(NamedTuple):
    """A joint between two nodes that is held by multipliers.

    Attributes
    ----------
    name : str
    node : (int, int)
        Nodes a and b.
    law : Together or Distance
    """

    name: str
    node: tuple[int, int]
    law: Together | Distance

    def forces(self, dim: int) -> int:
        """Number of its multipliers where positions have so many components."""
        return dim if self.law.is_vector else 1


def gap_matrix(kept: list[KeptLink], x: Array) -> Any:
    """Derivative of all gaps [m, 12 N] by the coordinates, sparse, at positions x [N, 3]."""
    from scipy import sparse
    rows, columns, data = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0)]
    m = 0
    for link in kept:
        a, b = link.node
        lead = link.law.lead(x[b] - x[a])
        i, j = np.nonzero(np.ones(lead.shape))
        for node, sign in ((b, 1.0), (a, -1.0)):
            rows.append(m + i)
            columns.append(12 * node + j)
            data.append(sign * lead[i, j])
        m += len(lead)
    return sparse.csr_matrix((np.concatenate(data), (np.concatenate(rows), np.concatenate(columns))), shape=(m, 12 * len(x)))
