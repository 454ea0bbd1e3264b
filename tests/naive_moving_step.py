"""The conserving step on a mesh that moves (theory.md 5.12) in plain NumPy, in space, with directors: what it lacks of balance
at a given start and end.

One beam from 0 to `length` with one contact. q, v [n, 4, 3] of its nodes at both ends of a step, s and ds/dt; m0 are the momenta
of points at the start. All is written with whole arrays, and discrete derivatives by the names of their factors.
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

    def momentum(self, x: Ends) -> Array:
        """Of points by mass, h a - dx/dt g, from the rates of one end [e, g, 4, 3]."""
        h, rate, a, g = self.fields(x)
        return h[..., None, None] * a - rate[..., None, None] * g

    def mean(self, start: Ends, end: Ends) -> Array:
        """The same as a mean over the step."""
        (h0, x0, a0, g0), (h1, x1, a1, g1) = self.fields(start), self.fields(end)
        size = 1.0 / (0.5 * (1.0 / h0 + 1.0 / h1))
        return size[..., None, None] * 0.5 * (a0 + a1) - 0.5 * (x0 + x1)[..., None, None] * 0.5 * (g0 + g1)

    def sums(self, m: Array, x: Ends) -> tuple[Array, float]:
        """Momenta of nodes [n, 4, 3] and of s, of those m of points at one end."""
        h, _, _, g = self.fields(x)
        p = self.w[:, None, None] * self.rho[:, None] * m
        out = np.zeros_like(x.q)
        np.add.at(out, self.at, np.einsum("gn,egkc->enkc", self.N, p))
        return out, -float(np.sum(p * g / h[..., None, None] * self.along[..., None, None]))

    def forces(self, start: Ends, end: Ends, m0: Array) -> tuple[Array, float]:
        """Discrete derivatives of T - V by q and s; m0: momenta of points at the start."""
        (h0, x0, _, g0), (h1, x1, _, g1) = self.fields(start), self.fields(end)
        mean, x = self.mean(start, end), 0.5 * (x0 + x1)
        m1 = 2.0 * mean - m0
        slope = -(x * 0.5 * (1.0 / h0 + 1.0 / h1))[..., None, None] * mean
        out = np.zeros_like(start.q)
        np.add.at(out, self.at, np.einsum("gn,egkc->enkc", self.D, self.w[:, None, None] * self.rho[:, None] * slope))
        square, mixed = 0.5 * np.sum(m0**2 + m1**2, axis=3), 0.5 * np.sum(m0 * g0 + m1 * g1, axis=3)
        of_size = np.sum(self.w[:, None] * self.rho * (0.5 * square + x[..., None] * mixed), axis=(1, 2)) / (h0 * h1)[:, 0]
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
        # strains times the length of the element do not depend on it
        every = [self._forms(x.q)[0] for x in (start, end)]
        scale = h[..., None]**-SCALES.astype(float)
        Q = [a * scale for a in every]
        r = [np.sqrt(2.0 * a[..., 0] - a[..., 1]**2 - a[..., 2]**2) for a in Q]
        c = [1.75 + a[..., 6] for a in Q]
        E = [np.concatenate((x[..., None], a[..., 1:3], y[..., None] * a[..., 3:6]), axis=-1) for x, y, a in zip(r, c, Q)]
        S, mean = (0.5 * (E[0] + E[1]) - self.E0) @ self.C, 0.5 * (Q[0] + Q[1])
        s = np.zeros_like(mean)
        s[..., 0] = S[..., 0] / (0.5 * (r[0] + r[1]))
        s[..., 1:3] = S[..., 1:3] - s[..., :1] * mean[..., 1:3]
        s[..., 3:6] = (0.5 * (c[0] + c[1]))[..., None] * S[..., 3:6]
        s[..., 6] = np.sum(S[..., 3:] * mean[..., 3:6], axis=-1)
        # energy at the ends of the step with their lengths less that with the mean length
        excess = [x * (h / size)[..., None] - self.E0 for x, size in zip(E, (h0, h1))]
        squares = [np.einsum("egi,ij,egj->eg", x, self.C, x) for x in excess]
        by_size = -S @ self.E0 - 0.25 * (h0 * squares[0] + h1 * squares[1]) / h
        _, y, d = self._forms(0.5 * (start.q + end.q))
        t = (self.ws * h)[..., None] * s * scale
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

    def unbalance(self, start: Ends, end: Ends, m0: Array, h: float) -> tuple[Array, Array, float]:
        """Forces and moments [n, 3] that the step lacks, of the nodes and of s; m0: momenta of points at its start."""
        (p0, s0), (p1, s1) = self.sums(m0, start), self.sums(2.0 * self.mean(start, end) - m0, end)
        f, force = self.forces(start, end, m0)
        lacking = (p1 - p0) / h - f
        moment = np.cross(0.5 * (start.q + end.q)[:, 1:], lacking[:, 1:]).sum(axis=1)
        return lacking[:, 0], moment, (s1 - s0) / h - force
