"""Modes of motions x e^(r t) with damping, (K + r C + r^2 M) x = 0, about an equilibrium (theory.md 14).

They are looked for in the span of undamped modes first, where the equation is small and dense, and then improved one by one by
inverse iteration with the whole matrix at the rate that is known so far, which squares the error. Where damping does not couple
undamped modes the first step is exact. Where K is not symmetric they begin with the vectors of `steady_modes`.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fastbeam.linalg.dynamic_stiffness import DynamicStiffness, with_still
from fastbeam.linalg.eigen import Eigen, SingularError
from fastbeam.vibration.linearised import Linearisation
from fastbeam.vibration.steady_modes import steady_modes_of

Array = np.ndarray
# residual, next to the sum of the sizes of its terms, of what counts as a mode, and of what is improved no more
GOOD, DONE = 1e-8, 1e-14
ITERATIONS = 12
# residuals of a solution of inverse iteration next to its largest term that are accepted, one after the other: rates are as
# good as these, and factors that are none leave more
ROUGH = (1e-12, 1e-10, 1e-8)
# share of a vector, in the masses, in which it may differ from the one that it was begun with
SAME = 0.5
# rates whose sizes differ by less than this share are of equal size
EQUAL = 1e-9
# next to the largest rate: round-off of a free motion
ZERO = 1e-14
# more undamped modes than are asked for: what they give of the others
MORE = 8


class Damped(NamedTuple):
    """Rates and vectors of m motions; of complex pairs the one that turns forward."""

    rates: Array      # complex [m], 1/s
    vectors: Array    # complex [n, m]: all coordinates and multipliers
    residuals: Array  # [m]


def damped_of(about: Linearisation, found: Eigen, n: int, backend: str) -> Damped:
    """Find the motions that n undamped modes, the first of those found, become; n motions where K is not symmetric.

    Raises SingularError: one of them was not found.
    """
    pencil = found.factors.pencil
    k = pencil.mass.shape[0]
    damping = about.damping()
    if pencil.is_symmetric:
        rates, vectors = _begun(found, damping, min(n, found.values.size))
    else:
        rates, vectors, *_ = steady_modes_of(about, found, n, backend)
    pencil = with_still(pencil, np.zeros(k))
    system = DynamicStiffness(pencil, damping, backend=backend)
    terms = abs(pencil.stiffness), abs(damping), abs(pencil.mass)
    scale, least = found.factors.scale, ZERO * float(np.max(np.abs(rates), initial=0.0))
    out: list[tuple[complex, Array, float]] = []
    for rate, x in zip(rates, vectors.T):
        out.append(_improved(system, terms, scale, complex(rate), x.astype(complex), least, out))
    out = _in_order(out)
    vectors = np.array([x for _, x, _ in out]).reshape(len(out), pencil.multiplier.size)
    return Damped(np.array([rate for rate, *_ in out]), vectors.T, np.array([left for *_, left in out]))


def _begun(found: Eigen, damping: Any, n: int) -> tuple[Array, Array]:
    """Solve the equation in the span of undamped modes: rates [m] and vectors [k, m] that belong to the first n modes."""
    span, frequencies, k = found.vectors, np.real(found.values), damping.shape[0]
    round_off = np.finfo(float).eps * np.max(np.abs(frequencies), initial=0.0)
    frequencies = np.where(np.abs(frequencies) <= round_off, 0.0, frequencies)
    small = span[:k].T @ (damping @ span[:k])
    # free motions are not damped by round-off, which is as large as the parts that cancel in them
    free, size = frequencies == 0.0, np.abs(span[:k])
    small[(np.abs(small) <= ZERO * (size.T @ (abs(damping) @ size))) & (free | free[:, None])] = 0.0
    rates, parts = _projected(np.diag(frequencies), small, n)
    # one by one: products with several columns round otherwise
    return rates, np.array([span @ part for part in parts.T]).reshape(rates.size, len(span)).T


def _in_order(found: list[tuple[complex, Array, float]]) -> list[tuple[complex, Array, float]]:
    """Sort modes by the size of their rates, and those of equal size, as of a motion that grows and the same backward in time, by
    their real parts."""
    found = sorted(found, key=lambda one: abs(one[0]))
    sizes = np.abs([rate for rate, *_ in found])
    group = np.concatenate(([0], np.cumsum(sizes[1:] > (1.0 + EQUAL) * sizes[:-1])))
    return [found[k] for k in sorted(range(len(found)), key=lambda k: (group[k], found[k][0].real))]


def _projected(stiffness: Array, damping: Array, n: int) -> tuple[Array, Array]:
    """Solve the equation in the span of modes of unit mass: rates [m], and vectors [modes, m] that belong to the first n modes,
    of complex pairs one."""
    m = len(damping)
    zero, one = np.zeros((m, m)), np.eye(m)
    # in a unit of time of the modes
    unit = float(np.exp2(np.round(0.5 * np.log2(np.max(np.abs(stiffness), initial=0.0) or 1.0))))
    rates, vectors = np.linalg.eig(np.block([[zero, one], [-stiffness / unit**2, -damping / unit]]))
    rates = unit * rates
    vectors = vectors[:m] / np.maximum(np.linalg.norm(vectors[:m], axis=0), 1e-300)
    share = np.sum(np.abs(vectors[:n])**2, axis=0)
    order = np.argsort(-share, kind="stable")[:2 * n]
    # round-off makes pairs of equal real rates
    flat = np.abs(np.imag(rates)) <= 1e-9 * np.abs(rates)
    picks = [j for j in order if flat[j] or np.imag(rates[j]) > 0.0]
    rates = np.where(flat, np.real(rates), rates)
    rates[np.abs(rates) <= ZERO * np.max(np.abs(rates), initial=0.0)] = 0.0
    rates, vectors = rates[picks], vectors[:, picks]
    # a dense solver may return one vector of a multiple zero several times: free motions are taken instead
    free = np.flatnonzero(np.diag(stiffness) == 0.0)
    for j, k in zip(np.flatnonzero(rates == 0.0), free[free < n]):
        vectors[:, j] = np.arange(m) == k
    return rates, vectors


def _solved(system: DynamicStiffness, rate: complex, right: Array) -> Array | None:
    """Solve the equation at a rate, by the best factors that there are; None where there are none."""
    for rough in ROUGH:
        try:
            return system.factored(rate, rough).solve(right)
        except SingularError:
            continue
    return None


def _improved(system: DynamicStiffness, terms: tuple[Any, Any, Any], scale: Array, rate: complex, x: Array, least: float,
              before: list[tuple[complex, Array, float]]) -> tuple[complex, Array, float]:
    """Improve a mode by inverse iteration: rate, vector and residual; scale: of rows and columns [n], with which residuals are
    measured; least: of rates that are not zero.

    Raises SingularError: it did not converge, or to a motion that is known.
    """
    pencil = system.pencil
    k = pencil.mass.shape[0]
    start = x[:k].copy()
    mass = pencil.mass

    def residual(rate: complex, x: Array) -> tuple[Array, float]:
        left = pencil.stiffness @ x + rate * (system.damping @ x) + rate * rate * (system.mass @ x)
        size = np.abs(x)
        whole = terms[0] @ size
        whole[:k] += abs(rate) * (terms[1] @ size[:k]) + abs(rate)**2 * (terms[2] @ size[:k])
        reference = max(float(np.linalg.norm(scale * whole)), 1e-300)
        if rate == 0.0:
            # a free motion of a part that nothing strains, where all terms are round-off
            reference = max(reference, float(np.linalg.norm(size / scale)))
        return left, float(np.linalg.norm(scale * left)) / reference

    def share(x: Array) -> float:
        """Return how much of the first vector there is in this one, 0 to 1."""
        whole = np.real(np.vdot(start, mass @ start)) * np.real(np.vdot(x[:k], mass @ x[:k]))
        return float(abs(np.vdot(start, mass @ x[:k]))**2 / whole)

    left, size = residual(rate, x)
    best = rate, x, size
    for _ in range(ITERATIONS):
        if best[2] <= DONE:
            break
        y = _solved(system, rate, system.damping @ x + 2.0 * rate * (system.mass @ x))
        if y is None:
            break
        # Newton's method with the mass of the first vector as the condition on the size
        step = np.vdot(start, mass @ x[:k]) / np.vdot(start, mass @ y[:k])
        rate = complex(rate - step)
        x = y * step
        if abs(rate) <= least:
            rate = 0j
        if not rate.imag or abs(rate.imag) <= 1e-11 * abs(rate):
            rate = complex(rate.real)
        x = x / np.sqrt(float(np.real(np.vdot(x[:k], mass @ x[:k]))))
        if share(x) < SAME:
            # another motion, as of modes with the same rate, among which round-off chooses
            break
        left, size = residual(rate, x)
        if size >= 0.5 * best[2]:
            if size < best[2]:
                best = rate, x, size
            break
        best = rate, x, size
    rate, x, size = best
    known = rate != 0.0 and any(abs(rate - other) <= 1e-9 * abs(rate) and abs(np.vdot(y[:k], mass @ x[:k])) > 1.0 - 1e-6
                for other, y, _ in before)
    if not size <= GOOD or known:
        raise SingularError
    return rate, x, size
