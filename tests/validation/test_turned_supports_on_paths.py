"""Equilibrium paths along which supports turn: `solve_path(moves={support: (dx, dy, dz, rx, ry, rz)})` (theory.md 12)."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import fastbeam as fb

SHAFT = fb.Section(EA=1e7, GA2=1e7, GA3=1e7, GJ=100.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=1e-4, rhoI3=1e-4)
SOFT = fb.Section(EA=1e4, GA2=4e3, GA3=4e3, GJ=1.5, EI2=2.0, EI3=2.0, rhoA=1.0, rhoI2=1e-4, rhoI3=1e-4)


def test_shaft_of_greenhill_on_a_path() -> None:
    """M L/EI = 2 x with tan x = x (A. G. Greenhill, 1883), met on the way of the turning end."""
    exact = 2.0 * brentq(lambda x: np.tan(x) - x, 4.4, 4.6, xtol=1e-14)
    shaft = fb.Beam.straight("shaft", (0, 0, 0), (1, 0, 0), section=SHAFT, elements=16)
    end = fb.PrescribedMotion("turn", shaft.end, rotation=lambda t: (t, 0, 0), axes="yz")
    model = fb.compile_scene(fb.Scene(shaft, fb.Clamp(shaft.start), end))
    result = fb.solve_path(model, moves={end: (0, 0, 0, 0.12, 0, 0)}, stop_at="bifurcation", observe=("reaction",))
    moment = result.reaction('turn')["moment"][-1]
    assert moment[0] == pytest.approx(exact, rel=1e-6)
    assert result.info["critical_points"][-1]["load_factor"] * 12.0 == pytest.approx(exact, rel=1e-6)


def test_many_turns_of_a_shaft() -> None:
    """A soft shaft that is held straight by its tension: T = GJ angle/L after two turns."""
    rod = fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=SOFT, elements=80, prestress=100.0)
    clamps = fb.Clamp(rod.start), fb.Clamp(rod.end)
    angle = 4.0 * np.pi
    model = fb.compile_scene(fb.Scene(rod, *clamps))
    result = fb.solve_path(model, moves={clamps[1]: (0, 0, 0, angle, 0, 0)}, points={"middle": rod.node(120)},
                           observe=("section", "reaction"), largest_step=1.0)
    assert result.series["load_factor"][-1] == 1.0
    np.testing.assert_allclose(result.section("middle")["T"], 1.5 * angle / 2.0 * result.series["load_factor"], rtol=1e-6)
    assert np.max(np.abs(result.series["unstable_directions"])) == 0.0


TURN, WAY = np.array((0.2, 0.5, -0.7)), np.array((0.1, 0.0, 0.05))


def test_a_pin_is_not_turned() -> None:
    rod = fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=SOFT, elements=4)
    pin = fb.Pin(rod.end)
    model = fb.compile_scene(fb.Scene(rod, fb.Clamp(rod.start), pin))
    with pytest.raises(fb.SceneError, match="moves= turns beam 'rod' node 12, but no support fixes its rotation"):
        fb.solve_path(model, moves={pin: (0, 0, 0, 1.0, 0, 0)})
    with pytest.raises(fb.SceneError, match="must be 3 finite numbers, m, or 6 with a rotation vector, rad, got"):
        fb.solve_path(model, moves={pin: (0, 0, 0, 1.0)})


def test_a_support_at_a_point_of_a_body() -> None:
    hub = fb.RigidBody("hub", mass=1.0, inertia=(1, 1, 1), position=(0, 0, 0))
    rod = fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=SOFT, elements=2)
    clamp = fb.Clamp(hub.point((0.3, 0, 0)))
    model = fb.compile_scene(fb.Scene(hub, rod, clamp, fb.RigidConnection(hub, rod.start)))
    with pytest.raises(fb.SceneError, match="a support there fixes the whole body; name body 'hub'"):
        fb.solve_path(model, moves={clamp: (0, 0, 0, 0, 0, 1.0)})
    assert fb.solve_path(model, moves={hub: (0, 0, 0, 0, 0, 1.0)}).series["load_factor"][-1] == 1.0


def machine(moves: bool) -> tuple[fb.Model, Any, dict[str, Any]]:
    """A body that carries a beam, a ring on this, a strut on a hinge beside the body and a rod from there to the ground; what
    turns is the body."""
    hub = fb.RigidBody("hub", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0.3, 0, 0))
    arm = fb.Beam.straight("arm", (0.3, 0, 0), (1.5, 0, 0), section=SOFT, elements=4)
    strut = fb.Beam.straight("strut", (0.3, 0.4, 0), (0.3, 0.4, 1.0), section=SOFT, elements=3)
    ring, bob = fb.PointMass("ring", mass=1.0), fb.PointMass("bob", mass=1.0, position=(0.3, -0.4, -0.5))
    support = fb.Clamp(hub) if not moves else fb.PrescribedMotion("turn", hub, displacement=lambda t: t * WAY,
                                                                  rotation=lambda t: t * TURN)
    hinge = fb.RevoluteJoint(hub.point((0, 0.4, 0)), strut.start, "hinge", axis=(0, 1, 0), stiffness=2.0)
    rod = fb.DistanceJoint(hub.point((0, -0.4, 0)), bob, "rod")
    springs = [fb.Spring(a, fb.GROUND.point(b), name, stiffness=k, length=0.2) for name, a, b, k in (
        ("pull", ring, (1.1, 0.1, -0.5), 30.0), ("stay", strut.end, (0.5, 0.2, 1.5), 20.0),
        ("keep", bob, (0.2, -0.8, -1.5), 10.0))]
    scene = fb.Scene(hub, arm, strut, ring, bob, support, fb.RigidConnection(hub, arm.start), hinge, rod, *springs,
                     fb.Slider("slider", ring, on=arm, at=0.7), project_velocities=True)
    return fb.compile_scene(scene), support, {"tip": arm.end, "top": strut.end, "bob": bob, "ring": ring}


def test_where_supports_turn_scenes_are_as_solve_static_finds_them() -> None:
    """Sliders, hinges, rods and beams on a body that turns and moves on: half the way and all of it."""
    model, clamp, points = machine(False)
    start = fb.solve_static(model).state
    for to in (0.5, 1.0):
        path = fb.solve_path(model, moves={clamp: (*WAY, *TURN)}, start=start, to=to, points=points, observe=("reaction",))
        moving, _, same = machine(True)
        found = fb.solve_static(moving, at_time=to, points=same, observe=("reaction",))
        for name in points:
            np.testing.assert_allclose(path.point(name)[-1], found.point(name)[-1], atol=1e-10, err_msg=name)
        np.testing.assert_allclose(path.series["s_slide"][-1], found.series["s_slide"][-1], atol=1e-10)
        reaction = [x.reaction(name) for x, name in ((path, "clamp of body 'hub'"), (found, 'turn'))]
        for kind in ("force", "moment"):
            np.testing.assert_allclose(reaction[0][kind][-1], reaction[1][kind][-1], atol=1e-8)


def test_energy_along_the_path_is_the_work_of_the_turning_support() -> None:
    """dW = M . r dL: the rate of the energy by the load factor, by differences of paths, is what the support takes."""
    model, clamp, _ = machine(False)
    start = fb.solve_static(model).state
    h = 1e-3

    def at(to: float) -> fb.Result:
        return fb.solve_path(model, moves={clamp: (*WAY, *TURN)}, start=start, to=to, observe=("reaction", "energy"))

    energies = [at(0.8 + k * h).series["potential"][-1] for k in (-2, -1, 1, 2)]
    rate = np.dot((1.0, -8.0, 8.0, -1.0), energies) / (12.0 * h)
    holds = at(0.8).reaction("clamp of body 'hub'")
    assert rate == pytest.approx(holds["force"][-1] @ WAY + holds["moment"][-1] @ TURN, rel=1e-8)


def arch(planar: bool | str) -> tuple[fb.Model, Any, Any]:
    """A shallow arch between clamps, one of which is turned: it snaps through."""
    def place(s: float) -> Any:
        return np.array((s, 0.0, 0.12 * np.sin(np.pi * s)))

    beam = fb.Beam.through_points("arch", [place(s) for s in np.linspace(0, 1, 9)], section=fb.Section(
        EA=1e5, GA2=4e4, GA3=4e4, GJ=1.0, EI2=1.0, EI3=3.0, rhoA=1.0, rhoI2=1e-4, rhoI3=1e-4), elements=8)
    clamp = fb.Clamp(beam.end)
    return fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), clamp), planar=planar), clamp, beam


def test_arch_that_snaps_where_its_end_turns() -> None:
    """In the plane and in space the same path with the same limit points, and every row in equilibrium: from it Newton's method
    with the support where it stands does not move."""
    rows = []
    for planar in (True, False):
        model, clamp, beam = arch(planar)
        result = fb.solve_path(model, moves={clamp: (0, 0, 0, 0, 2.5, 0)}, points={"top": beam.node(12)},
                               most_points=200, largest_step=0.02, observe=("reaction", "energy"))
        rows.append(result)
        assert [x["kind"] for x in result.info["critical_points"]][:1] == ["limit"]
    limits = [[x["load_factor"] for x in result.info["critical_points"] if x["kind"] == "limit"] for result in rows]
    np.testing.assert_allclose(limits[0], limits[1], rtol=1e-9)
