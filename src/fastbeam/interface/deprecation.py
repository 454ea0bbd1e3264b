"""Old names and arguments that go on working for two minor versions (CONTRIBUTING.md), with a FutureWarning.

A public name that changes gets an entry in `RENAMED`; an argument that changes, `@deprecated("0.2", old="new")` above the call; a
function or method that goes, `@deprecated("0.2", instead="what to write")`.
"""
from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from functools import wraps
from types import ModuleType
from typing import Any, NamedTuple, TypeVar

T = TypeVar("T", bound=Callable[..., Any])
# minor versions for which an old name works, beginning with the one that renames it
KEPT = 2


class Renamed(NamedTuple):
    """New name of a public name, and the minor version, as "0.2", that renamed it."""

    new: str
    since: str


# old public name of the package -> Renamed
RENAMED: dict[str, Renamed] = {}
# modules that pages of 0.1 named; their classes and errors are names of the package now
MODULES = ("adjoint", "critical_slopes", "errors", "mode_shapes", "responses", "sensitivities")


def gone(since: str) -> str:
    """Return the minor version that no longer knows an old name that `since` replaced: gone("0.2") is "0.4". Raises ValueError:
    `since` is no version as "0.2"."""
    parts = since.split(".")
    if len(parts) != 2 or not all(part.isdecimal() for part in parts):
        raise ValueError(f"since: a minor version as \"0.2\" is needed, got {since!r}")
    return f"{parts[0]}.{int(parts[1]) + KEPT}"


def new_name(old: str) -> str | None:
    """Return the present name of a public name of earlier versions, with a FutureWarning; None for a name that never was."""
    found = RENAMED.get(old)
    if found is None:
        return None
    _warn(f"fastbeam.{old} is called fastbeam.{found.new} now", found.since, 4)
    return found.new


class OldModules:
    """Finder and loader of `MODULES`, whose names are those of the package, with a FutureWarning."""

    @staticmethod
    def find_spec(name: str, path: Any = None, target: Any = None) -> Any:
        """Return the spec of one of `MODULES`; None for others."""
        package, _, module = name.partition(".")
        if package != "fastbeam" or module not in MODULES:
            return None
        from importlib.util import spec_from_loader
        return spec_from_loader(name, OldModules)  # type: ignore[arg-type]

    @staticmethod
    def create_module(spec: Any) -> None:
        """Leave it to Python."""

    @staticmethod
    def exec_module(module: ModuleType) -> None:
        """Give the module the public names of the package."""
        def get(name: str) -> Any:
            import fastbeam
            if name not in fastbeam.__all__:
                raise AttributeError(f"module {module.__name__!r} has no attribute {name!r}")
            _warn(f"{module.__name__}.{name} is called fastbeam.{name} now", "0.2", 3)
            return getattr(fastbeam, name)
        module.__getattr__ = get  # type: ignore[method-assign]


def deprecated(since: str, /, *, instead: str = "", **renamed: str) -> Callable[[T], T]:
    """Accept arguments of the decorated function or class, `old="new"`, by their old names, too; without any, the call itself is
    deprecated, and `instead` says what to write. It stands above `@checked`.

    since: the minor version that renames, as "0.2".
    Raises ValueError: neither `instead` nor a renamed argument, or both; `since` is no version.
    Raises TypeError: of the decorated call: an argument is given by both names.
    """
    gone(since)
    if bool(instead) == bool(renamed):
        raise ValueError("deprecated: name what to write instead, or renamed arguments")

    def wrap(call: Any, name: str) -> Any:
        @wraps(call)
        def warned(*args: Any, **given: Any) -> Any:
            if instead:
                _warn(f"{name} is deprecated; write {instead}", since, 3)
            for old, new in renamed.items():
                if old in given:
                    if new in given:
                        raise TypeError(f"{name}: {old} is the old name of {new}; give {new} alone")
                    _warn(f"{name}: the argument {old} is called {new} now", since, 3)
                    given[new] = given.pop(old)
            return call(*args, **given)
        return warned

    def decorate(thing: Any) -> Any:
        if isinstance(thing, type):
            thing.__init__ = wrap(thing.__init__, thing.__name__)  # type: ignore[misc]
            return thing
        return wrap(thing, thing.__name__)

    return decorate


# a group of arguments: the argument that takes it, its class, and the name of an old argument there
Grouped = Mapping[str, tuple[str, type, str]]


def regroup(subject: str, since: str, old: Grouped, given: dict[str, Any], level: int = 2) -> dict[str, Any]:
    """Return arguments of a call with the old ones put into the groups that took their place, with a FutureWarning.

    Raises TypeError: an old argument is given beside its group.
    Raises SceneError: a group refuses its arguments.
    """
    from inspect import signature  # takes a third of the time of `import fastbeam`
    out = {name: value for name, value in given.items() if name not in old}
    groups: dict[str, tuple[type, dict[str, Any]]] = {}
    for name in (name for name in given if name in old):
        place, group, new = old[name]
        if isinstance(given.get(place), group):
            raise TypeError(f"{subject}: {name} is {new} of {group.__name__} now; give it there alone")
        first = {} if given.get(place) is None else {next(iter(signature(group).parameters)): given[place]}
        groups.setdefault(place, (group, first))[1][new] = given[name]
    if not groups:
        return out
    texts = (f"{place}={group.__name__}({', '.join(f'{name}=...' for name in values)})" for place,
             (group, values) in groups.items())
    have = ", ".join(name for name in given if name in old)
    _warn(f"{subject}: arguments went into groups; instead of {have} write {', '.join(texts)}", since, level + 1)
    return out | {place: group(**values) for place, (group, values) in groups.items()}


def regrouped(since: str, old: Grouped) -> Callable[[T], T]:
    """Accept arguments of the decorated function that went into groups by their old names, too. It stands above `@checked`."""
    gone(since)

    def decorate(call: Any) -> Any:
        @wraps(call)
        def warned(*args: Any, **given: Any) -> Any:
            return call(*args, **(given if given.keys().isdisjoint(old) else regroup(call.__name__, since, old, given, 3)))
        return warned
    return decorate


def _warn(text: str, since: str, level: int) -> None:
    warnings.warn(f"{text}; the old name works until {gone(since)}", FutureWarning, stacklevel=level)
