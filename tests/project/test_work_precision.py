"""The work-precision comparison reads fronts and times right, measures what it says, and words its verdict by the numbers."""
from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import fastbeam as fb

STUDY = Path(__file__).resolve().parents[2] / "examples" / "study"
MODULES = ("scenes", "methods", "work_precision_plot", "work_precision_text", "work_precision")


@pytest.fixture(scope="module")
def study() -> Iterator[dict[str, ModuleType]]:
    """The modules under their own short names, and nothing new from that folder left behind."""
    known = dict(sys.modules)
    sys.path.insert(0, str(STUDY))
    try:
        yield {name: importlib.import_module(name) for name in MODULES}
    finally:
        sys.path.remove(str(STUDY))
        for name in [n for n, m in sys.modules.items() if n not in known and str(STUDY) in str(getattr(m, "__file__", ""))]:
            del sys.modules[name]


def test_a_front_holds_the_points_that_no_other_beats(study: dict[str, ModuleType]) -> None:
    found = study["work_precision_plot"].front([(3.0, 1e-3), (1.0, 1e-2), (2.0, 5e-2), (4.0, 1e-3), (5.0, 1e-5)])
    assert found == [(1.0, 1e-2), (3.0, 1e-3), (5.0, 1e-5)]


def test_the_time_at_an_error_follows_a_power_law_exactly(study: dict[str, ModuleType]) -> None:
    time_at = study["work_precision_text"].time_at
    law = [(t, 1e-2 * t**-2.0) for t in (1.0, 2.0, 4.0, 8.0)]
    assert time_at(law, 1e-3) == pytest.approx(10.0**0.5, rel=1e-12)
    # all runs are better: the fastest; none is good enough: no time
    assert time_at(law, 1.0) == 1.0
    assert time_at(law, 1e-5) is None


def test_errors_are_distances_over_length_and_peak(study: dict[str, ModuleType]) -> None:
    b = {"position": np.zeros((5, 2, 3)), "s": np.zeros((5, 1)), "force": np.ones((4, 1, 3)), "mean_force": np.ones((4, 3))}
    a = {key: x.copy() for key, x in b.items()}
    a["position"][3, 1] = (3.0, 4.0, 0.0)
    a["s"][2] = -1.0
    a["force"] += 0.1
    a["mean_force"][0] += 0.2
    off = study["work_precision"].errors(a, b, length=10.0)
    assert off == pytest.approx({"position": 0.5, "s": 0.1, "force": 0.1, "mean_force": 0.1})


def test_a_family_sets_the_curve_of_the_sliders(study: dict[str, ModuleType]) -> None:
    tool = study["work_precision"]
    for curve in ("own", "c1"):
        case, model = tool.build("mass_on_cable", tool.Family("simo_reissner", "lagrange", 2, curve=curve), 6)
        assert [s.curve for s in case.scene.sliders] == [curve]
        assert model.n_sliders == 1 and case.scene.gravity.tolist() == [0.0, 0.0, -9.81]


def test_the_mean_contact_force_is_the_gain_in_momentum(study: dict[str, ModuleType]) -> None:
    tool = study["work_precision"]
    case, model = tool.build("mass_on_cable", tool.Family("simo_reissner", "lagrange", 3, curve="c1"), 10)
    found = tool.observe(case, model, "em2", 0.5, 800)
    rows = fb.simulate(model, t_end=0.5, step=0.5 / 800, every=1, output=fb.Output(snapshots=0),
                       progress=False).series["contact_force"][:, 0]
    weight = case.scene.masses[0].mass * case.scene.gravity
    means = [np.trapezoid(rows[k:k + 33], axis=0) / 32 + weight for k in range(32 * tool.FIRST, 800, 32)]
    peak = np.linalg.norm(means, axis=1).max()
    assert found["mean_force"].shape == (len(means), 3) and found["position"].shape == (tool.INSTANTS, 2, 3)
    # rows at the ends of an interval are means of the steps on both sides: off by 1/128 of the change of the force over a step
    assert np.abs(found["mean_force"] - means).max() < 1e-3 * peak
    # round-off of 800 steps
    assert found["energy"] < 1e-11


def test_the_walk_halves_steps_until_the_error_of_space_remains(study: dict[str, ModuleType]) -> None:
    tool, plot = study["work_precision"], study["work_precision_plot"]
    plan = tool.Plan(0.2, 1, (6, 8, 400), (5, 8, 200), 8, repeats=1)
    exact, facts = tool.reference("spaghetti3d", "simo_reissner", plan, False)
    assert facts["uncertainty"]["position"] < 1e-6
    family = tool.walk("spaghetti3d", tool.Family("simo_reissner", "lagrange", 2), 2, (8,), plan, exact, 400)
    found = plot.column({"fields": list(tool.FIELDS)}, family["rows"], "position")
    steps = plot.column({"fields": list(tool.FIELDS)}, family["rows"], "steps")
    assert steps == [25 * 2**k for k in range(len(steps))] and family["failed"] == {}
    assert found[0] > found[-1] > 0.0
    assert found[-1] > 0.8 * found[-2] or steps[-1] == 400


def made_up(factor: float) -> dict[str, Any]:
    """Data of one scene: two degrees with errors t^-2, the default `factor` times slower than degree 4."""
    def rows(slower: float) -> list[list[Any]]:
        return [[slower * t, slower * t, 1e-3 * t**-2.0, None, None, 1e-14] for t in np.geomspace(0.1, 100.0, 13).tolist()]

    families = [{"strain": "simo_reissner", "interpolation": "lagrange", "degree": p, "directors": None, "curve": None,
                 "order": 2, "rows": rows(x), "failed": {}} for p, x in ((3, factor), (4, 1.0))]
    families.append(families[0] | {"strain": "green_lagrange"})
    methods = {"em2": {"label": "energy-momentum, order 2", "rows": rows(1.0), "failed": {}},
               "trapezoidal": {"label": "trapezoidal", "rows": rows(2.0), "failed": {"25 steps": "diverged"}}}
    facts = {"mesh": "fine", "second": "less fine", "uncertainty": {"position": 1e-9}}
    scene = {"letter": "a", "text": "a rod", "t_end": 1.0, "length": 1.0, "sliders": False, "families": families,
             "references": {"simo_reissner": facts, "green_lagrange": facts},
             "methods": {"mesh": "lagrange 3", "uncertainty": {"position": 1e-9}, "space": {"position": 1e-8},
                         "families": methods}}
    return {"fields": ["seconds", "cpu", "position", "force", "mean_force", "energy"], "scenes": {"rod": scene}, "quick": False,
            "repeats": 3, "machine": {"cpu": "none", "python": "3", "numba": "0"}, "command": "none",
            "defaults": {"strain": "simo_reissner", "interpolation": "lagrange", "degree": 3, "directors": "greville",
                         "curve": "c1", "order": 2, "method": "energy_momentum"}}


@pytest.mark.parametrize(("factor", "words"), [(0.5, ", which is the default."), (1.05, "stands beside it"),
                                               (3.0, "does not lie on the front")])
def test_the_verdict_depends_on_the_numbers(study: dict[str, ModuleType], factor: float, words: str) -> None:
    text = study["work_precision_text"].text(made_up(factor))
    assert words in text
    assert text.count("energy-momentum, order 2 - default") == 1
    assert "trapezoidal: 1 of 14 runs; the last with 25 steps: diverged." in text


def test_the_defaults_are_asked_from_the_package(study: dict[str, ModuleType]) -> None:
    assert study["work_precision"].defaults().keys() == made_up(1.0)["defaults"].keys()


def test_all_pictures_are_drawn_from_data_alone(study: dict[str, ModuleType], tmp_path: Path) -> None:
    made = study["work_precision_plot"].draw(made_up(2.0), tmp_path)
    assert [path.stat().st_size > 10_000 for path in made] == [True] * 4
