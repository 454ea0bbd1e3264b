"""Beams with stress in their reference: exact frequencies, equilibria, conservation, and agreement with beams stretched by
hand."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg as dense

import fastbeam as fb

Array = np.ndarray
L, EA, GA, EI, RHO_A, RHO_I = 10.0, 2e5, 1e5, 1e3, 1.0, 0.05
THICK = fb.Section(EA=EA, GA2=GA, GA3=GA, GJ=1e3, EI2=EI, EI3=EI, rhoA=RHO_A, rhoI2=RHO_I, rhoI3=RHO_I)
STRING = fb.Section(EA=1e5, GA2=1e5, GA3=1e5, GJ=1e-3, EI2=1e-4, EI3=1e-4, rhoA=0.2, rhoI2=1e-9, rhoI3=1e-9)


def held(section: fb.Section, elements: int = 8, degree: int = 5, **changes: Any) -> fb.Model:
    beam = fb.Beam.straight("beam", (0, 0, 0), (L, 0, 0), section=section, elements=elements, degree=degree, **changes)
    return fb.compile_scene(fb.Scene(beam, fb.Pin(beam.start), fb.Pin(beam.end)))


@pytest.mark.parametrize("strain", ["simo_reissner", "green_lagrange"])
def test_taut_string_by_prestress_alone(strain: str) -> None:
    """w = n pi/L sqrt(T/rhoA), without any load or displacement, in both planes."""
    tension = 300.0
    found = fb.modes(held(STRING, elements=12, strain=strain, prestress=tension), n=9)
    assert found.unstable == 0
    swinging = found.angular[found.angular > 0.0]
    for n in (1, 2, 3):
        np.testing.assert_allclose(swinging[2 * n - 2:2 * n], n * np.pi / L * np.sqrt(tension / 0.2), rtol=1e-6)


@pytest.mark.parametrize("tension", [400.0, -60.0])
def test_thick_beam_taut_or_pressed(tension: float) -> None:
    """Exact with shear and rotary inertia on the axis of the reference: a stretch of one, a normal force T."""
    found = fb.modes(held(THICK, prestress=tension), n=12)
    for n in (1, 2, 3):
        k, c = n * np.pi / L, GA - tension
        stiffness = np.array([[GA * k * k, -c * k], [-c * k, EI * k * k + c]])
        exact = dense.eigh(stiffness, np.diag([RHO_A, RHO_I]), eigvals_only=True)[0]
        assert np.min(np.abs(found.angular - np.sqrt(exact))) < 1e-8 * np.sqrt(exact)
    pressed = fb.modes(held(THICK, prestress=-1.2 * EI * (np.pi / L)**2), n=3)
    assert pressed.unstable == 2, "buckled in both planes"


def test_prestrain_is_the_length_without_stress() -> None:
    """Free at one end a beam of 10 m with prestrain 0.02 is 9.8 m long; a curved one keeps its angles."""
    beam = fb.Beam.straight("beam", (0, 0, 0), (L, 0, 0), section=THICK, elements=3, prestrain=0.02)
    result = fb.solve_static(fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start))), points={"tip": beam.end})
    np.testing.assert_allclose(result.point("tip")[-1], (9.8, 0, 0), atol=1e-11)
    assert abs(result.series["strain"][-1]) < 1e-16 < result.series["strain"][0]
    assert result.series["strain"][0] == pytest.approx(0.5 * EA * 0.02**2 * L, rel=1e-12)
    # two beams in a row, one of them short: T (1/EA1 + 1/EA2) l = e l
    half = fb.Beam.straight("half", (0, 0, 0), (5, 0, 0), section=THICK, elements=3, prestrain=0.01)
    rest = fb.Beam.straight("rest", (5, 0, 0), (L, 0, 0), section=THICK, elements=2)
    model = fb.compile_scene(fb.Scene(half, rest, fb.RigidConnection(half.end, rest.start), fb.Clamp(half.start),
                                      fb.Clamp(rest.end)))
    state = fb.solve_static(model).state
    for part in (half, rest):
        np.testing.assert_allclose(fb.section_forces(model, state, part).N, 0.005 * EA, rtol=1e-9)


def test_coupled_section_gets_the_normal_force_alone() -> None:
    coupled = np.diag([EA, GA, GA, 1e3, EI, EI])
    coupled[0, 3] = coupled[3, 0] = 4e3
    section = fb.Section.from_matrix(coupled, rhoA=1.0, rhoI2=0.05, rhoI3=0.05)
    beam = fb.Beam.straight("beam", (0, 0, 0), (L, 0, 0), section=section, elements=2, prestress=150.0)
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Clamp(beam.end)))
    found = fb.section_forces(model, model.state(), beam)
    np.testing.assert_allclose(found.N, 150.0, rtol=1e-12)
    np.testing.assert_allclose(np.abs(found.T) + np.abs(found.M2) + np.abs(found.Q2), 0.0, atol=1e-11)


@pytest.mark.parametrize("planar", [True, False])
def test_runs_conserve_and_agree_with_a_string_stretched_by_hand(planar: bool) -> None:
    """A bead on a plucked string, its tension from prestress, or from supports moved apart: EA of the stretched length."""
    tension, section = 300.0, STRING
    e = tension / section.C[0, 0]

    def scene(length: float, **changes: Any) -> fb.Model:
        beam = fb.Beam.straight("string", (0, 0, 0), (length, 0, 0), section=section, elements=8, **changes)
        bead = fb.PointMass("bead", mass=0.3)
        return fb.compile_scene(fb.Scene(beam, bead, fb.Slider("run", bead, beam, at=0.3 * length), fb.Pin(beam.start),
                                         fb.Pin(beam.end), gravity=(0, 0, -9.81)), planar=planar)

    taut = scene(L, prestress=tension)
    run = fb.simulate(taut, t_end=0.5, step=0.005, progress=False)
    assert max(run.drift("total"), run.drift("gap")) < 1e-11
    model = scene(L / (1.0 + e))
    start = model.state()
    start.q.reshape(-1, 4, 3)[:, 0] *= 1.0 + e
    other = fb.simulate(model, start=start, t_end=0.5, step=0.005, progress=False)
    mine, its = run.slider("run")["position"][-1], other.slider("run")["position"][-1]
    # the mass of the string is that of its reference: it differs by e
    assert np.linalg.norm(mine - its) < 3.0 * e * np.linalg.norm(mine - (0.3 * L, 0, 0))


def test_net_with_prestressed_cables_and_its_beams() -> None:
    """A cross of four cables, each with its force, with a load in the middle: as of four beams, also condensed."""
    nodes = np.array([(0, 0, 0), (1, 0, 0), (0, 2, 0), (-1, 0, 0), (0, -2, 0)], float)
    edges = [(0, k) for k in range(1, 5)]
    force = [100.0, 60.0, 100.0, 60.0]
    loads = np.zeros((5, 3))
    loads[0, 2] = -5.0
    net = fb.Net("net", nodes, edges, section=STRING, elements=4, degree=3, pins=[1, 2, 3, 4], prestress=force, loads=loads)
    model = fb.compile_scene(fb.Scene(net))
    whole = fb.solve_static(model)
    beams = [fb.Beam.straight(f"b{k}", nodes[0], nodes[k + 1], section=STRING, elements=4, prestress=force[k]) for k in range(4)]
    joints = [fb.RigidConnection(beams[0].start, beam.start) for beam in beams[1:]]
    apart = fb.compile_scene(fb.Scene(*beams, *joints, *(fb.Pin(beam.end) for beam in beams),
                                      fb.Load("down", beams[0].start, force=(0, 0, -5.0))))
    parts = fb.solve_static(apart)
    for k, beam in enumerate(beams):
        mine = fb.section_forces(model, whole.state, net.beam(k)).N
        np.testing.assert_allclose(mine, fb.section_forces(apart, parts.state, beam).N, rtol=1e-6)
        np.testing.assert_allclose(fb.section_forces(model, model.state(), net.beam(k)).N, force[k], rtol=1e-12)
    run = fb.simulate(model, t_end=0.05, step=1e-3, progress=False)
    assert run.drift("total") < 1e-11


@pytest.mark.parametrize(("changes", "message"), [
    ({"prestrain": 0.1, "prestress": 5.0}, "give prestrain or prestress, not both"),
    ({"prestrain": 1.0}, "prestrain must be a finite number >= -10 and <= 0.99"),
    ({"prestress": 3e5}, "gives it a prestrain of 1.5, so its unstressed length would not be positive"),
    ({"prestress": np.nan}, "prestress must be a finite number")])
def test_what_no_beam_can_have_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(fb.SceneError, match=message):
        fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=THICK, elements=1, **changes)
    if "prestrain" in changes or changes["prestress"] == 3e5:
        with pytest.raises(fb.SceneError, match="edge 1|not both"):
            value = {name: [0.0, x] for name, x in changes.items()}
            fb.Net("net", [(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1), (1, 2)], section=THICK, **value)
    with pytest.raises(fb.SceneError, match="prestress must be a finite number .* or 1 of them"):
        fb.Net("net", [(0, 0, 0), (1, 0, 0)], [(0, 1)], section=THICK, prestress=[1.0, 2.0])


# --- force densities --------------------------------------------------------------------------------------------------------
def saddle_roof(n: int) -> tuple[Array, Array, Array]:
    """A square mesh, nodes inside at zero, with a rim that is high at two corners: nodes, edges, pins."""
    u, v = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n), indexing="ij")
    number = np.arange(n * n).reshape(n, n)
    rim = np.unique(np.concatenate((number[0], number[-1], number[:, 0], number[:, -1])))
    nodes = np.stack((u.ravel(), v.ravel(), 0.4 * (u * v).ravel()), axis=1)
    edges = np.concatenate((np.stack((number[:-1, 1:-1].ravel(), number[1:, 1:-1].ravel()), 1),
                            np.stack((number[1:-1, :-1].ravel(), number[1:-1, 1:].ravel()), 1)))
    corners = np.setdiff1d(rim, edges)
    kept = np.setdiff1d(np.arange(n * n), corners)
    new = np.full(n * n, -1)
    new[kept] = np.arange(kept.size)
    return nodes[kept], new[edges], new[np.setdiff1d(rim, corners)]


def test_net_of_force_densities_is_in_equilibrium_as_it_is_drawn() -> None:
    nodes, edges, pins = saddle_roof(6)
    q = 50.0 + 30.0 * np.random.default_rng(1).random(len(edges))
    loads = np.zeros(nodes.shape)
    loads[:, 2] = -2.0
    places = fb.force_density(nodes, edges, q, pins, loads=loads)
    np.testing.assert_array_equal(places[pins], nodes[pins])
    # naive: node by node
    inside = np.setdiff1d(np.arange(len(nodes)), pins)
    for i in inside:
        pull = sum(q[k] * (places[edges[k]].sum(axis=0) - 2.0 * places[i]) for k in np.flatnonzero((edges == i).any(axis=1)))
        np.testing.assert_allclose(pull + loads[i], 0.0, atol=1e-11)
    lengths = np.linalg.norm(places[edges[:, 1]] - places[edges[:, 0]], axis=1)
    net = fb.Net("roof", places, edges, section=STRING, elements=2, pins=pins, prestress=q * lengths, loads=loads)
    model = fb.compile_scene(fb.Scene(net))
    rest = fb.solve_static(model, load_step=1.0)
    np.testing.assert_allclose(rest.state.q, model.state().q, atol=1e-11)
    found = fb.modes(model, n=4)
    assert found.unstable == 0 and np.all(found.squared > 0.0)


@pytest.mark.parametrize(("changes", "message"), [
    ({"edges": [(0, 5)]}, "edges: must be node numbers from 0 to 2"), ({"pins": [0.5]}, "pins: must be node numbers"),
    ({"densities": [1.0]}, "densities: must be a finite number in N/m or 2 of them"),
    ({"edges": [(1, 1), (0, 2)]}, "with itself"),
    ({"densities": [0.0, 1.0]}, "no cables with a density lead from node 0|from node 2|from node 1"),
    ({"densities": [1.0, -1.0]}, "tension and compression cancel"), ({"loads": np.ones((2, 3))}, "forces of all 3 nodes")])
def test_force_densities_that_have_no_shape(changes: dict[str, Any], message: str) -> None:
    arguments = dict(nodes=[(0, 0, 0), (2, 0, 0), (1, 1, 0)], edges=[(0, 2), (1, 2)], densities=[3.0, 1.0], pins=[0, 1])
    if "densities" in changes and changes["densities"][0] == 0.0:
        arguments["pins"] = [0]
    with pytest.raises(fb.SceneError, match=message):
        fb.force_density(**arguments | changes)
