"""The scenes of examples/study are what they claim, the conserving step keeps their invariants, and its harness counts right."""
from __future__ import annotations

import importlib
import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import fastbeam as fb

STUDY = Path(__file__).resolve().parents[2] / "examples" / "study"
MODULES = ("scenes", "methods", "measures", "pictures", "texts", "tables", "run")
NAMES = ("spaghetti2d", "spaghetti3d", "pendulum", "mass_on_cable", "mass_on_cantilever", "body_on_beam", "beam_on_beam", "large",
         "stiff", "stiff_cantilever")


@pytest.fixture(scope="module")
def study() -> Iterator[dict[str, ModuleType]]:
    """The modules of the study under their own short names, and nothing of them left behind."""
    before = {name: sys.modules.pop(name, None) for name in MODULES}
    sys.path.insert(0, str(STUDY))
    try:
        yield {name: importlib.import_module(name) for name in MODULES}
    finally:
        sys.path.remove(str(STUDY))
        for name, module in before.items():
            sys.modules.pop(name, None)
            if module is not None:
                sys.modules[name] = module


def elements_under(slider: fb.Slider) -> float:
    """Where a slider starts, counted in elements."""
    return slider.at / slider.beam.length * slider.beam.n_elements


def test_the_study_has_a_scene_for_every_letter(study: dict[str, ModuleType]) -> None:
    cases = study["scenes"].CASES
    assert tuple(cases) == NAMES
    assert {build().letter for build in cases.values()} == set("abcdefg")
    # run.py reads the letter from the docstring
    assert all(build.__doc__[1] == build().letter for build in cases.values())


@pytest.mark.parametrize("name", [name for name in NAMES if name != "large"])
def test_a_few_steps_keep_what_the_scene_conserves(study: dict[str, ModuleType], name: str) -> None:
    case = study["scenes"].CASES[name]()
    model = fb.compile_scene(case.scene)
    for order in (2, 4):
        result = fb.simulate(model, t_end=6 * case.step, step=case.step, order=order, points=case.points, progress=False)
        assert set(case.conserved) <= set(result.info["conserved"])
        # round-off of 30 substeps
        assert max(result.drift(key) for key in case.conserved) < 1e-11
        assert result.info["steps"] == 6 and not result.events
    # the scene moves
    assert max(np.linalg.norm(result.point(key)[-1] - result.point(key)[0]) for key in case.points) > 1e-6 * case.length


@pytest.mark.parametrize("name", NAMES)
def test_sliders_start_inside_an_element_and_on_their_beam(study: dict[str, ModuleType], name: str) -> None:
    case = study["scenes"].CASES[name]()
    assert len(case.sliders) == len(case.scene.sliders) == {"a": 0, "b": 0, "f": 32}.get(case.letter, 1)
    for slider in case.scene.sliders:
        x = elements_under(slider)
        assert 0.1 < x - math.floor(x) < 0.9 and 1.0 < x < slider.beam.n_elements - 1.0
    assert ("gap" in case.conserved) == bool(case.sliders)


def test_the_large_scene_is_large_and_every_slider_is_a_real_one(study: dict[str, ModuleType]) -> None:
    case = study["scenes"].CASES["large"]()
    assert len(case.scene.beams) >= 30 and len(case.scene.sliders) >= 30
    assert len({id(slider.beam) for slider in case.scene.sliders}) == len(case.scene.sliders)
    model = fb.compile_scene(case.scene)
    result = fb.simulate(model, t_end=4 * case.step, step=case.step, points=case.points, progress=False)
    assert max(result.drift(key) for key in case.conserved) < 1e-11
    s, force = result.series["s_slide"], result.series["contact_force"]
    # every ring runs on with its own speed, carried by a force of its own across a cable that moves sideways
    rates = (s[-1] - s[0]) / result.t[-1]
    wanted = np.array([slider.rate for slider in case.scene.sliders])
    assert np.abs(rates / wanted - 1.0).max() < 0.05
    assert np.linalg.norm(force[1:], axis=2).max(axis=0).min() > 1e-3
    assert len({round(float(x), 9) for x in np.linalg.norm(force[2], axis=1)}) == len(case.sliders)


@pytest.mark.slow
def test_every_slider_of_the_large_scene_crosses_ten_elements(study: dict[str, ModuleType]) -> None:
    case = study["scenes"].CASES["large"]()
    attempt = study["methods"].run(case, fb.compile_scene(case.scene), "em2", step=case.step)
    assert attempt.status == "done" and max(study["methods"].drifts(case, attempt).values()) < 1e-11
    assert min(study["measures"].crossed(case, attempt.result)) >= 10


@pytest.mark.parametrize("family", [{"interpolation": "bspline", "degree": 2, "directors": "control", "strain": "green_lagrange"},
                                    {"degree": 4, "elements": 8}])
@pytest.mark.parametrize("name", ["mass_on_cable", "body_on_beam"])
def test_scenes_take_other_discretisations(study: dict[str, ModuleType], name: str, family: dict[str, Any]) -> None:
    case = study["scenes"].CASES[name](**family)
    beam = case.scene.beams[0]
    assert (beam.interpolation, beam.degree) == (family.get("interpolation", "lagrange"), family["degree"])
    result = fb.simulate(fb.compile_scene(case.scene), t_end=3 * case.step, step=case.step, progress=False)
    assert max(result.drift(key) for key in case.conserved) < 1e-11


def test_failures_are_recorded_with_step_time_and_reason(study: dict[str, ModuleType]) -> None:
    case = study["scenes"].CASES["spaghetti3d"]()
    model = fb.compile_scene(case.scene)
    # measured: Newton diverges in the first step of half a second
    attempt = study["methods"].run(case, model, "em2", step=0.64)
    assert attempt.status == "newton" and not attempt.survived and not attempt.strict
    assert attempt.time == 0.64 * attempt.step < case.t_end and "increments" in attempt.reason
    # an energy that leaves its scale counts as blown up, however the run ends
    attempt = study["methods"].run(case, model, "em2", step=case.step, t_end=0.1, scale=1e-17)
    assert attempt.status == "blow-up" and attempt.energy_error > 10.0


def test_the_largest_step_is_the_edge_of_what_passes(study: dict[str, ModuleType], monkeypatch: pytest.MonkeyPatch) -> None:
    measures, methods = study["measures"], study["methods"]
    tried = []

    def pretend(case: Any, model: Any, method: str, *, step: float, scale: float, t_end: float) -> Any:
        """Passes below 0.3 and, by luck, at 1; accurate below 0.05."""
        tried.append(step)
        good = step < 0.3 or step == 1.0
        result = type("R", (), {"info": {"iterations": 3, "steps": 1}})()
        return methods.Attempt("done" if good else "newton", step, 1, "", 0.01 if step < 0.05 else 0.5, result)

    monkeypatch.setattr(measures, "run", pretend)
    found = measures.largest_step(None, None, "trapezoidal", 1.0, 0.01, 10.0)
    assert 0.3 / 1.1 < found["survived"]["step"] < 0.3 <= found["survived"]["failed"] <= 0.3 * 1.1
    assert 0.05 / 1.1 < found["strict"]["step"] < 0.05
    assert len(tried) == len(set(tried)) == len(found["runs"])


def test_observed_orders_skip_round_off_and_failures(study: dict[str, ModuleType]) -> None:
    found = study["measures"].orders([0.4, 0.2, 0.1, 0.05], [1.6e-3, 1e-4, math.nan, 1e-16])
    assert found[0] == pytest.approx(4.0) and math.isnan(found[1]) and math.isnan(found[2])
    x = np.ones(20)
    assert study["measures"].zigzag(x) == 0.0
    # the alternating part of 1 +- 0.1 is 0.1
    assert study["measures"].zigzag(1.0 + 0.1 * (-1.0) ** np.arange(20)) == pytest.approx(0.1, rel=0.01)


def test_tables_and_pictures_come_from_the_stored_numbers(study: dict[str, ModuleType], tmp_path: Path) -> None:
    run = study["run"]
    numbers, seconds = run.measure("spaghetti3d", "drift", True)
    assert seconds > 0.0 and numbers["methods"]["em2"]["status"] == "done"
    data = {"cases": {"spaghetti3d": {"drift": run.clean(numbers | {"seconds": seconds})}}}
    (tmp_path / "study").mkdir()
    (tmp_path / "study" / "data.json").write_text(json.dumps(data, allow_nan=False), encoding="utf-8")
    run.main(["--draw", "--out", str(tmp_path)])
    page = (tmp_path / "study.md").read_text(encoding="utf-8")
    assert "(a) spaghetti3d" in page and format(numbers["methods"]["em2"]["energy_error"], ".1e") in page
    for picture in ("scenes.png", "energy.png"):
        assert (tmp_path / "study" / picture).stat().st_size > 3_000
