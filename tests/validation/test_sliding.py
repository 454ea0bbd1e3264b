"""Sliding contact meets exact solutions and other programs."""
from __future__ import annotations

from perf.validation import misses
from perf.validation.beads import check_beads
from perf.validation.sliding import check_ring_on_cable, check_slide_cantilever, check_slide_isolated


def test_a_ring_on_a_hanging_cable_agrees_with_another_program() -> None:
    assert misses(check_ring_on_cable(quick=True)) == []


def test_a_particle_on_a_cantilever_agrees_with_the_spectral_code() -> None:
    assert misses(check_slide_cantilever(quick=True)) == []


def test_a_particle_on_a_free_beam_agrees_with_the_spectral_code() -> None:
    assert misses(check_slide_isolated(quick=True)) == []


def test_beads_on_stiff_wires_follow_their_exact_laws() -> None:
    assert misses(check_beads(quick=True)) == []
