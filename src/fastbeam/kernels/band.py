"""Symmetric matrices of a small bandwidth: signs of their eigenvalues, counted as pivots (Sylvester).

Arrays: upper [n, w + 2]: entry (i, i + k) of the symmetric part stands in upper[i, k]; the last column is room for the diagonal.
"""
from __future__ import annotations

from .._jit import kernel


@kernel
def add_blocks(rows, columns, blocks, size, upper):
    """Add half of blocks and of their transposed ones.

    Arrays: rows, columns [m], blocks [m, size, 8], upper [n, w + 2]
    """
    for b in range(rows.shape[0]):
        for i in range(size):
            for j in range(size):
                at, to = size * rows[b] + i, size * columns[b] + j
                if at <= to:
                    upper[at, to - at] += 0.5 * blocks[b, i, j]
                if at >= to:
                    upper[to, at - to] += 0.5 * blocks[b, i, j]


@kernel
def add_entries(indptr, indices, data, upper):
    """Add half of a matrix by rows and of its transposed one.

    Arrays: indptr [n + 1], indices, data [entries], upper [n, w + 2]
    """
    for at in range(upper.shape[0]):
        for k in range(indptr[at], indptr[at + 1]):
            to = indices[k]
            if at <= to:
                upper[at, to - at] += 0.5 * data[k]
            if at >= to:
                upper[to, at - to] += 0.5 * data[k]


@kernel
def negative_pivots(upper, least):
    """Number of negative pivots of the matrix, which is overwritten; -1 where one is not larger than this share of its diagonal
    entry.

    Arrays: upper [n, w + 2]
    """
    n, kept = upper.shape[0], upper.shape[1] - 1
    for k in range(n):
        upper[k, kept] = least * abs(upper[k, 0])
    count = 0
    for k in range(n):
        pivot = upper[k, 0]
        # NaN fails the comparison too
        if not abs(pivot) > upper[k, kept]:
            return -1
        if pivot < 0.0:
            count += 1
        last = min(kept, n - k)
        for i in range(1, last):
            share = upper[k, i] / pivot
            if share != 0.0:
                for j in range(i, last):
                    upper[k + i, j - i] -= share * upper[k, j]
    return count
