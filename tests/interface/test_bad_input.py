"""Every argument of every public call, fed with what it does not take: refused with a message, not raw, not taken, no hang."""
from __future__ import annotations

import inspect
import os
import random
import signal
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam import __main__ as front
from fastbeam.kernels.state import State
from fastbeam.model.model import Model
from fastbeam.results.mode_shapes import DampedModes, Modes, SteadyModes
from fastbeam.results.responses import FrequencyResponse
from fastbeam.scene.sections import SectionLaw

SECTION = fb.Section.circle(radius=0.02, E=1e6, rho=1000.0)
BEAM = fb.Beam.straight("boom", (0, 0, 0), (2, 0, 0), section=SECTION, elements=2, degree=2)
RAIL = fb.Beam.straight("rail", (0, 1, 0), (2, 1, 0), section=SECTION, elements=2, degree=2)
MASS = fb.PointMass("bead", mass=0.1)
MIDDLE = fb.Slider("middle", MASS, RAIL, at=1.0)
AROUND = fb.Path("around", [BEAM], closed=True)
ACROSS = fb.Beam.straight("across", (1, -1, 0), (1, 1, 0), section=SECTION, elements=2, degree=2)
POINTS = fb.Switch("points", [BEAM, RAIL])
BODY = fb.RigidBody("block", mass=1.0, inertia=(1, 1, 1), position=(2, 0, 0))
NET = fb.Net("roof", [(0, 0, 3), (1, 0, 3), (0, 1, 3)], [(0, 1), (1, 2)], section=SECTION, clamps=[0])
SCENE = fb.Scene(BEAM, RAIL, MASS, BODY, NET, fb.Clamp(BEAM.start), fb.Clamp(RAIL.start), fb.RigidConnection(BEAM.end, BODY),
                 fb.Slider("ride", MASS, RAIL, at=0.5), gravity=(0, 0, -9.81))
# seconds after which a call hangs; some compile for ten on a busy machine
PATIENCE = 60.0


@cache
def model() -> Model:
    return fb.compile_scene(SCENE)


@cache
def held() -> Model:
    return fb.compile_scene(fb.Scene(BEAM, fb.Clamp(BEAM.start), gravity=(0, 0, -0.01)))


@cache
def rubbing() -> Model:
    mass = fb.PointMass("m", mass=0.1)
    return fb.compile_scene(fb.Scene(BEAM, mass, fb.Clamp(BEAM.start), fb.Clamp(BEAM.end),
                                     fb.Slider("s", mass, BEAM, at=0.5, friction=0.5), gravity=(0, 0, -0.01)))


@cache
def result() -> fb.Result:
    return fb.simulate(model(), t_end=2e-3, step=1e-3, progress=False, points={"tip": BEAM.end})


@cache
def modes() -> Modes:
    return fb.modes(held(), load_factor=0.0, n=3)


@cache
def buckling() -> fb.BucklingModes:
    pressed = fb.compile_scene(fb.Scene(BEAM, fb.Clamp(BEAM.start), fb.Clamp(BEAM.end)))
    return fb.critical_loads(pressed, prestrains={BEAM: -0.01}, n=2)


@cache
def damped_modes() -> DampedModes:
    return fb.modes(held(), load_factor=0.0, n=3, damped=True)


@cache
def steady_modes() -> SteadyModes:
    """Of the same beam that turns with its clamp."""
    model, spin = held(), fb.Spin(1.0)
    return fb.modes(model, n=2, steady=spin, state=fb.solve_static(model, steady=spin).state)


@cache
def response() -> FrequencyResponse:
    return fb.frequency_response(held(), [3.0, 4.0], load_factor=0.0, base=(0, 0, 1), points={"tip": BEAM.end}, shapes=True)


class Rude:
    """Fails wherever it is asked."""

    def __float__(self) -> float:
        raise RuntimeError("no")

    def __array__(self, *more: Any, **options: Any) -> Any:
        raise RuntimeError("no")

    def __repr__(self) -> str:
        raise RuntimeError("no")

    def __fspath__(self) -> str:
        raise RuntimeError("no")


NUMBERS: dict[str, Any] = {
    "0": 0, "-1": -1, "3": 3, "2.5": 2.5, "nan": np.nan, "inf": np.inf, "-inf": -np.inf, "1e308": 1e308, "-1e308": -1e308,
    "1e200": 1e200,
    "1e-200": 1e-200, "5e-324": 5e-324, "10**12": 10**12, "10**19": 10**19, "10**400": 10**400, "10**5000": 10**5000,
    "float32 inf": np.float32(np.inf), "Fraction": Fraction(1, 3), "Decimal nan": Decimal("nan"), "0-d array": np.array(0.5)}
ARRAYS: dict[str, Any] = {
    "3 numbers": (1.0, 2.0, 3.0), "3 huge": (1e308, 1e308, 1e308), "3 tiny": (1e-200, 0, 0), "3 nan": [np.nan] * 3,
    "2 numbers": [1, 2], "none": [], "eye": np.eye(3), "-eye": -np.eye(3), "big": np.ones((50, 3)), "flat": np.zeros((3, 0)),
    "increasing": [0.0, 1.0, 2.0], "6 x 6": np.eye(6), "range": range(10**12), "too big": [10**400, 0, 0], "ints": np.arange(3)}
WRONG: dict[str, Any] = {
    "True": True, "np.True_": np.True_, "complex": 1 + 2j, "np.complex": np.complex128(1), "text": "text", "number as text": "3",
    "empty": "", "blank": " ", "bytes": b"3", "texts": ["1", "2", "3"], "bools": [True, False, True],
    "mixed bools": [1.0, True, 0.0],
    "complexes": [1j, 0, 0], "complex array": np.ones(3, complex), "masked": np.ma.array([1.0, 2, 3], mask=[0, 1, 0]),
    "masked number": np.ma.masked, "objects": np.array([object()] * 3), "Nones": [None] * 3, "ragged": [[1, 2], [3]],
    "structure": np.zeros(3, [("a", float)]), "words": np.array(["a", "b", "c"]), "date": np.datetime64("2020-01-01"),
    "duration": np.timedelta64(3, "s"), "object": object(), "Ellipsis": ..., "class": dict, "noun class": fb.Beam, "module": np,
    "mapping": {"a": 1}, "set": {1, 2, 3}, "rude": Rude(), "bytearray": bytearray(b"123"), "NaT": np.datetime64("NaT"),
    "function": lambda: 1.0, "function of t": lambda t: 1.0, "function of s": lambda s: np.zeros((len(s), 3)),
    "function that fails": lambda *a: 1 / 0, "function of texts": lambda *a: "3", "function of nan": lambda *a: np.nan,
    "function of two": lambda t, state: None, "builtin": len, "ufunc": np.sin,
    "zero byte": "a\0b", "long name": "x" * 300, "beam": BEAM, "node": BEAM.end, "mass": MASS, "body": BODY, "net": NET,
    "scene": SCENE, "section": SECTION, "parts": [BEAM, MASS], "foreign beam": fb.Beam.straight(
        "other", (0, 0, 0), (1, 0, 0), section=SECTION, elements=1).end, "clamp": fb.Clamp(BEAM.start), "None": None,
    "drive": fb.Drive(speed=0.1), "stops": fb.Stops(0.1, 0.9), "lock": fb.Lock(1.0), "release": fb.Release(1.0),
    "locks": [fb.Lock(1.0, until=2.0), fb.Lock(3.0)], "one-sided": fb.OneSided((0, 0, 1)),
    "condition": lambda t, s, rate: rate - 1.0,
    "path": AROUND, "executor": ThreadPoolExecutor(1)}


def pool(folder: Path) -> dict[str, Callable[[], Any]]:
    """Values by name; made anew for every call, since generators are used up."""
    pipe = folder / "pipe"
    if not pipe.exists():
        os.mkfifo(pipe)
    more: dict[str, Callable[[], Any]] = {
        "generator": lambda: (x for x in (1.0, 2.0, 3.0)), "generator of texts": lambda: (x for x in "abc"), "pipe": lambda: pipe,
        "folder": lambda: folder, "nowhere": lambda: folder / "none" / "here", "text file": lambda: folder / "text",
        "model": model, "result": result, "modes": modes,
        "state": lambda: model().state(), "checkpoint": lambda: result().checkpoint,
        "state of nan": lambda: model().state()._replace(q=np.full(3, np.nan)),
        "state of texts": lambda: State("q", "v", "s", "f"),
        "state of Nones": lambda: State(None, None, None, None)}
    (folder / "text").write_text("no result")
    return {name: (lambda value=value: value) for name, value in {**NUMBERS, **ARRAYS, **WRONG}.items()} | more


def bar_of(L: float) -> Any:  # noqa: N803
    beam = fb.Beam.straight("boom", (0, 0, 0), (L, 0, 0), section=SECTION, elements=1)
    return fb.Scene(beam, fb.Clamp(beam.start), gravity=(0, 0, -0.01)), {"tip": beam.end}


def held_bar() -> Any:
    return bar_of(2.0)


@cache
def short() -> Any:
    return fb.adjoint_run(held(), t_end=2e-3, step=1e-3, points={"tip": BEAM.end})


@cache
def bars() -> Any:
    return fb.sensitivity(bar_of, {"L": 2.0})


# --- what an argument may be, told apart without the package's own checks ------------------------------------------------
def is_real(x: Any) -> bool:
    if isinstance(x, np.ndarray):
        return x.ndim == 0 and x.dtype.kind in "iuf" and not isinstance(x, np.ma.MaskedArray) and is_real(x[()])
    if isinstance(x, (bool, np.bool_, np.timedelta64)) or not isinstance(x, (int, float, Fraction, Decimal, np.number)):
        return False
    if isinstance(x, (int, np.integer)):
        return abs(x) <= 10**60
    return not isinstance(x, np.complexfloating) and abs(float(x)) <= 1e60


def is_count(x: Any) -> bool:
    return isinstance(x, (int, np.integer)) and not isinstance(x, (bool, np.timedelta64)) and abs(x) < 2**63


def is_array(*shapes: int | None) -> Callable[[Any], bool]:
    def fits(x: Any) -> bool:
        if isinstance(x, range):
            return len(x) < 10**7
        if isinstance(x, np.ndarray):
            return type(x) is np.ndarray and x.dtype.kind in "iuf" and x.ndim in shapes and bool(np.all(np.abs(x) <= 1e60))
        return isinstance(x, (list, tuple)) and all(fits(y) if isinstance(y, (list, tuple)) else is_real(y) for y in x)
    return fits


def is_function(x: Any) -> bool:
    return callable(x) and not isinstance(x, type)


def is_a(kind: type) -> Callable[[Any], bool]:
    return lambda x: isinstance(x, kind)


def among(*values: Any) -> Callable[[Any], bool]:
    return lambda x: any(type(x) is type(value) and x == value for value in values)


def one_of(*kinds: type) -> Callable[[Any], bool]:
    return lambda x: isinstance(x, kinds)


def is_triple(x: Any) -> bool:
    """Three numbers, real or complex, as far as this can be seen from outside."""
    return isinstance(x, (tuple, list, np.ndarray)) and getattr(x, "ndim", 1) > 0 and len(x) == 3


def either(*tests: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda x: any(test(x) for test in tests)


def is_flag(x: Any) -> bool:
    return isinstance(x, (bool, np.bool_))


def is_text(x: Any) -> bool:
    return isinstance(x, str)


def is_list_of(test: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda x: isinstance(x, (list, tuple)) and all(test(y) for y in x)


def is_counts(x: Any) -> bool:
    return isinstance(x, np.ndarray) and not isinstance(x, np.ma.MaskedArray) and x.ndim == 1 and x.dtype.kind in "iu"


def is_series(x: Any) -> bool:
    """What a result may hold: numbers that are not finite, too."""
    if isinstance(x, range):
        return len(x) < 10**7
    if isinstance(x, (list, tuple)):
        return all(is_series(y) for y in x) and len({np.shape(y) for y in x}) <= 1
    x = x if isinstance(x, np.ndarray) else np.array(x) if isinstance(x, (int, float, np.floating)) else None
    return x is not None and not isinstance(x, np.ma.MaskedArray) and x.dtype.kind in "iufb"


VECTOR, NODE = is_array(1), one_of(fb.NodeRef, fb.PointMass, fb.RigidBody)
A_BEAM, A_TRACK, SECTIONS = one_of(fb.Beam), one_of(fb.Beam, fb.Path), one_of(fb.Section)
FIELD, PATH = either(VECTOR, is_function), one_of(str, Path)
CONDITION = either(is_real, is_function, is_text)
LOCKED = dict(lock=either(is_a(fb.Lock), is_list_of(is_a(fb.Lock))), release=is_a(fb.Release),
              one_sided=either(VECTOR, is_a(fb.OneSided)))
STEADY = one_of(fb.Spin, fb.Travel)
OF_TIME = either(is_real, is_function)
HINGE = fb.RevoluteJoint(fb.GROUND, BODY, "hinge of the block", axis=(0, 1, 0))
TABLE = fb.PlanarJoint(fb.GROUND, BODY, "table", normal=(0, 0, 1))
A_JOINT = one_of(fb.RevoluteJoint, fb.PlanarJoint)
IN_JOINT = dict(stiffness=is_real, damping=is_real, rest=is_real, speed=OF_TIME, friction=is_real, stops=is_a(fb.Stops),
                coefficient=is_real, length=is_real, drive=is_a(fb.Drive))


@dataclass
class Call:
    """A public call with arguments that work, and what else each of them may be."""

    function: Callable[..., Any]
    works: dict[str, Any]
    takes: dict[str, Callable[[Any], bool]]


NOTHING = among(None)
SOME_OF_TIME = is_list_of(either(NOTHING, OF_TIME))
IN_EACH = dict(stiffness=VECTOR, damping=VECTOR, rest=VECTOR, friction=VECTOR, speed=SOME_OF_TIME,
               drive=is_list_of(either(NOTHING, is_a(fb.Drive))), stops=is_list_of(either(NOTHING, is_a(fb.Stops))))
SUPPORT = dict(at=NODE, name=is_text, axes=is_text, until=either(is_real, is_function),
               since=either(is_real, is_function))
COMMON = dict(section=SECTIONS, elements=either(is_count, VECTOR), degree=is_count, interpolation=is_text, directors=is_text,
              strain=is_text, prestrain=is_real, prestress=is_real)
BAR = dict(section=SECTION, elements=2)
DAMPING = either(is_real, is_array(1, 2))
MATERIAL = dict(E=is_real, rho=is_real, nu=is_real, G=is_real, shear_factor=is_real, damping=DAMPING, name=is_text)
SIX = dict.fromkeys(("EA", "GA2", "GA3", "GJ", "EI2", "EI3"), is_real)
INERTIA = dict(rhoA=is_real, rhoI2=is_real, rhoI3=is_real, damping=DAMPING, name=is_text)
NODES, EDGES = [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1), (1, 2)]
ROWS = dict(observe=is_list_of(is_text), points=one_of(Mapping))


def calls(folder: Path) -> dict[str, Call]:
    """All public calls by name."""
    ends_at_once = dict(t_end=2e-3, step=1e-3, every=1, progress=False, callback=lambda t, state: True)
    out = {
        "Section": Call(fb.Section, dict.fromkeys(SIX, 1.0) | dict(rhoA=1.0, rhoI2=0.0, rhoI3=0.0),
                        dict(law=one_of(SectionLaw), **SIX, **INERTIA)),
        "Section.with_law": Call(SECTION.with_law, dict(law=SectionLaw()), dict(law=one_of(SectionLaw))),
        "Section.rectangle": Call(fb.Section.rectangle, dict(height=0.1, width=0.2, E=1e6, rho=1e3),
                                  dict(height=is_real, width=is_real, GJ=is_real, **MATERIAL)),
        "Section.circle": Call(fb.Section.circle, dict(radius=0.1, E=1e6, rho=1e3), dict(radius=is_real, **MATERIAL)),
        "Section.tube": Call(fb.Section.tube, dict(radius=0.1, thickness=0.01, E=1e6, rho=1e3),
                             dict(radius=is_real, thickness=is_real, **MATERIAL)),
        "Section.from_matrix": Call(fb.Section.from_matrix, dict(C=np.eye(6), rhoA=1.0, rhoI2=0.0, rhoI3=0.0),
                                    dict(C=is_array(2), **INERTIA)),
        "Beam": Call(fb.Beam, dict(name="b", curve=BEAM.curve, **BAR), dict(name=is_text, curve=A_TRACK, **COMMON)),
        "Beam.straight": Call(fb.Beam.straight, dict(name="b", start=(0, 0, 0), end=(1, 0, 0), **BAR),
                              dict(name=is_text, start=VECTOR, end=VECTOR, d2=VECTOR, twist=is_real, **COMMON)),
        "Beam.arc": Call(fb.Beam.arc, dict(name="b", start=(0, 0, 0), tangent=(1, 0, 0), normal=(0, 1, 0), radius=1.0, angle=1.0,
                                            **BAR),
                         dict(name=is_text, start=VECTOR, tangent=VECTOR, normal=VECTOR, radius=is_real, angle=is_real,
                              **COMMON)),
        "Beam.helix": Call(fb.Beam.helix, dict(name="b", radius=1.0, pitch=0.3, turns=1.0, **BAR),
                           dict(name=is_text, radius=is_real, pitch=is_real, turns=is_real, center=VECTOR, axis=VECTOR,
                                start_direction=VECTOR, **COMMON)),
        "Beam.from_curve": Call(fb.Beam.from_curve, dict(name="b", curve=lambda t: (t, t * t, 0.0), **BAR),
                                dict(name=is_text, curve=is_function, frame=is_function, d2=VECTOR, **COMMON)),
        "Beam.through_points": Call(fb.Beam.through_points, dict(name="b", points=[(0, 0, 0), (1, 0, 0), (2, 1, 0)], **BAR),
                                    dict(name=is_text, points=is_array(2), d2=VECTOR, **COMMON)),
        "Beam.node": Call(BEAM.node, dict(index=0), dict(index=is_count)),
        "Beam.at": Call(BEAM.at, dict(s=0.0), dict(s=is_real)),
        "Beam.nearest": Call(BEAM.nearest, dict(point=(0.5, 1.0, 0.0)), dict(point=VECTOR)),
        "Path.nearest": Call(AROUND.nearest, dict(point=(0.5, 1.0, 0.0)), dict(point=VECTOR)),
        "Beam.reference": Call(BEAM.reference, dict(s=[0.0, 1.0]), dict(s=either(is_real, VECTOR))),
        "NodeRef": Call(fb.NodeRef, dict(owner=BODY), dict(owner=one_of(fb.Beam, fb.PointMass, fb.RigidBody), index=is_count,
                                                           offset=VECTOR)),
        "PointMass": Call(fb.PointMass, dict(name="m", mass=1.0),
                          dict(name=is_text, mass=is_real, position=VECTOR, velocity=VECTOR)),
        "RigidBody": Call(fb.RigidBody, dict(name="m", mass=1.0, inertia=(1, 1, 1), position=(0, 0, 0)),
                          dict(name=is_text, mass=is_real, inertia=is_array(1, 2), position=VECTOR, directors=is_array(2),
                               velocity=VECTOR, spin=VECTOR)),
        "RigidBody.point": Call(BODY.point, dict(offset=(0, 0, 1)), dict(offset=VECTOR)),
        "Clamp": Call(fb.Clamp, dict(at=BEAM.start), SUPPORT),
        "Pin": Call(fb.Pin, dict(at=BEAM.start), SUPPORT),
        "Drag": Call(fb.Drag, dict(name="d", on=BEAM, normal=1.0), dict(
            name=is_text, on=one_of(fb.Beam, fb.Net, fb.PointMass, fb.RigidBody), normal=is_real, tangential=is_real,
            linear=is_real, air=VECTOR, time=is_function, wind=is_function, parameters=VECTOR)),
        "AddedMass": Call(fb.AddedMass, dict(name="w", on=BEAM, normal=1.0), dict(
            name=is_text, on=one_of(fb.Beam, fb.Net, fb.PointMass, fb.RigidBody), normal=is_real, tangential=is_real)),
        "PrescribedMotion": Call(fb.PrescribedMotion, dict(name="p", at=BEAM.start, displacement=lambda t: (t, 0, 0)), dict(
            name=is_text, at=NODE, position=is_function, displacement=is_function, rotation=is_function, axes=is_text,
            until=either(is_real, is_function), since=either(is_real, is_function))),
        **{f"PrescribedMotion.{name}": Call(getattr(fb.PrescribedMotion("p", BEAM.start, displacement=lambda t: (t, 0, 0)), name),
                                            dict(t=0.5), dict(t=is_real)) for name in (
                                                "place", "turn", "turning", "rates")},
        "Signal": Call(fb.Signal, dict(times=np.arange(4.0), values=np.zeros(4)), dict(
            times=VECTOR, values=is_array(1, 2), direction=VECTOR, rest=is_flag, interpolation=is_text)),
        "Signal.from_acceleration": Call(fb.Signal.from_acceleration, dict(times=np.arange(4.0), acceleration=np.zeros(4)), dict(
            times=VECTOR, acceleration=is_array(1, 2), direction=VECTOR, velocity=either(is_real, VECTOR),
            displacement=either(is_real, VECTOR), baseline=is_count)),
        "RigidConnection": Call(fb.RigidConnection, dict(a=BEAM.end, b=BODY), dict(a=NODE, b=NODE, name=is_text)),
        "BallJoint": Call(fb.BallJoint, dict(a=BEAM.end, b=BODY), dict(a=NODE, b=NODE, name=is_text)),
        "GearCoupling": Call(fb.GearCoupling, dict(first=HINGE, second=(TABLE, "angle"), ratio=2.0), dict(
            first=A_JOINT, second=either(A_JOINT, is_list_of(either(A_JOINT, is_text))), name=is_text, ratio=is_real)),
        "DistanceJoint": Call(fb.DistanceJoint, dict(a=BEAM.end, b=BODY), dict(a=NODE, b=NODE, name=is_text)),
        "Spring": Call(fb.Spring, dict(a=BEAM.end, b=BODY, stiffness=1.0),
                       dict(a=NODE, b=NODE, name=is_text, stiffness=is_real, length=is_real, damping=is_real,
                            tension_only=is_flag, compression_only=is_flag, table=is_array(2), interpolation=is_text)),
        "Spring of a table": Call(lambda **more: fb.Spring(BEAM.end, BODY, **more), dict(table=([0.0, 1.0], [0.0, 2.0])),
                                  dict(table=is_array(2))),
        "Damper": Call(fb.Damper, dict(a=BEAM.end, b=BODY, damping=1.0), dict(a=NODE, b=NODE, name=is_text, damping=is_real)),
        "Bushing": Call(fb.Bushing, dict(a=BEAM.end, b=BODY, stiffness=np.ones(6)),
                        dict(a=NODE, b=NODE, name=is_text, stiffness=is_array(1, 2), damping=is_array(1, 2),
                             directors=is_array(2))),
        **{name: Call(getattr(fb, name), dict(a=BEAM.end, b=BODY.point((0, 0, 1))) | axes,
                      dict(a=NODE, b=NODE, name=is_text) | dict.fromkeys(axes, VECTOR) | more)
           for name, axes, more in (
               ("RevoluteJoint", dict(axis=(0, 1, 0)), IN_JOINT | dict.fromkeys(("torque", "angle"), OF_TIME)
                | {"radius": is_real}),
               ("PrismaticJoint", dict(axis=(0, 1, 0)), IN_JOINT | dict.fromkeys(("force", "distance"), OF_TIME)),
               ("CylindricalJoint", dict(axis=(0, 1, 0)), IN_EACH
                | dict.fromkeys(("torque", "force", "angle", "distance"), OF_TIME)),
               ("ScrewJoint", dict(axis=(0, 1, 0), pitch=0.1), IN_EACH | {"pitch": is_real}
                | dict.fromkeys(("torque", "force", "angle", "distance"), OF_TIME)),
               ("PlanarJoint", dict(normal=(0, 1, 0)), IN_EACH | dict(along=VECTOR) | dict.fromkeys(("torque", "angle"), OF_TIME)
                | dict.fromkeys(("force", "distance"), SOME_OF_TIME)),
               ("UniversalJoint", dict(axis_a=(0, 1, 0), axis_b=(0, 0, 1)), IN_EACH
                | dict.fromkeys(("torque", "angle"), SOME_OF_TIME)),
               ("SphericalJoint", dict(axis=(0, 1, 0)), dict.fromkeys(("stiffness", "damping"), VECTOR)
                | dict.fromkeys(("torque", "twist", "speed"), OF_TIME)
                | dict(friction=is_real, drive=is_a(fb.Drive), stops=is_a(fb.Stops), cone=is_a(fb.Stops))))},
        "GROUND.point": Call(fb.GROUND.point, dict(position=(0, 0, 1)), dict(position=VECTOR)),
        "Load": Call(fb.Load, dict(name="l", at=BEAM.end),
                     dict(name=is_text, at=NODE, force=VECTOR, moment=VECTOR, time=is_function, follower=is_flag)),
        "DistributedLoad": Call(fb.DistributedLoad, dict(name="l", beam=BEAM, force=(0, 0, 1)),
                                dict(name=is_text, beam=A_BEAM, force=FIELD, moment=FIELD, time=is_function, follower=is_flag)),
        "DistributedLoad.force_at": Call(fb.DistributedLoad("l", BEAM, force=(0, 0, 1)).force_at, dict(s=[0.0]),
                                         dict(s=either(is_real, VECTOR))),
        "DistributedLoad.moment_at": Call(fb.DistributedLoad("l", BEAM, force=(0, 0, 1)).moment_at, dict(s=[0.0]),
                                          dict(s=either(is_real, VECTOR))),
        "InitialVelocity": Call(fb.InitialVelocity, dict(beam=BEAM), dict(beam=A_BEAM, velocity=FIELD, spin=FIELD)),
        "InitialVelocity.velocity_at": Call(fb.InitialVelocity(BEAM).velocity_at, dict(s=[0.0]), dict(s=either(is_real, VECTOR))),
        "InitialVelocity.spin_at": Call(fb.InitialVelocity(BEAM).spin_at, dict(s=[0.0]), dict(s=either(is_real, VECTOR))),
        "RigidMotion": Call(fb.RigidMotion, {}, dict(
            objects=either(one_of(fb.Beam, fb.Net, fb.PointMass, fb.RigidBody),
                           is_list_of(one_of(fb.Beam, fb.Net, fb.PointMass, fb.RigidBody))),
            velocity=VECTOR, spin=VECTOR, about=VECTOR)),
        "Path": Call(fb.Path, dict(name="p", beams=[BEAM, (RAIL, -1)]), dict(
            name=is_text, beams=is_list_of(A_BEAM), closed=is_flag)),
        "Path.locate": Call(AROUND.locate, dict(s=0.5), dict(s=is_real)),
        "Path.places": Call(AROUND.places, dict(s=[0.5]), dict(s=either(is_real, VECTOR))),
        "Path.reference": Call(AROUND.reference, dict(s=[0.5]), dict(s=either(is_real, VECTOR))),
        "Crossing": Call(fb.Crossing, dict(name="x", beam_a=BEAM, beam_b=ACROSS, at=(1.0, 1.0)), dict(
            name=is_text, beam_a=A_TRACK, beam_b=A_TRACK, at=VECTOR, curve=is_text,
            friction=either(is_real, is_list_of(is_real)))),
        "Switch": Call(fb.Switch, dict(name="w", tracks=[BEAM, RAIL]), dict(
            name=is_text, tracks=is_list_of(A_TRACK),
            choose=either(is_function, is_a(Mapping), is_list_of(is_list_of(is_text))))),
        "Switch.where": Call(POINTS.where, dict(s=0.5), dict(s=is_real)),
        "Switch.offset": Call(POINTS.offset, dict(track=BEAM), dict(track=either(A_TRACK, is_text))),
        "Switch.options": Call(POINTS.options, dict(track=BEAM, end="end"), dict(track=either(A_TRACK, is_text), end=is_text)),
        "Switch.nearest": Call(POINTS.nearest, dict(point=(0.5, 1.0, 0.0)), dict(point=VECTOR)),
        "Switch.places": Call(POINTS.places, dict(s=[0.5]), dict(s=either(is_real, VECTOR))),
        "Switch.locate": Call(POINTS.locate, dict(s=0.5), dict(s=is_real)),
        "Switch.reference": Call(POINTS.reference, dict(s=[0.5]), dict(s=either(is_real, VECTOR))),
        "MovingMesh": Call(fb.MovingMesh, dict(beam=RAIL, sliders=MIDDLE), dict(
            beam=A_BEAM, sliders=either(is_a(fb.Slider), is_list_of(is_a(fb.Slider))), velocity=FIELD, spin=FIELD)),
        "with_moving_meshes": Call(fb.with_moving_meshes, dict(scene=fb.Scene(RAIL, MASS, MIDDLE)), dict(scene=is_a(fb.Scene))),
        "Slider": Call(fb.Slider, dict(name="s", point=MASS, beam=RAIL, at=0.5),
                       dict(name=is_text, point=NODE, beam=A_TRACK, on=A_TRACK, at=is_real, rate=is_real, curve=is_text,
                            friction=is_real, drive=is_a(fb.Drive), stops=is_a(fb.Stops), **LOCKED)),
        "Sleeve": Call(fb.Sleeve, dict(name="s", point=BODY, beam=RAIL, at=0.5, length=0.2),
                       dict(name=is_text, point=NODE, beam=A_BEAM, on=A_BEAM, at=is_real, rate=is_real, curve=is_text,
                            friction=is_real, drive=is_a(fb.Drive), stops=is_a(fb.Stops), keyed=is_flag, length=is_real,
                            key_radius=is_real, radius=is_real, axis=VECTOR, **LOCKED)),
        "Friction": Call(fb.Friction, dict(coefficient=0.1), dict(coefficient=is_real, viscous=is_real, smoothing=is_real)),
        "Drive": Call(fb.Drive, dict(speed=0.5), dict(
            position=either(is_real, is_function), speed=either(is_real, is_function), force=either(is_real, is_function),
            stiffness=is_real, damping=is_real, limit=is_real)),
        "Stops": Call(fb.Stops, dict(start=0.1), dict(start=is_real, end=is_real, stiffness=is_real, restitution=is_real)),
        "Lock": Call(fb.Lock, {}, dict(when=CONDITION, at=is_real, until=CONDITION)),
        "Release": Call(fb.Release, dict(when=1.0), dict(when=CONDITION)),
        "OneSided": Call(fb.OneSided, dict(side=(0, 0, 1)), dict(side=VECTOR, restitution=is_real, catch=is_flag)),
        "Net": Call(fb.Net, dict(name="n", nodes=NODES, edges=EDGES, section=SECTION), dict(
            name=is_text, nodes=is_array(2), edges=is_array(2), section=either(SECTIONS, is_list_of(SECTIONS)), section_of=VECTOR,
            prestrain=either(is_real, VECTOR), prestress=either(is_real, VECTOR),
            elements=either(is_count, VECTOR), degree=is_count, strain=is_text, d2=is_array(1, 2),
            joints=either(is_text, is_list_of(is_text)), pins=VECTOR, clamps=VECTOR, masses=VECTOR, loads=is_array(2),
            time=is_function, velocity=is_array(1, 2), spin=is_array(1, 2))),
        "Net.beam": Call(NET.beam, dict(k=0), dict(k=is_count)),
        "Net.node": Call(NET.node, dict(i=0), dict(i=is_count)),
        "Scene": Call(lambda part=BEAM, **more: fb.Scene(part, **more), {}, dict(
            part=one_of(fb.Beam, fb.Net, fb.PointMass, fb.RigidBody, fb.Clamp), name=is_text, gravity=VECTOR,
            gravity_time=is_function, project_velocities=is_flag)),
        "Scene.add": Call(lambda part: fb.Scene(BEAM).add(part), dict(part=RAIL), dict(
            part=one_of(fb.Beam, fb.Net, fb.PointMass, fb.RigidBody, fb.Clamp))),
        "Scene.position_of": Call(SCENE.position_of, dict(thing=MASS), dict(thing=NODE)),
        "compile_scene": Call(fb.compile_scene, dict(scene=fb.Scene(BEAM)), dict(
            scene=one_of(fb.Scene), solver=is_text, eliminate_inner=is_flag, planar=either(is_flag, among("auto")),
            condense=either(is_flag, among("auto")), moving=either(is_flag, among("auto")))),
        "Model.node_label": Call(model().node_label, dict(node=0), dict(node=is_count)),
        "simulate": Call(fb.simulate, dict(model=model(), **ends_at_once), ROWS | dict(
            model=one_of(Model), start=one_of(State, fb.Checkpoint, fb.Start), t_end=is_real, step=is_real, order=is_count,
            method=either(is_text, one_of(fb.Method)),
            every=is_count, callback=is_function, tolerance=either(is_real, one_of(fb.StepControl)),
            output=either(PATH, one_of(fb.Output)), solver=either(is_text, one_of(fb.Solver)), progress=is_flag)),
        "Start": Call(fb.Start, {}, dict(state=one_of(State, fb.Checkpoint), time=is_real, mend=is_flag,
                                         velocities=among("start", "scene"))),
        "Method": Call(fb.Method, {}, dict(name=is_text, rho_inf=is_real)),
        "StepControl": Call(fb.StepControl, dict(tolerance=1e-6), dict(tolerance=is_real, min_step=is_real, max_step=is_real)),
        "Output": Call(fb.Output, {}, dict(file=PATH, overwrite=is_flag, snapshots=is_count, checkpoint=PATH,
                                           checkpoint_every=is_real)),
        "Solver": Call(fb.Solver, {}, dict(backend=is_text, threads=is_count, max_iterations=is_count, augmentation=is_real)),
        "solve_static": Call(fb.solve_static, dict(model=held()), ROWS | dict(
            model=one_of(Model), start=one_of(State, fb.Start), max_iterations=is_count, backend=is_text, threads=is_count,
            load_step=is_real, largest_load_step=is_real, levels=VECTOR, smallest_step=is_real,
            at_time=is_real, held=either(is_flag, is_text, is_list_of(is_text)),
            rest_intervals=either(is_flag, is_text, is_list_of(is_text)), raise_loads=is_flag, contacts=among("mesh", "exact"),
             steady=STEADY)),
        "solve_path": Call(fb.solve_path, dict(model=held(), most_points=4), dict(
            model=one_of(Model), to=is_real, start=one_of(State), load_factor=is_real, step=is_real, largest_step=is_real,
            smallest_step=is_real, most_points=is_count, at_time=either(is_real, is_array(2)), points=one_of(Mapping),
            held=either(is_flag, is_text, is_list_of(is_text)), max_iterations=is_count, backend=is_text, stop_at=is_text,
            side=among(1, -1), branch=is_count, observe=is_list_of(is_text), moves=one_of(Mapping), stop=one_of(Mapping),
            prestrains=one_of(Mapping))),
        "critical_loads": Call(fb.critical_loads, dict(model=held(), n=2), dict(
            model=one_of(Model), state=one_of(State), load_factor=is_real, n=is_count, negative=is_flag,
            at_time=either(is_real, is_array(2)), held=either(is_flag, is_text, is_list_of(is_text)), moves=one_of(Mapping),
            prestrains=one_of(Mapping), backend=is_text)),
        "find_lengths": Call(fb.find_lengths, dict(model=held(), lengths=["boom"], conditions={("tip", "x"): 2.0},
                                                   points={"tip": BEAM.end}), dict(
            model=one_of(Model), lengths=is_list_of(either(is_text, one_of(fb.Beam))), conditions=one_of(Mapping),
            points=one_of(Mapping), start=one_of(State), at_time=is_real, mass=among("kept", "per_length"),
            observe=is_list_of(is_text), held=either(is_flag, is_text, is_list_of(is_text)), step=is_real, largest_step=is_real,
            smallest_step=is_real, max_iterations=is_count, backend=is_text)),
        "stick_interval": Call(fb.stick_interval, dict(model=rubbing(), slider="s"), dict(
            model=one_of(Model), slider=is_text, load_factor=is_real, within=is_array(2), at_time=either(is_real, is_array(2)),
            start=one_of(State), held=either(is_flag, is_text, is_list_of(is_text)), max_iterations=is_count, backend=is_text)),
        "modes": Call(fb.modes, dict(model=held(), load_factor=0.0, n=3), dict(
            model=one_of(Model), state=one_of(State), n=is_count, load_factor=is_real, at_time=is_real, planar=is_flag,
            held=either(is_flag, is_text, is_list_of(is_text)), damped=is_flag, steady=STEADY, backend=is_text)),
        "Spin": Call(fb.Spin, dict(rate=1.0), dict(rate=is_real, axis=VECTOR, point=VECTOR)),
        "Travel": Call(fb.Travel, dict(speeds={BEAM: 1.0}), dict(speeds=one_of(Mapping))),
        "frequency_response": Call(fb.frequency_response, dict(
            model=held(), frequencies=[3.0], load_factor=0.0, base=(1, 0, 0)), dict(
            model=one_of(Model), frequencies=VECTOR, state=one_of(State), load_factor=is_real, at_time=is_real, planar=is_flag,
            loads=either(is_text, one_of(Mapping, fb.Load), is_list_of(either(is_text, one_of(fb.Load)))),
            base=either(is_triple, one_of(Mapping)),
            damping_ratio=is_real, loss_factor=is_real,
            points=one_of(Mapping), held=either(is_flag, is_text, is_list_of(is_text)), shapes=is_flag, backend=is_text)),
        "force_density": Call(fb.force_density, dict(nodes=NODES, edges=EDGES, densities=1.0, pins=[0]), dict(
            nodes=is_array(2), edges=is_array(2), densities=either(is_real, VECTOR), pins=VECTOR, loads=is_array(2))),
        "relax": Call(fb.relax, dict(model=held(), most_steps=50), dict(
            model=one_of(Model), start=one_of(State, fb.Start), step=is_real, most_steps=is_count, at_time=is_real,
            observe=is_list_of(is_text), points=one_of(Mapping), finish=is_flag, max_iterations=is_count, backend=is_text)),
        **{f"FrequencyResponse.{name}": Call(getattr(response(), name), dict(name="tip"), dict(name=is_text))
           for name in ("point", "spin", "slide", "peaks")},
        "FrequencyResponse.shape": Call(response().shape, dict(k=0), dict(k=is_count)),
        "SteadyModes.state": Call(steady_modes().state, dict(k=0, amplitude=0.01), dict(
            k=is_count, amplitude=is_real, phase=is_real)),
        "DampedModes.state": Call(damped_modes().state, dict(k=0, amplitude=0.01), dict(
            k=is_count, amplitude=is_real, phase=is_real)),
        "plot_response": Call(fb.plot_response, dict(response=response()), dict(
            response=one_of(FrequencyResponse), component=is_text, log=is_flag)),
        "sensitivity": Call(fb.sensitivity, dict(build=held_bar, values={}), dict(
            build=callable, values=one_of(Mapping), scale=one_of(Mapping), state=one_of(State), observe=is_list_of(is_text),
            load_factor=is_real, at_time=is_real, held=either(is_flag, is_text, is_list_of(is_text)), backend=is_text)),
        "critical_sensitivity": Call(fb.critical_sensitivity, dict(
            build=held_bar, values={}, state=fb.compile_scene(held_bar()[0]).state(), load_factor=0.0), dict(
                build=callable, values=one_of(Mapping), scale=one_of(Mapping), state=one_of(State), load_factor=is_real,
                at_time=is_real, held=either(is_flag, is_text, is_list_of(is_text)), backend=is_text)),
        "adjoint_run": Call(fb.adjoint_run, dict(model=held(), t_end=2e-3, step=1e-3), dict(
            model=one_of(Model), t_end=is_real, step=is_real, start=one_of(State), points=one_of(Mapping),
            max_iterations=is_count, backend=is_text, keep_every=is_count)),
        "AdjointRun.point": Call(short().point, dict(name="tip"), dict(name=is_text)),
        "AdjointRun.velocity": Call(short().velocity, dict(name="tip"), dict(name=is_text)),
        "AdjointRun.gradient": Call(short().gradient, dict(points={"tip": (0, 0, 1)}), dict(
            points=one_of(Mapping), velocities=one_of(Mapping), build=callable, values=one_of(Mapping), scale=one_of(Mapping))),
        "Sensitivity.point": Call(bars().point, dict(name="tip"), dict(name=is_text)),
        "Sensitivity.slider": Call(bars().slider, dict(name="none"), dict(name=is_text)),
        "Sensitivity.contact_force": Call(bars().contact_force, dict(name="none"), dict(name=is_text)),
        "Sensitivity.reaction": Call(bars().reaction, dict(name="none"), dict(name=is_text)),
        "Sensitivity.section": Call(bars().section, dict(name="tip"), dict(name=is_text)),
        "Sensitivity.energy": Call(bars().energy, dict(kind="strain"), dict(kind=is_text)),
        "Sensitivity.gradient": Call(bars().gradient, dict(points={"tip": (0, 0, 1)}), dict(
            points=one_of(Mapping), sliders=one_of(Mapping), contact_forces=one_of(Mapping), strain_energy=is_real)),
        "Sensitivity.frequencies": Call(bars().frequencies, dict(n=2), dict(n=is_count, planar=is_flag)),
        "Modes.state": Call(modes().state, dict(k=0, amplitude=0.01), dict(k=is_count, amplitude=is_real, phase=is_real)),
        "BucklingModes.state": Call(buckling().state, dict(k=0, amplitude=0.01), dict(k=is_count, amplitude=is_real)),
        "BucklingModes.motion": Call(buckling().motion, dict(k=0), dict(
            k=is_count, amplitude=is_real, frames=is_count, decay=is_flag)),
        "Modes.motion": Call(modes().motion, dict(k=0), dict(k=is_count, amplitude=is_real, frames=is_count, decay=is_flag)),
        "DampedModes.motion": Call(damped_modes().motion, dict(k=0), dict(
            k=is_count, amplitude=is_real, frames=is_count, decay=is_flag)),
        "SteadyModes.motion": Call(steady_modes().motion, dict(k=0), dict(
            k=is_count, amplitude=is_real, frames=is_count, decay=is_flag)),
        "Modes.shape": Call(modes().shape, dict(k=0), dict(k=is_count)),
        "load_result": Call(fb.load_result, dict(path=folder / "text"), dict(path=PATH)),
        "load_checkpoint": Call(fb.load_checkpoint, dict(path=folder / "text"), dict(path=PATH)),
        "Checkpoint": Call(fb.Checkpoint, dict(state=model().state(), t=0.0, step=1.0, t_start=0.0, steps=0, next_step=None,
                                               mean_force=None, scene="", fingerprint=""),
                           dict(state=one_of(State), t=is_real, step=is_real, t_start=is_real, steps=is_count, next_step=is_real,
                                mean_force=one_of(np.ndarray), scene=is_text, fingerprint=is_text, memory=one_of(np.ndarray),
                                last_step=is_real, impacts=one_of(np.ndarray), began=is_real)),
        "Checkpoint.save": Call(result().checkpoint.save, dict(path=folder / "c", overwrite=True),
                                dict(path=PATH, overwrite=is_flag)),
        "Result": Call(fb.Result, dict(t=[0.0, 1.0]), dict(
            t=is_series, series=one_of(Mapping), model_text=is_text, info=one_of(Mapping), names=one_of(Mapping),
            t_snap=is_series, phi=is_series, directors=is_series, velocities=is_series, spins=is_series, mesh=is_series,
            events=one_of(list, tuple))),
        **{f"Result.{name}": Call(getattr(result(), name), dict(name="total"), dict(name=is_text))
           for name in ("point", "slider", "joint", "spring", "bushing", "winch", "deviation", "drift", "is_conserved",
                        "velocity", "section", "acceleration", "spin", "orientation", "power")},
        "Result.reaction": Call(result().reaction, dict(name="pin"), dict(name=either(is_text, one_of(fb.Pin, fb.Clamp)))),
        "LineForce": Call(fb.LineForce, dict(a=BEAM.end, b=BODY, law=tension), dict(
            a=NODE, b=NODE, name=is_text, law=is_function, parameters=VECTOR, derivative=is_function)),
        "ForceElement": Call(fb.ForceElement, dict(a=BEAM.end, b=BODY, law=between), dict(
            a=NODE, b=NODE, name=is_text, law=is_function, parameters=VECTOR, derivative=is_function, directors=is_array(2))),
        "Winch": Call(fb.Winch, dict(name="w", drum=BEAM.start, load=BODY, stiffness=1e3, mass_per_length=1.0), dict(
            name=is_text, drum=NODE, load=NODE, stiffness=is_real, mass_per_length=is_real, length=is_real, total=is_real,
            inertia=is_real, speed=is_real, length_at=is_function, tension=OF_TIME, segments=is_count)),
        "Winch.length_of": Call(fb.Winch("w", BEAM.start, BODY, stiffness=1e3, mass_per_length=1.0,
                                         length_at=lambda t: 2.0 + t * t).length_of, dict(t=0.5), dict(t=is_real)),
        "Controller": Call(fb.Controller, dict(name="c", law=held_value, period=0.1), dict(
            name=is_text, law=is_function, period=is_real, start=is_real, memory=VECTOR, points=one_of(Mapping))),
        "UserForce": Call(fb.UserForce, dict(name="u", at=BODY, law=law), dict(
            name=is_text, at=one_of(fb.NodeRef, fb.Beam, fb.RigidBody, fb.PointMass), law=is_function,
            parameters=either(VECTOR, is_function), derivative=is_function, dissipates=is_flag, grows=is_flag)),
        "section_forces": Call(fb.section_forces, dict(model=model(), shapes=model().state(), beam=BEAM), dict(
            model=one_of(Model), shapes=one_of(State, fb.Result), beam=one_of(fb.Beam), s=either(is_real, VECTOR))),
        "Result.state_for": Call(result().state_for, dict(model=model()), dict(model=one_of(Model))),
        "Result.save": Call(result().save, dict(path=folder / "r", overwrite=True),
                            dict(path=PATH, overwrite=is_flag)),
        "Result.to_vtk": Call(result().to_vtk, dict(path=folder / "r.vtkhdf", overwrite=True), dict(
            path=PATH, overwrite=is_flag, surface=is_flag, refine=is_count, double=is_flag, sections=one_of(Mapping))),
        "sweep": Call(fb.sweep, dict(build=lambda a: a, cases=[{"a": 1}], workers=1, progress=False), dict(
            build=callable, cases=either(one_of(Mapping), is_list_of(one_of(Mapping))),
            run=one_of(Mapping), measure=is_function, executor=one_of(Executor), workers=is_count, threads=is_count, file=PATH,
            overwrite=is_flag, retry=is_flag, progress=is_flag)),
        "load_sweep": Call(fb.load_sweep, dict(path=folder / "text"), dict(path=PATH)),
        "Sweep.column": Call(fb.sweep(lambda a: 2.0 * a, {"a": [1, 2]}, workers=1).column, dict(name="value"),
                             dict(name=is_text)),
        "plot_balance": Call(fb.plot_balance, dict(result=result()), dict(result=one_of(fb.Result))),
        "animate": Call(fb.animate, dict(result=modes(), path=folder / "film.gif", overwrite=True, plane="xy", frames=2), dict(
            result=one_of(fb.Result, Modes, DampedModes, fb.BucklingModes), path=PATH, plane=is_text, fps=is_real, speed=is_real,
            mode=either(is_count, is_list_of(is_count), is_counts), amplitude=is_real, frames=is_count, decay=is_flag,
            overwrite=is_flag, progress=is_flag)),
        "plot_overview": Call(fb.plot_overview, dict(result=result()), dict(result=one_of(fb.Result), plane=is_text, n=is_count)),
        "plot_shapes": Call(fb.plot_shapes, dict(result=result()), dict(result=one_of(fb.Result), plane=is_text, n=is_count,
                                                                        cmap=is_text)),
        "plot_invariants": Call(fb.plot_invariants, dict(result=result()), dict(result=one_of(fb.Result))),
        "plot_slider": Call(fb.plot_slider, dict(result=result()), dict(result=one_of(fb.Result), slider=is_text)),
        "plot_modes": Call(fb.plot_modes, dict(modes=modes()), dict(
            modes=one_of(Modes, DampedModes, fb.BucklingModes), plane=is_text, n=is_count, first=is_count, amplitude=is_real)),
    }
    return out


# --- one call with bad arguments -------------------------------------------------------------------------------------------
REFUSED = (fb.SceneError, fb.ResultFileError, fb.ConvergenceError)


class TooLong(BaseException):
    """A call took longer than anyone waits."""


def law(t: Any, position: Any, directors: Any, velocity: Any, spin: Any, parameters: Any, force: Any, moment: Any) -> None:
    """Of a user force."""


def between(t: Any, x: Any, rotation: Any, v: Any, spin: Any, parameters: Any, force: Any, moment: Any) -> None:
    """Of a force element."""
    force[0] = 0.0


def tension(t: Any, length: Any, rate: Any, parameters: Any) -> float:
    """Of a force along a line."""
    return 0.0


def held_value(now: Any, memory: Any) -> float:
    """Of a controller."""
    return 0.0


def _ring(*_: Any) -> None:
    raise TooLong


def outcome(call: Call, bad: dict[str, Any]) -> str:
    """'' where a call is refused, or takes what it may take; else what went wrong."""
    defaults = {name: p.default for name, p in inspect.signature(call.function).parameters.items()}
    signal.setitimer(signal.ITIMER_REAL, PATIENCE)
    try:
        call.function(**{**call.works, **bad})
    except REFUSED as refused:
        return "" if len(str(refused)) > 20 else f"says only {refused}"
    except TooLong:
        return "hangs"
    except ZeroDivisionError as error:
        # a function of the user that fails where it is called, in a run: that is for the user to see
        return "" if "function that fails" in traceback_names(error) else f"raw {type(error).__name__}: {error}"
    except Exception as error:
        return f"raw {type(error).__name__}: {str(error)[:80]}"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    taken = [name for name, value in bad.items()
             if not (call.takes[name](value) or value is None and (defaults.get(name, 0) is None or name in MAY_BE_NONE))]
    return f"takes {taken}" if taken else ""


# of arguments that the signature does not show or give a default
MAY_BE_NONE = ("next_step", "mean_force", "gravity_time")


def traceback_names(error: BaseException) -> set[str]:
    names, at = set(), error.__traceback__
    while at is not None:
        names.add("function that fails" if at.tb_frame.f_code is WRONG["function that fails"].__code__ else "")
        at = at.tb_next
    return names


def singles(folder: Path) -> Iterator[tuple[str, dict[str, str]]]:
    """Every value for every argument of every call."""
    for name, call in calls(folder).items():
        for argument in call.takes:
            for value in pool(folder):
                yield name, {argument: value}


def report(folder: Path, cases: list[tuple[str, dict[str, str]]], monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """What went wrong, by call and values."""
    # compilation is no hang, nor is that of the solver that a failing step falls back on
    result(), fb.solve_static(held())
    with suppress(fb.ConvergenceError):
        fb.simulate(model(), t_end=3.0, step=3.0, progress=False)
    with suppress(fb.ConvergenceError):
        fb.simulate(model(), t_end=0.1, step=0.1, progress=False, method=fb.Method(rho_inf=0))
    monkeypatch.chdir(folder)
    table, values = calls(folder), pool(folder)
    before = signal.signal(signal.SIGALRM, _ring)
    wrong: dict[str, str] = {}
    try:
        for name, chosen in cases:
            said = outcome(table[name], {argument: values[value]() for argument, value in chosen.items()})
            if said:
                wrong[f"{name}({', '.join(f'{a}={v}' for a, v in chosen.items())})"] = said
    finally:
        signal.signal(signal.SIGALRM, before)
    return wrong


@pytest.mark.filterwarnings("error::numpy.exceptions.ComplexWarning")
def test_no_bad_argument_is_taken_or_ends_in_something_raw(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cases = list(singles(tmp_path))
    assert len(cases) > 20_000
    assert report(tmp_path, cases, monkeypatch) == {}


@pytest.mark.parametrize(("seed", "n"), [(1, 3000), pytest.param(2, 6000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("fitting", [False, True])
def test_bad_arguments_in_combination(seed: int, n: int, fitting: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Any values, and values of the right kind alone, which get past the first check: huge, tiny, of odd shapes."""
    draw = random.Random(seed)
    table, values = calls(tmp_path), pool(tmp_path)
    choice = {(name, argument): [value for value in values if not fitting or test(values[value]())]
              for name, call in table.items() for argument, test in call.takes.items()}
    cases = []
    for _ in range(n):
        name = draw.choice(list(table))
        # where values are to fit, an argument that takes none of them is left out
        there = [argument for argument in table[name].takes if choice[name, argument]]
        some = draw.sample(there, min(len(there), draw.randint(2, 5)))
        cases.append((name, {argument: draw.choice(choice[name, argument]) for argument in some}))
    wrong = report(tmp_path, cases, monkeypatch)
    assert wrong == {}, Counter(text.split(":")[0] for text in wrong.values())


# --- nothing public is left out --------------------------------------------------------------------------------------------
# of errors and of tables that calls make the arguments are texts and facts of the package's own; a net's lists serve the compiler
OWN = {"BackendError", "ConvergenceError", "Interrupted", "ResultFileError", "ResultWarning", "SceneError", "__version__"}
FOR_THE_COMPILER = {"Net.along", "Net.beam_at"}
# objects of these are made by calls alone
MADE = {"AdjointRun", "BucklingModes", "CriticalSlopes", "DampedModes", "FrequencyResponse", "Modes", "RunGradient",
        "RunSliderGradient", "Sensitivity", "SteadyModes", "Sweep"}


def public() -> Iterator[tuple[str, Any]]:
    """Every public call with arguments: functions, constructors, methods."""
    for name in set(fb.__all__) - OWN:
        thing = getattr(fb, name)
        if callable(thing) and not inspect.isclass(thing):
            yield name, thing
            continue
        # an object of the package, such as GROUND, has methods alone
        if inspect.isclass(thing) and name not in MADE:
            yield name, thing.__init__
        for method, found in inspect.getmembers(thing, lambda x: inspect.isfunction(x) or inspect.ismethod(x)):
            if not method.startswith("_") and f"{name}.{method}" not in FOR_THE_COMPILER:
                yield f"{name}.{method}", found


def arguments_of(function: Any) -> list[str]:
    return [p.name for p in inspect.signature(function).parameters.values()
            if p.name not in ("self", "cls") and not p.name.startswith("_") and p.kind is not p.VAR_KEYWORD]


def test_every_argument_of_every_public_call_has_a_kind() -> None:
    without = [f"{name}({argument})" for name, function in public() for argument in arguments_of(function)
               if argument not in getattr(function, "kinds", ())]
    assert without == []
    assert len(list(public())) > 40


def test_every_public_call_is_fed_here(tmp_path: Path) -> None:
    table = calls(tmp_path)
    fed = {name for name, function in public() if arguments_of(function)}
    missing = {name for name in fed if name not in table}
    assert missing == set()
    unfed = {f"{name}({argument})" for name, function in public() for argument in arguments_of(function)
             if name in table and argument not in table[name].takes and argument not in ("parts",)}
    assert unfed == set()


def test_signatures_stay_readable() -> None:
    assert list(inspect.signature(fb.PointMass).parameters) == ["name", "mass", "position", "velocity"]
    assert "t_end: 'float'" in str(inspect.signature(fb.simulate))
    assert (fb.simulate.__doc__ or "").startswith("Integrate a model in time")
    assert fb.Beam.straight.__name__ == "straight"


@pytest.mark.parametrize("arguments", [["run"], ["run", ""], ["run", "a\0b"], ["run", "../x"], ["fly"], ["--out"],
                                       ["run", "x" * 5000], ["warmup", "all"], ["warmup", ""], ["-h"], ["run", "crane", "--out"]])
def test_command_line_answers_what_it_cannot_do(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    try:
        code = front.main(arguments)
    except SystemExit as done:
        code = done.code
    said = capsys.readouterr()
    assert code == (0 if arguments == ["-h"] else 2)
    assert len(said.out + said.err) > 20


def test_command_line_refuses_a_file_as_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert front.main(["run", next(iter(front.find_examples())), "--out", str(tmp_path / "file")]) == 2
    assert "file' is a file; give a folder" in capsys.readouterr().err
