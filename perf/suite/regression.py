"""The benchmark suite: few cases that take different paths through fastbeam, each in a fresh process with one thread.

    python perf/suite/regression.py                      all cases but the largest; prints a table
    python perf/suite/regression.py beam slider          some of them
    python perf/suite/regression.py --large              with the net of 1e6 unknowns and the compilation with an empty cache
    python perf/suite/regression.py --json out.json      values, machine and versions as JSON
    python perf/suite/regression.py --list               what there is

Times are the smallest of several repetitions of the same work: other programs only add to them. `perf/suite/compare.py` runs two
revisions in turn with the cases of this file.
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
import tempfile  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable  # noqa: E402
from dataclasses import dataclass  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from perf.machine import machine, peak  # noqa: E402

STEP = 1e-3
Values = dict[str, tuple[float, str]]


@dataclass(frozen=True)
class Case:
    """One entry of the suite: `measure` returns name -> (value, unit); smaller is better."""

    measure: Callable[[], Values]
    what: str
    large: bool = False


def section() -> Any:
    """A rod of 4 cm."""
    import fastbeam as fb
    return fb.Section.circle(radius=0.02, E=1e8, rho=1000.0)


def a_step(model: Any, step: float, steps: int, repeats: int = 9) -> float:
    """Thread time of a step of a run without observers, all its Newton iterations, us: fewer of them count, too."""
    from perf.places import private
    Stepper = private("newton", "Stepper")
    stepper = Stepper(model, np.ones(1))
    start = stepper.copy_state()
    stepper.advance(0.0, step, 2)
    best = np.inf
    for _ in range(repeats):
        stepper.set_state(start)
        begin = time.thread_time()
        outcome = stepper.advance(0.0, step, steps)
        best = min(best, (time.thread_time() - begin) / steps)
        if outcome.steps != steps:
            raise RuntimeError("the run stopped early: nothing was measured")
    return 1e6 * best


# --- cases ------------------------------------------------------------------------------------------------------------
def spinning(elements: int) -> Any:
    """A free beam that bends, twists and turns."""
    import fastbeam as fb
    beam = fb.Beam.straight("beam", (0, 0, 0), (10, 0, 0), section=section(), elements=elements, degree=2)
    motion = fb.InitialVelocity(beam, velocity=lambda s: np.stack((0 * s, np.sin(0.6 * s), 0.5 * np.cos(0.4 * s)), axis=1),
                                spin=lambda s: np.stack((0.2 + 0 * s, 0.2 * np.sin(0.4 * s), 0.6 * np.cos(0.6 * s)), axis=1))
    return fb.compile_scene(fb.Scene(beam, motion))


def beam() -> Values:
    return {"step": (a_step(spinning(20), STEP, 400), "us")}


def chain() -> Values:
    return {"step": (a_step(spinning(1000), STEP, 10), "us")}


def sliding(planar: bool) -> Values:
    """A mass that runs along a hanging beam."""
    import fastbeam as fb
    rail = fb.Beam.straight("rail", (0, 0, 0), (2, 0, 0), section=section(), elements=8)
    mass = fb.PointMass("mass", mass=0.3)
    scene = fb.Scene(rail, mass, fb.Clamp(rail.start), fb.Slider("run", mass, rail, at=1.1, rate=0.4), gravity=(0, 0, -9.81))
    return {"step": (a_step(fb.compile_scene(scene, planar="auto" if planar else False), STEP, 200), "us")}


def square_net(cells: int) -> Any:
    """Beams of 2 elements of degree 2 between (cells + 1)^2 nodes, pinned along one side, under gravity."""
    import fastbeam as fb
    k = np.arange((cells + 1)**2).reshape(cells + 1, cells + 1)
    x, y = np.divmod(k, cells + 1)
    nodes = np.stack((x, y, 0.1 * np.random.default_rng(0).standard_normal(x.shape)), axis=-1).reshape(-1, 3)
    edges = np.concatenate([np.stack(pair, axis=-1).reshape(-1, 2) for pair in ((k[:-1], k[1:]), (k[:, :-1], k[:, 1:]))])
    net = fb.Net("net", nodes, edges, section=section(), elements=2, degree=2, joints="rigid", pins=np.arange(cells + 1))
    return fb.Scene(net, gravity=(0, 0, -9.81))


def net(cells: int, steps: int, repeats: int) -> Values:
    import fastbeam as fb
    begin = time.perf_counter()
    model = fb.compile_scene(square_net(cells))
    compiled = time.perf_counter() - begin
    elements = 4 * cells * (cells + 1)
    return {"compile": (compiled, "s"), "step": (a_step(model, STEP, steps, repeats) / elements, "us per element"),
            "memory": (peak(), "MB")}


def ring_on_cable() -> Values:
    """The scene of examples/ring_on_cable.py, with its step."""
    import fastbeam as fb
    sys.path.insert(0, str(ROOT / "examples"))
    from ring_on_cable import build
    return {"step": (a_step(fb.compile_scene(build()), 5e-4, 400, 5), "us")}


def net_with_sliders(cells: int, count: int) -> Values:
    """The welded net with masses that run along some of its beams, each from its middle."""
    import fastbeam as fb
    scene = square_net(cells)
    net = scene.nets[0]
    for k, beam in enumerate(np.linspace(0, len(net.edges) - 1, count).astype(int).tolist()):
        mass = fb.PointMass(f"mass {k}", mass=0.05)
        scene.add(mass, fb.Slider(f"slider {k}", mass, net.beam(beam), at=0.45 * float(net.lengths[beam]), rate=0.3))
    elements = 4 * cells * (cells + 1)
    return {"step": (a_step(fb.compile_scene(scene), STEP, 2, 3) / elements, "us per element"), "memory": (peak(), "MB")}


def statics() -> Values:
    """A cantilever rolled up to a circle by a moment, 100 elements."""
    import fastbeam as fb
    rod = section()
    beam = fb.Beam.straight("beam", (0, 0, 0), (4, 0, 0), section=rod, elements=100)
    moment = fb.Load("roll", beam.end, moment=(0, 2.0 * np.pi * rod.EI2 / 4.0, 0))
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), moment))
    fb.solve_static(model)
    best = np.inf
    for _ in range(5):
        begin = time.thread_time()
        result = fb.solve_static(model)
        best = min(best, time.thread_time() - begin)
    return {"whole": (1e3 * best, "ms"), "iterations": (float(result.info["iterations"]), "")}


def many_beams() -> Values:
    import fastbeam as fb
    fb.compile_scene(square_net(4))
    scene = square_net(223)
    begin = time.perf_counter()
    fb.compile_scene(scene)
    return {"compile": (time.perf_counter() - begin, "s"), "memory": (peak(), "MB")}


def long_chain() -> Values:
    """Bytes of a run, without those of an empty process."""
    import fastbeam as fb
    elements = 100_000
    a_step(spinning(8), STEP, 2, 1)  # loads the compiled code
    before = peak()
    rod = fb.Beam.straight("chain", (0, 0, 0), (0.1 * elements, 0, 0), section=section(), elements=elements, degree=2)
    model = fb.compile_scene(fb.Scene(rod, fb.Clamp(rod.start), gravity=(0, 0, -9.81)))
    spent = a_step(model, STEP, 2, 2)
    return {"step": (spent / elements, "us per element"),
            "memory": ((peak() - before) * 1024.0 / elements, "kB per element")}


SMALL_SCENE = """
import time
begin = time.perf_counter()
import fastbeam as fb
light = time.perf_counter() - begin
rod = fb.Section.circle(radius=0.01, E=1e8, rho=1000.0)
beam = fb.Beam.straight("rail", (0, 0, 0), (1, 0, 0), section=rod, elements=4)
mass = fb.PointMass("bead", mass=0.1)
model = fb.compile_scene(fb.Scene(beam, mass, fb.Slider("run", mass, beam, at=0.3, rate=1.0)))
fb.simulate(model, t_end=0.001, step=0.001, progress=False)
print(light, time.perf_counter() - begin)
"""


def fresh(**environment: str) -> tuple[float, float]:
    """(import, import to first step), s, of a fresh process."""
    done = subprocess.run([sys.executable, "-c", SMALL_SCENE], capture_output=True, text=True, check=True,
                          env={**os.environ, "PYTHONDONTWRITEBYTECODE": "", **environment})
    light, whole = done.stdout.split()[-2:]
    return float(light), float(whole)


def warm_start() -> Values:
    fresh()
    times = np.array([fresh() for _ in range(5)])
    return {"import": (1e3 * float(times[:, 0].min()), "ms"), "first step": (float(times[:, 1].min()), "s")}


def cold_start() -> Values:
    with tempfile.TemporaryDirectory() as folder:
        return {"first step": (fresh(FASTBEAM_CACHE_DIR=folder)[1], "s")}


CASES = {
    "beam": Case(beam, "free beam, 20 elements of degree 2"),
    "chain": Case(chain, "free beam, 1000 elements of degree 2"),
    "slider": Case(lambda: sliding(False), "mass on a beam of 8 elements of degree 3, in space"),
    "planar": Case(lambda: sliding(True), "the same in its plane"),
    "ring on cable": Case(ring_on_cable, "the example of this name, 32 elements of degree 3 in a plane"),
    "net": Case(lambda: net(28, 2, 3), "welded net, 1e4 unknowns at the joints and more within"),
    "net sliders": Case(lambda: net_with_sliders(28, 100), "the same net with 100 masses that slide on its beams"),
    "statics": Case(statics, "roll-up of a cantilever, 100 elements of degree 3"),
    "many beams": Case(many_beams, "compile_scene of a net of 1e5 beams"),
    "long chain": Case(long_chain, "clamped beam, 1e5 elements of degree 2"),
    "warm start": Case(warm_start, "fresh process, kernels in the cache"),
    "cold start": Case(cold_start, "fresh process, empty cache", large=True),
    "large net": Case(lambda: net(260, 1, 1), "welded net, 1e6 unknowns", large=True),
}


# --- running them -----------------------------------------------------------------------------------------------------
def measure(name: str, source: Path | None = None, timeout: float = 1800.0) -> dict[str, tuple[float, str]] | str:
    """Run one case in a fresh process with the package at `source`; its values, or why there are none."""
    environment = {**os.environ, "PYTHONPATH": str(source or ROOT / "src"), "FASTBEAM_PROGRESS": "0"}
    try:
        done = subprocess.run([sys.executable, __file__, "--case", name], capture_output=True, text=True,
                              env=environment, timeout=timeout)
    except subprocess.TimeoutExpired:
        return f"took longer than {timeout:.0f} s"
    if done.returncode:
        return (done.stderr.strip().splitlines() or ["no message"])[-1]
    return {key: (value, unit) for key, (value, unit) in json.loads(done.stdout.splitlines()[-1]).items()}


def chosen(names: list[str], large: bool) -> list[str]:
    """Cases to run, in the order of the suite.

    Raises
    ------
    SystemExit
        A case that does not exist.
    """
    unknown = [name for name in names if name not in CASES]
    if unknown:
        raise SystemExit(f"no case is called {unknown[0]!r}: choose from {', '.join(CASES)}")
    return [name for name, case in CASES.items() if (name in names if names else large or not case.large)]


def main() -> int:
    """Measure and print; the number of cases that failed."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("cases", nargs="*")
    parser.add_argument("--large", action="store_true", help="also the largest cases")
    parser.add_argument("--json", type=Path, help="write all values to this file")
    parser.add_argument("--list", action="store_true", help="name the cases and end")
    parser.add_argument("--case", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.case:
        print(json.dumps(CASES[options.case].measure()))
        return 0
    if options.list:
        for name, case in CASES.items():
            print(f"{name:16} {case.what}{' (--large)' if case.large else ''}")
        return 0
    found: dict[str, Any] = {}
    failed = 0
    for name in chosen(options.cases, options.large):
        values = measure(name)
        if isinstance(values, str):
            failed += 1
            print(f"{name:16} FAILED: {values}", flush=True)
            continue
        found[name] = values
        for key, (value, unit) in values.items():
            print(f"{name:16} {key:12} {value:12.4g} {unit:16} {CASES[name].what}", flush=True)
    if options.json:
        options.json.write_text(json.dumps({"machine": machine(), "cases": found}, indent=1) + "\n")
    return failed


if __name__ == "__main__":
    raise SystemExit(main())
