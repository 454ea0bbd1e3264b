"""Sliders that are locked and let go, and that leave their beams, against exact answers."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from exchange import balanced

import fastbeam as fb

G = 9.81
RAIL = fb.Section.circle(radius=0.05, E=200e9, rho=7800.0)
# of beams that are held everywhere: the weight of steel would add nothing but its round-off to the balance
HELD = fb.Section.circle(radius=0.05, E=200e9, rho=1.0)


def rail(angle: float, at: float, planar: Any = "auto", mass: float = 0.5, gravity: float = G, **forces: Any) -> fb.Model:
    """A bead on a straight rail of 4 m, all nodes of which are clamped, at this angle (degrees) to the horizontal."""
    a = np.radians(angle)
    beam = fb.Beam.straight("rail", (0, 0, 0), (4 * np.cos(a), 0, 4 * np.sin(a)), section=HELD, elements=4)
    bead = fb.PointMass("bead", mass=mass)
    return fb.compile_scene(fb.Scene(beam, bead, *[fb.Clamp(beam.node(i)) for i in range(beam.n_nodes)],
                                     fb.Slider("s", bead, beam, at=at, **forces), gravity=(0, 0, -gravity)), planar=planar)


def run(model: Any, t_end: float, step: float = 0.01, **settings: Any) -> fb.Result:
    return fb.simulate(model, t_end=t_end, step=step, every=1, progress=False, **settings)


def happened(result: fb.Result) -> list[tuple[str, float]]:
    return [(x["kind"], x["time"]) for x in result.events if x["kind"] in ("locked", "unlocked", "released", "impact")]


@pytest.mark.parametrize("planar", ["auto", False])
def test_a_bead_that_is_caught_loses_its_energy_at_once(planar: Any) -> None:
    result = run(rail(0.0, 1.0, planar, rate=2.0, lock=fb.Lock(0.505, until=0.805)), 1.0)
    bead, event = result.slider("s"), result.events[0]
    assert happened(result) == [("locked", 0.505), ("unlocked", 0.805)]
    assert abs(event["s"] - 2.01) < 1e-13 and abs(event["loss"] - 1.0) < 1e-13
    np.testing.assert_allclose(bead["s"], 1.0 + 2.0 * np.minimum(result.t, 0.505), atol=1e-13)
    np.testing.assert_allclose(bead["lock_loss"], np.where(result.t < 0.505, 0.0, 1.0), atol=1e-14)
    held = (result.t >= 0.505) & (result.t <= 0.805)
    assert np.array_equal(np.unique(bead["s"][held]), [event["s"]]) and balanced(result)


@pytest.mark.parametrize("planar", ["auto", False])
def test_a_mass_that_is_let_go_slides_down_as_it_must(planar: Any) -> None:
    result = run(rail(30.0, 3.0, planar, lock=fb.Lock(until=0.305)), 0.8)
    pull, bead = 0.5 * 0.5 * G, result.slider("s")
    np.testing.assert_allclose(bead["s"], 3.0 - 0.25 * G * np.maximum(result.t - 0.305, 0.0)**2, atol=1e-13)
    np.testing.assert_allclose(bead["lock_force"], np.where(result.t < 0.305, pull, 0.0), atol=1e-9)
    assert happened(result) == [("unlocked", 0.305)] and balanced(result)


CONDITIONS: dict[str, tuple[Any, float]] = {
    # s = 3 - g t^2/4, ds/dt = -g t/2
    "place": (dict(at=2.0), np.sqrt(4.0 / G)), "way": (dict(when=lambda t, s, rate: 2.0 - s), np.sqrt(4.0 / G)),
    "truth": (dict(when=lambda t, s, rate: s <= 2.0), np.sqrt(4.0 / G)),
    "speed": (dict(when=lambda t, s, rate: -rate - 1.7), 3.4 / G),
    "power": (dict(when=lambda t, s, rate: rate**2 * t - 0.3), (1.2 / G**2)**(1.0 / 3.0))}


@pytest.mark.parametrize("tolerance", [None, 1e-6])
@pytest.mark.parametrize("name", CONDITIONS)
def test_a_condition_is_met_to_round_off(name: str, tolerance: float | None) -> None:
    condition, exact = CONDITIONS[name]
    result = run(rail(30.0, 3.0, lock=fb.Lock(**condition)), 1.0, tolerance=tolerance)
    ((kind, t),) = happened(result)
    assert kind == "locked" and abs(t - exact) < 1e-13 and balanced(result)
    assert abs(result.slider("s")["lock_loss"][-1] - 0.5 * 0.5 * (0.5 * G * exact)**2) < 1e-12


def test_a_slider_latches_at_its_stop_and_is_let_go_there() -> None:
    # pressed against the stop, it stays there when it is let go; the lock in between bears what the stop does before
    locks = [fb.Lock(until=0.1), fb.Lock("start", until=1.2)]
    result = run(rail(30.0, 3.0, stops=fb.Stops(1.0, restitution=0.7), lock=locks), 1.5)
    bead, pull = result.slider("s"), 0.5 * 0.5 * G
    assert [kind for kind, _ in happened(result)] == ["unlocked", "locked", "unlocked"]
    meets = happened(result)[1][1]
    assert abs(meets - 0.1 - np.sqrt(8.0 / G)) < 1e-9 and np.all(np.abs(bead["s"][result.t > meets] - 1.0) < 1e-9)
    np.testing.assert_allclose(bead["lock_force"], np.where((result.t < 0.1) | (result.t >= meets) & (result.t < 1.2), pull, 0.0),
                               atol=1e-8)
    np.testing.assert_allclose(bead["stop_force"], np.where(result.t >= 1.2, pull, 0.0), atol=1e-8)
    assert bead["stop_loss"][-1] == 0.0 and balanced(result)


def test_friction_holds_what_a_lock_lets_go() -> None:
    result = run(rail(16.0, 2.0, friction=0.3, lock=fb.Lock(until=0.2)), 0.6)
    bead = result.slider("s")
    assert np.array_equal(np.unique(bead["s"]), [2.0])
    pull = 0.5 * G * np.sin(np.radians(16.0))
    np.testing.assert_allclose(bead["friction_force"], np.where(result.t < 0.2, 0.0, pull), atol=1e-8)
    np.testing.assert_allclose(bead["lock_force"], np.where(result.t < 0.2, pull, 0.0), atol=1e-8)


@pytest.mark.parametrize("planar", ["auto", False])
def test_a_bead_that_leaves_its_rail_flies_on_a_parabola(planar: Any) -> None:
    result = run(rail(30.0, 3.0, planar, release=fb.Release(0.305)), 0.8)
    after = result.t >= 0.305
    t, place = result.t[after] - 0.305, result.series["slider_position"][:, 0]
    along = np.array([np.cos(np.pi / 6), 0.0, 0.5])
    begin, speed = (3.0 - 0.25 * G * 0.305**2) * along, -0.5 * G * 0.305 * along
    exact = begin + t[:, None] * speed - 0.5 * G * t[:, None]**2 * np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(place[after], exact, atol=1e-13)
    bead = result.slider("s")
    assert np.all(np.abs(bead["force"][after]) < 1e-12) and balanced(result)
    np.testing.assert_allclose(bead["gap"][after], np.linalg.norm(exact - begin, axis=1), atol=1e-13)
    assert "gap" not in result.info["conserved"]


def test_a_bead_slides_off_the_end_of_its_rail() -> None:
    result = run(rail(30.0, 3.0, release=fb.Release("start")), 1.5)
    ((kind, t),) = happened(result)
    assert kind == "released" and abs(t - np.sqrt(12.0 / G)) < 1e-9 and result.t[-1] == 1.5 and balanced(result)


# --- on what gives way --------------------------------------------------------------------------------------------------
def telescope(planar: Any, **forces: Any) -> fb.Model:
    """A body that slides along a rigid rod, both free in space."""
    tube = fb.Beam.straight("tube", (0, 0, 0), (1, 0, 0), section=RAIL, elements=2)
    hub = fb.RigidBody("hub", mass=2.0, inertia=(1.0, 1.0, 1.0), position=(0, 0, 0))
    head = fb.RigidBody("head", mass=3.0, inertia=(1.0, 1.0, 1.0), position=(0.25, 0, 0), velocity=(1.5, 0, 0))
    sleeve = fb.Sleeve("s", head, tube, at=0.25, **forces)
    tied = [fb.RigidConnection(hub, tube.node(i)) for i in range(tube.n_nodes)]
    return fb.compile_scene(fb.Scene(tube, hub, head, sleeve, *tied), planar=planar)


@pytest.mark.parametrize("planar", ["auto", False])
def test_a_telescope_that_latches_keeps_its_momentum(planar: Any) -> None:
    model = telescope(planar, stops=fb.Stops(end=0.75), lock=fb.Lock("end"))
    result = run(model, 0.6)
    other = 2.0 + RAIL.rhoA * 1.0
    loss = 0.5 * 1.5**2 * 3.0 * other / (3.0 + other)
    ((kind, t),) = happened(result)
    assert kind == "locked" and abs(t - 1.0 / 3.0) < 1e-9
    assert abs(result.slider("s")["lock_loss"][-1] / loss - 1.0) < 1e-10
    assert result.drift("lin_mom") < 1e-13 and balanced(result)


@pytest.mark.parametrize("planar", ["auto", False])
def test_a_telescope_that_latches_off_its_axis_turns_as_one_body(planar: Any) -> None:
    # the head passes 0.5 m beside the rod with 1.5 m/s: behind the latch both are one rigid body
    tube = fb.Beam.straight("tube", (0, 0, 0), (1, 0, 0), section=RAIL, elements=2)
    hub = fb.RigidBody("hub", mass=2.0, inertia=(1.0, 1.0, 1.0), position=(0, 0, 0))
    head = fb.RigidBody("head", mass=3.0, inertia=(1.0, 1.0, 1.0), position=(0.25, 0, 0.5), velocity=(1.5, 0, 0))
    sleeve = fb.Sleeve("s", head.point((0, 0, -0.5)), tube, at=0.25, lock=fb.Lock(0.1))
    tied = [fb.RigidConnection(hub, tube.node(i)) for i in range(tube.n_nodes)]
    result = run(fb.compile_scene(fb.Scene(tube, hub, head, sleeve, *tied), planar=planar), 0.3)
    m, x, z = np.array([2.0, RAIL.rhoA, 3.0]), np.array([0.0, 0.5, 0.4]), np.array([0.0, 0.0, 0.5])
    x0, z0 = m @ x / m.sum(), m @ z / m.sum()
    inertia = 2.0 + RAIL.rhoA / 12.0 + RAIL.rhoI2 + m @ ((x - x0)**2 + (z - z0)**2)
    spin = 3.0 * 1.5 * (0.5 - z0) / inertia
    loss = 0.5 * 3.0 * 1.5**2 - 0.5 * (3.0 * 1.5)**2 / m.sum() - 0.5 * inertia * spin**2
    assert abs(result.slider("s")["lock_loss"][-1] / loss - 1.0) < 1e-8
    assert result.drift("lin_mom") < 1e-12 and result.drift("ang_mom") < 1e-12 and balanced(result)


def pendulum(planar: Any = "auto", **forces: Any) -> fb.Model:
    """A bead on a rigid rod that swings about its start."""
    rod = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=RAIL, elements=2)
    bead, hub = fb.PointMass("bead", mass=30.0), fb.RigidBody("hub", mass=1.0, inertia=(1.0, 1.0, 1.0), position=(0, 0, 0))
    tied = [fb.RigidConnection(hub, rod.node(i)) for i in range(rod.n_nodes)]
    return fb.compile_scene(fb.Scene(rod, bead, hub, fb.Pin(hub), fb.Slider("s", bead, rod, at=0.5, **forces), *tied,
                                     gravity=(0, 0, -G)), planar=planar)


def test_a_bead_on_a_pendulum_lets_go_and_keeps_energy() -> None:
    places = []
    for step in (4e-3, 2e-3, 1e-3, 5e-4):
        result = run(pendulum(lock=fb.Lock(), release=fb.Release(0.3)), 0.5, step)
        assert balanced(result)
        after = result.t >= 0.3
        t, place = result.t[after] - 0.3, result.series["slider_position"][after, 0]
        # free flight from there on, exactly
        fall = np.array([0.0, 0.0, -0.5 * G])
        speed = (place[-1] - place[0] - fall * t[-1]**2) / t[-1]
        np.testing.assert_allclose(place, place[0] + t[:, None] * speed + fall * t[:, None]**2, atol=1e-12)
        places.append(place[-1])
    errors = [np.linalg.norm(x - places[-1]) for x in places[:-1]]
    assert 3.0 < errors[0] / errors[1] < 6.0


EVENTS: dict[str, dict[str, Any]] = {
    "lock": dict(lock=fb.Lock(lambda t, s, rate: s - 0.6, until=0.55)), "until": dict(lock=fb.Lock(until=0.2)),
    "release": dict(release=fb.Release(0.4)), "off a place": dict(release=fb.Release(lambda t, s, rate: s - 0.6))}


@pytest.mark.parametrize("name", EVENTS)
def test_order_is_two_through_locks_and_releases(name: str) -> None:
    model = pendulum(**EVENTS[name])
    ends = [run(model, 0.8, step).state.q for step in (0.02, 0.01, 0.005, 6.25e-4)]
    errors = [np.max(np.abs(x - ends[-1])) for x in ends[:-1]]
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(rates > 1.7), (rates, errors)


# --- one-sided contact --------------------------------------------------------------------------------------------------
def ball_above(height: float, restitution: float, planar: Any = "auto", angle: float = 0.0, speed: float = 0.0,
               **forces: Any) -> fb.Model:
    """A ball above a stiff clamped beam, at this angle (degrees) to the horizontal."""
    a = np.radians(angle)
    along, normal = np.array([np.cos(a), 0.0, np.sin(a)]), np.array([-np.sin(a), 0.0, np.cos(a)])
    beam = fb.Beam.straight("rail", (0, 0, 0), 4 * along, section=HELD, elements=4)
    ball = fb.PointMass("ball", mass=0.5, position=along + height * normal, velocity=speed * along)
    slider = fb.Slider("s", ball, beam, at=1.0, one_sided=fb.OneSided(normal, restitution=restitution), **forces)
    return fb.compile_scene(fb.Scene(beam, ball, slider, *[fb.Clamp(beam.node(i)) for i in range(beam.n_nodes)],
                                     gravity=(0, 0, -G)), planar=planar)


@pytest.mark.parametrize("planar", ["auto", False])
def test_a_ball_bounces_to_the_height_that_its_restitution_says(planar: Any) -> None:
    for e, times in ((1.0, (1, 3, 5)), (0.5, (1, 2, 2.5))):
        result = run(ball_above(0.2, e, planar, speed=0.3), 1.2)
        fall = np.sqrt(0.4 / G)
        hits = [t for kind, t in happened(result) if kind == "impact"]
        np.testing.assert_allclose(hits[:3], fall * np.array(times), rtol=1e-13)
        ball = result.slider("s")
        np.testing.assert_allclose(ball["s"], 1.0 + 0.3 * result.t, atol=1e-12)
        assert balanced(result)
        # the height of the flight behind the first hit, from the energy at its end
        at = int(np.flatnonzero(result.t == hits[1])[0])
        height = result.series["slider_position"][at - 1, 0, 2] + (0.5 * G * (result.t[at] - result.t[at - 1])**2
                 - e * np.sqrt(0.4 * G) * (result.t[at] - result.t[at - 1]))
        assert abs(height) < 1e-12
        loss = 0.5 * G * 0.2 * (1.0 - e**2)
        np.testing.assert_allclose(ball["stop_loss"][result.t == hits[0]], loss, atol=1e-13)


def test_a_ball_without_restitution_stays_on_and_slides() -> None:
    result = run(ball_above(0.1, 0.0, angle=-30.0), 0.7)
    ((kind, t),) = [(x["kind"], x["time"]) for x in result.events]
    cos, sin = np.cos(np.pi / 6), 0.5
    assert kind == "landed" and abs(t - np.sqrt(0.2 / (G * cos))) < 1e-13
    # along the beam nothing but gravity acts, before and behind
    ball = result.slider("s")
    np.testing.assert_allclose(ball["s"], 1.0 + 0.5 * G * sin * result.t**2, atol=1e-12)
    on = result.t >= t
    np.testing.assert_allclose(np.linalg.norm(ball["force"], axis=1), np.where(on, 0.5 * G * cos, 0.0), atol=1e-8)
    assert np.all(ball["gap"][on] < 1e-14) and balanced(result)


@pytest.mark.parametrize("planar", ["auto", False])
def test_a_bead_lifts_off_where_it_would_have_to_be_pulled(planar: Any) -> None:
    """Down the outside of a circle of radius R from its top: it leaves at cos = 2/3 for a start at rest."""
    def error(step: float) -> float:
        hill = fb.Beam.arc("hill", (0, 0, 0), (1, 0, 0), (0, 0, -1), angle=np.pi / 2, radius=2.0, section=RAIL, elements=8)
        bead = fb.PointMass("bead", mass=0.5)
        scene = fb.Scene(hill, bead, *[fb.Clamp(hill.node(i)) for i in range(hill.n_nodes)], gravity=(0, 0, -G))
        scene.add(fb.Slider("s", bead, hill, at=0.0, rate=1.0, one_sided=(0, 0, 1)))
        result = run(fb.compile_scene(scene, planar=planar), 1.2, step)
        (lift,) = [x for x in result.events if x["kind"] == "lifted"]
        assert balanced(result) and result.slider("s")["gap"][-1] > 0.05
        # m v^2/R = m g cos
        return float(lift["s"] - 2.0 * np.arccos((1.0 / G + 4.0) / 6.0))

    # at the end of the step behind, as it pulls
    assert 0.0 < error(2e-3) < 3.0 * 2e-3 * 3.0


@pytest.mark.parametrize("planar", ["auto", False])
def test_a_body_that_is_caught_loses_what_the_reduced_mass_says(planar: Any) -> None:
    # a rigid rod at rest in space, hit in its middle by a body that slides along it with 0.5 m/s from then on, then pulled away
    rod = fb.Beam.straight("rod", (-1, 0, 0), (1, 0, 0), section=RAIL, elements=2)
    hub = fb.RigidBody("hub", mass=2.0, inertia=(1.0, 1.0, 1.0), position=(0, 0, 0))
    body = fb.RigidBody("body", mass=3.0, inertia=(1.0, 1.0, 1.0), position=(-0.1, 0, 0.3), velocity=(0.5, 0, -1.5))
    tied = [fb.RigidConnection(hub, rod.node(i)) for i in range(rod.n_nodes)]
    slider = fb.Slider("s", body, rod, at=0.9, one_sided=fb.OneSided((0, 0, 1), catch=True))
    pull = fb.Load("pull", body, force=(0, 0, 20.0), time=lambda t: float(t > 0.4))
    result = run(fb.compile_scene(fb.Scene(rod, hub, body, slider, pull, *tied), planar=planar), 0.6)
    other = 2.0 + 2.0 * RAIL.rhoA
    ((kind, t),) = [(x["kind"], x["time"]) for x in result.events]
    assert kind == "landed" and abs(t - 0.2) < 1e-13
    assert abs(result.slider("s")["stop_loss"][-1] / (0.5 * 1.5**2 * 3.0 * other / (3.0 + other)) - 1.0) < 1e-10
    before = result.t < 0.4
    assert np.ptp(result.series["lin_mom"][before], axis=0).max() < 1e-12 and balanced(result)
    # held from both sides
    assert np.all(result.slider("s")["gap"][result.t >= t] < 1e-13)
    assert result.slider("s")["force"][-1, 2] < -1.0


def test_another_model_knows_what_locks_have_done() -> None:
    def make() -> fb.Model:
        return rail(30.0, 3.0, lock=fb.Lock(0.1, until=0.3))
    whole, part = run(make(), 0.6), run(make(), 0.2)
    rest = run(make(), 0.6, start=fb.Start(part.state_for(make()), time=0.2))
    # held until 0.3 s, not locked once more at once, nor free
    assert happened(part) == [("locked", 0.1)] and happened(rest) == happened(whole)[1:]
    np.testing.assert_allclose(rest.state.q, whole.state.q, rtol=0, atol=1e-12)
    # one with other locks begins with its own
    free = rail(30.0, 3.0)
    slid = run(free, 0.25, start=fb.Start(part.state_for(free), time=0.2)).slider("s")["s"]
    assert slid[0] - slid[-1] == pytest.approx(0.25 * G * 0.05**2, rel=1e-3)


def test_another_model_knows_that_a_point_flies() -> None:
    def make() -> fb.Model:
        return rail(30.0, 3.0, release=fb.Release(0.1))
    whole, part = run(make(), 0.4), run(make(), 0.2)
    rest = run(make(), 0.4, start=fb.Start(part.state_for(make()), time=0.2))
    np.testing.assert_allclose(rest.state.q, whole.state.q, rtol=0, atol=1e-12)
    # a slider that never leaves its beam cannot take that state
    model = rail(30.0, 3.0)
    with pytest.raises(fb.SceneError, match="its point lies"):
        run(model, 0.4, start=fb.Start(part.state_for(model), time=0.2))
