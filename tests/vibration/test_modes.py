"""Modes as users ask for them: arguments, states, facts, pictures."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parents[1]))
from small_scenes import SECTION, bead, cantilever, straight  # noqa: E402


def compiled(scene: fb.Scene, **options: Any) -> Any:
    return fb.compile_scene(scene, **options)


def timed() -> fb.Scene:
    beam = straight("beam", (0, 0, 0), (3, 0, 0))
    return fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, force=(0, 0, 20.0), time=lambda t: t))


@pytest.mark.parametrize(("arguments", "message"), [
    ({"n": 0}, "n: must be a whole number >= 1, got 0"),
    ({"backend": "mumps"}, "backend 'mumps' does not exist"),
    ({"held": "ring"}, "held: scene 'cantilever' has no slider 'ring'; it has no sliders"),
    ({"load_factor": np.nan}, "load_factor: must be a finite number, got nan"),
    ({"planar": 1}, "planar: must be True or False"),
    ({"state": 3}, "state: must be a State"),
    ({"frequency": 3.0}, "has no argument 'frequency'")])
def test_bad_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(fb.SceneError, match=message):
        fb.modes(compiled(cantilever()), **arguments)


def test_what_is_no_equilibrium_is_refused_with_its_force() -> None:
    model = compiled(cantilever())
    with pytest.raises(fb.SceneError, match="beam 'beam' .*has an unbalanced force of 20 N; .*load_factor=0"):
        fb.modes(model)
    rest = fb.solve_static(model, levels=(0.5,))
    with pytest.raises(fb.SceneError, match="the state is not an equilibrium"):
        fb.modes(model, state=rest.state, load_factor=0.5)
    assert fb.modes(model, state=rest.state, n=2).info["solver"] in ("PARDISO", "SuperLU")
    with pytest.raises(fb.SceneError, match="loads have time functions, so a time is needed; give the time with at_time="):
        fb.modes(compiled(timed()))
    assert len(fb.modes(compiled(timed()), at_time=0.0, n=2)) == 2


def test_solvers_agree_and_the_reference_without_loads_is_that_of_a_scene_without() -> None:
    model = compiled(cantilever())
    one, other = (fb.modes(model, load_factor=0.0, n=6, backend=backend) for backend in ("auto", "superlu"))
    np.testing.assert_allclose(one.angular, other.angular, rtol=1e-10)
    assert one.is_complete and np.max(one.residuals) < 1e-10 and np.all(one.uncertainty < 1e-9 * one.squared)
    # a quarter of the mass of a clamped beam swings with the first mode in neither direction: 61 % do
    assert one.effective_mass[:2].max() == pytest.approx(0.61 * 3.0, rel=0.08)
    np.testing.assert_allclose(np.linalg.norm(one.displacements, axis=2).max(axis=1)[:2], 1.0, rtol=1e-12)


def test_planar_scenes_vibrate_in_space_unless_asked_otherwise() -> None:
    beam = straight("beam", (0, 0, 0), (3, 0, 0))
    scene = fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, force=(0, 0, 20.0)))
    model = compiled(scene)
    state = fb.solve_static(model).state
    every, flat = fb.modes(model, state=state, n=8), fb.modes(model, state=state, n=3, planar=True)
    assert (every.info["moves_in"], flat.info["moves_in"]) == ("space", "plane")
    assert np.max(np.abs(flat.displacements[:, :, 1])) == 0.0
    inside = [k for k in range(8) if np.max(np.abs(every.displacements[k, :, 1])) < 1e-8]
    np.testing.assert_allclose(every.angular[inside][:3], flat.angular, rtol=1e-9)
    asked = compiled(scene, planar=True)
    assert fb.modes(asked, state=fb.solve_static(asked).state, n=1).info["moves_in"] == "plane"
    twisted = fb.Beam.straight("twisted", (0, 0, 0), (3, 0, 0), section=SECTION, elements=3, degree=2, twist=0.3)
    with pytest.raises(fb.SceneError, match="planar=True: scene 'scene' does not stay in a plane"):
        fb.modes(compiled(fb.Scene(twisted, fb.Clamp(twisted.start))), planar=True)


def test_states_of_modes_are_starts_of_runs() -> None:
    model = compiled(bead(rate=0.0))
    found = fb.modes(model, load_factor=0.0, n=12)
    assert np.sum(found.squared == 0.0) == 7, "a free beam, and its bead"
    k = 8
    moved, moving = found.state(k, 0.01), found.state(k, 0.01, phase=-np.pi / 2)
    x = moved.q.reshape(-1, 4, 3)[:, 0] - found.positions
    np.testing.assert_allclose(x, 0.01 * found.displacements[k], atol=2e-4)
    v = moving.v.reshape(-1, 4, 3)
    np.testing.assert_allclose(moving.q, model.state().q, atol=1e-12)
    np.testing.assert_allclose(v[:, 0], 0.01 * found.angular[k] * found.displacements[k], atol=1e-9)
    rates, turns = found.shape(k)
    np.testing.assert_allclose(v[:, 1:], 0.01 * found.angular[k] * turns, atol=1e-9)
    assert rates.shape == x.shape
    run = fb.simulate(model, start=moved, t_end=0.01, step=1e-3, progress=False)
    assert run.drift("total") < 1e-10
    with pytest.raises(fb.SceneError, match="mode 99 does not exist: there are 12"):
        found.state(99, 0.01)
    with pytest.raises(fb.SceneError, match="amplitude must be a finite number"):
        found.state(0, "much")  # type: ignore[arg-type]


def test_the_unstable_directions_of_an_equilibrium_are_its_first_modes() -> None:
    """Pressed beyond twice its Euler load; statics and modes count the same."""
    beam = straight("column", (0, 0, 0), (0, 0, 3), elements=6)
    load = 1.3 * 600.0 * np.pi**2 / (4.0 * 9.0)
    model = compiled(fb.Scene(beam, fb.Clamp(beam.start), fb.Load("top", beam.end, force=(0, 0, -load))))
    rest = fb.solve_static(model)
    found = fb.modes(model, state=rest.state, n=4)
    assert rest.info["unstable_directions"] == found.unstable == 2
    assert any("fb.modes(model, state=result.state)" in event["text"] for event in rest.events)
    across = np.abs(found.displacements[:2, -1, :2])
    np.testing.assert_allclose(np.sort(across, axis=1)[:, 1], 1.0, rtol=1e-12)


def test_a_picture_of_modes() -> None:
    pytest.importorskip("matplotlib")
    found = fb.modes(compiled(cantilever()), load_factor=0.0, n=4)
    figure = fb.plot_modes(found, n=3, first=1)
    assert [axes.get_title()[:2] for axes in figure.axes] == ["1:", "2:", "3:"]
    assert "Hz" in figure.axes[0].get_title()
    with pytest.raises(fb.SceneError, match="first: mode 4 does not exist, there are 4"):
        fb.plot_modes(found, first=4)
    assert "effective mass" in str(found) and str(found).count("\n") == 4
