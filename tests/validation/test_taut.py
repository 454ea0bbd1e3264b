"""Taut thin ropes: right by default. Once invariants stayed at round-off while a rope let its load fall by 40 m."""
from __future__ import annotations

import numpy as np
import pytest

import fastbeam as fb
from fastbeam.statics.load_steps import LoadSteps
from perf.stress import taut


def wrong(rows: object) -> list[str]:
    return [str(row) for row in rows if not row.ok]  # type: ignore[attr-defined]


def test_ropes_are_stable_and_vibrate_as_strings() -> None:
    assert wrong(taut.ropes(taut.FEW, taut.FEW_COUNTS)) == []


def test_the_load_swings_whatever_the_step_and_the_mesh() -> None:
    assert wrong(taut.swings(quick=True)) == []


def test_elevator_crane_and_contact_wire() -> None:
    assert wrong(taut.machines(quick=True)) == []


def test_cubic_elements_vibrate_as_a_string_to_four_digits() -> None:
    # eight elements, EI negligible; the bar is 1e-2
    assert np.abs(taut.frequency_errors(1e6, 8, degree=3)).max() < 1e-4


@pytest.mark.parametrize("elements,tension,share,family", [
    (8, 1e6, 1e-3, {"degree": 2}), (6, 1e8, 1e-2, {"degree": 3}), (2, 1e8, 1e-2, {"degree": 4}), (8, 1e8, 0.1, {"degree": 3}),
    (6, 1e8, 1e-2, {"degree": 4}), (3, 1e8, 1e-2, {"degree": 6}), (4, 1e6, 1e-3, {"degree": 3, "interpolation": "bspline"})])
def test_a_bent_rope_is_stable(elements: int, tension: float, share: float, family: dict[str, object]) -> None:
    """The first load step of a quarter led to folded shapes, that are in equilibrium too, or needed steps below 1e-6."""
    result = taut.stretched(tension, elements, share * tension, **family)[1]
    assert result.info["unstable_directions"] == 0 and not [x for x in result.events if x["kind"] == "unstable"]
    end = result.state.q.reshape(-1, 4, 3)[-1, 0]
    np.testing.assert_allclose(end[:2], (1.0 / np.hypot(1.0, share), share / np.hypot(1.0, share)), rtol=0.03, atol=2e-4)


def test_an_unstable_equilibrium_is_looked_for_again_but_not_from_a_start() -> None:
    column = fb.Beam.straight("column", (0, 0, 0), (0, 0, 1), section=taut.wire(100.0), elements=4)
    model = fb.compile_scene(fb.Scene(column, fb.Clamp(column.start), fb.Load("weight", column.end, force=(0, 0, -10.0))))
    first = fb.solve_static(model)
    # beyond Euler's load in both directions, whatever the steps
    assert first.info["unstable_directions"] == 2
    again = fb.solve_static(model, start=first.state)
    assert again.info["unstable_directions"] == 2 and again.info["steps"] <= first.info["steps"]


def cantilever(force: tuple[float, float, float], moment: tuple[float, float, float], planar: bool | str) -> fb.Model:
    section = fb.Section(EA=1e6, GA2=4e5, GA3=4e5, GJ=0.77, EI2=10.0, EI3=0.5, rhoA=1.0, rhoI2=1e-6, rhoI3=1e-6)
    beam = fb.Beam.straight("beam", (0, 0, 0), (1, 0, 0), section=section, elements=4)
    return fb.compile_scene(fb.Scene(beam, fb.Clamp(beam.start), fb.Load("end", beam.end, force=force, moment=moment)),
                            planar=planar)


def test_attempts_are_compared_only_where_stability_is_decided_alike() -> None:
    # with moments the second attempt may leave it undecided, or decide it in the plane alone
    undecided = cantilever((-2.35471, -7.08977, 15.44458), (4.2104, -4.68892, -1.42225), False)
    assert fb.solve_static(undecided).info["unstable_directions"] == 1
    flat = fb.solve_static(cantilever((3.005331785899699, 3.1976229376038035, 0), (0, 0, -4.859423093211577), "auto"))
    assert flat.info["counted_in"] == "space" and flat.info["unstable_directions"] == 1
    assert [x["kind"] for x in flat.events].count("unstable") == 1


def test_no_step_is_smaller_than_the_smallest_and_nothing_found_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    model = cantilever((-9.787132675504516, 7.982056586266808, 0), (0, 0, -2.6435250648984976), "auto")
    rows = fb.solve_static(model, load_step=0.25, smallest_step=0.25)
    assert rows.t[1] == 0.25 and np.all(np.diff(rows.t) >= 0.25 - 1e-12)
    assert rows.info["unstable_directions"] > 0
    find, calls = LoadSteps.find, []
    for wrong, kind in ((KeyboardInterrupt(), fb.Interrupted), (MemoryError("full"), MemoryError)):
        calls.clear()

        def once(self: LoadSteps, *steps: float) -> fb.Result:
            calls.append(steps)
            if len(calls) == 2:
                raise wrong
            return find(self, *steps)

        monkeypatch.setattr(LoadSteps, "find", once)
        with pytest.raises(kind) as caught:
            fb.solve_static(model)
        assert len(calls) == 2 and caught.value.result.t[-1] == 1.0
        np.testing.assert_array_equal(caught.value.result.state.q, rows.state.q)


@pytest.mark.slow
def test_other_families_steps_and_meshes() -> None:
    """Ropes of more meshes: perf/stress/taut.py."""
    others = [name for name in taut.FAMILIES if name not in taut.FEW]
    for rows in (taut.ropes(others, taut.FEW_COUNTS), taut.swings(quick=False), taut.machines(quick=False)):
        assert wrong(rows) == []
