"""Time and memory of an element in a Newton iteration, from 1e2 to 1e6 elements: a chain (one beam) and a net, 1 and 2 threads.

    python perf/limits/scaling.py                    all sizes; prints the table, draws docs/reports/scaling.png
    python perf/limits/scaling.py --quick            two small sizes, no picture
    python perf/limits/scaling.py --kinds chain --degree 3 --sizes 1000 10000 --json out.json
    python perf/limits/scaling.py --markdown         the table ready to paste into docs/reports/performance.md
    python perf/limits/scaling.py --from out.json --picture docs/reports/scaling.png     draw what was measured before

Every size runs in a process of its own, which first runs the smallest scene of its kind: memory is what comes on top of that. The
limit is the time in which the bytes that all passes read and write (traffic.py) go through the memory of this machine, as a
triad does in the same run (ceilings.py). One thread is timed by its processor time, two by the clock on the wall; the
smallest of several repetitions counts. Two threads run where the model has condensed beams; other models run on one.
"""
from __future__ import annotations

import os

# libraries keep to one thread where they are not told otherwise
os.environ.update({name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")})

import argparse  # noqa: E402
import json  # noqa: E402
import subprocess  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from perf.printing import table  # noqa: E402

SIZES = (100, 300, 1000, 3000, 10_000, 30_000, 100_000, 300_000, 1_000_000)
QUICK = (100, 1000)
STEP = 1e-3
NET_BEAM = 10  # elements
ONE_THREAD = "no condensed beams: one thread"
LIMIT = 1000  # elements from which on the chain should cost the same
Row = dict[str, Any]


def chain_scene(elements: int, degree: int) -> Any:
    """One clamped beam that begins to fall."""
    import fastbeam as fb
    rod = fb.Section.circle(radius=0.02, E=1e8, rho=1000.0)
    beam = fb.Beam.straight("chain", (0, 0, 0), (0.1 * elements, 0, 0), section=rod, elements=elements, degree=degree)
    return fb.Scene(beam, fb.Clamp(beam.start), gravity=(0, 0, -9.81))


def net_scene(elements: int, degree: int, per_beam: int = NET_BEAM) -> Any:
    """A welded square net of about so many elements."""
    from perf.cases.net_step import square_net
    cells = max(2, round(0.5 * ((1.0 + 2.0 * elements / per_beam)**0.5 - 1.0)))
    return square_net(cells, per_beam, degree, "rigid")


def scene(kind: str, elements: int, degree: int) -> Any:
    """A chain or a net of about so many elements."""
    return chain_scene(elements, degree) if kind == "chain" else net_scene(elements, degree)


def memory(field: str) -> float:
    """VmHWM (largest resident memory so far) or VmRSS (present one) of this process, bytes; not on Linux always the former."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        return 1024.0 * next(int(line.split()[1]) for line in lines if line.startswith(field))
    except (OSError, StopIteration):
        import resource
        size = float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
        return size if sys.platform == "darwin" else 1024.0 * size


def run_case(kind: str, elements: int, degree: int, threads: int, seconds: float) -> Row:
    """One size in this process; seconds: how long to measure."""
    import fastbeam as fb
    from perf.limits import traffic
    from perf.limits.parts import iteration
    from perf.places import private
    Stepper = private("newton", "Stepper")
    WORTH_IN_BEAMS, WORTH_IN_NETS = private("substructuring", "WORTH_IN_BEAMS", "WORTH_IN_NETS")
    # loads the compiled code that the large scene runs
    worth = WORTH_IN_BEAMS if kind == "chain" else WORTH_IN_NETS
    small = fb.compile_scene(scene(kind, 32, degree), planar=False, condense=elements >= worth)
    Stepper(small, np.ones(1), threads=threads).advance(0.0, STEP, 1)
    del small
    whole_before, before = memory("VmHWM"), memory("VmRSS")
    begin = time.perf_counter()
    model = fb.compile_scene(scene(kind, elements, degree), planar=False)
    compiled = time.perf_counter() - begin
    count = number_of_elements(model)
    row: Row = {"kind": kind, "elements": count, "degree": degree, "threads": threads, "unknowns": model.n_unknowns,
                "condensed": model.condensed_elements, "compile, s": compiled}
    if threads > 1 and not model.condensed_elements:
        return row | {"skipped": ONE_THREAD}
    stepper = Stepper(model, np.ones(1), threads=threads)
    # all arrays are touched from now on
    stepper.advance(0.0, STEP, 1)
    row |= {"peak": (memory("VmHWM") - whole_before) / count, "resident": (memory("VmRSS") - before) / count,
            "kept": {name: size / count for name, size in traffic.kept(stepper).items()}}
    spent, per_step, outcome = iteration(stepper, STEP, seconds, threads)
    mixed = traffic.mixed_share(stepper, outcome)
    found = traffic.passes(stepper, per_step, mixed)
    return row | {"iterations a step": per_step, "mixed": mixed, "us": 1e6 * spent / count,
                  "bytes": sum(p.moved for p in found) / count, "passes": {p.name: p.moved / count for p in found},
                  "solver": stepper.linear.name.split(",")[0]}


def number_of_elements(model: Any) -> int:
    """Elements of a model; idle lanes repeat the last element of their group and have rows behind the last."""
    total = 0
    for tables in (model.simo, model.green):
        if tables is not None:
            first = (tables.meta[:, 3, None] + np.arange(8)).reshape(-1)
            total += int(np.sum(tables.rows[first] < model.n_nodes))
    return total


def measure(kind: str, elements: int, degree: int, threads: int, seconds: float, timeout: float = 3600.0) -> Row:
    """Run one size in a fresh process.

    Raises
    ------
    SystemExit
        With what the process said last, where it failed.
    """
    command = [sys.executable, __file__, "--case", kind, str(elements), str(degree), str(threads), str(seconds)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False,
                          env={**os.environ, "FASTBEAM_PROGRESS": "0"})
    if done.returncode:
        raise SystemExit(f"{kind} of {elements} elements: " + (done.stderr.strip().splitlines() or ["no message"])[-1])
    found: Row = json.loads(done.stdout.splitlines()[-1])
    return found


def ratio(rows: list[Row]) -> float | None:
    """Largest time of an element over the smallest, of the chain on one thread from LIMIT elements on; None for fewer than two
    sizes."""
    times = [row["us"] for row in rows
             if row["kind"] == "chain" and row["threads"] == 1 and row["elements"] >= LIMIT and "us" in row]
    return max(times) / min(times) if len(times) > 1 else None


HEADER = ("kind", "elements", "threads", "iterations a step", "us", "kB moved", "limit, us", "limit/time", "kB peak",
          "kB resident", "kB tables", "kB state", "kB work", "kB factors")


def cells(row: Row) -> list[str]:
    """One line of the table."""
    out = [f"{row['kind']} of degree {row['degree']}", f"{row['elements']}", f"{row['threads']}"]
    if "us" not in row:
        return [*out, row["skipped"]]
    kept = row["kept"]
    return [*out, f"{row['iterations a step']:.2f}", f"{row['us']:.3f}", f"{1e-3 * row['bytes']:.2f}", f"{row['limit']:.3f}",
            f"{row['limit'] / row['us']:.2f}", *(f"{1e-3 * x:.2f}" for x in (row["peak"], row["resident"], kept["tables"],
                                                                             kept["state"], kept["work"], kept["factors"]))]


def draw(rows: list[Row], file: Path) -> None:
    """Time and memory of an element against the number of elements."""
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib import ticker
    figure, (times, sizes) = plt.subplots(1, 2, figsize=(10.4, 5.2), layout="constrained")
    color = {"chain": "tab:blue", "net": "tab:orange"}
    for kind in ("chain", "net"):
        for threads in sorted({row["threads"] for row in rows}):
            some = [row for row in rows if row["kind"] == kind and row["threads"] == threads and "us" in row]
            if not some:
                continue
            n = [row["elements"] for row in some]
            style = {"color": color[kind], "linestyle": "-" if threads == 1 else "--", "marker": "o" if threads == 1 else "s"}
            label = f"{kind} of degree {some[0]['degree']}, {threads} thread{'s' * (threads > 1)}"
            times.plot(n, [row["us"] for row in some], label=label, markersize=4, **style)
            times.plot(n, [row["limit"] for row in some], ":" if threads == 1 else "-.", color=color[kind], linewidth=1.0,
                       label=f"{kind}: its bytes at the bandwidth of memory, {threads} thread{'s' * (threads > 1)}")
            sizes.plot(n, [1e-3 * row["peak"] for row in some], label=label, markersize=4, **style)
            if threads == 1:
                sizes.plot(n, [1e-3 * sum(row["kept"].values()) for row in some], ":", color=color[kind], linewidth=1.0,
                           label=f"{kind}: its arrays")
    times.set(xscale="log", yscale="log", xlabel="elements", title="time of an element and Newton iteration, us")
    sizes.set(xscale="log", xlabel="elements", title="memory of an element above an empty run, kB")
    sizes.set_ylim(bottom=0.0)
    times.yaxis.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0)))
    times.yaxis.set_major_formatter(ticker.StrMethodFormatter("{x:g}"))
    times.yaxis.set_minor_formatter(ticker.NullFormatter())
    for axes in (times, sizes):
        axes.grid(True, which="major", color="0.93")
        axes.set_axisbelow(True)
        axes.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=1)
    figure.savefig(file, dpi=110)
    plt.close(figure)


def report(found: dict[str, Any], as_markdown: bool) -> None:
    """Print the table and the ratio."""
    print(table(HEADER, [cells(row) for row in found["rows"]], as_markdown))
    if found["largest ratio"] is not None:
        print(f"\nchain, from {LIMIT} elements on: largest time of an element over the smallest {found['largest ratio']:.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", nargs="+", choices=("chain", "net"), default=["chain", "net"])
    parser.add_argument("--degree", type=int, choices=(1, 2, 3), default=2, help="of the chain")
    parser.add_argument("--net-degree", type=int, choices=(1, 2, 3), default=1)
    parser.add_argument("--sizes", type=int, nargs="+", help="numbers of elements")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--seconds", type=float, help="time of the measurement of one size, default 2")
    parser.add_argument("--quick", action="store_true", help="two small sizes, short measurements, no picture")
    parser.add_argument("--json", type=Path, help="write all values to this file")
    parser.add_argument("--picture", type=Path, help="file of the picture, default docs/reports/scaling.png")
    parser.add_argument("--markdown", action="store_true", help="print the table as it stands in docs/reports/performance.md")
    parser.add_argument("--from", dest="source", type=Path, help="take the values of a run from its JSON file")
    parser.add_argument("--case", nargs=5, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.case:
        kind, elements, degree, threads = options.case[0], *map(int, options.case[1:4])
        print(json.dumps(run_case(kind, elements, degree, threads, float(options.case[4]))))
        return
    if options.source:
        found = json.loads(options.source.read_text())
    else:
        found = run(options)
    report(found, options.markdown)
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n")
    picture = options.picture or (None if options.quick or options.source else ROOT / "docs" / "reports" / "scaling.png")
    if picture is not None:
        draw(found["rows"], picture)
        print(f"drawn: {picture.name}")


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Measure everything that was asked for."""
    from perf.limits.ceilings import Ceilings
    seconds = options.seconds or (0.1 if options.quick else 2.0)
    ceilings = Ceilings(2.0**25) if options.quick else Ceilings()
    rows: list[Row] = []
    for kind in options.kinds:
        degree = options.degree if kind == "chain" else options.net_degree
        for elements in options.sizes or (QUICK if options.quick else SIZES):
            first: Row = {}
            for threads in options.threads:
                if threads > 1 and first.get("condensed") == 0:
                    row = {key: first[key] for key in ("kind", "degree", "elements", "condensed")}
                    row |= {"threads": threads, "skipped": ONE_THREAD}
                else:
                    row = measure(kind, elements, degree, threads, seconds)
                    first = first or row
                if "us" in row:
                    row["limit"] = 1e-3 * row["bytes"] / ceilings.bandwidth(threads=threads)
                rows.append(row)
                print(f"measured: {kind}, {row['elements']} elements, {threads} threads", file=sys.stderr, flush=True)
    # sets threads of libraries when it is imported
    from perf.machine import machine
    return {"machine": machine(), "ceilings": ceilings.facts(), "largest ratio": ratio(rows), "rows": rows}


if __name__ == "__main__":
    main()
