"""Time of a step: compiled against plain NumPy, SciPy and PARDISO, one thread; start-up times in fresh processes.

    python perf/cases/step_time.py [--no-cold]

Ratios are measured in one session on one machine; exits with 1 where one misses its bar.
"""
from __future__ import annotations

import os

# one thread everywhere, before any library starts its pool
os.environ.update({name: "1" for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")})

import argparse  # noqa: E402
import sys  # noqa: E402
import tempfile  # noqa: E402
import time  # noqa: E402
from pathlib import Path  # noqa: E402

import numpy as np  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

import fastbeam as fb  # noqa: E402
from perf.cases.plain_step import PlainBeam, spsolve  # noqa: E402
from perf.places import private  # noqa: E402

Stepper = private("newton", "Stepper")

BAR = 20.0  # compiled iteration over plain iteration, at least
SAME = 1e-9  # of the length, after COMPARED steps
COMPARED = 40
STEP = 0.01
ELEMENTS = 20


def spinning_beam(degree: int, elements: int = ELEMENTS) -> tuple[fb.Beam, fb.Model]:
    """A free beam that bends, twists and turns."""
    section = fb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=500.0, EI2=500.0, EI3=500.0, rhoA=1.0, rhoI2=10.0, rhoI3=10.0)
    beam = fb.Beam.straight("beam", (0, 0, 0), (10, 0, 0), section=section, elements=elements, degree=degree)
    motion = fb.InitialVelocity(beam, velocity=lambda s: np.stack((0 * s, np.sin(0.6 * s), 0.5 * np.cos(0.4 * s)), axis=1),
                                spin=lambda s: np.stack((0.2 + 0 * s, 0.2 * np.sin(0.4 * s), 0.6 * np.cos(0.6 * s)), axis=1))
    return beam, fb.compile_scene(fb.Scene(beam, motion))


def compiled_iteration(model: fb.Model, steps: int, repeats: int = 9) -> tuple[float, float]:
    """(median thread time of one Newton iteration, s; iterations a step)."""
    stepper = Stepper(model, np.ones(1))
    start = stepper.copy_state()
    stepper.advance(0.0, STEP, 10)
    times = []
    for _ in range(repeats):
        stepper.set_state(start)
        begin = time.thread_time()
        outcome = stepper.advance(0.0, STEP, steps)
        times.append((time.thread_time() - begin) / outcome.iterations)
    if outcome.steps != steps:
        raise RuntimeError("the compiled run stopped early: nothing was measured")
    return float(np.median(times)), outcome.iterations / steps


def plain_iteration(beam: fb.Beam, model: fb.Model, steps: int, repeats: int = 5) -> tuple[float, float]:
    """The same of the plain step."""
    times = []
    for _ in range(repeats):
        plain = PlainBeam(beam, model.q0.reshape(-1, 4, 3), model.v0.reshape(-1, 4, 3))
        plain.step(STEP)
        done = plain.iterations
        begin = time.thread_time()
        for _ in range(steps):
            plain.step(STEP)
        times.append((time.thread_time() - begin) / (plain.iterations - done))
    return float(np.median(times)), (plain.iterations - done) / steps


def difference(beam: fb.Beam, model: fb.Model) -> float:
    """Largest difference of a coordinate between both programs after COMPARED steps, relative to the length of the beam."""
    plain = PlainBeam(beam, model.q0.reshape(-1, 4, 3), model.v0.reshape(-1, 4, 3))
    for _ in range(COMPARED):
        plain.step(STEP)
    stepper = Stepper(model, np.ones(1))
    stepper.advance(0.0, STEP, COMPARED)
    if not np.max(np.abs(stepper.state.q - model.q0)) > 0.01 * beam.length:
        raise RuntimeError("the beam hardly moved: nothing was compared")
    return float(np.max(np.abs(stepper.state.q - plain.q.reshape(-1)))) / beam.length


def start_up(cold: bool) -> None:
    """Print what a fresh process takes."""
    from perf.suite.regression import fresh
    source = {"PYTHONPATH": str(ROOT / "src")}
    fresh(**source)
    light, whole = np.median([fresh(**source) for _ in range(5)], axis=0)
    print(f"import fastbeam                            {1e3 * light:8.1f} ms")
    print(f"import to first step with a slider, warm   {whole:8.2f} s")
    if cold:
        with tempfile.TemporaryDirectory() as folder:
            print(f"import to first step with a slider, cold   {fresh(FASTBEAM_CACHE_DIR=folder, **source)[1]:8.2f} s")


def main() -> int:
    """Measure and print; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--no-cold", action="store_true", help="leave out the start with an empty cache (compiles for a minute)")
    arguments = parser.parse_args()
    failed = False
    print(f"free beam of {ELEMENTS} elements, no observers, one thread (thread time, medians); plain solver "
          f"{spsolve.__module__}; bars: ratio >= {BAR:g}, difference <= {SAME:g}")
    print(f"{'degree':>6} {'us/iteration':>13} {'plain us':>10} {'iter/step':>10} {'steps/s':>9} {'steps/s at 4':>13} "
          f"{'ratio':>7} {'difference':>11}")
    for degree in (2, 3):
        beam, model = spinning_beam(degree)
        apart = difference(beam, model)
        fast, n = compiled_iteration(model, 2000)
        slow, n_plain = plain_iteration(beam, model, 30)
        ok = slow / fast >= BAR and apart <= SAME
        failed |= not ok
        print(f"{degree:6d} {1e6 * fast:13.1f} {1e6 * slow:10.0f} {n:10.2f} {1.0 / (n * fast):9.0f} {0.25 / fast:13.0f} "
              f"{slow / fast:7.1f} {apart:11.1e}  {'ok' if ok else 'MISSED'} (plain: {n_plain:.2f} iter/step)")
    start_up(not arguments.no_cold)
    return int(failed)


if __name__ == "__main__":
    raise SystemExit(main())
