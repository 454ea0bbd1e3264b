"""Gradients of runs with what springs, motors, drives and given motions do to coordinates of joints, and with supports that move:
against differences of order 6 of runs."""
from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fastbeam as fb

sys.path.insert(0, str(Path(__file__).parents[1]))
from validation.test_adjoint_run import AWAY, SIXTH  # noqa: E402

Array = np.ndarray
STEPS, STEP = 20, 0.01
TURN = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
CASES: dict[str, dict[str, Any]] = {
    "spring, damper, stops": dict(stiffness=20.0, damping=0.4, rest=0.2, stops=fb.Stops(-0.1, 0.02, stiffness=300.0)),
    "motor": dict(torque=lambda t: 2.0 * np.sin(8.0 * t)),
    "given": dict(angle=lambda t: t * t + 0.3 * t * np.sin(7.0 * t)),
    "speed": dict(speed=lambda t: 0.5 * t),
    "law": dict(drive=fb.Drive(force=lambda t, x, rate: 2.0 - 4.0 * x - 0.5 * rate**3)),
    "controller": dict(drive=fb.Drive(position=lambda t: t, stiffness=200.0, damping=5.0)),
    "prismatic": dict(stiffness=20.0, damping=0.4, force=lambda t: 2.0 * np.cos(8.0 * t)),
    "a support that moves": {},
    "a support that turns": {},
}


def arm(kind: str, flat: bool = True, EI: float = 5.0, m: float = 0.7, pull: float = 3.0, g: float = -9.81) -> Any:  # noqa: N803
    """A body on a joint at the end of a cantilever."""
    y, case = 0.0 if flat else 1.0, CASES[kind]
    one = fb.Section(EA=1e4, GA2=4e3, GA3=5e3, GJ=4.0, EI2=EI, EI3=6.0, rhoA=1.0, rhoI2=0.02, rhoI3=0.03)
    a = fb.Beam.straight("a", (0, 0, 0), (2, 0, 0), section=one, elements=3, degree=2)
    body = fb.RigidBody("body", mass=m, inertia=(0.02, 0.03, 0.04), position=(2.3, 0.1 * y, 0.2))
    at = body.point((-0.3, -0.1 * y, -0.2))
    joint = (fb.PrismaticJoint(a.end, at, axis=(1, 0.5 * y, 0.3), **case) if kind == "prismatic" else
             fb.RevoluteJoint(a.end, at, axis=(0, 1, 0.3 * y), **case))
    support: Any = fb.Clamp(a.start)
    if kind.startswith("a support"):
        def turn(t: float) -> Array:
            return np.asarray(np.eye(3) + np.sin(2 * t) * TURN + (1 - np.cos(2 * t)) * TURN @ TURN)

        turns: dict[str, Any] = dict(rotation=turn) if "turns" in kind else {}
        support = fb.PrescribedMotion("base", a.start, displacement=lambda t: (0.3 * t * t, 0, 0.1 * np.sin(9 * t)), **turns)
    scene = fb.Scene(a, body, support, joint, fb.Load("pull", a.end, force=(0, 0.3 * y * pull, pull)), gravity=(0, 0, g))
    return scene, {"tip": a.end, "body": body.point((0.1, 0, 0.1))}


def go(**values: Any) -> Any:
    scene, points = arm(**values)
    return fb.adjoint_run(fb.compile_scene(scene), t_end=STEPS * STEP, step=STEP, points=points)


@pytest.mark.parametrize(("kind", "flat"), [("spring, damper, stops", True), *(
    pytest.param(kind, flat, marks=pytest.mark.slow) for kind in CASES for flat in (True, False)
    if flat is False or kind != "spring, damper, stops")])
def test_a_body_on_a_joint(kind: str, flat: bool) -> None:
    draw = np.random.default_rng(5)
    given = {name: draw.standard_normal((STEPS + 1, 3)) * (1, not flat, 1) for name in ("tip", "body")}
    run = go(kind=kind, flat=flat)
    by = run.gradient(points=given)
    assert run.outside == 0 and (run._stepper.plane is not None) == flat
    if "stops" in kind:
        assert np.any(run._stretch.values < -0.1) or np.any(run._stretch.values > 0.02)
    node = run._points["tip"][0][0]
    found = {"EI": by.sections["a"].stiffness[0, 4, 4], "m": by.masses["body"], "g": by.gravity[2],
             "pull": by.forces[node, 2] + (0.0 if flat else 0.3 * by.forces[node, 1])}
    for name, value in dict(EI=5.0, m=0.7, g=-9.81, pull=3.0).items():
        e = 1e-3 * value
        around = [sum(float(np.sum(w * x.point(p))) for p, w in given.items())
                  for x in (go(kind=kind, flat=flat, **{name: value + k * e}) for k in AWAY)]
        assert found[name] == pytest.approx(float(SIXTH @ np.array(around)) / e, rel=1e-8), name
