"""The benchmark suite and its judge: verdicts on made-up numbers, one small case for real."""
from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "perf"))

import compare  # noqa: E402
import suite  # noqa: E402


@pytest.mark.parametrize(("pairs", "verdict"), [
    ([(1.0, 1.0), (1.1, 1.1), (0.9, 0.9)], "same"),
    ([(1.0, 1.2), (1.1, 1.32), (0.9, 1.08)], "SLOWER"),
    ([(1.0, 0.8), (1.1, 0.88), (0.9, 0.72)], "faster"),
    # 5 % within a noise of 2 % at least
    ([(1.0, 1.05)] * 5, "same"),
    ([(1.0, 1.08)] * 5, "SLOWER"),
    # noisy rounds forgive more
    ([(1.0, 1.3), (1.0, 1.0), (1.0, 1.2), (1.0, 0.9), (1.0, 1.5)], "same")])
def test_verdicts(pairs: list[tuple[float, float]], verdict: str) -> None:
    assert compare.judge(pairs, 0.03)[2] == verdict


def test_a_slow_down_below_what_is_allowed_is_none() -> None:
    assert compare.judge([(1.0, 1.2)] * 3, 0.25)[2] == "same"


def test_cases_are_chosen_by_name_or_size() -> None:
    assert suite.chosen(["planar", "beam"], False) == ["beam", "planar"]
    assert "large net" not in suite.chosen([], False)
    assert suite.chosen([], True) == list(suite.CASES)
    with pytest.raises(SystemExit, match="no case is called 'bean': choose from beam, "):
        suite.chosen(["bean"], False)


def test_an_unknown_revision_is_named(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="base 'no-such-thing'"):
        compare.checkout("no-such-thing", tmp_path)


def test_a_case_runs_in_its_own_process() -> None:
    found = suite.measure("statics")
    assert not isinstance(found, str), found
    assert found["whole"][0] > 0.0 and found["whole"][1] == "ms"
    assert found["iterations"][0] >= 3.0


def test_a_case_that_fails_says_why(tmp_path: Path) -> None:
    (tmp_path / "fastbeam.py").write_text("raise RuntimeError('not this one')\n")
    assert suite.measure("beam", tmp_path) == "RuntimeError: not this one"


def test_the_list_names_every_case() -> None:
    done = subprocess.run([sys.executable, str(ROOT / "perf" / "suite.py"), "--list"], capture_output=True, text=True, check=True)
    assert [line[:12].strip() for line in done.stdout.splitlines()] == list(suite.CASES)


@pytest.mark.parametrize("kind", ["plane", "space"])
def test_memory_of_a_slider_keeps_its_bar_whatever_their_number(kind: str) -> None:
    import numpy as np
    import sliders

    import fastbeam as fb
    from fastbeam.newton import Stepper
    taken = {}
    for n in (16, 64, 128):
        model = fb.compile_scene(sliders.cable(n, 3, "c1"), planar=kind == "plane", condense=False)
        taken[n] = sliders.room(Stepper(model, np.ones(1))) / n
    assert taken[128] <= taken[64] <= taken[16] <= sliders.BYTES, taken
