"""Linear buckling against exact columns, frames, strips and beams, in space, about loaded states, with joints and sliders."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parents[1]))
import column_scenes  # noqa: E402

L, EI = 2.0, 3e3


def section(slender: float, ratio: float = 2.0, GJ: float = 2e3, ei: float = EI) -> fb.Section:
    """A section whose EI2 is `ratio` times EI3 = ei, of a beam of this slenderness L/i about the softer axis."""
    EA = ei * slender**2 / L**2
    return fb.Section(EA=EA, GA2=0.4 * EA, GA3=0.4 * EA, GJ=GJ, EI2=ratio * ei, EI3=ei, rhoA=1.0, rhoI2=1e-3, rhoI3=1e-3)


def critical(of: fb.Section, k: float, ei: float, first: float = 0.0) -> float:
    """The load P of a column that has shortened under a first load only, P (1 - first/EA + P/GA) = EI k^2, k the wave number of
    its shape. In full P (1 - P/EA + P/GA) = EI k^2."""
    c = 1.0 - first / of.EA
    return float((np.sqrt(c**2 + 4.0 * ei * k * k / of.GA2) - c) / 2.0 * of.GA2)


def clamped_pinned(of: fb.Section, ei: float) -> float:
    """tan u = u, with shear: tan(u)/u = 1 - P/(GA + P), u^2 = P (1 + P/GA) L^2/EI."""
    def left(load: float) -> float:
        u = np.sqrt(load * (1.0 + load / of.GA2) / ei) * L
        return float(np.sin(u) / u - of.GA2 / (of.GA2 + load) * np.cos(u))

    euler = ei * (4.493409457909064 / L)**2
    return float(brentq(left, 0.8 * euler, 1.01 * euler, xtol=1e-13 * euler, rtol=1e-15))


def column(of: fb.Section, ends: str, elements: int = 16, load: float = 1.0) -> fb.Scene:
    """A column along z that bends along x about its softer axis; ends below and above: clamped, pinned, free, guided."""
    beam = fb.Beam.straight("column", (0, 0, 0), (0, 0, L), section=of, elements=elements, d2=(1, 0, 0))
    support: dict[str, list[Any]] = {
        "f": [], "p": [fb.Pin(beam.end, axes="xy")], "c": [fb.Clamp(beam.end, axes="xy")], "g": [fb.Clamp(beam.end, axes="y")]}
    fork = fb.UniversalJoint(fb.GROUND, beam.start, axis_a=(1, 0, 0), axis_b=(0, 1, 0))
    foot = fb.Clamp(beam.start) if ends[0] == "c" else fork
    return fb.Scene(beam, foot, *support[ends[1]], fb.Load("press", beam.end, force=(0, 0, -load)))


@pytest.mark.parametrize("slender", [30.0, 1000.0])
@pytest.mark.parametrize(("ends", "length"), [("cf", 2.0), ("pp", 1.0), ("cp", 0.0), ("cc", 0.5), ("cg", 1.0)])
def test_columns_of_five_supports_with_shear_and_shortening(ends: str, length: float, slender: float) -> None:
    of = section(slender)
    found = fb.critical_loads(fb.compile_scene(column(of, ends)), n=2 if ends != "cg" else 1)
    exact = [clamped_pinned(of, ei) if ends == "cp" else critical(of, np.pi / (length * L), ei) for ei in (EI, 2.0 * EI)]
    np.testing.assert_allclose(found.load_factors, exact[:len(found)], rtol=1e-7)
    assert found.is_complete and np.all(found.residuals < 1e-12) and found.info["conservative"]
    # the softer axis first: along x
    assert np.abs(found.displacements[0, :, 0]).max() == pytest.approx(1.0, rel=1e-3)
    assert np.abs(found.displacements[0, :, 1]).max() < 1e-6


def test_a_unit_load_has_a_factor_of_half_a_million() -> None:
    """And the hint of a path that cannot get there."""
    of = section(1e3, ei=480_000.0 * (2.0 * L / np.pi)**2)
    model = fb.compile_scene(column(of, "cf"))
    found = fb.critical_loads(model, n=1)
    assert found.load_factors[0] == pytest.approx(critical(of, 0.5 * np.pi / L, of.EI3), rel=1e-7)
    assert found.load_factors[0] == pytest.approx(480_000.0, rel=1e-5)
    path = fb.solve_path(model, to=1e6, most_points=3)
    text, = (event["text"] for event in path.events if event["kind"] == "stopped")
    assert "critical_loads" in text and "most_points" not in text


def test_a_rectangle_buckles_about_its_weak_axis_whatever_its_direction() -> None:
    steel = fb.Section.rectangle(height=0.004, width=0.002, E=2e11, rho=7850.0, nu=0.3)
    weak, strong = sorted((steel.EI2, steel.EI3))
    found = []
    for d2 in ((1, 0, 0), (0, 1, 0)):
        beam = fb.Beam.straight("column", (0, 0, 0), (0, 0, L), section=steel, elements=6, d2=d2)
        scene = fb.Scene(beam, fb.Clamp(beam.start), fb.Load("press", beam.end, force=(0, 0, -1.0)))
        found.append(fb.critical_loads(fb.compile_scene(scene), n=2))
        np.testing.assert_allclose(found[-1].load_factors, np.array([weak, strong]) * (0.5 * np.pi / L)**2, rtol=3e-6)
        assert found[-1].info["counted_in"] == "space" and found[-1].is_complete
    along = [np.argmax(np.abs(x.displacements[0]).max(axis=0)) for x in found]
    assert sorted(along) == [0, 1]


def test_a_state_leaves_the_rest_of_its_load() -> None:
    of = section(30.0)
    model = fb.compile_scene(column(of, "cf"))
    k = 0.5 * np.pi / L
    half = 0.5 * critical(of, k, EI)
    rest = fb.solve_path(model, to=half, step=1.0, largest_step=10.0, most_points=5000)
    found = fb.critical_loads(model, state=rest.state, load_factor=half, n=1)
    assert found.load_factors[0] == pytest.approx(critical(of, k, EI, half), rel=1e-8)
    assert found.change[0] == pytest.approx(found.load_factors[0] - half, rel=1e-12)
    with pytest.raises(fb.SceneError, match="not an equilibrium at load_factor=0; give the load factor"):
        fb.critical_loads(model, state=rest.state)


def test_states_nearer_to_the_exact_load_neglect_less() -> None:
    """The shortening that is left out: P (1 - P/EA + P/GA) = EI k^2 is exact."""
    of = section(30.0)
    k, c = 0.5 * np.pi / L, 1.0 / of.GA2 - 1.0 / of.EA
    exact = (np.sqrt(1.0 + 4.0 * c * EI * k * k) - 1.0) / (2.0 * c)
    model = fb.compile_scene(column(of, "cf", load=exact))
    errors = []
    for share in (0.0, 0.5, 0.75):
        state = fb.solve_path(model, to=share, stop_at="limit").state if share else None
        errors.append(fb.critical_loads(model, state=state, load_factor=share, n=1).load_factors[0] - 1.0)
    assert errors[0] == pytest.approx(critical(of, k, EI) / exact - 1.0, rel=1e-4)
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 1.0, atol=0.05)


@pytest.mark.parametrize("planar", ["auto", True])
def test_portal_frame(planar: Any) -> None:
    """tan u = -u/6 of a frame of equal bars with clamped feet that sways in its plane, across it earlier where it is thin."""
    of = section(5e3, ratio=0.1)
    soft = fb.Section(EA=of.EA, GA2=of.GA2, GA3=of.GA3, GJ=of.GJ, EI2=EI, EI3=0.1 * EI, rhoA=1.0, rhoI2=1e-3, rhoI3=1e-3)
    bars = [fb.Beam.straight(name, a, b, section=soft, elements=6, d2=(0, 1, 0)) for name, a, b in (
        ("left", (0, 0, 0), (0, 0, L)), ("right", (L, 0, 0), (L, 0, L)), ("beam", (0, 0, L), (L, 0, L)))]
    left, right, beam = bars
    scene = fb.Scene(*bars, fb.RigidConnection(left.end, beam.start), fb.RigidConnection(right.end, beam.end),
                     fb.Clamp(left.start), fb.Clamp(right.start), fb.Load("a", left.end, force=(0, 0, -1.0)),
                     fb.Load("b", right.end, force=(0, 0, -1.0)))
    u = brentq(lambda u: np.sin(u) + u / 6.0 * np.cos(u), 2.0, 3.0, xtol=1e-14)
    found = fb.critical_loads(fb.compile_scene(scene, planar=planar), n=1 if planar is True else 6)
    sways = np.abs(found.displacements[:, :, 1]).max(axis=1) < 1e-6
    assert found.info["counted_in"] == ("plane" if planar is True else "space") and found.is_complete
    assert found.load_factors[sways][0] == pytest.approx(EI * (u / L)**2, rel=1e-6)
    assert planar is True or not sways[0] and found.load_factors[0] < 0.2 * found.load_factors[sways][0]
    assert np.abs(found.displacements[sways][0, :, 0]).max() > 0.9 and found.motion_before[sways][0] < 1e-6


def test_a_column_under_a_strut_on_a_hinge() -> None:
    """tan u = u (1 + b/a) of the clamped part a below a strut of length b, whose top is guided."""
    of = section(5e3, ratio=20.0)
    a, b = L, 0.5 * L
    lower = fb.Beam.straight("lower", (0, 0, 0), (0, 0, a), section=of, elements=6, d2=(1, 0, 0))
    upper = fb.Beam.straight("upper", (0, 0, a), (0, 0, a + b), section=of, elements=6, d2=(1, 0, 0))
    hinge = fb.RevoluteJoint(lower.end, upper.start, "hinge", axis=(0, 1, 0))
    scene = fb.Scene(lower, upper, hinge, fb.Clamp(lower.start), fb.Pin(upper.end, axes="xy"),
                     fb.Load("press", upper.end, force=(0, 0, -1.0)))
    u = brentq(lambda u: np.sin(u) - u * (1.0 + b / a) * np.cos(u), 0.5, 1.5, xtol=1e-14)
    found = fb.critical_loads(fb.compile_scene(scene), n=1)
    assert found.load_factors[0] == pytest.approx(EI * (u / a)**2, rel=1e-6)


def test_a_roller_on_a_rail() -> None:
    """A slider with its multipliers holds the top of a clamped column across."""
    of = section(5e3)
    beam = fb.Beam.straight("column", (0, 0, 0), (0, 0, L), section=of, elements=8, d2=(1, 0, 0))
    stiff = fb.Section(EA=1e9, GA2=1e9, GA3=1e9, GJ=1e9, EI2=1e9, EI3=1e9, rhoA=1.0, rhoI2=1e-3, rhoI3=1e-3)
    rail = fb.Beam.straight("rail", (0, 0, L - 1), (0, 0, L + 1), section=stiff, elements=1, degree=1)
    scene = fb.Scene(beam, fb.Clamp(beam.start), rail, fb.Clamp(rail.start), fb.Clamp(rail.end),
                     fb.Slider("roller", beam.end, rail, at=1.0), fb.Load("press", beam.end, force=(0, 0, -1.0)))
    found = fb.critical_loads(fb.compile_scene(scene), n=1)
    assert found.load_factors[0] == pytest.approx(clamped_pinned(of, EI), rel=1e-6)


def test_lateral_buckling_of_a_strip_and_of_a_beam_under_end_moments() -> None:
    """Prandtl: 4.012599344 sqrt(EI GJ)/L^2 of a strip with a force at its end, pi/L sqrt(EI GJ) of a beam in forks: as in
    textbooks, the deflection before does not count."""
    of = fb.Section(EA=1e8, GA2=1e8, GA3=1e8, GJ=1.0, EI2=100.0, EI3=1.0, rhoA=1.0, rhoI2=1e-3, rhoI3=1e-3)
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=of, elements=16)
    strip = fb.Scene(beam, fb.Clamp(beam.start), fb.Load("tip", beam.end, force=(0, 0, -1.0)))
    forks = [fb.UniversalJoint(fb.GROUND, end, name, axis_a=(0, 1, 0), axis_b=(0, 0, 1))
             for name, end in (("left", beam.start), ("right", beam.end))]
    bent = fb.Scene(beam, *forks, fb.Load("a", beam.start, moment=(0, 1.0, 0)), fb.Load("b", beam.end, moment=(0, -1.0, 0)))
    one, other = (fb.critical_loads(fb.compile_scene(scene), n=1) for scene in (strip, bent))
    assert one.load_factors[0] == pytest.approx(4.012599344, rel=1e-6) and other.load_factors[0] == pytest.approx(np.pi, rel=1e-6)
    assert one.info["conservative"] and one.is_complete and not other.info["conservative"]
    assert [event["kind"] for event in other.events] == ["nonconservative"]


def test_heat_and_supports_that_move_press_a_column_between_walls() -> None:
    of = section(1e3)
    beam = fb.Beam.straight("column", (0, 0, 0), (0, 0, L), section=of, elements=16, d2=(1, 0, 0))
    wall = fb.Clamp(beam.end)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), wall))
    strain = critical(of, 2.0 * np.pi / L, EI) / of.EA
    hot = fb.critical_loads(model, prestrains={beam: -0.01}, n=1)
    pushed = fb.critical_loads(model, moves={wall: (0, 0, -0.01)}, n=1)
    assert 0.01 * hot.load_factors[0] == pytest.approx(strain, rel=1e-6)
    assert 0.01 * pushed.load_factors[0] == pytest.approx(strain * L, rel=1e-6)


def test_loads_the_other_way_round_and_loads_that_stay() -> None:
    of = section(5e3)
    k = 0.5 * np.pi / L
    beam = fb.Beam.straight("column", (0, 0, 0), (0, 0, L), section=of, elements=8, d2=(1, 0, 0))
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Load("pull", beam.end, force=(0, 0, 100.0))))
    found = fb.critical_loads(model, n=2, negative=True)
    np.testing.assert_allclose(100.0 * found.load_factors, [-EI * k * k, -2.0 * EI * k * k], rtol=1e-6)
    assert found.is_complete
    # a load that stays, and one that grows
    scene = fb.Scene(beam, fb.Clamp(beam.start), fb.Load("dead", beam.end, force=(0, 0, -1000.0)),
                     fb.Load("live", beam.end, force=(0, 0, -1.0), time=lambda t: t))
    model = fb.compile_scene(scene)
    dead = fb.solve_static(model, at_time=0.0)
    found = fb.critical_loads(model, state=dead.state, at_time=(0.0, 1.0), n=1)
    assert found.load_factors[0] == pytest.approx(EI * k * k - 1000.0, rel=1e-5)


def test_a_follower_load_has_no_divergence_and_says_where_to_look() -> None:
    of = section(1e3)
    beam = fb.Beam.straight("column", (0, 0, 0), (0, 0, L), section=of, elements=6, d2=(1, 0, 0))
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Load("push", beam.end, force=(-1.0, 0, 0), follower=True)))
    found = fb.critical_loads(model, n=1)
    assert len(found) == 0
    event = next(event for event in found.events if event["kind"] == "nonconservative")
    assert "flutter" in event["text"]


def test_what_moves_far_before_it_buckles_is_said() -> None:
    """A shallow arch has a limit point, which linear buckling does not see."""
    of = section(100.0)
    left = fb.Beam.straight("left", (-1, 0, 0), (0, 0, 0.1), section=of, elements=4)
    right = fb.Beam.straight("right", (0, 0, 0.1), (1, 0, 0), section=of, elements=4)
    scene = fb.Scene(left, right, fb.RigidConnection(left.end, right.start), fb.Pin(left.start), fb.Pin(right.end),
                     fb.Clamp(left.end, axes="y"), fb.Load("push", left.end, force=(0, 0, -1.0)))
    found = fb.critical_loads(fb.compile_scene(scene), n=1)
    assert found.motion_before[0] > 0.01
    assert ("unresolved" in {event["kind"] for event in found.events}) == (found.motion_before[0] > 0.05)


def test_modes_are_states_and_pictures() -> None:
    model = fb.compile_scene(column(section(1e3), "cf", elements=4))
    found = fb.critical_loads(model, n=2)
    moved = found.state(0, 0.01).q.reshape(-1, 4, 3)[:, 0] - found.positions
    np.testing.assert_allclose(moved, 0.01 * found.displacements[0], atol=1e-4)
    assert len(found.motion(0, frames=8).t_snap) == 8 and "load factor" in found.table() and len(found) == 2
    assert fb.plot_modes(found, n=2).axes
    with pytest.raises(fb.SceneError, match="mode 5 does not exist"):
        found.state(5, 0.1)


def test_rigid_bars_on_bushings() -> None:
    """Two of length L: P L/k = (3 -+ sqrt(5))/2, to all sides; the axes of the upper bushing turn with the lower bar."""
    k, stiff = 50.0, 1e9
    low, up = bars = [fb.RigidBody(name, mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0, 0, z * L))
                      for name, z in (("low", 0.5), ("up", 1.5))]
    rubber = (stiff, stiff, stiff, k, k, k)
    scene = fb.Scene(*bars, fb.Bushing(fb.GROUND.point((0, 0, 0)), low.point((0, 0, -0.5 * L)), stiffness=rubber),
                     fb.Bushing(low.point((0, 0, 0.5 * L)), up.point((0, 0, -0.5 * L)), stiffness=rubber),
                     fb.Load("press", up.point((0, 0, 0.5 * L)), force=(0, 0, -1.0)))
    found = fb.critical_loads(fb.compile_scene(scene), n=4)
    exact = k / L * (3.0 + np.array([-1.0, -1.0, 1.0, 1.0]) * np.sqrt(5.0)) / 2.0
    np.testing.assert_allclose(found.load_factors, exact, rtol=1e-6)


@pytest.mark.parametrize("law", [False, True])
def test_two_springs_in_line_snap_aside(law: bool) -> None:
    """P/a + P/b = c of two springs of lengths a and b in line and one across, each with half of the load on the point between."""
    a, b, c, stiff = 1.0, 2.0, 30.0, 1e6
    mass = fb.PointMass("point", mass=1.0, position=(0, 0, 0))
    more = {"table": ([-1.0, 0.0, 1.0], [-stiff, 0.0, stiff])} if law else {"stiffness": stiff}
    top = fb.PointMass("top", mass=1.0, position=(0, 0, b))
    scene = fb.Scene(mass, top, fb.Pin(top, axes="xy"), fb.Spring(fb.GROUND.point((0, 0, -a)), mass, "lower", **more),
                     fb.Spring(mass, top, "upper", **more), fb.Spring(fb.GROUND.point((1, 0, 0)), mass, "x", stiffness=c),
                     fb.Spring(fb.GROUND.point((0, 1, 0)), mass, "y", stiffness=2.0 * c),
                     fb.Load("press", top, force=(0, 0, -1.0)))
    found = fb.critical_loads(fb.compile_scene(scene), n=2)
    np.testing.assert_allclose(found.load_factors, np.array([c, 2.0 * c]) / (1.0 / a + 1.0 / b), rtol=1e-6)


def test_a_frame_that_hardly_moves_buckles_where_its_path_branches() -> None:
    of = section(2e3)
    left, right = (fb.Beam.straight(name, (x, 0, 0), (x, 0, L), section=of, elements=6, d2=(1, 0, 0))
                   for name, x in (("left", 0.0), ("right", 0.7 * L)))
    rope = fb.PointMass("ring", mass=1.0, position=(0.7 * L, 0, L))
    scene = fb.Scene(left, right, rope, fb.Clamp(left.start), fb.Clamp(right.start), fb.BallJoint(right.end, rope),
                     fb.Spring(left.end, rope, "tie", stiffness=5e3), fb.Load("a", left.end, force=(0, 0, -800.0)),
                     fb.Load("b", right.end, force=(0, 0, -300.0)))
    model = fb.compile_scene(scene)
    path = fb.solve_path(model, to=5.0, stop_at="bifurcation")
    at = path.info["critical_points"][-1]["load_factor"]
    found = fb.critical_loads(model, n=1)
    assert found.load_factors[0] == pytest.approx(at, rel=1e-5)
    mode = np.array(path.info["critical_points"][-1]["mode"])
    assert abs(np.sum(mode * found.displacements[0])) > 0.9999 * np.linalg.norm(mode) * np.linalg.norm(found.displacements[0])


def test_a_bar_below_a_strut_that_is_a_spring() -> None:
    """P = k/(L + L^2/b) of a bar of length L on a bushing, under a strut of length b on its end."""
    k, b = 50.0, 0.5 * L
    bar = fb.RigidBody("bar", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0, 0, 0.3 * L))
    top, rubber = fb.PointMass("top", mass=1.0, position=(0, 0, L + b)), (1e9, 1e9, 1e9, k, 3.0 * k, k)
    scene = fb.Scene(bar, top, fb.Pin(top, axes="xy"),
                     fb.Bushing(fb.GROUND.point((0, 0, 0)), bar.point((0, 0, -0.3 * L)), stiffness=rubber),
                     fb.Spring(bar.point((0, 0, 0.7 * L)), top, "strut", stiffness=1e8),
                     fb.Load("press", top, force=(0, 0, -1.0)))
    found = fb.critical_loads(fb.compile_scene(scene), n=2)
    np.testing.assert_allclose(found.load_factors, np.array([1.0, 3.0]) * k / (L + L * L / b), rtol=1e-6)


@pytest.mark.parametrize("joint", ["slider", "ball"])
def test_a_load_that_comes_through_a_contact(joint: str) -> None:
    """A strip that buckles aside under a ring on it, or under a mass on a ball joint, as under the same force on its node."""
    of = fb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=1.0, EI2=100.0, EI3=1.0, rhoA=1.0, rhoI2=1e-3, rhoI3=1e-3)
    beam = fb.Beam.straight("strip", (0, 0, 0), (1, 0, 0), section=of, elements=5)
    ring = fb.PointMass("ring", mass=1.0, position=(0.8, 0, 0))
    contact = fb.Slider("eye", ring, beam, at=0.8) if joint == "slider" else fb.BallJoint(beam.at(0.8), ring)
    through = fb.Scene(beam, fb.Clamp(beam.start), ring, contact, fb.Load("weight", ring, force=(0, 0, -1.0)))
    same = fb.Scene(beam, fb.Clamp(beam.start), fb.Load("weight", beam.at(0.8), force=(0, 0, -1.0)))
    one, other = (fb.critical_loads(fb.compile_scene(scene), n=1, held=scene is through and joint == "slider", negative=True)
                  for scene in (through, same))
    assert abs(one.load_factors[0]) == pytest.approx(abs(other.load_factors[0]), rel=1e-8)
    assert one.info["held_sliders"] == (["eye"] if joint == "slider" else [])


@pytest.mark.parametrize("seed", [1, 2, 3, 5, 6, 10])
def test_random_columns_with_struts_that_spin_and_bodies_that_hang(seed: int) -> None:
    """Free motions without loads, which they hold or do not: the body hangs, the strut spins about its axis at any load."""
    of = column_scenes.drawn(seed, most_elements=32, most_slender=1000.0)
    found = fb.critical_loads(fb.compile_scene(of.scene, planar=of.planar), n=1)
    u = min(x.min() for x in of._roots()[:1 if of.planar else 2])
    euler, shear = of.stiffness * (u / of.length)**2, 0.4 * of.stiffness * of.slenderness**2 / of.length**2
    exact = 0.5 * shear * (np.sqrt(1.0 + 4.0 * euler / shear) - 1.0)
    # shear of columns that are held at their tops counts a little less
    assert found.load_factors[0] * of.force == pytest.approx(exact, rel=2e-6 if of.kind in ("bare", "body") else 1e-4)
    assert found.is_complete


def test_load_factors_do_not_depend_on_units() -> None:
    found = []
    for length, force in ((1.0, 1.0), (1e3, 1e-3)):
        bends = force * length**2
        of = fb.Section(EA=1e6 * force, GA2=4e5 * force, GA3=4e5 * force, GJ=20.0 * bends, EI2=300.0 * bends, EI3=50.0 * bends,
                        rhoA=1.0, rhoI2=1e-3, rhoI3=1e-3)
        post = fb.Beam.straight("post", (0, 0, 0), (0, 0, 2.0 * length), section=of, elements=4)
        arm = fb.Beam.straight("arm", (0, 0, 2.0 * length), (0.7 * length, 0, 2.0 * length), section=of, elements=3)
        tie = fb.Spring(arm.end, fb.GROUND.point((0.5 * length, 0.3 * length, 0)), "tie", stiffness=100.0 * force / length)
        scene = fb.Scene(post, arm, fb.RigidConnection(post.end, arm.start), fb.Clamp(post.start), tie,
                         fb.Load("weight", post.end, force=(0, 0, -force)))
        found.append(fb.critical_loads(fb.compile_scene(scene), n=3))
    np.testing.assert_allclose(found[0].load_factors, found[1].load_factors, rtol=1e-9)
    # next to motions of 1; stiffnesses of 1e6 beside 20 round them to 5e-13
    np.testing.assert_allclose(found[0].motion_before, found[1].motion_before, rtol=0.0, atol=3e-12)


@pytest.mark.parametrize("below", [True, False])
def test_a_body_above_its_joint_topples_at_once(below: bool) -> None:
    """One that hangs below it does not."""
    of = section(1e3)
    beam = fb.Beam.straight("column", (0, 0, 0), (0, 0, L), section=of, elements=6, d2=(1, 0, 0))
    z = L - 0.5 if below else L + 0.5
    body = fb.RigidBody("body", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0, 0, z))
    scene = fb.Scene(beam, fb.Clamp(beam.start), body, fb.BallJoint(beam.end, body.point((0, 0, L - z))), gravity=(0, 0, -9.81))
    found = fb.critical_loads(fb.compile_scene(scene), n=1)
    assert found.info["toppling"] == (0 if below else 2) and found.is_complete == below
    assert ["grow under the smallest" in event["text"] for event in found.events] == ([] if below else [True])
