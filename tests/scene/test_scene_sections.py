"""Sections: stiffness and inertia against closed forms, and the messages."""
from __future__ import annotations

import math

import numpy as np
import pytest

from fastbeam.interface.errors import SceneError
from fastbeam.scene import Section

VALUES = dict(EA=1.0, GA2=2.0, GA3=3.0, GJ=4.0, EI2=5.0, EI3=6.0, rhoA=7.0, rhoI2=8.0, rhoI3=9.0)


def test_matrix_is_the_diagonal_in_strain_order():
    section = Section(**VALUES)
    assert np.array_equal(section.C, np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]))
    assert section.inertia == (7.0, 8.0, 9.0)
    assert section.is_diagonal


@pytest.mark.parametrize("key", ["EA", "GA2", "GA3", "GJ", "EI2", "EI3", "rhoA"])
@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf, "x", None, True])
def test_stiffness_and_mass_must_be_positive(key, bad):
    with pytest.raises(SceneError, match=f"section 'web': {key} must be a finite number > 0"):
        Section(**{**VALUES, key: bad}, name="web")


def test_rotary_inertia_may_be_zero_but_not_negative():
    assert Section(**{**VALUES, "rhoI2": 0.0}).rhoI2 == 0.0
    with pytest.raises(SceneError, match="rhoI3 must be a finite number >= 0 kg m, got -1"):
        Section(**{**VALUES, "rhoI3": -1.0})


def test_fields_cannot_be_changed():
    with pytest.raises(AttributeError):
        Section(**VALUES).EA = 2.0


def test_rectangle_closed_forms():
    h, w, E, rho, nu = 0.3, 0.2, 7.0, 11.0, 0.25
    section = Section.rectangle(height=h, width=w, E=E, rho=rho, nu=nu)
    G = E / 2.5
    expected = [E * h * w, 5 / 6 * G * h * w, 5 / 6 * G * h * w, E * h * w**3 / 12, E * w * h**3 / 12]
    got = [section.EA, section.GA2, section.GA3, section.EI2, section.EI3]
    assert got == pytest.approx(expected, rel=1e-14)
    assert section.inertia == pytest.approx((rho * h * w, rho * w * h**3 / 12, rho * h * w**3 / 12), rel=1e-14)


@pytest.mark.parametrize(("ratio", "beta"), [(1.0, 0.1406), (1.2, 0.166), (1.5, 0.196), (2.0, 0.229), (2.5, 0.249), (3.0, 0.263),
                                             (4.0, 0.281), (5.0, 0.291), (10.0, 0.312)])
def test_rectangle_torsion_meets_the_published_table(ratio, beta):
    # J = beta a b^3, b the shorter side: Timoshenko and Goodier, Theory of Elasticity, art. 109, given to three digits
    a, b = 0.1 * ratio, 0.1
    for height, width in ((a, b), (b, a)):
        section = Section.rectangle(height=height, width=width, E=1.0, rho=1.0, G=2.0)
        assert section.GJ / (2.0 * a * b**3) == pytest.approx(beta, abs=5.01e-4)


def test_square_torsion_is_known_to_six_digits():
    assert Section.rectangle(height=3.0, width=3.0, E=1.0, rho=1.0, G=1.0).GJ == pytest.approx(0.140577 * 81.0, rel=4e-6)


def test_square_torsion_against_the_plain_series():
    n = np.arange(1, 20001, 2, dtype=float)
    plain = 1 / 3 - 64 / np.pi**5 * np.sum(np.tanh(0.5 * np.pi * n) / n**5)
    section = Section.rectangle(height=2.0, width=2.0, E=1.0, rho=1.0, G=1.0)
    assert section.GJ == pytest.approx(16.0 * plain, rel=1e-14)


def test_torsion_of_a_thin_strip_does_not_overflow():
    section = Section.rectangle(height=1.0, width=1e-4, E=1.0, rho=1.0, G=1.0)
    assert section.GJ == pytest.approx(1e-12 / 3 * (1 - 0.63024923e-4), rel=1e-9)


def test_given_torsion_and_shear_factor_are_taken():
    section = Section.rectangle(height=1.0, width=2.0, E=1.0, rho=1.0, G=3.0, GJ=0.5, shear_factor=1.0)
    assert (section.GJ, section.GA2, section.GA3) == (0.5, 6.0, 6.0)


def test_circle_closed_forms():
    r, E, rho = 0.2, 3.0, 5.0
    section = Section.circle(radius=r, E=E, rho=rho)
    G, area, second = E / 2.6, math.pi * r**2, math.pi * r**4 / 4
    assert section.GA2 == pytest.approx(6 * 1.3 / (7 + 1.8) * G * area, rel=1e-14)
    assert (section.EA, section.GJ, section.EI2, section.EI3) == pytest.approx((E * area, 2 * G * second, E * second, E * second))
    assert section.inertia == pytest.approx((rho * area, rho * second, rho * second))


def test_tube_is_the_difference_of_two_circles():
    outer = Section.circle(radius=0.2, E=3.0, rho=5.0)
    inner = Section.circle(radius=0.15, E=3.0, rho=5.0)
    tube = Section.tube(radius=0.2, thickness=0.05, E=3.0, rho=5.0)
    for key in ("EA", "GJ", "EI2", "EI3", "rhoA", "rhoI2", "rhoI3"):
        assert getattr(tube, key) == pytest.approx(getattr(outer, key) - getattr(inner, key), rel=1e-13)


def test_tube_shear_factor_runs_from_full_circle_to_thin_wall():
    full = Section.tube(radius=1.0, thickness=1.0, E=1.0, rho=1.0)
    assert full.GA2 == pytest.approx(Section.circle(radius=1.0, E=1.0, rho=1.0).GA2, rel=1e-14)
    thin = Section.tube(radius=1.0, thickness=1e-6, E=2.6, rho=1.0)
    # Cowper's thin round tube: 2 (1 + nu) / (4 + 3 nu); the wall of 1e-6 changes it by its square
    assert thin.GA2 / thin.EA * 2.6 == pytest.approx(2 * 1.3 / 4.9, rel=1e-9)


def test_shapes_refuse_impossible_values():
    with pytest.raises(SceneError, match=r"Section\.rectangle: height must be a finite number > 0 m, got -0\.1"):
        Section.rectangle(height=-0.1, width=0.1, E=1.0, rho=1.0)
    with pytest.raises(SceneError, match=r"thickness=0\.3 exceeds the outer radius 0\.2 m"):
        Section.tube(radius=0.2, thickness=0.3, E=1.0, rho=1.0)
    with pytest.raises(SceneError, match=r"section 'rod': nu=0\.7 lies outside \(-1, 0\.5\]"):
        Section.circle(radius=0.2, E=1.0, rho=1.0, nu=0.7, name="rod")
    with pytest.raises(SceneError, match="G must be a finite number > 0"):
        Section.circle(radius=0.2, E=1.0, rho=1.0, G=0.0)
    with pytest.raises(SceneError, match="shear_factor must be a finite number > 0"):
        Section.circle(radius=0.2, E=1.0, rho=1.0, shear_factor=-1.0)


def test_full_matrix_is_kept_and_copied_out():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(6, 6))
    C = root @ root.T + np.eye(6)
    section = Section.from_matrix(C, rhoA=1.0, rhoI2=0.1, rhoI3=0.2)
    assert np.allclose(section.C, C, rtol=1e-14)
    assert section.GJ == C[3, 3] and not section.is_diagonal
    section.C[0, 0] = 99.0
    assert section.C[0, 0] == C[0, 0]


def test_full_matrix_may_mix_very_different_stiffness():
    C = np.diag([1e10, 1e9, 1e9, 1e-3, 1e-4, 1e-4])
    assert np.array_equal(Section.from_matrix(C, rhoA=1.0, rhoI2=0.0, rhoI3=0.0).C, C)


def test_full_matrix_errors_say_what_is_wrong():
    inertia = dict(rhoA=1.0, rhoI2=0.0, rhoI3=0.0)
    skew = np.eye(6)
    skew[0, 3] = 0.1
    with pytest.raises(SceneError, match=r"C must be symmetric, C\[0,3\]=0\.1 but C\[3,0\]=0"):
        Section.from_matrix(skew, **inertia)
    indefinite = np.eye(6)
    indefinite[0, 3] = indefinite[3, 0] = 2.0
    with pytest.raises(SceneError, match="smallest eigenvalue is -1 "):
        Section.from_matrix(indefinite, **inertia)
    with pytest.raises(SceneError, match="smallest eigenvalue is -4"):
        Section.from_matrix(np.diag([1.0, 1.0, 1.0, 1.0, 1.0, -4.0]), **inertia)
    with pytest.raises(SceneError, match="C must be 6 x 6 finite numbers"):
        Section.from_matrix(np.eye(5), **inertia)
