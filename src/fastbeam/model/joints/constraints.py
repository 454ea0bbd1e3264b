"""Joints with multipliers: number of forces, and derivatives of their gaps by the motions of both nodes, for reactions and for
velocities of a scene that is not compiled. The gaps themselves are compiled.

Coordinates x [n, 4, 3] are position and directors of its nodes, mostly two, a and b.
"""
from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from fastbeam.interface.arguments import shown
from fastbeam.interface.errors import SceneError

Array = np.ndarray
# most gaps of a link from outside, and how open they may be at t = 0, next to its coordinates
MOST_GAPS, CLOSED = 6, 1e-9


class Law(Protocol):
    """Constraint of a joint with multipliers."""

    is_vector: bool  # True if its gap is a vector in space
    is_angle: bool   # True if its gap is one of directions, not of points
    holds: bool      # True if it always holds: False for friction
    rate: float      # rate of its gap at t = 0, m/s or rad/s

    def forces(self, dim: int) -> int:
        """Return the number of multipliers; dim: components of a position."""

    def lead(self, x: Array) -> Array:
        """Return the derivative [m, n, 4, 3] of the gap by the coordinates."""

    def within(self, axes: Array) -> Array:
        """Select the conditions that are left in a plane of these axes [3, 3] from those in space, [m in the plane, m]."""


class Together:
    """Constraint of a ball joint: both points coincide. The gap is r = x_b - x_a, the force a vector."""

    is_vector, is_angle, holds, rate = True, False, True, 0.0

    def forces(self, dim: int) -> int:
        """Return `dim`: one multiplier for each component of r."""
        return dim

    def lead(self, x: Array) -> Array:
        """Return the derivative [3, 2, 4, 3] of r by the coordinates."""
        out = np.zeros((3, 2, 4, 3))
        out[:, 1, 0], out[:, 0, 0] = np.eye(3), -np.eye(3)
        return out

    def within(self, axes: Array) -> Array:
        """Return the two axes in the plane, which select two components of r, [2, 3]."""
        return axes[:2]


class Distance:
    """Constraint of a distance joint: the length of r is constant. One gap, and one force, which pushes along r."""

    is_vector, is_angle, holds, rate = False, False, True, 0.0

    def forces(self, dim: int) -> int:
        """Return 1, the number of multipliers."""
        return 1

    def lead(self, x: Array) -> Array:
        """Return the derivative [1, 2, 4, 3] of the length of r by the coordinates."""
        out, r = np.zeros((1, 2, 4, 3)), x[1, 0] - x[0, 0]
        out[0, 1, 0] = r / np.linalg.norm(r)
        out[0, 0, 0] = -out[0, 1, 0]
        return out

    def within(self, axes: Array) -> Array:
        """Return the identity [1, 1]: the condition is left in a plane."""
        return np.eye(1)


class GapLaw:
    """Constraint of a kind of link from outside by a function of its coordinates.

    part: the link.
    gap: gap(part, x, start) -> [m], see `links.register`.
    start: float64 [2, 4, 3], coordinates at t = 0.
    Raises SceneError: the gaps are not numbers, or are open at t = 0.
    """

    is_vector, is_angle, holds, rate = False, False, True, 0.0

    def __init__(self, part: Any, gap: Callable[[Any, Array, Array], Any], start: Array) -> None:
        self._part, self._gap, self._start = part, gap, start
        found = self._gaps(start)
        size = 1.0 + float(np.max(np.abs(start[:, 0])))
        if found.dtype != float or found.ndim != 1 or not 1 <= found.size <= MOST_GAPS:
            raise SceneError(f"{part.name}: its gap must return from 1 to {MOST_GAPS} numbers, got {shown(found)}")
        if not np.all(np.abs(found) <= CLOSED * size):
            raise SceneError(f"{part.name}: its gap is {shown(found)} at t = 0, and has to be 0; move its ends")
        self._count = found.size
        along = np.random.default_rng(0).standard_normal(start.shape)
        # one-sided, to see kinks
        slope = (self._gaps(start + 1e-7 * size * along) - self._gaps(start)) / (1e-7 * size)
        found = np.einsum("msic,sic->m", self.lead(start), along)
        if not np.allclose(found, slope, rtol=1e-3, atol=1e-3 * float(np.max(np.abs(slope)))):
            raise SceneError(f"{part.name}: the derivative of its gap by complex numbers is {shown(found)}, but differences have "
                             f"{shown(slope)}; write it without abs, norm, conj and real")

    def _gaps(self, x: Array) -> Array:
        return np.asarray(self._gap(self._part, x, self._start))

    def forces(self, dim: int) -> int:
        """Return the number of gaps, one multiplier each."""
        return self._count

    def lead(self, x: Array) -> Array:
        """Return the derivative [m, 2, 4, 3] of the gaps by the coordinates."""
        out = np.zeros((self._count, x.size))
        for k in range(x.size):
            moved = x.astype(complex)
            moved.reshape(-1)[k] += 1e-30j
            out[:, k] = self._gaps(moved).imag * 1e30
        return out.reshape(self._count, *x.shape)

    def within(self, axes: Array) -> Array:
        """Return the identity [m, m]: all gaps are left in a plane."""
        return np.eye(self._count)


class ConstrainedJoint(NamedTuple):
    """Joint with multipliers, or a part of its conditions, between two nodes; or a coupling of coordinates of joints."""

    name: str
    node: tuple[int, ...]  # nodes a and b; of a coupling the nodes of its joints, each once
    law: Law
    # of a coupling its coordinates: factor in the gap, and the constraint that would hold the coordinate alone
    coupled: tuple[tuple[float, ConstrainedJoint], ...] = ()

    @property
    def joint(self) -> str:
        """Name of the joint, without its kind and the part of its conditions."""
        quoted = re.fullmatch(r"[a-z ]+ '(.+)'(?: \([a-z ]+\))?", self.name)
        return self.name if quoted is None else quoted[1]

    @property
    def shares(self) -> tuple[tuple[float, ConstrainedJoint], ...]:
        """Constraints between two nodes that its forces act on, with a factor: the coordinates of a coupling, else itself."""
        return self.coupled or ((1.0, self),)

    def forces(self, dim: int) -> int:
        """Return the number of its multipliers; dim: components of a position."""
        return self.law.forces(dim)

    def rates(self) -> Array:
        """Return the rates [m] of its gaps in space at t = 0 that its functions of time prescribe."""
        return np.full(self.forces(3), self.law.rate)

    def by_velocities(self, x: Array) -> list[tuple[int, Array, Array]]:
        """Return the number of each node, and the derivatives of the gaps by its velocity and spin [m, 3]; x [n, 4, 3]."""
        lead = self.law.lead(x)
        out = []
        for k, node in enumerate(self.node):
            # sum of d_i x (derivative by d_i): the axial vector of a matrix, in a tenth of the time of numpy.cross
            t = x[k, 1:].T @ lead[:, k, 1:]
            turned = np.stack((t[:, 1, 2] - t[:, 2, 1], t[:, 2, 0] - t[:, 0, 2], t[:, 0, 1] - t[:, 1, 0]), axis=1)
            out.append((node, lead[:, k, 0], turned))
        return out
