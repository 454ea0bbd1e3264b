"""Compiler options of kernels, and the cache of their machine code; no other file names compiler options.

Every kernel is cached on disk at first use. Numba's own cache does not notice an edit in a file that a kernel calls into, so the
folder carries a hash of all kernel sources: any edit starts a new folder. Kernels found there are run as they are: entries carry
a checksum, and files that others could have written are not used.

There are two ways to compile. The fast one (`_parts`, `_sealed`, `_background`) builds on numba's interior, which may change with
any version. The plain one uses features of numba's manual: the same functions and flags of arithmetic, and the same results to
round-off, but compilation takes four times as long, and kernels count references, which makes iterations of small scenes a
quarter slower. `FASTBEAM_PLAIN_NUMBA=1` asks for it, and it is taken if the fast one was not tested with the installed numba or
cannot be loaded; `FASTBEAM_PLAIN_NUMBA=0` tries the fast one in any case.
"""
from __future__ import annotations

import contextlib
import functools
import importlib
import inspect
import os
import pickle
import sys
import warnings
from pathlib import Path
from typing import Any, BinaryIO, Callable, TypeVar

import numba
from numba import config, version_info

from fastbeam.kernels.jit import background as _background
from fastbeam.kernels.jit import sources as _outside
from fastbeam.kernels.jit.cache import cache_folder

F = TypeVar("F", bound=Callable[..., Any])

__all__ = ["ABSENT", "KERNELS", "NUMBA_ONLY", "address_of", "announce_first_use", "around_user", "compile_counts", "inlined",
           "kernel", "link_library", "of_user", "one_variant", "prepare", "separate", "table_entry", "with_address", "work"]

ABSENT = numba.types.none  # the type of the argument for a part that a scene lacks
KERNELS: list[Any] = []  # every dispatcher, for the test that a warm process compiles nothing
OPTIONS: dict[str, Any] = {"fastmath": {"contract"}, "error_model": "numpy", "nogil": True}
# versions of numba that the fast way was tested with
TESTED = (0, 61), (0, 68)


def _why_numba_only(setting: str, version: tuple[int, ...]) -> str | None:
    """Return the reason for the plain way before the other is tried; empty if the user asks for it, None if there is none."""
    if setting in ("0", "1"):
        return "" if setting == "1" else None
    low, high = (".".join(map(str, x)) for x in TESTED)
    return None if TESTED[0] <= version <= TESTED[1] else f"its faster compilation was tested with numba {low} to {high}"


def _fast_way() -> Any:
    """Return the modules of the fast way, or None for the plain one."""
    reason = _why_numba_only(os.environ.get("FASTBEAM_PLAIN_NUMBA", ""), version_info.short)
    if reason is None:
        try:
            from fastbeam.kernels.jit import parts as _parts
            from fastbeam.kernels.jit import sealed as _sealed
            return _parts, _sealed
        except Exception as error:  # whatever is not there any more
            reason = f"its faster compilation does not work with it ({type(error).__name__}: {error})"
    if reason:
        warnings.warn(f"fastbeam: {reason}, and this is numba {numba.__version__}. Kernels are compiled without it: a first run "
                      "takes minutes, its results are the same to round-off. FASTBEAM_PLAIN_NUMBA=1 hides this warning",
                      RuntimeWarning, stacklevel=2)
    return None


_FAST = _fast_way()
NUMBA_ONLY = _FAST is None
_FOLDER = cache_folder("plain" if NUMBA_ONLY else "")


def kernel(function: F) -> F:
    """Compile a pure function of arrays.

    `contract` lets LLVM fuse multiply and add; the other fast-math flags would assume that no NaN occurs, and NaN is
    the alarm of the Newton loop. `error_model='numpy'` drops the division-by-zero exceptions. Kernels allocate nothing, and their
    callers hold the arrays: without reference counts (`_nrt`) small calls take a third less time.
    """
    return _compiled(function)


def inlined(function: F) -> F:
    """Compile like `kernel`, written into every kernel that calls it, whatever its size: for short steps of loops, which pass
    arrays, seven words each. Numbers in the source of a caller reach it that way, so there is one variant for all."""
    return _compiled(function, one=True, forceinline=True)


def one_variant(function: F) -> F:
    """Compile like `kernel`, once for all numbers that stand in the source of callers. Else f(x, 2) and f(x, 3) are compiled
    apart: faster code in loops over elements, and only time lost where they differ in an offset."""
    return _compiled(function, one=True)


def separate(function: F) -> F:
    """Compile like `one_variant`, with machine code of its own that all kernels share which call it with the same types: for
    large kernels that many kinds of scenes have. A call is never written into its caller."""
    return _compiled(function, one=True, alone=True)


def table_entry(function: F) -> F:
    """Compile like `separate`, as an entry that tables of calls point to (`calls.py`)."""
    return _compiled(function, one=True, alone=True, is_entry=True)


def address_of(entry: Any, arguments: tuple[Any, ...]) -> int:
    """Return the address of the machine code of a table's entry for argument types."""
    if NUMBA_ONLY:
        entry.compile(arguments)
        found = entry.overloads[arguments]
        return int(found.library.get_pointer_to_function(found.fndesc.llvm_func_name))
    return entry.part.address(arguments)  # type: ignore[no-any-return]


def prepare(jobs: list[tuple[Any, tuple[Any, ...]]], name: str) -> Any:
    """Return a context in which entries (kernel, types of its arguments) are about to be compiled: a second process compiles half
    of those that are not on the disk. name: their purpose, of `parts.STAGES`."""
    if NUMBA_ONLY:
        return contextlib.nullcontext()
    missing = _background.missing(jobs)
    if len(missing) > 1:
        _background.start(missing[1::2], _FOLDER)
    return _FAST[0].PROGRESS.of(name)


def _compiled(function: F, one: bool = False, alone: bool = False, is_entry: bool = False, **options: Any) -> F:
    try:
        compiled = _plainly(function, options) if NUMBA_ONLY else _fast(function, one, alone, is_entry, options)
    except RuntimeError as error:
        if _outside.is_outside(function):
            raise RuntimeError(f"kernel {function.__name__}: compiled code is kept by the file that it stands in, and there is "
                               f"none; move it to a module ({error})") from error
        raise
    KERNELS.append(compiled)
    return compiled


def _fast(function: Any, one: bool, alone: bool, is_entry: bool, options: dict[str, Any]) -> Any:
    parts, sealed = _FAST
    # numba asks for the signature twice, which takes a tenth of the load time of kernels
    function.__signature__ = inspect.signature(function)
    compiled = numba.njit(_nrt=False, no_cfunc_wrapper=True, pipeline_class=parts.WholeCompiler, **OPTIONS, **options)(function)
    del function.__signature__
    compiled._cache = sealed.KernelCache(function, parts.WholeCache, _FOLDER)
    parts.Part(compiled, one, alone, is_entry, sealed.KernelCache(function, parts.PartCache, _FOLDER))
    if _outside.is_outside(function):
        compiled._cache.make()  # fails for functions that no file contains
    return compiled


def _plainly(function: Any, options: dict[str, Any]) -> Any:
    # numba would not notice edits in other files of a package that adds terms
    keep = not (_outside.is_outside(function) or _outside.known())
    before, config.CACHE_DIR = config.CACHE_DIR, _FOLDER
    try:
        return numba.njit(cache=keep, **OPTIONS, **{x: value for x, value in options.items() if _takes(x)})(function)
    finally:
        config.CACHE_DIR = before


@functools.cache
def _takes(option: str) -> bool:
    """Return whether numba has an option that its manual does not name. A try takes a compilation, which tested versions are
    spared."""
    if TESTED[0] <= version_info.short <= TESTED[1]:
        return True
    try:
        numba.njit(**{option: True})(lambda: 0)()
    except Exception:  # it does not say which
        return False
    return True


def _forget_on_disk() -> None:
    """Keep no kernels on disk that may call terms from outside (plain way)."""
    for compiled in KERNELS:
        if not hasattr(compiled, "_cache"):
            raise RuntimeError(f"terms from outside fastbeam cannot be added with numba {numba.__version__}: its cache cannot be "
                               "switched off; use an older one")
        compiled._cache = _NoCache()


class _NoCache:
    """Cache that keeps nothing."""

    cache_path = None

    def load_overload(self, arguments: Any, context: Any) -> None:
        """Find nothing: nothing is kept."""

    def save_overload(self, arguments: Any, compiled: Any) -> None:
        """Keep nothing."""


if NUMBA_ONLY:
    _outside.AT_FIRST.append(_forget_on_disk)


def work(source: BinaryIO) -> None:
    """Run the second process (`_background`): compile the parts that `source` names, and print a line on stdout for each when it
    is kept."""
    folder, modules = pickle.load(source)
    if NUMBA_ONLY or folder != _FOLDER:
        return
    for module in modules:  # implementations that are not known here would be left out
        importlib.import_module(module)
    jobs = pickle.load(source)
    with _FAST[0].memoized_typing():
        for module, name, arguments in jobs:
            getattr(importlib.import_module(module), name).part.compile(arguments)
            print(flush=True)


def of_user(function: Callable[..., Any]) -> Any:
    """Compile a user function as Python runs it: to divide by zero and to read beyond an array are errors. It is not kept on the
    disk."""
    return _of_process(function, error_model="python", boundscheck=True)


def around_user(function: Callable[..., Any]) -> Any:
    """Compile a function that calls a user function. Both are written into `with_address`: tests of bounds that hold anyway are
    removed, which leaves a law as fast as without them."""
    return _of_process(function, error_model="numpy")


def _of_process(function: Callable[..., Any], **options: Any) -> Any:
    return numba.njit(**options, **({"forceinline": True} if _takes("forceinline") else {}))(function)


def with_address(function: Callable[..., None]) -> Any:
    """Compile a function (double t, double *given, double *parameters, double *found, double *failed) to machine code that
    kernels call by its `.address`; it lives as long as this object. Exceptions that it raises would be lost."""
    pointer = numba.types.CPointer(numba.types.float64)
    return numba.cfunc(numba.types.void(numba.types.float64, pointer, pointer, pointer, pointer), error_model="numpy")(function)


def link_library(path: str) -> None:
    """Let compiled code find the symbols of a shared library by name."""
    from llvmlite import binding
    binding.load_library_permanently(path)


def announce_first_use() -> None:
    """Print one line on stderr before the first compilation on a machine, which takes about ten seconds, and one after it; silent
    with FASTBEAM_PROGRESS=0."""
    if os.environ.get("FASTBEAM_PROGRESS") != "0" and not any(Path(_FOLDER).rglob("*.nbi")):
        print(f"fastbeam: compiling its kernels for the first time, kept in {_FOLDER}", file=sys.stderr, flush=True)
        if not NUMBA_ONLY:
            _FAST[0].PROGRESS.announced = True


def compile_counts() -> tuple[int, int]:
    """Return (kernels loaded from the cache, kernels compiled) in this process."""
    hits = sum(sum(k.stats.cache_hits.values()) for k in KERNELS)
    misses = sum(sum(k.stats.cache_misses.values()) for k in KERNELS)
    if NUMBA_ONLY:
        return hits, misses
    return (hits + sum(sum(k.part.loaded.values()) for k in KERNELS),
            misses + sum(sum(k.part.missed.values()) for k in KERNELS))
