"""One-sided contact on paths, with stops, locks and drives; the search for the nearest place against its twin in NumPy."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from exchange import balanced

import fastbeam as fb
from fastbeam.dynamics.locks import Locking
from fastbeam.model.mapping import shapes_at

G = 9.81
RAIL = fb.Section.circle(radius=0.05, E=200e9, rho=7800.0)
SOFT = fb.Section(EA=1e6, GA2=4e5, GA3=4e5, GJ=100, EI2=100, EI3=100, rhoA=2.0, rhoI2=1e-3, rhoI3=1e-3)


def ball_above(height: float = 0.2, at: float = 1.0, speed: float = 0.3, restitution: float = 0.0, mass: float = 0.5,
               **forces: Any) -> Any:
    """A ball above a stiff rail of 4 m, all nodes of which are clamped."""
    beam = fb.Beam.straight("rail", (0, 0, 0), (4, 0, 0), section=RAIL, elements=4)
    ball = fb.PointMass("ball", mass=mass, position=(at, 0, height), velocity=(speed, 0, 0))
    slider = fb.Slider("s", ball, beam, at=at, one_sided=fb.OneSided((0, 0, 1), restitution=restitution), **forces)
    return fb.compile_scene(fb.Scene(beam, ball, slider, *[fb.Clamp(beam.node(i)) for i in range(beam.n_nodes)],
                                     gravity=(0, 0, -G)))


def run(model: Any, t_end: float, step: float = 0.01, **settings: Any) -> fb.Result:
    return fb.simulate(model, t_end=t_end, step=step, every=1, progress=False, **settings)


def soft_rail(way: str, elements: int = 8) -> Any:
    """A ball that bounces on a flexible rail of 4 m: one beam, or a path of two, the second of which runs backwards and has its
    section turned by half a turn."""
    ball = fb.PointMass("ball", mass=0.5, position=(1.6, 0, 0.2), velocity=(2.0, 0, 0))
    contact: dict[str, Any] = {"at": 1.6, "one_sided": fb.OneSided((0, 0, 1), restitution=0.6)}
    if way == "beam":
        a = fb.Beam.straight("a", (0, 0, 0), (4, 0, 0), section=SOFT, elements=elements)
        parts: list[Any] = [a, fb.Slider("s", ball, a, **contact), fb.Clamp(a.start), fb.Clamp(a.end)]
    else:
        a = fb.Beam.straight("a", (0, 0, 0), (2, 0, 0), section=SOFT, elements=elements // 2)
        b = fb.Beam.straight("b", (4, 0, 0), (2, 0, 0), section=SOFT, elements=elements // 2, d2=(0, 0, -1))
        path = fb.Path("p", [a, (b, -1)])
        parts = [a, b, fb.RigidConnection(a.end, b.end), fb.Slider("s", ball, on=path, **contact), fb.Clamp(a.start),
                 fb.Clamp(b.start)]
    return fb.compile_scene(fb.Scene(*parts, ball, gravity=(0, 0, -G)))


def test_on_a_path_as_on_one_beam() -> None:
    one, other = (run(soft_rail(way), 0.5, 2e-3) for way in ("beam", "path"))
    hits = [[(x["kind"], x["time"]) for x in result.events if x["kind"] in ("impact", "landed", "lifted")]
            for result in (one, other)]
    assert len(hits[0]) >= 1 and [x[0] for x in hits[0]] == [x[0] for x in hits[1]]
    np.testing.assert_allclose([x[1] for x in hits[0]], [x[1] for x in hits[1]], atol=1e-7)
    # it passes the joint at 2 m in flight or on the rail
    assert one.slider("s")["s"][-1] > 2.3
    np.testing.assert_allclose(one.slider("s")["s"], other.slider("s")["s"], atol=1e-6)
    assert balanced(one) and balanced(other)


def naive_place(model: Any, q: Any, k: int, s: float, side: Any) -> tuple[float, float, Any]:
    """Arc length of the nearest place, distance and normal; q [N, 4, 3], side: in the triads of the beam."""
    point = q[int(model.sliders.point[k]), 0]
    for _ in range(50):
        nodes, shapes = shapes_at(model, k, s)
        at, tangent, bend = shapes @ q[nodes, 0]
        s = float(np.clip(s + (point - at) @ tangent / (tangent @ tangent - (point - at) @ bend), *model.slider_ends[k]))
    nodes, shapes = shapes_at(model, k, s)
    at, tangent, _ = shapes @ q[nodes, 0]
    tangent /= np.linalg.norm(tangent)
    normal = side @ np.einsum("n,nic->ic", shapes[0], q[nodes, 1:])
    normal -= (normal @ tangent) * tangent
    normal /= np.linalg.norm(normal)
    return s, float(normal @ (point - at)), normal


def test_the_nearest_place_against_its_twin() -> None:
    model = soft_rail("beam")
    state = run(model, 0.3, 2e-3).state
    finder = Locking(model)._finder
    side = model.slider_forces.sides[0][0]
    q = state.q.reshape(-1, 4, 3)
    number = int(model.sliders.point[0])
    for x, z in ((0.3, 0.1), (1.77, 0.4), (2.5, -0.2), (3.99, 0.05)):
        q[number, 0] = x, 0.0, z
        wanted = naive_place(model, q, 0, float(state.s[0]), side)
        found = finder.place(state, 0)
        np.testing.assert_allclose((found.s, found.distance), wanted[:2], atol=1e-13)
        np.testing.assert_allclose(found.normal, wanted[2], atol=1e-13)
        assert found.is_between_ends and found.off < 1e-15
    q[number, 0] = 4.5, 0.0, 0.1
    assert not finder.place(state, 0).is_between_ends
    q[number, 0] = 1.0, 0.3, 0.1
    assert abs(finder.place(state, 0).off - 0.3) < 1e-3


@pytest.mark.parametrize("e", [0.0, 0.5])
def test_a_stop_turns_a_ball_that_is_on_the_rail(e: float) -> None:
    result = run(ball_above(0.1, speed=2.0, stops=fb.Stops(end=2.0, restitution=e)), 1.5)
    (landed,) = [x for x in result.events if x["kind"] == "landed"]
    (impact,) = [x for x in result.events if x["kind"] == "impact"]
    assert abs(impact["time"] - 0.5) < 1e-12 and landed["time"] < 0.2
    after = result.t > 0.5
    np.testing.assert_allclose(result.slider("s")["s"][after], 2.0 - 2.0 * e * (result.t[after] - 0.5), atol=1e-10)
    assert balanced(result)


def test_beyond_a_stop_nothing_holds_a_ball_that_comes_down() -> None:
    for stops in (fb.Stops(end=1.5), fb.Stops(end=1.5, stiffness=100.0)):
        result = run(ball_above(0.3, at=1.3, speed=2.0, stops=stops), 0.6)
        assert [x for x in result.events if x["kind"] in ("landed", "impact")] == []
        assert result.series["slider_position"][-1, 0, 2] < -1.0
        assert balanced(result)


def test_an_elastic_stop_keeps_what_a_ball_leaves_there() -> None:
    # it presses the stop and is pulled up from there
    beam = fb.Beam.straight("rail", (0, 0, 0), (4, 0, 0), section=RAIL, elements=4)
    ball = fb.PointMass("ball", mass=0.5)
    lift = fb.Load("lift", ball, force=(0, 0, 20.0), time=lambda t: float(t > 0.6))
    slider = fb.Slider("s", ball, beam, at=1.0, rate=2.0, one_sided=(0, 0, 1), stops=fb.Stops(end=2.0, stiffness=4.0))
    result = run(fb.compile_scene(fb.Scene(beam, ball, slider, lift, *[fb.Clamp(beam.node(i)) for i in range(beam.n_nodes)],
                                           gravity=(0, 0, -G))), 0.8)
    (lifted,) = [x for x in result.events if x["kind"] == "lifted"]
    x = result.slider("s")
    pressed = lifted["s"] - 2.0
    assert pressed > 0.1 and abs(x["stop_loss"][-1] - 0.5 * 4.0 * pressed**2) < 1e-12
    assert x["stop_energy"][-1] == 0.0 and balanced(result)


def test_a_lock_that_is_due_in_flight_takes_hold_on_the_rail() -> None:
    result = run(ball_above(0.2, speed=1.0, lock=fb.Lock(0.1, until=0.5)), 0.9)
    fall = np.sqrt(0.4 / G)
    kinds = [(x["kind"], x["time"]) for x in result.events]
    assert [k for k, _ in kinds] == ["landed", "locked", "unlocked"]
    np.testing.assert_allclose([t for _, t in kinds], [fall, fall, 0.5], atol=1e-12)
    s = result.slider("s")["s"][(result.t >= fall) & (result.t <= 0.5)]
    assert np.all(s == s[0]) and abs(s[0] - 1.0 - fall) < 1e-10
    assert abs(result.slider("s")["lock_loss"][-1] - 0.25) < 1e-10
    assert balanced(result)


def test_a_locked_ball_does_not_lift_off() -> None:
    beam = fb.Beam.straight("rail", (0, 0, 0), (4, 0, 0), section=RAIL, elements=4)
    ball = fb.PointMass("ball", mass=0.5)
    slider = fb.Slider("s", ball, beam, at=1.0, one_sided=(0, 0, 1), lock=fb.Lock(until=0.3))
    lift = fb.Load("lift", ball, force=(0, 0, 20.0))
    result = run(fb.compile_scene(fb.Scene(beam, ball, slider, lift, *[fb.Clamp(beam.node(i)) for i in range(beam.n_nodes)],
                                           gravity=(0, 0, -G))), 0.5)
    times = {x["kind"]: x["time"] for x in result.events}
    assert abs(times["unlocked"] - 0.3) < 1e-12 and 0.3 < times["lifted"] < 0.35
    assert balanced(result)


def test_a_belt_takes_along_what_falls_on_it() -> None:
    result = run(ball_above(0.2, speed=0.0, drive=fb.Drive(speed=1.5)), 0.8)
    fall = np.sqrt(0.4 / G)
    (landed,) = [x for x in result.events if x["kind"] == "landed"]
    assert abs(landed["time"] - fall) < 1e-12
    x, on = result.slider("s"), result.t >= landed["time"]
    np.testing.assert_allclose(x["s"][on], 1.0 + 1.5 * (result.t[on] - fall), atol=1e-10)
    assert abs(x["drive_work"][-1] - 0.5 * 0.5 * 1.5**2) < 1e-10
    assert abs(x["stop_loss"][-1] - 0.5 * G * 0.2) < 1e-10
    assert balanced(result)


def test_around_a_closed_path_and_what_is_refused() -> None:
    up = fb.Beam.arc("up", (0, 0, 0), (1, 0, 0), (0, 0, 1), radius=1.0, angle=np.pi, elements=4, section=RAIL)
    down = fb.Beam.arc("down", (0, 0, 2), (-1, 0, 0), (0, 0, -1), radius=1.0, angle=np.pi, elements=4, section=RAIL)
    ring = fb.Path("ring", [up, down], closed=True)
    bead = fb.PointMass("bead", mass=0.5)
    # inside of a ring that stands upright, fast enough for the top: it stays on
    scene = fb.Scene(up, down, *(fb.RigidConnection(a, b) for a, b in ring.joints()), bead, gravity=(0, 0, -G))
    scene.add(*[fb.Clamp(beam.node(i)) for beam in (up, down) for i in range(1, beam.n_nodes - 1)])
    scene.add(fb.Slider("s", bead, on=ring, at=0.0, rate=7.5, one_sided=(0, 0, 1)))
    result = run(fb.compile_scene(scene), 1.2, 4e-3)
    assert [x["kind"] for x in result.events] == [] and result.slider("s")["s"][-1] > 2.0 * np.pi
    assert balanced(result, 1e-11)
    corner = fb.Beam.straight("c", (4, 0, 0), (4, 0, 3), section=RAIL, elements=2)
    flat = fb.Beam.straight("f", (0, 0, 0), (4, 0, 0), section=RAIL, elements=2)
    path = fb.Path("l", [flat, corner])
    with pytest.raises(fb.SceneError, match="its side must not be parallel to the axis of a beam"):
        fb.compile_scene(fb.Scene(flat, corner, fb.RigidConnection(flat.end, corner.start), bead,
                                  fb.Slider("s", bead, on=path, at=1.0, one_sided=(0, 0, 1))))
