"""Checks of random scenes and paths whose sliders have friction, drives and stops or are sleeves: balance of energies, restarts
bit for bit from any row, plane and space, turned and shifted scenes, both solvers. perf/stress/random_scenes.py runs them."""
from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from hypothesis import assume

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parent / "validation"))
from exchange import balanced, exchanged, largest, unit_of_strains  # noqa: E402
from restarts import assert_goes_on  # noqa: E402
from scene_strategies import Drawn, DrawnPath, build, build_path, moving_scenes, sliding_scenes  # noqa: E402
from test_scene_properties import SAME, STEPS  # noqa: E402

Array = np.ndarray
# a general rotation, by Cayley's formula
TURN = np.array((0.3, -0.5, 0.8))
CROSS = np.array([[0.0, -TURN[2], TURN[1]], [TURN[2], 0.0, -TURN[0]], [-TURN[1], TURN[0], 0.0]])
ROTATION, SHIFT = np.linalg.solve(np.eye(3) - CROSS, np.eye(3) + CROSS), np.array((1.5, -0.7, 0.4))

# iterations of a step in which friction jams
JAMS = 100


def scene_of(drawn: Drawn | DrawnPath) -> fb.Scene:
    return build(drawn) if isinstance(drawn, Drawn) else build_path(drawn)


def compiled(drawn: Drawn | DrawnPath, **options: Any) -> fb.Model:
    return fb.compile_scene(scene_of(drawn), **options)


def settings_of(drawn: Drawn | DrawnPath) -> dict[str, Any]:
    h = drawn.rest["step"] if isinstance(drawn, Drawn) else drawn.step
    return dict(t_end=STEPS * h, step=h, every=1, output=fb.Output(snapshots=0), progress=False)


def run(model: fb.Model, drawn: Drawn | DrawnPath, **options: Any) -> fb.Result:
    """Twelve steps; where one fails or a point leaves its beam there is no example."""
    try:
        result = fb.simulate(model, **settings_of(drawn), **options)
    except fb.ConvergenceError:
        assume(False)
        raise
    assume(not [e for e in result.events if e["kind"] in ("slider_end", "stopped")])
    return result


def jammed(result: fb.Result) -> list[dict[str, Any]]:
    """Events of steps that have missed Coulomb's law: how far these move is not determined."""
    return [event for event in result.events if "jams" in event.get("text", "")]


def of_both(one: fb.Result, other: fb.Result) -> None:
    """Coordinates and events of two ways to compute the same."""
    assume(not jammed(one) and not jammed(other))
    assert [e["kind"] for e in one.events] == [e["kind"] for e in other.events]
    for name in ("q", "s"):
        x, y = getattr(one.state, name), getattr(other.state, name)
        np.testing.assert_allclose(x, y, rtol=0.0, atol=SAME * float(np.abs(x).max(initial=1.0)))


def round_off_of_strains(drawn: Drawn | DrawnPath, energy: float) -> float:
    """What round-off of strains is worth of a strain energy in a few steps, J: four units in the last place."""
    return 4.0 * max(unit_of_strains(x.section, x.length, x.basis.n_elements, energy) for x in scene_of(drawn).beams)


def check_balance(drawn: Drawn | DrawnPath) -> None:
    result = run(compiled(drawn), drawn)
    # but where friction jams and its signs wander, a matrix of which may be singular
    jams = np.sum(result.series["iterations"] > JAMS) + len(jammed(result))
    assert result.info["fallbacks"] <= jams
    size = largest(result)
    limits = {"gap": 1e-14, "balance": 1e-13 + round_off_of_strains(drawn, float(np.max(result.series["strain"]))) / size}
    for name in result.info["conserved"]:
        assert result.drift(name) < limits.get(name, 1e-13), name
    if exchanged(result) > 0.05 * size:
        assert balanced(result)
    for name, x in result.balance().items():
        if name.startswith(("friction of", "stops of")):
            # what friction and stops took never comes back; a loss at a stop is a difference of energies
            assert np.min(np.diff(x)) >= -1e-14 * size, name


def check_restart(drawn: Drawn | DrawnPath) -> None:
    model = compiled(drawn)
    whole = run(model, drawn)
    # two steps are left: forces of the last row come from these
    n = Random(str(drawn)).randrange(1, len(whole.t) - 2)
    with tempfile.TemporaryDirectory() as folder:
        assert_goes_on(model, whole, n, Path(folder) / "c", settings_of(drawn))


def check_solvers(drawn: Drawn | DrawnPath) -> None:
    of_both(run(compiled(drawn), drawn), run(compiled(drawn, solver="sparse"), drawn))


def check_plane(drawn: Drawn | DrawnPath) -> None:
    model = compiled(drawn)
    assert model.plane is not None
    of_both(run(model, drawn), run(compiled(drawn, planar=False), drawn))


def check_turned(drawn: Drawn) -> None:
    """A scene turned and shifted moves as the other."""
    model, moved = compiled(drawn), fb.compile_scene(build(drawn, ROTATION, shift=SHIFT))
    one, other = run(model, drawn), run(moved, drawn)
    assume(not jammed(one) and not jammed(other))
    assert [e["kind"] for e in one.events] == [e["kind"] for e in other.events]
    in_space = np.arange(model.n_nodes) if model.moving is None else model.moving.in_space(model.n_nodes)
    x, y = (result.state.q.reshape(-1, 4, 3)[in_space, 0] for result in (one, other))
    size = max(1.0, float(np.abs(x).max()))
    np.testing.assert_allclose((y - SHIFT) @ ROTATION, x, rtol=0.0, atol=SAME * size)
    np.testing.assert_allclose(other.state.s, one.state.s, rtol=0.0, atol=SAME * size)


CHECKS = {"balance": check_balance, "restart": check_restart, "solvers": check_solvers, "plane": check_plane,
          "turned": check_turned}


def drawn_by(name: str, held: bool = False, kinds: Any = ("sleeve", "point"), moves: bool = False) -> Any:
    """Scenes for one of the checks; moves: with elements that move with the sliders."""
    if moves:
        return moving_scenes(held=held)
    return sliding_scenes(planar=name == "plane", held=held, kinds=kinds)
