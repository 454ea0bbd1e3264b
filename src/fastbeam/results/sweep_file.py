"""The file of a sweep: rows as they come, readable after the writer was killed.

    format, version        attributes, 'fastbeam-sweep'
    header                 uint8 [k]      JSON: what was computed, and how
    rows                   uint8 [k]      JSON lines: number, case, values, error, and where arrays stand in 'numbers'
    numbers                float64 [n]    arrays of all rows, one after the other
    committed              int64 [5]      bytes of rows, numbers, CRC-32 of each, and the sum of these four with a minus

As in result files (`store`) nothing in it is executed, and no size is believed before it is compared with the file.
"""
from __future__ import annotations

import json
import os
import shutil
import time
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Any, NotRequired, TypedDict

import numpy as np

from fastbeam.interface.errors import ResultFileError
from fastbeam.interface.paths import check_new, claim
from fastbeam.results.hdf5_reader import MARGIN, Reader, import_h5py, read_file
from fastbeam.results.hdf5_writer import lock

Array = np.ndarray
FORMAT, VERSION = "fastbeam-sweep", 1
# s between two flushes, bytes that wait in memory at most
FLUSH_TIME, PENDING = 0.5, 1 << 24
# entries of a chunk
CHUNK = 8192
# locks of this process; forks let go of theirs, or they would outlive it
_HELD: list[Any] = []


class Row(TypedDict):
    """An entry of the table: number, case, values, error or None and where, arrays by name."""

    run: int
    case: dict[str, object]
    values: dict[str, object]
    error: str | None
    arrays: dict[str, Array]
    traceback: NotRequired[str]


class SweepFile:
    """Writer of the rows of a sweep as they come.

    header: JSON-able.
    rows: rows that the file begins with, those of the file that stood there.
    Raises ResultFileError: its folder does not exist, another sweep writes it, or it cannot be written.
    """

    def __init__(self, path: Path, header: dict[str, Any], rows: list[Row]) -> None:
        h5py = import_h5py()
        self.path, self._where = path, Path(os.path.realpath(path))
        self._part = self._where.with_name(f".{self._where.name}.{os.getpid()}.part")
        self._file: Any = None
        self._text, self._numbers, self._waiting = b"", [np.zeros(0)], 0
        self._counts, self._crc = [0, 0], [0, 0]
        try:
            check_new("sweep file", self._where, path, True)
            self._old = self._where.open("rb") if self._where.exists() else None
            if self._old is not None and not lock(self._old, "LOCK_EX"):
                raise ResultFileError(f"sweep file '{path}': another sweep writes to it; wait for that, or choose another path")
            text = json.dumps(header).encode()
            self._raw = self._part.open("wb")
            claim(self._raw.fileno(), 0, len(text) + MARGIN)
            self._file = h5py.File(self._part, "w", libver="latest")
            self._reserve(len(text))
            self._file.attrs["format"], self._file.attrs["version"] = FORMAT, VERSION
            self._file["header"] = np.frombuffer(text, np.uint8)
            self._file["committed"] = np.zeros(5, np.int64)
            for name, kind in (("rows", np.uint8), ("numbers", np.float64)):
                self._file.create_dataset(name, shape=(0,), maxshape=(None,), chunks=(CHUNK,), dtype=kind)
            self._file.swmr_mode = True
            for row in rows:
                self.append(row)
            self.flush()
            # the old file is there until all that it held stands in the new one
            os.replace(self._part, self._where)
            self._new = self._where.open("rb")
            _HELD.append(self._new)
            lock(self._new, "LOCK_SH")
        except (OSError, RuntimeError) as error:
            self._close()
            with suppress(OSError):
                self._part.unlink(missing_ok=True)
            raise self._unwritable(error) from error
        finally:
            if getattr(self, "_old", None) is not None:
                self._old.close()
        self._last = time.perf_counter()

    def append(self, row: Row) -> None:
        """Add a row; it waits in memory for half a second at most."""
        places, at = {}, self._counts[1] + sum(map(len, self._numbers))
        for name, x in row["arrays"].items():
            flat = np.ascontiguousarray(x, np.float64).reshape(-1)
            places[name] = [at, list(np.shape(x)), np.asarray(x).dtype.kind]
            self._numbers.append(flat)
            at += flat.size
            self._waiting += flat.nbytes
        self._text += json.dumps({**row, "arrays": places}).encode() + b"\n"

    def flush_when_due(self) -> None:
        """Write waiting rows where it is time."""
        if time.perf_counter() - self._last > FLUSH_TIME or self._waiting + len(self._text) > PENDING:
            self.flush()

    def flush(self) -> None:
        """Write everything that waits in memory. Raises ResultFileError."""
        if self._file is None or not self._text:
            return
        numbers = np.concatenate(self._numbers)
        try:
            if shutil.disk_usage(self._where.parent).free < len(self._text) + numbers.nbytes + (1 << 20):
                raise OSError("no disk space left")
            self._reserve(len(self._text) + numbers.nbytes + 2 * 9 * CHUNK)
            for name, data, k in (("rows", np.frombuffer(self._text, np.uint8), 0), ("numbers", numbers, 1)):
                first = self._counts[k]
                self._file[name].resize(first + len(data), axis=0)
                self._file[name][first:] = data
                self._counts[k] = first + len(data)
                self._crc[k] = zlib.crc32(data.tobytes(), self._crc[k])
            self._file.flush()
            committed = [*self._counts, *self._crc]
            self._file["committed"][...] = [*committed, -sum(committed)]
            self._file.flush()
            # a flush gives back what it did not use
            self._reserve(0)
        except (OSError, RuntimeError) as error:
            self._close()
            raise self._unwritable(error) from error
        self._text, self._numbers, self._waiting, self._last = b"", [np.zeros(0)], 0, time.perf_counter()

    def _reserve(self, size: int) -> None:
        """Reserve room behind what is written."""
        claim(self._raw.fileno(), int(self._file.id.get_filesize()), size + MARGIN)

    def close(self) -> None:
        """Write waiting rows and close; safe to call twice."""
        try:
            self.flush()
        finally:
            self._close()

    def _close(self) -> None:
        file, self._file = self._file, None
        with suppress(OSError, RuntimeError):
            if file is not None:
                file.close()
        if hasattr(self, "_raw"):
            self._raw.close()
        if hasattr(self, "_new"):
            self._new.close()
            _HELD[:] = [open_file for open_file in _HELD if open_file is not self._new]

    def _unwritable(self, error: BaseException) -> ResultFileError:
        return ResultFileError(f"sweep file '{self.path}': cannot be written ({' '.join(str(error).split())}); free disk space, "
                               "or choose another path")


def let_go() -> None:
    """Close the locks that a fork inherits: they belong to the process that writes."""
    while _HELD:
        _HELD.pop().close()


def read_sweep(path: Path) -> tuple[dict[str, Any], list[Row]]:
    """Read header and rows of a file, also of one whose writer was killed or is running. Raises ResultFileError: the file is
    missing, no sweep, or damaged."""
    return read_file("sweep file", path, _read)


def _read(reader: Reader) -> tuple[dict[str, Any], list[Row]]:
    if reader.attribute("format") != FORMAT or reader.attribute("version") != VERSION:
        raise reader.refuse(f"not a sweep of a known format ('{FORMAT}' {VERSION}); load_result reads results")
    reader.present(["committed", "header", "rows", "numbers"])
    committed = reader.read("committed", np.int64, ()).tolist()
    if len(committed) != 5 or sum(committed) != 0 or min(committed[:4]) < 0:
        raise reader.refuse("damaged, its counts are not valid")
    text = reader.read("rows", np.uint8, (), committed[0], strict=True).tobytes()
    numbers = reader.read("numbers", np.float64, (), committed[1], strict=True)
    header = reader.read("header", np.uint8, ()).tobytes()
    if [zlib.crc32(text), zlib.crc32(numbers.tobytes())] != committed[2:4]:
        raise reader.refuse("damaged, its checksum is wrong")
    reader.bound("rows", text)
    reader.bound("header", header)
    found = json.loads(header)
    if not isinstance(found, dict):
        raise reader.refuse("damaged, its header is missing")
    return found, [_row(json.loads(line), numbers) for line in text.splitlines()]


def _row(raw: Any, numbers: Array) -> Row:
    arrays = {}
    for name, (at, shape, kind) in raw["arrays"].items():
        size = int(np.prod(shape, dtype=object))
        if not (0 <= at and 0 <= size <= len(numbers) - at and kind in "biuf"):
            raise ValueError(f"array {name!r:.60} is not among its numbers")
        arrays[name] = numbers[at:at + size].reshape(shape).astype(np.float64 if kind == "f" else np.int64)
    if not (isinstance(raw["run"], int) and isinstance(raw["case"], dict) and isinstance(raw["values"], dict)
            and isinstance(raw["error"], (str, type(None)))):
        raise ValueError("a row is none")
    return {**raw, "arrays": arrays}
