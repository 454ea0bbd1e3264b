"""Whatever a function of the user's own raises on the way brings what was computed until then."""
from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parents[1]))
from small_scenes import straight  # noqa: E402

H = 0.01


def scene(time: Callable[[float], float], *more: Callable[[fb.Beam], Any]) -> fb.Scene:
    beam = straight("beam", (0, 0, 0), (3, 0, 0))
    return fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, force=(0, 0, 20), time=time),
                    *(make(beam) for make in more), name="pulled")


def steady(t: float) -> float:
    return 1.0 + np.sin(5.0 * t)


def failing(after: float, how: Any) -> Callable[[float], float]:
    return lambda t: steady(t) if t < after else how()


def divided() -> float:
    return 1 / 0


def assert_same(a: Any, b: Any) -> None:
    for x, y in zip(a, b):
        np.testing.assert_array_equal(x, y)


@pytest.mark.parametrize("how", [divided, lambda: float("nan")])
@pytest.mark.parametrize("settings", [{"every": 7}, {"every": 1000}, {"order": 4, "every": 3}, {"tolerance": 1e-5}])
def test_time_function_that_fails_brings_everything_until_then(how: Any, settings: dict[str, Any], tmp_path: Path) -> None:
    settings = {"t_end": 1.0, "step": H, **settings}
    whole = fb.simulate(fb.compile_scene(scene(steady)), **settings)
    model = fb.compile_scene(scene(failing(0.5, how)))
    with pytest.raises(fb.SceneError, match="time function of load 'tip': must .* at t = 0.5") as caught:
        fb.simulate(model, output=fb.Output(tmp_path / "run.h5", checkpoint=tmp_path / "kept"), **settings)
    result = caught.value.result
    assert result.events[-1]["kind"] == "failed" and str(caught.value) in result.events[-1]["text"]
    # the last step before the function fails, whatever the distance of rows
    assert result.t[-1] == result.checkpoint.t
    assert "tolerance" in settings or 0.5 - H - 1e-9 <= result.t[-1] <= 0.5 + 1e-9
    assert 0.3 < result.t[-1] < 0.52
    stored = fb.load_result(tmp_path / "run.h5")
    np.testing.assert_array_equal(stored.t, result.t)
    assert stored.events == result.events
    kept = fb.load_checkpoint(tmp_path / "kept")
    assert kept.t == result.t[-1]
    assert_same(kept.state, result.state)
    # the mended scene goes on from there, and meets the run that never failed
    if "tolerance" not in settings:
        mended = fb.simulate(fb.compile_scene(scene(steady)), start=fb.Start(kept.state, time=kept.t), **settings)
        np.testing.assert_allclose(mended.state.q, whole.state.q, rtol=0, atol=1e-9)


@pytest.mark.parametrize("settings", [{"every": 5}, {"every": 5, "tolerance": 1e-5}])
def test_callback_that_raises_brings_everything_until_then(settings: dict[str, Any], tmp_path: Path) -> None:
    class Own(Exception):
        pass

    def callback(t: float, state: Any) -> None:
        if t > 0.3:
            raise Own("enough")

    with pytest.raises(Own, match="enough") as caught:
        fb.simulate(fb.compile_scene(scene(steady)), t_end=1.0, step=H, callback=callback,
                    output=fb.Output(tmp_path / "run.h5", checkpoint=tmp_path / "kept"), **settings)
    result: Any = caught.value.result  # type: ignore[attr-defined]
    assert "everything computed until then is in .result" in caught.value.__notes__[0]
    assert 0.3 < result.t[-1] == result.checkpoint.t < 0.5
    assert result.events[-1]["kind"] == "failed" and result.events[-1]["text"] == "Own: enough"
    np.testing.assert_array_equal(fb.load_result(tmp_path / "run.h5").t, result.t)
    assert fb.load_checkpoint(tmp_path / "kept").t == result.t[-1]
    # nothing of the last row is missing
    assert all(np.isfinite(x[-1]).all() for x in result.series.values())


def test_callback_that_answers_nonsense_brings_the_result() -> None:
    with pytest.raises(fb.SceneError, match="callback: must return True") as caught:
        fb.simulate(fb.compile_scene(scene(steady)), t_end=1.0, step=H, every=5, callback=lambda t, state: "no")
    assert caught.value.result is not None and caught.value.result.t[-1] == pytest.approx(5 * H)


def test_controller_that_fails_brings_everything_until_then(tmp_path: Path) -> None:
    def law(now: Any, memory: Any) -> float:
        return 1.0 if now.t < 0.3 else 1 / 0

    control = fb.Controller("hand", law=law, period=5 * H, start=1.0)
    with pytest.raises(fb.SceneError, match="its law failed at t = 0.3 s") as caught:
        fb.simulate(fb.compile_scene(scene(control, lambda beam: control)), t_end=1.0, step=H, every=1,
                    output=tmp_path / "run.h5")
    result = caught.value.result
    assert result.t[-1] == pytest.approx(0.3) == result.checkpoint.t
    np.testing.assert_array_equal(fb.load_result(tmp_path / "run.h5").t, result.t)


def test_condition_that_fails_brings_everything_until_then() -> None:
    def gone(t: float, state: Any) -> float:
        return -1.0 if t < 0.3 else 1 / 0

    beam = straight("beam", (0, 0, 0), (3, 0, 0))
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Pin(beam.end, until=gone), gravity=(0, 0, -9.81)))
    for settings in ({"every": 10}, {"every": 1000}, {"tolerance": 1e-5}):
        with pytest.raises(Exception, match="division by zero") as caught:
            fb.simulate(model, t_end=0.6, step=H, **settings)
        result = caught.value.result  # type: ignore[attr-defined]
        assert 0.2 < result.t[-1] < 0.3 + 1e-9 and result.checkpoint.t == result.t[-1], settings


def test_path_whose_stop_fails_brings_its_equilibria() -> None:
    asked = []

    def high(state: Any) -> float:
        asked.append(1)
        return 1.0 if len(asked) < 4 else 1 / 0

    beam = straight("beam", (0, 0, 0), (3, 0, 0))
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, force=(0, 0, 20))))
    with pytest.raises(Exception, match="division by zero") as caught:
        fb.solve_path(model, stop={high: 0.0})
    result = caught.value.result  # type: ignore[attr-defined]
    assert len(result.t) >= 2 and result.events[-1]["kind"] == "failed"
    again = fb.solve_static(model, start=result.state, at_time=0.0, load_step=1.0)
    assert np.isfinite(again.state.q).all()


def test_support_that_fails_on_its_way_brings_everything_until_then() -> None:
    def lifted(t: float) -> Any:
        if t > 0.4:
            raise ZeroDivisionError("no way")
        return 0.0, 0.0, 0.1 * t

    beam = straight("beam", (0, 0, 0), (3, 0, 0))
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.PrescribedMotion("lift", beam.end, displacement=lifted)))
    with pytest.raises(Exception, match="no way") as caught:
        fb.simulate(model, t_end=1.0, step=H, every=1000)
    result = caught.value.result  # type: ignore[attr-defined]
    assert 0.35 < result.t[-1] <= 0.4


@pytest.mark.parametrize("run", [
    lambda model: fb.solve_static(model, load_step=0.2),
    lambda model: fb.relax(model, most_steps=10_000, finish=False)])
def test_any_failure_in_statics_brings_the_result(run: Callable[[fb.Model], Any], monkeypatch: pytest.MonkeyPatch) -> None:
    from fastbeam.statics.equilibrium import StaticSolver
    from fastbeam.stepping.stepper import Stepper
    beam = straight("beam", (0, 0, 0), (3, 0, 0))
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, force=(0, 0, 20))))
    for of, name in ((StaticSolver, "_equilibrium"), (Stepper, "advance")):
        count, inner = [0], getattr(of, name)

        def fails(*args: Any, count: list[int] = count, inner: Any = inner) -> Any:
            count[0] += 1
            if count[0] > (2 if inner.__name__ == "_equilibrium" else 60):
                raise MemoryError("no room")
            return inner(*args)

        monkeypatch.setattr(of, name, fails)
    with pytest.raises(MemoryError, match="no room") as caught:
        run(model)
    result = caught.value.result  # type: ignore[attr-defined]
    assert len(result.t) >= 2 and result.events[-1]["kind"] == "failed" and np.isfinite(result.state.q).all()
