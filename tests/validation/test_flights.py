"""Dynamics without sliders meets a spectral code; the step has its orders."""
from __future__ import annotations

from perf.validation import misses
from perf.validation.flights import check_free_flight, check_frequencies, check_spaghetti
from perf.validation.time_order import check_time_order


def test_positions_converge_with_orders_two_and_four_in_time() -> None:
    assert misses(check_time_order(quick=True)) == []


def test_the_free_flight_agrees_with_the_spectral_code() -> None:
    assert misses(check_free_flight(quick=True)) == []


def test_the_flying_spaghetti_agrees_with_the_spectral_code() -> None:
    assert misses(check_spaghetti(quick=True)) == []


def test_a_pinned_beam_vibrates_with_its_exact_frequency() -> None:
    assert misses(check_frequencies(quick=True)) == []
