"""Result, its buffers, and result files."""
from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from fastbeam.interface.errors import BackendError, ResultFileError, SceneError
from fastbeam.results.hdf5_writer import ResultWriter, load_result
from fastbeam.results.result import Result, ResultBuffer, ResultHeader
from fastbeam.results.rows import RowBuffer

h5py = pytest.importorskip("h5py")
SOURCE = Path(__file__).resolve().parents[2] / "src"


def header(n_sliders: int = 1, n_nodes: int = 4) -> ResultHeader:
    return ResultHeader("40 elements", {"scene": "test", "step": 0.1}, {"sliders": ["cart"], "points": ["tip", "mid"]}, n_nodes,
                        {"total": (), "lin_mom": (3,), "gap": (n_sliders,), "s_slide": (n_sliders,),
                         "contact_force": (n_sliders, 3), "points": (2, 3), "iterations": ()})


def row(k: int, n_sliders: int = 1) -> dict[str, object]:
    return {"total": 2.0 + 1e-14 * k, "lin_mom": np.full(3, float(k)), "gap": np.full(n_sliders, 1e-15 * k),
            "s_slide": np.full(n_sliders, 0.1 * k), "contact_force": np.full((n_sliders, 3), 0.5 * k),
            "points": np.arange(6.0).reshape(2, 3) + k, "iterations": k}


def fill(sink: ResultBuffer | ResultWriter, n: int, n_sliders: int = 1, n_nodes: int = 4) -> None:
    for k in range(n):
        sink.append(row(k, n_sliders), 0.1 * k)
        if k % 3 == 0:
            sink.snapshot(0.1 * k, np.full((n_nodes, 3), float(k)), np.tile(np.eye(3) * k, (n_nodes, 1, 1)))
    sink.event({"kind": "end stop", "time": 0.3, "text": "slider 'cart' reached s = 1 m"})


def assert_same(a: Result, b: Result) -> None:
    assert a.model_text == b.model_text and a.info == b.info and a.names == b.names and a.events == b.events
    assert a.series.keys() == b.series.keys()
    for name in a.series:
        assert a.series[name].dtype == b.series[name].dtype
        np.testing.assert_array_equal(a.series[name], b.series[name])
    for x, y in ((a.t, b.t), (a.t_snap, b.t_snap), (a.phi, b.phi), (a.directors, b.directors)):
        np.testing.assert_array_equal(x, y)


def test_row_buffer_keeps_rows_through_growth_and_blocks() -> None:
    buffer = RowBuffer({"x": (), "v": (2,)}, capacity=1)
    buffer.append({"x": 1.0, "v": [2.0, 3.0]})
    buffer.append({"x": np.arange(5.0), "v": np.ones((5, 2))}, 5)
    views = buffer.views()
    buffer.append({"x": 9.0, "v": [9.0, 9.0]})
    np.testing.assert_array_equal(views["x"], [1, 0, 1, 2, 3, 4])
    assert len(buffer) == 7 and buffer.views()["v"].shape == (7, 2)


@pytest.mark.parametrize(("bad", "text"), [
    ({"x": 1.0}, "missing 'v'"), ({"x": 1.0, "v": [1, 2], "w": 0}, "not in the header 'w'"),
    ({"x": 1.0, "v": [1, 2, 3]}, r"series 'v': expected shape \(2,\), got \(3,\)")])
def test_row_buffer_refuses_wrong_rows_and_stays_unchanged(bad: dict[str, object], text: str) -> None:
    buffer = RowBuffer({"x": (), "v": (2,)})
    with pytest.raises(ValueError, match=text):
        buffer.append(bad)
    assert len(buffer) == 0


def test_series_of_points_and_sliders_are_found_by_name() -> None:
    buffer = ResultBuffer(header())
    fill(buffer, 4)
    result = buffer.close({"wall_time": 1.5})
    np.testing.assert_array_equal(result.point("mid")[1], [4, 5, 6])
    assert result.slider("cart")["s"] == pytest.approx([0, 0.1, 0.2, 0.3]) and result.slider("cart")["force"].shape == (4, 3)
    assert result.info["wall_time"] == 1.5 and "4 rows" in repr(result) and "'test'" in repr(result)
    with pytest.raises(SceneError, match="point 'top' is not in this result: choose from 'mid', 'tip'"):
        result.point("top")
    with pytest.raises(SceneError, match="series 'strain' was not recorded"):
        result.drift("strain")


def test_drift_uses_the_largest_value_or_the_stored_scale() -> None:
    t = np.arange(3.0)
    series = {"total": np.array([-4.0, -4.0, -3.0]), "lin_mom": np.array([[0, 0, 0], [0, 3e-9, 4e-9], [0, 0, 0]]),
              "gap": np.array([[1e-3, -2e-3]] * 3)}
    plain = Result(t=t, series=series)
    assert plain.drift("total") == 0.25 and plain.drift("lin_mom") == 1.0 and plain.drift("gap") == 2e-3
    scaled = Result(t=t, series=series, info={"scale": {"lin_mom": 5.0, "gap": 2.0}})
    assert scaled.drift("lin_mom") == pytest.approx(1e-9) and scaled.drift("gap") == 1e-3
    assert np.isnan(Result(t=t, series={"total": np.array([1.0, np.nan, 1.0])}).drift("total"))


def test_table_lists_start_end_and_drift_and_leaves_out_what_is_not_conserved() -> None:
    result = Result(t=[0.0, 1.0], series={"total": [2.0, 2.5], "lin_mom": [[3.0, 4.0, 0.0]] * 2, "gap": np.zeros((2, 0))},
                    info={"conserved": ["lin_mom"]})
    lines = result.table().splitlines()
    assert len(lines) == 3
    assert lines[1].split()[-3:] == ["2.00000000e+00", "2.50000000e+00", "-"]
    assert lines[2].split()[-3:] == ["5.00000000e+00", "5.00000000e+00", "0.00e+00"]


def test_result_refuses_series_of_unequal_length() -> None:
    with pytest.raises(ValueError, match="series 'total'.*3 rows"):
        Result(t=np.zeros(3), series={"total": np.zeros(2)})


@pytest.mark.parametrize("n_sliders", [0, 2])
def test_saved_result_equals_the_loaded_one(tmp_path: Path, n_sliders: int) -> None:
    buffer = ResultBuffer(header(n_sliders))
    fill(buffer, 50, n_sliders)
    result = buffer.close({"wall_time": 0.25, "versions": ["1", "2"]})
    result.save(tmp_path / "run.h5")
    assert_same(result, load_result(tmp_path / "run.h5"))


def test_empty_result_can_be_saved(tmp_path: Path) -> None:
    result = Result(t=[], series={"total": []})
    result.save(tmp_path / "run.h5")
    assert_same(result, load_result(tmp_path / "run.h5"))


def test_writer_and_buffer_give_the_same_result(tmp_path: Path) -> None:
    buffer, writer = ResultBuffer(header()), ResultWriter(tmp_path / "run.h5", header())
    for sink in (buffer, writer):
        fill(sink, 30)
    writer.close({"steps": np.int64(29)})
    assert_same(buffer.close({"steps": 29}), load_result(tmp_path / "run.h5"))


def test_running_file_can_be_read_beside_its_writer(tmp_path: Path) -> None:
    with ResultWriter(tmp_path / "run.h5", header()) as writer:
        fill(writer, 10)
        writer.flush()
        fill(writer, 5)
        seen = load_result(tmp_path / "run.h5")
    assert len(seen.t) == 10 and len(seen.events) == 1
    assert len(load_result(tmp_path / "run.h5").t) == 15


KILLED = """
import sys
import numpy as np
sys.path.insert(0, {tests!r})
import test_store as ts
from fastbeam.results import hdf5_writer as store
store.FLUSH_TIME = 0.002
writer = store.ResultWriter({path!r}, ts.header(n_nodes=60))
k = 0
while True:
    writer.append(ts.row(k), 0.1 * k)
    if k % 5 == 0:
        writer.snapshot(0.1 * k, np.full((60, 3), float(k)), np.full((60, 3, 3), float(k)))
        writer.event({{"kind": "tick", "time": 0.1 * k, "text": "x" * (k % 97)}})
    before = writer._state.count["rows"]
    if before and before != getattr(writer, "told", 0):
        writer.told = before
        print(before, flush=True)
    k += 1
"""


@pytest.mark.parametrize("delay", [0.0, 0.013, 0.11, 0.37])
def test_file_of_a_killed_writer_holds_every_flushed_row(tmp_path: Path, delay: float) -> None:
    path = tmp_path / "run.h5"
    code = KILLED.format(tests=str(Path(__file__).parent), path=str(path))
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True,
                               env={**os.environ, "PYTHONPATH": str(SOURCE)})
    assert process.stdout is not None
    told = [process.stdout.readline()]
    time.sleep(delay)
    os.kill(process.pid, signal.SIGKILL)
    told += process.stdout.read().splitlines()
    assert process.wait() == -signal.SIGKILL
    flushed = max(int(line) for line in told if line.strip())
    result = load_result(path)
    n = len(result.t)
    assert n >= flushed > 0
    np.testing.assert_array_equal(result.series["iterations"], np.arange(n))
    np.testing.assert_array_equal(result.t, 0.1 * np.arange(n))
    np.testing.assert_array_equal(result.series["contact_force"][:, 0, 2], 0.5 * np.arange(n))
    m = len(result.t_snap)
    # snapshots and events of the last flush may lag one behind the rows of the same flush
    assert 0 <= (n + 4) // 5 - m <= 1 and len(result.events) in (m - 1, m)
    np.testing.assert_array_equal(result.directors[:, 59, 2, 2], 5.0 * np.arange(m))
    assert all(event["text"] == "x" * (5 * k % 97) for k, event in enumerate(result.events))


def test_existing_file_is_replaced_only_when_asked(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    Result(t=[0.0]).save(path)
    with pytest.raises(ResultFileError, match="exists already; pass overwrite=True"):
        Result(t=[0.0, 1.0]).save(path)
    assert len(load_result(path).t) == 1
    Result(t=[0.0, 1.0]).save(path, overwrite=True)
    assert len(load_result(path).t) == 2


def test_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(ResultFileError, match="folder '.*nowhere' does not exist"):
        Result(t=[0.0]).save(tmp_path / "nowhere" / "run.h5")


def test_files_that_are_not_results_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    with pytest.raises(ResultFileError, match="run.h5': no such file"):
        load_result(path)
    path.write_bytes(b"not hdf5")
    with pytest.raises(ResultFileError, match="run.h5': not an HDF5 file"):
        load_result(path)
    with h5py.File(path, "w") as file:
        file["x"] = 1
    with pytest.raises(ResultFileError, match="not a fastbeam result .attribute 'format' is None"):
        load_result(path)


def test_newer_and_damaged_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    with ResultWriter(path, header()) as writer:
        fill(writer, 3)
    with h5py.File(path, "r+") as file:
        file.attrs["version"] = 99
    with pytest.raises(ResultFileError, match="format version 99, this fastbeam reads 1 to 2"):
        load_result(path)
    with h5py.File(path, "r+") as file:
        file.attrs["version"] = 2
        del file["rows/gap"]
    with pytest.raises(ResultFileError, match="damaged, it lacks rows/gap"):
        load_result(path)


@pytest.mark.parametrize("closed", [True, False])
def test_truncated_files_are_refused_at_once(tmp_path: Path, closed: bool) -> None:
    path, copy = tmp_path / "run.h5", tmp_path / "copy.h5"
    with ResultWriter(path, header()) as writer:
        fill(writer, 3)
        writer.flush()
        if closed:
            writer.close()
        copy.write_bytes(path.read_bytes()[:2000])
        with pytest.raises(ResultFileError, match="copy.h5'.*truncated"):
            load_result(copy)


def test_rows_that_are_missing_are_noticed(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    with ResultWriter(path, header()) as writer:
        fill(writer, 6)
    with h5py.File(path, "r+") as file:
        file["rows/total"].resize(4, axis=0)
    with pytest.raises(ResultFileError, match="damaged, 'rows/total' has 4 of 6 rows"):
        load_result(path)


def test_files_of_version_1_are_read_and_cut_to_the_common_rows(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    with ResultWriter(path, header()) as writer:
        fill(writer, 6)
    counts = (6, 2, writer._state.count["events"], 0)
    with h5py.File(path, "r+") as file:
        del file["blocks"], file["committed"]
        file["committed"] = np.array(counts)
        file.attrs["version"] = 1
    assert len(load_result(path).t) == 6
    with h5py.File(path, "r+") as file:
        file["rows/total"].resize(4, axis=0)
        file["snapshots/phi"].resize(1, axis=0)
    result = load_result(path)
    assert len(result.t) == len(result.series["gap"]) == 4 and len(result.t_snap) == len(result.directors) == 1


def test_events_that_cannot_be_stored_are_refused(tmp_path: Path) -> None:
    with ResultWriter(tmp_path / "run.h5", header()) as writer, pytest.raises(ResultFileError, match="result event: only"):
        writer.event({"kind": object()})


def test_closed_writer_takes_no_more_rows(tmp_path: Path) -> None:
    writer = ResultWriter(tmp_path / "run.h5", header())
    writer.close()
    writer.close()
    with pytest.raises(ResultFileError, match="already closed"):
        writer.append(row(0), 0.0)


def test_missing_h5py_says_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(BackendError, match="pip install h5py"):
        Result(t=[0.0]).save(tmp_path / "run.h5")
