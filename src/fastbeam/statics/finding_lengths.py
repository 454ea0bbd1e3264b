"""Equilibria in which unstressed lengths of beams are unknowns, one for every condition: dropper lengths, sag (theory.md 12)."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fastbeam.interface.arguments import Anything, Count, Number, Word, checked, shown
from fastbeam.interface.errors import ConvergenceError, SceneError
from fastbeam.interface.result_warnings import warns
from fastbeam.interface.synonyms import known
from fastbeam.kernels.loop import OK, SINGULAR
from fastbeam.kernels.state import State
from fastbeam.linalg.linear_system import check_backend
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.forces.loads import load_factors_at
from fastbeam.model.model import Model, check_model
from fastbeam.results.observe.observer import OBSERVED, POINTS
from fastbeam.results.observe.resultants import span_of
from fastbeam.results.progress import Progress
from fastbeam.results.result import Result
from fastbeam.scene import Beam
from fastbeam.scene.checks import Place
from fastbeam.statics.load_steps import KEPT, LONG, LoadSteps, StaticTask
from fastbeam.statics.path_stops import wanted_of
from fastbeam.statics.static_analysis import SHARE, START, held_sliders, solve_static, which_sliders
from fastbeam.statics.unknown_lengths import DEPENDENT, UNMOVED, Condition, Lengths, LengthSolver, conditions_of

Array = np.ndarray
MASSES = ("kept", "per_length")
# iterations up to which the next step is twice as long
FEW = 6
# a part of a combination of conditions or lengths that is told of, next to the largest; how many are told of
PART, MOST = 0.1, 6


@dataclass(frozen=True)
class LengthTask(StaticTask):
    """Task of `find_lengths`, its arguments tested."""

    unknown: Lengths
    conditions: list[Condition]

    def solver(self) -> LengthSolver:
        assert self.start is not None
        return LengthSolver(self.unknown, self.start, self.max_iterations, self.stays, self.backend, self.at_time or 0.0,
                            self.factors, self.conditions)


class LengthSteps(LoadSteps):
    """Steps of conditions from their first to their wanted values, with a row for each.

    mass: see `find_lengths`.
    Raises SceneError: something is held by nothing, what is observed does not exist, or the lengths do not move the conditions.
    """

    task: LengthTask
    solver: LengthSolver

    def __init__(self, task: LengthTask, mass: str) -> None:
        names = [beam.name for beam in task.unknown.beams]
        super().__init__(task, "lengths", series={"prestrains": (len(task.conditions),)}, names={"lengths": names})
        self.info["mass"] = mass
        # loads act in full, at their time
        self.solver.set_time(task.at_time or 0.0, 1.0)
        _check_influence(self.solver.influence(), task.unknown.beams, task.conditions)
        task.unknown.strains.watch(self.observer.points.sections)

    def _also(self) -> dict[str, Any]:
        return {"prestrains": self.solver.prestrains.copy()}

    def _finish(self) -> Result:
        result, unknown, prestrains = super()._finish(), self.task.unknown, self.solver.prestrains
        names = [beam.name for beam in unknown.beams]
        shares = (1.0 - prestrains) / (1.0 - unknown.first) if self.info["mass"] == "per_length" else np.ones(len(names))
        for key, values in (("prestrains", prestrains), ("unstressed_lengths", (1.0 - prestrains) * unknown.lengths),
                            ("mass_factors", shares)):
            result.info[key] = dict(zip(names, values.tolist()))
        return result

    def _climb(self, step: float, largest: float, bar: Progress) -> None:
        task, solver, first = self.task, self.solver, step
        reached = 0.0
        self._record(0.0, 0, 0.0)
        while reached < 1.0:
            solver.interrupts.serve()
            target = 1.0 if reached + step > 1.0 - 1e-12 else reached + step
            solver.move_to(target)
            status, sizes = solver.equilibrium(task.factors)
            if status == OK:
                solver.history.append(len(sizes))
                self._record(target, len(sizes), target - reached)
                bar.update(target - reached)
                reached, solver.may_leap = target, False
                step = min(largest, step * (2.0 if len(sizes) <= FEW else 1.4 if len(sizes) <= LONG else 1.0))
            elif step > task.smallest_step * (1.0 + 1e-12):
                step = max(task.smallest_step, 0.25 * step)
            elif not solver.may_leap:
                # none nearby: whatever equilibrium there is
                solver.may_leap, step = True, first
            else:
                raise self._failure(status, sizes, reached)

    def _judge(self) -> None:
        for share, extent in self.solver.leaps:
            text = (f"at a share of {share:.6g} of the conditions no equilibrium was found nearby, and a more distant one was "
                    f"used (motion of {extent:.3g}, in sizes of the scene and rad). Lengths or sliders jump there, for example "
                    "when a slider passes an element end of a mesh that is too coarse")
            self.event("leap", share, text)
        super()._judge()

    def _failure(self, status: int, sizes: list[float], reached: float) -> ConvergenceError:
        solver, result = self.solver, self._finish()
        told = [f"{one.wanted.label} is {value:.6g} of {one.wanted.value:.6g}"
                for one, value in zip(self.task.conditions, solver.values())]
        off = np.argsort(-np.abs(solver.values() - solver.asked), kind="stable")[:MOST]
        why = ("lengths do not affect the conditions there any more, or a part can move freely" if status == SINGULAR else
               "there may be no equilibrium beyond it, or a prestrain would leave the range from -10 to 0.99")
        text = f"find_lengths: the smallest step fails at a share of {reached:.6g} of the conditions"
        error = ConvergenceError(f"{text}, {', '.join(told[k] for k in off)}; {why}. {KEPT}"
                                 + self.look_at_mesh(reached, self.solver.state),
                                 step=len(solver.history), time=reached, residuals=sizes, state=result.state, result=result)
        return solver.stepper.blamed(error, text, KEPT)


@warns
@checked(model=Anything(), lengths=Anything(), conditions=Anything(), points=POINTS, start=START, at_time=Number(unit="s"),
         mass=Word(MASSES), observe=OBSERVED, held=which_sliders, step=SHARE, largest_step=SHARE, smallest_step=SHARE,
         max_iterations=Count(most=10_000), backend=Word())
def find_lengths(model: Model, lengths: Sequence[Beam | str], conditions: Mapping[tuple[str, str] | str, float], *,
                 points: Mapping[str, Place] | None = None, start: State | None = None, at_time: float | None = None,
                 mass: str = "kept", observe: Sequence[str] = ("energy",), held: bool | str | Sequence[str] = False,
                 step: float = 0.25, largest_step: float = 1.0, smallest_step: float = 1e-4, max_iterations: int = 20,
                 backend: str = "auto") -> Result:
    """Find unstressed lengths of beams with which conditions hold in equilibrium under the loads of the scene: droppers whose
    wire is level, cables with a given sag or tension (theory.md (12.4)).

    Parameters
    ----------
    model : Model
        Held as for `solve_static`.
    lengths : sequence of Beam or str
        Beams, or their names, whose unstressed lengths are unknowns, as many as conditions; of a net its beams, `net.beam(k)`.
        Lengths are (1 - e) L: L as drawn, e the prestrain (theory.md (2.8)), from -10 to 0.99. The scene gives the first ones.
    conditions : mapping
        Quantities -> values, as `stop=` of `solve_path`: ("middle", "z") is a coordinate (m) of a point of `points`, ("middle",
        "N") one of N, Q2, Q3 (N), T, M2, M3 (N m) of the beam there, the name of a slider its arc length (m). Functions of the
        state are refused.
    points : mapping
        As in `simulate`.
    start : State
        A shape near the equilibrium with the first lengths, as that of `solve_static` or `relax`; default: `solve_static` finds
        it. There the conditions begin, and are led straight to their values.
    at_time : float
        Where time functions of loads and supports are evaluated, s, as in `solve_static`.
    mass : {'kept', 'per_length'}
        Whether a beam weighs what the scene says at any length, as one that is stretched, or in proportion to its unstressed
        length, as one that is cut; the length of the scene has the mass of the scene. Loads along a beam stay.
    observe : sequence of str
        As in `solve_static`.
    held : bool, str or sequence of str
        Sliders that stay where they are, as in `solve_static`; those that are free slide. Friction, drives, stops and locks of
        free ones are refused, as in `solve_path`.
    step, largest_step, smallest_step : float
        First, largest and smallest part of the way of all conditions that is gone at once, all in (0, 1].
    max_iterations : int
        Newton iterations a step.
    backend : {'auto', 'pardiso', 'superlu'}

    Returns
    -------
    Result
        As that of `solve_static`: rows are steps, `result.t` the part of the way, `.state` the equilibrium,
        `info["unstable_directions"]` the negative eigenvalues of its tangent, the lengths being kept. `series["prestrains"]`
        [n, m] in the order of `lengths`; `info["prestrains"]`, `info["unstressed_lengths"]` (m) and `info["mass_factors"]` (what
        `mass="per_length"` multiplies masses by, else 1) by names of the beams. A scene whose beams have these prestrains is in
        equilibrium there; `section_forces`, `modes` and `simulate` need that scene, compiled anew.

    Raises
    ------
    SceneError
        A scene that is not compiled, an argument out of range, beams or quantities that do not exist, not as many lengths as
        conditions, lengths that do not move the conditions at the start, something that is held by nothing.
    ConvergenceError
        There is no equilibrium at the start, or the smallest step fails; carries the last equilibrium and the result until then.
    Interrupted
        By Ctrl-C; carries the same.

    Examples
    --------
    >>> import fastbeam as fb
    >>> steel = fb.Section.circle(radius=0.01, E=2e11, rho=7800.0)
    >>> rod = fb.Beam.straight('rod', (0, 0, 0), (0, 0, -2), section=steel, elements=2)
    >>> model = fb.compile_scene(fb.Scene(rod, fb.Clamp(rod.start), fb.Load('pull', rod.end, force=(0, 0, -1e4))))
    >>> found = fb.find_lengths(model, ['rod'], {('tip', 'z'): -2.0}, points={'tip': rod.end})
    >>> f"{found.info['unstressed_lengths']['rod']:.6f}"
    '1.999682'
    """
    check_model("find_lengths", model)
    stays = held_sliders(model, held)
    require(Analysis.LENGTHS, model, held=stays)
    check_backend(backend)
    step = min(step, largest_step)
    if not smallest_step <= step:
        raise SceneError(f"step: needs smallest_step <= step and <= largest_step, got {smallest_step:g}, {step:g} and "
                         f"{largest_step:g}")
    unknown = Lengths(model, _beams_of(model, lengths), mass == "per_length")
    model = unknown.model
    wanted = wanted_of(model, {} if conditions is None else conditions, points, "find_lengths, conditions")
    asked = conditions_of(model, wanted, conditions, points, stays)
    if len(asked) != len(unknown.beams):
        raise SceneError(f"find_lengths: needs as many unknown lengths as conditions, {len(asked)}, got {len(unknown.beams)}; "
                         f"name {('more' if len(asked) > len(unknown.beams) else 'fewer')} beams, or conditions")
    factors = load_factors_at("find_lengths", model, at_time)
    first = solve_static(model, start=start, raise_loads=start is None, at_time=at_time, held=held,
                         max_iterations=max_iterations, backend=backend)
    task = LengthTask(unknown.model, first.state, [], factors, [1.0], stays, [], smallest_step, at_time, observe, points,
                      max_iterations, backend, None, False, "mesh", None, unknown, asked)
    return LengthSteps(task, mass).find(step, largest_step)


def _beams_of(model: Model, lengths: Any) -> list[Beam]:
    """Return the beams whose lengths are asked for. Raises SceneError: they are not in the scene, stand twice, or there are
    none."""
    if isinstance(lengths, (str, bytes, Mapping, Beam)) or not isinstance(lengths, Sequence) or not lengths:
        raise SceneError(f"find_lengths, lengths: must be beams or names of beams, as in ['dropper 1', 'dropper 2'], got "
                         f"{shown(lengths)}")
    scene = getattr(model.uneliminated, "scene", None)
    named = {beam.name: beam for beam in (() if scene is None else scene.beams)}
    out: list[Beam] = []
    for one in lengths:
        if isinstance(one, str):
            if one not in named:
                raise SceneError(f"find_lengths, lengths: scene {model.scene_name!r} has no beam {one!r}; its beams are "
                                 f"{known(named, one)}; of a net name net.beam(k)")
            one = named[one]
        span_of("find_lengths, lengths", model, one)
        if any(one is other for other in out):
            raise SceneError(f"find_lengths, lengths: {one.label} is listed twice; each length is one unknown")
        out.append(one)
    return out


def _check_influence(found: tuple[Array, Array] | None, beams: list[Beam], conditions: list[Condition]) -> None:
    """Refuse lengths that do not move the conditions at the start, each by itself. Raises SceneError."""
    if found is None:
        # without stiffness of its own, as a slack net: conditions may give it some
        return
    by, moved = found
    seen = np.abs(by) > UNMOVED * moved
    labels, names = [one.wanted.label for one in conditions], [beam.label for beam in beams]
    for j in np.flatnonzero(~seen.any(axis=1)):
        raise SceneError(f"find_lengths: no length affects {labels[j]} at the start; name beams that carry the part in question, "
                         "or give a start= in which they are not slack")
    for k in np.flatnonzero(~seen.any(axis=0)):
        raise SceneError(f"find_lengths: the length of {names[k]} affects none of the conditions at the start; name another beam")
    scaled = by / np.max(np.abs(by), axis=1, keepdims=True)
    scaled /= np.max(np.abs(scaled), axis=0)
    left, sizes, right = np.linalg.svd(scaled)
    if sizes[-1] <= DEPENDENT * sizes[0]:
        rows, columns = (", ".join(text[k] for k in np.flatnonzero(np.abs(x) > PART * np.max(np.abs(x)))[:MOST])
                         for text, x in ((labels, left[:, -1]), (names, right[-1])))
        raise SceneError(f"find_lengths: conditions and lengths do not match at the start: lengths of {columns} can change "
                         f"together without any effect on the conditions, and no lengths affect {rows} independently; choose "
                         "other beams or conditions")
