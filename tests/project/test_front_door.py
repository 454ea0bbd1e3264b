"""Command line and progress bar."""
from __future__ import annotations

import io
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from fastbeam import __main__ as front
from fastbeam.results import progress
from fastbeam.results.progress import Progress

SOURCE = Path(__file__).resolve().parents[2] / "src"
EXAMPLE = '''"""A pendulum that swings.

More text.
"""
from dataclasses import dataclass
from pathlib import Path


@dataclass
class Swing:
    angle: float = 0.1


def main(out: str = "out", n_steps: int = 3) -> Swing:
    Path(out).mkdir(parents=True, exist_ok=True)
    (Path(out) / "done.txt").write_text(f"{n_steps} {Swing().angle}")
    return Swing()
'''


@pytest.fixture
def examples(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "examples"
    folder.mkdir()
    (folder / "pendulum.py").write_text(EXAMPLE)
    (folder / "_shared.py").write_text("raise RuntimeError('not an example')")
    (folder / "silent.py").write_text("raise RuntimeError('listing must not run this')")
    monkeypatch.setattr(front, "example_folders", lambda: [tmp_path / "missing", folder])
    return folder


def test_listing_shows_first_docstring_lines_without_running_scripts(examples: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main([]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1:] == ["  pendulum  A pendulum that swings.", "  silent    "]


def test_run_calls_main_with_the_folder(examples: Path, tmp_path: Path) -> None:
    assert front.main(["run", "pendulum", "--out", str(tmp_path / "a" / "b")]) == 0
    assert (tmp_path / "a" / "b" / "done.txt").read_text() == "3 0.1"


def test_unknown_example_lists_the_known_ones_and_exits_with_2(examples: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["run", "pendulums"]) == 2
    error = capsys.readouterr().err
    assert "example 'pendulums' does not exist" in error and "pendulum  A pendulum that swings." in error


def test_missing_examples_are_explained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(front, "example_folders", lambda: [tmp_path])
    assert front.list_examples() == f"no examples found in {tmp_path}"


@pytest.mark.parametrize(("arguments", "code", "text"), [
    (["--version"], 0, "fastbeam "), ([], 0, "examples (python -m fastbeam run NAME"), (["fly"], 2, "invalid choice: 'fly'")])
def test_module_runs_from_the_command_line(arguments: list[str], code: int, text: str) -> None:
    done = subprocess.run([sys.executable, "-m", "fastbeam", *arguments], capture_output=True, text=True, check=False,
                          env={**os.environ, "PYTHONPATH": str(SOURCE)})
    assert done.returncode == code
    assert text in done.stdout + done.stderr


class Clock:
    """Stands in for time.perf_counter."""

    def __init__(self) -> None:
        self.now = 100.0

    def perf_counter(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    monkeypatch.delenv("FASTBEAM_PROGRESS", raising=False)
    stand_in = Clock()
    monkeypatch.setattr(progress, "time", stand_in)
    return stand_in


def test_progress_is_silent_during_the_first_second(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    with Progress(10, "steps") as bar:
        for _ in range(10):
            clock.now += 0.1 - 1e-9
            bar.update()
    captured = capsys.readouterr()
    assert bar.done == 10 and captured.err == captured.out == ""


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "_is_terminal", lambda stream: True)


@pytest.mark.usefixtures("terminal")
def test_progress_appears_on_stderr_after_a_second_and_counts_earlier_work(clock: Clock,
                                                                          capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("tqdm")
    with Progress(0.4, "steps") as bar:
        bar.update(0.1)
        clock.now += 1.5
        bar.update(0.1)
        # round-off past the end must not upset the bar
        bar.update(0.2 + 1e-12)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "steps:  50%" in captured.err and "steps: 100%" in captured.err


@pytest.mark.parametrize(("variable", "enabled", "shown"), [("0", None, False), ("0", True, True), ("1", False, False)])
def test_progress_obeys_environment_and_argument(clock: Clock, capsys: pytest.CaptureFixture[str],
                                                 monkeypatch: pytest.MonkeyPatch, variable: str, enabled: bool | None,
                                                 shown: bool) -> None:
    monkeypatch.setenv("FASTBEAM_PROGRESS", variable)
    with Progress(2, "steps", enabled) as bar:
        clock.now += 2.0
        bar.update()
    assert ("50%" in capsys.readouterr().err) is shown


def test_log_files_get_a_line_after_ten_seconds_and_then_fewer(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    with Progress(1000, "long run") as bar:
        for _ in range(350):
            clock.now += 0.1
            bar.update()
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["long run: 10% in 00:10, 01:30 left", "long run: 20% in 00:20, 01:20 left"]


def test_compilation_before_the_first_step_foretells_nothing(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    with Progress(1000, "run") as bar:
        clock.now += 18.0
        bar.update()
        for _ in range(599):
            clock.now += 0.1
            bar.update()
    lines = capsys.readouterr().err.splitlines()
    # 100 s of steps, not five hours
    assert lines == ["run: 10% in 00:28, 01:30 left", "run: 20% in 00:38, 01:20 left", "run: 40% in 00:58, 01:00 left"]


def test_an_hour_in_a_log_file_is_a_few_lines(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    with Progress(3600, "run") as bar:
        for _ in range(3600):
            clock.now += 1.0
            bar.update()
    assert 5 <= len(capsys.readouterr().err.splitlines()) <= 12


def test_log_files_stay_empty_in_runs_of_some_seconds(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    with Progress(80, "short run") as bar:
        for _ in range(80):
            clock.now += 0.1
            bar.update()
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("on_terminal", [True, False])
def test_no_time_beyond_a_day_is_foretold(on_terminal: bool, clock: Clock, capsys: pytest.CaptureFixture[str],
                                          monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("tqdm")
    monkeypatch.setattr(progress, "_is_terminal", lambda stream: on_terminal)
    with Progress(1e4, "steps") as bar:
        for _ in range(30):
            clock.now += 12.0
            bar.update()
    said = capsys.readouterr().err
    assert "over 24 h" in said and not re.search(r"\d{3,}:\d\d:\d\d", said)


def test_progress_survives_a_closed_stream(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    gone = io.StringIO()
    gone.close()
    monkeypatch.setattr(sys, "stderr", gone)
    with Progress(2, "steps") as bar:
        clock.now += 20.0
        bar.update()
    assert bar.done == 1


@pytest.mark.usefixtures("terminal")
def test_progress_needs_no_tqdm(clock: Clock, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "tqdm", None)
    with Progress(2, "steps") as bar:
        clock.now += 2.0
        bar.update()
    assert bar.done == 1 and capsys.readouterr().err == ""


def test_warmup_compiles_what_a_scene_of_that_kind_needs(capsys: pytest.CaptureFixture[str]) -> None:
    from fastbeam import warmup
    from fastbeam.kernels.jit import decorators as _jit
    assert front.main(["warmup", "planar-slider"]) == 0
    assert "1/1 planar-slider" in capsys.readouterr().out
    _, before = _jit.compile_counts()
    warmup.KINDS["planar-slider"][1]()
    assert _jit.compile_counts()[1] == before


def test_warmup_refuses_what_it_does_not_know(capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["warmup", "slider", "magic"]) == 2
    assert "'magic' does not exist; choose from: beam, slider" in capsys.readouterr().err


@pytest.mark.slow  # compiles seven sets of kernels
@pytest.mark.parametrize("kind", "beam slider planar-slider mechanism planar-mechanism statics planar-statics".split())
def test_every_kind_of_warmup_runs(kind: str) -> None:
    from fastbeam import warmup
    assert front.main(["warmup", kind]) == 0
    assert kind in warmup.KINDS
