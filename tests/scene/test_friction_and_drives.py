"""Bad friction, drives and stops of sliders: messages that say what is wrong and what to write."""
from __future__ import annotations

from typing import Any, Callable

import numpy as np
import pytest
from exchange import balanced

import fastbeam as fb

SECTION = fb.Section.circle(radius=0.01, E=1e8, rho=1000.0)
BEAM = fb.Beam.straight("rail", (0, 0, 0), (1, 0, 0), section=SECTION, elements=2)
MASS = fb.PointMass("m", mass=0.1)


def slider(**forces: Any) -> fb.Slider:
    return fb.Slider("s", MASS, BEAM, **{"at": 0.5, **forces})


def model(**forces: Any) -> fb.Model:
    return fb.compile_scene(fb.Scene(BEAM, MASS, fb.Clamp(BEAM.start), slider(**forces)))


def held(**forces: Any) -> fb.Model:
    """One that an equilibrium may be asked of."""
    return fb.compile_scene(fb.Scene(BEAM, MASS, fb.Clamp(BEAM.start), fb.Clamp(BEAM.end), slider(**forces)))


def sleeve(**changes: Any) -> fb.Sleeve:
    body = fb.RigidBody("b", mass=1.0, inertia=(1, 1, 1), position=(0.5, 0, 0))
    return fb.Sleeve("s", body, BEAM, at=0.5, **changes)


WRONG: dict[str, tuple[Callable[[], Any], tuple[str, ...]]] = {
    "negative friction": (lambda: slider(friction=-0.1), ("friction", "finite number >= 0")),
    "friction as text": (lambda: slider(friction="0.3"), ("friction", "coefficient >= 0 or a Friction")),
    "drive as a number": (lambda: slider(drive=1.0), ("drive", "fb.Drive(speed=")),
    "several drives": (lambda: slider(drive=[fb.Drive(speed=1.0), fb.Drive(force=1.0)]), ("slider 's'", "a slider has one "
                                                                                                        "drive")),
    "stops as a pair": (lambda: slider(stops=(0.2, 0.8)), ("stops", "fb.Stops(start, end)")),
    "stops beyond the beam": (lambda: slider(stops=fb.Stops(0.2, 1.8)), ("end=1.8 m lies beyond", "0 to 1 m")),
    "stops that exclude the start": (lambda: slider(stops=fb.Stops(0.6, 0.8)),
                                     ("must enclose its place at=0.5", "start between them")),
    "stops the wrong way round": (lambda: fb.Stops(0.8, 0.2), ("start must lie before end",)),
    "no stop": (lambda: fb.Stops(), ("give start=, end= or both",)),
    "elastic and rigid": (lambda: fb.Stops(0.1, 0.2, stiffness=1.0, restitution=0.5), ("not both",)),
    "restitution above 1": (lambda: fb.Stops(0.1, restitution=1.5), ("restitution", "<= 1")),
    "empty drive": (lambda: fb.Drive(), ("give position=, speed= or force=",)),
    "two drives": (lambda: fb.Drive(position=0.1, speed=1.0), ("both prescribe the motion",)),
    "force and speed": (lambda: fb.Drive(force=0.1, speed=1.0), ("force= cannot be combined with a controller",)),
    "limit of a prescribed motion": (lambda: fb.Drive(speed=1.0, limit=2.0), ("limit= bounds the force of a controller",)),
    "stiffness without a place": (lambda: fb.Drive(speed=1.0, stiffness=2.0), ("stiffness= needs position=",)),
    "force of two arguments": (lambda: fb.Drive(force=lambda t, s: 1.0), ("one argument (t) or three",)),
    "force that fails": (lambda: fb.Drive(force=lambda t, s, v: 1.0 / 0.0), ("must not fail", "ZeroDivisionError")),
    "force that numba does not know": (lambda: model(drive=fb.Drive(force=lambda t, s, v: float(str(1.0 + s)))),
                                       ("slider 's'", "numba cannot compile its drive's force", "math and numpy")),
    "position that begins elsewhere": (lambda: model(drive=fb.Drive(position=lambda t: 0.2 + t)),
                                       ("begins at position(0) = 0.2 m", "the slider at 0.5 m")),
    "rate and drive": (lambda: slider(rate=1.0, drive=fb.Drive(speed=2.0)), ("rate=1 m/s", "begins with 2 m/s")),
    "rigid stop and prescribed motion": (lambda: slider(drive=fb.Drive(speed=1.0), stops=fb.Stops(0.2, 0.8)),
                                         ("prescribes the motion", "give the stops a stiffness")),
    "drive elsewhere at the start": (lambda: fb.simulate(model(drive=fb.Drive(position=lambda t: 0.5 + 0.1 * t)),
                                                         start=fb.Start(time=1.0),
                                                         t_end=1.1, step=0.01),
                                                         ("is at s = 0.5 m", "prescribes 0.6 m", "Start(state, time=...)")),
    "start beyond a stop": (lambda: fb.simulate(model(stops=fb.Stops(0.1, 0.55)), t_end=0.1, step=0.01,
                                                start=model(friction=0.1).state()._replace(s=np.array([0.6]))),
                            ("beyond its stops (0.1 to 0.55 m)",)),
    "order 4 with friction": (lambda: fb.simulate(model(friction=0.1), t_end=0.1, step=0.01, order=4), ("order=4", "order=2")),
    "midpoint with friction": (lambda: fb.simulate(model(friction=0.1), t_end=0.1, step=0.01, method="midpoint"),
                               ("midpoint", "use the default method")),
    "interval of rest without friction": (lambda: fb.solve_static(held(), rest_intervals="s"), ("slider 's'", "friction=")),
    "interval of rest of what is held": (lambda: fb.solve_static(held(friction=0.1), held="s", rest_intervals="s"),
                                         ("slider 's'", "is locked")),
    "interval of rest of nobody": (lambda: fb.solve_static(held(friction=0.1), rest_intervals="t"),
                                   ("rest_intervals", "no slider 't'", "'s'")),
    "equilibrium at no time": (lambda: fb.solve_static(held(drive=fb.Drive(position=lambda t: 0.5 + t))), ("drives", "at_time=")),
    "equilibrium beyond the beam": (lambda: fb.solve_static(held(drive=fb.Drive(position=lambda t: 0.5 + t)), at_time=2.0),
                                    ("slider 's'", "s = 2.5 m", "0 to 1 m")),
    "equilibrium with a position that fails": (lambda: fb.solve_static(held(drive=fb.Drive(
        position=lambda t: 0.5 if t == 0.0 else np.nan)), at_time=2.0), ("slider 's'", "position", "finite number")),
    "friction of a bore of no length": (lambda: sleeve(friction=0.1, length=0.0), ("sleeve 's'", "length=")),
    "friction of a bore of unknown length": (lambda: sleeve(friction=0.1), ("sleeve 's'", "length=")),
    "key of a sleeve that is not keyed": (lambda: sleeve(length=0.1, keyed=False, key_radius=0.1), ("key_radius", "keyed=False")),
    "friction of a twist that is held": (lambda: sleeve(length=0.1, friction=0.1, radius=0.01),
                                         ("radius", "keyed=True", "key_radius=")),
    "friction of a twist without a coefficient": (lambda: sleeve(length=0.1, keyed=False, radius=0.01), ("radius", "friction=")),
    "smoothed friction of a twist": (lambda: sleeve(length=0.1, keyed=False, radius=0.01, friction=fb.Friction(
        0.1, smoothing=0.1)), ("radius", "Coulomb", "smoothing")),
    "nan on the way": (lambda: fb.simulate(model(drive=fb.Drive(position=lambda t: 0.5 if t < 0.05 else np.nan)), t_end=0.1,
                                           step=0.01), ("slider 's'", "position", "finite number")),
}


@pytest.mark.parametrize("case", WRONG)
def test_message_says_what_is_wrong(case: str) -> None:
    call, words = WRONG[case]
    with pytest.raises(fb.SceneError) as caught:
        call()
    for word in words:
        assert word in str(caught.value), str(caught.value)


def test_equilibria_with_held_sliders_take_friction() -> None:
    result = fb.solve_static(model(friction=0.1), held=True)
    assert result.slider("s")["s"][-1] == 0.5


@pytest.mark.parametrize("drive", [fb.Drive(speed=-0.4), fb.Drive(position=lambda t: 0.5 - 0.4 * t)], ids=["speed", "position"])
def test_a_prescribed_motion_and_friction_do_not_contradict_each_other(drive: fb.Drive) -> None:
    """The drive gives what friction takes and the mass gets."""
    load = fb.Load("push", BEAM.end, force=(0, 0, 0.05))
    driven = fb.Scene(BEAM, MASS, fb.Clamp(BEAM.start), slider(drive=drive, friction=0.3), load, gravity=(0, 0, -1.0))
    result = fb.simulate(fb.compile_scene(driven), t_end=0.5, step=1e-3, every=1, progress=False)
    s = result.slider("s")
    np.testing.assert_allclose(s["s"], 0.5 - 0.4 * result.t, atol=1e-12)
    assert s["friction_loss"][-1] > 1e-3 and np.all(np.diff(s["friction_loss"]) >= 0.0) and s["drive_work"][-1] > 0.0
    assert balanced(result)


def test_a_prescribed_motion_gives_the_rate() -> None:
    assert slider(drive=fb.Drive(speed=0.3)).rate == 0.3
    assert slider(drive=fb.Drive(position=0.5)).rate == 0.0
    assert abs(slider(drive=fb.Drive(position=lambda t: 0.5 + np.sin(t))).rate - 1.0) < 1e-9
    assert slider(drive=fb.Drive(force=1.0)).rate is None


def test_a_scene_without_forces_along_beams_has_none_of_their_arrays() -> None:
    plain = fb.compile_scene(fb.Scene(BEAM, MASS, fb.Clamp(BEAM.start), slider()))
    assert plain.slider_forces is None and plain.state().history.size == 0
    result = fb.simulate(plain, t_end=0.01, step=1e-3, progress=False)
    assert "friction_loss" not in result.series and "balance" not in result.series
    assert result.info["conserved"] == ["gap", "total"]


def test_a_checkpoint_belongs_to_its_stops(tmp_path: Any) -> None:
    early = fb.simulate(model(stops=fb.Stops(0.1, 0.9)), t_end=0.01, step=1e-3, progress=False)
    with pytest.raises(fb.SceneError, match="belongs to another model"):
        fb.simulate(model(stops=fb.Stops(0.1, 0.8)), start=early.checkpoint, t_end=0.02, step=1e-3, progress=False)


def test_results_with_forces_are_written_and_read(tmp_path: Any) -> None:
    result = fb.simulate(model(friction=0.1, rate=0.1, drive=fb.Drive(force=0.05)), t_end=0.05, step=1e-3, progress=False,
                         output=tmp_path / "r.h5")
    again = fb.load_result(tmp_path / "r.h5")
    for name in ("friction_force", "drive_work", "force_along", "stop_loss"):
        assert np.array_equal(again.slider("s")[name], result.slider("s")[name])
    table = again.table().splitlines()
    assert any(line.startswith("energy balance") for line in table)
    at = next(k for k, line in enumerate(table) if line.startswith("parts of the balance"))
    rows = {line.split(" [J]")[0]: [float(x) for x in line.split("[J]")[1].split()] for line in table[at + 1:]}
    assert {"friction of slider 's'", "drive of slider 's'"} <= rows.keys()
    assert rows["friction of slider 's'"] == pytest.approx([0.0, result.series["friction_loss"][-1, 0]], rel=1e-8)
    assert np.array_equal(again.balance()["sum"], result.balance()["sum"])


def test_a_plane_accounts_for_the_loads_that_its_scene_does() -> None:
    # a moment of round-off size within the plane is none there
    load = fb.Load("push", BEAM.end, force=(0, 0, 0.1), moment=(1e-17, 0, 0))
    slide = slider(friction=0.1, rate=0.2)
    found = fb.compile_scene(fb.Scene(BEAM, MASS, fb.Clamp(BEAM.start), load, slide, gravity=(0, 0, -1.0)))
    assert found.plane is not None and found.accounts_loads
    assert found.plane.model.accounts_loads and found.plane.model.history_size == found.history_size
    result = fb.simulate(found, t_end=0.05, step=1e-3, progress=False)
    assert result.drift("balance") < 1e-12 and result.state.history.size == found.history_size
