"""Coordinates that joints leave free, for NumPy: functions of products of directions and distances (theory.md 4)."""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.kernels.joints.coordinates import ANGLE, LINE, NO_SWING, SWING
from fastbeam.model.plane import TOLERANCE, NotPlanar

Array = np.ndarray
KINDS = {"distance": LINE, "cosine": LINE, "angle": ANGLE, "twist": ANGLE, "swing": SWING}


def kind_of(shape: Any) -> int:
    """Return the kind of a coordinate: LINE, ANGLE or SWING."""
    return KINDS[shape.what]


class Coordinate:
    """Coordinate x that a joint leaves free, a function of the coordinates of both nodes; a `Law` where a multiplier holds it:
    prescribed as a function of time, or by friction and rigid stops.

    x is y less y at t = 0 for a LINE (y itself for a place), atan2(y, z) for an ANGLE, acos(z) for a SWING; y and z are sums of
    products.

    rate: rate of x at t = 0, m/s or rad/s.
    holds: false for friction, which holds up to a limit.
    """

    is_vector = False

    def __init__(self, shape: Any, frame: Any, rate: float = 0.0, holds: bool = False) -> None:
        self.shape, self.kind, self.is_angle, self.rate, self.holds = shape, kind_of(shape), shape.is_angle, rate, holds
        self.directions = np.array([frame.axes[side, i] for one in shape.products for side, i in ((0, one.i), (1, one.j))
                                    if i >= 0])
        # products of two linear combinations of the eight vectors of both nodes, for y and for z
        self._pairs: tuple[list[tuple[Array, Array]], ...] = ([], [])
        for of_z, i, j, sign in shape.products:
            a, b = np.zeros(8), np.zeros(8)
            a[1:4] = sign * frame.turn[0, i]
            if j < 0:
                b[0], b[4] = -1.0, 1.0
            else:
                b[5:] = frame.turn[1, j]
            self._pairs[of_z].append((a, b))
        self.at_start = float(self._sums(frame.reference)[0]) if self.kind == LINE else 0.0

    def forces(self, dim: int) -> int:
        """Return 1, the number of multipliers."""
        return 1

    def _sums(self, x: Array) -> Array:
        """Return y and z; the y of a SWING is the sine."""
        v = x.reshape(8, 3)
        out = np.array([sum(float((a @ v) @ (b @ v)) for a, b in pairs) for pairs in self._pairs])
        if self.kind == SWING:
            (a, b), = self._pairs[1]
            out[0] = np.linalg.norm(np.cross(a @ v, b @ v))
        return out

    def _leads(self, x: Array) -> Array:
        """Return the derivatives of y and z, [2, 24]."""
        v = x.reshape(8, 3)
        return np.array([sum(((np.outer(a, b @ v) + np.outer(b, a @ v)).reshape(-1) for a, b in pairs), np.zeros(24))
                         for pairs in self._pairs])

    def lead(self, x: Array) -> Array:
        """Return the derivative [1, 2, 4, 3] of x by the coordinates of both nodes."""
        y, z = self._sums(x)
        of_y, of_z = self._leads(x)
        if self.kind == SWING:
            out = -of_z / max(y, NO_SWING)
        else:
            out = of_y if self.kind == LINE else (z * of_y - y * of_z) / (y * y + z * z)
        return np.asarray(out).reshape(1, 2, 4, 3)

    def is_left_in_plane(self, normal: Array) -> bool:
        """Return whether the coordinate is free in the plane with this normal.

        Raises NotPlanar: a direction lies neither in the plane nor along its normal.
        """
        up = np.abs(self.directions @ normal)
        if np.any((up > TOLERANCE) & (up < 1.0 - TOLERANCE)):
            raise NotPlanar
        return bool(np.all(up < 0.5))

    def within(self, axes: Array) -> Array:
        """Return [[1]] where the plane with these axes [3, 3] leaves the coordinate free, else an empty matrix [0, 1]."""
        return np.eye(1)[:int(self.is_left_in_plane(axes[2]))]
