"""At least ten likely mistakes for every public noun and call: the message names what is wrong and what to write instead.

They stand in `mistakes.txt`: a call that works, and below it what is wrong | what the message contains. Wrong is an argument that
is added or takes the place of that of the call (`axis='y'`), one that is left out (`-axis`), or all arguments (`(rod.end)`).
"""
from __future__ import annotations

import ast
import warnings
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_bad_input import between, held_value, law, public, response, rubbing, tension
from test_bad_input import result as sliding

import fastbeam as fb
from fastbeam.interface.synonyms import ABSENT, CONVERTED, WORDS, instead, known

SECTION = fb.Section.circle(radius=0.02, E=1e9, rho=1000.0)
ROD = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0), section=SECTION, elements=2)
RAIL = fb.Beam.straight("rail", (1, 0, 0), (2, 0, 0), section=SECTION, elements=2)
PARTS = {"sec": SECTION, "rod": ROD, "rail": RAIL, "bead": fb.PointMass("bead", mass=1.0),
         "block": fb.RigidBody("block", mass=1.0, inertia=(1, 1, 1), position=(1, 0, 0)),
         "net": fb.Net("roof", [(0, 0, 0), (1, 0, 0)], [(0, 1)], section=SECTION)}
LAWS = {"law": law, "between": between, "tension": tension, "control": held_value}
# calls of files that are not there, and of states that no short call finds, do not work as they stand
FAILING = ("fb.load_", "fb.critical_sensitivity", "fb.relax")


def scene_of(L: float) -> tuple[fb.Scene, dict[str, Any]]:  # noqa: N803
    beam = fb.Beam.straight("boom", (0, 0, 0), (L, 0, 0), section=SECTION, elements=1)
    return fb.Scene(beam, fb.Clamp(beam.start), gravity=(0, 0, -0.01)), {"tip": beam.end}


@cache
def names() -> dict[str, Any]:
    scene = fb.Scene(ROD, fb.Clamp(ROD.start), fb.Load("push", ROD.end, force=(0, 0, 0.01)))
    model = fb.compile_scene(scene)
    still = fb.solve_static(model).state
    return {"fb": fb, "np": np, **PARTS, **LAWS, "scene_of": scene_of, "scene": scene, "model": model, "still": still,
            "result": fb.simulate(model, t_end=2e-3, step=1e-3, progress=False, points={"tip": ROD.end}),
            "modes": fb.modes(model, state=still, n=3), "response": response(), "rubbing": rubbing(), "sliding": sliding()}


def table() -> dict[str, list[tuple[str, str]]]:
    """Wrong arguments and messages by calls."""
    out: dict[str, list[tuple[str, str]]] = {}
    works = ""
    for line in (Path(__file__).parent / "mistakes.txt").read_text(encoding="utf-8").splitlines():
        if line.startswith(" "):
            wrong, _, message = line.strip().partition(" | ")
            out[works].append((wrong, message))
        else:
            works = line
            out[works] = []
    return out


def spoiled(works: str, wrong: str) -> str:
    """The call with wrong arguments."""
    head, call = works.split("(", 1)[0], ast.parse(works, mode="eval").body
    assert isinstance(call, ast.Call)
    if wrong.startswith("("):
        return head + wrong
    by_name = {str(k.arg): ast.unparse(k.value) for k in call.keywords}
    if wrong.startswith("-"):
        by_name = {name: x for name, x in by_name.items() if name not in wrong[1:].split(",")}
    else:
        more = ast.parse(f"f({wrong})", mode="eval").body
        assert isinstance(more, ast.Call)
        by_name |= {str(k.arg): ast.unparse(k.value) for k in more.keywords}
    return f"{head}({', '.join([*map(ast.unparse, call.args), *(f'{name}={x}' for name, x in by_name.items())])})"


MISTAKES = table()


@pytest.mark.parametrize("works", MISTAKES)
def test_messages_say_what_is_wrong_and_what_to_write(works: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if not works.startswith(FAILING):
            eval(works, dict(names()))
        for wrong, message in MISTAKES[works]:
            with pytest.raises((fb.SceneError, fb.ResultFileError)) as caught:
                eval(spoiled(works, wrong), dict(names()))
            assert message in str(caught.value), (wrong, str(caught.value))
            # nothing from inside
            assert not any(word in str(caught.value) for word in (" object at 0x", "array(", "Tables(", "__init__", "Exports"))


def test_every_public_call_has_ten() -> None:
    counts: dict[str, int] = {}
    for works, rows in MISTAKES.items():
        name = works.split("(", 1)[0].removeprefix("fb.")
        counts[name] = counts.get(name, 0) + len(rows)
    few = {name for name, _ in public() if "." not in name and counts.get(name, 0) < 10} - {"GROUND"}
    assert few == set()
    assert sum(counts.values()) > 900


def shared() -> Iterator[tuple[str, str]]:
    """Words of the table and the argument that each comes to, where a call has that argument alone."""
    for argument, words in WORDS.items():
        if "=" not in argument and " " not in argument:
            yield from ((word, argument) for word in words.split())


def test_every_word_leads_to_its_argument_and_no_argument_to_itself() -> None:
    for word, argument in shared():
        found = instead(word, ["other", argument])
        assert found == f"; use {argument}" or found.startswith(f"; use {argument}, ") and argument in CONVERTED, word
        assert word != argument


def test_words_that_mean_something_else_say_what_the_argument_is() -> None:
    for argument, rows in CONVERTED.items():
        names_of_call = argument.split(" and ")
        for words, what in rows.items():
            assert set(words.split()) <= set(WORDS[argument].split())
            assert all(instead(word, names_of_call).endswith(f"{argument}, {what}") for word in words.split())
    # friction of joints is a limit in N or N m, and mu their coefficient
    assert instead("mu", ["friction", "coefficient"]) == "; use coefficient" and instead("mu", ["friction"]) == "; use friction"
    for call, wrong, says in ((fb.Section.circle, {"diameter": 0.02}, "use radius, half of the diameter"),
                              (fb.Section.tube, {"radius": 0.02, "inner_radius": 0.018},
                               "use thickness, the radius less the inner radius")):
        with pytest.raises(fb.SceneError, match=says):
            call(E=1e9, rho=1e3, **wrong)


def test_words_name_arguments_that_exist() -> None:
    import inspect
    known = {p for _, function in public() for p in inspect.signature(function).parameters}
    for argument in WORDS:
        for name in argument.split("=")[0].split(" and "):
            assert name in known or argument == "each part without a name", argument


def test_names_that_do_not_exist_meet_their_nearest_ones() -> None:
    assert known(["rail", "Cart"], "cart") == "'rail', 'Cart'; did you mean 'Cart'?"
    assert known(["rail", "Cart"], "wing") == "'rail', 'Cart'" and known(["Cart"], "cart") == "'Cart'" and known([]) == "none"
    assert known([f"rope {k}" for k in range(20)], "roap 17").endswith("'rope 11', ...; did you mean 'rope 17'?")
    beads = [fb.PointMass(f"bead {name}", mass=0.1) for name in ("Front", "Rear")]
    sliders = [fb.Slider(bead.name[5:], bead, ROD, at=0.3 + 0.3 * k) for k, bead in enumerate(beads)]
    loads = [fb.Load(name, ROD.end, force=(0, 0, -0.01)) for name in ("Push", "Shake")]
    model = fb.compile_scene(fb.Scene(ROD, *beads, *sliders, *loads, fb.Clamp(ROD.start)))
    run = fb.simulate(model, t_end=2e-3, step=1e-3, points={"Tip": ROD.end, "Middle": ROD.at(0.5)}, progress=False)
    calls = ((lambda: fb.solve_static(model, held=["front"]), "'front'", "'Front', 'Rear'; did you mean 'Front'"),
             (lambda: fb.frequency_response(model, [1.0], held=True, load_factor=0.0, loads={"push": 1j}), "'push'",
              "'Push', 'Shake'; did you mean 'Push'"),
             (lambda: fb.find_lengths(model, ["road"], {"Front": 0.3}, held=True), "'road'", "its beams are 'rod'"),
             (lambda: fb.find_lengths(model, ["rod"], {("tip", "z"): 0.0}, held=True, points={"Tip": ROD.end, "top": ROD.end}),
              "'tip'", "'Tip', 'top'; did you mean 'Tip'"),
             (lambda: run.point("tip"), "'tip'", "'Middle', 'Tip'; did you mean 'Tip'"),
             (lambda: run.slider("reer"), "'reer'", "'Front', 'Rear'; did you mean 'Rear'"))
    for call, value, there in calls:
        with pytest.raises(fb.SceneError) as error:
            call()
        assert value in str(error.value) and there in str(error.value)


def test_only_slips_of_the_pen_are_guessed() -> None:
    assert instead("hight", ["height", "width"]) == "; did you mean height?"
    assert instead("elemets", ["elements", "section"]) == "; did you mean elements?"
    # these were taken for one another by their letters
    for word, names_of_call in (("angular_velocity", ["velocity", "mass"]), ("orientation", ["position", "mass"]),
                                ("direction", ["friction", "stops"]), ("n_modes", ["model", "state"])):
        assert instead(word, names_of_call) == f"; it takes {', '.join(names_of_call)}"
    assert all("limits.md" in instead(word, ["name"]) for word in ABSENT)
