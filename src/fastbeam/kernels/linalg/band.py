"""Matrices of a small bandwidth w: signs of the eigenvalues of their symmetric part, counted as pivots (Sylvester), and how far
they are from symmetric.

Arrays: upper [n, w + 2]: entry (i, i + k) of the symmetric part stands in upper[i, k]; the last column is room for the diagonal.
whole [n, 3 w + 1]: entry (i, j) stands in whole[j, 2 w + i - j], as LAPACK keeps bands; it needs the first w for exchanged rows.
"""
from __future__ import annotations

from fastbeam.kernels.jit.decorators import kernel


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
def put_blocks(rows, columns, blocks, size, width, whole):
    """Store the matrix of blocks in a band that was zero.

    Arrays: rows, columns [m], blocks [m, size, 8], whole [n, 3 w + 1]
    """
    for b in range(rows.shape[0]):
        for i in range(size):
            for j in range(size):
                at, to = size * rows[b] + i, size * columns[b] + j
                whole[to, 2 * width + at - to] = blocks[b, i, j]


@kernel
def put_entries(indptr, indices, data, width, whole):
    """Store a matrix by rows, without duplicates, in a band that was zero.

    Arrays: indptr [n + 1], indices, data [entries], whole [n, 3 w + 1]
    """
    for at in range(whole.shape[0]):
        for k in range(indptr[at], indptr[at + 1]):
            to = indices[k]
            whole[to, 2 * width + at - to] = data[k]


@kernel
def largest_skew(whole, width, scale):
    """Return the largest difference of an entry and the transposed one, each multiplied by the scale of its row and of its
    column.

    Arrays: whole [n, 3 w + 1], scale [n]
    """
    n = whole.shape[0]
    largest = 0.0
    for i in range(n):
        for j in range(i + 1, min(n, i + width + 1)):
            skew = abs(whole[j, 2 * width + i - j] - whole[i, 2 * width + j - i])
            largest = max(largest, skew * scale[i] * scale[j])
    return largest


@kernel
def negative_pivots(upper, least):
    """Count the negative pivots of the matrix, which is overwritten; -1 where one is not larger than this share of its diagonal
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
