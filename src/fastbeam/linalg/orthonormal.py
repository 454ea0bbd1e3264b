"""Orthonormalisation of blocks of vectors in a mass matrix, against known vectors and each other."""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray
# remaining share of a vector after projection: below the first it is round-off, above the second a product with R^-1 keeps digits
NOTHING, PLENTY = 1e-12, 0.1
TINY = 1e-300


class Block(NamedTuple):
    """Factors of x = known P + Q R; without columns that vanish to round-off."""

    q: Array              # [k, j], j <= m
    weighed: Array        # [k, j]: M Q
    r: Array              # [j, m], a triangle
    parts: Array          # P [known, m]


def orthonormal(x: Array, known: Array, mass: Any) -> Block:
    """Make columns of x [k, m] orthonormal in the mass [k, k], sparse; the known vectors [k, n] are orthonormal already."""
    weighed = mass @ x
    sizes = norms(x, weighed)
    parts = np.zeros((known.shape[1], x.shape[1]))
    # twice: a difference in which little is left is orthogonal to few digits, and damped modes need them all
    for _ in range(2 if known.shape[1] else 0):
        part = known.T @ weighed
        x = x - known @ part
        parts += part
        weighed = mass @ x
    try:
        r = np.linalg.cholesky(x.T @ weighed).T
    except np.linalg.LinAlgError:
        r = np.zeros_like(parts[:0])
    if r.size and np.all(np.diagonal(r) >= PLENTY * sizes):
        turn = np.linalg.inv(r)
        return Block(x @ turn, weighed @ turn, r, parts)
    q, r = _one_by_one(x, sizes, known, mass)
    return Block(q, mass @ q, r, parts)


def norms(x: Array, weighed: Array) -> Array:
    """Return norms of columns in the mass, from their products with it."""
    return np.sqrt(np.maximum(np.sum(x * weighed, axis=0), 0.0))


def _one_by_one(x: Array, sizes: Array, known: Array, mass: Any) -> tuple[Array, Array]:
    """Return Q and R if columns are nearly dependent; sizes: norms of the columns before known ones were taken out."""
    m = x.shape[1]
    # column by column: products with some columns of an array by rows have crashed in OpenBLAS
    q = np.zeros(x.shape, order="F")
    r = np.zeros((m, m))
    count = 0
    for j in range(m):
        column = x[:, j].copy()
        weighed = mass @ column
        last = float(norms(column, weighed))
        while True:
            part = q[:, :count].T @ weighed
            column -= q[:, :count] @ part
            r[:count, j] += part
            weighed = mass @ column
            size = float(norms(column, weighed))
            if size > 0.5 * last or not size > NOTHING * sizes[j]:
                break
            # a small difference is orthogonal to no more than a few digits
            column -= known @ (known.T @ weighed)
            weighed = mass @ column
            last = size
        if not size > max(NOTHING * float(sizes[j]), TINY):
            continue
        q[:, count] = column / size
        r[count, j] = size
        count += 1
    return q[:, :count], r[:count]
