"""Critical loads of planar scenes are those in space: against paths in space, modes about both sides, and exact loads."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from buckling_scenes import KINDS, buckling_scene

import fastbeam as fb
from fastbeam.statics.paths.critical_points import CriticalPoint, PathStep

LATERAL = 4.0126
STRIP = dict(EA=1e6, GA2=1e6, GA3=1e6, GJ=1.0, EI2=1e4, EI3=1.0, rhoA=1.0, rhoI2=0.1, rhoI3=0.2)


def turned(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def strip(force: float, planar: Any = "auto", angle: float = 0.0, elements: int = 6) -> fb.Model:
    """A clamped strip that stands upright, with a force down at its end."""
    beam = fb.Beam.straight("strip", (0, 0, 0), turned(angle) @ (1, 0, 0), section=fb.Section(**STRIP), elements=elements,
                            degree=3)
    return fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, force=(0, 0, -force))), planar=planar)


def critical(result: fb.Result) -> list[float]:
    return [point["load_factor"] for point in result.info["critical_points"]]


def compared(kind: str, seed: int) -> float:
    """Of a random scene how far its lowest critical load is off that of a path in space, as a share; below it modes of the
    equilibrium do not grow, beyond it some do."""
    scene, to = buckling_scene(kind, seed)
    model = fb.compile_scene(scene)
    at, in_space = (fb.solve_path(x, to=to, stop_at="bifurcation") for x in (model, fb.compile_scene(scene, planar=False)))
    assert at.info["counted_in"] == "space"
    (found, *_), (other, *_) = (critical(x) or [np.inf] for x in (at, in_space))
    for side, factor in ((0, 1.0 - 1e-4), (1, 1.0 + 1e-4)):
        if side and not critical(at):
            break
        near = fb.solve_path(model, to=min(factor * found, to))
        modes = fb.modes(model, state=near.state, load_factor=near.series["load_factor"][-1], n=3)
        assert (modes.unstable > 0) == side, (kind, seed, side)
    return abs(found / other - 1.0) if np.isfinite(found) or np.isfinite(other) else 0.0


@pytest.mark.parametrize(("kind", "seed"), [("strut", 1), ("portal", 5), ("strip", 1), ("arch", 5), ("corner", 10),
                                            ("portal", 2)])
def test_random_scenes_buckle_where_they_do_in_space(kind: str, seed: int) -> None:
    """The last one does not: a small load across it makes it bend aside, next to where it would."""
    assert compared(kind, seed) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_more_random_scenes_buckle_where_they_do_in_space(kind: str) -> None:
    """Twelve of each kind: perf/stress/buckling.py."""
    assert max(compared(kind, seed) for seed in (0, 4, 7, 11)) < 1e-6


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_lateral_buckling_of_a_strip(angle: float) -> None:
    """P L^2 = 4.0126 sqrt(EI GJ) (S. Timoshenko, J. Gere, 1961, section 6.3), for EI3/EI2 = 1e-4 some 1e-4 more."""
    model = strip(8.0, angle=angle)
    at = fb.solve_path(model, stop_at="bifurcation")
    in_space = fb.solve_path(strip(8.0, planar=False, angle=angle), stop_at="bifurcation")
    assert model.plane is not None and at.info["counted_in"] == "space"
    [found] = critical(at)
    assert 8.0 * found == pytest.approx(LATERAL, rel=1e-3) and found == pytest.approx(critical(in_space)[0], rel=1e-8)
    [point] = at.info["critical_points"]
    aside = turned(angle) @ (0, 1, 0)
    assert point["type"] == "supercritical" and abs(np.max(np.abs(point["mode"] @ aside)) - 1.0) < 1e-12
    # from there on to both sides, out of the plane
    tips = [fb.solve_path(model, start=at.state, load_factor=found, side=side, to=1.01 * found) for side in (1, -1)]
    ways = [aside @ x.state.q.reshape(-1, 12)[-1, :3] for x in tips]
    assert abs(ways[0]) > 0.05 and ways[0] == pytest.approx(-ways[1], rel=1e-6)
    assert all(not x.series["unstable_directions"][1:].any() for x in tips)


@pytest.mark.parametrize("force", [3.9, 4.2, 9.5, 14.0])
def test_the_number_is_that_of_modes_that_grow(force: float) -> None:
    model = strip(force)
    path = fb.solve_path(model, largest_step=0.5, step=0.5)
    n = fb.modes(model, state=path.state, n=6).unstable
    assert path.series["unstable_directions"][-1] == n == len(critical(path)) == sum(force > x for x in (LATERAL, 10.25))
    assert fb.solve_static(model).info["unstable_directions"] == n


def test_a_window_between_stable_ends() -> None:
    """Two beams that snap through would go aside on their way, and hang in tension behind."""
    section = fb.Section(**STRIP | dict(EA=1e5, EI2=2.0, EI3=4.0, GJ=4.0))
    a, b = (fb.Beam.straight(name, *ends, section=section, elements=4, degree=3) for name, ends in (
        ("left", ((0, 0, 0), (0.5, 0, 0.1))), ("right", ((0.5, 0, 0.1), (1, 0, 0)))))
    model = fb.compile_scene(fb.Scene(a, b, fb.RigidConnection(a.end, b.start), fb.Clamp(a.start), fb.Clamp(b.end),
                                      fb.Load("push", a.end, force=(0, 0, -600.0))))
    path = fb.solve_path(model)
    assert path.series["load_factor"][-1] == 1.0 and path.series["unstable_directions"][-1] == 0.0
    aside = [np.abs(np.array(point["mode"])[:, 1]).max() > 0.5 for point in path.info["critical_points"]]
    rows = [point["row"] for point, out in zip(path.info["critical_points"], aside) if out]
    assert len(rows) >= 2 and len(rows) % 2 == 0
    for row, grows in ((rows[0] - 1, False), (rows[0] + 1, True), (rows[-1] + 1, False)):
        short = fb.solve_path(model, most_points=row + 1)
        found = fb.modes(model, state=short.state, load_factor=short.series["load_factor"][-1], n=10)
        out = np.abs(found.displacements[..., 1]).max(axis=1) > 0.5
        assert np.any(out & (found.growth > 0.0)) == grows


def test_what_stays_in_its_plane() -> None:
    """Because it was asked to, or because only its plane holds it, which is told."""
    asked = fb.solve_path(strip(8.0, planar=True))
    assert asked.info["counted_in"] == "plane" and asked.info["critical_points"] == []
    a, b = (fb.Beam.straight(name, *ends, section=fb.Section(**STRIP), elements=2, degree=3) for name, ends in (
        ("left", ((0, 0, 0), (0.5, 0, 0.1))), ("right", ((0.5, 0, 0.1), (1, 0, 0)))))
    model = fb.compile_scene(fb.Scene(a, b, fb.RigidConnection(a.end, b.start), fb.Pin(a.start), fb.Pin(b.end),
                                      fb.Load("push", a.end, force=(0, 0, -600.0))))
    path = fb.solve_path(model, to=0.1, stop_at="limit")
    [told] = [event["text"] for event in path.events if event["kind"] == "plane"]
    assert model.plane is not None and path.info["counted_in"] == "plane" and "'left' can turn about (1, 0, 0)" in told


@pytest.mark.parametrize("kind", ["limit", "bifurcation"])
@pytest.mark.parametrize("planar", ["auto", True, False])
def test_a_path_goes_along_what_vanishes_at_a_limit_point_alone(kind: str, planar: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where its vectors are in space and the path is in a plane: an arch of EA R^2/EI = 5e9, stiff across its plane, that
    snaps through at 8.97 EI/R^2 (D. A. DaDeppo, R. Schmidt, J. Appl. Mech. 42, 1975), and the strip."""
    first, told = PathStep.first, []

    def looked_at(self: PathStep, *counts: Any) -> CriticalPoint | None:
        point = first(self, *counts)
        if point is not None:
            told.append(self._turns(point.size, point.number, self.solver.saved()))
        return point

    monkeypatch.setattr(PathStep, "first", looked_at)
    model = strip(8.0, planar=planar)
    if kind == "limit":
        sin, cos = np.sin(np.radians(107.5)), np.cos(np.radians(107.5))
        section = fb.Section(**STRIP | dict(EA=5e9, GA2=5e9, GA3=5e9, GJ=1e5, EI2=1e5, EI3=1.0))
        arch = fb.Beam.arc("arch", (-sin, cos, 0), (cos, sin, 0), (sin, -cos, 0), radius=1.0, angle=np.radians(215.0),
                           section=section, elements=12)
        model = fb.compile_scene(fb.Scene(arch, fb.Pin(arch.start), fb.Clamp(arch.end),
                                          fb.Load("crown", arch.at(0.5 * arch.length), force=(0, -8.97, 0))),
                                 planar=planar)
    path = fb.solve_path(model, to=1.8, stop_at=kind)
    if kind == "bifurcation" and planar is True:
        assert told == critical(path) == []
        return
    assert [point["kind"] for point in path.info["critical_points"]] == [kind]
    assert told == [kind == "limit"] and path.info["counted_in"] == ("plane" if planar is True else "space")
    assert critical(path)[0] == pytest.approx(1.0 if kind == "limit" else LATERAL / 8.0, rel=2e-3)


@pytest.mark.parametrize("weak", ["across", "within", "both"])
def test_a_strut_on_pins_that_may_spin_about_its_line(weak: str) -> None:
    """Euler: pi^2 EI/L^2 of the weaker axis, with shortening and shear P (1 - P/EA + P/GA)."""
    EA, GA = 1e6, 1e6
    EI = {"across": (1e4, 1.0), "within": (1.0, 1e4), "both": (1.0, 1.0)}[weak]
    section = fb.Section(**STRIP | dict(EI2=EI[0], EI3=EI[1]))
    strut = fb.Beam.straight("strut", (0, 0, 0), (1, 0, 0), section=section, elements=6, degree=3)
    model = fb.compile_scene(fb.Scene(strut, fb.Pin(strut.start), fb.Pin(strut.end, axes="yz"),
                                      fb.Load("press", strut.end, force=(-12.0, 0, 0))))
    assert model.plane is not None
    at = fb.solve_path(model, stop_at="bifurcation")
    [found] = critical(at)
    P = 12.0 * found
    assert P * (1.0 - P / EA + P / GA) == pytest.approx(np.pi**2, rel=2e-6)
    beyond = fb.solve_path(model, start=at.state, load_factor=found, to=1.2 * found)
    assert beyond.series["unstable_directions"][-1] == (2.0 if weak == "both" else 1.0)
    # the same at the full load, 1.2 times the critical one
    rest = fb.solve_static(model).info
    assert rest["counted_in"] == "space" and rest["unstable_directions"] == beyond.series["unstable_directions"][-1]
    assert rest["free_motions"] == ["beam 'strut' about its axis"] and rest["free_directions"] == 1
    bent = fb.solve_path(model, start=at.state, load_factor=found, side=1, to=1.001 * found)
    assert np.max(np.linalg.norm(bent.state.q.reshape(-1, 12)[:, 1:3], axis=1)) > 0.02


@pytest.mark.parametrize("kind", ["moves", "prestrains", "follower", "two times", "bead", "moment", "joint"])
def test_all_kinds_of_paths(kind: str) -> None:
    """Against what `solve_static` counts in space at the same place, or modes about it, and against paths in space."""
    section = fb.Section(**STRIP)
    beam = fb.Beam.straight("strip", (0, 0, 0), (1, 0, 0), section=section, elements=4, degree=3)
    clamp, parts, options = fb.Clamp(beam.start), [], {}
    down = fb.Load("tip", beam.end, force=(0, 0, -8.0))
    if kind == "moves":
        parts = [fb.Pin(beam.end, axes="z")]
        options = dict(moves={parts[0]: (0, 0, -6.0 / 3e4)})
    elif kind == "prestrains":
        # P = 4 pi^2 EI/L^2, and 8.18 pi^2, out of the plane xy that a straight beam has
        beam = fb.Beam.straight("strip", (0, 0, 0), (1, 0, 0), section=fb.Section(**STRIP | dict(EI2=1.0, EI3=1e4)), elements=6,
                                degree=3)
        clamp, parts, options = fb.Clamp(beam.start), [fb.Clamp(beam.end)], dict(prestrains={beam: -1e-4})
    elif kind == "follower":
        parts = [fb.Load("tip", beam.end, force=(0, 0, -8.0), follower=True)]
    elif kind == "two times":
        parts = [fb.Load("tip", beam.end, force=(0, 0, -8.0), follower=True, time=lambda t: t)]
        options = dict(at_time=(0.0, 1.0))
    elif kind == "bead":
        bead = fb.PointMass("bead", mass=0.1)
        parts = [down, bead, fb.Slider("run", bead, beam, at=0.4)]
        options = dict(held=True)
    elif kind == "moment":
        # the same moment in a plane, and fixed in space
        parts = [fb.Load("tip", beam.end, force=(0, 0, -8.0), moment=(0, 1e-3, 0))]
    else:
        rod = fb.Beam.straight("rod", (1, 0, 0), (1.5, 0, 0), section=section, elements=2, degree=3)
        parts = [rod, fb.RevoluteJoint(beam.end, rod.start, axis=(0, 1, 0), stiffness=1e4),
                 fb.Load("tip", rod.end, force=(0, 0, -3.0))]
    scene = fb.Scene(beam, clamp, *parts)
    model = fb.compile_scene(scene)
    assert model.plane is not None
    models = model, fb.compile_scene(scene, planar=False)
    path, in_space = (fb.solve_path(x, step=0.1, largest_step=0.25, **options) for x in models)
    n = path.series["unstable_directions"][-1]
    np.testing.assert_allclose(critical(path), critical(in_space), rtol=1e-6)
    if kind in ("moves", "prestrains"):
        assert n == (1 if kind == "moves" else 2) == len(critical(path))
        return
    if kind in ("follower", "two times"):
        # vibrations that grow, which no static criterion sees
        assert critical(path) == [] and (n == 0.0 or np.isnan(n))
        assert fb.modes(model, state=path.state, at_time=1.0, n=4).unstable == 2
        return
    held = options.pop("held", False)
    rest = fb.solve_static(model, held=held, at_time=1.0 if "at_time" in options else None)
    assert rest.info["counted_in"] == "space" and n == rest.info["unstable_directions"] == 1
