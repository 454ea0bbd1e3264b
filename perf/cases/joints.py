"""Joints with multipliers: time of a Newton iteration for each joint.

    python perf/cases/joints.py                   chains of 1000, 10 000 and 100 000 bodies in space
    python perf/cases/joints.py --planar          the same in a plane
    python perf/cases/joints.py --bodies 5000     one chain
    python perf/cases/joints.py --with friction   every hinge rubs; also: given (an angle as a function of time), stops, spring
    python perf/cases/joints.py --scene hub       4 and 32 beams, hinged at both ends to two bodies
    python perf/cases/joints.py --scene net       masses on grids of 5 x 5 to 30 x 30 with distance joints
    python perf/cases/joints.py --scene grid      chains of 10 to 100 bodies on hinges, as many side by side, springs between them

A chain of up to 1000 bodies hangs from the ground between hinges whose axes are turned by a right angle from one to the next
(planar: all the same) and swings under its weight; more bodies are more such chains. Prints the time to compile the scene, Newton
iterations a step, the time of an iteration for each joint, and the largest gap.
"""
from __future__ import annotations

import os

os.environ.setdefault("FASTBEAM_THREADS", "1")

import argparse  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

STEP, STEPS, LONGEST = 1e-3, 10, 1000


def chains(bodies: int, planar: bool = False, more: str | None = None) -> Any:
    """Straight chains of up to 1000 bodies along x, 0.1 m long each with joints at their ends, side by side; more: what acts in
    every joint."""
    import fastbeam as fb
    in_joints: dict[str, dict[str, Any]] = {
        "friction": {"friction": 1e-3}, "given": {"angle": lambda t: 0.1 * t**2}, "spring": {"stiffness": 1.0},
        "stops": {"stops": fb.Stops(-1e-6, 1e-6, stiffness=100.0)}}
    options = in_joints[more] if more else {}
    half, axes = np.array([0.05, 0.0, 0.0]), ((0, 1, 0), (0, 0, 1))
    parts: list[Any] = []
    for first in range(0, bodies, LONGEST):
        height = 0.0 if planar else 0.1 * first / LONGEST
        links = [fb.RigidBody(f"link {first + k}", mass=0.1, inertia=(1e-4, 2e-4, 2e-4), position=(0.1 * k + 0.05, height, 0))
                 for k in range(min(LONGEST, bodies - first))]
        parts += [*links, fb.RevoluteJoint(fb.GROUND, links[0].point(-half), f"joint {first}", axis=axes[0], **options)]
        parts += [fb.RevoluteJoint(a.point(half), b.point(-half), f"joint {first + k}", axis=axes[0 if planar else k % 2],
                                   **options)
                  for k, (a, b) in enumerate(zip(links, links[1:]), 1)]
    return fb.Scene(*parts, gravity=(0, 0, -9.81))


def hub(beams: int) -> Any:
    """Beams between two bodies, around their axis."""
    import fastbeam as fb
    section = fb.Section.circle(radius=0.005, E=1e9, rho=1000.0)
    ends = [fb.RigidBody(name, mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0, 0, z))
            for name, z in (("low", 0.0), ("high", 1.0))]
    parts: list[Any] = [*ends]
    for k in range(beams):
        out = np.array([np.cos(2 * np.pi * k / beams), np.sin(2 * np.pi * k / beams), 0.0])
        beam = fb.Beam.straight(f"beam {k}", 0.5 * out, 0.5 * out + (0, 0, 1), section=section, elements=8)
        parts += [beam, *(fb.RevoluteJoint(body.point(0.5 * out), end, f"{name} {k}", axis=out)
                          for body, end, name in zip(ends, (beam.start, beam.end), ("low", "high")))]
    return fb.Scene(*parts, gravity=(0, 0, -9.81))


def net(n: int) -> Any:
    """Masses on a grid of n x n that hangs on a corner."""
    import fastbeam as fb
    masses = [[fb.PointMass(f"mass {i} {j}", mass=0.1, position=(0.1 * i, 0.1 * j, 0.02 * np.sin(0.7 * i + j))) for j in range(n)]
              for i in range(n)]
    across = [(row[j], row[j + 1]) for row in masses for j in range(n - 1)]
    along = [(a[j], b[j]) for a, b in zip(masses, masses[1:]) for j in range(n)]
    rods = [fb.DistanceJoint(a, b, f"rod {k}") for k, (a, b) in enumerate(across + along)]
    return fb.Scene(*(mass for row in masses for mass in row), *rods, fb.Pin(masses[0][0]), gravity=(0, 0, -9.81))


def grid(n: int) -> Any:
    """n chains of n bodies on revolute joints, with springs between bodies side by side."""
    import fastbeam as fb
    half = np.array([0.05, 0.0, 0.0])
    rows = [[fb.RigidBody(f"link {i} {j}", mass=0.1, inertia=(1e-4, 2e-4, 2e-4), position=(0.1 * j + 0.05, 0.1 * i, 0))
             for j in range(n)] for i in range(n)]
    joints = [fb.RevoluteJoint(a if a is fb.GROUND else a.point(half), b.point(-half), f"joint {i} {j}", axis=axis)
              for i, row in enumerate(rows)
              for j, (a, b, axis) in enumerate(zip([fb.GROUND, *row], row, ((0, 1, 0), (0, 0, 1)) * n))]
    springs = [fb.Spring(a, b, f"spring {i} {j}", stiffness=100.0)
               for i, (row, other) in enumerate(zip(rows, rows[1:])) for j, (a, b) in enumerate(zip(row, other))]
    return fb.Scene(*(body for row in rows for body in row), *joints, *springs, gravity=(0, 0, -9.81))


def measure(scene: Any, joints: int, planar: bool) -> tuple[float, float, float, float]:
    """Compile time, iterations a step, seconds an iteration and joint, largest gap."""
    import fastbeam as fb
    from fastbeam.model.gap_rows import ConstraintGaps
    from perf.places import private
    Stepper = private("newton", "Stepper")
    begin = time.process_time()
    model = fb.compile_scene(scene, planar="auto" if planar else False)
    compiled = time.process_time() - begin
    stepper = Stepper(model, np.ones(1))
    stepper.advance(0.0, STEP, 2)
    begin = time.process_time()
    done = stepper.advance(0.0, STEP, STEPS, 2)
    seconds = time.process_time() - begin
    assert done.status == 0, done
    gap = float(np.max(np.abs(ConstraintGaps(model).values(stepper.state.q, stepper.state.s)[0])))
    return compiled, done.iterations / STEPS, seconds / done.iterations / joints, gap


def main() -> None:
    parser = argparse.ArgumentParser(description="Time of an iteration for each joint.")
    parser.add_argument("--bodies", type=int, nargs="*", default=[1000, 10_000, 100_000])
    parser.add_argument("--planar", action="store_true")
    parser.add_argument("--with", dest="more", choices=("friction", "given", "stops", "spring"))
    parser.add_argument("--scene", choices=("chain", "hub", "net", "grid"), default="chain")
    options = parser.parse_args()
    scenes = {"chain": ((n, lambda n=n: chains(n, options.planar, options.more)) for n in options.bodies),
              "hub": ((2 * n, lambda n=n: hub(n)) for n in (4, 32)),
              "net": ((2 * n * (n - 1), lambda n=n: net(n)) for n in (5, 10, 20, 30)),
              "grid": ((n * n, lambda n=n: grid(n)) for n in (10, 30, 60, 100))}
    print("  joints  compile s  iterations  us/iteration/joint      gap m")
    for joints, scene in scenes[options.scene]:
        compiled, iterations, seconds, gap = measure(scene(), joints, options.planar)
        print(f"{joints:8d} {compiled:10.2f} {iterations:11.2f} {1e6 * seconds:19.2f} {gap:10.1e}", flush=True)


if __name__ == "__main__":
    main()
