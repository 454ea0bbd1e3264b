"""Small motions x e^(r t) about a steady motion, (K + r (C + G) + r^2 M) x = 0, G skew (theory.md 17); without G those about an
equilibrium whose K is not symmetric (theory.md 14).

Krylov vectors of the inverse at a real rate near zero, of positions and velocities together, in blocks and all of them kept. For
each rate found the vector follows from one more solution, and the rate from that vector once more, by the quadratic equation
x* (K + r G + r^2 M) x = 0, which squares its error where nothing is damped.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.linalg.arnoldi import nearest
from fastbeam.linalg.eigen import BLOCK, NOISE, Eigen, Pencil, Shifted, SingularError, grown, satisfied
from fastbeam.vibration.linearised import Linearisation

Array = np.ndarray
# the real rate beside which vectors are looked for, as a share of the square root of the largest of the lowest eigenvalues of K
NEXT_TO = 0.5
# residual of a motion next to the sum of the sizes of its terms, up to which it counts
GOOD = 1e-7
# rates that are zero, next to what round-off of the stiffness may make of one, and real or imaginary, next to their size
ZERO, FLAT = 10.0, 1e-9
# rates that are infinite, next to the largest of the others
INFINITE = 1e4
# frequencies between which motions are counted differ by this share
DISTINCT = 1e-6


class SteadyEigen(NamedTuple):
    """Rates and vectors of m motions; of complex pairs the one that turns forward; of a zero pair one."""

    rates: Array        # complex [m], 1/s, by their size
    vectors: Array      # complex [n, m]: all coordinates and multipliers
    residuals: Array    # [m]
    is_complete: bool   # whether a count of signs confirms that none is missing below the last


def steady_modes_of(about: Linearisation, found: Eigen, n: int, backend: str) -> SteadyEigen:
    """Find the n motions of smallest |r|; found: lowest eigenvalues of K alone. Raises SingularError: they were not found."""
    pencil = found.factors.pencil
    damping = about.damping()
    if damping.nnz and not np.any(damping.data):
        damping.eliminate_zeros()
    against = damping if about.steady is None else (about.coriolis() + damping).tocsr()
    shift = NEXT_TO * float(np.sqrt(np.max(np.abs(found.values), initial=0.0)))
    if not shift > 0.0:
        raise SingularError
    k = pencil.mass.shape[0]
    whole = pencil.multiplier.size
    moved = Pencil((pencil.stiffness + grown((shift * against + shift**2 * pencil.mass).tocsr(), whole)).tocsr(), pencil.mass,
                   pencil.multiplier, False, pencil.still, pencil.turns)
    factors = Shifted(moved, 0.0, backend)
    with_rate = (against + 2.0 * shift * pencil.mass).tocsr()
    rates, u = _krylov(factors, with_rate, pencil.mass, shift, n)
    conserves = pencil.is_symmetric and damping.nnz == 0
    out: list[tuple[complex, Array, float]] = []
    is_every = rates.size < wanted(n)
    for rate, x in zip(rates, u.T):
        try:
            out.append(_improved(pencil, against, factors, with_rate, shift, rate, x, conserves))
        except SingularError:
            # constraints make some infinite ones
            if abs(rate) <= INFINITE * max([shift, *(abs(known) for known, *_ in out)]):
                raise
            is_every = True
            break
    out = _one_of_pairs(out)
    if len(out) < n and not (is_every or len(out) >= k):
        raise SingularError
    out = out[:n]
    found_rates = np.array([rate for rate, *_ in out], complex)
    vectors = np.array([x for _, x, _ in out], complex).reshape(len(out), whole).T
    definite = conserves and bool(np.all(np.real(found.values) >= 0.0))
    return SteadyEigen(found_rates, vectors, np.array([left for *_, left in out]),
                       definite and _counted(pencil, against, found_rates, backend))


def wanted(n: int) -> int:
    """Return the number of rates to look for: both of each of n pairs, and some more."""
    return 2 * n + 4


def _krylov(factors: Shifted, with_rate: Any, mass: Any, shift: float, n: int) -> tuple[Array, Array]:
    """Find rates and vectors [k, m] of the motions with rates next to the shift, both of each pair."""
    k = mass.shape[0]
    whole = factors.pencil.multiplier.size
    scale = factors.scale[:k]

    def solved(right: Array) -> Array:
        grown = np.zeros((whole, right.shape[1]))
        grown[:k] = right
        return factors.solve(grown)[:k]

    def applied(z: Array) -> Array:
        """Return (x, r x / shift) from its like, in scaled unknowns."""
        u, w = z[:k] * scale[:, None], z[k:] * scale[:, None]
        x = -solved(with_rate @ u + shift * (mass @ w))
        return np.concatenate((x / scale[:, None], z[:k] / shift))

    draw = np.random.default_rng(0)
    found = nearest(applied, applied(applied(draw.standard_normal((2 * k, BLOCK)))), shift, wanted(n),
                    min(2 * k, 12 * n + 240), np.abs)
    if not (found.is_converged or found.parts.shape[0] >= 2 * k - BLOCK):
        raise SingularError
    # vectors of pairs are conjugate to the last bit where the projected matrix is real
    return found.values, (found.basis[:k] @ found.parts) * scale[:, None]


def _improved(pencil: Pencil, against: Any, factors: Shifted, with_rate: Any, shift: float, rate: complex, x: Array,
              conserves: bool) -> tuple[complex, Array, float]:
    """Improve a motion: rate, vector of all coordinates and multipliers, and residual."""
    k, mass = pencil.mass.shape[0], pencil.mass
    for again in range(2):
        more = rate - shift
        right = np.zeros((pencil.multiplier.size, 2))
        part = -(more * (with_rate @ x) + more**2 * (mass @ x))
        right[:k, 0], right[:k, 1] = part.real, part.imag
        y = factors.solve(right)
        whole = y[:, 0] + 1j * y[:, 1]
        size = float(np.sqrt(max(np.real(np.vdot(whole[:k], mass @ whole[:k])), 0.0)))
        if not size > 0.0:
            raise SingularError
        whole /= size
        x = whole[:k]
        noise = float(np.sqrt(NOISE * float(np.abs(whole) @ (abs(pencil.stiffness) @ np.abs(whole)))))
        if again or not conserves or abs(rate) <= ZERO * noise:
            break
        of_rate = np.vdot(x, against @ x)
        static_part = np.real(np.vdot(whole, pencil.stiffness @ whole))
        roots = np.roots([1.0, complex(0.0, of_rate.imag), static_part])
        better = roots[np.argmin(np.abs(roots - rate))]
        # two equal roots: a motion that only just swings, whose rate is no better than its vector
        if abs(roots[0] - roots[1]) > 1e-4 * abs(rate):
            rate = complex(better)
    if abs(rate) <= ZERO * noise:
        rate = 0j
    elif abs(rate.real) <= FLAT * abs(rate) and conserves:
        rate = complex(0.0, rate.imag)
    elif abs(rate.imag) <= FLAT * abs(rate):
        rate = complex(rate.real)
    left = pencil.stiffness @ whole
    left[:k] += rate * (against @ x) + rate**2 * (mass @ x)
    terms = abs(pencil.stiffness) @ np.abs(whole)
    terms[:k] += abs(rate) * (abs(against) @ np.abs(x)) + abs(rate)**2 * (abs(mass) @ np.abs(x))
    scale = factors.scale
    residual = float(np.linalg.norm(scale * left) / max(float(np.linalg.norm(scale * terms)), 1e-300))
    if not residual <= GOOD or not satisfied(pencil, scale, whole[:, None])[0]:
        raise SingularError
    return rate, whole, residual


def _one_of_pairs(every: list[tuple[complex, Array, float]]) -> list[tuple[complex, Array, float]]:
    """Keep one motion of each complex pair, with Im r > 0, all real ones, and one of two zeros."""
    zeros = [one for one in every if one[0] == 0.0]
    out = zeros[:(len(zeros) + 1) // 2] + [one for one in every if one[0] != 0.0 and one[0].imag >= 0.0]
    return sorted(out, key=lambda one: (abs(one[0]), one[0].real))


def _counted(pencil: Pencil, against: Any, rates: Array, backend: str) -> bool:
    """Return whether as many motions swing slower than a frequency behind the last ones as were found: where K has no negative
    eigenvalue, that is the number of negative eigenvalues of the Hermitian matrix K + i w G - w^2 M (W. H. Wittrick, F. W.
    Williams, 1971)."""
    from scipy import sparse
    w = np.sort(np.imag(rates))
    gaps = np.flatnonzero(np.diff(w) > DISTINCT * w[1:])
    if not gaps.size:
        return False
    last = int(gaps[-1])
    middle = 0.5 * float(w[last] + w[last + 1])
    n = pencil.multiplier.size
    real = (pencil.stiffness - middle**2 * grown(pencil.mass, n)).tocsr()
    imaginary = middle * grown(against, n)
    both = sparse.bmat([[real, -imaginary], [imaginary, real]], format="csr")
    double = Pencil(both, sparse.csr_matrix((0, 0)), np.tile(pencil.multiplier, 2), True, sparse.csr_matrix((0, 0)),
                    np.tile(pencil.turns, 2))
    try:
        counted = Shifted(double, 0.0, backend)
    except SingularError:
        return False
    return counted.below == 2 * (last + 1 + pencil.still.shape[1])
