"""The page of what works with what shows everything that features declare, and every declaration is looked up somewhere."""
from __future__ import annotations

import ast
import importlib.util
import string
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.model.analyses import Analysis, Asked
from fastbeam.model.feature import Feature, every_feature

ROOT = Path(__file__).resolve().parents[2]


def hook() -> Any:
    spec = importlib.util.spec_from_file_location("works_with", ROOT / "docs" / "works_with.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


PAGE = hook()
LACKS = [(feature, lack) for feature in every_feature() for lack in feature.lacks]


def test_every_analysis_stands_in_one_table_and_every_feature_in_all() -> None:
    shown = [analysis for analyses in PAGE.TABLES.values() for analysis in analyses]
    assert sorted(shown, key=lambda x: x.name) == sorted(Analysis, key=lambda x: x.name)
    text = PAGE.page()
    rows = [row for row in text.splitlines() if row.startswith("| ") and not row.startswith("| --- ")]
    for feature in every_feature():
        assert sum(row.startswith(f"| {feature.title} |") for row in rows) == len(PAGE.TABLES)
    for analyses, table in zip(PAGE.TABLES.values(), text.split("\n## ")):
        cells = [row for row in table.splitlines() if row.startswith("| ")]
        assert {row.count("|") for row in cells} == {len(analyses) + 2}


def test_every_declaration_is_on_the_page() -> None:
    text = PAGE.page()
    assert len(LACKS) > 50
    for feature, lack in LACKS:
        assert lack.analyses and f"- {feature.title}: " in text and PAGE.said(feature, lack) in text, (feature.title, lack.what)


def test_features_have_names_and_numbers_of_their_own() -> None:
    kinds = every_feature()
    assert len(kinds) >= 18 and {Feature} == {Feature} - set(kinds)
    for name in ("key", "title", "order"):
        assert len({getattr(kind, name) for kind in kinds}) == len(kinds), name


@pytest.mark.parametrize(("feature", "lack"), LACKS, ids=[f"{x.key}: {y.what}, {y.analyses[0].name}" for x, y in LACKS])
def test_messages_have_only_words_that_are_given(feature: type[Feature], lack: Any) -> None:
    words = {name for text in (lack.text, lack.instead) for _, name, _, _ in string.Formatter().parse(text) if name}
    assert words <= {"who", "name", "names"} and not lack.text.endswith((".", ";")) and not lack.instead.endswith(".")


def test_every_analysis_is_asked_for_by_some_code() -> None:
    asked = set()
    for path in (ROOT / "src").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("require", "lacking", "told"):
                parts = [x for x in ast.walk(node) if isinstance(x, ast.Attribute)]
                asked |= {x.attr for x in parts if getattr(x.value, "id", "") == "Analysis"}
    assert asked == {analysis.name for analysis in Analysis}


def test_a_model_is_refused_by_what_it_has_alone() -> None:
    """Drag is named where it is, with all that the method does not know; without it the same call runs."""
    section = fb.Section.circle(radius=0.005, E=2e11, rho=7800.0)
    beam = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=section, elements=2)
    still, air = fb.Scene(beam, fb.Clamp(beam.start)), fb.Drag("air", beam, normal=0.1)
    fb.simulate(fb.compile_scene(still), t_end=0.002, step=0.001, method="midpoint", progress=False)
    model = fb.compile_scene(fb.Scene(*still.parts, air))
    with pytest.raises(fb.SceneError, match="^method 'midpoint' does not support drag 'air' on beam 'rod'; use the default "
                                            "method$"):
        fb.simulate(model, t_end=0.002, step=0.001, method="midpoint", progress=False)
    (dragged,) = [x for x in model.features if x.key == "dragged"]
    named = [list(lack.names(dragged, Asked(model, "", np.zeros(0, bool)))) for lack in dragged.lacks]
    assert ["drag 'air' on beam 'rod'"] in named and [] in named
