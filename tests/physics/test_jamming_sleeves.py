"""Sleeves with friction that jam: the signs of friction go in circles, and both solvers end with Coulomb's law all the same."""
from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scene_strategies import Drawn, build

import fastbeam as fb
from fastbeam.kernels.doubt import LEVEL, LEVELS, MOST_FLIPS, WITHIN
from fastbeam.kernels.step import OK
from fastbeam.newton import Stepper

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


def test_both_solvers_end_with_the_same_law(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their compliances differ by a hundredth: friction that is proportional to them made 4e-6 of 2 m of that in 12 steps."""
    doubtful: list[Any] = []
    taken = Stepper._run

    def run(self: Stepper, *args: Any) -> Any:
        outcome = taken(self, *args)
        if outcome.status == OK and self.along.flips[0] >= MOST_FLIPS:
            doubtful.append(self.along.doubt.counts[0].copy())
        return outcome

    monkeypatch.setattr(Stepper, "_run", run)
    settings: dict[str, Any] = dict(t_end=12 * JAMMING.rest["step"], step=JAMMING.rest["step"], every=1, progress=False)
    one, other = (fb.simulate(fb.compile_scene(build(JAMMING), solver=solver), **settings) for solver in ("auto", "sparse"))
    # it slips with all of its friction, or sticks
    assert len(doubtful) >= 6 and all(x[WITHIN] == 0 or x[LEVEL] == LEVELS for x in doubtful)
    assert one.series["friction_loss"][-1, 0] > 1e-4
    for name, limit in (("q", 1e-12), ("s", 1e-13)):
        np.testing.assert_allclose(getattr(one.state, name), getattr(other.state, name), rtol=0.0, atol=limit)
    for result in (one, other):
        assert result.info["fallbacks"] == 0
        assert result.drift("balance") < 1e-13 and np.all(np.diff(result.series["friction_loss"][:, 0]) >= 0.0)
