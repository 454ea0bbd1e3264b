"""Random scenes: invariants, equal results of all solvers, restarts bit for bit, order and orientation irrelevant."""
from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parents[1]))
from scene_strategies import Drawn, DrawnYard, build, build_yard, scenes, yards  # noqa: E402

Array = np.ndarray
STEPS = 12
# twelve steps amplify the round-off of two ways of computing the same; forces of links and unresolved waves are part of it
SAME = 1e-9
QUICK = settings(derandomize=True, max_examples=4, deadline=None, suppress_health_check=list(HealthCheck), database=None)
# three hundred of each: perf/stress/random_scenes.py
MANY = settings(QUICK, max_examples=int(os.environ.get("FASTBEAM_EXAMPLES", "15")))


def run(drawn: Drawn, scene: fb.Scene | None = None, steps: int = STEPS, **options: Any) -> fb.Result:
    """Twelve steps of a drawn scene; an example whose step fails, or whose bead leaves its beam, is no example."""
    compiled = fb.compile_scene(build(drawn) if scene is None else scene,
                                **{key: options.pop(key) for key in ("solver", "eliminate_inner") if key in options})
    h = drawn.rest["step"]
    try:
        result = fb.simulate(compiled, t_end=steps * h, step=h, every=3, output=fb.Output(snapshots=0), progress=False, **options)
    except fb.ConvergenceError:
        assume(False)
    assume(result.info["steps"] == steps)
    return result


def assert_same(one: fb.Result, other: fb.Result) -> None:
    """Coordinates to round-off, next to the size of the motion."""
    for name in ("q", "s"):
        x, y = getattr(one.state, name), getattr(other.state, name)
        np.testing.assert_allclose(x, y, rtol=0.0, atol=SAME * max(1.0, float(np.abs(x).max())))


def check_invariants(drawn: Drawn) -> None:
    result = run(drawn)
    assert result.info["fallbacks"] == 0
    for name in result.info["conserved"]:
        assert result.drift(name) < (1e-14 if name == "gap" else 1e-12), name
    assert not [event for event in result.events if event["kind"] == "drift"]


def check_solvers(drawn: Drawn) -> None:
    one = run(drawn)
    assert one.info["solver"].startswith("block elimination")
    assert_same(one, run(drawn, solver="sparse"))
    assert_same(one, run(drawn, eliminate_inner=False))


def check_restart(drawn: Drawn) -> None:
    whole, half = run(drawn), run(drawn, steps=STEPS // 2)
    model = fb.compile_scene(build(drawn))
    rest = fb.simulate(model, start=half.checkpoint, t_end=STEPS * drawn.rest["step"], step=drawn.rest["step"], progress=False)
    for x, y in zip(whole.state, rest.state):
        np.testing.assert_array_equal(x, y)


def check_order(drawn: Drawn) -> None:
    one = run(drawn)
    mixed = build(drawn, order=Random(drawn.rest["order"]).shuffle)
    other = run(drawn, mixed)
    labels = [fb.compile_scene(scene).labels for scene in (build(drawn), mixed)]
    place = {label: k for k, label in enumerate(labels[1])}
    at = np.array([place[label] for label in labels[0]])
    q = [result.state.q.reshape(-1, 4, 3) for result in (one, other)]
    np.testing.assert_allclose(q[0], q[1][at], rtol=0.0, atol=SAME * max(1.0, float(np.abs(q[0]).max())))


def check_turned(drawn: Drawn) -> None:
    """The same scene in a general plane, turned back; a planar one stays in its plane exactly to round-off."""
    a = np.array((0.3, -0.5, 0.8))
    cross = np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
    rotation = np.linalg.solve(np.eye(3) - cross, np.eye(3) + cross)
    one, other = run(drawn), run(drawn, build(drawn, rotation))
    # the triad of a point mass stands still and does not belong to the scene
    turns = np.flatnonzero(fb.compile_scene(build(drawn)).numbers.rank != 9)
    q = [result.state.q.reshape(-1, 4, 3) for result in (one, other)]
    back = q[1] @ rotation
    back[:, 1:] = np.where(np.isin(np.arange(len(back)), turns)[:, None, None], back[:, 1:], q[0][:, 1:])
    np.testing.assert_allclose(q[0], back, rtol=0.0, atol=SAME * max(1.0, float(np.abs(q[0]).max())))
    if drawn.planar:
        assert float(np.abs(q[0][:, 0, 2]).max()) <= 1e-12


CHECKS = {"invariants": check_invariants, "solvers": check_solvers, "restart": check_restart, "order": check_order,
          "turned": check_turned}


def assert_property(name: str, drawn: Drawn) -> None:
    """One of the checks."""
    CHECKS[name](drawn)


@pytest.mark.parametrize("name", CHECKS)
def test_a_few_scenes(name: str) -> None:
    QUICK(given(scenes(planar=name == "turned"))(lambda drawn: assert_property(name, drawn)))()


@pytest.mark.slow
@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("name", CHECKS)
def test_many_scenes(name: str, held: bool) -> None:
    MANY(given(scenes(held=held, planar=name == "turned"))(lambda drawn: assert_property(name, drawn)))()


@pytest.mark.slow
@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("name", CHECKS)
def test_scenes_with_joints_that_have_axes(name: str, held: bool) -> None:
    settings(MANY, max_examples=6)(
        given(scenes(held=held, planar=name == "turned", jointed=True))(lambda drawn: assert_property(name, drawn)))()


@pytest.mark.slow
def test_yards_keep_their_books_whatever_the_order_of_parts_and_across_a_restart() -> None:
    """Springs with laws, a bushing, a crossing, a switch and a roller beside each other."""
    switched = []

    def check(drawn: DrawnYard) -> None:
        def run(order: Any = None, steps: int = STEPS, start: Any = None) -> fb.Result:
            model = fb.compile_scene(build_yard(drawn, order))
            try:
                return fb.simulate(model, t_end=steps * drawn.step, step=drawn.step, every=1, output=fb.Output(snapshots=0),
                                   progress=False,
                                   start=start)
            except fb.ConvergenceError:
                assume(False)
                raise

        whole = run()
        assert whole.info["steps"] >= STEPS
        assert whole.drift("balance") < 1e-12
        # where soft sections shear there is a corner at the end of a track
        assert whole.series["gap"].max() < 1e-13
        # what dampers and friction took never comes back
        assert np.all(np.diff(whole.series["losses"], axis=0) >= -1e-14 * np.max(np.abs(whole.series["losses"])))
        other = run(Random(drawn.rest["order"]).shuffle)
        assert [e["kind"] for e in whole.events] == [e["kind"] for e in other.events]
        for name in ("car", "cross on stem", "cross on over"):
            np.testing.assert_allclose(other.slider(name)["s"][-1], whole.slider(name)["s"][-1], rtol=0, atol=SAME)
        half = run(steps=STEPS // 2)
        # behind an event steps go on from there, and the half ends within one of them
        assume(all(e["kind"] == "projected" for e in half.events))
        for x, y in zip(whole.state, run(start=half.checkpoint).state):
            np.testing.assert_array_equal(x, y)
        switched.append("switched" in [e["kind"] for e in whole.events])

    settings(QUICK, max_examples=5)(given(yards())(check))()
    assert sum(switched) >= 2


def hashes() -> list[str]:
    """Of the final states of a few scenes with both solvers."""
    found: list[str] = []

    @settings(QUICK, max_examples=6)
    @given(scenes())
    def collect(drawn: Drawn) -> None:
        for solver in ("auto", "sparse"):
            found.append(run(drawn, solver=solver).state.q.tobytes().hex()[-64:])

    collect()
    return found


@pytest.mark.slow
def test_number_of_threads_changes_nothing() -> None:
    outputs = []
    for threads in ("1", "2"):
        names = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS")
        done = subprocess.run([sys.executable, __file__], env={**os.environ, **dict.fromkeys(names, threads)}, check=True,
                              capture_output=True, text=True, timeout=500)
        outputs.append(json.loads(done.stdout.splitlines()[-1]))
    assert len(outputs[0]) >= 6 and outputs[0] == outputs[1]


if __name__ == "__main__":
    print(json.dumps(hashes()))
