"""Material points of beams whose elements move with contacts (theory.md 5.12): shapes and rates at fixed arc lengths."""
from __future__ import annotations

import numpy as np

from fastbeam.kernels.contact.moving_beam import MovingBeam
from fastbeam.model.contact.moving_tables import element_ends, element_lengths, slopes_of, unit_element

Array = np.ndarray


class MaterialPoints:
    """Points of a moving beam at arc lengths [m], with the places of all sliders.

    nodes: int64 [m, n], of the elements around the points; values, slopes: float64 [m, n], shape functions and their derivatives
    by the arc length.
    """

    def __init__(self, table: MovingBeam, at: Array, s: Array) -> None:
        self.table, self._s = table, s
        lengths, begins = element_lengths(table, s), element_ends(table, s)[:-1]
        self._element = np.clip(np.searchsorted(begins, at, side="right") - 1, 0, None)
        self._local = np.minimum((at - begins[self._element]) / lengths[self._element], 1.0)
        _, self.values, slopes = unit_element(table.node.shape[1] - 1)[1].evaluate(self._local)
        self.nodes, self.slopes = table.node[self._element], slopes / lengths[self._element, None]

    def of(self, x: Array) -> Array:
        """Interpolate coordinates [N, 4, 3], or rates of nodes that do not move along the beam: [m, 4, 3]."""
        return np.einsum("mn,mnkc->mkc", self.values, x[self.nodes])

    def rates(self, q: Array, v: Array, of_places: Array) -> Array:
        """Return the rates of the material [m, 4, 3] from coordinates and rates of all nodes [N, 4, 3] and ds/dt of the contacts
        of the beam [S]."""
        return self.of(v) - np.einsum("ms,s,mkc->mkc", self.mesh(), of_places, self.tangents(q))

    def tangents(self, q: Array) -> Array:
        """Return the derivatives of the coordinates by the arc length at coordinates of all nodes [N, 4, 3], [m, 4, 3]."""
        return np.einsum("mn,mnkc->mkc", self.slopes, q[self.nodes])

    def mesh(self) -> Array:
        """Return the motion of the mesh along the beam at the points, for ds/dt of its contacts [m, S]."""
        table, along = self.table, slopes_of(self.table, self._s)
        slot, share = table.slot[self._element], table.share[self._element]
        f = share[:, 0] + self._local * (share[:, 1] - share[:, 0])
        return sum(np.where(slot[:, side, None] == np.arange(along.size), part[:, None] * along, 0.0)
                   for side, part in ((0, 1.0 - f), (1, f)))
