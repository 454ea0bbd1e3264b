"""Critical points within a step along a path of equilibria: the first of them, where it is, and of which type (theory.md 12)."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from fastbeam.statics.arc_length import Direction, PathSolver, root

Array = np.ndarray
# zeros within this share of the step belong to one point; eigenvalues beside a limit point are counted at these shares from it,
# nearer where other directions change as well
TOGETHER, NEARBY = 1e-6, (1e-3, 1e-4, 1e-5, 1e-6)
# cosine of two directions that are the same
PARALLEL = 0.99
# where Newton's matrix is singular at a zero: distance of the samples beside it that are interpolated, as a share of the
# step, from the first to the largest that is tried, and how many there are on either side
CLOSEST, WIDEST, SAMPLES = 1e-4, 0.05, 3
# part of a step within which eigenvalues of tangents without symmetry change their signs together
SHORTEST = 1e-3
# residual along vectors that vanish, as a multiple of that of the samples, beyond which two paths pass each other
LEFT = 30.0
# share of the step to which bisection locates a critical point; change of the coordinates there, as a share of that in the step,
# beyond which the solver has passed to another path
LOCATED, PASSED = 1e-8, 1e-4
# step off a bifurcation by which its type is told, as a share of the first step of a path; changes of the load factor below this
# are none; increment of the unknowns by which a mode is told
ASIDE, NO_CHANGE, SHORT = 0.2, 1e-13, 1e-6


class CriticalPoint(NamedTuple):
    """First critical point within a step."""

    kind: str                # 'limit' or 'bifurcation'
    size: float              # part of the step that leads there
    number: int              # of the eigenvalue that vanishes, counted from 0
    unstable: int | None     # negative eigenvalues behind it


# part of a step that leads to a zero, number of the eigenvalue, and what the solver has saved there
Found = tuple[float, int, tuple[Any, ...]]


class PathStep:
    """Step along a path, of which parts can be taken.

    Parameters
    ----------
    solver : PathSolver
        Solver at the end of the step. Eigenvalues are those of its judge.
    before : tuple
        State of the solver saved at the beginning of the step.
    along : Direction
    size : float
    """

    def __init__(self, solver: PathSolver, before: tuple[Any, ...], along: Direction, size: float) -> None:
        self.solver, self.before, self.along, self.size = solver, before, along, size
        self.end = solver.saved()
        # whether a change within the step was not located
        self.is_lost = False

    def zero(self, f: Callable[[], float], first: float, last: float, size: float | None = None,
             number: int | None = None, begin: float = 0.0) -> float | None:
        """Find the part of the step at which f vanishes, and put the solver there; first, last: f at the beginning of the
        step and at its end, or those of its parts `begin` and `size`; number: of the eigenvalue that vanishes there, too. None,
        with the solver at the end of the step, where it is not found."""
        size = self.size if size is None else size
        failed: list[float] = []

        def at(x: float) -> float:
            self.solver.restore(self.before)
            value = f() if self.solver.go(self.along, x) else np.nan
            if not np.isfinite(value):
                failed.append(x)
            return value

        if not first * last < 0.0:
            return None
        x = root(at, begin, first, size, last, *([] if number is None else [CLOSEST * self.size]))
        if number is not None:
            x = self._between_samples(f, at, failed[-1] if x is None else x, number)
        elif x is not None and not (begin < x < size and np.isfinite(at(x))):
            x = None
        if x is None:
            self.solver.restore(self.end)
        return x

    def _between_samples(self, f: Callable[[], float], at: Callable[[float], float], near: float, number: int) -> float | None:
        """Find the zero of f near the part `near` of the step by interpolation between equilibria on both sides; None where it is
        not found. At a bifurcation Newton's matrix is singular: next to it round-off moves the solver along the vector that
        vanishes, and Newton's method may fail."""
        places = np.array([*range(-SAMPLES, 0), *range(1, SAMPLES + 1)], float)
        width = CLOSEST * self.size
        while width <= WIDEST * self.size:
            values, states, left = [], [], []
            for place in places:
                values.append(at(near + width * place))
                if not np.isfinite(values[-1]):
                    break
                states.append(self.solver.saved())
                left.append(self.solver.judge.equations()[1])
            if len(states) == places.size and values[0] * values[-1] < 0.0:
                line = np.polynomial.Polynomial.fit(places, values, places.size - 1)
                zeros = np.array([z.real for z in line.roots() if abs(z.imag) < 1e-9 and abs(z.real) < SAMPLES])
                if zeros.size:
                    x = float(zeros[np.argmin(np.abs(zeros))])
                    weights = [np.prod([(x - b) / (a - b) for b in places if b != a]) for a in places]
                    self._restore_mean(weights, states)
                    is_one = abs(f()) <= max(np.abs(values)) and self._is_balanced(number, np.array(left))
                    return float(near + width * x) if is_one else None
            width *= 4.0
        return None

    def _is_balanced(self, number: int, samples: Array) -> bool:
        """Return whether a mean of equilibria lies on one path: its residual along the vectors that vanish with eigenvalue
        `number` is round-off, as are those of the samples [m, n]. If some samples lie on another path that passes by, the mean
        lacks the force that keeps the two from crossing."""
        judge = self.solver.judge
        vectors = judge.critical_directions(number, left=True)
        if vectors is None:
            return False
        saddle, right, _ = judge.equations()
        allowed = LEFT * np.max(np.abs(samples @ vectors), axis=0) + judge.round_off(saddle, vectors)
        return bool(np.all(np.abs(right @ vectors) <= allowed))

    def _restore_mean(self, weights: list[Any], states: list[tuple[Any, ...]]) -> None:
        """Put the solver to the mean of states with these weights."""
        q, s, force, factor = (sum(w * x for w, x in zip(weights, part)) for part in zip(*states))
        if self.solver.stepper.plane is None:
            triads = q.reshape(-1, 4, 3)[:, 1:]
            u, _, v = np.linalg.svd(triads)
            triads[:] = u @ v
        else:
            u = q.reshape(-1, 4)[:, 2:]
            u /= np.linalg.norm(u, axis=1)[:, None]
        self.solver.restore((q, s, force, float(factor)))

    # --- what is looked for -------------------------------------------------------------------------------------------
    def first(self, rates: tuple[float, float] | None, unstable: int | None, counted: int | None) -> CriticalPoint | None:
        """Find the first critical point, with the solver there; None, with the solver at the end, where there is none.

        Parameters
        ----------
        rates : (float, float), optional
            Rates of the load factor at the beginning and the end, where they differ in sign.
        unstable, counted : int, optional
            Negative eigenvalues of the tangent at the beginning and the end.
        """
        known = unstable is not None and counted is not None
        found: list[Found] = []
        limit = None
        if rates is not None:
            size = self.zero(self._rate, *rates)
            limit = None if size is None else (size, self.solver.saved())
            self.is_lost |= limit is None
        behind = counted
        if limit is not None and known:
            # a limit point changes the number, too; earlier changes are bifurcations
            size, ahead, behind = self._around(limit[0])
            # near a crossing with another path there may be no equilibrium of this one
            behind = counted if behind is None else behind
            if ahead == behind:
                # next to a limit point the number has to differ on both sides: round-off hides where it changes
                near = behind if abs((behind or 0) - (unstable or 0)) == 1 else counted
                if abs((near or 0) - (unstable or 0)) == 1:
                    ahead, behind = unstable, near
            if ahead is not None and ahead != unstable and self.to(size):
                found = self._bifurcations(unstable, ahead, size, self.solver.saved())  # type: ignore[arg-type]
        elif known and counted != unstable:
            found = self._bifurcations(unstable, counted, self.size, self.end)  # type: ignore[arg-type]
            # round-off may move the zero of a limit point into the step before it or behind it
            found = [x for x in found if not self._turns(*x)]
        best = min(found, default=None, key=lambda x: x[0])
        if limit is not None and best is None:
            self.solver.restore(limit[1])
            return CriticalPoint("limit", limit[0], min(unstable or 0, behind or 0), behind)
        if best is not None:
            here = [x for x in found if self._is_at(x[0], best[0])]
            number = min(x[1] for x in here)
            way = 1 if number >= (unstable or 0) else -1
            self.solver.restore(best[2])
            return CriticalPoint("bifurcation", best[0], number, (unstable or 0) + way * len(here))
        self.solver.restore(self.end)
        return None

    def to(self, size: float) -> bool:
        """Go so far."""
        self.solver.restore(self.before)
        return bool(self.solver.go(self.along, size))

    def _is_at(self, a: float, b: float) -> bool:
        return abs(a - b) <= TOGETHER * self.size

    def _turns(self, size: float, number: int, at: tuple[Any, ...]) -> bool:
        """Return whether the path is tangent to vectors of the eigenvalues that vanish at a saved state, at this part of the
        step, as it is at a limit point."""
        # not the direction there, which at a bifurcation is that of any path
        self.solver.restore(self.end)
        after = self.solver.direction(self.along)
        self.solver.restore(at)
        found = self.solver.judge.critical_directions(number)
        if found is None or after is None:
            return False
        vectors = self.solver.within(found)
        way, factor = (a + size / self.size * (b - a) for a, b in zip(self.along, after))
        weighed = self.solver.weight * way
        return bool(np.linalg.norm(weighed @ vectors) >= PARALLEL * np.sqrt(weighed @ way + factor**2))

    def _around(self, limit: float) -> tuple[float, int | None, int | None]:
        """Return the part of the step that ends shortly before a limit point, and the numbers of negative eigenvalues there and
        as far behind it: so near that one direction changes between, if that is possible."""
        found = []
        for near in NEARBY:
            size = limit - near * self.size
            found.append((size, self._count(size), self._count(limit + near * self.size)))
            _, ahead, behind = found[-1]
            if ahead is not None and behind is not None and abs(behind - ahead) == 1:
                return found[-1]
        return next((x for x in found if x[1] is not None and x[2] is not None), found[0])

    def _count(self, size: float) -> int | None:
        return self.solver.judge.unstable() if self.to(size) else None

    def _rate(self) -> float:
        found = self.solver.direction(self.along)
        return np.nan if found is None else found.factor

    def _bifurcations(self, unstable: int, counted: int, size: float, end: tuple[Any, ...]) -> list[Found]:
        """Find the places where eigenvalues of the tangent vanish up to this size, at whose end the solver has saved `end`."""
        if self.solver.judge.is_unsymmetric:
            return self._crossings(0.0, unstable, size, counted)
        solver, out = self.solver, []
        for k in range(min(unstable, counted), max(unstable, counted)):
            def test(k: int = k) -> float:
                return solver.judge.eigenvalue(k)

            solver.restore(end)
            last = test()
            solver.restore(self.before)
            x = self.zero(test, test(), last, size, k)
            if x is None:
                x = self._bisected(k, counted > unstable, size, end)
            if x is None:
                self.is_lost = True
            else:
                out.append((x, k, solver.saved()))
        return out

    def _bisected(self, number: int, grows: bool, size: float, end: tuple[Any, ...]) -> float | None:
        """Find by bisection where eigenvalue `number` changes its sign, from numbers of negative eigenvalues: factors tell them
        where round-off hides the eigenvalue itself. Put the solver there; None, with the solver at `end`, where a number is not
        found on the way. grows: whether the number of negative eigenvalues grows; end: state at part `size`."""
        solver, low, high, below, above = self.solver, 0.0, size, self.before, end
        while high - low > LOCATED * self.size:
            middle = 0.5 * (low + high)
            count = self._count(middle)
            if count is None:
                solver.restore(end)
                return None
            if (count > number) == grows:
                high, above = middle, solver.saved()
            else:
                low, below = middle, solver.saved()
        is_one = np.max(np.abs(above[0] - below[0])) <= PASSED * np.max(np.abs(end[0] - self.before[0]))
        solver.restore(below if is_one else end)
        return low if is_one else None

    def _crossings(self, begin: float, first: int, end: float, last: int) -> list[Found]:
        """Find vanishing eigenvalues of tangents without symmetry, between two parts of the step with these numbers of negative
        eigenvalues.

        Their eigenvalues have no order of their own, so the step is divided until one changes its sign in each part, or several
        at one place. Two real ones that meet and become complex leave the number without passing zero."""
        if first == last:
            return []
        is_short = end - begin <= SHORTEST * self.size
        if abs(last - first) == 1 or is_short:
            out = self._zeros_of(begin, end, min(first, last), abs(last - first))
            if out or is_short:
                self.is_lost |= (last - first - len(out)) % 2 != 0
                return out
        for share in (0.5, 0.4, 0.65):
            middle = begin + share * (end - begin)
            count = self._count(middle)
            if count is not None:
                return [*self._crossings(begin, first, middle, count), *self._crossings(middle, count, end, last)]
        self.is_lost = True
        return []

    def _zeros_of(self, begin: float, end: float, number: int, count: int) -> list[Found]:
        """Find zeros, between two parts of the step, of the `count` eigenvalues nearest to zero at the second, numbered from
        `number` on."""
        solver, out = self.solver, []
        vectors = solver.judge.nearest(count) if self.to(end) else np.zeros((0, 0))
        for v in vectors.T:
            def test(v: Array = v) -> float:
                return solver.judge.test_of(v)

            last = test() if self.to(end) else np.nan
            x = self.zero(test, test(), last, end, number + len(out), begin) if self.to(begin) else None
            if x is not None:
                out.append((x, number + len(out), solver.saved()))
        return out


def type_of_bifurcation(solver: PathSolver, vectors: Array, step: float, sign: float) -> str:
    """Classify the bifurcation at which the solver is, by the vectors [n, m] of the eigenvalues that vanish.

    'supercritical' and 'subcritical' pitchforks have load factors that grow and fall on both sides (sign -1: the other way round,
    on a path that goes down), a 'transcritical' one those that grow here and fall there; 'multiple' where several eigenvalues
    vanish together, 'unknown' where no step leads aside.
    """
    if vectors.shape[1] > 1:
        return "multiple"
    before, changes = solver.saved(), []
    for side in (1.0, -1.0):
        solver.restore(before)
        if not solver.go(Direction(side * vectors[:, 0], 0.0), ASIDE * step):
            break
        changes.append(sign * (solver.factor - before[3]))
    solver.restore(before)
    if len(changes) < 2 or max(map(abs, changes)) <= NO_CHANGE:
        return "unknown"
    if changes[0] * changes[1] < 0.0:
        return "transcritical"
    return "supercritical" if sum(changes) > 0.0 else "subcritical"


def mode_of(solver: PathSolver, vector: Array) -> tuple[Array, Array] | None:
    """Return displacements of all nodes [N, 3] and of sliders [S] by a vector [n], the largest of them 1; None where nothing
    moves."""
    before, places = solver.saved(), []
    for sign in (1.0, -1.0):
        solver.restore(before)
        x = sign * SHORT * vector
        x[solver.places.stop:] = 0.0
        solver.move(x)
        state = solver.state
        places.append((state.q.reshape(-1, 4, 3)[:, 0].copy(), state.s.copy()))
    solver.restore(before)
    moves, slides = ((a - b) / (2.0 * SHORT) for a, b in zip(*places))
    size = max(float(np.max(np.linalg.norm(moves, axis=1), initial=0.0)), float(np.max(np.abs(slides), initial=0.0)))
    return (moves / size, slides / size) if size > 0.0 else None
