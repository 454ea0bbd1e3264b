"""Sparse direct solution of block matrices: PARDISO by phases, SuperLU as the fallback, every residual checked.

MKL's PARDISO perturbs small pivots and may return garbage without an error code on indefinite matrices; the check is the only
warning there is.
"""
from __future__ import annotations

import ctypes
import ctypes.util
import glob
import os
import sys
from typing import Any

import numpy as np

Array = np.ndarray
# relative residual above which a solution is refined once, and above which it is not accepted
REFINE_AT, REFUSE_AT = 1e-12, 1e-8


def load_mkl() -> Any | None:
    """The MKL runtime, or None where it is not installed."""
    if os.environ.get("FASTBEAM_NO_MKL"):
        return None
    names = ["libmkl_rt.so*", "libmkl_rt*.dylib", "mkl_rt*.dll"]
    folders = [os.path.join(sys.prefix, "lib"), os.path.join(sys.prefix, "Library", "bin"), os.path.join(sys.base_prefix, "lib")]
    found = [path for folder in folders for name in names for path in sorted(glob.glob(os.path.join(folder, name)), key=len)]
    system = ctypes.util.find_library("mkl_rt")
    for path in [*found, *([system] if system else [])]:
        try:
            return ctypes.CDLL(path)
        except OSError:
            continue
    return None


class Pardiso:
    """One structure, analysed once: 6 x 6 blocks by rows (0-based BSR), real unsymmetric.

    Parameters
    ----------
    mkl : the MKL runtime
    indptr, indices : int [n + 1], [n_blocks]
    data : float64 [n_blocks, 6, 6]
        Filled by the caller before every `factor`; read in place.
    """

    def __init__(self, mkl: Any, indptr: Array, indices: Array, data: Array) -> None:
        self._call = mkl.pardiso
        self._call.restype = None
        n = indptr.size - 1
        self.data = data
        self._indptr, self._indices = indptr.astype(np.int32), indices.astype(np.int32)
        self._handle = np.zeros(64, np.int64)
        self._iparm = np.zeros(64, np.int32)
        # METIS order, no scaling or matching (they are computed from the values of the analysis), two refinements at most
        for k, value in {0: 1, 1: 2, 7: 2, 9: 13, 20: 1, 34: 1, 36: 6}.items():
            self._iparm[k] = value
        self._perm = np.zeros(max(n, 1), np.int32)
        self._int = {"maxfct": 1, "mnum": 1, "mtype": 11, "phase": 11, "n": n, "nrhs": 1, "msglvl": 0, "error": 0}
        self._int = {k: ctypes.c_int32(v) for k, v in self._int.items()}
        self._empty = np.zeros(6 * n)
        self._run(11, self._empty, self._empty)

    def _run(self, phase: int, b: Array, x: Array) -> None:
        i = self._int
        i["phase"].value = phase
        i["nrhs"].value = 1 if b.ndim == 1 else b.shape[0]

        def pointer(a: Array) -> ctypes.c_void_p:
            return ctypes.c_void_p(a.ctypes.data)

        self._call(pointer(self._handle), *(ctypes.byref(i[k]) for k in ("maxfct", "mnum", "mtype", "phase", "n")), pointer(self.data),
                   pointer(self._indptr), pointer(self._indices), pointer(self._perm), ctypes.byref(i["nrhs"]), pointer(self._iparm),
                   ctypes.byref(i["msglvl"]), pointer(b), pointer(x), ctypes.byref(i["error"]))
        if i["error"].value:
            raise ArithmeticError(f"PARDISO error {i['error'].value} in phase {phase}")

    def factor(self) -> None:
        """Numerical factorisation of the present data."""
        self._run(22, self._empty, self._empty)

    def solve(self, b: Array) -> Array:
        """Solve for right-hand sides [m, 6 n]."""
        b = np.ascontiguousarray(b)
        x = np.zeros_like(b)
        self._run(33, b, x)
        return x

    def close(self) -> None:
        """Free the factors."""
        if self._handle.any():
            try:
                self._run(-1, self._empty, self._empty)
            finally:
                self._handle[:] = 0

    def __del__(self) -> None:
        try:
            self.close()
        except Exception:  # the interpreter may be shutting down
            pass


class SparseSolver:
    """Solves with the blocks of a pattern: PARDISO where MKL is present, else or after a bad residual SuperLU.

    Attributes
    ----------
    solves, fallbacks, refinements : int
        How often a factorisation was made, SuperLU had to help, a solution was refined.
    worst_residual : float
        Largest accepted relative residual.
    """

    def __init__(self, rows: Array, columns: Array, n: int, backend: str = "auto") -> None:
        self.n = n
        self._columns = np.ascontiguousarray(columns)
        self._indptr = np.searchsorted(rows, np.arange(n + 1))
        self._data = np.zeros((rows.size, 6, 6))
        mkl = load_mkl() if backend in ("auto", "pardiso") else None
        self._pardiso: Pardiso | None = None
        self._mkl = mkl
        self.solves = self.fallbacks = self.refinements = 0
        self.worst_residual = 0.0

    @property
    def name(self) -> str:
        """What is used, for the result."""
        if self._mkl is None:
            return "SuperLU (MKL not found)"
        return f"PARDISO, {self.fallbacks} of {self.solves} solves fell back to SuperLU"

    def solve(self, blocks: Array, right: Array) -> Array | None:
        """Solve K x = b for b [m, 6 n]; blocks [n_blocks, 6, 8]. None where no solver gives an acceptable residual."""
        from scipy import sparse
        self._data[:] = blocks[:, :, :6]
        self.solves += 1
        matrix = sparse.bsr_matrix((self._data, self._columns, self._indptr), shape=(6 * self.n, 6 * self.n))
        if not (np.isfinite(self._data).all() and np.isfinite(right).all()):
            return None
        if self._mkl is not None:
            x = self._by_pardiso(matrix, right)
            if x is not None:
                return x
            self.fallbacks += 1
        return self._by_superlu(matrix, right)

    def _residual(self, matrix: Any, x: Array, b: Array) -> tuple[Array, float]:
        r = b - (matrix @ x.T).T
        size = np.linalg.norm(b, axis=1)
        worst = float(np.max(np.linalg.norm(r, axis=1) / np.where(size > 0.0, size, 1.0)))
        return r, worst if np.isfinite(worst) else np.inf

    def _by_pardiso(self, matrix: Any, b: Array) -> Array | None:
        try:
            if self._pardiso is None:
                self._pardiso = Pardiso(self._mkl, self._indptr, self._columns, self._data)
            self._pardiso.factor()
            x = self._pardiso.solve(b)
            r, worst = self._residual(matrix, x, b)
            if REFINE_AT < worst < 1.0:
                self.refinements += 1
                x = x + self._pardiso.solve(r)
                worst = self._residual(matrix, x, b)[1]
        except ArithmeticError:
            return None
        if not worst <= REFUSE_AT:
            return None
        self.worst_residual = max(self.worst_residual, worst)
        return x

    def _by_superlu(self, matrix: Any, b: Array) -> Array | None:
        from scipy.sparse.linalg import splu
        try:
            factors = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
            x = factors.solve(b.T).T
            r, worst = self._residual(matrix, x, b)
            if REFINE_AT < worst < 1.0:
                self.refinements += 1
                x = x + factors.solve(r.T).T
                worst = self._residual(matrix, x, b)[1]
            if not worst <= REFUSE_AT:
                # threshold pivoting without the symmetric bias
                x = splu(matrix.tocsc()).solve(b.T).T
                worst = self._residual(matrix, x, b)[1]
        except RuntimeError:
            return None
        if not worst <= REFUSE_AT:
            return None
        self.worst_residual = max(self.worst_residual, worst)
        return np.ascontiguousarray(x)
