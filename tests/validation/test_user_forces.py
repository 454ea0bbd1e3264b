"""Forces by functions of the user's own, against exact motions and against built-in loads and springs."""
from __future__ import annotations

import numpy as np
import pytest

import fastbeam as fb

BAR = fb.Section.circle(radius=0.02, E=1e8, rho=1000.0)
G = (0.0, 0.0, -9.81)


def drag(t, position, directors, velocity, spin, parameters, force, moment):
    speed = np.sqrt(velocity[0]**2 + velocity[1]**2 + velocity[2]**2)
    force[:] = -parameters[0] * speed * velocity


def damped_spin(t, position, directors, velocity, spin, parameters, force, moment):
    moment[:] = -parameters[0] * spin


def spring_to_origin(t, position, directors, velocity, spin, parameters, force, moment):
    force[:] = -parameters[0] * position


def constant(t, position, directors, velocity, spin, parameters, force, moment):
    for c in range(3):
        force[c] = parameters[c]
        moment[c] = parameters[3 + c]


def along_d3(t, position, directors, velocity, spin, parameters, force, moment):
    """Of constant size along the third director: a load that follows."""
    for c in range(3):
        force[c] = parameters[0] * directors[2, c]


def swinging(t, position, directors, velocity, spin, parameters, force, moment):
    force[2] = parameters[0] * np.sin(parameters[1] * t)


def test_a_falling_ball_has_its_terminal_speed():
    ball = fb.PointMass("ball", mass=0.2, position=(0, 0, 0))
    model = fb.compile_scene(fb.Scene(ball, fb.UserForce("air", ball, drag, parameters=(0.004,)), gravity=G))
    limit = np.sqrt(0.2 * 9.81 / 0.004)
    errors = []
    for step in (0.1, 0.05, 0.025):
        run = fb.simulate(model, t_end=5.0, step=step, points={"ball": ball}, observe=("energy", "velocity"), progress=False)
        errors.append(abs(run.velocity("ball")[-1, 2] + limit * np.tanh(9.81 * 5.0 / limit)))
        assert run.drift("balance") < 1e-13
        # what the air took away stands among the loads
        lost = run.balance()["loads"][-1] + 0.2 * 9.81 * -run.point("ball")[-1, 2]
        assert lost == pytest.approx(0.2 * 9.81 * -run.point("ball")[-1, 2] - run.series["kinetic"][-1], rel=1e-9)
    assert np.log2(errors[0] / errors[1]) > 1.95 and np.log2(errors[1] / errors[2]) > 1.95


def test_a_body_whose_spin_is_damped_slows_down_exponentially():
    body = fb.RigidBody("body", mass=1.0, inertia=np.eye(3) * 0.3, position=(0, 0, 0), spin=(1.0, -2.0, 0.5))
    model = fb.compile_scene(fb.Scene(body, fb.UserForce("grease", body, damped_spin, parameters=(0.2,))))
    errors = []
    for step in (0.02, 0.01):
        run = fb.simulate(model, t_end=1.0, step=step, progress=False)
        momentum = run.series["ang_mom"][-1]
        errors.append(np.linalg.norm(momentum - 0.3 * np.array([1.0, -2.0, 0.5]) * np.exp(-0.2 / 0.3)))
        assert run.drift("balance") < 1e-13
    assert errors[1] < 1e-4 and np.log2(errors[0] / errors[1]) > 1.95, errors


def test_a_spring_by_a_law_moves_like_the_built_in_one():
    def scene(own: bool) -> fb.Scene:
        beam = fb.Beam.straight("beam", (1, 0, 0), (2, 0, 0), section=BAR, elements=4)
        anchor = fb.PointMass("anchor", mass=1.0, position=(0, 0, 0))
        pull = (fb.UserForce("spring", beam.end, spring_to_origin, parameters=(30.0,), dissipates=False) if own else
                fb.Spring(beam.end, anchor, stiffness=30.0, length=0.0))
        return fb.Scene(beam, anchor, fb.Clamp(anchor), pull, fb.RigidMotion([beam], velocity=(0, 1, 0.5), spin=(0, 1, 2)))

    runs = [fb.simulate(fb.compile_scene(scene(own), planar=False), t_end=0.5, step=0.005, progress=False)
            for own in (True, False)]
    assert np.max(np.abs(runs[0].state.q - runs[1].state.q)) < 1e-9
    # the force at the mean place is the discrete gradient of a quadratic potential
    assert runs[0].drift("balance") < 1e-12


def test_order_four_with_laws_of_place_and_time():
    ball = fb.PointMass("ball", mass=0.2, position=(0.3, 0, 0), velocity=(0, 1, 0))
    parts = [ball, fb.UserForce("spring", ball, spring_to_origin, parameters=(5.0,), dissipates=False)]
    parts.append(fb.UserForce("shaker", ball, swinging, parameters=(0.7, 3.0), dissipates=False))
    model = fb.compile_scene(fb.Scene(*parts))
    w, a, nu, t = 5.0, 3.5, 3.0, 2.0
    exact = np.array([0.3 * np.cos(w * t), np.sin(w * t) / w, a / (w**2 - nu**2) * (np.sin(nu * t) - nu / w * np.sin(w * t))])
    errors = []
    for step in (0.1, 0.05):
        run = fb.simulate(model, t_end=t, step=step, order=4, points={"ball": ball}, progress=False)
        errors.append(np.linalg.norm(run.point("ball")[-1] - exact))
    assert errors[1] < 1e-5 and 3.7 < np.log2(errors[0] / errors[1]) < 4.4, errors


@pytest.mark.parametrize("moment", [False, True])
def test_a_constant_law_along_a_beam_is_a_distributed_load(moment):
    force, turn = (3.0, -2.0, 5.0), (0.05, 0.02, -0.03) if moment else (0.0, 0.0, 0.0)
    states = []
    for own in (True, False):
        beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=BAR, elements=3)
        load = (fb.UserForce("load", beam, constant, parameters=(*force, *turn)) if own else
                fb.DistributedLoad("load", beam, force=force, moment=turn))
        model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), load), planar=False)
        run = fb.simulate(model, t_end=0.2, step=0.005, progress=False)
        states.append((run.state.q, fb.solve_static(model).state.q))
        assert run.drift("balance" if own else "total" if not moment else "balance") < 1e-12
    for one, other in zip(*states):
        assert np.max(np.abs(one - other)) < 1e-10


def test_a_following_load_in_equilibrium_is_the_dead_load_of_its_last_direction():
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=BAR, elements=8)
    size = 3.0 * BAR.C[4, 4]
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.UserForce("jet", beam.end, along_d3, parameters=(size,))))
    follows = fb.solve_static(model, observe=("reaction", "energy"))
    q = follows.state.q.reshape(-1, 4, 3)
    direction = q[-1, 3]
    assert np.arccos(direction[2]) > 0.8
    held = follows.reaction("clamp of beam 'beam' node 0")["force"][-1]
    assert np.allclose(held, -size * direction, atol=1e-8 * size)
    dead = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Load("dead", beam.end, force=size * direction)))
    same = fb.solve_static(dead, load_step=0.1, largest_load_step=0.1)
    assert np.max(np.abs(same.state.q - follows.state.q)) < 1e-9


def test_a_load_of_time_acts_like_the_built_in_one_and_goes_on_bit_for_bit():
    def scene(own: bool) -> fb.Scene:
        body = fb.RigidBody("body", mass=1.0, inertia=(0.1, 0.2, 0.3), position=(0, 0, 0), spin=(0.1, 0.2, 3.0))
        at = body.point((0.2, 0.1, 0.0))
        return fb.Scene(body, fb.UserForce("shaker", at, swinging, parameters=(2.0, 9.0)) if own else
                        fb.Load("shaker", at, force=(0, 0, 2.0), time=lambda t: np.sin(9.0 * t)))

    model = fb.compile_scene(scene(True))
    whole = fb.simulate(model, t_end=0.5, step=0.005, progress=False)
    other = fb.simulate(fb.compile_scene(scene(False), planar=False), t_end=0.5, step=0.005, progress=False)
    # one evaluation in the middle of the step against three Gauss points
    assert np.max(np.abs(whole.state.q - other.state.q)) < 1e-4
    half = fb.simulate(model, t_end=0.25, step=0.005, progress=False)
    rest = fb.simulate(model, t_end=0.5, step=0.005, start=half.checkpoint, progress=False)
    assert all(np.array_equal(x, y) for x, y in zip(rest.state, whole.state))


def test_what_does_not_fit_is_refused():
    ball = fb.PointMass("ball", mass=0.2, position=(0, 0, 0))

    def broken(t, position, directors, velocity, spin, parameters, force, moment):
        force[:] = parameters[7]

    def not_finite(t, position, directors, velocity, spin, parameters, force, moment):
        force[0] = 1.0 / position[0]

    def not_compiled(t, position, directors, velocity, spin, parameters, force, moment):
        force[0] = {"a": 1.0}.get("b", open)  # noqa: SIM115

    for law, text in ((broken, "its law failed at the start, IndexError"), (not_finite, "must return finite numbers"),
                      (not_compiled, "numba cannot compile its law")):
        with pytest.raises(fb.SceneError, match=text):
            fb.compile_scene(fb.Scene(ball, fb.UserForce("own", ball, law)))
    spline = fb.Beam.straight("spline", (0, 0, 0), (1, 0, 0), section=BAR, elements=4, interpolation="bspline")
    with pytest.raises(fb.SceneError, match="B-splines"):
        fb.UserForce("own", spline, drag, parameters=(1.0,))
    with pytest.raises(fb.SceneError, match="function of"):
        fb.UserForce("own", ball, lambda t: t)
    model = fb.compile_scene(fb.Scene(ball, fb.UserForce("air", ball, drag, parameters=(0.1,))))
    with pytest.raises(fb.SceneError, match="does not support user force"):
        fb.simulate(model, t_end=0.1, step=0.01, method="generalized_alpha")
    with pytest.raises(fb.SceneError, match="user force 'air' may lead out of a plane"):
        fb.compile_scene(fb.Scene(ball, fb.UserForce("air", ball, drag, parameters=(0.1,))), planar=True)
    elsewhere = fb.PointMass("elsewhere", mass=0.2, position=(0, 0, 0))
    with pytest.raises(fb.SceneError, match="is not in scene"):
        fb.compile_scene(fb.Scene(ball, fb.UserForce("air", elsewhere, drag, parameters=(0.1,))))
