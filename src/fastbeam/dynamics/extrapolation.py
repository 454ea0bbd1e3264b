"""Order four with dissipation, and for reactions: conserving steps of h and of h/2, extrapolated (theory.md 6)."""
from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fastbeam.dynamics.checkpoint import Clock
from fastbeam.dynamics.kinks import Kinks
from fastbeam.dynamics.options import Output, Start
from fastbeam.interface.errors import ConvergenceError, Interrupted, ResultFileError, SceneError
from fastbeam.interface.paths import check_new
from fastbeam.kernels.contact.slider_forces import DRIVE_WORK, FRICTION_LOSS, HISTORY, LOCK_LOSS, STOP_LOSS
from fastbeam.kernels.state import State
from fastbeam.model.analyses import Analysis, lacking
from fastbeam.model.maps import spins
from fastbeam.model.model import Model
from fastbeam.model.start import check_start
from fastbeam.results.result import Result
from fastbeam.scene.prescribed_motion import axial

Array = np.ndarray
# two runs that differ by more, of the size of the scene, are no longer in the range in which errors go with h^2
NEAR = 0.05


# for messages: the runs that need two
WHICH = "order=4 with dissipation, or with 'reaction' observed, extrapolates from two runs"


def extrapolates(model: Model, observed: Collection[str] = ()) -> bool:
    """Return whether order 4 takes two runs: something dissipates, or reactions are recorded, which are means over whole steps;
    and nothing has a kink in time."""
    dissipates = any(lacking(Analysis.COMPOSED, model)) or "reaction" in observed
    return dissipates and not any(lacking(Analysis.ORDER_4, model))


def check_two_runs(tolerance: Any, callback: Any, checkpoint: Any) -> None:
    """Refuse options that need one state on the way. Raises SceneError."""
    given = [name for name, x in (("tolerance", tolerance), ("callback", callback), ("checkpoint", checkpoint)) if x is not None]
    if given:
        raise SceneError(f"{given[0]}: {WHICH}, and has no {given[0]} for the extrapolated run; leave it out, or use order=2")


def between(coarse: Array, fine: Array) -> Array:
    """Return (4 fine - coarse)/3; equal numbers stay as they are."""
    return np.asarray(fine + (fine - coarse) / 3.0)


def triads_between(coarse: Array, fine: Array) -> Array:
    """Extrapolate triads [..., 3, 3], directors in rows: on from fine by a third of the rotation from coarse to fine."""
    turn = np.einsum("...ia,...ib->...ab", fine, coarse)
    axis = 0.5 * axial(turn)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    angle = np.arctan2(sine, 0.5 * (np.trace(turn, axis1=-2, axis2=-1)[..., None] - 1.0)) / 3.0
    axis = axis / np.where(sine > 0.0, sine, 1.0)
    # Rodrigues' formula on every director
    n = axis[..., None, :]
    c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
    return np.asarray(c * fine + s * np.cross(n, fine) + (1.0 - c) * np.sum(n * fine, axis=-1, keepdims=True) * n)


def state_between(model: Model, coarse: State, fine: State, step: float) -> State:
    """Return the extrapolated state, corrected to the nearest one that joints and sliders allow."""
    q, v = np.zeros((model.n_nodes, 4, 3)), np.zeros((model.n_nodes, 4, 3))
    (q1, v1), (q2, v2) = ((x.q.reshape(-1, 4, 3), x.v.reshape(-1, 4, 3)) for x in (coarse, fine))
    q[:, 0], v[:, 0] = between(q1[:, 0], q2[:, 0]), between(v1[:, 0], v2[:, 0])
    q[:, 1:] = triads_between(q1[:, 1:], q2[:, 1:])
    v[:, 1:] = np.cross(between(spins(q1, v1), spins(q2, v2))[:, None], q[:, 1:])
    history = between(coarse.history, fine.history)
    # flags of sliders stand beside their energies
    flags = np.setdiff1d(np.arange(HISTORY), (FRICTION_LOSS, DRIVE_WORK, STOP_LOSS, LOCK_LOSS))
    own, known = (model.along_of(x) for x in (history, fine.history))
    own[:, flags] = known[:, flags]
    state = State(q.reshape(-1), v.reshape(-1), between(coarse.s, fine.s), fine.force.copy(), history)
    try:
        return check_start(model, state, step, mend=True)[0]
    except SceneError:
        return state


def difference(model: Model, coarse: Result, fine: Result) -> float:
    """Return the largest distance of nodes of the two runs in shapes and at the end, as a share of the size of the scene."""
    end = (fine.state.q - coarse.state.q).reshape(-1, 12)[:, :3]
    far = [float(np.max(np.linalg.norm(end, axis=-1), initial=0.0))]
    if len(fine.t_snap) == len(coarse.t_snap):
        far.append(float(np.max(np.linalg.norm(fine.phi - coarse.phi, axis=-1), initial=0.0)))
    return max(far) / model.length


def combine(model: Model, coarse: Result, fine: Result, step: float, t_end: float) -> Result:
    """Return the result of order 4: every row is linear in those of the two runs, so that it conserves what they conserve,
    balance and momenta.

    coarse, fine: runs with steps `step` and half of it, s.
    Raises ConvergenceError: one of them ended before t_end.
    """
    for run in (coarse, fine):
        if run.state is None or run.t[-1] != t_end:
            why = run.events[-1]["text"] if run.events else "it ended early"
            raise ConvergenceError(f"{WHICH}, and one of them ended at t = {run.t[-1]:g} s: {why}; end the run before that, or "
                                   "use order=2",
                                   step=int(run.info["steps"]), time=float(run.t[-1]), state=run.state)
    rows = [np.flatnonzero(np.isin(a.t, b.t)) for a, b in ((coarse, fine), (fine, coarse))]
    shapes = [np.flatnonzero(np.isin(a.t_snap, b.t_snap)) for a, b in ((coarse, fine), (fine, coarse))]
    series = {}
    for name, x in fine.series.items():
        a, b = coarse.series[name][rows[0]], x[rows[1]]
        if name == "iterations":
            # iterations of both runs, for one step
            series[name] = a + 2 * b
        elif name == "step_size":
            series[name] = a
        elif name == "point_directors":
            series[name] = triads_between(a, b)
        else:
            series[name] = between(a, b)
    a, b = coarse.info, fine.info
    info = {**b, "method": f"{b['method']}, two runs extrapolated", "order": 4, "step": step, "steps": a["steps"],
            **{name: a[name] + b[name] for name in ("iterations", "fallbacks", "wall_time")},
            "scale": {name: max(x, a["scale"].get(name, 0.0)) for name, x in b["scale"].items()},
            "difference": difference(model, coarse, fine)}
    known = {(event["kind"], event["text"]) for event in fine.events}
    events = [*fine.events, *(event for event in coarse.events if (event["kind"], event["text"]) not in known)]
    if not info["difference"] <= NEAR:
        text = (f"order=4: the runs with steps of {step:g} and {0.5 * step:g} s differ by {info['difference']:.2g} of the size "
                "of the scene. This difference is too large to estimate the error of both; use smaller steps, or a shorter run")
        events.append({"kind": "extrapolation", "time": t_end, "text": text})
    velocities, spins = (None if b is None else between(a[shapes[0]], b[shapes[1]]) for a, b in (
        (coarse.velocities, fine.velocities), (coarse.spins, fine.spins)))
    mesh = None
    if coarse.mesh is not None and fine.mesh is not None:
        a, b = coarse.mesh[shapes[0]], fine.mesh[shapes[1]]
        mesh = np.concatenate((between(a[:, :, :1], b[:, :, :1]), triads_between(a[:, :, 1:], b[:, :, 1:])), axis=2)
    result = Result(t=fine.t[rows[1]], series=series, model_text=fine.model_text, info=info, names=fine.names,
                    t_snap=fine.t_snap[shapes[1]], phi=between(coarse.phi[shapes[0]], fine.phi[shapes[1]]),
                    directors=triads_between(coarse.directors[shapes[0]], fine.directors[shapes[1]]), velocities=velocities,
                    spins=spins, mesh=mesh, events=events)
    result.state, result._moving = state_between(model, coarse.state, fine.state, step), model.moving
    result.checkpoint = Clock(t_end, t_end, step, step, t_end).checkpoint(model, result.state, False, None)
    return result


def ended_alone(error: BaseException, runs: list[Result], step: float, output: Output) -> BaseException:
    """Return the error to raise where one of the two runs did not come to its end: its result is that of one run, of order 2, and
    says so; it is written to the file that was asked for.

    runs: runs that are complete.
    step: step of the first run, s.
    """
    result = getattr(error, "result", None) or (runs[-1] if runs else None)
    if not isinstance(result, Result):
        return error
    second = len(runs) > 0 and result is not runs[0]
    text = (f"this is the {('second' if second else 'first')} of the two runs that order=4 with dissipation extrapolates, "
            f"without the other: steps of {(0.5 if second else 1.0) * step:g} s, errors of second order")
    result.events.append({"kind": "extrapolation", "time": float(result.t[-1]), "text": text})
    if output.file is not None:
        try:
            result.save(output.file, overwrite=output.overwrite)
        except ResultFileError as failed:
            result.events.append({"kind": "file", "time": float(result.t[-1]), "text": str(failed)})
    if isinstance(error, KeyboardInterrupt) and not isinstance(error, Interrupted):
        # between the runs, or while one of them was being prepared
        error = Interrupted("the run was interrupted", result=result, state=result.state, checkpoint=result.checkpoint)
    if isinstance(error, ConvergenceError):
        error.result = result
    if isinstance(error, Interrupted | ConvergenceError):
        error.args = (f"{error.args[0]}; {text}", *error.args[1:])
    return error


def of_two_runs(run: Callable[..., Result], model: Model, start: Start, t_end: float, step: float, every: int | None,
                output: Output, options: dict[str, Any]) -> Result:
    """Run order 4 with what dissipates, or with reactions; the step becomes a whole part of the time, so that rows are the same.
    run: `simulate`."""
    if output.file is not None:
        check_new("result file", Path(output.file), Path(output.file), output.overwrite)
    t_start = start.time
    n = max(1, math.ceil((t_end - t_start) / step * (1.0 - 1e-12)))
    every = max(1, n // 500) if every is None else min(every, n)
    step = (t_end - t_start) / n
    kinks = Kinks(model, step)
    kinks(t_start, start.state or model.state())
    runs: list[Result] = []
    try:
        for k in (1, 2):
            runs.append(run(model, start=start, t_end=t_end, step=step / k, every=k * every, output=replace(output, file=None),
                            callback=kinks if k == 2 and kinks.groups else None, **options))
        result = combine(model, *runs, step, t_end)
    except (KeyboardInterrupt, Exception) as error:
        raised = ended_alone(error, runs, step, output)
        if raised is not error:
            raise raised from error
        raise
    result.events += kinks.events
    if output.file is not None:
        result.save(output.file, overwrite=output.overwrite)
    return result
