"""Equilibria of a mass on a clamped beam whose element ends follow it up to the clamps, in plain NumPy (reports/sliding-mesh.md):
energy V of the scene, force along the beam V' and its slope V'' next to those of a fine mesh, at places s from the clamp on.

    python perf/cases/mesh_at_supports.py

An end follows the contact, X = s, where that is further than 2 r from both ends of the beam, and stays r away from these: there
the contact runs inside the small elements beside the end. X(s) is twice continuously differentiable. Beside it the same number of
elements that stand. Exits with 1 where the mesh that follows is off by more than 1e-3 (4 elements), 2e-5 (8) further than 2 r
from the end.
"""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path += [str(ROOT), str(ROOT / "tests")]

from naive_moving_mesh import shapes  # noqa: E402

from perf.printing import Bar, judged  # noqa: E402

Array = np.ndarray
# EA, GA (N), EI (N m^2) of a beam of 1 m, and the weight, N
STIFF, WEIGHT = np.array((1e4, 1e6, 1.0)), 10.0
# places, m; r as a share of an element; bars for 4 and 8 elements
PLACES, RADII, BARS = (0.001, 0.01, 0.04, 0.08, 0.15, 0.3), (0.25, 0.5), {4: 1e-3, 8: 2e-5}
STEP = 1e-30


def excess(u: Any, r: float) -> Any:
    """By how much a distance u is widened, so that it stays above r; 0 from 2 r on."""
    x = np.clip(u.real, 0.0, 2.0 * r) / (2.0 * r) + 1j * (u.imag if 0.0 < u.real < 2.0 * r else 0.0) / (2.0 * r)
    return r + 2.0 * r * x**3 * (1.0 - 0.5 * x) - u if u.real < 2.0 * r else 0.0


class Scene:
    """n elements of degree p whose middle end follows the contact, or that stand (r = 0)."""

    def __init__(self, n: int, p: int, r: float) -> None:
        self.n, self.p, self.r = n, p, r
        _, self.w, self.N, self.D, self.nodes = shapes(p, p)
        self.powers = np.linalg.inv(np.vander(self.nodes, p + 1, increasing=True))
        self.at = np.arange(n)[:, None] * p + np.arange(p + 1)
        self.free = np.arange(3, 3 * n * p)

    def ends(self, s: complex) -> Array:
        """Element ends [n + 1]."""
        if not self.r:
            return np.linspace(0.0, 1.0, self.n + 1).astype(complex)
        s = complex(s)
        x, half = s + excess(s, self.r) - excess(1.0 - s, self.r), self.n // 2
        return np.append(x * np.arange(half) / half, x + (1.0 - x) * np.arange(self.n - half + 1) / (self.n - half))

    def energies(self, q: Array, s: complex) -> Array:
        """Stored energy of all elements, q [n, p + 1, 3]: positions and angle."""
        h = np.diff(self.ends(s))
        f, a = np.einsum("ga,eac->egc", self.D, q) / h[:, None, None], np.einsum("ga,ea->eg", self.N, q[:, :, 2])
        c, d = np.cos(a), np.sin(a)
        strain = np.stack((f[..., 0] * c + f[..., 1] * d - 1.0, f[..., 1] * c - f[..., 0] * d, f[..., 2]), axis=2)
        return np.asarray(0.5 * h * np.einsum("g,c,egc->e", self.w, STIFF, strain * strain))

    def height(self, q: Array, s: complex) -> complex:
        """Height of the contact; q [nodes, 3]."""
        x = self.ends(s)
        e = int(np.clip(np.searchsorted(x.real, complex(s).real, side="right") - 1, 0, self.n - 1))
        xi = (s - x[e]) / (x[e + 1] - x[e])
        return complex(xi**np.arange(self.p + 1) @ self.powers @ q[self.at[e], 1])

    def slopes(self, q: Array, s: float) -> tuple[Array, float]:
        """Derivatives of V by q [nodes, 3] and by s."""
        out, local = np.zeros((self.n * self.p + 1, 3)), np.zeros((self.n, self.p + 1, 3))
        for i in np.ndindex(self.p + 1, 3):
            y = q[self.at].astype(complex)
            y[(slice(None), *i)] += 1j * STEP
            local[(slice(None), *i)] = self.energies(y, s).imag / STEP
        np.add.at(out, self.at, local)
        end = int(np.clip(np.searchsorted(self.ends(s).real, s, side="right") - 1, 0, self.n - 1))
        for node in self.at[end]:
            y = q.astype(complex)
            y[node, 1] += 1j * STEP
            out[node, 1] += WEIGHT * self.height(y, s).imag / STEP
        of_s = self.energies(q[self.at], s + 1j * STEP).sum() + WEIGHT * self.height(q.astype(complex), s + 1j * STEP)
        return out, float(of_s.imag / STEP)

    def straight(self, s: float) -> Array:
        """Nodes of the undeformed beam."""
        x = self.ends(s).real
        place = np.append((x[:-1, None] + np.diff(x)[:, None] * self.nodes[:-1]).reshape(-1), 1.0)
        return np.stack((place, 0.0 * place, 0.0 * place), axis=1)

    def tangent(self, q: Array, s: float) -> Array:
        """Second derivatives of V by the free coordinates."""
        out = np.empty((self.free.size,) * 2)
        for k, i in enumerate(self.free):
            ahead, back = q.copy(), q.copy()
            ahead.reshape(-1)[i] += 1e-6
            back.reshape(-1)[i] -= 1e-6
            out[:, k] = (self.slopes(ahead, s)[0] - self.slopes(back, s)[0]).reshape(-1)[self.free] / 2e-6
        return out

    def rest(self, s: float, q: Array, tangent: Array | None = None) -> tuple[Array, float, Array]:
        """Equilibrium under the weight at a held contact from q on, V' there, and the tangent; that which is given stays."""
        for _ in range(60):
            K = self.tangent(q, s) if tangent is None else tangent
            change = np.linalg.solve(K, -self.slopes(q, s)[0].reshape(-1)[self.free])
            size = float(np.max(np.abs(change)))
            q = q.copy()
            q.reshape(-1)[self.free] += change * min(1.0, 0.1 / size)
            if size < 1e-11:
                return q, self.slopes(q, s)[1], K
        raise ArithmeticError(f"no equilibrium at s = {s}")

    def found(self, s: float) -> Array:
        """V, V' and V'' at s."""
        q, force, K = self.rest(s, self.straight(s))
        h = 1e-4 * min(s, 0.1)
        sides = [self.rest(x, q + self.straight(x) - self.straight(s), K)[1] for x in (s - h, s + h)]
        stored = float(self.energies(q[self.at], s).sum().real) + WEIGHT * self.height(q.astype(complex), s).real
        return np.array((stored, force, (sides[1] - sides[0]) / (2.0 * h)))


def main() -> int:
    """Print all."""
    found: list[Bar] = []
    fine = {s: Scene(8, 6, 1e-6).found(s) for s in PLACES}
    print("relative errors of V, V', V''")
    for n, bar in BARS.items():
        for r in (*RADII, 0.0):
            scene, worst = Scene(n, 3, r / n), 0.0
            print(f"{n} elements, {f'r = {r} of one' if r else 'that stand'}")
            for s in PLACES:
                off = np.abs(scene.found(s) / fine[s] - 1.0)
                worst = max(worst, float(np.max(off))) if s > 2.0 * r / n else worst
                print(f"    s = {s:5.3f} m  " + "  ".join(f"{x:7.1e}" for x in off), flush=True)
            if r:
                found.append((f"{n} elements, r = {r} of one, beyond 2 r", bar, worst, ""))
    return int(judged(found) > 0)


if __name__ == "__main__":
    sys.exit(main())
