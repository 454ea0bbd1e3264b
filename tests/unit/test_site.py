"""The site is built without a warning, and its search answers the questions of a first day."""
from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
# what a new user types; sections that answer it; what such an answer has to name
QUESTIONS = (
    ("how do I damp a vibration", ("questions.html#how-do-i-damp", "how-to.html#damping", "how-to.html#drag"), "damping"),
    ("how do I drive a slider", ("questions.html#how-do-i-drive", "how-to.html#friction-drives-and-stops"), "Drive("),
    ("how do I stop a run", ("questions.html#how-do-i-stop", "how-to.html#stop-a-run"), "Ctrl-C"),
    ("how do I stop a slider at the end", ("questions.html#how-do-i-stop", "how-to.html#friction-drives-and-stops",
                                           "how-to.html#locks-releases-and-one-sided-contact",
                                           "tutorials/crane.html#what-if-nobody-stops-it",
                                           "tutorials/telescope.html#at-its-stop-it-latches"), "Stops("),
    ("how do I read a moment", ("questions.html#how-do-i-read", "how-to.html#read-forces-out"), "section_forces"),
    ("how do I export", ("questions.html#how-do-i-export", "how-to.html#paraview-pandas"), "to_vtk"),
    ("how do I find modes", ("questions.html#how-do-i-find-natural", "how-to.html#find-frequencies-and-modes"), "modes("),
    ("how do I run 100 cases", ("questions.html#how-do-i-run-100", "how-to.html#many-runs"), "sweep("),
    ("how do I restart", ("questions.html#how-do-i-restart", "how-to.html#go-on-from-where-a-run-stopped"), "checkpoint"),
    ("why is it not planar", ("questions.html#why-is-it-not-planar", "how-to.html#scenes-in-a-plane"), "not_planar"),
    ("how do I add my force", ("questions.html#how-do-i-add-my-force", "how-to.html#forces-of-your-own"), "UserForce("))


@pytest.fixture(scope="module")
def sections(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, str]]:
    """What the search of the built site knows: sections by their address."""
    pytest.importorskip("mkdocs")
    place = tmp_path_factory.mktemp("site")
    done = subprocess.run([sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", str(place)], cwd=ROOT,
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return {found["location"]: found for found in json.loads((place / "search" / "search_index.json").read_text())["docs"]}


@pytest.fixture(scope="module")
def index(sections: dict[str, dict[str, str]]) -> Any:
    """The index that the search page makes of them, as mkdocs does: lunr over titles and texts, without weights."""
    lunr = pytest.importorskip("lunr")
    return lunr.lunr(ref="location", fields=("title", "text"), documents=list(sections.values()))


@pytest.mark.parametrize(("query", "answers", "names"), QUESTIONS, ids=[query for query, *_ in QUESTIONS])
def test_a_question_is_answered_in_the_first_three_hits(query: str, answers: tuple[str, ...], names: str, index: Any,
                                                        sections: dict[str, dict[str, str]]) -> None:
    hits = [hit["ref"] for hit in index.search(query)[:3]]
    found = [hit for hit in hits if hit.startswith(answers)]
    assert found, hits
    # and the section does answer: it says what to write
    assert any(names in sections[hit]["text"] for hit in found), found


def test_every_address_of_an_answer_exists(sections: dict[str, dict[str, str]]) -> None:
    missing = [answer for _, answers, _ in QUESTIONS for answer in answers if not any(x.startswith(answer) for x in sections)]
    assert missing == []


def test_links_to_sections_lead_somewhere(sections: dict[str, dict[str, str]]) -> None:
    broken = []
    for page in sorted((ROOT / "docs").rglob("*.md")):
        for target, anchor in re.findall(r"\]\(([\w./-]*\.md)#([\w-]+)\)", page.read_text(encoding="utf-8").replace("\n", " ")):
            where = (page.parent / target).resolve().relative_to(ROOT / "docs").with_suffix(".html").as_posix()
            if f"{where}#{anchor}" not in sections:
                broken.append(f"{page.name}: {target}#{anchor}")
    assert broken == []
