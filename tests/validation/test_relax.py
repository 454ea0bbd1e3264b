"""Equilibria found by motion, where Newton's method alone finds none or another one."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq, fsolve, minimize_scalar

import fastbeam as fb

Array = np.ndarray
G = 9.81
ROPE = fb.Section.circle(radius=0.004, E=1e7, rho=1200.0)
DOWN = (0.0, 0.0, -G)


def places(state: Any) -> Array:
    return np.asarray(state.q).reshape(-1, 4, 3)[:, 0]


def links(n: int, length: float, span: float) -> tuple[fb.Scene, list[fb.RigidBody]]:
    """n rigid links on ball joints between two points, at the start a bow upwards."""
    # the chord of an arc of equal links
    half = brentq(lambda a: np.sum(np.cos(np.linspace(a, -a, n))) * length - span, 1e-3, 3.0)
    hooks = [fb.PointMass(f"hook {k}", mass=1.0, position=(k * span, 0, 0)) for k in range(2)]
    at, before = np.zeros(3), np.zeros(3)
    bodies: list[fb.RigidBody] = []
    parts: list[Any] = [*hooks, *(fb.Clamp(hook) for hook in hooks)]
    for k, angle in enumerate(np.linspace(half, -half, n)):
        way = 0.5 * length * np.array([np.cos(angle), 0.0, np.sin(angle)])
        bodies.append(fb.RigidBody(f"link {k}", mass=0.3, inertia=(1e-3, 1e-3, 1e-3), position=at + way))
        a = hooks[0] if k == 0 else bodies[k - 1].point(before)
        parts += [bodies[-1], fb.BallJoint(a, bodies[-1].point(-way), name=f"joint {k}")]
        before, at = way, at + 2.0 * way
    end = fb.BallJoint(bodies[-1].point(before), hooks[1], name="last")
    return fb.Scene(*parts, end, gravity=DOWN), bodies


@pytest.mark.parametrize("n", [5, 10])
def test_chain_of_rigid_links_hangs_in_its_catenary(n: int) -> None:
    """Pull H along the chain, weights at the middles: tan of the angle of link k is (n/2 - k - 1/2) m g/H."""
    length, span = 0.2, 0.14 * n
    scene, bodies = links(n, length, span)
    model = fb.compile_scene(scene, planar=True)
    found = fb.relax(model, points={f"{k}": body for k, body in enumerate(bodies)})
    slope = (n / 2 - np.arange(n) - 0.5) * 0.3 * G
    pull = brentq(lambda h: np.sum(np.cos(np.arctan(slope / h))) * length - span, 1e-3, 1e3)
    angle = -np.arctan(slope / pull)
    way = length * np.stack((np.cos(angle), 0 * angle, np.sin(angle)), axis=1)
    middles = np.cumsum(way, axis=0) - 0.5 * way
    np.testing.assert_allclose([found.point(f"{k}")[-1] for k in range(n)], middles, atol=1e-10)
    assert found.info["finished"] and found.info["unstable_directions"] == 0
    # (15.1), from the first row to that before Newton's method
    potential = found.series["potential"]
    assert potential[0] - potential[-2] == pytest.approx(found.info["energy_loss"], rel=1e-11)
    # all that the motion lost and Newton's method took came from the height
    drop = 0.3 * G * sum(body.position[2] - x[2] for body, x in zip(bodies, middles))
    assert 0.5 * drop < found.info["energy_loss"] < drop * (1.0 + 1e-9)


def folded(side: float, elements: int = 10) -> fb.Scene:
    """Two ropes from two pins, 0.3 m apart, to a point 1 m away, joined there; side 1: aside and up, -1: its image, down."""
    tip = (0.5, 0.0, side * 0.85)
    one = fb.Beam.straight("one", (0, 0, 0), tip, section=ROPE, elements=elements)
    two = fb.Beam.straight("two", tip, (0.3, 0, 0), section=ROPE, elements=elements)
    return fb.Scene(one, two, fb.BallJoint(one.end, two.start), fb.Pin(one.start), fb.Pin(two.end), gravity=DOWN)


def test_folded_rope_falls_to_where_it_hangs() -> None:
    model = fb.compile_scene(folded(1.0), planar=True)
    found = fb.relax(model)
    hanging = fb.solve_static(fb.compile_scene(folded(-1.0), planar=True))
    assert hanging.info["unstable_directions"] == found.info["unstable_directions"] == 0
    np.testing.assert_allclose(places(found.state), places(hanging.state), atol=1e-7)
    assert fb.solve_static(model).info["unstable_directions"] > 0, "load steps from the same start stay above the pins"
    # ready to run: it stays
    run = fb.simulate(model, start=found.state, t_end=0.2, step=0.01, progress=False)
    assert np.max(run.series["kinetic"]) < 1e-12 * found.info["energy_loss"]


def net(side: float, joints: str = "rigid") -> Any:
    n = 5
    grid = np.stack(np.meshgrid(np.linspace(0, 2, n), np.linspace(0, 2, n), indexing="ij"), axis=-1).reshape(-1, 2)
    x, y = grid.T - 1.0
    nodes = np.stack((*grid.T, side * 0.8 * (1 - x**2) * (1 - y**2) + side * 0.1 * x), axis=1)
    number = np.arange(n * n).reshape(n, n)
    edges = np.concatenate((np.stack((number[:-1].ravel(), number[1:].ravel()), 1),
                            np.stack((number[:, :-1].ravel(), number[:, 1:].ravel()), 1)))
    rim = np.concatenate((number[0], number[-1], number[1:-1, 0], number[1:-1, -1]))
    roof = fb.Net("net", nodes, edges, section=ROPE, elements=2, degree=2, joints=joints, pins=rim)
    return fb.compile_scene(fb.Scene(roof, gravity=DOWN))


@pytest.mark.parametrize("joints", ["rigid", "ball"])
def test_slack_net_dropped_on_its_pins(joints: str) -> None:
    """From a dome to the bowl that hangs, its potential falling from swing to swing; an equilibrium to Newton's method, too."""
    model = net(1.0, joints)
    found = fb.relax(model)
    assert found.info["finished"] and found.info["unstable_directions"] == 0
    assert found.info["swings"] >= 2 and np.all(np.diff(found.series["potential"]) < 1e-9)
    assert np.min(places(found.state)[:, 2]) < -0.3, "it hangs"
    again = fb.solve_static(model, start=found.state, load_step=1.0)
    np.testing.assert_allclose(places(again.state), places(found.state), atol=1e-9)


def test_ring_far_from_its_place_on_a_hanging_cable() -> None:
    cable = fb.Beam.from_curve("cable", lambda t: (1.0 * t, 0, -0.3 * np.sin(np.pi * t) - 0.2 * t), section=ROPE, elements=16)
    ring = fb.PointMass("ring", mass=0.2)
    model = fb.compile_scene(fb.Scene(cable, ring, fb.Slider("run", ring, cable, at=0.1), fb.Pin(cable.start), fb.Pin(cable.end),
                                      gravity=DOWN))
    found, known = fb.relax(model), fb.solve_static(model)
    np.testing.assert_allclose(places(found.state), places(known.state), atol=1e-8)
    np.testing.assert_allclose(found.state.s, known.state.s, atol=1e-8)
    np.testing.assert_allclose(found.slider("run")["force"][-1], known.slider("run")["force"][-1], atol=1e-6)


def test_without_newton_and_from_a_start() -> None:
    model = fb.compile_scene(folded(1.0, 3), planar=True)
    exact = fb.relax(model)
    slow = fb.relax(model, finish=False)
    assert not slow.info["finished"] and slow.info["residual"] <= 1e-7
    np.testing.assert_allclose(places(slow.state), places(exact.state), atol=2e-4)
    again = fb.relax(model, start=slow.state)
    np.testing.assert_allclose(places(again.state), places(exact.state), atol=1e-9)
    # what rests already is told at once
    once = fb.relax(model, start=exact.state)
    assert once.info["steps"] < 30
    np.testing.assert_allclose(places(once.state), places(exact.state), atol=1e-9)


def test_loads_of_time_are_those_of_their_time() -> None:
    def scene(factor: Any, force: float) -> fb.Model:
        one = fb.Beam.straight("one", (0, 0, 0), (0.6, 0, 0.1), section=ROPE, elements=4)
        return fb.compile_scene(fb.Scene(one, fb.Pin(one.start), fb.Load("pull", one.end, force=(force, 0, 0), time=factor),
                                         gravity=DOWN), planar=True)

    steady, timed = fb.relax(scene(None, 0.5)), fb.relax(scene(lambda t: t * t, 0.125), at_time=2.0)
    np.testing.assert_allclose(places(timed.state), places(steady.state), atol=1e-9)
    with pytest.raises(fb.SceneError, match="relax: loads have time functions, so a time is needed; give the time with at_time="):
        fb.relax(scene(lambda t: t, 1.0))


def test_what_never_rests_says_so_and_brings_what_there_is() -> None:
    wheel = fb.RigidBody("wheel", mass=1.0, inertia=(1, 1, 1), position=(0, 0, 0))
    model = fb.compile_scene(fb.Scene(wheel, fb.RevoluteJoint(fb.GROUND, wheel, "axle", axis=(0, 1, 0)),
                                      fb.Load("turn", wheel, moment=(0, 1.0, 0))))
    with pytest.raises(fb.ConvergenceError, match="did not come to rest in 200 steps, 0 swings") as caught:
        fb.relax(model, most_steps=200)
    assert caught.value.result.info["steps"] == 200 and caught.value.state is not None
    with pytest.raises(fb.SceneError, match="it is not supported"):
        flying = fb.Beam.straight("flying", (0, 0, 0), (1, 0, 0), section=ROPE, elements=2)
        fb.relax(fb.compile_scene(fb.Scene(flying, gravity=DOWN)))
    bead, wire = fb.PointMass("bead", mass=1.0), fb.Beam.straight("wire", (0, 0, 0), (1, 0, -1), section=ROPE, elements=2)
    sliding = fb.Scene(wire, bead, fb.Slider("ride", bead, wire, at=0.3), fb.Clamp(wire.start), fb.Clamp(wire.end), gravity=DOWN)
    with pytest.raises(fb.ConvergenceError, match="slider 'ride' leaves its beam during relaxation"):
        fb.relax(fb.compile_scene(sliding))


def test_an_inverted_pendulum_stays_where_it_is_and_is_told() -> None:
    rod = fb.RigidBody("rod", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0, 0, 0.5))
    axle = fb.RevoluteJoint(fb.GROUND, rod.point((0, 0, -0.5)), "axle", axis=(0, 1, 0))
    model = fb.compile_scene(fb.Scene(rod, axle, gravity=DOWN))
    with pytest.raises(fb.ConvergenceError, match="has 1 unstable direction.*disturb it by a small load"):
        fb.relax(model, most_steps=300)
    nudged = fb.compile_scene(fb.Scene(rod, axle, fb.Load("nudge", rod, force=(0.1, 0, 0)), gravity=DOWN))
    found = fb.relax(nudged, points={"rod": rod})
    size = np.hypot(0.1, G)
    np.testing.assert_allclose(found.point("rod")[-1], (0.05 / size, 0, -0.5 * G / size), atol=1e-11)


def test_supports_that_could_move_stand_still_and_hinges_count_their_turns() -> None:
    """A rope on a clamp that would move, with a bob that swings over on a hinge with a spring."""
    arm = fb.Beam.straight("arm", (0, 0, 0), (1, 0, 0.2), section=ROPE, elements=12)
    bob = fb.RigidBody("bob", mass=0.05, inertia=(0.01, 0.01, 0.01), position=(1.3, 0, 0.2))
    hinge = fb.RevoluteJoint(arm.end, bob.point((-0.3, 0, 0)), "hinge", axis=(0, 1, 0), stiffness=0.02)
    drive = fb.PrescribedMotion("drive", arm.start, displacement=lambda t: (0.1 * t * t, 0, 0))
    model = fb.compile_scene(fb.Scene(arm, bob, hinge, drive, fb.Clamp(arm.start), gravity=DOWN))
    found = fb.relax(model)
    assert found.info["finished"] and np.linalg.norm(places(found.state)[0]) == 0.0
    again = fb.solve_static(model, start=found.state, load_step=1.0)
    np.testing.assert_allclose(places(again.state), places(found.state), atol=1e-9)


def test_a_cable_on_two_pins_hangs_in_a_wind_from_the_side_where_statics_refuse_it() -> None:
    section = fb.Section.circle(radius=0.006, E=1e11, rho=8000.0)
    weight, wind = section.rhoA * 9.81, 3.0

    def hung(gravity: float, *loads: tuple[float, float, float]) -> fb.Model:
        cable = fb.Beam.through_points("cable", [(0, 0, 0), (2, 0, -1.5), (4, 0, -2), (6, 0, -1.5), (8, 0, 0)], section=section,
                                       elements=6)
        return fb.compile_scene(fb.Scene(cable, fb.Pin(cable.start), fb.Pin(cable.end), gravity=(0, 0, -gravity), *(
            fb.DistributedLoad("wind", cable, force=load) for load in loads)))

    aslant = hung(9.81, (0.0, wind, 0.0))
    with pytest.raises(fb.SceneError, match=r"can turn about \(1, 0, 0\) .* \(relax finds the shape in which it hangs\)"):
        fb.solve_static(aslant)
    found = fb.relax(aslant).state.q.reshape(-1, 4, 3)[:, 0]
    # the equilibrium in a plane, under both loads together, turned into theirs
    total = float(np.hypot(weight, wind))
    plane = fb.solve_static(hung(total / section.rhoA)).state.q.reshape(-1, 4, 3)[:, 0]
    expected = np.stack((plane[:, 0], -plane[:, 2] * wind / total, plane[:, 2] * weight / total), axis=1)
    assert np.max(expected[:, 1]) > 0.6
    np.testing.assert_allclose(found, expected, atol=1e-7)


def trolley(elements: int = 12, **options: Any) -> fb.Model:
    """A ring of 20 N on a slack, light and thin cable between two pins."""
    thin = fb.Section(EA=1e5, GA2=4e4, GA3=4e4, GJ=0.1, EI2=0.1, EI3=0.1, rhoA=1e-3, rhoI2=1e-8, rhoI3=1e-8)
    cable = fb.Beam.straight("cable", (0, 0, 0), (4, 0, 0), section=thin, elements=elements, prestrain=-0.08)
    ring = fb.PointMass("ring", mass=2.0)
    return fb.compile_scene(fb.Scene(cable, ring, fb.Pin(cable.start), fb.Pin(cable.end),
                                     fb.Slider("hook", ring, cable, at=0.6, **options), gravity=(0, 0, -10.0)), planar=True)


def test_a_ring_that_a_drive_pushes_along_a_slack_cable() -> None:
    """Of a string without weight and stiffness: the ring on its ellipse, where 20 N z - 3 N s is least."""
    def potential(s: float) -> float:
        a, length = 1.08 * s, 4.32
        x = (a * a - (length - a)**2 + 16.0) / 8.0
        return -20.0 * float(np.sqrt(max(a * a - x * x, 0.0))) - 3.0 * s

    expected = float(minimize_scalar(potential, bounds=(0.5, 3.5), method="bounded", options={"xatol": 1e-10}).x)
    found = fb.relax(trolley(48, drive=fb.Drive(force=3.0)))
    assert found.info["finished"] and found.info["unstable_directions"] == 0
    assert found.series["s_slide"][-1, 0] == pytest.approx(expected, rel=1e-2)


@pytest.mark.parametrize("options", [
    {"drive": fb.Drive(force=3.0)}, {"drive": fb.Drive(force=lambda t: 1.0 + 4.0 * t)},
    {"drive": fb.Drive(force=3.0), "friction": fb.Friction(0.0, viscous=2.0)},
    {"drive": fb.Drive(force=8.0), "stops": fb.Stops(start=0.2, end=3.0, stiffness=1e4)},
    {"stops": fb.Stops(start=0.2, end=0.9, stiffness=1e4)}])
def test_drives_viscous_friction_and_elastic_stops_of_sliders(options: dict[str, Any]) -> None:
    """What the motion finds is an equilibrium of `solve_static`; stops carry what the drive and the slope leave."""
    model = trolley(**options)
    timed = 0.5 if "drive" in options and callable(options["drive"].force) else None
    found = fb.relax(model, at_time=timed)
    assert found.info["finished"] and found.info["unstable_directions"] == 0
    again = fb.solve_static(model, start=found.state, load_step=1.0, largest_load_step=1.0, at_time=timed)
    np.testing.assert_allclose(places(again.state), places(found.state), atol=1e-9)
    np.testing.assert_allclose(again.series["s_slide"][-1], found.series["s_slide"][-1], atol=1e-9)
    if "stops" in options:
        stop = options["stops"].end
        assert stop < found.series["s_slide"][-1, 0] < stop + 20.0 / 1e4
    elif timed is None and "friction" not in options:
        for others in ({"drive": fb.Drive(force=lambda t: 1.0 + 4.0 * t)}, {"friction": fb.Friction(0.0, viscous=2.0)}):
            other = fb.solve_static(trolley(**options | others), start=found.state, load_step=1.0, largest_load_step=1.0,
                                    at_time=0.5)
            np.testing.assert_allclose(places(other.state), places(found.state), atol=1e-9)


def test_what_relax_does_not_know_along_beams() -> None:
    with pytest.raises(fb.SceneError, match="relax: drives have time functions, so a time is needed; give one time with "
                                            "at_time="):
        fb.relax(trolley(drive=fb.Drive(force=lambda t: t)))
    for options in ({"friction": 0.2}, {"stops": fb.Stops(start=0.2, end=3.0)}, {"drive": fb.Drive(speed=1.0)}):
        with pytest.raises(fb.SceneError, match="relax: slider 'hook' has Coulomb friction, a prescribed motion, rigid stops"):
            fb.relax(trolley(**options))


def touching_down(h: float, v: float, length: float, weight: float, stiffness: float) -> tuple[float, float]:
    """Distance and height of the fairlead of an elastic catenary that lies on a bed without friction, pulled there by (h, v)."""
    turn = v / h
    return (length - v / weight + h / weight * np.arcsinh(turn) + h * length / stiffness,
            h / weight * (np.sqrt(1.0 + turn * turn) - 1.0) + v * v / (2.0 * stiffness * weight))


def bed(t, position, directors, velocity, spin, parameters, force, moment):
    depth = -200.0 - position[2]
    if depth > 0.0:
        force[2] = parameters[0] * depth


@pytest.mark.parametrize(("elements", "error"), [(20, 5e-4), (40, 5e-5)])
def test_a_mooring_line_drawn_with_a_corner(elements: int, error: float) -> None:
    """Load steps fail at the first loads; statics relax the shape by themselves. The weight is that of a chain of 90 mm in water,
    and the bed gives way by a few millimetres."""
    length, across, weight, stiffness = 850.0, 800.0, 1048.0, 7.536e8
    lying = brentq(lambda b: b + np.hypot(across - b, 200.0) - length, 1.0, across - 1.0)
    corner, top = np.array([lying, 0.0, -200.0]), np.array([across, 0.0, 0.0])
    chain = fb.Section(EA=stiffness, GA2=0.3 * stiffness, GA3=0.3 * stiffness, GJ=1e3, EI2=1e3, EI3=1e3, rhoA=113.35, rhoI2=0.1,
                       rhoI3=0.1)
    line = fb.Beam.from_curve("line", lambda q: corner * [q * length / lying, 0.0, 1.0] if q * length < lying else
                              corner + (q * length - lying) / (length - lying) * (top - corner), section=chain,
                              elements=elements, degree=3)
    scene = fb.Scene(line, fb.Clamp(line.start), fb.Pin(line.end, "fairlead"),
                     fb.DistributedLoad("weight", line, force=(0, 0, -weight)),
                     fb.UserForce("seabed", line, bed, parameters=(2.7e5,)))
    with pytest.warns(fb.ResultWarning, match="coarse"):
        found = fb.solve_static(fb.compile_scene(scene), observe=("reaction",))
    pull = found.reaction("fairlead")["force"][-1]
    exact = fsolve(lambda x: np.subtract(touching_down(*x, length, weight, stiffness), (across, 200.0)), (6e5, 5e5))
    assert pull[[0, 2]] == pytest.approx(exact, rel=error) and abs(pull[1]) < 1e-6 * exact[0]
    assert found.info["steps"] == 1 and [x["kind"] for x in found.events].count("relaxed") == 1
