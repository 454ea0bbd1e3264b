"""Equilibria with unstressed lengths as unknowns: bars, catenaries with a given sag, droppers, nets, sliders (theory.md 12)."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq, root

import fastbeam as fb

EA = 900.0
GRAVITY = 9.81


def section() -> fb.Section:
    return fb.Section(EA=EA, GA2=400.0, GA3=400.0, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=1e-4, rhoI3=1e-4)


def bars(strain: str = "simo_reissner", planar: bool = True) -> tuple[Any, list[fb.Beam], dict[str, Any]]:
    """Two bars between walls."""
    hot = fb.Beam.straight("hot", (0, 0, 0), (1, 0, 0), section=section(), elements=3, strain=strain)
    cold = fb.Beam.straight("cold", (1, 0, 0), (2, 0, 0), section=section(), elements=2, strain=strain, prestrain=0.01)
    scene = fb.Scene(hot, cold, fb.RigidConnection(hot.end, cold.start), fb.Clamp(hot.start), fb.Clamp(cold.end))
    return fb.compile_scene(scene, planar=planar), [hot, cold], {"hot": (hot, 0.3), "cold": (cold, 0.3), "joint": hot.end}


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("strain", ["simo_reissner", "green_lagrange"])
def test_bars_have_a_given_force_and_their_joint_a_given_place(strain: str, planar: bool) -> None:
    """N = EA (r - 1 + e), or EA r ((r^2 - 1)/2 + e), with r = 1.1 and 0.9, solved for e."""
    model, beams, points = bars(strain, planar)
    found = fb.find_lengths(model, ["hot", beams[1]], {("cold", "N"): 20.0, ("joint", "x"): 1.1}, points=points,
                            observe=("section", "energy"))
    exact = [20.0 / EA - (r - 1.0) if strain == "simo_reissner" else 20.0 / (EA * r) - 0.5 * (r * r - 1.0) for r in (1.1, 0.9)]
    # measured: 2e-15
    np.testing.assert_allclose(list(found.info["prestrains"].values()), exact, atol=1e-13)
    np.testing.assert_allclose(list(found.info["unstressed_lengths"].values()), 1.0 - np.array(exact), atol=1e-13)
    assert list(found.info["prestrains"]) == ["hot", "cold"] and found.info["unstable_directions"] == 0
    assert found.point("joint")[-1, 0] == pytest.approx(1.1, abs=1e-13)
    for name in ("hot", "cold"):
        assert found.section(name)["N"][-1] == pytest.approx(20.0, abs=1e-11)
    # rows: the way from the scene's own lengths
    assert found.t[0] == 0.0 and found.t[-1] == 1.0
    np.testing.assert_allclose(found.series["prestrains"][0], (0.0, 0.01), atol=1e-15)
    assert found.series["prestrains"][-1].tolist() == list(found.info["prestrains"].values())


def rope(stiffness: float, weight: float, bending: float) -> fb.Section:
    return fb.Section(EA=stiffness, GA2=stiffness, GA3=stiffness, GJ=1e-3, EI2=bending, EI3=bending, rhoA=weight / GRAVITY,
                      rhoI2=1e-9, rhoI3=1e-9)


def sag_of_catenary(length: float, stiffness: float, weight: float, span: float) -> float:
    """Of an elastic cable of this unstressed length and weight a length between points at the same height (H. M. Irvine, Cable
    Structures, 1981)."""
    up = 0.5 * weight * length
    across = root(lambda h: h * length / stiffness + 2.0 * h / weight * np.arcsinh(up / h) - span, 0.8, tol=1e-14).x[0]
    return float(up * length / (4.0 * stiffness) + across / weight * (np.hypot(1.0, up / across) - 1.0))


@pytest.mark.parametrize("mass", ["kept", "per_length"])
@pytest.mark.parametrize(("bending", "tolerance"), [(1e-7, 1e-7), (1e-9, 1e-9)])
def test_a_cable_of_given_sag_is_an_elastic_catenary(bending: float, tolerance: float, mass: str) -> None:
    """A wire of EA cut to (1 - e) L has the stiffness (1 - e) EA over its strain by the length as drawn, and the weight w/(1 - e)
    where its mass is kept. Bending makes the difference, which goes with EI: 2e-8 and 7e-10."""
    stiffness, weight, sag = 200.0, 1.0, 0.12
    cable = fb.Beam.straight("cable", (0, 0, 0), (1, 0, 0), section=rope(stiffness, weight, bending), elements=32)
    scene = fb.Scene(cable, fb.Pin(cable.start), fb.Pin(cable.end), gravity=(0, 0, -GRAVITY))
    model = fb.compile_scene(scene, planar=True)
    found = fb.find_lengths(model, [cable], {("middle", "z"): -sag}, points={"middle": cable.at(0.5)}, mass=mass,
                            observe=("reaction", "energy"))
    assert found.point("middle")[-1, 2] == pytest.approx(-sag, abs=1e-13) and found.info["unstable_directions"] == 0

    def off(e: float) -> float:
        share = 1.0 - e
        return sag_of_catenary(share, share * stiffness, weight / share if mass == "kept" else weight, 1.0) - sag

    e = found.info["prestrains"]["cable"]
    assert e == pytest.approx(brentq(off, -0.1, -1e-4, xtol=1e-15), abs=tolerance)
    share = 1.0 - e if mass == "per_length" else 1.0
    assert found.info["mass_factors"]["cable"] == pytest.approx(share, abs=1e-15)
    assert np.sum(found.series["reaction"][-1, :, 0, 2]) == pytest.approx(share * weight, rel=1e-10)
    # the same cable drawn with this prestrain
    other = fb.Beam.straight("cable", (0, 0, 0), (1, 0, 0), section=rope(stiffness, share * weight, bending), elements=32,
                             prestrain=e)
    again = fb.compile_scene(fb.Scene(other, fb.Pin(other.start), fb.Pin(other.end), gravity=(0, 0, -GRAVITY)), planar=True)
    rest = fb.solve_static(again, start=found.state, raise_loads=False)
    np.testing.assert_allclose(rest.state.q, found.state.q, atol=1e-11)
    for name in ("strain", "gravity"):
        assert found.series[name][-1] == pytest.approx(rest.series[name][-1], rel=1e-10)


def catenary(count: int, planar: bool, prestrains: Sequence[float] | None = None,
             factors: Sequence[float] | None = None) -> tuple[Any, list[fb.Beam], dict[str, Any]]:
    """A contact wire under a messenger cable, hung by droppers that are drawn as long as their distance."""
    span, high = 60.0, 1.2
    wires = [fb.Section(EA=ea, GA2=ea, GA3=ea, GJ=10.0, EI2=ei, EI3=ei, rhoA=rho, rhoI2=1e-6, rhoI3=1e-6)
             for ea, ei, rho in ((5.9e6, 130.0, 0.6), (1.1e7, 150.0, 1.08))]
    n = 2 * (count + 1)
    cable, wire = (fb.Beam.straight(name, (0, 0, z), (span, 0, z), section=one, elements=n, prestress=force)
                   for name, z, one, force in (("messenger", high, wires[0], 14e3), ("wire", 0.0, wires[1], 20e3)))
    parts: list[Any] = [cable, wire, *(fb.Pin(x) for x in (cable.start, cable.end, wire.start, wire.end))]
    droppers = []
    for k in range(count):
        x = span * (k + 1) / (count + 1)
        rho = 0.1 * (1.0 if factors is None else factors[k])
        thin = fb.Section(EA=2e5, GA2=2e5, GA3=2e5, GJ=0.1, EI2=0.02, EI3=0.02, rhoA=rho, rhoI2=1e-7, rhoI3=1e-7)
        one = fb.Beam.straight(f"dropper {k}", (x, 0, high), (x, 0, 0), section=thin, elements=1,
                               prestrain=0.0 if prestrains is None else prestrains[k])
        droppers.append(one)
        parts += [one, fb.BallJoint(one.start, cable.at(x)), fb.BallJoint(one.end, wire.at(x))]
    model = fb.compile_scene(fb.Scene(*parts, gravity=(0, 0, -GRAVITY)), planar=planar)
    return model, droppers, {f"at {k}": one.end for k, one in enumerate(droppers)}


@pytest.mark.parametrize(("count", "planar", "mass"), [(5, True, "kept"), (10, True, "per_length"), (5, False, "per_length")])
def test_droppers_make_a_contact_wire_level(count: int, planar: bool, mass: str) -> None:
    model, droppers, points = catenary(count, planar)
    before = fb.solve_static(model, points=points)
    assert all(before.point(name)[-1, 2] < -0.02 for name in points)
    found = fb.find_lengths(model, droppers, {(name, "z"): 0.0 for name in points}, points=points, mass=mass,
                            observe=("reaction", "section", "energy"))
    heights = np.array([found.point(name)[-1, 2] for name in points])
    np.testing.assert_allclose(heights, 0.0, atol=1e-10)
    prestrains, factors = (list(found.info[key].values()) for key in ("prestrains", "mass_factors"))
    # shorter in the middle, where the cable hangs lowest
    assert np.all(np.diff(prestrains[:(count + 1) // 2]) > 0.0) and found.info["unstable_directions"] == 0
    np.testing.assert_allclose(prestrains, prestrains[::-1], rtol=1e-6)
    np.testing.assert_allclose(factors, 1.0 if mass == "kept" else 1.0 - np.array(prestrains), rtol=1e-14)
    # all supports carry all weights
    weight = GRAVITY * (60.0 * (0.6 + 1.08) + 0.1 * 1.2 * sum(factors))
    assert np.sum(found.series["reaction"][-1, :4, 0, 2]) == pytest.approx(weight, rel=1e-10)
    # a scene with such droppers hangs the same, from its own shape
    other, _, names = catenary(count, planar, prestrains, factors)
    rest = fb.solve_static(other, points=names, observe=("section", "energy"))
    for name in points:
        np.testing.assert_allclose(rest.point(name)[-1], found.point(name)[-1], atol=1e-10)
    # triads of droppers may spin about their axes
    np.testing.assert_allclose(rest.phi[-1], found.phi[-1], atol=1e-9)
    for name in ("strain", "gravity"):
        assert rest.series[name][-1] == pytest.approx(found.series[name][-1], rel=1e-9)
    same = fb.solve_static(other, start=found.state, raise_loads=False)
    np.testing.assert_allclose(same.phi[-1], found.phi[-1], atol=1e-10)


@pytest.mark.parametrize("planar", [True, False])
def test_lengths_are_those_of_a_path_that_ends_at_the_value(planar: bool) -> None:
    """A bead that slides on a cable: its height, and its place on the cable, against `solve_path(prestrains=, stop=)`."""
    cable = fb.Beam.straight("cable", (0, 0, 0), (1, 0, 0.05), section=rope(200.0, 1.0, 1e-3), elements=16)
    bead = fb.PointMass("bead", mass=0.2)
    slides = fb.Slider("run", bead, cable, at=0.4, curve="c1")
    scene = fb.Scene(cable, bead, fb.Clamp(cable.start), fb.Clamp(cable.end), slides, gravity=(0, 0, -GRAVITY))
    model = fb.compile_scene(scene, planar=planar)
    start = fb.solve_static(model)
    kwargs: dict[str, Any] = {"points": {"bead": bead}}
    for quantity, value in ((("bead", "z"), -0.12), ("run", float(start.slider("run")["s"][-1]) + 0.02)):
        found = fb.find_lengths(model, [cable], {quantity: value}, **kwargs)
        path = fb.solve_path(model, prestrains={cable: -0.1}, start=start.state, stop={quantity: value}, **kwargs)
        # contacts whose place the mesh decides are told of by both
        assert [event["kind"] for event in (*path.events, *found.events)] == ["wanted", "contact", "contact"]
        assert found.info["prestrains"]["cable"] == pytest.approx(-0.1 * path.series["load_factor"][-1], abs=1e-11)
        np.testing.assert_allclose(found.state.q, path.state.q, atol=1e-10)
        np.testing.assert_allclose(found.state.s, path.state.s, atol=1e-10)
    held = fb.find_lengths(model, [cable], {("bead", "z"): -0.12}, held=True, **kwargs)
    assert held.state.s[0] == 0.4
    assert held.point("bead")[-1, 2] == pytest.approx(-0.12, abs=1e-13)


def test_cables_of_a_net_bring_a_node_to_its_place() -> None:
    corners = np.array([(0.0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)])
    nodes, edges = np.vstack(((1.0, 1.0, -0.5), corners)), [(0, k + 1) for k in range(4)]
    wire = fb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=1.0, EI2=0.1, EI3=0.1, rhoA=0.1, rhoI2=1e-6, rhoI3=1e-6)
    loads = np.zeros((5, 3))
    loads[0] = 0.0, 0.0, -100.0

    def roof(prestrain: Any) -> tuple[fb.Net, Any]:
        net = fb.Net("roof", nodes, edges, section=wire, elements=2, joints="ball", pins=[1, 2, 3, 4], loads=loads,
                     prestrain=prestrain)
        return net, fb.compile_scene(fb.Scene(net))

    net, model = roof(0.0)
    place = np.array([1.05, 0.9, -0.48])
    found = fb.find_lengths(model, [net.beam(k) for k in range(3)], dict(zip([("mid", c) for c in "xyz"], place)),
                            points={"mid": net.node(0)})
    np.testing.assert_allclose(found.point("mid")[-1], place, atol=1e-13)
    # forces along straight cables balance the load, and tell their lengths; the fourth keeps its own
    way = place - corners
    length = np.linalg.norm(way, axis=1)
    drawn = np.linalg.norm(nodes[0] - corners, axis=1)
    last = 1e4 * (length[3] / drawn[3] - 1.0)
    forces = np.linalg.solve((way[:3] / length[:3, None]).T, loads[0] - last * way[3] / length[3])
    exact = 1.0 + forces / 1e4 - length[:3] / drawn[:3]
    np.testing.assert_allclose(list(found.info["prestrains"].values()), exact, atol=1e-10)
    again = fb.solve_static(roof([*found.info["prestrains"].values(), 0.0])[1])
    np.testing.assert_allclose(again.phi[-1], found.phi[-1], atol=1e-10)


@pytest.mark.parametrize(("lengths", "conditions", "message"), [
    ([], {("joint", "x"): 1.1}, "lengths: must be beams or names"),
    ("hot", {("joint", "x"): 1.1}, "lengths: must be beams or names"),
    (["warm"], {("joint", "x"): 1.1}, "no beam 'warm'; its beams are 'hot', 'cold'"),
    ([3], {("joint", "x"): 1.1}, "needs a beam of the scene, got 3"),
    (["hot", "hot"], {("joint", "x"): 1.1, ("hot", "N"): 1.0}, "beam 'hot' is listed twice"),
    (["hot"], {}, "conditions: must be a mapping of quantities"),
    (["hot"], None, "conditions: must be a mapping of quantities"),
    (["hot"], {("joint", "x"): "a"}, "conditions: the value of"),
    (["hot"], {("tip", "x"): 1.1}, "'tip' is not a name in points="),
    (["hot"], {("joint", "w"): 1.1}, "'joint' has no quantity 'w'"),
    (["hot"], {"run": 1.1}, "has no slider 'run'"),
    (["hot"], {(lambda state: 0.0): 1.1}, "is a function, whose derivative is not known"),
    (["hot"], {("joint", "x"): 1.1, ("hot", "N"): 1.0}, "as many unknown lengths as conditions, 2, got 1; name more beams"),
    (["hot", "cold"], {("joint", "x"): 1.1}, "got 2; name fewer beams"),
    (["hot"], {("joint", "y"): 0.1}, "no length affects y at 'joint' at the start"),
    (["hot", "cold"], {("hot", "N"): 1.0, ("cold", "N"): 1.0}, "lengths of beam 'hot', beam 'cold' can change together")])
def test_what_cannot_be_is_refused(lengths: Any, conditions: Any, message: str) -> None:
    model, _, points = bars()
    with pytest.raises(fb.SceneError, match=message):
        fb.find_lengths(model, lengths, conditions, points=points)


def test_beams_of_other_scenes_and_those_that_hold_nothing_are_refused() -> None:
    model, beams, points = bars()
    with pytest.raises(fb.SceneError, match="beam 'hot' is not in scene"):
        fb.find_lengths(model, [bars()[1][0]], {("joint", "x"): 1.1}, points=points)
    free = fb.Beam.straight("free", (0, 1, 0), (1, 1, 0), section=section(), elements=1)
    more = fb.compile_scene(fb.Scene(*beams, free, fb.RigidConnection(beams[0].end, beams[1].start), fb.Clamp(beams[0].start),
                                     fb.Clamp(beams[1].end), fb.Clamp(free.start)), planar=True)
    with pytest.raises(fb.SceneError, match="the length of beam 'free' affects none of the conditions"):
        fb.find_lengths(more, ["hot", "free"], {("joint", "x"): 1.1, ("hot", "N"): 1.0}, points=points)


def test_a_held_slider_has_no_arc_length_that_lengths_could_move() -> None:
    rail = fb.Beam.straight("rail", (0, 0, 0), (1, 0, 0), section=section(), elements=2)
    bead = fb.PointMass("bead", mass=0.1)
    model = fb.compile_scene(fb.Scene(rail, bead, fb.Clamp(rail.start), fb.Clamp(rail.end), fb.Slider("run", bead, rail, at=0.4),
                                      gravity=(0, 0, -GRAVITY)), planar=True)
    with pytest.raises(fb.SceneError, match="slider 'run' is locked"):
        fb.find_lengths(model, ["rail"], {"run": 0.5}, held=("run",))


def test_conditions_out_of_reach_end_with_the_last_equilibrium() -> None:
    """The joint of two bars between walls 2 apart: the second one is compressed to nothing at x = 2."""
    model, beams, points = bars()
    with pytest.raises(fb.ConvergenceError, match=r"at a share of 0\.\d+ of the conditions.*x at 'joint' is 1\.99\d+ of "
                                                  r"5") as caught:
        fb.find_lengths(model, ["hot"], {("joint", "x"): 5.0}, points=points)
    result = caught.value.result
    assert result is not None and 0.0 < result.t[-1] < 1.0
    place = result.point("joint")[-1, 0]
    # N = EA (x - 1 + e) = EA ((2 - x) - 1 + 0.01)
    assert result.info["prestrains"]["hot"] == pytest.approx(2.01 - 2.0 * place, abs=1e-12)
