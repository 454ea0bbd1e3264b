"""Compare methods of time integration on beams with sliding contact, on the scenes (a) to (g) of scenes.py.

    python examples/study/run.py                   everything, about half an hour on one core
    python examples/study/run.py --jobs 2          two scenes at a time
    python examples/study/run.py --quick           a few steps of a few scenes, written to out
    python examples/study/run.py --only a,c        some scenes; the others keep their numbers
    python examples/study/run.py --kinds largest   some measurements
    python examples/study/run.py --draw            tables and pictures again from docs/reports/study/data.json

Writes study.md, study/*.png and study/data.json in docs/reports (`--out` for another folder). Every number and every failure in
the text comes from that file.
"""
from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import argparse
import json
import math
import platform
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import fastbeam as fb
import measures
import methods
import pictures
import tables
from scenes import CASES

ROOT = Path(__file__).resolve().parents[2]
KINDS = ("drift", "orders", "mesh", "largest", "control")
SPLINE = {"interpolation": "bspline", "degree": 4}
# t_end, first number of steps, halvings of methods of order 2 and 4, mesh: smooth curves, because a path over the kinks of a
# curve has no order; coarse, because fast waves hide the order until the step resolves them
ORDERS: dict[str, tuple[float, int, int, int, dict[str, Any]]] = {
    "spaghetti2d": (0.5, 50, 7, 6, {"elements": 6}),
    "spaghetti3d": (0.5, 50, 7, 6, {"elements": 6}),
    "pendulum": (0.1, 50, 8, 6, {"elements": 5, **SPLINE}),
    "mass_on_cable": (0.2, 100, 7, 6, {"elements": 10, **SPLINE}),
    "mass_on_cantilever": (1.0, 100, 8, 6, {"elements": 8, **SPLINE}),
    "body_on_beam": (0.5, 50, 7, 6, {"elements": 8, **SPLINE}),
    "beam_on_beam": (0.5, 50, 9, 6, {"elements": 8, **SPLINE}),
    "large": (0.1, 10, 5, 4, {"elements": 4, **SPLINE}),
    "stiff": (0.1, 100, 6, 5, {"elements": 10, **SPLINE}),
    "stiff_cantilever": (2.0, 100, 6, 5, {"elements": 8, **SPLINE})}
# t_end, step, elements, elements of the fine mesh
MESH: dict[str, tuple[float, float, tuple[int, ...], int]] = {
    "spaghetti2d": (1.0, 5e-3, (4, 8, 16, 32), 24),
    "spaghetti3d": (1.0, 5e-3, (4, 8, 16, 32), 24),
    "pendulum": (0.5, 2.5e-3, (4, 8, 16, 32), 24),
    "mass_on_cable": (0.5, 2.5e-3, (8, 16, 32, 64), 40),
    "mass_on_cantilever": (5.0, 2.5e-2, (4, 8, 16, 32), 36),
    "body_on_beam": (1.5, 1e-2, (4, 8, 16, 32), 36),
    "beam_on_beam": (1.5, 1e-2, (4, 8, 16, 32), 36),
    "stiff": (0.25, 1e-3, (8, 16, 32), 24)}
SIMO = ("spaghetti3d", "mass_on_cable", "body_on_beam")
PAPER_LABELS = ["bspline 2, control", "bspline 3, control", "bspline 2, greville", "bspline 3, greville", "lagrange 2",
                "lagrange 3"]
SIMO_LABELS = ["bspline 3, greville", "lagrange 2", "lagrange 3", "lagrange 4"]
CONTROL = ("pendulum", "mass_on_cable", "mass_on_cantilever", "stiff", "stiff_cantilever")
# methods of the costly measurements of the large scene
LARGE = ("em2", "em4", "midpoint", "trapezoidal", "alpha09")
QUICK = ("spaghetti3d", "mass_on_cable", "body_on_beam")


def tasks(names: list[str], kinds: list[str]) -> list[tuple[str, str]]:
    """(scene, measurement) of everything that has to be done; the large scene last."""
    offered = {"drift": set(CASES), "orders": set(ORDERS), "mesh": set(MESH), "largest": set(CASES), "control": set(CONTROL)}
    return [(name, kind) for name in sorted(names, key=lambda n: n == "large") for kind in kinds if name in offered[kind]]


def measure(name: str, kind: str, quick: bool) -> tuple[dict[str, Any], float]:
    """One measurement of one scene, and the seconds it took."""
    begin = time.perf_counter()
    keys = list(methods.METHODS)
    case = CASES[name]()
    model = fb.compile_scene(case.scene, planar=False)
    out: dict[str, Any] = {}
    if kind == "drift":
        scale = methods.energy_scale(case, model)
        out = {"facts": measures.facts(case, model) | {"energy_scale": scale}, "methods": {}}
        for key in keys:
            out["methods"][key], attempt = measures.history(case, model, key, scale)
            if key == "em2":
                out["shapes"] = pictures.shapes(case, model)
    elif kind == "orders":
        t_end, base, second, fourth, mesh = ORDERS[name]
        if name == "large":
            keys = [k for k in keys if k in LARGE]
        if quick:
            base, second, fourth = base, 4, 4
        out = measures.order_in_step(lambda: CASES[name](**mesh), keys, t_end, base, second, fourth)
    elif kind == "mesh":
        t_end, step, meshes, fine = MESH[name]
        out["green_lagrange"] = measures.order_in_mesh(name, "green_lagrange", PAPER_LABELS, meshes, t_end, step, fine)
        if name in SIMO:
            out["simo_reissner"] = measures.order_in_mesh(name, "simo_reissner", SIMO_LABELS, meshes, t_end, step, fine)
    elif kind == "largest":
        scale = methods.energy_scale(case, model)
        bottom, ratio = (case.step, 1.5) if quick else (0.25 * case.step, 1.1)
        if name == "large":
            bottom, ratio, keys = case.step, 2.0, [k for k in keys if k in LARGE]
        for key in keys:
            # five substeps a step: not below the usual step
            low = max(bottom, case.step) if key == "em4" else bottom
            out[key] = measures.largest_step(case, model, key, scale, low, case.long, ratio)
    elif kind == "control":
        span = case.t_end if name != "stiff" else 1.0
        out["runs"] = [measures.step_control(case, model, order, tolerance, span)
                       for order in (2, 4) for tolerance in (1e-4, 1e-5, 1e-6, 1e-7)[:2 if quick else 4]]
    return out, time.perf_counter() - begin


def machine() -> dict[str, Any]:
    """Facts about where the numbers come from."""
    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = info.read_text(encoding="utf-8").splitlines()
        found = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
        cpu = found[0] if found else cpu
    from importlib.metadata import version
    return {"cpu": cpu, "cores": os.cpu_count(), "system": f"{platform.system()} {platform.machine()}",
            "python": platform.python_version(), **{name: version(name) for name in ("numpy", "numba")}}


def clean(value: Any) -> Any:
    """JSON has no NaN and no infinity: None and 1e999 become null; numbers get 6 digits."""
    if isinstance(value, dict):
        return {str(k): clean(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [clean(v) for v in value]
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    return value


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measure, write the data, draw tables and pictures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", default="", help="letters or names of scenes, with commas")
    parser.add_argument("--kinds", default=",".join(KINDS), help=f"measurements out of {', '.join(KINDS)}")
    parser.add_argument("--quick", action="store_true", help="three scenes, few steps")
    parser.add_argument("--draw", action="store_true", help="only tables and pictures, from the stored numbers")
    parser.add_argument("--jobs", type=int, default=1, help="measurements at a time")
    parser.add_argument("--out", help="folder of study.md and study/ (default: docs/reports, of a quick run: out)")
    chosen = parser.parse_args(arguments)
    folder = Path(chosen.out or ROOT / ("out" if chosen.quick else "docs/reports"))
    (folder / "study").mkdir(parents=True, exist_ok=True)
    file = folder / "study" / "data.json"
    data = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {"cases": {}}
    if not chosen.draw:
        wanted = [w.strip() for w in chosen.only.split(",") if w.strip()]
        letters = {name: (f.__doc__ or "")[1] for name, f in CASES.items()}
        names = [name for name in (QUICK if chosen.quick and not wanted else CASES)
                 if not wanted or name in wanted or letters[name] in wanted]
        kinds = [k for k in chosen.kinds.split(",") if k in KINDS]
        if chosen.quick:
            kinds = [k for k in kinds if k != "mesh"]
        work = tasks(names, kinds)
        print(f"{len(work)} measurements with {', '.join(methods.METHODS)}", flush=True)
        begin = time.perf_counter()
        with ProcessPoolExecutor(max(1, chosen.jobs)) as pool:
            waiting = {pool.submit(measure, name, kind, chosen.quick): (name, kind) for name, kind in work}
            for done in as_completed(waiting):
                name, kind = waiting[done]
                numbers, seconds = done.result()
                data["cases"].setdefault(name, {})[kind] = clean(numbers | {"seconds": seconds})
                print(f"{time.perf_counter() - begin:7.0f} s  {name:20s} {kind:8s} {seconds:6.0f} s", flush=True)
                file.write_text(json.dumps(data, separators=(",", ":"), allow_nan=False), encoding="utf-8")
        data |= {"machine": machine(), "quick": chosen.quick, "fastbeam": fb.__version__}
        file.write_text(json.dumps(data, separators=(",", ":"), allow_nan=False), encoding="utf-8")
    pictures.draw(data, folder / "study")
    (folder / "study.md").write_text(tables.text(data), encoding="utf-8")
    print(f"written: {folder / 'study.md'}, {folder / 'study'}")
    return data


if __name__ == "__main__":
    main()
