"""Axes and shapes of pictures and animations: planes and scales, beams as lines, bodies, masses and sliders.

matplotlib is imported when something is drawn; no window is opened and no display is needed.
"""
from __future__ import annotations

import io
from collections.abc import Callable
from functools import partial, wraps
from typing import TYPE_CHECKING, Any, ParamSpec

import numpy as np

from fastbeam.interface.arguments import Instance, Word
from fastbeam.interface.errors import BackendError, SceneError
from fastbeam.results.lines import Lines
from fastbeam.results.result import Result

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
# nodes up to which beams are drawn as the curves they are and not by lines from node to node
SMALL = 5000
# part of the size of a scene that axes of a body are long
AXES = 0.06
STYLE = {"font.size": 10.0, "axes.titlesize": 11.0, "axes.labelsize": 10.0, "legend.fontsize": 8.5, "axes.spines.top": False,
         "axes.spines.right": False, "axes.grid": True, "grid.color": "0.9", "grid.linewidth": 0.7, "lines.linewidth": 1.6,
         "axes.axisbelow": True, "legend.frameon": False, "axes.titleweight": "bold", "savefig.dpi": 150}
# distinguishable for colour-blind readers (Okabe and Ito)
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
A_RESULT = Instance(Result, "a Result", "what simulate, solve_static and load_result return")
PLANE = Word(("auto", *PLANES))


class Shapes:
    """Lines and dots of the shapes of a result.

    result: with snapshots.
    paths: times [k] and positions [k, 3] of the point of every slider.
    Raises SceneError: it has none.
    """

    def __init__(self, result: Result) -> None:
        if not len(result.t_snap):
            raise SceneError("the result has no snapshots to draw; record some with simulate(..., output=Output(snapshots=100))")
        self.result = result
        n_nodes = result.phi.shape[1]
        self.lines = Lines(result.names, n_nodes, 4 if n_nodes <= SMALL else 1)
        self.width = 1.0 if result.names.get("nets") else 1.8
        self.bodies = [entry["node"] for entry in result.names.get("bodies", [])]
        # the drum of a winch is a length, no place, and points of its rope are a line
        masses = result.names.get("masses", [])
        self.masses = [entry["node"] for entry in masses if "drum" not in entry and "rope" not in entry]
        drums = [entry["node"] for entry in masses if "drum" in entry]
        self.paths = {name: slider_path(result, name) for name in slider_names(result)}
        places = np.delete(result.phi, drums, axis=1)
        self.everything = np.concatenate([places.reshape(-1, 3), *(path for _, path in self.paths.values())])
        low, high = bounds(self.everything)
        self.axis_length = AXES * float(np.max(high - low))
        if self.bodies:
            # their axes reach beyond their centres
            tips = result.phi[:, self.bodies][:, :, None] + self.axis_length * result.directors[:, self.bodies]
            if np.any(high - low <= FLAT * np.max(high - low)):
                # and do not make a flat scene deep
                tips = np.clip(tips, *np.where(high - low <= FLAT * np.max(high - low), (low, high), ((-np.inf,), (np.inf,))))
            self.everything = np.concatenate((self.everything, tips.reshape(-1, 3)))

    def beams(self, k: int) -> np.ndarray:
        """Return points [m, 3] of all beams at snapshot k, NaN between them."""
        return np.insert(self.lines.points(self.result.phi[k]), self.lines.starts[1:-1], np.nan, axis=0)

    def axes_of_bodies(self, k: int) -> np.ndarray:
        """Return points [m, 3] of lines from the centres of bodies along their axes at snapshot k, NaN between them."""
        center = self.result.phi[k, self.bodies][:, None]
        tips = center + self.axis_length * self.result.directors[k, self.bodies]
        return np.stack((np.broadcast_to(center, tips.shape), tips, np.full(tips.shape, np.nan)), axis=2).reshape(-1, 3)

    def dots(self, k: int) -> np.ndarray:
        """Return point masses and points of sliders [m, 3] at snapshot k."""
        t = self.result.t_snap[k]
        rings = [[np.interp(t, times, path[:, i]) for i in range(3)] for times, path in self.paths.values() if len(path)]
        return np.concatenate((self.result.phi[k, self.masses], np.reshape(rings, (-1, 3))))

    def draw(self, axes: Any, k: int, colour: Any) -> list[Any]:
        """Draw snapshot k; the lines of all `points` that are there."""
        spot = {"ls": "none", "ms": 7, "mec": "white", "mew": 0.8, "zorder": 4}
        styles = ({"lw": self.width, "solid_capstyle": "round"}, {"lw": 1.0}, {"marker": "s", **spot}, {"marker": "o", **spot})
        out = []
        for points, style in zip(self.points(k), styles):
            if len(points):
                out += axes.plot(*points[:, axes.axes_of_space].T, color=colour, **style)
        return out

    def points(self, k: int) -> tuple[np.ndarray, ...]:
        """Return points of all lines at snapshot k, [m, 3] each: beams, axes of bodies, bodies, masses and sliders."""
        return self.beams(k), self.axes_of_bodies(k), self.result.phi[k, self.bodies], self.dots(k)

    def move(self, lines: list[Any], k: int, space: list[int]) -> None:
        """Show snapshot k with lines that `draw` made."""
        for line, points in zip(lines, filter(len, self.points(k))):
            if len(space) == 3:
                line.set_data_3d(*points.T)
            else:
                line.set_data(*points[:, space].T)

    def draw_paths(self, axes: Any) -> None:
        """Draw paths of sliders, behind everything."""
        for _, path in self.paths.values():
            if len(path):
                axes.plot(*path[:, axes.axes_of_space].T, color="0.65", lw=0.9, ls="--", zorder=1)


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
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


def new_figure(size: tuple[float, float]) -> Figure:
    """Create a figure of this size, inches, outside of any window; notebooks show it, also where they do not know matplotlib."""
    from matplotlib.figure import Figure
    figure = Figure(figsize=size, layout="constrained")
    setattr(figure, "_repr_png_", partial(_png_of, figure))
    return figure


def _png_of(figure: Figure) -> bytes:
    image = io.BytesIO()
    figure.savefig(image, format="png")
    return image.getvalue()


def as_text(name: str) -> str:
    """Return a name of the user's such that matplotlib shows it letter by letter: no formulas, and not left out of legends."""
    return f"{' ' if name.startswith('_') else ''}{name}".replace("$", r"\$")


def shapes_size(points: np.ndarray, plane: str) -> tuple[float, float]:
    """Return width and height of a figure, inches, in which axes that show `points` leave little white around them."""
    low, high = bounds(points)
    space = PLANES[flat_plane(high - low) if plane == "auto" else plane]
    width, *others = (high - low)[list(space)]
    if len(space) == 3:
        return 6.4, 4.7 + 0.8 * min(1.0, others[1] / max(width, others[0], 1e-300))
    drawn = others[0] / max(width, 1e-300)
    if STRAIGHT < drawn < 1.0 / LONGEST:
        return 7.5, 3.2                # scales of their own
    return 7.5, float(np.clip(6.2 * max(drawn, 0.25) + 0.9, 2.4, 5.5))


def space_axes(figure: Figure, place: Any, points: np.ndarray, plane: str) -> Any:
    """Create axes that show `points`, with equal aspect unless one extent in a plane is more than `LONGEST` times the other;
    .axes_of_space lists the coordinates drawn."""
    low, high = bounds(points)
    extent = high - low
    space = list(PLANES[flat_plane(extent) if plane == "auto" else plane])
    axes = figure.add_subplot(place, **({"projection": "3d"} if len(space) == 3 else {}))
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


def panel_figure(n: int, points: np.ndarray, plane: str) -> tuple[Figure, list[Any]]:
    """Create a figure with n panels, in rows of three, and their axes, which all show `points`."""
    columns = min(3, n)
    rows = -(-n // columns)
    figure = new_figure((4.2 * columns, 3.4 * rows))
    grid = figure.add_gridspec(rows, columns)
    panels = [space_axes(figure, grid[j // columns, j % columns], points, plane) for j in range(n)]
    for axes in panels:
        if len(axes.axes_of_space) == 3:
            # panels are small: the numbers of a short axis would lie on each other, and a mode has no size
            for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
                axis.set_ticklabels([])
                axis.labelpad = -8.0
    return figure, panels


def put_title(axes: Any, text: str) -> None:
    """Put a title above the axes; those in space leave room above their box unless it is high."""
    flatness = 1.0 - _height(axes)
    axes.set_title(text, y=1.0 - 0.07 * flatness if flatness else None)


def _height(axes: Any) -> float:
    """Return the height of the box of axes in space over its width, at most 1; of flat axes 1."""
    if len(axes.axes_of_space) == 2:
        return 1.0
    width, depth, height = (high - low for low, high in (axes.get_xlim(), axes.get_ylim(), axes.get_zlim()))
    return min(1.0, height / max(width, depth))


def time_bar(figure: Figure, axes: Any, mappable: Any, label: str = "time [s]") -> None:
    """Draw a colour bar of time: as high as flat axes, below axes in space."""
    flat = len(axes.axes_of_space) == 2
    # the labels of a high box reach further down
    place = axes.inset_axes((1.02, 0.0, 0.02, 1.0) if flat else (0.15, -0.02 - 0.07 * _height(axes) ** 2, 0.7, 0.025))
    figure.colorbar(mappable, cax=place, label=label, orientation="vertical" if flat else "horizontal")


def bounds(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return smallest and largest coordinates [3] of the finite points."""
    finite = points[np.isfinite(points).all(axis=1)]
    return (finite.min(axis=0), finite.max(axis=0)) if len(finite) else (np.zeros(3), np.zeros(3))


def flat_plane(extent: np.ndarray) -> str:
    """Return the name of the plane with the two largest extents (xy before xz before yz when equal), or 3d."""
    if extent.min() > FLAT * extent.max():
        return "3d"
    # equal extents: the later coordinate is left out
    left_out = 2 - int(np.argmin(extent[::-1]))
    return {0: "yz", 1: "xz", 2: "xy"}[left_out]


def slider_names(result: Result) -> list[str]:
    """Return names of the sliders whose motion was recorded."""
    return list(result.names.get("sliders", [])) if "s_slide" in result.series else []


def slider_path(result: Result, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return times [k] and positions [k, 3] of a slider point: its series, an observed point of that name, or its node in
    snapshots."""
    values = result.slider(name)
    if "position" in values:
        return result.t, values["position"]
    if name in result.names.get("points", []) and "points" in result.series:
        return result.t, result.point(name)
    nodes = result.names.get("slider_nodes", [])
    if nodes and len(result.t_snap):
        return result.t_snap, result.phi[:, nodes[result.names["sliders"].index(name)]]
    return np.zeros(0), np.zeros((0, 3))
