"""What friction, drives and stops of sliders cost beside sliders without them, measured in turn.

    python perf/cases/friction.py
    python perf/cases/friction.py --counts 16 256

Sliders of sliders.py on one cable. Printed are microseconds of an iteration and of a step for each slider, those of the bare
cable taken off, and their ratio to those of plain sliders. The bar: an iteration with friction takes at most 1.2 times as long.
"""
from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np  # noqa: E402

import fastbeam as fb  # noqa: E402
from perf.cases import sliders as plain  # noqa: E402
from perf.places import private  # noqa: E402
from perf.printing import table  # noqa: E402
from perf.processes import in_turn, smallest  # noqa: E402

Stepper = private("newton", "Stepper")

BAR, ROUNDS, STEPS = 1.2, 12, 30
FORCES: dict[str, dict[str, Any]] = {
    "plain": {}, "friction": {"friction": 0.2}, "viscous": {"friction": fb.Friction(viscous=0.1)},
    "speed": {"drive": fb.Drive(speed=0.5), "rate": None},
    "law": {"drive": fb.Drive(force=lambda t, s, rate: 0.1 * np.sin(t) - 0.1 * rate)},
    "elastic stops": {"stops": fb.Stops(0.0, stiffness=1e4)}}


def scene(n: int, forces: dict[str, Any] | None) -> fb.Scene:
    """The cable with n sliders with these forces; None: without sliders."""
    found = plain.cable(n, 2, "c1", bare=forces is None)
    parts = [replace(x, **forces) if isinstance(x, fb.Slider) and forces else x for x in found.parts]
    return fb.Scene(*parts, gravity=found.gravity)


def measure(n: int, planar: bool) -> dict[str, tuple[float, float]]:
    """Microseconds of an iteration and of a step, the smallest of several rounds in turn, in this process."""
    steppers = {"bare": Stepper(fb.compile_scene(scene(n, None), planar=planar, condense=False), np.ones(1))}
    steppers |= {name: Stepper(fb.compile_scene(scene(n, forces), planar=planar, condense=False), np.ones(1))
                 for name, forces in FORCES.items()}
    return {name: (iteration, step) for name, (iteration, step, _) in in_turn(steppers, plain.STEP, STEPS, ROUNDS).items()}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--counts", type=int, nargs="+", default=[16, 64])
    given = parser.parse_args()
    rows: list[list[str]] = []
    found: list[plain.Bar] = []
    for kind, planar in (("plane", "auto"), ("space", False)):
        for n in given.counts:
            taken = smallest(measure, n, planar)
            own = {name: (a - taken["bare"][0], b - taken["bare"][1]) for name, (a, b) in taken.items()}
            for name in FORCES:
                ratio = own[name][0] / own["plain"][0]
                rows.append([kind, str(n), name, f"{own[name][0] / n:.2f}", f"{ratio:.2f}", f"{own[name][1] / n:.2f}",
                             f"{own[name][1] / own['plain'][1]:.2f}"])
                if name == "friction":
                    found.append((f"{kind}, {n} sliders: iteration with Coulomb friction, of that without", BAR, ratio, ""))
    print(table(["kind", "sliders", "forces", "us an iteration", "ratio", "us a step", "ratio"], rows))
    return int(plain.judged(found) > 0)


if __name__ == "__main__":
    sys.exit(main())
