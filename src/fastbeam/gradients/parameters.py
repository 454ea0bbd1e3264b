"""Scenes as functions of parameters: the scene at given values, scenes around it, and derivatives over them (theory.md 13)."""
from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from fastbeam.compile.compile import compile_scene
from fastbeam.interface.arguments import LARGEST, Refusal, number, shown
from fastbeam.interface.errors import SceneError
from fastbeam.interface.synonyms import known
from fastbeam.model.model import Model
from fastbeam.scene import Scene
from fastbeam.scene.checks import Place

Array = np.ndarray
# a function of parameters that returns a scene, or a scene and points to observe
Build = Callable[..., Scene | tuple[Scene, Mapping[str, Place]]]
# a parameter is changed by multiples of this share of its size, a power of two
SHARE = 2.0**-8
# central differences of order 6 on the changes -3 to 3, and of order 4 on the inner four of them
CHANGES = (-3, -2, -1, 1, 2, 3)
SIXTH = np.array([-1.0, 9.0, -45.0, 45.0, -9.0, 1.0]) / 60.0
# a scene is no smooth function of a parameter where these differ by more than this share
SMOOTH = 1e-5
FOURTH = np.array([0.0, 1.0, -8.0, 8.0, -1.0, 0.0]) / 12.0


def which_build(value: Any) -> Build:
    """Check that an argument is a function. Raises Refusal."""
    if not callable(value) or isinstance(value, type):
        raise Refusal(f"must be a function that takes the parameters by their names and returns a scene, got {shown(value)}")
    return value


class Built(NamedTuple):
    """A scene at values of its parameters."""

    model: Model
    points: dict[str, Place]   # what to observe, by names


class Family:
    """The scenes that a function builds.

    build: its keyword arguments are the parameters; it returns a scene, or a scene and a mapping of names to points.
    scale: sizes of parameters; default: those of their values.
    who: the function that is called, for messages.
    """

    def __init__(self, build: Build, values: Mapping[str, float], scale: Mapping[str, float], who: str = "sensitivity") -> None:
        self._build, self.values, self._who = build, dict(values), who
        for name in scale:
            if name not in values:
                raise SceneError(f"{self._who}, scale: there is no parameter {name!r}; values has {known(values, name)}")
        self.steps = {}
        for name, value in values.items():
            size = abs(scale.get(name, value))
            if size == 0.0:
                raise SceneError(f"{self._who}: parameter {name!r} is 0, so the size of a small change of it is unknown; give "
                                 f"scale={{{name!r}: ...}}, a relevant change in its unit")
            self.steps[name] = SHARE * size
        scene, points = self.called({})
        # the model for whoever solves, and the one in whose tables nothing is eliminated
        self.model, self.points = compile_scene(scene), points
        check_values(values, who)
        self._base: dict[bool, Built] = {}
        self._around: dict[tuple[str, bool], list[Built]] = {}

    def called(self, changed: Mapping[str, float]) -> tuple[Scene, dict[str, Place]]:
        """Call build with changed values; return the scene and its points. Raises SceneError: it failed, or returned something
        else."""
        try:
            out = self._build(**{**self.values, **changed})
        except SceneError:
            raise
        except TypeError as error:
            raise SceneError(f"{self._who}, build: could not be called with {known(self.values)}: {error}") from error
        scene, points = out if isinstance(out, tuple) and len(out) == 2 else (out, {})
        if not isinstance(scene, Scene) or not isinstance(points, Mapping):
            raise SceneError(f"{self._who}, build: must return a Scene, or a Scene and a mapping of names to points, got "
                             f"{shown(out)}")
        return scene, dict(points)

    def base(self, flat: bool) -> Built:
        """Return the scene at the values, with tables in which nothing is eliminated."""
        if flat not in self._base:
            self._base[flat] = self._built({}, flat)
        return self._base[flat]

    def around(self, name: str, flat: bool) -> list[Built]:
        """Return six scenes in which parameter `name` is less and more, by `CHANGES` of its step, with tables in which nothing is
        eliminated. Raises SceneError: they have other parts, nodes or supports than the scene at the values."""
        key = name, flat
        if key not in self._around:
            self._around[key] = [self._built({name: self.values[name] + k * self.steps[name]}, flat) for k in CHANGES]
            for built in self._around[key]:
                self.check_alike(name, self.is_alike(self.base(flat).model, built.model)
                                 and list(self.points) == list(built.points))
        return self._around[key]

    def _built(self, changed: Mapping[str, float], flat: bool) -> Built:
        scene, points = self.called(changed)
        model = compile_scene(scene, solver="sparse", eliminate_inner=False, condense=False, planar="auto" if flat else False)
        return Built(replace(model, uneliminated=_Itself(model)), points)

    def check_alike(self, name: str, is_alike: bool) -> None:
        """Refuse a parameter around whose value the scene has other parts. Raises SceneError."""
        if not is_alike:
            raise SceneError(f"{self._who}: parameter {name!r} changes the parts, nodes, supports, joints or points of the "
                             "scene, so no derivative exists. Let build return the same parts with the same elements for all "
                             "values near the given ones")

    @staticmethod
    def is_alike(base: Model, other: Model) -> bool:
        """Return whether two models have the same parts, nodes, supports, joints and loads."""
        same = _parts(base) == _parts(other) and base.constraint_names == other.constraint_names
        same = same and base.reaction_names == other.reaction_names
        same = same and np.array_equal(base.fixed_mask, other.fixed_mask) and len(base.load_times) == len(other.load_times)
        return same and np.array_equal(base.spin_root, other.spin_root) and np.array_equal(base.spinless, other.spinless)

    def slope(self, name: str, six: Any) -> Array:
        """Return the derivative by parameter `name` of values in the six scenes, with an error of order 6 in the change."""
        return np.tensordot(SIXTH, np.asarray(six), 1) / self.steps[name]

    def check_smooth(self, name: str, six: Any, weights: Array, noise: float) -> None:
        """Refuse a parameter where differences of order 4 and 6 of values in the six scenes disagree by more than noise; weights:
        of rows. Raises SceneError."""
        six = np.asarray(six, dtype=float)
        fine, coarse = (weights * np.tensordot(w, six, 1) for w in (SIXTH, FOURTH))
        if not np.linalg.norm(fine - coarse) <= SMOOTH * np.linalg.norm(fine) + noise:
            raise SceneError(f"{self._who}: the scene does not depend smoothly on parameter {name!r} near {self.values[name]:g}: "
                             "differences of order 4 and 6 disagree. Look for jumps and kinks in build (rounding, min, max), or "
                             "give a smaller scale={...}")


class _Itself:
    """Compiler of a model that has nothing eliminated: it returns the model itself."""

    def __init__(self, model: Model) -> None:
        self._model, self._in_space = model, replace(model, plane=None)

    def __call__(self, planar: Any) -> Model:
        return self._model if planar else self._in_space


def _parts(model: Model) -> list[tuple[Any, ...]]:
    """Return parts with nodes, and where these are."""
    known = ("name", "first", "count", "node", "starts")
    return [(kind, *(entry.get(key) for key in known)) for kind in ("beams", "nets", "bodies", "masses")
            for entry in model.names.get(kind, [])]


def numbers_of(who: str, values: Mapping[str, Any], scale: Mapping[str, Any] | None) -> tuple[dict[str, float], dict[str, float]]:
    """Return values and sizes of parameters. Raises SceneError: one is no number."""
    out, sizes = ({name: number(f"{who}, {kind}: parameter {name!r}", x) for name, x in given.items()}
                  for kind, given in (("values", values), ("scale", scale or {})))
    return out, sizes


def check_values(values: Mapping[str, Any], who: str) -> None:
    """Refuse numbers that are too large to be changed. Raises SceneError."""
    for name, value in values.items():
        if not abs(value) <= LARGEST:
            raise SceneError(f"{who}, values: parameter {name!r} must be a finite number, got {shown(value)}")
