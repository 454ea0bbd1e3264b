"""Every feature in every analysis: 78 x 26 pairs, each checked against another way to find the same numbers.

    python perf/stress/features.py OUT.json --md OUT.md                  all pairs, an hour; those in OUT.json are not run again
    python perf/stress/features.py OUT.json --features winch --analyses static path
    python perf/stress/features.py OUT.json --fill                       and with work arrays that begin as NaN: the same bits

A pair is ok; refused, by a SceneError; failed, by anything else; or makes no sense. Each feature runs in a process of its own;
one that says nothing for longer than --timeout is stopped, and its other analyses go on.
"""
from __future__ import annotations

import argparse
import collections
import concurrent.futures
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "src"), str(ROOT / "tests")]

import numpy as np  # noqa: E402

import fastbeam as fb  # noqa: E402
from fastbeam.kernels import empty_arrays  # noqa: E402
from perf.feature_scenes import FEATURES, MakesNoSense  # noqa: E402
from perf.stress.feature_analyses import ANALYSES, WrongError, forget  # noqa: E402
from perf.stress.table import Row  # noqa: E402
from perf.suite.same_bits_cases import found_in  # noqa: E402

SIGNS = {"ok": "+", "refused": "r", "failed": "F", "makes no sense": "."}
QUICK = ("order 2", "static")
# calls whose results are compared to the last bit
CALLS = ("simulate", "solve_static", "solve_path", "critical_loads", "relax", "modes", "frequency_response", "sensitivity",
         "critical_sensitivity", "adjoint_run", "find_lengths", "stick_interval")
# a pair: a word of SIGNS, what it says, seconds
Pair = tuple[str, str, float]


# ---- one pair ------------------------------------------------------------------------------------------------------------

def _tried(feature: str, analysis: str) -> tuple[str, str]:
    try:
        ANALYSES[analysis](feature)
        return "ok", ""
    except MakesNoSense as reason:
        return "makes no sense", str(reason)
    except WrongError as wrong:
        return "failed", f"WRONG: {wrong}"[:400]
    except fb.SceneError as refused:
        # what lies outside of something has no message of its own
        return "failed" if "lies outside it" in str(refused) else "refused", str(refused)[:300]
    except Exception as failed:  # whatever else it is, it is a defect
        return "failed", f"{type(failed).__name__}: {failed}"[:400]


def _noted(notes: list[Any], call: Callable[..., Any]) -> Callable[..., Any]:
    def noting(*args: Any, **options: Any) -> Any:
        found = call(*args, **options)
        notes.append(found_in(found))
        return found
    return noting


def _begun_with(fill: float, feature: str, analyses: list[str]) -> Iterator[tuple[str, str, str, list[Any], float]]:
    """Try analyses, and note the bits of what they find."""
    empty_arrays.FILL = fill
    forget()
    notes: list[Any] = []
    calls = {name: getattr(fb, name) for name in CALLS}
    try:
        for name, call in calls.items():
            setattr(fb, name, _noted(notes, call))
        for analysis in analyses:
            del notes[:]
            began = time.perf_counter()
            status, says = _tried(feature, analysis)
            yield analysis, status, says, list(notes), round(time.perf_counter() - began, 2)
    finally:
        for name, call in calls.items():
            setattr(fb, name, call)
        empty_arrays.FILL = 0.0


def _of_feature(feature: str, analyses: list[str], fill: bool) -> None:
    """In the process of a feature: print a line when a pair begins, and one when it ends."""
    import matplotlib
    matplotlib.use("Agg")
    before: dict[str, Any] = {}
    for analysis, *found, seconds in _begun_with(0.0, feature, analyses):
        print(json.dumps([analysis]), flush=True)
        before[analysis] = found
        if not fill:
            print(json.dumps([analysis, *found[:2], seconds]), flush=True)
    for analysis, *found, seconds in _begun_with(np.nan, feature, analyses) if fill else ():
        status, says, notes = before[analysis]
        if found[:2] != [status, says]:
            status, says = "failed", f"{says or status}, but with NaN {found[1] or found[0]}"[:400]
        elif found[2] != notes:
            other = {name for a, b in zip(notes, found[2]) for name in {*a, *b} if a.get(name) != b.get(name)}
            status, says = "failed", f"other bits with NaN: {sorted(other)}"[:400]
        print(json.dumps([analysis, status, says, seconds]), flush=True)


# ---- all pairs -----------------------------------------------------------------------------------------------------------

def _process(feature: str, left: list[str], timeout: float, more: list[str]) -> tuple[dict[str, Pair], str | None, str]:
    """Run analyses in a process: finished pairs, the one that it stopped in, and how it ended."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "out")
        with open(out, "w") as file:
            asked = ["-", "--features", feature, "--analyses", *left, "--child", *more]
            child = subprocess.Popen([sys.executable, __file__, *asked], stdout=file, stderr=subprocess.DEVNULL,
                                     start_new_session=True)
        size, since = 0, time.monotonic()
        while child.poll() is None:
            time.sleep(0.2)
            if out.stat().st_size != size:
                size, since = out.stat().st_size, time.monotonic()
            elif time.monotonic() - since > timeout:
                os.killpg(child.pid, signal.SIGKILL)
                child.wait()
        lines = [json.loads(line) for line in out.read_text().splitlines() if line.endswith("]")]
    done = {name: tuple(pair) for name, *pair in lines if len(pair) == 3}
    stopped = next((name for name, *_ in reversed(lines) if name not in done), None)
    ended = f"no word for {timeout:g} s" if child.returncode == -signal.SIGKILL else f"process died, {child.returncode}"
    return done, stopped, ended


def pairs_of(feature: str, analyses: list[str], timeout: float = 180.0, fill: bool = False) -> dict[str, Pair]:
    """Run analyses of a feature."""
    left, done = list(analyses), {}
    while left:
        found, stopped, ended = _process(feature, left, timeout, ["--fill"] if fill else [])
        done.update(found)
        at = stopped or next((name for name in left if name not in done), None)
        if at is not None:
            done[at] = "failed", ended, timeout
        left = [name for name in left if name not in done]
    return done


def _share(pairs: list[Pair]) -> tuple[str, dict[str, int]]:
    count = collections.Counter(status for status, *_ in pairs)
    meant = sum(count.values()) - count["makes no sense"]
    return f"{100 * count['ok'] / meant:.0f} %" if meant else "-", dict(count)


def report(found: dict[str, dict[str, Pair]]) -> str:
    """Write the table, then what failed, then what is refused."""
    pairs = {(row, name): pair for row in FEATURES for name, pair in found.get(row, {}).items()}
    text, count = _share(list(pairs.values()))
    lines = [f"{text} ok of the pairs that make sense: {count}; {len(FEATURES) * len(ANALYSES) - len(pairs)} not run", "",
             "+ ok, r refused, F failed or wrong, . makes no sense, blank: not run", "",
             "| | " + " | ".join(ANALYSES) + " | ok |", "|---" * (len(ANALYSES) + 2) + "|"]
    for row in FEATURES:
        mine = found.get(row, {})
        signs = [SIGNS[mine[name][0]] if name in mine else " " for name in ANALYSES]
        lines.append(f"| {row} | " + " | ".join(signs) + f" | {_share(list(mine.values()))[0]} |")
    shares = [_share([pair for (_, name), pair in pairs.items() if name == analysis])[0] for analysis in ANALYSES]
    lines += ["| ok | " + " | ".join(shares) + " | |", "", "## Failed", ""]
    lines += [f"- {row} x {name}: {says}" for (row, name), (status, says, _) in pairs.items() if status == "failed"]
    groups = collections.defaultdict(list)
    for (row, name), (status, says, _) in pairs.items():
        if status == "refused":
            groups[name, re.sub(r"'[^']*'|[-+]?\d[\d.e+-]*", "..", says)[:100]].append((row, says))
    lines += ["", "## Refused", ""]
    lines += [f"- {name} ({len(of)}): {of[0][1][:160]} -- {', '.join(row for row, _ in of)}"
              for (name, _), of in sorted(groups.items(), key=lambda item: -len(item[1]))]
    return "\n".join(lines) + "\n"


def rows(quick: bool = False) -> Iterator[Row]:
    """All features of this part."""
    analyses = list(QUICK if quick else ANALYSES)
    for feature in FEATURES:
        found = pairs_of(feature, analyses)
        failed = [f"{name}: {says}" for name, (status, says, _) in found.items() if status == "failed"]
        happened = "; ".join(failed) or str(_share([*found.values()])[1])
        yield Row(f"{feature}, {len(found)} analyses", "right, or refused", happened, not failed)


def main() -> int:
    """Run the pairs asked for; return 1 where one failed."""
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("out", type=Path)
    ask.add_argument("--md", type=Path)
    ask.add_argument("--features", nargs="+", default=list(FEATURES), choices=list(FEATURES), metavar="FEATURE")
    ask.add_argument("--analyses", nargs="+", default=list(ANALYSES), choices=list(ANALYSES), metavar="ANALYSIS")
    ask.add_argument("--jobs", type=int, default=2)
    ask.add_argument("--timeout", type=float, default=180.0, help="seconds that a pair may take")
    ask.add_argument("--fill", action="store_true", help="compare with work arrays that begin as NaN")
    ask.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    asked = ask.parse_args()
    if asked.child:
        _of_feature(asked.features[0], asked.analyses, asked.fill)
        return 0
    table = json.loads(asked.out.read_text()) if asked.out.exists() else {}
    work = {row: left for row in asked.features if (left := [name for name in asked.analyses if name not in table.get(row, {})])}
    with concurrent.futures.ThreadPoolExecutor(asked.jobs) as pool:
        tasks = {pool.submit(pairs_of, row, left, asked.timeout, asked.fill): row for row, left in work.items()}
        for task in concurrent.futures.as_completed(tasks):
            row, found = tasks[task], task.result()
            table.setdefault(row, {}).update(found)
            asked.out.write_text(json.dumps(table, indent=0))
            print(f"{row}: " + "".join(SIGNS[found[name][0]] for name in ANALYSES if name in found), flush=True)
    text = report(table)
    print(text)
    if asked.md:
        asked.md.write_text(text)
    return int(any(pair[0] == "failed" for pairs in table.values() for pair in pairs.values()))


if __name__ == "__main__":
    sys.exit(main())
