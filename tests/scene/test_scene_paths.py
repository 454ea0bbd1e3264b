"""Paths as nouns and as tables: what is refused and why, places, directions, joints, tangents."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.compile.tracks import contact_curve_of
from fastbeam.kernels.contact import curves as kernels
from fastbeam.model.mapping import shapes_at
from fastbeam.model.numbering import NodeList

SECTION = fb.Section.circle(radius=0.02, E=1e6, rho=1000.0)
A = fb.Beam.straight("a", (0, 0, 0), (2, 0, 0), section=SECTION, elements=3)
B = fb.Beam.straight("b", (2, 1, 0), (2, 0, 0), section=SECTION, elements=2, degree=2)
C = fb.Beam.straight("c", (2, 1, 0), (0, 0, 0), section=SECTION, elements=[0.0, 1.0, 5**0.5], interpolation="bspline", degree=3)
ON = fb.Beam.straight("on", (2, 0, 0), (3, 0, 0), section=SECTION, elements=1, degree=4)
BEAD = fb.PointMass("bead", mass=1.0)
TRIANGLE = fb.Path("triangle", [A, (B, -1), C], closed=True)


def scene(path: fb.Path, *parts: Any, at: float = 0.5, **options: Any) -> fb.Scene:
    return fb.Scene(*path.beams, BEAD, fb.Slider("s", BEAD, on=path, at=at, **options), *parts)


def joined(path: fb.Path, joint: Any = fb.RigidConnection, **options: Any) -> fb.Scene:
    return scene(path, *(joint(a, b) for a, b in path.joints()), **options)


# --- the noun ------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("beams", "text"), [
    ([], "is empty"), (A, r"must be a list of beams.*write \[beam\]"), ("ab", "must be a list of beams"), (3, "must be a list"),
    ([A, "b"], "must be beams, or pairs"), ([A, A.end], "give beam 'a' itself"), ([A, B, (A, -1)], "beam 'a' appears twice"),
    ([(A, 2)], "beam 'a' in direction 2"), ([(A, "back")], "in direction 'back'"), ([(BEAD, 1)], "must be beams"),
    ([fb.Net("net", [(0, 0, 0), (1, 0, 0)], [(0, 1)], section=SECTION)], r"use its beam\(k\)"), (None, "must be a list")])
def test_what_is_no_list_of_beams_is_refused(beams: Any, text: str) -> None:
    with pytest.raises(fb.SceneError, match=text):
        fb.Path("p", beams)


def test_places_along_an_open_path() -> None:
    path = fb.Path("p", [A, (B, -1)])
    assert path.length == 3.0 and path.directions == (1, -1)
    for s, beam, local in ((0.0, A, 0.0), (1.5, A, 1.5), (2.0, B, 1.0), (2.25, B, 0.75), (3.0, B, 0.0)):
        assert path.locate(s) == (beam, pytest.approx(local))
    which, local = path.places([0.5, 2.5])
    assert which.tolist() == [0, 1] and local.tolist() == [0.5, 0.5]
    with pytest.raises(fb.SceneError, match=r"path 'p': s=3.1 lies outside it \(0 to 3 m\)"):
        path.locate(3.1)


def test_places_around_a_closed_path() -> None:
    length = TRIANGLE.length
    assert length == pytest.approx(3.0 + 5**0.5)
    for rounds in (-2, 0, 7):
        beam, s = TRIANGLE.locate(2.25 + rounds * length)
        assert beam is B and s == pytest.approx(0.75)
    phi, triads = TRIANGLE.reference([2.25, 2.25 - 3 * length])
    np.testing.assert_allclose(phi, [[2.0, 0.25, 0.0]] * 2, atol=1e-12)
    # along the path, and still right-handed
    np.testing.assert_allclose(triads[:, 0], [[0.0, 1.0, 0.0]] * 2, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(triads), 1.0)


def test_a_slider_says_once_what_it_slides_on() -> None:
    path = fb.Path("p", [A, (B, -1)])
    one, two = fb.Slider("s", BEAD, path, at=1.0), fb.Slider("s", BEAD, on=path, at=1.0)
    assert one.beam is one.on is two.beam is path and one.beams == (A, B)
    assert fb.Slider("s", BEAD, A, at=1.0).beams == (A,)
    for given in ({}, {"beam": A, "on": path}):
        with pytest.raises(fb.SceneError, match="needs exactly one curve to slide on"):
            fb.Slider("s", BEAD, at=1.0, **given)
    with pytest.raises(fb.SceneError, match=r"must be a Beam, got .p. \(or a Path\)"):
        fb.Slider("s", BEAD, on="p", at=1.0)


# --- in a scene ------------------------------------------------------------------------------------------------------------
def refused(what: fb.Scene) -> str:
    with pytest.raises(fb.SceneError) as found:
        fb.compile_scene(what)
    return str(found.value)


def test_beams_that_do_not_meet_are_named_with_their_distance() -> None:
    text = refused(scene(fb.Path("p", [A, B])))
    assert "path 'p': beam 'a' node 9 (s = 2 m) and beam 'b' node 0 (s = 0 m) do not meet, their distance is 1 m" in text
    assert "(beam, -1) runs backwards" in text
    assert "leave closed=True out" in refused(scene(fb.Path("p", [A, ON], closed=True)))
    assert "name the beams in their order" in refused(scene(fb.Path("p", [ON, C])))


def test_beams_that_nothing_joins_are_refused() -> None:
    path = fb.Path("p", [A, ON])
    assert "meet without a joint" in refused(scene(path))
    # on supports side by side, and by way of a body
    body = fb.RigidBody("b", mass=1.0, inertia=(1, 1, 1), position=(2, 1, 0))
    hook = body.point((0, -1, 0))
    ways: list[tuple[Any, ...]] = [(fb.Pin(A.end), fb.Pin(ON.start)), (fb.Pin(A.end), fb.Clamp(ON.start)),
                                   (body, fb.BallJoint(A.end, hook), fb.RigidConnection(hook, ON.start)),
                                   (body, fb.BallJoint(A.end, hook), fb.BallJoint(hook, ON.start))]
    for parts in ways:
        fb.compile_scene(scene(path, *parts))
    assert "meet without a joint" in refused(scene(path, fb.Pin(A.end)))
    assert "meet without a joint" in refused(scene(path, body, fb.BallJoint(A.end, hook),
                                                   fb.BallJoint(body.point((1, -1, 0)), ON.end)))


@pytest.mark.parametrize(("options", "text"), [
    ({"at": 3.2}, "at=3.2 lies outside path 'p'"), ({"at": -0.1}, "at=-0.1 lies outside path 'p'")])
def test_places_outside_an_open_path_are_refused(options: dict[str, Any], text: str) -> None:
    assert text in refused(joined(fb.Path("p", [A, ON]), **options))


def test_too_many_rounds_are_refused() -> None:
    assert "is more than 1e+06 times around path 'triangle'" in refused(joined(TRIANGLE, at=1e9))


def test_stops_outside_are_refused() -> None:
    with pytest.raises(fb.SceneError, match=r"end=4 m lies beyond path 'p' \(0 to 3 m\)"):
        fb.Slider("s", BEAD, on=fb.Path("p", [A, ON]), at=1.0, stops=fb.Stops(end=4.0))
    with pytest.raises(fb.SceneError, match="must enclose its place at=7"):
        fb.Slider("s", BEAD, on=TRIANGLE, at=7.0, stops=fb.Stops(end=6.0))
    fb.Slider("s", BEAD, on=TRIANGLE, at=7.0, stops=fb.Stops(end=16.0))


def test_a_path_is_no_part_and_its_beams_are() -> None:
    with pytest.raises(fb.SceneError, match="is not a part of a scene; add its beams"):
        fb.Scene(A, TRIANGLE)
    path = fb.Path("p", [A, ON])
    with pytest.raises(fb.SceneError, match="beam 'on' is not in scene"):
        fb.compile_scene(fb.Scene(A, BEAD, fb.Slider("s", BEAD, on=path, at=0.5)))
    with pytest.raises(fb.SceneError, match="belongs to the beam that it slides on"):
        fb.compile_scene(fb.Scene(A, ON, fb.RigidConnection(A.end, ON.start), fb.Slider("s", ON.end, on=path, at=0.5)))


def test_a_point_beside_the_path_is_told_where_it_would_lie_on_it() -> None:
    path = fb.Path("p", [A, ON])
    bead = fb.PointMass("bead", mass=1.0, position=(2.5, 0, 0))
    text = refused(fb.Scene(A, ON, fb.RigidConnection(A.end, ON.start), bead, fb.Slider("s", bead, on=path, at=0.5)))
    assert "use at=2.5, where it lies on the beam" in text


def test_print_says_what_the_path_is() -> None:
    text = str(fb.compile_scene(joined(fb.Path("rail", [A, ON]))))
    assert "path               'rail': 2 beams, 3 m, 1 slider, one tangent across 1 of 1 joint" in text
    text = str(fb.compile_scene(joined(TRIANGLE)))
    assert "'triangle': 3 beams, 5.23607 m, closed, 1 slider" in text and "one tangent" not in text
    # a hinge is not rounded, nor are the beams' own curves
    rail = fb.Path("rail", [A, ON])
    assert "one tangent" not in str(fb.compile_scene(joined(rail, fb.BallJoint)))
    assert "one tangent" not in str(fb.compile_scene(joined(rail, curve="own")))


# --- tables --------------------------------------------------------------------------------------------------------------
PATHS = {"corner": fb.Path("corner", [A, (B, -1)]), "straight": fb.Path("straight", [A, ON]), "triangle": TRIANGLE,
         "back": fb.Path("back", [(ON, -1), (A, -1)]), "one": fb.Path("one", [(B, -1)])}


@pytest.mark.parametrize("curve", ["own", "c1"])
@pytest.mark.parametrize("name", PATHS)
def test_the_curve_of_a_path_is_that_of_its_beams(name: str, curve: str) -> None:
    path = PATHS[name]
    model = fb.compile_scene(joined(path, curve=curve))
    phi = model.q0.reshape(-1, 4, 3)[:, 0]
    rounds = path.length * np.array([-1.0, 0.0, 2.0]) if path.closed else np.zeros(1)
    for s in np.random.default_rng(1).uniform(0.0, path.length, 40):
        for more in rounds:
            nodes, (values, slopes, _) = shapes_at(model, 0, s + more)
            assert nodes.size == np.unique(nodes).size and abs(values.sum() - 1.0) < 1e-14 and abs(slopes.sum()) < 1e-12
            # straight beams: the curve is the axis
            np.testing.assert_allclose(values @ phi[nodes], path.reference(s)[0][0], rtol=0.0, atol=1e-13)
            np.testing.assert_allclose(slopes @ phi[nodes], path.reference(s)[1][0, 0], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("curve", ["own", "c1"])
def test_tangents_at_joints(curve: str) -> None:
    path = PATHS["straight"]
    model = fb.compile_scene(joined(path, curve=curve))
    bent = np.random.default_rng(2).standard_normal((model.n_nodes, 3))
    # both end nodes of a joint are at one place
    bent[A.n_nodes] = bent[A.n_nodes - 1]
    slopes = []
    for s in (2.0 - 1e-9, 2.0 + 1e-9):
        nodes, (values, slope, _) = shapes_at(model, 0, s)
        np.testing.assert_allclose(values @ bent[nodes], bent[A.n_nodes], rtol=0.0, atol=1e-6)
        slopes.append(slope @ bent[nodes])
    assert (np.max(np.abs(slopes[1] - slopes[0])) < 1e-5) == (curve == "c1")


def test_kernels_and_python_agree_on_shapes_and_divided_differences() -> None:
    path = TRIANGLE
    model = fb.compile_scene(joined(path, curve="c1"))
    from fastbeam.model.workspace import contact_of
    curves, contact, length = model.curves, contact_of(model), path.length
    phi = np.random.default_rng(3).standard_normal((model.n_nodes, 3))
    for a, b in path.joints():
        first, second = (model.numbers.number(x) for x in (a, b))
        phi[second] = phi[first]
    numbers = curves.node

    def at(s: float) -> np.ndarray:
        nodes, (values, _, _) = shapes_at(model, 0, s)
        return np.asarray(values @ phi[nodes])

    rng = np.random.default_rng(4)
    for way in (0.1, 2.0, 0.9 * length, 1.4 * length, 3.7 * length, -0.4, -2.2 * length):
        for s0 in rng.uniform(-2.0 * length, 2.0 * length, 8):
            s1 = s0 + way
            e0 = kernels.find_element(curves, 0, s0, 0)
            e1 = kernels.find_element(curves, 0, s1, e0)
            lo, hi = kernels.nodes_under(curves, 0, e0, e1)
            assert hi - lo <= model.n_nodes
            contact.basis[:] = np.nan
            kernels.step_basis(curves, 0, s0, s1, e0, e1, lo, hi, contact)
            slots = [a % curves.shape[0, 2] for a in range(lo, hi)]
            basis, place = contact.basis[:, slots], phi[numbers[slots]]
            np.testing.assert_allclose(basis[0] @ place, at(s0), rtol=0.0, atol=1e-12)
            np.testing.assert_allclose(basis[1] @ place, at(s1), rtol=0.0, atol=1e-12)
            np.testing.assert_allclose(basis[3] @ place * way, at(s1) - at(s0), rtol=0.0, atol=1e-11)
            assert abs(basis[3].sum()) < 1e-12


def test_wild_places_of_a_diverging_iteration_find_an_element() -> None:
    model = fb.compile_scene(joined(TRIANGLE))
    for s in (np.nan, np.inf, -np.inf, 1e300, -1e17):
        assert kernels.find_element(model.curves, 0, s, 3) == 3


def test_tracks_are_made_once() -> None:
    path = PATHS["straight"]
    beads = [fb.PointMass(f"bead {k}", mass=1.0) for k in range(3)]
    sliders = [fb.Slider(f"s{k}", beads[k], on=path, at=0.5 + k, curve="own" if k == 2 else "c1") for k in range(3)]
    what = fb.Scene(A, ON, *beads, *sliders, fb.RigidConnection(A.end, ON.start))
    nodes = NodeList(what)
    tracks = [contact_curve_of(what, nodes, slider) for slider in sliders]
    assert tracks[0] is tracks[1] is not tracks[2] and (tracks[0].smooth, tracks[2].smooth) == (1, 0)
    model = fb.compile_scene(what)
    assert model.sliders.curve.tolist() == [0, 0, 1]
    # a scene without paths has tables without what paths need
    assert isinstance(fb.compile_scene(fb.Scene(A, BEAD, fb.Slider("s", BEAD, A, at=1.0))).curves, kernels.Curves)
