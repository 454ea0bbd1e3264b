"""Runs with gradients: the discrete adjoint of conserving steps (theory.md (13.9) to (13.15))."""
from __future__ import annotations

from collections.abc import Mapping
from math import ceil, sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fastbeam.dynamics.options import START
from fastbeam.dynamics.control import failure
from fastbeam.gradients.backward import Backward, Stretch, Sums, Weights
from fastbeam.gradients.parameters import Build, which_build
from fastbeam.gradients.run_parameters import RunFamily
from fastbeam.gradients.section_gradient import beam_numbers
from fastbeam.interface.arguments import LARGEST, Anything, Count, Names, Number, Word, checked, numbers, shown
from fastbeam.interface.errors import ConvergenceError, SceneError
from fastbeam.interface.result_warnings import Doubts, warns
from fastbeam.interface.synonyms import known
from fastbeam.kernels.contact.coulomb import MOST_FLIPS
from fastbeam.kernels.empty_arrays import empty
from fastbeam.kernels.joints.coordinates import VALUE
from fastbeam.kernels.loop import OK
from fastbeam.kernels.state import State
from fastbeam.linalg.linear_system import check_backend
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.model import Model, check_model
from fastbeam.model.plane import TOLERANCE
from fastbeam.model.start import check_start
from fastbeam.results.observe.observer import POINTS, Observer
from fastbeam.results.observe.resolution import mesh_events
from fastbeam.scene.checks import Place
from fastbeam.stepping.stepper import Stepper

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Array = np.ndarray
# bytes that the steps of a run may take
MOST = 4e9


class RunSectionGradient(NamedTuple):
    """Derivatives by the section of every beam of a part, see `SectionGradient`, [beams] each.

    Attributes
    ----------
    stiffness : float64 [beams, 6, 6]
        Derivatives by C.
    rhoA, rhoI2, rhoI3 : float64 [beams]
    viscosity : float64 [beams, 6, 6]
        Derivatives by D of theory.md (2.5), where a section has damping; else 0.
    prestrain : float64 [beams, 6]
        Derivatives by e of theory.md (2.8), see `SectionGradient`: unstressed lengths, with the motion of the start as it is.
    """

    stiffness: Array
    rhoA: Array  # noqa: N815  the field's symbols
    rhoI2: Array  # noqa: N815
    rhoI3: Array  # noqa: N815
    viscosity: Array
    prestrain: Array

    def by(self, stiffness: ArrayLike, rhoA: ArrayLike = 0.0, rhoI2: ArrayLike = 0.0,  # noqa: N803
           rhoI3: ArrayLike = 0.0, viscosity: ArrayLike = 0.0) -> Array:
        """Return derivatives by a parameter [beams], from its derivatives of C (6, 6), or one of every beam, of the inertias, and
        of D (6, 6): with `damping=d` of a section D = d C changes with C."""
        return (np.sum(self.stiffness * np.asarray(stiffness), axis=(1, 2)) + self.rhoA * np.asarray(rhoA)
                + self.rhoI2 * np.asarray(rhoI2) + self.rhoI3 * np.asarray(rhoI3)
                + np.sum(self.viscosity * np.asarray(viscosity), axis=(1, 2)))


class RunSliderGradient(NamedTuple):
    """Derivatives by forces, drive and friction along the beam of a slider, in a run of n steps (theory.md (13.15)).

    Attributes
    ----------
    forces : float64 [n]
        Derivatives by a force in the direction of growing s during every step, N; 0 where its motion is prescribed, or friction
        holds it. Multiply by derivatives of the force of a drive by a parameter, at the middle of steps, for that parameter.
    places : float64 [n]
        Derivatives by a drive with `position`: by its place at the end of every step, m; with `speed`: by the way in every
        step, m.
    friction : float
        Derivative by the coefficient of friction.
    viscous : float
        Derivative by its viscous part, per N s/m.
    """

    forces: Array
    places: Array
    friction: float
    viscous: float


class RunGradient(NamedTuple):
    """Derivatives of one number of a run in n steps.

    Attributes
    ----------
    sections : dict of str to RunSectionGradient
        Derivatives by the sections of all beams and of the beams of all nets.
    masses : dict of str to float
        Derivatives by the masses of bodies and point masses, per kg.
    forces, moments : float64 [N, 3]
        Derivatives by dead forces and moments that act on a node from the start to the end.
    velocities, spins : float64 [N, 3]
        Derivatives by the initial velocity and spin of a node, those of its row where several share one, 0 where it follows
        others.
    positions, turns : float64 [N, 3]
        Derivatives by the position and orientation (rotation vector in space, rad) of a node at the start, in the same way;
        velocities and spins, the reference and supports stay. Sliders and joints have to allow the change.
    gravity : float64 [3]
        Derivatives by the gravity of the scene, as it is before its time function.
    factors : dict of str to float64 [n]
        Derivatives by the mean factor over every step of a time function, under the names of the loads that have it, as in
        "load 'pull'", several with a comma between them.
    pushes : dict of str to float64 [n, 3]
        Derivatives by a dead force on an observed point during every step, for loads that change in time.
    sliders : dict of str to RunSliderGradient
        Derivatives by forces along the beam on all sliders and sleeves.
    by : dict of str to float
        Derivatives by the parameters of `build`.
    """

    sections: dict[str, RunSectionGradient]
    masses: dict[str, float]
    forces: Array
    moments: Array
    velocities: Array
    spins: Array
    positions: Array
    turns: Array
    gravity: Array
    factors: dict[str, Array]
    pushes: dict[str, Array]
    sliders: dict[str, RunSliderGradient]
    by: dict[str, float]


class AdjointRun(Doubts):
    """A run that remembers its steps; made by `adjoint_run`.

    Attributes
    ----------
    t : float64 [n + 1]
        s.
    model : Model
    state : State
        The last one.
    outside : int
        Steps of the last `gradient` that block elimination left to a solver with pivoting.
    events : list of dict
        Events of the start, and of the mesh at the end, as in a `Result`.
    """

    def __init__(self, model: Model, stepper: Stepper, points: Mapping[str, Place], h: float, n: int, every: int,
                 begins_as_scene: bool) -> None:
        self.model, self._stepper, self._h, self._every = model, stepper, h, every
        self._begins_as_scene = begins_as_scene
        self.t = h * np.arange(n + 1)
        self.outside = 0
        self.events: list[dict[str, Any]] = []
        self._points = Observer(model, (), points).points.places
        self._rows = {name: empty((2, n + 1, 3)) for name in self._points}
        self._saved: list[Any] = []
        # step and slider whose friction no branch was found for
        self._undecided: tuple[int, str] | None = None
        # all steps, or those of the newest stretch
        self._stretch: Stretch | None = None
        for first in range(0, n, every):
            if every < n:
                self._saved.append(stepper.save())
            self._stretch = self._go(first)
            self._observe(self._stretch)
        self.state = stepper.copy_state()

    def _go(self, first: int) -> Stretch:
        """Take steps from row `first` on, from the present state."""
        stepper, n = self._stepper, min(self._every, self.t.size - 1 - first)
        state, work = stepper.core_state, stepper.work
        nodes, dim = self.model.n_nodes, stepper.core.dim
        values = np.zeros(0, np.int64) if self.model.motions is None else self.model.motions.every.place + VALUE
        slides = 0 if stepper.along is None else state.s.size
        out = Stretch(first, empty((n + 1, state.q.size)), empty((n + 1, state.q.size)), empty((n, dim * nodes)),
                      empty((n, (len(stepper.core.dofs) - dim) * nodes)), empty((n + 1, state.s.size)),
                      empty((n, state.force.size)), np.zeros((n, slides), np.int64), empty((n, slides)),
                      empty((n + 1, values.size)))
        for k in range(n + 1):
            out.q[k], out.v[k], out.s[k], out.values[k] = state.q, state.v, state.s, state.history[values]
            if k < n:
                pivoting = stepper.linear.fallbacks
                outcome = stepper.advance(0.0, self._h, 1, first + k)
                if outcome.status != OK:
                    raise failure(stepper, outcome, float(self.t[first + k]), first + k, self._h)
                out.dphi[k], out.theta[k] = work.dphi[:out.dphi.shape[1]], work.theta[:out.theta.shape[1]]
                out.force[k] = state.force
                if stepper.along is not None:
                    along = stepper.along if stepper.linear.fallbacks == pivoting else stepper.fallback.along
                    out.sign[k], out.rest[k] = along.coulomb.sign, along.coulomb.rest
                    fallback = np.flatnonzero((along.coulomb.flips >= MOST_FLIPS) & self.model.slider_forces.hold_by_friction)
                    if fallback.size and self._undecided is None:
                        self._undecided = first + k, self.model.names["sliders"][fallback[0]]
        return out

    def _again(self, first: int) -> Stretch:
        """Take the steps from row `first` on once more where they are not kept: the same bits."""
        if self._stretch is None or self._stretch.first != first:
            self._stepper.load(self._saved[first // self._every])
            self._stretch = self._go(first)
        return self._stretch

    def _observe(self, part: Stretch) -> None:
        """Evaluate places and velocities of points."""
        plane, rows = self._stepper.plane, slice(part.first, part.first + len(part.q))
        for name, (nodes, weights) in self._points.items():
            for kind, of in enumerate((part.q, part.v)):
                if plane is None:
                    of_nodes = of.reshape(len(of), -1, 4, 3)[:, nodes]
                else:
                    of_nodes = plane.vectors_of(of, nodes, kind == 0)
                self._rows[name][kind, rows] = np.einsum("ma,tmac->tc", weights, of_nodes)

    def _read(self, name: str, kind: int) -> Array:
        if name not in self._points:
            raise SceneError(f"adjoint_run: there is no point {shown(name)}; there are {known(self._points, name)}")
        return self._rows[name][kind].copy()

    @checked(name=Word())
    def point(self, name: str) -> Array:
        """Return the path of an observed point [n + 1, 3], m.

        Raises
        ------
        SceneError
            There is no such point.
        """
        return self._read(name, 0)

    @checked(name=Word())
    def velocity(self, name: str) -> Array:
        """Return the velocity of an observed point [n + 1, 3], m/s.

        Raises
        ------
        SceneError
            There is no such point.
        """
        return self._read(name, 1)

    @checked(points=Names("must map names of points to weights (3,) or (n + 1, 3)"),
             velocities=Names("must map names of points to weights (3,) or (n + 1, 3)"), build=which_build,
             values=Names("must map names of parameters to numbers"), scale=Names("must map names of parameters to sizes"))
    def gradient(self, *, points: Mapping[str, ArrayLike] | None = None, velocities: Mapping[str, ArrayLike] | None = None,
                 build: Build | None = None, values: Mapping[str, float] | None = None,
                 scale: Mapping[str, float] | None = None) -> RunGradient:
        """Return derivatives of a weighed sum of positions and velocities of points, by one backward pass through all steps.

        Parameters
        ----------
        points, velocities : mapping of str to (3,) or (n + 1, 3)
            Weights of the last row, or of all rows; for a function of the run its derivatives by positions and velocities.
        build, values, scale : optional
            See `sensitivity`: a function that builds the scene of the run, and returns it with the points, (scene, points);
            its parameters, anything that the scene depends on smoothly (positions, lengths, offsets, densities), for `.by`. Each
            takes about as long as three or four runs. A `start` of the run goes along with the reference. Needs all steps
            (keep_every=1).

        Raises
        ------
        SceneError
            No weights, a point that was not observed, or friction that neither slips nor sticks in a step. Of parameters: build
            returns another scene, or other parts for other values; the scene depends on one in steps; friction holds a slider.
        ConvergenceError
            The tangent of a step is singular.
        """
        if not points and not velocities:
            raise SceneError("gradient: needs weights of the quantity to differentiate, as in gradient(points={'tip': (0, 0, "
                             "1)})")
        if self._undecided is not None:
            k, name = self._undecided
            raise SceneError(f"gradient: in the step from t = {self.t[k]:.6g} s neither slipping nor sticking of slider {name!r} "
                             "solves the equations. The compromise taken there (theory.md 5.6) has no derivative; use smaller "
                             "steps, or smoothing= in its friction")
        rows = self._weights_of_points(points or {}, False) | self._weights_of_points(velocities or {}, True)
        wanted = [Weights(*self._points[name], weights, is_rate) for (name, is_rate), weights in rows.items()]
        family = self._family(rows, build, values, scale)
        plane, n = self._stepper.plane, self.t.size - 1
        # weights out of the plane need derivatives out of the plane
        flat = plane is not None and family is None and all(
            np.max(np.abs(x.rows @ plane.axes[2])) <= TOLERANCE * np.max(np.abs(x.rows)) for x in wanted)
        assert self.model.uneliminated is not None
        own = self.model.uneliminated(planar=flat, solver="auto")
        back = Backward(own, flat, 0.0, self._h, n, wanted, list(self._points.values()))
        if family is not None:
            back.keep_solutions()
        part = None
        for first in reversed(range(0, n, self._every)):
            part = self._again(first)
            if plane is not None and not flat:
                part = part.in_space(plane)
            if first + len(part.dphi) == n:
                back.start(part.q[-1])
            try:
                back.through(part)
            except ArithmeticError as error:
                raise ConvergenceError(f"gradient: the tangent of step {error.args[0]} is singular", step=error.args[0],
                                       time=float(self.t[error.args[0]]), state=self.state) from None
        assert part is not None
        self.outside = back.outside
        by = {} if family is None else {
            name: family.by(name, back, part, rows, self._begins_as_scene) for name in family.values}
        return self._found(back.sums(part.q[0], part.v[0]), by)

    def _family(self, rows: Mapping[tuple[str, bool], Array], build: Build | None, values: Mapping[str, float] | None,
                scale: Mapping[str, float] | None) -> RunFamily | None:
        """Return the scenes for the parameters of `gradient`; None without parameters.

        Raises
        ------
        SceneError
        """
        if build is None and not values and not scale:
            return None
        if build is None or not values:
            raise SceneError("gradient: derivatives by parameters need both build=..., a function that builds the scene, and "
                             "values={...}, its parameters")
        if self._every < self.t.size - 1:
            raise SceneError("gradient: derivatives by parameters of build need the states of all steps; leave keep_every out")
        assert self._stretch is not None
        forces = self.model.slider_forces
        stuck = np.zeros(0, np.int64)
        if forces is not None:
            stuck = np.flatnonzero(forces.hold_by_friction & np.any(self._stretch.sign == 0, axis=0))
        if stuck.size:
            raise SceneError(f"gradient: friction holds slider {self.model.names['sliders'][stuck[0]]!r} in some steps. For such "
                             "runs derivatives by parameters of build are not available, only those by sections, masses and "
                             "loads")
        return RunFamily(self.model, dict.fromkeys(name for name, _ in rows), build, values, scale)

    def _found(self, sums: Sums, by: dict[str, float]) -> RunGradient:
        """Sort the sums of a backward pass by the names of the scene."""
        model = self.model
        sections = {name: RunSectionGradient(sums.stiffness[part], *sums.inertia[part].T, sums.viscosity[part],
                                             sums.prestrain[part])
                    for name, part in beam_numbers(model)[1].items()}
        names = [(entry["name"], entry["node"]) for kind in ("bodies", "masses") for entry in model.names.get(kind, [])]
        number = {} if model.bodies is None else {int(node): j for j, node in enumerate(model.bodies.node)}
        masses = {name: float(sums.bodies[number[node]]) for name, node in names if node in number}
        factors = {name: sums.factors[:, k].copy() for k, (name, time) in enumerate(zip(model.load_names, model.load_times))
                   if time is not None}
        pushes = {name: sums.pushes[:, k].copy() for k, name in enumerate(self._points)}
        of = sums.sliders
        sliders = {name: RunSliderGradient(of.along[:, k].copy(), of.place[:, k].copy(), float(of.friction[k]),
                                           float(of.viscous[k])) for k, name in enumerate(model.names["sliders"])}
        return RunGradient(sections, masses, sums.forces, sums.moments, sums.velocities, sums.spins, sums.positions, sums.turns,
                           sums.gravity, factors, pushes, sliders, by)

    def _weights_of_points(self, given: Mapping[str, ArrayLike], is_rate: bool) -> dict[tuple[str, bool], Array]:
        """Return weights of points [n + 1, 3], by their names and whether they are of velocities."""
        out = {}
        for name, value in given.items():
            if name not in self._points:
                raise SceneError(f"gradient: there is no point {name!r}; there are {known(self._points, name)}")
            found = numbers(value)
            if found is None or found.shape not in ((3,), (self.t.size, 3)) or not np.all(np.abs(found) <= LARGEST):
                raise SceneError(f"gradient, point {name!r}: needs weights (3,) of the last row, or ({self.t.size}, 3) of all, "
                                 f"got {shown(value)}")
            rows = np.zeros((self.t.size, 3))
            rows[(slice(None) if found.ndim == 2 else -1)] = found
            out[name, is_rate] = rows
        return out


@warns
@checked(model=Anything(), t_end=Number(above=0.0, unit="s"), step=Number(above=0.0, unit="s"), start=START, points=POINTS,
         max_iterations=Count(most=10_000), backend=Word(), keep_every=Count(most=1_000_000_000))
def adjoint_run(model: Model, *, t_end: float, step: float, start: State | None = None,
                points: Mapping[str, Place] | None = None, max_iterations: int = 25, backend: str = "auto",
                keep_every: int = 1) -> AdjointRun:
    """Run a model in conserving steps of order 2 that are kept, for gradients of its results (theory.md 13).

    Parameters
    ----------
    model : Model
        Beams, nets, bodies and masses with supports, also those that move, joints, sliders, sleeves, their friction, drives and
        elastic stops, springs, dampers, bushings, drag, damped sections, loads and gravity.
    t_end, step : float
        s; as many steps as fit, the last one ending within round-off of t_end.
    start : State, optional
    points : mapping
        As in `simulate`: points that `gradient` may weigh.
    max_iterations : int
    backend : {'auto', 'pardiso', 'superlu'}
        Solver of the steps forward.
    keep_every : int
        Steps between states that are kept. 1: all steps are. More: those between are taken once more by `gradient`, to the same
        bits, for a run whose steps do not fit into the memory; about the root of the number of steps takes the least.

    Returns
    -------
    AdjointRun
        `.point(name)`, `.velocity(name)` at all steps; `.gradient(points={...})`: derivatives of a weighed sum of them by the
        sections and prestrains of all beams, masses, loads and what they do in every step, gravity, initial shapes and
        velocities, and forces along beams on sliders.

    Raises
    ------
    SceneError
        Rigid stops, locks, releases, switches and one-sided contact of sliders, friction of twists in sleeves, friction and rigid
        stops of joints, supports that let go or take hold, sliders on nets of condensed beams, added mass, air that changes in
        time, controllers, user forces and laws of one's own between two points, whose steps have no adjoint here; steps that do
        not fit into t_end, or into the memory.
    ConvergenceError
        A step fails.
    """
    check_model("adjoint_run", model)
    check_backend(backend)
    require(Analysis.ADJOINT, model)
    n = round(t_end / step)
    if n < 1 or abs(n * step - t_end) > 1e-9 * t_end:
        raise SceneError(f"adjoint_run: t_end={t_end:g} s must be a whole number of steps of {step:g} s")
    every = n if keep_every == 1 else min(keep_every, n)
    # shapes, velocities and increments; of a state that is kept also what the first guess of the next step takes
    size = 20.0 * model.q0.size * ((every + 1) + 1.6 * (ceil(n / every) if every < n else 0))
    if size > MOST:
        least = ceil(sqrt(1.6 * n))
        advice = f"keep the state of every {least}th step only, keep_every={least}" if every == n else "divide the run into parts"
        raise SceneError(f"adjoint_run: {n} steps of {model.n_nodes} nodes take {size / 1e9:.3g} GB of memory, more than "
                         f"{MOST / 1e9:g}; {advice}")
    notes = list(model.notes)
    if start is not None:
        start, notes = check_start(model, start, step, t=0.0)
    run = AdjointRun(model, Stepper(model, np.ones(1), start, max_iterations, backend), points or {}, step, n, every,
                     start is None)
    run.events = [{"kind": kind, "time": 0.0, "text": text} for kind, text in notes] + mesh_events(model, run.state)
    return run
