"""Supports that let go at a time or where a condition holds: nothing jumps, and what follows is the scene without them."""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from restarts import assert_goes_on
from scipy.integrate import solve_ivp

import fastbeam as fb

Array = np.ndarray
SOFT = fb.Section(EA=1e3, GA2=500.0, GA3=500.0, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=0.01, rhoI3=0.01)
G = 9.81


def pendulum(until: Any) -> tuple[fb.Scene, fb.RigidBody]:
    top = fb.PointMass("top", mass=1e-9, position=(0, 0, 0))
    bob = fb.RigidBody("bob", mass=2.0, inertia=(0.1, 0.1, 0.1), position=(0.6, 0, -0.8))
    return fb.Scene(top, bob, fb.BallJoint(top, bob.point((-0.6, 0, 0.8))), fb.Clamp(top, "peg", until=until),
                    gravity=(0, 0, -G)), bob


def test_a_pendulum_that_is_let_go_flies_along_a_parabola() -> None:
    """From the exact angle at T on; within a run the parabola of its own state there is exact."""
    T, end = 0.6, 1.0
    scene, bob = pendulum(T)
    model = fb.compile_scene(scene)
    found = solve_ivp(lambda t, y: [y[1], -2.0 * G * np.sin(y[0]) / 2.1], (0, T), (np.arctan2(0.6, 0.8), 0.0), method="DOP853",
                      rtol=1e-12, atol=1e-13).y[:, -1]
    angle, rate = found
    place, speed = np.array((np.sin(angle), -np.cos(angle))), rate * np.array((np.cos(angle), np.sin(angle)))
    exact = place + speed * (end - T) - 0.5 * G * (end - T)**2 * np.array((0.0, 1.0))
    errors = []
    for step in (0.01, 0.005):
        run = fb.simulate(model, t_end=end, step=step, every=1, points={"bob": bob}, progress=False,
                          observe=("energy", "momentum", "reaction"))
        event, = run.events
        assert event["kind"] == "let go" and event["time"] == T and event["support"] == "peg"
        assert run.drift("total") < 1e-13
        errors.append(float(np.linalg.norm(run.point("bob")[-1, [0, 2]] - exact)))
        free = run.t >= T
        x, t, p = run.point("bob")[free], run.t[free] - T, run.series["lin_mom"][free] / 2.000000001
        own = x[0] + t[:, None] * p[0] - 0.5 * G * t[:, None]**2 * np.array((0, 0, 1))
        np.testing.assert_allclose(x, own, rtol=0, atol=1e-9)
        np.testing.assert_allclose(p, p[0] - G * t[:, None] * np.array((0, 0, 1)), rtol=0, atol=1e-13)
        assert not np.any(run.reaction("peg")["force"][free]) and np.all(run.reaction("peg")["force"][~free, 2] > 5.0)
    assert abs(np.log2(errors[0] / errors[1]) - 2.0) < 0.3 and errors[1] < 2e-4


def parts_of_a_whip(**until: Any) -> tuple[list[Any], list[Any]]:
    """A rope between two supports with a weight that slides on it; the supports."""
    rope = fb.Beam.straight("rope", (0, 0, 0), (2, 0, 0), section=SOFT, elements=6)
    ring = fb.PointMass("ring", mass=0.2)
    return [rope, ring, fb.Slider("on", ring, rope, at=0.9, rate=0.3)], [
        fb.Pin(rope.start), fb.Clamp(rope.end, "hand", **until)]


@pytest.mark.parametrize("options", [{}, {"planar": False}, {"solver": "sparse"}, {"eliminate_inner": False}])
def test_a_rope_that_is_let_go_is_the_rope_without_that_support(options: dict[str, Any]) -> None:
    """From the state at that time in a model that never had it; with a sliding weight, whose rows touch the support's."""
    settings: dict[str, Any] = {"step": 0.005, "progress": False}
    gravity = (0, 0, -G)
    parts, supports = parts_of_a_whip(until=0.1)
    model = fb.compile_scene(fb.Scene(*parts, *supports, gravity=gravity, project_velocities=True), **options)
    run = fb.simulate(model, t_end=0.3, **settings)
    assert run.drift("total") < 1e-12 and run.drift("gap") < 1e-12 and [e["kind"] for e in run.events] == ["let go"]
    held, last = fb.simulate(model, t_end=0.1 - 0.005, **settings), fb.simulate(model, t_end=0.1, **settings)
    assert not held.events and len(last.events) == 1
    free = fb.compile_scene(fb.Scene(*parts, supports[0], gravity=gravity, project_velocities=True), **options)
    other = fb.simulate(free, start=fb.Start(last.state_for(free), time=0.1), t_end=0.3, **settings)
    np.testing.assert_allclose(run.state.q, other.state.q, rtol=0, atol=1e-9)
    assert np.max(np.abs(run.state.q - held.state.q)) > 0.1


def test_a_clamp_becomes_a_hinge_and_a_roller_goes() -> None:
    """Each lets go of what it alone holds."""
    beam = fb.Beam.straight("beam", (0, 0, 0), (2, 0, 0), section=SOFT, elements=5)
    scene = fb.Scene(beam, fb.Clamp(beam.start, "clamp", until=0.1), fb.Pin(beam.start), fb.Pin(beam.end, "guide", axes="y"),
                     fb.Pin(beam.end, "prop", axes="yz", until=0.2), gravity=(0, 1.0, -G))
    run = fb.simulate(fb.compile_scene(scene, planar=False), t_end=0.3, step=0.005, every=1, progress=False,
                      observe=("energy", "reaction"))
    assert run.drift("total") < 1e-12 and [e["support"] for e in run.events] == ["clamp", "prop"]
    end = beam.n_nodes - 1
    shapes = run.phi
    assert not np.any(np.ptp(shapes[:, 0], axis=0)) and not np.any(shapes[:, end, 1])
    turned = np.abs(run.directors[:, 0, 0, 2])
    assert turned[0] == 0.0 and turned[-1] > 0.05 and abs(shapes[-1, end, 2]) > 0.01
    forces = {name: run.reaction(name) for name in ("clamp", "prop", "guide")}
    assert not np.any(forces["clamp"]["moment"][run.t >= 0.1]) and np.any(forces["clamp"]["moment"][run.t < 0.09])
    assert not np.any(forces["prop"]["force"][run.t >= 0.2]) and np.all(forces["guide"]["force"][:, [0, 2]] == 0.0)
    assert np.all(np.abs(forces["guide"]["force"][run.t > 0.2, 1]) > 1e-3)


def test_a_condition_is_met_to_round_off() -> None:
    """Let go where the bob is below the peg: level flight from there. A truth instead of a number is found as well."""
    at = 0
    for until in (lambda t, state: -float(state.q.reshape(-1, 12)[at, 0]), lambda t, state: bool(state.q[12 * at] <= 0.0)):
        scene, bob = pendulum(until)
        model = fb.compile_scene(scene)
        assert model.numbers.start(bob) == at
        run = fb.simulate(model, t_end=1.0, step=0.01, points={"bob": bob}, every=1, progress=False)
        event, = run.events
        row = int(np.argmin(np.abs(run.t - event["time"])))
        assert abs(run.point("bob")[row, 0]) < 1e-12 and run.drift("total") < 1e-13
        # what has fallen by 0.2 m, level
        speed = np.sqrt(2.0 * 2.0 * G * 0.2 / 2.1)
        np.testing.assert_allclose(run.point("bob")[-1, 0], -speed * (1.0 - event["time"]), rtol=2e-3)


def test_what_is_carried_is_thrown() -> None:
    """A support that moves lets go: free flight from its place with its velocity; its work stays in the balance."""
    ball = fb.PointMass("ball", mass=0.5, position=(0, 0, 0), velocity=(1, 0, 0))
    spear = fb.RigidBody("spear", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0, 1, 0))
    T = 0.25
    table = fb.Signal(np.linspace(0, T, 6), 3.0 * np.linspace(0, T, 6)**2, rest=False, interpolation="cubic")
    scene = fb.Scene(ball, spear, fb.PrescribedMotion("throw", ball, displacement=lambda t: (t, 0, 2.0 * t * t), until=T),
                     fb.PrescribedMotion("turn", spear, rotation=lambda t: (0, 0, 4.0 * t * t), displacement=table, axes="x",
                                         until=T), gravity=(0, 0, -G))
    model = fb.compile_scene(scene)
    run = fb.simulate(model, t_end=1.0, step=0.01, every=1, points={"ball": ball, "spear": spear},
                      output=fb.Output(snapshots=200), progress=False)
    assert run.drift("balance") < 1e-12 and len(run.events) == 2
    free = run.t >= T
    t = run.t[free] - T
    exact = np.stack((T + t, 0 * t, 2.0 * T * T + 4.0 * T * t - 0.5 * G * t * t), axis=1)
    np.testing.assert_allclose(run.point("ball")[free], exact, rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.ptp(run.series["works"][free], axis=0), 0.0, rtol=0, atol=1e-14)
    # the rotation goes on at the speed 8 T
    d = run.directors[:, 0, 0] if model.numbers.start(spear) == 0 else run.directors[:, 1, 0]
    angle = np.unwrap(np.arctan2(d[:, 1], d[:, 0]))
    assert abs(angle[-1] - (4.0 * T * T + 8.0 * T * 0.75)) < 2e-3


def test_runs_go_on_across_and_behind_it(tmp_path: Path) -> None:
    parts, supports = parts_of_a_whip(until=0.0525)
    model = fb.compile_scene(fb.Scene(*parts, *supports, gravity=(0, 0, -G), project_velocities=True))
    settings: dict[str, Any] = {"t_end": 0.1, "step": 0.005, "every": 1, "progress": False}
    whole = fb.simulate(model, **settings)
    for n in (5, 11, 15):
        assert_goes_on(model, whole, n, tmp_path / f"{n}.h5", settings)
    # from a state alone: it knows what has let go
    again = fb.simulate(model, start=fb.Start(whole.state, time=0.1), t_end=0.2, step=0.005, progress=False)
    assert not again.events and again.drift("total") < 1e-12
    with pytest.raises(fb.SceneError, match="hand has been released in this state"):
        fb.solve_static(model, start=whole.state, held=True)
    # with step control, and a callback that hands states on
    run = fb.simulate(model, t_end=0.1, step=0.005, tolerance=1e-6, progress=False)
    assert [e["time"] for e in run.events] == [0.0525] and run.drift("total") < 1e-12
    fine = fb.simulate(model, t_end=0.1, step=0.0005, progress=False)
    np.testing.assert_allclose(run.state.q.reshape(-1, 12)[:, :3], fine.state.q.reshape(-1, 12)[:, :3], rtol=0, atol=1e-3)


def test_another_model_knows_which_supports_have_let_go() -> None:
    def make() -> fb.Model:
        return fb.compile_scene(pendulum(0.3)[0])
    whole, part = (fb.simulate(make(), t_end=t, step=0.01, progress=False) for t in (0.6, 0.4))
    state = part.state_for(make())
    rest = fb.simulate(make(), start=fb.Start(state, time=0.4), t_end=0.6, step=0.01, progress=False)
    np.testing.assert_allclose(rest.state.q, whole.state.q, rtol=0, atol=1e-12)
    # one that never lets go is told that its node moves
    held = fb.compile_scene(pendulum(None)[0])
    with pytest.raises(fb.SceneError, match="the support of .*: its velocity is"):
        fb.simulate(held, start=fb.Start(part.state_for(held), time=0.4), t_end=0.6, step=0.01, progress=False)


def test_a_net_that_is_let_go_is_condensed_to_the_same_numbers() -> None:
    grid = np.array([(x, y, 0.0) for x in range(3) for y in range(3)])
    edges = [(3 * x + y, 3 * x + y + 1) for x in range(3) for y in range(2)]
    edges += [(3 * x + y, 3 * x + y + 3) for x in range(2) for y in range(3)]
    net = fb.Net("net", grid, edges, section=SOFT, elements=4, degree=2, pins=[0, 8])
    scene = fb.Scene(net, fb.Pin(net.node(2), until=0.05), fb.Clamp(net.node(6), until=0.1), gravity=(0, 0, -2))
    runs = [fb.simulate(fb.compile_scene(scene, condense=condense), t_end=0.2, step=0.01, progress=False)
            for condense in (False, True)]
    assert max(run.drift("total") for run in runs) < 1e-12 and all(len(run.events) == 2 for run in runs)
    np.testing.assert_allclose(runs[1].state.q, runs[0].state.q, rtol=0, atol=1e-11)


def two_supports() -> None:
    a = fb.Beam.straight("a", (0, 0, 0), (1, 0, 0), section=SOFT, elements=2)
    body = fb.RigidBody("b", mass=1.0, inertia=(1, 1, 1), position=(1, 0, 0))
    fb.compile_scene(fb.Scene(a, body, fb.RigidConnection(a.end, body), fb.Pin(a.end), fb.Pin(body, until=1.0)))


def fails(until: Callable[..., Any]) -> None:
    fb.simulate(fb.compile_scene(pendulum(until)[0]), t_end=0.1, step=0.01, progress=False)


@pytest.mark.parametrize(("make", "says"), [
    (two_supports, "until: "), (lambda: pendulum(lambda t: t), "must take two arguments"),
    (lambda: pendulum("soon"), "a finite time in s or a function"),
    (lambda: fails(lambda t, state: 1 / 0), "until must not fail"),
    (lambda: fails(lambda t, state: np.nan), "must return a finite number"),
    (lambda: fb.simulate(fb.compile_scene(pendulum(1.0)[0]), t_end=0.1, step=0.01, order=4), "where a support is released"),
    (lambda: fb.simulate(fb.compile_scene(pendulum(1.0)[0]), t_end=0.1, step=0.01, method="midpoint"), "supports with until=")])
def test_what_makes_no_sense_is_refused(make: Callable[[], Any], says: str) -> None:
    with pytest.raises(fb.SceneError, match=says):
        make()
