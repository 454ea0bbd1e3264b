"""Statics with supports that move: displacement control, load-displacement curves from reactions."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import fastbeam as fb

Array = np.ndarray


def section(EA: float = 1e4, EI: float = 1.0, GJ: float = 1.0) -> fb.Section:
    return fb.Section(EA=EA, GA2=EA, GA3=EA, GJ=GJ, EI2=EI, EI3=EI, rhoA=1.0, rhoI2=0.01, rhoI3=0.01)


def cantilever() -> fb.Beam:
    return fb.Beam.straight("b", (0, 0, 0), (1, 0, 0), section=section(), elements=6)


@pytest.mark.parametrize("planar", ["auto", False])
def test_a_tip_that_is_put_where_a_load_bends_it_needs_that_load(planar: bool | str) -> None:
    """Moved along z alone, free along x: the whole curve of load and displacement."""
    beam = cantilever()
    loaded = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, force=(0, 0, -3.0))), planar=planar)
    by_load = fb.solve_static(loaded, points={"end": beam.end}, levels=(0.3, 0.6, 0.8))
    way = by_load.point("end")
    pull = fb.PrescribedMotion("pull", beam.end, displacement=lambda t: t * way[-1, 2], axes="z")
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), pull), planar=planar)
    levels = tuple((way[:, 2] / way[-1, 2])[np.isin(by_load.t, (0.3, 0.6, 0.8))])
    run = fb.solve_static(model, at_time=1.0, levels=levels, points={"end": beam.end}, observe=("energy", "reaction"))
    for level, share in zip((0.3, 0.6, 0.8, 1.0), (*levels, 1.0)):
        row, other = int(np.flatnonzero(run.t == share)[0]), int(np.flatnonzero(by_load.t == level)[0])
        np.testing.assert_allclose(run.reaction("pull")["force"][row], (0.0, 0.0, -3.0 * level), rtol=0, atol=1e-9)
        np.testing.assert_allclose(run.point("end")[row], way[other], rtol=0, atol=1e-12)
    assert way[-1, 2] < -0.6 and way[-1, 0] < 0.8 and len(run.t) < 12
    # without a time supports stay where they are, from any start
    still = fb.solve_static(model, start=run.state)
    np.testing.assert_allclose(still.state.q, run.state.q, rtol=0, atol=1e-12)


def test_paths_and_relax_move_supports_as_statics_do() -> None:
    """The end of a cantilever turned along a circle by a function that is not linear: the moment is EI angle/L everywhere."""
    beam = cantilever()

    def angle(t: float) -> float:
        return np.pi * t * t

    def on_circle(t: float) -> tuple[float, float, float]:
        a = angle(t)
        return (np.sin(a) / a - 1.0, 0.0, (1.0 - np.cos(a)) / a) if a > 1e-3 else (-a * a / 6.0, 0.0, 0.5 * a)

    turn = fb.PrescribedMotion("turn", beam.end, rotation=lambda t: (0, -angle(t), 0), displacement=on_circle)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), turn))
    watched: dict[str, Any] = {"points": {"middle": (beam, 0.5)}}
    half = fb.solve_path(model, at_time=1.0, to=0.5, observe=("reaction",), **watched)
    whole = fb.solve_path(model, at_time=1.0, start=half.state, load_factor=0.5, **watched)
    between = fb.solve_path(model, at_time=(0.5, 1.0), start=half.state, observe=("reaction",), **watched)
    rests = fb.relax(model, at_time=0.5, **watched), fb.solve_static(model, at_time=1.0, levels=(0.5,), **watched)
    np.testing.assert_allclose(half.reaction("turn")["moment"][-1], (0.0, -angle(0.5), 0.0), rtol=0, atol=1e-5)
    np.testing.assert_allclose(between.reaction("turn")["moment"][-1], (0.0, -angle(1.0), 0.0), rtol=0, atol=1e-3)
    for found, t in ((half, 0.5), (whole, 1.0), (between, 1.0), (rests[0], 0.5), (rests[1], 1.0)):
        a = angle(t)
        exact = np.sin(0.5 * a) / a, 0.0, (1.0 - np.cos(0.5 * a)) / a
        np.testing.assert_allclose(found.point("middle")[-1], exact, rtol=0, atol=1e-5)
    level = rests[1].point("middle")[np.flatnonzero(rests[1].t == 0.5)[0]]
    for found in (half, rests[0]):
        np.testing.assert_allclose(found.point("middle")[-1], level, rtol=0, atol=1e-11)
    for call in (lambda: fb.solve_path(model, at_time=1.0, start=half.state),
                 lambda: fb.relax(model, at_time=1.0, start=half.state)):
        with pytest.raises(fb.SceneError, match="'turn': at the start these supports are not at the places that their functions "
                                                "prescribe"):
            call()
    with pytest.raises(fb.SceneError, match="moves between the times of at_time=, and supports in moves= with the load factor "
                                            "too"):
        fb.solve_path(model, at_time=(0.5, 1.0), start=half.state, moves={beam.start: (0, 0, 0.1)})


@pytest.mark.parametrize("planar", ["auto", False])
def test_a_cantilever_whose_end_is_turned_rolls_up(planar: bool | str) -> None:
    """Moment EI angle/L, end on the circle; by whole turns from the shape of the scene, back from a start."""
    beam = cantilever()
    turn = fb.PrescribedMotion("turn", beam.end, rotation=lambda t: (0, -2.0 * np.pi * t, 0), axes="y",
                               displacement=lambda t: 0.0)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), turn), planar=planar)
    start = None
    for t in (1.0, 0.75):
        run = fb.solve_static(model, at_time=t, start=start, points={"end": beam.end}, observe=("energy", "reaction"))
        angle, start = 2.0 * np.pi * t, run.state
        exact = (np.sin(angle) / angle, 0.0, (1.0 - np.cos(angle)) / angle)
        np.testing.assert_allclose(run.point("end")[-1], exact, rtol=0, atol=1e-5)
        np.testing.assert_allclose(run.reaction("turn")["moment"][-1], (0.0, -angle, 0.0), rtol=1e-4, atol=1e-9)
        np.testing.assert_allclose(run.reaction("turn")["force"][-1], 0.0, rtol=0, atol=1e-9)


def arch(*parts: Any) -> fb.Model:
    R, half = 5.0, 0.2
    beam = fb.Beam.arc("arch", (-R * np.sin(half), 0, 0), (np.cos(half), 0, np.sin(half)), (np.sin(half), 0, -np.cos(half)),
                       radius=R, angle=2.0 * half, section=section(), elements=8)
    top = beam.at(beam.length / 2.0)
    return fb.compile_scene(fb.Scene(beam, fb.Pin(beam.start), fb.Pin(beam.end), fb.Pin(top, axes="x"),
                                     *(part(top) for part in parts)))


def gripped(rotation: Any) -> tuple[fb.Beam, fb.Model]:
    """A rod whose right end is held by a gripper that turns about the axis."""
    beam = cantilever()
    gradient = fb.PrescribedMotion("grip", beam.end, displacement=lambda t: (0, 0, 0), rotation=rotation)
    return beam, fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), gradient), planar=False)


ALONG = np.array((1.0, 0.0, 0.0))
# there and back, and by more than a turn at once
WAYS = {1.0: 3.6, 2.0: 0.0, 3.0: -5.0, 4.0: 9.0, 5.0: 0.0}


def twist(t: float) -> Array:
    return float(np.interp(t, [0.0, *WAYS], [0.0, *WAYS.values()])) * ALONG


def test_a_gripper_that_turns_and_turns_back_leaves_nothing_behind() -> None:
    """From one equilibrium to the next, through another model, a run in time, a mode shape, `relax` and a path. The moment is
    GJ angle/L, off by 2.4e-4 at 1.5 rad an element (measured), a turn would be 2 pi."""
    beam, model = gripped(twist)

    def at(t: float, start: Any = None) -> fb.Result:
        run = fb.solve_static(model, at_time=t, start=start, observe=("reaction",))
        np.testing.assert_allclose(run.reaction("grip")["moment"][-1], twist(t), rtol=1e-3, atol=1e-9)
        return run

    run = None
    for t in WAYS:
        run = at(t, None if run is None else run.state)
    turned = at(1.0)
    other = gripped(twist)[1]
    back = fb.solve_static(other, at_time=2.0, start=turned.state_for(other), observe=("reaction",))
    np.testing.assert_allclose(back.reaction("grip")["moment"][-1], 0.0, rtol=0, atol=1e-9)
    in_time = fb.simulate(model, t_end=1.0, step=0.05)
    path = fb.solve_path(model, moves={beam.end: (0, 0, 0, 8.0, 0, 0)}, step=0.5, largest_step=2.0, observe=("reaction",))
    np.testing.assert_allclose(path.reaction("grip")["moment"][-1], 8.0 * ALONG, rtol=1e-3, atol=1e-9)
    for state in (in_time.state, path.state, fb.relax(model, start=turned.state).state,
                  fb.modes(model, state=turned.state, n=1).state(0, amplitude=1e-6)):
        at(2.0, state)
    # a state with a turn more than the function has is told of
    long = at(4.0)
    run = fb.simulate(model, start=fb.Start(long.state, time=0.0, mend=True), t_end=0.02, step=0.01)
    assert "is 9 rad away from the prescribed place at that time" in next(x["text"] for x in run.events if x["kind"] == "support")


def test_rotation_matrices_cannot_tell_turns_and_jumps_are_refused() -> None:
    """A matrix goes the shorter way to the next equilibrium, so a turn stays; a vector must not jump by half a turn."""
    from scipy.spatial.transform import Rotation
    _, model = gripped(lambda t: Rotation.from_rotvec(twist(t)).as_matrix())
    there = fb.solve_static(model, at_time=1.0, observe=("reaction",))
    np.testing.assert_allclose(there.reaction("grip")["moment"][-1], 3.6 * ALONG, rtol=1e-3, atol=1e-9)
    back = fb.solve_static(model, at_time=2.0, start=there.state, observe=("reaction",))
    np.testing.assert_allclose(back.reaction("grip")["moment"][-1], 2.0 * np.pi * ALONG, rtol=1e-3, atol=1e-9)
    _, jumps = gripped(lambda t: 4.0 * (t > 0.5) * ALONG)
    with pytest.raises(fb.SceneError, match=r"'grip'.*turns by 4 rad from t = 0.499\d* s to 0.5\d* s.*less than half a turn"):
        fb.solve_static(jumps, at_time=1.0)
    with pytest.raises(fb.SceneError, match=r"'grip'.*turns by 4 rad from t = 0.5 s to 0.51 s.*less than half a turn"):
        fb.simulate(jumps, t_end=1.0, step=0.01)
    # the same triad, a turn less
    _, wraps = gripped(lambda t: (5.0 * t - (2.0 * np.pi if t > 0.4 else 0.0)) * ALONG)
    with pytest.raises(fb.SceneError, match="let a rotation vector grow beyond a full turn"):
        fb.solve_static(wraps, at_time=1.0)


def test_joints_that_are_given_angles_beyond_half_a_turn_at_once() -> None:
    """In one load step, from one equilibrium to another: energy GJ angle^2/(2 L)."""
    beam = cantilever()
    hinge = fb.RevoluteJoint(beam.end, fb.GROUND, "h", axis=ALONG, angle=lambda t: twist(t)[0] if t > 0.1 else 0.0)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), hinge), planar=False)
    start = None
    for t, angle in WAYS.items():
        run = fb.solve_static(model, at_time=t, start=start, load_step=1.0, largest_load_step=1.0)
        assert run.joint("h")["angle"][-1] == pytest.approx(angle, abs=1e-12)
        assert run.series["potential"][-1] == pytest.approx(0.5 * angle**2, rel=1e-3, abs=1e-9)
        start = run.state


def test_springs_of_joints_keep_their_turns_in_other_models_and_mode_shapes() -> None:
    """Two hinges in a row about one axis with equal springs share the angle of what turns them: energy k angle^2/4. Their
    equations have more conditions than unknowns, of which SuperLU once made a crash."""
    turning, middle = (fb.RigidBody(name, mass=1.0, inertia=(1, 1, 1), position=(x, 0, 0)) for name, x in (("A", 0), ("B", 1)))
    drive = fb.PrescribedMotion("drive", turning, displacement=lambda t: (0, 0, 0), rotation=lambda t: 8.0 * t * t * ALONG)
    model = fb.compile_scene(fb.Scene(
        turning, middle, drive, fb.RevoluteJoint(fb.GROUND, middle, "g", axis=ALONG, stiffness=2.0),
        fb.RevoluteJoint(turning, middle.point((-1, 0, 0)), "h", axis=ALONG, stiffness=2.0)), planar=False)
    rest = fb.solve_static(model, at_time=1.0)
    assert rest.series["potential"][-1] == pytest.approx(32.0, rel=1e-12)
    for state in (rest.state_for(model), fb.modes(model, state=rest.state, n=1).state(0, amplitude=1e-9)):
        run = fb.simulate(model, start=fb.Start(state, time=1.0, mend=True), t_end=1.0 + 2e-6, step=1e-6,
                          observe=("energy", "joint"))
        assert run.joint("h")["angle"][0] == pytest.approx(-4.0, abs=1e-8)
        assert run.series["potential"][0] == pytest.approx(32.0, rel=1e-8)


def test_an_arch_snaps_through_under_displacement_control_along_its_path() -> None:
    """Down to where the load is negative and beyond; every point is an equilibrium under its own reaction, and lies on the path
    that arc length finds."""
    model = arch(lambda top: fb.PrescribedMotion("push", top, displacement=lambda t: -0.15 * t, axes="z"))
    run = fb.solve_static(model, at_time=1.0, largest_load_step=0.05, observe=("energy", "reaction"))
    force = -run.reaction("push")["force"][:, 2]
    assert np.max(force) > 2.3 and force[-1] < -0.3 and run.info["unstable_directions"] == 0
    path = fb.solve_path(arch(lambda top: fb.Load("push", top, force=(0, 0, -1.0))), to=3.0, most_points=90)
    top = int(np.argmax(model.q0.reshape(-1, 12)[:, 2]))
    z = path.phi[:, top, 2] - path.phi[0, top, 2]
    n = int(np.argmax(z < -0.14)) + 1
    own = np.interp(-0.15 * run.t, z[:n][::-1], path.series["load_factor"][:n][::-1])
    assert np.max(np.abs(own - force)[0.15 * run.t < 0.14]) < 5e-3 * np.max(force)
    limit = max(point["load_factor"] for point in path.info["critical_points"] if point["kind"] == "limit")
    assert np.max(force) < limit < 1.001 * np.max(force)
    # the last point under its load, where it is unstable
    last = arch(lambda top: fb.Load("push", top, force=(0, 0, -float(force[-1]))))
    again = fb.solve_static(last, start=run.state_for(last), raise_loads=False, load_step=1.0)
    np.testing.assert_allclose(again.state.q, run.state.q, rtol=0, atol=1e-10)
    assert again.info["unstable_directions"] == 1


def catenary(span: float, length: float, weight: float, EA: float) -> tuple[float, float]:
    """Horizontal pull and sag of an elastic cable between two points of one height."""
    v = 0.5 * weight * length

    def reach(h: float) -> float:
        return h * length / EA + 2.0 * h / weight * float(np.arcsinh(v / h))

    h = float(brentq(lambda h: reach(h) - span, 1e-6, 1e6, xtol=1e-12))
    return h, float(weight * length / EA / 4.0 * length / 2.0 + h / weight * (np.hypot(1.0, v / h) - 1.0))


@pytest.mark.parametrize("bead", [False, True])
def test_a_cable_whose_end_is_pulled(bead: bool) -> None:
    """Under its full weight from a sagging start: horizontal pulls of elastic catenaries. A bead that slides on it stays at the
    lowest point; without weight of its own it changes nothing."""
    EA, g = 1e4, 9.81
    cable = fb.Beam.straight("cable", (0, 0, 0), (4, 0, 0), section=section(EA, EI=1e-5, GJ=1e-3), elements=32)
    far = fb.PrescribedMotion("far", cable.end, displacement=lambda t: (-t, 0, 0))
    ring = fb.PointMass("ring", mass=1e-9)
    more = [ring, fb.Slider("on", ring, cable, at=1.9)] if bead else []
    model = fb.compile_scene(fb.Scene(cable, fb.Pin(cable.start), far, *more, gravity=(0, 0, -g)))
    state = fb.solve_static(model, held=True).state
    for t in (1.0, 0.4, 0.05):
        run = fb.solve_static(model, at_time=t, start=state, raise_loads=False, observe=("energy", "reaction"),
                              points={"middle": (cable, 2.0)}, levels=(0.5,))
        state = run.state
        pull, sag = catenary(4.0 - t, 4.0, g, EA)
        force = run.reaction("far")["force"][-1]
        np.testing.assert_allclose(force, (pull, 0.0, 2.0 * g), rtol=2e-3, atol=1e-6)
        assert abs(run.point("middle")[-1, 2] + sag) < 2e-3 and run.info["unstable_directions"] == 0
        # the full weight at every row behind the start
        np.testing.assert_allclose(run.reaction("far")["force"][1:, 2], 2.0 * g, rtol=1e-6)
        if bead:
            assert abs(run.slider("on")["s"][-1] - 2.0) < 1e-4 and np.max(run.slider("on")["gap"]) < 1e-12


def test_supports_carry_joints_bodies_and_nets_along() -> None:
    """A frame with a ball joint that closes its loop."""
    a, b, c = (fb.Beam.straight(name, x, y, section=section(), elements=3) for name, x, y in (
        ("a", (0, 0, 0), (0, 0, 1)), ("b", (1, 0, 0), (1, 0, 1)), ("c", (0, 0, 1), (1, 0, 1))))
    body = fb.RigidBody("body", mass=0.5, inertia=(0.01, 0.01, 0.01), position=(0.5, 0, 1.2))
    scene = fb.Scene(a, b, c, body, fb.RigidConnection(a.end, c.start), fb.BallJoint(b.end, c.end), fb.Clamp(a.start),
                     fb.RigidConnection(body, c.node(4)), fb.Clamp(b.start), gravity=(0, 0, -1))
    shift = np.array((0.1, 0.05, -0.08))
    scene.add(fb.PrescribedMotion("move", b.start, displacement=lambda t: t * shift))
    run = fb.solve_static(fb.compile_scene(scene), at_time=1.0, observe=("energy", "reaction"))
    # the start moved by hand, a little at a time, and held there
    model = fb.compile_scene(scene)
    state = fb.solve_static(model).state
    for _ in range(30):
        state.q.reshape(-1, 4, 3)[foot(run), 0] += shift / 30.0
        state = fb.solve_static(model, start=state, raise_loads=False).state
    np.testing.assert_allclose(run.state.q, state.q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.phi[-1, foot(run)] - run.phi[0, foot(run)], shift, rtol=0, atol=1e-15)
    total = sum(run.reaction(name)["force"][-1] for name in ("move", "clamp of beam 'a' node 0"))
    np.testing.assert_allclose(total, (0, 0, 3.5), rtol=0, atol=1e-9)


def foot(run: fb.Result) -> int:
    """The node at the foot of the second arm."""
    return int(np.argmin(np.linalg.norm(run.phi[0] - (1, 0, 0), axis=1)))


def test_a_net_is_pulled_up_at_one_corner() -> None:
    grid = np.array([(x, y, 0.0) for x in range(3) for y in range(3)])
    edges = [(3 * x + y, 3 * x + y + 1) for x in range(3) for y in range(2)]
    edges += [(3 * x + y, 3 * x + y + 3) for x in range(2) for y in range(3)]
    net = fb.Net("net", grid, edges, section=section(EA=1e3, EI=0.1), elements=4, degree=2, pins=[0, 2, 6])
    lift = fb.PrescribedMotion("lift", net.node(8), displacement=lambda t: 0.3 * t * t, axes="z")
    scene = fb.Scene(net, lift, gravity=(0, 0, -0.05))
    runs = [fb.solve_static(fb.compile_scene(scene, condense=condense), at_time=1.0, observe=("energy", "reaction"))
            for condense in (False, True)]
    np.testing.assert_allclose(runs[1].state.q, runs[0].state.q, rtol=0, atol=1e-9)
    for run in runs:
        force = sum(run.reaction(name)["force"][-1] for name in run.names["reactions"])
        np.testing.assert_allclose(force, (0, 0, 0.05 * 12.0), rtol=0, atol=1e-8)
        corner = [i for i in range(run.phi.shape[1]) if np.allclose(run.phi[0, i], (2, 2, 0))]
        assert np.ptp(run.phi[-1, corner, 2]) < 1e-12 and abs(run.phi[-1, corner[0], 2] - 0.3) < 1e-15


def test_what_is_refused() -> None:
    beam = cantilever()
    lift = fb.PrescribedMotion("lift", beam.end, displacement=lambda t: (0, 0.1 if t == 0.123 else 0.0, -0.1 * t))
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), lift))
    assert model.plane is not None
    with pytest.raises(fb.SceneError, match="'lift': it leaves the plane"):
        fb.solve_static(model, at_time=0.123)
    table = fb.Signal(np.linspace(0, 1, 5), np.linspace(0, 1, 5), rest=False)
    lift = fb.PrescribedMotion("lift", beam.end, displacement=table, axes="z")
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), lift))
    with pytest.raises(fb.SceneError, match="outside its table"):
        fb.solve_static(model, at_time=2.0)


@pytest.mark.parametrize(("kind", "EA", "turn", "way"), [
    ("support", 1e4, 0.9, (-0.5, 0.0, -0.4)), ("support", 1e4, 1.8, (-0.6, 0.0, 0.2)), ("support", 1e8, 1.8, (-0.6, 0.0, 0.2)),
    ("joint", 1e4, 1.8, (-0.6, 0.0, 0.2))])
def test_the_end_of_a_rod_is_pushed_and_turned_whatever_the_load_steps(kind: str, EA: float, turn: float,
                                                                       way: tuple[float, ...]) -> None:
    """There are several equilibria: load steps of any size lead to the one that the path of equilibria leads to; those that are
    not to be divided may lead elsewhere, and tell."""
    rod = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=section(EA), elements=8)
    end, far = np.array((1.0, 0.0, 0.0)), np.array(way)
    if kind == "support":
        hand = fb.PrescribedMotion("hand", rod.end, position=lambda t: end + t**2 * far, rotation=lambda t: (0, t**2 * turn, 0))
        parts: tuple[Any, ...] = (hand,)
    else:
        arm, gradient = (fb.RigidBody(name, mass=1.0, inertia=(1, 1, 1), position=end) for name in ("arm", "grip"))
        hand = fb.PrescribedMotion("hand", arm.center, position=lambda t: end + t**2 * far, rotation=lambda t: (0, 0, 0))
        wrist = fb.RevoluteJoint(arm, gradient, axis=(0, 1, 0), angle=lambda t: t**2 * turn)
        parts = arm, gradient, hand, fb.RigidConnection(rod.end, gradient.center), wrist
    model = fb.compile_scene(fb.Scene(rod, fb.Clamp(rod.start), *parts))
    shapes = [fb.solve_static(model, at_time=1.0, load_step=step, points={"mid": rod.at(0.5)}).point("mid")[-1]
              for step in (0.25, 0.5, 0.01)]
    if kind == "support" and EA == 1e4:
        shapes.append(fb.solve_path(model, at_time=(0.0, 1.0), points={"mid": rod.at(0.5)}).point("mid")[-1])
    np.testing.assert_allclose(shapes, np.broadcast_to(shapes[0], np.shape(shapes)), rtol=0, atol=1e-12)
    if turn == 0.9:
        with pytest.warns(fb.ResultWarning, match="no equilibrium was found near the one before"):
            fb.solve_static(model, at_time=1.0, load_step=0.5, smallest_step=0.2)
