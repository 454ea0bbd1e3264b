"""Exact contacts with friction and rigid stops: capstans, beads on bent beams on any mesh, cones, what remains refused."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from test_static_friction import CAPSTAN, capstan

import fastbeam as fb

MASS, G = 20.0, 9.81


def inclined(elements: int, at: float = 1.3, mu: float | None = 0.05, angle: float = 0.0, EI: float = 150.0, planar: Any = "auto",
             **slide: Any) -> fb.Model:
    """A heavy bead on a bar of 3 m at this angle (degrees) between a clamp and a pin."""
    a = np.radians(angle)
    section = fb.Section(EA=1e6, GA2=4e5, GA3=4e5, GJ=EI, EI2=EI, EI3=EI, rhoA=1e-3, rhoI2=1e-6, rhoI3=1e-6)
    bar = fb.Beam.straight("bar", (0, 0, 0), (3 * np.cos(a), 0, 3 * np.sin(a)), section=section, elements=elements)
    bead = fb.PointMass("bead", mass=MASS)
    scene = fb.Scene(bar, bead, fb.Clamp(bar.start), fb.Pin(bar.end), fb.Slider("s", bead, bar, at=at, friction=mu, **slide),
                     gravity=(0, 0, -G))
    return fb.compile_scene(scene, planar=planar)


def exact(model: fb.Model, **settings: Any) -> fb.Result:
    return fb.solve_static(model, contacts="exact", **settings)


@pytest.mark.parametrize(("rings", "per_length"), [(1, 10), (5, 2), (5, 1)])
def test_a_capstan_of_rings(rings: int, per_length: int) -> None:
    model, tension = capstan(rings, per_length)
    result = exact(model, levels=(0.8, 0.9))
    off = [level / tension(result.phi[result.t_snap.tolist().index(level)]) / CAPSTAN[rings] - 1.0 for level in (0.8, 0.9, 1.0)]
    print(f"{rings} rings, {per_length} elements on the length that bends: off by {', '.join(f'{x:.1e}' for x in off)}")
    assert np.max(np.abs(off)) < 1e-4
    assert not any(x["sticks"] for x in result.info["friction"].values())


@pytest.mark.parametrize("planar", ["auto", False], ids=["plane", "space"])
def test_where_a_bead_can_rest_does_not_depend_on_the_mesh(planar: Any) -> None:
    found = {elements: exact(inclined(elements, planar=planar), rest_intervals="s") for elements in (16, 32)}
    one, other = (np.array(result.info["rest_intervals"]["s"]) for result in found.values())
    mesh = fb.solve_static(inclined(16, planar=planar), rest_intervals="s").info["rest_intervals"]["s"]
    print(f"intervals {one}, {other}, of 16 elements on their mesh {mesh}")
    assert np.max(np.abs(one - other)) < 2e-5 and np.max(np.abs(np.array(mesh) - other)) > 1e-3
    for result in found.values():
        bead, friction = result.slider("s"), result.info["friction"]["s"]
        assert result.state.s[0] == 1.3 and friction["sticks"]
        # no more than two digits of the cancellation of both ends are lost
        assert bead["friction_force"][-1] == pytest.approx(bead["force_along"][-1], rel=1e-12)
        # the weight, whatever part of it friction carries; c' is longer than 1 by the strain
        assert np.hypot(friction["force"], friction["cone"] / 0.05) / (MASS * G) == pytest.approx(1.0, abs=2e-3)
    needed = [result.info["friction"]["s"]["force"] for result in found.values()]
    assert needed[0] == pytest.approx(needed[1], rel=1e-5)


def test_friction_at_the_end_of_an_interval_is_its_cone() -> None:
    """Started there, a bead needs all its friction, to round-off of the place."""
    low, high = exact(inclined(8), rest_intervals="s").info["rest_intervals"]["s"]
    for at, sign in ((low, -1.0), (high, 1.0)):
        friction = exact(inclined(8, at=at, mu=0.06)).info["friction"]["s"]
        assert sign * friction["force"] / friction["cone"] == pytest.approx(0.05 / 0.06, rel=1e-9)


@pytest.mark.parametrize("planar", ["auto", False], ids=["plane", "space"])
def test_a_bead_slips_to_the_end_of_its_interval(planar: Any) -> None:
    for at, end in ((0.5, 0), (2.8, 1)):
        result = exact(inclined(8, at=at, mu=0.02, planar=planar), rest_intervals="s")
        friction = result.info["friction"]["s"]
        assert not friction["sticks"] and abs(friction["force"]) == pytest.approx((1.0 - 1e-5) * friction["cone"], rel=1e-8)
        reached = result.info["rest_intervals"]["s"][end]
        assert abs(result.state.s[0] - reached) < 1e-4 and (result.state.s[0] - reached) * (0.5 - end) > 0.0
        # a run from there sticks
        run = fb.simulate(inclined(8, at=at, mu=0.05, planar=planar), t_end=0.5, step=1e-3, start=result.state, progress=False)
        assert np.ptp(run.slider("s")["s"]) < 1e-9


@pytest.mark.parametrize("mu", [None, 0.2])
@pytest.mark.parametrize("planar", ["auto", False], ids=["plane", "space"])
def test_a_bead_comes_to_a_rigid_stop(planar: Any, mu: float | None) -> None:
    forces = []
    for elements in (8, 16):
        model = inclined(elements, mu=mu, angle=25.0, EI=2e3, planar=planar, stops=fb.Stops(0.41))
        result = exact(model)
        bead = result.slider("s")
        assert result.state.s[0] == 0.41 and bead["s"][-1] == 0.41
        forces.append((bead["stop_force"][-1], bead["friction_force"][-1]))
        assert sum(forces[-1]) == pytest.approx(bead["force_along"][-1], rel=1e-12)
        if mu:
            assert bead["friction_force"][-1] == pytest.approx(result.info["friction"]["s"]["cone"], rel=1e-12)
    np.testing.assert_allclose(forces[0], forces[1], rtol=2e-5, atol=1e-9)
    assert forces[0][0] > 40.0


def test_without_friction_and_stops_nothing_changes() -> None:
    """A stop that is not met, and friction of a coefficient that is nothing: the place of rest of the sliding bead."""
    free, stopped, rough = (exact(inclined(8, mu=mu, **more)).state.s[0] for mu, more in (
        (None, {}), (None, {"stops": fb.Stops(0.1, 2.9)}), (1e-9, {})))
    assert stopped == pytest.approx(free, abs=1e-9) and rough == pytest.approx(free, abs=1e-6)


def test_sleeves_with_friction_are_refused() -> None:
    section = fb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=1e-4, rhoI3=1e-4)
    rod = fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=section, elements=10)
    body = fb.RigidBody("holder", mass=1.0, inertia=(1, 1, 1), position=(1, 0, 0))
    scene = fb.Scene(rod, body, fb.Clamp(body), fb.Sleeve("sleeve", body, rod, at=1.0, friction=0.1, length=0.1),
                     fb.Load("tip", rod.end, force=(0, -0.1, 0)))
    with pytest.raises(fb.SceneError, match="sleeve 'sleeve' has friction"):
        exact(fb.compile_scene(scene))
