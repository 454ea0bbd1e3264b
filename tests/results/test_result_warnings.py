"""Events that mean "do not trust this" reach who never looks at events: Python warnings, tables, texts, notebooks, sweeps."""
from __future__ import annotations

import warnings

import numpy as np
import pytest
from test_notebook import Texts

import fastbeam as fb
from fastbeam.interface import result_warnings as doubts
from fastbeam.interface.result_warnings import KINDS

ROD = fb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=1.0, EI2=1.0, EI3=1.0, rhoA=1.0, rhoI2=0.1, rhoI3=0.1)
SAYS = "unreliable result, coarse: beam 'strip'"


def roll(elements: int) -> fb.Scene:
    """A cantilever bent to a part of a circle, for which one cubic element is too few."""
    beam = fb.Beam.straight("strip", (0, 0, 0), (1, 0, 0), section=ROD, elements=elements, degree=3)
    return fb.Scene(beam, fb.Clamp(beam.start), fb.Load("m", beam.end, moment=(0, 0, 2.4)))


def test_a_result_warns_once_and_names_the_line_that_asked() -> None:
    model = fb.compile_scene(roll(1))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = fb.solve_static(model)
    (one,) = [x for x in caught if x.category is fb.ResultWarning]
    assert one.filename == __file__ and one.message.result is result
    assert str(one.message).startswith(f"solve_static: {SAYS}")
    assert str(result).splitlines()[-1].startswith(SAYS) and result.table().splitlines()[-1].startswith(SAYS)
    assert any(text.startswith(SAYS) for text in Texts(result._repr_html_()).texts)
    # what comes of that state has the same mesh
    with pytest.warns(fb.ResultWarning, match="modes: unreliable result, coarse"):
        found = fb.modes(model, state=result.state, n=2, planar=True)
    assert found.table().splitlines()[-1].startswith(SAYS)


def test_as_an_error_it_brings_the_result() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", fb.ResultWarning)
        with pytest.raises(fb.ResultWarning) as raised:
            fb.solve_static(fb.compile_scene(roll(1)))
        assert raised.value.result.info["unstable_directions"] == 0 and raised.value.result.state is not None
        # nothing to say of a finer one
        assert not doubts.doubts(fb.solve_static(fb.compile_scene(roll(2))).events)


def test_a_sweep_says_which_cases() -> None:
    def build(elements: int) -> fb.Result:
        return fb.solve_static(fb.compile_scene(roll(elements)))

    def measure(result: fb.Result) -> float:
        return float(result.info["steps"])

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        table = fb.sweep(build, {"elements": [1, 2]}, measure=measure, workers=1)
    (one,) = [x.message for x in caught if isinstance(x.message.result, fb.Sweep)]
    assert str(one).startswith(f"sweep: case 0, {SAYS}")
    assert list(table.doubts) == [0] and f"case 0, {SAYS}" in repr(table) and table.failures == []


def test_calls_of_the_package_itself_do_not_warn() -> None:
    @doubts.warns
    def analysis() -> fb.Result:
        return fb.Result(t=[0.0], events=[{"kind": "drift", "text": "large"}])

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        inside = {"__name__": "fastbeam.somewhere", "analysis": analysis}
        exec("found = analysis()", inside)
    assert inside["found"].events
    with pytest.warns(fb.ResultWarning, match="analysis: unreliable result, drift: large"):
        analysis()


def test_many_events_are_counted_and_others_do_not_count() -> None:
    events = [{"kind": kind, "text": "t"} for kind in (*KINDS, "stopped", "impact", "bifurcation")]
    lines = doubts.doubts(events)
    assert len(lines) == doubts.MOST + 1 and lines[-1] == f"and {len(KINDS) - doubts.MOST} more like these in .events"
    assert str(fb.Result(t=[0.0], events=events[-3:])).count("\n") == 0


def test_the_table_of_a_notebook_keeps_its_columns_where_numbers_are_negative() -> None:
    names = {"losses": ["damper d"], "works": []}
    run = fb.Result(t=[0.0, 1.0], names=names, series={
        "kinetic": [1.0, -2.0], "potential": [-3.0, -4.0], "total": [1.0, 1.0], "strain": np.zeros(2), "gravity": np.zeros(2),
        "balance": np.zeros(2), "losses": [[0.0], [-5.0]]})
    page = run._repr_html_()
    rows = [[cell.split(">", 1)[1].split("</td>")[0] for cell in row.split("<td")[1:]] for row in page.split("<tr>")[2:]]
    assert {len(row) for row in rows} == {4}
    cells = {row[0]: row[1:] for row in rows}
    assert cells["kinetic energy [J]"][:2] == ["1.00000000e+00", "-2.00000000e+00"]
    assert cells["potential energy [J]"][:2] == ["-3.00000000e+00", "-4.00000000e+00"]
    assert any(row[1:3] == ["0.00000000e+00", "-5.00000000e+00"] for row in rows)
