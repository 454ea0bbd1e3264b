"""The site is built without a warning, and its search answers the questions of a first day."""
from __future__ import annotations

import ast
import html
import inspect
import json
import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import pytest

import fastbeam as fb

ROOT = Path(__file__).resolve().parents[2]
# what a new user types; sections that answer it; what such an answer has to name
QUESTIONS = (
    ("how do I damp a vibration", ("questions.html#how-do-i-damp", "how-to/loads.html#damping",
                                   "how-to/loads.html#drag"), "damping"),
    ("how do I drive a slider", ("questions.html#how-do-i-drive", "how-to/sliding.html#friction-drives-and-stops"), "Drive("),
    ("how do I stop a run", ("questions.html#how-do-i-stop", "how-to/running.html#stop-a-run"), "Ctrl-C"),
    ("how do I stop a slider at the end", ("questions.html#how-do-i-stop", "how-to/sliding.html#friction-drives-and-stops",
                                           "how-to/sliding.html#locks-releases-and-one-sided-contact",
                                           "tutorials/crane.html#what-if-nobody-stops-it",
                                           "tutorials/telescope.html#at-its-stop-it-latches"), "Stops("),
    ("how do I read a moment", ("questions.html#how-do-i-read", "how-to/results.html#read-forces-out"), "section_forces"),
    ("how do I export", ("questions.html#how-do-i-export", "how-to/results.html#paraview-pandas"), "to_vtk"),
    ("how do I find modes", ("questions.html#how-do-i-find-natural", "how-to/statics.html#find-frequencies-and-modes"), "modes("),
    ("how do I run 100 cases", ("questions.html#how-do-i-run-100", "how-to/nets.html#many-runs"), "sweep("),
    ("how do I restart", ("questions.html#how-do-i-restart", "how-to/running.html#go-on-from-where-a-run-stopped"), "checkpoint"),
    ("why is it not planar", ("questions.html#why-is-it-not-planar", "how-to/scenes.html#scenes-in-a-plane"), "not_planar"),
    ("how do I add my force", ("questions.html#how-do-i-add-my-force", "how-to/loads.html#forces-of-your-own"), "UserForce("),
    ("how do I install fastbeam", ("questions.html#how-do-i-install",), "pip install"),
    ("python version", ("questions.html#which-python",), "Python 3.11"),
    ("how long does it take to compile", ("questions.html#why-is-the-first-run-slow", "how-to/nets.html#environment"), "warmup"),
    ("how do I define a cross section", ("questions.html#how-do-i-define",), "Section.circle("),
    ("how do I make a curved beam", ("questions.html#how-do-i-make",), "Beam.arc("),
    ("how do I model a cable", ("questions.html#how-do-i-model-a-cable",
                                "how-to/scenes.html#ropes-and-cables"), "Section.circle"),
    ("natural frequency of a string", ("questions.html#how-do-i-model-a-cable",
                                       "questions.html#how-do-i-find-natural"), "modes("),
    ("how do I connect two beams", ("questions.html#how-do-i-connect",), "RigidConnection("),
    ("how do I model a hinge with a motor", ("questions.html#how-do-i-drive",
                                              "how-to/joints.html#joints-with-axes"), "torque="),
    ("how do I fix a node", ("questions.html#how-do-i-fix",), "Clamp("),
    ("reaction force at a support", ("questions.html#how-do-i-fix", "how-to/results.html#read-forces-out"), "reaction"),
    ("how do I add gravity", ("questions.html#how-do-i-add-gravity",), "gravity=("),
    ("how do I apply a force that changes in time", ("questions.html#how-do-i-apply-a-force",), "time=lambda"),
    ("follower force", ("questions.html#how-do-i-apply-a-follower", "limits.html#forces"), "UserForce"),
    ("how do I set the initial velocity", ("questions.html#how-do-i-set", "how-to/scenes.html#build-a-scene"), "RigidMotion"),
    ("how do I choose the time step", ("questions.html#how-do-i-choose",), "tolerance="),
    ("how many elements", ("questions.html#how-many", "how-to/scenes.html#ropes-and-cables"), "elements"),
    ("why does my simulation not converge", ("questions.html#why-does-my-simulation",
                                             "how-to/running.html#when-a-step-fails"), "smaller step"),
    ("how do I add friction", ("questions.html#how-do-i-add-friction",), "friction=0.3"),
    ("how do I model a pulley", ("questions.html#how-do-i-model-a-pulley",), "Slider("),
    ("contact between beams", ("questions.html#how-do-i-model-contact", "limits.html#supports-joints-contact"), "Crossing"),
    ("how do I do a static analysis", ("questions.html#how-do-i-do-a-static",
                                      "how-to/statics.html#find-an-equilibrium"), "solve_static("),
    ("buckling load", ("questions.html#how-do-i-do-a-static", "how-to/statics.html#go-through-a-snap"), "solve_path("),
    ("how do I plot the shape", ("questions.html#how-do-i-plot",), "plot_shapes("),
    ("how do I make a video", ("questions.html#how-do-i-plot", "how-to/results.html#pictures-and-films"), "animate("),
    ("how do I save a result to a file", ("questions.html#how-do-i-save", "how-to/results.html#files"), "save("),
    ("how do I load a result", ("questions.html#how-do-i-save", "how-to/results.html#files"), "load_result("),
    ("how do I print the energy", ("questions.html#how-do-i-print",), "table()"),
    ("how do I get the force in a spring", ("questions.html#how-do-i-get-the-force",
                                            "how-to/joints.html#springs-dampers-bushings"), "spring("),
    ("what is a director", ("questions.html#what-is-a-director", "glossary.html", "theory.html#1-configuration"), "d1"),
    ("rotation angles of a node", ("questions.html#what-is-a-director",), "Rotation.from_matrix"),
    ("change a parameter and run again", ("questions.html#how-do-i-run-100",), "sweep("),
    ("how do I use several cores", ("questions.html#how-do-i-use",), "threads="),
    ("how do I cite", ("questions.html#how-do-i-cite",), "CITATION"),
    # names lead to their entries
    ("Slider", ("api/sliding.html#fastbeam.Slider",), "point"),
    ("Beam", ("api/beams.html#fastbeam.Beam",), "section"),
    ("Result", ("api/results.html#fastbeam.Result",), "series"),
    ("Winch", ("api/joints.html#fastbeam.Winch",), "drum"),
    ("Result.slider", ("api/results.html#fastbeam.Result.slider",), "gap"),
    ("simulate", ("api/running.html#fastbeam.simulate",), "t_end"),
    ("section_forces", ("api/results.html#fastbeam.section_forces",), "beam"))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the built site."""
    pytest.importorskip("mkdocs")
    pytest.importorskip("mkdocstrings_handlers.python")
    place = tmp_path_factory.mktemp("site")
    # --quiet would hide warnings from --strict; signatures are those of these sources
    done = subprocess.run([sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(place)], cwd=ROOT,
                          env=os.environ | {"PYTHONPATH": str(ROOT / "src")}, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "WARNING" not in done.stdout + done.stderr, done.stdout + done.stderr
    return place


@pytest.fixture(scope="module")
def sections(site: Path) -> dict[str, dict[str, str]]:
    """What the search of the built site knows: sections by their address."""
    return {found["location"]: found for found in json.loads((site / "search" / "search_index.json").read_text())["docs"]}


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


def test_entries_of_the_reference_show_arguments_defaults_and_errors(sections: dict[str, dict[str, str]]) -> None:
    """Of a part of a scene, whose constructor is made of its fields, of a function and of a method."""
    shown = {name: sections[f"api/{page}.html#fastbeam.{name}"]["text"] for page, name in
             (("sliding", "Slider"), ("running", "simulate"), ("results", "Result.slider"))}
    assert "one_sided = None" in shown["Slider"] and "When it leaves the beam." in shown["Slider"]
    assert "Parameters: " in shown["simulate"] and "Raises: " in shown["simulate"] and "Returns: " in shown["simulate"]
    assert all(x in shown["simulate"] for x in ("output = None", "Output", "ConvergenceError", "ResultFileError"))
    assert shown["Result.slider"].startswith("slider ( name )")
    assert sections["api/results.html#fastbeam.Result.slider"]["title"] == "Result.slider"


def test_the_architecture_lists_every_file_with_what_it_holds(site: Path) -> None:
    page = html.unescape(re.sub(r"<[^>]*>", " ", (site / "architecture.html").read_text(encoding="utf-8")))
    shown = " ".join(page.split())
    package = ROOT / "src" / "fastbeam"
    files = [path for path in package.rglob("*.py") if path.name != "__init__.py"]
    assert len(files) > 300
    missing = []
    for path in files:
        parts = path.relative_to(package).parts
        # up to the first sentence's end, or to code in it
        begin = re.split(r"`|\. |\n", ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "?")[0].strip()
        if f"{'/'.join(parts[1:] or parts)} {begin}" not in shown:
            missing.append(f"{path.name}: {begin}")
    assert missing == []


@pytest.mark.parametrize(("pages", "least"), [("questions.md", 40), ("how-to/*.md", 180)])
def test_answers_and_recipes_name_what_is_there(pages: str, least: int) -> None:
    """Every call of a program on these pages exists and has the arguments that it is given."""
    calls = 0
    for page in sorted((ROOT / "docs").glob(pages)):
        for block in re.findall(r"(?:^    .*\n(?:\n(?=    ))?)+", page.read_text(encoding="utf-8"), flags=re.MULTILINE):
            if re.match(r"    (python -m|fastbeam:) ", block):                # commands, and what they print
                continue
            for node in ast.walk(ast.parse(textwrap.dedent(block))):
                if isinstance(node, ast.Call) and re.fullmatch(r"fb(\.\w+)+", ast.unparse(node.func)):
                    call = fb
                    for name in ast.unparse(node.func).split(".")[1:]:
                        call = getattr(call, name)
                    given = {x.arg for x in node.keywords}
                    assert given <= set(inspect.signature(call).parameters), f"{page.name}: {ast.unparse(node)}"
                    calls += 1
    assert calls > least


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
