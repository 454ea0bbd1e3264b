"""Scaling factors of rows and columns that bring the entries of a sparse matrix to a size of 1, all of them powers of two."""
from __future__ import annotations

from typing import Any

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.linalg.scaling import balance

Array = np.ndarray
# sweeps of the equilibration; each halves the exponent of the remaining factor
SWEEPS = 12
# share of the largest stiffness of a kind below which a stiffness is round-off
ROUND_OFF = 1e-12


def rows_of(matrix: Any) -> Array:
    """Return the row of every entry of a matrix by rows."""
    return np.arange(matrix.shape[0]).repeat(matrix.indptr[1:] - matrix.indptr[:-1])


def with_values(matrix: Any, data: Array) -> Any:
    """Return a sparse matrix with the structure of this one, shared, and other values: making one anew looks at the structure."""
    out = object.__new__(type(matrix))
    vars(out).update(vars(matrix), data=data)
    return out


def entry_scales(matrix: Any, row: Array, column: Array) -> Array:
    """Return the factors of the entries of a matrix by rows from those of its rows and columns [n]."""
    return np.asarray(row.repeat(matrix.indptr[1:] - matrix.indptr[:-1]) * column[matrix.indices])


def with_diagonal(matrix: Any) -> Any:
    """Copy a matrix by rows with all of its diagonal, zeros too, in order."""
    matrix = matrix.copy()
    matrix.sum_duplicates()
    row = rows_of(matrix)
    absent = np.setdiff1d(np.arange(matrix.shape[0]), row[matrix.indices == row], assume_unique=True)
    if not absent.size:
        return matrix
    where = np.append(row, absent), np.append(matrix.indices, absent)
    matrix = sparse.csr_matrix((np.append(matrix.data, np.zeros(absent.size)), where), matrix.shape)
    matrix.sort_indices()
    return matrix


def equilibrated(matrix: Any, begin: tuple[Array, Array] | None = None) -> tuple[Array, Array]:
    """Return factors of rows and columns [n] of a matrix by rows, powers of two, with which the largest entry of each comes close
    to 1 (D. Ruiz, 2001); the same for both if the matrix is symmetric. 1 for those without entries. begin: factors to begin with;
    default: 1."""
    n = matrix.indptr.size - 1
    structure = [x.astype(np.int32, copy=False) for x in (matrix.indptr, matrix.indices)]
    row, column = (np.ones(n), np.ones(n)) if begin is None else (begin[0].copy(), begin[1].copy())
    balance(np.abs(matrix.data), *structure, SWEEPS, row, column, np.zeros(n), np.zeros(n))
    return np.exp2(np.rint(np.log2(row))), np.exp2(np.rint(np.log2(column)))


def parity(size: float) -> float:
    """Return 1 or 2, with which the power of two in a number becomes an even one: its root is a power of two as well."""
    return float(2.0**(np.frexp(size)[1] % 2))


def counted(stiff: Array, kind: Array) -> Array:
    """Return the stiffnesses, bool [n], that are more than round-off of the largest among those of one kind, bool [n]."""
    return stiff > ROUND_OFF * float(np.max(stiff[kind], initial=0.0))


def _levers(size: Any, of: tuple[Array, Array], multiplier: Array, turns: Array) -> Array:
    """Return the entries, bool, that are no round-off of a constraint: next to the largest by displacements, or by rotations."""
    joins = multiplier[of[0]] != multiplier[of[1]]
    of_turns = turns[np.where(multiplier[of[0]], of[1], of[0])]
    use = np.ones(size.data.size, bool)
    for kind in (joins & of_turns, joins & ~of_turns):
        use[kind] = counted(size.data, kind)[kind]
    return use


def typical_factors(size: Any, multiplier: Array, turns: Array, stiff: Array) -> tuple[float, Array, Array]:
    """Return factors of a matrix, 1 or 2, of its rows, and of its columns, from typical stiffnesses against displacements and
    rotations, not from units. size: sizes of the entries, by rows; stiff: stiffnesses, 0 if they do not count."""
    n, diagonal = multiplier.size, size.diagonal()
    of = np.repeat(np.arange(n), np.diff(size.indptr)), size.indices
    # rows of fixed unknowns have only a diagonal entry
    joined = np.zeros(n, bool)
    joined[of[0][(of[0] != of[1]) & (size.data > 0.0)]] = True
    once, row = 0.0, np.zeros(n)
    for kind in (~turns & ~multiplier, turns & ~multiplier):
        own = stiff[kind & joined & counted(stiff, kind & joined)]
        if own.size:
            typical = float(np.median(own))
            once = once or parity(typical)
            row[kind] = 1.0 / np.sqrt(once * typical)
    once = once or 1.0
    column, free = row.copy(), ~multiplier & (row == 0.0)
    use = _levers(size, of, multiplier, turns)
    # constraints, then unknowns without stiffness by way of these, then constraints on such unknowns alone
    for kind in (multiplier & joined, free, multiplier & joined):
        most = np.zeros((2, n))
        for largest, at, factor in zip(most, (of, of[::-1]), (column, row)):
            np.maximum.at(largest, at[0][use], once * size.data[use] * factor[at[1][use]])
        row, column = (np.where(kind & (factor == 0.0) & (largest > 0.0), 1.0 / np.where(largest > 0.0, largest, 1.0), factor)
                       for largest, factor in zip(most, (row, column)))
        for one in (free & turns, free & ~turns):
            for factor in (row, column):
                known = factor[one & (factor > 0.0)]
                factor[one & (factor == 0.0)] = np.median(known) if known.size else 0.0
    alone = ~joined & (diagonal > 0.0)
    column[column == 0.0] = row[row == 0.0] = 1.0
    row[alone] = 1.0 / (once * diagonal * column)[alone]
    return once, row, column
