"""Springs, dampers and bushings against exact and independently integrated motions, equilibria and frequencies."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from scipy.optimize import minimize
from scipy.special import ellipk

import fastbeam as fb

Array = np.ndarray
ORIGIN = fb.GROUND.point((0, 0, 0))
OBSERVED = ("energy", "momentum", "spring")


def mass(position: Any = (0, 0, -1.0), velocity: Any = (0, 0, 0), m: float = 2.0, name: str = "bob") -> fb.PointMass:
    return fb.PointMass(name, mass=m, position=position, velocity=velocity)


def run(scene: fb.Scene, t_end: float, step: float, **more: Any) -> fb.Result:
    return fb.simulate(fb.compile_scene(scene), t_end=t_end, step=step, observe=OBSERVED, progress=False, **more)


def place(result: fb.Result, node: int = 0) -> Array:
    return np.asarray(result.state.q.reshape(-1, 4, 3)[node, 0])


def closed(result: fb.Result) -> float:
    """How well the books close, relative to the largest energy."""
    name = "balance" if "balance" in result.series else "total"
    return float(np.ptp(result.series[name]) / np.max(np.abs([result.series[x] for x in ("kinetic", "potential")])))


# ----------------------------------------------------------------------------------------------------- on a line, exactly
@pytest.mark.parametrize("beside", [True, False], ids=["spring with damping", "damper"])
def test_damped_oscillator(beside: bool) -> None:
    m, k, c, v, t = 2.0, 80.0, 3.0, 0.4, 1.0

    def end(step: float) -> float:
        bob = mass(velocity=(0, 0, -v))
        parts = [fb.Spring(ORIGIN, bob, "s", stiffness=k, damping=c)] if beside else [
            fb.Spring(ORIGIN, bob, "s", stiffness=k), fb.Damper(ORIGIN, bob, "d", damping=c)]
        result = run(fb.Scene(bob, *parts), t, step)
        assert closed(result) < 1e-13
        return -float(place(result)[2]) - 1.0

    delta, w = 0.5 * c / m, np.sqrt(k / m - 0.25 * (c / m)**2)
    exact = v / w * np.exp(-delta * t) * np.sin(w * t)
    coarse, fine = end(0.02), end(0.01)
    assert np.log2((coarse - exact) / (fine - exact)) == pytest.approx(2.0, abs=0.05)
    assert (4.0 * fine - coarse) / 3.0 == pytest.approx(exact, rel=1e-4, abs=1e-6)
    assert abs((16 * (4.0 * end(0.005) - fine) - (4.0 * fine - coarse)) / 45.0 - exact) < 1e-8


def test_a_mass_between_two_ropes_flies_and_swings_in_half_waves() -> None:
    # ropes are slack in the middle, on 0.4 m; each throws it back after half a period
    m, k, v, free = 2.0, 800.0, 1.5, 0.4
    w = np.sqrt(k / m)
    bob = mass(position=(0, 0, 0), velocity=(v, 0, 0))
    ropes = [fb.Spring(fb.GROUND.point((x, 0, 0)), bob, name, stiffness=k, length=3.0 + 0.5 * free, tension_only=True)
             for x, name in ((-3.0, "left"), (3.0, "right"))]
    period = 2.0 * (np.pi / w + free / v)
    result = run(fb.Scene(bob, *ropes), 3.0 * period, period / 600)
    assert closed(result) < 1e-13
    np.testing.assert_allclose(place(result), 0.0, atol=2e-4)
    stretched = result.spring("left")["force"].max()
    assert stretched == pytest.approx(v * np.sqrt(k * m), rel=1e-3)
    finer = run(fb.Scene(bob, *ropes), 3.0 * period, period / 1200)
    assert np.linalg.norm(place(finer)) < 0.4 * np.linalg.norm(place(result))


@pytest.mark.parametrize("step", [0.5, 0.07, 0.01])
def test_energy_is_exact_over_slack_whatever_the_step(step: float) -> None:
    bob = mass(position=(0.3, 0, -0.5), velocity=(1.0, 2.0, -3.0))
    result = run(fb.Scene(bob, fb.Spring(ORIGIN, bob, "rope", stiffness=3000.0, length=1.0, tension_only=True),
                          gravity=(0, 0, -9.81)), 20.0 * step, step)
    force = result.spring("rope")["force"]
    assert np.any(force > 0.0) and np.any(force == 0.0)
    assert closed(result) < 1e-12


def test_buffers_push_alone() -> None:
    # a mass falls on a buffer: up again to where it was
    m, k, g, h = 2.0, 5e3, 9.81, 0.3
    bob = mass(position=(0, 0, 0.5 + h))
    buffer = fb.Spring(ORIGIN, bob, "buffer", stiffness=k, length=0.5, compression_only=True)
    fall, sag = np.sqrt(2.0 * h / g), m * g / k
    w, v = np.sqrt(k / m), np.sqrt(2.0 * g * h)
    contact = 2.0 / w * (np.pi - np.arctan(v / (w * sag)))
    result = run(fb.Scene(bob, buffer, gravity=(0, 0, -g)), 2.0 * fall + contact, (2.0 * fall + contact) / 2000)
    assert place(result)[2] == pytest.approx(0.5 + h, abs=1e-5)
    assert -result.spring("buffer")["force"].min() == pytest.approx(m * g + np.sqrt((m * g)**2 + k * m * v * v), rel=1e-4)
    assert closed(result) < 1e-12


def test_through_the_anchor() -> None:
    """l -> 0: a spring without free length, with a damper, and a rope, whose mass goes through the anchor."""
    m, k, v = 2.0, 50.0, 2.0
    bob = mass(position=(0, 0, 0), velocity=(v, 0, 0))
    for c, allowed in ((0.0, 1e-5), (1.0, 5e-4)):
        # the length has a kink there: in the step across a damper misses what the length turns back, an error of first order
        result = run(fb.Scene(bob, fb.Spring(ORIGIN, bob, "s", table=([0, 1], [0, k]), length=0.0, damping=c)), 2.0, 0.001)
        delta, w = 0.5 * c / m, np.sqrt(k / m - 0.25 * (c / m)**2)
        np.testing.assert_allclose(place(result), [v / w * np.exp(-2.0 * delta) * np.sin(2.0 * w), 0, 0], rtol=0.0, atol=allowed)
        assert closed(result) < 1e-12
    rope = run(fb.Scene(bob, fb.Spring(ORIGIN, bob, "s", stiffness=k, length=0.3, tension_only=True)), 4.0, 0.01)
    assert closed(rope) < 1e-12 and np.min(rope.spring("s")["length"]) < 0.05


# --------------------------------------------------------------------------------------------------- against integrations
def integrated(force: Any, t: float, x: Any, v: Any, m: float = 2.0, c: float = 0.0, g: float = 9.81) -> Array:
    """Place at time t of a mass on a spring to the origin, force of its length."""
    def rates(_: float, y: Array) -> Array:
        length = np.linalg.norm(y[:3])
        pull = (force(length) + c * (y[:3] @ y[3:]) / length) / length
        return np.concatenate((y[3:], -pull / m * y[:3] + [0.0, 0.0, -g]))

    return np.asarray(solve_ivp(rates, (0.0, t), [*x, *v], method="DOP853", rtol=1e-12, atol=1e-13).y[:3, -1])


@pytest.mark.parametrize(("order", "steps", "error"), [(2, (0.01, 0.005), 3e-3), (4, (0.02, 0.01), 2e-6)])
def test_a_table_through_a_cubic_is_duffings_spring(order: int, steps: tuple[float, float], error: float) -> None:
    k, beta, length = 60.0, 900.0, 0.9
    e = np.linspace(-0.5, 0.6, 9)
    bob = mass(position=(0, 0, -1.0), velocity=(0.6, 0.2, 0))
    scene = fb.Scene(bob, fb.Spring(ORIGIN, bob, "s", table=(e, k * e + beta * e**3), interpolation="spline", length=length),
                     gravity=(0, 0, -9.81))
    exact = integrated(lambda x: k * (x - length) + beta * (x - length)**3, 1.0, (0, 0, -1.0), (0.6, 0.2, 0))
    runs = [run(scene, 1.0, step, order=order) for step in steps]
    errors = [float(np.linalg.norm(place(x) - exact)) for x in runs]
    assert errors[1] < error and np.log2(errors[0] / errors[1]) > order - 0.4
    assert all(closed(x) < 1e-13 for x in runs)


@pytest.mark.parametrize("damping", [0.0, 1.5])
def test_a_pendulum_on_a_rope_that_goes_slack(damping: float) -> None:
    # thrown up too slowly to go round: the rope goes slack, the mass flies, and the rope catches it
    k, length, x, v = 2000.0, 1.0, (0.0, 0.0, -1.01), (5.5, 0.0, 0.0)

    def rates(_: float, y: Array) -> Array:
        at = np.linalg.norm(y[:3])
        pull = (k * (at - length) + damping * (y[:3] @ y[3:]) / at) / at if at > length else 0.0
        return np.concatenate((y[3:], -0.5 * pull * y[:3] + [0.0, 0.0, -9.81]))

    exact = solve_ivp(rates, (0.0, 0.9), [*x, *v], method="DOP853", rtol=1e-12, atol=1e-13, max_step=1e-3).y[:3, -1]
    bob = mass(position=x, velocity=v)
    scene = fb.Scene(bob, fb.Spring(ORIGIN, bob, "rope", stiffness=k, length=length, tension_only=True, damping=damping),
                     gravity=(0, 0, -9.81))
    runs = [run(scene, 0.9, step) for step in (1e-3, 5e-4)]
    errors = [float(np.linalg.norm(place(r) - exact)) for r in runs]
    assert np.any(runs[0].spring("rope")["force"] == 0.0)
    assert errors[1] < 2e-4 and errors[1] < 0.4 * errors[0]
    assert all(closed(r) < 1e-12 for r in runs)


def test_kinks_of_a_table_keep_order_two() -> None:
    e, f = np.array([-0.2, 0.0, 0.1, 0.3]), np.array([-8.0, 0.0, 30.0, 40.0])

    def force(length: float) -> float:
        x = length - 1.0
        slope = 40.0 if x < 0.0 else 300.0 if x < 0.1 else 50.0
        return slope * x if x < 0.1 else 30.0 + slope * (x - 0.1)

    bob = mass(velocity=(0.8, 0, 0.5))
    scene = fb.Scene(bob, fb.Spring(ORIGIN, bob, "s", table=(e, f), length=1.0), gravity=(0, 0, -9.81))
    exact = integrated(force, 1.0, (0, 0, -1.0), (0.8, 0, 0.5))
    runs = [run(scene, 1.0, step) for step in (2e-3, 1e-3)]
    errors = [float(np.linalg.norm(place(r) - exact)) for r in runs]
    assert errors[1] < 2e-4 and np.log2(errors[0] / errors[1]) > 1.5
    assert all(closed(r) < 1e-12 for r in runs)


# --------------------------------------------------------------------------------------------------------- user scenes
def test_bungee_jump() -> None:
    """A rope of 20 springs that is slack at first, with its own mass; the jumper stops where the energies say."""
    n, length, total, k, m = 20, 12.0, 8.0, 160.0, 75.0
    beads = [fb.PointMass(f"bead {i}", mass=total / n, position=(0.15 * (i % 2), 0.0, 0.0 - 0.01 * i)) for i in range(1, n + 1)]
    jumper = fb.PointMass("jumper", mass=m, position=(0.8, 0, 0.0), velocity=(0.4, 0, 0))
    ends = [fb.GROUND.point((0, 0, 0)), *beads, jumper]
    rope = [fb.Spring(a, b, f"rope {i}", stiffness=k * (n + 1), length=length / (n + 1), tension_only=True, damping=20.0)
            for i, (a, b) in enumerate(zip(ends, ends[1:]))]
    result = run(fb.Scene(*beads, jumper, *rope, gravity=(0, 0, -9.81)), 6.0, 2e-3, points={"jumper": jumper})
    assert closed(result) < 1e-11
    z = result.point("jumper")[:, 2]
    fall = np.sqrt(2.0 * length / 9.81)
    # free until the rope is taut; the deepest point of a jumper on a rope without mass and damping is a little deeper
    free = result.t < 0.9 * fall
    np.testing.assert_allclose(z[free], -0.5 * 9.81 * result.t[free]**2, atol=0.2)
    e = m * 9.81 / k
    deepest = length + e + np.sqrt(e * e + 2.0 * e * length)
    assert 0.85 * deepest < -z.min() < 1.05 * deepest
    slack = np.array([result.spring(f"rope {i}")["force"] == 0.0 for i in range(n + 1)])
    assert slack[:, result.t < 0.5].mean() > 0.5 and np.all(~slack[1:, np.argmin(z)])


def test_a_cable_net_with_slack_springs_finds_its_equilibrium() -> None:
    """Against the least energy found by another program, from a start where some are slack."""
    n, k = 5, 400.0
    x = np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), axis=-1).reshape(-1, 2).astype(float)
    edge = (x == 0).any(axis=1) | (x == n - 1).any(axis=1)
    start = np.column_stack((x, -0.4 * np.sin(np.pi * x[:, 0] / (n - 1)) * np.sin(np.pi * x[:, 1] / (n - 1))))
    knots = [fb.PointMass(f"k{i}", mass=1.0, position=p) for i, p in enumerate(start)]
    pairs = [(i, j) for i in range(n * n) for j in (i + 1, i + n) if j < n * n and (j == i + n or j % n)]
    # braces along diagonals, longer than the cells: slack
    braces = [(i, i + n + 1) for i in range(n * n - n - 1) if i % n < n - 1]
    rest = np.array([1.0] * len(pairs) + [1.5] * len(braces))
    ropes = [fb.Spring(knots[i], knots[j], f"s{e}", stiffness=k, length=length, tension_only=True)
             for e, ((i, j), length) in enumerate(zip(pairs + braces, rest))]
    scene = fb.Scene(*knots, *(fb.Pin(knots[i]) for i in np.flatnonzero(edge)), *ropes, gravity=(0, 0, -9.81))
    result = fb.solve_static(fb.compile_scene(scene), observe=("energy", "spring"))
    found = result.state.q.reshape(-1, 4, 3)[:n * n, 0]
    both = np.array(pairs + braces)

    def energy(y: Array) -> tuple[float, Array]:
        p = start.copy()
        p[~edge] = y.reshape(-1, 3)
        r = p[both[:, 1]] - p[both[:, 0]]
        length = np.linalg.norm(r, axis=1)
        e = np.maximum(length - rest, 0.0)
        pull = (k * e / length)[:, None] * r
        gradient = np.zeros_like(p)
        np.add.at(gradient, both[:, 1], pull)
        np.add.at(gradient, both[:, 0], -pull)
        gradient[:, 2] += 9.81
        return 0.5 * k * float(e @ e) + 9.81 * float(p[:, 2].sum()), gradient[~edge].reshape(-1)

    least = minimize(energy, start[~edge].reshape(-1), jac=True, method="BFGS", options={"gtol": 1e-9, "maxiter": 2000})
    assert energy(found[~edge].reshape(-1))[0] == pytest.approx(least.fun, abs=1e-9)
    assert np.max(np.abs(energy(found[~edge].reshape(-1))[1])) < 1e-9
    forces = result.series["spring_force"][-1]
    assert np.sum(forces == 0.0) >= len(braces) // 2 and np.all(forces >= 0.0)


def test_an_equilibrium_that_slack_ropes_leave_open_says_so() -> None:
    bob = mass(position=(0.1, 0, -1.0))
    hung = fb.compile_scene(fb.Scene(bob, fb.Spring(ORIGIN, bob, "rope", stiffness=1e3, length=1.2, tension_only=True),
                                     gravity=(0, 0, -9.81)))
    with pytest.raises(fb.ConvergenceError, match="1 of the springs with tension or compression only are slack .'rope'., and "
                                                  "have no stiffness"):
        fb.solve_static(hung, levels=(0.5,))
    # from where it is taut, and relaxed
    start = hung.state()
    start.q[:3] = 0.0, 0.0, -1.25
    for begin, events in ((start, []), (None, ["relaxed"])):
        found = fb.solve_static(hung, start=begin, observe=("energy", "spring"))
        assert found.spring("rope")["force"][-1] == pytest.approx(2.0 * 9.81, rel=1e-12)
        assert place(found)[2] == pytest.approx(-1.2 - 2.0 * 9.81 / 1e3, rel=1e-12)
        assert [event["kind"] for event in found.events] == events


def test_a_net_that_begins_slack_is_relaxed() -> None:
    n = 4
    knots = [[mass((i, j, 0), name=f"m{i}{j}", m=0.1) for j in range(n)] for i in range(n)]
    pairs = [(knots[i][j], knots[a][b]) for i in range(n) for j in range(n) for a, b in ((i + 1, j), (i, j + 1)) if max(a, b) < n]
    cords = [fb.Spring(a, b, f"cord {k}", stiffness=1e3, length=1.05, tension_only=True) for k, (a, b) in enumerate(pairs)]
    pins = [fb.Pin(knots[i][j]) for i in (0, n - 1) for j in (0, n - 1)]
    net = fb.compile_scene(fb.Scene(*sum(knots, []), *cords, *pins, gravity=(0, 0, -9.81)))
    with pytest.raises(fb.ConvergenceError, match="24 of the springs with tension or compression only are slack .* or let "
                                                  "fb.relax.model."):
        fb.solve_static(net, levels=(0.5,))
    found = fb.relax(net)
    np.testing.assert_allclose(fb.solve_static(net).state.q, found.state.q, atol=1e-9)
    rest = fb.solve_static(net, start=found.state, load_step=1.0, observe=("spring", "reaction"))
    np.testing.assert_allclose(rest.state.q, found.state.q, atol=1e-12)
    # all of its weight hangs on the corners
    pulls = sum(rest.reaction(pin)["force"][-1] for pin in pins)
    np.testing.assert_allclose(np.abs(pulls), (0, 0, n * n * 0.1 * 9.81), atol=1e-9)
    assert found.info["unstable_directions"] == 0 and np.all(rest.series["spring_force"][-1] >= 0.0)


def test_reactions_and_step_control_know_springs_with_damping() -> None:
    anchor, bob = mass((0, 0, 0), name="anchor", m=1.0), mass((0.1, 0, -1.0), (1.0, 0.5, 2.0))
    scene = fb.Scene(anchor, fb.Pin(anchor, "pin"), bob, fb.Spring(anchor, bob, "s", stiffness=100.0, damping=3.0),
                     gravity=(0, 0, -9.81))
    model, errors = fb.compile_scene(scene), []
    for step in (0.01, 0.005):
        result = fb.simulate(model, t_end=0.5, step=step, observe=("energy", "spring", "reaction"), points={"bob": bob},
                             progress=False)
        along = result.point("bob") / result.spring("s")["length"][:, None]
        expected = np.array([0.0, 0.0, 9.81]) - result.spring("s")["force"][:, None] * along
        errors.append(float(np.max(np.abs(result.reaction("pin")["force"] - expected)[1:-1])))
    assert errors[1] < 0.02 and np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.2)
    free = fb.simulate(model, t_end=0.5, step=0.01, tolerance=1e-6, progress=False)
    assert closed(free) < 1e-12 and len(np.unique(np.round(free.series["step_size"], 12))) > 2
    np.testing.assert_allclose(place(free, 1), place(result, 1), atol=2e-4)


# ----------------------------------------------------------------------------------------------------------- bushings
def test_modes_of_a_body_on_a_full_stiffness() -> None:
    rng = np.random.default_rng(1)
    a, frame = rng.standard_normal((6, 6)), np.linalg.qr(rng.standard_normal((3, 3)))[0]
    frame *= np.linalg.det(frame)
    size = np.diag([30.0, 30, 30, 3, 3, 3])
    stiffness = 10.0 * size @ (a @ a.T + 0.1 * np.eye(6)) @ size
    position, arm = np.array([0.5, 0.2, 0.1]), np.array([0.1, 0.05, -0.2])
    body = fb.RigidBody("b", mass=3.0, inertia=(0.2, 0.3, 0.25), position=position)
    mount = fb.Bushing(fb.GROUND.point(position + arm - [0.1, 0, 0]), body.point(arm), "m", stiffness=stiffness, directors=frame)
    # in space, moved to the centre of the body
    both, lever = np.kron(np.eye(2), frame), np.eye(6)
    # displacement of the point: v + spin x arm
    lever[:3, 3:] = np.cross(np.eye(3), arm).T
    at_center = lever.T @ both.T @ stiffness @ both @ lever
    exact = np.sqrt(eigh(at_center, np.diag([3, 3, 3, 0.2, 0.3, 0.25]), eigvals_only=True))
    modes = fb.modes(fb.compile_scene(fb.Scene(body, mount)), n=6)
    np.testing.assert_allclose(modes.frequencies * 2.0 * np.pi, exact, rtol=1e-9)
    load = np.array([1e-6, 2e-6, -1e-6, 1e-7, -2e-7, 3e-7])
    scene = fb.Scene(body, mount, fb.Load("f", body, force=load[:3], moment=load[3:]))
    result = fb.solve_static(fb.compile_scene(scene), observe=("energy", "spring"))
    answer = np.linalg.solve(at_center, load)
    np.testing.assert_allclose(place(result) - position, answer[:3], rtol=0.0, atol=1e-4 * np.abs(answer[:3]).max())
    np.testing.assert_allclose(result.bushing("m")["force"][-1], frame @ load[:3], rtol=1e-5)
    np.testing.assert_allclose(result.bushing("m")["rotation"][-1], frame @ answer[3:], rtol=0.0,
                               atol=1e-4 * np.abs(answer[3:]).max())


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_large_turns_about_one_axis_are_those_of_a_pendulum(axis: int) -> None:
    # moment k sin(angle): the period of a pendulum
    inertia, k, angle = (0.2, 0.3, 0.25), 6.0, 2.0
    stiffness = np.array([100.0, 100, 100, 1, 1, 1])
    stiffness[3 + axis] = k
    w = np.sqrt(k / inertia[axis])
    # through 0 with the speed of this amplitude
    spin = 2.0 * w * np.sin(0.5 * angle) * np.eye(3)[axis]
    period = 4.0 * ellipk(np.sin(0.5 * angle)**2) / w
    body = fb.RigidBody("b", mass=1.0, inertia=inertia, position=(0, 0, 0), spin=spin)
    scene = fb.Scene(body, fb.Bushing(ORIGIN, body, "m", stiffness=stiffness))
    result = run(scene, period, period / 200, order=4)
    turn = result.bushing("m")["rotation"][:, axis]
    assert abs(turn[-1]) < 1e-6 and np.max(turn) == pytest.approx(angle, rel=1e-4)
    assert result.bushing("m")["moment"].max() == pytest.approx(k, rel=1e-3)
    assert closed(result) < 1e-12


def test_a_damped_torsion_spring() -> None:
    inertia, k, c, spin, t = 0.3, 6.0, 0.4, 5.0, 1.0
    exact = solve_ivp(lambda _, y: [y[1], (-k * np.sin(y[0]) - c * y[1]) / inertia], (0.0, t), [0.0, spin], method="DOP853",
                      rtol=1e-12, atol=1e-13).y[0, -1]
    body = fb.RigidBody("b", mass=1.0, inertia=(inertia,) * 3, position=(0, 0, 0), spin=(0, spin, 0))
    scene = fb.Scene(body, fb.Bushing(ORIGIN, body, "m", stiffness=(9, 9, 9, 0, k, 0), damping=(0, 0, 0, 0, c, 0)))
    found = []
    for step in (0.01, 0.005):
        result = run(scene, t, step)
        assert closed(result) < 1e-12
        found.append(float(result.bushing("m")["rotation"][-1, 1]))
    assert np.log2((found[0] - exact) / (found[1] - exact)) == pytest.approx(2.0, abs=0.1)
    assert abs((4.0 * found[1] - found[0]) / 3.0 - exact) < 1e-7


def test_energy_and_momenta_of_two_bodies_on_a_bushing() -> None:
    rng = np.random.default_rng(3)
    a = rng.standard_normal((6, 6))
    parts = [fb.RigidBody("a", mass=2.0, inertia=(0.1, 0.2, 0.15), position=(0, 0, 0), spin=(0.1, 3.0, 2.0)),
             fb.RigidBody("b", mass=3.0, inertia=(0.2, 0.3, 0.25), position=(0.5, 0.2, 0.1), velocity=(0.2, 0.1, -0.3))]
    mount = fb.Bushing(parts[0].point((0.3, 0, 0)), parts[1].point((0, 0.1, -0.2)), "m", stiffness=10.0 * a @ a.T)
    result = run(fb.Scene(*parts, mount), 20.0, 0.01)
    assert closed(result) < 1e-12
    assert result.bushing("m")["energy"].max() > 0.05 * result.series["kinetic"].max()
    for name in ("lin_mom", "ang_mom"):
        x = result.series[name]
        assert np.max(np.abs(x - x[0])) < 1e-13 * np.linalg.norm(x[0])


@pytest.mark.parametrize("planar", [True, False])
def test_a_cantilever_on_an_elastic_foundation_of_bushings(planar: bool) -> None:
    """Bar on an elastic clamp: its tip sinks by the clamp's tilt and shift besides its own bending."""
    bar = fb.Section.circle(radius=0.01, E=1e8, rho=1000.0)
    beam = fb.Beam.straight("b", (0, 0, 0), (1, 0, 0), section=bar, elements=8, degree=3)
    force, k, turn = 1e-4, 30.0, 2.0
    scene = fb.Scene(beam, fb.Bushing(ORIGIN, beam.start, "clamp", stiffness=(k, k, k, turn, turn, turn)),
                     fb.Load("f", beam.end, force=(0, -force, 0)))
    result = fb.solve_static(fb.compile_scene(scene, planar=planar))
    expected = -force * (1.0 / (3.0 * bar.EI2) + 1.0 / bar.GA2 + 1.0 / k + 1.0 / turn)
    assert place(result, beam.n_nodes - 1)[1] == pytest.approx(expected, rel=1e-6)
    assert result.info["unstable_directions"] == 0


def test_the_recipes_of_the_how_to() -> None:
    """The code of its section on springs runs, and gives what its text says."""
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "joints.md").read_text(encoding="utf-8")
    section = page.split("\n## Springs, dampers, bushings\n")[1].split("\n## ")[0]
    code = "\n".join(line[4:] for line in section.splitlines() if line.startswith("    "))
    found: dict[str, Any] = {"fb": fb}
    exec(code, found)
    jump, sunk, modes = found["jump"], found["sunk"], fb.modes(found["on_mounts"], state=found["sunk"].state, n=6)
    assert closed(jump) < 1e-12 and np.any(jump.spring("rope")["force"] == 0.0)
    for name in ("mount 0", "mount 1", "mount 2", "mount 3"):
        np.testing.assert_allclose(sunk.bushing(name)["force"][-1], [0.0, 0.0, -150.0 * 9.81 / 4], rtol=0.0, atol=1e-6)
    assert modes.frequencies[0] > 1.0 and np.any(np.abs(modes.frequencies * 2.0 * np.pi - np.sqrt(4 * 3e5 / 150.0)) < 1e-6)


# ------------------------------------------------------------------------------------------------------ ends that pass
def pressed(force: float) -> fb.Model:
    """A mass on a vertical guide, on a buffer of 20 mm that pushes alone with 2000 N/m, up to 40 N, and a spring above."""
    bob = fb.PointMass("bob", mass=1.0, position=(0, 0, 0))
    return fb.compile_scene(fb.Scene(
        bob, fb.Pin(bob, axes="xy"), fb.Load("press", bob, force=(0, 0, -force)),
        fb.Spring(bob, fb.GROUND.point((0, 0, 1)), "hanger", stiffness=100.0, length=1.0),
        fb.Spring(bob, fb.GROUND.point((0, 0, -0.02)), "buffer", stiffness=2000.0, length=0.02, compression_only=True)))


@pytest.mark.parametrize("force", [4.0, 10.0, 35.0])
def test_statics_do_not_step_over_a_buffer(force: float) -> None:
    """In the first load step the buffer is at its kink and resists nothing: the mass went through it, and was left with 0 N."""
    found = fb.solve_static(pressed(force), observe=("spring",))
    np.testing.assert_allclose(found.state.q[2], -force / 2100.0, rtol=1e-9)
    np.testing.assert_allclose(found.spring("buffer")["force"][-1], -2000.0 * force / 2100.0, rtol=1e-9)
    assert not [e for e in found.events if e["kind"] == "unresolved"]


def test_a_buffer_that_is_pushed_through_is_told() -> None:
    model = pressed(60.0)
    # on its side there is no equilibrium beyond 40 N and the 2 N of the spring above
    through = fb.solve_static(model)
    np.testing.assert_allclose(through.state.q[2], -0.6, rtol=1e-12)
    (event,) = [e for e in through.events if e["kind"] == "unresolved"]
    says = "spring 'buffer': its ends pass each other between the "
    assert event["text"].startswith(says + "load factor 0.7 and the load factor 0.7. From there on its force acts in the "
                                           "opposite direction")
    # at rest where it was left the buffer never pushes again, and the run says so
    run = fb.simulate(model, start=through.state, t_end=0.02, step=0.01, progress=False)
    (event,) = [e for e in run.events if e["kind"] == "start"]
    assert event["text"].startswith("spring 'buffer' has no force at the start, and points in the opposite direction than in the "
                                    "scene")
    assert not fb.simulate(model, start=fb.solve_static(pressed(10.0)).state, t_end=0.02, step=0.01, progress=False).events
    relaxed = fb.relax(model)
    assert relaxed.state.q[2] < -0.02 and [e for e in relaxed.events if e["text"].startswith(says + "shape at t = 0 s and")]
