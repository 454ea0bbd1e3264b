"""Films of a result: GIF by Pillow, MP4 by ffmpeg."""
from __future__ import annotations

import os
import shutil
from contextlib import suppress
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from .arguments import FilePath, Flag, Number, checked
from .drawing import A_RESULT, PLANE, STYLE, Shapes, new_figure, put_title, space_axes
from .errors import BackendError, ResultFileError, SceneError
from .places import check_new
from .progress import Progress
from .result import Result

SUFFIXES = (".gif", ".mp4")
# frames at most: a film of an hour is a mistake
MOST_FRAMES = 20_000


@checked(result=A_RESULT, path=FilePath(), plane=PLANE, fps=Number(above=0.0, most=120.0, unit="1/s"), speed=Number(above=0.0),
         overwrite=Flag(), progress=Flag())
def animate(result: Result, path: str | PathLike[str], *, plane: str = "auto", fps: float = 20.0, speed: float | None = None,
            overwrite: bool = False, progress: bool | None = None) -> None:
    """Write a film of the snapshots: `path` ends in .gif (by Pillow) or .mp4 (by ffmpeg).

    The shape at the first snapshot stays behind in grey. Snapshots are shown as they are, nothing is interpolated in time: record
    enough of them, ``simulate(..., snapshots=200)``.

    Parameters
    ----------
    result : Result
        With snapshots.
    path : path
        The new file.
    plane : str
        'xy', 'xz', 'yz', '3d', or 'auto': the plane of a flat scene, else '3d'.
    fps : float
        Frames per second of the film; players of GIF take 50 at most.
    speed : float
        Seconds of the run in a second of the film, 1: as it was; each frame then shows the snapshot nearest to its time. Default:
        every snapshot is a frame.
    overwrite : bool
        Replace an existing file.
    progress : bool
        Progress bar; default: on anything longer than a second.

    Raises
    ------
    SceneError
        The path ends in something else, or the result holds no snapshots.
    BackendError
        Pillow, ffmpeg or matplotlib is missing; the message says what to install.
    ResultFileError
        The file exists (and not `overwrite`), or cannot be written.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in SUFFIXES:
        raise SceneError(f"animate: path must end in .gif or .mp4, got '{path.name}'")
    shapes = Shapes(result)
    picks = _frames(result.t_snap, fps, speed)
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
            figure, lines, axes = _first(result, shapes, plane)
            with writer.saving(figure, str(part), 100), Progress(len(picks), path.name, progress) as bar:
                for k in picks:
                    shapes.move(lines, k, axes.axes_of_space)
                    put_title(axes, _time(result, k))
                    writer.grab_frame()
                    bar.update()
        os.replace(part, where)
    except OSError as error:
        raise ResultFileError(f"film '{path}': cannot be written ({error}); make room or choose another path") from error
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def _frames(times: np.ndarray, fps: float, speed: float | None) -> np.ndarray:
    """Snapshots that the frames show."""
    if speed is None:
        return np.arange(len(times))
    n = int(min((times[-1] - times[0]) / (speed / fps), MOST_FRAMES)) + 1
    if n > MOST_FRAMES:
        raise SceneError(f"animate: speed={speed:g} takes more than {MOST_FRAMES} frames; choose a larger speed")
    at = times[0] + speed / fps * np.arange(n)
    return np.abs(np.searchsorted(0.5 * (times[1:] + times[:-1]), at))


def _writer(kind: str, fps: float) -> Any:
    """What makes a film of frames.

    Raises
    ------
    BackendError
        It is not installed.
    """
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


def _first(result: Result, shapes: Shapes, plane: str) -> tuple[Any, list[Any], Any]:
    """The figure, its moving lines and their axes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    figure = new_figure((8.0, 6.0))
    FigureCanvasAgg(figure)
    axes = space_axes(figure, 111, shapes.everything, plane)
    shapes.draw_paths(axes)
    for line in shapes.draw(axes, 0, "0.85"):
        line.set_zorder(0)
    lines = shapes.draw(axes, 0, "#0072B2")
    put_title(axes, _time(result, 0))
    # axes stay where they are from frame to frame
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    return figure, lines, axes


def _time(result: Result, k: int) -> str:
    name = str(result.info.get("scene", ""))
    text = f"load factor {result.t_snap[k]:.3f}" if result.info.get("method") == "static" else f"t = {result.t_snap[k]:.3f} s"
    return f"{name}, {text}" if name else text
