"""The conserving step on a mesh that moves (theory.md 5.12) in plain NumPy, in space, with directors: what it lacks of balance
at a given start and end.

One beam from 0 to `length` with one contact. q, v [n, 4, 3] of its nodes at both ends of a step, s and ds/dt; P0 are the momenta
at the start. All is written with whole arrays, and discrete derivatives by the names of their factors.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from naive_moving_mesh import shapes

Array = np.ndarray
SCALES = np.array((2, 1, 1, 1, 1, 1, 0))


class Ends(NamedTuple):
    """Of one end of a step: q, v [n, 4, 3], s, ds/dt."""

    q: Array
    v: Array
    s: float
    rate: float


class Step:
    """n elements of degree p on each side; C [6, 6], E0 [6], rho [4], gravity [3]."""

    def __init__(self, n: int, p: int, length: float, C: Array, E0: Array, rho: Array, gravity: Array) -> None:
        self.n, self.length, self.C, self.E0, self.rho, self.gravity = n, length, C, E0, rho, gravity
        x, self.w, self.N, self.D, _ = shapes(p, p + 1)
        _, self.ws, self.Ns, self.Ds, _ = shapes(p, p)
        self.at = np.arange(2 * n)[:, None] * p + np.arange(p + 1)
        share = (np.arange(n)[:, None] + x) / n
        self.along = np.concatenate((share, 1.0 - share))
        self.way = np.repeat((1.0, -1.0), n) / n

    def sizes(self, s: float) -> Array:
        return np.repeat((s, self.length - s), self.n) / self.n

    def fields(self, x: Ends) -> tuple[Array, ...]:
        """h [e, 1], dx/dt [e, g], a and g [e, g, 4, 3]."""
        a = np.einsum("gn,enkc->egkc", self.N, x.v[self.at])
        return self.sizes(x.s)[:, None], self.along * x.rate, a, np.einsum("gn,enkc->egkc", self.D, x.q[self.at])

    def momenta(self, start: Ends, end: Ends) -> tuple[Array, float]:
        """Their means over the step."""
        (h0, x0, a0, g0), (h1, x1, a1, g1) = self.fields(start), self.fields(end)
        h, x, a, g = (0.5 * (y0 + y1) for y0, y1 in ((h0, h1), (x0, x1), (a0, a1), (g0, g1)))
        p = self.w[:, None, None] * self.rho[:, None] * (h[..., None, None] * a - x[..., None, None] * g)
        out = np.zeros_like(start.q)
        np.add.at(out, self.at, np.einsum("gn,egkc->enkc", self.N, p))
        mixed, square = (0.5 * (np.sum(y0, axis=3) + np.sum(y1, axis=3)) for y0, y1 in ((a0 * g0, a1 * g1), (g0**2, g1**2)))
        by_rate = self.w[:, None] * self.rho * (square * (0.5 * (1.0 / h0 + 1.0 / h1) * x)[..., None] - mixed)
        return out, float(np.sum(by_rate * self.along[..., None]))

    def forces(self, start: Ends, end: Ends) -> tuple[Array, float]:
        """Discrete derivatives of T - V by q and s."""
        (h0, x0, a0, g0), (h1, x1, a1, g1) = self.fields(start), self.fields(end)
        x, xh, xx = 0.5 * (x0 + x1), 0.5 * (x0**2 / h0 + x1**2 / h1), 0.5 * (x0**2 + x1**2)
        slope = 0.5 * (g0 + g1) * xh[..., None, None] - 0.5 * (a0 + a1) * x[..., None, None]
        out = np.zeros_like(start.q)
        np.add.at(out, self.at, np.einsum("gn,egkc->enkc", self.D, self.w[:, None, None] * self.rho[:, None] * slope))
        aa, gg = (0.5 * (np.sum(y0**2, axis=3) + np.sum(y1**2, axis=3)) for y0, y1 in ((a0, a1), (g0, g1)))
        of_size = 0.5 * np.sum(self.w[:, None] * self.rho * (aa - gg * (xx / (h0 * h1))[..., None]), axis=(1, 2))
        # weight
        mean = 0.5 * (start.q + end.q)
        lumps = self.w @ self.N
        np.add.at(out[:, 0], self.at, self.rho[0] * (0.5 * (h0 + h1))[..., None] * lumps[:, None] * self.gravity)
        of_size += self.rho[0] * np.einsum("n,enc,c->e", lumps, mean[self.at][:, :, 0], self.gravity)
        stored, by_size = self._stored(start, end, 0.5 * (h0 + h1), h0, h1)
        return out - stored, float(self.way @ (of_size - by_size))

    def _forms(self, q: Array) -> tuple[Array, Array, Array]:
        """Forms by the element's coordinate [e, g, 7]; values and slopes of fields [e, g, 4, 3]."""
        y, d = (np.einsum("gn,enkc->egkc", table, q[self.at]) for table in (self.Ns, self.Ds))
        f, t, k = d[:, :, 0], y[:, :, 1:], d[:, :, 1:]

        def dot(u: Array, v: Array) -> Array:
            return np.sum(u * v, axis=-1)

        bend = [0.5 * (dot(k[:, :, a], t[:, :, b]) - dot(k[:, :, b], t[:, :, a])) for a, b in ((1, 2), (2, 0), (0, 1))]
        length = -0.25 * sum(dot(t[:, :, i], t[:, :, i]) for i in range(3))
        return np.stack((0.5 * dot(f, f), dot(f, t[:, :, 1]), dot(f, t[:, :, 2]), *bend, length), axis=-1), y, d

    def _stored(self, start: Ends, end: Ends, h: Array, h0: Array, h1: Array) -> tuple[Array, Array]:
        """Discrete derivatives of the stored energy by q [n, 4, 3] and by the lengths of elements [e]."""
        forms = [self._forms(x.q)[0] for x in (start, end)]
        scales = [size[..., None]**-SCALES.astype(float) for size in (h0, h1)]
        Q = [a * b for a, b in zip(forms, scales)]
        r = [np.sqrt(2.0 * a[..., 0] - a[..., 1]**2 - a[..., 2]**2) for a in Q]
        c = [1.75 + a[..., 6] for a in Q]
        E = [np.concatenate((x[..., None], a[..., 1:3], y[..., None] * a[..., 3:6]), axis=-1) - self.E0
             for x, y, a in zip(r, c, Q)]
        S, mean = 0.5 * (E[0] + E[1]) @ self.C, 0.5 * (Q[0] + Q[1])
        s = np.zeros_like(mean)
        s[..., 0] = S[..., 0] / (0.5 * (r[0] + r[1]))
        s[..., 1:3] = S[..., 1:3] - s[..., :1] * mean[..., 1:3]
        s[..., 3:6] = (0.5 * (c[0] + c[1]))[..., None] * S[..., 3:6]
        s[..., 6] = np.sum(S[..., 3:] * mean[..., 3:6], axis=-1)
        energy = 0.25 * sum(np.einsum("egi,ij,egj->eg", x, self.C, x) for x in E)
        change = (scales[1] - scales[0]) / np.where(h1 == h0, 1.0, h1 - h0)[..., None]
        by_size = energy + h * np.sum(s * 0.5 * (forms[0] + forms[1]) * change, axis=-1)
        _, y, d = self._forms(0.5 * (start.q + end.q))
        t = (self.ws * h)[..., None] * s * 0.5 * (scales[0] + scales[1])
        of_values, of_slopes = np.zeros_like(y), np.zeros_like(y)
        of_slopes[:, :, 0] = t[..., :1] * d[:, :, 0] + t[..., 1:2] * y[:, :, 2] + t[..., 2:3] * y[:, :, 3]
        of_values[:, :, 2] += t[..., 1:2] * d[:, :, 0]
        of_values[:, :, 3] += t[..., 2:3] * d[:, :, 0]
        for i, (a, b) in enumerate(((2, 3), (3, 1), (1, 2))):
            x = 0.5 * t[..., 3 + i:4 + i]
            of_slopes[:, :, a] += x * y[:, :, b]
            of_values[:, :, b] += x * d[:, :, a]
            of_slopes[:, :, b] -= x * y[:, :, a]
            of_values[:, :, a] -= x * d[:, :, b]
        of_values[:, :, 1:] -= 0.5 * t[..., 6][..., None, None] * y[:, :, 1:]
        out = np.zeros_like(start.q)
        np.add.at(out, self.at, np.einsum("gn,egkc->enkc", self.Ns, of_values) + np.einsum("gn,egkc->enkc", self.Ds, of_slopes))
        return out, np.sum(self.ws * by_size, axis=1)

    def unbalance(self, start: Ends, end: Ends, before: tuple[Array, float], h: float) -> tuple[Array, Array, float]:
        """Forces and moments [n, 3] that the step lacks, of the nodes and of s; before: momenta at its start."""
        p, of_s = self.momenta(start, end)
        f, force = self.forces(start, end)
        lacking = 2.0 / h * (p - before[0]) - f
        moment = np.cross(0.5 * (start.q + end.q)[:, 1:], lacking[:, 1:]).sum(axis=1)
        return lacking[:, 0], moment, 2.0 / h * (of_s - before[1]) - force
