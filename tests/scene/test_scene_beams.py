"""Beams: reference curves and triads, nodes, and the messages."""
from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

from fastbeam.interface.errors import SceneError
from fastbeam.scene import Beam, NodeRef, Section

BAR = Section.circle(radius=0.01, E=70e9, rho=2700.0)
COMMON = dict(section=BAR, elements=4)
# central difference of order six
OFFSETS, WEIGHTS = np.array([-3, -2, -1, 1, 2, 3]), np.array([-1, 9, -45, 45, -9, 1]) / 60


def straight(**options):
    return Beam.straight("boom", (0, 0, 0), (2, 0, 0), **{**COMMON, **options})


def helix_point(t):
    u = 2 * np.pi * 3 * t
    return 0.5 * np.cos(u), 0.5 * np.sin(u), 0.3 * 3 * t


def helix_normal(t):
    u = 2 * np.pi * 3 * t
    return -np.cos(u), -np.sin(u), 0.0


CURVED = {
    "straight": straight(twist=1.3),
    "oblique": Beam.straight("x", (1, 2, 3), (-1, 0.4, 5), d2=(0.3, 0.2, 0.1), twist=-7.0, **COMMON),
    "arc": Beam.arc("x", (1, 2, 3), (1, 1, 0), (1, -1, 2), radius=0.7, angle=4.0, **COMMON),
    "helix": Beam.helix("x", radius=0.5, pitch=-0.3, turns=3, center=(1, 2, 3), axis=(1, 1, 1), **COMMON),
    "from_curve": Beam.from_curve("x", helix_point, **COMMON),
    "framed": Beam.from_curve("x", helix_point, frame=helix_normal, **COMMON),
    "points": Beam.through_points("x", [(0, 0, 0), (1, 0.5, 0.2), (1.5, 1.5, 0.1), (1.2, 2.0, 1.0)], **COMMON),
}


@pytest.mark.parametrize("name", CURVED)
def test_triads_are_orthonormal_and_right_handed(name):
    beam = CURVED[name]
    _, d = beam.reference(np.linspace(0.0, beam.length, 501))
    # 3 roundings of a product of directors, and in each of them some 4 of its rotation
    assert np.max(np.abs(np.einsum("nik,njk->nij", d, d) - np.eye(3))) < 3e-15
    assert np.max(np.abs(np.cross(d[:, 0], d[:, 1]) - d[:, 2])) < 3e-15


@pytest.mark.parametrize("name", CURVED)
def test_first_director_is_the_derivative_of_the_position(name):
    beam = CURVED[name]
    s, step = np.linspace(0.1, 0.9, 41) * beam.length, 1e-3 * beam.length
    difference = sum(w * beam.reference(s + o * step)[0] for o, w in zip(OFFSETS, WEIGHTS)) / step
    # round-off eps/step dominates; the spline has kinks in its third derivative
    assert np.max(np.abs(difference - beam.reference(s)[1][:, 0])) < (1e-5 if name == "points" else 1e-10)


def test_straight_positions_and_default_triad():
    phi, d = straight().reference([0.0, 0.5, 2.0])
    assert np.array_equal(phi, [[0, 0, 0], [0.5, 0, 0], [2, 0, 0]])
    assert np.array_equal(d[1], np.eye(3))


@pytest.mark.parametrize(("end", "d2", "d3"), [
    ((0, 1, 0), (-1, 0, 0), (0, 0, 1)), ((0, 0, 1), (0, 1, 0), (-1, 0, 0)), ((0, 0, -2), (0, 1, 0), (1, 0, 0)),
    ((1e-8, 0, 1), (0, 1, 0), (-1, 0, 1e-8)), ((3, 0, 4), (0, 1, 0), (-0.8, 0, 0.6)),
])
def test_default_triad_keeps_d3_close_to_e_z(end, d2, d3):
    _, d = Beam.straight("x", (0, 0, 0), end, **COMMON).reference([0.0])
    assert np.allclose(d[0, 1:], [d2, d3], atol=1e-15)


def test_hint_is_made_orthogonal():
    _, d = straight(d2=(5, 0, 2)).reference([1.0])
    assert np.allclose(d[0], [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-15)


def test_twist_turns_d2_towards_d3():
    _, d = straight(twist=np.pi).reference([0.0, 1.0, 2.0])
    assert np.allclose(d[:, 1], [[0, 1, 0], [0, 0, 1], [0, -1, 0]], atol=1e-15)


def test_arc_meets_its_closed_form():
    beam = Beam.arc("x", (2, 0, 0), (0, 1, 0), (-1, 0, 0), radius=2.0, angle=np.pi, **COMMON)
    a = np.linspace(0, np.pi, 9)
    phi, d = beam.reference(2.0 * a)
    zero = 0 * a
    assert beam.length == 2.0 * np.pi
    assert np.allclose(phi, 2 * np.stack([np.cos(a), np.sin(a), zero], axis=1), atol=1e-15)
    assert np.allclose(d[:, 0], np.stack([-np.sin(a), np.cos(a), zero], axis=1), atol=1e-15)
    assert np.allclose(d[:, 1], -0.5 * phi, atol=1e-15) and np.allclose(d[:, 2], [0, 0, 1], atol=1e-15)


def test_helix_has_constant_curvature_and_torsion():
    beam, R, c = Beam.helix("x", radius=0.5, pitch=0.3, turns=3, **COMMON), 0.5, 0.3 / (2 * np.pi)
    assert beam.length == pytest.approx(3 * np.hypot(2 * np.pi * R, 0.3), rel=1e-15)
    s, step = np.linspace(0.1, 0.9, 31) * beam.length, 1e-3
    prime = sum(w * beam.reference(s + o * step)[1] for o, w in zip(OFFSETS, WEIGHTS)) / step
    d = beam.reference(s)[1]
    # d1' = curvature d2, d2' . d3 = torsion
    assert np.allclose(prime[:, 0], R / (R**2 + c**2) * d[:, 1], atol=1e-11)
    assert np.allclose(np.sum(prime[:, 1] * d[:, 2], axis=1), c / (R**2 + c**2), atol=1e-11)
    assert np.allclose(beam.reference([0.0])[0], [[0.5, 0, 0]], atol=1e-16)
    assert np.allclose(beam.reference([beam.length])[0], [[0.5, 0, 0.9]], atol=1e-14)


def test_circle_given_as_a_function_is_the_arc():
    # uneven parameter: the arc length has to be found
    def point(t):
        u = 3.5 * t**2 + 0.5 * t
        return 1 + 0.7 * np.cos(u), 0.7 * np.sin(u), 2.0

    beam = Beam.from_curve("x", point, d2=(-1, 0, 0), **COMMON)
    exact = Beam.arc("y", (1.7, 0, 2), (0, 1, 0), (-1, 0, 0), radius=0.7, angle=4.0, **COMMON)
    s = np.linspace(0.0, exact.length, 301)
    assert beam.length == pytest.approx(exact.length, rel=1e-13)
    for got, expected in zip(beam.reference(s), exact.reference(s)):
        assert np.max(np.abs(got - expected)) < 1e-11


def test_helix_given_as_a_function_is_the_helix():
    exact = Beam.helix("y", radius=0.5, pitch=0.3, turns=3, **COMMON)
    s = np.linspace(0.0, exact.length, 301)
    for frame in (helix_normal, lambda t: exact.reference([t * exact.length])[1][0]):
        beam = Beam.from_curve("x", helix_point, frame=frame, **COMMON)
        assert beam.length == pytest.approx(exact.length, rel=1e-13)
        for got, expected in zip(beam.reference(np.minimum(s, beam.length)), exact.reference(s)):
            assert np.max(np.abs(got - expected)) < 1e-11


def test_frame_without_hint_does_not_turn_about_the_tangent():
    # on a helix it lags behind the Frenet frame by torsion times arc length
    beam = Beam.from_curve("x", helix_point, d2=(-1, 0, 0), **COMMON)
    frenet = Beam.helix("y", radius=0.5, pitch=0.3, turns=3, **COMMON)
    s = np.linspace(0.0, beam.length, 301)
    rise = 0.3 / (2 * np.pi)
    angle = rise / (0.25 + rise**2) * s[:, None]
    _, normal, binormal = np.moveaxis(frenet.reference(s)[1], 1, 0)
    assert np.max(np.abs(beam.reference(s)[1][:, 1] - (np.cos(angle) * normal - np.sin(angle) * binormal))) < 1e-11


def test_spline_passes_its_points_and_measures_its_length():
    from scipy.interpolate import CubicSpline

    points = np.array([(0, 0, 0), (1, 0.5, 0.2), (1.5, 1.5, 0.1), (1.2, 2.0, 1.0), (0.0, 2.5, 1.2)])
    beam = Beam.through_points("x", points, **COMMON)
    t = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    spline, (x, w) = CubicSpline(t, points), leggauss(40)
    ends = np.unique(np.concatenate([np.linspace(a, b, 21) for a, b in zip(t[:-1], t[1:])]))
    lengths = [0.5 * (b - a) * w @ np.linalg.norm(spline(0.5 * (a + b) + 0.5 * (b - a) * x, 1), axis=1)
               for a, b in zip(ends[:-1], ends[1:])]
    s = np.concatenate([[0], np.cumsum(lengths)])
    assert beam.length == pytest.approx(s[-1], rel=1e-12)
    assert np.max(np.abs(beam.reference(s[::20])[0] - points)) < 1e-12


def test_two_points_make_a_straight_beam():
    beam = Beam.through_points("x", [(1, 0, 0), (1, 3, 0)], **COMMON)
    phi, d = beam.reference([0.0, 1.0, 3.0])
    assert np.allclose(phi, [[1, 0, 0], [1, 1, 0], [1, 3, 0]], atol=1e-14)
    assert np.allclose(d, [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-14)


def test_kink_is_confined():
    beam = Beam.from_curve("x", lambda t: (t, abs(t - 0.3), 0), **COMMON)
    assert beam.length == pytest.approx(np.sqrt(2), rel=1e-11)
    _, d = beam.reference([0.3 * np.sqrt(2) - 1e-6, 0.3 * np.sqrt(2) + 1e-6])
    root = np.sqrt(0.5)
    assert np.allclose(d[:, 0], [[root, -root, 0], [root, root, 0]], atol=1e-10)
    assert np.allclose(d[:, 1], [[root, root, 0], [-root, root, 0]], atol=1e-10)


# --- nodes -----------------------------------------------------------------------------------------------------------------
def test_nodes_by_end_number_and_arc_length():
    beam = straight(degree=2)
    assert (beam.n_nodes, beam.n_elements) == (9, 4)
    assert beam.start == beam.node(0) == beam.at(0.0) == beam.node(-9)
    assert beam.end == beam.node(-1) == beam.at(2.0) and beam.end.index == 8
    assert beam.at(0.75 + 1e-10).index == 3
    assert beam.basis is beam.basis
    assert np.allclose(beam.node_s, np.linspace(0, 2, 9))
    assert beam.end != straight(degree=2).end and len({beam.start, beam.at(0.0), beam.end}) == 2


def test_node_texts():
    beam = straight(degree=1)
    assert str(beam.node(1)) == "beam 'boom' node 1 (s = 0.5 m)"
    assert beam.node(1).label == "beam 'boom' node 1"
    assert repr(beam) == "<beam 'boom': 2 m, 4 elements, lagrange 1, simo_reissner>"
    assert isinstance(beam.start, NodeRef) and np.array_equal(beam.start.offset, [0, 0, 0])


@pytest.mark.parametrize("index", [9, -10, 1.0, "3", True])
def test_missing_node_is_an_error(index):
    with pytest.raises(SceneError, match=r"beam 'boom': node .* does not exist, nodes run from 0 to 8"):
        straight(degree=2).node(index)


@pytest.mark.parametrize("index", [9, -1, 10**6, 1.0, None])
def test_a_node_that_the_beam_does_not_have_is_refused_also_without_the_beam(index: object) -> None:
    boom = Beam.straight("boom", (0, 0, 0), (1, 0, 0), section=Section.circle(radius=0.01, E=1e9, rho=1e3), elements=4, degree=2)
    assert NodeRef(boom, 8) == boom.end
    with pytest.raises(SceneError, match=r"NodeRef: beam 'boom' has no node .*, nodes run from 0 to 8"):
        NodeRef(boom, index)
    with pytest.raises(SceneError, match="NodeRef: beam 'boom' takes no offset, got .*; join a RigidBody there"):
        NodeRef(boom, 0, (0, 0, 1))


def test_arc_length_between_nodes_lists_the_neighbours():
    with pytest.raises(SceneError, match=r"beam 'boom': no node at s=0\.6, the nearest nodes lie at s = 0\.5 and 0\.75 m"):
        straight(degree=2).at(0.6)
    with pytest.raises(SceneError, match="s must be a finite number, got nan"):
        straight().at(np.nan)


def test_spline_beam_has_its_own_nodes():
    beam = straight(interpolation="bspline", degree=2)
    assert beam.n_nodes == 6 and beam.end.index == 5
    assert np.allclose(beam.node_s, [0, 0.25, 0.75, 1.25, 1.75, 2])


def test_elements_may_be_uneven():
    beam = straight(elements=[0, 0.5, 2.0 - 1e-12], degree=1)
    assert np.array_equal(beam.node_s, [0, 0.5, 2.0]) and beam.n_elements == 2


# --- messages --------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("options", "text"), [
    (dict(elements=0), r"elements must be a whole number >= 1 .*, got 0"),
    (dict(elements=2.5), r"elements must be a whole number >= 1 .*, got 2\.5"),
    (dict(elements=True), r"elements must be a whole number"),
    (dict(elements="four"), r"elements must be a whole number"),
    (dict(elements=[0, 1]), r"elements must run from 0 to the length 2 m, got \(0, 1\)"),
    (dict(elements=[0, 1, 1, 2]), r"elements must increase strictly, entry 2 \(1\) does not exceed entry 1 \(1\)"),
    (dict(elements=[0, np.nan, 2]), r"elements must be finite arc lengths"),
    (dict(degree=9), r"degree=9 lies outside 1 to 8 of interpolation 'lagrange'"),
    (dict(degree=2.0), r"degree=2\.0 lies outside 1 to 8"),
    (dict(degree=1, interpolation="bspline"), r"degree=1 lies outside 2 to 5 of interpolation 'bspline'"),
    (dict(interpolation="nurbs"), r"interpolation 'nurbs' does not exist: choose 'lagrange' \(degree 1 to 8\) or 'bspline'"),
    (dict(interpolation="bspline", directors="nodes"), r"directors 'nodes' does not exist: choose 'greville' or 'control'"),
    (dict(directors="control"), r"directors='control' exists only for interpolation 'bspline'"),
    (dict(strain="linear"), r"strain 'linear' does not exist: choose 'simo_reissner' or 'green_lagrange'"),
    (dict(section=1.0), r"section must be a Section, got 1\.0"),
    (dict(d2=(1, 0, 0)), r"d2=\(1, 0, 0\) is parallel to the beam axis \(1, 0, 0\)"),
    (dict(d2=(0, 0, 0)), r"d2 must not be zero"),
    (dict(d2=(0, 1)), r"d2 must be 3 finite numbers, got \(0, 1\)"),
    (dict(twist=np.inf), r"twist must be a finite number, got inf"),
])
def test_beam_arguments_are_checked(options, text):
    with pytest.raises(SceneError, match="beam 'boom': " + text):
        straight(**options)


def test_straight_beam_needs_a_length_and_a_name():
    with pytest.raises(SceneError, match=r"beam 'x': start and end coincide at \(1, 2, 3\)"):
        Beam.straight("x", (1, 2, 3), (1, 2, 3), **COMMON)
    with pytest.raises(SceneError, match="beam 'x': end must be 3 finite numbers, got an array of shape"):
        Beam.straight("x", (1, 2, 3), np.zeros((5, 3)), **COMMON)
    with pytest.raises(SceneError, match=r"beam 'x': start must be 3 finite numbers, got \(0, nan, 0\)"):
        Beam.straight("x", (0, np.nan, 0), (1, 2, 3), **COMMON)
    with pytest.raises(SceneError, match="Beam.straight: name must be a non-empty text, got ''"):
        Beam.straight("", (0, 0, 0), (1, 2, 3), **COMMON)


def test_curve_argument_is_checked():
    with pytest.raises(SceneError, match=r"curve must have length and reference\(s\).*use Beam\.from_curve"):
        Beam("x", lambda t: (t, 0, 0), **COMMON)
    with pytest.raises(SceneError, match=r"got 3; use Beam\.straight"):
        Beam("x", 3, **COMMON)


def test_arc_and_helix_arguments_are_checked():
    with pytest.raises(SceneError, match="must be orthogonal to tangent.* the angle between them is 45 degrees"):
        Beam.arc("x", (0, 0, 0), (1, 0, 0), (1, 1, 0), radius=1, angle=1, **COMMON)
    with pytest.raises(SceneError, match="radius must be a finite number > 0 m, got 0"):
        Beam.arc("x", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=0, angle=1, **COMMON)
    with pytest.raises(SceneError, match="angle must be a finite number > 0 rad, got -1"):
        Beam.arc("x", (0, 0, 0), (1, 0, 0), (0, 1, 0), radius=1, angle=-1, **COMMON)
    with pytest.raises(SceneError, match="turns must be a finite number > 0, got 0"):
        Beam.helix("x", radius=1, pitch=1, turns=0, **COMMON)
    with pytest.raises(SceneError, match=r"start_direction=\(0, 0, 3\) is parallel to axis=\(0, 0, 1\)"):
        Beam.helix("x", radius=1, pitch=1, turns=1, start_direction=(0, 0, 3), **COMMON)


@pytest.mark.parametrize(("curve", "options", "text"), [
    ((0, 0, 1), {}, "curve must be a function of t"),
    (lambda t: (t, 0), {}, r"curve\(0\) must be 3 finite numbers, got \(0, 0\)"),
    (lambda t: (t, 0, np.inf), {}, r"curve\(0\) must be 3 finite numbers"),
    (lambda t: (1, 2, 3), {}, "the curve has no length"),
    (lambda t: (t * t, 0, 0), {}, "the curve has zero speed at t=0; use a parameter"),
    (lambda t: (abs(t - 0.5), 0, 0), {}, r"the curve reverses its direction near t=0\.5"),
    (helix_point, dict(frame=3), "frame must be a function"),
    (helix_point, dict(frame=helix_normal, d2=(1, 0, 0)), "give frame or d2, not both"),
])
def test_curve_functions_are_checked(curve, options, text):
    with pytest.raises(SceneError, match="beam 'x': " + text):
        Beam.from_curve("x", curve, **options, **COMMON)


@pytest.mark.parametrize(("frame", "text"), [
    (lambda t: (1, 0), r"frame\(0\) must be 3 finite numbers"),
    (lambda t: (2, 0, 0), r"frame\(0\) is parallel to the beam axis \(1, 0, 0\)"),
    (lambda t: np.roll(np.eye(3), 1, axis=0), r"frame\(0\) has d1=\(0, 0, 1\), .* away from the unit tangent \(1, 0, 0\)"),
    (lambda t: 2 * np.eye(3), r"frame\(0\) must be three orthonormal rows"),
])
def test_frame_functions_are_checked(frame, text):
    beam = Beam.from_curve("x", lambda t: (t, 0, 0), frame=frame, **COMMON)
    with pytest.raises(SceneError, match="beam 'x': " + text):
        beam.reference([0.0])


def test_spline_points_are_checked():
    with pytest.raises(SceneError, match=r"points must have shape \[m, 3\] with m >= 2, got shape \[1, 3\]"):
        Beam.through_points("x", [(0, 0, 0)], **COMMON)
    with pytest.raises(SceneError, match=r"points must be finite numbers of shape \[m, 3\]"):
        Beam.through_points("x", [(0, 0), (1, 1)], **COMMON)
    with pytest.raises(SceneError, match="points 1 and 2 coincide; remove one"):
        Beam.through_points("x", [(0, 0, 0), (1, 0, 0), (1, 0, 0)], **COMMON)


def test_arc_lengths_outside_the_beam_are_refused():
    with pytest.raises(SceneError, match=r"beam 'boom': s=2\.1 lies outside it \(0 to 2 m\)"):
        straight().reference([0.0, 2.1])
    with pytest.raises(SceneError, match=r"s must be arc lengths, finite numbers of shape \[n\]"):
        straight().reference(np.zeros((2, 2)))
    assert np.array_equal(straight().reference(2.0 + 1e-10)[0], [[2, 0, 0]])
