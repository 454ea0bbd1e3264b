"""Joints with axes: exact motions, a twin in minimal coordinates, linkages, springs, dampers and motors; conservation."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import minimize
from scipy.special import ellipk

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parents[1]))
from naive_constraints import largest_gap  # noqa: E402

Array = np.ndarray
G = 9.81


def body(name: str, position: Any, **options: Any) -> fb.RigidBody:
    return fb.RigidBody(name, **{"mass": 1.0, "inertia": (0.02, 0.03, 0.04), "position": position, **options})


def hinge(a: Any, b: Any, at: Any, axis: Any, name: str, **options: Any) -> fb.RevoluteJoint:
    """A revolute joint at a place in space."""
    sides = [x if x is fb.GROUND else x.point((np.asarray(at, float) - x.position) @ x.directors.T) for x in (a, b)]
    return fb.RevoluteJoint(*sides, name, axis=axis, **options)


def run(model: fb.Model, t_end: float, step: float, **options: Any) -> fb.Result:
    return fb.simulate(model, t_end=t_end, step=step, progress=False, **options)


# --------------------------------------------------------------------------------------------------------- exact motions
def pendulum(angle: float, **options: Any) -> fb.Scene:
    """A body 0.5 m below a hinge about y, turned from there."""
    turn = np.array([[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]])
    arm = body("arm", 0.5 * np.array([-np.sin(angle), 0, -np.cos(angle)]), directors=turn)
    return fb.Scene(arm, hinge(fb.GROUND, arm, (0, 0, 0), (0, 1, 0), "pivot", **options), gravity=(0, 0, -G))


def test_period_of_a_physical_pendulum_is_that_of_the_elliptic_integral() -> None:
    amplitude = 2.0
    inertia = 0.03 + 0.25
    period = 4.0 * np.sqrt(inertia / (G * 0.5)) * ellipk(np.sin(0.5 * amplitude)**2)
    model = fb.compile_scene(pendulum(amplitude), planar=False)
    for order, steps, best in ((2, (200, 400), 1e-4), (4, (50, 100), 2e-6)):
        errors = []
        for n in steps:
            result = run(model, period, period / n, order=order)
            # half a turn of the phase is where the angle hardly moves: the spin tells the time
            errors.append(abs(result.joint("pivot")["spin"][-1]) / (G * 0.5 * np.sin(amplitude) / inertia) / period)
            assert result.drift("total") < 1e-12 and largest_gap(model, result.state.q) < 1e-14
        assert errors[1] < best and np.log2(errors[0] / errors[1]) > order - 0.3


class Twin:
    """Two bodies, the first on a hinge with the ground, the second on one with the first, in the two angles: Lagrange's equations
    with differences of the kinetic and potential energy in the place of formulas."""

    axes = np.array([[0.0, 1.0, 0.0], [1.0, 1.0, 0.3] / np.linalg.norm([1.0, 1.0, 0.3])])
    # hinges and centres of mass at angle zero
    hinge, centre = np.array([[0.0, 0, 0], [1.0, 0, 0]]), np.array([[0.5, 0, 0], [1.5, 0, 0.2]])
    inertia = np.diag([0.02, 0.03, 0.04])

    @staticmethod
    def turn(axis: Array, angle: float) -> Array:
        k = np.cross(np.eye(3), axis)
        return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * (k @ k)

    def place(self, angles: Array) -> tuple[list[Array], list[Array]]:
        first = self.turn(self.axes[0], angles[0])
        second = first @ self.turn(self.axes[1], angles[1])
        joint = first @ self.hinge[1]
        return [first @ self.centre[0], joint + second @ (self.centre[1] - self.hinge[1])], [first, second]

    def mass(self, angles: Array) -> Array:
        centre, turns = self.place(angles)
        spins = np.array([[self.axes[0], np.zeros(3)], [self.axes[0], turns[0] @ self.axes[1]]])
        joint = turns[0] @ self.hinge[1]
        out = np.zeros((2, 2))
        for k in (0, 1):
            way = np.array([np.cross(spins[k, 0], centre[k]), np.cross(spins[k, 1], centre[k] - joint)])
            out += way @ way.T + spins[k] @ turns[k] @ self.inertia @ turns[k].T @ spins[k].T
        return out

    def rates(self, t: float, y: Array) -> Array:
        x, v, e = y[:2], y[2:], 1e-5
        by = [(self.mass(x + e * d) - self.mass(x - e * d)) / (2 * e) for d in np.eye(2)]
        fall = [(sum(c[2] for c in self.place(x + e * d)[0]) - sum(c[2] for c in self.place(x - e * d)[0])) / (2 * e)
                for d in np.eye(2)]
        force = np.array([0.5 * v @ m @ v for m in by]) - sum(m * r for m, r in zip(by, v)) @ v - G * np.array(fall)
        return np.concatenate((v, np.linalg.solve(self.mass(x), force)))


def double_pendulum() -> fb.Scene:
    """The scene of the twin."""
    a, b = (body(name, place) for name, place in zip("ab", Twin.centre))
    return fb.Scene(a, b, hinge(fb.GROUND, a, Twin.hinge[0], Twin.axes[0], "first"),
                    hinge(a, b, Twin.hinge[1], Twin.axes[1], "second"), gravity=(0, 0, -G))


def test_double_pendulum_with_oblique_axes_moves_like_its_twin_in_two_angles() -> None:
    exact = solve_ivp(Twin().rates, (0.0, 1.0), [0, 0, 0, 0], method="DOP853", rtol=1e-10, atol=1e-11).y[:, -1]
    model = fb.compile_scene(double_pendulum())
    assert model.plane is None
    for order, steps, best in ((2, (0.002, 0.001), 1e-3), (4, (0.01, 0.005), 1e-6)):
        errors = []
        for step in steps:
            result = run(model, 1.0, step, order=order)
            found = [result.joint(name)[what][-1] for what in ("angle", "spin") for name in ("first", "second")]
            off = np.abs(np.array(found) - exact)
            # velocities meet the joints at the end of a step to second order, whatever the order of the motion
            errors.append(float(np.max(off if order == 2 else off[:2])))
            assert result.drift("total") < 1e-12 and largest_gap(model, result.state.q) < 1e-14
        assert errors[1] < best and np.max(off) < 1e-3 and np.log2(errors[0] / errors[1]) > order - 0.4


def test_a_free_rotor_under_constant_torque_turns_as_it_should() -> None:
    """Angles over several turns, 1/2 torque t^2 / inertia, and the work is in the books."""
    model = fb.compile_scene(with_forces(torque=0.05, gravity=(0, 0, 0)), planar=False)
    result = run(model, 20.0, 0.02, every=50)
    joint = result.joint("pivot")
    inertia = 0.03 + 0.25
    assert joint["angle"][-1] > 10 * np.pi
    np.testing.assert_allclose(joint["angle"], 0.025 * result.t**2 / inertia, rtol=1e-3, atol=1e-12)
    np.testing.assert_allclose(joint["work"], result.series["kinetic"], rtol=1e-11, atol=1e-12)
    assert result.drift("balance") < 1e-12


def with_forces(gravity: Any = (0, 0, -G), **options: Any) -> fb.Scene:
    """The pendulum with a second body that hangs on it by a damped spring; the first joint takes what is given."""
    arm = body("arm", (0.5, 0, 0))
    return fb.Scene(arm, hinge(fb.GROUND, arm, (0, 0, 0), (0, 1, 0), "pivot", **options), gravity=gravity)


@pytest.mark.parametrize("planar", [False, "auto"], ids=["space", "plane"])
def test_torsion_spring_and_damper_against_a_reference_integrator(planar: Any) -> None:
    k, c, rest, inertia = 6.0, 0.4, 0.5, 0.03 + 0.25

    def torque(t: float) -> float:
        return 2.0 * np.cos(3.0 * t)

    exact = solve_ivp(lambda t, y: [y[1], (G * 0.5 * np.cos(y[0]) - k * (y[0] - rest) - c * y[1] + torque(t)) / inertia],
                      (0.0, 2.0), [0, 0], method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    model = fb.compile_scene(with_forces(stiffness=k, damping=c, rest=rest, torque=torque), planar=planar)
    assert (model.plane is None) == (planar is False)
    errors = []
    for step in (0.0025, 0.00125):
        result = run(model, 2.0, step)
        joint = result.joint("pivot")
        errors.append(abs(joint["angle"][-1] - exact[0]) + abs(joint["spin"][-1] - exact[1]))
        assert result.drift("balance") < 1e-13
        assert np.all(np.diff(joint["loss"]) >= 0.0) and joint["loss"][-1] > 0.1
        parts = result.balance()
        assert {"damper of joint 'pivot'", "motor of joint 'pivot'"} <= set(parts)
        assert np.ptp(parts["sum"]) < 1e-12
        assert joint["energy"][-1] == pytest.approx(0.5 * k * (joint["angle"][-1] - rest)**2)
    assert errors[1] < 2e-4 and np.log2(errors[0] / errors[1]) > 1.9


def test_a_motor_in_time_goes_on_from_a_checkpoint_bit_for_bit() -> None:
    model = fb.compile_scene(with_forces(stiffness=6.0, damping=0.4, torque=lambda t: 20.0 * np.sin(t)), planar=False)
    whole = run(model, 2.0, 0.01)
    first = run(model, 0.83, 0.01)
    second = run(model, 2.0, 0.01, start=first.checkpoint)
    for x, y in zip(whole.state, second.state):
        np.testing.assert_array_equal(x, y)
    np.testing.assert_array_equal(whole.joint("pivot")["angle"][-1], second.joint("pivot")["angle"][-1])


def test_equilibrium_on_a_torsion_spring() -> None:
    k = 8.0
    scene = with_forces(stiffness=k)
    for planar in (False, "auto"):
        model = fb.compile_scene(scene, planar=planar)
        rest = fb.solve_static(model)
        x = rest.state.q.reshape(-1, 4, 3)[0, 0]
        angle = np.arctan2(-x[2], x[0])
        assert k * angle == pytest.approx(G * 0.5 * np.cos(angle), rel=1e-10)
        assert rest.info["unstable_directions"] == 0


@pytest.mark.parametrize("planar", [False, "auto"], ids=["space", "plane"])
def test_equilibrium_of_a_slide_on_an_arm_is_the_least_energy(planar: Any) -> None:
    stiffness = 15.0, 60.0

    def energy(x: Array) -> float:
        place = (0.7 + x[1]) * np.sin(x[0]) + 0.1 * np.cos(x[0])
        return float(0.5 * np.dot(stiffness, x**2) - G * (0.5 * np.sin(x[0]) + 0.6 * place))

    exact = minimize(energy, (0.3, 0.1), tol=1e-14).x
    arm, slide = body("arm", (0.5, 0, 0)), body("slide", (0.7, 0, -0.1), mass=0.6)
    scene = fb.Scene(arm, slide, hinge(fb.GROUND, arm, (0, 0, 0), (0, 1, 0), "pivot", stiffness=stiffness[0]),
                     fb.PrismaticJoint(arm.point((0.1, 0, 0.05)), slide, "guide", axis=(1, 0, 0), stiffness=stiffness[1]),
                     gravity=(0, 0, -G))
    model = fb.compile_scene(scene, planar=planar)
    rest = fb.solve_static(model)
    run_on = run(model, 0.1, 0.01, start=rest.state)
    found = run_on.joint("pivot")["angle"][0], run_on.joint("guide")["distance"][0]
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=1e-6)
    # and it stays there
    assert np.ptp(run_on.joint("pivot")["angle"]) < 1e-11 and largest_gap(model, rest.state.q) < 1e-14
    assert rest.info["unstable_directions"] == 0


# -------------------------------------------------------------------------------------------------------------- linkages
def four_bar(ball_joints: bool = False) -> fb.Scene:
    """Crank, coupler and rocker between two pivots; the crank goes round. With hinges in space three constraints too many."""
    p = np.array([[0.0, 0, 0], [0, 0.3, 0], [0, 0, 0], [1.1, 0, 0]])
    reach = p[3] - p[1]
    length = np.linalg.norm(reach)
    along = (1.0 - 0.81 + length**2) / (2 * length)
    across = np.array([-reach[1], reach[0], 0]) / length
    p[2] = p[1] + along * reach / length + np.sqrt(1.0 - along**2) * across
    bars = [body(name, 0.5 * (p[k] + p[k + 1])) for k, name in enumerate(("crank", "coupler", "rocker"))]
    joints: list[Any] = []
    if ball_joints:
        stands = [body("left", p[0]), body("right", p[3])]
        for k, (a, b) in enumerate(zip([stands[0], *bars], [*bars, stands[1]])):
            for side in (-0.1, 0.1):
                at = p[k] + np.array([0, 0, side])
                joints.append(fb.BallJoint(a.point(at - a.position), b.point(at - b.position)))
        joints += [*stands, *(fb.Clamp(stand) for stand in stands)]
    else:
        joints = [hinge(a, b, p[k], (0, 0, 1), "ABCD"[k])
                  for k, (a, b) in enumerate(zip([fb.GROUND, *bars], [*bars, fb.GROUND]))]
    return fb.Scene(*bars, *joints, fb.RigidMotion(bars[0], spin=(0, 0, 8.0)), gravity=(0, -G, 0), project_velocities=True)


def slider_crank(**drive: Any) -> fb.Scene:
    r, length, w = 0.3, 1.0, 4.0
    x = np.sqrt(length**2 - r**2)
    crank = body("crank", (0, 0, 0.5 * r), spin=(0, w, 0), velocity=(0.5 * r * w, 0, 0))
    rod, piston = body("rod", (0.5 * x, 0, 0.5 * r), velocity=(r * w, 0, 0)), body("piston", (x, 0, 0), velocity=(r * w, 0, 0))
    return fb.Scene(crank, rod, piston, hinge(fb.GROUND, crank, (0, 0, 0), (0, 1, 0), "A", **drive),
                    hinge(crank, rod, (0, 0, r), (0, 1, 0), "B"), hinge(rod, piston, (x, 0, 0), (0, 1, 0), "C"),
                    fb.PrismaticJoint(fb.GROUND, piston, "guide", axis=(1, 0, 0)), gravity=(0, 0, -G))


def gyroscope() -> fb.Scene:
    """A heavy top in two gimbals."""
    ring = body("ring", (0, 0, 0), mass=0.5, inertia=(0.02, 0.02, 0.02), spin=(0.3, 0, 0))
    inner = body("inner", (0, 0, 0), mass=0.5, inertia=(0.02, 0.02, 0.02), spin=(0.3, 0, 0))
    top = body("top", (0, 0, 0.3), mass=2.0, inertia=(0.1, 0.1, 0.05), spin=(0.3, 0, 40.0), velocity=(0, -0.09, 0))
    return fb.Scene(ring, inner, top, hinge(fb.GROUND, ring, (0, 0, 0), (1, 0, 0), "outer"),
                    hinge(ring, inner, (0, 0, 0), (0, 1, 0), "middle"), hinge(inner, top, (0, 0, 0), (0, 0, 1), "spin"),
                    gravity=(0, 0, -G))


def bricard(flying: bool) -> fb.Scene:
    """Six bars along edges of a cube, each hinge at right angles to both bars: it moves although counting says that it cannot."""
    p = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1), (0, 1, 1), (0, 0, 1)], float)
    bars = [body(f"bar {k}", 0.5 * (p[k] + p[(k + 1) % 6]), inertia=0.002 + 0.08 * (1 - np.abs(p[(k + 1) % 6] - p[k])))
            for k in range(6)]
    joints = [hinge(bars[k], bars[(k + 1) % 6], p[(k + 1) % 6],
                    np.cross(p[(k + 1) % 6] - p[k], p[(k + 2) % 6] - p[(k + 1) % 6]), f"hinge {k}") for k in range(6)]
    motion = fb.RigidMotion(bars[3], spin=(1.0, 0.5, 0.2), velocity=(0.2, 0.1, 0))
    return fb.Scene(*bars, *joints, motion, *([] if flying else [fb.Clamp(bars[0])]), project_velocities=True)


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "step", "planar"), [
    (double_pendulum, 1e-3, False), (four_bar, 1e-3, False), (four_bar, 1e-3, True), (slider_crank, 1e-3, False),
    (gyroscope, 4e-4, False), (lambda: bricard(False), 1e-3, False), (lambda: bricard(True), 1e-3, False)],
    ids=["double pendulum", "four-bar in space", "four-bar in plane", "slider-crank", "gyroscope", "Bricard", "Bricard flying"])
def test_ten_thousand_steps_keep_invariants_and_gaps(scene: Any, step: float, planar: bool) -> None:
    model = fb.compile_scene(scene(), planar=planar)
    result = run(model, 1e4 * step, step, every=100, output=fb.Output(snapshots=2))
    assert result.info["fallbacks"] == 0
    assert {name: result.drift(name) for name in result.info["conserved"] if name != "gap" and result.drift(name) > 1e-12} == {}
    assert largest_gap(model, result.state.q) < 1e-14
    # redundant joints take an iteration more, once round-off makes them disagree
    assert result.info["iterations"] < 4.5e4


def test_a_linkage_of_revolute_joints_moves_like_one_of_pairs_of_ball_joints() -> None:
    runs = [run(fb.compile_scene(four_bar(balls), planar=False), 0.5, 0.005) for balls in (False, True)]
    crank, other = (result.state.q.reshape(-1, 4, 3)[:3] for result in runs)
    np.testing.assert_allclose(crank, other, rtol=0.0, atol=1e-12)
    assert runs[0].joint("A")["angle"][-1] > 2.0


def test_a_linkage_in_its_plane_moves_as_in_space() -> None:
    runs = []
    for planar in (False, True):
        model = fb.compile_scene(slider_crank(), planar=planar)
        runs.append(run(model, 1.0, 0.005))
        assert largest_gap(model, runs[-1].state.q) < 1e-14
    np.testing.assert_allclose(runs[0].state.q, runs[1].state.q, rtol=0.0, atol=1e-12)
    force = runs[0].state.force
    np.testing.assert_allclose(force, runs[1].state.force, rtol=0.0, atol=1e-9 * np.max(np.abs(force)))
    for name in ("A", "guide"):
        for key, values in runs[0].joint(name).items():
            np.testing.assert_allclose(values, runs[1].joint(name)[key], rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("angle", [0.3, 0.7, 1.2])
def test_shafts_on_a_universal_joint_turn_by_the_law_of_cardan(angle: float) -> None:
    out = np.array([np.cos(angle), 0, np.sin(angle)])
    shafts = [body("in", (-0.5, 0, 0), spin=(3.0, 0, 0)), body("out", 0.5 * out)]
    cross = fb.UniversalJoint(shafts[0].point((0.5, 0, 0)), shafts[1].point(-0.5 * out), "cross", axis_a=(0, 1, 0),
                              axis_b=np.cross(out, (0, 1, 0)))
    scene = fb.Scene(*shafts, cross, hinge(fb.GROUND, shafts[0], (-0.5, 0, 0), (1, 0, 0), "driving"),
                     hinge(fb.GROUND, shafts[1], 0.5 * out, out, "driven"), project_velocities=True)
    result = run(fb.compile_scene(scene), 3.0, 5e-3, every=5)
    a, b = (result.joint(name)["angle"] for name in ("driving", "driven"))
    assert a[-1] > 3.5
    # the fork of the driving shaft begins at a right angle to the plane of the shafts
    np.testing.assert_allclose(b, np.unwrap(np.arctan2(np.cos(angle) * np.sin(a), np.cos(a))), rtol=0.0, atol=1e-12)
    assert result.drift("total") < 1e-12


# ------------------------------------------------------------------------------------------------- joints in free flight
AXIS = (0.3, 1.0, 0.2)
JOINTS = {"revolute": lambda a, b: fb.RevoluteJoint(a.point((1, 0, 0)), b.point((0, 0, -0.2)), "joint", axis=AXIS),
          "universal": lambda a, b: fb.UniversalJoint(a.point((1, 0, 0)), b.point((0, 0, -0.2)), "joint", axis_a=(0, 0.6, 0.8),
                                                      axis_b=(0, 0.8, -0.6)),
          "cylindrical": lambda a, b: fb.CylindricalJoint(a.point((0.2, 0.1, 0)), b.point((0, 0.1, 0.3)), "joint", axis=AXIS),
          "prismatic": lambda a, b: fb.PrismaticJoint(a.point((0.2, 0.1, 0)), b.point((0, 0.1, 0.3)), "joint", axis=AXIS),
          "planar": lambda a, b: fb.PlanarJoint(a.point((0.2, 0.1, 0)), b.point((0, 0.1, 0.3)), "joint", normal=AXIS)}
def flight(kind: str) -> fb.Scene:
    a, b = body("a", (0.5, 0, 0), spin=(1, 2, 3), mass=2.0), body("b", (1.5, 0, 0.2), spin=(-1, 0, 1), velocity=(0, 0.5, 0.2))
    return fb.Scene(a, b, JOINTS[kind](a, b), project_velocities=True)


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(JOINTS))
def test_two_bodies_in_flight_keep_everything_and_move_as_the_joint_allows(kind: str) -> None:
    model = fb.compile_scene(flight(kind))
    result = run(model, 5.0, 5e-3, every=1, output=fb.Output(snapshots=201))
    assert result.info["fallbacks"] == 0
    assert max(result.drift(name) for name in ("total", "lin_mom", "ang_mom")) < 1e-13
    assert largest_gap(model, result.state.q) < 1e-14
    # what the joint holds, from the shapes alone
    one, other = result.directors[:, 0], result.directors[:, 1]
    arms = [(0, 0.6, 0.8), (0, 0.8, -0.6)] if kind == "universal" else [np.array(AXIS) / np.linalg.norm(AXIS)] * 2
    carried = [np.einsum("i,tic->tc", triad[0] @ arm, triad) for arm, triad in zip(arms, (one, other))]
    link = flight(kind).links[0]
    points = [result.phi[:, k] + np.einsum("i,tic->tc", node.offset, result.directors[:, k])
              for k, node in enumerate((link.a, link.b))]
    way = points[1] - points[0]
    if kind == "universal":
        np.testing.assert_allclose(np.sum(carried[0] * carried[1], axis=1), 0.0, atol=1e-13)
    else:
        np.testing.assert_allclose(carried[0], carried[1], rtol=0.0, atol=1e-13)
    if kind == "prismatic":
        relative = np.einsum("tic,tjc->tij", one, other)
        np.testing.assert_allclose(relative, np.broadcast_to(relative[0], relative.shape), rtol=0.0, atol=1e-13)
    in_a = np.einsum("tic,tc->ti", one, way)
    free = {"cylindrical": 1, "prismatic": 1, "planar": 2}.get(kind, 0)
    assert np.linalg.matrix_rank(in_a - in_a[0], tol=1e-11) == free
    if free == 1:
        along, rows = np.sum(carried[0] * way, axis=1), np.searchsorted(result.t, result.t_snap - 1e-9)
        np.testing.assert_allclose(along - along[0], result.joint("joint")["distance"][rows], rtol=0.0, atol=1e-12)


# ------------------------------------------------------------------------------------------------------- joints of beams
@pytest.mark.slow
def test_beams_and_a_body_on_all_kinds_of_joints_in_space_and_in_their_plane() -> None:
    section = fb.Section.circle(radius=0.01, E=1e9, rho=1000.0)
    ends = []
    for planar in (False, True):
        a, b, c = (fb.Beam.straight(name, (x, 0, 0), (x + length, 0, 0), section=section, elements=3)
                   for name, x, length in (("a", 0.0, 1.0), ("b", 1.0, 1.0), ("c", 2.0, 0.7)))
        load = body("load", (2.5, 0, 0.4))
        scene = fb.Scene(a, b, c, load, fb.RevoluteJoint(a.end, b.start, "hinge", axis=(0, 1, 0)),
                         fb.PrismaticJoint(b.end, c.start, "guide", axis=(1, 0, 0)),
                         fb.CylindricalJoint(c.node(3), load.point((0.1, 0, 0.1)), "bush", axis=(0, 1, 0)),
                         fb.RigidMotion(spin=(0, 2.0, 0)), fb.RigidMotion(load, velocity=(0.3, 0, 0.2)), project_velocities=True)
        model = fb.compile_scene(scene, planar=planar)
        result = run(model, 0.3, 2e-3)
        assert max(result.drift(name) for name in ("total", "lin_mom", "ang_mom")) < 1e-12
        assert largest_gap(model, result.state.q) < 1e-14 and result.info["iterations"] < 5 * result.info["steps"]
        ends.append(result.state.q)
    np.testing.assert_allclose(ends[0], ends[1], rtol=0.0, atol=1e-11)
