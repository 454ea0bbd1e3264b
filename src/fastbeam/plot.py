"""Pictures of a result. Every function returns a matplotlib Figure that the caller saves: `plot_shapes(run).savefig("run.png")`.

No window is opened and no display is needed; matplotlib is imported when the first picture is drawn.
"""
from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from typing import TYPE_CHECKING, Any, ParamSpec

import numpy as np

from .arguments import Count, Instance, Number, Word, checked
from .errors import BackendError, SceneError
from .mode_shapes import Modes
from .result import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure

P = ParamSpec("P")
PLANES = {"xy": (0, 1), "xz": (0, 2), "yz": (1, 2), "3d": (0, 1, 2)}
# a scene is drawn flat when its smallest extent is below this part of the largest
FLAT = 1e-3
# beyond this ratio of the extents axes have different scales: with equal ones nothing is left to see of a long shallow scene
LONGEST = 8.0
# a smaller part of the largest extent is no shape but round-off or a straight line
STRAIGHT = 1e-5
# names in a legend; of more than these a few stand for all
MOST_NAMES, FEW_NAMES = 24, 8
# relative deviations below this are drawn on it (logarithmic axis)
FLOOR = 1e-17
STYLE = {"font.size": 10.0, "axes.titlesize": 11.0, "axes.labelsize": 10.0, "legend.fontsize": 8.5, "axes.spines.top": False,
         "axes.spines.right": False, "axes.grid": True, "grid.color": "0.9", "grid.linewidth": 0.7, "lines.linewidth": 1.6,
         "axes.axisbelow": True, "legend.frameon": False, "axes.titleweight": "bold", "savefig.dpi": 150}
# distinguishable for colour-blind readers (Okabe and Ito)
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
ENERGIES = (("kinetic", COLOURS[0]), ("strain", COLOURS[1]), ("gravity", COLOURS[2]), ("potential", COLOURS[3]),
            ("total", "black"))
SOME_MODES = Instance(Modes, "Modes", "what modes returns")
A_RESULT = Instance(Result, "a Result", "what simulate, solve_static and load_result return")
PLANE, SHAPES = Word(("auto", *PLANES)), Count(most=1000)
DRIFTS = (("total", "total energy", "black"), ("balance", "energy balance", COLOURS[3]),
          ("lin_mom", "linear momentum", COLOURS[0]),
          ("ang_mom", "angular momentum", COLOURS[1]), ("gap", "gap", COLOURS[2]))


def _styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Draw with the style of this file and leave the caller's settings alone."""
    @wraps(draw)
    def drawn(*args: P.args, **options: P.kwargs) -> Figure:
        try:
            import matplotlib as mpl
        except ImportError as error:
            raise BackendError("pictures need matplotlib: pip install matplotlib") from error
        with mpl.rc_context(STYLE):
            return draw(*args, **options)
    return drawn


@checked(result=A_RESULT, plane=PLANE, n=SHAPES, cmap=Word())
@_styled
def plot_shapes(result: Result, plane: str = "auto", n: int = 8, cmap: str = "viridis") -> Figure:
    """Deformed shapes at n snapshots coloured by time; bodies, point masses and slider points as dots, slider paths as lines.

    Lagrange beams are drawn as the curves they are, those of nets through their nodes. B-spline beams are drawn through their
    control points, which lie close to the curve but not on it. Of a static result the colour is the load factor.

    Parameters
    ----------
    result : Result
        With snapshots and names['beams'].
    plane : str
        'xy', 'xz', 'yz', '3d', or 'auto': the plane of a flat scene, else '3d'.
    n : int
        Number of shapes, spread evenly over the snapshots.
    cmap : str
        Colour map of time.

    Raises
    ------
    SceneError
        No snapshots were recorded, or the plane does not exist.
    """
    figure = _figure((7.5, 5.5))
    _draw_shapes(figure, 111, result, plane, n, cmap)
    return figure


@checked(result=A_RESULT)
@_styled
def plot_invariants(result: Result) -> Figure:
    """Energies over time (J), and relative deviation of energy, momenta and gap from the start on a logarithmic axis.

    Raises
    ------
    SceneError
        The result holds neither energies nor momenta.
    """
    _need_any(result, ("kinetic", "potential", "total", "lin_mom", "ang_mom"), "energies and momenta")
    figure = _figure((7.5, 6.0))
    upper, lower = figure.subplots(2, 1, sharex=True)
    _draw_energies(upper, result)
    _draw_drifts(lower, result)
    upper.label_outer()
    return figure


@checked(result=A_RESULT, slider=Word())
@_styled
def plot_slider(result: Result, slider: str | None = None) -> Figure:
    """Sliding coordinate s(t) (m), components of the contact force (N), and the path of the slider point in space (m).

    Parameters
    ----------
    result : Result
        With 's_slide' and 'contact_force'.
    slider : str, optional
        Name; the first one when left out.

    Raises
    ------
    SceneError
        There is no such slider.
    """
    name = _slider_name(result, slider)
    figure = _figure((9.5, 5.2))
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.1))
    _draw_coordinates(figure.add_subplot(grid[0, 0]), result, [name])
    _draw_forces(figure.add_subplot(grid[1, 0]), result, [name])
    times, path = _slider_path(result, name)
    axes = _space_axes(figure, grid[:, 1], path.reshape(-1, 3), "auto")
    if len(path):
        pick = axes.axes_of_space
        axes.plot(*path[:, pick].T, color="0.6", lw=1.0)
        dots = axes.scatter(*path[:, pick].T, c=times, cmap="viridis", s=8, **({"depthshade": False} if len(pick) == 3 else {}))
        _time_bar(figure, axes, dots)
        axes.plot(*path[:1, pick].T, "o", color="black", ms=6, label="start")
        axes.legend(loc="best")
    if len(axes.axes_of_space) == 3:
        # the layout does not see the labels of the z axis and of the bar
        figure.get_layout_engine().set(rect=(0.0, 0.04, 0.94, 0.96))
    _title(axes, f"Path of '{name}'" if len(path) else "Path: not recorded")
    return figure


@checked(result=A_RESULT, plane=PLANE, n=SHAPES)
@_styled
def plot_overview(result: Result, plane: str = "auto", n: int = 8) -> Figure:
    """One figure with shapes, energies, deviations and, where there are sliders, s(t) and contact forces.

    Parameters
    ----------
    result : Result
        With snapshots and energies.
    plane, n
        See `plot_shapes`.
    """
    sliders = _slider_names(result)
    panels = 4 if sliders else 2
    low, high = _bounds(result.phi.reshape(-1, 3))
    flat = PLANES[_flat_plane(high - low) if plane == "auto" else plane]
    if len(flat) == 2 and high[flat[0]] - low[flat[0]] > 1.6 * (high[flat[1]] - low[flat[1]]):
        # a wide scene spans the figure, the other panels stand below it
        rows = panels // 2
        figure = _figure((11.0, 4.2 + 3.0 * rows))
        grid = figure.add_gridspec(1 + rows, 2, height_ratios=(1.3, *[1] * rows))
        shapes, places = grid[0, :], [grid[1 + i, j] for j in range(2) for i in range(rows)]
    else:
        figure = _figure((13.5, 7.0) if sliders else (11.0, 6.5))
        grid = figure.add_gridspec(2, 1 + panels // 2, width_ratios=(1.7, *[1] * (panels // 2)))
        shapes, places = grid[:, 0], [grid[i, 1 + j] for j in range(panels // 2) for i in range(2)]
    _draw_shapes(figure, shapes, result, plane, n, "viridis")
    _draw_energies(figure.add_subplot(places[0]), result)
    _draw_drifts(figure.add_subplot(places[1]), result)
    if sliders:
        _draw_coordinates(figure.add_subplot(places[2]), result, sliders)
        _draw_forces(figure.add_subplot(places[3]), result, sliders)
    title = " - ".join(str(result.info[key]) for key in ("scene", "method") if result.info.get(key))
    if title:
        figure.suptitle(title, fontsize=13, fontweight="bold")
    return figure


@checked(modes=SOME_MODES, plane=PLANE, n=Count(most=48), first=Count(0), amplitude=Number(above=0.0, most=10.0))
@_styled
def plot_modes(modes: Modes, plane: str = "auto", n: int = 6, first: int = 0, amplitude: float = 0.12) -> Figure:
    """n modes, one in each panel: the shape in colour, the opposite one dashed, the equilibrium in grey.

    Parameters
    ----------
    modes : Modes
    plane : str
        'xy', 'xz', 'yz', '3d', or 'auto': the plane that scene and drawn modes lie in, else '3d'.
    n, first : int
        How many modes, and the first of them, counted from 0.
    amplitude : float
        Largest displacement drawn, as a share of the size of the scene.

    Raises
    ------
    SceneError
        There is no mode `first`.
    """
    picks = range(first, min(first + n, len(modes)))
    if not picks:
        raise SceneError(f"first: mode {first} does not exist, there are {len(modes)}, counted from 0")
    low, high = _bounds(modes.positions)
    size = amplitude * (float(np.max(high - low)) or 1.0)
    shapes = [modes.positions + sign * size * modes.displacements[k] for k in picks for sign in (1.0, -1.0)]
    columns = min(3, len(picks))
    rows = -(-len(picks) // columns)
    figure = _figure((4.2 * columns, 3.4 * rows))
    lines = _Lines(modes.names)
    everything = np.concatenate([modes.positions, *shapes])
    for j, k in enumerate(picks):
        axes = _space_axes(figure, (rows, columns, j + 1), everything, plane)
        lines.draw(axes, modes.positions, "0.75", zorder=1)
        colour = COLOURS[1] if modes.growth[k] else COLOURS[0]
        lines.draw(axes, shapes[2 * j + 1], colour, ls="--", alpha=0.4, zorder=2)
        lines.draw(axes, shapes[2 * j], colour, zorder=3)
        what = f"grows, {modes.growth[k]:.4g} 1/s" if modes.growth[k] else f"{modes.frequencies[k]:.5g} Hz"
        _title(axes, f"{k}: {what if modes.squared[k] else 'free'}")
    return figure


def _draw_shapes(figure: Figure, place: Any, result: Result, plane: str, n: int, cmap: str) -> None:
    import matplotlib as mpl
    if cmap not in mpl.colormaps:
        raise SceneError(f"cmap {cmap!r:.60} does not exist: choose a colour map of matplotlib, such as 'viridis' or 'plasma'")
    if not len(result.t_snap):
        raise SceneError("the result holds no snapshots: record some to draw shapes")
    picks = np.unique(np.linspace(0, len(result.t_snap) - 1, n).round().astype(int))
    sliders = {name: _slider_path(result, name) for name in _slider_names(result)}
    everything = np.concatenate([result.phi.reshape(-1, 3), *(path for _, path in sliders.values())])
    axes = _space_axes(figure, place, everything, plane)
    space = axes.axes_of_space
    scale = mpl.colors.Normalize(result.t_snap[picks[0]], max(result.t_snap[picks[-1]], result.t_snap[picks[0]] + 1e-300))
    # the bright end of the map is hard to see on white
    colours = mpl.colors.LinearSegmentedColormap.from_list("time", mpl.colormaps[cmap](np.linspace(0.0, 0.92, 256)))
    lines = _Lines(result.names)
    for _, path in sliders.values():
        if len(path):
            axes.plot(*path[:, space].T, color="0.65", lw=0.9, ls="--", zorder=1)
    for k in picks:
        colour, shape = colours(scale(result.t_snap[k])), result.phi[k]
        more = [_position_at(times, path, result.t_snap[k]) for times, path in sliders.values() if len(path)]
        lines.draw(axes, shape, colour, more)
    mappable = mpl.cm.ScalarMappable(norm=scale, cmap=colours)
    label = {"static": "load factor [-]", "path": "length of the path [-]"}.get(str(result.info.get("method")), "time [s]")
    _time_bar(figure, axes, mappable, label)
    _title(axes, "Deformed shapes")


class _Lines:
    """Draws shapes of a scene: beams as the curves that they are, nets through their nodes, bodies and masses as dots."""

    def __init__(self, names: Mapping[str, Any]) -> None:
        self._lumps = [entry["node"] for kind in ("bodies", "masses") for entry in names.get(kind, [])]
        self._beams = [(entry["first"], entry["first"] + entry["count"], _sampling(entry)) for entry in names.get("beams", [])]
        self._nets = names.get("nets", [])

    def draw(self, axes: Any, shape: np.ndarray, colour: Any, more: Sequence[np.ndarray] = (), **style: Any) -> None:
        """One shape [N, 3]; more: points [3] that are drawn as dots, too."""
        space = axes.axes_of_space
        for net in self._nets:
            # one line for all beams, with gaps
            points = np.insert(shape[net["first"]:net["first"] + net["count"]], net["starts"][1:], np.nan, axis=0)
            axes.plot(*points[:, space].T, color=colour, lw=1.0, **style)
        for first, last, sampling in self._beams or [(0, len(shape), None)] * (not self._nets):
            points = shape[first:last] if sampling is None else sampling @ shape[first:last]
            axes.plot(*points[:, space].T, color=colour, lw=1.8, solid_capstyle="round", **style)
        for dot in [*(shape[node] for node in self._lumps), *more]:
            axes.plot(*dot[space, None], "o", color=colour, ms=7, mec="white", mew=0.8, **{"zorder": 4, **style})


def _sampling(beam: dict[str, Any]) -> np.ndarray | None:
    """Matrix [m, nodes] from the nodes of a Lagrange beam to points on its curve; None where the nodes have to do."""
    ends, s = beam.get("element_ends", []), np.asarray(beam.get("s", []), dtype=float)
    if len(s) != beam["count"] or len(ends) < 2:
        return None
    ends = np.asarray(ends) - beam["first"]
    degree = int(np.diff(ends).max())
    if degree == 1 or len(ends) > 200:
        return None
    rows = [np.eye(len(s))[:1]]
    for a, b in zip(ends[:-1], ends[1:], strict=True):
        x = s[a:b + 1]
        at = np.linspace(x[0], x[-1], 4 * (b - a) + 1)[1:]
        # Lagrange polynomials of the element's nodes
        block = np.zeros((len(at), len(s)))
        for i in range(len(x)):
            others = np.delete(x, i)
            block[:, a + i] = np.prod((at[:, None] - others) / (x[i] - others), axis=1)
        rows.append(block)
    return np.concatenate(rows)


def _draw_energies(axes: Any, result: Result) -> None:
    parts = {name: result.series.get(name) for name, _ in ENERGIES}
    # one potential needs no split; a split needs no sum
    both = all(parts[name] is not None and np.any(parts[name]) for name in ("strain", "gravity"))
    hidden = ("potential",) if both else ("strain", "gravity") if parts["potential"] is not None else ()
    for name, colour in ENERGIES:
        if parts[name] is not None and name not in hidden:
            axes.plot(result.t, parts[name], color=colour, label=name, lw=2.0 if name == "total" else 1.6)
    if both and parts["potential"] is not None:
        loads = parts["potential"] - parts["strain"] - parts["gravity"]
        # what is left of round-off is no load
        if np.nanmax(np.abs(loads), initial=0.0) > 1e-9 * np.nanmax(np.abs(parts["potential"]), initial=0.0):
            axes.plot(result.t, loads, color=COLOURS[3], label="loads", lw=1.6)
    _finish(axes, "Energies", "energy [J]")


def _draw_drifts(axes: Any, result: Result) -> None:
    top = 1e-12
    for name, label, colour in DRIFTS:
        x = result.series.get(name)
        if x is None or x.size == 0 or not (result.is_conserved(name) or name == "gap"):
            continue
        # the largest so far: the zigzag of round-off says nothing
        deviation = np.maximum.accumulate(np.maximum(result.deviation(name), FLOOR))
        if name == "gap" and not (result.info.get("scale") or {}).get("gap"):
            label += " [m]"
        axes.plot(result.t, deviation, color=colour, label=label, lw=1.1)
        top = max(top, 10.0 * float(np.nanmax(deviation, initial=0.0)))
    axes.axhline(np.finfo(float).eps, color="0.5", lw=0.9, ls=":", zorder=1, label="machine epsilon")
    axes.set_yscale("log")
    axes.set_ylim(FLOOR, 10.0 ** np.ceil(np.log10(top) + 1.0))
    _finish(axes, "Largest deviation so far", "relative deviation [-]", columns=2)


def _draw_coordinates(axes: Any, result: Result, names: list[str]) -> None:
    for name, colour in zip(names, _cycle(len(names)), strict=True):
        axes.plot(result.t, result.slider(name)["s"], color=colour, label=name)
    _finish(axes, "Sliding coordinate", "s [m]")


def _draw_forces(axes: Any, result: Result, names: list[str]) -> None:
    if len(names) == 1:
        force = result.slider(names[0])["force"]
        for i, label in enumerate(("x", "y", "z")):
            axes.plot(result.t, force[:, i], color=COLOURS[i], label=f"$F_{label}$", lw=1.3)
        _finish(axes, f"Contact force on '{names[0]}'", "force [N]")
        return
    for name, colour in zip(names, _cycle(len(names)), strict=True):
        axes.plot(result.t, np.linalg.norm(result.slider(name)["force"], axis=1), color=colour, label=name, lw=1.3)
    _finish(axes, "Contact force, magnitude", "|F| [N]")


def _finish(axes: Any, title: str, label: str, columns: int = 0) -> None:
    axes.set(title=title, xlabel="time [s]", ylabel=label)
    axes.margins(x=0.01)
    handles, labels = axes.get_legend_handles_labels()
    every = len(labels)
    if not every:
        return
    if every > MOST_NAMES:
        picks = np.linspace(0, every - 1, FEW_NAMES).round().astype(int)
        handles, labels = [handles[k] for k in picks], [labels[k] for k in picks]
    count = len(labels)
    columns = columns or min(count, 4)
    # room above the curves, so that the legend covers none
    if axes.get_yscale() == "linear":
        low, high = axes.get_ylim()
        rows = -(-count // columns) + (every > count)
        axes.set_ylim(low, high + (0.18 if rows <= 2 else 0.1 * rows) * (high - low))
    axes.legend(handles, labels, loc="upper left", ncols=columns, handlelength=1.0, columnspacing=0.9, handletextpad=0.4,
                borderaxespad=0.1, alignment="left", fontsize=None if count <= FEW_NAMES else 6.5,
                title=f"{count} of {every}, in order" if every > count else None, title_fontsize=7.5)


def _figure(size: tuple[float, float]) -> Figure:
    from matplotlib.figure import Figure
    return Figure(figsize=size, layout="constrained")


def _space_axes(figure: Figure, place: Any, points: np.ndarray, plane: str) -> Any:
    """Axes that show `points`, with equal aspect unless one extent in a plane is more than `LONGEST` times the other;
    .axes_of_space lists the coordinates drawn."""
    low, high = _bounds(points)
    extent = high - low
    space = list(PLANES[_flat_plane(extent) if plane == "auto" else plane])
    place = place if isinstance(place, tuple) else (place,)
    axes = figure.add_subplot(*place, **({"projection": "3d"} if len(space) == 3 else {}))
    axes.axes_of_space = space
    axes.set_xlabel(f"{'xyz'[space[0]]} [m]")
    axes.set_ylabel(f"{'xyz'[space[1]]} [m]")
    # a straight beam still gets a box that is a quarter as high as long
    half = np.maximum(0.54 * extent, (0.125 if len(space) == 2 else 0.2) * max(extent.max(), 1e-9))[space]
    middle = (0.5 * (low + high))[space]
    drawn = extent[space]
    if len(space) == 2 and STRAIGHT * drawn.max() < drawn.min() < drawn.max() / LONGEST:
        half = 0.54 * drawn
        small = int(np.argmin(drawn))
        (axes.set_xlabel, axes.set_ylabel)[small](f"{'xyz'[space[small]]} [m], other scale")
        axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
        axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
        return axes
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
    if len(space) == 2:
        axes.set_aspect("equal", adjustable="box")
        return axes
    from matplotlib.ticker import MaxNLocator
    axes.set_zlabel("z [m]")
    axes.set_zlim(middle[2] - half[2], middle[2] + half[2])
    axes.set_box_aspect(half, zoom=0.87)
    for axis, size in zip((axes.xaxis, axes.yaxis, axes.zaxis), half / half.max(), strict=True):
        axis.set_major_locator(MaxNLocator(nbins=max(2, round(5 * size))))
        axis.labelpad = 10.0 * size
        axis.set_pane_color((0.97, 0.97, 0.97, 1.0))
    return axes


def _title(axes: Any, text: str) -> None:
    """A title above the axes; those in space leave room above their box unless it is high."""
    flatness = 1.0 - _height(axes)
    axes.set_title(text, y=1.0 - 0.07 * flatness if flatness else None)


def _height(axes: Any) -> float:
    """Height of the box of axes in space over its width, at most 1; of flat axes 1."""
    if len(axes.axes_of_space) == 2:
        return 1.0
    width, depth, height = (high - low for low, high in (axes.get_xlim(), axes.get_ylim(), axes.get_zlim()))
    return min(1.0, height / max(width, depth))


def _time_bar(figure: Figure, axes: Any, mappable: Any, label: str = "time [s]") -> None:
    """Colour bar of time: as high as flat axes, below axes in space."""
    flat = len(axes.axes_of_space) == 2
    # the labels of a high box reach further down
    place = axes.inset_axes((1.02, 0.0, 0.02, 1.0) if flat else (0.15, -0.02 - 0.07 * _height(axes) ** 2, 0.7, 0.025))
    figure.colorbar(mappable, cax=place, label=label, orientation="vertical" if flat else "horizontal")


def _bounds(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest coordinates [3] of the finite points."""
    finite = points[np.isfinite(points).all(axis=1)]
    return (finite.min(axis=0), finite.max(axis=0)) if len(finite) else (np.zeros(3), np.zeros(3))


def _flat_plane(extent: np.ndarray) -> str:
    """Name of the plane with the two largest extents (xy before xz before yz when equal), or 3d."""
    if extent.min() > FLAT * extent.max():
        return "3d"
    # equal extents: the later coordinate is left out
    left_out = 2 - int(np.argmin(extent[::-1]))
    return {0: "yz", 1: "xz", 2: "xy"}[left_out]


def _slider_names(result: Result) -> list[str]:
    return list(result.names.get("sliders", [])) if "s_slide" in result.series else []


def _slider_name(result: Result, slider: str | None) -> str:
    names = _slider_names(result)
    if not names:
        raise SceneError("the result holds no slider: add a Slider to the scene and record 's_slide'")
    return names[0] if slider is None else slider


def _slider_path(result: Result, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Times [k] and positions [k, 3] of a slider point: its series, an observed point of that name, or its node in snapshots."""
    values = result.slider(name)
    if "position" in values:
        return result.t, values["position"]
    if name in result.names.get("points", []) and "points" in result.series:
        return result.t, result.point(name)
    nodes = result.names.get("slider_nodes", [])
    if nodes and len(result.t_snap):
        return result.t_snap, result.phi[:, nodes[result.names["sliders"].index(name)]]
    return np.zeros(0), np.zeros((0, 3))


def _position_at(times: np.ndarray, path: np.ndarray, t: float) -> np.ndarray:
    return np.array([np.interp(t, times, path[:, i]) for i in range(3)])


def _need_any(result: Result, names: tuple[str, ...], what: str) -> None:
    if not any(name in result.series for name in names):
        raise SceneError(f"the result holds no {what}: record at least one of {', '.join(names)}")


def _cycle(n: int) -> list[Any]:
    """n colours, all different."""
    import matplotlib as mpl
    return list(COLOURS[:n]) if n <= len(COLOURS) else list(mpl.colormaps["turbo"](np.linspace(0.03, 0.97, n)))
