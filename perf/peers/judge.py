"""From runs to errors, fronts, times at the wanted errors, and tables."""
from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from perf.peers.cases import BAR, ERRORS, Sweep
from perf.peers.front import Crossing, Limit, Run, distance, front, limit, time_at
from perf.peers.scenes import Sliding, Spaghetti
from perf.peers.session import key, short

Array = np.ndarray
LENGTH = {"spaghetti3d": Spaghetti.LENGTH, "sliding": Sliding.LENGTH}
TITLE = {"fastbeam": "fastbeam", "exudyn": "Exudyn", "pyelastica": "PyElastica", "opensees": "OpenSees"}
TRUST = 3.0  # runs closer to the reference than this many of its uncertainties are left out of the front


@dataclass
class Verdict:
    """One program in one scene.

    Parameters
    ----------
    runs, front : list of Run
        All runs with an error that can be trusted; the envelope.
    crossings : dict
        Wanted error -> Crossing.
    limit : Limit or None
        The program's own limit.
    from_common : float
        Distance of the own limit to the common reference; nan without a limit.
    uncertainty : float
        Of what the errors are measured from.
    failed : list of str
        Runs that gave no answer.
    """

    runs: list[Run] = field(default_factory=list)
    front: list[Run] = field(default_factory=list)
    crossings: dict[float, Crossing] = field(default_factory=dict)
    limit: Limit | None = None
    from_common: float = math.nan
    uncertainty: float = math.nan
    failed: list[str] = field(default_factory=list)


def points(line: Mapping[str, Any]) -> Array:
    """Positions [n, 3] of a run."""
    return np.array(line["points"], dtype=float)


def verdict(sweep: Sweep, lines: Sequence[dict[str, Any]], common: Array, uncertainty: float, length: float,
            clock: str) -> Verdict:
    """Judge the runs of one program; their errors are written into `lines`."""
    by_settings = {key(line["settings"]): line for line in lines if line["ok"]}
    out = Verdict(uncertainty=uncertainty,
                  failed=[f"{short(line['settings'])}: {line['message']}" for line in lines if not line["ok"]])
    if sweep.limit is not None:
        answers = {(run["elements"], run["step"]): points(by_settings[key(run)]) for run in sweep.limit_runs()
                   if key(run) in by_settings}
        if len(answers) == len(sweep.limit_runs()):
            out.limit = limit(answers, *sweep.limit, sweep.orders, length)
            out.from_common = distance(out.limit.points, common, length)
    target = common
    if sweep.own:
        if out.limit is None:
            out.uncertainty = math.nan
            out.failed.append("runs for its own limit are missing: its errors are unknown")
            return out
        target, out.uncertainty = out.limit.points, out.limit.uncertainty
    for line in by_settings.values():
        line["error"] = distance(points(line), target, length)
        if line["error"] >= TRUST * out.uncertainty:
            out.runs.append(Run(line["error"], line[clock], short(line["settings"])))
    out.front = front(out.runs)
    out.crossings = {error: time_at(out.front, error) for error in ERRORS}
    return out


def shown(crossing: Crossing | None) -> str:
    """A time for the table."""
    if crossing is None:
        return "-"
    if crossing.kind == "not reached":
        return "not reached"
    text = f"{crossing.time:.2g}" if crossing.time < 100.0 else f"{crossing.time:.0f}"
    if crossing.kind == "extrapolated":
        return f"{text} (extrapolated, t ~ e^-{crossing.slope:.1f})"
    return f"{text} (at most)" if crossing.kind == "at most" else text


def ratio(verdicts: Mapping[str, Verdict], error: float) -> tuple[float, str]:
    """(time of the fastest peer over that of fastbeam, its name); nan without both."""
    own = verdicts["fastbeam"].crossings.get(error) if "fastbeam" in verdicts else None
    times = {name: v.crossings[error].time for name, v in verdicts.items()
             if name != "fastbeam" and error in v.crossings and math.isfinite(v.crossings[error].time)}
    if own is None or not math.isfinite(own.time) or not times:
        return math.nan, ""
    best = min(times, key=lambda name: times[name])
    return times[best] / own.time, best


def table(all_verdicts: Mapping[str, Mapping[str, Verdict]], programs: Sequence[str]) -> str:
    """The Markdown table: time at each wanted error, and the ratio of the fastest peer to fastbeam."""
    head = ["scene", "error", *(f"{TITLE[name]}, s" for name in programs), "fastest peer / fastbeam"]
    lines = ["| " + " | ".join(head) + " |", "| " + " | ".join("---" for _ in head) + " |"]
    for scene, verdicts in all_verdicts.items():
        for error in ERRORS:
            cells = [shown(verdicts[name].crossings.get(error)) if name in verdicts else "-" for name in programs]
            value, best = ratio(verdicts, error)
            text = "-"
            if best:
                sign = " (extrapolated)" if verdicts[best].crossings[error].kind == "extrapolated" else ""
                text = f"{value:.0f}{sign}, bar {BAR:g}: {'met' if value >= BAR else 'MISSED'}"
            lines.append("| " + " | ".join([scene, f"{error:g}", *cells, text]) + " |")
    return "\n".join(lines)


def notes(scene: str, verdicts: Mapping[str, Verdict], sweeps: Mapping[str, Sweep]) -> list[str]:
    """What the errors are measured from, how far the models lie apart, best runs and failures, a line each."""
    out = []
    for name, v in verdicts.items():
        sweep = sweeps[name]
        text = f"- {scene}, {TITLE[name]}: errors from {'its own limit' if sweep.own else 'the common reference'}"
        text += f" (uncertainty {v.uncertainty:.1e})" if math.isfinite(v.uncertainty) else ""
        if v.limit is not None:
            found, space, order = v.limit, *sweep.orders
            text += (f"; own limit by Richardson with orders {space:g} in space and {order:g} in time (observed "
                     f"{found.order_space:.2f}, {found.order_time:.2f}), {found.uncertainty:.1e} from that of one level coarser, "
                     f"{v.from_common:.1e} from the common reference")
        if v.front:
            text += f"; {len(v.runs)} runs, most accurate {v.front[-1].error:.1e} in {v.front[-1].time:.3g} s"
        out.append(text)
        out += [f"  - failed: {line}" for line in v.failed]
    return out


def fronts(verdicts: Mapping[str, Verdict]) -> list[str]:
    """The runs of every front."""
    return [f"| {TITLE[name]} | {run.error:.1e} | {run.time:.3g} | {run.label} |"
            for name, v in verdicts.items() for run in v.front]
