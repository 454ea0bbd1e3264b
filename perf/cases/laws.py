"""What a force by a law of one's own costs beside the same force of the package: drag across a rope in space, measured in turn.

    python perf/cases/laws.py
    python perf/cases/laws.py --elements 50 200

Printed are microseconds of an iteration of the rope alone, with `Drag(normal=k)`, and with that as a `UserForce`, with its
derivative by differences and given; how far their motions are apart; and the ratio of what they add to the iteration of the rope,
and of whole iterations. The bar: an iteration with a law of one's own takes at most 1.3 times as long as with the drag.
"""
from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np  # noqa: E402

import fastbeam as fb  # noqa: E402
from perf.places import private  # noqa: E402
from perf.printing import Bar, judged, table  # noqa: E402
from perf.processes import in_turn, smallest  # noqa: E402

Stepper = private("newton", "Stepper")

BAR, ROUNDS, STEPS, STEP = 1.3, 7, 30, 1e-3
K = 0.4
KINDS = ("rope alone", "Drag", "law, differences", "law, derivative given")


def law(t, position, directors, velocity, spin, parameters, force, moment):  # type: ignore[no-untyped-def]
    """Drag by the square of the velocity across d1, which in the middle of a step is shorter than 1."""
    size = directors[0, 0]**2 + directors[0, 1]**2 + directors[0, 2]**2
    along = (velocity[0] * directors[0, 0] + velocity[1] * directors[0, 1] + velocity[2] * directors[0, 2]) / size
    x = velocity[0] - along * directors[0, 0]
    y = velocity[1] - along * directors[0, 1]
    z = velocity[2] - along * directors[0, 2]
    speed = np.sqrt(x * x + y * y + z * z)
    force[0] = -parameters[0] * speed * x
    force[1] = -parameters[0] * speed * y
    force[2] = -parameters[0] * speed * z


def derivative(t, position, directors, velocity, spin, parameters, out):  # type: ignore[no-untyped-def]
    """Of the law, by velocity (columns 12 to 14) and d1 (3 to 5)."""
    size = directors[0, 0]**2 + directors[0, 1]**2 + directors[0, 2]**2
    along = (velocity[0] * directors[0, 0] + velocity[1] * directors[0, 1] + velocity[2] * directors[0, 2]) / size
    x = velocity[0] - along * directors[0, 0]
    y = velocity[1] - along * directors[0, 1]
    z = velocity[2] - along * directors[0, 2]
    speed = np.sqrt(x * x + y * y + z * z)
    w, u = (x, y, z), (directors[0, 0] / size, directors[0, 1] / size, directors[0, 2] / size)
    over = 1.0 / speed if speed > 0.0 else 0.0
    for i in range(3):
        for j in range(3):
            # of speed w_i by w_j
            by = parameters[0] * (w[i] * w[j] * over + (speed if i == j else 0.0))
            for k in range(3):
                # of w_j by the velocity and by d1
                out[i, 12 + k] += by * u[j] * directors[0, k]
                out[i, 3 + k] += by * u[j] * (velocity[k] - 2.0 * along * directors[0, k])
            out[i, 12 + j] -= by
            out[i, 3 + j] += by * along


def scene(elements: int, kind: str) -> fb.Scene:
    """A rope that falls sideways from a pin."""
    section = fb.Section.circle(radius=0.01, E=1e8, rho=1000.0)
    rope = fb.Beam.straight("rope", (0, 0, 0), (2, 0, 0), section=section, elements=elements, degree=3)
    parts: list[Any] = [rope, fb.Pin(rope.start), fb.InitialVelocity(rope, velocity=lambda s: np.outer(s, (0, 1.5, 0)))]
    if kind == "Drag":
        parts.append(fb.Drag("air", rope, normal=K))
    elif kind != "rope alone":
        given = {"derivative": derivative} if "given" in kind else {}
        parts.append(fb.UserForce("air", rope, law, parameters=(K,), **given))
    return fb.Scene(*parts, gravity=(0, 0, -9.81), project_velocities=True)


def measure(elements: int) -> dict[str, tuple[float, ...]]:
    """Microseconds of an iteration in this process, and how far the end of the rope is from where it is with `Drag`, m."""
    models = {kind: fb.compile_scene(scene(elements, kind), planar=False, condense=False) for kind in KINDS}
    steppers = {kind: Stepper(model, np.ones(1)) for kind, model in models.items()}
    best = in_turn(steppers, STEP, STEPS, ROUNDS)
    ends = {kind: stepper.state.q.reshape(-1, 12)[-1, :3] for kind, stepper in steppers.items()}
    return {kind: (best[kind][0], float(np.max(np.abs(ends[kind] - ends["Drag"])))) for kind in KINDS}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--elements", type=int, nargs="+", default=[50, 200])
    rows: list[list[str]] = []
    bars: list[Bar] = []
    for n in parser.parse_args().elements:
        found = smallest(measure, n)
        alone, drag = found["rope alone"][0], found["Drag"][0]
        for kind, (took, apart) in found.items():
            own = kind.startswith("law")
            added = f"{(took - alone) / (drag - alone):.2f}" if own else ""
            rows.append([str(n), kind, f"{took:.1f}", added, f"{took / drag:.2f}" if own else "", f"{apart:.0e}" if own else ""])
            if own:
                bars.append((f"{n} elements, {kind}: iteration over that with Drag", BAR, took / drag, ""))
    print(table(["elements", "", "us an iteration", "added, of Drag's", "iteration, of Drag's", "apart, m"], rows, left=(1,)))
    return int(judged(bars) > 0)


if __name__ == "__main__":
    sys.exit(main())
