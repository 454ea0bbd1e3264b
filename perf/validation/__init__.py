"""Validation of fastbeam: every bar of accuracy is one row of one table, printed by `python perf/validation/validate.py`.

A check is a function `check_...(quick=False) -> list[Row]`; the quick form is a smaller case of the same kind for the test suite.
"""
from __future__ import annotations

from collections.abc import Callable
from importlib import import_module

from .rows import Row, misses

# name on the command line -> module, function
CHECKS: dict[str, tuple[str, str]] = {
    "mass_slider": ("invariants", "check_mass_slider"),
    "body_slider": ("invariants", "check_body_slider"),
    "beam_slider": ("invariants", "check_beam_slider"),
    "cantilever": ("equilibria", "check_cantilever"),
    "bend45": ("equilibria", "check_bend45"),
    "rollup": ("equilibria", "check_rollup"),
    "helix": ("equilibria", "check_helix"),
    "slenderness": ("equilibria", "check_slenderness"),
    "time_order": ("time_order", "check_time_order"),
    "ring_on_cable": ("sliding", "check_ring_on_cable"),
    "slide_cantilever": ("sliding", "check_slide_cantilever"),
    "slide_isolated": ("sliding", "check_slide_isolated"),
    "beads": ("beads", "check_beads"),
    "beam_through_ring": ("sliding_equilibria", "check_beam_through_ring"),
    "ropes": ("sliding_equilibria", "check_ropes"),
    "tendons": ("sliding_equilibria", "check_tendons"),
    "lever": ("sliding_equilibria", "check_lever"),
    "ring_at_rest": ("sliding_equilibria", "check_ring_at_rest"),
    "free_flight": ("flights", "check_free_flight"),
    "spaghetti": ("flights", "check_spaghetti"),
    "frequencies": ("flights", "check_frequencies"),
    "sections": ("sections", "check_sections"),
    "newton": ("tangents", "check_newton"),
    "ring_models": ("sliding", "study_ring_models"),
    "corner_orders": ("time_order", "study_corner_orders"),
}
# rows without a bar: they are printed, and no test runs them
STUDIES = {name for name, (_, function) in CHECKS.items() if function.startswith("study_")}

__all__ = ["CHECKS", "STUDIES", "Row", "check", "misses"]


def check(name: str) -> Callable[..., list[Row]]:
    """The check of that name; its module is loaded when asked for."""
    module, function = CHECKS[name]
    return getattr(import_module(f".{module}", __name__), function)
