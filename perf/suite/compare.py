"""Compare this state with another revision: both run the cases of perf/suite/regression.py in turn, in one session.

    python perf/suite/compare.py main~5                       the default cases, 5 rounds
    python perf/suite/compare.py v0.1 beam slider --rounds 9
    python perf/suite/compare.py main~5 --json out.json
    python perf/suite/compare.py main~5 --bar 1.03            no step may take more than 1.03 times as long

The order within a round alternates, so that a drifting machine favours nobody. The ratio of a value is the median over rounds
of (this state / base); its noise is half the range of the middle half of all rounds, at least 2 %. A value is a regression
when its ratio exceeds 1 by more than three times the noise and more than `--allow` (0.03). With `--bar` the ratios of steps, and
of whole equilibria, are held against it as they are, noise or not: met or missed. Exits with 1 when there is a regression, or a
bar is missed. A case that one of both revisions cannot do is named and not judged.
"""
from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from perf.machine import machine  # noqa: E402
from perf.suite import regression  # noqa: E402

LEAST_NOISE = 0.02
# values that a bar is for: times of all Newton iterations of a step or of an equilibrium
BARRED = ("step", "whole")
Rounds = dict[tuple[str, str], list[tuple[float, float]]]


def judge(pairs: list[tuple[float, float]], allow: float, bar: float | None = None) -> tuple[float, float, str]:
    """(ratio, noise, verdict) of values (base, here) of every round; with a bar the verdict is that of the ratio alone."""
    ratios = np.array([here / base for base, here in pairs])
    low, ratio, high = np.quantile(ratios, (0.25, 0.5, 0.75))
    noise = max(LEAST_NOISE, 0.5 * float(high - low))
    change = float(ratio) - 1.0
    if bar is not None:
        return float(ratio), noise, "met" if ratio <= bar else "missed"
    verdict = "same"
    if abs(change) > max(3.0 * noise, allow):
        verdict = "SLOWER" if change > 0.0 else "faster"
    return float(ratio), noise, verdict


def checkout(revision: str, folder: Path) -> Path:
    """The package of a revision in a folder.

    Raises
    ------
    SystemExit
        git does not know the revision.
    """
    archive = folder / "base.tar"
    done = subprocess.run(["git", "archive", "-o", str(archive), revision, "src"], cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"base {revision!r}: {done.stderr.strip()}; name a commit, branch or tag of this repository")
    subprocess.run(["tar", "-xf", str(archive), "-C", str(folder)], check=True)
    return folder / "src"


def run(names: list[str], base: Path, rounds: int) -> tuple[Rounds, dict[str, str]]:
    """Values of all rounds, and cases that one of both cannot do."""
    found: Rounds = {}
    missing: dict[str, str] = {}
    for name in names:
        for k in range(-1, rounds):
            # the first round fills the caches and does not count
            order = (base, None) if k % 2 else (None, base)
            values = {source: regression.measure(name, source) for source in order}
            told = [f"{'base' if source else 'here'}: {v}" for source, v in values.items() if isinstance(v, str)]
            if told:
                missing[name] = "; ".join(told)
                break
            if k >= 0:
                for key in values[None].keys() & values[base].keys():
                    found.setdefault((name, key), []).append((values[base][key][0], values[None][key][0]))
        for (case, key), pairs in found.items():
            if case == name:
                print(f"{case:16} {key:12} base {np.median([p[0] for p in pairs]):10.4g}   here "
                      f"{np.median([p[1] for p in pairs]):10.4g}", flush=True)
    return found, missing


def main() -> int:
    """Measure, print ratios; 1 where something became slower, or misses its bar."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("base", help="commit, branch or tag to compare with")
    parser.add_argument("cases", nargs="*", help="cases of perf/suite/regression.py")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--allow", type=float, default=0.03, help="a slow-down below this is none")
    parser.add_argument("--bar", type=float, help="largest ratio of a step, judged without regard to noise; others as without it")
    parser.add_argument("--large", action="store_true", help="also the largest cases")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    if options.rounds < 3:
        parser.error(f"--rounds: needs at least 3 to know the noise, got {options.rounds}")
    if options.bar is not None and not 0.0 < options.bar < np.inf:
        parser.error(f"--bar: must be a ratio > 0, got {options.bar}")
    names = regression.chosen(options.cases, options.large)
    failed = 0
    report: dict[str, Any] = {"machine": machine(), "base": options.base, "rounds": options.rounds, "bar": options.bar,
                              "values": [], "not compared": {}}
    with tempfile.TemporaryDirectory() as folder:
        found, missing = run(names, checkout(options.base, Path(folder)), options.rounds)
    print(f"\n{'case':16} {'value':12} {'here/base':>9} {'noise':>7}")
    for (case, key), pairs in found.items():
        ratio, noise, verdict = judge(pairs, options.allow, options.bar if key in BARRED else None)
        failed += verdict in ("SLOWER", "missed")
        print(f"{case:16} {key:12} {ratio:9.3f} {noise:7.3f}  {verdict}")
        report["values"].append({"case": case, "value": key, "ratio": ratio, "noise": noise, "verdict": verdict,
                                 "pairs": pairs})
    for case, why in missing.items():
        print(f"{case:16} not compared ({why})")
    report["not compared"] = missing
    if options.json:
        options.json.write_text(json.dumps(report, indent=1) + "\n")
    return int(failed > 0)


if __name__ == "__main__":
    raise SystemExit(main())
