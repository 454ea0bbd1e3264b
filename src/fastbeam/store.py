"""Results in HDF5 files, written as the run goes and readable after the writer was killed.

All datasets are created before the first step; then the file is switched to single-writer-multiple-reader mode, in which HDF5
keeps the file consistent at every moment. Rows are gathered in memory and flushed at most every half second; afterwards the
dataset 'committed' says how many rows, snapshots and bytes of text count. Texts (header, events, final info) are bytes of JSON.

    format, version        attributes
    header                 uint8 [k]      JSON of ResultHeader
    rows/<series>          [n, ...]       one dataset per series, 't' among them
    snapshots/<name>       [m, ...]       t_snap, phi, directors
    events, final_info     uint8 [k]      JSON lines; JSON
    committed              int64 [4]      rows, snapshots, bytes of events, bytes of final_info
"""
from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import asdict
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from .errors import BackendError, ResultFileError
from .result import Result, ResultHeader, RowBuffer, Rows

FORMAT, VERSION = "fastbeam-result", 1
# s and rows between two flushes
FLUSH_TIME, FLUSH_ROWS = 0.5, 4096
# bytes aimed at per chunk of a dataset, and per block of snapshots that waits in memory
CHUNK_BYTES, PENDING_BYTES = 32768, 1 << 24


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
        The file exists, or its folder does not, or it cannot be created.
    """

    def __init__(self, path: str | PathLike[str], header: ResultHeader, *, overwrite: bool = False) -> None:
        h5py = _h5py()
        self.path = _check_target(Path(path), overwrite)
        self.header = header
        texts = _encode({**asdict(header), "info": header.info, "names": header.names}, "header")
        shapes, dtypes = header.row_tables()
        self._pending = {"rows": RowBuffer(shapes, dtypes), "snapshots": RowBuffer(header.snapshot_tables(), capacity=1)}
        self._snapshot_bytes = 8 * (1 + 12 * header.n_nodes)
        self._text = {"events": b"", "final_info": b""}
        self._count = {"rows": 0, "snapshots": 0, "events": 0, "final_info": 0}
        try:
            self._file = h5py.File(self.path, "w", libver="latest")
        except OSError as error:
            raise ResultFileError(f"result file '{self.path}': cannot be created ({error}); choose another path") from error
        try:
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
        for group, buffer in self._pending.items():
            self._extend_rows(group, buffer)
        for name in self._text:
            self._extend_text(name)
        # the data reach the file before the count that vouches for them
        self._file.flush()
        self._file["committed"][...] = list(self._count.values())
        self._file.flush()
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
            self._file.close()
            self._file = None

    def __enter__(self) -> ResultWriter:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _create(self, texts: bytes) -> None:
        file = self._file
        file.attrs["format"], file.attrs["version"] = FORMAT, VERSION
        file["header"] = np.frombuffer(texts, dtype=np.uint8)
        file["committed"] = np.zeros(len(self._count), dtype=np.int64)
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
        self._count[group] = last
        buffer.clear()

    def _extend_text(self, name: str) -> None:
        if self._text[name]:
            first, last = self._count[name], self._count[name] + len(self._text[name])
            self._file[name].resize(last, axis=0)
            self._file[name][first:last] = np.frombuffer(self._text[name], dtype=np.uint8)
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


def load_result(path: str | PathLike[str]) -> Result:
    """Read a result file, also one whose writer was killed or is still running.

    Raises
    ------
    BackendError
        h5py is missing.
    ResultFileError
        The file is missing, not HDF5, not a fastbeam result, of a newer format, or damaged.
    """
    h5py = _h5py()
    path = Path(path)
    with _open_file(h5py, path) as file:
        try:
            return _read(file, path)
        except ResultFileError:
            raise
        except (OSError, KeyError, ValueError, TypeError, AttributeError, RuntimeError) as error:
            raise ResultFileError(f"result file '{path}': damaged ({error})") from error


def _read(file: Any, path: Path) -> Result:
    found = file.attrs.get("format")
    if found != FORMAT:
        raise ResultFileError(f"result file '{path}': not a fastbeam result (attribute 'format' is {found!r}, "
                              f"expected '{FORMAT}')")
    version = int(file.attrs.get("version", 0))
    if not 1 <= version <= VERSION:
        raise ResultFileError(f"result file '{path}': format version {version}, this fastbeam reads 1 to {VERSION}; "
                              "install a newer fastbeam")
    missing = [name for name in ("header", "committed", "events", "final_info", "rows/t") if name not in file]
    if missing:
        raise ResultFileError(f"result file '{path}': damaged, it lacks {', '.join(missing)}")
    raw = json.loads(bytes(file["header"][...]))
    header = ResultHeader(raw["model_text"], raw["info"], raw["names"], raw["n_nodes"],
                          {name: tuple(shape) for name, shape in raw["series"].items()}, tuple(raw["integer"]))
    n_rows, n_snapshots, n_events, n_info = (int(k) for k in file["committed"][...])
    shapes, dtypes = header.row_tables()
    series = _read_group(file, "rows", shapes, dtypes, n_rows, path)
    snapshots = _read_group(file, "snapshots", header.snapshot_tables(), {}, n_snapshots, path)
    events = [json.loads(line) for line in bytes(file["events"][:n_events]).splitlines()]
    info = json.loads(bytes(file["final_info"][:n_info]) or b"{}")
    return Result(model_text=header.model_text, info={**header.info, **info}, names=header.names, t=series.pop("t"),
                  series=series, events=events, **snapshots)


def _read_group(file: Any, group: str, shapes: Mapping[str, tuple[int, ...]], dtypes: Mapping[str, type], n: int,
                path: Path) -> dict[str, np.ndarray]:
    stored = {name for name, shape in shapes.items() if 0 not in shape}
    missing = [f"{group}/{name}" for name in sorted(stored) if f"{group}/{name}" not in file]
    if missing:
        raise ResultFileError(f"result file '{path}': damaged, it lacks {', '.join(missing)}")
    # cut to what all series hold
    n = min([n, *(len(file[f"{group}/{name}"]) for name in stored)])
    return {name: file[f"{group}/{name}"][:n] if name in stored else np.zeros((n, *shape), dtypes.get(name, np.float64))
            for name, shape in shapes.items()}


def _open_file(h5py: Any, path: Path) -> Any:
    if not path.is_file():
        raise ResultFileError(f"result file '{path}': no such file")
    try:
        if not h5py.is_hdf5(path):
            raise ResultFileError(f"result file '{path}': not an HDF5 file")
        # a file that was never closed opens only as a reader beside a writer
        return h5py.File(path, "r", libver="latest", swmr=True) if _left_open(path) else h5py.File(path, "r")
    except OSError as error:
        raise ResultFileError(f"result file '{path}': cannot be opened ({error})") from error


def _left_open(path: Path) -> bool:
    """Whether the file was never closed by its writer, from the superblock (HDF5 file format, version 3).

    A reader beside a writer waits without end for data that a truncated file will never hold, so such a file is refused here.
    """
    with path.open("rb") as raw:
        block = raw.read(36)
        size = raw.seek(0, 2)
    # byte 8: version; byte 11: consistency flags; bytes 28-35: end of the file when the superblock was last written
    if len(block) < 36 or block[8] < 3 or block[11] == 0:
        return False
    if size < int.from_bytes(block[28:36], "little"):
        raise ResultFileError(f"result file '{path}': truncated, {size} bytes of {int.from_bytes(block[28:36], 'little')}")
    return True


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


def _h5py() -> Any:
    try:
        import h5py
    except ImportError as error:
        raise BackendError("result files need h5py: pip install h5py") from error
    return h5py
