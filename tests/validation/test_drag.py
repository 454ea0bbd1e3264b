"""Drag in still and moving air against exact answers, and the energy that it takes."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb

Array = np.ndarray
SOFT = fb.Section(EA=2e5, GA2=8e4, GA3=8e4, GJ=16.0, EI2=20.0, EI3=20.0, rhoA=1.0, rhoI2=1e-4, rhoI3=1e-4)
G = 9.81
ROUND_OFF = 1e-12
ROPE = fb.Section.circle(radius=0.01, E=1e7, rho=1000.0)


def rope(**options: Any) -> fb.Beam:
    return fb.Beam.straight("rope", (0, 0, 0), (2, 0, 0), section=ROPE, elements=5, degree=3, **options)


def extrapolated(values: list[float]) -> float:
    """From steps h, h/2, h/4 of a method of second order that is symmetric in time."""
    first = [b + (b - a) / 3.0 for a, b in zip(values, values[1:])]
    return first[1] + (first[1] - first[0]) / 15.0


@pytest.mark.parametrize(("what", "planar"), [("mass", "auto"), ("rope", "auto"), ("rope", False)])
def test_what_falls_has_the_exact_velocity(what: str, planar: bool | str) -> None:
    """v = v_inf tanh(g t/v_inf), v_inf^2 = m g/k; a rope that lies across the fall stays straight."""
    k, m = 0.3, ROPE.rhoA if what == "rope" else 0.5
    limit = np.sqrt(m * G / k)
    part = rope() if what == "rope" else fb.PointMass("mass", mass=m, position=(0, 0, 0))
    model = fb.compile_scene(fb.Scene(part, fb.Drag("air", part, normal=k, tangential=k if what == "rope" else 0.0),
                                      gravity=(0, 0, -G)), planar=planar)
    found = []
    for steps in (50, 100, 200):
        run = fb.simulate(model, t_end=0.5, step=0.5 / steps, progress=False)
        found.append(float(run.state.v.reshape(-1, 12)[0, 2]))
        assert run.drift("balance") < ROUND_OFF and "lin_mom" not in run.info["conserved"]
        assert np.all(np.diff(run.series["losses"][:, 0]) > 0.0)
    exact = -limit * np.tanh(G * 0.5 / limit)
    errors = np.abs(np.array(found) - exact)
    assert np.all(np.log2(errors[:-1] / errors[1:]) > 1.9) and abs(extrapolated(found) - exact) < 1e-6 * abs(exact)


def test_along_a_rope_the_tangential_coefficient_counts_and_a_linear_one_in_all_directions() -> None:
    """v' = -k v^2/m, and v' = -c v/m."""
    for direction, coefficients in (((1, 0, 0), {"tangential": 0.2}), ((0.6, 0, 0.8), {"linear": 2.0 * ROPE.rhoA})):
        beam = rope()
        model = fb.compile_scene(fb.Scene(beam, fb.Drag("air", beam, **coefficients),
                                          fb.RigidMotion(velocity=3.0 * np.array(direction))))
        found = []
        for steps in (50, 100, 200):
            run = fb.simulate(model, t_end=0.5, step=0.5 / steps, progress=False)
            assert run.drift("balance") < ROUND_OFF
            found.append(float(run.state.v.reshape(-1, 12)[0, :3] @ direction))
        exact = 3.0 * np.exp(-1.0) if "linear" in coefficients else 3.0 / (1.0 + 0.5 * 0.2 * 3.0 / ROPE.rhoA)
        assert abs(extrapolated(found) - exact) < 1e-6 * exact


def in_the_wind(planar: bool | str, air: Any = (4.0, 0.0, 1.0), support: Any = fb.Pin, **options: Any) -> fb.Model:
    """A hanging rope with a ball at its end in a wind, from a horizontal start."""
    beam = rope()
    ball = fb.RigidBody("ball", mass=0.05, inertia=(1e-4, 1e-4, 1e-4), position=(2, 0, 0))
    return fb.compile_scene(fb.Scene(
        beam, ball, fb.RigidConnection(beam.end, ball), support(beam.start), gravity=(0, 0, -G),
        *(fb.Drag(f"wind on {x.name}", x, normal=0.05, linear=0.01, air=air, **options) for x in (beam, ball))), planar=planar)


def test_a_plane_gives_the_numbers_of_space_and_books_close_in_moving_air() -> None:
    flat, space = (fb.simulate(in_the_wind(planar), t_end=0.5, step=0.005, progress=False) for planar in (True, False))
    assert flat.drift("balance") < ROUND_OFF and space.drift("balance") < ROUND_OFF
    np.testing.assert_allclose(flat.state.q, space.state.q, rtol=0, atol=1e-11)
    np.testing.assert_allclose(flat.series["losses"], space.series["losses"], rtol=1e-9, atol=1e-13)
    assert flat.names["losses"] == ["drag 'wind on rope' on beam 'rope'", "drag 'wind on ball' on body 'ball'"]
    assert flat.info["iterations"] < 5 * flat.info["steps"]


@pytest.mark.slow
@pytest.mark.parametrize("planar", ["auto", False])
def test_a_factor_of_the_wind_is_that_wind(planar: bool | str) -> None:
    """To the last bit, in reactions too."""
    half, plain = (fb.simulate(model, t_end=0.1, step=0.005, observe=("energy", "reaction"), progress=False) for model in (
        in_the_wind(planar, time=lambda t: 0.5), in_the_wind(planar, (2.0, 0.0, 0.5))))
    assert np.array_equal(half.state.q, plain.state.q) and np.array_equal(half.series["reaction"], plain.series["reaction"])
    assert half.drift("balance") < ROUND_OFF


def test_a_wind_carries_a_mass_along_and_gives_the_energy() -> None:
    """Relative to the air w' = -c w/m."""
    mass = fb.PointMass("leaf", mass=0.5, position=(0, 0, 0))
    model = fb.compile_scene(fb.Scene(mass, fb.Drag("wind", mass, linear=1.0, air=(0, 3, 0))))
    run = fb.simulate(model, t_end=5.0, step=0.01, progress=False)
    assert run.drift("balance") < ROUND_OFF
    np.testing.assert_allclose(run.state.v[:3], (0.0, 3.0 * (1.0 - np.exp(-10.0)), 0.0), rtol=0, atol=1e-5)
    assert abs(run.series["losses"][-1, 0] + run.series["kinetic"][-1]) < 1e-12


@pytest.mark.parametrize("order", [2, 4])
def test_gusts_have_the_order_of_the_step_and_are_in_the_books(order: int) -> None:
    """m v' = c (3 (1 + sin(4 t)) - v)."""
    c, m, w, t = 1.0, 0.5, 4.0, 1.0
    mass = fb.PointMass("leaf", mass=m, position=(0, 0, 0))
    model = fb.compile_scene(fb.Scene(mass, fb.Drag("wind", mass, linear=c, air=(0, 3, 0), time=lambda t: 1.0 + np.sin(w * t))))
    r = c / m
    exact = 3.0 * (1.0 - np.exp(-r * t)) + 3.0 * r * (r * np.sin(w * t) - w * np.cos(w * t) + w * np.exp(-r * t)) / (r**2 + w**2)
    errors = []
    for n in (20, 40, 80):
        run = fb.simulate(model, t_end=t, step=t / n, order=order, progress=False)
        assert run.drift("balance") < ROUND_OFF
        errors.append(abs(run.state.v[1] - exact))
    found = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all(np.abs(found - order) < 0.15), found
    # another run of the model does not remember the air of this one
    again = fb.simulate(model, t_end=t, step=t / 80, order=order, progress=False)
    assert np.array_equal(again.state.v, run.state.v)
    half = fb.simulate(model, t_end=0.5, step=0.0125, progress=False)
    rest, whole = (fb.simulate(model, t_end=1.0, step=0.0125, progress=False, **x) for x in ({"start": half.checkpoint}, {}))
    assert np.array_equal(rest.state.v, whole.state.v)


def test_a_run_goes_on_from_a_checkpoint_bit_for_bit() -> None:
    model = in_the_wind(True)
    whole = fb.simulate(model, t_end=0.2, step=0.005, every=10, progress=False)
    half = fb.simulate(model, t_end=0.1, step=0.005, every=10, progress=False)
    rest = fb.simulate(model, t_end=0.2, step=0.005, every=10, start=half.checkpoint, progress=False)
    assert all(np.array_equal(a, b) for a, b in zip(whole.state, rest.state))


def test_what_drag_does_not_go_together_with_is_refused() -> None:
    model = in_the_wind(True)
    with pytest.raises(fb.SceneError, match="does not support drag"):
        fb.simulate(model, t_end=0.1, step=0.01, progress=False, method="midpoint")
    with pytest.raises(fb.SceneError, match="planar|plane"):
        beam = rope()
        fb.compile_scene(fb.Scene(beam, fb.Drag("air", beam, normal=1.0, air=(0, 1, 0)), fb.Clamp(beam.start),
                                  gravity=(0, 0, -G)), planar=True)
    ball = fb.PointMass("ball", mass=1.0, position=(0, 0, 0))
    refused = ((lambda: fb.Drag("air", ball, tangential=1.0), "no direction"), (lambda: fb.Drag("air", ball), "give normal"),
               (lambda: fb.Drag("air", ball, normal=1.0, time=lambda t: t), "time is a factor of air"),
               (lambda: fb.Drag("air", beam.end, normal=1.0), "beam 'rope' itself"))
    for make, says in refused:
        with pytest.raises(fb.SceneError, match=says):
            make()


# --- at rest ----------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("planar", [True, False])
def test_a_stiff_rod_at_rest_in_a_wind_has_the_force_of_its_inclination(planar: bool) -> None:
    way, length = np.array([0.6, 0.0, 0.8]), 2.0
    stiff = fb.Section(EA=1e9, GA2=1e9, GA3=1e9, GJ=1e8, EI2=1e8, EI3=1e8, rhoA=1.0, rhoI2=1e-4, rhoI3=1e-4)
    rod = fb.Beam.straight("rod", (0, 0, 0), length * way, d2=(0, 1, 0), section=stiff, elements=2, degree=2)
    ball = fb.RigidBody("ball", mass=0.05, inertia=(1e-4, 1e-4, 1e-4), position=length * way)
    air, (n, t, c) = np.array([9.0, 0.0, 2.0]), (0.3, 0.05, 0.4)
    winds = (fb.Drag("on rod", rod, normal=n, tangential=t, linear=c, air=air, time=lambda t: 2.0 * t),
             fb.Drag("on ball", ball, normal=n, linear=c, air=air))
    model = fb.compile_scene(fb.Scene(rod, ball, fb.Clamp(rod.start), fb.RigidConnection(rod.end, ball), *winds), planar=planar)
    with pytest.raises(fb.SceneError, match="give the time with at_time"):
        fb.solve_static(model)
    rest = fb.solve_static(model, at_time=0.5, levels=(0.5,), observe=("reaction", "section"), points={"root": rod.start})
    along = air @ way * way
    across = air - along
    on_ball = (n * np.linalg.norm(air) + c) * air
    on_rod = length * (n * np.linalg.norm(across) * across + t * np.linalg.norm(along) * along + c * air)
    arm = length * way
    moment = np.cross(0.5 * arm, on_rod) + np.cross(arm, on_ball)
    found = rest.reaction(list(rest.names["reactions"])[0])
    # it bends by 1e-6, of 56 N
    np.testing.assert_allclose(found["force"][-1], -(on_rod + on_ball), rtol=0, atol=3e-4)
    np.testing.assert_allclose(found["moment"][-1], -moment, rtol=0, atol=3e-4)
    half = found["force"][np.flatnonzero(rest.t == 0.5)[0]]
    np.testing.assert_allclose(half, -0.5 * (on_rod + on_ball), rtol=0, atol=3e-4)
    np.testing.assert_allclose(rest.section("root")["force"][-1], on_rod + on_ball, rtol=0, atol=3e-4)


def test_a_rope_rests_in_a_wind_where_statics_paths_and_relax_find_it() -> None:
    model = in_the_wind(planar=True, support=fb.Clamp)
    rests = [fb.solve_static(model), fb.relax(model), fb.solve_path(model, largest_step=1.0, step=0.3)]
    for other in rests[1:]:
        np.testing.assert_allclose(other.state.q, rests[0].state.q, rtol=0, atol=1e-10)
    # of the time loop, whose drag is not that of statics
    still = fb.simulate(model, t_end=0.5, step=0.005, start=rests[0].state, progress=False)
    assert np.max(np.abs(still.state.q - rests[0].state.q)) < 1e-9 and abs(rests[0].phi[-1, -1, 0]) > 0.1


def test_a_weight_on_a_thread_hangs_askew_in_a_wind() -> None:
    """tan(angle) = k u^2/(m g), of a mass without direction."""
    found = []
    for planar in (True, False):
        mass = fb.PointMass("mass", mass=2.0, position=(0, 0, -1.0))
        scene = fb.Scene(mass, fb.DistanceJoint(fb.GROUND.point((0, 0, 0)), mass), gravity=(0, 0, -G),
                         *[fb.Drag("wind", mass, normal=0.2, air=(6.0, 0, 0))])
        found.append(fb.relax(fb.compile_scene(scene, planar=planar)).phi[-1, 0])
    angle = np.arctan(0.2 * 36.0 / (2.0 * G))
    np.testing.assert_allclose(found, [(np.sin(angle), 0.0, -np.cos(angle))] * 2, rtol=0, atol=1e-9)


def test_equilibria_in_a_wind_have_derivatives() -> None:
    def build(c: float, speed: float) -> Any:
        rod = fb.Beam.straight("rod", (0, 0, 0), (0.6, 0, 0.8), d2=(0, 1, 0), section=SOFT, elements=2, degree=3)
        wind = fb.Drag("wind", rod, normal=c, tangential=0.05, linear=0.4, air=(speed, 0, 2.0))
        return fb.Scene(rod, fb.Clamp(rod.start), wind, gravity=(0, 0, -G)), {"tip": rod.end}

    def tip(**values: float) -> Any:
        scene, points = build(**values)
        return fb.solve_static(fb.compile_scene(scene), points=points)

    at = {"c": 0.3, "speed": 9.0}
    slopes = fb.sensitivity(build, at, state=tip(**at).state)
    for name, size in (("c", 1e-4), ("speed", 3e-3)):
        ends = [tip(**{**at, name: at[name] + sign * size}).point("tip")[-1] for sign in (1.0, -1.0)]
        np.testing.assert_allclose(slopes.point("tip")[name], (ends[0] - ends[1]) / (2.0 * size), rtol=0, atol=1e-6)
    with pytest.raises(fb.SceneError, match="moments or moving air make"):
        slopes.frequencies()
