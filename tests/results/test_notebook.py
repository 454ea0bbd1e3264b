"""What notebooks show."""
from __future__ import annotations

import sys
from html.parser import HTMLParser
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from small_scenes import bead

import fastbeam as fb
from fastbeam.results import progress
from fastbeam.results.progress import Progress


class Texts(HTMLParser):
    """Texts and tags of a page; tags have to be closed."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.texts: list[str] = []
        self.open: list[str] = []
        self.tags: set[str] = set()
        self.feed(page)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.tags.add(tag)
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def test_scenes_models_and_results_show_themselves() -> None:
    scene = bead()
    assert {"Scene bead", "beam", "rail", "slider", "run", "point mass"} <= set(Texts(scene._repr_html_()).texts)
    model = fb.compile_scene(scene)
    assert str(model) in Texts(model._repr_html_()).texts
    run = fb.Result(t=[0.0, 1.0], series={"total": [2.0, 2.0], "lin_mom": np.ones((2, 3))}, info={"scene": "bead"},
                    events=[{"kind": "coarse", "time": 1.0, "text": "too few elements"}])
    page = Texts(run._repr_html_())
    assert {"Result bead", "total energy [J]", "|linear momentum| [kg m/s]", "max drift"} <= set(page.texts)
    assert "unreliable result, coarse: too few elements" in page.texts
    assert "2.00000000e+00" in page.texts and "0.00e+00" in page.texts


def test_names_of_foreign_files_are_text_and_not_code() -> None:
    bad = "<script>alert(1)</script>"
    run = fb.Result(t=[0.0], info={"scene": bad}, events=[{"kind": bad, "text": bad}], series={"total": [1.0]})
    page = Texts(run._repr_html_())
    assert "script" not in page.tags and any(bad in text for text in page.texts)
    beam = fb.Beam.straight(bad, (0, 0, 0), (1, 0, 0), section=fb.Section.circle(radius=0.1, E=1.0, rho=1.0), elements=1)
    assert "script" not in Texts(fb.Scene(beam, name=bad)._repr_html_()).tags


def test_long_scenes_are_cut() -> None:
    masses = [fb.PointMass(f"m{k}", mass=1.0, position=(k, 0, 0)) for k in range(200)]
    texts = Texts(fb.Scene(*masses)._repr_html_()).texts
    assert "and 150 more" in texts and "m49" in texts and "m50" not in texts


class Output:
    """A cell's output."""

    def __init__(self) -> None:
        self.pages: list[str] = []

    def update(self, page: str) -> None:
        self.pages.append(page)


@pytest.fixture
def cell(monkeypatch: pytest.MonkeyPatch) -> Output:
    """IPython as it is in the kernel of a notebook."""
    output = Output()
    shell = type("ZMQInteractiveShell", (), {})()
    ipython, display = ModuleType("IPython"), ModuleType("IPython.display")
    ipython.get_ipython = lambda: shell  # type: ignore[attr-defined]
    display.HTML = str  # type: ignore[attr-defined]
    display.display = lambda page, display_id: output  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    monkeypatch.delenv("FASTBEAM_PROGRESS", raising=False)
    return output


def test_bars_move_in_cells_and_vanish(cell: Output, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    clock = SimpleNamespace(now=0.0, perf_counter=lambda: clock.now)
    monkeypatch.setattr(progress, "time", clock)
    with Progress(100, "<run>") as bar:
        for _ in range(100):
            clock.now += 0.1
            bar.update()
    assert capsys.readouterr().err == ""
    # nothing in the first second, then at most five pictures a second
    assert 30 < len(cell.pages) < 60 and cell.pages[-1] == ""
    assert "value='0.1" in cell.pages[0] and "&lt;run&gt;: 5" in cell.pages[len(cell.pages) // 2] and "left" in cell.pages[5]


def test_short_runs_show_nothing(cell: Output) -> None:
    with Progress(1, "run") as bar:
        bar.update()
    assert cell.pages == []


def test_a_front_end_without_displays_stops_no_run(cell: Output, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cell, "update", lambda page: 1 / 0)
    monkeypatch.setattr(progress, "QUIET_TIME", -1.0)
    with Progress(2, "run") as bar:
        bar.update()
        bar.update()
    assert bar.done == 2
