"""Equilibrium paths: exact trusses and columns, published limit loads of arches and frames, lateral buckling."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg as dense
from scipy.optimize import brentq, minimize_scalar
from scipy.special import ellipe, ellipk

import fastbeam as fb
from fastbeam.statics.arc_length import PathSolver
from fastbeam.statics.paths import critical_points
from fastbeam.statics.paths import walk as path_walk

Array = np.ndarray


def section(EA: float, GA: float, EI: float, GJ: float = 1e3, EI3: float | None = None) -> fb.Section:
    return fb.Section(EA=EA, GA2=GA, GA3=GA, GJ=GJ, EI2=EI, EI3=EI if EI3 is None else EI3, rhoA=1.0, rhoI2=0.1, rhoI3=0.1)


def critical(result: fb.Result, kind: str) -> list[float]:
    return [point["load_factor"] for point in result.info["critical_points"] if point["kind"] == kind]


def test_truss_of_two_bars_goes_through_both_limit_points() -> None:
    """P = 2 EA (1 - l/l0) z/l at the height z of the top, exactly; out on one side and back on the other."""
    height, stiffness = 0.3, 1e4
    rest = np.hypot(height, 1.0)
    bar = section(stiffness, stiffness, 1e4)

    def load(w: Any) -> Any:
        z = height - w
        length = np.hypot(1.0, z)
        return -2.0 * stiffness * (length - rest) / rest * z / length

    peak = float(load(minimize_scalar(lambda w: -load(w), bounds=(0.0, height), method="bounded", options={"xatol": 1e-12}).x))
    bars = [fb.Beam.straight("a", (-1, 0, 0), (0, 0, height), section=bar, elements=2, degree=2),
            fb.Beam.straight("b", (0, 0, height), (1, 0, 0), section=bar, elements=2, degree=2)]
    model = fb.compile_scene(fb.Scene(*bars, fb.Pin(bars[0].start), fb.Pin(bars[1].end), fb.BallJoint(bars[0].end, bars[1].start),
                                      fb.Load("push", bars[0].end, force=(0, 0, -1.5 * peak))))
    result = fb.solve_path(model, points={"top": bars[0].end})
    factor, w = result.series["load_factor"], height - result.point("top")[:, 2]
    np.testing.assert_allclose(1.5 * factor * peak, load(w), atol=1e-11 * peak)
    np.testing.assert_allclose(np.array(critical(result, "limit")) * 1.5, [1.0, -1.0], atol=1e-12)
    assert factor[-1] == 1.0 and w[-1] > 2.0 * height
    unstable = result.series["unstable_directions"]
    assert (unstable[0], unstable.max(), unstable[-1]) == (0.0, 1.0, 0.0)
    assert np.all(np.diff(result.t) > 0.0) and len(result.t_snap) == len(result.t)
    assert {event["kind"] for event in result.events} == {"limit"}
    # back again, from the end
    back = fb.solve_path(model, start=result.state, load_factor=1.0, to=0.0, points={"top": bars[0].end})
    assert back.series["load_factor"][-1] == 0.0
    assert height - back.point("top")[-1, 2] == pytest.approx(2.0 * height, abs=1e-12)


def determinant(load: float, ends: str, length: float, EI: float, EA: float, GA: float) -> float:
    """Zero at the buckling loads of a column with shear that its load has shortened, by the matrix exponential."""
    e = -load / EA
    c = (1.0 + e) * GA + load
    a = np.array([[0, load / GA + 1 + e, 0, 1 / GA], [0, 0, 1 / EI, 0], [0, -c * load / GA, 0, -c / GA], [0, 0, 0, 0.0]])
    held = {"c": [0, 1], "p": [0, 2], "f": [2, 3]}
    free = [i for i in range(4) if i not in held[ends[0]]]
    return float(np.linalg.det(dense.expm(a * length)[np.ix_(held[ends[1]], free)]))


@pytest.mark.parametrize(("ends", "bound"), [("cf", 1e-9), ("pp", 5e-9), ("cp", 2e-8)])
def test_columns_branch_at_their_buckling_loads_with_order_six(ends: str, bound: float) -> None:
    length, EI, EA, GA = 5.0, 1e3, 1e6, 1e5
    loads = np.linspace(1.0, 1500.0, 800)
    values = [determinant(x, ends, length, EI, EA, GA) for x in loads]
    k = next(i for i in range(len(loads)) if values[i] * values[i + 1] < 0.0)
    exact = brentq(determinant, loads[k], loads[k + 1], args=(ends, length, EI, EA, GA), xtol=1e-12, rtol=1e-14)
    errors = []
    for elements in (8, 16):
        column = fb.Beam.straight("column", (0, 0, 0), (0, 0, length), section=section(EA, GA, EI), elements=elements)
        parts: list[Any] = [column, (fb.Clamp if ends[0] == "c" else fb.Pin)(column.start)]
        if ends[1] == "p":
            # a roller on a stiff rail
            rail = fb.Beam.straight("rail", (0, 0, length - 1), (0, 0, length + 1), section=section(1e9, 1e9, 1e9), elements=1,
                                    degree=1)
            parts += [rail, fb.Clamp(rail.start), fb.Clamp(rail.end), fb.Slider("roller", column.end, rail, at=1.0)]
        scene = fb.Scene(*parts, fb.Load("press", column.end, force=(0, 0, -2.0 * exact)))
        result = fb.solve_path(fb.compile_scene(scene), to=0.6)
        # a round section bends to all sides
        assert critical(result, "limit") == [] and result.series["unstable_directions"][-1] == 2.0
        found, = critical(result, "bifurcation")
        errors.append(abs(2.0 * found - 1.0))
    assert errors[1] < bound
    assert errors[0] < 3e-9 or np.log2(errors[0] / errors[1]) > 5.5


@pytest.mark.slow
def test_lateral_buckling_of_a_strip() -> None:
    """Prandtl: 4.012599344 sqrt(EI GJ)/L^2 for a strip that is infinitely stiff in its plane; the error is one over the ratio."""
    found = []
    for ratio in (1e4, 1e5):
        strip = fb.Beam.straight("strip", (0, 0, 0), (1, 0, 0), section=section(100 * ratio, 100 * ratio, ratio, 1.0, 1.0),
                                 elements=16)
        scene = fb.Scene(strip, fb.Clamp(strip.start), fb.Load("tip", strip.end, force=(0, 0, -6.0)))
        result = fb.solve_path(fb.compile_scene(scene, planar=False))
        assert result.info["counted_in"] == "space"
        found.append(6.0 * critical(result, "bifurcation")[0])
    # stiffnesses 1e7 apart: round-off moves it, between -3e-8 and 5e-8 with loads of 5.7 to 6.2 in place of 6
    assert (10.0 * found[1] - found[0]) / 9.0 == pytest.approx(4.012599344, rel=1e-7)


def test_deep_arch_of_dadeppo_and_schmidt_and_every_point_in_equilibrium(monkeypatch: pytest.MonkeyPatch) -> None:
    """Clamped and hinged, 215 degrees: P R^2/EI = 8.97 (F. W. DaDeppo, R. Schmidt, J. Appl. Mech. 42, 1975)."""
    left: list[float] = []
    record = path_walk.PathWalk.record

    def watch(self: Any, iterations: int, size: float, unstable: int | None) -> None:
        solver: PathSolver = self.solver
        solver.work.increment.control[0] = 0.0
        _, right, loads = solver.equations()
        left.append(float(np.max(np.abs(right)) / np.max(np.abs(loads))))
        record(self, iterations, size, unstable)

    monkeypatch.setattr(path_walk.PathWalk, "record", watch)
    half = np.deg2rad(107.5)
    start, tangent = (-np.sin(half), 0, np.cos(half)), (np.cos(half), 0, np.sin(half))
    arch = fb.Beam.arc("arch", start, tangent, (np.sin(half), 0, -np.cos(half)), radius=1.0, angle=2 * half,
                       section=section(1e5, 1e5, 1.0), elements=16)
    scene = fb.Scene(arch, fb.Clamp(arch.start), fb.Pin(arch.end), fb.Load("top", arch.at(arch.length / 2), force=(0, 0, -10.0)))
    result = fb.solve_path(fb.compile_scene(scene))
    limits = 10.0 * np.array(critical(result, "limit"))
    assert limits[0] == pytest.approx(8.97, abs=0.005) and len(limits) == 2
    assert result.series["load_factor"][-1] == 1.0
    # round-off of coordinates: 2e-16 of 1 m times EA/h = 7e5, next to the load of 10
    assert max(left) < 5e-10 and len(left) == len(result.t)


def test_frame_of_lee_snaps_back() -> None:
    """Two legs of 120 cm, E = 720, sections 3 x 2; limit loads 1.85 and -0.94 (S. Lee, F. Manuel, E. Rossow, 1968)."""
    E, area, inertia = 720.0, 6.0, 2.0
    leg = section(E * area, E / 2.6 * area * 5 / 6, E * inertia)
    column = fb.Beam.straight("column", (0, 0, 0), (0, 0, 120), section=leg, elements=5)
    beam = fb.Beam.straight("beam", (0, 0, 120), (120, 0, 120), section=leg, elements=5)
    scene = fb.Scene(column, beam, fb.Pin(column.start), fb.Pin(beam.end), fb.RigidConnection(column.end, beam.start),
                     fb.Load("push", beam.at(24.0), force=(0, 0, -2.5)))
    result = fb.solve_path(fb.compile_scene(scene), points={"load": beam.at(24.0)})
    np.testing.assert_allclose(2.5 * np.array(critical(result, "limit")), [1.854, -0.939], atol=2e-3)
    rows = [point["row"] for point in result.info["critical_points"]]
    z = result.point("load")[rows[0]:rows[1] + 1, 2]
    assert np.any(np.diff(z) > 0.0) and np.any(np.diff(z) < 0.0), "the load falls and its place turns back"


@pytest.mark.parametrize("side", [1, -1])
def test_a_column_buckles_along_its_elastica(side: int) -> None:
    """P L^2/EI = K(k)^2, height 2 E/K - 1, deflection 2 k/K; what is left is its stretch."""
    critical_load = np.pi**2 / 4.0
    column = fb.Beam.straight("column", (0, 0, 0), (0, 0, 1), section=section(1e6, 1e6, 1.0), elements=16)
    load = fb.Load("press", column.end, force=(0, 0, -2.0 * critical_load))
    model = fb.compile_scene(fb.Scene(column, fb.Clamp(column.start), load))
    at = fb.solve_path(model, stop_at="bifurcation")
    assert len(at.info["critical_points"]) == 1 and at.info["critical_points"][0]["row"] == len(at.t) - 1
    factor = float(at.series["load_factor"][-1])
    bent = fb.solve_path(model, start=at.state, load_factor=factor, side=side, to=0.576, points={"tip": column.end})
    k = brentq(lambda k: ellipk(k * k)**2 - 0.576 * 2.0 * critical_load, 1e-3, 0.99)
    x, y, z = bent.point("tip")[-1]
    assert np.hypot(x, y) == pytest.approx(2.0 * k / ellipk(k * k), rel=1e-6)
    assert z == pytest.approx(2.0 * ellipe(k * k) / ellipk(k * k) - 1.0, rel=1e-5)
    assert np.all(bent.series["unstable_directions"][1:] == 0.0) and bent.info["critical_points"] == []
    other = fb.solve_path(model, start=at.state, load_factor=factor, side=-side, to=0.576, points={"tip": column.end})
    np.testing.assert_allclose(other.point("tip")[-1], [-x, -y, z], atol=1e-9)


@pytest.mark.parametrize(("arguments", "message"), [
    ({"to": 0.0}, "to: the path begins at load factor 0 already"),
    ({"step": 0.2, "largest_step": 0.1, "smallest_step": 0.15}, "step: needs smallest_step <= step and <= largest_step"),
    ({"side": 1}, "side: needs a start on a bifurcation"), ({"side": 2}, "side: must be 1 or -1"),
    ({"stop_at": "snap"}, "'snap' does not exist: choose 'limit' or 'bifurcation'"),
    ({"backend": "mumps"}, "backend 'mumps' does not exist"), ({"held": "ring"}, "has no slider 'ring'"),
    ({"start": 3}, "start: must be a State"), ({"arc": 3}, "has no argument 'arc'"),
    ({"branch": 1}, "branch: needs a start on a bifurcation"), ({"branch": 0, "side": 1}, "give side= or branch=, not both"),
    ({"moves": {}}, "moves: must be a mapping"), ({"moves": {3: (0, 0, 1)}}, "moves= must map supports"),
    ({"moves": {fb.PointMass("else", mass=1.0): (0, 0, 1)}}, "moves= of .*else.*: it is not in scene"),
    ({"observe": ("speed",)}, "observe")])
def test_bad_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    column = fb.Beam.straight("column", (0, 0, 0), (0, 0, 1), section=section(1e6, 1e6, 1.0), elements=2)
    model = fb.compile_scene(fb.Scene(column, fb.Clamp(column.start), fb.Load("press", column.end, force=(0, 0, -1.0))))
    with pytest.raises(fb.SceneError, match=message):
        fb.solve_path(model, **arguments)


def test_paths_that_do_not_begin_or_end_say_so() -> None:
    column = fb.Beam.straight("column", (0, 0, 0), (0, 0, 1), section=section(1e6, 1e6, 1.0), elements=2)
    with pytest.raises(fb.SceneError, match="solve_path: the scene has no loads to scale"):
        fb.solve_path(fb.compile_scene(fb.Scene(column, fb.Clamp(column.start))))
    model = fb.compile_scene(fb.Scene(column, fb.Clamp(column.start), fb.Load("across", column.end, force=(1.0, 0, 0))))
    short = fb.solve_path(model, most_points=3)
    assert [event["kind"] for event in short.events] == ["stopped"] and len(short.t) == 3
    ring = fb.PointMass("ring", mass=1.0)
    slides = fb.Scene(column, fb.Clamp(column.start), ring, fb.Slider("fall", ring, column, at=0.9), gravity=(1.0, 0, 0))
    with pytest.raises(fb.ConvergenceError, match=r"the largest residual is at .*lock it \(held=True\)"):
        fb.solve_path(fb.compile_scene(slides))
    rest = fb.solve_path(model, start=short.state, load_factor=float(short.series["load_factor"][-1]))
    np.testing.assert_allclose(rest.state.q, fb.solve_static(model).state.q, atol=1e-11)


@pytest.mark.parametrize("bars", ["springs", "beams"])
def test_a_closed_path_ends_where_it_began(bars: str) -> None:
    """The sway of a steep truss of two springs, or hinged beams: a loop through both of its bifurcations, every point in exact
    equilibrium."""
    stiffness, push, feet = 100.0, 100.0, np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    parts: list[Any]
    if bars == "springs":
        top: Any = fb.PointMass("top", mass=1.0, position=(0, 0, 3))
        parts = [top, *(fb.Spring(top, fb.GROUND.point(x), f"bar {k}", stiffness=stiffness) for k, x in enumerate(feet))]
    else:
        beams = [fb.Beam.straight(f"bar {k}", x, (0, 0, 3), section=section(stiffness * np.hypot(1.0, 3.0), 1e3, 1e3), elements=2)
                 for k, x in enumerate(feet)]
        top = beams[0].end
        parts = [*beams, *(fb.Pin(beam.start) for beam in beams), fb.BallJoint(top, beams[1].end)]
    model = fb.compile_scene(fb.Scene(*parts, fb.Load("push", top, force=(0, 0, -push))), planar=True)
    at = fb.solve_path(model, stop_at="bifurcation", points={"top": top})
    height = float(at.point("top")[-1, 2])
    rest = np.hypot(1.0, 3.0)
    length = brentq(lambda x: x**3 - rest * x * x + rest, 1.5, rest)
    assert height == pytest.approx(np.sqrt(length**2 - 1.0), abs=1e-11)
    loop = fb.solve_path(model, start=at.state, load_factor=float(at.series["load_factor"][-1]), side=1, to=50.0,
                         points={"top": top})
    assert loop.events[-1]["kind"] == "closed" and len(loop.t) < 200
    place, factor = loop.point("top"), loop.series["load_factor"]
    np.testing.assert_array_equal(place[-1], place[0])
    # twice through x = 0 below, once back at the start: all around
    assert place[:, 0].min() < -2.5 and place[:, 0].max() > 2.5 and place[:, 2].min() == pytest.approx(-height, abs=5e-3)
    away = place[:, None] - feet
    lengths = np.linalg.norm(away, axis=2, keepdims=True)
    force = -(stiffness * (1.0 - rest / lengths) * away).sum(axis=1)
    force[:, 2] -= push * factor
    assert np.abs(force).max() < 1e-10 * push


def test_loads_that_stay_while_others_grow() -> None:
    """A column under its weight and a thrust that stays, pushed sideways: ends where `solve_static` of all loads does, and its
    buckling load is that of the thrust alone less the weight's share."""
    column = fb.Beam.straight("column", (0, 0, 0), (0, 0, 1), section=section(1e4, 1e4, 1.0), elements=8)
    euler = np.pi**2 / 4.0
    parts = (column, fb.Clamp(column.start), fb.Load("thrust", column.end, force=(0, 0, -0.5 * euler)))
    model = fb.compile_scene(fb.Scene(*parts, fb.Load("side", column.end, force=(1.5, 0, 0), time=lambda t: t)))
    begin = fb.solve_static(model, at_time=0.0)
    path = fb.solve_path(model, at_time=(0.0, 1.0), start=begin.state, points={"tip": column.end})
    whole = fb.solve_static(model, at_time=1.0, points={"tip": column.end})
    np.testing.assert_allclose(path.point("tip")[-1], whole.point("tip")[-1], atol=1e-11)
    middle = fb.solve_path(model, at_time=(0.0, 1.0), start=begin.state, points={"tip": column.end}, to=0.4)
    part = fb.solve_static(model, at_time=0.4, points={"tip": column.end})
    np.testing.assert_allclose(middle.point("tip")[-1], part.point("tip")[-1], atol=1e-11)
    # thrust that grows on one that stays: together they reach the same buckling load
    grows = fb.compile_scene(fb.Scene(*parts, fb.Load("more", column.end, force=(0, 0, -euler), time=lambda t: t)))
    alone = fb.compile_scene(fb.Scene(*parts[:2], fb.Load("all", column.end, force=(0, 0, -euler))))
    found = fb.solve_path(grows, at_time=(0.0, 1.0), start=fb.solve_static(grows, at_time=0.0).state, stop_at="bifurcation")
    once = fb.solve_path(alone, stop_at="bifurcation", to=1.5)
    assert found.series["load_factor"][-1] + 0.5 == pytest.approx(once.series["load_factor"][-1], abs=1e-10)


def test_two_times_of_loads_are_checked() -> None:
    column = fb.Beam.straight("column", (0, 0, 0), (0, 0, 1), section=section(1e6, 1e6, 1.0), elements=2)
    parts = (column, fb.Clamp(column.start), fb.Load("thrust", column.end, force=(0, 0, -0.5)))
    model = fb.compile_scene(fb.Scene(*parts))
    with pytest.raises(fb.SceneError, match=r"at_time=\(0.0, 1.0\): no load changes between these times"):
        fb.solve_path(model, at_time=(0.0, 1.0))
    model = fb.compile_scene(fb.Scene(*parts, fb.Load("side", column.end, force=(1, 0, 0), time=lambda t: t)))
    with pytest.raises(fb.SceneError, match="the start carries loads already; give the equilibrium to begin from"):
        fb.solve_path(model, at_time=(0.0, 1.0))
    for wrong in ((0.0,), (0.0, 1.0, 2.0), "ab", (0.0, "b"), np.nan):
        with pytest.raises(fb.SceneError, match="at_time: "):
            fb.solve_path(model, at_time=wrong)


def test_displacement_control_snaps_back() -> None:
    """A truss of two springs pushed by a hand on a soft spring: the hand, a support, has to go back for the truss to go on.
    Exact: P(z) = 2 k (l - l0) z/l at the height z of the top, the hand at z + P/ks + l_s."""
    k, height, soft, rod = 100.0, 0.5, 6.0, 1.5
    rest = np.hypot(1.0, height)

    def force(z: Any) -> Any:
        length = np.hypot(1.0, z)
        return 2.0 * k * (length - rest) * z / length

    top, hand = (fb.PointMass(name, mass=1.0, position=(0, 0, z)) for name, z in (("top", height), ("hand", height + rod)))
    bars = [fb.Spring(top, fb.GROUND.point((x, 0, 0)), f"bar {x}", stiffness=k) for x in (-1, 1)]
    clamp = fb.Clamp(hand)
    scene = fb.Scene(top, hand, *bars, fb.Spring(hand, top, "arm", stiffness=soft), clamp)
    model = fb.compile_scene(scene, planar=True)
    result = fb.solve_path(model, moves={clamp: (0, 0, -1.5)}, points={"top": top, "hand": hand}, observe=("reaction", "energy"),
                           largest_step=0.05)
    z, u = result.point("top")[:, 2], result.point("hand")[:, 2]
    np.testing.assert_allclose(u, z + force(z) / soft + rod, atol=1e-12)
    np.testing.assert_allclose(u, height + rod - 1.5 * result.series["load_factor"], atol=1e-13)
    np.testing.assert_allclose(result.reaction("clamp of point mass 'hand'")["force"][:, 2], force(z), atol=1e-11)
    turns = [minimize_scalar(lambda z: sign * (z + force(z) / soft), bounds=ends, method="bounded", options={"xatol": 1e-13}).x
             for sign, ends in ((1.0, (0.1, 0.45)), (-1.0, (-0.45, -0.1)))]
    exact = [(height + rod - (x + force(x) / soft + rod)) / 1.5 for x in turns]
    np.testing.assert_allclose(critical(result, "limit"), exact, atol=1e-12)
    assert np.diff(u).max() > 0.0 and result.series["load_factor"][-1] == 1.0
    with pytest.raises(fb.SceneError, match="no support fixes its position"):
        fb.solve_path(model, moves={top: (0, 0, 1)})
    # on from there, by the node, and what `solve_static` finds
    on = fb.solve_path(model, moves={hand: (0, 0, -0.2)}, start=result.state, points={"top": top})
    z = on.point("top")[-1, 2]
    assert z + force(z) / soft + rod == pytest.approx(u[-1] - 0.2, abs=1e-12)


def test_all_paths_through_a_point_where_eight_directions_lead_away() -> None:
    """A steep pyramid of four springs sways to both axes at once: along each, and along both diagonals, to either side."""
    k, feet = 100.0, np.array([[-1.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0]])
    top = fb.PointMass("top", mass=1.0, position=(0, 0, 3))
    springs = [fb.Spring(top, fb.GROUND.point(x), f"bar {i}", stiffness=k) for i, x in enumerate(feet)]
    model = fb.compile_scene(fb.Scene(top, *springs, fb.Load("push", top, force=(0, 0, -2.0 * k))))
    at = fb.solve_path(model, stop_at="bifurcation")
    point = at.info["critical_points"][-1]
    assert (point["multiplicity"], len(point["branches"]), point["continuum"]) == (2, 8, False)
    ways = np.array(point["branches"])
    angles = np.mod(np.rad2deg(np.arctan2(ways[:, 1], ways[:, 0])) + 1.0, 360.0)
    np.testing.assert_allclose(np.sort(angles), 45.0 * np.arange(8) + 1.0, atol=1e-4)
    turns = []
    for branch in (0, 1):
        path = fb.solve_path(model, start=at.state, load_factor=point["load_factor"], branch=branch, to=50.0, most_points=8,
                             points={"top": top})
        x = path.point("top")
        away = x[:, None] - feet
        force = -(k * (1.0 - np.sqrt(10.0) / np.linalg.norm(away, axis=2, keepdims=True)) * away).sum(axis=1)
        force[:, 2] -= 2.0 * k * path.series["load_factor"]
        assert np.abs(force).max() < 1e-11 * k
        turns.append(float(np.arctan2(x[-1, 1], x[-1, 0])))
    assert np.mod(np.rad2deg(turns[1] - turns[0]) + 1.0, 90.0) == pytest.approx(46.0, abs=1e-9)
    with pytest.raises(fb.SceneError, match="branch: 8 does not exist, 8 directions lead away"):
        fb.solve_path(model, start=at.state, load_factor=point["load_factor"], branch=8)


def test_a_column_that_may_bend_to_all_sides_says_so() -> None:
    column = fb.Beam.straight("column", (0, 0, 0), (0, 0, 1), section=section(1e6, 1e6, 1.0), elements=4)
    load = fb.Load("press", column.end, force=(0, 0, -5.0))
    model = fb.compile_scene(fb.Scene(column, fb.Clamp(column.start), load), planar=False)
    at = fb.solve_path(model, stop_at="bifurcation")
    point = at.info["critical_points"][-1]
    assert (point["multiplicity"], len(point["branches"]), point["continuum"]) == (2, 2, True)
    assert 5.0 * point["load_factor"] == pytest.approx(np.pi**2 / 4.0, rel=1e-5)


# --------------------------------------------------------------------------------------------- critical points in their order
def test_no_point_of_a_step_is_lost() -> None:
    """A column that is a hundredth stiffer to one side buckles twice within a step, at the same loads as with small steps; the
    modes are those sides."""
    column = fb.Beam.straight("column", (0, 0, 0), (0, 0, 1), section=section(1e4, 1e4, 1.0, 1.0, 1.01), elements=8)
    model = fb.compile_scene(fb.Scene(column, fb.Clamp(column.start), fb.Load("press", column.end, force=(0, 0, -5.0))),
                             planar=False)
    paths = [fb.solve_path(model, to=0.6, step=0.05, largest_step=size, most_points=100) for size in (0.1, 0.02)]
    for path in paths:
        points = path.info["critical_points"]
        assert [(x["kind"], x["type"]) for x in points] == 2 * [("bifurcation", "supercritical")]
        assert {x["mode_at"] for x in points} == {"beam 'column' node 24"}
        np.testing.assert_allclose(np.abs([x["mode"][24] for x in points]), [[1, 0, 0], [0, 1, 0]], atol=1e-9)
        assert path.series["unstable_directions"][-1] == 2.0
        rows = [x["row"] for x in points]
        assert path.series["unstable_directions"][rows].tolist() == [1.0, 2.0]
    loads = np.array([critical(path, "bifurcation") for path in paths])
    np.testing.assert_allclose(loads[0], loads[1], rtol=1e-9)
    # EI to both sides, but for shear and shortening of some 1e-4
    np.testing.assert_allclose(5.0 * loads[0], np.array([1.0, 1.01]) * np.pi**2 / 4.0, rtol=1e-3)


def test_points_where_newtons_matrix_is_singular_are_located(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pinned arch: bifurcation before limit point on the way down and on the way up, the same at any size of the steps; all
    changes of the number of unstable directions are at critical points, which are equilibria as others are."""
    half = 0.6
    sin, cos = np.sin(half), np.cos(half)
    arch = fb.Beam.arc("arch", (-sin, 0, 0), (cos, 0, sin), (sin, 0, -cos), radius=1.0, angle=2 * half,
                       section=section(1e4, 1e4, 1.0, 1.0), elements=8)
    scene = fb.Scene(arch, fb.Pin(arch.start), fb.Pin(arch.end), fb.Load("top", arch.at(arch.length / 2), force=(0, 0, -30.0)))
    model = fb.compile_scene(scene, planar=True)
    left: list[float] = []
    record = path_walk.PathWalk.record

    def watch(self: Any, *arguments: Any) -> None:
        left.append(float(np.max(np.abs(self.solver.equations()[1]))) / 30.0)
        record(self, *arguments)

    monkeypatch.setattr(path_walk.PathWalk, "record", watch)
    loads = []
    for size in (0.1, 0.05):
        path = fb.solve_path(model, to=1.5, step=0.05, largest_step=size, most_points=300)
        points = path.info["critical_points"]
        assert [(x["kind"], x["type"]) for x in points] == [("bifurcation", "subcritical"), ("limit", "maximum"),
                                                            ("bifurcation", "subcritical"), ("limit", "minimum")]
        unstable = path.series["unstable_directions"]
        assert (np.flatnonzero(np.diff(unstable)) + 1).tolist() == [x["row"] for x in points]
        assert not [event for event in path.events if event["kind"] == "unresolved"]
        loads.append([x["load_factor"] for x in points])
    print(f"left of the equations: {max(left):.1e} of the load")
    assert max(left) < 1e-10
    np.testing.assert_allclose(loads[0], loads[1], rtol=1e-9)


def test_what_is_not_located_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """At the end of a path that looks for it by an error, behind steps that became shorter, else by an event. Where eigenvalues
    do not tell where they vanish, numbers of unstable directions do."""
    monkeypatch.setattr(critical_points.PathStep, "zero", lambda self, *_, **__: self.solver.restore(self.end))
    column = fb.Beam.straight("column", (0, 0, 0), (0, 0, 1), section=section(1e6, 1e6, 1.0), elements=4)
    scene = fb.Scene(column, fb.Clamp(column.start), fb.Load("press", column.end, force=(0, 0, -5.0)))
    model = fb.compile_scene(scene, planar=True)
    points = fb.solve_path(model).info["critical_points"]
    assert [x["kind"] for x in points] == ["bifurcation"]
    monkeypatch.setattr(critical_points.PathStep, "_bisected", lambda self, *_, **__: self.solver.restore(self.end))
    path = fb.solve_path(model)
    event = next(x for x in path.events if x["kind"] == "unresolved")
    assert "the number of unstable directions changes from 0 to 1, but the critical point was not located" in event["text"]
    assert path.info["critical_points"] == [] and 1e-5 < np.min(path.series["step_size"][1:]) < 3e-4
    with pytest.raises(fb.ConvergenceError, match="not located, where the path may have to end .stop_at='limit'") as caught:
        fb.solve_path(model, stop_at="limit")
    last = caught.value.result.series["load_factor"][-1]
    assert last == pytest.approx(np.pi**2 / 20.0, rel=1e-5) and last == pytest.approx(points[0]["load_factor"], rel=1e-6)


@pytest.mark.parametrize("lateral", [0.3, 0.003])
def test_the_limit_load_of_an_arch_next_to_another_branch(lateral: float) -> None:
    """A small load aside makes a limit point of a bifurcation, next to which another path begins. Stiffnesses and loads of the
    same ratio have the same load factor; short steps lead there; and statics finds the equilibrium below that load only."""
    def arch(k: float, factor: float = 1.0) -> fb.Model:
        cut = fb.Section(EA=1e4 * k, GA2=4e3 * k, GA3=4e3 * k, GJ=2.0 * k, EI2=k, EI3=4.0 * k, rhoA=0.1, rhoI2=1e-5,
                         rhoI3=1e-5)
        a = fb.Beam.straight("left", (-1, 0, 0), (0, 0, 0.15), section=cut, elements=2)
        b = fb.Beam.straight("right", (0, 0, 0.15), (1, 0, 0), section=cut, elements=2)
        load = fb.Load("weight", a.end, force=(lateral * k * factor, 0, -1.5 * k * factor))
        clamps = fb.Clamp(a.start), fb.Clamp(b.end)
        return fb.compile_scene(fb.Scene(a, b, fb.RigidConnection(a.end, b.start), *clamps, load), planar=True)

    model = arch(1.0)
    found = [fb.solve_path(x, to=20.0, stop_at="limit", **options) for x, options in (
        (model, {}), (arch(1.001), {}), (model, {"largest_step": 0.02, "step": 0.01}))]
    loads = np.array([x.series["load_factor"][-1] for x in found])
    np.testing.assert_allclose(loads, loads[0], rtol=1e-9)
    assert all(not x.series["unstable_directions"][:-1].any() and len(x.info["critical_points"]) == 1 for x in found)
    below, beyond = (fb.solve_static(arch(1.0, x * loads[0]), largest_load_step=0.02) for x in (0.9999, 1.0001))
    moves = [np.max(np.abs(x.state.q - found[0].state.q)) for x in (below, beyond)]
    # 0.002 below, 0.015 and more beyond
    assert moves[0] < 0.005 < moves[1] and below.info["unstable_directions"] == 0


@pytest.mark.parametrize(("slenderness", "aside"), [(300.0, 1e-6), (3e3, 1e-5), (1e4, 1e-4)])
def test_slender_columns_go_to_the_side_of_a_small_load(slenderness: float, aside: float) -> None:
    """Without that load the path meets another one. With K(k) = sqrt(P L^2/EI) the elastica goes
    2 k/sqrt(P L^2/EI) of its length aside (S. Timoshenko, J. Gere, 1961, section 2.7), and balances the moment at its foot."""
    stiff, load = slenderness**2, 1.1 * np.pi**2 / 4.0
    column = fb.Beam.straight("column", (0, 0, 0), (0, 0, 1), section=section(stiff, 0.4 * stiff, 4.0, 0.8, 1.0), elements=6,
                              degree=3, d2=(1, 0, 0))
    foot = fb.Clamp(column.start, name="foot")
    scene = fb.Scene(column, foot, fb.Load("press", column.end, force=(aside * load, 0, -load)))
    path = fb.solve_path(fb.compile_scene(scene), observe=["reaction"])
    assert path.info["critical_points"] == [] and path.events == [] and not path.series["unstable_directions"].any()
    x, _, z = path.state.q.reshape(-1, 12)[-1, :3]
    k = brentq(lambda k: ellipk(k**2) - np.sqrt(load), 0.1, 0.9)
    assert x == pytest.approx(2.0 * k / np.sqrt(load), rel=1e-3)
    assert path.reaction("foot")["moment"][-1, 1] == pytest.approx(-load * (x + aside * z), rel=1e-6)
