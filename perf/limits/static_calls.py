"""What an equilibrium with sliders costs beside arithmetic: calls of Python functions and moves between files of one with a held
slider, and times of equilibria with many.

    python perf/limits/static_calls.py                 against the bars
    python perf/limits/static_calls.py --json FILE     the numbers, for another revision to be compared with

Counts are those of a second run, when all kernels are compiled. A move is a call into another file than that of the call before;
files of libraries count as well. Exits with 1 where a bar is missed.
"""
from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from perf.printing import table  # noqa: E402

MOST_CALLS, MOST_MOVES = 2500, 900
COUNTS, REPEATS = (1, 10, 100), 5


def beads(sliders: int, elements: int, length: float) -> Any:
    """A compiled soft wire between clamps with so many beads on it, in space."""
    import fastbeam as fb
    section = fb.Section.circle(radius=0.02, E=1e7, rho=1000.0)
    wire = fb.Beam.straight("wire", (0, 0, 0), (length, 0, 0), section=section, elements=elements)
    scene = fb.Scene(wire, fb.Clamp(wire.start), fb.Clamp(wire.end), gravity=(0, 0, -9.81))
    for k in range(sliders):
        bead = fb.PointMass(f"bead {k}", mass=0.05 / sliders)
        scene.add(bead, fb.Slider(f"run {k}", bead, wire, at=length * (k + 0.45) / sliders))
    return fb.compile_scene(scene, planar=False)


def counted(work: Callable[[], Any]) -> tuple[int, int]:
    """Calls of Python functions, and how many of them enter another file than the one before."""
    calls = moves = 0
    last = ""

    def note(frame: Any, event: str, arg: Any) -> None:
        nonlocal calls, moves, last
        if event == "call":
            calls += 1
            moves += frame.f_code.co_filename != last
            last = frame.f_code.co_filename

    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(None)
    return calls, moves


def measured() -> dict[str, float]:
    """Counts of an equilibrium with a held slider, and seconds of processor time of equilibria with many."""
    import fastbeam as fb
    model = beads(1, 12, 1.0)
    fb.solve_static(model, held=True)
    calls, moves = counted(lambda: fb.solve_static(model, held=True))
    found: dict[str, float] = {"calls": calls, "moves": moves}
    for sliders in COUNTS:
        many = beads(sliders, 40, 10.0)
        times = []
        for _ in range(REPEATS + 1):
            begin = time.process_time()
            fb.solve_static(many, held=True)
            times.append(time.process_time() - begin)
        found[f"{sliders} sliders, s"] = min(times[1:])
    return found


def main() -> int:
    """Measure and judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", metavar="FILE")
    arguments = parser.parse_args()
    found = measured()
    bars = {"calls": MOST_CALLS, "moves": MOST_MOVES}
    print(table(("quantity", "found", "bar"), [(name, f"{value:.4g}", str(bars.get(name, ""))) for name, value in found.items()]))
    if arguments.json:
        Path(arguments.json).write_text(json.dumps(found, indent=1) + "\n")
    return int(any(found[name] > bar for name, bar in bars.items()))


if __name__ == "__main__":
    sys.exit(main())
