"""Loads along beams by functions of the arc length: jumps and kinks inside elements, sections, laws that know their place."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.compile.cut_beams import Acting, Element
from fastbeam.compile.unpack import of_elements

SECTION = fb.Section(EA=1e6, GA2=1e6, GA3=1e6, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=1e-6, rhoI3=1e-6)


def rod(**options: Any) -> fb.Beam:
    return fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=SECTION, **{"elements": 5, "degree": 3, **options})


def part(a: float, b: float) -> Any:
    """1 + s between two places."""
    return lambda s: np.c_[0.0 * s, 0.0 * s, np.where((s > a) & (s < b), 1.0 + s, 0.0)]


def integral(a: float, b: float, power: int) -> float:
    """Of s^power (1 + s)."""
    return (b**(power + 1) - a**(power + 1)) / (power + 1) + (b**(power + 2) - a**(power + 2)) / (power + 2)


@pytest.mark.parametrize("options", [{}, {"degree": 1}, {"degree": 6}, {"elements": [0.0, 0.07, 0.5, 1.0]},
                                     {"interpolation": "bspline"}, {"interpolation": "bspline", "directors": "control"}])
def test_a_load_over_a_part_of_a_beam_has_its_force_and_its_moment(options: dict[str, Any]) -> None:
    beam = rod(**options)
    rng = np.random.default_rng(1)
    places = [(0.33, 0.71), (0.2, 0.6), (0.2 + 1e-3, 0.6 - 1e-9), (0.0, 1e-2), *np.sort(rng.random((20, 2)), axis=1)]
    for a, b in places:
        load = fb.DistributedLoad("q", beam, force=part(a, b), moment=part(a, b))
        (_, force), (_, moment) = of_elements(load)
        # the sum of N_a s_a is s, with either family
        at = beam.basis.fit_positions(beam.basis.node_s[:, None])[beam.basis.element_nodes, 0]
        assert np.sum(force[..., 2]) == pytest.approx(integral(a, b, 0), abs=1e-11)
        assert np.sum(force[..., 2] * at) == pytest.approx(integral(a, b, 1), abs=1e-11)
        assert np.sum(moment[..., 2]) == pytest.approx(integral(a, b, 0), abs=1e-11)
        element = Element(beam, Acting(np.zeros(3), ((load, 2.0),)), (0.0, 1.0), np.zeros((beam.degree + 1, 4, 3)))
        assert np.sum(element.forces()[:, 2]) == pytest.approx(2.0 * integral(a, b, 0), abs=1e-11)


def test_a_load_from_a_table_with_kinks_everywhere_is_integrated() -> None:
    s, values = np.linspace(0.0, 1.0, 301), np.random.default_rng(2).random(301)
    load = fb.DistributedLoad("q", rod(), force=lambda x: np.c_[0.0 * x, np.interp(x, s, values), 0.0 * x])
    assert np.sum(of_elements(load)[0][1]) == pytest.approx(np.sum(0.5 * (values[1:] + values[:-1])) / 300.0, abs=1e-10)
    rng = np.random.default_rng(3)
    with pytest.raises(fb.SceneError, match="force.s. changes too often along beam 'rod' to be integrated"):
        of_elements(fb.DistributedLoad("q", rod(), force=lambda x: rng.random((len(x), 3))))


def test_reactions_and_sections_of_a_beam_that_is_loaded_over_a_part() -> None:
    beam, a, b = rod(), 0.33, 0.71
    model = fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.DistributedLoad("q", beam, force=part(a, b))))
    places = {"root": 0.0, "edge": 0.35, "within": 0.5, "far": 0.68, "free": 0.77}
    # a small load, so that nothing moves
    rest = fb.solve_static(model, levels=(1e-6,), observe=("reaction", "section"),
                           points={name: (beam, s) for name, s in places.items()})
    row = np.flatnonzero(rest.t == 1e-6)[0]
    assert rest.reaction("clamp of beam 'rod' node 0")["force"][row, 2] == pytest.approx(-1e-6 * integral(a, b, 0), abs=1e-15)
    for name, s in places.items():
        low = min(max(s, a), b)
        found = rest.section(name)
        assert 1e6 * found["force"][row, 2] == pytest.approx(integral(low, b, 0), abs=1e-9)
        assert 1e6 * found["moment"][row, 1] == pytest.approx(s * integral(low, b, 0) - integral(low, b, 1), abs=1e-9)


def per_length(t: float, position: Any, directors: Any, velocity: Any, spin: Any, parameters: Any, force: Any,
               moment: Any) -> None:
    force[2] = parameters[1] * (1.0 - parameters[0])
    moment[1] = 0.1 * parameters[0]


def test_a_law_along_a_beam_knows_its_place_on_it() -> None:
    rests = []
    for own in (True, False):
        beam = rod()
        if own:
            load: Any = fb.UserForce("q", beam, per_length, parameters=lambda s: np.c_[s, np.full(len(s), 5.0)], grows=True)
        else:
            load = fb.DistributedLoad("q", beam, force=lambda s: np.c_[0 * s, 0 * s, 5.0 * (1.0 - s)],
                                      moment=lambda s: np.c_[0 * s, 0.1 * s, 0 * s])
        rests.append(fb.solve_static(fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), load), planar=False)).state.q)
    # nodes are the points of a quadrature of degree 5, which integrates both exactly
    assert np.max(np.abs(rests[0] - rests[1])) < 1e-11 and np.max(np.abs(rests[0].reshape(-1, 12)[-1, 2])) > 0.1


def test_parameters_of_a_law_by_place_that_cannot_be() -> None:
    beam = rod()
    for wrong, says in ((lambda s: s, "must be finite numbers of shape .n, m. .here .16, m."), (lambda s: 1 / 0, "must not fail"),
                        (lambda s: np.c_[s] * np.nan, "must be finite numbers"), ("s", "must be a list of numbers")):
        with pytest.raises(fb.SceneError, match=f"user force 'q'.*parameters.*{says}"):
            fb.UserForce("q", beam, per_length, parameters=wrong)
    with pytest.raises(fb.SceneError, match="a function of s along a beam only"):
        fb.UserForce("q", beam.end, per_length, parameters=lambda s: np.c_[s])
