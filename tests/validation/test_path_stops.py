"""Paths that end at a wanted value of a quantity, located to round-off (theory.md 12)."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb

SECTION = fb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=1e-4, rhoI3=1e-4)


def truss() -> tuple[Any, Any]:
    top = fb.PointMass("top", mass=1.0, position=(0, 0, 0.5))
    bars = [fb.Spring(top, fb.GROUND.point((x, 0, 0)), f"bar {x}", stiffness=100.0) for x in (-1, 1)]
    return fb.compile_scene(fb.Scene(top, *bars, fb.Load("push", top, force=(0, 0, -20.0))), planar=True), top


def force(z: float) -> float:
    length = np.hypot(1.0, z)
    return float(2.0 * 100.0 * (length - np.hypot(1.0, 0.5)) * z / length)


@pytest.mark.parametrize("z", [0.4, 0.05, -0.3])
def test_a_path_ends_where_a_node_is(z: float) -> None:
    """Before, between and behind the limit points of a truss, whose load at a height is known."""
    model, top = truss()
    path = fb.solve_path(model, stop={("top", "z"): z}, points={"top": top})
    assert path.point("top")[-1, 2] == pytest.approx(z, abs=1e-12)
    assert -20.0 * path.series["load_factor"][-1] == pytest.approx(force(z), abs=1e-9)
    event = path.events[-1]
    assert event["kind"] == "wanted" and "z at 'top'" in event["text"] and event["time"] == path.t[-1]
    assert len(path.info["critical_points"]) == {0.4: 0, 0.05: 1, -0.3: 2}[z]
    # of several the first, of one that it begins at none
    both = fb.solve_path(model, stop={("top", "z"): z, (lambda state: float(state.q[2])): 0.45}, points={"top": top})
    assert both.point("top")[-1, 2] == pytest.approx(0.45, abs=1e-12)
    same = fb.solve_path(model, stop={("top", "z"): 0.5}, points={"top": top})
    assert same.series["load_factor"][-1] == 1.0


def test_a_path_ends_at_a_section_force_and_at_a_moment() -> None:
    rod = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=SECTION, elements=8)
    pull = fb.Load("pull", rod.end, force=(7.0, 3.0, 0))
    model = fb.compile_scene(fb.Scene(rod, fb.Clamp(rod.start), pull))
    at = {"root": (rod, 0.0), "tip": rod.end}
    path = fb.solve_path(model, stop={("root", "N"): 2.5}, points=at, observe=("section",))
    assert path.section("root")["N"][-1] == pytest.approx(2.5, abs=1e-11)
    # the clamp does not turn: N there is the load, but for what an element does not show
    assert 7.0 * path.series["load_factor"][-1] == pytest.approx(2.5, rel=1e-3)
    whole = fb.solve_path(model, points=at, observe=("section",))
    wanted = 0.5 * whole.section("root")["M3"][-1] + 0.5 * whole.section("root")["M3"][0]
    bent = fb.solve_path(model, stop={("root", "M3"): wanted}, points=at, observe=("section",))
    assert bent.section("root")["M3"][-1] == pytest.approx(wanted, abs=1e-11)


def test_a_path_ends_where_a_slider_is() -> None:
    wire = fb.Beam.arc("wire", (-1, 0, 0), (0, 0, -1), (1, 0, 0), radius=1.0, angle=np.pi, section=SECTION, elements=8)
    bead = fb.PointMass("bead", mass=1.0)
    slides = fb.Slider("slide", bead, wire, at=0.5 * wire.length)
    side = fb.Load("side", bead, force=(2.0, 0, 0), time=lambda t: t)
    scene = fb.Scene(wire, fb.Clamp(wire.start), fb.Clamp(wire.end), bead, slides, side, gravity=(0, 0, -1.0))
    model = fb.compile_scene(scene)
    start = fb.solve_static(model, at_time=0.0)
    path = fb.solve_path(model, start=start.state, at_time=(0.0, 1.0), stop={"slide": 1.8})
    assert path.state.s[0] == pytest.approx(1.8, abs=1e-11) and 0.0 < path.series["load_factor"][-1] < 1.0
    # where the sum of both forces is across a wire that hardly bends
    angle = 1.8 - 0.5 * np.pi
    assert 2.0 * path.series["load_factor"][-1] == pytest.approx(np.tan(angle), rel=0.2)


@pytest.mark.parametrize(("stop", "message"), [
    ({}, "stop: must be a mapping of quantities"), (3.0, "stop: must be a mapping of quantities"),
    ({("tip", "z"): np.inf}, "stop: the value of .* must be a finite number"), ({("top", "q"): 0.1}, "'top' has no quantity 'q'"),
    ({("tip", "z"): 0.1}, "'tip' is not a name in points="), ({"ring": 1.0}, "has no slider 'ring'"),
    ({("top", "N"): 1.0}, "lies on no beam"), ({3: 1.0}, "3 is not a quantity"),
    ({(lambda state: None): 1.0}, "must return a finite number"),
    ({(lambda t, state: 0.0): 1.0}, "stop: <lambda> must be a function of .state., got one of .t, state."),
    ({(lambda: 0.0): 1.0}, "must be a function of .state., got one of ..")])
def test_what_cannot_be_wanted_is_refused(stop: Any, message: str) -> None:
    model, top = truss()
    with pytest.raises(fb.SceneError, match=message):
        fb.solve_path(model, stop=stop, points={"top": top})
