"""Supports that take hold in a run: what is caught keeps its momenta along what stays free, and the books tell what is lost."""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from restarts import assert_goes_on

import fastbeam as fb

SOFT = fb.Section(EA=1e3, GA2=500.0, GA3=500.0, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=0.01, rhoI3=0.01)
G = 9.81
CENTER, MASS, INERTIA = np.array((0.6, 0.0, -0.8)), 2.0, 0.3


def rod(at_top: dict[str, Any], at_end: dict[str, Any], **more: Any) -> tuple[fb.Model, fb.RigidBody]:
    """A rigid rod of length 2 between two points without mass that are held from time to time."""
    body = fb.RigidBody("rod", mass=MASS, inertia=(INERTIA, INERTIA, INERTIA), position=CENTER)
    a, b = (fb.PointMass(name, mass=1e-10, position=x) for name, x in (("a", 0.0 * CENTER), ("b", 2.0 * CENTER)))
    joints = [fb.BallJoint(a, body.point(-CENTER)), fb.BallJoint(b, body.point(CENTER))]
    scene = fb.Scene(body, a, b, *joints, fb.Pin(a, "top", **at_top), fb.Pin(b, "end", **at_end), gravity=(0, 0, -G))
    return fb.compile_scene(scene, **more), body


@pytest.mark.parametrize("options", [{}, {"planar": False}])
def test_a_pendulum_that_changes_its_pin_keeps_its_angular_momentum_about_the_new_one(options: dict[str, Any]) -> None:
    """About the end: (I - m) w0 = (I + m) w1, with the arm 1."""
    T = 0.5
    model, body = rod({"until": T}, {"since": T}, **options)
    run = fb.simulate(model, t_end=1.0, step=0.01, every=1, points={"rod": body}, progress=False,
                      observe=("energy", "momentum", "reaction"))
    assert [(e["kind"], e["support"], e["time"]) for e in run.events] == [("let go", "top", T), ("caught", "end", T)]
    assert run.drift("balance") < 1e-14 and not run.is_conserved("total") and not run.is_conserved("lin_mom")
    row = int(np.flatnonzero(run.t >= T)[0])
    before = np.sqrt(2.0 * MASS * G * (CENTER[2] - run.point("rod")[row, 2]) / (INERTIA + MASS))
    after = before * (INERTIA - MASS) / (INERTIA + MASS)
    np.testing.assert_allclose(run.series["kinetic"][row], 0.5 * (INERTIA + MASS) * after**2, rtol=1e-8)
    lost = 0.5 * (INERTIA + MASS) * (before**2 - after**2)
    np.testing.assert_allclose([run.events[1]["loss"], run.balance()["impact at end"][-1]], lost, rtol=1e-8)
    force = run.reaction("end")["force"]
    assert not np.any(force[:row])
    pushes = np.gradient(run.series["lin_mom"][row:], 0.01, axis=0) + MASS * G * np.array((0, 0, 1))
    np.testing.assert_allclose(force[row + 1:-1], pushes[1:-1], rtol=0, atol=2e-3 * MASS * G)
    assert not np.any(run.reaction("top")["force"][row:])
    np.testing.assert_allclose(np.ptp(run.series["total"][row:]), 0.0, rtol=0, atol=1e-12)


def test_one_that_is_handed_over_and_back() -> None:
    """Caught, let go and caught again: at each time the momentum about the pin that catches is kept, at any place."""
    times = 0.4, 0.7, 0.9
    body = fb.RigidBody("rod", mass=MASS, inertia=(INERTIA, INERTIA, INERTIA), position=CENTER)
    a, b = (fb.PointMass(name, mass=1e-10, position=x) for name, x in (("a", 0.0 * CENTER), ("b", 2.0 * CENTER)))
    scene = fb.Scene(body, a, b, fb.BallJoint(a, body.point(-CENTER)), fb.BallJoint(b, body.point(CENTER)),
                     fb.Pin(a, "first", until=times[0]), fb.Pin(b, "second", since=times[0], until=times[1]),
                     fb.Pin(a, "third", since=times[2]), gravity=(0, 0, -G))
    model = fb.compile_scene(scene)
    assert "take hold" in str(model) and "impact at second" in str(model)
    settings: dict[str, Any] = dict(step=0.01, every=1, points={"rod": body, "a": a, "b": b}, progress=False)
    run = fb.simulate(model, t_end=1.2, **settings)
    assert [e["kind"] for e in run.events] == ["let go", "caught", "let go", "caught"] and run.drift("balance") < 1e-14
    k = [int(np.flatnonzero(run.t >= t)[0]) for t in times]
    for name, some in (("a", slice(0, k[0])), ("b", slice(k[0], k[1])), ("a", slice(k[2], None))):
        np.testing.assert_allclose(np.ptp(run.point(name)[some], axis=0), 0.0, rtol=0, atol=1e-13)
    # free flight between: momentum and energy are those of a thrown rod
    fly = slice(k[1], k[2])
    t, p = run.t[fly] - times[1], run.series["lin_mom"][fly]
    np.testing.assert_allclose(p, p[0] - MASS * G * t[:, None] * np.array((0, 0, 1)), rtol=0, atol=1e-8)
    # about the third pin: momentum before, from the flight, and after, from the energy
    arm, x = run.point("rod")[k[2]] - run.point("a")[k[2]], run.point("rod")[k[2]]
    last = p[0] - MASS * G * (times[2] - times[1]) * np.array((0, 0, 1))
    own = run.series["ang_mom"][k[2] - 1] - np.cross(run.point("rod")[k[2] - 1], run.series["lin_mom"][k[2] - 1])
    about = (own + np.cross(arm, last))[1]
    np.testing.assert_allclose(run.series["kinetic"][k[2]], 0.5 * about**2 / (INERTIA + MASS), rtol=1e-6)
    behind = run.series["ang_mom"][k[2]] - np.cross(x - arm, run.series["lin_mom"][k[2]])
    np.testing.assert_allclose(behind[1], about, rtol=1e-6)


def falling(**more: Any) -> tuple[fb.Model, fb.Beam]:
    beam = fb.Beam.straight("beam", (0, 0, 0), (2, 0, 0), section=SOFT, elements=4)
    peg = fb.Pin(beam.start, "peg", **{"since": lambda t, state: -0.1 - float(state.q.reshape(-1, 12)[0, 2]), **more})
    return fb.compile_scene(fb.Scene(beam, peg, gravity=(0, 0, -G))), beam


def test_a_beam_that_falls_on_a_peg_keeps_its_momentum_about_it() -> None:
    """It falls by exactly 0.1 m and is caught at one end: angular momentum about the peg is kept in the blow, and the loss is
    what the kinetic energy lacks behind it."""
    model, beam = falling()
    run = fb.simulate(model, t_end=0.4, step=0.005, every=1, points={"peg": beam.start, "end": beam.end}, progress=False)
    event, = run.events
    T, v = np.sqrt(0.2 / G), np.sqrt(0.2 * G)
    np.testing.assert_allclose(event["time"], T, rtol=1e-9)
    row = int(np.argmin(np.abs(run.t - event["time"])))
    at = run.point("peg")[row]
    np.testing.assert_allclose(at, (0, 0, -0.1), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(run.point("peg")[row:], np.broadcast_to(at, (len(run.t) - row, 3)))
    assert run.drift("balance") < 1e-13 and run.series["kinetic"][row] < 0.5 * 2.0 * v * v
    about = run.series["ang_mom"][row] - np.cross(at, run.series["lin_mom"][row])
    np.testing.assert_allclose(about, (0, 2.0 * v, 0), rtol=0, atol=1e-9)
    np.testing.assert_allclose(event["loss"], v * v - run.series["kinetic"][row], rtol=0, atol=1e-10)


def test_a_body_that_is_caught_loses_what_the_support_holds() -> None:
    """All of its motion in a clamp, one component of its velocity on a roller."""
    v = 0.7
    for support, moved in ((fb.Clamp, 0.0), (fb.Pin, None)):
        body = fb.RigidBody("body", mass=MASS, inertia=(0.1, 0.2, 0.3), position=(0, 0, 0), velocity=(v, 0.0, 0.2),
                             spin=(0.1, 0.2, 0.3))
        axes = {} if support is fb.Clamp else {"axes": "x"}
        model = fb.compile_scene(fb.Scene(body, support(body, "stop", since=0.1, **axes)))
        run = fb.simulate(model, t_end=0.3, step=0.01, every=1, points={"body": body}, progress=False)
        event, = run.events
        turn = 0.5 * (0.1 * 0.1**2 + 0.2 * 0.2**2 + 0.3 * 0.3**2)
        lost = 0.5 * MASS * (v**2 + 0.04) + turn if moved == 0.0 else 0.5 * MASS * v**2
        np.testing.assert_allclose(event["loss"], lost, rtol=1e-9)
        assert run.drift("balance") < 1e-13
        np.testing.assert_allclose(run.series["lin_mom"][-1], (0, 0, 0 if moved == 0.0 else 0.2 * MASS), rtol=0, atol=1e-13)


def test_what_a_moving_support_catches_moves_with_it() -> None:
    """Of a ball: the blow does the work of its impulse, m (V - v) V, and half m (V - v)^2 is lost; then both move alike."""
    T, m = 0.25, 0.5
    ball = fb.PointMass("ball", mass=m, position=(0, 0, 0), velocity=(1.0, 0.5, 0))
    lift = fb.PrescribedMotion("lift", ball, displacement=lambda t: (0.0, 2.0 * t * t), axes="xy", since=T, until=0.5)
    model = fb.compile_scene(fb.Scene(ball, lift))
    run = fb.simulate(model, t_end=0.75, step=0.01, every=1, points={"ball": ball}, progress=False)
    assert [e["kind"] for e in run.events] == ["caught", "let go"] and run.drift("balance") < 1e-13
    row = int(np.flatnonzero(run.t >= T)[0])
    V = np.array((0.0, 4.0 * T)) - np.array((1.0, 0.5))
    books = run.balance()
    np.testing.assert_allclose(run.events[0]["loss"], 0.5 * m * V @ V, rtol=1e-9)
    np.testing.assert_allclose(-books["motion of point mass 'ball' ('lift')"][row], m * V[1] * 4.0 * T, rtol=1e-9)
    some = (run.t >= T) & (run.t <= 0.5)
    t = run.t[some]
    exact = np.stack((np.full(t.size, T), 0.5 * T + 2.0 * (t * t - T * T), 0 * t), axis=1)
    np.testing.assert_allclose(run.point("ball")[some], exact, rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.series["lin_mom"][-1], (0, m * 2.0, 0), rtol=0, atol=1e-9)


def test_a_slider_takes_part_in_the_blow() -> None:
    """A weight on a rope: with its rows as rows of the matrix and as a border, in the plane and in space."""
    def run(**options: Any) -> fb.Result:
        rope = fb.Beam.straight("rope", (0, 0, 0), (2, 0, 0), section=SOFT, elements=6)
        ring = fb.PointMass("ring", mass=0.2)
        scene = fb.Scene(rope, ring, fb.Slider("on", ring, rope, at=0.9, rate=0.3), fb.Pin(rope.start),
                         fb.Clamp(rope.end, "hand", since=0.1), gravity=(0, 0, -G), project_velocities=True)
        return fb.simulate(fb.compile_scene(scene, **options), t_end=0.3, step=0.005, progress=False)
    runs = [run(), run(planar=False), run(solver="sparse")]
    for one in runs:
        assert one.drift("balance") < 1e-12 and one.drift("gap") < 1e-12 and one.events[0]["loss"] > 0.01
        np.testing.assert_allclose(one.state.q, runs[0].state.q, rtol=0, atol=1e-9)


def test_a_net_that_is_caught_is_condensed_to_the_same_numbers() -> None:
    grid = np.array([(x, y, 0.0) for x in range(3) for y in range(3)])
    edges = [(3 * x + y, 3 * x + y + 1) for x in range(3) for y in range(2)]
    edges += [(3 * x + y, 3 * x + y + 3) for x in range(2) for y in range(3)]
    net = fb.Net("net", grid, edges, section=SOFT, elements=4, degree=2, pins=[0, 8])
    supports = fb.Pin(net.node(2), "corner", since=0.05), fb.Clamp(net.node(6), "other", since=0.1)
    scene = fb.Scene(net, *supports, gravity=(0, 0, -2))
    runs = [fb.simulate(fb.compile_scene(scene, condense=condense), t_end=0.2, step=0.01, progress=False)
            for condense in (False, True)]
    assert max(run.drift("balance") for run in runs) < 1e-12 and all(len(run.events) == 2 for run in runs)
    np.testing.assert_allclose(runs[1].state.q, runs[0].state.q, rtol=0, atol=1e-11)
    np.testing.assert_allclose(*([e["loss"] for e in run.events] for run in runs), rtol=1e-9)


def test_runs_go_on_across_and_behind_it(tmp_path: Path) -> None:
    model, _ = falling(since=0.0525, until=0.09)
    settings: dict[str, Any] = {"t_end": 0.12, "step": 0.005, "every": 1, "progress": False}
    whole = fb.simulate(model, **settings)
    for n in (5, 11, 15, 21):
        assert_goes_on(model, whole, n, tmp_path / f"{n}.h5", settings)
    # from a state alone, and in a model of its own: it knows what holds
    part = fb.simulate(model, **{**settings, "t_end": 0.0575})
    other = falling(since=0.0525, until=0.09)[0]
    for start in (part.state, part.state_for(other)):
        again = fb.simulate(other, start=fb.Start(start, time=0.0575), t_end=0.12, step=0.005, progress=False)
        assert [e["kind"] for e in again.events] == ["let go"] and again.drift("balance") < 1e-12
        np.testing.assert_allclose(again.state.q, whole.state.q, rtol=0, atol=1e-12)


def test_equilibria_and_modes_are_those_before_it() -> None:
    beam = fb.Beam.straight("beam", (0, 0, 0), (2, 0, 0), section=SOFT, elements=4)

    def make(*more: Any) -> fb.Model:
        return fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), *more, gravity=(0, 0, -0.1)))
    model, plain = make(fb.Pin(beam.end, "prop", since=1.0)), make()
    rest, other = fb.solve_static(model), fb.solve_static(plain)
    np.testing.assert_array_equal(rest.state.q, other.state.q)
    found = [fb.modes(x, n=3, state=y.state).frequencies for x, y in ((model, rest), (plain, other))]
    np.testing.assert_allclose(found[0], found[1], rtol=1e-12)
    run = fb.simulate(model, start=rest.state, t_end=1.2, step=0.01, progress=False)
    assert run.events[0]["kind"] == "caught" and run.events[0]["loss"] < 1e-18
    with pytest.raises(fb.SceneError, match="prop has engaged in this state; leave out its since="):
        fb.solve_static(model, start=run.state)


def fails(since: Callable[..., Any]) -> None:
    fb.simulate(falling(since=since)[0], t_end=0.1, step=0.01, progress=False)


def moving(**more: Any) -> fb.Model:
    ball = fb.PointMass("ball", mass=1.0, position=(0, 0, 0))
    motion = fb.PrescribedMotion("lift", ball, **{"displacement": lambda t: (0, 0, t), "since": 1.0, **more})
    return fb.compile_scene(fb.Scene(ball, motion))


@pytest.mark.parametrize(("make", "says"), [
    (lambda: falling(since=2.0, until=1.0), "until=1 s must lie after since=2 s"),
    (lambda: falling(since=lambda t: t), "must take two arguments"),
    (lambda: falling(since="soon"), "a finite time in s or a function"),
    (lambda: fails(lambda t, state: 1 / 0), "since must not fail"),
    (lambda: fails(lambda t, state: np.nan), "since must return a finite number"),
    (lambda: moving(displacement=None, position=lambda t: (0, 0, t)), "give displacement instead of position"),
    (lambda: fb.solve_static(moving(), at_time=1.0, held=True), "engages in a run"),
    (lambda: fb.simulate(falling()[0], t_end=0.1, step=0.01, order=4), "is released or engages"),
    (lambda: fb.simulate(falling()[0], t_end=0.1, step=0.01, method="midpoint"), "supports with until= or since="),
    (lambda: fb.relax(falling()[0]), "is released or engages")])
def test_what_makes_no_sense_is_refused(make: Callable[[], Any], says: str) -> None:
    with pytest.raises(fb.SceneError, match=says):
        make()
