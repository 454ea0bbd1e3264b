"""Chains of bodies with revolute joints: time of a Newton iteration for each joint.

    python perf/joints.py                     chains of 1000, 10 000 and 100 000 bodies in space
    python perf/joints.py --planar            the same in a plane
    python perf/joints.py --bodies 5000       one chain
    python perf/joints.py --with friction     every hinge rubs; also: given (an angle as a function of time), stops, spring

A chain of up to 1000 bodies hangs from the ground between hinges whose axes are turned by a right angle from one to the next
(planar: all the same) and swings under its weight; more bodies are more such chains. Prints the time to compile the scene, Newton
iterations a step, the time of an iteration for each joint, and the largest gap.
"""
from __future__ import annotations

import os

os.environ.setdefault("FASTBEAM_THREADS", "1")

import argparse  # noqa: E402
import time  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402

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


def measure(bodies: int, planar: bool, more: str | None = None) -> tuple[float, float, float, float]:
    """Compile time, iterations a step, seconds an iteration and joint, largest gap."""
    import fastbeam as fb
    from fastbeam.newton import Stepper
    begin = time.process_time()
    model = fb.compile_scene(chains(bodies, planar, more), planar="auto" if planar else False)
    compiled = time.process_time() - begin
    stepper = Stepper(model, np.ones(1))
    stepper.advance(0.0, STEP, 2)
    begin = time.process_time()
    done = stepper.advance(0.0, STEP, STEPS, 2)
    seconds = time.process_time() - begin
    assert done.status == 0, done
    x, start = (q.reshape(-1, 4, 3) for q in (stepper.state.q, model.q0))
    gap = max(float(np.max(np.abs(link.law.gap(x[list(link.node)], start[list(link.node)])))) for link in model.kept)
    return compiled, done.iterations / STEPS, seconds / done.iterations / bodies, gap


def main() -> None:
    parser = argparse.ArgumentParser(description="Time of an iteration for each revolute joint of a chain.")
    parser.add_argument("--bodies", type=int, nargs="*", default=[1000, 10_000, 100_000])
    parser.add_argument("--planar", action="store_true")
    parser.add_argument("--with", dest="more", choices=("friction", "given", "stops", "spring"))
    options = parser.parse_args()
    print("  bodies  compile s  iterations  us/iteration/joint      gap m")
    for bodies in options.bodies:
        compiled, iterations, seconds, gap = measure(bodies, options.planar, options.more)
        print(f"{bodies:8d} {compiled:10.2f} {iterations:11.2f} {1e6 * seconds:19.2f} {gap:10.1e}", flush=True)


if __name__ == "__main__":
    main()
