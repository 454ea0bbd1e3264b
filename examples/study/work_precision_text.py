"""The text of the work-precision comparison: tables and answers computed from the stored numbers."""
from __future__ import annotations

import math
from typing import Any

from work_precision_plot import Front, busy, clock, column, default_method, default_text, front, is_default, label, points

Numbers = dict[str, Any]
TARGETS = (1e-3, 1e-4, 1e-6, 1e-8)
# targets that a default is judged by: what mechanisms are usually computed to
EVERYDAY, FINE = (1e-3, 1e-4), (1e-5, 1e-6)
FORCE_TARGETS = (1e-1, 1e-2, 1e-3, 1e-4)
# times within this factor count as equal; a default is changed for more than the second
EQUAL, CLEAR = 1.15, 1.3
Choice = tuple[str, int]


# ----------------------------------------------------------------------------------------------------------- times at errors
def time_at(found: Front, target: float) -> float | None:
    """Seconds to an error: between the points of the front by logarithms, the fastest run where all are better, None where none
    is."""
    line = front(found)
    for k, (t, e) in enumerate(line):
        if e <= target:
            if k == 0:
                return t
            t0, e0 = line[k - 1]
            x = math.log(e0 / target) / math.log(e0 / e)
            return math.exp((1.0 - x) * math.log(t0) + x * math.log(t))
    return None


def groups(data: Numbers, scene: Numbers, strain: str) -> dict[str, list[Numbers]]:
    """Families of a strain set by their discretisation; both orders together."""
    out: dict[str, list[Numbers]] = {}
    for family in scene["families"]:
        if family["strain"] == strain:
            out.setdefault(label(family), []).append(family)
    return out


def best(data: Numbers, families: list[Numbers], target: float, error: str = "position") -> tuple[float, Numbers] | None:
    """The fastest of some families at an error, and its seconds."""
    times = [(time_at(points(data, f["rows"], error), target), k) for k, f in enumerate(families)]
    known = [(t, k) for t, k in times if t is not None]
    return (min(known)[0], families[min(known)[1]]) if known else None


def power(target: float) -> str:
    """1e-4 and the like."""
    return f"{target:.0e}".replace("e-0", "e-")


def milliseconds(t: float | None) -> str:
    """Two digits."""
    if t is None:
        return "-"
    x = 1e3 * t
    return f"{x:.0f}" if x >= 9.95 else f"{x:.1f}"


def reachable(scene: Numbers, strain: str, target: float) -> bool:
    """Whether the reference can tell errors of this size."""
    return target >= scene["references"][strain]["uncertainty"]["position"]


# -------------------------------------------------------------------------------------------------------------------- tables
def family_table(data: Numbers, name: str, strain: str) -> list[str]:
    """Milliseconds of every discretisation, with its faster order in brackets; bold: fastest, or as good."""
    scene = data["scenes"][name]
    table = groups(data, scene, strain)
    cells: dict[str, list[str]] = {}
    everything = [f for fs in table.values() for f in fs]
    for text, families in table.items():
        row = []
        for target in TARGETS:
            found, top = best(data, families, target), best(data, everything, target)
            if not reachable(scene, strain, target):
                row.append("below reference")
            elif found is None or top is None:
                row.append("-")
            else:
                cell = f"{milliseconds(found[0])} ({found[1]['order']})"
                row.append(f"**{cell}**" if found[0] <= EQUAL * top[0] else cell)
        mine = any(is_default(data, f, order=False) for f in families)
        cells[text + (" - default" if mine else "")] = row
    head = ["| discretisation | " + " | ".join(power(t) for t in TARGETS) + " |", "| --- " * 5 + "|"]
    return head + [f"| {text} | " + " | ".join(row) + " |" for text, row in cells.items()]


def method_table(data: Numbers, name: str, error: str, targets: tuple[float, ...]) -> list[str]:
    """Milliseconds of every method on the same mesh."""
    methods = data["scenes"][name]["methods"]
    floor = methods["uncertainty"].get(error, 0.0)
    times = {key: [time_at(points(data, entry["rows"], error), t) if t >= floor else None for t in targets]
             for key, entry in methods["families"].items()}
    out = ["| method | " + " | ".join(power(t) for t in targets) + " |", "| --- " * (len(targets) + 1) + "|"]
    for key, row in times.items():
        cells = []
        for k, t in enumerate(row):
            known = [r[k] for r in times.values() if r[k] is not None]
            cells.append(f"**{milliseconds(t)}**" if t is not None and t <= EQUAL * min(known) else milliseconds(t))
        mine = " - default" if key == default_method(data) else ""
        out.append(f"| {methods['families'][key]['label']}{mine} | " + " | ".join(cells) + " |")
    return out


def choices(data: Numbers) -> dict[Choice, dict[str, Numbers]]:
    """(discretisation, order) -> its family in every scene, with the strains of the default; where nothing slides, all curves are
    the same."""
    out: dict[Choice, dict[str, Numbers]] = {}
    for name, scene in data["scenes"].items():
        for f in scene["families"]:
            if f["strain"] == data["defaults"]["strain"]:
                out.setdefault((label(f), f["order"]), {})[name] = f
    for (text, order), found in out.items():
        plain = out.get((text.removesuffix(", own curve"), order), {})
        for name, scene in data["scenes"].items():
            if name in plain and not scene["sliders"]:
                found.setdefault(name, plain[name])
    return out


def ranking(data: Numbers, targets: tuple[float, ...]) -> list[tuple[str, int, bool, int, int, float, float]]:
    """Candidates for a default (discretisation, order) with the strains of the default: (name, order, is the default, targets
    reached, targets in all, mean factor over the front, largest factor), the best first."""
    strain = data["defaults"]["strain"]
    factors: dict[Choice, list[float | None]] = {}
    default: set[Choice] = set()
    for name, scene in data["scenes"].items():
        for target in [t for t in targets if reachable(scene, strain, t)]:
            top = best(data, [f for f in scene["families"] if f["strain"] == strain], target)
            if top is None:
                continue
            for key, found in choices(data).items():
                t = time_at(points(data, found[name]["rows"], "position"), target) if name in found else None
                factors.setdefault(key, []).append(t / top[0] if t is not None else None)
                if name in found and is_default(data, found[name]) and "own" not in key[0]:
                    default.add(key)
    out = []
    for key, found in factors.items():
        known = [x for x in found if x is not None]
        n = len(found)
        mean = math.exp(sum(map(math.log, known)) / len(known)) if known else math.inf
        out.append((*key, key in default, len(known), n, mean, max(known, default=math.inf)))
    return sorted(out, key=lambda x: (x[3] < x[4], x[5]))


def ranking_table(rows: list[tuple[str, int, bool, int, int, float, float]], n: int = 10) -> list[str]:
    """The best candidates and the present default."""
    out = ["| | discretisation | order | errors reached | mean factor | largest factor |", "| --- " * 6 + "|"]
    for k, (text, order, mine, known, total, mean, worst) in enumerate(rows, 1):
        if k <= n or mine:
            mark = " - default" if mine else ""
            out.append(f"| {k} | {text}{mark} | {order} | {known} of {total} | {mean:.2f} | {worst:.2f} |")
    return out


# ------------------------------------------------------------------------------------------------------------------- answers
def standing(data: Numbers) -> list[str]:
    """One line per scene and error: what is on the front, and how far the default is from it."""
    strain, out = data["defaults"]["strain"], []
    for name, scene in data["scenes"].items():
        families = [f for f in scene["families"] if f["strain"] == strain]
        mine = [f for f in families if is_default(data, f)]
        for target in (1e-3, 1e-4, 1e-5, 1e-6, 1e-8):
            if not reachable(scene, strain, target):
                continue
            top, own = best(data, families, target), best(data, mine, target)
            goal = power(target)
            if top is None:
                out.append(f"| {name} | {goal} | not reached by any | | |")
                continue
            fastest = f"{label(top[1])}, order {top[1]['order']}"
            own_text = (milliseconds(own[0]), f"{own[0] / top[0]:.1f}") if own else ("not reached", "-")
            out.append(f"| {name} | {goal} | {fastest}: {milliseconds(top[0])} | {own_text[0]} | {own_text[1]} |")
    return ["| scene | error | fastest, ms | default, ms | factor |", "| --- " * 5 + "|"] + out


def curves(data: Numbers) -> list[str]:
    """c1 against own curve at the same degree, where both were run: best over both orders."""
    out = ["| scene | degree | error of | error | c1, ms | own, ms |", "| --- " * 6 + "|"]
    strain = data["defaults"]["strain"]
    for name, scene in data["scenes"].items():
        table, unsure = groups(data, scene, strain), scene["references"][strain]["uncertainty"]
        for text in [t for t in table if t.endswith("own curve")]:
            for key, title, targets in (("position", "position", EVERYDAY + FINE), ("mean_force", "mean force", FORCE_TARGETS)):
                for target in [t for t in targets if t >= unsure[key]]:
                    pair = [best(data, table.get(k, []), target, key) for k in (text.removesuffix(", own curve"), text)]
                    if any(pair):
                        shown = " | ".join(f"{milliseconds(x[0])} ({x[1]['order']})" if x else "-" for x in pair)
                        out.append(f"| {name} | {table[text][0]['degree']} | {title} | {power(target)} | {shown} |")
    return out


def paper(data: Numbers) -> list[str]:
    """The paper's own discretisation against the best of the same strains."""
    out = []
    for name, scene in data["scenes"].items():
        families = [f for f in scene["families"] if f["strain"] == "green_lagrange"]
        own = [f for f in families if f["directors"] == "control"]
        rest = [f for f in families if f["directors"] != "control"]
        smallest = {key: min((e for f in group for _, e in points(data, f["rows"], "position")), default=math.nan)
                    for key, group in (("own", own), ("rest", rest))}
        times = []
        for target in (1e-3, 1e-4):
            a, b = best(data, own, target), best(data, rest, target)
            goal = power(target)
            shown = [f"{milliseconds(x[0])} ms ({label(x[1])}, order {x[1]['order']})" if x else "not reached" for x in (a, b)]
            times.append(f"at {goal} {shown[0]} against {shown[1]}")
        out.append(f"- {name}: {'; '.join(times)}; smallest error of the sweep {smallest['own']:.1e} against "
                   f"{smallest['rest']:.1e}.")
    return out


def verdict(data: Numbers) -> list[str]:
    """What the ranking says about the default, in sentences."""
    out = []
    for text, targets in (("errors of 1e-3 and 1e-4", EVERYDAY), ("errors of 1e-5 and 1e-6", FINE)):
        rows = ranking(data, targets)
        if not rows or not rows[0][4]:
            continue
        first = rows[0]
        place = next((k for k, r in enumerate(rows, 1) if r[2]), None)
        mine = rows[place - 1] if place else None
        sentence = (f"For {text} the best choice for all scenes is {first[0]} with order {first[1]} (mean factor over the front "
                    f"{first[5]:.2f})")
        if mine is None:
            sentence += "; the default was not measured."
        elif place == 1:
            sentence += ", which is the default."
        else:
            close = mine[5] <= EQUAL * first[5] and mine[3] == first[3]
            verb = "stands beside it" if close else "does not lie on the front there"
            reached = "" if mine[3] == mine[4] else f", reaches {mine[3]} of {mine[4]}"
            sentence += (f"; the default ({mine[0]}, order {mine[1]}) has place {place} of {len(rows)} with {mine[5]:.2f}"
                         f"{reached} and {verb}.")
        out.append(sentence)
    return out


def proposal(data: Numbers) -> str:
    """Keep the default or change it: where another choice reaches as many errors in clearly less time."""
    strain = data["defaults"]["strain"]
    goals = [(name, t) for name, scene in data["scenes"].items() for t in EVERYDAY + FINE if reachable(scene, strain, t)]
    times: dict[Choice, dict[tuple[str, float], float]] = {}
    default: Choice | None = None
    for key, found in choices(data).items():
        for name, target in goals:
            if name in found:
                default = key if is_default(data, found[name]) and "own" not in key[0] else default
                t = time_at(points(data, found[name]["rows"], "position"), target)
                if t is not None:
                    times.setdefault(key, {})[name, target] = t
    if default is None or default not in times:
        return "The default was not measured."
    mine = times[default]
    gains = {}
    for key, found in times.items():
        if mine.keys() <= found.keys():
            gains[key] = math.exp(sum(math.log(mine[g] / found[g]) for g in mine) / len(mine))
    first = max(gains, key=lambda key: gains[key])
    reached = f"it reaches {len(mine)} of the {len(goals)} errors, that one {len(times[first])}"
    if gains[first] <= CLEAR:
        return (f"Nothing else reaches all errors that the default reaches in clearly less time (best: {first[0]}, order "
                f"{first[1]}, {gains[first]:.2f} times as fast; {reached}): **keep the default**.")
    ratios = [mine[g] / times[first][g] for g in mine]
    return (f"Over all scenes and errors from 1e-3 to 1e-6 that the default reaches, {first[0]} with order {first[1]} is "
            f"{gains[first]:.2f} times as fast in the mean (from {min(ratios):.2f} to {max(ratios):.2f}; "
            f"{reached}): **the picture asks for {first[0]}, order {first[1]}**.")


def method_verdict(data: Numbers) -> str:
    """How far every method is behind the fastest on the same mesh, in one sentence."""
    factors: dict[str, list[float]] = {}
    labels: dict[str, str] = {}
    total = 0
    for scene in data["scenes"].values():
        families, floor = scene["methods"]["families"], scene["methods"]["uncertainty"]["position"]
        for target in [t for t in EVERYDAY + FINE if t >= floor]:
            times = {key: time_at(points(data, e["rows"], "position"), target) for key, e in families.items()}
            known = [t for t in times.values() if t is not None]
            total += bool(known)
            for key, t in times.items():
                labels[key] = families[key]["label"]
                factors.setdefault(key, [])
                if t is not None:
                    factors[key].append(t / min(known))
    means = {key: math.exp(sum(map(math.log, f)) / len(f)) for key, f in factors.items() if f}
    shown = [f"{labels[key]}{' (default)' if key == default_method(data) else ''} {means[key]:.2f} ({len(factors[key])})"
             for key in sorted(means, key=lambda key: means[key])]
    return (f"Mean factor over the fastest at position errors from 1e-3 to 1e-6, and in brackets how many of the {total} errors "
            f"of all scenes a method reaches: {'; '.join(shown)}.")


def failures(data: Numbers) -> list[str]:
    """Runs that did not finish, one line for each family, with the reason of its finest failure."""
    out = []
    for name, scene in data["scenes"].items():
        named = [(entry["label"], entry) for entry in scene["methods"]["families"].values()]
        named += [(f"{label(f)}, {f['strain']}, order {f['order']}", f) for f in scene["families"]]
        for title, entry in named:
            if entry["failed"]:
                where, why = list(entry["failed"].items())[-1]
                n = len(entry["failed"])
                why = why.split(" (last of")[0]
                out.append(f"- {name}, {title}: {n} of {n + len(entry['rows'])} runs; the last with {where}: {why}.")
    return out or ["None."]


def quietness(data: Numbers) -> str:
    """How much of the wall time the processor worked, and what follows."""
    share = 100.0 * min(busy(data), 1.0)
    if clock(data) == "seconds":
        return f"Times are wall times; the processor worked {share:.0f} % of them."
    return (f"The processor worked {share:.0f} % of the wall time of the timed runs: the machine was busy with other work, so "
            "times are\nprocessor times, close to the wall times of a quiet machine.")


def text(data: Numbers) -> str:
    """The whole document."""
    return "\n".join(_head(data) + _answer(data) + _discretisations(data) + _paper_part(data) + _methods(data)
                     + ["", "## Runs that did not finish", ""] + failures(data)) + "\n"


def _head(data: Numbers) -> list[str]:
    machine = data["machine"]
    runs = sum(len(e["rows"]) for s in data["scenes"].values() for e in [*s["families"], *s["methods"]["families"].values()])
    out = ["# Error against run time", "",
           "Which method, order, degree and interpolation gives an error in the least time. Written by",
           f"`{data['command'].strip()}`; every number comes from `study/work_precision.json`, which that command measured.", "",
           f"{runs} points on {machine['cpu']}, one thread, Python {machine['python']}, numba {machine['numba']}.",
           quietness(data)]
    if data["quick"]:
        out += ["", "**This is the quick run: few meshes, coarse references. It says nothing about defaults.**"]
    out += ["",
            "- Error: largest distance of the observed points from the reference at 25 instants, divided by the length.",
            f"- Time: `simulate` with nothing recorded, best of {data['repeats']}, kernels warm, the scene compiled.",
            "- All methods and discretisations run in space, with 6 unknowns a node, also where the scene is planar: only the",
            "  conserving method has a planar form, which takes a half to a quarter of the time.",
            "- Contact force at instants: root mean square over instants from the third on, divided by the largest. Mean contact",
            "  force: the same of the force averaged from instant to instant.",
            "- References: fine runs of order 4; their uncertainty is the distance of a second fine run of another degree, mesh",
            "  and step. Smaller errors cannot be told and are shaded in the pictures.", "",
            "| scene | until, s | strains | reference | second | uncertainty: position | force | mean force |",
            "| --- " * 8 + "|"]
    for name, scene in data["scenes"].items():
        for key, r in scene["references"].items():
            u = r["uncertainty"]
            forces = " | ".join(f"{u[k]:.1e}" if k in u else "" for k in ("force", "mean_force"))
            out.append(f"| {name} | {scene['t_end']:g} | {key} | {r['mesh']} | {r['second']} | {u['position']:.1e} | {forces} |")
    return out


def _answer(data: Numbers) -> list[str]:
    out = ["", f"The default of the package is {default_text(data)}, method {data['defaults']['method']}.", "", "## Answer", ""]
    out += [line for sentence in [*verdict(data), proposal(data)] for line in (sentence, "")]
    out += ["The factor says how many times longer than the fastest of all discretisations and orders it takes.", ""]
    out += standing(data)
    for title, targets in (("errors of 1e-3 and 1e-4", EVERYDAY), ("errors of 1e-5 and 1e-6", FINE)):
        out += ["", f"Ranking over all scenes at {title} (means are geometric):", ""] + ranking_table(ranking(data, targets))
    return out


def _discretisations(data: Numbers) -> list[str]:
    strain = data["defaults"]["strain"]
    out = ["", "## Discretisations", "", "![Error against run time of all discretisations](study/work_precision_meshes.png)", "",
           "Time in ms at four errors, the faster order in brackets; bold: the fastest, or within 15 %; `-`: not reached by any",
           f"run of the sweep. Strains {strain}."]
    for name, scene in data["scenes"].items():
        out += ["", f"### {name}", "", f"({scene['letter']}) {scene['text']}.", ""] + family_table(data, name, strain)
    if any(s["sliders"] for s in data["scenes"].values()):
        out += ["", "### Curve of the slider", "", "Lagrange elements, the faster order in brackets:", ""] + curves(data)
    return out


def _paper_part(data: Numbers) -> list[str]:
    out = ["", "## The paper's discretisation", "", "![Green-Lagrange strains](study/work_precision_paper.png)", "",
           "Green-Lagrange strains on splines with orthonormal triads at the control points (the paper's own), against Lagrange",
           "elements and Greville triads with the same strains:", ""] + paper(data)
    for name in data["scenes"]:
        out += ["", f"{name}, green_lagrange:", ""] + family_table(data, name, "green_lagrange")
    return out


def _methods(data: Numbers) -> list[str]:
    out = ["", "## Methods", "", "![Error of time stepping of all methods](study/work_precision_methods.png)", "",
           "Same mesh, same equations; errors against the exact motion of that mesh, hence of time stepping alone. Time in",
           "ms.", "",
           method_verdict(data)]
    for name, scene in data["scenes"].items():
        methods = scene["methods"]
        out += ["", f"{name}, position, {methods['mesh']} (its error of space {methods['space']['position']:.1e}):", ""]
        out += method_table(data, name, "position", TARGETS)
    out += ["", "![Energy and contact force](study/work_precision_forces.png)"]
    for name, scene in data["scenes"].items():
        if scene["sliders"]:
            for key, title in (("force", "contact force at instants"), ("mean_force", "mean contact force between instants")):
                space = scene["methods"]["space"][key]
                out += ["", f"{name}, {title} (error of space of this mesh {space:.1e}):", ""]
                out += method_table(data, name, key, FORCE_TARGETS)
    entries = {key: e["label"] for key, e in next(iter(data["scenes"].values()))["methods"]["families"].items()}
    out += ["", "Largest energy error over all runs of the sweep:", "", f"| scene | {' | '.join(entries.values())} |",
            "| --- " * (1 + len(entries)) + "|"]
    for name, scene in data["scenes"].items():
        cells = [max(column(data, scene["methods"]["families"][key]["rows"], "energy"), default=math.nan) for key in entries]
        out.append(f"| {name} | " + " | ".join(f"{x:.1e}" for x in cells) + " |")
    return out
