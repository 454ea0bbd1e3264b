"""Derivatives of critical loads by parameters: of limit points, and of bifurcations that stay ones (theory.md (13.7), (13.8))."""
from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from fastbeam.dynamics.options import START
from fastbeam.gradients.equilibria import family_of
from fastbeam.gradients.parameters import CHANGES, SHARE, SIXTH, Build, Family, which_build
from fastbeam.interface.arguments import Names, Number, Word, checked
from fastbeam.interface.errors import ConvergenceError, SceneError
from fastbeam.kernels.state import State
from fastbeam.linalg.saddle import Saddle
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.forces.loads import load_factors_at
from fastbeam.model.maps import spins
from fastbeam.model.model import Model
from fastbeam.model.start import check_start
from fastbeam.statics.linear_response import OutOfPlane, Response, at_shape
from fastbeam.statics.static_analysis import which_sliders

Array = np.ndarray
# a state whose tangent has no eigenvector this near to zero, or whose nodes would move by this much, is no critical point
CRITICAL, AT_REST = 1e-6, 1e-7
# share of the load, or of a parameter, in the critical direction up to which it is round-off
ACROSS = 1e-6
ASYMMETRIC = 1e-4
# round-off of x . K x, next to |x| . |K| |x|
NOISE = 8.0 * np.finfo(float).eps


class CriticalSlopes(NamedTuple):
    """A critical load and its derivatives.

    Attributes
    ----------
    kind : str
        'limit' or 'bifurcation'.
    load_factor : float
    by : dict of str to float
        Derivatives by every parameter, per unit; NaN of an imperfection, which turns a bifurcation into a limit point or none.
    displacements, spins : float64 [N, 3]
        The critical direction, its largest displacement 1 m, or where nothing moves its largest spin 1 rad.
    """

    kind: str
    load_factor: float
    by: dict[str, float]
    displacements: Array
    spins: Array


class _NotCritical(Exception):
    """Error: the tangent is not singular there, or the state is no equilibrium."""


class _Critical:
    """Critical point: the tangent K, its null vectors of both sides, the loads."""

    def __init__(self, base: Response, plus: Response, backend: str) -> None:
        self.base = base
        saddle, right = base.linearised()
        self.loads = plus.unbalanced() - right
        self.matrix, self.multiplier = saddle.matrix, saddle.multiplier
        # free motions are no part of the critical direction
        base.hold_free(lambda: self.matrix)
        self.free = base.weights[:, None] * base.free_motions.motions(right.size)
        start = np.random.default_rng(0).standard_normal(right.size)
        start[base.nodes:] *= 0.0
        # rows of what is held are in no unit
        start[:base.nodes] *= base.map.free
        self.scale = saddle.typical(self.matrix)
        self.null = self.left = start / np.sqrt(np.where(base.weights > 0.0, base.weights, 1.0))
        self._whole: tuple[Saddle, Array, Array] | None = None
        for _ in range(4):
            null, left = self._ends(False), self._ends(True)
            self._whole, self.null, self.left = None, null / base.size_of(null), left / base.size_of(left)
        move = self.solved(right)
        value, noise = self._eigenvalue()
        if not abs(value) <= CRITICAL * self._next(start) + noise or not base.size_of(move) <= AT_REST:
            raise _NotCritical
        self.is_limit = self.across(self.loads) > ACROSS
        skew, size = (self.scale * (abs(x) @ self.scale) for x in (self.matrix - self.matrix.T, self.matrix))
        self.is_symmetric = bool(np.max(skew) <= 1e-7 * np.max(size))

    def across(self, right: Array, noise: float = 0.0) -> float:
        """Return the share of a right-hand side that pushes along the critical direction; 0 where that is round-off, `noise`
        times the round-off of forces."""
        push = abs(float(self.left @ right))
        if push <= noise * float(np.abs(self.left) @ self.base.noise()):
            return 0.0
        size = float(np.linalg.norm(self.left / self.scale) * np.linalg.norm(self.scale * right))
        return push / max(size, 1e-300)

    def _bordered(self) -> tuple[Saddle, Array, Array]:
        """Scale [K, W left, W free; (W null)^T, 0, 0; (W free)^T, 0, 0], W the metric of (12.1); also returned are the factors of
        its rows and columns."""
        from scipy import sparse
        if self._whole is not None:
            return self._whole
        borders = [np.column_stack((self.base.weights * x, self.free)) for x in (self.left, self.null)]
        column, row = (sparse.csr_matrix(x) for x in borders)
        matrix = sparse.bmat([[self.matrix, column], [row.T, None]], format="csr")
        # scaling makes the test of singularity independent of units
        of_row, of_column = (np.append(self.scale, 1.0 / np.max(self.scale[:, None] * np.abs(x), axis=0)) for x in borders[::-1])
        matrix = sparse.diags(of_row) @ matrix @ sparse.diags(of_column)
        self._whole = Saddle(matrix, np.append(self.multiplier, np.ones(column.shape[1], bool))), of_row, of_column
        return self._whole

    def _solve(self, right: Array, last: float, transposed: bool) -> tuple[Array, float]:
        """Solve the bordered equations, or the transposed ones. Raises ConvergenceError: there is more than one null vector."""
        saddle, *factors = self._bordered()
        of_row, of_column = factors[::-1] if transposed else factors
        more = of_row.size - right.size
        x = saddle.solve(of_row * np.concatenate((right, [last], np.zeros(more - 1))), transposed)
        if x is None or saddle.is_singular:
            raise ConvergenceError("critical_sensitivity: the tangent is singular in several directions at once; the load of "
                                   "such a multiple critical point has no derivative", state=self.base.state)
        x = of_column * x
        return x[:-more], float(x[-more])

    def _eigenvalue(self) -> tuple[float, float]:
        """Return the eigenvalue of the critical direction, in the metric of (12.1), and the round-off that a zero may have from
        the stiffness."""
        value, sizes = self.left @ (self.matrix @ self.null), np.abs(self.left) @ (abs(self.matrix) @ np.abs(self.null))
        mass = float(self.left @ (self.base.weights * self.null))
        return float(value) / mass, NOISE * float(sizes) / abs(mass)

    def _next(self, start: Array) -> float:
        """Estimate the smallest of the other eigenvalues by inverse iteration."""
        x, size = start, 1.0
        for _ in range(3):
            x = self.solved(self.base.weights * x)
            size = float(np.sqrt(np.sum(self.base.weights * x**2)))
            x = x / size
        return 1.0 / size

    def _ends(self, transposed: bool) -> Array:
        return self._solve(np.zeros(self.multiplier.size), 1.0, transposed)[0]

    def solved(self, right: Array) -> Array:
        """Return the solution x of K x = right, without parts of both along the critical direction."""
        return self._solve(right, 0.0, False)[0]

    def curvature(self, at: Response) -> float:
        """Return phi . K phi with the tangent of another shape."""
        return float(self.null @ (at.linearised()[0].matrix @ self.null))


@checked(build=which_build, values=Names("must map names of parameters to numbers"), state=START, load_factor=Number(),
         scale=Names("must map names of parameters to sizes"), at_time=Number(unit="s"), held=which_sliders, backend=Word())
def critical_sensitivity(build: Build, values: Mapping[str, float], *, state: State, load_factor: float,
                         scale: Mapping[str, float] | None = None, at_time: float | None = None,
                         held: bool | str | Sequence[str] = False, backend: str = "auto") -> CriticalSlopes:
    """Differentiate the load factor of a limit point or a bifurcation (a buckling load) by parameters (theory.md 13).

    Parameters
    ----------
    build, values, scale, at_time, held, backend
        As in `sensitivity`.
    state : State
        The critical point, `solve_path(model, stop_at=...).state`.
    load_factor : float
        Its load factor, `path.series["load_factor"][-1]`.

    Returns
    -------
    CriticalSlopes
        `.by[name]`: change of the critical load factor; NaN where a parameter is an imperfection of a bifurcation.

    Raises
    ------
    SceneError
        As `sensitivity`; the state is no critical point; a bifurcation of a tangent that is not symmetric, or where branches
        cross obliquely.
    ConvergenceError
        Several directions become unstable at once.
    """
    family, stays = family_of("critical_sensitivity", build, values, scale, held, backend)
    model = family.model
    state, _ = check_start(model, state, 1.0, at_rest=True)
    if at_time is None:
        require(Analysis.TIMELESS_SHAPES, model, "critical_sensitivity", stays)

    def factors(of: Model, factor: float = load_factor) -> Array:
        return factor * load_factors_at("critical_sensitivity", of, at_time)

    flat = model.plane is not None and bool(model.plane.holds(state))
    for plane in ((True, False) if flat else (False,)):
        own = family.base(plane).model
        base, plus = (Response(own, state, stays, plane, backend, at_time or 0.0, factors(own, x), x)
                      for x in (load_factor, load_factor + 1.0))
        try:
            # what is regular in a plane may buckle out of it
            return _slopes(_Critical(base, plus, backend), family, factors, load_factor)
        except (OutOfPlane, _NotCritical):
            continue
    raise SceneError("critical_sensitivity: the state is not a critical point at this load_factor; find it with path = "
                     "fb.solve_path(model, stop_at='limit' or 'bifurcation') and give state=path.state, "
                     "load_factor=path.series['load_factor'][-1]. A limit point at a kink of a force law, where a stop or a rope "
                     "loses contact, has no critical direction")


def _slopes(point: _Critical, family: Family, factors: Callable[..., Array], load_factor: float) -> CriticalSlopes:
    base = point.base
    flat = base.stepper.plane is not None
    none = np.zeros(base.unknowns)
    own = base.stepper.model

    def around(name: str, way: Array) -> list[Response]:
        return [at_shape(base, x.model, factors(x.model), way, k * family.steps[name])
                for k, x in zip(CHANGES, family.around(name, flat))]

    by_load = 0.0
    if not point.is_limit:
        by_load = _by_load(point, own, factors, load_factor)
    by = {}
    for name in family.values:
        change = family.slope(name, [x.unbalanced() for x in around(name, none)])
        if point.is_limit:
            by[name] = -float(point.left @ change) / float(point.left @ point.loads)
            continue
        if point.across(change, 1.0 / family.steps[name]) > ACROSS:
            by[name] = np.nan
            continue
        direction = point.solved(change)
        by[name] = -float(family.slope(name, [point.curvature(x) for x in around(name, direction)])) / by_load
    q, mode = base.own_rates(point.null)
    turns = spins(q, mode)
    largest = float(np.max(np.linalg.norm(mode[:, 0], axis=1))) or float(np.max(np.linalg.norm(turns, axis=1)))
    return CriticalSlopes("limit" if point.is_limit else "bifurcation", load_factor, by, mode[:, 0] / largest, turns / largest)


def _by_load(point: _Critical, own: Model, factors: Callable[..., Array], load_factor: float) -> float:
    """Return the derivative of phi . K phi by the load factor along the path.

    Raises SceneError: the tangent is not symmetric, or branches cross obliquely.
    """
    base = point.base
    if not point.is_symmetric:
        raise SceneError("critical_sensitivity: derivatives at a bifurcation need a symmetric tangent, but moments or moving air "
                         "make it unsymmetric; compile with planar=True, or use solve_path at two values")
    step = SHARE * (abs(load_factor) or 1.0)

    def along(way: Array, size: float, loads: bool) -> float:
        found = []
        for k in CHANGES:
            factor = load_factor + k * size * loads
            found.append(point.curvature(at_shape(base, own, factors(own, factor), way, k * size, factor)))
        return float(SIXTH @ np.array(found)) / size

    by_load = along(point.solved(point.loads), step, True)
    if abs(along(point.null, SHARE, False)) > ASYMMETRIC * abs(by_load) * (abs(load_factor) or 1.0):
        raise SceneError("critical_sensitivity: branches cross obliquely at this bifurcation, on both sides of its load. "
                         "Derivatives are not available for this type; use solve_path at two values")
    return by_load
