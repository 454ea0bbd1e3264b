"""Quadrature points of the strain energy of B-splines of degree 2 and 3: Gauss rules of spline spaces, theory.md 3.1.

With p Gauss points an element splines of few elements lock: shear is to vanish at more points than there are shapes to choose
from. The energy of derivatives is exact with fewer: those of the Gauss rule of splines of degree 2 p - 2 with p - 2 continuous
derivatives, p/2 an element (T. Hughes, A. Reali, G. Sangalli, Comput. Methods Appl. Mech. Engrg. 199 (2010) 301-313).
"""
from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# elements that are solved for at most; beyond, equal ones repeat the pattern inside
SOLVED = {2: 80, 3: 40}
# error of integrals of all functions of the space, as a share of the length of an element
EXACT = 1e-13


def points_of(p: int, sizes: Array) -> tuple[Array, Array] | None:
    """Return places in their elements, 0 to 1, and weights as shares of the length of their element, [n, 2] both; an element with
    one point has another of weight zero. None if p Gauss points of an element are taken: for degrees 4 and 5, which lock little,
    for a single element, and for many unequal ones.

    p: degree.
    sizes: float64 [n], lengths of elements, m.
    """
    n = sizes.size
    equal = bool(np.ptp(sizes) <= 1e-12 * sizes.max())
    most = SOLVED.get(p, 0)
    if n == 1 or n > most and (most == 0 or not equal):
        return None
    few = n if n <= most else most - 4 + (n - most) % 4
    found = _of_equal(p, few) if equal else _of(p, np.concatenate(([0.0], np.cumsum(sizes) / sizes.sum())), False)
    if found is None or few == n:
        return found
    # inside, points repeat after one or two elements, with one change in the middle
    quarter, more = few // 4, (n - few) // 2
    order = np.concatenate((np.arange(quarter), quarter + np.arange(more) % 2, np.arange(quarter, few - quarter),
                            few - quarter - 2 + np.arange(more) % 2, np.arange(few - quarter, few)))
    return found[0][order], found[1][order]


@cache
def _of_equal(p: int, n: int) -> tuple[Array, Array] | None:
    return _of(p, np.arange(n + 1.0) / n, True)


def _of(p: int, ends: Array, symmetric: bool) -> tuple[Array, Array] | None:
    """Return `points_of` for elements with these ends, 0 to 1."""
    found = _quadratic(np.diff(ends), ends) if p == 2 else _solved(p, ends, symmetric)
    return None if found is None else _by_elements(*found, ends)


def _quadratic(sizes: Array, ends: Array) -> tuple[Array, Array] | None:
    """Return points and weights for degree 2: those of C0 parabolas. With one point in each element the integrals of its bubble
    and of the function of its outer end fix its place and its weight, from both ends to the middle, where two points or one at an
    end of elements remain."""
    n = sizes.size
    x, w = [], []

    def outside(order: list[int], inward: float) -> float:
        left = 0.0
        for e in order:
            before = sizes[e - int(inward)] if left else 0.0
            # share of the function of the outer end that this element has to bring, over its size
            share = (sizes[e] + before) / 3.0 / sizes[e] - left / sizes[e]
            # weight (1 - t)^2 = share, weight 2 t (1 - t) = 1/3
            t = 1.0 / (6.0 * share + 1.0)
            weight = share / (1.0 - t)**2
            left = weight * t * t * sizes[e]
            x.append(ends[e] + (t if inward > 0.0 else 1.0 - t) * sizes[e])
            w.append(weight * sizes[e])
        return left

    half = n // 2
    left, right = outside(list(range(half)), 1.0), outside(list(range(n - 1, n - 1 - half, -1)), -1.0)
    if n % 2 == 0:
        x.append(ends[half])
        w.append((sizes[half - 1] + sizes[half]) / 3.0 - left - right)
    else:
        found = _two_points(*(((sizes[half] + sizes[e]) / 3.0 - remaining) / sizes[half]
                              for e, remaining in ((half - 1, left), (half + 1, right))))
        if found is None:
            return None
        x += [ends[half] + t * sizes[half] for t in found[0]]
        w += [weight * sizes[half] for weight in found[1]]
    order = np.argsort(x)
    points, weights = np.array(x)[order], np.array(w)[order]
    sound = np.all(weights > 0.0) and np.all(np.diff(points) > 0.0) and points[0] > 0.0 and points[-1] < 1.0
    return (points, weights) if sound else None


def _two_points(a: float, b: float) -> tuple[list[float], list[float]] | None:
    """Return two points in an element with integrals a of (1 - t)^2, b of t^2 and 1/3 of 2 t (1 - t): of equal weights."""
    whole = a + b + 1.0 / 3.0
    # moments of 1, t, t^2; equal weights leave one solution
    first, second = (b + 1.0 / 6.0) / whole, b / whole
    spread = second - first * first
    if spread <= 0.0:
        return None
    off = float(np.sqrt(spread))
    return [first - off, first + off], [0.5 * whole, 0.5 * whole]


def _solved(p: int, ends: Array, symmetric: bool) -> tuple[Array, Array] | None:
    """Solve for points and weights on 0 to 1; None if there are none that are inside, in order and positive."""
    q, smooth = 2 * p - 2, p - 2
    knots = np.concatenate((np.zeros(q + 1), np.repeat(ends[1:-1], q - smooth), np.ones(q + 1)))
    size = knots.size - q - 1
    m = (size + 1) // 2
    whole = (knots[q + 1:] - knots[:size]) / (q + 1)
    centre = np.array([knots[i + 1:i + q + 1].mean() for i in range(size)])
    # a point begins between two functions. An odd space leaves one choice: least changes of a start that a mirrored mesh has, too
    share = np.zeros((m, size))
    share[np.arange(size) // 2, np.arange(size)] = 0.5
    share = share + share[::-1, ::-1] if size % 2 else 2.0 * share
    x, w = share @ centre / share.sum(axis=1), share @ whole
    fold = _folded(m) if symmetric else np.eye(2 * m)
    z = np.linalg.pinv(fold) @ np.concatenate((x - 0.5, w))

    def unfolded(z: Array) -> tuple[Array, Array]:
        both = fold @ z
        return np.clip(both[:m] + 0.5, 0.0, 1.0 - 1e-15), both[m:]

    def missing(z: Array) -> tuple[Array, Array]:
        """Return the error of the integrals, and its derivative."""
        x, w = unfolded(z)
        values, slopes = _splines(q, knots, x)
        return values.T @ w - whole, np.hstack((slopes.T * w, values.T)) @ fold

    miss, tangent = missing(z)
    for _ in range(200):
        change = np.linalg.lstsq(tangent, -miss, rcond=1e-12)[0]
        part = 1.0
        while part > 1e-4:
            tried = missing(z + part * change)
            if np.linalg.norm(tried[0]) < (1.0 - 0.1 * part) * np.linalg.norm(miss):
                break
            part *= 0.5
        else:
            break
        z = z + part * change
        miss, tangent = tried
    x, w = unfolded(z)
    sound = np.max(np.abs(miss)) <= EXACT * np.min(np.diff(ends)) and np.all(np.diff(x) > 0.0) and np.all(w > 0.0)
    return (x, w) if sound else None


def _folded(m: int) -> Array:
    """Return the map [2 m, m] from the first half of points, from the middle on, and weights to all of them."""
    half, middle = m // 2, m % 2
    out = np.zeros((2 * m, m))
    i = np.arange(half)
    out[i, i], out[m - 1 - i, i] = 1.0, -1.0
    j = np.arange(half + middle)
    out[m + j, half + j] = out[2 * m - 1 - j, half + j] = 1.0
    return out


def _splines(q: int, knots: Array, x: Array) -> tuple[Array, Array]:
    """Evaluate all B-splines of degree q, repeated knots included, and their derivatives at x [m]: [m, size] both."""
    span = np.searchsorted(knots, x, side="right") - 1
    values = np.zeros((x.size, knots.size - 1))
    values[np.arange(x.size), span] = 1.0
    lower = values
    for j in range(1, q + 1):
        lower, values = values, np.zeros((x.size, knots.size - 1 - j))
        gap = knots[j:] - knots[:-j]
        share = np.divide(1.0, gap, out=np.zeros_like(gap), where=gap > 0.0)
        left, right = (x[:, None] - knots[:-j]) * share, (knots[j:] - x[:, None]) * share
        values = left[:, :-1] * lower[:, :-1] + right[:, 1:] * lower[:, 1:]
    return values, q * (lower[:, :-1] * share[:-1] - lower[:, 1:] * share[1:])


def _by_elements(x: Array, w: Array, ends: Array) -> tuple[Array, Array]:
    """Sort points and weights into elements, filled up with points of weight zero in the middle."""
    n = ends.size - 1
    element = np.clip(np.searchsorted(ends, x, side="right") - 1, 0, n - 1)
    number = np.bincount(element, minlength=n)
    place = np.arange(x.size) - (np.cumsum(number) - number)[element]
    sizes = np.diff(ends)
    at, weight = np.full((n, number.max()), 0.5), np.zeros((n, number.max()))
    at[element, place] = (x - ends[element]) / sizes[element]
    weight[element, place] = w / sizes[element]
    return at, weight
