"""One Newton iteration of a net whose beams are condensed to their ends, next to the same net without, and to PARDISO's factors
and solution of the uncondensed matrix alone: wall time on one and on two threads in turn, ratios, peak memory.

    python perf/cases/net_step.py [--cells 20] [--elements 10] [--degree 1] [--joints rigid] [--threads 1 2] [--repeats 5]
                                  [--memory]

A net of (cells + 1)^2 nodes has 2 cells (cells + 1) beams. --memory: only the condensed net, on the last number of
threads, for its peak memory.
"""
from __future__ import annotations

import os

# libraries keep to one thread where they are not told otherwise
os.environ.update({name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")})

import argparse  # noqa: E402
import resource  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

import fastbeam as fb  # noqa: E402
from perf.places import private  # noqa: E402

FACTOR, SOLVE, block_residual, call_pardiso = private("kernels.sparse", "FACTOR", "SOLVE", "block_residual", "call_pardiso")
Stepper = private("newton", "Stepper")

SECTION = fb.Section.circle(radius=0.02, E=1e8, rho=1000.0)
STEP = 1e-3


def square_net(cells: int, elements: int, degree: int, joints: str) -> fb.Scene:
    """Beams between (cells + 1)^2 nodes, pinned along one side, under gravity."""
    k = np.arange((cells + 1)**2).reshape(cells + 1, cells + 1)
    x, y = np.divmod(k, cells + 1)
    nodes = np.stack((x, y, 0.1 * np.random.default_rng(0).standard_normal(x.shape)), axis=-1).reshape(-1, 3)
    edges = np.concatenate([np.stack(pair, axis=-1).reshape(-1, 2) for pair in ((k[:-1], k[1:]), (k[:, :-1], k[:, 1:]))])
    net = fb.Net("net", nodes, edges, section=SECTION, elements=elements, degree=degree, joints=joints, pins=np.arange(cells + 1))
    return fb.Scene(net, gravity=(0, 0, -9.81))


def iteration(model: Any, threads: int) -> Callable[[], float]:
    """A function that takes a step and returns seconds of one of its Newton iterations."""
    stepper = Stepper(model, np.ones(1), threads=threads)

    def run() -> float:
        begin = time.perf_counter()
        outcome = stepper.advance(0.0, STEP, 1)
        if outcome.status:
            raise SystemExit(f"the step failed with status {outcome.status}")
        return (time.perf_counter() - begin) / outcome.iterations

    run()
    return run


def solver(model: Any, threads: int) -> Callable[[], float]:
    """A function that factors the matrix of the first iteration by PARDISO, solves once and returns the seconds."""
    stepper = Stepper(model, np.ones(1), threads=threads)
    if stepper.linear.tables is None:
        raise SystemExit("MKL was not found: pip install pypardiso")
    t, n = stepper.linear.tables, len(model.dofs)
    stepper.parts.start(STEP)
    stepper.parts.assemble(STEP)
    blocks = stepper.work.blocks[:8 * n * model.pattern.keys.size].reshape(-1, n, 8)
    t.data[:] = blocks[:, :, :n].reshape(-1)
    t.b[0] = stepper.work.r[:8 * model.pattern.n].reshape(-1, 8)[:, :n].reshape(-1)

    def run() -> float:
        with stepper.linear.threads():
            begin = time.perf_counter()
            code = call_pardiso(t, FACTOR, t.b, t.x) or call_pardiso(t, SOLVE, t.b, t.x)
            seconds = time.perf_counter() - begin
        if code or not block_residual(t, t.x, t.b, t.r, model.dofs) < 1e-8:
            raise SystemExit(f"PARDISO: error {code}, or a large residual")
        return seconds

    run()
    return run


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in (("cells", 20), ("elements", 10), ("degree", 1), ("repeats", 5)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--joints", choices=("rigid", "ball"), default="rigid")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--memory", action="store_true")
    options = parser.parse_args()
    threads = options.threads[-1:] if options.memory else options.threads
    scene = square_net(options.cells, options.elements, options.degree, options.joints)
    n_elements = int(scene.nets[0].elements.sum())
    begin = time.perf_counter()
    model = fb.compile_scene(scene, condense=True, planar=False)
    print(f"{len(scene.nets[0].edges)} beams, {n_elements} elements of degree {options.degree}, {options.joints} joints, "
          f"{model.n_unknowns} unknowns; compiled in {time.perf_counter() - begin:.1f} s")
    work = {f"condensed, {k} threads": iteration(model, k) for k in threads}
    if not options.memory:
        work["not condensed"] = iteration(fb.compile_scene(scene, condense=False, planar=False), 1)
        plain = fb.compile_scene(scene, solver="sparse", condense=False, planar=False)
        whole = fb.compile_scene(scene, solver="sparse", condense=False, eliminate_inner=False, planar=False)
        work |= {f"PARDISO alone, all nodes, {k} threads": solver(whole, k) for k in threads}
        if options.degree > 1:
            work |= {f"PARDISO alone, ends of elements, {k} threads": solver(plain, k) for k in threads}
    best = dict.fromkeys(work, np.inf)
    for _ in range(options.repeats):
        for name, run in work.items():
            best[name] = min(best[name], run())
    for name, seconds in best.items():
        print(f"{name:40s} {1e3 * seconds:10.1f} ms  {1e6 * seconds / n_elements:8.3f} us per element")
    first, last = threads[0], threads[-1]
    fast = best[f"condensed, {last} threads"]
    if first != last:
        print(f"condensed, {first} threads over {last}: {best[f'condensed, {first} threads'] / fast:.2f}")
    for name, seconds in best.items():
        if not name.startswith("condensed"):
            print(f"condensed, {last} threads over {name}: {fast / seconds:.3f}")
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")


if __name__ == "__main__":
    main()
