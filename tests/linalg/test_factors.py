"""Factors of small matrices against dense ones: by both solvers, real and complex, transposed, next to singular ones."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import sparse

from fastbeam.linalg.factors import OF_STEP, Factors, factoriser_for, lu
from fastbeam.linalg.mkl import load_mkl
from fastbeam.linalg.saddle import Saddle

Array = np.ndarray
BACKENDS = ["superlu", pytest.param("pardiso", marks=pytest.mark.skipif(load_mkl() is None, reason="no MKL"))]


def matrix(n: int, is_complex: bool, symmetric: bool, seed: int = 0) -> Array:
    """Dense, every second pair of rows without an entry on the diagonal, in units far apart."""
    rng = np.random.default_rng(seed)
    a = rng.standard_normal((n, n)) + 1j * is_complex * rng.standard_normal((n, n))
    a = a + a.T if symmetric else a
    a[np.arange(0, n, 2), np.arange(0, n, 2)] = 0.0
    scale = 10.0**rng.uniform(-4.0, 4.0, n)
    a = scale[:, None] * a * (scale if symmetric else 1.0)
    return a if is_complex else a.real


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("is_complex", [False, True])
@pytest.mark.parametrize("symmetric", [False, True])
def test_solutions_are_those_of_dense_matrices(backend: str, is_complex: bool, symmetric: bool) -> None:
    n, by = 12, factoriser_for(backend, symmetric=symmetric)
    rng = np.random.default_rng(1)
    every: list[Any] = []
    for seed in range(3):
        # zeros on the diagonal are entries
        a = matrix(n, is_complex, symmetric, seed)
        rows, columns = np.indices((n, n)).reshape(2, -1)
        found = Factors(sparse.csr_matrix((a.reshape(-1), (rows, columns))), by)
        for transposed in (False, True):
            x = rng.standard_normal((2, n)) / np.abs(a).max(axis=int(transposed))
            right = x @ (a if transposed else a.T)
            both, one = found.solve(right, transposed), found.solve(right[0], transposed)
            assert both is not None and one is not None and found.residual < 1e-13
            np.testing.assert_allclose(both / x, 1.0, rtol=0.0, atol=1e-10)
            np.testing.assert_allclose(one / x[0], 1.0, rtol=0.0, atol=1e-10)
        every.append((x[0], right[0], found))
        if symmetric and not is_complex and found.by is not None and found.by.negative is not None:
            assert found.by.negative == np.sum(np.linalg.eigvalsh(a * found.row[:, None] * found.column) < 0.0)
    if by is not None:
        assert (by.analyses, by.refused) == (1, 0)
    # the first one again, though others came between
    x, right, found = every[0]
    np.testing.assert_allclose(found.solve(right, True), x, rtol=1e-10)
    assert found.factorisations == (1 if by is None else 2)


@pytest.mark.parametrize("backend", BACKENDS)
def test_complex_right_hand_sides_of_real_matrices(backend: str) -> None:
    a = matrix(10, False, False)
    x = np.arange(1.0, 11.0) + 1j
    found = Factors(sparse.csr_matrix(a), factoriser_for(backend)).solve(a @ x)
    np.testing.assert_allclose(found, x, rtol=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_is_singular_has_no_solution_or_says_so(backend: str) -> None:
    a = np.diag(np.arange(1.0, 7.0)) + np.ones((6, 6))
    a[4] = a[2] + a[3]
    right = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    for limits in (OF_STEP, OF_STEP._replace(is_strict=True)):
        assert Factors(sparse.csr_matrix(a), factoriser_for(backend), limits).solve(right) is None
    saddle = Saddle(sparse.csr_matrix(a), np.zeros(6, bool), factoriser_for(backend))
    for transposed in (False, True):
        whole = a.T if transposed else a
        x = saddle.solve(right, transposed)
        assert x is not None and saddle.is_singular
        # what is left is along the null vector of the other side
        null = np.linalg.svd(whole)[0][:, -1]
        rest = saddle.left[:, 0] / np.linalg.norm(saddle.left[:, 0])
        assert abs(abs(rest @ null) - 1.0) < 1e-10
        assert saddle.unbalanced == pytest.approx(np.linalg.norm(saddle.left.T @ right), rel=1e-9)
        met = right - saddle.left @ np.linalg.solve(saddle.left.T @ saddle.left, saddle.left.T @ right)
        x = saddle.solve(met, transposed)
        assert x is not None and np.linalg.norm(whole @ x - met) < 1e-12 * np.linalg.norm(met)
    assert Factors(sparse.csr_matrix(np.full((2, 2), np.nan)), factoriser_for(backend)).solve(np.ones(2)) is None


def test_superlu_is_not_asked_for_what_is_singular_whatever_its_entries_are() -> None:
    assert lu(sparse.csc_matrix(np.array([[0.0, 1.0], [0.0, 2.0]]))) is None
    assert lu(sparse.csc_matrix(np.array([[1.0, 2.0], [2.0, 4.0]])), least=1e-15) is None
    pivots = lu(sparse.csc_matrix(np.diag([2.0, -3.0, 4.0])), {"diag_pivot_thresh": 0.0})
    assert pivots is not None and pivots.negative == 1 and pivots.pivots.tolist() == [2.0, -3.0, 4.0]
