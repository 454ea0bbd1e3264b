"""Wind that varies in place and time: drag by it against a force of the user's own with the same law, in books, order."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb

G = 9.81
ROPE = fb.Section.circle(radius=0.01, E=1e7, rho=1000.0)
NUMBERS = np.array([4.0, 0.8, 2.5])


def shear(t, position, parameters, velocity):
    """A boundary layer with gusts that travel."""
    velocity[0] = parameters[0] + parameters[1] * position[2] + np.sin(parameters[2] * t - position[0])
    velocity[1] = 0.5 * np.cos(3.0 * position[2])
    velocity[2] = 0.3 * position[0] * position[1]


def same(t, position, directors, velocity, spin, parameters, force, moment):
    """Drag in that wind; the last three parameters are its coefficients, the one before whether it is a beam."""
    w = velocity.copy()
    w[0] -= parameters[0] + parameters[1] * position[2] + np.sin(parameters[2] * t - position[0])
    w[1] -= 0.5 * np.cos(3.0 * position[2])
    w[2] -= 0.3 * position[0] * position[1]
    along = np.zeros(3)
    if parameters[3] > 0.0:
        d = directors[0] / np.sqrt(np.sum(directors[0]**2))
        along = np.sum(w * d) * d
    across = w - along
    force[:] = -(parameters[4] * np.sqrt(np.sum(across**2)) * across + parameters[5] * np.sqrt(np.sum(along**2)) * along
                 + parameters[6] * w)


def scene(own: bool, support: Any = fb.Pin) -> Any:
    """A hanging rope with a body at its end, from a horizontal start."""
    rope = fb.Beam.straight("rope", (0, 0, 0), (2, 0, 0), section=ROPE, elements=5, degree=3, interpolation="lagrange")
    ball = fb.RigidBody("ball", mass=0.05, inertia=(1e-4, 1e-4, 1e-4), position=(2, 0, 0))
    forces = []
    for part, slender, tangential in ((rope, 1.0, 0.01), (ball, 0.0, 0.0)):
        if own:
            forces.append(fb.UserForce(f"wind on {part.name}", part, same,
                                       parameters=(*NUMBERS, slender, 0.05, tangential, 0.01), grows=True))
        else:
            forces.append(fb.Drag(f"wind on {part.name}", part, normal=0.05, tangential=tangential, linear=0.01, wind=shear,
                                  parameters=NUMBERS))
    return fb.compile_scene(fb.Scene(rope, ball, fb.RigidConnection(rope.end, ball), support(rope.start), *forces,
                                     gravity=(0, 0, -G)))


def test_it_is_the_force_of_the_users_own_with_the_same_law() -> None:
    wind, own = (fb.simulate(scene(x), t_end=0.3, step=0.005, progress=False) for x in (False, True))
    assert wind.drift("balance") < 1e-12 and own.drift("balance") < 1e-12
    assert np.max(np.abs(wind.phi - own.phi)) < 1e-12 and abs(wind.phi[-1, -1, 1]) > 1e-3
    taken = np.sum(wind.series["losses"], axis=1)
    # the loads of that run are its weight and the wind
    assert np.max(np.abs(taken + wind.balance()["gravity"] - own.balance()["loads"])) < 1e-12 and np.ptp(taken) > 0.01
    # the tangent knows how the air changes along the way
    assert wind.info["iterations"] <= own.info["iterations"]


def test_its_equilibrium_is_that_of_the_users_own_with_the_same_law() -> None:
    wind, own = (scene(x, fb.Clamp) for x in (False, True))
    rests = [fb.solve_static(model, at_time=0.4) for model in (wind, own)]
    assert np.max(np.abs(rests[0].state.q - rests[1].state.q)) < 1e-11 and abs(rests[0].phi[-1, -1, 1]) > 1e-3
    kept = [fb.modes(model, state=rest.state, at_time=0.4, n=6).angular for model, rest in zip((wind, own), rests)]
    np.testing.assert_allclose(*kept, rtol=1e-8)
    path = fb.solve_path(wind, at_time=0.4, largest_step=0.5, step=0.2)
    assert np.max(np.abs(path.state.q - rests[0].state.q)) < 1e-11
    with pytest.raises(fb.SceneError, match="its air moves by wind="):
        fb.frequency_response(wind, [1.0], base=(1, 0, 0), state=rests[0].state, at_time=0.4)
    with pytest.raises(fb.SceneError, match="its force between two times depends on more than these times"):
        fb.solve_path(wind, at_time=(0.0, 0.4), start=rests[0].state)


def test_a_mass_in_a_shear_flow_has_the_exact_way() -> None:
    """m v' = c (a z - v_x) with z = z_0 + w t, linear drag in a wind along x."""
    def layer(t, position, parameters, velocity):
        velocity[0] = parameters[0] * position[2]
        velocity[2] = parameters[1]

    m, c, a, up = 2.0, 3.0, 4.0, 0.5
    mass = fb.PointMass("mass", mass=m, position=(0, 0, 1.0), velocity=(0, 0, up))
    model = fb.compile_scene(fb.Scene(mass, fb.Drag("flow", mass, linear=c, wind=layer, parameters=(a, up))))
    ends = [fb.simulate(model, t_end=1.0, step=h, progress=False).state.v.reshape(-1, 3)[0, 0] for h in (0.02, 0.01)]
    # v = a (z_0 + w t) - a w m/c + C exp(-c t/m)
    exact = a * (1.0 + up) - a * up * m / c - (a - a * up * m / c) * np.exp(-c / m)
    off = np.abs(np.array(ends) - exact)
    assert off[1] < 1e-4 and 3.9 < off[0] / off[1] < 4.1


def test_winds_that_cannot_be_are_refused() -> None:
    mass = fb.PointMass("mass", mass=1.0, position=(0, 0, 0))
    with pytest.raises(fb.SceneError, match="leave air and time out"):
        fb.Drag("d", mass, linear=1.0, wind=shear, air=(1, 0, 0))
    with pytest.raises(fb.SceneError, match="parameters are numbers for wind"):
        fb.Drag("d", mass, linear=1.0, parameters=(1.0,))

    def wrong(t, position, parameters, velocity):
        velocity[0] = np.nan
    with pytest.raises(fb.SceneError, match="its wind returns"):
        fb.compile_scene(fb.Scene(mass, fb.Drag("d", mass, linear=1.0, wind=wrong)))
    model = fb.compile_scene(fb.Scene(mass, fb.Drag("d", mass, linear=1.0, wind=shear, parameters=NUMBERS)), planar="auto")
    with pytest.raises(fb.SceneError, match="point mass 'mass' has an unbalanced force of"):
        fb.modes(model, n=1)
    with pytest.raises(fb.SceneError, match="its air moves by wind=, and damping of small motions by such air"):
        fb.modes(model, n=1, damped=True)
