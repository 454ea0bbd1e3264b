"""Many runs on all processors: `fb.sweep` against the same runs one after the other, in this process.

    python perf/cases/sweep.py [--workers 2] [--rounds 3]

Three kinds of runs: a flight of a few milliseconds, one of about 26 ms, and nothing at all, which leaves the time that a sweep
itself takes for a run. On a machine that others use too, processor time tells more than the clock.
"""
from __future__ import annotations

import argparse
import os
import statistics
import time
from collections.abc import Callable
from typing import Any

import fastbeam as fb


def flight(k: int, t_end: float) -> dict[str, float]:
    """A bead slides on a rod that flies; steps of 1 ms."""
    rubber = fb.Section.circle(radius=0.02, E=1e6, rho=1000.0)
    rod = fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=rubber, elements=6)
    bead = fb.PointMass("bead", mass=0.5 + 1e-3 * k)
    scene = fb.Scene(rod, bead, fb.Slider("contact", bead, rod, at=0.8, rate=0.5), fb.RigidMotion(spin=(0, 0.5, 2.0)))
    result = fb.simulate(fb.compile_scene(scene), t_end=t_end, step=1e-3, output=fb.Output(snapshots=2), progress=False)
    return {"s": float(result.slider("contact")["s"][-1])}


def nothing(k: int) -> int:
    """A run that takes no time."""
    return k


def seconds(call: Callable[[], Any]) -> tuple[float, float]:
    """Wall clock and processor time of a call, of its processes too."""
    begin, used = time.perf_counter(), sum(os.times()[:4])
    call()
    return time.perf_counter() - begin, sum(os.times()[:4]) - used


def main() -> None:
    """Print ratios, medians of rounds in which both are timed in turn."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=3)
    chosen = parser.parse_args()
    flight(0, 2e-3)
    for n, t_end in ((100, 0.12), (1000, 0.01)):
        cases = [{"k": k, "t_end": t_end} for k in range(n)]
        alone, together = [], []
        for _ in range(chosen.rounds):
            alone.append(seconds(lambda: [flight(**case) for case in cases]))
            together.append(seconds(lambda: fb.sweep(flight, cases, workers=chosen.workers, progress=False)))
        one, many = (statistics.median(x for x, _ in times) for times in (alone, together))
        ratio = statistics.median(a / b for (a, _), (b, _) in zip(alone, together))
        work = statistics.median(b / a for (_, a), (_, b) in zip(alone, together))
        print(f"{n} runs of {1e3 * one / n:.1f} ms: {one:.2f} s one by one, {many:.2f} s on {chosen.workers} processes, "
              f"{ratio:.2f} times faster; processor time {work:.2f} of that one by one")
    for workers in (1, chosen.workers):
        empty = min(seconds(lambda: fb.sweep(nothing, {"k": range(1000)}, workers=workers, progress=False))[0]
                    for _ in range(chosen.rounds))
        print(f"a run that does nothing, on {workers}: {empty:.2f} ms")


if __name__ == "__main__":
    main()
