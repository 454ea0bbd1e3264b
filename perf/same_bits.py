"""Whether this state and another revision take the same steps to the last bit: the scenes of the study, 40 steps each.

    python perf/same_bits.py main~5

Errors, orders and drifts that were measured on a revision with the same bits (docs/study.md, docs/work-precision.md) are those of
this state. Exits with 1 where bits differ.
"""
from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from compare import checkout
from printing import table

ROOT = Path(__file__).resolve().parents[1]
STEPS = 40
# of elements: those of the study, and splines
FAMILIES = {"lagrange 3": {}, "bspline 4": {"interpolation": "bspline", "degree": 4}}


def ends() -> None:
    """Print a number of the state at the end of every scene, or why there is none; with the package that is imported."""
    import fastbeam as fb
    sys.path.insert(0, str(ROOT / "examples" / "study"))
    import scenes
    for name, make in scenes.CASES.items():
        for family, options in FAMILIES.items():
            try:
                case = make(**options)
                result = fb.simulate(fb.compile_scene(case.scene), t_end=STEPS * case.step, step=case.step, observe=(),
                                     progress=False)
                found = hashlib.sha256(result.state.q.tobytes() + result.state.v.tobytes()).hexdigest()[:16]
            except (fb.SceneError, fb.ConvergenceError, TypeError) as trouble:
                found = f"{type(trouble).__name__}: {str(trouble)[:60]}"
            print(f"{name}|{family}|{found}", flush=True)


def found_by(source: Path) -> dict[tuple[str, str], str]:
    """The same of the package at `source`, in a process of its own."""
    environment = {**os.environ, "PYTHONPATH": str(source), "OMP_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, str(Path(__file__)), "--here"], capture_output=True, text=True, env=environment)
    if done.returncode:
        raise SystemExit(done.stderr.strip().splitlines()[-1])
    lines = [line.split("|", 2) for line in done.stdout.splitlines() if line.count("|") >= 2]
    return {(name, family): found for name, family, found in lines}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("base", nargs="?", help="commit, branch or tag to compare with")
    parser.add_argument("--here", action="store_true", help="print what this process finds (for the command itself)")
    options = parser.parse_args()
    if options.here:
        ends()
        return 0
    if options.base is None:
        parser.error("name a revision to compare with, as in python perf/same_bits.py main~5")
    with tempfile.TemporaryDirectory() as folder:
        base = found_by(checkout(options.base, Path(folder)))
    here = found_by(ROOT / "src")
    rows = [[name, family, "same" if base.get((name, family)) == found else "DIFFERENT", found]
            for (name, family), found in here.items()]
    print(table(["scene", "elements", "", "state at the end"], rows, left=(0, 1, 2, 3)))
    return int(any(row[2] != "same" for row in rows))


if __name__ == "__main__":
    sys.exit(main())
