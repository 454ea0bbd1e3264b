"""What damping of sections and filters of strains (`rho_inf`) cost beside the same beams without them, measured in turn.

    python perf/cases/damping.py
    python perf/cases/damping.py --elements 1000 4000

A swinging cantilever. Printed are microseconds of an iteration and of a step, and their ratios to those without damping; a step
has the account of the energy besides its iterations. The bar: an iteration with damping takes at most 1.03 times as long.
"""
from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np  # noqa: E402

import fastbeam as fb  # noqa: E402
from perf.places import module, private  # noqa: E402
from perf.printing import table  # noqa: E402

FilteringStepper = private("filtering", "FilteringStepper")
kernels = module("kernels.step")
Method = private("methods", "Method")
AUGMENTATION, Stepper = private("newton", "AUGMENTATION", "Stepper")

BAR, ROUNDS, STEP = 1.03, 40, 1e-3
KINDS = {"none": 0.0, "a time": 1e-4, "a matrix": 1e-4, "rho_inf": 0.0}


def scene(elements: int, kind: str) -> fb.Scene:
    """The cantilever; a matrix of damping is that of the time, which makes no section coupled."""
    plain = fb.Section.circle(radius=0.01, E=1e9, rho=1000.0, damping=KINDS[kind])
    section = plain if kind != "a matrix" else fb.Section.circle(radius=0.01, E=1e9, rho=1000.0, damping=plain.D)
    beam = fb.Beam.straight("beam", (0, 0, 0), (2, 0, 0), section=section, elements=elements, degree=3)
    return fb.Scene(beam, fb.Clamp(beam.start), gravity=(0, 0, -9.81))


def iteration(stepper: Stepper, repeat: int) -> float:
    """Microseconds of residual, tangent and solution, at the present state."""
    terms, system = stepper.records
    kernels.begin(terms, system, STEP)
    begin = time.thread_time()
    for _ in range(repeat):
        kernels.assemble_all(terms, system, STEP)
        kernels.fill_right(terms, system)
        kernels.solve_right(terms, system)
        kernels.close_right(terms, system)
    return 1e6 * (time.thread_time() - begin) / repeat


def measure(elements: int, planar: bool | str) -> dict[str, tuple[float, float, float]]:
    """Microseconds of an iteration, of a step, and iterations of a step: the least of several rounds in turn."""
    models = {kind: fb.compile_scene(scene(elements, kind), planar=planar, condense=False) for kind in KINDS}
    filtering = Method("energy_momentum", rho_inf=0.8)
    steppers = {kind: Stepper(model, np.ones(1)) if kind != "rho_inf" else
                FilteringStepper(model, np.ones(1), None, 25, "auto", filtering, 0.0, None, AUGMENTATION, None)
                for kind, model in models.items()}
    best = dict.fromkeys(steppers, (np.inf, np.inf, 0.0))
    for k in range(ROUNDS):
        for kind, stepper in steppers.items():
            begin = time.thread_time()
            outcome = stepper.advance(0.0, STEP, 10, 10 * k)
            took = 1e5 * (time.thread_time() - begin)
            assert outcome.status == 0 and stepper.linear.fallbacks == 0, (kind, outcome)
            alone = iteration(stepper, max(5, 4000 // elements))
            if k:
                best[kind] = min(best[kind][0], alone), min(best[kind][1], took), outcome.iterations / 10
    return best


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--elements", type=int, nargs="+", default=[1000])
    rows, missed = [], []
    for where, planar in (("plane", "auto"), ("space", False)):
        for n in parser.parse_args().elements:
            found = measure(n, planar)
            plain = found["none"]
            for kind, (alone, whole, count) in found.items():
                ratio = alone / plain[0]
                rows.append([where, str(n), kind, f"{alone:.2f}", f"{ratio:.3f}", f"{whole:.2f}", f"{count:.1f}",
                             f"{whole / count / (plain[1] / plain[2]):.3f}"])
                if ratio > BAR and kind != "rho_inf":
                    missed.append(f"{where}, {n} elements, {kind}: {ratio:.3f}, at most {BAR}")
    print(table(["", "elements", "damping", "us an iteration", "ratio", "us a step", "iterations", "ratio of steps"], rows))
    for line in missed:
        print("missed:", line)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
