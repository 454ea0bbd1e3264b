"""Files that compiled code of terms from outside this package depends on.

The folder of compiled kernels carries a hash of this package. A kernel that takes a term whose class or implementations stand
elsewhere depends on those files too, so it is kept under a hash of them: an edit there compiles it again, and processes that do
not know the class never read such an entry.
"""
from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

PACKAGE = __name__.split(".", 1)[0]
# implementations of generic functions by the class from outside that they are registered for
_IMPLEMENTATIONS: dict[type, list[FunctionType]] = {}
# called when the first of them is registered
AT_FIRST: list[Callable[[], None]] = []
CONSTANTS = (bool, int, float, complex, str, bytes, tuple)


def is_outside(thing: Any) -> bool:
    """Return whether a class or function belongs to another package."""
    return str(getattr(thing, "__module__", PACKAGE)).split(".", 1)[0] != PACKAGE


def is_term(thing: Any) -> bool:
    """Return whether an object is a class of named tuples from outside."""
    return isinstance(thing, type) and issubclass(thing, tuple) and hasattr(thing, "_fields") and is_outside(thing)


def note(name: str, classes: tuple[Any, ...], function: Any) -> None:
    """Record an implementation of the generic function `name` that comes from outside. Raises TypeError: it is not compiled, or
    it is registered for classes of this package alone, whose kernels would not notice."""
    source = getattr(function, "py_func", None)
    if source is None:
        if is_outside(function):
            raise TypeError(f"{name}.register: {getattr(function, '__name__', function)} is no kernel; write @kernel below "
                            f"@{name}.register(...)")
        return
    if not is_outside(source):
        return
    terms = [x for x in classes if is_term(x)]
    if not terms:
        given = ", ".join(str(getattr(x, "__name__", x)) for x in classes) or "nothing"
        raise TypeError(f"{name}.register: {source.__name__} is registered for {given}, and none of these is a named tuple of "
                        "your own; what fastbeam does with its classes cannot be replaced")
    if not _IMPLEMENTATIONS:
        for call in AT_FIRST:
            call()
    for x in terms:
        _IMPLEMENTATIONS.setdefault(x, []).append(source)


def known() -> bool:
    """Return whether there are terms from outside."""
    return bool(_IMPLEMENTATIONS)


def classes_of(types: Any) -> list[type]:
    """Return classes from outside among types of arguments and their items."""
    found: dict[type, None] = {}

    def look(kind: Any) -> None:
        of = getattr(kind, "instance_class", None)
        if of is not None:
            found.update((x, None) for x in of.__mro__ if is_term(x))
        inner = getattr(kind, "of", None)
        for x in (inner,) if inner is not None else getattr(kind, "types", None) or ():
            look(x)

    for kind in types:
        look(kind)
    return list(found)


def modules(types: Any) -> list[str]:
    """Return names of the modules that these classes and their implementations come from."""
    found = {x.__module__ for of in classes_of(types) for x in (of, *_IMPLEMENTATIONS.get(of, ()))}
    return sorted(found)


def digest(function: FunctionType, types: Any) -> str | None:
    """Return a hash of all files outside this package that a kernel with arguments of these types depends on; "" if there are
    none, None if code has no file: such a kernel is not kept."""
    classes = classes_of(types)
    if not classes and not is_outside(function):
        return ""
    whole = hashlib.sha256()
    sources = [function] if is_outside(function) else []
    sources += [x for of in classes for x in _IMPLEMENTATIONS.get(of, ())]
    parts = {_text(of) for of in classes}
    for source in sources:
        parts.update(_reached(source))
    if None in parts:
        return None
    for part in sorted(x for x in parts if x is not None):
        whole.update(part.encode())
    return whole.hexdigest()[:16]


@cache
def _text(thing: Any) -> str | None:
    """Return the hash of the file of a class, function or module; None: it has no file, or is in the program itself, whose
    classes are other objects in every process."""
    if getattr(thing, "__module__", None) == "__main__":
        return None
    try:
        return hashlib.sha256(Path(inspect.getfile(thing)).read_bytes()).hexdigest()
    except (OSError, TypeError):
        return None


@cache
def _reached(function: FunctionType) -> frozenset[str | None]:
    """Return hashes of the files of a function and of all from outside that it calls, and the constants that they name."""
    found: dict[FunctionType, None] = {}
    out: set[str | None] = set()
    rest = [function]
    while rest:
        one = rest.pop()
        if one in found:
            continue
        found[one] = None
        out.add(_text(one))
        for name, value in _named(one):
            value = getattr(value, "py_func", value)
            if isinstance(value, FunctionType) and is_outside(value):
                rest.append(value)
            elif isinstance(value, ModuleType) and value.__name__.split(".", 1)[0] not in (PACKAGE, "numpy", "math"):
                out.add(_text(value))
            elif isinstance(value, CONSTANTS):
                out.add(f"{name} {value!r}")
            elif hasattr(value, "tobytes"):
                out.add(f"{name} {value.dtype} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}")
    return frozenset(out)


def _named(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield global names of a function's source and those that it closes over, with their values."""
    for name in function.__code__.co_names:
        if name in function.__globals__:
            yield name, function.__globals__[name]
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or ()):
        yield name, cell.cell_contents

