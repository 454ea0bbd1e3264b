"""Words with a sense of their own stand once in the glossary, which is short."""
from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "src" / "fastbeam"
PAGE = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
# bullets: term, and what it means
TERMS = dict(re.findall(r"^- \*\*(.+?)\*\*: ((?:.|\n  )+)", PAGE, re.MULTILINE))
# words that docs and docstrings use for one thing each
WORDS = ("director", "net", "slider", "sleeve", "event", "row", "conserving step", "noun", "term", "generic function", "lane",
         "block, row", "chain, tree, plan", "inner node", "condensed beam", "constraint row", "border", "method")


def test_every_term_is_defined_once_in_a_sentence() -> None:
    terms = re.findall(r"^- \*\*(.+?)\*\*", PAGE, re.MULTILINE)
    assert len(terms) > 40 and len(terms) == len(set(terms)) == len(TERMS)
    assert [term for term, text in TERMS.items() if len(text) < 20 or not text.endswith(".")] == []
    assert [word for word in WORDS if word not in TERMS] == []


def test_the_places_exist() -> None:
    places = re.findall(r"`([\w/]+/(?:\w+\.py)?)`", PAGE)
    assert len(places) > 8 and [place for place in places if not (PACKAGE / place).exists()] == []


@pytest.mark.parametrize(("page", "link"), [("docs/index.md", "glossary.md"), ("docs/architecture.md", "glossary.md")])
def test_the_page_is_linked(page: str, link: str) -> None:
    assert f"]({link})" in (ROOT / page).read_text(encoding="utf-8")
