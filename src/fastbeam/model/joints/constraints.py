"""Joints with multipliers: number of forces, and derivatives of their gaps by the motions of both nodes, for reactions and for
velocities of a scene that is not compiled. The gaps themselves are compiled.

Coordinates x [n, 4, 3] are position and directors of its nodes, mostly two, a and b.
"""
from __future__ import annotations

import re
from typing import NamedTuple, Protocol

import numpy as np

Array = np.ndarray


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


class ConstrainedJoint(NamedTuple):
    """Joint with multipliers, or a part of its conditions, between two nodes; or the coupling of coordinates of several joints."""

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
        """Constraints between two nodes that its forces act on, each with its factor: of a coupling the coordinates, else itself."""
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
