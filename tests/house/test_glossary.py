"""Words with a sense of their own stand once in the glossary, which is short; private words name nothing in src."""
from __future__ import annotations

import re
import tokenize
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
# what names were before they said what they are
PRIVATE = ("written_in", "in_haste", "beside", "spare", "plain", "apart", "room")
FORMS = {form for word in PRIVATE for form in (word, word.upper(), word.capitalize())}


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


def names(path: Path) -> set[str]:
    """All names in the code of a file, not those in texts and comments."""
    with open(path, "rb") as file:
        return {token.string for token in tokenize.tokenize(file.readline) if token.type == tokenize.NAME}


def test_private_words_are_no_names() -> None:
    found = [f"{path.relative_to(ROOT)}: {name}" for path in sorted(PACKAGE.rglob("*.py")) for name in sorted(names(path))
             if FORMS & {name, *name.strip("_").split("_")}]
    assert found == []
    assert [path.name for path in PACKAGE.rglob("*.py") if path.stem.strip("_") in PRIVATE] == []


def test_names_are_found_in_code_alone(tmp_path: Path) -> None:
    (tmp_path / "x.py").write_text('"""spare"""\ndef f(room):  # plain\n    return room.size\n', encoding="utf-8")
    assert names(tmp_path / "x.py") == {"def", "f", "room", "return", "size"}
