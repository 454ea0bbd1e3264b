"""The self-test says what is there, and fails where something is wrong."""
from __future__ import annotations

import re

import numpy as np
import pytest

import fastbeam as fb
from fastbeam import __main__ as front
from fastbeam import doctor


def test_doctor_prints_what_is_there_and_passes(capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["doctor"]) == 0
    said = capsys.readouterr().out
    lines = dict(line.split(maxsplit=1) for line in said.splitlines())
    assert {"fastbeam", "python", "libraries", "processor", "MKL", "settings", "cache", "kernels"} <= set(lines)
    assert f"numpy {np.__version__}" in lines["libraries"] and lines["fastbeam"].startswith(fb.__version__)
    assert said.count("\nok ") == 2
    drift, = re.findall(r"drift of energy (\S+),", said)
    assert 0.0 < float(drift) < 1e-12


def test_a_failing_test_is_said_with_its_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> tuple[bool, str]:
        raise OSError("no such\nlibrary")

    monkeypatch.setattr(doctor, "sparse_solver", broken)
    monkeypatch.setattr(doctor, "LARGEST_DRIFT", 0.0)
    said: list[str] = []
    assert doctor.examine(said.append) == 1
    failed = [line for line in said if line.startswith("FAILED")]
    assert len(failed) == 2 and "200 steps, drift of energy" in failed[0] and "OSError: no such library" in failed[1]


def test_without_mkl_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FASTBEAM_NO_MKL", "1")
    assert any("pip install pypardiso" in line for line in doctor.processor())
    assert doctor.sparse_solver() == (True, "not there")
