"""Films: as many frames as shapes, things move in them, and what is missing is said."""
from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

import fastbeam as fb
from fastbeam.results.mode_shapes import DampedModes, Modes
from fastbeam.results.plots import animation
from fastbeam.results.result import Result

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


# --- modes ------------------------------------------------------------------------------------------------------------------
ROD = {"beams": [{"name": "rod", "first": 0, "count": 5}]}
STILL = np.column_stack((np.linspace(0.0, 2.0, 5), np.zeros((5, 2))))
TRIADS = np.tile(np.eye(3), (5, 1, 1))
# x'' + D x' + K x = 0 of two nodes across a rod: what does not commute, and what has no potential
STIFFNESS, DAMPING = np.array([[90.0, -20.0], [-20.0, 40.0]]), np.array([[2.0, 0.0], [0.0, 0.1]])
FOLLOWED = np.array([[50.0, -30.0], [30.0, 60.0]])


def across(pairs: np.ndarray) -> np.ndarray:
    """Displacements [n, 5, 3] along y of the nodes 2 and 4 from pairs [n, 2]."""
    out = np.zeros((len(pairs), 5, 3), pairs.dtype)
    out[:, (2, 4), 1] = pairs
    return out


def free_modes(values: np.ndarray, x: np.ndarray, spins: np.ndarray | None = None) -> Modes:
    n = len(values)
    return Modes(values, x, np.zeros_like(x) if spins is None else spins, np.zeros((n, 0)), np.ones(n), np.zeros((n, 3)),
                 np.zeros(n), np.zeros(n), None, {"scene": "rod", "left_out": 0, "complete": True}, ROD, STILL, TRIADS)


def damped_modes(rates: np.ndarray, x: np.ndarray) -> DampedModes:
    n = len(rates)
    return DampedModes(rates, x, np.zeros_like(x), np.zeros((n, 0)), np.zeros(n), None, {"scene": "rod"}, ROD, STILL, TRIADS)


def two_modes() -> Modes:
    values, vectors = np.linalg.eigh(STIFFNESS)
    return free_modes(values, across((vectors / np.abs(vectors).max(axis=0)).T))


def two_damped() -> DampedModes:
    rates, vectors = np.linalg.eig(np.block([[np.zeros((2, 2)), np.eye(2)], [-STIFFNESS, -DAMPING]]))
    up = np.flatnonzero(rates.imag > 0.0)
    x = vectors[:2, up]
    return damped_modes(rates[up], across((x / x[np.argmax(np.abs(x), axis=0), (0, 1)]).T))


def flutter() -> Modes:
    """The pair of w^2 and the parts of its vector, as `modes` lists them."""
    values, vectors = np.linalg.eig(FOLLOWED)
    up = int(np.argmax(values.imag))
    z = vectors[:, up] / np.abs(np.concatenate((vectors[:, up].real, vectors[:, up].imag))).max()
    return free_modes(np.array([values[up], values[up].conj()]), across(np.array([z.real, z.imag])))


def test_a_mode_at_quarter_periods() -> None:
    found = two_modes()
    for k in range(2):
        run = found.motion(k, amplitude=0.1, frames=8)
        x, size = found.displacements[k], 0.1 * 2.0
        for j, factor in enumerate((1.0, np.sqrt(0.5), 0.0, -np.sqrt(0.5), -1.0)):
            np.testing.assert_allclose(run.phi[j], STILL + factor * size * x, atol=1e-15)
        assert np.abs(run.phi - STILL).max() == pytest.approx(size, rel=1e-14)
        np.testing.assert_allclose(run.t_snap, np.arange(8) / 8.0 / found.frequencies[k], rtol=1e-14)
        np.testing.assert_allclose(run.velocities[2], -found.angular[k] * size * x, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(("case", "k"), [("damped", 0), ("damped", 1), ("flutter", 0), ("flutter", 1)])
def test_a_motion_with_its_decay_is_the_motion_of_the_equations(case: str, k: int) -> None:
    found, stiffness, damping = ((two_damped(), STIFFNESS, DAMPING) if case == "damped" else
                                 (flutter(), FOLLOWED, np.zeros((2, 2))))
    run = found.motion(k, frames=16, decay=True)
    u, v = run.phi[:, (2, 4), 1], run.velocities[:, (2, 4), 1]
    step = expm((run.t_snap[1] - run.t_snap[0]) * np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -damping]]))
    for j in range(15):
        np.testing.assert_allclose(step @ np.concatenate((u[j], v[j])), np.concatenate((u[j + 1], v[j + 1])), atol=1e-13)
    # it fades or grows, and is never larger than it should be
    last, first = np.abs(u[-4:]).max(), np.abs(u[:4]).max()
    assert last < 0.99 * first if case == "damped" else last > 1.1 * first
    assert np.abs(u).max() <= 0.24 * np.sqrt(2.0)


def test_without_decay_a_complex_shape_turns_in_phase() -> None:
    found = two_damped()
    x = found.displacements[0]
    run = found.motion(0, amplitude=0.2, frames=12)
    assert np.abs(x.imag).max() > 0.01
    np.testing.assert_allclose(run.phi[0], STILL + 0.4 * x.real, atol=1e-15)
    np.testing.assert_allclose(run.phi[3], STILL - 0.4 * x.imag, atol=1e-15)
    np.testing.assert_allclose(run.phi[6] - STILL, STILL - run.phi[0], atol=1e-15)
    np.testing.assert_allclose(run.phi[9] - STILL, STILL - run.phi[3], atol=1e-15)


def test_motions_that_do_not_swing() -> None:
    x = across(np.array([[0.5, 1.0]] * 3))
    found = damped_modes(np.array([-2.0, 0.0, 3.0], complex), x.astype(complex))
    for k in range(3):
        run = found.motion(k, frames=4)
        np.testing.assert_allclose(run.phi[:, 4, 1], [0.24, 0.0, -0.24, 0.0], atol=1e-15)
        assert run.t_snap[-1] == 0.75
    fades, grows = found.motion(0, frames=6, decay=True), found.motion(2, frames=6, decay=True)
    np.testing.assert_allclose(fades.phi[:, 4, 1], 0.24 * np.exp(-2.0 * fades.t_snap), rtol=1e-13)
    np.testing.assert_allclose(grows.phi[:, 4, 1], 0.24 * np.exp(3.0 * grows.t_snap - 3.0), rtol=1e-13)
    np.testing.assert_allclose(found.motion(1, frames=4, decay=True).phi, found.motion(1, frames=4).phi)


def test_triads_turn_by_finite_rotations() -> None:
    spins = np.zeros((1, 5, 3))
    spins[0, :, 0] = np.linspace(0.0, 1.0, 5)
    run = free_modes(np.array([4.0]), np.zeros((1, 5, 3)), spins).motion(0, amplitude=2.0, frames=4)
    angle = 2.0 * spins[0, :, 0]
    np.testing.assert_allclose(run.directors[0, :, 1], np.column_stack((0 * angle, np.cos(angle), np.sin(angle))), atol=1e-15)
    np.testing.assert_allclose(run.directors[2, :, 2], np.column_stack((0 * angle, np.sin(angle), np.cos(angle))), atol=1e-15)
    np.testing.assert_array_equal(run.phi, np.tile(STILL, (4, 1, 1)))


@pytest.mark.parametrize("kind", ["plain", "damped", "steady"])
def test_motions_are_those_of_states(kind: str) -> None:
    """Whose positions and triads are found in another way (triads by half tangents of angles, the same where these are small);
    of a spin they stand in the frame that turns."""
    beam = fb.Beam.straight("beam", (0, 0, 0), (3, 0, 0), section=fb.Section(
        EA=1e4, GA2=1e4, GA3=1e4, GJ=500.0, EI2=500.0, EI3=600.0, rhoA=1.0, rhoI2=0.1, rhoI3=0.2, damping=0.05), elements=3,
        degree=2)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start)))
    spin = fb.Spin(2.0, axis=(1, 0, 0))
    found = (fb.modes(model, n=4) if kind == "plain" else fb.modes(model, n=4, damped=True) if kind == "damped" else
             fb.modes(model, n=4, steady=spin, state=fb.solve_static(model, steady=spin).state))
    for k in range(3):
        run = found.motion(k, amplitude=1e-5, frames=8)
        # of torsion the amplitude is an angle
        size = 3e-5 if np.abs(found.displacements[k]).max() > 0.5 else 1e-5
        for j in (0, 1, 2, 5):
            state = found.state(k, size, 0.25 * np.pi * j)
            q = state.q.reshape(-1, 4, 3)
            np.testing.assert_allclose(run.phi[j], q[:, 0], atol=1e-13)
            np.testing.assert_allclose(run.directors[j], q[:, 1:], atol=1e-13)


def test_films_of_modes(tmp_path: Path) -> None:
    found = two_modes()
    fb.animate(found, tmp_path / "all.gif", frames=8, fps=10.0)
    pictures = frames(tmp_path / "all.gif")
    film = Image.open(tmp_path / "all.gif")
    # two panels side by side, and the film begins anew
    assert pictures.shape == (8, 340, 840, 3) and film.info["duration"] == 100 and film.info["loop"] == 0
    # to and fro in the same places
    assert np.array_equal(pictures[1], pictures[7]) and np.array_equal(pictures[2], pictures[6])
    blue = (pictures[..., 2] > 120) & (pictures[..., 0] < 60)
    heights = [np.argwhere(picture[:, :420])[:, 0].mean() for picture in blue]
    # on one side of the equilibrium at first, on the other half a period later
    assert (heights[0] - heights[2]) * (heights[4] - heights[2]) < -25.0
    fb.animate(found, tmp_path / "one.gif", mode=1, frames=4)
    assert frames(tmp_path / "one.gif").shape == (4, 600, 800, 3)
    fb.animate(two_damped(), tmp_path / "damped.gif", mode=[1, 0, 1, 0], frames=4, decay=True, plane="3d")
    assert frames(tmp_path / "damped.gif").shape == (4, 680, 1260, 3)


def test_the_phase_of_a_complex_shape_is_seen(tmp_path: Path) -> None:
    x = across(np.array([[1.0, 1.0j]]))
    fb.animate(damped_modes(np.array([-0.1 + 5.0j]), x), tmp_path / "run.gif", mode=0, frames=4)
    pictures = frames(tmp_path / "run.gif")
    blue = (pictures[..., 2] > 120) & (pictures[..., 0] < 60)
    tip = [np.argwhere(picture[:, 600:])[:, 0].mean() for picture in blue]
    middle = [np.argwhere(picture[:, 390:450])[:, 0].mean() for picture in blue]
    # rows count downwards: the middle is up at first, the end a quarter of a period before that
    assert np.argmin(middle) == 0 and np.argmax(middle) == 2 and np.argmin(tip) == 3 and np.argmax(tip) == 1


def test_films_of_modes_that_will_not_do(tmp_path: Path) -> None:
    found = two_modes()
    for arguments, message in ((dict(result=found, speed=1.0), "speed is for a Result"),
                               (dict(result=found, mode=2), "mode 2 does not exist: there are 2"),
                               (dict(result=found, mode=[]), "mode: names no mode"),
                               (dict(result=found, mode="first"), "mode: must be the number of a mode, from 0, or several"),
                               (dict(result=pendulum(), mode=0),
                                r"mode is for modes \(the result of fb\.modes\), but a Result was given"),
                               (dict(result=pendulum(), decay=False), "decay is for modes"),
                               (dict(result=free_modes(np.zeros(0), np.zeros((0, 5, 3)))), "there are no modes to show"),
                               (dict(result=3), "must be a Result or Modes, got 3; what simulate")):
        with pytest.raises(fb.SceneError, match=message):
            fb.animate(path=tmp_path / "run.gif", **arguments)
    assert list(tmp_path.iterdir()) == []
