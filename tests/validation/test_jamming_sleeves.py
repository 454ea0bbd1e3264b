"""Sleeves with friction that jam: the signs of friction go in circles, and both solvers end with Coulomb's law all the same."""
from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scene_strategies import Drawn, build
from sliding_checks import settings_of

import fastbeam as fb
from fastbeam.kernels.contact.coulomb import MOST_FLIPS, WITHIN
from fastbeam.kernels.loop import OK
from fastbeam.model import start
from fastbeam.stepping.stepper import Stepper

SOFT: dict[str, float] = dict(EA=10.0, GA2=10.0, GA3=10.0, GJ=10.0, EI2=10.0, EI3=10.0, rhoA=0.1, rhoI2=1e-3, rhoI3=1e-3,
                              coupling=0)
ALONG, ACROSS = np.array((-0.88547621, -0.12622157, -0.4472136)), np.array((0.14112001, -0.9899925, 0.0))
START = np.full(3, -2.0)
# a sleeve with a bore of 7.5 mm half a metre beside the body that it carries, on an arc of 15 cm with a rod at its end
SLEEVE = dict(kind="sleeve", friction="coulomb", drive="none", stops="none", coefficient=0.05, viscous=0.1, way=-0.1, rhythm=2.0,
              force=-5.0, gains=(1.0, 0.1), before=0.002, behind=0.002, stiffness=10.0, restitution=0.0, bore=0.05, keyed=False,
              inertia=0.01)
COMMON = dict(interpolation="lagrange", degree=2)
JAMMING = Drawn(
    beams=[("arc", dict(start=START, tangent=ALONG, normal=ACROSS, radius=0.5, angle=0.3), SOFT,
            dict(elements=3, strain="simo_reissner", **COMMON)),
           ("straight", dict(start=START, end=START + ALONG, d2=ACROSS, twist=-2.0), SOFT,
            dict(elements=2, strain="green_lagrange", **COMMON))],
    rest=dict(mass=0.1, offset=np.full(3, -0.3), link=False, velocity=np.full(3, -0.5), spin=np.full(3, -0.7), step=10.0**-2.5,
              order=0, sliders=[(0, 0.25, -1.0, 0.01, "own")], sliding=[SLEEVE]), planar=False, held=False)


def jamming(step: float, mass: float, elements: int = 3, **sleeve: Any) -> Drawn:
    """As JAMMING with another step, mass of the body, elements of the arc and a sleeve that differs."""
    (kind, shape, of, mesh), rod = JAMMING.beams
    return replace(JAMMING, beams=[(kind, shape, of, {**mesh, "elements": elements}), rod],
                   rest=JAMMING.rest | {"step": step, "sliders": [(0, 0.25, -1.0, mass, "own")], "sliding": [SLEEVE | sleeve]})


# and how many of their steps are in doubt at least; steps of the others are all but too long for Newton's method
SCENES = {"short": (JAMMING, 6), "light": (jamming(0.0231846, 0.0420727), 2),
          "heavy": (jamming(0.0378094, 0.291072, 5, stops="elastic"), 2)}


# two sleeves on arcs that a body joins, in a plane: neither sticks nor slides with its first compliance
def arc(strain: str) -> tuple[str, dict[str, Any], dict[str, float], dict[str, Any]]:
    turn = np.array((-0.21549985, -0.97650387, 0.0))
    return ("arc", dict(start=np.array((-0.568, 1.592, 0.0)), tangent=turn, normal=np.array((-turn[1], turn[0], 0.0)),
                        radius=0.6515, angle=0.8319),
            dict(EA=260.615, GA2=10.7152, GA3=8531.0, GJ=512.861, EI2=28.774, EI3=1e4, rhoA=0.389045, rhoI2=0.0167494,
                 rhoI3=0.00270396),
            dict(elements=6, interpolation="lagrange", degree=4, strain=strain))


TWO = Drawn(
    beams=[arc("simo_reissner"), arc("green_lagrange")],
    rest=dict(mass=0.274157, offset=np.array((-0.1842, -0.2232, 0.0)), link=False, velocity=np.array((0.113, 0.078, 0.0)),
              spin=np.array((0.0, 0.0, -0.944)), step=0.0528923, order=0,
              sliders=[(1, 0.283, -0.078, 0.355631, "own"), (0, 0.6075, 0.696, 0.167494, "own")],
              sliding=[SLEEVE | dict(coefficient=0.72425, drive="force", force=-0.69, rhythm=8.08, stops="rigid", before=0.0547,
                                     behind=0.0195, restitution=0.193, inertia=0.0698),
                       SLEEVE | dict(coefficient=0.39575, drive="controller", force=-0.6, way=0.088, gains=(1.0568, 0.1236),
                                     bore=0.1, inertia=0.0368)]),
    planar=True, held=False)


def watched(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return a list that grows by what coordinates do in every step in which the fallback decided."""
    doubtful: list[Any] = []
    taken = Stepper._run

    def run(self: Stepper, *args: Any) -> Any:
        outcome = taken(self, *args)
        if outcome.status == OK:
            doubtful.extend(self.along.coulomb.branch[self.along.coulomb.flips >= MOST_FLIPS])
        return outcome

    monkeypatch.setattr(Stepper, "_run", run)
    return doubtful


def assert_coulombs_law(branches: list[Any], at_least: int) -> None:
    """They slip with all of their friction, or stick with less."""
    assert len(branches) >= at_least and WITHIN not in branches


def assert_same(one: fb.Result, other: fb.Result) -> None:
    for name, limit in (("q", 1e-12), ("s", 1e-13)):
        np.testing.assert_allclose(getattr(one.state, name), getattr(other.state, name), rtol=0.0, atol=limit)
    for result in (one, other):
        assert result.info["fallbacks"] == 0 and not [x for x in result.events if x["kind"] == "unresolved"]
        assert result.drift("balance") < 1e-13
        assert np.all(np.diff(result.series["friction_loss"], axis=0) >= 0.0)


@pytest.mark.parametrize("name", SCENES)
def test_both_solvers_end_with_the_same_law(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their compliances differ by a hundredth: friction that is proportional to them made 4e-6 of 2 m of that in 12 steps."""
    # starts that bend the beam, so that the sleeve jams
    monkeypatch.setattr(start, "rigid_change", lambda mass, matrix, right, given, rigid: 0.0 * given)
    doubtful, (scene, at_least) = watched(monkeypatch), SCENES[name]
    one, other = (fb.simulate(fb.compile_scene(build(scene), solver=solver), **settings_of(scene))
                  for solver in ("auto", "sparse"))
    assert_coulombs_law(doubtful, at_least)
    assert one.series["friction_loss"][-1, 0] > 1e-4
    assert_same(one, other)


def test_two_sleeves_do_the_same_in_a_plane_and_in_space(monkeypatch: pytest.MonkeyPatch) -> None:
    """A smaller compliance that is too small has to be tried in smaller steps."""
    doubtful = watched(monkeypatch)
    one, other = (fb.simulate(fb.compile_scene(build(TWO), planar=planar), **settings_of(TWO)) for planar in ("auto", False))
    assert_coulombs_law(doubtful, 4)
    assert_same(one, other)
