"""Error against run time: fastbeam beside other beam programs, one thread each, in one session.

    python perf/peers/environments.py       once: makes the environments of the peers
    python perf/peers/run.py [--quick] [--scenes spaghetti3d,sliding] [--peers exudyn,pyelastica,opensees]
    python perf/peers/run.py --redo perf/peers/results.json      tables and picture from stored runs

Writes the runs, a table beside them and a picture. Exits with 1 where a bar is missed. See README.md beside this file.
"""
from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(ROOT))

from perf.machine import machine  # noqa: E402
from perf.peers.cases import BAR, ERRORS, PEERS, QUICK_REFERENCE, REFERENCE, SCENES, Sweep, full, quick  # noqa: E402
from perf.peers.environments import trouble  # noqa: E402
from perf.peers.front import distance  # noqa: E402
from perf.peers.judge import LENGTH, TITLE, Verdict, fronts, notes, points, ratio, table, verdict  # noqa: E402
from perf.peers.session import key, mixed, run, short  # noqa: E402

ENERGY = {"fastbeam": {"elements": 8, "degree": 3, "step": 0.01, "order": 2, "cable": True, "energy": True},
          "exudyn": {"elements": 8, "step": 0.0005, "solver": "trapezoidal", "dim": 2}}


def measure(scenes: list[str], peers: list[str], is_quick: bool, out: Path, before: dict[str, Any]) -> dict[str, Any]:
    """All runs of a session that `before` does not have; the file `out` is kept up to date, so that nothing gets lost."""
    sweeps = quick() if is_quick else full()
    reasons = {name: trouble(name) for name in peers}
    for name, reason in reasons.items():
        if reason:
            print(f"{TITLE[name]} is left out: {reason}", flush=True)
    programs = ["fastbeam", *(name for name in peers if not reasons[name])]
    session: dict[str, Any] = {"quick": is_quick, "machine": {**machine(), "date": time.strftime("%Y-%m-%d")},
                               "left_out": {k: v for k, v in reasons.items() if v},
                               "reference": before.get("reference", {}), "energy": before.get("energy", {}),
                               "runs": [line for line in before.get("runs", []) if line["ok"]]}
    have = {(line["program"], line["scene"], key(line["settings"])) for line in session["runs"]}
    for scene in scenes:
        pair = (QUICK_REFERENCE if is_quick else REFERENCE)[scene]
        if scene not in session["reference"]:
            session["reference"][scene] = [run("fastbeam", scene, settings) for settings in pair]
        queues = [[(sweep.program, settings) for settings in sweep.all_runs()
                   if (sweep.program, scene, key(settings)) not in have]
                  for sweep in sweeps[scene] if sweep.program in programs]
        order = mixed(queues)
        for k, (program, settings) in enumerate(order, 1):
            line = run(program, scene, settings)
            session["runs"].append(line)
            out.write_text(json.dumps(session, indent=1) + "\n")
            said = f"{line['wall']:9.4f} s, processor {line['processor']:9.4f} s" if line["ok"] else f"FAILED: {line['message']}"
            print(f"{scene} {k:3d}/{len(order)} {program:10} {short(settings):60} {said}", flush=True)
        if scene == "sliding":
            for name, settings in ENERGY.items():
                if name in programs and name not in session["energy"]:
                    session["energy"][name] = run(name, scene, settings)
    out.write_text(json.dumps(session, indent=1) + "\n")
    return session


def report(session: dict[str, Any], clock: str) -> tuple[str, dict[str, dict[str, Verdict]]]:
    """Markdown text and the verdicts."""
    sweeps = quick() if session["quick"] else full()
    verdicts: dict[str, dict[str, Verdict]] = {}
    text = ["# Error against run time", "",
            f"{session['machine']['date']}, {session['machine']['processor']}, one thread, {clock} time of the solve alone."
            f"{' Quick selection.' if session['quick'] else ''}", ""]
    details: list[str] = []
    for scene, pair in session["reference"].items():
        common, other = (points(line) for line in pair)
        uncertainty = distance(common, other, LENGTH[scene])
        details.append(f"- {scene}: common reference fastbeam {short(pair[0]['settings'])}, {uncertainty:.1e} from "
                       f"{short(pair[1]['settings'])}")
        by_program: dict[str, Sweep] = {sweep.program: sweep for sweep in sweeps[scene]}
        verdicts[scene] = {}
        for name, sweep in by_program.items():
            wanted = {key(settings) for settings in sweep.all_runs()}
            lines = [line for line in session["runs"] if line["scene"] == scene and line["program"] == name
                     and key(line["settings"]) in wanted]
            if lines:
                verdicts[scene][name] = verdict(sweep, lines, common, uncertainty, LENGTH[scene], clock)
        details += notes(scene, verdicts[scene], by_program)
    versions = {line["program"]: line.get("version", "") for line in session["runs"] if line["ok"]}
    programs = [name for name in ("fastbeam", *PEERS) if name in versions]
    text += [table(verdicts, programs), "",
             "Versions: " + ", ".join(f"{TITLE[name]} {versions[name]}" for name in programs) + ".", "", "## Notes", "", *details]
    text += [f"- sliding, energy, {TITLE[name]} ({short(line['settings'])}): the total energy, which the scene conserves, "
             f"changes by {line['energy_change']:.1e} of the kinetic energy at the start"
             for name, line in session["energy"].items() if line["ok"]]
    text += [f"- {TITLE[name]} is left out: {reason}" for name, reason in session["left_out"].items()]
    text += ["", "## Fronts", ""]
    for scene in verdicts:
        text += [f"{scene}:", "", "| program | error | time, s | run |", "| --- | --- | --- | --- |"]
        text += [*fronts(verdicts[scene]), ""]
    return "\n".join(text), verdicts


def names(text: str, known: tuple[str, ...]) -> list[str]:
    """A list on the command line."""
    chosen = [name for name in text.split(",") if name]
    unknown = [name for name in chosen if name not in known]
    if unknown:
        raise SystemExit(f"{unknown[0]!r} is unknown: choose from {', '.join(known)}")
    return chosen


def main() -> int:
    """Measure, judge, write; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--scenes", default=",".join(SCENES), help="comma-separated (default: %(default)s)")
    parser.add_argument("--peers", default=",".join(PEERS), help="comma-separated (default: %(default)s)")
    parser.add_argument("--quick", action="store_true", help="a thin selection, a few minutes")
    parser.add_argument("--out", type=Path, default=HERE / "results.json", help="the runs; tables go beside it as .md")
    parser.add_argument("--picture", type=Path, default=ROOT / "docs" / "reports" / "peers.png")
    parser.add_argument("--clock", choices=("wall", "processor"), default="wall",
                        help="'processor' where other programs share the machine")
    parser.add_argument("--resume", action="store_true", help="keep the runs that are in the file --out, add what is missing")
    parser.add_argument("--redo", type=Path, help="judge the runs in this file; nothing is measured")
    options = parser.parse_args()
    if options.redo:
        session = json.loads(options.redo.read_text())
    else:
        before = json.loads(options.out.read_text()) if options.resume and options.out.exists() else {}
        if before and before["quick"] != options.quick:
            raise SystemExit(f"{options.out} holds {'quick' if before['quick'] else 'full'} runs: resume it as such")
        session = measure(names(options.scenes, SCENES), names(options.peers, PEERS), options.quick, options.out, before)
    text, verdicts = report(session, options.clock)
    print(f"\n{text}")
    out = options.redo or options.out
    out.with_suffix(".md").write_text(text)
    try:
        from perf.peers.picture import draw
        draw(verdicts, options.clock, options.picture)
    except ImportError as error:
        print(f"no picture: {error}")
    missed = [(scene, error) for scene, v in verdicts.items() if len(v) > 1 for error in ERRORS if not ratio(v, error)[0] >= BAR]
    return int(bool(missed))


if __name__ == "__main__":
    raise SystemExit(main())
