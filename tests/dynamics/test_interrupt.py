"""Ctrl-C ends a run as its end does."""
from __future__ import annotations

import collections
import os
import signal
import sys
import threading
import time
import types
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.dynamics import interrupt
from fastbeam.kernels.jit import decorators as _jit
from fastbeam.kernels.jit import parts as _parts
from fastbeam.results import hdf5_writer as store
from fastbeam.stepping import iteration

sys.path.insert(0, str(Path(__file__).parents[1]))
from small_scenes import bead, cantilever, free_beam, straight  # noqa: E402

H = 0.01


@pytest.fixture(autouse=True)
def ctrl_c_is_not_ignored() -> Iterator[None]:
    """Shells start jobs in the background with SIGINT ignored, and so runs leave it alone there."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def ctrl_c() -> None:
    os.kill(os.getpid(), signal.SIGINT)


def disturbed(times: list[float]) -> fb.Scene:
    """A clamped beam; somebody presses Ctrl-C while a step is computed that begins after one of these times."""
    def factor(t: Any) -> Any:
        # not while the scene is checked
        while times and np.max(t) > times[0] and signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
            times.pop(0)
            ctrl_c()
        return 1.0 + np.sin(5.0 * t)

    beam = straight("beam", (0, 0, 0), (3, 0, 0))
    return fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, force=(0, 0, 20), time=factor), name="pulled")


def assert_same_state(a: Any, b: Any) -> None:
    for x, y in zip(a, b):
        np.testing.assert_array_equal(x, y)


@pytest.mark.parametrize("settings", [{"every": 7}, {"every": 1000}, {"order": 4, "every": 3}, {"tolerance": 1e-5}])
def test_ctrl_c_leaves_whole_steps_a_file_a_checkpoint_and_the_result(settings: dict[str, Any], tmp_path: Path) -> None:
    settings = {"t_end": 1.0, "step": H, **settings}
    whole = fb.simulate(fb.compile_scene(disturbed([])), **settings)
    model = fb.compile_scene(disturbed([0.3]))
    with pytest.raises(fb.Interrupted, match="the run was interrupted at t = 0.*; everything until then is in .result") as caught:
        fb.simulate(model, output=fb.Output(tmp_path / "run.h5", checkpoint=tmp_path / "kept"), **settings)
    stopped = caught.value
    assert isinstance(stopped, KeyboardInterrupt) and isinstance(stopped.__cause__, KeyboardInterrupt)
    assert 0.3 < stopped.checkpoint.t == stopped.result.t[-1] < 0.9
    assert stopped.result.events[-1]["kind"] == "interrupted" and stopped.state is stopped.result.state
    stored = fb.load_result(tmp_path / "run.h5")
    np.testing.assert_array_equal(stored.t, stopped.result.t)
    assert stored.info == stopped.result.info and stored.events == stopped.result.events
    kept = fb.load_checkpoint(tmp_path / "kept")
    assert kept.t == stopped.checkpoint.t
    assert_same_state(fb.simulate(model, start=kept, **settings).state, whole.state)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("make", [free_beam, bead])
def test_ctrl_c_is_seen_at_once_in_a_run_of_any_length(make: Callable[[], fb.Scene]) -> None:
    model = fb.compile_scene(make())
    fb.simulate(model, t_end=0.1, step=1e-6, every=1000)
    timer = threading.Timer(1.0, ctrl_c)
    timer.start()
    begin = time.perf_counter()
    with pytest.raises(fb.Interrupted):
        # a row each 1e8 steps, which take a quarter of an hour
        fb.simulate(model, t_end=1e4, step=1e-6, every=10**8, observe=())
    assert 1.0 <= time.perf_counter() - begin < 1.5


def test_results_do_not_depend_on_how_steps_are_cut_into_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    for scene, settings in ((disturbed([]), {}), (bead(), {}), (bead(), {"order": 4}), (bead(), {"method": "generalized_alpha"})):
        model = fb.compile_scene(scene)
        runs = []
        for limit in (0.0, 1e-4, 1e3):
            monkeypatch.setattr(interrupt, "CALL_TIME", limit)
            runs.append(fb.simulate(model, t_end=0.6, step=H, every=20, **settings))
        for other in runs[1:]:
            assert_same_state(other.state, runs[0].state)
            assert_same_state([other.checkpoint.memory], [runs[0].checkpoint.memory])
            for name, x in other.series.items():
                np.testing.assert_array_equal(x, runs[0].series[name], err_msg=name)


def test_few_calls_are_added(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    for name in ("advance", "take"):
        original = getattr(interrupt.Stepper, name)
        monkeypatch.setattr(interrupt.Stepper, name, lambda self, *a, of=original: (calls.append(a[2]), of(self, *a))[1])
    fb.simulate(fb.compile_scene(free_beam()), t_end=5.0, step=1e-3, every=100)
    assert sum(calls) == 5000 and len(calls) <= 50 + 4


def test_second_ctrl_c_does_not_wait(tmp_path: Path) -> None:
    # loads are evaluated before the steps of a call
    model = fb.compile_scene(disturbed([0.3, 0.3]))
    with pytest.raises(fb.Interrupted) as caught:
        fb.simulate(model, t_end=1.0, step=H, every=5, output=fb.Output(tmp_path / "run.h5", checkpoint=tmp_path / "kept"))
    result = caught.value.result
    assert caught.value.checkpoint is caught.value.state is None and "checkpoint" not in str(caught.value)
    assert 0.2 < result.t[-1] <= 0.3 and not (tmp_path / "kept").exists()
    np.testing.assert_array_equal(fb.load_result(tmp_path / "run.h5").t, result.t)


def test_ctrl_c_does_not_wait_for_the_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    @contextmanager
    def interrupted() -> Iterator[None]:
        ctrl_c()
        yield

    @_jit.kernel
    def triple(x: float) -> float:
        return 3.0 * x

    monkeypatch.setattr(_parts, "memoized_typing", interrupted)
    try:
        with interrupt.Interrupts() as waiting, pytest.raises(KeyboardInterrupt):
            triple(1.5)
        assert not waiting.asked
    finally:
        _jit.KERNELS.remove(triple)


def test_first_call_that_is_interrupted_leaves_the_start(monkeypatch: pytest.MonkeyPatch) -> None:
    model = fb.compile_scene(bead())

    def broken(self: Any, *arguments: Any) -> None:
        self.core_state.q[:] = 7.0
        raise KeyboardInterrupt

    monkeypatch.setattr(interrupt.Stepper, "_run", broken)
    for settings in ({}, {"tolerance": 1e-5}):
        with pytest.raises(fb.Interrupted) as caught:
            fb.simulate(model, t_end=1.0, step=H, **settings)
        assert caught.value.checkpoint.t == 0.0
        assert_same_state(caught.value.state, model.state())


@pytest.mark.parametrize("settings", [{}, {"tolerance": 1e-5}], ids=["fixed", "control"])
def test_long_step_is_left_between_its_iterations(settings: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(interrupt, "CALL_TIME", 0.0)
    model = fb.compile_scene(bead(), solver="sparse")
    whole = fb.simulate(model, t_end=0.3, step=H, solver="superlu", **settings)
    original, n = iteration.Iteration.assemble, [0]

    def assemble(self: Any, h: float) -> None:
        n[0] += 1
        if n[0] == 41:
            ctrl_c()
        original(self, h)

    monkeypatch.setattr(iteration.Iteration, "assemble", assemble)
    with pytest.raises(fb.Interrupted) as caught:
        fb.simulate(model, t_end=0.3, step=H, solver="superlu", **settings)
    assert n[0] == 41  # no iteration more
    assert 0.0 < caught.value.checkpoint.t < 0.2
    rest = fb.simulate(model, start=caught.value.checkpoint, t_end=0.3, step=H, solver="superlu", **settings)
    assert_same_state(rest.state, whole.state)


def test_callback_is_interrupted_at_once_and_may_interrupt() -> None:
    seen = []

    def callback(t: float, state: Any) -> None:
        if t > 0.055:
            ctrl_c()
            seen.append("too late")

    def stop(t: float, state: Any) -> None:
        if t > 0.055:
            raise KeyboardInterrupt

    for function in (callback, stop):
        with pytest.raises(fb.Interrupted) as caught:
            fb.simulate(fb.compile_scene(bead()), t_end=1.0, step=H, every=1, callback=function)
        assert caught.value.result.t[-1] == caught.value.checkpoint.t == pytest.approx(0.06)
    assert not seen


def test_handler_of_the_user_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: told.append(number))
    try:
        result = fb.simulate(fb.compile_scene(disturbed([0.3])), t_end=1.0, step=H, every=10)
        assert told == [signal.SIGINT] and result.t[-1] == 1.0
    finally:
        signal.signal(signal.SIGINT, before)
    assert_same_state(result.state, fb.simulate(fb.compile_scene(disturbed([])), t_end=1.0, step=H, every=10).state)


def test_runs_in_other_threads_leave_signals_alone() -> None:
    out: list[Any] = []
    thread = threading.Thread(target=lambda: out.append(fb.simulate(fb.compile_scene(bead()), t_end=0.1, step=H)))
    thread.start()
    thread.join()
    assert out[0].t[-1] == 0.1


def test_interrupt_anywhere_in_a_flush_leaves_a_readable_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    model = fb.compile_scene(bead())
    monkeypatch.setattr(store, "FLUSH_TIME", 0.0)
    found: collections.Counter[str] = collections.Counter()
    for n in range(2, 60):
        calls = [0]

        def crc32(*arguments: Any) -> int:
            calls[0] += 1
            if calls[0] == n:
                raise KeyboardInterrupt
            return zlib.crc32(*arguments)

        monkeypatch.setattr(store, "zlib", types.SimpleNamespace(crc32=crc32))
        with pytest.raises(fb.Interrupted) as caught:
            fb.simulate(model, t_end=0.5, step=H, every=1, output=fb.Output(tmp_path / "run.h5", overwrite=True))
        stored = fb.load_result(tmp_path / "run.h5")
        np.testing.assert_array_equal(stored.t, caught.value.result.t)
        found["rows" if len(stored.t) > 1 else "start"] += 1
    assert found["rows"] > 20


def test_statics_end_with_the_last_equilibrium(monkeypatch: pytest.MonkeyPatch) -> None:
    model = fb.compile_scene(cantilever(force=5.0))
    original, n = interrupt.Interrupts.serve, [0]

    def serve(self: Any) -> None:
        n[0] += 1
        if n[0] == 3:
            ctrl_c()
        original(self)

    monkeypatch.setattr(interrupt.Interrupts, "serve", serve)
    with pytest.raises(fb.Interrupted, match="load factor 0.75: interrupted; the last equilibrium is in .state") as caught:
        fb.solve_static(model)
    assert caught.value.result.t.tolist() == [0.0, 0.25, 0.75]
    assert caught.value.result.events[-1]["kind"] == "interrupted"
    n[0] = 10
    rest = fb.solve_static(model, start=caught.value.state)
    np.testing.assert_allclose(rest.state.q, fb.solve_static(model).state.q, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("settings", [{}, {"tolerance": 1e-5}], ids=["fixed", "control"])
def test_last_row_has_contact_forces_unless_steps_are_long(settings: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(t: float, state: Any) -> None:
        if t > 0.055:
            raise KeyboardInterrupt

    model = fb.compile_scene(bead())
    ended = fb.simulate(model, t_end=0.3, step=H, every=1, callback=lambda t, state: t > 0.055, **settings)
    for limit in (10.0, 0.0):
        monkeypatch.setattr(interrupt, "CALL_TIME", limit)
        with pytest.raises(fb.Interrupted) as caught:
            fb.simulate(model, t_end=0.3, step=H, every=1, callback=stop, **settings)
        force, other = (x.series["contact_force"] for x in (caught.value.result, ended))
        np.testing.assert_array_equal(force[:-1], other[:-1])
        assert np.isfinite(other).all()
        np.testing.assert_array_equal(force[-1], other[-1] if limit else np.full((1, 3), np.nan))


@pytest.mark.parametrize(("at", "which", "share"), [([0.05], "first", 1.0), ([0.05, 0.07], "second", 0.5)])
def test_ctrl_c_in_one_of_two_runs_leaves_a_file_and_says_which(at: list[float], which: str, share: float,
                                                                tmp_path: Path) -> None:
    # order 4 with damping extrapolates two runs
    calls: list[float] = []

    def factor(t: Any) -> Any:
        calls.append(float(np.max(t)))
        # the times of the second run begin anew
        runs = sum(b < a - 0.5 * H for a, b in zip(calls, calls[1:]))
        if calls[-1] > at[-1] and (len(at) == 1 or runs > 0 and calls[-1] < 0.1):
            if signal.getsignal(signal.SIGINT) is not signal.default_int_handler and not pressed:
                pressed.append(True)
                ctrl_c()
        return 1.0 + 0.1 * np.sin(5.0 * t)

    pressed: list[bool] = []
    soft = fb.Section.circle(radius=0.05, E=1e7, rho=1000.0, damping=1e-3)
    beam = fb.Beam.straight("beam", (0, 0, 0), (3, 0, 0), section=soft, elements=2)
    scene = fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, force=(0, 0, 2), time=factor))
    settings: dict[str, Any] = dict(t_end=0.2, step=H, every=1, progress=False)
    with pytest.raises(fb.Interrupted) as caught:
        fb.simulate(fb.compile_scene(scene), order=4, output=tmp_path / "run.h5", **settings)
    result = caught.value.result
    says = (f"this is the {which} of the two runs that order=4 with dissipation extrapolates, without the other: steps of "
            f"{share * H:g} s, errors of second order")
    assert str(caught.value).endswith(says)
    assert [e["text"] for e in result.events if e["kind"] == "extrapolation"] == [says]
    assert 0.04 < result.t[-1] < 0.2 and result.info["order"] == 2 and result.info["step"] == share * H
    # the run that it is, bit for bit
    alone = fb.simulate(fb.compile_scene(scene), **{**settings, "step": share * H, "every": round(1.0 / share)})
    np.testing.assert_array_equal(result.t[:-1], alone.t[:result.t.size - 1])
    np.testing.assert_array_equal(result.series["strain"][:-2], alone.series["strain"][:result.t.size - 2])
    stored = fb.load_result(tmp_path / "run.h5")
    np.testing.assert_array_equal(stored.t, result.t)
    assert stored.events == result.events
    assert caught.value.checkpoint.t == result.t[-1]


def test_a_failure_in_one_of_two_runs_leaves_a_file_and_says_which(tmp_path: Path) -> None:
    soft = fb.Section.circle(radius=0.05, E=1e7, rho=1000.0, damping=1e-3)
    beam = fb.Beam.straight("beam", (0, 0, 0), (3, 0, 0), section=soft, elements=2)
    scene = fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, force=(0, 0, 2),
                                                        time=lambda t: 1.0 if t < 0.05 else float("nan")))
    with pytest.raises(fb.SceneError, match="time function of load 'tip'") as caught:
        fb.simulate(fb.compile_scene(scene), t_end=0.2, step=H, order=4, every=1, progress=False, output=tmp_path / "run.h5")
    assert caught.value.result.events[-1]["text"].startswith("this is the first of the two runs")
    np.testing.assert_array_equal(fb.load_result(tmp_path / "run.h5").t, caught.value.result.t)
