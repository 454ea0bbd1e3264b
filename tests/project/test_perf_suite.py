"""The benchmark suite and its judge: verdicts on made-up numbers, one small case for real."""
from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from perf.suite import compare, regression

ROOT = Path(__file__).resolve().parents[2]


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


def made_up(base: dict[str, dict[str, float] | str], here: dict[str, dict[str, float] | str], monkeypatch: pytest.MonkeyPatch,
            *options: str) -> int:
    """Exit code of compare.py where both revisions measure these values."""
    def measure(name: str, source: Path | None = None) -> dict[str, tuple[float, str]] | str:
        values = (base if source else here)[name]
        return values if isinstance(values, str) else {key: (x, "us") for key, x in values.items()}

    monkeypatch.setattr(regression, "measure", measure)
    monkeypatch.setattr(compare, "checkout", lambda revision, folder: folder / "src")
    monkeypatch.setattr(sys, "argv", ["compare.py", "base", *here, *options])
    return compare.main()


@pytest.mark.parametrize(("options", "code", "verdicts"), [
    ((), 0, ("same", "same", "same")), (("--bar", "1.05"), 0, ("met", "met", "same")),
    (("--bar", "1.03"), 1, ("missed", "met", "same"))])
def test_a_bar_judges_steps_as_they_are(options: tuple[str, ...], code: int, verdicts: tuple[str, ...],
                                        monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """5 % are within the noise without a bar, and miss one of 3 %; memory keeps its own verdict."""
    base: dict[str, dict[str, float] | str] = {"beam": {"step": 1.0, "memory": 1.0}, "statics": {"whole": 1.0}}
    here: dict[str, dict[str, float] | str] = {"beam": {"step": 1.049, "memory": 1.05}, "statics": {"whole": 1.02}}
    assert made_up(base, here, monkeypatch, *options) == code
    found = {tuple(line.split()[:2]): line.split()[-1] for line in capsys.readouterr().out.split("here/base")[1].splitlines()[1:]}
    assert found == {("beam", "step"): verdicts[0], ("statics", "whole"): verdicts[1], ("beam", "memory"): verdicts[2]}


def test_a_case_that_the_base_cannot_build_is_named_and_not_judged(monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
                                                                   capsys: pytest.CaptureFixture[str]) -> None:
    base: dict[str, dict[str, float] | str] = {"beam": {"step": 1.0}, "net sliders": "AttributeError: no beam here"}
    here: dict[str, dict[str, float] | str] = {"beam": {"step": 1.0}, "net sliders": {"step": 9.0}}
    kept = tmp_path / "found.json"
    assert made_up(base, here, monkeypatch, "--bar", "1.03", "--json", str(kept)) == 0
    assert "net sliders      not compared (base: AttributeError: no beam here)" in capsys.readouterr().out
    assert json.loads(kept.read_text())["not compared"] == {"net sliders": "base: AttributeError: no beam here"}


@pytest.mark.parametrize("bar", ["0", "-1", "nan", "inf"])
def test_a_bar_is_a_ratio(bar: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        made_up({"beam": {}}, {"beam": {}}, monkeypatch, f"--bar={bar}")
    assert "--bar: must be a ratio > 0" in capsys.readouterr().err


def test_cases_are_chosen_by_name_or_size() -> None:
    assert regression.chosen(["planar", "beam"], False) == ["beam", "planar"]
    assert "large net" not in regression.chosen([], False)
    assert regression.chosen([], True) == list(regression.CASES)
    with pytest.raises(SystemExit, match="no case is called 'bean': choose from beam, "):
        regression.chosen(["bean"], False)


def test_an_unknown_revision_is_named(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="base 'no-such-thing'"):
        compare.checkout("no-such-thing", tmp_path)


def test_a_case_runs_in_its_own_process() -> None:
    found = regression.measure("statics")
    assert not isinstance(found, str), found
    assert found["whole"][0] > 0.0 and found["whole"][1] == "ms"
    assert found["iterations"][0] >= 3.0


def test_a_case_that_fails_says_why(tmp_path: Path) -> None:
    (tmp_path / "fastbeam.py").write_text("raise RuntimeError('not this one')\n")
    assert regression.measure("beam", tmp_path) == "RuntimeError: not this one"


def test_the_list_names_every_case() -> None:
    command = [sys.executable, str(ROOT / "perf" / "suite" / "regression.py"), "--list"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert [line[:16].strip() for line in done.stdout.splitlines()] == list(regression.CASES)


@pytest.mark.parametrize("kind", ["plane", "space"])
def test_memory_of_a_slider_keeps_its_bar_whatever_their_number(kind: str) -> None:
    import numpy as np

    import fastbeam as fb
    from fastbeam.stepping.stepper import Stepper
    from perf.cases import sliders
    taken = {}
    for n in (16, 64, 128):
        model = fb.compile_scene(sliders.cable(n, 3, "c1"), planar=kind == "plane", condense=False)
        taken[n] = sliders.room(Stepper(model, np.ones(1))) / n
    assert taken[128] <= taken[64] <= taken[16] <= sliders.BYTES, taken
