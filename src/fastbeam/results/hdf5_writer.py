"""Results in HDF5 files, written as the run goes and readable after the writer was killed.

All datasets are created before the first step; then the file is switched to single-writer-multiple-reader mode, in which HDF5
keeps the file consistent at every moment. Rows are gathered in memory and flushed at most every half second. Every flush adds a
line to 'blocks': how many rows, snapshots and bytes of text there are, and a checksum of all numbers until then; 'committed' says
how many lines count. Texts (header, events, final info) are bytes of JSON.

    format, version        attributes
    header                 uint8 [k]      JSON of ResultHeader
    rows/<series>          [n, ...]       one dataset per series, 't' among them
    snapshots/<name>       [m, ...]       t_snap, phi, directors, velocities, spins, mesh
    events, final_info     uint8 [k]      JSON lines; JSON
    blocks                 int64 [b, 5]   rows, snapshots, bytes of events, bytes of final_info, CRC-32 of all of it
    committed              int64 [2]      b, -b - 1

HDF5 does not survive a full disk (it may crash the process), so space is claimed from the file system before anything is written.
Files are read without trust: no links, filters, foreign types or external data, nothing larger than the file itself.
"""
from __future__ import annotations

import errno
import json
import os
import time
import zlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields
from os import PathLike
from pathlib import Path
from typing import Any, BinaryIO

try:
    import fcntl
except ImportError:  # no such locks on this system
    fcntl = None  # type: ignore[assignment]

import numpy as np

from fastbeam.interface.arguments import FilePath, take
from fastbeam.interface.errors import ResultFileError
from fastbeam.interface.paths import check_new, claim
from fastbeam.results.hdf5_reader import (
    COUNTS,
    FORMAT,
    MARGIN,
    MOST_EVENT_BYTES,
    MOST_EVENTS,
    MOST_PARTS,
    VERSION,
    import_h5py,
    load_result,
    parts_of,
)
from fastbeam.results.result import Result, ResultHeader, shape_row
from fastbeam.results.rows import RowBuffer, Rows

__all__ = ["ResultWriter", "load_result", "save_result"]

# s and rows between two flushes
FLUSH_TIME, FLUSH_ROWS = 0.5, 4096
# bytes aimed at per chunk of a dataset, and per block of snapshots that waits in memory
CHUNK_BYTES, PENDING_BYTES = 32768, 1 << 24
# files that HDF5 could not write to: closing one may crash
_LOST: list[Any] = []


class _Waiting:
    """Data that wait in memory, and the counts and checksum of all that a file holds before them; count: rows, snapshots and
    bytes of text in the file, in the order of COUNTS."""

    def __init__(self, header: ResultHeader, count: dict[str, int], blocks: int, crc: int) -> None:
        self.pending = {"rows": RowBuffer(*header.row_tables()), "snapshots": RowBuffer(header.snapshot_tables(), capacity=1)}
        self.text = {"events": b"", "final_info": b""}
        self.count, self.blocks, self.crc = count, blocks, crc


class ResultWriter:
    """Writer of a run to a file while it goes; takes the same calls as `result.ResultBuffer`.

    After a kill at any moment the file opens and holds everything flushed before.

    path: the new file.
    header: names and shapes of all series.
    overwrite: replace an existing file.
    Raises BackendError: h5py is missing.
    Raises ResultFileError: the file exists, or another run writes it, or its folder does not exist, or it cannot be created;
        later, it cannot be written, or it was removed or replaced.
    Raises SceneError: the path is not a path.
    """

    def __init__(self, path: str | PathLike[str], header: ResultHeader, *, overwrite: bool = False) -> None:
        h5py = import_h5py()
        self._file: Any = None
        self.path = take(FilePath(), "file:", path)
        self.header = header
        texts = _encode({item.name: getattr(header, item.name) for item in fields(header)}, "header")
        if parts_of(texts) > MOST_PARTS:
            raise ResultFileError(f"result file '{self.path}': the names of this model need more than {MOST_PARTS} lists, which "
                                  "is the limit of readers; put beams into nets, or run without file=")
        self._state = _Waiting(header, dict.fromkeys(COUNTS, 0), 0, zlib.crc32(texts))
        self._events = 0
        self._snapshot_bytes = 8 * (1 + (12 + 3 * header.velocities + 3 * header.spins) * header.n_nodes + 12 * header.mesh)
        # absolute, so that a change of the current folder does not matter
        self._where = Path(os.path.realpath(self.path))
        self._raw = _open(self.path, self._where, overwrite)
        try:
            self._raw.truncate(0)
            claim(self._raw.fileno(), 0, len(texts) + MARGIN)
            # until others may read the file HDF5 keeps a lock of its own
            lock(self._raw, "LOCK_UN")
            self._file = h5py.File(self._where, "w", libver="latest")
            self._reserve(len(texts))
            self._create(texts)
            lock(self._raw, "LOCK_SH")
        except BaseException as error:
            if self._file is not None:
                with suppress(OSError, RuntimeError):
                    self._file.close()
            # half a file is none, also where Ctrl-C cut it short
            if lock(self._raw, "LOCK_EX"):
                self._where.unlink(missing_ok=True)
            self._raw.close()
            if not isinstance(error, OSError):
                raise
            raise ResultFileError(f"result file '{self.path}': cannot be created ({error}); choose another path") from error
        self._last_flush = time.perf_counter()

    def append(self, rows: Rows, t: Any) -> None:
        """Add one row (t a number, s) or a block (t [m], arrays with first axis m) of all series of the header."""
        self._check_open()
        times = np.asarray(t, dtype=np.float64)
        self._state.pending["rows"].append({"t": times, **rows}, None if times.ndim == 0 else len(times))
        self._flush_when_due()

    def snapshot(self, t: float, phi: np.ndarray, d: np.ndarray, v: np.ndarray | None = None,
                 w: np.ndarray | None = None, mesh: np.ndarray | None = None) -> None:
        """Add the shape at time t (s): phi [N, 3] (m), d [N, 3, 3] (rows d1, d2, d3), v (m/s) and w (rad/s) [N, 3], mesh
        [M, 4, 3] where the header says so."""
        self._check_open()
        self._state.pending["snapshots"].append(shape_row(self.header, t, phi, d, v, w, mesh))
        self._flush_when_due()

    def event(self, event: dict[str, Any]) -> None:
        """Add an event {'kind', 'time', 'text', ...} (JSON-able)."""
        self._check_open()
        text = self._state.text["events"] + _encode(event, "event") + b"\n"
        size = self._state.count["events"] + len(text)
        if self._events >= MOST_EVENTS or size > MOST_EVENT_BYTES or parts_of(text) > MOST_PARTS:
            raise ResultFileError(f"result file '{self.path}': more than {MOST_EVENTS} events, {MOST_EVENT_BYTES} bytes of them "
                                  f"or {MOST_PARTS} lists in them, which is the limit of readers; leave some out")
        self._state.text["events"] = text
        self._events += 1
        self._flush_when_due()

    def flush(self) -> None:
        """Write everything that waits in memory; after this a kill does not lose it."""
        self._check_open()
        before = self._state
        if not any(map(len, (*before.pending.values(), *before.text.values()))):
            return
        try:
            self._check_place()
            self._reserve(self._growth())
        except OSError as error:
            # nothing was handed to HDF5 yet: the file is sound and can be closed
            with suppress(ResultFileError):
                self._end()
            raise self._unwritable(error) from error
        # an interrupt at any point leaves the state as it was: the next flush writes the same to the same places
        after = _Waiting(self.header, dict(before.count), before.blocks + 1, before.crc)
        try:
            for group, buffer in before.pending.items():
                self._extend_rows(group, buffer, after)
            for name, text in before.text.items():
                self._extend_text(name, text, after)
            # the data reach the file before the line that vouches for them, and that before the count of lines
            self._sync()
            self._file["blocks"].resize(after.blocks, axis=0)
            self._file["blocks"][after.blocks - 1] = [*after.count.values(), after.crc]
            self._sync()
            self._file["committed"][...] = [after.blocks, -after.blocks - 1]
            self._sync()
        except (OSError, RuntimeError) as error:
            _LOST.append(self._file)
            self._file = None
            self._raw.close()
            raise self._unwritable(error) from error
        self._state = after
        self._last_flush = time.perf_counter()

    def close(self, info: Mapping[str, Any] | None = None) -> None:
        """Flush, store the final info (added to the header's) and close; safe to call twice."""
        if self._file is None:
            return
        try:
            if info:
                self._state.text["final_info"] = _encode(dict(info), "info")
            self.flush()
        finally:
            self._end()

    def _end(self) -> None:
        """Close the file and give back the space that was claimed for nothing."""
        if self._file is None:
            return
        file, self._file = self._file, None
        try:
            # a block that an interrupt cut short does not count
            count = int(file["committed"][0])
            if len(file["blocks"]) != count:
                file["blocks"].resize(count, axis=0)
            file.close()
            with self._raw as raw:
                raw.seek(0)
                block, size = raw.read(36), raw.seek(0, 2)
                end = int.from_bytes(block[28:36], "little")
                if block[8] >= 3 and 0 < end < size:
                    raw.truncate(end)
        except (OSError, RuntimeError) as error:
            raise self._unwritable(error) from error

    def _check_place(self) -> None:
        """Refuse to go on where the file of this name is another one. Raises OSError."""
        with suppress(OSError):
            if os.path.samestat(os.stat(self._where), os.fstat(self._raw.fileno())):
                return
        raise FileNotFoundError(errno.ENOENT, "it was removed, moved or replaced during the run")

    def _unwritable(self, error: BaseException) -> ResultFileError:
        cause = str(error).replace("\n", " ")
        advice = ("save what the run has computed with .result.save(path) of this error" if isinstance(error, FileNotFoundError)
                  else "it holds all rows written before; free disk space, or choose another path")
        return ResultFileError(f"result file '{self.path}': cannot be written ({cause}); {advice}")

    def _growth(self) -> int:
        """Return the bytes that the next flush adds to the file at most."""
        state = self._state
        out = sum(len(text) + 4096 for text in state.text.values())
        for group, buffer in state.pending.items():
            first, last = state.count[group], state.count[group] + len(buffer)
            for name, column in buffer.views().items():
                if 0 not in column.shape[1:]:
                    rows = _chunk(column.shape[1:])[0]
                    row_bytes = 8 * int(np.prod(column.shape[1:], dtype=np.int64))
                    out += (-(-last // rows) + -(-first // -rows)) * rows * row_bytes
        return out

    def _reserve(self, size: int) -> None:
        claim(self._raw.fileno(), int(self._file.id.get_filesize()), size + MARGIN)

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
        for name in self._state.text:
            file.create_dataset(name, shape=(0,), maxshape=(None,), chunks=(4096,), dtype=np.uint8)
        for group, buffer in self._state.pending.items():
            for name, column in buffer.views().items():
                shape = column.shape[1:]
                # a series without entries (no sliders) needs no dataset, only its shape in the header
                if 0 not in shape:
                    file.create_dataset(f"{group}/{name}", shape=(0, *shape), maxshape=(None, *shape),
                                        chunks=_chunk(shape), dtype=column.dtype)
        file.swmr_mode = True
        file.flush()

    def _extend_rows(self, group: str, buffer: RowBuffer, after: _Waiting) -> None:
        if not len(buffer):
            return
        first, last = after.count[group], after.count[group] + len(buffer)
        for name, column in buffer.views().items():
            if 0 not in column.shape[1:]:
                dataset = self._file[f"{group}/{name}"]
                dataset.resize(last, axis=0)
                dataset[first:last] = column
                after.crc = zlib.crc32(np.ascontiguousarray(column), after.crc)
        after.count[group] = last

    def _extend_text(self, name: str, text: bytes, after: _Waiting) -> None:
        if text:
            first, last = after.count[name], after.count[name] + len(text)
            self._file[name].resize(last, axis=0)
            self._file[name][first:last] = np.frombuffer(text, dtype=np.uint8)
            after.crc = zlib.crc32(text, after.crc)
            after.count[name] = last

    def _flush_when_due(self) -> None:
        if (time.perf_counter() - self._last_flush > FLUSH_TIME or len(self._state.pending["rows"]) >= FLUSH_ROWS
                or len(self._state.pending["snapshots"]) * self._snapshot_bytes >= PENDING_BYTES):
            self.flush()

    def _check_open(self) -> None:
        if self._file is None:
            raise ResultFileError(f"result file '{self.path}': already closed; nothing more can be added")


def save_result(result: Result, path: str | PathLike[str], *, overwrite: bool = False) -> None:
    """Write a finished result to a new file (see `Result.save`)."""
    with ResultWriter(path, result.header(), overwrite=overwrite) as writer:
        if len(result.t):
            writer.append(result.series, result.t)
        for k, (t, phi, d) in enumerate(zip(result.t_snap, result.phi, result.directors, strict=True)):
            more = result.velocities, result.spins, result.mesh
            writer.snapshot(float(t), phi, d, *(None if x is None else x[k] for x in more))
        for event in result.events:
            writer.event(event)


def _open(path: Path, where: Path, overwrite: bool) -> BinaryIO:
    """Open a file for writing that no other run writes; its contents stay for now. Raises ResultFileError."""
    try:
        check_new("result file", where, path, overwrite)
        raw = open(os.open(where, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666), "rb+", buffering=0)
    except OSError as error:
        raise ResultFileError(f"result file '{path}': cannot be created ({error}); choose another path") from error
    if not lock(raw, "LOCK_EX"):
        raw.close()
        raise ResultFileError(f"result file '{path}': another run is writing it, or another program has it open; wait for that, "
                              "or choose another path")
    return raw


def lock(raw: BinaryIO, kind: str) -> bool:
    """Keep other runs from writing a file until it is closed; under a shared lock others may read it with HDF5's own. False:
    somebody else has it."""
    if fcntl is not None:
        try:
            fcntl.flock(raw, getattr(fcntl, kind) | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:
            pass  # a file system without locks
    return True


def _chunk(shape: tuple[int, ...]) -> tuple[int, ...]:
    row_bytes = 8 * int(np.prod(shape, dtype=np.int64))
    return (int(np.clip(CHUNK_BYTES // row_bytes, 1, 1024)), *shape)


def _encode(value: Any, noun: str) -> bytes:
    """Encode a value as JSON bytes; NumPy scalars and arrays become numbers and lists."""
    try:
        return json.dumps(value, default=_as_json).encode()
    except (TypeError, ValueError) as error:
        raise ResultFileError(f"result {noun}: only numbers, texts, lists and dicts can be stored ({error})") from error


def _as_json(value: Any) -> Any:
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} {value!r}")
