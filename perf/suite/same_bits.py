"""Whether this state and another revision find the same numbers to the last bit: the scenes of the study, 40 steps each, and the
small cases of same_bits_cases.py.

    python perf/suite/same_bits.py main~5                     compare with a revision
    python perf/suite/same_bits.py --keep bits.json           write the hashes of this state
    python perf/suite/same_bits.py --with bits.json           compare with hashes of before
    python perf/suite/same_bits.py --twice                    this state with itself: the other way round, in another process
    python perf/suite/same_bits.py main~5 --only joint net    cases whose names contain one of these words

Errors, orders and drifts that were measured on a revision with the same bits (docs/reports/study.md, work-precision.md) are those
of this state. A case, or a number of a case, that one of both does not have is named and does not count as different. Hashes are
those of one machine: kernels are compiled for its processor. Exits with 1 where bits differ.
"""
from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from perf.printing import table  # noqa: E402
from perf.suite.compare import checkout  # noqa: E402

STEPS = 40
# of elements: those of the study, and splines
FAMILIES = {"lagrange 3": {}, "bspline 4": {"interpolation": "bspline", "degree": 4}}
# hashes of the numbers of a case by name, or why there are none
Found = dict[str, str] | str
NOT_THERE = "not there"


def of_study(make: Callable[..., Any], options: dict[str, Any]) -> dict[str, str]:
    """The state at the end of a scene of the study."""
    import fastbeam as fb
    case = make(**options)
    result = fb.simulate(fb.compile_scene(case.scene), t_end=STEPS * case.step, step=case.step, observe=(), progress=False)
    return {"state": hashlib.sha256(result.state.q.tobytes() + result.state.v.tobytes()).hexdigest()[:16]}


def cases() -> Iterator[tuple[str, Callable[[], dict[str, str]]]]:
    """Names of all cases and how to find their hashes, with the package that is imported."""
    sys.path.insert(0, str(ROOT / "examples" / "study"))
    import scenes

    from perf.suite import same_bits_cases
    for name, make in scenes.CASES.items():
        for family, options in FAMILIES.items():
            yield f"study: {name}, {family}", lambda make=make, options=options: of_study(make, options)
    for name, act in same_bits_cases.CASES.items():
        yield name, lambda act=act: same_bits_cases.found_in(act())


def chosen(only: Sequence[str], backward: bool) -> list[tuple[str, Callable[[], dict[str, str]]]]:
    """The cases whose names contain one of the words, or all."""
    found = [(name, act) for name, act in cases() if not only or any(word in name for word in only)]
    return found[::-1] if backward else found


def print_found(only: Sequence[str], backward: bool) -> None:
    """Print a line of JSON for every case."""
    import fastbeam as fb
    for name, act in chosen(only, backward):
        found: Found
        try:
            found = act()
        except (fb.SceneError, fb.ConvergenceError) as trouble:
            found = f"{type(trouble).__name__}: {str(trouble)[:60]}"
        except (AttributeError, TypeError) as trouble:
            lacks = "has no attribute" in str(trouble) or "unexpected keyword argument" in str(trouble)
            found = f"{NOT_THERE if lacks else type(trouble).__name__}: {str(trouble)[:60]}"
        print(json.dumps([name, found]), flush=True)


def found_by(source: Path, only: Sequence[str] = (), backward: bool = False) -> dict[str, Found]:
    """What the package at `source` finds, in a process of its own."""
    environment = {**os.environ, "PYTHONPATH": str(source), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, str(Path(__file__)), "--here", *["--backward"] * backward, *(["--only", *only] if only else [])]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    if done.returncode:
        raise SystemExit(done.stderr.strip().splitlines()[-1])
    return dict(json.loads(line) for line in done.stdout.splitlines() if line.startswith("["))


def judge(base: Found | None, here: Found) -> tuple[str, str]:
    """'same', 'DIFFERENT' or 'not there', and which numbers differ, or those that only one of both has."""
    if base is None or any(isinstance(found, str) and found.startswith(NOT_THERE) for found in (base, here)):
        why = next((found for found in (here, base) if isinstance(found, str)), "the other has no such case")
        return NOT_THERE, why
    if isinstance(base, str) or isinstance(here, str):
        return ("same", str(here)) if base == here else ("DIFFERENT", f"{_short(base)} / {_short(here)}")
    both = base.keys() & here.keys()
    wrong = sorted(name for name in both if base[name] != here[name])
    if wrong or not both:
        return "DIFFERENT", ", ".join(wrong) or "nothing in common"
    alone = sorted(base.keys() ^ here.keys())
    return "same", f"{len(both)} numbers" + (f"; in one of both only: {', '.join(alone)}" if alone else "")


def _short(found: Found) -> str:
    return found if isinstance(found, str) else f"{len(found)} numbers"


def arguments() -> argparse.Namespace:
    """What the command was asked."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("base", nargs="?", help="commit, branch or tag to compare with")
    parser.add_argument("--only", nargs="+", default=[], metavar="WORD", help="cases whose names contain one of these words")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="write the hashes of this state, or of the revision named")
    parser.add_argument("--with", type=Path, metavar="FILE", dest="kept", help="compare with hashes that --keep wrote")
    parser.add_argument("--twice", action="store_true", help="compare this state with itself")
    parser.add_argument("--here", action="store_true", help="print what this process finds (for the command itself)")
    parser.add_argument("--backward", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if not options.here and sum(map(bool, (options.base and not options.keep, options.kept, options.twice, options.keep))) != 1:
        parser.error("name one thing to compare with, a revision as in python perf/suite/same_bits.py main~5, --with FILE or "
                     "--twice; or say where to --keep hashes")
    return options


def main() -> int:
    options = arguments()
    if options.here:
        print_found(options.only, options.backward)
        return 0
    with tempfile.TemporaryDirectory() as folder:
        base = found_by(checkout(options.base, Path(folder)), options.only) if options.base else None
    if options.keep:
        options.keep.write_text(json.dumps(base or found_by(ROOT / "src", options.only), indent=1) + "\n")
        return 0
    here = found_by(ROOT / "src", options.only)
    if options.kept:
        base = json.loads(options.kept.read_text())
    elif options.twice:
        base = found_by(ROOT / "src", options.only, backward=True)
    rows = [[name, *judge((base or {}).get(name), found)] for name, found in here.items()]
    print(table(["case", "", ""], rows, left=(0, 1, 2)))
    return int(any(row[1] == "DIFFERENT" for row in rows))


if __name__ == "__main__":
    sys.exit(main())
