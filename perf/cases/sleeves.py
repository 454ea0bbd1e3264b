"""What a sleeve costs beside a slider, measured in turn: bodies on one cable.

    python perf/cases/sleeves.py
    python perf/cases/sleeves.py --counts 16 256

Printed are microseconds of an iteration for each body, those of the bare cable taken off, and their ratio to those of sliders on
the C1 curve. The bar: a sleeve takes at most twice as long as a slider.
"""
from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np  # noqa: E402

import fastbeam as fb  # noqa: E402
from perf.cases.sliders import Bar, judged  # noqa: E402
from perf.places import private  # noqa: E402
from perf.printing import table  # noqa: E402
from perf.processes import in_turn, smallest  # noqa: E402

Stepper = private("newton", "Stepper")

BAR, ROUNDS, STEPS, STEP = 2.0, 7, 30, 1e-3
KINDS: dict[str, dict[str, Any] | None] = {"slider": None, "sleeve, bore of an element": {}, "sleeve, a point": {"length": 0.0},
                                           "sleeve, twist free": {"keyed": False}}


def scene(n: int, kind: str | None) -> fb.Scene:
    """A cable of 4 cubic elements a body that flies, with bodies that slide on it; None: without them."""
    section = fb.Section.circle(radius=0.01, E=1e9, rho=1500.0)
    cable = fb.Beam.straight("cable", (0, 0, 0), (0.5 * n, 0, 0), section=section, elements=4 * n)
    motion = fb.InitialVelocity(cable, velocity=lambda s: np.stack((0 * s, np.sin(7.0 * s), 0 * s), axis=1))
    parts: list[Any] = [cable, motion]
    for k in range(n if kind else 0):
        body = fb.RigidBody(f"body {k}", mass=0.2, inertia=(1e-3, 1e-3, 1e-3), position=(0.5 * k + 0.2, 0, 0),
                            velocity=(0.3, 0, 0))
        of = KINDS[str(kind)]
        slider = fb.Slider if of is None else fb.Sleeve
        parts += [body, slider(f"on {k}", body, cable, at=0.5 * k + 0.2, **(of or {}))]
    return fb.Scene(*parts, project_velocities=True)


def measure(n: int, planar: bool | str) -> dict[str, tuple[float, float]]:
    """Microseconds of an iteration, the smallest of several rounds in turn, in this process, and iterations a step."""
    steppers = {kind or "bare": Stepper(fb.compile_scene(scene(n, kind), planar=planar, condense=False), np.ones(1))
                for kind in (None, *KINDS)}
    return {name: (took, iterations) for name, (took, _, iterations) in in_turn(steppers, STEP, STEPS, ROUNDS).items()}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--counts", type=int, nargs="+", default=[16, 64])
    given = parser.parse_args()
    rows: list[list[str]] = []
    bars: list[Bar] = []
    for where, planar in (("plane", "auto"), ("space", False)):
        for n in given.counts:
            found = smallest(measure, n, planar)
            bare, plain = found["bare"][0], found["slider"][0] - found["bare"][0]
            for kind in KINDS:
                took, iterations = found[kind]
                ratio = (took - bare) / plain
                if kind != "slider":
                    bars.append((f"{where}, {n} bodies: iteration with a {kind}, of that of sliders", BAR, ratio, ""))
                rows.append([where, str(n), kind, f"{(took - bare) / n:.1f}", f"{ratio:.2f}", f"{iterations:.1f}"])
    print(table(["", "bodies", "held by", "us each", "of a slider", "iterations a step"], rows))
    return int(judged(bars) > 0)


if __name__ == "__main__":
    sys.exit(main())
