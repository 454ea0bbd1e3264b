"""Numbers of unstable and free directions, and kinds of critical points, where they are known."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from column_scenes import counted, drawn

import fastbeam as fb

GRAVITY = (0.0, 0.0, -9.81)


def section(EA: float = 1e4) -> fb.Section:
    return fb.Section(EA=EA, GA2=0.5 * EA, GA3=0.5 * EA, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=0.1, rhoI2=1e-4, rhoI3=1e-4)


def bar(name: str, start: Any, end: Any) -> fb.Beam:
    return fb.Beam.straight(name, start, end, section=section(), elements=4)


def on_a_cantilever(center: tuple[float, float, float], inertia: tuple[float, float, float] = (0.01, 0.02, 0.03)) -> list[Any]:
    """A body on a ball joint at the end of a clamped beam, at (1, 0, 0)."""
    beam, body = bar("beam", (0, 0, 0), (1, 0, 0)), fb.RigidBody("body", mass=0.1, inertia=inertia, position=center)
    return [beam, fb.Clamp(beam.start), body, fb.BallJoint(beam.end, body.point(tuple(np.subtract((1, 0, 0), center))))]


def chain() -> list[Any]:
    """Two bars that hang from a clamped one, one below the other."""
    beam, upper = bar("beam", (0, 0, 0), (1, 0, 0)), bar("upper", (1, 0, 0), (1, 0, -1))
    lower = bar("lower", (1, 0, -1), (1, 0, -2))
    return [beam, fb.Clamp(beam.start), upper, lower, fb.BallJoint(beam.end, upper.start), fb.BallJoint(upper.end, lower.start)]


def welded_strut() -> list[Any]:
    """A column that is loaded beyond pi^2/4, held in one direction by a strut of two bars welded in line, one drawn backwards."""
    column = fb.Beam.straight("column", (0, 0, 0), (0, 0, 1), section=section(), elements=8)
    left, right = bar("left", (0, 0, 1), (1, 0, 1)), bar("right", (2, 0, 1), (1, 0, 1))
    return [column, fb.Clamp(column.start), left, right, fb.BallJoint(column.end, left.start),
            fb.RigidConnection(left.end, right.end), fb.Pin(right.start), fb.Load("P", column.end, force=(0, 0, -3.0))]


def arc() -> list[Any]:
    """An arc without load between two points that hold it: it turns about its chord."""
    beam = bar("beam", (0, 0, -1), (0, 0, 0))
    bow = fb.Beam.arc("bow", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=1.0, angle=1.5, section=section(), elements=4)
    return [beam, bow, fb.Clamp(beam.start), fb.BallJoint(beam.end, bow.start), fb.Pin(bow.end)]


# scene, gravity, unstable directions, names of free motions
TABLE = {
    "a body hangs": (on_a_cantilever((1, 0, -0.5)), GRAVITY, 0, ["body 'body' about (0, 0, 1)"]),
    "a body stands": (on_a_cantilever((1, 0, 0.5)), GRAVITY, 2, ["body 'body' about (0, 0, 1)"]),
    "a body at its centre": (on_a_cantilever((1, 0, 0)), GRAVITY, 0, [f"body 'body' about {axis}" for axis in
                                                                      ("(0, 0, 1)", "(0, 1, 0)", "(1, 0, 0)")]),
    "bars hang": (chain(), GRAVITY, 0, ["beam 'lower' about its axis", "beam 'upper' about its axis"]),
    "a strut": (welded_strut(), (0, 0, 0), 1, ["beam 'left' and what is joined to it about their axes"]),
    "an arc": (arc(), (0, 0, 0), 0, [f"beam 'bow' about ({np.cos(0.75):.3g}, {np.sin(0.75):.3g}, 0)"]),
}


@pytest.mark.parametrize("planar", ["auto", False])
@pytest.mark.parametrize("name", TABLE)
def test_what_nothing_resists_is_named_and_statics_go_on(name: str, planar: Any) -> None:
    """Spins about an axis and turns about joints are neither unstable nor the end of load steps."""
    parts, gravity, unstable, motions = TABLE[name]
    result = fb.solve_static(fb.compile_scene(fb.Scene(*parts, gravity=gravity), planar=planar))
    assert (result.info["unstable_directions"], result.info["free_directions"]) == (unstable, len(motions))
    assert sorted(result.info["free_motions"]) == motions
    texts = [event["text"] for event in result.events if event["kind"] == "free"]
    assert len(texts) == 1 and all(motion in texts[0] for motion in motions)


@pytest.mark.parametrize("seed", range(12))
def test_columns_of_any_slenderness_have_as_many_unstable_directions_as_modes_below_their_load(seed: int) -> None:
    """Exact, from P (1 - P/EA + P/GA) = EI u^2/L^2 with cos u = 0 or tan u = u."""
    column = drawn(seed, 200)
    assert counted(column) == (column.unstable, column.free)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12, 44))
def test_many_columns_with_up_to_2048_elements(seed: int) -> None:
    """Two hundred of them: perf/stress/counts.py."""
    column = drawn(seed)
    assert counted(column) == (column.unstable, column.free)


def test_a_slender_column_of_many_elements_below_and_above_its_buckling_load() -> None:
    """The lowest eigenvalue is 1e-17 of the stiffness of an element, less than round-off."""
    column = drawn(0)._replace(kind="bare", slenderness=1e5, ratio=1.0, elements=512, degree=3, planar=False)
    assert [counted(column._replace(load=load)) for load in (0.9, 1.1)] == [(0, 0), (2, 0)]


def slender_arch(half: float, load: float, EA: float, elements: int) -> fb.Scene:
    """Build an arch clamped at one end and hinged at the other, with a load on its crown. Limit loads: 8.97 EI/R^2 at 215 degrees
    (D. A. DaDeppo, R. Schmidt, J. Appl. Mech. 42, 1975), 7.58 at 220 and 5.72 at 230 degrees as of arches less slender."""
    a = np.radians(half)
    sin, cos = np.sin(a), np.cos(a)
    arch = fb.Beam.arc("arch", (-sin, cos, 0), (cos, sin, 0), (sin, -cos, 0), radius=1.0, angle=2.0 * a, section=section(EA),
                       elements=elements)
    crown = fb.Load("crown", arch.at(arch.length / 2), force=(0, -load, 0))
    return fb.Scene(arch, fb.Pin(arch.start), fb.Clamp(arch.end), crown)


def test_bifurcations_of_slender_arches_are_located_where_round_off_hides_eigenvalues() -> None:
    """Out of its plane an arch buckles at a tenth of its limit load; round-off hides the eigenvalue."""
    path = fb.solve_path(fb.compile_scene(slender_arch(110.0, 7.58, 5e9, 24)), to=1.8, stop_at="limit")
    assert [point["kind"] for point in path.info["critical_points"]] == ["bifurcation", "bifurcation", "limit"]
    # that of an arch that is less slender, EA = 1e6; round-off of axial forces moves it by 1.2e-4
    assert path.info["critical_points"][0]["load_factor"] == pytest.approx(0.0976017, rel=4e-4)
    assert path.series["load_factor"][-1] == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("half, load, EA, elements", [(107.5, 8.97, 5e9, 12), (115.0, 5.72, 1e10, 24)])
def test_limit_points_of_slender_arches_are_limit_points(half: float, load: float, EA: float, elements: int) -> None:
    path = fb.solve_path(fb.compile_scene(slender_arch(half, load, EA, elements), planar=True), to=1.8, stop_at="limit")
    assert [point["kind"] for point in path.info["critical_points"]] == ["limit"]
    assert not [event for event in path.events if event["kind"] == "unresolved"]
    assert path.series["load_factor"][-1] == pytest.approx(1.0, abs=2e-3)
    assert path.series["unstable_directions"][-1] == 1
