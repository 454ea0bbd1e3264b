"""The text of the study: a short lead and the tables of the measured numbers, written as Markdown."""
from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import texts
from measures import orders
from methods import BLOWN_UP, MAX_ITERATIONS, METHODS, STRICT

Numbers = dict[str, Any]
BAR = 1e-11
# an observed order this much below the expected one counts as missed
NEAR = 0.3
NAMES = {"total": "energy", "lin_mom": "momentum", "ang_mom": "angular momentum", "gap": "gap"}
ONE = {"beams": "beam", "elements": "element", "bodies": "body", "masses": "mass", "sliders": "slider"}


def text(data: Numbers) -> str:
    """The whole page."""
    cases = data["cases"]
    order = sorted(cases, key=lambda name: cases[name].get("drift", {}).get("facts", {}).get("letter", "z"))
    cases = {name: cases[name] for name in order}
    parts = [_head(data), _bars(cases), texts.FINDINGS, _largest(cases), _drift(cases), _orders(cases), _mesh(cases),
             _iterations(cases), _control(cases), _scenes(cases)]
    return "\n\n".join(part.strip() for part in parts if part) + "\n"


# ------------------------------------------------------------------------------------------------------------------ format
def number(x: float | None, form: str = ".1e") -> str:
    """A number, or a dash where there is none."""
    return "-" if x is None or not math.isfinite(x) else format(x, form)


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A Markdown table."""
    head = list(head)
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def name_of(cases: Numbers, name: str) -> str:
    """Letter and name of a scene."""
    letter = cases[name].get("drift", {}).get("facts", {}).get("letter")
    return f"({letter}) {name}" if letter else name


def last_order(steps: list[float], entry: Numbers) -> float | None:
    """Median of the last three observed orders."""
    found = sorted([x for x in orders(steps, entry["error"]) if math.isfinite(x)][-3:])
    return found[len(found) // 2] if found else None


def step_text(entry: Numbers, numbers: Numbers) -> str:
    """The largest step, or that none or every one tried passes."""
    if entry["step"] is None:
        return f"none >= {numbers['bottom']:.2g}"
    return (">= " if entry["failed"] is None else "") + format(entry["step"], ".3g")


# ------------------------------------------------------------------------------------------------------------------- parts
def _head(data: Numbers) -> str:
    m = {key: "" for key in ("cpu", "cores", "system", "python", "numpy", "numba")} | data.get("machine", {})
    quick = " This is a quick run: few scenes, few steps." if data.get("quick") else ""
    seconds = sum(part.get("seconds", 0.0) for case in data["cases"].values() for part in case.values())
    return texts.HEAD.format(iterations=MAX_ITERATIONS, minutes=seconds / 60.0, quick=quick, **m)



def em_drifts(cases: Numbers) -> list[tuple[str, str, float, float]]:
    """(scene, method, step, worst drift) of every run of the conserving step that finished or ended in a failed step."""
    out = []
    for name, case in cases.items():
        for key in ("em2", "em4"):
            entry = case.get("drift", {}).get("methods", {}).get(key)
            if entry:
                out.append((name, key, case["drift"]["facts"]["step"], max(entry["drift"].values())))
            for r in case.get("largest", {}).get(key, {}).get("runs", []):
                if r["drift"] is not None and r["step"] > 0:
                    out.append((name, key, r["h"], r["drift"]))
        for r in case.get("control", {}).get("runs", []):
            out.append((name, f"em{r['order']}, step control", 0.0, max(r["drift"].values())))
    return out


def _bars(cases: Numbers) -> str:
    rows = []
    drifts = em_drifts(cases)
    if drifts:
        worst = max(drifts, key=lambda x: x[3])
        over = sum(x[3] > BAR for x in drifts)
        rows.append(("drift of energy, momenta and gap of the conserving step, orders 2 and 4, at most 1e-11",
                     f"{worst[3]:.1e} in the worst of {len(drifts)} runs ({worst[0]}, {worst[1]}"
                     + (f", h = {worst[2]:.3g} s" if worst[2] else "") + ")",
                     "met" if over == 0 else f"missed in {over} runs"))
    for key, order in (("em2", 2), ("em4", 4)):
        entries = {name: case["orders"]["methods"][key] for name, case in cases.items()
                   if key in case.get("orders", {}).get("methods", {})}
        found = {name: last_order(entry["steps"], entry["position"]) for name, entry in entries.items()}
        last = {name: x for name, x in found.items() if x is not None}
        missed = [name for name, x in last.items() if x < order - NEAR]
        if last:
            rows.append((f"order {order} in position of the conserving step, with sliders too",
                         ", ".join(f"{name} {x:.2f}" for name, x in last.items()),
                         f"missed on {', '.join(missed)}" if missed else "met"))
    for letter in ("c", "g"):
        for name, case in cases.items():
            numbers = case.get("largest", {})
            if case.get("drift", {}).get("facts", {}).get("letter") == letter and {"em2", "trapezoidal"} <= set(numbers):
                rows.append((f"largest step of the conserving step at least 5 times that of the trapezoidal rule, {name}",
                             *_ratio(numbers)))
    return "## Bars\n\n" + table(("bar", "measured", "verdict"), rows) if rows else ""


def _ratio(numbers: Numbers) -> tuple[str, str]:
    em, tr = numbers["em2"], numbers["trapezoidal"]
    a, b = em["survived"]["step"], tr["survived"]["step"]
    if a is None:
        return f"none of the steps of order 2 from {em['bottom']:.2g} s on survives", "missed"
    if b is None:
        ratio = a / tr["bottom"]
        return f"{step_text(em['survived'], em)} s against none from {tr['bottom']:.2g} s on: more than {ratio:.0f} times", \
            "met" if ratio >= 5.0 else "open"
    capped = em["survived"]["failed"] is None
    both = f"{step_text(em['survived'], em)} s against {step_text(tr['survived'], tr)} s"
    return f"{both}: {'at least ' if capped else ''}{a / b:.1f} times", "met" if a / b >= 5.0 else "missed"


def _largest(cases: Numbers) -> str:
    found = {name: case["largest"] for name, case in cases.items() if "largest" in case}
    if not found:
        return ""
    keys = [key for key in METHODS if any(key in x for x in found.values())]
    head = ["scene, span", *(METHODS[key].label for key in keys)]
    out = [texts.LARGEST.format(blown=BLOWN_UP, strict=STRICT)]
    rows = []
    for name, numbers in found.items():
        cells = [" (".join(step_text(numbers[k][what], numbers[k]) for what in ("survived", "strict")) + ")"
                 if k in numbers else "-" for k in keys]
        spans = {numbers[k]["span"] for k in numbers if k in METHODS}
        rows.append([f"{name_of(cases, name)}, {max(spans):g} s", *cells])
    out.append(table(head, rows))
    out.append("\nHow each of them ends at the smallest step tried above that limit:\n")
    rows = []
    for name, numbers in found.items():
        for key in keys:
            limit = numbers.get(key, {}).get("survived", {}).get("failed")
            if limit is None:
                continue
            r = min((r for r in numbers[key]["runs"] if not r["survived"]), key=lambda r: abs(r["h"] - limit))
            rows.append([name, METHODS[key].label, f"{r['h']:.3g}", f"{r['step']}, {r['time']:.3g}", number(r["energy_error"]),
                         r["reason"]])
    out.append(table(("scene", "method", "h [s]", "step, t [s]", "energy error", "reason"), rows))
    return "\n".join(out)


def _drift(cases: Numbers) -> str:
    found = {name: case["drift"] for name, case in cases.items() if "drift" in case}
    if not found:
        return ""
    rows = []
    for name, numbers in found.items():
        for key, entry in numbers["methods"].items():
            d = entry["drift"]
            state = "" if entry["status"] == "done" else f"{entry['status']} at {entry['time']:.3g} s"
            rows.append([f"{name_of(cases, name)}, h = {numbers['facts']['step']:g} s" if key == "em2" else "",
                         METHODS[key].label, number(entry["energy_error"]),
                         *(number(d.get(x)) for x in ("lin_mom", "ang_mom", "gap")),
                         f"{entry['newton']:.1f}", number(entry.get("zigzag"), ".1e"), state])
    return (texts.DRIFT
            + table(("scene", "method", "energy", "momentum", "angular momentum", "gap", "Newton per step", "zigzag", "failed"),
                    rows)
            + "\n\n![Contact forces](study/forces.png)")


def _orders(cases: Numbers) -> str:
    found = {name: case["orders"] for name, case in cases.items() if "orders" in case}
    if not found:
        return ""
    rows = []
    for name, numbers in found.items():
        for key, entry in numbers["methods"].items():
            failed = "; ".join(f"h = {h}: {why}" for h, why in entry["failed"].items())
            first = f"{name_of(cases, name)}, {numbers['elements']} elements, {numbers['mesh'].split(', ')[0]}, "
            rows.append([f"{first}t = {numbers['t_end']:g} s" if key == "em2" else "", METHODS[key].label,
                         f"{entry['steps'][0]:.3g} to {entry['steps'][-1]:.3g}",
                         " ".join(number(e) for e in entry["position"]["error"]),
                         " ".join(number(o, ".1f") for o in orders(entry["steps"], entry["position"]["error"])),
                         *(number(last_order(entry["steps"], entry[k]), ".2f") if k in entry else "-"
                           for k in ("position", "s", "force")), failed])
    return (texts.ORDERS
            + table(("scene", "method", "steps [s]", "errors of positions / L", "orders", "position", "s", "force", "failed"),
                    rows))


def _mesh(cases: Numbers) -> str:
    found = [(name, strain, case["mesh"][strain]) for name, case in cases.items() if "mesh" in case
             for strain in ("green_lagrange", "simo_reissner") if strain in case["mesh"]]
    if not found:
        return ""
    rows = []
    for name, strain, numbers in found:
        for k, (label, entry) in enumerate(numbers["families"].items()):
            failed = "; ".join(f"{n} elements: {why}" for n, why in entry["failed"].items())
            rows.append([f"{name_of(cases, name)}, {strain}, t = {numbers['t_end']:g} s" if k == 0 else "", label,
                         " ".join(str(n) for n in entry["nodes"]), " ".join(number(e) for e in entry["error"]),
                         " ".join(number(o, ".1f") for o in entry["order"]), failed])
    return (texts.MESH
            + table(("scene, strains", "interpolation", "nodes", "errors of positions / L", "orders", "failed"), rows))


def _iterations(cases: Numbers) -> str:
    found = {name: case["largest"] for name, case in cases.items() if "largest" in case}
    if not found:
        return ""
    keys = [key for key in METHODS if any(key in x for x in found.values())]
    rows = []
    for name, numbers in found.items():
        entries = cases[name].get("drift", {}).get("methods", {})
        usual = [f"{entries[k]['newton']:.1f}" if k in entries else "-" for k in keys]
        largest = []
        for k in keys:
            most = 1.001 * (numbers.get(k, {}).get("survived", {}).get("step") or 0.0)
            passed = [r for r in numbers.get(k, {}).get("runs", []) if r["survived"] and r["h"] <= most]
            largest.append(f"{passed[-1]['newton']:.1f}" if passed else "-")
        rows.append([name_of(cases, name), *(f"{a} / {b}" for a, b in zip(usual, largest))])
    return texts.NEWTON + table(("scene", *(METHODS[k].label for k in keys)), rows)


def _control(cases: Numbers) -> str:
    found = {name: case["control"]["runs"] for name, case in cases.items() if "control" in case}
    if not found:
        return ""
    rows = []
    for name, runs in found.items():
        for k, r in enumerate(runs):
            errors = [e for e in r["local_errors"] if e is not None]
            ratio = [e / r["tolerance"] for e in errors]
            rows.append([f"{name_of(cases, name)}, t = {r['t_end']:g} s" if k == 0 else "", str(r["order"]),
                         f"{r['tolerance']:.0e}", f"{r['accepted']} / {r['rejected']}",
                         f"{number(r.get('smallest'))} to {number(r.get('largest'))}",
                         f"{number(sorted(ratio)[len(ratio) // 2] if ratio else None, '.2f')}; "
                         f"{number(max(ratio, default=None), '.2f')}",
                         number(max(r["drift"].values())), r["reason"]])
    return (texts.CONTROL
            + table(("scene", "order", "tolerance", "accepted / rejected", "steps [s]",
                     "true local error / tolerance: median; largest", "drift", "failed"), rows))


def _scenes(cases: Numbers) -> str:
    out = ["## The scenes"]
    for name, case in cases.items():
        if "drift" not in case:
            continue
        facts, entry = case["drift"]["facts"], case["drift"]["methods"].get("em2", {})
        crossed = entry.get("crossed")
        passes = ""
        if crossed:
            passes = (f" The slider crosses {crossed[0]} element ends." if len(crossed) == 1
                      else f" Every slider crosses at least {min(crossed)} element ends (at most {max(crossed)}).")
        parts = ", ".join(f"{facts[key]} {key if facts[key] != 1 else ONE[key]}" for key in ONE if facts[key])
        out.append(f"### ({facts['letter']}) {name}\n\n{facts['text'][0].upper()}{facts['text'][1:]}. {texts.LEADS[name]}\n\n"
                   f"{parts}, {facts['unknowns']} unknowns; {facts['t_end']:g} s with h = {facts['step']:g} s; "
                   f"energy scale {facts['energy_scale']:.3g} J.{passes}")
    return "\n\n".join(out)
