"""Beams that turn in unkeyed sleeves with friction, against exact answers; balances, momenta, restart."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.model.contact.sleeve_conditions import sections

sys.path.insert(0, str(Path(__file__).parent))
from exchange import balanced  # noqa: E402
from test_sleeves import scene as flying  # noqa: E402
from test_slider_forces import run  # noqa: E402

MU, RADIUS, WEIGHT, INERTIA = 0.3, 0.02, 50.0, 2e-3
# largest moment of friction, N m
MOST = MU * RADIUS * WEIGHT
STIFF = fb.Section(EA=1e8, GA2=1e8, GA3=1e8, GJ=1e5, EI2=1e5, EI3=1e5, rhoA=1e-3, rhoI2=1e-9, rhoI3=1e-9)
SOFT = fb.Section(EA=1e5, GA2=1e5, GA3=1e5, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1e-3, rhoI2=1e-9, rhoI3=1e-9)


def shaft(spin: float = 0.0, torque: float = 0.0, clamped: bool = False, weight: float = WEIGHT, planar: Any = False,
          time: Any = None, soft_elements: int = 1, **changes: Any) -> fb.Model:
    """A disc on a rod of 1 m, in a sleeve at the disc that is fixed in space and carries a weight; clamped: at the end of a soft
    rod of 1 m, with 1 N m/rad; time: of the torque."""
    rod = fb.Beam.straight("rod", (-0.5, 0, 0), (0.5, 0, 0), section=STIFF, elements=2)
    soft = fb.Beam.straight("soft", (-1.5, 0, 0), (-0.5, 0, 0), section=SOFT, elements=soft_elements)
    beams = (rod, soft, fb.RigidConnection(soft.end, rod.start), fb.Clamp(soft.start)) if clamped else (rod,)
    disc = fb.RigidBody("disc", mass=1.0, inertia=(INERTIA, 1e-3, 1e-3), position=(0, 0, 0), spin=(spin, 0, 0))
    holder = fb.RigidBody("holder", mass=1.0, inertia=(1, 1, 1), position=(0, 0, 0))
    sleeve = fb.Sleeve("s", holder, rod, at=0.5, **{"keyed": False, "length": 0.2, "friction": MU, "radius": RADIUS, **changes})
    return fb.compile_scene(fb.Scene(
        *beams, disc, holder, fb.RigidConnection(disc, rod.node(rod.n_nodes // 2)), fb.Clamp(holder), sleeve,
        fb.Load("weight", disc.center, force=(0, 0, -weight)), fb.Load("torque", disc.center, moment=(torque, 0, 0), time=time),
        fb.RigidMotion((rod,), spin=(spin, 0, 0)),
        project_velocities=True), planar=planar)


def from_rest(spin: float = 0.0, **given: Any) -> tuple[fb.Model, Any]:
    """A shaft, and the state in which the weight has bent what it bends, so that nothing rings; with its spin."""
    model, hung = shaft(spin, **given), shaft(keyed=True, radius=None, **{**given, "torque": 0.0})
    state = fb.solve_static(hung).state_for(model)
    return model, state._replace(v=model.v0.copy())


def go(t_end: float, step: float, spin: float = 0.0, **given: Any) -> fb.Result:
    more = {name: given.pop(name) for name in ("observe", "checkpoint") if name in given}
    model, start = from_rest(spin, **given)
    return run(model, t_end, step, start=start, **more)


def test_a_shaft_slows_down_and_rests_where_friction_has_taken_its_energy() -> None:
    spin, slow = 60.0, MOST / INERTIA
    stop = spin / slow
    for step in (4e-3, 1e-3):
        result = go(0.5, step, spin)
        s = result.slider("s")
        moves = result.t < stop - step
        exact = spin * result.t - 0.5 * slow * result.t**2
        # a spin w lags by w^3 h^2/12 in these steps, with friction or without
        lag = spin**4 * step**2 / (48.0 * slow)
        assert np.max(np.abs(s["twist"] - exact)[moves]) < 1.01 * lag + slow * step**2
        assert s["twist"][-1] > 2.0 * np.pi and abs(s["twist"][-1] - 0.5 * spin**2 / slow) < 1.01 * lag + slow * step**2
        assert np.ptp(s["twist"][result.t > stop + 4.0 * step]) == 0.0 and np.ptp(s["s"]) == 0.0
        np.testing.assert_allclose(s["friction_loss"][-1], result.series["kinetic"][0], rtol=1e-6)
        # it takes what it must from the angle that it turns
        np.testing.assert_allclose(s["friction_loss"][moves], MOST * s["twist"][moves], rtol=2e-6)
        assert balanced(result)


@pytest.mark.slow
def test_the_law_of_friction_has_order_two() -> None:
    # torque and friction, so that it never stops: (T - M)/J
    def end(step: float) -> float:
        return float(go(0.2, step, 3.0, torque=0.7).slider("s")["twist"][-1])

    exact = 3.0 * 0.2 + 0.5 * (0.7 - MOST) / INERTIA * 0.2**2
    errors = np.array([end(step) for step in (8e-3, 4e-3, 2e-3)]) - exact
    print("errors of the angle of a shaft", errors)
    assert np.all(np.abs(np.log2(np.abs(errors[:-1] / errors[1:])) - 2.0) < 0.1), errors


def test_it_sticks_up_to_its_limit_and_not_beyond() -> None:
    held = go(1.0, 1e-3, torque=0.999 * MOST)
    s = held.slider("s")
    assert np.max(np.abs(s["twist"])) < 1e-6 and np.ptp(s["twist"][100:]) == 0.0
    # in the mean of two steps: the torque comes at once, and rings in the stiff rod
    np.testing.assert_allclose(s["twist_moment"][100:-1], -0.999 * MOST, rtol=1e-3)
    # on the holder with the opposite sign
    np.testing.assert_array_equal(s["moment"][100:, 0], -s["twist_moment"][100:])
    slips = go(0.1, 1e-3, torque=-1.5 * MOST).slider("s")
    np.testing.assert_allclose(slips["twist"][-1], -0.5 * 0.5 * MOST / INERTIA * 0.01, rtol=1e-3)


def test_a_torsion_pendulum_loses_two_limits_over_its_stiffness_in_every_swing() -> None:
    stiffness, spin, most = 1.0, 40.0, MOST
    result = go(1.0, 1e-3, spin, clamped=True)
    s = result.slider("s")
    # 1/2 J w^2 = 1/2 k A^2 + M A, then A - 2 M/k from swing to swing, until k A < M
    swings = [(np.sqrt(most**2 + stiffness * INERTIA * spin**2) - most) / stiffness]
    while stiffness * swings[-1] > most:
        swings.append(swings[-1] - 2.0 * most / stiffness)
    x = s["twist"]
    print(f"swings {swings}, largest {x.max():.6f}, smallest {x.min():.6f}, rest {x[-1]:.6f} rad")
    rest = swings[-1] * (-1.0)**(len(swings) - 1)
    assert len(swings) == 4 and abs(x.max() - swings[0]) < 1e-3 and abs(x[-1] - rest) < 2e-3 and np.ptp(x[-100:]) == 0.0
    assert balanced(result, 1e-11)


def test_a_run_goes_on_bit_for_bit_and_rows_tell_the_coordinates(tmp_path: Any) -> None:
    model, start = from_rest(60.0)
    whole = run(model, 0.1, 2e-3, start=start)
    half = run(model, 0.05, 2e-3, start=start, output=fb.Output(checkpoint=tmp_path / "c"))
    rest = run(model, 0.1, 2e-3, start=fb.load_checkpoint(tmp_path / "c"))
    for x, y in zip(rest.state, whole.state):
        assert np.array_equal(x, y)
    # from the bare state, without what it remembers, it goes on in the same way
    bare = half.state._replace(history=model.state().history)
    again = run(model, 0.1, 2e-3, start=fb.Start(bare, time=0.05)).slider("s")["twist"][-1]
    assert abs(np.exp(1j * again) - np.exp(1j * whole.slider("s")["twist"][-1])) < 1e-3
    section = sections(model, whole.state.s, whole.state.q.reshape(-1, 4, 3))[0]
    d = np.einsum("a,ajc->jc", section.shapes[0], section.d)
    angle = -np.arctan2(section.axes[1] @ d[2], section.axes[1] @ d[1])
    assert abs(np.exp(1j * angle) - np.exp(1j * whole.slider("s")["twist"][-1])) < 1e-12


@pytest.mark.slow
def test_supports_take_the_moment_of_friction() -> None:
    result = go(0.01, 1e-3, 2.0, observe=("energy", "slider", "reaction"))
    (name,) = [x for x in result.names["reactions"] if "holder" in x]
    # in a step that turns by x it is smaller by x^2/8, as all moments of that step are
    np.testing.assert_allclose(result.reaction(name)["moment"][1:, 0], result.slider("s")["twist_moment"][1:], rtol=2e-6)


@pytest.mark.parametrize("torque", [0.2, 0.299, 0.31, -0.8, 2.0])
def test_in_equilibria_friction_takes_its_limit_from_the_torque(torque: float) -> None:
    # a bar of 1 N m/rad behind the sleeve
    result = fb.solve_static(shaft(torque=torque, clamped=True, soft_elements=30))
    s, twist = result.slider("s"), result.info["friction"]["s: twist"]
    exact = np.sign(torque) * max(abs(torque) - MOST, 0.0)
    # half of the rod adds to it; a section that slips comes to rest with 1e-5 of its friction in reserve
    assert abs(s["twist"][-1] - exact * (1.0 + 0.5 / STIFF.GJ)) < 1.2e-5 * MOST
    np.testing.assert_allclose(s["twist_moment"][-1], exact - torque, rtol=0.0, atol=1.2e-5 * MOST)
    assert twist["sticks"] == (abs(torque) < MOST) and twist["cone"] == pytest.approx(MOST, rel=1e-6)
    assert twist["force"] == pytest.approx(-s["twist_moment"][-1]) and result.info["unstable_directions"] == 0


def test_a_slow_history_of_torques_leaves_what_friction_holds() -> None:
    state, held = None, 0.0
    for torque in (0.2, 0.5, 0.8, 0.5, 0.3, 1e-3, -0.5, 1e-3, 0.8):
        model = shaft(torque=torque, clamped=True)
        result = fb.solve_static(model, **({} if state is None else dict(start=state, raise_loads=False)))
        state = result.state
        # the angle follows the torque within a band of the limit: play
        held = min(max(held, torque - MOST), torque + MOST)
        assert abs(result.slider("s")["twist"][-1] - held) < 2e-5, torque
    rests = run(model, 0.02, 1e-3, start=state)
    assert np.ptp(rests.slider("s")["twist"]) == 0.0 and np.max(rests.series["kinetic"]) < 1e-15


def test_torques_that_friction_of_a_twist_holds_are_an_interval() -> None:
    # the weight stays, the torque is 0.1 N m times the load factor
    held = fb.stick_interval(shaft(torque=0.1, clamped=True, time=lambda t: t), "s: twist", at_time=(0.0, 1.0), load_factor=0.5)
    assert held.low == -np.inf and held.high == pytest.approx(10.0 * MOST, rel=1e-6)


@pytest.mark.parametrize("planar", ["auto", True])
def test_nothing_twists_in_a_plane_whose_scene_has_an_interval_in_space(planar: Any) -> None:
    # the torque of the first load is none; the second one lies in the axis, out of the plane
    model = shaft(torque=0.0, clamped=True, planar=planar)
    assert model.plane is not None
    if planar is True:
        with pytest.raises(fb.SceneError, match="'s: twist': beams do not twist in a plane"):
            fb.stick_interval(model, "s: twist")
    else:
        held = fb.stick_interval(model, "s: twist", within=(0.5, 2.0))
        assert held.low == -np.inf and held.high == np.inf


def test_a_torque_that_nothing_resists_is_named() -> None:
    with pytest.raises(fb.ConvergenceError, match="'s: twist' slips beyond its friction there, and no other force resists"):
        fb.solve_static(shaft(torque=0.5))


def test_joints_and_sleeves_that_rub_side_by_side() -> None:
    rod = fb.Beam.straight("rod", (-0.5, 0, 0), (0.5, 0, 0), section=STIFF, elements=2)
    soft = fb.Beam.straight("soft", (-1.5, 0, 0), (-0.5, 0, 0), section=SOFT, elements=30)
    holder = fb.RigidBody("holder", mass=1.0, inertia=(1, 1, 1), position=(0, 0, 0))
    arm = fb.RigidBody("arm", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(3, 0, 0))
    sleeve = fb.Sleeve("s", holder, rod, at=0.5, keyed=False, length=0.2, friction=MU, radius=RADIUS)
    hinge = fb.RevoluteJoint(fb.GROUND, arm.center, "hinge", axis=(1, 0, 0), friction=0.5, stiffness=2.0)
    model = fb.compile_scene(fb.Scene(
        rod, soft, fb.RigidConnection(soft.end, rod.start), fb.Clamp(soft.start), holder, fb.Clamp(holder), sleeve, arm, hinge,
        fb.Load("weight", rod.node(rod.n_nodes // 2), force=(0, 0, -WEIGHT), moment=(0.7, 0, 0)),
        fb.Load("turn", arm.center, moment=(0.9, 0, 0))))
    rest = fb.solve_static(model)
    told = rest.info["friction"]
    assert set(told) == {"s", "s: twist", "revolute joint 'hinge'"} and not told["s: twist"]["sticks"]
    assert abs(rest.slider("s")["twist"][-1] - (0.7 - MOST) * (1.0 + 0.5 / STIFF.GJ)) < 1.2e-5 * MOST
    later = run(model, 0.02, 2e-3, start=rest.state)
    angle = later.joint("hinge")["angle"]
    assert np.ptp(later.slider("s")["twist"]) == 0.0 and np.ptp(angle) < 1e-12 and abs(angle[0] - (0.9 - 0.5) / 2.0) < 1e-5


@pytest.mark.parametrize("call, text", [
    (fb.solve_path, "solve_path: sleeve 's' has friction of a beam"), (fb.modes, "modes: sleeve 's' has friction of a beam"),
    (fb.relax, "relax: sleeve 's' has friction of a beam"),
    (lambda model: fb.solve_static(model, contacts="exact"),
     r"solve_static\(contacts='exact'\): sleeve 's' has friction of a beam")])
def test_other_analyses_know_no_friction_of_a_twist(call: Any, text: str) -> None:
    with pytest.raises(fb.SceneError, match=text):
        call(shaft())


@pytest.mark.parametrize("keyed", [False, True])
def test_connections_under_a_sleeve_carry_what_acts_on_them_alone(keyed: bool) -> None:
    # the disc is connected to the node of the rod on which the sleeve acts
    options: dict[str, Any] = {"keyed": True, "radius": None} if keyed else {}
    model = shaft(torque=0.1, clamped=True, **options)
    rest = fb.solve_static(model, observe=("energy", "reaction"))
    moving = run(model, 4e-3, 1e-3, start=rest.state, observe=("energy", "slider", "reaction"))
    for result in (rest, moving):
        (name,) = [x for x in result.names["reactions"] if "disc" in x]
        held = result.reaction(name)
        np.testing.assert_allclose(held["moment"][-1], (0.1, 0.0, 0.0), rtol=0.0, atol=1e-7)
        np.testing.assert_allclose(held["force"][-1], (0.0, 0.0, -WEIGHT), rtol=0.0, atol=1e-4)


@pytest.mark.slow
def test_a_plane_has_no_twist() -> None:
    flat, without = (shaft(planar=True, radius=radius) for radius in (RADIUS, None))
    assert flat.plane is not None
    result, other = (run(model, 0.02, 1e-3) for model in (flat, without))
    assert np.max(np.abs(result.slider("s")["twist"])) == 0.0 and np.array_equal(result.state.q, other.state.q)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["body", "telescope"])
def test_balance_and_momenta_of_flexible_parts_that_fly(kind: str) -> None:
    model = fb.compile_scene(flying(kind, keyed=False, length=0.3, friction=0.1, radius=0.05), planar=False)
    result = run(model, 1.0, 5e-3)
    s = result.slider("sleeve")
    assert balanced(result) and result.drift("lin_mom") < 1e-12 and result.drift("ang_mom") < 1e-12
    assert np.ptp(s["twist"]) > (0.01 if kind == "body" else 1e-4) and np.all(np.diff(s["friction_loss"]) > -1e-11)
    # without friction of the twist less is lost
    less = run(fb.compile_scene(flying(kind, keyed=False, length=0.3, friction=0.1), planar=False), 1.0, 5e-3)
    assert less.slider("sleeve")["friction_loss"][-1] < s["friction_loss"][-1]
