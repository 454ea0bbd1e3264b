"""Error against run time of all methods, orders, degrees and interpolations, with the Pareto front (work-precision).

    python examples/study/work_precision.py           everything, about 20 minutes on one core
    python examples/study/work_precision.py --quick   a few meshes of two scenes, within a minute, into out/work_precision
    python examples/study/work_precision.py --only mass_on_cable    one scene; the others keep their numbers
    python examples/study/work_precision.py --draw    pictures and text again from the stored numbers

Writes work-precision.md, study/work_precision*.png and study/work_precision.json in docs/reports (`--out` for another folder).
Times are those of `simulate` with nothing recorded, best of three, in one thread and with warm kernels; the first run on a
machine compiles kernels for several minutes. Errors come from a second, observed run of the same kind.
"""
from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import argparse
import dataclasses
import json
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import fastbeam as fb
import work_precision_plot
import work_precision_text
from methods import MAX_ITERATIONS, METHODS, newton_per_step, run
from run import clean, machine
from scenes import CASES, Case

Array = np.ndarray
Numbers = dict[str, Any]
ROOT = Path(__file__).resolve().parents[2]
# common instants of a run; forces are compared from FIRST on
INSTANTS, FIRST = 25, 3
# columns of the measured rows
FIELDS = ("elements", "nodes", "steps", "seconds", "cpu", "position", "s", "force", "mean_force", "energy", "newton")
# above this error a run may be too coarse to have an order: its steps are halved once more
COARSE = 2e-3


@dataclass(frozen=True)
class Plan:
    """Of one scene: time at which errors are taken, meshes, references.

    Attributes
    ----------
    t_end : float
        Errors are taken at 25 instants up to here, s.
    dense : int
        Factor on the numbers of elements.
    reference, second : (degree, elements, steps)
        Fine runs of order 4 on Lagrange elements; their distance is the uncertainty of the reference.
    elements : int
        Of the mesh on which methods are compared.
    longest : float
        Processor time that no run of the sweep takes much more of, s.
    repeats : int
        Timed runs of every point, the fastest counts.
    """

    t_end: float
    dense: int
    reference: tuple[int, int, int]
    second: tuple[int, int, int]
    elements: int
    longest: float = 0.9
    repeats: int = 3


PLANS = {"spaghetti3d": Plan(1.0, 1, (8, 24, 1600), (6, 24, 800), 24, 3.5),
         "mass_on_cable": Plan(0.5, 2, (4, 192, 800), (6, 96, 400), 24),
         "body_on_beam": Plan(1.5, 2, (4, 192, 800), (6, 96, 400), 24)}
# elements of the meshes by degree, times the factor of the plan
LAGRANGE = {1: (16, 32, 64, 128), 2: (8, 16, 32, 64), 3: (4, 8, 16, 32), 4: (4, 8, 16, 24), 5: (4, 8, 16, 24), 6: (4, 8, 16, 24)}
SPLINE = (8, 16, 32, 64)


@dataclass(frozen=True)
class Family:
    """A discretisation in space: one curve of the picture for each order."""

    strain: str
    interpolation: str
    degree: int
    directors: str | None = None
    curve: str | None = None

    def arguments(self, elements: int) -> Numbers:
        """Of a function of scenes.py."""
        out: Numbers = {"elements": elements, "degree": self.degree, "interpolation": self.interpolation, "strain": self.strain}
        return out | ({"directors": self.directors} if self.directors else {})


def families(sliders: bool, quick: bool) -> list[Family]:
    """All discretisations that a scene is run with; splines are smooth, so only Lagrange elements have a choice of curves."""
    c1 = "c1" if sliders else None
    out = [Family("simo_reissner", "lagrange", p, curve=c1) for p in ((2, 3, 4) if quick else range(1, 7))]
    if sliders and not quick:
        out += [Family("simo_reissner", "lagrange", p, curve="own") for p in (2, 3, 4)]
    for strain, directors in (("simo_reissner", "greville"), ("simo_reissner", "control"), ("green_lagrange", "control")):
        out += [Family(strain, "bspline", p, directors) for p in ((3,) if quick else range(2, 6))]
    if not quick:
        out += [Family("green_lagrange", "lagrange", 3, curve=c1), Family("green_lagrange", "bspline", 3, "greville")]
    return out


def build(name: str, family: Family, elements: int) -> tuple[Case, fb.Model]:
    """Scene with this discretisation and curve, compiled."""
    case = CASES[name](**family.arguments(elements))
    scene = case.scene
    if family.curve is not None:
        parts = [dataclasses.replace(x, curve=family.curve) if isinstance(x, fb.Slider) else x for x in scene.parts]
        scene = fb.Scene(*parts, name=scene.name, gravity=scene.gravity, project_velocities=scene.project_velocities)
        case = dataclasses.replace(case, scene=scene)
    return case, fb.compile_scene(scene, planar=False)


# ----------------------------------------------------------------------------------------------------------------- one run
def observe(case: Case, model: fb.Model, method: str, t_end: float, steps: int, **settings: Any) -> Numbers | str:
    """Paths at the common instants, energy error and iterations of a run, or why it failed.

    `mean_force` is the contact force averaged from instant to instant: what the slid mass or body gains in momentum.
    """
    velocities: list[Array] = []
    every = max(steps // 100, 1)
    gap = steps // INSTANTS // every
    rows = 0

    def keep(t: float, state: Any) -> None:
        nonlocal rows
        rows += 1
        if rows % gap == 0:
            velocities.append(np.array(state.v).reshape(-1, 12)[:, :3].copy())

    attempt = run(case, model, method, step=t_end / steps, t_end=t_end, every=every, observe=("energy", "slider"), callback=keep,
                  **settings)
    result = attempt.result
    if attempt.status != "done" or len(result.t) != steps // every + 1:
        return attempt.reason or "rows are missing"
    pick = slice(gap, None, gap)
    out: Numbers = {"position": result.series["points"][pick], "energy": float(result.drift("total")),
                    "newton": newton_per_step(attempt)}
    if case.sliders:
        out["s"] = result.series["s_slide"][pick]
        # the last row has a step on one side only
        out["force"] = result.series["contact_force"][pick][FIRST - 1:-1]
        slid = (case.scene.masses + case.scene.bodies)[0]
        node = (result.names["masses"] + result.names["bodies"])[0]["node"]
        # nothing but the contact and a constant weight acts on it
        out["mean_force"] = slid.mass * np.diff([v[node] for v in velocities], axis=0)[FIRST - 1:] / (t_end / INSTANTS)
    return out


def errors(a: Numbers, b: Numbers, length: float) -> Numbers:
    """Distances of a from b: positions and s at their largest over the length, forces in the mean square over the largest."""
    out = {"position": float(np.linalg.norm(a["position"] - b["position"], axis=-1).max()) / length}
    if "s" in b:
        out["s"] = float(np.abs(a["s"] - b["s"]).max()) / length
        for key in ("force", "mean_force"):
            size = np.linalg.norm(b[key], axis=-1).max()
            off = (a[key] - b[key]).reshape(len(b[key]), -1)
            out[key] = float(np.sqrt(np.mean(np.sum(off**2, axis=1))) / size)
    return out


def clock(model: fb.Model, method: str, plan: Plan, steps: int, **settings: Any) -> tuple[float, float]:
    """Least wall and processor seconds of `simulate` with nothing recorded."""
    wall, cpu = [], []
    for _ in range(plan.repeats):
        a, c = time.perf_counter(), time.process_time()
        fb.simulate(model, t_end=plan.t_end, step=plan.t_end / steps, observe=(), output=fb.Output(snapshots=0), progress=False,
                    solver=fb.Solver(max_iterations=MAX_ITERATIONS), **METHODS[method].arguments, **settings)
        wall.append(time.perf_counter() - a)
        cpu.append(time.process_time() - c)
    return min(wall), min(cpu)


def row(case: Case, model: fb.Model, method: str, plan: Plan, steps: int, exact: Numbers, **settings: Any) -> list[Any] | str:
    """One point of the picture (columns FIELDS), or why the run failed."""
    found = observe(case, model, method, plan.t_end, steps, **settings)
    if isinstance(found, str):
        return found
    off = errors(found, exact, case.length)
    # kernels and caches are warm by now
    seconds, cpu = clock(model, method, plan, steps, **settings)
    values = off | {"elements": case.elements, "nodes": case.scene.beams[0].n_nodes, "steps": steps, "seconds": seconds,
                    "cpu": cpu, "energy": found["energy"], "newton": found["newton"]}
    return [values.get(key) for key in FIELDS]


# ---------------------------------------------------------------------------------------------------------------- one scene
def reference(name: str, strain: str, plan: Plan, quick: bool) -> tuple[Numbers, Numbers]:
    """Finest run of a scene, and facts about it: its uncertainty is the distance of a second fine run."""
    paths, meshes = [], []
    for degree, elements, steps in (plan.reference, plan.second):
        if quick:
            elements, steps = elements // 3, steps // 2
        case, model = build(name, Family(strain, "lagrange", degree), elements)
        found = observe(case, model, "em4", plan.t_end, steps)
        if isinstance(found, str):
            raise RuntimeError(f"{name}: the reference failed: {found}")
        paths.append(found)
        meshes.append(f"lagrange {degree}, {elements} elements, {steps} steps of order 4")
    facts = {"mesh": meshes[0], "second": meshes[1], "uncertainty": errors(paths[1], paths[0], CASES[name]().length)}
    return paths[0], facts


def walk(name: str, family: Family, order: int, meshes: Iterable[int], plan: Plan, exact: Numbers, most: int) -> Numbers:
    """Points of a family: on every mesh the steps are halved until the error of space remains.

    A finer mesh starts two halvings before the number of steps where the coarser one had ended.
    """
    out: Numbers = dataclasses.asdict(family) | {"order": order, "rows": [], "failed": {}}
    method, first = f"em{order}", 0
    for elements in meshes:
        case, model = build(name, family, elements)
        before, seconds, k, still = float("inf"), 0.0, first, 0
        while INSTANTS * 2**k <= most and 2.0 * seconds < plan.longest:
            steps = INSTANTS * 2**k
            point = row(case, model, method, plan, steps, exact)
            k += 1
            if isinstance(point, str):
                out["failed"][f"{elements} elements, {steps} steps"] = point
                continue
            out["rows"].append(point)
            error, seconds = point[FIELDS.index("position")], point[FIELDS.index("cpu")]
            still = still + 1 if error > 0.8 * before else 0
            if still > (error > COARSE):
                break
            before = error
        first = max(0, k - 3)
    return out


def compare_methods(name: str, plan: Plan, most: int, exact: Numbers) -> Numbers:
    """All methods on one mesh of the default discretisation, against the exact motion of that mesh: the error of time alone."""
    family = Family("simo_reissner", "lagrange", 3)
    case, model = build(name, family, plan.elements)
    finest = observe(case, model, "em4", plan.t_end, 2 * most)
    if isinstance(finest, str):
        raise RuntimeError(f"{name}: the reference of the methods failed: {finest}")
    second = observe(case, model, "em4", plan.t_end, most)
    assert isinstance(second, dict)
    out: Numbers = {"mesh": f"lagrange 3, {plan.elements} elements", "reference": f"{2 * most} steps of order 4",
                    "uncertainty": errors(second, finest, case.length), "space": errors(finest, exact, case.length),
                    "families": {}}
    wanted = [(key, key, {}) for key in METHODS] + [("midpoint4", "midpoint", {"order": 4})]
    for key, method, settings in wanted:
        label = METHODS[method].label + (", order 4" if settings else "")
        entry: Numbers = {"label": label, "rows": [], "failed": {}}
        steps, seconds = INSTANTS, 0.0
        while steps <= most and seconds < plan.longest:
            point = row(case, model, method, plan, steps, finest, **settings)
            if isinstance(point, str):
                entry["failed"][f"{steps} steps"] = point
            else:
                entry["rows"].append(point)
                seconds = point[FIELDS.index("cpu")]
            steps *= 2
        out["families"][key] = entry
    return out


def scene_numbers(name: str, plan: Plan, quick: bool, say: Any) -> Numbers:
    """Everything that is measured on a scene."""
    case = CASES[name]()
    out: Numbers = {"letter": case.letter, "text": case.text, "t_end": plan.t_end, "length": case.length,
                    "sliders": bool(case.sliders), "references": {}, "families": []}
    exact: dict[str, Numbers] = {}
    for strain in ("simo_reissner", "green_lagrange"):
        exact[strain], out["references"][strain] = reference(name, strain, plan, quick)
    say(f"{name}: references")
    out["methods"] = compare_methods(name, plan, 200 if quick else 1600, exact["simo_reissner"])
    say(f"{name}: methods")
    for family in families(bool(case.sliders), quick):
        sizes: tuple[int, ...] = LAGRANGE[family.degree] if family.interpolation == "lagrange" else SPLINE
        meshes = [plan.dense * n for n in (sizes[:2] if quick else sizes)]
        for order in (2, 4):
            out["families"].append(walk(name, family, order, meshes, plan, exact[family.strain], 200 if quick else 1600))
        say(f"{name}: {work_precision_plot.label(out['families'][-1])}")
    return out


def main(arguments: list[str] | None = None) -> Numbers:
    """Measure, write the data, draw pictures and text."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", default="", help=f"scenes out of {', '.join(PLANS)}, with commas")
    parser.add_argument("--quick", action="store_true", help="a few meshes of two scenes")
    parser.add_argument("--draw", action="store_true", help="only pictures and text, from the stored numbers")
    parser.add_argument("--repeats", type=int, default=3, help="timed runs of every point, the fastest counts")
    parser.add_argument("--out", default="",
                        help="folder of work-precision.md and study/ (docs/reports; out/work_precision if --quick)")
    chosen = parser.parse_args(arguments)
    folder = Path(chosen.out) if chosen.out else ROOT / ("out/work_precision" if chosen.quick else "docs/reports")
    (folder / "study").mkdir(parents=True, exist_ok=True)
    file = folder / "study" / "work_precision.json"
    data: Numbers = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {"scenes": {}}
    if not chosen.draw:
        begin = time.perf_counter()

        def say(text: str) -> None:
            print(f"{time.perf_counter() - begin:7.0f} s  {text}", flush=True)

        wanted = [w.strip() for w in chosen.only.split(",") if w.strip()] or list(PLANS)[:2 if chosen.quick else None]
        unknown = [w for w in wanted if w not in PLANS]
        if unknown:
            parser.error(f"--only: {unknown[0]!r} is none of {', '.join(PLANS)}")
        for name in wanted:
            start = time.perf_counter()
            numbers = scene_numbers(name, dataclasses.replace(PLANS[name], repeats=max(1, chosen.repeats)), chosen.quick, say)
            data["scenes"][name] = clean(numbers | {"took": time.perf_counter() - start})
            said = [f"--only {chosen.only}"] * bool(chosen.only) + ["--quick"] * chosen.quick
            said += [f"--repeats {chosen.repeats}"] * (chosen.repeats != 3)
            data |= {"machine": machine(), "quick": chosen.quick, "fastbeam": fb.__version__, "fields": list(FIELDS),
                     "repeats": max(1, chosen.repeats), "defaults": defaults(),
                     "command": " ".join(["python examples/study/work_precision.py", *said])}
            file.write_text(json.dumps(data, separators=(",", ":"), allow_nan=False), encoding="utf-8")
    work_precision_plot.draw(data, folder / "study")
    (folder / "work-precision.md").write_text(work_precision_text.text(data), encoding="utf-8")
    print(f"written: {folder / 'work-precision.md'}, {folder / 'study'}")
    return data


def defaults() -> Numbers:
    """Defaults of the package, asked from its signatures."""
    import inspect
    beam, slider = inspect.signature(fb.Beam).parameters, inspect.signature(fb.Slider).parameters
    return {"strain": beam["strain"].default, "interpolation": beam["interpolation"].default, "degree": beam["degree"].default,
            "directors": beam["directors"].default, "curve": slider["curve"].default,
            "order": inspect.signature(fb.simulate).parameters["order"].default,
            "method": inspect.signature(fb.simulate).parameters["method"].default}


if __name__ == "__main__":
    main()
