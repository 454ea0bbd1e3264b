"""Shape functions of the two families: Lagrange polynomials on Lobatto nodes, B-splines and their director quasi-interpolant."""
from __future__ import annotations

from math import comb

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


def gll_nodes(degree: int) -> Array:
    """Return the degree + 1 Gauss-Lobatto-Legendre nodes on [-1, 1]: the zeros of (1 - x^2) P_p'(x), ascending and exactly
    symmetric."""
    p = degree
    top = np.eye(p + 1)[p]
    slope, curvature = legendre.legder(top), legendre.legder(top, 2)
    x = -np.cos(np.pi * np.arange(p + 1) / p)
    for _ in range(12 if p > 1 else 0):  # Newton from the Chebyshev-Lobatto points converges quadratically for every p in use
        x[1:-1] -= legendre.legval(x[1:-1], slope) / legendre.legval(x[1:-1], curvature)
    x[0], x[-1] = -1.0, 1.0
    return 0.5 * (x - x[::-1])


def lagrange_shapes(p: int, xi: Array, sizes: Array) -> tuple[Array, Array]:
    """Return Lagrange polynomials through the Lobatto nodes at xi [m] and their d/ds, both [n_elements, m, p+1]."""
    # discrete Legendre transform on the Lobatto nodes: N_a = sum_k w_a P_k(x_a) / gamma_k P_k
    nodes = gll_nodes(p)
    vander = legendre.legvander(nodes, p)
    norm = np.append(2.0 / (2.0 * np.arange(p) + 1.0), 2.0 / p)
    coef = (2.0 / (p * (p + 1) * vander[:, p] ** 2))[:, None] * vander / norm
    coef = fix_sum(coef[None])[0]
    values = legendre.legval(xi, coef.T).T
    slopes = np.ascontiguousarray(legendre.legval(xi, legendre.legder(coef.T, axis=0)).T)
    return np.repeat(values[None], sizes.size, axis=0), slopes[None] * (2.0 / sizes)[:, None, None]


def bspline_shapes(p: int, knots: Array, theta: Array) -> tuple[Array, Array]:
    """Return B-splines on each element at its fractions theta [m] and their derivative, both [n_elements, m, p+1]: Cox-de
    Boor."""
    n_elements = knots.size - 2 * p - 1
    span = slice(p, p + n_elements)

    def gap(high: int, low: int) -> Array:
        # knot difference t[i + high] - t[i + low] of every element i, as a column
        return (knots[p + high:p + high + n_elements] - knots[p + low:p + low + n_elements])[:, None]

    x = theta * (knots[p + 1:p + 1 + n_elements] - knots[span])[:, None]
    values = [np.ones_like(x)]
    lower = values
    for j in range(1, p + 1):
        lower, saved, values = values, np.zeros_like(x), []
        for r in range(j):
            part = lower[r] / gap(r + 1, r + 1 - j)
            values.append(saved + (gap(r + 1, 0) - x) * part)
            saved = (x + gap(0, r + 1 - j)) * part
        values.append(saved)
    # N' = p (N_low[a-1] / (t[i+a] - t[i+a-p]) - N_low[a] / (t[i+a+1] - t[i+a+1-p]))
    scaled = [p * lower[a] / gap(a + 1, a + 1 - p) for a in range(p)]
    zero = np.zeros_like(x)
    slopes = [left - right for left, right in zip([zero] + scaled, scaled + [zero])]
    return np.stack(values, axis=2), np.stack(slopes, axis=2)


def spread_table(knots: Array, greville: Array, p: int) -> tuple[IntArray, int, Array]:
    """Return first node [n_elements], number nn of nodes of an element, map [n_elements, p+1, nn] from its triads to
    coefficients."""
    start, last, weights = _director_weights(knots, greville, p)
    n = greville.size
    element = np.arange(n - p)
    rows = element[:, None] + np.arange(p + 1)
    low, high = start[rows].min(axis=1), last[rows].max(axis=1)
    nn = int((high - low).max()) + 1
    first = np.minimum(low, n - nn)
    # a symmetric window is shorter than the table: its zeros may land in spare columns
    width = weights.shape[1]
    spread = np.zeros((n - p, p + 1, nn + width - p))
    columns = (start[rows] - first[:, None])[:, :, None] + np.arange(width)
    np.put_along_axis(spread, columns, weights[rows], axis=2)
    return first, nn, np.ascontiguousarray(spread[:, :, :nn])


def _director_weights(knots: Array, greville: Array, p: int) -> tuple[IntArray, IntArray, Array]:
    """Return the local quasi-interpolant that reproduces degree p, theory.md 3.1 (b).

    Coefficient A is sum_k weights[A, k] triad[start[A] + k].

    Even p: windows of p + 1 points, for which the weights are unique. Odd p: a symmetric window of p points where that suffices
    (equal elements around A); elsewhere p + 2 points and the weights of least norm on unequal elements, and p + 1 points near the
    ends of a beam of equal elements (one node less per element). Windows are shifted inwards at the ends.
    Returns start [n], last [n] (window bounds) and weights [n, width].
    """
    n, half = greville.size, p // 2
    node = np.arange(n)
    inner_knots = knots[1 + node[:, None] + np.arange(p)]
    sizes = np.diff(knots[p:n + 1])
    rounding = 8.0 * np.finfo(float).eps * greville[-1]  # round-off of a difference of arc lengths
    equal = np.ptp(sizes) <= rounding
    width = p + 1 if p % 2 == 0 or equal else min(p + 2, n)
    wide = node - half if p % 2 == 0 else np.where(equal & (2 * node < n), node - half, node - half - 1)
    start = np.clip(wide, 0, n - width)
    last = start + width - 1
    weights = np.zeros((n, width))
    todo = np.ones(n, dtype=bool)
    if equal:
        todo[2 * p + 1:n - 2 * p] = False  # all alike, copied below
    middle = node[todo & (node > half) & (node < n - 1 - half)] if p % 2 else node[:0]
    if middle.size:
        # a symmetric window of p points misses degree p only through the unevenness of its points and knots
        points, inner = greville[middle[:, None] + np.arange(-half, half + 1)], inner_knots[middle]
        uneven = np.abs(inner + inner[:, ::-1] - 2.0 * points[:, half:half + 1]).max(axis=1)
        uneven = np.maximum(uneven, np.abs(points + points[:, ::-1] - 2.0 * points[:, half:half + 1]).max(axis=1))
        even = uneven <= rounding
        rows = middle[even]
        weights[rows, :p] = _blossom_weights(points[even], inner[even], p)
        start[rows], last[rows], todo[rows] = rows - half, rows + half, False
    todo[[0, -1]] = False  # first and last triad exactly
    weights[0, 0] = weights[-1, -1] = 1.0
    weights[todo] = _blossom_weights(greville[start[todo, None] + np.arange(width)], inner_knots[todo], p)
    if equal and n > 4 * p + 1:
        inside, model = slice(2 * p + 1, n - 2 * p), 2 * p
        weights[inside] = weights[model]
        start[inside], last[inside] = node[inside] + (start[model] - model), node[inside] + (last[model] - model)
    return start, last, weights


def _blossom_weights(points: Array, arguments: Array, p: int) -> Array:
    """Return weights [m, w] on points [m, w] that turn values of a polynomial into its polar form at arguments [m, p].

    The polar form of x^k, k <= p, is e_k(arguments) / binomial(p, k): the B-spline coefficient if these are the inner knots.
    w = p + 1, w = p + 2 (the weights of least norm are taken) or w = p (for windows whose symmetry takes care of degree p).
    """
    centre, scale = 0.5 * (points[:, :1] + points[:, -1:]), 0.5 * (points[:, -1:] - points[:, :1])
    x, y = (points - centre) / scale, (arguments - centre) / scale
    polar = np.zeros((points.shape[0], p + 1))
    polar[:, 0] = 1.0
    for j in range(p):
        polar[:, 1:] += y[:, j:j + 1] * polar[:, :-1].copy()
    polar /= [comb(p, k) for k in range(p + 1)]
    width = points.shape[1]
    fixed = min(width, p + 1)
    powers = np.ones((points.shape[0], fixed, width))
    for k in range(1, fixed):
        powers[:, k] = powers[:, k - 1] * x
    square = powers[:, :, :fixed]
    weights = np.zeros((points.shape[0], width, 1))
    weights[:, :fixed] = np.linalg.solve(square, polar[:, :fixed, None])
    if width == p + 2:
        # the divided difference of order p + 1 spans the weights that may be added without a change up to degree p
        null = 1.0 / np.stack([(x[:, b:b + 1] - np.delete(x, b, axis=1)).prod(axis=1) for b in range(width)], axis=1)
        null /= np.sqrt((null ** 2).sum(axis=1))[:, None]
        weights[:, :, 0] -= (null * weights[:, :, 0]).sum(axis=1)[:, None] * null
    weights[:, :fixed] += np.linalg.solve(square, polar[:, :fixed, None] - powers @ weights)
    return fix_sum(weights)[:, :, 0]


def fix_sum(coef: Array) -> Array:
    """Take the rounding error of sum_a coef[e, a, k] = (1, 0, 0, ...)[k] out of the largest entry, in place."""
    for _ in range(2):
        defect = coef.sum(axis=1)
        defect[:, 0] -= 1.0
        largest = np.abs(coef).argmax(axis=1)[:, None, :]
        np.put_along_axis(coef, largest, np.take_along_axis(coef, largest, axis=1) - defect[:, None, :], axis=1)
    return coef
