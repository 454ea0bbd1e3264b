"""Stops, locks, releases and controllers of place on switches: against one beam without a switch, books, restarts, walls that are
met from both sides, what is refused."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb

SOFT = fb.Section(EA=1e4, GA2=4e3, GA3=4e3, GJ=50, EI2=50, EI3=50, rhoA=1.0, rhoI2=1e-2, rhoI3=1e-2)
STIFF = fb.Section(EA=5e4, GA2=2e4, GA3=2e4, GJ=200, EI2=200, EI3=200, rhoA=1.0, rhoI2=1e-2, rhoI3=1e-2)
BACK = 1e-12
# energies of some J walk by forces in beams, sqrt(2 EA U) = 100 N, times the last place of 2 m, 4e-16, in 600 steps: 1e-12 J
BOOKS = 3e-12


def line(switch: bool, planar: bool = True, at: float = 0.4, rate: float | None = 2.0, gravity: float = 0.0,
         interpolation: str = "own", **slide: Any) -> tuple[fb.Scene, Any]:
    """Three beams of 1 m in a row, in free flight, as tracks of a switch or as one path; a bead runs along."""
    beams = [fb.Beam.straight(name, (k, 0, 0), (k + 1.0, 0, 0), section=SOFT, elements=3) for k, name in enumerate("abc")]
    on = fb.Switch("tracks", beams) if switch else fb.Path("way", beams)
    bead = fb.PointMass("bead", mass=0.5)
    joints = [fb.RigidConnection(x.end, y.start) for x, y in zip(beams, beams[1:])]
    motion = fb.RigidMotion(velocity=(0.2, 0.1, 0.0 if planar else 0.3), spin=(0, 0, 0.4) if planar else (0.2, 0.1, 0.4))
    scene = fb.Scene(*beams, *joints, bead, fb.Slider("s", bead, on=on, at=at, rate=rate, curve=interpolation, **slide), motion,
                     gravity=(0, -gravity, 0), project_velocities=True)
    return scene, on


def run(scene: fb.Scene, t_end: float = 1.5, step: float = 0.01, **settings: Any) -> fb.Result:
    return fb.simulate(fb.compile_scene(scene), t_end=t_end, step=step, every=1, progress=False, **settings)


def kinds(result: fb.Result) -> list[str]:
    return [x["kind"] for x in result.events if x["kind"] not in ("start", "memory")]


def books(result: fb.Result) -> float:
    """How far the balance is off, as a share of its largest part."""
    found = result.balance()
    off = float(np.ptp(found["sum"]) / max(np.max(np.abs(x)) for x in found.values()))
    return max(off, result.drift("balance"))


def local(on: Any, result: fb.Result) -> tuple[str, float]:
    track, s = on.where(result.state.s[0])
    return track.name, s


@pytest.mark.parametrize("planar", [True, False], ids=["plane", "space"])
@pytest.mark.parametrize(("slide", "what"), [
    ({"stops": fb.Stops(start=0.2, end=2.4, restitution=0.6)}, "impact"),
    ({"stops": fb.Stops(end=2.3), "friction": 0.05}, "impact"),
    ({"stops": fb.Stops(start=0.2, end=1.02, stiffness=400.0)}, ""),
    ({"lock": fb.Lock(at=1.6, until=1.1)}, "locked"),
    ({"stops": fb.Stops(end=2.3), "lock": fb.Lock("end", until=1.2)}, "locked"),
    ({"drive": fb.Drive(position=lambda t: 0.4 + 1.5 * np.sin(t)), "rate": None}, ""),
    ({"drive": fb.Drive(position=lambda t: 0.4 + 1.5 * np.sin(t), stiffness=300.0, damping=8.0), "rate": None}, ""),
], ids=["rigid", "rubs", "elastic", "lock", "latch", "position", "controller"])
def test_arc_lengths_of_the_way_are_those_of_one_path(planar: bool, slide: dict[str, Any], what: str) -> None:
    """The same beams as one path: what happens is the same, up to the steps that end where tracks meet."""
    found = {}
    for step in (0.01, 0.0025):
        one, other = (run(line(switch, planar, **slide)[0], step=step) for switch in (True, False))
        assert [x for x in kinds(one) if x != "switched"] == kinds(other) and "switched" in kinds(one)
        assert not what or what in kinds(one)
        assert max(books(one), books(other)) < BOOKS
        assert one.drift("gap") < BACK and max(one.drift("lin_mom"), one.drift("ang_mom")) < BACK
        found[step] = float(np.max(np.abs(one.state.q - other.state.q)))
        times = [[x["time"] for x in result.events if x["kind"] in ("impact", "locked")][:1] for result in (one, other)]
        np.testing.assert_allclose(*times, atol=2e-2 * step / 0.01)
    assert found[0.0025] < 2e-5 and found[0.01] < 1e-3


def test_the_rigid_stop_stands_where_it_was_put() -> None:
    for stop, at in ((2.4, ("c", 0.4)), (("c", 0.4), ("c", 0.4)), (("b", 1.0), ("b", 1.0))):
        scene, on = line(True, stops=fb.Stops(end=stop))
        result = run(scene)
        hit = next(x["time"] for x in result.events if x["kind"] == "impact")
        track, s = on.where(result.slider("s")["s"][np.flatnonzero(result.t == hit)[0]])
        assert track.name == at[0] and abs(s - at[1]) < 1e-12, stop
        assert np.max(result.slider("s")["s"]) <= on.offset(at[0]) + at[1] + 1e-12 and books(result) < BOOKS
        assert result.slider("s")["stop_loss"][-1] > 0.05


def test_a_lock_on_a_track_takes_hold_there_and_at_its_end() -> None:
    for at in (("b", 0.35), ("b", 1.0), ("c", 0.0)):
        scene, on = line(True, lock=fb.Lock(at=at, until=1.0))
        result = run(scene, 1.6)
        locked = next(x for x in result.events if x["kind"] == "locked")
        track, s = on.where(locked["s"])
        assert track.name == at[0] and abs(s - at[1]) < 1e-11
        assert "unlocked" in kinds(result) and books(result) < BOOKS


def yard(planar: bool = True, rate: float = 5.0, at: float = 0.5, **slide: Any) -> tuple[fb.Scene, Any]:
    """A free loop of two half circles, and a siding of two beams that leads out of its start and back into it."""
    up = fb.Beam.arc("up", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=1.0, angle=np.pi, elements=8, section=STIFF)
    down = fb.Beam.arc("down", (0, 2, 0), (-1, 0, 0), (0, -1, 0), radius=1.0, angle=np.pi, elements=8, section=STIFF)
    side = fb.Beam.straight("side", (0, 0, 0), (3, 0, 0), elements=6, section=STIFF)
    on = fb.Switch("points", [fb.Path("loop", [up, down]), side], choose=[(0.0, "loop"), (2.0, "side")])
    joints = [fb.RigidConnection(a, b) for a, b in ((up.end, down.start), (down.end, up.start), (up.start, side.start))]
    bead = fb.PointMass("bead", mass=0.5)
    motion = fb.RigidMotion(velocity=(0.2, 0.1, 0.0 if planar else 0.3), spin=(0, 0, 0.3) if planar else (0.2, 0.1, 0.3))
    parts = [up, down, side, *joints, bead, fb.Slider("s0", bead, on=on, at=at, rate=rate, **slide), motion]
    return fb.Scene(*parts, project_velocities=True), on


@pytest.mark.parametrize("planar", [True, False], ids=["plane", "space"])
def test_a_buffer_on_the_siding_lets_the_loop_free(planar: bool) -> None:
    """Once past 1.5 m of the loop, then into the buffer of the siding; it comes back onto the loop."""
    scene, on = yard(planar, stops=fb.Stops(end=("side", 1.5), restitution=0.8))
    result = run(scene, 3.6)
    happened = [x.get("track", x["kind"]) for x in result.events if x["kind"] in ("switched", "impact")]
    assert happened[:3] == ["loop", "side", "impact"] and happened.count("loop") >= 2 and "side" not in happened[3:]
    hit = next(x for x in result.events if x["kind"] == "impact")
    row = int(np.argmin(np.abs(result.t - hit["time"])))
    track, s = on.where(result.slider("s0")["s"][row])
    assert track.name == "side" and abs(s - 1.5) < 1e-11
    assert books(result) < BOOKS and max(result.drift("lin_mom"), result.drift("ang_mom"), result.drift("gap")) < BACK


def test_plane_and_space_are_the_same() -> None:
    scene, _ = yard(stops=fb.Stops(end=("side", 1.5), restitution=0.8), friction=0.02)
    flat, space = (fb.simulate(fb.compile_scene(scene, planar=planar), t_end=4.0, step=0.01, every=1, progress=False)
                   for planar in (True, False))
    assert kinds(flat) == kinds(space)
    np.testing.assert_allclose(flat.state.q, space.state.q, atol=1e-8)
    np.testing.assert_allclose(flat.state.history, space.state.history, atol=1e-8)


@pytest.mark.parametrize("slide", [{"stops": fb.Stops(end=14.0, restitution=0.7)},
                                   {"stops": fb.Stops(end=("side", 1.5), restitution=0.7)},
                                   {"stops": fb.Stops(end=13.5, stiffness=300.0), "friction": 0.02},
                                   {"lock": fb.Lock(at=13.0, until=3.7)}], ids=["way", "track", "elastic", "lock"])
def test_a_run_goes_on_bit_for_bit_behind_changes_of_track(slide: dict[str, Any], tmp_path: Any) -> None:
    model = fb.compile_scene(yard(**slide)[0])

    def go(t_end: float, **start: Any) -> fb.Result:
        return fb.simulate(model, t_end=t_end, step=0.01, every=1, progress=False, **start)

    whole = go(4.0)
    assert kinds(whole).count("switched") >= 2, kinds(whole)
    last = [x["time"] for x in whole.events if x["kind"] == "switched"][1]
    # where steps of the whole run end, too
    part = go(last + 5 * 0.01)
    rest = go(4.0, start=part.checkpoint)
    for one, other in zip(rest.state, whole.state):
        np.testing.assert_array_equal(one, other)


def test_a_wall_is_met_from_behind() -> None:
    """Backwards onto a track whose `end` stands before its end: the wall is met from its other side."""
    for slide in ({"restitution": 1.0}, {"stiffness": 500.0}):
        # c begins at 6 m: behind two tracks of 1 m and what is left out beside them
        scene, on = line(True, at=6.7, rate=-2.0, stops=fb.Stops(end=("b", 0.5), **slide))
        assert on.offset("c") == 6.0
        result = run(scene, 2.0)
        assert kinds(result)[0] == "switched" and kinds(result)[-1] in ("switched", "slider_end")
        assert local(on, result)[0] == "c"
        s = [on.where(x)[1] for x in result.slider("s")["s"] if on.where(x)[0].name == "b"]
        assert min(s) > 0.5 - (1e-12 if "restitution" in slide else 0.1) and books(result) < BOOKS


def test_an_elastic_stop_on_a_track_that_is_left_swings_back_by_itself() -> None:
    scene, _ = line(True, stops=fb.Stops(end=("a", 0.9), stiffness=20.0))
    result = run(scene, 0.8)
    lost = result.slider("s")["stop_loss"][-1]
    # the total energy falls by that
    assert kinds(result) == ["switched", "drift"] and abs(lost - 0.5 * 20.0 * 0.1**2) < 1e-12 and books(result) < BOOKS


@pytest.mark.parametrize("planar", [True, False], ids=["plane", "space"])
def test_released_where_no_track_leads_on(planar: bool) -> None:
    scene, _ = line(True, planar, release=fb.Release("end"))
    result = run(scene, 2.0)
    assert kinds(result) == ["switched", "switched", "released"]
    assert books(result) < BOOKS and max(result.drift(x) for x in ("total", "lin_mom", "ang_mom")) < BACK
    assert result.slider("s")["gap"][-1] > 0.1


def test_equilibrium_against_a_stop_of_the_second_track() -> None:
    """A chain of tracks that goes down: a heavy bead rests at its buffer, as on one path."""
    found = []
    for switch in (True, False):
        beams = [fb.Beam.straight(name, (k, 0, -0.2 * k), (k + 1.0, 0, -0.2 * k - 0.2), section=STIFF, elements=4)
                 for k, name in enumerate("ab")]
        bead = fb.PointMass("bead", mass=2.0)
        on = fb.Switch("tracks", beams) if switch else fb.Path("way", beams)
        begin = on.offset("b") if switch else beams[0].length
        slide = fb.Slider("s", bead, on=on, at=begin + 0.3, curve="own",
                          stops=fb.Stops(end=("b", 0.7) if switch else begin + 0.7))
        scene = fb.Scene(*beams, fb.RigidConnection(beams[0].end, beams[1].start), bead, slide, fb.Clamp(beams[0].start),
                         fb.Clamp(beams[1].end), gravity=(0, 0, -9.81))
        result = fb.solve_static(fb.compile_scene(scene))
        found.append((result.state.q, result.slider("s")["stop_force"][-1]))
    np.testing.assert_allclose(found[0][0], found[1][0], atol=1e-10)
    assert found[0][1] < -3.0 and found[0][1] == pytest.approx(found[1][1], rel=1e-9)


def test_what_is_refused() -> None:
    a, b = (fb.Beam.straight(name, (k, 0, 0), (k + 1.0, 0, 0), section=STIFF, elements=2) for k, name in enumerate("ab"))
    bead, on = fb.PointMass("bead", mass=1.0), fb.Switch("w", [a, b])
    for message, more in (("not one of the tracks", {"stops": fb.Stops(end=("x", 0.2))}),
                          ("beyond beam 'b'", {"lock": fb.Lock(at=(b, 1.5))}),
                          ("must enclose its place", {"stops": fb.Stops(end=0.3)}),
                          ("must enclose its place", {"stops": fb.Stops(end=(a, 0.3))}),
                          ("needs a rigid stop", {"lock": fb.Lock("end")}),
                          ("begins at position", {"drive": fb.Drive(position=lambda t: 0.2)})):
        with pytest.raises(fb.SceneError, match=message):
            slide = fb.Slider("s", bead, on=on, at=0.5, **more)
            fb.compile_scene(fb.Scene(a, b, fb.RigidConnection(a.end, b.start), bead, slide))
    for more in ({"stops": fb.Stops(end=("a", 0.8))}, {"lock": fb.Lock(at=(a, 0.8))}):
        with pytest.raises(fb.SceneError, match="place on a track"):
            fb.Slider("s", bead, a, at=0.5, **more)
    with pytest.raises(fb.SceneError, match="track, s"):
        fb.Stops(end=(1.0, 2.0))
    with pytest.raises(fb.SceneError, match="start must lie before end"):
        fb.Stops(start=(a, 0.5), end=("a", 0.2))
    ring = [fb.Beam.arc(name, (0, 2.0 * k, 0), (1 - 2 * k, 0, 0), (0, 1 - 2 * k, 0), radius=1.0, angle=np.pi, elements=4,
                        section=STIFF) for k, name in enumerate("ud")]
    with pytest.raises(fb.SceneError, match="another track follows"):
        fb.Slider("s", bead, on=fb.Switch("r", ring), at=0.5, release=fb.Release("end"))
