"""Element ends that follow contacts near the ends of a beam, and the places of contacts on the mesh (theory.md (5.24))."""
from __future__ import annotations

import numpy as np
import pytest

from fastbeam.kernels.contact.moving_places import excess, on_mesh, place_at, place_of, put_shift, slope_of
from fastbeam.kernels.contact.slider import no_following

R, LENGTH, NODE = 0.1, 2.0, 0.7
PLACES = [-0.1, -0.03, 0.0, 0.05, 0.1, 0.199, 0.2, 0.21, 0.5, 1.0, 1.9, 1.99, 2.0, 2.05]
STEP = 1e-5


def followed() -> object:
    return no_following(1)._replace(reach=np.array([[LENGTH, R, R, NODE]]), shift=np.zeros((1, 5)))


def test_ends_keep_a_distance_from_the_ends_of_the_beam() -> None:
    s = np.linspace(0.0, LENGTH, 401)
    y = np.array([place_at(x, LENGTH, R, R) for x in s])
    inner = (s >= 2.0 * R) & (s <= LENGTH - 2.0 * R)
    assert np.array_equal(y[inner], s[inner])
    assert y[0] == R and y[-1] == LENGTH - R and np.all(np.diff(y) > 0.0)
    # of a beam whose ends are another contact's
    assert place_at(0.01, LENGTH, 0.0, R) == 0.01


@pytest.mark.parametrize("r", [0.0, R])
def test_excess_is_twice_differentiable(r: float) -> None:
    for x in PLACES:
        ahead, here, back = (excess(x + d, x + d, r).end for d in (STEP, 0.0, -STEP))
        found = excess(x, x, r)
        assert found.start == found.end and found.mean == pytest.approx(found.slope, abs=1e-14)
        assert found.slope == pytest.approx(0.5 * (ahead - back) / STEP, abs=1e-8)
        # half the second derivative, which is continuous
        assert 2.0 * found.bend == pytest.approx((ahead - 2.0 * here + back) / STEP**2, abs=2e-3)


def of_step(follow: object, s0: float, s1: float) -> dict[str, tuple[float, tuple[float, float, float]]]:
    """Place at the end of a step and (mean slope, slope, derivative of the mean slope)."""
    put_shift(follow, 0, s0, s1)
    u = on_mesh(follow, 0, s0, s1)
    return {"y": (place_of(follow, 0, s1), tuple(follow.shift[0, :3])), "u": (u.end, (u.mean, u.slope, u.bend))}


@pytest.mark.parametrize("s0", PLACES)
@pytest.mark.parametrize("s1", PLACES)
def test_divided_differences_and_derivatives(s0: float, s1: float) -> None:
    follow = followed()
    here = of_step(follow, s0, s1)
    start, ahead, back = of_step(follow, s0, s0), of_step(follow, s0, s1 + STEP), of_step(follow, s0, s1 - STEP)
    for name, (value, (mean, slope, bend)) in here.items():
        if s0 != s1:
            assert mean == pytest.approx((value - start[name][0]) / (s1 - s0), abs=1e-11)
        assert slope == pytest.approx(0.5 * (ahead[name][0] - back[name][0]) / STEP, abs=1e-6)
        assert bend == pytest.approx(0.5 * (ahead[name][1][0] - back[name][1][0]) / STEP, abs=1e-2)
    assert slope_of(follow, 0, s1) == here["y"][1][1]
    put_shift(follow, 0, s0, s1)
    assert tuple(follow.shift[0, 3:]) == (start["y"][0], here["y"][0])


def test_a_contact_away_from_the_ends_is_the_node() -> None:
    follow = followed()
    assert on_mesh(follow, 0, 0.25, 1.75) == (NODE, NODE, 0.0, 0.0, 0.0)
    assert on_mesh(follow, 0, 0.0, LENGTH)[:2] == (0.0, LENGTH)
