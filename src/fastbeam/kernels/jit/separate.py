"""Kernels with machine code of their own: compiled once for all kernels that call them, which find them by a symbol.

Other called kernels are parts of their callers' machine code (`_parts`), compiled anew for every kind of scene. Large kernels
whose arguments are the same in many scenes (`decorators.separate`) are optimised and turned into machine code once for each set
of types. A symbol is named after the kernel and these types alone, so that callers from the disk find code that another process
has compiled; a caller's entry on the disk names the kernels to load before it.
"""
from __future__ import annotations

import hashlib
import importlib
from collections.abc import Iterable, Iterator
from typing import Any

from llvmlite import binding
from numba.core.caching import CompileResultCacheImpl, FunctionCache

PREFIX = "fastbeam.separate."
# module, name and types of arguments of a kernel
Named = tuple[str, str, tuple[Any, ...]]
_KNOWN: dict[str, Named] = {}


def symbol_of(function: Any, arguments: tuple[Any, ...]) -> str:
    """Return the symbol of a kernel for argument types."""
    named = function.__module__, function.__qualname__, *map(str, arguments), *_classes(arguments)
    return f"{PREFIX}{function.__name__}.{hashlib.blake2b(repr(named).encode(), digest_size=16).hexdigest()}"


def _classes(kinds: Iterable[Any]) -> Iterator[str]:
    """Yield module and name of the classes of named tuples among types, and in these: a type has only the name of its class."""
    for kind in kinds:
        of = getattr(kind, "instance_class", None)
        if of is not None:
            yield f"{of.__module__}.{of.__qualname__}"
        inner = getattr(kind, "of", None)
        yield from _classes((inner,) if inner is not None else getattr(kind, "types", None) or ())


def called_in(module: Any) -> list[Named]:
    """Return the kernels that an LLVM module calls by such symbols."""
    names = (x.name for x in module.functions if x.is_declaration)
    return [_KNOWN[name] for name in names if name.startswith(PREFIX)]


def load(kernels: list[Named]) -> None:
    """Define the symbols of kernels: from the disk, or compiled."""
    for module, name, arguments in kernels:
        getattr(importlib.import_module(module), name).part.compile(arguments)


def rename(library: Any, descriptor: Any, symbol: str) -> None:
    """Give a function of a library that is not final yet its symbol, for callers too."""
    library._final_module.get_function(descriptor.mangled_name).name = symbol
    descriptor.mangled_name = symbol


def define(library: Any, symbol: str, function: Any, arguments: tuple[Any, ...]) -> None:
    """Let code that is linked from now on find the symbol of a kernel."""
    binding.add_symbol(symbol, library.get_pointer_to_function(symbol))
    _KNOWN[symbol] = function.__module__, function.__qualname__, arguments


class _WholeCacheImpl(CompileResultCacheImpl):  # type: ignore[misc]
    def reduce(self, found: Any) -> Any:
        return found.library.calls, super().reduce(found)

    def rebuild(self, target_context: Any, reduced: Any) -> Any:
        calls, rest = reduced
        load(calls)
        return super().rebuild(target_context, rest)


class WholeCache(FunctionCache):  # type: ignore[misc]
    """Numba's cache of a kernel that Python calls."""

    _impl_class = _WholeCacheImpl
