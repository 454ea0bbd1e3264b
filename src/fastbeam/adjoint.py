"""Runs with gradients: the discrete adjoint of conserving steps (theory.md (13.9) to (13.11))."""
from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .arguments import Anything, Count, Names, Number, Word, checked, numbers, shown
from .dynamics import failure
from .errors import ConvergenceError, SceneError
from .kernels import step as kernels
from .kernels.spring import Springs
from .kernels.step import OK
from .kernels.work import State
from .linsolve import SMALL, check_backend, load_mkl
from .load_times import load_factors, mean_factors
from .maps import mass_map, tie_map
from .model import Model, check_model
from .newton import Stepper
from .observe import POINTS, Observer
from .saddle import Factors
from .scene.checks import Place
from .starting import check_start
from .statics import START
from .step_gradient import SectionSums

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Array = np.ndarray
# bytes that the steps of a run may take
MOST = 4e9
# relative residual of a solution with the transposed tangent
GOOD = 1e-13


class RunSectionGradient(NamedTuple):
    """Derivatives by what the section of every beam of a part says, as `SectionGradient`, [beams] each.

    Attributes
    ----------
    stiffness : float64 [beams, 6, 6]
        By C.
    rhoA, rhoI2, rhoI3 : float64 [beams]
    """

    stiffness: Array
    rhoA: Array  # noqa: N815  the field's symbols
    rhoI2: Array  # noqa: N815
    rhoI3: Array  # noqa: N815

    def by(self, stiffness: ArrayLike, rhoA: ArrayLike = 0.0, rhoI2: ArrayLike = 0.0,  # noqa: N803
           rhoI3: ArrayLike = 0.0) -> Array:  # noqa: N803
        """Derivatives by a parameter [beams], from its derivatives of C (6, 6), or one of every beam, and of the inertias."""
        return (np.sum(self.stiffness * np.asarray(stiffness), axis=(1, 2)) + self.rhoA * np.asarray(rhoA)
                + self.rhoI2 * np.asarray(rhoI2) + self.rhoI3 * np.asarray(rhoI3))


class RunGradient(NamedTuple):
    """Derivatives of one number of a run.

    Attributes
    ----------
    sections : dict of str to RunSectionGradient
        By the sections of all beams and of the beams of all nets.
    masses : dict of str to float
        By the masses of bodies and point masses, per kg.
    forces, moments : float64 [N, 3]
        By dead forces and moments that act on a node from the start to the end.
    velocities, spins : float64 [N, 3]
        By the initial velocity and spin of a node, those of its row where several share one, 0 where it follows others.
    """

    sections: dict[str, RunSectionGradient]
    masses: dict[str, float]
    forces: Array
    moments: Array
    velocities: Array
    spins: Array


class AdjointRun:
    """A run that remembers all its steps; made by `adjoint_run`.

    Attributes
    ----------
    t : float64 [n + 1]
        s.
    model : Model
    state : State
        The last one.
    """

    def __init__(self, model: Model, stepper: Stepper, points: Mapping[str, Place], t: float, h: float, n: int) -> None:
        self.model, self._stepper, self._h = model, stepper, h
        self.t = t + h * np.arange(n + 1)
        self._points = Observer(model, (), points).points
        size = stepper.core_state.q.size
        self._q, self._v = np.empty((n + 1, size)), np.empty((n + 1, size))
        self._moves = np.empty((n, 2, size // 4))
        for k in range(n + 1):
            self._q[k], self._v[k] = stepper.core_state.q, stepper.core_state.v
            if k == n:
                break
            outcome = stepper.advance(t, h, 1, k)
            if outcome.status != OK:
                raise failure(stepper, outcome, float(self.t[k]), k)
            self._moves[k] = stepper.work.dphi[:size // 4], stepper.work.theta[:size // 4]
        self.state = stepper.copy_state()

    def _read(self, name: str, of: Array) -> Array:
        if name not in self._points:
            there = ", ".join(map(repr, self._points)) or "none"
            raise SceneError(f"adjoint_run: there is no point {shown(name)}; there are {there}")
        nodes, weights = self._points[name]
        return np.einsum("ma,tmac->tc", weights, of.reshape(len(of), -1, 4, 3)[:, nodes])

    @checked(name=Word())
    def point(self, name: str) -> Array:
        """Path of an observed point [n + 1, 3], m.

        Raises
        ------
        SceneError
            There is no such point.
        """
        return self._read(name, self._q)

    @checked(name=Word())
    def velocity(self, name: str) -> Array:
        """Velocity of an observed point [n + 1, 3], m/s.

        Raises
        ------
        SceneError
            There is no such point.
        """
        return self._read(name, self._v)

    @checked(points=Names("must map names of points to weights (3,) or (n + 1, 3)"),
             velocities=Names("must map names of points to weights (3,) or (n + 1, 3)"))
    def gradient(self, *, points: Mapping[str, ArrayLike] | None = None,
                 velocities: Mapping[str, ArrayLike] | None = None) -> RunGradient:
        """Derivatives of a weighed sum of positions and velocities of points, backward through all steps once.

        Parameters
        ----------
        points, velocities : mapping of str to (3,) or (n + 1, 3)
            Weights: of the last row, or of all rows. Of a function of the run: its derivatives by them.

        Raises
        ------
        SceneError
            No weights, or a point that was not observed.
        ConvergenceError
            The tangent of a step is singular.
        """
        if not points and not velocities:
            raise SceneError("gradient: needs weights of what it is the gradient of, as in gradient(points={'tip': (0, 0, 1)})")
        return _Backward(self, self._weights(points or {}), self._weights(velocities or {})).gradient()

    def _weights(self, given: Mapping[str, ArrayLike]) -> list[tuple[Array, Array, Array]]:
        """(nodes, weights of their coordinates, weights of rows [n + 1, 3])."""
        out = []
        for name, value in given.items():
            if name not in self._points:
                there = ", ".join(map(repr, self._points)) or "none"
                raise SceneError(f"gradient: there is no point {name!r}; there are {there}")
            found = numbers(value)
            if found is None or found.shape not in ((3,), (self.t.size, 3)) or not np.isfinite(found).all():
                raise SceneError(f"gradient, point {name!r}: needs weights (3,) of the last row, or ({self.t.size}, 3) of all, "
                                 f"got {shown(value)}")
            rows = np.zeros((self.t.size, 3))
            rows[(slice(None) if found.ndim == 2 else -1)] = found
            out.append((*self._points[name], rows))
        return out


class _Backward:
    """The adjoint recursion."""

    def __init__(self, run: AdjointRun, of_points: list[Any], of_velocities: list[Any]) -> None:
        from scipy import sparse
        self.run, self.of_points, self.of_velocities = run, of_points, of_velocities
        self.stepper = stepper = run._stepper
        self.model = model = stepper.core
        n, rows = model.n_nodes, model.pattern.n
        free = np.ones((rows, 6))
        if model.held is not None:
            free[model.held.row] *= 1 - (model.held.mask[:, None] >> np.arange(6) & 1)
        pick = sparse.csr_matrix((np.ones(n), (np.arange(n), model.pattern.row_of)), shape=(n, rows))
        self.rows = (sparse.kron(pick, sparse.eye(6)) @ sparse.diags(free.reshape(-1))).tocsr()
        self.rows_back, self.ties, self.mass = self.rows.T.tocsr(), tie_map(model), mass_map(model)
        self.ties_back = self.ties.T.tocsr()
        self.sums = SectionSums(model)
        self.masses = np.zeros(0 if model.bodies is None else model.bodies.node.size)
        self.mkl = load_mkl()
        # the structure of tangents by columns, and where their entries stand in the blocks
        size = model.pattern.keys.size
        numbered = stepper.linear.superlu.matrix(np.arange(1.0, 48.0 * size + 1.0).reshape(-1, 6, 8))
        self.place = numbered.data.astype(np.int64) - 1
        self.structure = numbered.indices, numbered.indptr
        self.factors: Factors | None = None
        self.terms, self.system = stepper.terms, stepper.system

    # --- maps -----------------------------------------------------------------------------------------------------------
    def lift(self, q: Array, x: Array) -> Array:
        """Unknowns of the rows -> rates of all coordinates [N, 4, 3] at q [N, 4, 3]."""
        of_node = (self.rows @ x).reshape(-1, 6)
        out = np.empty_like(q)
        out[:, 0] = of_node[:, :3]
        out[:, 1:] = _cross(of_node[:, None, 3:], q[:, 1:])
        return np.asarray(self.ties @ out.reshape(-1)).reshape(q.shape)

    def lower(self, q: Array, y: Array) -> Array:
        """The transpose: forces on the coordinates [12 N] -> on the unknowns of the rows."""
        own = (self.ties_back @ y.reshape(-1)).reshape(q.shape)
        forces = np.concatenate((own[:, 0], _cross(q[:, 1:], own[:, 1:]).sum(axis=1)), axis=1)
        return np.asarray(self.rows_back @ forces.reshape(-1))

    def tangent(self, q: Array, v: Array, moves: Array) -> Any:
        """Derivative of the equations of a step from q, v by increments `moves` by the unknowns at its end."""
        state, work = self.stepper.core_state, self.stepper.work
        state.q[:], state.v[:] = q, v
        work.dphi[:moves.shape[1]], work.theta[:moves.shape[1]] = moves
        work.increment.control[0] = 0.0
        kernels.assemble_all(self.terms, self.system, self.run._h)
        from scipy import sparse
        n = self.structure[1].size - 1
        return sparse.csc_matrix((work.blocks[self.place], *self.structure), shape=(n, n))

    def solve(self, matrix: Any, right: Array, k: int) -> Array:
        """Of the transposed matrix.

        Raises
        ------
        ConvergenceError
        """
        back = matrix.T
        solved: Any = None
        if self.mkl is not None:
            if self.factors is None:
                threads = 1 if right.size < SMALL else self.mkl.MKL_Get_Max_Threads()
                self.factors = Factors(self.mkl, threads=threads)
            if self.factors.factor(back.tocsr()):
                solved = self.factors.solve
        if solved is None:
            from scipy.sparse.linalg import splu
            try:
                lu = splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
            except RuntimeError:
                lu = splu(matrix)

            solved = partial(lu.solve, trans="T")
        x = solved(right)
        size = float(np.linalg.norm(right)) or 1.0
        for _ in range(2):
            rest = right - back @ x
            if np.linalg.norm(rest) <= GOOD * size:
                break
            x = x + solved(rest)
        if not np.isfinite(x).all():
            raise ConvergenceError(f"gradient: the tangent of step {k} is singular", step=k, time=float(self.run.t[k]),
                                   state=self.run.state)
        return x

    def weights(self, which: list[Any], k: int) -> Array:
        """Derivatives of the number by the coordinates, or their rates, of row k, [N, 4, 3]."""
        out = np.zeros((self.model.n_nodes, 4, 3))
        for nodes, weights, rows in which:
            np.add.at(out, nodes, weights[:, :, None] * rows[k])
        return out

    # --- backward ---------------------------------------------------------------------------------------------------------
    def gradient(self) -> RunGradient:
        """Through all steps."""
        run, model, h = self.run, self.model, self.run._h
        kept = self.stepper.save()
        q, v = run._q, run._v
        last = q.shape[0] - 1
        shape = (model.n_nodes, 4, 3)
        by_shape = self.lower(q[last].reshape(shape), self.weights(self.of_points, last))
        by_rates = self.weights(self.of_velocities, last).reshape(-1)
        forces = np.zeros((model.n_nodes, 2, 3))
        timed = any(time is not None for time in model.load_times)
        for k in range(last - 1, -1, -1):
            start, end = q[k].reshape(shape), q[k + 1].reshape(shape)
            middle = 0.5 * (start + end)
            if timed:
                factors = load_factors(model, run.t[k:k + 1], np.full(1, h))[0]
                kernels.external_forces(model.loads, factors, self.stepper.work.f_ext)
            right = by_shape + 2.0 / h * self.lower(end, by_rates)
            x = self.solve(self.tangent(q[k], v[k], run._moves[k]), right, k)
            # the same step backward in time: its end is the start of this one
            backward = self.tangent(q[k + 1], -v[k + 1], -run._moves[k])
            rates = self.lift(middle, x)
            inertia = np.asarray(self.mass @ rates.reshape(-1))
            by_shape = (4.0 / h**2 * self.lower(start, inertia) - backward.T @ x - 2.0 / h * self.lower(start, by_rates)
                        + self.lower(start, self.weights(self.of_points, k)))
            second = (v[k + 1] - v[k]).reshape(shape) / h
            self._collect(start, end, rates, second, float(run.t[k]))
            forces[:, 0] += rates[:, 0]
            forces[:, 1] += self._spins(x)
            by_rates = 2.0 / h * inertia - by_rates + self.weights(self.of_velocities, k).reshape(-1)
        self.stepper.load(kept)
        self.sums.finish()
        at_start = (self.rows @ self.lower(q[0].reshape(shape), by_rates)).reshape(-1, 2, 3)
        sums = self.sums
        sections = {name: RunSectionGradient(sums.stiffness[part], *sums.inertia[part].T) for name, part in sums.parts.items()}
        names = [entry["name"] for kind in ("bodies", "masses") for entry in model.names.get(kind, [])]
        places = [entry["node"] for kind in ("bodies", "masses") for entry in model.names.get(kind, [])]
        number = {} if model.bodies is None else {int(node): j for j, node in enumerate(model.bodies.node)}
        masses = {name: float(self.masses[number[node]]) for name, node in zip(names, places) if node in number}
        return RunGradient(sections, masses, forces[:, 0], forces[:, 1], at_start[:, 0], at_start[:, 1])

    def _spins(self, x: Array) -> Array:
        """Spins of all nodes, those of tied ones from their roots [N, 3]."""
        return (self.rows @ x).reshape(-1, 6)[self.model.spin_root, 3:]

    def _collect(self, start: Array, end: Array, rates: Array, second: Array, t: float) -> None:
        """What the equations of a step depend on besides its shapes."""
        model = self.model
        factor = 1.0
        if model.gravity_time is not None:
            factor = float(mean_factors(model.gravity_time, np.full(1, t), np.full(1, self.run._h))[0])
        gravity = factor * model.gravity
        self.sums.add(start, end, rates, second, gravity)
        if model.bodies is not None:
            at = model.bodies.node
            self.masses -= np.sum(rates[at, 0] * (second[at, 0] - gravity), axis=1)


def _cross(a: Array, b: Array) -> Array:
    """Of vectors [..., 3]; np.cross takes five times as long for few of them."""
    x, y = a[..., (1, 2, 0)], a[..., (2, 0, 1)]
    return x * b[..., (2, 0, 1)] - y * b[..., (1, 2, 0)]


@checked(model=Anything(), t_end=Number(above=0.0, unit="s"), step=Number(above=0.0, unit="s"), start=START, points=POINTS,
         max_iterations=Count(most=10_000), backend=Word())
def adjoint_run(model: Model, *, t_end: float, step: float, start: State | None = None,
                points: Mapping[str, Place] | None = None, max_iterations: int = 25, backend: str = "auto") -> AdjointRun:
    """A run in conserving steps of order 2 that remembers all of them, for gradients of what it leads to (theory.md 13).

    Parameters
    ----------
    model : Model
        Beams, nets, bodies and masses with supports, rigid and ball joints that are eliminated, springs, loads and gravity.
    t_end, step : float
        s; as many steps as fit, the last one ending within round-off of t_end.
    start : State, optional
    points : mapping
        As in `simulate`: what numbers may be made of.
    max_iterations : int
    backend : {'auto', 'pardiso', 'superlu'}
        Of the steps forward.

    Returns
    -------
    AdjointRun
        `.point(name)`, `.velocity(name)` at all steps; `.gradient(points={...})`: derivatives of a weighed sum of them by the
        sections of all beams, masses, loads and initial velocities.

    Raises
    ------
    SceneError
        Sliders, joints with multipliers, damping, drag, supports that move or user forces, whose steps have no adjoint here;
        steps that do not fit into t_end, or into the memory.
    ConvergenceError
        A step fails.
    """
    check_model("adjoint_run", model)
    check_backend(backend)
    unknown = [name for name, there in (
        ("sliders", model.n_sliders), ("joints with multipliers", len(model.kept)),
        ("damping", model.damped is not None or bool(model.losses)), ("joints with axes", model.motions is not None),
        ("drag", model.dragged is not None), ("supports that move", model.prescribed is not None),
        ("supports that let go", model.released is not None),
        ("user forces", model.user_forces), ("links of other kinds than springs", any(
            not isinstance(x, Springs) for x in model.links))) if there]
    if unknown:
        raise SceneError(f"adjoint_run: steps with {', '.join(unknown)} have no adjoint here; use differences of runs")
    n = round(t_end / step)
    if n < 1 or abs(n * step - t_end) > 1e-9 * t_end:
        raise SceneError(f"adjoint_run: t_end={t_end:g} s is no whole number of steps of {step:g} s")
    assert model.uneliminated is not None
    own = model.uneliminated(planar=False)
    if (n + 1) * own.q0.size * 20.0 > MOST:
        raise SceneError(f"adjoint_run: {n} steps of {own.n_nodes} nodes take {n * own.q0.size * 20.0 / 1e9:.3g} GB of "
                         f"memory, more than {MOST / 1e9:g}; run in parts")
    if start is not None:
        start, _ = check_start(model, start, step)
    return AdjointRun(own, Stepper(own, np.ones(1), start, max_iterations, backend), points or {}, 0.0, step, n)
