"""Results in HDF5 files, written as the run goes and readable after the writer was killed.

All datasets are created before the first step; then the file is switched to single-writer-multiple-reader mode, in which HDF5
keeps the file consistent at every moment. Rows are gathered in memory and flushed at most every half second. Every flush adds a
line to 'blocks': how many rows, snapshots and bytes of text there are, and a checksum of all numbers until then; 'committed' says
how many lines count. Texts (header, events, final info) are bytes of JSON.

    format, version        attributes
    header                 uint8 [k]      JSON of ResultHeader
    rows/<series>          [n, ...]       one dataset per series, 't' among them
    snapshots/<name>       [m, ...]       t_snap, phi, directors
    events, final_info     uint8 [k]      JSON lines; JSON
    blocks                 int64 [b, 5]   rows, snapshots, bytes of events, bytes of final_info, CRC-32 of all of it
    committed              int64 [2]      b, -b - 1

HDF5 does not survive a full disk (it may crash the process), so space is claimed from the file system before anything is written.
Files are read without trust: no links, filters, foreign types or external data, nothing larger than the file itself.
"""
from __future__ import annotations

import json
import os
import time
import zlib
from collections.abc import Mapping
from dataclasses import fields
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from .errors import ResultFileError
from .reading import COUNTS, FORMAT, MARGIN, VERSION, import_h5py, load_result
from .result import Result, ResultHeader, RowBuffer, Rows

__all__ = ["ResultWriter", "load_result", "save_result"]

# s and rows between two flushes
FLUSH_TIME, FLUSH_ROWS = 0.5, 4096
# bytes aimed at per chunk of a dataset, and per block of snapshots that waits in memory
CHUNK_BYTES, PENDING_BYTES = 32768, 1 << 24
# files that HDF5 could not write to: closing one may crash
_LOST: list[Any] = []


class ResultWriter:
    """Writes a run to a file while it goes; takes the same calls as `result.ResultBuffer`.

    After a kill at any moment the file opens and holds everything flushed before.

    Parameters
    ----------
    path : path-like
        The new file.
    header : ResultHeader
        Names and shapes of all series.
    overwrite : bool
        Replace an existing file.

    Raises
    ------
    BackendError
        h5py is missing.
    ResultFileError
        The file exists, or its folder does not, or it cannot be created; later, it cannot be written.
    """

    def __init__(self, path: str | PathLike[str], header: ResultHeader, *, overwrite: bool = False) -> None:
        h5py = import_h5py()
        self.path = _check_target(Path(path), overwrite)
        self.header = header
        texts = _encode({item.name: getattr(header, item.name) for item in fields(header)}, "header")
        shapes, dtypes = header.row_tables()
        self._pending = {"rows": RowBuffer(shapes, dtypes), "snapshots": RowBuffer(header.snapshot_tables(), capacity=1)}
        self._snapshot_bytes = 8 * (1 + 12 * header.n_nodes)
        self._text = {"events": b"", "final_info": b""}
        self._count = dict.fromkeys(COUNTS, 0)
        self._blocks, self._crc = 0, zlib.crc32(texts)
        try:
            with self.path.open("wb") as raw:
                _claim(raw.fileno(), 0, len(texts) + MARGIN)
            self._file = h5py.File(self.path, "w", libver="latest")
        except OSError as error:
            if self.path.is_file() and self.path.stat().st_size in (0, len(texts) + MARGIN):
                self.path.unlink()
            raise ResultFileError(f"result file '{self.path}': cannot be created ({error}); choose another path") from error
        try:
            self._reserve(len(texts))
            self._create(texts)
        except BaseException:
            self._file.close()
            raise
        self._last_flush = time.perf_counter()

    def append(self, rows: Rows, t: Any) -> None:
        """Add one row (t a number, s) or a block (t [m], arrays with first axis m) of all series of the header."""
        self._check_open()
        times = np.asarray(t, dtype=np.float64)
        self._pending["rows"].append({"t": times, **rows}, None if times.ndim == 0 else len(times))
        self._flush_when_due()

    def snapshot(self, t: float, phi: np.ndarray, d: np.ndarray) -> None:
        """Add the shape at time t (s): phi [N, 3] (m), d [N, 3, 3] (rows d1, d2, d3)."""
        self._check_open()
        self._pending["snapshots"].append({"t_snap": t, "phi": phi, "directors": d})
        self._flush_when_due()

    def event(self, event: dict[str, Any]) -> None:
        """Add an event {'kind', 'time', 'text', ...} (JSON-able)."""
        self._check_open()
        self._text["events"] += _encode(event, "event") + b"\n"
        self._flush_when_due()

    def flush(self) -> None:
        """Write everything that waits in memory; after this a kill does not lose it."""
        self._check_open()
        if not any(map(len, (*self._pending.values(), *self._text.values()))):
            return
        try:
            self._reserve(self._growth())
        except OSError as error:
            # nothing was handed to HDF5 yet: the file is sound and can be closed
            self._end()
            raise self._unwritable(error) from error
        try:
            for group, buffer in self._pending.items():
                self._extend_rows(group, buffer)
            for name in self._text:
                self._extend_text(name)
            # the data reach the file before the line that vouches for them, and that before the count of lines
            self._sync()
            self._blocks += 1
            self._file["blocks"].resize(self._blocks, axis=0)
            self._file["blocks"][self._blocks - 1] = [*self._count.values(), self._crc]
            self._sync()
            self._file["committed"][...] = [self._blocks, -self._blocks - 1]
            self._sync()
        except (OSError, RuntimeError) as error:
            _LOST.append(self._file)
            self._file = None
            raise self._unwritable(error) from error
        self._last_flush = time.perf_counter()

    def close(self, info: Mapping[str, Any] | None = None) -> None:
        """Flush, store the final info (added to the header's) and close; safe to call twice."""
        if self._file is None:
            return
        try:
            if info:
                self._text["final_info"] = _encode(dict(info), "info")
            self.flush()
        finally:
            self._end()

    def _end(self) -> None:
        """Close the file and give back the space that was claimed for nothing."""
        if self._file is None:
            return
        file, self._file = self._file, None
        file.close()
        with self.path.open("rb+") as raw:
            block, size = raw.read(36), raw.seek(0, 2)
            end = int.from_bytes(block[28:36], "little")
            if block[8] >= 3 and 0 < end < size:
                raw.truncate(end)

    def _unwritable(self, error: BaseException) -> ResultFileError:
        cause = str(error).replace("\n", " ")
        return ResultFileError(f"result file '{self.path}': cannot be written ({cause}); it holds what was flushed before, make "
                               "room or choose another path")

    def _growth(self) -> int:
        """Bytes that the next flush adds to the file at most."""
        out = sum(len(text) + 4096 for text in self._text.values())
        for group, buffer in self._pending.items():
            first, last = self._count[group], self._count[group] + len(buffer)
            for name, column in buffer.views().items():
                if 0 not in column.shape[1:]:
                    rows = _chunk(column.shape[1:])[0]
                    row_bytes = 8 * int(np.prod(column.shape[1:], dtype=np.int64))
                    out += (-(-last // rows) + -(-first // -rows)) * rows * row_bytes
        return out

    def _reserve(self, size: int) -> None:
        with self.path.open("rb+") as raw:
            _claim(raw.fileno(), int(self._file.id.get_filesize()), size + MARGIN)

    def _sync(self) -> None:
        # a flush gives back what it did not use
        self._file.flush()
        self._reserve(0)

    def __enter__(self) -> ResultWriter:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _create(self, texts: bytes) -> None:
        file = self._file
        file.attrs["format"], file.attrs["version"] = FORMAT, VERSION
        file["header"] = np.frombuffer(texts, dtype=np.uint8)
        file["committed"] = np.array([0, -1])
        file.create_dataset("blocks", shape=(0, 5), maxshape=(None, 5), chunks=(256, 5), dtype=np.int64)
        for name in self._text:
            file.create_dataset(name, shape=(0,), maxshape=(None,), chunks=(4096,), dtype=np.uint8)
        for group, buffer in self._pending.items():
            for name, column in buffer.views().items():
                shape = column.shape[1:]
                # a series without entries (no sliders) needs no dataset, only its shape in the header
                if 0 not in shape:
                    file.create_dataset(f"{group}/{name}", shape=(0, *shape), maxshape=(None, *shape),
                                        chunks=_chunk(shape), dtype=column.dtype)
        file.swmr_mode = True
        file.flush()

    def _extend_rows(self, group: str, buffer: RowBuffer) -> None:
        if not len(buffer):
            return
        first, last = self._count[group], self._count[group] + len(buffer)
        for name, column in buffer.views().items():
            if 0 not in column.shape[1:]:
                dataset = self._file[f"{group}/{name}"]
                dataset.resize(last, axis=0)
                dataset[first:last] = column
                self._crc = zlib.crc32(np.ascontiguousarray(column), self._crc)
        self._count[group] = last
        buffer.clear()

    def _extend_text(self, name: str) -> None:
        if self._text[name]:
            first, last = self._count[name], self._count[name] + len(self._text[name])
            self._file[name].resize(last, axis=0)
            self._file[name][first:last] = np.frombuffer(self._text[name], dtype=np.uint8)
            self._crc = zlib.crc32(self._text[name], self._crc)
            self._count[name], self._text[name] = last, b""

    def _flush_when_due(self) -> None:
        if (time.perf_counter() - self._last_flush > FLUSH_TIME or len(self._pending["rows"]) >= FLUSH_ROWS
                or len(self._pending["snapshots"]) * self._snapshot_bytes >= PENDING_BYTES):
            self.flush()

    def _check_open(self) -> None:
        if self._file is None:
            raise ResultFileError(f"result file '{self.path}': already closed; nothing more can be added")


def save_result(result: Result, path: str | PathLike[str], *, overwrite: bool = False) -> None:
    """Write a finished result to a new file (see `Result.save`)."""
    with ResultWriter(path, result.header(), overwrite=overwrite) as writer:
        if len(result.t):
            writer.append(result.series, result.t)
        for t, phi, d in zip(result.t_snap, result.phi, result.directors, strict=True):
            writer.snapshot(float(t), phi, d)
        for event in result.events:
            writer.event(event)


def _claim(handle: int, first: int, size: int) -> None:
    """Make the file system set this range aside, where it can."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(handle, first, size)


def _check_target(path: Path, overwrite: bool) -> Path:
    if not path.parent.is_dir():
        raise ResultFileError(f"result file '{path}': folder '{path.parent}' does not exist; create it first")
    if path.is_dir():
        raise ResultFileError(f"result file '{path}': is a folder; give the name of a file")
    if path.exists() and not overwrite:
        raise ResultFileError(f"result file '{path}': exists already; pass overwrite=True or choose another path")
    return path


def _chunk(shape: tuple[int, ...]) -> tuple[int, ...]:
    row_bytes = 8 * int(np.prod(shape, dtype=np.int64))
    return (int(np.clip(CHUNK_BYTES // row_bytes, 1, 1024)), *shape)


def _encode(value: Any, noun: str) -> bytes:
    """JSON bytes; NumPy scalars and arrays become numbers and lists."""
    try:
        return json.dumps(value, default=_plain).encode()
    except (TypeError, ValueError) as error:
        raise ResultFileError(f"result {noun}: only numbers, texts, lists and dicts can be stored ({error})") from error


def _plain(value: Any) -> Any:
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} {value!r}")
