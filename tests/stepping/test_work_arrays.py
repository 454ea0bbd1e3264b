"""Compiled code writes inside the arrays that it is given and reads nothing from room for work that it has not written before.

Work arrays get a fence of NaN on both sides, those of empty_arrays.py begin as NaN: fences stay as they are, and the run has the
bits of one with ordinary arrays.
"""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from planar_scenes import FAMILIES, FLAT, flight, mechanism, plane
from small_scenes import bead, free_beam
from test_methods import mass_on_own_curve
from test_sliders_on_nets import CASES as NETS
from test_sliders_on_nets import scene as net

import fastbeam as fb
from fastbeam.dynamics import filtering, reactions
from fastbeam.kernels.layout import NODES, POINTS
from fastbeam.kernels.linalg import substructures
from fastbeam.kernels.state import State
from fastbeam.linalg import linear_system as linsolve
from fastbeam.model import moving_supports as prescribed
from fastbeam.model import workspace
from fastbeam.model.contact import sleeves, slider_forces
from fastbeam.model.joints import drives as joint_drives
from fastbeam.model.model import Model
from fastbeam.results.observe import observer as observe
from fastbeam.results.observe import resolution
from fastbeam.statics import equilibrium
from fastbeam.stepping import carriers as carrying
from fastbeam.stepping import constraint_rows as constraints
from fastbeam.stepping import methods
from fastbeam.stepping import stepper as newton

Array = np.ndarray
H = 0.01
WIDTH = 128                                      # of a fence on one side, doubles
MARK = np.int64(0x7FF8_DEAD_BEEF_0BAD)           # a NaN
ALLOCATING = (carrying, constraints, equilibrium, filtering, joint_drives, linsolve, methods, newton, observe, prescribed,
              reactions, resolution, sleeves, slider_forces, substructures, workspace)


class Fences:
    """Allocates arrays with fences around them; `numpy` for modules that allocate."""

    def __init__(self) -> None:
        self.edges: list[Array] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(np, name)

    def zeros(self, shape: Any, dtype: Any = float, shift: int = 0) -> Array:
        """As numpy.zeros; shift: doubles between fence and array, up to 8."""
        count, kind = int(np.prod(shape)), np.dtype(dtype)
        words = -(-count * kind.itemsize // 8)
        raw = np.full(words + 2 * WIDTH + 8, MARK)
        start = WIDTH + shift
        self.edges += [raw[:start], raw[start + words:]]
        raw[start:start + words] = 0
        inside: Array = raw[start:start + words].view(kind)[:count].reshape(shape)
        return inside

    def aligned(self, n: int) -> Array:
        """As kernels.work.aligned."""
        raw = np.full(n + 2 * WIDTH + 8, MARK)
        start = WIDTH + (-raw.ctypes.data // 8) % 8
        self.edges += [raw[:start], raw[start + n:]]
        raw[start:start + n] = 0
        return raw[start:start + n].view(float)

    def empty(self, shape: Any) -> Array:
        """As empty_arrays.empty."""
        out = self.zeros(shape)
        out.fill(np.nan)
        return out

    def aligned_empty(self, n: int) -> Array:
        """As empty_arrays.aligned_empty."""
        out = self.aligned(n)
        out.fill(np.nan)
        return out

    def copy(self, x: Array) -> Array:
        """As numpy.copy."""
        out = self.zeros(x.shape, x.dtype)
        out[:] = x
        return out

    def broken(self) -> list[tuple[int, int]]:
        """(number of the fence, doubles that are not as they were) of all that something wrote into."""
        return [(i, int(np.count_nonzero(x != MARK))) for i, x in enumerate(self.edges) if (x != MARK).any()]


@pytest.fixture
def fences(monkeypatch: pytest.MonkeyPatch) -> Fences:
    """All work arrays that are allocated from now on have fences, and room for work begins as NaN."""
    made = Fences()
    state = Model.state
    for module in ALLOCATING:
        monkeypatch.setattr(module, "np", made)
        for name, own in (("aligned", made.aligned), ("aligned_empty", made.aligned_empty), ("_padded", made.zeros),
                          ("empty", made.empty)):
            if hasattr(module, name):
                monkeypatch.setattr(module, name, own)
    monkeypatch.setattr(Model, "state", lambda self: State(*(made.copy(x) for x in state(self))))
    return made


def assert_fences_hold(scene: fb.Scene, fences: Fences, monkeypatch: pytest.MonkeyPatch, static: bool = False, path: bool = False,
                       compiled: dict[str, Any] | None = None, **run: Any) -> fb.Model:
    model = fb.compile_scene(scene, **(compiled or {}))

    def state() -> State:
        if static:
            return fb.solve_static(model, at_time=0.1).state
        if path:
            return fb.solve_path(model, at_time=0.1, step=0.01, to=0.02, observe=("energy",)).state
        return fb.simulate(model, **{"t_end": 3 * H, "step": H, **run}).state

    fenced = state()
    assert len(fences.edges) > 20
    assert fences.broken() == []
    monkeypatch.undo()
    for name, a, b in zip(State._fields, fenced, state()):
        assert np.isfinite(a).all(), name
        assert np.array_equal(a, b), name
    return model


def test_fences_notice_what_is_written_behind_an_array() -> None:
    fences = Fences()
    arrays = fences.zeros((2, 3)), fences.aligned(5), fences.zeros(4, np.int32)
    assert fences.broken() == []
    for k, array in enumerate(arrays):
        np.lib.stride_tricks.as_strided(array.reshape(-1), (array.size + 2,))[-1] = 1
        assert len(fences.broken()) == k + 1


@pytest.mark.parametrize("planar", [True, False], ids=["plane", "space"])
@pytest.mark.parametrize("elements", [1, 2, 3, 5])
@pytest.mark.parametrize("family", FAMILIES)
def test_beams_of_every_family(family: str, elements: int, planar: bool, fences: Fences, monkeypatch: pytest.MonkeyPatch) -> None:
    model = assert_fences_hold(flight(FLAT, family, "arc", elements=elements), fences, monkeypatch, compiled={"planar": planar})
    # B-splines of few elements have fewer nodes than others of their degree
    nodes, points = model.simo.meta[0, [NODES, POINTS]]
    assert nodes == points + 1 or "greville" in family or (nodes, points) == (4, 2) and family == "bspline 3 control"


@pytest.mark.parametrize("planar", [True, False], ids=["plane", "space"])
@pytest.mark.parametrize("run", [{}, {"order": 4}, {"tolerance": 1e-5}, {"static": True}, {"path": True}], ids=str)
def test_mechanism(run: dict[str, Any], planar: bool, fences: Fences, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = mechanism(plane(), sliding=not {"static", "path"} & set(run))
    assert_fences_hold(scene, fences, monkeypatch, compiled={"planar": planar}, **run)


@pytest.mark.parametrize("planar", [True, False], ids=["plane", "space"])
def test_inner_nodes_that_are_not_eliminated(planar: bool, fences: Fences, monkeypatch: pytest.MonkeyPatch) -> None:
    assert_fences_hold(flight(), fences, monkeypatch, compiled={"planar": planar, "eliminate_inner": False})


@pytest.mark.parametrize("make", [free_beam, bead])
def test_one_beam(make: Any, fences: Fences, monkeypatch: pytest.MonkeyPatch) -> None:
    assert_fences_hold(make(), fences, monkeypatch)


def test_generalised_alpha(fences: Fences, monkeypatch: pytest.MonkeyPatch) -> None:
    assert_fences_hold(mass_on_own_curve(), fences, monkeypatch, method="generalized_alpha")


@pytest.mark.parametrize("case", ["quadratic", "in a plane"])
def test_sliders_on_nets(case: str, fences: Fences, monkeypatch: pytest.MonkeyPatch) -> None:
    assert_fences_hold(net(**NETS[case]), fences, monkeypatch, step=2e-3, t_end=6e-3, threads=1,
                       compiled={"condense": True, "planar": "auto" if "plane" in case else False})
