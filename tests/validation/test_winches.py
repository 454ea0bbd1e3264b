"""Ropes of variable length: pendulums and hoists against integrated and exact answers, books that close (theory.md 4)."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb

G = 9.81
ORIGIN = fb.GROUND.point((0, 0, 0))


def smooth(t: float, time: float) -> float:
    """Way after t of a motion that takes `time` to reach the speed 1, with a continuous rate of its acceleration."""
    x = min(max(t / time, 0.0), 1.0)
    return time * x**4 * (2.5 - 3.0 * x + x * x) + max(t - time, 0.0)


def acceleration(t: float, time: float) -> float:
    x = min(max(t / time, 0.0), 1.0)
    return 30.0 * x**2 * (1.0 - x)**2 / time


def run(model: Any, t_end: float, step: float, **more: Any) -> fb.Result:
    kinds = ("energy", "momentum", "spring", "velocity") + (("reaction",) if more.get("order") != 4 else ())
    return fb.simulate(model, t_end=t_end, step=step, progress=False, observe=kinds, **more)


def pendulum(**more: Any) -> tuple[Any, Any]:
    """A mass on an elastic rope without mass that is reeled in from 10 m."""
    bob = fb.PointMass("bob", mass=10.0, position=(6.024, 0.0, -8.032), velocity=(0.0, 1.5, 0.0))
    given = {"length_at": lambda t: 10.0 - 1.5 * smooth(t, 1.0)} | more
    rope = fb.Winch("rope", ORIGIN, bob, stiffness=2e4, mass_per_length=1e-9, segments=1, **given)
    return fb.compile_scene(fb.Scene(bob, rope, gravity=(0, 0, -G))), bob


def exact_pendulum(t_end: float) -> Any:
    from scipy.integrate import solve_ivp

    def rates(t: float, y: Any) -> Any:
        x, length = y[:3], 10.0 - 1.5 * smooth(t, 1.0)
        r = np.linalg.norm(x)
        return np.concatenate((y[3:], np.array([0.0, 0.0, -G]) - 2e3 * max(r - length, 0.0) / length * x / r))

    return solve_ivp(rates, (0.0, t_end), [6.024, 0.0, -8.032, 0.0, 1.5, 0.0], method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]


@pytest.mark.parametrize("order, step, least", [(2, 0.004, 1.95), (4, 0.01, 3.8)])
def test_a_pendulum_that_is_reeled_in(order: int, step: float, least: float) -> None:
    model, bob = pendulum()
    exact = exact_pendulum(3.0)[:3]
    errors = []
    for h in (step, step / 2.0):
        result = run(model, 3.0, h, order=order, points={"bob": bob}, every=1000)
        errors.append(float(np.linalg.norm(result.point("bob")[-1] - exact)))
        assert abs(result.drift("balance")) < 1e-12
    assert np.log2(errors[0] / errors[1]) > least
    assert errors[1] < {2: 1e-5, 4: 1e-8}[order]


def hoist(segments: int = 8, **more: Any) -> Any:
    """A crane rope with 500 kg on 50 m."""
    crate = fb.PointMass("crate", mass=500.0, position=(0, 0, -50.0))
    given = {"total": 60.0, "inertia": 20.0} | more
    rope = fb.Winch("hoist", ORIGIN, crate, stiffness=1e8, mass_per_length=1.5, segments=segments, **given)
    return fb.compile_scene(fb.Scene(crate, rope, gravity=(0, 0, -G)))


def test_a_crane_hoists_a_load_over_thirty_metres() -> None:
    # one segment with the stretch at rest, so that nothing bounces
    strain = (500.0 + 1.5 * 25.0) * G / 1e8
    start = 50.0 / (1.0 + strain)
    model = hoist(length_at=lambda t: start - smooth(t, 6.0), segments=1)
    result = run(model, 33.0, 0.02, every=25)
    rope, pull = result.winch("hoist"), -result.reaction("hoist")["force"][:, 0]
    t, length = result.t, rope["length"]
    # d/dt of 1/2 (m + rho total + J) V^2 and of the weights, over V
    moved, free = 500.0 + 1.5 * 60.0 + 20.0, 500.0 + 1.5 * length
    exact = moved * np.array([acceleration(x, 6.0) for x in t]) + free * G
    at = (t > 0.0) & (t < 32.9)
    assert np.max(np.abs(pull - exact)[at]) < 2e-3 * moved * 0.3125
    assert abs(length[-1] - (start - 30.0)) < 1e-12 * start
    assert abs(result.drift("balance")) < 1e-13
    work = result.series["works"][-1, 0]
    # and what the rope stretches less at the end
    assert abs(work / (0.5 * moved + 500.0 * G * 30.0 + 0.75 * G * (start**2 - length[-1]**2)) - 1.0) < 1e-4


def satellites(mass: float, segments: int) -> Any:
    """Two bodies that turn about each other, on a tether that gets longer."""
    a = fb.PointMass("a", mass=200.0, position=(-2.0, 0, 0), velocity=(0, 0.1, 0))
    b = fb.PointMass("b", mass=100.0, position=(3.0, 0, 0), velocity=(0, 1.6, 0.3))
    tether = fb.Winch("tether", a, b, stiffness=2e5, mass_per_length=mass, total=25.0, segments=segments,
                      length_at=lambda t: 5.0 + smooth(t, 2.0))
    return fb.compile_scene(fb.Scene(a, b, tether)), (a, b)


def test_a_tether_is_deployed_in_free_flight() -> None:
    model, _ = satellites(0.5, 4)
    errors = []
    for h in (0.02, 0.01):
        result = run(model, 10.0, h, every=50)
        assert abs(result.drift("balance")) < 1e-13 and abs(result.drift("lin_mom")) < 1e-13
        errors.append(abs(result.drift("ang_mom")))
    # of second order while the length changes
    assert errors[1] < 1e-5 and np.log2(errors[0] / errors[1]) > 1.8


def test_a_light_tether_turns_as_angular_momentum_says() -> None:
    model, (a, b) = satellites(1e-9, 1)
    result = run(model, 10.0, 0.005, every=100, points={"a": a, "b": b})
    x = result.point("b") - result.point("a")
    r = np.linalg.norm(x, axis=1)
    v = result.velocity("b") - result.velocity("a")
    assert r[-1] > 12.5
    turn = np.linalg.norm(np.cross(x, v), axis=1)
    assert np.max(np.abs(turn / turn[0] - 1.0)) < 1e-9


def test_what_a_rope_cannot_be_is_refused() -> None:
    crate = fb.PointMass("crate", mass=1.0, position=(0, 0, -2.0))
    more = {"stiffness": 1e4, "mass_per_length": 0.1}
    with pytest.raises(fb.SceneError, match="leave tension out"):
        fb.Winch("w", ORIGIN, crate, length_at=lambda t: 2.0, tension=3.0, **more)
    with pytest.raises(fb.SceneError, match="coincide, but a rope needs"):
        fb.Winch("w", fb.GROUND.point((0, 0, -2.0)), crate, **more)
    with pytest.raises(fb.SceneError, match="2 m are free"):
        fb.Winch("w", ORIGIN, crate, total=1.0, **more)
    with pytest.raises(fb.SceneError, match="is for a rope whose length is not prescribed"):
        fb.Winch("w", ORIGIN, crate, speed=1.0, **more)
    with pytest.raises(fb.SceneError, match="no position"):
        fb.Winch("w", ORIGIN, fb.PointMass("loose", mass=1.0), **more)
    rope = fb.Winch("w", ORIGIN, crate, length_at=lambda t: 2.0 - t, total=3.0, **more)
    with pytest.raises(fb.SceneError, match=r"length_at\(2\) = 0 m"):
        rope.length_of(2.0)
    model = fb.compile_scene(fb.Scene(crate, rope))
    with pytest.raises(fb.SceneError, match="solve_static: steady motions do not support ropes of winches"):
        fb.solve_static(model, at_time=0.0, steady=fb.Spin(rate=1.0, axis=(0, 0, 1)))
    for wrong in (lambda: fb.relax(model), lambda: fb.simulate(model, t_end=1.0, step=0.1,
                                                                                        method="midpoint"),
                  lambda: fb.simulate(model, t_end=1.0, step=0.1, observe=("inner",))):
        with pytest.raises(fb.SceneError, match="winches"):
            wrong()


@pytest.mark.slow
def test_a_drum_pulls_with_a_constant_force() -> None:
    crate = fb.PointMass("crate", mass=500.0, position=(0, 0, -50.0))
    strain = (500.0 + 1.5 * 25.0) * G / 1e9
    start = 50.0 / (1.0 + strain)
    pull = (500.0 + 1.5 * start) * G
    rope = fb.Winch("hoist", ORIGIN, crate, stiffness=1e9, mass_per_length=1.5, length=start, total=60.0, inertia=20.0,
                    segments=1, tension=lambda t: pull * (1.0 + pull / 2e9) + 100.0 * acceleration(t, 5.0))
    model = fb.compile_scene(fb.Scene(crate, rope, gravity=(0, 0, -G)))
    result = run(model, 20.0, 0.01, every=100)
    from scipy.integrate import solve_ivp

    def rates(t: float, y: Any) -> Any:
        moved = 500.0 + 1.5 * 60.0 + 20.0
        return y[1], ((500.0 + 1.5 * y[0]) * G - pull - 100.0 * acceleration(t, 5.0)) / moved

    exact = solve_ivp(rates, (0.0, 20.0), [start, 0.0], rtol=1e-10, atol=1e-10).y[0, -1]
    assert abs(result.winch("hoist")["length"][-1] - exact) < 1e-4 * (start - exact) and start - exact > 5.0
    assert abs(result.drift("balance")) < 1e-11
    loose = fb.Winch("loose", ORIGIN, crate, stiffness=1e9, mass_per_length=1.5, length=start, total=51.0, speed=1.0,
                     segments=1, tension=lambda t: 0.0)
    with pytest.raises(fb.ConvergenceError, match="all rope is paid out, of drum 'loose drum'"):
        run(fb.compile_scene(fb.Scene(crate, loose, gravity=(0, 0, -G))), 2.0, 0.01)


@pytest.mark.parametrize("segments", [1, 4])
def test_tensions_are_those_of_the_ends(segments: int) -> None:
    """At rest what hangs on them, and in a taut rope that slopes the reaction of what it ends at, to round-off; while the load is
    hoisted m (g + a), to 2.0e-5 with four segments (measured)."""
    crate = fb.PointMass("crate", mass=500.0, position=(0, 0, -50.0))
    rope = fb.Winch("hoist", ORIGIN, crate, stiffness=1e7, mass_per_length=1.5, segments=segments,
                    length_at=lambda t: 49.9 - 2.0 * smooth(t, 2.0))
    model = fb.compile_scene(fb.Scene(crate, rope, gravity=(0, 0, -G)))
    rest = fb.solve_static(model, at_time=0.0, observe=("spring",))
    tensions = rest.winch("hoist")
    assert tensions["load_tension"][-1] == pytest.approx(500.0 * G, rel=1e-11)
    assert tensions["drum_tension"][-1] == pytest.approx((500.0 + 1.5 * 49.9) * G, rel=1e-11)
    post = fb.PointMass("post", mass=1.0, position=(40.0, 0, -5.0))
    stay = fb.Winch("stay", ORIGIN, post, stiffness=1e6, mass_per_length=1.5, length=40.0, segments=segments)
    held = fb.solve_static(fb.compile_scene(fb.Scene(post, stay, fb.Pin(post), gravity=(0, 0, -G))),
                           observe=("spring", "reaction"))
    pull = held.reaction("pin of point mass 'post'")["force"][-1] - (0, 0, G)
    assert held.winch("stay")["load_tension"][-1] == pytest.approx(np.linalg.norm(pull), rel=1e-9)
    if segments > 1:
        moving = fb.simulate(model, t_end=1.0, step=0.005, start=rest.state, every=20, points={"crate": crate},
                             observe=("spring", "acceleration"))
        np.testing.assert_allclose(moving.winch("hoist")["load_tension"][1:], 500.0 * (G + moving.acceleration("crate")[1:, 2]),
                                   rtol=1e-4)


@pytest.mark.slow
def test_a_rope_hangs_at_rest() -> None:
    model = hoist(segments=16, length=49.0)
    result = fb.solve_static(model, observe=("energy", "spring", "reaction"))
    # N steps of n: weight below the middle of each segment, EA eps = W_below
    below = (np.arange(16) + 0.5) / 16.0
    stretch = 49.0 * (1.0 + np.mean((500.0 + 1.5 * 49.0 * below) * G) / 1e8)
    assert abs(result.phi[-1, 0, 2] + stretch) < 1e-9 * stretch
    # the drum holds the weight but for the energy of the stretch
    tension = (500.0 + 1.5 * 49.0) * G
    assert abs(-result.reaction("hoist")["force"][-1, 0] / tension - 1.0) < 1e-3


def test_a_tether_that_falls_slack_closes_its_books() -> None:
    """1 km between a body and a probe, paid out faster than it is drawn: iterations over the kink of slack segments converge
    slowly, and the work of the drum is that of the end of them."""
    main = fb.RigidBody("main", mass=500.0, inertia=(50, 60, 70), position=(0, 0, 0))
    probe = fb.PointMass("probe", mass=1.0, position=(1000.0, 0, 0), velocity=(3.0, 2.0, 1.0))
    tether = fb.Winch("tether", main.center, probe, stiffness=8e6, mass_per_length=0.05, segments=32,
                      length_at=lambda t: 1000.0 + 6.0 * smooth(t, 5.0))
    result = fb.simulate(fb.compile_scene(fb.Scene(main, probe, tether)), t_end=40.0, step=0.1, every=5, progress=False)
    assert np.max(result.series["strain"]) > 1.0 and result.series["iterations"].max() > 6
    assert abs(result.drift("balance")) < 1e-11 and abs(result.drift("lin_mom")) < 1e-12


# --- vibrations, pictures ------------------------------------------------------------------------------------------------
def hung(**more: Any) -> tuple[fb.Model, fb.PointMass, fb.Result]:
    """A mass of 10 kg at rest on a rope without mass, one segment of 9.9 m."""
    bob = fb.PointMass("bob", mass=10.0, position=(0, 0, -10.0))
    rope = fb.Winch("rope", ORIGIN, bob, stiffness=2e4, mass_per_length=1e-9, segments=1, length=9.9, **more)
    springs = [fb.Spring(rope.coil, fb.GROUND.point((-1.0, 0, 0)), "brake", stiffness=3000.0)] if more else []
    model = fb.compile_scene(fb.Scene(bob, rope, *springs, gravity=(0, 0, -G)))
    return model, bob, fb.solve_static(model, points={"bob": bob, "drum": rope.coil})


def test_modes_and_responses_of_a_pendulum_on_a_winch() -> None:
    """sqrt(g/l) with the length that the weight has drawn it to, and sqrt(EA/(L m)) along the rope."""
    model, bob, rest = hung()
    length = -rest.point("bob")[-1, 2]
    np.testing.assert_allclose(length, 9.9 * (1.0 + 10.0 * G / 2e4), rtol=1e-11)
    found = 2.0 * np.pi * fb.modes(model, state=rest.state, n=3).frequencies
    np.testing.assert_allclose(found, np.sqrt([G / length, G / length, 2e4 / 99.0]), rtol=1e-9)
    f = np.array([0.05, 0.1, 0.3])
    push = fb.Load("push", bob, force=(1.0, 0, 0))
    response = fb.frequency_response(model, f, state=rest.state, loads=push, points={"bob": bob}).point("bob")[:, 0]
    np.testing.assert_allclose(response, 0.1 / (G / length - (2.0 * np.pi * f)**2), rtol=1e-8)


def test_modes_of_a_drum_that_turns_against_a_spring() -> None:
    """U = EA (l - L)^2/(2 L) + k (L - L_0)^2/2, masses m on l and the inertia of the drum on L."""
    from scipy.linalg import eigh
    model, _, rest = hung(inertia=4.0, tension=0.0)
    length, free = -rest.point("bob")[-1, 2], 9.9 + rest.point("drum")[-1, 0]
    of_rope = 2e4 * np.array([[1.0 / free, -length / free**2], [-length / free**2, length**2 / free**3]])
    exact = np.sqrt([G / length, G / length, *eigh(of_rope + np.diag([0.0, 3000.0]), np.diag([10.0, 4.0]))[0]])
    np.testing.assert_allclose(2.0 * np.pi * fb.modes(model, state=rest.state, n=4).frequencies, exact, rtol=1e-8)


def test_modes_of_a_taut_rope_are_those_of_its_segments_and_of_a_string() -> None:
    n, length, chord, stiffness, mass = 16, 9.9, 10.0, 1e4, 0.3
    end = fb.PointMass("end", mass=1.0, position=(chord, 0, 0))
    rope = fb.Winch("rope", ORIGIN, end, stiffness=stiffness, mass_per_length=mass, segments=n, length=length)
    model = fb.compile_scene(fb.Scene(end, rope, fb.Pin(end)))
    found = fb.modes(model, state=fb.solve_static(model).state, n=6).frequencies
    tension, angle = stiffness * (chord - length) / length, np.repeat(np.arange(1, 4) * np.pi / n, 2)
    own = np.sqrt(6.0 * tension / (chord / n * mass * length / n) * (1.0 - np.cos(angle)) / (2.0 + np.cos(angle))) / (2.0 * np.pi)
    np.testing.assert_allclose(found, own, rtol=1e-12)
    np.testing.assert_allclose(found[0], np.sqrt(tension / (mass * length / chord)) / (2.0 * chord), rtol=2e-3)


def test_ropes_are_drawn_as_lines(tmp_path: Any) -> None:
    from fastbeam.results.lines import Lines
    from fastbeam.results.plots.drawing import Shapes
    bob = fb.PointMass("bob", mass=10.0, position=(0, 0, -10.0))
    rope = fb.Winch("rope", ORIGIN, bob, stiffness=2e4, mass_per_length=0.1, segments=4, length_at=lambda t: 9.9 + 0.1 * t * t)
    beam = fb.Beam.straight("beam", (5, 0, 0), (5, 0, -1), section=fb.Section.circle(radius=0.1, E=1e9, rho=1.0), elements=2)
    model = fb.compile_scene(fb.Scene(bob, rope, beam, fb.Clamp(beam.start), gravity=(0, 0, -G)))
    result = fb.simulate(model, t_end=0.5, step=0.01, output=fb.Output(snapshots=5), progress=False)
    result.save(tmp_path / "r.h5")
    for x in (result, fb.load_result(tmp_path / "r.h5")):
        lines = Lines(x.names, x.phi.shape[1])
        assert lines.labels == ["beam", "rope"]
        points = lines.points(x.phi[-1])[lines.starts[1]:]
        assert points.shape == (5, 3) and not np.any(points[0]) and points[-1, 2] < -9.9 and np.all(np.diff(points[:, 2]) < 0.0)
    shapes = Shapes(result)
    # the load alone is a dot, and the drum, a length, does not widen the picture
    assert len(shapes.dots(0)) == 1 and np.max(np.abs(shapes.everything[:, 0])) < 5.0 + 1e-9
    result.to_vtk(tmp_path / "r.vtkhdf")
    with pytest.raises(fb.SceneError, match="an entry of 'ropes' must hold nodes"):
        result._check_names(3)


def test_a_support_lets_go_of_the_load_of_a_winch() -> None:
    """From there on it moves as in a scene without the support, from the same state; what takes hold is refused."""
    def crane(*supports: Any) -> Any:
        crate = fb.PointMass("crate", mass=200.0, position=(0.3, 0, -4.0))
        rope = fb.Winch("hoist", ORIGIN, crate, stiffness=1e5, mass_per_length=1.5, segments=3,
                        length_at=lambda t: 4.0 + 0.5 * np.sin(t)**2)
        return fb.compile_scene(fb.Scene(crate, rope, *[support(crate) for support in supports], gravity=(0, 0, -G)))

    model = crane(lambda crate: fb.Pin(crate, name="hold", until=0.1))
    held = fb.simulate(model, t_end=0.1, step=0.005, progress=False)
    whole = run(model, 0.4, 0.005)
    assert [event["kind"] for event in whole.events] == ["let go"] and whole.drift("balance") < 1e-14
    assert np.max(np.abs(whole.reaction("hold")["force"][-40:])) == 0.0
    free = crane()
    after = fb.simulate(free, t_end=0.4, step=0.005, start=fb.Start(held.state_for(free), time=0.1), progress=False)
    np.testing.assert_allclose(after.state.q, whole.state.q, rtol=0, atol=1e-9)
    assert np.max(np.abs(whole.state.q - held.state.q)) > 0.05
    with pytest.raises(fb.SceneError, match="hold: since, whose impact does not support winches"):
        run(crane(lambda crate: fb.Pin(crate, name="hold", since=0.1)), 0.4, 0.005)
