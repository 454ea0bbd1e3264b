"""Results of scenes whose elements move with contacts: rows, points and states of the material of the user's beams (theory.md
5.12)."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.model.mapping import contact

SECTION = fb.Section.circle(radius=0.01, E=2e9, rho=2e3)
KINDS = ("energy", "slider", "velocity", "spin", "orientation", "acceleration", "section")
INSIDE = 0.713


def rider(elements: int = 8, at: float = 0.3, rate: float = 0.8, **options: Any) -> fb.Scene:
    """A mass that slides along a clamped beam of 2 m."""
    beam = fb.Beam.straight("rail", (0, 0, 0), (2, 0, 0), section=SECTION, elements=elements)
    bead = fb.PointMass("bead", mass=0.5, position=(at, 0, 0))
    return fb.Scene(beam, bead, fb.Clamp(beam.start), fb.Clamp(beam.end),
                    fb.Slider("run", bead, beam, at=at, rate=rate, **options), gravity=(0, 0, -9.81))


def run(scene: fb.Scene, moving: bool, points: Any = None, **options: Any) -> tuple[fb.Model, fb.Result]:
    model = fb.compile_scene(scene, moving=moving)
    return model, fb.simulate(model, t_end=0.3, step=2e-3, points=points, progress=False, **options)


@pytest.fixture(scope="module")
def moved(tmp_path_factory: pytest.TempPathFactory) -> tuple[fb.Scene, fb.Model, fb.Result, Path]:
    scene, file = rider(), tmp_path_factory.mktemp("rows") / "run.h5"
    beam = scene.beams[0]
    points = {"inside": (beam, INSIDE), "node": beam.node(10), "end": beam.end}
    return scene, *run(scene, True, points, observe=KINDS, output=str(file)), file


def test_rows_are_those_of_material_points(moved: Any) -> None:
    scene, model, result, _ = moved
    beam, fine = scene.beams[0], rider(64)
    places = {str(k): (fine.beams[0], float(s)) for k, s in enumerate(beam.node_s)} | {"inside": (fine.beams[0], INSIDE)}
    _, there = run(fine, False, places, observe=KINDS)
    at, nodes = np.searchsorted(there.t, result.t_snap), model.numbers.span(beam)
    exact = np.stack([there.point(str(k)) for k in range(beam.n_nodes)], axis=1)[at]
    assert np.ptp(result.slider("run")["s"]) > 0.2 and np.max(np.abs(exact - exact[:1])) > 0.01
    np.testing.assert_allclose(result.phi[:, nodes], exact, rtol=0, atol=1e-4)
    np.testing.assert_allclose(result.point("inside"), there.point("inside"), rtol=0, atol=1e-4)
    np.testing.assert_allclose(result.point("node")[at], result.phi[:, nodes][:, 10], rtol=0, atol=1e-14)
    triads = result.directors[:, nodes]
    np.testing.assert_allclose(triads @ triads.transpose(0, 1, 3, 2), np.broadcast_to(np.eye(3), triads.shape), atol=1e-14)


def test_velocities_and_spins_are_rates_of_the_rows(moved: Any) -> None:
    _, model, result, _ = moved
    x, v = result.series["points"], result.series["point_velocity"]
    rate = (x[2:] - x[:-2]) / (result.t[2:] - result.t[:-2])[:, None, None]
    # of second order in the step
    assert np.max(np.abs(v)) > 0.2 and np.max(np.abs(rate - v[1:-1])) < 0.02 * np.max(np.abs(v))
    d, w = result.series["point_directors"], result.series["point_spin"]
    turning = (d[2:] - d[:-2]) / (result.t[2:] - result.t[:-2])[:, None, None, None]
    off = turning - np.cross(w[1:-1, :, None], d[1:-1])
    assert np.max(np.abs(w)) > 0.3 and np.max(np.abs(off)) < 0.1 * np.max(np.abs(w))
    at = np.searchsorted(result.t, result.t_snap)
    np.testing.assert_allclose(result.velocities[:, model.numbers.start(moved[0].beams[0]) + 10], v[at, 1], rtol=0, atol=1e-13)
    np.testing.assert_allclose(result.spins[:, model.numbers.start(moved[0].beams[0]) + 10], w[at, 1], rtol=0, atol=1e-3)


def test_section_forces_of_rows_states_and_files(moved: Any) -> None:
    scene, model, result, file = moved
    beam = scene.beams[0]
    own = fb.section_forces(model, result, beam, INSIDE)
    at = np.searchsorted(result.t, result.t_snap)
    np.testing.assert_allclose(own.M2[:, 0], result.series["section_moment"][at, 0, 1], rtol=1e-12)
    np.testing.assert_allclose(own.M2[-1], fb.section_forces(model, result.state, beam, INSIDE).M2[0], rtol=1e-12)
    read = fb.load_result(file)
    assert read.mesh is not None and np.array_equal(read.mesh, result.mesh) and np.array_equal(read.phi, result.phi)
    np.testing.assert_array_equal(fb.section_forces(model, read, beam, INSIDE).M2, own.M2)
    with pytest.raises(fb.SceneError, match="mesh .* does not fit"):
        fb.Result(t=[0.0], t_snap=[0.0], phi=np.zeros((1, 2, 3)), mesh=np.zeros((1, 2, 3)))


def test_sections_beside_reactions_are_those_of_stresses() -> None:
    """Forces from balance are those of elements that stand, and are not told."""
    scene = rider(at=0.6, rate=0.0)
    model, beam = fb.compile_scene(scene, moving=True), scene.beams[0]
    found = [fb.solve_static(model, held=True, points={"inside": (beam, INSIDE)}, observe=kinds).section("inside")
             for kinds in (("section",), ("section", "reaction"))]
    assert "force" not in found[1]
    np.testing.assert_array_equal(found[0]["M2"], found[1]["M2"])
    (_, one), (_, other) = (run(scene, True, {"inside": (beam, INSIDE)}, observe=kinds) for kinds in (
        ("slider", "section"), ("slider", "section", "reaction")))
    np.testing.assert_array_equal(one.section("inside")["M2"], other.section("inside")["M2"])
    assert "force" not in other.section("inside")


def test_states_go_from_one_mesh_to_another() -> None:
    scene = rider()
    (moving, one), (standing, other) = (run(scene, x, output=fb.Output(snapshots=300)) for x in (True, False))
    for result, model in ((one, standing), (other, moving)):
        state = result.state_for(model)
        assert state.s[0] == result.state.s[0]
        there = fb.simulate(model, start=fb.Start(state, mend=True), t_end=0.01, step=2e-3, progress=False)
        # but for the kink that a mesh that stands cannot show
        assert there.series["total"][0] == pytest.approx(result.series["total"][-1], abs=0.02 * result.series["kinetic"][-1])
        assert there.series["kinetic"][0] == pytest.approx(result.series["kinetic"][-1], rel=1e-3)
        assert there.slider("run")["s"][1] == pytest.approx(result.state.s[0] + 2e-3 * 0.8, abs=2e-4)
        np.testing.assert_allclose(there.phi[0], result.phi[-1], rtol=0, atol=1e-5)
    same = one.state_for(fb.compile_scene(rider(), moving=True))
    np.testing.assert_array_equal(same.q, one.state.q)


def test_rows_of_equilibria() -> None:
    """A ring at rest off the middle of the beam: rows of both meshes agree but for the kink."""
    shapes = []
    for moving in (True, False):
        scene = rider(8 if moving else 64, at=0.7, rate=0.0)
        model = fb.compile_scene(scene, moving=moving)
        rest, beam = fb.solve_static(model, held=True), scene.beams[0]
        shapes.append(rest.phi[-1, model.numbers.start(beam) + (np.arange(0, 25, 3) if moving else np.arange(0, 193, 24))])
    assert np.max(np.abs(shapes[1][:, 2])) > 0.01
    np.testing.assert_allclose(shapes[0], shapes[1], rtol=0, atol=1e-5)


def test_what_can_move() -> None:
    scene = rider()
    assert fb.compile_scene(scene, moving="auto").moving is not None
    for refused in (rider(release=fb.Release(when=0.1)), rider(1)):
        assert fb.compile_scene(refused, moving="auto").moving is None
        with pytest.raises(fb.SceneError, match="compile_scene: moving=True.*(has a release|has 1 elements)"):
            fb.compile_scene(refused, moving=True)
    alone = fb.Beam.straight("alone", (0, 0, 0), (1, 0, 0), section=SECTION, elements=2)
    assert fb.compile_scene(fb.Scene(alone, fb.Clamp(alone.start)), moving="auto").moving is None
    with pytest.raises(fb.SceneError, match="has no sliders"):
        fb.compile_scene(fb.Scene(alone, fb.Clamp(alone.start)), moving=True)


def test_modes_and_responses_have_rows_of_material_points() -> None:
    scene, fine = rider(at=0.6, rate=0.0), rider(64, at=0.6, rate=0.0)
    beam, places = scene.beams[0], scene.beams[0].node_s
    found = []
    for one, moving in ((scene, True), (fine, False)):
        model = fb.compile_scene(one, moving=moving)
        rest = fb.solve_static(model, held=True)
        points = {str(k): (one.beams[0], float(s)) for k, s in enumerate(places)}
        nodes = {"node": beam.node(10)}
        nodes = nodes if moving else {str(d): (one.beams[0], float(places[10] + d)) for d in (-1e-3, 1e-3)}
        response = fb.frequency_response(model, [2.0, 9.0], base=(0, 0, 1), state=rest.state, points=points | nodes, held=True,
                                         shapes=moving)
        found.append((model, rest, response))
    (model, rest, own), (_, _, there) = found
    nodes = model.numbers.span(beam)
    at = slice(0, places.size)
    np.testing.assert_allclose(own.displacements[:, at], there.displacements[:, at], rtol=0, atol=1e-3)
    np.testing.assert_allclose(own.shape(1)[nodes], own.displacements[1, :places.size], rtol=0, atol=1e-12)
    # w x d1 is the slope of the deflection
    slope = (there.point("0.001") - there.point("-0.001")) / 2e-3
    np.testing.assert_allclose(own.spin("node")[:, 1], -slope[:, 2], rtol=0.02)
    modes = fb.modes(model, state=rest.state, n=2, held=True)
    for k in range(2):
        moved = model.moving.own_shape(modes.state(k, 1e-6))[0][nodes] - model.moving.own_shape(rest.state)[0][nodes]
        np.testing.assert_allclose(moved[:, 0] / 1e-6, modes.displacements[k][nodes], rtol=0, atol=1e-8)
        turning = np.cross(modes.spins[k][nodes][:, None], modes.directors[nodes])
        np.testing.assert_allclose(moved[:, 1:] / 1e-6, turning, rtol=0, atol=1e-4)
    np.testing.assert_array_equal(modes.positions[nodes], model.moving.own_shape(rest.state)[0][nodes, 0])


def test_velocities_that_a_user_writes_are_those_of_the_material() -> None:
    """A mass that is pushed along its beam amid a run goes on as on a fine mesh that stands."""
    places = []
    for elements, moving in ((8, True), (64, False)):
        scene = rider(elements)
        model, first = run(scene, moving)
        state, bead = first.state, model.numbers.start(next(x for x in scene.parts if isinstance(x, fb.PointMass)))
        tangent = contact(model, 0, float(state.s[0]), *[state.q.reshape(-1, 4, 3)] * 2)[1]
        state.v.reshape(-1, 4, 3)[bead, 0] += 0.9 * tangent / np.linalg.norm(tangent)
        second = fb.simulate(model, start=state, t_end=0.3, step=2e-3, progress=False)
        assert any("velocities of the material" in x["text"] for x in second.events) == moving
        assert second.drift("total") < 1e-11
        places.append(second.slider("run")["s"])
    assert places[1][-1] - places[1][0] > 1.8 * (places[1][0] - 0.3)
    np.testing.assert_allclose(places[0], places[1], rtol=0.0, atol=2e-4)


@pytest.mark.parametrize("t_end", [0.2, 1.9])
def test_a_motion_goes_back_with_opposite_velocities(t_end: float) -> None:
    """Back from the middle of the beam, and from 5 cm before its end, where the contact is inside an element; and on."""
    scene = rider()
    model = fb.compile_scene(scene, moving=True)
    options: dict[str, Any] = {"t_end": t_end, "step": 5e-3, "progress": False}
    there = fb.simulate(model, **options)
    back = fb.simulate(model, start=there.state._replace(v=-there.state.v), **options)
    assert not [x for x in back.events if x["kind"] == "start"]
    assert abs(there.state.s[0] - 0.3) > 0.1
    assert np.max(np.abs(back.state.q - model.q0)) < 1e-9 and abs(back.state.s[0] - 0.3) < 1e-9
    on = fb.simulate(model, start=there.state, t_end=0.02, step=5e-3, progress=False)
    assert not [x for x in on.events if x["kind"] == "start"]
