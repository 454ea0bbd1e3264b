"""Folder of compiled kernels: its name is a hash of their sources, and nobody else can write to it."""
from __future__ import annotations

import hashlib
import os
import shutil
import stat
import tempfile
import warnings
from pathlib import Path

import numba

if numba.config.DISABLE_JIT:
    raise ImportError("NUMBA_DISABLE_JIT is set, and fastbeam's kernels run as compiled code alone: they call functions by "
                      "address and work in registers of the processor; unset it")


def _source_hash(way: str) -> str:
    kernels = Path(__file__).parents[1]
    digest = hashlib.sha256(numba.__version__.encode() + way.encode())
    for path in sorted(kernels.rglob("*.py")):
        digest.update(path.relative_to(kernels).as_posix().encode())
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


def is_private(found: os.stat_result) -> bool:
    """Return whether only this user and the administrator can write to a file."""
    return not hasattr(os, "getuid") or (found.st_uid in (0, os.getuid()) and not found.st_mode & 0o022)


def _is_safe(folder: Path) -> bool:
    """Return whether nobody else can put kernels into this folder."""
    try:
        above = folder.parent.stat()
        # entries of others cannot be removed from a sticky folder
        return ((is_private(above) or bool(above.st_mode & stat.S_ISVTX)) and not folder.is_symlink()
                and all(is_private(place.stat()) for place in (folder, *filter(Path.is_dir, folder.iterdir()))))
    except OSError:
        return False


def _fallback_root() -> Path:
    """Return a folder in the system's temporary folder that nobody else can write to: cached machine code is run as it is
    found."""
    root = Path(tempfile.gettempdir()) / f"fastbeam-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
    try:
        root.mkdir(mode=0o700, exist_ok=True)
        found = root.lstat()
        if stat.S_ISDIR(found.st_mode) and is_private(found) and _usable(root):
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


def cache_folder(way: str = "") -> str:
    """Return the folder of the kernels that are compiled in this way: in `$FASTBEAM_CACHE_DIR`, else the user's cache folder. If
    that cannot be written, or others can write to it, a folder in the system's temporary folder takes its place, with a copy of
    all kernels that can be read and trusted."""
    name = _source_hash(way)
    folder = _cache_root() / name
    usable = _usable(folder)
    if usable and not _is_safe(folder):
        warnings.warn(f"fastbeam: others can write to {folder} or the folder that holds it, so its kernels are not used: take "
                      "these rights away (chmod -R go-w) or let FASTBEAM_CACHE_DIR name another folder", RuntimeWarning,
                      stacklevel=2)
    if not usable or not _is_safe(folder):
        fallback = _fallback_root() / name
        _take_over(folder, fallback)
        fallback.mkdir(parents=True, exist_ok=True)
        return str(fallback)
    return str(folder)
