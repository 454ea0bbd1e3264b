"""Equilibrium: Newton on the unknowns of every node with load steps that adapt (theory.md 8)."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fastbeam.dynamics.options import MENDED, START, Group, Start, shape_of_start
from fastbeam.interface.arguments import (
    Anything,
    Count,
    Flag,
    Listing,
    Name,
    Number,
    Numbers,
    Refusal,
    Word,
    checked,
    shown,
)
from fastbeam.interface.deprecation import regrouped
from fastbeam.interface.errors import ConvergenceError, Interrupted, SceneError, carry
from fastbeam.interface.result_warnings import warns
from fastbeam.interface.synonyms import its_sliders
from fastbeam.kernels.state import State
from fastbeam.linalg.linear_system import check_backend
from fastbeam.model.analyses import Analysis, require
from fastbeam.model.forces.loads import load_factors_at
from fastbeam.model.model import Model, check_model
from fastbeam.results.observe.observer import OBSERVED, POINTS
from fastbeam.results.result import Result
from fastbeam.scene.checks import Place
from fastbeam.statics.dynamic_relaxation import relax
from fastbeam.statics.load_steps import LoadSteps, StaticTask
from fastbeam.statics.steady_motion import Spin, Travel, check_steady, which_steady_motion

Array = np.ndarray
# what load steps are multiplied by in the second attempt, where the first led to an unstable equilibrium, and the largest then
SMALLER = 0.2
SHARE = Number(above=0.0, most=1.0)
CONTACTS = ("mesh", "exact")
# load factor and load step of a failure below which the scene counts as far from an equilibrium, and steps of its relaxation
FAR, RELAXED_STEPS = 1e-3, 1000
RELAXED = ("no equilibrium was found near the start, at load factor {:.3g}: the shape was relaxed under the full loads, as by "
           "fb.relax, to one of the equilibria, and there are no load steps on the way")


def which_sliders(value: Any) -> bool | tuple[str, ...]:
    """Check that an argument is True, False, a name or names of sliders. Raises Refusal."""
    need = "must be True (all), False (none), or names of sliders, as in ('ring',)"
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    try:
        names = Listing(Name(), need)((value,) if isinstance(value, str) else value)
    except Refusal:
        raise Refusal(f"{need}, got {shown(value)}") from None
    return names




@regrouped("0.2", MENDED)
@warns
@checked(model=Anything(), load_step=SHARE, largest_load_step=SHARE, levels=Numbers((None,), "increasing load factors in (0, 1]"),
         smallest_step=SHARE, at_time=Number(unit="s"), start=Group(Start, START), observe=OBSERVED, points=POINTS,
         max_iterations=Count(most=10_000), backend=Word(), threads=Count(most=1024), held=which_sliders,
         rest_intervals=which_sliders, raise_loads=Flag(), contacts=Word(CONTACTS), steady=which_steady_motion)
def solve_static(model: Model, *, load_step: float = 0.25, largest_load_step: float = 1.0, levels: Sequence[float] | None = None,
                 smallest_step: float = 1e-9, at_time: float | None = None, start: State | Start | None = None,
                 observe: Sequence[str] = ("energy",), points: Mapping[str, Place] | None = None, max_iterations: int = 20,
                 backend: str = "auto", threads: int | None = None, held: bool | str | Sequence[str] = False,
                 rest_intervals: bool | str | Sequence[str] = False, raise_loads: bool = True, contacts: str = "mesh",
                 steady: Spin | Travel | None = None) -> Result:
    """Find the equilibrium under the loads of the scene, raised from zero in steps that adapt to the convergence.

    Parameters
    ----------
    model : Model
        A planar scene has to be held in its plane, any other one in space. Sliders connect what they join; they slide downhill
        from where they are until they do not push along their beams any more. Those with friction stay where it holds them, and
        slip no further than they must; load steps are a slow history of it. Prescribed positions are approached, and forces of
        drives grow, with the load factor; smoothed and viscous friction are none at rest.
    load_step, largest_load_step, smallest_step : float
        First, largest and smallest increment of the load factor, which runs from 0 to 1; all in (0, 1]. At most 200 load steps
        are tried, or twice as many as `largest_load_step` and `levels` make necessary. Where they fail at the first loads, since
        the scene begins far from an equilibrium (a rope drawn with a corner), without `start`, `levels` and `held` the shape is
        relaxed under the full loads as by `relax`, and an event "relaxed" says so.
    levels : sequence of float
        Increasing load factors in (0, 1] that steps end at, so that they have rows; other steps are rows as well.
    at_time : float
        Where time functions of loads and drives are evaluated, s; needed when the scene has some. With it a `PrescribedMotion`
        moves its support with the load factor (displacement control): from the shape of the scene along its function from t = 0
        on, from a `start` straight to its place at that time; steps that lead to another equilibrium than the one
        nearby are divided, an event "leap" tells where the smallest one does. Without it such supports stay where they are.
    start : State or Start
        Begin from this shape instead of the reference; joints have to allow it, supports hold their nodes where it has them.
        ``Start(state, mend=True)`` mends it as in `simulate`.
    observe, points
        As in `simulate`, of 'energy', 'spring', 'section' and 'reaction'; rows are load steps, `result.t` the load factor.
    max_iterations : int
        Newton iterations a load step.
    backend : {'auto', 'pardiso', 'superlu'}
    threads : int
        As in `simulate`; scenes with sliders are solved on one thread.
    held : bool, str or sequence of str
        Names of sliders that stay where they are on their beams, as if clipped to them; True: all. Their contact forces may have
        a part along the beam. Sliders that are locked from the start stay as well.
    rest_intervals : bool, str or sequence of str
        Names of sliders with Coulomb friction, or True for all, whose interval of places of rest is looked for at the end.
    raise_loads : bool
        False: loads and drives act in full from the first step on, and the load factor is how far supports that move, and
        prescribed places of sliders, have gone; for a `start` that is in equilibrium with the loads.
    contacts : {'mesh', 'exact'}
        Whether the force along the beam of sliders and sleeves is that of the elements in which they stand, or exact: beams are
        cut at their contacts, and rows have that equilibrium (theory.md (8.3)). Sleeves count as points, without friction; on
        beams with Lagrange elements that are no part of a net.
    steady : Spin or Travel, optional
        The equilibrium in a steady motion, under its forces of inertia, which grow with the load factor (theory.md 17): in the
        frame that spins, or beside which beams travel, supports stand still. Unstable directions are not counted: `modes(model,
        state=..., steady=...)` tells what grows.

    Returns
    -------
    Result
        With the equilibrium in `.state`, ready as `start` of `simulate`, and place, contact force and gap of every slider in
        rows (`Result.slider`). With `contacts="exact"` the state is that of the given mesh, all sliders held in their exact
        places, and `info["force_along"]` has what holds each of them along its beam, N; NaN where it stands on a node that
        other parts refer to, at an end, or with another. `info["unstable_directions"]` and `info["free_directions"]` count the
        negative and the zero eigenvalues of its tangent, among the motions that sliders allow; any is an event too: a buckling
        or limit load was passed, or is met, or something can move freely; `modes` shows them. `info["free_motions"]` names those
        of the latter that are spins and turns of parts, `["beam 'tie' about its axis"]`, which stay as they are. Where the first
        are not 0, and there is no `start`, and a load step was larger than 0.2, the equilibrium is looked for a second time with
        steps of a fifth, because a large one may end in a remote equilibrium, and that of both with fewer is returned.
        `info["counted_in"]` is "space" or "plane": a planar scene that is held in its plane only, one compiled with planar=True,
        and one whose moments leave it undecided in space are counted in the plane. Moments make the tangent in space
        unsymmetric; then the number is 0 where its symmetric part has no negative eigenvalue, 1 (at least) where its determinant
        is negative, else None (theory.md 8); sliders that friction or a stop holds do not move in it. `info["friction"]` has for
        all sliders, joints and twists in sleeves ("s: twist") with friction its `force`, the most that it could be, `cone`, and
        whether it `sticks`; `info["rest_intervals"]` the arc lengths (from, to) where a slider that was asked for rests, the
        others with friction staying where they are; NaN where that is not found.

    Raises
    ------
    SceneError
        A scene that is not compiled, an argument out of range, something that is held by nothing, a slider that does not exist,
        or is of a kind that contacts='exact' does not know.
    ConvergenceError
        The smallest load step fails, too many are needed, or a slider runs off its beam; carries the last equilibrium and the
        result until then.
    Interrupted
        By Ctrl-C; carries the same.
    """
    check_model("solve_static", model)
    stays = held_sliders(model, held)
    require(Analysis.STATIC, model, held=stays)
    asked = _rubbing(model, named_sliders(model, "rest_intervals", rest_intervals), stays, rest_intervals)
    check_backend(backend)
    load_step = min(load_step, largest_load_step)
    if not smallest_step <= load_step:
        raise SceneError(f"load_step: needs 0 < smallest_step <= load_step <= 1, got {smallest_step!r} and {load_step!r}")
    stops = [*([] if levels is None else levels), 1.0]
    if levels is not None and not (len(levels) and levels[0] > 0.0 and levels[-1] <= 1.0 and np.all(np.diff(levels) > 0.0)):
        raise SceneError(f"levels: must be increasing load factors in (0, 1], got {tuple(float(x) for x in levels[:12])}")
    if at_time is None:
        require(Analysis.TIMELESS, model, "solve_static", stays)
    factors = load_factors_at("solve_static", model, at_time)
    if steady is not None:
        check_steady("solve_static", model, steady, factors)
        if model.asked_for_plane:
            raise SceneError("solve_static: steady= is available in space only; compile the scene without planar=True")
    state, notes = (None, []) if start is None else shape_of_start("solve_static", model, start)
    task = StaticTask(model, state, notes, factors, stops, stays, asked, smallest_step, at_time, observe, points, max_iterations,
                      backend, threads, raise_loads, contacts, steady)
    try:
        result = LoadSteps(task).find(load_step, largest_load_step)
    except ConvergenceError as failed:
        return _relaxed(task, failed)
    first = max(SMALLER * load_step, smallest_step)
    large = first < load_step and float(np.max(result.series["step_size"])) > SMALLER
    if result.info["unstable_directions"] and state is None and large:
        return _more_stable(task, result, first, max(first, min(largest_load_step, SMALLER)))
    return result


def _relaxed(task: StaticTask, failed: ConvergenceError) -> Result:
    """Return the equilibrium next to the relaxed shape, where load steps have failed because the scene begins far from any, as a
    rope drawn with a corner. Raises ConvergenceError: this failure, where it has other reasons or relaxation does not help."""
    asks = task.start is not None or len(task.stops) > 1 or np.any(task.stays) or task.asked or task.steady is not None
    if max(failed.time, task.smallest_step) > FAR or asks or not task.raise_loads or task.contacts == "exact":
        raise failed
    try:
        shape = relax(task.model, at_time=task.at_time, finish=False, most_steps=RELAXED_STEPS,
                      max_iterations=task.max_iterations, backend=task.backend)
        near = replace(task, start=shape.state, raise_loads=False, notes=[("relaxed", RELAXED.format(failed.time))])
        found = LoadSteps(near).find(1.0, 1.0)
    except (SceneError, ConvergenceError):
        raise failed from None
    assert failed.result is not None
    found.info["wall_time"] += failed.result.info["wall_time"] + shape.info["wall_time"]
    return found


def _more_stable(task: StaticTask, found: Result, load_step: float, largest: float) -> Result:
    """Return that of two equilibria with fewer unstable directions: `found`, or one that smaller load steps lead to. A large step
    may end in a remote equilibrium; after a buckling or limit load small ones lead to one like the first. Raises Interrupted: by
    Ctrl-C; carries the first."""
    try:
        again = LoadSteps(task).find(load_step, largest)
    except ConvergenceError:
        return found
    except (Interrupted, KeyboardInterrupt):
        raise Interrupted("interrupted during the search for a more stable equilibrium; the one with unstable directions is in "
                          ".state, its rows are in .result", result=found, state=found.state) from None
    except Exception as failed:
        carry(failed, lambda: found)
        raise
    found.info["wall_time"] = again.info["wall_time"] = found.info["wall_time"] + again.info["wall_time"]
    count, where = again.info["unstable_directions"], again.info["counted_in"]
    # moments may leave it undecided in space; fewer in the plane says nothing about space
    fewer = count is not None and count < found.info["unstable_directions"] and where in ("space", found.info["counted_in"])
    return again if fewer else found


def _rubbing(model: Model, asked: Array, stays: Array, given: Any) -> list[int]:
    """Return the numbers of the sliders whose intervals of rest are asked for; given: the argument. Raises SceneError: one of
    them is held, or has no friction that could hold it."""
    forces = model.slider_forces
    rubs = np.zeros(asked.size, bool) if forces is None else forces.hold_by_friction & ~stays
    others = (asked & ~rubs).nonzero()[0]
    if given is not True and others.size:
        name = model.names["sliders"][others[0]]
        raise SceneError(f"rest_intervals: slider {name!r} has no Coulomb friction, or is locked or driven by a prescribed "
                         "motion; name sliders with friction=")
    return (asked & rubs).nonzero()[0].tolist()  # type: ignore[no-any-return]


def held_sliders(model: Model, held: bool | str | Sequence[str]) -> Array:
    """Return which sliders stay in place, bool [S]: those of `held`, and those that are locked from the start. Raises SceneError:
    there is no slider of that name."""
    stays = named_sliders(model, "held", held)
    return stays if model.slider_forces is None else stays | model.slider_forces.locked_at_start


def named_sliders(model: Model, what: str, held: bool | str | Sequence[str]) -> Array:
    """Return which sliders an argument of this name means, bool [S]. Raises SceneError: there is no slider of that name."""
    names = model.names["sliders"]
    if isinstance(held, bool):
        return np.array([held] * len(names), bool)
    for name in held:
        if name not in names:
            raise SceneError(f"{what}: scene {model.scene_name!r} has no slider {name!r}; {its_sliders(names, name)}")
    return np.array([name in held for name in names], bool)
