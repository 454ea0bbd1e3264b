"""Time and memory of a slider in a Newton iteration, for 1 to 4096 masses that slide on one cable, four elements a slider.

    python perf/cases/sliders.py                     plane and space, degrees 2 and 3; every bar; exits with 1 where one is missed
    python perf/cases/sliders.py --counts 1 16 256 --kinds space --degrees 2 --curves own
    python perf/cases/sliders.py --json out.json

Times are processor times of whole runs over their iterations, the smallest of several repetitions. `bare` is the time of the same
cable without sliders and masses, `own` what sliders add to it. Memory is that of the arrays of the equations of sliders and their
elimination. Some of these have numbers for every node: a cable of twice as many elements a slider tells what belongs to a slider
(`bytes own`) and what to an element (`bytes an element`).
"""
from __future__ import annotations

import os

# one thread everywhere, before any library starts its pool
os.environ.update({name: "1" for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")})

import argparse  # noqa: E402
import json  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

import fastbeam as fb  # noqa: E402
from perf.places import private  # noqa: E402
from perf.printing import Bar, judged, table  # noqa: E402

Stepper = private("newton", "Stepper")

COUNTS = (1, 4, 16, 64, 256, 1024, 4096)
ELEMENTS = 4  # a slider
STEP = 1e-3
# bars: microseconds a slider and iteration, cost of the most over that of 16, bytes a slider, ms of a step of 256
MOST = {"plane": 12.0, "space": 25.0}
GROWTH, BYTES, STEP_OF_256 = 1.5, 10_000, 10.0


def cable(sliders: int, degree: int, curve: str, bare: bool = False, elements: int = ELEMENTS) -> fb.Scene:
    """Masses that start 0.37 of the way through their metre of a clamped cable, each at another rate."""
    section = fb.Section.circle(radius=0.01, E=1e8, rho=1000.0)
    beam = fb.Beam.straight("cable", (0, 0, 0), (sliders, 0, 0), section=section, elements=elements * sliders, degree=degree)
    parts: list[Any] = [beam, fb.Clamp(beam.start), fb.Clamp(beam.end)]
    for k in range(0 if bare else sliders):
        mass = fb.PointMass(f"m{k}", mass=0.1)
        parts += [mass, fb.Slider(f"s{k}", mass, beam, at=k + 0.37, rate=1.0 + 0.1 * np.sin(k), curve=curve)]
    return fb.Scene(*parts, gravity=(0, -9.81, 0))


def held(tables: Any) -> int:
    """Bytes of the arrays in nested tuples."""
    if isinstance(tables, np.ndarray):
        return int(tables.nbytes)
    return sum(held(x) for x in tables) if isinstance(tables, tuple) else 0


def measure(scene: fb.Scene, planar: bool, sliders: int) -> dict[str, float]:
    """Microseconds of an iteration, iterations a step, bytes of the arrays of the run."""
    model = fb.compile_scene(scene, planar=planar, condense=False)
    stepper = Stepper(model, np.ones(1))
    stepper.advance(0.0, STEP, 2)
    best, steps = np.inf, max(1, min(30, 3000 // sliders))
    iterations = 0
    for _ in range(5):
        begin = time.thread_time()
        outcome = stepper.advance(0.0, STEP, steps)
        took = time.thread_time() - begin
        assert outcome.status == 0 and stepper.linear.fallbacks == 0, outcome
        best, iterations = min(best, took / outcome.iterations), outcome.iterations
    return {"time": 1e6 * best, "iterations": iterations / steps, "bytes": room(stepper)}


def room(stepper: Stepper) -> int:
    """Bytes of the equations of sliders and of their elimination."""
    # the assembled blocks are the first of those that sliders have rows in; the others belong to every scene
    work, blocks = stepper.work, stepper.work.blocks.nbytes if stepper.rows is not None else 0
    rows = None if stepper.rows is None else stepper.rows[:5]  # and not the tables that it names
    arrays = (stepper.contact, rows, work.panel, work.border_rows, work.schur, work.y)
    return held(arrays) - blocks


def shares(sliders: int, degree: int, curve: str, planar: bool) -> tuple[float, float]:
    """Bytes of a slider itself and of an element, from cables of as many sliders on more elements."""
    found = []
    for elements in (ELEMENTS, 2 * ELEMENTS):
        model = fb.compile_scene(cable(sliders, degree, curve, elements=elements), planar=planar, condense=False)
        stepper = Stepper(model, np.ones(1))
        assert stepper.advance(0.0, STEP, 2).status == 0
        found.append(room(stepper) / sliders)
    element = (found[1] - found[0]) / ELEMENTS
    return found[0] - ELEMENTS * element, element


def rows(kinds: list[str], degrees: list[int], curves: list[str], counts: list[int]) -> list[dict[str, Any]]:
    """One result for every scene, printed as it comes."""
    out = []
    for kind, degree, curve in ((k, d, c) for k in kinds for d in degrees for c in curves):
        for n in counts:
            found = measure(cable(n, degree, curve), kind == "plane", n)
            bare = measure(cable(n, degree, curve, bare=True), kind == "plane", n)
            own, element = shares(n, degree, curve, kind == "plane")
            out.append({"kind": kind, "degree": degree, "curve": curve, "sliders": n, "time": found["time"] / n,
                        "bare": bare["time"] / n, "own": (found["time"] - bare["time"]) / n,
                        "bytes": found["bytes"] / n, "bytes own": own, "bytes an element": element,
                        "step": 1e-3 * found["time"] * found["iterations"]})
            print(" ".join(f"{key} {value:.4g}" if isinstance(value, float) else str(value) for key, value in out[-1].items()),
                  flush=True)
    return out


def bars(results: list[dict[str, Any]]) -> list[Bar]:
    """Bars with what was found: text, most, value, note."""
    out: list[Bar] = []
    for kind, degree, curve in dict.fromkeys((x["kind"], x["degree"], x["curve"]) for x in results):
        some = [x for x in results if (x["kind"], x["degree"], x["curve"]) == (kind, degree, curve)]
        name = f"{kind}, degree {degree}, {curve}: "
        for key, most, least, what in (("time", MOST[kind], 4, "us a slider and iteration"),
                                       ("bytes", BYTES, 16, "bytes a slider")):
            of = [x for x in some if x["sliders"] >= least]
            if of:
                worst = max(of, key=lambda x: x[key])
                out.append((f"{name}{what}, the most from {least} sliders on", most, worst[key], f"{worst['sliders']} sliders"))
        by = {x["sliders"]: x for x in some}
        if 256 in by:
            out.append((f"{name}ms of a step of 256", STEP_OF_256, by[256]["step"], ""))
        if 64 in by and max(by) > 64:
            out.append((f"{name}bytes a slider, {max(by)} over 64", 1.0, by[max(by)]["bytes"] / by[64]["bytes"],
                        "nothing grows with the square"))
        if 16 in by and max(by) > 16:
            last, few = by[max(by)], by[16]
            out.append((f"{name}time of a slider, {max(by)} over 16", GROWTH, last["time"] / few["time"],
                        f"bare cable {last['bare'] / few['bare']:.2f}, sliders alone {last['own'] / few['own']:.2f}"))
    return out


def main() -> int:
    """Measure, print, compare with the bars."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--counts", type=int, nargs="+", default=COUNTS)
    parser.add_argument("--kinds", nargs="+", default=["plane", "space"], choices=["plane", "space"])
    parser.add_argument("--degrees", type=int, nargs="+", default=[2, 3])
    parser.add_argument("--curves", nargs="+", default=["c1"], choices=["c1", "own"])
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    results = rows(given.kinds, given.degrees, given.curves, given.counts)
    if given.json is not None:
        given.json.write_text(json.dumps(results, indent=1))
    print(table(["kind", "degree", "curve", "sliders", "us a slider", "us bare", "us own", "bytes a slider", "bytes own",
                 "bytes an element", "ms a step"],
                [[x["kind"], str(x["degree"]), x["curve"], str(x["sliders"]), f"{x['time']:.2f}", f"{x['bare']:.2f}",
                  f"{x['own']:.2f}", f"{x['bytes']:.0f}", f"{x['bytes own']:.0f}", f"{x['bytes an element']:.0f}",
                  f"{x['step']:.2f}"] for x in results]))
    return int(judged(bars(results)) > 0)


if __name__ == "__main__":
    sys.exit(main())
