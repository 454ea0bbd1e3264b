"""Checks of the arguments of functions that run something; the nouns of a scene have theirs in `scene/checks.py`."""
from __future__ import annotations

import math
import os
import stat
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from .errors import ResultFileError, SceneError


def number(name: str, value: Any) -> float:
    """A finite number as a float.

    Raises
    ------
    SceneError
        Texts, truth values, NaN, infinities, anything that is not one number.
    """
    try:
        x = math.nan if isinstance(value, (str, bytes, bool, np.bool_)) or np.ndim(value) else float(value)
    except (TypeError, ValueError, OverflowError):
        x = math.nan
    if not math.isfinite(x):
        raise SceneError(f"{name}: must be a finite number, got {value!r:.60}")
    return x


def count(name: str, value: Any, least: int = 1) -> int:
    """A whole number >= `least`.

    Raises
    ------
    SceneError
        Anything else, floats and truth values too.
    """
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise SceneError(f"{name}: must be a whole number >= {least}, got {value!r:.60}")
    return int(value)


def file_path(name: str, value: Any) -> Path:
    """The path of a file.

    Raises
    ------
    SceneError
        Not a text or path, or one that no file can have.
    """
    if not isinstance(value, (str, PathLike)) or not isinstance(os.fspath(value), str) or "\0" in os.fspath(value):
        raise SceneError(f"{name}: must be the path of a file, a text or a pathlib.Path, got {value!r:.60}")
    return Path(value)


def check_regular(noun: str, path: Path, named: Path) -> None:
    """Refuse what is no file: a folder, or a device, pipe or socket, which must be neither replaced nor waited for.

    Raises
    ------
    ResultFileError
    OSError
        It cannot be looked at.
    """
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        raise ResultFileError(f"{noun} '{named}': is a folder; give the name of a file")
    if not stat.S_ISREG(mode):
        raise ResultFileError(f"{noun} '{named}': is a device, pipe or socket and no file; choose another path")
