"""Paths in a plane tell of equilibria that are unstable out of it: against paths and modes in space, and exact loads."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb

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


def told(result: fb.Result) -> list[dict[str, Any]]:
    return [event for event in result.events if event["kind"] == "unstable"]


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_lateral_buckling_of_a_strip(angle: float) -> None:
    """From the first row beyond P L^2 = 4.0126 sqrt(EI GJ) on (S. Timoshenko, J. Gere, 1961, section 6.3)."""
    model = strip(8.0, angle=angle)
    path = fb.solve_path(model)
    assert model.plane is not None and not np.any(path.series["unstable_directions"]) and path.info["counted_in"] == "plane"
    [event] = told(path)
    row = event["row"]
    assert 8.0 * path.series["load_factor"][row - 1] < LATERAL < 8.0 * path.series["load_factor"][row]
    assert event["directions"] == 1 and event["time"] == path.t[row] and path.info["unstable_out_of_plane"] == 1
    assert f"from row {row} (load factor 0.525) on are unstable" in event["text"] and "planar=False" in event["text"]
    # the same rows in space meet the point there
    found = fb.solve_path(strip(8.0, planar=False, angle=angle), stop_at="bifurcation")
    assert path.series["load_factor"][row - 1] < found.series["load_factor"][-1] < path.series["load_factor"][row]


@pytest.mark.parametrize("force", [3.9, 4.2, 9.5, 14.0])
def test_the_number_is_that_of_modes_that_grow(force: float) -> None:
    model = strip(force)
    path = fb.solve_path(model, largest_step=0.5, step=0.5)
    n = fb.modes(model, state=path.state, n=6).unstable
    assert path.info["unstable_out_of_plane"] == n == sum(force > x for x in (LATERAL, 10.25))
    assert len(told(path)) == (n > 0) and fb.solve_static(model).info["unstable_directions"] == n


def test_a_window_between_stable_ends() -> None:
    """Two beams that snap through would go aside on their way, and hang in tension behind."""
    section = fb.Section(**STRIP | dict(EA=1e5, EI2=2.0, EI3=4.0, GJ=4.0))
    a, b = (fb.Beam.straight(name, *ends, section=section, elements=4, degree=3) for name, ends in (
        ("left", ((0, 0, 0), (0.5, 0, 0.1))), ("right", ((0.5, 0, 0.1), (1, 0, 0)))))
    model = fb.compile_scene(fb.Scene(a, b, fb.RigidConnection(a.end, b.start), fb.Clamp(a.start), fb.Clamp(b.end),
                                      fb.Load("push", a.end, force=(0, 0, -600.0))))
    path = fb.solve_path(model)
    [event] = told(path)
    row, critical = event["row"], {point["row"] for point in path.info["critical_points"]}
    # where an eigenvalue within the plane is zero it is not looked
    before = max(k for k in range(row) if k not in critical)
    assert path.info["unstable_out_of_plane"] == 0 and "on, up to row" in event["text"] and path.series["load_factor"][-1] == 1.0
    for k in (before, row, len(path.t) - 1):
        short = fb.solve_path(model, most_points=k + 1)
        assert short.t[-1] == path.t[k]
        found = fb.modes(model, state=short.state, load_factor=short.series["load_factor"][-1], n=10)
        aside = np.abs(found.displacements[..., 1]).max(axis=1) > 0.5
        assert np.any(aside & (found.growth > 0.0)) == (k == row)


def test_where_nothing_is_counted() -> None:
    """Below the load; where the model was asked to stay in its plane; where only the plane holds it."""
    assert told(fb.solve_path(strip(3.9))) == []
    asked = fb.solve_path(strip(8.0, planar=True))
    assert told(asked) == [] and "unstable_out_of_plane" not in asked.info
    assert "unstable_out_of_plane" not in fb.solve_path(strip(3.0, planar=False)).info
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=fb.Section(**STRIP), elements=4)
    scene = fb.Scene(beam, fb.Pin(beam.start), fb.Pin(beam.end), fb.Load("down", beam.at(0.5), force=(0, 0, -40)))
    model = fb.compile_scene(scene)
    assert model.plane is not None and told(fb.solve_path(model)) == []
    assert fb.solve_static(model).info["counted_in"] == "plane"


@pytest.mark.parametrize("kind", ["moves", "prestrains", "follower", "two times", "bead", "moment", "joint"])
def test_all_kinds_of_paths(kind: str) -> None:
    """Against what `solve_static` counts in space at the same place, or modes about it."""
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
    model = fb.compile_scene(fb.Scene(beam, clamp, *parts))
    assert model.plane is not None
    path = fb.solve_path(model, step=0.1, largest_step=0.25, **options)
    n = path.info["unstable_out_of_plane"]
    if kind in ("moves", "prestrains"):
        assert n == (1 if kind == "moves" else 2) and told(path)
        return
    if kind in ("follower", "two times"):
        # vibrations that grow, which no static criterion sees: nothing is said that is not known
        assert n is None and told(path) == [] and fb.modes(model, state=path.state, at_time=1.0, n=4).unstable == 2
        return
    held = options.pop("held", False)
    rest = fb.solve_static(model, held=held, at_time=1.0 if "at_time" in options else None)
    assert rest.info["counted_in"] == "space" and n == rest.info["unstable_directions"] == 1
