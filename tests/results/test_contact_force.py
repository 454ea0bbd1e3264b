"""Contact forces in rows: of second order also in the first and last row and beside a shorter step; looking ahead and back
leaves no trace."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parents[1]))
from planar_scenes import mechanism  # noqa: E402
from small_scenes import bead  # noqa: E402

Array = np.ndarray
T = 0.1


def forces(model: fb.Model, n: int, **options: Any) -> Array:
    """Rows [m, S, 3] of n steps."""
    result = fb.simulate(model, t_end=T, step=T / n, output=fb.Output(snapshots=0), progress=False, **{"every": 1, **options})
    assert result.info["steps"] == n
    return result.series["contact_force"]


@pytest.mark.parametrize("scene", [bead, mechanism])
def test_the_first_and_last_row_converge_with_the_square_of_the_step(scene: Any) -> None:
    model = fb.compile_scene(scene())
    exact = forces(model, 3200, every=3200)
    size = np.max(np.abs(forces(model, 400)))
    error = []
    for n in (200, 400, 800):
        rows = forces(model, n, every=n)
        error.append(np.linalg.norm(rows - exact, axis=(1, 2)) / size)
    # one-sided they were 6e-3 and 3e-3 off at the start, with the first power of the step
    first, last = np.transpose(error)
    assert first[0] < 3e-4 and first[2] < 0.3 * first[1] < 0.09 * first[0] * 1.1
    assert last[0] < 2e-2 and last[2] < 0.4 * last[0]


def cart(step: float) -> fb.Result:
    """A cart that starts to roll on a bridge, at 20 m/s."""
    deck = fb.Section.rectangle(height=0.1, width=0.1, E=2e11, rho=7800.0)
    bridge = fb.Beam.straight("bridge", (0, 0, 0), (20, 0, 0), section=deck, elements=10)
    mass = fb.PointMass("cart", mass=30.0)
    scene = fb.Scene(bridge, mass, fb.Clamp(bridge.start), fb.Clamp(bridge.end), fb.Slider("s", mass, bridge, at=7.0, rate=20.0),
                     gravity=(0, 0, -9.81))
    return fb.simulate(fb.compile_scene(scene), t_end=0.0503, step=step, output=fb.Output(snapshots=0), progress=False)


@pytest.mark.parametrize("step", [2e-3, 1e-4, 1e-5])
def test_the_outer_rows_do_not_grow_with_small_steps(step: float) -> None:
    # 0.0503 s are no whole number of the first steps: the last one is shorter
    force = cart(step).slider("s")["force"][:, 2]
    inner = force[3:-3]
    spread = np.ptp(inner)
    for row in (*force[:3], *force[-3:]):
        assert inner.min() - 0.3 * spread < row < inner.max() + 0.3 * spread


@pytest.mark.parametrize("options", [{}, {"order": 4}, {"method": "midpoint"}, {"tolerance": 1e-4}], ids=str)
@pytest.mark.parametrize("planar", ["auto", False])
def test_looking_ahead_and_back_leaves_no_trace(planar: str | bool, options: dict[str, Any]) -> None:
    model = fb.compile_scene(bead(), planar=planar)
    run = {"t_end": 0.0333, "step": 1e-3, "every": 5, **options}
    plain, seen = (fb.simulate(model, observe=kinds, **run) for kinds in ((), ("slider",)))
    for x, y in zip(plain.state, seen.state):
        np.testing.assert_array_equal(x, y)
    np.testing.assert_array_equal(plain.checkpoint.memory, seen.checkpoint.memory)
    for name in ("steps", "iterations", "fallbacks"):
        assert plain.info[name] == seen.info[name]
    assert np.isfinite(seen.series["contact_force"]).all()


@pytest.mark.parametrize("options", [{}, {"tolerance": 1e-4}], ids=["fixed", "controlled"])
@pytest.mark.parametrize("stop", [0.008, 0.012])
def test_rows_of_an_interrupted_run_go_on_bit_for_bit(options: dict[str, Any], stop: float, tmp_path: Path) -> None:
    # the last step is a shorter one
    model = fb.compile_scene(bead())
    run = {"t_end": 0.01234, "step": 1e-3, "every": 1, "output": fb.Output(snapshots=0), **options}
    whole = fb.simulate(model, **run)
    first = fb.simulate(model, callback=lambda t, state: t >= stop - 1e-12, **run)
    first.checkpoint.save(tmp_path / "kept")
    for start in (first.checkpoint, fb.load_checkpoint(tmp_path / "kept")):
        rest = fb.simulate(model, start=start, **run)
        n = len(rest.t)
        np.testing.assert_array_equal(rest.t, whole.t[-n:])
        np.testing.assert_array_equal(rest.series["contact_force"], whole.series["contact_force"][-n:])
    # but for its last row the first part says the same, and that row is close
    n = len(first.t) - 1
    np.testing.assert_array_equal(first.series["contact_force"][:n], whole.series["contact_force"][:n])
    size = np.max(np.abs(whole.series["contact_force"]))
    assert np.max(np.abs(first.series["contact_force"][n] - whole.series["contact_force"][n])) < 0.05 * size


def test_rows_at_the_end_of_a_beam() -> None:
    # the last step ends where the beam does, however short it is
    result = fb.simulate(fb.compile_scene(bead(at=2.9, rate=2.0)), t_end=0.2, step=1e-3, every=1)
    assert result.events[-1]["kind"] == "slider_end"
    fine = fb.simulate(fb.compile_scene(bead(at=2.9, rate=2.0)), t_end=0.2, step=1e-4, every=1)
    force, exact = (r.series["contact_force"][:, 0] for r in (result, fine))
    size = np.max(np.linalg.norm(exact, axis=1))
    for k in (-2, -1):
        expected = [np.interp(result.t[k], fine.t, exact[:, i]) for i in range(3)]
        assert np.linalg.norm(force[k] - expected) < 0.1 * size


def test_a_row_without_steps_around_it_has_no_force(tmp_path: Path) -> None:
    model = fb.compile_scene(bead())
    with pytest.raises(fb.ConvergenceError) as caught:
        fb.simulate(model, t_end=1.0, step=0.5, solver=fb.Solver(max_iterations=1))
    assert np.isnan(caught.value.result.series["contact_force"]).all()
    # pictures leave it out, files keep it
    fb.plot_slider(caught.value.result)
    caught.value.result.save(tmp_path / "run.h5")
    assert np.isnan(fb.load_result(tmp_path / "run.h5").series["contact_force"]).all()


def test_a_run_that_an_error_breaks_off_ends_as_runs_do(tmp_path: Path) -> None:
    def stop(t: float, state: Any) -> None:
        if t > 0.0045:
            raise KeyError("mine")

    model = fb.compile_scene(bead())
    run = {"t_end": 0.01, "step": 1e-3, "every": 1}
    with pytest.raises(KeyError):
        fb.simulate(model, callback=stop, output=tmp_path / "run.h5", **run)
    kept = fb.load_result(tmp_path / "run.h5").series["contact_force"]
    # a callback fails between steps: the last row has its force, as the last row of a run that ends there
    ended = fb.simulate(model, **run | {"t_end": 0.005}).series["contact_force"]
    assert kept.shape == ended.shape and np.array_equal(kept[:-1], ended[:-1])
    assert np.max(np.abs(kept[-1] - ended[-1])) < 1e-9 * np.max(np.abs(ended))
    # an error that is being handled around a run is none of it
    try:
        raise KeyError
    except KeyError:
        assert np.isfinite(fb.simulate(model, **run).series["contact_force"]).all()


def test_loads_are_asked_for_within_the_run_only() -> None:
    asked: list[float] = []

    def push(t: float) -> float:
        asked.append(t)
        return np.sin(t)

    scene = bead()
    scene.add(fb.Load("push", scene.beams[0].end, force=(0, 0, 1.0), time=push))
    model = fb.compile_scene(scene)
    asked.clear()
    for steps in (1, 2, 10):
        result = fb.simulate(model, start=fb.Start(time=3.0), t_end=3.0 + 0.01 * steps, step=0.01)
        assert 3.0 <= min(asked[3:]) and max(asked) <= 3.0 + 0.01 * steps
        assert np.isfinite(result.series["contact_force"]).all()
        asked.clear()
