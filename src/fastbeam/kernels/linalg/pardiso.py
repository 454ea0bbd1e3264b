"""MKL's PARDISO called from compiled code, so that a net of beams runs its time loop there too; every residual is checked.

The symbol `pardiso` is resolved when a kernel that uses it is loaded: `mkl.load_mkl` has to run before.

Arrays: b, x, r, r_out, out, bound [m, n rows], m right-hand sides; blocks [8 n (blocks + 1)]; panel [rows, n, width] flat; data
[n n blocks].
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba.core import types

from fastbeam.kernels.jit.decorators import kernel

_PARDISO = types.ExternalFunction("pardiso", types.void(*[types.intp] * 16))
ANALYSE, FACTOR, SOLVE, RELEASE = 11, 22, 33, -1
# forward and backward substitution with a matrix whose last unknowns only take a Schur complement
FORWARD, BACKWARD = 331, 333
# phases of `go_on` at which a solution ends
DONE, FAILED = 0, -2
# matrix types of PARDISO: structurally symmetric; symmetric, where only the blocks on and above the diagonal are stored
UNSYMMETRIC, SYMMETRIC = 11, -2
# relative residual above which a solution is refined once, and above which it is not accepted
REFINE_AT, REFUSE_AT = 1e-12, 1e-8
# on large soft nets K x is a small difference of large forces, and round-off alone may leave this relative residual: a solution
# is as good as can be where it is that of a matrix this near. What is singular leaves more
SOFT, NEAR = 1e-5, 1e-13
# factors of an earlier iteration are used again if each correction leaves no more than this share, up to five corrections, for
# about a tenth of the time of factors each; the error that stays is a share of an increment that is small itself
WORTH, AGAIN_AT = 1e-2, 1e-10


class PardisoTables(NamedTuple):
    """One analysed structure of n x n blocks by rows, 0-based; m right-hand sides at most. A symmetric one has the blocks on and
    above the diagonal."""

    handle: np.ndarray    # int64 [64]
    iparm: np.ndarray     # int32 [64]
    numbers: np.ndarray   # int32 [8]: maxfct, mnum, mtype, phase, rows, right-hand sides, msglvl, error
    perm: np.ndarray      # int32 [rows]
    indptr: np.ndarray    # int32 [rows + 1]
    indices: np.ndarray   # int32 [blocks]
    block: np.ndarray     # int64 [blocks]: number of every block of the structure in the matrix
    mirror: np.ndarray    # int64 [blocks]: block on the other side of the diagonal where the mean of both sides counts,
    #                       else the block itself
    data: np.ndarray      # float64 [n n blocks]
    b: np.ndarray         # float64 [m, n rows]
    x: np.ndarray         # float64 [m, n rows]
    r: np.ndarray         # float64 [m, n rows]: residuals
    y: np.ndarray         # float64 [m, n rows]: corrections
    counts: np.ndarray    # int64 [5]: factorisations, refinements, solutions with earlier factors, 1 where there are factors of
    #                       an earlier solution of this step, corrections of the present one
    worst: np.ndarray     # float64 [2]: largest accepted relative residual; that before the next correction


@kernel
def call_pardiso(t, phase, b, x):
    """Call PARDISO once; return its error code, 0 is good."""
    t.numbers[3] = phase
    t.numbers[5] = b.shape[0]
    n = t.numbers.ctypes.data
    _PARDISO(t.handle.ctypes.data, n, n + 4, n + 8, n + 12, n + 16, t.data.ctypes.data, t.indptr.ctypes.data,
             t.indices.ctypes.data, t.perm.ctypes.data, n + 20, t.iparm.ctypes.data, n + 24, b.ctypes.data, x.ctypes.data, n + 28)
    return t.numbers[7]


@kernel
def add_product(t, m, x, sizes, out, dofs):
    """Subtract K x from out for right-hand side m, or, where only `sizes` count, add |K| |x|."""
    n = len(dofs)
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
def block_residual(t, x, b, r_out, dofs):
    """Form r = b - K x for all right-hand sides; return the largest relative norm, infinity if it is not finite."""
    worst = 0.0
    for m in range(b.shape[0]):
        whole = 0.0
        error = 0.0
        for i in range(b.shape[1]):
            r_out[m, i] = b[m, i]
            whole += b[m, i] * b[m, i]
        add_product(t, m, x, False, r_out, dofs)
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
def distance(t, x, b, r, bound, dofs):
    """Return the largest norm of the residual r relative to |b| + |K| |x|, by right-hand sides."""
    worst = 0.0
    for m in range(b.shape[0]):
        forces = 0.0
        error = 0.0
        for i in range(b.shape[1]):
            bound[m, i] = abs(b[m, i])
        add_product(t, m, x, True, bound, dofs)
        for i in range(b.shape[1]):
            forces += bound[m, i] * bound[m, i]
            error += r[m, i] * r[m, i]
        if not forces < np.inf:
            return np.inf
        if error > 0.0:
            worst = max(worst, np.sqrt(error / forces))
    return worst


@kernel
def begin_step(t):
    """Discard factors of earlier steps, so that a run that goes on from a checkpoint has the same bits."""
    t.counts[3] = 0


@kernel
def load_system(t, blocks, panel, width, dofs):
    """Take K and the right-hand sides from the first m columns of panel [n rows, width]. Return the first call for `go_on`."""
    nu = len(dofs)
    symmetric = t.numbers[2] == SYMMETRIC
    for k in range(t.indices.shape[0]):
        a = t.block[k]
        b = t.mirror[k]
        for i in range(nu):
            for j in range(nu):
                x = blocks[8 * (nu * a + i) + j]
                t.data[nu * (nu * k + i) + j] = 0.5 * (x + blocks[8 * (nu * b + j) + i]) if symmetric else x
    for m in range(t.b.shape[0]):
        for i in range(t.b.shape[1]):
            t.b[m, i] = panel[i * width + m]
    return start_corrections(t) if t.counts[3] != 0 else FACTOR


@kernel
def start_corrections(t):
    """Start from x = 0, whose residual is b."""
    t.counts[4] = 0
    t.worst[1] = 1.0
    for m in range(t.b.shape[0]):
        for i in range(t.b.shape[1]):
            t.x[m, i] = 0.0
            t.r[m, i] = t.b[m, i]
    return SOLVE


@kernel
def go_on(t, phase, code, dofs):
    """Return the next phase after a call of `phase` that returned `code`: FACTOR, SOLVE (y = K^-1 r with the present factors),
    DONE or FAILED.

    x is a sum of corrections. One with present factors, two if the residual asks for it; with the factors of an earlier iteration
    up to five, as long as each is worth it, else new factors."""
    if phase == FACTOR:
        t.counts[0] += 1
        t.counts[3] = 0
        return start_corrections(t) if code == 0 else FAILED
    worst = np.inf
    if code == 0:
        for m in range(t.b.shape[0]):
            for i in range(t.b.shape[1]):
                t.x[m, i] += t.y[m, i]
        worst = block_residual(t, t.x, t.b, t.r, dofs)
    before = t.worst[1]
    t.worst[1] = worst
    t.counts[4] += 1
    if t.counts[3] != 0:
        if not worst <= AGAIN_AT:
            return SOLVE if worst <= WORTH * before and t.counts[4] < 5 else FACTOR
        t.counts[2] += 1
    elif t.counts[4] == 1 and worst > REFINE_AT and worst < 1.0:
        t.counts[1] += 1
        return SOLVE
    elif not worst <= REFUSE_AT:
        if not worst <= SOFT:
            return FAILED
        if not distance(t, t.x, t.b, t.r, t.y, dofs) <= NEAR:
            return FAILED
    t.counts[3] = 1
    t.worst[0] = max(t.worst[0], worst)
    return DONE


@kernel
def store_solution(t, panel, width):
    """Write x to the first m columns of panel [n rows, width]."""
    for m in range(t.b.shape[0]):
        for i in range(t.b.shape[1]):
            panel[i * width + m] = t.x[m, i]


@kernel
def take_half(t, data, own, dofs):
    """Take the blocks of a half (`halves.Half`) from those of the whole matrix, each row of numbers on its own; blocks between
    the rows from `own` on count half."""
    nu = len(dofs)
    for row in range(0, t.numbers[4], nu):
        first = t.indptr[row]
        n = t.indptr[row + 1] - first
        for k in range(n // nu):
            share = 0.5 if row >= own and t.indices[first + nu * k] >= own else 1.0
            o = nu * nu * t.block[first // (nu * nu) + k]
            for i in range(nu):
                for j in range(nu):
                    t.data[first + n * i + nu * k + j] = share * data[o + nu * i + j]


@kernel
def solve_sparse(t, blocks, panel, width, dofs):
    """Solve K X = panel [n rows, width] in its first m columns, in place; return False if there is no acceptable solution."""
    phase = load_system(t, blocks, panel, width, dofs)
    while phase > DONE:
        phase = go_on(t, phase, call_pardiso(t, phase, t.r, t.y), dofs)
    if phase == FAILED:
        return False
    store_solution(t, panel, width)
    return True
