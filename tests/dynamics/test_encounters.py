"""Locks, releases and one-sided contact of sliders: restarts, step control, orders, what is refused and what events say."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from restarts import assert_goes_on

import fastbeam as fb
from fastbeam.kernels.loop import OK
from fastbeam.stepping.stepper import Stepper

RAIL = fb.Section.circle(radius=0.05, E=200e9, rho=7800.0)
SOFT = fb.Section.circle(radius=0.01, E=1e8, rho=1000.0)
BEAM = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0.2), section=SOFT, elements=4)
MASS = fb.PointMass("point", mass=0.2)


def slider(**forces: Any) -> fb.Slider:
    return fb.Slider("s", MASS, BEAM, at=0.4, **forces)


def flying(planar: Any, **forces: Any) -> fb.Model:
    """A mass on a free beam in motion."""
    out = 0.0 if planar == "auto" else 1.0
    spin = fb.InitialVelocity(BEAM, velocity=lambda s: np.stack((0.0 * s, out * np.cos(3 * s), np.sin(3 * s)), axis=1))
    return fb.compile_scene(fb.Scene(BEAM, MASS, spin, slider(rate=2.0, **forces)), planar=planar)


def bouncing(restitution: float) -> fb.Model:
    """A ball above a stiff clamped beam."""
    beam = fb.Beam.straight("rail", (0, 0, 0), (4, 0, 0), section=RAIL, elements=4)
    ball = fb.PointMass("ball", mass=0.5, position=(1, 0, 0.02), velocity=(1, 0, 0))
    side = fb.OneSided((0, 0, 1), restitution=restitution)
    return fb.compile_scene(fb.Scene(beam, ball, fb.Slider("s", ball, beam, at=1.0, one_sided=side, friction=0.2),
                                     *[fb.Clamp(beam.node(i)) for i in range(beam.n_nodes)], gravity=(0, 0, -9.81)))


LOCKS = [fb.Lock(0.0133, until=0.0406), fb.Lock(lambda t, s, rate: 0.5 - s if rate < 0 else s - 0.5)]
SCENES = {"plane": lambda: flying("auto", lock=LOCKS, friction=0.05), "space": lambda: flying(False, lock=LOCKS),
          "released": lambda: flying("auto", release=fb.Release(lambda t, s, rate: s - 0.5)), "bouncing": lambda: bouncing(0.6),
          "landing": lambda: bouncing(0.0)}
KINDS = ("locked", "unlocked", "released", "impact", "landed", "lifted")


@pytest.mark.parametrize("tolerance", [None, 1e-5])
@pytest.mark.parametrize("name", SCENES)
def test_a_run_goes_on_bit_for_bit_from_every_row_around_an_event(name: str, tolerance: float | None, tmp_path: Any) -> None:
    model = SCENES[name]()
    settings: dict[str, Any] = dict(t_end=0.15, step=2e-3, every=1, tolerance=tolerance, progress=False)
    whole = fb.simulate(model, **settings)
    times = [x["time"] for x in whole.events if x["kind"] in KINDS]
    # round-off, 1e-13 a row, adds up as a random walk: with step control there are ten times the rows, and from starts that are
    # shifted by millimetres the drift is 2e-13 to 1.6e-12
    assert len(times) > 0 and whole.drift("balance") < 1e-12 * max(1.0, (len(whole.t) / 78) ** 0.5)
    near = {int(np.argmin(np.abs(whole.t - t))) + k for t in times[:3] for k in (-2, -1, 0, 1)}
    for n in sorted(near & set(range(1, len(whole.t) - 1))):
        part, rest = assert_goes_on(model, whole, n, tmp_path / "c", settings)
        assert [x["time"] for x in part.events + rest.events if x["kind"] in KINDS] == times


@pytest.mark.parametrize("end, forces", [
    (BEAM.length, {"release": fb.Release("end")}), (0.8, {"lock": fb.Lock("end"), "stops": fb.Stops(end=0.8)})],
    ids=["released", "locked"])
def test_a_slider_that_is_held_at_an_end_is_not_stopped_there_again(end: float, forces: dict[str, Any]) -> None:
    model = flying(False, **forces)
    result = fb.simulate(model, t_end=0.35, step=2e-3, progress=False)
    held = [x for x in result.events if x["kind"] in ("released", "locked")]
    assert len(held) == 1 and held[0]["time"] < 0.3 and result.t[-1] == 0.35
    # round-off of a step can leave it behind the end, here by much more
    state = result.state._replace(s=np.array([end + 1e-10]))
    stepper = Stepper(model, np.ones(1), state)
    assert stepper.advance(0.0, 2e-3, 5).status == OK and abs(stepper.state.s[0] - state.s[0]) < 1e-14


def test_rows_do_not_change_what_happens() -> None:
    results = [fb.simulate(flying("auto", lock=LOCKS), t_end=0.15, step=2e-3, every=every, progress=False)
               for every in (1, 7, 1000)]
    for result in results[1:]:
        assert all(np.array_equal(x, y) for x, y in zip(result.state, results[0].state))


@pytest.mark.parametrize("model", [bouncing(1.0), flying("auto", lock=fb.Lock(1.0)), flying("auto", release=fb.Release(1.0))])
def test_events_have_no_order_four(model: fb.Model) -> None:
    with pytest.raises(fb.SceneError, match="order=4"):
        fb.simulate(model, t_end=0.1, step=1e-3, order=4)
    with pytest.raises(fb.SceneError, match="friction, drives, stops, locks and releases of sliders"):
        fb.simulate(model, t_end=0.1, step=1e-3, method="midpoint")


REFUSED: dict[str, tuple[Any, str]] = {
    "drive": (lambda: slider(drive=fb.Drive(speed=1.0), lock=fb.Lock(1.0)), "prescribes the motion, so it cannot be locked"),
    "rate": (lambda: slider(rate=1.0, lock=fb.Lock(until=1.0)), "locked from the start; leave rate out"),
    "order of locks": (lambda: slider(lock=[fb.Lock(1.0), fb.Lock(2.0)]), "must be the last"),
    "times": (lambda: slider(lock=[fb.Lock(1.0, until=2.0), fb.Lock(1.5)]), "times must increase from lock to lock"),
    "second from start": (lambda: slider(lock=[fb.Lock(until=1.0), fb.Lock()]), "needs a time, a place or a condition"),
    "no stop": (lambda: slider(lock=fb.Lock("stop")), "needs a rigid stop"),
    "elastic stop": (lambda: slider(stops=fb.Stops(end=0.9, stiffness=1e3), lock=fb.Lock("stop")), "needs a rigid stop"),
    "other stop": (lambda: slider(stops=fb.Stops(end=0.9), lock=fb.Lock("start")), "needs a rigid stop"),
    "place": (lambda: slider(lock=fb.Lock(at=3.0)), "lies beyond its beam"),
    "both": (lambda: fb.Lock(1.0, at=2.0), "give when= or at="),
    "until": (lambda: fb.Lock(1.0, until=0.5), "must lie after"),
    "function": (lambda: fb.Lock(lambda t: t), "three arguments"),
    "texts": (lambda: fb.Release(lambda t, s, rate: "now"), "finite number, or True or False"),
    "stop before the end": (lambda: slider(stops=fb.Stops(end=0.9), release=fb.Release("end")), "of its beam lies behind a rigid "
                                                                                                "stop"),
    "sleeve": (lambda: fb.Sleeve("s", fb.RigidBody("b", mass=1.0, inertia=(1, 1, 1), position=(0, 0, 0)), BEAM, at=0.0,
                                 release=fb.Release(1.0)), "a sleeve cannot leave"),
    "side": (lambda: slider(one_sided=(0, 0, 0)), "must be a direction"),
    "one-sided release": (lambda: slider(one_sided=(0, 0, 1), release=fb.Release(1.0)), "cannot be combined with release"),
    "one-sided drive": (lambda: slider(one_sided=(0, 0, 1), drive=fb.Drive(position=lambda t: 0.4 + t)), "cannot land at another "
                                                                                                         "place"),
    "one-sided lock": (lambda: fb.Slider("s", fb.PointMass("high", mass=1.0, position=(0.4, 0, 1)), BEAM, at=0.4,
                                         one_sided=(0, 0, 1), lock=fb.Lock()), "locked from the start")}


@pytest.mark.parametrize("name", REFUSED)
def test_what_contradicts_is_refused(name: str) -> None:
    make, text = REFUSED[name]
    with pytest.raises(fb.SceneError, match=text):
        make()


def test_a_condition_that_fails_on_the_way_is_named() -> None:
    model = flying("auto", lock=fb.Lock(lambda t, s, rate: np.nan if t > 0.01 else -1.0))
    with pytest.raises(fb.SceneError, match="slider 's': lock: when must return a finite number, or True or False, but does not "
                                            "at t = 0.01"):
        fb.simulate(model, t_end=0.1, step=2e-3, progress=False)


def test_what_is_due_at_the_start_happens_before_the_first_row() -> None:
    model = flying("auto", lock=fb.Lock(1.0, until=1.02))
    result = fb.simulate(model, t_end=1.04, start=fb.Start(time=1.01), step=2e-3, every=1, progress=False)
    assert [(x["kind"], x["time"]) for x in result.events] == [("locked", 1.01), ("unlocked", 1.02)]
    assert result.slider("s")["lock_loss"][0] > 0.0 and result.drift("balance") < 1e-12


def test_a_point_that_passes_beside_its_beam_flies_on() -> None:
    beam = fb.Beam.straight("rail", (0, 0, 0), (4, 0, 0), section=RAIL, elements=4)
    ball = fb.PointMass("ball", mass=0.5, position=(1, 0.01, 0.02))
    scene = fb.Scene(beam, ball, fb.Slider("s", ball, beam, at=1.0, one_sided=(0, 0, 1)),
                     *[fb.Clamp(beam.node(i)) for i in range(beam.n_nodes)], gravity=(0, 0, -9.81))
    result = fb.simulate(fb.compile_scene(scene), t_end=0.1, step=2e-3, every=1, progress=False)
    ((kind, t),) = [(x["kind"], x["time"]) for x in result.events]
    assert kind == "missed" and abs(t - np.sqrt(0.04 / 9.81)) < 1e-12
    np.testing.assert_allclose(result.series["slider_position"][:, 0, 2], 0.02 - 0.5 * 9.81 * result.t**2, atol=1e-13)


def test_equilibria_hold_what_is_locked_from_the_start() -> None:
    beam = fb.Beam.straight("arm", (0, 0, 0), (1, 0, 0), section=RAIL, elements=4)
    mass = fb.PointMass("m", mass=5.0)

    def model(**forces: Any) -> fb.Model:
        return fb.compile_scene(fb.Scene(beam, mass, fb.Clamp(beam.start), fb.Slider("s", mass, beam, at=0.7, **forces),
                                         gravity=(0, 0, -9.81)))

    locked = model(lock=fb.Lock(until=0.1))
    rest = fb.solve_static(locked)
    assert rest.state.s[0] == 0.7 and rest.slider("s")["gap"][-1] < 1e-12
    result = fb.simulate(locked, start=rest.state, t_end=0.2, step=1e-3, every=1, progress=False)
    z = result.series["slider_position"][:, 0, 2]
    assert np.ptp(z[result.t < 0.1]) < 1e-12 and result.slider("s")["s"][-1] > 0.7 and result.drift("balance") < 1e-12
    with pytest.raises(fb.SceneError, match="a lock or may leave its beam"):
        fb.solve_static(model(lock=fb.Lock(1.0)))


def test_a_point_away_from_its_beam_has_no_equilibrium() -> None:
    with pytest.raises(fb.SceneError, match="begins away from its beam"):
        fb.solve_static(bouncing(0.0), held=True)


def test_sliders_of_a_net_are_locked_and_released_in_both_solvers() -> None:
    points = [(x, y, 0) for x in range(3) for y in range(3)]
    edges = [(0, 1), (1, 2), (3, 4), (4, 5), (6, 7), (7, 8), (0, 3), (3, 6), (1, 4), (4, 7), (2, 5), (5, 8)]
    net = fb.Net("net", points, edges, section=SOFT, clamps=[0, 2, 6, 8], elements=2)
    masses = [fb.PointMass(f"m{i}", mass=0.05) for i in range(4)]
    kinds: list[dict[str, Any]] = [dict(lock=fb.Lock(until=0.011)), dict(release=fb.Release(0.013), rate=1.0),
                                   dict(lock=fb.Lock(at=0.51), rate=1.0), dict(one_sided=(0, 0, 1), rate=0.3)]
    sliders = [fb.Slider(f"s{i}", mass, net.beam(2 * i + 1), at=0.5, **kind) for i, (mass, kind) in enumerate(zip(masses, kinds))]
    scene = fb.Scene(net, *masses, *sliders, gravity=(0, 0, -9.81))
    results = [fb.simulate(fb.compile_scene(scene, solver=solver), t_end=0.03, step=1e-3, every=1, progress=False)
               for solver in ("auto", "sparse")]
    for result in results:
        found = {x["slider"]: x["kind"] for x in result.events if x["kind"] != "missed"}
        assert found["s0"] == "unlocked" and found["s1"] == "released" and found["s2"] == "locked"
        assert result.drift("balance") < 1e-12 and result.info["fallbacks"] == 0
    np.testing.assert_allclose(results[0].state.q, results[1].state.q, rtol=0.0, atol=1e-10)
