"""Validation shared by the scene classes: every helper returns the clean value or raises a SceneError that names the object."""
from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar, Union, dataclass_transform

import numpy as np

from fastbeam.interface.arguments import (LARGEST, Number, Numbers, Refusal, Vector, constant, numbers, real, shown,  # noqa: F401
    take)
from fastbeam.interface.errors import SceneError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from fastbeam.kernels.state import State
    from fastbeam.scene.beams import Beam, NodeRef
    from fastbeam.scene.bodies import PointMass, RigidBody
    from fastbeam.scene.fixed import Ground

Array = np.ndarray
Given = TypeVar("Given", contravariant=True)
Held = TypeVar("Held", covariant=True)
Noun = TypeVar("Noun")


class Takes(Generic[Given, Held]):
    """Field that takes more types than it has, as type checkers see it: `Takes[given, held]`, a descriptor of the constructor's
    argument and of the attribute. It is never instantiated; the decorator of the class cleans the argument."""

    if TYPE_CHECKING:
        def __get__(self, owner: object, kind: type | None = None) -> Held: ...
        def __set__(self, owner: object, value: Given) -> None: ...


@dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(field,))
def noun(cls: type[Noun]) -> type[Noun]:
    """Make a frozen dataclass that is compared by identity, as all parts of scenes. Type checkers see fields that are `Takes`
    with both types (in dataclasses mypy does so only for fields with a default)."""
    made = dataclass(frozen=True, eq=False, repr=False)(cls)
    if made.__repr__ is object.__repr__:
        made.__repr__ = described  # type: ignore[method-assign]
    return made


def described(part: Any) -> str:
    """Describe a part in one line: its kind, its name, and arguments that are not the default."""
    name = getattr(part, "name", None)
    made_up = isinstance(name, str) and name.startswith(f"{part.kind} of ")
    head = name if made_up else label(part.kind, name) if name else part.kind
    # skip the second name of a slider's beam, and automatic names, which say where a part is
    skipped = {"name"} | ({"on"} if hasattr(part, "beam") else set()) | ({"a", "b", "at"} if made_up else set())
    return f"<{': '.join(filter(None, (head, ', '.join(_differing(part, skipped)))))}>"


def called_with(value: Any) -> str:
    """Write a small object as the call that makes it, without default arguments."""
    return f"{type(value).__name__}({', '.join(_differing(value, set()))})"


def _differing(part: Any, skipped: set[str]) -> list[str]:
    """Return name=value of all fields that are not the default."""
    out = []
    for x in fields(part):
        value = getattr(part, x.name)
        if not x.init or x.name in skipped or x.name.startswith("_") or np.array_equal(value, x.default):
            continue
        # the value that None stands for
        if x.default is None and (np.array_equal(value, np.eye(3)) or isinstance(value, np.ndarray) and not value.any()):
            continue
        out.append(f"{x.name}={_brief(value)}")
    return out


def _brief(value: Any) -> str:
    if isinstance(value, np.ndarray) and value.ndim == 2 and value.shape[0] == value.shape[1]:
        if np.array_equal(value, np.diag(np.diag(value))):
            return f"diagonal {shown(np.diag(value))}"
        return f"a matrix {value.shape}"
    if isinstance(value, tuple) and not all(isinstance(x, (int, float)) for x in value):
        return f"({', '.join(map(_brief, value))})"
    if isinstance(value, np.ndarray) or isinstance(value, (int, float)) and not isinstance(value, bool):
        return shown(value)
    named = getattr(value, "label", None)
    return named if isinstance(named, str) else shown(value)


# types of arguments: a function of t, a field along a beam s[n] -> [n, 3], a function of (t, state), of (t, s, rate)
TimeFactor = Callable[[float], Union[float, Array]]
OfTimeLike = Union[float, TimeFactor]
FieldLike = Union["ArrayLike", Callable[[Array], "ArrayLike"]]
Condition = Callable[[float, float, float], Union[float, np.bool_]]
UntilLike = Union[float, Callable[[float, "State"], Union[float, np.bool_]]]
WhenLike = Union[float, str, Condition]
# a node, or a part that has one; a place to observe
NodeLike = Union["NodeRef", "RigidBody", "PointMass"]
Place = Union["NodeRef", "RigidBody", "PointMass", tuple["Beam", float]]
# numbers of any kind that become arrays, nodes, bodies and masses that become nodes
ArrayField = Takes["ArrayLike", Array]
FilledArray = Takes[Union["ArrayLike", None], Array]
OptionalArray = Takes[Union["ArrayLike", None], Union[Array, None]]
FieldField = Takes[FieldLike, Union[Array, Callable[[Array], "ArrayLike"]]]
OptionalField = Takes[Union[FieldLike, None], Union[Array, Callable[[Array], "ArrayLike"], None]]
NodeField = Takes[NodeLike, "NodeRef"]
SideField = Takes[Union[NodeLike, "Ground"], "NodeRef"]


def fill(obj: Any, **values: Any) -> None:
    """Set the cleaned fields of a frozen dataclass while it is being built."""
    for key, value in values.items():
        object.__setattr__(obj, key, value)


def label(kind: str, name: str) -> str:
    """Return `kind 'name'`."""
    return f"{kind} {name!r}"


class Named:
    """Part of a scene with a name that the user gave."""

    kind: ClassVar[str]
    name: Any

    @property
    def label(self) -> str:
        """`kind 'name'`, for messages."""
        return label(self.kind, self.name)


def number(who: str, what: str, value: Any, **bounds: Any) -> float:
    """Return a finite float, optionally `above=`, `least=`, `most=`, with a `unit=`."""
    return take(Number(**bounds), f"{who}: {what}", value)


def array(who: str, what: str, value: Any, shape: tuple[int | None, ...], need: str) -> Array:
    """Return a read-only array of finite floats of the given shape (None: any size)."""
    return take(Numbers(shape, need), f"{who}: {what}", value)


def vector(who: str, what: str, value: Any) -> Array:
    """Return three finite numbers as a read-only array."""
    return take(Vector, f"{who}: {what}", value)


def direction(who: str, what: str, value: Any) -> Array:
    """Return a vector of any non-zero length with length 1."""
    clean = vector(who, what, value)
    largest = float(np.max(np.abs(clean)))
    if largest == 0.0:
        raise SceneError(f"{who}: {what} must not be zero, got {shown(value)}")
    scaled = clean / largest
    return constant(scaled / math.sqrt(float(scaled @ scaled)))


def refuse_jumps(value: Any) -> Any:
    """Return the value; raise Refusal for a table that jumps."""
    jumps = getattr(value, "_jumps", ())
    if len(jumps):
        raise Refusal(f"must not jump, but this Signal does at t = {jumps[0]:.6g} s; let the value change over some time")
    return value


def as_factor(value: Any) -> TimeFactor:
    """Check of a function t -> factor; it is tried at t = 0."""
    if not callable(value) or isinstance(value, type):
        raise Refusal(f"must be a function of t that returns a number, or None, got {shown(value)}")
    start = tried(value, "at t = 0", 0.0)
    clean = real(start)
    if clean is None or not abs(clean) <= LARGEST:
        raise Refusal(f"must return a finite number at t = 0, got {shown(start)}")
    return value


def tried(function: Callable[..., Any], where: str, *at: Any) -> Any:
    """Call a user function; if it raises an error, raise a Refusal that says so; where: text with places for the arguments."""
    try:
        return function(*at)
    except Exception as error:
        text = f"must not fail, but raises {type(error).__name__} {where.format(*at)}: {error}"
        raise Refusal(f"{text:.200}") from error


def called(who: str, what: str, function: Callable[..., Any], *at: Any, where: str = "at {:.6g}") -> Any:
    """Call a user function, as `tried`. Raises SceneError: the function raised an error."""
    try:
        return tried(function, where, *at)
    except Refusal as refusal:
        raise SceneError(f"{who}: {what} {refusal}") from refusal.__cause__


def as_field(value: Any) -> Any:
    """Check of three numbers, or a function s[n] -> [n, 3]."""
    if not callable(value):
        return Vector(value)
    if isinstance(value, type):
        raise Refusal(f"must be 3 finite numbers or a function of s[n] that returns [n, 3], got {shown(value)}")
    return value


def try_field(who: str, what: str, value: Any, length: float) -> None:
    """Try a field at four arc lengths of its beam."""
    if callable(value):
        field_values(who, what, value, np.linspace(0.0, length, 4))


def field_values(who: str, what: str, value: FieldLike, s: Array) -> Array:
    """Return values [n, 3] of a field at the arc lengths s[n]."""
    s = np.atleast_1d(np.asarray(s, dtype=float))
    if not callable(value):
        return np.tile(value, (s.size, 1))
    values = called(who, f"{what}(s)", value, s, where=f"at s = {shown(s)}")
    return np.array(array(who, f"{what}(s)", values, (s.size, 3), f"finite numbers of shape [n, 3] (here [{s.size}, 3])"))


def triad_from(who: str, d1: Array, d2_hint: Array) -> Array:
    """Return orthonormal right-handed rows d1, d2, d3: d1 kept, d2 the part of the hint orthogonal to d1."""
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
    """Return a triad on the unit tangent d1: d3 as close to e_z as possible; d2 near e_y where d1 is parallel to e_z."""
    if d2_hint is not None:
        return triad_from(who, d1, vector(who, "d2", d2_hint))
    across = np.array([-d1[1], d1[0], 0.0])          # e_z x d1
    if math.hypot(d1[0], d1[1]) < 1e-6:
        across = np.array([0.0, 1.0, 0.0])
    return triad_from(who, d1, across)


def as_rotation(value: Any) -> Array:
    """Check of orthonormal right-handed rows (3, 3); input may deviate by 1e-6 and is cleaned (nearest rotation)."""
    rows = Numbers((3, 3), "3 x 3 finite numbers (rows d1, d2, d3)")(value)
    defect = float(np.max(np.abs(rows @ rows.T - np.eye(3))))
    if defect > 1e-6:
        raise Refusal(f"must be three orthonormal rows, they deviate by {defect:.3g} (allowed: 1e-6)")
    if np.linalg.det(rows) < 0.0:
        raise Refusal("are left-handed; d3 must be d1 x d2")
    exact = np.array_equal(rows @ rows.T, np.eye(3))
    return rows if exact else constant(nearest_triads(rows))


def nearest_triads(directors: Array) -> Array:
    """Return the orthonormal triads nearest to directors in rows [..., 3, 3]."""
    u, _, v = np.linalg.svd(directors)
    return np.asarray(u @ v)


def symmetry(matrix: Array) -> tuple[Array, float, float]:
    """Return a matrix whose rows have different units scaled to a unit diagonal, its largest difference from its transpose, and
    its smallest eigenvalue."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    scaled = matrix / np.outer(*[np.where(scale > 0.0, scale, 1.0)] * 2)
    return scaled, float(np.max(np.abs(scaled - scaled.T))), float(np.linalg.eigvalsh(0.5 * (scaled + scaled.T))[0])


def rotation(who: str, what: str, value: Any) -> Array:
    """Return three finite orthonormal rows."""
    return take(as_rotation, f"{who}: {what}", value)
