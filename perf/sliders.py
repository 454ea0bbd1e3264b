"""Time and memory of a slider in a Newton iteration, for 1 to 4096 masses that slide on one cable, four elements a slider.

    python perf/sliders.py                     plane and space, degrees 2 and 3; exits with 1 where a bar is missed
    python perf/sliders.py --counts 1 16 256 --kinds space --degrees 2 --curves own
    python perf/sliders.py --json out.json

Times are processor times of whole runs over their iterations, the smallest of several repetitions. `bare` is the time of the same
cable without sliders and masses. Memory is that of the arrays of the equations of sliders and their elimination.
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

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "src"), str(HERE)]

import fastbeam as fb  # noqa: E402
from fastbeam.newton import Stepper  # noqa: E402
from printing import table  # noqa: E402

COUNTS = (1, 4, 16, 64, 256, 1024, 4096)
ELEMENTS = 4  # a slider
STEP = 1e-3
# bars: microseconds a slider and iteration, cost of the most over that of 16, bytes a slider, ms of a step of 256
MOST = {"plane": 12.0, "space": 25.0}
GROWTH, BYTES, STEP_OF_256 = 1.5, 10_000, 10.0


def cable(sliders: int, degree: int, curve: str, bare: bool = False) -> fb.Scene:
    """Masses that start 0.37 of the way through their metre of a clamped cable, each at another rate."""
    section = fb.Section.circle(radius=0.01, E=1e8, rho=1000.0)
    beam = fb.Beam.straight("cable", (0, 0, 0), (sliders, 0, 0), section=section, elements=ELEMENTS * sliders, degree=degree)
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
    # the assembled blocks are the first of those that sliders have rows in; the others belong to every scene
    work, blocks = stepper.work, stepper.work.blocks.nbytes if stepper.rows is not None else 0
    rows = None if stepper.rows is None else stepper.rows[:5]  # and not the tables that it names
    arrays = (stepper.contact, rows, work.panel, work.border_rows, work.schur, work.y)
    return {"time": 1e6 * best, "iterations": iterations / steps, "bytes": held(arrays) - blocks}


def rows(kinds: list[str], degrees: list[int], curves: list[str], counts: list[int]) -> list[dict[str, Any]]:
    """One result for every scene, printed as it comes."""
    out = []
    for kind, degree, curve in ((k, d, c) for k in kinds for d in degrees for c in curves):
        for n in counts:
            found = measure(cable(n, degree, curve), kind == "plane", n)
            bare = measure(cable(n, degree, curve, bare=True), kind == "plane", n)
            out.append({"kind": kind, "degree": degree, "curve": curve, "sliders": n, "time": found["time"] / n,
                        "bare": bare["time"] / n, "bytes": found["bytes"] / n,
                        "step": 1e-3 * found["time"] * found["iterations"]})
            print(" ".join(f"{key} {value:.4g}" if isinstance(value, float) else str(value) for key, value in out[-1].items()),
                  flush=True)
    return out


def missed(results: list[dict[str, Any]]) -> list[str]:
    """Bars that the results miss."""
    said = []
    for x in results:
        name = f"{x['kind']}, degree {x['degree']}, {x['curve']}, {x['sliders']} sliders"
        if x["sliders"] > 1 and x["time"] > MOST[x["kind"]]:
            said.append(f"{name}: {x['time']:.1f} us, at most {MOST[x['kind']]:g}")
        if x["sliders"] >= 16 and x["bytes"] > BYTES:
            said.append(f"{name}: {x['bytes']:.0f} bytes a slider, at most {BYTES}")
        if x["sliders"] == 256 and x["step"] > STEP_OF_256:
            said.append(f"{name}: a step takes {x['step']:.1f} ms, at most {STEP_OF_256:g}")
        few = [y for y in results if y["sliders"] == 16 and all(y[key] == x[key] for key in ("kind", "degree", "curve"))]
        if x["sliders"] == COUNTS[-1] and few and x["time"] > GROWTH * few[0]["time"]:
            said.append(f"{name}: {x['time'] / few[0]['time']:.2f} of the time with 16, at most {GROWTH:g}")
    return said


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
    print(table(["kind", "degree", "curve", "sliders", "us a slider", "us bare", "bytes a slider", "ms a step"],
                [[x["kind"], str(x["degree"]), x["curve"], str(x["sliders"]), f"{x['time']:.2f}", f"{x['bare']:.2f}",
                  f"{x['bytes']:.0f}", f"{x['step']:.2f}"] for x in results]))
    failures = missed(results)
    for line in failures:
        print("missed:", line)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
