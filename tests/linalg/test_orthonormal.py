"""Blocks made orthonormal in a mass: plain, nearly dependent and dependent columns."""
from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from fastbeam.linalg.orthonormal import orthonormal


@pytest.mark.parametrize("case", ["plain", "little is left", "nearly dependent", "dependent", "known", "nothing"])
@pytest.mark.parametrize("known_ones", [0, 6])
def test_blocks_are_orthonormal_and_add_up(case: str, known_ones: int) -> None:
    draw = np.random.default_rng(2)
    k, m = 40, 4
    mass = sparse.diags(draw.uniform(0.1, 10.0, k)).tocsr()
    known = orthonormal(draw.standard_normal((k, known_ones)), np.zeros((k, 0)), mass).q if known_ones else np.zeros((k, 0))
    x = draw.standard_normal((k, m))
    left = m
    if case == "little is left" and known_ones:
        x = 1e6 * known @ draw.standard_normal((known_ones, m)) + x
    elif case == "nearly dependent":
        x[:, 2] = x[:, 0] + 1e-7 * x[:, 2]
    elif case == "dependent":
        x[:, 2] = x[:, 0] - 3.0 * x[:, 1]
        left = 3
    elif case == "known" and known_ones:
        x[:, :2] = known[:, :2]
        left = 2
    elif case == "nothing":
        x[:] = 0.0
        left = 0
    block = orthonormal(x, known, mass)
    assert block.q.shape == block.weighed.shape == (k, left)
    every = np.concatenate((known, block.q), axis=1)
    np.testing.assert_allclose(every.T @ (mass @ every), np.eye(every.shape[1]), atol=3e-14)
    np.testing.assert_allclose(block.weighed, mass @ block.q, atol=1e-13)
    size = np.abs(x).max(initial=1.0)
    np.testing.assert_allclose(known @ block.parts + block.q @ block.r, x, atol=1e-13 * size)
    assert np.all(np.tril(block.r, -1) == 0.0)
