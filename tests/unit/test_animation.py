"""Films: as many frames as shapes, things move in them, and what is missing is said."""
from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import fastbeam as fb
from fastbeam import animation
from fastbeam.result import Result

pytest.importorskip("matplotlib")
Image = pytest.importorskip("PIL.Image")


def pendulum(n: int = 6, spatial: bool = False) -> Result:
    """A rod with a body and a mass at its nodes, that turns a quarter in 1 s."""
    t = np.linspace(0.0, 1.0, n)
    arm = np.linspace(0.0, 1.0, 5)
    phi = np.zeros((n, 7, 3))
    angle = 0.5 * np.pi * t[:, None]
    phi[:, :5, 0], phi[:, :5, 1] = np.cos(angle) * arm, np.sin(angle) * arm
    phi[:, :5, 2] = 0.5 * arm if spatial else 0.0
    phi[:, 5], phi[:, 6] = phi[:, 4], phi[:, 2]
    names = {"beams": [{"name": "rod", "first": 0, "count": 5}], "bodies": [{"name": "bob", "node": 5}],
             "masses": [{"name": "bead", "node": 6}]}
    return Result(t=t, names=names, info={"scene": "pendulum"}, t_snap=t, phi=phi, directors=np.tile(np.eye(3), (n, 7, 1, 1)))


def frames(path: Path) -> np.ndarray:
    """All pictures of a GIF [n, height, width, 3]."""
    film = Image.open(path)
    out = []
    for k in range(film.n_frames):
        film.seek(k)
        out.append(np.asarray(film.convert("RGB"), dtype=int))
    return np.array(out)


@pytest.mark.parametrize("spatial", [False, True])
def test_every_shape_is_a_frame_and_the_rod_moves(spatial: bool, tmp_path: Path) -> None:
    fb.animate(pendulum(spatial=spatial), tmp_path / "run.gif", fps=10.0)
    pictures = frames(tmp_path / "run.gif")
    assert len(pictures) == 6 and Image.open(tmp_path / "run.gif").info["duration"] == 100
    # blue is where the rod is
    blue = (pictures[..., 2] > 120) & (pictures[..., 0] < 60)
    centers = [np.argwhere(picture).mean(axis=0) for picture in blue]
    assert all(picture.sum() > 200 for picture in blue)
    # it rises from frame to frame
    assert np.all(np.diff([y for y, _ in centers]) < -5.0)


@pytest.mark.parametrize(("speed", "picks"), [(None, [0, 1, 2, 3, 4, 5]), (1.0, [0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5]),
                                              (5.0, [0, 3, 5])])
def test_frames_show_the_shape_nearest_to_their_time(speed: float | None, picks: list[int]) -> None:
    times = np.linspace(0.0, 1.0, 6)
    found = animation._frames(times, 10.0, speed).tolist()
    assert len(found) == len(picks)
    if speed is not None:
        assert all(abs(times[k] - speed / 10.0 * i) <= 0.1 + 1e-12 for i, k in enumerate(found))


def test_one_shape_is_a_film_of_one_frame(tmp_path: Path) -> None:
    run = pendulum(2)
    one = Result(t=run.t[:1], names=run.names, t_snap=run.t_snap[:1], phi=run.phi[:1], directors=run.directors[:1])
    fb.animate(one, tmp_path / "run.gif", speed=1.0)
    assert Image.open(tmp_path / "run.gif").n_frames == 1


def test_mp4_by_ffmpeg(tmp_path: Path) -> None:
    try:
        fb.animate(pendulum(), tmp_path / "run.mp4", fps=5.0)
    except fb.BackendError:
        pytest.skip("no ffmpeg here")
    assert b"ftyp" in (tmp_path / "run.mp4").read_bytes()[:16] and (tmp_path / "run.mp4").stat().st_size > 2000


def test_without_ffmpeg_the_error_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.which", lambda name: None)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(fb.BackendError, match="pip install imageio-ffmpeg; a film as .gif needs neither"):
        fb.animate(pendulum(), tmp_path / "run.mp4")
    assert list(tmp_path.iterdir()) == []


def test_places_and_results_that_will_not_do_are_refused(tmp_path: Path) -> None:
    with pytest.raises(fb.SceneError, match="must end in .gif or .mp4, got 'run.avi'"):
        fb.animate(pendulum(), tmp_path / "run.avi")
    with pytest.raises(fb.SceneError, match="no snapshots"):
        fb.animate(Result(t=[0.0]), tmp_path / "run.gif")
    with pytest.raises(fb.SceneError, match="takes more than 20000 frames"):
        fb.animate(pendulum(), tmp_path / "run.gif", speed=1e-6)
    (tmp_path / "run.gif").write_text("mine")
    with pytest.raises(fb.ResultFileError, match="exists already"):
        fb.animate(pendulum(), tmp_path / "run.gif")
    assert (tmp_path / "run.gif").read_text() == "mine" and len(list(tmp_path.iterdir())) == 1
