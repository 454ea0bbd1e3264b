"""What all programs share: settings come as one JSON argument, one JSON line goes back.

Needs nothing but Python: it is imported inside the environments of the peers.
"""
from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

REPEATS = 5  # of a short run, at most
SAMPLES = 5  # equidistant times at which positions are compared
PATIENCE = 3.0  # s after which a run is not repeated any more


def settings() -> dict[str, Any]:
    """The settings of this run: the only argument of the command line, JSON."""
    if len(sys.argv) != 2:
        raise SystemExit(f"usage: python {sys.argv[0]} '{{\"scene\": \"sliding\", ...}}'; run.py does that")
    return json.loads(sys.argv[1])


def steps(t_end: float, step: float) -> int:
    """Number of steps between two of the `SAMPLES` times, which divide the run; refuses a step size that does not fit."""
    n = round(t_end / SAMPLES / step)
    if abs(n * SAMPLES * step - t_end) > 1e-9 * t_end:
        raise SystemExit(f"step {step:g} does not divide {t_end / SAMPLES:g} s")
    return n


def timed(build: Callable[[], Any], solve: Callable[[Any], None]) -> tuple[Any, list[tuple[float, float]]]:
    """The last solved system and the (wall, processor) times of `solve` alone, s. `build` is not timed; short runs are repeated.

    The processor time tells how much of the wall time another program of the machine took.
    """
    times: list[tuple[float, float]] = []
    while True:
        system = build()
        wall, processor = time.perf_counter(), time.process_time()
        solve(system)
        times.append((time.perf_counter() - wall, time.process_time() - processor))
        walls = [wall for wall, _ in times]
        if len(times) >= REPEATS or sum(walls) + min(walls) > PATIENCE:
            return system, times


def answer(program: str, version: str, points: Sequence[Sequence[float]], times: Sequence[tuple[float, float]], message: str = "",
           extra: Mapping[str, Any] | None = None) -> None:
    """Print the line, with the points [samples * observed, 3] sample by sample; a message means that the run failed."""
    finite = all(abs(float(x)) < 1e9 for point in points for x in point)
    line = {"program": program, "version": version, "ok": finite and not message,
            "message": message or ("" if finite else "the run diverged"),
            "points": [[float(x) for x in point] for point in points] if finite else [], "wall": min(wall for wall, _ in times),
            "processor": min(processor for _, processor in times), "repeats": len(times), **(extra or {})}
    print(json.dumps(line))
