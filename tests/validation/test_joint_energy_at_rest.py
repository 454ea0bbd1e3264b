"""Energy of springs in joints of equilibria: `solve_static`, `solve_path` and `relax`, angles counted over turns."""
from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

import fastbeam as fb

STIFF, WEIGHT, ARM = 3.0, 9.81, 0.5


def pendulum() -> fb.Model:
    """A body on a hinge with a spring, its arm level at the start."""
    body = fb.RigidBody("arm", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(ARM, 0, 0))
    hinge = fb.RevoluteJoint(fb.GROUND.point((0, 0, 0)), body.point((-ARM, 0, 0)), "hinge", axis=(0, 1, 0), stiffness=STIFF)
    return fb.compile_scene(fb.Scene(body, hinge, gravity=(0, 0, -WEIGHT)))


@pytest.mark.parametrize("how", ["static", "path", "relax"])
def test_weight_on_a_hinge_with_a_spring(how: str) -> None:
    """k a = m g l cos a: the energy of the spring is k a^2/2, and it counts among the strains."""
    model = pendulum()
    angle = brentq(lambda a: STIFF * a - WEIGHT * ARM * np.cos(a), 0.0, 1.5, xtol=1e-15)
    found = fb.relax(model) if how == "relax" else fb.solve_static(model) if how == "static" else fb.solve_path(
        model, observe=("energy",))
    assert found.series["joint_energy"][-1, 0] == pytest.approx(0.5 * STIFF * angle**2, rel=1e-9)
    assert found.joint("hinge")["angle"][-1] == pytest.approx(angle, rel=1e-9)
    assert found.series["strain"][-1] == pytest.approx(0.5 * STIFF * angle**2, rel=1e-9)


def test_wound_by_a_turning_support() -> None:
    """A hinge is wound by three turns against a stiff shaft, T = angle/(1/k + L/GJ): the energy counts all of them."""
    turns, GJ = 6.0 * np.pi, 2000.0
    base = fb.RigidBody("base", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0, 0, 0))
    shaft = fb.Beam.straight("shaft", (0, 0, 0.2), (0, 0, 1.2), elements=4, section=fb.Section(
        EA=1e5, GA2=1e5, GA3=1e5, GJ=GJ, EI2=2e3, EI3=2e3, rhoA=1.0, rhoI2=1e-4, rhoI3=1e-4))
    clamp = fb.Clamp(base)
    hinge = fb.RevoluteJoint(base.point((0, 0, 0.2)), shaft.start, "hinge", axis=(0, 0, 1), stiffness=STIFF)
    model = fb.compile_scene(fb.Scene(base, shaft, clamp, fb.Clamp(shaft.end), hinge))
    found = fb.solve_path(model, moves={clamp: (0, 0, 0, 0, 0, -turns)}, observe=("energy", "reaction"), largest_step=0.5)
    torque = turns * found.series["load_factor"] / (1.0 / STIFF + 1.0 / GJ)
    np.testing.assert_allclose(found.series["joint_energy"][:, 0], 0.5 * torque**2 / STIFF, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(found.reaction("clamp of body 'base'")["moment"][:, 2], -torque, rtol=1e-8, atol=1e-12)
    assert len(torque) > 5
