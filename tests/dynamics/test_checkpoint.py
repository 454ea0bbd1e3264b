"""Checkpoints: a run that goes on from one is the run, bit for bit; a file is complete, or it is refused."""
from __future__ import annotations

import dataclasses
import errno
import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.dynamics import checkpoint as module

sys.path.insert(0, str(Path(__file__).parents[1]))
from small_scenes import bead, free_beam, straight  # noqa: E402

H = 0.01
TESTS = Path(__file__).resolve().parents[1]


def pulled() -> fb.Scene:
    """A clamped beam under a load that changes in time."""
    beam = straight("beam", (0, 0, 0), (3, 0, 0))
    return fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, force=(0, 0, 20), time=lambda t: 1.0 + np.sin(5.0 * t)),
                    name="pulled")


def assert_same_state(a: Any, b: Any) -> None:
    for x, y in zip(a, b):
        np.testing.assert_array_equal(x, y)


def assert_rest(rest: fb.Result, whole: fb.Result) -> None:
    """Rows and shapes of the rest are the last rows and shapes of the whole."""
    assert_same_state(rest.state, whole.state)
    n = len(rest.t)
    assert 1 < n < len(whole.t)
    np.testing.assert_array_equal(rest.t, whole.t[-n:])
    for name, x in rest.series.items():
        # the first row of a run is not preceded by a step
        first = 1 if name in ("iterations", "step_size") else 0
        np.testing.assert_array_equal(x[first:], whole.series[name][-n:][first:], err_msg=name)
    m = len(rest.t_snap) - 1
    assert m > 0
    np.testing.assert_array_equal(rest.t_snap[1:], whole.t_snap[-m:])
    np.testing.assert_array_equal(rest.directors[1:], whole.directors[-m:])


def stop_at(time_: float) -> Any:
    return lambda t, state: t >= time_


@pytest.mark.parametrize("control", [{}, {"tolerance": 1e-5}], ids=["fixed", "control"])
@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize("make", [free_beam, bead, pulled])
def test_run_from_a_checkpoint_is_the_rest_of_the_run(make: Any, order: int, control: dict[str, float], tmp_path: Path) -> None:
    model = fb.compile_scene(make())
    settings: dict[str, Any] = {"t_end": 0.603, "step": H, "order": order, **control}
    if not control:
        settings["every"] = 3
    whole = fb.simulate(model, **settings)
    first = fb.simulate(model, callback=stop_at(0.2), output=fb.Output(checkpoint=tmp_path / "run.checkpoint"), **settings)
    kept = fb.load_checkpoint(tmp_path / "run.checkpoint")
    assert kept.t == first.t[-1] == first.checkpoint.t < 0.4
    assert_same_state(kept.state, first.state)
    assert_rest(fb.simulate(model, start=kept, **settings), whole)
    assert_rest(fb.simulate(fb.compile_scene(make()), start=first.checkpoint, **settings), whole)


@pytest.mark.parametrize("method", ["midpoint", "trapezoidal", "generalized_alpha"])
def test_compared_methods_go_on_bit_for_bit(method: str, tmp_path: Path) -> None:
    model = fb.compile_scene(bead())
    settings: dict[str, Any] = {"t_end": 0.2, "step": H, "every": 3, "method": method}
    whole = fb.simulate(model, **settings)
    first = fb.simulate(model, callback=stop_at(0.1), output=fb.Output(checkpoint=tmp_path / "run.checkpoint"), **settings)
    assert first.t[-1] < 0.15
    assert_rest(fb.simulate(model, start=fb.load_checkpoint(tmp_path / "run.checkpoint"), **settings), whole)


def test_checkpoint_at_the_end_of_a_run_goes_on_too() -> None:
    # 0.3 is 30 steps of 0.01 only up to round-off, and the load depends on time
    model = fb.compile_scene(pulled())
    whole = fb.simulate(model, t_end=1.0, step=H, every=10)
    first = fb.simulate(model, t_end=0.3, step=H, every=7)
    assert (first.t[-1], first.checkpoint.steps) == (0.3, 30)
    assert_same_state(fb.simulate(model, start=first.checkpoint, t_end=1.0, step=H).state, whole.state)


def test_rows_do_not_change_a_run_under_a_load_in_time() -> None:
    model = fb.compile_scene(pulled())
    runs = [fb.simulate(model, t_end=0.7, step=H, every=every, observe=()) for every in (1, 7, 70)]
    for other in runs[1:]:
        assert_same_state(other.state, runs[0].state)


@pytest.mark.parametrize("changes", [{"step": 0.007}, {"tolerance": 1e-5}, {"order": 4}])
def test_other_settings_may_go_on_from_a_checkpoint(changes: dict[str, Any]) -> None:
    model = fb.compile_scene(bead())
    first = fb.simulate(model, t_end=0.305, step=H)
    rest = fb.simulate(model, start=first.checkpoint, **{"t_end": 0.5, "step": H, **changes})
    assert (rest.t[0], rest.t[-1]) == (0.305, 0.5)
    assert rest.drift("total") <= 1e-12


def ring_on_a_clamped_beam() -> fb.Scene:
    beam, ring = straight("beam", (0, 0, 0), (3, 0, 0)), fb.PointMass("ring", mass=1.0)
    return fb.Scene(beam, ring, fb.Clamp(beam.start, name="wall"), fb.Slider("slides", ring, beam, at=1.0, rate=0.3),
                    fb.Load("tip", beam.end, force=(0, 0, 20), time=lambda t: 1.0 + np.sin(5.0 * t)), gravity=(0, 0, -9.81))


@pytest.mark.parametrize("control", [{}, {"tolerance": 1e-5}], ids=["fixed", "control"])
@pytest.mark.parametrize("after", [("energy", "slider"), ("energy", "slider", "reaction")], ids=["without", "with reactions"])
@pytest.mark.parametrize("before", [("energy", "slider"), ("energy", "slider", "reaction")], ids=["without", "with reactions"])
def test_a_run_that_records_other_forces_goes_on_from_a_checkpoint(before: tuple[str, ...], after: tuple[str, ...],
                                                                   control: dict[str, float], tmp_path: Path) -> None:
    model = fb.compile_scene(ring_on_a_clamped_beam())
    settings: dict[str, Any] = {"step": H, "t_end": 0.6, **(control or {"every": 3})}
    whole = fb.simulate(model, observe=after, **settings)
    first = fb.simulate(model, observe=before, callback=stop_at(0.3), output=fb.Output(checkpoint=tmp_path / "run.checkpoint"),
                        **settings)
    kept = fb.load_checkpoint(tmp_path / "run.checkpoint")
    for start in (first.checkpoint, kept):
        rest = fb.simulate(model, observe=after, start=start, **settings)
        assert_same_state(rest.state, whole.state)
        n = len(rest.t)
        assert 1 < n < len(whole.t)
        np.testing.assert_array_equal(rest.series["contact_force"], whole.series["contact_force"][-n:])
        if "reaction" in after:
            force, exact = rest.reaction("wall")["force"], whole.reaction("wall")["force"][-n:]
            np.testing.assert_array_equal(force[1:], exact[1:])
            if "reaction" in before:
                np.testing.assert_array_equal(force[0], exact[0])
            else:
                # the step before this row did not tell them: short steps ahead do, as at the start of any run
                fresh = fb.simulate(model, observe=after, start=fb.Start(start.state, time=start.t),
                                    **{**settings, "step": start.next_step or H})
                scale = np.abs(exact).max()
                np.testing.assert_allclose(force[0], fresh.reaction("wall")["force"][0], rtol=0.0, atol=1e-6 * scale)
                assert np.abs(force[0] - exact[0]).max() < 0.1 * scale


def test_failed_run_leaves_the_last_good_state(tmp_path: Path) -> None:
    beam = straight("beam", (0, 0, 0), (3, 0, 0))
    blow = fb.Load("blow", beam.end, force=(0, 0, 300.0), time=lambda t: float(t > 0.05))
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), blow))
    with pytest.raises(fb.ConvergenceError) as caught:
        fb.simulate(model, t_end=0.1, step=H, solver=fb.Solver(max_iterations=2), every=100,
                    output=fb.Output(checkpoint=tmp_path / "a"))
    kept = fb.load_checkpoint(tmp_path / "a")
    assert kept.t == caught.value.time == caught.value.result.t[-1] == pytest.approx(0.05)
    assert kept.steps == 5
    # increments of the step that failed are no rates to go on from
    past = model.plane.model.past_size
    assert kept.memory[0] == 2.0
    assert not kept.memory[past:past + 3 * model.n_nodes].any()
    assert_same_state(fb.simulate(model, start=kept, t_end=0.1, step=H).state, fb.simulate(model, t_end=0.1, step=H).state)


CHILD = """
import sys
sys.path.insert(0, sys.argv[1])
import fastbeam as fb
from small_scenes import bead
print("ready", flush=True)
fb.simulate(fb.compile_scene(bead(at=0.6, rate=0.1)), t_end=20.0, step=1e-4, order=4, every=5, checkpoint=sys.argv[2],
            checkpoint_every=0.0)
"""


@pytest.mark.parametrize("delay", [0.3, 0.7])
def test_checkpoint_of_a_killed_run_is_complete_and_goes_on(delay: float, tmp_path: Path) -> None:
    fb.simulate(fb.compile_scene(bead()), t_end=0.01, step=H)  # the child finds compiled kernels
    path = tmp_path / "run.checkpoint"
    child = subprocess.Popen([sys.executable, "-c", CHILD, str(TESTS), str(path)], stdout=subprocess.PIPE, text=True,
                             env={**os.environ, "FASTBEAM_PROGRESS": "0"})
    assert child.stdout is not None and child.stdout.readline() == "ready\n"
    limit = time.monotonic() + 60.0
    while not path.exists() and time.monotonic() < limit:
        time.sleep(0.01)
    time.sleep(delay)
    child.send_signal(signal.SIGKILL)
    assert child.wait() == -signal.SIGKILL
    kept = fb.load_checkpoint(path)
    assert kept.steps > 0 and kept.steps % 5 == 0
    model = fb.compile_scene(bead(at=0.6, rate=0.1))
    t_end = kept.t + 0.005
    settings: dict[str, Any] = {"t_end": t_end, "step": 1e-4, "order": 4, "every": 5}
    assert_same_state(fb.simulate(model, start=kept, **settings).state, fb.simulate(model, **settings).state)


# ------------------------------------------------------------------------------------------------------------------ refusals
@pytest.fixture(scope="module")
def good() -> Any:
    return fb.simulate(fb.compile_scene(bead()), t_end=0.05, step=H).checkpoint


def test_checkpoint_of_another_model_is_refused(good: Any) -> None:
    with pytest.raises(fb.SceneError, match="start: the checkpoint belongs to another model .scene 'bead', 8 nodes. than 'bead'"):
        fb.simulate(fb.compile_scene(bead(at=1.1)), start=good, t_end=1.0, step=H)
    with pytest.raises(fb.SceneError, match="start: the checkpoint belongs to t = 0.05 s; leave the time of Start out"):
        fb.simulate(fb.compile_scene(bead()), start=fb.Start(good, time=0.0), t_end=1.0, step=H)
    with pytest.raises(fb.SceneError, match="t_end: must be greater than the time of the start, 0.05 s, got 0.05"):
        fb.simulate(fb.compile_scene(bead()), start=good, t_end=0.05, step=H)


def test_states_that_no_run_can_reach_are_refused(good: Any) -> None:
    model = fb.compile_scene(bead())
    state = good.state
    for wrong, message in ((state._replace(q=1.01 * state.q), "the directors of a node are not orthonormal .off by 0.02"),
                           (state._replace(s=state.s + 3.0), r"slider 'run' is at s = 4.\d* m, outside its beam .0 to 3"),
                           (state._replace(s=-state.s), r"slider 'run' is at s = -1.\d* m, outside its beam")):
        with pytest.raises(fb.SceneError, match=message):
            fb.simulate(model, start=dataclasses.replace(good, state=wrong), t_end=0.1, step=H)


def test_no_flipped_bit_and_no_cut_goes_unnoticed(good: Any, tmp_path: Path) -> None:
    good.save(tmp_path / "a")
    data = (tmp_path / "a").read_bytes()
    generator = np.random.default_rng(7)
    flips = generator.integers(0, 8 * len(data), 400).tolist()
    for bit in flips:
        broken = bytearray(data)
        broken[bit // 8] ^= 1 << bit % 8
        (tmp_path / "b").write_bytes(broken)
        with pytest.raises(fb.ResultFileError, match="checkpoint '.*b': "):
            fb.load_checkpoint(tmp_path / "b")
    for length in [0, 1, 20, 25, *generator.integers(0, len(data), 40).tolist(), len(data) - 1]:
        (tmp_path / "b").write_bytes(data[:length])
        with pytest.raises(fb.ResultFileError, match="checkpoint '.*b': "):
            fb.load_checkpoint(tmp_path / "b")


def forged(good: Any, path: Path, body: bytes | None = None, **changes: Any) -> None:
    """A file with a right checksum and a wrong header or body."""
    good.save(path, overwrite=True)
    first, line, rest = path.read_bytes().split(b"\n", 2)
    head = json.loads(line)
    for name, value in changes.items():
        head[name] = value
    data = first + b"\n" + json.dumps(head).encode() + b"\n" + (rest[:-32] if body is None else body)
    path.write_bytes(data + hashlib.sha256(data).digest())


@pytest.mark.parametrize(("changes", "message"), [
    ({"sizes": {"q": 10**15, "v": 10**15, "s": 1, "force": 3, "history": 0, "mean_force": 3, "memory": 0, "impacts": 0}},
     "arrays of .* numbers do not fit"),
    ({"sizes": {"q": -96, "v": 96, "s": 1, "force": 3, "history": 0, "mean_force": 3, "memory": 0, "impacts": 0}}, "do not fit"),
    ({"sizes": {"q": 95, "v": 97, "s": 1, "force": 3, "history": 0, "mean_force": 3, "memory": 109, "impacts": 0}},
     "do not form a state"),
    ({"sizes": {"q": 96, "v": 96, "s": 1, "force": 3, "history": 0, "mean_force": 3, "memory": 108, "impacts": 1}},
     "do not form a state"),
    ({"sizes": [1, 2]}, "damaged header .TypeError"), ({"sizes": {}}, "damaged header .KeyError: 'q'"),
    ({"t": "now"}, "damaged header .SceneError: t: must be a finite number"), ({"t": float("nan")}, "t: must be a finite number"),
    ({"step": -1.0}, "a step size is not > 0"), ({"next_step": 0.0}, "a step size is not > 0"), ({"steps": -3}, "a step size is "
                                                                                                                "not > 0"),
    ({"steps": None}, "damaged header .TypeError"), ({"steps": 1e400}, "damaged header .OverflowError"),
    ({"body": np.full(308, np.nan).tobytes()}, "holds values that are not finite"), ({"body": b""}, "do not fit 0 bytes")])
def test_forged_files_are_refused(good: Any, changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    assert sum(x.size for x in (*good.state, good.mean_force, good.memory)) == 308
    forged(good, tmp_path / "a", **changes)
    with pytest.raises(fb.ResultFileError, match=f"checkpoint '.*a': .*{message}"):
        fb.load_checkpoint(tmp_path / "a")


def test_what_is_no_checkpoint_is_refused(tmp_path: Path) -> None:
    for data, message in ((b"", "not a fastbeam checkpoint"), (b"\x80\x04cos\nsystem\n", "not a fastbeam checkpoint"),
                          (b"fastbeam-checkpoint 5\n{}\n", "format version 5, but this fastbeam reads 4; install a newer "
                                                           "fastbeam"),
                          (b"fastbeam-checkpoint 1\n{}\n", "format version 1, but this fastbeam reads 4; install an older "
                                                           "fastbeam"),
                          (b"fastbeam-checkpoint x\n{}\n", "its version is not a number"),
                          (b"fastbeam-checkpoint 4\n" + b"[" * 100000, "checksum of its 100022 bytes is wrong")):
        (tmp_path / "a").write_bytes(data)
        with pytest.raises(fb.ResultFileError, match=message):
            fb.load_checkpoint(tmp_path / "a")
    nested = b"fastbeam-checkpoint 4\n" + b"[" * 50000 + b"\n"
    (tmp_path / "a").write_bytes(nested + hashlib.sha256(nested).digest())
    with pytest.raises(fb.ResultFileError, match="damaged header .(RecursionError|JSONDecodeError)"):
        fb.load_checkpoint(tmp_path / "a")
    with pytest.raises(fb.ResultFileError, match="nowhere': no such file"):
        fb.load_checkpoint(tmp_path / "nowhere")


def test_checkpoints_replace_only_checkpoints(good: Any, tmp_path: Path) -> None:
    model = fb.compile_scene(bead())
    path = tmp_path / "a"
    path.write_text("precious")
    for overwrite, message in ((False, "exists already; pass overwrite=True"), (True, "the file exists and is not a checkpoint")):
        with pytest.raises(fb.ResultFileError, match=message):
            good.save(path, overwrite=overwrite)
    with pytest.raises(fb.ResultFileError, match="the file exists and is not a checkpoint"):
        fb.simulate(model, t_end=0.1, step=H, output=fb.Output(checkpoint=path))
    assert path.read_text() == "precious"
    with pytest.raises(fb.ResultFileError, match="folder '.*nowhere' does not exist; create it first"):
        fb.simulate(model, t_end=0.1, step=H, output=fb.Output(checkpoint=tmp_path / "nowhere" / "a"))
    good.save(tmp_path / "b")
    fb.simulate(model, t_end=0.1, step=H, output=fb.Output(checkpoint=tmp_path / "b"))
    assert fb.load_checkpoint(tmp_path / "b").steps == 10
    assert sorted(x.name for x in tmp_path.iterdir()) == ["a", "b"]


def test_full_disk_ends_the_run_and_keeps_what_there_is(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    model = fb.compile_scene(bead())
    saved: list[int] = []

    def fsync(handle: int) -> None:
        saved.append(handle)
        if len(saved) > 8:  # file and folder: four checkpoints
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(module.os, "fsync", fsync)
    with pytest.raises(fb.ResultFileError, match="a': cannot be written .*No space.*; an earlier checkpoint there is "
                                                 "unchanged") as caught:
        fb.simulate(model, t_end=1.0, step=H, every=1, output=fb.Output(checkpoint=tmp_path / "a", checkpoint_every=0.0))
    monkeypatch.undo()
    result = caught.value.result
    assert len(result.t) == 6 and result.events[-1]["kind"] == "file"
    assert fb.load_checkpoint(tmp_path / "a").steps == 4
    assert [x.name for x in tmp_path.iterdir()] == ["a"]
    whole = fb.simulate(model, t_end=1.0, step=H)
    assert_same_state(fb.simulate(model, start=result.checkpoint, t_end=1.0, step=H).state, whole.state)


# -------------------------------------------------------------------------------------------------------------------- places
needs_posix = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs links and pipes")


@needs_posix
def test_checkpoint_goes_through_a_link_to_the_file_it_leads_to(tmp_path: Path) -> None:
    model = fb.compile_scene(bead())
    (tmp_path / "disk").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "disk" / "real")
    for t_end in (0.05, 0.1):  # the first time the link leads to nothing
        fb.simulate(model, t_end=t_end, step=H, output=fb.Output(checkpoint=tmp_path / "link"))
        assert (tmp_path / "link").is_symlink()
        assert fb.load_checkpoint(tmp_path / "disk" / "real").t == pytest.approx(t_end)
    assert sorted(x.name for x in tmp_path.rglob("*")) == ["disk", "link", "real"]


@needs_posix
def test_rights_of_a_checkpoint_stay(good: Any, tmp_path: Path) -> None:
    good.save(tmp_path / "a")
    (tmp_path / "a").chmod(0o600)
    good.save(tmp_path / "a", overwrite=True)
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o600


@needs_posix
def test_devices_pipes_and_loops_of_links_are_refused_before_the_run(good: Any, tmp_path: Path) -> None:
    model = fb.compile_scene(bead())
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "null").symlink_to("/dev/null")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    for name, message in (("pipe", "is a device, pipe or socket, not a file"), ("null", "is a device, pipe or socket"),
                          ("loop", "cannot be written"),
                          ("x" * 300, r"cannot be written \(.*\); (an earlier checkpoint there is unchanged\. C|c)hoose "
                                      "another path"),
                          ("", "is a folder; give the name of a file")):
        for use in (lambda path: fb.simulate(model, t_end=0.1, step=H, output=fb.Output(checkpoint=path), callback=too_late),
                    lambda path: good.save(path, overwrite=True)):
            with pytest.raises(fb.ResultFileError, match=f"checkpoint '.*{name}': .*{message}"):
                use(tmp_path / name)
    with pytest.raises(fb.ResultFileError, match="pipe': is a device, pipe or socket"):
        fb.load_checkpoint(tmp_path / "pipe")
    for wrong in (5, b"run", "a\0b", None):
        with pytest.raises(fb.SceneError, match="Checkpoint.save: path must be the path of a file"):
            good.save(wrong)
    assert sorted(x.name for x in tmp_path.iterdir()) == ["loop", "null", "pipe"]


def too_late(t: float, state: Any) -> None:
    pytest.fail("the run began")


def test_longest_possible_name_will_do(good: Any, tmp_path: Path) -> None:
    fb.simulate(fb.compile_scene(bead()), t_end=0.1, step=H, output=fb.Output(checkpoint=tmp_path / ("x" * 255)))
    assert fb.load_checkpoint(tmp_path / ("x" * 255)).steps == 10


def test_folder_that_cannot_be_written_is_refused_before_the_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    # not by its rights, which mean nothing to root
    def refuse(self: Path, *arguments: Any, **options: Any) -> Any:
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(module.Path, "open", refuse)
    with pytest.raises(fb.ResultFileError, match="run': cannot be written .*Read-only file system.*; choose another path"):
        fb.simulate(fb.compile_scene(bead()), t_end=0.1, step=H, output=fb.Output(checkpoint=tmp_path / "run"), callback=too_late)


def test_disk_that_becomes_unwritable_leaves_the_result(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    # not even what was begun can be removed
    def refuse(*arguments: Any, **options: Any) -> Any:
        raise OSError(errno.EROFS, "Read-only file system")

    def fail_later(t: float, state: Any) -> None:
        if t > 0.055:
            monkeypatch.setattr(module.Path, "open", refuse)
            monkeypatch.setattr(module.Path, "unlink", refuse)

    model = fb.compile_scene(bead())
    with pytest.raises(fb.ResultFileError, match="run': cannot be written .*Read-only") as caught:
        fb.simulate(model, t_end=0.1, step=H, every=1, output=fb.Output(checkpoint=tmp_path / "run", checkpoint_every=0.0),
                    callback=fail_later)
    monkeypatch.undo()
    assert caught.value.result.checkpoint.steps == len(caught.value.result.t) - 1 == 6
    assert fb.load_checkpoint(tmp_path / "run").steps == 5


def test_checkpoint_of_a_scene_with_joint_forces_is_read(tmp_path: Path) -> None:
    # the forces of joints with multipliers stand behind those of sliders
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=fb.Section.circle(radius=0.01, E=1e8, rho=1000.0), elements=2)
    ring, bob = fb.PointMass("ring", mass=0.1), fb.PointMass("bob", mass=0.1, position=(0.5, 0, -0.3))
    model = fb.compile_scene(fb.Scene(beam, ring, bob, fb.Clamp(beam.start), fb.DistanceJoint(ring, bob, "rod"),
                                      fb.Slider("s", ring, beam, at=0.5), gravity=(0, 0, -9.81)))
    whole = fb.simulate(model, t_end=0.02, step=1e-3, progress=False)
    fb.simulate(model, t_end=0.01, step=1e-3, output=fb.Output(checkpoint=tmp_path / "c"), progress=False)
    rest = fb.simulate(model, t_end=0.02, step=1e-3, start=fb.load_checkpoint(tmp_path / "c"), progress=False)
    assert whole.state.force.size == 4
    assert all(np.array_equal(x, y) for x, y in zip(rest.state, whole.state))
