"""Fronts, times at wanted errors and extrapolated limits of perf/peers, without any peer."""
from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from perf.peers import front as peers
from perf.peers import names
from perf.peers.environments import trouble

Run = peers.Run


def test_front_keeps_only_runs_that_no_other_run_beats() -> None:
    runs = [Run(1e-3, 2.0), Run(1e-2, 1.0), Run(2e-2, 1.5), Run(1e-4, 10.0), Run(5e-4, 20.0), Run(math.nan, 0.1)]
    assert peers.front(runs) == [Run(1e-2, 1.0), Run(1e-3, 2.0), Run(1e-4, 10.0)]


def test_of_two_runs_with_the_same_time_the_more_accurate_one_is_kept() -> None:
    assert peers.front([Run(1e-2, 1.0), Run(1e-3, 1.0)]) == [Run(1e-3, 1.0)]


def test_time_between_two_runs_follows_a_power_law() -> None:
    crossing = peers.time_at([Run(1e-2, 1.0), Run(1e-4, 100.0)], 1e-3)
    assert crossing.kind == "measured"
    assert crossing.time == pytest.approx(10.0) and crossing.slope == pytest.approx(1.0)


def test_time_at_the_error_of_a_run_is_its_time() -> None:
    runs = [Run(1e-2, 1.0), Run(1e-3, 3.0), Run(1e-5, 50.0)]
    assert [peers.time_at(runs, run.error).time for run in runs] == pytest.approx([1.0, 3.0, 50.0])
    assert {peers.time_at(runs, run.error).kind for run in runs} == {"measured"}


def test_an_error_above_the_cheapest_run_costs_at_most_that_run() -> None:
    crossing = peers.time_at([Run(1e-5, 0.5), Run(1e-6, 1.0)], 1e-3)
    assert (crossing.kind, crossing.time) == ("at most", 0.5)


def test_beyond_the_most_accurate_run_the_slope_of_the_tail_is_followed() -> None:
    runs = [Run(1e-1, 1.0), Run(1e-3, 1.5), Run(1e-4, 15.0), Run(1e-5, 150.0)]
    crossing = peers.time_at(runs, 1e-6)
    # the tail is a decade and a half long: the flat beginning does not count
    assert crossing.kind == "extrapolated"
    assert crossing.slope == pytest.approx(1.0) and crossing.time == pytest.approx(1500.0)


@pytest.mark.parametrize("runs", [[], [Run(1e-2, 1.0)], [Run(1e-2, 1.0), Run(0.99e-2, 90.0)], [Run(1e-1, 1.0), Run(1e-2, 10.0)]],
                         ids=["none", "one", "stalled", "too far"])
def test_what_cannot_be_extrapolated_is_not_reached(runs: list[Run]) -> None:
    crossing = peers.time_at(runs, 1e-6)
    assert crossing.kind == "not reached" and math.isnan(crossing.time)


@pytest.mark.parametrize("orders", [(2.0, 2.0), (2.0, 1.0), (4.0, 1.0)])
def test_limit_of_a_method_with_known_orders_is_exact(orders: tuple[float, float]) -> None:
    exact, a, b = np.array([[1.0, 2.0, 3.0]]), np.array([[3.0, -1.0, 2.0]]), np.array([[0.5, 0.5, -4.0]])
    runs = [(32, 0.1), (16, 0.1), (32, 0.2), (16, 0.2), (8, 0.2), (16, 0.4)]
    answers = {(n, h): exact + a / n ** orders[0] + b * h ** orders[1] for n, h in runs}
    found = peers.limit(answers, 32, 0.1, orders, 1.0)
    np.testing.assert_allclose(found.points, exact, rtol=0, atol=1e-13)
    assert found.uncertainty < 1e-13
    assert (found.order_space, found.order_time) == pytest.approx(orders)


def test_limit_with_a_wrong_order_shows_in_uncertainty_and_observed_order() -> None:
    runs = [(32, 0.1), (16, 0.1), (32, 0.2), (16, 0.2), (8, 0.2), (16, 0.4)]
    answers = {(n, h): np.array([[1.0 / n**2 + h, 0.0, 0.0]]) for n, h in runs}
    found = peers.limit(answers, 32, 0.1, (2.0, 2.0), 1.0)
    assert found.order_time == pytest.approx(1.0)
    assert found.uncertainty > 0.05


def test_distance_is_the_largest_over_all_points_relative_to_the_length() -> None:
    a = np.zeros((2, 3))
    assert peers.distance(a, a + np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0]]), 10.0) == pytest.approx(0.5)


@pytest.mark.slow  # where the environment of the peer is made
def test_names_and_program_of_the_page_for_those_who_come_from_exudyn(
        capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    # Exudyn writes a folder `solution` where it stands
    monkeypatch.chdir(tmp_path)
    if trouble("exudyn"):
        pytest.skip("exudyn is not installed: python perf/peers/environments.py exudyn")
    assert len(names.names()) > 25
    assert names.main() == 0
    place = re.search(r"x = ([\d.]+) m", capsys.readouterr().out)
    assert place is not None and float(place[1]) == pytest.approx(3.0450, abs=1e-3)
