"""MKL runtime: its library, number of threads, and settings of PARDISO."""
from __future__ import annotations

import ctypes
import ctypes.util
import glob
import os
import sys
from functools import cache
from typing import Any

import numpy as np

from fastbeam.interface.errors import BackendError
from fastbeam.kernels.empty_arrays import empty
from fastbeam.kernels.jit.decorators import link_library
from fastbeam.kernels.linalg.pardiso import PardisoTables

Array = np.ndarray
# unknowns below which PARDISO runs on one thread: threads cost more than they bring in small systems
SMALL = 5000


def load_mkl() -> Any | None:
    """Load the MKL runtime; return None if it is not installed."""
    return None if os.environ.get("FASTBEAM_NO_MKL") else _found_mkl()


def mkl_for(backend: str) -> Any | None:
    """Load the MKL runtime if a backend takes it; None with backend='superlu', and without MKL. Raises BackendError:
    backend='pardiso' without MKL."""
    mkl = None if backend == "superlu" else load_mkl()
    if mkl is None and backend == "pardiso":
        raise BackendError("backend='pardiso': no MKL runtime was found; pip install pypardiso, or use backend='auto'")
    return mkl


def threads_for(mkl: Any, n: int, threads: int | None = None) -> int:
    """Return the number of threads for n unknowns; threads: at most, if they were chosen."""
    return 1 if n < SMALL else threads or int(mkl.MKL_Get_Max_Threads())


@cache
def _found_mkl() -> Any | None:
    """Find and load the MKL runtime, once."""
    names = ["libmkl_rt.so*", "libmkl_rt*.dylib", "mkl_rt*.dll"]
    folders = [os.path.join(sys.prefix, "lib"), os.path.join(sys.prefix, "Library", "bin"), os.path.join(sys.base_prefix, "lib")]
    found = [path for folder in folders for name in names for path in sorted(glob.glob(os.path.join(folder, name)), key=len)]
    for path in found:
        if (library := _loaded(path)) is not None:
            return library
    # find_library asks compilers and linkers, which takes a tenth of a second
    system = ctypes.util.find_library("mkl_rt")
    return _loaded(system) if system else None


def _loaded(path: str) -> Any | None:
    """Load a library; return None if it cannot be loaded."""
    try:
        library = ctypes.CDLL(path)
    except OSError:
        return None
    # compiled code finds the symbol `pardiso` by name
    link_library(path)
    return library


class OnThreads:
    """Context of MKL on a number of threads, the calling one among them."""

    def __init__(self, mkl: Any, n: int) -> None:
        self._mkl, self._n, self._before = mkl, n, 0

    def __enter__(self) -> None:
        self._before = self._mkl.MKL_Set_Num_Threads_Local(self._n)

    def __exit__(self, *error: object) -> None:
        self._mkl.MKL_Set_Num_Threads_Local(self._before)


def pardiso_tables(indptr: Array, indices: Array, kind: int, more: dict[int, int], columns: int = 1, size: int = 1,
                   refined: bool = False) -> PardisoTables:
    """Make the arguments of PARDISO, not yet analysed.

    indptr, indices: int [n + 1], [n_blocks], square blocks by rows, 0-based.
    kind: `kernels.sparse.SYMMETRIC` (blocks on and above the diagonal) or `UNSYMMETRIC`.
    more: entries of PARDISO's iparm, by place. The others: METIS order, no scaling or matching (they are computed from the values
        of the analysis), no refinement of its own, which would take the present matrix and cost two more solutions.
    columns, size: right-hand sides at most; unknowns of a block.
    refined: keep places for residuals and corrections.
    """
    n, rows = indptr.size - 1, size * (indptr.size - 1)
    every, iparm = np.arange(indices.size), np.zeros(64, np.int32)
    for k, value in ({0: 1, 1: 2, 7: 0, 9: 13, 20: 1, 34: 1} | more).items():
        iparm[k] = value
    indptr, indices = indptr.astype(np.int32), indices.astype(np.int32)
    return PardisoTables(
        np.zeros(64, np.int64), iparm, np.array([1, 1, kind, 0, n, columns, 0, 0], np.int32),
        np.zeros(max(n, 1), np.int32), indptr, indices, every, every, empty(size**2 * indices.size),
        *map(empty, [(m, rows) for m in (columns, columns, *(columns * refined,) * 2)]), np.zeros(5, np.int64), np.zeros(2))
