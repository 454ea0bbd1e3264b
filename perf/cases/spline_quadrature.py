"""Points of the strain energy of B-splines: p Gauss points an element against Gauss rules of spline spaces, which the package has
for degree 2 and 3 (fastbeam/spline_points.py), on the linear Timoshenko beam, with NumPy and SciPy alone.

    python perf/cases/spline_quadrature.py      errors of the third frequency of a pinned beam, slender in bending and taut

With p points an element splines of few elements lock: shear has as many conditions as the mesh has unknowns. A rule that is exact
for splines of degree 2 p - 2 with p - 2 (from p = 4 on p - 1) continuous derivatives has half as many points as that space has
dimensions (T. Hughes, A. Reali, G. Sangalli, Comput. Methods Appl. Mech. Engrg. 199 (2010) 301-313). Rules are solved for by
least squares here, which takes seconds for a hundred elements; their residual is printed.
"""
from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import eigh
from scipy.optimize import least_squares

Array = np.ndarray
# bending, shear and axial stiffness of a beam of length 1 and mass 1: EI, GA, N
CASES = {"slender, bending": (1.0, 4e6, 0.0), "taut": (1.0, 1e10 / 2.6, 1e6)}
MESHES = (8, 16, 32)


def knots(q: int, smooth: int, n: int) -> Array:
    """Of splines of degree q on n elements with so many continuous derivatives."""
    inner = np.repeat(np.arange(1, n) / n, q - smooth)
    return np.concatenate((np.zeros(q + 1), inner, np.ones(q + 1)))


def functions(t: Array, q: int) -> BSpline:
    """All basis functions as one vector-valued spline."""
    return BSpline(t, np.eye(len(t) - q - 1), q)


def gauss(p: int, n: int) -> tuple[Array, Array, float]:
    """p Gauss points an element, weights, and 0."""
    x, w = np.polynomial.legendre.leggauss(p)
    return (np.arange(n)[:, None] / n + 0.5 * (1.0 + x) / n).ravel(), np.tile(0.5 * w / n, n), 0.0


def spline_rule(p: int, n: int) -> tuple[Array, Array, float]:
    """Points and weights of the Gauss rule of a spline space, and how far its integrals are off."""
    q, smooth = 2 * p - 2, p - 2 if p < 4 else p - 1
    t = knots(q, smooth, n)
    size = len(t) - q - 1
    m = (size + 1) // 2
    basis, slopes = functions(t, q), functions(t, q).derivative()
    whole = (t[q + 1:] - t[:size]) / (q + 1)
    middle = np.array([t[i + 1:i + q + 1].mean() for i in range(size)])

    def split(z: Array) -> tuple[Array, Array]:
        return np.clip(z[:m], 0.0, 1.0 - 1e-15), z[m:]

    def miss(z: Array) -> Array:
        x, w = split(z)
        return np.asarray(basis(x).T @ w - whole)

    def tangent(z: Array) -> Array:
        x, w = split(z)
        return np.hstack((slopes(x).T * w, basis(x).T))

    start = [[y[2 * i:2 * i + 2] for i in range(m)] for y in (middle, whole)]
    found = least_squares(miss, np.array([x.mean() for x in start[0]] + [w.sum() for w in start[1]]), jac=tangent, xtol=1e-15,
                          ftol=1e-15, gtol=1e-15, max_nfev=2000).x
    return *split(found), float(np.max(np.abs(miss(found))))


def third_frequency(p: int, n: int, rule: tuple[Array, Array, float], EI: float, GA: float, N: float) -> float:
    """Relative error for rotary inertia 1e-9; masses by p + 1 Gauss points."""
    shape = functions(knots(p, p - 1, n), p)
    slope = shape.derivative()
    x, w, _ = rule
    a, b = shape(x), slope(x)
    shear, curvature, turn = np.hstack((b, -a)), np.hstack((0 * a, b)), np.hstack((b, 0 * a))
    stiffness = sum((y.T * (w * factor)) @ y for y, factor in ((shear, GA), (curvature, EI), (turn, N)))
    x, w, _ = gauss(p + 1, n)
    mass = (shape(x).T * w) @ shape(x)
    size = len(mass)
    free = np.delete(np.arange(2 * size), (0, size - 1))
    whole = np.block([[mass, 0 * mass], [0 * mass, 1e-9 * mass]])
    square = eigh(stiffness[np.ix_(free, free)], whole[np.ix_(free, free)], eigvals_only=True)[2]
    k = 3.0 * np.pi
    exact = k**2 * np.sqrt(EI / (1.0 + k**2 * EI / GA)) if N == 0.0 else np.sqrt(N * k**2 + EI * k**4)
    return float(np.sqrt(abs(square)) / exact - 1.0)


def main() -> None:
    print("third frequency of a pinned beam, relative error with " + ", ".join(map(str, MESHES)) + " elements")
    for name, numbers in CASES.items():
        for p in (2, 3, 4):
            for kind, make in (("p Gauss points", gauss), ("spline rule", spline_rule)):
                rules = [make(p, n) for n in MESHES]
                errors = [third_frequency(p, n, rule, *numbers) for n, rule in zip(MESHES, rules)]
                print(f"{name:17s} degree {p}  {kind:15s} {len(rules[-1][0]) / MESHES[-1]:4.2f} points an element, "
                      + " ".join(f"{x:9.1e}" for x in errors) + f", rule off by {max(rule[2] for rule in rules):.0e}")


if __name__ == "__main__":
    main()
