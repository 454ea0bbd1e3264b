"""Interpolation tables of one beam: shape functions as data (theory.md 3.2).

Two families, one table layout. `lagrange`: C0 polynomials through Gauss-Lobatto-Legendre nodes, degree 1 to 8. `bspline`:
C^(p-1) splines on an open knot vector, degree 2 to 5; their directors sit at the control points or, quasi-interpolated, at the
Greville abscissae. Nothing that reads these tables knows a family.
"""
from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import isfinite
from numbers import Integral
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

from fastbeam.interface.errors import SceneError
from fastbeam.scene.interpolation.shapes import bspline_shapes, fix_sum, gll_nodes, lagrange_shapes, spread_table
from fastbeam.scene.interpolation.spline_quadrature import points_of

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

DEGREES: dict[str, tuple[int, int]] = {"lagrange": (1, 8), "bspline": (2, 5)}
DIRECTORS: tuple[str, ...] = ("nodes", "greville", "control")
END_TOLERANCE = 1e-12  # share of the length by which a given end may miss 0 and length, and s may leave the beam


@dataclass(frozen=True)
class CurveBasis:
    """Curve a slider runs on, c(s) = sum_a N_a(s) phi_a, polynomial in xi in [-1, 1] on each element, theory.md (3.1)."""

    element_ends: Array  # [n_elements+1]: arc lengths of the element ends, m
    # first_node, n_nodes_of, int [n_elements]: element e touches the nodes first_node .. first_node + n_nodes_of - 1 of the beam
    first_node: IntArray
    n_nodes_of: IntArray
    # [n_elements, max_nodes, n_coef]: Legendre coefficients: N_a = sum_k coef[e, a, k] P_k(xi); zero beyond n_nodes_of. Their sum
    # over a is (1, 0, 0, ...)
    coef: Array

    def evaluate(self, s: ArrayLike) -> tuple[IntArray, Array, Array]:
        """Return the first touched node [m], shape functions [m, max_nodes] and their d/ds (1/m) at the arc lengths s [m] in m.

        An element owns its left end; the last one also its right end.

        Raises SceneError: if an s lies outside the beam.
        """
        s = np.atleast_1d(np.asarray(s, dtype=float))
        length = self.element_ends[-1]
        outside = ~((s >= -END_TOLERANCE * length) & (s <= length * (1.0 + END_TOLERANCE)))
        if outside.any():
            raise SceneError(f"curve: s={s[outside][0]:g} lies outside the beam (0 to {length:g} m): choose a point on it")
        e = np.clip(np.searchsorted(self.element_ends, s, side="right") - 1, 0, self.first_node.size - 1)
        size = self.element_ends[e + 1] - self.element_ends[e]
        xi = 2.0 * (s - self.element_ends[e]) / size - 1.0
        n_coef = self.coef.shape[2]
        values = np.einsum("mk,mak->ma", legendre.legvander(xi, n_coef - 1), self.coef[e])
        slopes = legendre.legder(np.eye(n_coef), axis=0)  # column k: Legendre coefficients of P_k'
        legendre_s = legendre.legvander(xi, n_coef - 2) @ slopes * (2.0 / size)[:, None]
        return self.first_node[e], values, np.einsum("mk,mak->ma", legendre_s, self.coef[e])


@dataclass(frozen=True)
class Basis:
    """Tables of one beam (theory.md 3.2). nn nodes per element, nq points of the strain energy: degree Gauss points, of
    splines of degree 2 and 3 two, of which one may have weight zero (`spline_points`); nm = degree + 1 Gauss points."""

    # interpolation, degree, directors, length, n_nodes, n_elements: what the tables were built from; length in m; directors is
    # 'nodes', 'greville' or 'control'
    interpolation: str
    degree: int
    directors: str
    length: float
    n_nodes: int
    n_elements: int
    # [n_nodes]: arc length of the nodes, m: Gauss-Lobatto-Legendre nodes (lagrange) or Greville abscissae (bspline)
    node_s: Array
    element_ends: Array  # [n_elements+1]: arc lengths of the element ends, m
    # int [n_elements, nn]: nodes of every element, numbered along the beam, consecutive. A table entry is zero where a node does
    # not matter
    element_nodes: IntArray
    # point_s, weight, [n_elements, nq]: arc length and weight, m, of the points of the strain energy
    point_s: Array
    weight: Array
    # phi, phi_s, dir, dir_s, [n_elements, nq, nn]: position and director basis there and their d/ds (1/m). `dir is phi` unless
    # directors is 'greville'
    phi: Array
    phi_s: Array
    dir: Array
    dir_s: Array
    # mass_phi, mass_dir, [n_elements, nn, nn]: int N_a N_b ds (m) of the position and the director basis, exact
    mass_phi: Array
    mass_dir: Array
    # mass_point_s, mass_weight, [n_elements, nm]: points (m) and weights (m) that integrate masses and distributed loads
    mass_point_s: Array
    mass_weight: Array
    mass_phi_values: Array  # [n_elements, nm, nn]: position basis there
    # [n_elements, p+1, nn] or None: what the director basis makes of the p + 1 functions of positions, where it is another one
    spread: Array | None = None

    def shapes(self, element: IntArray, s: Array) -> tuple[Array, Array]:
        """Return the position and director basis of the nodes of elements [m] at arc lengths s [m, g] within them: [m, g, nn]
        each."""
        curve = self.curve("own")
        begin, end = self.element_ends[element], self.element_ends[element + 1]
        xi = (2.0 * (s - begin[:, None]) / (end - begin)[:, None]) - 1.0
        # nodes that all elements have
        own = np.einsum("mgk,mak->mga", legendre.legvander(xi, self.degree), curve.coef[element][:, :self.degree + 1])
        if self.spread is None:
            return own, own
        wide = np.zeros((*s.shape, self.element_nodes.shape[1]))
        at = (curve.first_node[element] - self.element_nodes[element, 0])[:, None] + np.arange(self.degree + 1)
        np.put_along_axis(wide, np.broadcast_to(at[:, None], own.shape), own, axis=2)
        return wide, own @ self.spread[element]

    def fit_positions(self, values: ArrayLike) -> Array:
        """Return the nodal coefficients [n_nodes, k] of the curve through values [n_nodes, k] at node_s.

        A banded collocation solve for bspline, the identity for lagrange.

        Raises SceneError: if there is not one row of values per node.
        """
        values = np.asarray(values, dtype=float)
        if values.ndim == 0 or values.shape[0] != self.n_nodes:
            raise SceneError(f"fit_positions: values has shape {values.shape}, but the basis has {self.n_nodes} nodes: "
                             "give one row per node_s")
        if self.interpolation == "lagrange":
            return values.copy()
        from scipy.linalg import solve_banded

        first, rows, _ = self.curve("own").evaluate(self.node_s)
        node = np.arange(self.n_nodes)
        lower, upper = int((node - first).max()), int((first + self.degree - node).max())
        band = np.zeros((lower + upper + 1, self.n_nodes))
        for a in range(self.degree + 1):
            band[upper + node - (first + a), first + a] = rows[:, a]
        return solve_banded((lower, upper), band, values)

    def curve(self, kind: str) -> CurveBasis:
        """Return the basis of the curve a slider runs on: 'own' is the position basis, 'c1' has a continuous tangent, theory.md
        (3.1).

        For lagrange 'c1' bends every element polynomial towards the mean of the two slopes at its inner ends. The weight of a
        slope is the p-th power of the other element's length: equal on uniform meshes, and for odd p the leading errors of the
        slopes cancel. The corrections vanish at all nodes. A bspline is its own 'c1' curve, and so is a single element.

        Raises SceneError: if kind is unknown.
        """
        if kind not in ("own", "c1"):
            raise SceneError(f"curve '{kind}' does not exist: choose 'own' or 'c1'")
        if kind not in self._curves:
            self._curves[kind] = self._curve(kind)
        return self._curves[kind]

    @cached_property
    def _curves(self) -> dict[str, CurveBasis]:
        """Curves that were asked for, by their kind."""
        return {}

    def _curve(self, kind: str) -> CurveBasis:
        """Form the basis of one of these curves."""
        n, p = self.n_elements, self.degree
        if self.interpolation == "bspline":
            return CurveBasis(self.element_ends, np.arange(n), np.full(n, p + 1), _own_coefficients(self, n))
        own = _own_coefficients(self, 1)[0]
        if kind == "c1" and n > 1:
            return _smoothed_curve(self.element_ends, own, p)
        return CurveBasis(self.element_ends, np.arange(n) * p, np.full(n, p + 1), np.repeat(own[None], n, axis=0))

    def position_matrix(self, s: ArrayLike) -> tuple[Array, Array]:
        """Return the position basis and its d/ds (1/m) at the arc lengths s [m] in m, two dense arrays [m, n_nodes]. Raises
        SceneError: if an s lies outside the beam."""
        first, values, values_s = self.curve("own").evaluate(s)
        columns = first[:, None] + np.arange(self.degree + 1)
        matrix, matrix_s = np.zeros((first.size, self.n_nodes)), np.zeros((first.size, self.n_nodes))
        np.put_along_axis(matrix, columns, values, axis=1)
        np.put_along_axis(matrix_s, columns, values_s, axis=1)
        return matrix, matrix_s


class _Elements(NamedTuple):
    """Elements of one family, on which shape functions are evaluated."""

    degree: int
    ends: Array     # [n + 1], m
    sizes: Array    # [n], m
    kinds: Array    # sizes of those with tables of their own, the first where all are equal, [1 or n], m
    knots: Array | None = None    # of a spline
    unit: float = 1.0             # in which knots are counted, m

    def gauss(self, n_points: int) -> tuple[Array, Array, Array, Array]:
        """Find Gauss points: arc lengths, weights, shape functions of the p + 1 own nodes and their d/ds there."""
        xi, w = legendre.leggauss(n_points)
        theta = 0.5 * (1.0 + xi)
        shapes = lagrange_shapes(self.degree, xi, self.kinds) if self.knots is None else self.spline_shapes(theta)
        weight, values, values_s = map(self.every, (0.5 * self.kinds[:, None] * w, *shapes))
        return self.ends[:-1, None] + theta * self.sizes[:, None], weight, values, values_s

    def spline_shapes(self, theta: Array) -> tuple[Array, Array]:
        """Evaluate the shape functions of a spline and their d/ds at fractions theta of its elements."""
        assert self.knots is not None
        values, slopes = bspline_shapes(self.degree, self.knots, theta)
        return values, slopes / self.unit

    def every(self, table: Array) -> Array:
        """Spread a table of `kinds` over all elements."""
        return np.broadcast_to(table, (self.sizes.size, *table.shape[1:]))


def build_basis(interpolation: str, degree: int, n_elements_or_ends: int | ArrayLike, length: float,
                directors: str = "greville") -> Basis:
    """Build the interpolation tables of a beam of the given length (m), theory.md 3.2.

    Parameters
    ----------
    interpolation : 'lagrange' (degree 1 to 8) or 'bspline' (degree 2 to 5).
    n_elements_or_ends : number of equal elements, or the arc lengths of all element ends, from 0 to length (m).
    directors : where the triads of a bspline sit, 'greville' or 'control'; the result of lagrange always says 'nodes'.

    Raises
    ------
    SceneError
        If an argument is unknown or out of range.

    Examples
    --------
    >>> basis = build_basis("lagrange", 2, 4, 1.0)
    >>> basis.n_nodes, basis.phi.shape, round(float(basis.weight.sum()), 12)
    (9, (4, 2, 3), 1.0)
    """
    _check_family(interpolation, degree, directors)
    p = int(degree)
    ends, sizes = _element_grid(n_elements_or_ends, length)
    length, n_elements = float(length), sizes.size
    element = np.arange(n_elements)
    spread: Array | None = None
    equal = np.ndim(n_elements_or_ends) == 0
    elements = _Elements(p, ends, sizes, sizes)
    if interpolation == "lagrange":
        # equal elements share what they have
        elements = elements._replace(kinds=sizes[:1] if equal else sizes)
        directors, stride, n_nodes = "nodes", p, n_elements * p + 1
        xi_nodes = gll_nodes(p)
        node_s = np.append((ends[:-1, None] + 0.5 * (1.0 + xi_nodes[:-1]) * sizes[:, None]).ravel(), length)
        first, nn = element * p, p + 1
    else:
        stride, n_nodes = 1, n_elements + p
        # equal elements: knots 0, 1, 2, ... keep every knot difference exact
        unit = sizes[0] if equal else 1.0
        breaks = np.arange(n_elements + 1.0) if equal else ends
        knots = np.concatenate((np.full(p, breaks[0]), breaks, np.full(p, breaks[-1])))
        greville = sum(knots[1 + j:1 + j + n_nodes] for j in range(p)) / p
        node_s = greville * unit
        node_s[0], node_s[-1] = 0.0, length
        elements = elements._replace(knots=knots, unit=unit)
        first, nn = element, p + 1
        if directors == "greville":
            first, nn, spread = spread_table(knots, greville, p)

    rule = points_of(p, sizes) if interpolation == "bspline" else None
    if rule is None:
        point_s, weight, own, own_s = elements.gauss(p)
    else:
        at, share = rule
        point_s, weight = ends[:-1, None] + at * sizes[:, None], share * sizes[:, None]
        own, own_s = elements.spline_shapes(at)
    mass_point_s, mass_weight, mass_own, _ = elements.gauss(p + 1)  # exact to degree 2 p + 1
    shift = element * stride - first
    phi, phi_s, mass_values = (_widen(table, shift, nn) for table in (own, own_s, mass_own))  # zero for nodes that do not matter
    kinds = elements.kinds.size
    mass_phi = elements.every(_mass(mass_own[:kinds], mass_weight[:kinds]))
    if nn > p + 1:
        mass_phi = _widen(_widen(mass_phi, shift, nn).transpose(0, 2, 1), shift, nn)  # columns, then rows
    dir_, dir_s, mass_dir = phi, phi_s, mass_phi
    if spread is not None:
        dir_, dir_s = own @ spread, own_s @ spread
        mass_dir = _mass(mass_own @ spread, mass_weight)
    return Basis(interpolation, p, directors, length, n_nodes, n_elements, node_s, ends, first[:, None] + np.arange(nn), point_s,
                 weight, phi, phi_s, dir_, dir_s, mass_phi, mass_dir, mass_point_s, mass_weight, mass_values, spread)


def _check_family(interpolation: str, degree: int, directors: str) -> None:
    if interpolation not in DEGREES:
        choice = " or ".join(f"'{name}' (degree {low} to {high})" for name, (low, high) in DEGREES.items())
        raise SceneError(f"interpolation '{interpolation}' does not exist: choose {choice}")
    low, high = DEGREES[interpolation]
    if isinstance(degree, bool) or not isinstance(degree, Integral) or not low <= degree <= high:
        raise SceneError(f"interpolation '{interpolation}': degree={degree!r} does not exist: "
                         f"choose an integer from {low} to {high}")
    if directors not in DIRECTORS:
        raise SceneError(f"directors '{directors}' do not exist: choose 'greville' or 'control'")
    if interpolation == "bspline" and directors == "nodes":
        raise SceneError("directors 'nodes' exist for 'lagrange' only: choose 'greville' or 'control' for 'bspline'")


def _element_grid(n_elements_or_ends: int | ArrayLike, length: float) -> tuple[Array, Array]:
    """Return the element ends [n+1] and sizes [n] in m, checked."""
    if not (isfinite(length) and length > 0.0):
        raise SceneError(f"beam: length={length!r} must be positive and finite: give the length in m")
    if np.ndim(n_elements_or_ends) == 0:
        n = n_elements_or_ends
        if isinstance(n, (bool, np.bool_)) or not isinstance(n, Integral) or n < 1:
            raise SceneError(f"beam: n_elements={n!r} must be an integer of at least 1: "
                             "give a number of elements or all element ends")
        ends = float(length) * (np.arange(int(n) + 1) / int(n))
        return ends, np.full(int(n), float(length) / int(n))
    ends = np.array(n_elements_or_ends, dtype=float)
    if ends.ndim != 1 or ends.size < 2:
        raise SceneError(f"beam: element ends of shape {ends.shape} are no mesh: "
                         "give a list of at least two arc lengths, from 0 to length")
    for index, name, expected in ((0, "first", 0.0), (-1, "last", float(length))):
        if not abs(ends[index] - expected) <= END_TOLERANCE * length:
            raise SceneError(f"beam: the {name} element end is {ends[index]:g} m and must be {expected:g} m: "
                             "element ends run from 0 to length")
        ends[index] = expected
    wrong = np.flatnonzero(~(np.diff(ends) > 0.0))
    if wrong.size:
        i = wrong[0]
        raise SceneError(f"beam: element ends must increase strictly, but end {i} is {ends[i]:g} m and end {i + 1} is "
                         f"{ends[i + 1]:g} m: sort the ends and drop repeated ones")
    return ends, np.diff(ends)


def _widen(table: Array, shift: IntArray, nn: int) -> Array:
    """Return the table [n_elements, m, p+1] of the own nodes placed at column shift[e] of a table [n_elements, m, nn]."""
    if table.shape[2] == nn:
        return table
    wide = np.zeros(table.shape[:2] + (nn,))
    usual = int(np.bincount(shift).argmax())
    wide[:, :, usual:usual + table.shape[2]] = table
    for column in np.unique(shift[shift != usual]):
        rows = np.flatnonzero(shift == column)
        wide[rows] = 0.0
        wide[rows, :, column:column + table.shape[2]] = table[rows]
    return wide


def _mass(values: Array, weight: Array) -> Array:
    """Return int N_a N_b ds [n_elements, nn, nn] from values [n_elements, m, nn] at Gauss points."""
    return values.transpose(0, 2, 1) @ (weight[:, :, None] * values)


def _own_coefficients(basis: Basis, n: int) -> Array:
    """Return Legendre coefficients [n, p+1, p+1] of the position basis on the first n elements, by exact projection."""
    p = basis.degree
    xi, w = legendre.leggauss(p + 1)
    project = legendre.legvander(xi, p) * w[:, None] * (np.arange(p + 1) + 0.5)
    values = basis.mass_phi_values[:n]
    if values.shape[2] > p + 1:
        columns = (np.arange(n) - basis.element_nodes[:n, 0])[:, None] + np.arange(p + 1)
        values = np.take_along_axis(values, columns[:, None, :], axis=2)
    return fix_sum(np.ascontiguousarray(np.tensordot(values, project, axes=(1, 0))))


def end_bumps(p: int) -> tuple[Array, Array]:
    """Return Legendre coefficients [p + 3] of functions that are zero at the nodes of an element of degree p, with slope 1 (by
    xi) at its left and at its right end and 0 at the other: the nodal polynomial P_{p+1} - P_{p-1}, slope (+-)(2 p + 1) at the
    ends, times (1 +- xi) / 2."""
    nodal = np.zeros(p + 2)
    nodal[p + 1], nodal[p - 1] = 1.0, -1.0
    shifted = legendre.legmulx(nodal)
    nodal = np.append(nodal, 0.0)
    return 0.5 * (nodal - shifted) / (2 * p + 1) * (-1.0) ** p, 0.5 * (nodal + shifted) / (2 * p + 1)


def _smoothed_curve(ends: Array, own: Array, p: int) -> CurveBasis:
    """Return the C1 curve of `Basis.curve` from the Legendre coefficients own [p+1, p+1] of one Lagrange element."""
    n = ends.size - 1
    sizes = np.diff(ends)
    first = np.maximum(np.arange(n) - 1, 0) * p
    last = np.minimum(np.arange(n) + 2, n) * p
    coef = np.zeros((n, min(3 * p + 1, n * p + 1), p + 3))
    coef[0, :p + 1, :p + 1] = own
    coef[1:, p:2 * p + 1, :p + 1] = own
    bump_left, bump_right = end_bumps(p)
    slope_right = legendre.legval(1.0, legendre.legder(own.T, axis=0))
    slope_left = legendre.legval(-1.0, legendre.legder(own.T, axis=0))
    ratio = sizes[1:] / sizes[:-1]  # right over left element at every inner end
    share_right = 1.0 / (1.0 + ratio ** p)
    # slope of the neighbour minus own slope, in the own xi, times the neighbour's share in the mean
    change = np.zeros((n - 1, 2 * p + 1))  # left end of elements 1 ..; nodes of the left and the own element
    change[:, :p + 1] = ratio[:, None] * slope_right
    change[:, p:] -= slope_left
    change *= 1.0 - share_right[:, None]
    coef[1:, :2 * p + 1] += change[:, :, None] * bump_left
    change = np.zeros((n - 1, 2 * p + 1))  # right end of elements .. n-2; nodes of the own and the right element
    change[:, p:] = slope_left / ratio[:, None]
    change[:, :p + 1] -= slope_right
    change *= share_right[:, None]
    coef[0, :2 * p + 1] += change[0, :, None] * bump_right
    if n > 2:
        coef[1:-1, p:] += change[1:, :, None] * bump_right
    for _ in range(2):  # rounding errors of sum_a coef = (1, 0, 0, ...) go to a node in the middle of the element
        defect = coef.sum(axis=1)
        defect[:, 0] -= 1.0
        coef[0, p // 2] -= defect[0]
        coef[1:, p + p // 2] -= defect[1:]
    return CurveBasis(ends, first, last - first + 1, coef)
