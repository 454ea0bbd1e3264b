"""Statics meets closed forms and high-precision shooting."""
from __future__ import annotations

import math

import numpy as np
import pytest

from perf.validation import check, misses
from perf.validation.equilibria import check_bend45, check_cantilever, check_helix, check_rollup, check_slenderness, helix
from perf.validation.rows import reference


def test_cantilevers_agree_with_exact_reissner_values_to_ten_digits() -> None:
    assert misses(check_cantilever(quick=True)) == []


def test_the_45_degree_bend_converges_with_order_two_p() -> None:
    assert misses(check_bend45(quick=True)) == []


def test_an_end_moment_rolls_a_cantilever_up_to_a_full_circle() -> None:
    assert misses(check_rollup(quick=True)) == []


def test_an_oblique_end_moment_bends_a_straight_rod_into_a_helix() -> None:
    assert misses(check_helix(quick=True)) == []


def test_the_closed_form_of_the_helix_satisfies_its_equations() -> None:
    moment, s, h = np.array((0.9, 0.5, 1.1)), 3.7, 1e-5
    (before, d_before), (_, d), (after, d_after) = (helix(x, moment) for x in (s - h, s, s + h))
    # central differences: 1e-9; phi' = d1 and curvature = moment over stiffness (EI = 2, GJ = 1.3)
    assert np.allclose((after - before) / (2 * h), d[0], atol=1e-8)
    d_s = (d_after - d_before) / (2 * h)
    curvature = 0.5 * np.array((d_s[1] @ d[2] - d_s[2] @ d[1], d_s[2] @ d[0] - d_s[0] @ d[2], d_s[0] @ d[1] - d_s[1] @ d[0]))
    assert np.allclose(curvature, d @ moment / np.array((1.3, 2.0, 2.0)), atol=1e-8)


def test_slender_beams_do_not_lock() -> None:
    assert misses(check_slenderness(quick=True)) == []


@pytest.mark.parametrize("name", ["beam_through_ring", "ropes", "tendons", "lever", "ring_at_rest"])
def test_sliders_rest_where_exact_solutions_say(name: str) -> None:
    rows = check(name)(quick=True)
    print(*rows, sep="\n")
    assert misses(rows) == []


@pytest.mark.parametrize("name", ["cantilever", "bend45", "ring_on_cable", "slide_cantilever", "slide_isolated", "free_flight",
                                  "spaghetti", "sliding_exact", "sliding_equilibria", "frequencies"])
def test_every_reference_says_what_it_is_and_how_good(name: str) -> None:
    data = reference(name)
    assert len(data["what"]) > 20 and len(data["accuracy"]) > 10
    assert "rows" not in data or data["rows"].shape[1] == len(data["columns"])


def test_the_cantilever_reference_balances_moments_at_the_clamp() -> None:
    # M(0) = x_tip F_y - y_tip F_x + M_tip: the copied numbers belong together
    for case in reference("cantilever")["cases"]:
        (x, y), (f_x, f_y) = case["tip"], case["force"]
        assert math.isclose(case["root_moment"], x * f_y - y * f_x + case["moment"], rel_tol=1e-12)


def test_the_reference_of_ropes_balances_forces_at_the_ring() -> None:
    for case in reference("sliding_equilibria")["ropes"].values():
        H, T = case.get("H", [case.get("horizontal_tension")] * 2), case["tension_at_ring"]
        # of both sides the same tension; a ring between rising and falling rope carries the difference of horizontal parts
        left, right = (math.sqrt(T**2 - h**2) for h in H)
        if "force_on_ring" in case:
            x, y = case["force_on_ring"]
            assert math.isclose(x, H[1] - H[0], rel_tol=1e-12)
            assert any(math.isclose(-y, a * left + b * right, rel_tol=1e-12) for a in (1, -1) for b in (1, -1))
        else:
            assert math.isclose(case["ring_weight"], left + right, rel_tol=1e-12)
