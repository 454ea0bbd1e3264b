"""Operations and bytes of a Newton iteration against what the machine allows, measured in the same run: chains and a net.

    python perf/limits/roofline.py             chains of 20, 200 and 20000 elements of degree 1 to 3, a net on one and two threads
    python perf/limits/roofline.py --quick     one small chain and a small net
    python perf/limits/roofline.py --markdown  tables ready to paste into docs/reports/performance.md
    python perf/limits/roofline.py --json out.json

Operations are counted by running the source of the kernels on numbers that count (counting.py), those of PARDISO are its
own figure; bytes are those of the arrays that every pass reads and writes (traffic.py). The limits are the time of all
operations at the peak of multiply-adds in registers and the time of all bytes at the bandwidth of a triad on arrays as large
as everything that the iteration touches, so that small scenes are compared with the cache in which they fit. The larger of
both binds. A part that takes more than twice that is bound by neither: operations that wait for each other, loads that
overlap no arithmetic, or calls cost more, and `what is left` says by how much.
"""
from __future__ import annotations

import os

# libraries keep to one thread where they are not told otherwise
os.environ.update({name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")})

import argparse  # noqa: E402
import json  # noqa: E402
import math  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from dataclasses import asdict, dataclass  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

import fastbeam as fb  # noqa: E402
from perf.cases.net_step import square_net  # noqa: E402
from perf.limits import counting, traffic  # noqa: E402
from perf.limits.ceilings import Ceilings, clock  # noqa: E402
from perf.limits.parts import ChainParts, iteration  # noqa: E402
from perf.limits.scaling import chain_scene, number_of_elements  # noqa: E402
from perf.places import private  # noqa: E402
from perf.printing import table  # noqa: E402

ANALYSE, call_pardiso = private("kernels.sparse", "ANALYSE", "call_pardiso")
Pardiso = private("linsolve", "Pardiso")
load_mkl = private("mkl", "load_mkl")
Stepper = private("newton", "Stepper")

STEP = 1e-3
FREE = 0.5  # a part that reaches less than this share of its limit is not bound by it


@dataclass
class Part:
    """A part of an iteration, per element: time in us, operations, bytes; rates and limits follow.

    Attributes
    ----------
    peak, bandwidth : float
        What the machine allows, GF/s, GB/s.
    """

    case: str
    name: str
    threads: int
    time: float
    operations: float
    moved: float
    peak: float
    bandwidth: float

    @property
    def at_peak(self) -> float:
        """Time of the operations alone, us."""
        return 1e-3 * self.operations / self.peak

    @property
    def at_bandwidth(self) -> float:
        """Time of the bytes alone, us."""
        return 1e-3 * self.moved / self.bandwidth

    @property
    def share(self) -> float:
        """Of the time that the limit allows."""
        return self.per_time(max(self.at_peak, self.at_bandwidth))

    def per_time(self, x: float) -> float:
        """x over the time; infinite where the time is lost in those of other parts, of which it is the difference."""
        return x / self.time if self.time > 0.0 else math.inf

    @property
    def binds(self) -> str:
        """What limits it."""
        if self.share < FREE:
            return "neither"
        return "arithmetic" if self.at_peak > self.at_bandwidth else "bandwidth"

    def cells(self) -> list[str]:
        """One line of the table."""
        return [self.case, self.name, f"{self.threads}", f"{self.time:.4f}", f"{self.operations:.0f}", f"{self.moved:.0f}",
                f"{1e-3 * self.per_time(self.operations):.1f}", f"{100.0 * self.per_time(self.at_peak):.0f} %",
                f"{1e-3 * self.per_time(self.moved):.1f}", f"{100.0 * self.per_time(self.at_bandwidth):.0f} %", self.binds,
                f"{self.time - max(self.at_peak, self.at_bandwidth):.4f}"]


HEADER = ["case", "part", "threads", "us/element", "operations", "bytes", "GF/s", "of peak", "GB/s", "of bandwidth", "binds",
          "what is left, us"]


def chain(elements: int, degree: int, ceilings: Ceilings, seconds: float) -> list[Part]:
    """A whole iteration of one beam that is not condensed and its parts, on one thread."""
    model = fb.compile_scene(chain_scene(elements, degree), planar=False, condense=False)
    stepper = Stepper(model, np.ones(1))
    stepper.advance(0.0, STEP, 2)
    spent, per_step, outcome = iteration(stepper, STEP, seconds)
    mixed = traffic.mixed_share(stepper, outcome)
    plan, n = model.pattern.plan, len(model.dofs)
    ends = counting.elimination(plan, n)
    kernel = elements * counting.element_kernel(model, mixed)
    after = elements * counting.after_kernel(model)
    rest = elements * counting.inner_recovery(degree + 1, n) + model.n_nodes * counting.node_loops(model)
    moved = {"elements": 0.0, "elimination": 0.0, "nodes": 0.0, "step": 0.0}
    found = traffic.passes(stepper, per_step, mixed)
    for p in found:
        moved[p.part] += p.moved
    ends_moved = sum(p.moved for p in found if p.name in ("factors", "back substitution"))
    size = sum(traffic.kept(stepper).values())
    limits = ceilings.peak(), ceilings.bandwidth(size)
    parts = ChainParts(model, STEP, mixed > 0.5)
    evaluated, eliminated = parts.element_time(seconds), parts.elimination_time(seconds)
    case = f"chain, {elements} elements, degree {degree}"
    times = [("whole iteration", spent, kernel + after + ends + rest, sum(moved.values())),
             ("elements, inner nodes, assembly", evaluated, kernel + after, moved["elements"]),
             ("elimination of end nodes", eliminated, ends, ends_moved),
             ("nodes, right-hand sides, recovery", max(spent - evaluated - eliminated, 1e-12), rest,
              sum(moved.values()) - moved["elements"] - ends_moved)]
    return [Part(case, name, 1, 1e6 * t / elements, f / elements, b / elements, *limits) for name, t, f, b in times]


def pardiso_operations(model: Any) -> tuple[float, float]:
    """(operations of the factors, those of a solution), by PARDISO's own account; a solution multiplies by every entry of the
    factors once. Of a matrix of blocks it counts blocks, in whole millions: here it sees the same matrix number by number."""
    mkl = load_mkl()
    if mkl is None:
        return 0.0, 0.0
    pattern, n = model.pattern, len(model.dofs)
    i, j = (np.broadcast_to(n * x[:, None, None] + at, (x.size, n, n)).reshape(-1)
            for x, at in ((pattern.rows, np.arange(n)[:, None]), (pattern.columns, np.arange(n))))
    order = np.argsort(i * (n * pattern.n) + j)
    solver = Pardiso(mkl, np.searchsorted(i[order], np.arange(n * pattern.n + 1)), j[order], 1, 1, 1)
    t = solver.tables
    t.iparm[17:19] = -1
    with solver.threads():
        if call_pardiso(t, ANALYSE, t.b, t.x):
            raise SystemExit("PARDISO: the analysis failed")
    return 1e6 * float(t.iparm[18]), 2.0 * float(t.iparm[17])


def condensed(model: Any, case: str, threads: int, ceilings: Ceilings, seconds: float) -> list[Part]:
    """An iteration of a model with condensed beams and its parts, the calls of the time loop."""
    stepper = Stepper(model, np.ones(1), threads=threads)
    outcome = stepper.advance(0.0, STEP, 2)
    mixed = traffic.mixed_share(stepper, outcome)
    elements, per_step = number_of_elements(model), outcome.iterations / outcome.steps
    now = clock(threads)
    iterations = max(1, round(per_step))
    best = np.full(3, np.inf)
    k, end = 0, time.perf_counter() + seconds
    while k < 3 or time.perf_counter() < end:
        # the same step again and again: it is never accepted
        stepper.parts.start(STEP)
        stepper.linear.begin_step()
        spent = np.zeros(3)
        for _ in range(iterations):
            marks = [now()]
            stepper.parts.assemble(STEP)
            marks.append(now())
            if not stepper.parts.solve():
                raise SystemExit("the solution was refused: nothing was measured")
            marks.append(now())
            stepper.parts.update()
            marks.append(now())
            spent += np.diff(marks)
        best, k = np.minimum(best, spent / iterations), k + 1
    recovery = {"solution to rows", "recover the inner nodes", "recover the beams, increments"}
    moved = {"beams": 0.0, "solve": 0.0, "recover": 0.0}
    for p in traffic.passes(stepper, per_step, mixed):
        if p.part != "step":
            part = "recover" if p.name in recovery else "solve" if p.part == "elimination" else "beams"
            moved[part] += p.moved
    again = counting.recovery_of_beams(stepper)
    beams = counting.condensed_beams(stepper, mixed) - again
    rest = elements - model.condensed_elements
    if rest:
        beams += rest * (counting.element_kernel(model, mixed) + counting.after_kernel(model))
    plan = model.pattern.plan
    if plan is None:
        factors, solution = pardiso_operations(model)
        factors *= traffic.factored_share(stepper) if stepper.linear.tables is not None else 1.0
    else:
        factors, solution = float(counting.elimination(plan, len(model.dofs))), 0.0
    limits = ceilings.peak(threads), ceilings.bandwidth(sum(traffic.kept(stepper).values()), threads)
    nodes = float(model.n_nodes * counting.node_loops(model))
    times = [("whole iteration", best.sum(), beams + factors + solution + again + nodes, sum(moved.values())),
             ("elements, condensation", best[0], beams, moved["beams"]),
             ("ends: PARDISO" if plan is None else "ends: block elimination", best[1], factors + solution, moved["solve"]),
             ("recovery, nodes", best[2], again + nodes, moved["recover"])]
    return [Part(case, name, threads, 1e6 * t / elements, f / elements, b / elements, *limits) for name, t, f, b in times]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--chains", type=int, nargs="*", default=[20, 200, 20_000], help="numbers of elements")
    parser.add_argument("--degrees", type=int, nargs="*", choices=(1, 2, 3), default=[1, 2, 3])
    parser.add_argument("--cells", type=int, nargs="*", default=[30], help="of nets")
    parser.add_argument("--per-beam", type=int, default=10, help="elements of a beam of a net")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2], help="of condensed beams")
    parser.add_argument("--seconds", type=float, help="time of one measurement, default 1")
    parser.add_argument("--quick", action="store_true", help="one small chain and a small net, short measurements")
    parser.add_argument("--markdown", action="store_true", help="print tables as they stand in docs/reports/performance.md")
    parser.add_argument("--json", type=Path, help="write all values to this file")
    options = parser.parse_args()
    if options.quick:
        options.chains, options.degrees, options.cells, options.threads = [20], [2], [5], [1]
    seconds = options.seconds or (0.05 if options.quick else 1.0)
    ceilings = Ceilings(2.0**25) if options.quick else Ceilings()
    parts: list[Part] = []
    for degree in options.degrees:
        for elements in options.chains:
            model = fb.compile_scene(chain_scene(elements, degree), planar=False)
            if model.substructures is None:
                parts += chain(elements, degree, ceilings, seconds)
                continue
            for threads in options.threads:
                parts += condensed(model, f"chain, {elements} elements, degree {degree}", threads, ceilings, seconds)
    for cells in options.cells:
        for degree in options.degrees:
            model = fb.compile_scene(square_net(cells, options.per_beam, degree, "rigid"), planar=False, condense=True)
            case = f"net, {number_of_elements(model)} elements, {options.per_beam} a beam, degree {degree}"
            for threads in options.threads:
                parts += condensed(model, case, threads, ceilings, seconds)
    print(table(HEADER, [part.cells() for part in parts], options.markdown, left=(0, 1)))
    for name, values in ceilings.facts().items():
        print(f"{name}: " + ", ".join(f"{key}: {value:.1f}" for key, value in values.items()))
    if options.json:
        from perf.machine import machine
        rows = [asdict(part) | {"share": part.share, "binds": part.binds} for part in parts]
        options.json.write_text(json.dumps({"machine": machine(), "ceilings": ceilings.facts(), "parts": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
