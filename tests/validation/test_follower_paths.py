"""Paths of equilibria under loads that turn with what they act on: tangents are not symmetric (theory.md 12)."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root

import fastbeam as fb

EI = 1.0


def section(EA: float, GA: float) -> fb.Section:
    return fb.Section(EA=EA, GA2=GA, GA3=GA, GJ=1.0, EI2=EI, EI3=EI, rhoA=1.0, rhoI2=1e-4, rhoI3=1e-4)


def shape(start: Any, pieces: Any, EA: float, GA: float) -> np.ndarray:
    """x, y, angle of d1, moment at the end of a planar rod (M' = -(r' x n), strains by N, Q, M): `start` at its begin, pieces of
    (length, curvature, force n) one after the other."""
    y = np.array(start, float)
    for length, curvature, force in pieces:
        n = np.array(force(y) if callable(force) else force)

        def rates(s: float, y: Any, n: Any = n, curvature: float = curvature) -> Any:
            d1, d2 = np.array([np.cos(y[2]), np.sin(y[2])]), np.array([-np.sin(y[2]), np.cos(y[2])])
            r = (1.0 + n @ d1 / EA) * d1 + n @ d2 / GA * d2
            return [*r, y[3] / EI + curvature, -(r[0] * n[1] - r[1] * n[0])]

        y = solve_ivp(rates, (0.0, length), y, method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    return y


@pytest.mark.parametrize("planar", [False, "auto"])
def test_a_cantilever_whose_end_force_follows_rolls_up(planar: Any) -> None:
    """Two rows against the exact rod with stretch and shear, until its end points backwards."""
    EA = GA = 1e4
    rod = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), d2=(0, 1, 0), section=section(EA, GA), elements=32)
    push = fb.Load("push", rod.end, force=(0.0, 16.0, 0.0), follower=True)
    model = fb.compile_scene(fb.Scene(rod, fb.Clamp(rod.start), push), planar=planar)
    path = fb.solve_path(model, points={"tip": rod.end}, largest_step=0.5, step=0.2)
    assert path.series["load_factor"][-1] == 1.0
    angles = []
    for row in (len(path.t) // 2, len(path.t) - 1):
        size = 16.0 * path.series["load_factor"][row]

        def left(x: Any, size: float = size) -> Any:
            way = size * np.array([-np.sin(x[0]), np.cos(x[0])])
            end = shape((0, 0, 0, x[1]), [(1.0, 0.0, way)], EA, GA)
            return end[2] - x[0], end[3]

        d1 = path.directors[row, -1, 0]
        guess = float(np.mod(np.arctan2(d1[1], d1[0]), 2.0 * np.pi))
        found = root(left, [guess, size * 0.5], tol=1e-12)
        assert found.success
        way = size * np.array([-np.sin(found.x[0]), np.cos(found.x[0])])
        end = shape((0, 0, 0, found.x[1]), [(1.0, 0.0, way)], EA, GA)
        np.testing.assert_allclose(path.point("tip")[row, :2], end[:2], atol=1e-8)
        angles.append(end[2])
    assert angles[-1] > 3.09


@pytest.mark.parametrize("planar", [False, "auto"])
def test_a_column_under_a_load_that_follows_in_part_buckles_where_it_diverges(planar: Any) -> None:
    """A share w of the thrust follows, w < 1/2: cos kL = -w/(1 - w), k^2 = P (1 - P/EA + P/GA)/EI, beyond it buckles neither way
    that a potential tells."""
    EA, GA, share, P = 400.0, 150.0, 0.4, 8.0
    column = fb.Beam.straight("column", (0, 0, 0), (0, 0, 1), section=section(EA, GA), elements=16)
    # d1 points along the column
    turns = fb.Load("turns", column.end, force=(-share * P, 0, 0), follower=True)
    stays = fb.Load("stays", column.end, force=(0, 0, -(1.0 - share) * P))
    parts: list[Any] = [column, fb.Clamp(column.start), turns, stays]
    if not planar:
        # in space it would bend to both sides at once
        wide = fb.Section(EA=EA, GA2=GA, GA3=GA, GJ=1.0, EI2=EI, EI3=3.0 * EI, rhoA=1.0, rhoI2=1e-4, rhoI3=1e-4)
        column = fb.Beam.straight("column", (0, 0, 0), (0, 0, 1), section=wide, elements=16)
        parts = [column, fb.Clamp(column.start), fb.Load("turns", column.end, force=(-share * P, 0, 0), follower=True),
                 fb.Load("stays", column.end, force=(0, 0, -(1.0 - share) * P))]
    model = fb.compile_scene(fb.Scene(*parts), planar=planar)
    assert (model.plane is None) == (planar is False)
    k = np.arccos(-share / (1.0 - share))
    exact = brentq(lambda p: p * (1.0 - p / EA + p / GA) - k * k * EI, 1.0, 8.0, xtol=1e-14)
    at = fb.solve_path(model, stop_at="bifurcation")
    assert P * at.info["critical_points"][-1]["load_factor"] == pytest.approx(exact, rel=1e-9)
    assert np.all(at.series["unstable_directions"][:-1] == 0.0)
    factor = float(at.series["load_factor"][-1])
    beyond = fb.solve_path(model, start=at.state, load_factor=factor, to=factor + 0.1)
    # a round column to all sides
    assert beyond.series["unstable_directions"][-1] == (1.0 if planar is False else 2.0)
    bent = fb.solve_path(model, start=at.state, load_factor=factor, side=1, to=factor + 0.05, points={"tip": column.end})
    assert np.linalg.norm(bent.point("tip")[-1, :2]) > 0.1
    assert not at.info["conservative"] and "no potential" in at.events[-1]["text"]


@pytest.mark.parametrize(("bending", "size"), [
    ([(1.0, 1.1), (1.02, 1.2), (1.05, 1.4)], 0.5), ([(1.0, 1.0001), (1.00003, 1.3)], 0.1), ([(1.0, 1.0), (1.05, 1.05)], 0.5)])
def test_all_bifurcations_within_a_step_are_found_without_symmetry(bending: list[tuple[float, float]], size: float) -> None:
    """Columns side by side, whose thrust follows in part: both axes of each at cos kL = -w/(1 - w), in order."""
    EA, GA, share, P = 4000.0, 1500.0, 0.4, 8.0
    k = np.arccos(-share / (1.0 - share))
    parts: list[Any] = []
    for j, (EI2, EI3) in enumerate(bending):
        cut = fb.Section(EA=EA, GA2=GA, GA3=GA, GJ=1.0, EI2=EI2, EI3=EI3, rhoA=1.0, rhoI2=1e-4, rhoI3=1e-4)
        column = fb.Beam.straight(f"column {j}", (2.0 * j, 0, 0), (2.0 * j, 0, 1), section=cut, elements=6)
        parts += [column, fb.Clamp(column.start), fb.Load(f"turns {j}", column.end, force=(-share * P, 0, 0), follower=True),
                  fb.Load(f"stays {j}", column.end, force=(0, 0, -(1.0 - share) * P))]
    path = fb.solve_path(fb.compile_scene(fb.Scene(*parts)), to=0.95, largest_step=size, step=size)
    # those of round columns are double
    exact = [brentq(lambda p, x=x: p * (1.0 - p / EA + p / GA) - k * k * x, 1.0, 20.0, xtol=1e-14) / P
             for x in sorted({y for pair in bending for y in pair})]
    points = path.info["critical_points"]
    np.testing.assert_allclose([x["load_factor"] for x in points], exact, rtol=2e-6)
    assert [x["type"] for x in points] == ["multiple" if len(exact) == len(bending) else "supercritical"] * len(exact)
    assert path.series["unstable_directions"][-1] == 2 * len(bending) and {x["kind"] for x in path.events} == {
        "bifurcation", "nonconservative"}


def test_an_arch_snaps_under_a_load_that_follows() -> None:
    """Clamped and pinned, 215 degrees: its limit load against the largest force of the exact rod, all along its own path."""
    EA = GA = 2e4
    half = np.deg2rad(107.5)
    start, tangent = (-np.sin(half), np.cos(half), 0), (np.cos(half), np.sin(half), 0)
    arch = fb.Beam.arc("arch", start, tangent, (np.sin(half), -np.cos(half), 0), radius=1.0, angle=2 * half,
                       section=section(EA, GA), elements=96)
    # d2 points to the centre
    load = fb.Load("top", arch.at(arch.length / 2), force=(0, 10.0, 0), follower=True)
    model = fb.compile_scene(fb.Scene(arch, fb.Clamp(arch.start), fb.Pin(arch.end), load))
    path = fb.solve_path(model, stop_at="limit", points={"start": (arch, 0.0)}, observe=("section", "reaction"))
    factor = path.info["critical_points"][-1]["load_factor"]
    rows = path.series
    end = np.array([np.sin(half), np.cos(half)])

    def left(x: Any, size: float) -> Any:
        """x: force and moment at the start."""
        n = x[:2]

        # the centre is to the right: curvature -1, d2 of the beam points there
        got = shape((*start[:2], half, x[2]), [(half, -1.0, n), (half, -1.0, lambda y: n + size * np.array(
            [-np.sin(y[2]), np.cos(y[2])]))], EA, GA)
        return np.append(got[:2] - end, got[3])

    force = path.reaction("clamp of beam 'arch' node 0")
    guess = np.append(-force["force"][-1, :2], -force["moment"][-1, 2])
    # the matrix of shooting is singular at the limit load
    step = 1e-6

    def jacobian(x: Any, size: float) -> Any:
        return np.stack([(left(x + step * e, size) - left(x - step * e, size)) / (2.0 * step) for e in np.eye(3)], axis=1)

    found = root(lambda z: np.append(left(z[:3], z[3]), np.linalg.det(jacobian(z[:3], z[3]))), [*guess, 10.0 * factor], tol=1e-12)
    # round-off of a determinant of differences, which on some processors ends the iteration before it meets 1e-12
    assert np.max(np.abs(found.fun)) < 1e-8, found.message
    assert 10.0 * factor == pytest.approx(found.x[3], rel=5e-9)
    assert rows["load_factor"][-1] == factor


def test_a_ring_under_pressure_that_follows_buckles() -> None:
    """3 EI/R^3 (M. Levy, 1884), of a quarter; with the shortening of the ring."""
    stiff = 1e6
    quarter = fb.Beam.arc("quarter", (1, 0, 0), (0, 1, 0), (-1, 0, 0), radius=1.0, angle=np.pi / 2.0,
                          section=section(stiff, stiff), elements=16)
    load = fb.DistributedLoad("pressure", quarter, force=(0, 5.0, 0), follower=True)
    ends = fb.Clamp(quarter.start, axes="yz"), fb.Clamp(quarter.end, axes="xz")
    model = fb.compile_scene(fb.Scene(quarter, load, *ends), planar="auto")
    at = fb.solve_path(model, stop_at="bifurcation", step=0.2, largest_step=0.2)
    assert 5.0 * at.series["load_factor"][-1] == pytest.approx(3.0, rel=1e-5)


def test_a_load_that_follows_from_one_time_to_another() -> None:
    rod = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=section(1e4, 1e4), elements=4)
    parts = rod, fb.Clamp(rod.start), fb.Load("stays", rod.end, force=(0, 1.0, 0), follower=True)
    grows = fb.Load("grows", rod.end, force=(0, 0, 2.0), follower=True, time=lambda t: t - 1.0)
    model = fb.compile_scene(fb.Scene(*parts, grows))
    begin = fb.solve_static(model, at_time=1.5)
    path = fb.solve_path(model, start=begin.state, at_time=(1.5, 3.0), observe=("reaction",))
    whole = fb.solve_static(model, at_time=3.0, observe=("reaction",))
    clamp = "clamp of beam 'rod' node 0"
    for part in ("force", "moment"):
        np.testing.assert_allclose(path.reaction(clamp)[part][-1], whole.reaction(clamp)[part][-1], atol=1e-9)
        np.testing.assert_allclose(path.reaction(clamp)[part][0], fb.solve_static(
            model, at_time=1.5, observe=("reaction",)).reaction(clamp)[part][-1], atol=1e-9)
    np.testing.assert_allclose(path.state.q, whole.state.q, atol=1e-11)
    part = fb.solve_path(model, at_time=3.0, to=0.5)
    levels = fb.solve_static(model, at_time=3.0, levels=(0.5,), points={"tip": rod.end})
    half = levels.point("tip")[np.flatnonzero(levels.t == 0.5)[0]]
    np.testing.assert_allclose(part.state.q.reshape(-1, 12)[-1, :3], half, atol=1e-11)
    with pytest.raises(fb.SceneError, match="the start carries loads already"):
        fb.solve_path(model, at_time=(1.5, 3.0))
    with pytest.raises(fb.SceneError, match="give the time with at_time="):
        fb.solve_path(model)


def test_a_law_of_ones_own_grows_along_a_path_where_it_is_a_load() -> None:
    def pull(t: float, position: Any, directors: Any, velocity: Any, spin: Any, parameters: Any, force: Any, moment: Any) -> None:
        force[1] = t * parameters[0] * position[0]

    rod = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=section(1e4, 1e4), elements=4)
    model, stays = (fb.compile_scene(fb.Scene(
        rod, fb.Clamp(rod.start), fb.UserForce("law", rod.end, pull, parameters=(2.0,), grows=grows),
        fb.Load("push", rod.end, force=(0, 0, 0.1)))) for grows in (True, False))
    path = fb.solve_path(model, at_time=1.5)
    np.testing.assert_allclose(path.state.q, fb.solve_static(model, at_time=1.5).state.q, atol=1e-11)
    with pytest.raises(fb.SceneError, match="user force 'law' has a user-defined law"):
        fb.solve_path(model, at_time=(0.0, 1.0))
    # levels of statics: half of what grows, all of what does not
    for one, share in ((model, 0.5), (stays, 1.0)):
        levels = fb.solve_static(one, at_time=1.5, levels=(0.5,), observe=("reaction",), points={"tip": rod.end})
        row = np.flatnonzero(levels.t == 0.5)[0]
        held, at = levels.reaction("clamp of beam 'rod' node 0")["force"][row], levels.point("tip")[row, 0]
        np.testing.assert_allclose(held, (0.0, -share * 3.0 * at, -0.05), rtol=0, atol=1e-9)
    with pytest.raises(fb.SceneError, match="user forces that do not grow act at the start"):
        fb.solve_path(stays, at_time=1.5)


def test_a_foundation_by_a_law_stays_while_the_load_of_a_column_grows() -> None:
    """EI d^4w/dx^4 + P d^2w/dx^2 + k w = 0 between clamps: the lowest P with a symmetric solution."""
    k = 400.0

    def bed(t: float, position: Any, directors: Any, velocity: Any, spin: Any, parameters: Any, force: Any, moment: Any) -> None:
        force[2] = -parameters[0] * position[2]

    def left(P: float) -> float:
        r = np.sqrt(0.5 * (P + np.array([1.0, -1.0]) * np.sqrt(P * P - 4.0 * k * EI)) / EI)
        c, s = np.cos(0.5 * r), np.sin(0.5 * r)
        return float(c[1] * r[0] * s[0] - c[0] * r[1] * s[1])

    exact = brentq(left, 60.0, 80.0, xtol=1e-12)
    wide = fb.Section(EA=1e7, GA2=1e7, GA3=1e7, GJ=1.0, EI2=EI, EI3=9.0 * EI, rhoA=1.0, rhoI2=1e-4, rhoI3=1e-4)
    column = fb.Beam.straight("column", (0, 0, 0), (1, 0, 0), section=wide, elements=12)
    push = fb.Load("push", column.end, force=(-exact, 0, 0))
    bedding = fb.UserForce("bed", column, bed, parameters=(k,), dissipates=False)
    ends = fb.Clamp(column.start), fb.Clamp(column.end, axes="yz")
    model = fb.compile_scene(fb.Scene(column, *ends, push, bedding), planar=False)
    at = fb.solve_path(model, to=2.0, stop_at="bifurcation")
    assert at.series["load_factor"][-1] == pytest.approx(1.0, abs=1e-5)
