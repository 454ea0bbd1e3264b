"""One bad entry in a list, tuple, mapping or state that would do otherwise: refused with a message, not raw, not taken."""
from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_bad_input import (
    ACROSS,
    ARRAYS,
    BEAM,
    MASS,
    NUMBERS,
    PATIENCE,
    RAIL,
    REFUSED,
    SECTION,
    WRONG,
    TooLong,
    _ring,
    bar_of,
    calls,
    either,
    held,
    is_count,
    is_function,
    is_real,
    is_text,
    model,
    one_of,
    result,
    short,
)

import fastbeam as fb
from fastbeam.kernels.state import State

# what stands in place of an entry
BAD = {name: {**NUMBERS, **ARRAYS, **WRONG}[name] for name in (
    "nan", "inf", "-1", "1e308", "10**400", "Decimal nan", "True", "np.True_", "complex", "text", "number as text", "empty",
    "bytes", "None", "none", "2 numbers", "3 numbers", "bools", "ragged", "masked number", "masked", "objects", "NaT", "duration",
    "object", "class", "mapping", "set", "rude", "function", "function that fails", "beam", "node", "mass", "section", "3 nan",
    "0-d array")}
LIFT = fb.PrescribedMotion("lift", BEAM.end, displacement=lambda t: (0.0, 0.0, 0.0))
PART = one_of(fb.Beam, fb.PointMass, fb.RigidBody)
PLACE = one_of(fb.NodeRef, fb.PointMass, fb.RigidBody)
TRACK = one_of(fb.Beam, fb.Path)
A_LOAD = either(is_text, one_of(fb.Load, fb.DistributedLoad))
OPTIONAL = either(lambda x: x is None, is_real, is_function)


@cache
def lifted() -> fb.Model:
    return fb.compile_scene(fb.Scene(BEAM, fb.Clamp(BEAM.start), LIFT), planar=False)


@cache
def bars() -> Any:
    return fb.sensitivity(bar_of, {"L": 2.0})


def plain(state: State) -> State:
    """With lists for arrays."""
    return State(*(x.tolist() for x in state))


def never(value: Any) -> bool:
    """Nothing but what stands there."""
    return False


def anything(value: Any) -> bool:
    """Cases of a sweep are for the user's own function."""
    return True


def is_none(value: Any) -> bool:
    return value is None


def is_float(value: Any) -> bool:
    """What a result holds."""
    return is_real(value) or isinstance(value, float)


def is_row(value: Any) -> bool:
    """A whole row of numbers in place of another."""
    return isinstance(value, (list, tuple)) and len(value) > 1 and all(is_real(x) for x in value)


# calls that take lists of rows
ROWS = ("Beam.through_points", "Net", "force_density")


def containers(folder: Path) -> Iterator[tuple[str, Callable[..., Any], dict[str, Any], str, Any, Callable[[Any], bool]]]:
    """(call, function, other arguments, argument, container that works, what an entry may be)."""
    table = calls(folder)

    def of(call: str, argument: str, good: Any, entry: Callable[[Any], bool], **others: Any) -> Any:
        works = {name: x for name, x in table[call].works.items() if name not in (argument, "drop")} | others
        return call, table[call].function, works, argument, good, entry

    numbers = {
        "Section.from_matrix": ["C"], "Beam.straight": ["start", "end"], "Beam.arc": ["start", "tangent", "normal"],
        "RigidBody": ["inertia", "position"], "force_density": ["nodes", "edges", "pins"], "Net": ["nodes", "edges"],
        "Crossing": ["at"], "Bushing": ["stiffness"], "Load": ["force"], "Beam.through_points": ["points"],
        "Signal": ["times", "values"],
        "GROUND.point": ["position"], "RigidBody.point": ["offset"], "RevoluteJoint": ["axis"], "PlanarJoint": ["normal"],
        "UniversalJoint": ["axis_a", "axis_b"], "DistributedLoad": ["force"], "OneSided": ["side"], "Result": ["t"]}
    goods: dict[tuple[str, str], Any] = {("Load", "force"): (0, 0, 1)}
    for call, names in numbers.items():
        for name in names:
            entry = is_real if call not in ROWS else either(is_real, is_row)
            good = goods.get((call, name), table[call].works.get(name))
            good = good.tolist() if isinstance(good, np.ndarray) else good
            yield of(call, name, good, is_float if call == "Result" else entry)
    yield of("Beam.straight", "elements", [0.0, 0.5, 1.0], is_real)
    yield of("Beam.straight", "d2", [0.0, 1.0, 0.0], is_real)
    yield of("Section.circle", "damping", [0.1] * 6, is_real)
    yield of("RigidBody", "directors", np.eye(3).tolist(), is_real)
    yield of("RigidBody", "inertia", np.eye(3).tolist(), is_real)
    yield of("RigidBody", "spin", [0, 0, 1.0], is_real)
    yield of("PointMass", "velocity", (0, 0, 1.0), is_real)
    yield of("Scene", "gravity", [0, 0, -9.81], is_real, part=BEAM)
    yield of("RigidMotion", "objects", [BEAM, MASS], PART)
    yield of("RigidMotion", "velocity", (0, 0, 1.0), is_real, objects=BEAM)
    yield of("Spring of a table", "table", ([0.0, 1.0], [0.0, 2.0]), either(is_real, is_row))
    yield of("Bushing", "damping", [1.0] * 6, is_real)
    yield of("Bushing", "stiffness", np.eye(6).tolist(), is_real)
    yield of("CylindricalJoint", "stiffness", [1.0, 2.0], is_real)
    yield of("CylindricalJoint", "speed", [1.0, None], OPTIONAL)
    yield of("CylindricalJoint", "stops", [fb.Stops(-1.0, 1.0), None], either(lambda x: x is None, one_of(fb.Stops)))
    yield of("UniversalJoint", "torque", [1.0, lambda t: t], OPTIONAL)
    yield of("Path", "beams", [BEAM, RAIL], TRACK)
    yield of("Path", "beams", [BEAM, (RAIL, -1)], either(TRACK, is_real))
    yield of("Switch", "tracks", [BEAM, RAIL], TRACK)
    yield of("Crossing", "friction", (0.1, 0.2), either(is_real, is_none), beam_b=ACROSS)
    yield of("Slider", "lock", [fb.Lock(1.0, until=2.0), fb.Lock(3.0)], one_of(fb.Lock))
    yield of("Slider", "one_sided", [0.0, 0.0, 1.0], is_real)
    yield of("Sleeve", "axis", [1.0, 0.0, 0.0], is_real)
    yield of("Drag", "air", [1.0, 0.0, 0.0], is_real)
    yield of("UserForce", "parameters", [1.0, 2.0], is_real)
    yield of("LineForce", "parameters", [1.0, 2.0], is_real)
    yield of("Controller", "memory", [1.0, 2.0], is_real)
    yield of("MovingMesh", "sliders", [fb.Slider("m", MASS, RAIL, at=1.0)], one_of(fb.Slider))
    for name, good, entry in (
            ("section", [SECTION, SECTION], one_of(fb.Section)), ("section_of", [0, 1], is_count), ("elements", [1, 2], is_count),
            ("prestrain", [0.0, 0.1], is_real), ("prestress", [0.0, 0.1], is_real),
            ("d2", [[0, 0, 1.0]] * 2, either(is_real, is_row)),
            ("joints", ["rigid", "ball", "ball"], is_text), ("pins", [0, 1], is_count), ("clamps", [0, 1], is_count),
            ("masses", [0.0, 1.0, 0.0], is_real), ("loads", [[0, 0, 1.0]] * 3, either(is_real, is_row)),
            ("velocity", [[0, 0, 1.0]] * 3, either(is_real, is_row))):
        yield of("Net", name, good, entry, **({"section": [SECTION, SECTION]} if name == "section_of" else
                                              {"section_of": [0, 1]} if name == "section" else {}))
    yield of("force_density", "densities", [1.0, 2.0], is_real)
    yield of("force_density", "loads", [[0, 0, 1.0]] * 3, either(is_real, is_row))
    # runs
    point = dict(points={"tip": BEAM.end, "middle": (BEAM, 1.0)})
    for call in ("simulate", "solve_static", "solve_path", "relax"):
        yield of(call, "points", point["points"], either(PLACE, is_real, TRACK))
        yield of(call, "observe", ["energy", "momentum"], is_text)
    for call, of_model in (("simulate", model()), ("solve_static", held()), ("solve_path", held()), ("relax", held()),
                           ("adjoint_run", held())):
        yield of(call, "start", plain(of_model.state()), is_real)
    yield of("modes", "state", plain(held().state()), is_real, load_factor=0.0)
    yield of("section_forces", "shapes", plain(model().state()), is_real)
    yield of("solve_static", "levels", [0.5, 1.0], is_real)
    yield of("stick_interval", "within", [0.0, 1.0], is_real)
    for call in ("solve_path", "critical_loads"):
        yield of(call, "moves", {LIFT: (0.0, 0.0, 0.01)}, either(is_real, is_row), model=lifted())
        yield of(call, "prestrains", {BEAM: 0.01}, is_real, model=lifted())
    yield of("solve_path", "stop", {("tip", "z"): -0.1}, is_real, points={"tip": BEAM.end})
    yield of("Travel", "speeds", {BEAM: 1.0}, is_real)
    yield of("frequency_response", "frequencies", [3.0, 4.0], is_real)
    yield of("frequency_response", "base", [1.0, 0.0, 1.0], either(is_real, one_of(complex)))
    yield of("frequency_response", "loads", [fb.Load("push", BEAM.end, force=(0, 0, 1))], A_LOAD, base=None)
    yield of("frequency_response", "loads", {fb.Load("push", BEAM.end, force=(0, 0, 1)): 1.0}, either(is_real, one_of(complex)),
             base=None)
    yield of("sensitivity", "values", {"L": 2.0}, is_real, build=bar_of)
    yield of("sensitivity", "scale", {"L": 2.0}, is_real, build=bar_of, values={"L": 2.0})
    yield of("Sensitivity.gradient", "points", {"tip": [0.0, 0.0, 1.0]}, either(is_real, is_row))
    yield of("AdjointRun.gradient", "points", {"tip": [0.0, 0.0, 1.0]}, either(is_real, is_row))
    yield of("AdjointRun.gradient", "velocities", {"tip": [[0.0, 0.0, 1.0]] * len(short().t)}, either(is_real, is_row),
             points=None)
    yield of("Result.to_vtk", "sections", {"boom": fb.section_forces(model(), result(), BEAM)}, never)
    yield of("sweep", "cases", [{"a": 1}, {"a": 2}], anything)
    yield of("Scene.add", "part", RAIL, PART)


def spoiled(good: Any, bad: Any) -> Iterator[Any]:
    """Copies of a container with its first or last entry replaced, at any depth."""
    if isinstance(good, State):
        for name, x in zip(State._fields, good):
            yield from (good._replace(**{name: y}) for y in spoiled(x, bad))
    elif isinstance(good, Mapping):
        for key, x in good.items():
            yield {**good, key: bad}
            yield from ({**good, key: y} for y in spoiled(x, bad))
    elif isinstance(good, (list, tuple)) and good:
        for k in {0, len(good) - 1}:
            put = (lambda y, k=k: type(good)([*good[:k], y, *good[k + 1:]]))
            yield put(bad)
            yield from (put(y) for y in spoiled(good[k], bad))


def went_wrong(function: Callable[..., Any], arguments: dict[str, Any], may: bool) -> str:
    """'' where a call is refused, or taken where it may be."""
    signal.setitimer(signal.ITIMER_REAL, PATIENCE)
    try:
        function(**arguments)
    except REFUSED as refused:
        return "" if len(str(refused)) > 20 else f"says only {refused}"
    except TooLong:
        return "hangs"
    except Exception as error:
        return f"raw {type(error).__name__}: {str(error)[:80]}"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    return "" if may else "taken"


@pytest.mark.filterwarnings("ignore:.*masked element:UserWarning", "ignore:overflow:RuntimeWarning")
def test_no_bad_entry_is_taken_or_ends_in_something_raw(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    before = signal.signal(signal.SIGALRM, _ring)
    wrong: dict[str, str] = {}
    tried = 0
    try:
        for call, function, others, argument, good, entry in containers(tmp_path):
            try:
                function(**{**others, argument: good})
            except Exception as error:
                wrong[f"{call}({argument})"] = f"does not work without a bad entry: {error}"
                continue
            for name, bad in BAD.items():
                for k, value in enumerate(spoiled(good, bad)):
                    tried += 1
                    said = went_wrong(function, {**others, argument: value}, entry(bad))
                    if said:
                        wrong[f"{call}({argument}, {k}: {name})"] = said
    finally:
        signal.signal(signal.SIGALRM, before)
    assert wrong == {}
    assert tried > 5000


@pytest.mark.parametrize("value", [[1.0, True], (1, np.True_), [[0, 1], [True, 2]], [np.array([True, False]), [0, 1]],
                                   [[0.0, np.ma.masked], [1.0, 2.0]], [0.0] * 5000 + [True], [[[0, 1]], [[0, False]]]])
def test_truth_values_and_masked_ones_among_numbers_are_found_at_any_depth(value: Any) -> None:
    from fastbeam.interface.arguments import numbers
    assert numbers(value) is None


def test_numbers_stay_what_they_are() -> None:
    from fastbeam.interface.arguments import numbers
    for value in ([1, 2.5], [[1, 2], [3, 4]], (np.float32(1.0), 2), [np.arange(3), np.zeros(3)], [], [[]], [[], []],
                  [(0, 1), [2, 3]]):
        np.testing.assert_array_equal(numbers(value), np.asarray(value, dtype=float))

