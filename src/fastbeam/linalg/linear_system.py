"""Sparse direct solution of the block matrices of steps: PARDISO inside compiled code, SuperLU as the fallback."""
from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.kernels.linalg import pardiso as kernels
from fastbeam.kernels.linalg.pardiso import PardisoTables
from fastbeam.linalg.factors import OF_STEP, Factors, PardisoMemory
from fastbeam.linalg.halves import Each, Halves, cut
from fastbeam.linalg.inertia import Blocks, Nodes, Signs, held
from fastbeam.linalg.mkl import mkl_for, pardiso_tables, threads_for
from fastbeam.linalg.pattern import Pattern

Array = np.ndarray
# number of threads for which PARDISO cuts a matrix; the bits are the same on any number of threads, but depend on this number
REPRODUCIBLE = 8
BACKENDS = ("auto", "pardiso", "superlu")
# unknowns from which on a matrix is cut in two, where results have to be the same bits on any number of threads
HALVES_FROM = 8000
# share of the largest entry of a column from which on SuperLU takes the one on the diagonal, in statics
FEW = 1e-3


def check_backend(backend: str) -> None:
    """Check the name of a solver. Raises SceneError."""
    if backend not in BACKENDS:
        raise SceneError(f"backend {backend!r} does not exist: choose 'auto', 'pardiso' or 'superlu'")


class Pardiso:
    """PARDISO for one structure, analysed once: square blocks by rows (0-based BSR), real unsymmetric.

    indptr, indices: int [n + 1], [n_blocks].
    columns: right-hand sides of a solve.
    size: unknowns of a block.
    threads: default: as many as MKL likes.
    reproducible: the same bits for any number of threads. Large matrices are then cut in two (`halves`), if that leaves few nodes
        between.
    symmetric: take the symmetric part of the matrix: half the operations and memory.
    Raises ArithmeticError: the analysis fails.
    """

    def __init__(self, mkl: Any, indptr: Array, indices: Array, columns: int, size: int, threads: int | None = None,
                 reproducible: bool = False, symmetric: bool = False) -> None:
        n = indptr.size - 1
        block = mirror = np.arange(indices.size)
        if symmetric:
            rows = np.repeat(np.arange(n), np.diff(indptr))
            block = np.flatnonzero(indices >= rows)
            mirror = np.searchsorted(rows * n + indices, indices[block] * n + rows[block])
            indptr, indices = np.searchsorted(rows[block], np.arange(n + 1)), indices[block]
        kind = kernels.SYMMETRIC if symmetric else kernels.UNSYMMETRIC
        more = {33: REPRODUCIBLE if reproducible else 0, 36: size}
        self.halves: Halves | None = None
        tables = pardiso_tables(indptr, indices, kind, more, columns, size, refined=True)
        self.tables = tables._replace(block=block, mirror=mirror)
        self._memory = PardisoMemory(mkl, self.tables, threads_for(mkl, size * n, threads))
        if reproducible and not symmetric and size * n >= HALVES_FROM:
            parts = cut(self.tables.indptr, self.tables.indices)
            if parts is not None:
                self.halves = Halves(mkl, parts, self.tables, size)
                return
        code = self._memory.call(kernels.ANALYSE, self.tables.b, self.tables.x)
        if code:
            raise ArithmeticError(f"PARDISO error {code} in the analysis")

    def threads(self) -> AbstractContextManager[None]:
        """Run calls of compiled code on the threads of the analysis."""
        return self._memory.threads

    @property
    def factor_bytes(self) -> int:
        """Size of the factors in bytes, by PARDISO's own account."""
        return 1024 * int(self.tables.iparm[16]) if self.halves is None else self.halves.factor_bytes

    @property
    def arrays(self) -> list[Array]:
        """All arrays that it keeps besides the factors."""
        return [*self.tables, *([] if self.halves is None else self.halves.arrays)]

    def solve(self, blocks: Array, panel: Array, width: int, size: Any, each: Each) -> bool:
        """Solve for the panel in place, see `kernels.sparse.solve_sparse`; each: works on a list by threads."""
        if self.halves is not None:
            return self.halves.solve(blocks, panel, width, size, each)
        with self.threads():
            return bool(kernels.solve_sparse(self.tables, blocks, panel, width, size))


class SuperLU:
    """Fallback solver: factorises anew every time, slower, with pivoting across blocks."""

    def __init__(self, rows: Array, columns: Array, n: int, size: int) -> None:
        self.n, self.size = n, size
        self._rows, self._columns = np.ascontiguousarray(rows), np.ascontiguousarray(columns)
        # function that finds one unknown of every free motion of the matrix by rows, to be fixed
        self.free: Callable[[Callable[[], Any]], Array] | None = None

    def solve(self, blocks: Array, right: Array) -> Array | None:
        """Solve K x = b for b [m, size*n]; blocks [n_blocks, size, 8]. Return None if no acceptable solution was found."""
        if not np.isfinite(blocks).all():
            return None
        matrix = self.by_rows(blocks)
        if self.free is None:
            return Factors(matrix, limits=OF_STEP).solve(right)
        # in statics with few exchanges of rows, which fill the factors of fine meshes
        return Factors(held(matrix, self.free(lambda: matrix)), limits=OF_STEP, exchange=FEW).solve(right)

    def signs(self, blocks: Array, symmetric: bool,
              free: Callable[[Callable[[], Any]], Array] | None = None) -> tuple[int, int] | None:
        """Return `inertia.Signs.count` of the matrix of blocks [n_blocks, size, 8]."""
        of = self._of(blocks)
        return Signs(of, Nodes(of.n, self.size, 2 if self.size == 3 else 3), free).count(symmetric)

    def matrix(self, blocks: Array) -> Any:
        """Return the matrix of blocks [n_blocks, size, 8] by columns."""
        return self._of(blocks).matrix

    def by_rows(self, blocks: Array) -> Any:
        """Return the matrix of blocks [n_blocks, size, 8] by rows."""
        return self._of(blocks).by_rows

    def _of(self, blocks: Array) -> Blocks:
        return Blocks(self.size * self.n, self._rows, self._columns, blocks, self.size)


class LinearSystem:
    """Solver for the nodes of a model: block elimination if the pattern has a plan, else PARDISO, both inside compiled code;
    SuperLU without MKL, and for a step in which the others failed.

    columns: right-hand sides of a solve.
    backend: {'auto', 'pardiso', 'superlu'}, for patterns without a plan.
    size: unknowns a node.
    threads, reproducible, symmetric: options of PARDISO.
    Raises BackendError: backend='pardiso' without MKL.
    """

    def __init__(self, pattern: Pattern, columns: int, backend: str = "auto", size: int = 6, threads: int | None = None,
                 reproducible: bool = False, symmetric: bool = False) -> None:
        self.pattern, self.size = pattern, size
        self.fallbacks = 0
        self.pardiso: Pardiso | None = None
        # arguments of the compiled loop
        self.tables: PardisoTables | None = None
        self._superlu: SuperLU | None = None
        self._why = ""
        if pattern.plan is not None or backend == "superlu":
            return
        mkl = mkl_for(backend)
        if mkl is None:
            self._why = "MKL not found"
            return
        indptr = np.searchsorted(pattern.rows, np.arange(pattern.n + 1))
        self.pardiso = Pardiso(mkl, indptr, pattern.columns, columns, size, threads, reproducible, symmetric)
        self.tables = self.pardiso.tables

    def threads(self) -> AbstractContextManager[None]:
        """Return the context in which the compiled loop has to run."""
        return nullcontext() if self.pardiso is None else self.pardiso.threads()

    def begin_step(self) -> None:
        """Discard factors of earlier steps."""
        if self.pardiso is not None:
            kernels.begin_step(self.pardiso.tables)

    @property
    def is_compiled(self) -> bool:
        """True if the time loop runs in compiled code."""
        return self.pattern.plan is not None or self.pardiso is not None

    @property
    def superlu(self) -> SuperLU:
        """Fallback solver, made when first needed."""
        if self._superlu is None:
            self._superlu = SuperLU(self.pattern.rows, self.pattern.columns, self.pattern.n, self.size)
        return self._superlu

    @property
    def name(self) -> str:
        """Name of the solver that was used and number of its fallbacks, for the result."""
        fell = f"{self.fallbacks} steps fell back to SuperLU"
        if self.pattern.plan is not None:
            return f"block elimination, {fell}"
        if self.pardiso is not None:
            t = self.pardiso.tables
            kind = " (symmetric)" if t.numbers[2] == kernels.SYMMETRIC else " (two halves)" if self.pardiso.halves else ""
            return (f"PARDISO{kind}, {t.counts[0]} factorisations, used again {t.counts[2]} times, {t.counts[1]} refined, "
                    f"largest relative residual {t.worst[0]:.1e}, {fell}")
        return "SuperLU" + (f" ({self._why})" if self._why else "")
