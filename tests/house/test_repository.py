"""Habits that hold for every file of the project."""
from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("src", "tests", "perf", "examples", "docs")
PYTHON_FILES = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py"))
TEXT_FILES = PYTHON_FILES + [path for folder in FOLDERS for kind in ("md", "json", "pyi")
                             for path in (ROOT / folder).rglob(f"*.{kind}")]
TEXT_FILES += [path for path in (ROOT / name for name in ("Makefile", "pyproject.toml", "README.md")) if path.exists()]
SOURCES = [path for path in PYTHON_FILES if ROOT / "src" in path.parents]
TESTS = [path for path in PYTHON_FILES if path.name.startswith("test_")]
# put together here, so that this file does not find itself
FORBIDDEN = ["TO" + "DO", "FIX" + "ME", "NotImplemented" + "Error"]
ABSOLUTE = re.compile(r"(?<![\w.:/}~-])/(?:work|home|root|Users|tmp|mnt|opt|var)/")


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines()


def test_the_lists_of_files_are_not_empty() -> None:
    assert len(SOURCES) > 20 and len(TESTS) > 10


def test_no_source_file_is_longer_than_800_lines() -> None:
    assert {name_of(path): len(lines(path)) for path in SOURCES if len(lines(path)) > 800} == {}


def lengths(text: str) -> dict[str, int]:
    """Lines of every function, without its docstring: name and line to number."""
    found = {}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0]
            told = first.end_lineno - first.lineno + 1 if ast.get_docstring(node) is not None else 0
            found[f"{node.name}, line {node.lineno}"] = node.end_lineno - node.lineno + 1 - told
    return found


def test_no_function_is_longer_than_60_lines_without_its_docstring() -> None:
    long = {f"{name_of(path)}: {name}": n for path in SOURCES for name, n in lengths(path.read_text(encoding="utf-8")).items()
            if n > 60}
    assert long == {}


def test_lines_of_functions_are_counted() -> None:
    text = 'def f(a,\n      b):\n    """A\n    B"""\n    return a\n\nclass C:\n    async def g(self):\n        def h(): pass\n'
    assert lengths(text) == {"f, line 1": 3, "g, line 8": 2, "h, line 9": 1}


def test_no_line_is_longer_than_130_columns() -> None:
    assert [f"{name_of(path)}:{k}" for path in PYTHON_FILES for k, line in enumerate(lines(path), 1) if len(line) > 130] == []


def test_no_file_names_an_absolute_path() -> None:
    assert [f"{name_of(path)}:{k}" for path in TEXT_FILES for k, line in enumerate(lines(path), 1) if ABSOLUTE.search(line)] == []


def test_files_of_perf_that_texts_name_exist() -> None:
    named = {(name_of(path), file) for path in [*TEXT_FILES, ROOT / "CHANGELOG.md"]
             for file in re.findall(r"\bperf/[\w/]+\.py\b", path.read_text(encoding="utf-8"))}
    assert len(named) > 100 and [pair for pair in named if not (ROOT / pair[1]).exists()] == []


def test_nothing_is_left_unfinished() -> None:
    found = [f"{name_of(path)}:{k}: {word}" for path in PYTHON_FILES for k, line in enumerate(lines(path), 1)
             for word in FORBIDDEN if word in line]
    assert found == []


def test_source_is_ascii() -> None:
    assert [name_of(path) for path in SOURCES if not path.read_text(encoding="utf-8").isascii()] == []


def functions(path: Path) -> Iterator[ast.FunctionDef]:
    """All functions of a file, methods too."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef):
            yield node


def called(node: ast.AST) -> set[str]:
    """Last names of everything called inside."""
    return {call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
            for call in ast.walk(node) if isinstance(call, ast.Call)}


def asserts(node: ast.AST, helpers: set[str]) -> bool:
    """An assert statement, an expected error, or a call of something that asserts."""
    names = called(node)
    return (any(isinstance(part, ast.Assert) for part in ast.walk(node)) or bool(names & ({"raises", "warns"} | helpers))
            or any(name.startswith("assert_") for name in names))


@pytest.mark.parametrize("path", TESTS, ids=name_of)
def test_every_test_asserts_something(path: Path) -> None:
    helpers = {f.name for f in functions(path) if not f.name.startswith("test_") and asserts(f, set())}
    empty = [f.name for f in functions(path) if f.name.startswith("test_") and not asserts(f, helpers)]
    assert empty == []


def test_the_search_for_empty_tests_finds_one() -> None:
    tree = ast.parse("def test_a():\n    x = f(1)\ndef test_b():\n    check(2)\ndef check(x):\n    assert x")
    assert [asserts(f, {"check"}) for f in tree.body] == [False, True, True]


@pytest.mark.parametrize("path", [path for path in SOURCES if "kernels" not in path.parts], ids=name_of)
def test_every_public_function_and_class_above_the_kernels_has_a_docstring(path: Path) -> None:
    bare = []
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not node.name.startswith("_") and not ast.get_docstring(node):
            bare.append(node.name)
    assert bare == []
