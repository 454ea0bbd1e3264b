"""The only file that names compiler options: how kernels are compiled and where their machine code is cached.

Every kernel is cached on disk at first use. Numba's own cache does not notice an edit in a file that a kernel calls
into, so the folder carries a hash of all kernel sources: any edit starts a new folder. What is found there is run as it is:
entries carry a checksum, and what others could have written is not touched.
"""
from __future__ import annotations

import functools
import hashlib
import importlib
import os
import pickle
import shutil
import stat
import sys
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import RLock
from typing import Any, BinaryIO, Callable, TypeVar

try:
    import fcntl
except ImportError:  # no such locks on this system
    fcntl = None  # type: ignore[assignment]

import numba
import numba.np.linalg as _linalg
from numba.core import config as _config
from numba.core.caching import IndexDataCacheFile

# when it starts, numba looks for SciPy's BLAS, which takes a tenth of a second to import; kernels call none, and other code that
# does finds it all the same, later
_look = _linalg.ensure_blas
_linalg.ensure_blas = lambda: None
import numba.np.arraymath  # noqa: E402, F401

_linalg.ensure_blas = _look

from ._beside import beside, start
from ._parts import PROGRESS, Part, WholeCompiler, in_haste, is_kept

F = TypeVar("F", bound=Callable[..., Any])

__all__ = ["ABSENT", "KERNELS", "announce_first_use", "begin_beside", "beside", "compile_counts", "compiled_law", "kernel",
           "link_library", "one_variant", "work", "written_in"]

ABSENT = numba.types.none  # the type of the argument for a part that a scene lacks
DIGEST = 16  # bytes of a checksum
KERNELS: list[Any] = []  # every dispatcher, for the test that a warm process compiles nothing


def _source_hash() -> str:
    here = Path(__file__).parent
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted([Path(__file__), here / "_parts.py", here / "_generic.py", *here.glob("kernels/*.py")]):
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
        folder.parent.parent.mkdir(parents=True, exist_ok=True)
        for place in (folder.parent, folder):
            place.mkdir(mode=0o755, exist_ok=True)  # whatever the rights that new folders have
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _is_private(found: os.stat_result) -> bool:
    """Whether nobody but this user and the administrator can write to it."""
    return not hasattr(os, "getuid") or (found.st_uid in (0, os.getuid()) and not found.st_mode & 0o022)


def _is_safe(folder: Path) -> bool:
    """Whether nobody else can put kernels into this folder."""
    try:
        above = folder.parent.stat()
        # entries of others cannot be removed from a sticky folder
        return ((_is_private(above) or bool(above.st_mode & stat.S_ISVTX)) and not folder.is_symlink()
                and all(_is_private(place.stat()) for place in (folder, *filter(Path.is_dir, folder.iterdir()))))
    except OSError:
        return False


def _spare_root() -> Path:
    """A folder in the system's temporary folder that nobody else can write to: cached machine code is run as it is found."""
    root = Path(tempfile.gettempdir()) / f"fastbeam-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
    try:
        root.mkdir(mode=0o700, exist_ok=True)
        found = root.lstat()
        if stat.S_ISDIR(found.st_mode) and _is_private(found) and _usable(root):
            return root
    except OSError:
        pass
    return Path(tempfile.mkdtemp(prefix="fastbeam-"))


def _take_over(source: Path, target: Path) -> None:
    """Copy kernels from a folder that can be read but not written."""
    if target.exists() or not _is_safe(source):
        return
    fresh = Path(tempfile.mkdtemp(dir=target.parent))
    try:
        shutil.copytree(source, fresh / target.name)
        os.rename(fresh / target.name, target)
    except (OSError, shutil.Error):
        pass  # another process was first, or nothing can be read: kernels are compiled instead
    finally:
        shutil.rmtree(fresh, ignore_errors=True)


def cache_folder() -> str:
    """Folder of the compiled kernels: `$FASTBEAM_CACHE_DIR`, else the user's cache folder. Where that cannot be written, or
    others can write to it, one in the system's temporary folder takes its place, with a copy of what can be read and trusted."""
    name = _source_hash()
    folder = _cache_root() / name
    usable = _usable(folder)
    if usable and not _is_safe(folder):
        warnings.warn(f"fastbeam: others can write to {folder} or the folder that holds it, so its kernels are not used: take "
                      "these rights away (chmod -R go-w) or let FASTBEAM_CACHE_DIR name another folder", RuntimeWarning,
                      stacklevel=2)
    if not usable or not _is_safe(folder):
        spare = _spare_root() / name
        _take_over(folder, spare)
        spare.mkdir(parents=True, exist_ok=True)
        return str(spare)
    return str(folder)


_FOLDER = cache_folder()
WholeCompiler.folder = _FOLDER


_LOCK, _DEPTH = RLock(), [0]


@contextmanager
def _locked(exclusive: bool) -> Iterator[None]:
    """Processes that share the folder take turns in writing; without it two that start together could save different variants of
    a kernel under one name."""
    with _LOCK:
        file = None
        if fcntl is not None and not _DEPTH[0]:
            try:
                file = open(Path(_FOLDER) / "lock", "ab")
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


class _SealedFile(IndexDataCacheFile):  # type: ignore[misc]
    """Entries on the disk of one kernel, each with a checksum that is verified before anything in it is believed: a wrong bit in
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
            if not _is_private(os.fstat(file.fileno())):
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
    """Of the contents of a file and its name, so that files that changed places are found too."""
    digest = hashlib.blake2b(os.fsencode(os.path.basename(path)), digest_size=DIGEST)
    digest.update(data)
    return digest.digest()


def _guard(cache: Any) -> None:
    """Let a kernel's cache survive other processes, damaged files and a full disk: then it counts as empty."""
    plain = cache._cache_file
    cache._cache_file = _SealedFile(plain._cache_path, plain._index_name.removesuffix(".nbi"), plain._source_stamp)
    _close(plain._cache_path)
    save = cache.save_overload

    def guarded_load(*arguments: Any) -> Any:
        try:
            # numba's `load_overload` first registers all that it can compile: a quarter of the time of a warm start
            with _locked(exclusive=False), cache._guard_against_spurious_io_errors():
                return cache._load_overload(*arguments)
        except Exception as error:  # whatever unpickling of a damaged file may raise
            warnings.warn(f"fastbeam: the compiled kernels in {_FOLDER} are damaged ({type(error).__name__}: {error}); compiling "
                          "them again", RuntimeWarning, stacklevel=2)
            try:
                with _locked(exclusive=True):
                    cache.flush()
            except OSError:
                pass
            return None

    def guarded_save(*arguments: Any) -> None:
        try:
            with _locked(exclusive=True):
                save(*arguments)
        except OSError as error:
            warnings.warn(f"fastbeam: compiled kernels cannot be kept in {_FOLDER} ({error}); the next process compiles them "
                          "again", RuntimeWarning, stacklevel=2)

    cache.load_overload, cache.save_overload = guarded_load, guarded_save


def kernel(function: F) -> F:
    """Compile a pure function of arrays.

    `contract` lets LLVM fuse multiply and add; the other fast-math flags would assume that no NaN occurs, and NaN is
    the alarm of the Newton loop. `error_model='numpy'` drops the division-by-zero exceptions. Kernels allocate nothing, and their
    callers hold the arrays: without reference counts (`_nrt`) small calls take a third less time.
    """
    return _compiled(function)


def written_in(function: F) -> F:
    """Compile like `kernel`, inlined into every kernel that calls it, whatever its size: for short steps of loops, where passing
    arrays, seven words each, would cost more than the step."""
    return _compiled(function, forceinline=True)


def one_variant(function: F) -> F:
    """Compile like `kernel`, once for all numbers that stand in the source of callers. Else f(x, 2) and f(x, 3) are compiled
    apart: faster code in loops over elements, and only time lost where they differ in an offset."""
    return _compiled(function, one=True)


def _compiled(function: F, one: bool = False, **options: Any) -> F:
    before = _config.CACHE_DIR
    _config.CACHE_DIR = _FOLDER
    try:
        compiled = numba.njit(cache=True, fastmath={"contract"}, error_model="numpy", nogil=True, _nrt=False,
                              no_cfunc_wrapper=True, pipeline_class=WholeCompiler, **options)(function)
        part = Part(compiled, one)
    finally:
        _config.CACHE_DIR = before
    _guard(compiled._cache)
    _guard(part.cache)
    KERNELS.append(compiled)
    return compiled


def begin_beside(kernel: Any, arguments: tuple[Any, ...]) -> None:
    """Where the first call of `kernel` in this process has to compile it, let a second process begin before that call."""
    if kernel.overloads:
        return  # finding the types would cost every run a millisecond
    types = tuple(kernel.typeof_pyval(x) for x in arguments)
    if not is_kept(kernel._cache, types, kernel.targetctx.codegen()):
        start(kernel.py_func, types, _FOLDER)


def work(source: BinaryIO) -> None:
    """What a second process (`_beside`) does: compile the parts that `source` names, a line on stdout for each when it is
    kept."""
    folder, jobs = pickle.load(source)
    if folder != _FOLDER:
        return
    with in_haste():
        for module, name, arguments in jobs:
            getattr(importlib.import_module(module), name).part.compile(arguments)
            print(flush=True)


def compiled_law(function: Callable[..., float]) -> Any:
    """A function of three numbers as machine code that kernels call by its `.address`; it lives as long as this object."""
    return numba.cfunc("float64(float64, float64, float64)")(function)


def link_library(path: str) -> None:
    """Let compiled code find the symbols of a shared library by name."""
    from llvmlite import binding
    binding.load_library_permanently(path)


def announce_first_use() -> None:
    """One line on stderr before the first compilation on a machine, which takes about ten seconds, and one after it; silent with
    FASTBEAM_PROGRESS=0."""
    if os.environ.get("FASTBEAM_PROGRESS") != "0" and not any(Path(_FOLDER).rglob("*.nbi")):
        print(f"fastbeam: compiling its kernels for the first time, kept in {_FOLDER}", file=sys.stderr, flush=True)
        PROGRESS.announced = True


def compile_counts() -> tuple[int, int]:
    """(kernels loaded from the cache, kernels compiled) in this process."""
    hits = sum(sum(k.stats.cache_hits.values()) + sum(k.part.loaded.values()) for k in KERNELS)
    misses = sum(sum(k.stats.cache_misses.values()) + sum(k.part.missed.values()) for k in KERNELS)
    return hits, misses
