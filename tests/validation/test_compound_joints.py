"""Springs, dampers, motors, given motions, friction, stops in joints with several coordinates: exact answers, integrators."""
from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import fastbeam as fb

Array = np.ndarray
SPACE_AND_PLANE = pytest.mark.parametrize("planar", [False, "auto"], ids=["space", "plane"])
AXIS = np.array((0.3, 1.0, 0.2)) / np.linalg.norm((0.3, 1.0, 0.2))
SIDE = np.cross(AXIS, (1, 0, 0)) / np.linalg.norm(np.cross(AXIS, (1, 0, 0)))
INERTIA = (0.02, 0.03, 0.04)


def body(name: str, position: Any, **options: Any) -> fb.RigidBody:
    return fb.RigidBody(name, **{"mass": 1.0, "inertia": INERTIA, "position": position, **options})


def run(model: fb.Model, t_end: float, step: float, **options: Any) -> fb.Result:
    return fb.simulate(model, t_end=t_end, step=step, progress=False, **options)


def joined(joint: Any, planar: Any = False, gravity: Any = (0, 0, 0), **motion: Any) -> fb.Model:
    """A body at the origin on a joint with the ground."""
    part = body("part", (0, 0, 0), **motion)
    return fb.compile_scene(fb.Scene(part, joint(part), gravity=gravity), planar=planar)


# ------------------------------------------------------------------------------------------------ two bodies in free flight
SPRINGS = {"stiffness": (3.0, 20.0), "damping": (0.05, 0.3), "rest": (0.2, -0.1)}
KINDS: dict[str, tuple[Any, dict[str, Any], int]] = {
    "cylindrical": (fb.CylindricalJoint, {"axis": AXIS}, 2),
    "universal": (fb.UniversalJoint, {"axis_a": AXIS, "axis_b": SIDE}, 2),
    "planar": (fb.PlanarJoint, {"normal": AXIS, "along": SIDE}, 3), "spherical": (fb.SphericalJoint, {"axis": AXIS}, 2)}
ACTIONS: dict[str, Any] = {
    "springs and dampers": lambda n: {"stiffness": (3.0, 2.0, 1.0)[:n], "rest": (0.2, -0.1, 0.3)[:n],
                                      "damping": (0.05, 0.3, 0.1)[:n]},
    "stops": lambda n: {"stops": tuple(fb.Stops(-0.05, 0.04, stiffness=300.0) for _ in range(n))},
    "rigid stops and friction": lambda n: {"stops": tuple(fb.Stops(-0.05, 0.04, restitution=0.5) for _ in range(n)),
                                           "friction": (0.02, 0.05, 0.03)[:n]},
    "drives": lambda n: {"drive": (fb.Drive(position=lambda t: 0.3 * np.sin(t), stiffness=4.0, damping=0.1),) * n},
    "speeds": lambda n: {"speed": tuple([lambda t: 0.4 * np.cos(3.0 * t)] * n)}}


def action(kind: str, what: str) -> dict[str, Any]:
    found = ACTIONS[what](KINDS[kind][2])
    if kind != "spherical":
        return found
    found.pop("rest", None)
    second = {"friction", "drive", "speed"}
    if "stops" in found:
        found["cone"] = fb.Stops(end=0.06, **({"stiffness": 300.0} if what == "stops" else {"restitution": 0.5}))
        second.add("stops")
    return {name: x[1] if name in second else x for name, x in found.items()}


def flight(kind: str, **options: Any) -> fb.Model:
    a, b = body("a", (0.5, 0, 0), spin=(1, 2, 3), mass=2.0), body("b", (1.5, 0, 0.2), spin=(-1, 0, 1), velocity=(0, 0.5, 0.2))
    noun, axes, _ = KINDS[kind]
    joint = noun(a.point((1, 0, 0)), b.point((0, 0, -0.2)), "joint", **axes, **options)
    return fb.compile_scene(fb.Scene(a, b, joint, project_velocities=True))


@pytest.mark.parametrize("kind", list(KINDS))
@pytest.mark.parametrize("what", list(ACTIONS))
def test_two_bodies_in_flight_keep_momenta_and_close_their_books(kind: str, what: str) -> None:
    model = flight(kind, **action(kind, what))
    result = run(model, 1.0, 5e-3, every=1)
    conserved = ("total" if what == "stops" else "balance", "lin_mom", "ang_mom")
    assert max(result.drift(name) for name in conserved) < 1e-12, {name: result.drift(name) for name in conserved}
    assert result.info["fallbacks"] == 0 and result.info["iterations"] < 9 * result.info["steps"]
    joint = result.joint("joint")
    acted = {"springs and dampers": ("energy", "loss"), "stops": ("energy",),
             "rigid stops and friction": ("stop_loss", "friction_loss")}.get(what, ("work",))
    assert all(np.max(np.abs(joint[name])) > 1e-4 for name in acted)
    for name in {"loss", "friction_loss", "stop_loss"} & set(joint):
        assert np.all(np.diff(joint[name]) >= -1e-15)
    # rates are those of the values
    for value, rate in (("angle", "spin"), ("distance", "speed"), ("swing", "swing_rate"), ("twist", "spin")):
        if value in joint and what == "springs and dampers":
            middle = 0.5 * (joint[rate][1:] + joint[rate][:-1])
            # a swing has no rate where it is 0
            np.testing.assert_allclose((np.diff(joint[value], axis=0) / 5e-3)[1:], middle[1:], rtol=0.0, atol=5e-3)


@pytest.mark.parametrize("kind", list(KINDS))
def test_springs_are_of_fourth_order_and_goes_on_from_a_checkpoint_bit_for_bit(kind: str, tmp_path: Any) -> None:
    model = flight(kind, **action(kind, "springs and dampers"))
    # the last state, whose points of bodies are extrapolated by themselves: mending it turned a body by 0.4 rad
    ends = [run(model, 0.64, 0.64 / n, order=4).state.q for n in (16, 32, 64)]
    one, two = (float(np.max(np.abs(x - y))) for x, y in zip(ends, ends[1:]))
    assert np.log2(one / two) > 3.5
    # stops that are never reached: behind an impact steps begin there
    wide = fb.Stops(-3.0, 3.0, restitution=0.5)
    out_of_reach = {"stops": wide, "cone": fb.Stops(end=3.0, restitution=0.5)} if kind == "spherical" else {
        "stops": (wide,) * KINDS[kind][2]}
    model = flight(kind, **action(kind, "rigid stops and friction") | out_of_reach)
    whole, half = run(model, 0.5, 0.01), run(model, 0.25, 0.01)
    on = run(model, 0.5, 0.01, start=half.checkpoint)
    np.testing.assert_array_equal(whole.state.q, on.state.q)


# ------------------------------------------------------------------------------------------------ independent integrators
def rotations(scene: str, t: Array, rates: Array, moment: Any) -> Array:
    """Rotations of a body about a fixed point with moments (rotation, spin) in the body, by quaternions and rtol 1e-11."""
    inertia = np.array(INERTIA)

    def f(time: float, y: Array) -> Array:
        turn, w = Rotation.from_quat(y[:4]), y[4:]
        x, s = y[:3], y[3]
        dot = 0.5 * np.concatenate((s * w + np.cross(x, w), [-x @ w]))
        return np.concatenate((dot, (moment(turn, w) - np.cross(w, inertia * w)) / inertia))

    found = solve_ivp(f, (0.0, t[-1]), np.concatenate(([0, 0, 0, 1.0], rates)), t_eval=t, rtol=1e-11, atol=1e-13)
    assert found.success, scene
    return found.y.T


def swing_twist(turn: Rotation) -> Array:
    """By its definition with quaternions, not as sums of products."""
    quat = turn.as_quat()
    along = quat[:3] @ AXIS
    return np.array([2.0 * np.arctan2(np.linalg.norm(quat[:3] - along * AXIS), np.hypot(along, quat[3])),
                     2.0 * np.arctan2(along, quat[3])])


def cardan(turn: Rotation) -> Array:
    """R = R(AXIS, x_1) R(SIDE, x_2)."""
    frame = np.stack((AXIS, SIDE, np.cross(AXIS, SIDE)))
    return (Rotation.from_matrix(frame @ turn.as_matrix() @ frame.T)).as_euler("XYZ")[:2]


def slopes(values: Any, turn: Rotation) -> Array:
    """Derivatives of the values by spins in the body, [2, 3]."""
    e = 1e-6
    return np.array([(values(turn * Rotation.from_rotvec(e * x)) - values(turn * Rotation.from_rotvec(-e * x))) / (2 * e)
                     for x in np.eye(3)]).T


def test_a_ball_in_a_socket_on_springs_of_swing_and_twist_against_an_integrator_with_quaternions() -> None:
    spin, k, c = np.array((1.5, 2.0, -1.0)), (0.3, 0.2), 0.01

    def moment(turn: Rotation, w: Array) -> Array:
        lead, (swing, twist) = slopes(swing_twist, turn), swing_twist(turn)
        return -lead[1] * (k[1] * twist + c * lead[1] @ w) - (k[0] * swing * lead[0] if swing > 1e-7 else 0.0)

    errors = []
    for step in (0.01, 0.005):
        result = run(joined(lambda x: fb.SphericalJoint(fb.GROUND, x, "ball", axis=AXIS, stiffness=k, damping=(0.0, c)),
                            spin=spin), 1.0, step, every=1)
        exact = np.array([swing_twist(Rotation.from_quat(y[:4])) for y in rotations("ball", result.t, spin, moment)])
        joint = result.joint("ball")
        errors.append(np.max(np.abs(np.stack((joint["swing"], joint["twist"]), axis=1) - exact)))
        assert result.drift("balance") < 1e-13 and np.max(joint["swing"]) > 0.3
    assert errors[1] < 2e-4 and np.log2(errors[0] / errors[1]) > 1.9


def test_what_damps_the_swing_resists_the_turning_of_the_axis_alone() -> None:
    spin, c = np.array((1.5, 2.0, -1.0)), 0.03

    def moment(turn: Rotation, w: Array) -> Array:
        axis = turn.inv().apply(turn.apply(AXIS))
        return -c * (w - (w @ axis) * axis)

    errors = []
    for step in (0.01, 0.005):
        model = joined(lambda x: fb.SphericalJoint(fb.GROUND, x, "ball", axis=AXIS, damping=(c, 0.0)), spin=spin)
        result = run(model, 1.0, step)
        exact = swing_twist(Rotation.from_quat(rotations("ball", result.t, spin, moment)[-1, :4]))
        joint = result.joint("ball")
        errors.append(np.max(np.abs([joint["swing"][-1] - exact[0], np.sin(joint["twist"][-1] - exact[1])])))
        assert result.drift("balance") < 1e-13
        assert set(joint) == {"swing", "swing_rate", "twist", "spin", "energy", "loss", "work"}
    assert errors[1] < 2e-4 and np.log2(errors[0] / errors[1]) > 1.9


def test_a_cross_with_springs_and_dampers_against_an_integrator() -> None:
    k, c, rest = np.array((0.3, 0.2)), np.array((0.01, 0.02)), np.array((0.2, -0.3))
    # about the arms of the cross
    spin = 1.2 * AXIS + 0.8 * SIDE

    def f(t: float, y: Array) -> Array:
        x, rate = y[:2], y[2:]
        return np.concatenate((rate, np.linalg.solve(mass(x), -k * (x - rest) - c * rate - bias(x, rate))))

    # spin in the body: x_1' R(SIDE, -x_2) AXIS + x_2' SIDE
    def mass(x: Array) -> Array:
        arms = np.stack((Rotation.from_rotvec(-x[1] * SIDE).apply(AXIS), SIDE))
        return (arms * INERTIA) @ arms.T

    def bias(x: Array, rate: Array) -> Array:
        e = 1e-6
        by = [(mass(x + e * d) - mass(x - e * d)) / (2 * e) for d in np.eye(2)]
        return sum(by[i] * rate[i] for i in range(2)) @ rate - 0.5 * np.array([rate @ by[i] @ rate for i in range(2)])

    exact = solve_ivp(f, (0.0, 1.5), (0, 0, 1.2, 0.8), rtol=1e-11, atol=1e-13).y[:2, -1]
    ends = []
    for step in (0.01, 0.005):
        result = run(joined(lambda x: fb.UniversalJoint(fb.GROUND, x, "cross", axis_a=AXIS, axis_b=SIDE, stiffness=tuple(k),
                                                        damping=tuple(c), rest=tuple(rest)), spin=spin), 1.5, step)
        ends.append(result.joint("cross")["angle"][-1])
        assert result.drift("balance") < 1e-13
        turn = Rotation.from_matrix(result.state.q.reshape(-1, 4, 3)[0, 1:].T)
        np.testing.assert_allclose(ends[-1], cardan(turn), rtol=0.0, atol=1e-13)
    errors = [np.max(np.abs(x - exact)) for x in ends]
    assert errors[1] < 1e-4 and np.log2(errors[0] / errors[1]) > 1.9


# ------------------------------------------------------------------------------------------------ exact answers
@SPACE_AND_PLANE
def test_a_plate_on_a_table_swings_along_both_directions_and_turns_by_itself(planar: Any) -> None:
    k, m, t = np.array((30.0, 12.0, 0.5)), np.array((1.0, 1.0, INERTIA[2])), 1.0
    rest = np.array((0.1, -0.2, 0.7))

    def table(part: Any) -> Any:
        return fb.PlanarJoint(fb.GROUND, part, "table", normal=(0, 0, 1), along=(0, 1, 0), stiffness=tuple(k), rest=tuple(rest))

    ends = []
    for step in (0.01, 0.005):
        joint = run(joined(table, planar), t, step).joint("table")
        ends.append(np.array([*joint["distance"][-1], joint["angle"][-1]]))
    exact = rest * (1.0 - np.cos(np.sqrt(k / m) * t))
    np.testing.assert_allclose((4.0 * ends[1] - ends[0]) / 3.0, exact, rtol=0.0, atol=2e-5)
    # along y, then along z x y = -x
    result = run(joined(table, planar), 0.05, 0.01)
    place = result.state.q.reshape(-1, 4, 3)[0, 0]
    np.testing.assert_allclose(result.joint("table")["distance"][-1], (place[1], -place[0]), rtol=0.0, atol=1e-15)


@SPACE_AND_PLANE
def test_motors_friction_and_given_motions_of_a_plate_are_those_of_the_equations_of_motion(planar: Any) -> None:
    speed, f, torque = 1.2, 0.5, 0.02

    def table(part: Any) -> Any:
        return fb.PlanarJoint(fb.GROUND, part, "table", normal=(0, 0, 1), along=(1, 0, 0), friction=(f, 0.0, 0.0),
                              distance=(None, lambda t: 0.3 * t**2), torque=torque)

    off = []
    for step in (0.02, 0.01):
        result = run(joined(table, planar, velocity=(speed, 0, 0)), 3.0, step, every=1)
        off.append(np.max(np.abs(result.joint("table")["angle"] - 0.5 * torque / INERTIA[2] * result.t**2)))
    assert off[1] < 3e-5 and np.log2(off[0] / off[1]) > 1.9
    joint, t = result.joint("table"), result.t
    stopped = speed / f
    np.testing.assert_allclose(joint["distance"][-1], (0.5 * speed * stopped, 2.7), rtol=0.0, atol=1e-4)
    np.testing.assert_allclose(joint["distance"][:, 1], 0.3 * t**2, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(joint["friction_loss"][-1], 0.5 * speed**2, rtol=1e-12)
    np.testing.assert_allclose(joint["force"][5:-1, 1], 0.6, rtol=0.0, atol=1e-8)
    assert result.drift("balance") < 1e-13 and np.ptp(joint["distance"][t > stopped + 0.05, 0]) == 0.0


@SPACE_AND_PLANE
def test_a_sleeve_on_a_rod_turns_as_given_and_bounces_between_its_stops(planar: Any) -> None:
    """Along y, or in the plane about z; the way is 0.5 m there and 0.8 of the speed back."""
    model = joined(lambda x: fb.CylindricalJoint(fb.GROUND, x, "rod", axis=(0, 0, 1), angle=lambda t: 2.0 * t**2,
                                                 stops=(None, fb.Stops(None, 0.5, restitution=0.8))),
                   planar, **({"velocity": (0, 0, 1.0)} if planar is False else {}))
    result = run(model, 1.0, 0.01, every=1)
    joint = result.joint("rod")
    np.testing.assert_allclose(joint["angle"], 2.0 * result.t**2, rtol=0.0, atol=1e-12)
    if planar is False:
        np.testing.assert_allclose(joint["distance"][-1], 0.5 - 0.8 * 0.5, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(joint["stop_loss"][-1], 0.5 * (1.0 - 0.64), rtol=1e-9)
    assert result.drift("balance") < 1e-12


@pytest.mark.parametrize("elastic", [True, False])
def test_a_cone_turns_a_swing_back(elastic: bool) -> None:
    """About x, away from the axis z: free to the cone, half a period of its spring there, or a bounce."""
    w, limit, k, e = 1.6, 0.4, 80.0, 0.6
    cone = fb.Stops(end=limit, **({"stiffness": k} if elastic else {"restitution": e}))
    result = run(joined(lambda x: fb.SphericalJoint(fb.GROUND, x, "ball", axis=(0, 0, 1), cone=cone), spin=(w, 0, 0)), 0.6, 1e-3,
                 every=1)
    joint = result.joint("ball")
    own = np.sqrt(k / INERTIA[0])
    if elastic:
        assert abs(np.max(joint["swing"]) - limit - w / own) < 2e-5 and result.drift("total") < 1e-13
        # back at 0 after 2 limit/w and half a period, then to the other side
        np.testing.assert_allclose(joint["swing"][-1], w * abs(0.6 - 2.0 * limit / w - np.pi / own), rtol=0.0, atol=1e-4)
    else:
        hit = limit / w
        # a step at a constant spin turns by 2 atan(w h/2)
        np.testing.assert_allclose(joint["swing"][-1], limit - e * w * (0.6 - hit), rtol=0.0, atol=w * 0.6 * (w * 1e-3)**2 / 12)
        np.testing.assert_allclose(joint["stop_loss"][-1], 0.5 * INERTIA[0] * w**2 * (1.0 - e**2), rtol=1e-9)
        assert result.drift("balance") < 1e-12


def test_a_pendulum_rests_on_its_cone_and_carries_its_weight_there() -> None:
    part = body("part", (0.5, 0, 0))
    model = fb.compile_scene(fb.Scene(part, fb.SphericalJoint(fb.GROUND, part.point((-0.5, 0, 0)), "ball", axis=(1, 0, 0.0),
                                                              cone=fb.Stops(end=0.3)), gravity=(0, 0, -9.81)), planar=False)
    result = run(model, 1.0, 0.005)
    joint = result.joint("ball")
    np.testing.assert_allclose(joint["swing"][-1], 0.3, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(joint["cone_torque"][-1], -9.81 * 0.5 * np.cos(0.3), rtol=0.0, atol=1e-8)
    assert result.drift("balance") < 1e-12


@pytest.mark.parametrize("about", [0, 1])
def test_a_cross_in_its_plane_moves_as_in_space(about: int) -> None:
    axes = {"axis_a": (0, 0, 1), "axis_b": (1, 0, 0)} if about == 0 else {"axis_a": (1, 0, 0), "axis_b": (0, 0, 1)}
    one = {"stiffness": (0.4, 0.0), "friction": (0.01, 0.0), "torque": (lambda t: 0.05 * np.sin(5.0 * t), None)}
    options = one if about == 0 else {name: x[::-1] for name, x in one.items()}
    ends = []
    for planar in (False, True):
        part = body("part", (0.4, 0.1, 0), spin=(0, 0, 2.0), velocity=(-0.2, 0.8, 0))
        cross = fb.UniversalJoint(fb.GROUND, part.point((-0.4, -0.1, 0)), "cross", **axes, **options)
        result = run(fb.compile_scene(fb.Scene(part, cross, gravity=(0, -3.0, 0)), planar=planar), 1.0, 0.01, every=1)
        assert result.drift("balance") < 1e-13 and np.max(np.abs(result.joint("cross")["angle"])) > 0.2
        ends.append(result.joint("cross")["angle"])
    np.testing.assert_allclose(ends[0], ends[1], rtol=0.0, atol=1e-12)
    assert np.all(ends[0][:, 1 - about] == ends[0][0, 1 - about])


# ----------------------------------------------------------------------------------------- how-to/joints.md, refusals
def test_the_recipe_runs() -> None:
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "joints.md").read_text(encoding="utf-8")
    recipe = page.split("A shaft that a motor turns through a cross with dampers")[1].split("\n\n")[1]
    found: dict[str, Any] = {"fb": fb}
    exec(textwrap.dedent(recipe), found)
    shaken = found["shaken"]
    assert shaken.drift("balance") < 1e-12 and np.max(shaken.joint("cross")["angle"][:, 0]) > 0.7
    np.testing.assert_allclose(np.max(shaken.joint("shoulder")["swing"]), 1.2, rtol=0.0, atol=1e-9)
    assert shaken.joint("shoulder")["stop_loss"][-1] > 0.0


BODY = body("block", (0, 0, 0))


@pytest.mark.parametrize(("call", "text"), [
    (lambda: fb.CylindricalJoint(fb.GROUND, BODY, "c", axis=(0, 0, 1), stiffness=3.0), "must be two numbers >= 0, one for the"),
    (lambda: fb.UniversalJoint(fb.GROUND, BODY, "c", axis_a=(1, 0, 0), axis_b=(0, 1, 0), angle=1.0), "angle must be two of them"),
    (lambda: fb.PlanarJoint(fb.GROUND, BODY, "c", normal=(0, 0, 1), along=(1, 0, 1)), "must lie in the plane"),
    (lambda: fb.CylindricalJoint(fb.GROUND, BODY, "c", axis=(0, 0, 1), angle=1.0, friction=(1.0, 0.0)),
     "angle of cylindrical joint 'c': angle= prescribes its motion whatever the force, so friction="),
    (lambda: fb.UniversalJoint(fb.GROUND, BODY, "c", axis_a=(1, 0, 0), axis_b=(0, 1, 0), stops=(None, fb.Stops(0.1, 0.2))),
     "second angle of universal joint 'c': stops from 0.1 to 0.2 rad must enclose its .* at the start"),
    (lambda: fb.SphericalJoint(fb.GROUND, BODY, "c", axis=(0, 0, 1), cone=fb.Stops(-0.1, 0.2)), "write fb.Stops.end="),
    (lambda: fb.SphericalJoint(fb.GROUND, fb.PointMass("m", mass=1.0, position=(0, 0, 0)), axis=(0, 0, 1)), "has no rotation")])
def test_what_makes_no_sense_is_refused(call: Any, text: str) -> None:
    with pytest.raises(fb.SceneError, match=text):
        call()


# -------------------------------------------------------------------------------------- a joint that holds nothing in its plane
def halves(planar: bool | str, joined: bool = True, ground: bool = False, **joint: Any) -> fb.Model:
    """Two cantilevers whose ends meet, one of them loaded, or one of them and the ground, on a joint about the normal."""
    section = fb.Section(EA=1e4, GA2=4e3, GA3=4e3, GJ=2.0, EI2=1.0, EI3=4.0, rhoA=0.1, rhoI2=1e-5, rhoI3=1e-5)
    a, b = (fb.Beam.straight(name, (x, 0, 0), (x + 1, 0, 0), section=section, elements=2) for name, x in (("a", 0), ("b", 1)))
    rest = () if ground else (b, fb.Clamp(b.end))
    held = (fb.PlanarJoint(a.end, fb.GROUND if ground else b.start, "joint", normal=(0, 1, 0), along=(1, 0, 0), **joint),)
    load = fb.Load("end", a.end, force=(0, 0, -0.1))
    return fb.compile_scene(fb.Scene(a, *rest, fb.Clamp(a.start, "root"), *(held if joined else ()), load), planar=planar)


@pytest.mark.parametrize("rho_inf", [None, 0.8])
@pytest.mark.parametrize("ground", [False, True], ids=["two beams", "beam and ground"])
def test_a_planar_joint_in_its_plane_only_reads(ground: bool, rho_inf: float | None) -> None:
    with_joint, without = (run(halves("auto", joined=joined, ground=ground), 0.02, 1e-3, method=fb.Method(rho_inf=rho_inf))
                           for joined in (True, False))
    # the ground is one more node, the last
    q = with_joint.state.q[:without.state.q.size].reshape(-1, 4, 3)
    assert np.abs(q.reshape(-1) - without.state.q).max() < 1e-14 and with_joint.info["fallbacks"] == 0
    end = 6
    gap = (np.array((1.0, 0, 0)) if ground else q[7, 0]) - q[end, 0]
    # in directions that the first part carries, x and the normal times x
    turn = q[end, 1:].T @ halves("auto", ground=ground).q0.reshape(-1, 4, 3)[end, 1:]
    expected = gap @ turn[:, 0], gap @ np.cross((0, 1, 0), turn[:, 0])
    np.testing.assert_allclose(with_joint.joint("joint")["distance"][-1], expected, atol=1e-15)


@pytest.mark.parametrize("ground", [False, True], ids=["two beams", "beam and ground"])
def test_reactions_beside_a_planar_joint_in_its_plane_are_those_without_it(ground: bool) -> None:
    # reactions take the equations without eliminated nodes, in which the plane leaves no constraint
    found = [run(halves("auto", joined=joined, ground=ground), 0.005, 1e-3, observe=("reaction",)).reaction("root")["force"][1:]
             for joined in (True, False)]
    assert np.abs(found[1]).max() > 1e-3
    np.testing.assert_allclose(found[0], found[1], rtol=0.0, atol=1e-10 * np.abs(found[1]).max())


@pytest.mark.parametrize("ground", [False, True], ids=["two beams", "beam and ground"])
def test_springs_of_a_planar_joint_in_its_plane_are_those_in_space(ground: bool) -> None:
    found = [run(halves(planar, ground=ground, stiffness=(50.0, 50.0, 1.0)), 0.02, 1e-3) for planar in ("auto", False)]
    for name in ("distance", "angle"):
        a, b = (x.joint("joint")[name] for x in found)
        assert np.abs(b).max() > 1e-6
        np.testing.assert_allclose(a, b, atol=1e-13)
    assert max(x.drift("total") for x in found) < 1e-13
