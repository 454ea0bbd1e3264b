"""Blocks of vectors made orthonormal in masses."""
from __future__ import annotations

from typing import Any

import numpy as np

Array = np.ndarray
# what is left of a vector once others are taken out of it, and is round-off
NOTHING = 1e-12
# share of a vector that others of its block and those before leave, above which it is taken by Cholesky factors of the block
INDEPENDENT = 1e-2
TINY = 1e-300


def sizes_in(x: Array, mass: Any) -> Array:
    """Norms of columns in the mass."""
    return np.sqrt(np.maximum(np.sum(x * (mass @ x), axis=0), 0.0))


def orthonormal(x: Array, removed: Array, known: Array, mass: Any) -> tuple[Array, Array, Array]:
    """Columns of x, which were made orthogonal in the mass to known ones, made orthonormal to each other, the triangle R [j, m]
    with x = Q R, j <= m, and the masses times Q: those of which nothing is left next to their sizes before that are left out.
    removed [m]: squares of what was taken out of them."""
    heavy = mass @ x
    gram = x.T @ heavy
    size = np.sqrt(np.maximum(np.diag(gram), 0.0))
    sizes = np.sqrt(removed + size * size)
    if np.all(size > INDEPENDENT * sizes):
        # twice by Cholesky (T. Fukaya et al., 2014)
        first = _triangle(gram, size)
        if first is not None:
            q = x @ np.linalg.inv(first)
            heavy = mass @ q
            gram = q.T @ heavy
            second = _triangle(gram, np.ones(size.size))
            if second is not None:
                back = np.linalg.inv(second)
                return q @ back, second @ first, heavy @ back
    return _one_by_one(x, sizes, known, mass)


def _triangle(gram: Array, size: Array) -> Array | None:
    """R with R^T R = gram, whose columns have these sizes; None where these depend on each other."""
    try:
        lower = np.linalg.cholesky(gram / np.outer(size, size))
    except np.linalg.LinAlgError:
        return None
    return lower.T * size if np.all(np.diag(lower) > INDEPENDENT) else None


def _one_by_one(x: Array, sizes: Array, known: Array, mass: Any) -> tuple[Array, Array, Array]:
    """The same of columns that depend on each other or on known ones."""
    m = x.shape[1]
    q = np.zeros_like(x)
    r = np.zeros((m, m))
    kept = 0
    for j in range(m):
        column = x[:, j].copy()
        last = float(sizes_in(column[:, None], mass)[0])
        while True:
            part = q[:, :kept].T @ (mass @ column)
            column -= q[:, :kept] @ part
            r[:kept, j] += part
            size = float(sizes_in(column[:, None], mass)[0])
            if size > 0.5 * last or not size > NOTHING * sizes[j]:
                break
            # what is left of a difference is orthogonal to no more than a few digits
            column -= known @ (known.T @ (mass @ column))
            last = size
        if not size > max(NOTHING * float(sizes[j]), TINY):
            continue
        q[:, kept] = column / size
        r[kept, j] = size
        kept += 1
    return q[:, :kept], r[:kept], mass @ q[:, :kept]
