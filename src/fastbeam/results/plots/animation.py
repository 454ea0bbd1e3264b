"""Films of a result, and of modes: GIF by Pillow, MP4 by ffmpeg."""
from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from contextlib import suppress
from os import PathLike
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from fastbeam.interface.arguments import Count, FilePath, Flag, Instance, Listing, Number, Refusal, checked, whole
from fastbeam.interface.errors import BackendError, ResultFileError, SceneError
from fastbeam.interface.paths import check_new
from fastbeam.results.mode_shapes import FRAMES, MOST_FRAMES, SIZE, Motion, Motions
from fastbeam.results.plots.drawing import (
    COLOURS,
    PLANE,
    STYLE,
    Shapes,
    as_text,
    new_figure,
    panel_figure,
    put_title,
    space_axes,
)
from fastbeam.results.progress import Progress
from fastbeam.results.result import Result

SUFFIXES = (".gif", ".mp4")
SHOWN = Instance((Result, Motions), "a Result or Modes", "what simulate, solve_static, load_result and modes return")
# modes of a film of which nothing else is said, as `plot_modes` draws
SOME, MOST = 6, 48


def which_modes(value: Any) -> int | tuple[int, ...]:
    """Check that an argument is a mode, or several. Raises Refusal."""
    if whole(value) is not None:
        return Count(0)(value)
    several: tuple[int, ...] = Listing(Count(0), "the number of a mode, from 0, or several", MOST)(value)
    if not several:
        raise Refusal("names no mode")
    return several


class Film(Protocol):
    """Figures of a film, frame by frame."""

    n: int

    def begin(self) -> Any:
        """Return the figure of the first frame."""

    def show(self, i: int) -> None:
        """Show frame i."""


@checked(result=SHOWN, path=FilePath(), plane=PLANE, fps=Number(above=0.0, most=120.0, unit="1/s"), speed=Number(above=0.0),
         mode=which_modes, amplitude=SIZE, frames=FRAMES, decay=Flag(), overwrite=Flag(), progress=Flag())
def animate(result: Result | Motions, path: str | PathLike[str], *, plane: str = "auto", fps: float = 20.0,
            speed: float | None = None, mode: int | Sequence[int] | None = None, amplitude: float | None = None,
            frames: int | None = None, decay: bool | None = None, overwrite: bool = False,
            progress: bool | None = None) -> None:
    """Write a film of the snapshots of a result, or of modes: `path` ends in .gif (by Pillow) or .mp4 (by ffmpeg).

    The shape at the first snapshot stays behind in grey. Snapshots are shown as they are, nothing is interpolated in time: record
    enough of them, ``simulate(..., output=Output(snapshots=200))``.

    A film of modes is one period of each, which goes on where it begins, before the equilibrium in grey; a GIF repeats it.
    Damped modes, and those about a steady motion in the frame that spins, have the phases of their complex shapes. Motions
    without a period (free, growing, more than critically damped) go to and fro once (see `Modes.motion`).

    Parameters
    ----------
    result : Result, Modes or DampedModes
        Result with snapshots; or modes.
    path : path
        The new file.
    plane : str
        'xy', 'xz', 'yz', '3d', or 'auto': the plane of a flat scene, else '3d'.
    fps : float
        Frames per second of the film; players of GIF take 50 at most.
    speed : float
        For a result: seconds of the run in a second of the film, 1: as it was; each frame then shows the snapshot nearest to its
        time. Default: every snapshot is a frame.
    mode : int or sequence of int
        For modes: the number of one, from 0, or of several, at most 48, a panel for each. Default: the first 6.
    amplitude : float
        For modes: largest displacement, as a share of the size of the scene, default 0.12 as in `plot_modes`; largest angle, rad,
        where nothing but triads turns.
    frames : int
        For modes: frames of the period, default 24.
    decay : bool
        For modes: whether they decay or grow at their rate, from or to `amplitude`; default: not.
    overwrite : bool
        Replace an existing file.
    progress : bool
        Progress bar; default: on anything longer than a second.

    Raises
    ------
    SceneError
        The path ends in something else, the result holds no snapshots, there is no such mode, or an argument does not belong to
        what is shown.
    BackendError
        Pillow, ffmpeg or matplotlib is missing; the message says what to install.
    ResultFileError
        The file exists (and not `overwrite`), or cannot be written.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in SUFFIXES:
        raise SceneError(f"animate: path must end in .gif or .mp4, got '{path.name}'")
    film: Film
    if isinstance(result, Result):
        of_modes = {"mode": mode, "amplitude": amplitude, "frames": frames, "decay": decay}
        given = [name for name, value in of_modes.items() if value is not None]
        if given:
            raise SceneError(f"animate: {given[0]} is for modes (the result of fb.modes), but a Result was given; leave it out")
        film = ResultFilm(result, plane, fps, speed)
    else:
        if speed is not None:
            raise SceneError("animate: speed is for a Result, but modes were given, whose period takes frames / fps seconds of "
                             "the film; leave it out")
        which = range(min(SOME, len(result))) if mode is None else (mode,) if isinstance(mode, int) else mode
        film = ModeFilm(result, plane, which, 0.12 if amplitude is None else amplitude, frames or 24, bool(decay))
    _write(film, path, kind, fps, overwrite, progress)


def _write(film: Film, path: Path, kind: str, fps: float, overwrite: bool, progress: bool | None) -> None:
    """Write a film, beside its place first. Raises BackendError or ResultFileError."""
    try:
        import matplotlib as mpl
    except ImportError as error:
        raise BackendError("films need matplotlib: pip install matplotlib") from error
    where = Path(os.path.realpath(path))
    part = where.with_name(f".{where.stem}.{os.getpid()}.part{kind}")
    try:
        check_new("film", where, path, overwrite)
        with mpl.rc_context({**STYLE, "savefig.dpi": 100}):
            writer = _writer(kind, fps)
            figure = film.begin()
            # axes stay where they are from frame to frame
            figure.draw_without_rendering()
            figure.set_layout_engine("none")
            with writer.saving(figure, str(part), 100), Progress(film.n, path.name, progress) as bar:
                for i in range(film.n):
                    film.show(i)
                    writer.grab_frame()
                    bar.update()
        os.replace(part, where)
    except OSError as error:
        raise ResultFileError(f"film '{path}': cannot be written ({error}); free disk space, or choose another path") from error
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


class ResultFilm:
    """Snapshots of a result, one after the other.

    plane, fps, speed: see `animate`.
    Raises SceneError: there are no snapshots, or too many frames.
    """

    def __init__(self, result: Result, plane: str, fps: float, speed: float | None) -> None:
        self.result, self.plane, self.shapes = result, plane, Shapes(result)
        self.picks = _frames(result.t_snap, fps, speed)
        self.n = len(self.picks)

    def begin(self) -> Any:
        """Return the figure of the first snapshot."""
        shapes = self.shapes
        figure = _canvas(new_figure((8.0, 6.0)))
        self.axes = space_axes(figure, 111, shapes.everything, self.plane)
        shapes.draw_paths(self.axes)
        for line in shapes.draw(self.axes, 0, "0.85"):
            line.set_zorder(0)
        self.lines = shapes.draw(self.axes, 0, COLOURS[0])
        put_title(self.axes, _time(self.result, 0))
        return figure

    def show(self, i: int) -> None:
        """Show the snapshot of frame i."""
        k = self.picks[i]
        self.shapes.move(self.lines, k, self.axes.axes_of_space)
        put_title(self.axes, _time(self.result, k))


class ModeFilm:
    """One period of modes, a panel for each.

    which: modes, from 0.
    amplitude: see `Motion`.
    n: frames.
    Raises SceneError: there is no such mode.
    """

    def __init__(self, modes: Motions, plane: str, which: Sequence[int], amplitude: float, n: int,
                 decay: bool) -> None:
        if not which:
            raise SceneError("animate: there are no modes to show")
        self.modes, self.plane, self.which, self.n = modes, plane, which, n
        self.motions = [Motion(modes, k, amplitude, decay) for k in which]
        # of modes that come to the same places in all panels; then the shapes of a frame, written anew in each
        phi = np.array([modes.positions, *(x for motion in self.motions for x in motion.reach())])
        self.shapes = Shapes(Result(t=(), names=modes.names, t_snap=np.zeros(len(phi)), phi=phi,
                                    directors=np.tile(modes.directors, (len(phi), 1, 1, 1))))

    def begin(self) -> Any:
        """Return the figure with the equilibrium, and the modes at phase 0."""
        shapes = self.shapes
        if len(self.which) == 1:
            figure = new_figure((8.0, 6.0))
            self.panels = [space_axes(figure, 111, shapes.everything, self.plane)]
        else:
            figure, self.panels = panel_figure(len(self.which), shapes.everything, self.plane)
        self._take(0)
        self.lines = []
        for j, (k, axes) in enumerate(zip(self.which, self.panels)):
            what, grows = self.modes._words(k)
            for line in shapes.draw(axes, 0, "0.8"):
                line.set_zorder(0)
            self.lines.append(shapes.draw(axes, 1 + j, COLOURS[1] if grows else COLOURS[0]))
            name = f"{as_text(str(self.modes.info['scene']))}, mode " if len(self.which) == 1 else ""
            put_title(axes, f"{name}{k}: {what}")
        return _canvas(figure)

    def show(self, i: int) -> None:
        """Show all modes at frame i of their period."""
        self._take(i)
        for j, (lines, axes) in enumerate(zip(self.lines, self.panels)):
            self.shapes.move(lines, 1 + j, axes.axes_of_space)

    def _take(self, i: int) -> None:
        for j, motion in enumerate(self.motions, 1):
            self.shapes.result.phi[j], self.shapes.result.directors[j] = motion.shape(i / self.n)


def _frames(times: np.ndarray, fps: float, speed: float | None) -> np.ndarray:
    """Choose the snapshots that the frames show."""
    if speed is None:
        return np.arange(len(times))
    n = int(min((times[-1] - times[0]) / (speed / fps), MOST_FRAMES)) + 1
    if n > MOST_FRAMES:
        raise SceneError(f"animate: speed={speed:g} takes more than {MOST_FRAMES} frames; choose a larger speed")
    at = times[0] + speed / fps * np.arange(n)
    return np.abs(np.searchsorted(0.5 * (times[1:] + times[:-1]), at))


def _writer(kind: str, fps: float) -> Any:
    """Return the writer that makes a film of frames. Raises BackendError: it is not installed."""
    import matplotlib as mpl
    from matplotlib.animation import FFMpegWriter, PillowWriter
    if kind == ".gif":
        return PillowWriter(fps=fps)
    if shutil.which(mpl.rcParams["animation.ffmpeg_path"]) is None:
        try:
            from imageio_ffmpeg import get_ffmpeg_exe
            mpl.rcParams["animation.ffmpeg_path"] = get_ffmpeg_exe()
        except (ImportError, RuntimeError) as error:
            raise BackendError("films in MP4 need ffmpeg: install it, or pip install imageio-ffmpeg; a film as .gif needs neither"
                               ) from error
    return FFMpegWriter(fps=fps, extra_args=["-pix_fmt", "yuv420p", "-loglevel", "error"])


def _canvas(figure: Any) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    FigureCanvasAgg(figure)
    return figure


def _time(result: Result, k: int) -> str:
    name = str(result.info.get("scene", ""))
    text = f"load factor {result.t_snap[k]:.3f}" if result.info.get("method") == "static" else f"t = {result.t_snap[k]:.3f} s"
    return f"{name}, {text}" if name else text
