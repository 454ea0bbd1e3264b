"""Sliders that go on from track to track: loops, sidings, what stays, against closed paths, books, restarts, what is refused."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from exchange import balanced

import fastbeam as fb

SECTION = fb.Section(EA=1e5, GA2=4e4, GA3=4e4, GJ=200, EI2=200, EI3=200, rhoA=1.0, rhoI2=1e-2, rhoI3=1e-2)
LOOP = 2.0 * np.pi


def yard(choose: Any = (("loop", 0.0), ("side", 2.0)), planar: bool = True, at: float = 0.5, rate: float | None = 4.0,
         way: str = "switch", curve: str = "c1", cars: int = 1, **slide: Any) -> tuple[fb.Scene, Any]:
    """A free loop of two half circles, from whose start a straight siding leads on; a bead runs around. way 'path': the closed
    path of the loop instead of a switch."""
    up = fb.Beam.arc("up", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=1.0, angle=np.pi, elements=8, section=SECTION)
    down = fb.Beam.arc("down", (0, 2, 0), (-1, 0, 0), (0, -1, 0), radius=1.0, angle=np.pi, elements=8, section=SECTION)
    side = fb.Beam.straight("side", (0, 0, 0), (3, 0, 0), elements=6, section=SECTION)
    if isinstance(choose, tuple):
        choose = [(t, name) for name, t in choose]
    on = fb.Path("ring", [up, down], closed=True) if way == "path" else fb.Switch(
        "points", [fb.Path("loop", [up, down]), side], choose=choose)
    joints = [fb.RigidConnection(a, b) for a, b in ((up.end, down.start), (down.end, up.start), (up.start, side.start))]
    parts: list[Any] = [up, down, side, *joints]
    for k in range(cars):
        bead = fb.PointMass(f"bead{k}", mass=0.5)
        parts += [bead, fb.Slider(f"s{k}", bead, on=on, at=at + 0.7 * k, rate=rate, curve=curve, **slide)]
    motion = fb.RigidMotion(velocity=(0.2, 0.1, 0.0 if planar else 0.3), spin=(0, 0, 0.3) if planar else (0.2, 0.1, 0.3))
    return fb.Scene(*parts, motion, project_velocities=True), on


def run(model: Any, t_end: float = 3.5, step: float = 0.01, **settings: Any) -> fb.Result:
    return fb.simulate(model, t_end=t_end, step=step, every=1, progress=False, **settings)


def switched(result: fb.Result) -> list[str]:
    return [x["track"] for x in result.events if x["kind"] == "switched"]


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("order", [2, 4])
def test_around_the_loop_and_onto_the_siding(planar: bool, order: int) -> None:
    scene, on = yard(planar=planar)
    model = fb.compile_scene(scene)
    assert (model.plane is not None) == planar
    result = run(model, order=order)
    assert switched(result) == ["loop", "side"]
    for name in ("total", "lin_mom", "ang_mom", "gap"):
        assert result.drift(name) < 1e-12, name
    track, s = on.where(result.slider("s0")["s"][-1])
    assert track.name == "side" and 0.5 < s < 3.0
    # nothing jumps: positions move by at most the way of a step
    x = result.slider("s0")["position"]
    assert np.max(np.linalg.norm(np.diff(x, axis=0), axis=1)) < 4.6 * 0.01 * 1.05
    # where s says it is the bead is: on the siding in its last shape
    q = result.state.q.reshape(-1, 4, 3)
    entry = next(x for x in result.names["beams"] if x["name"] == "side")
    nodes = slice(entry["first"], entry["first"] + entry["count"])
    at = np.array(entry["s"])
    inside = np.abs(at - s) < 0.6
    weights = [np.prod([(s - b) / (a - b) for b in at[inside] if b != a]) for a in at[inside]]
    np.testing.assert_allclose(np.array(weights) @ q[nodes, 0][inside], x[-1], atol=1e-5)


def test_a_loop_is_a_closed_path() -> None:
    off = []
    for step in (0.01, 0.005):
        one, other = (run(fb.compile_scene(yard(choose=lambda t, state: "loop", way=way, curve="own")[0]), 2.5, step)
                      for way in ("switch", "path"))
        assert switched(one) == ["loop"]
        # s counts rounds on the closed path
        assert abs((other.state.s[0] - one.state.s[0]) - LOOP) < 0.01
        off.append(np.max(np.abs(one.state.q - other.state.q)))
    assert off[1] < 5e-4 and off[1] < 0.4 * off[0]


def test_the_first_step_behind_is_as_smooth_as_before() -> None:
    """Without a corner nothing acts at the switch: the rate changes from row to row as elsewhere."""
    result = run(fb.compile_scene(yard(choose=lambda t, state: "loop")[0]), 2.0, 0.005)
    rate, t = result.slider("s0")["slide_rate"], result.t
    at = next(x["time"] for x in result.events if x["kind"] == "switched")
    change = np.abs(np.diff(rate))
    near = np.abs(t[1:] - at) < 0.01
    assert np.max(change[near]) < 3.0 * np.max(change[~near])


def test_corners_of_a_long_switch_open_no_gaps() -> None:
    """Twelve tracks in zigzag: a slider once went beyond the end of a track by 1e-12 of the arc length of the whole switch, which
    at a corner became a gap of 3e-12 m and took 3e-11 of the energy."""
    soft = fb.Section(EA=1e4, GA2=5e3, GA3=5e3, GJ=50, EI2=50, EI3=50, rhoA=1.0, rhoI2=1e-2, rhoI3=1e-2)
    beams, at = [], np.zeros(3)
    for k in range(12):
        along = np.array((np.cos(0.5), np.sin(0.5), 0.0)) if k % 2 else np.array((1.0, 0.0, 0.0))
        beams.append(fb.Beam.straight(f"b{k}", at, at + along, section=soft, elements=2))
        at = at + along
    bead, joints = fb.PointMass("bead", mass=0.5), [fb.RigidConnection(x.end, y.start) for x, y in zip(beams, beams[1:])]
    for rate in (1.5, 2.0, 2.5, 3.0):
        scene = fb.Scene(*beams, *joints, bead, fb.Slider("s", bead, on=fb.Switch("zigzag", beams), at=0.4, rate=rate),
                         fb.RigidMotion(velocity=(0.2, 0.1, 0.0), spin=(0, 0, 0.1)), project_velocities=True)
        result = run(fb.compile_scene(scene), 2.0)
        assert len(switched(result)) >= 2 and result.series["gap"].max() < 2e-14 and result.drift("total") < 1e-12


def corner(angle: float, way: str, stiffness: float = 1e4, rate: float = 2.0, **slide: Any) -> tuple[fb.Scene, Any]:
    """Three free beams with corners of an angle in degrees, a bead runs over them; way: 'path' or 'switch'."""
    soft = fb.Section(EA=stiffness, GA2=0.5 * stiffness, GA3=0.5 * stiffness, GJ=50, EI2=50, EI3=50, rhoA=1.0, rhoI2=1e-2,
                      rhoI3=1e-2)
    beams, at = [], np.zeros(3)
    for k in range(3):
        turn = np.deg2rad(angle) * (k % 2)
        along = np.array((np.cos(turn), np.sin(turn), 0.0))
        beams.append(fb.Beam.straight(f"b{k}", at, at + along, section=soft, elements=3))
        at = at + along
    on = fb.Path("path", beams) if way == "path" else fb.Switch("corners", beams)
    bead, joints = fb.PointMass("bead", mass=0.5), [fb.RigidConnection(x.end, y.start) for x, y in zip(beams, beams[1:])]
    at_s = 0.4 if rate > 0.0 else on.offset(beams[2]) + 0.6 if way == "switch" else 2.6
    return fb.Scene(*beams, *joints, bead, fb.Slider("s", bead, on=on, at=at_s, rate=rate, **slide),
                    fb.RigidMotion(velocity=(0.2, 0.1, 0.0), spin=(0, 0, 0.1)), project_velocities=True), on


@pytest.mark.parametrize("rate", [2.0, -2.0])
@pytest.mark.parametrize("angle, stiffness", [(88.0, 1e4), (90.0, 1e4), (88.0, 1e6), (90.0, 1e6)])
def test_a_corner_is_passed_as_on_a_path(angle: float, stiffness: float, rate: float) -> None:
    """Steps that ended at the corner once failed there, one of them 4e-16 s long with energy from round-off."""
    found = []
    for way in ("path", "switch"):
        scene, on = corner(angle, way, stiffness, rate)
        found.append(run(fb.compile_scene(scene), 1.0, 0.002))
    one, other = found
    # energy walks by forces in the beams, sqrt(2 EA U) = 700 N, times the last place of 2 m, 500 steps: 7e-12 J
    assert len(switched(other)) >= 1 and other.drift("total") < 2e-11 and other.series["gap"].max() < 1e-13
    np.testing.assert_allclose(other.slider("s")["position"][:len(one.t)], one.slider("s")["position"], atol=1e-6)
    np.testing.assert_allclose(other.t, one.t, atol=1e-12)
    # where it is on its track is where it is on the path
    here, s = on.where(other.slider("s")["s"][-1])
    before = sum(x.length for x in on.tracks[:on.tracks.index(here)])
    assert abs(before + s - one.slider("s")["s"][-1]) < 1e-6


def test_stops_and_friction_behind_a_corner() -> None:
    """A wall on the next track, counted along the way, and friction over the corner."""
    for slide in ({"stops": fb.Stops(end=1.3, restitution=0.5)}, {"friction": 0.05}):
        found = [run(fb.compile_scene(corner(80.0, way, **slide)[0]), 0.6, 0.002) for way in ("path", "switch")]
        one, other = found
        assert switched(other)[0] == "b1"
        books = other.balance()["sum"]
        assert np.ptp(books) < 1e-11 * np.max(books)
        np.testing.assert_allclose(other.slider("s")["position"][-1], one.slider("s")["position"][-1], atol=1e-3)


def test_step_control_over_corners() -> None:
    """Both approach one motion as the tolerance falls, from 0.2 m apart where no step over the corner was judged."""
    one, other = (run(fb.compile_scene(corner(45.0, way)[0]), 1.0, 0.004, tolerance=1e-5) for way in ("path", "switch"))
    assert switched(other)[0] == "b1" and other.drift("total") < 1e-11
    np.testing.assert_allclose(other.slider("s")["position"][-1], one.slider("s")["position"][-1], atol=0.02)


def test_beyond_a_right_angle_the_run_says_so() -> None:
    model = fb.compile_scene(corner(150.0, "switch")[0])
    with pytest.raises(fb.ConvergenceError, match="cannot pass the corner between the tracks 'b0' and 'b1'") as caught:
        run(model, 1.0)
    assert caught.value.result.drift("total") < 1e-12 and 0.9 < caught.value.state.s[0] < 1.0


def test_backwards_through_the_start() -> None:
    scene, on = yard(rate=-4.0)
    result = run(fb.compile_scene(scene), 1.0)
    # what ends where the loop begins is its own end
    assert switched(result) == ["loop"]
    assert on.where(result.slider("s0")["s"][-1])[1] > 2.0
    assert max(result.drift(x) for x in ("total", "lin_mom", "ang_mom", "gap")) < 1e-12


def test_there_and_back() -> None:
    model = fb.compile_scene(yard()[0])
    there = run(model, 1.6)
    back = run(model, 1.6, start=fb.Start(there.state._replace(v=-there.state.v), time=0.0))
    assert switched(there) == ["loop"] and switched(back) == ["loop"]
    # cut steps lie elsewhere on the way back
    np.testing.assert_allclose(back.state.s, model.s0, atol=2e-3)


def test_books_with_friction_and_a_drive() -> None:
    scene, _ = yard(friction=0.1, drive=fb.Drive(speed=4.0), rate=None, cars=2, choose={"s0": "side", "s1": "loop"})
    result = run(fb.compile_scene(scene), 2.0)
    assert sorted(x["slider"] + " " + x["track"] for x in result.events if x["kind"] == "switched") == ["s0 side", "s1 loop"]
    assert balanced(result)
    for k in range(2):
        x = result.slider(f"s{k}")
        assert x["friction_loss"][-1] > 0.1 and x["drive_work"][-1] > 0.0
    assert result.drift("lin_mom") < 1e-12 and result.drift("ang_mom") < 1e-12
    # friction goes on with its sign
    free = run(fb.compile_scene(yard(friction=0.05)[0]), 2.0)
    assert switched(free) == ["loop"]
    assert balanced(free)
    assert np.all(free.slider("s0")["slide_rate"] > 0.5) and np.all(free.slider("s0")["friction_force"][1:-1] < 0.0)


def test_the_function_knows_time_state_and_slider() -> None:
    asked: list[tuple[float, int, str]] = []

    def choose(t: float, state: Any, slider: str) -> str:
        asked.append((t, state.q.size, slider))
        return "side" if state.s[1] < 0.0 or slider == "s1" else "loop"

    model = fb.compile_scene(yard(choose=choose, cars=2)[0])
    result = run(model, 2.0)
    assert [(x[1], x[2]) for x in asked] == [(model.q0.size, "s1"), (model.q0.size, "s0")]
    for (t, _, _), event in zip(asked, (x for x in result.events if x["kind"] == "switched")):
        assert event["time"] == t
    assert switched(result) == ["side", "loop"]


def test_a_run_goes_on_behind_a_switch() -> None:
    model = fb.compile_scene(yard()[0])
    whole = run(model)
    assert switched(whole) == ["loop", "side"]
    last = [x["time"] for x in whole.events if x["kind"] == "switched"][-1]
    # where steps of the whole run end, too
    part = run(model, last + 10 * 0.01)
    rest = run(model, start=part.checkpoint)
    for one, other in zip(rest.state, whole.state):
        np.testing.assert_array_equal(one, other)
    # from the bare state, which knows its track by s
    bare = run(model, start=fb.Start(part.state, time=part.t[-1]))
    np.testing.assert_allclose(bare.state.s, whole.state.s, atol=1e-9)


def test_a_checkpoint_knows_where_switches_lead() -> None:
    part = run(fb.compile_scene(yard()[0]), 0.1)
    for other in ((("loop", 0.0), ("side", 3.0)), (("side", 0.0), ("loop", 2.0)), {"s0": "loop"}, lambda t, state: "loop"):
        with pytest.raises(fb.SceneError, match="checkpoint"):
            run(fb.compile_scene(yard(choose=other)[0]), start=part.checkpoint)
    assert fb.compile_scene(yard()[0]).fingerprint == fb.compile_scene(yard()[0]).fingerprint


def test_step_control_meets_the_end() -> None:
    fixed, controlled = (run(fb.compile_scene(yard()[0]), 1.6, **more) for more in (
        {"step": 0.002}, {"step": 0.005, "tolerance": 1e-6}))
    assert switched(controlled) == ["loop"]
    times = [[x["time"] for x in result.events if x["kind"] == "switched"] for result in (fixed, controlled)]
    np.testing.assert_allclose(times[0], times[1], atol=2e-4)
    assert controlled.drift("total") < 1e-12


def test_a_step_that_leads_far_beyond_the_end() -> None:
    """In one step of 0.2 s a bead passes more than an element behind the end of its track."""
    result = run(fb.compile_scene(yard(rate=6.0)[0]), 1.2, 0.1)
    assert switched(result) == ["loop"] and result.drift("total") < 1e-12


def test_equilibrium_on_the_second_track() -> None:
    left = fb.Beam.straight("left", (0, 0, 0), (1, 0, 0), section=SECTION, elements=4)
    right = fb.Beam.straight("right", (1, 0, 0), (3, 0, 0), section=SECTION, elements=6)
    on = fb.Switch("both", [left, right])
    bead = fb.PointMass("bead", mass=5.0)
    found = []
    for track, at in ((on, on.offset(right) + 0.7), (right, 0.7)):
        scene = fb.Scene(left, right, fb.RigidConnection(left.end, right.start), bead, fb.Slider("s", bead, on=track, at=at),
                         fb.Clamp(left.start), fb.Clamp(right.end), gravity=(0, 0, -9.81))
        result = fb.solve_static(fb.compile_scene(scene), held=True)
        found.append(result.state.q)
    np.testing.assert_allclose(found[0], found[1], atol=1e-10)


def test_what_is_refused() -> None:
    a, b, c = (fb.Beam.straight(name, (k, 0, 0), (k + 1.0, 0, 0), section=SECTION, elements=2) for k, name in enumerate("abc"))
    d = fb.Beam.straight("d", (1, 0, 0), (2, 1, 0), section=SECTION, elements=2)
    bead = fb.PointMass("bead", mass=1.0)
    for message, tracks, choose in (("several tracks", [a, b, d], None), ("choose names 'x'", [a, b, d], {"s": "x"}),
                                    ("growing times", [a, b, d], [(1.0, "b"), (0.5, "d")]),
                                    ("two arguments", [a, b], lambda t: "b"),
                                    ("closed", [fb.Path("p", [a, b], closed=True)], None), ("the same name", [a, a], None),
                                    ("empty", [], None), ("list of beams", a, None)):
        with pytest.raises(fb.SceneError, match=message):
            fb.Switch("w", tracks, choose=choose)
    on = fb.Switch("w", [a, b, c])
    assert on.options(a, "end") == ("b",) and on.options("a", "start") == () and on.options(c, "start") == ("b",)
    for message, more in (("none of the tracks", {"at": 1.5}), ("one_sided", {"at": 0.5, "one_sided": (0, 0, 1)})):
        with pytest.raises(fb.SceneError, match=message):
            fb.Slider("s", bead, on=on, **more)
    with pytest.raises(fb.SceneError, match="switch 'points': choose names 'S0', which is not a slider on it; its sliders are "
                                            "'s0'"):
        fb.compile_scene(yard(choose={"S0": "side"})[0])
    with pytest.raises(fb.SceneError, match="meet without a joint"):
        fb.compile_scene(fb.Scene(a, b, c, bead, fb.Slider("s", bead, on=on, at=0.5)))
    with pytest.raises(fb.SceneError, match="not on switch"):
        fb.Crossing("x", on, d, at=(0.5, 0.5))
    wrong = yard(choose=lambda t, state: "nowhere")[0]
    with pytest.raises(fb.SceneError, match="must return one of 'loop', 'side'"):
        run(fb.compile_scene(wrong), 2.0)
