"""Lowest eigenvalues of small matrices against dense ones, by both solvers."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg as dense
from scipy import sparse

from fastbeam.linalg import eigen, inertia
from fastbeam.linalg.eigen import Pencil, Shifted, SingularError, lowest
from fastbeam.linalg.linear_system import SuperLU
from fastbeam.linalg.saddle import Saddle

Array = np.ndarray


def chain(n: int, held: bool) -> Any:
    """Masses of 1 on springs of 1 in a row."""
    matrix = sparse.diags([np.full(n - 1, -1.0), np.full(n, 2.0), np.full(n - 1, -1.0)], [-1, 0, 1]).tolil()
    if not held:
        matrix[0, 0] = matrix[n - 1, n - 1] = 1.0
    return matrix.tocsr()


def pencil(stiffness: Any, mass: Any, multipliers: int = 0, symmetric: bool = True) -> Pencil:
    n = stiffness.shape[0]
    return Pencil(stiffness, mass, np.arange(n) >= n - multipliers, symmetric, sparse.csr_matrix((mass.shape[0], 0)),
                  np.zeros(n, bool))


@pytest.mark.parametrize("backend", ["auto", "superlu"])
@pytest.mark.parametrize("held", [True, False])
def test_eigenvalues_that_come_six_times_are_all_found(backend: str, held: bool) -> None:
    n = 30
    stiffness = sparse.block_diag([chain(n, held)] * 6).tocsr()
    found = lowest(pencil(stiffness, sparse.eye(6 * n).tocsr()), 24, backend)
    k = np.arange(1, 5) if held else np.arange(4)
    exact = 4.0 * np.sin(k * np.pi / (2 * (n + 1) if held else 2 * n))**2
    np.testing.assert_allclose(found.values, np.repeat(exact, 6), rtol=1e-11)
    assert found.is_complete
    assert np.all((found.values == 0.0) == (np.repeat(exact, 6) == 0.0))


@pytest.mark.parametrize("backend", ["auto", "superlu"])
def test_constraints_twice_a_massless_coordinate_and_a_negative_eigenvalue(backend: str) -> None:
    n = 20
    stiffness = sparse.block_diag([chain(n, False), chain(n, False), sparse.csr_matrix([[1.0]])]).tolil()
    # a massless spring from ground to coordinate 0, negative once it is condensed
    stiffness[2 * n, 0] = stiffness[0, 2 * n] = -0.5
    rows = np.zeros((3, 2 * n + 1))
    rows[0, n - 1], rows[0, n] = 1.0, -1.0
    rows[1] = 2.0 * rows[0]
    rows[2, 5], rows[2, 6] = 1.0, -1.0
    whole = sparse.bmat([[stiffness.tocsr(), -rows.T], [-rows, None]]).tocsr()
    found = lowest(pencil(whole, sparse.eye(2 * n).tocsr(), 3), 8, backend)
    allowed = dense.null_space(rows)
    mass = np.diag([*np.ones(2 * n), 0.0])
    exact = dense.eig(allowed.T @ stiffness.toarray() @ allowed, allowed.T @ mass @ allowed, right=False)
    exact = np.sort(np.real(exact[np.isfinite(exact) & (np.abs(exact) < 1e6)]))
    np.testing.assert_allclose(found.values, exact[:8], rtol=1e-10)
    assert found.values[0] < 0.0 and found.is_complete
    assert np.max(np.abs(rows @ found.vectors[:2 * n + 1])) < 1e-10
    every = lowest(pencil(whole, sparse.eye(2 * n).tocsr(), 3), 100, backend)
    np.testing.assert_allclose(every.values, exact, rtol=1e-9)


def test_fewer_than_asked_for_and_nothing_but_zeros() -> None:
    assert lowest(pencil(sparse.csr_matrix((3, 3)), sparse.eye(3).tocsr()), 5).values.tolist() == [0.0, 0.0, 0.0]
    found = lowest(pencil(2.0 * sparse.eye(1).tocsr(), sparse.eye(1).tocsr()), 5)
    np.testing.assert_allclose(found.values, [2.0], rtol=1e-14)


def test_complex_pairs_of_an_unsymmetric_matrix() -> None:
    draw = np.random.default_rng(3)
    n = 30
    stiffness = np.diag(np.arange(1.0, n + 1)) + 0.4 * draw.standard_normal((n, n))
    found = lowest(pencil(sparse.csr_matrix(stiffness), sparse.eye(n).tocsr(), symmetric=False), 10)
    exact = np.linalg.eigvals(stiffness)
    for value in found.values:
        assert np.min(np.abs(exact - value)) < 1e-9
    pair = np.flatnonzero(np.imag(found.values) > 0.0)
    assert pair.size
    z = found.vectors[:, pair] + 1j * found.vectors[:, pair + 1]
    np.testing.assert_allclose(stiffness @ z, found.values[pair] * z, atol=1e-8)


def test_what_has_neither_mass_nor_stiffness_does_not_count() -> None:
    stiffness = sparse.diags([2.0, 3.0, 0.0]).tocsr()
    mass = sparse.diags([1.0, 1.0, 0.0]).tocsr()
    np.testing.assert_allclose(lowest(pencil(stiffness, mass), 5).values, [2.0, 3.0], rtol=1e-9)


def test_no_mass_at_all_is_refused_or_empty() -> None:
    try:
        assert lowest(pencil(sparse.eye(3).tocsr(), sparse.csr_matrix((3, 3))), 2).values.size == 0
    except SingularError:
        pass


@pytest.mark.parametrize("counts", ["pardiso", "dense", "signs"])
def test_what_krylov_vectors_miss_is_found_by_the_count(counts: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first Krylov vectors are blind for two unstable modes, and pivots beside zero tell nothing."""
    n, multipliers = 40, 2
    draw = np.random.default_rng(5)
    values = np.sort(np.concatenate(([-3.0, -1.0], np.linspace(0.5, 60.0, n - 2))))
    turn = dense.qr(draw.standard_normal((n, n)))[0]
    stiffness = turn @ np.diag(values) @ turn.T
    rows = draw.standard_normal((multipliers, n))
    whole = sparse.csr_matrix(np.block([[stiffness, -rows.T], [-rows, np.zeros((multipliers, multipliers))]]))
    allowed = dense.null_space(rows)
    exact = np.linalg.eigvalsh(allowed.T @ stiffness @ allowed)
    assert np.sum(exact < 0.0) == 2
    krylov, first, calls = eigen._krylov, Shifted.__init__, []

    def blind(factors: Any, count: int, may_move: bool) -> Any:
        calls.append(factors.shift)
        found, vectors, better = krylov(factors, count + 2, may_move)
        return (found[2:], vectors[:, 2:], better) if len(calls) == 1 else krylov(factors, count, may_move)

    def uncounted(self: Any, *arguments: Any) -> None:
        first(self, *arguments)
        if counts != "pardiso" or self.shift < 0.0:
            self.below = None

    monkeypatch.setattr(eigen, "_krylov", blind)
    monkeypatch.setattr(Shifted, "__init__", uncounted)
    if counts == "signs":
        monkeypatch.setattr(eigen, "DENSE", 0)
    found = lowest(pencil(whole, sparse.eye(n).tocsr(), multipliers), 8)
    assert found.is_complete and len(calls) == 2 and calls[1] > 0.0
    np.testing.assert_allclose(found.values, exact[:8], rtol=1e-9)


@pytest.mark.parametrize("shift", [0.0, 3.0, 40.0])
def test_negative_eigenvalues_are_counted_as_pivots_of_a_band(shift: float) -> None:
    draw = np.random.default_rng(4)
    n, size = 7, 3
    rows, columns = np.nonzero(np.abs(np.subtract.outer(np.arange(n), np.arange(n))) <= 2)
    blocks = np.zeros((rows.size, size, 8))
    blocks[:, :, :size] = draw.standard_normal((rows.size, size, size))
    blocks[rows == columns, :, :size] += (12.0 - shift) * np.eye(size)
    whole = np.zeros((n, size, n, size))
    whole[rows, :, columns] = blocks[:, :, :size]
    whole = whole.reshape(n * size, n * size)
    values = np.linalg.eigvalsh(0.5 * (whole + whole.T))
    solver = SuperLU(rows, columns, n, size)
    saddle = Saddle(sparse.csr_matrix(whole), np.zeros(n * size, bool))
    exact = int(np.sum(values < 0.0)), 0
    assert inertia.Signs(inertia.Entries(saddle.matrix)).clear() == exact == saddle.signs() == solver.signs(blocks, True)


def test_a_small_pivot_of_a_band_is_left_to_others() -> None:
    matrix = sparse.csr_matrix(np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 1.0], [0.0, 1.0, 1.0]]))
    saddle = Saddle(matrix, np.zeros(3, bool))
    assert inertia.Signs(inertia.Entries(saddle.matrix)).clear() is None and saddle.signs() == (1, 0)


@pytest.mark.parametrize("narrow", [True, False])
def test_signs_of_a_determinant_and_skew_parts_of_bands_and_others(narrow: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    draw = np.random.default_rng(7)
    if not narrow:
        monkeypatch.setattr(inertia, "WIDEST", -1)
    seen = set()
    for n, width in ((1, 0), (6, 5), (40, 3), (41, 7)):
        for _ in range(6):
            whole = np.where(np.abs(np.subtract.outer(np.arange(n), np.arange(n))) <= width, draw.standard_normal((n, n)), 0.0)
            signs, scale = inertia.Signs(inertia.Entries(sparse.csr_matrix(whole))), draw.uniform(0.5, 2.0, n)
            assert (signs._whole is not None) == narrow
            seen.add(signs.determinant())
            assert signs.determinant() == np.linalg.slogdet(whole)[0]
            np.testing.assert_allclose(signs.skew(scale), np.max(np.abs(whole - whole.T) * np.outer(scale, scale)), rtol=1e-14)
    assert seen == {1, -1}
    assert inertia.Signs(inertia.Entries(sparse.csr_matrix(np.diag([1.0, 0.0])))).determinant() == 0


@pytest.mark.parametrize("pivot", [-3e-7, -1e-9, 3e-7])
def test_an_unsymmetric_matrix_is_positive_where_its_symmetric_part_is(pivot: float, monkeypatch: pytest.MonkeyPatch) -> None:
    # the last pivot is what a soft end of a beam leaves; a skew part beside it, with a positive determinant
    whole = np.diag(np.ones(5))
    whole[3, 4] = whole[4, 3] = np.sqrt(1.0 - pivot)
    whole[0, 1], whole[1, 0] = 0.4, -0.4
    whole[2, 4], whole[4, 2] = 0.1, -0.1
    sure: list[float] = []
    monkeypatch.setattr(inertia, "inertia", lambda *given, whole=inertia.inertia: sure.append(0.0) or whole(*given))
    assert Saddle(sparse.csr_matrix(whole), np.zeros(5, bool)).signs(False) == ((0, 0) if pivot > 0.0 else None)
    # a negative pivot that is no round-off decides without the eigenvalues
    assert bool(sure) == (pivot > -1e-8)
