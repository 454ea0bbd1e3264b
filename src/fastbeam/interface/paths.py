"""Checks of paths on disk before a file is read or written."""
from __future__ import annotations

import os
import stat
from pathlib import Path

from fastbeam.interface.errors import ResultFileError


def check_regular(noun: str, path: Path, named: Path) -> None:
    """Check that a path is a file and no folder, or a device, pipe or socket, which must be neither replaced nor waited for.

    Raises ResultFileError.
    Raises OSError: it cannot be looked at.
    """
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        raise ResultFileError(f"{noun} '{named}': is a folder; give the name of a file")
    if not stat.S_ISREG(mode):
        raise ResultFileError(f"{noun} '{named}': is a device, pipe or socket, not a file; choose another path")


def check_new(noun: str, path: Path, named: Path, overwrite: bool) -> bool:
    """Refuse a place for a file in a folder that does not exist, and one that is taken unless `overwrite`. Returns whether a file
    is there.

    Raises ResultFileError.
    Raises OSError: it cannot be looked at.
    """
    if not path.parent.is_dir():
        raise ResultFileError(f"{noun} '{named}': folder '{path.parent}' does not exist; create it first")
    if not os.path.lexists(path):
        return False
    check_regular(noun, path, named)
    if not overwrite:
        raise ResultFileError(f"{noun} '{named}': exists already; pass overwrite=True or choose another path")
    return True


def claim(handle: int, first: int, size: int) -> None:
    """Make the file system set this range of a file aside, where it can. HDF5 must not meet the end of the disk: a file that it
    cannot close makes the process crash when it ends. Raises OSError: there is no room."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(handle, first, size)
