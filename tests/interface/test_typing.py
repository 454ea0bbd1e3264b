"""What editors and type checkers see: every public name, every argument."""
from __future__ import annotations

import ast
import importlib
import inspect
import json
import os
import re
import subprocess
import sys
import typing
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.gradients.adjoint import AdjointRun, RunGradient, RunSectionGradient, RunSliderGradient
from fastbeam.gradients.critical_load_slopes import CriticalSlopes
from fastbeam.gradients.equilibria import Gradient, Sensitivity
from fastbeam.gradients.section_gradient import SectionGradient
from fastbeam.interface.lazy_import import names_of
from fastbeam.model.model import Model
from fastbeam.results.mode_shapes import DampedModes, Modes, SteadyModes
from fastbeam.results.observe.resultants import SectionForces
from fastbeam.results.responses import FrequencyResponse

ROOT = Path(__file__).resolve().parents[2]
IDIOMS = """
import numpy as np
import fastbeam as fb

rubber = fb.Section.circle(radius=0.02, E=1e6, rho=1000.0)
rod = fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=rubber, elements=12)
graded = fb.Beam.straight("graded", [2, 0, 0], np.zeros(3), section=rubber, elements=[0.0, 0.5, 2.0], degree=2)
bead = fb.PointMass("bead", mass=0.5)
block = fb.RigidBody("block", mass=40.0, inertia=(2.0, 1.2, 1.6), position=(2, 0, 0))
scene = fb.Scene(rod, bead, fb.Slider("contact", bead, rod, at=0.8, rate=0.5), fb.Clamp(rod.start), fb.Pin(block),
                 fb.Load("pull", rod.end, force=(0, 0, 1), time=lambda t: 2.0 * t), gravity=(0, 0, -9.81), name="bead")
scene.add(block, fb.RigidConnection(rod.end, block), fb.Spring(rod.end, block, stiffness=3.0))
model = fb.compile_scene(scene)
result = fb.simulate(model, t_end=1.5, step=2e-3, points={"tip": rod.end, "middle": (rod, 1.0)},
                     callback=lambda t, state: t > 1.0)
drift: float = result.drift("total")
force: np.ndarray = result.slider("contact")["force"]
fb.plot_overview(result).savefig("first.png")
result.to_vtk("run.vtkhdf", surface=True)
fb.animate(result, "run.gif", speed=0.1)
again = fb.simulate(model, start=fb.Start(result.state, time=1.5), t_end=2.0, step=1e-3)
more = fb.simulate(model, start=result.checkpoint, t_end=2.0, step=1e-3, output="run.h5", solver=fb.Solver(threads=1))
rest = fb.solve_static(model, levels=(0.25, 1.0), held=("contact",))
def case(a: int) -> int:
    return a + 1


table = fb.sweep(case, {"a": [1, 2]}, workers=1)
first: dict[str, object] = table[0]
net = fb.Net("roof", np.zeros((3, 3)), [(0, 1), (1, 2)], section=[rubber, rubber], section_of=[0, 1], joints="ball", pins=[0])
lift = fb.Slider("lift", bead, net.beam(0), at=0.4)
rope = fb.Path("rope", [rod, (graded, -1)], closed=True)
hinge = fb.RevoluteJoint(fb.GROUND, block, "hinge", axis=(0, 1, 0), torque=lambda t: 2.0 * t)
result.to_vtk("run.vtkhdf", sections={"rod": fb.section_forces(model, result, rod)})
ride = fb.Slider("ride", bead, on=rope, at=1.0, friction=0.2, drive=fb.Drive(speed=0.5), stops=fb.Stops(0.5, 3.0))
"""
MISTAKES = """
import fastbeam as fb
rubber = fb.Section.circle(radius="wide", E=1e6, rho=1.0)
beem = fb.Beem("x")
rod = fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), elements=3)
rod = fb.Beam.straight("rod", (0, 0, 0), (2, 0, 0), section=rubber, elements=3, elemets=4)
run = fb.simulate(rod, t_end=1.0, step=1.0)
load = fb.Load("l", rod.end, forces=(0, 0, 1))
bead = fb.Slider("s", "bead", rod, at=0.5)
hold = fb.Clamp(rod, until="later")
body = fb.RigidBody("b", mass=1.0, inertia=rod, position=(0, 0, 0))
way = fb.Path("p", [rod.end])
rest = fb.solve_static(fb.compile_scene(fb.Scene(rod)), points={"tip": 3.0})
size: str = body.inertia
"""
FORMS = ROOT / "tests" / "typed_forms.py"


def test_editors_are_told_every_public_name_from_where_it_is() -> None:
    # the door and its packages read the stubs that editors and type checkers read
    told = names_of("fastbeam")
    assert set(told) | {"__version__"} == set(fb.__all__)
    assert [name for name, module in told.items() if getattr(import_module(module), name) is not getattr(fb, name)] == []


def test_help_lists_every_argument() -> None:
    hidden = []
    for name in fb.__all__:
        thing = getattr(fb, name)
        if inspect.isclass(thing) and issubclass(thing, BaseException):
            continue
        calls = {name: thing} | ({f"{name}.{x}": y for x, y in inspect.getmembers(thing, callable) if not x.startswith("_")}
                                 if inspect.isclass(thing) else {})
        for label, call in calls.items():
            if callable(call):
                kinds = [p.kind for p in inspect.signature(call).parameters.values()]
                hidden += [label] * (inspect.Parameter.VAR_KEYWORD in kinds)
    assert hidden == []
    arguments = inspect.signature(fb.Beam.arc).parameters
    assert list(arguments)[-8:] == ["section", "elements", "degree", "interpolation", "directors", "strain", "prestrain",
                                    "prestress"]
    assert arguments["degree"].default == 3 and arguments["section"].default is inspect.Parameter.empty


def checked(*files: Path) -> str:
    pytest.importorskip("mypy")
    done = subprocess.run([sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", "--cache-dir", os.devnull,
                           *map(str, files)], cwd=files[0].parent, env={**os.environ, "MYPYPATH": str(ROOT / "src")},
                          capture_output=True, text=True, check=False)
    return done.stdout


@pytest.mark.slow  # mypy reads numpy
def test_idioms_examples_and_the_program_of_the_readme_pass_a_type_checker_which_finds_mistakes(tmp_path: Path) -> None:
    program, = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.DOTALL)
    (tmp_path / "readme.py").write_text(program)
    (tmp_path / "idioms.py").write_text(IDIOMS)
    (tmp_path / "mistakes.py").write_text(MISTAKES)
    said = checked(*(tmp_path / f"{name}.py" for name in ("readme", "idioms", "mistakes")), FORMS,
                   *sorted((ROOT / "examples").glob("*.py")))
    wrong = [line for line in said.splitlines() if ": error:" in line]
    assert [line for line in wrong if not line.startswith("mistakes.py:")] == [], said
    assert {int(line.split(":")[1]) for line in wrong} == set(range(3, 15)), said
    assert f"Found {len(wrong)} errors in 1 file (checked 11 source files)" in said, said


@pytest.mark.slow  # pyright reads numpy and matplotlib
def test_idioms_examples_and_the_program_of_the_readme_are_strict_for_pyright(tmp_path: Path) -> None:
    pytest.importorskip("pyright")
    program, = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.DOTALL)
    (tmp_path / "readme.py").write_text(program)
    (tmp_path / "idioms.py").write_text(IDIOMS)
    for example in (FORMS, *(ROOT / "examples").glob("*.py")):
        (tmp_path / example.name).write_text(example.read_text(encoding="utf-8"), encoding="utf-8")
    # matplotlib leaves keywords of its methods open
    settings = {"typeCheckingMode": "strict", "extraPaths": [str(ROOT / "src")], "reportUnknownMemberType": "none"}
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(settings))
    done = subprocess.run([sys.executable, "-m", "pyright", "--pythonpath", sys.executable], cwd=tmp_path, capture_output=True,
                          text=True, check=False)
    if not re.search(r"\d+ errors?,", done.stdout):
        pytest.skip("pyright could not be fetched from its registry")
    assert done.returncode == 0, done.stdout


# --- no argument and no result is anything ---------------------------------------------------------------------------------
@cache
def for_checkers(module: str) -> dict[str, Any]:
    """What the annotations of a module mean: its names, and those that it imports for type checkers alone."""
    names = dict(vars(sys.modules[module]))
    tree = ast.parse(Path(str(sys.modules[module].__file__)).read_text(encoding="utf-8"))
    for block in tree.body:
        if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING":
            for node in block.body:
                if isinstance(node, ast.ImportFrom):
                    home = importlib.import_module("." * node.level + (node.module or ""), module.rpartition(".")[0])
                    names |= {alias.name: getattr(home, alias.name) for alias in node.names}
    # numpy's own, which holds any kind of number inside
    return names | {"ArrayLike": np.ndarray}


def is_anything(kind: object, names: dict[str, Any]) -> bool:
    """Whether a type is Any, or holds it, behind any alias."""
    if isinstance(kind, typing.ForwardRef):
        kind = kind.__forward_arg__
    if isinstance(kind, str):
        kind = eval(kind, names)
    if isinstance(kind, list):
        return any(is_anything(x, names) for x in kind)
    return kind is Any or any(is_anything(x, names) for x in typing.get_args(kind))


def public_calls() -> dict[str, Any]:
    """All public calls, and those of what they return."""
    out: dict[str, Any] = {}
    made = (AdjointRun, fb.BucklingModes, CriticalSlopes, DampedModes, FrequencyResponse, Gradient, Model, Modes, RunGradient,
            RunSectionGradient, RunSliderGradient, SectionForces, SectionGradient, Sensitivity, SteadyModes)
    todo = [(name, getattr(fb, name)) for name in fb.__all__ if name != "__version__"]
    for name, thing in dict([*todo, *((x.__name__, x) for x in made)]).items():
        if thing not in made:
            out[name] = thing
        if inspect.isclass(thing):
            for x, y in inspect.getmembers(thing):
                if x.startswith("_") and x not in ("__call__", "__getitem__", "__iter__"):
                    continue
                y = y.fget if isinstance(y, property) else y
                if callable(y) and not inspect.isclass(y):
                    out[f"{name}.{x}"] = y
    return out


def test_public_signatures_say_what_they_take_and_give() -> None:
    found, seen = [], 0
    for label, call in public_calls().items():
        try:
            signature = inspect.signature(call)
        except (TypeError, ValueError):
            continue
        homes = [x.__module__ for x in inspect.getmro(call)] if inspect.isclass(call) else [
            getattr(inspect.unwrap(call), "__module__", "")]
        homes = [home for home in homes if home.startswith("fastbeam")]
        if not homes:
            continue
        # aliases name what they lead to by texts
        names: dict[str, Any] = {}
        for home in (*homes, "fastbeam.scene.checks", "fastbeam.scene.switches"):
            names = for_checkers(home) | names
        kinds = {f"{label}({p.name})": p.annotation for p in signature.parameters.values()}
        kinds[label] = signature.return_annotation
        seen += len(kinds)
        found += [what for what, kind in kinds.items() if kind is not inspect.Signature.empty and is_anything(kind, names)]
    assert seen > 800
    assert not found, " ".join(found)


def test_any_is_found_behind_aliases() -> None:
    names = {"Hidden": list[Any], "Any": Any, "np": np, "Callable": Callable}
    assert is_anything("Hidden | None", names) and is_anything("Callable[[Hidden], float]", names)
    assert not is_anything("Callable[[float], np.ndarray] | None", names)


def test_the_forms_that_type_checkers_take_are_taken() -> None:
    text = FORMS.read_text(encoding="utf-8")
    nouns, calls = text.split("model = fb.compile_scene")
    names: dict[str, Any] = {"__name__": "forms"}
    exec(compile(nouns, str(FORMS), "exec"), names)
    assert len(names["scene"].parts) > 20 and "fb.simulate(model" in calls
