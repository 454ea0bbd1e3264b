"""Pictures of error against run time, drawn from the stored numbers, and the Pareto fronts in them."""
from __future__ import annotations

import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

Numbers = dict[str, Any]
Front = list[tuple[float, float]]
COLOURS = {"em2": "#0b5fa5", "em4": "#53a8e2", "midpoint": "#1d6b3d", "midpoint4": "#6cc08b", "trapezoidal": "#c0392b",
           "alpha09": "#7d3c98", "alpha05": "#d68910", "alpha00": "#7f8c8d"}
MARKS = {"em2": "o", "em4": "s", "midpoint": "^", "midpoint4": "<", "trapezoidal": "v", "alpha09": "D", "alpha05": "P",
         "alpha00": "X"}
DEGREES = {1: "#b8860b", 2: "#e8743b", 3: "#c2185b", 4: "#6a1b9a", 5: "#1565c0", 6: "#00838f"}
LINES = {"nodes": "-", "own": "-.", "greville": "--", "control": ":"}
DEFAULT = "#d00000"
# errors above are not drawn
USELESS = 0.2
STYLE = {"font.size": 9, "axes.grid": True, "grid.color": "0.92", "axes.axisbelow": True, "axes.spines.top": False,
         "axes.spines.right": False, "axes.titlesize": 10, "legend.frameon": False, "figure.dpi": 110, "lines.linewidth": 1.2}


# ------------------------------------------------------------------------------------------------------------------- fronts
def column(data: Numbers, rows: list[list[Any]], name: str) -> list[Any]:
    """One column of measured rows."""
    k = data["fields"].index(name)
    return [row[k] for row in rows]


def busy(data: Numbers) -> float:
    """Share of the wall time of all timed runs that the processor worked for them."""
    rows = [r for s in data["scenes"].values() for e in [*s["families"], *s["methods"]["families"].values()] for r in e["rows"]]
    return float(sum(column(data, rows, "cpu"))) / max(float(sum(column(data, rows, "seconds"))), 1e-300)


def clock(data: Numbers) -> str:
    """Wall time where the machine was quiet, processor time where other work slowed the runs down; asked for once."""
    if "clock" not in data:
        data["clock"] = "seconds" if busy(data) > 0.9 else "cpu"
    return str(data["clock"])


def points(data: Numbers, rows: list[list[Any]], error: str) -> Front:
    """(seconds, error) of all rows that have both."""
    return [(t, e) for t, e in zip(column(data, rows, clock(data)), column(data, rows, error)) if t and e]


def front(found: Iterable[tuple[float, float]]) -> Front:
    """Pareto front: points that no other point beats in both, the fastest first."""
    out: Front = []
    for t, e in sorted(found):
        if not out or e < out[-1][1]:
            out.append((t, e))
    return out


def style_of(family: Numbers) -> str:
    """Which line a discretisation has: by its triads, or by the curve of its sliders."""
    return "own" if family["curve"] == "own" else family["directors"] or "nodes"


def label(family: Numbers) -> str:
    """For people, without the order."""
    extra = {"nodes": "", "own": ", own curve"}.get(style_of(family), f", {family['directors']}")
    return f"{family['interpolation']} {family['degree']}{extra}"


def is_default(data: Numbers, family: Numbers, order: bool = True) -> bool:
    """Whether this is what the package does unless told otherwise."""
    d = data["defaults"]
    same = all(family[key] == d[key] for key in ("strain", "interpolation", "degree"))
    same = same and (family["directors"] in (None, d["directors"])) and family["curve"] in (None, d["curve"])
    return same and (not order or family["order"] == d["order"])


def default_text(data: Numbers) -> str:
    """The defaults in a few words."""
    d = data["defaults"]
    return f"{d['interpolation']} {d['degree']}, order {d['order']}, slider curve {d['curve']}, {d['strain']}"


def default_method(data: Numbers) -> str:
    """Key of the default method in the comparison of methods."""
    method, order = data["defaults"]["method"], data["defaults"]["order"]
    keys = {("energy_momentum", 2): "em2", ("energy_momentum", 4): "em4", ("midpoint", 4): "midpoint4"}
    return keys.get((method, order), method)


# ----------------------------------------------------------------------------------------------------------------- pictures
def draw(data: Numbers, folder: Path) -> list[Path]:
    """Draw all pictures."""
    import matplotlib as mpl
    mpl.use("Agg")
    folder.mkdir(parents=True, exist_ok=True)
    made = []
    with mpl.rc_context(STYLE):
        for name, make in (("methods", _methods), ("meshes", _meshes), ("paper", _paper), ("forces", _forces)):
            figure = make(data)
            path = folder / f"work_precision_{name}.png"
            _save(figure, path)
            made.append(path)
    return made


def _save(figure: Any, path: Path) -> None:
    """As a PNG with a palette, a third of the size."""
    from PIL import Image
    memory = io.BytesIO()
    figure.savefig(memory, format="png", bbox_inches="tight")
    Image.open(memory).convert("RGB").quantize(128).save(path, optimize=True)


def _figure(rows: int, columns: int, height: float, title: str) -> tuple[Any, Any]:
    from matplotlib.figure import Figure
    figure = Figure(figsize=(4.1 * columns, height * rows + 0.7), layout="constrained")
    figure.suptitle(title, fontsize=11, fontweight="bold")
    return figure, figure.subplots(rows, columns, squeeze=False)


def _axes(ax: Any, data: Numbers, title: str, ylabel: str) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter
    xlabel = {"seconds": "run time, s", "cpu": "run time (processor), s"}[clock(data)]
    ax.set(xscale="log", yscale="log", title=title, xlabel=xlabel, ylabel=ylabel)
    # only powers of ten fit
    ax.minorticks_off()
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0,)))
        axis.set_minor_formatter(NullFormatter())


def _draw_front(ax: Any, found: Front, name: str = "Pareto front") -> None:
    line = front(found)
    if line:
        ax.plot(*zip(*line), color="0.15", lw=6.0, alpha=0.22, solid_capstyle="round", zorder=1.5, label=name)


def _shade(ax: Any, level: float | None, text: str) -> None:
    """Errors that the reference cannot tell."""
    if level:
        ax.axhspan(1e-30, level, color="0.93", zorder=0.4, lw=0)
        ax.text(0.99, level, text, ha="right", va="bottom", fontsize=7, color="0.45", transform=ax.get_yaxis_transform())


def _limits(ax: Any, found: Front, floor: float | None, top: float = 1.0) -> None:
    """Everything in sight, without the depths of the shaded part."""
    low = min([e for _, e in found] + ([floor] if floor else []))
    high = min(max(e for _, e in found), top)
    ax.set_ylim(low * 0.3, high * 3.0)


def _method_lines(ax: Any, data: Numbers, scene: Numbers, error: str) -> Front:
    chosen, everything = default_method(data), []
    for key, entry in scene["methods"]["families"].items():
        found = points(data, entry["rows"], error)
        everything += found
        if found:
            mine = key == chosen
            ax.plot(*zip(*sorted(found)), color=DEFAULT if mine else COLOURS[key], marker=MARKS[key], ms=4.5,
                    lw=2.2 if mine else 1.1, zorder=4 if mine else 3, label=entry["label"] + (" (default)" if mine else ""))
    _draw_front(ax, everything)
    return everything


def _method_title(data: Numbers) -> str:
    return f"default method, set from this picture: {data['defaults']['method']}, order {data['defaults']['order']}"


def _methods(data: Numbers) -> Any:
    """Position error of all methods on one mesh."""
    scenes = data["scenes"]
    figure, axes = _figure(1, len(scenes), 3.7, f"Error of time stepping against run time; {_method_title(data)}")
    for ax, (name, scene) in zip(axes[0], scenes.items()):
        methods = scene["methods"]
        _axes(ax, data, f"{name}: {methods['mesh']}", "position error / length")
        found = _method_lines(ax, data, scene, "position")
        space, floor = methods["space"]["position"], methods["uncertainty"]["position"]
        ax.axhline(space, color="0.4", ls=":", lw=1.0)
        ax.text(0.01, space, "error of space of this mesh", fontsize=7, color="0.35", va="bottom",
                transform=ax.get_yaxis_transform())
        _shade(ax, floor, "uncertainty of the reference")
        _limits(ax, found, floor)
    figure.legend(*axes[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize=8)
    return figure


def _family_lines(ax: Any, data: Numbers, families: list[Numbers], by_order: bool = False) -> None:
    """Every family by its own front; points behind it stay away."""
    for family in families:
        line = front(_all_points(data, [family]))
        if not line:
            continue
        mine = is_default(data, family)
        look = LINES[style_of(family)]
        colour = DEFAULT if mine else DEGREES[family["degree"]]
        fill = "none" if by_order and family["order"] == 4 else colour
        ax.plot(*zip(*line), look, color=colour, marker="*" if mine else "so"[family["order"] == 4 or not by_order],
                ms=8 if mine else 3, mfc=fill, lw=2.2 if mine else 1.2 if look == "-" else 0.9,
                alpha=1.0 if mine or look == "-" else 0.75, zorder=4 if mine else 3,
                label=label(family) + (f", order {family['order']}" if by_order else "") + (" (default)" if mine else ""))


def _all_points(data: Numbers, families: list[Numbers], error: str = "position") -> Front:
    """Points of families that are of any use."""
    return [p for family in families for p in points(data, family["rows"], error) if p[1] < USELESS]


def _meshes(data: Numbers) -> Any:
    """All discretisations with the default strains, orders 2 and 4."""
    scenes, strain = data["scenes"], data["defaults"]["strain"]
    figure, axes = _figure(2, len(scenes), 3.6, f"Error against run time; default of the package, set from this picture: "
                           f"{default_text(data)}")
    legend: dict[str, Any] = {}
    for j, (name, scene) in enumerate(scenes.items()):
        mine = [f for f in scene["families"] if f["strain"] == strain]
        found = _all_points(data, mine)
        floor = scene["references"][strain]["uncertainty"]["position"]
        for i, order in enumerate((2, 4)):
            ax = axes[i][j]
            _axes(ax, data, f"{name}, order {order}", "position error / length")
            _draw_front(ax, found, "Pareto front of both orders")
            _family_lines(ax, data, [f for f in mine if f["order"] == order])
            _shade(ax, floor, "uncertainty of the reference")
            _limits(ax, found, floor)
            ax.set_xlim(min(t for t, _ in found) * 0.7, max(t for t, _ in found) * 1.4)
            for handle, text in zip(*ax.get_legend_handles_labels()):
                legend.setdefault(text, handle)
    names = sorted(legend, key=lambda text: ("front" not in text, "bspline" in text, "own" in text, "control" in text, text))
    figure.legend([legend[text] for text in names], names, loc="outside lower center", ncols=6, fontsize=8)
    return figure


def _paper(data: Numbers) -> Any:
    """The paper's own strains and splines, beside better interpolations of the same strains."""
    scenes = data["scenes"]
    figure, axes = _figure(1, len(scenes), 3.9, "Green-Lagrange strains: the paper's splines (control) and better interpolations")
    legend: dict[str, Any] = {}
    for ax, (name, scene) in zip(axes[0], scenes.items()):
        mine = [f for f in scene["families"] if f["strain"] == "green_lagrange"]
        found, floor = _all_points(data, mine), scene["references"]["green_lagrange"]["uncertainty"]["position"]
        _axes(ax, data, name, "position error / length")
        _draw_front(ax, found)
        _family_lines(ax, data, mine, by_order=True)
        _shade(ax, floor, "uncertainty of the reference")
        _limits(ax, found, floor)
        for handle, text in zip(*ax.get_legend_handles_labels()):
            legend.setdefault(text, handle)
    figure.legend(legend.values(), legend.keys(), loc="outside lower center", ncols=5, fontsize=8)
    return figure


def _forces(data: Numbers) -> Any:
    """Energy and contact force of all methods."""
    scenes = data["scenes"]
    figure, axes = _figure(3, len(scenes), 3.2, f"Energy and contact force against run time; {_method_title(data)}")
    for j, (name, scene) in enumerate(scenes.items()):
        titles = {"energy": ("energy", "largest energy error / energy"),
                  "force": ("contact force at instants", "force error / peak"),
                  "mean_force": ("mean contact force between instants", "force error / peak")}
        for ax, (key, (title, ylabel)) in zip(axes[:, j], titles.items()):
            if key != "energy" and not scene["sliders"]:
                ax.axis("off")
                continue
            _axes(ax, data, f"{name}: {title}", ylabel)
            found = _method_lines(ax, data, scene, key)
            if key != "energy":
                floor = scene["methods"]["uncertainty"][key]
                _shade(ax, floor, "uncertainty of the reference")
                space = scene["methods"]["space"][key]
                ax.axhline(space, color="0.4", ls=":", lw=1.0)
                _limits(ax, found, floor)
    figure.legend(*axes[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize=8)
    return figure
