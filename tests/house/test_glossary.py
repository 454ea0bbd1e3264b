"""Words with a sense of their own stand once in the glossary, with a place that exists; private words name nothing in src."""
from __future__ import annotations

import re
import tokenize
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "src" / "fastbeam"
PAGE = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
ROWS = [[cell.strip() for cell in line.split("|")[1:-1]] for line in PAGE.splitlines()
        if line.startswith("| ") and not line.startswith(("| term | meaning", "| ---"))]
THEORY = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
# words that docs and docstrings use for one thing each
WORDS = ("director triad", "own curve", "c1 curve", "chain", "tree", "net", "condensed beam", "inner node", "tied node",
         "carried slider", "border", "constraint row", "block", "lane", "group of eight elements", "term", "generic function",
         "kind of node", "strain set", "method", "saved and kept", "event", "row of a result", "slider", "link", "panel",
         "carrier")
# what names were before they said what they are
PRIVATE = ("written_in", "in_haste", "beside", "spare", "plain", "apart", "room")
FORMS = {form for word in PRIVATE for form in (word, word.upper(), word.capitalize())}


def test_every_row_has_a_term_a_meaning_synonyms_and_a_place() -> None:
    assert len(ROWS) > 70
    assert [row for row in ROWS if len(row) != 4 or not row[0] or len(row[1]) < 20 or not row[3]] == []


def test_every_term_is_defined_once() -> None:
    assert [term for term, count in Counter(row[0].lower() for row in ROWS).items() if count > 1] == []
    assert [word for word in WORDS if word not in {row[0] for row in ROWS}] == []


def test_the_places_exist() -> None:
    gone = []
    for term, _, _, where in ROWS:
        gone += [f"{term}: {x}" for x in re.findall(r"`([^`]+)`", where)
                 if not (PACKAGE / x).exists() and not (ROOT / x).exists()]
        gone += [f"{term}: {x}" for x in re.findall(r"\(\d+\.\d+\)", where) if x not in THEORY]
        gone += [f"{term}: {x}" for x in re.findall(r"(?<![\d.(])\d+(?:\.\d)?(?![\d.)])", where)
                 if not re.search(rf"^##+ {re.escape(x)}[. ]", THEORY, re.MULTILINE)]
    assert gone == []


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
