"""The pictures of the study, drawn from the stored numbers."""
from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

import fastbeam as fb
from methods import METHODS, run
from scenes import Case

Numbers = dict[str, Any]
COLOURS = {"em2": "#0b5fa5", "em4": "#53a8e2", "midpoint": "#2e8b57", "trapezoidal": "#c0392b", "alpha09": "#7d3c98",
           "alpha05": "#d68910", "alpha00": "#7f8c8d"}
MARKS = {"em2": "o", "em4": "s", "midpoint": "^", "trapezoidal": "v", "alpha09": "D", "alpha05": "P", "alpha00": "X"}
STYLE = {"font.size": 9, "axes.grid": True, "grid.color": "0.9", "axes.axisbelow": True, "axes.spines.top": False,
         "axes.spines.right": False, "axes.titlesize": 10, "legend.frameon": False, "figure.dpi": 110, "lines.linewidth": 1.4}


def shapes(case: Case, model: fb.Model, n: int = 6) -> Numbers:
    """Positions along every beam [beam][time][node] and of bodies, masses and sliders at a few times, in the largest plane."""
    result = run(case, model, "em2", step=case.step, every=max(1, round(case.t_end / case.step / 200)),
                 output=fb.Output(snapshots=120)).result
    phi = result.phi
    low, high = phi.reshape(-1, 3).min(axis=0), phi.reshape(-1, 3).max(axis=0)
    plane = sorted(np.argsort(high - low)[::-1][:2].tolist())
    if case.name == "large":
        plane = [0, 2]
    picks = np.linspace(0, len(phi) - 1, n).round().astype(int)
    if case.name == "large":
        picks = picks[[0, 2, 5]]
    out: Numbers = {"plane": plane, "t": [float(result.t_snap[k]) for k in picks], "beams": [], "dots": [], "path": []}
    for beam in result.names["beams"][:: 2 if case.name == "large" else 1]:
        first, last = beam["first"], beam["first"] + beam["count"]
        stride = max(1, beam["count"] // 40)
        nodes = np.unique(np.append(np.arange(first, last, stride), last - 1))
        out["beams"].append([[[float(f"{x:.4g}") for x in p] for p in phi[k][nodes][:, plane]] for k in picks])
    lumps = [entry["node"] for kind in ("bodies", "masses") for entry in result.names.get(kind, [])] + list(
        result.names.get("slider_nodes", []))
    out["dots"] = [[[float(f"{x:.4g}") for x in p] for p in phi[k][sorted(set(lumps))][:, plane]] for k in picks]
    return out


# ----------------------------------------------------------------------------------------------------------------- drawing
def draw(data: Numbers, folder: Path) -> list[Path]:
    """Draw everything that the data hold."""
    import matplotlib as mpl
    folder.mkdir(parents=True, exist_ok=True)
    made = []
    with mpl.rc_context(STYLE):
        for name, make in (("scenes", _scenes), ("energy", _energy), ("forces", _forces), ("orders", _orders), ("mesh", _mesh),
                           ("largest_step", _largest), ("step_control", _control)):
            figure = make(data["cases"])
            if figure is not None:
                _save(figure, folder / f"{name}.png")
                made.append(folder / f"{name}.png")
    return made


def _save(figure: Any, path: Path) -> None:
    """Write a picture with 128 colours, which takes a third of the space."""
    from PIL import Image
    figure.savefig(path)
    with Image.open(path) as picture:
        small = picture.convert("RGB").quantize(128)
    small.save(path, optimize=True)


def _grid(count: int, columns: int, size: tuple[float, float]) -> tuple[Any, list[Any]]:
    from matplotlib.figure import Figure
    columns = min(columns, count)
    rows = math.ceil(count / columns)
    figure = Figure(figsize=(max(6.0, columns * size[0]), rows * size[1] + 0.6), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).flat)
    for spare in axes[count:]:
        spare.set_axis_off()
    return figure, axes[:count]


def _with(cases: Numbers, kind: str, has: Callable[[Numbers], bool] = bool) -> list[tuple[str, Numbers]]:
    """(title, numbers) of all scenes that have this measurement, by letter."""
    found = [(name, case[kind]) for name, case in cases.items() if kind in case and has(case[kind])]
    letters = {name: cases[name]["drift"]["facts"]["letter"] if "drift" in cases[name] else "" for name, _ in found}
    return [(f"({letters[name]}) {name}" if letters[name] else name, x) for name, x in sorted(found, key=lambda x: letters[x[0]])]


def _legend(figure: Any, axes: Iterable[Any]) -> None:
    """One legend for all panels, below them, as wide as the figure allows."""
    entries: dict[str, Any] = {}
    for panel in axes:
        for handle, label in zip(*panel.get_legend_handles_labels()):
            entries.setdefault(label, handle)
    columns = max(1, int(figure.get_figwidth() / 2.0))
    figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=columns)


def _title(figure: Any, text: str) -> None:
    """Title of the figure, broken into lines that fit."""
    figure.suptitle("\n".join(textwrap.wrap(text, int(12.5 * figure.get_figwidth()))), fontsize=11)


def _few_ticks(panel: Any) -> None:
    """A logarithmic axis with labels at powers of ten only."""
    from matplotlib.ticker import LogLocator, NullFormatter
    panel.xaxis.set_major_locator(LogLocator(numticks=6))
    panel.xaxis.set_minor_formatter(NullFormatter())


def _scenes(cases: Numbers) -> Any:
    import matplotlib as mpl
    found = _with(cases, "drift", lambda x: "shapes" in x)
    if not found:
        return None
    figure, axes = _grid(len(found), 5, (2.9, 2.6))
    colours = mpl.colormaps["viridis"]
    for panel, (title, numbers) in zip(axes, found):
        data = numbers["shapes"]
        for k in range(len(data["t"])):
            colour = colours(0.9 * k / max(len(data["t"]) - 1, 1))
            thin = len(data["beams"]) > 4
            for beam in data["beams"]:
                panel.plot(*np.array(beam[k]).T, color=colour, lw=0.5 if thin else 1.5)
            if data["dots"][k]:
                panel.plot(*np.array(data["dots"][k]).T, "o", color=colour, ms=2 if thin else 5, mec="white",
                           mew=0.0 if thin else 0.6)
        panel.set_aspect("equal", adjustable="datalim")
        panel.set(title=title, xlabel=f"{'xyz'[data['plane'][0]]} [m]", ylabel=f"{'xyz'[data['plane'][1]]} [m]")
    _title(figure, "The scenes at equal distances in time, dark to bright")
    return figure


def _energy(cases: Numbers) -> Any:
    found = _with(cases, "drift", lambda x: bool(x.get("methods")))
    if not found:
        return None
    figure, axes = _grid(len(found), 5, (2.9, 2.5))
    for panel, (title, numbers) in zip(axes, found):
        for key, run_ in numbers["methods"].items():
            # the largest so far: zeros of an oscillation say nothing
            values = np.maximum.accumulate(np.maximum(np.array(run_["energy"], dtype=float), 1e-17))
            panel.semilogy(run_["t"], values, color=COLOURS[key], label=METHODS[key].label)
            if run_["status"] != "done":
                panel.plot(run_["t"][-1], min(values[-1], 50.0), "x", color=COLOURS[key], ms=7, mew=2)
        panel.axhline(1e-11, color="0.4", lw=0.8, ls=":")
        panel.set(title=f"{title}\nh = {numbers['facts']['step']:g} s", ylim=(1e-17, 1e2), xlabel="t [s]")
        panel.set_ylabel("energy error")
    _legend(figure, axes)
    _title(figure, "Largest error of the energy so far over its scale, usual step (dotted: 1e-11; cross: the run failed)")
    return figure


def _forces(cases: Numbers) -> Any:
    found = _with(cases, "drift", lambda x: "force" in x["methods"].get("em2", {}))
    if not found:
        return None
    figure, axes = _grid(len(found), 4, (3.6, 2.5))
    for panel, (title, numbers) in zip(axes, found):
        bound = 3.0 * max(numbers["methods"]["em2"]["force"])
        for key in ("alpha00", "alpha09", "trapezoidal", "midpoint", "em2", "em4"):
            run_ = numbers["methods"].get(key)
            if run_ and run_.get("force"):
                force = np.array(_numbers(run_["force"]))
                panel.plot(run_["force_t"], np.clip(force, None, bound), color=COLOURS[key], label=METHODS[key].label,
                           lw=1.8 if key == "em2" else 1.0)
        panel.set(title=title, xlabel="t [s]", ylabel="|F| [N]", ylim=(0.0, None))
    _legend(figure, axes)
    _title(figure, "Contact force of the first slider over 100 neighbouring steps (cut at three times the conserving step)")
    return figure


def _numbers(values: list[float | None]) -> list[float]:
    """What JSON keeps as null is NaN, a gap in a line."""
    return [math.nan if x is None else x for x in values]


def _orders(cases: Numbers) -> Any:
    found = _with(cases, "orders")
    if not found:
        return None
    figure, axes = _grid(len(found), 5, (2.9, 2.7))
    for panel, (title, numbers) in zip(axes, found):
        for key, entry in numbers["methods"].items():
            error = _numbers(entry["position"]["error"])
            panel.loglog(entry["steps"], error, color=COLOURS[key], marker=MARKS[key], ms=3.5, label=METHODS[key].label)
        best = numbers["methods"].get("em2") or next(iter(numbers["methods"].values()))
        for order, key in ((2, "em2"), (4, "em4")):
            entry = numbers["methods"].get(key, best)
            h, e = np.array(entry["steps"]), entry["position"]["error"][-1]
            if e:
                panel.loglog(h, 0.5 * e * (h / h[-1]) ** order, ":", color="0.5", lw=1.0)
        panel.set(title=title, xlabel="h [s]", ylabel="error of positions / L")
        panel.set_ylim(1e-14, 1.0)
        _few_ticks(panel)
    _legend(figure, axes)
    _title(figure, "Error over the step size on one mesh (dotted: orders 2 and 4)")
    return figure


def _mesh(cases: Numbers) -> Any:
    found = [(f"{title}, {strain.replace('_', '-')}", x[strain]) for title, x in _with(cases, "mesh")
             for strain in ("green_lagrange", "simo_reissner") if strain in x]
    if not found:
        return None
    figure, axes = _grid(len(found), 4, (3.5, 2.8))
    marks = {"bspline 2, control": ("#c0392b", "o--"), "bspline 3, control": ("#e59866", "s--"),
             "bspline 2, greville": ("#2e8b57", "o-"), "bspline 3, greville": ("#82c99b", "s-"),
             "lagrange 2": ("#0b5fa5", "^-"), "lagrange 3": ("#53a8e2", "v-"), "lagrange 4": ("#7d3c98", "D-")}
    for panel, (title, numbers) in zip(axes, found):
        for label, entry in numbers["families"].items():
            colour, style = marks[label]
            error = _numbers(entry["error"])
            panel.loglog(entry["nodes"], error, style, color=colour, ms=3.5, label=label)
        panel.set(title=title, xlabel="nodes of the beam", ylabel="error of positions / L")
    _legend(figure, axes)
    _title(figure, "Error over the number of nodes against one fine mesh of the same strains (dashed: the paper's triads)")
    return figure


def _largest(cases: Numbers) -> Any:
    found = _with(cases, "largest")
    if not found:
        return None
    from matplotlib.figure import Figure
    figure = Figure(figsize=(12.5, 4.4), layout="constrained")
    axes = figure.subplots()
    keys = [key for key in METHODS if any(key in x for _, x in found)]
    width = 0.8 / len(keys)
    for j, key in enumerate(keys):
        for k, (_, numbers) in enumerate(found):
            entry = numbers.get(key)
            if entry is None:
                continue
            x = k + (j - 0.5 * (len(keys) - 1)) * width
            label = METHODS[key].label if k == 0 else None
            reached = entry["survived"]["step"]
            axes.bar(x, (reached or entry["bottom"]) / entry["top"], width, bottom=1e-5, color=COLOURS[key], label=label,
                     alpha=1.0 if reached else 0.15)
            if entry["strict"]["step"]:
                axes.plot(x, entry["strict"]["step"] / entry["top"], "_", color="black", ms=8, mew=1.5)
    axes.set_yscale("log")
    axes.set_ylim(1e-4, 2.0)
    axes.set_xticks(range(len(found)), [title.replace(") ", ")\n").replace("_on_", "\non_") for title, _ in found])
    axes.set_ylabel("step / (span / 5)")
    axes.set_title("Largest step that survives the whole span (black line: energy error below 10 %; pale: none tried survives)")
    _legend(figure, [axes])
    return figure


def _control(cases: Numbers) -> Any:
    found = _with(cases, "control")
    if not found:
        return None
    from matplotlib.figure import Figure
    figure = Figure(figsize=(2.9 * len(found), 5.0), layout="constrained")
    panels = figure.subplots(2, len(found), squeeze=False)
    for k, (title, numbers) in enumerate(found):
        upper, lower = panels[:, k]
        tolerances = sorted({r["tolerance"] for r in numbers["runs"]}, reverse=True)
        for r in numbers["runs"]:
            shade = tolerances.index(r["tolerance"]) / max(len(tolerances), 2)
            colour = (("Blues", "Reds")[r["order"] == 4], 0.9 - 0.6 * shade)
            import matplotlib as mpl
            colour = mpl.colormaps[colour[0]](colour[1])
            if r["tolerance"] in (tolerances[0], tolerances[-1]):
                upper.semilogy(r["t"], r["h"], color=colour, label=f"order {r['order']}, tolerance {r['tolerance']:g}")
            errors = [e for e in r["local_errors"] if e]
            lower.loglog([r["tolerance"]] * len(errors), errors, ".", color=colour, alpha=0.7)
        lower.loglog(tolerances, tolerances, "-", color="0.4", lw=1.0)
        upper.set(title=title, xlabel="t [s]", ylabel="step [s]")
        lower.set(xlabel="tolerance", ylabel="true local error / L")
    _legend(figure, panels[0])
    _title(figure, "Step control: the steps taken, and the true local error of sampled steps (line: equal to the tolerance)")
    return figure
