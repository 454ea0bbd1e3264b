"""For the page of what works with what: tables of features and analyses, from what features declare. mkdocs calls it."""
from __future__ import annotations

import re
from typing import Any

from markdown import markdown

from fastbeam.compile.compile import compile_scene  # noqa: F401  with it all features are known
from fastbeam.model.analyses import Analysis, Lack
from fastbeam.model.feature import Feature, every_feature

MARKER = "<!-- works with -->"
TABLES = {
    "Compiling and running": (
        Analysis.PLANAR, Analysis.COMPARED, Analysis.ORDER_4, Analysis.COMPOSED, Analysis.FILTERED, Analysis.STEP_CONTROL,
        Analysis.GRAVITY_IN_TIME, Analysis.BLOWS, Analysis.MASSES, Analysis.PROJECTION,
        Analysis.CATCHING, Analysis.INNER, Analysis.ADJOINT),
    "Equilibria": (
        Analysis.STATIC, Analysis.EXACT, Analysis.RELAX, Analysis.PATH, Analysis.LENGTHS, Analysis.STICK,
        Analysis.BUCKLING, Analysis.SENSITIVITY,
        Analysis.AT_TIME, Analysis.TIME_SPAN, Analysis.TWO_TIMES, Analysis.TIMELESS_LOADS, Analysis.TIMELESS,
        Analysis.TIMELESS_SHAPES),
    "Vibration and steady motion": (
        Analysis.MODES, Analysis.DAMPED, Analysis.LOSS_FACTOR, Analysis.STEADY, Analysis.TRAVEL, Analysis.TIMELESS_MODES)}
WORKS = "+"


def lacks_of(feature: type[Feature], analysis: Analysis) -> list[Lack]:
    """Return what an analysis cannot do with a feature."""
    return [lack for lack in feature.lacks if analysis in lack.analyses]


def advice(lack: Lack) -> str:
    """Return what to do instead, for a scene without names."""
    return re.sub(r"\{(name|names)(!r)?\}", lambda found: "'name'" if found[2] else "it", lack.instead)


def said(feature: type[Feature], lack: Lack) -> str:
    """Return what is not known of a feature and what to do instead; where all of it is not known, the advice alone."""
    whole = feature.title, feature.title.partition(" (")[0]
    return advice(lack) if lack.what in whole else f"{lack.what}: {advice(lack)}"


def cell(feature: type[Feature], analysis: Analysis) -> str:
    """Return '+', or all that an analysis does not know of a feature."""
    return "; ".join(said(feature, lack) for lack in lacks_of(feature, analysis)).replace("|", r"\|") or WORKS


def grid(analyses: tuple[Analysis, ...]) -> str:
    """Return the table of features and some analyses; '-' stands where a reason follows below."""
    rows = ["| | " + " | ".join(f"`{x.value}`" for x in analyses) + " |", "| --- |" + " --- |" * len(analyses)]
    rows += [f"| {feature.title} | " + " | ".join(WORKS if not lacks_of(feature, x) else "-" for x in analyses) + " |"
             for feature in every_feature()]
    return "\n".join(rows)


def reasons(analyses: tuple[Analysis, ...]) -> str:
    """Return a list of what is not known, and what to do instead, for every analysis."""
    out = []
    for analysis in analyses:
        lines = [f"- {feature.title}: {cell(feature, analysis)}" for feature in every_feature() if lacks_of(feature, analysis)]
        out.append("\n".join([f"`{analysis.value}`", "", *lines]) if lines else "")
    return "\n\n".join(x for x in out if x)


def page() -> str:
    """Return all tables, each with its reasons."""
    return "\n\n".join(f"## {title}\n\n{grid(analyses)}\n\n{reasons(analyses)}" for title, analyses in TABLES.items())


def on_post_page(output: str, **more: Any) -> str:
    """Put the tables where the marker stands."""
    return output.replace(MARKER, markdown(page(), extensions=["tables"])) if MARKER in output else output
