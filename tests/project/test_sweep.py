"""Sweeps: the same table whatever runs it, failures kept, files that go on where they stopped."""
from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from small_scenes import SECTION, straight

import fastbeam as fb

SOURCE = Path(__file__).resolve().parents[2] / "src"
RATES = {"rate": [0.5, 1.0, 1.5], "mass": [0.4, 0.5]}
RUN = {"t_end": 0.1, "step": 0.02, "every": 1}


def bead(rate: float, mass: float) -> fb.Scene:
    """A mass slides on a beam that flies; beyond 1.4 m/s there is none."""
    if rate > 1.4:
        raise RuntimeError("too fast")
    rail, ring = straight("rail", (0, 0, 0), (3, 0, 0)), fb.PointMass("ring", mass=mass)
    return fb.Scene(rail, ring, fb.Slider("run", ring, rail, at=1.0, rate=rate), fb.RigidMotion(spin=(0, 0.5, 1.0)), name="bead")


def end(result: fb.Result) -> dict[str, Any]:
    return {"s": result.slider("run")["s"][-1], "path": result.slider("run")["s"], "method": result.info["method"]}


def numbers(a: float, b: float = 2.0) -> dict[str, Any]:
    if a == 3:
        raise ZeroDivisionError("three\nis not allowed")
    return {"product": a * b, "list": np.arange(int(a))}


def slow(a: int) -> int:
    time.sleep(0.2)
    return a * a


def same(one: fb.Sweep, other: fb.Sweep) -> bool:
    """Whether two tables are the same to the last bit."""
    return (repr(one.rows) == repr(other.rows) and len(one.arrays) == len(other.arrays)
            and all(a.keys() == b.keys() and all(np.array_equal(a[x], b[x], equal_nan=True) for x in a)
                    for a, b in zip(one.arrays, other.arrays)))


def test_a_sweep_is_the_runs_one_by_one() -> None:
    table = fb.sweep(bead, RATES, run=RUN, measure=end, workers=1)
    assert [(row["rate"], row["mass"]) for row in table] == [(r, m) for r in RATES["rate"] for m in RATES["mass"]]
    for row, arrays in zip(table.rows[:4], table.arrays):
        alone = fb.simulate(fb.compile_scene(bead(row["rate"], row["mass"])), progress=False, **RUN).slider("run")["s"]
        assert row["s"] == alone[-1] and row["error"] is None
        np.testing.assert_array_equal(arrays["path"], alone)
    assert [row["run"] for row in table.failures] == [4, 5] and table[4]["error"] == "RuntimeError: too fast"
    assert 'raise RuntimeError("too fast")' in table.tracebacks[5] and table.missing == []


@pytest.mark.parametrize("workers", [2, 3])
def test_tables_are_the_same_for_any_number_of_processes(workers: int) -> None:
    one = fb.sweep(bead, RATES, run=RUN, workers=1)
    assert one[0]["drift_total"] < 1e-12 and one[0]["steps"] == 5 and one.arrays[0]["series_total"].shape == (6,)
    assert same(one, fb.sweep(bead, RATES, run=RUN, workers=workers))


@pytest.mark.parametrize("executor", [lambda: ThreadPoolExecutor(2), lambda: ProcessPoolExecutor(2)])
def test_any_executor_will_do(executor: Callable[[], Executor]) -> None:
    with executor() as pool:
        assert same(fb.sweep(bead, RATES, run=RUN, workers=1), fb.sweep(bead, RATES, run=RUN, executor=pool))


class Backwards(Executor):
    """Runs what it is handed at once, and the last one first where it can."""

    def submit(self, function: Any, /, *args: Any, **more: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(function(*args, **more))
        return future


def test_rows_stand_in_the_order_of_cases() -> None:
    cases = [{"a": a} for a in range(40)]
    table = fb.sweep(numbers, cases, executor=Backwards())
    assert [row["a"] for row in table] == list(range(40)) and table[7]["product"] == 14.0
    assert same(table, fb.sweep(numbers, cases, workers=2))


@pytest.mark.skipif(sys.platform != "linux", reason="forks")
def test_functions_without_a_name_go_to_forks() -> None:
    factor = 3
    assert [row["value"] for row in fb.sweep(lambda a: factor * a, {"a": [1, 2, 3]}, workers=2)] == [3, 6, 9]


def test_what_cannot_stand_in_a_table_is_a_failure() -> None:
    table = fb.sweep(lambda a: [object(), {"a": 1}, {"x": 1j}, {"error": 1}, None, "text"][a], {"a": range(6)}, workers=1)
    assert [row["error"] is None for row in table] == [False, False, False, False, True, True]
    assert "mapping of names to numbers" in table[0]["error"] and "has the name of another column" in table[1]["error"]
    row, = fb.sweep(bead, [{"rate": 1.0, "mass": 1.0}], workers=1)
    assert row["error"].startswith("SceneError: build returned a scene, but no run arguments were given; add run=")


@pytest.mark.parametrize(("cases", "said"), [
    (5, "must be a list of mappings"), ([1], "case 0 must map names"), ({"a": 3}, r"cases\['a'\] must be a list of values"),
    ({"a": "text"}, "must be a list of values"), ([{1: 2}], "case 0 must map"),
    ({"a": range(2000), "b": range(2000)}, "at most 1000000")])
def test_cases_that_are_none_are_refused(cases: Any, said: str) -> None:
    with pytest.raises(fb.SceneError, match=said):
        fb.sweep(numbers, cases)


# --- files ------------------------------------------------------------------------------------------------------------------
def test_files_hold_the_table(tmp_path: Path) -> None:
    table = fb.sweep(numbers, {"a": [1, 2, 3, 4], "b": [0.1, float("nan")]}, workers=1, file=tmp_path / "s.h5")
    again = fb.load_sweep(tmp_path / "s.h5")
    assert same(table, again) and again.tracebacks == table.tracebacks and len(again.failures) == 2
    assert again.arrays[6]["list"].tolist() == [0, 1, 2, 3]


def test_what_is_missing_is_run_and_nothing_else(tmp_path: Path) -> None:
    calls: list[float] = []

    def counted(a: float, b: float = 2.0) -> dict[str, Any]:
        calls.append(a)
        return numbers(a, b)

    go = partial(fb.sweep, counted, workers=1, file=tmp_path / "s.h5")
    go([{"a": 1}, {"a": 3}, {"a": 2}])
    calls.clear()
    # two more, in another order, one of them twice
    table = go([{"a": 2}, {"a": 5}, {"a": 1}, {"a": 3}, {"a": 1}])
    assert calls == [5, 1] and [row["a"] for row in table] == [2, 5, 1, 3, 1] and table.missing == []
    assert table[3]["error"] == "ZeroDivisionError: three is not allowed"
    calls.clear()
    assert same(go([{"a": 2}, {"a": 5}, {"a": 1}, {"a": 3}, {"a": 1}], retry=True), table) and calls == [3]
    go([{"a": 2}], overwrite=True)
    assert calls == [3, 2]


def test_files_of_something_else_are_not_touched(tmp_path: Path) -> None:
    path = tmp_path / "s.h5"
    fb.sweep(numbers, {"a": [1]}, workers=1, file=path)
    with pytest.raises(fb.ResultFileError, match="another build .*numbers instead of .*slow"):
        fb.sweep(slow, {"a": [1]}, workers=1, file=path)
    with pytest.raises(fb.ResultFileError, match="another run"):
        fb.sweep(numbers, {"a": [1]}, run={"t_end": 1.0}, workers=1, file=path)
    with pytest.raises(fb.SceneError, match="case 0 contains something that a file cannot store"):
        fb.sweep(numbers, [{"a": SECTION}], workers=1, file=path)
    (tmp_path / "text").write_text("no sweep")
    with pytest.raises(fb.ResultFileError, match="not an HDF5 file"):
        fb.sweep(numbers, {"a": [1]}, workers=1, file=tmp_path / "text")
    with pytest.raises(fb.ResultFileError, match="load_result reads results"):
        fb.Result(t=[0.0]).save(tmp_path / "r.h5")
        fb.load_sweep(tmp_path / "r.h5")
    assert len(fb.load_sweep(path)) == 1


@pytest.mark.parametrize(("name", "change"), [("committed", [1, 1, 1, 1, -4]), ("committed", [2**60, 0, 0, 0, -2**60]),
                                              ("numbers", 7.0)])
def test_damaged_files_are_refused(name: str, change: Any, tmp_path: Path) -> None:
    fb.sweep(numbers, {"a": [1, 2]}, workers=1, file=tmp_path / "s.h5")
    with h5py.File(tmp_path / "s.h5", "r+") as file:
        file[name][...] = change
    with pytest.raises(fb.ResultFileError, match="damaged"):
        fb.load_sweep(tmp_path / "s.h5")


KILLED = """
import sys, time
sys.path[:0] = {path!r}
import fastbeam as fb
from test_sweep import slow
fb.sweep(slow, {{"a": range(30)}}, workers={workers}, file=sys.argv[1], progress=False)
"""


def alive(group: int) -> bool:
    """Whether a group has processes."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize("workers", [1, 2])
def test_a_sweep_that_was_killed_goes_on(workers: int, tmp_path: Path) -> None:
    program = KILLED.format(path=[str(SOURCE), str(Path(__file__).parent), str(Path(__file__).parents[1])], workers=workers)
    process = subprocess.Popen([sys.executable, "-c", program, str(tmp_path / "s.h5")], start_new_session=True)
    try:
        found, give_up = 0, time.monotonic() + 60.0
        while found < 2 and time.monotonic() < give_up:
            time.sleep(0.1)
            if (tmp_path / "s.h5").exists():
                # beside the writer
                found = len(fb.load_sweep(tmp_path / "s.h5"))
        with pytest.raises(fb.ResultFileError, match="another sweep writes to it"):
            fb.sweep(slow, {"a": range(30)}, workers=1, file=tmp_path / "s.h5", overwrite=True)
        # its workers are told by nobody
        process.kill()
        process.wait()
        gone, give_up = False, time.monotonic() + 10.0
        while not gone and time.monotonic() < give_up:
            time.sleep(0.1)
            gone = not alive(process.pid)
        assert gone
    finally:
        if alive(process.pid):
            os.killpg(process.pid, signal.SIGKILL)
    before = fb.load_sweep(tmp_path / "s.h5")
    assert 2 <= len(before) < 30 and len(before.missing) == 30 - len(before)
    table = fb.sweep(slow, {"a": range(30)}, workers=2, file=tmp_path / "s.h5", progress=False)
    assert [row["value"] for row in table] == [a * a for a in range(30)] and same(table, fb.load_sweep(tmp_path / "s.h5"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["s.h5"]


def die(a: int) -> int:
    if a == 3:
        os._exit(7)
    return a


def test_a_worker_that_dies_is_said_and_rows_are_kept(tmp_path: Path) -> None:
    with pytest.raises(fb.BackendError, match="a worker process died"):
        fb.sweep(die, {"a": range(6)}, workers=2, file=tmp_path / "s.h5")
    assert all(row["value"] == row["a"] for row in fb.load_sweep(tmp_path / "s.h5"))


INTERRUPTED = """
import os, signal, sys, threading, time
sys.path[:0] = {path!r}
import fastbeam as fb
from test_sweep import slow
fb.sweep
# a shell in the background starts programs that ignore it
signal.signal(signal.SIGINT, signal.default_int_handler)
threading.Timer(1.5, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
begin = time.monotonic()
try:
    fb.sweep(slow, {{"a": range(100)}}, workers=2, file=sys.argv[1], progress=False)
except KeyboardInterrupt:
    print("stopped", time.monotonic() - begin < 5.0)
"""


def test_ctrl_c_ends_a_sweep_and_closes_its_file(tmp_path: Path) -> None:
    program = INTERRUPTED.format(path=[str(SOURCE), str(Path(__file__).parent), str(Path(__file__).parents[1])])
    done = subprocess.run([sys.executable, "-c", program, str(tmp_path / "s.h5")], capture_output=True, text=True, timeout=60,
                          check=False)
    assert done.stdout == "stopped True\n", done.stderr
    assert 0 < len(fb.load_sweep(tmp_path / "s.h5")) < 100


def test_tables_go_to_pandas() -> None:
    pytest.importorskip("pandas")
    frame = fb.sweep(numbers, {"a": [1, 3]}, workers=1).to_dataframe()
    assert list(frame.columns) == ["run", "a", "product", "error"] and frame["product"][0] == 2.0


def test_columns_of_a_table_are_arrays_of_numbers() -> None:
    table = fb.sweep(lambda a: {"root": a**0.5, "word": "x"} if a >= 0 else {"root": 1 / 0}, {"a": [4, -1, 9]}, workers=1)
    assert np.array_equal(table.column("root"), [2.0, np.nan, 3.0], equal_nan=True)
    assert table.column("a").tolist() == [4.0, -1.0, 9.0] and [row["run"] for row in table[1:]] == [1, 2]
    with pytest.raises(fb.SceneError, match="no case has a result 'word'; there are 'run', 'a', 'root'"):
        table.column("word")


def test_a_file_is_read_again_while_its_writer_is_at_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from fastbeam.results import sweep_file
    wanted = fb.sweep(slow, {"a": [1, 2]}, workers=1, file=tmp_path / "s.h5", progress=False)
    tried = []

    def half_written(path: Path) -> bool:
        tried.append(path)
        return True

    read = sweep_file._row

    def row(raw: object, numbers: np.ndarray) -> object:
        if len(tried) < 3:
            raise OSError("addr overflow")
        return read(raw, numbers)

    monkeypatch.setattr("fastbeam.results.hdf5_reader.check_file", half_written)
    monkeypatch.setattr(sweep_file, "_row", row)
    assert same(wanted, fb.load_sweep(tmp_path / "s.h5")) and len(tried) == 3
    monkeypatch.setattr("fastbeam.results.hdf5_reader.check_file", lambda path: bool(tried.append(path)))
    tried.clear()
    with pytest.raises(fb.ResultFileError, match="damaged .* addr overflow"):
        fb.load_sweep(tmp_path / "s.h5")
    assert len(tried) == 1
