"""A slow model, in plain NumPy, of a beam whose mesh moves with the contact: a bead that slides without friction is an element
end.

A plane beam that bends, shears and stretches, clamped at both ends, n elements of degree p on each side of the bead. Element
ends, x_e(s), are shares of s or of L - s, so that s is one of the coordinates z = (q, s) of

    L(z, z') = 1/2 sum_e int rho |v|^2 dx + 1/2 m |q_c'|^2 - V(z),   v = sum N_A q_A' - s' (dx/ds) phi'(x),

q_c the node of the bead. There is no condition and no multiplier; energy is an invariant, and momenta are where nothing is held.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

Array = np.ndarray


class Data(NamedTuple):
    """EA, GA, EI (N, N, N m^2), mass and inertia per length, length, mass of the bead, gravity and the time in which it grows."""

    stiff: Array = np.array((400.0, 150.0, 1.0))
    rho: Array = np.array((1.0, 1.0, 0.01))
    length: float = 1.0
    bead: float = 0.5
    gravity: float = 6.0
    grows: float = 0.5

    def weight(self, t: float) -> float:
        """Acceleration at time t; it grows smoothly."""
        x = min(max(t / self.grows, 0.0), 1.0) if self.grows > 0.0 else 1.0
        return float(self.gravity * x**4 * (35.0 - 84.0 * x + 70.0 * x * x - 20.0 * x**3))


class Contact(NamedTuple):
    """What a run ends with: s, m; position of the bead, m [2]; force of the beam on it, N [2]."""

    s: float
    position: Array
    force: Array


def shapes(p: int, points: int) -> tuple[Array, Array, Array, Array, Array]:
    """Gauss points on [0, 1], weights, shape functions and their slopes there, and nodes of the element."""
    x, w = legendre.leggauss(points)
    x, w = 0.5 * (1.0 + x), 0.5 * w
    nodes = np.concatenate(([0.0], 0.5 * (1.0 + np.sort(legendre.Legendre.basis(p).deriv().roots().real)), [1.0]))
    powers = np.linalg.inv(np.vander(nodes, p + 1, increasing=True))
    slopes = np.arange(p + 1) * np.vander(x, p + 1, increasing=True)[:, np.maximum(np.arange(p + 1) - 1, 0)]
    return x, w, np.vander(x, p + 1, increasing=True) @ powers, slopes @ powers, nodes


class MovingMesh:
    """n elements of degree p on each side of the bead."""

    def __init__(self, n: int, p: int, data: Data = Data()) -> None:
        self.n, self.p, self.data = n, p, data
        self.x, self.w, self.N, self.D, self.nodes = shapes(p, p + 1)
        _, self.wr, self.Nr, self.Dr, _ = shapes(p, p)
        self.contact, self.count = n * p, 2 * n * p + 1
        self.element = np.arange(2 * n)[:, None] * p + np.arange(p + 1)
        self.stretch = np.concatenate((np.full(n, 1.0 / n), np.full(n, -1.0 / n)))  # dh/ds
        self.along = self._along(self.x)  # dx/ds [e, g]
        # clamped ends stay; s comes last
        self.free = np.append(np.arange(3, 3 * self.count - 3), 3 * self.count)

    def _along(self, x: Array) -> Array:
        share = (np.arange(self.n)[:, None] + x) / self.n
        return np.concatenate((share, 1.0 - share))

    def sizes(self, s: float) -> Array:
        """Lengths of the elements."""
        return np.repeat((s, self.data.length - s), self.n) / self.n

    def mass(self, q: Array, s: float) -> Array:
        """Of all coordinates, [3 N + 1, 3 N + 1]."""
        h = self.sizes(s)
        weight, slope = self.w * h[:, None], np.einsum("ga,eac->egc", self.D, q[self.element]) / h[:, None, None]
        out = np.zeros((3 * self.count + 1,) * 2)
        own = np.einsum("eg,ga,gb->eab", weight, self.N, self.N)
        for c, rho in enumerate(self.data.rho):
            at = 3 * self.element + c
            for e, i in enumerate(at):
                out[np.ix_(i, i)] += rho * own[e]
            mixed = -rho * np.einsum("eg,ga->ea", weight * self.along * slope[:, :, c], self.N)
            np.add.at(out[:, -1], at, mixed)
            np.add.at(out[-1], at, mixed)
            out[-1, -1] += rho * np.sum(weight * self.along**2 * slope[:, :, c]**2)
        for i in (3 * self.contact, 3 * self.contact + 1):
            out[i, i] += self.data.bead
        return out

    def forces(self, q: Array, s: float, rates: Array, t: float) -> tuple[Array, float]:
        """dL/dz [3 N + 1] at rates [3 N + 1], and V."""
        h, d, g = self.sizes(s), self.data, self.data.weight(t)
        at, nodes = self.element, q[self.element]
        weight, slope = self.w * h[:, None], np.einsum("ga,eac->egc", self.D, nodes) / h[:, None, None]
        v = np.einsum("ga,eac->egc", self.N, rates[:-1].reshape(-1, 3)[at]) - rates[-1] * self.along[:, :, None] * slope
        p = d.rho * v
        out, change = np.zeros((self.count, 3)), (self.stretch / h)[:, None]
        np.add.at(out, at, np.einsum("eg,ga,egc->eac", -self.w * rates[-1] * self.along, self.D, p))
        of_s = np.sum(weight * change * 0.5 * np.sum(v * p, axis=2))
        of_s += rates[-1] * np.sum(weight * change * self.along * np.sum(p * slope, axis=2))
        # strain energy at its own points
        weight_r, f = self.wr * h[:, None], np.einsum("ga,eac->egc", self.Dr, nodes) / h[:, None, None]
        angle = np.einsum("ga,ea->eg", self.Nr, nodes[:, :, 2])
        cos, sin = np.cos(angle), np.sin(angle)
        strain = np.stack((f[..., 0] * cos + f[..., 1] * sin - 1.0, f[..., 1] * cos - f[..., 0] * sin, f[..., 2]), axis=2)
        stress = d.stiff * strain
        by_f = np.stack((stress[..., 0] * cos - stress[..., 1] * sin, stress[..., 0] * sin + stress[..., 1] * cos,
                         stress[..., 2]), axis=2)
        by_angle = stress[..., 0] * strain[..., 1] - stress[..., 1] * (strain[..., 0] + 1.0)
        energy = 0.5 * np.sum(stress * strain, axis=2)
        np.add.at(out, at, -np.einsum("g,ga,egc->eac", self.wr, self.Dr, by_f))
        np.add.at(out[:, 2], at, -np.einsum("eg,ga->ea", weight_r * by_angle, self.Nr))
        of_s -= np.sum(weight_r * change * (energy - np.sum(by_f * f, axis=2)))
        # weight
        height = np.einsum("ga,ea->eg", self.N, nodes[:, :, 1])
        np.add.at(out[:, 1], at, -d.rho[0] * g * np.einsum("eg,ga->ea", weight, self.N))
        of_s -= d.rho[0] * g * np.sum(weight * change * height)
        out[self.contact, 1] -= d.bead * g
        stored = np.sum(weight_r * energy) + d.rho[0] * g * np.sum(weight * height) + d.bead * g * q[self.contact, 1]
        return np.append(out, of_s), float(stored)

    # --- Hamilton's equations -----------------------------------------------------------------------------------------
    def start(self, s: float, rate: float) -> Array:
        """State (free z, momenta) of a straight beam at rest along which the bead moves."""
        share = self._along(self.nodes[:-1]).reshape(-1)
        sizes = self.sizes(s)
        x = np.concatenate([[0.0], np.cumsum(sizes)])[:-1, None] + sizes[:, None] * self.nodes[:-1]
        place = np.append(x.reshape(-1), self.data.length)
        self.rest = np.append(np.stack((place, 0.0 * place, 0.0 * place), axis=1), s)
        moving = np.append(np.stack((rate * np.append(share, 0.0), 0.0 * place, 0.0 * place), axis=1), rate)
        return np.concatenate((self.rest[self.free], self.mass(self.rest[:-1].reshape(-1, 3), s)[np.ix_(self.free, self.free)]
                               @ moving[self.free]))

    def slopes(self, t: float, u: Array) -> tuple[Array, float]:
        """du/dt of the state u, and the energy."""
        k = self.free.size
        z, rates = self.rest.copy(), np.zeros(self.rest.size)
        z[self.free] = u[:k]
        q, s = z[:-1].reshape(-1, 3), float(z[-1])
        rates[self.free] = np.linalg.solve(self.mass(q, s)[np.ix_(self.free, self.free)], u[k:])
        force, stored = self.forces(q, s, rates, t)
        return np.concatenate((rates[self.free], force[self.free])), 0.5 * float(u[k:] @ rates[self.free]) + stored

    def run(self, s: float, rate: float, t_end: float, accuracy: float = 1e-10) -> Contact:
        """From rest to t_end, with the exact solution in time to `accuracy`."""
        from scipy.integrate import solve_ivp
        u = solve_ivp(lambda t, u: self.slopes(t, u)[0], (0.0, t_end), self.start(s, rate), method="DOP853", rtol=accuracy,
                      atol=1e-2 * accuracy).y[:, -1]
        at, step = 3 * self.contact - 3, 1e-5
        rates = []
        for h in (step, -step):
            middle = u + 0.5 * h * self.slopes(t_end, u)[0]
            ahead = u + h * self.slopes(t_end + 0.5 * h, middle)[0]
            rates.append(self.slopes(t_end + h, ahead)[0][at:at + 2])
        force = self.data.bead * ((rates[0] - rates[1]) / (2.0 * step) + (0.0, self.data.weight(t_end)))
        return Contact(float(u[self.free.size - 1]), u[at:at + 2], force)

    def conserving_step(self, u: Array, h: float) -> Array:
        """One step with the midpoint discrete gradient (Gonzalez 1996) of the energy, loads constant: energy to round-off."""
        k = self.free.size

        def gradient(u: Array) -> tuple[Array, float]:
            rates, energy = self.slopes(np.inf, u)
            return np.concatenate((-rates[k:], rates[:k])), energy

        before = gradient(u)[1]

        def residual(end: Array) -> Array:
            way, g = end - u, gradient(0.5 * (u + end))[0]
            if way.any():
                g = g + (gradient(end)[1] - before - g @ way) / (way @ way) * way
            return way - h * np.concatenate((g[k:], -g[:k]))

        end = u + h * self.slopes(np.inf, u)[0]
        tangent = None
        for n in range(40):
            r = residual(end)
            if tangent is None or n % 8 == 0:
                tangent = np.array([(residual(end + 1e-6 * x) - r) / 1e-6 for x in np.eye(u.size)]).T
            change = np.linalg.solve(tangent, -r)
            end = end + change
            if np.max(np.abs(change)) < 1e-13:
                return end
        raise ArithmeticError("no convergence")
