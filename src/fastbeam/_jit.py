"""The only file that names compiler options: how kernels are compiled and where their machine code is cached.

Every kernel is cached on disk at first use. Numba's own cache does not notice an edit in a file that a kernel calls
into, so the folder carries a hash of all kernel sources: any edit starts a new folder.
"""
from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from pathlib import Path
from typing import Any, Callable, TypeVar

import numba
from numba.core import config as _config

F = TypeVar("F", bound=Callable[..., Any])

KERNELS: list[Any] = []  # every dispatcher, for the test that a warm process compiles nothing


def _source_hash() -> str:
    here = Path(__file__).parent
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted([Path(__file__), *here.glob("kernels/*.py")]):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _cache_root() -> Path:
    named = os.environ.get("FASTBEAM_CACHE_DIR")
    if named:
        return Path(named)
    base = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return Path(base) / "fastbeam"


def _usable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def cache_folder() -> str:
    """Folder of the compiled kernels: `$FASTBEAM_CACHE_DIR`, else the user's cache folder, else the system's temporary
    folder when neither can be written."""
    name = _source_hash()
    folder = _cache_root() / name
    if not _usable(folder):
        folder = Path(tempfile.gettempdir()) / f"fastbeam-{os.getuid() if hasattr(os, 'getuid') else 'user'}" / name
        folder.mkdir(parents=True, exist_ok=True)
    return str(folder)


_FOLDER = cache_folder()


def kernel(function: F) -> F:
    """Compile a pure function of arrays.

    `contract` lets LLVM fuse multiply and add; the other fast-math flags would assume that no NaN occurs, and NaN is
    the alarm of the Newton loop. `error_model='numpy'` drops the division-by-zero exceptions.
    """
    before = _config.CACHE_DIR
    _config.CACHE_DIR = _FOLDER
    try:
        compiled = numba.njit(cache=True, fastmath={"contract"}, error_model="numpy", nogil=True)(function)
    finally:
        _config.CACHE_DIR = before
    KERNELS.append(compiled)
    return compiled


def link_library(path: str) -> None:
    """Let compiled code find the symbols of a shared library by name."""
    from llvmlite import binding
    binding.load_library_permanently(path)


def announce_first_use() -> None:
    """One line on stderr before the first compilation on a machine, which takes about half a minute; silent with
    FASTBEAM_PROGRESS=0."""
    if os.environ.get("FASTBEAM_PROGRESS") != "0" and not any(Path(_FOLDER).rglob("*.nbi")):
        print(f"fastbeam: compiling its kernels for the first time, kept in {_FOLDER}", file=sys.stderr, flush=True)


def compile_counts() -> tuple[int, int]:
    """(kernels loaded from the cache, kernels compiled) in this process."""
    hits = sum(sum(k.stats.cache_hits.values()) for k in KERNELS)
    misses = sum(sum(k.stats.cache_misses.values()) for k in KERNELS)
    return hits, misses
