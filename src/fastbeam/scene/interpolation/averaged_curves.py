"""Curves averaged over a length: the contact curve of a sleeve with a bore, theory.md 5.8.

The shape functions of a point are replaced by their mean, weighed by a quadratic B-spline of that width: three convolutions with
a box of a third of it. Beyond its ends the beam is continued by reflection at the end point, so that straight lines keep their
length and the ends stay where they are. Convolutions of piecewise polynomials are piecewise polynomials: the result is a curve
like any other, with second derivatives that are continuous.
"""
from __future__ import annotations

import numpy as np
from numpy.polynomial import legendre

from fastbeam.interface.errors import SceneError
from fastbeam.scene.interpolation.basis import Basis, CurveBasis
from fastbeam.scene.interpolation.shapes import fix_sum

Array = np.ndarray
# pieces shorter than this share of the beam are round-off
LEAST_PIECE = 1e-9


def averaged_curve(basis: Basis, width: float) -> CurveBasis:
    """Return the position basis of a beam averaged over `width`, m; made once for a basis and a width. Raises SceneError: the
    width is not positive or longer than the beam."""
    if not 0.0 < width <= basis.length:
        raise SceneError(f"averaged curve: width={width:.6g} m must be positive and at most the length of the beam, "
                         f"{basis.length:.6g} m")
    known = basis.__dict__.setdefault("_averaged", {})
    if width not in known:
        known[width] = _averaged(basis, width)
    return known[width]


def _averaged(basis: Basis, width: float) -> CurveBasis:
    length = basis.length
    ends = basis.element_ends
    mirrored = np.concatenate((-ends[:0:-1], ends, 2.0 * length - ends[-2::-1]))
    knots = width * np.array([-0.5, -1.0 / 6.0, 1.0 / 6.0, 0.5])
    cuts = np.sort((mirrored[:, None] - knots).reshape(-1))
    least = LEAST_PIECE * length
    cuts = cuts[(cuts > least) & (cuts < length - least)]
    cuts = np.concatenate(([0.0], cuts[np.diff(cuts, prepend=-1.0) > least], [length]))
    first_node = basis.curve("own").first_node
    pieces: list[tuple[int, Array]] = []
    known: dict[tuple[float, ...], tuple[int, tuple[int, Array]]] = {}
    for a, b in zip(cuts[:-1], cuts[1:]):
        inside = mirrored[(mirrored > 0.5 * (a + b) - 0.5 * width) & (mirrored < 0.5 * (a + b) + 0.5 * width)]
        low, high = np.searchsorted(ends, 0.5 * (a + b) + 0.5 * np.array([-width, width])) - 1
        # splines of an element depend on the elements beside it
        margin = basis.degree if basis.interpolation == "bspline" else 0
        if a > width and b < length - width and low >= margin and high < basis.n_elements - margin:
            # pieces that see equal elements alike are computed once
            near = ends[low - margin:high + margin + 2]
            key = tuple(np.round((np.concatenate(([a, b], near)) - ends[low]) / width, 9))
            start = int(first_node[low])
            if key not in known:
                known[key] = start, _piece(basis, a, b, inside, knots)
            before, (first, coef) = known[key]
            pieces.append((first + start - before, coef))
        else:
            pieces.append(_piece(basis, a, b, inside, knots))
    most = max(len(coef) for _, coef in pieces)
    coef = np.zeros((len(pieces), most, basis.degree + 4))
    for out, (_, found) in zip(coef, pieces):
        out[:len(found)] = found
    count = np.array([len(found) for _, found in pieces])
    return CurveBasis(cuts, np.array([first for first, _ in pieces]), count, coef)


def _piece(basis: Basis, a: float, b: float, inside: Array, knots: Array) -> tuple[int, Array]:
    """Return the first node and Legendre coefficients [n, p + 4] between a and b, where the window sees these element ends
    [m]."""
    own, length, n = basis.curve("own"), basis.length, basis.degree + 4
    xi, weight = legendre.leggauss(n)
    s = 0.5 * (a + b) + 0.5 * (b - a) * xi
    parts = np.sort(np.concatenate((np.broadcast_to(inside, (n, inside.size)), s[:, None] + knots), axis=1), axis=1)
    half = 0.5 * np.diff(parts, axis=1)
    # window of degree 2 times shape functions of degree p
    gauss, gauss_weight = legendre.leggauss(basis.degree // 2 + 2)
    x = 0.5 * (parts[:, 1:] + parts[:, :-1])[:, :, None] + half[:, :, None] * gauss
    w = half[:, :, None] * gauss_weight * _window(x - s[:, None, None], float(knots[-1] - knots[0]))
    below, above = x < 0.0, x > length
    first, values, _ = own.evaluate(np.where(below, -x, np.where(above, 2.0 * length - x, x)).reshape(-1))
    sign = np.where(below | above, -1.0, 1.0)
    lo = int(first.min())
    table = np.zeros((n, int(first.max()) - lo + values.shape[1] + 1))
    sample = np.repeat(np.arange(n), x[0].size)
    np.add.at(table, (sample[:, None], (first - lo)[:, None] + np.arange(values.shape[1])),
              (sign * w).reshape(-1, 1) * values)
    if below.any():
        table[:, 0] += 2.0 * np.sum(w * below, axis=(1, 2))
    if above.any():
        table[:, basis.n_nodes - 1 - lo] += 2.0 * np.sum(w * above, axis=(1, 2))
    seen = np.flatnonzero(np.any(np.abs(table) > 1e-14, axis=0))
    lo, table = lo + int(seen[0]), table[:, seen[0]:seen[-1] + 1]
    project = legendre.legvander(xi, n - 1) * weight[:, None] * (np.arange(n) + 0.5)
    return lo, fix_sum((table.T @ project)[None])[0]


def _window(x: Array, width: float) -> Array:
    """Return the quadratic B-spline of this width around 0, with integral 1."""
    t = 3.0 * np.abs(x) / width
    return 3.0 / width * np.where(t <= 0.5, 0.75 - t * t, 0.5 * np.maximum(1.5 - t, 0.0)**2)
