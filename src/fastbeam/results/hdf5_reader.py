"""Reads result files (layout: `store`) without trusting them.

No links, filters, foreign types or external data are followed, nothing larger than the file itself is allocated, and every number
and text has to fit the checksums that the writer left.
"""
from __future__ import annotations

import io
import json
import time
import zlib
from collections.abc import Callable, Iterable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fastbeam.interface.arguments import FilePath, checked
from fastbeam.interface.errors import BackendError, ResultFileError
from fastbeam.interface.paths import check_regular
from fastbeam.results.result import Result, ResultHeader

Array = np.ndarray
T = TypeVar("T")
FORMAT, VERSION = "fastbeam-result", 2
COUNTS = ("rows", "snapshots", "events", "final_info")
# bytes that a writer claims beyond its data, for what HDF5 adds of its own
MARGIN = 1 << 18
# bytes of the superblock of HDF5; how often a file that is being written is tried
SUPERBLOCK, ATTEMPTS = 48, 5
# texts grow a hundredfold when they become objects, lists and dicts most: bounds of honest files
MOST_EVENTS, MOST_EVENT_BYTES, MOST_PARTS = 100_000, 1 << 25, 1_000_000


@checked(path=FilePath())
def load_result(path: str | PathLike[str]) -> Result:
    """Read a result file, also one whose writer was killed or is still running.

    Raises
    ------
    BackendError
        h5py is missing.
    ResultFileError
        The file is missing, not HDF5, not a fastbeam result, of a newer format, or damaged.
    """
    return read_file("result file", Path(path), lambda reader: reader.result())


def read_file(kind: str, path: Path, read: Callable[[Reader], T]) -> T:
    """Return what `read` finds in a file; call it again where it fails on a file whose writer may be running. Raises
    ResultFileError: it is no HDF5 file, or the last call failed."""
    h5py = import_h5py()
    for attempt in reversed(range(ATTEMPTS)):
        left_open = check_file(path)
        try:
            with LeftOpen(path) if left_open else path.open("rb") as raw, h5py.File(raw, "r") as file:
                return read(Reader(h5py, file, path, left_open))
        except Exception as error:  # whatever a damaged file makes HDF5, JSON or NumPy raise
            # something may be half written for a moment
            if not (left_open and attempt):
                if isinstance(error, ResultFileError):
                    raise
                why = "too large to be read with the memory that is left" if isinstance(error, MemoryError) else (
                    f"damaged ({type(error).__name__}: {error})")
                raise ResultFileError(f"{kind} '{path}': {why}") from error
            time.sleep(0.1)
    raise AssertionError("unreachable")


class Reader:
    """Reader of one open file. Whoever wrote it may have meant harm: types, layouts and sizes are checked before anything is
    read."""

    def __init__(self, h5py: Any, file: Any, path: Path, left_open: bool) -> None:
        self.h5py, self.file, self.path, self.left_open = h5py, file, path, left_open
        # no honest file holds more numbers than bytes
        self.budget = path.stat().st_size

    def refuse(self, why: str) -> ResultFileError:
        return ResultFileError(f"result file '{self.path}': {why}")

    def result(self) -> Result:
        found = self.attribute("format")
        if found != FORMAT:
            raise self.refuse(f"not a fastbeam result (attribute 'format' is {found!r:.60}, expected '{FORMAT}')")
        version = int(self.attribute("version") or 0)
        if not 1 <= version <= VERSION:
            raise self.refuse(f"format version {version}, this fastbeam reads 1 to {VERSION}; install a newer fastbeam")
        # this count before anything else: a writer may go on, and all it adds later comes on top
        self.present(["committed"])
        committed = self.read("committed", np.int64, ())
        self.present(["header", "events", "final_info", "rows/t", *(["blocks"] if version > 1 else [])])
        text = self.read("header", np.uint8, ()).tobytes()
        self.bound("header", text)
        header = _parse_header(json.loads(text))
        blocks = self.blocks(committed) if version > 1 else np.append(committed, 0)[None, :]
        if blocks.shape[1] != 5 or np.any(np.diff(blocks[:, :4], axis=0, prepend=0) < 0):
            raise self.refuse("damaged, the counts of its blocks are not valid")
        ends = blocks[-1] if len(blocks) else np.zeros(5, np.int64)
        shapes, dtypes = header.row_tables()
        strict = version > 1
        data = {"rows": self.group("rows", shapes, dtypes, int(ends[0]), strict),
                "snapshots": self.group("snapshots", header.snapshot_tables(), {}, int(ends[1]), strict)}
        texts = {name: self.read(name, np.uint8, (), int(n), strict).tobytes() for name, n in zip(COUNTS[2:], ends[2:])}
        if strict:
            self.verify(blocks, text, data, texts)
        for name in texts:
            self.bound(name, texts[name])
        if texts["events"].count(b"\n") > MOST_EVENTS or len(texts["events"]) > MOST_EVENT_BYTES:
            raise self.refuse(f"damaged, {texts['events'].count(10)} events of {len(texts['events'])} bytes exceed the limit of "
                              f"{MOST_EVENTS} events or {MOST_EVENT_BYTES} bytes")
        events = [json.loads(line) for line in texts["events"].splitlines()]
        info = json.loads(texts["final_info"] or b"{}")
        if not isinstance(info, dict) or not all(isinstance(event, dict) for event in events):
            raise self.refuse("damaged, its events or run information are not dicts")
        series = data["rows"]
        return Result(model_text=header.model_text, info=_checked_info({**header.info, **info}), names=header.names,
                      t=series.pop("t"), series=series, events=events, **data["snapshots"])

    def bound(self, name: str, text: bytes) -> None:
        """Refuse texts of which objects would take far more memory than the file."""
        if parts_of(text) > MOST_PARTS:
            raise self.refuse(f"damaged, {parts_of(text)} lists in '{name}', more than {MOST_PARTS}")

    def attribute(self, name: str) -> Any:
        """Read an attribute of the root that is one text or number, else return None."""
        if name not in self.file.attrs or self.file.attrs.get_id(name).shape != ():
            return None
        value = self.file.attrs[name]
        return value if isinstance(value, (str, int, np.integer)) else None

    def blocks(self, committed: Array) -> Array:
        n = int(committed[0])
        if committed.tolist() != [n, -n - 1] or n < 0:
            raise self.refuse("damaged, the number of its blocks is missing")
        blocks = self.read("blocks", np.int64, (5,), n, strict=True)
        if not self.left_open and n != len(self.file["blocks"]):
            raise self.refuse("damaged, its numbers of blocks at the start and at the end differ")
        return blocks

    def verify(self, blocks: Array, header: bytes, data: dict[str, dict[str, Array]], texts: dict[str, bytes]) -> None:
        """Compare the checksums of all blocks."""
        crc = zlib.crc32(header)
        before = np.zeros(4, np.int64)
        for k, (*ends, expected) in enumerate(blocks.tolist()):
            for at, group in enumerate(data.values()):
                for x in group.values():
                    if ends[at] > before[at] and x.size:
                        crc = zlib.crc32(x[before[at]:ends[at]], crc)
            for at, text in enumerate(texts.values(), 2):
                crc = zlib.crc32(text[before[at]:ends[at]], crc)
            if crc != expected:
                raise self.refuse(f"damaged, the checksum of block {k} of {len(blocks)} is wrong (rows {before[0]} to {ends[0]})")
            before = ends

    def present(self, names: Iterable[str]) -> None:
        """Refuse files that lack datasets or hold something else under their names."""
        missing = []
        for name in names:
            group = self.file
            for part in name.split("/"):
                link = group.get(part, getlink=True) if isinstance(group, self.h5py.Group) else None
                if link is None:
                    missing.append(name)
                    break
                if type(link) is not self.h5py.HardLink:
                    raise self.refuse(f"damaged, '{name}' is a link to another place")
                group = group[part]
        if missing:
            raise self.refuse(f"damaged, it lacks {', '.join(missing)}")

    def read(self, name: str, dtype: Any, shape: tuple[int, ...], n: int | None = None, strict: bool = False) -> Array:
        """Read the first n rows of a dataset (all: None), fewer where there are no more and not `strict`."""
        dataset = self.file[name]
        if not isinstance(dataset, self.h5py.Dataset):
            raise self.refuse(f"damaged, '{name}' is not a dataset")
        plan, h5d = dataset.id.get_create_plist(), self.h5py.h5d
        if (plan.get_nfilters() or plan.get_external_count()
                or plan.get_layout() not in (h5d.CHUNKED, h5d.CONTIGUOUS, h5d.COMPACT)):
            raise self.refuse(f"damaged, '{name}' has filters or refers to other files")
        if dataset.dtype != np.dtype(dtype) or dataset.ndim != 1 + len(shape) or dataset.shape[1:] != shape:
            raise self.refuse(f"damaged, '{name}' is {dataset.dtype} {dataset.shape}, expected {np.dtype(dtype)} {('n', *shape)}")
        n = len(dataset) if n is None else n
        if n > len(dataset):
            if strict:
                raise self.refuse(f"damaged, '{name}' has {len(dataset)} of {n} rows")
            n = len(dataset)
        row_bytes = dataset.dtype.itemsize * int(np.prod(shape, dtype=object))
        self.budget -= n * row_bytes
        if self.budget < 0 or row_bytes * (dataset.chunks or (0,))[0] > self.path.stat().st_size + MARGIN:
            raise self.refuse(f"damaged, '{name}' claims more data than the file holds")
        return dataset[:n]

    def group(self, group: str, shapes: Mapping[str, tuple[int, ...]], dtypes: Mapping[str, type], n: int,
              strict: bool) -> dict[str, Array]:
        stored = [name for name, shape in shapes.items() if 0 not in shape]
        self.present(f"{group}/{name}" for name in stored)
        # files of version 1 are cut to what all series hold
        data = {name: self.read(f"{group}/{name}", dtypes.get(name, np.float64), shapes[name], n, strict) for name in stored}
        n = min([n, *map(len, data.values())])
        return {name: data[name][:n] if name in data else np.zeros((n, *shape), dtypes.get(name, np.float64))
                for name, shape in shapes.items()}


def parts_of(text: bytes) -> int:
    """Return the largest number of lists and dicts that a text of JSON can hold."""
    return text.count(b"{") + text.count(b"[")


def _parse_header(raw: Any) -> ResultHeader:
    """Read the header of a file, with the types it should have. Raises ValueError: one of them is something else."""
    series = raw["series"]
    _expect("model_text", raw["model_text"], str)
    for name in ("info", "names", "series"):
        _expect(name, raw[name], dict)
    _expect("integer", raw["integer"], list)
    for name, what in raw["names"].items():
        _expect(f"names of {name}", what, list)
    for name, shape in series.items():
        _expect(f"shape of {name}", shape, list)
        if len(shape) > 4:
            raise ValueError(f"shape of {name}: {len(shape)} axes")
    mesh = raw.get("mesh", 0)
    for size in (raw["n_nodes"], mesh, *(k for shape in series.values() for k in shape)):
        if type(size) is not int or not 0 <= size < 2**40:
            raise ValueError(f"header: {size!r:.60} is not a size")
    moving = raw.get("velocities", False), raw.get("spins", False)
    for name, there in zip(("velocities", "spins"), moving):
        _expect(name, there, bool)
    return ResultHeader(raw["model_text"], raw["info"], raw["names"], raw["n_nodes"],
                        {name: tuple(shape) for name, shape in series.items()}, tuple(map(str, raw["integer"])),
                        *moving, mesh)


def _checked_info(info: dict[str, Any]) -> dict[str, Any]:
    """Check the facts that the result computes with."""
    _expect("scale", info.get("scale", {}), dict)
    _expect("conserved", info.get("conserved", []), list)
    for name, x in info.get("scale", {}).items():
        _expect(f"scale of {name}", x, (int, float))
    return info


def _expect(name: str, value: Any, kind: Any) -> None:
    if not isinstance(value, kind):
        raise ValueError(f"{name} is a {type(value).__name__}")


def check_file(path: Path) -> bool:
    """Return whether the file was never closed by its writer, from the superblock (HDF5 file format, version 3). Raises
    ResultFileError: there is no such file, it is not HDF5, or it is shorter than it was."""
    try:
        if not path.exists():
            raise ResultFileError(f"result file '{path}': no such file")
        check_regular("result file", path, path)
        with path.open("rb") as raw:
            block = raw.read(SUPERBLOCK)
            size = raw.seek(0, 2)
    except OSError as error:
        raise ResultFileError(f"result file '{path}': cannot be opened ({error})") from error
    if block[:8] != b"\x89HDF\r\n\x1a\n":
        raise ResultFileError(f"result file '{path}': not an HDF5 file")
    # byte 8: version; byte 11: consistency flags; bytes 28-35: end of the file when the superblock was last written
    if len(block) < SUPERBLOCK or block[8] < 3 or block[11] == 0:
        return False
    if size < int.from_bytes(block[28:36], "little"):
        raise ResultFileError(f"result file '{path}': truncated, {size} bytes of {int.from_bytes(block[28:36], 'little')}")
    return True


class LeftOpen(io.RawIOBase):
    """A file whose writer runs or was killed, shown with the superblock of one that was closed.

    HDF5 opens such a file only as a reader beside a writer, and then waits without end where a checksum stays wrong.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._raw = path.open("rb", buffering=0)
        block = bytearray(self._raw.read(SUPERBLOCK))
        if lookup3(block[:-4]) != int.from_bytes(block[-4:], "little"):
            self._raw.close()
            raise ResultFileError(f"result file '{path}': damaged, the checksum of its superblock is wrong")
        block[11] = 0
        block[28:36] = self._raw.seek(0, 2).to_bytes(8, "little")
        block[-4:] = lookup3(block[:-4]).to_bytes(4, "little")
        self._block = bytes(block)

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._raw.seek(offset, whence)

    def tell(self) -> int:
        return self._raw.tell()

    def readinto(self, buffer: Any) -> int:
        first = self._raw.tell()
        n = self._raw.readinto(buffer) or 0
        shown = self._block[first:first + n]
        memoryview(buffer).cast("B")[:len(shown)] = shown
        return n

    def close(self) -> None:
        self._raw.close()
        super().close()


def lookup3(data: bytes | bytearray) -> int:
    """Compute Bob Jenkins' hash of 1 byte or more, the checksum of HDF5's metadata."""
    mask = 0xFFFFFFFF

    def turn(x: int, k: int) -> int:
        return (x << k | x >> (32 - k)) & mask

    a = b = c = (0xDEADBEEF + len(data)) & mask
    words = [int.from_bytes(data[k:k + 4], "little") for k in range(0, len(data), 4)]
    words += [0] * (-len(words) % 3)
    for k in range(0, len(words), 3):
        a, b, c = (a + words[k]) & mask, (b + words[k + 1]) & mask, (c + words[k + 2]) & mask
        if k + 3 < len(words):
            a = (a - c & mask) ^ turn(c, 4); c = c + b & mask
            b = (b - a & mask) ^ turn(a, 6); a = a + c & mask
            c = (c - b & mask) ^ turn(b, 8); b = b + a & mask
            a = (a - c & mask) ^ turn(c, 16); c = c + b & mask
            b = (b - a & mask) ^ turn(a, 19); a = a + c & mask
            c = (c - b & mask) ^ turn(b, 4); b = b + a & mask
    for x, k in (("c", 14), ("a", 11), ("b", 25), ("c", 16), ("a", 4), ("b", 14), ("c", 24)):
        if x == "c":
            c = (c ^ b) - turn(b, k) & mask
        elif x == "a":
            a = (a ^ c) - turn(c, k) & mask
        else:
            b = (b ^ a) - turn(a, k) & mask
    return c


def import_h5py() -> Any:
    """Import h5py. Raises BackendError: it is missing or cannot be loaded."""
    try:
        import h5py
    except ModuleNotFoundError as error:
        raise BackendError("result files need h5py: pip install h5py") from error
    except ImportError as error:
        raise BackendError(f"result files need h5py, which is installed and cannot be loaded ({error}); close other programs if "
                           "memory is short, else install it anew: pip install --force-reinstall h5py") from error
    return h5py
