"""Forces and moments of sections from the balance of what lies behind them (theory.md 4.2)."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from restarts import assert_goes_on

import fastbeam as fb
from perf.validation import misses
from perf.validation.sections import check_sections

Array = np.ndarray
BAR = fb.Section.circle(radius=0.02, E=2e8, rho=1200.0)
MESHES: list[dict[str, Any]] = [{"elements": 4, "degree": 3}, {"elements": 8, "degree": 1},
                                {"elements": 6, "degree": 3, "interpolation": "bspline"}]
ALONG = np.array([1.0, 0.0, 0.3]) / np.linalg.norm([1.0, 0.0, 0.3])
GRAVITY = np.array([0.0, 0.0, -9.81])
TIP = np.array([3.0, 0.0, -20.0])


def beam(mesh: dict[str, Any], strain: str = "simo_reissner", section: fb.Section = BAR) -> fb.Beam:
    return fb.Beam.straight("beam", (0, 0, 0), ALONG, section=section, strain=strain, **mesh)


def spread(s: Array) -> Array:
    """A load per length, N/m."""
    return np.stack((0.0 * s + 3.0, 0.0 * s, -20.0 - 10.0 * s), axis=1)


def places(part: fb.Beam) -> dict[str, tuple[fb.Beam, float]]:
    """Both ends, an end of an element, right in front of it, and a place inside an element."""
    at = float(part.basis.element_ends[2])
    return {"start": (part, 0.0), "end": (part, part.length), "knot": (part, at), "before": (part, at * (1.0 - 1e-10)),
            "inside": (part, 0.37 * part.length)}


def quadrature_behind(part: fb.Beam, s0: float) -> tuple[Array, Array]:
    """Points and weights along a beam behind s0, element by element, m."""
    x, w = np.polynomial.legendre.leggauss(40)
    ends = np.unique(np.concatenate(([s0], part.basis.element_ends[part.basis.element_ends > s0])))
    pairs = list(zip(ends, ends[1:]))
    s = np.concatenate([a + 0.5 * (b - a) * (1.0 + x) for a, b in pairs] or [np.zeros(0)])
    return s, np.concatenate([0.5 * (b - a) * w for a, b in pairs] or [np.zeros(0)])


@pytest.mark.parametrize("strain", ["simo_reissner", "green_lagrange"])
@pytest.mark.parametrize("mesh", MESHES)
def test_equilibria_have_the_forces_and_moments_of_their_loads(mesh: dict[str, Any], strain: str) -> None:
    part = beam(mesh, strain)
    couple, moment = np.array([0.3, 0.1, -0.2]), np.array([1.0, 2.0, 3.0])
    model = fb.compile_scene(fb.Scene(
        part, fb.Clamp(part.start, name="clamp"), fb.Load("tip", part.end, force=TIP, moment=moment),
        fb.DistributedLoad("spread", part, force=spread, moment=couple), gravity=GRAVITY))
    found = fb.solve_static(model, observe=("section", "reaction"), points=places(part))
    held = found.reaction("clamp")
    for name, (_, s0) in places(part).items():
        # points of the deformed line, and all that acts behind the section
        s, weight = quadrature_behind(part, s0)
        line = part.basis.position_matrix(np.concatenate(([s0, part.length], s)))[0] @ found.phi[-1]
        load = weight[:, None] * (spread(s) + BAR.inertia[0] * GRAVITY)
        force = TIP + load.sum(axis=0)
        about = moment + couple * (part.length - s0) + np.cross(line[1] - line[0], TIP)
        about += np.cross(line[2:] - line[0], load).sum(axis=0)
        section = found.section(name)
        np.testing.assert_allclose(section["force"][-1], force, rtol=0.0, atol=1e-10 * np.abs(held["force"]).max())
        # the moment spread along splines counts at their nodes
        near = 1e-10 if "interpolation" not in mesh else 2e-3
        np.testing.assert_allclose(section["moment"][-1], about, rtol=0.0, atol=near * np.abs(held["moment"]).max())
    for kind in ("force", "moment"):
        np.testing.assert_allclose(found.section("start")[kind], -held[kind], rtol=0.0, atol=1e-13 * np.abs(held[kind]).max())


def swinging(mesh: dict[str, Any], *parts: Any, section: fb.Section = BAR, held: bool = True, planar: bool = True,
             **options: Any) -> tuple[fb.Beam, fb.Result]:
    part = beam(mesh, section=section)
    own = [make(part) for make in parts]
    own = [x for made in own for x in (made if isinstance(made, list) else [made])]
    model = fb.compile_scene(fb.Scene(part, *([fb.Clamp(part.start, name="clamp")] if held else []), *own, gravity=GRAVITY),
                             **({} if planar else {"planar": False}))
    return part, fb.simulate(model, t_end=6e-3, step=1e-3, every=1, observe=("section", "reaction", "velocity"), progress=False,
                             points=places(part), output=fb.Output(snapshots=7), **options)


def ring(**options: Any) -> Any:
    def make(part: fb.Beam) -> list[Any]:
        body = fb.PointMass("ring", mass=0.5, position=0.45 * ALONG)
        return [body, fb.Slider("slider", body, part, at=0.45, **options)]
    return make


def sleeve(**options: Any) -> Any:
    def make(part: fb.Beam) -> list[Any]:
        across = np.array([0.0, 1.0, 0.0])
        body = fb.RigidBody("body", mass=0.5, inertia=(1e-3, 1e-3, 1e-3), position=0.45 * ALONG,
                            directors=np.array([ALONG, across, np.cross(ALONG, across)]))
        return [body, fb.Sleeve("sleeve", body, part, at=0.45, **options)]
    return make


def tip(part: fb.Beam) -> fb.Load:
    return fb.Load("tip", part.end, force=TIP, time=lambda t: 1.0 + np.sin(30.0 * t))


def loads(part: fb.Beam) -> fb.DistributedLoad:
    return fb.DistributedLoad("spread", part, force=spread, time=lambda t: np.cos(10.0 * t))


def air(part: fb.Beam) -> fb.Drag:
    return fb.Drag("air", part, normal=30.0, tangential=1.0, air=(0, 0, 20.0))


DAMPED = fb.Section.circle(radius=0.02, E=2e8, rho=1200.0, damping=1e-3)
CASES: dict[str, tuple[Any, dict[str, Any]]] = {
    "loads": ((tip, loads), {}), "drag and damping": ((tip, air), {"section": DAMPED}),
    "ring that rubs": ((tip, loads, ring(friction=0.2)), {"planar": False}), "sleeve": ((tip, loads, sleeve()), {}),
    "sleeve with a bore": ((tip, sleeve(length=0.1, friction=0.1)), {"planar": False})}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("mesh", MESHES)
def test_sections_are_in_equilibrium_with_reactions_and_loads_and_have_no_jumps(mesh: dict[str, Any], case: str) -> None:
    parts, options = CASES[case]
    _, found = swinging(mesh, *parts, **options)
    held, rows = found.reaction("clamp"), slice(1, -1)
    for kind in ("force", "moment"):
        start, size = found.section("start")[kind][rows], np.abs(held[kind]).max()
        np.testing.assert_allclose(start, -held[kind][rows], rtol=0.0, atol=1e-12 * size)
        # right in front of an end of an element the balance goes on from the end before
        before, knot = (found.section(name)[kind][rows] for name in ("before", "knot"))
        np.testing.assert_allclose(before, knot, rtol=0.0, atol=1e-8 * size)
    np.testing.assert_allclose(found.section("end")["moment"][rows], 0.0, atol=1e-10 * np.abs(held["moment"]).max())
    shares = found.section("end")["force"][rows] / np.where(TIP == 0.0, np.inf, TIP)
    np.testing.assert_allclose(shares[:, 0], shares[:, 2], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("mesh", MESHES)
def test_the_part_behind_a_section_changes_its_momentum_by_its_force(mesh: dict[str, Any]) -> None:
    part, found = swinging(mesh, lambda part: fb.Load("push", part.start, force=TIP), held=False)
    basis, h = part.basis, 1e-3
    assert np.abs(found.section("knot")["force"]).max() > 1.0
    np.testing.assert_allclose(found.section("start")["force"][1:-1], np.tile(-TIP, (5, 1)), rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(found.section("end")["force"][1:-1], 0.0, atol=1e-8)
    weight = np.zeros(basis.n_nodes)
    np.add.at(weight, basis.element_nodes[2:], BAR.inertia[0] * basis.mass_phi[2:].sum(axis=1))
    momentum = np.einsum("a,tac->tc", weight, found.velocities)
    change = (momentum[2:] - momentum[:-2]) / (2.0 * h)
    np.testing.assert_allclose(found.section("knot")["force"][1:-1], weight.sum() * GRAVITY - change, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("contacts", ["mesh", "exact"])
def test_a_ring_at_rest_carries_its_weight_where_it_hangs(contacts: str) -> None:
    part = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=BAR, elements=5, degree=3)
    body = fb.PointMass("ring", mass=2.0, position=(0.45, 0, 0))
    model = fb.compile_scene(fb.Scene(part, body, fb.Slider("slider", body, part, at=0.45), fb.Clamp(part.start, name="clamp"),
                                      fb.Pin(part.end, name="pin"), gravity=GRAVITY))
    points = {"start": (part, 0.0), "knot": (part, 0.4), "left": (part, 0.44), "right": (part, 0.46), "end": (part, 1.0)}
    found = fb.solve_static(model, held=True, contacts=contacts, observe=("section", "reaction"), points=points)
    force = {name: found.section(name)["force"][-1, 2] for name in points}
    per_length = 9.81 * BAR.inertia[0]
    scale = 1e-10 * 2.0 * 9.81
    assert abs(force["left"] - force["knot"] - 0.04 * per_length) < scale
    assert abs(force["right"] - force["left"] - 0.02 * per_length - 2.0 * 9.81) < scale
    assert abs(force["start"] + found.reaction("clamp")["force"][-1, 2]) < scale
    assert abs(force["end"] - found.reaction("pin")["force"][-1, 2]) < scale
    assert np.abs(found.section("end")["moment"][-1]).max() < scale


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("planar", [True, False])
def test_sections_on_both_sides_of_a_joint_agree_while_a_ring_passes_it(turned: bool, planar: bool) -> None:
    first = fb.Beam.straight("first", (0, 0, 0), (1, 0, 0), section=BAR, elements=3)
    ends = ((2, 0, 0), (1, 0, 0)) if turned else ((1, 0, 0), (2, 0, 0))
    second = fb.Beam.straight("second", *ends, section=BAR, elements=3)
    near, far = (second.end, second.start) if turned else (second.start, second.end)
    body = fb.PointMass("ring", mass=0.5, position=(0.98, 0, 0), velocity=(4, 0, 0))
    path = fb.Path("path", [first, (second, -1) if turned else second])
    model = fb.compile_scene(fb.Scene(
        first, second, body, fb.RigidConnection(first.end, near), fb.Slider("slider", body, path, at=0.98, rate=4.0),
        fb.Clamp(first.start, name="clamp"), fb.Pin(far, name="pin"), gravity=GRAVITY), **({} if planar else {"planar": False}))
    points = {"before": first.end, "behind": near, "start": first.start, "far": far}
    found = fb.simulate(model, t_end=0.02, step=1e-3, every=1, observe=("section", "reaction", "slider"), points=points,
                        progress=False)
    assert found.slider("slider")["s"][-1] > 1.05 and np.abs(found.slider("slider")["force"]).max() > 0.5
    sign = -1.0 if turned else 1.0
    for kind in ("force", "moment"):
        before, behind = (found.section(name)[kind][1:-1] for name in ("before", "behind"))
        size = np.abs(before).max()
        # but for round-off of strains, which steps converge to: last places of 1 to 2 m, 2e-16, times slopes over elements of
        # 1/3 m, which add up to some 40 per m
        np.testing.assert_allclose(before, sign * behind, rtol=0.0, atol=3e-14 * BAR.C[0, 0])
        start = found.section("start")[kind][1:-1]
        np.testing.assert_allclose(start, -found.reaction("clamp")[kind][1:-1], rtol=0.0, atol=1e-11 * size)
    at_pin = found.reaction("pin")["force"][1:-1]
    np.testing.assert_allclose(sign * found.section("far")["force"][1:-1], at_pin, rtol=0.0, atol=3e-14 * BAR.C[0, 0])


def test_a_ring_that_turns_into_another_track_is_in_balance_on_the_corner() -> None:
    first = fb.Beam.straight("first", (0, 0, 0), (1, 0, 0), section=BAR, elements=3)
    second = fb.Beam.straight("second", (1, 0, 0), (1.9, 0.3, 0), section=BAR, elements=3)
    body = fb.PointMass("ring", mass=0.5)
    model = fb.compile_scene(fb.Scene(
        first, second, body, fb.RigidConnection(first.end, second.start), fb.Clamp(first.start), fb.Clamp(second.end),
        fb.Slider("slider", body, fb.Switch("switch", [first, second]), at=0.9, rate=3.0), project_velocities=True))
    found = fb.simulate(model, t_end=0.06, step=4e-3, every=1, observe=("section", "reaction"), progress=False,
                        points={"before": first.end, "behind": second.start})
    assert "switched" in [event["kind"] for event in found.events]
    before, behind = (found.section(name)["force"][1:-1] for name in ("before", "behind"))
    np.testing.assert_allclose(before, behind, rtol=0.0, atol=1e-13 * BAR.C[0, 0])


@pytest.mark.parametrize("still", [True, False])
def test_beams_of_a_net_are_in_equilibrium_where_they_meet(still: bool) -> None:
    nodes = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.0), (1.0, 1.0, 0.0), (1.0, -1.0, 0.0)])
    load = np.array([1.0, 2.0, -30.0])
    net = fb.Net("net", nodes, [(0, 1), (1, 2), (1, 3), (1, 4)], section=BAR, elements=3, degree=2, joints="rigid",
                 pins=[0, 2, 3, 4], loads=np.outer([0.0, 1.0, 0.0, 0.0, 0.0], load))
    model = fb.compile_scene(fb.Scene(net, gravity=GRAVITY))
    beams = [net.beam(k) for k in range(4)]
    points = {"to": (beams[0], beams[0].length), **{f"from {k}": (beams[k], 0.0) for k in (1, 2, 3)}}
    observe = ("section", "reaction")
    found = (fb.solve_static(model, observe=observe, points=points) if still else
             fb.simulate(model, t_end=5e-3, step=1e-3, every=1, observe=observe, points=points, progress=False))
    for kind, given in (("force", load), ("moment", np.zeros(3))):
        leaving = sum(found.section(f"from {k}")[kind][-2] for k in (1, 2, 3))
        share = found.t[-2] if still else 1.0
        np.testing.assert_allclose(found.section("to")[kind][-2] - leaving, share * given, rtol=0.0, atol=1e-9)


def test_forces_of_the_balance_come_with_reactions_alone_and_of_beams_alone() -> None:
    part = beam(MESHES[0])
    mass = fb.PointMass("mass", mass=1.0, position=(5, 0, 0))
    model = fb.compile_scene(fb.Scene(part, fb.Clamp(part.start), mass, gravity=GRAVITY))
    points = {"inside": (part, 0.3), "mass": mass, "node": part.end}
    without = fb.simulate(model, t_end=2e-3, step=1e-3, observe=("section",), points=points, progress=False)
    assert set(without.section("inside")) == {"N", "Q2", "Q3", "T", "M2", "M3"}
    found = fb.simulate(model, t_end=2e-3, step=1e-3, observe=("section", "reaction"), points=points, progress=False)
    assert np.all(np.isfinite(found.section("node")["force"])) and np.all(np.isnan(found.section("mass")["force"]))


def test_a_run_that_is_cut_in_two_goes_on_with_the_same_bits(tmp_path: Path) -> None:
    part = beam(MESHES[0])
    model = fb.compile_scene(fb.Scene(part, fb.Clamp(part.start), tip(part), *ring(friction=0.1)(part), gravity=GRAVITY))
    given = {"t_end": 6e-3, "step": 1e-3, "every": 1, "observe": ("section", "reaction"), "points": places(part),
             "progress": False}
    assert_goes_on(model, fb.simulate(model, **given), 3, tmp_path / "c", given)


@pytest.mark.parametrize("mesh", MESHES)
def test_sections_of_a_spin_carry_the_inertia_behind_them(mesh: dict[str, Any]) -> None:
    """An arm that stands off the axis and bends outwards: accelerations of the deformed line and of its triads."""
    part, axis, point = beam(mesh), np.array([0.0, 0.0, 1.0]), np.array([-0.2, 0.1, 0.0])
    model = fb.compile_scene(fb.Scene(part, fb.Clamp(part.start, name="clamp"), gravity=GRAVITY), planar=False)
    found = fb.solve_static(model, steady=fb.Spin(6.0, axis, point), levels=(0.4,), observe=("section", "reaction"),
                            points=places(part))
    held, q = found.reaction("clamp"), found.state.q.reshape(-1, 4, 3)
    turn = 6.0 * np.cross(axis, np.eye(3)).T
    for name, (_, s0) in places(part).items():
        s, weight = quadrature_behind(part, s0)
        where = part.basis.position_matrix(np.concatenate(([s0], s)))[0]
        line = where @ q[:, 0]
        pull = -BAR.inertia[0] * weight[:, None] * ((line[1:] - point) @ (turn @ turn).T - GRAVITY)
        about = np.cross(line[1:] - line[0], pull).sum(axis=0)
        if mesh.get("interpolation") != "bspline":
            for i in (2, 3):
                d = where[1:] @ q[:, i]
                about -= BAR.inertia[i - 1] * (weight[:, None] * np.cross(d, d @ (turn @ turn).T)).sum(axis=0)
        section = found.section(name)
        np.testing.assert_allclose(section["force"][-1], pull.sum(axis=0), rtol=0.0, atol=1e-10 * np.abs(held["force"]).max())
        # directors of splines have a basis of their own: their share is 2e-3 of the moment
        near = 1e-10 if mesh.get("interpolation") != "bspline" else 1e-2
        np.testing.assert_allclose(section["moment"][-1], about, rtol=0.0, atol=near * np.abs(held["moment"]).max())
    assert 0.4 in found.t and np.abs(held["force"][0]).max() < 1e-11 * np.abs(held["force"]).max(), "none of it acts at first"
    for kind in ("force", "moment"):
        np.testing.assert_allclose(found.section("start")[kind], -held[kind], rtol=0.0, atol=1e-12 * np.abs(held[kind]).max())


def test_sections_of_beams_that_travel_are_not_told() -> None:
    part = beam(MESHES[0])
    model = fb.compile_scene(fb.Scene(part, fb.Clamp(part.start, name="clamp"), fb.Pin(part.end)), planar=False)
    found = fb.solve_static(model, steady=fb.Travel({part: 1.0}), observe=("section", "reaction"), points=places(part))
    assert np.all(np.isnan(found.section("knot")["force"])) and np.all(np.isfinite(found.reaction("clamp")["force"]))


def test_forces_of_beams_are_in_balance_with_reactions_sliders_and_inertia() -> None:
    assert misses(check_sections(quick=True)) == []
