"""Derivatives of laws that are given instead of taken by differences."""
from __future__ import annotations

from typing import Any

import numba
import numpy as np
import pytest

import fastbeam as fb
from fastbeam.model.forces.user_forces import check_slopes
from fastbeam.scene.follower import turning, turning_slopes
from fastbeam.stepping.stepper import Stepper

Array = np.ndarray


def law(t: Any, position: Any, directors: Any, velocity: Any, spin: Any, parameters: Any, force: Any, moment: Any) -> None:
    """Of everything it is given, not linear in any of it."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        force[i] = -parameters[0] * position[i] * (1.0 + position[j]**2) + directors[i, j] * directors[k, i]
        force[i] += -0.3 * velocity[i] * (1.0 + velocity[k]**2) + 0.2 * spin[j] * position[k] + 0.1 * np.sin(t)
        moment[i] = -parameters[1] * directors[j, k] * (1.0 + directors[i, i]) - 0.05 * spin[i] * (1.0 + spin[j]**2)
        moment[i] += 0.04 * velocity[j] * directors[k, k] + 0.02 * position[i] * position[k]


def slopes(t: Any, position: Any, directors: Any, velocity: Any, spin: Any, parameters: Any, out: Any) -> None:
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i, i] += -parameters[0] * (1.0 + position[j]**2)
        out[i, j] += -2.0 * parameters[0] * position[i] * position[j]
        out[i, 3 + 3 * i + j] += directors[k, i]
        out[i, 3 + 3 * k + i] += directors[i, j]
        out[i, 12 + i] += -0.3 * (1.0 + velocity[k]**2)
        out[i, 12 + k] += -0.6 * velocity[i] * velocity[k]
        out[i, 15 + j] += 0.2 * position[k]
        out[i, k] += 0.2 * spin[j]
        m = 3 + i
        out[m, 3 + 3 * j + k] += -parameters[1] * (1.0 + directors[i, i])
        out[m, 3 + 3 * i + i] += -parameters[1] * directors[j, k]
        out[m, 15 + i] += -0.05 * (1.0 + spin[j]**2)
        out[m, 15 + j] += -0.1 * spin[i] * spin[j]
        out[m, 12 + j] += 0.04 * directors[k, k]
        out[m, 3 + 3 * k + k] += 0.04 * velocity[j]
        out[m, i] += 0.02 * position[k]
        out[m, k] += 0.02 * position[i]


compiled = numba.njit(slopes)


def stiffening(t: Any, length: Any, rate: Any, parameters: Any) -> Any:
    return parameters[0] * (length - 0.4)**3 + parameters[1] * rate * length


def its_slopes(t: Any, length: Any, rate: Any, parameters: Any) -> Any:
    return 3.0 * parameters[0] * (length - 0.4)**2 + parameters[1] * rate, parameters[1] * length


def scene(kind: str, given: bool) -> fb.Scene:
    body = fb.RigidBody("body", mass=0.4, inertia=(0.02, 0.03, 0.025), position=(0.3, -0.2, 0.4), velocity=(1.0, 0.4, -0.7),
                        spin=(2.0, -3.0, 1.0))
    other = fb.RigidBody("other", mass=0.7, inertia=(0.03, 0.02, 0.04), position=(-0.3, 0.1, 0.2), spin=(-1.0, 0.5, 2.0))
    options: dict[str, Any] = dict(parameters=(3.0, 0.2), law=law) | (dict(derivative=slopes) if given else {})
    if kind == "user":
        return fb.Scene(body, other, fb.UserForce("law", body, **options))
    if kind == "element":
        return fb.Scene(body, other, fb.ForceElement(other.point((0.1, 0.0, 0.05)), body.center, "law", **options))
    if kind == "beam":
        section = fb.Section.circle(radius=0.02, E=1e6, rho=1000.0)
        beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=section, elements=2, degree=3)
        return fb.Scene(beam, fb.Clamp(beam.start), fb.UserForce("law", beam, **options))
    options |= dict(law=stiffening) | (dict(derivative=its_slopes) if given else {})
    return fb.Scene(body, other, fb.LineForce(other.center, body.point((0.05, 0.0, 0.1)), "law", **options))


KINDS = ["user", "element", "beam", "line"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("h", [0.05, 0.0])
def test_tangent_of_a_given_derivative_is_that_of_differences(kind: str, h: float) -> None:
    draw = np.random.default_rng(3)
    found = []
    for given in (False, True):
        model = fb.compile_scene(scene(kind, given))
        stepper = Stepper(model, np.ones(1), static=h == 0.0)
        draw = np.random.default_rng(3)
        n = model.n_nodes
        stepper.parts.start(h)
        stepper.work.dphi[:3 * n] = 0.05 * draw.standard_normal(3 * n)
        stepper.work.theta[:3 * n] = 0.1 * draw.standard_normal(3 * n)
        stepper.parts.assemble(h)
        found.append((stepper.work.blocks.copy(), stepper.work.r.copy()))
    (blocks, r), (own, own_r) = found
    assert np.max(np.abs(r)) > 0.0
    np.testing.assert_array_equal(own_r, r)
    # of nodes in time one-sided ones with increments of 1e-7: as much times the curvature of the law
    near = 3e-7 if kind in ("user", "beam") and h != 0.0 else 1e-8
    np.testing.assert_allclose(own, blocks, rtol=0.0, atol=near * np.max(np.abs(blocks)))
    # by differences otherwise
    assert np.any(own != blocks)


@pytest.mark.parametrize("kind", KINDS)
def test_runs_and_equilibria_are_those_of_differences(kind: str) -> None:
    runs = [fb.simulate(fb.compile_scene(scene(kind, given)), t_end=0.4, step=0.02, progress=False) for given in (False, True)]
    np.testing.assert_allclose(runs[1].state.q, runs[0].state.q, rtol=0.0, atol=1e-11)
    assert runs[1].info["iterations"] <= runs[0].info["iterations"]
    if kind == "beam":
        rest = [fb.solve_static(fb.compile_scene(scene(kind, given))) for given in (False, True)]
        np.testing.assert_allclose(rest[1].state.q, rest[0].state.q, rtol=0.0, atol=1e-9)


def wrong(t: Any, position: Any, directors: Any, velocity: Any, spin: Any, parameters: Any, out: Any) -> None:
    compiled(t, position, directors, velocity, spin, parameters, out)
    out[4, 16] *= 1.01


def off_by_a_sign(t: Any, length: Any, rate: Any, parameters: Any) -> Any:
    return 3.0 * parameters[0] * (length - 0.4)**2 + parameters[1] * rate, -parameters[1] * length


def no_derivative(t: Any, position: Any, directors: Any, velocity: Any, spin: Any, parameters: Any, out: Any) -> None:
    out[0, 0] = parameters.nothing


def not_finite(t: Any, position: Any, directors: Any, velocity: Any, spin: Any, parameters: Any, out: Any) -> None:
    compiled(t, position, directors, velocity, spin, parameters, out)
    out[2, 1] = np.nan


@pytest.mark.parametrize("derivative, text", [
    (wrong, r"user force 'law': its derivative returns .* for the change of moment\[1\] with spin\[1\], but differences"),
    (not_finite, r"returns nan for the change of force\[2\] with position\[1\]"),
    (no_derivative, "user force 'law': numba cannot compile its derivative"),
    (lambda t: 0.0, "user force 'law': derivative must be a function of"),
    (1.0, "user force 'law': derivative must be a function of"),
])
def test_a_derivative_that_is_none_is_refused(derivative: Any, text: str) -> None:
    body = fb.RigidBody("body", mass=0.4, inertia=(0.02, 0.03, 0.025), position=(0.3, -0.2, 0.4))
    with pytest.raises(fb.SceneError, match=text):
        fb.compile_scene(fb.Scene(body, fb.UserForce("law", body, law, parameters=(3.0, 0.2), derivative=derivative)))


def lever(t: Any, position: Any, directors: Any, velocity: Any, spin: Any, parameters: Any, force: Any, moment: Any) -> None:
    for i in range(3):
        force[i] = -parameters[0] * (position[i] + 0.5 * directors[0, i] - parameters[1 + i])


def its_lever(t: Any, position: Any, directors: Any, velocity: Any, spin: Any, parameters: Any, out: Any) -> None:
    for i in range(3):
        out[i, i] = -parameters[0]
        out[i, 3 + i] = -0.5 * parameters[0]


@pytest.mark.parametrize("far", [1.0, 1e3, 1e6])
def test_a_derivative_is_taken_far_from_the_origin(far: float) -> None:
    body = fb.RigidBody("body", mass=0.4, inertia=(0.02, 0.03, 0.025), position=(far, -far, 0.4))
    force = fb.UserForce("law", body, lever, parameters=(10.0, far, -far, 0.4), derivative=its_lever)
    model = fb.compile_scene(fb.Scene(body, force))
    assert model.n_nodes == 1


def test_a_derivative_of_a_tension_with_a_wrong_sign_is_refused() -> None:
    ball = fb.PointMass("ball", mass=1.0, position=(0, 0, 1))
    force = fb.LineForce(fb.GROUND.point((0, 0, 0)), ball, "law", law=stiffening, parameters=(3.0, 0.2), derivative=off_by_a_sign)
    with pytest.raises(fb.SceneError, match="line force 'law': its derivative returns -0.2 for the change of tension with rate"):
        fb.compile_scene(fb.Scene(ball, force))


def pushed(t: Any, position: Any, directors: Any, velocity: Any, spin: Any, parameters: Any, force: Any, moment: Any) -> None:
    force[2] = parameters[0] * max(-position[2], 0.0) - parameters[1] * abs(velocity[2]) * velocity[2]


def its_push(t: Any, position: Any, directors: Any, velocity: Any, spin: Any, parameters: Any, out: Any) -> None:
    out[2, 2] = -parameters[0] if position[2] < 0.0 else 0.0
    out[2, 14] = -2.0 * parameters[1] * abs(velocity[2])


@pytest.mark.parametrize("height", [0.0, 1e-9, -1e-9, 0.3, -0.3])
def test_a_law_with_a_kink_at_the_start_takes_its_derivative(height: float) -> None:
    ball = fb.PointMass("ball", mass=1.0, position=(0, 0, height), velocity=(0, 0, -1.0))
    force = fb.UserForce("law", ball, pushed, parameters=(1e3, 0.1), derivative=its_push)
    run = fb.simulate(fb.compile_scene(fb.Scene(ball, force)), t_end=0.1, step=0.01, progress=False)
    assert run.t[-1] == pytest.approx(0.1) and np.isfinite(run.state.q).all()


def test_the_derivative_of_loads_that_follow_is_that_of_their_law() -> None:
    """It is not compared when a scene is compiled."""
    rng = np.random.default_rng(3)
    given, parameters = rng.standard_normal(18), rng.standard_normal(6)
    check_slopes("load", turning, turning_slopes, given, parameters, False)
    with pytest.raises(fb.SceneError, match="its derivative returns"):
        check_slopes("load", turning, lambda *x: turning_slopes(*x[:5], -x[5], x[6]), given, parameters, False)
