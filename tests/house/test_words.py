"""The words of the field: `words.txt` lists what stood before, and what stands instead."""
from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SOURCES = sorted((ROOT / "src").rglob("*.py"))
PAGES = [ROOT / "README.md", *(path for path in sorted((ROOT / "docs").rglob("*.md")) if "reports" not in path.parts)]
PARTS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


def listed(kind: str) -> dict[str, str]:
    """Return what stands instead of the old words of a kind."""
    rows = [line.split("\t") for line in (Path(__file__).parent / "words.txt").read_text().splitlines() if line[:1] != "#"]
    return {old: new for what, old, new in rows if what == kind}


def docstrings(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the docstrings of a file with their lines."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef, ast.Module)) and (text := ast.get_docstring(node)):
            yield getattr(node, "lineno", 1), text


def messages(text: str) -> Iterator[tuple[int, str]]:
    """Yield the texts of a program that are no docstrings, with their lines; {} stands for values."""
    tree = ast.parse(text)
    silent = {node.body[0].value for node in ast.walk(tree) if isinstance(node, (ast.FunctionDef, ast.ClassDef, ast.Module))
              and node.body and isinstance(node.body[0], ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            silent.update(node.values)
            yield node.lineno, "".join(x.value if isinstance(x, ast.Constant) else "{}" for x in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in silent:
            yield node.lineno, node.value


def identifiers(text: str) -> Iterator[tuple[int, str]]:
    """Yield all names of a program, and their parts, with their lines."""
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.NAME:
            for part in {token.string.strip("_").lower(), *map(str.lower, PARTS.findall(token.string))}:
                yield token.start[0], part


def first_words(text: str) -> set[str]:
    """Return the first word of a docstring, and the first two."""
    words = text.split()
    return {words[0].rstrip(",:."), " ".join(words[:2])}


def test_first_lines_of_docstrings_say_what_is_done_or_name_a_thing() -> None:
    openings = listed("opening")
    assert len(openings) > 10
    assert [f"{path.relative_to(ROOT)}:{line}: {text.splitlines()[0]}" for path in SOURCES for line, text in docstrings(path)
            if first_words(text) & openings.keys()] == []


def test_identifiers_are_words_of_the_field() -> None:
    old = listed("identifier")
    assert [f"{path.relative_to(ROOT)}:{line}: {part}, better {old[part]}" for path in SOURCES
            for line, part in identifiers(path.read_text()) if part in old] == []
    assert [path.name for path in SOURCES if path.stem.strip("_") in old] == []


def test_docstrings_and_pages_have_no_private_phrases() -> None:
    old = listed("phrase")
    pattern = re.compile(rf"\b({'|'.join(map(re.escape, old))})\b")
    texts = [(path, text) for path in SOURCES for _, text in docstrings(path)] + [(path, path.read_text()) for path in PAGES]
    assert [f"{path.relative_to(ROOT)}: {found[0]}, better {old[found[0]]}" for path, text in texts
            for found in pattern.finditer(text)] == []


def test_messages_have_no_private_phrases() -> None:
    old = listed("message")
    pattern = re.compile(rf"\b({'|'.join(map(re.escape, old))})\b")
    assert [f"{path.relative_to(ROOT)}:{line}: {found[0]}, better {old[found[0]]}" for path in SOURCES
            for line, text in messages(path.read_text()) for found in pattern.finditer(text)] == []


def test_what_is_looked_for_is_found() -> None:
    assert list(messages('def f(x):\n    """Text."""\n    return "one", f"two {x} {\'three\'}"')) == [
        (3, "one"), (3, "two {} {}"), (3, "three")]
    assert "whether" in {part for _, part in identifiers("def is_whetherOr(x): return NAME_whether")}
    assert first_words("The same, computed.") >= {"The"} and "The same," in first_words("The same, computed.")
    assert list(docstrings(Path(__file__)))[0][1].startswith("The words of the field")
