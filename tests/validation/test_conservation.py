"""Energy, momenta and gap of free flights with sliding contact stay at round-off."""
from __future__ import annotations

import numpy as np
import pytest

from perf.validation import misses
from perf.validation.invariants import check_beam_slider, check_body_slider, check_mass_slider, fly, mass_scene


def test_a_mass_sliding_on_a_free_beam_conserves_energy_momenta_and_gap() -> None:
    assert misses(check_mass_slider(quick=True)) == []


def test_a_body_sliding_with_a_point_off_its_centre_conserves_energy_momenta_and_gap() -> None:
    assert misses(check_body_slider(quick=True)) == []


def test_a_beam_node_sliding_on_another_beam_conserves_energy_momenta_and_gap() -> None:
    assert misses(check_beam_slider(quick=True)) == []


@pytest.mark.parametrize("curve", ["own", "c1"])
def test_a_contact_that_passes_eight_elements_really_bends_the_beam(curve: str) -> None:
    result, passed = fly(mass_scene(curve=curve, degree=2), 2)
    assert passed >= 8
    # conservation of a beam that hardly moves would prove little
    assert result.series["strain"].max() > 0.1 * result.series["total"][0]
    assert np.ptp(result.series["kinetic"]) > 0.1 * result.series["total"][0]
    assert result.drift("total") < 1e-12
