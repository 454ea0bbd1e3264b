"""Loads that turn with what they act on: cantilevers and rings against exact answers, books that close (theory.md (4.30))."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb

EA, GA, EI, LENGTH = 2.0e5, 8.0e4, 20.0, 1.0
SECTION = fb.Section(EA=EA, GA2=GA, GA3=GA, GJ=16.0, EI2=EI, EI3=EI, rhoA=1.0, rhoI2=1e-4, rhoI3=1e-4)


def cantilever(force: float, elements: int = 8, **more: Any) -> tuple[Any, Any]:
    rod = fb.Beam.straight("rod", (0, 0, 0), (LENGTH, 0, 0), d2=(0, 1, 0), section=SECTION, elements=elements, degree=3)
    push = fb.Load("push", rod.end, force=(0.0, force, 0.0), follower=True, **more)
    return fb.compile_scene(fb.Scene(rod, fb.Clamp(rod.start), push)), rod


def exact_tip(force: float) -> np.ndarray:
    """Tip and its angle of the rod with stretch and shear, a force along d2 of the tip: the equations of one end to the other."""
    from scipy.integrate import solve_ivp
    from scipy.optimize import brentq

    def shape(end: float) -> Any:
        way = np.array([-np.sin(end), np.cos(end)]) * force

        def rates(s: float, y: Any) -> Any:
            d1, d2 = np.array([np.cos(y[2]), np.sin(y[2])]), np.array([-np.sin(y[2]), np.cos(y[2])])
            r = (1.0 + way @ d1 / EA) * d1 + way @ d2 / GA * d2
            # M' = -(r' x n)
            return [*r, y[3] / EI, -(r[0] * way[1] - r[1] * way[0])]

        def moment(start: float) -> Any:
            return solve_ivp(rates, (0.0, LENGTH), [0.0, 0.0, 0.0, start], rtol=1e-12, atol=1e-12).y[:, -1]

        return moment(brentq(lambda m: moment(m)[3], -20.0 * force - 1.0, 20.0 * force + 1.0, xtol=1e-13))

    end = brentq(lambda angle: shape(angle)[2] - angle, 0.0, 3.0, xtol=1e-13)
    return shape(end)[:3]


def test_the_equilibrium_of_a_cantilever_whose_end_force_follows() -> None:
    model, rod = cantilever(60.0)
    result = fb.solve_static(model, observe=("energy",), points={"tip": rod.end})
    tip = result.point("tip")[-1]
    exact = exact_tip(60.0)
    # well beyond what a dead force does
    assert exact[2] > 1.3
    assert np.linalg.norm(tip[:2] - exact[:2]) < 2e-6 and abs(tip[2]) < 1e-12


@pytest.mark.slow
def test_a_cantilever_comes_to_rest_where_newtons_method_finds_it() -> None:
    # a scene without dead loads, which relax() once could not read
    model, _ = cantilever(5.0, elements=3)
    rest = fb.relax(model)
    assert rest.info["finished"]
    assert np.max(np.abs(rest.state.q - fb.solve_static(model).state.q)) < 1e-12


@pytest.mark.slow
def test_the_work_of_a_force_that_follows_is_in_the_books() -> None:
    model, rod = cantilever(20.0, elements=4, time=lambda t: np.sin(3.0 * t)**2)
    result = fb.simulate(model, t_end=1.0, step=2e-3, progress=False, observe=("energy", "momentum"), points={"tip": rod.end})
    assert abs(result.drift("balance")) < 1e-11 and np.max(np.abs(result.balance()["loads"])) > 0.1
    assert np.max(np.abs(result.point("tip")[:, 1])) > 0.05


def test_a_ring_under_pressure_has_its_hoop_force() -> None:
    radius, pressure = 2.0, 3000.0
    quarter = fb.Beam.arc("quarter", (radius, 0, 0), (0, 1, 0), (-1, 0, 0), radius=radius, angle=np.pi / 2.0, section=SECTION,
                          elements=8, degree=3)
    # d2 points to the centre
    load = fb.DistributedLoad("pressure", quarter, force=(0.0, -pressure, 0.0), follower=True)
    ends = fb.Clamp(quarter.start, axes="yz"), fb.Clamp(quarter.end, axes="xz")
    found = fb.solve_static(fb.compile_scene(fb.Scene(quarter, load, *ends)), observe=("energy",))
    wide = radius * (1.0 + pressure * radius / EA)
    assert np.max(np.abs(np.linalg.norm(found.phi[-1], axis=1) - wide)) < 1e-5 * (wide - radius)
    assert abs(found.series["strain"][-1] / (0.25 * np.pi * radius * (pressure * radius)**2 / EA) - 1.0) < 1e-6


def test_what_cannot_follow_is_refused() -> None:
    bead = fb.PointMass("bead", mass=1.0, position=(0, 0, 0))
    with pytest.raises(fb.SceneError, match="no directors that turn"):
        fb.Load("push", bead, force=(1, 0, 0), follower=True)
    rod = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=SECTION, elements=2, degree=2)
    with pytest.raises(fb.SceneError, match="must be 3 numbers"):
        fb.DistributedLoad("wind", rod, force=lambda s: np.zeros((len(s), 3)), follower=True)
    with pytest.raises(fb.SceneError, match="does not support follower load 'push'"):
        fb.simulate(cantilever(1.0)[0], t_end=1.0, step=0.1, method="midpoint")
    with pytest.raises(fb.SceneError, match="numba cannot compile"):
        cantilever(1.0, time=np.polynomial.Polynomial((0.0, 1.0)))


def test_the_factor_of_a_load_that_follows_may_be_a_table() -> None:
    table = fb.Signal([0.0, 0.5, 1.0], [0.0, 0.5, 2.0])
    tips = []
    for time in (table, lambda t: t if t < 0.5 else 3.0 * t - 1.0):
        model, rod = cantilever(30.0, elements=4, time=time)
        tips.append(fb.solve_static(model, at_time=0.75, points={"tip": rod.end}).point("tip")[-1])
    assert np.max(np.abs(tips[0] - tips[1])) < 1e-12
    # 1.25 x 30 N
    assert np.linalg.norm(tips[0][:2] - exact_tip(37.5)[:2]) < 1e-4
    model, rod = cantilever(30.0, elements=4, time=fb.Signal([0.0, 0.02], [0.0, 1.0], rest=False))
    with pytest.raises(fb.ConvergenceError, match="'push': its time function fails, SceneError: Signal: t = 0.021 s lies"):
        fb.simulate(model, t_end=0.04, step=2e-3, progress=False)


@pytest.mark.parametrize("order", [2, 4])
def test_a_load_that_follows_in_a_plane_is_the_one_in_space(order: int) -> None:
    """A swinging plate on a rod, thrust on its edge and a moment that turn along, pressure along the rod that grows in time."""
    rod = fb.Beam.straight("rod", (0, 0, 0), (0.6, 0, 0.8), d2=(0, 1, 0), section=SECTION, elements=3, degree=3)
    plate = fb.RigidBody("plate", mass=0.3, inertia=(0.02, 0.03, 0.04), position=(0.9, 0, 0.8))
    thrust = fb.Load("thrust", plate.point((0.1, 0, 0.2)), force=(3.0, 0.0, -8.0), moment=(0, 0.5, 0), follower=True)
    wind = fb.DistributedLoad("wind", rod, force=(0.0, 0.0, 4.0), follower=True, time=lambda t: 1.0 + t * t)
    scene = fb.Scene(rod, plate, fb.Clamp(rod.start), fb.RigidConnection(rod.end, plate), thrust, wind, gravity=(0, 0, -9.81))
    runs = [fb.simulate(fb.compile_scene(scene, planar=planar), t_end=0.2, step=2e-3, order=order, progress=False,
                        observe=("energy",)) for planar in (True, False)]
    assert runs[0].state.q == pytest.approx(runs[1].state.q, abs=1e-9)
    assert np.max(np.abs(runs[1].phi[-1] - runs[1].phi[0])) > 0.01
    assert abs(runs[0].drift("balance")) < 1e-11 and np.max(np.abs(runs[0].balance()["loads"])) > 0.1
    rests = [fb.solve_static(fb.compile_scene(scene, planar=planar), at_time=0.5) for planar in (True, False)]
    assert rests[0].state.q == pytest.approx(rests[1].state.q, abs=1e-10)
    assert rests[0].info["unstable_directions"] == rests[1].info["unstable_directions"] == 0
    kept = [fb.modes(fb.compile_scene(scene, planar=True), state=rests[0].state, at_time=0.5, n=3, planar=True).angular,
            fb.modes(fb.compile_scene(scene, planar=False), state=rests[1].state, at_time=0.5, n=12).angular]
    assert all(np.min(np.abs(kept[1] / x - 1.0)) < 1e-8 for x in kept[0])


def test_a_load_that_follows_out_of_a_plane_is_no_load_of_the_plane() -> None:
    rod = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), d2=(0, 1, 0), section=SECTION, elements=2, degree=2)
    flat = fb.Load("flat", rod.end, force=(0, 1.0, 0), follower=True)
    across = fb.Load("across", rod.end, moment=(0, 1.0, 0), follower=True)
    assert fb.compile_scene(fb.Scene(rod, fb.Clamp(rod.start), flat)).plane is not None
    with pytest.raises(fb.SceneError, match="does not stay in a plane: the load on"):
        fb.compile_scene(fb.Scene(rod, fb.Clamp(rod.start), flat, across), planar=True)
