"""Every example runs, writes its pictures and gives the numbers it promises; so does the program of the README."""
from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from test_pages import pages

from fastbeam import load_result
from fastbeam.__main__ import find_examples, list_examples, load_example

ROOT = Path(__file__).resolve().parents[2]
NAMES = ("bend45", "crane", "free_flight_slider", "ring_on_cable", "slider_crank", "snap_through", "tuning_fork")


@pytest.fixture
def example(request: pytest.FixtureRequest) -> ModuleType:
    return load_example(request.param)


def is_picture(path: Path) -> bool:
    return path.read_bytes().startswith(b"\x89PNG") and path.stat().st_size > 10_000


def test_the_command_line_lists_every_example_with_what_it_shows() -> None:
    assert tuple(find_examples()) == NAMES
    lines = list_examples().splitlines()
    assert [line.split()[0] for line in lines] == list(NAMES)
    assert all(len(line.split(maxsplit=1)[1]) > 30 for line in lines)


@pytest.mark.parametrize("example", ["ring_on_cable"], indirect=True)
def test_ring_on_cable_meets_the_other_program_and_keeps_its_energy(example: ModuleType, tmp_path: Path,
                                                                   capsys: pytest.CaptureFixture[str]) -> None:
    run = example.main(out=str(tmp_path), elements=16, step=1e-3)
    rows = example.compare(run)
    assert rows.shape == (6, 6)
    # 3e-5 m uncertainty of the other program, about 1e-4 m from its strain model, 5e-5 m from this coarser mesh and step
    assert np.abs(rows - example.PUBLISHED).max() < 2e-4
    # round-off of 600 steps
    assert run.drift("total") < 1e-12 and run.drift("gap") < 1e-15
    assert run.events == [] and run.info["steps"] == 600
    printed = capsys.readouterr().out
    assert "steps per second" in printed and "block elimination" in printed and "difference" in printed
    assert is_picture(tmp_path / "ring_on_cable.png")
    np.testing.assert_array_equal(load_result(tmp_path / "ring_on_cable.h5").series["s_slide"], run.series["s_slide"])


@pytest.mark.parametrize("example", ["free_flight_slider"], indirect=True)
def test_free_flight_keeps_all_invariants_for_every_order_and_step(example: ModuleType, tmp_path: Path) -> None:
    runs = example.main(out=str(tmp_path), elements=6, step=0.04, t_end=2.0)
    assert len(runs) == 6
    for run in runs.values():
        # round-off of at most 1000 substeps
        assert max(run.drift(name) for name in ("total", "lin_mom", "ang_mom")) < 1e-12
        assert run.drift("gap") < 1e-14 and not run.events
    tips = {key: run.point("tip")[-1] for key, run in runs.items()}
    # the step of order 4 is nearer to the finest run than the basic one; measured 1e-5 m against 1e-3 m
    basic, composed = (np.linalg.norm(tips[order, 0.02] - tips[4, 0.01]) for order in (2, 4))
    assert composed < 0.1 * basic < 1e-3
    # the body has moved on by more than an element
    assert runs[2, 0.04].slider("contact")["s"][-1] > 3.0
    assert is_picture(tmp_path / "free_flight_slider.png")


@pytest.mark.parametrize("example", ["bend45"], indirect=True)
def test_bend45_reaches_the_exact_tip_with_order_2p(example: ModuleType, tmp_path: Path,
                                                    monkeypatch: pytest.MonkeyPatch) -> None:
    # measured 1.75e-7 with 8 cubic elements
    assert example.tip_error(8, 3)[1] < 2e-7
    table = example.convergence((2, 3), (8, 16))
    for p, ((nodes, coarse), (finer, fine)) in table.items():
        order = np.log(coarse / fine) / np.log((finer - 1) / (nodes - 1))
        # not yet asymptotic: a tenth of the order 2p is allowed
        assert abs(order - 2 * p) < 0.2 * p
    monkeypatch.setattr(example, "convergence", lambda: table)
    result = example.main(out=str(tmp_path), elements=4)
    # strain energy of the exact solution 10695.374; four elements are 1e-5 of the length away
    assert result.series["strain"][-1] == pytest.approx(10695.374391690506, rel=1e-4)
    assert is_picture(tmp_path / "bend45.png") and is_picture(tmp_path / "bend45_convergence.png")


@pytest.mark.parametrize("example", ["crane"], indirect=True)
def test_crane_keeps_its_energy_and_stops_at_the_end_of_the_boom(example: ModuleType, tmp_path: Path) -> None:
    run = example.main(out=str(tmp_path), boom_elements=6, rope_elements=3)
    assert run.drift("total") < 1e-12 and run.drift("gap") < 1e-14
    event, = run.events
    assert event["kind"] == "slider_end" and event["end"] == "end"
    # 3.6847 s with 24 and 6 elements and half the step
    assert event["time"] == pytest.approx(3.6847, abs=1e-3)
    assert run.slider("trolley on boom")["s"][-1] == pytest.approx(example.SPAN, abs=1e-9 * example.SPAN)
    # rope and load stay a rope's length below the trolley
    reach = np.linalg.norm(run.point("load") - run.slider("trolley on boom")["position"], axis=1)
    assert np.abs(reach - example.ROPE).max() < 0.02
    assert is_picture(tmp_path / "crane.png")


@pytest.mark.parametrize("example", ["snap_through"], indirect=True)
def test_snap_through_is_the_exact_path(example: ModuleType, tmp_path: Path) -> None:
    path = example.main(out=str(tmp_path))
    y, load = path.point("joint")[:, 1], 200.0 * path.series["load_factor"]
    assert np.abs(load - example.load_at(y)).max() < 1e-9
    limits = [200.0 * point["load_factor"] for point in path.info["critical_points"]]
    np.testing.assert_allclose(limits, [example.limit_load(), -example.limit_load()], rtol=1e-12)
    # the formula of the limit load itself: no other load on the way down to the line is larger
    assert example.load_at(np.linspace(0.0, example.HEIGHT, 20001)).max() == pytest.approx(example.limit_load(), rel=1e-7)
    assert y.min() < -example.HEIGHT and is_picture(tmp_path / "snap_through.png")


@pytest.mark.parametrize("example", ["slider_crank"], indirect=True)
def test_slider_crank_goes_where_a_stiff_rod_sends_it(example: ModuleType, tmp_path: Path) -> None:
    run = example.main(out=str(tmp_path), step=2e-3, t_end=1.0)
    shaft, guide = run.joint("shaft"), run.joint("guide")
    # two turns; measured 4e-6 m from the rigid rod
    assert shaft["angle"][-1] > 4.0 * np.pi
    assert np.abs(guide["distance"] - example.rigid_piston(shaft["angle"])).max() < 2e-5
    np.testing.assert_allclose(shaft["work"], 3.0 * shaft["angle"], rtol=1e-11, atol=1e-11)
    assert run.drift("balance") < 1e-12 and not run.events
    assert is_picture(tmp_path / "slider_crank.png")


@pytest.mark.parametrize("example", ["tuning_fork"], indirect=True)
def test_tuning_fork_sounds_like_its_mode(example: ModuleType, tmp_path: Path) -> None:
    mode, tone = example.main(out=str(tmp_path), elements=3)
    # measured 324.49 and 324.51 Hz; a clamped prong would be higher by what the bow gives way
    assert tone == pytest.approx(mode, rel=2e-4)
    assert 0.85 < mode / example.clamped_prong() < 0.95
    assert is_picture(tmp_path / "tuning_fork.png")


def readme() -> str:
    return (ROOT / "README.md").read_text(encoding="utf-8")


def readme_blocks() -> list[str]:
    """The program, and the end of what it prints."""
    return re.findall(r"```(?:python|text)\n(.*?)```", readme(), flags=re.DOTALL)


def test_the_readme_is_short_and_its_picture_moves() -> None:
    assert len(readme().split()) <= 450
    bullets = re.findall(r"^- (\*\*.*)$", readme(), flags=re.MULTILINE)
    assert len(bullets) == 6 and max(len(bullet.split()) for bullet in bullets) <= 12
    film = (ROOT / "docs" / "ring_on_cable.gif").read_bytes()
    # a graphic control extension in front of every frame
    assert film.startswith(b"GIF89a") and film.count(b"\x21\xf9\x04") >= 60 and len(film) < 1_500_000


def test_the_readme_maps_every_package() -> None:
    named = re.findall(r"^    (\w+) {2,}\w", readme(), flags=re.MULTILINE)
    assert sorted(named) == sorted(path.parent.name for path in (ROOT / "src" / "fastbeam").glob("*/__init__.py"))


def test_the_program_of_the_readme_is_short_and_runs_as_it_stands(tmp_path: Path) -> None:
    program, shown = readme_blocks()
    assert len([line for line in program.splitlines() if line.strip()]) <= 15
    (tmp_path / "first.py").write_text(program, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src"), "FASTBEAM_PROGRESS": "0"}
    done = subprocess.run([sys.executable, "first.py"], cwd=tmp_path, env=environment, capture_output=True, text=True,
                          check=False)
    assert done.returncode == 0, done.stderr
    drifts = [float(line.split()[-1]) for line in done.stdout.splitlines() if re.search(r"e[-+]\d\d$", line)]
    assert len(drifts) == 4 and max(drifts) < 1e-11
    lines = done.stdout.splitlines(keepends=True)
    assert pages.same(shown, "".join(lines[-len(shown.splitlines()):])) == ""
    assert is_picture(tmp_path / "first.png")


def test_links_and_pictures_of_the_texts_exist() -> None:
    texts = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    assert len(texts) > 40
    links = [(text, target) for text in texts for target in re.findall(r"\]\(([^)#]+)", text.read_text(encoding="utf-8"))]
    inside = [(text, target) for text, target in links if "://" not in target]
    assert len(inside) >= 9
    assert [f"{text.name}: {target}" for text, target in inside if not (text.parent / target).exists()] == []
