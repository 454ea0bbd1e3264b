"""Beams cut at contacts: element ends, the scene on them, and the derivatives of an element's energy, against the slow twin."""
from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.compile.cut_beams import Acting, Cut, Element, moved, slots_of
from fastbeam.scene.interpolation.basis import build_basis

sys.path.insert(0, str(Path(__file__).parents[1]))
from naive import beam_strains  # noqa: E402

Array = np.ndarray
SOFT = fb.Section(EA=2e3, GA2=1e3, GA3=1.2e3, GJ=80.0, EI2=100.0, EI3=120.0, rhoA=1.5, rhoI2=0.02, rhoI3=0.03)


def ends(beam: fb.Beam, kept: Any, contacts: dict[int, float]) -> list[float]:
    return [round(slot.at, 12) for slot in slots_of(beam, np.array(kept), contacts)]


def test_contacts_are_element_ends_and_those_near_them_give_way() -> None:
    beam = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=SOFT, elements=4)
    assert ends(beam, [0, 1], {0: 0.4}) == [0, 0.25, 0.4, 0.5, 0.75, 1]
    assert ends(beam, [0, 1], {0: 0.3, 1: 0.7}) == [0, 0.3, 0.5, 0.7, 1]
    # a node that other parts refer to stays, and two contacts at one place are one end
    assert ends(beam, [0, 0.25, 1], {0: 0.3, 1: 0.3}) == [0, 0.25, 0.3, 0.5, 0.75, 1]
    at_node = slots_of(beam, np.array([0.0, 0.25, 1.0]), {3: 0.25})
    assert at_node[1].contacts == (3,) and at_node[1].stays


def test_a_contact_takes_its_node_along_until_elements_become_short() -> None:
    beam = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=SOFT, elements=4)
    slots = slots_of(beam, np.array([0.0, 1.0]), {0: 0.4})
    on = moved(slots, {0: 0.42})
    assert on is not None and [slot.at for slot in on] == [0, 0.25, 0.42, 0.5, 0.75, 1]
    assert moved(slots, {0: 0.499}) is None and moved(slots, {0: 0.6}) is None


@pytest.mark.parametrize("a, b", [(0.5, 1.3), (3e-4, 1.3), (0.5, 2.4 - 3e-4)], ids=["within", "from the start", "to the end"])
@pytest.mark.parametrize("strain", ["simo_reissner", "green_lagrange"])
def test_slopes_of_an_element_are_those_of_the_twin(strain: str, a: float, b: float) -> None:
    """Also beside the end of the beam, where differences by the place reach into the element alone."""
    arc = fb.Beam.arc("arc", (0, 0, 0), (1, 0, 0), (0, 0, 1), radius=2.0, angle=1.2, section=SOFT, elements=3, strain=strain,
                      prestrain=0.01)
    load = fb.DistributedLoad("wind", arc, force=lambda s: np.stack((0 * s, 1.0 + s, s**2), axis=1))
    weight = 1.5 * np.array((0.3, 0.0, -9.81))
    rng = np.random.default_rng(3)
    nodes = a + (b - a) * build_basis("lagrange", 3, 1, 1.0).node_s
    q = np.concatenate([x.reshape(4, -1, 3) for x in arc.reference(nodes)], axis=1)
    q[:, 0] += 0.05 * rng.standard_normal((4, 3))
    q[:, 1:] += 0.05 * rng.standard_normal((4, 3, 3))

    def energy(ends: tuple[float, float], q: Array) -> float:
        # the element as one of a beam of three
        beam = replace(arc, elements=np.array([0.0, *ends, arc.length]))
        full = np.concatenate([x.reshape(beam.n_nodes, -1, 3) for x in beam.reference(beam.node_s)], axis=1)
        at = beam.basis.element_nodes
        start = beam_strains(beam, full[at])[1]
        full[at[1]] = q
        strain = beam_strains(beam, full[at])[1] - start + beam.start_strain
        w, x = beam.basis.mass_weight[1], beam.basis.mass_point_s[1]
        force = weight + 0.7 * load.force_at(x)
        work = np.einsum("g,gc,gn,nc->", w, force, beam.basis.mass_phi_values[1], q[:, 0])
        return float(0.5 * np.einsum("g,gi,ij,gj->", beam.basis.weight[1], strain, SOFT.C, strain) - work)

    slopes, gradient = Element(arc, Acting(weight, ((load, 0.7),)), (a, b), q).slopes((0, 1))
    step = 1e-5
    for side in (0, 1):
        near = [(a + w * (side == 0), b + w * (side == 1)) for w in (step, -step)]
        assert slopes[side] == pytest.approx((energy(near[0], q) - energy(near[1], q)) / (2 * step), rel=1e-7)
    for at in ((1, 0, 2), (2, 1, 0), (3, 3, 1)):
        x = np.zeros_like(q)
        x[at] = step
        assert gradient[at] == pytest.approx((energy((a, b), q + x) - energy((a, b), q - x)) / (2 * step), rel=1e-6)


def test_a_cut_scene_has_the_same_parts() -> None:
    left = fb.Beam.straight("left", (0, 0, 0), (1, 0, 0), section=SOFT, elements=4)
    right = fb.Beam.straight("right", (2, 0, 0), (1, 0, 0), section=SOFT, elements=4)
    ring, bob = fb.PointMass("ring", mass=1.0), fb.RigidBody("bob", mass=1.0, inertia=(1, 1, 1), position=(0.25, 0, -1))
    path = fb.Path("way", [left, (right, -1)])
    scene = fb.Scene(left, right, ring, bob, fb.Pin(left.start), fb.RigidConnection(left.end, right.end), fb.Clamp(right.start),
                     fb.Slider("run", ring, on=path, at=1.7), fb.DistributedLoad("wind", right, force=(0, 0, -1)),
                     fb.Spring(left.node(5), bob, stiffness=10.0), gravity=(0, 0, -9.81))
    cut = Cut(scene, np.array([1.7]))
    assert cut.places[0].beam is right and cut.places[0].at == pytest.approx(0.3) and cut.places[0].sign == -1
    new = cut.new[right]
    assert np.allclose(new.elements, [0, 0.3, 0.5, 0.75, 1]) and [x.name for x in cut.scene.beams] == ["left", "right"]
    assert cut.scene.beams[0] is left and cut.scene.distributed[0].beam is new and cut.scene.sliders[0].beam.beams == (left, new)
    assert cut.scene.rigid[0].b == new.end and cut.scene.links[0].a == left.node(5)
    cut.scene.check()
    # a node that something is on is still there
    again = Cut(scene, np.array([0.4]))
    assert again.scene.links[0].a.owner is again.new[left]
    assert again.scene.beams[0].node_s[again.scene.links[0].a.index] == pytest.approx(left.node_s[5], abs=1e-14)


def refused(*more: Any, on: str = "lagrange", **slider: Any) -> str:
    beam = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=SOFT, elements=4, interpolation=on)
    ring = fb.PointMass("ring", mass=1.0)
    parts = [x(beam) for x in more]
    model = fb.compile_scene(fb.Scene(beam, ring, fb.Clamp(beam.start), fb.Clamp(beam.end), *parts,
                                      fb.Slider("run", ring, beam, at=0.4, **slider), gravity=(0, 0, -1)))
    with pytest.raises(fb.SceneError) as error:
        fb.solve_static(model, contacts="exact")
    return str(error.value)


def test_what_cannot_be_exact_is_refused_by_name() -> None:
    assert "slider 'run' is on beam 'rod' with interpolation 'bspline'" in refused(on="bspline")
    text = refused(lambda beam: fb.DistributedLoad("twist", beam, moment=(1, 0, 0)))
    assert "distributed load 'twist' acts" in text and "leave contacts= out" in text
    net = fb.Net("net", nodes=[(0, 0, 0), (1, 0, 0), (2, 0, 0)], edges=[(0, 1), (1, 2)], section=SOFT, elements=2, pins=[0, 2])
    ring = fb.PointMass("ring", mass=1.0)
    model = fb.compile_scene(fb.Scene(net, ring, fb.Slider("run", ring, net.beam(0), at=0.4), gravity=(0, 0, -1)))
    with pytest.raises(fb.SceneError, match="slider 'run' is on .*whose elements have equal lengths; make it a Beam of its own"):
        fb.solve_static(model, contacts="exact")
    a = fb.Beam.straight("a", (0, 0, 0), (1, 0, 0), section=SOFT, elements=2)
    b = fb.Beam.straight("b", (0.4, -1, 0), (0.4, 1, 0), section=SOFT, elements=2)
    scene = fb.Scene(a, b, *(fb.Clamp(x) for beam in (a, b) for x in (beam.start, beam.end)),
                     fb.Crossing("x", a, b, at=(0.4, 1.0)))
    with pytest.raises(fb.SceneError, match="belongs to a crossing, which only contacts='mesh' supports"):
        fb.solve_static(fb.compile_scene(scene), contacts="exact")
