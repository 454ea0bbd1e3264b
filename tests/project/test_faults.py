"""Faults: hostile and damaged result files, full disks, killed runs, unusable kernel caches."""
from __future__ import annotations

import builtins
import errno
import json
import os
import signal
import subprocess
import sys
import time
import tracemalloc
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_scenes import bead

import fastbeam as fb
from fastbeam.kernels.jit import cache as _folder
from fastbeam.kernels.jit import decorators as _jit
from fastbeam.kernels.jit import sealed as _sealed
from fastbeam.results import hdf5_reader as reading
from fastbeam.results import hdf5_writer as store

pytest.importorskip("h5py")
from counted import peak_bytes  # noqa: E402
from hostile_files import HOSTILE, make_hostile  # noqa: E402

from perf.stress.victims import long_rail  # noqa: E402

H = 0.01
VICTIMS = Path(__file__).parents[2] / "perf" / "stress" / "victims.py"


def victim(*arguments: Any, **environment: str) -> subprocess.Popen[str]:
    """One of the processes that may end badly."""
    return subprocess.Popen([sys.executable, str(VICTIMS), *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                            text=True, env={**os.environ, "FASTBEAM_PROGRESS": "0", **environment})


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sound") / "run.h5"
    # a pause for compilation would make two blocks of one
    fb.simulate(fb.compile_scene(bead()), t_end=0.1, step=H)
    fb.simulate(fb.compile_scene(bead()), t_end=0.1, step=H, output=path)
    assert len(fb.load_result(path).t) == 11
    return path


# -------------------------------------------------------------------------------------------------------------------- files
@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_result_files_are_refused(name: str, sound: Path, tmp_path: Path) -> None:
    message = make_hostile(sound, tmp_path / "run.h5", name)

    def load() -> None:
        with pytest.raises(fb.ResultFileError, match=rf"result file '.*run.h5': .*{message}"):
            fb.load_result(tmp_path / "run.h5")

    assert peak_bytes(load) < 10**8  # no size in a file is believed


@pytest.fixture(scope="module")
def left_open(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a killed writer leaves behind."""
    place = tmp_path_factory.mktemp("left_open")
    result = fb.simulate(fb.compile_scene(bead()), t_end=0.3, step=H)
    with store.ResultWriter(place / "run.h5", result.header()) as writer:
        writer.append(result.series, result.t)
        writer.flush()
        (place / "copy.h5").write_bytes((place / "run.h5").read_bytes())
    np.testing.assert_array_equal(fb.load_result(place / "copy.h5").t, result.t)
    return place / "copy.h5"


@pytest.mark.parametrize("kind", ["bit", "bytes", "cut", "killed"])
def test_damaged_result_files_are_refused_or_harmless(kind: str, sound: Path, left_open: Path, tmp_path: Path) -> None:
    # in a process of its own: HDF5 itself might crash, or wait for a writer that is no more
    sound, kind = (left_open, "bit") if kind == "killed" else (sound, kind)
    out, err = victim("read", tmp_path / "run.h5", sound, kind, 0, 60).communicate(timeout=200)
    last = json.loads(out.splitlines()[-1])
    assert last[0] == "counts", (last, err[-2000:])
    assert last[1]["WRONG"] == last[1]["other error"] == 0, out
    assert last[1]["refused"] > 0 and sum(last[1].values()) == 60


def test_result_of_a_killed_run_holds_its_rows_until_shortly_before(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    child = victim("run", path, 2)
    assert child.stdout is not None
    told = [json.loads(child.stdout.readline()) for _ in range(20)]
    time.sleep(1.3)
    child.send_signal(signal.SIGKILL)
    told += [json.loads(line) for line in child.stdout.read().splitlines() if line.endswith("]")]
    assert child.wait() == -signal.SIGKILL
    result = fb.load_result(path)
    assert len(result.t) > 1 and len(result.t_snap) > 0
    model = fb.compile_scene(long_rail())
    whole = fb.simulate(model, t_end=float(result.t[-1]) + 0.1, step=2e-3, every=5, output=fb.Output(snapshots=0))
    for name in result.series:
        np.testing.assert_array_equal(result.series[name], whole.series[name][:len(result.t)])
    kept = fb.load_checkpoint(f"{path}.checkpoint")
    assert kept.t >= told[-1][0] - 0.02  # at every row


@pytest.mark.skipif(sys.platform == "win32", reason="needs limits of the system")
@pytest.mark.parametrize("limit", [100_000, 700_000, 1_300_000])
def test_file_that_may_not_grow_ends_the_run_with_everything_computed(limit: int, tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    child = victim("fill", path, limit)
    out, err = child.communicate(timeout=200)
    assert child.returncode == 0, err[-2000:]
    how, message, n, has_state = json.loads(out.splitlines()[-1])
    assert how == "refused" and "File too large" in message
    if "cannot be created" in message:
        assert limit == 100_000 and not path.exists()
    else:
        result = fb.load_result(path)
        assert 0 < len(result.t) <= n and has_state
        assert path.stat().st_size <= limit


def test_error_of_hdf5_itself_ends_the_run_too(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    original, calls = store.ResultWriter._extend_rows, [0]

    def fail(self: Any, *arguments: Any) -> None:
        calls[0] += 1
        if calls[0] > 6:
            raise OSError(errno.ENOSPC, "No space left on device")
        original(self, *arguments)

    monkeypatch.setattr(store, "FLUSH_TIME", 0.0)
    monkeypatch.setattr(store.ResultWriter, "_extend_rows", fail)
    monkeypatch.setattr(store, "_LOST", [])
    model = fb.compile_scene(bead())
    with pytest.raises(fb.ResultFileError, match="run.h5': cannot be written .*No space left.*; it holds all rows written "
                                                 "before") as caught:
        fb.simulate(model, t_end=0.5, step=H, every=1, output=fb.Output(tmp_path / "run.h5", checkpoint=tmp_path / "kept"))
    result = caught.value.result
    assert 0 < len(result.t) < 40 and result.events[-1]["kind"] == "file"
    assert fb.load_checkpoint(tmp_path / "kept").t == result.t[-1]
    rest = fb.simulate(model, start=result.checkpoint, t_end=0.5, step=H)
    np.testing.assert_array_equal(rest.state.q, fb.simulate(model, t_end=0.5, step=H).state.q)
    (lost,) = store._LOST
    lost.close()


@pytest.mark.parametrize("place", ["_create", "_reserve", "_end"])
def test_failure_at_either_end_of_a_file_is_told_as_such(place: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def fail(*arguments: Any) -> None:
        raise OSError(errno.EIO, "Input/output error")

    model = fb.compile_scene(bead())
    if place == "_end":
        # closing cuts off the space that was claimed for nothing
        monkeypatch.setattr(store, "open", lambda *arguments, **options: Brittle(open(*arguments, **options)), raising=False)
    else:
        monkeypatch.setattr(store.ResultWriter, place, fail)
    with pytest.raises(fb.ResultFileError, match="run.h5': cannot be .*Input/output error") as caught:
        fb.simulate(model, t_end=0.1, step=H, output=tmp_path / "run.h5")
    if place == "_end":
        assert len(caught.value.result.t) == 11 and len(fb.load_result(tmp_path / "run.h5").t) == 11
    else:
        assert list(tmp_path.iterdir()) == []


def test_ctrl_c_while_a_file_is_created_leaves_no_half_of_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    create = store.ResultWriter._create

    def stop(self: store.ResultWriter, texts: bytes) -> None:
        create(self, texts)
        raise KeyboardInterrupt

    monkeypatch.setattr(store.ResultWriter, "_create", stop)
    with pytest.raises(KeyboardInterrupt):
        fb.simulate(fb.compile_scene(bead()), t_end=0.1, step=H, output=tmp_path / "run.h5")
    assert list(tmp_path.iterdir()) == []


class Brittle:
    """A file that cannot be cut twice."""

    def __init__(self, file: Any) -> None:
        self.file, self.cuts = file, 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self.file, name)

    def __enter__(self) -> Brittle:
        return self

    def __exit__(self, *exc: object) -> None:
        self.file.close()

    def truncate(self, size: int) -> None:
        self.cuts += 1
        if self.cuts > 1:
            raise OSError(errno.EIO, "Input/output error")
        self.file.truncate(size)


@pytest.mark.skipif(sys.platform == "win32", reason="open files cannot be removed there")
@pytest.mark.parametrize("replaced", [False, True])
def test_result_file_that_is_removed_ends_the_run_with_everything_computed(replaced: bool, monkeypatch: pytest.MonkeyPatch,
                                                                           tmp_path: Path) -> None:
    monkeypatch.setattr(store, "FLUSH_TIME", 0.0)
    path = tmp_path / "run.h5"

    def remove(t: float, state: Any) -> None:
        if t > 0.095 and path.exists():
            path.unlink()
            if replaced:
                path.write_text("precious")

    with pytest.raises(fb.ResultFileError, match="run.h5': cannot be written .*it was removed, moved or replaced") as caught:
        fb.simulate(fb.compile_scene(bead()), t_end=0.5, step=H, every=1, output=path, callback=remove)
    result = caught.value.result
    assert 11 <= len(result.t) <= 14 and result.checkpoint.t == result.t[-1] and result.events[-1]["kind"] == "file"
    assert path.exists() == replaced and (not replaced or path.read_text() == "precious")
    result.save(tmp_path / "kept.h5")
    np.testing.assert_array_equal(fb.load_result(tmp_path / "kept.h5").t, result.t)


def test_two_runs_do_not_share_a_file(tmp_path: Path) -> None:
    pytest.importorskip("fcntl")
    path, model = tmp_path / "run.h5", fb.compile_scene(bead())
    child = victim("run", path, 2)
    assert child.stdout is not None
    child.stdout.readline()
    time.sleep(1.2)
    (tmp_path / "link.h5").symlink_to(path)
    for name in ("run.h5", "link.h5"):
        with pytest.raises(fb.ResultFileError, match=f"{name}': another run is writing it, or another program has it open"):
            fb.simulate(model, t_end=0.1, step=H, output=fb.Output(tmp_path / name, overwrite=True))
    assert len(fb.load_result(path).t) > 0 and child.poll() is None
    child.send_signal(signal.SIGKILL)
    child.wait()
    assert len(fb.load_result(path).t) > 0  # nothing happened to it
    fb.simulate(model, t_end=0.1, step=H, output=fb.Output(path, overwrite=True))
    assert len(fb.load_result(path).t) == 11


def test_other_programs_read_a_file_that_is_being_written(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    result = fb.simulate(fb.compile_scene(bead()), t_end=0.1, step=H)
    with store.ResultWriter(tmp_path / "run.h5", result.header()) as writer:
        writer.append(result.series, result.t)
        writer.flush()
        with h5py.File(tmp_path / "run.h5", "r", swmr=True) as file:
            np.testing.assert_array_equal(file["rows/t"], result.t)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes")
def test_pipes_and_devices_are_no_result_files(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    model = fb.compile_scene(bead())
    for path in (tmp_path / "pipe", "/dev/null"):
        with pytest.raises(fb.ResultFileError, match="is a device, pipe or socket, not a file"):
            fb.simulate(model, t_end=0.1, step=H, output=fb.Output(path, overwrite=True))
        with pytest.raises(fb.ResultFileError, match="is a device, pipe or socket, not a file"):
            fb.load_result(path)
    for wrong in (5, b"run.h5", "a\0b"):
        with pytest.raises(fb.SceneError, match="must be the path of a file"):
            fb.simulate(model, t_end=0.1, step=H, output=wrong)
        with pytest.raises(fb.SceneError, match="must be the path of a file"):
            fb.load_result(wrong)


def test_current_folder_may_change_during_a_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(store, "FLUSH_TIME", 0.0)
    (tmp_path / "other").mkdir()
    monkeypatch.chdir(tmp_path)
    fb.simulate(fb.compile_scene(bead()), t_end=0.1, step=H, every=1, output="run.h5",
                callback=lambda t, state: os.chdir(tmp_path / "other"))
    assert len(fb.load_result(tmp_path / "run.h5").t) == 11


@pytest.mark.parametrize(("name", "text", "message"), [
    ("events", b"{}\n" * 200_000, "200000 events of 600000 bytes exceed the limit of 100000"),
    ("events", b'"' + b"x" * (1 << 25) + b'"\n', "1 events of 33554435 bytes"),
    ("events", b'{"x": [' + b"[]," * 1_000_000 + b"[]]}\n", "1000003 lists in 'events', more than 1000000"),
    ("final_info", b'{"x": [' + b"{}," * 1_000_000 + b"{}]}", "1000003 lists in 'final_info'"),
    ("header", b"[" + b"[]," * 1_000_000 + b"[]]", "1000002 lists in 'header'")])
def test_texts_that_would_fill_the_memory_are_refused(name: str, text: bytes, message: str, sound: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    path.write_bytes(sound.read_bytes())
    import h5py
    with h5py.File(path, "r+") as file:
        del file[name]
        file[name] = np.frombuffer(text, np.uint8)
        blocks = file["blocks"][...]
        if name != "header":
            blocks[-1, 2 + (name == "final_info")] = len(text)
        texts = {kind: file[kind][...].tobytes() for kind in ("header", "events", "final_info")}
        crc = zlib.crc32(texts["header"])
        for group in ("rows", "snapshots"):
            names = (["t", *json.loads(sound_header(sound))["series"]] if group == "rows" else ["t_snap", "phi", "directors"])
            for kind in names:
                crc = zlib.crc32(file[f"{group}/{kind}"][...], crc)
        blocks = blocks[-1:]
        blocks[0, 4] = zlib.crc32(texts["final_info"], zlib.crc32(texts["events"], crc))
        file["blocks"].resize(1, axis=0)
        file["blocks"][...] = blocks
        file["committed"][...] = [1, -2]
    tracemalloc.start()
    with pytest.raises(fb.ResultFileError, match=message):
        fb.load_result(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20e6 + 5 * len(text)


def sound_header(path: Path) -> bytes:
    import h5py
    with h5py.File(path, "r") as file:
        return file["header"][...].tobytes()


def test_writer_writes_no_more_events_than_can_be_read(tmp_path: Path) -> None:
    result = fb.simulate(fb.compile_scene(bead()), t_end=0.02, step=H)
    result.events = [{}] * 100_000
    result.save(tmp_path / "a.h5")
    assert len(fb.load_result(tmp_path / "a.h5").events) == 100_000
    result.events.append({})
    with pytest.raises(fb.ResultFileError, match="more than 100000 events, .* which is the limit of readers"):
        result.save(tmp_path / "b.h5")


def test_short_memory_is_not_taken_for_a_missing_library(monkeypatch: pytest.MonkeyPatch, sound: Path) -> None:
    for error, kind, message in ((ImportError("libhdf5.so: cannot allocate memory"), fb.BackendError,
                                  "h5py, which is installed and cannot be loaded .libhdf5.so: cannot allocate memory"),
                                 (ModuleNotFoundError("No module named 'h5py'"), fb.BackendError, "pip install h5py"),
                                 (MemoryError("short"), MemoryError, "short")):
        def fail(name: str, *arguments: Any, error: BaseException = error, **options: Any) -> Any:
            if name == "h5py":
                raise error
            return builtins_import(name, *arguments, **options)

        builtins_import = builtins.__import__
        with monkeypatch.context() as patch:
            patch.setattr(builtins, "__import__", fail)
            with pytest.raises(kind, match=message):
                fb.load_result(sound)

    def full(*arguments: Any) -> None:
        raise MemoryError

    monkeypatch.setattr(reading.Reader, "result", full)
    with pytest.raises(fb.ResultFileError, match="too large to be read with the memory that is left"):
        fb.load_result(sound)


# ------------------------------------------------------------------------------------------------------------------- caches
TINY = """
import json, sys, warnings
from pathlib import Path
import numpy as np
warnings.simplefilter("always")
from fastbeam.kernels.jit import decorators as _jit
sys.path.insert(0, sys.argv[1])
import tiny
out = [float(tiny.half(np.dtype(kind).type(3))) for kind in sys.argv[2:]]
print(json.dumps([out, *_jit.compile_counts(), _jit._FOLDER]))
"""


def tiny(folder: Path, *kinds: str, wait: bool = True, **environment: str) -> Any:
    """Run a kernel for numbers of these types in a fresh process."""
    source = folder / "source"
    source.mkdir(exist_ok=True)
    if not (source / "tiny.py").exists():
        (source / "tiny.py").write_text("from fastbeam.kernels.jit.decorators import kernel\n"
                                        "\n\n@kernel\ndef half(x):\n    return x / 2\n")
    child = subprocess.Popen([sys.executable, "-c", TINY, str(source), *kinds], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                             text=True, env={**os.environ, "FASTBEAM_CACHE_DIR": str(folder / "cache"), **environment})
    return answer(child) if wait else child


def answer(child: subprocess.Popen[str]) -> Any:
    out, err = child.communicate(timeout=200)
    assert child.returncode == 0, err
    return *json.loads(out.splitlines()[-1]), err


def test_processes_that_start_together_share_an_empty_cache(tmp_path: Path) -> None:
    kinds = ["float64", "float32", "int64", "int32"]
    children = [tiny(tmp_path, kind, wait=False) for kind in kinds]
    for child in children:
        assert answer(child)[0] == [1.5]
    values, loaded, compiled, _, _ = tiny(tmp_path, *kinds)
    assert (values, loaded, compiled) == ([1.5] * 4, 4, 0)  # nobody's kernel was lost or mistaken


def test_damaged_cache_is_compiled_again(tmp_path: Path) -> None:
    tiny(tmp_path, "float64")
    for pattern in ("*.nbc", "*.nbi"):
        (path,) = (tmp_path / "cache").rglob(pattern)
        path.write_bytes(path.read_bytes()[:40])
        values, loaded, compiled, _, err = tiny(tmp_path, "float64")
        assert (values, loaded, compiled) == ([1.5], 0, 1) and "compiled kernels in" in err and "are damaged" in err
        values, loaded, compiled, _, err = tiny(tmp_path, "float64")
        assert (values, loaded, compiled, err) == ([1.5], 1, 0, "")


@pytest.mark.parametrize("pattern", ["*.nbc", "*.nbi"])
def test_no_flipped_bit_in_a_kernel_is_run(pattern: str, tmp_path: Path) -> None:
    tiny(tmp_path, "float64")
    (path,) = (tmp_path / "cache").rglob(pattern)
    data = path.read_bytes()
    cache = fresh_cache(tmp_path)
    generator = np.random.default_rng(3)
    for bit in [0, 8 * len(data) - 1, *generator.integers(0, 8 * len(data), 60).tolist()]:
        broken = bytearray(data)
        broken[bit // 8] ^= 1 << bit % 8
        path.write_bytes(broken)
        with pytest.raises(ValueError, match="the checksum of .* is wrong"):
            cache._load_index() if pattern == "*.nbi" else cache._load_data(path.name)
    path.write_bytes(broken)
    values, loaded, compiled, _, err = tiny(tmp_path, "float64")
    assert (values, loaded, compiled) == ([1.5], 0, 1) and "the checksum of" in err and "compiling them again" in err
    assert path.read_bytes() != broken


def fresh_cache(folder: Path) -> _sealed.SealedFile:
    (index,) = (folder / "cache").rglob("*.nbi")
    return _sealed.SealedFile(str(index.parent), index.stem, None)


def test_kernels_that_changed_places_are_not_run(tmp_path: Path) -> None:
    tiny(tmp_path, "float64", "int32")
    one, other = sorted((tmp_path / "cache").rglob("*.nbc"))
    data = one.read_bytes()
    one.write_bytes(other.read_bytes())
    other.write_bytes(data)
    values, loaded, _, _, err = tiny(tmp_path, "float64", "int32")
    assert (values, loaded) == ([1.5, 1.5], 0) and "the checksum of" in err


needs_owners = pytest.mark.skipif(not hasattr(os, "getuid"), reason="needs owners of files")


@needs_owners
@pytest.mark.parametrize("what", ["cache", "cache/*", "cache/*/*/"])
def test_folder_of_kernels_that_others_can_write_to_is_not_used(what: str, tmp_path: Path) -> None:
    tiny(tmp_path, "float64")
    (tmp_path / "spare").mkdir()
    (place,) = [x for x in tmp_path.glob(what) if x.is_dir()]
    place.chmod(0o775)
    for expected in ((0, 1), (1, 0)):
        values, *counts, folder, err = tiny(tmp_path, "float64", TMPDIR=str(tmp_path / "spare"))
        assert (values, tuple(counts)) == ([1.5], expected) and "others can write to" in err and "chmod -R go-w" in err
        assert folder.startswith(str(tmp_path / "spare" / "fastbeam-"))
    place.chmod(0o755)
    values, loaded, compiled, folder, err = tiny(tmp_path, "float64")
    assert (values, loaded, compiled, err) == ([1.5], 1, 0, "") and folder.startswith(str(tmp_path / "cache"))


@needs_owners
def test_kernel_that_others_can_write_to_is_not_run(tmp_path: Path) -> None:
    tiny(tmp_path, "float64")
    (path,) = (tmp_path / "cache").rglob("*.nbc")
    path.chmod(0o666)
    values, loaded, compiled, _, err = tiny(tmp_path, "float64")
    assert (values, loaded, compiled) == ([1.5], 0, 1) and "others can write to" in err
    assert path.stat().st_mode & 0o022 == 0


@needs_owners
def test_rights_of_the_cache_do_not_depend_on_those_of_new_files(tmp_path: Path) -> None:
    (tmp_path / "source").mkdir()
    before = os.umask(0o002)
    try:
        for expected in ((0, 1), (1, 0)):
            values, *counts, _, err = tiny(tmp_path, "float64")
            assert (values, tuple(counts), err) == ([1.5], expected, "")
    finally:
        os.umask(before)
    places = [tmp_path / "cache", *(x for x in (tmp_path / "cache").rglob("*") if x.name != "lock")]
    assert len(places) >= 5 and all(place.stat().st_mode & 0o022 == 0 for place in places)


@needs_owners
def test_kernels_of_somebody_else_are_not_trusted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    folder = tmp_path / "cache" / "kernels"
    folder.mkdir(parents=True)
    assert _folder._is_safe(folder)
    found = os.stat(folder)
    monkeypatch.setattr(_folder.os, "getuid", lambda: found.st_uid + 1)
    assert _folder._is_safe(folder) == (found.st_uid == 0)
    assert not _folder.is_private(os.stat_result((0o755, 0, 0, 1, found.st_uid + 7, 0, 0, 0, 0, 0)))


def test_cache_that_cannot_be_written_costs_only_time(tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("a file where the folder should be")
    (tmp_path / "spare").mkdir()
    for expected in ((0, 1), (1, 0)):
        values, loaded, compiled, folder, _ = tiny(tmp_path, "float64", TMPDIR=str(tmp_path / "spare"))
        assert (values, (loaded, compiled)) == ([1.5], expected)
        assert folder.startswith(str(tmp_path / "spare" / "fastbeam-"))


def test_spare_folder_that_others_could_write_to_is_not_used(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    # cached machine code is run: a folder prepared by somebody else must not be trusted
    monkeypatch.setattr(_folder.tempfile, "tempdir", str(tmp_path))
    root = _folder._fallback_root()
    assert root.stat().st_mode & 0o777 == 0o700 and root == _folder._fallback_root()
    root.chmod(0o777)
    fresh = _folder._fallback_root()
    assert fresh != root and fresh.parent == tmp_path and fresh.stat().st_mode & 0o777 == 0o700
    root.rmdir()
    (tmp_path / "elsewhere").mkdir()
    root.symlink_to(tmp_path / "elsewhere")
    assert _folder._fallback_root() not in (root, tmp_path / "elsewhere")


def test_kernels_that_can_only_be_read_are_copied(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    shared = tmp_path / "shared" / _folder._source_hash("")
    (shared / "kernels").mkdir(parents=True)
    (shared / "kernels" / "run.nbi").write_bytes(b"index")
    monkeypatch.setenv("FASTBEAM_CACHE_DIR", str(tmp_path / "shared"))
    monkeypatch.setattr(_folder.tempfile, "tempdir", str(tmp_path))
    usable = _folder._usable
    monkeypatch.setattr(_folder, "_usable", lambda folder: folder != shared and usable(folder))
    for _ in range(2):
        folder = Path(_folder.cache_folder())
        assert folder != shared and (folder / "kernels" / "run.nbi").read_bytes() == b"index"
        assert sorted(x.name for x in folder.parent.iterdir()) == [folder.name]


def test_cache_that_fills_the_disk_is_only_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    @_jit.kernel
    def double(x: float) -> float:
        return 2.0 * x

    def full(*arguments: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(_sealed.SealedFile, "_save_index", full)
    with pytest.warns(RuntimeWarning, match="compiled kernels cannot be kept in .*No space left on device"):
        assert double(1.5) == 3.0
    _jit.KERNELS.remove(double)
