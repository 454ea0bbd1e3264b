"""Rods in a plane by Chebyshev polynomials: equilibria and vibrations of the model itself, independent of elements.

The six equations of first order of a Simo-Reissner rod (x, z, angle, force, moment) hold at the zeros of a Chebyshev polynomial,
ends by themselves (T. A. Driscoll, N. Hale, IMA J. Numer. Anal. 36, 2016). Vibrations are eigenvalues of compliance times masses.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Array = np.ndarray
X, Z, TURN, FX, FZ, M = range(6)
CLAMP, PIN, FREE = (X, Z, TURN), (X, Z, M), (FX, FZ, M)


def chebyshev(n: int, length: float) -> tuple[Array, Array, Array]:
    """Places s [n], and matrices [n - 1, n] that take values there to values and derivatives at the zeros of T_(n-1)."""
    theta = np.pi * np.arange(n) / (n - 1)
    x, y = -np.cos(theta), -np.cos(np.pi * (2.0 * np.arange(n - 1) + 1.0) / (2.0 * n - 2.0))
    of = np.polynomial.chebyshev
    to = np.linalg.inv(of.chebvander(x, n - 1))
    slope = np.stack([of.chebval(y, of.chebder(row)) for row in np.eye(n)], axis=1)
    return 0.5 * length * (x + 1.0), of.chebvander(y, n - 1) @ to, 2.0 / length * slope @ to


@dataclass
class Rod:
    """A rod of length L, its reference along x, with loads a length `load` [2] and forces `pull` [2] times the coordinates;
    `turned` the same of the angle. ends: what vanishes there, less what is given in `values`. gyro: 2 gyro times the masses
    couple both velocities."""

    length: float
    EA: float
    GA: float
    EI: float
    rhoA: float
    rhoI: float
    ends: tuple[tuple[int, ...], tuple[int, ...]]
    values: tuple[tuple[float, ...], tuple[float, ...]] = ((0.0,) * 3, (0.0,) * 3)
    load: tuple[float, float] = (0.0, 0.0)
    pull: tuple[float, float] = (0.0, 0.0)
    turned: float = 0.0
    gyro: float = 0.0
    points: int = 40

    def __post_init__(self) -> None:
        self.s, self.at, self.slope = chebyshev(self.points, self.length)

    def slopes(self, y: Array) -> tuple[Array, Array]:
        """What the equations say of the derivatives of y [6, m], and their derivatives [6, 6, m]."""
        c, s = np.cos(y[TURN]), np.sin(y[TURN])
        normal, shear = c * y[FX] + s * y[FZ], c * y[FZ] - s * y[FX]
        long, across = 1.0 + normal / self.EA, shear / self.GA
        f, d = np.zeros_like(y), np.zeros((6, *y.shape))
        f[X], f[Z] = c * long - s * across, s * long + c * across
        d[X, FX], d[X, FZ] = c * c / self.EA + s * s / self.GA, c * s * (1.0 / self.EA - 1.0 / self.GA)
        d[Z, FX], d[Z, FZ] = d[X, FZ], s * s / self.EA + c * c / self.GA
        # the normal force changes by the shear force, and the shear force by minus the normal force
        d[X, TURN] = -s * long - c * across + c * shear / self.EA + s * normal / self.GA
        d[Z, TURN] = c * long - s * across + s * shear / self.EA - c * normal / self.GA
        f[TURN], d[TURN, M] = y[M] / self.EI, 1.0 / self.EI
        for k, force in ((X, FX), (Z, FZ)):
            f[force] = -self.load[k] - self.rhoA * self.pull[k] * y[k]
            d[force, k] = -self.rhoA * self.pull[k]
        f[M] = f[Z] * y[FX] - f[X] * y[FZ] - self.rhoI * self.turned * y[TURN]
        d[M] = d[Z] * y[FX] - d[X] * y[FZ]
        d[M, FX] += f[Z]
        d[M, FZ] -= f[X]
        d[M, TURN] -= self.rhoI * self.turned
        return f, d

    def system(self, y: Array) -> tuple[Array, Array]:
        """Residual and its derivative at y [6, n]."""
        n = self.points
        f, d = self.slopes(y @ self.at.T)
        rest = [(y[k] @ self.slope.T - f[k]) for k in range(6)]
        whole = np.zeros((6 * n, 6 * n))
        for k in range(6):
            rows = slice(k * (n - 1), (k + 1) * (n - 1))
            for j in range(6):
                whole[rows, j * n:(j + 1) * n] = (self.slope if k == j else 0.0) - d[k, j][:, None] * self.at
        row = 6 * (n - 1)
        for end, place in ((0, 0), (1, n - 1)):
            for k, value in zip(self.ends[end], self.values[end]):
                rest.append(np.array([y[k, place] - value]))
                whole[row, k * n + place] = 1.0
                row += 1
        return np.concatenate(rest), whole

    def equilibrium(self, y: Array) -> Array:
        """From a guess [6, n]."""
        for _ in range(60):
            rest, whole = self.system(y)
            step = np.linalg.solve(whole, rest).reshape(6, -1)
            y = y - step
            if np.max(np.abs(step)) < 1e-12 * (1.0 + np.max(np.abs(y))):
                break
        return y

    def angular(self, y: Array) -> Array:
        """Natural frequencies about an equilibrium [6, n], rad/s, ascending."""
        n = self.points
        whole = self.system(y)[1]
        # derivatives of forces and moment are masses times accelerations
        forces = np.zeros((6 * n, 3 * n))
        for k, (row, mass) in enumerate(((FX, self.rhoA), (FZ, self.rhoA), (M, self.rhoI))):
            forces[row * (n - 1):(row + 1) * (n - 1), k * n:(k + 1) * n] = mass * self.at
        compliance = np.linalg.solve(whole, forces)[:3 * n]
        if not self.gyro:
            values = np.linalg.eigvals(compliance)
            values = np.real(values[(np.abs(np.imag(values)) < 1e-6 * np.abs(values)) & (np.real(values) < 0.0)])
            return np.sort(np.sqrt(-1.0 / values))
        turn = np.zeros((3 * n, 3 * n))
        turn[:n, n:2 * n], turn[n:2 * n, :n] = -2.0 * self.gyro * np.eye(n), 2.0 * self.gyro * np.eye(n)
        # x / rate = C G x + C v, v / rate = x with velocities v
        both = np.block([[compliance @ turn, compliance], [np.eye(3 * n), np.zeros((3 * n, 3 * n))]])
        values = np.linalg.eigvals(both)
        rates = 1.0 / values[np.abs(values) > 1e-9 * np.max(np.abs(values))]
        return np.sort(np.abs(np.imag(rates[(np.imag(rates) > 0.0) & (np.abs(np.real(rates)) < 1e-6 * np.abs(rates))])))


def guess(rod: Rod, x: Callable[[Array], Array], z: Callable[[Array], Array], force: Callable[[Array], Array]) -> Array:
    """From the shape and the force along x."""
    y = np.zeros((6, rod.points))
    y[X], y[Z], y[FX] = x(rod.s), z(rod.s), force(rod.s)
    d = np.gradient(y[Z], rod.s, edge_order=2)
    y[TURN] = np.arctan(d)
    y[FZ] = y[FX] * d
    return y
