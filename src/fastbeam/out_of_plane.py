"""Unstable directions out of the plane in which a path of equilibria was found (theory.md 12)."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .arc_length import PathSolver
from .kernels.work import State

# rows from one look to the next, before the first one with such directions is searched for between two of them: a look takes as
# long as one to three steps of the path
EVERY = 10


class OutOfPlane:
    """Equilibria of a path in a plane, looked at in space when the path has ended.

    The tangent in space falls apart into a part within the plane and one across it, so that of the negative eigenvalues in space
    those that are not found in the plane lead out of it.

    Parameters
    ----------
    solver : PathSolver
        In the plane.
    in_space : callable
        A solver in space of the same path, from a state and its load factor.
    """

    def __init__(self, solver: PathSolver, in_space: Callable[[State, float], PathSolver]) -> None:
        self._solver, self._in_space = solver, in_space
        # of every row the equilibrium, the length of the path, and the number of unstable directions in the plane
        self._rows: list[tuple[tuple[Any, ...], float, int | None]] = []
        self._found: dict[int, int | None] = {}
        self._other: PathSolver | None = None

    def keep(self, length: float, unstable: int | None) -> None:
        """The present equilibrium of the solver, a row of the path."""
        self._rows.append((self._solver.saved(), length, unstable))

    def look(self, critical: set[int]) -> tuple[int | None, dict[str, Any] | None]:
        """Number of unstable directions out of the plane at the last row that is none of these critical ones, at which an
        eigenvalue is zero; None where it is not found. And an event where there are such directions on the way."""
        usable = [k for k, row in enumerate(self._rows) if k not in critical and row[2] is not None]
        if not usable:
            return None, None
        present = self._solver.saved()
        try:
            samples = [*range(EVERY, len(usable) - 1, EVERY), len(usable) - 1]
            among = [k for k in samples if self._count(usable[k])]
            at_end = self._count(usable[-1])
            if not among:
                return at_end, None
            first = among[0]
            stable = max((k for k in samples if k < first), default=-1)
            while first - stable > 1:
                middle = (first + stable) // 2
                first, stable = (middle, stable) if self._count(usable[middle]) else (first, middle)
            most = max(self._found[usable[k]] or 0 for k in among)
        finally:
            self._solver.restore(present)
        row, last = usable[first], usable[among[-1]]
        (*_, factor), length, _ = self._rows[row]
        where = "on" if last == usable[-1] else f"on, up to row {last} and maybe further,"
        return at_end, {
            "kind": "unstable", "time": length, "row": row, "directions": most,
            "text": f"equilibria from row {row} (load factor {factor:.6g}) {where} are unstable in up to {most} direction(s) out "
                    "of the plane of the scene, where the path stays and finds critical points; in a model of "
                    "compile_scene(scene, planar=False) it finds those that lead out of it, too"}

    def _count(self, row: int) -> int | None:
        """Number of unstable directions out of the plane at a row; None where moments leave it undecided."""
        if row not in self._found:
            saved, _, in_plane = self._rows[row]
            self._solver.restore(saved)
            state, factor = self._solver.state, self._solver.factor
            if self._other is None:
                self._other = self._in_space(state, factor)
            other = self._other
            other.restore((state.q, state.s, state.force, factor))
            found = other.equations()[0].signs(other.has_potential(False))
            assert in_plane is not None
            # without a potential an odd number of negative eigenvalues counts as one
            known = found is not None and (in_plane == 0 or other.has_potential(False)) and found[0] >= in_plane
            self._found[row] = found[0] - in_plane if found is not None and known else None
        return self._found[row]
