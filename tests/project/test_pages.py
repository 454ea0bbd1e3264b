"""The programs on the pages run, print what the pages say, and draw the pictures that the pages show."""
from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

from fastbeam.__main__ import find_examples

ROOT = Path(__file__).resolve().parents[2]


def load() -> ModuleType:
    """docs/pages.py; docs is no package."""
    spec = importlib.util.spec_from_file_location("pages", ROOT / "docs" / "pages.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # dataclasses look their module up
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


pages = load()
PROGRAMS = pages.tutorials()


def is_small_picture(path: Path) -> bool:
    return path.read_bytes().startswith(b"\x89PNG") and 4_000 < path.stat().st_size <= pages.LARGEST


def test_there_is_a_tutorial_for_every_kind_of_machine() -> None:
    assert [page.stem for page in PROGRAMS] == ["coming-from", "crane", "net", "rope", "telescope", "tendon"]
    index = (ROOT / "docs" / "tutorials" / "index.md").read_text(encoding="utf-8")
    assert [page.name for page in PROGRAMS[1:] if f"]({page.name})" not in index] == []


def test_the_gallery_shows_every_example_and_every_tutorial() -> None:
    page = ROOT / "docs" / "gallery.md"
    text = page.read_text(encoding="utf-8")
    assert sorted(pages.gallery()) == sorted(find_examples())
    assert [name for name in find_examples() if f"](../examples/{name}.py)" not in text or f"run {name}`" not in text] == []
    assert [name for name in ("rope", "telescope", "tendon", "net") if f"](tutorials/{name}.md)" not in text] == []
    assert [name for name in pages.pictures(page) if not is_small_picture(page.parent / name)] == []


@pytest.mark.parametrize("page", PROGRAMS, ids=lambda page: page.stem)
def test_a_tutorial_prints_what_it_says_and_draws_what_it_shows(page: Path, tmp_path: Path) -> None:
    shown = pages.pictures(page)
    found = pages.run(page, tmp_path)
    assert len(found) >= (4 if shown else 1) and all(got.strip() for _, got in found)
    assert [said for block, got in found if (said := pages.same(block.text, got))] == []
    for name in shown:
        pages.shrink(tmp_path / name)
        assert is_small_picture(tmp_path / name) and is_small_picture(page.parent / name)


@pytest.mark.parametrize(("expected", "got"), [
    ("a 1.0000", "a 1.0100"), ("a 1.0", "b 1.0"), ("1e-15", "1e-6"), ("a 1", "a 1\nb 2"), ("3.2e-05", "3.5e-05"),
    ("12 events", "13 events")])
def test_the_comparison_sees_differences(expected: str, got: str) -> None:
    assert pages.same(expected, got)


@pytest.mark.parametrize(("expected", "got"), [
    ("a 1.0000", "a  1.0001"), ("1e-15", "4e-14"), ("3.2e-05", "3.3e-05"), ("12.0 m", "12.0 m"), ("drift -0.0", "drift 0.0")])
def test_the_comparison_lets_last_digits_and_round_off_pass(expected: str, got: str) -> None:
    assert pages.same(expected, got) == ""
