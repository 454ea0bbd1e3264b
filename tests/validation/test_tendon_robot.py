"""A tendon robot in time, whose eyes stick and slip together (theory.md 5.6)."""
from __future__ import annotations

import numpy as np

import fastbeam as fb
from perf.cases.tendon_robot import robot, start_of

DISCS, TENDONS, FRICTION = 5, 4, 0.2


def test_twenty_eyes_stick_and_slip_together() -> None:
    """Where the robot comes to rest, all eyes turn around within some steps; the signs of single ones go in circles then."""
    model = fb.compile_scene(robot(DISCS, TENDONS, FRICTION))
    result = fb.simulate(model, start=start_of(model, DISCS, TENDONS), t_end=1.5, step=5e-3, every=1, progress=False)
    assert result.info["steps"] == 300 and result.info["fallbacks"] == 0
    assert not [x for x in result.events if x["kind"] in ("failed", "unresolved")]
    assert result.drift("balance") < 1e-12
    loss = np.diff(result.series["friction_loss"], axis=0)
    assert np.all(loss >= -1e-18) and result.series["friction_loss"][-1].sum() > 1e-5
    # what friction holds is at rest to the last bit, and much is held in some rows and little in others
    held = np.mean(np.diff(result.series["s_slide"], axis=0) == 0.0, axis=1)
    assert held.max() > 0.0 and held.min() < 0.5
