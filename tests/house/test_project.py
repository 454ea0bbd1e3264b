"""What the project says of itself in several places is the same."""
from __future__ import annotations

import re
import tomllib
from pathlib import Path

import fastbeam as fb

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def links(name: str) -> set[str]:
    """Pages of the same folder, or below it, that a page leads to."""
    return set(re.findall(r"\]\(([\w/-]+\.md)\)", text(name)))


def test_one_version_stands_everywhere() -> None:
    assert PROJECT["version"] == fb.__version__
    assert f"version: {fb.__version__}\n" in text("CITATION.cff")
    assert re.findall(r"^## (\S+)", text("CHANGELOG.md"), re.MULTILINE)[0] == fb.__version__


def test_license_and_authors_are_the_same() -> None:
    author, = PROJECT["authors"]
    assert PROJECT["license"] == "MIT" and text("LICENSE").startswith("MIT License")
    assert author["name"] in text("LICENSE") and author["name"] in text("CITATION.cff") and "license: MIT" in text("CITATION.cff")


def test_the_files_are_linked_and_name_what_is_there() -> None:
    readme = text("README.md")
    assert [name for name in ("LICENSE", "CITATION.cff", "CONTRIBUTING.md", "CHANGELOG.md") if f"]({name})" not in readme] == []
    page = text("CONTRIBUTING.md")
    targets = set(re.findall(r"\]\(([^)#]+)", page)) | set(re.findall(r"`([\w./]+\.py)`", page))
    missing = [name for name in targets if not any((ROOT / folder / name).exists() for folder in ("", "src/fastbeam"))]
    assert len(targets) > 8 and missing == []
    commands = re.findall(r"make ([\w-]+)", page)
    assert [name for name in commands if not re.search(rf"^{name}:", text("Makefile"), re.MULTILINE)] == []


def test_the_page_of_trust_names_tests_that_exist_and_no_file_is_unpickled() -> None:
    page = text("docs/security.md")
    named = re.findall(r"`((?:tests|src)/[\w./]+\.py)`", page)
    assert len(named) > 8 and [name for name in named if not (ROOT / name).exists()] == []
    # kernels and the two processes that compile them; numba's cache and Python's own channels are pickles
    users = {path.relative_to(ROOT / "src" / "fastbeam").as_posix() for path in (ROOT / "src").rglob("*.py")
             if re.search(r"\bpickle\.(?:loads?|Unpickler)\b|\bnp\.load\(|\beval\(|\bexec\(", path.read_text(encoding="utf-8"))}
    assert users == {f"kernels/jit/{name}.py" for name in ("background", "decorators", "sealed")}


def test_every_page_is_part_of_the_site() -> None:
    listed = re.findall(r": ([\w/-]+\.md)$", text("mkdocs.yml"), re.MULTILINE)
    pages = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")}
    # reports stand outside the menu, and a page of their own leads to them
    reports = {name for name in pages if name.startswith("reports/")} - {"reports/index.md"}
    assert sorted(listed) == sorted(pages - reports)
    assert len(reports) == 6 and links("docs/reports/index.md") == {name.split("/")[1] for name in reports}
    assert links("docs/index.md") == {name for name in listed if "/" not in name or name.endswith("/index.md")} - {"index.md"}


def users_pages() -> set[str]:
    """Pages of docs but those about methods, measurements and the inside."""
    pages = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")}
    return {name for name in pages if not name.startswith("reports/")} - {"theory.md", "architecture.md", "extending.md"}


def words(*names: str) -> int:
    return sum(len(text(f"docs/{name}").split()) for name in names)


def test_the_pages_of_users_are_short() -> None:
    assert len(users_pages()) > 30 and words(*users_pages()) <= 30_000
    assert words("glossary.md") <= 900
    assert words("limits.md") <= 2500
    assert words("questions.md", "coming-from.md") <= 2400


def test_the_pages_of_users_begin_with_a_sentence() -> None:
    """Behind the title, and not with a heading, a list or code."""
    for name in users_pages():
        title, first = [line for line in text(f"docs/{name}").splitlines() if line.strip()][:2]
        assert title.startswith("# ") and first[0].isalpha(), name
