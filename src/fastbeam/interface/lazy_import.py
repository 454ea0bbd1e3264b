"""Public names that import their module when they are first used: `import fastbeam` loads neither numba nor matplotlib nor h5py.

The stub `__init__.pyi` of a package says which public names it has and where they are; type checkers read the same file.
"""
from __future__ import annotations

import gc
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from typing import Any

# pathlib takes a third of the time of `import fastbeam`
ROOT = os.path.abspath(os.path.join(os.path.dirname(__file__), "..", ".."))
IMPORT = re.compile(r"^from (fastbeam[\w.]*) import (\(.*?\)|[^\n]*)", re.MULTILINE | re.DOTALL)


@cache
def names_of(package: str) -> dict[str, str]:
    """Read the stub of a package; return its public names, each with the module that holds it."""
    out: dict[str, str] = {}
    with open(os.path.join(ROOT, *package.split("."), "__init__.pyi"), encoding="utf-8") as file:
        stub = file.read()
    for module, names in IMPORT.findall(stub):
        out.update(names_of(module) if names == "*" else dict.fromkeys(re.findall(r"(\w+) as ", names), module))
    return out


def public_names(package: str) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """Make `__all__`, `__getattr__` and `__dir__` of a package from its stub."""
    where = names_of(package)
    names = sorted(where)

    def get(name: str) -> Any:
        if name not in where:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        with held():
            value = getattr(import_module(where[name]), name)
        setattr(sys.modules[package], name, value)
        return value

    return names, get, lambda: names


class Later:
    """Module that is imported when an attribute of it is first used."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        value = getattr(import_module(self._name), name)
        setattr(self, name, value)
        return value


sparse: Any = Later("scipy.sparse")


@contextmanager
def held() -> Iterator[None]:
    """Hold Python's garbage collector while modules load.

    They make thousands of objects and no garbage, and to look for it takes an eighth of the time.
    """
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        if not gc.get_freeze_count():
            # all objects are old ones from here on, looked at when old ones are
            gc.freeze()
            gc.unfreeze()
        gc.enable()
