"""Factors that bring rows and columns of a sparse matrix to a size of 1 (D. Ruiz, 2001), and residuals of the scaled matrix.

Arrays: size, data [entries] of a matrix by rows; indptr [n + 1], indices [entries]; row [n], column [m]: factors; most_row [n],
most_column [m]: largest entries; x [m], b, rest_out [n].
"""
from __future__ import annotations

import numpy as np

from fastbeam.kernels.jit.decorators import kernel


@kernel
def balance(size, indptr, indices, sweeps, row, column, most_row, most_column):
    """Divide the factors by the roots of the largest entries that they leave, `sweeps` times; factors without entries stay.

    Arrays: size, indices [entries], indptr [n + 1], row, most_row [n], column, most_column [m]
    """
    for _ in range(sweeps):
        most_row[:] = 0.0
        most_column[:] = 0.0
        for i in range(row.shape[0]):
            for k in range(indptr[i], indptr[i + 1]):
                j = indices[k]
                x = size[k] * row[i] * column[j]
                if x > most_row[i]:
                    most_row[i] = x
                if x > most_column[j]:
                    most_column[j] = x
        for i in range(row.shape[0]):
            if most_row[i] > 0.0:
                row[i] /= np.sqrt(most_row[i])
        for j in range(column.shape[0]):
            if most_column[j] > 0.0:
                column[j] /= np.sqrt(most_column[j])


@kernel
def leave(data, indptr, indices, row, column, x, b, rest_out):
    """Form the residual b - R A C x of the matrix with scaled rows and columns for a solution x; return its norm.

    Arrays: data, indices [entries], indptr [n + 1], row, b, rest_out [n], column, x [m]
    """
    square = 0.0
    for i in range(row.shape[0]):
        y = 0.0
        for k in range(indptr[i], indptr[i + 1]):
            y += data[k] * column[indices[k]] * x[indices[k]]
        rest = b[i] - row[i] * y
        rest_out[i] = rest
        square += rest * rest
    return np.sqrt(square)
