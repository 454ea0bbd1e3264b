"""Joints that multipliers hold: how many forces they have, and how their gaps, functions of the coordinates of both nodes, change
with the motions of these: for reactions, and for velocities of a scene that is not compiled. The gaps themselves are compiled.

Coordinates x [2, 4, 3] are position and directors of nodes a and b.
"""
from __future__ import annotations

import re
from typing import NamedTuple, Protocol

import numpy as np

Array = np.ndarray


class Law(Protocol):
    """What a joint keeps."""

    is_vector: bool  # whether its gap is a vector in space
    is_angle: bool   # whether its gap is one of directions, not of points
    holds: bool      # whether it always holds: friction does not
    rate: float      # of its gap at t = 0, m/s or rad/s

    def forces(self, dim: int) -> int:
        """Number of multipliers where positions have so many components."""

    def lead(self, x: Array) -> Array:
        """Derivative [m, 2, 4, 3] of the gap by the coordinates."""

    def within(self, axes: Array) -> Array:
        """The conditions that are left in a plane of these axes [3, 3] from those in space, [m in the plane, m]."""


class Together:
    """Of a ball joint: both points stay together. The gap is r = x_b - x_a, the force a vector."""

    is_vector, is_angle, holds, rate = True, False, True, 0.0

    def forces(self, dim: int) -> int:
        """As of `Law`."""
        return dim

    def lead(self, x: Array) -> Array:
        """As of `Law`."""
        out = np.zeros((3, 2, 4, 3))
        out[:, 1, 0], out[:, 0, 0] = np.eye(3), -np.eye(3)
        return out

    def within(self, axes: Array) -> Array:
        """As of `Law`."""
        return axes[:2]


class Distance:
    """Of a distance joint: the length of r stays. One gap, and one force, which pushes along r."""

    is_vector, is_angle, holds, rate = False, False, True, 0.0

    def forces(self, dim: int) -> int:
        """As of `Law`."""
        return 1

    def lead(self, x: Array) -> Array:
        """As of `Law`."""
        out, r = np.zeros((1, 2, 4, 3)), x[1, 0] - x[0, 0]
        out[0, 1, 0] = r / np.linalg.norm(r)
        out[0, 0, 0] = -out[0, 1, 0]
        return out

    def within(self, axes: Array) -> Array:
        """As of `Law`."""
        return np.eye(1)


class KeptLink(NamedTuple):
    """A joint, or a part of the conditions of one, between two nodes that is held by multipliers.

    Attributes
    ----------
    name : str
    node : (int, int)
        Nodes a and b.
    law : Law
    """

    name: str
    node: tuple[int, int]
    law: Law

    @property
    def joint(self) -> str:
        """Name of the joint, without its kind and what of it this is."""
        quoted = re.fullmatch(r"[a-z ]+ '(.+)'(?: \([a-z ]+\))?", self.name)
        return self.name if quoted is None else quoted[1]

    def forces(self, dim: int) -> int:
        """Number of its multipliers where positions have so many components."""
        return self.law.forces(dim)

    def rates(self) -> Array:
        """Of its gaps in space at t = 0, as they would be without what is given as a function of time, [m]."""
        return np.full(self.forces(3), self.law.rate)

    def by_motion(self, x: Array) -> list[tuple[int, Array, Array]]:
        """Of both nodes the number, and the derivatives of the gaps by velocity and spin [m, 3]; x [2, 4, 3]."""
        lead = self.law.lead(x)
        out = []
        for k in (0, 1):
            # sum of d_i x (derivative by d_i): the axial vector of a matrix, in a tenth of the time of numpy.cross
            t = x[k, 1:].T @ lead[:, k, 1:]
            turned = np.stack((t[:, 1, 2] - t[:, 2, 1], t[:, 2, 0] - t[:, 0, 2], t[:, 0, 1] - t[:, 1, 0]), axis=1)
            out.append((self.node[k], lead[:, k, 0], turned))
        return out
