"""Coordinates that joints leave free, as NumPy sees them: functions of products of directions and distances (theory.md 4)."""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.kernels.joints.coordinates import ANGLE, LINE, NO_SWING, SWING
from fastbeam.model.plane import TOLERANCE, NotPlanar

Array = np.ndarray
KINDS = {"distance": LINE, "place": LINE, "cosine": LINE, "angle": ANGLE, "twist": ANGLE, "swing": SWING}


def kind_of(shape: Any) -> int:
    """LINE, ANGLE or SWING."""
    return KINDS[shape.what]


class Coordinate:
    """What a joint leaves free, as a function x of the coordinates of both nodes; a `Law` where a force of its own holds it:
    given as a function of time, or by friction and rigid stops.

    It is y less that at t = 0 of a LINE (y itself of a place), atan2(y, z) of an ANGLE, acos(z) of a SWING; y and z are sums of
    products.

    Parameters
    ----------
    shape : scene.freedoms.Shape
    frame : tables.Frame
    rate : float
        At t = 0, m/s or rad/s.
    holds : bool
        False: friction, which holds up to a limit.
    """

    is_vector = False

    def __init__(self, shape: Any, frame: Any, rate: float = 0.0, holds: bool = False) -> None:
        self.shape, self.kind, self.is_angle, self.rate, self.holds = shape, kind_of(shape), shape.is_angle, rate, holds
        self.directions = np.array([frame.axes[side, i] for one in shape.products for side, i in ((0, one.i), (1, one.j))
                                    if i >= 0])
        # products of two combinations of the eight vectors of both nodes; of y and of z
        self._pairs: tuple[list[tuple[Array, Array]], ...] = ([], [])
        for of_z, i, j, sign in shape.products:
            a, b = np.zeros(8), np.zeros(8)
            a[1:4] = sign * frame.turn[0, i]
            if j < 0:
                b[0], b[4] = -1.0, 1.0
            else:
                b[5:] = frame.turn[1, j]
            self._pairs[of_z].append((a, b))
        self.at_start = float(self._sums(frame.reference)[0]) if self.kind == LINE and shape.what != "place" else 0.0

    def forces(self, dim: int) -> int:
        """As of `Law`."""
        return 1

    def _sums(self, x: Array) -> Array:
        """y and z; the y of a SWING is the sine."""
        v = x.reshape(8, 3)
        out = np.array([sum(float((a @ v) @ (b @ v)) for a, b in pairs) for pairs in self._pairs])
        if self.kind == SWING:
            (a, b), = self._pairs[1]
            out[0] = np.linalg.norm(np.cross(a @ v, b @ v))
        return out

    def _leads(self, x: Array) -> Array:
        """Derivatives of y and z, [2, 24]."""
        v = x.reshape(8, 3)
        return np.array([sum(((np.outer(a, b @ v) + np.outer(b, a @ v)).reshape(-1) for a, b in pairs), np.zeros(24))
                         for pairs in self._pairs])

    def lead(self, x: Array) -> Array:
        """As of `Law`."""
        y, z = self._sums(x)
        of_y, of_z = self._leads(x)
        if self.kind == SWING:
            out = -of_z / max(y, NO_SWING)
        else:
            out = of_y if self.kind == LINE else (z * of_y - y * of_z) / (y * y + z * z)
        return np.asarray(out).reshape(1, 2, 4, 3)

    def is_left_in_plane(self, normal: Array) -> bool:
        """Whether the plane with this normal leaves it free.

        Raises
        ------
        NotPlanar
            A direction lies neither in the plane nor along its normal.
        """
        up = np.abs(self.directions @ normal)
        if np.any((up > TOLERANCE) & (up < 1.0 - TOLERANCE)):
            raise NotPlanar
        return bool(np.all(up < 0.5))

    def within(self, axes: Array) -> Array:
        """As of `Law`."""
        return np.eye(1)[:int(self.is_left_in_plane(axes[2]))]
