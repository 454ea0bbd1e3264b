"""Kernels that kernels call: one code for all numbers in the source, a second process that compiles some, what the user sees."""
from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from fastbeam.kernels.jit import decorators as _jit
from fastbeam.kernels.jit import parts as _parts

SOURCE = Path(__file__).resolve().parents[2] / "src"
PAIR = """
from numba import float64, int64
from fastbeam.kernels.jit.decorators import ABSENT, kernel, one_variant


@one_variant
def power(x, n, array):
    y = 1.0
    for i in range(n):
        y *= x
    if array is not None:
        y += array[0]
    return y


@kernel
def whole(x):
    return power(x, 2, None) + power(x, 3, None)


JOB = power, (float64, int64, ABSENT)
"""
RUN = """
import json, os, sys
folder, processors, program, patience = json.loads(sys.argv[1])
sys.path.insert(0, folder)
if processors == 1:
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
from fastbeam.kernels.jit import background as _background, decorators as _jit
import pair
_background.PATIENCE = patience
sys.executable = program or sys.executable
_background.start(_background.missing([pair.JOB]), _jit._FOLDER)
value = pair.whole(3.0)
part = pair.power.part
print(json.dumps([value, len(part.loaded), len(part.missed), len(part.signatures), *_jit.compile_counts(),
                  len(_background._COMING)]))
"""
two_processors = pytest.mark.skipif(not hasattr(os, "sched_setaffinity") or len(os.sched_getaffinity(0)) < 2,
                                    reason="needs two processors and a system that can hide one")


def run(folder: Path, processors: int = 2, program: str = "", patience: float = 60.0) -> Any:
    """Call `whole` in a fresh process, while a second compiles its part: value, variants of `power` that were loaded, compiled
    and used, kernels loaded and compiled, what is still waited for."""
    (folder / "pair.py").write_text(PAIR)
    done = subprocess.run([sys.executable, "-c", RUN, json.dumps([str(folder), processors, program, patience])],
                          capture_output=True, text=True, check=False, timeout=200,
                          env={**os.environ, "PYTHONPATH": str(SOURCE), "FASTBEAM_CACHE_DIR": str(folder / "cache")})
    assert done.returncode == 0 and done.stderr == "", done.stderr
    return json.loads(done.stdout)


def program(folder: Path, text: str) -> str:
    """A program in place of Python's."""
    path = folder / "python-of-another-kind"
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


@two_processors
def test_second_process_compiles_what_the_first_loads(tmp_path: Path) -> None:
    assert run(tmp_path) == [36.0, 1, 0, 1, 1, 1, 0]
    # all that a warm process needs is the kernel that it calls
    assert run(tmp_path) == [36.0, 0, 0, 0, 1, 0, 0]


@two_processors
def test_one_processor_compiles_alone_and_numbers_in_the_source_make_no_variants(tmp_path: Path) -> None:
    assert run(tmp_path, processors=1) == [36.0, 0, 1, 1, 0, 2, 0]


@two_processors
@pytest.mark.parametrize("text", ["exit 1", "exec sleep 20", "head -c 10; echo; echo; echo", "not a command"])
def test_second_process_that_fails_does_not_matter(tmp_path: Path, text: str) -> None:
    assert run(tmp_path, program=program(tmp_path, text), patience=0.5) == [36.0, 0, 1, 1, 0, 2, 0]


@two_processors
def test_program_that_is_not_python_is_not_started(tmp_path: Path) -> None:
    trace = tmp_path / "started"
    for name, started in (("python-of-another-kind", True), ("painter", False)):
        path = Path(program(tmp_path, f"touch {trace}")).rename(tmp_path / name)
        run(tmp_path, program=str(path))
        assert trace.exists() is started
        trace.unlink(missing_ok=True)
        for kept in (tmp_path / "cache").rglob("*.nb?"):
            kept.unlink()


BEAM = """
import json, sys
import numpy as np
import fastbeam as fb
from fastbeam.kernels.beams.element_loop import element_groups
from fastbeam.kernels.linalg.chain import factor
section = fb.Section.circle(radius=0.01, E=1e7, rho=1000.0)
beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=section, elements=2, degree=1)
parts = [fb.Clamp(beam.start)] if sys.argv[1] == "held" else []
result = fb.simulate(fb.compile_scene(fb.Scene(beam, *parts, gravity=(0, 0, -9.81))), step=1e-2, t_end=0.05)
print(json.dumps([result.state.q.tobytes().hex(), *([len(x.part.loaded), len(x.part.missed)] for x in (element_groups, factor))]))
"""


def test_scenes_share_machine_code_of_their_own_through_the_disk(tmp_path: Path) -> None:
    def ran(kind: str, cache: str) -> Any:
        done = subprocess.run([sys.executable, "-c", BEAM, kind], capture_output=True, text=True, check=True, timeout=400,
                              env={**os.environ, "PYTHONPATH": str(SOURCE), "FASTBEAM_CACHE_DIR": str(tmp_path / cache)})
        return json.loads(done.stdout)

    assert not _jit.NUMBA_ONLY
    alone = ran("held", "alone")
    ran("free", "shared")
    # another scene, compiled by another process: what both have in common is neither compiled nor other code
    assert ran("held", "shared") == [alone[0], [1, 0], [1, 0]]
    # nor is anything left to compile, nor a symbol to find, for the whole loop from the disk
    assert ran("held", "shared") == [alone[0], [1, 0], [1, 0]]


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def fresh_kernel() -> Any:
    """A kernel with one part that has not been compiled yet."""
    @_jit.kernel
    def part(x: float) -> float:
        return 2.0 * x

    @_jit.kernel
    def whole(x: float) -> float:
        return part(x)

    for kernel in (part, whole):
        for cache in (kernel._cache, kernel.part.cache):
            cache.disable()
    yield whole
    for kernel in (part, whole):
        _jit.KERNELS.remove(kernel)


@pytest.mark.parametrize("setting, quiet_time, kind, announced, text", [
    ("1", 0.0, Terminal, False, ["\rfastbeam: compiling kernels, 1 in 0 s"] * 2),
    ("1", 1e3, Terminal, False, []),
    ("0", 0.0, Terminal, False, []),
    ("1", 0.0, io.StringIO, False, []),
    ("1", 0.0, io.StringIO, True, ["fastbeam: compiling kernels, 1 in 0 s"])])
def test_compilation_shows_a_line(fresh_kernel: Any, monkeypatch: pytest.MonkeyPatch, setting: str, quiet_time: float,
                                  kind: type[io.StringIO], announced: bool, text: list[str]) -> None:
    stream = kind()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setenv("FASTBEAM_PROGRESS", setting)
    monkeypatch.setattr(_parts, "QUIET_TIME", quiet_time)
    monkeypatch.setattr(_parts.PROGRESS, "announced", announced)
    assert fresh_kernel(1.5) == 3.0
    assert stream.getvalue() == "".join(text) + ("\n" if text else "")
    assert _parts.PROGRESS.announced is False


def test_long_compilation_says_what_it_is_for_and_how_long_it_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setenv("FASTBEAM_PROGRESS", "1")
    monkeypatch.setattr(_parts, "time", type("Clock", (), {"perf_counter": staticmethod(lambda: now[0])}))
    monkeypatch.setitem(_parts.STAGES, "run", ("the time steps", 4))
    progress = _parts._Progress()
    with progress.of("run"):
        for _ in range(6):
            now[0] += 1.6
            progress.step()
        progress.machine_code()
        now[0] += 3.0
    shown = [line.rstrip() for line in stream.getvalue().replace("\n", "").split("\r")[1:]]
    assert shown == ["fastbeam: compiling the time steps: 1 of about 4 kernels, about 6 s left",
                     "fastbeam: compiling the time steps: 2 of about 4 kernels, about 4 s left",
                     "fastbeam: compiling the time steps: 3 of about 4 kernels, about 3 s left",
                     # more than expected: nothing is foretold
                     *(f"fastbeam: compiling kernels for the time steps, {k} in {s} s" for k, s in ((4, 6), (5, 8), (6, 10))),
                     "fastbeam: compiling the time steps: machine code of 6 kernels, about 2 s left",
                     "fastbeam: compiling kernels for the time steps, 6 in 13 s"]
    assert stream.getvalue().endswith("\n")
    # every line covers the one before it
    lines = stream.getvalue().rstrip("\n").split("\r")[1:]
    assert all(len(after) >= len(before.rstrip()) for before, after in zip(lines, lines[1:]))


def test_in_log_files_short_kernels_do_not_take_the_line_of_the_long_one(monkeypatch: pytest.MonkeyPatch) -> None:
    now, stream = [0.0], io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(_parts, "time", type("Clock", (), {"perf_counter": staticmethod(lambda: now[0])}))
    progress = _parts._Progress()
    progress.announced = True
    for name, seconds in (("add_bodies", 2.0), ("run", 12.0), ("add_elements", 7.0)):
        with progress.of(name):
            progress.step()
            progress.machine_code()
            now[0] += seconds
    assert stream.getvalue() == "fastbeam: compiling kernels for the time steps, 1 in 12 s\n"
