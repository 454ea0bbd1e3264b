"""Paths of equilibria around corners, where the law of a force has a kink."""
from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

import fastbeam as fb

K, STIFF, PUSH = 1.0, 20.0, np.array((0.1, 0.0, -1.0))
ANCHOR, SLACK = np.array((-1.0, 0.0, 0.0)), 0.15


def tip(angle: float) -> np.ndarray:
    return np.array((-np.sin(angle), 0.0, np.cos(angle)))


def length(angle: float) -> float:
    """Of the rope, m."""
    return float(np.linalg.norm(tip(angle) - ANCHOR))


def moments(angle: float) -> tuple[float, float]:
    """About the foot of the bar: what keeps it upright, spring and rope, and the load of factor 1."""
    pull = STIFF * max(length(angle) - length(SLACK), 0.0) * (ANCHOR - tip(angle)) / length(angle)
    tangent = np.array((-np.cos(angle), 0.0, -np.sin(angle)))
    return float(K * angle - pull @ tangent), float(PUSH @ tangent)


def load(angle: float) -> float:
    """Load factor in equilibrium."""
    upright, pushed = moments(angle)
    return upright / pushed


def strut(turn: float) -> tuple[fb.Scene, fb.RigidBody]:
    """An upright rigid bar on a hinge with a spring; a rope, taut at first, pulls it to one side. turn: about the vertical."""
    c, s = np.cos(turn), np.sin(turn)
    q = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    bar = fb.RigidBody("bar", mass=1.0, inertia=(0.1, 0.1, 0.1), position=tip(0.0))
    foot = fb.GROUND.point((0, 0, 0)), bar.point((0, 0, -1.0))
    scene = fb.Scene(bar, fb.RevoluteJoint(*foot, "hinge", axis=q @ (0, 1, 0), stiffness=K),
                     fb.Spring(fb.GROUND.point(q @ ANCHOR), bar, "rope", stiffness=STIFF, length=length(SLACK),
                               tension_only=True),
                     fb.Load("push", bar, force=q @ PUSH))
    return scene, bar


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_a_rope_that_goes_slack_ends_what_a_strut_carries(turn: float) -> None:
    scene, bar = strut(turn)
    model = fb.compile_scene(scene)
    most = load(SLACK)
    assert load(SLACK - 1e-3) < most > load(SLACK + 1e-3)
    path = fb.solve_path(model, to=10.0, stop_at="limit", points={"tip": bar})
    point = path.info["critical_points"][-1]
    assert (point["kind"], point["type"]) == ("limit", "maximum")
    # to the smallest step, 1e-7, times the slope of the path
    assert point["load_factor"] == pytest.approx(most, rel=1e-5)
    assert path.series["load_factor"][-1] == point["load_factor"] and any(event["kind"] == "limit" for event in path.events)
    first = brentq(lambda x: moments(x)[0], 0.0, SLACK)
    at = np.arcsin(np.hypot(*path.point("tip")[:, :2].T))
    assert at[0] == pytest.approx(first, abs=1e-12)
    # the path goes on behind it, with the rope slack
    behind = fb.solve_path(model, to=0.1, points={"tip": bar}, start=path.state, load_factor=point["load_factor"], most_points=30)
    beyond = fb.solve_path(model, to=10.0, points={"tip": bar}, most_points=60)
    at = np.arcsin(np.hypot(*beyond.point("tip")[:, :2].T))
    assert at[-1] > SLACK + 0.03 and beyond.series["unstable_directions"][0] == 0.0
    np.testing.assert_allclose(beyond.series["load_factor"], [load(x) for x in at], rtol=1e-6, atol=1e-10)
    assert behind.series["load_factor"][-1] < most
