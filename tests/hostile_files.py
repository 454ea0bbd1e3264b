"""Ways to make a result file hostile; each changes a sound file in place. The message that refuses it follows."""
from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np


def replace(file: Any, name: str, **created: Any) -> None:
    """Another dataset under a name."""
    del file[name]
    file.create_dataset(name, **created)


def link(file: Any, name: str, target: Any) -> None:
    del file[name]
    file[name] = target


def head(file: Any, **changes: Any) -> None:
    """Other values in the header; names that do not exist are added."""
    raw = json.loads(file["header"][...].tobytes())
    replace(file, "header", data=np.frombuffer(json.dumps({**raw, **changes}).encode(), np.uint8))


def text(file: Any, name: str, value: bytes) -> None:
    replace(file, name, data=np.frombuffer(value, np.uint8))


def virtual(file: Any) -> None:
    layout = h5py.VirtualLayout(shape=(11,), dtype="f8")
    layout[:] = h5py.VirtualSource("elsewhere.h5", "x", shape=(11,))
    del file["rows/total"]
    file.create_virtual_dataset("rows/total", layout)


def many_names(file: Any) -> None:
    """One dataset under hundreds of names: each read would be a copy."""
    raw = json.loads(file["header"][...].tobytes())
    file["x"] = np.zeros((11, 300))
    for k in range(500):
        file[f"rows/x{k}"] = file["x"]
        raw["series"][f"x{k}"] = [300]
    head(file, series=raw["series"])


def shifted(file: Any) -> None:
    """One number changed by its last bit."""
    x = file["rows/total"][3]
    file["rows/total"][3] = np.nextafter(x, np.inf)


HUGE = 10**13
HOSTILE: dict[str, tuple[Callable[[Any], None], str]] = {
    "link to another file": (lambda f: link(f, "rows/total", h5py.ExternalLink("/dev/zero", "/x")), "is a link to another place"),
    "group that is a link": (lambda f: link(f, "rows", h5py.ExternalLink("other.h5", "/rows")), "'rows/t' is a link"),
    "link inside the file": (lambda f: link(f, "rows/total", h5py.SoftLink("/rows/t")), "'rows/total' is a link to another "
                                                                                        "place"),
    "link to nothing": (lambda f: link(f, "rows/total", h5py.SoftLink("/nothing")), "'rows/total' is a link to another place"),
    "data of other files": (lambda f: replace(f, "rows/total", shape=(11,), dtype="f8", external=[("/etc/hostname", 0, 88)]),
                            "has filters or refers to other files"),
    "virtual data": (virtual, "has filters or refers to other files"),
    "compressed data": (lambda f: replace(f, "rows/total", data=np.zeros(11), chunks=(11,), compression="gzip"), "has filters"),
    "texts for numbers": (lambda f: replace(f, "rows/total", data=["a"] * 11, dtype=h5py.string_dtype()),
                          "'rows/total' is object"),
    "references": (lambda f: replace(f, "rows/total", shape=(11,), dtype=h5py.ref_dtype), "'rows/total' is object"),
    "opaque bytes": (lambda f: replace(f, "rows/total", data=np.zeros(11, "V8")), r"'rows/total' is \|V8"),
    "records": (lambda f: replace(f, "rows/total", data=np.zeros(11, [("x", "f8")])), "'rows/total' is .*expected float64"),
    "short floats": (lambda f: replace(f, "rows/total", data=np.zeros(11, "f4")), "'rows/total' is float32"),
    "other shape": (lambda f: replace(f, "rows/total", data=np.zeros((11, 3))), r"'rows/total' is float64 \(11, 3\)"),
    "scalar": (lambda f: replace(f, "rows/total", data=1.0), r"'rows/total' is float64 \(\)"),
    "group for a dataset": (lambda f: (f.__delitem__("rows/total"), f.create_group("rows/total")), "'rows/total' is not a "
                                                                                                   "dataset"),
    "dataset for a group": (lambda f: replace(f, "rows", data=np.zeros(11)), "lacks rows/t"),
    "huge dataset": (lambda f: replace(f, "header", shape=(HUGE,), dtype="u1", chunks=(4096,)), "'header' claims more data than"),
    "huge rows": (lambda f: (f["committed"].write_direct(np.array([1, -2])), f["blocks"].resize(1, axis=0),
                             f["blocks"].__setitem__(0, [HUGE, 0, 0, 0, 0]), f["rows/t"].resize(HUGE, axis=0)),
                  "'rows/t' claims more data than the file holds"),
    "huge chunks": (lambda f: replace(f, "rows/total", shape=(11,), maxshape=(None,), dtype="f8", chunks=(2**28,)),
                    "claims more data than the file holds"),
    "huge count of blocks": (lambda f: (f["blocks"].resize(HUGE, axis=0),
                                        f["committed"].write_direct(np.array([HUGE, -HUGE - 1]))),
                             "'blocks' claims more data than the file holds"),
    "one dataset under many names": (many_names, "claims more data than the file holds"),
    "negative count": (lambda f: f["committed"].write_direct(np.array([-1, 0])), "number of its blocks is missing"),
    "lone count": (lambda f: f["committed"].write_direct(np.array([2**60, 5])), "number of its blocks is missing"),
    "blocks forgotten": (lambda f: f["committed"].write_direct(np.array([0, -1])), "at the start and at the end differ"),
    "counts that shrink": (lambda f: f["blocks"].__setitem__(0, [-5, 0, 0, 0, 0]), "the counts of its blocks are not valid"),
    "one bit of a number": (shifted, r"the checksum of block \d of \d is wrong \(rows 0 to 11\)"),
    "other step in the header": (lambda f: head(f, model_text="another"), "the checksum of block 0"),
    "header that is no JSON": (lambda f: text(f, "header", b"{"), "damaged .JSONDecodeError"),
    "header of nested lists": (lambda f: text(f, "header", b"[" * 200000), "damaged .(RecursionError|JSONDecodeError)"),
    "header that is a list": (lambda f: text(f, "header", b"[]"), "damaged .TypeError"),
    "pickled header": (lambda f: text(f, "header", b"\x80\x04cos\nsystem\n(S'false'\ntR."), "damaged .UnicodeDecodeError"),
    "negative nodes": (lambda f: head(f, n_nodes=-1), "header: -1 is not a size"),
    "huge nodes": (lambda f: head(f, n_nodes=10**30), "header: 10+ is not a size"),
    "nodes that are a text": (lambda f: head(f, n_nodes="8"), "header: '8' is not a size"),
    "series of many axes": (lambda f: head(f, series={"total": [1] * 40}), "shape of total: 40 axes"),
    "series that is huge and empty": (lambda f: head(f, series={"gap": [0, 2**39, 2**39]}), "damaged .ValueError"),
    "facts that are a list": (lambda f: head(f, info=[]), "info is a list"),
    "newer format": (lambda f: f.attrs.__setitem__("version", 3), "format version 3, this fastbeam reads 1 to 2"),
    "version that is an array": (lambda f: f.attrs.__setitem__("version", np.ones(5)), "format version 0"),
    "format that is a number": (lambda f: f.attrs.__setitem__("format", 5), "not a fastbeam result .attribute 'format' is .*5"),
}


def make_hostile(source: Path, target: Path, name: str) -> str:
    """A hostile copy of a sound file; the message that should refuse it."""
    change, message = HOSTILE[name]
    target.write_bytes(source.read_bytes())
    with h5py.File(target, "r+") as file:
        change(file)
    return message
