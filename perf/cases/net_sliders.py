"""One Newton iteration of a net of beams with masses, or bodies, that slide on it, next to the same net without: wall time on
one and on two threads in turn, and the memory that sliders take.

    python perf/cases/net_sliders.py [--cells 70] [--elements 10] [--degree 1] [--joints rigid] [--sliders 1000] [--a-beam 1]
                                     [--bodies] [--curve own] [--friction 0.2] [--sleeves 2] [--hangers 2]
                                     [--threads 1 2] [--repeats 5]

A net of (cells + 1)^2 nodes has 2 cells (cells + 1) beams; --a-beam: sliders on every beam that has some; --friction: of each of
them; --sleeves: so many bodies in sleeves on other beams; --hangers: so many beams that hang on sliders at other beams, which are
a dense border. The memory of as many
sliders, one and four on a beam, tells what belongs to a slider and what to a beam that has some: tables of its elements, their
blocks that the substitution needs; in nets of few beams with sliders the work of a thread hides both. Exits with 1 where that of
a slider misses the bar of perf/cases/sliders.py.
"""
from __future__ import annotations

import os

# libraries keep to one thread where they are not told otherwise
os.environ.update({name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")})

import argparse  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

import fastbeam as fb  # noqa: E402
from perf.cases.net_step import STEP, square_net  # noqa: E402
from perf.cases.sliders import BYTES, judged  # noqa: E402
from perf.places import private  # noqa: E402

Stepper = private("newton", "Stepper")


def sliding(scene: fb.Scene, count: int, a_beam: int, options: argparse.Namespace) -> list[Any]:
    """So many masses or bodies and their sliders, on beams all over the net."""
    more = {"curve": options.curve, "friction": options.friction}
    net = scene.nets[0]
    some = np.linspace(0, len(net.edges) - 1, count // a_beam).astype(int).tolist()
    parts: list[Any] = []
    for k in range(count):
        beam = some[k // a_beam]
        at = (0.1 + 0.8 * (k % a_beam + 0.41) / a_beam) * float(net.lengths[beam])
        start = net.nodes[net.edges[beam, 0]]
        place = start + at / float(net.lengths[beam]) * (net.nodes[net.edges[beam, 1]] - start)
        if options.bodies:
            body = fb.RigidBody(f"body {k}", mass=0.05, inertia=1e-4 * np.eye(3), position=tuple(place - (0.0, 0.0, 0.1)))
            parts += [body, fb.Slider(f"slider {k}", body.point((0.0, 0.0, 0.1)), net.beam(beam), at=at, rate=None, **more)]
        else:
            mass = fb.PointMass(f"mass {k}", mass=0.05)
            parts += [mass, fb.Slider(f"slider {k}", mass, net.beam(beam), at=at, rate=0.5, **more)]
    free = np.setdiff1d(np.arange(len(net.edges)), some)
    others = free[np.linspace(0, free.size - 1, options.sleeves + options.hangers).astype(int)].tolist()
    for n, k in enumerate(others):
        place, at = net.nodes[net.edges[k]].mean(axis=0), 0.5 * float(net.lengths[k])
        if n < options.sleeves:
            body = fb.RigidBody(f"in sleeve {k}", mass=0.05, inertia=1e-4 * np.eye(3), position=tuple(place))
            parts += [body, fb.Sleeve(f"sleeve {k}", body, net.beam(k), at=at)]
        else:
            wire = fb.Beam.straight(f"wire {k}", place, place - (0.0, 0.0, 1.0), section=net.sections[0], elements=2, degree=1)
            parts += [wire, fb.Slider(f"of wire {k}", wire.start, net.beam(k), at=at)]
    return parts


def held_memory(stepper: Stepper) -> int:
    """Bytes of all arrays of a run, each once."""
    seen: dict[int, int] = {}

    def walk(x: Any) -> None:
        if isinstance(x, np.ndarray):
            base = x
            while isinstance(base.base, np.ndarray):
                base = base.base
            seen[id(base)] = base.nbytes
        elif isinstance(x, (tuple, list)):
            for y in x:
                walk(y)
        elif isinstance(x, dict):
            walk(list(x.values()))
        elif type(x).__module__.startswith("fastbeam") and not isinstance(x, type) and id(x) not in visited:
            visited.add(id(x))
            walk(list(getattr(x, "__dict__", {}).values()))

    visited = {id(stepper.model)}
    walk(list(stepper.__dict__.values()))
    return sum(seen.values())


def memory_of_sliders(scene: fb.Scene, options: argparse.Namespace, one: int) -> tuple[float, float]:
    """Bytes that belong to a slider and to a beam with sliders; one: bytes of a run with a single slider."""
    beams, taken = [], []
    for a_beam in (1, 4):
        more = sliding(scene, options.sliders, a_beam, options)
        whole = fb.Scene(*scene.parts, *more, gravity=(0, 0, -9.81), project_velocities=not options.bodies)
        stepper = Stepper(fb.compile_scene(whole, planar=False, condense=True), np.ones(1), threads=options.threads[0])
        if stepper.advance(0.0, STEP, 1).status:
            raise SystemExit("the step failed")
        beams.append(options.sliders / a_beam)
        taken.append(held_memory(stepper) - one)
    beam = (taken[0] - taken[1]) / (beams[0] - beams[1])
    return (taken[0] - beam * beams[0]) / options.sliders, beam


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in (("cells", 70), ("elements", 10), ("degree", 1), ("sliders", 1000), ("a-beam", 1), ("repeats", 5)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--joints", choices=("rigid", "ball"), default="rigid")
    parser.add_argument("--curve", choices=("c1", "own"), default="c1")
    parser.add_argument("--bodies", action="store_true")
    parser.add_argument("--friction", type=float)
    parser.add_argument("--sleeves", type=int, default=0)
    parser.add_argument("--hangers", type=int, default=0)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    options = parser.parse_args()
    scene = square_net(options.cells, options.elements, options.degree, options.joints)
    more = sliding(scene, options.sliders, options.a_beam, options)
    models = {}
    # the state before a step and coordinates of all nodes, which one slider asks for, are no memory of a slider
    for name, parts in (("without sliders", []), ("with sliders", more), ("with one", more[:2])):
        begin = time.perf_counter()
        whole = fb.Scene(*scene.parts, *parts, gravity=(0, 0, -9.81), project_velocities=not options.bodies)
        models[name] = fb.compile_scene(whole, planar=False, condense=True)
        print(f"{name}: compiled in {time.perf_counter() - begin:.1f} s, {models[name].n_unknowns} unknowns")
    steppers = {(name, k): Stepper(model, np.ones(1), threads=k) for name, model in models.items()
                for k in (options.threads if name != "with one" else options.threads[:1])}
    best = dict.fromkeys(steppers, np.inf)
    iterations = dict.fromkeys(steppers, 0)
    done = 0
    for repeat in range(options.repeats + 2):
        for key, stepper in steppers.items():
            begin = time.perf_counter()
            outcome = stepper.advance(0.0, STEP, 1, done)
            if outcome.status or stepper.linear.fallbacks:
                raise SystemExit(f"the step failed with status {outcome.status}")
            if repeat > 1:
                best[key] = min(best[key], (time.perf_counter() - begin) / outcome.iterations)
                iterations[key] += outcome.iterations
        done += 1
    for key, seconds in best.items():
        print(f"{key[0]:20s} {key[1]} threads {1e3 * seconds:10.1f} ms an iteration, "
              f"{iterations[key] / options.repeats:.1f} a step")
    for k in options.threads:
        ratio = best["with sliders", k] / best["without sliders", k]
        print(f"{k} threads: with over without {ratio:.3f}, "
              f"{1e6 * (best['with sliders', k] - best['without sliders', k]) / options.sliders:.2f} us a slider")
    k = options.threads[0]
    taken = [held_memory(steppers[name, k]) for name in models]
    print(f"memory of a run {taken[0] / 1e6:.1f} MB without sliders, {taken[2] / 1e6:.1f} MB with one, "
          f"{(taken[1] - taken[2]) / (options.sliders - 1) / 1e3:.2f} kB for each more")
    slider, beam = memory_of_sliders(scene, options, taken[2])
    print(f"of these {beam / 1e3:.2f} kB belong to a beam of {options.elements} elements that has sliders")
    return int(judged([("bytes a slider in a net, without those of its beam", BYTES, slider, "")]) > 0)


if __name__ == "__main__":
    sys.exit(main())
