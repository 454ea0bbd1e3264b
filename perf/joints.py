"""Chains of bodies with revolute joints: time of a Newton iteration for each joint.

    python perf/joints.py                     chains of 1000, 10 000 and 100 000 bodies in space
    python perf/joints.py --planar            the same in a plane
    python perf/joints.py --bodies 5000       one chain

A chain hangs from the ground between hinges whose axes are turned by a right angle from one to the next (planar: all the same) and
swings under its weight. Prints the time to compile the scene, Newton iterations a step, the time of an iteration for each joint,
and the largest gap and the drift of the energy at the end.
"""
from __future__ import annotations

import os

os.environ.setdefault("FASTBEAM_THREADS", "1")

import argparse  # noqa: E402
import time  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402

STEP, STEPS = 1e-3, 10


def chain(bodies: int, planar: bool = False) -> Any:
    """A straight chain along x, bodies 0.1 m long; joints at their ends."""
    import fastbeam as fb
    half, axes = np.array([0.05, 0.0, 0.0]), ((0, 1, 0), (0, 0, 1))
    links = [fb.RigidBody(f"link {k}", mass=0.1, inertia=(1e-4, 2e-4, 2e-4), position=(0.1 * k + 0.05, 0, 0))
             for k in range(bodies)]
    joints = [fb.RevoluteJoint(fb.GROUND, links[0].point(-half), "joint 0", axis=(0, 1, 0))]
    joints += [fb.RevoluteJoint(a.point(half), b.point(-half), f"joint {k + 1}", axis=axes[0 if planar else (k + 1) % 2])
               for k, (a, b) in enumerate(zip(links, links[1:]))]
    return fb.Scene(*links, *joints, gravity=(0, 0, -9.81))


def measure(bodies: int, planar: bool) -> tuple[float, float, float, float, float]:
    """Compile time, iterations a step, seconds an iteration and joint, largest gap, drift of the energy."""
    import fastbeam as fb
    begin = time.perf_counter()
    model = fb.compile_scene(chain(bodies, planar), planar="auto" if planar else False)
    compiled = time.perf_counter() - begin
    first = fb.simulate(model, t_end=STEP, step=STEP, observe=(), snapshots=0, progress=False)
    begin = time.perf_counter()
    run = fb.simulate(model, start=first.checkpoint, t_end=(1 + STEPS) * STEP, step=STEP, observe=(), snapshots=0, progress=False)
    empty = time.perf_counter()
    fb.simulate(model, start=first.checkpoint, t_end=2 * STEP, step=STEP, observe=(), snapshots=0, progress=False)
    last = time.perf_counter() - empty
    iterations = run.info["iterations"]
    # what a run takes around its steps is in both
    seconds = (empty - begin - last) / (iterations * (1.0 - 1.0 / STEPS))
    whole = fb.simulate(model, t_end=3 * STEP, step=STEP, observe=("energy",), snapshots=0, progress=False)
    x, start = (q.reshape(-1, 4, 3) for q in (run.state.q, model.q0))
    gap = max(float(np.max(np.abs(link.law.gap(x[list(link.node)], start[list(link.node)])))) for link in model.kept)
    return compiled, iterations / STEPS, seconds / bodies, gap, whole.drift("total")


def main() -> None:
    parser = argparse.ArgumentParser(description="Time of an iteration for each revolute joint of a chain.")
    parser.add_argument("--bodies", type=int, nargs="*", default=[1000, 10_000, 100_000])
    parser.add_argument("--planar", action="store_true")
    options = parser.parse_args()
    print("  bodies  compile s  iterations  us/iteration/joint      gap m    drift")
    for bodies in options.bodies:
        compiled, iterations, seconds, gap, drift = measure(bodies, options.planar)
        print(f"{bodies:8d} {compiled:10.2f} {iterations:11.2f} {1e6 * seconds:19.2f} {gap:10.1e} {drift:8.1e}", flush=True)


if __name__ == "__main__":
    main()
