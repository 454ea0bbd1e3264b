"""Paths whose parameter is the unstressed length of beams: heated columns, bars, snap-through by heat (theory.md 12)."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar, root

import fastbeam as fb
from fastbeam.model.workspace import ReferenceStrains
from fastbeam.results.observe.observer import Observer
from fastbeam.stepping.stepper import Stepper

EA, GA, EI = 900.0, 400.0, 1.0


def section() -> fb.Section:
    return fb.Section(EA=EA, GA2=GA, GA3=GA, GJ=1.0, EI2=EI, EI3=EI, rhoA=1.0, rhoI2=1e-4, rhoI3=1e-4)


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("strain", ["simo_reissner", "green_lagrange"])
def test_a_bar_between_walls_has_the_force_of_its_prestrain(strain: str, planar: bool) -> None:
    """Half of a clamped bar shrinks, beside one that is taut: N = EA times the mean prestrain, and every row is that of a scene
    with such a bar from the start."""
    hot = fb.Beam.straight("hot", (0, 0, 0), (1, 0, 0), section=section(), elements=3, strain=strain)
    cold = fb.Beam.straight("cold", (1, 0, 0), (2, 0, 0), section=section(), elements=2, strain=strain, prestrain=0.01)
    joint = fb.RigidConnection(hot.end, cold.start)
    model = fb.compile_scene(fb.Scene(hot, cold, joint, fb.Clamp(hot.start), fb.Clamp(cold.end)), planar=planar)
    at = {"hot": (hot, 0.3), "cold": (cold, 0.3)}
    kwargs: dict[str, Any] = dict(points=at, observe=("section", "reaction", "energy"))
    start = fb.solve_static(model)
    path = fb.solve_path(model, prestrains={hot: 0.05}, start=start.state, stop={("cold", "N"): 20.0}, **kwargs)
    for row, factor in enumerate(path.series["load_factor"]):
        # the same scene with that prestrain from the start
        warm = fb.Beam.straight("hot", (0, 0, 0), (1, 0, 0), section=section(), elements=3, strain=strain,
                                prestrain=0.05 * factor)
        rest = fb.Beam.straight("cold", (1, 0, 0), (2, 0, 0), section=section(), elements=2, strain=strain, prestrain=0.01)
        scene = fb.Scene(warm, rest, fb.RigidConnection(warm.end, rest.start), fb.Clamp(warm.start), fb.Clamp(rest.end))
        other = fb.solve_static(fb.compile_scene(scene, planar=planar), points={"hot": (warm, 0.3), "cold": (rest, 0.3)},
                                observe=("section", "reaction", "energy"))
        np.testing.assert_allclose(path.phi[row], other.phi[-1], atol=1e-12)
        for name in at:
            assert path.section(name)["N"][row] == pytest.approx(other.section(name)["N"][-1], abs=1e-9)
        assert path.series["strain"][row] == pytest.approx(other.series["strain"][-1], rel=1e-10)
        if strain == "simo_reissner":
            assert path.section("hot")["N"][row] == pytest.approx(EA * 0.5 * (0.05 * factor + 0.01), rel=1e-10)
    assert path.section("cold")["N"][-1] == pytest.approx(20.0, abs=1e-10)


@pytest.mark.parametrize("planar", [True, False])
def test_a_heated_column_buckles(planar: bool) -> None:
    """Clamped at both ends, which keep its length: e EA = P, P (1 + P/GA) = 4 pi^2 EI/L^2."""
    column = fb.Beam.straight("column", (0, 0, 0), (0, 0, 1), section=section(), elements=32)
    model = fb.compile_scene(fb.Scene(column, fb.Clamp(column.start), fb.Clamp(column.end)), planar=planar)
    at = fb.solve_path(model, prestrains={column: -0.1}, stop_at="bifurcation")
    P = brentq(lambda p: p * (1.0 + p / GA) - 4.0 * np.pi**2 * EI, 10.0, 40.0, xtol=1e-14)
    assert 0.1 * at.info["critical_points"][-1]["load_factor"] == pytest.approx(P / EA, rel=1e-8)
    assert at.series["unstable_directions"][-2] == 0.0
    factor = float(at.series["load_factor"][-1])
    bent = fb.solve_path(model, prestrains={column: -0.1}, start=at.state, load_factor=factor, side=1, to=1.5 * factor)
    assert np.max(np.abs(bent.phi[-1, :, :2])) > 0.05


def test_a_shallow_truss_snaps_through_by_cold() -> None:
    """Two bars under a load that stays; as they shrink they lose their hold: P = -2 N z/l, N = EA (l/l0 - 1 + e); bending of
    1e-7 is what is left."""
    height, soft = 0.12, fb.Section(EA=50.0, GA2=50.0, GA3=50.0, GJ=1e-7, EI2=1e-7, EI3=1e-7, rhoA=1.0, rhoI2=1e-6, rhoI3=1e-6)
    left = fb.Beam.straight("left", (-1, 0, 0), (0, 0, height), section=soft, elements=1, degree=2)
    right = fb.Beam.straight("right", (0, 0, height), (1, 0, 0), section=soft, elements=1, degree=2)
    load = fb.Load("load", left.end, force=(0, 0, -0.01))
    joints = fb.BallJoint(left.end, right.start), fb.Pin(left.start), fb.Pin(right.end)
    model = fb.compile_scene(fb.Scene(left, right, *joints, load), planar=True)
    start = fb.solve_static(model)
    path = fb.solve_path(model, prestrains={left: 0.1, right: 0.1}, start=start.state, points={"top": left.end}, most_points=400)
    rest = np.hypot(1.0, height)

    def strain(z: Any) -> Any:
        """The prestrain at a height."""
        length = np.hypot(1.0, z)
        return -0.01 * length / (2.0 * z) / 50.0 - (length / rest - 1.0)

    z, factor = path.point("top")[:, 2], path.series["load_factor"]
    np.testing.assert_allclose(0.1 * factor, strain(z), atol=2e-6)
    limit = path.info["critical_points"][0]
    assert limit["kind"] == "limit"
    top = minimize_scalar(lambda z: -strain(z), bounds=(0.01, height), method="bounded", options={"xatol": 1e-12})
    assert 0.1 * limit["load_factor"] == pytest.approx(-top.fun, abs=2e-6)


@pytest.mark.parametrize(("prestrains", "message"), [
    ({}, "prestrains: must be a mapping"), ({3: 0.1}, "needs a beam of the scene"), ({"column": 0.0}, "all changes are zero"),
    ({"column": 2.0}, "must be a number from -10 to 0.99"), ({"column": "a"}, "must be a number from"),
    ({"else": 0.1}, "is not in scene")])
def test_prestrains_that_cannot_be_are_refused(prestrains: Any, message: str) -> None:
    beams = {name: fb.Beam.straight(name, (0, 0, 0), (0, 0, 1), section=section(), elements=2) for name in ("column", "else")}
    column = beams["column"]
    model = fb.compile_scene(fb.Scene(column, fb.Clamp(column.start)))
    with pytest.raises(fb.SceneError, match=message):
        fb.solve_path(model, prestrains={beams.get(name, name): value for name, value in prestrains.items()})


def elastic_catenary(length: float, stiffness: float, weight: float, to: tuple[float, float]) -> tuple[float, float, Any]:
    """Force across, force upward at the start, and places of a cable of this unstressed length and weight a length that hangs
    from the origin to a point beside and above it (H. M. Irvine, Cable Structures, 1981)."""
    def place(s: Any, across: float, up: float) -> Any:
        left, right = up / across, (up - weight * s) / across
        x = across * s / stiffness + across / weight * (np.arcsinh(left) - np.arcsinh(right))
        fall = s / stiffness * (up - 0.5 * weight * s) + across / weight * (np.hypot(1.0, left) - np.hypot(1.0, right))
        return np.array([x, -fall])

    first = max(0.8, stiffness * (1.0 / length - 1.0)), 0.45 * weight * length
    found = root(lambda y: place(length, *y) - to, first, tol=1e-13)
    assert np.max(np.abs(found.fun)) < 1e-10
    return float(found.x[0]), float(found.x[1]), lambda s: place(s, *found.x)


def test_a_slack_cable_that_is_shortened_is_an_elastic_catenary_at_every_length() -> None:
    """Unstressed lengths as the parameter of a path: a prestrain e leaves (1 - e) L, with the stiffness (1 - e) EA of the same
    wire and the weight w / (1 - e) of the same mass; from slack to a tension eight times as large."""
    stiffness, weight, length, to, most = 200.0, 1.0, 1.05, (1.0, 0.1), 0.08
    rope = fb.Section(EA=stiffness, GA2=stiffness, GA3=stiffness, GJ=1e-3, EI2=1e-9, EI3=1e-9, rhoA=weight / 9.81, rhoI2=1e-9,
                      rhoI3=1e-9)
    cable = fb.Beam.straight("cable", (0, 0, 0), (length, 0, 0), section=rope, elements=16)
    model = fb.compile_scene(fb.Scene(cable, fb.Pin(cable.start), fb.Pin(cable.end), gravity=(0, 0, -9.81)), planar=True)
    start = model.state()
    nodes = start.q.reshape(-1, 4, 3)
    across, up, place = elastic_catenary(length, stiffness, weight, to)
    s = nodes[:, 0, 0].copy()
    nodes[:, 0, 0], nodes[:, 0, 2] = place(s)
    size = np.hypot(across, up - weight * s)
    c, d = across / size, (weight * s - up) / size
    turn = np.zeros((s.size, 3, 3))
    turn[:, 0, 0] = turn[:, 2, 2] = c
    turn[:, 2, 0], turn[:, 0, 2], turn[:, 1, 1] = d, -d, 1.0
    nodes[:, 1:] = np.einsum("nij,nkj->nki", turn, nodes[:, 1:])
    rest = fb.solve_static(model, start=start)
    path = fb.solve_path(model, start=rest.state, prestrains={cable: most}, points={"middle": cable.at(length / 2)},
                         observe=("reaction",))
    assert path.series["load_factor"][-1] == 1.0 and len(path.t) > 8
    for row, factor in enumerate(path.series["load_factor"]):
        share = 1.0 - most * factor
        across, up, place = elastic_catenary(share * length, share * stiffness, weight / share, to)
        x, _, z = path.point("middle")[row]
        np.testing.assert_allclose((x, z), place(0.5 * share * length), atol=2e-7)
        force = path.series["reaction"][row, 0, 0]
        np.testing.assert_allclose((-force[0], force[2]), (across, up), rtol=2e-7)
    assert across > 8.0 * -path.series["reaction"][0, 0, 0, 0]


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("strain", ["simo_reissner", "green_lagrange"])
def test_reference_strains_of_a_run_are_those_of_a_scene_with_its_prestrain(strain: str, planar: bool) -> None:
    """Steps under prestrains of the run, space and plane, against the same scene with these from the start; the model stays."""
    def scene(change: float) -> tuple[fb.Scene, fb.Beam]:
        bent = fb.Beam.straight("bent", (0, 0, 0), (1, 0, 0), section=section(), elements=9, degree=2, strain=strain,
                                prestrain=0.01 + change)
        other = fb.Beam.straight("other", (1, 0, 0), (1, 0, 1), section=section(), elements=2)
        joint = fb.RigidConnection(bent.end, other.start)
        return fb.Scene(bent, other, joint, fb.Clamp(bent.start), gravity=(0, 0, -9.81)), bent

    plain, beam = scene(0.0)
    model, warm = (fb.compile_scene(x, planar=planar) for x in (plain, scene(0.03)[0]))
    initial = model.reference_strains.copy()
    strains = ReferenceStrains([(model.numbers.span(beam), 0.06)])
    run, expected = Stepper(model, np.ones(1), strains=strains), Stepper(warm, np.ones(1))
    strains.put(0.5)
    for stepper in (run, expected):
        assert stepper.advance(0.0, 1e-3, 20).steps == 20
    np.testing.assert_allclose(run.state.q, expected.state.q, rtol=0, atol=1e-12)
    energies = [Observer(x.model, ("energy",), None, strains=x.strains).row(0.02, x.state)["strain"] for x in (run, expected)]
    assert energies[0] == pytest.approx(energies[1], rel=1e-10)
    assert energies[0] != pytest.approx(Observer(model, ("energy",), None).row(0.02, run.state)["strain"], rel=1e-2)
    strains.put(0.0)
    for form in (model, run.core):
        np.testing.assert_array_equal(strains.of(form), form.reference_strains)
    np.testing.assert_array_equal(model.reference_strains, initial)
    assert expected.work.reference_strains is expected.core.reference_strains
