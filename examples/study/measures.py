"""What is measured: drifts and histories, orders in the step and in the mesh, the largest step, step control.

Every function takes a case and returns numbers that can be written as JSON.
"""
from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

import fastbeam as fb
from methods import Attempt, drifts, newton_per_step, run
from scenes import CASES, Case

Array = np.ndarray
Numbers = dict[str, Any]
# errors below this share of the length are round-off and belong to no order
FLOOR = 2e-13
# interpolations of the convergence in the mesh: label -> arguments of the scene; the first two are those of the paper
MESHES: dict[str, dict[str, Any]] = {
    "bspline 2, control": {"interpolation": "bspline", "degree": 2, "directors": "control"},
    "bspline 3, control": {"interpolation": "bspline", "degree": 3, "directors": "control"},
    "bspline 2, greville": {"interpolation": "bspline", "degree": 2},
    "bspline 3, greville": {"interpolation": "bspline", "degree": 3},
    "lagrange 2": {"degree": 2},
    "lagrange 3": {"degree": 3},
    "lagrange 4": {"degree": 4}}


# ------------------------------------------------------------------------------------------------------- drift and history
def facts(case: Case, model: fb.Model) -> Numbers:
    """What the scene is."""
    beams = case.scene.beams
    return {"letter": case.letter, "text": case.text, "beams": len(beams), "bodies": len(case.scene.bodies),
            "masses": len(case.scene.masses), "sliders": len(case.sliders), "elements": sum(b.n_elements for b in beams),
            "unknowns": int(model.n_unknowns), "t_end": case.t_end, "step": case.step, "length": case.length,
            "period": case.period, "conserved": list(case.conserved)}


def crossed(case: Case, result: fb.Result) -> list[int]:
    """Element ends that each slider crossed over the run, to and fro counted each time."""
    out = []
    for k, slider in enumerate(case.scene.sliders):
        size = slider.beam.length / slider.beam.n_elements
        cell = np.floor(result.series["s_slide"][:, k] / size)
        out.append(int(np.abs(np.diff(cell)).sum()))
    return out


def history(case: Case, model: fb.Model, method: str, scale: float) -> tuple[Numbers, Attempt]:
    """The usual run with one method: drifts, iterations, and thinned series of the energy error and the contact force."""
    attempt = run(case, model, method, step=case.step, scale=scale, every=1)
    result, series = attempt.result, attempt.result.series
    off = np.abs(series["total"] - series["total"][0]) / scale
    out: Numbers = {"status": attempt.status, "time": attempt.time, "reason": attempt.reason, "step": attempt.step,
                    "energy_error": attempt.energy_error, "drift": drifts(case, attempt), "newton": newton_per_step(attempt),
                    "wall_time": float(result.info["wall_time"])}
    # the largest of every bin, so that no peak is lost
    bins = np.array_split(np.arange(len(result.t)), min(120, len(result.t)))
    out["t"] = [_short(result.t[b[-1]]) for b in bins]
    out["energy"] = [_short(np.nan_to_num(off[b], nan=1e30).max(), 3) for b in bins]
    if case.sliders:
        force = np.linalg.norm(series["contact_force"][:, 0], axis=1)
        out["zigzag"] = zigzag(force)
        # a window of neighbouring steps from a quarter of the run on
        first = round(0.25 * case.t_end / case.step)
        window = slice(first, first + 100)
        out["force_t"] = [_short(x) for x in result.t[window]]
        out["force"] = [_short(x, 5) for x in force[window]]
        out["crossed"] = crossed(case, result)
    return out, attempt


def zigzag(x: Array) -> float:
    """Part of a series that alternates from row to row, root mean square over that of the series."""
    if len(x) < 8:
        return math.nan
    x = x[1:-1]
    part = 0.25 * (x[2:] - 2.0 * x[1:-1] + x[:-2])
    return float(np.sqrt(np.mean(part**2) / max(np.mean(x**2), 1e-300)))


def _short(x: float, digits: int = 6) -> float:
    return float(f"{float(x):.{digits}g}")


# --------------------------------------------------------------------------------------------------------- order in the step
def paths(case: Case, attempt: Attempt, rows: int) -> dict[str, Array]:
    """Positions [rows, k], sliding coordinates [rows, sliders] and contact forces at `rows` equal times of a run."""
    result = attempt.result
    every = (len(result.t) - 1) // rows
    pick = slice(every, None, every)
    out = {"position": result.series["points"][pick].reshape(rows, -1)}
    if case.sliders:
        out["s"] = result.series["s_slide"][pick]
        # the force of the last row has only one step beside it
        out["force"] = result.series["contact_force"][pick][:-1].reshape(rows - 1, -1)
    return out


def distance(a: dict[str, Array], b: dict[str, Array], length: float) -> dict[str, float]:
    """Largest distance of two runs: positions and s over the length, forces over the largest force of b."""
    scale = {"position": length, "s": length, "force": float(np.abs(b["force"]).max()) if "force" in b else 1.0}
    return {key: float(np.max(np.abs(a[key] - b[key]))) / scale[key] for key in a}


def orders(sizes: list[float], errors: list[float | None]) -> list[float]:
    """Observed order between neighbours; NaN where an error is missing or at round-off."""
    out = []
    for k in range(1, len(errors)):
        a, b = (math.nan if e is None else e for e in errors[k - 1:k + 1])
        good = math.isfinite(a) and math.isfinite(b) and a > FLOOR and b > FLOOR
        out.append(math.log(a / b) / math.log(sizes[k - 1] / sizes[k]) if good else math.nan)
    return out


def order_in_step(make: Callable[[], Case], methods: list[str], t_end: float, base: int, second: int, fourth: int,
                  rows: int = 10) -> Numbers:
    """Errors over the step size of all methods against the run of order 4 with the smallest step.

    Steps are t_end/(base 2^k), k below `second` for methods of order 2 and below `fourth` for the step of order 4; the phase of
    fast waves, which order 4 resolves long before, asks methods of order 2 for the smaller steps.
    """
    case = make()
    model = fb.compile_scene(case.scene, planar=False)

    def path(method: str, n: int) -> dict[str, Array] | str:
        attempt = run(case, model, method, step=t_end / n, t_end=t_end, every=n // rows)
        return paths(case, attempt, rows) if attempt.status == "done" else attempt.reason

    finest = base * 2 ** max(second - 1, fourth + 1)
    exact = path("em4", finest)
    if isinstance(exact, str):
        raise RuntimeError(f"{case.name}: the reference failed: {exact}")
    out: Numbers = {"t_end": t_end, "reference": t_end / finest, "elements": sum(b.n_elements for b in case.scene.beams),
                    "mesh": repr(case.scene.beams[0]).strip("<>").split(", ", 2)[2], "methods": {}}
    for method in methods:
        counts = [base * 2**k for k in range(fourth if method == "em4" else second)]
        sizes = [t_end / n for n in counts]
        found = [path(method, n) for n in counts]
        errors = [{} if isinstance(x, str) else distance(x, exact, case.length) for x in found]
        entry: Numbers = {"steps": sizes, "failed": {f"{h:.3g}": x for h, x in zip(sizes, found) if isinstance(x, str)}}
        for key in exact:
            e = [x.get(key, math.nan) for x in errors]
            entry[key] = {"error": e, "order": orders(sizes, e)}
        out["methods"][method] = entry
    return out


# --------------------------------------------------------------------------------------------------------- order in the mesh
def order_in_mesh(name: str, strain: str, labels: list[str], meshes: tuple[int, ...], t_end: float, step: float, fine: int,
                  rows: int = 10) -> Numbers:
    """Errors over the number of nodes of several interpolations against one fine mesh of Lagrange elements of degree 5."""
    def path(arguments: dict[str, Any]) -> tuple[int, dict[str, Array] | str]:
        case = CASES[name](strain=strain, **arguments)
        model = fb.compile_scene(case.scene, planar=False)
        attempt = run(case, model, "em4", step=step, t_end=t_end, every=round(t_end / step) // rows)
        nodes = case.scene.beams[0].n_nodes
        return nodes, paths(case, attempt, rows) if attempt.status == "done" else attempt.reason

    length = CASES[name]().length
    _, exact = path({"elements": fine, "degree": 5})
    if isinstance(exact, str):
        raise RuntimeError(f"{name}: the fine mesh failed: {exact}")
    out: Numbers = {"strain": strain, "t_end": t_end, "step": step, "fine": fine, "families": {}}
    for label in labels:
        nodes, errors, failed = [], [], {}
        for elements in meshes:
            n, found = path(MESHES[label] | {"elements": elements})
            nodes.append(n)
            errors.append(math.nan if isinstance(found, str) else distance(found, exact, length)["position"])
            if isinstance(found, str):
                failed[str(elements)] = found
        sizes = [1.0 / (n - 1) for n in nodes]
        out["families"][label] = {"nodes": nodes, "elements": list(meshes), "error": errors, "order": orders(sizes, errors),
                                  "failed": failed}
    return out


# ---------------------------------------------------------------------------------------------------------- the largest step
def largest_step(case: Case, model: fb.Model, method: str, scale: float, bottom: float, span: float,
                 ratio: float = 1.1) -> Numbers:
    """Largest step that a method survives, and the largest with an energy error below the strict bar.

    Steps are halved from a fifth of `span` down until two neighbours pass, so that a step that passes by luck between two
    that fail is not taken; then the limit is refined to `ratio`. All runs have the same span.
    """
    runs: dict[float, Numbers] = {}
    top = span / 5.0

    def probe(h: float) -> Numbers:
        if h not in runs:
            attempt = run(case, model, method, step=h, scale=scale, t_end=span)
            worst = max(drifts(case, attempt).values()) if method.startswith("em") else None
            runs[h] = {"status": attempt.status, "survived": attempt.survived, "strict": attempt.strict, "time": attempt.time,
                       "step": attempt.step, "energy_error": attempt.energy_error, "reason": attempt.reason,
                       "newton": newton_per_step(attempt), "drift": worst}
        return runs[h]

    def limit(criterion: str) -> tuple[float | None, float | None]:
        """(largest step that passes, smallest tried above it that fails); None: none passes, or none fails."""
        h, before, failed = top, None, None
        while h > bottom * 0.999:
            if probe(h)[criterion]:
                if before is not None:
                    break
                before = h
            else:
                failed, before = h, None
            h *= 0.5
        if before is None:
            return None, failed
        good = before
        while failed is not None and failed / good > ratio:
            middle = math.sqrt(good * failed)
            if probe(middle)[criterion]:
                good = middle
            else:
                failed = middle
        return good, failed

    out: Numbers = {"span": span, "top": top, "bottom": bottom}
    for criterion in ("survived", "strict"):
        good, failed = limit(criterion)
        out[criterion] = {"step": good, "failed": failed}
    out["runs"] = [{"h": h, **runs[h]} for h in sorted(runs)]
    return out


# ------------------------------------------------------------------------------------------------------------- step control
def step_control(case: Case, model: fb.Model, order: int, tolerance: float, t_end: float, samples: int = 12) -> Numbers:
    """Run with step control; the true local error of some of its steps comes from running them again with 16 steps of order 4."""
    states: list[tuple[float, Any]] = []

    def keep(t: float, state: Any) -> None:
        if len(states) < 20000:
            states.append((t, type(state)(*(np.array(x) for x in state))))

    out: Numbers = {"order": order, "tolerance": tolerance, "t_end": t_end, "status": "done", "reason": ""}
    start = model.state()
    try:
        result = fb.simulate(model, t_end=t_end, step=case.step, order=order, tolerance=tolerance, points=case.points,
                             output=fb.Output(snapshots=0), progress=False, callback=keep)
    except fb.ConvergenceError as failed:
        result = failed.result
        out |= {"status": "newton", "reason": str(failed).split(";")[0]}
        if result is None:
            raise
    states.insert(0, (0.0, start))
    info = result.info
    out |= {"accepted": int(info["accepted"]), "rejected": int(info["rejected"]), "wall_time": float(info["wall_time"]),
            "iterations": int(info["iterations"]),
            "drift": {name: float(result.drift(name)) for name in case.conserved}}
    # the last step is cut to meet the end
    sizes = result.series["step_size"][1:-1]
    if len(sizes):
        out |= {"smallest": float(sizes.min()), "largest": float(sizes.max())}
    thin = np.unique(np.linspace(1, len(result.t) - 1, min(150, len(result.t) - 1)).astype(int)) if len(result.t) > 1 else []
    out["t"], out["h"] = [_short(result.t[k]) for k in thin], [_short(result.series["step_size"][k], 4) for k in thin]
    out["end"] = [float(x) for x in result.series["points"][-1].reshape(-1)] if len(result.t) > 1 else []
    errors = []
    for k in np.unique(np.linspace(0, len(states) - 2, min(samples, len(states) - 1)).astype(int)):
        (t, a), (after, b) = states[k], states[k + 1]
        exact = fb.simulate(model, start=fb.Start(a, time=t), t_end=after, step=(after - t) / 16.0, order=4, observe=(),
                            output=fb.Output(snapshots=0),
                            progress=False).state
        # over the same size of the scene as in the step control
        errors.append(_local_error(exact, b, float(info["scale"]["gap"])))
    out["local_errors"] = [_short(e, 3) for e in errors]
    return out


def _local_error(exact: Any, state: Any, length: float) -> float:
    """Largest distance of node positions and of sliding coordinates over the length."""
    off = (np.asarray(exact.q) - np.asarray(state.q)).reshape(-1, 12)[:, :3]
    size = float(np.linalg.norm(off, axis=1).max())
    s = np.abs(np.asarray(exact.s) - np.asarray(state.s))
    return max(size, float(s.max(initial=0.0))) / length
