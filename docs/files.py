"""For the page of the architecture: all files of the package, each with its first sentence. mkdocs calls what stands here."""
from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

from markdown import markdown

PACKAGE = Path(__file__).resolve().parents[1] / "src" / "fastbeam"
MARKER = "<!-- files -->"


def first_sentence(path: Path) -> str:
    """Return the first sentence of the docstring of a file, '' where it has none."""
    paragraph = (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").partition("\n\n")[0]
    return re.split(r"(?<=\.)\s", paragraph)[0].replace("\n", " ").replace("|", r"\|")


def table(folder: Path, files: list[Path]) -> str:
    """Return the table of some files below a folder."""
    rows = [f"| `{path.relative_to(folder).as_posix()}` | {first_sentence(path)} |" for path in files]
    return "\n".join(["| file | what it holds |", "| --- | --- |", *rows])


def all_files() -> str:
    """Return a heading and a table for every package; the files of the folder above them come first."""
    out = [f"### fastbeam\n\n{table(PACKAGE, sorted(PACKAGE.glob('*.py')))}"]
    for package in sorted(path.parent for path in PACKAGE.glob("*/__init__.py")):
        files = [path for path in sorted(package.rglob("*.py")) if path.name != "__init__.py"]
        out.append(f"### {package.name}\n\n{first_sentence(package / '__init__.py')}\n\n{table(package, files)}")
    return "\n\n".join(out)


def on_post_page(output: str, **more: Any) -> str:
    """Put the tables where the marker stands: behind the search, whose answers are for users."""
    return output.replace(MARKER, markdown(all_files(), extensions=["tables"])) if MARKER in output else output
