"""Entries of compiled kernels on the disk: each with a checksum, written by one process at a time.

Built on numba's interior, like `_parts`.
"""
from __future__ import annotations

import functools
import hashlib
import os
import pickle
import stat
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import RLock
from typing import Any

try:
    import fcntl
except ImportError:  # no such locks on this system
    fcntl = None  # type: ignore[assignment]

from numba import config
from numba.core.caching import IndexDataCacheFile

from fastbeam.kernels.jit import sources as _outside
from fastbeam.kernels.jit.cache import is_private

DIGEST = 16  # bytes of a checksum
_LOCK, _DEPTH = RLock(), [0]


@contextmanager
def _locked(folder: str, exclusive: bool) -> Iterator[None]:
    """Take turns in writing with processes that share the folder; without it two that start together could save different
    variants of a kernel under one name."""
    with _LOCK:
        file = None
        if fcntl is not None and not _DEPTH[0]:
            try:
                file = open(Path(folder) / "lock", "ab")
                fcntl.flock(file, fcntl.LOCK_EX if exclusive else fcntl.LOCK_SH)
            except OSError:
                pass  # a file system without locks
        _DEPTH[0] += 1
        try:
            yield
        finally:
            _DEPTH[0] -= 1
            if file is not None:
                file.close()


class SealedFile(IndexDataCacheFile):  # type: ignore[misc]
    """Entries on the disk of one kernel, each with a checksum that is verified before any part of it is used: a wrong bit in
    machine code crashes the process, or gives other numbers."""

    def _load_index(self) -> dict[Any, str]:
        try:
            version, stamp, entries = self._unsealed(self._index_path)
        except FileNotFoundError:
            return {}
        return entries if (version, stamp) == (self._version, self._source_stamp) else {}

    def _save_index(self, entries: dict[Any, str]) -> None:
        self._seal(self._index_path, (self._version, self._source_stamp, entries))

    def _load_data(self, name: str) -> Any:
        return self._unsealed(self._data_path(name))

    def _save_data(self, name: str, data: Any) -> None:
        self._seal(self._data_path(name), data)

    def _seal(self, path: str, what: Any) -> None:
        data = self._dump(what)
        with self._open_for_write(path) as file:
            if hasattr(os, "fchmod"):
                os.fchmod(file.fileno(), stat.S_IMODE(os.fstat(file.fileno()).st_mode) & ~0o022)
            file.write(data)
            file.write(_checksum(path, data))

    def _unsealed(self, path: str) -> Any:
        with open(path, "rb") as file:
            if not is_private(os.fstat(file.fileno())):
                raise ValueError(f"others can write to {path}")
            whole = memoryview(file.read())
        data, found = whole[:-DIGEST], whole[-DIGEST:]
        if _checksum(path, data) != found:
            raise ValueError(f"the checksum of {os.path.basename(path)} is wrong")
        return pickle.loads(data)


@functools.cache
def _close(path: str) -> None:
    """Take the rights of others away from a folder that numba made."""
    try:
        mode = stat.S_IMODE(os.stat(path).st_mode)
        if mode & 0o022:
            os.chmod(path, mode & ~0o022)
    except OSError:
        pass  # not there yet


def _checksum(path: str, data: Any) -> bytes:
    """Return the checksum of the contents of a file and its name, which also detects files that changed places."""
    digest = hashlib.blake2b(os.fsencode(os.path.basename(path)), digest_size=DIGEST)
    digest.update(data)
    return digest.digest()


class _Entries:
    """All entries of one kernel: those of this package in one file, those that depend on files outside it in one for each state
    of these files, `sources.digest`."""

    def __init__(self, function: Any, file: IndexDataCacheFile) -> None:
        self._function = function
        self._place = file._cache_path, file._index_name.removesuffix(".nbi"), file._source_stamp
        self.own = SealedFile(*self._place)

    def file(self, key: Any) -> SealedFile | None:
        """Return the file of the entry of a key; None if it cannot be kept."""
        digest = _outside.digest(self._function, getattr(key[0], "args", key[0]))
        if not digest:
            return self.own if digest is not None else None
        folder, name, stamp = self._place
        return SealedFile(folder, f"{name}-{digest}", stamp)

    def holds(self, key: Any) -> bool:
        """Return whether there is an entry."""
        file = self.file(key)
        return file is not None and key in file._load_index()

    def load(self, key: Any) -> Any:
        file = self.file(key)
        return None if file is None else file.load(key)

    def save(self, key: Any, data: Any) -> None:
        file = self.file(key)
        if file is not None:
            file.save(key, data)

    def flush(self, key: Any) -> None:
        """Delete the entries of the file that has this one."""
        file = self.file(key)
        if file is not None:
            file.flush()


class KernelCache:
    """Cache of a kernel, made on first use: most kernels are never used, and making it looks for folders on the disk. With a
    damaged file, a full disk, or other processes at work it counts as empty.

    function: the function that is compiled.
    kind: numba's kind of cache.
    folder: the folder of all kernels.
    """

    def __init__(self, function: Any, kind: Any, folder: str) -> None:
        self._function, self._kind, self._folder = function, kind, folder
        self._made: Any = None
        self._enabled = True

    @property
    def cache_path(self) -> str:
        """Folder of all kernels, a property that numba's caches have."""
        return self._folder

    def disable(self) -> None:
        """Keep nothing from now on."""
        self._enabled = False

    def make(self) -> Any:
        """Return numba's cache. Raises RuntimeError: no file contains the function."""
        if self._made is None:
            before, config.CACHE_DIR = config.CACHE_DIR, self._folder
            try:
                made = self._kind(self._function)
            finally:
                config.CACHE_DIR = before
            made._cache_file = _Entries(self._function, made._cache_file)
            _close(made._cache_path)
            self._made = made
        return self._made

    def holds(self, arguments: Any, codegen: Any) -> bool:
        """Return whether there is an entry on the disk."""
        try:
            made = self.make()
            return self._enabled and bool(made._cache_file.holds(made._index_key(arguments, codegen)))
        except Exception:  # a damaged file, which `load_overload` reports
            return False

    def load_overload(self, arguments: Any, context: Any) -> Any:
        """Return the code kept for argument types, or None."""
        if not self._enabled:
            return None
        made = self.make()
        try:
            # numba's `load_overload` first registers all that it can compile: a quarter of the time of a warm start
            with _locked(self._folder, exclusive=False), made._guard_against_spurious_io_errors():
                return made._load_overload(arguments, context)
        except Exception as error:  # whatever unpickling of a damaged file may raise
            warnings.warn(f"fastbeam: the compiled kernels in {self._folder} are damaged ({type(error).__name__}: {error}); "
                          "compiling them again", RuntimeWarning, stacklevel=2)
            try:
                with _locked(self._folder, exclusive=True):
                    made._cache_file.flush(made._index_key(arguments, context.codegen()))
            except OSError:
                pass
        return None

    def save_overload(self, arguments: Any, compiled: Any) -> None:
        """Keep compiled code."""
        if not self._enabled:
            return
        try:
            with _locked(self._folder, exclusive=True):
                self.make().save_overload(arguments, compiled)
        except OSError as error:
            warnings.warn(f"fastbeam: compiled kernels cannot be kept in {self._folder} ({error}); the next process compiles "
                          "them again", RuntimeWarning, stacklevel=2)
