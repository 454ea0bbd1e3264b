"""Equilibrium paths under loads that grow and fall by one factor, past limit points, by arc length (theory.md 12)."""
from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fastbeam.interface.arguments import LARGEST, Anything, Count, Number, Refusal, Word, checked, numbers, real, shown, whole
from fastbeam.interface.errors import SceneError
from fastbeam.interface.result_warnings import warns
from fastbeam.kernels.contact.slider_forces import NO_DRIVE
from fastbeam.kernels.state import State
from fastbeam.linalg.linear_system import check_backend
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.forces.loads import load_factors_at, load_path, which_times
from fastbeam.model.model import Model, check_model
from fastbeam.model.start import check_start
from fastbeam.model.supports import check_supports, check_turned, free_aside, standing_supports, supported
from fastbeam.model.workspace import ReferenceStrains
from fastbeam.results.observe.observer import OBSERVED, POINTS
from fastbeam.results.observe.resultants import span_of
from fastbeam.results.result import Result
from fastbeam.scene import Beam, Clamp, NodeRef, Pin, PointMass, PrescribedMotion, RigidBody
from fastbeam.scene.checks import Place
from fastbeam.statics.arc_length import PathSolver
from fastbeam.statics.load_laws import LawPath, law_path, laws_grow, user_forces
from fastbeam.statics.moving_supports import SupportPath, StaticShift, coordinates_of, leave_plane
from fastbeam.statics.path_stops import wanted_of
from fastbeam.statics.paths.walk import PathWalk
from fastbeam.statics.static_analysis import START, held_sliders, which_sliders
from fastbeam.statics.unknown_lengths import LEAST, MOST

Array = np.ndarray
Quantity = tuple[str, str] | str | Callable[[State], float]
Support = Clamp | Pin | PrescribedMotion | NodeRef | PointMass | RigidBody
STEP = Number(above=0.0, most=10.0)
KINDS = ("limit", "bifurcation")


def which_branch(value: Any) -> int:
    """Check that a side is 1 or -1. Raises Refusal."""
    side = whole(value)
    if side not in (1, -1):
        raise Refusal(f"must be 1 or -1, the side to which the path branches off, got {shown(value)}")
    return side


@warns
@checked(model=Anything(), to=Number(), start=START, load_factor=Number(), step=STEP, largest_step=STEP, smallest_step=STEP,
         most_points=Count(most=1_000_000), at_time=which_times, points=POINTS, observe=OBSERVED, held=which_sliders,
         max_iterations=Count(most=10_000), backend=Word(), stop_at=Word(KINDS), side=which_branch, branch=Count(0),
         moves=Anything(), stop=Anything(), prestrains=Anything())
def solve_path(model: Model, *, to: float = 1.0, start: State | None = None, load_factor: float = 0.0, step: float = 0.05,
               largest_step: float = 0.1, smallest_step: float = 1e-7, most_points: int = 500,
               at_time: float | tuple[float, float] | None = None,
               points: Mapping[str, Place] | None = None, observe: Sequence[str] = (), held: bool | str | Sequence[str] = False,
               max_iterations: int = 15, backend: str = "auto", stop_at: str | None = None, side: int | None = None,
               branch: int | None = None, moves: Mapping[Support, ArrayLike] | None = None,
               stop: Mapping[Quantity, float] | None = None, prestrains: Mapping[Beam, float] | None = None) -> Result:
    """Follow the path of equilibria under dead loads and gravity times a load factor by arc length, through limit points and
    snap-back, until the factor is `to`; limit points and bifurcations are located on the way.

    Parameters
    ----------
    model : Model
        Held as for `solve_static`. A planar scene stays in its plane until it branches off; its critical points and unstable
        directions are those in space all the same, but for a model compiled with planar=True and a scene that only its plane
        holds (`info["counted_in"]` is "plane" then).
    to : float
        Load factor at which the path ends.
    start : State
        An equilibrium, that of `load_factor`; default: the reference, without loads.
    load_factor : float
        Load factor of the start. The path sets out towards `to`.
    step, largest_step, smallest_step : float
        First, largest and smallest length of a step: the root of the squares of the change of the load factor and of the mean
        motion of the nodes, in sizes of the scene and rad.
    most_points : int
        Points after which the path ends all the same, with an event; one that comes back to its start ends there.
    at_time : float or (float, float)
        Where time functions of loads, and of drives, are evaluated, s; needed when the scene has some. Two times: load factor 0
        has the loads of the first, 1 those of the second, so that loads and gravity without a time function stay, and cases of
        loads follow each other. `start` is then an equilibrium under the first loads, `solve_static(model, at_time=...)`. A
        `PrescribedMotion` goes along its function from t = 0, or between the times, with the load factor; with `moves` or
        `prestrains` and one time it stands where it is then; without a time where it is at the start.
    points : mapping
        As in `simulate`.
    observe : sequence of str
        Besides what sliders do, of 'energy', 'spring', 'section' and 'reaction', as in `solve_static`.
    held : bool, str or sequence of str
        Sliders that stay where they are, as in `solve_static`. Those that are free need a start in which their contact carries
        a force. Forces of drives grow with the load factor as loads do; those that prescribe a motion, Coulomb friction and rigid
        stops are refused.
    max_iterations : int
        Newton iterations a step.
    backend : {'auto', 'pardiso', 'superlu'}
    stop_at : {'limit', 'bifurcation'}, optional
        End at the first critical point of this kind. What may be one and cannot be located raises.
    side : {1, -1}, optional
        Leave the start, a bifurcation (`stop_at`), on the other path that goes through it, to this side.
    branch : int, optional
        Number, from 0, of one of several directions `info["critical_points"][-1]["branches"]` to leave the start in; at a simple
        bifurcation 0 is side 1 and 1 is side -1.
    moves : mapping, optional
        Displacement control: supports (Clamp, Pin, PrescribedMotion, or the node that they hold) -> displacement (3,), m, by
        which they are shifted from the start, straight, times the load factor less that of the start; or (6,) with a rotation
        vector in space, rad, by which they turn at their place, as often as it says. Loads and gravity stay as they are, in full,
        but for those with time functions between two times.
    prestrains : mapping, optional
        Beams -> change of their prestrain (theory.md (2.8)) until load factor 1: unstressed lengths, -alpha dT of a temperature.
        Loads and gravity stay, as with `moves`. The start is an equilibrium with the prestrains of `load_factor`.
    stop : mapping, optional
        Quantities -> values at which the path ends, the first that is met, located to round-off, with an event "wanted": ("tip",
        "z") is a coordinate (m) of a point of `points`, ("tip", "N") one of N, Q2, Q3, T, M2, M3 of the beam there, the name of a
        slider its arc length, a function of the state what it returns. What passes its value twice within a step is missed.

    Returns
    -------
    Result
        Rows are equilibria along the path, `result.t` its length; `series["load_factor"]`, `series["unstable_directions"]` (NaN
        where moments leave the number open). Critical points are rows, too; `info["critical_points"]` lists them: kind ("limit"
        or "bifurcation"), type ("maximum", "minimum"; "supercritical", "subcritical", "transcritical", "multiple", "unknown"),
        load_factor, length, row, mode (displacements [N, 3] of all nodes, largest 1), mode_sliders (of sliders [S]), mode_at (the
        node that moves most); of the bifurcation that stop_at= ends at also multiplicity, branches
        (directions that lead away, as components along the vectors that vanish together) and continuum (whether they are two
        opposite ones of a continuum, as of a column that may bend to all sides; those in the plane of a planar scene first).
        An event "plane" says that critical points out of the plane are not known, because only the plane holds the scene.

    Raises
    ------
    SceneError
        An argument is not usable, or something is held by nothing.
    ConvergenceError
        The smallest step fails, or with stop_at= something changes that cannot be located; carries the last equilibrium and the
        result until then.
    Interrupted
        By Ctrl-C; carries the same.
    """
    begun = begin_path("solve_path", model, start, load_factor, at_time, held, moves, prestrains, backend, max_iterations)
    step = _first_step(to, load_factor, step, largest_step, smallest_step)
    if branch is not None and side is not None:
        raise SceneError("branch: give side= or branch=, not both")
    for name, value in (("branch", branch), ("side", side)):
        if value is not None and start is None:
            raise SceneError(f"{name}: needs a start on a bifurcation, solve_path(model, stop_at='bifurcation').state, and its "
                             "load_factor=")
    model = begun.model
    path = PathWalk(model, begun.solver, points, step, largest_step, smallest_step, most_points, observe,
                    wanted_of(model, stop, points))
    path.aside = begun.aside
    for kind, text in begun.notes:
        path.event(kind, 0.0, text)
    begun.strains.watch([*path.observer.points.sections, *(x.section for x in path.wanted)])
    return path.to(to, stop_at, branch if side is None else (1 - side) // 2)


class Begun(NamedTuple):
    """Beginning of a path of equilibria."""

    model: Model                     # for runs with its prestrains
    solver: PathSolver
    aside: str                       # why critical points out of the plane are not known; empty where they are, or in space
    notes: list[tuple[str, str]]     # kinds and texts of events of the start
    strains: ReferenceStrains


def begin_path(who: str, model: Model, start: State | None, load_factor: float, at_time: float | tuple[float, float] | None,
               held: bool | str | Sequence[str], moves: Mapping[Support, ArrayLike] | None,
               prestrains: Mapping[Beam, float] | None, backend: str, max_iterations: int = 15) -> Begun:
    """Check what grows with a load factor, as `solve_path` is given it, and put a solver to the start.

    Parameters
    ----------
    who : str
        Name of the analysis in messages.

    Raises
    ------
    SceneError
        An argument is not usable, or something is held by nothing.
    """
    check_model(who, model)
    stays = held_sliders(model, held)
    require(Analysis.PATH, model, who, stays)
    if at_time is None or isinstance(at_time, tuple):
        require(Analysis.TIMELESS_SHAPES, model, who, stays)
    check_backend(backend)
    growing = _growing(who, model, stays, at_time, moves, prestrains)
    model = growing.strains.own(model)
    start, notes = _checked_start(who, model, start, growing)
    task = _Task(who, model, start, load_factor, stays, max_iterations, backend, growing)
    return Begun(model, *task.first_solver(at_time), notes, growing.strains)


class _Growing(NamedTuple):
    """Loads, supports and prestrains that change with the load factor."""

    factors: tuple[Array, Array]             # of loads [K] at load factor 0, and their change until 1
    laws: LawPath                            # forces by laws
    acts: bool                               # whether these, or drives, grow
    moved: dict[int, Array]                  # supports that are shifted and turned
    strains: ReferenceStrains                # prestrains
    rides: tuple[float, float] | None        # times at which supports are where their functions have them


@dataclass(frozen=True)
class _Task:
    """Task of a path, its arguments tested."""

    who: str
    model: Model
    start: State | None
    load_factor: float
    stays: Array
    max_iterations: int
    backend: str
    growing: _Growing

    def solver(self, at: State | None, factor: float, flat: bool | None) -> PathSolver:
        """Make a solver that begins at a state of this load factor."""
        model, grows = self.model, self.growing
        found = PathSolver(model, at, self.max_iterations, self.stays, flat, self.backend, grows.factors, factor, grows.laws,
                           grows.strains)
        if grows.moved:
            begin = model.q0 if self.start is None else self.start.q
            found.motion = StaticShift(found.stepper.model, grows.moved, begin, self.load_factor)
        if grows.rides is not None:
            ride = SupportPath(found.stepper.model, found.state, True, grows.rides, self.who)
            ride.check_stands(self.who, factor, coordinates_of(found.stepper, ride.own))
            if grows.rides[0] != grows.rides[1]:
                found.motion = ride
        return found

    def first_solver(self, at_time: float | tuple[float, float] | None) -> tuple[PathSolver, str]:
        """Make a solver at the start, with a judge in space, or with the reason why there is none. Raises SceneError: the start
        is no equilibrium, or something is held by nothing."""
        model = self.model
        may_leave = model.plane is not None and not model.asked_for_plane
        # the scene leaves its plane with its supports, if it may
        solver = self.solver(self.start, self.load_factor,
                             False if may_leave and leave_plane(model, self.growing.moved) else None)
        if self.start is None and any(not force.grows for force in user_forces(model)) and not solver.balanced():
            raise SceneError(f"{self.who}: user forces that do not grow act at the start, which is not an equilibrium: begin "
                             "with the equilibrium under them, or use grows=True for loads")
        flat = solver.stepper.plane is not None
        check_supports(model, flat)
        if model.motions is not None:
            for t in np.atleast_1d(0.0 if at_time is None else at_time).tolist():
                model.motions.check_stays(self.who, solver.state, model.place("motions"), t)
        aside = free_aside(model) if flat and may_leave else ""
        if aside:
            return solver, (f"nothing supports the scene in its plane, {aside}: critical points and unstable directions are "
                            "counted in the plane only; fix it there with Pins or Clamps to count those in space")
        if flat and may_leave:
            solver.in_space = lambda at, factor: self.solver(at, factor, False)
        return solver, ""


def _first_step(to: float, load_factor: float, step: float, largest_step: float, smallest_step: float) -> float:
    """Return the length of the first step. Raises SceneError."""
    step = min(step, largest_step)
    if not smallest_step <= step:
        raise SceneError(f"step: needs smallest_step <= step and <= largest_step, got {smallest_step:g}, {step:g} and "
                         f"{largest_step:g}")
    if to == load_factor:
        raise SceneError(f"to: the path begins at load factor {load_factor:g} already; give another `to`")
    return step


def _growing(who: str, model: Model, stays: Array, at_time: float | tuple[float, float] | None, moves: Any,
             prestrains: Any) -> _Growing:
    """Collect what changes with the load factor. Raises SceneError: nothing changes, or one of the arguments is not usable."""
    stays_put = moves is None and prestrains is None
    rides = _rides(who, model, at_time, moves, stays_put)
    # laws that do not grow act in full, as springs do
    by_laws, drives = laws_grow(model), model.slider_forces
    pushed = drives is not None and bool(np.any(~stays & (drives.tables.drive != NO_DRIVE)))
    if stays_put and not np.any(model.loads.entries) and not by_laws and not pushed and rides is None:
        raise SceneError(f"{who}: the scene has no loads to scale; add a Load, a DistributedLoad or gravity, use "
                         "UserForce(grows=True), move supports, moves={clamp: (0, 0, -0.1)}, or strain beams, prestrains={beam: "
                         "-0.01}")
    moved = {} if moves is None else _moves(who, model, moves)
    strains = ReferenceStrains() if prestrains is None else _prestrains(who, model, prestrains)
    laws = law_path(who, model, at_time, stays_put)
    if stays_put or isinstance(at_time, tuple):
        factors = load_path(who, model, at_time, by_laws and laws.moves or rides is not None)
    else:
        stay = load_factors_at(who, model, at_time)
        factors = stay, np.zeros_like(stay)
    return _Growing(factors, laws, by_laws or pushed, moved, strains, rides)


def _checked_start(who: str, model: Model, start: State | None, growing: _Growing
                   ) -> tuple[State | None, list[tuple[str, str]]]:
    """Check a start; return it and its events. Raises SceneError: it is missing, or is none."""
    if start is None and (np.any(growing.factors[0]) and np.any(model.loads.entries) or growing.acts and growing.laws.begins):
        raise SceneError(f"{who}: the start carries loads already; give the equilibrium to begin from, "
                         "solve_static(model, at_time=...).state")
    notes: list[tuple[str, str]] = []
    if start is not None:
        start, notes = check_start(model, start, 1.0, at_rest=True)
    return start, notes


def _rides(who: str, model: Model, at_time: float | tuple[float, float] | None, moves: Any, grow: bool
           ) -> tuple[float, float] | None:
    """Return times at load factors 0 and 1 at which supports that move are where their functions have them; None where they
    stay."""
    if model.prescribed is None or at_time is None:
        return None
    if isinstance(at_time, tuple):
        if moves is not None:
            raise SceneError(f"{who}: {model.prescribed.motions[0].label} moves between the times of at_time=, and supports "
                             "in moves= with the load factor too; give one time, or leave moves out")
        return at_time
    return (0.0, at_time) if grow else (at_time, at_time)


def _moves(who: str, model: Model, moves: Any) -> dict[int, Array]:
    """Return displacements and rotation vectors of nodes that supports hold, (6,) each. Raises SceneError."""
    if not isinstance(moves, Mapping) or not moves:
        raise SceneError(f"{who}, moves: must be a mapping {{support or its node: displacement (3,) in m, or (6,) with a "
                         f"rotation vector in rad}}, got {shown(moves)}")
    held, out = standing_supports(model), {}
    for what, value in moves.items():
        vector = numbers(value)
        if vector is None or vector.shape not in ((3,), (6,)) or not np.all(np.abs(vector) <= LARGEST):
            raise SceneError(f"{who}, moves: displacement of {shown(what)} must be 3 finite numbers, m, or 6 with a "
                             f"rotation vector, rad, got {shown(value)}")
        vector = np.concatenate((vector, np.zeros(6 - vector.size)))
        turns = vector[3:].any()
        axes = int(np.sum(np.array([1, 2, 4])[vector[:3] != 0.0]))
        if axes or turns:
            node = supported(f"{who}: moves=", model, what, held, axes)
            if turns:
                check_turned(f"{who}: moves=", model, node, held)
            out[node] = vector
    if not out:
        raise SceneError(f"{who}, moves: all displacements and turns are zero, got " + shown(moves))
    return out


def _prestrains(who: str, model: Model, prestrains: Any) -> ReferenceStrains:
    """Return reference strains whose prestrains change until load factor 1. Raises SceneError: no mapping of beams of the scene
    to finite numbers, or all are zero."""
    if not isinstance(prestrains, Mapping) or not prestrains:
        raise SceneError(f"{who}, prestrains: must be a mapping {{beam: change of its prestrain}}, got {shown(prestrains)}")
    out = []
    for beam, value in prestrains.items():
        span = span_of(f"{who}, prestrains", model, beam)
        number = real(value)
        if number is None or not LEAST <= beam.start_strain[0] + number <= MOST:
            raise SceneError(f"{who}, prestrains: {beam.label} would have a prestrain of {beam.start_strain[0]:.6g} + "
                             f"{shown(value)} at load factor 1; it must be a number from {LEAST:g} to {MOST:g}")
        if number:
            out.append((span, number))
    if not out:
        raise SceneError(f"{who}, prestrains: all changes are zero, got {shown(prestrains)}")
    return ReferenceStrains(out)
