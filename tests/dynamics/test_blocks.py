"""Rows of many steps in one call of the compiled loop: the same bits as rows that are read one by one, as with a callback."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.stepping.stepper import Stepper

SOFT = fb.Section.circle(radius=0.01, E=1e7, rho=1000.0)


def swinging() -> tuple[Any, dict[str, Any]]:
    """A soft beam that falls, oblique to the axes, with a point on it."""
    c, s = np.cos(0.6), np.sin(0.6)
    beam = fb.Beam.straight("beam", (0, 0, 0), (c, s, 0), section=SOFT, elements=4)
    dead = fb.Load("dead", beam.end, force=(0, 0, 0.3))
    return fb.Scene(beam, fb.Clamp(beam.start), dead, gravity=(0, 0, -9.81)), {"tip": beam.end}


def no_one(t: float, state: fb.State) -> None:
    """What looks at every row, so that they are read one by one."""


def assert_same(found: fb.Result, wanted: fb.Result) -> None:
    assert found.series.keys() == wanted.series.keys() and found.events == wanted.events
    for name, series in {**wanted.series, "t": wanted.t, "t_snap": wanted.t_snap, "phi": wanted.phi}.items():
        np.testing.assert_array_equal(found.series.get(name, getattr(found, name, None)), series)
    for name in ("steps", "iterations", "scale"):
        assert found.info[name] == wanted.info[name]
    for x, y in zip((*found.state, found.checkpoint.memory), (*wanted.state, wanted.checkpoint.memory)):
        np.testing.assert_array_equal(x, y)
    assert found.checkpoint.t == wanted.checkpoint.t


@pytest.mark.parametrize("planar", ["auto", False])
@pytest.mark.parametrize("settings", [{}, {"every": 3}, {"t_end": 0.10037}, {"observe": ("energy",)}, {"watched": True}])
def test_rows_are_those_of_single_steps(settings: dict[str, Any], planar: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, points = swinging()
    model = fb.compile_scene(scene, planar=planar)
    more = {"points": points, "observe": ("energy", "velocity")} if settings.pop("watched", False) else {}
    settings = {"t_end": 0.1, "step": 1e-3, "every": 1, "progress": False, **settings, **more}
    wanted = fb.simulate(model, callback=no_one, **settings)
    calls: list[int] = []
    advance = Stepper.advance
    monkeypatch.setattr(Stepper, "advance", lambda self, t, h, n, done=0: calls.append(n) or advance(self, t, h, n, done))
    found = fb.simulate(model, **settings)
    assert_same(found, wanted)
    assert sum(calls) < 30 < len(found.t)


def test_turns_that_steps_do_not_resolve_are_told_at_their_row(monkeypatch: pytest.MonkeyPatch) -> None:
    model = fb.compile_scene(swinging()[0])
    settings: dict[str, Any] = {"t_end": 0.1, "step": 1e-3, "every": 1, "progress": False, "observe": ("energy", "velocity")}
    spins = np.linalg.norm(fb.simulate(model, **settings).spins, axis=2)
    for module in ("blocks", "warnings"):
        monkeypatch.setattr(f"fastbeam.dynamics.{module}.UNRESOLVED_TURN", 0.9e-3 * spins.max())
    wanted = fb.simulate(model, callback=no_one, **settings)
    (event,) = [event for event in wanted.events if "rotation is not resolved" in event["text"]]
    assert 0.005 < event["time"] <= 0.1
    assert_same(fb.simulate(model, **settings), wanted)


def test_a_step_that_fails_among_others_ends_a_run_as_a_single_one(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, _ = swinging()
    model, results = fb.compile_scene(scene), []
    for more in ({"callback": no_one}, {}):
        with pytest.raises(fb.ConvergenceError) as failed:
            fb.simulate(model, t_end=4.0, step=1e-3, every=1, solver=fb.Solver(max_iterations=3), progress=False, **more)
        results.append(failed.value.result)
    assert 10 < len(results[0].t) < 4000
    assert_same(*results[::-1])


def test_a_file_has_all_rows(tmp_path: Path) -> None:
    scene, _ = swinging()
    model = fb.compile_scene(scene)
    found = fb.simulate(model, t_end=0.1, step=1e-3, every=1, progress=False, output=tmp_path / "run.h5")
    stored = fb.load_result(tmp_path / "run.h5")
    for name, series in found.series.items():
        np.testing.assert_array_equal(stored.series[name], series)
    np.testing.assert_array_equal(stored.phi, found.phi)
