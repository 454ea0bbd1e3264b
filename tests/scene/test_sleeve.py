"""Sleeves as nouns: curves averaged over a bore, messages, starts."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.interpolate import BSpline

import fastbeam as fb
from fastbeam.scene.interpolation.averaged_curves import averaged_curve
from fastbeam.scene.interpolation.basis import Basis, build_basis

Array = np.ndarray
SECTION = fb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=500.0, EI2=500.0, EI3=600.0, rhoA=1.0, rhoI2=0.1, rhoI3=0.2)
BASES = [build_basis("lagrange", 3, 10, 1.0), build_basis("lagrange", 2, 7, 2.0), build_basis("bspline", 3, 9, 1.5),
         build_basis("lagrange", 4, np.array([0, 0.1, 0.35, 0.5, 0.8, 1.0]), 1.0), build_basis("lagrange", 1, 3, 1.0),
         build_basis("bspline", 2, np.array([0, 0.2, 0.3, 0.7, 1.0]), 1.0), build_basis("lagrange", 1, 60, 1.0),
         build_basis("bspline", 3, 40, 1.0)]
NAMES = [f"{basis.interpolation} {basis.degree} {basis.n_elements}" for basis in BASES]


def dense(basis: Basis, width: float, s: Array) -> tuple[Array, Array]:
    """Shape functions of all nodes at s, and their slopes."""
    first, values, slopes = averaged_curve(basis, width).evaluate(s)
    out = np.zeros((2, len(s), basis.n_nodes + values.shape[1]))
    for k, (a, x, y) in enumerate(zip(first, values, slopes)):
        out[0, k, a:a + len(x)], out[1, k, a:a + len(x)] = x, y
    return out[0, :, :basis.n_nodes], out[1, :, :basis.n_nodes]


def slow_mean(basis: Basis, width: float, s: float) -> Array:
    """The same as a sum of many points, with the B-spline of another library."""
    u = (np.arange(6000) + 0.5) / 2000
    x, weight = s + width * (u / 3.0 - 0.5), BSpline.basis_element([0, 1, 2, 3])(u)
    low, high = x < 0, x > basis.length
    inside = np.where(low, -x, np.where(high, 2 * basis.length - x, x))
    table = basis.position_matrix(inside)[0] * np.where(low | high, -1.0, 1.0)[:, None]
    table[low] += 2.0 * basis.position_matrix([0.0])[0]
    table[high] += 2.0 * basis.position_matrix([basis.length])[0]
    return weight @ table / weight.sum()


@pytest.mark.parametrize("share", [0.07, 0.2, 0.61])
@pytest.mark.parametrize("basis", BASES, ids=NAMES)
def test_averaged_curve_is_the_mean_over_the_bore(basis: Basis, share: float) -> None:
    width = share * basis.length
    for s in np.array([0.0, 0.03, 0.31, 0.5, 0.77, 0.99, 1.0]) * basis.length:
        np.testing.assert_allclose(dense(basis, width, np.array([s]))[0][0], slow_mean(basis, width, s), atol=1e-6)


@pytest.mark.parametrize("basis", BASES, ids=NAMES)
def test_straight_lines_and_ends_stay_and_slopes_are_continuous(basis: Basis) -> None:
    width = 0.23 * basis.length
    s = np.linspace(0.0, basis.length, 301)
    values, slopes = dense(basis, width, s)
    straight = basis.fit_positions(basis.node_s[:, None])[:, 0]
    np.testing.assert_allclose(values @ straight, s, atol=1e-14 * basis.length)
    np.testing.assert_allclose(values.sum(axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(slopes @ straight, 1.0, atol=1e-11)
    np.testing.assert_allclose(values[[0, -1]], basis.position_matrix(s[[0, -1]])[0], atol=1e-13)
    cuts = averaged_curve(basis, width).element_ends[1:-1]
    before, after = (dense(basis, width, cuts + x)[1] for x in (-1e-9, 1e-9))
    assert np.abs(before - after).max() < 1e-5 / width


def test_a_curve_is_made_once() -> None:
    basis = build_basis("lagrange", 3, 10, 1.0)
    assert averaged_curve(basis, 0.1) is averaged_curve(basis, 0.1)
    with pytest.raises(fb.SceneError, match="positive and at most the length"):
        averaged_curve(basis, 1.1)


def parts(**sleeve: Any) -> tuple[fb.Beam, fb.RigidBody, fb.Sleeve]:
    rod = fb.Beam.straight("rod", (0, 0, 0), (3, 0, 0), section=SECTION, elements=6)
    body = fb.RigidBody("holder", mass=1.0, inertia=(1, 1, 1), position=(1, 0, 0))
    return rod, body, fb.Sleeve("guide", body, rod, at=1.0, **sleeve)


def test_the_bore_is_as_long_as_an_element_by_default_and_the_model_says_so() -> None:
    rod, body, sleeve = parts()
    assert sleeve.length == 0.5 and sleeve.keyed
    text = str(fb.compile_scene(fb.Scene(rod, body, sleeve)))
    assert "1 slider (1 sleeve, bore 0.5 m)" in text and "C1 curve" not in text
    other = fb.PointMass("bead", mass=1.0)
    text = str(fb.compile_scene(fb.Scene(rod, body, other, fb.Slider("run", other, rod, at=2.0), parts(length=0.0)[2].__class__(
        "guide", body, rod, at=1.0, length=0.0))))
    assert "2 sliders (1 sleeve), discrete gradient, 2 on a C1 curve" in text


@pytest.mark.parametrize(("change", "message"), [
    (dict(length=3.5), r"the bore, length=3.5 m, is longer than beam 'rod', 3 m"),
    (dict(length=-1.0), r"length must be a finite number >= 0 m"),
    (dict(friction=0.1), r"friction=0.1 needs the length of the bore"),
    (dict(axis=(0, 0, 0)), r"axis=\(0, 0, 0\) has no direction"),
    (dict(keyed="no"), "keyed must be True or False"),
    (dict(angle=1.0), "angle"),
])
def test_a_sleeve_says_what_is_wrong(change: dict[str, Any], message: str) -> None:
    with pytest.raises(fb.SceneError, match=message):
        parts(**change)


def test_a_point_mass_cannot_hold_a_section() -> None:
    rod = parts()[0]
    with pytest.raises(fb.SceneError, match="point mass 'bead' has no rotation"):
        fb.Sleeve("guide", fb.PointMass("bead", mass=1.0), rod, at=1.0)


def test_an_axis_that_is_not_that_of_the_beam_is_refused_with_the_angle() -> None:
    rod, body, sleeve = parts(axis=(1.0, 0.1, 0.0))
    with pytest.raises(fb.SceneError, match=r"angle of 5.71\d* degrees.*Turn body 'holder' or the beam, or leave axis out"):
        fb.compile_scene(fb.Scene(rod, body, sleeve))
    for axis in ((1.0, 0.0, 0.0), (-2.0, 0.0, 0.0)):
        rod, body, sleeve = parts(axis=axis)
        fb.compile_scene(fb.Scene(rod, body, sleeve))


def test_velocities_that_a_sleeve_does_not_allow_are_refused_or_projected() -> None:
    rod, body, sleeve = parts()
    turning = fb.RigidMotion(body, spin=(0, 0, 1.0), about=(1, 0, 0))
    with pytest.raises(fb.SceneError, match=r"sleeve 'guide' \(rotation\)"):
        fb.compile_scene(fb.Scene(rod, body, sleeve, turning))
    model = fb.compile_scene(fb.Scene(rod, body, sleeve, turning, project_velocities=True))
    result = fb.simulate(model, t_end=0.05, step=0.01, progress=False)
    assert [event["kind"] for event in result.events if event["kind"] != "contact"] == ["projected"]
    # free of them where the rod may twist
    rod, body, sleeve = parts(keyed=False)
    fb.compile_scene(fb.Scene(rod, body, sleeve, fb.RigidMotion(body, spin=(1.0, 0, 0), about=(1, 0, 0))))


def test_a_start_with_another_direction_is_refused_or_mended() -> None:
    rod, body, sleeve = parts()
    model = fb.compile_scene(fb.Scene(rod, body, sleeve), planar=False)
    state = model.state()
    c, s = np.cos(2e-3), np.sin(2e-3)
    holder = model.numbers.start(body)
    state.q.reshape(-1, 4, 3)[holder, 1:] = [[c, s, 0], [-s, c, 0], [0, 0, 1]]
    with pytest.raises(fb.SceneError, match=r"sleeve 'guide': its direction is 0.002 rad off.*mend=True"):
        fb.simulate(model, t_end=0.05, step=0.01, start=state, progress=False)
    result = fb.simulate(model, t_end=0.05, step=0.01, start=fb.Start(state, mend=True), progress=False)
    # bodies turn, the rod is not bent: next to the energy of a bend by that angle
    assert result.events[0]["kind"] == "mended" and np.ptp(result.series["total"]) < 1e-12 * 250.0 * 2e-3**2


def test_compared_methods_refuse_sleeves() -> None:
    rod, body, sleeve = parts()
    model = fb.compile_scene(fb.Scene(rod, body, sleeve))
    for method in ("midpoint", "generalized_alpha", "trapezoidal"):
        with pytest.raises(fb.SceneError, match="does not support sleeves"):
            fb.simulate(model, t_end=0.1, step=0.01, method=method)


def test_an_inconsistent_step_names_the_sleeve() -> None:
    rod, body, sleeve = parts()
    model = fb.compile_scene(fb.Scene(rod, body, sleeve))
    assert model.constraint_names == ["slider 'guide'", "sleeve 'guide' (moments)"]
    assert model.forces.tolist() == [3, 3] and model.unknowns.tolist() == [7, 7]
    assert model.plane.model.forces.tolist() == [2, 1] and model.plane.model.unknowns.tolist() == [5, 5]


def curved(**sleeve: Any) -> tuple[fb.Beam, fb.RigidBody, fb.Sleeve]:
    ring = fb.Beam.arc("ring", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=1.0, angle=3.0, section=SECTION, elements=12)
    place, triad = ring.reference(1.3)
    turn = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    body = fb.RigidBody("carriage", mass=1.0, inertia=(1, 1, 1), position=place[0], directors=turn @ triad[0])
    return ring, body, fb.Sleeve("on", body, ring, at=1.3, **sleeve)


def test_on_a_curved_beam_the_bore_lies_around_its_mean() -> None:
    ring, body, sleeve = curved()
    # a quadratic B-spline of width l has the variance l^2/36
    assert np.linalg.norm(sleeve.place - body.position) == pytest.approx(0.25**2 / 72.0, rel=0.01)
    assert np.linalg.norm(sleeve.point.offset) == pytest.approx(np.linalg.norm(sleeve.place - body.position))
    model = fb.compile_scene(fb.Scene(ring, body, sleeve))
    result = fb.simulate(model, t_end=0.1, step=0.01, progress=False)
    assert all(event["kind"] == "contact" for event in result.events) and np.abs(result.state.q - model.q0).max() < 1e-11
    # made again from its own fields it is the same
    from dataclasses import replace
    again = replace(sleeve, keyed=False)
    assert np.array_equal(again.point.offset, sleeve.point.offset) and again.point.owner is body
    _, _, at_a_point = curved(length=0.0)
    assert np.linalg.norm(at_a_point.point.offset) < 1e-5


def test_a_beam_cannot_hold_a_bore_on_a_curved_beam() -> None:
    ring = curved()[0]
    place = ring.reference(1.3)[0][0]
    arm = fb.Beam.straight("arm", place + (0, 0, 1), place, section=SECTION, elements=2)
    with pytest.raises(fb.SceneError, match=r"is curved at=1.3: its mean .* lies 0.000867 m off it.*length=0, or let a"):
        fb.Sleeve("on", arm.end, ring, at=1.3)
    with pytest.raises(fb.SceneError, match="lies 0.300001 m away from"):
        ring, body, sleeve = curved()
        far = fb.RigidBody("far", mass=1.0, inertia=(1, 1, 1), position=place + (0, 0, 0.3))
        fb.compile_scene(fb.Scene(ring, far, fb.Sleeve("on", far, ring, at=1.3)))


def test_a_sleeve_runs_on_one_beam() -> None:
    rod, body, _ = parts()
    with pytest.raises(fb.SceneError, match="must be a Beam, got"):
        fb.Sleeve("guide", body, on=fb.Path("way", [rod]), at=1.0)


@pytest.mark.parametrize("radius", [0.5, 400.0, 4000.0, 4e4, 4e7])
def test_a_body_on_a_beam_however_little_curved_holds_a_sleeve(radius: float) -> None:
    """The mean over the bore lies off the beam: by as much as is put right, by as little as counts as on it, and between."""
    section = fb.Section.circle(radius=0.01, E=1e9, rho=1000.0)
    beam = fb.Beam.arc("rod", (2.0, -3.0, 0.5), (1, 0, 0), (0, 1, 0), radius=radius, angle=0.24 / radius, section=section,
                       elements=2)
    body = fb.RigidBody("holder", mass=1.0, inertia=(0.1, 0.1, 0.1), position=beam.reference(0.1)[0][0])
    model = fb.compile_scene(fb.Scene(beam, body, fb.Clamp(beam.start), fb.Sleeve("sleeve", body, beam, at=0.1, length=0.012)))
    assert fb.simulate(model, t_end=1e-3, step=1e-3, every=1, progress=False).slider("sleeve")["gap"][0] < 1e-15 * 4.0


@pytest.mark.parametrize("length", [5e-324, 1e-200, 1e-8])
def test_a_bore_that_is_round_off_is_refused(length: float) -> None:
    beam = fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=SECTION, elements=4)
    body = fb.RigidBody("body", mass=1.0, inertia=(1, 1, 1), position=(1, 0, 0))
    with pytest.raises(fb.SceneError, match="give length=0 for a sleeve that acts at one point, or a longer bore"):
        fb.Sleeve("ring", body, beam, at=1.0, length=length)


def test_the_shortest_bore_has_the_curve_of_the_beam() -> None:
    basis = fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=SECTION, elements=4).basis
    thin, own = averaged_curve(basis, 2e-7 * 1.1), basis.curve("own")
    s = np.linspace(0.01, 1.99, 50)
    nodes = np.sin(np.arange(basis.n_nodes))
    values = []
    for curve in (thin, own):
        first, weights, _ = curve.evaluate(s)
        values.append([w[:basis.n_nodes - a] @ nodes[a:a + len(w)] for a, w in zip(first, weights)])
    np.testing.assert_allclose(*values, rtol=0.0, atol=1e-7)
