"""Reactions, section forces and velocities against exact values and against the equations that they belong to."""
from __future__ import annotations

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.dynamics.reactions import ReactingStepper

BAR = fb.Section.circle(radius=0.05, E=2e9, rho=1000.0)
G = np.array([0.0, 0.0, -9.81])


def cantilever(strain: str, degree: int = 3, elements: int = 8, force=(300.0, -2000.0, 900.0)):
    beam = fb.Beam.straight("beam", (0, 0, 0), (2, 0, 0), section=BAR, elements=elements, degree=degree, strain=strain)
    wall = fb.Clamp(beam.start, name="wall")
    return beam, wall, fb.compile_scene(fb.Scene(beam, wall, fb.Load("tip", beam.end, force=force)))


@pytest.mark.parametrize("force", [(300.0, -2000.0, 900.0), (300.0, -2000.0, 0.0)], ids=["space", "plane"])
@pytest.mark.parametrize("strain", ["simo_reissner", "green_lagrange"])
def test_sections_of_a_bent_cantilever_hold_its_load(strain, force):
    beam, wall, model = cantilever(strain, force=force)
    result = fb.solve_static(model, observe=("section", "reaction"), points={"root": beam.start, "tip": beam.end})
    s = np.linspace(0.0, 2.0, 41)
    found = fb.section_forces(model, result.state, beam, s)
    lever = result.state.q.reshape(-1, 4, 3)[-1, 0] - found.position[0]
    moment = np.cross(lever, force)
    assert np.max(np.abs(found.force[0] - force)) < 1e-9 * np.linalg.norm(force)
    assert np.max(np.abs(found.moment[0] - moment)) < 1e-6 * np.max(np.abs(moment))
    # components along the triad make up the vectors
    parts = np.stack((found.N, found.Q2, found.Q3), axis=-1), np.stack((found.T, found.M2, found.M3), axis=-1)
    for whole, of in zip((found.force, found.moment), parts):
        assert np.allclose(np.einsum("tsk,tskc->tsc", of, found.directors), whole, rtol=1e-12, atol=1e-9)
    row = result.section("root")
    assert row["N"][-1] == pytest.approx(found.N[0, 0], rel=1e-12)
    assert row["M3"][-1] == pytest.approx(found.M3[0, 0], rel=1e-12)
    held = result.reaction(wall)
    assert np.max(np.abs(held["force"][-1] + force)) < 1e-9 * np.linalg.norm(force)
    about = np.cross(result.state.q.reshape(-1, 4, 3)[-1, 0], force)
    assert np.max(np.abs(held["moment"][-1] + about)) < 1e-8 * np.max(np.abs(moment))
    assert np.array_equal(result.reaction("wall")["force"], held["force"])


@pytest.mark.parametrize(("degree", "elements"), [(2, 2), (2, 7), (3, 2), (3, 8), (4, 5)])
def test_sections_of_splines_hold_the_load_whatever_their_points(degree, elements):
    bar = fb.Section.circle(radius=0.01, E=2e11, rho=7800.0)
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=bar, elements=elements, degree=degree, interpolation="bspline")
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, force=(0, 0, -1e-3))))
    s = np.linspace(0.0, 1.0, 17)
    found = fb.section_forces(model, fb.solve_static(model).state, beam, s)
    np.testing.assert_allclose(np.abs(found.M2[0]), 1e-3 * (1.0 - s), rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.abs(found.Q3[0]), 1e-3, rtol=1e-9)


def test_section_moments_converge_twice_as_fast_as_strains_would():
    errors = []
    for elements in (4, 8, 16):
        beam, _, model = cantilever("simo_reissner", elements=elements)
        state = fb.solve_static(model).state
        found = fb.section_forces(model, state, beam, np.linspace(0.0, 2.0, 33))
        exact = np.cross(state.q.reshape(-1, 4, 3)[-1, 0] - found.position[0], (300.0, -2000.0, 900.0))
        errors.append(np.max(np.abs(found.moment[0] - exact)) / np.max(np.abs(exact)))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(rates > 3.7), rates


def test_a_roll_up_has_its_moment_everywhere():
    # pure bending to a full circle: M = 2 pi EI / L
    moment = 2.0 * np.pi * BAR.C[5, 5] / 2.0
    errors = []
    for elements in (8, 16):
        beam = fb.Beam.straight("beam", (0, 0, 0), (2, 0, 0), section=BAR, elements=elements, degree=3)
        model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, moment=(0, 0, moment))))
        found = fb.section_forces(model, fb.solve_static(model, load_step=0.1, largest_load_step=0.1).state, beam)
        errors.append(np.max(np.abs(found.M3 / moment - 1.0)))
        assert np.max(np.abs(found.N)) < 1e-9 * moment
    assert errors[1] < 2e-5 and np.log2(errors[0] / errors[1]) > 3.7, errors


def loop_scene(out_of_plane: float = 0.3):
    """A beam on a pin, a body welded to it, a mass that hangs from the body, a ring on the beam, a body in a closed loop."""
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=BAR, elements=4)
    plate = fb.RigidBody("plate", mass=2.0, inertia=np.diag([0.02, 0.03, 0.04]), position=(1.2, 0, 0))
    weight = fb.PointMass("weight", mass=0.5, position=(1.5, 0, 0))
    rod = fb.RigidBody("rod", mass=1.0, inertia=np.diag([0.01, 0.05, 0.05]), position=(1.2, 0, -0.4))
    ring = fb.PointMass("ring", mass=0.3, position=(0.4, 0, 0))
    parts = [beam, plate, weight, rod, ring, fb.Pin(beam.start, name="pin"), fb.RigidConnection(beam.end, plate, name="weld"),
             fb.BallJoint(plate.point((0.3, 0, 0)), weight, name="hook"),
             fb.BallJoint(plate, rod.point((0, 0, 0.4)), name="hinge"),
             fb.DistanceJoint(rod.point((0.2, 0, 0)), weight, name="strut"),
             fb.Slider("ring on beam", ring, beam, at=0.4),
             fb.Load("push", plate, force=(3.0, 0.0, 5.0), moment=(0, 0.2, 0)),
             fb.Load("side", weight, force=(0, out_of_plane, 0))]
    return fb.Scene(*parts, gravity=G)


@pytest.mark.parametrize("planar", [True, False], ids=["plane", "space"])
def test_momenta_of_the_steps_balance_with_reactions_and_loads(planar):
    """In every step the pin, gravity and loads make up the change of momentum, and the joints that of the parts."""
    scene = loop_scene(out_of_plane=0.0)
    model = fb.compile_scene(scene, planar=planar)
    stepper = ReactingStepper(model, np.ones(1))
    names = model.reaction_names
    assert names == ["pin", "weld", "hook", "hinge", "strut"]
    h, total = 1e-3, float(model.gravity_weight.sum())
    weight = model.numbers.start(next(p for p in scene.parts if getattr(p, "name", "") == "weight"))
    largest = 0.0
    for k in range(40):
        v0 = stepper.state.v.reshape(-1, 4, 3)[weight, 0].copy()
        p0 = momentum(model, stepper.state)
        outcome = stepper.advance(k * h, h, 1)
        found = dict(zip(names, outcome.force[1, model.n_forces:].reshape(-1, 2, 3)))
        change = (momentum(model, stepper.state) - p0) / h
        assert np.max(np.abs(found["pin"][0] + total * G + (3.0, 0.0, 5.0) - change)) < 1e-9 * 200.0
        assert np.all(found["pin"][1] == 0.0)
        # the weight: hook and strut
        own = 0.5 * (stepper.state.v.reshape(-1, 4, 3)[weight, 0] - v0) / h
        strut = found[names[-1]][0]
        assert np.max(np.abs(found["hook"][0] + strut + 0.5 * G - own)) < 1e-9 * 200.0
        largest = max(largest, np.max(np.abs(outcome.force[1])))
    assert 10.0 < largest < 200.0


def momentum(model, state):
    from fastbeam.results.observe.observer import Observer
    return Observer(model, ("momentum",), None).row(0.0, state)["lin_mom"]


def test_a_run_with_reactions_is_the_same_run():
    model = fb.compile_scene(loop_scene())
    plain = fb.simulate(model, t_end=0.05, step=1e-3)
    told = fb.simulate(model, t_end=0.05, step=1e-3, observe=("energy", "momentum", "slider", "reaction"))
    assert np.array_equal(plain.state.q, told.state.q)
    assert np.allclose(plain.series["contact_force"], told.series["contact_force"], rtol=1e-9, atol=1e-9)
    assert np.isfinite(told.series["reaction"]).all()


def pendulum():
    """A mass on a rod without mass, let go at 1.2 rad."""
    angle, length = 1.2, 0.7
    top = fb.PointMass("top", mass=1.0, position=(0, 0, 0))
    bob = fb.PointMass("bob", mass=2.5, position=(length * np.sin(angle), 0, -length * np.cos(angle)))
    return fb.Scene(top, bob, fb.Clamp(top, name="hanger"), fb.DistanceJoint(top, bob, name="rod"), gravity=G), angle, length, bob


def test_the_pull_of_a_pendulum_is_of_second_order_at_rows():
    scene, angle, length, bob = pendulum()
    model = fb.compile_scene(scene)
    errors = []
    for step in (4e-3, 2e-3, 1e-3):
        result = fb.simulate(model, t_end=1.2, step=step, every=max(1, round(0.1 / step)), observe=("reaction", "velocity"),
                             points={"bob": bob})
        x, v = result.point("bob"), result.velocity("bob")
        # m (g cos a + v^2/L) along the rod, at the places and speeds of the rows
        pull = 2.5 * (9.81 * -x[:, 2] / length + np.sum(v**2, axis=1) / length)
        on_hanger = result.reaction("hanger")["force"] + 1.0 * G
        direction = -x / np.linalg.norm(x, axis=1)[:, None]
        errors.append(np.max(np.abs(np.einsum("nc,nc->n", on_hanger, direction) - pull)))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(rates > 1.8) and errors[-1] < 1e-3 * 2.5 * 9.81, (errors, rates)


def test_supports_of_a_cable_with_rings_carry_all_weights():
    rope = fb.Section.circle(radius=0.004, E=1e9, rho=1200.0)
    cable = fb.Beam.straight("cable", (0, 0, 0), (4, 0, 0), section=rope, elements=16)
    rings = [fb.PointMass(f"ring {k}", mass=0.2 + 0.1 * k, position=(1.0 + k, 0, 0)) for k in range(3)]
    sliders = [fb.Slider(f"on cable {k}", ring, cable, at=1.0 + k) for k, ring in enumerate(rings)]
    model = fb.compile_scene(fb.Scene(cable, *rings, *sliders, fb.Pin(cable.start, name="left"), fb.Pin(cable.end, name="right"),
                                      gravity=G))
    held = fb.solve_static(model, held=True, observe=("reaction", "energy"))
    total = held.reaction("left")["force"][-1] + held.reaction("right")["force"][-1]
    assert np.allclose(total, -model.gravity_weight.sum() * G, atol=1e-9 * 20.0)
    # horizontal pulls agree with the tension in the sections beside the supports
    found = fb.section_forces(model, held.state, cable, [0.0, 4.0])
    assert np.allclose(found.force[0, 0], -held.reaction("left")["force"][-1], rtol=0, atol=0.02)


def test_shares_that_nothing_tells_are_nan():
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=BAR, elements=2)
    body = fb.RigidBody("body", mass=1.0, inertia=np.eye(3), position=(0, 0, 0))
    model = fb.compile_scene(fb.Scene(beam, body, fb.RigidConnection(body, beam.start, name="weld"), fb.Clamp(body, name="a"),
                                      fb.Clamp(beam.start, name="b"), gravity=G))
    result = fb.solve_static(model, observe=("reaction",))
    total = np.array([result.reaction(x)["force"][-1] for x in ("a", "b")])
    assert np.isnan(total).all(axis=1).sum() == 1
    assert np.allclose(np.nansum(total, axis=0), -model.gravity_weight.sum() * G)
    assert np.isnan(result.reaction("weld")["force"]).all()


def test_reactions_survive_files_and_checkpoints(tmp_path):
    model = fb.compile_scene(loop_scene())
    options = {"step": 1e-3, "observe": ("reaction", "energy")}
    whole = fb.simulate(model, t_end=0.04, every=5, output=tmp_path / "run.h5", **options)
    again = fb.load_result(tmp_path / "run.h5")
    assert np.array_equal(again.reaction("pin")["force"], whole.reaction("pin")["force"])
    half = fb.simulate(model, t_end=0.02, every=5, **options)
    rest = fb.simulate(model, t_end=0.04, every=5, start=half.checkpoint, **options)
    assert np.array_equal(rest.state.q, whole.state.q)
    assert np.allclose(rest.reaction("pin")["force"][1:], whole.reaction("pin")["force"][-4:], rtol=1e-9, atol=1e-9)


def test_section_forces_refuse_what_is_not_there():
    beam, _, model = cantilever("simo_reissner")
    other = fb.Beam.straight("other", (0, 0, 0), (1, 0, 0), section=BAR, elements=2)
    state = model.state()
    for arguments, text in (((model, state, other), "not in scene"), ((model, state, "beam"), "needs a beam"),
                            ((model, state, beam, 3.0), "arc lengths within"), ((model, 3.0, beam), "a Result or a State"),
                            ((model, fb.compile_scene(fb.Scene(other)).state(), beam), "has shape")):
        with pytest.raises(fb.SceneError, match=text):
            fb.section_forces(*arguments)


def test_a_hinge_with_a_motor_and_a_moving_support_balance():
    """Reactions of a revolute joint with spring and motor, and of a support that moves, make up the change of momentum."""
    arm = fb.RigidBody("arm", mass=1.5, inertia=np.diag([0.02, 0.05, 0.04]), position=(0.4, 0, 0))
    base = fb.RigidBody("base", mass=2.0, inertia=np.eye(3) * 0.1, position=(0, 0, 0))
    hinge = fb.RevoluteJoint(base, arm.point((-0.4, 0, 0)), name="hinge", axis=(0, 0, 1), stiffness=3.0,
                             torque=lambda t: 0.7 * np.sin(9.0 * t))
    shaker = fb.PrescribedMotion("shaker", base, displacement=lambda t: (0.02 * (1.0 - np.cos(12.0 * t)), 0.0, 0.0),
                                 rotation=lambda t: np.eye(3))
    model = fb.compile_scene(fb.Scene(arm, base, hinge, shaker, gravity=(0, -9.81, 0)), planar=False)
    stepper = ReactingStepper(model, np.ones(1))
    names = model.reaction_names
    h = 1e-3
    at = model.numbers.start(arm)
    for k in range(30):
        p0, v0 = momentum(model, stepper.state), stepper.state.v.reshape(-1, 4, 3)[at, 0].copy()
        outcome = stepper.advance(k * h, h, 1)
        found = dict(zip(names, outcome.force[1, model.n_forces:].reshape(-1, 2, 3)))
        change = (momentum(model, stepper.state) - p0) / h
        assert np.max(np.abs(found["shaker"][0] + 3.5 * np.array([0, -9.81, 0]) - change)) < 1e-8
        own = 1.5 * (stepper.state.v.reshape(-1, 4, 3)[at, 0] - v0) / h
        assert np.max(np.abs(found["hinge"][0] + 1.5 * np.array([0, -9.81, 0]) - own)) < 1e-8
        # the joint leaves the turn about its axis free: no moment there
        assert abs(found["hinge"][1][2]) < 1e-10
    assert np.max(np.abs(found["hinge"][0])) > 1.0
