"""Pictures of a result. Every function returns a matplotlib Figure that the caller saves: `plot_shapes(run).savefig("run.png")`.

No window is opened and no display is needed; matplotlib is imported when the first picture is drawn.
"""
from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fastbeam.interface.arguments import Count, Flag, Instance, Word, checked
from fastbeam.interface.errors import SceneError
from fastbeam.results.mode_shapes import SIZE, Motions, size_of
from fastbeam.results.plots.drawing import (
    A_RESULT,
    COLOURS,
    PLANE,
    PLANES,
    Shapes,
    as_text,
    bounds,
    flat_plane,
    new_figure,
    panel_figure,
    put_title,
    shapes_size,
    slider_names,
    slider_path,
    space_axes,
    styled,
    time_bar,
)
from fastbeam.results.responses import FrequencyResponse
from fastbeam.results.result import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# names in a legend; of more than these a few stand for all
MOST_NAMES, FEW_NAMES = 24, 8
# relative deviations below this are drawn on it (logarithmic axis)
FLOOR = 1e-17
ENERGIES = (("kinetic", COLOURS[0]), ("strain", COLOURS[1]), ("gravity", COLOURS[2]), ("potential", COLOURS[3]),
            ("total", "black"))
SHAPES = Count(most=1000)
SOME_MODES = Instance(Motions, "Modes", "what modes returns")
A_RESPONSE = Instance(FrequencyResponse, "a FrequencyResponse", "what frequency_response returns")
DRIFTS = (("total", "total energy", "black"), ("balance", "energy balance", COLOURS[3]),
          ("lin_mom", "linear momentum", COLOURS[0]),
          ("ang_mom", "angular momentum", COLOURS[1]), ("gap", "gap", COLOURS[2]))


@checked(result=A_RESULT, plane=PLANE, n=SHAPES, cmap=Word())
@styled
def plot_shapes(result: Result, plane: str = "auto", n: int = 8, cmap: str = "viridis") -> Figure:
    """Draw deformed shapes at n snapshots coloured by time; bodies as squares with their axes, point masses and slider points as
    dots, slider paths as lines.

    Beams are drawn as the curves they are, those of nets, and of scenes with more than 5000 nodes, through their nodes. Of a
    static result the colour is the load factor.

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
    shapes = Shapes(result)
    figure = new_figure(shapes_size(shapes.everything, plane))
    _draw_shapes(figure, 111, shapes, plane, n, cmap)
    return figure


@checked(result=A_RESULT)
@styled
def plot_invariants(result: Result) -> Figure:
    """Draw energies over time (J), and relative deviation of energy, momenta and gap from the start on a logarithmic axis.

    Raises
    ------
    SceneError
        The result holds neither energies nor momenta.
    """
    needed = "kinetic", "potential", "total", "lin_mom", "ang_mom"
    if not any(name in result.series for name in needed):
        raise SceneError(f"the result holds no energies and momenta: record at least one of {', '.join(needed)}")
    figure = new_figure((7.5, 6.0))
    upper, lower = figure.subplots(2, 1, sharex=True)
    _draw_energies(upper, result)
    _draw_drifts(lower, result)
    upper.label_outer()
    return figure


@checked(result=A_RESULT)
@styled
def plot_balance(result: Result) -> Figure:
    """Draw the change since the start of energies that parts store, take away and put in (J), see `Result.balance`, and the drift
    of their sum.

    Raises
    ------
    SceneError
        The run did not record energies.
    """
    parts = result.balance()
    total = parts.pop("sum")
    figure = new_figure((7.5, 6.5))
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
    for (name, x), colour in zip(parts.items(), _cycle(len(parts))):
        upper.plot(result.t, x - x[:1], color=colour, label=as_text(name))
    upper.plot(result.t, total - total[:1], color="black", label="sum", lw=2.0)
    _finish(upper, "Energy balance, change since the start", "energy [J]", columns=3)
    size = max(float(np.nanmax(np.abs(x), initial=0.0)) for x in parts.values()) or 1.0
    lower.plot(result.t, (total - total[:1]) / size, color="black", lw=1.1)
    _finish(lower, "Sum less its start, relative to the largest part", "deviation [-]")
    upper.label_outer()
    return figure


@checked(result=A_RESULT, slider=Word())
@styled
def plot_slider(result: Result, slider: str | None = None) -> Figure:
    """Draw the sliding coordinate s(t) (m), components of the contact force (N), and the path of the slider point in space (m).

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
    figure = new_figure((9.5, 5.2))
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.1))
    _draw_coordinates(figure.add_subplot(grid[0, 0]), result, [name])
    _draw_forces(figure.add_subplot(grid[1, 0]), result, [name])
    times, path = slider_path(result, name)
    axes = space_axes(figure, grid[:, 1], path.reshape(-1, 3), "auto")
    if len(path):
        pick = axes.axes_of_space
        axes.plot(*path[:, pick].T, color="0.6", lw=1.0)
        dots = axes.scatter(*path[:, pick].T, c=times, cmap="viridis", s=8, **({"depthshade": False} if len(pick) == 3 else {}))
        time_bar(figure, axes, dots)
        axes.plot(*path[:1, pick].T, "o", color="black", ms=6, label="start")
        axes.legend(loc="best")
    if len(axes.axes_of_space) == 3:
        # the layout does not see the labels of the z axis and of the bar
        figure.get_layout_engine().set(rect=(0.0, 0.04, 0.94, 0.96))
    put_title(axes, f"Path of '{as_text(name)}'" if len(path) else "Path: not recorded")
    return figure


@checked(result=A_RESULT, plane=PLANE, n=SHAPES)
@styled
def plot_overview(result: Result, plane: str = "auto", n: int = 8) -> Figure:
    """Draw one figure with shapes, energies, deviations and, where there are sliders, s(t) and contact forces.

    Parameters
    ----------
    result : Result
        With snapshots and energies.
    plane, n
        See `plot_shapes`.
    """
    sliders = slider_names(result)
    panels = 4 if sliders else 2
    shapes = Shapes(result)
    low, high = bounds(shapes.everything)
    flat = PLANES[flat_plane(high - low) if plane == "auto" else plane]
    if len(flat) == 2 and high[flat[0]] - low[flat[0]] > 1.6 * (high[flat[1]] - low[flat[1]]):
        # a wide scene spans the figure, the other panels stand below it
        rows = panels // 2
        figure = new_figure((11.0, 4.2 + 3.0 * rows))
        grid = figure.add_gridspec(1 + rows, 2, height_ratios=(1.3, *[1] * rows))
        place, places = grid[0, :], [grid[1 + i, j] for j in range(2) for i in range(rows)]
    else:
        figure = new_figure((13.5, 7.0) if sliders else (11.0, 6.5))
        grid = figure.add_gridspec(2, 1 + panels // 2, width_ratios=(1.7, *[1] * (panels // 2)))
        place, places = grid[:, 0], [grid[i, 1 + j] for j in range(panels // 2) for i in range(2)]
    _draw_shapes(figure, place, shapes, plane, n, "viridis")
    _draw_energies(figure.add_subplot(places[0]), result)
    _draw_drifts(figure.add_subplot(places[1]), result)
    if sliders:
        _draw_coordinates(figure.add_subplot(places[2]), result, sliders)
        _draw_forces(figure.add_subplot(places[3]), result, sliders)
    title = " - ".join(str(result.info[key]) for key in ("scene", "method") if result.info.get(key))
    if title:
        figure.suptitle(as_text(title), fontsize=13, fontweight="bold")
    return figure


@checked(modes=SOME_MODES, plane=PLANE, n=Count(most=48), first=Count(0), amplitude=SIZE)
@styled
def plot_modes(modes: Motions, plane: str = "auto", n: int = 6, first: int = 0, amplitude: float = 0.12) -> Figure:
    """Draw n modes, one in each panel: the shape in colour, the opposite one dashed, the equilibrium in grey. Of damped modes the
    shape at phase 0.

    Parameters
    ----------
    modes : Modes or DampedModes
    plane : str
        'xy', 'xz', 'yz', '3d', or 'auto': the plane that scene and drawn modes lie in, else '3d'.
    n, first : int
        Number of modes, and the first of them, counted from 0.
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
    size = amplitude * size_of(modes.positions)
    positions = [modes.positions]
    positions += [modes.positions + sign * size * np.real(modes.displacements[k]) for k in picks for sign in (-1.0, 1.0)]
    shapes = Shapes(Result(t=(), names=modes.names, t_snap=np.zeros(len(positions)), phi=positions,
                           directors=np.broadcast_to(modes.directors, (len(positions), *modes.directors.shape))))
    figure, panels = panel_figure(len(picks), shapes.everything, plane)
    for j, (k, axes) in enumerate(zip(picks, panels)):
        what, grows = modes._words(k)
        colour = COLOURS[1] if grows else COLOURS[0]
        shapes.draw(axes, 0, "0.75")
        for line in shapes.draw(axes, 1 + 2 * j, colour):
            line.set(linestyle="--" if line.get_marker() == "None" else "none", alpha=0.4)
        shapes.draw(axes, 2 + 2 * j, colour)
        put_title(axes, f"{k}: {what}")
    return figure


@checked(response=A_RESPONSE, component=Word(("x", "y", "z", "size")), log=Flag())
@styled
def plot_response(response: FrequencyResponse, component: str = "size", log: bool = True) -> Figure:
    """Draw amplitudes of all points over the frequency, and below them the phases of a component.

    Parameters
    ----------
    response : FrequencyResponse
        With points.
    component : {'size', 'x', 'y', 'z'}
        'size': the length of the vector of amplitudes, without phases.
    log : bool
        Amplitudes on a logarithmic axis.

    Raises
    ------
    SceneError
        The response has no points.
    """
    names = response.names["points"]
    if not names:
        raise SceneError("plot_response: the response has no points; give points= to frequency_response")
    figure = new_figure((7.5, 4.2 if component == "size" else 6.2))
    panels = 1 if component == "size" else 2
    axes = [figure.add_subplot(panels, 1, k + 1) for k in range(panels)]
    order = np.argsort(response.frequencies)
    f = response.frequencies[order]
    for name in names if len(names) <= MOST_NAMES else names[:FEW_NAMES]:
        x = response.point(name)[order]
        size = np.linalg.norm(x, axis=1) if component == "size" else np.abs(x[:, "xyz".index(component)])
        axes[0].plot(f, np.where(size > 0.0, size, np.nan) if log else size, label=as_text(name), lw=1.6)
        if panels == 2:
            axes[1].plot(f, np.degrees(np.angle(x[:, "xyz".index(component)])), label=as_text(name), lw=1.6)
    axes[0].set_ylabel(f"amplitude{'' if component == 'size' else ' ' + component} [m]")
    if log:
        axes[0].set_yscale("log")
    axes[0].legend()
    if panels == 2:
        axes[1].set_ylabel("phase [degrees]")
    axes[-1].set_xlabel("frequency [Hz]")
    axes[0].set_title(f"Response to {as_text(response.info['excitation'])}")
    return figure


def _draw_shapes(figure: Figure, place: Any, shapes: Shapes, plane: str, n: int, cmap: str) -> None:
    import matplotlib as mpl
    if cmap not in mpl.colormaps:
        raise SceneError(f"cmap {cmap!r:.60} does not exist: choose a colour map of matplotlib, such as 'viridis' or 'plasma'")
    result = shapes.result
    picks = np.unique(np.linspace(0, len(result.t_snap) - 1, n).round().astype(int))
    axes = space_axes(figure, place, shapes.everything, plane)
    scale = mpl.colors.Normalize(result.t_snap[picks[0]], max(result.t_snap[picks[-1]], result.t_snap[picks[0]] + 1e-300))
    # the bright end of the map is hard to see on white
    colours = mpl.colors.LinearSegmentedColormap.from_list("time", mpl.colormaps[cmap](np.linspace(0.0, 0.92, 256)))
    shapes.draw_paths(axes)
    for k in picks:
        shapes.draw(axes, k, colours(scale(result.t_snap[k])))
    mappable = mpl.cm.ScalarMappable(norm=scale, cmap=colours)
    label = {"static": "load factor [-]", "path": "length of the path [-]"}.get(str(result.info.get("method")), "time [s]")
    time_bar(figure, axes, mappable, label)
    put_title(axes, "Deformed shapes")


def _draw_energies(axes: Any, result: Result) -> None:
    parts = {name: result.series.get(name) for name, _ in ENERGIES}
    # one potential needs no split; a split needs no sum
    both = all(parts[name] is not None and np.any(parts[name]) for name in ("strain", "gravity"))
    hidden = ("potential",) if both else ("strain", "gravity") if parts["potential"] is not None else ()
    for name, colour in ENERGIES:
        if parts[name] is not None and name not in hidden:
            axes.plot(result.t, parts[name], color=colour, label=name, lw=2.0 if name == "total" else 1.6)
    if both and parts["potential"] is not None:
        stops = result.series["stop_energy"].sum(axis=1) if "stop_energy" in result.series else np.zeros(len(result.t))
        if np.any(stops):
            axes.plot(result.t, stops, color=COLOURS[4], label="stops", lw=1.6)
        loads = parts["potential"] - parts["strain"] - parts["gravity"] - stops
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
        axes.plot(result.t, result.slider(name)["s"], color=colour, label=as_text(name))
    _finish(axes, "Sliding coordinate", "s [m]")


def _draw_forces(axes: Any, result: Result, names: list[str]) -> None:
    if len(names) == 1:
        force = result.slider(names[0])["force"]
        for i, label in enumerate(("x", "y", "z")):
            axes.plot(result.t, force[:, i], color=COLOURS[i], label=f"$F_{label}$", lw=1.3)
        _finish(axes, f"Contact force on '{as_text(names[0])}'", "force [N]")
        return
    for name, colour in zip(names, _cycle(len(names)), strict=True):
        axes.plot(result.t, np.linalg.norm(result.slider(name)["force"], axis=1), color=colour, label=as_text(name), lw=1.3)
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


def _slider_name(result: Result, slider: str | None) -> str:
    names = slider_names(result)
    if not names:
        raise SceneError("the result holds no slider: add a Slider to the scene, and keep 'slider' among observe=")
    return names[0] if slider is None else slider


def _cycle(n: int) -> list[Any]:
    """Return n colours, all different."""
    import matplotlib as mpl
    return list(COLOURS[:n]) if n <= len(COLOURS) else list(mpl.colormaps["turbo"](np.linspace(0.03, 0.97, n)))
