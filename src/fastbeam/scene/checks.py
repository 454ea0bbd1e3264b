"""Validation shared by the nouns: every helper returns the clean value or raises a SceneError that names the object."""
from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from fastbeam.errors import SceneError

Array = np.ndarray
TimeFactor = Callable[[float], float]
Field = Array | Callable[[Array], Array]


def fill(obj: Any, **values: Any) -> None:
    """Set the cleaned fields of a frozen dataclass while it is being built."""
    for key, value in values.items():
        object.__setattr__(obj, key, value)


def constant(array: Array) -> Array:
    """A read-only contiguous float copy of `array`."""
    copy = np.array(array, dtype=float, order="C")
    copy.setflags(write=False)
    return copy


def shown(value: Any) -> str:
    """A value as a short text for messages: lists and arrays of numbers with six digits, anything else by its repr."""
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return repr(value)
    if isinstance(value, str) or value is None or array.size > 12:
        return repr(value) if array.size <= 12 else f"an array of shape {array.shape}"
    if array.ndim == 0:
        return f"{float(array):.6g}"
    if array.ndim == 1:
        return "(" + ", ".join(f"{x:.6g}" for x in array) + ")"
    return str(np.round(array, 6).tolist())


def label(kind: str, name: Any) -> str:
    """`kind 'name'`; the name must be a non-empty text."""
    if not isinstance(name, str) or not name.strip():
        raise SceneError(f"{kind}: name must be a non-empty text, got {name!r}")
    return f"{kind} {name!r}"


def number(who: str, what: str, value: Any, *, above: float | None = None, least: float | None = None, unit: str = "") -> float:
    """A finite float, optionally `> above` or `>= least`."""
    bound = "finite" if above is None and least is None else (f"> {above:g}" if above is not None else f">= {least:g}")
    tail = f" {unit}" if unit else ""
    try:
        clean = math.nan if isinstance(value, (str, bytes, bool)) else float(value)
    except (TypeError, ValueError):
        clean = math.nan
    if not math.isfinite(clean) or (above is not None and clean <= above) or (least is not None and clean < least):
        need = "a finite number" if bound == "finite" else f"a finite number {bound}{tail}"
        raise SceneError(f"{who}: {what} must be {need}, got {shown(value)}")
    return clean


def array(who: str, what: str, value: Any, shape: tuple[int, ...], need: str) -> Array:
    """A read-only array of finite floats of the given shape."""
    try:
        clean = None if isinstance(value, (str, bytes)) or value is None else np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        clean = None
    if clean is None or clean.shape != shape or not np.all(np.isfinite(clean)):
        raise SceneError(f"{who}: {what} must be {need}, got {shown(value)}")
    return constant(clean)


def vector(who: str, what: str, value: Any) -> Array:
    """Three finite numbers as a read-only array."""
    return array(who, what, value, (3,), "3 finite numbers")


def direction(who: str, what: str, value: Any) -> Array:
    """A vector of any non-zero length, returned with length 1."""
    clean = vector(who, what, value)
    largest = float(np.max(np.abs(clean)))
    if largest == 0.0:
        raise SceneError(f"{who}: {what} must not be zero, got {shown(value)}")
    scaled = clean / largest
    return constant(scaled / math.sqrt(float(scaled @ scaled)))


def choice(who: str, what: str, value: Any, options: tuple[str, ...]) -> str:
    """One of a few words."""
    if value not in options:
        listed = " or ".join(repr(option) for option in options)
        raise SceneError(f"{who}: {what} {value!r} does not exist: choose {listed}")
    return value


def time_factor(who: str, what: str, value: Any) -> TimeFactor | None:
    """A callable t -> float, finite at t = 0, or None for a constant factor 1."""
    if value is None:
        return None
    if not callable(value):
        raise SceneError(f"{who}: {what} must be a function of t that returns a number, or None, got {value!r}")
    start = value(0.0)
    try:
        finite = np.ndim(start) == 0 and math.isfinite(float(start))
    except (TypeError, ValueError):
        finite = False
    if not finite:
        raise SceneError(f"{who}: {what} must return a finite number at t = 0, got {start!r}")
    return value


def field(who: str, what: str, value: Any, length: float) -> Field:
    """Three numbers, or a callable s[n] -> [n, 3] that is tried at four arc lengths of the beam."""
    if not callable(value):
        return vector(who, what, value)
    field_values(who, what, value, np.linspace(0.0, length, 4))
    return value


def field_values(who: str, what: str, value: Field, s: Array) -> Array:
    """Values [n, 3] of a field at the arc lengths s[n]."""
    s = np.atleast_1d(np.asarray(s, dtype=float))
    if not callable(value):
        return np.tile(value, (s.size, 1))
    return np.array(array(who, f"{what}(s)", value(s), (s.size, 3), f"finite numbers of shape [n, 3] (here [{s.size}, 3])"))


def triad_from(who: str, d1: Array, d2_hint: Array) -> Array:
    """Orthonormal right-handed rows d1, d2, d3: d1 kept, d2 the part of the hint orthogonal to d1."""
    hint = direction(who, "d2", d2_hint)
    d2 = hint - (hint @ d1) * d1
    size = math.sqrt(float(d2 @ d2))
    if size < 1e-6:
        raise SceneError(f"{who}: d2={shown(d2_hint)} is parallel to the beam axis {shown(d1)}; give a direction across it")
    d2 = d2 / size
    d2 = d2 - (d2 @ d1) * d1
    d2 = d2 / math.sqrt(float(d2 @ d2))
    return constant(np.array([d1, d2, np.cross(d1, d2)]) + 0.0)          # + 0.0: no negative zeros


def default_triad(who: str, d1: Array, d2_hint: Any = None) -> Array:
    """Triad on the unit tangent d1: d3 as close to e_z as possible; d2 near e_y where d1 is parallel to e_z."""
    if d2_hint is not None:
        return triad_from(who, d1, vector(who, "d2", d2_hint))
    across = np.array([-d1[1], d1[0], 0.0])          # e_z x d1
    if math.hypot(d1[0], d1[1]) < 1e-6:
        across = np.array([0.0, 1.0, 0.0])
    return triad_from(who, d1, across)


def rotation(who: str, what: str, value: Any) -> Array:
    """Orthonormal right-handed rows (3, 3); input may deviate by 1e-6 and is cleaned (nearest rotation)."""
    rows = array(who, what, value, (3, 3), "3 x 3 finite numbers (rows d1, d2, d3)")
    defect = float(np.max(np.abs(rows @ rows.T - np.eye(3))))
    if defect > 1e-6:
        raise SceneError(f"{who}: {what} must be three orthonormal rows, they deviate by {defect:.3g} (allowed: 1e-6)")
    if np.linalg.det(rows) < 0.0:
        raise SceneError(f"{who}: {what} are left-handed; d3 must be d1 x d2")
    exact = np.array_equal(rows @ rows.T, np.eye(3))
    left, _, right = np.linalg.svd(rows)
    return rows if exact else constant(left @ right)
