"""The stages of the compiler: what each hands on, that the plane is found before anything is packed, that models stay as they
are."""
from __future__ import annotations

import dataclasses
import hashlib
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.compile import compile as compiler
from fastbeam.compile.condense import Condensed, condense
from fastbeam.compile.numbered import Numbered, number
from fastbeam.compile.order import Ordered, order
from fastbeam.compile.planar import Found, find_plane
from fastbeam.compile.unpack import Unpacked, unpack
from fastbeam.model import tables
from fastbeam.model.feature import Feature
from fastbeam.model.model import Model

sys.path.insert(0, str(Path(__file__).parents[1]))
from planar_scenes import mechanism  # noqa: E402
from small_scenes import bead, cantilever, free_beam  # noqa: E402

PACKAGE = Path(fb.__file__).parent
# what only the way from scene to model enters
STAGES = {*(f"compile/{name}.py" for name in ("compile", "numbered", "unpack", "planar", "condense", "order", "initial", "links",
                                              "substructuring", "carriers", "report")),
          "model/tables.py", "model/connections.py", "linalg/pattern.py"}


# fields of a model that are no arrays of a run: numbers of the parts of the scene, other forms of it, names
NO_ARRAYS = ("numbers", "uncondensed", "uneliminated")


def contents(x: Any, seen: Any) -> None:
    """Feed a hash with every array that a model holds."""
    if isinstance(x, np.ndarray):
        seen.update(np.ascontiguousarray(x).tobytes())
    elif dataclasses.is_dataclass(x):
        for f in dataclasses.fields(x):
            if f.name not in NO_ARRAYS:
                contents(getattr(x, f.name), seen)
    elif isinstance(x, (tuple, list)):
        for y in x:
            contents(y, seen)
    elif isinstance(x, Feature):
        contents([y for name, y in vars(x).items() if name != "parts"], seen)


def digest(model: Model) -> str:
    seen = hashlib.sha256()
    contents(model, seen)
    return seen.hexdigest()


def test_every_stage_hands_on_a_record_of_its_own() -> None:
    scene = mechanism()
    numbered = number(scene)
    unpacked = unpack(scene, numbered, compiler.pack_at_rest)
    found, why = find_plane(unpacked)
    condensed = condense(scene, unpacked, "auto")
    ordered = order(numbered, condensed, "auto", True, len(scene.sliders), 0)
    kinds = (Numbered, Unpacked, Found, Condensed, Ordered)
    for record, kind in zip((numbered, unpacked, found, condensed, ordered), kinds):
        assert isinstance(record, kind)
        name = (record._fields if isinstance(record, tuple) else dataclasses.fields(record))[0]
        with pytest.raises(AttributeError):
            setattr(record, name if isinstance(name, str) else name.name, None)
    assert why == "" and found is not None and found.plane.model is None
    assert isinstance(compiler.pack(scene, unpacked, condensed, ordered), Model)


def test_the_plane_is_found_before_anything_is_packed(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []
    find, pack = compiler.find_plane, tables.ElementPacker.tables

    def finding(unpacked: Unpacked) -> Any:
        calls.append("plane")
        return find(unpacked)

    def packing(self: Any, *arguments: Any) -> Any:
        calls.append("tables")
        return pack(self, *arguments)

    monkeypatch.setattr(compiler, "find_plane", finding)
    monkeypatch.setattr(tables.ElementPacker, "tables", packing)
    model = fb.compile_scene(mechanism())
    assert model.plane is not None and calls[0] == "plane" and calls.count("plane") == 1 and "tables" in calls


@pytest.mark.parametrize("make", [mechanism, bead, free_beam])
def test_a_model_is_frozen(make: Any) -> None:
    model = fb.compile_scene(make())
    held = [model, *([model.plane, model.plane.model] if model.plane is not None else [])]
    for record in held:
        for f in dataclasses.fields(record):
            with pytest.raises(dataclasses.FrozenInstanceError):
                setattr(record, f.name, getattr(record, f.name))
    with pytest.raises(dataclasses.FrozenInstanceError):
        model.something = 1  # type: ignore[attr-defined]


def test_nothing_goes_round_the_freezing() -> None:
    there = [path.name for path in PACKAGE.rglob("*.py") if "object.__setattr__(model" in path.read_text(encoding="utf-8")
             or "setattr(model" in path.read_text(encoding="utf-8")]
    assert there == []


@pytest.mark.parametrize("run", [lambda model: fb.simulate(model, t_end=0.02, step=0.01),
                                 lambda model: fb.solve_static(model)], ids=["in time", "at rest"])
def test_a_run_leaves_the_model_as_it_was(run: Any) -> None:
    assert set(NO_ARRAYS) <= {f.name for f in dataclasses.fields(Model)}
    model = fb.compile_scene(cantilever())
    before = digest(model)
    run(model)
    assert digest(model) == before


def test_a_run_does_not_go_back_to_the_compiler() -> None:
    model = fb.compile_scene(bead())
    fb.simulate(model, t_end=0.02, step=0.01)
    entered: set[str] = set()

    def note(frame: Any, event: str, _: Any) -> None:
        path = frame.f_code.co_filename
        if event == "call" and path.startswith(str(PACKAGE)):
            entered.add(Path(path).relative_to(PACKAGE).as_posix())

    sys.setprofile(note)
    try:
        fb.simulate(model, t_end=0.02, step=0.01)
    finally:
        sys.setprofile(None)
    assert "stepping/stepper.py" in entered and "results/result.py" in entered
    assert entered & STAGES == set()
    # what there is to say about contacts and tables of time asks parts of the scene
    told = {"scene/scene.py", "scene/sliders.py", "scene/paths.py", "scene/beams.py", "scene/sections.py",
            "scene/interpolation/basis.py", "scene/interpolation/shapes.py"}
    assert {name for name in entered if name.startswith("scene/")} <= told


def test_another_form_of_a_model_is_compiled_once_and_when_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = bead()
    model = fb.compile_scene(scene)
    compiled: list[Any] = []
    real = compiler.compile_scene
    monkeypatch.setattr(compiler, "compile_scene", lambda *a, **k: compiled.append(k) or real(*a, **k))
    assert model.uneliminated is not None
    # parts that are added later do not belong to it
    scene.parts.append(fb.PointMass("late", mass=1.0))
    one = model.uneliminated(planar=False)
    assert model.uneliminated(planar=False) is one and len(compiled) == 1
    assert one.solver == "sparse" and one.inner is None and one.n_nodes == model.n_nodes


@pytest.mark.parametrize("planar", [False, "auto"])
def test_load_vectors_hold_the_rows_that_they_touch(planar: Any) -> None:
    tube = fb.Section.tube(radius=0.03, thickness=0.003, E=210e9, rho=7850.0)
    posts = [fb.Beam.straight(f"post {k}", (k, 0, 0), (k, 0, 1), section=tube, elements=1) for k in range(8)]
    winds = [fb.DistributedLoad(f"wind {k}", post, force=(1.0 + k, 0, 0), time=lambda t, k=k: np.sin(k * t))
             for k, post in enumerate(posts)]
    pulls = [fb.Load(f"pull {k}", post.end, force=(0, 0, 1.0), time=winds[k].time) for k, post in enumerate(posts)]
    scene = fb.Scene(*posts, *map(fb.Clamp, (post.start for post in posts)), *winds, *pulls, gravity=(0, 0, -9.81))
    model = fb.compile_scene(scene, planar=planar)
    loads = (model if model.plane is None else model.plane.model).loads
    count = posts[0].basis.n_nodes
    assert loads.first.size == 8 * (model.n_nodes + 1) and loads.value.size == 8 * loads.row.size
    # a load and another with its function are one vector
    assert np.array_equal(loads.vector, np.repeat(np.arange(1, 9), count))
    for k, post in enumerate(posts):
        nodes = model.numbers.start(post) + np.arange(count)
        own = loads.vector == k + 1
        assert np.array_equal(loads.row[own], np.sort(model.pattern.row_of[nodes]))
        assert loads.value.reshape(-1, 8)[own].sum() == pytest.approx(1.0 + k + 1.0, rel=1e-14)
    assert model.fingerprint == fb.compile_scene(scene, planar=planar).fingerprint
