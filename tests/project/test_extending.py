"""The page on terms from outside: its code runs in a module outside the package and does what fastbeam's own spring
does; misuse is told; the cache notices edits."""
from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pytest

import fastbeam as fb
from fastbeam import extend
from fastbeam.compile import links
from fastbeam.kernels.forces.spring import Springs, assemble_springs
from fastbeam.kernels.jit import decorators as _jit
from fastbeam.kernels.jit import sources as _outside

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
COMPARE = """
import json, sys
import numpy as np
import fastbeam as fb
from fastbeam.kernels.jit import decorators as _jit
from my_spring import MySpring

BAR = fb.Section.circle(radius=0.01, E=1e8, rho=1000.0)


def pendulum(spring, flat=False):
    anchor = fb.PointMass("anchor", mass=1.0, position=(0, 0, 0))
    bob = fb.PointMass("bob", mass=2.0, position=(0, 0, -1.0), velocity=(0.3, 0.0 if flat else 0.1, 0.0))
    body = fb.RigidBody("body", mass=1.0, inertia=(0.1, 0.2, 0.3), position=(0.5, 0, -2))
    return fb.Scene(anchor, bob, body, fb.Clamp(anchor), spring(anchor, bob, "a", stiffness=200.0, length=0.7),
                    spring(bob, body.point((0.1, 0.0 if flat else 0.1, 0)), "b", stiffness=90.0), gravity=(0, 0, -9.81))


def held(spring):
    beam = fb.Beam.straight("b", (0, 0, 0), (1, 0, 0), section=BAR, elements=4)
    ground = fb.PointMass("ground", mass=1.0, position=(1, 1, 0))
    return fb.Scene(beam, ground, fb.Clamp(beam.start), fb.Clamp(ground), spring(beam.end, ground, stiffness=3.0, length=0.9),
                    fb.Load("f", beam.end, force=(0, 1e-4, 2e-4)))


def differences(build, run):
    (a, b), names = [run(fb.compile_scene(build(spring))) for spring in (fb.Spring, MySpring)], ("strain", "total")
    return [float(np.max(np.abs(x - y))) for x, y in [(a.state.q, b.state.q), *((a.series[n], b.series[n]) for n in names)]]


def moved(**options):
    return lambda model: fb.simulate(model, t_end=0.2, step=0.01, progress=False, **options)


RUNS = {"space": lambda: differences(pendulum, moved()),
        "plane": lambda: differences(lambda spring: pendulum(spring, True), moved()),
        "midpoint": lambda: differences(pendulum, moved(method="midpoint")),
        "statics": lambda: differences(held, fb.solve_static)}
planes = [fb.compile_scene(pendulum(MySpring, flat)).plane is not None for flat in (False, True)]
print(json.dumps([planes, {name: RUNS[name]() for name in sys.argv[1:]}, _jit.compile_counts()[1]]))
"""


def write_page(folder: Path) -> None:
    """The code of the page, in the files that its first lines name."""
    files: dict[str, str] = {}
    for code in re.findall(r"```python\n(.*?)```", PAGE, re.S):
        name = code.split("\n", 1)[0].removeprefix("# ")
        files[name] = files.get(name, "") + code
    assert sorted(files) == ["my_law.py", "my_rod.py", "my_spring.py", "use.py", "use_law.py", "use_rod.py"]
    for name, code in files.items():
        (folder / name).write_text(code)


def python(folder: Path, *arguments: str, **environment: str) -> Any:
    """Run Python in a fresh process, with the modules of a folder; what it prints last, from JSON."""
    paths = os.pathsep.join((str(ROOT / "src"), str(folder)))
    done = subprocess.run([sys.executable, "-W", "error", "-W", "ignore::UserWarning", *arguments], capture_output=True,
                          text=True, check=False, timeout=400,
                          env={**os.environ, "PYTHONPATH": paths, "FASTBEAM_PROGRESS": "0", **environment})
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1]) if done.stdout else None


@pytest.mark.parametrize("name", ["use", "use_rod", "use_law"])
def test_code_of_the_page_runs(tmp_path: Path, name: str) -> None:
    write_page(tmp_path)
    assert python(tmp_path, str(tmp_path / f"{name}.py")) is None


RODS = """
import json, sys
import numpy as np
import fastbeam as fb
from my_rod import MyRod

SOFT = fb.Section.circle(radius=0.01, E=1e8, rho=1000.0)


def swing(rod, flat):
    beam = fb.Beam.straight("b", (0, 0, 0), (1, 0, 0), section=SOFT, elements=3)
    bob = fb.RigidBody("bob", mass=2.0, inertia=(0.1, 0.2, 0.3), position=(1.2, 0, -0.8), velocity=(0, 0.0 if flat else 0.4, 0))
    mass = fb.PointMass("mass", mass=0.3, position=(1.5, 0, -1.2))
    return fb.Scene(beam, bob, mass, fb.Clamp(beam.start), rod(beam.end, bob.point((0, 0, 0.1)), "one"), rod(bob, mass, "two"),
                    gravity=(0, 0, -9.81), project_velocities=True)


def both(find):
    return [float(np.max(np.abs(np.asarray(x) - y))) for x, y in zip(*(find(kind) for kind in (fb.DistanceJoint, MyRod)))]


def run(flat):
    def found(kind):
        result = fb.simulate(fb.compile_scene(swing(kind, flat)), t_end=0.2, step=0.01, progress=False,
                             observe=("energy", "reaction"))
        return result.state.q, result.series["total"], result.reaction("one")["force"], result.reaction("two")["force"]
    return found


def rest(kind):
    model = fb.compile_scene(swing(kind, True))
    result = fb.solve_static(model)
    return result.state.q, fb.modes(model, state=result.state, n=4).frequencies


print(json.dumps([both({"space": run(False), "plane": run(True), "rest": rest}[name]) for name in sys.argv[1:]]))
"""


def test_rod_from_outside_is_that_of_the_package(tmp_path: Path) -> None:
    write_page(tmp_path)
    for found in python(tmp_path, "-c", RODS, "space", "plane", "rest"):
        assert np.max(found) < 1e-9, found


@pytest.mark.usefixtures("registry")
def test_gaps_that_are_none_are_refused() -> None:
    for gap, text in ((lambda part, x, start: [1.0], "its gap is .* at t = 0, and has to be 0"),
                      (lambda part, x, start: ["a"], "its gap must return from 1 to 6 numbers"),
                      (lambda part, x, start: [abs(x[1, 0, 0] - start[1, 0, 0])], "the derivative of its gap by complex"),
                      (lambda part, x, start: [abs(x[1, 0, 0]) - 1.0], "write it without abs, norm, conj and real")):
        links.REGISTRY[:] = [entry for entry in links.REGISTRY if entry.noun is not Tie]
        extend.register_link(Tie, Ties, gap)
        with pytest.raises(fb.SceneError, match=text):
            fb.compile_scene(scene())
    links.REGISTRY[:] = [entry for entry in links.REGISTRY if entry.noun is not Tie]
    with pytest.raises(TypeError, match="the gap of Tie must be a function of"):
        extend.register_link(Tie, Ties, 3.0)


@pytest.mark.parametrize("names", [["space", "plane"], pytest.param(["midpoint", "statics"], marks=pytest.mark.slow)])
def test_spring_from_outside_is_that_of_the_package(tmp_path: Path, names: list[str]) -> None:
    write_page(tmp_path)
    planes, found, _ = python(tmp_path, "-c", COMPARE, *names)
    assert planes == [False, True]
    # both energies are of the order of 100 J, coordinates of 1 m
    for name in names:
        assert np.max(found[name][0]) < 1e-12 and np.max(found[name][1:]) < 1e-11, found


def test_edit_outside_is_noticed_and_what_did_not_change_is_kept(tmp_path: Path) -> None:
    write_page(tmp_path)
    python(tmp_path, "-c", COMPARE, "space")
    assert python(tmp_path, "-c", COMPARE, "space")[2] == 0
    module = tmp_path / "my_spring.py"
    edited = module.read_text().replace("        c = springs.stiffness[k]\n", "        c = 2.0 * springs.stiffness[k]\n")
    assert edited != module.read_text()
    before = module.stat()
    module.write_text(edited)
    # as an edit that keeps the time of the file
    os.utime(module, ns=(before.st_atime_ns, before.st_mtime_ns))
    _, found, _ = python(tmp_path, "-c", COMPARE, "space")
    assert found["space"][0] > 1e-3


# ------------------------------------------------------------------------------------------------------------- the cache
FAR = """
from typing import NamedTuple
import numpy as np
class Table(NamedTuple):
    x: np.ndarray
"""
CODE = """
from fastbeam.kernels.jit.generic import generic
from fastbeam.kernels.jit.decorators import kernel
import factors
import table

@generic
def value(term):
    "A number."

@value.register(table.Table)
@kernel
def value_of_table(term):
    return factors.scaled(term.x[0])

@kernel
def twice(terms):
    return 2.0 * value.call(terms[0])

@kernel
def whole(terms):
    return twice(terms)
"""
FACTORS = """
from fastbeam.kernels.jit.decorators import kernel
FACTOR = 3.0

@kernel
def scaled(x):
    return FACTOR * x
"""
CALL = """
import json
import numpy as np
import code_of_table, table
from fastbeam.kernels.jit import decorators as _jit
from fastbeam.kernels.jit import background as _background
import numba
part = code_of_table.twice.part
terms = (table.Table(np.ones(1)),)
_background.start(_background.missing([(code_of_table.twice, (numba.typeof(terms),))]), _jit._FOLDER)
value = code_of_table.whole(terms)
print(json.dumps([value, len(part.loaded), len(part.missed), _jit.compile_counts()[1]]))
"""


def write_table(folder: Path, factor: float = 3.0) -> None:
    for name, text in (("table", FAR), ("code_of_table", CODE), ("factors", FACTORS.replace("3.0", str(factor)))):
        (folder / f"{name}.py").write_text(text)


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity") or len(os.sched_getaffinity(0)) < 2, reason="needs two processors")
def test_second_process_imports_what_its_parts_need(tmp_path: Path) -> None:
    # the class alone, which the types name, brings no implementation along
    write_table(tmp_path)
    assert python(tmp_path, "-c", CALL, FASTBEAM_CACHE_DIR=str(tmp_path / "cache"))[:3] == [6.0, 1, 0]


def test_edit_in_a_file_that_an_implementation_calls_is_noticed(tmp_path: Path) -> None:
    write_table(tmp_path)
    environment = {"FASTBEAM_CACHE_DIR": str(tmp_path / "cache")}
    assert python(tmp_path, "-c", CALL, **environment)[0] == 6.0
    assert python(tmp_path, "-c", CALL, **environment)[::3] == [6.0, 0]
    write_table(tmp_path, 5.0)
    assert python(tmp_path, "-c", CALL, **environment)[0] == 10.0
    write_table(tmp_path)
    assert python(tmp_path, "-c", CALL, **environment)[::3] == [6.0, 0]


def test_program_itself_and_what_stands_in_no_file_is_not_kept() -> None:
    class Here(NamedTuple):
        x: np.ndarray

    class OfTypes:
        instance_class = Here

    assert _outside.digest(extend.kernel, [OfTypes]) not in ("", None)
    Here.__module__ = "__main__"
    assert _outside.modules([OfTypes]) == ["__main__"]
    _outside._text.cache_clear()
    assert _outside.digest(extend.kernel, [OfTypes]) is None
    assert _outside.digest(extend.kernel, [int]) == ""


# ---------------------------------------------------------------------------------------------------------------- misuse
@extend.checked(a=extend.Node(), b=extend.Node(), name=extend.Name(), stiffness=extend.Number(least=0.0))
@dataclass(frozen=True, eq=False)
class Tie(extend.Link):
    kind: ClassVar[str] = "tie"
    _: KW_ONLY
    stiffness: float


class Ties(NamedTuple):
    stiffness: np.ndarray


def scene() -> fb.Scene:
    a, b = fb.PointMass("a", mass=1.0, position=(0, 0, 0)), fb.PointMass("b", mass=1.0, position=(1, 0, 0))
    return fb.Scene(a, b, Tie(a, b, stiffness=1.0))


@pytest.fixture
def registry(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(links, "REGISTRY", [*links.REGISTRY])


def test_noun_checks_its_arguments() -> None:
    a, b = fb.PointMass("a", mass=1.0, position=(0, 0, 0)), fb.PointMass("b", mass=1.0, position=(1, 0, 0))
    with pytest.raises(fb.SceneError, match="stiffness"):
        Tie(a, b, stiffness=-1.0)
    with pytest.raises(fb.SceneError, match="tie: both sides are point mass 'a'"):
        Tie(a, a, stiffness=1.0)


def test_noun_that_is_not_registered_is_refused() -> None:
    with pytest.raises(fb.SceneError, match=r"tie of .*: Tie is not registered; call fastbeam.extend.register_link\(Tie"):
        fb.compile_scene(scene())


@pytest.mark.parametrize(("table", "text"), [
    (lambda ends: [1.0], "the table of Tie must be a named tuple of arrays, got list"),
    (lambda ends: Ties(np.ones((4, 2))[:, 0]), r"the table of Tie: stiffness must be a C-contiguous array of float64 or int64, "
                                               r"got an array of float64, shape \(4,\)"),
    (lambda ends: Ties(np.ones(1, np.float32)), "stiffness must be .* got an array of float32"),
    (lambda ends: Ties(1.0), "stiffness must be a C-contiguous array of float64 or int64, got float"),
    (lambda ends: Ties(np.ones(1)), "Ties has no assemble function; import the module")])
@pytest.mark.usefixtures("registry")
def test_table_that_kernels_cannot_take_is_refused(table: Any, text: str) -> None:
    extend.register_link(Tie, table)
    with pytest.raises(TypeError, match=text):
        fb.compile_scene(scene())


@pytest.mark.usefixtures("registry")
def test_what_is_no_link_is_not_registered() -> None:
    class Nameless(extend.Link):
        pass

    for noun, text in ((fb.PointMass, "must be a class derived from Link"), (extend.Link, "must be a class"),
                       (3, "must be a class"),
                       (Nameless, "Nameless.kind must be a text for messages, got 'link'")):
        with pytest.raises(TypeError, match=text):
            extend.register_link(noun, Ties)
    with pytest.raises(TypeError, match="the table of Tie must be a function of Ends, got None"):
        extend.register_link(Tie, None)
    extend.register_link(Tie, Ties)
    with pytest.raises(TypeError, match="Tie is registered already"):
        extend.register_link(Tie, Ties)


def test_what_is_no_implementation_is_refused() -> None:
    def plain(term: Any, method: Any, system: Any, h: float) -> None:
        pass

    before = dict(extend.assemble.implementations)
    with pytest.raises(TypeError, match="plain is no kernel; write @kernel below @assemble.register"):
        extend.assemble.register(Ties)(plain)
    compiled = extend.kernel(plain)
    for classes in ((), (Springs,), (object,), (Springs, extend.Conserving)):
        with pytest.raises(TypeError, match="none of these is a named tuple of your own"):
            extend.assemble.register(*classes)(compiled)
    _jit.KERNELS.remove(compiled)
    assert extend.assemble.implementations == before
    assert extend.assemble.find((_Typed(Springs), _Typed(extend.Conserving))) is assemble_springs


class _Typed:
    """A type of a named tuple as a compiler has it."""

    def __init__(self, of: type) -> None:
        self.instance_class = of


def test_implementation_after_the_first_compilation_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    class Late(NamedTuple):
        x: np.ndarray

    monkeypatch.setattr(_outside, "_IMPLEMENTATIONS", {})
    assert extend.potential_energy.find((_Typed(Late),)) is None
    compiled = extend.kernel(lambda term, q, dofs, out: None)
    with pytest.raises(TypeError, match="kernels for Late have been compiled without it"):
        extend.potential_energy.register(Late)(compiled)
    extend.potential_energy._asked.discard(Late)
    monkeypatch.setattr(extend.potential_energy, "implementations", dict(extend.potential_energy.implementations))
    extend.potential_energy.register(Late)(compiled)
    with pytest.raises(TypeError, match="there is an implementation for Late already"):
        extend.potential_energy.register(Late)(compiled)
    _jit.KERNELS.remove(compiled)
