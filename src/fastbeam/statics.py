"""Equilibrium: Newton on the unknowns of every node with load steps that adapt (theory.md 8)."""
from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import numpy as np

from .arguments import Anything, Count, Flag, Instance, Number, Numbers, Word, checked
from .dynamics import failure
from .errors import ConvergenceError, Interrupted, SceneError
from .interrupt import Interrupts
from .kernels import step as kernels
from .kernels.step import OK, SINGULAR
from .kernels.work import State
from .model import Model, check_model, factor_at
from .newton import Outcome, Stepper
from .observe import OBSERVED, POINTS, Observer
from .planar import find_plane
from .progress import Progress
from .resolution import Resolution
from .result import Result, ResultBuffer
from .starting import check_start

Array = np.ndarray
# an increment of a fifth of the scene or of 0.8 rad at once is not a Newton step any more
LARGEST_INCREMENT = 4.0
TOLD = {"unstable": "this equilibrium is unstable, its tangent has {} negative eigenvalue(s) {}: a buckling or limit load was "
                    "passed on the way; a larger imperfection or a run in time finds a stable one",
        "free": "the tangent of this equilibrium has {} zero eigenvalue(s) {}: a buckling load is met, or a part can move or "
                "spin freely, such as a beam between two ball joints about its axis; what it does there is arbitrary"}
WHERE = {"space": "in space", "plane": "in the plane of the scene (motions out of it are not counted)"}
SHARE = Number(above=0.0, most=1.0)
START = Instance(State, "a State (result.state, model.state())", "of a checkpoint: checkpoint.state")


@checked(model=Anything(), load_step=SHARE, largest_load_step=SHARE, levels=Numbers((None,), "increasing load factors in (0, 1]"),
         smallest_step=SHARE, at_time=Number(unit="s"), start=START, observe=OBSERVED, points=POINTS,
         max_iterations=Count(most=10_000), backend=Word(), threads=Count(most=1024), mend_start=Flag())
def solve_static(model: Model, *, load_step: float = 0.25, largest_load_step: float = 1.0, levels: Sequence[float] | None = None,
                 smallest_step: float = 1e-6, at_time: float | None = None, start: State | None = None,
                 observe: Sequence[str] = ("energy",), points: Mapping[str, Any] | None = None, max_iterations: int = 20,
                 backend: str = "auto", threads: int | None = None, mend_start: bool = False) -> Result:
    """Equilibrium under the loads of the scene, raised from zero in steps that adapt to the convergence.

    Parameters
    ----------
    model : Model
        Without sliders: a sliding point has no static equilibrium here. Find that of the scene without the slider and go on from
        it in the whole scene, `simulate(whole, start=result.state_for(whole), ...)`. A planar scene has to be held in its plane,
        any other one in space.
    load_step, largest_load_step, smallest_step : float
        First, largest and smallest increment of the load factor, which runs from 0 to 1; all in (0, 1].
    levels : sequence of float
        Increasing load factors in (0, 1] that steps end at, so that they have rows; other steps are rows as well.
    at_time : float
        Where time functions of loads are evaluated, s; needed when the scene has some.
    start : State
        Begin from this shape instead of the reference; joints have to allow it, supports hold their nodes where it has them.
    observe, points
        As in `simulate`; rows are load steps, `result.t` the load factor.
    max_iterations : int
        Newton iterations a load step.
    backend : {'auto', 'pardiso', 'superlu'}
    threads : int
        As in `simulate`.
    mend_start : bool
        As in `simulate`.

    Returns
    -------
    Result
        With the equilibrium in `.state`, ready as `start` of `simulate`. `info["unstable_directions"]` and
        `info["free_directions"]` count the negative and the zero eigenvalues of its tangent; any is an event too: a buckling or
        limit load was passed, or is met, or something is held by nothing. `info["counted_in"]` is "space" or "plane": a planar
        scene that is held in its plane only, one compiled with planar=True, and one whose moments leave it undecided in space are
        counted in the plane. Moments make the tangent in space unsymmetric; then the number is 0 where its symmetric part has no
        negative eigenvalue, 1 (at least) where its determinant is negative, else None (theory.md 8).

    Raises
    ------
    SceneError
        A scene that is not compiled, an argument out of range, something that is held by nothing, sliders.
    ConvergenceError
        The smallest load step fails; carries the last equilibrium and the result until then.
    Interrupted
        By Ctrl-C; carries the same.
    """
    check_model("solve_static", model)
    if model.n_sliders:
        raise SceneError(f"solve_static: scene {model.scene_name!r} has sliders, which it cannot bring to rest; leave the "
                         "sliders and what hangs on them out, solve that scene, and start the whole one from there: "
                         "fb.simulate(model, start=result.state_for(model), ...)")
    load_step = min(load_step, largest_load_step)
    if not smallest_step <= load_step:
        raise SceneError(f"load_step: needs 0 < smallest_step <= load_step <= 1, got {smallest_step!r} and {load_step!r}")
    stops = [*([] if levels is None else levels), 1.0]
    if levels is not None and not (len(levels) and levels[0] > 0.0 and levels[-1] <= 1.0 and np.all(np.diff(levels) > 0.0)):
        raise SceneError(f"levels: must be increasing load factors in (0, 1], got {tuple(float(x) for x in levels[:12])}")
    timed = [t for t in model.load_times if t is not None]
    if timed and at_time is None:
        raise SceneError("solve_static: loads have time functions; say with at_time=... where to evaluate them")
    factors = np.array([1.0 if t is None else factor_at(t, at_time or 0.0) for t in model.load_times])
    notes: list[Any] = []
    if start is not None:
        start, notes = check_start(model, start, 1.0, mend_start, at_rest=True)
    solver = _StaticSolver(model, start, max_iterations, backend, threads)
    flat = solver.stepper.plane is not None
    held_in_space = check_supports(model, flat)
    Observer(model, observe, points)  # refuses what does not exist; at rest there is nothing but the energy to record
    observer = Observer(model, ("energy",) if "energy" in observe else (), points)
    info: dict[str, Any] = {"scene": model.scene_name, "method": "static", "conserved": []}
    buffer = ResultBuffer(observer.header(info))
    begin = time.perf_counter()

    def record(factor: float, iterations: int, size: float) -> None:
        buffer.append({**observer.row(at_time or 0.0, solver.state), "iterations": iterations, "step_size": size}, factor)
        q = solver.state.q.reshape(-1, 4, 3)
        buffer.snapshot(factor, q[:, 0], q[:, 1:])

    def finish() -> Result:
        result = buffer.close(info | {"solver": solver.linear.name, "steps": len(solver.history),
                                      "iterations": sum(solver.history), "wall_time": time.perf_counter() - begin})
        result.state = State(*(x.copy() for x in solver.state))
        return result

    def look_at_mesh(factor: float) -> str:
        """Events where elements are too coarse for the last equilibrium; the first as a text."""
        resolution = Resolution(model)
        resolution.look(factor, solver.state.q)
        found = resolution.events()
        for event in found:
            buffer.event(event)
        return f"; {found[0]['text']}" if found else ""

    bar = Progress(1.0, f"{model.scene_name}: load")
    for kind, text in notes:
        buffer.event({"kind": kind, "time": 0.0, "text": text})
    reached, step = 0.0, load_step
    with _interruptible(solver, buffer, finish, bar):
        record(0.0, 0, 0.0)
        while reached < 1.0:
            solver.interrupts.serve()
            stop = next(level for level in stops if level > reached)
            size = min(step, stop - reached)
            target = stop if reached + size > stop - 1e-12 else reached + size
            status, sizes = solver.equilibrium(target * factors)
            if status == OK:
                solver.history.append(len(sizes))
                record(target, len(sizes), size)
                bar.update(target - reached)
                reached = target
                # a step that was cut to meet a level says nothing against the size planned
                grown = size * (2.0 if len(sizes) <= 6 else 1.4 if len(sizes) <= 9 else 1.0)
                step = min(max(grown, step if size < step else 0.0), largest_load_step)
                continue
            if size <= smallest_step * (1.0 + 1e-12):
                failed = Outcome(status, 0, len(sizes), -1, np.array(sizes), np.zeros((2, 0)))
                error = failure(solver.stepper, failed, reached, len(solver.history))
                text = str(error).replace(f"t = {reached:.6g} s", f"load factor {reached:.6g}").split("; the last good state")[0]
                bar.close()
                coarse = look_at_mesh(reached)
                raise ConvergenceError(f"{text}{coarse}; a limit or buckling point may lie there, a part may be free to move, or "
                                       "stiffnesses are too far apart for round-off (beams more slender than 1e6). The last "
                                       "equilibrium is in .state, everything computed in .result", step=error.step, time=reached,
                                       residuals=error.residuals, worst=error.worst,
                                       state=State(*(x.copy() for x in solver.state)), result=finish())
            step = max(smallest_step, 0.25 * size)
        bar.close()
        counted_in = "plane" if flat and (model.asked_for_plane or not held_in_space) else "space"
        counted = solver.signs(factors, counted_in == "plane")
        if counted is None and flat and counted_in == "space":
            # about the normal of a plane moments have a potential
            counted_in, counted = "plane", solver.signs(factors, True)
        look_at_mesh(1.0)
        info["counted_in"] = counted_in
        for (kind, text), found in zip(TOLD.items(), counted or (None, None)):
            info[kind + "_directions"] = found
            if found:
                buffer.event({"kind": kind, "time": 1.0, "text": text.format(found, WHERE[counted_in])})
    return finish()


@contextmanager
def _interruptible(solver: _StaticSolver, buffer: ResultBuffer, finish: Callable[[], Result], bar: Progress) -> Iterator[None]:
    """Ctrl-C waits for the end of a load step, or of an iteration where these are called from Python, and brings the result.

    Raises
    ------
    Interrupted
    """
    try:
        with Interrupts() as solver.interrupts:
            yield
    except KeyboardInterrupt as stopped:
        bar.close()
        text = "interrupted; the last equilibrium is in .state, everything until then in .result"
        buffer.event({"kind": "interrupted", "time": bar.done, "text": f"at load factor {bar.done:.6g}: interrupted"})
        result = finish()
        raise Interrupted(f"load factor {bar.done:.6g}: {text}", result=result, state=result.state) from stopped


class _StaticSolver:
    """Newton iterations of one model; keeps the last equilibrium."""

    def __init__(self, model: Model, start: State | None, max_iterations: int, backend: str, threads: int | None = None) -> None:
        # the tangent lacks as much of symmetry as there is lacking of equilibrium: its symmetric part squares the increments as
        # well, unless moments act (theory.md 8)
        self.moments = model.loads.size > 0 and bool(np.any(model.loads.reshape(len(model.loads), -1, 8)[:, :, 3:6]))
        self.stepper = Stepper(model, np.ones(1), start, max_iterations, backend, threads=threads, static=True,
                               symmetric=not self.moments)
        self.core, self.work, self.max_iterations = self.stepper.core, self.stepper.work, max_iterations
        self.stepper.core_state.v[:] = 0.0
        self.history: list[int] = []
        self.interrupts = Interrupts()
        self.linear = self.stepper.linear
        self.inner = self.stepper.inner

    @property
    def state(self) -> State:
        """The present shape."""
        return self.stepper.state

    def _load(self, factors: Array) -> None:
        self.work.f_ext[:] = 0.0
        if self.core.loads.shape[0]:
            kernels.external_forces(self.core.loads, factors, self.work.f_ext)

    def equilibrium(self, factors: Array) -> tuple[int, list[float]]:
        """Solve for load factors [K]; on a failure or interrupt the state is the last equilibrium."""
        before = self.stepper.core_state.q.copy()
        try:
            return self._equilibrium(factors)
        except KeyboardInterrupt:
            self.stepper.core_state.q[:] = before
            raise

    def _equilibrium(self, factors: Array) -> tuple[int, list[float]]:
        model, state = self.core, self.stepper.core_state
        self._load(factors)
        before = state.q.copy()
        if self.linear.is_compiled and model.substructures is None:
            buffer = np.zeros(self.max_iterations)
            with self.linear.threads():
                status, n = kernels.solve_equilibrium(self.stepper.terms, self.stepper.system, self.max_iterations,
                                                      LARGEST_INCREMENT, buffer)
            sizes = [float(x) for x in buffer[:n]]
        else:
            self.stepper.parts.start(0.0)
            status, sizes = self.stepper.parts.newton(0.0, self.max_iterations, LARGEST_INCREMENT, self.interrupts.serve)
        if status == SINGULAR and not self.stepper.pivots_everywhere:
            state.q[:] = before
            status, sizes = self.spare.equilibrium(factors)
            self.linear.fallbacks += status == OK
        if status != OK:
            state.q[:] = before
        return status, sizes

    def _plain(self, planar: bool) -> _StaticSolver:
        plain = self.stepper.model.plain
        assert plain is not None
        return _StaticSolver(plain(planar=planar), self.state, self.max_iterations, "superlu")

    @cached_property
    def spare(self) -> _StaticSolver:
        """The same state around SuperLU without elimination of inner nodes, see `Stepper.spare`."""
        spare = self._plain(self.stepper.plane is not None)
        spare.stepper.core_state = self.stepper.core_state
        spare.interrupts = self.interrupts
        return spare

    def signs(self, factors: Array, in_plane: bool) -> tuple[int, int] | None:
        """Numbers of negative and of zero eigenvalues of the tangent at the last equilibrium, that of load factors [K]: in space,
        also in directions that a planar scene cannot follow, or in its plane. None where moments leave it undecided."""
        if in_plane != (self.stepper.plane is not None) or not self.stepper.pivots_everywhere:
            return self._plain(in_plane).signs(factors, in_plane)
        model, work = self.core, self.work
        self._load(factors)
        self.stepper.parts.start(0.0)
        self.stepper.parts.assemble(0.0)
        size = len(model.size)
        return self.linear.superlu.signs(work.blocks[:8 * size * model.pattern.keys.size].reshape(-1, size, 8),
                                         symmetric=in_plane or not self.moments)


def check_supports(model: Model, flat: bool = False) -> bool:
    """Every connected part must be held against all six rigid motions; flat: against the three in the plane of the scene. Returns
    whether all six are prevented.

    Raises
    ------
    SceneError
        Names the part and the motion that nothing prevents.
    """
    held_in_space = True
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    pattern = model.pattern
    n = model.n_nodes
    graph = coo_matrix((np.ones(pattern.keys.size), (pattern.rows, pattern.columns)), shape=(n, n))
    rows, columns = [pattern.row_of], [pattern.row_of]
    if model.inner is not None:
        # an eliminated node hangs on the first node of its element
        rows.append(pattern.n + np.arange(model.inner.element.size))
        columns.append(model.inner.rows[model.inner.where[model.inner.element, 2]])
    if model.substructures is not None:
        # a node of a condensed beam hangs on the start of the beam
        for tables, groups in zip((model.simo, model.green), model.groups_of_beams()):
            for count, nn in np.unique(groups[:, 1:3], axis=0).tolist():
                first = groups[(groups[:, 1] == count) & (groups[:, 2] == nn), 0]
                at = tables.meta[first[:, None] + np.arange(count), 3]
                own = tables.rows[at[:, :, None, None] + np.arange(8 * nn).reshape(nn, 8)]
                rows.append(own.reshape(-1))
                columns.append(np.broadcast_to(own[:, :1, :1], own.shape).reshape(-1))
    if model.ties is not None:
        # a tied node hangs on its targets
        count = np.diff(model.ties.start)
        rows.append(np.repeat(pattern.row_of, count))
        columns.append(model.ties.target_row)
    graph = graph + coo_matrix((np.ones(sum(map(len, rows))), (np.concatenate(rows), np.concatenate(columns))), shape=(n, n))
    _, part = connected_components(graph, directed=False)
    part = np.unique(part[pattern.row_of], return_inverse=True)[1]
    phi = model.q0.reshape(-1, 12)[:, :3]
    mask = model.held_mask
    if model.ties is not None:
        mask[model.ties.slave] = 0
    point = model.numbers.rank == 9
    eye6 = np.eye(6)
    within = eye6
    if flat:
        axes = model.plane.axes
        within = np.zeros((6, 3))
        within[:3, 0], within[:3, 1], within[3:, 2] = axes
    by_part = np.split(np.argsort(part, kind="stable"), np.cumsum(np.bincount(part))[:-1])
    for nodes in by_part:
        if np.all(point[nodes]) and np.all(mask[nodes] & 7):
            continue
        center = phi[nodes].mean(axis=0)
        size = float(np.max(np.linalg.norm(phi[nodes] - center, axis=1))) or 1.0
        eye, none = np.eye(3), np.zeros((3, 3))
        # unit motions: shift, and turn about the centre
        x = (phi[nodes[mask[nodes] & 7 != 0]] - center) / size
        turn = np.cross(eye[:, None], x[None]).transpose(1, 2, 0)
        held = [np.concatenate((np.broadcast_to(eye, turn.shape), turn), axis=2).reshape(-1, 6)]
        if np.any((mask[nodes] & 56 != 0) & ~point[nodes]):
            held.append(np.hstack((none, eye)))
        matrix = np.concatenate(held)
        values, motions = _free_motions(matrix, eye6)
        if values[5] > 1e-9:
            continue
        held_in_space = False
        if flat:
            values, motions = _free_motions(matrix, within)
            if values[2] > 1e-9:
                continue
        what = model.labels[nodes[0]].split(" node ")[0]
        shift, turn = motions[-1][:3], motions[-1][3:]
        how = "turn about " + _axis(turn) if np.linalg.norm(turn) > 0.5 else "move along " + _axis(shift)
        n_free = int(np.sum(values <= 1e-9))
        kind = "3 rigid motions in its plane" if flat else "6 rigid motions"
        raise SceneError(f"{what}: nothing holds it in statics, it can {how} ({n_free} of {kind} are free); "
                         f"{'add a Clamp or Pins' if flat else 'add a Clamp, or Pins that do not lie on one line'}"
                         + ("" if flat else _planar_hint(model, shift, turn)))
    return held_in_space


def _free_motions(matrix: Array, basis: Array) -> tuple[Array, Array]:
    """Singular values [k] of what supports feel of the rigid motions basis [6, k], and the motions [k, 6], the freest last."""
    k = basis.shape[1]
    # the triangle of a QR has the same singular values
    triangle = np.linalg.qr(np.concatenate((matrix @ basis, np.zeros((k, k)))), mode="r")
    _, values, motions = np.linalg.svd(triangle)
    return values, motions @ basis.T


def _planar_hint(model: Model, shift: Array, turn: Array) -> str:
    """What to say to someone whose scene would do in its plane."""
    plane, reason = (model.plane, "") if model.plane is not None else find_plane(model)
    if plane is None:
        return f"; it would do in a plane, but it is not planar: {reason}" if reason and model.not_planar == reason else ""
    normal = plane.axes[2]
    inside = np.concatenate((shift - (shift @ normal) * normal, [turn @ normal]))
    if np.linalg.norm(inside) > 1e-6:
        return ""
    return "; within its plane it is held: compile it with planar=True" + (" and start in the plane" if model.plane else "")


def _axis(v: Array) -> str:
    v = v / (np.max(np.abs(v)) or 1.0)
    return "(" + ", ".join(f"{x:.3g}" for x in np.where(np.abs(v) < 1e-9, 0.0, v)) + ")"
