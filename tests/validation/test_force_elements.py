"""Forces and moments between two triads by laws of the user's own: as bushings, momenta and books (theory.md (4.33))."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb

PUSH, PULL = np.array([40.0, 60.0, 25.0]), np.array([1.5, 0.7, 2.0])
TURN, CALM = np.array([3.0, 5.0, 2.0]), np.array([0.1, 0.2, 0.3])
ARM = fb.RigidBody("arm", mass=2.0, inertia=(0.1, 0.2, 0.25), position=(0, 0, 0), velocity=(0.3, 0, 0.1), spin=(1.0, 2.0, -0.5))
LEG = fb.RigidBody("leg", mass=1.0, inertia=(0.05, 0.04, 0.06), position=(1.0, 0.2, 0), spin=(-0.7, 0.3, 1.0))
ENDS = ARM.point((0.2, 0.1, 0)), LEG.point((-0.1, 0.15, 0.05))
AXES = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
BLOCK = fb.RigidBody("block", mass=2.0, inertia=(0.1, 0.1, 0.1), position=(0, 0, 0))
START = AXES @ np.array([0.7, 0.25, 0.05])


def mount(t, position, rotation, velocity, spin, parameters, force, moment):
    """Stiffness, damping, place at rest; of turns the sine."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        force[i] = -parameters[i] * (position[i] - parameters[6 + i]) - parameters[3 + i] * velocity[i]
        moment[i] = -parameters[9 + i] * 0.5 * (rotation[k, j] - rotation[j, k]) - parameters[12 + i] * spin[i]


def crank(t, position, rotation, velocity, spin, parameters, force, moment):
    """Without a potential, of everything that it is given."""
    force[:] = parameters[0] * np.sin(3.0 * t) * rotation[0] - 2.0 * position * np.sum(position**2) + 0.02 * np.sum(spin**2)
    moment[:] = parameters[1] * np.cos(t) * position + 0.03 * velocity[1] * rotation[2] - 0.01 * spin * np.abs(spin[0])


def numbers(turns: bool) -> Any:
    return np.concatenate((PUSH, PULL, START, TURN * turns, CALM * turns))


def run(link: Any, step: float = 0.01, **options: Any) -> fb.Result:
    model = fb.compile_scene(fb.Scene(ARM, LEG, link), planar=False)
    return fb.simulate(model, t_end=1.0, step=step, progress=False, observe=("energy", "momentum"), **options)


def test_displacements_by_a_law_are_those_of_a_bushing() -> None:
    zero = np.zeros(3)
    built = run(fb.Bushing(*ENDS, "m", stiffness=np.concatenate((PUSH, zero)), damping=np.concatenate((PULL, zero)),
                           directors=AXES))
    own = run(fb.ForceElement(*ENDS, "m", law=mount, parameters=numbers(False), directors=AXES))
    assert np.max(np.abs(own.phi - built.phi)) < 1e-12 and np.max(np.abs(own.directors - built.directors)) < 1e-12
    taken, lost = own.balance()["work taken by force element 'm'"], built.balance()["damping of bushing 'm'"]
    strain = built.series["strain"]
    assert np.max(np.abs(taken - lost - (strain - strain[0]))) < 1e-11 and lost[-1] > 0.1


def test_turns_by_a_law_are_those_of_a_bushing() -> None:
    """About one axis, where the moment of a bushing is the sine of the angle."""
    disc = fb.RigidBody("disc", mass=1.0, inertia=(0.05, 0.05, 0.06), position=(0.4, 0, 0), velocity=(0.5, 0.3, 0),
                        spin=(0, 0, 3.0))
    hub = fb.GROUND.point((0, 0, 0))

    def last(link: Any) -> fb.Result:
        model = fb.compile_scene(fb.Scene(disc, link), planar=False)
        return fb.simulate(model, t_end=0.64, step=0.02, progress=False)

    zero = np.zeros(3)
    built = last(fb.Bushing(hub, disc.center, stiffness=np.concatenate((PUSH, TURN)), damping=np.concatenate((PULL, zero))))
    parameters = np.concatenate((PUSH, PULL, (0.4, 0, 0), TURN, zero))
    own = last(fb.ForceElement(hub, disc.center, law=mount, parameters=parameters))
    assert np.max(np.abs(own.directors - built.directors)) < 1e-12 and np.max(np.abs(own.phi - built.phi)) < 1e-12
    assert np.ptp(own.directors[:, 0, 0, 0]) > 0.05


def test_steps_are_of_second_order() -> None:
    link = fb.ForceElement(*ENDS, law=mount, parameters=numbers(True), directors=AXES)
    ends = [run(link, h).directors[-1] for h in (0.02, 0.01, 0.005)]
    assert 3.7 < np.max(np.abs(ends[0] - ends[1])) / np.max(np.abs(ends[1] - ends[2])) < 4.3


@pytest.mark.parametrize("order", [2, 4])
def test_any_law_keeps_momenta_and_closes_its_books(order: int) -> None:
    result = run(fb.ForceElement(*ENDS, law=crank, parameters=(1.0, 0.1), directors=AXES), order=order)
    assert np.ptp(result.series["kinetic"]) > 0.1
    for name in ("balance", "lin_mom", "ang_mom") if order == 2 else ("balance",):
        assert abs(result.drift(name)) < (1e-12 if order == 2 else 1e-8)


def test_a_torsional_damper_slows_two_rotors_at_its_rate() -> None:
    """J/2 d(w_b - w_a)/dt = -c (w_b - w_a)."""
    rotors = [fb.RigidBody(f"r{k}", mass=1.0, inertia=(0.1, 0.1, 0.2), position=(0, 0, k), spin=(0, 0, s))
              for k, s in enumerate((1.0, -3.0))]
    link = fb.ForceElement(rotors[0].center, rotors[1].center, law=mount,
                           parameters=np.concatenate((np.zeros(12), np.full(3, 0.15))))
    spin = []
    for h in (0.02, 0.01):
        model = fb.compile_scene(fb.Scene(*rotors, link), planar=False)
        result = fb.simulate(model, t_end=1.0, step=h, progress=False)
        spin.append(result.series["kinetic"][-1])
    relative = 4.0 * np.exp(-0.15 * 2.0 / 0.2)
    exact = 0.5 * 0.2 * 2.0 * (1.0 + 0.25 * relative**2)
    assert abs(spin[1] - exact) < 1e-4 and 3.8 < (spin[0] - exact) / (spin[1] - exact) < 4.2


@pytest.mark.parametrize("weight", [0.0, 2.0])
def test_beams_on_elements_have_equilibria_and_modes_as_on_bushings(weight: float) -> None:
    """Turned about one axis in the equilibrium; modes, with damping, where it is free of forces."""
    section = fb.Section.circle(radius=0.015, E=1e7, rho=1000.0)
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=section, elements=6)
    ends = fb.GROUND.point((0, 0, 0)), beam.start
    stiff, calm = np.array([400.0, 300.0, 500.0, 6.0, 5.0, 7.0]), np.array([0.02, 0.03, 0.04])
    # damping of turns by M is that of the law where they are small
    parameters = np.concatenate((stiff[:3], PULL, np.zeros(3), stiff[3:], calm))
    found = []
    for link in (fb.Bushing(*ends, stiffness=stiff, damping=np.concatenate((PULL, calm))),
                 fb.ForceElement(*ends, law=mount, parameters=parameters)):
        model = fb.compile_scene(fb.Scene(beam, link, gravity=(0, 0, -weight)), planar=False)
        rest = fb.solve_static(model)
        found.append((rest, None if weight else fb.modes(model, state=rest.state, n=5, damped=True)))
    (built, of_built), (own, of_own) = found
    assert np.max(np.abs(own.phi[-1] - built.phi[-1])) < 1e-10
    if weight:
        assert np.ptp(own.phi[-1, :, 2]) > 0.1
    else:
        np.testing.assert_allclose(of_own.frequencies, of_built.frequencies, rtol=1e-7)
        np.testing.assert_allclose(of_own.damping_ratios, of_built.damping_ratios, rtol=1e-6)
        assert np.max(of_own.damping_ratios) > 0.01


def hard(t, position, rotation, velocity, spin, parameters, force, moment):
    """A polynomial of the first coordinate."""
    x = position[0]
    force[0] = parameters[3] - parameters[0] * x - parameters[1] * x * x - parameters[2] * x**3


def guided(*parameters: float) -> fb.Scene:
    guide, push = fb.PrismaticJoint(fb.GROUND, BLOCK, "guide", axis=(1, 0, 0)), fb.Load("push", BLOCK, force=(1.0, 0, 0))
    return fb.Scene(BLOCK, guide, push, fb.ForceElement(fb.GROUND.point((0, 0, 0)), BLOCK.center, "soft", law=hard,
                                                        parameters=parameters))


def on_a_guide(*parameters: float) -> fb.Model:
    return fb.compile_scene(guided(*parameters), planar=False)


def test_it_acts_in_full_at_every_load_factor() -> None:
    """Rows of an equilibrium, and its mode: F + 0.5 = 100 x + 20 x^3."""
    model = on_a_guide(100.0, 0.0, 20.0, 0.5)
    rest = fb.solve_static(model, load_step=0.25, points={"block": BLOCK})
    x = rest.point("block")[1:, 0]
    assert len(x) >= 3
    np.testing.assert_allclose(100.0 * x + 20.0 * x**3 - 0.5, rest.t[1:], rtol=0, atol=1e-11)
    found = fb.modes(model, state=rest.state, n=1)
    np.testing.assert_allclose(found.frequencies[0], np.sqrt((100.0 + 60.0 * x[-1]**2) / 2.0) / (2.0 * np.pi), rtol=1e-8)


def test_a_path_goes_through_the_limit_points_of_a_law() -> None:
    """F = 10 x - 30 x^2 + 20 x^3, with limit points at F = +-10/sqrt(108)."""
    model = on_a_guide(10.0, -30.0, 20.0, 0.0)
    path = fb.solve_path(model, to=1.2, step=0.2, largest_step=0.4, points={"block": BLOCK})
    x = path.point("block")[:, 0]
    np.testing.assert_allclose(10.0 * x - 30.0 * x**2 + 20.0 * x**3, path.series["load_factor"], rtol=0, atol=1e-11)
    limits = [e["load_factor"] for e in path.info["critical_points"]]
    np.testing.assert_allclose(limits, np.array([1.0, -1.0]) * 10.0 / np.sqrt(108.0), rtol=1e-10)
    with pytest.raises(fb.SceneError, match="force between two times of at_time= is not determined"):
        fb.solve_path(model, at_time=(0.0, 1.0))


def test_what_does_not_know_force_elements_says_so() -> None:
    model = on_a_guide(100.0, 0.0, 20.0, 0.0)
    for call, says in ((lambda: fb.sensitivity(lambda k: guided(k, 0.0, 20.0, 0.0), {"k": 100.0}),
                        "derivatives do not support force element 'soft'"),
                       (lambda: fb.adjoint_run(model, t_end=0.1, step=0.01), "force element"),
                       (lambda: fb.solve_static(model, steady=fb.Spin(1.0)), "steady motions do not support .*'soft'")):
        with pytest.raises(fb.SceneError, match=says):
            call()


def test_laws_that_cannot_be_are_refused() -> None:
    with pytest.raises(fb.SceneError, match="law= is missing"):
        fb.ForceElement(ARM, LEG)
    with pytest.raises(fb.SceneError, match="has no rotation"):
        fb.ForceElement(ARM, fb.PointMass("ball", mass=0.5, position=(0.5, 1.0, 0.3)), law=mount)

    def wrong(t, position, rotation, velocity, spin, parameters, force, moment):
        force[0] = np.nan
    with pytest.raises(fb.SceneError, match="finite numbers"):
        fb.compile_scene(fb.Scene(ARM, LEG, fb.ForceElement(ARM, LEG, law=wrong)))
