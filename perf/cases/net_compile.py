"""Nets and long chains from arrays to the first step: time by phase, peak memory, bytes of an element by array.

    python perf/cases/net_compile.py [--beams 1000 10000 100000] [--chains 100000 1000000] [--no-step]

Every case runs in a fresh process, after a small scene of the same kind that loads the compiled code.
"""
from __future__ import annotations

import os

# one thread everywhere, before any library starts its pool
os.environ.update({name: "1" for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS",
                                           "FASTBEAM_THREADS")})

import argparse  # noqa: E402
import json  # noqa: E402
import subprocess  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

import fastbeam as fb  # noqa: E402
from perf.machine import peak  # noqa: E402
from perf.places import module, private  # noqa: E402

numbered = module("numbered")
ordering = module("ordering")
unpacked = module("unpacked")
Stepper = private("newton", "Stepper")
ElementPacker = private("tables", "ElementPacker")

Array = np.ndarray
SECTION = fb.Section.circle(radius=0.02, E=1e8, rho=1000.0)
STEP = 1e-3
INITIAL = "initial_rates" if hasattr(unpacked, "initial_rates") else "initial_state"
PHASES = {"nodes": (numbered, "NodeList"), "joints": (numbered, "_connections"), "state": (unpacked, INITIAL),
          "blocks": (ordering, "Blocks"), "elements": (ElementPacker, "tables")}


def square_net(beams: int, joints: str) -> fb.Scene:
    """About so many beams of 2 elements of degree 2 in a square net, pinned along one side, under gravity."""
    m = max(2, round((0.5 * beams)**0.5))
    k = np.arange((m + 1)**2).reshape(m + 1, m + 1)
    x, y = np.divmod(k, m + 1)
    nodes = np.stack((x, y, 0.1 * np.random.default_rng(0).standard_normal(x.shape)), axis=-1).reshape(-1, 3)
    edges = np.concatenate([np.stack(pair, axis=-1).reshape(-1, 2) for pair in ((k[:-1], k[1:]), (k[:, :-1], k[:, 1:]))])
    net = fb.Net("net", nodes, edges, section=SECTION, elements=2, degree=2, joints=joints, pins=np.arange(m + 1))
    return fb.Scene(net, gravity=(0, 0, -9.81))


def long_chain(elements: int, degree: int) -> fb.Scene:
    """One clamped beam under gravity."""
    beam = fb.Beam.straight("chain", (0, 0, 0), (0.1 * elements, 0, 0), section=SECTION, elements=elements, degree=degree)
    return fb.Scene(beam, fb.Clamp(beam.start), gravity=(0, 0, -9.81))


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    begin = time.perf_counter()
    result = work()
    return result, time.perf_counter() - begin


def watched(spent: dict[str, float]) -> None:
    """Have the phases of the compiler add their time to `spent`."""
    for phase, (owner, name) in PHASES.items():
        inside = getattr(owner, name)

        def measured(*args: Any, phase: str = phase, inside: Any = inside, **options: Any) -> Any:
            result, seconds = timed(lambda: inside(*args, **options))
            spent[phase] = spent.get(phase, 0.0) + seconds
            return result

        setattr(owner, name, measured)


def array_sizes(model: fb.Model, stepper: Stepper, elements: int) -> dict[str, float]:
    """Bytes of an element of everything that a model and a run hold by name, without the factors of inner nodes of the model,
    which are never touched."""
    out: dict[str, float] = {}

    def add(prefix: str, x: Any) -> None:
        if isinstance(x, np.ndarray):
            out[prefix] = x.nbytes / elements
        elif hasattr(x, "_fields"):
            for name in x._fields:
                add(f"{prefix}.{name}", getattr(x, name))

    for name in ("simo", "ties", "held", "loads", "gravity_weight", "constant_load", "q0", "v0", "spin_root"):
        add(f"model.{name}", getattr(model, name))
    add("model.pattern.row_of", model.pattern.row_of)
    add("model.pattern.keys", model.pattern.keys)
    add("model.pattern.plan", model.pattern.plan)
    add("state", stepper.state)
    add("work", stepper.work)
    add("inner", stepper.inner)
    if stepper.linear.pardiso is not None:
        out["pardiso"] = sum(x.nbytes for x in stepper.linear.pardiso.arrays) / elements
    return out


def run_case(kind: str, variant: str, size: int, step: bool) -> dict[str, Any]:
    """One measurement in this process."""
    def build(n: int) -> fb.Scene:
        return square_net(n, variant) if kind == "net" else long_chain(n, int(variant))

    solver = "sparse" if kind == "net" else "chain"
    small = fb.compile_scene(build(8), solver=solver)
    if step:
        Stepper(small, np.ones(1)).advance(0.0, STEP, 1)
    out: dict[str, Any] = {"at rest": peak()}
    spent: dict[str, float] = {}
    watched(spent)
    scene, out["describe"] = timed(lambda: build(size))
    model, out["compile"] = timed(lambda: fb.compile_scene(scene))
    out |= {"phases": spent, "compiled": peak(), "unknowns": model.n_unknowns, "solver": model.solver}
    out["elements"] = elements = int(scene.nets[0].elements.sum()) if kind == "net" else size
    out["beams"] = len(scene.nets[0].edges) if kind == "net" else 1
    if step:
        stepper, out["prepare"] = timed(lambda: Stepper(model, np.ones(1)))
        outcome, seconds = timed(lambda: stepper.advance(0.0, STEP, 1))
        out |= {"status": outcome.status, "iterations": outcome.iterations, "iteration": seconds / max(outcome.iterations, 1),
                "increments": [float(x) for x in outcome.sizes[:outcome.iterations]], "run": peak(), "by": stepper.linear.name,
                "arrays": array_sizes(model, stepper, elements)}
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--beams", type=int, nargs="*", default=[1000, 10000, 100000])
    parser.add_argument("--chains", type=int, nargs="*", default=[100000, 1000000])
    parser.add_argument("--no-step", action="store_true", help="compile only")
    parser.add_argument("--case", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.case:
        kind, variant, size = options.case
        print(json.dumps(run_case(kind, variant, int(size), not options.no_step)))
        return
    cases = [("net", joints, n) for joints in ("rigid", "ball") for n in options.beams]
    cases += [("chain", degree, n) for degree in ("1", "3") for n in options.chains if int(degree) * n <= 1000000]
    for kind, variant, size in cases:
        command = [sys.executable, __file__, "--case", kind, variant, str(size), *(["--no-step"] if options.no_step else [])]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            print(f"{kind} {variant} {size}: failed\n{done.stderr}")
            continue
        x = json.loads(done.stdout.splitlines()[-1])
        name = f"{x['beams']} beams, {variant}" if kind == "net" else f"chain of degree {variant}"
        print(f"\n{name}: {x['elements']} elements, {x['unknowns']} unknowns, {x['solver']} solver")
        phases = ", ".join(f"{phase} {seconds:.2f}" for phase, seconds in x["phases"].items())
        print(f"  describe {x['describe']:.2f} s, compile {x['compile']:.2f} s ({phases}, rest "
              f"{x['compile'] - sum(x['phases'].values()):.2f})")
        memory = f"  peak memory above {x['at rest']:.0f} MB: compile {x['compiled'] - x['at rest']:.0f} MB"
        if not options.no_step:
            more = x["run"] - x["at rest"]
            memory += f", step {more:.0f} MB ({1e3 * more / x['elements']:.2f} kB an element)"
            print(f"  prepare {x['prepare']:.2f} s, a Newton iteration {x['iteration']:.3f} s, status {x['status']}, increments "
                  + ", ".join(f"{size:.0e}" for size in x["increments"]))
            print(f"  {x['by']}")
        print(memory)
        if not options.no_step and size == max(options.beams if kind == "net" else options.chains):
            print(f"  bytes of an element, {sum(x['arrays'].values()):.0f} in all: "
                  + ", ".join(f"{array} {b:.0f}" for array, b in sorted(x["arrays"].items(), key=lambda e: -e[1]) if b >= 40))


if __name__ == "__main__":
    main()
