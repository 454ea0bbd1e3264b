"""Reference curves of beams: position and director triad against arc length."""
from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.polynomial import chebyshev

from fastbeam.interface.errors import SceneError
from fastbeam.scene import checks
from fastbeam.scene.checks import Array


class Curve(Protocol):
    """Interface of the curve of a beam: `length` (m) and `reference(s[n]) -> (phi [n, 3], d [n, 3, 3])`."""

    length: float

    def reference(self, s: Array) -> tuple[Array, Array]:
        """Return positions and triads (rows d1, d2, d3; d1 the unit tangent) at the arc lengths s."""
        ...


class StraightLine:
    """Straight line from `start` (3,) m along the rows of `triad`; d2, d3 turn about d1 by `twist` (rad) over the length."""

    def __init__(self, start: Array, triad: Array, length: float, twist: float = 0.0) -> None:
        self.start, self.triad, self.length, self.twist = start, triad, length, twist

    def reference(self, s: Array) -> tuple[Array, Array]:
        """Return positions [n, 3] and triads [n, 3, 3] at the arc lengths s[n]."""
        d1, d2, d3 = self.triad
        phi = self.start + s[:, None] * d1
        angle = (self.twist * s / self.length)[:, None]
        c, si = np.cos(angle), np.sin(angle)
        return phi, np.stack([np.broadcast_to(d1, phi.shape), c * d2 + si * d3, c * d3 - si * d2], axis=1)


class Arc:
    """Circular arc from `start` (3,) m; rows of `triad` at the start: tangent, direction to the centre, binormal."""

    def __init__(self, start: Array, triad: Array, radius: float, angle: float) -> None:
        self.start, self.triad, self.radius, self.angle = start, triad, radius, angle
        self.length = radius * angle

    def reference(self, s: Array) -> tuple[Array, Array]:
        """Return positions [n, 3] and triads [n, 3, 3] at the arc lengths s[n]."""
        t, n, b = self.triad
        a = (s / self.radius)[:, None]
        c, si = np.cos(a), np.sin(a)
        phi = self.start + self.radius * (si * t + 2.0 * np.sin(0.5 * a) ** 2 * n)
        return phi, np.stack([c * t + si * n, c * n - si * t, np.broadcast_to(b, phi.shape)], axis=1)


class Helix:
    """Helix about `axis_triad[2]` through `center`, starting from radius * axis_triad[0]; Frenet frame, d2 to the axis."""

    def __init__(self, center: Array, axis_triad: Array, radius: float, pitch: float, turns: float) -> None:
        self.center, self.axis_triad = center, axis_triad
        self.radius, self.pitch, self.turns = radius, pitch, turns
        self.length = math.hypot(radius, pitch / (2.0 * math.pi)) * 2.0 * math.pi * turns

    def reference(self, s: Array) -> tuple[Array, Array]:
        """Return positions [n, 3] and triads [n, 3, 3] at the arc lengths s[n]."""
        e1, e2, e3 = self.axis_triad
        rise = self.pitch / (2.0 * math.pi)
        per_angle = math.hypot(self.radius, rise)
        u = (s / per_angle)[:, None]
        c, si = np.cos(u), np.sin(u)
        outward, around = c * e1 + si * e2, c * e2 - si * e1
        p, q = self.radius / per_angle, rise / per_angle
        phi = self.center + self.radius * outward + rise * u * e3
        return phi, np.stack([p * around + q * e3, -outward, p * e3 - q * around], axis=1)


# --- curves given by a function: piecewise Chebyshev polynomials, arc length by integration of their speed ----------------
DEGREE = 24
NODES = -np.cos(np.pi * np.arange(DEGREE + 1) / DEGREE)
TO_COEF = np.linalg.inv(chebyshev.chebvander(NODES, DEGREE))
DERIVE = chebyshev.chebval(NODES, chebyshev.chebder(np.eye(DEGREE + 1))).T @ TO_COEF
MAX_LEVELS = 30
MAX_PANELS = 2048
EPS = float(np.finfo(float).eps)


class FittedCurve:
    """Curve given by a function of t in [0, 1], made arc-length parametric.

    Each panel of t carries Chebyshev polynomials of degree 24; panels are halved until the position and its speed are
    resolved to round-off. Arc length is accurate to 1e-12 relative on smooth curves; kinks are enclosed in tiny panels.

    who: name used in messages.
    curve: t -> position (3,), m.
    breaks: increasing values of t from 0 to 1 where panels must end (places of reduced smoothness).
    frame: t -> d2 (3,) or rows d1, d2, d3 (3, 3). None: rotation-minimising frame.
    d2: start of the rotation-minimising frame; None: d3 as close to e_z as possible.
    Raises SceneError: the function returns no finite points or no direction, stands still, or turns back on itself.
    """

    def __init__(self, who: str, curve: Callable[[float], Any], *, breaks: Any = (0.0, 0.25, 0.5, 0.75, 1.0),
                 frame: Callable[[float], Any] | None = None, d2: Any = None) -> None:
        if not callable(curve) or isinstance(curve, type):
            raise SceneError(f"{who}: curve must be a function of t in [0, 1] that returns 3 numbers, got {checks.shown(curve)}")
        if frame is not None and (not callable(frame) or isinstance(frame, type)):
            raise SceneError(f"{who}: frame must be a function of t that returns d2 or rows d1, d2, d3, got "
                             f"{checks.shown(frame)}")
        if frame is not None and d2 is not None:
            raise SceneError(f"{who}: give frame or d2, not both")
        self.who, self.frame = who, frame
        self._fit(curve, np.asarray(breaks, dtype=float))
        self._integrate_speed()
        self._frame_coef = None if frame is not None else self._transport_frame(d2)

    def _fit(self, curve: Callable[[float], Any], breaks: Array) -> None:
        """Halve panels, level by level, until every one is resolved, at its noise floor, or the budget is spent."""
        pending = [(a, b, math.inf) for a, b in zip(breaks[:-1], breaks[1:])]
        done: list[tuple[float, Array, bool]] = []
        for level in range(MAX_LEVELS + 1):
            split: list[tuple[float, float, float]] = []
            for a, b, parent_tail in pending:
                coef, tail, resolved = self._fit_panel(curve, a, b, parent_tail)
                if resolved or level == MAX_LEVELS or len(done) + len(pending) + len(split) > MAX_PANELS:
                    done.append((a, b, coef, resolved))
                else:
                    split += [(a, 0.5 * (a + b), tail), (0.5 * (a + b), b, tail)]
            pending = split
        done.sort(key=lambda panel: panel[0])
        self._t_ends = np.array([panel[0] for panel in done] + [1.0])
        self._coef = np.array([panel[2] for panel in done])                        # [panels, 25, 3]
        self._resolved = np.array([panel[3] for panel in done])
        self._coef_x = chebyshev.chebder(self._coef, axis=1)

    def _fit_panel(self, curve: Callable[[float], Any], a: float, b: float, parent_tail: float) -> tuple[Array, float, bool]:
        """Return coefficients [25, 3] of one panel, the size of their tail, and whether the panel need not be halved."""
        t = 0.5 * (a + b) + 0.5 * (b - a) * NODES
        t[0], t[-1] = a, b
        points = np.array([checks.vector(self.who, f"curve({x:.6g})", checks.called(self.who, "curve", curve, float(x)))
                           for x in t])
        # far from the origin sums would round by the distance from it; derivatives multiply that by the square of the degree
        near = points - points[-1]
        coef = TO_COEF @ near
        speed = np.linalg.norm(DERIVE @ near, axis=1)
        tail = float(np.max(np.abs(coef[-3:])))
        speed_tail = float(np.max(np.abs((TO_COEF @ speed)[-3:])))
        reach, span = float(np.max(np.abs(points))), float(np.max(np.ptp(points, axis=0)))
        # coefficients that are round-off of the given values would only spoil derivatives
        used = np.nonzero(np.max(np.abs(coef), axis=1) > 2 * EPS * reach)[0]
        coef[int(used[-1]) + 1 if used.size else 0:] = 0.0
        coef[0] += points[-1]
        resolved = (tail <= max(2e-15 * span, 4 * EPS * reach)
                    and speed_tail <= max(1e-13 * float(np.max(speed)), 200 * EPS * reach))
        # noise of the given function: halving no longer helps
        noise = 0.8 * parent_tail < tail < 1e-8 * span
        return coef, tail, resolved or noise

    def _integrate_speed(self) -> None:
        """Form arc length s(x) of every panel as a polynomial of degree 25, and the arc lengths of the panel ends."""
        tangents = chebyshev.chebval(NODES, np.moveaxis(self._coef_x, 1, 0))        # [panels, 3, 25]
        speed = np.linalg.norm(tangents, axis=1)
        self._s_coef = chebyshev.chebint(speed @ TO_COEF.T, lbnd=-1.0, axis=1)      # [panels, 26]
        lengths = np.sum(self._s_coef, axis=1)
        self._s_ends = np.concatenate([[0.0], np.cumsum(lengths)])
        self.length = float(self._s_ends[-1])
        if self.length <= 1e-12 * float(np.max(np.abs(self._coef))):
            raise SceneError(f"{self.who}: the curve has no length")
        per_t = speed * (2.0 / np.diff(self._t_ends))[:, None]
        if np.min(per_t) < 1e-6 * self.length:
            panel, node = np.unravel_index(int(np.argmin(per_t)), per_t.shape)
            t = self._t_ends[panel] + 0.5 * (NODES[node] + 1.0) * (self._t_ends[panel + 1] - self._t_ends[panel])
            raise SceneError(f"{self.who}: the curve has zero speed at t={t:.6g}; use a parameter with non-zero speed")

    def _transport_frame(self, d2: Any) -> Array:
        """Return coefficients [panels, 25, 3] of the rotation-minimising d2: d2_x = -(d2 . t_x) t, solved by collocation."""
        frames = np.empty_like(self._coef)
        previous = r = None
        for k, coef in enumerate(self._coef):
            x_prime = chebyshev.chebval(NODES, self._coef_x[k]).T
            t = x_prime / np.linalg.norm(x_prime, axis=1)[:, None]
            r = checks.default_triad(self.who, t[0], d2)[1] if r is None else self._turn(r, previous, t[0], k)
            values = self._collocate(t, r) if self._resolved[k] else None
            if values is None:
                values = np.empty((DEGREE + 1, 3))
                values[0] = r
                for i in range(DEGREE):
                    values[i + 1] = self._turn(values[i], t[i], t[i + 1], k)
            frames[k] = TO_COEF @ values
            previous = t[-1]
            r = values[-1] - (values[-1] @ previous) * previous
            r = r / np.linalg.norm(r)
        return frames

    @staticmethod
    def _collocate(t: Array, r: Array) -> Array:
        """Return values [25, 3] of d2 on one panel from unit tangents t [25, 3] and the start value r (3,)."""
        n = DEGREE + 1
        t_x = DERIVE @ t
        t_x -= np.sum(t_x * t, axis=1)[:, None] * t
        system = np.einsum("ij,ab->iajb", DERIVE, np.eye(3))
        system[np.arange(n), :, np.arange(n), :] += t[:, :, None] * t_x[:, None, :]
        system = system.reshape(3 * n, 3 * n)
        higher = np.linalg.solve(system[3:, 3:], -system[3:, :3] @ r)
        return np.concatenate([r[None], higher.reshape(DEGREE, 3)])

    def _turn(self, r: Array, t_from: Array, t_to: Array, panel: int) -> Array:
        """Return r carried by the smallest rotation that takes t_from to t_to."""
        both = 1.0 + float(t_from @ t_to)
        if both < 1e-10:
            raise SceneError(f"{self.who}: the curve reverses its direction near t={self._t_ends[panel]:.6g}; give frame=")
        turned = r - (float(r @ t_to) / both) * (t_from + t_to)
        turned = turned - (turned @ t_to) * t_to
        return turned / np.linalg.norm(turned)

    def reference(self, s: Array) -> tuple[Array, Array]:
        """Return positions [n, 3] and triads [n, 3, 3] at the arc lengths s[n]."""
        phi, d = np.empty((s.size, 3)), np.empty((s.size, 3, 3))
        for first in range(0, s.size, 4096):
            part = slice(first, min(first + 4096, s.size))
            phi[part], d[part] = self._reference(s[part])
        return phi, d

    def parameter(self, s: Array) -> Array:
        """Return the curve parameter t in [0, 1] at the arc lengths s[n]."""
        panel, x = self._locate(np.asarray(s, dtype=float))
        return self._t_of(panel, x)

    def _t_of(self, panel: Array, x: Array) -> Array:
        a, b = self._t_ends[panel], self._t_ends[panel + 1]
        return np.clip(a + 0.5 * (x + 1.0) * (b - a), 0.0, 1.0)

    def _locate(self, s: Array) -> tuple[Array, Array]:
        """Find panel and local coordinate x in [-1, 1] of every arc length: Newton, kept in a shrinking bracket."""
        panel = np.clip(np.searchsorted(self._s_ends, s, side="right") - 1, 0, len(self._coef) - 1)
        coef = self._s_coef[panel]
        whole = np.sum(coef, axis=1)
        target = np.clip(s - self._s_ends[panel], 0.0, whole)
        slope = chebyshev.chebder(coef, axis=1)
        low, high = np.full(s.shape, -1.0), np.full(s.shape, 1.0)
        x = 2.0 * target / whole - 1.0
        for _ in range(60):
            miss = _clenshaw(coef, x) - target
            low, high = np.where(miss <= 0.0, x, low), np.where(miss >= 0.0, x, high)
            with np.errstate(divide="ignore", invalid="ignore"):
                new = x - miss / _clenshaw(slope, x)
            new = np.where((new >= low) & (new <= high), new, 0.5 * (low + high))
            step, x = np.max(np.abs(new - x), initial=0.0), new
            if step < 4 * EPS:
                break
        # ends to the last bit
        return panel, np.where(target <= 0.0, -1.0, np.where(target >= whole, 1.0, x))

    def _reference(self, s: Array) -> tuple[Array, Array]:
        panel, x = self._locate(s)
        phi = _clenshaw(self._coef[panel], x)
        d1 = _unit(_clenshaw(self._coef_x[panel], x))
        if self._frame_coef is not None:
            d2 = _clenshaw(self._frame_coef[panel], x)
        else:
            d2 = self._given_frame(self._t_of(panel, x), d1)
        # twice: the second pass removes the round-off of the first
        for _ in range(2):
            d2 = _unit(d2 - np.sum(d2 * d1, axis=1)[:, None] * d1)
        return phi, np.stack([d1, d2, np.cross(d1, d2)], axis=1)

    def _given_frame(self, t: Array, d1: Array) -> Array:
        """Return d2 [n, 3] of the user's frame function, not yet orthogonal to the tangents d1 [n, 3]."""
        assert self.frame is not None
        d2 = np.empty_like(d1)
        for k, x in enumerate(t):
            value = checks.called(self.who, "frame", self.frame, float(x))
            what = f"frame({x:.6g})"
            found = checks.numbers(value)
            if found is not None and found.shape == (3, 3):
                rows = checks.rotation(self.who, what, value)
                miss = float(np.linalg.norm(rows[0] - d1[k]))
                if miss > 1e-6:
                    raise SceneError(f"{self.who}: {what} has d1={checks.shown(rows[0])}, {miss:.3g} away from the unit "
                                     f"tangent {checks.shown(d1[k])}; the first row must be the tangent")
                d2[k] = rows[1]
            else:
                d2[k] = checks.direction(self.who, what, value)
                if np.linalg.norm(np.cross(d2[k], d1[k])) < 1e-6:
                    raise SceneError(f"{self.who}: {what} is parallel to the beam axis {checks.shown(d1[k])}; give a d2 across "
                                     "the axis")
        return d2


def _clenshaw(coef: Array, x: Array) -> Array:
    """Evaluate Chebyshev series coef[n, k, ...] at x[n]: one series per point."""
    x = x.reshape(x.shape + (1,) * (coef.ndim - 2))
    b1 = b2 = np.zeros_like(coef[:, 0])
    for k in range(coef.shape[1] - 1, 0, -1):
        b1, b2 = coef[:, k] + 2.0 * x * b1 - b2, b1
    return coef[:, 0] + x * b1 - b2


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=1)[:, None]


def spline_through(who: str, points: Any, *, d2: Any = None) -> FittedCurve:
    """Make the C2 cubic spline through points [m, 3] (not-a-knot ends, chord-length parameter), a curve in arc length. Raises
    SceneError: fewer than two points, a wrong shape, values that are not finite, or equal neighbours."""
    from scipy.interpolate import CubicSpline

    knots = checks.array(who, "points", points, (None, 3), "finite numbers of shape [m, 3] with m >= 2")
    if len(knots) < 2:
        raise SceneError(f"{who}: points must have shape [m, 3] with m >= 2, got shape {list(knots.shape)}")
    chords = np.linalg.norm(np.diff(knots, axis=0), axis=1)
    if np.min(chords) <= 1e-12 * np.sum(chords):
        i = int(np.argmin(chords))
        raise SceneError(f"{who}: points {i} and {i + 1} coincide; remove one")
    t = np.concatenate([[0.0], np.cumsum(chords)]) / np.sum(chords)
    t[-1] = 1.0
    return FittedCurve(who, CubicSpline(t, knots), breaks=t, d2=d2)
