"""The page of limits is found, and what it says is not there is not there."""
from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any

import pytest

import fastbeam as fb
from fastbeam.interface.synonyms import ABSENT

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "limits.md").read_text(encoding="utf-8")
# first column of every table
CELLS = [row.split("|")[1] for row in PAGE.splitlines() if row.startswith("|") and row.count("|") == 3]
NAMES = sorted({name for cell in CELLS for name in re.findall(r"`([^`]+)`", cell)})
# what a new user searches for
WORDS = ("damping", "friction", "spring", "motor", "reaction", "contact", "revolute", "prismatic", "hydrodynamics", "follower",
         "plasticity", "arc length", "modal", "winch", "sleeve", "GPU", "prestress", "stress", "impact", "prescribed",
         "eigenfrequencies", "wind", "buckling", "pressure", "temperature", "hinge", "roller", "collision")


def callables() -> list[Any]:
    """Every public function, constructor and method."""
    out = []
    for name in fb.__all__:
        thing = getattr(fb, name)
        out += [thing] if callable(thing) else []
        out += [found for _, found in inspect.getmembers(thing, callable) if inspect.isclass(thing)]
    return out


def arguments() -> set[str]:
    found: set[str] = set()
    for call in callables():
        try:
            found |= set(inspect.signature(call).parameters) | set(getattr(call, "kinds", ()))
        except (TypeError, ValueError):
            continue
    return found


def test_the_page_has_names_to_check() -> None:
    assert len(NAMES) > 40 and {"drag=", "Wall", "Result.stress"} <= set(NAMES)


def test_what_the_page_says_is_not_there_is_not_there() -> None:
    known = arguments()
    assert {"t_end", "section", "gravity", "rho_inf"} <= known
    there = [name for name in NAMES if name.endswith("=") and name[:-1] in known]
    there += [name for name in NAMES if not name.endswith("=") and "." not in name and (hasattr(fb, name) or name in fb.__all__)]
    there += [name for name in NAMES if name.startswith("Result.") and hasattr(fb.Result, name.split(".")[1])]
    assert there == [], "it exists now: take it off docs/limits.md and say where it is described"


def test_arguments_that_are_refused_with_a_pointer_stand_on_the_page() -> None:
    assert [word for word in ABSENT if not re.search(rf"\b{word}\b", PAGE, re.IGNORECASE)] == []


@pytest.mark.parametrize("word", WORDS)
def test_words_that_one_searches_for_are_found(word: str) -> None:
    assert re.search(rf"\b{word}\b", PAGE, re.IGNORECASE)


@pytest.mark.parametrize(("page", "link"), [("README.md", "docs/limits.md"), ("docs/how-to/index.md", "../limits.md"),
                                            ("docs/reference.md", "limits.md")])
def test_the_page_is_linked(page: str, link: str) -> None:
    assert f"]({link})" in (ROOT / page).read_text(encoding="utf-8")
