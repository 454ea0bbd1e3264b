"""Cabins on a closed flexible cable over supports, round after round.

    python perf/cases/ropeway.py                    50 cabins, 10 supports, 5 rounds
    python perf/cases/ropeway.py --rounds 100       a line every tenth of the way
    python perf/cases/ropeway.py --scaling          time of a step with 50 to 400 cabins

Exits with 1 where a bar is missed.

The cable is a circle of ten spans, tensioned by springs at the supports, under its own weight and that of the cabins, point
masses whose drives bring them to their speed and keep it. Starts from the equilibrium with the cabins at rest. Prints the
largest error of the energy balance, relative to the largest energy exchanged meanwhile, Newton iterations and the time of a step.
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

from perf.printing import Bar, judged  # noqa: E402

# bars: error of the balance over what was exchanged; time of a step per cabin, of the most over the fewest, as in sliders.py
BALANCE, GROWTH = 1e-11, 1.5
RADIUS, SPANS, SPEED, RAMP, STEP = 20.0, 10, 4.0, 5.0, 0.02


def speed(t: float) -> float:
    """Of the driven cabins: a smooth ramp."""
    x = min(t / RAMP, 1.0)
    return SPEED * x * x * (3.0 - 2.0 * x)


def ropeway(cabins: int, elements: int = 5, damping: float = 0.0) -> tuple[Any, Any]:
    """Scene and path; elements of a span, and damping of the rope, s."""
    import fastbeam as fb
    rope = fb.Section.circle(radius=0.015, E=1e10, rho=6000.0, damping=damping)
    spans = []
    for k in range(SPANS):
        a = 2.0 * np.pi * k / SPANS
        out = np.array([np.cos(a), np.sin(a), 0.0])
        spans.append(fb.Beam.arc(f"span {k}", RADIUS * out, (-out[1], out[0], 0.0), -out, radius=RADIUS,
                                 angle=2.0 * np.pi / SPANS, section=rope, elements=elements, degree=3))
    path = fb.Path("rope", spans, closed=True)
    parts: list[Any] = [*spans, *(fb.RigidConnection(a, b) for a, b in path.joints())]
    for k, span in enumerate(spans):
        out = span.reference(0.0)[0][0] / RADIUS
        for up in (-1.0, 1.0):
            anchor = fb.PointMass(f"anchor {k} {up:+g}", mass=1.0, position=(RADIUS + 3.0) * out + (0.0, 0.0, up))
            parts += [anchor, fb.Pin(anchor), fb.Spring(span.start, anchor, stiffness=1e5, length=2.7)]
    for k in range(cabins):
        at = path.length * (k + 0.25) / cabins
        cabin = fb.PointMass(f"cabin {k}", mass=20.0)
        parts += [cabin, fb.Slider(f"hanger {k}", cabin, on=path, at=at, drive=fb.Drive(speed=speed))]
    return fb.Scene(*parts, name="ropeway", gravity=(0.0, 0.0, -9.81)), path


def run(cabins: int, rounds: float) -> list[Bar]:
    """Print how a run goes; bars with what was found. A step that fails ends it."""
    import fastbeam as fb
    scene, path = ropeway(cabins)
    model = fb.compile_scene(scene)
    print(model)
    state = fb.solve_static(model, held=True).state
    t_end = RAMP / 2.0 + rounds * path.length / SPEED
    begin, clock, books, failed = 0.0, time.thread_time(), np.zeros(2), 0
    for part in range(1, 11):
        end = t_end * part / 10
        try:
            result = fb.simulate(model, t_end=end, step=STEP, start=fb.Start(state, time=begin))
        except fb.ConvergenceError as error:
            print(error)
            failed = 1
            break
        parts = result.balance()
        exchanged = max(float(np.max(np.abs(x - x[0]))) for name, x in parts.items() if name != "sum")
        error = float(np.max(np.abs(parts["sum"] - parts["sum"][0])))
        # of the whole run at most the one and at least the other
        books = np.array((books[0] + error, max(books[1], exchanged)))
        s = result.slider("hanger 0")["s"][-1]
        steps = result.info["steps"]
        print(f"round {s / path.length:8.3f}  {steps} steps, {result.series['iterations'].mean():.2f} iterations, balance "
              f"{error:.2e} J of {exchanged:.4g} J, {error / exchanged:.2e}, gap {result.series['gap'].max():.1e} m, "
              f"{1e3 * (time.thread_time() - clock) / steps:.2f} ms a step, events {len(result.events)}", flush=True)
        state, begin, clock = result.checkpoint, None, time.thread_time()
    return [(f"{cabins} cabins: failed steps", 0.0, float(failed), f"{rounds:g} rounds"),
            (f"{cabins} cabins: error of the balance, of what was exchanged", BALANCE, float(books[0] / books[1]),
             "sum of ten parts, of the most in one")]


def scaling(counts: list[int]) -> list[Bar]:
    """Print the time of a step by the number of cabins, one element a cabin, without observers; the bar of its growth."""
    import fastbeam as fb
    of_a_cabin: dict[int, tuple[float, float]] = {}
    for cabins in counts:
        model = fb.compile_scene(ropeway(cabins, cabins // SPANS)[0])
        state = fb.solve_static(model, held=True).state
        times = []
        for _ in range(3):
            clock = time.thread_time()
            result = fb.simulate(model, t_end=300 * STEP, step=STEP, start=state, observe=(), output=fb.Output(snapshots=0))
            times.append((time.thread_time() - clock) / result.info["steps"])
        iterations = float(result.series["iterations"].mean())
        of_a_cabin[cabins] = min(times) / iterations / cabins, min(times) / cabins
        print(f"{cabins:4} cabins: {1e3 * min(times):.3f} ms a step, {iterations:.2f} iterations, "
              f"{1e6 * min(times) / iterations / cabins:.1f} us a cabin and iteration", flush=True)
    few, many = min(counts), max(counts)
    one, step = np.array(of_a_cabin[many]) / of_a_cabin[few]
    return [(f"time of a step per cabin, {many} cabins over {few}", GROWTH, float(step), f"of an iteration {one:.2f}")]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cabins", type=int, default=50)
    parser.add_argument("--rounds", type=float, default=5.0)
    parser.add_argument("--scaling", action="store_true")
    parser.add_argument("--counts", type=int, nargs="+", default=[50, 100, 200, 400], help="of cabins, for --scaling")
    arguments = parser.parse_args()
    found = scaling(arguments.counts) if arguments.scaling else run(arguments.cabins, arguments.rounds)
    return int(judged(found) > 0)


if __name__ == "__main__":
    sys.exit(main())
