"""Tables of calls: the same numbers as code that is compiled for the terms, entries shared by scenes, what is refused."""
from __future__ import annotations

import inspect
import re
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.kernels import call_tables, loop
from fastbeam.kernels.call_tables import ASSEMBLY, Calls, SystemRecord, system_record
from fastbeam.kernels.jit.records import Record
from fastbeam.kernels.questions import BY_CONTACT
from fastbeam.kernels.terms import System, close, fill
from fastbeam.stepping.stepper import Stepper

H = 1e-3


def stepper(slider: bool = False, bodies: int = 0) -> Stepper:
    """Of a beam in space that turns, with what else there is."""
    section = fb.Section.circle(radius=0.02, E=1e7, rho=1000.0)
    rod = fb.Beam.straight("rod", (0, 0, 0), (1, 0, 0.3), section=section, elements=2, degree=2)
    scene = fb.Scene(rod, fb.RigidMotion(spin=(0.1, 2.0, 0.3)), gravity=(0, 0, -9.81))
    for k in range(bodies):
        scene.add(fb.RigidBody(f"body {k}", mass=2.0, inertia=(1, 2, 3), position=(0, 0, k), spin=(1, 0, 2)))
    if slider:
        bead = fb.PointMass("bead", mass=0.1)
        scene.add(bead, fb.Slider("run", bead, rod, at=0.4, rate=0.5))
    return Stepper(fb.compile_scene(scene, planar=False), np.ones(1))


def equations(of: Stepper, arguments: tuple[Any, Any]) -> tuple[bytes, bytes]:
    """Residual and tangent of a first guess."""
    loop.begin(*of.records, H)
    of.work.r[:], of.work.blocks[:] = np.nan, np.nan
    loop.assemble_all(*arguments, H)
    return of.work.r.tobytes(), of.work.blocks.tobytes()


def test_a_table_finds_what_code_for_the_terms_finds() -> None:
    of = stepper(slider=True)
    assert equations(of, of.records) == equations(of, (Record(of.terms), Record(of.system)))


def test_scenes_share_entries() -> None:
    parts: dict[str, Any] = {"a slider": {"slider": True}, "a body": {"bodies": 1}, "both": {"slider": True, "bodies": 1}}
    known: dict[str, set[Any]] = {}
    for name, options in parts.items():
        before = dict(call_tables._ENTRIES)
        _ = stepper(**options).records
        known[name] = call_tables._ENTRIES.keys() - before.keys()
    # what both have is compiled for the kind of contact and of method alone; the beam with a slider and the body were there
    assert not {number for number, kind, _ in known["both"] if kind is not call_tables.NO_TERM}


def test_a_system_with_other_types_of_arrays_is_refused() -> None:
    of = stepper()
    wrong = of.system._replace(row_of=of.system.row_of.astype(np.int32))
    with pytest.raises(TypeError, match="arrays of a system have other types"):
        SystemRecord(wrong, ASSEMBLY)


def test_a_method_without_an_implementation_is_refused() -> None:
    of = stepper()
    with pytest.raises(TypeError, match="spread_nodes: there is no implementation for Space, tuple"):
        SystemRecord(of.system._replace(method=()))


def test_a_table_follows_its_system_and_keeps_the_records_of_its_terms() -> None:
    of = stepper()
    first = system_record(of.system, None)
    assert system_record(of.system, first) is first
    moved: System = of.system._replace(work=of.work._replace(r=of.work.r.copy()))
    second = system_record(moved, first)
    calls = Calls(of.terms)
    table, _ = calls.on(first)
    assert calls.on(first)[0] is table and calls.on(second)[0] is not table
    # the table alone holds what it points to
    expected = equations(of, calls.on(first))
    table, system = calls.on(first)
    del calls
    junk = [np.full(40, np.nan) for _ in range(2000)]
    assert equations(of, (table, system)) == expected and len(junk) == 2000


def test_contacts_name_all_that_their_equations_ask_terms() -> None:
    of_contacts = {x.name for asked in BY_CONTACT.values() for x in asked}
    for question in (fill, close):
        for (contact, *_), function in question.implementations.items():
            asked = set(re.findall(r"(\w+)\.each(?:_backward)?\(terms", inspect.getsource(function.py_func)))
            assert asked <= {x.name for x in BY_CONTACT[contact]}
            of_contacts -= asked
    assert not of_contacts
