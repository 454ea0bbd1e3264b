"""Statics of planar structures that only pins hold, where stability is counted, and at which load factors rows stand."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import fastbeam as fb

# round, so slender that shear and extension do not count
SECTION = fb.Section(EA=1e9, GA2=1e9, GA3=1e9, GJ=80.0, EI2=100.0, EI3=100.0, rhoA=2.0, rhoI2=1e-4, rhoI3=1e-4)


def beam(name: str, start: tuple[float, ...], end: tuple[float, ...], elements: int = 8,
         section: fb.Section = SECTION) -> fb.Beam:
    return fb.Beam.straight(name, start, end, section=section, elements=elements)


def on_two_pins(*more: Any, gravity: tuple[float, float, float] = (0, 0, -1e-5)) -> tuple[fb.Beam, fb.Scene]:
    b = beam("girder", (0, 0, 0), (4, 0, 0))
    return b, fb.Scene(b, fb.Pin(b.start), fb.Pin(b.end), *more, gravity=gravity)


# ------------------------------------------------------------------------------------------------------- what stands on pins
@pytest.mark.parametrize("planar", ["auto", True])
def test_simply_supported_beam_sags_as_it_should(planar: bool | str) -> None:
    b, scene = on_two_pins()
    result = fb.solve_static(fb.compile_scene(scene, planar=planar), points={"middle": b.at(2.0)})
    # 5 q L^4 / (384 EI)
    assert result.point("middle")[-1, 2] == pytest.approx(-5 * 2e-5 * 4.0**4 / (384 * 100.0), rel=1e-4)
    # in space a round one may spin about its axis
    found = "counted_in", "unstable_directions", "free_directions"
    assert [result.info[name] for name in found] == (["plane", 0, 0] if planar is True else ["space", 0, 1])


def test_cable_between_two_pins_is_a_catenary() -> None:
    a, span = 1.5, 2.0
    rope = fb.Section(EA=1e7, GA2=1e7, GA3=1e7, GJ=1e-2, EI2=1e-2, EI3=1e-2, rhoA=1.0, rhoI2=1e-6, rhoI3=1e-6)
    # bent on a parabola first, of the length that the catenary between (-1, 0) and (1, 0) has
    wanted = 2.0 * a * np.sinh(span / (2.0 * a))

    def arch(sag: float) -> fb.Beam:
        return fb.Beam.from_curve("rope", lambda t: (2.0 * t - 1.0, 0.0, -4.0 * sag * t * (1.0 - t)), section=rope, elements=24)

    cable = arch(brentq(lambda sag: arch(sag).length - wanted, 0.1, 1.0, xtol=1e-10))
    scene = fb.Scene(cable, fb.Pin(cable.start), fb.Pin(cable.end), gravity=(0, 0, -9.81))
    result = fb.solve_static(fb.compile_scene(scene), points={"lowest": (cable, 0.5 * cable.length)})
    assert result.point("lowest")[-1, 2] == pytest.approx(-a * (np.cosh(span / (2.0 * a)) - 1.0), rel=2e-3)
    assert result.info["unstable_directions"] == 0


def frame(push: float) -> fb.Scene:
    left, right = beam("left", (0, 0, 0), (0, 0, 2), 6), beam("right", (2, 0, 0), (2, 0, 2), 6)
    top = beam("top", (0, 0, 2), (2, 0, 2), 6)
    return fb.Scene(left, right, top, fb.Pin(left.start), fb.Pin(right.start), fb.RigidConnection(left.end, top.start),
                    fb.RigidConnection(right.end, top.end), fb.Load("a", top.start, force=(0, 0, -push)),
                    fb.Load("b", top.end, force=(0, 0, -push)))


@pytest.mark.parametrize("share", [0.5, 0.99, 1.01])
def test_portal_frame_on_pins_becomes_unstable_at_its_sway_load(share: float) -> None:
    # columns and girder alike: k h tan(k h) = 6
    critical = brentq(lambda x: x * np.tan(x) - 6.0, 1.0, 1.5) ** 2 * 100.0 / 2.0**2
    result = fb.solve_static(fb.compile_scene(frame(share * critical)))
    assert result.info["unstable_directions"] == int(share > 1.0)
    assert [event["kind"] for event in result.events] == ["unstable"] * (share > 1.0)
    assert all("1 negative eigenvalue(s) in the plane of the scene" in event["text"] for event in result.events)


def test_planar_structure_that_is_not_held_in_its_plane_is_refused() -> None:
    b = beam("girder", (0, 0, 0), (4, 0, 0))
    with pytest.raises(fb.SceneError, match=r"turn about \(0, 1, 0\) \(1 of 3 rigid motions in its plane are free\); add a"):
        fb.solve_static(fb.compile_scene(fb.Scene(b, fb.Pin(b.start), gravity=(0, 0, -1))))


def test_message_in_space_names_the_plane_where_that_would_do() -> None:
    _, scene = on_two_pins()
    with pytest.raises(fb.SceneError, match="1 of 6 .*; it is supported within its plane: compile the scene with planar=True"):
        fb.solve_static(fb.compile_scene(scene, planar=False))
    b, scene = on_two_pins()
    scene.add(fb.Load("aside", b.node(4), force=(0, 1, 0)))
    with pytest.raises(fb.SceneError, match="the scene is not planar: the load on beam 'girder' node 4 points out of the plane"):
        fb.solve_static(fb.compile_scene(scene))


def test_where_stability_is_counted() -> None:
    """A flat column that buckles out of its plane first: seen in space, not asked for with planar=True."""
    flat = fb.Section(EA=1e9, GA2=1e9, GA3=1e9, GJ=80.0, EI2=400.0, EI3=100.0, rhoA=2.0, rhoI2=1e-4, rhoI3=1e-4)
    found = {}
    for planar in ("auto", True):
        column = beam("column", (0, 0, 0), (1, 0, 0), section=flat)
        push = fb.Load("push", column.end, force=(-2.0 * 100.0 * np.pi**2 / 4.0, 0, 0))
        hint = fb.Load("upwards", column.end, force=(0, 0, 1e-3))          # makes xz the plane
        result = fb.solve_static(fb.compile_scene(fb.Scene(column, fb.Clamp(column.start), push, hint), planar=planar))
        found[planar] = (result.info["counted_in"], result.info["unstable_directions"])
        assert all(event["text"].count("in space") == 1 for event in result.events)
    assert found == {"auto": ("space", 1), True: ("plane", 0)}


# ----------------------------------------------------------------------------------------------------------------- moments
def bent(moment: tuple[float, float, float]) -> fb.Scene:
    rod = beam("rod", (0, 0, 0), (2, 0, 0), 10)
    return fb.Scene(rod, fb.Clamp(rod.start), fb.Load("end", rod.end, moment=moment))


def test_small_moments_leave_an_equilibrium_that_is_called_stable() -> None:
    for moment in ((0, 30.0, 0), (10.0, 20.0, 0)):
        info = fb.solve_static(fb.compile_scene(bent(moment), planar=False)).info
        assert (info["counted_in"], info["unstable_directions"], info["free_directions"]) == ("space", 0, 0)


def test_large_moments_are_decided_in_the_plane_or_not_at_all() -> None:
    rolled = (0, 2 * np.pi * 100.0 / 2.0, 0)          # to a circle
    info = fb.solve_static(fb.compile_scene(bent(rolled))).info
    assert (info["counted_in"], info["unstable_directions"]) == ("plane", 0)
    info = fb.solve_static(fb.compile_scene(bent(rolled), planar=False)).info
    assert (info["counted_in"], info["unstable_directions"]) == ("space", None)


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_column_with_a_moment_in_space_becomes_unstable(share: float) -> None:
    # a moment about the axis lowers Euler's load, this one by next to nothing; the two bending directions are split by 2 in 1
    oval = fb.Section(EA=1e9, GA2=1e9, GA3=1e9, GJ=80.0, EI2=200.0, EI3=100.0, rhoA=2.0, rhoI2=1e-4, rhoI3=1e-4)
    column = beam("column", (0, 0, 0), (2, 0, 0), section=oval)
    loads = fb.Load("end", column.end, force=(-share * np.pi**2 * 100.0 / 16.0, 0, 0), moment=(0.1, 0, 0))
    result = fb.solve_static(fb.compile_scene(fb.Scene(column, fb.Clamp(column.start), loads)))
    assert result.info["counted_in"] == "space"
    assert result.info["unstable_directions"] == int(share > 1.0)


# --------------------------------------------------------------------------------------------------------------- load steps
def test_rows_stand_at_the_levels_asked_for() -> None:
    b, scene = on_two_pins()
    model = fb.compile_scene(scene)
    levels = (0.1, 1.0 / 3.0, 0.7, 0.9)
    result = fb.solve_static(model, levels=levels, points={"middle": b.at(2.0)})
    assert set(levels) <= set(result.t.tolist()) and result.t[-1] == 1.0 and np.all(np.diff(result.t) > 0.0)
    free = fb.solve_static(model, points={"middle": b.at(2.0)})
    np.testing.assert_allclose(result.point("middle")[-1], free.point("middle")[-1], rtol=0.0, atol=1e-12)


def test_load_steps_stay_below_the_largest() -> None:
    _, scene = on_two_pins()
    model = fb.compile_scene(scene)
    assert np.diff(fb.solve_static(model, load_step=0.02).t).max() > 0.3
    steps = np.diff(fb.solve_static(model, load_step=0.02, largest_load_step=0.1).t)
    assert steps[0] == 0.02 and 0.09 < steps.max() <= 0.1 + 1e-12
    assert fb.solve_static(model, largest_load_step=0.1).t[1] == 0.1
