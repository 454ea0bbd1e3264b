"""Interpolation tables: what theory.md 3.2 promises of every family, checked on equal and unequal elements."""
from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from counted import calls
from numpy.polynomial import legendre
from numpy.typing import NDArray

from fastbeam.interface.errors import SceneError
from fastbeam.scene.interpolation.basis import Basis, CurveBasis, build_basis, gll_nodes

Array = NDArray[np.float64]
LENGTH = 2.5
UNEQUAL = LENGTH * np.cumsum([0.0, 0.05, 0.2, 0.1, 0.1, 0.25, 0.05, 0.15, 0.1])
UNEQUAL[-1] = LENGTH
JUMP = LENGTH * np.append(np.linspace(0.0, 0.5, 6)[:-1], np.linspace(0.5, 1.0, 26))  # element sizes differ by 5
MESHES = {"one": 1, "two": 2, "three": 3, "equal": 9, "unequal": UNEQUAL, "jump": JUMP}
FAMILIES = ([("lagrange", p, "nodes") for p in range(1, 9)] + [("bspline", p, "greville") for p in range(2, 6)]
            + [("bspline", p, "control") for p in range(2, 6)])
EXACT = 1e-13  # rounding of a handful of products of numbers of order one


@pytest.fixture(params=[(family, mesh) for family in FAMILIES for mesh in MESHES],
                ids=lambda case: "-".join(map(str, case[0])) + "-" + case[1])
def basis(request: pytest.FixtureRequest) -> Basis:
    (interpolation, degree, directors), mesh = request.param
    return build_basis(interpolation, degree, MESHES[mesh], LENGTH, directors)


def _sample(curve: CurveBasis, values: Array, s: Array) -> tuple[Array, Array]:
    first, shape, shape_s = curve.evaluate(s)
    padded = np.append(values, np.zeros(shape.shape[1]))
    touched = padded[first[:, None] + np.arange(shape.shape[1])]
    return (shape * touched).sum(axis=1), (shape_s * touched).sum(axis=1)


def _inside(ends: Array, n: int = 7) -> Array:
    return (ends[:-1, None] + np.linspace(0.03, 0.96, n) * np.diff(ends)[:, None]).ravel()


def _has_rule(basis: Basis) -> bool:
    """Whether its strain energy is taken by the rule of a spline space."""
    return basis.interpolation == "bspline" and basis.degree < 4 and basis.n_elements > 1


# tables

def test_tables_have_the_announced_shapes_and_types(basis: Basis) -> None:
    e, p, nn = basis.n_elements, basis.degree, basis.element_nodes.shape[1]
    assert basis.node_s.shape == (basis.n_nodes,)
    assert basis.element_ends.shape == (e + 1,)
    # two points hold the rule of a spline space
    points = 2 if _has_rule(basis) else p
    assert basis.point_s.shape == basis.weight.shape == (e, points)
    assert basis.mass_point_s.shape == basis.mass_weight.shape == (e, p + 1)
    assert basis.mass_phi_values.shape == (e, p + 1, nn)
    assert basis.mass_phi.shape == basis.mass_dir.shape == (e, nn, nn)
    for table in (basis.phi, basis.phi_s, basis.dir, basis.dir_s):
        assert table.shape == (e, points, nn)
    for table in (basis.node_s, basis.point_s, basis.weight, basis.phi, basis.phi_s, basis.dir, basis.dir_s, basis.mass_phi,
                  basis.mass_dir, basis.mass_point_s, basis.mass_weight, basis.mass_phi_values, basis.curve("c1").coef):
        # equal elements share theirs
        assert (table.flags.c_contiguous or table[0].flags.c_contiguous and table.strides[0] == 0) and table.dtype == np.float64
    assert basis.element_nodes.flags.c_contiguous and basis.element_nodes.dtype == np.int64


def test_nodes_of_an_element_are_consecutive_and_exist(basis: Basis) -> None:
    assert np.all(np.diff(basis.element_nodes, axis=1) == 1)
    assert basis.element_nodes.min() == 0 and basis.element_nodes.max() == basis.n_nodes - 1
    assert np.all(np.diff(basis.node_s) > 0.0)
    assert basis.node_s[0] == 0.0 and basis.node_s[-1] == LENGTH


def test_number_of_nodes_follows_from_family_and_degree(basis: Basis) -> None:
    expected = basis.n_elements * basis.degree + 1 if basis.interpolation == "lagrange" else basis.n_elements + basis.degree
    assert basis.n_nodes == expected


def test_position_and_director_basis_are_partitions_of_unity(basis: Basis) -> None:
    shortest = np.diff(basis.element_ends).min()
    for table, table_s in ((basis.phi, basis.phi_s), (basis.dir, basis.dir_s)):
        np.testing.assert_allclose(table.sum(axis=2), 1.0, rtol=0, atol=EXACT)
        np.testing.assert_allclose(table_s.sum(axis=2) * shortest, 0.0, rtol=0, atol=EXACT * basis.degree ** 2)


def test_position_basis_reproduces_arc_length(basis: Basis) -> None:
    s = basis.node_s[basis.element_nodes]
    np.testing.assert_allclose(np.einsum("ega,ea->eg", basis.phi, s), basis.point_s, rtol=0, atol=EXACT * LENGTH)
    # derivatives carry a factor length over element size
    np.testing.assert_allclose(np.einsum("ega,ea->eg", basis.phi_s, s), 1.0, rtol=0, atol=1e-12 * basis.degree)


def _reproduced(basis: Basis) -> int:
    # control points carry coefficients, not values: only straight lines survive
    return 1 if basis.directors == "control" else basis.degree


def test_directors_from_nodal_values_reproduce_degree_p(basis: Basis) -> None:
    s, x = basis.node_s / LENGTH, basis.point_s / LENGTH
    for k in range(_reproduced(basis) + 1):
        at_nodes = (s ** k)[basis.element_nodes]
        np.testing.assert_allclose(np.einsum("ega,ea->eg", basis.dir, at_nodes), x ** k, rtol=0, atol=EXACT)
        slope = k * x ** max(k - 1, 0) / LENGTH
        np.testing.assert_allclose(np.einsum("ega,ea->eg", basis.dir_s, at_nodes), slope, rtol=0, atol=1e-11)  # over element size


def test_quasi_interpolant_is_not_exact_beyond_degree_p() -> None:
    basis = build_basis("bspline", 2, 9, LENGTH)
    cubic = ((basis.node_s / LENGTH) ** 3)[basis.element_nodes]
    assert np.abs(np.einsum("ega,ea->eg", basis.dir, cubic) - (basis.point_s / LENGTH) ** 3).max() > 1e-5


@pytest.mark.parametrize("family", [f for f in FAMILIES if f[2] != "greville"], ids=str)
def test_directors_share_the_position_basis_unless_quasi_interpolated(family: tuple[str, int, str]) -> None:
    basis = build_basis(family[0], family[1], UNEQUAL, LENGTH, family[2])
    assert basis.dir is basis.phi and basis.dir_s is basis.phi_s and basis.mass_dir is basis.mass_phi
    assert basis.element_nodes.shape[1] == basis.degree + 1


def test_lagrange_ignores_where_spline_directors_would_sit() -> None:
    kinds = {build_basis("lagrange", 3, 4, LENGTH, directors).directors for directors in ("nodes", "greville", "control")}
    assert kinds == {"nodes"}


def test_quadratic_quasi_interpolant_has_the_weights_minus_one_ten_minus_one() -> None:
    # phi and dir of one inner element: dir = phi with coefficients (-1/8, 10/8, -1/8)
    basis = build_basis("bspline", 2, 9, LENGTH)
    own = basis.phi[4][:, 1:4]
    expected = np.zeros((2, 5))
    for a in range(3):
        expected[:, a:a + 3] += own[:, a:a + 1] * np.array([-0.125, 1.25, -0.125])
    np.testing.assert_array_equal(basis.element_nodes[4], [3, 4, 5, 6, 7])
    np.testing.assert_allclose(basis.dir[4], expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize("degree, nn", [(2, 5), (3, 6), (4, 9), (5, 10)])
def test_quasi_interpolant_stays_local(degree: int, nn: int) -> None:
    assert build_basis("bspline", degree, 60, LENGTH).element_nodes.shape[1] == nn
    # the odd degrees need wider windows where elements differ
    assert build_basis("bspline", degree, JUMP, LENGTH).element_nodes.shape[1] <= nn + 2 * (degree % 2)
    assert build_basis("bspline", degree, 1, LENGTH).element_nodes.shape[1] == degree + 1


@pytest.mark.parametrize("degree", [2, 3, 4, 5])
@pytest.mark.parametrize("mesh", ["two", "equal", "unequal"])
def test_end_triads_are_met_exactly(degree: int, mesh: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fastbeam.scene.interpolation.basis.points_of", lambda degree, sizes: None)
    basis = build_basis("bspline", degree, MESHES[mesh], LENGTH)
    # the slopes at p Gauss points fix the slope of degree p - 1; its integral leads from the first Gauss point to the end
    xi, _ = legendre.leggauss(degree)
    table = np.zeros((2, basis.element_nodes.shape[1]))
    for row, (element, end) in enumerate(((0, -1.0), (-1, 1.0))):
        slope = np.linalg.solve(legendre.legvander(xi, degree - 1), basis.dir_s[element])
        rise = legendre.legint(slope, lbnd=xi[0], axis=0) * 0.5 * basis.weight[element].sum()
        table[row] = basis.dir[element, 0] + legendre.legval(end, rise)
    expected = np.zeros_like(table)
    expected[0, 0] = expected[1, -1] = 1.0
    np.testing.assert_allclose(table, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("degree", [3, 5])
def test_given_equal_ends_and_a_number_of_elements_make_the_same_tables(degree: int) -> None:
    a, b = build_basis("bspline", degree, 40, LENGTH), build_basis("bspline", degree, np.linspace(0.0, LENGTH, 41), LENGTH)
    np.testing.assert_array_equal(a.element_nodes, b.element_nodes)
    np.testing.assert_allclose(a.dir, b.dir, rtol=0, atol=1e-12)  # ends are rounded to 1e-16 of 40 elements


@pytest.mark.parametrize("family", FAMILIES, ids=str)
def test_a_mirrored_mesh_gives_mirrored_tables(family: tuple[str, int, str]) -> None:
    a, b = (build_basis(family[0], family[1], ends, LENGTH, family[2]) for ends in (UNEQUAL, LENGTH - UNEQUAL[::-1]))
    np.testing.assert_allclose(a.node_s, LENGTH - b.node_s[::-1], rtol=0, atol=1e-14)
    dense = []
    for basis in (a, b):
        table = np.zeros((*basis.weight.shape, basis.n_nodes))
        np.put_along_axis(table, np.broadcast_to(basis.element_nodes[:, None, :], basis.dir.shape), basis.dir, axis=2)
        dense.append(table[basis.weight > 0.0])
    np.testing.assert_allclose(dense[0], dense[1][::-1, ::-1], rtol=0, atol=1e-12)


# quadrature

def test_weights_integrate_the_length(basis: Basis) -> None:
    for weight in (basis.mass_weight,) if _has_rule(basis) else (basis.weight, basis.mass_weight):
        np.testing.assert_allclose(weight.sum(axis=1), np.diff(basis.element_ends), rtol=1e-13)
        assert np.all(weight > 0.0)
    assert basis.weight.sum() == pytest.approx(LENGTH, rel=1e-12)
    inside = (basis.point_s >= basis.element_ends[:-1, None]) & (basis.point_s <= basis.element_ends[1:, None])
    assert np.all(basis.weight >= 0.0) and np.all(inside)


def test_points_are_exact_to_degree_2p_minus_2_or_2p_minus_1_and_2p_plus_1(basis: Basis) -> None:
    for point, weight, k in ((basis.point_s, basis.weight, 2 * basis.degree - (2 if _has_rule(basis) else 1)),
                             (basis.mass_point_s, basis.mass_weight, 2 * basis.degree + 1)):
        assert np.sum(weight * (point / LENGTH) ** k) == pytest.approx(LENGTH / (k + 1), rel=1e-12 if _has_rule(basis) else 1e-13)


def test_products_of_slopes_are_integrated_exactly(basis: Basis) -> None:
    def products(s: Array, weight: Array) -> Array:
        slopes = basis.position_matrix(np.minimum(s.ravel(), LENGTH))[1]
        return (slopes.T * weight.ravel()) @ slopes

    exact = products(basis.mass_point_s, basis.mass_weight)
    np.testing.assert_allclose(products(basis.point_s, basis.weight), exact, rtol=0, atol=1e-11 * np.max(np.abs(exact)))


@pytest.mark.parametrize("degree", [2, 3])
@pytest.mark.parametrize("n", [2, 3, 7, 40, 41, 79, 80, 81, 82, 83, 84, 200])
def test_points_of_splines_are_half_as_many_as_their_space_has_dimensions(degree: int, n: int) -> None:
    basis = build_basis("bspline", degree, n, LENGTH)
    dimensions = 2 * n + 1 if degree == 2 else 3 * n + 2
    assert np.count_nonzero(basis.weight) == (dimensions + 1) // 2
    # enough for every shape of degree p - 1 of the slopes, or shapes would cost nothing
    slopes = basis.position_matrix(basis.point_s[basis.weight > 0.0])[1]
    assert np.linalg.matrix_rank(slopes) == basis.n_nodes - 1
    # a change of the pattern inside long beams would show in sums of powers
    s = (basis.point_s / LENGTH - 0.5).ravel()
    for k in range(2 * degree - 1):
        assert np.sum(basis.weight.ravel() * s**k) == pytest.approx(0.0 if k % 2 else LENGTH * 0.5**k / (k + 1), abs=1e-11)


def test_mass_matrices_equal_overintegrated_ones(basis: Basis) -> None:
    e = basis.n_elements - 1
    xi, w = legendre.leggauss(2 * basis.degree + 3)
    left, right = basis.element_ends[e:e + 2]
    values, _ = basis.position_matrix(left + 0.5 * (1.0 + xi) * (right - left))
    values = values[:, basis.element_nodes[e]]
    expected = np.einsum("g,ga,gb->ab", 0.5 * w * (right - left), values, values)
    np.testing.assert_allclose(basis.mass_phi[e], expected, rtol=0, atol=1e-13 * LENGTH)
    np.testing.assert_allclose(basis.mass_phi, basis.mass_phi.transpose(0, 2, 1), rtol=0, atol=1e-15)


def test_mass_matrices_integrate_products_of_polynomials(basis: Basis) -> None:
    p = _reproduced(basis)
    q = ((basis.node_s / LENGTH) ** p)[basis.element_nodes]
    one = np.ones_like(q)
    assert np.einsum("ea,eab,eb->", q, basis.mass_dir, q) == pytest.approx(LENGTH / (2 * p + 1), rel=1e-12)
    assert np.einsum("ea,eab,eb->", one, basis.mass_phi, one) == pytest.approx(LENGTH, rel=1e-13)
    s = basis.node_s[basis.element_nodes]
    assert np.einsum("ea,eab,eb->", s, basis.mass_phi, s) == pytest.approx(LENGTH ** 3 / 3, rel=1e-12)


def test_mass_points_carry_the_position_basis(basis: Basis) -> None:
    first, values, _ = basis.curve("own").evaluate(basis.mass_point_s.ravel())
    q = np.cos(3.0 * np.arange(basis.n_nodes))
    expected = (values * q[first[:, None] + np.arange(values.shape[1])]).sum(axis=1)
    found = np.einsum("ega,ea->eg", basis.mass_phi_values, q[basis.element_nodes])
    np.testing.assert_allclose(found.ravel(), expected, rtol=0, atol=1e-12)


def test_strain_points_agree_with_the_dense_position_matrix(basis: Basis) -> None:
    matrix, matrix_s = basis.position_matrix(basis.point_s.ravel())
    q = np.cos(3.0 * np.arange(basis.n_nodes))
    np.testing.assert_allclose(np.einsum("ega,ea->eg", basis.phi, q[basis.element_nodes]).ravel(), matrix @ q, rtol=0, atol=1e-12)
    found = np.einsum("ega,ea->eg", basis.phi_s, q[basis.element_nodes]).ravel()
    np.testing.assert_allclose(found, matrix_s @ q, rtol=0, atol=1e-12 * np.abs(found).max())


# nodes

@pytest.mark.parametrize("degree, inner", [(1, []), (2, [0.0]), (3, [-5 ** -0.5, 5 ** -0.5]),
                                           (4, [-(3 / 7) ** 0.5, 0.0, (3 / 7) ** 0.5]),
                                           (5, [-0.765055323929465, -0.285231516480645, 0.285231516480645, 0.765055323929465])])
def test_lobatto_nodes_have_their_known_values(degree: int, inner: list[float]) -> None:
    np.testing.assert_allclose(gll_nodes(degree), [-1.0, *inner, 1.0], rtol=0, atol=1e-15)


@pytest.mark.parametrize("degree", range(2, 9))
def test_lobatto_nodes_are_zeros_of_the_legendre_derivative(degree: int) -> None:
    x = gll_nodes(degree)
    slope = legendre.legder(np.eye(degree + 1)[degree])
    np.testing.assert_allclose(legendre.legval(x[1:-1], slope), 0.0, rtol=0, atol=1e-14 * degree ** 2)  # rounding of the sum
    np.testing.assert_array_equal(x, -x[::-1])


@pytest.mark.parametrize("degree", range(1, 9))
def test_lagrange_basis_is_one_at_its_node(degree: int) -> None:
    basis = build_basis("lagrange", degree, UNEQUAL, LENGTH)
    np.testing.assert_allclose(basis.position_matrix(basis.node_s)[0], np.eye(basis.n_nodes), rtol=0, atol=EXACT)


def test_greville_abscissae_have_their_known_values() -> None:
    np.testing.assert_allclose(build_basis("bspline", 3, 4, 1.2).node_s, [0.0, 0.1, 0.3, 0.6, 0.9, 1.1, 1.2], rtol=0, atol=1e-15)


def test_one_spline_element_is_the_bernstein_basis() -> None:
    basis = build_basis("bspline", 3, 1, 2.0)
    x = np.array([0.0, 0.3, 1.0])
    bernstein = np.stack([(1 - x) ** 3, 3 * x * (1 - x) ** 2, 3 * x ** 2 * (1 - x), x ** 3], axis=1)
    np.testing.assert_allclose(basis.position_matrix(2.0 * x)[0], bernstein, rtol=0, atol=1e-14)


@pytest.mark.parametrize("degree", [2, 3, 4, 5])
def test_spline_basis_agrees_with_scipy(degree: int) -> None:
    interpolate = pytest.importorskip("scipy.interpolate")
    basis = build_basis("bspline", degree, UNEQUAL, LENGTH)
    knots = np.concatenate((np.zeros(degree), UNEQUAL, np.full(degree, LENGTH)))
    s = _inside(UNEQUAL)
    reference = interpolate.BSpline(knots, np.eye(basis.n_nodes), degree)
    matrix, matrix_s = basis.position_matrix(s)
    np.testing.assert_allclose(matrix, reference(s), rtol=0, atol=EXACT)
    np.testing.assert_allclose(matrix_s, reference.derivative()(s), rtol=0, atol=1e-11)  # over element size


def test_fitted_positions_meet_the_values_at_the_nodes(basis: Basis) -> None:
    values = np.stack([np.sin(3.0 * basis.node_s), basis.node_s ** 2, np.ones(basis.n_nodes)], axis=1)
    coefficients = basis.fit_positions(values)
    assert coefficients.shape == values.shape and coefficients is not values
    np.testing.assert_allclose(basis.position_matrix(basis.node_s)[0] @ coefficients, values, rtol=0, atol=1e-12)
    if basis.interpolation == "lagrange":
        np.testing.assert_array_equal(coefficients, values)


# the curve of a slider

@pytest.mark.parametrize("kind", ["own", "c1"])
def test_curve_coefficients_sum_to_one_without_rounding(basis: Basis, kind: str) -> None:
    curve = basis.curve(kind)
    total = curve.coef.sum(axis=1)
    total[:, 0] -= 1.0
    assert np.abs(total).max() < 2e-15  # a few units in the last place


@pytest.mark.parametrize("kind", ["own", "c1"])
def test_curve_touches_existing_nodes_and_is_zero_beyond(basis: Basis, kind: str) -> None:
    curve = basis.curve(kind)
    assert np.all(curve.first_node >= 0) and np.all(curve.first_node + curve.n_nodes_of <= basis.n_nodes)
    assert curve.n_nodes_of.max() == curve.coef.shape[1]
    beyond = np.arange(curve.coef.shape[1]) >= curve.n_nodes_of[:, None]
    assert np.all(curve.coef[beyond] == 0.0)


@pytest.mark.parametrize("kind", ["own", "c1"])
def test_curve_reproduces_arc_length(basis: Basis, kind: str) -> None:
    s = np.append(_inside(basis.element_ends), [0.0, LENGTH])
    value, slope = _sample(basis.curve(kind), basis.node_s, s)
    np.testing.assert_allclose(value, s, rtol=0, atol=EXACT * LENGTH)
    np.testing.assert_allclose(slope, 1.0, rtol=0, atol=1e-12 * basis.degree)


@pytest.mark.parametrize("degree", range(1, 9))
@pytest.mark.parametrize("mesh", ["two", "equal", "unequal"])
def test_c1_curve_of_lagrange_has_one_slope_at_element_ends_and_meets_all_nodes(degree: int, mesh: str) -> None:
    basis = build_basis("lagrange", degree, MESHES[mesh], LENGTH)
    curve, own, q = basis.curve("c1"), basis.curve("own"), np.cos(2.0 * np.arange(basis.n_nodes))

    def slope_at(side: CurveBasis, element: int, xi: float) -> float:
        shape = legendre.legval(xi, legendre.legder(side.coef[element].T, axis=0))
        n = side.n_nodes_of[element]
        first = side.first_node[element]
        return 2.0 / (basis.element_ends[element + 1] - basis.element_ends[element]) * float(shape[:n] @ q[first:first + n])

    for e in range(basis.n_elements - 1):
        left, right = slope_at(curve, e, 1.0), slope_at(curve, e + 1, -1.0)
        assert left == pytest.approx(right, rel=1e-11, abs=1e-9)
        own_left, own_right = slope_at(own, e, 1.0), slope_at(own, e + 1, -1.0)
        assert abs(own_left - own_right) > 1e-3  # the data has a kink to remove
        assert min(own_left, own_right) <= left <= max(own_left, own_right)
        if mesh != "unequal":
            assert left == pytest.approx(0.5 * (own_left + own_right), rel=1e-11, abs=1e-9)
    np.testing.assert_allclose(_sample(curve, q, basis.node_s)[0], q, rtol=0, atol=1e-12)
    # no correction at the ends of the beam
    assert slope_at(curve, 0, -1.0) == pytest.approx(slope_at(own, 0, -1.0), rel=1e-12)
    assert slope_at(curve, -1 + basis.n_elements, 1.0) == pytest.approx(slope_at(own, -1 + basis.n_elements, 1.0), rel=1e-12)


@pytest.mark.parametrize("degree", range(1, 9))
def test_c1_curve_of_lagrange_reproduces_degree_p_on_unequal_elements(degree: int) -> None:
    basis = build_basis("lagrange", degree, UNEQUAL, LENGTH)
    s = _inside(UNEQUAL)
    value, slope = _sample(basis.curve("c1"), (basis.node_s / LENGTH) ** degree, s)
    np.testing.assert_allclose(value, (s / LENGTH) ** degree, rtol=0, atol=EXACT)
    np.testing.assert_allclose(slope * LENGTH, degree * (s / LENGTH) ** (degree - 1), rtol=0, atol=1e-11)


def test_c1_curve_is_the_own_curve_where_that_is_smooth() -> None:
    for basis in (build_basis("bspline", 3, 5, LENGTH), build_basis("lagrange", 3, 1, LENGTH)):
        np.testing.assert_array_equal(basis.curve("c1").coef, basis.curve("own").coef)


@pytest.mark.parametrize("degree", [2, 3, 4, 5])
def test_spline_curve_has_continuous_derivatives_up_to_p_minus_1(degree: int) -> None:
    curve = build_basis("bspline", degree, UNEQUAL, LENGTH).curve("c1")
    size = np.diff(UNEQUAL)
    for k in range(degree):
        derivative = legendre.legder(curve.coef, m=k, axis=2) * (2.0 / size[:, None, None]) ** k
        at_right = legendre.legval(1.0, np.moveaxis(derivative, 2, 0))
        at_left = legendre.legval(-1.0, np.moveaxis(derivative, 2, 0))
        # nodes 1 .. p of element e are nodes 0 .. p-1 of element e+1; the outer two must fade out; each derivative multiplies the
        # round-off of a coefficient like the coefficient: next to the sum of all terms without their signs
        scale = np.max(np.sum(np.abs(derivative), axis=2))
        np.testing.assert_allclose(at_right[:-1, 1:], at_left[1:, :-1], rtol=0, atol=3e-13 * scale)
        np.testing.assert_allclose(at_right[:-1, 0], 0.0, rtol=0, atol=3e-13 * scale)


@pytest.mark.parametrize("kind", ["own", "c1"])
@pytest.mark.parametrize("interpolation, degree", [("lagrange", p) for p in range(1, 6)] + [("bspline", p) for p in range(2, 6)])
def test_curve_converges_with_order_p_plus_1_and_its_slope_with_order_p(interpolation: str, degree: int, kind: str) -> None:
    errors = []
    for n in (32, 64):
        # a smooth grading keeps elements unequal at every refinement
        ends = LENGTH * (np.linspace(0.0, 1.0, n + 1) + 0.1 * np.sin(np.pi * np.linspace(0.0, 1.0, n + 1)))
        ends[-1] = LENGTH
        basis = build_basis(interpolation, degree, ends, LENGTH)
        s = _inside(ends, 11)
        value, slope = _sample(basis.curve(kind), basis.fit_positions(np.sin(4.0 * basis.node_s)), s)
        errors.append((np.abs(value - np.sin(4.0 * s)).max(), np.abs(slope - 4.0 * np.cos(4.0 * s)).max()))
    order = np.log2(np.array(errors[0]) / np.array(errors[1]))
    assert order[0] > degree + 1 - 0.25  # the asymptotic order is met to a quarter on these meshes
    assert order[1] > degree - 0.25


@pytest.mark.parametrize("degree", [3, 5])
def test_weighted_mean_of_slopes_gains_an_order_for_odd_degrees(degree: int) -> None:
    errors = []
    for n in (16, 32):
        ends = LENGTH * np.append(np.linspace(0.0, 0.4, n // 2 + 1)[:-1], np.linspace(0.4, 1.0, n // 2 + 1))  # one jump of 1.5
        basis = build_basis("lagrange", degree, ends, LENGTH)
        slope = _sample(basis.curve("c1"), np.sin(4.0 * basis.node_s), ends[1:-1])[1]
        errors.append(np.abs(slope - 4.0 * np.cos(4.0 * ends[1:-1])).max())
    assert np.log2(errors[0] / errors[1]) > degree + 1 - 0.25


@pytest.mark.parametrize("degree", [2, 3, 4, 5])
@pytest.mark.parametrize("graded", [False, True])
def test_quasi_interpolated_directors_converge_with_order_p_plus_1(degree: int, graded: bool) -> None:
    errors = []
    for n in (64, 128):
        x = np.linspace(0.0, 1.0, n + 1)
        ends = LENGTH * (x + 0.1 * np.sin(np.pi * x) * graded)
        ends[-1] = LENGTH
        basis = build_basis("bspline", degree, ends, LENGTH)
        found = np.einsum("ega,ea->eg", basis.dir, np.sin(4.0 * basis.node_s)[basis.element_nodes])
        errors.append(np.abs(found - np.sin(4.0 * basis.point_s)).max())
    assert np.log2(errors[0] / errors[1]) > degree + 1 - 0.25  # the asymptotic order is met to a quarter on these meshes


def test_curve_slopes_are_derivatives_of_its_values() -> None:
    curve = build_basis("lagrange", 3, UNEQUAL, LENGTH).curve("c1")
    s, step = _inside(UNEQUAL), 1e-6
    _, _, slope = curve.evaluate(s)
    difference = (curve.evaluate(s + step)[1] - curve.evaluate(s - step)[1]) / (2 * step)
    np.testing.assert_allclose(slope, difference, rtol=0, atol=1e-5)  # third derivative times step^2, and 1e-16 / step


@pytest.mark.parametrize("sizes", [[1.0, 100.0], [100.0, 1.0]])
@pytest.mark.parametrize("degree", [2, 3, 4, 5])
def test_quasi_interpolant_survives_a_jump_of_element_size(degree: int, sizes: list[float]) -> None:
    ends = np.append(0.0, np.cumsum(np.repeat(sizes, 8)))
    basis = build_basis("bspline", degree, ends, ends[-1])
    s, x = basis.node_s / ends[-1], basis.point_s / ends[-1]
    assert np.abs(basis.dir).sum(axis=2).max() < 40.0  # amplification of nodal errors
    for k in range(degree + 1):
        found = np.einsum("ega,ea->eg", basis.dir, (s ** k)[basis.element_nodes])
        np.testing.assert_allclose(found, x ** k, rtol=0, atol=EXACT)


# errors

@pytest.mark.parametrize("arguments, message", [
    (("nurbs", 3, 4, 1.0),
     r"interpolation 'nurbs' does not exist: choose 'lagrange' \(degree 1 to 8\) or 'bspline' \(degree 2 to 5\)"),
    (("lagrange", 0, 4, 1.0), "degree=0 .*1 to 8"),
    (("lagrange", 9, 4, 1.0), "degree=9 .*1 to 8"),
    (("lagrange", 2.0, 4, 1.0), "degree=2.0 .*integer"),
    (("lagrange", True, 4, 1.0), "degree=True .*integer"),
    (("bspline", 1, 4, 1.0), "degree=1 .*2 to 5"),
    (("bspline", 6, 4, 1.0), "degree=6 .*2 to 5"),
    (("bspline", 3, 0, 1.0), "n_elements=0 must be an integer of at least 1"),
    (("bspline", 3, 4.0, 1.0), "n_elements=4.0 must be an integer"),
    (("bspline", 3, True, 1.0), "n_elements=True must be an integer"),
    (("bspline", 3, 4, 0.0), "length=0.0 must be positive"),
    (("bspline", 3, 4, float("nan")), "length=nan must be positive"),
    (("bspline", 3, [0.0], 1.0), "at least two"),
    (("bspline", 3, [[0.0, 1.0]], 1.0), "shape"),
    (("bspline", 3, [0.1, 1.0], 1.0), "first element end is 0.1 m and must be 0 m"),
    (("bspline", 3, [0.0, 0.9], 1.0), "last element end is 0.9 m and must be 1 m"),
    (("bspline", 3, [0.0, 0.6, 0.6, 1.0], 1.0), "increase strictly, but end 1 is 0.6 m and end 2 is 0.6 m"),
    (("bspline", 3, [0.0, float("nan"), 1.0], 1.0), "increase strictly"),
    (("bspline", 3, 4, 1.0, "middle"), "directors 'middle' do not exist: choose 'greville' or 'control'"),
    (("bspline", 3, 4, 1.0, "nodes"), "directors 'nodes' exist for 'lagrange' only"),
    (("lagrange", 3, 4, 1.0, "middle"), "directors 'middle' do not exist"),
])
def test_unusable_arguments_are_named(arguments: tuple, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        build_basis(*arguments)


def test_unusable_queries_are_named() -> None:
    basis = build_basis("lagrange", 3, 4, 1.2)
    with pytest.raises(SceneError, match="curve 'c2' does not exist: choose 'own' or 'c1'"):
        basis.curve("c2")
    with pytest.raises(SceneError, match=r"s=1.4 lies outside the beam \(0 to 1.2 m\)"):
        basis.position_matrix([0.3, 1.4])
    with pytest.raises(SceneError, match="s=nan"):
        basis.curve("c1").evaluate(np.nan)
    with pytest.raises(SceneError, match="13 nodes"):
        basis.fit_positions(np.zeros((12, 3)))


# cost

def test_many_elements_are_built_at_once() -> None:
    for kind in ("lagrange", "bspline"):
        few, many = (calls(lambda n=n: build_basis(kind, 3, n, LENGTH)) for n in (1000, 100_000))
        print(f"{kind}: {few} calls for 1000 elements, {many} for 100 000")
        assert many < few + 100
    basis = build_basis("lagrange", 3, 100_000, LENGTH)
    spline = build_basis("bspline", 3, 100_000, LENGTH)
    np.testing.assert_allclose(basis.phi.sum(axis=2), 1.0, rtol=0, atol=EXACT)
    np.testing.assert_allclose(spline.dir.sum(axis=2), 1.0, rtol=0, atol=EXACT)
    assert basis.n_nodes == 300_001 and spline.n_nodes == 100_003


def test_building_needs_neither_scipy_nor_numba() -> None:
    code = ("import sys; from fastbeam.scene.interpolation.basis import build_basis; "
            "build_basis('bspline', 3, 4, 1.0).curve('c1'); "
            "print(sorted({'scipy', 'numba', 'matplotlib', 'h5py'} & set(sys.modules)))")
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"
