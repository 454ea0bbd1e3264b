"""Springs with laws: piecewise polynomials from one-sided springs and tables, and series at rows (forces/spring_laws.py)."""
from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from fastbeam.kernels.forces.spring_laws import SpringLaws
from fastbeam.kernels.state import State

Array = np.ndarray
# smallest jump of the slope of a law that is no round-off, as a share of the largest slope
JUMP = 1e-9


class Pieces(NamedTuple):
    """Law of one spring: begins and origins of its pieces, m, energies at the origins, J, and polynomials of the force."""

    begin: Array    # float64 [P], -inf first
    origin: Array   # float64 [P]
    energy: Array   # float64 [P]
    force: Array    # float64 [P, 4]


def pieces_of(part: Any) -> Pieces:
    """Return the law of a spring or damper; its energy is 0 at the elongation 0."""
    if part.table is not None:
        return _of_table(*part.table, part.interpolation)
    k = part.stiffness
    # a spring that only pulls has no force below 0, one that only pushes none above
    slopes = {0: [k], 1: [0.0, k], -1: [k, 0.0]}[part.side]
    force = np.zeros((len(slopes), 4))
    force[:, 1] = slopes
    zero = np.zeros(len(slopes))
    return Pieces(np.array([-np.inf, 0.0][:len(slopes)]), zero, zero.copy(), force)


def _of_table(x: Array, y: Array, interpolation: str) -> Pieces:
    """Return polynomials between the points of a table, with straight lines outside."""
    inside = np.zeros((x.size - 1, 4))
    inside[:, 0], inside[:, 1] = y[:-1], np.diff(y) / np.diff(x)
    ends = inside[0, 1], inside[-1, 1]
    if interpolation == "spline" and x.size > 2:
        from scipy.interpolate import CubicSpline
        found = CubicSpline(x, y)
        inside, ends = np.ascontiguousarray(found.c[::-1].T), (float(found(x[0], 1)), float(found(x[-1], 1)))
    force = np.concatenate(([[y[0], ends[0], 0.0, 0.0]], inside, [[y[-1], ends[1], 0.0, 0.0]]))
    step = np.diff(x)
    origin = np.concatenate((x[:1], x))
    stored = np.sum(inside * step[:, None]**np.arange(1, 5) / np.arange(1, 5), axis=1)
    energy = np.concatenate(([0.0, 0.0], np.cumsum(stored)))
    begin = np.concatenate(([-np.inf], x))
    at = int(np.searchsorted(begin, 0.0, side="right")) - 1
    zero = energy[at] + float(np.sum(force[at] * (-origin[at])**np.arange(1, 5) / np.arange(1, 5)))
    return Pieces(begin, origin, energy - zero, force)


def spring_laws(ends: Any) -> SpringLaws:
    """Build the table of all springs with laws; ends: `links.Ends`."""
    parts = ends.parts
    return laws_of(parts, ends.node, ends.row, ends.block, ends.distance, ends.place)


def laws_of(parts: Sequence[Any], node: Array, row: Array, block: Array, distance: Array, place: Array) -> SpringLaws:
    """Build the table of springs and dampers, linear ones too; distance [L]: of their ends at t = 0; place [L]: of their losses
    in the history."""
    length = np.array([d if part.length is None else part.length for part, d in zip(parts, distance)])
    pieces = [pieces_of(part) for part in parts]
    first = np.concatenate(([0], np.cumsum([len(p.begin) for p in pieces]))).astype(np.int64)
    begin, origin, energy, force = (np.concatenate(x) for x in zip(*pieces))
    return SpringLaws(node, row, block, length, np.array([float(part.damping) for part in parts]),
                      np.array([part.side for part in parts], np.int64), place, first, begin, origin, energy, force.reshape(-1))


def kinks_of(part: Any) -> tuple[tuple[float, int], ...]:
    """Return the elongations, m, at which the slope of the force of a spring or damper jumps, or its damper begins, with the
    order to which steps of order 4 drop there. Jumps of the curvature alone, at the ends of a spline, leave the order as it
    is."""
    law, out = pieces_of(part), []
    for k in range(1, len(law.begin)):
        x = law.begin[k] - law.origin[k - 1:k + 1]
        c1, c2, c3 = law.force[k - 1:k + 1, 1:].T
        slopes = c1 + x * (2.0 * c2 + 3.0 * c3 * x)
        if abs(slopes[1] - slopes[0]) > JUMP * np.max(np.abs(law.force[:, 1])):
            out.append((float(law.begin[k]), 1 if part.side != 0 and part.is_damped else 3))
    return tuple(out)


class SpringRows:
    """Lengths, forces and energies of S springs and dampers at rows.

    node: int64 [S, 2].
    distance: float64 [S], distances of their ends at t = 0, m.
    """

    kind = "springs"

    def __init__(self, parts: list[Any], node: Array, distance: Array) -> None:
        self.names, self.labels = [str(part.name) for part in parts], [str(part.label) for part in parts]
        self._parts, self._node, self._distance = parts, node, distance

    @cached_property
    def _laws(self) -> SpringLaws:
        none = np.zeros((0, 4), np.int64)
        return laws_of(self._parts, self._node, none, none, self._distance, none)

    def _pieces(self, e: Array) -> Array:
        """Find the piece of every spring at its elongation."""
        laws = self._laws
        lo, hi = laws.first[:-1].copy(), laws.first[1:] - 1
        while np.any(lo < hi):
            middle = (lo + hi + 1) // 2
            up = laws.begin[middle] <= e
            lo, hi = np.where(up, middle, lo), np.where(up, hi, middle - 1)
        return lo

    def series(self) -> dict[str, tuple[int, ...]]:
        """Return the shapes of their series."""
        return dict.fromkeys(("spring_length", "spring_force", "spring_energy"), (len(self.names),))

    def slack(self, state: State) -> list[str]:
        """Return the names of one-sided springs without force."""
        laws, (a, b) = self._laws, self._node.T
        x = state.q.reshape(-1, 12)[:, :3]
        e = np.linalg.norm(x[b] - x[a], axis=1) - laws.length
        return [self.names[k] for k in np.flatnonzero((laws.side != 0) & (laws.side * e <= 0.0))]

    def kinks(self) -> list[tuple[tuple[float, int], ...]]:
        """Return `kinks_of` each spring and damper."""
        return [kinks_of(part) for part in self._parts]

    def motion(self, state: State) -> tuple[Array, Array]:
        """Return elongations, m, and their rates, m/s, [S]."""
        a, b = self._node.T
        x, v = (y.reshape(-1, 12)[:, :3] for y in (state.q, state.v))
        r = x[b] - x[a]
        length = np.linalg.norm(r, axis=1)
        return length - self._laws.length, np.sum(r * (v[b] - v[a]), axis=1) / np.where(length > 0.0, length, 1.0)

    def row(self, state: State) -> dict[str, Array]:
        """Evaluate the series of one row."""
        laws = self._laws
        e, rate = self.motion(state)
        length = e + laws.length
        j = self._pieces(e)
        y = (e - laws.origin[j])[:, None]**np.arange(5)
        c = laws.force.reshape(-1, 4)[j]
        viscous = np.where(laws.side * e < 0.0, 0.0, laws.damping * rate)
        return {"spring_length": length, "spring_force": np.sum(c * y[:, :4], axis=1) + viscous,
                "spring_energy": laws.energy[j] + np.sum(c * y[:, 1:] / np.arange(1, 5), axis=1)}
