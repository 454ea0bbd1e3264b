"""Arguments of public calls: kinds of arguments, and the decorator that checks them.

A kind is called with a value and returns it clean, or raises `Refusal` with the rest of a sentence that begins with the name of
the argument. `@checked(mass=Number(above=0.0, unit="kg"))` checks the argument `mass` of a function, or of the constructor of a
class; None stands where it is the default. Nothing is allocated before sizes are compared.
"""
from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache, wraps
from inspect import Parameter, signature
from itertools import chain
from pathlib import Path
from types import FunctionType
from typing import Any, TypeVar

import numpy as np

from fastbeam.interface.errors import SceneError
from fastbeam.interface.synonyms import instead, listed, nearest

Array = np.ndarray
T = TypeVar("T")
# beyond these, products of a few numbers leave the range of doubles
SMALLEST, LARGEST = 1e-60, 1e60
LONGEST_RANGE = 10**7
# types that float() accepts although they are no real numbers
NO_NUMBERS = (str, bytes, bytearray, bool, np.bool_, complex, np.complexfloating, np.datetime64, np.timedelta64, type)


class Refusal(ValueError):
    """Error that says why a value is not usable: the rest of a sentence that begins with the name of its argument."""


def shown(value: Any) -> str:
    """Return a value as a short text for messages: numbers with six digits, anything else by its repr, cut."""
    array = None if isinstance(value, (str, bytes, type)) or value is None else numbers(value)
    if array is not None and array.size > 12:
        return f"an array of shape {array.shape}"
    if array is not None and array.ndim == 0:
        text = f"{float(array):.6g}"
        return f"{text}.0" if isinstance(value, (float, np.floating)) and text.lstrip("-").isdigit() else text
    if array is not None and array.ndim == 1:
        return ("[{}]" if isinstance(value, list) else "({})").format(", ".join(f"{x:.6g}" for x in array))
    if array is not None:
        return str(np.round(array, 6).tolist())
    if isinstance(value, np.ndarray) and value.size > 12:
        return f"an array of {value.dtype} of shape {value.shape}"
    try:
        text = "a function" if isinstance(value, FunctionType) else " ".join(repr(value).split())
        label = getattr(value, "label", None) if len(text) > 60 else None
        text = label if isinstance(label, str) else text
        kind = type(value).__name__
        if len(text) > 60 and text.startswith(f"{kind}(") or " object at 0x" in text:
            # its contents do not help to recognise it
            text = f"{'an' if kind[:1] in 'AEIOUaeiou' else 'a'} {kind}"
    except Exception:          # whatever a foreign repr does, or a whole number with too many digits
        text = f"a {type(value).__name__}"
    return text if len(text) <= 100 else text[:97] + "..."


def is_masked(value: Any) -> bool:
    """Return whether a value is a masked array; without a look at `numpy.ma`, which takes a while to load."""
    return isinstance(value, np.ndarray) and hasattr(value, "mask")


def real(value: Any) -> float | None:
    """Return the value as a float if it is one real number, else None."""
    if type(value) is float:
        return value
    if isinstance(value, NO_NUMBERS):
        return None
    if isinstance(value, np.ndarray) and (value.ndim or value.dtype.kind not in "iuf" or is_masked(value)):
        return None
    try:
        return float(value)
    except Exception:          # whatever the __float__ of a foreign object raises
        return None


def whole(value: Any) -> int | None:
    """Return the value as an int if it is a whole number by its type, else None."""
    # timedelta64 is an integer to NumPy
    if isinstance(value, (bool, np.timedelta64)) or not isinstance(value, (int, np.integer)):
        return None
    return int(value)


def numbers(value: Any) -> Array | None:
    """Return the value as an array of floats if it holds nothing but real numbers, else None."""
    if isinstance(value, (str, bytes, bytearray, memoryview, bool)) or value is None or is_masked(value):
        return None
    if isinstance(value, range) and len(value[:LONGEST_RANGE + 1]) > LONGEST_RANGE:
        return None
    try:
        raw = np.asarray(value)
    except Exception:          # ragged lists, and errors of foreign objects
        return None
    if raw.dtype.kind in "iuf":
        if isinstance(value, (list, tuple)) and hides_others(value):
            return None
        if raw.dtype == float:
            return raw
        with np.errstate(over="ignore"):
            return raw.astype(float)
    if raw.dtype.kind == "O" and raw.ndim and 0 < raw.size <= 10_000:
        items = [real(x) for x in raw.reshape(-1)]
        return None if None in items else np.array(items, dtype=float).reshape(raw.shape)
    return None


def hides_others(value: list[Any] | tuple[Any, ...]) -> bool:
    """Return whether a list has truth values, which pass for 0 and 1 among numbers, or masked arrays, at any depth; by the types
    of its entries, since a net may have a million."""
    kinds = set(map(type, value))
    if any(issubclass(kind, (bool, np.bool_)) or hasattr(kind, "mask") for kind in kinds):
        return True
    arrays = [x for x in value if isinstance(x, np.ndarray)] if any(issubclass(kind, np.ndarray) for kind in kinds) else []
    if any(x.dtype.kind == "b" for x in arrays):
        return True
    inner = [x for x in value if isinstance(x, (list, tuple))] if any(issubclass(kind, (list, tuple)) for kind in kinds) else []
    return bool(inner) and hides_others(list(chain.from_iterable(inner)))


def constant(array: Array) -> Array:
    """Return a read-only contiguous float copy of `array`."""
    copy = np.array(array, dtype=float, order="C")
    copy.setflags(write=False)
    return copy


# --- kinds ------------------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Anything:
    """Kind of a value that the call itself checks."""

    def __call__(self, value: Any) -> Any:
        return value


@dataclass(frozen=True)
class Number:
    """Kind of a finite real number, `> above`, `>= least`, `<= most`; its size is 0 or from 1e-60 to 1e60."""

    above: float | None = None
    least: float | None = None
    most: float | None = None
    unit: str = ""

    def __call__(self, value: Any) -> float:
        x = real(value)
        bounds = ((">", self.above), (">=", self.least), ("<=", self.most))
        bound = " and".join(f" {sign} {size:g}" for sign, size in bounds if size is not None)
        need = f"must be a finite number{bound}{f' {self.unit}' if self.unit and bound else ''}"
        if x is None or not math.isfinite(x):
            hint = "; real numbers only" if isinstance(value, (complex, np.complexfloating)) else ""
            raise Refusal(f"{need}, got {shown(value)}{hint}")
        if ((self.above is not None and not x > self.above) or (self.least is not None and not x >= self.least)
                or (self.most is not None and not x <= self.most)):
            raise Refusal(f"{need}, got {shown(value)}")
        if x != 0.0 and not SMALLEST <= abs(x) <= LARGEST and (abs(x) > 1.0 or self.above is not None):
            raise Refusal(f"{need} with a size from {SMALLEST:g} to {LARGEST:g}, got {shown(value)}; choose other units")
        return x


@dataclass(frozen=True)
class Count:
    """Kind of a whole number from `least` to `most`."""

    least: int = 1
    most: int = 10**15

    def __call__(self, value: Any) -> int:
        n = whole(value)
        if n is None or n < self.least:
            raise Refusal(f"must be a whole number >= {self.least}, got {shown(value)}")
        if n > self.most:
            raise Refusal(f"must be a whole number from {self.least} to {self.most:g}, got {shown(value)}")
        return n


@dataclass(frozen=True)
class Flag:
    """Kind of True or False, or one of a few words beside them."""

    words: tuple[str, ...] = ()

    def __call__(self, value: Any) -> bool | str:
        if isinstance(value, (bool, np.bool_)):
            return bool(value)
        if isinstance(value, str) and value in self.words:
            return value
        listed = "".join(f"{word!r}, " for word in self.words)[:-2]
        raise Refusal(f"must be {listed + ', ' if listed else ''}True or False, got {shown(value)}")


@dataclass(frozen=True)
class Word:
    """Kind of one of a few words; without a list any text."""

    options: tuple[str, ...] = ()

    def __call__(self, value: Any) -> str:
        if not isinstance(value, str):
            raise Refusal(f"must be {_either(self.options) or 'a text'}, got {shown(value)}")
        if self.options and value not in self.options:
            close = nearest(value, self.options)
            raise Refusal(f"{value!r:.60} does not exist: choose {_either(self.options)}{close and f'; did you mean {close!r}?'}")
        return str(value)


def _either(words: tuple[str, ...]) -> str:
    """Return "'a', 'b' or 'c'" for words a, b, c."""
    listed = [repr(word) for word in words]
    return " or ".join([", ".join(listed[:-1]), listed[-1]]) if len(listed) > 1 else "".join(listed)


@dataclass(frozen=True)
class Name:
    """Kind of a text that is not empty."""

    otherwise: str = "the name comes first"

    def __call__(self, value: Any) -> str:
        if not isinstance(value, str) or not value.strip():
            hint = "" if isinstance(value, str) or value is None else f"; {self.otherwise}"
            raise Refusal(f"must be a non-empty text, got {shown(value)}{hint}")
        return str(value)


@dataclass(frozen=True)
class FilePath:
    """Kind of a text or path; the code that opens the file checks it."""

    def __call__(self, value: Any) -> Path:
        try:
            text = os.fspath(value)
        except Exception:          # no path, or whatever a foreign __fspath__ raises
            text = None
        if not isinstance(text, str) or not text or "\0" in text:
            raise Refusal(f"must be the path of a file, a text or a pathlib.Path, got {shown(value)}")
        return Path(text)


@dataclass(frozen=True)
class Function:
    """Kind of a function of `arguments`, such as 't'."""

    arguments: str
    returns: str = ""

    def __call__(self, value: Any) -> Any:
        need = f"must be a function of {self.arguments}{f' that returns {self.returns}' if self.returns else ''}"
        if not callable(value) or isinstance(value, type):
            raise Refusal(f"{need}, got {shown(value)}")
        given = self.arguments.strip("()").split(",")
        if isinstance(value, np.ufunc) and value.nin != len(given):
            raise Refusal(f"{need}, got {shown(value)}")
        try:
            wanted = signature(value)
        except (TypeError, ValueError):
            return value          # some built-in functions have none
        try:
            wanted.bind(*given)
        except TypeError:
            raise Refusal(f"{need}, got one of {wanted}") from None
        return value


@dataclass(frozen=True)
class Instance:
    """Kind of an object of one of some classes."""

    classes: type | tuple[type, ...]
    need: str
    hint: str = ""

    def __call__(self, value: Any) -> Any:
        if not isinstance(value, self.classes):
            raise Refusal(f"must be {self.need}, got {shown(value)}{f'; {self.hint}' if self.hint else ''}")
        return value


@dataclass(frozen=True)
class Numbers:
    """Kind of a read-only array of finite real numbers; None in its shape: any size."""

    shape: tuple[int | None, ...]
    need: str

    def __call__(self, value: Any) -> Array:
        clean = numbers(value)
        fits = clean is not None and clean.ndim == len(self.shape) and all(
            a in (None, b) for a, b in zip(self.shape, clean.shape))
        if clean is None or not fits or not (np.abs(clean) <= LARGEST).all():
            # finite, and still too large
            huge = f" of at most {LARGEST:g} in size" if fits and np.isfinite(clean).all() else ""
            raise Refusal(f"must be {self.need}{huge}, got {shown(value)}")
        return constant(clean)


@dataclass(frozen=True)
class Maybe:
    """Kind of another kind or None, where None is not the default."""

    kind: Callable[[Any], Any]

    def __call__(self, value: Any) -> Any:
        return None if value is None else self.kind(value)


Vector = Numbers((3,), "3 finite numbers")


@dataclass(frozen=True)
class Listing:
    """Kind of several values of one kind, as a tuple; a text is none."""

    of: Any
    need: str
    most: int = 10_000

    def __call__(self, value: Any) -> tuple[Any, ...]:
        if isinstance(value, (str, bytes, Mapping, type)) or not isinstance(value, Iterable) or (
                isinstance(value, np.ndarray) and value.ndim == 0):
            raise Refusal(f"must be {self.need}, got {shown(value)}")
        items = []
        for k, item in enumerate(value):
            if k == self.most:
                raise Refusal(f"must be {self.need}, at most {self.most}, got more than that")
            items.append(self.of(item))
        return tuple(items)


@dataclass(frozen=True)
class Names:
    """Kind of a mapping from names to values that the call itself checks, as a dict."""

    need: str

    def __call__(self, value: Any) -> dict[str, Any]:
        if not isinstance(value, Mapping):
            raise Refusal(f"{self.need}, got {shown(value)}")
        wrong = [key for key in value if not isinstance(key, str) or not key.strip()]
        if wrong:
            raise Refusal(f"{self.need}; {shown(wrong[0])} is not a name")
        return dict(value)


# --- the decorator ----------------------------------------------------------------------------------------------------------
def checked(**kinds: Callable[[Any], Any]) -> Callable[[T], T]:
    """Check the arguments of a function, method, or constructor of a class by their names, before it runs. Raises SceneError: the
    call raises it: an argument is not of its kind, is missing, is unknown, or came without a name where it needs one."""
    def decorate(target: Any) -> Any:
        if isinstance(target, type):
            target.__init__ = _checked(target.__init__, kinds)  # type: ignore[misc]
            return target
        return _checked(target, kinds)
    return decorate


def _checked(function: Any, kinds: dict[str, Any]) -> Any:
    parameters = list(signature(function).parameters.values())
    bound = int(bool(parameters) and parameters[0].name in ("self", "cls"))
    named = [p for p in parameters[bound:] if p.kind in (Parameter.POSITIONAL_OR_KEYWORD, Parameter.KEYWORD_ONLY)]
    positional = [p.name for p in named if p.kind is Parameter.POSITIONAL_OR_KEYWORD]
    every = next((p.name for p in parameters if p.kind is Parameter.VAR_POSITIONAL), None)
    more = any(p.kind is Parameter.VAR_KEYWORD for p in parameters)
    names = {p.name for p in named}
    required = [p.name for p in named if p.default is Parameter.empty]
    must, optional = set(required), {p.name for p in named if p.default is None}
    # defaults are cleaned once
    defaults = {p.name: kinds[p.name](p.default) for p in named
                if p.name in kinds and p.default is not None and p.default is not Parameter.empty}
    visible = [name for name in (p.name for p in named) if not name.startswith("_")]

    @cache
    def known() -> tuple[list[str], list[str]]:
        """Return arguments to name in messages, and which of them are needed: also those that go on to another call."""
        if not more:
            return visible, required
        full = [p for p in signature(call).parameters.values() if p.kind is not Parameter.VAR_KEYWORD][bound:]
        return [p.name for p in full], [p.name for p in full if p.default is Parameter.empty]

    @wraps(function)
    def call(*args: Any, **given: Any) -> Any:
        own, args = args[:bound], args[bound:]
        extra = args[len(positional):]
        if extra and every is None:
            others = [n for n in known()[0] if n not in positional]
            raise SceneError(f"{_subject(function, own, given)}: takes {listed(positional)} without a name, got {len(args)} "
                             f"arguments; give the others by name: {listed(others, '=...')}")
        for name, value in zip(positional, args):
            if name in given:
                raise SceneError(f"{_subject(function, own, given)}: {name} was given twice, without and with its name")
            given[name] = value
        if not given.keys() <= (names | kinds.keys() if more else names):
            unknown = next(name for name in given if name not in names and not (more and name in kinds))
            raise SceneError(f"{_subject(function, own, given)}: has no argument {unknown!r}{instead(unknown, known()[0])}")
        if more or not given.keys() >= must:
            lacking = [name for name in known()[1] if name not in given]
            if lacking:
                raise SceneError(f"{_subject(function, own, given)}: {listed(lacking)} missing; it takes {listed(known()[0])}")
        try:
            for name, kind in kinds.items():
                if name in given and (given[name] is not None or name not in optional):
                    given[name] = kind(given[name])
            if every in kinds:
                name = every
                extra = tuple(kinds[every](value) for value in extra)
        except Refusal as refusal:
            who = _subject(function, own, given)
            what = f"{who}, {name}:" if who == function.__name__ else f"{who}:" if name == every else f"{who}: {name}"
            raise SceneError(f"{what} {refusal}") from refusal.__cause__
        for name, value in defaults.items():
            given.setdefault(name, value)
        return function(*own, *extra, **given)

    call.kinds = kinds  # type: ignore[attr-defined]
    return call


def spell_out(function: Any, of: Any) -> None:
    """Write into the signature of a function that hands on `**more` to a constructor the arguments that it stands for, for help
    and editors."""
    own = [p for p in signature(function).parameters.values() if p.kind is not Parameter.VAR_KEYWORD]
    have = {p.name for p in own}
    more = [p for p in signature(of).parameters.values() if p.kind is Parameter.KEYWORD_ONLY and p.name not in have]
    function.__signature__ = signature(function).replace(parameters=[*own, *more])


def _subject(function: Any, own: tuple[Any, ...], given: dict[str, Any]) -> str:
    """Return the subject of a message: a part by its kind and name, else the function."""
    if not own:
        return function.__name__
    kind, name = getattr(own[0], "kind", type(own[0]).__name__), given.get("name", (function.__kwdefaults__ or {}).get("name"))
    if function.__name__ == "__init__" or isinstance(own[0], type):
        if isinstance(name, str) and name.strip():
            return f"{kind} {name!r:.60}"
        beam = given.get("beam")
        of = getattr(beam, "label", None) if getattr(beam, "kind", None) == "beam" else None
        return function.__qualname__ if isinstance(own[0], type) else f"{kind} of {of}" if isinstance(of, str) else kind
    return getattr(own[0], "label", f"{type(own[0]).__name__}.{function.__name__}")


# --- single checks of code that is no public call ---------------------------------------------------------------------------
def take(kind: Callable[[Any], Any], subject: str, value: Any) -> Any:
    """Return `value` as a kind; raise a SceneError that begins with `subject` if it is not."""
    try:
        return kind(value)
    except Refusal as refusal:
        raise SceneError(f"{subject} {refusal}") from refusal.__cause__


def number(name: str, value: Any) -> float:
    """Return a finite number as a float. Raises SceneError: texts, truth values, complex numbers, NaN, infinities, anything that
    is not one number."""
    return take(Number(), f"{name}:", value)


def count(name: str, value: Any, least: int = 1) -> int:
    """Return a whole number >= `least`. Raises SceneError: anything else, floats and truth values too."""
    return take(Count(least), f"{name}:", value)
