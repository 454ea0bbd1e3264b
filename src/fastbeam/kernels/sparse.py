"""MKL's PARDISO called from compiled code, so that a net of beams runs its time loop there too; every residual is checked.

The symbol `pardiso` is resolved when a kernel that uses it is loaded: `linsolve.load_mkl` has to run before.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba.core import types

from .._jit import kernel

_PARDISO = types.ExternalFunction("pardiso", types.void(*[types.intp] * 16))
ANALYSE, FACTOR, SOLVE, RELEASE = 11, 22, 33, -1
# its kinds of matrices: with symmetric structure; symmetric, of which it knows the blocks on and above the diagonal
UNSYMMETRIC, SYMMETRIC = 11, -2
# relative residual above which a solution is refined once, and above which it is not accepted
REFINE_AT, REFUSE_AT = 1e-12, 1e-8
# on large soft nets K x is a small difference of large forces, and round-off alone may leave this relative residual: a solution
# is as good as can be where it is that of a matrix this near. What is singular leaves more
SOFT, NEAR = 1e-5, 1e-13
# factors of an earlier iteration are used again where each solution with them leaves so little, which takes five at most, for
# about a tenth of the time of factors each; the error that stays is a share of an increment that is small itself
WORTH, AGAIN_AT = 1e-2, 1e-10


class PardisoTables(NamedTuple):
    """One analysed structure of n x n blocks by rows, 0-based; m right-hand sides at most. Of a symmetric one the blocks on and
    above the diagonal."""

    handle: np.ndarray    # int64 [64]
    iparm: np.ndarray     # int32 [64]
    numbers: np.ndarray   # int32 [8]: maxfct, mnum, mtype, phase, rows, right-hand sides, msglvl, error
    perm: np.ndarray      # int32 [rows]
    indptr: np.ndarray    # int32 [rows + 1]
    indices: np.ndarray   # int32 [blocks]
    block: np.ndarray     # int64 [blocks]: number of every block of the structure in the matrix, and of the one on the other side
    mirror: np.ndarray    # of the diagonal where the mean of both counts, else the same
    data: np.ndarray      # float64 [n n blocks]
    b: np.ndarray         # float64 [m, n rows]
    x: np.ndarray         # float64 [m, n rows]
    r: np.ndarray         # float64 [m, n rows]: residuals
    y: np.ndarray         # float64 [m, n rows]: corrections
    counts: np.ndarray    # int64 [4]: factorisations, refinements, solutions with earlier factors, 1 where there are factors of
    #                       this step
    worst: np.ndarray     # float64 [1]: largest accepted relative residual


@kernel
def call_pardiso(t, phase, b, x):
    """One call; returns its error code, 0 is good."""
    t.numbers[3] = phase
    t.numbers[5] = b.shape[0]
    n = t.numbers.ctypes.data
    _PARDISO(t.handle.ctypes.data, n, n + 4, n + 8, n + 12, n + 16, t.data.ctypes.data, t.indptr.ctypes.data,
             t.indices.ctypes.data, t.perm.ctypes.data, n + 20, t.iparm.ctypes.data, n + 24, b.ctypes.data, x.ctypes.data, n + 28)
    return t.numbers[7]


@kernel
def add_product(t, m, x, sizes, out, size):
    """out -= K x for right-hand side m, or, where only `sizes` count, out += |K| |x|."""
    n = len(size)
    symmetric = t.numbers[2] == SYMMETRIC
    for i in range(t.indptr.shape[0] - 1):
        for c in range(n):
            s = 0.0
            for k in range(t.indptr[i], t.indptr[i + 1]):
                o = n * (n * k + c)
                j = n * t.indices[k]
                for d in range(n):
                    z = t.data[o + d] * x[m, j + d]
                    s += abs(z) if sizes else -z
                if symmetric and j != n * i:
                    # the block on the other side of the diagonal
                    for d in range(n):
                        z = t.data[o + d] * x[m, n * i + c]
                        out[m, j + d] += abs(z) if sizes else -z
            out[m, n * i + c] += s


@kernel
def block_residual(t, x, b, r_out, size):
    """r = b - K x for all right-hand sides; returns the largest relative norm, infinity where it is not finite."""
    worst = 0.0
    for m in range(b.shape[0]):
        whole = 0.0
        error = 0.0
        for i in range(b.shape[1]):
            r_out[m, i] = b[m, i]
            whole += b[m, i] * b[m, i]
        add_product(t, m, x, False, r_out, size)
        for i in range(b.shape[1]):
            error += r_out[m, i] * r_out[m, i]
        if not error < np.inf:
            return np.inf
        if whole > 0.0:
            worst = max(worst, np.sqrt(error / whole))
        elif error > 0.0:
            return np.inf
    return worst


@kernel
def distance(t, x, b, r, room, size):
    """Largest norm of the residual r relative to |b| + |K| |x|, by right-hand sides."""
    worst = 0.0
    for m in range(b.shape[0]):
        forces = 0.0
        error = 0.0
        for i in range(b.shape[1]):
            room[m, i] = abs(b[m, i])
        add_product(t, m, x, True, room, size)
        for i in range(b.shape[1]):
            forces += room[m, i] * room[m, i]
            error += r[m, i] * r[m, i]
        if not forces < np.inf:
            return np.inf
        if error > 0.0:
            worst = max(worst, np.sqrt(error / forces))
    return worst


@kernel
def begin_step(t):
    """Factors of earlier steps do not count: a run goes on with the same bits from any step."""
    if t is not None:
        t.counts[3] = 0


@kernel
def add_correction(t, n, size):
    """x += K_old^-1 r with the factors that are there; the largest relative residual after it, infinity on an error."""
    if call_pardiso(t, SOLVE, t.r, t.y) != 0:
        return np.inf
    for m in range(t.b.shape[0]):
        for i in range(n):
            t.x[m, i] += t.y[m, i]
    return block_residual(t, t.x, t.b, t.r, size)


@kernel
def solve_again(t, n, size):
    """Solve with the factors of an earlier iteration of this step, by corrections. Returns the largest relative residual; above
    AGAIN_AT it was not worth it."""
    for m in range(t.b.shape[0]):
        for i in range(n):
            t.x[m, i] = 0.0
            t.r[m, i] = t.b[m, i]
    before = 1.0
    worst = 1.0
    for k in range(5):
        worst = add_correction(t, n, size)
        if worst <= AGAIN_AT:
            t.counts[2] += 1
            return worst
        if not worst <= WORTH * before:
            return worst
        before = worst
    return worst


@kernel
def solve_sparse(t, blocks, panel, width, size):
    """Solve K X = panel [n rows, width] in its first m columns, in place. False: no acceptable solution."""
    nu = len(size)
    for k in range(t.indices.shape[0]):
        a = t.block[k]
        b = t.mirror[k]
        for i in range(nu):
            for j in range(nu):
                x = blocks[8 * (nu * a + i) + j]
                if a != b or t.numbers[2] == SYMMETRIC:
                    x = 0.5 * (x + blocks[8 * (nu * b + j) + i])
                t.data[nu * (nu * k + i) + j] = x
    n = nu * (t.indptr.shape[0] - 1)
    for m in range(t.b.shape[0]):
        for i in range(n):
            t.b[m, i] = panel[i * width + m]
    worst = np.inf
    if t.counts[3] != 0:
        worst = solve_again(t, n, size)
    if not worst <= AGAIN_AT:
        t.counts[0] += 1
        t.counts[3] = 0
        if call_pardiso(t, FACTOR, t.b, t.x) != 0:
            return False
        if call_pardiso(t, SOLVE, t.b, t.x) != 0:
            return False
        worst = block_residual(t, t.x, t.b, t.r, size)
        if worst > REFINE_AT and worst < 1.0:
            t.counts[1] += 1
            worst = add_correction(t, n, size)
        if not worst <= REFUSE_AT:
            if not worst <= SOFT:
                return False
            if not distance(t, t.x, t.b, t.r, t.y, size) <= NEAR:
                return False
        t.counts[3] = 1
    t.worst[0] = max(t.worst[0], worst)
    for m in range(t.b.shape[0]):
        for i in range(n):
            panel[i * width + m] = t.x[m, i]
    return True
