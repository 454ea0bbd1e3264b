"""Two halves of the matrix of a large net: each half has a PARDISO on a thread of its own, the nodes between them a dense matrix.

One cut of nested dissection (A. George, SIAM J. Numer. Anal. 10 (1973) 345-363). PARDISO's own threads, if they are to give the
same bits on any number of them, do not make its solutions faster; two halves are two tasks, and the same two on one thread.
"""
from __future__ import annotations

from collections.abc import Callable, Sequence
from ctypes import c_void_p
from typing import Any

import numpy as np

from fastbeam.interface.lazy_import import sparse
from fastbeam.kernels.empty_arrays import empty
from fastbeam.kernels.linalg import pardiso as kernels
from fastbeam.kernels.linalg.pardiso import PardisoTables
from fastbeam.linalg.factors import PardisoMemory
from fastbeam.linalg.mkl import OnThreads, pardiso_tables

Array = np.ndarray
Each = Callable[[Callable[[int, Any], Any], Sequence[Any]], Any]
# most nodes between the halves: a number, and a share of all
MOST_BETWEEN, SHARE_BETWEEN = 1000, 0.125


def cut(indptr: Array, indices: Array) -> tuple[Array, Array, Array] | None:
    """Return nodes of two halves of a symmetric structure that no block couples, and those between them; None if these are many.

    Levels of the breadth-first search behind the Cuthill-McKee order are narrow, whatever the geometry of the net."""
    n = indptr.size - 1
    graph = sparse.csr_matrix((np.ones(indices.size, np.int8), indices, indptr), shape=(n, n))
    place = np.empty(n, np.int64)
    place[sparse.csgraph.reverse_cuthill_mckee(graph, symmetric_mode=True)] = np.arange(n)
    rows = np.repeat(np.arange(n), np.diff(indptr))
    across = (place[rows] < n // 2) & (place[indices] >= n // 2)
    # the first half keeps its nodes, the other loses its neighbours of the first; at least one, if the net is not connected
    between = np.unique(indices[across]) if across.any() else np.flatnonzero(place == n // 2)
    if between.size > min(MOST_BETWEEN, SHARE_BETWEEN * n):
        return None
    outside = np.ones(n, bool)
    outside[between] = False
    return np.flatnonzero(outside & (place < n // 2)), np.flatnonzero(outside & (place >= n // 2)), between


def unknowns(nodes: Array, size: int) -> Array:
    """Return the unknowns of nodes with `size` each, in turn."""
    return (size * nodes[:, None] + np.arange(size)).reshape(-1)


class Half:
    """One half, then the nodes between: blocks among these come with half their values, so that both Schur complements add up.

    nodes, between: int64 [n], [m].
    indptr, indices: int [N + 1], [blocks], structure of the whole matrix, by blocks.
    columns, size: right-hand sides; unknowns of a block.
    Raises ArithmeticError: the analysis fails.
    """

    def __init__(self, mkl: Any, nodes: Array, between: Array, indptr: Array, indices: Array, columns: int, size: int) -> None:
        self.own = size * nodes.size
        mine = np.concatenate((nodes, between))
        place = np.full(indptr.size - 1, -1)
        place[mine] = np.arange(mine.size)
        rows = np.repeat(np.arange(indptr.size - 1), np.diff(indptr))
        block = np.flatnonzero((place[rows] >= 0) & (place[indices] >= 0))
        block = block[np.lexsort((place[indices[block]], place[rows[block]]))]
        row, column = place[rows[block]], place[indices[block]]
        # PARDISO takes no blocks with a Schur complement; all rows of a block have its columns
        number = size * np.bincount(row, minlength=mine.size)
        first, number = np.repeat(np.cumsum(number) - number, size), np.repeat(number, size)
        start = np.concatenate(([0], np.cumsum(number))).astype(np.int32)
        entry = np.arange(start[-1], dtype=np.int32) + np.repeat((first - start[:-1]).astype(np.int32), number)
        self.rows, self.between = unknowns(nodes, size), unknowns(between, size)
        tables = pardiso_tables(start, unknowns(column, size)[entry], kernels.UNSYMMETRIC, {35: 2}, columns)
        self.tables = tables._replace(block=block, mirror=block)
        # rows of the Schur complement
        self.tables.perm[self.own:] = 1
        self.schur = empty((size * between.size,) * 2)
        self._memory = PardisoMemory(mkl, self.tables, 1)
        if self._call(kernels.ANALYSE, self.schur):
            raise ArithmeticError(f"PARDISO error {self.tables.numbers[7]} in the analysis of a half")

    def _call(self, phase: int, out: Array) -> int:
        return self._memory.call(phase, self.tables.b, out)

    def factor(self, data: Array, size: Any) -> int:
        """Form factors and Schur complement from the blocks of the whole matrix; return PARDISO's error code."""
        kernels.take_half(self.tables, data, self.own, size)
        return self._call(kernels.FACTOR, self.schur)

    def forward(self, r: Array) -> int:
        """Substitute forward for right-hand sides of the whole matrix; those between the halves count half."""
        self.tables.b[:, :self.own] = r[:, self.rows]
        self.tables.b[:, self.own:] = 0.5 * r[:, self.between]
        return self._call(kernels.FORWARD, self.tables.x)

    def backward(self, z: Array, y: Array) -> int:
        """Substitute backward from the solution between the halves, into its rows of y."""
        self.tables.b[:] = self.tables.x
        self.tables.b[:, self.own:] = z
        code = self._call(kernels.BACKWARD, self.tables.x)
        y[:, self.rows] = self.tables.x[:, :self.own]
        return code


class Halves:
    """Matrix structure cut in two, analysed once.

    tables: of the whole matrix; its handle is not used.
    size: unknowns of a block.
    Raises ArithmeticError: an analysis fails.
    """

    def __init__(self, mkl: Any, parts: tuple[Array, Array, Array], tables: PardisoTables, size: int) -> None:
        self._mkl, self.tables = mkl, tables
        *halves, between = parts
        self.halves = [Half(mkl, nodes, between, tables.indptr, tables.indices, tables.b.shape[0], size) for nodes in halves]
        # both Schur complements are added up, and factored, in the place of the first
        self._dense = self.halves[0].schur
        n = len(self._dense)
        self._pivots, self._lapack = np.zeros(n, np.int32), np.array([n, tables.b.shape[0], 0], np.int32)
        self._n, self._m, self._info = (self._lapack.ctypes.data + 4 * k for k in range(3))

    @property
    def factor_bytes(self) -> int:
        """Size of the factors in bytes, with those of the dense matrix."""
        return self._dense.nbytes + 1024 * sum(int(half.tables.iparm[16]) for half in self.halves)

    @property
    def arrays(self) -> list[Array]:
        """Arrays that the halves keep besides."""
        return [*(x for half in self.halves for x in (*half.tables, half.rows)), self.halves[1].schur]

    def solve(self, blocks: Array, panel: Array, width: int, size: Any, each: Each) -> bool:
        """Solve like `kernels.sparse.solve_sparse`, the halves by `each` (as `condensed.Team.each`)."""
        t = self.tables
        phase = kernels.load_system(t, blocks, panel, width, size)
        while phase > kernels.DONE:
            code = self._factor(size, each) if phase == kernels.FACTOR else self._correct(each)
            phase = kernels.go_on(t, phase, code, size)
        if phase == kernels.FAILED:
            return False
        kernels.store_solution(t, panel, width)
        return True

    def _factor(self, size: Any, each: Each) -> int:
        codes = each(lambda _, half: half.factor(self.tables.data, size), self.halves)
        if any(codes):
            return 1
        self._dense += self.halves[1].schur
        self._call("dgetrf", self._n, self._n, self._dense.ctypes.data, self._n, self._pivots.ctypes.data, self._info)
        return int(self._lapack[2])

    def _correct(self, each: Each) -> int:
        """Solve y = K^-1 r."""
        r, y = self.tables.r, self.tables.y
        codes = each(lambda _, half: half.forward(r), self.halves)
        first, second = (half.tables.x[:, half.own:] for half in self.halves)
        z = first + second
        # rows of C are columns of Fortran
        self._call("dgetrs", b"T", self._n, self._m, self._dense.ctypes.data, self._n, self._pivots.ctypes.data, z.ctypes.data,
                   self._n, self._info)
        codes += [self._lapack[2], *each(lambda _, half: half.backward(z, y), self.halves)]
        y[:, self.halves[0].between] = z
        return int(any(codes))

    def _call(self, name: str, *pointers: Any) -> None:
        with OnThreads(self._mkl, 1):
            getattr(self._mkl, name)(*(x if isinstance(x, bytes) else c_void_p(x) for x in pointers))
